"""Actions of a trained agent: those of its model, also where small networks are computed without torch."""

import gymnasium as gym
import numpy as np
import pytest
import torch
from gymnasium import spaces
from stable_baselines3 import A2C, PPO, SAC

from wt_gym.agents.trained_agent import TrainedAgent


class Plain(gym.Env):
    """Eight numbers, two actions of which one is narrow."""

    observation_space = spaces.Box(-np.inf, np.inf, (8,), np.float32)
    action_space = spaces.Box(np.array([-1.0, -0.02], np.float32), np.array([1.0, 0.03], np.float32))

    def reset(self, *, seed=None, options=None):
        return np.zeros(8, np.float32), {}

    def step(self, action):
        return np.zeros(8, np.float32), 0.0, False, False, {}


def agent_of(cls, **policy):
    return TrainedAgent(cls("MlpPolicy", Plain(), seed=3, policy_kwargs=policy))


@pytest.mark.parametrize("activation", [torch.nn.Tanh, torch.nn.ReLU, torch.nn.ELU, torch.nn.GELU])
@pytest.mark.parametrize("shape", [(8,), (1, 8), (5, 8)])
@pytest.mark.parametrize("cls", [PPO, A2C, SAC])
def test_actions_are_those_of_the_model(cls, shape, activation):
    agent = agent_of(cls, net_arch=[16], activation_fn=activation)
    if cls is not SAC:
        with torch.no_grad():  # beyond the range of the actions, which the first weights are too small for
            agent.model.policy.action_net.weight *= 1000.0
    observation = 30.0 * np.random.default_rng(0).standard_normal(shape).astype(np.float32)
    expected, _ = agent.model.predict(observation, deterministic=True)
    action, state = agent.predict(observation)
    assert state is None
    assert (action.dtype, action.shape) == (expected.dtype, expected.shape)
    np.testing.assert_allclose(action, expected, rtol=1e-5, atol=1e-6)
    if cls is not SAC:  # their actions are clipped, its own lie within
        assert np.isin(np.float32([-0.02, 0.03]), action[..., 1]).any()


def test_weights_that_are_changed_later_act():
    agent, observation = agent_of(PPO), np.ones(8, np.float32)
    before = agent.predict(observation)[0]
    with torch.no_grad():
        agent.model.policy.action_net.bias += 0.3
    assert agent.predict(observation)[0][0] == pytest.approx(before[0] + 0.3, abs=1e-6)


def test_an_action_is_drawn_where_it_is_asked_for():
    agent, observation = agent_of(PPO), np.ones(8, np.float32)
    drawn = {float(agent.predict(observation, deterministic=False)[0][0]) for _ in range(4)}
    assert len(drawn) > 1


@pytest.mark.parametrize("cls", [PPO, SAC])
def test_an_observation_of_another_size_is_refused(cls):
    with pytest.raises(ValueError, match=r"Unexpected observation shape \(7,\)"):
        agent_of(cls).predict(np.zeros(7, np.float32))
