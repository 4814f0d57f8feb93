"""From a normalised action to the demands on pitch servos, yaw drive and generator, and back."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from wt_gym.errors import ActionError

if TYPE_CHECKING:
    from wt_gym.turbines import Turbine

__all__ = ["ActionMap", "Demand"]

# An action may leave [-1, 1] by float32 rounding of a policy's output, by no more.
_ROUNDING = 1e-6


@dataclass(frozen=True)
class Demand:
    """What the actuators are asked for.

    Attributes
    ----------
    pitch : numpy.ndarray, shape (n_blades,)
        Blade pitch [rad].
    yaw_rate : float
        Rate of the nacelle about the vertical, counter-clockwise from above [rad/s].
    generator_torque : float
        Torque on the high-speed shaft [N m].
    """

    pitch: np.ndarray
    yaw_rate: float
    generator_torque: float


class ActionMap:
    """Meaning of the components of an action in [-1, 1].

    Components are, in this order, pitch (one, or one a blade), yaw (none for a turbine whose greatest yaw rate is 0),
    generator torque. In mode ``"rate"`` pitch and torque components are rates of the demand, held over a control step:
    the demand moves by ``action * max_rate * control_dt``. In mode ``"absolute"`` they are the demands themselves, from
    the lower limit (-1) to the upper one (+1). The yaw component is a rate in both modes, because a yaw drive turns at
    a rate and holds otherwise. Demands end at the limits of the turbine.

    Parameters
    ----------
    turbine : Turbine
        Its pitch system, drivetrain and nacelle set the limits.
    control_dt : float
        Control step [s].
    mode : {"rate", "absolute"}
    pitch : {"collective", "individual"}

    Attributes
    ----------
    names : tuple of str
    units : tuple of str
    low, high : numpy.ndarray, shape (n,)
        Physical value of an action component at -1 and +1.
    size : int
    has_yaw : bool
        Whether there is a yaw component.

    Raises
    ------
    ValueError
        If ``mode``, ``pitch`` or ``control_dt`` is not one of those allowed.
    """

    def __init__(self, turbine: Turbine, control_dt: float, mode: str = "rate", pitch: str = "collective"):
        if mode not in ("rate", "absolute"):
            raise ValueError(f"action_mode must be 'rate' or 'absolute', got {mode!r}")
        if pitch not in ("collective", "individual"):
            raise ValueError(f"pitch must be 'collective' or 'individual', got {pitch!r}")
        if not control_dt > 0:
            raise ValueError(f"control_dt must be positive, got {control_dt!r} s")
        self.mode, self.pitch, self.control_dt = mode, pitch, float(control_dt)
        self.n_blades = turbine.n_blades
        self.n_pitch = turbine.n_blades if pitch == "individual" else 1
        self.pitch_limits = (turbine.pitch.min_pitch, turbine.pitch.max_pitch)
        self.torque_limits = (0.0, turbine.drivetrain.max_generator_torque)
        self.max_pitch_rate = turbine.pitch.max_rate
        self.max_yaw_rate = turbine.nacelle.max_yaw_rate
        self.max_torque_rate = turbine.drivetrain.max_torque_rate
        self.has_yaw = self.max_yaw_rate > 0.0

        names = [f"pitch_{b + 1}" for b in range(self.n_pitch)] if pitch == "individual" else ["pitch"]
        rate, torque_rate = self.max_pitch_rate, self.max_torque_rate
        if mode == "rate":
            rows = [(f"{name}_rate", "rad/s", -rate, rate) for name in names]
            last = ("generator_torque_rate", "N m/s", -torque_rate, torque_rate)
        else:
            rows = [(name, "rad", *self.pitch_limits) for name in names]
            last = ("generator_torque", "N m", *self.torque_limits)
        if self.has_yaw:
            rows.append(("yaw_rate", "rad/s", -self.max_yaw_rate, self.max_yaw_rate))
        self.names, self.units, low, high = zip(*rows, last, strict=True)
        self.low, self.high, self.size = np.array(low), np.array(high), len(self.names)
        self.low.flags.writeable = self.high.flags.writeable = False

    def validate(self, action) -> np.ndarray:
        """Return an action as float64, or refuse it.

        Parameters
        ----------
        action : array_like, shape (size,)

        Returns
        -------
        numpy.ndarray, shape (size,)
            A copy; values beyond the bounds by rounding (1e-6) are put on them.

        Raises
        ------
        ActionError
            If the shape is wrong or a component is not finite or outside [-1, 1].
        """
        try:
            values = np.array(action, dtype=np.float64)
        except (TypeError, ValueError) as error:
            raise ActionError(f"action must be {self.size} numbers {self.names}, got {action!r}") from error
        if values.shape != (self.size,):
            raise ActionError(f"action must have shape ({self.size},) for {self.names}, got shape {values.shape}")
        # The comparison is written so that NaN fails it.
        refused = ~(np.abs(values) <= 1.0 + _ROUNDING)
        if refused.any():
            wrong = ", ".join(f"{self.names[i]} (component {i}) = {values[i]}" for i in np.flatnonzero(refused))
            raise ActionError(f"action components must be finite and within [-1, 1], got {wrong}")
        return np.clip(values, -1.0, 1.0)

    def decode(self, action: np.ndarray, previous: Demand) -> Demand:
        """Demands for the next control step.

        Parameters
        ----------
        action : numpy.ndarray, shape (size,)
            A validated action.
        previous : Demand
            Demands of the step before (used in mode ``"rate"``).

        Returns
        -------
        Demand
        """
        physical = self.low + 0.5 * (action + 1.0) * (self.high - self.low)
        pitch, torque = physical[: self.n_pitch], physical[-1]
        if self.mode == "rate":
            pitch = previous.pitch + pitch * self.control_dt
            torque = previous.generator_torque + torque * self.control_dt
        pitch = np.clip(np.broadcast_to(pitch, self.n_blades), *self.pitch_limits)
        yaw_rate = float(physical[-2]) if self.has_yaw else 0.0
        return Demand(pitch, yaw_rate, float(np.clip(torque, *self.torque_limits)))

    def encode(self, demand: Demand, previous: Demand) -> np.ndarray:
        """Give the action whose `decode` is the wanted demand, or the nearest one the actuators' rates allow.

        Parameters
        ----------
        demand, previous : Demand
            Collective maps take the mean of the blades' pitch.

        Returns
        -------
        numpy.ndarray, shape (size,)
            Within [-1, 1].
        """
        pitch, torque = np.asarray(demand.pitch, dtype=np.float64), demand.generator_torque
        if self.mode == "rate":
            pitch = (pitch - previous.pitch) / self.control_dt
            torque = (torque - previous.generator_torque) / self.control_dt
        if self.pitch == "collective":
            pitch = pitch.mean(keepdims=True)
        yaw_rate = [demand.yaw_rate] if self.has_yaw else []
        physical = np.concatenate([pitch, yaw_rate, [torque]])
        return np.clip(2.0 * (physical - self.low) / (self.high - self.low) - 1.0, -1.0, 1.0)

    def table(self) -> list[dict]:
        """Rows (name, unit, value at -1, value at +1) of the action vector, for documentation and reports."""
        rows = zip(self.names, self.units, self.low, self.high, strict=True)
        return [{"name": n, "unit": u, "min": float(low), "max": float(high)} for n, u, low, high in rows]
