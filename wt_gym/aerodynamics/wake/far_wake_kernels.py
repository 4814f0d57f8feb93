"""What continues a rotor wake behind its last row: coaxial vortex cylinders, measured there and carried away.

**Measuring.** Each span boundary that carries vortices leaves behind a cylinder. Ring circulation passes the last rows
at the rate F = sum(G a) / (pi r^2 T) [m^2/s^2], with the circulation G of the trailing segments, the area a that they
sweep about the axis, the time T that the rows span and the mean square radius r^2: a flux, without the length of the
rows, which fluctuates in turbulence. The flux vanishes with the rotation, without a case to distinguish.

**Carrying.** The strength per length g of a cylinder is transported with the speed c of its vorticity,

    dg/dt + d(c g)/dz = 0,    c g = F where the rows end,

in cells along the axis, the last of them without end. So g c stays what it is in steady flow: a wake that slows down
becomes stronger; and what a gust or a change of pitch has shed acts later, and further away.

**Speed.** The speed of a sheet is the mean of the speeds on its two sides. Of a cylinder with the strength g(z) in a
wind V0 it is V0 + u(z), u the velocity of all cylinders at their own radius: half of g far behind the rotor, a quarter
in its plane. In this proportion the vorticity slows down behind the measured rows. No speed is less than half that of
the rows (a wake that stands does not exist: beyond an induction of about 0.45 it breaks down).

**Turbulence** moves the vorticity in every direction by s = i z on the way z from the rotor: faster than random walks
do, the eddies being larger than the wake is long. The last rows tell i by how far they have wandered apart along the
axis; in orderly wakes it is nothing. It acts twice. Vorticity is spread over the width of the wake, where faster air
carries it and vorticity of the other sign takes it away: on the way R / i by a radius, so the deficit falls by
exp(-2 i (z' - z) / R). And rings no longer stand on the axis: one that is d off it acts on the rotor, for d << z, as
one of equal impulse whose R^2 is larger by 2 d^2, one that is widened by d^2 as one whose R^2 is larger by that. With
2 s^2 across the axis, half of it movement of the whole wake and half widening (as in 17 free turns behind the 5-MW
rotor, class B, 8 m/s), the rings at z act by the share

    f = ((z^2 + R^2) / (z^2 + R^2 + 3 s^2))^(3/2)
"""

import math

import numpy as np

from wt_gym.aerodynamics.induction.induction_kernels import FAST, FOUR_PI
from wt_gym.base.compiled import kernel

N_CELL = 5
# entries of AeroArrays.far: 1 or 0, three coordinates, three components, share of each cell that acts
ACTIVE, CENTER, AXIS, SHARE, N_FAR = 0, 1, 4, 7, 7 + N_CELL
END, RADIUS, LENGTH, SWEPT, LINE, N_TUBE = 0, 1, 2, 3, 4, 5  # rows of AeroArrays.far_tube
WANDERED, FLUX = 0, 1  # rows of AeroWork.lines
FIRST_CELL, GROWTH = 0.5, 1.4  # length of the first cell, in radii, and of each over the one before
SLOWEST = 0.5  # speed of the far wake over that of the last rows
MOST_INDUCTION = 1.6  # mean velocity in the far wake over the speed of the last rows
STEADY_PASSES = 30


