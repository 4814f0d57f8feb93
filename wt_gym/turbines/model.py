"""Turbines as frozen, validated dataclasses in SI units and radians. No physics beyond interpolation.

Frames
------
Global: x downwind, z up, y left looking downwind. Blade: z from root to tip, x to the suction (downwind) side, y to the
trailing edge, origin in the middle of the blade root, pitch not included. A section frame is the blade frame turned by
minus the twist about z: x_s normal to the chord to the suction side, y_s from leading to trailing edge. Positive twist
and pitch feather, that is, they turn the leading edge upwind (to -x). OpenFAST's names are given where they exist.
"""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Annotated, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from wt_gym.base.errors import TurbineDefinitionError, did_you_mean
from wt_gym.turbines.airfoil import Airfoil, Polar, RotationalAugmentation
from wt_gym.turbines.blade import BeamStations, Blade, BladeIce
from wt_gym.turbines.checks import (
    ArrayRecord,
    OneOf,
    Range,
    Table,
    check_number,
    check_span,
    check_symmetric,
    fail,
)

__all__ = [
    "LONGEST_LAG", "SITE", "STRONGEST", "Airfoil", "BeamStations", "Blade", "ControlData", "Drivetrain", "Hub",
    "LossShares", "Nacelle", "PitchSystem", "Polar", "ShaftDamper", "Support", "Tower", "Turbine",
    "at_controller_density", "with_site", "without_site",
]  # fmt: skip

SEA_WATER = 1025.0
"""Density of sea water [kg/m^3]."""
LONGEST_LAG = 2.0
"""Of a generator torque [s]."""
STRONGEST = 0.2
"""Damping ratio that a converter may add to the torsion of the shaft [-]."""

_BIG = 1e15
"""Bound of masses, inertias, stiffnesses: far above any machine, far below overflow."""
_BIG_GAIN = 1e12
_Positive = Annotated[float, Range(0.0, _BIG, above=True)]
_NotNegative = Annotated[float, Range(0.0, _BIG)]
_Efficiency = Annotated[float, Range(0.3, 1.0, above=True)]  # what is below is a slip of the pen
_Damping = Annotated[float, Range(0.0, 0.5)]
_Elevation = Annotated[float, Range(-500.0, 500.0)]
_Density = Annotated[float, Range(0.1, 10.0)]
_Stations = Annotated[NDArray[np.float64], Table("diameter_station", low=0.0, ascending=2)]
_Diameters = Annotated[NDArray[np.float64], Table("diameter_station", low=0.01, high=50.0)]


@dataclass(frozen=True, eq=False, repr=False)
class Support(ArrayRecord):
    """Monopile between the sea bed and the base of a tower: one beam with it, in its frame.

    The sea has no waves and no current: what is in it moves the water around it, and that is all. A cylinder that
    moves across its axis carries added mass, rho pi D^2/4 per length (potential flow, J. N. Newman, Marine
    Hydrodynamics, 1977, section 4.13), which has inertia and no weight.
    """

    base_height: _Elevation
    """Elevation of the sea bed, where the foundation begins, above mean sea level [m]: minus the depth of the water."""
    diameter_station: _Stations
    """Distance from the base along the monopile (n,) [m]."""
    diameter: _Diameters
    """Outer diameter (n,) [m]."""
    structure: BeamStations
    """From the base (station 0) to the base of the tower."""
    foundation: Annotated[NDArray[np.float64] | None, Table(6, 6)] = None
    """Stiffness (6, 6) that the ground has against the displacement and rotation of the base (axes of a tower: x
    downwind, y left, z up) [N/m, N, N m]; None: the base is clamped. See
    `wt_gym.structure.beam.pile_head_stiffness`."""
    top_mass: Annotated[float, Range(0.0, 1e9)] = 0.0
    """Transition piece at the base of the tower [kg]."""
    water_density: Annotated[float, Range(0.0, 2000.0)] = SEA_WATER
    """[kg/m^3]; 0 leaves the water out."""

    def _check(self) -> None:
        check_span("Support.diameter_station", self.diameter_station, self.structure.length)
        if self.foundation is None:
            return
        check_symmetric("Support.foundation", self.foundation[None])
        diagonal = np.diag(self.foundation)
        scale = np.sqrt(np.abs(diagonal))
        if not np.all(scale > 0.0) or np.linalg.eigvalsh(self.foundation / np.outer(scale, scale))[0] <= 0.0:
            raise fail("Support.foundation", diagonal.tolist(), "a positive definite stiffness (its diagonal)")

    @property
    def length(self) -> float:
        """Length from the sea bed to the base of the tower [m]."""
        return self.structure.length

    def diameter_at(self, station: ArrayLike) -> NDArray[np.float64]:
        """Return the outer diameter [m] at a distance from the base [m], linear between stations."""
        return np.interp(np.asarray(station, dtype=np.float64), self.diameter_station, self.diameter)

    def added_mass_at(self, station: ArrayLike) -> NDArray[np.float64]:
        """Return the mass per length [kg/m] of the water that moves along across the axis, none above sea level."""
        s = np.asarray(station, dtype=np.float64)
        wet = self.base_height + s <= 0.0
        return np.where(wet, 0.25 * np.pi * self.water_density * self.diameter_at(s) ** 2, 0.0)


