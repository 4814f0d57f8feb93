"""Loads and constraints on markers of bodies in local observer frames.

With w the six components (force, moment) that a unit multiplier exerts on a marker, in frame axes, a Jacobian row is
B_r = w shape, so that B A⁻¹ Bᵀ needs only the 6 × 6 blocks shape A⁻¹ shapeᵀ.

Three kinds of rows stand side by side: displacements and angles that are held, the latter perhaps by a drive that turns
the second section about an axis, and the angle of a hinge on which a torque acts.
"""

import math

from wt_gym.base.compiled import kernel
from wt_gym.multibody.tree.rotation_kernels import rotation_exp, tangent_bias

DISPLACEMENT, ORTHOGONAL, TORQUE = range(3)
FIXED, UNDEFORMED, DEFORMED, TURNED, CONSISTENT = range(5)

# ---- loads ---------------------------------------------------------------------------------------------------------


@kernel
def marker_field(m, model, x, out):
    """Displacement and rotation (6,) of a marker for the coordinates x (n_b, n_max) of all bodies."""
    b = model.marker_body[m]
    for i in range(6):
        total = 0.0
        for k in range(model.n[b]):
            total += model.marker_shape[m, i, k] * x[b, k]
        out[i] = total


@kernel
def add_loads(value, model, state, q, work, out):
    """Out += Nᵀ p + Pᵀ m of all loads (n_loads, 6: force, moment) at the coordinates q (eq. 4).

    Consistent loads add p · H q, the work of p on the second-order displacement ½ qᵀ H q of their point; where that is
    part of the displacement, it is in the shape of the marker.
    """
    f, u, p = work.pull, work.field, work.load
    for l in range(model.load_marker.shape[0]):
        m, axes = model.load_marker[l], model.load_axes[l]
        b = model.marker_body[m]
        for i in range(6):
            f[i] = value[l, i]
        if axes == FIXED:
            r = state.rotation[b]
            for i in range(3):
                p[i] = r[0, i] * f[0] + r[1, i] * f[1] + r[2, i] * f[2]
                p[i + 3] = r[0, i] * f[3] + r[1, i] * f[4] + r[2, i] * f[5]
        else:
            for i in range(6):
                p[i] = f[i]
        if axes >= DEFORMED:
            marker_field(m, model, q, u)
            for i in range(3):
                j, k = (i + 1) % 3, (i + 2) % 3
                p[i] += u[3 + j] * f[k] - u[3 + k] * f[j]
                p[i + 3] += u[3 + j] * f[3 + k] - u[3 + k] * f[3 + j]
        if axes == DEFORMED:
            for i in range(3):
                j, k = (i + 1) % 3, (i + 2) % 3
                p[i + 3] += u[j] * p[k] - u[k] * p[j]
        for k in range(model.n[b]):
            total = 0.0
            for i in range(6):
                total += model.marker_shape[m, i, k] * p[i]
            out[b, k] += total
        if axes == UNDEFORMED or axes == DEFORMED:
            # the lever of eq. (4) is that of the undeformed axis, plus what the moment m adds
            x = model.marker_lever[m]
            for i in range(3):
                j, k = (i + 1) % 3, (i + 2) % 3
                out[b, model.n[b] - 3 + i] -= x[j] * p[k] - x[k] * p[j]
        if axes == CONSISTENT and not model.bends[b]:
            second = model.load_second[model.load_field[l]]
            for k in range(model.n[b] - 6):
                total = 0.0
                for j in range(model.n[b] - 6):
                    h = p[0] * second[0, k, j] + p[1] * second[1, k, j] + p[2] * second[2, k, j]
                    total += h * q[b, j]
                out[b, k] += total
    for b in range(model.load_section.shape[0]):
        if model.load_section[b] >= 0:
            add_section_load(b, model, q, work, out[b])


@kernel
def add_section_load(b, model, q, work, out):
    """Out (n_max,) += generalized loads of a body that are known for its section ``load_section``, by virtual work.

    work.body_load[b] holds the forces on the elastic coordinates for that section at rest, then force and moment at the
    section in its axes. The virtual turn of the section is T δφ for the rotation φ of the section from the frame.
    """
    m, n = model.load_section[b], model.n[b]
    load, u, p = work.body_load[b], work.field, work.load
    marker_field(m, model, q, u)
    rotation_exp(u[3:6], work.turn, work.tangent)
    r, t, moment = work.turn, work.tangent, work.spare
    for i in range(3):
        p[i] = r[i, 0] * load[n - 6] + r[i, 1] * load[n - 5] + r[i, 2] * load[n - 4]
        moment[i] = r[i, 0] * load[n - 3] + r[i, 1] * load[n - 2] + r[i, 2] * load[n - 1]
    for i in range(3):
        p[3 + i] = t[0, i] * moment[0] + t[1, i] * moment[1] + t[2, i] * moment[2]
    for k in range(n):
        total = load[k] if k < n - 6 else 0.0
        for i in range(6):
            total += model.marker_shape[m, i, k] * p[i]
        out[k] += total


