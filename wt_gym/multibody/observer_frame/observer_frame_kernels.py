"""Compiled stepping of bodies in local observer frames; theory in :mod:`wt_gym.multibody.observer_frame.frame`."""

import math

from wt_gym.base.compiled import kernel
from wt_gym.multibody.observer_frame.observer_frame_constraint_kernels import (
    TORQUE,
    add_loads,
    constraint_rows,
    free_hinges,
    give_torques,
    keep_reactions,
    marker_pairs,
    row_torque,
    rows_of,
    schur_complement,
    subtract_reactions,
)
from wt_gym.multibody.observer_frame.observer_frame_matrix_kernels import (
    factorize_envelope,
    gyroscopic_product,
    inner_forces,
    mass_product,
    solve_envelope,
    step_matrix,
)
from wt_gym.multibody.tree.linear_algebra_kernels import factorize, solve_factorized
from wt_gym.multibody.tree.rotation_kernels import rotation_exp

OK, SINGULAR_BODY, SINGULAR_CONSTRAINTS, DIVERGED = range(4)
UNIFORM, MEAN, PRINTED = range(3)
"""What the frame's accelerations become in an update: nothing, their mean since the last one, or eqs (10), (11)."""

# ---- frames --------------------------------------------------------------------------------------------------------


@kernel
def turn_frame(b, angle, state, work):
    """R ← R exp(angle̅), the angle in frame axes; leaves exp in work.turn and its tangent in work.tangent."""
    rotation_exp(angle, work.turn, work.tangent)
    r, t = state.rotation[b], work.turn
    for i in range(3):
        x, y, z = r[i, 0], r[i, 1], r[i, 2]
        for j in range(3):
            r[i, j] = x * t[0, j] + y * t[1, j] + z * t[2, j]


@kernel
def predict_frame(b, h, model, state, work):
    """Carry a frame over one step with constant acceleration (fixed axes) and angular acceleration (frame axes).

    The third-order term makes exp exact to O(h⁵) for an angular velocity that grows linearly (Magnus expansion); the
    printed form does without. The angle is kept in state.turned.
    """
    w, a, angle = state.omega[b], state.alpha[b], state.turned[b]
    third = 0.0 if model.prediction == PRINTED else h**3 / 12.0
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        angle[i] = h * w[i] + 0.5 * h * h * a[i] + third * (w[j] * a[k] - w[k] * a[j])
    turn_frame(b, angle, state, work)
    for i in range(3):
        w[i] += h * a[i]
        state.position[b, i] += h * state.velocity[b, i] + 0.5 * h * h * state.acceleration[b, i]
        state.velocity[b, i] += h * state.acceleration[b, i]


@kernel
def needs_update(b, threshold, model, state):
    """Whether the rigid-body displacement of an end or the rotation times the reach exceeds the threshold (0: always).

    A body that turns about its own axis moves neither of its ends: the largest distance from an origin that any body of
    the system has makes a displacement of its rotation too.
    """
    if threshold <= 0.0:
        return True
    n = model.n[b]
    rigid = state.q[b, n - 6 : n]
    angle = rigid[3] * rigid[3] + rigid[4] * rigid[4] + rigid[5] * rigid[5]
    if angle * model.reach * model.reach > threshold * threshold:
        return True
    for end in range(2):
        s = model.ends[b, end]
        square = 0.0
        for i in range(3):
            j, k = (i + 1) % 3, (i + 2) % 3
            u = rigid[i] + rigid[3 + j] * s[k] - rigid[3 + k] * s[j]
            square += u * u
        if square > threshold * threshold:
            return True
    return False


@kernel
def turn_shapes(b, turn, share, model, state, work, out):
    """Out += ∫ Nᵀ (1 + 2 share ω̃) h with h = (H x) q̇, for a change x of the elastic coordinates; of first order.

    h is the velocity that changes its name as shapes turn by x. The Coriolis force on rigid-body coordinates, which a
    step takes with the shapes of its start, lacks 2 ω̃ h at its end, where accelerations have the weight ``share``; the
    rotor would lose the power share · 2 q̇ᵀ K_g x. On elastic coordinates that force is of higher order.
    """
    nf, v = model.n[b] - 6, state.v[b]
    first, moment, mass = model.bend_first[b], model.bend_moment[b], model.bend_mass[b]
    z, c, w = work.pair, work.mean, work.spare
    for k in range(3):
        c[k], w[k] = 0.0, 2.0 * share * (state.omega[b, k] + v[nf + 3 + k])
        for l in range(3):
            z[k, l] = 0.0
    for j in range(nf):
        for m in range(nf):
            product = v[j] * turn[m]
            for i in range(nf):
                out[i] += mass[i, j, m] * product
            for k in range(3):
                c[k] += first[k, j, m] * product
                for l in range(3):
                    z[k, l] += moment[3 * k + l, j, m] * product
    trace = z[0, 0] + z[1, 1] + z[2, 2]
    for k in range(3):
        l, n = (k + 1) % 3, (k + 2) % 3
        out[nf + k] += c[k] + w[l] * c[n] - w[n] * c[l]
        out[nf + 3 + k] += z[n, l] - z[l, n] + w[k] * trace - (z[k, 0] * w[0] + z[k, 1] * w[1] + z[k, 2] * w[2])


