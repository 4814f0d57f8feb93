"""Options of the lattice: wake of the tips, form of the loads, strained cores, curved filaments, coupling, refusals."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from envs_tests.physics.cases.airfoils import (
    INVISCID,
    UniformStream,
    WingFlow,
    exact_lift,
    far_field_drag,
    flat_planform,
    half_span_edges,
    oscillating_lift,
    panels_of,
    steady_coefficients,
    steady_wing,
)
from envs_tests.physics.cases.wings import starting_impulse
from envs_tests.physics.refusals import refuses
from wt_gym.aerodynamics import ENGINEERING, TRAINING, AerodynamicsError, AeroOptions, VortexLattice, build_planform
from wt_gym.aerodynamics.induction.induction_kernels import direct_induction
from wt_gym.aerodynamics.induction.simd_kernels import WIDTH
from wt_gym.aerodynamics.wake.sheet_kernels import LAMB, build_wake_sheet
from wt_gym.simulation import FIDELITIES, Simulator
from wt_gym.simulation.models import blade_planform
from wt_gym.turbines import load_turbine
from wt_gym.wind import SteadyInflow

# ---- wake of the tips ------------------------------------------------------------------------------------------------


def normal_force(aspect, degrees, n_chord=6, n_half=6, **options):
    """Normal and tangential force coefficients (2,) of a flat rectangular wing of chord 1 behind a free wake."""
    planform = flat_planform(half_span_edges(0.5 * aspect, n_half), 1.0, n_chord)
    stream = UniformStream.at_incidence(np.radians(degrees))
    n_steps = 6 * n_chord
    flow = WingFlow(planform, stream, n_steps, 1.0 / n_chord, drifting=False, **({"wake_core": 0.02} | options))
    flow.start_from_rest()
    forces = [flow.step().sum(axis=(0, 1))[:2] / (0.25 * aspect) for _ in range(n_steps)]
    return np.mean(forces[-n_chord:], axis=0)


def suction_factors(aspect, n=8, alpha=1e-3):
    """Polhamus' factors of a rectangular wing in linear theory: potential flow, leading edge, both side edges.

    The normal force is Kp sin(a) cos(a) + (Kv,le + Kv,se) sin(a)^2: the suction of an edge, turned by a right angle
    where the flow separates there (Polhamus, NASA TN D-3767, 1966; side edges: Lamb, NASA TR R-428, 1974).
    """
    inner = half_span_edges(0.5 * aspect, n)
    edges = np.r_[-inner[:0:-1], inner]
    _, state, stream = steady_wing(flat_planform(edges, 1.0, n), alpha, ground_height=None)
    potential = steady_coefficients(state, stream, aspect)[0] / alpha
    drag = far_field_drag(state.circulation[0, n:], inner) / (0.25 * aspect * alpha**2)
    outwards = 0.5 * (state.nodal_forces[0, :, n + 1 :, 2].sum() - state.nodal_forces[0, :, :n, 2].sum())
    return potential, potential - drag, 2.0 * outwards / (0.5 * aspect * alpha**2)


def test_suction_of_slender_and_square_wings():
    """For A -> 0, pi A / 2 and pi (suction of a plate across the stream); 1.460227 for the square (Tuck 1993)."""
    slender, square = suction_factors(0.05), suction_factors(1.0)
    assert slender[0] == pytest.approx(0.5 * np.pi * 0.05, rel=0.005)
    assert slender[2] == pytest.approx(np.pi, rel=0.01)
    assert square[0] == pytest.approx(1.460227, rel=0.002)


@pytest.mark.parametrize("degrees", [5.0, 10.0, 15.0, 20.0])
def test_vortex_lift_of_a_square_wing(degrees):
    """Sheets from the tips lift a square wing as much as the suction of its edges, turned by a right angle.

    The sheet from the tips alone (inviscid, without the flow that separates again beneath it) exceeds the suction of
    the side edges by half of it, and grows with finer lattices: 12 x 12 panels a half have 13 % more normal force than
    leading and side edges together at 20 degrees, 6 x 6 panels 5 %.
    """
    potential, leading, side = suction_factors(1.0)
    sine, cosine = np.sin(np.radians(degrees)), np.cos(np.radians(degrees))
    attached, separated = normal_force(1.0, degrees)[0], normal_force(1.0, degrees, tip_wake=True)[0]
    assert attached == pytest.approx(potential * sine * cosine, rel=0.05)
    assert separated == pytest.approx(potential * sine * cosine + (leading + side) * sine**2, rel=0.08)
    assert separated > potential * sine * cosine + side * sine**2


def test_wing_with_a_wake_of_its_tips_only():
    """Without a Kutta condition at the trailing edge the wing carries hardly any lift."""
    force = normal_force(1.0, 10.0, 4, 4, trailing_edge_wake=False, tip_wake=True)
    assert np.all(np.isfinite(force))
    assert abs(force[0]) < 0.02


# ---- form of the loads -----------------------------------------------------------------------------------------------


def steady_force(load_form, n_chord=8, alpha=0.1):
    """Normal and tangential force coefficients of a rectangular wing of aspect ratio 8, and its induced drag."""
    planform = flat_planform(half_span_edges(4.0, 12), 1.0, n_chord)
    _, state, _ = steady_wing(planform, alpha, load_form=load_form)
    force = state.nodal_forces.sum(axis=(0, 1, 2))[:2] / (0.5 * 4.0)
    return force, far_field_drag(state.circulation[0], planform.span_edges) / (0.5 * 4.0)


def test_bernoulli_lacks_the_suction_of_the_leading_edge():
    alpha = 0.1
    (normal, suction), far_drag = steady_force("joukowski", alpha=alpha)
    (pressed, tangential), _ = steady_force("bernoulli", alpha=alpha)
    assert pressed == pytest.approx(normal, rel=0.002)
    assert abs(tangential) < 1e-12 * pressed  # so that the drag is the lift times tan(alpha)
    assert normal * np.sin(alpha) + suction * np.cos(alpha) == pytest.approx(far_drag, rel=0.01)
    assert suction < -0.5 * normal * np.sin(alpha)


def test_plunging_section_by_bernoulli():
    ratio = oscillating_lift("plunge", 0.5, 8, load_form="bernoulli") / exact_lift("plunge", 0.5)
    assert abs(ratio) == pytest.approx(1.0, abs=0.02)
    assert np.degrees(np.angle(ratio)) == pytest.approx(0.0, abs=2.0)


def test_sudden_motion_meets_the_same_apparent_mass():
    """The apparent mass does not depend on the form of the loads."""
    forms = [starting_impulse(8, load_form=form) for form in ("joukowski", "bernoulli")]
    assert forms[1] == pytest.approx(forms[0], rel=1e-3)
    assert forms == pytest.approx([1.0, 1.0], rel=0.015)


# ---- cores -----------------------------------------------------------------------------------------------------------


class Accelerating:
    """A stream along y that gains speed, and with it length, on its way."""

    def velocity(self, points, time):
        flow = np.zeros(np.shape(points))
        flow[..., 1] = 1.0 + 0.4 * np.maximum(np.asarray(points)[..., 1], 0.0)
        return flow


def drawn_out_wake(**options):
    """Core (rc l)^2, length and volume of the trailing segments at the tip of a wake that only drifts, by its rows."""
    planform = flat_planform(half_span_edges(2.0, 3), 1.0, 2)
    drifting = {"fresh_rows": 0, "refresh_stride": 10**9, "wake_rows": 20, "full_rows": 20, "wake_core": 0.1}
    lattice = VortexLattice(planform, 1, AeroOptions(**(INVISCID | panels_of(planform) | drifting | options)), 1.0)
    state, nodes = lattice.new_state(), planform.nodes[None].copy()
    wind = 0.0 * nodes + [0.05, 1.0, 0.0]
    lattice.reset(state, nodes, 0.0 * nodes, wind)
    history = []
    for k in range(12):
        lattice.convect_wake(state, Accelerating(), 0.25 * k, 0.25)
        lattice.solve(state, nodes, 0.0 * nodes, wind, 0.25)
        lattice.accept(state)
        length = np.linalg.norm(np.diff(state.wake_nodes[:, 0, -1], axis=0), axis=-1)
        core = lattice.work.wake_sheet[1 : state.n_rows + 1, 0, -1, 4].astype(float)
        history.append((core, length, state.arrays.volume[1 : state.n_rows + 1, 0, -1, 0].copy()))
    return history, state


def test_stretched_segments_keep_the_volume_of_their_cores():
    history, _ = drawn_out_wake(core_strain=True, curved_filaments=False)
    (_, before, volume), (core, after, kept) = history[-2:]
    old = slice(3, 11)  # rows that were laid down long ago; they move back by one
    assert np.all(after[4:12] > 1.05 * before[old])
    assert np.array_equal(kept[4:12], volume[old])
    np.testing.assert_allclose(core[4:12], kept[4:12] * after[4:12], rtol=1e-6)  # rc^2 l^2 = volume l


def test_strained_cores_spread_with_their_circulation():
    """Without spreading the volume stays; with it, it grows by the length at the time."""
    history, state = drawn_out_wake(core_strain=True, curved_filaments=False, squire=0.01)
    (_, _, volume), (_, after, grown) = history[-2:]
    gamma = np.abs(state.wake_circulation[3:11, 0, -1])
    np.testing.assert_allclose(grown[4:11] - volume[3:10], LAMB * 0.01 * gamma[1:] * after[4:11] * 0.25, rtol=0.02)


@pytest.mark.parametrize("squire", [0.0, 0.01])
def test_cores_by_age_alone_do_not_feel_the_strain(squire):
    """rc² = rc0² + 4 · 1.25643 · a Γ t."""
    history, state = drawn_out_wake(core_strain=False, curved_filaments=False, squire=squire)
    core, length, _ = history[-1]
    spread = LAMB * squire * np.abs(state.wake_circulation[: len(core), 0, -1]) * state.arrays.age[1 : len(core) + 1]
    np.testing.assert_allclose(core[3:], (0.1**2 + spread[3:]) * length[3:] ** 2, rtol=1e-5)


# ---- curved filaments ------------------------------------------------------------------------------------------------


def polygon_velocity(n, pitch, curved):
    """Velocity at the center of one turn of a filament of unit circulation and radius, in n straight segments.

    One strip whose outer node row is the filament, with three turns around; the inner one is far away.
    """
    planform = flat_planform(np.array([0.0, 1.0]), 1.0, 1)
    chosen = {"wake_rows": 3 * n + 1, "curved_filaments": curved, "core_strain": False}
    lattice = VortexLattice(planform, 1, AeroOptions(**(INVISCID | panels_of(planform) | chosen)))
    a, w = lattice.new_state().arrays, lattice.work
    n_rows = 3 * n + 1
    angle = 2.0 * np.pi * (np.arange(1, n_rows + 1) / n - 1.5) - np.pi / n
    a.n_rows[0] = n_rows
    a.age[1:] = np.arange(1, n_rows + 1)
    a.wake_gamma[:] = 1.0
    a.wake[:, 0, 0] = [0.0, 0.0, 1e6]
    a.wake[1:, 0, 1] = np.column_stack([np.cos(angle), np.sin(angle), pitch * angle / (2.0 * np.pi)])
    build_wake_sheet(a, lattice.arrays, lattice.constants, 1, n_rows, -1.0, True, w.wake_sheet)
    sheet = np.ascontiguousarray(w.wake_sheet[n + 1 : 2 * n + 2])
    targets, velocity = np.zeros((3, WIDTH), np.float32), np.zeros((3, WIDTH), np.float32)
    direct_induction(sheet, targets, velocity, 0, WIDTH, w.scratch)
    return velocity[:, 0].astype(float), angle[n], angle[2 * n]


def exact_velocity(pitch, start, end):
    """Biot-Savart integral along the filament between two angles, at the center."""
    t, weight = np.polynomial.legendre.leggauss(60)
    t, weight = 0.5 * (start + end) + 0.5 * (end - start) * t, 0.5 * (end - start) * weight
    x = np.column_stack([np.cos(t), np.sin(t), pitch * t / (2.0 * np.pi)])
    along = np.column_stack([-np.sin(t), np.cos(t), 0.0 * t + pitch / (2.0 * np.pi)])
    return weight @ (np.cross(along, -x) / np.linalg.norm(x, axis=1)[:, None] ** 3) / (4.0 * np.pi)


@pytest.mark.parametrize("pitch", [0.0, 0.5])
def test_curved_filaments_converge_faster(pitch):
    """Error at the center of a ring and of a turn of a helix: second order with straight chords, fourth displaced."""
    error = {}
    for curved in (False, True):
        for n in (8, 16, 32):
            velocity, start, end = polygon_velocity(n, pitch, curved)
            exact = exact_velocity(pitch, start, end)
            error[curved, n] = abs(abs(velocity[2]) / abs(exact[2]) - 1.0)
    assert error[False, 16] / error[False, 32] == pytest.approx(4.0, rel=0.1)
    assert error[True, 8] / error[True, 16] > 8.0
    assert error[True, 16] < 0.1 * error[False, 16]


# ---- loads and structure iterated to agreement -----------------------------------------------------------------------


def light_turbine(share):
    """The 5-MW turbine with this share of the mass of its blades."""
    turbine = load_turbine("nrel_5mw")
    structure = turbine.blade.structure
    return replace(
        turbine, blade=replace(turbine.blade, structure=replace(structure, inertia=share * structure.inertia))
    )


@pytest.mark.parametrize(("share", "factor", "left"), [(1.0, 0.2, 1e-3), (0.3, 0.3, 5e-3), (0.1, 0.5, 0.05)])
def test_passes_of_loads_and_structure_converge_on_light_blades(share, factor, left):
    """The change of the loads falls from pass to pass, also where the air moved with a blade outweighs the blade.

    Unrelaxed it would be multiplied by about 0.2 / share.
    """
    fidelity = replace(FIDELITIES["training"], coupling_tolerance=0.0, coupling_iterations=8)
    sim = Simulator(light_turbine(share), inflow=SteadyInflow(9.0), fidelity=fidelity)
    sim.reset(rotor_speed=1.0, pitch=0.0)
    for k in range(5):
        sim.advance(0.4, pitch=(0.02 * k, 0.0, 0.0), generator_torque=2e4)
    start = sim.state()

    def loads(passes, n_steps):
        sim.restore(start)
        sim.coupling.scheme = sim.coupling.scheme._replace(iterations=passes, loosest=np.inf)
        sim.advance(n_steps * sim.time_step, pitch=0.02, generator_torque=2e4)
        return sim.coupling.aero.nodal_forces.copy()

    converged = loads(16, 1)
    scale = np.abs(converged).max()
    error = [np.abs(loads(n, 1) - converged).max() / scale for n in range(1, 7)]
    assert (error[5] / error[0]) ** 0.2 < factor
    # what three passes leave shows little in the loads a second later
    assert np.abs(loads(3, 10) - loads(12, 10)).max() < left * scale


# ---- refusals --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("options", [TRAINING, replace(TRAINING, tip_wake=True), ENGINEERING])
def test_polars_and_circulation_agree_at_every_angle_and_rate(options):
    """One blade swept through all angles of attack, with long steps in which the lag hardly helps."""
    options = replace(options, far_wake=False, wake_rows=20, full_rows=20, sparse_from=None, sparse_stride=1,
                      sparse_span=1)  # fmt: skip
    planform = blade_planform(load_turbine("nrel_5mw"), options)
    lattice, still = VortexLattice(planform, 1, options), np.zeros((1, *planform.nodes.shape))
    state, nodes, rng = lattice.new_state(), planform.nodes[None].copy(), np.random.default_rng(5)
    for _ in range(40):
        speed, angle = rng.uniform(5, 60), rng.uniform(-np.pi, np.pi)
        rate, dt = 0.15 * rng.normal(), rng.choice([0.1, 0.2])
        winds = [speed * np.array([np.sin(x), np.cos(x), 0.0]) for x in angle + rate * np.arange(26)]
        lattice.reset(state, nodes, still, still + winds[0])
        for wind in winds[1:]:
            inflow = SimpleNamespace(velocity=lambda points, time, wind=wind: np.broadcast_to(wind, points.shape))
            lattice.convect_wake(state, inflow, 0.0, dt)
            lattice.solve(state, nodes, still, still + wind, dt)
            assert state.residual < 1.001e-5 * (state.arrays.speed.max() + 1e-3)
            lattice.accept(state)


def test_refused_options():
    with pytest.raises(AerodynamicsError, match="no wake has no memory"):
        AeroOptions(trailing_edge_wake=False, tip_wake=False)
    with pytest.raises(AerodynamicsError, match="sparse_from must be None or more than full_rows, 135, got 135"):
        AeroOptions(sparse_from=135)
    with pytest.raises(AerodynamicsError, match="sparse_stride must be a multiple of coarse_stride, 4, got 6"):
        AeroOptions(full_rows=8, coarse_stride=4, sparse_from=20, sparse_stride=6)


def test_strides_follow_the_step():
    """Rows lie no further apart than at the recommended step, and no nearer than a step allows."""
    thinned = AeroOptions(full_rows=8, coarse_stride=3, sparse_from=12, sparse_stride=6, azimuth_step_deg=8.0)
    for step, coarse, sparse in ((8.0, 3, 6), (7.26, 3, 6), (4.54, 5, 10), (3.9, 6, 12), (2.0, 12, 24), (16.0, 1, 3)):
        options = thinned.for_step(step)
        assert (options.coarse_stride, options.sparse_stride) == (coarse, sparse)
        assert options.sparse_stride * step <= thinned.sparse_stride * thinned.azimuth_step_deg + 1e-9
    assert thinned.for_step(8.0) == thinned
    assert AeroOptions(azimuth_step_deg=8.0).for_step(2.0) == AeroOptions(azimuth_step_deg=8.0)  # nothing is thinned
    alone = AeroOptions(coarse_stride=2, azimuth_step_deg=7.5).for_step(4.5)
    assert (alone.coarse_stride, alone.sparse_stride, alone.sparse_from) == (3, 1, None)


def test_rows_take_even_turns_at_the_wind_after_their_strides_changed():
    """Five steps between rows and ten between turns would let every other fifth of the steps ask for all rows."""
    thinned = AeroOptions(
        wake_rows=60,
        full_rows=8,
        coarse_stride=3,
        sparse_from=12,
        sparse_stride=3,
        azimuth_step_deg=8.0,
        wind_stride=10,
    )
    assert thinned.for_step(7.26).wind_stride == 10
    options = thinned.for_step(4.54)
    asking = np.bincount(options.row_numbers() % options.wind_stride, minlength=options.wind_stride)
    assert (options.coarse_stride, options.wind_stride) == (5, 11)
    assert np.ptp(asking) <= 2


GOOD = flat_planform(np.linspace(0.0, 4.0, 5), 1.0, 2)
"""A flat wing of four strips."""


def planform_with(nodes):
    """The flat wing with other ring nodes."""
    return replace(GOOD, nodes=nodes(GOOD.nodes.copy()))


def test_refused_lattices():
    def turned_over(nodes):
        angle = np.radians([0.0, 0.0, 0.0, 100.0, 200.0])
        return np.stack([nodes[..., 1] * np.sin(angle), nodes[..., 1] * np.cos(angle), nodes[..., 2]], axis=-1)

    refuses(
        AerodynamicsError,
        (r"have none: \[\[0, 1\], \[1, 1\]\]", lambda: planform_with(lambda nodes: nodes[:, [0, 1, 1, 3, 4]])),
        ("must turn by at most 90 degrees", lambda: planform_with(turned_over)),
        ("must be finite", lambda: planform_with(lambda nodes: nodes * np.nan)),
        ("increase", lambda: flat_planform(np.linspace(4.0, 0.0, 5), 1.0, 2)),
        *((message, lambda place=place: planform_with(place)) for message, place in (
            (r"larger z, from root to tip; .*\[\[0, 0\], .*\[1, 3\]\]", lambda n: n[:, ::-1]),
            ("larger y, from the leading to the trailing edge", lambda n: n[::-1]),
            ("larger y", lambda n: n * [1, -1, 1]),
            ("larger z", lambda n: n * [1, 1, -1]),
            (r"folded back .*\[\[0, 0\], \[0, 1\], \[0, 2\], \[0, 3\]\]", lambda n: n[[0, 2, 1]]),
            ("larger x, the suction",
             lambda n: n + np.cumsum(n[..., 1:2], axis=0) * [0, 0, 30] + n[..., 2:] * [3, 3, 0]),
        )),
    )  # fmt: skip


def built(**changes):
    """The flat wing with other arguments of `build_planform`."""
    edges, one = GOOD.span_edges, np.ones(5)
    given = {"span_edges": edges, "axis": np.outer(edges, [0.0, 0.0, 1.0]), "chord": one, "twist": 0.0 * one,
             "le_offset": 0.25 * one, "polars": GOOD.polars, "n_chord": 2}  # fmt: skip
    return build_planform(**(given | changes))


@pytest.mark.parametrize("degrees", [0.0, 89.0, -89.0])
def test_blades_along_their_frame_are_taken(degrees):
    """Twist, sweep, prebend, dihedral and a tip without chord."""
    edges = GOOD.span_edges
    axis = np.column_stack([0.5 * edges, -0.5 * edges, edges])
    planform = built(axis=axis, twist=np.full(5, np.radians(degrees)), chord=np.array([1.0, 1.0, 1.0, 0.5, 0.0]))
    assert planform.nodes.shape == (3, 5, 3)


def test_refused_planforms():
    level = {"alpha0_lattice": np.full(4, np.nan), "lift_slope": np.zeros(4), "slope_angle": np.zeros((4, 1)),
             "edge_chord": np.ones(4), "span_edges": np.arange(4.0), "polars": None}  # fmt: skip
    refuses(
        AerodynamicsError,
        *(("a twist between -90 and 90 degrees", lambda degrees=degrees: built(twist=np.full(5, np.radians(degrees))))
          for degrees in (91.0, 180.0, -100.0)),
        ("larger z, from root to tip", lambda: built(axis=np.outer(GOOD.span_edges[::-1], [0.0, 0.0, 1.0]))),
        (r"n_chord=1\.5,", lambda: built(n_chord=1.5)),
        ("chord must be an array of numbers", lambda: built(chord="wide")),
        ("edge chords must be at least 0", lambda: replace(GOOD, edge_chord=-np.ones(5))),
        *((message, lambda field=field: replace(GOOD, **{field: level[field]})) for field, message in (
            ("alpha0_lattice", "alpha0_lattice is not finite"), ("lift_slope", "lift_slope must be positive"),
            ("slope_angle", r"slope_angle has shape \(4, 1\)"), ("polars", "polars"),
            ("edge_chord", r"edge_chord has shape \(4,\); must be \(5,\)"),
            ("span_edges", r"span_edges has shape \(4,\); must be \(5,\)"),
        )),
    )  # fmt: skip


def small_lattice(**options):
    """Lattice of the flat wing with few wake rows, a state, nodes, no velocities, a wind."""
    lattice = VortexLattice(GOOD, 1, AeroOptions(**(INVISCID | panels_of(GOOD) | {"wake_rows": 4} | options)), 1.0)
    nodes = GOOD.nodes[None].copy()
    return lattice, lattice.new_state(), nodes, 0.0 * nodes, 0.0 * nodes + [0.1, 1.0, 0.0]


def test_refused_numbers_of_panels():
    refuses(
        AerodynamicsError,
        (r"planform has 2 x 4 panels .* n_chord x n_span = 3 x 4", lambda: small_lattice(n_chord=3)),
        (r"planform has 2 x 4 panels .* n_chord x n_span = 2 x 7", lambda: small_lattice(n_span=7)),
        *((f"n_blades is {n}", lambda n=n: VortexLattice(GOOD, n, AeroOptions(**panels_of(GOOD))))
          for n in (0, 1.5, np.nan)),
    )  # fmt: skip


def test_refused_panels_without_area_in_motion():
    lattice, state, nodes, still, wind = small_lattice()
    thin = nodes[:, :, [0, 2, 2, 3, 4]]
    lattice.reset(state, nodes, still, wind)
    lattice.convect_wake(state, UniformStream([0.1, 1.0, 0.0]), 0.0, 0.1)
    row, helix = [nodes[:, -1] + [0.0, 1.0, 0.0]], ([0.0] * 3, [0.0, 1.0, 0.0], 1.0, 0.1)
    refuses(
        AerodynamicsError,
        *((r"\(blade, chord, span\) have none: \[\[0, 0, 1\], \[0, 1, 1\]\]", call) for call in (
            lambda: lattice.solve(state, thin, still, wind, 0.1),
            lambda: lattice.reset(state, thin, still, wind),
            lambda: lattice.initialize_wake(state, thin, still, wind, row, [1.0]),
            lambda: lattice.initialize_helix(state, thin, still, wind, *helix),
        )),
        (r"\[0, 1, 3\]\]", lambda: lattice.reset(state, 0.0 * nodes, still, wind)),
    )  # fmt: skip


def test_refused_wakes():
    lattice, state, nodes, still, wind = small_lattice()
    rows = np.array([nodes[:, -1] + [0.0, 0.5 * k, 0.0] for k in (1, 2, 3)])
    ages = np.array([0.5, 1.0, 1.5])
    lattice.initialize_wake(state, nodes, still, wind, rows, ages)
    before = state.copy()
    broken = rows.copy()
    broken[1, 0, 2, 0] = np.nan
    cases = [
        (broken, ages, r"wake_rows are not finite in rows \[1\]"),
        (rows[..., :-1, :], ages, r"wake_rows have shape \(3, 1, 4, 3\); must be \(3, 1, 5, 3\)"),
        (rows[:, 0], ages, "wake_rows have shape"),
        (rows, ages[:-1], r"ages have shape \(2,\); must be \(3,\)"),
        (rows, ages[:, None], "ages have shape"),
        (rows, ages * np.nan, r"ages are not finite in rows \[0, 1, 2\]"),
        (rows[:0], ages[:0], "0 wake rows given; between 1 and 4"),
        (np.tile(rows, (2, 1, 1, 1)), np.arange(1.0, 7.0), "6 wake rows given; between 1 and 4"),
        *((rows, wrong, "ages are .* positive and increase from row to row") for wrong in (
            0.0 * ages, -ages, ages[::-1], ages - 0.5, [0.5, 0.5, 1.0],
        )),
    ]  # fmt: skip
    refuses(AerodynamicsError, *(
        (message, lambda given=given, times=times: lattice.initialize_wake(state, nodes, still, wind, given, times))
        for given, times, message in cases
    ))  # fmt: skip
    assert state == before


def test_refused_helices():
    lattice, state, nodes, still, wind = small_lattice()
    good = {"center": [0.0, 0.0, -1.0], "axis": [0.0, 1.0, 0.0], "rotor_speed": 1.0, "dt": 0.1}
    wrong = {
        "axis": ([0.0, 0.0, 0.0], [0.0, np.nan, 0.0], [1.0, 0.0], None), "center": ([np.inf, 0.0, 0.0], 0.0),
        "dt": (0.0, -0.1, np.nan, np.inf), "rotor_speed": (np.nan, np.inf), "passes": (0, 1.5),
    }  # fmt: skip
    start = lambda air, change: lattice.initialize_helix(state, nodes, still, air, **(good | change))  # noqa: E731
    refuses(
        AerodynamicsError,
        *((name, lambda change={name: value}: start(wind, change)) for name in wrong for value in wrong[name]),
        ("wind have shape", lambda: start(wind[0], {})),
    )


def test_refused_flows():
    lattice, state, nodes, still, wind = small_lattice()
    broken = nodes.copy()
    broken[0, 1, 2, 0] = np.nan
    lattice.reset(state, nodes, still, wind)
    refuses(
        AerodynamicsError,
        ("nodes are not finite", lambda: lattice.reset(state, broken, still, wind)),
        ("velocities are not finite", lambda: lattice.reset(state, nodes, broken, wind)),
        ("wind are not finite", lambda: lattice.reset(state, nodes, still, broken)),
        ("inflow is not finite", lambda: lattice.convect_wake(state, UniformStream([np.nan, 1.0, 0.0]), 0.0, 0.1)),
        ("dt is 0", lambda: lattice.convect_wake(state, UniformStream([0.0, 1.0, 0.0]), 0.0, 0.0)),
        ("must be", lambda: lattice.solve(state, nodes[:, :-1], still, wind, 0.1)),
        *((f"dt is {dt}; it must be positive and finite", lambda dt=dt: lattice.solve(state, nodes, still, wind, dt))
          for dt in (0.0, -0.1, np.nan, np.inf)),
    )  # fmt: skip
    one = SimpleNamespace(velocity=lambda points, time: np.array([0.0, 1.0, 0.0]))
    shape = r"shape \(3,\) at wake nodes of shape \(1, 1, 5, 3\)"
    refuses(AerodynamicsError, (shape, lambda: lattice.convect_wake(state, one, 0.0, 0.1)))
    lattice.convect_wake(state, UniformStream([1e30, 0.0, 0.0]), 0.0, 0.1)
    refuses(
        AerodynamicsError,
        (r"forces are not finite; .*at the wake 1e\+30 m/s", lambda: lattice.solve(state, nodes, still, wind, 0.1)),
        (r"forces are not finite; .*at a node 1e\+200 m/s", lambda: lattice.reset(state, nodes, still, 1e200 * wind)),
    )


def test_tip_without_chord():
    """The shedding edge has no direction there; the wake starts all the same."""
    edges, wing = np.linspace(0.0, 1.0, 6), AeroOptions(n_chord=2, n_span=5, wake_rows=5, full_rows=5, far_wake=False)
    angles = np.linspace(-np.pi, np.pi, 72, endpoint=False)
    polar = np.stack([2 * np.pi * np.sin(angles), 0.01 + 0 * angles, 0 * angles], -1)
    axis = np.stack([0 * edges, 0 * edges, edges], -1)
    chord, quarter = np.sqrt(1.0 - edges**2), 0.25 + 0 * edges
    planform = build_planform(edges, axis, chord, 0 * edges, quarter, np.tile(polar, (5, 1, 1)), 2)
    lattice, nodes = VortexLattice(planform, 1, wing), planform.nodes[None].copy()
    state, still, stream = lattice.new_state(), np.zeros_like(nodes), np.array([1.0, 10.0, 0.0])
    inflow = SimpleNamespace(velocity=lambda points, time: np.broadcast_to(stream, points.shape))
    lattice.reset(state, nodes, still, still + stream)
    lattice.convect_wake(state, inflow, 0.0, 0.05)
    assert lattice.solve(state, nodes, still, still + stream, 0.05)[..., 0].sum() > 0.0
