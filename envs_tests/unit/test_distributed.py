"""What trainings on a cluster share with those in one process; without Ray and without a simulator."""

import gymnasium as gym
import numpy as np
import pytest
import torch
from gymnasium.vector import AutoresetMode
from stable_baselines3 import PPO, SAC
from stable_baselines3.common.vec_env import DummyVecEnv, VecNormalize

from wt_gym.learning import rllib_environment
from wt_gym.learning.rllib_environment import RunnerEnv, first_weights, make_runner_env, take_weights

SPACE = gym.spaces.Box(-1.0, 1.0, (3,), np.float32)


class Countdown(gym.Env):
    """Ends after so many steps; the reward is their number, times the action."""

    observation_space, action_space = SPACE, SPACE

    def __init__(self, length: int):
        self._length, self._steps = length, 0

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self._steps = 0
        return np.zeros(3, np.float32), {}

    def step(self, action):
        self._steps += 1
        reward = float(self._steps * action[0])
        return np.full(3, 0.1, np.float32), reward, self._steps == self._length, False, {"ignored": 1}


def counted(mark=(0, 0), gamma=None, mode=AutoresetMode.NEXT_STEP) -> RunnerEnv:
    env = gym.vector.SyncVectorEnv([lambda n=n: Countdown(n) for n in (2, 3)], autoreset_mode=mode)
    return RunnerEnv(env, mark, gamma)


def test_episodes_are_reported_once_and_resets_are_no_steps():
    env = counted()
    env.reset()
    for _ in range(5):
        *_, infos = env.step(np.ones((2, 3)))
        assert infos == {}
    report = env.take_report()
    assert report["steps"] == 10 - 2  # one reset each
    assert report["episodes"] == [{"r": 3.0, "l": 2}, {"r": 6.0, "l": 3}, {"r": 3.0, "l": 2}]
    assert env.take_report()["episodes"] == []


def test_rewards_are_scaled_as_by_stable_baselines3():
    """Its copies begin anew in the step of the end; here that takes a step, which must not count."""
    rng = np.random.default_rng(0)
    scales = rng.normal(size=40)
    theirs = VecNormalize(DummyVecEnv([lambda: Countdown(4)]), norm_obs=False, gamma=0.9)
    theirs.reset()
    expected = [theirs.step(np.full((1, 3), scale))[1][0] for scale in scales]
    env = RunnerEnv(gym.vector.SyncVectorEnv([lambda: Countdown(4)], autoreset_mode="NextStep"), (0,), 0.9)
    env.reset()
    found = []
    for scale in scales:
        _, reward, terminated, _, _ = env.step(np.full((1, 3), scale))
        found.append(reward[0])
        if terminated[0]:
            env.step(np.zeros((1, 3)))
    np.testing.assert_allclose(found, expected, rtol=1e-5)
    np.testing.assert_allclose(env.take_report()["statistics"][1], theirs.ret_rms.var, rtol=1e-6)


def drawn(env: RunnerEnv, seed: int) -> tuple[int, ...]:
    """Seeds that the environments of a runner get by RLlib's."""
    env.reset(seed=seed)
    return env.env.np_random_seed


def test_no_two_runners_begin_with_the_same_seeds():
    first = [seed for runner in range(7, 11) for seed in drawn(counted((7, 0)), runner)]
    assert len(set(first)) == 8
    assert drawn(counted((7, 0)), 7) == tuple(first[:2])
    assert not set(drawn(counted((7, 1000)), 7)) & set(first)  # a later session
    assert not set(drawn(counted((8, 0)), 8)) & set(first)  # another training


def test_another_mode_of_autoreset_is_refused():
    with pytest.raises(ValueError, match="RLlib takes the autoreset mode NextStep for granted"):
        counted(mode=AutoresetMode.SAME_STEP)


def test_a_runner_makes_its_turbines_by_id(monkeypatch):
    asked = []

    def make_vec(*words, **more):
        asked.append((words, more))
        return counted().env

    monkeypatch.setattr(rllib_environment.gym, "make_vec", make_vec)
    context = {"env_id": "x-v0", "env_kwargs": {"a": 1}, "mark": [3, 0], "gamma": 0.9, "num_envs": 2}
    env = make_runner_env(context)
    more = {"num_envs": 2, "vectorization_mode": "vector_entry_point", "threads": 1, "a": 1}
    assert asked == [(("x-v0",), more)]
    assert drawn(env, 5) == drawn(counted((3, 0)), 5)


@pytest.mark.parametrize("algorithm", [PPO, SAC])
def test_weights_go_there_and_back(algorithm):
    def model(seed: int):
        env = DummyVecEnv([lambda: Countdown(3)])
        return algorithm("MlpPolicy", env, policy_kwargs={"net_arch": [8, 4]}, seed=seed, device="cpu")

    first, second = model(0), model(1)
    observation = np.array([0.1, -0.2, 0.3], np.float32)
    before = second.predict(observation, deterministic=True)[0]
    weights = first_weights(first)
    take_weights(second, weights)
    wanted = first.predict(observation, deterministic=True)[0]
    assert np.abs(before - wanted).max() > 1e-6
    np.testing.assert_array_equal(second.predict(observation, deterministic=True)[0], wanted)
    head = "pi.net.mlp.0.weight"
    assert weights[head].shape == ((6, 4) if algorithm is SAC else (3, 4))
    if algorithm is PPO:
        with torch.no_grad():
            values = [m.policy.predict_values(torch.as_tensor(observation)[None]) for m in (first, second)]
        assert torch.equal(*values)
