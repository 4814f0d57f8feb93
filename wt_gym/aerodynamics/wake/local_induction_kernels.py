"""What the two segments that meet at a node leave out: the velocity that a curved filament induces at itself.

A node feels nothing of the two straight segments that meet in it. The arcs that they stand for would drive it along its
binormal: between a distance d and the length l of the segments, on both sides, by

    v = G / (4 pi) curvature binormal (ln(l1 / d) + ln(l2 / d)) / 2

(the element at angle phi of a ring of radius R induces G / (16 pi R) dphi / sin(phi / 2) at angle 0, Batchelor, An
Introduction to Fluid Dynamics, section 7.1). The distance d makes a ring with this cut-off as fast as the ring with its
core, 4 pi R V / G = ln(8 R / g) - 1/2 with the geometric mean distance g of the core's vorticity from itself (Saffman,
Vortex Dynamics, section 10.2): d = g exp(1/2) / 2. That is 0.874 rc for the core of Lamb and Oseen, whose constant is
0.558. A line of a lattice also stands for the sheet of width b about it, with g = b exp(-3/2): d = 0.184 b. Both
together count by the sum of their squares.

Without it a wake moves the faster the longer its segments are, by a logarithm that has no limit before they are as
short as their cores: Bhagwat & Leishman, J. Am. Helicopter Soc. 59 (2014); Wood, Wind Energ. Sci. 3, 345 (2018).

The velocity is asked for where the node is, on the smooth curve, while the corners of the sheet lie outside of it
(`curved_filaments`). A corner would see its neighbors from outside: between turns h apart, a distance e from the
sheet changes the mean of the speeds on its two sides by (pi / 3) e / h of half their difference, several per cent at
24 degrees. At the node the two segments that meet in the corner are near and mean nothing: they are taken away.
"""

import math

from wt_gym.aerodynamics.induction.induction_kernels import FOUR_PI
from wt_gym.base.compiled import kernel

CORE_CUT = 0.874  # cut-off over the radius of a Lamb-Oseen core, exp(0.558) / 2
SHEET_CUT = 0.184  # cut-off over the width of a flat sheet, exp(-1) / 2


@kernel(fastmath=False)
def trailing_strength(a, p, o, k, b, i):
    """Circulation of the segment from row k - 1 to row k at a node, or carrying node i in the sparse part [m^2/s]."""
    n_edge = a.wake_gamma.shape[2]
    if k <= o.sparse_from:
        inboard = a.wake_gamma[k - 1, b, i - 1] if i > 0 else 0.0
        return inboard - (a.wake_gamma[k - 1, b, i] if i < n_edge else 0.0)
    strength, j = 0.0, p.sparse_nodes[i]
    for strip in range(p.sparse_nodes[max(i - 1, 0)], j):
        strength += p.sparse_weight[strip] * a.wake_gamma[k - 1, b, strip]
    for strip in range(j, p.sparse_nodes[min(i + 1, p.sparse_nodes.shape[0] - 1)]):
        strength -= p.sparse_weight[strip] * a.wake_gamma[k - 1, b, strip]
    return strength


@kernel(fastmath=False, inline="always")
def _distance(x, y):
    return math.sqrt((x[0] - y[0]) ** 2 + (x[1] - y[1]) ** 2 + (x[2] - y[2]) ** 2)


@kernel(fastmath=False)
def local_velocity(before, here, after, cut, strength, out):
    """Velocity (3,) at ``here`` of the arcs from ``before`` and to ``after`` beyond the cut-off [m], see the module."""
    ax, ay, az = here[0] - before[0], here[1] - before[1], here[2] - before[2]
    bx, by, bz = after[0] - here[0], after[1] - here[1], after[2] - here[2]
    la, lb = math.sqrt(ax * ax + ay * ay + az * az), math.sqrt(bx * bx + by * by + bz * bz)
    product = la * lb * _distance(before, after)
    size = max(math.log(max(la, cut) / cut) + math.log(max(lb, cut) / cut), 0.0)
    # curvature of the circle through three points: 2 |a x b| / (|a| |b| |a + b|)
    factor = strength / FOUR_PI * size / product if product > 0.0 else 0.0
    out[0] = factor * (ay * bz - az * by)
    out[1] = factor * (az * bx - ax * bz)
    out[2] = factor * (ax * by - ay * bx)


