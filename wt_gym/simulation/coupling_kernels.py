"""Compiled exchange between the blades as bodies and the blades as a lattice: motion one way, loads the other."""

import math

from wt_gym.compiled import kernel
from wt_gym.multibody.tree.output_kernels import joint_wrenches
from wt_gym.multibody.tree.point_kernels import point_loads, point_motion
from wt_gym.multibody.tree.tree_kernels import kinematics


@kernel
def rotor_motion(rot, r, v, omega, elastic, rates, points, blades, nodes, velocities):
    """Global positions and velocities (n_blades, n_points, 3) of the lattice points.

    rot, r, v, omega are the frames of all bodies; elastic and rates (n_blades, n_f) the blades' coordinates.
    """
    for i in range(blades.shape[0]):
        b = blades[i]
        point_motion(rot[b], r[b], v[b], omega[b], elastic[i], rates[i], points, nodes[i], velocities[i])


@kernel
def rotor_loads(forces, rot, elastic, points, blades, loads):
    """Loads (n_b, 6 + n_f) of the bodies from forces (n_blades, n_points, 3) on the lattice points, by virtual work.

    Returns the largest change of a force component against what ``loads`` held, divided by the largest component.
    """
    change, size = 0.0, 1e-30
    for i in range(blades.shape[0]):
        b = blades[i]
        old0, old1, old2 = loads[b, 0], loads[b, 1], loads[b, 2]
        for k in range(loads.shape[1]):
            loads[b, k] = 0.0
        point_loads(rot[b], elastic[i], points, forces[i], loads[b])
        change = max(change, abs(loads[b, 0] - old0), abs(loads[b, 1] - old1), abs(loads[b, 2] - old2))
        size = max(size, abs(loads[b, 0]), abs(loads[b, 1]), abs(loads[b, 2]))
    return change / size


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
def tip_deflection(tip, root, hub_rotation, root_rotation, rest, pitch, out):
    """Displacement (3,) of a tip from its undeformed place, in the axes of the unpitched root."""
    cos, sin = math.cos(pitch), math.sin(pitch)
    out[0] = -(cos * rest[0] + sin * rest[1])
    out[1] = -(cos * rest[1] - sin * rest[0])
    out[2] = -rest[2]
    for c in range(3):
        in_hub = 0.0
        for i in range(3):
            in_hub += (tip[i] - root[i]) * hub_rotation[i, c]
        for k in range(3):
            out[k] += in_hub * root_rotation[c, k]


@kernel
def observe(y, rates, body_loads, tree, work, hub, nacelle, blades, tip_points, nodes, forces, tower, root_rotation,
            pitch, wrench, tips, tip_velocity, deflection, clearance, totals):  # fmt: skip
    """What is measured beyond the state, in one call; kinematics are brought up to date.

    Parameters
    ----------
    y, rates : array (n_state,), (n_u,)
        State and accelerations.
    body_loads, tree, work : arrays of the multibody system
    hub, nacelle, blades : int, int, array (n_blades,) of int
        Bodies.
    tip_points : Points
        The tip of a blade.
    nodes, forces : (n_blades, n_points, 3)
        Lattice points [m] and the forces of the air on them [N].
    tower : (base (3,), heights (n,), radii (n,))
    root_rotation : (n_blades, 3, 3)
        Orientation of the unpitched blade roots in the hub.
    pitch : (n_blades,)
        [rad].
    wrench : (n_b, 6); tips, tip_velocity, deflection : (n_blades, 3); clearance : (n_blades,)
        Results.
    totals : (5,)
        Thrust [N] and torque [N m] of the air, acceleration of the nacelle in its own axes [m/s²].
    """
    kinematics(y, tree, work)
    joint_wrenches(y, rates, body_loads, tree, work, wrench)
    axis = work.rot[hub, :, 0]
    totals[0], totals[1] = rotor_resultant(nodes, forces, work.r[hub], axis)
    for i in range(3):
        totals[2 + i] = work.bias_lin[nacelle, i]
        for c in range(tree.n_col[nacelle]):
            totals[2 + i] += work.vl[nacelle, i, c] * rates[tree.cols[nacelle, c]]
    for i in range(blades.shape[0]):
        b = blades[i]
        n, q, u = tree.n_elastic[b], tree.elastic_q[b], tree.n_q + tree.elastic_u[b]
        point_motion(work.rot[b], work.r[b], work.v[b], work.omega[b], y[q : q + n], y[u : u + n], tip_points,
                     tips[i : i + 1], tip_velocity[i : i + 1])  # fmt: skip
        tip_deflection(tips[i], work.r[b], work.rot[hub], root_rotation[i], tip_points.position[0], pitch[i],
                       deflection[i])  # fmt: skip
    tower_clearance(tips, tower[0], work.r[nacelle], tower[1], tower[2], clearance)
