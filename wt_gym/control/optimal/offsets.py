"""Offsets of the blades' pitch as mean, tilt and yaw in the fixed frame, within limits, as they reach the drives."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from wt_gym.control.actions import Demand
from wt_gym.control.coleman import to_blades
from wt_gym.control.controllers.fading import AboveRated, FadeParameters
from wt_gym.control.controllers.parameters import Parameter
from wt_gym.simulation.drivetrain.drives import pitch_delay

if TYPE_CHECKING:
    from collections.abc import Sequence

    from wt_gym.turbines import Turbine

__all__ = ["OFFSET_PARAMETERS", "PitchOffsets", "default_limits"]

OFFSET_PARAMETERS = (
    Parameter("limit", "rad", "largest mean offset, and largest amplitude of tilt and yaw", 0.0, math.pi),
    Parameter("rate_limit", "rad/s", "largest rate of the mean offset, and of tilt and yaw together", 0.0, above=True),
)

_MOST, _MOST_RATE = math.radians(4.0), math.radians(3.0)
_TURNING, _CHANGING = 0.625, 0.375
"""Shares of the rate of the pitch drive: for cyclic pitch that lasts, and for its change [-]."""


def default_limits(turbine: Turbine) -> tuple[float, float]:
    """Largest offset [rad] and largest rate of offsets [rad/s] that the pitch drives of a turbine can follow.

    Tilt and yaw offsets of amplitude A, which change at the rate r in the fixed frame, move a blade of a rotor at the
    speed Ω at up to A Ω + r. At rated speed that is the rate of the drive; both are at most 4° and 3°/s.
    """
    most = turbine.pitch.max_rate
    limit = _TURNING * most / turbine.drivetrain.rated_rotor_speed
    return min(limit, _MOST), min(_CHANGING * most, _MOST_RATE)


class PitchOffsets:
    """Adds offsets in the fixed frame to a demand and says what of them reaches the drives.

    The mean is limited in size and rate, tilt and yaw in the 2-norm of both. Below rated all fade out, because pitch
    costs power there. No blade is pitched beyond the range of its drive: what is left of the offsets is given back, so
    that a model of the turbine gets the inputs that the turbine gets.

    Parameters
    ----------
    turbine : Turbine
    limit, rate_limit : float
        [rad], [rad/s].
    fade : FadeParameters, bool or float
        As of `AboveRated.of_turbine`; False: always in full.

    Attributes
    ----------
    share : float
        Of the fade [-].
    acting : tuple of float
        Mean, tilt and yaw that reached the drives in the last step [rad].

    Raises
    ------
    ValueError
        For a turbine of less than three blades, or limits out of range.
    """

    def __init__(
        self, turbine: Turbine, limit: float, rate_limit: float, fade: FadeParameters | bool | float = True
    ) -> None:
        if turbine.n_blades < 3:
            raise ValueError(f"offsets in the fixed frame need at least 3 blades, got {turbine.n_blades}")
        if not (0.0 <= limit < math.inf and 0.0 < rate_limit < math.inf):
            raise ValueError(
                f"limit must be finite and not negative, rate_limit finite and positive; got {limit!r}, {rate_limit!r}"
            )
        self.limit, self.rate_limit = limit, rate_limit
        self.drive, self.n_blades = turbine.pitch, turbine.n_blades
        self.fade = AboveRated.of_turbine(turbine, fade)
        self.start()

    def start(self) -> None:
        """Forget everything: there are no offsets."""
        self.share, self._fresh = 1.0, True
        self._asked = (0.0, 0.0, 0.0)
        self.acting = (0.0, 0.0, 0.0)

    def update_share(self, demand: Demand, rotor_speed: float, dt: float) -> float:
        """Share in which offsets act on a demand, before `added` is called for the same step."""
        if self.fade is not None:
            before = list(map(float, demand.pitch))
            if self._fresh:
                self.fade.start(sum(before) / len(before))
            self.share = self.fade.update(before, rotor_speed, dt)
        self._fresh = False
        return self.share

    def added(self, wanted: Sequence[float], demand: Demand, azimuth: float, rotor_speed: float, dt: float) -> Demand:
        """Demand with offsets.

        Parameters
        ----------
        wanted : sequence of float, length 3
            Mean, tilt and yaw [rad]; what limits and rates let through counts.
        demand : Demand
            Stays as it is.
        azimuth, rotor_speed, dt : float
            [rad], [rad/s], [s].
        """
        mean, tilt, yaw = wanted
        mean = min(max(mean, -self.limit), self.limit)
        tilt, yaw = _within(tilt, yaw, self.limit)
        last, reach = self._asked, self.rate_limit * dt
        mean = last[0] + min(max(mean - last[0], -reach), reach)
        move = _within(tilt - last[1], yaw - last[2], reach)
        self._asked = (mean, last[1] + move[0], last[2] + move[1])
        ahead = azimuth + rotor_speed * pitch_delay(self.drive, dt)
        low, high = self.drive.min_pitch, self.drive.max_pitch
        pitch, reached = [], []
        for before, offset in zip(map(float, demand.pitch), to_blades(self._asked, ahead, self.n_blades), strict=True):
            angle = min(max(before + offset, min(before, low)), max(before, high))
            pitch.append(angle)
            reached.append(angle - before)
        self.acting = self._in_fixed_frame(reached, ahead)
        return Demand(np.array(pitch), demand.yaw_rate, demand.generator_torque)

    def between(
        self, before: Demand, after: Demand, azimuth: float, rotor_speed: float, dt: float
    ) -> tuple[float, float, float]:
        """Mean, tilt and yaw [rad] by which one demand differs from another, at the azimuth at which it acts."""
        ahead = azimuth + rotor_speed * pitch_delay(self.drive, dt)
        pairs = zip(after.pitch.tolist(), before.pitch.tolist(), strict=True)
        return self._in_fixed_frame([own - base for own, base in pairs], ahead)

    def _in_fixed_frame(self, values: list[float], azimuth: float) -> tuple[float, float, float]:
        """Mean, tilt and yaw, numbers one by one: arrays of three are slow."""
        n = self.n_blades
        angles = [azimuth + 2.0 * math.pi * b / n for b in range(n)]
        tilt = sum(x * math.cos(a) for x, a in zip(values, angles, strict=True))
        yaw = sum(x * math.sin(a) for x, a in zip(values, angles, strict=True))
        return sum(values) / n, 2.0 / n * tilt, 2.0 / n * yaw


def _within(x: float, y: float, size: float) -> tuple[float, float]:
    """Vector shortened to a size."""
    length = math.hypot(x, y)
    return (x, y) if length <= size else (x * size / length, y * size / length)
