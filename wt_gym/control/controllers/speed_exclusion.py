"""Rotor speeds that a set point passes quickly: those at which the passing blades, or one turn, excite the tower."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from wt_gym.control.controllers.rotor_rules import tower_top

if TYPE_CHECKING:
    from wt_gym.turbines import Turbine

__all__ = ["SpeedExclusion", "resonant_speed"]


def resonant_speed(turbine: Turbine) -> float | None:
    """Speed of operation at which the passing blades, else one turn, meet the first tower mode [rad/s].

    None where there is none from 10 % below the least to rated rotor speed.
    """
    drivetrain, tower = turbine.drivetrain, tower_top(turbine)
    for frequency in (tower.fore_aft / turbine.n_blades, tower.fore_aft):
        if 0.9 * drivetrain.min_rotor_speed < frequency < drivetrain.rated_rotor_speed:
            return frequency
    return None


class SpeedExclusion:
    """Set point that waits at one end of a band of speeds, and then crosses it.

    A set point that rises into the band stays at its lower end until the requested one has passed the upper end, and
    the other way round: as the resonance avoidance of ROSCO 2.10 (TRA_ExclSpeed, TRA_ExclBand, TRA_RateLimit), with
    a hysteresis of the whole band. It crosses at a limited rate, and keeps
    to that until it has reached the requested one.

    Parameters
    ----------
    low, high : float
        Of the band, generator speed [rad/s].
    rate : float
        At which the set point moves [rad/s^2].
    least : float
        Least set point; where the band reaches below it, the set point waits above the band alone [rad/s].

    Attributes
    ----------
    value : float
        Present set point [rad/s]; NaN before the first.
    """

    def __init__(self, low: float, high: float, rate: float, least: float = 0.0):
        if not (0.0 < low < high and rate > 0.0):
            raise ValueError(
                f"a band of speeds needs 0 < low < high and a positive rate, got {low!r}, {high!r}, {rate!r}"
            )
        self.low, self.high, self.rate = float(low), float(high), float(rate)
        self._always_above = low < least
        self.value, self._above, self._crossing = math.nan, 0.0, False

    @classmethod
    def of_turbine(cls, turbine: Turbine, half_width: float, crossing: float = 5.0) -> SpeedExclusion:
        """About the resonance of a turbine.

        Parameters
        ----------
        turbine : Turbine
        half_width : float
            Of the band over the resonant speed [-].
        crossing : float
            Time in which the set point crosses the band [s].

        Raises
        ------
        ValueError
            If the turbine has no resonance within its speeds.
        """
        center, drivetrain = resonant_speed(turbine), turbine.drivetrain
        if center is None:
            raise ValueError(
                f"resonance must be 0 for {turbine.name}: neither the passing blades nor one turn meet the tower's "
                f"frequency between its least and its rated rotor speed; got {half_width!r}"
            )
        center *= drivetrain.gear_ratio
        width = 2.0 * half_width * center
        least = drivetrain.min_rotor_speed * drivetrain.gear_ratio
        return cls(center - 0.5 * width, center + 0.5 * width, width / crossing, least)

    def start(self) -> None:
        """Forget the set point."""
        self.value, self._above, self._crossing = math.nan, 0.0, False

    def moved(self, requested: float, dt: float) -> float:
        """Set point for a requested one [rad/s] after another ``dt`` [s]."""
        if math.isnan(self.value):
            self._above = float(requested > 0.5 * (self.low + self.high))
        if requested >= self.high:
            self._above = 1.0
        elif requested <= self.low:
            self._above = 0.0
        if self.low < requested < self.high or self._always_above:
            requested = max(requested, self.high) if self._above or self._always_above else self.low
        if math.isnan(self.value):
            self.value = requested
        elif self._crossing or (min(self.value, requested) < self.high and max(self.value, requested) > self.low):
            self.value += min(max(requested - self.value, -self.rate * dt), self.rate * dt)
            self._crossing = self.value != requested  # beyond the band too: the requested one may lie far behind it
        else:
            self.value = requested
        return self.value
