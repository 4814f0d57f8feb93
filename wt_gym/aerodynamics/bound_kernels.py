"""The bound lattice: influence matrices, boundary condition with decambering, and loads.

Points of one blade-set come in this order: collocation points (blade, chord, span), midpoints of spanwise bound
segments (blade, chord, span), midpoints of chordwise bound segments (blade, chord, node). Rings are numbered
(blade, chord, span). A positive circulation runs from root to tip along the leading side of a ring and lifts towards
the suction side; panel normals point there too.
"""

import numpy as np

from wt_gym.aerodynamics.induction_kernels import FAST, FOUR_PI
from wt_gym.compiled import kernel


@kernel(fastmath=FAST)
def _segment_influence(a, b, core2, points, out):
    """Velocity of a unit segment from a to b at all points (3, n), float64; ``core2`` is rc^2."""
    lx, ly, lz = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    soft = core2 * (lx * lx + ly * ly + lz * lz) + 1e-300
    for i in range(points.shape[1]):
        ax = points[0, i] - a[0]
        ay = points[1, i] - a[1]
        az = points[2, i] - a[2]
        bx = points[0, i] - b[0]
        by = points[1, i] - b[1]
        bz = points[2, i] - b[2]
        ra = np.sqrt(ax * ax + ay * ay + az * az)
        rb = np.sqrt(bx * bx + by * by + bz * bz)
        ab = ra * rb
        k = (ra + rb) / (FOUR_PI * (ab * (ab + ax * bx + ay * by + az * bz) + soft))
        out[0, i] = k * (ay * bz - az * by)
        out[1, i] = k * (az * bx - ax * bz)
        out[2, i] = k * (ax * by - ay * bx)


@kernel(fastmath=FAST)
def _add(total, sign, part):
    for c in range(3):
        for i in range(part.shape[1]):
            total[c, i] += sign * part[c, i]


@kernel(fastmath=False)
def geometry(nodes, points, normal, area):
    """Collocation points, segment midpoints, and ring normals with ring areas.

    nodes (n_blade, n_chord + 1, n_node, 3); points (3, n_point); normal (n_ring, 3); area (n_ring,).
    """
    n_blade, n_row, n_node, _ = nodes.shape
    n_chord, n_span = n_row - 1, n_node - 1
    n_ring = n_blade * n_chord * n_span
    r = 0
    for b in range(n_blade):
        for i in range(n_chord):
            for j in range(n_span):
                p00, p01, p10, p11 = nodes[b, i, j], nodes[b, i, j + 1], nodes[b, i + 1, j], nodes[b, i + 1, j + 1]
                for c in range(3):
                    points[c, r] = 0.25 * (p00[c] + p01[c] + p10[c] + p11[c])
                    points[c, n_ring + r] = 0.5 * (p00[c] + p01[c])
                cx = 0.5 * (p10[0] + p11[0] - p00[0] - p01[0])
                cy = 0.5 * (p10[1] + p11[1] - p00[1] - p01[1])
                cz = 0.5 * (p10[2] + p11[2] - p00[2] - p01[2])
                sx = 0.5 * (p01[0] + p11[0] - p00[0] - p10[0])
                sy = 0.5 * (p01[1] + p11[1] - p00[1] - p10[1])
                sz = 0.5 * (p01[2] + p11[2] - p00[2] - p10[2])
                nx, ny, nz = cy * sz - cz * sy, cz * sx - cx * sz, cx * sy - cy * sx
                size = np.sqrt(nx * nx + ny * ny + nz * nz)
                area[r] = size
                normal[r, 0] = nx / size
                normal[r, 1] = ny / size
                normal[r, 2] = nz / size
                r += 1
    k = 2 * n_ring
    for b in range(n_blade):
        for i in range(n_chord):
            for j in range(n_node):
                for c in range(3):
                    points[c, k] = 0.5 * (nodes[b, i, j, c] + nodes[b, i + 1, j, c])
                k += 1


