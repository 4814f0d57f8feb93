"""Velocity induced by sheets of vortex segments at a cost that grows as N log N: a tree of clusters.

The sheet (layout: see `induction_kernels`) is cut into tiles of a few rows and nodes. The tiles, put in the order of a
Hilbert curve through their centers, are the leaves of a tree in which every cluster is `BRANCHES` neighbors on that
curve. A cluster far away acts through the expansion of the Biot-Savart law of its straight segments about its center
to second order,

    A(x) = M0 / d + (M1 d) / d^3 + (d Q d) / d^5,    v = curl A,    d = x - center,
    M0 = sum g l,  M1 = sum g l s,  Q = sum g l (3 s s - |s|^2 I) / 2

with g = G / (4 pi), l the vector along the segment, and s s averaged over its length, not only taken at the middle.
Targets too are put in the order of a Hilbert curve, and blocks of neighbors are served together: one walk through the
tree gathers the clusters that are far enough from the whole block and the tiles that are not; those act exactly, with
their smooth core.

Far enough means that the first neglected term, about sum |g l| |s|^3 / d^5, and the effect of the core, at most
sum |g l| (rc l)^2 / (2 d^6), are below a share of the ordered error, the same for all clusters (Salmon and Warren,
Journal of Computational Physics 111, 1994): a strong cluster is resolved more finely than a weak one at the same
distance.
"""

import numpy as np

from wt_gym.aerodynamics.induction.induction_kernels import (
    ONE,
    TINY,
    ZERO,
    load_vector,
    node_velocity,
    store_vector,
    vector_from,
)
from wt_gym.aerodynamics.induction.simd_kernels import WIDTH, load, reciprocal_root, spread, store
from wt_gym.base.compiled import kernel

TILE = 3  # most rows, and nodes, of a tile
BRANCHES = 4  # clusters in a cluster
TARGETS = 64  # targets of one block, a multiple of WIDTH
LIST = 512  # clusters or tiles gathered before they act on a block
OPENING = 0.8  # largest ratio of a cluster's radius to its distance from a block; the series converges below 1
SHARE = 0.15  # of the ordered error that one cluster may make: hundreds add up, mostly with changing sign
BITS = 10  # of each coordinate in a key
DIGIT = 1 << BITS  # the sort takes the key in three digits
STACK = 256  # clusters waiting in the walk
# A cluster's record of moments: center 0:3, M0 3:6, M1 6:15, Q 15:30 (xx, yy, 2 xy, 2 xz, 2 yz for each component of
# l; zz = -xx - yy), curl of the first-order polynomial 30:33, of the second-order one 33:42.
RECORD = 42
# Its measures: radius, sum |g l|, sum |g l| |s|^2, sum |g l| (rc l)^2 / 2.
MEASURES = 4


@kernel(fastmath=False, inline="always")
def _interleave(number):
    """Spread the lowest ten bits of a number to every third bit."""
    number = (number | (number << 16)) & 0x030000FF
    number = (number | (number << 8)) & 0x0300F00F
    number = (number | (number << 4)) & 0x030C30C3
    return (number | (number << 2)) & 0x09249249


@kernel
def hilbert_keys(points, n, keys):
    """Place of points (3, >= n) float32 along a Hilbert curve through their cube, into keys (>= n,) int32.

    Skilling, AIP Conference Proceedings 707, 381 (2004): undo the reflections and exchanges of each level from the
    coarsest, then the Gray code.
    """
    low0, low1, low2 = points[0, 0], points[1, 0], points[2, 0]
    high0, high1, high2 = low0, low1, low2
    for i in range(n):
        low0, high0 = min(low0, points[0, i]), max(high0, points[0, i])
        low1, high1 = min(low1, points[1, i]), max(high1, points[1, i])
        low2, high2 = min(low2, points[2, i]), max(high2, points[2, i])
    size = max(high0 - low0, max(high1 - low1, high2 - low2))
    scale = np.float32((DIGIT - 1) / size) if size > ZERO else ZERO
    for i in range(n):
        x = np.int32((points[0, i] - low0) * scale)
        y = np.int32((points[1, i] - low1) * scale)
        z = np.int32((points[2, i] - low2) * scale)
        for level in range(BITS - 1, 0, -1):
            below = np.int32((1 << level) - 1)
            set_x = -((x >> level) & 1)
            x ^= below & set_x
            set_y = -((y >> level) & 1)
            swap = (x ^ y) & below & ~set_y
            x ^= (below & set_y) | swap
            y ^= swap
            set_z = -((z >> level) & 1)
            swap = (x ^ z) & below & ~set_z
            x ^= (below & set_z) | swap
            z ^= swap
        y ^= x
        z ^= y
        flip = np.int32(0)
        for level in range(BITS - 1, 0, -1):
            flip ^= np.int32((1 << level) - 1) & -((z >> level) & 1)
        keys[i] = (_interleave(x ^ flip) << 2) | (_interleave(y ^ flip) << 1) | _interleave(z ^ flip)


