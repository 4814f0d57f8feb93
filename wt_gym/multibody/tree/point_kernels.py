"""Compiled motion of material points of a body, and the loads of forces on them."""

from wt_gym.base.compiled import kernel


@kernel(inline="always")
def mode_at_point(points, n, k, q):
    """Displacement of point n per unit of the coordinate k: its mean from the undeformed state, and its rate at q.

    Returns S + ½ H q (three numbers) and S + H q (three numbers).
    """
    s0, s1, s2 = points.linear[n, 0, k], points.linear[n, 1, k], points.linear[n, 2, k]
    h0, h1, h2 = 0.0, 0.0, 0.0
    for j in range(q.shape[0]):
        h0 += points.second[n, 0, k, j] * q[j]
        h1 += points.second[n, 1, k, j] * q[j]
        h2 += points.second[n, 2, k, j] * q[j]
    return s0 + 0.5 * h0, s1 + 0.5 * h1, s2 + 0.5 * h2, s0 + h0, s1 + h1, s2 + h2


@kernel
def point_motion(rot, r, v, w, q, rate, points, position, velocity):
    """Global position and velocity of points that move with a body.

    Parameters
    ----------
    rot, r, v, w : (3, 3), (3,), (3,), (3,)
        Frame of the body: orientation and origin (global), velocity and angular velocity (body components).
    q, rate : (n_f,)
        Elastic coordinates and their rates.
    points : Points
        position (n, 3), linear (n, 3, n_f), second (n, 3, n_f, n_f).
    position, velocity : (n, 3)
        Filled.
    """
    for n in range(position.shape[0]):
        x0, x1, x2 = points.position[n, 0], points.position[n, 1], points.position[n, 2]
        v0, v1, v2 = v[0], v[1], v[2]
        for k in range(q.shape[0]):
            d0, d1, d2, s0, s1, s2 = mode_at_point(points, n, k, q)
            x0 += d0 * q[k]
            x1 += d1 * q[k]
            x2 += d2 * q[k]
            v0 += s0 * rate[k]
            v1 += s1 * rate[k]
            v2 += s2 * rate[k]
        v0 += w[1] * x2 - w[2] * x1
        v1 += w[2] * x0 - w[0] * x2
        v2 += w[0] * x1 - w[1] * x0
        for i in range(3):
            position[n, i] = r[i] + rot[i, 0] * x0 + rot[i, 1] * x1 + rot[i, 2] * x2
            velocity[n, i] = rot[i, 0] * v0 + rot[i, 1] * v1 + rot[i, 2] * v2


@kernel
def point_loads(rot, q, points, force, loads):
    """Add global point forces (n, 3) to the loads (6 + n_f,) of a body by virtual work, body components."""
    for n in range(force.shape[0]):
        x0, x1, x2 = points.position[n, 0], points.position[n, 1], points.position[n, 2]
        g0, g1, g2 = force[n, 0], force[n, 1], force[n, 2]
        f0 = rot[0, 0] * g0 + rot[1, 0] * g1 + rot[2, 0] * g2
        f1 = rot[0, 1] * g0 + rot[1, 1] * g1 + rot[2, 1] * g2
        f2 = rot[0, 2] * g0 + rot[1, 2] * g1 + rot[2, 2] * g2
        for k in range(q.shape[0]):
            d0, d1, d2, s0, s1, s2 = mode_at_point(points, n, k, q)
            x0 += d0 * q[k]
            x1 += d1 * q[k]
            x2 += d2 * q[k]
            loads[6 + k] += s0 * f0 + s1 * f1 + s2 * f2
        loads[0] += f0
        loads[1] += f1
        loads[2] += f2
        loads[3] += x1 * f2 - x2 * f1
        loads[4] += x2 * f0 - x0 * f2
        loads[5] += x0 * f1 - x1 * f0
