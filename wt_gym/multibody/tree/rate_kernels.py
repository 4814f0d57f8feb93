"""Compiled right-hand side of a system: the rates of its positions, velocities and servos."""

from wt_gym.base.compiled import kernel
from wt_gym.multibody.constraints.constraint_kernels import constraint_rows, solve_constrained
from wt_gym.multibody.tree.linear_algebra_kernels import cholesky, solve_lower, solve_upper
from wt_gym.multibody.tree.sparse_kernels import factorize_tree, solve_tree
from wt_gym.multibody.tree.tree_kernels import FREE, OK, SINGULAR_MASS, SPHERICAL, assemble, kinematics


@kernel(inline="always")
def rates(y, tau, inputs, tree, work, dy, constrained=None):
    """dy/dt for the state y = [q, u, servo angles, servo rates] at the fraction tau of the input interval.

    inputs holds the loads at both ends of the interval: body_loads (2, n_b, 6 + n_f), dof_force (2, n_u),
    reference (2, n_u), reference_rate (2, n_u), servo_command (2, n_servo); linear in between. What
    `prescribe_servos` prescribes is written into y.

    ``constrained`` is None for a system without constraint equations, which then cost neither time nor compilation.
    Returns OK, SINGULAR_MASS or SINGULAR_CONSTRAINTS. The accelerations are also left in work.force, the constraint
    forces on the second bodies in work.multipliers.
    """
    balance_terms(y, tau, inputs, tree, work, dy)
    n_q, n_u, force = tree.n_q, tree.n_u, work.force
    yd = y[n_q : n_q + n_u]
    if constrained is None:
        if not cholesky(work.mass):
            return SINGULAR_MASS
        solve_lower(work.mass, force)
        solve_upper(work.mass, force)
    else:
        constraint_rows(y, tree, work)
        code = solve_constrained(tree, work)
        if code != OK:
            return code
    for i in range(n_u):
        dy[n_q + i] = force[i]
    position_rates(y, yd, tree.dof_q, tree.kind, tree.joint_q, tree.joint_u, dy)
    return OK


@kernel(separate=True)
def tree_rates(y, tau, inputs, tree, work, dy):
    """As `rates` without constraint equations, by factors along the branches of the tree, for many coordinates."""
    balance_terms(y, tau, inputs, tree, work, dy)
    n_q, n_u, force = tree.n_q, tree.n_u, work.force
    if not factorize_tree(work.mass, tree.dof_parent):
        return SINGULAR_MASS
    solve_tree(work.mass, tree.dof_parent, force)
    for i in range(n_u):
        dy[n_q + i] = force[i]
    position_rates(y, y[n_q : n_q + n_u], tree.dof_q, tree.kind, tree.joint_q, tree.joint_u, dy)
    return OK


@kernel(inline="always")
def balance_terms(y, tau, inputs, tree, work, dy):
    """The two sides of M u̇ = f, into work.mass (lower triangle) and work.force, and the rates of the servos into dy.

    Arguments as for `rates`; the kinematics are then up to date.
    """
    n_q, n_u, n_s = tree.n_q, tree.n_u, tree.n_servo
    n_y = n_q + n_u
    yd = y[n_q:n_y]
    prescribe_servos(y, tau, inputs, n_y)
    for s in range(n_s):
        command = inputs.servo_command[0, s] + tau * (inputs.servo_command[1, s] - inputs.servo_command[0, s])
        angle, rate = y[n_y + s], y[n_y + n_s + s]
        wn, interval = tree.servo_frequency[s], inputs.servo_interval[1, s]
        if interval > 0.0:
            change = inputs.servo_rate[1, s] - inputs.servo_rate[0, s]
            work.servo_acceleration[s] = 30.0 * (tau * (1.0 - tau)) ** 2 * change / interval
        else:
            work.servo_acceleration[s] = wn * wn * (command - angle) - 2.0 * tree.servo_damping[s] * wn * rate
        dy[n_y + s] = rate
        dy[n_y + n_s + s] = work.servo_acceleration[s]
    kinematics(y, tree, work)
    loads = work.loads
    for b in range(loads.shape[0]):
        for i in range(loads.shape[1]):
            loads[b, i] = inputs.body_loads[0, b, i] + tau * (inputs.body_loads[1, b, i] - inputs.body_loads[0, b, i])
    assemble(y, loads, tree, work)
    force = work.force
    for i in range(n_u):
        force[i] += inputs.dof_force[0, i] + tau * (inputs.dof_force[1, i] - inputs.dof_force[0, i])
        k, c = tree.dof_stiffness[i], tree.dof_damping[i]
        if k != 0.0 or c != 0.0:
            ref = inputs.reference[0, i] + tau * (inputs.reference[1, i] - inputs.reference[0, i])
            ref_rate = inputs.reference_rate[0, i] + tau * (inputs.reference_rate[1, i] - inputs.reference_rate[0, i])
            force[i] += k * (ref - y[tree.dof_q[i]]) + c * (ref_rate - yd[i])


