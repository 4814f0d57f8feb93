"""Closed bodies in the flow: constant-strength source panels and their coupling with the lattice.

A flat panel of unit strength (velocity through it, sum of both sides) induces, exactly,

    v = 1 / (4 pi) (sum over edges of nu_k ln((r1 + r2 + d) / (r1 + r2 - d)) + n W),

with nu_k the outward normal of edge k in the plane of the panel, d its length, r1 and r2 the distances of its ends,
and W the solid angle of the panel, positive on the side of its normal n (Hess & Smith, Progress in Aerospace Sciences
8, 1967; Katz & Plotkin, Low-Speed Aerodynamics, section 10.4.1, in another arrangement; solid angle of a triangle:
van Oosterom & Strackee, IEEE Trans. Biomed. Eng. 30, 1983, eq. 8). Far away it acts as a point source at its centroid
with a quadrupole. A ground is made by mirror images of the same strength: the velocity of the image is the mirrored
velocity at the mirrored point.

``bodies`` are `BodyArrays`, ``work`` a `BodyWork`.
"""

import numpy as np

from wt_gym.aerodynamics.induction.induction_kernels import FAST, FOUR_PI
from wt_gym.base.compiled import kernel

BLOCK = 256  # targets whose numbers stay in the first-level cache
FAR_OFF = 1e12  # square of the distance at which the far field takes near points, which follow on their own [m^2]


@kernel(fastmath=FAST)
def _triangle_solid_angle(ax, ay, az, a, bx, by, bz, b, cx, cy, cz, c):
    """Solid angle of a triangle from the vectors corner -> point and their lengths."""
    volume = ax * (by * cz - bz * cy) + ay * (bz * cx - bx * cz) + az * (bx * cy - by * cx)
    ab, bc, ca = ax * bx + ay * by + az * bz, bx * cx + by * cy + bz * cz, cx * ax + cy * ay + cz * az
    return 2.0 * np.arctan2(volume, a * b * c + ab * c + bc * a + ca * b)


@kernel(fastmath=FAST)
def near_velocity(corners, normal, x, y, z):
    """Velocity of a flat panel (4, 3) of unit strength at a point; on the panel, that of the side of its normal."""
    u, v, w = 0.0, 0.0, 0.0
    longest, inside = 0.0, True
    for k in range(4):
        m = (k + 1) % 4
        ex, ey, ez = corners[m, 0] - corners[k, 0], corners[m, 1] - corners[k, 1], corners[m, 2] - corners[k, 2]
        d = np.sqrt(ex * ex + ey * ey + ez * ez)
        if d > 0.0:  # a triangle has an edge without length
            ax, ay, az = x - corners[k, 0], y - corners[k, 1], z - corners[k, 2]
            bx, by, bz = x - corners[m, 0], y - corners[m, 1], z - corners[m, 2]
            total = np.sqrt(ax * ax + ay * ay + az * az) + np.sqrt(bx * bx + by * by + bz * bz)
            # The velocity has no limit at an edge; the bound only keeps it finite within a millionth of its length.
            strength = np.log((total + d) / max(total - d, 1e-6 * d)) / d
            ox, oy, oz = (
                ey * normal[2] - ez * normal[1],
                ez * normal[0] - ex * normal[2],
                ex * normal[1] - ey * normal[0],
            )
            u += strength * ox
            v += strength * oy
            w += strength * oz
            inside = inside and ox * ax + oy * ay + oz * az <= 0.0
            longest = max(longest, d)
    ax, ay, az = x - corners[0, 0], y - corners[0, 1], z - corners[0, 2]
    bx, by, bz = x - corners[1, 0], y - corners[1, 1], z - corners[1, 2]
    cx, cy, cz = x - corners[2, 0], y - corners[2, 1], z - corners[2, 2]
    dx, dy, dz = x - corners[3, 0], y - corners[3, 1], z - corners[3, 2]
    a, b = np.sqrt(ax * ax + ay * ay + az * az), np.sqrt(bx * bx + by * by + bz * bz)
    c, d = np.sqrt(cx * cx + cy * cy + cz * cz), np.sqrt(dx * dx + dy * dy + dz * dz)
    if abs(ax * normal[0] + ay * normal[1] + az * normal[2]) < 1e-9 * longest:
        solid = 2.0 * np.pi if inside else 0.0
    else:
        solid = _triangle_solid_angle(ax, ay, az, a, bx, by, bz, b, cx, cy, cz, c)
        solid += _triangle_solid_angle(ax, ay, az, a, cx, cy, cz, c, dx, dy, dz, d)
    return (
        (u + solid * normal[0]) / FOUR_PI,
        (v + solid * normal[1]) / FOUR_PI,
        (w + solid * normal[2]) / FOUR_PI,
    )


