"""Hub, nacelle, drivetrain and pitch system of an OpenFAST model, from ElastoDyn, ServoDyn and ROSCO's DISCON.IN.

ElastoDyn counts along its shaft axis, which points downwind: an upwind rotor has a negative OverHang, its usual tilt
and cone are negative. Here all three are positive.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from wt_gym.base.errors import TurbineDefinitionError
from wt_gym.turbines.checks import fail
from wt_gym.turbines.model import Blade, Drivetrain, Hub, Nacelle, PitchSystem
from wt_gym.turbines.openfast_control import Rating
from wt_gym.turbines.openfast_text import TextFile, existing_file
from wt_gym.turbines.windio_nacelle import YAW_DAMPING, YAW_FREQUENCY

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import NDArray

__all__ = [
    "blade_file",
    "read_openfast_drivetrain",
    "read_openfast_hub",
    "read_openfast_nacelle",
    "read_openfast_pitch",
    "require_plain",
]

_DEGREE = np.pi / 180.0
_RATE = 0.3 * _DEGREE
"""Yaw rate of the NREL 5-MW [rad/s], where a model has none."""
_TORQUE_MARGIN = 1.1
_TORQUE_TIME = 3.0
"""In which a torque rate that no file gives runs through the rated torque [s], about that of the NREL 5-MW."""
_RIGID_SHAFT = 1e15
"""Stiffness [N m/rad] with which the shaft of any turbine is stiffer than what a simulation lets twist."""
_PITCH_RATE = 8.0 * _DEGREE
"""Of the NREL 5-MW [rad/s]."""


def read_openfast_hub(file: TextFile, notes: list[str]) -> Hub:
    """Build the hub.

    Raises
    ------
    TurbineDefinitionError
        If blades have different cones, or a number is missing or out of range.
    """
    n = file.integer("NumBl")
    cones = [file.number(f"PreCone({i + 1})") for i in range(n)]
    if max(cones) - min(cones) > 1e-6:
        raise file.fail("PreCone", cones, "the same cone for all blades")
    axial = transverse = file.number("HubIner")
    if n == 2:
        notes.append(f"{file.path.name}: HubIner is that about the teeter axis, the same is used about the shaft")
    else:
        given = file.number("HubIner_Teeter", 0.0)
        transverse = given or axial
        if not given:
            notes.append(f"{file.path.name}: HubIner is that about the shaft, the same is used across it")
    return Hub(
        radius=file.number("HubRad"),
        cone=-_DEGREE * cones[0] or 0.0,
        mass=file.number("HubMass"),
        inertia_axial=axial,
        inertia_transverse=transverse,
        cm_offset_along_shaft=file.number("HubCM"),
    )


def read_openfast_nacelle(
    file: TextFile, servodyn: TextFile | None, blade: Blade, hub: Hub, n_blades: int, notes: list[str]
) -> Nacelle:
    """Build the nacelle.

    ElastoDyn's nacelle has an inertia about the yaw axis only. The others are those of a homogeneous box with this
    inertia whose cross-section is a square that stands on the tower top.

    Raises
    ------
    TurbineDefinitionError
        For a rotor that runs downwind, an inertia that the place of the mass contradicts, or a missing number.
    """
    overhang = file.number("OverHang")
    if overhang >= 0.0:
        raise file.fail("OverHang", overhang, "a negative number: an upwind rotor (others are not modeled)")
    mass = file.number("NacMass")
    cm = np.array([file.number(key) for key in ("NacCMxn", "NacCMyn", "NacCMzn")])
    vertical = file.number("NacYIner") - mass * float(cm[0] ** 2 + cm[1] ** 2)
    if vertical < -1e-6 * max(file.number("NacYIner"), 1.0):
        least = mass * float(cm[0] ** 2 + cm[1] ** 2)
        raise file.fail("NacYIner", file.number("NacYIner"), f"at least NacMass (NacCMxn^2 + NacCMyn^2) = {least:g}")
    vertical = max(vertical, 0.0)
    roll = min(mass * (2.0 * float(cm[2])) ** 2 / 6.0, vertical)
    notes.append(
        f"{file.path.name}: NacYIner is about the yaw axis; roll {roll:.4g} and pitch {vertical:.4g} kg m^2 of the "
        "nacelle are those of a box on the tower top with this yaw inertia"
    )
    tilt = -_DEGREE * file.number("ShftTilt") or 0.0
    spring, damper, rate = _yaw(servodyn, vertical, mass, cm, blade, hub, n_blades, -overhang, notes)
    return Nacelle(
        mass=mass,
        cm=cm,
        inertia=np.diag([roll, vertical, vertical]),
        tilt=tilt,
        overhang=-overhang,
        tower_top_to_shaft=file.number("Twr2Shft"),
        yaw_bearing_mass=file.number("YawBrMass"),
        yaw_spring=spring,
        yaw_damper=damper,
        max_yaw_rate=rate,
    )


def _yaw(
    servodyn: TextFile | None,
    vertical: float,
    mass: float,
    cm: NDArray[np.float64],
    blade: Blade,
    hub: Hub,
    n_blades: int,
    overhang: float,
    notes: list[str],
) -> tuple[float, float, float]:
    """Return spring, damper and largest rate of the yaw actuator."""
    rate = _RATE
    if servodyn is not None and servodyn.number("YawManRat", 0.0) > 0.0:
        rate = min(_DEGREE * servodyn.number("YawManRat"), 1.0)
    else:
        notes.append("YawManRat: not in the model, 0.3 deg/s assumed")
    if servodyn is not None and servodyn.number("YawSpr", 0.0) > 0.0:
        return servodyn.number("YawSpr"), servodyn.number("YawDamp", 0.0), rate
    m0, m1, m2 = (blade.structure.mass_moment(k) for k in range(3))
    rotor = 0.5 * n_blades * (m2 + 2.0 * hub.radius * m1 + hub.radius**2 * m0) + hub.inertia_transverse
    inertia = vertical + mass * float(cm[0] ** 2 + cm[1] ** 2) + rotor + (n_blades * m0 + hub.mass) * overhang**2
    omega = 2.0 * np.pi * YAW_FREQUENCY
    notes.append("YawSpr: not in the model, a yaw actuator with 3 Hz and 2 % damping is assumed")
    return inertia * omega**2, 2.0 * YAW_DAMPING * inertia * omega, rate


def read_openfast_drivetrain(file: TextFile, discon: TextFile | None, rating: Rating, notes: list[str]) -> Drivetrain:
    """Build the drivetrain; limits of the torque come from a DISCON.IN of ROSCO that controls it.

    Raises
    ------
    TurbineDefinitionError
        If a number is missing or out of range.
    """
    ratio = rating.gear_ratio
    gear = file.number("GBoxEff") / 100.0
    rated_torque = rating.mechanical_power / (rating.rotor_speed * ratio)
    spring = _shaft_spring(file, notes)
    most, rate = _TORQUE_MARGIN * rated_torque, rated_torque / _TORQUE_TIME
    if discon is not None and "VS_MaxTq" in discon:
        most = discon.number("VS_MaxTq")
    else:
        notes.append("VS_MaxTq: not in the model, 110 % of the rated torque assumed")
    if discon is not None and "VS_MaxRat" in discon:
        rate = discon.number("VS_MaxRat")
    else:
        notes.append("VS_MaxRat: not in the model, a third of the rated torque per second assumed")
    slowest = 0.0
    if discon is not None and "VS_MinOMSpd" in discon:
        slowest = min(discon.number("VS_MinOMSpd") / ratio, rating.rotor_speed)
    else:
        notes.append("VS_MinOMSpd: not in the model, a least rotor speed of 0 assumed")
    return Drivetrain(
        gear_ratio=ratio,
        gearbox_efficiency=gear,
        generator_efficiency=rating.generator_efficiency,
        generator_inertia=file.number("GenIner"),
        spring=spring,
        damper=file.number("DTTorDmp"),
        rated_power=rating.power,
        rated_rotor_speed=rating.rotor_speed,
        min_rotor_speed=slowest,
        max_generator_torque=most,
        max_torque_rate=rate,
    )


def _shaft_spring(file: TextFile, notes: list[str]) -> float:
    """Return the torsional stiffness of the shaft [N m/rad]."""
    spring = file.number("DTTorSpr")
    if spring < 0.0:
        raise file.fail("DTTorSpr", spring, "a number of at least 0")
    if file.flag("DrTrDOF", True):
        if spring == 0.0:
            raise file.fail(
                "DTTorSpr", spring, "a number above 0 with DrTrDOF True: rotor and generator are not connected"
            )
        return spring
    words = "twists by DTTorSpr" if spring > 0.0 else "is rigid (DTTorSpr 0)"
    notes.append(f"{file.path.name}: DrTrDOF is False; the shaft {words} here")
    return spring or _RIGID_SHAFT


def read_openfast_pitch(servodyn: TextFile | None, discon: TextFile | None, notes: list[str]) -> PitchSystem:
    """Build the limits of the pitch system, from the DISCON.IN that controls it or the Bladed interface of ServoDyn.

    Raises
    ------
    TurbineDefinitionError
        If limits contradict each other.
    """
    if discon is not None and all(key in discon for key in ("PC_MinPit", "PC_MaxPit", "PC_MaxRat")):
        frequency, damping = None, 1.0
        if "PA_Mode" in discon and discon.integer("PA_Mode") > 0:
            frequency = discon.number("PA_CornerFreq")
            if discon.integer("PA_Mode") == 2:
                damping = discon.number("PA_Damping")
            else:
                notes.append(f"{discon.path.name}: the pitch drive is critically damped here, with PA_CornerFreq")
        low, high = discon.number("PC_MinPit"), discon.number("PC_MaxPit")
        return PitchSystem(low, high, discon.number("PC_MaxRat"), frequency, damping)
    if servodyn is not None and servodyn.number("Ptch_Max", 0.0) > servodyn.number("Ptch_Min", 0.0):
        low, high, rate = (_DEGREE * servodyn.number(key) for key in ("Ptch_Min", "Ptch_Max", "PtchRate_Max"))
        if rate > 0.0:
            notes.append(f"{servodyn.path.name}: limits of the pitch from Ptch_Min, Ptch_Max and PtchRate_Max")
            return PitchSystem(low, high, rate)
    notes.append("limits of the pitch: not in the model, 0 to 90 deg at up to 8 deg/s assumed")
    return PitchSystem(0.0, 0.5 * np.pi, _PITCH_RATE)


def require_plain(file: TextFile) -> None:
    """Refuse what ElastoDyn's primary file has and would make another turbine here.

    Raises
    ------
    TurbineDefinitionError
        Naming the keyword.
    """
    for i in range(file.integer("NumBl")):
        key = f"TipMass({i + 1})"
        if file.number(key, 0.0) != 0.0:
            raise file.fail(key, file.number(key), "0 (masses at the blade tips are not modeled)")
    if file.integer("NumBl") == 2 and file.flag("TeetDOF"):
        raise file.fail("TeetDOF", True, "False (hubs that teeter are not modeled)")
    if file.integer("NumBl") == 2 and abs(file.number("UndSling", 0.0)) > 0.0:
        raise file.fail("UndSling", file.number("UndSling"), "0")
    if file.flag("Furling"):
        raise file.fail("Furling", True, "False (rotors and tails that furl are not modeled)")


def blade_file(file: TextFile, keys: list[str], free: bool = False, within: str = "") -> TextFile:
    """Open the file that all keywords name, or the first of several that are copies of each other.

    Parameters
    ----------
    file : TextFile
        That has the keywords.
    keys : list of str
        One for each blade.
    free : bool
        As of `TextFile`.
    within : str
        Keyword of these files that names another one, whose copies are copies too.

    Raises
    ------
    TurbineDefinitionError
        If there is no such file, or blades differ.
    """
    names = [file.text(key) for key in keys if key in file]
    if not names:
        raise TurbineDefinitionError(f"{file.path.name}: {keys[0]}: missing, no line has this keyword")
    first = TextFile(existing_file(file.path.parent, names[0], keys[0]), free)
    for name in dict.fromkeys(names[1:]):
        if name != names[0] and not _is_copy(first, file.path.parent / name.replace("\\", "/"), free, within):
            allowed = "the same file for all blades, or copies of it"
            raise fail(f"{file.path.name}: {', '.join(keys)}", names, allowed)
    return first


def _is_copy(first: TextFile, path: Path, free: bool, within: str) -> bool:
    """Return whether a file has the same words below its titles, and so the file that ``within`` names there."""
    if not path.is_file():
        return False
    other = TextFile(path, free)
    if first.words(within) != other.words(within):
        return False
    if not within:
        return True
    one, two = (existing_file(file.path.parent, file.text(within), within) for file in (first, other))
    return _is_copy(TextFile(one), two, False, "")
