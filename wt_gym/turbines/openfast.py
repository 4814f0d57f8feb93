"""Turbines from models of OpenFAST: the primary file (``.fst``) and the files that it names.

Hub, nacelle, drivetrain and pitch system of an OpenFAST model, from ElastoDyn, ServoDyn and ROSCO's DISCON.IN.

ElastoDyn counts along its shaft axis, which points downwind: an upwind rotor has a negative OverHang, its usual tilt
and cone are negative. Here all three are positive.

Keywords of an OpenFAST model that change what it does and that a turbine does not hold, for its notes.

A second reading of an OpenFAST model, by the package ``openfast_io``, to compare with.

``openfast_io`` reads lines by their number, in the format of its own release. A file of another release it refuses at
the first word where it expects a number, or reads with the numbers of lines beside.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from wt_gym.base.errors import TurbineDefinitionError
from wt_gym.turbines.checks import check_number, fail
from wt_gym.turbines.model import Blade, ControlData, Drivetrain, Hub, Nacelle, PitchSystem, Turbine
from wt_gym.turbines.openfast_blade import BladeFiles, read_openfast_blade, read_openfast_tower
from wt_gym.turbines.openfast_control import Rating, read_controllers, read_openfast_control, read_rating
from wt_gym.turbines.openfast_text import TextFile, existing_file
from wt_gym.turbines.windio_blade import KINEMATIC_VISCOSITY
from wt_gym.turbines.windio_machine import YAW_DAMPING, YAW_FREQUENCY

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

__all__ = ["compare_with_openfast_io", "read_openfast"]

_STRUCTURES = ("elastodyn", "beamdyn")
"""Modules with the structure of the blade, as CompElast (1, 2) counts them."""

CUT_IN, CUT_OUT = 3.0, 25.0
"""Where a model has none [m/s]: OpenFAST models do not say it."""

_BETZ = 16.0 / 27.0
_NOMINAL = 0.009
"""Part by which the nominal radius TipRad may exceed that of the coned rotor."""


def read_openfast(
    path: str | Path,
    rated_power: float | None = None,
    rated_rotor_speed: float | None = None,
    blade: str | None = None,
) -> Turbine:
    """Build a turbine from an OpenFAST model of any release from 2 to 5.

    Parameters
    ----------
    path : str or Path
        Primary file of the model (``.fst``).
    rated_power : float, optional
        Electrical [W], for a model that does not say it: its torque is neither by ROSCO (VSContrl 5 with a DISCON.IN)
        nor by ServoDyn's own law (VSContrl 1).
    rated_rotor_speed : float, optional
        [rad/s], likewise.
    blade : str, optional
        "elastodyn" or "beamdyn", the module whose files give the structure of the blade; by default that of CompElast.

    Returns
    -------
    Turbine
        ``notes`` lists what was assumed, and what the model has and the turbine does not hold.

    Examples
    --------
    >>> read_openfast("NREL-5MW.fst")  # doctest: +SKIP
    """
    if rated_power is not None:
        rated_power = check_number("rated_power", rated_power, 1.0, 1e9)
    if rated_rotor_speed is not None:
        rated_rotor_speed = check_number("rated_rotor_speed", rated_rotor_speed, 1e-3, 1000.0)
    if blade not in (None, *_STRUCTURES):
        raise fail("blade", blade, f"one of {', '.join(map(repr, _STRUCTURES))} or None")
    notes: list[str] = []
    primary = TextFile(Path(path))
    _require_wind_turbine(primary)
    folder = primary.path.parent
    elastodyn = TextFile(existing_file(folder, primary.text("EDFile"), "EDFile"))
    require_plain(elastodyn)
    aerodyn = TextFile(existing_file(folder, primary.text("AeroFile"), "AeroFile"), free=True)
    servodyn = None
    if primary.integer("CompServo", 0) == 1:
        servodyn = TextFile(existing_file(folder, primary.text("ServoFile"), "ServoFile"), free=True)
    discon = read_controllers(servodyn, notes)
    n_blades = elastodyn.integer("NumBl")
    gearbox = elastodyn.number("GBoxEff") / 100.0
    rating = read_rating(elastodyn, servodyn, discon, rated_power, rated_rotor_speed, notes)
    hub = read_openfast_hub(elastodyn, notes)
    structure = blade or _STRUCTURES[primary.integer("CompElast") - 1]
    files = _blade_files(primary, elastodyn, aerodyn, n_blades, structure, notes)
    length = elastodyn.number("TipRad") - hub.radius
    body = read_openfast_blade(files, length, hub.radius, rating.rotor_speed, notes)
    tower_file = TextFile(existing_file(elastodyn.path.parent, elastodyn.text("TwrFile"), "TwrFile"))
    tower = read_openfast_tower(elastodyn, tower_file, aerodyn, notes)
    nacelle = read_openfast_nacelle(elastodyn, servodyn, body, hub, n_blades, notes)
    density = _density(primary, aerodyn)
    tip = hub.radius + length
    radius = tip * float(np.cos(hub.cone))
    drivetrain = read_openfast_drivetrain(elastodyn, discon.torque, rating, notes)
    pitch = read_openfast_pitch(servodyn, discon.pitch, notes)
    control = read_openfast_control(servodyn, discon, rating, radius, density, notes)
    name_the_rest(primary, elastodyn, servodyn, aerodyn, notes)
    rotation = _rotation(primary, notes)
    notes.append(f"OpenFAST models have no cut-in and cut-out wind, {CUT_IN:g} and {CUT_OUT:g} m/s assumed")
    notes.append("OpenFAST models have no wind class, IEC class I and turbulence class B assumed")
    return Turbine(
        name=primary.path.stem,
        n_blades=n_blades,
        rotor_orientation="upwind",
        rotor_diameter=2.0 * (tip if tip - radius < _NOMINAL * radius else radius),
        hub_height=tower.height + nacelle.tower_top_to_shaft + nacelle.overhang * float(np.sin(nacelle.tilt)),
        rated_wind_speed=_rated_wind(rating, gearbox, control, radius, density, notes),
        cut_in=CUT_IN,
        cut_out=CUT_OUT,
        air_density=density,
        blade=body,
        tower=tower,
        hub=hub,
        nacelle=nacelle,
        drivetrain=drivetrain,
        pitch=pitch,
        iec_class="I",
        turbulence_class="B",
        notes=tuple(notes),
        control=control,
        rotation=rotation,
    )


def _rotation(primary: TextFile, notes: list[str]) -> str:
    """Return the direction in which the rotor turns: files of blades describe the clockwise one in any case."""
    if "MirrorRotor" not in primary or not primary.flag("MirrorRotor"):
        return "clockwise"
    notes.append("MirrorRotor: True, the rotor turns counter-clockwise; OpenFAST 5.0 reads this flag without using it")
    return "counter-clockwise"


def _require_wind_turbine(file: TextFile) -> None:
    """Refuse models of other machines, and of parts of one."""
    if "EDFile" not in file:
        raise TurbineDefinitionError(f"{file.path.name}: EDFile: missing; is this the primary file of OpenFAST (.fst)?")
    if "MHK" in file and file.text("MHK").lower() not in ("0", "false", "f"):
        raise file.fail("MHK", file.text("MHK"), "0 (turbines in water are not modeled)")
    if "NRotors" in file and file.integer("NRotors") != 1:
        raise file.fail("NRotors", file.integer("NRotors"), "1")
    if file.integer("CompElast") not in (1, 2):
        allowed = "1 or 2 (Simplified-ElastoDyn has no flexible blades and tower)"
        raise file.fail("CompElast", file.integer("CompElast"), allowed)
    if file.integer("CompAero") != 2:
        raise file.fail("CompAero", file.integer("CompAero"), "2 (blade and polars are read from AeroDyn 15)")


def _blade_files(
    primary: TextFile, elastodyn: TextFile, aerodyn: TextFile, n_blades: int, structure: str, notes: list[str]
) -> BladeFiles:
    """Open the files of the blade, whose structure is that of ElastoDyn or BeamDyn."""
    numbers = range(1, n_blades + 1)
    aero = blade_file(aerodyn, [f"ADBlFile({i})" for i in numbers])
    fluid = primary if aerodyn.is_default("KinVisc") else aerodyn
    viscosity = KINEMATIC_VISCOSITY if fluid.is_default("KinVisc") else fluid.number("KinVisc")
    viscosity = check_number(f"{fluid.path.name}: KinVisc", viscosity, 1e-8, 1e-2)
    elastic_path = elastodyn.path.parent / elastodyn.text("BldFile(1)").replace("\\", "/")
    if structure == "elastodyn":
        elastic = blade_file(elastodyn, [f"BldFile({i})" for i in numbers], free=True)
        if "BDBldFile(1)" in primary and (primary.path.parent / primary.text("BDBldFile(1)")).is_file():
            notes.append("blade: sections of ElastoDyn; BeamDyn's, which the model has too, are left aside")
        return BladeFiles(elastic, None, None, aerodyn, aero, viscosity)
    beam = blade_file(primary, [f"BDBldFile({i})" for i in numbers], within="BldFile")
    sections = TextFile(existing_file(beam.path.parent, beam.text("BldFile"), f"{beam.path.name}: BldFile"))
    elastic_file = TextFile(elastic_path, free=True) if elastic_path.is_file() else None
    if elastic_file is not None:
        notes.append(f"blade: sections of BeamDyn ({sections.path.name}), not those of {elastic_file.path.name}")
    return BladeFiles(elastic_file, beam, sections, aerodyn, aero, viscosity)


def _density(primary: TextFile, aerodyn: TextFile) -> float:
    """Return the density of the air; before OpenFAST 3 it stood in AeroDyn's file only."""
    file = primary if aerodyn.is_default("AirDens") else aerodyn
    return check_number(f"{file.path.name}: AirDens", file.number("AirDens"), 0.1, 10.0)