@kernel(fastmath=False, inline="always")
def relative_wind(nodes, velocities, wind, flow):
    """Wind minus motion at all points (3, n_point), from node values."""
    n_blade, n_row, n_node, _ = nodes.shape
    n_chord, n_span = n_row - 1, n_node - 1
    n_ring = n_blade * n_chord * n_span
    for c in range(3):
        r = 0
        k = 2 * n_ring
        for b in range(n_blade):
            for i in range(n_chord):
                for j in range(n_node):
                    fore = wind[b, i, j, c] - velocities[b, i, j, c]
                    aft = wind[b, i + 1, j, c] - velocities[b, i + 1, j, c]
                    flow[c, k] = 0.5 * (fore + aft)
                    k += 1
                    if j < n_span:
                        fore2 = wind[b, i, j + 1, c] - velocities[b, i, j + 1, c]
                        aft2 = wind[b, i + 1, j + 1, c] - velocities[b, i + 1, j + 1, c]
                        flow[c, r] = 0.25 * (fore + aft + fore2 + aft2)
                        flow[c, n_ring + r] = 0.5 * (fore + fore2)
                        r += 1


@kernel(fastmath=False)
def bound_influence(nodes, newest_row, has_wake, edge_chord, bound_core, wake_core, points, scratch, influence):
    """Velocity of each unit ring at all points, influence (n_ring, 3, n_point).

    The newest wake ring, between trailing edge and ``newest_row`` (n_blade, n_node, 3), has the circulation of the
    last ring before it (Kutta condition) and counts to that ring when ``has_wake`` is true.
    """
    n_blade, n_row, n_node, _ = nodes.shape
    n_chord, n_span = n_row - 1, n_node - 1
    influence[:] = 0.0
    last = n_chord + 1 if has_wake else n_chord
    for b in range(n_blade):
        first = b * n_chord * n_span
        for i in range(last + 1):
            # Spanwise segments: leading side of ring row i, trailing side of ring row i - 1.
            if has_wake and i == n_chord:
                continue  # the ring before and the newest wake ring cancel at the trailing edge
            for j in range(n_span):
                chord = 0.5 * (edge_chord[j] + edge_chord[j + 1])
                if i <= n_chord:
                    start, end, core = nodes[b, i, j], nodes[b, i, j + 1], bound_core * chord / n_chord
                else:
                    start, end, core = newest_row[b, j], newest_row[b, j + 1], wake_core * chord
                _segment_influence(start, end, core * core, points, scratch)
                if i < n_chord:
                    _add(influence[first + i * n_span + j], 1.0, scratch)
                if i > 0:
                    _add(influence[first + min(i - 1, n_chord - 1) * n_span + j], -1.0, scratch)
        for i in range(last):
            # Chordwise segments, directed aft: tip side of strip j - 1, root side of strip j.
            ring_row = min(i, n_chord - 1)
            for j in range(n_node):
                if i < n_chord:
                    end, core = nodes[b, i + 1, j], bound_core * edge_chord[j] / n_chord
                else:
                    end, core = newest_row[b, j], wake_core * edge_chord[j]
                _segment_influence(nodes[b, i, j], end, core * core, points, scratch)
                if j > 0:
                    _add(influence[first + ring_row * n_span + j - 1], 1.0, scratch)
                if j < n_span:
                    _add(influence[first + ring_row * n_span + j], -1.0, scratch)


