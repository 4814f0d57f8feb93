"""Semi-infinite vortex cylinders that continue a rotor wake behind its last row: measuring and evaluating them.

The far wake is one float64 vector: active, centre of the last rows (3), axis (3), then for each cylinder its start
along the axis from there [m], its radius [m], its ring vorticity per length [m/s] and its axial circulation [m^2/s].
Positions are relative to the origin of the wake sheet.
"""

import numpy as np

from wt_gym.aerodynamics.induction.induction_kernels import FAST, FOUR_PI
from wt_gym.compiled import kernel

HEADER = 7  # active, centre (3), axis (3)
PER_CYLINDER = 4  # start, radius, ring vorticity, axial circulation
MOST_INDUCTION = 1.6


@kernel(fastmath=False, inline="always")
def measure_far_wake(a, n_tail, dt, sparse_nodes, sparse_weight, sums):
    """Cylinders from the geometry and circulation of the last ``n_tail`` rows.

    The axis runs from the centre of the trailing edges to the centre of these rows; each cylinder starts at the last
    row of its span boundary. Its ring vorticity is the sum of circulation times tangential length over the trailing
    segments of the rows, divided by circumference and by the axial length they cover: it vanishes with the rotation,
    without a case to distinguish. The axial circulation is found in the same way. Cylinders stand at the nodes that
    carry the sparse part of the wake, all nodes if there is none, and rings between them are merged as there.
    sums (3, n_sparse) is for work.

    Two precautions, since a slower wake makes a stronger far wake, which makes the wake slower. The strengths follow
    the measurement with the time the measured rows span (``dt`` 0: at once). And the mean velocity in the far wake
    is limited smoothly to `MOST_INDUCTION` times the speed w of the measured rows: in momentum theory their ratio is
    2 a / (1 - a), and beyond a = 0.45 a wake breaks down instead of standing as a cylinder.
    """
    wake, wake_gamma, age, far = a.wake, a.wake_gamma, a.age, a.far
    n_blade, n_node = wake.shape[1], sparse_nodes.shape[0]
    n_rows = a.n_rows[0]
    first = n_rows - n_tail
    fx, fy, fz, cx, cy, cz = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for b in range(n_blade):
        for j in sparse_nodes:
            fx, fy, fz = fx + wake[0, b, j, 0], fy + wake[0, b, j, 1], fz + wake[0, b, j, 2]
            for k in range(first, n_rows + 1):
                cx, cy, cz = cx + wake[k, b, j, 0], cy + wake[k, b, j, 1], cz + wake[k, b, j, 2]
    n_foot = n_blade * n_node
    n_centre = n_foot * (n_tail + 1)
    cx, cy, cz = cx / n_centre, cy / n_centre, cz / n_centre
    ax, ay, az = cx - fx / n_foot, cy - fy / n_foot, cz - fz / n_foot
    size = np.sqrt(ax * ax + ay * ay + az * az)
    if not size > 0.0:
        far[:] = 0.0
        return
    duration = age[n_rows] - age[first]
    keep = np.exp(-dt / duration) if (far[0] > 0.0 and dt > 0.0) else 0.0
    ax, ay, az = ax / size, ay / size, az / size
    largest = 0.0
    lengths, rings, lines = sums[0], sums[1], sums[2]
    for i in range(n_node):
        radius2, begin, end, turned, lengthwise = 0.0, 0.0, 0.0, 0.0, 0.0
        j = sparse_nodes[i]
        inboard, outboard = sparse_nodes[max(i - 1, 0)], sparse_nodes[min(i + 1, n_node - 1)]
        for b in range(n_blade):
            for k in range(first, n_rows + 1):
                dx, dy, dz = wake[k, b, j, 0] - cx, wake[k, b, j, 1] - cy, wake[k, b, j, 2] - cz
                along = dx * ax + dy * ay + dz * az
                radius2 += (dx * dx + dy * dy + dz * dz - along * along) / (n_blade * (n_tail + 1))
                if k == first:
                    begin += along / n_blade
                if k == n_rows:
                    end += along / n_blade
                    continue
                strength = 0.0
                for strip in range(inboard, j):
                    strength += sparse_weight[strip] * wake_gamma[k, b, strip]
                for strip in range(j, outboard):
                    strength -= sparse_weight[strip] * wake_gamma[k, b, strip]
                lx = wake[k + 1, b, j, 0] - wake[k, b, j, 0]
                ly = wake[k + 1, b, j, 1] - wake[k, b, j, 1]
                lz = wake[k + 1, b, j, 2] - wake[k, b, j, 2]
                # (axis x d) . l is radius times the tangential part of l, the same at both ends of l
                turned += strength * ((ay * dz - az * dy) * lx + (az * dx - ax * dz) * ly + (ax * dy - ay * dx) * lz)
                lengthwise += strength * (ax * lx + ay * ly + az * lz)
        o = HEADER + PER_CYLINDER * i
        far[o] = end
        far[o + 1] = np.sqrt(max(radius2, 0.0))
        rings[i] = turned
        lines[i] = lengthwise
        lengths[i] = end - begin
        largest = max(largest, far[o + 1])
    through, speed, weight = 0.0, 0.0, 1e-30
    for j in range(n_node):
        radius2 = max(far[HEADER + PER_CYLINDER * j + 1] ** 2, (0.01 * largest) ** 2)
        # A wake that does not move away (no wind) has no length to spread its circulation over: soften 1 / length.
        soft = lengths[j] / (lengths[j] ** 2 + (0.05 * largest) ** 2)
        rings[j] *= soft / (2.0 * np.pi * radius2)
        lines[j] *= soft
        through += rings[j] * radius2 / largest**2
        speed += abs(rings[j]) * radius2 * lengths[j] / duration
        weight += abs(rings[j]) * radius2
    speed = max(speed / weight, 1e-9)
    share = (1.0 + (through / (MOST_INDUCTION * speed)) ** 8) ** -0.125
    for j in range(n_node):
        o = HEADER + PER_CYLINDER * j
        far[o + 2] = keep * far[o + 2] + (1.0 - keep) * share * rings[j]
        far[o + 3] = keep * far[o + 3] + (1.0 - keep) * share * lines[j]
    far[0] = 1.0
    far[1], far[2], far[3] = cx - a.origin[0], cy - a.origin[1], cz - a.origin[2]
    far[4], far[5], far[6] = ax, ay, az


