"""The environment keeps the contract of Gymnasium and stable-baselines3, on the real simulator."""

import re
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.error import ResetNeeded
from matplotlib import pyplot as plt
from matplotlib.backend_bases import FigureManagerBase
from matplotlib.backends.backend_agg import FigureCanvasAgg
from turbine_contract import random_episode, snapshot_repeats

from wt_gym.base.errors import ActionError, InflowError, SimulationError

IDS = ("wt_gym/NREL5MW-Steady-v1", "wt_gym/NREL5MW-Turbulent-v1")


@pytest.fixture(scope="module")
def env():
    env = gym.make("wt_gym/NREL5MW-Turbulent-v1", wind_speed=13.0)
    yield env
    env.close()


def rollout(env, actions, seed, **options):
    """Observations, rewards and infos of an episode; stops where it ends."""
    observation, info = env.reset(seed=seed, options=options or None)
    observations, rewards, infos = [observation], [], [info]
    for action in actions:
        observation, reward, terminated, truncated, info = env.step(action)
        observations.append(observation)
        rewards.append(reward)
        infos.append(info)
        if terminated or truncated:
            break
    return np.array(observations), np.array(rewards), infos


def test_blades_that_twist_keep_the_contract():
    env = gym.make("wt_gym/IEA15MW-Steady-v2", max_episode_steps=100)
    snapshot_repeats(env.unwrapped)
    assert random_episode(env)


def test_blades_that_twist_in_fine_steps():
    """IEA 15-MW at "engineering-torsion": its tips turn by degrees towards feather."""
    env = gym.make("wt_gym/IEA15MW-Turbulent-v2", fidelity="engineering-torsion", wind_speed=9.0)
    observations, rewards, _ = rollout(env, np.zeros((10, 3), dtype=np.float32), seed=1)
    assert np.isfinite(observations).all()
    assert np.isfinite(rewards).all()
    simulator = env.unwrapped.simulator
    structure, state = simulator.structure, simulator.coupling.integrator.state
    for number, blade in enumerate(structure.blades, 1):
        body, (coordinates, rates) = structure.system.bodies[blade], structure.elastic(blade, state)
        twist = np.degrees(body.markers["tip"].rotation[2] @ coordinates)
        assert -8.0 < twist < -1.0  # about minus z, as pitch feathers; 1e-16 in modes that only bend
        torsion = body.coordinate_names.index(f"blade_{number}_torsion_1")
        assert abs(coordinates[torsion]) > 0.1
        assert rates[torsion] != 0.0


def test_a_used_environment_repeats_a_fresh_one(env):
    actions = np.zeros((10, 3), dtype=np.float32)
    rollout(env, actions, seed=5)
    rollout(env, np.ones((25, 3), dtype=np.float32), seed=6)
    again = rollout(env, actions, seed=5)
    fresh = rollout(gym.make("wt_gym/NREL5MW-Turbulent-v1", wind_speed=13.0), actions, seed=5)
    np.testing.assert_equal(again, fresh)


@pytest.mark.parametrize("bad", [[np.nan, 0, 0], [0, np.inf, 0], [0, 0, 1.5], [0, 0], np.zeros((1, 3))])
def test_a_refused_action_leaves_everything_as_it_was(env, bad):
    raw = env.unwrapped
    raw.reset(seed=4)
    raw.step(np.array([0.2, 0.0, -0.1]))
    before, demand = raw.simulator.state(), raw.demand
    with pytest.raises(ActionError):
        raw.step(bad)
    assert raw.simulator.state() == before
    assert raw.demand is demand
    raw.step(np.zeros(3))


def test_objects_are_fresh_every_step(env):
    observation, info = env.reset(seed=0)
    kept = observation.copy()
    next_observation, _, _, _, next_info = env.step(np.ones(3, dtype=np.float32))
    assert next_observation is not observation
    assert next_info is not info
    assert np.array_equal(observation, kept)
    action = np.zeros(3, dtype=np.float32)
    env.step(action)
    action[:] = 1.0
    assert np.array_equal(env.unwrapped._action, np.zeros(3))