@kernel(fastmath=FAST)
def invert(matrix, inverse):
    """Inverse of a square matrix by Gauss-Jordan elimination with row pivoting; destroys ``matrix``.

    LAPACK is 3 to 6 times faster for 100 to 300 unknowns on an idle machine, but its threads wait for each other on a
    busy one: calls of 8 ms instead of 0.15 ms, and of 0.6 s instead of 2 ms, were seen. This one takes 0.4 and 11 ms.
    """
    n = matrix.shape[0]
    for r in range(n):
        for m in range(n):
            inverse[r, m] = 1.0 if r == m else 0.0
    for k in range(n):
        pivot = k
        for r in range(k + 1, n):
            if abs(matrix[r, k]) > abs(matrix[pivot, k]):
                pivot = r
        if pivot != k:
            for m in range(n):
                matrix[k, m], matrix[pivot, m] = matrix[pivot, m], matrix[k, m]
                inverse[k, m], inverse[pivot, m] = inverse[pivot, m], inverse[k, m]
        scale = 1.0 / matrix[k, k]
        for m in range(n):
            matrix[k, m] *= scale
            inverse[k, m] *= scale
        for r in range(n):
            factor = matrix[r, k]
            if r != k and factor != 0.0:
                for m in range(k, n):
                    matrix[r, m] -= factor * matrix[k, m]
                for m in range(n):
                    inverse[r, m] -= factor * inverse[k, m]


@kernel(fastmath=False, _nrt=True, inline="always")
def invert_boundary_condition(influence, normal, n_blade, n_chord, n_span, inverse, response):
    """Inverse of the normal-velocity matrix and the strips' response to decambering.

    inverse (n_ring, n_ring): circulations = inverse @ normal velocities that the rings must induce.
    response (n_strip, n_strip): circulation at the trailing edge per uniform normal velocity of a strip.
    """
    n_ring = n_blade * n_chord * n_span
    matrix = np.empty((n_ring, n_ring))
    for source in range(n_ring):
        for r in range(n_ring):
            matrix[r, source] = (
                influence[source, 0, r] * normal[r, 0]
                + influence[source, 1, r] * normal[r, 1]
                + influence[source, 2, r] * normal[r, 2]
            )
    invert(matrix, inverse)
    for b in range(n_blade):
        for j in range(n_span):
            edge_ring = (b * n_chord + n_chord - 1) * n_span + j
            for b2 in range(n_blade):
                for j2 in range(n_span):
                    total = 0.0
                    for i in range(n_chord):
                        total += inverse[edge_ring, (b2 * n_chord + i) * n_span + j2]
                    response[b * n_span + j, b2 * n_span + j2] = total


@kernel(fastmath=False)
def polar_at(table, alpha):
    """Coefficients and lift slope at ``alpha``: cl, cd, cm, dcl/dalpha.

    Periodic cubic (Catmull-Rom) interpolation of cl, continuous with its slope; linear for cd, so that it never
    becomes negative, and for cm. table (n_alpha, 3) from -pi (included) to pi (excluded).
    """
    n = table.shape[0]
    step = 2.0 * np.pi / n
    position = (alpha + np.pi) / step
    floor = np.floor(position)
    t = position - floor
    i1 = int(floor) % n
    i0, i2, i3 = (i1 - 1) % n, (i1 + 1) % n, (i1 + 2) % n
    y0, y1, y2, y3 = table[i0, 0], table[i1, 0], table[i2, 0], table[i3, 0]
    a = 0.5 * (3.0 * (y1 - y2) + y3 - y0)
    b = 0.5 * (2.0 * y0 - 5.0 * y1 + 4.0 * y2 - y3)
    c = 0.5 * (y2 - y0)
    cl = y1 + t * (c + t * (b + t * a))
    slope = (c + t * (2.0 * b + t * 3.0 * a)) / step
    cd = (1.0 - t) * table[i1, 1] + t * table[i2, 1]
    cm = (1.0 - t) * table[i1, 2] + t * table[i2, 2]
    return cl, cd, cm, slope


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
def section_state(across, along, tilt, polar, alpha0, chord, kappa):
    """Angle of attack and what the polar makes of it.

    ``across`` is the velocity normal to the zero-lift line of the lattice section, ``along`` the one along the line
    that joins its first and last node, ``tilt`` = slope angle - alpha0. Returns alpha, speed, decambering velocity
    wanted by the polar (the normal velocity that makes no circulation) and its derivative with respect to ``across``.
    """
    tangential = (along - across * np.sin(tilt)) / np.cos(tilt)
    speed = np.sqrt(across * across + tangential * tangential)
    alpha = np.arctan2(across, tangential) + alpha0
    cl, _, _, slope = polar_at(polar, alpha)
    # 0.5 c d(V cl)/d(across) with d(alpha) = tangential/V^2, dV = across/V (and tangential nearly constant).
    safe = max(speed, 1e-9)
    gradient = 0.5 * chord * (slope * tangential + cl * across) / safe
    return alpha, speed, across - 0.5 * speed * chord * cl / kappa, 1.0 - gradient / kappa


