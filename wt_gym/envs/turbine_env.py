"""The Gymnasium environment."""

import copy
from collections.abc import Callable
from typing import Any, Self, cast

import gymnasium as gym
import numpy as np
from gymnasium import spaces
from gymnasium.error import ResetNeeded

from wt_gym.base.errors import ControllerError, SimulationError
from wt_gym.envs import rewards
from wt_gym.envs.builder import Parts, build
from wt_gym.envs.manual import describe, manual
from wt_gym.envs.operation import make_simulator
from wt_gym.envs.options import RENDER_MODES, EnvOptions, PlainSpec, named_arguments, signature
from wt_gym.envs.terminations import registered_limit, tip_clearance
from wt_gym.envs.terms import Beginning, EnvSnapshot, Stateful, Transition, hooks
from wt_gym.simulation import Signals
from wt_gym.simulation.contract import SimulatorMaker


class WindTurbineEnv(PlainSpec, gym.Env[np.ndarray, np.ndarray], Stateful, Parts):
    __doc__ = manual()
    __signature__ = signature()

    observation_space: spaces.Box
    action_space: spaces.Box
    metadata: dict[str, Any] = {"render_modes": list(RENDER_MODES), "render_fps": 5}  # noqa: RUF012 - as its base
    make_simulator: SimulatorMaker = staticmethod(make_simulator)
    """Makes the simulator of an episode's turbine, at the first reset; another one may take its place."""
    remembered = ("reward_terms", "_action", "_observation", "_saturated", "_steps", "_running", "_failed")

    def __init__(self, *positional: Any, **arguments: Any):
        self._make(EnvOptions.from_dict(named_arguments(positional, arguments)))

    @staticmethod
    def made_of(**arguments: Any) -> "WindTurbineEnv":
        """Make an environment of arguments, whatever class is derived from this one."""
        return WindTurbineEnv(**arguments)

    @classmethod
    def of(cls, options: EnvOptions) -> Self:
        """Make an environment of options that are made already."""
        env = cls.__new__(cls)
        env._make(options)
        return env

    def _make(self, options: EnvOptions) -> None:
        self.outer_steps: int | None = None  # after which an episode ends from outside, where that is known
        build(self, options)
        self.metadata = {**self.metadata, "render_fps": max(1, round(1 / self.control_dt))}
        self._begins, self._follows, self._adjusts, self._infos = (
            hooks(self.terms.values(), name) for name in ("begin", "follow", "adjust", "info")
        )
        self._episode_infos: list[Callable[[], dict[str, Any]]] = []
        self._observation: np.ndarray | None = None
        self._saturated: tuple[str, ...] = ()
        self._running = self._failed = False
        self._steps = 0

    # ---- attributes ----

    def __str__(self) -> str:
        return describe(self, self.spec)

    def __format__(self, spec: str) -> str:
        """Name and id in one line: wrappers of Gymnasium put what they enclose into an f-string."""
        return format(super().__str__(), spec)

    # ---- an episode ----

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """Start an episode.

        Parameters
        ----------
        options : dict, optional
            See "Starting state" in the class documentation.

        Returns
        -------
        observation : numpy.ndarray, float32
        info : dict

        Raises
        ------
        ValueError
            If an option is unknown or no number.
        wt_gym.base.errors.InflowError
            If a wind is asked for that cannot be had.
        wt_gym.base.errors.ActionError
            If an option is out of range, for example more torque than there is at the rotor speed.
        wt_gym.base.errors.SimulationError
            If there is no steady state to start from, for example because the wind bends the blades too far.
        """
        if self._running and self.outer_steps is None and self._steps == registered_limit(self.spec):
            self.length.warn(self.spec, None)  # only now it is known that the limit of the id stands
        self._running = False
        super().reset(seed=seed)
        longest = self.length.longest(self.spec, self.outer_steps)
        beginning = self.starts.draw(self.np_random, options, longest, self.np_random_seed, seed is not None)
        self._begin(beginning)
        observation, saturated = self._observe()
        info = self._info(saturated, tip_clearance(self.signals))
        for first_info in hooks(beginning.drawn.values(), "first_info"):
            info |= first_info()
        return observation, info

    def _begin(self, beginning: Beginning) -> None:
        """Start turbine, sensors, reward and terms."""
        start, operation = beginning.start, self.operation
        operation.begin(beginning)
        self._action = np.zeros(self.layout.action.size)
        self._steps, self._running, self._failed = 0, True, False
        self._observation, self._saturated = None, ()
        for begin in self._begins:
            begin(beginning)
        self._episode_infos = [*operation.infos(), *self._infos]
        self.observer.reset(self._action, start.trail)
        averaged = start.averaged(operation.signals)
        rewards.reset(self.reward_terms, self.turbine, operation.signals, averaged, operation.demanded_power)

    def step(self, action: Any) -> tuple[np.ndarray, Any, bool, bool, dict[str, Any]]:
        """Advance by one control step.

        Parameters
        ----------
        action : array_like, shape (n_act,)

        Returns
        -------
        observation : numpy.ndarray, float32
        reward : float
            With ``vector_reward`` an array, float32, of the terms and "termination", named in ``reward_names``.
        terminated, truncated : bool
        info : dict

        Raises
        ------
        wt_gym.base.errors.ActionError
            If the action is refused; the state is unchanged.
        wt_gym.base.errors.ControllerError
            If the base controller gives a demand without meaning; the episode is over.
        gymnasium.error.ResetNeeded
            If no episode is running.
        """
        if not self._running:
            raise ResetNeeded("the episode is over, or none was started: call reset() before step()")
        return self.advance(self.layout.action.validate(action))

    def advance(self, values: np.ndarray) -> tuple[np.ndarray, Any, bool, bool, dict[str, Any]]:
        """Step with an action (n_act,) that was validated."""
        operation, dt, before = self.operation, self.control_dt, self.operation.signals
        try:
            after = operation.advance(self.layout.action.decode(values, operation.setpoint))
        except SimulationError as error:
            return self._fail(error)
        except ControllerError:
            self._running = False  # a part of the step may have been simulated
            raise
        self._action = values
        self._steps += 1
        self.observer.advance(dt)
        transition = Transition(
            self.turbine, before, after, dt, operation.wind.inflow, values, operation.demanded_power
        )  # fmt: skip
        for follow in self._follows:
            follow(transition)
        reward, terms = rewards.total(self.reward_terms, transition)
        clearance = tip_clearance(after)
        ending = self.limits.ending(after, clearance)
        if ending is not None:
            reward, terms = self.limits.punish(reward, terms)
        for adjust in self._adjusts:
            reward, terms = adjust(reward, terms, self._steps - 1, before["time"])
        observation, saturated = self._observe()
        truncated = ending is None and self.length.is_over(self._steps)
        self._running = ending is None and not truncated
        costs = self.costs.of(after)
        info = self._info(saturated, clearance)
        info |= {"reward_terms": terms, "cost": sum(costs.values()), "costs": costs}
        if ending is not None:
            info["termination"] = ending
        return observation, self.to_reward(reward, terms), ending is not None, truncated, info

    def _fail(self, error: SimulationError) -> tuple[np.ndarray, Any, bool, bool, dict[str, Any]]:
        """Result of a step that the simulation did not survive: the last good observation and the penalty."""
        self._running, self._failed = False, True
        observation = cast(np.ndarray, self._observation).copy()
        reward, terms = self.limits.punish(0.0, {term.name: 0.0 for term in self.reward_terms})
        costs = self.costs.of_failure()
        info = self._info(self._saturated, tip_clearance(self.signals))
        info |= {"reward_terms": terms, "cost": sum(costs.values()), "costs": costs}
        info |= {"termination": "failure", "failure": str(error)}
        return observation, self.to_reward(reward, terms), True, False, info

    def _observe(self) -> tuple[np.ndarray, tuple[str, ...]]:
        self._observation, self._saturated = self.observer.observe(self._action, self.np_random)
        return self._observation.copy(), self._saturated

    def _info(self, saturated: tuple[str, ...], clearance: float) -> dict[str, Any]:
        signals, wind = self.operation.signals, self.operation.wind
        info = {
            "time": signals["time"],
            "wind_speed": float(wind.wind_speed),
            "wind_seed": int(wind.wind_seed),
            "generator_power": signals["generator_power"],
            "rotor_speed": signals["rotor_speed"],
            "rotor_speed_max": signals["rotor_speed_max"],
            "tip_clearance_min": clearance,
            "idle_time": self.idle.time,
            "saturated": saturated,
        }
        for part in self._episode_infos:
            info |= part()
        return info

    # ---- snapshots and pictures ----

    def snapshot(self) -> EnvSnapshot:
        """All from which the episode continues bit for bit: simulator, controller, filters, reward, random state.

        For planning: take one, try actions, `restore` it. An episode that is over is kept as such: after restoring it
        `step` asks for a reset, and `render` shows its last instant.

        Raises
        ------
        gymnasium.error.ResetNeeded
            If no episode was started.
        """
        simulator = self.operation.simulator
        if simulator is None or cast("Signals | None", self.signals) is None:
            raise ResetNeeded("there is nothing to take a snapshot of: call reset() first")
        parts = {"operation": self.operation, "environment": self, "observer": self.observer, **self.terms}
        return EnvSnapshot(
            None if self._failed else simulator.state(),
            self.episode_wind,
            copy.deepcopy(cast("dict[str, Any]", self.np_random.bit_generator.state)),
            {name: part.memory() for name, part in parts.items()},
        )

    def restore(self, snapshot: EnvSnapshot) -> np.ndarray:
        """Continue from a snapshot of this environment or of one made with the same arguments.

        Returns
        -------
        observation : numpy.ndarray, float32
            That of the snapshot; with sensor noise it is drawn again.

        Raises
        ------
        wt_gym.base.errors.SimulationError
            If the snapshot belongs to another turbine or fidelity.
        """
        parts = snapshot.parts
        self.operation.resume(parts["operation"], snapshot.wind, snapshot.simulator)
        self.recall(parts["environment"])
        self.observer.recall(parts["observer"])
        self.np_random.bit_generator.state = copy.deepcopy(snapshot.random)
        for name, term in self.terms.items():
            term.recall(parts.get(name, {}))  # a snapshot of an environment without pictures has none
        self._episode_infos = [*self.operation.infos(), *self._infos]
        return cast(np.ndarray, None if self._observation is None else self._observation.copy())  # a twin has none

    def render(self) -> np.ndarray | None:
        """Return a picture of the turbine and its wake, uint8 array of shape (height, width, 3), or None.

        Of a simulation that failed it shows what was drawn last.
        """
        renderer: Any = self.terms.get("renderer")
        if renderer is None:
            gym.logger.warn("render() was called without a render_mode; make the environment with 'rgb_array'")
            return None
        if cast("Signals | None", self.signals) is None:
            raise ResetNeeded("render() needs a started episode: call reset() first")
        return cast(np.ndarray, renderer.draw(None if self._failed else self.simulator.geometry()))

    def close(self) -> None:
        """Release the simulator and the renderer."""
        self.operation.close()
        for close in hooks(self.terms.values(), "close"):
            close()
        self.terms.pop("renderer", None)
        self._running = False


def turbine_env_of(env: gym.Env[Any, Any]) -> WindTurbineEnv:
    """The environment of the turbine behind any wrappers."""
    return cast("WindTurbineEnv", env.unwrapped)
