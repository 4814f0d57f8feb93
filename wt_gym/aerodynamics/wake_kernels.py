"""The free wake: convection of material rows, ageing, thinning, and which rows are refreshed when."""

from wt_gym.aerodynamics.far_wake_kernels import far_wake_velocity
from wt_gym.aerodynamics.induction_kernels import lane_count, sheet_induction
from wt_gym.compiled import kernel


@kernel(fastmath=False, inline="always")
def convect(wake, induced, history, wind, n_rows, dt, ratio):
    """Move rows 0..n_rows from t to t + dt with the second-order Adams-Bashforth scheme, in place.

    Row 0, the air that passes the trailing edge now, has no history and takes an Euler step. ``ratio`` is dt over the
    step before, 0 at the first step. ``history`` receives the velocity at t.
    """
    _, n_blade, n_node, _ = wake.shape
    for k in range(n_rows + 1):
        weight = 0.5 * ratio if k > 0 else 0.0
        for b in range(n_blade):
            for j in range(n_node):
                for c in range(3):
                    velocity = wind[k, b, j, c] + induced[k, b, j, c]
                    wake[k, b, j, c] += dt * ((1.0 + weight) * velocity - weight * history[k, b, j, c])
                    history[k, b, j, c] = velocity


@kernel(fastmath=False, inline="always")
def age_rows(wake, induced, history, wake_gamma, age, shed, n_rows, dt, full_rows, stride, step, shed_fraction):
    """Make room for a new row behind the trailing edge: every row becomes one older; returns the number of rows.

    The row that leaves the first ``full_rows`` stays only if its number is a multiple of ``stride``; else its two
    rings become one with their time-weighted mean circulation. Row 1 is then the air that left the trailing edge.
    """
    n_max = wake.shape[0] - 1
    for k in range(1, n_rows + 1):
        age[k] += dt
    last = n_rows
    if stride > 1 and n_rows > full_rows and shed[full_rows] % stride != 0:
        k = full_rows
        behind, ahead = age[k + 1] - age[k], age[k] - age[k - 1]
        share = behind / (behind + ahead)
        for b in range(wake_gamma.shape[1]):
            for j in range(wake_gamma.shape[2]):
                wake_gamma[k, b, j] = share * wake_gamma[k, b, j] + (1.0 - share) * wake_gamma[k - 1, b, j]
        last = k - 1
    else:
        n_rows = min(n_rows + 1, n_max)
        last = n_rows - 1
    for k in range(last, -1, -1):
        for b in range(wake.shape[1]):
            for j in range(wake.shape[2]):
                for c in range(3):
                    wake[k + 1, b, j, c] = wake[k, b, j, c]
                    induced[k + 1, b, j, c] = induced[k, b, j, c]
                    history[k + 1, b, j, c] = history[k, b, j, c]
        age[k + 1] = age[k]
        shed[k + 1] = shed[k]
    for k in range(min(last, wake_gamma.shape[0] - 1), 0, -1):
        for b in range(wake_gamma.shape[1]):
            for j in range(wake_gamma.shape[2]):
                wake_gamma[k, b, j] = wake_gamma[k - 1, b, j]
    age[0] = 0.0
    age[1] = shed_fraction * dt
    shed[1] = step
    return n_rows


@kernel(fastmath=False)
def trailing_edge(nodes, edge):
    """Trailing edge (n_blade, n_node, 3): a quarter panel chord before the last ring nodes."""
    n_blade, n_row, n_node, _ = nodes.shape
    for b in range(n_blade):
        for j in range(n_node):
            for c in range(3):
                edge[b, j, c] = 0.25 * nodes[b, n_row - 2, j, c] + 0.75 * nodes[b, n_row - 1, j, c]


