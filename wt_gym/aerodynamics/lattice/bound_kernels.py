"""The bound lattice: geometry, velocities at its points, influence of its rings and the boundary condition.

Points of one blade-set come in this order: collocation points (blade, chord, span), midpoints of loaded spanwise bound
segments (blade, row, span), midpoints of chordwise bound segments (blade, chord, node). The spanwise segments at the
trailing edge are loaded only if the edge sheds no wake. Rings are numbered (blade, chord, span). A positive
circulation runs from root to tip along the leading side of a ring and lifts towards the suction side; panel normals
point there too.
"""

import numpy as np

from wt_gym.aerodynamics.induction.induction_kernels import FAST, FOUR_PI
from wt_gym.base.compiled import kernel


@kernel(fastmath=FAST, separate=True, distinct=True)
def distances(corner, points, out):
    """Distance of a corner from all points (3, n)."""
    x, y, z = corner[0], corner[1], corner[2]
    for i in range(out.shape[0]):
        dx, dy, dz = points[0, i] - x, points[1, i] - y, points[2, i] - z
        out[i] = np.sqrt(dx * dx + dy * dy + dz * dz)


@kernel(fastmath=FAST, separate=True, distinct=True)
def add_segment(a, b, from_a, from_b, core2, points, circulation, plus, minus):
    """Add the velocity of a segment from a to b at all points (3, n) to one ring (3, n), take it from another.

    ``circulation`` is that of the segment, ``from_a`` and ``from_b`` (n,) are the distances of its ends, ``core2`` is
    rc^2. With r2 = r1 - l the product r1 x r2 of the law is l x r1.
    """
    lx, ly, lz = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    soft = core2 * (lx * lx + ly * ly + lz * lz) + 1e-300
    strength = circulation / FOUR_PI
    for i in range(points.shape[1]):
        x = points[0, i] - a[0]
        y = points[1, i] - a[1]
        z = points[2, i] - a[2]
        ra, rb = from_a[i], from_b[i]
        ab = ra * rb
        dot = x * (x - lx) + y * (y - ly) + z * (z - lz)
        k = strength * (ra + rb) / (ab * (ab + dot) + soft)
        u = k * (ly * z - lz * y)
        v = k * (lz * x - lx * z)
        w = k * (lx * y - ly * x)
        plus[0, i] += u
        plus[1, i] += v
        plus[2, i] += w
        minus[0, i] -= u
        minus[1, i] -= v
        minus[2, i] -= w


@kernel(fastmath=False)
def geometry(nodes, line_rows, points, normal, area):
    """Collocation points, segment midpoints, and ring normals with ring areas.

    nodes (n_blade, n_chord + 1, n_node, 3); points (3, n_point); normal (n_ring, 3); area (n_ring,).
    """
    n_blade, n_row, n_node, _ = nodes.shape
    n_chord, n_span = n_row - 1, n_node - 1
    n_ring = n_blade * n_chord * n_span
    r, s, k = 0, n_ring, n_ring + n_blade * line_rows * n_span
    for b in range(n_blade):
        for i in range(n_row):
            for j in range(n_span):
                p00, p01 = nodes[b, i, j], nodes[b, i, j + 1]
                if i < line_rows:
                    for c in range(3):
                        points[c, s] = 0.5 * (p00[c] + p01[c])
                    s += 1
                if i == n_chord:
                    continue
                p10, p11 = nodes[b, i + 1, j], nodes[b, i + 1, j + 1]
                for c in range(3):
                    points[c, r] = 0.25 * (p00[c] + p01[c] + p10[c] + p11[c])
                cx = 0.5 * (p10[0] + p11[0] - p00[0] - p01[0])
                cy = 0.5 * (p10[1] + p11[1] - p00[1] - p01[1])
                cz = 0.5 * (p10[2] + p11[2] - p00[2] - p01[2])
                sx = 0.5 * (p01[0] + p11[0] - p00[0] - p10[0])
                sy = 0.5 * (p01[1] + p11[1] - p00[1] - p10[1])
                sz = 0.5 * (p01[2] + p11[2] - p00[2] - p10[2])
                nx, ny, nz = cy * sz - cz * sy, cz * sx - cx * sz, cx * sy - cy * sx
                size = np.sqrt(nx * nx + ny * ny + nz * nz)
                area[r] = size
                normal[r, 0] = nx / size
                normal[r, 1] = ny / size
                normal[r, 2] = nz / size
                r += 1
            if i < n_chord:
                for j in range(n_node):
                    for c in range(3):
                        points[c, k] = 0.5 * (nodes[b, i, j, c] + nodes[b, i + 1, j, c])
                    k += 1