@kernel(fastmath=False, inline="always")
def measure_far_wake(p, a, w, n_tail, dt):
    """Bring the cylinders up to date with the last ``n_tail`` rows, ``dt`` later; 0: as they are in steady flow.

    The axis runs from the center of the shedding edges to the center of these rows; each cylinder starts at the last
    row of its span boundary. Cylinders stand at the nodes that carry the sparse part of the wake, all nodes if there is
    none, and rings between them are merged as there. What is measured follows with the time that the rows span.
    """
    far, tube, flux = a.far, a.far_tube, w.lines[FLUX]
    n_rows = a.n_rows[0]
    first = n_rows - n_tail
    way = find_axis(p, a, first)
    if not way > 0.0:
        far[ACTIVE] = 0.0
        return
    duration = a.age[n_rows] - a.age[first]
    follow = dt > 0.0 and far[ACTIVE] > 0.0
    measure_tubes(p, a, w.lines[WANDERED], first, duration, math.exp(-dt / duration) if follow else 0.0)
    largest = 0.0
    for i in range(tube.shape[1]):
        largest = max(largest, tube[RADIUS, i])
    through, speed, apart2, weight = 0.0, 0.0, 0.0, 1e-30
    for i in range(tube.shape[1]):
        radius2 = max(tube[RADIUS, i] ** 2, (0.01 * largest) ** 2)
        flux[i] = tube[SWEPT, i] / (2.0 * np.pi * radius2)
        share = abs(flux[i]) * radius2
        through += flux[i] * radius2 / largest**2
        speed += share * tube[LENGTH, i] / duration
        apart2 += share * w.lines[WANDERED, i]
        weight += share
    # A wake that does not move away (no wind) would be infinitely strong: its speed is softened.
    slow = 0.05 * largest / duration
    speed = math.sqrt((speed / weight) ** 2 + slow * slow)
    limit = (1.0 + (through / (MOST_INDUCTION * speed * speed)) ** 8) ** -0.125
    wander2 = apart2 / (weight * way * way)
    wind = wind_along(p, a, first)
    for i in range(tube.shape[1]):
        flux[i] *= limit
        for m in range(N_CELL):
            a.far_ring[m, i] = a.far_ring[m, i] if follow else flux[i] / speed
    for _ in range(1 if follow else STEADY_PASSES):
        transport(a, flux, wind, way, largest, duration, speed, slow, wander2, dt if follow else -1.0)
    share_of_cells(a, way, largest, wander2)
    far[ACTIVE] = 1.0


@kernel(fastmath=False, separate=True)
def find_axis(p, a, first):
    """Write center and axis of the rows from ``first`` on; returns their distance from the shedding edges [m]."""
    n_rows, n_blade, n_node = a.n_rows[0], a.wake.shape[1], p.sparse_nodes.shape[0]
    way2 = 0.0
    for c in range(3):
        foot, center = 0.0, 0.0
        for b in range(n_blade):
            for j in p.sparse_nodes:
                foot += a.wake[0, b, j, c]
                for k in range(first, n_rows + 1):
                    center += a.wake[k, b, j, c]
        center /= n_blade * n_node * (n_rows - first + 1)
        a.far[CENTER + c] = center - a.origin[c]
        a.far[AXIS + c] = center - foot / (n_blade * n_node)
        way2 += a.far[AXIS + c] ** 2
    way = math.sqrt(way2)
    if way > 0.0:
        for c in range(3):
            a.far[AXIS + c] /= way
    return way


@kernel(fastmath=False, separate=True)
def wind_along(p, a, first):
    """Mean wind along the axis at the rows from ``first`` on [m/s]."""
    total, count = 0.0, 0
    for k in range(first, a.n_rows[0] + 1):
        for b in range(a.wake.shape[1]):
            for j in p.sparse_nodes:
                count += 1
                for c in range(3):
                    total += a.wind[k, b, j, c] * a.far[AXIS + c]
    return total / count


