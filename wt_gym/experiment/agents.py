"""Agents that need no training: constant and random actions, a controller of the library, a planner; agents by name."""

from __future__ import annotations

import copy
import inspect
import math
from collections import deque
from functools import partial
from typing import TYPE_CHECKING, Any, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from wt_gym.base.errors import WtGymError
from wt_gym.base.options import Options, option, option_record
from wt_gym.control import AgentSetpoint, Demand
from wt_gym.control.controllers import Controller, checked_demand, lidar_of, make_controller
from wt_gym.control.controllers.names import Name, call_maker, load_class
from wt_gym.envs.layout import EnvLayout
from wt_gym.envs.terms import EnvSnapshot
from wt_gym.envs.turbine_env import turbine_env_of
from wt_gym.experiment.names import is_base_controller, read_name

if TYPE_CHECKING:
    import gymnasium as gym

    from wt_gym.envs.episode import Agent
    from wt_gym.experiment.trained_agent import TrainedAgent

__all__ = [
    "ConstantAgent", "ControllerAgent", "ObservedSignals", "PlannerOptions", "ShootingPlanner", "UniformAgent",
    "load_agent", "load_model",
]  # fmt: skip


class ConstantAgent:
    """Gives one action whatever it sees; by default the middle of the range, which holds all demands in rate mode.

    ``action`` has shape (n_act,) and numbers within [-1, 1]; ``layout`` is ``env.unwrapped.layout``.
    """

    def __init__(self, layout: EnvLayout, action: ArrayLike | None = None):
        values = np.zeros(layout.action.size) if action is None else np.asarray(action)
        self._action: NDArray[np.float32] = layout.action.validate(values).astype(np.float32)

    def predict(
        self, observation: Any, state: Any = None, episode_start: Any = None, deterministic: bool = True
    ) -> tuple[NDArray[np.float32], Any]:
        """Return the constant action for each observation, and the state as it came."""
        observation = np.asarray(observation)
        if observation.ndim == 1:
            return self._action.copy(), state
        return np.tile(self._action, (observation.shape[0], 1)), state


class UniformAgent:
    """Draws every action evenly from the action space; each start of an episode begins the draws of its seed again."""

    def __init__(self, layout: EnvLayout, seed: int = 0):
        self._size, self._seed = layout.action.size, seed
        self._rng = np.random.default_rng(seed)

    def predict(
        self, observation: Any, state: Any = None, episode_start: Any = None, deterministic: bool = True
    ) -> tuple[NDArray[np.float32], Any]:
        """Return an action for each observation, and the state as it came."""
        if episode_start is not None and np.any(episode_start):
            self._rng = np.random.default_rng(self._seed)
        shape = (*np.shape(observation)[:-1], self._size)
        return self._rng.uniform(-1.0, 1.0, shape).astype(np.float32), state


class UnobservedError(WtGymError, KeyError):
    """The observation lacks a signal that a controller reads."""

    __str__ = Exception.__str__  # that of KeyError quotes


class ObservedSignals:
    """The channels of the simulator that can be read from an observation of shape (n_obs,), by name.

    The azimuth comes from its sine and cosine, a gate of a lidar as the mean of its beams where these are apart; where
    only the mean of the blades is observed (collective pitch), each blade has it.
    """

    def __init__(self, layout: EnvLayout, observation: np.ndarray | None = None):
        self.layout, self.observation = layout, cast(np.ndarray, observation)

    def source(self, name: str) -> tuple[str, ...]:
        """Channels of the observation from which a signal is read; a `KeyError` says what the observation has."""
        names, lidar, (stem, _, number) = self.layout.observation.names, self.layout.lidar, name.rpartition("_")
        candidates: list[tuple[str, ...]] = [(name,), (stem,)] if number.isdigit() else [(name,)]
        if name == "azimuth":
            candidates = [("azimuth_sin", "azimuth_cos")]
        elif stem == "lidar" and lidar is not None and lidar.apart:
            candidates = [tuple(f"{name}_{beam + 1}" for beam in range(lidar.n_beams))]
        for candidate in candidates:
            if all(channel in names for channel in candidate):
                return candidate
        raise UnobservedError(
            f"the observation has no channel {' and '.join(candidates[0])} for the signal {name!r}; "
            f"it has {', '.join(names)}. A base controller, controller=..., reads every signal"
        )

    def __getitem__(self, name: str) -> float:
        values = [float(self.layout.observation.value(self.observation, channel)) for channel in self.source(name)]
        if name == "azimuth":
            return math.atan2(*values) % (2.0 * math.pi)
        return sum(values) / len(values)


