"""Compiled implicit time integration of the tree equations: Newmark and generalized-α with modified Newton iteration.

The unknowns of a step are the accelerations x = (u̇, servo accelerations) at its end. With the pseudo-acceleration a of
Arnold & Brüls (2007), Chung & Hulbert's scheme reads

    (1 − αm) a₁ + αm a₀ = (1 − αf) x₁ + αf x₀
    Δ  = h u₀ + h² [(½ − β) a₀ + β a₁],   u₁ = u₀ + h [(1 − γ) a₀ + γ a₁],   q₁ = q₀ ⊞ Δ
    x₁ = u̇(q₁, u₁, t₁)

⊞ adds increments of angles, slides and elastic coordinates, and turns a quaternion by the body-fixed rotation vector
(Brüls & Cardona 2010). Bodies that constraint equations hold to others go around with these: in systems with such
equations the origins of all free bodies are moved in axes that turn with them (`origin_end`), in which their velocities
change little. Newmark's scheme is the case αm = αf = 0. Because the equations of motion hold at the end of the step,
the stored rate belongs to the stored state. With constraint equations the state is then put back onto them, if the
system asks for it, and the rate is taken there.

One loop of steps serves two matrices of Newton's iteration, which change its speed and not its result:

- ∂(x₁ − u̇)/∂x₁ by finite differences, for every system. It is kept over the steps and remade when the iteration slows
  down.
- For systems without constraint equations that of the structure, by which the equations of motion are not solved for
  the accelerations but balanced,

      r(x) = M(q₁) x − f(q₁, u₁, t₁) = 0,    S Δx = −r,    S = M + h γ r_α C + h² β r_α K,   r_α = (1 − αf)/(1 − αm),

  with the constant damping C and stiffness K of the elastic coordinates and joint springs. S leaves out what turning
  adds to stiffness and damping, of the order (Ω h)² and Ω h of M. It has the pattern of M, so that its factors cost
  little more than M itself, and many degrees of freedom a body (nodal coordinates) need no matrix of differences.

The step of bodies in observer frames (:mod:`wt_gym.multibody.observer_frame.observer_frame_kernels`) is another: a
system that is linear in the increments and multipliers, so that one solution of it is the step.
"""

import math

from wt_gym.base.compiled import kernel
from wt_gym.multibody.integrators.integrator_kernels import normalize_quaternions
from wt_gym.multibody.tree.linear_algebra_kernels import factorize, solve_factorized
from wt_gym.multibody.tree.rate_kernels import (
    balance_terms,
    keep_drift,
    position_rates,
    prescribe_servos,
    project,
    rates,
)
from wt_gym.multibody.tree.sparse_kernels import factorize_tree, multiply_tree, solve_tree
from wt_gym.multibody.tree.tree_kernels import DIVERGED, FREE, NOT_CONVERGED, OK, SINGULAR_MASS, SPHERICAL

FRESH, EVALUATIONS, TANGENTS = range(3)
SLOW = 0.2
"""Contraction of the corrections above which the kept matrix is remade."""


@kernel
def turn_quaternion(y, q, rotation, out):
    """Out[q:q + 4] = y[q:q + 4] ∘ exp(½ rotation), a turn by a rotation vector in body axes."""
    angle = math.sqrt(rotation[0] * rotation[0] + rotation[1] * rotation[1] + rotation[2] * rotation[2])
    half = math.sin(0.5 * angle) / angle if angle > 1e-6 else 0.5 - angle * angle / 48.0
    w, x1, x2, x3 = math.cos(0.5 * angle), half * rotation[0], half * rotation[1], half * rotation[2]
    a, b1, b2, b3 = y[q], y[q + 1], y[q + 2], y[q + 3]
    c0 = a * w - b1 * x1 - b2 * x2 - b3 * x3
    c1 = a * x1 + b1 * w + b2 * x3 - b3 * x2
    c2 = a * x2 + b2 * w + b3 * x1 - b1 * x3
    c3 = a * x3 + b3 * w + b1 * x2 - b2 * x1
    scale = 1.0 / math.sqrt(c0 * c0 + c1 * c1 + c2 * c2 + c3 * c3)
    out[q], out[q + 1], out[q + 2], out[q + 3] = scale * c0, scale * c1, scale * c2, scale * c3