# ---- constraints ---------------------------------------------------------------------------------------------------


@kernel
def marker_motion(m, model, state, q, v, work):
    """Position, velocity, section orientation and its rates of a marker, in fixed axes, and the acceleration bias."""
    b = model.marker_body[m]
    u, du = work.field, work.field_rate
    marker_field(m, model, q, u)
    marker_field(m, model, v, du)
    r, w, al = state.rotation[b], state.omega[b], state.alpha[b]
    x, rate, bias, c = work.lever, work.rate, work.bias, work.spare
    for i in range(3):
        x[i] = model.marker_position[m, i] + u[i]
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        c[i] = w[j] * x[k] - w[k] * x[j]
        rate[i] = c[i] + du[i]
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        bias[i] = al[j] * x[k] - al[k] * x[j] + w[j] * (c[k] + 2.0 * du[k]) - w[k] * (c[j] + 2.0 * du[j])
    tangent = work.marker_tangent[m]
    rotation_exp(u[3:6], work.turn, tangent)
    tangent_bias(u[3:6], du[3:6], work.angle)
    for i in range(3):
        c[i] = tangent[i, 0] * du[3] + tangent[i, 1] * du[4] + tangent[i, 2] * du[5]
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        rate[3 + i] = w[i] + c[i]
        bias[3 + i] = al[i] + w[j] * c[k] - w[k] * c[j] + work.angle[i]
    for i in range(3):
        p, pd, pb = state.position[b, i], state.velocity[b, i], state.acceleration[b, i]
        wd, wb = 0.0, 0.0
        for j in range(3):
            p += r[i, j] * x[j]
            pd += r[i, j] * rate[j]
            pb += r[i, j] * bias[j]
            wd += r[i, j] * rate[3 + j]
            wb += r[i, j] * bias[3 + j]
            work.marker_rotation[m, i, j] = (
                r[i, 0] * work.turn[0, j] + r[i, 1] * work.turn[1, j] + r[i, 2] * work.turn[2, j]
            )
        work.marker_point[m, i] = p
        work.marker_rate[m, i], work.marker_rate[m, 3 + i] = pd, wd
        work.marker_bias[m, i], work.marker_bias[m, 3 + i] = pb, wb


@kernel
def cross(a, b, out):
    """Out = a × b."""
    out[0] = a[1] * b[2] - a[2] * b[1]
    out[1] = a[2] * b[0] - a[0] * b[2]
    out[2] = a[0] * b[1] - a[1] * b[0]


@kernel
def place_row(row, side, m, vector, offset, sign, model, state, work):
    """Write the unit action (fixed axes; offset 0 a force, 3 a moment) on a marker into the row's weights."""
    r = state.rotation[model.marker_body[m]]
    w = work.weight[row, side]
    for i in range(6):
        w[i] = 0.0
    for i in range(3):
        w[offset + i] = sign * (r[0, i] * vector[0] + r[1, i] * vector[1] + r[2, i] * vector[2])
    if offset == 3:
        t, x, y, z = work.marker_tangent[m], w[3], w[4], w[5]
        for i in range(3):
            w[3 + i] = t[0, i] * x + t[1, i] * y + t[2, i] * z


@kernel
def turned_vector(row, b, vector, model, work):
    """A vector of the second section of a row, which a drive may turn: the vector, angular velocity and acceleration.

    With the axis n of the drive, fixed in the section, and its angle θ the vector is S_b exp(θ ñ) r, and its axes have

        W = W_b + θ̇ S_b n,    Ẇ = Ẇ_b + θ̈ S_b n + θ̇ W_b × S_b n.

    Fills work.two, work.second_rate and work.second_bias, and work.axis = S_b n.
    """
    drive, n, axis, two, turn = model.row_drive[row], model.row_axis[row], work.axis, work.two, work.angle
    angle, rate, acceleration = 0.0, 0.0, 0.0
    if drive >= 0:
        angle, rate, acceleration = work.drive[drive, 0], work.drive[drive, 1], work.drive[drive, 2]
    along = n[0] * vector[0] + n[1] * vector[1] + n[2] * vector[2]
    cos, sin = math.cos(angle), math.sin(angle)
    cross(n, vector, work.spare)
    for i in range(3):
        turn[i] = cos * vector[i] + sin * work.spare[i] + (1.0 - cos) * along * n[i]
    for i in range(3):
        two[i], axis[i] = turn[i], n[i]
        work.second_rate[i], work.second_bias[i] = 0.0, 0.0
    if b >= 0:
        for i in range(3):
            s = work.marker_rotation[b, i]
            two[i] = s[0] * turn[0] + s[1] * turn[1] + s[2] * turn[2]
            axis[i] = s[0] * n[0] + s[1] * n[1] + s[2] * n[2]
            work.second_rate[i], work.second_bias[i] = work.marker_rate[b, 3 + i], work.marker_bias[b, 3 + i]
    cross(work.second_rate, axis, work.spare)
    for i in range(3):
        work.second_bias[i] += acceleration * axis[i] + rate * work.spare[i]
        work.second_rate[i] += rate * axis[i]


