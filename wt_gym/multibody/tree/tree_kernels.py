"""Compiled equations of motion of a tree of flexible bodies in embedded minimal form.

Notation of one body (all vectors in body-frame components, frame origin at its joint):
``a = Vl u̇ + gl`` and ``ω̇ = Va u̇ + ga`` are the true acceleration of the frame origin and the angular acceleration;
the columns of ``Vl``/``Va`` that can be non-zero are listed in ``cols[b, :n_col[b]]`` and stored in that order.

Newton–Euler–Lagrange equations of the body, from the kinetic energy second order in the elastic coordinates q
(Boltzmann–Hamel form; Shabana, Dynamics of Multibody Systems, ch. 5), with the integrals of ``BodyInertia``:

    m a + ω̇ × mc + C q̈ + 2 ω × C q̇ + c2(q̇, q̇) + ω × (ω × mc)          = F
    mc × a + J ω̇ + D q̈ + J̇ ω + d1(q̇, q̇) + ω × (J ω + D q̇)            = M
    Cᵀ a + Dᵀ ω̇ + M q̈ + ω·(d1_kj − d1_jk) q̇_j − ½ ω·∂J/∂q_k ω
        + (m1_klj − ½ m1_ljk) q̇_l q̇_j + K q + D q̇                           = Q

Gravity enters as a − g. The velocity transformation Vᵀ(·) of all bodies gives the equations M u̇ = f in the joint and
elastic velocities u, with the inertia of rotors geared to joints on the diagonal of M; constraint forces do not appear.
Equations that tie bodies as well are in :mod:`wt_gym.multibody.constraints.constraint_kernels`, the solution for u̇ in
:mod:`wt_gym.multibody.tree.rate_kernels`.
"""

import math

from wt_gym.base.compiled import kernel
from wt_gym.multibody.tree.rotation_kernels import (
    cardan_rotation,
    cross_add,
    quaternion_rotation,
    rotation_exp,
    tangent_bias,
)

FIXED, REVOLUTE, PRISMATIC, SPHERICAL, FREE, SERVO, CARDAN = range(7)
OK, SINGULAR_MASS, SINGULAR_CONSTRAINTS, DIVERGED, NOT_CONVERGED = range(5)


@kernel(inline="always")
def attachment(b, p, y, yd, tree, work):
    """Position, rotation and rates of marker b on body p, in components of p.

    Fills work.place (position), work.turn_rot (rotation) with its tangent, work.marker_shape (S + H q) and, relative to
    the parent frame, work.place_rate (velocity), work.place_bias (acceleration bias), work.joint_omega (angular
    velocity) and work.marker_bias (angular bias).
    """
    nf = tree.n_elastic[p]
    q0, u0 = tree.elastic_q[p], tree.elastic_u[p]
    for i in range(3):
        x, xd, xb, th, thd = tree.marker_position[b, i], 0.0, 0.0, 0.0, 0.0
        for k in range(nf):
            lin, rate, bias = tree.marker_linear[b, i, k], 0.0, 0.0
            half = lin
            for j in range(nf):
                h = tree.marker_second[b, i, k, j]
                lin += h * y[q0 + j]
                half += 0.5 * h * y[q0 + j]
                bias += h * yd[u0 + j]
            work.marker_shape[i, k] = lin
            x += half * y[q0 + k]
            rate = yd[u0 + k]
            xd += lin * rate
            xb += bias * rate
            th += tree.marker_rotation[b, i, k] * y[q0 + k]
            thd += tree.marker_rotation[b, i, k] * rate
        work.place[i], work.place_rate[i], work.place_bias[i], work.turn[i], work.turn_rate[i] = x, xd, xb, th, thd
    rotation_exp(work.turn, work.turn_rot, work.tangent)
    t, td = work.turn, work.turn_rate
    for i in range(3):
        work.joint_omega[i] = work.tangent[i, 0] * td[0] + work.tangent[i, 1] * td[1] + work.tangent[i, 2] * td[2]
    tangent_bias(t, td, work.marker_bias)