@kernel
def take_out(b, w, share, model, state, work):
    """Take w × u out of the velocities in the metric of M: v −= M⁻¹ G(w) x, with x_f of u = N_f x_f in work.vector.

    Where second-order shapes turn by x_f, at the end of a step (`turn_shapes`; ``share`` negative: they do not), H(x_f)
    q̇ is taken out too.
    """
    n = model.n[b]
    field, carried = work.vector[b], work.rhs[b]
    for i in range(n):
        carried[i] = 0.0
    for i in range(n - 6, n):
        field[i] = 0.0
    gyroscopic_product(b, w, model, field, carried)
    if share >= 0.0 and model.bends[b]:
        turn_shapes(b, field, share, model, state, work, carried)
    solve_envelope(n, model.first[b], model.mass_low[b], model.mass_up[b], carried)
    for i in range(n):
        state.v[b, i] -= carried[i]


@kernel
def update_printed(b, model, state, work):
    """Eqs (9)–(12) as they are printed.

    The rotations of the prediction and of the body are added before they are turned into a matrix, the angular
    velocities and accelerations are added in the axes they have, and the accelerations are those of the last instant.
    """
    n = model.n[b]
    q, v, a = state.q[b], state.v[b], state.a[b]
    w, al, r = state.omega[b], state.alpha[b], state.rotation[b]
    u, du, d2u = q[n - 6 : n - 3], v[n - 6 : n - 3], a[n - 6 : n - 3]
    gain, bias = work.spare, work.lever
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        gain[i] = w[j] * u[k] - w[k] * u[j]
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        bias[i] = al[j] * u[k] - al[k] * u[j] + w[j] * gain[k] - w[k] * gain[j]
        bias[i] += 2.0 * (w[j] * du[k] - w[k] * du[j]) + d2u[i]
    for i in range(3):
        for j in range(3):
            state.position[b, i] += r[i, j] * u[j]
            state.velocity[b, i] += r[i, j] * (gain[j] + du[j])
            state.acceleration[b, i] += r[i, j] * bias[j]
    for i in range(3):
        work.angle[i] = -state.turned[b, i]
    turn_frame(b, work.angle, state, work)
    for i in range(3):
        work.angle[i] = state.turned[b, i] + q[n - 3 + i]
    turn_frame(b, work.angle, state, work)
    for i in range(3):
        w[i] += v[n - 3 + i]
        al[i] += a[n - 3 + i]
    for i in range(n - 6, n):
        q[i], v[i] = 0.0, 0.0


@kernel
def update_frame(b, model, state, work):
    """Move the frame onto the rigid-body motion (eqs 9–12), which becomes zero.

    The frame continues uniformly or with the mean acceleration since its last update. The elastic coordinates stay.
    When the rotation modes know the deformed shape, φ × u̇_f is taken out of the rates, the turn of the axes in which
    they are counted.
    """
    n, keep = model.n[b], 1.0 if model.prediction == MEAN else 0.0
    q, v = state.q[b], state.v[b]
    w, al, r, t = state.omega[b], state.alpha[b], state.rotation[b], work.turn
    u, du, phi, dphi = q[n - 6 : n - 3], v[n - 6 : n - 3], q[n - 3 : n], v[n - 3 : n]
    gain, spin, spin_rate, moved = work.spare, work.angle, work.lever, work.pull
    for i in range(3):
        moved[i], moved[3 + i] = du[i], dphi[i]
    rate = 1.0 / state.age[b]
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        gain[i] = du[i] + w[j] * u[k] - w[k] * u[j]
    for i in range(3):
        for j in range(3):
            state.position[b, i] += r[i, j] * u[j]
            state.velocity[b, i] += r[i, j] * gain[j]
            state.acceleration[b, i] += r[i, j] * gain[j] * rate
        state.acceleration[b, i] *= keep
    rotation_exp(phi, t, work.tangent)
    for i in range(3):
        gain[i] = work.tangent[i, 0] * dphi[0] + work.tangent[i, 1] * dphi[1] + work.tangent[i, 2] * dphi[2]
        spin[i] = w[i] + gain[i]
        spin_rate[i] = keep * (al[i] + gain[i] * rate)
    if model.deformed_modes:
        for i in range(n - 6):
            work.vector[b, i] = v[i]
        take_out(b, phi, -1.0, model, state, work)
    for i in range(3):
        w[i] = t[0, i] * spin[0] + t[1, i] * spin[1] + t[2, i] * spin[2]
        al[i] = t[0, i] * spin_rate[0] + t[1, i] * spin_rate[1] + t[2, i] * spin_rate[2]
    turn_frame(b, phi, state, work)
    for i in range(3):
        q[n - 6 + i], q[n - 3 + i] = 0.0, 0.0
        v[n - 6 + i] -= moved[i]
        v[n - 3 + i] -= moved[3 + i]


