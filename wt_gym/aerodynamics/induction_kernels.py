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