class ControllerAgent:
    """A controller with stable-baselines3's ``predict``, for rate and absolute actions.

    It reads the signals and the demands from the observation, steps the controller by the control step and gives the
    action that asks for the controller's demand. The agent remembers one controller an environment. Where the observed
    demands are not those that the agent asked for (a new episode, a handover), it starts afresh and bumplessly from
    them; ``episode_start`` says the same. Late observations (``sensor_delay``) show what it asked for so long ago; a
    handover in the middle of an episode then needs demands that have rested as long.

    Parameters
    ----------
    layout : EnvLayout
        ``env.unwrapped.layout``.
    controller, **parameters
        As of `wt_gym.control.controllers.make_controller`.

    Raises
    ------
    KeyError
        If the observation lacks a channel that the controller reads, or a demand.
    ValueError
        If a controller of individual pitch meets an environment with collective pitch, the actions are neither rates
        nor absolute demands, they have a base controller already, or the lidar of the controller is not that of the
        observation.
    """

    def __init__(self, layout: EnvLayout, controller: str | Controller = "discon", **parameters: Any):
        self.layout = layout
        self.controller = make_controller(controller, layout.turbine, **parameters)
        action = layout.action
        if action.needs_controller or action.turns_with_rotor:
            raise ValueError(
                "actions for a ControllerAgent must be rates or absolute demands of blade pitch and torque, got "
                f"action_mode {action.mode!r} with pitch {action.pitch!r} and components {action.components}; for "
                "others make it the base controller, controller=..."
            )
        lidar = lidar_of(self.controller)
        if lidar is not None and (layout.lidar is None or not layout.lidar.serves(lidar)):
            raise ValueError(
                f"the controller reads {lidar}, the observation has {layout.lidar}: give both the same, lidar=..., or "
                "the observation the same with apart=True"
            )
        if "azimuth" in self.controller.channels and action.pitch != "individual":
            raise ValueError(f"pitch must be 'individual' for a controller of individual pitch, got {action.pitch!r}")
        blades = [f"_{b + 1}" for b in range(action.n_blades)] if action.pitch == "individual" else [""]
        self._pitch_names = tuple(f"pitch_demand{blade}" for blade in blades)
        self._signals = ObservedSignals(layout)
        for name in (*self.controller.channels, *self._pitch_names, "generator_torque_demand"):
            self._signals.source(name)
        self._pitch_tolerance = 1e-3 * action.max_pitch_rate * layout.control_dt
        self._torque_tolerance = 1e-3 * action.max_torque_rate * layout.control_dt
        self.reset()

    def reset(self) -> None:
        """Forget everything: the next `predict` starts afresh."""
        self._controllers: list[Controller] = []
        # of an environment: what it was asked for, from the demand that the next observation shows to the current one
        self._asked: list[deque[AgentSetpoint | Demand]] = []

    def predict(
        self, observation: Any, state: Any = None, episode_start: Any = None, deterministic: bool = True
    ) -> tuple[NDArray[np.float32], Any]:
        """Action of shape (n_act,) for an observation, or (n_envs, n_act) for several, and the state as it came.

        Where ``episode_start`` is true, the controller of that environment starts afresh.
        """
        observation = np.asarray(observation, dtype=np.float64)
        batch = np.atleast_2d(observation)
        if len(self._controllers) != len(batch):
            self._controllers = [copy.deepcopy(self.controller) for _ in batch]
            self._asked = [deque(maxlen=self.layout.delay + 1) for _ in batch]
        starts = np.zeros(len(batch), dtype=bool) if episode_start is None else np.atleast_1d(episode_start)
        rows = enumerate(zip(batch, starts, strict=True))
        actions = np.array([self._act(k, row, bool(start)) for k, (row, start) in rows])
        return (actions if observation.ndim == 2 else actions[0]), state

    def _act(self, k: int, observation: np.ndarray, start: bool) -> np.ndarray:
        """Action of environment k."""
        layout, signals, controller, asked = self.layout, self._signals, self._controllers[k], self._asked[k]
        signals.observation = observation
        n_blades = layout.action.n_blades
        pitch = np.broadcast_to([signals[name] for name in self._pitch_names], n_blades).astype(np.float64)
        seen = Demand(pitch, 0.0, signals["generator_torque_demand"])
        if start or not asked or not self._same(asked[0], seen):
            controller.start(signals, seen)
            asked.extend([seen] * (layout.delay + 1))
        demand = checked_demand(controller.step(signals, layout.control_dt), controller, n_blades)
        now = seen if layout.delay == 0 else asked[-1]
        action = layout.action.encode(demand, now).astype(np.float32)
        setpoint = layout.action.start(now) if isinstance(now, Demand) else now
        asked.append(layout.action.decode(action.astype(np.float64), setpoint))
        return action

    def _same(self, asked: AgentSetpoint | Demand, seen: Demand) -> bool:
        """Whether the observed demands are those asked for."""
        same_torque = abs(asked.generator_torque - seen.generator_torque) <= self._torque_tolerance
        return bool(same_torque and np.all(np.abs(asked.pitch - seen.pitch) <= self._pitch_tolerance))