def _rated_wind(
    rating: Rating, gearbox: float, control: ControlData | None, radius: float, density: float, notes: list[str]
) -> float:
    """Return the wind at which the rotor has rated power at its largest power coefficient [m/s].

    The rotor gives what the generator takes and what the gearbox of efficiency ``gearbox`` loses.
    """
    cp = None if control is None else control.peak_power_coefficient
    if cp is None:
        cp = 0.8 * _BETZ
        how = f"with a power coefficient of {cp:.3f} (0.8 of Betz's), which the model does not say"
    else:
        how = f"with the power coefficient {cp:.3f} of the controller's data"
    wind = (rating.mechanical_power / gearbox / (0.5 * density * np.pi * radius**2 * cp)) ** (1.0 / 3.0)
    notes.append(f"rated wind speed: {wind:.2f} m/s is where the rotor reaches rated power {how}")
    return float(wind)


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
    """Build the drivetrain; limits of the torque come from a DISCON.IN of ROSCO that controls it."""
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
    """Build the limits of the pitch system, from the DISCON.IN that controls it or the Bladed interface of ServoDyn."""
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
    """Refuse what ElastoDyn's primary file has and would make another turbine here."""
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


_GRAVITY = 9.80665
_SAME_GRAVITY = 0.01
"""Difference in which models differ by rounding or by their site [m/s^2]."""
_LONGEST = 9000.0
"""Times of events [s] and cut-off frequencies [Hz] from which on they stand for never (9999.9 in most models)."""

