"""Environments of agents: those of their training, and those that an experiment runs them in."""

import json
import platform
from collections.abc import Iterable, Mapping
from contextlib import ExitStack, closing
from typing import Any, Self, cast

import gymnasium as gym
import numpy as np
from gymnasium.envs.registration import EnvSpec

from wt_gym.base.canary import differing
from wt_gym.base.files import json_values
from wt_gym.control.controllers import make_controller, supervisor_of
from wt_gym.control.controllers.names import ALIASES, BASELINE, PREFIX
from wt_gym.envs.episode import Agent
from wt_gym.envs.layout import layout_of
from wt_gym.envs.options import argument_default, flat_arguments, registered_arguments
from wt_gym.envs.turbine_env import turbine_env_of
from wt_gym.experiment.agents import load_agent, load_model
from wt_gym.experiment.execute import Experiment
from wt_gym.experiment.names import env_choices_of, fingerprint, is_base_controller, read_name
from wt_gym.experiment.run import ENDLESS, benchmark_fingerprint

_COMPARED = {"relative_reward": False, "reward_credit": False, "starts": None}
"""The baseline runs in the same wind and is compared afterwards; starts of a training are none of an evaluation."""


def compile_kernels(env: gym.Env) -> None:
    """Run one step, so that every kernel is in the cache that worker processes share, and close the environment."""
    env.reset(seed=0)
    env.step(np.zeros(env.action_space.shape, dtype=np.float32))
    env.close()


# ---- the environment of a training ----


KEPT = (
    "action_spans", "residual_fade", "residual_washout", "residual_form", "controller", "sensor_noise", "sensor_delay",
    "sensor_washout", "sensors",
)  # fmt: skip
"""Arguments of the environment that decide on what actions and observations of the same names mean. Turbine, fidelity,
inflow and wind are not among them: to carry an agent over to others is an experiment."""
_SEEN = ("observation", "history", "sensor_washout")
_MEANT = ("pitch", "action_components", "action_spans", "residual_fade", "residual_washout", "residual_form")


def resolved_arguments(env_id: str, env_kwargs: Mapping[str, Any]) -> dict[str, Any]:
    """Arguments of an environment, registered and given ones, as a record stores them: JSON values.

    An id may mean other arguments in a later version of the package; a record says what they were.
    """
    return json_values(registered_arguments(env_id, env_kwargs))


def trained_arguments(record: Mapping[str, Any]) -> dict[str, Any]:
    """Arguments of the environment of a training, registered and given ones; empty if its record does not say."""
    return dict(record.get("environment", {}))


def training_arguments(
    record: Mapping[str, Any] | None, env_kwargs: dict[str, Any], model: str | None = None
) -> dict[str, Any]:
    """Arguments of the environment of a training, which must be known: of the record, else of a card (``env_kwargs``).

    ``model`` is the path of the model, for the message. Raises a `ValueError` if neither says what the environment was.
    """
    arguments = trained_arguments(record or {}) or env_kwargs
    if not arguments:
        of = "" if model is None else f" of {model}"
        raise ValueError(
            f"the environment of the training{of} must be known, by training.json beside the model or a card "
            'MODEL.json with "env_kwargs"; got neither'
        )
    return arguments


def environment_of_training(record: Mapping[str, Any], names: Iterable[str]) -> dict[str, Any]:
    """Named arguments of the environment of a training, defaults included, as JSON values; empty if it is unknown.

    In another id than that of the training an argument that is not named would have the value of that id.
    """
    arguments = trained_arguments(record)
    return _with_defaults(arguments, names) if arguments else {}


def controller_of_training(record: Mapping[str, Any], env: gym.Env) -> str | None:
    """Base controller by name of the training of a model, where an environment has another one.

    Under residual actions it belongs to the agent: the model without it is not the trained one. None where the actions
    have no base controller, the controllers are the same, or the record has no name for it.
    """
    if not (trained_arguments(record) and layout_of(env).action.needs_controller):
        return None
    given = flat_arguments(cast(EnvSpec, env.spec).kwargs)
    trained, here = (_kept(arguments)["controller"] for arguments in (trained_arguments(record), given))
    if not isinstance(trained, str) or (isinstance(here, str) and read_name(trained) == read_name(here)):
        return None
    return trained if trained != here and read_name(trained).kind in ("controller", "class") else None