@kernel(separate=True, distinct=True)
def kinematics(y, tree, work):
    """Frames, velocities, velocity transformation and acceleration bias of all bodies for the state y."""
    n_q = tree.n_q
    yd = y[n_q : n_q + tree.n_u]
    for b in range(tree.parent.shape[0]):
        p = tree.parent[b]
        n_in = joint_frame(b, p, y, yd, tree, work)
        for i in range(3):
            work.r[b, i] = work.place[i]
            if p >= 0:
                work.r[b, i] = work.r[p, i]
                for j in range(3):
                    work.r[b, i] += work.rot[p, i, j] * work.place[j]
        joint_motion(b, p, tree.kind[b], n_in, y, yd, tree, work)


@kernel(inline="always")
def joint_frame(k, p, y, yd, tree, work):
    """Motion of the frame that marker k carries on body p (the ground for p = −1), in components of p.

    Fills work.place (position in p), work.joint_rot (orientation in p), work.joint_omega and work.joint_v (absolute
    angular and linear velocity), work.joint_bias_ang and work.joint_bias_lin (acceleration bias) and the columns
    work.joint_va and work.joint_vl, which belong to the velocities ``cols[p]`` followed by the elastic ones of p.
    Returns the number of columns.
    """
    lever, wn, nb_lin, nb_ang, nv = work.lever, work.joint_omega, work.joint_bias_lin, work.joint_bias_ang, work.joint_v
    if p < 0:
        for i in range(3):
            work.place[i] = tree.joint_offset[k, i]
            wn[i] = 0.0
            nb_lin[i] = 0.0
            nb_ang[i] = 0.0
            nv[i] = 0.0
            for j in range(3):
                work.joint_rot[i, j] = tree.joint_rotation[k, i, j]
        return 0
    attachment(k, p, y, yd, tree, work)
    for i in range(3):
        lever[i] = (
            work.turn_rot[i, 0] * tree.joint_offset[k, 0]
            + work.turn_rot[i, 1] * tree.joint_offset[k, 1]
            + work.turn_rot[i, 2] * tree.joint_offset[k, 2]
        )
        for j in range(3):
            work.joint_rot[i, j] = (
                work.turn_rot[i, 0] * tree.joint_rotation[k, 0, j]
                + work.turn_rot[i, 1] * tree.joint_rotation[k, 1, j]
                + work.turn_rot[i, 2] * tree.joint_rotation[k, 2, j]
            )
    # relative position, velocity and bias of the joint origin in the parent frame
    for i in range(3):
        work.place[i] += lever[i]
        work.one[i] = 0.0
        work.two[i] = 0.0
    cross_add(wn, lever, work.one)  # w × lever
    cross_add(wn, work.one, work.two)
    cross_add(work.marker_bias, lever, work.two)
    wp, vp = work.omega[p], work.v[p]
    for i in range(3):
        work.place_rate[i] += work.one[i]
        work.place_bias[i] += work.two[i]
        work.one[i] = 0.0
        work.two[i] = 0.0
        nb_lin[i] = work.bias_lin[p, i] + work.place_bias[i]
        nb_ang[i] = work.bias_ang[p, i] + work.marker_bias[i]
        nv[i] = vp[i] + work.place_rate[i]
    cross_add(wp, work.place, work.one)
    for i in range(3):
        nv[i] += work.one[i]
        work.two[i] = work.one[i] + 2.0 * work.place_rate[i]
    cross_add(wp, work.two, nb_lin)
    cross_add(work.bias_ang[p], work.place, nb_lin)
    cross_add(wp, wn, nb_ang)
    for i in range(3):
        wn[i] += wp[i]
    # columns: those of the parent, then the parent's elastic coordinates
    x = work.place
    n_in = tree.n_col[p]
    for c in range(n_in):
        va0, va1, va2 = work.va[p, 0, c], work.va[p, 1, c], work.va[p, 2, c]
        work.joint_va[0, c], work.joint_va[1, c], work.joint_va[2, c] = va0, va1, va2
        work.joint_vl[0, c] = work.vl[p, 0, c] + va1 * x[2] - va2 * x[1]
        work.joint_vl[1, c] = work.vl[p, 1, c] + va2 * x[0] - va0 * x[2]
        work.joint_vl[2, c] = work.vl[p, 2, c] + va0 * x[1] - va1 * x[0]
    for e in range(tree.n_elastic[p]):
        for i in range(3):
            work.joint_va[i, n_in] = (
                work.tangent[i, 0] * tree.marker_rotation[k, 0, e]
                + work.tangent[i, 1] * tree.marker_rotation[k, 1, e]
                + work.tangent[i, 2] * tree.marker_rotation[k, 2, e]
            )
        va0, va1, va2 = work.joint_va[0, n_in], work.joint_va[1, n_in], work.joint_va[2, n_in]
        work.joint_vl[0, n_in] = work.marker_shape[0, e] + va1 * lever[2] - va2 * lever[1]
        work.joint_vl[1, n_in] = work.marker_shape[1, e] + va2 * lever[0] - va0 * lever[2]
        work.joint_vl[2, n_in] = work.marker_shape[2, e] + va0 * lever[1] - va1 * lever[0]
        n_in += 1
    return n_in


