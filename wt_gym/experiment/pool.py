"""Agents by name, each with the environment it runs in, in this process and in those of an executor."""

from __future__ import annotations

import inspect
import json
import platform
from contextlib import ExitStack, closing
from functools import partial
from typing import TYPE_CHECKING, Any, cast

import gymnasium as gym

from wt_gym.base.canary import differing
from wt_gym.benchmark.run import benchmark_fingerprint
from wt_gym.control.controllers import make_controller, supervisor_of
from wt_gym.control.controllers.names import ALIASES, Name, call_maker, load_class
from wt_gym.envs.layout import layout_of
from wt_gym.envs.options import registered_arguments
from wt_gym.envs.turbine_env import turbine_env_of
from wt_gym.experiment.compilation import compile_kernels
from wt_gym.experiment.constant import ConstantAgent
from wt_gym.experiment.controller_agent import ControllerAgent
from wt_gym.experiment.names import BASELINE, PREFIX, env_choices_of, fingerprint, is_base_controller, read_name
from wt_gym.experiment.planning import ShootingPlanner
from wt_gym.experiment.trained_environment import check_environment, controller_of_training, interface_of_training
from wt_gym.experiment.uniform import UniformAgent

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence

    from wt_gym.envs.episode import Agent
    from wt_gym.envs.layout import EnvLayout
    from wt_gym.experiment.trained_agent import TrainedAgent
    from wt_gym.runs.executors import Executor

__all__ = ["AgentPool", "Environments", "load_agent", "load_model"]

_ENDLESS = 10**9  # control steps
_COMPARED = {"relative_reward": False, "starts": None}
"""The baseline runs in the same wind and is compared afterwards; beginnings of a training are none of an evaluation."""


def load_agent(choice: str, layout: EnvLayout, env: gym.Env | None = None) -> Agent:
    """Give the agent that a name means.

    Parameters
    ----------
    choice : str
        As of `wt_gym.experiment.names.read_name`: ``"zero"``, ``"random"``, ``"planner"``, a controller or a class of
        yours that makes one (under residual actions the environment runs it, and its agent gives zero actions), a
        class with ``predict``, or the path of a trained model. ``"baseline"`` is the base controller of residual
        actions, else the turbine's own.
    layout : EnvLayout
        Of the environment that it runs in.
    env : gymnasium.Env, optional
        That environment, for a planner.

    Returns
    -------
    Agent

    Raises
    ------
    ValueError
        If there is no such agent, or what a class makes has no ``predict``.
    """
    name = read_name(choice)
    if name.kind == "word":
        return _by_word(name, layout, env)
    if name.kind == "trained":
        return load_model(name)
    if not is_base_controller(choice):
        return _of_own_class(name, layout)
    if layout.action.mode == "residual":
        return ConstantAgent(layout)
    return ControllerAgent(layout, name.target, **name.parameters)


def load_model(name: Name) -> TrainedAgent:
    """Load the trained model that a name means, with what the name says of it."""
    from wt_gym.experiment.trained_agent import TrainedAgent, model_card  # torch takes seconds to import

    algorithm = name.parameters.get("algo") or model_card(name.target, name.parameters.get("env")).get("algo")
    return TrainedAgent.load(name.target, algorithm, trust=bool(name.parameters.get("trust", False)))


def _by_word(name: Name, layout: EnvLayout, env: gym.Env | None) -> Agent:
    """Agent of a word."""
    if name.target == "zero":
        return ConstantAgent(layout)
    if name.target == "random":
        return UniformAgent(layout)
    if env is None:
        raise ValueError("a planner needs the environment that it plans in")
    return ShootingPlanner(env, **name.parameters)


def _of_own_class(name: Name, layout: EnvLayout) -> Agent:
    """Agent of a class of the user's, which gets the layout where it takes one."""
    maker = load_class(name.target)
    given = {"layout": layout} if "layout" in inspect.signature(maker).parameters else {}
    agent: Agent = call_maker(name.target, partial(maker, **given), name.parameters)
    if not callable(getattr(agent, "predict", None)):
        raise ValueError(f"{name.target} must make an agent with predict, got {agent!r}")
    return agent


