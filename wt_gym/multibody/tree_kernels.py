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

Gravity enters as a − g. The velocity transformation Vᵀ(·) of all bodies gives the equations in the joint and elastic
velocities u; constraint forces do not appear. Bodies may be tied by constraint equations as well (closed loops, or a
blade held to its hub as in Gebhardt et al. 2012, eqs. 6–11); these keep their Lagrange multipliers:

    [M  −Bᵀ] [u̇]   [f                     ]
    [B   0 ] [λ ] = [−γ − 2 α φ̇ − α² φ    ]      (Baumgarte 1972, critically damped)
"""

import math

from wt_gym.compiled import kernel

FIXED, REVOLUTE, PRISMATIC, SPHERICAL, FREE, SERVO = range(6)
WELD, HINGE, BALL = range(3)
OK, SINGULAR_MASS, SINGULAR_CONSTRAINTS, DIVERGED = range(4)


@kernel
def rotation_exp(t, rot, tangent):
    """Rotation exp(t̃) and the tangent T with ω = T ṫ (both in the frame before the rotation)."""
    a2 = t[0] * t[0] + t[1] * t[1] + t[2] * t[2]
    if a2 > 1e-8:
        a = math.sqrt(a2)
        s, c = math.sin(a) / a, (1.0 - math.cos(a)) / a2
        d = (1.0 - s) / a2
    else:
        s, c, d = 1.0 - a2 / 6.0, 0.5 - a2 / 24.0, 1.0 / 6.0 - a2 / 120.0
    for i in range(3):
        for j in range(3):
            outer = t[i] * t[j]
            rot[i, j] = c * outer
            tangent[i, j] = d * outer
        rot[i, i] += 1.0 - c * a2
        tangent[i, i] += 1.0 - d * a2
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        rot[i, j] -= s * t[k]
        rot[j, i] += s * t[k]
        tangent[i, j] -= c * t[k]
        tangent[j, i] += c * t[k]


@kernel
def tangent_bias(t, td, out):
    """Angular acceleration Ṫ ṫ of a rotation vector t that moves with constant rate ṫ.

    With T = 1 + c t̃ + d t̃²: Ṫ ṫ = ċ t × ṫ + ḋ t × (t × ṫ) + d ṫ × (t × ṫ).
    """
    a2 = t[0] * t[0] + t[1] * t[1] + t[2] * t[2]
    if a2 > 1e-2:
        a = math.sqrt(a2)
        d = (a - math.sin(a)) / (a2 * a)
        c_slope = (0.5 * a * math.sin(a) - 1.0 + math.cos(a)) / (a2 * a2)
        d_slope = 0.5 * ((1.0 - math.cos(a)) / a2 - 3.0 * d) / a2
    else:
        d = 1.0 / 6.0 - a2 / 120.0 + a2 * a2 / 5040.0
        c_slope = -1.0 / 24.0 + a2 / 360.0 - a2 * a2 / 13440.0
        d_slope = -1.0 / 120.0 + a2 / 2520.0 - a2 * a2 / 120960.0
    twice = 2.0 * (t[0] * td[0] + t[1] * td[1] + t[2] * td[2])
    c0 = t[1] * td[2] - t[2] * td[1]
    c1 = t[2] * td[0] - t[0] * td[2]
    c2 = t[0] * td[1] - t[1] * td[0]
    e0 = twice * d_slope * t[0] + d * td[0]
    e1 = twice * d_slope * t[1] + d * td[1]
    e2 = twice * d_slope * t[2] + d * td[2]
    out[0] = twice * c_slope * c0 + e1 * c2 - e2 * c1
    out[1] = twice * c_slope * c1 + e2 * c0 - e0 * c2
    out[2] = twice * c_slope * c2 + e0 * c1 - e1 * c0


@kernel
def quaternion_rotation(q, rot):
    """Rotation matrix of a scalar-first quaternion; divides by |q|² so that drift of the norm does no harm."""
    w, x, y, z = q[0], q[1], q[2], q[3]
    n = 2.0 / (w * w + x * x + y * y + z * z)
    rot[0, 0] = 1.0 - n * (y * y + z * z)
    rot[0, 1] = n * (x * y - w * z)
    rot[0, 2] = n * (x * z + w * y)
    rot[1, 0] = n * (x * y + w * z)
    rot[1, 1] = 1.0 - n * (x * x + z * z)
    rot[1, 2] = n * (y * z - w * x)
    rot[2, 0] = n * (x * z - w * y)
    rot[2, 1] = n * (y * z + w * x)
    rot[2, 2] = 1.0 - n * (x * x + y * y)


@kernel
def cross_add(a, b, out):
    """Out += a × b."""
    out[0] += a[1] * b[2] - a[2] * b[1]
    out[1] += a[2] * b[0] - a[0] * b[2]
    out[2] += a[0] * b[1] - a[1] * b[0]


@kernel(inline="always")
def attachment(b, p, y, yd, tree, work):
    """Position, rotation and rates of marker b on body p, in components of p.

    Fills work.x (position), work.rn (rotation), work.ti (tangent), work.s_eff (S + H q) and, relative to the parent
    frame, work.xd (velocity), work.xb (acceleration bias), work.wn (angular velocity), work.wb (angular bias).
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
            work.s_eff[i, k] = lin
            x += half * y[q0 + k]
            rate = yd[u0 + k]
            xd += lin * rate
            xb += bias * rate
            th += tree.marker_rotation[b, i, k] * y[q0 + k]
            thd += tree.marker_rotation[b, i, k] * rate
        work.x[i], work.xd[i], work.xb[i], work.th[i], work.thd[i] = x, xd, xb, th, thd
    rotation_exp(work.th, work.rn, work.ti)
    t, td = work.th, work.thd
    for i in range(3):
        work.wn[i] = work.ti[i, 0] * td[0] + work.ti[i, 1] * td[1] + work.ti[i, 2] * td[2]
    tangent_bias(t, td, work.wb)


