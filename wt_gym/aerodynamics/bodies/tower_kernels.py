"""The tower as a slender cylinder: its potential flow at the blades, and the wake nodes that came too close to it."""

import numpy as np

from wt_gym.base.compiled import kernel


@kernel(fastmath=False)
def radius_at(along, stations, radii):
    """Radius at the distance ``along`` from the base: linear between the stations, constant beyond."""
    last = stations.shape[0] - 1
    if along <= stations[0]:
        return radii[0]
    if along >= stations[last]:
        return radii[last]
    k = 1
    while stations[k] < along:
        k += 1
    share = (along - stations[k - 1]) / (stations[k] - stations[k - 1])
    return radii[k - 1] + share * (radii[k] - radii[k - 1])


@kernel(fastmath=False)
def add_tower_flow(points, wind, base, top, stations, radii):
    """Add the flow past the tower to the wind (n, 3) at points (n, 3); false if the tower has no height."""
    tx, ty, tz = top[0] - base[0], top[1] - base[1], top[2] - base[2]
    height = np.sqrt(tx * tx + ty * ty + tz * tz)
    if not height > 0.0:
        return False
    tx, ty, tz = tx / height, ty / height, tz / height
    for i in range(points.shape[0]):
        x, y, z = points[i, 0] - base[0], points[i, 1] - base[1], points[i, 2] - base[2]
        along = x * tx + y * ty + z * tz
        x, y, z = x - along * tx, y - along * ty, z - along * tz
        distance2 = x * x + y * y + z * z
        radius = radius_at(along, stations, radii)
        # Distance from the nearer end, positive inside: the disturbance is halved at the very end.
        fade = 0.5 * (1.0 + np.tanh(2.0 * min(along, height - along) / radius))
        u, v, w = wind[i, 0], wind[i, 1], wind[i, 2]
        axial = u * tx + v * ty + w * tz
        u, v, w = u - axial * tx, v - axial * ty, w - axial * tz
        radial = 2.0 * (u * x + v * y + w * z) / max(distance2, 1e-12)
        strength = fade * radius * radius / max(distance2, radius * radius)
        wind[i, 0] += strength * (u - radial * x)
        wind[i, 1] += strength * (v - radial * y)
        wind[i, 2] += strength * (w - radial * z)
    return True


@kernel(fastmath=False)
def _segment_near_tower(start, end, base, axis, height, stations, radii, reach):
    """Whether a segment comes within ``reach`` radii of the tower; ``axis`` is its unit direction."""
    a0, a1 = 0.0, 0.0
    for c in range(3):
        a0 += (start[c] - base[c]) * axis[c]
        a1 += (end[c] - base[c]) * axis[c]
    # Part of the segment at the heights of the tower.
    beyond = (reach - 1.0) * radius_at(min(max(a0, 0.0), height), stations, radii)
    low, high = 0.0, 1.0
    if a1 != a0:
        u, v = (-beyond - a0) / (a1 - a0), (height + beyond - a0) / (a1 - a0)
        low, high = max(low, min(u, v)), min(high, max(u, v))
    elif a0 < -beyond or a0 > height + beyond:
        return False
    if low > high:
        return False
    # Nearest point of that part to the axis.
    dot, square = 0.0, 0.0
    for c in range(3):
        across = start[c] - base[c] - a0 * axis[c]
        change = end[c] - start[c] - (a1 - a0) * axis[c]
        dot += across * change
        square += change * change
    u = min(max(-dot / square, low), high) if square > 0.0 else low
    distance2 = 0.0
    for c in range(3):
        across = start[c] + u * (end[c] - start[c]) - base[c] - (a0 + u * (a1 - a0)) * axis[c]
        distance2 += across * across
    radius = radius_at(a0 + u * (a1 - a0), stations, radii)
    return distance2 < (reach * radius) ** 2


@kernel(fastmath=False)
def flag_wake_segments(wake, n_rows, base, top, stations, radii, reach, flags):
    """Mark the wake segments that come within ``reach`` tower radii of the tower; returns how many those are.

    Such segments are dropped, so that the wake does not cut through the tower (Gebhardt et al. 2012 take 1.2 radii).
    The flow around a closed tower keeps the nodes of the wake outside, but segments between nodes on both of its sides
    cut through it when they are longer than the tower is wide. Beyond the ends the tower reaches ``reach`` - 1 radii
    farther.

    Parameters
    ----------
    wake : (n_max + 1, n_blade, n_node, 3)
        Wake nodes [m]; segments that end in rows 2..n_rows are looked at.
    base, top : (3,)
        Ends of the tower axis [m].
    stations, radii : (n,)
        Radii at increasing distances from the base [m].
    flags : int8, (n_max + 1, n_blade, n_node)
        Sum of 1 when the trailing segment and 2 when the spanwise segment that end in the node, coming from the same
        node of the row before and from the node before in the row, are marked.
    """
    height2, widest = 0.0, 0.0
    for c in range(3):
        height2 += (top[c] - base[c]) ** 2
    height = np.sqrt(height2)
    axis = ((top[0] - base[0]) / height, (top[1] - base[1]) / height, (top[2] - base[2]) / height)
    for k in range(radii.shape[0]):
        widest = max(widest, reach * radii[k])
    count = 0
    for k in range(n_rows + 1):
        for b in range(wake.shape[1]):
            for j in range(wake.shape[2]):
                flags[k, b, j] = 0
                if k < 2:
                    continue
                end = wake[k, b, j]
                for spanwise in range(2 if j > 0 else 1):
                    start = wake[k, b, j - 1] if spanwise == 1 else wake[k - 1, b, j]
                    # A box around both ends that does not touch the tower's decides most cases.
                    far = False
                    for c in range(3):
                        low, high = min(base[c], top[c]) - widest, max(base[c], top[c]) + widest
                        far = far or max(start[c], end[c]) < low or min(start[c], end[c]) > high
                    if not far and _segment_near_tower(start, end, base, axis, height, stations, radii, reach):
                        flags[k, b, j] += 1 + spanwise
                        count += 1
    return count
