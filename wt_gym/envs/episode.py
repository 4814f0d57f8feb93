"""An agent in an environment, from a reset to the end of the episode."""

from collections.abc import Iterator
from typing import Any, NamedTuple, Protocol, cast

import gymnasium as gym
import numpy as np


class Agent(Protocol):
    """Anything with stable-baselines3's ``predict``."""

    def predict(
        self, observation: Any, state: Any = None, episode_start: Any = None, deterministic: bool = True
    ) -> tuple[Any, Any]:
        """Action and state for an observation."""
        ...


class EpisodeStep(NamedTuple):
    """An action and what came of it.

    Attributes
    ----------
    action : numpy.ndarray, shape (n_act,)
    observation : numpy.ndarray, shape (n_obs,)
        After the step.
    reward : float or numpy.ndarray
        Its terms with ``vector_reward``.
    """

    action: np.ndarray
    observation: np.ndarray
    reward: float | np.ndarray
    terminated: bool
    truncated: bool
    info: dict[str, Any]

    @property
    def done(self) -> bool:
        """Return True for the last step."""
        return self.terminated or self.truncated

    @property
    def failed(self) -> bool:
        """Return True if the simulation failed: the signals of the environment are then those of the step before."""
        return "failure" in self.info


def episode_steps(env: gym.Env, agent: Agent, observation: np.ndarray) -> Iterator[EpisodeStep]:
    """Steps of an episode after its reset, made as they are asked for.

    Parameters
    ----------
    env : gymnasium.Env
        Has been reset.
    agent : Agent
        Acts without exploration.
    observation : numpy.ndarray, shape (n_obs,)
        Given by the reset.

    Yields
    ------
    EpisodeStep
        The last one is ``done``.
    """
    state, start, done = None, True, False
    while not done:
        action, state = agent.predict(observation, state=state, episode_start=np.array([start]), deterministic=True)
        answer = cast("tuple[np.ndarray, float | np.ndarray, bool, bool, dict[str, Any]]", env.step(action))
        step = EpisodeStep(action, *answer)
        observation, start, done = step.observation, False, step.done
        yield step
