"""Controllers in the coupled simulator: loads fall, the estimated wind is the wind."""

import math
from dataclasses import replace

import numpy as np
import pytest

from wt_gym.analysis.results import Wind
from wt_gym.control import Demand
from wt_gym.control.controllers import IndividualPitch, make_controller
from wt_gym.control.sensors import from_harmonic, to_harmonic
from wt_gym.experiment.comparison import ComparisonConfig, run_cases
from wt_gym.experiment.run import run_controller
from wt_gym.simulation import Simulator
from wt_gym.wind import SteadyInflow

SEED = 1


@pytest.fixture(scope="module")
def loads(turbine):
    """Metrics at 16 m/s over 100 s by controller."""
    names = ("discon", "ipc", "tower_dampers")
    config = ComparisonConfig(duration=100.0, skip=20.0)
    runs = run_cases(turbine, {name: (name, {}) for name in names}, [Wind(16.0, SEED)], config)
    return {run.name: run.metrics[Wind(16.0, SEED)] for run in runs}


def test_individual_pitch_lowers_the_flap_load(loads):
    assert loads["ipc"]["blade_flap_del"] < 0.85 * loads["discon"]["blade_flap_del"]
    assert loads["ipc"]["mean_power"] == pytest.approx(loads["discon"]["mean_power"], rel=2e-3)


@pytest.mark.parametrize("frequency", [None, 4.0 * math.pi])
def test_individual_pitch_arrives_at_its_azimuth(turbine, frequency):
    """Against a moment in tilt the blades pitch in tilt, seen from the fixed frame when they have done so."""
    turbine = replace(turbine, pitch=replace(turbine.pitch, servo_frequency=frequency))
    addition = IndividualPitch(turbine, bandwidth=1.0, limit=0.03, rate_limit=0.06, fade=False)
    simulator = Simulator(turbine, SteadyInflow(14.0, turbine.hub_height))
    signals = simulator.reset(rotor_speed=1.25, pitch=0.15)
    addition.start(signals)
    for k in range(40):
        moments = from_harmonic(1e7, 0.0, signals["azimuth"])
        seen = {"azimuth": signals["azimuth"], "rotor_speed": signals["rotor_speed"]}
        seen |= {f"root_flap_moment_{b}": moment for b, moment in enumerate(moments, start=1)}
        demand = addition.step(seen, simulator.time_step, Demand(np.full(3, 0.15), 0.0, 43e3))
        signals = simulator.advance(simulator.time_step, pitch=demand.pitch, generator_torque=demand.generator_torque)
        tilt, yaw = to_harmonic(signals.pitch, signals["azimuth"])
        if k > 20:
            assert np.hypot(tilt, yaw) == pytest.approx(0.03, rel=0.03)
            assert abs(np.degrees(np.arctan2(yaw, tilt))) < 0.5


def test_side_side_damper_lowers_the_tower_load(loads):
    assert loads["tower_dampers"]["tower_side_side_del"] < 0.8 * loads["discon"]["tower_side_side_del"]
    assert loads["tower_dampers"]["mean_power"] == pytest.approx(loads["discon"]["mean_power"], rel=2e-3)


def test_fore_aft_damper_adds_the_damping_of_its_rule(turbine):
    # free decay after a push by a gust: the amplitude left after a few periods tells the damping
    simulator = Simulator(turbine, SteadyInflow(16.0, turbine.hub_height))
    left = {}
    for name, parameters in (("discon", {}), ("fore_aft_damper", {"damping": 0.05})):
        simulator.inflow = SteadyInflow(16.0, turbine.hub_height)
        controller = make_controller(name, turbine, **parameters)
        run_controller(simulator, controller, 20.0)
        rows = []
        for k in range(150):
            wind = 18.0 if k < 15 else 16.0
            simulator.inflow = SteadyInflow(wind, turbine.hub_height)
            demand = controller.step(simulator.signals, 0.1)
            signals = simulator.advance(0.1, pitch=demand.pitch, generator_torque=demand.generator_torque)
            rows.append(signals["nacelle_acceleration_fore_aft"])
        left[name] = np.std(rows[60:])
    assert left["fore_aft_damper"] < 0.8 * left["discon"]
