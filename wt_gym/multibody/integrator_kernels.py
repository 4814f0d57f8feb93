"""Compiled time integration of the tree equations: the modified Hamming predictor–corrector scheme.

Gebhardt, Preidikman, Jørgensen & Massa 2012, section 4: explicit/modified Euler, two- and three-step
Adams–Bashforth/Adams–Moulton starters, then Hamming's fourth-order scheme with modifier and final correction. The
rate at the end of a step is evaluated again at the corrected state (a P M E (C E)ᵏ F E sequence), because the next step
and the loads of the air need accelerations that belong to the stored state.
"""

from wt_gym.compiled import kernel
from wt_gym.multibody.tree_kernels import FREE, SPHERICAL, rates

OK, SINGULAR, DIVERGED = 0, 1, 2


@kernel
def hamming_advance(history, inputs, tree, work, h, n_steps, n_corrections):
    """Advance the state by n_steps of length h while the inputs run linearly from their start to their end.

    Parameters
    ----------
    history : HammingHistory
        y (4, n) and f (4, n), newest last; error (n,); filled (1,) number of valid older points.
    inputs : Inputs
    tree, work : arrays of the system
    h : float
        Step [s].
    n_steps, n_corrections : int

    Returns
    -------
    int
        0, or 1 for a mass matrix that is not positive definite, or 2 for a state that is not finite.
    """
    y, f, e = history.y, history.f, history.error
    p, c, fn = work.predictor, work.corrector, work.rate
    n = p.shape[0]
    for step in range(n_steps):
        tau = (step + 1.0) / n_steps
        filled = history.filled[0]
        for i in range(n):
            if filled >= 3:
                p[i] = y[0, i] + 4.0 * h / 3.0 * (2.0 * f[3, i] - f[2, i] + 2.0 * f[1, i])
                c[i] = p[i] + 112.0 / 9.0 * e[i]
            elif filled == 2:
                p[i] = y[3, i] + h / 12.0 * (23.0 * f[3, i] - 16.0 * f[2, i] + 5.0 * f[1, i])
                c[i] = p[i]
            elif filled == 1:
                p[i] = y[3, i] + h / 2.0 * (3.0 * f[3, i] - f[2, i])
                c[i] = p[i]
            else:
                p[i] = y[3, i] + h * f[3, i]
                c[i] = p[i]
        for _ in range(n_corrections):
            if not rates(c, tau, inputs, tree, work, fn):
                return SINGULAR
            for i in range(n):
                if filled >= 3:
                    c[i] = 0.125 * (9.0 * y[3, i] - y[1, i] + 3.0 * h * (fn[i] + 2.0 * f[3, i] - f[2, i]))
                elif filled == 2:
                    c[i] = y[3, i] + h / 24.0 * (9.0 * fn[i] + 19.0 * f[3, i] - 5.0 * f[2, i] + f[1, i])
                elif filled == 1:
                    c[i] = y[3, i] + h / 12.0 * (5.0 * fn[i] + 8.0 * f[3, i] - f[2, i])
                else:
                    c[i] = y[3, i] + h / 2.0 * (fn[i] + f[3, i])
        if filled >= 2:
            for i in range(n):
                e[i] = 9.0 / 121.0 * (c[i] - p[i])
                if filled >= 3:
                    c[i] -= e[i]
        for i in range(n):
            if not abs(c[i]) < 1e12:
                return DIVERGED
        normalise_quaternions(c, tree)
        if not rates(c, tau, inputs, tree, work, fn):
            return SINGULAR
        for i in range(n):
            y[0, i], y[1, i], y[2, i], y[3, i] = y[1, i], y[2, i], y[3, i], c[i]
            f[0, i], f[1, i], f[2, i], f[3, i] = f[1, i], f[2, i], f[3, i], fn[i]
        if filled < 3:
            history.filled[0] = filled + 1
    return OK


@kernel
def normalise_quaternions(y, tree):
    """Scale the quaternions of spherical and free joints to unit length."""
    for b in range(tree.parent.shape[0]):
        if tree.kind[b] == SPHERICAL or tree.kind[b] == FREE:
            q = tree.joint_q[b] + (0 if tree.kind[b] == SPHERICAL else 3)
            n = 0.0
            for i in range(4):
                n += y[q + i] * y[q + i]
            scale = 1.0 / n**0.5
            for i in range(4):
                y[q + i] *= scale