@kernel(inline="always")
def joint_motion(b, p, kind, n_in, y, yd, tree, work):
    """Carry the joint-frame kinematics (parent components) through the joint of body b."""
    q0, u0 = tree.joint_q[b], tree.joint_u[b]
    axis = tree.axis[b]
    wn, nb_lin, nb_ang, nv = work.joint_omega, work.joint_bias_lin, work.joint_bias_ang, work.joint_v
    rate, accel = 0.0, 0.0
    if kind == PRISMATIC or kind == FREE or kind == CARDAN:
        slide_joint(b, p, kind, n_in, y, yd, tree, work)
        n_in += 1 if kind == PRISMATIC else 3
    if kind == REVOLUTE or kind == SERVO:
        if kind == REVOLUTE:
            angle, rate = y[q0], yd[u0]
        else:
            n_y = tree.n_q + tree.n_u
            s = tree.servo[b]
            angle, rate, accel = y[n_y + s], y[n_y + tree.n_servo + s], work.servo_acceleration[s]
        for i in range(3):
            work.turn[i] = axis[i] * angle
        rotation_exp(work.turn, work.turn_rot, work.tangent)
    elif kind == SPHERICAL:
        quaternion_rotation(y[q0 : q0 + 4], work.turn_rot)
    elif kind == FREE:
        quaternion_rotation(y[q0 + 3 : q0 + 7], work.turn_rot)
    elif kind == CARDAN:
        cardan_rotation(y[q0 + 3 : q0 + 6], work.turn_rot)
    if kind == FIXED or kind == PRISMATIC:
        for i in range(3):
            for j in range(3):
                work.child_rot[i, j] = work.joint_rot[i, j]
    else:
        for i in range(3):
            for j in range(3):
                work.child_rot[i, j] = (
                    work.joint_rot[i, 0] * work.turn_rot[0, j]
                    + work.joint_rot[i, 1] * work.turn_rot[1, j]
                    + work.joint_rot[i, 2] * work.turn_rot[2, j]
                )
    rb = work.child_rot
    # into body components
    for i in range(3):
        work.omega[b, i] = rb[0, i] * wn[0] + rb[1, i] * wn[1] + rb[2, i] * wn[2]
        work.v[b, i] = rb[0, i] * nv[0] + rb[1, i] * nv[1] + rb[2, i] * nv[2]
        work.bias_lin[b, i] = rb[0, i] * nb_lin[0] + rb[1, i] * nb_lin[1] + rb[2, i] * nb_lin[2]
        work.bias_ang[b, i] = rb[0, i] * nb_ang[0] + rb[1, i] * nb_ang[1] + rb[2, i] * nb_ang[2]
        for c in range(n_in):
            work.vl[b, i, c] = (
                rb[0, i] * work.joint_vl[0, c] + rb[1, i] * work.joint_vl[1, c] + rb[2, i] * work.joint_vl[2, c]
            )
            work.va[b, i, c] = (
                rb[0, i] * work.joint_va[0, c] + rb[1, i] * work.joint_va[1, c] + rb[2, i] * work.joint_va[2, c]
            )
        for j in range(3):
            if p >= 0:
                work.rot[b, i, j] = (
                    work.rot[p, i, 0] * rb[0, j] + work.rot[p, i, 1] * rb[1, j] + work.rot[p, i, 2] * rb[2, j]
                )
            else:
                work.rot[b, i, j] = rb[i, j]
    # relative rotation of the joint: the axis is the same in both frames
    if kind == REVOLUTE or kind == SERVO:
        for i in range(3):
            work.turn[i] = axis[i] * rate
        cross_add(work.omega[b], work.turn, work.bias_ang[b])
        for i in range(3):
            work.omega[b, i] += work.turn[i]
            if kind == SERVO:
                work.bias_ang[b, i] += axis[i] * accel
            else:
                work.va[b, i, n_in] = axis[i]
                work.vl[b, i, n_in] = 0.0
    elif kind == SPHERICAL or kind == FREE:
        first = u0 if kind == SPHERICAL else u0 + 3
        for i in range(3):
            work.turn[i] = yd[first + i]
        cross_add(work.omega[b], work.turn, work.bias_ang[b])
        for i in range(3):
            work.omega[b, i] += work.turn[i]
            for j in range(3):
                work.va[b, j, n_in + i] = 1.0 if i == j else 0.0
                work.vl[b, j, n_in + i] = 0.0
    elif kind == CARDAN:
        cardan_motion(b, n_in, y[q0 + 3 : q0 + 6], yd[u0 + 3 : u0 + 6], work)


