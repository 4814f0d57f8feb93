"""Extremes between two samples: nothing slips through a control step."""

from dataclasses import replace

import numpy as np
import pytest

from wt_gym.simulation import FIDELITIES, Simulator, SimulatorState
from wt_gym.simulation.step.coupling_kernels import passing_clearance, signed_clearance, view_from_tower
from wt_gym.turbines import load_turbine
from wt_gym.wind import SteadyInflow

SPEED = 1.2
RADIUS = 2.5


def clearance(ahead, beside, above=-10.0):
    return signed_clearance(np.array([ahead, beside, above, RADIUS]))


def test_clearance_of_a_cylinder_and_of_what_lies_behind_it():
    assert clearance(4.0, 3.0) == pytest.approx(5.0 - RADIUS)  # upwind: from the surface
    assert clearance(-7.0, 3.0) == clearance(0.0, -3.0) == pytest.approx(0.5)  # beside what lies behind
    assert clearance(0.0, 0.0) == -RADIUS
    assert clearance(-3.0, 0.0) == pytest.approx(-3.0 - RADIUS)  # from the front of the tower, along the nacelle's axis
    assert clearance(-3.0, 2.4) == pytest.approx(0.0, abs=0.25)
    assert clearance(2.0, 0.0, above=4.0) == 4.0  # over the rim
    assert clearance(5.5, 0.0, above=4.0) == pytest.approx(5.0)


def test_a_tip_is_seen_along_the_axis_of_the_nacelle():
    base, top, yaw = np.array([0.0, 0.0, 10.0]), np.array([1.0, 0.5, 90.0]), 0.4
    axis = np.array([np.cos(yaw), np.sin(yaw), -0.1])
    upwind, side = -np.array([np.cos(yaw), np.sin(yaw)]), np.array([-np.sin(yaw), np.cos(yaw)])
    middle = 0.5 * (base + top)
    tip = middle + np.array([*(6.0 * upwind + 2.0 * side), 0.0])
    out = np.zeros(4)
    view_from_tower(tip, base, top, axis, np.array([0.0, 40.0, 80.0]), np.array([3.0, 2.6, 2.0]), out)
    np.testing.assert_allclose(out, [6.0, 2.0, -40.0, 2.6], atol=1e-12)


@pytest.mark.parametrize(("ahead", "least"), [(6.0, 6.0 - RADIUS), (-1.0, -1.0 - RADIUS)])
def test_a_tip_that_flies_by_between_two_steps_counts(ahead, least):
    before, now = (np.array([ahead, beside, -60.0, RADIUS]) for beside in (5.0, -6.0))
    assert min(signed_clearance(before), signed_clearance(now)) > least + 1.0
    assert passing_clearance(before, now, np.zeros(4)) == pytest.approx(least, abs=1e-12)
    assert passing_clearance(now, now, np.zeros(4)) == signed_clearance(now)


def run(simulator, control_step, duration, state):
    """Signals of a run with constant demands from a snapshot."""
    simulator.restore(state)
    return [
        simulator.advance(control_step, pitch=0.03, generator_torque=38e3)
        for _ in range(round(duration / control_step))
    ]


@pytest.fixture(scope="module")
def simulator():
    sim = Simulator("nrel_5mw", SteadyInflow(11.0, shear_exponent=0.2))
    sim.reset(rotor_speed=SPEED, azimuth=0.4)
    return sim


def test_extremes_do_not_depend_on_the_control_step(simulator):
    """The same motion, sampled every 0.1 s and every 1.2 s: the extremes agree to the last bit, the samples do not."""
    start = simulator.state()
    fine, coarse = (run(simulator, step, 3.6, start) for step in (0.1, 1.2))
    assert np.array_equal(fine[-1]["tip_clearance"], coarse[-1]["tip_clearance"])
    for name in ("tip_out_of_plane", "root_flap_moment", "tower_base_moment", "rotor_speed"):
        highest = [np.max([s[f"{name}_max"] for s in signals], axis=0) for signals in (fine, coarse)]
        assert np.array_equal(*highest), name
    least = [np.min([s["tip_clearance_min"] for s in signals]) for signals in (fine, coarse)]
    assert least[0] == least[1]
    sampled = [min(s["tip_clearance"].min() for s in signals) for signals in (fine, coarse)]
    assert least[0] <= sampled[0] < least[0] + 0.5
    assert sampled[1] > least[0] + 1.0


def test_samples_count_among_the_extremes(simulator):
    signals = simulator.reset(rotor_speed=SPEED, azimuth=0.4)
    for _ in range(10):
        base = np.hypot(signals.tower_base_fore_aft_moment, signals.tower_base_side_side_moment)
        assert signals.tower_base_moment_max >= base * (1.0 - 1e-12)
        assert signals.rotor_speed_max >= signals.rotor_speed
        assert np.all(signals.tip_clearance_min <= signals.tip_clearance)
        assert np.all(signals.tip_out_of_plane_max >= signals.tip_out_of_plane)
        assert np.all(signals.root_flap_moment_max >= np.abs(signals.root_flap_moment) * (1.0 - 1e-12))
        signals = simulator.advance(0.1, pitch=0.03, generator_torque=38e3)


