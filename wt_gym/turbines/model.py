"""What stands under a tower at sea: a monopile in the water on its foundation.

What is published with a turbine about its controller: gains, filters and schedules, in SI units and radians.

What the losses of a generator with its converter consist of, and how slow its torque may be.

See `wt_gym.turbines.variants`.

Damper of the shaft's torsion, as a record; `wt_gym.turbines.variants` makes one for a turbine.

What a turbine is: frozen, validated dataclasses in SI units and radians. No physics beyond interpolation.

Frames
------
Global: x downwind, z up, y left looking downwind. Blade: z from root to tip, x to the suction (downwind) side, y to the
trailing edge, origin in the middle of the blade root, pitch not included. A section frame is the blade frame turned by
minus the twist about z: x_s normal to the chord to the suction side, y_s from leading to trailing edge. Positive twist
and pitch feather, that is, they turn the leading edge upwind (to -x). OpenFAST's names are given where they exist.

Numbers of the site at which a turbine stands, and of its operation there, in place of those of its file.
"""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from wt_gym.base.errors import TurbineDefinitionError, did_you_mean
from wt_gym.base.fields import later_field
from wt_gym.turbines.airfoil import Airfoil, Polar, RotationalAugmentation
from wt_gym.turbines.blade import BeamStations, Blade, BladeIce
from wt_gym.turbines.checks import (
    ArrayRecord,
    check_array,
    check_ascending,
    check_number,
    check_span,
    check_symmetric,
    fail,
)

__all__ = [
    "SITE", "STRONGEST", "Airfoil", "BeamStations", "Blade", "ControlData", "Drivetrain", "Hub", "Nacelle",
    "PitchSystem", "Polar", "Support", "Tower", "Turbine", "at_controller_density", "with_site", "without_site",
]  # fmt: skip

SEA_WATER = 1025.0
"""Density of sea water [kg/m^3]."""


@dataclass(frozen=True, eq=False, repr=False)
class Support(ArrayRecord):
    """Monopile between the sea bed and the base of a tower: one beam with it, in its frame.

    The sea has no waves and no current: what is in it moves the water around it, and that is all. A cylinder that
    moves across its axis carries added mass, rho pi D^2/4 per length (potential flow, J. N. Newman, Marine
    Hydrodynamics, 1977, section 4.13), which has inertia and no weight.

    Attributes
    ----------
    base_height : float
        Elevation of the sea bed, where the foundation begins, above mean sea level [m]: minus the depth of the water.
    diameter_station : ndarray (n,)
        Distance from the base along the monopile [m].
    diameter : ndarray (n,)
        Outer diameter [m].
    structure : BeamStations
        From the base (station 0) to the base of the tower.
    foundation : ndarray (6, 6) or None
        Stiffness that the ground has against the displacement and rotation of the base (axes of a tower: x downwind,
        y left, z up) [N/m, N, N m]; None: the base is clamped. See `wt_gym.structure.foundation.pile_head_stiffness`.
    top_mass : float
        Of a transition piece at the base of the tower [kg].
    water_density : float
        [kg/m^3]; 0 leaves the water out.

    Raises
    ------
    TurbineDefinitionError
        If a table does not fit the others, or the foundation is not a stiffness matrix.
    """

    base_height: float
    diameter_station: NDArray[np.float64]
    diameter: NDArray[np.float64]
    structure: BeamStations
    foundation: NDArray[np.float64] | None = None
    top_mass: float = 0.0
    water_density: float = SEA_WATER

    def __post_init__(self) -> None:
        """Check the fields and make the arrays read-only."""
        if not isinstance(self.structure, BeamStations):
            raise fail("Support.structure", self.structure, "BeamStations")
        station = check_array("Support.diameter_station", self.diameter_station, (None,), low=0.0)
        check_ascending("Support.diameter_station", station)
        check_span("Support.diameter_station", station, self.structure.length)
        self._set(
            base_height=check_number("Support.base_height", self.base_height, -500.0, 500.0),
            diameter_station=station,
            diameter=check_array("Support.diameter", self.diameter, (station.size,), low=0.01, high=50.0),
            top_mass=check_number("Support.top_mass", self.top_mass, 0.0, 1e9),
            water_density=check_number("Support.water_density", self.water_density, 0.0, 2000.0),
        )
        if self.foundation is not None:
            self._set(foundation=_checked_stiffness(self.foundation))

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