@kernel
def cardan_motion(b, n_in, angles, rates, work):
    """Add a rotation by roll φ, pitch θ and yaw ψ, R = R_z(ψ) R_y(θ) R_x(φ), to the motion of body b.

    In body axes ω = T (φ̇, θ̇, ψ̇) with the columns (1, 0, 0), (0, cos φ, −sin φ) and (−sin θ, sin φ cos θ,
    cos φ cos θ) of T (Diebel, Representing Attitude, Stanford 2006, section 5); the bias of ω̇ is Ṫ (φ̇, θ̇, ψ̇).
    """
    cr, sr, cp, sp = math.cos(angles[0]), math.sin(angles[0]), math.cos(angles[1]), math.sin(angles[1])
    roll, pitch, yaw = rates[0], rates[1], rates[2]
    turn, columns = work.turn, work.va[b]
    turn[0], turn[1], turn[2] = roll - sp * yaw, cr * pitch + sr * cp * yaw, cr * cp * yaw - sr * pitch
    cross_add(work.omega[b], turn, work.bias_ang[b])
    work.bias_ang[b, 0] -= cp * pitch * yaw
    work.bias_ang[b, 1] += cr * cp * roll * yaw - sr * roll * pitch - sr * sp * pitch * yaw
    work.bias_ang[b, 2] -= sr * cp * roll * yaw + cr * roll * pitch + cr * sp * pitch * yaw
    columns[0, n_in], columns[0, n_in + 1], columns[0, n_in + 2] = 1.0, 0.0, -sp
    columns[1, n_in], columns[1, n_in + 1], columns[1, n_in + 2] = 0.0, cr, sr * cp
    columns[2, n_in], columns[2, n_in + 1], columns[2, n_in + 2] = 0.0, -sr, cr * cp
    for i in range(3):
        work.omega[b, i] += turn[i]
        for k in range(3):
            work.vl[b, i, n_in + k] = 0.0