def test_extremes_survive_a_snapshot(simulator, tmp_path):
    simulator.reset(rotor_speed=SPEED, azimuth=0.9)
    simulator.advance(0.2, pitch=0.0, generator_torque=38e3)
    simulator.state().save(tmp_path / "state.npz")
    first = simulator.advance(0.3, pitch=0.0, generator_torque=38e3)
    simulator.restore(SimulatorState.load(tmp_path / "state.npz"))
    assert simulator.advance(0.3, pitch=0.0, generator_torque=38e3) == first


@pytest.fixture(scope="module")
def leaning():
    """The 5-MW turbine tilted the wrong way, so that its tips swing round behind the tower."""
    nrel, tilt = load_turbine("nrel_5mw"), np.radians(-7.0)
    height = nrel.hub_height + nrel.nacelle.overhang * (np.sin(tilt) - np.sin(nrel.nacelle.tilt))
    turbine = replace(nrel, hub_height=height, nacelle=replace(nrel.nacelle, tilt=tilt))
    fidelity = replace(FIDELITIES["training"], tower_shadow=False)  # no flow around a tower that is hit
    return Simulator(turbine, SteadyInflow(9.0), fidelity)


def test_no_tip_passes_behind_the_tower_unseen(leaning):
    """The first strike is found in the control step in which a blade passes the tower, wherever it starts."""
    step, unseen = 0.4, 0
    for azimuth in np.linspace(0.0, 0.9, 5):
        signals = leaning.reset(rotor_speed=SPEED, azimuth=azimuth)
        passing = (np.pi / 3.0 - azimuth) % (2.0 * np.pi / 3.0)  # of the next blade that comes to point down
        turned = 0.0
        while turned < passing:
            assert turned > passing - 0.1 or signals.tip_clearance_min.min() > 0.0
            before = signals.azimuth
            signals = leaning.advance(step, pitch=0.0, generator_torque=30e3)
            turned += (signals.azimuth - before) % (2.0 * np.pi)
        assert signals.tip_clearance_min.min() < -1.5
        unseen += signals.tip_clearance.min() > 0.0
    assert unseen >= 3  # what samples at control steps would have missed


def test_way_of_the_pitch_counts_what_happens_between_two_samples():
    """An ideal drive takes half a degree in the first of two time steps and stands at the sample."""
    sim = Simulator("nrel_5mw", inflow=SteadyInflow(12.0))
    sim.reset(rotor_speed=1.2, pitch=0.07)
    step = np.radians(0.5)
    for k, demand in enumerate((0.07 + step, 0.07, [0.07, 0.07 - step, 0.07])):
        signals = sim.advance(0.2, pitch=demand, generator_torque=40e3)
        np.testing.assert_allclose(signals.pitch_rate, 0.0, atol=1e-5)
        np.testing.assert_allclose(signals.pitch_travel, step if k < 2 else [0.0, step, 0.0], atol=1e-6)
    start = sim.state()
    there, back = sim.advance(0.1, 0.08, generator_torque=40e3), sim.advance(0.1, 0.07, generator_torque=40e3)
    sim.restore(start)
    sim.advance(0.1, 0.08, generator_torque=40e3)
    both = sim.advance(0.1, 0.07, generator_torque=40e3, accumulate=True)
    np.testing.assert_allclose(both.pitch_travel, there.pitch_travel + back.pitch_travel)
    np.testing.assert_array_equal(both.tip_clearance_min, np.minimum(there.tip_clearance_min, back.tip_clearance_min))
    assert both.rotor_speed_max == max(there.rotor_speed_max, back.rotor_speed_max)
    assert (both.time, both.rotor_speed) == (back.time, back.rotor_speed)


def test_an_interval_goes_on_from_a_snapshot_and_not_over_a_reset():
    sim = Simulator("nrel_5mw", inflow=SteadyInflow(12.0))
    sim.reset(rotor_speed=1.2, pitch=0.07)
    first = sim.advance(0.1, 0.08, generator_torque=40e3)
    amid = sim.state()
    whole = sim.advance(0.1, 0.09, generator_torque=40e3, accumulate=True)
    assert whole.pitch_travel.min() > first.pitch_travel.max()
    for _ in range(3):
        sim.advance(0.2, 0.12, generator_torque=40e3)
    sim.restore(amid)
    assert sim.advance(0.1, 0.09, generator_torque=40e3, accumulate=True) == whole
    sim.reset(rotor_speed=1.2, pitch=0.07)
    assert sim.advance(0.1, 0.08, generator_torque=40e3, accumulate=True) == first