def _checked_stiffness(value: ArrayLike) -> NDArray[np.float64]:
    """Return a symmetric positive definite (6, 6) stiffness."""
    stiffness = check_array("Support.foundation", value, (6, 6))
    check_symmetric("Support.foundation", stiffness[None])
    scale = np.sqrt(np.abs(np.diag(stiffness)))
    if not np.all(scale > 0.0) or np.linalg.eigvalsh(stiffness / np.outer(scale, scale))[0] <= 0.0:
        raise fail("Support.foundation", stiffness.diagonal().tolist(), "a positive definite stiffness (its diagonal)")
    return stiffness


_ANGLE = np.pi
_BIG_GAIN = 1e12


@dataclass(frozen=True, eq=False, repr=False)
class ControlData(ArrayRecord):
    """Numbers of a turbine's own controller, as far as they are known; None stands for what is not published.

    Speeds are those of the generator and torques those on the high-speed shaft, as in a Bladed-style controller: a file
    with gains for the rotor speed is converted with the gear ratio by its reader. All gains are those of the sign
    convention in which more pitch and more torque slow the rotor down, so all are positive.

    Attributes
    ----------
    fine_pitch : float or None
        Pitch of optimal power below rated [rad].
    optimal_tip_speed_ratio : float or None
        [-].
    peak_power_coefficient : float or None
        Aerodynamic power coefficient at fine pitch and optimal tip-speed ratio [-].
    region_2_gain : float or None
        Generator torque over the square of the generator speed below rated [N m/(rad/s)^2].
    air_density : float or None
        For which the region-2 gain is made [kg/m^3]; None for the standard atmosphere at sea level.
    cut_in_generator_speed, region_2_speed, region_3_speed : float or None
        Generator speeds at which torque begins, at which region 2 begins, and from which on region 3 holds [rad/s]
        (VS_CtInSp, VS_Rgn2Sp, VS_RtGnSp).
    slip : float or None
        Slip of region 2 1/2 as a fraction (VS_SlPc / 100).
    rated_mechanical_power : float or None
        Power on the high-speed shaft that region 3 holds [W] (VS_RtPwr).
    torque_proportional_gain, torque_integral_gain : float or None
        From generator speed error to generator torque [N m s/rad], [N m/rad].
    constant_power : bool or None
        Whether region 3 holds power (True) or torque (False). A held torque makes more than rated power while the rotor
        is faster than rated, as in ROSCO.
    speed_shift_per_pitch : float or None
        Fall of the speed that the torque law tracks, over rated speed, per pitch above the least pitch [1/rad]: the
        set-point smoother (Abbas et al., Wind Energ. Sci. 7 (2022) 53, section 3.4).
    speed_shift_per_power : float or None
        Rise of the speed that the pitch law holds, over rated speed, per power missing to rated, over rated power [-].
    speed_shift_frequency : float or None
        Corner frequency of the low-pass filter on both shifts [rad/s].
    gain_pitch : ndarray (n,) or None
        Pitch of the gain schedule, ascending [rad].
    pitch_proportional_gain, pitch_integral_gain : ndarray (n,) or None
        From generator speed error [rad/s] to pitch [rad] at ``gain_pitch`` [s], [-]. Both come with ``gain_pitch``. The
        proportional gain may turn negative at a large pitch, where the air damps more than is required.
    gain_doubling_pitch : float or None
        Pitch at which the gains are half of those at zero pitch [rad] (PC_KK); ``gain_pitch`` is then the one value 0.
    power_per_pitch : float or None
        Change of the aerodynamic power with the pitch at rated and fine pitch [W/rad], negative.
    reference_generator_speed : float or None
        Generator speed that the pitch controller holds [rad/s] (PC_RefSpd).
    speed_filter_frequency : float or None
        Corner frequency of the low-pass filter on the generator speed [rad/s].
    speed_filter_damping : float or None
        Its damping ratio where the filter is of second order [-]; None for first order.
    min_pitch_wind, min_pitch : ndarray (m,) or None
        Wind speed at hub height, ascending [m/s], and the least pitch there [rad]: peak shaving and power below rated.
        Both or neither.
    pitch_actuator_frequency, pitch_actuator_damping : float or None
        Natural frequency [rad/s] and damping ratio [-] of the pitch actuator as a second-order system.
    natural_frequency, damping_ratio : float or None
        Of the speed loop for which the pitch gains were made [rad/s], [-].
    region_3_min_pitch : float or None
        Pitch from which on the torque controller is in region 3 [rad] (VS_Rgn3MP).
    max_pitch, max_pitch_rate : float or None
        Limits of the pitch controller where they are not those of the drives [rad], [rad/s] (PC_MaxPit, PC_MaxRat).
    trim_wind, trim_pitch : ndarray (k,) or None
        Wind speed at hub height from rated on, ascending [m/s], and the steady pitch there [rad]. Both or neither.

    Raises
    ------
    wt_gym.base.errors.TurbineDefinitionError
        For a number out of range, or a table with a part missing.
    """

    fine_pitch: float | None = None
    optimal_tip_speed_ratio: float | None = None
    peak_power_coefficient: float | None = None
    region_2_gain: float | None = None
    air_density: float | None = None
    cut_in_generator_speed: float | None = None
    region_2_speed: float | None = None
    region_3_speed: float | None = None
    slip: float | None = None
    rated_mechanical_power: float | None = None
    torque_proportional_gain: float | None = None
    torque_integral_gain: float | None = None
    constant_power: bool | None = None
    gain_pitch: NDArray[np.float64] | None = None
    pitch_proportional_gain: NDArray[np.float64] | None = None
    pitch_integral_gain: NDArray[np.float64] | None = None
    reference_generator_speed: float | None = None
    speed_filter_frequency: float | None = None
    speed_filter_damping: float | None = None
    gain_doubling_pitch: float | None = None
    power_per_pitch: float | None = None
    min_pitch_wind: NDArray[np.float64] | None = None
    min_pitch: NDArray[np.float64] | None = None
    pitch_actuator_frequency: float | None = None
    pitch_actuator_damping: float | None = None
    natural_frequency: float | None = None
    damping_ratio: float | None = None
    region_3_min_pitch: float | None = None
    max_pitch: float | None = None
    max_pitch_rate: float | None = None
    trim_wind: NDArray[np.float64] | None = None
    trim_pitch: NDArray[np.float64] | None = None
    speed_shift_per_pitch: float | None = later_field(None)
    speed_shift_per_power: float | None = later_field(None)
    speed_shift_frequency: float | None = later_field(None)

    def __post_init__(self) -> None:
        """Check the fields and make the arrays read-only."""
        ranges = {
            "fine_pitch": (-_ANGLE, _ANGLE),
            "optimal_tip_speed_ratio": (0.1, 50.0),
            "peak_power_coefficient": (0.01, 0.7),
            "region_2_gain": (0.0, _BIG_GAIN),
            "air_density": (0.1, 10.0),
            "cut_in_generator_speed": (0.0, 1e4),
            "region_2_speed": (0.0, 1e4),
            "region_3_speed": (0.0, 1e4),
            "slip": (0.0, 1.0),
            "rated_mechanical_power": (0.0, 1e9),
            "torque_proportional_gain": (0.0, _BIG_GAIN),
            "torque_integral_gain": (0.0, _BIG_GAIN),
            "speed_shift_per_pitch": (0.0, 1e3),
            "speed_shift_per_power": (0.0, 1e3),
            "speed_shift_frequency": (1e-4, 1e3),
            "reference_generator_speed": (0.0, 1e4),
            "speed_filter_frequency": (1e-3, 1e3),
            "speed_filter_damping": (0.0, 10.0),
            "pitch_actuator_frequency": (1e-2, 1e3),
            "pitch_actuator_damping": (0.0, 10.0),
            "natural_frequency": (1e-3, 100.0),
            "damping_ratio": (0.0, 10.0),
            "region_3_min_pitch": (-_ANGLE, _ANGLE),
            "gain_doubling_pitch": (1e-4, 10.0),
            "power_per_pitch": (-_BIG_GAIN, 0.0),
            "max_pitch": (-_ANGLE, _ANGLE),
            "max_pitch_rate": (1e-6, 10.0),
        }
        for name, (low, high) in ranges.items():
            value = getattr(self, name)
            if value is not None:
                self._set(**{name: check_number(f"ControlData.{name}", value, low, high)})
        if self.constant_power is not None and not isinstance(self.constant_power, bool):
            raise fail("ControlData.constant_power", self.constant_power, "True, False or None")
        self._check_table("gain_pitch", _ANGLE, {"pitch_proportional_gain": -_BIG_GAIN, "pitch_integral_gain": 0.0})
        self._check_table("trim_wind", 200.0, {"trim_pitch": -_ANGLE})
        self._check_table("min_pitch_wind", 200.0, {"min_pitch": -_ANGLE})
        if self.gain_doubling_pitch is not None and (self.gain_pitch is None or self.gain_pitch.tolist() != [0.0]):
            raise fail("ControlData.gain_doubling_pitch", self.gain_doubling_pitch, "None unless gain_pitch is [0]")

    def _check_table(self, grid_name: str, high: float, columns: dict[str, float]) -> None:
        """Check a grid and its columns (name: least value), which stand together or not at all."""
        grid = getattr(self, grid_name)
        given = [name for name in columns if getattr(self, name) is not None]
        if grid is None:
            if given:
                raise fail(f"ControlData.{given[0]}", getattr(self, given[0]), f"None without {grid_name}")
            return
        grid = check_array(f"ControlData.{grid_name}", grid, (None,), low=-high, high=high)
        if grid.size > 1:
            check_ascending(f"ControlData.{grid_name}", grid)
        self._set(**{grid_name: grid})
        for name, low in columns.items():
            values = getattr(self, name)
            if values is None:
                raise fail(f"ControlData.{name}", values, f"as many numbers as {grid_name}")
            self._set(**{name: check_array(f"ControlData.{name}", values, (grid.size,), low=low)})


