"""Gain-scheduled proportional-integral law of the collective pitch, shared by the speed controllers.

Gains come in one of two forms. As published for the NREL 5-MW (NREL/TP-500-38060, section 7.3), a factor
``GK = 1/(1 + theta/theta_K)`` before both gains and the integral of the speed error. Or as a table over the pitch, as
in ROSCO's input files (Abbas et al., Wind Energ. Sci. 7 (2022) 53, section 3.2): then the integral gain stands inside
the integral, so that a gain that changes with the pitch does not move the demand.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from wt_gym.base.errors import ControllerError

__all__ = ["GainTable", "PitchLaw"]


@dataclass(frozen=True)
class GainTable:
    """Gains over the pitch, linear between the points and held beyond the ends.

    Attributes
    ----------
    pitch : tuple of float
        Ascending [rad].
    proportional, integral : tuple of float
        From generator speed error [rad/s] to pitch [s], [-].
    """

    pitch: tuple[float, ...]
    proportional: tuple[float, ...]
    integral: tuple[float, ...]

    def __post_init__(self) -> None:
        if not len(self.pitch) == len(self.proportional) == len(self.integral) > 0:
            raise ControllerError(
                f"a gain table needs as many gains as pitch angles, at least one, got {len(self.pitch)} angles, "
                f"{len(self.proportional)} and {len(self.integral)} gains"
            )
        if not all(gain > 0.0 for gain in self.integral):
            raise ControllerError(f"integral gains of a table must be positive, got {self.integral}")

    def at(self, pitch: float) -> tuple[float, float]:
        """Proportional and integral gain at a pitch [rad]."""
        return (
            float(np.interp(pitch, self.pitch, self.proportional)),
            float(np.interp(pitch, self.pitch, self.integral)),
        )


@dataclass(frozen=True)
class PitchLaw:
    """The law; what it remembers, the integral, is given and returned.

    Attributes
    ----------
    proportional_gain, integral_gain : float
        At zero pitch [s], [-].
    gain_doubling_pitch : float
        Pitch at which the gains are halved [rad].
    table : GainTable or None
        Takes the place of the three.
    """

    proportional_gain: float
    integral_gain: float
    gain_doubling_pitch: float
    table: GainTable | None = None

    def factor(self, pitch: float) -> float:
        """Gain reduction GK for the stronger response of the rotor at larger pitch [-]."""
        return 1.0 / (1.0 + pitch / self.gain_doubling_pitch)

    def gains(self, pitch: float) -> tuple[float, float]:
        """Proportional and integral gain at a pitch [rad]."""
        if self.table is not None:
            return self.table.at(pitch)
        factor = self.factor(pitch)
        return factor * self.proportional_gain, factor * self.integral_gain

    def holding(self, pitch: float, error: float | None = None) -> float:
        """Integral with which the law demands the present pitch [rad] at a speed error [rad/s].

        Without an error the integral alone holds the pitch.
        """
        if self.table is not None:
            return pitch - (0.0 if error is None else self.table.at(pitch)[0] * error)
        if error is None:
            return pitch / (self.factor(pitch) * self.integral_gain)
        return (pitch / self.factor(pitch) - self.proportional_gain * error) / self.integral_gain

    def step(
        self, pitch: float, integral: float, error: float, dt: float, low: float, high: float
    ) -> tuple[float, float]:
        """Pitch demand [rad] within limits [rad], and the integral, held within them too (anti-windup).

        Parameters
        ----------
        pitch : float
            Previous demand, at which the gains are taken [rad].
        integral : float
            Before the step: of the speed error [rad], or with a table of the pitch [rad].
        error : float
            Speed error [rad/s].
        dt : float
            [s].
        low, high : float
            [rad].
        """
        if self.table is not None:
            proportional, gain = self.table.at(pitch)
            integral = min(max(integral + gain * error * dt, low), high)
            return min(max(proportional * error + integral, low), high), integral
        factor = self.factor(pitch)
        to_integral = 1.0 / (factor * self.integral_gain)
        integral = integral + error * dt
        integral = min(max(integral, low * to_integral), high * to_integral)
        demand = factor * (self.proportional_gain * error + self.integral_gain * integral)
        return min(max(demand, low), high), integral

    def moved(self, before: float, change: float, integral: float) -> float:
        """Integral with which the next demand is moved by ``change`` [rad] from the present one ``before`` [rad].

        The gain factor stands before the integral too: a shift of the integral alone would shrink with the factor that
        belongs to the new pitch.
        """
        if self.table is not None:
            return integral + change
        integral = self.factor(before) * integral + change / self.integral_gain
        return integral / self.factor(before + change)
