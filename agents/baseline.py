"""The baseline controller behind the observation and action of an environment.

The law itself is `wt_gym.control.controllers.discon`; its names can be imported from here too.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from wt_gym.control.actions import Demand
from wt_gym.control.controllers.discon import NREL_5MW, BaselineController, BaselineParameters, BaselineState

if TYPE_CHECKING:
    from wt_gym.envs.layout import EnvLayout

__all__ = ["NREL_5MW", "BaselineAgent", "BaselineController", "BaselineParameters", "BaselineState"]


class BaselineAgent:
    """The baseline controller behind an environment's observation and action.

    Reads generator speed and the present demands from the observation, steps the controller by the control step of the
    environment and gives the action that asks for the controller's commands, for rate and absolute actions, collective
    and individual pitch. The yaw drive rests.

    The memory of the controller travels as ``state`` through `predict`, as that of a recurrent policy does in
    stable-baselines3. Where none is passed the agent keeps it itself. Where the observed demands are not those that the
    controller asked for (a new episode, a handover), it starts afresh and bumplessly from them.

    Parameters
    ----------
    layout : EnvLayout
        Layout of observation and action, ``env.unwrapped.layout``.
    parameters : BaselineParameters, optional
        Default: those of the layout's turbine.

    Raises
    ------
    KeyError
        If the observation lacks the generator speed or a demand.
    """

    def __init__(self, layout: EnvLayout, parameters: BaselineParameters | None = None):
        if layout.action.needs_controller:
            raise ValueError(
                "a controller runs beneath this environment's actions already (residual actions, or components left "
                "out): zero actions are it; choose it by controller=..."
            )
        self.layout = layout
        self.parameters = parameters or BaselineParameters.from_turbine(layout.turbine)
        self._controller = BaselineController(self.parameters)
        self._state: np.ndarray | None = None
        self._pitch_tolerance = 1e-3 * layout.action.max_pitch_rate * layout.control_dt
        self._torque_tolerance = 1e-3 * layout.action.max_torque_rate * layout.control_dt
        for name in ("generator_speed", "generator_torque_demand", *self._pitch_names()):
            layout.observation.index(name)

    @classmethod
    def from_env(cls, env, parameters: BaselineParameters | None = None) -> BaselineAgent:
        """Build the agent for a Gymnasium environment, a vector environment or a stable-baselines3 VecEnv."""
        from wt_gym.envs.layout import layout_of

        return cls(layout_of(env), parameters)

    def reset(self) -> None:
        """Forget everything: the next `predict` starts afresh."""
        self._state = None

    def predict(self, observation, state=None, episode_start=None, deterministic: bool = True):
        """Action for an observation, as stable-baselines3's models give it.

        Parameters
        ----------
        observation : numpy.ndarray, shape (n_obs,) or (n_envs, n_obs)
        state : numpy.ndarray, shape (n_envs, 3 + n_blades), optional
            As returned by the last call.
        episode_start : array_like of bool, shape (n_envs,), optional
            Where True the controller starts afresh.
        deterministic : bool
            Accepted for compatibility: the controller is deterministic.

        Returns
        -------
        action : numpy.ndarray, float32, shape (n_act,) or (n_envs, n_act)
        state : numpy.ndarray, shape (n_envs, 3 + n_blades)
        """
        observation = np.asarray(observation, dtype=np.float64)
        batch = np.atleast_2d(observation)
        previous = self._state if state is None else np.asarray(state, dtype=np.float64)
        if previous is None or previous.shape[0] != batch.shape[0]:
            previous = np.full((batch.shape[0], 3 + self.parameters.n_blades), np.nan)
        starts = np.zeros(batch.shape[0], dtype=bool) if episode_start is None else np.atleast_1d(episode_start)

        rows = [self._act(obs, row, start) for obs, row, start in zip(batch, previous, starts, strict=True)]
        actions = np.array([action for action, _ in rows], dtype=np.float32)
        self._state = np.array([row for _, row in rows])
        return (actions if observation.ndim == 2 else actions[0]), self._state.copy()

    def _act(self, observation: np.ndarray, row: np.ndarray, start: bool) -> tuple[np.ndarray, np.ndarray]:
        """Action and new memory for one environment."""
        layout = self.layout
        speed = float(layout.observation.value(observation, "generator_speed"))
        torque = float(layout.observation.value(observation, "generator_torque_demand"))
        pitch = np.array([layout.observation.value(observation, name) for name in self._pitch_names()])
        pitch = np.broadcast_to(pitch, self.parameters.n_blades)
        if start or not self._asked_for(row, pitch, torque):
            self._controller.start(speed, pitch, torque)
        else:
            state = BaselineState(row[0], row[1], row[3:], row[2])
            self._controller.state = replace(state, pitch=pitch, torque=torque)
        pitch_demand, torque_demand = self._controller.step(speed, layout.control_dt)
        action = layout.action.encode(Demand(pitch_demand, 0.0, torque_demand), Demand(pitch, 0.0, torque))
        state = self._controller.state
        return action, np.array([state.filtered_speed, state.speed_integral, state.torque, *state.pitch])

    def _asked_for(self, row: np.ndarray, pitch: np.ndarray, torque: float) -> bool:
        """Whether the observed demands are the ones of the memory (NaN, an empty memory, never is)."""
        same_torque = abs(row[2] - torque) <= self._torque_tolerance
        return bool(same_torque and np.all(np.abs(row[3:] - pitch) <= self._pitch_tolerance))

    def _pitch_names(self) -> tuple[str, ...]:
        """Names of the observed pitch demands."""
        if self.layout.action.pitch == "collective":
            return ("pitch_demand",)
        return tuple(f"pitch_demand_{b + 1}" for b in range(self.layout.action.n_blades))
