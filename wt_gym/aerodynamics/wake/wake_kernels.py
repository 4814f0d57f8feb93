"""The free wake: convection of material rows, ageing, thinning, and which rows are refreshed when."""

import numpy as np

from wt_gym.aerodynamics.induction.induction_kernels import direct_induction
from wt_gym.aerodynamics.induction.simd_kernels import WIDTH
from wt_gym.aerodynamics.wake.far_wake_kernels import far_wake_velocity
from wt_gym.base.compiled import kernel


@kernel(fastmath=False, inline="always")
def convect(a, dt, ratio):
    """Move all rows from t to t + dt with the second-order Adams-Bashforth scheme, in place.

    Row 0, the air that passes the shedding edge now, has no history and takes an Euler step. ``ratio`` is dt over the
    step before, 0 at the first step. ``a.history`` receives the velocity at t.
    """
    for k in range(a.n_rows[0] + 1):
        weight = 0.5 * ratio if k > 0 else 0.0
        for b in range(a.wake.shape[1]):
            for j in range(a.wake.shape[2]):
                for c in range(3):
                    velocity = a.wind[k, b, j, c] + a.induced[k, b, j, c]
                    a.wake[k, b, j, c] += dt * ((1.0 + weight) * velocity - weight * a.history[k, b, j, c])
                    a.history[k, b, j, c] = velocity


@kernel(fastmath=False, inline="always")
def age_rows(a, o, dt):
    """Make room for a new row behind the shedding edge: every row becomes one older; returns the number of rows.

    The row that leaves the first ``full_rows`` stays only if its number is a multiple of ``coarse_stride``; else its
    two rings become one with their time-weighted mean circulation. So with ``sparse_from`` and ``sparse_stride``. Row 1
    is then the air that left the edge. Induced velocities of the first ``full_rows`` stay where they are, see
    `turn_induced`; those of older rows belong to the air.
    """
    wake, wake_gamma, age, shed = a.wake, a.wake_gamma, a.age, a.shed
    n_max, n_blade, n_node = wake.shape[0] - 1, wake.shape[1], wake.shape[2]
    n_rows = a.n_rows[0]
    for k in range(1, n_rows + 1):
        age[k] += dt
    k = 0
    if o.coarse_stride > 1 and n_rows > o.full_rows and shed[o.full_rows] % o.coarse_stride != 0:
        k = o.full_rows
    elif o.sparse_stride > 1 and n_rows > o.sparse_from and shed[o.sparse_from] % o.sparse_stride != 0:
        k = o.sparse_from
    if k > 0:
        behind, ahead = age[k + 1] - age[k], age[k] - age[k - 1]
        share = behind / (behind + ahead)
        for b in range(n_blade):
            for j in range(n_node - 1):
                wake_gamma[k, b, j] = share * wake_gamma[k, b, j] + (1.0 - share) * wake_gamma[k - 1, b, j]
            for j in range(n_node):
                a.volume[k + 1, b, j, 0] += a.volume[k, b, j, 0]
        last = k - 1
    else:
        if n_rows < n_max:
            n_rows += 1
            for b in range(n_blade):
                for j in range(n_node):
                    for c in range(3):
                        a.induced[n_rows, b, j, c] = a.induced[n_rows - 1, b, j, c]
        last = n_rows - 1
    for k in range(last, -1, -1):
        for b in range(n_blade):
            for j in range(n_node):
                for c in range(3):
                    wake[k + 1, b, j, c] = wake[k, b, j, c]
                    a.history[k + 1, b, j, c] = a.history[k, b, j, c]
                    a.wind[k + 1, b, j, c] = a.wind[k, b, j, c]
                    if k >= o.full_rows:
                        a.induced[k + 1, b, j, c] = a.induced[k, b, j, c]
                a.volume[k + 1, b, j, 0] = a.volume[k, b, j, 0]
                a.volume[k + 1, b, j, 1] = a.volume[k, b, j, 1]
        age[k + 1] = age[k]
        shed[k + 1] = shed[k]
    for k in range(min(last, wake_gamma.shape[0] - 1), 0, -1):
        for b in range(n_blade):
            for j in range(n_node - 1):
                wake_gamma[k, b, j] = wake_gamma[k - 1, b, j]
    age[0] = 0.0
    age[1] = o.shed_fraction * dt
    shed[1] = a.n_steps[0]
    return n_rows


@kernel(fastmath=False)
def shedding_edge(nodes, shed_nodes, edge):
    """Where the wake leaves the blades (n_blade, n_edge + 1, 3): trailing edge, then the ring nodes at the tip.

    The trailing edge lies a quarter panel chord before the last ring nodes.
    """
    n_blade, n_row, n_bound, _ = nodes.shape
    for b in range(n_blade):
        for j in range(shed_nodes.shape[0]):
            row, column = shed_nodes[j] // n_bound, shed_nodes[j] % n_bound
            for c in range(3):
                if row == n_row - 1:
                    edge[b, j, c] = 0.25 * nodes[b, row - 1, column, c] + 0.75 * nodes[b, row, column, c]
                else:
                    edge[b, j, c] = nodes[b, row, column, c]


