"""Design point of a turbine's controller: its own data where there are any, else its own rotor by blade elements.

Speed loop
----------
Where nothing is published, the pitch controller places the poles of the rotor speed at a natural frequency omega_n
and a damping ratio of 0.7 (Hansen et al., Control design for a pitch-regulated, variable speed wind turbine,
Riso-R-1500, 2005, section 2, which recommends 0.6 to 0.8). omega_n is the least of four frequencies, the first
two at 1.2 times the rated wind speed with sigma the standard deviation of the normal turbulence model (IEC 61400-1) for
the turbine's class:

- *inertia*: with which a step of the wind by sigma raises the rotor speed by no more than 2 %. Above rated a pole pair
  of damping 1 answers a step dQ of the moment with ``dQ/J t exp(-omega_n t)``, at most ``dQ/(e J omega_n)``, so
  ``omega_n = (dQ/dV) sigma/(e J Omega 0.02)``;
- *pitch rate*: with which that step asks the drives for no more than 0.4 of their rate; the pitch moves through
  ``(dtheta/dV) sigma`` in about ``1/omega_n``, so ``omega_n = 0.4 theta'_max/((dtheta/dV) sigma)``;
- *tower*: 0.3 times the first fore-aft frequency. A pitch loop near that frequency takes the damping of the air from
  the tower (Larsen and Hanson, J. Phys.: Conf. Ser. 75 (2007) 012073; Bossanyi, Wind Energy 6 (2003) 119);
- *filter*: at which the filter on the generator speed lags by no more than that of the NREL 5-MW at its 0.6 rad/s, 21
  deg: 0.38 of the corner of a filter of first order. The poles are placed without the filter, and near rated, where the
  rotor answers to the pitch half as much as the gains assume once the wake has followed, its lag takes the damping that
  is left: the IEA 10-MW with 0.61 rad/s for a corner of 1.12 rad/s swings between fine pitch and 8 deg in a steady
  wind of 11 m/s, with 0.43 rad/s it is steady.

The rule gives 0.6 rad/s for the NREL 5-MW, whose filter it takes, and 0.20 to 0.21 rad/s for the IEA 15-MW and 22-MW
(published: 0.2), and 0.43 rad/s for the IEA 10-MW (0.08 to 0.25).

Sensitivity
-----------
``dP/dtheta`` with the induced velocities held, along the steady operating points above rated, and a straight line
over the pitch through them: its value at zero and the pitch at which it has doubled (NREL/TP-500-38060, section 7.3).
Between 10 and 24 deg the line of the NREL 5-MW lies within 9 % of the published one, -25.52 (1 + theta/6.302 deg)
MW/rad.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np
from scipy.optimize import brentq

from wt_gym.control.rotor import Rotor, rotor_of
from wt_gym.turbines.model import at_controller_density
from wt_gym.wind.iec import REFERENCE_INTENSITY, turbulence_sigma

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from wt_gym.turbines import Turbine

__all__ = [
    "DesignPoint",
    "SpeedLoop",
    "aerodynamic_rated_power",
    "design_point",
    "fine_pitch",
    "full_power_wind",
    "rated_mechanical_power",
    "rotor_inertia",
    "speed_filter",
    "speed_loop",
    "trim_pitch",
]

DAMPING_RATIO = 0.7
LARGEST_EXCURSION = 0.02
"""Of the rotor speed after a step of the wind by one standard deviation, in rated speeds [-]."""
SHARE_OF_PITCH_RATE = 0.4
SHARE_OF_TOWER = 0.3
FILTER_OVER_ROTOR_SPEED = 1.570796 / (12.1 * math.pi / 30)
"""Corner of the speed filter over the rated rotor speed where nothing is published: as of the NREL 5-MW (a quarter of
its first edgewise frequency, which scales with the rotor speed) [-]."""
LARGEST_FILTER_LAG = math.atan(0.6 / 1.570796)
"""Of the speed filter at the natural frequency: that of the NREL 5-MW [rad]."""
DESIGN_WIND = 1.2
"""Wind of the speed loop's design in rated wind speeds [-]."""
_TRIM = np.linspace(1.02, 2.2, 13)
"""Winds of the steady points of the sensitivity, in winds of full power [-]."""