LONGEST_LAG = 2.0
"""Of a generator torque [s]."""


@dataclass(frozen=True)
class LossShares:
    """What the losses of generator and converter consist of at rated operation.

    Attributes
    ----------
    copper, iron, converter : float
        c, i and k; their sum is 1 [-].
    """

    copper: float = 0.45
    iron: float = 0.15
    converter: float = 0.4

    def __post_init__(self) -> None:
        for name in ("copper", "iron", "converter"):
            check_number(f"LossShares.{name}", getattr(self, name), 0.0, 1.0)
        if abs(self.copper + self.iron + self.converter - 1.0) > 1e-9:
            raise fail("LossShares", self, "shares whose sum is 1")


STRONGEST = 0.2
"""Damping ratio that a converter may add [-]."""
_BIG = 1e15


@dataclass(frozen=True)
class ShaftDamper:
    """What the converter does against the torsion of the shaft.

    Attributes
    ----------
    coefficient : float
        c, torque over speed on the low-speed shaft [N m s/rad].
    frequency : float
        omega, of rotor and generator against each other [rad/s].
    """

    coefficient: float
    frequency: float

    def __post_init__(self) -> None:
        for name in ("coefficient", "frequency"):
            check_number(f"ShaftDamper.{name}", getattr(self, name), 0.0, _BIG, open_low=True)


