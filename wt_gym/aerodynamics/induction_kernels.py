"""Velocity induced by sheets of vortex segments: the inner loops of the free wake.

A smooth-core segment from x1 to x2 with circulation G induces, with r1 = x - x1 and r2 = x - x2,

    v = G / (4 pi) (|r1| + |r2|) (r1 x r2) / (|r1| |r2| (|r1| |r2| + r1 . r2) + (rc |x2 - x1|)^2),

which is the Biot-Savart law of a straight segment, regularised without a branch (van Garrel, ECN-C--03-079, eq. A.9).

A sheet is an array ``(n_row, n_sheet, n_node, 7)`` float32 of nodes, each with the two segments that end in it:
x, y, z, trailing strength, trailing core, spanwise strength, spanwise core. The trailing segment comes from the same
node of the row before, the spanwise one from the node before in the same row; strength is G / (4 pi), core (rc l)^2.
"""

import numpy as np

from wt_gym.compiled import kernel

# NaN and infinity keep their meaning (no nnan, no ninf), so that a broken state shows.
FAST = {"contract", "afn", "arcp", "reassoc", "nsz"}
MAX_LANES = 160  # targets of one block: their 4 numbers at each node of two rows must stay in the first-level cache
ONE = np.float32(1.0)
ZERO = np.float32(0.0)
FOUR_PI = 4.0 * np.pi
NO_CIRCULATION = 1e-12  # [m^2/s]
LAMB = 4.0 * 1.25643  # growth of the Lamb-Oseen core, rc^2 = 4 * 1.25643 nu t