@dataclass(frozen=True, eq=False, repr=False)
class Tower(ArrayRecord):
    """Tower, clamped at its base or standing on a support."""

    base_height: _Elevation
    """Elevation of the base above ground or mean sea level [m] (TowerBsHt)."""
    height: float
    """Elevation of the top (yaw bearing) [m] (TowerHt)."""
    diameter_station: _Stations
    """Distance from the base along the tower (n,) [m]."""
    diameter: _Diameters
    """Outer diameter (n,) [m]."""
    structure: BeamStations
    """From the base (station 0) to the top."""
    damping_ratio: _Damping
    """Structural damping of every tower mode, fraction of critical (TwrFADmp / 100)."""
    drag_coefficient: Annotated[float, Range(0.0, 5.0)]
    """Of the cross-section, based on the diameter (TwrCd)."""
    support: Support | None = None
    """Monopile under the base."""

    def _check(self) -> None:
        base, support = self.base_height, self.support
        self._set(height=check_number("Tower.height", self.height, base, 500.0, open_low=True))
        check_span("Tower.diameter_station", self.diameter_station, self.length)
        check_span("Tower.structure.station", self.structure.station, self.length)
        if support is None:
            return
        top = support.base_height + support.length
        if abs(top - base) > 1e-3:
            raise fail("Tower.support", f"a top {top:g} m up", f"one at the base of the tower, {base:g} m up")
        if support.structure.shear_rigid != self.structure.shear_rigid:
            raise fail("Tower.support.structure", "sections of another kind", "sections that shear as the tower's do")

    @property
    def length(self) -> float:
        """Length from base to top [m]."""
        return self.height - self.base_height

    def diameter_at(self, station: ArrayLike) -> NDArray[np.float64]:
        """Return the outer diameter [m] at a distance from the base [m], linear between stations."""
        s = np.asarray(station, dtype=np.float64)
        if np.any(~((s >= 0.0) & (s <= self.length * (1.0 + 1e-9)))):
            raise fail("station", station, f"distances from the tower base in [0, {self.length:g}] m")
        return np.interp(s, self.diameter_station, self.diameter)


@dataclass(frozen=True, eq=False, repr=False)
class Hub(ArrayRecord):
    """Hub with everything that turns but does not pitch."""

    radius: Annotated[float, Range(0.0, 50.0)]
    """From the apex to the blade roots [m] (HubRad)."""
    cone: Annotated[float, Range(-np.pi / 4, np.pi / 4)]
    """Precone [rad], positive = tips upwind (OpenFAST PreCone with the opposite sign)."""
    mass: _NotNegative
    """[kg] (HubMass)."""
    inertia_axial: _NotNegative
    """About the shaft [kg m^2] (HubIner)."""
    inertia_transverse: _NotNegative
    """About axes through the center of mass across the shaft [kg m^2]."""
    cm_offset_along_shaft: Annotated[float, Range(-50.0, 50.0)]
    """Center of mass from the apex along the shaft, positive downwind [m] (HubCM)."""