@kernel(fastmath=False, _nrt=True, inline="always")
def decambering(potential, along, response, previous, first, dt, lag, chord, kappa, tilt, alpha0, polars, n_blade,
                tolerance, max_iterations, source):  # fmt: skip
    """Decambering velocities of all strips such that circulation and polar agree; returns the residual [m/s].

    Strip k with decambering velocity s_k has the circulation G = potential + response @ s and sees the normal
    velocity x = G / kappa + s. The polar wants s* = x - (V c cl / 2) / kappa. Each step solves
    s = (1 - w) V d_previous + w s*(x), w = 1 - exp(-V dt / (lag c)), where ``previous`` holds d = s / V of the last
    step: what lags is an angle, so that the lift coefficient does not overshoot where the speed drops. Newton's
    method has the coupling inside a blade in its Jacobian, the weak one between blades and the slope of V only in
    the residual. The slope of s* is limited in the
    Jacobian (not in the equation) where the polar falls steeply, since there the equation has several solutions.
    """
    n_strip = potential.shape[0]
    n_span = n_strip // n_blade
    jacobian = np.empty((n_span, n_span))
    rhs = np.empty(n_strip)
    derivative = np.empty(n_strip)
    residual = 0.0
    for iteration in range(max_iterations + 1):
        residual = 0.0
        scale = 0.0
        for k in range(n_strip):
            g = potential[k]
            for m in range(n_strip):
                g += response[k, m] * source[m]
            j = k % n_span
            across = g / kappa[j] + source[k]
            _, speed, wanted, slope = section_state(across, along[k], tilt[j], polars[j], alpha0[j], chord[j], kappa[j])
            weight = 1.0 if first else 1.0 - np.exp(-speed * dt / max(lag * chord[j], 1e-12))
            rhs[k] = (1.0 - weight) * previous[k] * speed + weight * wanted - source[k]
            derivative[k] = weight * min(max(slope, -1.0), 1.0)
            residual = max(residual, abs(rhs[k]))
            scale = max(scale, speed)
        if not residual > tolerance * (scale + 1e-3) or iteration == max_iterations:
            break
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
                source[o + k] += rhs[o + k]
    return residual


@kernel(fastmath=False)
def _push(forces, b, i, j, fx, fy, fz):
    forces[b, i, j, 0] += fx
    forces[b, i, j, 1] += fy
    forces[b, i, j, 2] += fz


