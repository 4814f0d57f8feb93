"""Wings and sections on the lattice: thin-airfoil limits, polars, bookkeeping, tips, and independent references."""

from dataclasses import replace

import numpy as np
import pytest

from envs_tests.physics.cases.airfoils import (
    UniformStream,
    flat_planform,
    half_span_edges,
    panels_of,
    steady_coefficients,
    steady_wing,
)
from envs_tests.physics.cases.flutter import Resolution, growth, linear_flutter
from envs_tests.physics.cases.rotor import RigidRotor
from envs_tests.physics.cases.wings import (
    NARROW,
    PITCH,
    ROOT,
    RUNGS,
    blade_strips,
    lifting_line_blade,
    middles,
    rung_edges,
    through_strips,
    turbine_strips,
)
from wt_gym.aerodynamics import AerodynamicsError, AeroOptions, VortexLattice, build_planform, span_distribution
from wt_gym.aerodynamics.lattice.planform import section_lattice
from wt_gym.aerodynamics.options import TRAINING
from wt_gym.simulation.models import blade_planform
from wt_gym.turbines import load_turbine

# ---- wings and sections ---------------------------------------------------------------------------------------------

ANGLES = -np.pi + 2 * np.pi * np.arange(720) / 720
FLAT_PLATE = np.stack([2 * np.pi * np.sin(ANGLES), 0 * ANGLES, 0 * ANGLES], -1)
# Stalling section with +-180 degrees, after the shape of measured data: attached to 12 degrees, a drop, a plate beyond.
ATTACHED = np.clip(1.0 - (np.abs(np.degrees(ANGLES)) - 12) / 8, 0, 1)
STALLING = np.stack(
    [
        ATTACHED * 2 * np.pi * np.sin(ANGLES + 0.05) + (1 - ATTACHED) * 1.1 * np.sin(2 * ANGLES),
        0.01 + (1 - ATTACHED) * 1.3 * np.sin(ANGLES) ** 2,
        -0.05 - (1 - ATTACHED) * 0.3 * np.sin(ANGLES),
    ],
    -1,
)


def wing(aspect, n_chord, n_span, polar=FLAT_PLATE, camber=None, inset=(0.25, 0.25)):
    edges = span_distribution(0.0, aspect, n_span, 0.0, inset)
    axis = np.stack([0 * edges, 0 * edges, edges], -1)
    one = np.ones_like(edges)
    return build_planform(edges, axis, one, 0 * one, 0.25 * one, np.tile(polar, (n_span, 1, 1)), n_chord, camber)


def lattice(planform, **options):
    chosen = {"wake_rows": 1, "viscous": False, "far_wake": False, "wake_core": 1e-3, "bound_core": 1e-4, "squire": 0.0}
    return VortexLattice(planform, 1, AeroOptions(**(chosen | panels_of(planform) | options)), 1.0)


def steady(planform, alpha, **options):
    """State with a straight wake, lift and drag coefficients of the true area."""
    _, state, stream = steady_wing(planform, alpha, ground_height=None, **options)
    return state, *steady_coefficients(state, stream, planform.span_edges[-1] + planform.span_edges[0])


@pytest.mark.parametrize("n_chord", [1, 2, 5])
def test_section_lattice_is_thin_airfoil_theory(n_chord):
    flat = section_lattice(np.zeros_like, n_chord)
    assert flat.lift_slope == pytest.approx(2 * np.pi, rel=1e-12)
    assert flat.zero_lift_angle == pytest.approx(0.0, abs=1e-14)
    # Parabolic camber h = 4 f x (1 - x): alpha0 = -2 f, cm about the quarter chord = -pi f.
    f = 0.01
    arc = section_lattice(lambda x: 4 * f * (1 - 2 * x), n_chord, lambda x: 4 * f * x * (1 - x))
    assert arc.zero_lift_angle == pytest.approx(-2 * f, rel=2e-3)
    if n_chord > 1:
        assert arc.zero_lift_moment == pytest.approx(-np.pi * f, rel=1.2 / n_chord**2)


