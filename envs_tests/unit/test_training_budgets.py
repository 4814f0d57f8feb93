"""Budgets of a training: multipliers against a known optimum, in records, and what is refused."""

import json
from dataclasses import asdict, replace

import gymnasium as gym
import numpy as np
import pytest
from gymnasium import spaces
from stable_baselines3.common.logger import Logger
from stable_baselines3.common.vec_env import DummyVecEnv, VecNormalize

from wt_gym.commands import parse as parse_command
from wt_gym.commands.train import configuration
from wt_gym.learning.environments import BudgetedVecEnv, BudgetUpdates
from wt_gym.learning.models import ArrayPPO
from wt_gym.learning.options import TrainingConfig
from wt_gym.learning.train import resume, train

BEST, ALLOWED = 0.8, 0.5
"""Of the problem below: the action that earns most, and the mean cost that is allowed."""
LIMITS = {"pitch_travel": 300.0, "rotor_speed": 1.02}
SMALL = TrainingConfig(
    env_id="wt_gym/NREL5MW-Steady-v1",
    env_kwargs={"wind_speed": 12.0, "episode_length": 5.0},
    hyperparameters={"n_steps": 32, "batch_size": 32, "n_epochs": 1},
    total_steps=64,
    n_envs=1,
    eval_every=0,
    tensorboard=False,
    budgets=LIMITS,
)


class Bandit(gym.Env):
    """One step: an action a earns -(a - BEST)^2 and costs (1 + a) / 2, so that a mean of ALLOWED wants a = 0.

    There a bit more action earns 2 BEST of reward and takes 1/2 of cost, that is 1 of the budget: the multiplier that
    balances them is 2 BEST.
    """

    observation_space = spaces.Box(-1.0, 1.0, (1,), np.float32)
    action_space = spaces.Box(-1.0, 1.0, (1,), np.float32)

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        return np.zeros(1, np.float32), {}

    def step(self, action):
        a = float(action[0])
        return np.zeros(1, np.float32), -((a - BEST) ** 2), True, False, {"costs": {"effort": 0.5 * (1.0 + a)}}


def test_the_multiplier_comes_to_that_of_the_constrained_optimum():
    budgeted = BudgetedVecEnv(DummyVecEnv([Bandit] * 4), {"effort": ALLOWED}, rate=0.2)
    budgeted.reset()
    budgeted.step(np.full((4, 1), -1.0))
    budgeted.update()
    assert (budgeted.spent, budgeted.multipliers) == ({"effort": 0.0}, {"effort": 0.0})  # what is left costs nothing
    model = ArrayPPO(
        "MlpPolicy", VecNormalize(budgeted, norm_obs=False, gamma=0.9), n_steps=64, batch_size=128, n_epochs=4,
        learning_rate=1e-2, gamma=0.9, seed=1, device="cpu", policy_kwargs={"net_arch": [8], "log_std_init": -1.5},
    )  # fmt: skip
    model.set_logger(Logger(None, []))
    updates = BudgetUpdates(budgeted)
    model.learn(20_000, callback=updates)
    action = model.predict(np.zeros((1, 1), np.float32), deterministic=True)[0]
    assert float(action[0, 0]) == pytest.approx(0.0, abs=0.1)
    multipliers = updates.curve["effort_multiplier"]
    assert np.mean(multipliers[len(multipliers) // 2 :]) == pytest.approx(2.0 * BEST, rel=0.1)


class Paid(gym.Env):
    """Pays 2 and costs what it is told, at every step."""

    observation_space = action_space = spaces.Box(-1.0, 1.0, (1,), np.float32)
    costs = {"a": 0.3, "b": 2.0}  # noqa: RUF012

    def reset(self, *, seed=None, options=None):
        return np.zeros(1, np.float32), {}

    def step(self, action):
        return np.zeros(1, np.float32), 2.0, False, False, {"costs": self.costs}


def test_rewards_keep_their_size_and_multipliers_move_by_bounded_steps():
    venv = BudgetedVecEnv(DummyVecEnv([Paid] * 2), {"a": 0.1, "b": 4.0}, rate=0.5)
    venv.reset()
    action = np.zeros((2, 1), np.float32)
    venv.update()  # nothing was seen
    assert venv.multipliers == {"a": 0.0, "b": 0.0}
    np.testing.assert_array_equal(venv.step(action)[1], [2.0, 2.0])
    venv.update()
    assert venv.spent == pytest.approx({"a": 3.0, "b": 0.5})
    assert venv.multipliers == pytest.approx({"a": 0.5 * 2.0 / 4.0, "b": 0.0})
    np.testing.assert_allclose(venv.step(action)[1], [(2.0 - 0.25 * 3.0) / 1.25] * 2, rtol=1e-6)


def test_multipliers_are_in_the_record_and_continue(tmp_path):
    first = train(SMALL, tmp_path, progress=False)
    budgets = first["budgets"]
    assert budgets["limits"] == first["environment"]["cost_limits"] == LIMITS
    assert budgets["allowed"] == {"pitch_travel": 1.0, "rotor_speed": 1e-3}
    assert budgets["curve"]["steps"] == [32, 64]
    assert budgets["curve"]["pitch_travel_multiplier"][-1] == budgets["multipliers"]["pitch_travel"] > 0.0
    second = resume(tmp_path, total_steps=96, progress=False)["budgets"]
    assert second["curve"]["steps"] == [32, 64, 96]
    assert second["curve"]["pitch_travel_multiplier"][:2] == budgets["curve"]["pitch_travel_multiplier"]
    step = second["multipliers"]["pitch_travel"] - budgets["multipliers"]["pitch_travel"]
    assert step == pytest.approx(0.05 * (second["spent"]["pitch_travel"] - 1) / (second["spent"]["pitch_travel"] + 1))
    path = tmp_path / "training.json"
    record = json.loads(path.read_text())
    record["budgets"]["multipliers"]["pitch_travel"] = "much"
    path.write_text(json.dumps(record))
    with pytest.raises(ValueError, match="its budgets must have multipliers of pitch_travel, rotor_speed"):
        resume(tmp_path, total_steps=128, progress=False)


def test_the_command_takes_budgets(tmp_path):
    config = configuration(parse_command("train", ["--budget", "pitch_travel=300", "rotor_speed=1.1"]))
    assert config.budgets == config.env_kwargs["cost_limits"] == {"pitch_travel": 300.0, "rotor_speed": 1.1}
    file = tmp_path / "mine.yml"
    file.write_text("budget: {pitch_travel: 300, rotor_speed: 1.1}\n")
    assert configuration(parse_command("train", ["--config", str(file)])) == config
    typed = ["--config", str(file), "--budget", "rotor_speed=1.2"]  # changes the limit that it names
    assert configuration(parse_command("train", typed)).budgets == {"pitch_travel": 300.0, "rotor_speed": 1.2}
    assert TrainingConfig.from_dict(json.loads(json.dumps(asdict(config)))) == config
    for word in ("pitch_travel", "pitch_travel=much", "=3"):
        with pytest.raises((SystemExit, ValueError), match=r"2|budgets must be numbers by name"):
            configuration(parse_command("train", ["--budget", word]))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"algorithm": "SAC", "hyperparameters": {}}, "except with the algorithm PPO, got 'SAC'"),
        ({"budgets": {"pitch_travel": 1.0}}, "cost_limits must be the budgets or left out"),
    ],
)
def test_budgets_without_meaning_are_refused(changes, message):
    with pytest.raises(ValueError, match=message):
        replace(SMALL, **changes)
