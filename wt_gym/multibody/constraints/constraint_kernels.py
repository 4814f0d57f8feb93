"""Compiled constraint equations between bodies, and the solution of the equations of motion with their multipliers.

Closed loops, or a blade held to its hub as in Gebhardt et al. 2012, eqs. 6–11, keep their Lagrange multipliers:

    [M  −Bᵀ] [u̇]   [f                     ]
    [B   0 ] [λ ] = [−γ − 2 α φ̇ − α² φ    ]      (Baumgarte 1972, critically damped)
"""

from wt_gym.base.compiled import kernel
from wt_gym.multibody.tree.linear_algebra_kernels import cholesky, solve_lower, solve_upper
from wt_gym.multibody.tree.rotation_kernels import cross_add, rotation_exp
from wt_gym.multibody.tree.tree_kernels import OK, SINGULAR_CONSTRAINTS, SINGULAR_MASS, joint_frame

WELD, HINGE, BALL = range(3)


@kernel
def constraint_frame(c, side, y, yd, tree, work):
    """Global motion of the frame of constraint c on its first (0) or second (1) body, with dense Jacobians."""
    k = tree.parent.shape[0] + 2 * c + side
    p = tree.constraint_body[c, side]
    n_in = joint_frame(k, p, y, yd, tree, work)
    jl, ja = work.frame_jl[side], work.frame_ja[side]
    jl[:, :] = 0.0
    ja[:, :] = 0.0
    if p < 0:
        for i in range(3):
            work.frame_r[side, i] = work.place[i]
            work.frame_v[side, i] = 0.0
            work.frame_w[side, i] = 0.0
            work.frame_bl[side, i] = 0.0
            work.frame_ba[side, i] = 0.0
            for j in range(3):
                work.frame_rot[side, i, j] = work.joint_rot[i, j]
        return
    rot = work.rot[p]
    n_parent = tree.n_col[p]
    for i in range(3):
        work.frame_r[side, i] = work.r[p, i]
        work.frame_v[side, i] = 0.0
        work.frame_w[side, i] = 0.0
        work.frame_bl[side, i] = 0.0
        work.frame_ba[side, i] = 0.0
        for m in range(3):
            work.frame_r[side, i] += rot[i, m] * work.place[m]
            work.frame_v[side, i] += rot[i, m] * work.joint_v[m]
            work.frame_w[side, i] += rot[i, m] * work.joint_omega[m]
            work.frame_bl[side, i] += rot[i, m] * work.joint_bias_lin[m]
            work.frame_ba[side, i] += rot[i, m] * work.joint_bias_ang[m]
        for j in range(3):
            work.frame_rot[side, i, j] = (
                rot[i, 0] * work.joint_rot[0, j] + rot[i, 1] * work.joint_rot[1, j] + rot[i, 2] * work.joint_rot[2, j]
            )
        for col in range(n_in):
            u = tree.cols[p, col] if col < n_parent else tree.elastic_u[p] + col - n_parent
            jl[i, u] = (
                rot[i, 0] * work.joint_vl[0, col]
                + rot[i, 1] * work.joint_vl[1, col]
                + rot[i, 2] * work.joint_vl[2, col]
            )
            ja[i, u] = (
                rot[i, 0] * work.joint_va[0, col]
                + rot[i, 1] * work.joint_va[1, col]
                + rot[i, 2] * work.joint_va[2, col]
            )


@kernel
def turn_by_servo(c, y, tree, work):
    """Turn the first frame of constraint c by its servo angle about the constraint's axis."""
    s = tree.constraint_servo[c]
    n_y = tree.n_q + tree.n_u
    angle, rate, accel = y[n_y + s], y[n_y + tree.n_servo + s], work.servo_acceleration[s]
    axis, rot = tree.constraint_axis[c], work.frame_rot[0]
    for i in range(3):
        work.turn[i] = axis[i] * angle
        work.turn_rate[i] = rot[i, 0] * axis[0] + rot[i, 1] * axis[1] + rot[i, 2] * axis[2]
    rotation_exp(work.turn, work.turn_rot, work.tangent)
    for i in range(3):
        r0, r1, r2 = rot[i, 0], rot[i, 1], rot[i, 2]
        for j in range(3):
            rot[i, j] = r0 * work.turn_rot[0, j] + r1 * work.turn_rot[1, j] + r2 * work.turn_rot[2, j]
        work.frame_ba[0, i] += work.turn_rate[i] * accel
        work.one[i] = work.turn_rate[i] * rate
    cross_add(work.frame_w[0], work.one, work.frame_ba[0])
    for i in range(3):
        work.frame_w[0, i] += work.one[i]