@kernel(fastmath=False)
def place_newest_row(free_edge, shed_fraction, wake):
    """Wake row 1 on the way from the trailing edge, row 0, to the air that left it one step ago.

    Counting from the true trailing edge, not from the end of the last ring, matters: with a quarter of the way and a
    path of one panel chord the wake continues the quarter points of the panels, and Wagner's lift comes out exact.
    """
    for b in range(wake.shape[1]):
        for j in range(wake.shape[2]):
            for c in range(3):
                wake[1, b, j, c] = wake[0, b, j, c] + shed_fraction * (free_edge[b, j, c] - wake[0, b, j, c])


@kernel(fastmath=False)
def induced_at(sheet, n_target, targets, velocity, scratch, origin, ground, has_ground, far, table):
    """Velocity of sheet rows and far wake at the first ``n_target`` targets (float32, relative to the origin).

    ``targets`` and ``velocity`` (2, 3, n) hold targets with their mirror images when there is a ground: the velocity
    of a mirrored vortex is the mirrored velocity at the mirrored point.
    """
    n_lane = lane_count(n_target)
    n_padded = (n_target + n_lane - 1) // n_lane * n_lane
    for image in range(2 if has_ground else 1):
        t = targets[image]
        v = velocity[image]
        for c in range(3):
            for i in range(n_target):
                t[c, i] = targets[0, c, i]
            for i in range(n_target, n_padded):
                t[c, i] = t[c, 0]
        if image == 1:
            for i in range(n_target):
                t[2, i] = 2.0 * (ground - origin[2]) - t[2, i]
        # Rows are stored with a fixed length, the kernel wants its lanes without gaps.
        packed_t = scratch[-6 * n_padded : -3 * n_padded].reshape((3, n_padded))
        packed_v = scratch[-3 * n_padded :].reshape((3, n_padded))
        for c in range(3):
            for i in range(n_padded):
                packed_t[c, i] = t[c, i]
                packed_v[c, i] = 0.0
        sheet_induction(sheet, packed_t, packed_v, scratch)
        if far[0] > 0.0:
            far_wake_velocity(far, table, packed_t, packed_v, n_target)
        for c in range(3):
            for i in range(n_target):
                v[c, i] = packed_v[c, i]
    if has_ground:
        for i in range(n_target):
            velocity[0, 0, i] += velocity[1, 0, i]
            velocity[0, 1, i] += velocity[1, 1, i]
            velocity[0, 2, i] -= velocity[1, 2, i]


@kernel(fastmath=False, inline="always")
def refresh_induced(sheet, n_chord, n_rows, wake, induced, shed, step, fresh_rows, stride, rows, targets, velocity,
                    scratch, origin, ground, has_ground, far, table):  # fmt: skip
    """Compute the induced velocity of the wake rows whose turn it is; returns how many rows that were."""
    _, n_blade, n_node, _ = wake.shape
    count = 0
    for k in range(n_rows + 1):
        if k <= fresh_rows or (shed[k] + step) % stride == 0:
            rows[count] = k
            count += 1
    n_target = count * n_blade * n_node
    n = 0
    for m in range(count):
        for b in range(n_blade):
            for j in range(n_node):
                for c in range(3):
                    targets[0, c, n] = wake[rows[m], b, j, c] - origin[c]
                n += 1
    induced_at(
        sheet[: n_chord + n_rows + 1], n_target, targets, velocity, scratch, origin, ground, has_ground, far, table
    )
    n = 0
    for m in range(count):
        for b in range(n_blade):
            for j in range(n_node):
                for c in range(3):
                    induced[rows[m], b, j, c] = velocity[0, c, n]
                n += 1
    return count


@kernel(fastmath=False)
def velocity_at_points(
    sheet, points, targets, velocity, scratch, origin, ground, has_ground, far,
                       table, out):  # fmt: skip
    """Velocity of sheet rows and far wake at points (3, n) float64, into out (3, n)."""
    n = points.shape[1]
    for c in range(3):
        for i in range(n):
            targets[0, c, i] = points[c, i] - origin[c]
    induced_at(sheet, n, targets, velocity, scratch, origin, ground, has_ground, far, table)
    for c in range(3):
        for i in range(n):
            out[c, i] = velocity[0, c, i]
