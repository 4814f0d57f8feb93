"""Semi-infinite vortex cylinders that continue a rotor wake behind its last row: measuring and evaluating them.

The far wake is one float64 vector: active, centre of the last rows (3), axis (3), then for each cylinder its start
along the axis from there [m], its radius [m], its ring vorticity per length [m/s] and its axial circulation [m^2/s].
Positions are relative to the origin of the wake sheet.
"""

import numpy as np

from wt_gym.compiled import kernel

HEADER = 7  # active, centre (3), axis (3)
PER_CYLINDER = 4  # start, radius, ring vorticity, axial circulation
MOST_INDUCTION = 1.6


@kernel(fastmath=False, inline="always")
def measure_far_wake(a, n_tail, dt, sums):
    """Cylinders from the geometry and circulation of the last ``n_tail`` rows.

    The axis runs from the centre of the trailing edges to the centre of these rows; each cylinder starts at the last
    row of its span boundary. Its ring vorticity is the sum of circulation times tangential length over the trailing
    segments of the rows, divided by circumference and by the axial length they cover: it vanishes with the rotation,
    without a case to distinguish. The axial circulation is found in the same way. sums (3, n_node) is for work.

    Two precautions, since a slower wake makes a stronger far wake, which makes the wake slower. The strengths follow
    the measurement with the time the measured rows span (``dt`` 0: at once). And the mean velocity in the far wake
    is limited smoothly to `MOST_INDUCTION` times the speed w of the measured rows: in momentum theory their ratio is
    2 a / (1 - a), and beyond a = 0.45 a wake breaks down instead of standing as a cylinder.
    """
    wake, wake_gamma, age, far = a.wake, a.wake_gamma, a.age, a.far
    _, n_blade, n_node, _ = wake.shape
    n_rows = a.count[0]
    first = n_rows - n_tail
    fx, fy, fz, cx, cy, cz = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for b in range(n_blade):
        for j in range(n_node):
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
    for j in range(n_node):
        radius2, begin, end, turned, lengthwise = 0.0, 0.0, 0.0, 0.0, 0.0
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
                if j > 0:
                    strength += wake_gamma[k, b, j - 1]
                if j < n_node - 1:
                    strength -= wake_gamma[k, b, j]
                lx = wake[k + 1, b, j, 0] - wake[k, b, j, 0]
                ly = wake[k + 1, b, j, 1] - wake[k, b, j, 1]
                lz = wake[k + 1, b, j, 2] - wake[k, b, j, 2]
                # (axis x d) . l is radius times the tangential part of l, the same at both ends of l
                turned += strength * ((ay * dz - az * dy) * lx + (az * dx - ax * dz) * ly + (ax * dy - ay * dx) * lz)
                lengthwise += strength * (ax * lx + ay * ly + az * lz)
        o = HEADER + PER_CYLINDER * j
        far[o] = end
        far[o + 1] = np.sqrt(max(radius2, 0.0))
        rings[j] = turned
        lines[j] = lengthwise
        lengths[j] = end - begin
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


@kernel(fastmath=False)
def far_wake_velocity(far, table, targets, velocity, n_target):
    """Add the velocity of the cylinders at targets (3, n) float32.

    ``table`` (n_axial, n_radial, 2) holds axial and radial velocity of a unit cylinder of unit radius on an even grid
    of the mapped coordinates z / (1 + |z|) and r / (1 + r), see `far_wake.cylinder_table`.
    """
    n_axial, n_radial, _ = table.shape
    n_cylinder = (far.shape[0] - HEADER) // PER_CYLINDER
    for i in range(n_target):
        dx = targets[0, i] - far[1]
        dy = targets[1, i] - far[2]
        dz = targets[2, i] - far[3]
        height = dx * far[4] + dy * far[5] + dz * far[6]
        rx, ry, rz = dx - height * far[4], dy - height * far[5], dz - height * far[6]
        r2 = rx * rx + ry * ry + rz * rz
        r = np.sqrt(r2)
        r8 = r2 * r2 * r2 * r2
        axial, radial, swirl = 0.0, 0.0, 0.0
        for m in range(n_cylinder):
            o = HEADER + PER_CYLINDER * m
            radius = far[o + 1]
            if radius <= 0.0:
                continue
            along = height - far[o]
            p = (along / (radius + abs(along)) + 1.0) * 0.5 * (n_axial - 1)
            q = r / (radius + r) * (n_radial - 1)
            ip = min(int(p), n_axial - 2)
            iq = min(int(q), n_radial - 2)
            u, v = p - ip, q - iq
            w00, w01, w10, w11 = (1.0 - u) * (1.0 - v), (1.0 - u) * v, u * (1.0 - v), u * v
            axial += far[o + 2] * (w00 * table[ip, iq, 0] + w01 * table[ip, iq + 1, 0] + w10 * table[ip + 1, iq, 0]
                                   + w11 * table[ip + 1, iq + 1, 0])  # fmt: skip
            radial += far[o + 2] * (w00 * table[ip, iq, 1] + w01 * table[ip, iq + 1, 1] + w10 * table[ip + 1, iq, 1]
                                    + w11 * table[ip + 1, iq + 1, 1])  # fmt: skip
            # Lines parallel to the axis: nothing inside their cylinder, outside as if they lay on the axis.
            outside = r8 / (r8 + radius**8 + 1e-30)
            swirl += far[o + 3] * outside * (1.0 + along / max(np.sqrt(along * along + r2), 1e-9))
        radial /= max(r, 1e-9)
        swirl /= 4.0 * np.pi * max(r2, 1e-9)
        velocity[0, i] += axial * far[4] + radial * rx + swirl * (far[5] * rz - far[6] * ry)
        velocity[1, i] += axial * far[5] + radial * ry + swirl * (far[6] * rx - far[4] * rz)
        velocity[2, i] += axial * far[6] + radial * rz + swirl * (far[4] * ry - far[5] * rx)
