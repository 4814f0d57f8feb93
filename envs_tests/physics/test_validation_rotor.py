"""Fast parts of the rotor validation: blade-element theory, rigid rotors on the lattice, one point of the curve."""

from dataclasses import replace

import numpy as np
import pytest

from envs_tests.physics.cases.airfoils import theodorsen
from envs_tests.physics.cases.dynamic_inflow import DynamicRotor, Response, loewy, oye_filter, oye_times
from envs_tests.physics.cases.operation import GENERATOR_EFFICIENCY, steady_point
from envs_tests.physics.cases.rotor import WIND, RigidRotor, tilted_element, wake_options
from envs_tests.physics.cases.rotor_convergence import HELIX, rigid_helix
from envs_tests.physics.cases.rotor_steps import (
    ROTOR_SPEED,
    STEPS,
    carried_part,
    five_megawatt_elements,
    mean_in_windows,
    measured_harmonics,
    pitch_steps,
    ring_wake_step,
    strip_theory,
)
from envs_tests.physics.cases.rotor_steps import WIND as STEP
from envs_tests.physics.cases.rotor_steps import gust_response as measured
from envs_tests.physics.cases.rotor_steps import gust_theory as theory
from envs_tests.physics.cases.stall import MEASURED, OPTIONS, run_blade, stalled_rotor
from envs_tests.physics.validation import read_table
from wt_gym.aerodynamics import TRAINING
from wt_gym.base.constants import GRAVITY
from wt_gym.simulation import FIDELITIES
from wt_gym.turbines import load_turbine
from wt_gym.turbines.blade_element import BladeElementRotor, blade_element

RPM = np.pi / 30.0


@pytest.fixture(scope="module")
def turbine():
    return load_turbine("nrel_5mw")


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


def test_phase_six_torque():
    options = replace(OPTIONS, n_chord=1, n_span=10, azimuth_step_deg=15.0, wake_rows=60, full_rows=60,
                      fresh_rows=24, far_wake_rows=36)  # fmt: skip
    run, _, speed, measured = run_blade("model", options, turns=5.0)
    assert run.power[-run.steps_per_turn :].mean() / speed == pytest.approx(measured, rel=0.1)


def test_closure_of_a_rigid_helix():
    """A coarser step than in the validation case; the ratio of wake lengths is the same."""
    long = rigid_helix(12, steps_per_turn=20)
    assert rigid_helix(3, steps_per_turn=20) / long == pytest.approx(HELIX[3] / HELIX[12], rel=0.005)
    assert rigid_helix(3, steps_per_turn=20, closure=True) == pytest.approx(long, rel=0.01)


def test_operating_point_above_rated(turbine):
    table, _ = read_table("nrel5mw_steady_state.csv")
    wind, speed, pitch, power, thrust = table[table[:, 0] == 18.0][0]
    point = steady_point(turbine, wind, speed * RPM, np.radians(pitch), settling=20.0)
    assert point.rotor_speed == pytest.approx(speed, rel=0.005)
    assert point.power == pytest.approx(GENERATOR_EFFICIENCY * power, rel=0.01)
    assert point.thrust == pytest.approx(thrust, rel=0.08)
    assert point.pitch == pytest.approx(pitch, abs=0.8)


def test_two_exponentials_are_found_again():
    time = np.arange(-10.0, 60.0, 0.05)
    decay = 30.0 * np.exp(-time / 1.5) + 20.0 * np.exp(-time / 8.0)
    signal = np.where(time > 0.0, 120.0 + decay, 80.0)
    zero = np.zeros_like(time)
    run = Response(time, zero, zero, zero, signal, zero, zero)
    found, fit = run.overshoot("thrust"), run.fit("thrust")
    assert found.ratio == pytest.approx((120.0 + 50.0 - 80.0) / 40.0, rel=0.02)
    assert found.mean_time == pytest.approx((30.0 * 1.5 + 20.0 * 8.0) / 50.0, rel=0.03)
    assert (fit.fast_time, fit.slow_time) == pytest.approx((1.5, 8.0), rel=0.02)
    assert (fit.fast, fit.slow) == pytest.approx((30.0, 20.0), rel=0.05)