@kernel(fastmath=FAST)
def panel_velocity(bodies, p, points, ground, has_ground, out):
    """Velocity of panel ``p`` (and its image) of unit strength at points (3, n), written into out (3, n)."""
    cx, cy, cz = bodies.center[0, p], bodies.center[1, p], bodies.center[2, p]
    area, qxx, qyy, qzz = bodies.far[p, 0], bodies.far[p, 1], bodies.far[p, 2], bodies.far[p, 3]
    qxy, qyz, qzx, limit = bodies.far[p, 4], bodies.far[p, 5], bodies.far[p, 6], bodies.far[p, 7]
    trace = 1.5 * (qxx + qyy + qzz)
    for i in range(points.shape[1]):
        out[0, i] = 0.0
        out[1, i] = 0.0
        out[2, i] = 0.0
    for image in range(2 if has_ground else 1):
        flip, shift = (-1.0, 2.0 * ground) if image == 1 else (1.0, 0.0)
        near = 0.0
        for i in range(points.shape[1]):
            x, y, z = points[0, i] - cx, points[1, i] - cy, shift + flip * points[2, i] - cz
            r2 = x * x + y * y + z * z
            near += 1.0 if r2 < limit else 0.0
            r2 = r2 if r2 >= limit else FAR_OFF
            i2 = 1.0 / r2
            i3 = i2 * np.sqrt(i2)
            sx, sy, sz = qxx * x + qxy * y + qzx * z, qxy * x + qyy * y + qyz * z, qzx * x + qyz * y + qzz * z
            radial = i3 * (area + i2 * (7.5 * i2 * (sx * x + sy * y + sz * z) - trace))
            side = 3.0 * i3 * i2
            out[0, i] += radial * x - side * sx
            out[1, i] += radial * y - side * sy
            out[2, i] += flip * (radial * z - side * sz)
        if near > 0.0:
            for i in range(points.shape[1]):
                x, y, z = points[0, i], points[1, i], shift + flip * points[2, i]
                if (x - cx) ** 2 + (y - cy) ** 2 + (z - cz) ** 2 < limit:
                    u, v, w = near_velocity(bodies.corners[p], bodies.normal[p], x, y, z)
                    out[0, i] += u
                    out[1, i] += v
                    out[2, i] += flip * w


@kernel(fastmath=FAST)
def normal_matrix(bodies, ground, has_ground, part, matrix):
    """Normal velocity on panel i of panel p of unit strength, matrix (n_panel, n_panel); part (3, n_panel) is work.

    What a source on a closed body emits passes out of it in full. Values at control points miss a part of that flux
    of the order of the panel size, for flat panels do not feel their own curvature; the diagonal is corrected by it.
    No closed body then has a net source in a stream, and the flow around converges with the second order: upstream of
    a cylinder of 12 panels the deficit is 1 % off instead of 12 %.
    """
    for p in range(matrix.shape[0]):
        panel_velocity(bodies, p, bodies.center, ground, has_ground, part)
        missing = bodies.far[p, 0]
        for i in range(matrix.shape[0]):
            n = bodies.normal[i]
            matrix[i, p] = n[0] * part[0, i] + n[1] * part[1, i] + n[2] * part[2, i]
            if bodies.owner[i] == bodies.owner[p]:
                missing -= bodies.far[i, 0] * matrix[i, p]
        matrix[p, p] += missing / bodies.far[p, 0]


@kernel(fastmath=FAST)
def panels_velocity(bodies, strength, points, ground, has_ground, part, out):
    """Add the velocity of all panels at points (3, n) to out (3, n), float64; part (3, n) is work."""
    for p in range(strength.shape[0]):
        panel_velocity(bodies, p, points, ground, has_ground, part)
        for c in range(3):
            for i in range(points.shape[1]):
                out[c, i] += strength[p] * part[c, i]


@kernel(fastmath=FAST, separate=True)
def add_body_velocity(bodies, strength, targets, velocity, n_target, origin, ground, has_ground):
    """Add the velocity of all panels and their images to float32 velocities at float32 targets.

    Parameters
    ----------
    strength : (n_panel,)
        Source strengths [m/s].
    targets, velocity : float32, (3, at least n_target)
        Positions relative to ``origin`` (3,) [m]; velocities [m/s].
    """
    zero, one, far_off = np.float32(0.0), np.float32(1.0), np.float32(FAR_OFF)
    for start in range(0, n_target, BLOCK):
        end = min(start + BLOCK, n_target)
        tx, ty, tz = targets[0, start:end], targets[1, start:end], targets[2, start:end]
        vx, vy, vz = velocity[0, start:end], velocity[1, start:end], velocity[2, start:end]
        for p in range(strength.shape[0]):
            s, f = strength[p], bodies.far[p]
            area, limit = np.float32(s * f[0]), np.float32(f[7])
            qxx, qyy, qzz = np.float32(s * f[1]), np.float32(s * f[2]), np.float32(s * f[3])
            qxy, qyz, qzx = np.float32(s * f[4]), np.float32(s * f[5]), np.float32(s * f[6])
            trace = np.float32(1.5) * (qxx + qyy + qzz)
            cx = np.float32(bodies.center[0, p] - origin[0])
            cy = np.float32(bodies.center[1, p] - origin[1])
            for image in range(2 if has_ground else 1):
                flip = -one if image == 1 else one
                cz = np.float32(bodies.center[2, p] - (2.0 * ground - origin[2] if image == 1 else origin[2]))
                near = zero
                for i in range(tx.shape[0]):
                    x, y, z = tx[i] - cx, ty[i] - cy, flip * tz[i] - cz
                    r2 = x * x + y * y + z * z
                    near += one if r2 < limit else zero
                    r2 = r2 if r2 >= limit else far_off
                    i2 = one / r2
                    i3 = i2 * np.sqrt(i2)
                    sx, sy, sz = qxx * x + qxy * y + qzx * z, qxy * x + qyy * y + qyz * z, qzx * x + qyz * y + qzz * z
                    radial = i3 * (area + i2 * (np.float32(7.5) * i2 * (sx * x + sy * y + sz * z) - trace))
                    side = np.float32(3.0) * i3 * i2
                    vx[i] += radial * x - side * sx
                    vy[i] += radial * y - side * sy
                    vz[i] += flip * (radial * z - side * sz)
                if near > zero:
                    for i in range(tx.shape[0]):
                        x, y, z = tx[i] - cx, ty[i] - cy, flip * tz[i] - cz
                        if x * x + y * y + z * z < limit:
                            u, v, w = near_velocity(bodies.corners[p], bodies.normal[p], bodies.center[0, p] + x,
                                                    bodies.center[1, p] + y, bodies.center[2, p] + z)  # fmt: skip
                            vx[i] += s * u
                            vy[i] += s * v
                            vz[i] += flip * (s * w)


