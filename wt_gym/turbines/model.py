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
from dataclasses import replace
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from wt_gym.base.errors import TurbineDefinitionError, did_you_mean
from wt_gym.base.options import option, option_record
from wt_gym.base.quantities import Array
from wt_gym.hydrodynamics.platform import Platform
from wt_gym.turbines.airfoil import RotationalAugmentation
from wt_gym.turbines.blade import BeamStations, Blade, BladeIce
from wt_gym.turbines.checks import ArrayRecord, check_number, check_span, check_symmetric, fail

SEA_WATER = 1025.0
"""Density of sea water [kg/m^3]."""
LONGEST_LAG = 2.0
"""Of a generator torque [s]."""
STRONGEST = 0.2
"""Damping ratio that a converter may add to the torsion of the shaft [-]."""

Notes: TypeAlias = tuple[str, ...]
_BIG = 1e15  # Bound of masses, inertias, stiffnesses: far above any machine, far below overflow
_BIG_GAIN = 1e12
_LEAST_EFFICIENCY = 0.3  # what is below is a slip of the pen
_AFLOAT = 0.1  # of the displaced mass; published models have up to 0.034 (ITI Energy's barge)


@option_record
class Support(ArrayRecord):
    """Monopile between the sea bed and the base of a tower: one beam with it, in its frame.

    The sea has no waves and no current: what is in it moves the water around it, and that is all. A cylinder that
    moves across its axis carries added mass, rho pi D^2/4 per length (potential flow, J. N. Newman, Marine
    Hydrodynamics, 1977, section 4.13), which has inertia and no weight.
    """

    base_height: float = option("of the sea bed above mean sea level, minus the depth", unit="m", low=-500, high=500)
    diameter_station: Array = option("distance from the base", unit="m", shape=("diameter",), low=0, ascending=2)
    diameter: Array = option("outer diameter", unit="m", shape=("diameter",), low=0.01, high=50)
    structure: BeamStations = option("from the base (station 0) to the base of the tower", kinds=(BeamStations,))
    foundation: Array | None = option(
        "stiffness of the ground against displacement and rotation of the base in axes of a tower (x downwind, y left, "
        "z up) [N/m, N, N m], see `wt_gym.structure.beam.pile_head_stiffness`",
        default=None,
        otherwise="clamped",
        shape=(6, 6),
    )
    top_mass: float = option("transition piece at the base of the tower", default=0.0, unit="kg", low=0, high=1e9)
    water_density: float = option("0 leaves the water out", default=SEA_WATER, unit="kg/m^3", low=0, high=2000)

    def check(self) -> None:
        """Check what belongs together."""
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

    def diameter_at(self, station: ArrayLike) -> Array:
        """Return the outer diameter [m] at a distance from the base [m], linear between stations."""
        return np.interp(np.asarray(station, dtype=np.float64), self.diameter_station, self.diameter)

    def added_mass_at(self, station: ArrayLike) -> Array:
        """Return the mass per length [kg/m] of the water that moves along across the axis, none above sea level."""
        s = np.asarray(station, dtype=np.float64)
        wet = self.base_height + s <= 0.0
        return np.where(wet, 0.25 * np.pi * self.water_density * self.diameter_at(s) ** 2, 0.0)


@option_record
class Tower(ArrayRecord):
    """Tower, clamped at its base or standing on a support."""

    base_height: float = option("of the base above ground or sea (TowerBsHt)", unit="m", low=-500, high=500)
    height: float = option("of the top (yaw bearing) above ground or sea (TowerHt)", unit="m", high=500)
    diameter_station: Array = option("distance from the base", unit="m", shape=("diameter",), low=0, ascending=2)
    diameter: Array = option("outer diameter", unit="m", shape=("diameter",), low=0.01, high=50)
    structure: BeamStations = option("from the base (station 0) to the top", kinds=(BeamStations,))
    damping_ratio: float = option("of every tower mode, fraction of critical (TwrFADmp / 100)", low=0, high=0.5)
    drag_coefficient: float = option("of the section, based on the diameter (TwrCd)", low=0, high=5)
    support: Support | None = option("monopile under the base", default=None, kinds=(Support,))

    def check(self) -> None:
        """Check what belongs together."""
        base, support = self.base_height, self.support
        check_number("Tower.height", self.height, base, 500.0, open_low=True)
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

    def diameter_at(self, station: ArrayLike) -> Array:
        """Return the outer diameter [m] at a distance from the base [m], linear between stations."""
        s = np.asarray(station, dtype=np.float64)
        if np.any(~((s >= 0.0) & (s <= self.length * (1.0 + 1e-9)))):
            raise fail("station", station, f"distances from the tower base in [0, {self.length:g}] m")
        return np.interp(s, self.diameter_station, self.diameter)


