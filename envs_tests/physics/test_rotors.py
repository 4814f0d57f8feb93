"""Rigid rotors on the lattice: power, momentum limits, wakes, and blade elements with memory."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from envs_tests.physics.cases.operation import GENERATOR_EFFICIENCY, steady_point
from envs_tests.physics.cases.rotor import WIND, RigidRotor, UniformWind, tilted_element, wake_options
from envs_tests.physics.cases.rotor_steps import (
    STEPS,
    gust_response,
    gust_theory,
    measured_harmonics,
    pitch_steps,
    strip_theory,
)
from envs_tests.physics.cases.stall import MEASURED, stalled_rotor
from envs_tests.physics.cases.tools import blade_element
from envs_tests.physics.validation import read_table
from wt_gym.aerodynamics import TRAINING, VortexLattice, build_planform, span_distribution
from wt_gym.aerodynamics.state import sparse_span
from wt_gym.aerodynamics.wake.wake_kernels import wake_sheets
from wt_gym.base.quantities import GRAVITY
from wt_gym.simulation import FIDELITIES
from wt_gym.turbines.blade_element import BladeElementRotor

# ---- a rotor on the lattice -----------------------------------------------------------------------------------------

RADIUS, DENSITY = 60.0, 1.225
ANGLES = -np.pi + 2 * np.pi * np.arange(720) / 720


def polar():
    """Attached to 14 degrees, then a plate: cl = 2 pi sin, later 1.1 sin 2 alpha; cd 0.008, later 1.3 sin^2."""
    attached = np.clip((22 - np.abs(np.degrees(ANGLES))) / 8, 0, 1)
    cl = attached * 2 * np.pi * np.sin(ANGLES) + (1 - attached) * 1.1 * np.sin(2 * ANGLES)
    cd = 0.008 + (1 - attached) * 1.3 * np.sin(ANGLES) ** 2
    return np.stack([cl, cd, 0 * cl], -1)


def blade(options):
    """Chord and twist near the optimum for tip-speed ratio 7.5 and cl = 0.75, without cylinder at the root."""
    edges = span_distribution(4.0, RADIUS, options.n_span)
    local = 7.5 * edges / RADIUS
    inflow = 2 / 3 * np.arctan(1 / local)
    chord = np.minimum(8 * np.pi * edges / (3 * 0.75) * (1 - np.cos(inflow)), 5.0)
    twist = inflow - 0.75 / (2 * np.pi)
    axis = np.stack([0 * edges, 0 * edges, edges], -1)
    return build_planform(
        edges, axis, chord, twist, 0.25 + 0 * edges, np.tile(polar(), (options.n_span, 1, 1)), options.n_chord
    )


def rotor_of(options):
    """Three such blades without cone."""
    return RigidRotor(blade(options), 3, 0.0, RADIUS, 0.0, DENSITY)


def simulate(options, speed, ratio=None, rotor_speed=None, pitch=0.0, turns=2.0):
    """Power and thrust of the last turn [W, N], and the state."""
    rotor_speed = ratio * speed / RADIUS if rotor_speed is None else rotor_speed
    dt = np.radians(options.azimuth_step_deg) / max(abs(rotor_speed), 0.5)
    n_steps = int(turns * 360 / options.azimuth_step_deg)
    steps = rotor_of(options).march(options, UniformWind(speed), rotor_speed, lambda time: pitch, dt, n_steps)
    history = []
    for step in steps:
        history.append((step.torque * rotor_speed, step.thrust))
    assert np.all(np.isfinite(step.state.wake_nodes))
    return *np.array(history)[-int(360 / options.azimuth_step_deg) :].T, step.state


def coefficients(power, thrust, speed):
    area = 0.5 * DENSITY * np.pi * RADIUS**2
    return power.mean() / (area * speed**3), thrust.mean() / (area * speed**2)


@pytest.mark.parametrize("ratio", [6.5, 9.5])
def test_thinned_wake_has_the_power_of_the_unthinned_one(ratio):
    """Also where the wake is dense and counts most: thinning that speeds up the wake rewards overspeed."""
    every = replace(
        TRAINING, wake_rows=200, full_rows=200, coarse_stride=1, sparse_from=None, sparse_stride=1, sparse_span=1,
        far_wake_rows=60, refresh_stride=12,
    )  # fmt: skip
    thinned = coefficients(*simulate(TRAINING, 8.0, ratio=ratio, turns=12)[:2], 8.0)
    expected = coefficients(*simulate(every, 8.0, ratio=ratio, turns=12)[:2], 8.0)
    np.testing.assert_allclose(thinned, expected, rtol=0.02)


THINNED = replace(
    TRAINING, n_span=9, wake_rows=40, full_rows=8, coarse_stride=4, sparse_from=20, sparse_stride=8, sparse_span=3,
    far_wake=False,
)  # fmt: skip


def test_rings_of_a_wake_thinned_twice_are_closed_and_induce_what_all_nodes_do():
    """Circulation times length sums to nothing over each sheet; the velocity at the rotor changes by 1 %."""
    _, _, state = simulate(THINNED, 8.0, ratio=7.0, turns=6)
    assert state.n_rows == THINNED.wake_rows
    unthinned = replace(THINNED, sparse_from=None, sparse_stride=1, sparse_span=1)
    thinned, full = (VortexLattice(blade(o), 3, o, DENSITY) for o in (THINNED, unthinned))
    copy = full.new_state()
    for name, array in state.arrays._asdict().items():
        if not name.startswith("far_"):
            getattr(copy.arrays, name)[...] = array
    radius, angle = np.meshgrid(np.linspace(0.3, 0.9, 7) * RADIUS, np.linspace(0.0, 6.0, 9))
    points = np.stack([0 * radius - 5.0, radius * np.cos(angle), radius * np.sin(angle)], axis=-1)
    expected = full.induced_velocity(copy, points)
    size = np.abs(expected).max()
    np.testing.assert_allclose(thinned.induced_velocity(state, points), expected, atol=0.01 * size)
    wake, sparse = wake_sheets(state.arrays, thinned.constants, thinned.work, 0)
    assert len(sparse) == 21
    assert sparse.shape[2] == 6
    for sheet in (wake.astype(float), sparse.astype(float)):
        total = (np.diff(sheet[..., :3], axis=0) * sheet[1:, ..., 3:4]).sum(axis=(0, 1, 2))
        total += (np.diff(sheet[..., :3], axis=2) * sheet[:, :, 1:, 5:6]).sum(axis=(0, 1, 2))
        if sheet.shape == wake.shape:  # its first row continues the rings of the blades
            bound = thinned.work.bound_sheet.astype(float)
            total += (np.diff(bound[..., :3], axis=0) * bound[1:, ..., 3:4]).sum(axis=(0, 1, 2))
            total += (np.diff(bound[..., :3], axis=2) * bound[:, :, 1:, 5:6]).sum(axis=(0, 1, 2))
        lengths = np.linalg.norm(np.diff(sheet[..., :3], axis=0), axis=-1) * np.abs(sheet[1:, ..., 3])
        assert np.abs(total).max() < 1e-4 * lengths.sum()


def test_the_joint_of_dense_and_sparse_wake_does_not_move_the_nodes_beside_it():
    """Spanwise segments close the merged rings there. Every row anew in every step is as good as rows in turn."""
    every = replace(TRAINING, fresh_rows=TRAINING.wake_rows, refresh_stride=1)
    power, thrust, state = simulate(every, 8.0, ratio=7.5, turns=4)
    axial = state.arrays.wake[9:19, :, :, 0].copy()
    age = state.arrays.age[9:19]
    speed = np.diff(axial, axis=0) / np.diff(age)[:, None, None]
    assert np.abs(np.diff(speed, axis=0))[:, :, 1:-1].max() < 2.0  # [m/s] from row to row; 5 with these rows computed
    in_turn = simulate(TRAINING, 8.0, ratio=7.5, turns=4)
    np.testing.assert_allclose(np.mean(in_turn[:2], axis=1), np.mean((power, thrust), axis=1), rtol=5e-3)


def test_merged_rings_have_the_impulse_of_their_parts():
    """Of a rotor: circulation times area swept; of a wing, circulation times width."""
    planform = blade(TRAINING)
    edges, circulation = planform.span_edges, np.sin(np.linspace(0.3, 3.0, TRAINING.n_span))
    for radius in (None, 0.0, 3.0):
        turning = replace(planform, root_radius=radius)
        nodes, weight, place = sparse_span(turning, (TRAINING.n_chord * len(edges)) + np.arange(len(edges)), 3)
        corners = planform.nodes[-1]
        width, middle = np.linalg.norm(np.diff(corners, axis=0), axis=1), 0.5 * (corners[1:, 2] + corners[:-1, 2])
        moment = width * (1.0 if radius is None else radius + middle)
        for first, last in pairwise(nodes):
            part = slice(first, last)
            merged = weight[part] @ circulation[part]
            np.testing.assert_allclose(merged * moment[part].sum(), moment[part] @ circulation[part], rtol=1e-12)
            np.testing.assert_allclose(place[first + 1 : last], np.cumsum(width[part])[:-1] / width[part].sum())


def test_wind_of_every_row_is_asked_for_in_turn():
    """In a wind that grows by 1 m/s every second no row keeps an older wind than the options allow."""

    class Growing:
        def velocity(self, points, time):
            return np.broadcast_to([8.0 + time, 0.0, 0.0], np.shape(points))

    options, dt = replace(THINNED, wind_stride=5), 0.1
    for k, step in enumerate(rotor_of(options).march(options, Growing(), 1.2, lambda time: 0.0, dt, 60)):
        asked = step.state.arrays.wind[1 : step.state.n_rows + 1, ..., 0] - 8.0
        assert asked.min() > (k - options.wind_stride) * dt + 1e-9 or k < options.wind_stride
        assert asked.max() < (k + 0.5) * dt


SPEED_SCALE = 25.0  # [m/s]


@pytest.mark.parametrize(
    ("speed", "rotor_speed", "pitch_deg"),
    [
        (0.0, 1.2, 0.0), (8.0, 1.2, 90.0), (25.0, 0.0, 0.0), (25.0, 0.0, 90.0), (20.0, 1.25, 0.0), (-15.0, 1.2, 0.0),
        (15.0, -0.8, 0.0), (3.0, 1.25, 0.0), (12.0, 1.2, -30.0), (0.5, 1.2, 0.0), (0.0, 0.3, 0.0),
    ],
)  # fmt: skip
def test_no_corner_yields_more_than_momentum_allows(speed, rotor_speed, pitch_deg):
    power, thrust, state = simulate(TRAINING, speed, rotor_speed=rotor_speed, pitch=np.radians(pitch_deg), turns=3)
    betz = 16 / 27 * 0.5 * DENSITY * np.pi * RADIUS**2 * abs(speed) ** 3
    assert power.mean() < betz + 1.0
    if abs(speed) < 1.0:  # from the start on
        assert simulate(TRAINING, speed, rotor_speed=rotor_speed, turns=1)[0].max() < 0.0
        assert power.max() < 0.0
    # No strip carries more than its polar; where its speed has just fallen the lag of the stall may keep an older
    # angle, at a dynamic pressure that makes the excess meaningless.
    chord = np.broadcast_to(blade(TRAINING).chord, state.section_speed.shape)
    lift = 2 * np.abs(state.circulation) / (np.maximum(state.section_speed, 1e-3) * chord)
    excess = (
        np.maximum(lift - np.abs(polar()[:, 0]).max() * 1.15 - 0.05, 0.0) * (state.section_speed / SPEED_SCALE) ** 2
    )
    assert excess.max() < 0.03
    bound = 0.5 * DENSITY * 3 * 4.0 * RADIUS * (abs(speed) + abs(rotor_speed) * RADIUS) ** 2 * 1.6
    assert np.abs(thrust).max() < bound


def test_reset_without_wake_and_induced_velocity_far_away():
    rotor, inflow = rotor_of(TRAINING), UniformWind(8.0)
    solver = VortexLattice(rotor.planform, 3, TRAINING, DENSITY)
    state = solver.new_state()
    nodes, velocities = rotor.motion(0.0, 1.0, 0.0)
    wind = inflow.velocity(nodes, 0.0)
    solver.reset(state, nodes, velocities, wind)
    for k in range(3):
        solver.convect_wake(state, inflow, 0.2 * k, 0.2)
        nodes, velocities = rotor.motion(0.2 * (k + 1), 1.0, 0.0)
        solver.solve(state, nodes, velocities, wind, 0.2)
        solver.accept(state)
    assert state.n_rows == 3
    behind = solver.induced_velocity(state, [[5.0, 40.0, 0.0], [5e3, 0.0, 0.0]])
    assert -8.0 < behind[0, 0] < -0.1
    assert np.abs(behind[1]).max() < 1e-3


# ---- parts of the validation cases ----------------------------------------------------------------------------------

RPM = np.pi / 30.0


def test_blade_element_theory_agrees_with_an_independent_one():
    """Same polars and planform: near the optimum two codes of this theory differ by less than one percent."""
    table, _ = read_table("nrel5mw_performance.csv")
    for ratio in (7.0, 7.5, 8.0):
        cp, ct = tilted_element(ratio, 0.0)
        assert cp == pytest.approx(np.interp(ratio, table[:, 0], table[:, 1]), rel=0.01)
        assert ct == pytest.approx(np.interp(ratio, table[:, 0], table[:, 2]), rel=0.02)


def test_blade_element_theory_agrees_with_the_published_operating_points(turbine):
    rotor = BladeElementRotor.of_turbine(turbine)
    table, _ = read_table("nrel5mw_steady_state.csv")
    weight = 110e3 * GRAVITY * np.sin(np.radians(5.0))
    for wind, speed, pitch, power, thrust in table[np.isin(table[:, 0], (5.0, 8.0, 11.0, 15.0, 20.0))]:
        result = blade_element(rotor, wind, speed * RPM, np.radians(pitch))
        assert result.power == pytest.approx(1e3 * power, rel=0.025)
        assert result.thrust == pytest.approx(1e3 * thrust - weight, rel=0.02)


def test_blade_element_theory_without_a_wind_takes_power(turbine):
    """Far below the wind for which it is pitched a rotor works as a propeller."""
    assert blade_element(BladeElementRotor.of_turbine(turbine), 2.0, 12.1 * RPM, 0.0).power < 0.0


def test_rigid_rotor_at_the_optimum(turbine):
    options = wake_options(3.0, steps_per_turn=20, n_span=8)
    rotor = RigidRotor.of_turbine(turbine, options)
    run = rotor.run(options, WIND, 7.5 * WIND / rotor.radius, 0.0, 6.0, turbine.nacelle.tilt)
    assert run.cp == pytest.approx(0.482247, rel=0.09)
    assert run.ct == pytest.approx(0.770348, rel=0.08)
    assert abs(run.drift) < 0.01
    # the force per length along the span holds the thrust
    width = np.diff(rotor.planform.span_edges)
    one_blade = float(run.force[:, 0] @ width)
    assert 3.0 * one_blade == pytest.approx(run.ct * run.reference_thrust, rel=0.03)


def test_operating_point_above_rated(turbine):
    table, _ = read_table("nrel5mw_steady_state.csv")
    wind, speed, pitch, power, thrust = table[table[:, 0] == 18.0][0]
    point = steady_point(turbine, wind, speed * RPM, np.radians(pitch), settling=20.0)
    assert point.rotor_speed == pytest.approx(speed, rel=0.005)
    assert point.power == pytest.approx(GENERATOR_EFFICIENCY * power, rel=0.01)
    assert point.thrust == pytest.approx(thrust, rel=0.08)
    assert point.pitch == pytest.approx(pitch, abs=0.8)


def test_lag_of_the_thrust_in_oscillating_wind():
    """The coarsest wake against blade elements with Loewy's and Øye's lags at 12 m/s."""
    frequencies = np.array([0.12, 0.32, 0.8])
    found = gust_response(TRAINING, 12.0, 25.0, 25.0, frequencies)
    expected = np.array([r.full for r in gust_theory(12.0, frequencies)])
    np.testing.assert_allclose(np.abs(found / expected), 1.0, atol=0.1)
    np.testing.assert_allclose(np.degrees(np.angle(found / expected)), 0.0, atol=6.0)


def test_the_tower_before_which_the_blades_pass():
    """Harmonics of the thrust by the flow past the tower, in the wind that the rotor leaves it."""
    found, theory = measured_harmonics(FIDELITIES["training"], 60.0, 4), strip_theory()
    np.testing.assert_allclose(np.abs(found), np.abs(theory), rtol=0.25)
    assert abs(strip_theory(slowed=False)[0]) > 1.4 * abs(theory[0])


def test_tjaereborg_pitch_steps():
    """Published bounds with the coarsest wake."""
    run = pitch_steps(TRAINING)
    for start, end in STEPS.values():
        torque, thrust = run.overshoot("torque", start, end), run.overshoot("thrust", start, end)
        assert 3.0 <= torque.ratio <= 7.0
        assert 1.5 <= thrust.ratio <= 1.9
        assert 6.0 <= torque.recovery <= 14.0


def test_stall_delayed_by_rotation_gives_a_stalled_rotor_its_torque():
    """UAE Phase VI at 20 m/s: two-dimensional polars lose 40 % of the torque and of the normal force inboard."""
    torque, _, coefficients = MEASURED[20.0]
    obtained, _, normal = stalled_rotor(20.0, augmentation="du-selig", turns=3.0)
    assert obtained == pytest.approx(torque, rel=0.15)
    assert normal[0] == pytest.approx(coefficients[0], rel=0.1)
    without, _, flat = stalled_rotor(20.0, turns=3.0)
    assert without < 0.7 * torque
    assert flat[0] < 0.7 * coefficients[0]