_INITIAL = (
    "OoPDefl", "IPDefl", "BlPitch(1)", "BlPitch(2)", "BlPitch(3)", "Azimuth", "RotSpeed", "NacYaw", "TTDspFA",
    "TTDspSS", "PtfmSurge", "PtfmSway", "PtfmHeave", "PtfmRoll", "PtfmPitch", "PtfmYaw",
)  # fmt: skip
_BLADE_MODES = ("FlapDOF1", "FlapDOF2", "EdgeDOF")
_PLATFORM = ("PtfmSgDOF", "PtfmSwDOF", "PtfmHvDOF", "PtfmRDOF", "PtfmPDOF", "PtfmYDOF")
_SUPPORT = {
    "CompSeaSt": "waves",
    "CompHydro": "loads of the water",
    "CompSub": "the substructure",
    "CompMooring": "the mooring",
    "CompIce": "ice",
    "CompSoil": "the soil",
}

# file, what the keywords are, keywords with the value that changes nothing
_GROUPS: tuple[tuple[str, str, Mapping[str, float | bool]], ...] = (
    ("elastodyn", "initial conditions; runs start from a steady state", dict.fromkeys(_INITIAL, 0.0)),
    (
        "elastodyn",
        "motions that the model fixes and that are free here",
        dict.fromkeys(("TwFADOF1", "TwFADOF2", "TwSSDOF1", "TwSSDOF2", "GenDOF", "YawDOF"), True),
    ),
    (
        "elastodyn",
        "places of sensors and reference of the azimuth",
        dict.fromkeys(("NcIMUxn", "NcIMUyn", "NcIMUzn", "ShftGagL", "AzimB1Up"), 0.0),
    ),
    (
        "elastodyn",
        "inertias of pitch bearing and blade about the pitch axis",
        {f"{key}({i})": 0.0 for key in ("PBrIner", "BlPIner") for i in (1, 2, 3)},
    ),
    ("elastodyn", "friction of the yaw bearing", {"YawFrctMod": 0.0}),
    ("elastodyn", "a gearbox that reverses the direction", {"GBRevers": False}),
    ("elastodyn", "pitch bearings that turn on springs; drives turn the blades here", {"PitchDOF": False}),
    ("servodyn", "neutral position of the yaw spring, which is 0 here", {"YawNeut": 0.0}),
    ("servodyn", "neutral positions of the pitch springs", {f"PitNeut({i})": 0.0 for i in (1, 2, 3)}),
    ("servodyn", "reference of the nacelle's yaw angle", {"NacYaw_North": 0.0}),
    ("servodyn", "yaw control", {"YCMode": 0.0}),
    ("servodyn", "start and stop of the generator by its speed and power", {"GenTiStr": True, "GenTiStp": True}),
    ("servodyn", "control of the flow over the airfoils", {"AfCmode": 0.0}),
    ("servodyn", "control of cables", {"CCmode": 0.0}),
    ("servodyn", "structural dampers of the blades", {"NumBStC": 0.0}),
    ("servodyn", "structural dampers of the nacelle", {"NumNStC": 0.0}),
    ("servodyn", "structural dampers of the tower", {"NumTStC": 0.0}),
    ("servodyn", "structural dampers of the substructure", {"NumSStC": 0.0}),
    ("servodyn", "mass dampers of nacelle and tower", {"CompNTMD": False, "CompTTMD": False}),  # up to OpenFAST 2
    ("aerodyn", "the tail fin", {"TFinAero": False}),
    ("aerodyn", "the drag of the nacelle", {"NacelleDrag": False}),
    ("aerodyn", "buoyancy", {"Buoyancy": False}),
)
_DELAYS = ("TPCOn", "TimGenOn")
"""Times at which what runs here from the beginning starts."""
_EVENTS = ("TPitManS(1)", "TPitManS(2)", "TPitManS(3)", "TimGenOf", "THSSBrDp", "TYawManS")
_AERODYNAMICS = (
    "Wake_Mod", "WakeMod", "BEM_Mod", "AFAeroMod", "UA_Mod", "UAMod", "DBEMT_Mod", "Skew_Mod", "SkewMod", "TwrPotent",
    "TwrShadow", "TipLoss", "HubLoss", "TanInd", "AIDrag", "TIDrag", "SectAvg", "AoA34",
)  # fmt: skip
_CONTROL_MODES = {
    "PCMode": {0: "the model holds the pitch (BlPitch); here a controller moves the blades"},
    "VSContrl": {0: "the model's generator has no control of its speed; here a controller gives its torque"},
}
_ROUTINES = "control by a routine of the user is left aside"