@kernel(inline="always")
def slide_joint(b, p, kind, n_in, y, yd, tree, work):
    """Translation of a prismatic, free or Cardan joint, along axes fixed in the joint frame (parent components).

    wn, nb_*, nv are those of the joint frame; its orientation does not change by sliding, so a translation d adds
    ω × d etc. and the columns d/du.
    """
    q0, u0 = tree.joint_q[b], tree.joint_u[b]
    d, dd = work.one, work.two
    n_slide = 1 if kind == PRISMATIC else 3
    for i in range(3):
        d[i] = 0.0
        dd[i] = 0.0
        for k in range(n_slide):
            if kind == PRISMATIC:
                direction = (
                    work.joint_rot[i, 0] * tree.axis[b, 0]
                    + work.joint_rot[i, 1] * tree.axis[b, 1]
                    + work.joint_rot[i, 2] * tree.axis[b, 2]
                )
            else:
                direction = work.joint_rot[i, k]
            d[i] += direction * y[q0 + k]
            dd[i] += direction * yd[u0 + k]
            work.joint_vl[i, n_in + k] = direction
            work.joint_va[i, n_in + k] = 0.0
    for c in range(n_in):
        a0, a1, a2 = work.joint_va[0, c], work.joint_va[1, c], work.joint_va[2, c]
        work.joint_vl[0, c] += a1 * d[2] - a2 * d[1]
        work.joint_vl[1, c] += a2 * d[0] - a0 * d[2]
        work.joint_vl[2, c] += a0 * d[1] - a1 * d[0]
    for i in range(3):
        work.turn[i] = 0.0
    cross_add(work.joint_omega, d, work.turn)
    for i in range(3):
        work.joint_v[i] += dd[i] + work.turn[i]
        work.turn_rate[i] = work.turn[i] + 2.0 * dd[i]
        if p >= 0:
            work.r[b, i] += work.rot[p, i, 0] * d[0] + work.rot[p, i, 1] * d[1] + work.rot[p, i, 2] * d[2]
        else:
            work.r[b, i] += d[i]
    cross_add(work.joint_omega, work.turn_rate, work.joint_bias_lin)
    cross_add(work.joint_bias_ang, d, work.joint_bias_lin)


@kernel(inline="always")
def elastic_mass(b, y, tree, work):
    """Elastic mass matrix of body b, work.elastic_mass, and what else is of its order.

    work.coupling_slope[k, j, i] = ∂D_ki/∂q_j, and for bodies with complete integrals work.reach[k, l, j] =
    ∫ (H q)_k · H_lj dm.
    """
    nf, n_full, q0 = tree.n_elastic[b], tree.n_complete[b], tree.elastic_q[b]
    mff, dq, reach = work.elastic_mass[b], work.coupling_slope, work.reach
    for k in range(nf):
        for j in range(nf):
            for i in range(3):
                dq[k, j, i] = tree.d1[b, k, j, i]
        for j in range(k + 1):
            value = tree.m0[b, k, j]
            for l in range(nf):
                value += tree.m1[b, k, j, l] * y[q0 + l]
            mff[k, j] = value
            mff[j, k] = value
    for k in range(n_full):
        for j in range(n_full):
            for i in range(3):
                slope = 0.0
                for l in range(n_full):
                    slope += tree.d2[b, k, j, l, i] * y[q0 + l]
                dq[k, j, i] += 2.0 * slope
        for j in range(n_full):
            for l in range(n_full):
                reach[k, j, l] = 0.0
        for m in range(n_full):
            qm = y[q0 + m]
            for j in range(n_full):
                for l in range(n_full):
                    reach[k, j, l] += tree.m2[b, k, m, j, l] * qm
        for j in range(k + 1):
            value = 0.0
            for l in range(n_full):
                value += reach[k, j, l] * y[q0 + l]
            mff[k, j] += value
            if j < k:
                mff[j, k] += value


@kernel(separate=True, distinct=True)
def inertia_terms(y, yd, tree, work):
    """State-dependent inertia of all bodies and their velocity-dependent forces, see `body_terms`."""
    for b in range(tree.parent.shape[0]):
        body_terms(b, y, yd, tree, work)


