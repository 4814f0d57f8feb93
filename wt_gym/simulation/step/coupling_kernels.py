"""Compiled exchange between the blades as bodies and the blades as a lattice: motion one way, loads the other."""

import math

from wt_gym.base.compiled import kernel
from wt_gym.multibody.system import Points
from wt_gym.multibody.tree.output_kernels import joint_wrenches
from wt_gym.multibody.tree.point_kernels import point_loads, point_motion
from wt_gym.multibody.tree.tree_kernels import kinematics


@kernel
def rotor_motion(rot, r, v, omega, elastic, rates, points, lattice_bodies, sub_bodies, nodes, velocities):
    """Global positions and velocities (n_blades, n_points, 3) of the lattice points.

    rot, r, v, omega are the frames of all bodies; elastic and rates (n_lattice_bodies, n_f) the coordinates of the
    bodies that carry the lattice: the blades or (`SubBodyNodes`) the sub-bodies of one blade after the other.
    """
    if sub_bodies is None:
        for i in range(lattice_bodies.shape[0]):
            b = lattice_bodies[i]
            point_motion(rot[b], r[b], v[b], omega[b], elastic[i], rates[i], points_of_sub_body(points, 0), nodes[i],
                         velocities[i])  # fmt: skip
    else:
        for i in range(lattice_bodies.shape[0]):
            b, p = lattice_bodies[i], i % sub_bodies.count.shape[0]
            n, blade = sub_bodies.count[p], i // sub_bodies.count.shape[0]
            position, velocity = sub_bodies.position[:n], sub_bodies.velocity[:n]
            point_motion(rot[b], r[b], v[b], omega[b], elastic[i], rates[i], points_of_sub_body(points, p), position,
                         velocity)  # fmt: skip
            for k in range(n):
                for c in range(3):
                    nodes[blade, sub_bodies.node[p, k], c] = position[k, c]
                    velocities[blade, sub_bodies.node[p, k], c] = velocity[k, c]


@kernel(inline="always")
def points_of_sub_body(points, p):
    """`Points` of one sub-body, views."""
    return Points(points.position[p], points.linear[p], points.second[p])


@kernel
def rotor_loads(forces, rot, elastic, points, lattice_bodies, sub_bodies, loads):
    """Loads (n_b, 6 + n_f) of the bodies from forces (n_blades, n_points, 3) on the lattice points, by virtual work.

    Carriers and sub-bodies as for `rotor_motion`.

    Returns the largest change of a force component against what ``loads`` held, divided by the largest component.
    """
    change, size = 0.0, 1e-30
    for i in range(lattice_bodies.shape[0]):
        b = lattice_bodies[i]
        old0, old1, old2 = loads[b, 0], loads[b, 1], loads[b, 2]
        for k in range(loads.shape[1]):
            loads[b, k] = 0.0
        if sub_bodies is None:
            point_loads(rot[b], elastic[i], points_of_sub_body(points, 0), forces[i], loads[b])
        else:
            p, blade = i % sub_bodies.count.shape[0], i // sub_bodies.count.shape[0]
            n = sub_bodies.count[p]
            force = sub_bodies.position[:n]
            for k in range(n):
                for c in range(3):
                    force[k, c] = forces[blade, sub_bodies.node[p, k], c]
            point_loads(rot[b], elastic[i], points_of_sub_body(points, p), force, loads[b])
        change = max(change, abs(loads[b, 0] - old0), abs(loads[b, 1] - old1), abs(loads[b, 2] - old2))
        size = max(size, abs(loads[b, 0]), abs(loads[b, 1]), abs(loads[b, 2]))
    return change / size


@kernel(separate=True)
def tower_drag(y, tree, work, tower, loads):
    """Loads (6 + n_f,) of the tower: the drag of the wind, by virtual work, on top of what is given by its body in the
    flow (`wt_gym.simulation.step.coupling`); kinematics are up to date.

    A cylinder across the flow: the force of a point that stands for a piece of the tower is ½ ρ C_d D l |w| w, with the
    part w across the tower of the wind relative to the moving point. tower: `TowerAir`.
    """
    b = tower.body
    n, q, u = tree.n_elastic[b], tree.elastic_q[b], tree.n_q + tree.elastic_u[b]
    rot, elastic = work.rot[b], y[q : q + n]
    point_motion(rot, work.r[b], work.v[b], work.omega[b], elastic, y[u : u + n], tower.points, tower.position,
                 tower.velocity)  # fmt: skip
    for k in range(loads.shape[0]):
        loads[k] = tower.given[k]
    for p in range(tower.drag.shape[0]):
        along, square = 0.0, 0.0
        for i in range(3):
            tower.force[p, i] = tower.wind[p, i] - tower.velocity[p, i]
            along += tower.force[p, i] * rot[i, 2]
        for i in range(3):
            tower.force[p, i] -= along * rot[i, 2]
            square += tower.force[p, i] * tower.force[p, i]
        for i in range(3):
            tower.force[p, i] *= tower.drag[p] * math.sqrt(square)
    point_loads(rot, elastic, tower.points, tower.force, loads)