def name_the_rest(
    primary: TextFile, elastodyn: TextFile, servodyn: TextFile | None, aerodyn: TextFile, notes: list[str]
) -> None:
    """Note what the model has and the turbine does not hold."""
    left = [f"{what} ({key})" for key, what in _SUPPORT.items() if primary.integer(key, 0) != 0]
    if any(elastodyn.flag(key) for key in _PLATFORM):
        left.append("the motion of the platform")
    if left:
        base = elastodyn.number("TowerBsHt")
        notes.append(f"left aside: {', '.join(left)}; the tower is clamped at its base, {base:g} m up")
    files = {"elastodyn": elastodyn, "servodyn": servodyn, "aerodyn": aerodyn}
    for name, words, neutral in _GROUPS:
        _note(files[name], words, neutral, notes)
    if primary.integer("CompElast") == 1:  # BeamDyn's blade has no such modes
        _note(elastodyn, "modes that the model fixes and that are free here", dict.fromkeys(_BLADE_MODES, True), notes)
    gravity = primary if "Gravity" in primary else elastodyn  # up to OpenFAST 2
    if abs(gravity.number("Gravity", _GRAVITY) - _GRAVITY) > _SAME_GRAVITY:
        notes.append(f"left aside: Gravity {gravity.number('Gravity'):g} m/s^2; here it is {_GRAVITY} m/s^2")
    models = ", ".join(f"{key} {aerodyn.text(key)}" for key in _AERODYNAMICS if key in aerodyn)
    if models:
        notes.append(f"{aerodyn.path.name}: left aside: AeroDyn's models; those of this package act here ({models})")
    if servodyn is not None:
        _name_control(servodyn, notes)


def _note(file: TextFile | None, words: str, neutral: Mapping[str, float | bool], notes: list[str]) -> None:
    """Note the keywords of a file that do not have their neutral values."""
    if file is None:
        return
    active = [key for key, value in neutral.items() if key in file and _value(file, key, value) != value]
    if active:
        given = ", ".join(f"{key} {file.text(key)}" for key in active)
        notes.append(f"{file.path.name}: left aside: {words} ({given})")


def _value(file: TextFile, key: str, like: float | bool) -> float | bool:
    return file.flag(key) if isinstance(like, bool) else file.number(key)


