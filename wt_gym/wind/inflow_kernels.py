"""Compiled evaluation of the wind at many points: the mean profile, and frozen turbulence on top of it.

Angles in radians, lengths in meters, speeds in m/s. Those of velocities fill ``out`` (n, 3) and return the index of the
first point that is not finite, or -1.
"""

import math

from wt_gym.base.compiled import kernel

# No nnan, ninf or reassoc: each lets the optimizer drop a check for NaN (isfinite(x) is x - x == 0 to the compiler).
_FASTMATH = {"contract", "afn", "arcp", "nsz"}


# Share of the hub height below which a profile that grows downwards keeps its speed.
LOWEST_OF_NEGATIVE_SHEAR = 0.1


@kernel(fastmath=_FASTMATH)
def _jet_shape(z, jet_height):
    """Prandtl's profile, 1 at the nose: sqrt(2) exp(pi/4 - x) sin(x), x = pi z/(4 nose)."""
    place = 0.25 * math.pi * z / jet_height
    return math.sqrt(2.0) * math.exp(0.25 * math.pi - place) * math.sin(place)


@kernel(fastmath=_FASTMATH)
def _mean_speed(z, profile):
    """Speed at height z of a profile, see `SteadyInflow.kernel_profile`."""
    speed, hub_height, shear_exponent, roughness_length, jet_height, jet_share, _ = profile
    magnitude = _layer_speed(z, speed, hub_height, shear_exponent, roughness_length)
    if jet_height > 0.0:
        if z <= 0.0:
            return 0.0
        jet = speed * _jet_shape(z, jet_height) / _jet_shape(hub_height, jet_height)
        magnitude += jet_share * (jet - magnitude)
    return magnitude


@kernel(fastmath=_FASTMATH)
def _layer_speed(z, speed, hub_height, shear_exponent, roughness_length):
    if roughness_length > 0.0:
        if z <= roughness_length:
            return 0.0
        return speed * math.log(z / roughness_length) / math.log(hub_height / roughness_length)
    if shear_exponent > 0.0:
        if z <= 0.0:
            return 0.0
        return speed * math.exp(shear_exponent * math.log(z / hub_height))
    if shear_exponent < 0.0:
        return speed * math.exp(shear_exponent * math.log(max(z / hub_height, LOWEST_OF_NEGATIVE_SHEAR)))
    return speed


@kernel(fastmath=_FASTMATH)
def mean_velocity(points, profile, direction, inclination, out):
    """Velocity of a sheared, veered wind."""
    hub_height = profile[1]
    veer = profile[6]
    cos_direction = math.cos(direction)
    sin_direction = math.sin(direction)
    cos_inclination = math.cos(inclination)
    sin_inclination = math.sin(inclination)
    for i in range(points.shape[0]):
        x = points[i, 0]
        y = points[i, 1]
        z = points[i, 2]
        if not abs(x) + abs(y) + abs(z) < math.inf:
            return i
        height = z - hub_height
        magnitude = _mean_speed(z, profile)
        c = cos_direction
        s = sin_direction
        if veer != 0.0:
            c = math.cos(direction + veer * height)
            s = math.sin(direction + veer * height)
        out[i, 0] = magnitude * cos_inclination * c
        out[i, 1] = magnitude * cos_inclination * s
        out[i, 2] = magnitude * sin_inclination
    return -1


@kernel(fastmath=_FASTMATH)
def transient_velocity(
    points, profile, direction, inclination, speed_increment, turn, lateral_gradient, vertical_gradient, reach, out
):
    """Velocity of a sheared, veered wind with a speed increment, a turn and linear gradients at each point (n,).

    The gradients [1/s] act on the lateral and vertical distance from the hub axis, held beyond ``reach`` [m].
    """
    hub_height = profile[1]
    veer = profile[6]
    cos_inclination = math.cos(inclination)
    sin_inclination = math.sin(inclination)
    for i in range(points.shape[0]):
        x = points[i, 0]
        y = points[i, 1]
        z = points[i, 2]
        if not abs(x) + abs(y) + abs(z) < math.inf:
            return i
        height = z - hub_height
        heading = direction + turn[i]
        across = y * math.cos(heading) - x * math.sin(heading)
        magnitude = _mean_speed(z, profile) + speed_increment[i]
        magnitude += lateral_gradient[i] * min(max(across, -reach), reach)
        magnitude += vertical_gradient[i] * min(max(height, -reach), reach)
        heading += veer * height
        out[i, 0] = magnitude * cos_inclination * math.cos(heading)
        out[i, 1] = magnitude * cos_inclination * math.sin(heading)
        out[i, 2] = magnitude * sin_inclination
    return -1


