"""The compiled parts of an aerodynamic step: move the wake, solve the boundary condition, accept.

Arguments are ``p``, `PlanformArrays`; ``o``, `AeroConstants`; ``a``, `AeroArrays` (the state); ``w``, `AeroWork`; with
closed bodies in the flow also ``bodies``, `BodyArrays`, and ``body_work``, `BodyWork`. Nothing is allocated.
"""

from wt_gym.aerodynamics.bodies.body_kernels import add_body_velocity, body_strengths, couple_bodies
from wt_gym.aerodynamics.bodies.tower_kernels import flag_wake_segments
from wt_gym.aerodynamics.induction.induction_kernels import FAST
from wt_gym.aerodynamics.lattice.bound_kernels import (
    bound_influence,
    geometry,
    invert_boundary_condition,
    relative_wind,
)
from wt_gym.aerodynamics.lattice.load_kernels import bernoulli_loads, joukowski_loads, viscous_loads
from wt_gym.aerodynamics.lattice.section_kernels import decambering, section_state, settle_strips, strip_axes
from wt_gym.aerodynamics.lattice.separation_kernels import STATIC, advance_separation, reset_separation
from wt_gym.aerodynamics.wake.far_wake_kernels import measure_far_wake
from wt_gym.aerodynamics.wake.local_induction_kernels import add_local_velocity
from wt_gym.aerodynamics.wake.sheet_kernels import build_bound_sheet, build_sparse_sheet, build_wake_sheet
from wt_gym.aerodynamics.wake.wake_kernels import (
    age_rows,
    choose_rows,
    convect,
    gather_targets,
    induced_at,
    place_newest_row,
    scatter_velocities,
    shedding_edge,
    turn_induced,
    wake_sheets,
)
from wt_gym.base.compiled import kernel

TOLERANCE = 1e-5  # of the decambering, relative to the largest section speed
MAX_ITERATIONS = 40  # one or two in attached flow
CLEARANCE = 1.2  # tower radii within which the wake loses its segments (Gebhardt et al. 2012)


@kernel(fastmath=False)
def copy_nodes(source, target):
    """Copy (n_blade, n_row, n_node, 3); loops compile many times faster than array assignments."""
    for b in range(source.shape[0]):
        for i in range(source.shape[1]):
            for j in range(source.shape[2]):
                for c in range(3):
                    target[b, i, j, c] = source[b, i, j, c]


