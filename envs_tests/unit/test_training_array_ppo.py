"""PPO with NumPy beside that of stable-baselines3: samples, rollouts, updates, files."""

import gymnasium as gym
import numpy as np
import pytest
import torch
from gymnasium import spaces
from stable_baselines3 import PPO
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.logger import Logger
from stable_baselines3.common.vec_env import DummyVecEnv, VecNormalize

from wt_gym.experiment.policy_arrays import PolicyArrays
from wt_gym.learning.models import ArrayPPO


class Pushed(gym.Env):
    """A point that is pushed about; episodes end at its bounds, or are cut off."""

    observation_space = spaces.Box(-5.0, 5.0, (3,), np.float32)
    action_space = spaces.Box(-0.5, 1.0, (2,), np.float32)

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.x, self.steps = self.np_random.normal(size=3), 0
        return self.x.astype(np.float32), {}

    def step(self, action):
        assert self.action_space.contains(action)
        self.x = 0.9 * self.x + np.array([*action, action.sum()]) + 0.2 * self.np_random.normal(size=3)
        self.steps += 1
        out = bool(np.abs(self.x).max() > 3.0)
        return self.x.astype(np.float32), -float(self.x @ self.x), out, self.steps == 13 and not out, {}


def model(cls, n_envs=3, normalized=True, **more):
    venv = DummyVecEnv([Pushed] * n_envs)
    settings = {"n_steps": 64, "batch_size": 48, "n_epochs": 3, "learning_rate": 1e-2, "seed": 4, "device": "cpu"}
    policy = {"net_arch": [16, 8], "log_std_init": -0.4} | more.pop("policy_kwargs", {})
    made = cls("MlpPolicy", VecNormalize(venv) if normalized else venv, policy_kwargs=policy, **settings | more)
    made.set_logger(Logger(None, []))
    return made


class Rollouts(BaseCallback):
    """Keeps what the first rollout gathered, and how many figures the callbacks saw."""

    def _on_training_start(self):
        self.kept, self.seen = None, []

    def _on_step(self):
        self.seen.append((self.num_timesteps, len(self.locals["infos"]), self.locals["new_obs"].shape))
        return True

    def _on_rollout_end(self):
        buffer = self.locals["rollout_buffer"]
        names = ("observations", "actions", "rewards", "episode_starts", "values", "log_probs", "advantages", "returns")
        self.kept = self.kept or {name: getattr(buffer, name).copy() for name in names}


@pytest.mark.parametrize(
    "settings",
    [
        {},
        # the last minibatch is shorter
        {"n_envs": 1, "normalized": False, "batch_size": 50, "policy_kwargs": {"activation_fn": torch.nn.ReLU}},
        {"ent_coef": 0.01, "vf_coef": 0.8, "max_grad_norm": 0.05, "policy_kwargs": {"activation_fn": torch.nn.ELU}},
        {"target_kl": 0.004, "clip_range": 0.05, "normalize_advantage": False},
    ],
)
def test_a_training_is_that_of_stable_baselines(settings):
    """Three rollouts and updates: what was gathered, what callbacks saw, parameters, optimizer and figures."""
    models, watched = [model(cls, **settings) for cls in (PPO, ArrayPPO)], [Rollouts(), Rollouts()]
    for each, callback in zip(models, watched, strict=True):
        each.set_random_seed(4)  # of torch and NumPy, which both draw from
        each.learn(3 * 64 * each.n_envs, callback=callback)
    for name, wanted in watched[0].kept.items():
        np.testing.assert_allclose(watched[1].kept[name], wanted, rtol=1e-4, atol=1e-5, err_msg=name)
    assert 0 < watched[0].kept["episode_starts"].sum() < watched[0].kept["episode_starts"].size
    assert watched[0].seen == watched[1].seen
    first, second = (each.policy for each in models)
    for (name, wanted), got in zip(first.named_parameters(), second.parameters(), strict=True):
        np.testing.assert_allclose(got.detach(), wanted.detach(), atol=2e-4, err_msg=name)
    for wanted, got in zip(first.optimizer.state.values(), second.optimizer.state.values(), strict=True):
        assert got["step"] == wanted["step"] > 0
        np.testing.assert_allclose(got["exp_avg"], wanted["exp_avg"], atol=1e-3)
    assert models[0]._n_updates == models[1]._n_updates
    assert ("target_kl" not in settings) or models[1].policy.optimizer.state[second.log_std]["step"] < 3 * 3 * 4
    figures = [each.logger.name_to_value for each in models]
    assert figures[0].keys() == figures[1].keys()
    for name, wanted in figures[0].items():
        assert figures[1][name] == pytest.approx(wanted, rel=0.02, abs=2e-4), name


def test_networks_of_other_kinds_are_left_to_torch():
    parts = {"share_features_extractor": False, "optimizer_class": torch.optim.SGD, "activation_fn": torch.nn.SiLU}
    assert not PolicyArrays.represents(model(PPO, policy_kwargs={"activation_fn": torch.nn.SiLU}).policy)
    assert not PolicyArrays.represents(model(PPO, use_sde=True).policy)
    for settings in ({"use_sde": True}, {"clip_range_vf": 0.1}, *({"policy_kwargs": {k: v}} for k, v in parts.items())):
        models = [model(cls, **settings) for cls in (PPO, ArrayPPO)]
        for each in models:
            each.set_random_seed(4)
            each.learn(2 * 64 * 3)
        for wanted, got in zip(*(each.policy.parameters() for each in models), strict=True):
            np.testing.assert_allclose(got.detach(), wanted.detach(), atol=1e-4)


def test_its_files_are_those_of_stable_baselines(tmp_path):
    mine = model(ArrayPPO)
    mine.learn(64 * 3)
    mine.save(tmp_path / "model.zip")
    loaded = [cls.load(tmp_path / "model.zip", device="cpu") for cls in (PPO, ArrayPPO)]
    assert "wt_gym" not in str(vars(loaded[0]).get("policy_class")) + str(vars(loaded[0]).get("rollout_buffer_class"))
    for each in loaded:  # both continue, with the optimizer's state
        each.set_env(VecNormalize(DummyVecEnv([Pushed] * 3)))
        each.set_logger(Logger(None, []))
        each.set_random_seed(7)
        each.learn(64 * 3, reset_num_timesteps=False)
        assert each.policy.optimizer.state_dict()["state"][0]["step"] == 2 * 3 * 4
    for wanted, got in zip(*(each.policy.parameters() for each in loaded), strict=True):
        np.testing.assert_allclose(got.detach(), wanted.detach(), atol=1e-4)


def test_a_callback_ends_a_rollout_in_the_middle():
    class Stop(BaseCallback):
        def _on_step(self):
            return self.n_calls < 5

    mine = model(ArrayPPO)
    before = [p.detach().clone() for p in mine.policy.parameters()]
    mine.learn(10_000, callback=Stop())
    assert mine.num_timesteps == 15
    assert all(torch.equal(p, q) for p, q in zip(before, mine.policy.parameters(), strict=True))