@kernel
def hinge_angle(one, two, axis, last, spare):
    """Angle [rad] about an axis from the vector two to the vector one, the one closest to a known angle."""
    cross(two, one, spare)
    sin = axis[0] * spare[0] + axis[1] * spare[1] + axis[2] * spare[2]
    cos = two[0] * one[0] + two[1] * one[1] + two[2] * one[2]
    angle = math.atan2(sin, cos)
    return angle + 2.0 * math.pi * math.floor((last - angle) / (2.0 * math.pi) + 0.5)


@kernel
def row_torque(row, model, work):
    """Torque [N m] on a hinge: spring and damper at its present angle and rate about their references, and a drive."""
    spring = work.spring[model.row_spring[row]]
    return (
        model.row_stiffness[row] * (spring[0] - work.row_value[row])
        + model.row_damping[row] * (spring[1] - work.row_rate[row])
        + spring[2]
    )


@kernel
def free_hinges(model, work, share):
    """Make the equations of hinges in B A⁻¹ Bᵀ λ = rhs say what λ is; ``work.row_scale`` keeps its factor.

    With a rotor's inertia I on a hinge, λ = I θ̈ − τ and θ̈ = θ̈₀ − B A⁻¹ Bᵀ λ make it λ + I B A⁻¹ Bᵀ λ = I θ̈₀ − τ.
    """
    n_row = model.row_kind.shape[0]
    for r in range(n_row):
        if model.row_kind[r] == TORQUE:
            scale, inertia = work.schur[r, r], share * model.row_inertia[r]
            for s in range(n_row):
                work.schur[r, s] *= scale * inertia
            work.schur[r, r] += scale
            work.row_scale[r] = scale


@kernel
def give_torques(model, work, known):
    """The right-hand sides of these equations, or zero where torques are not ``known``.

    ``work.multiplier`` holds the accelerations θ̈₀ without reactions.
    """
    for r in range(model.row_kind.shape[0]):
        if model.row_kind[r] == TORQUE:
            torque = row_torque(r, model, work) - model.row_inertia[r] * work.multiplier[r]
            work.multiplier[r] = -work.row_scale[r] * torque if known else 0.0


@kernel
def constraint_rows(model, state, q, v, work):
    """Value, rate and acceleration bias of all constraint rows and their weights on the markers."""
    for m in range(model.marker_body.shape[0]):
        if model.marker_held[m]:
            marker_motion(m, model, state, q, v, work)
    one, two, c, c_rate, turn = work.one, work.two, work.normal, work.normal_rate, work.angle
    for row in range(model.row_kind.shape[0]):
        a, b = model.row_marker[row, 0], model.row_marker[row, 1]
        vector, other = model.row_vector[row, 0], model.row_vector[row, 1]
        value, rate, bias = 0.0, 0.0, 0.0
        if model.row_kind[row] == DISPLACEMENT:
            for i in range(3):
                gap, speed, acc = work.marker_point[a, i], work.marker_rate[a, i], work.marker_bias[a, i]
                if b >= 0:
                    gap -= work.marker_point[b, i]
                    speed -= work.marker_rate[b, i]
                    acc -= work.marker_bias[b, i]
                else:
                    gap -= other[i]
                value += vector[i] * gap
                rate += vector[i] * speed
                bias += vector[i] * acc
                c[i] = vector[i]
            offset = 0
        else:
            for i in range(3):
                s = work.marker_rotation[a, i]
                one[i] = s[0] * vector[0] + s[1] * vector[1] + s[2] * vector[2]
            turned_vector(row, b, other, model, work)
            if model.row_kind[row] == ORTHOGONAL:
                cross(one, two, c)
                # ċ = (W_a × one) × two + one × (W_b × two)
                cross(work.marker_rate[a, 3:6], one, turn)
                cross(turn, two, c_rate)
                cross(work.second_rate, two, turn)
                cross(one, turn, work.spare)
                for i in range(3):
                    c_rate[i] += work.spare[i]
                    value += one[i] * two[i]
            else:
                value = hinge_angle(one, two, work.axis, state.angle[model.row_spring[row]], c)
                for i in range(3):
                    c[i] = work.axis[i]
                    c_rate[i] = 0.0
            for i in range(3):
                speed = work.marker_rate[a, 3 + i] - work.second_rate[i]
                rate += c[i] * speed
                bias += c[i] * (work.marker_bias[a, 3 + i] - work.second_bias[i]) + c_rate[i] * speed
            offset = 3
        work.row_value[row], work.row_rate[row], work.row_bias[row] = value, rate, bias
        place_row(row, 0, a, c, offset, 1.0, model, state, work)
        if b >= 0:
            place_row(row, 1, b, c, offset, -1.0, model, state, work)


