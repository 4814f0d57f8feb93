"""How far additions that cost power below rated may act."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from wt_gym.control.controllers.parameters import Parameter
from wt_gym.control.operating_point import least_pitch
from wt_gym.control.sensors import LowPass

if TYPE_CHECKING:
    from collections.abc import Sequence

    from wt_gym.turbines import Turbine

__all__ = ["FADE", "AboveRated", "FadeParameters"]

_LEAST_FADE, _MOST_FADE = 0.001, 0.5  # [rad]

FADE = Parameter(
    "fade",
    "rad",
    "collective pitch above fine pitch from which on it acts in full, beginning at a sixth of it; True: 0.5° to 3°; "
    "False: always in full",
    _LEAST_FADE,
    _MOST_FADE,
    switch=True,
    kind="FadeParameters",
)
"""Of every addition that fades below rated."""


def _ramp(value: float, low: float, high: float) -> float:
    """Rise from 0 at low to 1 at high with continuous slope."""
    x = min(max((value - low) / (high - low), 0.0), 1.0)
    return x * x * (3.0 - 2.0 * x)


@dataclass(frozen=True)
class FadeParameters:
    """Where an addition begins to act and where it acts in full.

    Attributes
    ----------
    pitch : (float, float)
        Collective pitch above fine pitch [rad].
    speed : (float, float)
        Rotor speed over rated speed [-].
    time_constant : float
        Of the low-pass filter on the pitch [s], so that a swing of the collective pitch does not switch.
    fine_speed : (float, float), optional
        Rotor speed over rated speed at fine pitch [-], where by default nothing acts. About rated wind the loads are
        largest, the blades stand at fine pitch and the rotor near its rated speed.
    """

    pitch: tuple[float, float] = (math.radians(0.5), math.radians(3.0))
    speed: tuple[float, float] = (0.85, 0.95)
    time_constant: float = 5.0
    fine_speed: tuple[float, float] | None = None

    def __post_init__(self) -> None:
        for name in ("pitch", "speed") if self.fine_speed is None else ("pitch", "speed", "fine_speed"):
            low, high = getattr(self, name)
            if not low < high:
                raise ValueError(f"fade {name} must be two rising numbers, got {getattr(self, name)!r}")


class AboveRated:
    """Factor from 0 (below rated: leave the blades where they make the most power) to 1 (well above it).

    The product of a ramp in the collective pitch, low-pass filtered, and one in the rotor speed: blades at fine pitch
    mean that the wind is too weak for rated power. With ``fine_speed``, a ramp of its own in the rotor speed holds
    there.

    Parameters
    ----------
    parameters : FadeParameters
    fine_pitch : float
        [rad].
    rated_speed : float
        Of the rotor [rad/s].
    """

    def __init__(self, parameters: FadeParameters, fine_pitch: float, rated_speed: float):
        self.parameters, self.fine_pitch, self.rated_speed = parameters, fine_pitch, rated_speed
        self._pitch = LowPass(parameters.time_constant)

    @classmethod
    def of_turbine(cls, turbine: Turbine, fade: FadeParameters | bool | float = True) -> AboveRated | None:
        """Of a turbine; None where nothing is to fade.

        Parameters
        ----------
        turbine : Turbine
        fade : FadeParameters, bool or float
            True: the default parameters; False: none; a number: the collective pitch above fine pitch from which on the
            addition acts in full [rad], beginning at a sixth of it as by default.

        Raises
        ------
        ValueError
            For a pitch that is not a number from 0.001 to 0.5 rad.
        """
        if fade is False:
            return None
        parameters = FadeParameters() if fade is True else fade
        if not isinstance(parameters, FadeParameters):
            if not (isinstance(fade, int | float | np.floating) and _LEAST_FADE <= fade <= _MOST_FADE):
                raise ValueError(
                    f"fade must be True, False, FadeParameters or a pitch from {_LEAST_FADE:g} to {_MOST_FADE:g} rad, "
                    f"got {fade!r}"
                )
            parameters = FadeParameters(pitch=(fade / 6.0, float(fade)))
        # with peak shaving the blades are pitched below rated too: what counts begins above the least pitch at rated
        fine = least_pitch(turbine, turbine.rated_wind_speed)
        return cls(parameters, fine, turbine.drivetrain.rated_rotor_speed)

    def start(self, pitch: float) -> None:
        """Start in steady state at a collective pitch [rad]."""
        self._pitch.reset(pitch)

    def update(self, pitch: Sequence[float], rotor_speed: float, dt: float) -> float:
        """Factor after a step of ``dt`` [s] with these pitch demands [rad] at a rotor speed [rad/s]."""
        p = self.parameters
        filtered = self._pitch.update(sum(pitch) / len(pitch), dt)
        pitched, ratio = _ramp(filtered - self.fine_pitch, *p.pitch), rotor_speed / self.rated_speed
        share = pitched * _ramp(ratio, *p.speed)
        return share if p.fine_speed is None else share + (1.0 - pitched) * _ramp(ratio, *p.fine_speed)
