"""What a name on the command line of the server means."""

from __future__ import annotations

import logging
from typing import TYPE_CHECKING, Any

from wt_gym.base.errors import ControllerError
from wt_gym.control.controllers.names import load_class
from wt_gym.deployment.serving.own_set_points import OwnSetPoints
from wt_gym.deployment.serving.served_agent import ServedAgent
from wt_gym.envs.options.environment import flat_arguments, registered_arguments
from wt_gym.envs.turbine_env import WindTurbineEnv
from wt_gym.experiment.names import env_choices_of, read_name
from wt_gym.experiment.pool import load_agent, load_model
from wt_gym.experiment.trained_environment import training_arguments
from wt_gym.tasks import DEFAULT_ENV

if TYPE_CHECKING:
    from collections.abc import Mapping

    from wt_gym.bridges.rosco.server import Answers
    from wt_gym.control.controllers import Name

__all__ = ["answers_of"]

_log = logging.getLogger(__name__)
_NOT_RUN = {
    "controller": "discon", "start": "steady", "sensor_noise": 0.0, "relative_reward": False, "episode_length": None,
}  # fmt: skip
"""Of an environment that tells what an agent sees and does, but is not run: ROSCO is its base controller."""

_OF_THE_CONTROLLER = ("disturbance_", "linear_pitch_", "model_", "dead_band_")
"""Beginnings of the names of channels that a base controller knows and ROSCO does not."""


def answers_of(
    choice: str, env_id: str | None = None, turbine: str | None = None, lead: float | None = None
) -> Answers:
    """What answers turbines under ROSCO.

    Parameters
    ----------
    choice : str
        A trained agent, a class of yours with ``predict`` or with ``update_setpoints``, ``"zero"`` or ``"random"``.
    env_id : str, optional
        Environment of a class or word, by default `DEFAULT_ENV`; that of a trained agent is the one of its training.
    turbine : str, optional
        Of a class or word.
    lead : float, optional
        As of `ServedAgent`.

    Raises
    ------
    wt_gym.base.errors.ControllerError
        For a controller, or an agent for which ROSCO's interface has no room.
    ValueError
        If there is no such agent, or an environment is given to one that has its own.
    """
    name = read_name(choice)
    if name.kind == "trained":
        if env_id is not None or turbine is not None:
            raise ValueError("environment and turbine are those of the agent's training; they must be left out")
        return _trained(name, lead)
    if name.kind == "class":
        maker = load_class(name.target)
        if callable(getattr(maker, "update_setpoints", None)):
            return OwnSetPoints(lambda: maker(**name.parameters))
        if not callable(getattr(maker, "predict", None)):
            raise ControllerError(
                f"a class that is served must have predict, of an agent, or update_setpoints, got {name.target}"
            )
    elif name.kind == "controller":
        raise ControllerError(
            f"ROSCO's interface takes offsets on ROSCO's own demands; the controller {name.text} gives the demands "
            "themselves. What is served must be an agent of residual actions, or a class with update_setpoints"
        )
    given: dict[str, Any] = {} if turbine is None else {"turbine": turbine}
    if name.kind == "word":  # which looks at nothing
        given |= {"observation": ["rotor_speed"], "action_components": ["pitch"], "residual_fade": False}
    env = _environment(registered_arguments(env_id or DEFAULT_ENV, given | env_choices_of(choice)))
    return ServedAgent(lambda: load_agent(choice, env.layout), env, lead)


def _environment(arguments: Mapping[str, Any]) -> WindTurbineEnv:
    flat = flat_arguments(arguments)
    base = flat.get("controller", "discon")
    _log.info("ROSCO is the base controller; in the agent's environment it is %s", base)
    return WindTurbineEnv(**(flat | _NOT_RUN))


def _trained(name: Name, lead: float | None) -> ServedAgent:
    from wt_gym.experiment.trained_agent import model_card  # torch takes seconds to import

    agent = load_model(name)
    card = model_card(name.target, name.parameters.get("env")).get("env_kwargs", {})
    inside = [seen for seen in (agent.record or {}).get("observation", ()) if str(seen).startswith(_OF_THE_CONTROLLER)]
    if inside:
        raise ControllerError(
            f"the agent must see what ROSCO sends, got {', '.join(inside[:3])} and the like, which its own base "
            "controller knows; export it instead (wt-gym export), with that controller"
        )
    env = _environment(training_arguments(agent.record, card, name.target))
    agent.enter(env.layout)
    return ServedAgent(lambda: agent, env, lead)
