"""The tower as a slender cylinder: its potential flow at the blades, and the wake nodes that came too close to it."""

import numpy as np

from wt_gym.compiled import kernel


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
def flag_wake_nodes(wake, n_rows, base, top, stations, radii, reach, flags):
    """Mark the wake nodes within ``reach`` tower radii of the tower; returns how many those are.

    Segments that end in such a node are dropped, so that the wake does not cut through the tower (Gebhardt et al.
    2012 take 1.2 radii). Beyond the ends the tower reaches ``reach`` - 1 radii farther.

    Parameters
    ----------
    wake : (n_max + 1, n_blade, n_node, 3)
        Wake nodes [m], of which rows 1..n_rows are looked at; row 0, the trailing edge, belongs to the blade.
    base, top : (3,)
        Ends of the tower axis [m].
    stations, radii : (n,)
        Radii at increasing distances from the base [m].
    flags : int8, (n_max + 1, n_blade, n_node)
        1 for marked nodes, else 0.
    """
    tx, ty, tz = top[0] - base[0], top[1] - base[1], top[2] - base[2]
    height = np.sqrt(tx * tx + ty * ty + tz * tz)
    tx, ty, tz = tx / height, ty / height, tz / height
    widest = 0.0
    for k in range(radii.shape[0]):
        widest = max(widest, reach * radii[k])
    count = 0
    for k in range(n_rows + 1):
        for b in range(wake.shape[1]):
            for j in range(wake.shape[2]):
                flags[k, b, j] = 0
                x, y, z = wake[k, b, j, 0] - base[0], wake[k, b, j, 1] - base[1], wake[k, b, j, 2] - base[2]
                along = x * tx + y * ty + z * tz
                distance2 = x * x + y * y + z * z - along * along
                if k > 0 and distance2 < widest * widest:
                    radius = radius_at(along, stations, radii)
                    beyond = (reach - 1.0) * radius
                    if distance2 < (reach * radius) ** 2 and -beyond < along < height + beyond:
                        flags[k, b, j] = 1
                        count += 1
    return count
