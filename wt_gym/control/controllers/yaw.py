"""Yaw by dead-band: the nacelle turns only when it has stood wrong for a while, then until it faces the wind.

The habit of real yaw drives, which are slow and wear: the reading of the vane, averaged over about a minute, must leave
a dead-band of several degrees before the drive starts (compare ROSCO's Y_ErrThresh of 4 … 8 degrees and
Y_uSwitch; Bossanyi et al., Energy Procedia 35 (2013) 177).
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from wt_gym.control.actions import Demand
from wt_gym.control.controllers.controller import parts_of
from wt_gym.control.controllers.parameters import Parameter
from wt_gym.control.sensors import AngleLowPass

if TYPE_CHECKING:
    from typing import Any

    from wt_gym.control.controllers.controller import Controller, Readings
    from wt_gym.turbines import Turbine

__all__ = ["PARAMETERS", "YawByDeadBand", "yaw_drive_of"]

PARAMETERS = (
    Parameter("dead_band", "rad", "filtered yaw error beyond which the drive starts", 0.0, math.pi, above=True),
    Parameter("stop", "rad", "yaw error at which the drive stops, below the dead band", 0.0, math.pi),
    Parameter("slow", "s", "time constant of the filter on the yaw error while the nacelle rests", 0.0, above=True),
    Parameter("fast", "s", "time constant of the filter on the yaw error while the nacelle turns", 0.0, above=True),
)
"""What can be chosen (`wt_gym.control.controllers.parameters`)."""


class YawByDeadBand:
    """Addition that turns the nacelle into the wind at the greatest rate of its drive.

    At rest the yaw error passes a slow low-pass filter; the drive starts when that leaves the dead-band. Turning, a
    faster filter is read, and the drive stops when the error has become small or has changed sign through zero; the
    slow filter then resumes at that reading. A wind from behind, whose error flips between 180 and -180 degrees, does
    not turn the drive back. A filter of time constant tau delays as much as an average over 2 tau.

    Parameters
    ----------
    rate : float
        Of the drive [rad/s].
    dead_band : float
        Filtered yaw error beyond which the drive starts [rad].
    stop : float
        Error at which it stops [rad].
    slow, fast : float
        Time constants at rest and while turning [s].

    Attributes
    ----------
    turning : int
        +1 or -1 while the drive turns, else 0.
    """

    channels = ("yaw_error",)

    def __init__(
        self,
        rate: float,
        dead_band: float = math.radians(8.0),
        stop: float = math.radians(0.5),
        slow: float = 30.0,
        fast: float = 5.0,
    ):
        if not 0.0 <= stop < dead_band:
            raise ValueError(f"a yaw drive needs 0 <= stop < dead_band, got {stop!r} and {dead_band!r} rad")
        self.rate, self.dead_band, self.stop = float(rate), float(dead_band), float(stop)
        self._slow, self._fast, self.turning = AngleLowPass(slow), AngleLowPass(fast), 0

    @property
    def slow_error(self) -> float:
        """Yaw error behind the slow filter, which starts the drive beyond the dead-band [rad]."""
        return self._slow.value

    @classmethod
    def of_turbine(cls, turbine: Turbine, **parameters: Any) -> YawByDeadBand:
        """With the yaw drive of a turbine; parameters as those of the class."""
        return cls(turbine.nacelle.max_yaw_rate, **parameters)

    def start(self, signals: Readings) -> None:
        """Start at rest, as if the present error had been there for long, but no further than the dead-band."""
        error = signals["yaw_error"]
        self._slow.reset(min(max(error, -self.dead_band), self.dead_band))
        self._fast.reset(error)
        self.turning = 0

    def step(self, signals: Readings, dt: float, demand: Demand) -> Demand:
        """Set the yaw rate."""
        error = signals["yaw_error"]
        slow, fast = self._slow.update(error, dt), self._fast.update(error, dt)
        if self.turning == 0 and abs(slow) > self.dead_band:
            self.turning = 1 if slow > 0.0 else -1
        elif self.turning != 0 and self.turning * fast <= self.stop and abs(fast) < 0.5 * math.pi:
            self.turning = 0
            self._slow.reset(fast)
        return Demand(demand.pitch, self.turning * self.rate, demand.generator_torque)


def yaw_drive_of(controller: Controller | None) -> YawByDeadBand | None:
    """Dead-band control among the parts of a controller, None without any."""
    parts = () if controller is None else parts_of(controller)
    return next((part for part in parts if isinstance(part, YawByDeadBand)), None)