@kernel(fastmath=False)
def place_newest_row(nodes, shed_nodes, free_edge, shed_fraction, wake):
    """Wake row 1 on the way from the shedding edge, row 0, to the air that left it one step ago.

    Counting from the true trailing edge, not from the end of the last ring, matters: with a quarter of the way and a
    path of one panel chord the wake continues the quarter points of the panels, and Wagner's lift comes out exact.

    Where the flow is reversed the newest row lies as far behind the edge as it would lie before it. Over the blade it
    would take away what the bound rings induce there, and the boundary condition would have no solution when it comes
    to lie on their control points.
    """
    n_row, n_bound = nodes.shape[1], nodes.shape[2]
    for b in range(wake.shape[1]):
        for j in range(wake.shape[2]):
            row, column = shed_nodes[j] // n_bound, shed_nodes[j] % n_bound
            before = nodes[b, row - 1, column] if row == n_row - 1 else nodes[b, row, column - 1]
            off, size2 = 0.0, 0.0  # along the direction in which the edge points
            for c in range(3):
                outward = nodes[b, row, column, c] - before[c]
                off += outward * (free_edge[b, j, c] - wake[0, b, j, c])
                size2 += outward * outward
            back = 2.0 * off / size2 if off < 0.0 else 0.0  # a tip without chord has no direction
            for c in range(3):
                way = free_edge[b, j, c] - wake[0, b, j, c] - back * (nodes[b, row, column, c] - before[c])
                wake[1, b, j, c] = wake[0, b, j, c] + shed_fraction * way


@kernel(fastmath=False)
def pad_targets(w, n_target, o, origin):
    """Repeat the first target up to a whole number of lanes and write the mirror images; returns the padded number.

    ``w.targets`` and ``w.velocity`` (2, 3, n) hold targets with their mirror images when there is a ground: the
    velocity of a mirrored vortex is the mirrored velocity at the mirrored point.
    """
    n_padded = (n_target + WIDTH - 1) // WIDTH * WIDTH
    for c in range(3):
        for i in range(n_target, n_padded):
            w.targets[0, c, i] = w.targets[0, c, 0]
    if o.has_ground:
        for c in range(3):
            for i in range(n_padded):
                w.targets[1, c, i] = w.targets[0, c, i]
        for i in range(n_padded):
            w.targets[1, 2, i] = 2.0 * (o.ground - origin[2]) - w.targets[1, 2, i]
    return n_padded


@kernel(fastmath=False, inline="always")
def wake_sheets(a, o, w, first):
    """Sheets of the wake from row ``first`` on: the rows with all their nodes, and the sparse part."""
    n_rows = a.n_rows[0]
    n_dense = min(n_rows, o.sparse_from)
    return w.wake_sheet[first : n_dense + 1], w.sparse_sheet[: n_rows - n_dense + (n_rows > n_dense)]


@kernel(fastmath=False, separate=True)
def induced_at(bound_sheet, wake_sheet, sparse_sheet, a, n_target, w, o, table):
    """Velocity of sheets and far wake at the first ``n_target`` targets (float32, relative to the origin)."""
    n_padded = pad_targets(w, n_target, o, a.origin)
    # Rows are stored with a fixed length, the kernel needs its lanes without gaps.
    packed_t = w.scratch[-6 * n_padded : -3 * n_padded].reshape((3, n_padded))
    packed_v = w.scratch[-3 * n_padded :].reshape((3, n_padded))
    for image in range(2 if o.has_ground else 1):
        for c in range(3):
            for i in range(n_padded):
                packed_t[c, i] = w.targets[image, c, i]
                packed_v[c, i] = 0.0
        direct_induction(bound_sheet, packed_t, packed_v, 0, n_padded, w.scratch)
        direct_induction(wake_sheet, packed_t, packed_v, 0, n_padded, w.scratch)
        direct_induction(sparse_sheet, packed_t, packed_v, 0, n_padded, w.scratch)
        if a.far[0] > 0.0:
            # the lanes of the sheets' induction are free now
            far_wake_velocity(a, table, packed_t, packed_v, w.scratch[: 8 * n_padded].reshape((8, n_padded)))
        for c in range(3):
            for i in range(n_target):
                w.velocity[image, c, i] = packed_v[c, i]
    fold_images(o, w, n_target)