@kernel(fastmath=False)
def sort_by_key(n, keys, order, spare_keys, spare_order, count):
    """Numbers 0..n-1 in ascending order of their keys, into ``order``: three passes of a radix sort."""
    for i in range(n):
        order[i] = i
    for digit in range(3):
        shift = digit * BITS
        source, target = (keys, spare_keys) if digit % 2 == 0 else (spare_keys, keys)
        old, new = (order, spare_order) if digit % 2 == 0 else (spare_order, order)
        for i in range(DIGIT):
            count[i] = 0
        for i in range(n):
            count[(source[i] >> shift) & (DIGIT - 1)] += 1
        total = 0
        for i in range(DIGIT):
            total, count[i] = total + count[i], total
        for i in range(n):
            d = (source[i] >> shift) & (DIGIT - 1)
            place = count[d]
            count[d] = place + 1
            target[place] = source[i]
            new[place] = old[i]
    for i in range(n):
        order[i] = spare_order[i]


# ---- the tree ----


@kernel(fastmath=False)
def tile_count(n_row, n_sheet, n_node):
    """Tiles of all sheets together."""
    return ((n_row + TILE - 1) // TILE) * n_sheet * ((n_node + TILE - 1) // TILE)


@kernel(fastmath=False, inline="always")
def _tile_bounds(sheet, tile):
    """First and last + 1 row, sheet, first and last + 1 node of a tile; tiles of one sheet are of nearly equal size."""
    n_row, n_sheet, n_node, _ = sheet.shape
    down, across = (n_row + TILE - 1) // TILE, (n_node + TILE - 1) // TILE
    b = tile % across
    s = (tile // across) % n_sheet
    a = tile // (across * n_sheet)
    return a * n_row // down, (a + 1) * n_row // down, s, b * n_node // across, (b + 1) * n_node // across


@kernel(inline="always")
def _leaf(sheet, bounds, segments, record, measures):
    """Moments and measures of the segments that end in the nodes of a tile."""
    k0, k1, s, j0, j1 = bounds[0], bounds[1], bounds[2], bounds[3], bounds[4]
    n = 0
    cx, cy, cz, total, core = 0.0, 0.0, 0.0, 0.0, 0.0
    for k in range(k0, k1):
        for j in range(j0, j1):
            for direction in range(2):
                m, i = (k - 1, j) if direction == 0 else (k, j - 1)
                if m < 0 or i < 0:
                    continue
                g = sheet[k, s, j, 3 + 2 * direction]
                lx = sheet[k, s, j, 0] - sheet[m, s, i, 0]
                ly = sheet[k, s, j, 1] - sheet[m, s, i, 1]
                lz = sheet[k, s, j, 2] - sheet[m, s, i, 2]
                x = sheet[k, s, j, 0] - np.float32(0.5) * lx
                y = sheet[k, s, j, 1] - np.float32(0.5) * ly
                z = sheet[k, s, j, 2] - np.float32(0.5) * lz
                # Without strength anywhere the center is the mean position.
                weight = abs(g) * np.sqrt(lx * lx + ly * ly + lz * lz) + TINY
                cx += weight * x
                cy += weight * y
                cz += weight * z
                total += weight
                core += weight * sheet[k, s, j, 4 + 2 * direction]
                row = segments[n]
                row[0], row[1], row[2], row[3], row[4], row[5] = x, y, z, lx, ly, lz
                row[6], row[7] = g, weight
                n += 1
    for c in range(RECORD):
        record[c] = ZERO
    for c in range(MEASURES):
        measures[c] = ZERO
    if n == 0:  # the first node of a sheet alone
        for c in range(3):
            record[c] = sheet[k0, s, j0, c]
        return
    ox, oy, oz = np.float32(cx / total), np.float32(cy / total), np.float32(cz / total)
    record[0], record[1], record[2] = ox, oy, oz
    radius2, spread2 = ZERO, ZERO
    twelfth = np.float32(1.0 / 12.0)
    for i in range(n):
        row = segments[i]
        x, y, z = row[0] - ox, row[1] - oy, row[2] - oz
        lx, ly, lz, g, weight = row[3], row[4], row[5], row[6], row[7]
        l2 = lx * lx + ly * ly + lz * lz
        s2 = x * x + y * y + z * z
        # The farthest point of a segment is one of its ends.
        radius2 = max(radius2, s2 + np.float32(0.25) * l2 + abs(x * lx + y * ly + z * lz))
        mean2 = s2 + twelfth * l2
        spread2 += weight * mean2
        third = mean2 * np.float32(1.0 / 3.0)
        qxx = np.float32(1.5) * (x * x + twelfth * lx * lx - third)
        qyy = np.float32(1.5) * (y * y + twelfth * ly * ly - third)
        qxy = np.float32(3.0) * (x * y + twelfth * lx * ly)
        qxz = np.float32(3.0) * (x * z + twelfth * lx * lz)
        qyz = np.float32(3.0) * (y * z + twelfth * ly * lz)
        for c in range(3):
            f = g * row[3 + c]
            record[3 + c] += f
            record[6 + 3 * c] += f * x
            record[7 + 3 * c] += f * y
            record[8 + 3 * c] += f * z
            record[15 + 5 * c] += f * qxx
            record[16 + 5 * c] += f * qyy
            record[17 + 5 * c] += f * qxy
            record[18 + 5 * c] += f * qxz
            record[19 + 5 * c] += f * qyz
    measures[0] = np.sqrt(radius2)
    measures[1] = total
    measures[2] = spread2
    measures[3] = np.float32(0.5) * core


@kernel(inline="always")
def _merge(records, measures, first, last, record, measure):
    """Moments and measures of a cluster from those of its parts ``first`` to ``last`` - 1."""
    for c in range(RECORD):
        record[c] = ZERO
    for c in range(MEASURES):
        measure[c] = ZERO
    total = ZERO
    for i in range(first, last):
        weight = measures[i, 1] + TINY
        for c in range(3):
            record[c] += weight * records[i, c]
        total += weight
    for c in range(3):
        record[c] /= total
    for i in range(first, last):
        part = records[i]
        x, y, z = part[0] - record[0], part[1] - record[1], part[2] - record[2]
        s2 = x * x + y * y + z * z
        measure[0] = max(measure[0], measures[i, 0] + np.sqrt(s2))
        measure[1] += measures[i, 1]
        measure[2] += measures[i, 2] + measures[i, 1] * s2
        measure[3] += measures[i, 3]
        for c in range(3):
            f = part[3 + c]
            mx, my, mz = part[6 + 3 * c], part[7 + 3 * c], part[8 + 3 * c]
            dot = mx * x + my * y + mz * z
            half = np.float32(1.5) * f
            third = np.float32(0.5) * f * s2
            record[3 + c] += f
            record[6 + 3 * c] += mx + f * x
            record[7 + 3 * c] += my + f * y
            record[8 + 3 * c] += mz + f * z
            record[15 + 5 * c] += part[15 + 5 * c] + np.float32(3.0) * mx * x - dot + half * x * x - third
            record[16 + 5 * c] += part[16 + 5 * c] + np.float32(3.0) * my * y - dot + half * y * y - third
            record[17 + 5 * c] += part[17 + 5 * c] + np.float32(3.0) * (mx * y + my * x + f * x * y)
            record[18 + 5 * c] += part[18 + 5 * c] + np.float32(3.0) * (mx * z + mz * x + f * x * z)
            record[19 + 5 * c] += part[19 + 5 * c] + np.float32(3.0) * (my * z + mz * y + f * y * z)


@kernel(inline="always")
def _finish(record, measure, limit):
    """Add the curls to a record; return the distance from which on the cluster may act through its moments."""
    mx, my, mz = record[6:9], record[9:12], record[12:15]
    record[30] = mz[1] - my[2]
    record[31] = mx[2] - mz[0]
    record[32] = my[0] - mx[1]
    qx, qy, qz = record[15:20], record[20:25], record[25:30]
    two = np.float32(2.0)
    zz_x, zz_y = -qx[0] - qx[1], -qy[0] - qy[1]
    # Row i, column l: 2 epsilon_ijk Q_k,jl; the stored mixed elements are twice those of Q.
    record[33] = qz[2] - qy[3]
    record[34] = two * qz[1] - qy[4]
    record[35] = qz[4] - two * zz_y
    record[36] = qx[3] - two * qz[0]
    record[37] = qx[4] - qz[2]
    record[38] = two * zz_x - qz[3]
    record[39] = two * qy[0] - qx[2]
    record[40] = qy[2] - two * qx[1]
    record[41] = qy[3] - qx[4]
    reach = measure[0] / np.float32(OPENING)
    if measure[1] > ZERO:
        share = np.float32(SHARE) * limit
        third_moment = measure[2] * np.sqrt(measure[2] / measure[1])
        reach = max(reach, (third_moment / share) ** np.float32(0.2))
        reach = max(reach, (measure[3] / share) ** np.float32(1.0 / 6.0))
    return reach


@kernel
def order_tiles(sheet, tree):
    """Put the tiles of a sheet in the order of a Hilbert curve; returns their number.

    Parameters
    ----------
    sheet : float32, (n_row, n_sheet, n_node, 7)
    tree : Tree
        Work arrays; see `tree_induction.Tree`.
    """
    n = tile_count(sheet.shape[0], sheet.shape[1], sheet.shape[2])
    for tile in range(n):
        k0, k1, s, j0, j1 = _tile_bounds(sheet, tile)
        for c in range(3):
            tree.centers[c, tile] = sheet[(k0 + k1) // 2, s, (j0 + j1) // 2, c]
    hilbert_keys(tree.centers, n, tree.keys)
    sort_by_key(n, tree.keys, tree.tiles, tree.spare_keys, tree.spare_order, tree.count)
    return n


@kernel(nogil=True)
def plant_leaves(sheet, tree, first, last, segments):
    """Moments of the tiles number ``first`` to ``last`` - 1 in their order; parts may be planted in several threads.

    segments : float32, (2 * TILE * TILE, 8)
        For work.
    """
    for i in range(first, last):
        bounds = tree.bounds[i]
        bounds[0], bounds[1], bounds[2], bounds[3], bounds[4] = _tile_bounds(sheet, tree.tiles[i])
        _leaf(sheet, bounds, segments, tree.records[i], tree.measures[i])
        tree.parts[i, 0] = -1
        tree.parts[i, 1] = -1


@kernel
def grow_tree(tree, n, limit):
    """Build the clusters above ``n`` leaves.

    limit : float
        Root mean square error of the velocity that may be made [m/s], positive; a cluster acts through its moments
        where they are good to the share `SHARE` of it.
    """
    first, last = 0, n
    while last - first > 1:
        new = last
        for part in range(first, last, BRANCHES):
            end = min(part + BRANCHES, last)
            _merge(tree.records, tree.measures, part, end, tree.records[new], tree.measures[new])
            tree.parts[new, 0] = part
            tree.parts[new, 1] = end
            new += 1
        first, last = last, new
    for i in range(last):
        tree.reach[i] = _finish(tree.records[i], tree.measures[i], np.float32(limit))
    tree.root[0] = last - 1


# ---- the velocity of clusters and tiles ----


@kernel(fastmath=False, inline="always")
def _add_clusters(records, chosen, n_chosen, targets, velocity, o):
    """Add the velocity of clusters through their moments at targets o to o + 15 of a block (3, TARGETS)."""
    x = load(targets, o)
    y = load(targets, TARGETS + o)
    z = load(targets, 2 * TARGETS + o)
    u = load(velocity, o)
    v = load(velocity, TARGETS + o)
    w = load(velocity, 2 * TARGETS + o)
    three = spread(np.float32(3.0))
    five_thirds = spread(np.float32(5.0 / 3.0))
    for i in range(n_chosen):
        c = records[chosen[i]]
        dx = x - spread(c[0])
        dy = y - spread(c[1])
        dz = z - spread(c[2])
        inverse = reciprocal_root(dx * dx + dy * dy + dz * dz)
        inverse2 = inverse * inverse
        inverse3 = inverse2 * inverse
        first = three * inverse2
        second = five_thirds * inverse2
        zz = dz * dz
        xx = dx * dx - zz
        yy = dy * dy - zz
        xy = dx * dy
        xz = dx * dz
        yz = dy * dz
        px = spread(c[15]) * xx + spread(c[16]) * yy + spread(c[17]) * xy + spread(c[18]) * xz + spread(c[19]) * yz
        py = spread(c[20]) * xx + spread(c[21]) * yy + spread(c[22]) * xy + spread(c[23]) * xz + spread(c[24]) * yz
        pz = spread(c[25]) * xx + spread(c[26]) * yy + spread(c[27]) * xy + spread(c[28]) * xz + spread(c[29]) * yz
        px = spread(c[6]) * dx + spread(c[7]) * dy + spread(c[8]) * dz + second * px
        py = spread(c[9]) * dx + spread(c[10]) * dy + spread(c[11]) * dz + second * py
        pz = spread(c[12]) * dx + spread(c[13]) * dy + spread(c[14]) * dz + second * pz
        px = spread(c[3]) + first * px
        py = spread(c[4]) + first * py
        pz = spread(c[5]) + first * pz
        qx = spread(c[33]) * dx + spread(c[34]) * dy + spread(c[35]) * dz
        qy = spread(c[36]) * dx + spread(c[37]) * dy + spread(c[38]) * dz
        qz = spread(c[39]) * dx + spread(c[40]) * dy + spread(c[41]) * dz
        u = u + inverse3 * (spread(c[30]) + inverse2 * qx + py * dz - pz * dy)
        v = v + inverse3 * (spread(c[31]) + inverse2 * qy + pz * dx - px * dz)
        w = w + inverse3 * (spread(c[32]) + inverse2 * qz + px * dy - py * dx)
    store(velocity, o, u)
    store(velocity, TARGETS + o, v)
    store(velocity, 2 * TARGETS + o, w)


@kernel(fastmath=False, inline="always")
def _add_tiles(sheet, bounds, chosen, n_chosen, targets, velocity, o, scratch):
    """Add the velocity of the segments of tiles at targets o to o + 15 of a block (3, TARGETS)."""
    zero = spread(ZERO)
    one = spread(ONE)
    x = load(targets, o)
    y = load(targets, TARGETS + o)
    z = load(targets, 2 * TARGETS + o)
    u = load(velocity, o)
    v = load(velocity, TARGETS + o)
    w = load(velocity, 2 * TARGETS + o)
    for i in range(n_chosen):
        tile = bounds[chosen[i]]
        k0, k1, s, j0, j1 = tile[0], tile[1], tile[2], tile[3], tile[4]
        # Vectors and distances from the nodes of the tile and those before them.
        at = 0
        for k in range(k0 - 1, k1):
            for j in range(j0 - 1, j1):
                if k < 0 or j < 0:
                    # Vectors of zero length and distance one stand for the neighbors that the first ones lack.
                    store_vector(scratch, at, (zero, zero, zero, one))
                else:
                    r = vector_from(sheet[k, s, j, 0], sheet[k, s, j, 1], sheet[k, s, j, 2], x, y, z)
                    store_vector(scratch, at, r)
                at += 4 * WIDTH
        row = 4 * WIDTH * (j1 - j0 + 1)
        at = row + 4 * WIDTH
        for k in range(k0, k1):
            for j in range(j0, j1):
                r = load_vector(scratch, at)
                p = load_vector(scratch, at - row)
                q = load_vector(scratch, at - 4 * WIDTH)
                du, dv, dw = node_velocity(
                    p, q, r, sheet[k, s, j, 3], sheet[k, s, j, 4], sheet[k, s, j, 5], sheet[k, s, j, 6]
                )
                u = u + du
                v = v + dv
                w = w + dw
                at += 4 * WIDTH
            at += 4 * WIDTH
    store(velocity, o, u)
    store(velocity, TARGETS + o, v)
    store(velocity, 2 * TARGETS + o, w)


# ---- the walk ----


@kernel(nogil=True)
def order_targets(targets, n_target, tree):
    """Put targets (3, >= n_target) in the order of a Hilbert curve, into ``tree.order``."""
    hilbert_keys(targets, n_target, tree.keys)
    sort_by_key(n_target, tree.keys, tree.order, tree.spare_keys, tree.spare_order, tree.count)


@kernel
def _sphere(points, first, last, sphere):
    """Center of the box around points, and the distance of the farthest one from it."""
    for c in range(3):
        low, high = points[c, first], points[c, first]
        for i in range(first, last):
            low, high = min(low, points[c, i]), max(high, points[c, i])
        sphere[c] = np.float32(0.5) * (low + high)
    radius2 = ZERO
    for i in range(first, last):
        dx, dy, dz = points[0, i] - sphere[0], points[1, i] - sphere[1], points[2, i] - sphere[2]
        radius2 = max(radius2, dx * dx + dy * dy + dz * dz)
    sphere[3] = np.sqrt(radius2)


@kernel(fastmath=False, inline="always")
def _act(sheet, tree, block, n_far, n_near):
    """Add the velocity of the gathered clusters and tiles at a block.

    A tile that is near to the block may be far enough from some of its vectors of targets.
    """
    far, near = block.group_far, block.group_near
    for group in range(TARGETS // WIDTH):
        o = group * WIDTH
        sphere = block.spheres[group + 1]
        x, y, z, radius = sphere[0], sphere[1], sphere[2], sphere[3]
        for m in range(n_far):
            far[m] = block.far[m]
        n_group_far, n_group_near = n_far, 0
        for m in range(n_near):
            i = block.near[m]
            d2 = (tree.records[i, 0] - x) ** 2 + (tree.records[i, 1] - y) ** 2 + (tree.records[i, 2] - z) ** 2
            is_far = d2 > (tree.reach[i] + radius) ** 2
            # Written to both lists and counted in one: a branch would be mispredicted every other time.
            far[n_group_far] = i
            near[n_group_near] = i
            n_group_far += is_far
            n_group_near += not is_far
        _add_clusters(tree.records, far, n_group_far, block.targets, block.velocity, o)
        _add_tiles(sheet, tree.bounds, near, n_group_near, block.targets, block.velocity, o, block.scratch)
        block.acted[0] += n_group_far
        block.acted[1] += n_group_near


@kernel(fastmath=False, nogil=True)
def walk_blocks(sheet, tree, targets, n_target, velocity, first_block, last_block, block):
    """Add the velocity of the sheet at the targets of blocks ``first_block`` to ``last_block`` - 1.

    Blocks are disjoint and the tree is only read: several threads may walk at once, each with its own ``block`` work
    arrays. The tree must have been planted for this sheet and the targets put in order.
    """
    here = block.targets
    induced = block.velocity
    spheres = block.spheres
    stack = block.stack
    for number in range(first_block, last_block):
        o = number * TARGETS
        n_here = min(TARGETS, n_target - o)
        for c in range(3):
            for i in range(TARGETS):
                here[c, i] = targets[c, tree.order[o + min(i, n_here - 1)]]
                induced[c, i] = ZERO
        _sphere(here, 0, TARGETS, spheres[0])
        for group in range(TARGETS // WIDTH):
            _sphere(here, group * WIDTH, (group + 1) * WIDTH, spheres[group + 1])
        x, y, z, radius = spheres[0, 0], spheres[0, 1], spheres[0, 2], spheres[0, 3]
        n_far, n_near = 0, 0
        stack[0] = tree.root[0]
        n_stack = 1
        while n_stack > 0:
            n_stack -= 1
            i = stack[n_stack]
            d2 = (tree.records[i, 0] - x) ** 2 + (tree.records[i, 1] - y) ** 2 + (tree.records[i, 2] - z) ** 2
            if d2 > (tree.reach[i] + radius) ** 2:
                block.far[n_far] = i
                n_far += 1
            elif tree.parts[i, 0] < 0:
                block.near[n_near] = i
                n_near += 1
            else:
                for part in range(tree.parts[i, 0], tree.parts[i, 1]):
                    stack[n_stack] = part
                    n_stack += 1
            if n_far == LIST or n_near == LIST or n_stack == 0:
                _act(sheet, tree, block, n_far, n_near)
                n_far, n_near = 0, 0
        for i in range(n_here):
            m = tree.order[o + i]
            velocity[0, m] += induced[0, i]
            velocity[1, m] += induced[1, i]
            velocity[2, m] += induced[2, i]