@option_record
class Hub(ArrayRecord):
    """Hub with everything that turns but does not pitch."""

    radius: float = option("from the apex to the blade roots (HubRad)", unit="m", low=0, high=50)
    cone: float = option("tips upwind (minus PreCone)", unit="rad", low=-np.pi / 4, high=np.pi / 4)
    mass: float = option("with all that turns but does not pitch (HubMass)", unit="kg", low=0, high=_BIG)
    inertia_axial: float = option("about the shaft (HubIner)", unit="kg m^2", low=0, high=_BIG)
    inertia_transverse: float = option("across it, about the center of mass", unit="kg m^2", low=0, high=_BIG)
    cm_offset_along_shaft: float = option("mass center downwind of the apex (HubCM)", unit="m", low=-50, high=50)


@option_record
class Nacelle(ArrayRecord):
    """Everything that yaws but does not turn with the rotor, and where the shaft lies in it."""

    mass: float = option("without the yaw bearing (NacMass)", unit="kg", low=0, high=_BIG)
    cm: Array = option(
        "center of mass from the tower top, x downwind, y left, z up (NacCM)", unit="m", shape=(3,), low=-100, high=100
    )
    inertia: Array = option("about the center of mass (NacYIner is about the yaw axis)", unit="kg m^2", shape=(3, 3))
    tilt: float = option("raises the upwind end (minus ShftTilt)", unit="rad", low=-np.pi / 4, high=np.pi / 4)
    overhang: float = option("yaw axis to apex, upwind (minus OverHang)", unit="m", low=-50, high=50)
    tower_top_to_shaft: float = option("height on the yaw axis (Twr2Shft)", unit="m", low=-20, high=50)
    yaw_bearing_mass: float = option("at the tower top (YawBrMass)", unit="kg", low=0, high=_BIG)
    yaw_spring: float = option("of the yaw drive (YawSpr)", unit="N m/rad", low=0, high=_BIG, above=True)
    yaw_damper: float = option("of the yaw drive (YawDamp)", unit="N m s/rad", low=0, high=_BIG)
    max_yaw_rate: float = option("of the yaw drive (YawManRat)", unit="rad/s", low=0, high=1)

    def check(self) -> None:
        """Check what belongs together."""
        check_symmetric("Nacelle.inertia", self.inertia[None])
        least = float(np.linalg.eigvalsh(self.inertia)[0])
        if least < -1e-9 * np.abs(self.inertia).max():
            raise fail("Nacelle.inertia", f"least principal inertia {least:g} kg m^2", "principal inertias >= 0")


@option_record
class LossShares(ArrayRecord):
    """Shares of the losses of generator and converter at rated operation [-], see `wt_gym.turbines.variants`."""

    by_value = True

    copper: float = option("c", default=0.45, low=0, high=1)
    iron: float = option("i", default=0.15, low=0, high=1)
    converter: float = option("k; c + i + k = 1", default=0.4, low=0, high=1)

    def check(self) -> None:
        """Check what belongs together."""
        if abs(self.copper + self.iron + self.converter - 1.0) > 1e-9:
            raise fail("LossShares", self, "shares whose sum is 1")


@option_record
class ShaftDamper(ArrayRecord):
    """Damping of the shaft's torsion by the converter, see `wt_gym.turbines.variants.shaft_damper_of`."""

    by_value = True

    coefficient: float = option("torque over speed, low-speed shaft", unit="N m s/rad", low=0, high=_BIG, above=True)
    frequency: float = option("of rotor against generator", unit="rad/s", low=0, high=_BIG, above=True)