@kernel(fastmath=False, inline="always")
def relative_wind(nodes, velocities, wind, line_rows, flow):
    """Wind minus motion at all points (3, n_point), from node values."""
    n_blade, n_row, n_node, _ = nodes.shape
    n_chord, n_span = n_row - 1, n_node - 1
    n_ring = n_blade * n_chord * n_span
    for c in range(3):
        r, s, k = 0, n_ring, n_ring + n_blade * line_rows * n_span
        for b in range(n_blade):
            for i in range(n_row):
                for j in range(n_node):
                    fore = wind[b, i, j, c] - velocities[b, i, j, c]
                    fore2 = fore
                    if j < n_span:
                        fore2 = wind[b, i, j + 1, c] - velocities[b, i, j + 1, c]
                        if i < line_rows:
                            flow[c, s] = 0.5 * (fore + fore2)
                            s += 1
                    if i == n_chord:
                        continue
                    aft = wind[b, i + 1, j, c] - velocities[b, i + 1, j, c]
                    flow[c, k] = 0.5 * (fore + aft)
                    k += 1
                    if j < n_span:
                        aft2 = wind[b, i + 1, j + 1, c] - velocities[b, i + 1, j + 1, c]
                        flow[c, r] = 0.25 * (fore + aft + fore2 + aft2)
                        r += 1


@kernel(fastmath=False, separate=True)
def bound_influence(corners, segments, core2, n_segment, points, work, influence):
    """Velocity of each unit ring, and of its images, at all points.

    Segments meet in corners: the distance of a corner from the points is computed once for all of them. Rings that are
    not there, beyond the edges of a blade, are the last one of ``work.rings``, which nobody reads.

    Parameters
    ----------
    corners : (n_image, n_blade, n_corner, 3)
        Ring nodes and the newest wake row, and their mirror images if there is a ground [m].
    segments : (at least n_segment, 4); core2 : (at least n_segment,)
        The table of :func:`wt_gym.aerodynamics.lattice.planform.bound_segments`.
    points : (3, n_point)
        [m].
    work : RingWork
    influence : (n_ring, 3, n_point)
        Receives the velocity.
    """
    rings, n_ring, n_point = work.rings, influence.shape[0], points.shape[1]
    per_blade = n_ring // corners.shape[1]
    for r in range(n_ring):
        for c in range(3):
            for i in range(rings.shape[2]):
                rings[r, c, i] = 0.0
    for c in range(3):
        for i in range(rings.shape[2]):
            work.points[c, i] = points[c, min(i, n_point - 1)]
    for image in range(corners.shape[0]):
        for b in range(corners.shape[1]):
            at = corners[image, b]
            for m in range(at.shape[0]):
                distances(at[m], work.points, work.distance[m])
            for m in range(n_segment):
                start, end, plus, minus = segments[m, 0], segments[m, 1], segments[m, 2], segments[m, 3]
                plus = b * per_blade + plus if plus >= 0 else n_ring
                minus = b * per_blade + minus if minus >= 0 else n_ring
                add_segment(at[start], at[end], work.distance[start], work.distance[end], core2[m], work.points,
                            1.0 - 2.0 * image, rings[plus], rings[minus])  # fmt: skip
    for r in range(n_ring):
        for c in range(3):
            for i in range(n_point):
                influence[r, c, i] = rings[r, c, i]


