"""Compiled exchange between the blades as bodies and the blades as a lattice: motion one way, loads the other."""

import math

from wt_gym.compiled import kernel
from wt_gym.multibody.tree_kernels import joint_wrenches, kinematics, point_loads, point_motion


@kernel
def rotor_motion(y, tree, work, points, blades, nodes, velocities):
    """Global positions and velocities (n_blades, n_points, 3) of the lattice points; updates the kinematics."""
    kinematics(y, tree, work)
    for i in range(blades.shape[0]):
        point_motion(blades[i], points, y, tree, work, nodes[i], velocities[i])


@kernel
def rotor_loads(forces, y, tree, work, points, blades, loads):
    """Loads (n_b, 6 + n_f) of the bodies from forces (n_blades, n_points, 3) on the lattice points, by virtual work.

    Returns the largest change of a load against what ``loads`` held, divided by the largest load of its kind.
    """
    change, size = 0.0, 1e-30
    for i in range(blades.shape[0]):
        b = blades[i]
        old = work.loads[b]
        for k in range(loads.shape[1]):
            old[k] = loads[b, k]
            loads[b, k] = 0.0
        point_loads(b, points, forces[i], y, tree, work, loads[b])
        for k in range(3):
            size = max(size, abs(loads[b, k]))
            change = max(change, abs(loads[b, k] - old[k]))
    return change / size


@kernel
def loads_power(y, tree, work, loads):
    """Power [W] that the body loads feed into the structure: Σ F·v + M·ω + Q·q̇ (kinematics up to date)."""
    power = 0.0
    for b in range(loads.shape[0]):
        for i in range(3):
            power += loads[b, i] * work.v[b, i] + loads[b, 3 + i] * work.omega[b, i]
        for k in range(tree.n_elastic[b]):
            power += loads[b, 6 + k] * y[tree.n_q + tree.elastic_u[b] + k]
    return power


@kernel
def rotor_resultant(nodes, forces, centre, axis):
    """Force along the shaft [N] and moment about it [N m] of the lattice forces."""
    thrust, torque = 0.0, 0.0
    for i in range(nodes.shape[0]):
        for n in range(nodes.shape[1]):
            fx, fy, fz = forces[i, n, 0], forces[i, n, 1], forces[i, n, 2]
            rx, ry, rz = nodes[i, n, 0] - centre[0], nodes[i, n, 1] - centre[1], nodes[i, n, 2] - centre[2]
            thrust += fx * axis[0] + fy * axis[1] + fz * axis[2]
            torque += axis[0] * (ry * fz - rz * fy) + axis[1] * (rz * fx - rx * fz) + axis[2] * (rx * fy - ry * fx)
    return thrust, torque


@kernel
def tip_positions(y, tree, work, tip, blades, hub, root_rotation, tips, velocity, deflection):
    """Blade tips (n_blades, 3): global position and deflection from the pitched undeformed tip in the coned frame."""
    n_y = tree.n_q + tree.n_u
    for i in range(blades.shape[0]):
        b = blades[i]
        point_motion(b, tip, y, tree, work, tips[i : i + 1], velocity)
        angle = y[n_y + tree.servo[b]]
        c, s = math.cos(angle), math.sin(angle)
        x0, y0, z0 = tip.position[0, 0], tip.position[0, 1], tip.position[0, 2]
        rest = work.th
        rest[0], rest[1], rest[2] = c * x0 + s * y0, -s * x0 + c * y0, z0
        for k in range(3):
            deflection[i, k] = -rest[k]
            for j in range(3):
                arm = tips[i, j] - work.r[b, j]
                axis = 0.0
                for m in range(3):
                    axis += work.rot[hub, j, m] * root_rotation[i, m, k]
                deflection[i, k] += axis * arm


@kernel
def tower_clearance(tips, base, top, tower_z, tower_radius, out):
    """Distance [m] of each tip from the tower surface (axis straight from base to top), or from its upper rim."""
    for i in range(tips.shape[0]):
        s = (tips[i, 2] - base[2]) / (top[2] - base[2])
        s = min(max(s, 0.0), 1.0)
        dx = tips[i, 0] - (base[0] + s * (top[0] - base[0]))
        dy = tips[i, 1] - (base[1] + s * (top[1] - base[1]))
        dz = max(tips[i, 2] - top[2], 0.0)
        z = s * tower_z[-1]
        n = tower_z.shape[0]
        k = 0
        while k < n - 2 and tower_z[k + 1] < z:
            k += 1
        w = (z - tower_z[k]) / (tower_z[k + 1] - tower_z[k])
        radius = (1.0 - w) * tower_radius[k] + w * tower_radius[k + 1]
        out[i] = math.sqrt(max(math.sqrt(dx * dx + dy * dy) - radius, 0.0) ** 2 + dz * dz)
        if dz == 0.0:
            out[i] = math.sqrt(dx * dx + dy * dy) - radius


@kernel
def interface_loads(y, acceleration, loads, tree, work, wrench):
    """Joint wrenches (n_b, 6) for the state with its accelerations; updates the kinematics."""
    kinematics(y, tree, work)
    joint_wrenches(y, acceleration, loads, tree, work, wrench)


@kernel
def origin_acceleration(b, acceleration, tree, work, out):
    """True acceleration (3,) of the frame origin of body b in body components (kinematics up to date)."""
    for i in range(3):
        out[i] = work.bias_lin[b, i]
        for c in range(tree.n_col[b]):
            out[i] += work.vl[b, i, c] * acceleration[tree.cols[b, c]]