ROTATIONS = ("clockwise", "counter-clockwise")
"""Directions in which a rotor turns, seen looking downwind."""

_LEAST_EFFICIENCY = 0.3
"""Of gearbox and generator; what is below is a slip of the pen."""


@dataclass(frozen=True, eq=False, repr=False)
class Tower(ArrayRecord):
    """Tower, clamped at its base or standing on a support.

    Attributes
    ----------
    base_height, height : float
        Elevation of the base and of the top (yaw bearing) above ground or mean sea level [m] (TowerBsHt, TowerHt).
    diameter_station : ndarray (n,)
        Distance from the base along the tower [m].
    diameter : ndarray (n,)
        Outer diameter [m].
    structure : BeamStations
        From the base (station 0) to the top.
    damping_ratio : float
        Structural damping of every tower mode, fraction of critical (TwrFADmp / 100).
    drag_coefficient : float
        Of the cross-section, based on the diameter (TwrCd).
    support : Support or None
        Monopile under the base.
    """

    base_height: float
    height: float
    diameter_station: NDArray[np.float64]
    diameter: NDArray[np.float64]
    structure: BeamStations
    damping_ratio: float
    drag_coefficient: float
    support: Support | None = later_field(None)

    def __post_init__(self) -> None:
        """Check the fields and make the arrays read-only."""
        base = check_number("Tower.base_height", self.base_height, -500.0, 500.0)
        height = check_number("Tower.height", self.height, base, 500.0, open_low=True)
        station = check_array("Tower.diameter_station", self.diameter_station, (None,), low=0.0)
        check_ascending("Tower.diameter_station", station)
        check_span("Tower.diameter_station", station, height - base)
        if not isinstance(self.structure, BeamStations):
            raise fail("Tower.structure", self.structure, "BeamStations")
        check_span("Tower.structure.station", self.structure.station, height - base)
        self._set(
            base_height=base,
            height=height,
            diameter_station=station,
            diameter=check_array("Tower.diameter", self.diameter, (station.size,), low=0.01, high=50.0),
            damping_ratio=check_number("Tower.damping_ratio", self.damping_ratio, 0.0, 0.5),
            drag_coefficient=check_number("Tower.drag_coefficient", self.drag_coefficient, 0.0, 5.0),
        )
        if self.support is not None:
            self._check_support(self.support)

    def _check_support(self, support: Support) -> None:
        if not isinstance(support, Support):
            raise fail("Tower.support", support, "Support or None")
        top = support.base_height + support.length
        if abs(top - self.base_height) > 1e-3:
            raise fail(
                "Tower.support", f"a top {top:g} m up", f"one at the base of the tower, {self.base_height:g} m up"
            )
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
    """Hub with everything that turns but does not pitch.

    Attributes
    ----------
    radius : float
        From the apex to the blade roots [m] (HubRad).
    cone : float
        Precone [rad], positive = tips upwind (OpenFAST PreCone with the opposite sign).
    mass : float
        [kg] (HubMass).
    inertia_axial, inertia_transverse : float
        About the shaft and about axes through the center of mass across it [kg m^2] (HubIner).
    cm_offset_along_shaft : float
        Center of mass from the apex along the shaft, positive downwind [m] (HubCM).
    """

    radius: float
    cone: float
    mass: float
    inertia_axial: float
    inertia_transverse: float
    cm_offset_along_shaft: float

    def __post_init__(self) -> None:
        """Check the fields."""
        self._set(
            radius=check_number("Hub.radius", self.radius, 0.0, 50.0),
            cone=check_number("Hub.cone", self.cone, -np.pi / 4, np.pi / 4),
            mass=check_number("Hub.mass", self.mass, 0.0, _BIG),
            inertia_axial=check_number("Hub.inertia_axial", self.inertia_axial, 0.0, _BIG),
            inertia_transverse=check_number("Hub.inertia_transverse", self.inertia_transverse, 0.0, _BIG),
            cm_offset_along_shaft=check_number("Hub.cm_offset_along_shaft", self.cm_offset_along_shaft, -50.0, 50.0),
        )