@dataclass(frozen=True, eq=False, repr=False)
class Nacelle(ArrayRecord):
    """Everything that yaws but does not turn with the rotor, and where the shaft lies in it."""

    mass: _NotNegative
    """[kg] (NacMass)."""
    cm: Annotated[NDArray[np.float64], Table(3, low=-100.0, high=100.0)]
    """Center of mass (3,) from the tower top in nacelle axes (x downwind, y left, z up) [m] (NacCMxn, NacCMyn,
    NacCMzn)."""
    inertia: Annotated[NDArray[np.float64], Table(3, 3)]
    """About the nacelle's center of mass, nacelle axes (3, 3) [kg m^2]. (OpenFAST's NacYIner is about the yaw axis.)"""
    tilt: Annotated[float, Range(-np.pi / 4, np.pi / 4)]
    """Shaft tilt [rad], positive raises the upwind end (OpenFAST ShftTilt with the opposite sign)."""
    overhang: Annotated[float, Range(-50.0, 50.0)]
    """From the yaw axis to the apex along the shaft [m], positive for an upwind rotor (OverHang, opposite sign)."""
    tower_top_to_shaft: Annotated[float, Range(-20.0, 50.0)]
    """Height of the shaft above the tower top, on the yaw axis [m] (Twr2Shft)."""
    yaw_bearing_mass: _NotNegative
    """At the tower top [kg] (YawBrMass)."""
    yaw_spring: _Positive
    """Of the yaw actuator [N m/rad] (YawSpr)."""
    yaw_damper: _NotNegative
    """Of the yaw actuator [N m s/rad] (YawDamp)."""
    max_yaw_rate: Annotated[float, Range(0.0, 1.0)]
    """[rad/s] (YawManRat)."""

    def _check(self) -> None:
        check_symmetric("Nacelle.inertia", self.inertia[None])
        least = float(np.linalg.eigvalsh(self.inertia)[0])
        if least < -1e-9 * np.abs(self.inertia).max():
            raise fail("Nacelle.inertia", f"least principal inertia {least:g} kg m^2", "principal inertias >= 0")


@dataclass(frozen=True)
class LossShares(ArrayRecord):
    """Shares of the losses of generator and converter at rated operation [-], see `wt_gym.turbines.variants`."""

    copper: Annotated[float, Range(0.0, 1.0)] = 0.45
    """c."""
    iron: Annotated[float, Range(0.0, 1.0)] = 0.15
    """i."""
    converter: Annotated[float, Range(0.0, 1.0)] = 0.4
    """k; c + i + k = 1."""

    def _check(self) -> None:
        if abs(self.copper + self.iron + self.converter - 1.0) > 1e-9:
            raise fail("LossShares", self, "shares whose sum is 1")


@dataclass(frozen=True)
class ShaftDamper(ArrayRecord):
    """Damping of the shaft's torsion by the converter, see `wt_gym.turbines.variants.shaft_damper_of`."""

    coefficient: _Positive
    """c, torque over speed on the low-speed shaft [N m s/rad]."""
    frequency: _Positive
    """omega, of rotor and generator against each other [rad/s]."""


