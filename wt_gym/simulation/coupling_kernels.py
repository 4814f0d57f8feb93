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
def read_gauges(y, dy, body_loads, tree, work, g):
    """What is measured on the structure beyond its state, into the gauges; kinematics are brought up to date.

    Parameters
    ----------
    y, dy : array (n_state,)
        State and its rate.
    body_loads, tree, work : arrays of the multibody system
    g : Gauges
    """
    n_y = tree.n_q + tree.n_u
    for s in range(tree.n_servo):
        work.servo_acceleration[s] = dy[n_y + tree.n_servo + s]
    accelerations = dy[tree.n_q : n_y]
    kinematics(y, tree, work)
    joint_wrenches(y, accelerations, body_loads, tree, work, g.wrench)
    for i in range(3):
        g.nacelle_acceleration[i] = work.bias_lin[g.nacelle, i]
        for c in range(tree.n_col[g.nacelle]):
            g.nacelle_acceleration[i] += work.vl[g.nacelle, i, c] * accelerations[tree.cols[g.nacelle, c]]
    for i in range(g.blades.shape[0]):
        b = g.blades[i]
        n, q, u = tree.n_elastic[b], tree.elastic_q[b], tree.n_q + tree.elastic_u[b]
        point_motion(work.rot[b], work.r[b], work.v[b], work.omega[b], y[q : q + n], y[u : u + n], g.tip_points,
                     g.tips[i : i + 1], g.tip_velocity[i : i + 1])  # fmt: skip
        tip_deflection(g.tips[i], work.r[b], work.rot[g.hub], g.root_rotation[i], g.tip_points.position[0],
                       y[n_y + 1 + i], g.deflection[i])  # fmt: skip
    tower_clearance(g.tips, g.tower_base, work.r[g.nacelle], g.tower_height, g.tower_radius, g.clearance)
