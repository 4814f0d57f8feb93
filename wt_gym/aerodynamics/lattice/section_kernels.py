"""Blade sections: what their polars make of the flow, fed back into the lattice as decambering."""

import numpy as np

from wt_gym.base.compiled import kernel

LEAST_SHARE = 0.02  # of a step of Newton's method; where none helps the smallest is taken
STEEPEST = 0.9  # slope of the right-hand side over s for a strip alone, in the Jacobian
DISAGREEMENT = 1e-3  # of circulation and polars, over the largest speed of a section, with which a step may end
SWEEPS = 3  # over strips that are solved alone
DOUBLINGS, HALVINGS = 24, 40  # of the bracket of such a strip
ATTACHED, SEPARATED, POINT, DRAG = range(4)  # columns of the separation tables


@kernel(fastmath=False)
def cubic_at(table, column, alpha):
    """Periodic cubic (Catmull-Rom) interpolation in a column of a table (n_alpha, …) from -pi to pi, and its slope."""
    n = table.shape[0]
    step = 2.0 * np.pi / n
    position = (alpha + np.pi) / step
    floor = np.floor(position)
    t = position - floor
    i1 = int(floor) % n
    i0, i2, i3 = (i1 - 1) % n, (i1 + 1) % n, (i1 + 2) % n
    y0, y1, y2, y3 = table[i0, column], table[i1, column], table[i2, column], table[i3, column]
    a = 0.5 * (3.0 * (y1 - y2) + y3 - y0)
    b = 0.5 * (2.0 * y0 - 5.0 * y1 + 4.0 * y2 - y3)
    c = 0.5 * (y2 - y0)
    return y1 + t * (c + t * (b + t * a)), (c + t * (2.0 * b + t * 3.0 * a)) / step


@kernel(fastmath=False)
def linear_at(table, column, alpha):
    """Periodic linear interpolation in a column of a table (n_alpha, …) from -pi (included) to pi (excluded)."""
    n = table.shape[0]
    position = (alpha + np.pi) / (2.0 * np.pi / n)
    floor = np.floor(position)
    t = position - floor
    i = int(floor) % n
    return (1.0 - t) * table[i, column] + t * table[(i + 1) % n, column]


@kernel(fastmath=False)
def polar_at(table, alpha):
    """Coefficients and lift slope at ``alpha``: cl, cd, cm, dcl/dalpha.

    cl by cubics, continuous with its slope; cd by straight lines, so that it never becomes negative, and cm.
    table (n_alpha, 3).
    """
    cl, slope = cubic_at(table, 0, alpha)
    return cl, linear_at(table, 1, alpha), linear_at(table, 2, alpha), slope


@kernel(fastmath=False)
def lift_at(polar, separation, point, alpha):
    """Lift coefficient and its slope: of the polar (``point`` < 0), or of a flow separated ``point`` chords aft.

    separation (n_alpha, 4), see `separation.separation_tables`. With the separation point given, the slope is never
    that of the polar's fall beyond its maximum, which is the movement of this point.
    """
    if point < 0.0:
        return cubic_at(polar, 0, alpha)
    attached, attached_slope = cubic_at(separation, ATTACHED, alpha)
    separated, separated_slope = cubic_at(separation, SEPARATED, alpha)
    rest = 1.0 - point
    return point * attached + rest * separated, point * attached_slope + rest * separated_slope