@kernel(fastmath=False)
def take_segment(sheet, start, x, out):
    """Take away what the trailing segment that ends in a sheet's node ``sheet`` (7,) induces at x (3,)."""
    px, py, pz = x[0] - start[0], x[1] - start[1], x[2] - start[2]
    rx, ry, rz = x[0] - sheet[0], x[1] - sheet[1], x[2] - sheet[2]
    p, r = math.sqrt(px * px + py * py + pz * pz), math.sqrt(rx * rx + ry * ry + rz * rz)
    share = p * r * (p * r + px * rx + py * ry + pz * rz) + sheet[4]
    factor = sheet[3] * (p + r) / share if share > 0.0 else 0.0
    out[0] -= factor * (py * rz - pz * ry)
    out[1] -= factor * (pz * rx - px * rz)
    out[2] -= factor * (px * ry - py * rx)


@kernel(fastmath=False, inline="always")
def _on_ground(a, o, k, b, j):
    """Whether a node lies on the ground, where its mirror image takes away what its own filament does."""
    if not o.has_ground:
        return False
    return a.wake[k, b, j, 2] - o.ground < 0.01 * _distance(a.wake[k - 1, b, j], a.wake[k, b, j])


@kernel(fastmath=False, separate=True)
def add_local_velocity(p, o, a, w):
    """Put the arcs in the place of their segments at the rows whose turn it is, in the order of `gather_targets`."""
    n, n_rows = 0, a.n_rows[0]
    out, x = w.arc[0], w.arc[1]
    dense = min(n_rows, o.sparse_from)
    for m in range(w.n_turn[0]):
        k = w.rows[m]
        sparse = k > o.sparse_from
        n_node = p.sparse_nodes.shape[0] if sparse else a.wake.shape[2]
        for b in range(a.wake.shape[1]):
            for i in range(n_node):
                j = p.sparse_nodes[i] if sparse else i
                if k > 0 and n_rows > 1 and not _on_ground(a, o, k, b, j):
                    for c in range(3):
                        x[c], out[c] = w.targets[0, c, n], 0.0
                    here = w.sparse_sheet[k - o.sparse_from, b, i] if sparse else w.wake_sheet[k, b, i]
                    start = w.sparse_sheet[max(k - 1 - o.sparse_from, 0), b, i] if sparse else w.wake_sheet[k - 1, b, i]
                    take_segment(here, start, x, out)
                    if k < dense:
                        take_segment(w.wake_sheet[k + 1, b, i], here, x, out)
                    elif sparse and k < n_rows:
                        take_segment(w.sparse_sheet[k + 1 - o.sparse_from, b, i], here, x, out)
                    _add_arcs(p, o, a, k, b, i, j, sparse, here[4], x)
                    for c in range(3):
                        w.velocity[0, c, n] += out[c] + x[c]
                n += 1


@kernel(fastmath=False)
def _add_arcs(p, o, a, k, b, i, j, sparse, core, out):
    """Velocity (3,) of the arcs at a node of row k: node j of the edge, carrying node i; core (rc l)^2 [m^4]."""
    n_rows = a.n_rows[0]
    last = (p.sparse_nodes.shape[0] if sparse else a.wake.shape[2]) - 1
    inner, outer = max(i - 1, 0), min(i + 1, last)
    if sparse:
        inner, outer = p.sparse_nodes[inner], p.sparse_nodes[outer]
    width = 0.5 * _distance(a.wake[k, b, inner], a.wake[k, b, outer])
    length = max(_distance(a.wake[k - 1, b, j], a.wake[k, b, j]), 1e-6)
    cut = math.sqrt(CORE_CUT**2 * core / length**2 + (SHEET_CUT * width) ** 2) + 1e-9
    strength = trailing_strength(a, p, o, k, b, i)
    if k < n_rows and (sparse or k < o.sparse_from):
        strength = 0.5 * (strength + trailing_strength(a, p, o, k + 1, b, i))
    middle = min(k, n_rows - 1)  # the last row continues straight
    local_velocity(a.wake[middle - 1, b, j], a.wake[middle, b, j], a.wake[middle + 1, b, j], cut, strength, out)
