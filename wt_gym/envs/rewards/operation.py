"""Penalties on how the turbine is run: use of the actuators, speed above rated."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from wt_gym.envs.rewards.term import bounded_square

if TYPE_CHECKING:
    from wt_gym.envs.rewards.term import Transition

__all__ = ["ActuatorUse", "Overspeed"]


@dataclass(frozen=True)
class ActuatorUse:
    """Penalty on actuator use: mean of |rate| / greatest rate over the blades' pitch, the yaw drive and the torque.

    The share of the pitch system is the actuator duty cycle, by the way that the blades turned in all time steps of the
    simulator. Torque counts by its change over the step. A turbine without yaw drive, or with a damper as generator,
    has the mean of the others.
    """

    weight: float = 0.1
    name: str = "actuator_use"

    def __call__(self, transition: Transition) -> float:
        """Rate of reward [1/s]."""
        turbine, before, after = transition.turbine, transition.before, transition.after
        travel: float = sum(after["pitch_travel"].tolist()) / turbine.n_blades
        uses = [travel / transition.dt / turbine.pitch.max_rate]
        if turbine.drivetrain.takes_torque:
            torque: float = abs(after["generator_torque"] - before["generator_torque"]) / transition.dt
            uses.append(torque / turbine.drivetrain.max_torque_rate)
        if turbine.nacelle.max_yaw_rate > 0.0:
            uses.append(abs(after["yaw_rate"]) / turbine.nacelle.max_yaw_rate)
        return -self.weight * sum([min(use, 1.0) for use in uses]) / len(uses)


@dataclass(frozen=True)
class Overspeed:
    """Penalty on rotor speed above ``margin`` times rated: x = excess / (``scale`` * rated)."""

    weight: float = 0.4
    margin: float = 1.02
    scale: float = 0.1
    name: str = "overspeed"

    def __call__(self, transition: Transition) -> float:
        """Rate of reward [1/s]."""
        rated = transition.turbine.drivetrain.rated_rotor_speed
        excess = max(transition.after["rotor_speed"] / rated - self.margin, 0.0)
        return -self.weight * bounded_square((excess / self.scale) ** 2)