@dataclass(frozen=True, eq=False, repr=False)
class Nacelle(ArrayRecord):
    """Everything that yaws but does not turn with the rotor, and where the shaft lies in it.

    Attributes
    ----------
    mass : float
        [kg] (NacMass).
    cm : ndarray (3,)
        Center of mass from the tower top in nacelle axes (x downwind, y left, z up) [m] (NacCMxn, NacCMyn, NacCMzn).
    inertia : ndarray (3, 3)
        About the nacelle's center of mass, nacelle axes [kg m^2]. (OpenFAST's NacYIner is about the yaw axis.)
    tilt : float
        Shaft tilt [rad], positive raises the upwind end (OpenFAST ShftTilt with the opposite sign).
    overhang : float
        From the yaw axis to the apex along the shaft [m], positive for an upwind rotor (OverHang, opposite sign).
    tower_top_to_shaft : float
        Height of the shaft above the tower top, on the yaw axis [m] (Twr2Shft).
    yaw_bearing_mass : float
        At the tower top [kg] (YawBrMass).
    yaw_spring, yaw_damper : float
        Of the yaw actuator [N m/rad], [N m s/rad] (YawSpr, YawDamp).
    max_yaw_rate : float
        [rad/s] (YawManRat).
    """

    mass: float
    cm: NDArray[np.float64]
    inertia: NDArray[np.float64]
    tilt: float
    overhang: float
    tower_top_to_shaft: float
    yaw_bearing_mass: float
    yaw_spring: float
    yaw_damper: float
    max_yaw_rate: float

    def __post_init__(self) -> None:
        """Check the fields and make the arrays read-only."""
        inertia = check_array("Nacelle.inertia", self.inertia, (3, 3))
        check_symmetric("Nacelle.inertia", inertia[None])
        least = float(np.linalg.eigvalsh(inertia)[0])
        if least < -1e-9 * np.abs(inertia).max():
            raise fail("Nacelle.inertia", f"least principal inertia {least:g} kg m^2", "principal inertias >= 0")
        self._set(
            mass=check_number("Nacelle.mass", self.mass, 0.0, _BIG),
            cm=check_array("Nacelle.cm", self.cm, (3,), low=-100.0, high=100.0),
            inertia=inertia,
            tilt=check_number("Nacelle.tilt", self.tilt, -np.pi / 4, np.pi / 4),
            overhang=check_number("Nacelle.overhang", self.overhang, -50.0, 50.0),
            tower_top_to_shaft=check_number("Nacelle.tower_top_to_shaft", self.tower_top_to_shaft, -20.0, 50.0),
            yaw_bearing_mass=check_number("Nacelle.yaw_bearing_mass", self.yaw_bearing_mass, 0.0, _BIG),
            yaw_spring=check_number("Nacelle.yaw_spring", self.yaw_spring, 0.0, _BIG, open_low=True),
            yaw_damper=check_number("Nacelle.yaw_damper", self.yaw_damper, 0.0, _BIG),
            max_yaw_rate=check_number("Nacelle.max_yaw_rate", self.max_yaw_rate, 0.0, 1.0),
        )


