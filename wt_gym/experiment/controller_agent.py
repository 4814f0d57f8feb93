"""Any controller of the library behind the observation and action of an environment."""

from __future__ import annotations

import copy
import math
from collections import deque
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from wt_gym.control import AgentSetpoint, Demand
from wt_gym.control.controllers import checked_demand, lidar_of, make_controller

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from wt_gym.control.controllers import Controller
    from wt_gym.envs.layout import EnvLayout

__all__ = ["ControllerAgent", "ObservedSignals"]


class ObservedSignals:
    """The channels of the simulator that can be read from an observation, by name.

    The azimuth comes from its sine and cosine, a gate of a lidar as the mean of its beams where these are apart; where
    only the mean of the blades is observed (collective pitch), each
    blade has it.

    Parameters
    ----------
    layout : EnvLayout
    observation : numpy.ndarray, shape (n_obs,), optional
        May be set later.
    """

    def __init__(self, layout: EnvLayout, observation: np.ndarray | None = None):
        self.layout, self.observation = layout, cast(np.ndarray, observation)

    def source(self, name: str) -> tuple[str, ...]:
        """Channels of the observation from which a signal is read.

        Raises
        ------
        KeyError
            If the observation does not have them; the message says what it has.
        """
        names = self.layout.observation.names
        candidates: list[tuple[str, ...]]
        if name == "azimuth":
            candidates = [("azimuth_sin", "azimuth_cos")]
        else:
            stem, _, number = name.rpartition("_")
            candidates = [(name,), (stem,)] if number.isdigit() else [(name,)]
            lidar = self.layout.lidar
            if stem == "lidar" and lidar is not None and lidar.apart:
                candidates = [tuple(f"{name}_{beam + 1}" for beam in range(lidar.n_beams))]
        for candidate in candidates:
            if all(channel in names for channel in candidate):
                return candidate
        raise KeyError(
            f"the observation has no channel {' and '.join(candidates[0])} for the signal {name!r}; "
            f"it has {', '.join(names)}"
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
        Layout of observation and action, ``env.unwrapped.layout``.
    controller : str, Controller or callable
        See `wt_gym.control.controllers.make_controller`.
    **parameters
        Of the controller.

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
        if action.pitch == "individual":
            self._pitch_names = tuple(f"pitch_demand_{b + 1}" for b in range(action.n_blades))
        else:
            self._pitch_names = ("pitch_demand",)
        self._signals = ObservedSignals(layout)
        for name in (*self.controller.channels, *self._pitch_names, "generator_torque_demand"):
            self._signals.source(name)
        self._pitch_tolerance = 1e-3 * action.max_pitch_rate * layout.control_dt
        self._torque_tolerance = 1e-3 * action.max_torque_rate * layout.control_dt
        self.reset()

    @classmethod
    def from_env(cls, env: Any, controller: str | Controller = "discon", **parameters: Any) -> ControllerAgent:
        """Build the agent for a Gymnasium environment, a vector environment or a stable-baselines3 VecEnv."""
        from wt_gym.envs.layout import layout_of

        return cls(layout_of(env), controller, **parameters)

    def reset(self) -> None:
        """Forget everything: the next `predict` starts afresh."""
        self._controllers: list[Controller] = []
        # of an environment: what it was asked for, from the demand that the next observation shows to the present one
        self._asked: list[deque[AgentSetpoint | Demand]] = []

    def predict(
        self, observation: Any, state: Any = None, episode_start: Any = None, deterministic: bool = True
    ) -> tuple[NDArray[np.float32], Any]:
        """Action for an observation, as stable-baselines3's models give it.

        Parameters
        ----------
        observation : numpy.ndarray, shape (n_obs,) or (n_envs, n_obs)
        state : None
            Returned as it is: the agent keeps the memory of its controllers itself.
        episode_start : array_like of bool, shape (n_envs,), optional
            Where True the controller starts afresh.
        deterministic : bool
            Accepted for compatibility: controllers are deterministic.

        Returns
        -------
        action : numpy.ndarray, float32, shape (n_act,) or (n_envs, n_act)
        state : None
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
