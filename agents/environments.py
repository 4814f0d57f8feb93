"""Agents by word or path, and the environments that they run in."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

import gymnasium as gym

from wt_gym.agents.choices import PREFIX, controller_of, is_controller_name
from wt_gym.agents.constant import ConstantAgent
from wt_gym.agents.controller_agent import ControllerAgent
from wt_gym.agents.trained_environment import controller_of_training, interface_of_training
from wt_gym.envs.layout import layout_of
from wt_gym.envs.turbine_env import turbine_env_of

if TYPE_CHECKING:
    from collections.abc import Mapping

    from wt_gym.envs.episode import Agent
    from wt_gym.envs.layout import EnvLayout

__all__ = ["Environments", "load_agent"]

_ENDLESS = 10**9  # control steps


def load_agent(choice: str, layout: EnvLayout) -> Agent:
    """Give the agent that a word or path means.

    Parameters
    ----------
    choice : str
        ``"baseline"`` (the controller beneath residual actions, else the baseline controller), ``"constant"``, a
        controller as `wt_gym.agents.choices.controller_of` reads it (beneath residual actions it is the environment's
        matter, and its agent is the constant one), or the path of a trained model or its folder.
    layout : EnvLayout

    Returns
    -------
    Agent
    """
    beneath = layout.action.mode == "residual"
    if choice == "constant" or (beneath and (choice == "baseline" or is_controller_name(choice))):
        return ConstantAgent(layout)
    if choice == "baseline":
        return ControllerAgent(layout)
    if is_controller_name(choice):
        name, parameters = controller_of(choice)
        return ControllerAgent(layout, name, **parameters)
    from wt_gym.agents.trained_agent import TrainedAgent  # torch takes seconds to import

    return TrainedAgent.load(choice)


class Environments:
    """An environment, and those like it with another controller beneath residual actions or another observation.

    Parameters
    ----------
    env_id : str
    env_kwargs : mapping
        Arguments of the environment besides episode length.
    episode_length : float, optional
        The only limit, whatever the length of a task's episodes [s]; None: no limit.

    Attributes
    ----------
    plain : gymnasium.Env
        With the controller that the environment has anyway.
    """

    def __init__(self, env_id: str, env_kwargs: Mapping[str, Any], episode_length: float | None = None):
        self._id, self._kwargs, self._length = env_id, dict(env_kwargs), episode_length
        self._made: dict[tuple[str | None, str], gym.Env] = {}
        self.plain = self._make(None, {})

    def beneath(self, given: str | Agent, record: Mapping[str, Any], as_given: bool = False) -> gym.Env:
        """Environment for an agent: the plain one, except for a controller that has to run beneath the actions.

        A trained model sees what it saw in its training, and its residual actions mean what they meant.

        Parameters
        ----------
        given : str or Agent
            Word, path or agent.
        record : mapping
            Of the agent's training, empty without one: a trained model runs on the controller of its training, a
            controller by name beneath actions that rest.
        as_given : bool
            A trained model runs on the controller that is there, and its actions mean what they mean there.
        """
        own = None if as_given else controller_of_training(record, self.plain)
        residual = layout_of(self.plain).action.mode == "residual"
        choice = given if residual and isinstance(given, str) and is_controller_name(given) else own
        return self._make(choice, interface_of_training(record, self.plain, meaning=not as_given))

    def _make(self, choice: str | None, seen: Mapping[str, Any]) -> gym.Env:
        key = choice, json.dumps(seen, sort_keys=True)
        if key not in self._made:
            more = dict(seen)
            if choice is not None:
                more["controller"] = choice.removeprefix(PREFIX)
            self._made[key] = gym.make(
                self._id, **self._kwargs | more, episode_length=self._length, max_episode_steps=_ENDLESS
            )
            turbine_env_of(self._made[key]).outer_steps = _ENDLESS
        return self._made[key]

    def close(self) -> None:
        """Close all."""
        for env in self._made.values():
            env.close()