@dataclass(frozen=True, eq=False, repr=False)
class Drivetrain(ArrayRecord):
    """Shaft, gearbox and generator with their limits."""

    gear_ratio: Annotated[float, Range(0.1, 1000.0, above=True)]
    """Generator speed / rotor speed (GBRatio); 1 for a direct drive."""
    gearbox_efficiency: _Efficiency
    """(GBoxEff / 100)."""
    generator_efficiency: _Efficiency
    """(GenEff / 100)."""
    generator_inertia: _Positive
    """About the high-speed shaft [kg m^2] (GenIner)."""
    spring: _Positive
    """Torsion of the drivetrain seen from the low-speed shaft [N m/rad] (DTTorSpr)."""
    damper: _NotNegative
    """[N m s/rad] (DTTorDmp)."""
    rated_power: Annotated[float, Range(0.0, 1e9, above=True)]
    """Electrical [W]."""
    rated_rotor_speed: Annotated[float, Range(0.0, 1000.0, above=True)]
    """[rad/s]."""
    min_rotor_speed: float
    """[rad/s], at most the rated one."""
    max_generator_torque: _Positive
    """High-speed shaft [N m] (VS_MaxTq)."""
    max_torque_rate: _NotNegative
    """High-speed shaft [N m/s] (VS_MaxRat); 0 for a generator that takes no demand, a linear damper."""
    generator_damping: _NotNegative = 0.0
    """Torque over speed of a generator that is, or may run as, a linear damper, low-speed shaft [N m s/rad]; 0 if it
    cannot."""
    gearbox_reverses: bool = False
    """Whether the high-speed shaft turns against the low-speed shaft (GBRevers)."""
    torque_lag: Annotated[float, Range(0.0, LONGEST_LAG)] = 0.0
    """Time constant with which the torque follows its demand [s]; 0: at once (`wt_gym.turbines.variants`)."""
    losses: LossShares | None = None
    """Losses over speed and torque; None: ``generator_efficiency`` holds everywhere."""
    shaft_damper: ShaftDamper | None = None
    """Torque of the converter against the torsion of the shaft."""

    @property
    def speed_ratio(self) -> float:
        """Speed of the generator against the nacelle over that of the rotor; negative where the gearbox reverses."""
        return -self.gear_ratio if self.gearbox_reverses else self.gear_ratio

    @property
    def takes_torque(self) -> bool:
        """Whether the generator takes a demand for its torque."""
        return self.max_torque_rate > 0.0

    def _check(self) -> None:
        slowest = check_number("Drivetrain.min_rotor_speed", self.min_rotor_speed, 0.0, self.rated_rotor_speed)
        self._set(min_rotor_speed=slowest)
        if self.takes_torque:
            return
        if not self.generator_damping > 0.0:
            raise fail("Drivetrain.max_torque_rate", self.max_torque_rate, "0 with a positive generator_damping only")
        for name, off in (("torque_lag", 0.0), ("shaft_damper", None)):
            if getattr(self, name) != off:
                raise fail(f"Drivetrain.{name}", getattr(self, name), f"{off} for a generator that takes no demand")


@dataclass(frozen=True, eq=False, repr=False)
class PitchSystem(ArrayRecord):
    """Limits and bandwidth of the pitch actuators."""

    min_pitch: Annotated[float, Range(-np.pi / 2, np.pi)]
    """[rad] (PC_MinPit)."""
    max_pitch: float
    """[rad] (PC_MaxPit), above the least one and at most pi."""
    max_rate: Annotated[float, Range(0.0, 10.0, above=True)]
    """[rad/s] (PC_MaxRat)."""
    servo_frequency: Annotated[float | None, Range(0.1, 100.0)] = None
    """Natural frequency ω of the drive as a servo behind the demand [rad/s] (ROSCO's PA_CornerFreq), θ̈ = ω² (c − θ) −
    2 ζ ω θ̇. None, the default: an ideal drive, which follows the demand at up to ``max_rate``. windIO files say nothing
    about it, and the baseline controller of the NREL 5-MW is published without dynamics of the actuators
    (NREL/TP-500-38060, section 7)."""
    servo_damping: Annotated[float, Range(0.1, 10.0)] = 1.0
    """Damping ratio ζ of that servo (ROSCO's PA_Damping), by default 1; behind a moving demand its lag is 2 ζ/ω."""

    def _check(self) -> None:
        low = self.min_pitch
        self._set(max_pitch=check_number("PitchSystem.max_pitch", self.max_pitch, low, np.pi, open_low=True))