@kernel(fastmath=False, inline="always")
def strip_axes(nodes, fore_aft, normal, width):
    """Unit chord direction and normal of the section planes (n_strip, 3), and strip width along the span (n_strip,)."""
    n_blade, n_row, n_node, _ = nodes.shape
    for b in range(n_blade):
        for j in range(n_node - 1):
            k = b * (n_node - 1) + j
            s, c = normal[k], fore_aft[k]  # the span direction goes where the normal will be
            for i in range(3):
                s[i] = nodes[b, 0, j + 1, i] - nodes[b, 0, j, i]
                aft = nodes[b, n_row - 1, j, i] + nodes[b, n_row - 1, j + 1, i]
                c[i] = 0.5 * (aft - nodes[b, 0, j, i] - nodes[b, 0, j + 1, i])
            width[k] = np.sqrt(s[0] * s[0] + s[1] * s[1] + s[2] * s[2])
            across = (c[0] * s[0] + c[1] * s[1] + c[2] * s[2]) / (width[k] * width[k])
            for i in range(3):
                c[i] -= across * s[i]
            size = np.sqrt(c[0] * c[0] + c[1] * c[1] + c[2] * c[2])
            sx, sy, sz = s[0] / width[k], s[1] / width[k], s[2] / width[k]
            for i in range(3):
                c[i] /= size
            normal[k, 0] = c[1] * sz - c[2] * sy
            normal[k, 1] = c[2] * sx - c[0] * sz
            normal[k, 2] = c[0] * sy - c[1] * sx


@kernel(fastmath=False)
def section_state(across, along, tilt, polar, alpha0, chord, kappa, separation, point):
    """Angle of attack and what the polar makes of it, static or with the flow separated at ``point``, see `lift_at`.

    ``across`` is the velocity normal to the zero-lift line of the lattice section, ``along`` the one along the line
    that joins its first and last node, ``tilt`` (2,) cosine and sine of slope angle - alpha0. Returns alpha, speed,
    decambering velocity required by the polar (the normal velocity that makes no circulation), and the derivatives of
    the latter and of the speed with respect to ``across``.
    """
    tangential = (along - across * tilt[1]) / tilt[0]
    speed = np.sqrt(across * across + tangential * tangential)
    alpha = np.arctan2(across, tangential) + alpha0
    cl, slope = lift_at(polar, separation, point, alpha)
    safe = max(speed, 1e-9)
    tangential_rate = -tilt[1] / tilt[0]
    speed_rate = (across + tangential * tangential_rate) / safe
    lift_rate = slope * (tangential - across * tangential_rate) / safe + cl * speed_rate  # of V cl
    share = 0.5 * chord / kappa
    return alpha, speed, across - share * speed * cl, 1.0 - share * lift_rate, speed_rate


@kernel(fastmath=False, inline="always")
def decambering(potential, along, response, previous, first, dt, lag, p, n_blade, tolerance, max_iterations, point,
                jacobian, rhs, derivative, step, source):  # fmt: skip
    """Decambering velocities of all strips such that circulation and polar agree; returns the residual [m/s].

    Strip k with decambering velocity s_k has the circulation G = potential + response @ s and sees the normal
    velocity x = G / kappa + s. The polar requires s* = x - (V c cl / 2) / kappa. Each step solves
    s = (1 - w) V d_previous + w s*(x), w = 1 - exp(-V dt / (lag c)), where ``previous`` holds d = s / V of the last
    step: what lags is an angle, so that the lift coefficient does not overshoot where the speed drops. ``point``
    (n_strip,) are separation points, which stand still here, or negative for static polars. Newton's
    method has the coupling inside a blade in its Jacobian, the weak one between blades only in the residual. The
    slope of the right-hand side is limited in the Jacobian (not in the equation) where the polar falls steeply, since
    there the equation has several solutions. A step that does not lessen the sum of squares is halved.
    """
    n_strip = potential.shape[0]
    n_span = n_strip // n_blade
    chord, kappa = p.chord, p.kappa
    residual, last_sum, share = 0.0, np.inf, 1.0
    for iteration in range(max_iterations + 1):
        residual, square_sum, scale = 0.0, 0.0, 0.0
        for k in range(n_strip):
            g = potential[k]
            for m in range(n_strip):
                g += response[k, m] * source[m]
            j, row = k % n_span, k % p.polars.shape[0]
            across = g / kappa[j] + source[k]
            _, speed, required, slope, speed_rate = section_state(
                across, along[k], p.tilt[j], p.polars[row], p.alpha0[j], chord[j], kappa[j], p.separation[row], point[k]
            )
            frequency = dt / max(lag * chord[j], 1e-12)
            kept = 0.0 if first else np.exp(-speed * frequency)
            lagging = previous[k] * speed
            rhs[k] = kept * lagging + (1.0 - kept) * required - source[k]
            derivative[k] = (1.0 - kept) * max(slope, -1.0)
            if not first:
                derivative[k] += kept * speed_rate * (previous[k] + frequency * (required - lagging))
            own = 1.0 + response[k, k] / kappa[j]
            if derivative[k] * own > STEEPEST:
                derivative[k] = STEEPEST / own
            residual = max(residual, abs(rhs[k]))
            square_sum += rhs[k] * rhs[k]
            scale = max(scale, speed)
        if not residual > tolerance * (scale + 1e-3) or iteration == max_iterations:
            break
        if not square_sum < last_sum and share > LEAST_SHARE:
            share *= 0.5
            for k in range(n_strip):
                step[k] *= 0.5
                source[k] -= step[k]
            continue
        last_sum, share = square_sum, 1.0
        for b in range(n_blade):
            o = b * n_span
            for k in range(n_span):
                for m in range(n_span):
                    jacobian[k, m] = -derivative[o + k] * response[o + k, o + m] / kappa[k]
                jacobian[k, k] += 1.0 - derivative[o + k]
            for k in range(n_span):
                for m in range(k + 1, n_span):
                    factor = jacobian[m, k] / jacobian[k, k]
                    for l in range(k + 1, n_span):
                        jacobian[m, l] -= factor * jacobian[k, l]
                    rhs[o + m] -= factor * rhs[o + k]
            for k in range(n_span - 1, -1, -1):
                for l in range(k + 1, n_span):
                    rhs[o + k] -= jacobian[k, l] * rhs[o + l]
                rhs[o + k] /= jacobian[k, k]
                step[o + k] = rhs[o + k]
                source[o + k] += rhs[o + k]
    return residual