@kernel
def kinematics(y, tree, work):
    """Frames, velocities, velocity transformation and acceleration bias of all bodies for the state y."""
    n_q = tree.n_q
    yd = y[n_q : n_q + tree.n_u]
    for b in range(tree.parent.shape[0]):
        p = tree.parent[b]
        n_in = joint_frame(b, p, y, yd, tree, work)
        for i in range(3):
            work.r[b, i] = work.x[i]
            if p >= 0:
                work.r[b, i] = work.r[p, i]
                for j in range(3):
                    work.r[b, i] += work.rot[p, i, j] * work.x[j]
        joint_motion(b, p, tree.kind[b], n_in, y, yd, tree, work)


@kernel(inline="always")
def joint_frame(k, p, y, yd, tree, work):
    """Motion of the frame that marker k carries on body p (the ground for p = −1), in components of p.

    Fills work.x (position in p), work.rj (orientation in p), work.wn and work.nv (absolute angular and linear
    velocity), work.nb_ang and work.nb_lin (acceleration bias) and the columns work.na and work.nl, which belong to the
    velocities ``cols[p]`` followed by the elastic ones of p. Returns the number of columns.
    """
    lever, wn, nb_lin, nb_ang, nv = work.lever, work.wn, work.nb_lin, work.nb_ang, work.nv
    if p < 0:
        for i in range(3):
            work.x[i] = tree.joint_offset[k, i]
            wn[i] = 0.0
            nb_lin[i] = 0.0
            nb_ang[i] = 0.0
            nv[i] = 0.0
            for j in range(3):
                work.rj[i, j] = tree.joint_rotation[k, i, j]
        return 0
    attachment(k, p, y, yd, tree, work)
    for i in range(3):
        lever[i] = (
            work.rn[i, 0] * tree.joint_offset[k, 0]
            + work.rn[i, 1] * tree.joint_offset[k, 1]
            + work.rn[i, 2] * tree.joint_offset[k, 2]
        )
        for j in range(3):
            work.rj[i, j] = (
                work.rn[i, 0] * tree.joint_rotation[k, 0, j]
                + work.rn[i, 1] * tree.joint_rotation[k, 1, j]
                + work.rn[i, 2] * tree.joint_rotation[k, 2, j]
            )
    # relative position, velocity and bias of the joint origin in the parent frame
    for i in range(3):
        work.x[i] += lever[i]
        work.c1[i] = 0.0
        work.c2[i] = 0.0
    cross_add(wn, lever, work.c1)  # w × lever
    cross_add(wn, work.c1, work.c2)
    cross_add(work.wb, lever, work.c2)
    wp, vp = work.omega[p], work.v[p]
    for i in range(3):
        work.xd[i] += work.c1[i]
        work.xb[i] += work.c2[i]
        work.c1[i] = 0.0
        work.c2[i] = 0.0
        nb_lin[i] = work.bias_lin[p, i] + work.xb[i]
        nb_ang[i] = work.bias_ang[p, i] + work.wb[i]
        nv[i] = vp[i] + work.xd[i]
    cross_add(wp, work.x, work.c1)
    for i in range(3):
        nv[i] += work.c1[i]
        work.c2[i] = work.c1[i] + 2.0 * work.xd[i]
    cross_add(wp, work.c2, nb_lin)
    cross_add(work.bias_ang[p], work.x, nb_lin)
    cross_add(wp, wn, nb_ang)
    for i in range(3):
        wn[i] += wp[i]
    # columns: those of the parent, then the parent's elastic coordinates
    x = work.x
    n_in = tree.n_col[p]
    for c in range(n_in):
        va0, va1, va2 = work.va[p, 0, c], work.va[p, 1, c], work.va[p, 2, c]
        work.na[0, c], work.na[1, c], work.na[2, c] = va0, va1, va2
        work.nl[0, c] = work.vl[p, 0, c] + va1 * x[2] - va2 * x[1]
        work.nl[1, c] = work.vl[p, 1, c] + va2 * x[0] - va0 * x[2]
        work.nl[2, c] = work.vl[p, 2, c] + va0 * x[1] - va1 * x[0]
    for e in range(tree.n_elastic[p]):
        for i in range(3):
            work.na[i, n_in] = (
                work.ti[i, 0] * tree.marker_rotation[k, 0, e]
                + work.ti[i, 1] * tree.marker_rotation[k, 1, e]
                + work.ti[i, 2] * tree.marker_rotation[k, 2, e]
            )
        va0, va1, va2 = work.na[0, n_in], work.na[1, n_in], work.na[2, n_in]
        work.nl[0, n_in] = work.s_eff[0, e] + va1 * lever[2] - va2 * lever[1]
        work.nl[1, n_in] = work.s_eff[1, e] + va2 * lever[0] - va0 * lever[2]
        work.nl[2, n_in] = work.s_eff[2, e] + va0 * lever[1] - va1 * lever[0]
        n_in += 1
    return n_in


