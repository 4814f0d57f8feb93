"""What every turbine's environments keep, for the tests of single turbines."""

import warnings

import gymnasium as gym
import numpy as np
from gymnasium.utils.env_checker import check_env
from stable_baselines3.common.env_checker import check_env as sb3_check_env

PLAIN = {
    "control_dt": 0.2, "observation": None, "sensor_washout": None, "residual_washout": None, "relative_reward": False,
    "reward_credit": False, "starts": None, "termination_penalty": 120.0,
}  # fmt: skip
"""Arguments that give a task of load reduction the step, the observation and the reward of environments without one."""


def both_checkers_are_content(env_id, **kwargs):
    """The checkers of Gymnasium and stable-baselines3 have nothing to say, not even a warning."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        env = gym.make(env_id, **kwargs)
        check_env(env.unwrapped, skip_render_check=True)
        sb3_check_env(env)


def snapshot_repeats(env):
    """An environment goes on from a snapshot bit for bit."""
    env.reset(seed=3)
    actions = np.random.default_rng(0).uniform(-0.3, 0.3, (6, *env.action_space.shape))
    for action in actions[:3]:
        env.step(action)
    kept = env.snapshot()
    first = [env.step(action)[:2] for action in actions]
    env.restore(kept)
    again = [env.step(action)[:2] for action in actions]
    for (a, r), (b, s) in zip(first, again, strict=True):
        np.testing.assert_array_equal(a, b)
        assert r == s


def random_episode(env):
    """An episode of random actions without failure; returns whether it was truncated."""
    env.action_space.seed(7)
    env.reset(seed=2)
    over = False
    while not over:
        observation, reward, terminated, truncated, info = env.step(env.action_space.sample())
        assert np.isfinite(observation).all()
        assert np.isfinite(reward)
        over = terminated or truncated
    assert info.get("termination") != "failure"
    return truncated