@kernel
def renew_bending(b, q, model, work):
    """Make the elastic shapes those of the body as it is deformed, N + H q, and s the place s − ½ qᵀ H q.

    To first order in M₀, X and the elastic mass matrix, and in what couples elastic coordinates with translations.
    """
    nf = model.n[b] - 6
    first, moment, extra = model.first_moment[b], model.reference_moment[b], model.extra_mass[b]
    bend, swing, mass = model.bend_first[b], model.bend_moment[b], model.bend_mass[b]
    g, a, e = model.gyro[b], model.second[b], work.pair
    for i in range(nf):
        for k in range(3):
            total = model.elastic_first[b, i, k]
            for j in range(nf):
                total += bend[k, i, j] * q[j]
            first[i, k] = total
        for c in range(9):
            total = model.elastic_moment[b, i, c]
            for j in range(nf):
                total += swing[c, i, j] * q[j]
            moment[i, c] = total
        for j in range(i + 1):
            total = 0.0
            for m in range(nf):
                total += (mass[i, j, m] + mass[j, i, m]) * q[m]
            extra[i, j], extra[j, i] = total, total
    for l in range(3):
        shorter = 0.0
        for i in range(nf):
            shorter += 0.5 * q[i] * (first[i, l] - model.elastic_first[b, i, l])
        for k in range(3):
            moment[nf + k, 3 * k + l] = model.reference_first[b, l] - shorter
    for k in range(3):
        row = nf + k
        for j in range(nf):
            for l in range(3):
                for m in range(3):
                    e[l, m] = first[j, m] if l == k else 0.0
            a[0, row, j], a[1, row, j], a[2, row, j] = e[0, 0], e[1, 1], e[2, 2]
            a[3, row, j], a[4, row, j], a[5, row, j] = e[0, 1] + e[1, 0], e[0, 2] + e[2, 0], e[1, 2] + e[2, 1]
            g[0, row, j], g[1, row, j], g[2, row, j] = e[2, 1] - e[1, 2], e[0, 2] - e[2, 0], e[1, 0] - e[0, 1]
    for i in range(nf + 3):
        for j in range(i + 1):
            value = a[0, i, j] + a[1, i, j] + a[2, i, j]
            if i < nf:
                value += extra[i, j]
            model.mass_low[b, i, j], model.mass_up[b, i, j] = value, value


@kernel
def geometric_stiffness(b, model, state, work):
    """K_g = ∫ H_k [a_c − g + ü_r + (α̃ + φ̈~ + ω̃ω̃) s]_k + H_k(marker) λ_k of the motion and reactions known last."""
    nf, r, y, w = model.n[b] - 6, state.rotation[b], work.spare, work.pair
    acceleration, rate, spin, spin_rate = state.acceleration[b], state.omega[b], work.angle, work.lever
    square = 0.0
    for i in range(3):
        y[i] = state.a[b, nf + i]
        for k in range(3):
            y[i] += r[k, i] * (acceleration[k] - model.gravity[k])
        spin[i] = rate[i] + state.v[b, nf + 3 + i]
        spin_rate[i] = state.alpha[b, i] + state.a[b, nf + 3 + i]
        square += spin[i] * spin[i]
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        w[i, i] = spin[i] * spin[i] - square
        w[i, j] = spin[i] * spin[j] - spin_rate[k]
        w[j, i] = spin[i] * spin[j] + spin_rate[k]
    out, bend, swing = model.geometric[b], model.bend_first[b], model.bend_moment[b]
    for i in range(nf):
        for j in range(nf):
            total = 0.0
            for k in range(3):
                total += bend[k, i, j] * y[k]
                for l in range(3):
                    total += swing[3 * k + l, i, j] * w[k, l]
            out[i, j] = total
    for m in range(model.marker_body.shape[0]):
        if model.marker_body[m] == b and model.marker_held[m]:
            second, force = model.bend_marker[m], state.reaction[m]
            for i in range(nf):
                for j in range(nf):
                    out[i, j] += second[0, i, j] * force[0] + second[1, i, j] * force[1] + second[2, i, j] * force[2]