@kernel(inline="always")
def joint_motion(b, p, kind, n_in, y, yd, tree, work):
    """Carry the joint-frame kinematics (parent components) through the joint of body b."""
    q0, u0 = tree.joint_q[b], tree.joint_u[b]
    axis = tree.axis[b]
    wn, nb_lin, nb_ang, nv = work.wn, work.nb_lin, work.nb_ang, work.nv
    rate, accel = 0.0, 0.0
    if kind == PRISMATIC or kind == FREE:
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
            work.th[i] = axis[i] * angle
        rotation_exp(work.th, work.rn, work.ti)
    elif kind == SPHERICAL:
        quaternion_rotation(y[q0 : q0 + 4], work.rn)
    elif kind == FREE:
        quaternion_rotation(y[q0 + 3 : q0 + 7], work.rn)
    if kind == FIXED or kind == PRISMATIC:
        for i in range(3):
            for j in range(3):
                work.rb[i, j] = work.rj[i, j]
    else:
        for i in range(3):
            for j in range(3):
                work.rb[i, j] = (
                    work.rj[i, 0] * work.rn[0, j] + work.rj[i, 1] * work.rn[1, j] + work.rj[i, 2] * work.rn[2, j]
                )
    rb = work.rb
    # into body components
    for i in range(3):
        work.omega[b, i] = rb[0, i] * wn[0] + rb[1, i] * wn[1] + rb[2, i] * wn[2]
        work.v[b, i] = rb[0, i] * nv[0] + rb[1, i] * nv[1] + rb[2, i] * nv[2]
        work.bias_lin[b, i] = rb[0, i] * nb_lin[0] + rb[1, i] * nb_lin[1] + rb[2, i] * nb_lin[2]
        work.bias_ang[b, i] = rb[0, i] * nb_ang[0] + rb[1, i] * nb_ang[1] + rb[2, i] * nb_ang[2]
        for c in range(n_in):
            work.vl[b, i, c] = rb[0, i] * work.nl[0, c] + rb[1, i] * work.nl[1, c] + rb[2, i] * work.nl[2, c]
            work.va[b, i, c] = rb[0, i] * work.na[0, c] + rb[1, i] * work.na[1, c] + rb[2, i] * work.na[2, c]
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
            work.th[i] = axis[i] * rate
        cross_add(work.omega[b], work.th, work.bias_ang[b])
        for i in range(3):
            work.omega[b, i] += work.th[i]
            if kind == SERVO:
                work.bias_ang[b, i] += axis[i] * accel
            else:
                work.va[b, i, n_in] = axis[i]
                work.vl[b, i, n_in] = 0.0
    elif kind == SPHERICAL or kind == FREE:
        first = u0 if kind == SPHERICAL else u0 + 3
        for i in range(3):
            work.th[i] = yd[first + i]
        cross_add(work.omega[b], work.th, work.bias_ang[b])
        for i in range(3):
            work.omega[b, i] += work.th[i]
            for j in range(3):
                work.va[b, j, n_in + i] = 1.0 if i == j else 0.0
                work.vl[b, j, n_in + i] = 0.0


