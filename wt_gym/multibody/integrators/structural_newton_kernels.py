"""Compiled implicit integration of a tree with Newton's matrix from the mass, damping and stiffness of its bodies.

The schemes are those of :mod:`wt_gym.multibody.integrators.implicit_kernels`; the equations of motion are not solved
for the accelerations but balanced,

    r(x) = M(q₁) x − f(q₁, u₁, t₁) = 0,    S Δx = −r,    S = M + h γ r_α C + h² β r_α K,   r_α = (1 − αf)/(1 − αm),

with the constant damping C and stiffness K of the elastic coordinates and joint springs. S leaves out what turning adds
to stiffness and damping, of the order (Ω h)² and Ω h of M: it slows the iteration down and does not change its result.
S has the pattern of M, so that its factors cost little more than M itself, and many degrees of freedom a body (nodal
coordinates) need no matrix of differences. Only for systems without constraint equations.
"""

from wt_gym.compiled import kernel
from wt_gym.multibody.integrators.implicit_kernels import SLOW, step_end
from wt_gym.multibody.tree.rate_kernels import balance_terms, position_rates, prescribe_servos
from wt_gym.multibody.tree.sparse_kernels import factorize_tree, multiply_tree, solve_tree
from wt_gym.multibody.tree.tree_kernels import DIVERGED, NOT_CONVERGED, OK, SINGULAR_MASS


@kernel
def newton_matrix_of_structure(by_rate, by_position, tree, mass, matrix):
    """S into the lower triangle of ``matrix``, for what a change of x does to rates and positions at the end."""
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


@kernel(separate=True)
def tree_rates(y, tau, inputs, tree, work, dy):
    """As `wt_gym.multibody.tree.rate_kernels.rates` without constraint equations, by factors along the branches."""
    balance_terms(y, tau, inputs, tree, work, dy)
    n_q, n_u, force = tree.n_q, tree.n_u, work.force
    if not factorize_tree(work.mass, tree.dof_parent):
        return SINGULAR_MASS
    solve_tree(work.mass, tree.dof_parent, force)
    for i in range(n_u):
        dy[n_q + i] = force[i]
    position_rates(y, y[n_q : n_q + n_u], tree.dof_q, tree.kind, tree.joint_q, tree.joint_u, dy)
    return OK


@kernel(separate=True)
def structural_advance(history, inputs, tree, work, scratch, h, scheme, n_steps, tolerance, max_iterations):
    """Advance the state by n_steps of length h while the inputs run linearly from their start to their end.

    Parameters
    ----------
    history : History
    inputs : Inputs
    tree, work : arrays of the system
        ``work.trail`` and ``work.trail_rate`` take the state and rate after each step, as far as they have rows.
    scratch : ImplicitScratch
    h : float
        Step [s].
    scheme : array (4,)
        β, γ, αm, αf.
    n_steps, max_iterations : int
    tolerance : float
        The iteration ends when the position increments change by less than ``tolerance`` (1 + their size).

    Returns
    -------
    int
        OK, NOT_CONVERGED, SINGULAR_MASS or DIVERGED.
    """
    x, r, trial, rate = scratch.acceleration, scratch.residual, scratch.trial, scratch.rate
    n_q, n_u, n_s = tree.n_q, tree.n_u, tree.n_servo
    n_y = n_q + n_u
    ratio = (1.0 - scheme[3]) / (1.0 - scheme[2])
    by_rate, by_position = h * scheme[1] * ratio, h * h * scheme[0] * ratio
    reach = h * h * ratio * (scheme[0] + scheme[1])
    fresh = True
    for step in range(n_steps):
        tau = (step + 1.0) / n_steps
        for i in range(n_u + n_s):
            x[i] = history.f[0, n_q + i if i < n_u else n_y + n_s + i - n_u]
        before, converged = 0.0, False
        for iteration in range(max_iterations):
            step_end(h, scheme, history, x, tree, scratch, None)
            balance_terms(trial, tau, inputs, tree, work, rate)
            multiply_tree(work.mass, tree.dof_parent, x, r)
            for i in range(n_u):
                r[i] -= work.force[i]
            if fresh:
                newton_matrix_of_structure(by_rate, by_position, tree, work.mass, history.matrix)
                if not factorize_tree(history.matrix, tree.dof_parent):
                    return SINGULAR_MASS
                fresh = False
            solve_tree(history.matrix, tree.dof_parent, r)
            for s in range(n_s):
                wn, free = tree.servo_frequency[s], inputs.servo_interval[1, s] <= 0.0
                own = 1.0 + wn * (2.0 * tree.servo_damping[s] * by_rate + wn * by_position) if free else 1.0
                r[n_u + s] = (x[n_u + s] - work.servo_acceleration[s]) / own
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
            fresh = iteration > 0 and change > SLOW * before  # S of the first step serves the others too
            before = change
        if not converged:
            return NOT_CONVERGED
        step_end(h, scheme, history, x, tree, scratch, None)
        prescribe_servos(trial, tau, inputs, n_y)
        position_rates(trial, trial[n_q:n_y], tree.dof_q, tree.kind, tree.joint_q, tree.joint_u, rate)
        for i in range(n_u + n_s):
            history.memory[i] = scratch.pseudo[i]
            rate[n_q + i if i < n_u else n_y + n_s + i - n_u] = x[i]
        for s in range(n_s):
            rate[n_y + s] = trial[n_y + n_s + s]
        for i in range(trial.shape[0]):
            if not abs(trial[i]) < 1e12:
                return DIVERGED
            history.y[0, i], history.f[0, i] = trial[i], rate[i]
        if step < work.trail.shape[0]:
            for i in range(trial.shape[0]):
                work.trail[step, i], work.trail_rate[step, i] = trial[i], rate[i]
    return OK