def interface_of_training(record: Mapping[str, Any], env: gym.Env, meaning: bool = True) -> dict[str, Any]:
    """Observation of a model and meaning of its residual actions in its training, where an environment has others.

    Both belong to the model, as in the benchmark. Empty where the environment has the same, or the record does not say;
    without ``meaning``, observation and history only.
    """
    residual = layout_of(env).action.mode == "residual"
    names = (*_SEEN, *_MEANT) if meaning and residual else _SEEN
    trained = environment_of_training(record, names)
    here = _with_defaults(flat_arguments(cast(EnvSpec, env.spec).kwargs), names)
    return trained if trained != here else {}


def check_environment(record: Mapping[str, Any], env: gym.Env) -> None:
    """Refuse an environment in which observation and actions of a model mean something else than in its training.

    Raises a `ValueError` with the arguments out of `KEPT` that differ. Nothing is refused where the record does not say
    what the environment of the training was.
    """
    if not trained_arguments(record):
        return
    trained, here = _kept(trained_arguments(record)), _kept(flat_arguments(cast(EnvSpec, env.spec).kwargs))
    if not layout_of(env).action.needs_controller:
        del trained["controller"], here["controller"]  # the actions have no base controller
    differing = [f"{name} {trained[name]!r}, here {here[name]!r}" for name in trained if trained[name] != here[name]]
    if differing:
        raise ValueError(
            f"the model is for another environment: with {'; '.join(differing)}; give the environment the "
            "same, or ask for the other one by --allow-other-environment (allow_other_environment=True)"
        )


def _kept(arguments: Mapping[str, Any]) -> dict[str, Any]:
    """Values of `KEPT`, as a record would have them."""
    values = _with_defaults(arguments, KEPT)
    return values | {"action_spans": values["action_spans"] or {}}


def _with_defaults(arguments: Mapping[str, Any], names: Iterable[str]) -> dict[str, Any]:
    """Arguments of these names, the environment's defaults where they are not given, as JSON values."""
    values = {name: arguments.get(name, argument_default(name)) for name in names}
    return json_values(values)


def with_common_step(agents: Mapping[str, str | Agent], env_id: str, env_kwargs: Mapping[str, Any]) -> dict[str, Any]:
    """Arguments of an environment in which all trained models among agents can act, where they say no control step.

    It is the shortest of their trainings, if that is shorter than the environment's: the others hold their actions.
    """
    models = [each for each in agents.values() if isinstance(each, str) and read_name(each).kind == "trained"]
    if not models or "control_dt" in flat_arguments(env_kwargs):
        return dict(env_kwargs)
    here = registered_arguments(env_id, env_kwargs).get("control_dt", argument_default("control_dt"))
    steps = [(load_model(read_name(model)).record or {}).get("control_dt", here) for model in models]
    return {**env_kwargs, "control_dt": min(steps)} if min(steps) < here else dict(env_kwargs)


# ---- the environments of an experiment ----