def test_time_constants_of_dynamic_inflow():
    """Published table of Øye's model: Tjæreborg and the 5-MW at 8 m/s."""
    slow, fast = oye_times(0.30, 30.56, 8.7, [0.3, 0.7, 0.95])
    assert slow == pytest.approx(6.3, abs=0.05)
    np.testing.assert_allclose(fast, [2.3, 1.7, 1.0], atol=0.06)
    slow, fast = oye_times(0.33, 63.0, 8.0, [0.3, 0.7, 0.95])
    assert slow == pytest.approx(15.2, abs=0.05)
    np.testing.assert_allclose(fast, [5.6, 4.0, 2.4], atol=0.06)
    assert abs(oye_filter(1e-6, slow, fast) - 1.0).max() < 1e-4


def test_layers_far_away_leave_theodorsens_function():
    np.testing.assert_allclose(loewy(0.3, 1e3, 1.0), theodorsen(0.3), rtol=1e-9)


def test_a_step_of_the_pitch_in_blade_element_theory(turbine):
    """Overshoot at once, then the equilibrium of momentum theory."""
    rotor = DynamicRotor(BladeElementRotor.of_turbine(turbine), 12)
    run = rotor.respond(lambda t: 10.0 + 0.0 * t, lambda t: np.where(t > 0.0, 0.02, 0.0), 1.1, 90.0, 0.2)
    expected = rotor.loads(10.0, 1.1, 0.02, rotor.equilibrium(10.0, 1.1, 0.02))
    assert run.thrust[-1] == pytest.approx(expected[0], rel=1e-3)
    assert run.overshoot("thrust").ratio > 1.5


def test_lag_of_the_thrust_in_oscillating_wind():
    """The coarsest wake against blade elements with Loewy's and Øye's lags at 12 m/s."""
    frequencies = np.array([0.12, 0.32, 0.8])
    found = measured(TRAINING, 12.0, 25.0, 25.0, frequencies)
    expected = np.array([r.full for r in theory(12.0, frequencies)])
    np.testing.assert_allclose(np.abs(found / expected), 1.0, atol=0.1)
    np.testing.assert_allclose(np.degrees(np.angle(found / expected)), 0.0, atol=6.0)


def test_a_step_of_the_wind_at_constant_speed_hardly_overshoots():
    """Near the optimum momentum theory has the same induced velocity at 8 and 9 m/s: nothing is left to lag."""
    rotor = five_megawatt_elements()
    before, after = (rotor.equilibrium(wind, ROTOR_SPEED, 0.0) for wind in (STEP.before, STEP.after))
    area = rotor.radius / rotor.radius.sum()
    assert after[0] @ area == pytest.approx(before[0] @ area, rel=0.02)
    run = rotor.respond(STEP, lambda time: 0.0 * time, ROTOR_SPEED, 60.0)
    assert run.overshoot("thrust").ratio == pytest.approx(1.0, abs=0.01)


def test_a_carried_step_of_the_wind():
    """The coarsest wake against blade elements (at once) and against the transport of rings (what carrying adds)."""
    rotor = five_megawatt_elements()
    before = rotor.loads(STEP.before, ROTOR_SPEED, 0.0, rotor.equilibrium(STEP.before, ROTOR_SPEED, 0.0))[0]
    theory = []
    for carried in (np.inf, STEP.before):
        time, thrust = ring_wake_step(rotor, STEP, ROTOR_SPEED, carried)
        theory.append(mean_in_windows(time, thrust, before, thrust[-50:].mean()))
    assert -0.08 < (theory[1] - theory[0]).min() < -0.06
    at_once, added = carried_part(TRAINING)
    np.testing.assert_allclose(at_once, 1.0, atol=0.04)
    np.testing.assert_allclose(added, theory[1] - theory[0], atol=0.03)


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