@kernel(inline="always")
def slide_joint(b, p, kind, n_in, y, yd, tree, work):
    """Translation of a prismatic or free joint, along axes fixed in the joint frame (parent components).

    wn, nb_*, nv are those of the joint frame; its orientation does not change by sliding, so a translation d adds
    ω × d etc. and the columns d/du.
    """
    q0, u0 = tree.joint_q[b], tree.joint_u[b]
    d, dd = work.c1, work.c2
    n_slide = 1 if kind == PRISMATIC else 3
    for i in range(3):
        d[i] = 0.0
        dd[i] = 0.0
        for k in range(n_slide):
            if kind == PRISMATIC:
                direction = (
                    work.rj[i, 0] * tree.axis[b, 0] + work.rj[i, 1] * tree.axis[b, 1] + work.rj[i, 2] * tree.axis[b, 2]
                )
            else:
                direction = work.rj[i, k]
            d[i] += direction * y[q0 + k]
            dd[i] += direction * yd[u0 + k]
            work.nl[i, n_in + k] = direction
            work.na[i, n_in + k] = 0.0
    for c in range(n_in):
        a0, a1, a2 = work.na[0, c], work.na[1, c], work.na[2, c]
        work.nl[0, c] += a1 * d[2] - a2 * d[1]
        work.nl[1, c] += a2 * d[0] - a0 * d[2]
        work.nl[2, c] += a0 * d[1] - a1 * d[0]
    for i in range(3):
        work.th[i] = 0.0
    cross_add(work.wn, d, work.th)
    for i in range(3):
        work.nv[i] += dd[i] + work.th[i]
        work.thd[i] = work.th[i] + 2.0 * dd[i]
        if p >= 0:
            work.r[b, i] += work.rot[p, i, 0] * d[0] + work.rot[p, i, 1] * d[1] + work.rot[p, i, 2] * d[2]
        else:
            work.r[b, i] += d[i]
    cross_add(work.wn, work.thd, work.nb_lin)
    cross_add(work.nb_ang, d, work.nb_lin)


@kernel
def body_terms(b, y, yd, tree, work):
    """State-dependent inertia of body b: mc, J, C, D and the velocity-dependent forces h (elastic ones too)."""
    nf = tree.n_elastic[b]
    q0, u0 = tree.elastic_q[b], tree.elastic_u[b]
    w = work.omega[b]
    mc, jj, h = work.mc[b], work.jj[b], work.h[b]
    for i in range(3):
        mc[i] = tree.c0[b, i]
        h[i] = 0.0
        h[3 + i] = 0.0
        work.cd[i] = 0.0
        work.dd[i] = 0.0
        for j in range(3):
            jj[i, j] = tree.j0[b, i, j]
            work.jd[i, j] = 0.0
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
                d += tree.d1[b, k, j, i] * qj
                dbias += tree.d1[b, k, j, i] * rj
            work.cc[b, i, k] = c
            work.dk[b, i, k] = d
            mc[i] += half * qk
            work.cd[i] += c * rk
            work.dd[i] += d * rk
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
                work.jd[i, m] += g * rk
                centrifugal += w[i] * g * w[m]
        gyro = 0.0
        for j in range(nf):
            convective = 0.0
            for l in range(nf):
                convective += (tree.m1[b, k, l, j] - 0.5 * tree.m1[b, l, j, k]) * yd[u0 + l]
            gyro += yd[u0 + j] * (
                convective
                + w[0] * (tree.d1[b, k, j, 0] - tree.d1[b, j, k, 0])
                + w[1] * (tree.d1[b, k, j, 1] - tree.d1[b, j, k, 1])
                + w[2] * (tree.d1[b, k, j, 2] - tree.d1[b, j, k, 2])
            )
        h[6 + k] = gyro - 0.5 * centrifugal
    # rotational velocity terms
    for i in range(3):
        work.c1[i] = 2.0 * work.cd[i]
        work.c2[i] = work.dd[i]
        for j in range(3):
            work.c2[i] += jj[i, j] * w[j]
            h[3 + i] += work.jd[i, j] * w[j]
    cross_add(w, mc, work.c1)
    cross_add(w, work.c1, h[:3])
    cross_add(w, work.c2, h[3:6])