def test_long_wing_obeys_its_own_section():
    camber = lambda z, x: (0.04 * x * (1 - x), 0.04 * (1 - 2 * x))  # noqa: E731
    planform = wing(4000.0, 2, 3, camber=camber, inset=(0, 0))
    for alpha in (0.0, 0.1):
        _, lift, _ = steady(planform, alpha)
        exact = planform.lift_slope[1] * np.sin(alpha - planform.alpha0_lattice[1])
        assert lift == pytest.approx(exact, rel=2e-3)


def after_a_sudden_start(planform, n_steps, dt, alpha=1e-3, **options):
    """State and lattice some steps after a sudden start; its lift is the case ``wagner``.

    That case has strips which are narrow in the middle: velocities are single precision, in which a segment of two
    hundred panel chords, half of one away, loses a per cent, on every processor another one.
    """
    solver = lattice(planform, wake_rows=n_steps + 1, full_rows=n_steps + 1, fresh_rows=n_steps + 1, **options)
    state = solver.new_state()
    stream = UniformStream([np.sin(alpha), np.cos(alpha), 0.0])
    nodes = planform.nodes[None].copy()
    still, wind = 0 * nodes, 0 * nodes + stream.vector
    solver.reset(state, nodes, still, wind)
    for k in range(n_steps):
        solver.convect_wake(state, stream, k * dt, dt)
        solver.solve(state, nodes, still, wind, dt)
        solver.accept(state)
    return state, solver


@pytest.mark.parametrize("degrees", [5.0, 12.0, 16.0, 20.0, 60.0, 120.0, -40.0, 175.0])
@pytest.mark.parametrize("n_chord", [1, 3])
def test_viscous_wing_returns_its_polar(degrees, n_chord):
    alpha = np.radians(degrees)
    camber = lambda z, x: (0.04 * x * (1 - x), 0.04 * (1 - 2 * x))  # noqa: E731
    planform = wing(3000.0, n_chord, 5, STALLING, camber, inset=(0, 0))
    state, lift, drag = steady(planform, alpha, viscous=True)
    expected = [np.interp(alpha, ANGLES, STALLING[:, c]) for c in range(3)]
    assert state.angle_of_attack[0, 2] == pytest.approx(alpha, abs=0.01)
    assert lift == pytest.approx(expected[0], abs=0.02)
    assert drag == pytest.approx(expected[1], abs=0.02)
    assert state.residual < 1e-3
    # Moment about the quarter chord, nose-up positive.
    moment = np.cross(planform.nodes[None], state.nodal_forces).sum(axis=(0, 1, 2))[2] / (0.5 * 3000.0)
    assert moment == pytest.approx(expected[2], abs=0.03)


@pytest.mark.parametrize("edges", [(True, False), (True, True), (False, True)])
def test_circulation_is_conserved_at_every_node_of_the_sheets(edges):
    choice = {"trailing_edge_wake": edges[0], "tip_wake": edges[1]}
    state, solver = after_a_sudden_start(wing(6.0, 2, 6), 8, 0.5, alpha=0.1, **choice)
    bound, wake = solver.work.bound_sheet[:, 0], solver.work.wake_sheet[: state.n_rows + 1, 0]
    net = np.zeros(bound[..., 0].size + wake[1:, :, 0].size)
    number = np.arange(net.size)
    of_bound = number[: bound[..., 0].size].reshape(bound.shape[:2])
    of_wake = np.vstack([solver.arrays.shed_nodes, number[of_bound.size :].reshape(-1, wake.shape[1])])
    for sheet, node in ((bound, of_bound), (wake, of_wake)):
        trail, span = sheet[..., 3].astype(float), sheet[..., 5].astype(float)
        for strength, start, end in ((trail[1:], node[:-1], node[1:]), (span[:, 1:], node[:, :-1], node[:, 1:])):
            np.add.at(net, end, strength)
            np.add.at(net, start, -strength)
    assert np.abs(net).max() < 1e-6 * np.abs(wake[..., 3]).max()