@kernel(fastmath=False, separate=True)
def measure_tubes(p, a, wandered, first, duration, keep):
    """Starts, radii and lengths of the cylinders, what passes, mean square by which the rows have wandered [m^2].

    What passes a second is twice the area swept, times circulation [m^4/s^2]; the axial circulation is kept times the
    length of the rows [m^3/s]. Rows have wandered from where they would be had all nodes of their boundary moved with
    one speed and along one plane: the plane may be inclined, as in yaw.
    """
    tube, n_rows, n_blade, n_node = a.far_tube, a.n_rows[0], a.wake.shape[1], p.sparse_nodes.shape[0]
    ax, ay, az = a.far[AXIS], a.far[AXIS + 1], a.far[AXIS + 2]
    cx, cy, cz = a.far[CENTER] + a.origin[0], a.far[CENTER + 1] + a.origin[1], a.far[CENTER + 2] + a.origin[2]
    # directions across the axis: level, and the third
    level = math.sqrt(ax * ax + ay * ay)
    ex, ey = (-ay / level, ax / level) if level > 1e-6 else (1.0, 0.0)
    hx, hy, hz = -az * ey, az * ex, ax * ey - ay * ex
    count = n_blade * (n_rows - first + 1)
    for i in range(n_node):
        j = p.sparse_nodes[i]
        inboard, outboard = p.sparse_nodes[max(i - 1, 0)], p.sparse_nodes[min(i + 1, n_node - 1)]
        radius2, begin, end, swept, lengthwise = 0.0, 0.0, 0.0, 0.0, 0.0
        for b in range(n_blade):
            begin += ((a.wake[first, b, j, 0] - cx) * ax + (a.wake[first, b, j, 1] - cy) * ay
                      + (a.wake[first, b, j, 2] - cz) * az) / n_blade  # fmt: skip
            end += ((a.wake[n_rows, b, j, 0] - cx) * ax + (a.wake[n_rows, b, j, 1] - cy) * ay
                    + (a.wake[n_rows, b, j, 2] - cz) * az) / n_blade  # fmt: skip
        slope = (end - begin) / duration
        off, off2, off_e, off_h, e2, h2 = 0.0, 0.0, 0.0, 0.0, 1e-12, 1e-12
        for b in range(n_blade):
            for k in range(first, n_rows + 1):
                dx, dy, dz = a.wake[k, b, j, 0] - cx, a.wake[k, b, j, 1] - cy, a.wake[k, b, j, 2] - cz
                along = dx * ax + dy * ay + dz * az
                radius2 += (dx * dx + dy * dy + dz * dz - along * along) / count
                along -= begin + slope * (a.age[k] - a.age[first])
                e, h = dx * ex + dy * ey, dx * hx + dy * hy + dz * hz
                off, off2, off_e, off_h = off + along, off2 + along * along, off_e + along * e, off_h + along * h
                e2, h2 = e2 + e * e, h2 + h * h
                if k == n_rows:
                    continue
                strength = 0.0
                for strip in range(inboard, j):
                    strength += p.sparse_weight[strip] * a.wake_gamma[k, b, strip]
                for strip in range(j, outboard):
                    strength -= p.sparse_weight[strip] * a.wake_gamma[k, b, strip]
                lx = a.wake[k + 1, b, j, 0] - a.wake[k, b, j, 0]
                ly = a.wake[k + 1, b, j, 1] - a.wake[k, b, j, 1]
                lz = a.wake[k + 1, b, j, 2] - a.wake[k, b, j, 2]
                # (axis x d) . l is the same at both ends of l
                swept += strength * ((ay * dz - az * dy) * lx + (az * dx - ax * dz) * ly + (ax * dy - ay * dx) * lz)
                lengthwise += strength * (ax * lx + ay * ly + az * lz)
        wandered[i] = max(off2 - off * off / count - off_e * off_e / e2 - off_h * off_h / h2, 0.0) / count
        tube[END, i] = end
        tube[RADIUS, i] = math.sqrt(max(radius2, 0.0))
        tube[LENGTH, i] = keep * tube[LENGTH, i] + (1.0 - keep) * (end - begin)
        tube[SWEPT, i] = keep * tube[SWEPT, i] + (1.0 - keep) * swept / duration
        tube[LINE, i] = keep * tube[LINE, i] + (1.0 - keep) * lengthwise


@kernel(fastmath=False, inline="always")
def at_own_radius(distance):
    """Axial velocity of a cylinder of unit strength at its own radius, ``distance`` radii behind its start.

    1/4 + z k K(k) / (4 pi), k^2 = 4 / (4 + z^2): the mean of both sides (Branlard & Gaunaa, Wind Energ. 18 (2015)).
    """
    root = math.sqrt(4.0 + distance * distance)
    a, b = 1.0, max(abs(distance) / root, 1e-12)
    for _ in range(6):  # the arithmetic-geometric mean of 1 and sqrt(1 - k^2) is pi / (2 K)
        a, b = 0.5 * (a + b), math.sqrt(a * b)
    return 0.25 * (1.0 + distance / (root * a))


@kernel(fastmath=False, inline="always")
def mean_strength(rings, tube, largest):
    """Mean over the largest cylinder of the jumps of axial velocity at all cylinders [m/s]."""
    total = 0.0
    for i in range(tube.shape[1]):
        total += rings[i] * (tube[RADIUS, i] / largest) ** 2
    return total


