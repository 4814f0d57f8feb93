"""Planning by snapshots: the environment is left as it was found, and the plan is no worse than doing nothing."""

import copy
import re
from collections import deque
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest
from turbine_contract import PLAIN

from wt_gym.experiment.agents import ShootingPlanner

SMALL = {"horizon": 0.8, "hold": 0.4, "samples": 3, "elites": 2, "rounds": 2}


@pytest.fixture(scope="module")
def env():
    env = gym.make("wt_gym/LoadReduction-v3", wind_speed=15.0, sensor_noise=1.0, **PLAIN)
    yield env
    env.close()


def same(first, second):
    """Whether two snapshots hold the same numbers, objects by what they remember."""
    if isinstance(first, np.ndarray):
        return np.array_equal(first, second, equal_nan=True)
    if isinstance(first, dict):
        return first.keys() == second.keys() and all(same(first[key], second[key]) for key in first)
    if isinstance(first, list | tuple | deque):
        return len(first) == len(second) and all(map(same, first, second))
    if hasattr(first, "arrays") or isinstance(first, float) or not hasattr(first, "__dict__"):
        return first == second or (first != first and second != second)
    return type(first) is type(second) and same(vars(first), vars(second))


def test_the_environment_is_left_as_it_was_found(env):
    observation, _ = env.reset(seed=4)  # in whose wind the planner finds more than to rest
    planner = ShootingPlanner(env, **SMALL)
    for _ in range(2):
        observation, *_ = env.step(planner.predict(observation)[0])
    raw, planner = env.unwrapped, ShootingPlanner(env, **SMALL)
    before = copy.deepcopy(raw.snapshot())
    action, _ = planner.predict(observation)
    assert np.any(action != 0.0)
    assert same(vars(before), vars(raw.snapshot()))
    after = env.step(action)
    raw.restore(before)
    again = env.step(action)
    np.testing.assert_array_equal(after[0], again[0])
    assert after[1] == again[1]
    assert not same(vars(before), vars(raw.snapshot()))


def test_a_plan_is_no_worse_than_the_controller_alone(env):
    def earned(agent):
        observation, _ = env.reset(seed=5)
        total = 0.0
        for _ in range(4):
            observation, reward, *_ = env.step(agent(observation))
            total += reward
        return total

    planner = ShootingPlanner(env, **SMALL)  # its horizon is these four steps, of which it does two and plans anew
    assert earned(lambda observation: planner.predict(observation)[0]) >= earned(lambda _: np.zeros(3))


def test_actions_are_held_and_the_same_again(env):
    observation, _ = env.reset(seed=1)
    planner = ShootingPlanner(env, **SMALL)
    first = []
    for start in (True, False, False):
        action, _ = planner.predict(observation, episode_start=[start])
        first.append(action)
        env.step(action)
    np.testing.assert_array_equal(first[0], first[1])
    assert np.any(first[1] != first[2])
    env.reset(seed=1)
    np.testing.assert_array_equal(planner.predict(observation, episode_start=[True])[0], first[0])


def test_plans_end_with_the_episode():
    env = gym.make("wt_gym/LoadReduction-v3", wind_speed=15.0, episode_length=0.4, **PLAIN)
    observation, _ = env.reset(seed=0)
    planner = ShootingPlanner(env, **SMALL)
    for truncated in (False, True):
        observation, *_, ended, _ = env.step(planner.predict(observation)[0])
        assert ended is truncated
    env.close()


def test_the_example_of_the_page_runs():
    page = (Path(__file__).resolve().parents[2] / "docs" / "benchmark.md").read_text(encoding="utf-8")
    (example,) = (x for x in re.findall(r"^```python\n(.*?)^```", page, re.MULTILINE | re.DOTALL) if "Planner" in x)
    names = {}
    exec(compile(example, "docs/benchmark.md", "exec"), names)
    assert names["info"]["time"] == pytest.approx(1.6)


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"hold": 3.0}, "horizon of a planner must be 1 to 1000 times hold"),
        ({"elites": 12, "samples": 6}, "elites must be at most samples, got 12 of 6"),
    ],
)
def test_settings_without_meaning_are_refused(env, wrong, message):
    with pytest.raises(ValueError, match=message):
        ShootingPlanner(env, **wrong)
