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
from wt_gym.base.compiled import kernel

TINY = np.float32(1e-30)  # [m^2] keeps the distance of a target that lies on a node from becoming NaN
ZERO = np.float32(0.0)
ONE = np.float32(1.0)
FOUR_PI = 4.0 * np.pi
# NaN and infinity keep their meaning (no nnan, no ninf), so that a broken state shows.
FAST = {"contract", "afn", "arcp", "reassoc", "nsz"}


@kernel(fastmath=False, inline="always")
def node_velocity(p, q, r, trailing, trailing_core, spanwise, spanwise_core):
    """Velocity of the two segments that end in a node, from the node before it in its column (p) and in its row (q).

    p, q, r are vectors from the nodes to the targets and their lengths; strengths and cores as in a sheet.
    """
    px, py, pz, pr = p
    qx, qy, qz, qr = q
    rx, ry, rz, rr = r
    a = pr * rr
    b = qr * rr
    da = a * (a + px * rx + py * ry + pz * rz) + spread(trailing_core)
    db = b * (b + qx * rx + qy * ry + qz * rz) + spread(spanwise_core)
    # one reciprocal of the product would overflow 60 km away
    ka = spread(trailing) * (pr + rr) * reciprocal(da)
    kb = spread(spanwise) * (qr + rr) * reciprocal(db)
    fx = ka * px + kb * qx
    fy = ka * py + kb * qy
    fz = ka * pz + kb * qz
    return fy * rz - fz * ry, fz * rx - fx * rz, fx * ry - fy * rx


@kernel(fastmath=False, inline="always")
def vector_from(node_x, node_y, node_z, x, y, z):
    """Vectors from a node to 16 targets, and their lengths."""
    rx = x - spread(node_x)
    ry = y - spread(node_y)
    rz = z - spread(node_z)
    square = rx * rx + ry * ry + rz * rz + spread(TINY)
    return rx, ry, rz, square * reciprocal_root(square)


@kernel(fastmath=False, inline="always")
def store_vector(scratch, at, vector):
    """Keep what `load_vector` reads."""
    store(scratch, at, vector[0])
    store(scratch, at + WIDTH, vector[1])
    store(scratch, at + 2 * WIDTH, vector[2])
    store(scratch, at + 3 * WIDTH, vector[3])


@kernel(fastmath=False, inline="always")
def load_vector(scratch, at):
    """Vectors of 16 targets to a node and their lengths, from a flat index on."""
    return (
        load(scratch, at),
        load(scratch, at + WIDTH),
        load(scratch, at + 2 * WIDTH),
        load(scratch, at + 3 * WIDTH),
    )


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
                store_vector(scratch, at, (zero, zero, zero, one))
            for k in range(n_row):
                for j in range(n_node):
                    r = vector_from(sheet[k, s, j, 0], sheet[k, s, j, 1], sheet[k, s, j, 2], x, y, z)
                    store_vector(scratch, here + 4 * WIDTH * j, r)
                q = zero, zero, zero, one
                for j in range(n_node):
                    r = load_vector(scratch, here + 4 * WIDTH * j)
                    p = load_vector(scratch, before + 4 * WIDTH * j)
                    du, dv, dw = node_velocity(
                        p, q, r, sheet[k, s, j, 3], sheet[k, s, j, 4], sheet[k, s, j, 5], sheet[k, s, j, 6]
                    )
                    u = u + du
                    v = v + dv
                    w = w + dw
                    q = r
                before, here = here, before
        store(velocity, o, load(velocity, o) + u)
        store(velocity, n + o, load(velocity, n + o) + v)
        store(velocity, 2 * n + o, load(velocity, 2 * n + o) + w)
