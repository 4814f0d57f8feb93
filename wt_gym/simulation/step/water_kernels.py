"""Compiled exchange between a floater and the water: its motion one way, loads and signals the other."""

from wt_gym.base.compiled import kernel
from wt_gym.hydrodynamics.loads_kernels import platform_force


@kernel(separate=True)
def floater_loads(work, water, loads):
    """Loads (6 + n_f,) of the floater, body axes, at the end of a step; the kinematics belong to it.

    Parameters
    ----------
    work : Work
    water : Water
    loads : (6 + n_f,)

    Returns
    -------
    int
        OK, or the code of a mooring line without a solution.
    """
    b, force = water.body, water.force
    floater_motion(work, water)
    code = platform_force(water.platform, work.r[b], work.rot[b], water.velocity, water.spin, force)
    for i in range(3):
        loads[i], loads[3 + i] = 0.0, 0.0
        for j in range(3):
            loads[i] += work.rot[b, j, i] * force[j]
            loads[3 + i] += work.rot[b, j, i] * force[3 + j]
    return code


@kernel
def floater_motion(work, water):
    """Velocity and angular velocity of the floater along global axes, into ``water``."""
    b = water.body
    for i in range(3):
        water.velocity[i], water.spin[i] = 0.0, 0.0
        for j in range(3):
            water.velocity[i] += work.rot[b, i, j] * work.v[b, j]
            water.spin[i] += work.rot[b, i, j] * work.omega[b, j]


@kernel(separate=True)
def fill_platform(y, dy, tree, work, water, values):
    """Channels of the platform, in the order of `wt_gym.simulation.channels.PLATFORM`, and of the lines.

    Parameters
    ----------
    y, dy : (n_state,)
        State and its rate, to which the kinematics belong.
    tree, work : arrays of the multibody system
    water : Water
    values : (n_channels,)
    """
    b, at, p = water.body, water.at, water.platform
    q, u = tree.joint_q[b], tree.n_q + tree.joint_u[b]
    floater_motion(work, water)
    for i in range(3):
        turning = 0.0
        for j in range(3):
            spin_up = work.bias_ang[b, j]
            for c in range(3):
                spin_up += work.va[b, j, 3 + c] * dy[u + 3 + c]
            turning += work.rot[b, i, j] * spin_up
        values[at + i], values[at + 3 + i] = y[q + i], y[q + 3 + i]
        values[at + 6 + i], values[at + 9 + i] = water.velocity[i], water.spin[i]
        values[at + 12 + i], values[at + 15 + i] = dy[u + i], turning
    values[at + 18] = p.elevation[0]
    n = p.line_tension.shape[0]
    for k in range(n):
        values[at + 19 + k], values[at + 19 + n + k] = p.line_tension[k, 0], p.line_tension[k, 1]