@option_record
class Drivetrain(ArrayRecord):
    """Shaft, gearbox and generator with their limits."""

    gear_ratio: float = option("generator speed over rotor speed (GBRatio)", low=0.1, high=1000, above=True)
    gearbox_efficiency: float = option("(GBoxEff / 100)", low=_LEAST_EFFICIENCY, high=1, above=True)
    generator_efficiency: float = option("(GenEff / 100)", low=_LEAST_EFFICIENCY, high=1, above=True)
    generator_inertia: float = option("high-speed shaft (GenIner)", unit="kg m^2", low=0, high=_BIG, above=True)
    spring: float = option("low-speed shaft (DTTorSpr)", unit="N m/rad", low=0, high=_BIG, above=True)
    damper: float = option("low-speed shaft (DTTorDmp)", unit="N m s/rad", low=0, high=_BIG)
    rated_power: float = option("electrical", unit="W", low=0, high=1e9, above=True)
    rated_rotor_speed: float = option("at rated power", unit="rad/s", low=0, high=1000, above=True)
    min_rotor_speed: float = option("at most the rated one", unit="rad/s", low=0)
    max_generator_torque: float = option("high-speed shaft (VS_MaxTq)", unit="N m", low=0, high=_BIG, above=True)
    max_torque_rate: float = option("high-speed shaft (VS_MaxRat); 0: a linear damper", unit="N m/s", low=0, high=_BIG)
    generator_damping: float = option(
        "low-speed torque over speed as a linear damper; 0: none", default=0.0, unit="N m s/rad", low=0, high=_BIG
    )
    gearbox_reverses: bool = option("the high-speed shaft turns against the low-speed shaft (GBRevers)", default=False)
    torque_lag: float = option(
        "time constant of the torque behind its demand", default=0.0, unit="s", low=0, high=LONGEST_LAG
    )
    losses: LossShares | None = option(
        "over speed and torque", default=None, otherwise="one efficiency", kinds=(LossShares,)
    )
    shaft_damper: ShaftDamper | None = option("converter against torsion", default=None, kinds=(ShaftDamper,))

    @property
    def speed_ratio(self) -> float:
        """Speed of the generator against the nacelle over that of the rotor; negative where the gearbox reverses."""
        return -self.gear_ratio if self.gearbox_reverses else self.gear_ratio

    @property
    def takes_torque(self) -> bool:
        """Whether the generator takes a demand for its torque."""
        return self.max_torque_rate > 0.0

    def check(self) -> None:
        """Check what belongs together."""
        check_number("Drivetrain.min_rotor_speed", self.min_rotor_speed, 0.0, self.rated_rotor_speed)
        if self.takes_torque:
            return
        if not self.generator_damping > 0.0:
            raise fail("Drivetrain.max_torque_rate", self.max_torque_rate, "0 with a positive generator_damping only")
        for name, off in (("torque_lag", 0.0), ("shaft_damper", None)):
            if getattr(self, name) != off:
                raise fail(f"Drivetrain.{name}", getattr(self, name), f"{off} for a generator that takes no demand")


@option_record
class PitchSystem(ArrayRecord):
    """Limits and bandwidth of the pitch actuators.

    Without a servo the drive is ideal and follows the demand c at up to ``max_rate``: windIO files are silent on it,
    and the baseline controller of the NREL 5-MW is published without dynamics of the actuators (NREL/TP-500-38060,
    section 7).
    """

    min_pitch: float = option("(PC_MinPit)", unit="rad", low=-np.pi / 2, high=np.pi)
    max_pitch: float = option("above ``min_pitch`` (PC_MaxPit)", unit="rad", high=np.pi)
    max_rate: float = option("(PC_MaxRat)", unit="rad/s", low=0, high=10, above=True)
    servo_frequency: float | None = option(
        "ω of a servo θ̈ = ω² (c − θ) − 2 ζ ω θ̇ (PA_CornerFreq)", default=None, unit="rad/s", low=0.1, high=100
    )
    servo_damping: float = option("ζ of that servo (PA_Damping); its lag is 2 ζ/ω", default=1.0, low=0.1, high=10)

    def check(self) -> None:
        """Check what belongs together."""
        check_number("PitchSystem.max_pitch", self.max_pitch, self.min_pitch, np.pi, open_low=True)