def test_copied_state_continues_bit_for_bit_and_repeated_solves_agree():
    planform = wing(6.0, 2, 6)
    state, solver = after_a_sudden_start(planform, 5, 0.5, alpha=0.1, viscous=True)
    stream = UniformStream([0.1, 1.0, 0.0])
    nodes = planform.nodes[None].copy()

    def advance(state, solves):
        for k in range(4):
            solver.convect_wake(state, stream, 0.5 * k, 0.5)
            for _ in range(solves):
                solver.solve(state, nodes, 0 * nodes, 0 * nodes + stream.vector, 0.5)
            solver.accept(state)
        return state

    first, second = advance(state.copy(), 1), advance(state.copy(), 1)
    assert first == second
    assert first != state
    np.testing.assert_allclose(advance(state.copy(), 3).nodal_forces, first.nodal_forces, rtol=0, atol=1e-6)


# ---- references -----------------------------------------------------------------------------------------------------


def test_mirrored_half_is_the_whole_wing():
    """The image in z = 0 of a half wing against both halves in one lattice without a mirror."""
    edges = np.linspace(0.0, 2.0, 6)
    _, half, stream = steady_wing(flat_planform(edges, 1.0, 2), 0.05)
    whole_edges = np.r_[-edges[:0:-1], edges]
    _, whole, _ = steady_wing(flat_planform(whole_edges, 1.0, 2), 0.05, ground_height=None)
    np.testing.assert_allclose(half.circulation[0], whole.circulation[0, 5:], rtol=1e-5)
    assert steady_coefficients(half, stream, 2.0) == pytest.approx(steady_coefficients(whole, stream, 4.0), rel=1e-5)


def test_goland_wing_flutters_between_165_and_195_m_s():
    """Coarse lattice; published 165 m/s, converged 171 m/s, 4 x 6 panels 173 m/s; about 69 rad/s."""
    coarse = Resolution(4, 6, 8.0, 0.6)
    slow, fast = growth(165.0, coarse), growth(195.0, coarse)
    assert slow.real < 0.0 < fast.real
    assert 60.0 < fast.imag < slow.imag < 75.0
    assert linear_flutter(4, 6)[0] == pytest.approx(171.8, rel=0.01)


# ---- strips at tips -------------------------------------------------------------------------------------------------


def test_strips_of_narrow_blades_are_those_of_a_lifting_line():
    edges = rung_edges(TRAINING, ROOT, 1.0)
    ratio = blade_strips(edges, TRAINING.n_chord, NARROW) / lifting_line_blade(NARROW, ROOT, PITCH, 3)(middles(edges))
    np.testing.assert_allclose(ratio[-5:-1], 1.0, atol=0.005)
    assert ratio[-1] == pytest.approx(1.0, abs=0.02)


def test_strips_at_the_tip_of_a_turbine_are_those_of_a_fine_lattice():
    """The chord of the 5-MW has a kink within the outermost strip."""
    turbine = load_turbine("nrel_5mw")
    place, best = turbine_strips(turbine, replace(TRAINING, n_span=40, squire=1e-3))
    fine = through_strips(place, best.circulation, 2.0 * place[0] - place[1])
    for rung in ("training", "engineering"):
        place, flow = turbine_strips(turbine, replace(RUNGS[rung], squire=1e-3))
        np.testing.assert_allclose(flow.circulation[place > 0.85] / fine(place[place > 0.85]), 1.0, atol=0.015)


# ---- polars of thin airfoils change nothing ----


@pytest.mark.parametrize("n_chord", [1, 3])
def test_polar_of_a_flat_plate_leaves_an_elliptic_wing_alone(n_chord):
    """Aspect ratio 2: the downwash is strongly curved along the chord, most of all at the tip."""
    edges = half_span_edges(1.0, 12)
    chord = 4.0 / np.pi * np.sqrt(1.0 - edges**2)
    planform = flat_planform(edges, chord, n_chord, 0.5)
    _, linear, _ = steady_wing(planform, 0.1)
    _, fed_back, _ = steady_wing(planform, 0.1, viscous=True)
    np.testing.assert_allclose(fed_back.circulation, linear.circulation, rtol=2e-5)
    np.testing.assert_allclose(fed_back.nodal_forces, linear.nodal_forces, atol=2e-5 * linear.nodal_forces.max())


