"""Compiled statics of a mooring line: an elastic catenary whose lower part may rest on the seabed.

Unknowns are the horizontal and the vertical force H, V [N] that hold the upper end. Equations: J. M. Jonkman,
NREL/TP-500-41958 (2007), section 2.5. Position and force belong together by a convex energy: z rises with V at fixed H,
and x rises with H where V follows from z. Bisection within bisection therefore finds every solution.
"""

import math

from wt_gym.base.compiled import kernel

SOLVED, NOT_SOLVED = 0, 1
_LEAST_FORCE = 1e-6  # horizontal force of a slack line, of the weight of the line
_TOLERANCE = 1e-11  # of a position, of the length


@kernel
def line_end(h, v, length, weight, stiffness, friction, rests):
    """Position of the upper end over the anchor and its derivatives.

    Parameters
    ----------
    h, v : float
        Horizontal (above 0) and vertical force at the upper end [N].
    length, weight, stiffness : float
        Length without load [m], weight in water per length [N/m], EA [N].
    friction : float
        Coefficient of friction of the seabed.
    rests : int
        1 where the anchor is on the seabed, on which a part of the line can rest; 0 where the line hangs free.

    Returns
    -------
    tuple of float
        x, z [m], dx/dh, dx/dv, dz/dh, dz/dv [m/N].
    """
    lower = v - weight * length
    top = math.sqrt(h * h + v * v)
    x = math.asinh(v / h) * h / weight + h * length / stiffness
    x_h = (math.asinh(v / h) - v / top) / weight + length / stiffness
    x_v = h / (weight * top)
    if rests == 1 and lower < 0.0:
        bottom = -lower / weight
        x += bottom
        x_v -= 1.0 / weight
        z = (top - h) / weight + 0.5 * v * v / (stiffness * weight)
        z_h = (h / top - 1.0) / weight
        z_v = v / (weight * top) + v / (stiffness * weight)
        if friction > 0.0:
            held = bottom - h / (friction * weight)  # part without tension
            x -= 0.5 * friction * weight / stiffness * bottom * bottom
            x_v += friction * bottom / stiffness
            if held > 0.0:
                x += 0.5 * friction * weight / stiffness * held * held
                x_h -= held / stiffness
                x_v -= friction * held / stiffness
    else:
        end = math.sqrt(h * h + lower * lower)
        x -= math.asinh(lower / h) * h / weight
        x_h -= (math.asinh(lower / h) - lower / end) / weight
        x_v -= h / (weight * end)
        z = (top - end) / weight + (v * length - 0.5 * weight * length * length) / stiffness
        z_h = h * (1.0 / top - 1.0 / end) / weight
        z_v = (v / top - lower / end) / weight + length / stiffness
    return x, z, x_h, x_v, z_h, z_v


@kernel
def _vertical_force(h, z, length, weight, stiffness, friction, rests):
    """V at which the upper end is at height z, by bisection."""
    low = 0.0
    if rests == 0:
        low = -weight * length
        while line_end(h, low, length, weight, stiffness, friction, rests)[1] > z and low > -stiffness:
            low *= 2.0
    high = weight * length
    while line_end(h, high, length, weight, stiffness, friction, rests)[1] < z and high < stiffness:
        high *= 2.0
    for _ in range(200):
        middle = 0.5 * (low + high)
        if middle == low or middle == high:
            break
        if line_end(h, middle, length, weight, stiffness, friction, rests)[1] < z:
            low = middle
        else:
            high = middle
    return 0.5 * (low + high)


@kernel
def _cold_start(unknown, x, z, length, weight, stiffness, friction, rests):
    """Forces by bisection of H within which V follows from z."""
    least = _LEAST_FORCE * weight * length
    low, high = math.log(least), math.log(stiffness)
    v = _vertical_force(least, z, length, weight, stiffness, friction, rests)
    if line_end(least, v, length, weight, stiffness, friction, rests)[0] >= x:  # slack
        unknown[0] = least
        unknown[1] = v
        return SOLVED
    for _ in range(200):
        middle = 0.5 * (low + high)
        if middle == low or middle == high:
            break
        h = math.exp(middle)
        v = _vertical_force(h, z, length, weight, stiffness, friction, rests)
        if line_end(h, v, length, weight, stiffness, friction, rests)[0] < x:
            low = middle
        else:
            high = middle
    unknown[0] = math.exp(0.5 * (low + high))
    unknown[1] = _vertical_force(unknown[0], z, length, weight, stiffness, friction, rests)
    end = line_end(unknown[0], unknown[1], length, weight, stiffness, friction, rests)
    error = math.fabs(end[0] - x) + math.fabs(end[1] - z)
    return SOLVED if error < 1e-6 * length else NOT_SOLVED