@kernel
def deformed_moments(b, q, model, work):
    """Moments of the deformed body y = s + N_f q_f: work.moments[i] = ∫ N_i yᵀ for all but the rotation modes,

    and work.second = ∫ y yᵀ, work.mixed = ∫ y sᵀ, work.mean = ∫ y. With second-order displacements, y = s + N q +
    ½ qᵀ H q, N_i and s are those of `renew_bending`.
    """
    g, a, n = model.gyro[b], model.second[b], model.n[b]
    nf, v, x = n - 6, work.moments, model.reference_moment[b]
    for i in range(n - 3):
        for c in range(9):
            v[i, c] = x[i, c]
    for i in range(n - 3):
        for j in range(model.first[b, i], min(i + 1, nf)):
            # ∫ N_i,k N_j,l: symmetric half and skew half of the pairs (1, 2), (1, 3), (2, 3)
            e01, e10 = 0.5 * (a[3, i, j] - g[2, i, j]), 0.5 * (a[3, i, j] + g[2, i, j])
            e02, e20 = 0.5 * (a[4, i, j] + g[1, i, j]), 0.5 * (a[4, i, j] - g[1, i, j])
            e12, e21 = 0.5 * (a[5, i, j] - g[0, i, j]), 0.5 * (a[5, i, j] + g[0, i, j])
            for side in range(2):
                row, value = (i, q[j]) if side == 0 else (j, q[i])
                if side == 1 and (i == j or i >= nf):
                    continue
                v[row, 0] += a[0, i, j] * value
                v[row, 4] += a[1, i, j] * value
                v[row, 8] += a[2, i, j] * value
                v[row, 1] += (e01 if side == 0 else e10) * value
                v[row, 3] += (e10 if side == 0 else e01) * value
                v[row, 2] += (e02 if side == 0 else e20) * value
                v[row, 6] += (e20 if side == 0 else e02) * value
                v[row, 5] += (e12 if side == 0 else e21) * value
                v[row, 7] += (e21 if side == 0 else e12) * value
    for k in range(3):
        work.mean[k] = model.reference_first[b, k]
        for l in range(3):
            work.second[k, l] = model.reference_second[b, k, l]
            work.mixed[k, l] = model.reference_second[b, k, l]
    for i in range(nf):
        for k in range(3):
            work.mean[k] += q[i] * model.first_moment[b, i, k]
            for l in range(3):
                work.mixed[k, l] += q[i] * x[i, 3 * k + l]
                work.second[k, l] += q[i] * (v[i, 3 * k + l] + x[i, 3 * l + k])
    if model.bends[b]:
        # renewed shapes count H twice where the deformed body has it once
        for k in range(3):
            for i in range(nf):
                work.mean[k] -= 0.5 * q[i] * (model.first_moment[b, i, k] - model.elastic_first[b, i, k])
                for l in range(3):
                    half = 0.5 * q[i] * (x[i, 3 * k + l] - model.elastic_moment[b, i, 3 * k + l])
                    work.second[k, l] -= half
                    work.second[l, k] -= half
                    work.mixed[k, l] -= half
                    work.mixed[l, k] -= half