def _name_control(servodyn: TextFile, notes: list[str]) -> None:
    """Note control modes that are not those of a turbine here, and events of the simulation."""
    for key, words in _CONTROL_MODES.items():
        mode = servodyn.integer(key, 5)
        if mode in words:
            notes.append(f"{servodyn.path.name}: {key} {mode}: {words[mode]}")
        elif mode in (3, 4):
            notes.append(f"{servodyn.path.name}: {key} {mode}: {_ROUTINES}")
    events = [key for key in _EVENTS if key in servodyn and servodyn.number(key) < _LONGEST]
    events += [key for key in _DELAYS if key in servodyn and servodyn.number(key) > 0.0]
    if events:
        given = ", ".join(f"{key} {servodyn.text(key)} s" for key in events)
        notes.append(f"{servodyn.path.name}: left aside: events of the simulation ({given})")
    if servodyn.number("BPCutoff", _LONGEST) < _LONGEST:
        notes.append(f"{servodyn.path.name}: left aside: a filter of the demanded pitch (BPCutoff)")


_REFUSALS = (ValueError, IndexError, KeyError, TypeError, AttributeError, OSError)
"""What its reader raises where a line is not what it expects."""
_SHOWN = 3
_ROUNDING = 1e-9


def compare_with_openfast_io(path: str | Path) -> list[str]:
    """Read the primary files of a model with ``openfast_io``, and compare each number with that beside its keyword.

    Parameters
    ----------
    path : str or Path
        Primary file (``.fst``).

    Returns
    -------
    list of str
        One line for each module: how many numbers agree, which do not, or where the package stops.

    Raises
    ------
    ModuleNotFoundError
        If the package is not installed (extra ``openfast``).
    """
    import openfast_io  # noqa: F401 - fails by the name of the package where it is missing
    from openfast_io.FAST_reader import InputReader_OpenFAST

    primary = TextFile(Path(path))
    folder = primary.path.parent
    reader = InputReader_OpenFAST()
    reader.FAST_InputFile, reader.FAST_directory = primary.path.name, str(folder)
    elastodyn = TextFile(existing_file(folder, primary.text("EDFile"), "EDFile"))
    tower = TextFile(existing_file(elastodyn.path.parent, elastodyn.text("TwrFile"), "TwrFile"))
    lines = [
        _comparison("Fst", reader, reader.read_MainInput, primary),
        _comparison("ElastoDyn", reader, lambda: reader.read_ElastoDyn(str(elastodyn.path)), elastodyn),
        _comparison("ElastoDynTower", reader, lambda: reader.read_ElastoDynTower(str(tower.path)), tower),
    ]
    for module, key, read in (
        ("AeroDyn", "AeroFile", reader.read_AeroDyn),
        ("ServoDyn", "ServoFile", reader.read_ServoDyn),
    ):
        file = TextFile(existing_file(folder, primary.text(key), key))
        _name_the_file(reader, key, primary.text(key))
        lines.append(_comparison(module, reader, read, file))
    return lines


def _name_the_file(reader: Any, key: str, name: str) -> None:
    """Give the reader the path of a file, which it has not where it stopped before in the primary file."""
    reader.fst_vt["Fst"].setdefault(key, name)
    reader.fst_vt["Fst"].setdefault(f"{key}_path", str(Path(name).parent))


def _comparison(module: str, reader: Any, read: Callable[[], None], file: TextFile) -> str:
    stop = ""
    try:
        read()
    except _REFUSALS as error:
        stop = f"; it stops with {type(error).__name__}: {str(error)[:80]}"
    same, other = 0, []
    for key, value in reader.fst_vt[module].items():
        if not isinstance(value, (bool, int, float)) or key not in file:
            continue
        expected = _number_or_flag(file, key)
        if expected is None:
            continue
        if abs(float(value) - expected) <= _ROUNDING * max(abs(expected), 1.0):
            same += 1
        else:
            other.append(f"{key} {value:g} instead of {expected:g}")
    shown = [*other[:_SHOWN], *(["..."] if len(other) > _SHOWN else [])]
    differ = f"; {len(other)} differ: {', '.join(shown)}" if other else ""
    return f"openfast_io, {module} ({file.path.name}): {same} numbers agree{differ}{stop}"


def _number_or_flag(file: TextFile, key: str) -> float | None:
    """Return the number or flag beside a keyword, None for a word."""
    word = file.text(key)
    if word.lower() in ("true", "t", "false", "f"):
        return float(word.lower().startswith("t"))
    try:
        return float(word)
    except ValueError:
        return None
