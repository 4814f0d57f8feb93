"""The small turbine of Nada & Al-Shahrani 2019 as an environment: contract, snapshot, random actions, test speed."""

import gymnasium as gym
import numpy as np
import pytest
from turbine_contract import both_checkers_are_content, random_episode, snapshot_repeats

from wt_gym.simulation import Simulator
from wt_gym.wind import SteadyInflow

IDS = ("wt_gym/NadaSmall-Steady-v1", "wt_gym/NadaSmall-Turbulent-v1")


@pytest.mark.parametrize("env_id", [pytest.param(IDS[0], marks=pytest.mark.slow), IDS[1]])
def test_random_actions_do_not_break_an_episode(env_id):
    random_episode(gym.make(env_id).unwrapped)


@pytest.mark.slow
def test_mixed_coordinates_keep_the_contract():
    both_checkers_are_content(IDS[1], fidelity="mixed")


def test_mixed_coordinates_continue_bit_for_bit():
    env = gym.make(IDS[1], fidelity="mixed", wind_speed=8.0, sensor_noise=1.0).unwrapped
    snapshot_repeats(env)
    assert len(env.simulator.structure.system.quaternions) == 3  # it is the mixed form that went on


def test_mixed_coordinates():
    """Five tower modes, four nodes of a blade with four degrees of freedom, three frames with Euler parameters."""
    simulator = Simulator("nada_small", SteadyInflow(8.0, 0.6, 0.0), "mixed", generator="damper")
    structure = simulator.structure
    system, blade = structure.system, structure.system.bodies[structure.blades[0]]
    assert len(system.quaternions) == 3
    assert system.n_constraints == 18
    assert len(system.bodies[structure.tower].coordinate_names) == 5
    assert len(blade.coordinate_names) == 16
    assert not system.bodies[structure.nacelle].coordinate_names
    assert not system.bodies[structure.hub].coordinate_names


def test_the_damper_holds_the_speed_of_the_test():
    """The damper meets the air within 3 % at 160 rad/s and 8 m/s: Ω stays, and tip deflection and tower lean small."""
    simulator = Simulator("nada_small", SteadyInflow(8.0, 0.6, 0.0), generator="damper")
    signals = simulator.reset(rotor_speed=160.0)
    for _ in range(20):
        signals = simulator.advance(23 * simulator.time_step, pitch=0.0)
    assert signals["rotor_speed"] == pytest.approx(160.0, rel=0.03)
    # thrust L³/3EI of the rod: the mean lean of the tower
    assert signals["tower_top_fore_aft"] == pytest.approx(
        signals["aero_thrust"] * 0.6**3 / (3.0 * 1.17e11 * np.pi * 0.01**4 / 64.0), rel=0.1
    )
