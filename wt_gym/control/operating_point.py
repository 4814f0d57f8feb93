"""Operating points of a turbine under variable-speed, pitch-regulated control, in steady wind and at a start.

The torque curve is the one of the NREL 5-MW baseline controller (Jonkman et al., NREL/TP-500-38060, section 7): no
torque below cut-in speed, a linear start-up ramp (region 1 1/2), torque proportional to speed squared at the optimal
tip-speed ratio (region 2), an induction-machine slope (region 2 1/2) and constant power (region 3). Its constants
are those published with a turbine (`wt_gym.turbines.ControlData`), or follow from it by simple rules, which reproduce
the published constants of the NREL 5-MW.
"""

import itertools
import math
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.optimize import brentq

from wt_gym.base.errors import TurbineDefinitionError
from wt_gym.base.quantities import AIR_DENSITY
from wt_gym.control.design import DesignPoint, design_point, published, rated_mechanical_power, trim_pitch
from wt_gym.control.rotor import fine_pitch, rotor_of, rotor_table
from wt_gym.turbines import Turbine
from wt_gym.wind import Inflow
from wt_gym.wind.inflow import start_speed


@dataclass(frozen=True)
class TorqueCurve:
    """Generator torque against generator speed, both on the high-speed shaft."""

    cut_in_speed: float  #: end of region 1 [rad/s] (VS_CtInSp)
    region_2_speed: float  #: end of region 1 1/2 [rad/s] (VS_Rgn2Sp)
    rated_generator_speed: float  #: beginning of region 3 [rad/s] (VS_RtGnSp)
    region_2_gain: float  #: torque over speed squared in region 2 [N m/(rad/s)^2] (VS_Rgn2K)
    rated_power: float  #: mechanical power held in region 3 [W] (VS_RtPwr)
    slip: float = 0.10  #: slip of the induction machine imitated in region 2 1/2 [-] (VS_SlPc, here a fraction)

    def __post_init__(self) -> None:
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
        """Speed where region 2 meets region 2 1/2 [rad/s] (VS_TrGnSp): K w^2 = slope (w - w_sync); w_sync for K = 0."""
        slope, gain = self.slope_25, self.region_2_gain
        if gain == 0.0:
            return self.slip_synchronous_speed
        return (slope - math.sqrt(slope * (slope - 4 * gain * self.slip_synchronous_speed))) / (2 * gain)

    def torque(self, speed: float, *, constant_power: bool = False) -> float:
        """Torque at a generator speed [rad/s] in N m; with ``constant_power``, that of region 3 whatever the speed."""
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
    def from_turbine(cls, turbine: Turbine, design: DesignPoint | None = None) -> "TorqueCurve":
        """Torque curve of a turbine by rule.

        The region-2 gain is ``rho pi R^5 Cp / (2 lambda^3 N^3)`` with the coned rotor radius R; region 1 1/2 ends 30 %
        above the cut-in speed; region 3 begins at 99 % of the rated speed, as for the NREL 5-MW. What the turbine's
        data publish goes before the rule.

        A design point that is given goes before a published gain; by default it is `design_point`.

        Raises
        ------
        TurbineDefinitionError
            If the regions do not follow one another.
        """
        drivetrain = turbine.drivetrain
        rated = published(turbine, "region_3_speed") or 0.99 * drivetrain.rated_rotor_speed * drivetrain.gear_ratio
        cut_in = published(turbine, "cut_in_generator_speed") or drivetrain.min_rotor_speed * drivetrain.gear_ratio
        cut_in = cut_in or 0.1 * rated
        # A rotor with a narrow speed range has no room for 30 %: region 2 then begins 10 % below the synchronous speed.
        region_2 = published(turbine, "region_2_speed") or min(1.3 * cut_in, 0.9 * rated / 1.1)
        if published(turbine, "region_2_speed") is not None and published(turbine, "cut_in_generator_speed") is None:
            cut_in = min(cut_in, region_2 / 1.3)  # ROSCO's VS_MinOMSpd is the least speed of the rotor and of region 2
        power = published(turbine, "rated_mechanical_power") or rated_mechanical_power(turbine)
        gain = published(turbine, "region_2_gain") if design is None else None
        if gain is not None:
            gain *= turbine.controller_air_density / (published(turbine, "air_density") or AIR_DENSITY)
        else:
            design = design or design_point(turbine)
            radius = turbine.rotor_diameter / 2 * math.cos(turbine.hub.cone)
            gain = (
                0.5 * turbine.controller_air_density * math.pi * radius**5 * design.peak_power_coefficient
                / (design.tip_speed_ratio * drivetrain.gear_ratio) ** 3
            )  # fmt: skip
        # A gain that reaches rated power at rated speed would leave no region 2 1/2: 5 % less at its end opens one.
        gain = min(gain, 0.95 * power / rated**3)
        return cls(cut_in, region_2, rated, gain, power, published(turbine, "slip") or 0.10)


