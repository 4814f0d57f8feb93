"""Power, relative to what the wind and the turbine allow."""

import math
from dataclasses import dataclass, field
from typing import cast

import numpy as np
from numpy.typing import NDArray

from wt_gym.control.design import design_point, rotor_inertia
from wt_gym.envs.terms import Transition
from wt_gym.simulation import Signals
from wt_gym.turbines import Turbine
from wt_gym.wind import Inflow
from wt_gym.wind.inflow import fill_velocity, read_only

RINGS, AZIMUTHS = np.sqrt([0.25, 0.75]), 2.0 * np.pi * np.arange(6) / 6
"""Points of equal area of a rotor disc: radii over that of the rotor [-], azimuths [rad]."""
DISC_TIME = 5.0
"""Time constant of the filter of the wind over the rotor disc [s]."""


def available_power(turbine: Turbine, wind_speed: float) -> float:
    """Electrical power that a turbine can make of a steady wind [W].

    ``min(rated, rho A Cp_max eta V^3 / 2)`` with the swept area of the coned rotor, the peak power coefficient of
    `wt_gym.control.design.design_point` and the efficiency of gearbox and generator.

    Parameters
    ----------
    wind_speed : float
        Rotor-effective wind speed [m/s].
    """
    return min(turbine.drivetrain.rated_power, _power_factor(turbine) * wind_speed**3)


def efficiency(turbine: Turbine) -> float:
    """Electrical power over power on the low-speed shaft [-]."""
    return turbine.drivetrain.gearbox_efficiency * turbine.drivetrain.generator_efficiency


def _power_factor(turbine: Turbine) -> float:
    """Electrical power over cubed wind speed at the design point [W/(m/s)^3]."""
    radius = turbine.rotor_diameter / 2 * math.cos(turbine.hub.cone)
    area = math.pi * radius**2
    return 0.5 * turbine.air_density * area * design_point(turbine).peak_power_coefficient * efficiency(turbine)