@kernel(fastmath=False)
def lane_count(n_target):
    """Lanes per block: blocks of equal size, a multiple of 16, not above `MAX_LANES`."""
    n_block = (n_target + MAX_LANES - 1) // MAX_LANES
    return ((n_target + n_block - 1) // n_block + 15) // 16 * 16


@kernel(fastmath=FAST)
def sheet_induction(sheet, targets, velocity, scratch):
    """Add the velocity of all sheets at the targets.

    Trailing segments into the first row have no start and are left out. Targets are the vector lanes; the vector and
    distance from a node to a target are computed once and kept for the segment to the next node and the one to the
    next row, and the cross products of the two segments that end in a node are one, (k1 r1 + k2 r2) x r.

    Parameters
    ----------
    sheet : float32, (n_row, n_sheet, n_node, 7)
    targets, velocity : float32, (3, n)
        n is a multiple of ``lane_count(n)``; see there.
    scratch : float32, (at least (4 n_node + 10) * MAX_LANES,)
    """
    n_sheet = sheet.shape[1]
    n_node = sheet.shape[2]
    n_target = targets.shape[1]
    if n_target == 0:
        return
    n_lane = lane_count(n_target)
    lane = scratch[: (4 * n_node + 10) * n_lane].reshape((4 * n_node + 10, n_lane))
    for block in range(n_target // n_lane):
        o = block * n_lane
        for i in range(n_lane):
            lane[0, i] = targets[0, o + i]
            lane[1, i] = targets[1, o + i]
            lane[2, i] = targets[2, o + i]
            lane[3, i] = ZERO
            lane[4, i] = ZERO
            lane[5, i] = ZERO
        for s in range(n_sheet):
            # Vectors of zero length and distance one stand for the neighbours that the first row and node lack.
            for j in range(n_node + 1):
                for i in range(n_lane):
                    lane[6 + 4 * j, i] = ZERO
                    lane[7 + 4 * j, i] = ZERO
                    lane[8 + 4 * j, i] = ZERO
                    lane[9 + 4 * j, i] = ONE
            for k in range(sheet.shape[0]):
                for j in range(n_node):
                    xn = sheet[k, s, j, 0]
                    yn = sheet[k, s, j, 1]
                    zn = sheet[k, s, j, 2]
                    trail = sheet[k, s, j, 3]
                    trail_core = sheet[k, s, j, 4]
                    span = sheet[k, s, j, 5]
                    span_core = sheet[k, s, j, 6]
                    q = lane[6 + 4 * j : 10 + 4 * j]
                    p = lane[10 + 4 * j : 14 + 4 * j]
                    for i in range(n_lane):
                        rx = lane[0, i] - xn
                        ry = lane[1, i] - yn
                        rz = lane[2, i] - zn
                        r = np.sqrt(rx * rx + ry * ry + rz * rz)
                        px = p[0, i]
                        py = p[1, i]
                        pz = p[2, i]
                        pr = p[3, i]
                        qx = q[0, i]
                        qy = q[1, i]
                        qz = q[2, i]
                        qr = q[3, i]
                        a = pr * r
                        b = qr * r
                        da = a * (a + px * rx + py * ry + pz * rz) + trail_core
                        db = b * (b + qx * rx + qy * ry + qz * rz) + span_core
                        inverse = ONE / (da * db)
                        ka = trail * (pr + r) * db * inverse
                        kb = span * (qr + r) * da * inverse
                        fx = ka * px + kb * qx
                        fy = ka * py + kb * qy
                        fz = ka * pz + kb * qz
                        lane[3, i] += fy * rz - fz * ry
                        lane[4, i] += fz * rx - fx * rz
                        lane[5, i] += fx * ry - fy * rx
                        p[0, i] = rx
                        p[1, i] = ry
                        p[2, i] = rz
                        p[3, i] = r
        for i in range(n_lane):
            velocity[0, o + i] += lane[3, i]
            velocity[1, o + i] += lane[4, i]
            velocity[2, o + i] += lane[5, i]


@kernel(fastmath=False)
def build_sheet(bound, gamma, wake, wake_gamma, n_rows, age, edge_chord, wake_core, viscosity, squire, origin, closed,
                sheet):  # fmt: skip
    """Write bound lattice and wake as one sheet of merged segments, relative to ``origin``.

    Rows 0..n_chord are the bound nodes (row n_chord is the trailing edge and wake row 0), rows n_chord + k the wake
    rows. A segment shared by two rings carries the difference of their circulations. Without ``closed`` the last
    spanwise segment is left out: the far wake continues there.

    Parameters
    ----------
    bound : (n_blades, n_chord + 1, n_node, 3); gamma : (n_blades, n_chord, n_span)
    wake : (n_max + 1, n_blades, n_node, 3); wake_gamma : (n_max, n_blades, n_span)
    sheet : float32 (n_chord + 1 + n_max, n_blades, n_node, 7)
    """
    n_blade, n_edge_row, n_node, _ = bound.shape
    n_chord = n_edge_row - 1
    for k in range(n_chord + n_rows + 1):
        w = k - n_chord
        for s in range(n_blade):
            for j in range(n_node):
                core0 = (wake_core * edge_chord[j]) ** 2
                node_age = age[w] if w > 0 else 0.0
                here = bound[s, k, j] if w <= 0 else wake[w, s, j]
                for c in range(3):
                    sheet[k, s, j, c] = here[c] - origin[c]
                trail, trail_core, span, span_core = 0.0, 1.0, 0.0, 1.0
                if k > 0:
                    before = bound[s, k - 1, j] if w <= 0 else (wake[w - 1, s, j] if w > 1 else bound[s, n_chord, j])
                    length2 = (here[0] - before[0]) ** 2 + (here[1] - before[1]) ** 2 + (here[2] - before[2]) ** 2
                    if j > 0:
                        trail += gamma[s, k - 1, j - 1] if w <= 0 else wake_gamma[w - 1, s, j - 1]
                    if j < n_node - 1:
                        trail -= gamma[s, k - 1, j] if w <= 0 else wake_gamma[w - 1, s, j]
                    trail_core = (core0 + LAMB * (viscosity + squire * abs(trail)) * node_age) * length2
                if j > 0:
                    before = bound[s, k, j - 1] if w <= 0 else wake[w, s, j - 1]
                    length2 = (here[0] - before[0]) ** 2 + (here[1] - before[1]) ** 2 + (here[2] - before[2]) ** 2
                    if w < 0:
                        span += gamma[s, k, j - 1]
                    elif w < n_rows:
                        span += wake_gamma[w, s, j - 1]
                    if k > 0 and (closed or w < n_rows):
                        span -= gamma[s, k - 1, j - 1] if w <= 0 else wake_gamma[w - 1, s, j - 1]
                    span_core = (core0 + LAMB * (viscosity + squire * abs(span)) * node_age) * length2
                # Products with such a strength become denormal numbers, on which the processor is ten times slower.
                if abs(trail) < NO_CIRCULATION:
                    trail = 0.0
                if abs(span) < NO_CIRCULATION:
                    span = 0.0
                # A core of zero would divide zero by zero at a target on the segment.
                sheet[k, s, j, 3] = trail / FOUR_PI
                sheet[k, s, j, 4] = max(trail_core, 1e-12)
                sheet[k, s, j, 5] = span / FOUR_PI
                sheet[k, s, j, 6] = max(span_core, 1e-12)


@kernel(fastmath=False, inline="always")
def open_newest_ring(sheet, n_chord, n_rows, wake_gamma):
    """Take the ring between trailing edge and first wake row out of a sheet, for it belongs to the unknowns.

    Only rows from n_chord + 1 on are meant to be used afterwards.
    """
    k = n_chord + 1
    for s in range(sheet.shape[1]):
        for j in range(sheet.shape[2]):
            sheet[k, s, j, 3] = 0.0
            strength = wake_gamma[1, s, j - 1] if (j > 0 and n_rows > 1) else 0.0
            sheet[k, s, j, 5] = strength / FOUR_PI