MOST_ACTIONS = MOST_SAMPLES = MOST_ROUNDS = 1000
"""Of a plan, of a round, and of a search."""
_LEAST_SPREAD = 0.05  # of the samples, so that the search continues


@option_record
class PlannerOptions(Options):
    """Settings of a `ShootingPlanner`."""

    title = "planner"

    horizon: float = option(
        "time over which rewards are summed; a plan takes it once a sample and round, at every action", default=2.0,
        unit="s", low=0.0, high=600.0, above=True,
    )  # fmt: skip
    hold: float = option(
        "time for which an action is held, rounded to control steps; at most the horizon", default=0.4, unit="s",
        low=0.0, above=True,
    )  # fmt: skip
    samples: int = option("plans tried in each round", default=12, low=1, high=MOST_SAMPLES)
    elites: int = option("best plans, around which the next ones are drawn", default=3, low=1, high=MOST_SAMPLES)
    rounds: int = option("rounds of drawing", default=2, low=1, high=MOST_ROUNDS)
    spread: float = option("standard deviation of the plans in the first round", default=0.5, low=0.0, above=True)
    seed: int = option("random numbers of the planner alone", default=0, low=0)

    def check(self) -> None:
        """Refuse a plan without actions, with too many, or a selection of more than all plans."""
        if not self.hold <= self.horizon <= MOST_ACTIONS * self.hold:
            raise ValueError(
                f"the horizon of a planner must be 1 to {MOST_ACTIONS} times hold, got {self.horizon!r} s in steps of "
                f"{self.hold!r} s"
            )
        if self.elites > self.samples:
            raise ValueError(f"elites must be at most samples, got {self.elites} of {self.samples}")