@kernel(fastmath=False, separate=True)
def settle_strips(potential, along, response, previous, dt, lag, p, point, speed, source):
    """Solve strips alone where Newton's method has ended between two solutions; arguments as of `decambering`.

    Where a polar falls steeply behind its maximum the solution that a strip has followed ends in a fold, and the other
    one is far: the sum of squares has a minimum between them that is none. For one strip the right-hand side less s is
    continuous and falls from one sign to the other, so that there is a solution in the direction of the residual. It is
    bracketed with steps that double and halved; the strips follow each other `SWEEPS` times. ``speed`` (n_strip,) are
    the present ones.
    """
    fastest = 0.0
    for k in range(speed.shape[0]):
        fastest = max(fastest, speed[k])
    for _ in range(SWEEPS):
        for k in range(source.shape[0]):
            start = source[k]
            low = strip_residual(k, start, potential, along, response, previous, dt, lag, p, point, source)
            if abs(low) <= 0.1 * DISAGREEMENT * fastest:
                continue
            reach = 1e-3 * fastest if low > 0.0 else -1e-3 * fastest
            end = start
            for _ in range(DOUBLINGS):
                end = start + reach
                value = strip_residual(k, end, potential, along, response, previous, dt, lag, p, point, source)
                if value * low <= 0.0:
                    break
                start = end
                reach *= 2.0
            for _ in range(HALVINGS):
                middle = 0.5 * (start + end)
                value = strip_residual(k, middle, potential, along, response, previous, dt, lag, p, point, source)
                if value * low > 0.0:
                    start = middle
                else:
                    end = middle
            source[k] = end


@kernel(fastmath=False)
def strip_residual(k, own, potential, along, response, previous, dt, lag, p, point, source):
    """Right-hand side of `decambering` less s for strip k with s = ``own``, the others as they are [m/s]."""
    j, row = k % p.kappa.shape[0], k % p.polars.shape[0]
    g = potential[k] + response[k, k] * (own - source[k])
    for m in range(source.shape[0]):
        g += response[k, m] * source[m]
    across = g / p.kappa[j] + own
    _, speed, required, _, _ = section_state(
        across, along[k], p.tilt[j], p.polars[row], p.alpha0[j], p.chord[j], p.kappa[j], p.separation[row], point[k]
    )
    kept = np.exp(-speed * dt / max(lag * p.chord[j], 1e-12))
    return kept * previous[k] * speed + (1.0 - kept) * required - own