@kernel(fastmath=FAST)
def far_wake_velocity(far, table, targets, velocity, n_target, lane):
    """Add the velocity of the cylinders at the first ``n_target`` targets (3, n) float32.

    ``table`` (2, n_axial, n_radial) holds axial and radial velocity of a unit cylinder of unit radius on an even grid
    of the mapped coordinates z / (1 + |z|) and r / (1 + r), see `far_wake.cylinder_table`. ``lane`` is float32 for
    work, at least (8, n).
    """
    _, n_axial, n_radial = table.shape
    n_cylinder = (far.shape[0] - HEADER) // PER_CYLINDER
    axial_table, radial_table = table[0].reshape(n_axial * n_radial), table[1].reshape(n_axial * n_radial)
    cx, cy, cz = np.float32(far[1]), np.float32(far[2]), np.float32(far[3])
    ax, ay, az = np.float32(far[4]), np.float32(far[5]), np.float32(far[6])
    one, half = np.float32(1.0), np.float32(0.5)
    for i in range(n_target):
        dx, dy, dz = targets[0, i] - cx, targets[1, i] - cy, targets[2, i] - cz
        height = dx * ax + dy * ay + dz * az
        rx, ry, rz = dx - height * ax, dy - height * ay, dz - height * az
        lane[0, i], lane[1, i], lane[2, i], lane[3, i] = height, rx, ry, rz
        lane[4, i] = np.sqrt(rx * rx + ry * ry + rz * rz)
        lane[5, i], lane[6, i], lane[7, i] = np.float32(0.0), np.float32(0.0), np.float32(0.0)
    for m in range(n_cylinder):
        o = HEADER + PER_CYLINDER * m
        start, radius = np.float32(far[o]), np.float32(far[o + 1])
        ring, line = np.float32(far[o + 2]), np.float32(far[o + 3])
        if radius <= 0.0 or (ring == 0.0 and line == 0.0):
            continue
        for i in range(n_target):
            along, r = lane[0, i] - start, lane[4, i]
            p = (along / (radius + abs(along)) + one) * (half * np.float32(n_axial - 1))
            q = r / (radius + r) * np.float32(n_radial - 1)
            ip, iq = min(np.int32(p), np.int32(n_axial - 2)), min(np.int32(q), np.int32(n_radial - 2))
            u, v = p - np.float32(ip), q - np.float32(iq)
            at = ip * np.int32(n_radial) + iq
            below = at + np.int32(n_radial)
            w00, w01, w10, w11 = (one - u) * (one - v), (one - u) * v, u * (one - v), u * v
            lane[5, i] += ring * (w00 * axial_table[at] + w01 * axial_table[at + 1] + w10 * axial_table[below]
                                  + w11 * axial_table[below + 1])  # fmt: skip
            lane[6, i] += ring * (w00 * radial_table[at] + w01 * radial_table[at + 1] + w10 * radial_table[below]
                                  + w11 * radial_table[below + 1])  # fmt: skip
            # Lines parallel to the axis: nothing inside their cylinder, outside as if they lay on the axis.
            r8 = (r / radius) ** 8
            far_off = np.sqrt(along * along + r * r) + np.float32(1e-9)
            lane[7, i] += line * (r8 / (r8 + one)) * (one + along / far_off)
    for i in range(n_target):
        r = max(lane[4, i], np.float32(1e-6))
        radial, swirl = lane[6, i] / r, lane[7, i] / (np.float32(FOUR_PI) * r * r)
        axial, rx, ry, rz = lane[5, i], lane[1, i], lane[2, i], lane[3, i]
        velocity[0, i] += axial * ax + radial * rx + swirl * (ay * rz - az * ry)
        velocity[1, i] += axial * ay + radial * ry + swirl * (az * rx - ax * rz)
        velocity[2, i] += axial * az + radial * rz + swirl * (ax * ry - ay * rx)