class ShootingPlanner:
    """Chooses the actions whose rewards over the next seconds are best.

    A plan is a sequence of actions, each held for a while. Plans are drawn around the one that was best before, tried
    in the environment, and drawn again around the best of them; zero actions are always among them. The first action of
    the best plan is done, then everything begins again. The environment is left as it was found.

    The planner tries its actions in the very episode that it controls, so that it knows plant and future wind exactly:
    no controller of a real turbine does. Its rewards are a bound for those that do not.

    The environment is one of this package behind any wrappers: what these do to actions and rewards is not seen. The
    settings are fields of `PlannerOptions`.
    """

    def __init__(self, env: gym.Env, **settings: Any):
        options = PlannerOptions.from_dict(settings)
        self._env, self._options = turbine_env_of(env), options
        self._held = max(1, round(options.hold / self._env.control_dt))
        self._shape = (max(1, round(options.horizon / options.hold)), *self._env.action_space.shape)
        self.reset()

    def reset(self) -> None:
        """Forget the plan and begin the draws again."""
        self._rng = np.random.default_rng(self._options.seed)
        self._plan, self._left = np.zeros(self._shape), 0

    def predict(
        self, observation: Any, state: Any = None, episode_start: Any = None, deterministic: bool = True
    ) -> tuple[NDArray[np.float32], Any]:
        """Action of shape (n_act,) for the current instant of the environment, and the state as it came.

        The observation is not read: the planner has the environment. Where ``episode_start`` is true the plan is
        forgotten.
        """
        if np.ndim(observation) != 1:
            raise ValueError(
                f"observations of a planner must be those of one environment, got shape {np.shape(observation)}"
            )
        if episode_start is not None and np.any(episode_start):
            self.reset()
        if self._left == 0:
            self._plan, self._left = self._search(np.vstack([self._plan[1:], self._plan[-1:]])), self._held
        self._left -= 1
        return self._plan[0].astype(np.float32), state

    def _search(self, guess: np.ndarray) -> np.ndarray:
        """Best plan found, shape (n_actions, n_act)."""
        here = self._env.snapshot()
        best, best_value = None, -np.inf
        center, spread = guess, np.full(self._shape, self._options.spread)
        try:
            for turn in range(self._options.rounds):
                drawn = center + spread * self._rng.standard_normal((self._options.samples, *self._shape))
                plans = np.clip(drawn, -1.0, 1.0)
                if turn == 0:
                    plans = np.concatenate([np.zeros((1, *self._shape)), guess[None], plans])
                values = np.array([self._value(plan, here) for plan in plans])
                order = np.argsort(values)[::-1]
                if values[order[0]] > best_value:
                    best, best_value = plans[order[0]], values[order[0]]
                elites = plans[order[: self._options.elites]]
                center, spread = elites.mean(axis=0), np.maximum(elites.std(axis=0), _LEAST_SPREAD)
        finally:
            self._env.restore(here)
        return cast(np.ndarray, best)

    def _value(self, plan: np.ndarray, here: EnvSnapshot) -> float:
        """Sum of the rewards of a plan from a snapshot on, until the episode ends."""
        self._env.restore(here)
        total = 0.0
        for action in plan:
            for _ in range(self._held):
                _, reward, terminated, truncated, _ = self._env.step(action)
                total += float(np.sum(reward))
                if terminated or truncated:
                    return total
        return total


def load_agent(choice: str, layout: EnvLayout, env: gym.Env | None = None) -> Agent:
    """Give the agent that a name means.

    Parameters
    ----------
    choice : str
        As of `wt_gym.experiment.names.read_name`. A controller, or a class that makes one, is run by the environment
        under residual actions, and its agent gives zero actions. ``"baseline"`` is the base controller of residual
        actions, else the turbine's own.
    env : gymnasium.Env, optional
        The environment of the layout, for a planner.

    Raises
    ------
    ValueError
        If there is no such agent, or the object of a class has no ``predict``.
    """
    name = read_name(choice)
    if name.kind == "trained":
        return load_model(name)
    if name.kind == "word" and name.target == "planner":
        if env is None:
            raise ValueError("a planner needs the environment that it plans in")
        return ShootingPlanner(env, **name.parameters)
    if name.kind == "word":
        return ConstantAgent(layout) if name.target == "zero" else UniformAgent(layout)
    if not is_base_controller(choice):
        maker = load_class(name.target)
        given = {"layout": layout} if "layout" in inspect.signature(maker).parameters else {}
        agent: Agent = call_maker(name.target, partial(maker, **given), name.parameters)
        if not callable(getattr(agent, "predict", None)):
            raise ValueError(f"{name.target} must make an agent with predict, got {agent!r}")
        return agent
    if layout.action.mode == "residual":
        return ConstantAgent(layout)
    return ControllerAgent(layout, name.target, **name.parameters)


def load_model(name: Name) -> TrainedAgent:
    """Load the trained model that a name means, with what the name says of it."""
    from wt_gym.experiment.trained_agent import TrainedAgent, model_card  # torch takes seconds to import

    algorithm = name.parameters.get("algo") or model_card(name.target, name.parameters.get("env")).get("algo")
    return TrainedAgent.load(name.target, algorithm, trust=bool(name.parameters.get("trust", False)))