class Environments:
    """An environment, and those like it with another base controller or another observation.

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

    def environment_of(self, given: str | Agent, record: Mapping[str, Any], as_given: bool = False) -> gym.Env:
        """Environment for an agent: the plain one, except for an agent that brings its base controller.

        A trained model sees what it saw in its training, and its residual actions mean what they meant. A class
        of yours, or a model of another training, has what it chooses for itself
        (`wt_gym.experiment.names.env_choices_of`).

        Parameters
        ----------
        given : str or Agent
            Word, path or agent.
        record : mapping
            Of the agent's training, empty without one: a trained model runs on the controller of its training, a
            controller by name is the base controller of zero actions.
        as_given : bool
            A trained model runs on the controller that is there, and its actions mean what they mean there.
        """
        own = None if as_given else controller_of_training(record, self.plain)
        chosen = env_choices_of(given) if isinstance(given, str) else {}
        choice = own
        if layout_of(self.plain).action.mode == "residual" and isinstance(given, str) and is_base_controller(given):
            choice = None if given in ALIASES else self._other(given)
            chosen = chosen if choice is None else self._without_supervisor(choice) | chosen
        return self._make(choice, interface_of_training(record, self.plain, meaning=not as_given) | chosen)

    def _other(self, choice: str) -> str | None:
        """Controller as a name, None where it is the one that the environment has anyway."""
        here = registered_arguments(self._id, self._kwargs).get("controller", BASELINE)
        same = isinstance(here, str) and read_name(here) == read_name(choice)
        return None if same else choice

    def _without_supervisor(self, choice: str) -> dict[str, Any]:
        """Actions and observation without what a supervisor has, for a controller without one: its actions are zero."""
        here = registered_arguments(self._id, self._kwargs)
        left = {
            key: tuple(name for name in given if name != foreign)
            for key, foreign in (("action_components", "set_point"), ("observation", "supervisor"))
            if isinstance(given := here.get(key), list | tuple) and foreign in given
        }
        if not left or supervisor_of(make_controller(choice.removeprefix(PREFIX), layout_of(self.plain).turbine)):
            return {}
        return left

    def _make(self, choice: str | None, seen: Mapping[str, Any]) -> gym.Env:
        key = choice, json.dumps(seen, sort_keys=True)
        if key not in self._made:
            more = dict(seen)
            if choice is not None:
                more["controller"] = choice.removeprefix(PREFIX)
            self._made[key] = gym.make(
                self._id, **self._kwargs | more | _COMPARED, episode_length=self._length, max_episode_steps=_ENDLESS
            )
            turbine_env_of(self._made[key]).outer_steps = _ENDLESS
        return self._made[key]

    def close(self) -> None:
        """Close all."""
        for env in self._made.values():
            env.close()


class AgentPool:
    """Agents, each with the environment it runs in; a context, which closes these.

    Parameters
    ----------
    agents : mapping
        Name to agent, or to a word or path for `load_agent`.
    env_id, env_kwargs, episode_length
        As of `Environments`.
    as_given : bool
        Run trained models in the environment as it is, on top of its controller, whatever they were trained in; they
        see what they saw in their training.

    Raises
    ------
    ValueError
        If a model was trained in another environment, with its name and what differs.

    Attributes
    ----------
    env : gymnasium.Env
        With the controller that the environment has anyway.
    agents : dict
        Name to agent.
    """

    def __init__(
        self,
        agents: Mapping[str, str | Agent],
        env_id: str,
        env_kwargs: Mapping[str, Any],
        episode_length: float | None = None,
        as_given: bool = False,
    ):
        self._given, self._where = dict(agents), (env_id, dict(env_kwargs), episode_length)
        self._as_given, self._environments = as_given, Environments(*self._where)
        with ExitStack() as refused:
            refused.callback(self._environments.close)
            self.env = self._environments.plain
            self.agents: dict[str, Agent] = {}
            self._environment_of_agent = {name: self._place(name) for name in agents}
            refused.pop_all()  # nothing is: the context closes them

    def _place(self, name: str) -> gym.Env:
        """Environment that an agent runs in."""
        given = self._given[name]
        found = load_model(read_name(given)) if isinstance(given, str) and read_name(given).kind == "trained" else given
        record = getattr(found, "record", None) or {}
        env = self._environments.environment_of(given, record, self._as_given)
        self.agents[name] = agent = load_agent(found, layout_of(env), env) if isinstance(found, str) else found
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

    def results(
        self,
        play: Callable[[AgentPool, Any], Any],
        executor: Executor,
        jobs: Sequence[Any],
    ) -> Iterator[tuple[Any, Any]]:
        """Do jobs; give each with its result as soon as it is done.

        Parameters
        ----------
        play : callable
            Does a job with the pool; a function of a module, or a `functools.partial` of one.
        executor : Executor
            Other processes load the agents and make the environments once for all their jobs; these agents must have
            come by word or path.
        jobs : sequence

        Raises
        ------
        ValueError
            If the behavior of the package, or a model, is another one on another machine.
        """
        if not executor.beside:
            return executor.results(partial(play, self), jobs)
        env = turbine_env_of(self.env)
        models = {name: fingerprint(cast(str, choice)) for name, choice in self._given.items()}
        warm = partial(_warm, self._where, models, benchmark_fingerprint(env.turbine, env.fidelity))
        given = (play, self._given, *self._where, self._as_given)
        return executor.results(_play_here, jobs, begin=_get_ready, given=given, warm=warm)

    def __enter__(self) -> AgentPool:
        return self

    def __exit__(self, *exception: object) -> None:
        """Close the environments."""
        self._environments.close()


def _warm(
    where: tuple[str, dict[str, Any], float | None],
    models: dict[str, dict[str, Any]],
    expected: dict[str, Any],
) -> None:
    """Have the kernels in the cache of a machine.

    Raises
    ------
    ValueError
        If behavior or models are not those of the process that gives the work.
    """
    if other := [name for name, known in models.items() if fingerprint(known["choice"]) != known]:
        raise ValueError(f"the files of {', '.join(other)} differ on {platform.node()}")
    with closing(Environments(*where)) as environments:
        env = turbine_env_of(environments.plain)
        if other := differing(expected, benchmark_fingerprint(env.turbine, env.fidelity)):
            raise ValueError(f"wt_gym on {platform.node()} has another {' and '.join(other)}")
        compile_kernels(environments.plain)


_play: Callable[[Any], Any] | None = None
"""What a worker process does with a job."""


def _get_ready(play: Callable[[AgentPool, Any], Any], *given: Any) -> None:
    """Begin as a worker process."""
    global _play
    _play = partial(play, AgentPool(*given))


def _play_here(job: Any) -> Any:
    """Do a job in a worker process."""
    return cast("Callable[[Any], Any]", _play)(job)
