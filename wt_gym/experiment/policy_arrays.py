"""Policy and value function of PPO with NumPy: samples, values and gradients of small networks.

In a torch forward pass of a few observations through two hidden layers of 64, dispatch takes longer than arithmetic.
"""

import math
from collections.abc import Callable, Iterable
from typing import Any, NamedTuple

import numpy as np
import torch
from gymnasium import spaces
from stable_baselines3.common.distributions import DiagGaussianDistribution
from stable_baselines3.common.policies import ActorCriticPolicy
from stable_baselines3.common.torch_layers import FlattenExtractor, MlpExtractor

_HALF_LOG_2_PI = 0.5 * math.log(2.0 * math.pi)


class _Activation(NamedTuple):
    """A function and its derivative by the value of the function."""

    value: Callable[[np.ndarray], np.ndarray]
    slope: Callable[[np.ndarray], np.ndarray]


_IDENTITY = _Activation(lambda x: x, np.ones_like)
_ACTIVATIONS: dict[type[torch.nn.Module], _Activation] = {
    torch.nn.Tanh: _Activation(np.tanh, lambda y: 1.0 - y * y),
    torch.nn.ReLU: _Activation(lambda x: np.maximum(x, 0.0), lambda y: (y > 0.0).astype(y.dtype)),
    torch.nn.ELU: _Activation(
        lambda x: np.where(x > 0.0, x, np.expm1(np.minimum(x, 0.0))), lambda y: np.minimum(y, 0.0) + 1.0
    ),
}


class FlatVector:
    """A number for every element of a policy's parameters in one vector, with a view of the shape of each parameter.

    Attributes
    ----------
    values : numpy.ndarray, shape (n,), float32
        In the order of ``policy.parameters()``; zeros at first.
    """

    def __init__(self, policy: torch.nn.Module):
        parameters = list(policy.parameters())
        self.values = np.zeros(sum(p.numel() for p in parameters), np.float32)
        ends = np.cumsum([p.numel() for p in parameters])
        self._views: dict[torch.Tensor, np.ndarray] = {
            p: self.values[end - p.numel() : end].reshape(p.shape) for p, end in zip(parameters, ends, strict=True)
        }

    def __getitem__(self, parameter: torch.Tensor) -> np.ndarray:
        """View of the part that belongs to a parameter."""
        return self._views[parameter]

    def read(self, tensor_of: Callable[[torch.Tensor], torch.Tensor]) -> None:
        """Copy the values of a tensor for every parameter."""
        for parameter, view in self._views.items():
            view[...] = tensor_of(parameter).detach().numpy()

    def write(self, tensor_of: Callable[[torch.Tensor], torch.Tensor]) -> None:
        """Copy the values to a tensor for every parameter, in place."""
        for parameter, view in self._views.items():
            tensor_of(parameter).detach().numpy()[...] = view


class _Layer(NamedTuple):
    """``activation(weight x + bias)``, and where its gradients go."""

    weight: np.ndarray  # (n_out, n_in)
    bias: np.ndarray
    activation: _Activation
    weight_gradient: np.ndarray | None
    bias_gradient: np.ndarray | None


class _Network:
    """Fully connected layers."""

    def __init__(
        self,
        modules: Iterable[torch.nn.Module],
        view: Callable[[torch.Tensor], np.ndarray],
        gradient: FlatVector | None,
    ):
        layers: list[_Layer] = []
        for module in modules:
            if isinstance(module, torch.nn.Linear):
                pair = module.weight, module.bias
                slots = (None, None) if gradient is None else (gradient[pair[0]], gradient[pair[1]])
                layers.append(_Layer(view(pair[0]), view(pair[1]), _IDENTITY, *slots))
            else:
                layers[-1] = layers[-1]._replace(activation=_ACTIVATIONS[type(module)])
        self._layers = layers
        self._outputs: list[np.ndarray] = []

    def forward(self, x: np.ndarray) -> np.ndarray:
        """Output for a batch."""
        self._outputs = [x]
        for layer in self._layers:
            x = x @ layer.weight.T
            x += layer.bias
            if layer.activation is not _IDENTITY:
                x = layer.activation.value(x)
            self._outputs.append(x)
        return x

    def backward(self, slope: np.ndarray) -> None:
        """Gradients for the batch of the last `forward` from the derivative by its output, shape (n, n_out)."""
        for k in range(len(self._layers) - 1, -1, -1):
            layer, before, output = self._layers[k], self._outputs[k], self._outputs[k + 1]
            if layer.activation is not _IDENTITY:
                slope = slope * layer.activation.slope(output)
            np.matmul(slope.T, before, out=layer.weight_gradient)
            np.sum(slope, axis=0, out=layer.bias_gradient)
            if k > 0:
                slope = slope @ layer.weight


class Sample(NamedTuple):
    """Actions drawn for a batch of observations."""

    actions: np.ndarray  #: before they are clipped to the range of the actions, shape (n, n_act)
    values: np.ndarray  #: of the value function, shape (n,)
    log_probs: np.ndarray  #: logarithm of the probability density of each action, shape (n,)


