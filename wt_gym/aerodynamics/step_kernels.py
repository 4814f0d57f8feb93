"""The three compiled calls of an aerodynamic step: move the wake, solve the boundary condition, accept.

``p`` are `PlanformArrays`, ``a`` are `AeroArrays`, ``scratch`` are the float32 work arrays of the lattice.
"""

import numpy as np

from wt_gym.aerodynamics.bound_kernels import (
    bound_influence,
    decambering,
    geometry,
    invert_boundary_condition,
    potential_loads,
    relative_wind,
    section_state,
    strip_axes,
    viscous_loads,
)
from wt_gym.aerodynamics.far_wake_kernels import measure_far_wake
from wt_gym.aerodynamics.induction_kernels import FAST, build_sheet, open_newest_ring
from wt_gym.aerodynamics.wake_kernels import (
    age_rows,
    convect,
    place_newest_row,
    refresh_induced,
    trailing_edge,
    velocity_at_points,
)
from wt_gym.compiled import kernel

TOLERANCE = 1e-7  # of the decambering, relative to the largest section speed
MAX_ITERATIONS = 8


@kernel(fastmath=False, _nrt=True)
def copy_nodes(source, target):
    """Copy (n_blade, n_row, n_node, 3); loops compile many times faster than array assignments."""
    for b in range(source.shape[0]):
        for i in range(source.shape[1]):
            for j in range(source.shape[2]):
                for c in range(3):
                    target[b, i, j, c] = source[b, i, j, c]


@kernel(fastmath=False, _nrt=True)
def mirror(nodes, ground, mirrored):
    """Mirror images of nodes (n_blade, n_row, n_node, 3) in the ground."""
    copy_nodes(nodes, mirrored)
    for b in range(nodes.shape[0]):
        for i in range(nodes.shape[1]):
            for j in range(nodes.shape[2]):
                mirrored[b, i, j, 2] = 2.0 * ground - nodes[b, i, j, 2]


@kernel(fastmath=FAST, _nrt=True)
def apply_inverse(inverse, source, through, weight, n_chord, n_span, gamma):
    """Circulations (n_ring,) for the normal velocities ``through`` and ``weight`` times the decambering ``source``."""
    n_ring = gamma.shape[0]
    for r in range(n_ring):
        total = 0.0
        for m in range(n_ring):
            strip = m // (n_chord * n_span) * n_span + m % n_span
            total += inverse[r, m] * (weight * source[strip] - through[m])
        gamma[r] = total


@kernel(fastmath=False, _nrt=True)
def convect_wake(a, wind, dt, full_rows, stride, shed_fraction):
    """Move all wake rows and the air at the trailing edge through one step and make room for the new row."""
    n_rows = a.count[0]
    ratio = dt / a.clock[0] if a.count[2] > 1 else 0.0
    convect(a.wake, a.induced, a.history, wind, n_rows, dt, ratio)
    a.clock[2] = dt
    for b in range(a.wake.shape[1]):
        for j in range(a.wake.shape[2]):
            for c in range(3):
                a.free_edge[b, j, c] = a.wake[0, b, j, c]
    a.count[1] += 1
    a.count[0] = age_rows(a.wake, a.induced, a.history, a.wake_gamma, a.age, a.shed, n_rows, dt, full_rows, stride,
                          a.count[1], shed_fraction)  # fmt: skip
    if a.count[0] == a.wake.shape[0] - 1:
        a.count[4] = 1
    a.count[3] = 0