@kernel
def cross(a, b):
    """A × b of tuples."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@kernel
def plus(a, s, b):
    """A + s b of tuples."""
    return a[0] + s * b[0], a[1] + s * b[1], a[2] + s * b[2]


@kernel
def vector(array, i):
    """Three numbers of an array."""
    return array[i], array[i + 1], array[i + 2]


@kernel
def turned(y, q, sense, v):
    """The vector v turned by the quaternion y[q:q + 4] (sense 1) or back (−1)."""
    r = sense * y[q + 1], sense * y[q + 2], sense * y[q + 3]
    t = cross(r, v)
    twice = 2.0 / (y[q] * y[q] + r[0] * r[0] + r[1] * r[1] + r[2] * r[2])
    return plus(plus(v, twice * y[q], t), twice, cross(r, t))


@kernel
def origin_start(b, history, tree):
    """Velocity v of the origin of a free body, relative to its joint frame, in body axes, and v̇ = Rᵀ u̇ − ω × v."""
    q, first = tree.joint_q[b] + 3, tree.n_q + tree.joint_u[b]
    y, f = history.y[0], history.f[0]
    v = turned(y, q, -1.0, vector(y, first))
    return v, plus(turned(y, q, -1.0, vector(f, first)), -1.0, cross(vector(y, first + 3), v))


@kernel
def origin_end(b, h, scheme, history, x, tree, scratch):
    """Origin of a free body at the end of the step, by the scheme in axes that turn with the body.

    With v = Rᵀ u, v̇ = Rᵀ u̇ − ω × v and ψ the turn of the step (Brüls, Arnold & Cardona 2011: increments on SE(3)):

        v₁ = v₀ + h [(1 − γ) a₀ + γ a₁],   r₁ = r₀ + R₀ T(ψ) {h v₀ + h² [(½ − β) a₀ + β a₁]},   u₁ = R₁ v₁,
        T(ψ) = 1 + (1 − cos ψ)/ψ² ψ̃ + (ψ − sin ψ)/ψ³ ψ̃²

    R, r and u are those of the joint, relative to its frame. A body that goes around on a circle at constant speed
    stays on it and keeps its speed, whatever the step; in the axes of the joint it is ψ²/12 behind. The other way
    about, flight straight ahead while turning is exact there, and here bends in a step by ψ³/12 rad with Newmark's
    scheme, up to seven times as much with ρ∞ = 0, which damps the turning velocity: a share of order ψ⁴ is lost.
    """
    beta, gamma, alpha_m, alpha_f = scheme[0], scheme[1], scheme[2], scheme[3]
    q, u = tree.joint_q[b], tree.joint_u[b]
    first, trial = tree.n_q + u, scratch.trial
    a0, spin, turn = vector(history.memory, u), vector(trial, first + 3), vector(scratch.increment, u + 3)
    v0, rate0 = origin_start(b, history, tree)
    # v₁ = known + k v̇₁, and v̇₁ + ω₁ × v₁ = R₁ᵀ u̇₁ with the inverse of 1 + k ω̃₁
    share = h * gamma / (1.0 - alpha_m)
    k = share * (1.0 - alpha_f)
    known = plus(plus(v0, h * (1.0 - gamma) - share * alpha_m, a0), share * alpha_f, rate0)
    given = plus(turned(trial, q + 3, -1.0, vector(x, u)), -1.0, cross(spin, known))
    along = spin[0] * given[0] + spin[1] * given[1] + spin[2] * given[2]
    square = spin[0] * spin[0] + spin[1] * spin[1] + spin[2] * spin[2]
    rate1 = plus(plus(given, -k, cross(spin, given)), k * k * along, spin)
    weight = 1.0 / (1.0 + k * k * square)
    rate1 = rate1[0] * weight, rate1[1] * weight, rate1[2] * weight
    v1 = plus(known, k, rate1)
    for i in range(3):
        a1 = ((1.0 - alpha_f) * rate1[i] + alpha_f * rate0[i] - alpha_m * a0[i]) / (1.0 - alpha_m)
        scratch.pseudo[u + i] = a1
        scratch.increment[u + i] = h * v0[i] + h * h * ((0.5 - beta) * a0[i] + beta * a1)
    chord = vector(scratch.increment, u)
    angle = math.sqrt(turn[0] * turn[0] + turn[1] * turn[1] + turn[2] * turn[2])
    if angle > 1e-3:
        once, again = (1.0 - math.cos(angle)) / angle**2, (angle - math.sin(angle)) / angle**3
    else:
        once, again = 0.5 - angle**2 / 24.0, 1.0 / 6.0 - angle**2 / 120.0
    side = cross(turn, chord)
    shift = turned(history.y[0], q + 3, 1.0, plus(plus(chord, once, side), again, cross(turn, side)))
    velocity = turned(trial, q + 3, 1.0, v1)
    for i in range(3):
        trial[q + i] = history.y[0, q + i] + shift[i]
        trial[first + i] = velocity[i]


@kernel
def begin_memory(history, tree, constrained=None):
    """Pseudo-accelerations at the start: the accelerations there, of free bodies' origins v̇ (`origin_start`)."""
    n_y = tree.n_q + tree.n_u
    for i in range(tree.n_u):
        history.memory[i] = history.f[0, tree.n_q + i]
    for s in range(tree.n_servo):
        history.memory[tree.n_u + s] = history.f[0, n_y + tree.n_servo + s]
    if constrained is not None:
        for b in range(tree.parent.shape[0]):
            if tree.kind[b] == FREE:
                _, rate = origin_start(b, history, tree)
                for i in range(3):
                    history.memory[tree.joint_u[b] + i] = rate[i]


