"""The quasi-steady rotor of a turbine by blade elements: coefficients, optimum, pitch schedule and sensitivities.

All numbers follow from the turbine's own blade and polars (`wt_gym.turbines.blade_element`), in a fraction of a second.
The blade is rigid and straight, the wind uniform along the shaft; tower, tilt and deflection are left out. The
lattice of the simulator makes up to a tenth more power than blade-element theory below rated wind.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import TYPE_CHECKING

import numpy as np
from scipy.interpolate import RectBivariateSpline

from wt_gym.turbines.blade_element import BladeElementRotor, BladeElements

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from wt_gym.turbines import Turbine

__all__ = ["Rotor", "RotorSlopes", "rotor_of"]

_N_SPAN = 30
"""Sections; the power changes by less than 0.3 % with twice as many."""
_RATIOS = np.concatenate([np.arange(1.5, 6.0, 0.5), np.arange(6.0, 12.0, 0.4), np.arange(12.0, 22.1, 1.25)])
_PITCH = np.radians(np.arange(-8.0, 40.1, 1.25))
"""Grid of the splines: tip-speed ratios and pitch angles [rad]."""
_FINE_RATIOS = np.arange(3.0, 14.01, 0.05)
_LOWEST_FINE, _HIGHEST_FINE = math.radians(-5.0), math.radians(10.0)
"""Range in which the pitch of the largest power coefficient is looked for [rad]."""


@dataclass(frozen=True)
class RotorSlopes:
    """Derivatives of the aerodynamic moment about the shaft and of the thrust at a point.

    Attributes
    ----------
    torque_wind, torque_speed, torque_pitch : float
        [N m/(m/s)], [N m/(rad/s)], [N m/rad].
    thrust_wind, thrust_speed, thrust_pitch : float
        [N/(m/s)], [N/(rad/s)], [N/rad].
    """

    torque_wind: float
    torque_speed: float
    torque_pitch: float
    thrust_wind: float
    thrust_speed: float
    thrust_pitch: float


class Rotor:
    """Rotor of a turbine by blade elements.

    Parameters
    ----------
    turbine : Turbine
    """

    def __init__(self, turbine: Turbine):
        self.elements = BladeElements(BladeElementRotor.of_turbine(turbine), _N_SPAN)
        self.radius, self.air_density = turbine.rotor_diameter / 2, turbine.air_density
        self._lowest = max(turbine.pitch.min_pitch, _LOWEST_FINE)

    def power(self, wind: ArrayLike, rotor_speed: ArrayLike, pitch: ArrayLike) -> NDArray[np.float64]:
        """Aerodynamic power [W], shape (n,), of points (n,): wind [m/s], rotor speed [rad/s] and pitch [rad]."""
        return self._forces(wind, rotor_speed, pitch)[0]

    def thrust(self, wind: ArrayLike, rotor_speed: ArrayLike, pitch: ArrayLike) -> NDArray[np.float64]:
        """Thrust [N], shape (n,); arguments as `power`."""
        return self._forces(wind, rotor_speed, pitch)[1]

    def _forces(
        self, wind: ArrayLike, rotor_speed: ArrayLike, pitch: ArrayLike
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Power [W] and thrust [N] of points (n,): by the splines, or solved where a point lies beyond them."""
        given = (np.atleast_1d(np.asarray(x, dtype=np.float64)) for x in (wind, rotor_speed, pitch))
        winds, speeds, angles = np.broadcast_arrays(*given)
        ratio = speeds * self.radius / winds
        inside = (ratio >= _RATIOS[0]) & (ratio <= _RATIOS[-1]) & (angles >= _PITCH[0]) & (angles <= _PITCH[-1])
        if not inside.all():
            solved = self.elements.solve(winds, speeds, angles)
            return solved["power"], solved["thrust"]
        pressure = 0.5 * self.air_density * math.pi * self.radius**2 * winds**2
        power, thrust = self._splines
        return pressure * winds * power.ev(ratio, angles), pressure * thrust.ev(ratio, angles)

    @cached_property
    def _splines(self) -> tuple[RectBivariateSpline, RectBivariateSpline]:
        """Power and thrust coefficients over tip-speed ratio and pitch [rad], cubic between solved points."""
        values = self.coefficients(_RATIOS, _PITCH)
        return RectBivariateSpline(_RATIOS, _PITCH, values[0]), RectBivariateSpline(_RATIOS, _PITCH, values[1])

    def coefficients(
        self, ratio: NDArray[np.float64], pitch: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Solve power and thrust coefficients (n, m) over tip-speed ratios (n,) and pitch angles (m,) [rad]."""
        ratios, angles = (x.ravel() for x in np.meshgrid(ratio, pitch, indexing="ij"))
        wind = 10.0
        solved = self.elements.solve(wind, ratios * wind / self.radius, angles)
        reference = 0.5 * self.air_density * math.pi * self.radius**2 * wind**2
        shape = ratio.size, pitch.size
        return (solved["power"] / (reference * wind)).reshape(shape), (solved["thrust"] / reference).reshape(shape)

    @cached_property
    def optimum(self) -> tuple[float, float, float]:
        """Tip-speed ratio, pitch [rad] and power coefficient of the largest power coefficient.

        The pitch lies within the range of the drives, from -5 to 10 deg.
        """
        pitch = np.linspace(self._lowest, _HIGHEST_FINE, 121)
        power = self._splines[0](_FINE_RATIOS, pitch)
        i, j = np.unravel_index(int(np.argmax(power)), power.shape)
        return float(_FINE_RATIOS[i]), float(pitch[j]), float(power[i, j])

    def best_ratio(self, pitch: float) -> tuple[float, float]:
        """Tip-speed ratio of the largest power at a pitch [rad], and the power coefficient there."""
        power = self._splines[0](_FINE_RATIOS, [pitch])[:, 0]
        k = int(np.argmax(power))
        return float(_FINE_RATIOS[k]), float(power[k])

    def power_coefficient(self, ratio: float, pitch: float) -> float:
        """Power coefficient at a tip-speed ratio and a pitch [rad]."""
        wind = 10.0
        reference = 0.5 * self.air_density * math.pi * self.radius**2 * wind**3
        return float(self.power(wind, ratio * wind / self.radius, pitch)[0]) / reference

    def pitch_of_power(
        self, wind: ArrayLike, rotor_speed: float, power: float, least: ArrayLike, most: float = 0.66
    ) -> NDArray[np.float64]:
        """Smallest pitch from ``least`` on at which the power falls to ``power`` [rad], shape (n,).

        Parameters
        ----------
        wind : array_like, shape (n,)
            [m/s].
        rotor_speed : float
            [rad/s].
        power : float
            Aerodynamic [W].
        least : array_like, shape () or (n,)
            Returned where the power is less there already [rad].
        most : float
            End of the search [rad].
        """
        winds = np.atleast_1d(np.asarray(wind, dtype=np.float64))
        low = np.broadcast_to(np.asarray(least, dtype=np.float64), winds.shape).copy()
        enough = self.power(winds, rotor_speed, low) > power
        # the power rises with the pitch where a blade leaves stall: begin beyond its last crossing
        steps = np.linspace(0.0, 1.0, 71)
        angles = low[:, None] + steps[None, :] * (most - low)[:, None]
        surplus = self.power(np.repeat(winds, steps.size), rotor_speed, angles.ravel()).reshape(angles.shape) > power
        last = np.where(surplus.any(axis=1), surplus.shape[1] - 1 - np.argmax(surplus[:, ::-1], axis=1), 0)
        last = np.minimum(last, steps.size - 2)
        rows = np.arange(winds.size)
        a, b = angles[rows, last], angles[rows, last + 1]
        for _ in range(36):
            middle = 0.5 * (a + b)
            above = self.power(winds, rotor_speed, middle) > power
            a, b = np.where(above, middle, a), np.where(above, b, middle)
        return np.where(enough | surplus.any(axis=1), 0.5 * (a + b), low)

    def slopes(self, wind: float, rotor_speed: float, pitch: float) -> RotorSlopes:
        """Derivatives at a steady point, by central differences with the induction in equilibrium.

        Parameters
        ----------
        wind, rotor_speed, pitch : float
            [m/s], [rad/s], [rad].
        """
        changes = (0.02 * wind, 0.01 * rotor_speed, math.radians(0.25))
        points = np.tile([wind, rotor_speed, pitch], (6, 1))
        for k, change in enumerate(changes):
            points[2 * k, k] += change
            points[2 * k + 1, k] -= change
        power, thrust = self._forces(*points.T)
        torque = power / points[:, 1]
        found = [
            (values[2 * k] - values[2 * k + 1]) / (2.0 * change)
            for values in (torque, thrust)
            for k, change in enumerate(changes)
        ]
        return RotorSlopes(*map(float, found))

    def frozen_pitch_slope(self, wind: float, rotor_speed: float, pitch: float) -> float:
        """Change of the power with the pitch while the induced velocities are held [W/rad].

        So NREL/TP-500-38060, section 7.3, defines the sensitivity behind the gains of the pitch controller: a speed
        loop is faster than the wake.
        """
        change = math.radians(0.25)
        moved = self.elements.frozen_wake(wind, rotor_speed, pitch, (change, -change))["power"]
        return float((moved[0] - moved[1]) / (2.0 * change))

    def frozen_torque_slopes(
        self, wind: float, rotor_speed: float, pitch: float
    ) -> tuple[tuple[float, float, float], float]:
        """Derivatives of the moment about the shaft while the induced velocities are held, and the mean induction.

        Parameters
        ----------
        wind, rotor_speed, pitch : float
            [m/s], [rad/s], [rad].

        Returns
        -------
        slopes : tuple of float
            Over the wind [N m/(m/s)], the speed [N m/(rad/s)] and the pitch [N m/rad].
        induction : float
            Mean axial induction factor over the disc [-].
        """
        steps = np.array([0.02 * wind, 0.01 * rotor_speed, math.radians(0.25)])
        winds, speeds, angles = np.vstack([np.diag(steps), -np.diag(steps)]).T
        moved = self.elements.frozen_wake(wind, rotor_speed, pitch, angles, winds, speeds)
        torque = moved["power"] / (rotor_speed + speeds)
        slopes = (torque[:3] - torque[3:]) / (2.0 * steps)
        induction = float(np.average(moved["axial"][2], weights=self.elements.radius))  # there the pitch moved alone
        return (float(slopes[0]), float(slopes[1]), float(slopes[2])), induction


@lru_cache(maxsize=32)
def rotor_of(turbine: Turbine) -> Rotor:
    """Rotor of a turbine; the same object for the same turbine."""
    return Rotor(turbine)