@kernel(fastmath=False, _nrt=True)
def prepare(p, a, nodes, sheet, targets, velocity, scratch, points, bound_core, wake_core, viscosity, squire,
            shed_fraction, far_wake, n_tail, ground, has_ground, place):  # fmt: skip
    """What is computed once a step: newest row, influence of the bound rings, velocity of the wake at the blades."""
    n_blade, n_row, n_node, _ = nodes.shape
    n_chord, n_span = n_row - 1, n_node - 1
    n_ring = n_blade * n_chord * n_span
    n_rows = a.count[0]
    normal, area = np.empty((n_ring, 3)), np.empty(n_ring)
    geometry(nodes, points, normal, area)
    trailing_edge(nodes, a.wake[0])
    if n_rows > 0 and place:
        place_newest_row(a.free_edge, shed_fraction, a.wake)
    part = np.empty((3, points.shape[1]))
    bound_influence(nodes, a.wake[1], n_rows > 0, p.edge_chord, bound_core, wake_core, points, part, a.influence)
    if has_ground:
        mirrored, newest = np.empty(nodes.shape), np.empty(a.free_edge.shape)
        mirror(nodes, ground, mirrored)
        for b in range(n_blade):
            for j in range(n_node):
                newest[b, j, 0] = a.wake[1, b, j, 0]
                newest[b, j, 1] = a.wake[1, b, j, 1]
                newest[b, j, 2] = 2.0 * ground - a.wake[1, b, j, 2]
        image = np.empty(a.influence.shape)
        bound_influence(mirrored, newest, n_rows > 0, p.edge_chord, bound_core, wake_core, points, part, image)
        for r in range(n_ring):
            for c in range(3):
                for i in range(points.shape[1]):
                    a.influence[r, c, i] -= image[r, c, i]
    invert_boundary_condition(a.influence, normal, n_blade, n_chord, n_span, a.inverse, a.response)
    for c in range(3):
        for i in range(points.shape[1]):
            a.wake_flow[c, i] = 0.0
    if n_rows > 0:
        if far_wake and a.count[4] == 1 and n_rows > 1:
            measure_far_wake(a.wake, a.wake_gamma, a.age, n_rows, min(n_tail, n_rows - 1), a.origin, nodes[:, n_chord],
                             a.clock[2] if place else 0.0, a.far)  # fmt: skip
        build_sheet(nodes, a.gamma, a.wake, a.wake_gamma, n_rows, a.age, p.edge_chord, wake_core, viscosity, squire,
                    a.origin, a.far[0] == 0.0, sheet)  # fmt: skip
        open_newest_ring(sheet, n_chord, n_rows, a.wake_gamma)
        velocity_at_points(sheet[n_chord + 1 : n_chord + n_rows + 1], points, targets, velocity, scratch, a.origin,
                           ground, has_ground, a.far, p.cylinder_table, a.wake_flow)  # fmt: skip
    a.count[3] = 1


