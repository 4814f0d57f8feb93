"""Actions of a trained agent: those of its model, also where small networks are computed without torch."""

import copy
import pickle
import zipfile
from functools import partial

import gymnasium as gym
import numpy as np
import pytest
import torch
from gymnasium import spaces
from stable_baselines3 import A2C, PPO, SAC

from wt_gym.experiment.trained_agent import ALGORITHM_CLASSES, TrainedAgent


class Plain(gym.Env):
    """Eight numbers, two actions of which one is narrow."""

    observation_space = spaces.Box(-np.inf, np.inf, (8,), np.float32)
    action_space = spaces.Box(np.array([-1.0, -0.02], np.float32), np.array([1.0, 0.03], np.float32))

    def reset(self, *, seed=None, options=None):
        return np.zeros(8, np.float32), {}

    def step(self, action):
        return np.zeros(8, np.float32), 0.0, False, False, {}


class Bounded(Plain):
    """With bounds of the numbers, and actions as SAC wants them."""

    observation_space = spaces.Box(-1.0, 1.0, (8,), np.float32)
    action_space = spaces.Box(-1.0, 1.0, (2,), np.float32)


def agent_of(cls, **policy):
    return TrainedAgent(cls("MlpPolicy", Plain(), seed=3, policy_kwargs=policy))


def scaled(agent, factor):
    """With other weights of the last layer, which begin very small."""
    with torch.no_grad():
        agent.model.policy.action_net.weight *= factor
    return agent


OBSERVATIONS = 0.5 * np.random.default_rng(0).standard_normal((5, 8)).astype(np.float32)


@pytest.mark.parametrize("activation", [torch.nn.Tanh, torch.nn.ReLU, torch.nn.ELU])
@pytest.mark.parametrize("rows", [0, slice(0, 1), slice(None)])
@pytest.mark.parametrize(("cls", "factor"), [(PPO, 3.0), (A2C, 3000.0)])
def test_small_networks_act_as_the_model(cls, factor, rows, activation):
    """Within the range of the actions and, with large weights, at its ends."""
    agent = scaled(agent_of(cls, net_arch=[16], activation_fn=activation), factor)
    expected, _ = agent.model.predict(OBSERVATIONS[rows], deterministic=True)
    action, state = agent.predict(OBSERVATIONS[rows])
    assert agent._arrays[1] is not None
    assert state is None
    assert (action.dtype, action.shape) == (expected.dtype, expected.shape)
    np.testing.assert_allclose(action, expected, rtol=1e-4, atol=1e-7)
    assert np.isin(np.abs(action[..., 0]), 1.0).any() == (factor > 1000.0)


@pytest.mark.parametrize(
    "agent",
    [
        agent_of(SAC, net_arch=[16]),
        agent_of(PPO, net_arch=[16], activation_fn=torch.nn.GELU),
        agent_of(PPO, net_arch=[16], activation_fn=partial(torch.nn.ELU, alpha=0.3)),
    ],
    ids=["SAC", "GELU", "ELU of another alpha"],
)
def test_other_networks_are_asked_themselves(agent):
    expected, _ = agent.model.predict(OBSERVATIONS, deterministic=True)
    np.testing.assert_array_equal(agent.predict(OBSERVATIONS)[0], expected)


def own(*_, **__):
    return np.array([0.5, 0.01], np.float32), None


def test_a_model_with_a_predict_of_its_own_is_asked():
    of_class, of_object = agent_of(type("Own", (PPO,), {"predict": own})), agent_of(PPO)
    of_object.model.predict = own
    for agent in (of_class, of_object):
        assert agent.predict(OBSERVATIONS[0])[0].tolist() == pytest.approx([0.5, 0.01])


def in_place(policy):
    with torch.no_grad():
        policy.action_net.bias += 0.3


def from_vector(policy):
    policy.load_from_vector(policy.parameters_to_vector() + 0.1)


def another_layer(policy):
    policy.mlp_extractor.policy_net[0] = torch.nn.Linear(8, 64)


@pytest.mark.parametrize("change", [in_place, from_vector, another_layer])
@pytest.mark.parametrize(
    "copied", [copy.deepcopy, lambda agent: pickle.loads(pickle.dumps(agent))], ids=["copy", "sent"]
)
def test_weights_that_are_changed_later_act_in_their_agent_alone(change, copied):
    agent = scaled(agent_of(PPO), 30.0)
    before = agent.predict(OBSERVATIONS)[0]
    other = copied(agent)
    change(other.model.policy)
    expected, _ = other.model.predict(OBSERVATIONS, deterministic=True)
    assert np.abs(expected - before).max() > 1e-3
    np.testing.assert_allclose(other.predict(OBSERVATIONS)[0], expected, atol=1e-6)
    np.testing.assert_array_equal(agent.predict(OBSERVATIONS)[0], before)


def test_what_is_no_number_is_refused_by_the_model():
    with pytest.raises(ValueError, match="nan"):
        agent_of(PPO).predict(np.full(8, np.nan, np.float32))


def test_an_action_is_drawn_where_it_is_asked_for():
    agent, observation = agent_of(PPO), np.ones(8, np.float32)
    drawn = {float(agent.predict(observation, deterministic=False)[0][0]) for _ in range(4)}
    assert len(drawn) > 1


@pytest.mark.parametrize("cls", [PPO, SAC])
def test_an_observation_of_another_size_is_refused(cls):
    with pytest.raises(ValueError, match=r"Unexpected observation shape \(7,\)"):
        agent_of(cls).predict(np.zeros(7, np.float32))


@pytest.mark.parametrize("name", ["A2C", "ARS", "CrossQ", "DDPG", "PPO", "RecurrentPPO", "SAC", "TD3", "TQC", "TRPO"])
@pytest.mark.parametrize("trust", [False, True])
def test_a_file_shows_its_algorithm(tmp_path, name, trust):
    """The state of a policy with memory goes from step to step."""
    model = ALGORITHM_CLASSES[name]("MlpLstmPolicy" if name == "RecurrentPPO" else "MlpPolicy", Bounded(), seed=3)
    model.save(tmp_path / "model.zip")
    agent = TrainedAgent.load(tmp_path / "model.zip", trust=trust)
    assert type(agent.model).__name__ in (name, {"DDPG": "TD3"}.get(name))
    states, observation = [None, None], OBSERVATIONS[0].clip(-1.0, 1.0)
    for first in (True, False, False):
        expected, states[0] = model.predict(observation, states[0], np.array([first]), deterministic=True)
        action, states[1] = agent.predict(observation, states[1], np.array([first]))
        np.testing.assert_allclose(action, expected, rtol=1e-4, atol=1e-7)
    assert (states[1] is not None) == (name == "RecurrentPPO")


def test_a_file_that_does_not_show_its_algorithm_has_a_way_out(tmp_path):
    with zipfile.ZipFile(tmp_path / "model.zip", "w") as archive:
        archive.writestr("data", "{}")
    with pytest.raises(ValueError, match=r"state it by --algo, .* one of PPO, A2C, .* runs as a class with predict"):
        TrainedAgent.load(tmp_path / "model.zip")