def disc_points(turbine: Turbine) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Points of equal area of the rotor disc: distance to the left of the hub and height, each (12,) [m]."""
    ring = turbine.rotor_diameter / 2 * RINGS
    return np.outer(ring, np.sin(AZIMUTHS)).ravel(), turbine.hub_height + np.outer(ring, np.cos(AZIMUTHS)).ravel()


class DiscWind:
    """Mean horizontal wind over 12 points of equal area of a disc of the rotor's size at the hub.

    The disc stands across the wind: it faces the direction of that mean wind behind a first-order low-pass filter,
    which begins with the undisturbed wind at the hub. So it depends on nothing that an agent does. Without an inflow
    the undisturbed wind at the hub stands for it.

    Parameters
    ----------
    time_constant : float
        Of the filter [s].
    """

    def __init__(self, turbine: Turbine, time_constant: float = DISC_TIME):
        self.time_constant = time_constant
        self._beside, height = disc_points(turbine)
        self._disc, self._disc_wind = np.zeros((len(height), 3)), np.zeros((len(height), 3))
        self._disc[:, 2] = height
        self._mean = (0.0, 0.0)
        self._step, self.gain = math.nan, math.nan

    def begin(self, inflow: Inflow | None, signals: Signals) -> float:
        """Speed at the start [m/s]."""
        self._mean = signals["wind_x"], signals["wind_y"]
        self._mean = self._wind(inflow, signals)
        return math.hypot(*self._mean)

    def advance(self, inflow: Inflow | None, signals: Signals, dt: float) -> float:
        """Speed at the end of a step [m/s], with `gain` of the filter in it."""
        if self._step != dt:
            self._step, self.gain = dt, 1.0 - math.exp(-dt / self.time_constant)
        (x, y), (mean_x, mean_y), gain = self._wind(inflow, signals), self._mean, self.gain
        self._mean = mean_x + gain * (x - mean_x), mean_y + gain * (y - mean_y)
        return math.hypot(x, y)

    def _wind(self, inflow: Inflow | None, signals: Signals) -> tuple[float, float]:
        """Components along x and y [m/s]."""
        if inflow is None:
            return signals["wind_x"], signals["wind_y"]
        x, y = self._mean
        size = math.hypot(x, y)
        cos, sin = (x / size, y / size) if size > 0.0 else (1.0, 0.0)  # in a calm any disc will do
        np.multiply(self._beside, -sin, out=self._disc[:, 0])
        np.multiply(self._beside, cos, out=self._disc[:, 1])
        fill_velocity(inflow, read_only(self._disc), signals["time"], self._disc_wind)
        x, y, _ = np.add.reduce(self._disc_wind).tolist()
        return x / len(self._disc), y / len(self._disc)


@dataclass(eq=False)
class Power:
    """Electrical power plus what is stored in the rotor, less the power that wind and turbine allow.

    The rate is ``w (1 + (P + dE/dt - P_available) / P_rated)`` within [-w, 2 w]: about w for a turbine that takes what
    there is, whatever the wind, 0 for an idle one at rated wind, and lower by the same amount for every joule lost.

    - P is the mean of the electrical power at both ends of the step. Above rated power nothing is paid, and what goes
      beyond ``overload`` times rated is subtracted twice.
    - E is the kinetic energy of rotor and generator times the efficiency of the drivetrain, up to that at rated speed.
      Being a function of the state its changes sum to the difference between end and start of an episode: emptying the
      rotor earns nothing, nor does filling it at the end beyond rated speed, and driving it with the generator costs.
      It is a potential in the sense of Ng, Harada and Russell (1999), here without discount.
    - P_available is `available_power` at the rotor-effective wind, the size of `DiscWind` behind a filter of the same
      kind. It depends on nothing that an agent does: yawing away from the wind does not lower it.

    A difference and not a ratio, because a ratio to the available power of the moment would pay a joule stored in a
    lull more than it costs when taken out in a gust.

    Parameters
    ----------
    time_constant : float
        Of the filter of the wind [s].
    overload : float
        Electrical power over rated power from which on more power costs [-].
    """

    weight: float = 1.0
    time_constant: float = DISC_TIME
    overload: float = 1.03
    name: str = "power"
    _disc: DiscWind | None = field(default=None, init=False)

    def reset(self, turbine: Turbine, signals: Signals) -> None:
        """Start an episode: the filter of the wind begins with the wind of the first step."""
        drivetrain = turbine.drivetrain
        self._wind_speed = math.nan
        self._rated_power, self._rated_speed = drivetrain.rated_power, drivetrain.rated_rotor_speed
        self._half_inertia = 0.5 * rotor_inertia(turbine) * efficiency(turbine)
        self._power_factor = _power_factor(turbine)
        self._disc = DiscWind(turbine, self.time_constant)

    def __call__(self, transition: Transition) -> float:
        """Rate of reward [1/s]."""
        if self._disc is None:
            self.reset(transition.turbine, transition.before)
        before, after, dt = transition.before, transition.after, transition.dt
        power = 0.5 * (self._paid(before["generator_power"]) + self._paid(after["generator_power"]))
        stored = (self._energy(after["rotor_speed"]) - self._energy(before["rotor_speed"])) / (dt * self._rated_power)
        value = 1.0 + power + stored - self._available(transition)
        return self.weight * min(max(value, -1.0), 2.0)

    def _paid(self, power: float) -> float:
        """Power that counts, over rated power [-]."""
        ratio = power / self._rated_power
        return min(ratio, 1.0) - 2.0 * max(ratio - self.overload, 0.0)

    def _energy(self, rotor_speed: float) -> float:
        """Kinetic energy that counts [J]."""
        return self._half_inertia * min(max(rotor_speed, 0.0), self._rated_speed) ** 2

    def _available(self, transition: Transition) -> float:
        """Available power over rated power [-]."""
        disc = cast("DiscWind", self._disc)
        if math.isnan(self._wind_speed):
            self._wind_speed = disc.begin(transition.inflow, transition.before)
        speed = disc.advance(transition.inflow, transition.after, transition.dt)
        self._wind_speed += disc.gain * (speed - self._wind_speed)
        return min(1.0, self._power_factor * self._wind_speed**3 / self._rated_power)