@option_record
class ControlData(ArrayRecord):
    """Numbers of a turbine's own controller, as far as they are known; None stands for what is not published.

    Speeds are those of the generator and torques those on the high-speed shaft, as in a Bladed-style controller: a file
    with gains for the rotor speed is converted with the gear ratio by its reader. All gains are those of the sign
    convention in which more pitch and more torque slow the rotor down, so all are positive.
    """

    fine_pitch: float | None = option("of optimal power below rated", default=None, unit="rad", low=-np.pi, high=np.pi)
    optimal_tip_speed_ratio: float | None = option("at fine pitch", default=None, low=0.1, high=50)
    peak_power_coefficient: float | None = option("at the optimal tip-speed ratio", default=None, low=0.01, high=0.7)
    region_2_gain: float | None = option(
        "generator torque over the square of its speed", default=None, unit="N m/(rad/s)^2", low=0, high=_BIG_GAIN
    )
    air_density: float | None = option(
        "of the region-2 gain", default=None, unit="kg/m^3", otherwise="standard, at sea level", low=0.1, high=10
    )
    cut_in_generator_speed: float | None = option(
        "torque begins (VS_CtInSp)", default=None, unit="rad/s", low=0, high=1e4
    )
    region_2_speed: float | None = option("region 2 begins (VS_Rgn2Sp)", default=None, unit="rad/s", low=0, high=1e4)
    region_3_speed: float | None = option("region 3 begins (VS_RtGnSp)", default=None, unit="rad/s", low=0, high=1e4)
    slip: float | None = option("of region 2 1/2 (VS_SlPc / 100)", default=None, low=0, high=1)
    rated_mechanical_power: float | None = option(
        "of the generator shaft (VS_RtPwr)", default=None, unit="W", low=0, high=1e9
    )
    torque_proportional_gain: float | None = option(
        "from generator speed error to torque", default=None, unit="N m s/rad", low=0, high=_BIG_GAIN
    )
    torque_integral_gain: float | None = option("of its integral", default=None, unit="N m/rad", low=0, high=_BIG_GAIN)
    constant_power: bool | None = option("region 3 holds power, not torque (as ROSCO can)", default=None)
    gain_pitch: Array | None = option(
        "of the gain schedule", default=None, unit="rad", shape=("gains",), low=-np.pi, high=np.pi, ascending=1
    )
    pitch_proportional_gain: Array | None = option(
        "from speed error to pitch; may turn negative", default=None, unit="s", shape=("gains",), low=-_BIG_GAIN
    )
    pitch_integral_gain: Array | None = option("of its integral", default=None, unit="-", shape=("gains",), low=0)
    reference_generator_speed: float | None = option(
        "that the pitch controller holds (PC_RefSpd)", default=None, unit="rad/s", low=0, high=1e4
    )
    speed_filter_frequency: float | None = option(
        "corner of the low-pass filter on the generator speed", default=None, unit="rad/s", low=1e-3, high=1e3
    )
    speed_filter_damping: float | None = option("of it", default=None, otherwise="first order", low=0, high=10)
    gain_doubling_pitch: float | None = option(
        "where gains are half of those at ``gain_pitch`` 0 (PC_KK)", default=None, unit="rad", low=1e-4, high=10
    )
    power_per_pitch: float | None = option(
        "aerodynamic, at rated and fine pitch", default=None, unit="W/rad", low=-_BIG_GAIN, high=0
    )
    min_pitch_wind: Array | None = option(
        "wind speed at hub height", default=None, unit="m/s", shape=("winds",), low=-200, high=200, ascending=1
    )
    min_pitch: Array | None = option("least pitch there", default=None, unit="rad", shape=("winds",), low=-np.pi)
    pitch_actuator_frequency: float | None = option("of second order", default=None, unit="rad/s", low=1e-2, high=1e3)
    pitch_actuator_damping: float | None = option("damping ratio", default=None, unit="-", low=0, high=10)
    natural_frequency: float | None = option(
        "of the speed loop as designed", default=None, unit="rad/s", low=1e-3, high=100
    )
    damping_ratio: float | None = option("of that loop", default=None, unit="-", low=0, high=10)
    region_3_min_pitch: float | None = option(
        "from which region 3 holds (VS_Rgn3MP)", default=None, unit="rad", low=-np.pi, high=np.pi
    )
    max_pitch: float | None = option(
        "where it is not that of the drives (PC_MaxPit)", default=None, unit="rad", low=-np.pi, high=np.pi
    )
    max_pitch_rate: float | None = option("likewise (PC_MaxRat)", default=None, unit="rad/s", low=1e-6, high=10)
    trim_wind: Array | None = option(
        "from rated on", default=None, unit="m/s", shape=("trims",), low=-200, high=200, ascending=1
    )
    trim_pitch: Array | None = option("steady pitch there", default=None, unit="rad", shape=("trims",), low=-np.pi)
    speed_shift_per_pitch: float | None = option(
        "fall of the speed that the torque law tracks, over rated speed, per pitch above the least: the set-point "
        "smoother (Abbas et al., Wind Energ. Sci. 7 (2022) 53, section 3.4)",
        default=None,
        unit="1/rad",
        low=0,
        high=1e3,
    )
    speed_shift_per_power: float | None = option(
        "of the pitch law, over rated, per missing power over rated", default=None, low=0, high=1e3
    )
    speed_shift_frequency: float | None = option(
        "corner of the low-pass filter on both", default=None, unit="rad/s", low=1e-4, high=1e3
    )

    def check(self) -> None:
        """Check what belongs together."""
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


