"""What a reset can be told beside the wind of an environment: an inflow and faults, for one episode."""

import gymnasium as gym
import numpy as np
import pytest
from turbine_contract import PLAIN

from wt_gym.base.errors import ActionError, InflowError
from wt_gym.simulation.drivetrain.faults import GeneratorLoss, StuckPitch
from wt_gym.wind import SteadyInflow, TransientInflow, TurbulenceBox

WIND = {"wind_speed": 14.0, "wind_seed": 1001, "azimuth": 0.0}


@pytest.fixture(scope="module")
def env():
    made = gym.make("wt_gym/LoadReduction-v3", **PLAIN)
    yield made
    made.close()


def episode(env, steps=15, **options):
    """Observations and true rotor speeds."""
    seen = [env.reset(seed=5, options={**WIND, **options})[0]]
    speeds = []
    for _ in range(steps):
        seen.append(env.step(np.zeros(env.action_space.shape, np.float32))[0])
        speeds.append(env.unwrapped.signals["rotor_speed"])
    return np.array(seen), np.array(speeds)


def test_faults_hold_for_one_episode_and_change_nothing_before_they_begin(env):
    sound, _ = episode(env)
    failed, _ = episode(env, faults=(GeneratorLoss(1.0), StuckPitch(1.4, 1)))
    assert env.unwrapped.signals["generator_torque"] == 0.0
    np.testing.assert_array_equal(failed[:6], sound[:6])
    assert not np.array_equal(failed[6], sound[6])
    again, _ = episode(env)
    np.testing.assert_array_equal(again, sound)


def test_an_inflow_takes_the_place_of_the_wind_for_one_episode(env):
    gust = TransientInflow.ecd(11.4, 90.0, 126.0)
    _, info = env.reset(seed=1, options={"inflow": gust})
    assert (info["wind_speed"], info["wind_seed"]) == (11.4, -1)
    assert env.unwrapped.episode_wind.inflow is gust
    _, info = env.reset(seed=1, options=WIND)
    assert info["wind_seed"] == 1001


@pytest.mark.parametrize(
    ("options", "kind", "message"),
    [
        ({"inflow": SteadyInflow(8.0, 90.0), "wind_seed": 1}, InflowError, "a given inflow has wind_seed already"),
        ({"faults": [StuckPitch(1.0, 7)]}, ActionError, "blade 7"),
        ({"faults": "all"}, ActionError, "a fault is"),
    ],
)
def test_wrong_options_are_refused(env, options, kind, message):
    with pytest.raises(kind, match=message):
        env.reset(options=options)


def test_environments_have_the_turbulence_of_mann(monkeypatch):
    full = TurbulenceBox.mann
    monkeypatch.setattr(TurbulenceBox, "mann", lambda *a, **options: full(*a, **options, grid=(3, 3), cache=False))
    with gym.make("wt_gym/NREL5MW-Turbulent-v1", turbulence="mann", wind_speed=12.0) as env:
        env.reset(seed=0, options={"wind_seed": 3})
        assert "Mann NTM class" in env.unwrapped.episode_wind.inflow.description