@kernel(inline="always")
def assemble(y, loads, tree, work):
    """Mass matrix and right-hand side of M u̇ = f from all bodies; kinematics must be up to date."""
    n_q, n_u = tree.n_q, tree.n_u
    yd = y[n_q : n_q + n_u]
    mass, force = work.mass, work.force
    mass[:, :] = 0.0
    force[:] = 0.0
    for b in range(tree.parent.shape[0]):
        body_terms(b, y, yd, tree, work)
        m, nf, nc = tree.mass[b], tree.n_elastic[b], tree.n_col[b]
        mc, jj, h, cols = work.mc[b], work.jj[b], work.h[b], tree.cols[b]
        rot = work.rot[b]
        a, al, f, t = work.a, work.al, work.c1, work.c2
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
            c0, c1, c2 = work.cc[b, 0, k], work.cc[b, 1, k], work.cc[b, 2, k]
            d0, d1, d2 = work.dk[b, 0, k], work.dk[b, 1, k], work.dk[b, 2, k]
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
                value = tree.m0[b, k, j]
                for l in range(nf):
                    value += tree.m1[b, k, j, l] * y[q0 + l]
                mass[u0 + k, u0 + j] += value


@kernel
def cholesky(a):
    """Factor a = L Lᵀ in place (lower triangle); False if a is not positive definite."""
    n = a.shape[0]
    for j in range(n):
        s = a[j, j]
        full = s
        for k in range(j):
            s -= a[j, k] * a[j, k]
        if not s > 1e-14 * full:
            return False
        root = math.sqrt(s)
        a[j, j] = root
        inverse = 1.0 / root
        for i in range(j + 1, n):
            s = a[i, j]
            for k in range(j):
                s -= a[i, k] * a[j, k]
            a[i, j] = s * inverse
    return True


@kernel
def solve_lower(a, b):
    """Replace b by L⁻¹ b."""
    for i in range(b.shape[0]):
        s = b[i]
        for k in range(i):
            s -= a[i, k] * b[k]
        b[i] = s / a[i, i]


@kernel
def solve_upper(a, b):
    """Replace b by L⁻ᵀ b."""
    n = b.shape[0]
    for i in range(n - 1, -1, -1):
        s = b[i]
        for k in range(i + 1, n):
            s -= a[k, i] * b[k]
        b[i] = s / a[i, i]


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
            work.frame_r[side, i] = work.x[i]
            work.frame_v[side, i] = 0.0
            work.frame_w[side, i] = 0.0
            work.frame_bl[side, i] = 0.0
            work.frame_ba[side, i] = 0.0
            for j in range(3):
                work.frame_rot[side, i, j] = work.rj[i, j]
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
            work.frame_r[side, i] += rot[i, m] * work.x[m]
            work.frame_v[side, i] += rot[i, m] * work.nv[m]
            work.frame_w[side, i] += rot[i, m] * work.wn[m]
            work.frame_bl[side, i] += rot[i, m] * work.nb_lin[m]
            work.frame_ba[side, i] += rot[i, m] * work.nb_ang[m]
        for j in range(3):
            work.frame_rot[side, i, j] = (
                rot[i, 0] * work.rj[0, j] + rot[i, 1] * work.rj[1, j] + rot[i, 2] * work.rj[2, j]
            )
        for col in range(n_in):
            u = tree.cols[p, col] if col < n_parent else tree.elastic_u[p] + col - n_parent
            jl[i, u] = rot[i, 0] * work.nl[0, col] + rot[i, 1] * work.nl[1, col] + rot[i, 2] * work.nl[2, col]
            ja[i, u] = rot[i, 0] * work.na[0, col] + rot[i, 1] * work.na[1, col] + rot[i, 2] * work.na[2, col]


