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

from wt_gym.experiment.policy_arrays import FlatVector, PolicyArrays
from wt_gym.learning.models import ArrayPPO

ACTIVATIONS = [torch.nn.Tanh, torch.nn.ReLU, torch.nn.ELU]


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


@pytest.mark.parametrize("activation", ACTIVATIONS)
def test_samples_are_those_of_torch(activation):
    policy = model(PPO, policy_kwargs={"activation_fn": activation, "net_arch": [64, 64]}).policy
    arrays = PolicyArrays(policy)
    observations = np.random.default_rng(1).normal(size=(40, 3)).astype(np.float32)
    with torch.no_grad():
        policy.log_std += torch.tensor([0.3, -0.2])  # in place: seen by the arrays
        policy.action_net.bias += 0.5
        for n in (1, 7, 40):
            torch.manual_seed(n)
            actions, values, log_probs = policy(torch.as_tensor(observations[:n]))
            state = torch.get_rng_state()
            torch.manual_seed(n)
            sample = arrays.sample(observations[:n])
            assert torch.equal(torch.get_rng_state(), state)
            np.testing.assert_allclose(sample.actions, actions, atol=1e-6)
            np.testing.assert_allclose(sample.values, values[:, 0], atol=1e-6)
            np.testing.assert_allclose(sample.log_probs, log_probs, atol=1e-6)
        assert arrays.entropy() == pytest.approx(float(policy.get_distribution(torch.zeros(1, 3)).entropy()), rel=1e-6)


@pytest.mark.parametrize("activation", ACTIVATIONS)
def test_gradients_are_those_of_torch(activation):
    policy = model(PPO, policy_kwargs={"activation_fn": activation}).policy
    gradient = FlatVector(policy)
    arrays = PolicyArrays(policy, gradient=gradient)
    rng = np.random.default_rng(2)
    observations, actions = (rng.normal(size=(50, n)).astype(np.float32) for n in (3, 2))
    by_values, by_log_probs = rng.normal(size=(2, 50)).astype(np.float32)
    values, log_probs, _ = policy.evaluate_actions(torch.as_tensor(observations), torch.as_tensor(actions))
    (values[:, 0] @ torch.as_tensor(by_values) + log_probs @ torch.as_tensor(by_log_probs)).backward()
    arrays.evaluate(observations, actions)
    arrays.backward(by_values, by_log_probs)
    for name, parameter in policy.named_parameters():
        wanted = parameter.grad.numpy()
        assert np.abs(wanted).max() > 0.0
        np.testing.assert_allclose(gradient[parameter], wanted, rtol=1e-4, atol=1e-5, err_msg=name)


@pytest.mark.parametrize(
    "settings",
    [
        {},
        {"n_envs": 1, "normalized": False, "batch_size": 50},  # the last minibatch is shorter
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
    plain = PPO.load(tmp_path / "model.zip", device="cpu")
    assert "wt_gym" not in str(plain.__dict__.get("policy_class")) + str(plain.__dict__.get("rollout_buffer_class"))
    observation = np.ones((1, 3), np.float32)
    np.testing.assert_array_equal(*(each.predict(observation, deterministic=True)[0] for each in (plain, mine)))
    for each in (plain, ArrayPPO.load(tmp_path / "model.zip", device="cpu")):  # both go on, with the optimizer's state
        each.set_env(VecNormalize(DummyVecEnv([Pushed] * 3)))
        each.set_logger(Logger(None, []))
        each.set_random_seed(7)
        each.learn(64 * 3, reset_num_timesteps=False)
        assert each.policy.optimizer.state_dict()["state"][0]["step"] == 2 * 3 * 4
        if each is plain:
            wanted = [p.detach().clone() for p in each.policy.parameters()]
    for before, got in zip(wanted, each.policy.parameters(), strict=True):
        np.testing.assert_allclose(got.detach(), before, atol=1e-4)


def test_a_callback_ends_a_rollout_in_the_middle():
    class Stop(BaseCallback):
        def _on_step(self):
            return self.n_calls < 5

    mine = model(ArrayPPO)
    before = [p.detach().clone() for p in mine.policy.parameters()]
    mine.learn(10_000, callback=Stop())
    assert mine.num_timesteps == 15
    assert all(torch.equal(p, q) for p, q in zip(before, mine.policy.parameters(), strict=True))
