"""Compiled time integration of the tree equations: the modified Hamming predictor–corrector scheme.

Gebhardt, Preidikman, Jørgensen & Massa 2012, section 4: explicit/modified Euler, two- and three-step
Adams–Bashforth/Adams–Moulton starters, then Hamming's fourth-order scheme with modifier and final correction. The
rate at the end of a step is evaluated again at the corrected state (a P M E (C E)ᵏ F E sequence), because the next step
and the loads of the air need accelerations that belong to the stored state.

The first starter leaves an error of order h³, and so the whole run. The classical Runge–Kutta scheme may take the first
three steps instead: the error it leaves is that of the scheme itself.

Positions and velocities that have left the constraint equations during a step are put back at its end (the closest
state, in the norm of the mass matrix), before the last evaluation; Baumgarte's terms then have nothing left to do. A
system without projection leaves it to them.
"""

from wt_gym.base.compiled import kernel
from wt_gym.multibody.tree.rate_kernels import keep_drift, prescribe_servos, project, rates
from wt_gym.multibody.tree.tree_kernels import DIVERGED, FREE, OK, SPHERICAL


@kernel(separate=True, distinct=True)
def hamming_advance(history, inputs, tree, work, h, n_steps, n_corrections, constrained=None, last_rate=True):
    """Advance the state by n_steps of length h while the inputs run linearly from their start to their end.

    Parameters
    ----------
    history : History
        y (4, n) and f (4, n), newest last; memory (n,) the error; counters (1,) number of valid older points, or minus
        the number of Runge–Kutta steps still to go.
    inputs : Inputs
    tree, work : arrays of the system
        ``work.trail`` and ``work.trail_rate`` take the state and rate after each step, as far as they have rows.
    h : float
        Step [s]; without steps the fraction of the interval at which the inputs are taken.
    n_steps : int
        0 only evaluates the rate of the newest state, into the newest f.
    n_corrections : int
        A Runge–Kutta step has always three.
    constrained : None or int
        See :func:`wt_gym.multibody.tree.rate_kernels.rates`.
    last_rate : bool
        False leaves out the evaluation at the end of the last step, for a caller that asks for it later, with other
        inputs, or throws the state away; the newest f, and its copy in ``work.trail_rate``, is then out of date.

    Returns
    -------
    int
        OK, SINGULAR_MASS, SINGULAR_CONSTRAINTS or DIVERGED (the state is not finite).
    """
    y, f, e = history.y, history.f, history.memory
    p, c, fn = work.predictor, work.corrector, work.rate
    n = p.shape[0]
    for step in range(max(n_steps, 1)):
        tau = (step + 1.0) / n_steps if n_steps else h
        filled = history.counters[0]
        n_passes = n_corrections if filled >= 0 else 3
        for i in range(n):
            if n_steps == 0:
                c[i] = y[3, i]
            elif filled >= 3:
                p[i] = y[0, i] + 4.0 * h / 3.0 * (2.0 * f[3, i] - f[2, i] + 2.0 * f[1, i])
                c[i] = p[i] + 112.0 / 9.0 * e[i]
            elif filled == 2:
                p[i] = y[3, i] + h / 12.0 * (23.0 * f[3, i] - 16.0 * f[2, i] + 5.0 * f[1, i])
                c[i] = p[i]
            elif filled == 1:
                p[i] = y[3, i] + h / 2.0 * (3.0 * f[3, i] - f[2, i])
                c[i] = p[i]
            elif filled == 0:
                p[i] = y[3, i] + h * f[3, i]
                c[i] = p[i]
            else:  # p gathers the weighted slopes
                p[i] = y[3, i] + h / 6.0 * f[3, i]
                c[i] = y[3, i] + h / 2.0 * f[3, i]
        n_evaluations = n_passes + 1 if constrained is None else n_passes + 2
        for k in range(n_evaluations if n_steps else 1):
            if k == n_evaluations - 1 and step == n_steps - 1 and not last_rate:
                break
            middle = 0.5 / n_steps if filled < 0 and k < 2 and n_steps else 0.0
            code = rates(c, tau - middle, inputs, tree, work, fn, constrained)
            if code != OK:
                return code
            if n_steps == 0:
                for i in range(n):
                    f[3, i] = fn[i]
                return OK
            if k == n_evaluations - 1:
                break
            if k == n_passes:  # only with constraint equations
                keep_drift(work)
                if tree.projection:
                    project(c, tree, work, p, fn)
                continue
            for i in range(n):
                if filled >= 3:
                    c[i] = 0.125 * (9.0 * y[3, i] - y[1, i] + 3.0 * h * (fn[i] + 2.0 * f[3, i] - f[2, i]))
                elif filled == 2:
                    c[i] = y[3, i] + h / 24.0 * (9.0 * fn[i] + 19.0 * f[3, i] - 5.0 * f[2, i] + f[1, i])
                elif filled == 1:
                    c[i] = y[3, i] + h / 12.0 * (5.0 * fn[i] + 8.0 * f[3, i] - f[2, i])
                elif filled == 0:
                    c[i] = y[3, i] + h / 2.0 * (fn[i] + f[3, i])
                else:
                    p[i] += h / 6.0 * fn[i] * (2.0 if k < 2 else 1.0)
                    c[i] = p[i] if k == 2 else y[3, i] + h * fn[i] * (0.5 if k == 0 else 1.0)
            if k == n_passes - 1:
                for i in range(n):
                    if filled >= 2:
                        e[i] = 9.0 / 121.0 * (c[i] - p[i])
                    if filled >= 3:
                        c[i] -= e[i]
                    if not abs(c[i]) < 1e12:
                        return DIVERGED
                normalize_quaternions(c, tree.kind, tree.joint_q, work.drift)
        prescribe_servos(c, tau, inputs, tree.n_q + tree.n_u)
        for i in range(n):
            y[0, i], y[1, i], y[2, i], y[3, i] = y[1, i], y[2, i], y[3, i], c[i]
            f[0, i], f[1, i], f[2, i], f[3, i] = f[1, i], f[2, i], f[3, i], fn[i]
        if step < work.trail.shape[0]:
            for i in range(n):
                work.trail[step, i] = c[i]
                work.trail_rate[step, i] = fn[i]
        if filled < 3:
            history.counters[0] = filled + 1 if filled != -1 else 3
    return OK


@kernel
def normalize_quaternions(y, kinds, joint_q, drift):
    """Scale the quaternions of spherical and free joints to unit length; drift[0] keeps the largest | |q| − 1 |."""
    for b in range(kinds.shape[0]):
        if kinds[b] == SPHERICAL or kinds[b] == FREE:
            q = joint_q[b] + (0 if kinds[b] == SPHERICAL else 3)
            n = 0.0
            for i in range(4):
                n += y[q + i] * y[q + i]
            scale = 1.0 / n**0.5
            drift[0] = max(drift[0], abs(n**0.5 - 1.0))
            for i in range(4):
                y[q + i] *= scale