@kernel
def turn_by_servo(c, y, tree, work):
    """Turn the first frame of constraint c by its servo angle about the constraint's axis."""
    s = tree.constraint_servo[c]
    n_y = tree.n_q + tree.n_u
    angle, rate, accel = y[n_y + s], y[n_y + tree.n_servo + s], work.servo_acceleration[s]
    axis, rot = tree.constraint_axis[c], work.frame_rot[0]
    for i in range(3):
        work.th[i] = axis[i] * angle
        work.thd[i] = rot[i, 0] * axis[0] + rot[i, 1] * axis[1] + rot[i, 2] * axis[2]
    rotation_exp(work.th, work.rn, work.ti)
    for i in range(3):
        r0, r1, r2 = rot[i, 0], rot[i, 1], rot[i, 2]
        for j in range(3):
            rot[i, j] = r0 * work.rn[0, j] + r1 * work.rn[1, j] + r2 * work.rn[2, j]
        work.frame_ba[0, i] += work.thd[i] * accel
        work.c1[i] = work.thd[i] * rate
    cross_add(work.frame_w[0], work.c1, work.frame_ba[0])
    for i in range(3):
        work.frame_w[0, i] += work.c1[i]


@kernel
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
        delta, rate, bias, spin = work.c1, work.c2, work.th, work.thd
        for i in range(3):
            delta[i] = work.frame_r[1, i] - work.frame_r[0, i]
            rate[i] = work.frame_v[1, i] - work.frame_v[0, i]
            bias[i] = work.frame_bl[1, i] - work.frame_bl[0, i]
            spin[i] = work.frame_ba[1, i] - work.frame_ba[0, i]
            work.x[i] = 0.0
            work.xd[i] = 0.0
        cross_add(delta, wc, rate)  # ḋ seen from the first frame
        cross_add(wc, delta, work.x)
        for i in range(3):
            work.x[i] += 2.0 * rate[i]
        cross_add(work.x, wc, bias)
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
            work.x[i] = 0.0
            if kind == WELD:
                j, k = (i + 1) % 3, (i + 2) % 3
                for m in range(3):
                    work.x[i] += 0.5 * (rc[m, k] * rd[m, j] - rc[m, j] * rd[m, k])
            else:
                for m in range(3):
                    for n in range(3):
                        work.xd[i] += rc[m, i] * rd[m, n] * tree.constraint_axis[c, n]
        if kind == HINGE:
            cross_add(tree.constraint_axis[c], work.xd, work.x)
        for t in range(n_turn):
            e = tree.constraint_turn[c, t]
            work.residual[row] = e[0] * work.x[0] + e[1] * work.x[1] + e[2] * work.x[2]
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
    n_c, n_u, alpha = work.jacobian.shape[0], tree.n_u, tree.stabilisation
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