@kernel
def renew_rotations(b, model, state, work):
    """Make the rotation modes turn the body as it is deformed now, e_k × (s + N_f q_f), in all matrices."""
    n, q, start = model.n[b], state.q[b], model.n[b] - 3
    if model.bends[b]:
        start = 0
        renew_bending(b, q, model, work)
    deformed_moments(b, q, model, work)
    g, a, e = model.gyro[b], model.second[b], work.pair
    for k in range(3):
        l, m = (k + 1) % 3, (k + 2) % 3
        row = n - 3 + k
        for c in range(3):
            # ∫ (e_k × y) yᵀ, ∫ (e_k × y) sᵀ, ∫ e_k × y
            work.moments[row, 3 * k + c] = 0.0
            work.moments[row, 3 * l + c] = -work.second[m, c]
            work.moments[row, 3 * m + c] = work.second[l, c]
            model.reference_moment[b, row, 3 * l + c] = -work.mixed[m, c]
            model.reference_moment[b, row, 3 * m + c] = work.mixed[l, c]
        model.first_moment[b, row, l], model.first_moment[b, row, m] = -work.mean[m], work.mean[l]
    for k in range(3):
        l, m = (k + 1) % 3, (k + 2) % 3
        row = n - 3 + k
        for j in range(row + 1):
            v = work.moments[j]
            for c in range(3):
                e[k, c] = 0.0
                e[l, c] = -v[3 * c + m]
                e[m, c] = v[3 * c + l]
            a[0, row, j], a[1, row, j], a[2, row, j] = e[0, 0], e[1, 1], e[2, 2]
            a[3, row, j], a[4, row, j], a[5, row, j] = e[0, 1] + e[1, 0], e[0, 2] + e[2, 0], e[1, 2] + e[2, 1]
            g[0, row, j], g[1, row, j], g[2, row, j] = e[2, 1] - e[1, 2], e[0, 2] - e[2, 0], e[1, 0] - e[0, 1]
            mass = e[0, 0] + e[1, 1] + e[2, 2]
            model.mass_low[b, row, j], model.mass_up[b, row, j] = mass, mass
    for i in range(n - 6):
        state.deformed[b, i] = q[i]
    return factorize_envelope(start, n, model.first[b], model.mass_low[b], model.mass_up[b], model.definite[b])


@kernel
def renew_markers(b, model, state):
    """The same for the markers of the body, and M⁻¹ shapeᵀ of those that are held."""
    n = model.n[b]
    for m in range(model.marker_body.shape[0]):
        if model.marker_body[m] != b:
            continue
        shape, q = model.marker_shape[m], state.deformed[b]
        if model.bends[b]:
            for i in range(3):
                shorter, second = 0.0, model.bend_marker[m, i]
                for k in range(n - 6):
                    turn = 0.0
                    for j in range(n - 6):
                        turn += second[k, j] * q[j]
                    shape[i, k] = model.marker_linear[m, i, k] + turn
                    shorter += 0.5 * turn * q[k]
                model.marker_position[m, i] = model.marker_place[m, i] - shorter
        for i in range(3):
            total = 0.0
            for k in range(n - 6):
                total += shape[i, k] * q[k]
            model.marker_lever[m, i] = total
        for k in range(3):
            i, j = (k + 1) % 3, (k + 2) % 3
            shape[i, n - 3 + k] = -model.marker_position[m, j] - model.marker_lever[m, j]
            shape[j, n - 3 + k] = model.marker_position[m, i] + model.marker_lever[m, i]
        for i in range(model.marker_held[m]):
            column = model.mass_columns[m, i]
            for k in range(n):
                column[k] = shape[i, k]
            solve_envelope(n, model.first[b], model.mass_low[b], model.mass_up[b], column)


@kernel
def refresh(model, state, work):
    """Rotation modes of all bodies as they follow from ``state.deformed``, after a state was restored."""
    for b in range(model.n.shape[0]):
        n = model.n[b]
        for i in range(n - 6):
            work.vector[b, i] = state.q[b, i]
            state.q[b, i] = state.deformed[b, i]
        if not renew_rotations(b, model, state, work):
            return SINGULAR_BODY
        renew_markers(b, model, state)
        for i in range(n - 6):
            state.q[b, i] = work.vector[b, i]
    marker_pairs(model, model.mass_columns, model.mass_pairs)
    return OK


@kernel
def renew(b, share, model, state, work):
    """Shapes of the body as it is now deformed, at unchanged velocities; False for a singular mass matrix.

    ``share`` [s] is the weight of the accelerations at the end of the step in its velocities; zero outside of a step.
    """
    n = model.n[b]
    for i in range(n - 6):
        work.vector[b, i] = state.q[b, i] - state.deformed[b, i]
    take_out(b, state.v[b, n - 3 : n], share, model, state, work)
    if not renew_rotations(b, model, state, work):
        return False
    renew_markers(b, model, state)
    return True


# ---- one step ------------------------------------------------------------------------------------------------------


@kernel
def accelerations(value, model, state, work):
    """Accelerations and multipliers of eq. (6) with the constraints differentiated twice, for the present state."""
    if model.row_kind.shape[0] > 0:
        constraint_rows(model, state, state.q, state.v, work)
        if not factorize_constraints(model, work):
            return SINGULAR_CONSTRAINTS
    accelerate(value, model, state, work)
    return OK