_Angle = Annotated[float | None, Range(-np.pi, np.pi)]
_Speed = Annotated[float | None, Range(0.0, 1e4)]
_Gain = Annotated[float | None, Range(0.0, _BIG_GAIN)]
_Share = Annotated[float | None, Range(0.0, 1e3)]
_Zeta = Annotated[float | None, Range(0.0, 10.0)]


@dataclass(frozen=True, eq=False, repr=False)
class ControlData(ArrayRecord):
    """Numbers of a turbine's own controller, as far as they are known; None stands for what is not published.

    Speeds are those of the generator and torques those on the high-speed shaft, as in a Bladed-style controller: a file
    with gains for the rotor speed is converted with the gear ratio by its reader. All gains are those of the sign
    convention in which more pitch and more torque slow the rotor down, so all are positive.
    """

    fine_pitch: _Angle = None
    """Pitch of optimal power below rated [rad]."""
    optimal_tip_speed_ratio: Annotated[float | None, Range(0.1, 50.0)] = None
    """[-]."""
    peak_power_coefficient: Annotated[float | None, Range(0.01, 0.7)] = None
    """Aerodynamic power coefficient at fine pitch and optimal tip-speed ratio [-]."""
    region_2_gain: _Gain = None
    """Generator torque over the square of the generator speed below rated [N m/(rad/s)^2]."""
    air_density: Annotated[float | None, Range(0.1, 10.0)] = None
    """For which the region-2 gain is made [kg/m^3]; None for the standard atmosphere at sea level."""
    cut_in_generator_speed: _Speed = None
    """Generator speed at which torque begins [rad/s] (VS_CtInSp)."""
    region_2_speed: _Speed = None
    """Generator speed at which region 2 begins [rad/s] (VS_Rgn2Sp)."""
    region_3_speed: _Speed = None
    """Generator speed from which on region 3 holds [rad/s] (VS_RtGnSp)."""
    slip: Annotated[float | None, Range(0.0, 1.0)] = None
    """Slip of region 2 1/2 as a fraction (VS_SlPc / 100)."""
    rated_mechanical_power: Annotated[float | None, Range(0.0, 1e9)] = None
    """Power on the high-speed shaft that region 3 holds [W] (VS_RtPwr)."""
    torque_proportional_gain: _Gain = None
    """From generator speed error to generator torque [N m s/rad]."""
    torque_integral_gain: _Gain = None
    """Of its integral [N m/rad]."""
    constant_power: bool | None = None
    """Whether region 3 holds power (True) or torque (False). A held torque makes more than rated power while the rotor
    is faster than rated, as in ROSCO."""
    gain_pitch: Annotated[NDArray[np.float64] | None, Table("gains", low=-np.pi, high=np.pi, ascending=1)] = None
    """Pitch of the gain schedule, ascending (n,) [rad]; the two columns below come with it."""
    pitch_proportional_gain: Annotated[NDArray[np.float64] | None, Table("gains", low=-_BIG_GAIN)] = None
    """From generator speed error [rad/s] to pitch [rad] at ``gain_pitch`` (n,) [s]. It may turn negative at a large
    pitch, where the air damps more than is required."""
    pitch_integral_gain: Annotated[NDArray[np.float64] | None, Table("gains", low=0.0)] = None
    """Of its integral (n,) [-]."""
    reference_generator_speed: _Speed = None
    """Generator speed that the pitch controller holds [rad/s] (PC_RefSpd)."""
    speed_filter_frequency: Annotated[float | None, Range(1e-3, 1e3)] = None
    """Corner frequency of the low-pass filter on the generator speed [rad/s]."""
    speed_filter_damping: _Zeta = None
    """Its damping ratio where the filter is of second order [-]; None for first order."""
    gain_doubling_pitch: Annotated[float | None, Range(1e-4, 10.0)] = None
    """Pitch at which the gains are half of those at zero pitch [rad] (PC_KK); ``gain_pitch`` is then the one value
    0."""
    power_per_pitch: Annotated[float | None, Range(-_BIG_GAIN, 0.0)] = None
    """Change of the aerodynamic power with the pitch at rated and fine pitch [W/rad], negative."""
    min_pitch_wind: Annotated[NDArray[np.float64] | None, Table("winds", low=-200.0, high=200.0, ascending=1)] = None
    """Wind speed at hub height, ascending (m,) [m/s]: peak shaving and power below rated."""
    min_pitch: Annotated[NDArray[np.float64] | None, Table("winds", low=-np.pi)] = None
    """Least pitch there (m,) [rad]. Both or neither."""
    pitch_actuator_frequency: Annotated[float | None, Range(1e-2, 1e3)] = None
    """Natural frequency of the pitch actuator as a second-order system [rad/s]."""
    pitch_actuator_damping: _Zeta = None
    """Its damping ratio [-]."""
    natural_frequency: Annotated[float | None, Range(1e-3, 100.0)] = None
    """Of the speed loop for which the pitch gains were made [rad/s]."""
    damping_ratio: _Zeta = None
    """Of that loop [-]."""
    region_3_min_pitch: _Angle = None
    """Pitch from which on the torque controller is in region 3 [rad] (VS_Rgn3MP)."""
    max_pitch: _Angle = None
    """Limit of the pitch controller where it is not that of the drives [rad] (PC_MaxPit)."""
    max_pitch_rate: Annotated[float | None, Range(1e-6, 10.0)] = None
    """The same for the rate [rad/s] (PC_MaxRat)."""
    trim_wind: Annotated[NDArray[np.float64] | None, Table("trims", low=-200.0, high=200.0, ascending=1)] = None
    """Wind speed at hub height from rated on, ascending (k,) [m/s]."""
    trim_pitch: Annotated[NDArray[np.float64] | None, Table("trims", low=-np.pi)] = None
    """Steady pitch there (k,) [rad]. Both or neither."""
    speed_shift_per_pitch: _Share = None
    """Fall of the speed that the torque law tracks, over rated speed, per pitch above the least pitch [1/rad]: the
    set-point smoother (Abbas et al., Wind Energ. Sci. 7 (2022) 53, section 3.4)."""
    speed_shift_per_power: _Share = None
    """Rise of the speed that the pitch law holds, over rated speed, per power missing to rated, over rated power
    [-]."""
    speed_shift_frequency: Annotated[float | None, Range(1e-4, 1e3)] = None
    """Corner frequency of the low-pass filter on both shifts [rad/s]."""

    def _check(self) -> None:
        for grid, *columns in (
            ("gain_pitch", "pitch_proportional_gain", "pitch_integral_gain"),
            ("trim_wind", "trim_pitch"),
            ("min_pitch_wind", "min_pitch"),
        ):
            for name in columns:
                value = getattr(self, name)
                if (value is None) != (getattr(self, grid) is None):
                    allowed = f"as many numbers as {grid}" if value is None else f"None without {grid}"
                    raise fail(f"ControlData.{name}", value, allowed)
        if self.gain_doubling_pitch is not None and (self.gain_pitch is None or self.gain_pitch.tolist() != [0.0]):
            raise fail("ControlData.gain_doubling_pitch", self.gain_doubling_pitch, "None unless gain_pitch is [0]")