@kernel(fastmath=FAST, separate=True, distinct=True)
def eliminate_pivots(a, k0, width, rows):
    """Eliminate the pivot rows k0 to k0 + width - 1 of (n, n) among themselves, and copy them into ``rows`` (4, n)."""
    n = a.shape[0]
    for c in range(4):
        for m in range(n):
            rows[c, m] = a[k0 + c, m] if c < width else 0.0
    for c in range(width):
        k = k0 + c
        scale = 1.0 / rows[c, k]
        rows[c, k] = 1.0
        for m in range(n):
            rows[c, m] *= scale
        for d in range(width):
            if d != c:
                factor = rows[d, k]
                rows[d, k] = 0.0
                for m in range(n):
                    rows[d, m] -= factor * rows[c, m]
    for c in range(width):
        for m in range(n):
            a[k0 + c, m] = rows[c, m]


@kernel(fastmath=FAST, separate=True, distinct=True)
def subtract_pivots(a, k0, width, factors, rows):
    """Clear the pivot columns in all other rows of (n, n) with the pivot rows (4, n); ``factors`` (4,) is work."""
    for r in range(a.shape[0]):
        if k0 <= r < k0 + width:
            continue
        row = a[r]
        for c in range(4):
            factors[c] = 0.0
            if c < width:
                factors[c] = row[k0 + c]
                row[k0 + c] = 0.0
        f0, f1, f2, f3 = factors[0], factors[1], factors[2], factors[3]
        for m in range(row.shape[0]):
            row[m] -= f0 * rows[0, m] + f1 * rows[1, m] + f2 * rows[2, m] + f3 * rows[3, m]


@kernel(fastmath=False)
def invert(a, swap, panel, rows):
    """Inverse of a square matrix in its place, by Gauss-Jordan elimination with row pivoting, four pivots at a time.

    Four pivots read and write every other row once instead of four times. LAPACK is as fast on an idle machine, but its
    threads wait for each other on a busy one: calls of 0.6 s instead of 2 ms were seen.

    Parameters
    ----------
    a : (n, n)
    swap : int64 (n,); panel : (n, 4); rows : (4, n)
        For work.
    """
    n = a.shape[0]
    for k0 in range(0, n, 4):
        width = min(4, n - k0)
        for r in range(k0, n):
            for c in range(width):
                panel[r, c] = a[r, k0 + c]
        for c in range(width):
            k = k0 + c
            pivot = k
            for r in range(k + 1, n):
                if abs(panel[r, c]) > abs(panel[pivot, c]):
                    pivot = r
            swap[k] = pivot
            if pivot != k:
                for m in range(width):
                    panel[k, m], panel[pivot, m] = panel[pivot, m], panel[k, m]
                for m in range(n):
                    a[k, m], a[pivot, m] = a[pivot, m], a[k, m]
            scale = 1.0 / panel[k, c]
            for r in range(k + 1, n):
                factor = panel[r, c] * scale
                for m in range(c + 1, width):
                    panel[r, m] -= factor * panel[k, m]
        eliminate_pivots(a, k0, width, rows)
        subtract_pivots(a, k0, width, panel[0], rows)
    for k in range(n - 1, -1, -1):
        pivot = swap[k]
        if pivot != k:
            for r in range(n):
                a[r, k], a[r, pivot] = a[r, pivot], a[r, k]


@kernel(fastmath=FAST, inline="always")
def invert_boundary_condition(influence, normal, n_blade, n_chord, n_span, swap, panel, rows, inverse, response):
    """Inverse of the normal-velocity matrix and the strips' response to decambering.

    inverse (n_ring, n_ring): circulations = inverse @ normal velocities that the rings must induce.
    response (n_strip, n_strip): circulation at the trailing edge per uniform normal velocity of a strip.
    """
    n_ring = n_blade * n_chord * n_span
    for source in range(n_ring):
        for r in range(n_ring):
            inverse[r, source] = (
                influence[source, 0, r] * normal[r, 0]
                + influence[source, 1, r] * normal[r, 1]
                + influence[source, 2, r] * normal[r, 2]
            )
    invert(inverse, swap, panel, rows)
    for b in range(n_blade):
        for j in range(n_span):
            edge_ring = (b * n_chord + n_chord - 1) * n_span + j
            for b2 in range(n_blade):
                for j2 in range(n_span):
                    total = 0.0
                    for i in range(n_chord):
                        total += inverse[edge_ring, (b2 * n_chord + i) * n_span + j2]
                    response[b * n_span + j, b2 * n_span + j2] = total