@kernel(fastmath=FAST, separate=True)
def couple_bodies(bodies, work, points, ground, has_ground, influence, wake_flow):
    """Take the bodies out of the unknowns of the lattice, in place.

    The strengths that keep the flow from crossing the bodies are s = s0 - inverse B g for the ring circulations g,
    where B is the normal velocity of the unit rings at the control points and s0 answers wind and wake. With S the
    velocity of the panels at the points of the blades, the rings act there as ``influence`` - S inverse B, and the
    wake as ``wake_flow`` + S s0; the equations of the lattice stay as they are. To be called before the matrix of
    normal velocities is built from ``influence``.

    Parameters
    ----------
    bodies : BodyArrays
    work : BodyWork
        Reads ``ring_influence``, ``wind`` and ``wake_flow``; writes ``source_influence``, ``eliminated``, ``start``.
    points : (3, n_point)
        Points of the blades [m].
    influence : (n_ring, 3, n_point)
        Velocity of each unit ring at the points, with its image.
    wake_flow : (3, n_point)
        Velocity of the wake there [m/s].
    """
    n_panel, n_ring, n_point = work.start.shape[0], influence.shape[0], points.shape[1]
    through = work.through
    for p in range(n_panel):
        through[p] = 0.0
        for c in range(3):
            relative = work.wind[p, c] - bodies.motion[c, p] + work.wake_flow[c, p]
            through[p] += bodies.normal[p, c] * relative
        panel_velocity(bodies, p, points, ground, has_ground, work.source_influence[p])
    for p in range(n_panel):
        total = 0.0
        for m in range(n_panel):
            total += bodies.inverse[p, m] * through[m]
        work.start[p] = -total
    flow, source = wake_flow.reshape(3 * n_point), work.source_influence.reshape((n_panel, 3 * n_point))
    for p in range(n_panel):
        for i in range(3 * n_point):
            flow[i] += work.start[p] * source[p, i]
    rings = influence.reshape((n_ring, 3 * n_point))
    for r in range(n_ring):
        for p in range(n_panel):
            n = bodies.normal[p]
            v = work.ring_influence[r]
            through[p] = n[0] * v[0, p] + n[1] * v[1, p] + n[2] * v[2, p]
        for p in range(n_panel):
            total = 0.0
            for m in range(n_panel):
                total += bodies.inverse[p, m] * through[m]
            work.eliminated[r, p] = total
    # Four panels at a time: each pass over a row of the influence then does four times the work. Blocks of points: the
    # velocities of all panels there stay in the second-level cache.
    whole = n_panel // 4 * 4
    for begin in range(0, 3 * n_point, BLOCK):
        end = min(begin + BLOCK, 3 * n_point)
        for r in range(n_ring):
            row = rings[r, begin:end]
            e = work.eliminated[r]
            for p in range(0, whole, 4):
                s0, s1 = source[p, begin:end], source[p + 1, begin:end]
                s2, s3 = source[p + 2, begin:end], source[p + 3, begin:end]
                e0, e1, e2, e3 = e[p], e[p + 1], e[p + 2], e[p + 3]
                for i in range(row.shape[0]):
                    row[i] -= e0 * s0[i] + e1 * s1[i] + e2 * s2[i] + e3 * s3[i]
            for p in range(whole, n_panel):
                s0, e0 = source[p, begin:end], e[p]
                for i in range(row.shape[0]):
                    row[i] -= e0 * s0[i]


@kernel(fastmath=FAST)
def body_strengths(work, gamma, strength):
    """Source strengths (n_panel,) for the ring circulations (n_ring,) found by the lattice."""
    for p in range(strength.shape[0]):
        strength[p] = work.start[p]
    for r in range(gamma.shape[0]):
        for p in range(strength.shape[0]):
            strength[p] -= gamma[r] * work.eliminated[r, p]