@kernel(fastmath=False)
def rows_for_wind(wake, shed, n_rows, n_steps, stride, rows, points):
    """Rows that ask for their wind now, by the time since they were shed, and their nodes; returns their number.

    Row 0, where the wake is shed, asks in every step; all rows do with ``stride`` 1, and in the first step.
    """
    count, step = 0, n_steps[0]
    for k in range(n_rows[0] + 1):
        if k > 0 and step > 0 and (step - shed[k]) % stride != 0:
            continue
        rows[count] = k
        for b in range(wake.shape[1]):
            for j in range(wake.shape[2]):
                for c in range(3):
                    points[count, b, j, c] = wake[k, b, j, c]
        count += 1
    return count


@kernel(fastmath=False)
def store_wind(velocity, rows, wind):
    """Velocities (count, n_blade, n_node, 3) into their rows of the wind; whether all of them are finite."""
    total = 0.0
    for m in range(velocity.shape[0]):
        for b in range(velocity.shape[1]):
            for j in range(velocity.shape[2]):
                for c in range(3):
                    wind[rows[m], b, j, c] = velocity[m, b, j, c]
                    total += velocity[m, b, j, c]
    return total - total == 0.0


@kernel
def mean_induced(a, n_row):
    """Root mean square of the induced velocity at the first rows of the wake [m/s]."""
    total = 0.0
    for k in range(n_row):
        for b in range(a.induced.shape[1]):
            for j in range(a.induced.shape[2]):
                for c in range(3):
                    total += a.induced[k, b, j, c] * a.induced[k, b, j, c]
    return (total / (n_row * a.induced.shape[1] * a.induced.shape[2])) ** 0.5


@kernel(fastmath=False)
def velocity_behind_disc(wake, induced, age, n_rows, center, axis, spin, mean):
    """Mean induced velocity close behind the disc of a rotor, into ``mean`` (3,) [m/s]; zero without a wake.

    The rows that a blade has left since the one before it passed cover the disc once. Over them the near fields of the
    bound vortices, which slow the air behind a blade and speed it up before the next one, nearly cancel. The velocity
    of the wake at the blades themselves (`AeroArrays.wake_flow`) does not measure that: it lacks the newest ring, so
    that the first shed vortex stands alone behind each blade and drives air forwards there. A rotor that stands has all
    rows.

    Parameters
    ----------
    wake, induced : (n_max + 1, n_blade, n_edge + 1, 3)
        Positions [m] and induced velocities [m/s] of the rows, the shedding edge first.
    age : (n_max + 1,)
        Of the rows [s].
    n_rows : int64 (1,)
    center, axis : (3,)
        Hub [m] and unit direction of the shaft.
    spin : float
        Angular velocity about it [rad/s].
    """
    n_blade, last = wake.shape[1], n_rows[0]
    passing = 2.0 * np.pi / (n_blade * max(abs(spin), 1e-9))
    total = 0.0
    for c in range(3):
        mean[c] = 0.0
    for b in range(n_blade):
        inner = 0.0
        for j in range(wake.shape[2]):
            along, outer = 0.0, 0.0
            for c in range(3):
                off = wake[0, b, j, c] - center[c]
                along += off * axis[c]
                outer += off * off
            outer -= along * along
            if j > 0:
                for k in range(last):
                    duration = min(age[k + 1], passing) - age[k]
                    if duration <= 0.0:
                        break
                    weight = duration * (outer - inner)
                    total += weight
                    for c in range(3):
                        mean[c] += 0.25 * weight * (
                            induced[k, b, j - 1, c] + induced[k, b, j, c]
                            + induced[k + 1, b, j - 1, c] + induced[k + 1, b, j, c]
                        )  # fmt: skip
            inner = outer
    if total > 0.0:
        for c in range(3):
            mean[c] /= total


@kernel(fastmath=False)
def fold_images(o, w, n_target):
    """Add what the mirrored vortices do to the velocity of the targets."""
    if o.has_ground:
        for i in range(n_target):
            w.velocity[0, 0, i] += w.velocity[1, 0, i]
            w.velocity[0, 1, i] += w.velocity[1, 1, i]
            w.velocity[0, 2, i] -= w.velocity[1, 2, i]