@kernel(fastmath=_FASTMATH)
def _time_cell(time, along, speed, time_step, n_times):
    """Samples of a box before and after what passes a point now, and the share of the way between them.

    By Taylor's hypothesis it passed the hub plane along/speed ago.
    """
    cycles = (time - along / speed) / (time_step * n_times)
    place = (cycles - math.floor(cycles)) * n_times
    before = min(int(place), n_times - 1)
    return before, before + 1 if before + 1 < n_times else 0, place - before


@kernel(fastmath=_FASTMATH)
def _grid_cell(distance, spacing, n):
    """Grid point before a distance from the first of n, and the share of the way to the next; the ends hold beyond."""
    place = min(max(distance / spacing, 0.0), n - 1.0)
    before = min(int(place), n - 2)
    return before, place - before


@kernel(fastmath=_FASTMATH)
def turbulent_velocity(points, time, profile, direction, inclination, fluctuation, scale, time_step, spacing_y,
                       spacing_z, y_center, z_bottom, out):  # fmt: skip
    """Velocity of the mean wind plus ``scale`` times a box (n_times, n_z, n_y, 3) carried along at its speed."""
    speed = profile[0]
    hub_height = profile[1]
    veer = profile[6]
    n_times, n_z, n_y, _ = fluctuation.shape
    y_start = y_center - 0.5 * spacing_y * (n_y - 1)
    cos_direction = math.cos(direction)
    sin_direction = math.sin(direction)
    cos_inclination = math.cos(inclination)
    sin_inclination = math.sin(inclination)
    for i in range(points.shape[0]):
        x = points[i, 0]
        y = points[i, 1]
        z = points[i, 2]
        if not abs(x) + abs(y) + abs(z) < math.inf:
            return i
        height = z - hub_height

        # position in the frame of the wind: turned about the vertical and inclined about the hub
        ahead = x * cos_direction + y * sin_direction
        along = ahead * cos_inclination + height * sin_inclination
        across = y * cos_direction - x * sin_direction
        above = height * cos_inclination - ahead * sin_inclination + hub_height

        it, it_next, ft = _time_cell(time, along, speed, time_step, n_times)
        iy, fy = _grid_cell(across - y_start, spacing_y, n_y)
        iz, fz = _grid_cell(above - z_bottom, spacing_z, n_z)

        w00 = (1.0 - fz) * (1.0 - fy)
        w01 = (1.0 - fz) * fy
        w10 = fz * (1.0 - fy)
        w11 = fz * fy
        u = 0.0
        v = 0.0
        w = 0.0
        for k in range(2):
            t = it if k == 0 else it_next
            f = 1.0 - ft if k == 0 else ft
            for row in range(2):
                j = iz + row
                near = f * (w00 if row == 0 else w10)
                far = f * (w01 if row == 0 else w11)
                u += near * fluctuation[t, j, iy, 0] + far * fluctuation[t, j, iy + 1, 0]
                v += near * fluctuation[t, j, iy, 1] + far * fluctuation[t, j, iy + 1, 1]
                w += near * fluctuation[t, j, iy, 2] + far * fluctuation[t, j, iy + 1, 2]

        u *= scale
        v *= scale
        w *= scale
        magnitude = _mean_speed(z, profile)
        c = cos_direction
        s = sin_direction
        if veer != 0.0:
            c = math.cos(direction + veer * height)
            s = math.sin(direction + veer * height)
        forward = u * cos_inclination - w * sin_inclination
        out[i, 0] = magnitude * cos_inclination * c + forward * cos_direction - v * sin_direction
        out[i, 1] = magnitude * cos_inclination * s + forward * sin_direction + v * cos_direction
        out[i, 2] = (magnitude + u) * sin_inclination + w * cos_inclination
    return -1