# ---- polars refer to the chord of the strip, the lattice has that of its rings ----


def long_wing(strip_chord, n_chord=2, zero_lift=0.0, moment=0.0, camber=None):
    """A half wing of aspect ratio 4000 with rings of chord one, mirrored, whose polars refer to another chord."""
    edges = np.array([0.0, 800.0, 1600.0, 2000.0])
    angles = np.linspace(-np.pi, np.pi, 720, endpoint=False)
    polar = np.column_stack([2.0 * np.pi * np.sin(angles - zero_lift), 0.0 * angles, moment + 0.0 * angles])
    one, axis = np.ones(4), np.column_stack([0.0 * edges, 0.0 * edges, edges])
    polars = np.tile(polar, (3, 1, 1))
    return build_planform(edges, axis, one, 0.0 * one, 0.25 * one, polars, n_chord, camber, np.full(3, strip_chord))


@pytest.mark.parametrize("strip_chord", [0.85, 1.0, 1.2])
def test_circulation_and_angle_of_a_strip_go_with_the_chord_of_its_polar(strip_chord):
    _, state, _ = steady_wing(long_wing(strip_chord), 0.1, viscous=True)
    assert state.angle_of_attack[0, 0] == pytest.approx(0.1, rel=2e-3)
    assert state.circulation[0, 0] == pytest.approx(np.pi * strip_chord * np.sin(0.1), rel=2e-3)


@pytest.mark.parametrize("strip_chord", [0.85, 1.2])
def test_moment_at_zero_lift_goes_with_the_chord_of_the_polar(strip_chord):
    """A cambered lattice has a moment of its own, which that of the polar replaces."""

    def camber(span, x):
        return 0.16 * x * (1.0 - x), 0.16 * (1.0 - 2.0 * x)

    own = long_wing(1.0, 4, camber=camber)
    assert own.moment0_lattice[0] < -0.05
    zero_lift = own.alpha0_lattice[0]
    planform = long_wing(strip_chord, 4, zero_lift, -0.02, camber)
    _, state, _ = steady_wing(planform, zero_lift, viscous=True)
    force, place = state.nodal_forces[0], planform.nodes
    moment = -(force[..., 0] * place[..., 1] - force[..., 1] * place[..., 0])[:, 0].sum() / 400.0
    assert moment == pytest.approx(0.5 * strip_chord**2 * -0.02, abs=5e-4)


def test_strips_of_a_turbine_have_their_mean_chord():
    blade, planform = load_turbine("nrel_5mw").blade, blade_planform(load_turbine("nrel_5mw"), TRAINING)
    low, high = planform.span_edges[-2:]
    assert planform.chord[-1] == pytest.approx(blade.chord_at(np.linspace(low, high, 2001)).mean(), rel=2e-3)
    assert planform.ring_chord[-1] == pytest.approx(0.5 * (blade.chord_at(low) + blade.chord_at(high)))


def test_edges_without_chord_are_refused():
    planform = long_wing(1.0)
    with pytest.raises(AerodynamicsError, match="one must be positive"):
        replace(planform, edge_chord=np.array([1.0, 1.0, 0.0, 0.0]))


def test_forces_of_strips_are_not_smeared_out():
    """Nodes carry half of either strip beside them; across the sections the strips still have their own forces."""
    turbine = load_turbine("nrel_5mw")
    rotor = RigidRotor.of_turbine(turbine, TRAINING)
    run = rotor.run(TRAINING, 8.0, 7.55 * 8.0 / rotor.radius, 0.0, 1.0)
    inflow = run.alpha + turbine.blade.twist_at(middles(rotor.planform.span_edges))
    lift, drag = rotor.air_density * run.circulation * run.speed, run.coefficients[:, 1]
    along = lift * np.cos(inflow)
    along += 0.5 * rotor.air_density * run.speed**2 * rotor.planform.chord * drag * np.sin(inflow)
    np.testing.assert_allclose(run.force[3:, 0], along[3:], rtol=0.015)
    assert 3.0 * run.force[:, 0] @ np.diff(rotor.planform.span_edges) == pytest.approx(run.thrust[-1], rel=2e-3)