@dataclass(frozen=True)
class DesignPoint:
    """What a controller must know of a rotor beyond its dimensions.

    Attributes
    ----------
    peak_power_coefficient : float
        Largest power coefficient, reached at ``tip_speed_ratio`` and ``fine_pitch`` [-].
    tip_speed_ratio : float
        Optimal tip-speed ratio [-].
    fine_pitch : float
        Pitch of optimal power below rated; the least one of a schedule over the wind [rad].
    pitch_sensitivity : float
        Change of aerodynamic power with collective pitch at rated speed and zero pitch, divided by the rated mechanical
        power [1/rad]; negative.
    gain_doubling_pitch : float
        Pitch at which the sensitivity has doubled [rad].
    damping_ratio, natural_frequency : float
        Desired closed-loop response of the rotor speed above rated [-], [rad/s].
    """

    peak_power_coefficient: float
    tip_speed_ratio: float
    fine_pitch: float
    pitch_sensitivity: float
    gain_doubling_pitch: float
    damping_ratio: float
    natural_frequency: float


@dataclass(frozen=True)
class SpeedLoop:
    """Natural frequencies that the rule of this module allows [rad/s].

    Attributes
    ----------
    by_inertia, by_pitch_rate, by_tower, by_filter : float
    """

    by_inertia: float
    by_pitch_rate: float
    by_tower: float
    by_filter: float

    @property
    def natural_frequency(self) -> float:
        """The least of them [rad/s]."""
        return min(self.by_inertia, self.by_pitch_rate, self.by_tower, self.by_filter)


def rated_mechanical_power(turbine: Turbine) -> float:
    """Power on the high-speed shaft at rated electrical power [W]."""
    return turbine.drivetrain.rated_power / turbine.drivetrain.generator_efficiency


def aerodynamic_rated_power(turbine: Turbine) -> float:
    """Power of the air on the rotor at rated electrical power [W]."""
    return rated_mechanical_power(turbine) / turbine.drivetrain.gearbox_efficiency


def rotor_inertia(turbine: Turbine) -> float:
    """Inertia of rotor and generator about the low-speed shaft [kg m^2].

    Blades are rigid and coned: a section at distance r along the blade moves on a circle of radius r cos(cone).
    """
    station = turbine.blade.structure.station
    mass = turbine.blade.structure.inertia[:, 0, 0]
    radius = (turbine.blade.root_radius + station) * math.cos(turbine.hub.cone)
    blades = turbine.n_blades * np.trapezoid(mass * radius**2, station)
    generator = turbine.drivetrain.gear_ratio**2 * turbine.drivetrain.generator_inertia
    return float(blades + turbine.hub.inertia_axial + generator)


@lru_cache(maxsize=32)
def fine_pitch(turbine: Turbine) -> float:
    """Pitch of optimal power below rated [rad].

    The least pitch of a published schedule over the wind, else the published fine pitch, else that of the largest power
    coefficient by blade elements; never below the range of the drives.
    """
    own, lowest = turbine.control, turbine.pitch.min_pitch
    if own is not None and own.min_pitch is not None:
        return max(float(own.min_pitch.min()), lowest)
    if own is not None and own.fine_pitch is not None:
        return max(own.fine_pitch, lowest)
    return max(rotor_of(turbine).optimum[1], lowest)


@lru_cache(maxsize=32)
def full_power_wind(turbine: Turbine) -> float:
    """Least wind at which the rotor makes rated power at rated speed and fine pitch [m/s], by blade elements."""
    rotor, speed, power = rotor_of(turbine), turbine.drivetrain.rated_rotor_speed, aerodynamic_rated_power(turbine)
    winds = np.linspace(0.5 * turbine.rated_wind_speed, turbine.cut_out, 61)
    enough = rotor.power(winds, speed, fine_pitch(turbine)) >= power
    if not enough.any():
        return turbine.cut_out
    k = int(np.argmax(enough))
    if k == 0:
        return float(winds[0])
    found = brentq(lambda v: float(rotor.power(v, speed, fine_pitch(turbine))[0]) - power, winds[k - 1], winds[k])
    return float(found)


def trim_pitch(turbine: Turbine, wind: NDArray[np.float64]) -> NDArray[np.float64]:
    """Steady pitch at rated speed and power [rad], shape (n,), in winds above rated (n,) [m/s].

    The published one where the turbine's data have it, else by blade elements.
    """
    own = turbine.control
    if own is not None and own.trim_wind is not None and own.trim_pitch is not None:
        # over the ratio to rated wind, where the table begins; in degrees, with whose digits such tables are published
        ratio, degrees = np.asarray(wind) / turbine.rated_wind_speed, np.round(np.degrees(own.trim_pitch), 12)
        return np.radians(np.interp(ratio, own.trim_wind / own.trim_wind[0], degrees))
    speed, power = turbine.drivetrain.rated_rotor_speed, aerodynamic_rated_power(turbine)
    return rotor_of(turbine).pitch_of_power(wind, speed, power, fine_pitch(turbine))


