"""Rewards as vectors, in the convention of MO-Gymnasium (Felten et al., NeurIPS 2023), which need not be installed.

``step`` gives an array in place of a number; ``unwrapped.reward_space`` and ``unwrapped.reward_dim`` describe it, which
is where that library's wrappers and learners look.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, cast

import gymnasium as gym
import numpy as np
from gymnasium import spaces

from wt_gym.base.options import shown
from wt_gym.envs.dial import DIALED, factor_of
from wt_gym.envs.options.dial import DIAL_NAMES
from wt_gym.envs.turbine_env import turbine_env_of

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

__all__ = ["PROTECTION", "VectorReward"]

PROTECTION = "protection"
"""Objective of the terms that no factor of a dial is for, and of the penalty for an early end."""
_END = "termination"


class VectorReward(gym.Wrapper[np.ndarray, np.ndarray, np.ndarray, np.ndarray], gym.utils.RecordConstructorArgs):
    """The reward of any task as a vector of objectives, without the factors of a dial.

    Each objective is the sum of its reward terms with the weights of the task, relative to the base controller where
    the reward is. The objectives add up to the reward; with a dial, those of fatigue, power and travel do so times its
    factors.

    Parameters
    ----------
    env : gymnasium.Env
        With a `wt_gym.envs.turbine_env.WindTurbineEnv` inside whose reward is a number.
    objectives : {"dial", "terms"} or mapping of str to sequence of str
        ``"dial"``: fatigue, power, travel and `PROTECTION`. ``"terms"``: each term over its weight, and the end of the
        episode as -1. A mapping: names of objectives to those of their terms; others, and the penalty for an early end,
        are `PROTECTION`.

    Attributes
    ----------
    objectives : tuple of str
        Names of the components.

    Raises
    ------
    ValueError
        If the reward is a vector already, or there is no such term.
    """

    def __init__(self, env: gym.Env[Any, Any], objectives: str | Mapping[str, Sequence[str]] = "dial"):
        gym.utils.RecordConstructorArgs.__init__(self, objectives=objectives)
        gym.Wrapper.__init__(self, env)
        self._plain = plain = turbine_env_of(env)
        if plain.options.rewards.vector:
            raise ValueError("the reward of the environment must be a number, got vector_reward=True")
        self._weights = {term.name: float(term.weight) for term in plain.reward_terms}
        self._alone = objectives == "terms"
        kinds: dict[str, tuple[str, ...]] = {name: (name,) for name in (*self._weights, _END)}
        if self._alone:
            self._weights |= {_END: plain.termination_penalty or 1.0}
        else:
            kinds = self._kinds(objectives)
        self._index = {term: k for k, terms in enumerate(kinds.values()) for term in terms}
        self.objectives = tuple(kinds)
        inner = cast(Any, plain)
        inner.reward_space = spaces.Box(-np.inf, np.inf, (len(kinds),), np.float32)
        inner.reward_dim = len(kinds)

    def _kinds(self, objectives: str | Mapping[str, Sequence[str]]) -> dict[str, tuple[str, ...]]:
        """Terms by objective."""
        if objectives == "dial":
            chosen = {name: tuple(t for t in DIALED[name] if t in self._weights) for name in DIAL_NAMES}
        elif isinstance(objectives, str):
            raise ValueError(f"objectives must be 'dial', 'terms' or a mapping, got {objectives!r}")
        else:
            chosen = {name: tuple(terms) for name, terms in objectives.items()}
        given = [term for terms in chosen.values() for term in terms]
        if unknown := [term for term in given if term not in self._weights]:
            raise ValueError(f"objectives must have terms among {', '.join(self._weights)}, got {shown(unknown)}")
        if len(set(given)) != len(given) or PROTECTION in chosen:
            raise ValueError(
                f"objectives must have each term once and no name {PROTECTION!r}, got {shown(dict(chosen))}"
            )
        return {**chosen, PROTECTION: (*(t for t in self._weights if t not in given), _END)}

    def step(self, action: Any) -> tuple[np.ndarray, np.ndarray, bool, bool, dict[str, Any]]:
        """As of the environment, with a reward of shape (n_objectives,), float32.

        ``info["objectives"]`` has it by name, ``info["scalar_reward"]`` the reward of the environment.
        """
        dial = self._plain.dial  # that holds for this step
        factors = None if dial is None else tuple(dial.values())
        observation, reward, terminated, truncated, info = self.env.step(action)
        vector = np.zeros(len(self.objectives))
        for name, value in info["reward_terms"].items():
            plain = value if factors is None else value / factor_of(name, factors)
            vector[self._index[name]] += plain / self._weights[name] if self._alone else plain
        found = vector.astype(np.float32)
        info = info | {
            "objectives": dict(zip(self.objectives, found.tolist(), strict=True)),
            "scalar_reward": float(cast(Any, reward)),
        }
        return observation, found, terminated, truncated, info
