"""Where a turbine runs in steady wind under variable-speed, pitch-regulated control.

The torque curve is the one of the NREL 5-MW baseline controller (Jonkman et al., NREL/TP-500-38060, section 7): no
torque below cut-in speed, a linear start-up ramp (region 1 1/2), torque proportional to speed squared at the optimal
tip-speed ratio (region 2), an induction-machine slope (region 2 1/2) and constant power (region 3). Its constants
follow from a turbine by simple rules, which reproduce the published constants of the NREL 5-MW.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from scipy.optimize import brentq

from wt_gym.errors import TurbineDefinitionError
from wt_gym.turbines.catalogue import AIR_DENSITY
from wt_gym.turbines.site import at_controller_density

if TYPE_CHECKING:
    from wt_gym.turbines import Turbine

__all__ = [
    "DesignPoint",
    "OperatingPoint",
    "TorqueCurve",
    "design_point",
    "is_nrel_5mw",
    "operating_point",
    "rated_mechanical_power",
    "rotor_inertia",
    "torque_curve",
]

# Jonkman et al. (2009), Table 7-1: trim pitch of the NREL 5-MW above its rated wind speed of 11.4 m/s.
_TRIM_RATED_WIND = 11.4
_TRIM_WIND = np.array([11.4, 12, 13, 14, 15, 16, 17, 18, 19, 20, 21, 22, 23, 24, 25.0])
_TRIM_PITCH_DEG = np.array(
    [0, 3.83, 6.60, 8.70, 10.45, 12.06, 13.54, 14.92, 16.23, 17.47, 18.70, 19.94, 21.18, 22.35, 23.47]
)


@dataclass(frozen=True)
class DesignPoint:
    """What a controller must know of a rotor beyond its dimensions.

    Attributes
    ----------
    peak_power_coefficient : float
        Largest power coefficient, reached at ``tip_speed_ratio`` and fine pitch [-].
    tip_speed_ratio : float
        Optimal tip-speed ratio [-].
    pitch_sensitivity : float
        Change of aerodynamic power with collective pitch at rated and fine pitch, divided by the rated mechanical power
        [1/rad]; negative.
    gain_doubling_pitch : float
        Pitch at which the sensitivity has doubled [rad].
    damping_ratio, natural_frequency : float
        Wanted closed-loop response of the rotor speed above rated [-], [rad/s].
    """

    peak_power_coefficient: float
    tip_speed_ratio: float
    pitch_sensitivity: float
    gain_doubling_pitch: float
    damping_ratio: float
    natural_frequency: float


# NREL/TP-500-38060, section 7: dP/dtheta = -25.52 MW/rad at a mechanical power of 5.296610 MW.
NREL_5MW_DESIGN = DesignPoint(0.482, 7.55, -25.52e6 / 5.296610e6, 0.1099965, 0.7, 0.6)

# NREL/TP-5000-75698: peak Cp 0.489 at tip-speed ratio 9; the published tuning is critically damped at 0.2 rad/s.
# Its pitch sensitivity per rated power is taken as that of the NREL 5-MW, whose thrust and speed schedule are alike.
IEA_15MW_DESIGN = DesignPoint(0.489, 9.0, NREL_5MW_DESIGN.pitch_sensitivity, 0.1099965, 1.0, 0.2)


def _has_size(turbine: Turbine, rated_power: float, diameter: float) -> bool:
    """Whether rated power [W] and rotor diameter [m] are those given, within 0.1 % and 1 %."""
    return math.isclose(turbine.drivetrain.rated_power, rated_power, rel_tol=1e-3) and math.isclose(
        turbine.rotor_diameter, diameter, rel_tol=0.01
    )


def is_nrel_5mw(turbine: Turbine) -> bool:
    """Whether a turbine has the rating, rotor and gearbox of the NREL 5-MW, so that its published constants apply."""
    return _has_size(turbine, rated_power=5.0e6, diameter=126.0) and math.isclose(turbine.drivetrain.gear_ratio, 97.0)


def design_point(turbine: Turbine) -> DesignPoint:
    """Design point of a turbine: published where known, else from its rated point.

    The NREL 5-MW and the IEA 15-MW are recognised by rated power and diameter. For any other one the rated point is
    taken for the optimum (``Cp = P / (rho A V^3 / 2)``, ``lambda = Omega R / V``), a conservative choice: it makes the
    torque curve pass through rated, a little above the true optimum. Pitch response follows the NREL 5-MW by
    similarity.

    Parameters
    ----------
    turbine : Turbine

    Returns
    -------
    DesignPoint
    """
    if is_nrel_5mw(turbine):
        return NREL_5MW_DESIGN
    if _has_size(turbine, rated_power=15.0e6, diameter=241.0):
        return IEA_15MW_DESIGN
    turbine = at_controller_density(turbine)
    radius = turbine.rotor_diameter / 2
    wind_power = 0.5 * turbine.air_density * math.pi * radius**2 * turbine.rated_wind_speed**3
    return DesignPoint(
        peak_power_coefficient=rated_mechanical_power(turbine) / wind_power,
        tip_speed_ratio=turbine.drivetrain.rated_rotor_speed * radius / turbine.rated_wind_speed,
        pitch_sensitivity=NREL_5MW_DESIGN.pitch_sensitivity,
        gain_doubling_pitch=NREL_5MW_DESIGN.gain_doubling_pitch,
        damping_ratio=NREL_5MW_DESIGN.damping_ratio,
        natural_frequency=NREL_5MW_DESIGN.natural_frequency,
    )


def rated_mechanical_power(turbine: Turbine) -> float:
    """Power on the high-speed shaft at rated electrical power [W]."""
    return turbine.drivetrain.rated_power / turbine.drivetrain.generator_efficiency


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


@dataclass(frozen=True)
class TorqueCurve:
    """Generator torque against generator speed, both on the high-speed shaft.

    Attributes
    ----------
    cut_in_speed, region_2_speed, rated_generator_speed : float
        Ends of regions 1 and 1 1/2 and the beginning of region 3 [rad/s] (VS_CtInSp, VS_Rgn2Sp, VS_RtGnSp).
    region_2_gain : float
        Torque over speed squared in region 2 [N m/(rad/s)^2] (VS_Rgn2K).
    rated_power : float
        Mechanical power held in region 3 [W] (VS_RtPwr).
    slip : float
        Slip of the induction machine imitated in region 2 1/2 [-] (VS_SlPc, here a fraction).
    """

    cut_in_speed: float
    region_2_speed: float
    rated_generator_speed: float
    region_2_gain: float
    rated_power: float
    slip: float = 0.10

    def __post_init__(self):
        speeds = (0.0, self.cut_in_speed, self.region_2_speed, self.rated_generator_speed)
        if any(low >= high for low, high in itertools.pairwise(speeds)):
            raise TurbineDefinitionError(
                "a torque curve needs 0 < cut-in speed < region-2 speed < rated generator speed, "
                f"got {speeds[1:]} rad/s"
            )
        if self.region_2_gain * self.rated_generator_speed**3 >= self.rated_power:
            raise TurbineDefinitionError(
                f"the region-2 gain {self.region_2_gain:.6g} N m/(rad/s)^2 passes the rated power "
                f"{self.rated_power:.6g} W before the rated generator speed {self.rated_generator_speed:.6g} rad/s"
            )

    @cached_property
    def slip_synchronous_speed(self) -> float:
        """Speed at which the line of region 2 1/2 crosses zero torque [rad/s] (VS_SySp)."""
        return self.rated_generator_speed / (1 + self.slip)

    @cached_property
    def slope_15(self) -> float:
        """Slope of region 1 1/2 [N m/(rad/s)] (VS_Slope15)."""
        return self.region_2_gain * self.region_2_speed**2 / (self.region_2_speed - self.cut_in_speed)

    @cached_property
    def slope_25(self) -> float:
        """Slope of region 2 1/2 [N m/(rad/s)] (VS_Slope25)."""
        rated_torque = self.rated_power / self.rated_generator_speed
        return rated_torque / (self.rated_generator_speed - self.slip_synchronous_speed)

    @cached_property
    def transition_speed(self) -> float:
        """Where region 2 meets region 2 1/2 [rad/s] (VS_TrGnSp): K w^2 = slope (w - w_sync)."""
        slope, gain = self.slope_25, self.region_2_gain
        return (slope - math.sqrt(slope * (slope - 4 * gain * self.slip_synchronous_speed))) / (2 * gain)

    def torque(self, speed: float, *, constant_power: bool = False) -> float:
        """Torque at a generator speed [N m].

        Parameters
        ----------
        speed : float
            Generator speed [rad/s].
        constant_power : bool
            Use region 3 whatever the speed (blades are pitched).
        """
        if speed <= 0.0:
            return 0.0
        if constant_power or speed >= self.rated_generator_speed:
            return self.rated_power / speed
        if speed <= self.cut_in_speed:
            return 0.0
        if speed < self.region_2_speed:
            return self.slope_15 * (speed - self.cut_in_speed)
        if speed < self.transition_speed:
            return self.region_2_gain * speed**2
        return self.slope_25 * (speed - self.slip_synchronous_speed)

    @classmethod
    def from_turbine(cls, turbine: Turbine, design: DesignPoint | None = None) -> TorqueCurve:
        """Torque curve of a turbine by rule.

        The region-2 gain is ``rho pi R^5 Cp / (2 lambda^3 N^3)`` with the coned rotor radius R; region 1 1/2 ends 30 %
        above the cut-in speed; region 3 begins at 99 % of the rated speed, as for the NREL 5-MW.

        Parameters
        ----------
        turbine : Turbine
        design : DesignPoint, optional
            Defaults to `design_point`.

        Raises
        ------
        TurbineDefinitionError
            If the regions do not follow one another.
        """
        design = design or design_point(turbine)
        drivetrain = turbine.drivetrain
        radius = turbine.rotor_diameter / 2 * math.cos(turbine.hub.cone)
        rated_generator_speed = 0.99 * drivetrain.rated_rotor_speed * drivetrain.gear_ratio
        gain = (
            0.5 * turbine.controller_air_density * math.pi * radius**5 * design.peak_power_coefficient
            / (design.tip_speed_ratio * drivetrain.gear_ratio) ** 3
        )  # fmt: skip
        cut_in_speed = drivetrain.min_rotor_speed * drivetrain.gear_ratio
        # A rotor with a narrow speed range has no room for 30 %: region 2 then begins 10 % below the synchronous speed.
        region_2_speed = min(1.3 * cut_in_speed, 0.9 * rated_generator_speed / 1.1)
        power = rated_mechanical_power(turbine)
        # A gain from the rated point itself would leave no region 2 1/2: 5 % less power at its end opens one.
        gain = min(gain, 0.95 * power / rated_generator_speed**3)
        return cls(cut_in_speed, region_2_speed, rated_generator_speed, gain, power)


# NREL/TP-500-38060, Table 7-2, with the digits of the published controller.
NREL_5MW_TORQUE_CURVE = TorqueCurve(
    cut_in_speed=70.16224,
    region_2_speed=91.21091,
    rated_generator_speed=121.6805,
    region_2_gain=2.332287,
    rated_power=5_296_610.0,
)


def torque_curve(turbine: Turbine) -> TorqueCurve:
    """Torque curve of a turbine: the published constants for the NREL 5-MW, else `TorqueCurve.from_turbine`.

    Of the former the region-2 gain is in proportion to the air density for which the controller is designed.
    """
    if not is_nrel_5mw(turbine):
        return TorqueCurve.from_turbine(turbine)
    curve, share = NREL_5MW_TORQUE_CURVE, turbine.controller_air_density / AIR_DENSITY
    return curve if share == 1.0 else replace(curve, region_2_gain=share * curve.region_2_gain)


@dataclass(frozen=True)
class OperatingPoint:
    """A steady operating point: rotor speed [rad/s], collective pitch [rad], generator torque (HSS) [N m]."""

    rotor_speed: float
    pitch: float
    generator_torque: float


def operating_point(turbine: Turbine, wind_speed: float) -> OperatingPoint:
    """Estimate where a turbine settles in a steady wind.

    Below rated power the rotor takes up ``Cp_max rho A V^3 / 2`` and the torque curve sets the speed; above it the
    speed is rated and the pitch is that of the NREL 5-MW at the same ratio of wind speed to rated wind speed (Jonkman
    et al. 2009, Table 7-1). Good to a few percent, meant as a start state: the simulation finds its own equilibrium.
    With a damper as generator the speed is the highest, up to rated, at which some pitch makes the air hold the damper;
    its torque, which is no demand, is 0.

    Parameters
    ----------
    turbine : Turbine
    wind_speed : float
        Wind speed at hub height [m/s], positive.

    Returns
    -------
    OperatingPoint

    Raises
    ------
    ValueError
        If the wind speed is not positive.
    """
    if not wind_speed > 0.0:
        raise ValueError(f"operating_point needs a positive wind speed, got {wind_speed!r} m/s")
    if not turbine.drivetrain.takes_torque:
        return _damped_point(turbine, wind_speed)
    drivetrain, fine_pitch = turbine.drivetrain, max(turbine.pitch.min_pitch, 0.0)
    curve, design = torque_curve(turbine), design_point(turbine)
    rated_speed = drivetrain.rated_rotor_speed * drivetrain.gear_ratio

    radius = turbine.rotor_diameter / 2 * math.cos(turbine.hub.cone)
    swept_area = math.pi * radius**2
    power = 0.5 * turbine.air_density * swept_area * design.peak_power_coefficient * wind_speed**3
    if power >= curve.rated_power or wind_speed >= turbine.rated_wind_speed:
        ratio = wind_speed / turbine.rated_wind_speed
        pitch = np.radians(np.interp(ratio, _TRIM_WIND / _TRIM_RATED_WIND, _TRIM_PITCH_DEG))
        return OperatingPoint(
            drivetrain.rated_rotor_speed, max(fine_pitch, float(pitch)), curve.rated_power / rated_speed
        )

    speed = brentq(
        lambda omega: curve.torque(omega) * omega - power, curve.cut_in_speed, curve.rated_generator_speed * (1 - 1e-12)
    )
    return OperatingPoint(speed / drivetrain.gear_ratio, fine_pitch, curve.torque(speed))


def _damped_point(turbine: Turbine, wind_speed: float) -> OperatingPoint:
    """Highest speed up to rated at which the torque of the air reaches c Ω, and the most feathered pitch that does it.

    A damper against which the rotor is weak holds it in stall, at tip-speed ratios below those of the table, where its
    power coefficients are held; it then turns slowly.
    """
    from wt_gym.control.controllers.rotor_table import rotor_table  # controllers know operating points

    table, drivetrain = rotor_table(turbine), turbine.drivetrain
    speeds = drivetrain.rated_rotor_speed * np.linspace(1.0, 0.01, 100)
    pitches = np.linspace(table.pitch[0], table.pitch[-1], 10 * len(table.pitch))
    for speed in speeds.tolist():
        held = drivetrain.generator_damping * speed
        enough = [p for p in pitches.tolist() if table.torque(wind_speed, speed, p) >= held]
        if enough:
            return OperatingPoint(speed, max(enough), 0.0)
    return OperatingPoint(speeds[-1], float(pitches[-1]), 0.0)