class Environments:
    """An environment, and those like it with another base controller or another observation.

    Parameters
    ----------
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

    def environment_of(self, given: str | Agent, record: Mapping[str, Any], as_given: bool = False) -> gym.Env:
        """Environment for an agent: the plain one, except for an agent that brings its base controller.

        A trained model sees what it saw in its training, and its residual actions mean what they meant. A class of
        yours, or a model of another training, has the arguments that it chooses
        (`wt_gym.experiment.names.env_choices_of`).

        Parameters
        ----------
        given : str or Agent
            Word, path or agent; a controller by name is the base controller of zero actions.
        record : mapping
            Of the agent's training, empty without one: a trained model runs on the controller of its training.
        as_given : bool
            A trained model runs on the controller that is there, and its actions mean what they mean there.
        """
        choice = None if as_given else controller_of_training(record, self.plain)
        chosen = env_choices_of(given) if isinstance(given, str) else {}
        if layout_of(self.plain).action.mode == "residual" and isinstance(given, str) and is_base_controller(given):
            here = registered_arguments(self._id, self._kwargs).get("controller", BASELINE)
            same = given in ALIASES or (isinstance(here, str) and read_name(here) == read_name(given))
            choice = None if same else given
            chosen = chosen if choice is None else self._without_foreign(choice) | chosen
        return self._make(choice, interface_of_training(record, self.plain, meaning=not as_given) | chosen)

    def _without_foreign(self, choice: str) -> dict[str, Any]:
        """Actions and observation without what a controller lacks: its actions are zero, and look at nothing."""
        here, left = registered_arguments(self._id, self._kwargs), {"observation": ("rotor",)}
        components = here.get("action_components") or ()
        if "set_point" in components:
            controller = make_controller(choice.removeprefix(PREFIX), layout_of(self.plain).turbine)
            if supervisor_of(controller) is None:
                left["action_components"] = tuple(name for name in components if name != "set_point")
        return left

    def _make(self, choice: str | None, seen: Mapping[str, Any]) -> gym.Env:
        key = choice, json.dumps(seen, sort_keys=True)
        if key not in self._made:
            more = dict(seen) | ({} if choice is None else {"controller": choice.removeprefix(PREFIX)})
            self._made[key] = gym.make(
                self._id, **self._kwargs | more | _COMPARED, episode_length=self._length, max_episode_steps=ENDLESS
            )
            turbine_env_of(self._made[key]).outer_steps = ENDLESS
        return self._made[key]

    def close(self) -> None:
        """Close all."""
        for env in self._made.values():
            env.close()


class AgentExperiment(Experiment):
    """Rows of agents by name, each in its environment; a context, which closes these.

    Other processes load the agents and make the environments once for all their rows: these agents must have come by
    word or path.

    Parameters
    ----------
    agents : mapping
        Name to agent, or to a word or path for `wt_gym.experiment.agents.load_agent`.
    env_id, env_kwargs, episode_length
        As of `Environments`.
    as_given : bool
        Run trained models in the environment as it is, on top of its controller, whatever they were trained in; they
        see what they saw in their training.

    Attributes
    ----------
    env : gymnasium.Env
        With the controller that the environment has anyway.
    agents : dict
        Name to agent.

    Raises
    ------
    ValueError
        If a model was trained in another environment, with its name and what differs.
    """

    def __init__(
        self, agents: Mapping[str, str | Agent], env_id: str, env_kwargs: Mapping[str, Any],
        episode_length: float | None = None, as_given: bool = False,
    ):  # fmt: skip
        self._given, self._where = dict(agents), (env_id, dict(env_kwargs), episode_length)
        self._as_given, self._identity = as_given, None
        self.prepare()

    def prepare(self) -> None:
        """Make agents and environments in this process."""
        self._environments = Environments(*self._where)
        with ExitStack() as refused:
            refused.callback(self._environments.close)
            self.env = self._environments.plain
            self.agents: dict[str, Agent] = {}
            self._environment_of_agent = {name: self._place(name) for name in self._given}
            refused.pop_all()  # nothing is: the context closes them

    def _place(self, name: str) -> gym.Env:
        """Environment that an agent runs in."""
        choice = self._given[name]
        is_model = isinstance(choice, str) and read_name(choice).kind == "trained"
        source = load_model(read_name(cast(str, choice))) if is_model else choice
        record = getattr(source, "record", None) or {}
        env = self._environments.environment_of(choice, record, self._as_given)
        agent = load_agent(source, layout_of(env), env) if isinstance(source, str) else source
        self.agents[name] = agent
        try:
            enter = getattr(agent, "enter", None) or getattr(agent, "check_fits", None)
            if enter is not None:
                enter(layout_of(env))
            if not self._as_given:
                check_environment(record, env)
        except ValueError as error:
            raise ValueError(f"{name}: {error}") from error
        return env

    def __getitem__(self, name: str) -> tuple[gym.Env, Agent]:
        """Environment and agent of a name."""
        return self._environment_of_agent[name], self.agents[name]

    def __getstate__(self) -> dict[str, Any]:
        """Leave environments and agents to the other process, and tell it what they must be."""
        if self._identity is None:
            models = {name: fingerprint(cast(str, choice)) for name, choice in self._given.items()}
            env = turbine_env_of(self.env)
            self._identity = models, benchmark_fingerprint(env.turbine, env.fidelity)
        made = ("_environments", "env", "agents", "_environment_of_agent")
        return {name: value for name, value in vars(self).items() if name not in made}

    _identity: tuple[dict[str, dict[str, Any]], dict[str, Any]] | None
    """Fingerprints of the models and of the package in the process that gives the work."""

    def warm(self) -> None:
        """Have the kernels in the cache of a machine whose behavior and models are those of the process that asks."""
        models, behavior = ({}, None) if self._identity is None else self._identity
        if other := [name for name, model in models.items() if fingerprint(model["choice"]) != model]:
            raise ValueError(f"the files of {', '.join(other)} differ on {platform.node()}")
        with closing(Environments(*self._where)) as environments:
            env = turbine_env_of(environments.plain)
            if behavior and (other := differing(behavior, benchmark_fingerprint(env.turbine, env.fidelity))):
                raise ValueError(f"wt_gym on {platform.node()} has another {' and '.join(other)}")
            compile_kernels(environments.plain)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exception: object) -> None:
        """Close the environments."""
        self._environments.close()