@kernel
def marker_pairs(model, columns, pairs):
    """Pairs[m, l] = shape_m columns_l for held markers of one body: the blocks of B A⁻¹ Bᵀ."""
    for m in range(model.marker_body.shape[0]):
        for l in range(model.marker_body.shape[0]):
            b = model.marker_body[m]
            if model.marker_held[m] and model.marker_held[l] and model.marker_body[l] == b:
                for i in range(model.marker_held[m]):
                    for j in range(model.marker_held[l]):
                        total = 0.0
                        for k in range(model.n[b]):
                            total += model.marker_shape[m, i, k] * columns[l, j, k]
                        pairs[m, l, i, j] = total


@kernel
def schur_complement(model, pairs, work, out):
    """B A⁻¹ Bᵀ (n_rows, n_rows).

    work.row_reach (n_rows, n_markers, 6) holds what the unit multiplier of a row moves on every marker.
    """
    n_row, n_m, reach = model.row_kind.shape[0], model.marker_body.shape[0], work.row_reach
    for s in range(n_row):
        for m in range(n_m):
            for i in range(6):
                reach[s, m, i] = 0.0
        for y in range(2):
            l = model.row_marker[s, y]
            if l < 0:
                continue
            weight = work.weight[s, y]
            for m in range(n_m):
                if model.marker_held[m] and model.marker_body[m] == model.marker_body[l]:
                    for i in range(model.marker_held[m]):
                        for j in range(model.marker_held[l]):
                            reach[s, m, i] += pairs[m, l, i, j] * weight[j]
    for r in range(n_row):
        for s in range(n_row):
            out[r, s] = 0.0
        for x in range(2):
            m = model.row_marker[r, x]
            if m < 0:
                continue
            w = work.weight[r, x]
            for s in range(n_row):
                t = reach[s, m]
                out[r, s] += w[0] * t[0] + w[1] * t[1] + w[2] * t[2] + w[3] * t[3] + w[4] * t[4] + w[5] * t[5]


@kernel
def rows_of(model, x, work, out):
    """Out += B x for the coordinates x (n_b, n_max) of all bodies."""
    for m in range(model.marker_body.shape[0]):
        if model.marker_held[m]:
            marker_field(m, model, x, work.marker_field[m])
    for r in range(model.row_kind.shape[0]):
        for side in range(2):
            m = model.row_marker[r, side]
            if m >= 0:
                for i in range(6):
                    out[r] += work.weight[r, side, i] * work.marker_field[m, i]


@kernel
def subtract_reactions(model, columns, multiplier, work, out):
    """Out −= A⁻¹ Bᵀ λ with columns = A⁻¹ shapeᵀ."""
    for m in range(model.marker_body.shape[0]):
        if not model.marker_held[m]:
            continue
        b, pull = model.marker_body[m], work.pull
        for i in range(6):
            pull[i] = 0.0
        for r in range(model.row_kind.shape[0]):
            for side in range(2):
                if model.row_marker[r, side] == m:
                    for i in range(6):
                        pull[i] += work.weight[r, side, i] * multiplier[r]
        for i in range(model.marker_held[m]):
            if pull[i] != 0.0:
                for k in range(model.n[b]):
                    out[b, k] -= pull[i] * columns[m, i, k]


@kernel
def keep_reactions(model, state, work):
    """Forces (n_markers, 3) with which the body of a held marker acts there on others, in the axes of its frame."""
    for m in range(model.marker_body.shape[0]):
        if not (model.marker_held[m] and model.bends[model.marker_body[m]]):
            continue
        for i in range(3):
            state.reaction[m, i] = 0.0
        for r in range(model.row_kind.shape[0]):
            for side in range(2):
                if model.row_marker[r, side] == m:
                    for i in range(3):
                        state.reaction[m, i] += work.weight[r, side, i] * state.multiplier[r]