@kernel(separate=True)
def constraint_rows(y, tree, work):
    """Jacobian B, acceleration bias γ and residuals φ, φ̇ of all constraints, in axes of their first frames.

    Rows of constraint c: the position of the second frame in the first (three), then its rotation against the first
    (three for a weld, two for a revolute, none for a ball). φ̈ = B u̇ + γ.
    """
    yd = y[tree.n_q : tree.n_q + tree.n_u]
    n_u = tree.n_u
    row = 0
    for c in range(tree.constraint_kind.shape[0]):
        constraint_frame(c, 0, y, yd, tree, work)
        if tree.constraint_servo[c] >= 0:
            turn_by_servo(c, y, tree, work)
        constraint_frame(c, 1, y, yd, tree, work)
        rc, rd, wc, wd = work.frame_rot[0], work.frame_rot[1], work.frame_w[0], work.frame_w[1]
        delta, rate, bias, spin = work.one, work.two, work.turn, work.turn_rate
        for i in range(3):
            delta[i] = work.frame_r[1, i] - work.frame_r[0, i]
            rate[i] = work.frame_v[1, i] - work.frame_v[0, i]
            bias[i] = work.frame_bl[1, i] - work.frame_bl[0, i]
            spin[i] = work.frame_ba[1, i] - work.frame_ba[0, i]
            work.place[i] = 0.0
            work.place_rate[i] = 0.0
        cross_add(delta, wc, rate)  # ḋ seen from the first frame
        cross_add(wc, delta, work.place)
        for i in range(3):
            work.place[i] += 2.0 * rate[i]
        cross_add(work.place, wc, bias)
        cross_add(delta, work.frame_ba[0], bias)
        cross_add(wd, wc, spin)
        jl, ja = work.frame_jl, work.frame_ja
        for e in range(3):
            r0, r1, r2 = rc[0, e], rc[1, e], rc[2, e]
            work.residual[row] = r0 * delta[0] + r1 * delta[1] + r2 * delta[2]
            work.residual_rate[row] = r0 * rate[0] + r1 * rate[1] + r2 * rate[2]
            work.gamma[row] = r0 * bias[0] + r1 * bias[1] + r2 * bias[2]
            for u in range(n_u):
                a0, a1, a2 = ja[0, 0, u], ja[0, 1, u], ja[0, 2, u]
                work.jacobian[row, u] = (
                    r0 * (jl[1, 0, u] - jl[0, 0, u] - a1 * delta[2] + a2 * delta[1])
                    + r1 * (jl[1, 1, u] - jl[0, 1, u] - a2 * delta[0] + a0 * delta[2])
                    + r2 * (jl[1, 2, u] - jl[0, 2, u] - a0 * delta[1] + a1 * delta[0])
                )
            row += 1
        kind = tree.constraint_kind[c]
        n_turn = 3 if kind == WELD else (2 if kind == HINGE else 0)
        if n_turn == 0:
            continue
        # rotation of the second frame against the first: small angle, or tilt of the hinge axes against each other
        for i in range(3):
            work.place[i] = 0.0
            if kind == WELD:
                j, k = (i + 1) % 3, (i + 2) % 3
                for m in range(3):
                    work.place[i] += 0.5 * (rc[m, k] * rd[m, j] - rc[m, j] * rd[m, k])
            else:
                for m in range(3):
                    for n in range(3):
                        work.place_rate[i] += rc[m, i] * rd[m, n] * tree.constraint_axis[c, n]
        if kind == HINGE:
            cross_add(tree.constraint_axis[c], work.place_rate, work.place)
        for t in range(n_turn):
            e = tree.constraint_turn[c, t]
            work.residual[row] = e[0] * work.place[0] + e[1] * work.place[1] + e[2] * work.place[2]
            d0 = rc[0, 0] * e[0] + rc[0, 1] * e[1] + rc[0, 2] * e[2]
            d1 = rc[1, 0] * e[0] + rc[1, 1] * e[1] + rc[1, 2] * e[2]
            d2 = rc[2, 0] * e[0] + rc[2, 1] * e[1] + rc[2, 2] * e[2]
            work.residual_rate[row] = d0 * (wd[0] - wc[0]) + d1 * (wd[1] - wc[1]) + d2 * (wd[2] - wc[2])
            work.gamma[row] = d0 * spin[0] + d1 * spin[1] + d2 * spin[2]
            for u in range(n_u):
                work.jacobian[row, u] = (
                    d0 * (ja[1, 0, u] - ja[0, 0, u])
                    + d1 * (ja[1, 1, u] - ja[0, 1, u])
                    + d2 * (ja[1, 2, u] - ja[0, 2, u])
                )
            row += 1


@kernel
def solve_constrained(tree, work):
    """Accelerations (in work.force) and multipliers of [M −Bᵀ; B 0] [u̇ λ] = [f, r], r = −γ − 2 α φ̇ − α² φ.

    Range-space method on the augmented matrix M + Bᵀ W B = L Lᵀ with the right-hand side f + Bᵀ W r, which has the same
    solution and multipliers but needs M positive definite only for motions that the constraints allow (the mass matrix
    of a free body in clamped modes is almost singular): X = L⁻¹ Bᵀ, (XᵀX) λ = r − Xᵀ L⁻¹ f.
    Returns OK, SINGULAR_MASS or SINGULAR_CONSTRAINTS (rows that depend on each other).
    """
    n_c, n_u, alpha = work.jacobian.shape[0], tree.n_u, tree.stabilization
    x, s, lam, force, mass = work.half_jacobian, work.schur, work.multipliers, work.force, work.mass
    for i in range(n_c):
        compliance = 1e-300
        for u in range(n_u):
            compliance += work.jacobian[i, u] ** 2 / mass[u, u]
        work.weight[i] = 1.0 / compliance
        lam[i] = -work.gamma[i] - 2.0 * alpha * work.residual_rate[i] - alpha * alpha * work.residual[i]
    for i in range(n_c):
        for u in range(n_u):
            pull = work.weight[i] * work.jacobian[i, u]
            force[u] += pull * lam[i]
            for v in range(u + 1):
                mass[u, v] += pull * work.jacobian[i, v]
    if not cholesky(mass):
        return SINGULAR_MASS
    solve_lower(mass, force)
    for i in range(n_c):
        for u in range(n_u):
            x[i, u] = work.jacobian[i, u]
        solve_lower(mass, x[i])
        for u in range(n_u):
            lam[i] -= x[i, u] * force[u]
        for j in range(i + 1):
            value = 0.0
            for u in range(n_u):
                value += x[i, u] * x[j, u]
            s[i, j] = value
    if not cholesky(s):
        return SINGULAR_CONSTRAINTS
    solve_lower(s, lam)
    solve_upper(s, lam)
    for i in range(n_c):
        for u in range(n_u):
            force[u] += x[i, u] * lam[i]
    solve_upper(mass, force)
    return OK