@kernel
def step_end(h, scheme, history, x, tree, scratch, constrained):
    """State at the end of the step (scratch.trial) for the accelerations x; also a₁ and Δ (`origin_end`)."""
    beta, gamma, alpha_m, alpha_f = scheme[0], scheme[1], scheme[2], scheme[3]
    n_q, n_u, n_s = tree.n_q, tree.n_u, tree.n_servo
    n_y = n_q + n_u
    y, a, trial, increment = history.y[0], history.memory, scratch.trial, scratch.increment
    for i in range(n_u + n_s):
        k = n_q + i if i < n_u else n_y + n_s + i - n_u
        a1 = ((1.0 - alpha_f) * x[i] + alpha_f * history.f[0, k] - alpha_m * a[i]) / (1.0 - alpha_m)
        scratch.pseudo[i] = a1
        increment[i] = h * y[k] + h * h * ((0.5 - beta) * a[i] + beta * a1)
        trial[k] = y[k] + h * ((1.0 - gamma) * a[i] + gamma * a1)
    for i in range(n_u):
        if tree.dof_q[i] >= 0:
            trial[tree.dof_q[i]] = y[tree.dof_q[i]] + increment[i]
    for s in range(n_s):
        trial[n_y + s] = y[n_y + s] + increment[n_u + s]
    for b in range(tree.parent.shape[0]):
        kind = tree.kind[b]
        if kind == SPHERICAL or kind == FREE:
            shift = 0 if kind == SPHERICAL else 3
            u = tree.joint_u[b] + shift
            turn_quaternion(y, tree.joint_q[b] + shift, increment[u : u + 3], trial)
            if constrained is not None and kind == FREE:
                origin_end(b, h, scheme, history, x, tree, scratch)


@kernel
def imbalance(h, scheme, history, x, tau, inputs, tree, work, scratch, out, difference, constrained):
    """What is left of the equations of motion at the end of the step, into out (n_v,); returns a code.

    x − u̇, for Newton's matrix from differences; M x − f for that of the structure (``difference`` None).
    """
    step_end(h, scheme, history, x, tree, scratch, constrained)
    history.counters[EVALUATIONS] += 1
    n_q, n_u, n_s = tree.n_q, tree.n_u, tree.n_servo
    if difference is None:
        balance_terms(scratch.trial, tau, inputs, tree, work, scratch.rate)
        multiply_tree(work.mass, tree.dof_parent, x, out)
        for i in range(n_u):
            out[i] -= work.force[i]
        for s in range(n_s):
            out[n_u + s] = x[n_u + s] - work.servo_acceleration[s]
    else:
        code = rates(scratch.trial, tau, inputs, tree, work, scratch.rate, constrained)
        if code != OK:
            return code
        for i in range(n_u + n_s):
            out[i] = x[i] - scratch.rate[n_q + i if i < n_u else n_q + n_u + n_s + i - n_u]
    return OK


