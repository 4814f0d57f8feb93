"""What a trained policy computes, from the measured channels to the action, as arrays.

``observation = clip(channels, low, high)``, then ``(observation − offset)/scale`` (`wt_gym.envs.layout`), then the
statistics of the training where it normalized observations, then fully connected layers, then the mean of the policy's
distribution, squashed where the algorithm does that, within the range of the actions.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, cast

import numpy as np
import torch
from gymnasium import spaces
from stable_baselines3.common.torch_layers import FlattenExtractor

if TYPE_CHECKING:
    from collections.abc import Iterable

    from stable_baselines3.common.running_mean_std import RunningMeanStd

    from wt_gym.agents.trained_agent import TrainedAgent
    from wt_gym.envs.layout import EnvLayout

__all__ = ["ACTIVATIONS", "Layer", "Network", "Normalization", "network_of"]

ACTIVATIONS = {torch.nn.Tanh: "tanh", torch.nn.ReLU: "relu", torch.nn.ELU: "elu"}
"""Activations of layers, and their names here."""


@dataclass(frozen=True)
class Layer:
    """``activation(weight x + bias)``.

    Attributes
    ----------
    weight : numpy.ndarray, shape (n_out, n_in), float32
    bias : numpy.ndarray, shape (n_out,), float32
    activation : str
        Of `ACTIVATIONS`, or "" for none.
    """

    weight: np.ndarray
    bias: np.ndarray
    activation: str


@dataclass(frozen=True)
class Normalization:
    """``clip((x − mean)/sqrt(variance + epsilon), −limit, limit)``, statistics of the training.

    Attributes
    ----------
    mean, deviation : numpy.ndarray, shape (n,)
        The deviation is ``sqrt(variance + epsilon)``.
    limit : float
    """

    mean: np.ndarray
    deviation: np.ndarray
    limit: float


@dataclass(frozen=True)
class Network:
    """A policy from measured channels to the action.

    Attributes
    ----------
    channels : tuple of Channel
        In SI units, as the environment lists them; those of earlier readings are called ``NAME@k``.
    offset, scale, low, high : numpy.ndarray, shape (n_obs,)
        Of the channels.
    normalization : Normalization or None
    layers : tuple of Layer
    action_names : tuple of str
    action_low, action_high : numpy.ndarray, shape (n_act,), float32
        Range of the actions.
    squashed : bool
        Whether the last layer's output goes from −1 to 1 over the range, not clipped to it.
    """

    channels: tuple[Any, ...]
    offset: np.ndarray
    scale: np.ndarray
    low: np.ndarray
    high: np.ndarray
    normalization: Normalization | None
    layers: tuple[Layer, ...]
    action_names: tuple[str, ...]
    action_low: np.ndarray
    action_high: np.ndarray
    squashed: bool

    def action(self, values: np.ndarray) -> np.ndarray:
        """Action for measured values, with NumPy alone.

        Parameters
        ----------
        values : numpy.ndarray, shape (..., n_obs)
            In SI units.

        Returns
        -------
        numpy.ndarray, shape (..., n_act), float32
        """
        return self.of_observation((np.clip(values, self.low, self.high) - self.offset) / self.scale)

    def of_observation(self, observation: np.ndarray) -> np.ndarray:
        """Action for an observation as the environment gives it, in scales of the channels.

        Parameters
        ----------
        observation : numpy.ndarray, shape (..., n_obs)

        Returns
        -------
        numpy.ndarray, shape (..., n_act), float32
        """
        x = np.asarray(observation).astype(np.float32)
        if self.normalization is not None:
            n = self.normalization
            x = np.clip((x - n.mean) / n.deviation, -n.limit, n.limit).astype(np.float32)
        for layer in self.layers:
            x = _activate(x @ layer.weight.T + layer.bias, layer.activation)
        if self.squashed:
            x = self.action_low + 0.5 * (np.tanh(x) + 1.0) * (self.action_high - self.action_low)
        action: np.ndarray = np.clip(x, self.action_low, self.action_high).astype(np.float32)
        return action


def _activate(x: np.ndarray, activation: str) -> np.ndarray:
    y: np.ndarray
    match activation:
        case "tanh":
            y = np.tanh(x)
        case "relu":
            y = np.maximum(x, 0.0)
        case "elu":
            y = np.where(x > 0.0, x, np.expm1(np.minimum(x, 0.0)))
        case _:
            y = x
    return y


def network_of(agent: TrainedAgent, layout: EnvLayout) -> Network:
    """Take a policy apart.

    Parameters
    ----------
    agent : TrainedAgent
    layout : EnvLayout
        Of an environment that it fits.

    Raises
    ------
    ValueError
        If the policy is not made of fully connected layers on a flat observation with one continuous action.
    """
    agent.check_fits(layout)
    policy, space = agent.model.policy, agent.model.action_space
    if not isinstance(space, spaces.Box):
        raise ValueError(f"the policy must have a continuous action (Box) to be exported, got {space}")
    extractor = getattr(getattr(policy, "actor", policy), "features_extractor", None)
    if not isinstance(extractor, FlattenExtractor):
        raise ValueError(
            f"the policy must take the observation as it is (FlattenExtractor) to be exported, got {extractor!r}"
        )
    observation = layout.observation
    arrays = {
        name: np.array([getattr(channel, name) for channel in observation.channels])
        for name in ("offset", "scale", "low", "high")
    }
    modules, squashed = _modules(policy)
    return Network(
        channels=observation.channels,
        **arrays,
        normalization=_normalization(agent),
        layers=_layers(modules),
        action_names=tuple(layout.action.names),
        action_low=space.low.astype(np.float32),
        action_high=space.high.astype(np.float32),
        squashed=squashed,
    )


def _normalization(agent: TrainedAgent) -> Normalization | None:
    made = agent.normalization
    if made is None or not made.norm_obs:
        return None
    statistics = cast("RunningMeanStd", made.obs_rms)  # of a flat observation
    return Normalization(statistics.mean.copy(), np.sqrt(statistics.var + made.epsilon), float(made.clip_obs))


def _modules(policy: Any) -> tuple[list[Any], bool]:
    """Modules of a policy in the order in which they act, and whether the output is squashed."""
    actor = getattr(policy, "actor", None)
    if actor is None:  # PPO, A2C
        return [*policy.mlp_extractor.policy_net, policy.action_net], False
    if hasattr(actor, "latent_pi"):  # SAC, TQC
        return [*actor.latent_pi, *(actor.mu if isinstance(actor.mu, torch.nn.Sequential) else [actor.mu])], True
    return list(actor.mu)[:-1], True  # TD3, DDPG: the last one is the tanh


def _layers(modules: Iterable[Any]) -> tuple[Layer, ...]:
    layers: list[Layer] = []
    for module in modules:
        if isinstance(module, torch.nn.Linear):
            weight, bias = (p.detach().cpu().numpy().astype(np.float32) for p in (module.weight, module.bias))
            layers.append(Layer(weight.copy(), bias.copy(), ""))
        elif type(module) in ACTIVATIONS and layers and not layers[-1].activation:
            layers[-1] = Layer(layers[-1].weight, layers[-1].bias, ACTIVATIONS[type(module)])
        else:
            raise ValueError(
                f"a policy to be exported must be made of fully connected layers with "
                f"{', '.join(ACTIVATIONS.values())}, got {module!r}"
            )
    return tuple(layers)