@kernel(inline="always")
def body_terms(b, y, yd, tree, work):
    """State-dependent inertia of body b: mc, J, C, D, M and the velocity-dependent forces h (elastic ones too)."""
    nf = tree.n_elastic[b]
    q0, u0 = tree.elastic_q[b], tree.elastic_u[b]
    elastic_mass(b, y, tree, work)
    w = work.omega[b]
    mc, jj, h = work.first_moment[b], work.inertia[b], work.bias_force[b]
    for i in range(3):
        mc[i] = tree.c0[b, i]
        h[i] = 0.0
        h[3 + i] = 0.0
        work.elastic_lin[i] = 0.0
        work.elastic_ang[i] = 0.0
        for j in range(3):
            jj[i, j] = tree.j0[b, i, j]
            work.inertia_rate[i, j] = 0.0
    for k in range(nf):
        qk, rk = y[q0 + k], yd[u0 + k]
        for i in range(3):
            c, bias, d = tree.c1[b, i, k], 0.0, tree.d0[b, k, i]
            half, dbias = c, 0.0
            for j in range(nf):
                c2 = tree.c2[b, i, k, j]
                qj, rj = y[q0 + j], yd[u0 + j]
                c += c2 * qj
                half += 0.5 * c2 * qj
                bias += c2 * rj
                d += 0.5 * (tree.d1[b, k, j, i] + work.coupling_slope[k, j, i]) * qj
                dbias += work.coupling_slope[k, j, i] * rj
            work.coupling_lin[b, i, k] = c
            work.coupling_ang[b, i, k] = d
            mc[i] += half * qk
            work.elastic_lin[i] += c * rk
            work.elastic_ang[i] += d * rk
            h[i] += bias * rk
            h[3 + i] += dbias * rk
        centrifugal = 0.0
        for i in range(3):
            for m in range(3):
                g, half = tree.j1[b, k, i, m], tree.j1[b, k, i, m]
                for j in range(nf):
                    j2 = tree.j2[b, k, j, i, m] * y[q0 + j]
                    g += j2
                    half += 0.5 * j2
                jj[i, m] += half * qk
                work.inertia_rate[i, m] += g * rk
                centrifugal += w[i] * g * w[m]
        gyro = 0.0
        for j in range(nf):
            convective = 0.0
            for l in range(nf):
                convective += (tree.m1[b, k, l, j] - 0.5 * tree.m1[b, l, j, k]) * yd[u0 + l]
            gyro += yd[u0 + j] * (
                convective
                + w[0] * (work.coupling_slope[k, j, 0] - work.coupling_slope[j, k, 0])
                + w[1] * (work.coupling_slope[k, j, 1] - work.coupling_slope[j, k, 1])
                + w[2] * (work.coupling_slope[k, j, 2] - work.coupling_slope[j, k, 2])
            )
            if k < tree.n_complete[b]:
                for l in range(nf):
                    gyro += work.reach[k, j, l] * yd[u0 + j] * yd[u0 + l]
        h[6 + k] = gyro - 0.5 * centrifugal
    # rotational velocity terms
    for i in range(3):
        work.one[i] = 2.0 * work.elastic_lin[i]
        work.two[i] = work.elastic_ang[i]
        for j in range(3):
            work.two[i] += jj[i, j] * w[j]
            h[3 + i] += work.inertia_rate[i, j] * w[j]
    cross_add(w, mc, work.one)
    cross_add(w, work.one, h[:3])
    cross_add(w, work.two, h[3:6])