@kernel
def factorize_constraints(model, work):
    """Factors of B M⁻¹ Bᵀ for the directions of the rows as they were evaluated last; False when it is singular."""
    schur_complement(model, model.mass_pairs, work, work.schur)
    free_hinges(model, work, 1.0)
    return factorize(work.schur, work.order)


@kernel
def accelerate(value, model, state, work):
    """The accelerations, with rows and factors of the present state at hand."""
    n_row = model.row_kind.shape[0]
    for b in range(model.n.shape[0]):
        inner_forces(b, model, state, state.q[b], state.v[b], state.a[b])
    add_loads(value, model, state, state.q, work, state.a)
    for b in range(model.n.shape[0]):
        solve_envelope(model.n[b], model.first[b], model.mass_low[b], model.mass_up[b], state.a[b])
    if n_row == 0:
        return
    for r in range(n_row):
        work.multiplier[r] = work.row_bias[r]
    rows_of(model, state.a, work, work.multiplier)
    give_torques(model, work, True)
    solve_factorized(work.schur, work.order, work.multiplier)
    for r in range(n_row):
        state.multiplier[r] = work.multiplier[r]
    keep_reactions(model, state, work)
    subtract_reactions(model, model.mass_columns, state.multiplier, work, state.a)


@kernel
def hold_positions(model, state, work, n_passes):
    """Remove what is left of the constraint residual, along S⁻¹ Bᵀ of the step just taken.

    Directions change little in it: the factors of the first pass serve for all.
    """
    n_row = model.row_kind.shape[0]
    for i in range(n_passes):
        constraint_rows(model, state, state.q, state.v, work)
        worst = 0.0
        for r in range(n_row):
            work.multiplier[r] = 0.0
            if model.row_kind[r] != TORQUE:
                work.multiplier[r] = work.row_value[r]
                worst = max(worst, abs(work.row_value[r]))
        if worst < 1e-12:
            return OK
        if i == 0:
            schur_complement(model, work.pairs, work, work.schur)
            free_hinges(model, work, 0.0)
            if not factorize(work.schur, work.order):
                return SINGULAR_CONSTRAINTS
        solve_factorized(work.schur, work.order, work.multiplier)
        subtract_reactions(model, work.columns, work.multiplier, work, state.q)
    constraint_rows(model, state, state.q, state.v, work)
    return OK


@kernel
def hold_rates(model, state, work):
    """Project the velocities on Φ̇ = 0 in the metric of the mass matrix, with rows and factors of the state at hand."""
    n_row = model.row_kind.shape[0]
    for r in range(n_row):
        work.multiplier[r] = work.row_rate[r]
    give_torques(model, work, False)
    solve_factorized(work.schur, work.order, work.multiplier)
    subtract_reactions(model, model.mass_columns, work.multiplier, work, state.v)


@kernel
def hold_velocities(model, state, work):
    """Project the velocities on Φ̇ = 0 in the metric of the mass matrix."""
    constraint_rows(model, state, state.q, state.v, work)
    if not factorize_constraints(model, work):
        return SINGULAR_CONSTRAINTS
    hold_rates(model, state, work)
    return OK


@kernel
def factorize_step(h, model, state, work):
    """Matrices of the step at its end, their factors and S⁻¹ shapeᵀ of the held markers."""
    for b in range(model.n.shape[0]):
        if model.bends[b]:
            geometric_stiffness(b, model, state, work)
        step_matrix(b, h, model, state, work.low[b], work.up[b])
        if not factorize_envelope(0, model.n[b], model.first[b], work.low[b], work.up[b], model.definite[b]):
            return SINGULAR_BODY
    for m in range(model.marker_body.shape[0]):
        b = model.marker_body[m]
        for i in range(model.marker_held[m]):
            column = work.columns[m, i]
            for k in range(model.n[b]):
                column[k] = model.marker_shape[m, i, k]
            solve_envelope(model.n[b], model.first[b], work.low[b], work.up[b], column)
    marker_pairs(model, work.columns, work.pairs)
    return OK