def torque_curve(turbine: Turbine) -> TorqueCurve:
    """Torque curve of a turbine (`TorqueCurve.from_turbine`)."""
    return TorqueCurve.from_turbine(turbine)


@dataclass(frozen=True)
class OperatingPoint:
    """A steady operating point: rotor speed [rad/s], collective pitch [rad], generator torque (HSS) [N m]."""

    rotor_speed: float
    pitch: float
    generator_torque: float


def tracks_tip_speed_ratio(turbine: Turbine) -> bool:
    """Whether the turbine's own torque controller follows the tip-speed ratio with an estimate of the wind.

    It does where its data have the gains of such a law and the ratio, or a least pitch over the wind, which needs the
    estimate too.
    """
    own = turbine.control
    if own is None or not turbine.drivetrain.takes_torque:
        return False
    gains = own.torque_proportional_gain and own.torque_integral_gain and own.optimal_tip_speed_ratio
    return bool(gains) or own.min_pitch is not None


def least_pitch(turbine: Turbine, wind_speed: float) -> float:
    """Least pitch of the turbine's own controller in a wind [m/s]: its schedule, or fine pitch [rad]."""
    own = turbine.control
    if own is None or own.min_pitch_wind is None or own.min_pitch is None:
        return fine_pitch(turbine)
    return max(float(np.interp(wind_speed, own.min_pitch_wind, own.min_pitch)), turbine.pitch.min_pitch)


def operating_point(turbine: Turbine, wind_speed: float) -> OperatingPoint:
    """Estimate where a turbine settles in a steady wind at hub height [m/s].

    Below rated power the rotor takes up ``Cp_max rho A V^3 / 2`` and the torque curve sets the speed; a turbine whose
    controller tracks the tip-speed ratio or has a least pitch over the wind runs at both, with the power of blade
    elements. Above rated the speed is rated and the pitch the published one, or that of blade elements
    (`wt_gym.control.design.trim_pitch`). Good to a few percent, meant as a start state: the simulation finds its own
    equilibrium. With a damper as generator the speed is the highest, up to rated, at which some pitch makes the air
    hold the damper; its torque is not a demand and is 0.

    Raises
    ------
    ValueError
        If the wind speed is not positive.
    """
    if not wind_speed > 0.0:
        raise ValueError(f"operating_point needs a positive wind speed, got {wind_speed!r} m/s")
    if not turbine.drivetrain.takes_torque:
        return _damped_point(turbine, wind_speed)
    drivetrain, curve = turbine.drivetrain, torque_curve(turbine)
    rated_speed = drivetrain.rated_rotor_speed * drivetrain.gear_ratio
    if tracks_tip_speed_ratio(turbine):
        return _tracked_point(turbine, wind_speed, curve.rated_power / rated_speed)
    design = design_point(turbine)
    radius = turbine.rotor_diameter / 2 * math.cos(turbine.hub.cone)
    swept_area = math.pi * radius**2
    power = 0.5 * turbine.air_density * swept_area * design.peak_power_coefficient * wind_speed**3
    if power >= curve.rated_power or wind_speed >= turbine.rated_wind_speed:
        pitch = float(trim_pitch(turbine, np.array([wind_speed]))[0])
        return OperatingPoint(
            drivetrain.rated_rotor_speed, max(design.fine_pitch, pitch), curve.rated_power / rated_speed
        )

    speed = brentq(
        lambda omega: curve.torque(omega) * omega - power, curve.cut_in_speed, curve.rated_generator_speed * (1 - 1e-12)
    )
    return OperatingPoint(speed / drivetrain.gear_ratio, design.fine_pitch, curve.torque(speed))


