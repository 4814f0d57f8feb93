"""Velocity induced by sheets of vortex segments, every segment at every target, with sums kept in registers.

The formulas are those of `induction_kernels`. Here a vector of 16 targets passes along all nodes: its position and
velocity stay in registers, and only the vectors to the nodes of the last row go through memory. The distance of the
next node is computed ahead, beside the segments of the present one, because both are long chains of dependent
operations.
"""

import numpy as np

from wt_gym.aerodynamics.simd_kernels import WIDTH, load, reciprocal, reciprocal_root, spread, store
from wt_gym.compiled import kernel

TINY = np.float32(1e-30)  # [m^2] keeps the distance of a target that lies on a node from becoming NaN
ZERO = np.float32(0.0)
ONE = np.float32(1.0)


@kernel(fastmath=False, nogil=True)
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
    scratch : float32, (at least 4 * WIDTH * n_node,)
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
            # Vectors of zero length and distance one stand for the neighbours that the first row and node lack.
            for j in range(n_node):
                store(scratch, 4 * WIDTH * j, zero)
                store(scratch, 4 * WIDTH * j + WIDTH, zero)
                store(scratch, 4 * WIDTH * j + 2 * WIDTH, zero)
                store(scratch, 4 * WIDTH * j + 3 * WIDTH, one)
            for k in range(n_row):
                qx = zero
                qy = zero
                qz = zero
                qr = one
                next_x = x - spread(sheet[k, s, 0, 0])
                next_y = y - spread(sheet[k, s, 0, 1])
                next_z = z - spread(sheet[k, s, 0, 2])
                square = next_x * next_x + next_y * next_y + next_z * next_z + tiny
                next_r = square * reciprocal_root(square)
                for j in range(n_node):
                    rx = next_x
                    ry = next_y
                    rz = next_z
                    r = next_r
                    ahead = min(j + 1, n_node - 1)
                    next_x = x - spread(sheet[k, s, ahead, 0])
                    next_y = y - spread(sheet[k, s, ahead, 1])
                    next_z = z - spread(sheet[k, s, ahead, 2])
                    square = next_x * next_x + next_y * next_y + next_z * next_z + tiny
                    next_r = square * reciprocal_root(square)
                    at = 4 * WIDTH * j
                    px = load(scratch, at)
                    py = load(scratch, at + WIDTH)
                    pz = load(scratch, at + 2 * WIDTH)
                    pr = load(scratch, at + 3 * WIDTH)
                    a = pr * r
                    b = qr * r
                    da = a * (a + px * rx + py * ry + pz * rz) + spread(sheet[k, s, j, 4])
                    db = b * (b + qx * rx + qy * ry + qz * rz) + spread(sheet[k, s, j, 6])
                    inverse = reciprocal(da * db)
                    ka = spread(sheet[k, s, j, 3]) * (pr + r) * db * inverse
                    kb = spread(sheet[k, s, j, 5]) * (qr + r) * da * inverse
                    fx = ka * px + kb * qx
                    fy = ka * py + kb * qy
                    fz = ka * pz + kb * qz
                    u = u + (fy * rz - fz * ry)
                    v = v + (fz * rx - fx * rz)
                    w = w + (fx * ry - fy * rx)
                    store(scratch, at, rx)
                    store(scratch, at + WIDTH, ry)
                    store(scratch, at + 2 * WIDTH, rz)
                    store(scratch, at + 3 * WIDTH, r)
                    qx = rx
                    qy = ry
                    qz = rz
                    qr = r
        store(velocity, o, load(velocity, o) + u)
        store(velocity, n + o, load(velocity, n + o) + v)
        store(velocity, 2 * n + o, load(velocity, 2 * n + o) + w)