@kernel
def spring_rows(h, model, state, work):
    """The equations of hinges with springs and dampers in the system B S⁻¹ Bᵀ λ = rhs of a step.

    At the end of the step, angle θ, rate and acceleration being linear in the coordinates x about the iterate y, the
    torque −λ = k (θ_r − θ) + c (θ̇_r − θ̇) + τ − I θ̈ is τ₀ − κ B (x − y) with κ = k + c γ/(β h) + I (1−αm)/((1−αf) β h²)
    and τ₀ the torque at y and its rates by the rule of `step_solve`; x = x₀ − S⁻¹ Bᵀ λ gives

        (κ B S⁻¹ Bᵀ + 1) λ = κ B (x₀ − y) − τ₀,

    where work.multiplier holds B (x₀ − y). The bias of θ̈ is that of the expected rates, ``work.ahead``. A stiff
    spring thus limits no step.
    """
    n_row, some = model.row_kind.shape[0], False
    beta, gamma, alpha_m, alpha_f = model.rule
    share = (1.0 - alpha_m) / (1.0 - alpha_f)
    second = share / (beta * h * h)
    rate, kept, pushed = gamma / (beta * h), 1.0 - gamma / beta, h * (1.0 - 0.5 * gamma / beta)
    for r in range(n_row):
        work.row_change[r] = 0.0
        some = some or model.row_kind[r] == TORQUE
    if not some:
        return
    for b in range(model.n.shape[0]):
        for k in range(model.n[b]):
            start = state.a[b, k] + state.lead[b, k]
            end = rate * (work.next[b, k] - state.q[b, k]) + kept * state.v[b, k] + pushed * start
            work.vector[b, k] = end - work.ahead[b, k]
    rows_of(model, work.vector, work, work.row_change)
    for b in range(model.n.shape[0]):
        for k in range(model.n[b]):
            start = state.a[b, k] + state.lead[b, k]
            end = second * (work.next[b, k] - state.q[b, k] - h * state.v[b, k]) - share * (0.5 / beta - 1.0) * start
            work.vector[b, k] = end + (alpha_m * start - alpha_f * state.a[b, k]) / (1.0 - alpha_f)
    rows_of(model, work.vector, work, work.row_bias)
    for r in range(n_row):
        if model.row_kind[r] != TORQUE:
            continue
        work.row_rate[r] += work.row_change[r]
        inertia, scale = model.row_inertia[r], work.schur[r, r]
        stiffness = model.row_stiffness[r] + rate * model.row_damping[r] + second * inertia
        torque = row_torque(r, model, work) - inertia * work.row_bias[r]
        work.multiplier[r] = scale * (stiffness * work.multiplier[r] - torque)
        for s in range(n_row):
            work.schur[r, s] *= scale * stiffness
        work.schur[r, r] += scale


@kernel
def step_solve(h, value, n_iterations, model, state, work):
    """Solve eq. (6) for the increment of q over the step; work.next ends as q at its end.

    With a = q̈ + lead at the start, the end of the step has, for an increment x of q,

        q̇ = γ/(βh) x + (1 − γ/β) q̇₀ + h (1 − γ/2β) a,
        q̈ = (1−αm)/(1−αf) (x/(βh²) − q̇₀/(βh) − (1/2β − 1) a) + (αm a − αf q̈₀)/(1−αf).

    The matrices do not depend on q: an iteration renews only loads and constraint directions. ``work.ahead`` holds the
    rates that are expected at the end, with which rotors feel the turn of the axes of their hinges.
    """
    n_b, n_row = model.n.shape[0], model.row_kind.shape[0]
    beta, gamma, alpha_m, alpha_f = model.rule
    share = (1.0 - alpha_m) / (1.0 - alpha_f)
    for b in range(n_b):
        n, vector, base = model.n[b], work.vector[b], work.base[b]
        for k in range(n):
            start = state.a[b, k] + state.lead[b, k]
            vector[k] = (1.0 - gamma / beta) * state.v[b, k] + h * (1.0 - 0.5 * gamma / beta) * start
            work.next[b, k] = state.q[b, k]
            work.ahead[b, k] = state.v[b, k] + h * start
        inner_forces(b, model, state, state.q[b], vector, base)
        for k in range(n):
            start = state.a[b, k] + state.lead[b, k]
            vector[k] = share * (1.0 / (beta * h) * state.v[b, k] + (0.5 / beta - 1.0) * start)
            vector[k] -= (alpha_m * start - alpha_f * state.a[b, k]) / (1.0 - alpha_f)
        mass_product(b, model, vector, base)
    # Not the loop of `implicit_advance`: increments and multipliers solve a linear system whose matrices no iterate
    # changes, a fixed number of times and without a test of convergence, while loads and row directions are renewed.
    for _ in range(n_iterations):
        for b in range(n_b):
            for k in range(model.n[b]):
                work.rhs[b, k] = work.base[b, k]
        add_loads(value, model, state, work.next, work, work.rhs)
        for b in range(n_b):
            solve_envelope(model.n[b], model.first[b], work.low[b], work.up[b], work.rhs[b])
        if n_row > 0:
            constraint_rows(model, state, work.next, work.ahead, work)
            for b in range(n_b):
                for k in range(model.n[b]):
                    work.vector[b, k] = state.q[b, k] + work.rhs[b, k] - work.next[b, k]
            for r in range(n_row):
                work.multiplier[r] = 0.0 if model.row_kind[r] == TORQUE else work.row_value[r]
            rows_of(model, work.vector, work, work.multiplier)
            schur_complement(model, work.pairs, work, work.schur)
            spring_rows(h, model, state, work)
            if not factorize(work.schur, work.order):
                return SINGULAR_CONSTRAINTS
            solve_factorized(work.schur, work.order, work.multiplier)
            subtract_reactions(model, work.columns, work.multiplier, work, work.rhs)
        for b in range(n_b):
            for k in range(model.n[b]):
                work.next[b, k] = state.q[b, k] + work.rhs[b, k]
    return OK


