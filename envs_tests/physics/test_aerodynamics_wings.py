"""Wings and sections: thin-airfoil limits, lifting-surface values, unsteady lift, polars, bookkeeping."""

import numpy as np
import pytest

from envs_tests.physics.cases.airfoils import panels_of
from wt_gym.aerodynamics import AerodynamicsError, AeroOptions, VortexLattice, build_planform, span_distribution
from wt_gym.aerodynamics.lattice.planform import section_lattice

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


class Uniform:
    def __init__(self, velocity):
        self.vector = np.asarray(velocity, dtype=float)

    def velocity(self, points, time):
        return np.broadcast_to(self.vector, np.shape(points))


def wing(aspect, n_chord, n_span, polar=FLAT_PLATE, camber=None, inset=(0.25, 0.25)):
    edges = span_distribution(0.0, aspect, n_span, 0.0, inset)
    axis = np.stack([0 * edges, 0 * edges, edges], -1)
    one = np.ones_like(edges)
    return build_planform(edges, axis, one, 0 * one, 0.25 * one, np.tile(polar, (n_span, 1, 1)), n_chord, camber)


def lattice(planform, **options):
    chosen = {"wake_rows": 1, "viscous": False, "far_wake": False, "wake_core": 1e-3, "bound_core": 1e-4, "squire": 0.0}
    return VortexLattice(planform, 1, AeroOptions(**(chosen | panels_of(planform) | options)), 1.0)


def steady(planform, alpha, speed=1.0, **options):
    """State with a straight wake, lift and drag coefficients of the true area."""
    solver = lattice(planform, viscosity=0.0, **options)
    state = solver.new_state()
    nodes = planform.nodes[None].copy()
    stream = speed * np.array([np.sin(alpha), np.cos(alpha), 0.0])
    length = 2e3 * planform.span_edges[-1]
    edge = 0.25 * nodes[:, -2] + 0.75 * nodes[:, -1]
    solver.initialize_wake(
        state, nodes, 0 * nodes, 0 * nodes + stream, [edge + length * stream / speed], [length / speed]
    )
    total = state.nodal_forces.sum(axis=(0, 1, 2))
    inset = planform.span_edges[0]
    scale = 0.5 * speed**2 * (planform.span_edges[-1] + inset)
    direction = stream / speed
    return state, total @ [direction[1], -direction[0], 0] / scale, total @ direction / scale


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


@pytest.mark.parametrize(("aspect", "slope"), [(4, 3.6120), (8, 4.5861), (20, 5.4335)])
def test_rectangular_wing_lift_slope(aspect, slope):
    coarse, fine = (steady(wing(aspect, n, 10 * n), 1e-3)[1] / 1e-3 for n in (2, 4))
    assert coarse == pytest.approx(slope, rel=0.012)
    assert fine == pytest.approx(slope, rel=0.005)
    assert 2 * fine - coarse == pytest.approx(slope, rel=0.003)


def test_induced_drag_agrees_with_far_field():
    planform = wing(8.0, 2, 40)
    state, _, drag = steady(planform, 0.05)
    gamma, edges = state.circulation[0], planform.span_edges
    trailing = np.diff(np.concatenate(([0.0], gamma, [0.0])))
    middle = 0.5 * (edges[1:] + edges[:-1])
    # Trefftz plane: half of the downwash of the straight wake, at the middle of each strip.
    downwash = (trailing / (2 * np.pi * (edges - middle[:, None]))).sum(axis=1)
    far_field = 0.5 * np.sum(gamma * downwash * np.diff(edges))
    scale = 0.5 * (edges[-1] + edges[0])
    assert drag == pytest.approx(abs(far_field) / scale, rel=0.02)


def after_a_sudden_start(planform, n_steps, dt, alpha=1e-3, **options):
    """State and lattice some steps after a sudden start; its lift is the case ``wagner``.

    That case has strips which are narrow in the middle: velocities are single precision, in which a segment of two
    hundred panel chords, half of one away, loses a per cent, on every processor another one.
    """
    solver = lattice(planform, wake_rows=n_steps + 1, full_rows=n_steps + 1, fresh_rows=n_steps + 1, **options)
    state = solver.new_state()
    stream = Uniform([np.sin(alpha), np.cos(alpha), 0.0])
    nodes = planform.nodes[None].copy()
    still, wind = 0 * nodes, 0 * nodes + stream.vector
    solver.reset(state, nodes, still, wind)
    for k in range(n_steps):
        solver.convect_wake(state, stream, k * dt, dt)
        solver.solve(state, nodes, still, wind, dt)
        solver.accept(state)
    return state, solver