@kernel(inline="always")
def rates(y, tau, inputs, tree, work, dy, constrained=None):
    """dy/dt for the state y = [q, u, servo angles, servo rates] at the fraction tau of the input interval.

    inputs holds the loads at both ends of the interval: body_loads (2, n_b, 6 + n_f), dof_force (2, n_u),
    reference (2, n_u), reference_rate (2, n_u), servo_command (2, n_servo); linear in between.

    ``constrained`` is None for a system without constraint equations, which then cost neither time nor compilation.
    Returns OK, SINGULAR_MASS or SINGULAR_CONSTRAINTS. The accelerations are also left in work.force, the constraint
    forces on the second bodies in work.multipliers.
    """
    n_q, n_u, n_s = tree.n_q, tree.n_u, tree.n_servo
    n_y = n_q + n_u
    yd = y[n_q:n_y]
    for s in range(n_s):
        command = inputs.servo_command[0, s] + tau * (inputs.servo_command[1, s] - inputs.servo_command[0, s])
        angle, rate = y[n_y + s], y[n_y + n_s + s]
        wn = tree.servo_frequency[s]
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
def energies(y, tree, work):
    """Kinetic, elastic (bodies and joint springs about zero) and gravitational energy [J]; updates the kinematics."""
    n_q, n_u = tree.n_q, tree.n_u
    yd = y[n_q : n_q + n_u]
    kinematics(y, tree, work)
    kinetic, elastic, potential = 0.0, 0.0, 0.0
    for b in range(tree.parent.shape[0]):
        body_terms(b, y, yd, tree, work)
        v, w, mc, jj, rot = work.v[b], work.omega[b], work.mc[b], work.jj[b], work.rot[b]
        m, nf, u0, q0 = tree.mass[b], tree.n_elastic[b], tree.elastic_u[b], tree.elastic_q[b]
        for i in range(3):
            work.c1[i] = 0.0
        cross_add(w, mc, work.c1)
        for i in range(3):
            kinetic += 0.5 * m * v[i] * v[i] + v[i] * work.c1[i]
            centre = m * work.r[b, i]
            for j in range(3):
                kinetic += 0.5 * w[i] * jj[i, j] * w[j]
                centre += rot[i, j] * mc[j]
            potential -= tree.gravity[i] * centre
        for k in range(nf):
            for i in range(3):
                kinetic += yd[u0 + k] * (v[i] * work.cc[b, i, k] + w[i] * work.dk[b, i, k])
            for j in range(nf):
                modal = tree.m0[b, k, j]
                for l in range(nf):
                    modal += tree.m1[b, k, j, l] * y[q0 + l]
                kinetic += 0.5 * yd[u0 + k] * modal * yd[u0 + j]
                elastic += 0.5 * y[q0 + k] * tree.stiffness[b, k, j] * y[q0 + j]
    for i in range(n_u):
        if tree.dof_stiffness[i] != 0.0:
            elastic += 0.5 * tree.dof_stiffness[i] * y[tree.dof_q[i]] ** 2
    return kinetic, elastic, potential


@kernel
def joint_wrenches(y, acceleration, loads, tree, work, wrench):
    """Force and moment that each joint exerts on its body, at the body frame origin in body components.

    Inertia minus applied loads of the body plus what its children take through their joints (tip to root); a free body
    that a weld ties to another one counts as its child. Needs
    kinematics of the state y and servo accelerations up to date; ``acceleration`` is u̇ (n_u,), ``wrench`` (n_b, 6).
    """
    n_q = tree.n_q
    yd = y[n_q : n_q + tree.n_u]
    wrench[:, :] = 0.0
    a, al = work.a, work.al
    for b in range(tree.parent.shape[0] - 1, -1, -1):
        body_terms(b, y, yd, tree, work)
        m, nf, mc, jj, h, rot = tree.mass[b], tree.n_elastic[b], work.mc[b], work.jj[b], work.h[b], work.rot[b]
        for i in range(3):
            a[i] = (
                work.bias_lin[b, i]
                - rot[0, i] * tree.gravity[0]
                - rot[1, i] * tree.gravity[1]
                - rot[2, i] * tree.gravity[2]
            )
            al[i] = work.bias_ang[b, i]
            for c in range(tree.n_col[b]):
                rate = acceleration[tree.cols[b, c]]
                a[i] += work.vl[b, i, c] * rate
                al[i] += work.va[b, i, c] * rate
        f, t = work.c1, work.c2
        for i in range(3):
            f[i] = m * a[i] + h[i] - loads[b, i]
            t[i] = jj[i, 0] * al[0] + jj[i, 1] * al[1] + jj[i, 2] * al[2] + h[3 + i] - loads[b, 3 + i]
            for k in range(nf):
                rate = acceleration[tree.elastic_u[b] + k]
                f[i] += work.cc[b, i, k] * rate
                t[i] += work.dk[b, i, k] * rate
        cross_add(al, mc, f)
        cross_add(mc, a, t)
        for i in range(3):
            wrench[b, i] += f[i]
            wrench[b, 3 + i] += t[i]
        p = tree.load_parent[b]
        if p >= 0:
            # into parent components: global difference of origins gives the lever
            pr = work.rot[p]
            for i in range(3):
                work.th[i] = 0.0
                work.thd[i] = 0.0
                work.x[i] = 0.0
                for j in range(3):
                    work.x[i] += pr[j, i] * (work.r[b, j] - work.r[p, j])
                    turn = pr[0, i] * rot[0, j] + pr[1, i] * rot[1, j] + pr[2, i] * rot[2, j]
                    work.th[i] += turn * wrench[b, j]
                    work.thd[i] += turn * wrench[b, 3 + j]
            cross_add(work.x, work.th, work.thd)
            for i in range(3):
                wrench[p, i] += work.th[i]
                wrench[p, 3 + i] += work.thd[i]