@lru_cache(maxsize=32)
def speed_loop(turbine: Turbine) -> SpeedLoop:
    """Frequencies of the rule in the docstring of this module."""
    from wt_gym.control.controllers.rotor_rules import tower_top  # controllers know design points

    rotor, drivetrain = rotor_of(turbine), turbine.drivetrain
    wind, speed = DESIGN_WIND * full_power_wind(turbine), drivetrain.rated_rotor_speed
    power, least = aerodynamic_rated_power(turbine), fine_pitch(turbine)
    around = rotor.pitch_of_power(np.array([0.98 * wind, wind, 1.02 * wind]), speed, power, least)
    turbulence = turbine.turbulence_class if turbine.turbulence_class in REFERENCE_INTENSITY else "B"
    sigma = turbulence_sigma(wind, turbulence)
    slope = max(float(around[2] - around[0]) / (0.04 * wind), 1e-6)
    gust = max(rotor.slopes(wind, speed, float(around[1])).torque_wind, 0.0) * sigma
    return SpeedLoop(
        by_inertia=gust / (math.e * rotor_inertia(turbine) * speed * LARGEST_EXCURSION),
        by_pitch_rate=SHARE_OF_PITCH_RATE * turbine.pitch.max_rate / (slope * sigma),
        by_tower=SHARE_OF_TOWER * tower_top(turbine).fore_aft,
        by_filter=_frequency_of_lag(*speed_filter(turbine), LARGEST_FILTER_LAG),
    )


def speed_filter(turbine: Turbine) -> tuple[float, float]:
    """Corner [rad/s] and damping ratio of the filter on the generator speed; a damping of 0 is one of first order.

    Published ones, else by rule of first order with a corner in proportion to the rated rotor speed.
    """
    own = turbine.control
    if own is not None and own.speed_filter_frequency is not None:
        return own.speed_filter_frequency, own.speed_filter_damping or 0.0
    return FILTER_OVER_ROTOR_SPEED * turbine.drivetrain.rated_rotor_speed, 0.0


def _frequency_of_lag(corner: float, damping: float, lag: float) -> float:
    """Frequency at which a low-pass filter lags by an angle below a right one [rad/s].

    With x the frequency over the corner, ``tan(lag) = x`` of first order and ``2 damping x/(1 - x^2)`` of second.
    """
    slope = math.tan(lag)
    if damping == 0.0:
        return corner * slope
    return corner * (math.sqrt(damping**2 + slope**2) - damping) / slope


def _sensitivity(turbine: Turbine, rotor: Rotor) -> tuple[float, float]:
    """Change of power with pitch at zero pitch over rated power [1/rad], and its doubling pitch [rad]."""
    speed, power, least = turbine.drivetrain.rated_rotor_speed, aerodynamic_rated_power(turbine), fine_pitch(turbine)
    winds = _TRIM * full_power_wind(turbine)
    pitch = rotor.pitch_of_power(winds, speed, power, least)
    slope = np.array(
        [rotor.frozen_pitch_slope(v, speed, p) for v, p in zip(winds.tolist(), pitch.tolist(), strict=True)]
    )
    rise, at_zero = np.polyfit(pitch, slope / power, 1)
    if not (at_zero < 0.0 and rise < 0.0):  # no straight line through zero describes such a rotor: hold the mean
        return float(np.mean(slope) / power), 10.0
    return float(at_zero), float(at_zero / rise)


@lru_cache(maxsize=32)
def design_point(turbine: Turbine) -> DesignPoint:
    """Design point of a turbine: published numbers where its data have them, else by the rules of this module.

    The rules hold for the air for which the turbine's controller is designed.

    Parameters
    ----------
    turbine : Turbine

    Returns
    -------
    DesignPoint
    """
    turbine = at_controller_density(turbine)
    own, rotor = turbine.control, rotor_of(turbine)
    fine = fine_pitch(turbine)

    def published(name: str) -> float | None:
        return None if own is None else getattr(own, name)

    ratio = published("optimal_tip_speed_ratio") or rotor.best_ratio(fine)[0]
    power_per_pitch, doubling = published("power_per_pitch"), published("gain_doubling_pitch")
    if power_per_pitch is not None and doubling is not None:
        published_power = published("rated_mechanical_power") or rated_mechanical_power(turbine)
        sensitivity = power_per_pitch / published_power
    else:
        sensitivity, doubling = _sensitivity(turbine, rotor)
    return DesignPoint(
        peak_power_coefficient=published("peak_power_coefficient") or rotor.power_coefficient(ratio, fine),
        tip_speed_ratio=ratio,
        fine_pitch=fine,
        pitch_sensitivity=sensitivity,
        gain_doubling_pitch=doubling,
        damping_ratio=published("damping_ratio") or DAMPING_RATIO,
        natural_frequency=published("natural_frequency") or speed_loop(turbine).natural_frequency,
    )