@dataclass(frozen=True, eq=False, repr=False)
class Turbine(ArrayRecord):
    """A complete turbine."""

    name: str
    n_blades: Annotated[int, Range(1, 10, whole=True)]
    rotor_orientation: Annotated[str, OneOf("upwind")]
    rotor_diameter: Annotated[float, Range(0.1, 1000.0)]
    """[m], within 1 % of what blade, hub and cone give."""
    hub_height: Annotated[float, Range(0.1, 1000.0)]
    """Of the apex above ground or mean sea level, undeformed [m]."""
    rated_wind_speed: float
    """[m/s], above cut-in."""
    cut_in: Annotated[float, Range(0.0, 30.0)]
    """[m/s]."""
    cut_out: float
    """[m/s]."""
    air_density: _Density
    """[kg/m^3]."""
    blade: Blade
    tower: Tower
    hub: Hub
    nacelle: Nacelle
    drivetrain: Drivetrain
    pitch: PitchSystem
    iec_class: Annotated[str, OneOf("I", "II", "III", "IV")]
    turbulence_class: Annotated[str, OneOf("A+", "A", "B", "C")]
    """Of IEC 61400-1."""
    notes: tuple[str, ...] = ()
    """Assumptions of the reader where the file does not say it, in plain words."""
    control: ControlData | None = None
    """Published numbers of the turbine's own controller."""
    design_air_density: Annotated[float | None, Range(0.1, 10.0)] = None
    """Of the air for which the turbine's controller is designed [kg/m^3], where it is not ``air_density``."""
    rotation: Annotated[str, OneOf("clockwise", "counter-clockwise")] = "clockwise"
    """Direction in which the rotor turns, seen looking downwind. Blade data are in the frame of the blade, z to the
    tip, x to the suction side, y to the trailing edge, which is left-handed where the rotor turns counter-clockwise
    (`wt_gym.turbines.variants.mirrored`)."""
    ice: BladeIce | None = None
    """On one of the blades."""

    def _check(self) -> None:
        if self.ice is not None and self.ice.blade > self.n_blades:
            raise fail("Turbine.ice", self.ice, f"None or ice on one of the {self.n_blades} blades")
        rated = check_number("Turbine.rated_wind_speed", self.rated_wind_speed, self.cut_in, 40.0, open_low=True)
        self._set(
            rated_wind_speed=rated,
            cut_out=check_number("Turbine.cut_out", self.cut_out, rated, 100.0),
            notes=tuple(self.notes),
        )
        hub, nacelle = self.hub, self.nacelle
        diameter = 2.0 * (hub.radius + self.blade.length) * float(np.cos(hub.cone))
        height = self.tower.height + nacelle.tower_top_to_shaft + nacelle.overhang * float(np.sin(nacelle.tilt))
        for name, geometry in (("rotor_diameter", diameter), ("hub_height", height)):
            if abs(getattr(self, name) - geometry) > 0.01 * geometry:
                allowed = f"{geometry:.2f} m +- 1 %, which blade, hub, nacelle and tower give"
                raise fail(f"Turbine.{name}", getattr(self, name), allowed)

    def with_rotational_augmentation(self, model: str = "du-selig", tip_speed_ratio: float | None = None) -> Turbine:
        """Return this turbine with polars whose stall is delayed by rotation.

        Parameters
        ----------
        model : str
            "du-selig", "snel" or "snel-1993", see `RotationalAugmentation`.
        tip_speed_ratio : float, optional
            Of the operation for which the polars are made; by default that at rated wind and rotor speed.

        Raises
        ------
        TurbineDefinitionError
            If the polars hold the effect of rotation already, or the model is unknown.

        Warns
        -----
        UserWarning
            If it is not known whether they do; the polars are then taken as two-dimensional, with a note.
        """
        what = f"{model!r} for {self.name}"
        if self.blade.rotating_polars or self.blade.augmentation is not None:
            allowed = "a turbine with two-dimensional polars; those of its blade hold the delay of stall by rotation"
            raise fail("Turbine.with_rotational_augmentation", what, allowed)
        radius = 0.5 * self.rotor_diameter
        ratio = tip_speed_ratio
        if ratio is None:
            ratio = self.drivetrain.rated_rotor_speed * radius / self.rated_wind_speed
        augmentation = RotationalAugmentation(model, radius, ratio)
        notes = (*self.notes, f"stall delayed by rotation: {model} at the tip-speed ratio {ratio:.2f}")
        if self.blade.rotating_polars is None:
            unknown = "nothing says whether its polars hold the delay of stall by rotation; taken as two-dimensional"
            warnings.warn(f"rotational augmentation {what}: {unknown}", stacklevel=2)
            notes = (*notes, f"polars: {unknown}")
        return replace(self, blade=replace(self.blade, augmentation=augmentation), notes=notes)

    def with_site(self, **site: Any) -> Turbine:
        """Return this turbine at a site, see `wt_gym.turbines.model.with_site`."""
        return with_site(self, site)

    @property
    def title(self) -> str:
        """Name for headings, with what is unusual about the turbine."""
        return self.name if self.rotation == "clockwise" else f"{self.name}, {self.rotation}"

    @property
    def controller_air_density(self) -> float:
        """Density of the air for which the turbine's controller is designed [kg/m^3]."""
        return self.air_density if self.design_air_density is None else self.design_air_density