@kernel
def rotor_resultant(nodes, forces, center, axis):
    """Force along the shaft [N] and moment about it [N m] of the lattice forces."""
    thrust, torque = 0.0, 0.0
    for i in range(nodes.shape[0]):
        for n in range(nodes.shape[1]):
            fx, fy, fz = forces[i, n, 0], forces[i, n, 1], forces[i, n, 2]
            rx, ry, rz = nodes[i, n, 0] - center[0], nodes[i, n, 1] - center[1], nodes[i, n, 2] - center[2]
            thrust += fx * axis[0] + fy * axis[1] + fz * axis[2]
            torque += axis[0] * (ry * fz - rz * fy) + axis[1] * (rz * fx - rx * fz) + axis[2] * (rx * fy - ry * fx)
    return thrust, torque


@kernel
def view_from_tower(tip, base, top, axis, height, radius, out):
    """Where a tip is, seen from the tower's axis at its height, a straight line from base to top.

    Parameters
    ----------
    tip, base, top : (3,)
        [m].
    axis : (3,)
        Of the nacelle, downwind.
    height, radius : (n,)
        Of the tower, heights above the base [m].
    out : (4,)
        How far the tip is upwind along the nacelle's axis, to its side, above the top of the tower, and the tower's
        radius at this height [m].
    """
    s = min(max((tip[2] - base[2]) / (top[2] - base[2]), 0.0), 1.0)
    dx = tip[0] - (base[0] + s * (top[0] - base[0]))
    dy = tip[1] - (base[1] + s * (top[1] - base[1]))
    level = 1.0 / math.hypot(axis[0], axis[1])
    out[0] = -(dx * axis[0] + dy * axis[1]) * level
    out[1] = (dy * axis[0] - dx * axis[1]) * level
    out[2] = tip[2] - top[2]
    n, k = height.shape[0], 0
    z = s * height[n - 1]
    while k < n - 2 and height[k + 1] < z:
        k += 1
    w = (z - height[k]) / (height[k + 1] - height[k])
    out[3] = (1.0 - w) * radius[k] + w * radius[k + 1]


@kernel
def signed_clearance(view):
    """Distance [m] of a tip from the tower, negative where a blade from the upwind side cannot be without touching it.

    Upwind of the tower's axis it is the distance from the surface, downwind of it the distance from the space behind
    the tower; within that space minus the distance along the nacelle's axis from the front of the tower (exactly in the
    middle, falling to zero at its sides). Above the tower top it is the distance from the upper rim.
    """
    ahead, beside, above, radius = view[0], abs(view[1]), view[2], view[3]
    if ahead >= 0.0:
        gap = math.hypot(ahead, beside) - radius
    elif beside >= radius:
        gap = beside - radius
    else:
        gap = (beside - radius) * (1.0 - ahead / radius)
    return math.hypot(max(gap, 0.0), above) if above > 0.0 else gap


@kernel
def passing_clearance(before, now, between):
    """Least signed clearance [m] on the straight way between two views of a tip; ``between`` (4,) is scratch.

    It is sought at the end and where the way comes closest to the tower's axis.
    """
    along, square = 0.0, 0.0
    for c in range(2):
        along -= before[c] * (now[c] - before[c])
        square += (now[c] - before[c]) ** 2
    s = min(max(along / square, 0.0), 1.0) if square > 0.0 else 1.0
    for c in range(4):
        between[c] = before[c] + s * (now[c] - before[c])
    return min(signed_clearance(now), signed_clearance(between))


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


@kernel(separate=True, distinct=True)
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
        root, b = g.blades[i], g.tip_bodies[i]
        n, q, u = tree.n_elastic[b], tree.elastic_q[b], tree.n_q + tree.elastic_u[b]
        point_motion(work.rot[b], work.r[b], work.v[b], work.omega[b], y[q : q + n], y[u : u + n], g.tip_points,
                     g.tips[i : i + 1], g.tip_velocity[i : i + 1])  # fmt: skip
        tip_deflection(g.tips[i], work.r[root], work.rot[g.hub], g.root_rotation[i], g.tip_rest,
                       y[n_y + 1 + i], g.deflection[i])  # fmt: skip
        base = work.r[g.indices.tower] if g.tower_moves else g.tower_base
        view_from_tower(g.tips[i], base, work.r[g.nacelle], work.rot[g.nacelle, :, 0], g.tower_height,
                        g.tower_radius, g.tower_view[i])  # fmt: skip
        g.clearance[i] = signed_clearance(g.tower_view[i])