@dataclass(frozen=True, eq=False, repr=False)
class Drivetrain(ArrayRecord):
    """Shaft, gearbox and generator with their limits.

    Attributes
    ----------
    gear_ratio : float
        Generator speed / rotor speed (GBRatio); 1 for a direct drive.
    gearbox_efficiency, generator_efficiency : float
        In (0, 1] (GBoxEff / 100, GenEff / 100).
    generator_inertia : float
        About the high-speed shaft [kg m^2] (GenIner).
    spring, damper : float
        Torsion of the drivetrain seen from the low-speed shaft [N m/rad], [N m s/rad] (DTTorSpr, DTTorDmp).
    rated_power : float
        Electrical [W].
    rated_rotor_speed, min_rotor_speed : float
        [rad/s].
    max_generator_torque : float
        High-speed shaft [N m] (VS_MaxTq).
    max_torque_rate : float
        High-speed shaft [N m/s] (VS_MaxRat); 0 for a generator that takes no demand, a linear damper.
    generator_damping : float
        Torque over speed of a generator that is, or may run as, a linear damper, low-speed shaft [N m s/rad]; 0 if it
        cannot.
    gearbox_reverses : bool
        Whether the high-speed shaft turns against the low-speed shaft (GBRevers).
    torque_lag : float
        Time constant with which the torque follows its demand [s]; 0: at once (`wt_gym.turbines.variants`).
    losses : LossShares or None
        Losses over speed and torque; None: ``generator_efficiency`` holds everywhere.
    shaft_damper : ShaftDamper or None
        What the converter does against the torsion of the shaft.
    """

    gear_ratio: float
    gearbox_efficiency: float
    generator_efficiency: float
    generator_inertia: float
    spring: float
    damper: float
    rated_power: float
    rated_rotor_speed: float
    min_rotor_speed: float
    max_generator_torque: float
    max_torque_rate: float
    generator_damping: float = later_field(0.0)
    gearbox_reverses: bool = later_field(False)
    torque_lag: float = later_field(0.0)
    losses: LossShares | None = later_field(None)
    shaft_damper: ShaftDamper | None = later_field(None)

    @property
    def speed_ratio(self) -> float:
        """Speed of the generator against the nacelle over that of the rotor; negative where the gearbox reverses."""
        return -self.gear_ratio if self.gearbox_reverses else self.gear_ratio

    @property
    def takes_torque(self) -> bool:
        """Whether the generator takes a demand for its torque."""
        return self.max_torque_rate > 0.0

    def __post_init__(self) -> None:
        """Check the fields."""
        ranges = {
            "gear_ratio": (0.1, 1000.0),
            "gearbox_efficiency": (_LEAST_EFFICIENCY, 1.0),
            "generator_efficiency": (_LEAST_EFFICIENCY, 1.0),
            "generator_inertia": (0.0, _BIG),
            "spring": (0.0, _BIG),
            "rated_power": (0.0, 1e9),
            "rated_rotor_speed": (0.0, 1000.0),
            "max_generator_torque": (0.0, _BIG),
        }
        checked = {
            name: check_number(f"Drivetrain.{name}", getattr(self, name), low, high, open_low=True)
            for name, (low, high) in ranges.items()
        }
        for name in ("damper", "max_torque_rate", "generator_damping"):
            checked[name] = check_number(f"Drivetrain.{name}", getattr(self, name), 0.0, _BIG)
        if not (checked["max_torque_rate"] > 0.0 or checked["generator_damping"] > 0.0):
            raise fail("Drivetrain.max_torque_rate", self.max_torque_rate, "0 with a positive generator_damping only")
        checked["min_rotor_speed"] = check_number(
            "Drivetrain.min_rotor_speed", self.min_rotor_speed, 0.0, checked["rated_rotor_speed"]
        )
        if not isinstance(self.gearbox_reverses, bool):
            raise fail("Drivetrain.gearbox_reverses", self.gearbox_reverses, "True or False")
        checked["torque_lag"] = check_number("Drivetrain.torque_lag", self.torque_lag, 0.0, LONGEST_LAG)
        if checked["torque_lag"] > 0.0 and not checked["max_torque_rate"] > 0.0:
            raise fail("Drivetrain.torque_lag", self.torque_lag, "0 for a generator that takes no demand")
        if self.losses is not None and not isinstance(self.losses, LossShares):
            raise fail("Drivetrain.losses", self.losses, "LossShares or None")
        if self.shaft_damper is not None and not isinstance(self.shaft_damper, ShaftDamper):
            raise fail("Drivetrain.shaft_damper", self.shaft_damper, "ShaftDamper or None")
        if self.shaft_damper is not None and not checked["max_torque_rate"] > 0.0:
            raise fail("Drivetrain.shaft_damper", self.shaft_damper, "None for a generator that takes no demand")
        self._set(**checked)


