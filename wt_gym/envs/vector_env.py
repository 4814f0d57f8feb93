"""Many turbines in one process, stepped by threads: the compiled step of the simulator lets others run meanwhile."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor, wait
from dataclasses import replace
from typing import Any, NamedTuple, cast

import gymnasium as gym
import numpy as np
from gymnasium import spaces
from gymnasium.error import ClosedEnvironmentError, ResetNeeded
from gymnasium.vector import AutoresetMode
from gymnasium.vector.utils import batch_space

from wt_gym.base.errors import did_you_mean
from wt_gym.base.options import shown
from wt_gym.base.processes import one_blas_thread
from wt_gym.envs.manual import describe
from wt_gym.envs.options import EnvOptions, PlainSpec
from wt_gym.envs.turbine_env import WindTurbineEnv
from wt_gym.simulation.compilation import usable_cores


class Outcome(NamedTuple):
    """Result of a step of one turbine."""

    observation: np.ndarray
    reward: float | np.ndarray
    terminated: bool
    truncated: bool
    info: dict[str, Any]
    final: tuple[np.ndarray, dict[str, Any]] | None = None
    """Last observation and info of an episode that ended in this step, where the next has begun already."""


class WindTurbineVectorEnv(PlainSpec, gym.vector.VectorEnv):
    """Copies of `wt_gym.envs.turbine_env.WindTurbineEnv`, equal bit for bit to single ones with the same seeds.

    ``gymnasium.make_vec(id, num_envs=8)`` makes one for every id of this package; its further arguments are those
    below and those of the single environment.

    Parameters
    ----------
    max_episode_steps : int, optional
        Control steps after which an episode is truncated; `gymnasium.make_vec` passes that of the id.
    autoreset_mode : AutoresetMode or str
        Reset after the end of an episode; by value or by name, as ``"SAME_STEP"``. ``"NextStep"``: the next step
        resets, whatever its action, with reward 0. ``"SameStep"``: the same step resets; the last observation and info
        stand in ``infos["final_obs"]`` and ``infos["final_info"]``. ``"Disabled"``: nothing;
        ``reset(options={"reset_mask": ...})`` starts those chosen.
        It stands in the attribute ``autoreset_mode`` too, where some trainers look.
    threads : int, optional
        That step turbines at the same time; default: one for every processor at hand, at most one a turbine.
    **kwargs
        Arguments of `WindTurbineEnv`, groups of options among them. A turbine and controllers given as objects are
        shared and copied as there.

    Raises
    ------
    ValueError
        If a number is not positive or the mode is none of Gymnasium's.
    """

    def __init__(
        self,
        num_envs: int = 1,
        max_episode_steps: int | None = None,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        threads: int | None = None,
        **kwargs: Any,
    ):
        for name, number in (("num_envs", num_envs), ("max_episode_steps", max_episode_steps), ("threads", threads)):
            if number is not None and not (isinstance(number, int | np.integer) and number >= 1):
                raise ValueError(f"{name} must be a whole number of at least 1, got {shown(number)}")
        self.autoreset_mode = _autoreset_mode(autoreset_mode)
        options = EnvOptions.from_dict(kwargs)
        self.envs = [WindTurbineEnv.of(options)]
        options = replace(options, turbine=self.envs[0].turbine)
        self.envs += [WindTurbineEnv.of(options) for _ in range(num_envs - 1)]
        for env in self.envs:
            env.outer_steps = max_episode_steps
        first = self.envs[0]
        self.num_envs, self.render_mode = num_envs, first.render_mode
        self.layout = first.layout
        self.observation_names, self.observation_units = first.observation_names, first.observation_units
        self.action_names, self.action_units = first.action_names, first.action_units
        self.metadata = {**first.metadata, "autoreset_mode": self.autoreset_mode}
        self.single_observation_space, self.single_action_space = first.observation_space, first.action_space
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self._most_steps = max_episode_steps
        space = cast(spaces.Box, self.observation_space)
        self._observations = np.zeros(space.shape, space.dtype)
        self._steps = np.zeros(num_envs, dtype=np.int64)
        self._over = np.ones(num_envs, dtype=np.bool_)  # episodes that have ended or not begun
        self._begun = False
        self._no_reward = np.zeros(first.reward_space.shape, np.float32) if hasattr(first, "reward_space") else 0.0
        self._threads = min(threads or usable_cores(), num_envs)
        self._pool = self._make_pool()

    def _make_pool(self) -> ThreadPoolExecutor | None:
        """Threads beside the one of the caller; None where there are none, and after `close`."""
        return ThreadPoolExecutor(self._threads - 1, "turbine") if self._threads > 1 and not self.closed else None

    def __getstate__(self) -> dict[str, Any]:
        return self.__dict__ | {"_pool": None}

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Take the state of another one, in threads of its own."""
        self.__dict__.update(state)
        self._pool = self._make_pool()

    def __repr__(self) -> str:
        return f"<{type(self).__name__}: {self.num_envs} of {self.envs[0]!r}>"

    def __str__(self) -> str:
        return describe(self.envs[0], self.spec, self.num_envs)

    def __format__(self, spec: str) -> str:
        """In one line: wrappers of Gymnasium put what they enclose into an f-string."""
        return format(repr(self), spec)

    # ---- single turbines ----

    def reset_each(
        self, seeds: Sequence[int | None], options: dict[str, Any] | None, chosen: Iterable[int]
    ) -> list[tuple[np.ndarray, dict[str, Any]]]:
        """Start episodes of the chosen turbines; give observation and info of each."""
        if self.closed:
            raise ClosedEnvironmentError("the environment was closed")

        def start(k: int) -> tuple[np.ndarray, dict[str, Any]]:
            return self._start(k, seeds[k], options)

        if not self._begun:  # models are made and kernels loaded one after another
            self.envs[0].length.warn(self.spec, self._most_steps)
            results = [start(k) for k in chosen]
            self._begun = all(env.simulator is not None for env in self.envs)
            return results
        return self._each(start, chosen)

    def step_each(self, actions: np.ndarray) -> list[Outcome]:
        """Advance every turbine by a control step, with actions (num_envs, n_act) and errors as of `step`."""
        values = self._checked(actions)

        def step(k: int) -> Outcome:
            if k not in values:
                observation, info = self._start(k)
                return Outcome(observation, self._no_reward, False, False, info)
            return self._step(k, values[k])

        return self._each(step, range(self.num_envs))

    def _checked(self, actions: Any) -> dict[int, np.ndarray]:
        """Actions of those whose episodes go on; this step is the reset of the others."""
        if self.closed:
            raise ClosedEnvironmentError("the environment was closed")
        actions = np.asarray(actions)
        if actions.shape[:1] != (self.num_envs,):
            raise ValueError(f"{self.num_envs} actions are needed, got an array of shape {actions.shape}")
        if not self._begun:
            raise ResetNeeded("no episodes were started: call reset() before step()")
        over = np.flatnonzero(self._over).tolist()
        if over and self.autoreset_mode != AutoresetMode.NEXT_STEP:
            raise ResetNeeded(f"the episodes of turbines {over} are over")
        return {k: self.layout.action.validate(action) for k, action in enumerate(actions) if k not in over}

    def _start(
        self, k: int, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        self._steps[k], self._over[k] = 0, True
        result = self.envs[k].reset(seed=seed, options=options)
        self._over[k] = False
        return result

    def _step(self, k: int, values: np.ndarray) -> Outcome:
        self._over[k] = True  # where the step raises an error
        observation, reward, terminated, truncated, info = self.envs[k].advance(values)
        self._steps[k] += 1
        truncated = truncated or bool(self._steps[k] == self._most_steps)
        self._over[k] = over = terminated or truncated
        if over and self.autoreset_mode == AutoresetMode.SAME_STEP:
            first, beginning = self._start(k)
            return Outcome(first, reward, terminated, truncated, beginning, (observation, info))
        return Outcome(observation, reward, terminated, truncated, info)

    def _each(self, work: Callable[[int], Any], chosen: Iterable[int]) -> list[Any]:
        """Do something with the chosen turbines; an error comes once none of them is at work any more."""
        pool, turbines = self._pool, list(chosen)
        if pool is None:
            return [work(k) for k in turbines]
        turns = iter(enumerate(turbines))  # taken one by one by all threads, this one among them
        results: dict[int, Any] = {}
        errors: dict[int, Exception] = {}

        def serve() -> None:
            for place, k in turns:
                try:
                    results[place] = work(k)
                except Exception as error:
                    errors[place] = error

        with one_blas_thread():
            helpers = [pool.submit(serve) for _ in range(min(self._threads, len(turbines)) - 1)]
            try:
                serve()
                for helper in helpers:
                    helper.result()
            except BaseException:  # as KeyboardInterrupt: no thread may be left at work in a turbine
                for _ in turns:  # none that has not begun will
                    pass
                wait(helpers)
                self._over[:] = True  # who has moved is not known to the caller
                raise
        if errors:
            raise errors[min(errors)]
        return [results[place] for place in range(len(turbines))]

    # ---- Gymnasium ----

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """Start episodes.

        Parameters
        ----------
        seed : int or sequence, optional
            Of the first turbine, those of the others following; or one each.
        options : dict, optional
            As of a single environment, for all; ``reset_mask``, an array of bool, chooses which start again.

        Returns
        -------
        observations : numpy.ndarray, shape (num_envs, n_obs)
        infos : dict
            Of arrays, each with a mask ``_name`` of those that it holds for.
        """
        seeds = [None] * self.num_envs if seed is None else seed
        if isinstance(seeds, int | np.integer):
            seeds = [int(seeds) + k for k in range(self.num_envs)]
        several = isinstance(cast(object, seeds), list | tuple | range | np.ndarray)
        if not several or len(seeds) != self.num_envs:
            raise ValueError(f"seed must be an integer or a sequence of {self.num_envs}, got {shown(seed)}")
        if not isinstance(options, Mapping | None):
            raise ValueError(f"the options of reset must be a dict, got {shown(options)}")
        options = dict(options or {})
        given = options.pop("reset_mask", None)
        mask = np.ones(self.num_envs, dtype=np.bool_) if given is None else np.asarray(given)
        if mask.shape != (self.num_envs,) or mask.dtype != np.bool_ or not mask.any():
            raise ValueError(f"reset_mask must be {self.num_envs} bools, one of them true at least, got {mask!r}")
        chosen = np.flatnonzero(mask)
        infos: dict[str, Any] = {}
        for k, (observation, info) in zip(chosen, self.reset_each(seeds, options, chosen), strict=True):
            self._observations[k] = observation
            infos = self._add_info(infos, info, cast(int, k))
        return self._observations.copy(), infos

    def step(self, actions: Any) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, dict[str, Any]]:
        """Advance every turbine by a control step; an action that is refused moves none.

        Parameters
        ----------
        actions : array_like, shape (num_envs, n_act)

        Returns
        -------
        observations : numpy.ndarray, shape (num_envs, n_obs)
        rewards : numpy.ndarray, shape (num_envs,)
            With ``vector_reward`` (num_envs, n_terms).
        terminations, truncations : numpy.ndarray of bool, shape (num_envs,)
        infos : dict

        Raises
        ------
        wt_gym.base.errors.ActionError
            If an action is refused.
        gymnasium.error.ResetNeeded
            If an episode has ended that nothing resets.
        """
        outcomes = self.step_each(actions)
        infos: dict[str, Any] = {}
        for k, outcome in enumerate(outcomes):
            self._observations[k] = outcome.observation
            if outcome.final is not None:
                final_obs, final_info = outcome.final
                infos = self._add_info(infos, {"final_obs": final_obs, "final_info": final_info}, k)
            infos = self._add_info(infos, outcome.info, k)
        _, rewards, terminated, truncated, *_ = zip(*outcomes, strict=True)
        return self._observations.copy(), np.array(rewards), np.array(terminated), np.array(truncated), infos

    def render(self) -> tuple[Any, ...]:
        """Pictures of all turbines, as of a single environment."""
        return tuple(env.render() for env in self.envs)

    def call(self, name: str, *arguments: Any, **named: Any) -> tuple[Any, ...]:
        """Call a method of every turbine's environment, or read an attribute of it."""
        return tuple(value(*arguments, **named) if callable(value) else value for value in self.get_attr(name))

    def get_attr(self, name: str) -> tuple[Any, ...]:
        """Attribute of every turbine's environment."""
        return tuple(getattr(env, name) for env in self.envs)

    def set_attr(self, name: str, values: Any) -> None:
        """Set an attribute of every turbine's environment: one value for all, or a list or tuple of one each."""
        if not isinstance(values, list | tuple):
            values = [values] * self.num_envs
        for env, value in zip(self.envs, values, strict=True):
            setattr(env, name, value)

    # Gymnasium's base speaks of one generator; its own vector environments give one of each environment too.
    @property
    def np_random_seed(self) -> tuple[int, ...]:  # type: ignore[override]
        """Seeds of the random numbers of each turbine."""
        return self.get_attr("np_random_seed")

    @property  # type: ignore[misc]
    def np_random(self) -> tuple[np.random.Generator, ...]:  # type: ignore[override]
        """Random numbers of each turbine."""
        return self.get_attr("np_random")

    def close_extras(self, **_: Any) -> None:
        """Release simulators and threads."""
        if self._pool is not None:
            self._pool.shutdown()
        for env in self.envs:
            env.close()


def _autoreset_mode(given: AutoresetMode | str) -> AutoresetMode:
    """Mode by itself, by its value or by its name."""
    for mode in AutoresetMode:
        if given in (mode, mode.value, mode.name):
            return mode
    allowed = ", ".join(f"{mode.value!r} ({mode.name!r})" for mode in AutoresetMode)
    near = did_you_mean(given, [mode.value for mode in AutoresetMode])
    raise ValueError(f"autoreset_mode must be one of {allowed}, got {shown(given)}{near}")