@kernel(fastmath=False)
def transport(a, flux, wind, way, largest, duration, speed, slow, wander2, dt):
    """Carry the strengths of the cells on by ``dt`` (negative: to what is steady at the present speeds).

    Implicit upwind differences, which neither overshoot nor limit the step. For the speed at the end of a cell, over
    that of the measured rows, all cylinders are one sheet of their mean strength; its deficit falls with ``mixing``
    [1/m].
    """
    tube, ring = a.far_tube, a.far_ring
    end = 0.0  # of the rows, from their middle
    for i in range(tube.shape[1]):
        end += tube[END, i] / tube.shape[1]
    rows = mean_strength(flux, tube, largest) / speed  # strength of the part between rotor and last rows
    mixing = 2.0 * math.sqrt(wander2) / largest
    here = max(wind + velocity_of_cells(a, rows, way, way + end, largest), slow)
    length, z = FIRST_CELL * largest, way + end
    for m in range(N_CELL):
        z += length
        deficit = velocity_of_cells(a, rows, z, way + end, largest)
        share = max((wind + deficit * math.exp(-mixing * (z - way))) / here, SLOWEST)
        for i in range(tube.shape[1]):
            own = tube[LENGTH, i] / duration
            c = share * math.sqrt(own * own + slow * slow)
            if dt < 0.0:
                ring[m, i] = 0.5 * ring[m, i] + 0.5 * flux[i] / c
            else:
                ring[m, i] = (ring[m, i] + dt / length * flux[i]) / (1.0 + dt / length * c)
                flux[i] = c * ring[m, i]  # what leaves the cell enters the next
        length *= GROWTH


@kernel(fastmath=False)
def share_of_cells(a, way, largest, wander2):
    """How much of each cell acts on the rotor, having wandered as far as to the middle of the cell (see above)."""
    start, length = way, FIRST_CELL * largest
    for i in range(a.far_tube.shape[1]):
        start += a.far_tube[END, i] / a.far_tube.shape[1]
    for m in range(N_CELL):
        z2 = (start + 0.5 * length) ** 2
        orderly = z2 + largest**2
        a.far[SHARE + m] = (orderly / (orderly + 3.0 * wander2 * z2)) ** 1.5
        start, length = start + length, length * GROWTH


@kernel(fastmath=False)
def velocity_of_cells(a, rows, z, end, largest):
    """Axial velocity of the rows before ``end`` and of the cells at their own radius, ``z`` behind the rotor."""
    total = rows * (at_own_radius(z / largest) - at_own_radius((z - end) / largest))
    length, start, before = FIRST_CELL * largest, end, 0.0
    for m in range(N_CELL):
        strength = mean_strength(a.far_ring[m], a.far_tube, largest)
        total += (strength - before) * at_own_radius((z - start) / largest)
        before, start, length = strength, start + length, length * GROWTH
    return total


@kernel(fastmath=False, inline="always")
def merged_change(a, m):
    """Start, radius and strength of one cylinder for all changes of strength from cell m - 1 to cell m.

    Far away, cylinders of radius R are dipoles of strength gamma R^2: the mean of their areas is weighted with these.
    """
    tube, total, weight, area, start = a.far_tube, 0.0, 0.0, 0.0, 0.0
    here, before = a.far[SHARE + m], a.far[SHARE + m - 1]
    for i in range(tube.shape[1]):
        radius2 = tube[RADIUS, i] ** 2
        dipole = (here * a.far_ring[m, i] - before * a.far_ring[m - 1, i]) * radius2
        total += dipole
        weight += abs(dipole)
        area += abs(dipole) * radius2
        start += abs(dipole) * tube[END, i]
    if weight == 0.0 or area == 0.0:
        return 0.0, 0.0, 0.0
    area /= weight
    return start / weight, math.sqrt(area), total / area