def _tracked_point(turbine: Turbine, wind: float, rated_torque: float) -> OperatingPoint:
    """Point at the tracked tip-speed ratio and the least pitch, or at rated."""
    drivetrain, rotor, least = turbine.drivetrain, rotor_of(turbine), least_pitch(turbine, wind)
    ratio = design_point(turbine).tip_speed_ratio
    lowest, rated = drivetrain.min_rotor_speed, drivetrain.rated_rotor_speed
    speed = min(max(ratio * wind / rotor.radius, lowest), rated)
    to_torque = drivetrain.gearbox_efficiency / drivetrain.gear_ratio
    torque = float(rotor.power(wind, speed, least)[0]) / speed * to_torque
    if torque < rated_torque:
        return OperatingPoint(speed, least, max(torque, 0.0))
    pitch = float(trim_pitch(turbine, np.array([wind]))[0])
    return OperatingPoint(rated, max(pitch, least), rated_torque)


def _damped_point(turbine: Turbine, wind_speed: float) -> OperatingPoint:
    """Highest speed up to rated at which the torque of the air reaches c Ω, and the most feathered pitch that does it.

    A damper against which the rotor is weak holds it in stall, at tip-speed ratios below those of the table, where its
    power coefficients are held; it then turns slowly.
    """
    table, drivetrain = rotor_table(turbine), turbine.drivetrain
    speeds = drivetrain.rated_rotor_speed * np.linspace(1.0, 0.01, 100)
    pitches = np.linspace(table.pitch[0], table.pitch[-1], 10 * len(table.pitch))
    for speed in speeds.tolist():
        held = drivetrain.generator_damping * speed
        enough = [p for p in pitches.tolist() if table.torque(wind_speed, speed, p) >= held]
        if enough:
            return OperatingPoint(speed, max(enough), 0.0)
    return OperatingPoint(speeds[-1], float(pitches[-1]), 0.0)


def starting_point(turbine: Turbine, inflow: Inflow) -> OperatingPoint:
    """State of a turbine at the start of a simulation: the operating point of the wind's speed at time zero.

    Below cut-in the rotor turns as at cut-in, without torque. Above cut-out, where a schedule may end, the pitch is at
    least what the slope of the schedule below cut-out gives.
    """
    speed = start_speed(inflow)
    if speed > turbine.cut_out:
        return _beyond_cut_out(turbine, speed)
    if speed >= turbine.cut_in:
        return operating_point(turbine, speed)
    return replace(operating_point(turbine, max(turbine.cut_in, 0.1)), generator_torque=0.0)


def _beyond_cut_out(turbine: Turbine, speed: float) -> OperatingPoint:
    """Operating point with the pitch of a schedule that is extrapolated linearly."""
    point, before = operating_point(turbine, speed), 0.95 * turbine.cut_out
    last, earlier = operating_point(turbine, turbine.cut_out).pitch, operating_point(turbine, before).pitch
    pitch = last + (last - earlier) * (speed - turbine.cut_out) / (turbine.cut_out - before)
    return replace(point, pitch=min(max(point.pitch, pitch), turbine.pitch.max_pitch))