@kernel(fastmath=_FASTMATH)
def add_tower_points(points, time, profile, direction, inclination, fluctuation, tower, scale, time_step, spacing_y,
                     spacing_z, y_center, z_bottom, out):  # fmt: skip
    """Below the grid of a box: exchange its lowest row in ``out`` for the wind between that row and the tower points.

    The points (n_times, n_tower, 3) are ``spacing_z`` apart, the first so far below the lowest row.
    """
    speed = profile[0]
    hub_height = profile[1]
    n_times, _, n_y, _ = fluctuation.shape
    n_tower = tower.shape[1]
    y_start = y_center - 0.5 * spacing_y * (n_y - 1)
    c = math.cos(direction)
    s = math.sin(direction)
    cos_inclination = math.cos(inclination)
    sin_inclination = math.sin(inclination)
    for i in range(points.shape[0]):
        height = points[i, 2] - hub_height
        ahead = points[i, 0] * c + points[i, 1] * s
        above = height * cos_inclination - ahead * sin_inclination + hub_height
        if not above < z_bottom:
            continue
        along = ahead * cos_inclination + height * sin_inclination
        it, it_next, ft = _time_cell(time, along, speed, time_step, n_times)
        iy, fy = _grid_cell(points[i, 1] * c - points[i, 0] * s - y_start, spacing_y, n_y)
        depth = min((z_bottom - above) / spacing_z, float(n_tower))
        level = min(int(depth), n_tower - 1)
        down = scale * (depth - level)  # share of the tower point below
        up = scale - down  # of that above, or of the lowest row
        change = (0.0, 0.0, 0.0)
        for k in range(2):
            t = it if k == 0 else it_next
            f = 1.0 - ft if k == 0 else ft
            u = v = w = 0.0
            for side in range(2):
                share = (1.0 - fy if side == 0 else fy) * (scale - (up if level == 0 else 0.0))
                u -= share * fluctuation[t, 0, iy + side, 0]
                v -= share * fluctuation[t, 0, iy + side, 1]
                w -= share * fluctuation[t, 0, iy + side, 2]
            if level > 0:
                u += up * tower[t, level - 1, 0]
                v += up * tower[t, level - 1, 1]
                w += up * tower[t, level - 1, 2]
            u += down * tower[t, level, 0]
            v += down * tower[t, level, 1]
            w += down * tower[t, level, 2]
            change = change[0] + f * u, change[1] + f * v, change[2] + f * w
        u, v, w = change
        forward = u * cos_inclination - w * sin_inclination
        out[i, 0] += forward * c - v * s
        out[i, 1] += forward * s + v * c
        out[i, 2] += u * sin_inclination + w * cos_inclination


@kernel(fastmath=_FASTMATH)
def _series_place(times, time):
    """Row before a time, and the share of the way to the next one; the ends hold beyond the series."""
    last = times.shape[0] - 1
    if time < times[0] or last == 0:
        return 0, 0.0
    if time >= times[last]:
        return last, 0.0
    low = 0
    high = last
    while high - low > 1:  # times[low] <= time < times[high]
        middle = (low + high) // 2
        if time < times[middle]:
            high = middle
        else:
            low = middle
    return low, (time - times[low]) / (times[high] - times[low])


@kernel(fastmath=_FASTMATH)
def _series_value(table, row, share, column):
    value = table[row, column]
    if share > 0.0:
        value += share * (table[row + 1, column] - value)
    return value


@kernel(fastmath=_FASTMATH)
def series_velocity(points, time, times, table, hub_height, length, slowness, travel_direction, out):
    """Velocity of a wind that follows a table (n_times, 8) in straight lines.

    Columns: speed, direction, vertical speed, power-law exponent, horizontal and vertical linear shear, gust, upflow.
    A point meets what passed the tower ``slowness`` [s/m] times its distance along ``travel_direction`` ago.
    """
    c_travel = math.cos(travel_direction)
    s_travel = math.sin(travel_direction)
    row, share = _series_place(times, time)
    for i in range(points.shape[0]):
        x = points[i, 0]
        y = points[i, 1]
        z = points[i, 2]
        if not abs(x) + abs(y) + abs(z) < math.inf:
            return i
        if slowness > 0.0:
            row, share = _series_place(times, time - slowness * (x * c_travel + y * s_travel))
        speed = _series_value(table, row, share, 0)
        direction = _series_value(table, row, share, 1)
        vertical = _series_value(table, row, share, 2)
        exponent = _series_value(table, row, share, 3)
        upflow = _series_value(table, row, share, 7)
        c = math.cos(direction)
        s = math.sin(direction)
        across = _series_value(table, row, share, 4) * (y * c - x * s)
        along = _layer_speed(z, speed, hub_height, exponent, 0.0) + _series_value(table, row, share, 6)
        along += speed * (across + _series_value(table, row, share, 5) * (z - hub_height)) / length
        c_up = math.cos(upflow)
        s_up = math.sin(upflow)
        forward = along * c_up - vertical * s_up
        out[i, 0] = forward * c
        out[i, 1] = forward * s
        out[i, 2] = along * s_up + vertical * c_up
    return -1
