"""Turbines of an RLlib environment runner, and RLlib's networks in those of stable-baselines3; without Ray.

So a policy of RLlib is written, evaluated and compared as every other trained model.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, cast

import gymnasium as gym
import numpy as np
import torch
from gymnasium.vector import AutoresetMode
from gymnasium.wrappers.utils import RunningMeanStd

import wt_gym  # noqa: F401 - registers the environments in the process of the runner

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from ray.rllib.env.env_runner import EnvRunner
    from stable_baselines3.common.base_class import BaseAlgorithm


# As stable-baselines3's VecNormalize, so that the same hyperparameters mean the same.
_CLIP, _EPSILON = 10.0, 1e-8


class RunnerEnv(gym.vector.VectorWrapper):
    """Turbines with rewards scaled by the running deviation of discounted returns, and a list of finished episodes.

    Runners get seeds that no other one has: RLlib numbers them by runner, and a vector environment counts on from its
    number, so that the second turbine of one runner would meet the winds of the first turbine of the next. Infos stay
    here: RLlib would keep and send those of every step.

    Parameters
    ----------
    env : gymnasium.vector.VectorEnv
        With the mode of autoreset that RLlib takes for granted, ``"NextStep"``.
    mark : sequence of int
        Tells trainings and sessions apart; RLlib's seed, another for each runner, comes with the first reset.
    gamma : float or None
        Discount of the returns; None: rewards as they are.
    """

    def __init__(self, env: gym.vector.VectorEnv, mark: Sequence[int], gamma: float | None):
        super().__init__(env)
        if env.metadata["autoreset_mode"] != AutoresetMode.NEXT_STEP:
            raise ValueError(f"RLlib takes the autoreset mode NextStep for granted, got {env.metadata}")
        self._mark, self._gamma, self.statistics = tuple(mark), gamma, RunningMeanStd(shape=())
        self._returns, self._discounted = np.zeros(env.num_envs), np.zeros(env.num_envs)
        self._lengths, self._over = np.zeros(env.num_envs, dtype=np.int64), np.zeros(env.num_envs, dtype=np.bool_)
        self._steps = 0
        self._episodes: list[dict[str, Any]] = []

    def reset(
        self, *, seed: int | list[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """Start episodes; from a seed of RLlib each turbine gets one that no other has."""
        if isinstance(seed, int):
            seed = np.random.SeedSequence((*self._mark, seed)).generate_state(self.num_envs).tolist()
        # gymnasium types one seed for all; its vector environments take one each, too
        observations, _ = cast(Any, self.env).reset(seed=seed, options=options)
        for array in (self._returns, self._discounted, self._lengths, self._over):
            array[:] = 0
        return observations, {}

    def step(self, actions: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, dict[str, Any]]:
        """Advance every turbine; those whose episode is over begin the next one."""
        observations, rewards, terminated, truncated, _ = self.env.step(actions)
        going = ~self._over
        self._returns = np.where(going, self._returns + rewards, 0.0)
        self._lengths = np.where(going, self._lengths + 1, 0)
        self._steps += int(going.sum())
        if self._gamma is not None:
            self._discounted = np.where(going, self._discounted * self._gamma + rewards, 0.0)
            if going.any():
                self.statistics.update(self._discounted[going])
            rewards = np.clip(rewards / np.sqrt(self.statistics.var + _EPSILON), -_CLIP, _CLIP)
        self._over = terminated | truncated
        for k in np.flatnonzero(self._over):
            self._episodes.append({"r": float(self._returns[k]), "l": int(self._lengths[k])})
        return observations, rewards, terminated, truncated, {}

    def take_report(self) -> dict[str, Any]:
        """Steps and episodes since the last report, and the statistics of the rewards."""
        rms = self.statistics
        report = {
            "steps": self._steps,
            "episodes": self._episodes,
            "statistics": (float(rms.mean), float(rms.var), float(rms.count)),
        }
        self._steps, self._episodes = 0, []
        return report


def make_runner_env(context: dict[str, Any]) -> gym.vector.VectorEnv | gym.Env:
    """Environment of a runner, called in its process with ``env_id``, ``env_kwargs``, ``mark``, ``gamma``.

    And ``num_envs`` for turbines that are stepped together.
    """
    if "num_envs" not in context:
        return gym.make(context["env_id"], **context["env_kwargs"])
    env = gym.make_vec(
        context["env_id"],
        num_envs=context["num_envs"],
        vectorization_mode="vector_entry_point",
        threads=1,  # the processor that the runner has reserved
        **context["env_kwargs"],
    )
    return RunnerEnv(env, context["mark"], context["gamma"])


def runner_report(runner: EnvRunner) -> dict[str, Any] | None:
    """Report of the turbines of a runner, asked for in its process; None where it has none."""
    env = _turbines(runner)
    return None if env is None else env.take_report()


def set_runner_statistics(runner: EnvRunner, mean: float, var: float, count: float) -> None:
    """Have the turbines of a runner continue from the statistics of an earlier session."""
    env = _turbines(runner)
    if env is not None:
        vars(env.statistics).update(mean=np.float64(mean), var=np.float64(var), count=count)


def _turbines(runner: EnvRunner) -> RunnerEnv | None:
    """Turbines of a runner, below RLlib's own wrappers."""
    env = runner.env
    while env is not None and not isinstance(env, RunnerEnv):
        env = getattr(env, "env", None)
    return env


def take_weights(model: BaseAlgorithm, weights: Mapping[str, Any]) -> None:
    """Give a model, PPO or SAC of stable-baselines3, the policy of RLlib's module, and PPO its value network too.

    The critics of SAC are built otherwise in RLlib: those of the model stay what they are, and no policy needs them.
    """
    state = model.policy.state_dict()
    for theirs, ours in _names(model):
        parts = [state[name] for name in ours]
        value = torch.as_tensor(weights[theirs])
        for part, piece in zip(parts, value.split([len(part) for part in parts]), strict=True):
            part.copy_(piece)
    model.policy.load_state_dict(state)


def first_weights(model: BaseAlgorithm) -> dict[str, Any]:
    """Weights of a fresh model by RLlib's names: both begin with the same policy, ``log_std_init`` included."""
    state = model.policy.state_dict()
    return {theirs: torch.cat([state[name] for name in ours]).numpy() for theirs, ours in _names(model)}


def _names(model: BaseAlgorithm) -> Iterator[tuple[str, tuple[str, ...]]]:
    """Name in RLlib of each tensor, with those in stable-baselines3 that it is made of, one below the other."""
    squashed = type(model).__name__ == "SAC"
    layers = len(model.policy_kwargs["net_arch"])
    body, encoder = (
        ("actor.latent_pi", "pi_encoder") if squashed else ("mlp_extractor.policy_net", "encoder.actor_encoder")
    )
    heads = ("actor.mu", "actor.log_std") if squashed else ("action_net",)
    for kind in ("weight", "bias"):
        for k in range(0, 2 * layers, 2):  # activations stand between
            yield f"{encoder}.net.mlp.{k}.{kind}", (f"{body}.{k}.{kind}",)
            if not squashed:
                yield f"encoder.critic_encoder.net.mlp.{k}.{kind}", (f"mlp_extractor.value_net.{k}.{kind}",)
        yield f"pi.net.mlp.0.{kind}", tuple(f"{head}.{kind}" for head in heads)
        if not squashed:
            yield f"vf.net.mlp.0.{kind}", (f"value_net.{kind}",)
    if not squashed:
        yield "pi.log_std", ("log_std",)