@kernel
def step(h, value, n_iterations, threshold, model, state, work):
    """Advance all bodies by h under the loads (n_loads, 6) at the end of the step; returns a code."""
    n_b = model.n.shape[0]
    beta, gamma, alpha_m, alpha_f = model.rule
    for b in range(n_b):
        predict_frame(b, h, model, state, work)
    code = factorize_step(h, model, state, work)
    if code == OK:
        code = step_solve(h, value, n_iterations, model, state, work)
    if code != OK:
        return code
    total, share = 0.0, gamma * h * (1.0 - alpha_f) / (1.0 - alpha_m)
    for b in range(n_b):
        for k in range(model.n[b]):
            change, rate, before = work.next[b, k] - state.q[b, k], state.v[b, k], state.a[b, k]
            start = before + state.lead[b, k]
            end = 1.0 / (beta * h * h) * change - 1.0 / (beta * h) * rate - (0.5 / beta - 1.0) * start
            state.a[b, k] = ((1.0 - alpha_m) * end + alpha_m * start - alpha_f * before) / (1.0 - alpha_f)
            state.lead[b, k] = end - state.a[b, k]
            state.v[b, k] = gamma / (beta * h) * change + (1.0 - gamma / beta) * rate
            state.v[b, k] += h * (1.0 - 0.5 * gamma / beta) * start
            state.q[b, k] = work.next[b, k]
            total += abs(work.next[b, k])
    if not math.isfinite(total):
        return DIVERGED
    for b in range(n_b):
        state.age[b] += h
        if model.deformed_modes and not renew(b, share, model, state, work):
            return SINGULAR_BODY
        if needs_update(b, threshold, model, state):
            if model.prediction == PRINTED:
                update_printed(b, model, state, work)
            else:
                update_frame(b, model, state, work)
            state.age[b] = 0.0
            state.n_updates[b] += 1
    if model.row_kind.shape[0] > 0:
        if model.deformed_modes:
            marker_pairs(model, model.mass_columns, model.mass_pairs)
        code = hold_positions(model, state, work, 3)
        if code != OK:
            return code
        if not factorize_constraints(model, work):
            return SINGULAR_CONSTRAINTS
        hold_rates(model, state, work)
        constraint_rows(model, state, state.q, state.v, work)
    accelerate(value, model, state, work)
    for r in range(model.row_kind.shape[0]):
        if model.row_kind[r] == TORQUE:
            state.angle[model.row_spring[r]] = work.row_value[r]
    return OK


@kernel
def advance(h, values, drives, springs, n_iterations, threshold, model, state, work, done):
    """Take one step for each row of values (n_steps, n_loads, 6); done[0] counts the steps that succeeded.

    drives (n_steps, n_drives, 3) are angles, rates and accelerations at the ends of the steps, springs (n_steps,
    n_springs, 3) the references of springs and dampers and the torques beside them.
    """
    for i in range(values.shape[0]):
        for d in range(drives.shape[1]):
            for k in range(3):
                work.drive[d, k] = drives[i, d, k]
        for d in range(springs.shape[1]):
            for k in range(3):
                work.spring[d, k] = springs[i, d, k]
        code = step(h, values[i], n_iterations, threshold, model, state, work)
        if code != OK:
            return code
        done[0] = i + 1
    return OK
