"""Every algorithm of stable-baselines3 and sb3-contrib for continuous actions trains and acts."""

import gymnasium as gym
import numpy as np
import pytest

import wt_gym  # noqa: F401 - registers the environments

sb3 = pytest.importorskip("stable_baselines3", reason="the extra 'train' is not installed")
contrib = pytest.importorskip("sb3_contrib", reason="the extra 'train' is not installed")
from stable_baselines3.common.env_util import make_vec_env  # noqa: E402
from stable_baselines3.common.vec_env import VecNormalize  # noqa: E402

ON_POLICY = {"n_steps": 16, "batch_size": 16}
OFF_POLICY = {"learning_starts": 8, "batch_size": 8}
ALGORITHMS = {
    **dict.fromkeys(("PPO", "TRPO", "RecurrentPPO"), ON_POLICY), "A2C": {"n_steps": 16},
    "ARS": {"n_delta": 2, "n_top": 1},
    **dict.fromkeys(("SAC", "TD3", "DDPG", "TQC", "CrossQ"), OFF_POLICY),
}  # fmt: skip


@pytest.mark.parametrize("name", [pytest.param(n, marks=pytest.mark.slow) if n == "CrossQ" else n for n in ALGORITHMS])
def test_algorithms_train_and_act(scripted, name, tmp_path):
    algorithm = getattr(sb3, name, None) or getattr(contrib, name)
    policy = "MlpLstmPolicy" if name == "RecurrentPPO" else "MlpPolicy"
    env = gym.make("wt_gym/LoadReduction-v3", max_episode_steps=8)
    model = algorithm(policy, env, device="cpu", seed=0, **ALGORITHMS[name])
    model.learn(32)
    assert model.num_timesteps >= 32
    model.save(tmp_path / "model.zip")
    observation, _ = env.reset(seed=0)
    actions = [
        one.predict(observation, deterministic=True)[0] for one in (model, algorithm.load(tmp_path / "model.zip"))
    ]
    np.testing.assert_array_equal(*actions)
    env.step(actions[0])


def test_normalized_vector_environments(scripted):
    envs = VecNormalize(make_vec_env("wt_gym/LoadReduction-v3", n_envs=2, seed=0, env_kwargs={"max_episode_steps": 8}))
    model = sb3.PPO("MlpPolicy", envs, device="cpu", seed=0, **ON_POLICY).learn(64)
    assert [episode["l"] for episode in model.ep_info_buffer] == [8] * 8