@option_record
class Turbine(ArrayRecord):
    """A complete turbine."""

    name: str = option("of the turbine")
    n_blades: int = option("of the rotor", low=1, high=10)
    rotor_orientation: str = option("of the tower", choices=("upwind",))
    rotor_diameter: float = option("within 1 % of what blade, hub and cone give", unit="m", low=0.1, high=1000)
    hub_height: float = option("of the undeformed apex above ground or sea", unit="m", low=0.1, high=1000)
    rated_wind_speed: float = option("above cut-in", unit="m/s", high=40)
    cut_in: float = option("wind speed", unit="m/s", low=0, high=30)
    cut_out: float = option("wind speed, at least rated", unit="m/s", high=100)
    air_density: float = option("at the site", unit="kg/m^3", low=0.1, high=10)
    blade: Blade = option("each of the blades", kinds=(Blade,))
    tower: Tower = option("with its support", kinds=(Tower,))
    hub: Hub = option("of the rotor", kinds=(Hub,))
    nacelle: Nacelle = option("with the yaw drive", kinds=(Nacelle,))
    drivetrain: Drivetrain = option("with the generator", kinds=(Drivetrain,))
    pitch: PitchSystem = option("drives of the blades", kinds=(PitchSystem,))
    iec_class: str = option("of IEC 61400-1", choices=("I", "II", "III", "IV"))
    turbulence_class: str = option("of IEC 61400-1", choices=("A+", "A", "B", "C"))
    notes: Notes = option(
        "assumptions of the reader, where the file does not say it", default=(), kinds=(tuple,), allowed="texts"
    )
    control: ControlData | None = option("of its own controller, as published", default=None, kinds=(ControlData,))
    design_air_density: float | None = option(
        "of its controller", default=None, unit="kg/m^3", otherwise="``air_density``", low=0.1, high=10
    )
    rotation: str = option(
        "of the rotor, seen looking downwind; where it is counter-clockwise the frame of the blade is left-handed "
        "(`wt_gym.turbines.variants.mirrored`)",
        default="clockwise",
        choices=("clockwise", "counter-clockwise"),
    )
    ice: BladeIce | None = option("on one of the blades", default=None, kinds=(BladeIce,))
    floater: Platform | None = option("that carries the tower, with its moorings", default=None, kinds=(Platform,))

    def check(self) -> None:
        """Check what belongs together."""
        if self.ice is not None and self.ice.blade > self.n_blades:
            raise fail("Turbine.ice", self.ice, f"None or ice on one of the {self.n_blades} blades")
        check_number("Turbine.rated_wind_speed", self.rated_wind_speed, self.cut_in, 40.0, open_low=True)
        check_number("Turbine.cut_out", self.cut_out, self.rated_wind_speed, 100.0)
        hub, nacelle = self.hub, self.nacelle
        diameter = 2.0 * (hub.radius + self.blade.length) * float(np.cos(hub.cone))
        height = self.tower.height + nacelle.tower_top_to_shaft + nacelle.overhang * float(np.sin(nacelle.tilt))
        for name, geometry in (("rotor_diameter", diameter), ("hub_height", height)):
            if abs(getattr(self, name) - geometry) > 0.01 * geometry:
                allowed = f"{geometry:.2f} m +- 1 %, which blade, hub, nacelle and tower give"
                raise fail(f"Turbine.{name}", getattr(self, name), allowed)
        if (floater := self.floater) is not None:
            turbine, pull = self.tower_top_mass + self.tower.structure.mass_moment(), floater.pull() / floater.gravity
            carried, displaced = floater.mass + turbine + pull, floater.displaced_mass
            if abs(carried - displaced) > _AFLOAT * displaced:
                parts = (
                    f"platform {floater.mass:g}, rotor, nacelle and tower {turbine:g}, pull of mooring lines {pull:g}"
                )
                allowed = f"that of the displaced water, {displaced:g} kg, within {_AFLOAT:.0%}"
                raise fail(f"Turbine.floater: mass to carry ({parts} kg)", round(carried), allowed)

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
    def tower_top_mass(self) -> float:
        """Mass of rotor and nacelle [kg]."""
        blade, nacelle = self.blade.structure, self.nacelle
        rotor = self.n_blades * np.trapezoid(blade.inertia[:, 0, 0], blade.station) + self.hub.mass
        return float(nacelle.mass + nacelle.yaw_bearing_mass + rotor)

    @property
    def n_lines(self) -> int | None:
        """Number of mooring lines; None on the ground."""
        return None if self.floater is None else len(self.floater.lines)

    @property
    def heading(self) -> str:
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
    texts = [f"{name} {site[name]} {unit}".strip() for name, unit in SITE.items() if name in site]
    return replace(turbine, **changes, notes=(*turbine.notes, _NOTE + ", ".join(texts))) if site else turbine


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
