"""Credit: an action is paid its own effects, and the return of an episode stays."""

import gymnasium as gym
import numpy as np
import pytest

from wt_gym.envs import WindTurbineEnv
from wt_gym.envs.credit import held_responses, without_mean
from wt_gym.envs.fatigue import BladeFatigue
from wt_gym.envs.terms import HighPass
from wt_gym.learning.recording import respond
from wt_gym.tasks import TASKS

pytestmark = pytest.mark.usefixtures("scripted")
TASK = TASKS["LoadReduction"]
STEPS = 40


def rewards(actions, **changes):
    """Rewards and terms of steps of one episode of a task."""
    env = gym.make(TASK.id, start="steady", starts=None, wind_speed=15.0, **changes)
    env.reset(seed=3)
    steps = [env.step(action)[1:] for action in actions]
    env.close()
    return np.array([step[0] for step in steps]), [step[-1]["reward_terms"] for step in steps]


def drawn():
    actions = np.random.default_rng(0).uniform(-0.5, 0.5, (STEPS, 3)).astype(np.float32)
    actions[STEPS // 2 :] = 0.0
    return actions


def test_the_return_changes_by_the_effects_to_come_alone():
    with_credit, terms = rewards(drawn())
    without, plain = rewards(drawn(), reward_credit=False)
    paid = [term.pop("credit") for term in terms]
    assert terms == plain
    np.testing.assert_allclose(with_credit, without + paid, rtol=1e-12)
    assert np.abs(paid).max() > 0.01
    # 4 s after the last offset most of what was paid ahead has come
    assert abs(sum(paid)) < 0.5 * np.abs(np.cumsum(paid)).max()


@pytest.mark.parametrize("changes", [{"dial_weights": "simplex"}, {"reward": [BladeFatigue(), BladeFatigue(name="b")]}])
def test_weights_that_are_not_fixed_are_refused(changes):
    with pytest.raises(ValueError, match=r"at most one fatigue term of a kind|must be False with dial_weights"):
        gym.make(TASK.id, **changes)


def test_without_actions_nothing_is_paid():
    found, terms = rewards(np.zeros((STEPS, 3), np.float32))
    assert not found.any()
    assert not any(term["credit"] for term in terms)


def test_an_early_end_takes_back_what_was_paid():
    env = WindTurbineEnv(**{**TASK.arguments, "start": "steady", "starts": None, "wind_speed": 15.0})
    env.reset(seed=3)
    paid = [env.step(action)[-1]["reward_terms"]["credit"] for action in drawn()[:5]]
    env.limits.overspeed = 0.1
    *_, terminated, _, info = env.step(np.zeros(3, np.float32))
    assert terminated
    assert sum(paid) != 0.0
    assert info["reward_terms"]["credit"] == pytest.approx(-sum(paid), rel=1e-12)


def test_a_snapshot_keeps_what_was_paid_ahead():
    env = WindTurbineEnv(**{**TASK.arguments, "start": "steady", "starts": None, "wind_speed": 15.0})
    env.reset(seed=3)
    actions = drawn()
    for action in actions[:5]:
        env.step(action)
    snapshot = env.snapshot()
    first = [env.step(action)[1] for action in actions[5:15]]
    env.restore(snapshot)
    assert [env.step(action)[1] for action in actions[5:15]] == first


def test_responses_to_held_offsets_are_sums_of_those_to_samples():
    rng = np.random.default_rng(1)
    responses = rng.normal(size=(2, 3, 20))
    levels = rng.normal(size=(3, 6))
    fine = respond(responses, np.repeat(levels, 4, axis=1))[:, 4::4]
    coarse = respond(held_responses(responses, 4, 6), levels)[:, 1:]
    np.testing.assert_allclose(coarse, fine, rtol=1e-12, atol=1e-12)


def test_series_without_mean_are_those_of_the_filter_of_the_reward():
    series = np.random.default_rng(2).normal(size=50)
    high_pass = HighPass(10.0, 0.0)
    np.testing.assert_allclose(without_mean(series, 0.2, 10.0), [high_pass(x, 0.2) for x in series], rtol=1e-12)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"relative_reward": False}, "reward_credit must come with relative_reward=True"),
        ({"controller": "discon", "observation": ["rotor"]}, "credit needs a base controller with an observer"),
    ],
)
def test_what_credit_needs_is_said(changes, message):
    with pytest.raises(ValueError, match=message):
        gym.make(TASK.id, **changes)