@kernel(fastmath=False, inline="always")
def turn_induced(a, o):
    """Turn the induced velocities of the first ``full_rows`` with the blades.

    The flow behind a rotor is nearly steady as the blades see it: the air of row k has now the velocity that the air
    of row k had a step ago, turned with the blade. So velocities belong to rows, not to the air in them, and one that
    is not recomputed in every step stays right in steady operation. Rows further apart than a step are other places
    from step to step: there the velocity belongs to the air and changes only as slowly as the air moves downstream.
    The frame of a blade is made of the directions from its first ring node to the tip and to the trailing edge.
    """
    n_row, n_node = a.nodes.shape[1], a.nodes.shape[2]
    for b in range(a.nodes.shape[0]):
        f = a.frame[b]
        root, tip, aft = a.nodes[b, 0, 0], a.nodes[b, 0, n_node - 1], a.nodes[b, n_row - 1, 0]
        sx, sy, sz = tip[0] - root[0], tip[1] - root[1], tip[2] - root[2]
        size = (sx * sx + sy * sy + sz * sz) ** 0.5
        sx, sy, sz = sx / size, sy / size, sz / size
        cx, cy, cz = aft[0] - root[0], aft[1] - root[1], aft[2] - root[2]
        along = cx * sx + cy * sy + cz * sz
        cx, cy, cz = cx - along * sx, cy - along * sy, cz - along * sz
        size = (cx * cx + cy * cy + cz * cz) ** 0.5
        cx, cy, cz = cx / size, cy / size, cz / size
        nx, ny, nz = sy * cz - sz * cy, sz * cx - sx * cz, sx * cy - sy * cx
        if f[0, 0] != 0.0 or f[0, 1] != 0.0 or f[0, 2] != 0.0:
            for k in range(min(a.n_rows[0], o.full_rows) + 1):
                for j in range(a.induced.shape[2]):
                    v = a.induced[k, b, j]
                    p = v[0] * f[0, 0] + v[1] * f[0, 1] + v[2] * f[0, 2]
                    q = v[0] * f[1, 0] + v[1] * f[1, 1] + v[2] * f[1, 2]
                    r = v[0] * f[2, 0] + v[1] * f[2, 1] + v[2] * f[2, 2]
                    v[0] = p * sx + q * cx + r * nx
                    v[1] = p * sy + q * cy + r * ny
                    v[2] = p * sz + q * cz + r * nz
        f[0, 0], f[0, 1], f[0, 2] = sx, sy, sz
        f[1, 0], f[1, 1], f[1, 2] = cx, cy, cz
        f[2, 0], f[2, 1], f[2, 2] = nx, ny, nz


@kernel(fastmath=False, inline="always")
def steps_between(a, o, k):
    """Steps from one computation of the induced velocity of row k to the next."""
    if k <= o.fresh_rows:
        return 1
    return o.refresh_stride if 3 * k >= a.wake.shape[0] else max(o.refresh_stride // 4, 1)


@kernel(fastmath=False, inline="always")
def choose_rows(a, o, rows, all_rows):
    """Rows whose induced velocity is to be computed now, the newest always and older ones in turn; their number.

    The first third of the rows, where the wake slows down and answers the blades, has its turn four times as often. The
    rows at the joint of dense and sparse part keep the velocity with which they came: spanwise segments lie there that
    close the merged rings, which stand for nothing in the flow and move the nodes beside them by meters per second.
    """
    count = 0
    for k in range(a.n_rows[0] + 1):
        turn = k + a.n_steps[0] if k <= o.full_rows else a.n_steps[0] - a.shed[k]
        at_joint = o.sparse_from <= k <= o.sparse_from + 1
        if all_rows or (turn % steps_between(a, o, k) == 0 and not at_joint):
            rows[count] = k
            count += 1
    return count


@kernel(fastmath=False, inline="always")
def gather_targets(p, o, a, w):
    """Gather the targets of the rows whose turn it is, corners of the sheets and the shedding edge; their number."""
    n = 0
    for m in range(w.n_turn[0]):
        k = w.rows[m]
        for b in range(a.wake.shape[1]):
            if k > o.sparse_from:
                for i in range(p.sparse_nodes.shape[0]):
                    for c in range(3):
                        w.targets[0, c, n] = a.wake[k, b, p.sparse_nodes[i], c] - a.origin[c]
                    n += 1
                continue
            for j in range(a.wake.shape[2]):
                for c in range(3):
                    w.targets[0, c, n] = a.wake[k, b, j, c] - a.origin[c]
                n += 1
    return n


@kernel(fastmath=False, inline="always")
def scatter_velocities(p, o, a, w):
    """Velocities of the targets back to the rows; nodes between those of the sparse part get means of these."""
    n = 0
    for m in range(w.n_turn[0]):
        k = w.rows[m]
        for b in range(a.wake.shape[1]):
            induced = a.induced[k, b]
            if k > o.sparse_from:
                last = 0
                for i in range(p.sparse_nodes.shape[0]):
                    j = p.sparse_nodes[i]
                    for c in range(3):
                        induced[j, c] = w.velocity[0, c, n]
                    for between in range(last + 1, j):
                        share = p.sparse_place[between]
                        for c in range(3):
                            induced[between, c] = (1.0 - share) * induced[last, c] + share * induced[j, c]
                    last = j
                    n += 1
                continue
            for j in range(a.wake.shape[2]):
                for c in range(3):
                    induced[j, c] = w.velocity[0, c, n]
                n += 1
