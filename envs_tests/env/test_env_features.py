"""Every feature of the environment: seeds repeat it, snapshots, copies and vectors carry it, and off it is refused."""

import copy
import pickle
from pathlib import Path

import numpy as np
import pytest

from wt_gym.base.files import read_toml
from wt_gym.envs.episode_start import FEATURE_OPTIONS
from wt_gym.envs.turbine_env import WindTurbineEnv
from wt_gym.envs.vector_env import WindTurbineVectorEnv

PLAIN, FEATURES = read_toml(Path(__file__).with_name("data") / "features.toml").values()


@pytest.fixture(params=FEATURES)
def arguments(request, scripted):
    return PLAIN | FEATURES[request.param]


def play(env, steps=20, actions=0):
    """Results of steps under drawn actions."""
    rng = np.random.default_rng(actions)
    return [env.step(rng.uniform(-1.0, 1.0, env.action_space.shape)) for _ in range(steps)]


def test_a_seed_repeats_an_episode_and_another_one_does_not(arguments):
    env = WindTurbineEnv(**arguments)
    first = env.reset(seed=3), play(env)
    others = [env.reset(seed=seed)[0] for seed in (4, 5, 6, 7)]
    np.testing.assert_equal((env.reset(seed=3), play(env)), first)
    assert any(not np.array_equal(observation, first[0][0]) for observation in others)


def test_a_snapshot_continues_and_so_does_the_next_reset(arguments):
    env = WindTurbineEnv(**arguments)
    env.reset(seed=3)
    play(env, 5)
    snapshot = env.snapshot()
    course = play(env, 15, actions=1), env.reset()
    play(env, 5)
    env.restore(snapshot)
    np.testing.assert_equal((play(env, 15, actions=1), env.reset()), course)


@pytest.mark.parametrize("copied", [copy.deepcopy, lambda env: pickle.loads(pickle.dumps(env))], ids=["copy", "pickle"])
def test_a_copy_continues(arguments, copied):
    env = WindTurbineEnv(**arguments)
    env.reset(seed=3)
    play(env, 5)
    other = copied(env)
    np.testing.assert_equal((play(other, actions=1), other.reset()), (play(env, actions=1), env.reset()))


def test_a_vector_is_single_environments(arguments):
    vector, singles = WindTurbineVectorEnv(2, **arguments), [WindTurbineEnv(**arguments) for _ in range(2)]
    observations = [vector.reset(seed=7)[0]]
    starts = [env.reset(seed=7 + k)[0] for k, env in enumerate(singles)]
    rewards, rng = [], np.random.default_rng(0)
    for _ in range(10):
        actions = rng.uniform(-1.0, 1.0, vector.action_space.shape)
        observation, reward, *_ = vector.step(actions)
        results = [env.step(action) for env, action in zip(singles, actions, strict=True)]
        observations.append(observation)
        rewards.append(reward)
        np.testing.assert_array_equal(observation, [one[0] for one in results])
        np.testing.assert_array_equal(reward, [one[1] for one in results])
    np.testing.assert_array_equal(observations[0], starts)
    vector.close()


def test_starts_by_number_repeat_and_resting_is_the_controller_alone(arguments):
    env = WindTurbineEnv(**arguments | {"relative_reward": True, "starts": 3})
    starts = []
    for number in (0, 1, 0):
        observation, info = env.reset(seed=number, options={"start_number": number})
        starts.append((observation, info["wind_speed"], info.get("variation"), info.get("fault")))
        assert [env.step(np.zeros(env.action_space.shape))[1] for _ in range(20)] == [0.0] * 20
    np.testing.assert_equal(starts[0], starts[2])
    assert starts[0][1:] != starts[1][1:]


@pytest.mark.parametrize("option", FEATURE_OPTIONS)
def test_an_option_of_a_feature_that_is_off_is_refused(option):
    with pytest.raises(ValueError, match=f"{option} must be left out of a reset without {FEATURE_OPTIONS[option]}"):
        WindTurbineEnv(**PLAIN).reset(seed=0, options={option: "none"})