@kernel
def newton_matrix(h, scheme, history, x, tau, inputs, tree, work, scratch, reach, difference, constrained):
    """Factors of Newton's matrix at x, where scratch.residual is up to date; returns a code.

    By forward differences ∂(x − u̇)/∂x, or S of the structure (``difference`` None).
    """
    matrix = history.matrix
    history.counters[TANGENTS] += 1
    history.counters[FRESH] = 1
    if difference is None:
        structure_matrix(h, scheme, tree, work.mass, matrix)
        return OK if factorize_tree(matrix, tree.dof_parent) else SINGULAR_MASS
    else:
        change = difference / reach
        for j in range(x.shape[0]):
            origin = x[j]
            x[j] = origin + change
            code = imbalance(
                h, scheme, history, x, tau, inputs, tree, work, scratch, scratch.shifted, difference, constrained
            )
            x[j] = origin
            if code != OK:
                history.counters[FRESH] = 0
                return code
            for i in range(x.shape[0]):
                matrix[i, j] = (scratch.shifted[i] - scratch.residual[i]) / change
        return OK if factorize(matrix, history.pivot) else NOT_CONVERGED


@kernel
def structure_matrix(h, scheme, tree, mass, matrix):
    """S = M + h γ r_α C + h² β r_α K into the lower triangle of ``matrix``."""
    ratio = (1.0 - scheme[3]) / (1.0 - scheme[2])
    by_rate, by_position = h * scheme[1] * ratio, h * h * scheme[0] * ratio
    for i in range(tree.n_u):
        matrix[i, i] = mass[i, i] + by_rate * tree.dof_damping[i] + by_position * tree.dof_stiffness[i]
        j = tree.dof_parent[i]
        while j >= 0:
            matrix[i, j] = mass[i, j]
            j = tree.dof_parent[j]
    for b in range(tree.parent.shape[0]):
        u = tree.elastic_u[b]
        for k in range(tree.n_elastic[b]):
            for j in range(k + 1):
                matrix[u + k, u + j] += by_rate * tree.damping[b, k, j] + by_position * tree.stiffness[b, k, j]


@kernel
def solve_newton(h, scheme, history, inputs, tree, r, difference):
    """Replace what is left of the equations, r (n_v,), by minus the change of the accelerations that removes it."""
    if difference is None:
        solve_tree(history.matrix, tree.dof_parent, r)
        ratio = (1.0 - scheme[3]) / (1.0 - scheme[2])
        by_rate, by_position = h * scheme[1] * ratio, h * h * scheme[0] * ratio
        for s in range(tree.n_servo):  # the other servos move as they are told
            if inputs.servo_interval[1, s] <= 0.0:
                w = tree.servo_frequency[s]
                r[tree.n_u + s] /= 1.0 + w * (2.0 * tree.servo_damping[s] * by_rate + w * by_position)
    else:
        solve_factorized(history.matrix, history.pivot, r)


@kernel
def complete_step(h, scheme, history, x, tau, inputs, tree, work, scratch, difference, constrained):
    """State and rate at the end of a step that has converged, on the constraint equations; returns a code."""
    if difference is None:
        n_q, n_u, n_s = tree.n_q, tree.n_u, tree.n_servo
        n_y, trial, rate = n_q + n_u, scratch.trial, scratch.rate
        step_end(h, scheme, history, x, tree, scratch, constrained)
        prescribe_servos(trial, tau, inputs, n_y)
        position_rates(trial, trial[n_q:n_y], tree.dof_q, tree.kind, tree.joint_q, tree.joint_u, rate)
        for i in range(n_u + n_s):
            rate[n_q + i if i < n_u else n_y + n_s + i - n_u] = x[i]
        for s in range(n_s):
            rate[n_y + s] = trial[n_y + n_s + s]
        return OK
    else:
        code = imbalance(
            h, scheme, history, x, tau, inputs, tree, work, scratch, scratch.residual, difference, constrained
        )
        if code == OK and constrained is not None:
            keep_drift(work)
            if tree.projection:
                project(scratch.trial, tree, work, scratch.shifted, scratch.rate)
                normalize_quaternions(scratch.trial, tree.kind, tree.joint_q, work.drift)
                code = rates(scratch.trial, tau, inputs, tree, work, scratch.rate, constrained)
                history.counters[EVALUATIONS] += 1
        return code