@kernel
def point_motion(rot, r, v, w, q, rate, points, position, velocity):
    """Global position and velocity of points that move with a body.

    Parameters
    ----------
    rot, r, v, w : (3, 3), (3,), (3,), (3,)
        Frame of the body: orientation and origin (global), velocity and angular velocity (body components).
    q, rate : (n_f,)
        Elastic coordinates and their rates.
    points : Points
        position (n, 3), linear (n, 3, n_f), second (n, 3, n_f, n_f).
    position, velocity : (n, 3)
        Filled.
    """
    nf = q.shape[0]
    for n in range(position.shape[0]):
        x0, x1, x2 = points.position[n, 0], points.position[n, 1], points.position[n, 2]
        v0, v1, v2 = v[0], v[1], v[2]
        for k in range(nf):
            s0, s1, s2 = points.linear[n, 0, k], points.linear[n, 1, k], points.linear[n, 2, k]
            h0, h1, h2 = 0.0, 0.0, 0.0
            for j in range(nf):
                h0 += points.second[n, 0, k, j] * q[j]
                h1 += points.second[n, 1, k, j] * q[j]
                h2 += points.second[n, 2, k, j] * q[j]
            x0 += (s0 + 0.5 * h0) * q[k]
            x1 += (s1 + 0.5 * h1) * q[k]
            x2 += (s2 + 0.5 * h2) * q[k]
            v0 += (s0 + h0) * rate[k]
            v1 += (s1 + h1) * rate[k]
            v2 += (s2 + h2) * rate[k]
        v0 += w[1] * x2 - w[2] * x1
        v1 += w[2] * x0 - w[0] * x2
        v2 += w[0] * x1 - w[1] * x0
        for i in range(3):
            position[n, i] = r[i] + rot[i, 0] * x0 + rot[i, 1] * x1 + rot[i, 2] * x2
            velocity[n, i] = rot[i, 0] * v0 + rot[i, 1] * v1 + rot[i, 2] * v2


@kernel
def point_loads(rot, q, points, force, loads):
    """Add global point forces (n, 3) to the loads (6 + n_f,) of a body by virtual work, body components."""
    nf = q.shape[0]
    for n in range(force.shape[0]):
        x0, x1, x2 = points.position[n, 0], points.position[n, 1], points.position[n, 2]
        g0, g1, g2 = force[n, 0], force[n, 1], force[n, 2]
        f0 = rot[0, 0] * g0 + rot[1, 0] * g1 + rot[2, 0] * g2
        f1 = rot[0, 1] * g0 + rot[1, 1] * g1 + rot[2, 1] * g2
        f2 = rot[0, 2] * g0 + rot[1, 2] * g1 + rot[2, 2] * g2
        for k in range(nf):
            s0, s1, s2 = points.linear[n, 0, k], points.linear[n, 1, k], points.linear[n, 2, k]
            h0, h1, h2 = 0.0, 0.0, 0.0
            for j in range(nf):
                h0 += points.second[n, 0, k, j] * q[j]
                h1 += points.second[n, 1, k, j] * q[j]
                h2 += points.second[n, 2, k, j] * q[j]
            x0 += (s0 + 0.5 * h0) * q[k]
            x1 += (s1 + 0.5 * h1) * q[k]
            x2 += (s2 + 0.5 * h2) * q[k]
            loads[6 + k] += (s0 + h0) * f0 + (s1 + h1) * f1 + (s2 + h2) * f2
        loads[0] += f0
        loads[1] += f1
        loads[2] += f2
        loads[3] += x1 * f2 - x2 * f1
        loads[4] += x2 * f0 - x0 * f2
        loads[5] += x0 * f1 - x1 * f0
