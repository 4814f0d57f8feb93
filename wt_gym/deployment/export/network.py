"""What a trained policy computes, from the measured channels to the action, as arrays.

``observation = clip(channels, low, high)``, then ``(observation − offset)/scale`` (`wt_gym.envs.layout`), then the
statistics of the training where it normalized observations, then fully connected layers, then the mean of the policy's
distribution, squashed where the algorithm does that, within the range of the actions.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, cast

import numpy as np
import torch
from gymnasium import spaces
from stable_baselines3.common.torch_layers import FlattenExtractor

if TYPE_CHECKING:
    from collections.abc import Iterable

    from stable_baselines3.common.running_mean_std import RunningMeanStd

    from wt_gym.envs.layout import EnvLayout
    from wt_gym.experiment.trained_agent import TrainedAgent

__all__ = ["ACTIVATIONS", "Layer", "Network", "Normalization", "network_of"]

_UNIT = 2.0**-24
"""Relative error of rounding in single precision [-]."""
_OF_ACTIVATION = 2.0 * _UNIT
"""Error of a hyperbolic tangent or exponential in single precision; they are at most 1 [-]."""
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
        return self.of_observation(self._observation(values))

    def _observation(self, values: np.ndarray) -> np.ndarray:
        observation: np.ndarray = (np.clip(values, self.low, self.high) - self.offset) / self.scale
        return observation

    def _standardized(self, observation: np.ndarray) -> np.ndarray:
        """Input of the first layer, float32."""
        x = np.asarray(observation).astype(np.float32)
        if self.normalization is not None:
            n = self.normalization
            x = np.clip((x - n.mean) / n.deviation, -n.limit, n.limit).astype(np.float32)
        return x

    def rounding(self, values: np.ndarray) -> np.ndarray:
        """Bound on the difference of two single-precision computations of an action, whatever their order of sums.

        Rounding errors are independent, with zero mean and at most u = 2⁻²⁴ of the rounded number, as in the analysis
        of Higham and Mary (SIAM J. Sci. Comput. 41, 2019, A2815). Each of the n additions of a sum s of products p
        rounds a partial sum, whose mean square over all orders is at most s² + Σ p²; so the error of the sum has the
        variance n u² (s² + Σ p²). A layer passes on the root sum square of the errors of its inputs times its weights;
        activations enlarge none and add a unit in the last place. The bound is seven standard deviations.

        Parameters
        ----------
        values : numpy.ndarray, shape (..., n_obs)
            As of `action`.

        Returns
        -------
        numpy.ndarray, shape (..., n_act)
        """
        x = self._standardized(self._observation(values)).astype(np.float64)
        error = _UNIT * np.abs(x)
        for layer in self.layers:
            squares = (layer.weight.astype(np.float64) ** 2).T
            sums = x @ layer.weight.T + layer.bias
            own = len(squares) * _UNIT**2 * (sums**2 + x**2 @ squares + layer.bias**2)
            error = np.sqrt(error**2 @ squares + own)
            x = _activate(sums, layer.activation)
            error = error + (_OF_ACTIVATION if layer.activation else 0.0)
        if self.squashed:
            error = 0.5 * (self.action_high - self.action_low) * (error + _OF_ACTIVATION)
        ends = np.maximum(np.abs(self.action_low), np.abs(self.action_high))
        bound: np.ndarray = 7.0 * math.sqrt(2.0) * error + 4.0 * _UNIT * ends
        return bound

    def of_observation(self, observation: np.ndarray) -> np.ndarray:
        """Action for an observation as the environment gives it, in scales of the channels.

        Parameters
        ----------
        observation : numpy.ndarray, shape (..., n_obs)

        Returns
        -------
        numpy.ndarray, shape (..., n_act), float32
        """
        x = self._standardized(observation)
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
    if not hasattr(policy, "actor") and (hasattr(policy, "lstm_actor") or not hasattr(policy, "mlp_extractor")):
        raise ValueError(
            "a policy to be exported must be one of PPO, A2C, TRPO, SAC, TQC, TD3 or DDPG, got "
            f"{type(policy).__name__} of {type(agent.model).__name__}"
        )
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
