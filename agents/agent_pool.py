"""Agents that are compared: each with the environment it runs in, in this process and in those of an executor."""

from __future__ import annotations

import platform
from contextlib import ExitStack, closing
from functools import partial
from typing import TYPE_CHECKING, Any, cast

from wt_gym.agents.choices import fingerprint, read_name
from wt_gym.agents.compilation import compile_kernels
from wt_gym.agents.environments import Environments, load_agent, load_model
from wt_gym.agents.trained_environment import check_environment
from wt_gym.benchmark.fingerprint import differing
from wt_gym.deprecated import renamed_names
from wt_gym.envs.layout import layout_of
from wt_gym.envs.turbine_env import turbine_env_of

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence

    import gymnasium as gym

    from wt_gym.agents.executors import Executor
    from wt_gym.envs.episode import Agent

__all__ = ["AgentPool"]

if not TYPE_CHECKING:  # which would take every name for one of this module
    __getattr__ = renamed_names(__name__)


class AgentPool:
    """Agents, each with the environment it runs in; a context, which closes these.

    Parameters
    ----------
    agents : mapping
        Name to agent, or to a word or path for `wt_gym.agents.environments.load_agent`.
    env_id, env_kwargs, episode_length
        As of `wt_gym.agents.environments.Environments`.
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
        jobs: Sequence[Any],
        executor: Executor,
        code_of: Callable[..., dict[str, str]],
    ) -> Iterator[tuple[Any, Any]]:
        """Do jobs; give each with its result as soon as it is done.

        Parameters
        ----------
        play : callable
            Does a job with contenders; a function of a module, or a `functools.partial` of one.
        jobs : sequence
        executor : Executor
            Other processes load the agents and make the environments once for all their jobs; these agents must have
            come by word or path.
        code_of : callable
            Gives digests of the code for turbine and fidelity, which must be the same on all machines; as ``play``.

        Raises
        ------
        ValueError
            If code or models are others on another machine.
        """
        if not executor.beside:
            return executor.results(partial(play, self), jobs)
        env = turbine_env_of(self.env)
        models = {name: fingerprint(cast(str, choice)) for name, choice in self._given.items()}
        warm = partial(_warm, self._where, models, code_of, code_of(env.turbine, env.fidelity))
        given = (play, self._given, *self._where, self._as_given)
        return executor.results(_play_here, jobs, begin=_get_ready, given=given, warm=warm)

    def __enter__(self) -> AgentPool:
        return self

    def __exit__(self, *exception) -> None:
        """Close the environments."""
        self._environments.close()


def _warm(where: tuple, models: dict[str, dict[str, Any]], code_of, code: dict[str, str]) -> None:
    """Have the kernels in the cache of a machine.

    Raises
    ------
    ValueError
        If code or models are not those of the process that gives the work.
    """
    if other := [name for name, known in models.items() if fingerprint(known["choice"]) != known]:
        raise ValueError(f"the files of {', '.join(other)} differ on {platform.node()}")
    with closing(Environments(*where)) as environments:
        env = turbine_env_of(environments.plain)
        if other := differing(code, code_of(env.turbine, env.fidelity)):
            raise ValueError(f"wt_gym on {platform.node()} has other code: {', '.join(other)}")
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