@dataclass(frozen=True, eq=False, repr=False)
class PitchSystem(ArrayRecord):
    """Limits and bandwidth of the pitch actuators.

    Attributes
    ----------
    min_pitch, max_pitch : float
        [rad] (PC_MinPit, PC_MaxPit).
    max_rate : float
        [rad/s] (PC_MaxRat).
    servo_frequency : float or None
        Natural frequency ω of the drive as a servo behind the demand [rad/s] (ROSCO's PA_CornerFreq), θ̈ = ω² (c − θ) −
        2 ζ ω θ̇. None, the default: an ideal drive, which follows the demand at up to ``max_rate``. windIO files say
        nothing about it, and the baseline controller of the NREL 5-MW is published without dynamics of the actuators
        (NREL/TP-500-38060, section 7).
    servo_damping : float
        Damping ratio ζ of that servo (ROSCO's PA_Damping), by default 1; behind a moving demand its lag is 2 ζ/ω.
    """

    min_pitch: float
    max_pitch: float
    max_rate: float
    servo_frequency: float | None = None
    servo_damping: float = later_field(1.0)

    def __post_init__(self) -> None:
        """Check the fields."""
        low = check_number("PitchSystem.min_pitch", self.min_pitch, -np.pi / 2, np.pi)
        self._set(
            min_pitch=low,
            max_pitch=check_number("PitchSystem.max_pitch", self.max_pitch, low, np.pi, open_low=True),
            max_rate=check_number("PitchSystem.max_rate", self.max_rate, 0.0, 10.0, open_low=True),
        )
        if self.servo_frequency is not None:
            frequency = check_number("PitchSystem.servo_frequency", self.servo_frequency, 0.1, 100.0)
            self._set(servo_frequency=frequency)
        self._set(servo_damping=check_number("PitchSystem.servo_damping", self.servo_damping, 0.1, 10.0))


