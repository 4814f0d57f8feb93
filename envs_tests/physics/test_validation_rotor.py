"""Fast parts of the rotor validation: blade-element theory, rigid rotors on the lattice, one point of the curve."""

from dataclasses import replace

import numpy as np
import pytest

from validation.blade_element import BladeElementRotor, blade_element
from validation.lattice_convergence import HELIX, rigid_helix
from validation.nrel5mw_rotor import WIND, tilted_element, wake_options
from validation.operating_curve import GENERATOR_EFFICIENCY, steady_point
from validation.phase_vi import OPTIONS, run_blade
from validation.rigid_rotor import RigidRotor
from validation.tree_tools import read_table
from wt_gym.turbines import load_turbine

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
    weight = 110e3 * 9.81 * np.sin(np.radians(5.0))
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