@kernel(fastmath=False, _nrt=True)
def solve(p, a, nodes, velocities, wind, dt, density, viscous, lag, unsteady, first, points):
    """Circulation and nodal forces at the given nodes, with the wake frozen."""
    n_blade, n_row, n_node, _ = nodes.shape
    n_chord, n_span = n_row - 1, n_node - 1
    n_strip = n_blade * n_span
    n_ring = n_strip * n_chord
    normal, area = np.empty((n_ring, 3)), np.empty(n_ring)
    flow = np.empty((3, points.shape[1]))
    axes, normals, width = np.empty((n_strip, 3)), np.empty((n_strip, 3)), np.empty(n_strip)
    copy_nodes(nodes, a.nodes)
    geometry(nodes, points, normal, area)
    relative_wind(nodes, velocities, wind, flow)
    for c in range(3):
        for i in range(points.shape[1]):
            flow[c, i] += a.wake_flow[c, i]
    strip_axes(nodes, axes, normals, width)
    through = np.empty(n_ring)
    for r in range(n_ring):
        through[r] = flow[0, r] * normal[r, 0] + flow[1, r] * normal[r, 1] + flow[2, r] * normal[r, 2]
    gamma = a.gamma.reshape(n_ring)
    apply_inverse(a.inverse, a.source, through, 0.0, n_chord, n_span, gamma)
    along, potential = np.empty(n_strip), np.empty(n_strip)
    tilt = np.empty(n_span)
    for j in range(n_span):
        tilt[j] = p.slope_angle[j] - p.alpha0[j]
    for k in range(n_strip):
        b, j = k // n_span, k % n_span
        potential[k] = a.gamma[b, n_chord - 1, j]
        along[k] = 0.0
        for i in range(n_chord):
            r = (b * n_chord + i) * n_span + j
            for c in range(3):
                along[k] += flow[c, r] * axes[k, c] / n_chord
    if viscous:
        a.clock[1] = decambering(potential, along, a.response, a.source_1, first, dt, lag, p.chord, p.kappa, tilt,
                                 p.alpha0, p.polars, n_blade, TOLERANCE, MAX_ITERATIONS, a.source)  # fmt: skip
        apply_inverse(a.inverse, a.source, through, 1.0, n_chord, n_span, gamma)
    for k in range(n_strip):
        b, j = k // n_span, k % n_span
        across = a.gamma[b, n_chord - 1, j] / p.kappa[j] + a.source[k]
        a.alpha[k], a.speed[k], _, _ = section_state(across, along[k], tilt[j], p.polars[j], p.alpha0[j], p.chord[j],
                                                     p.kappa[j])  # fmt: skip
    for c in range(3):
        for r in range(n_ring):
            g = gamma[r]
            for i in range(n_ring, points.shape[1]):
                flow[c, i] += g * a.influence[r, c, i]
    gamma_1, gamma_2 = a.gamma_1.reshape(n_ring), a.gamma_2.reshape(n_ring)
    rate = through  # its memory is free now
    # Backward difference of second order for the steps dt and h dt; of first order after a start.
    now, before, earlier = 0.0, 0.0, 0.0
    if unsteady and a.count[2] == 1 and dt > 0.0:
        now, before = 1.0 / dt, -1.0 / dt
    elif unsteady and a.count[2] > 1:
        h = a.clock[0] / dt
        now, before, earlier = (2.0 + h) / (1.0 + h) / dt, -(1.0 + h) / (h * dt), 1.0 / (h * (1.0 + h) * dt)
    for r in range(n_ring):
        rate[r] = now * gamma[r] + before * gamma_1[r] + earlier * gamma_2[r]
    for b in range(n_blade):
        for i in range(n_row):
            for j in range(n_node):
                for c in range(3):
                    a.forces[b, i, j, c] = 0.0
    potential_loads(nodes, gamma, rate, flow, normal, area, density, a.forces)
    if viscous:
        viscous_loads(nodes, axes, normals, width, a.alpha, a.speed, p.slope_angle, p.chord, p.moment0, p.polars,
                      density, a.forces)  # fmt: skip


@kernel(fastmath=False, _nrt=True)
def accept(p, a, sheet, rows, targets, velocity, scratch, wake_core, viscosity, squire, fresh_rows, refresh_stride,
           shed_fraction, ground, has_ground, place):  # fmt: skip
    """Shed the newest ring and compute the induced velocities with which the wake moves on."""
    n_chord = a.gamma.shape[1]
    n_rows = a.count[0]
    trailing_edge(a.nodes, a.wake[0])
    if n_rows > 0 and place:
        place_newest_row(a.free_edge, shed_fraction, a.wake)
    start = a.count[2] == 0
    for b in range(a.gamma.shape[0]):
        for j in range(a.gamma.shape[2]):
            a.wake_gamma[0, b, j] = a.gamma[b, n_chord - 1, j]
            for i in range(n_chord):
                a.gamma_2[b, i, j] = a.gamma[b, i, j] if start else a.gamma_1[b, i, j]
                a.gamma_1[b, i, j] = a.gamma[b, i, j]
    a.count[2] = min(a.count[2] + 1, 2)
    for k in range(a.source.shape[0]):
        a.source_1[k] = a.source[k] / max(a.speed[k], 1e-3)
    a.clock[0] = a.clock[2]
    build_sheet(a.nodes, a.gamma, a.wake, a.wake_gamma, n_rows, a.age, p.edge_chord, wake_core, viscosity, squire,
                a.origin, a.far[0] == 0.0, sheet)  # fmt: skip
    return refresh_induced(sheet, n_chord, n_rows, a.wake, a.induced, a.shed, a.count[1], fresh_rows, refresh_stride,
                           rows, targets, velocity, scratch, a.origin, ground, has_ground, a.far,
                           p.cylinder_table)  # fmt: skip