@dataclass(frozen=True, eq=False, repr=False)
class Turbine(ArrayRecord):
    """A complete turbine.

    Attributes
    ----------
    rotor_orientation : str
        ``"upwind"``.
    rotor_diameter : float
        [m].
    hub_height : float
        Of the apex above ground or mean sea level, undeformed [m].
    rated_wind_speed, cut_in, cut_out : float
        [m/s].
    air_density : float
        [kg/m^3].
    iec_class : str
        ``"I"`` to ``"IV"``.
    turbulence_class : str
        ``"A+"``, ``"A"``, ``"B"`` or ``"C"`` of IEC 61400-1.
    notes : tuple of str
        What the reader had to assume because the file does not say it, in plain words.
    design_air_density : float or None
        Of the air for which the turbine's controller is designed [kg/m^3], where it is not ``air_density``.
    control : ControlData or None
        Published numbers of the turbine's own controller.
    rotation : str
        Direction in which the rotor turns, seen looking downwind: ``"clockwise"`` or ``"counter-clockwise"``. Blade
        data are in the frame of the blade, z to the tip, x to the suction side, y to the trailing edge, which is
        left-handed where the rotor turns counter-clockwise (`wt_gym.turbines.variants`).
    ice : BladeIce or None
        On one of the blades.
    """

    name: str
    n_blades: int
    rotor_orientation: str
    rotor_diameter: float
    hub_height: float
    rated_wind_speed: float
    cut_in: float
    cut_out: float
    air_density: float
    blade: Blade
    tower: Tower
    hub: Hub
    nacelle: Nacelle
    drivetrain: Drivetrain
    pitch: PitchSystem
    iec_class: str
    turbulence_class: str
    notes: tuple[str, ...] = ()
    control: ControlData | None = later_field(None)
    design_air_density: float | None = later_field(None)
    rotation: str = later_field("clockwise")
    ice: BladeIce | None = later_field(None)

    def __post_init__(self) -> None:
        """Check the fields and that the parts fit together."""
        if isinstance(self.n_blades, bool) or not isinstance(self.n_blades, int) or not 1 <= self.n_blades <= 10:
            raise fail("Turbine.n_blades", self.n_blades, "an integer from 1 to 10")
        for name, allowed in (
            ("rotor_orientation", ("upwind",)),
            ("rotation", ROTATIONS),
            ("iec_class", ("I", "II", "III", "IV")),
            ("turbulence_class", ("A+", "A", "B", "C")),
        ):
            if getattr(self, name) not in allowed:
                raise fail(f"Turbine.{name}", getattr(self, name), " or ".join(map(repr, allowed)))
        if self.control is not None and not isinstance(self.control, ControlData):
            raise fail("Turbine.control", self.control, "ControlData or None")
        if self.ice is not None and not (isinstance(self.ice, BladeIce) and self.ice.blade <= self.n_blades):
            raise fail("Turbine.ice", self.ice, f"None or ice on one of the {self.n_blades} blades")
        cut_in = check_number("Turbine.cut_in", self.cut_in, 0.0, 30.0)
        rated = check_number("Turbine.rated_wind_speed", self.rated_wind_speed, cut_in, 40.0, open_low=True)
        self._set(
            rotor_diameter=check_number("Turbine.rotor_diameter", self.rotor_diameter, 0.1, 1000.0),
            hub_height=check_number("Turbine.hub_height", self.hub_height, 0.1, 1000.0),
            cut_in=cut_in,
            rated_wind_speed=rated,
            cut_out=check_number("Turbine.cut_out", self.cut_out, rated, 100.0),
            air_density=check_number("Turbine.air_density", self.air_density, 0.1, 10.0),
            notes=tuple(self.notes),
        )
        if self.design_air_density is not None:
            designed = check_number("Turbine.design_air_density", self.design_air_density, 0.1, 10.0)
            self._set(design_air_density=designed)
        for name, given, geometry in (
            ("rotor_diameter", self.rotor_diameter, self._geometric_diameter),
            ("hub_height", self.hub_height, self._geometric_hub_height),
        ):
            if abs(given - geometry) > 0.01 * geometry:
                raise fail(
                    f"Turbine.{name}", given, f"{geometry:.2f} m +- 1 %, which blade, hub, nacelle and tower give"
                )

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
        """Return this turbine at a site: another air density, other limits of the wind, another class.

        Parameters
        ----------
        **site
            See `wt_gym.turbines.model.with_site`.

        Raises
        ------
        TurbineDefinitionError
            If a name is unknown or a value out of range.
        """
        return with_site(self, site)

    @property
    def title(self) -> str:
        """Name for headings, with what is unusual about the turbine."""
        return self.name if self.rotation == "clockwise" else f"{self.name}, {self.rotation}"

    @property
    def controller_air_density(self) -> float:
        """Density of the air for which the turbine's controller is designed [kg/m^3]."""
        return self.air_density if self.design_air_density is None else self.design_air_density

    @property
    def _geometric_diameter(self) -> float:
        return 2.0 * (self.hub.radius + self.blade.length) * float(np.cos(self.hub.cone))

    @property
    def _geometric_hub_height(self) -> float:
        nacelle = self.nacelle
        return self.tower.height + nacelle.tower_top_to_shaft + nacelle.overhang * float(np.sin(nacelle.tilt))


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

    Raises
    ------
    TurbineDefinitionError
        If a name is unknown or a value out of range.

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
