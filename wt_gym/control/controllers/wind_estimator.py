"""Rotor-effective wind speed from what every turbine measures: rotor speed, generator torque and pitch.

The rotor is the anemometer. With the moment of the air ``Q(v, Omega, theta)`` from the rotor's table,

    ``J dOmega/dt = Q(v, Omega, theta) - N M_gen / eta``,

and the wind is what explains the acceleration. The estimator is that of immersion and invariance (Ortega,
Mancilla-David and Jaramillo, Int. J. Robust Nonlinear Control 23 (2013) 1346):

    ``v = beta + gamma Omega``,  ``d beta/dt = (gamma / J) (N M_gen / eta - Q(v, Omega, theta))``.

Its error decays at the rate ``(gamma/J) dQ/dv`` wherever Q grows with v. Here gamma follows that slope so that the rate
is one chosen bandwidth in every wind (beta is set again with it, so that the estimate does not jump).

A shaft that twists lets rotor and generator swing against each other: to the rotor's speed alone, with the inertia of
both, this is wind. Their momentum ``J_r Omega_r + J_g Omega_g`` does not know it. A generator with most of the inertia
(a rotor of 8.6e6 kg m^2 before one of 122e6 kg m^2 in a public model) otherwise feeds its torsion back through the
estimate, with a mode that grows; Omega then is the mean of both speeds by inertia.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from wt_gym.control.controllers.rotor_rules import slower_than_reference
from wt_gym.control.operating_point import rotor_inertia
from wt_gym.control.rotor_table import RotorTable, rotor_table

if TYPE_CHECKING:
    from wt_gym.control.controllers.controller import Readings
    from wt_gym.turbines import Turbine

__all__ = ["WindEstimator", "bandwidth_of"]

LOWEST, HIGHEST = 2.0, 40.0
"""Range of the estimate [m/s]."""


def bandwidth_of(turbine: Turbine) -> float:
    """Bandwidth of the estimator by rule [rad/s]: 0.5 rad/s for a rotor of 12.1 rpm, in proportion to the rated
    speed.
    """
    return 0.5 / slower_than_reference(turbine)


class WindEstimator:
    """Estimator of the rotor-effective wind speed.

    Parameters
    ----------
    table : RotorTable
    inertia : float
        Of rotor and generator about the low-speed shaft [kg m^2].
    gear_ratio, gearbox_efficiency : float
        [-].
    n_blades : int
    bandwidth : float
        Rate at which an error of the estimate decays [rad/s].
    lowest_speed : float
        Rotor speed below which the estimate is held [rad/s]: a rotor at rest tells nothing.
    generator_share : float
        Share of the generator in the inertia, by which its speed counts [-]; 0: the rotor's speed is read alone.

    Attributes
    ----------
    wind : float
        Present estimate [m/s]; NaN before `start`.

    Notes
    -----
    A step takes measurements that are held over it. The estimate moves to the fixed point of the equation with the
    exponential of the local rate, exact for the equation linearized in v.
    """

    def __init__(
        self,
        table: RotorTable,
        inertia: float,
        gear_ratio: float = 1.0,
        gearbox_efficiency: float = 1.0,
        n_blades: int = 3,
        bandwidth: float = 0.5,
        lowest_speed: float = 0.1,
        generator_share: float = 0.0,
    ):
        if not 0.0 < bandwidth < math.inf:
            raise ValueError(f"the bandwidth of the wind estimator must be positive, got {bandwidth!r} rad/s")
        self.table, self.inertia, self.bandwidth, self.lowest_speed = table, inertia, bandwidth, lowest_speed
        self._gear_ratio, self._to_moment = gear_ratio, gear_ratio / gearbox_efficiency
        self.generator_share = generator_share
        self._pitch_names = tuple(f"pitch_{b + 1}" for b in range(n_blades))
        shaft = ("generator_speed",) if generator_share > 0.0 else ()
        self.channels = ("rotor_speed", *shaft, "generator_torque", *self._pitch_names)
        self.wind, self._speed = math.nan, math.nan

    @classmethod
    def of_turbine(
        cls,
        turbine: Turbine,
        bandwidth: float | None = None,
        table: RotorTable | None = None,
        reads_generator: bool = False,
    ) -> WindEstimator:
        """Make the estimator of a turbine.

        By default it has the table of `rotor_table.rotor_table` and the bandwidth of `bandwidth_of`. With
        ``reads_generator`` it reads the speed of the generator too, by its share in the inertia.
        """
        drivetrain, inertia = turbine.drivetrain, rotor_inertia(turbine)
        generator = drivetrain.gear_ratio**2 * drivetrain.generator_inertia
        return cls(
            rotor_table(turbine) if table is None else table,
            inertia,
            drivetrain.gear_ratio,
            drivetrain.gearbox_efficiency,
            turbine.n_blades,
            bandwidth_of(turbine) if bandwidth is None else bandwidth,
            0.1 * drivetrain.rated_rotor_speed,
            generator / inertia if reads_generator else 0.0,
        )

    def start(self, signals: Readings) -> float:
        """Start from the wind in which the present torque holds the present speed; return it [m/s]."""
        speed, pitch = self._speed_of(signals), self._pitch(signals)
        self._speed = speed
        if speed < self.lowest_speed:
            self.wind = LOWEST
            return self.wind
        winds = np.linspace(LOWEST, HIGHEST, 153)
        moment = np.array([self.table.torque(v, speed, pitch) for v in winds])
        enough = np.flatnonzero(moment >= self._to_moment * signals["generator_torque"])
        self.wind = float(winds[enough[0]]) if enough.size else LOWEST
        return self.wind

    def update(self, signals: Readings, dt: float) -> float:
        """Take the measurements after a step of ``dt`` [s] and return the estimate [m/s]."""
        speed, pitch = self._speed_of(signals), self._pitch(signals)
        before, self._speed = self._speed, speed
        if min(speed, before) < self.lowest_speed:
            return self.wind
        v, small = self.wind, 0.1
        slope = (self.table.torque(v + small, speed, pitch) - self.table.torque(v - small, speed, pitch)) / (2 * small)
        # where the table falls with the wind, deep in stall, the estimator would run away: there it only creeps
        slope = max(slope, _least_slope(self.table, v))
        surplus = self._to_moment * signals["generator_torque"] - self.table.torque(v, speed, pitch)
        acceleration = self.inertia * (speed - before) / dt
        self.wind = v + (acceleration + surplus) / slope * -math.expm1(-self.bandwidth * dt)
        self.wind = min(max(self.wind, LOWEST), HIGHEST)
        return self.wind

    def _speed_of(self, signals: Readings) -> float:
        """Speed of the drive train [rad/s]: that of the rotor, or the mean of rotor and generator by inertia."""
        speed = signals["rotor_speed"]
        if self.generator_share == 0.0:
            return speed
        return speed + self.generator_share * (signals["generator_speed"] / self._gear_ratio - speed)

    def _pitch(self, signals: Readings) -> float:
        return sum(signals[name] for name in self._pitch_names) / len(self._pitch_names)


def _least_slope(table: RotorTable, wind: float) -> float:
    """A tenth of the slope of the moment at the best power and that wind [N m s/m]."""
    ratio, best = table.optimum
    return 0.1 * 0.5 * table.air_density * math.pi * table.radius**3 * best / ratio * 2.0 * wind