def test_sudden_acceleration_pushes_with_the_added_mass():
    """A plate heaved with acceleration at rest in still air feels -rho pi c^2 / 4 per length."""
    planform = wing(200.0, 16, 3, inset=(0, 0))
    solver = lattice(planform, wake_rows=4)
    state, calm = solver.new_state(), Uniform([0.0, 1e-6, 0.0])
    nodes = planform.nodes[None].copy()
    dt, acceleration = 1e-3, 1.0
    wind = 0 * nodes + calm.vector
    solver.reset(state, nodes, 0 * nodes, wind)
    for k in range(1, 4):
        velocity = np.zeros_like(nodes)
        velocity[..., 0] = acceleration * k * dt
        solver.convect_wake(state, calm, (k - 1) * dt, dt)
        forces = solver.solve(state, nodes, velocity, wind, dt)
        solver.accept(state)
    assert forces[..., 0].sum() / 200.0 == pytest.approx(-np.pi / 4, rel=0.06)


@pytest.mark.parametrize("degrees", [5.0, 12.0, 16.0, 20.0, 60.0, 120.0, -40.0, 175.0])
@pytest.mark.parametrize("n_chord", [1, 3])
def test_viscous_wing_returns_its_polar(degrees, n_chord):
    alpha = np.radians(degrees)
    camber = lambda z, x: (0.04 * x * (1 - x), 0.04 * (1 - 2 * x))  # noqa: E731
    planform = wing(3000.0, n_chord, 5, STALLING, camber, inset=(0, 0))
    state, lift, drag = steady(planform, alpha, speed=30.0, viscous=True)
    expected = [np.interp(alpha, ANGLES, STALLING[:, c]) for c in range(3)]
    assert state.angle_of_attack[0, 2] == pytest.approx(alpha, abs=0.01)
    assert lift == pytest.approx(expected[0], abs=0.02)
    assert drag == pytest.approx(expected[1], abs=0.02)
    assert state.residual < 1e-3
    # Moment about the quarter chord, nose-up positive.
    arm = planform.nodes[None] - np.array([0.0, 0.0, 0.0])
    moment = np.cross(arm, state.nodal_forces).sum(axis=(0, 1, 2))[2] / (0.5 * 30.0**2 * 3000.0)
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
    stream = Uniform([0.1, 1.0, 0.0])
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


def test_ground_reduces_downwash():
    """A wing half a span above ground lifts more; the image method is exact for a mirrored pair of wings."""
    planform = wing(4.0, 2, 8)
    _, free, _ = steady(planform, 0.05)
    solver = lattice(planform, ground_height=0.0, viscosity=0.0)
    state = solver.new_state()
    # Lift upwards, +z: span along y, chord along x.
    turn = np.array([[0, 0, 1.0], [1, 0, 0], [0, 1, 0]]).T
    nodes = (planform.nodes @ turn.T + np.array([0, 0, 1.0]))[None]
    alpha = 0.05
    stream = turn @ np.array([np.sin(alpha), np.cos(alpha), 0])
    edge = 0.25 * nodes[:, -2] + 0.75 * nodes[:, -1]
    along = turn @ np.array([0.0, 1.0, 0.0])
    solver.initialize_wake(state, nodes, 0 * nodes, 0 * nodes + stream, [edge + 1e3 * along], [1e3])
    lift = state.nodal_forces.sum(axis=(0, 1, 2))[2] / (0.5 * 4.0)
    assert free * 1.03 < lift < free * 1.3


def test_refusals():
    good = {"edges": np.linspace(0, 4, 5)}
    one = np.ones(5)
    axis = np.stack([0 * one, 0 * one, good["edges"]], -1)
    polars = np.tile(FLAT_PLATE, (4, 1, 1))
    with pytest.raises(AerodynamicsError, match="increase"):
        build_planform(good["edges"][::-1], axis[::-1], one, 0 * one, one, polars, 2)
    with pytest.raises(AerodynamicsError, match="chord"):
        build_planform(good["edges"], axis, 0 * one, 0 * one, one, polars, 2)
    with pytest.raises(AerodynamicsError, match="must have an area"):
        build_planform(good["edges"], axis * [1, 1, 0], one, 0 * one, one, polars, 2)
    with pytest.raises(AerodynamicsError, match="polar"):
        build_planform(good["edges"], axis, one, 0 * one, one, polars * np.nan, 2)
    with pytest.raises(AerodynamicsError, match="wake_rows"):
        AeroOptions(wake_rows=0)
    planform = wing(4.0, 1, 4)
    solver = lattice(planform, wake_rows=3)
    state, nodes = solver.new_state(), planform.nodes[None].copy()
    with pytest.raises(AerodynamicsError, match="not finite"):
        solver.reset(state, nodes, 0 * nodes, nodes * np.nan)
    solver.reset(state, nodes, 0 * nodes, 0 * nodes + [0, 1.0, 0])
    with pytest.raises(AerodynamicsError, match="inflow is not finite"):
        solver.convect_wake(state, Uniform([np.nan, 1.0, 0.0]), 0.0, 0.1)