@kernel(fastmath=FAST, separate=True, distinct=True)
def add_cylinder(lane, start, radius, ring, line, axial_table, radial_table, n_axial, n_radial):
    """Add the axial, radial and swirling velocity of one cylinder to rows 5 to 7 of ``lane`` (8, n)."""
    one, half = np.float32(1.0), np.float32(0.5)
    axial_scale, radial_scale = half * np.float32(n_axial - 1), np.float32(n_radial - 1)
    last_axial, last_radial, stride = np.int32(n_axial - 2), np.int32(n_radial - 2), np.int32(n_radial)
    for i in range(lane.shape[1]):
        along, r = lane[0, i] - start, lane[4, i]
        p = (along / (radius + abs(along)) + one) * axial_scale
        q = r / (radius + r) * radial_scale
        ip, iq = min(np.int32(p), last_axial), min(np.int32(q), last_radial)
        u, v = p - np.float32(ip), q - np.float32(iq)
        at = ip * stride + iq
        below = at + stride
        w00, w01, w10, w11 = (one - u) * (one - v), (one - u) * v, u * (one - v), u * v
        lane[5, i] += ring * (w00 * axial_table[at] + w01 * axial_table[at + 1] + w10 * axial_table[below]
                              + w11 * axial_table[below + 1])  # fmt: skip
        lane[6, i] += ring * (w00 * radial_table[at] + w01 * radial_table[at + 1] + w10 * radial_table[below]
                              + w11 * radial_table[below + 1])  # fmt: skip
    if line == 0.0:
        return
    for i in range(lane.shape[1]):
        # Lines parallel to the axis: nothing inside their cylinder, outside as if they lay on the axis.
        along, r = lane[0, i] - start, lane[4, i]
        r2 = (r / radius) ** 2
        r8 = r2 * r2 * r2 * r2
        far_off = np.sqrt(along * along + r * r) + np.float32(1e-9)
        lane[7, i] += line * (r8 / (r8 + one)) * (one + along / far_off)


@kernel(fastmath=FAST)
def far_wake_velocity(a, table, targets, velocity, lane):
    """Add the velocity of the cylinders at targets (3, n) float32.

    A cell acts as the cylinder that starts with it, with the change of strength against the cell before: one at each
    span boundary for the first cell; one for all boundaries, with the dipole of all of them, for each of the others,
    whose changes are small and start half a radius behind the last row at least.

    ``table`` (2, n_axial, n_radial) holds axial and radial velocity of a unit cylinder of unit radius on an even grid
    of the mapped coordinates z / (1 + |z|) and r / (1 + r), see `far_wake.cylinder_table`. ``lane`` (8, n) is
    float32 for work.
    """
    _, n_axial, n_radial = table.shape
    far, tube, n_tube, largest = a.far, a.far_tube, a.far_tube.shape[1], 0.0
    for i in range(n_tube):
        largest = max(largest, tube[RADIUS, i])
    axial_table, radial_table = table[0].reshape(n_axial * n_radial), table[1].reshape(n_axial * n_radial)
    cx, cy, cz = np.float32(far[1]), np.float32(far[2]), np.float32(far[3])
    ax, ay, az = np.float32(far[4]), np.float32(far[5]), np.float32(far[6])
    for i in range(targets.shape[1]):
        dx, dy, dz = targets[0, i] - cx, targets[1, i] - cy, targets[2, i] - cz
        height = dx * ax + dy * ay + dz * az
        rx, ry, rz = dx - height * ax, dy - height * ay, dz - height * az
        lane[0, i], lane[1, i], lane[2, i], lane[3, i] = height, rx, ry, rz
        lane[4, i] = np.sqrt(rx * rx + ry * ry + rz * rz)
        lane[5, i], lane[6, i], lane[7, i] = np.float32(0.0), np.float32(0.0), np.float32(0.0)
    offset, length = 0.0, FIRST_CELL * largest
    for k in range(n_tube + N_CELL - 1):
        if k < n_tube:
            start, radius, ring = tube[END, k], tube[RADIUS, k], far[SHARE] * a.far_ring[0, k]
            soft = tube[LENGTH, k] / (tube[LENGTH, k] ** 2 + (0.05 * largest) ** 2)
            line = tube[LINE, k] * soft
        else:
            offset, length = offset + length, length * GROWTH
            start, radius, ring = merged_change(a, k - n_tube + 1)
            start, line = start + offset, 0.0
        start, radius, ring, line = np.float32(start), np.float32(radius), np.float32(ring), np.float32(line)
        if radius <= 0.0 or (ring == 0.0 and line == 0.0):
            continue
        add_cylinder(lane, start, radius, ring, line, axial_table, radial_table, n_axial, n_radial)
    for i in range(targets.shape[1]):
        r = max(lane[4, i], np.float32(1e-6))
        radial, swirl = lane[6, i] / r, lane[7, i] / (np.float32(FOUR_PI) * r * r)
        axial, rx, ry, rz = lane[5, i], lane[1, i], lane[2, i], lane[3, i]
        velocity[0, i] += axial * ax + radial * rx + swirl * (ay * rz - az * ry)
        velocity[1, i] += axial * ay + radial * ry + swirl * (az * rx - ax * rz)
        velocity[2, i] += axial * az + radial * rz + swirl * (ax * ry - ay * rx)