SITE = {
    "air_density": "kg/m^3",
    "controller_air_density": "kg/m^3",
    "cut_in": "m/s",
    "cut_out": "m/s",
    "iec_class": "",
    "turbulence_class": "",
    "rotation": "",
}
"""Numbers and names of a site, with their units."""

_NOTE = "site: "


def with_site(turbine: Turbine, site: Mapping[str, Any] | None) -> Turbine:
    """Return a turbine at a site.

    =========================== ====================================================================================
    ``air_density``             [kg/m^3], 0.1 to 10: density in aerodynamics, tower drag, operating points, available
                                power and reference loads. The rated wind speed scales with ρ^(-1/3), which keeps the
                                power of the wind at rated
    ``controller_air_density``  density that the controller is designed for [kg/m^3]; by default that of the turbine's
                                file, so that the region-2 gain does not change
    ``cut_in``, ``cut_out``     [m/s]: range of wind speeds in which the turbine operates
    ``iec_class``               "I" to "IV": reference wind speed and wind climate
    ``turbulence_class``        "A+", "A", "B" or "C"
    ``rotation``                "clockwise" or "counter-clockwise": direction in which the rotor turns, seen looking
                                downwind
    =========================== ====================================================================================

    Parameters
    ----------
    site : mapping or None
        Any of the above; None or empty: the turbine as it is.

    Examples
    --------
    >>> from wt_gym.turbines import load_turbine
    >>> high = with_site(load_turbine("nrel_5mw"), {"air_density": 1.0})
    >>> round(high.rated_wind_speed, 2)
    12.2
    """
    if site is None:
        return turbine
    if not isinstance(site, Mapping):
        raise TurbineDefinitionError(f"site must map names to values, got {site!r:.100}; names: {', '.join(SITE)}")
    for name in site:
        if name not in SITE:
            near = did_you_mean(name, SITE, ".")
            raise TurbineDefinitionError(f"site has no {name!r:.60}{near} Allowed: {', '.join(SITE)}")
    changes: dict[str, Any] = {name: site[name] for name in site if name != "controller_air_density"}
    if "air_density" in site:
        density = check_number("site['air_density']", site["air_density"], 0.1, 10.0)
        changes["rated_wind_speed"] = turbine.rated_wind_speed * (turbine.air_density / density) ** (1.0 / 3.0)
    designed = turbine.controller_air_density
    if "controller_air_density" in site:
        designed = check_number("site['controller_air_density']", site["controller_air_density"], 0.1, 10.0)
    if designed != changes.get("air_density", turbine.air_density) or "controller_air_density" in site:
        changes["design_air_density"] = designed
    told = [f"{name} {site[name]} {unit}".strip() for name, unit in SITE.items() if name in site]
    return replace(turbine, **changes, notes=(*turbine.notes, _NOTE + ", ".join(told))) if site else turbine


def at_controller_density(turbine: Turbine) -> Turbine:
    """The turbine in the air for which its controller is designed: of it the controller's rules take their numbers."""
    density = turbine.controller_air_density
    if density == turbine.air_density:
        return turbine
    return replace(
        turbine,
        air_density=density,
        # as many digits as tell the rounding of the way there and back from a turbine's number
        rated_wind_speed=round(turbine.rated_wind_speed * (turbine.air_density / density) ** (1.0 / 3.0), 9),
        design_air_density=None,
        notes=without_site(turbine.notes),
    )


def without_site(notes: tuple[str, ...]) -> tuple[str, ...]:
    """Return the notes of a turbine without those of its site."""
    return tuple(note for note in notes if not note.startswith(_NOTE))