@kernel(fastmath=False, inline="always")
def potential_loads(nodes, gamma, rate, flow, normal, area, density, forces):
    """Joukowski force of every bound segment and the force of the changing circulation, at the nodes.

    flow (3, n_point) is the whole local velocity at the segment midpoints, rate = d gamma / dt (n_ring,). The last
    ring of a strip ends a quarter panel behind the trailing edge; the pressure acts on the three quarters before it.
    """
    n_blade, n_row, n_node, _ = nodes.shape
    n_chord, n_span = n_row - 1, n_node - 1
    n_ring = n_blade * n_chord * n_span
    r = 0
    k = 2 * n_ring
    for b in range(n_blade):
        for i in range(n_chord):
            for j in range(n_node):
                if j < n_span:
                    strength = gamma[r] - (gamma[r - n_span] if i > 0 else 0.0)
                    lx = nodes[b, i, j + 1, 0] - nodes[b, i, j, 0]
                    ly = nodes[b, i, j + 1, 1] - nodes[b, i, j, 1]
                    lz = nodes[b, i, j + 1, 2] - nodes[b, i, j, 2]
                    u, v, w = flow[0, n_ring + r], flow[1, n_ring + r], flow[2, n_ring + r]
                    h = 0.5 * density * strength
                    fx, fy, fz = h * (v * lz - w * ly), h * (w * lx - u * lz), h * (u * ly - v * lx)
                    _push(forces, b, i, j, fx, fy, fz)
                    _push(forces, b, i, j + 1, fx, fy, fz)
                    part = 0.75 if i == n_chord - 1 else 1.0
                    h = 0.5 * density * rate[r] * area[r] * part
                    fore = 1.0 - 0.5 * part
                    for side in range(2):
                        _push(forces, b, i, j + side, h * fore * normal[r, 0], h * fore * normal[r, 1],
                              h * fore * normal[r, 2])  # fmt: skip
                        aft = 1.0 - fore
                        _push(forces, b, i + 1, j + side, h * aft * normal[r, 0], h * aft * normal[r, 1],
                              h * aft * normal[r, 2])  # fmt: skip
                    r += 1
                ring = (b * n_chord + i) * n_span + j
                strength = (gamma[ring - 1] if j > 0 else 0.0) - (gamma[ring] if j < n_span else 0.0)
                lx = nodes[b, i + 1, j, 0] - nodes[b, i, j, 0]
                ly = nodes[b, i + 1, j, 1] - nodes[b, i, j, 1]
                lz = nodes[b, i + 1, j, 2] - nodes[b, i, j, 2]
                u, v, w = flow[0, k], flow[1, k], flow[2, k]
                h = 0.5 * density * strength
                fx, fy, fz = h * (v * lz - w * ly), h * (w * lx - u * lz), h * (u * ly - v * lx)
                _push(forces, b, i, j, fx, fy, fz)
                _push(forces, b, i + 1, j, fx, fy, fz)
                k += 1


@kernel(fastmath=False, inline="always")
def viscous_loads(nodes, fore_aft, normal, width, alpha, speed, slope_angle, chord, moment0, polars, density, forces):
    """Drag at the quarter chord and pitching moment as a couple of the first and last node row, from the polars.

    The lattice already carries the moment of its own camber line, ``moment0`` at zero lift; only the rest is added.
    """
    n_blade, n_row, n_node, _ = nodes.shape
    n_chord, n_span = n_row - 1, n_node - 1
    quarter = 0.25 * n_chord - 0.25
    row = min(int(quarter), n_chord - 1)
    aft = quarter - row
    for b in range(n_blade):
        for j in range(n_span):
            k = b * n_span + j
            _, cd, cm, _ = polar_at(polars[j], alpha[k])
            pressure = 0.5 * density * speed[k] * speed[k] * chord[j] * width[k]
            angle = alpha[k] - slope_angle[j]
            arm = 0.0
            for c in range(3):
                arm += 0.5 * fore_aft[k, c] * (nodes[b, n_chord, j, c] + nodes[b, n_chord, j + 1, c]
                                               - nodes[b, 0, j, c] - nodes[b, 0, j + 1, c])  # fmt: skip
            couple = 0.5 * pressure * chord[j] * (cm - moment0[j] * np.cos(alpha[k]) ** 2) / arm
            for c in range(3):
                drag = 0.5 * pressure * cd * (np.cos(angle) * fore_aft[k, c] + np.sin(angle) * normal[k, c])
                for side in range(2):
                    forces[b, row, j + side, c] += (1.0 - aft) * drag
                    forces[b, row + 1, j + side, c] += aft * drag
                    forces[b, 0, j + side, c] += couple * normal[k, c]
                    forces[b, n_chord, j + side, c] -= couple * normal[k, c]