@kernel
def solve_line(unknown, x, z, length, weight, stiffness, friction, rests):
    """Forces H, V of a line whose upper end is x across and z above its anchor.

    Newton's method from the forces in ``unknown``, which the result replaces; where it does not converge, or the first
    force is not positive, bisection. A slack line has the horizontal force 0 (1e-6 of its weight).

    Returns
    -------
    int
        0, or 1 where the position is not finite or needs a force above EA, or a resting line ends at its seabed.
    """
    if not (math.isfinite(x) and math.isfinite(z)) or (rests == 1 and z <= 0.0):
        return NOT_SOLVED
    h, v = unknown[0], unknown[1]
    least = _LEAST_FORCE * weight * length
    if h > least:
        for _ in range(15):
            x_now, z_now, x_h, x_v, z_h, z_v = line_end(h, v, length, weight, stiffness, friction, rests)
            error_x, error_z = x - x_now, z - z_now
            determinant = x_h * z_v - x_v * z_h
            if not determinant > 0.0:
                break
            step_h = (error_x * z_v - error_z * x_v) / determinant
            step_v = (error_z * x_h - error_x * z_h) / determinant
            if h + step_h < 0.2 * h or (rests == 1 and v + step_v <= 0.0):
                break
            h += step_h
            v += step_v
            if h <= least or not math.isfinite(v):
                break
            if math.fabs(error_x) + math.fabs(error_z) < _TOLERANCE * length:
                unknown[0] = h
                unknown[1] = v
                return SOLVED
    return _cold_start(unknown, x, z, length, weight, stiffness, friction, rests)


@kernel
def mooring_force(p, position, rotation, out):
    """Add force and moment about the origin of the platform of all lines; see `wt_gym.hydrodynamics.loads`.

    Newton's method begins at ``p.line_unknown`` of the last accepted step; the result is in ``p.line_candidate``.
    """
    code = SOLVED
    for k in range(p.line_length.shape[0]):
        f0, f1, f2 = p.line_fairlead[k, 0], p.line_fairlead[k, 1], p.line_fairlead[k, 2]
        r0 = rotation[0, 0] * f0 + rotation[0, 1] * f1 + rotation[0, 2] * f2
        r1 = rotation[1, 0] * f0 + rotation[1, 1] * f1 + rotation[1, 2] * f2
        r2 = rotation[2, 0] * f0 + rotation[2, 1] * f1 + rotation[2, 2] * f2
        x = position[0] + r0 - p.line_anchor[k, 0]
        y = position[1] + r1 - p.line_anchor[k, 1]
        z = position[2] + r2 - p.line_anchor[k, 2]
        distance = math.sqrt(x * x + y * y)
        unknown = p.line_candidate[k]
        unknown[0] = p.line_unknown[k, 0]
        unknown[1] = p.line_unknown[k, 1]
        weight, length = p.line_weight[k], p.line_length[k]
        one = solve_line(unknown, distance, z, length, weight, p.line_stiffness[k], p.line_friction[k], p.line_rests[k])
        if one != SOLVED:
            code = one
        h, v = unknown[0], unknown[1]
        if distance > 0.0:
            p.line_direction[k, 0] = x / distance
            p.line_direction[k, 1] = y / distance
        fx, fy, fz = -h * p.line_direction[k, 0], -h * p.line_direction[k, 1], -v
        out[0] += fx
        out[1] += fy
        out[2] += fz
        out[3] += r1 * fz - r2 * fy
        out[4] += r2 * fx - r0 * fz
        out[5] += r0 * fy - r1 * fx
        p.line_tension[k, 0] = math.sqrt(h * h + v * v)
        p.line_tension[k, 1] = anchor_tension(h, v, length, weight, p.line_friction[k], p.line_rests[k])
    return code


@kernel
def anchor_tension(h, v, length, weight, friction, rests):
    """Tension at the anchor [N]: on the seabed less than H by the friction, at most all of it."""
    lower = v - weight * length
    if rests == 1 and lower < 0.0:
        return max(h + friction * lower, 0.0)
    return math.sqrt(h * h + lower * lower)