@kernel(inline="always")
def assemble(y, loads, tree, work):
    """Mass matrix and right-hand side of M u̇ = f from all bodies; kinematics must be up to date."""
    n_q, n_u = tree.n_q, tree.n_u
    yd = y[n_q : n_q + n_u]
    mass, force = work.mass, work.force
    mass[:, :] = 0.0
    force[:] = 0.0
    for i in range(n_u):
        mass[i, i] = tree.dof_inertia[i]
    inertia_terms(y, yd, tree, work)
    for b in range(tree.parent.shape[0]):
        m, nf, nc = tree.mass[b], tree.n_elastic[b], tree.n_col[b]
        mc, jj, h, cols = work.first_moment[b], work.inertia[b], work.bias_force[b], tree.cols[b]
        rot = work.rot[b]
        a, al, f, t = work.acceleration, work.angular_acceleration, work.one, work.two
        for i in range(3):
            a[i] = (
                work.bias_lin[b, i]
                - rot[0, i] * tree.gravity[0]
                - rot[1, i] * tree.gravity[1]
                - rot[2, i] * tree.gravity[2]
            )
            al[i] = work.bias_ang[b, i]
        for i in range(3):
            f[i] = loads[b, i] - h[i] - m * a[i]
            t[i] = loads[b, 3 + i] - h[3 + i] - (jj[i, 0] * al[0] + jj[i, 1] * al[1] + jj[i, 2] * al[2])
        # − ω̇ × mc and − mc × a
        cross_add(mc, al, f)
        cross_add(a, mc, t)
        vl, va = work.vl[b], work.va[b]
        for c in range(nc):
            l0, l1, l2 = vl[0, c], vl[1, c], vl[2, c]
            a0, a1, a2 = va[0, c], va[1, c], va[2, c]
            force[cols[c]] += l0 * f[0] + l1 * f[1] + l2 * f[2] + a0 * t[0] + a1 * t[1] + a2 * t[2]
            # momentum of column c: p = m l + a × mc, π = mc × l + J a
            p0 = m * l0 + a1 * mc[2] - a2 * mc[1]
            p1 = m * l1 + a2 * mc[0] - a0 * mc[2]
            p2 = m * l2 + a0 * mc[1] - a1 * mc[0]
            s0 = mc[1] * l2 - mc[2] * l1 + jj[0, 0] * a0 + jj[0, 1] * a1 + jj[0, 2] * a2
            s1 = mc[2] * l0 - mc[0] * l2 + jj[1, 0] * a0 + jj[1, 1] * a1 + jj[1, 2] * a2
            s2 = mc[0] * l1 - mc[1] * l0 + jj[2, 0] * a0 + jj[2, 1] * a1 + jj[2, 2] * a2
            for d in range(c + 1):
                value = vl[0, d] * p0 + vl[1, d] * p1 + vl[2, d] * p2 + va[0, d] * s0 + va[1, d] * s1 + va[2, d] * s2
                i, j = cols[c], cols[d]
                if i >= j:
                    mass[i, j] += value
                else:
                    mass[j, i] += value
        u0, q0 = tree.elastic_u[b], tree.elastic_q[b]
        for k in range(nf):
            c0, c1, c2 = work.coupling_lin[b, 0, k], work.coupling_lin[b, 1, k], work.coupling_lin[b, 2, k]
            d0, d1, d2 = work.coupling_ang[b, 0, k], work.coupling_ang[b, 1, k], work.coupling_ang[b, 2, k]
            q = loads[b, 6 + k] - h[6 + k]
            q -= c0 * a[0] + c1 * a[1] + c2 * a[2] + d0 * al[0] + d1 * al[1] + d2 * al[2]
            for j in range(nf):
                q -= tree.stiffness[b, k, j] * y[q0 + j] + tree.damping[b, k, j] * yd[u0 + j]
            force[u0 + k] += q
            for c in range(nc):
                value = c0 * vl[0, c] + c1 * vl[1, c] + c2 * vl[2, c] + d0 * va[0, c] + d1 * va[1, c] + d2 * va[2, c]
                i, j = u0 + k, cols[c]
                if i >= j:
                    mass[i, j] += value
                else:
                    mass[j, i] += value
            for j in range(k + 1):
                mass[u0 + k, u0 + j] += work.elastic_mass[b, k, j]
    if tree.added_body >= 0:
        water_inertia(tree.added_body, tree, work)


@kernel(separate=True)
def water_inertia(b, tree, work):
    """Inertia of the water that moves with body b, into the mass matrix and the right-hand side of `assemble`.

    The added mass A (6, 6) is constant along global axes at the origin of the body, as in the linear theory of floating
    bodies (Cummins 1962; Jonkman, NREL/TP-500-41958, eq. 2-13): with ν = (v, ω) = J u it has the kinetic energy
    ½ νᵀ A ν and the force −A ν̇ and no weight. The body is on a Cardan joint to the ground: the first three of its
    velocities are v, and ω = W u with W = R Va.
    """
    turn, bias, added, u, n = work.turn_rot, work.turn, tree.added_mass, tree.joint_u[b], 3
    rot, va = work.rot[b], work.va[b]
    for i in range(n):
        bias[i] = 0.0
        for k in range(n):
            bias[i] += rot[i, k] * work.bias_ang[b, k]
            turn[i, k] = rot[i, 0] * va[0, n + k] + rot[i, 1] * va[1, n + k] + rot[i, 2] * va[2, n + k]
    for i in range(n):
        for k in range(n):
            work.force[u + i] -= added[i, n + k] * bias[k]
            if k <= i:
                work.mass[u + i, u + k] += added[i, k]
            for m in range(n):
                work.mass[u + n + k, u + i] += turn[m, k] * added[n + m, i]
                work.force[u + n + i] -= turn[m, i] * added[n + m, n + k] * bias[k]
                for l in range(k + 1):
                    work.mass[u + n + k, u + n + l] += turn[m, k] * added[n + m, n + i] * turn[i, l]