@kernel(fastmath=False, inline="always")
def gather_corners(nodes, wake, ground, corners):
    """Ring nodes, then the newest wake row, in one list a blade; and their mirror images in the ground."""
    n_blade, n_row, n_node, _ = nodes.shape
    n_bound = n_row * n_node
    for b in range(n_blade):
        for m in range(corners.shape[2]):
            for c in range(3):
                if m < n_bound:
                    x = nodes[b, m // n_node, m % n_node, c]
                else:
                    x = wake[1, b, m - n_bound, c]
                corners[0, b, m, c] = x
                corners[1, b, m, c] = x if c < 2 else 2.0 * ground - x


@kernel(fastmath=FAST)
def apply_inverse(inverse, through, gamma):
    """Circulations (n_ring,) of rings that hold up the normal velocities ``through`` (n_ring,)."""
    for r in range(gamma.shape[0]):
        total = 0.0
        for m in range(gamma.shape[0]):
            total += inverse[r, m] * through[m]
        gamma[r] = -total


@kernel(fastmath=False, inline="always")
def let_through(source, n_blade, n_chord, n_span, through):
    """Take the decambering velocity of its strip from the normal velocity of each ring."""
    for b in range(n_blade):
        for i in range(n_chord):
            for j in range(n_span):
                through[(b * n_chord + i) * n_span + j] -= source[b * n_span + j]


@kernel(fastmath=False, separate=True)
def convect_wake(o, a, dt):
    """Move all wake rows and the air at the shedding edge through one step and make room for the new row."""
    convect(a, dt, dt / a.last_dt[0] if a.n_levels[0] > 1 else 0.0)
    a.dt[0] = dt
    for b in range(a.wake.shape[1]):
        for j in range(a.wake.shape[2]):
            for c in range(3):
                a.free_edge[b, j, c] = a.wake[0, b, j, c]
    a.n_steps[0] += 1
    a.n_rows[0] = age_rows(a, o, dt)
    if a.n_rows[0] == a.wake.shape[0] - 1:
        a.far_wake_on[0] = 1
    a.prepared[0] = 0


@kernel(fastmath=False, separate=True)
def prepare(p, o, a, w, nodes, place, bodies=None, body_work=None):
    """What is computed once a step: newest row, velocity of the wake at the blades, influence of the bound rings."""
    prepare_wake(p, o, a, w, nodes, place, bodies, body_work)
    if a.n_rows[0] > 0:
        velocity_at_points(p, o, a, w, w.bound_sheet[:0], 1, w.points, a.wake_flow)
    prepare_boundary(p, o, a, w, nodes, bodies, body_work)


@kernel(fastmath=False, separate=True)
def prepare_wake(p, o, a, w, nodes, place, bodies=None, body_work=None):
    """Points of the blades, newest row, far wake, and the sheet of the wake without its newest ring."""
    n_row = nodes.shape[1]
    n_rows = a.n_rows[0]
    if o.dynamic_stall and place:
        advance_separation(p, o, a)
    geometry(nodes, n_row - 1 if o.edge_wake else n_row, w.points, w.normal, w.area)
    shedding_edge(nodes, p.shed_nodes, a.wake[0])
    for c in range(3):
        for i in range(w.points.shape[1]):
            a.wake_flow[c, i] = 0.0
    if n_rows == 0:
        return
    if place:
        place_newest_row(nodes, p.shed_nodes, a.free_edge, o.shed_fraction, a.wake)
    if o.far_wake and a.far_wake_on[0] == 1 and n_rows > 1:
        n_tail, dt = min(o.far_wake_rows, n_rows - 1), a.dt[0] if place else 0.0
        measure_far_wake(p, a, w, n_tail, dt)
    grow = a.dt[0] if place else -1.0
    build_wake_sheet(a, p, o, 1, n_rows, grow, False, w.wake_sheet)
    if n_rows > o.sparse_from:
        build_sparse_sheet(a, p, o, grow, w.sparse_sheet)
    if bodies is not None:
        cut_wake(p, o, bodies, body_work.flags, a.wake, n_rows, w)


@kernel(fastmath=False, nogil=True, separate=True)
def prepare_boundary(p, o, a, w, nodes, bodies=None, body_work=None):
    """Influence of the bound rings with their newest wake rings, and the inverse of the boundary condition."""
    n_blade, n_row, n_node, _ = nodes.shape
    gather_corners(nodes, a.wake, o.ground, w.corners)
    has_wake = 1 if a.n_rows[0] > 0 else 0
    bound_influence(w.corners[: 2 if o.has_ground else 1], p.segments[has_wake], p.segment_core[has_wake],
                    p.n_segments[has_wake], w.points, w.rings, a.influence)  # fmt: skip
    if bodies is not None:
        answer_of_bodies(p, o, a, w, bodies, body_work)
    invert_boundary_condition(a.influence, w.normal, n_blade, n_row - 1, n_node - 1, w.swap, w.panel, w.pivots,
                              a.inverse, a.response)  # fmt: skip
    a.prepared[0] = 1


@kernel(fastmath=False, separate=True)
def cut_wake(p, o, bodies, flags, wake, n_rows, w):
    """Take the segments that would cut through the tower out of the sheets of the wake, rows 2..n_rows."""
    if bodies.stations.shape[0] == 0:
        return
    flag_wake_segments(wake, n_rows, bodies.axis[0], bodies.axis[1], bodies.stations, bodies.radii, CLEARANCE, flags)
    n_dense = min(n_rows, o.sparse_from)
    for k in range(2, n_rows + 1):
        for b in range(wake.shape[1]):
            if k <= n_dense:
                for j in range(wake.shape[2]):
                    if flags[k, b, j] & 1:
                        w.wake_sheet[k, b, j, 3] = 0.0
                    if flags[k, b, j] & 2:
                        w.wake_sheet[k, b, j, 5] = 0.0
            if n_rows > n_dense and k >= n_dense:
                for i in range(p.sparse_nodes.shape[0]):
                    here = w.sparse_sheet[k - n_dense, b, i]
                    if flags[k, b, p.sparse_nodes[i]] & 1:
                        here[3] = 0.0
                    for j in range(p.sparse_nodes[max(i - 1, 0)] + 1, p.sparse_nodes[i] + 1):
                        if flags[k, b, j] & 2:
                            here[5] = 0.0


@kernel(fastmath=False, separate=True)
def answer_of_bodies(p, o, a, w, bodies, body_work):
    """Eliminate the bodies: influence of the rings and velocity of the wake with the sources that answer them."""
    n_rows = a.n_rows[0]
    for c in range(3):
        for i in range(bodies.center.shape[1]):
            body_work.wake_flow[c, i] = 0.0
    has_wake = 1 if n_rows > 0 else 0
    bound_influence(w.corners[: 2 if o.has_ground else 1], p.segments[has_wake], p.segment_core[has_wake],
                    p.n_segments[has_wake], bodies.center, body_work.rings, body_work.ring_influence)  # fmt: skip
    if n_rows > 0:
        velocity_at_points(p, o, a, w, w.bound_sheet[:0], 1, bodies.center, body_work.wake_flow)
    couple_bodies(bodies, body_work, w.points, o.ground, o.has_ground, a.influence, a.wake_flow)


@kernel(fastmath=False)
def velocity_at_points(p, o, a, w, bound_sheet, first, points, out):
    """Velocity of sheets, the wake from row ``first`` on, and far wake at points (3, n) float64, into out (3, n)."""
    n = points.shape[1]
    for c in range(3):
        for i in range(n):
            w.targets[0, c, i] = points[c, i] - a.origin[c]
    wake_sheet, sparse_sheet = wake_sheets(a, o, w, first)
    induced_at(bound_sheet, wake_sheet, sparse_sheet, a, n, w, o, p.cylinder_table)
    for c in range(3):
        for i in range(n):
            out[c, i] = w.velocity[0, c, i]


@kernel(fastmath=False, inline="always")
def circulation_rate(o, a, dt, gamma, rate):
    """Rate of the circulations: backward difference of second order; of first order after a start."""
    gamma_1, gamma_2 = a.gamma_1.reshape(gamma.shape), a.gamma_2.reshape(gamma.shape)
    now, before, earlier = 0.0, 0.0, 0.0
    if o.unsteady and a.n_levels[0] == 1 and dt > 0.0:
        now, before = 1.0 / dt, -1.0 / dt
    elif o.unsteady and a.n_levels[0] > 1:
        h = a.last_dt[0] / dt
        now, before, earlier = (2.0 + h) / (1.0 + h) / dt, -(1.0 + h) / (h * dt), 1.0 / (h * (1.0 + h) * dt)
    for r in range(gamma.shape[0]):
        rate[r] = now * gamma[r] + before * gamma_1[r] + earlier * gamma_2[r]


@kernel(fastmath=False)
def settle(p, o, a, w, dt):
    """Bring strips whose circulation and polar disagree after `solve` near a solution, from which that finds it."""
    settle_strips(
        w.strip[2], w.strip[1], a.response, a.source_1, dt, o.stall_lag, p, a.separation[0], a.speed, a.source
    )


@kernel(fastmath=False, separate=True)
def solve(p, o, a, w, nodes, velocities, wind, dt, first):
    """Circulation and nodal forces at the given nodes, with the wake frozen."""
    n_blade, n_row, n_node, _ = nodes.shape
    n_chord, n_span = n_row - 1, n_node - 1
    n_strip = n_blade * n_span
    n_ring = n_strip * n_chord
    line_rows = n_chord if o.edge_wake else n_row
    flow, normal, through = w.flow, w.normal, w.through
    width, along, potential = w.strip[0], w.strip[1], w.strip[2]
    copy_nodes(nodes, a.nodes)
    geometry(nodes, line_rows, w.points, normal, w.area)
    relative_wind(nodes, velocities, wind, line_rows, flow)
    for c in range(3):
        for i in range(flow.shape[1]):
            flow[c, i] += a.wake_flow[c, i]
    strip_axes(nodes, w.axes, w.normals, width)
    for r in range(n_ring):
        through[r] = flow[0, r] * normal[r, 0] + flow[1, r] * normal[r, 1] + flow[2, r] * normal[r, 2]
    gamma = a.gamma.reshape(n_ring)
    apply_inverse(a.inverse, through, gamma)
    for k in range(n_strip):
        b, j = k // n_span, k % n_span
        potential[k] = a.gamma[b, n_chord - 1, j]
        along[k] = 0.0
        for i in range(n_chord):
            r = (b * n_chord + i) * n_span + j
            for c in range(3):
                along[k] += flow[c, r] * w.axes[k, c] / n_chord
    if first:
        for k in range(n_strip):
            a.separation[0, k] = STATIC
    if o.viscous:
        rhs, derivative, step = w.strip[3], w.strip[4], w.strip[5]
        a.residual[0] = decambering(potential, along, a.response, a.source_1, first, dt, o.stall_lag, p, n_blade,
                                    TOLERANCE, MAX_ITERATIONS, a.separation[0], w.jacobian, rhs, derivative, step,
                                    a.source)  # fmt: skip
        let_through(a.source, n_blade, n_chord, n_span, through)
        apply_inverse(a.inverse, through, gamma)
    for k in range(n_strip):
        b, j, row = k // n_span, k % n_span, k % p.polars.shape[0]
        across = a.gamma[b, n_chord - 1, j] / p.kappa[j] + a.source[k]
        a.alpha[k], a.speed[k], _, _, _ = section_state(across, along[k], p.tilt[j], p.polars[row], p.alpha0[j],
                                                     p.chord[j], p.kappa[j], p.separation[row], STATIC)  # fmt: skip
    if first:
        reset_separation(p, o, a)
    add_ring_velocity(gamma, a.influence, 0 if o.bernoulli else n_ring, flow)
    rate = through  # its memory is free now
    circulation_rate(o, a, dt, gamma, rate)
    for b in range(n_blade):
        for i in range(n_row):
            for j in range(n_node):
                for c in range(3):
                    a.forces[b, i, j, c] = 0.0
    if o.bernoulli:
        bernoulli_loads(nodes, a.gamma, rate, flow, normal, w.area, o.density, o.edge_wake, o.tip_wake, a.forces)
    else:
        joukowski_loads(nodes, a.gamma, rate, flow, normal, w.area, o.density, o.edge_wake, o.tip_wake, a.forces)
    if o.viscous:
        viscous_loads(nodes, w.axes, w.normals, width, a.alpha, a.speed, p, a.separation[0], o.density, a.forces)


@kernel(fastmath=FAST)
def add_ring_velocity(gamma, influence, begin, flow):
    """Add the velocity of the bound rings at the points from ``begin`` on."""
    for r in range(gamma.shape[0]):
        g = gamma[r]
        for c in range(3):
            for i in range(begin, flow.shape[1]):
                flow[c, i] += g * influence[r, c, i]


@kernel(fastmath=False, separate=True)
def accept(p, o, a, w, place, all_rows, bodies=None, body_work=None):
    """Shed the newest ring and compute the induced velocities with which the wake moves on."""
    n_target = shed_newest(p, o, a, w, place, all_rows, bodies, body_work)
    wake_sheet, sparse_sheet = wake_sheets(a, o, w, 0)
    induced_at(w.bound_sheet, wake_sheet, sparse_sheet, a, n_target, w, o, p.cylinder_table)
    store_induced(p, o, a, w, n_target, bodies, body_work)


@kernel(fastmath=False, separate=True)
def shed_newest(p, o, a, w, place, all_rows, bodies=None, body_work=None):
    """Shed the newest ring, finish the sheets and gather the targets whose turn it is; returns their number."""
    n_span = a.gamma.shape[2]
    n_chord = a.gamma.shape[1]
    n_rows = a.n_rows[0]
    shedding_edge(a.nodes, p.shed_nodes, a.wake[0])
    if n_rows > 0 and place:
        place_newest_row(a.nodes, p.shed_nodes, a.free_edge, o.shed_fraction, a.wake)
    start = a.n_levels[0] == 0
    for b in range(a.gamma.shape[0]):
        for e in range(p.shed_rings.shape[0]):
            a.wake_gamma[0, b, e] = a.gamma[b, p.shed_rings[e] // n_span, p.shed_rings[e] % n_span]
        for i in range(n_chord):
            for j in range(n_span):
                a.gamma_2[b, i, j] = a.gamma[b, i, j] if start else a.gamma_1[b, i, j]
                a.gamma_1[b, i, j] = a.gamma[b, i, j]
    a.n_levels[0] = min(a.n_levels[0] + 1, 2)
    for k in range(a.source.shape[0]):
        a.source_1[k] = a.source[k] / max(a.speed[k], 1e-3)
    a.last_dt[0] = a.dt[0]
    build_bound_sheet(a, p, o, w.bound_sheet)
    # The other rows were written when the step was prepared.
    build_wake_sheet(a, p, o, 0, min(2, n_rows), -1.0, True, w.wake_sheet)
    if bodies is not None:
        cut_wake(p, o, bodies, body_work.flags, a.wake, min(2, n_rows), w)
    turn_induced(a, o)
    w.n_turn[0] = choose_rows(a, o, w.rows, all_rows)
    return gather_targets(p, o, a, w)


@kernel(fastmath=False, separate=True)
def store_induced(p, o, a, w, n_target, bodies=None, body_work=None):
    """Velocities of the targets, with those of the bodies, back to the rows."""
    if bodies is not None:
        body_strengths(body_work, a.gamma.reshape(a.influence.shape[0]), a.body_strength)
        add_body_velocity(bodies, a.body_strength, w.targets[0], w.velocity[0], n_target, a.origin, o.ground,
                          o.has_ground)  # fmt: skip
    if o.arcs:
        add_local_velocity(p, o, a, w)
    scatter_velocities(p, o, a, w)


@kernel(fastmath=False)
def write_sheets(p, o, a, w, bodies=None, body_work=None):
    """Write the sheets of an accepted state, for velocities anywhere."""
    build_bound_sheet(a, p, o, w.bound_sheet)
    build_wake_sheet(a, p, o, 0, a.n_rows[0], 0.0, True, w.wake_sheet)
    if a.n_rows[0] > o.sparse_from:
        build_sparse_sheet(a, p, o, 0.0, w.sparse_sheet)
    if bodies is not None:
        cut_wake(p, o, bodies, body_work.flags, a.wake, a.n_rows[0], w)
