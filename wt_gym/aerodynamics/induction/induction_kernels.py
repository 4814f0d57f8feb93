"""Velocity induced by sheets of vortex segments: the inner loops of the free wake.

A smooth-core segment from x1 to x2 with circulation G induces, with r1 = x - x1 and r2 = x - x2,

    v = G / (4 pi) (|r1| + |r2|) (r1 x r2) / (|r1| |r2| (|r1| |r2| + r1 . r2) + (rc |x2 - x1|)^2),

which is the Biot-Savart law of a straight segment, regularized without a branch (van Garrel, ECN-C--03-079, eq. A.9).

A sheet is an array ``(n_row, n_sheet, n_node, 7)`` float32 of nodes, each with the two segments that end in it:
x, y, z, trailing strength, trailing core, spanwise strength, spanwise core. The trailing segment comes from the same
node of the row before, the spanwise one from the node before in the same row; strength is G / (4 pi), core (rc l)^2.

A vector of 16 targets passes along all nodes: its position and velocity stay in registers, and only the vectors to the
nodes of two rows go through memory. The distances of a whole row are computed before its segments: one loop over both
would be a chain of dependent operations so long that the processor could not look far enough ahead to fill its waiting
times.
"""

import numpy as np

from wt_gym.aerodynamics.induction.simd_kernels import WIDTH, load, reciprocal, reciprocal_root, spread, store
from wt_gym.compiled import kernel

TINY = np.float32(1e-30)  # [m^2] keeps the distance of a target that lies on a node from becoming NaN
ZERO = np.float32(0.0)
ONE = np.float32(1.0)
FOUR_PI = 4.0 * np.pi
# NaN and infinity keep their meaning (no nnan, no ninf), so that a broken state shows.
FAST = {"contract", "afn", "arcp", "reassoc", "nsz"}


@kernel(fastmath=False, nogil=True, separate=True)
def direct_induction(sheet, targets, velocity, first, last, scratch):
    """Add the velocity of all sheets at targets ``first`` to ``last`` - 1.

    Trailing segments into the first row have no start and are left out. Ranges that do not overlap may run in several
    threads at once, each with its own ``scratch``.

    Parameters
    ----------
    sheet : float32, (n_row, n_sheet, n_node, 7)
    targets, velocity : float32, (3, n)
    first, last : int
        Multiples of `WIDTH`.
    scratch : float32, (at least 8 * WIDTH * n_node,)
        The vectors and distances of the row before and of the present one.
    """
    n_row, n_sheet, n_node, _ = sheet.shape
    n = targets.shape[1]
    zero = spread(ZERO)
    one = spread(ONE)
    tiny = spread(TINY)
    for o in range(first, last, WIDTH):
        x = load(targets, o)
        y = load(targets, n + o)
        z = load(targets, 2 * n + o)
        u = zero
        v = zero
        w = zero
        for s in range(n_sheet):
            before = 0
            here = 4 * WIDTH * n_node
            # Vectors of zero length and distance one stand for the neighbors that the first row and node lack.
            for at in range(before, here, 4 * WIDTH):
                store(scratch, at, zero)
                store(scratch, at + WIDTH, zero)
                store(scratch, at + 2 * WIDTH, zero)
                store(scratch, at + 3 * WIDTH, one)
            for k in range(n_row):
                for j in range(n_node):
                    rx = x - spread(sheet[k, s, j, 0])
                    ry = y - spread(sheet[k, s, j, 1])
                    rz = z - spread(sheet[k, s, j, 2])
                    square = rx * rx + ry * ry + rz * rz + tiny
                    at = here + 4 * WIDTH * j
                    store(scratch, at, rx)
                    store(scratch, at + WIDTH, ry)
                    store(scratch, at + 2 * WIDTH, rz)
                    store(scratch, at + 3 * WIDTH, square * reciprocal_root(square))
                qx = zero
                qy = zero
                qz = zero
                qr = one
                for j in range(n_node):
                    at = here + 4 * WIDTH * j
                    rx = load(scratch, at)
                    ry = load(scratch, at + WIDTH)
                    rz = load(scratch, at + 2 * WIDTH)
                    r = load(scratch, at + 3 * WIDTH)
                    at = before + 4 * WIDTH * j
                    px = load(scratch, at)
                    py = load(scratch, at + WIDTH)
                    pz = load(scratch, at + 2 * WIDTH)
                    pr = load(scratch, at + 3 * WIDTH)
                    a = pr * r
                    b = qr * r
                    da = a * (a + px * rx + py * ry + pz * rz) + spread(sheet[k, s, j, 4])
                    db = b * (b + qx * rx + qy * ry + qz * rz) + spread(sheet[k, s, j, 6])
                    # one reciprocal of the product would overflow 60 km away
                    ka = spread(sheet[k, s, j, 3]) * (pr + r) * reciprocal(da)
                    kb = spread(sheet[k, s, j, 5]) * (qr + r) * reciprocal(db)
                    fx = ka * px + kb * qx
                    fy = ka * py + kb * qy
                    fz = ka * pz + kb * qz
                    u = u + (fy * rz - fz * ry)
                    v = v + (fz * rx - fx * rz)
                    w = w + (fx * ry - fy * rx)
                    qx = rx
                    qy = ry
                    qz = rz
                    qr = r
                before, here = here, before
        store(velocity, o, load(velocity, o) + u)
        store(velocity, n + o, load(velocity, n + o) + v)
        store(velocity, 2 * n + o, load(velocity, 2 * n + o) + w)