def test_reset_options_fix_the_start(env):
    _, info = env.reset(options={"wind_speed": 9.0, "wind_seed": 77, "rotor_speed": 1.0, "pitch": 0.05, "azimuth": 2.0})
    signals = env.unwrapped.signals
    assert (info["wind_speed"], info["wind_seed"]) == (9.0, 77)
    assert signals["rotor_speed"] == pytest.approx(1.0, rel=1e-6)
    assert signals["azimuth"] == pytest.approx(2.0, abs=0.01)  # the shaft is twisted by its torque
    assert signals["pitch_1"] == pytest.approx(0.05, abs=2e-3)
    with pytest.raises(ValueError, match="no option 'wind'; did you mean"):
        env.reset(options={"wind": 9.0})
    with pytest.raises(InflowError, match="and 50 m/s"):
        env.reset(options={"wind_speed": 60.0})


def test_a_refused_reset_leaves_no_episode_running(env):
    env.reset(seed=0)
    with pytest.raises((ValueError, SimulationError), match="rotor_speed"):
        env.reset(options={"wind_speed": 20.0, "rotor_speed": np.nan})
    with pytest.raises(ResetNeeded):
        env.unwrapped.step(np.zeros(3))
    env.reset(seed=0)
    env.step(np.zeros(3, dtype=np.float32))


def test_longest_rates_reach_the_limits_and_stay_there():
    env = gym.make(IDS[0], wind_speed=12.0, standstill_limit=0.0, episode_length=20.0)
    env.reset(seed=0)
    for _ in range(70):  # 90 deg at 8 deg/s take 56 steps
        _, _, terminated, _, _ = env.step(np.array([1.0, 0.0, -1.0], dtype=np.float32))
        assert not terminated
    turbine = env.unwrapped.turbine
    assert env.unwrapped.demand.pitch[0] == turbine.pitch.max_pitch
    assert env.unwrapped.signals["pitch_1"] == pytest.approx(turbine.pitch.max_pitch, abs=0.02)
    assert env.unwrapped.signals["generator_torque"] == 0.0


def test_a_live_view_is_a_window_or_without_a_display_a_file(monkeypatch):
    plt.switch_backend("agg")
    arguments = {"render_mode": "human", "wind_speed": 10.0, "control_dt": 0.4, "start": "steady"}
    with pytest.warns(UserWarning, match="there is no display") as told:
        env = gym.make(IDS[0], disable_env_checker=True, **arguments)
    path = Path(re.search(r"\S+\.png", str(told[0].message))[0])
    env.reset(seed=0)
    before = plt.imread(path)
    assert before.shape[:2] == (540, 960)
    env.step(env.action_space.sample())
    assert (plt.imread(path) != before).any()  # the rotor has turned
    assert env.render() is None
    env.close()
    assert not path.exists()
    shown, drawn = [], []
    monkeypatch.setattr(FigureCanvasAgg, "required_interactive_framework", "tk")
    monkeypatch.setattr(FigureManagerBase, "show", lambda _: shown.append(True))
    monkeypatch.setattr(FigureCanvasAgg, "flush_events", lambda canvas: drawn.append(np.array(canvas.buffer_rgba())))
    env = gym.make(IDS[0], disable_env_checker=True, **arguments)
    env.reset(seed=0)
    env.step(env.action_space.sample())
    env.close()
    assert (len(shown), len(drawn)) == (1, 2)
    assert (drawn[0] != drawn[1]).any()
    assert plt.get_fignums() == []


def test_render_gives_a_picture():
    env = gym.make(IDS[0], render_mode="rgb_array", wind_speed=10.0, control_dt=0.4)
    env.reset(seed=0)
    env.step(np.zeros(3, dtype=np.float32))
    picture = env.render()
    assert picture.dtype == np.uint8
    assert picture.shape == (540, 960, 3)
    assert picture.std() > 10
    assert env.metadata["render_fps"] == 2