@kernel(separate=True)
def force_balance(y, inputs, tree, work, dy):
    """As `balance_terms` at the start of the input interval, for Python."""
    balance_terms(y, 0.0, inputs, tree, work, dy)


@kernel
def prescribe_servos(y, tau, inputs, n_y):
    """Angles and rates of servos that follow their commands exactly, into the state y, at the fraction tau.

    Those with servo_interval (2, n_servo) > 0: over this time [s] the rate goes from servo_rate[0] to servo_rate[1] by
    10 τ³ − 15 τ⁴ + 6 τ⁵, and the angle, its integral, ends on servo_command[1]. The acceleration and its slope vanish
    at both ends: a multistep scheme, which answers jumps of what drives the other bodies with errors of the first
    order, then keeps the momentum that the drive exchanges with them. n_y is the number of positions and velocities.
    """
    n_s = inputs.servo_rate.shape[1]
    for s in range(n_s):
        interval = inputs.servo_interval[1, s]
        if interval > 0.0:
            first, change = inputs.servo_rate[0, s], inputs.servo_rate[1, s] - inputs.servo_rate[0, s]
            risen = tau * tau * tau * (10.0 + tau * (6.0 * tau - 15.0))
            turned = tau**4 * (2.5 + tau * (tau - 3.0))
            y[n_y + n_s + s] = first + risen * change
            y[n_y + s] = inputs.servo_command[1, s] - interval * ((1.0 - tau) * first + (0.5 - turned) * change)


@kernel
def position_rates(y, yd, dof_q, kinds, joint_q, joint_u, dy):
    """q̇ from u: equal for joint angles, slides and elastic coordinates, ½ q ∘ (0, ω) for quaternions."""
    for i in range(dof_q.shape[0]):
        if dof_q[i] >= 0:
            dy[dof_q[i]] = yd[i]
    for b in range(kinds.shape[0]):
        kind = kinds[b]
        if kind == SPHERICAL or kind == FREE:
            shift = 0 if kind == SPHERICAL else 3
            q, u = joint_q[b] + shift, joint_u[b] + shift
            a, x, yy, z = y[q], y[q + 1], y[q + 2], y[q + 3]
            w0, w1, w2 = yd[u], yd[u + 1], yd[u + 2]
            dy[q] = -0.5 * (x * w0 + yy * w1 + z * w2)
            dy[q + 1] = 0.5 * (a * w0 + yy * w2 - z * w1)
            dy[q + 2] = 0.5 * (a * w1 + z * w0 - x * w2)
            dy[q + 3] = 0.5 * (a * w2 + x * w1 - yy * w0)


@kernel
def keep_drift(work):
    """``work.drift`` keeps the largest |φ| [1] and |φ̇| [2] that the right-hand side has found; see `Drift` for [0]."""
    for i in range(work.residual.shape[0]):
        work.drift[1] = max(work.drift[1], abs(work.residual[i]))
        work.drift[2] = max(work.drift[2], abs(work.residual_rate[i]))


@kernel(separate=True)
def project(y, tree, work, change, shift):
    """Put a state back onto the constraint equations φ = 0, φ̇ = 0, in place.

    One Newton step to the closest state in the norm of the augmented mass matrix L Lᵀ = M + Bᵀ W B:
    δ = L⁻ᵀ X (XᵀX)⁻¹ φ with X = L⁻¹ Bᵀ, for positions with φ and for velocities with φ̇. Factors and residuals are those
    that the right-hand side left in ``work`` for the same state. change, shift (n_state,) are scratch.
    """
    n_q, n_u, n_c = tree.n_q, tree.n_u, work.residual.shape[0]
    delta, pull = change[:n_u], work.weight
    for level in range(2):
        for i in range(n_c):
            pull[i] = work.residual[i] if level == 0 else work.residual_rate[i]
        solve_lower(work.schur, pull)
        solve_upper(work.schur, pull)
        for u in range(n_u):
            delta[u] = 0.0
            for i in range(n_c):
                delta[u] += work.half_jacobian[i, u] * pull[i]
        solve_upper(work.mass, delta)
        if level == 0:
            position_rates(y, delta, tree.dof_q, tree.kind, tree.joint_q, tree.joint_u, shift)
            for i in range(n_q):
                y[i] -= shift[i]
        else:
            for u in range(n_u):
                y[n_q + u] -= delta[u]