@kernel(separate=True)
def implicit_advance(history, inputs, tree, work, scratch, h, scheme, n_steps, tolerance, max_iterations, difference,
                     constrained=None):  # fmt: skip
    """Advance the state by n_steps of length h while the inputs run linearly from their start to their end.

    Parameters
    ----------
    history : History
        y (1, n) and f (1, n) state and rate; memory (n_v,) pseudo-acceleration; matrix (n_v, n_v) and pivot (n_v,)
        factors of Newton's matrix; counters (3,): matrix usable, evaluations, matrices made. n_v = n_u + n_servo.
    inputs : Inputs
    tree : Tree
    work : Work
        ``work.trail`` and ``work.trail_rate`` take the state and rate after each step, as far as they have rows.
    scratch : ImplicitScratch
    h : float
        Step [s].
    scheme : array (4,)
        β, γ, αm, αf.
    n_steps, max_iterations : int
    tolerance : float
        Newton's iteration ends when the position increments change by less than ``tolerance`` (1 + their size).
    difference : float or None
        Change of the position increments [m or rad] from which Newton's matrix is made; None: from mass, damping and
        stiffness of the structure.
    constrained : None or int
        As for the right-hand side.

    Returns
    -------
    int
        OK, NOT_CONVERGED, DIVERGED, or a code of the right-hand side.
    """
    x, r = scratch.acceleration, scratch.residual
    n_q, n_u, n_s = tree.n_q, tree.n_u, tree.n_servo
    # what a change of an acceleration does to the position at the end, by itself and by the velocity over a step
    reach = h * h * ((1.0 - scheme[3]) / (1.0 - scheme[2])) * (scheme[0] + scheme[1])
    if difference is None:  # costs little more than the mass matrix: one of a call before is not worth keeping
        history.counters[FRESH] = 0
    for step in range(n_steps):
        tau = (step + 1.0) / n_steps
        for i in range(n_u + n_s):
            x[i] = history.f[0, n_q + i if i < n_u else n_q + n_u + n_s + i - n_u]
        before, converged = 0.0, False
        for iteration in range(max_iterations):
            code = imbalance(h, scheme, history, x, tau, inputs, tree, work, scratch, r, difference, constrained)
            if code == OK and history.counters[FRESH] == 0:
                code = newton_matrix(
                    h, scheme, history, x, tau, inputs, tree, work, scratch, reach, difference, constrained
                )
            if code != OK:
                return code
            solve_newton(h, scheme, history, inputs, tree, r, difference)
            change, finite = 0.0, True
            for i in range(n_u + n_s):
                x[i] -= r[i]
                change = max(change, reach * abs(r[i]) / (1.0 + abs(scratch.increment[i])))
                finite = finite and abs(x[i]) < 1e30
            if not finite:
                return DIVERGED
            if change < tolerance:
                converged = True
                break
            if iteration > 0 and change > SLOW * before:
                history.counters[FRESH] = 0
            before = change
        if not converged:
            return NOT_CONVERGED
        code = complete_step(h, scheme, history, x, tau, inputs, tree, work, scratch, difference, constrained)
        if code != OK:
            return code
        for i in range(n_u + n_s):
            history.memory[i] = scratch.pseudo[i]
        for i in range(history.y.shape[1]):
            if not abs(scratch.trial[i]) < 1e12:
                return DIVERGED
            history.y[0, i], history.f[0, i] = scratch.trial[i], scratch.rate[i]
        if step < work.trail.shape[0]:
            for i in range(history.y.shape[1]):
                work.trail[step, i], work.trail_rate[step, i] = history.y[0, i], history.f[0, i]
    return OK