class PolicyArrays:
    """What a policy of PPO computes.

    Parameters
    ----------
    policy : stable_baselines3.common.policies.ActorCriticPolicy
        One that `PolicyArrays.represents`.
    parameters : FlatVector, optional
        Parameters to compute with; default: those of the policy itself, with every change that is made to them in
        place, as by an optimizer or ``load_state_dict``.
    gradient : FlatVector, optional
        Gets the gradient of `backward`.
    """

    def __init__(
        self, policy: ActorCriticPolicy, parameters: FlatVector | None = None, gradient: FlatVector | None = None
    ):
        def view(parameter: torch.Tensor) -> np.ndarray:
            return parameter.detach().numpy() if parameters is None else parameters[parameter]

        extractor = policy.mlp_extractor
        self._actor = _Network((*extractor.policy_net, policy.action_net), view, gradient)
        self._critic = _Network((*extractor.value_net, policy.value_net), view, gradient)
        self.log_std = view(policy.log_std)
        self._log_std_gradient = None if gradient is None else gradient[policy.log_std]

    @staticmethod
    def represents(policy: ActorCriticPolicy) -> bool:
        """Whether a policy is of fully connected layers on a flat observation, with independent Gaussian actions.

        Its parameters must be of 32 bits and on the processor, its activations tanh, ReLU or ELU with an alpha of 1.
        """
        if not (
            type(policy) is ActorCriticPolicy
            and isinstance(policy.observation_space, spaces.Box)
            and len(policy.observation_space.shape) == 1
            and isinstance(policy.action_space, spaces.Box)
            and len(policy.action_space.shape) == 1
            and type(policy.action_dist) is DiagGaussianDistribution
            and type(policy.features_extractor) is FlattenExtractor
            and type(policy.mlp_extractor) is MlpExtractor
        ):
            return False
        modules = (*policy.mlp_extractor.policy_net, *policy.mlp_extractor.value_net)
        if any(isinstance(module, torch.nn.ELU) and module.alpha != 1.0 for module in modules):
            return False
        return all(type(module) in (torch.nn.Linear, *_ACTIVATIONS) for module in modules) and all(
            p.device.type == "cpu" and p.dtype == torch.float32 and p.requires_grad for p in policy.parameters()
        )

    @staticmethod
    def viewed(policy: Any) -> list[Any]:
        """What `means` computes with: a policy, its layers, and where their parameters lie.

        Views that were made of another policy, of other layers or of other parameters are none of it: compare. Any
        policy may be given; one that has no such layers is listed alone.
        """
        extractor = getattr(policy, "mlp_extractor", None)
        layers = () if extractor is None else (*extractor.policy_net, policy.action_net)
        found: list[Any] = [policy, *layers]
        for layer in layers:
            if type(layer) is torch.nn.Linear:
                found += layer.weight.data_ptr(), layer.bias.data_ptr()
        return found

    def values(self, observations: np.ndarray) -> np.ndarray:
        """Value function.

        Parameters
        ----------
        observations : numpy.ndarray, shape (n, n_obs)
        """
        return self._critic.forward(np.asarray(observations, np.float32))[:, 0]

    def means(self, observations: np.ndarray) -> np.ndarray:
        """Means of the actions.

        Parameters
        ----------
        observations : numpy.ndarray, shape (n, n_obs)
        """
        return self._actor.forward(np.asarray(observations, np.float32))

    def sample(self, observations: np.ndarray) -> Sample:
        """Draw an action for every observation.

        The standard normal numbers are those that the policy itself would draw from torch's default generator: with
        the same seed the actions are the same except for rounding, and the generator is left in the same state.

        Parameters
        ----------
        observations : numpy.ndarray, shape (n, n_obs)
        """
        means = self.means(observations)
        noise = torch.randn(means.shape).numpy()
        actions = means + np.exp(self.log_std) * noise
        return Sample(actions, self.values(observations), self._log_densities(noise))

    def evaluate(self, observations: np.ndarray, actions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Value function, and logarithm of the probability density of actions; `backward` belongs to this batch.

        Parameters
        ----------
        observations : numpy.ndarray, shape (n, n_obs)
        actions : numpy.ndarray, shape (n, n_act)

        Returns
        -------
        values, log_probs : numpy.ndarray, shape (n,), float32
        """
        self._noise = (actions - self.means(observations)) * np.exp(-self.log_std)
        return self.values(observations), self._log_densities(self._noise)

    def backward(self, by_values: np.ndarray, by_log_probs: np.ndarray) -> None:
        """Gradient of a loss, for the batch of the last `evaluate`.

        Parameters
        ----------
        by_values, by_log_probs : numpy.ndarray, shape (n,), float32
            Derivatives of the loss.
        """
        weighted = by_log_probs[:, None] * self._noise
        self._actor.backward(weighted * np.exp(-self.log_std))
        np.sum(weighted * self._noise - by_log_probs[:, None], axis=0, out=self._log_std_gradient)
        self._critic.backward(by_values[:, None])

    def entropy(self) -> float:
        """Differential entropy of the actions, the same for every observation."""
        return float(self.log_std.sum()) + self.log_std.size * (0.5 + _HALF_LOG_2_PI)

    def _log_densities(self, noise: np.ndarray) -> np.ndarray:
        """Of actions that lie so many standard deviations beside their means."""
        constant = self.log_std.sum() + np.float32(noise.shape[1] * _HALF_LOG_2_PI)
        out: np.ndarray = np.float32(-0.5) * np.square(noise).sum(axis=1) - constant
        return out
