"""Turbines from models of OpenFAST: the primary file (``.fst``) and the files that it names."""

from pathlib import Path

import numpy as np

from wt_gym.errors import TurbineDefinitionError
from wt_gym.turbines.checks import check_number, fail
from wt_gym.turbines.control_data import ControlData
from wt_gym.turbines.model import Turbine
from wt_gym.turbines.openfast_blade import BladeFiles, read_openfast_blade
from wt_gym.turbines.openfast_control import Rating, read_openfast_control, read_rating
from wt_gym.turbines.openfast_nacelle import (
    blade_files,
    read_openfast_drivetrain,
    read_openfast_hub,
    read_openfast_nacelle,
    read_openfast_pitch,
    require_plain,
)
from wt_gym.turbines.openfast_text import TextFile, existing_file
from wt_gym.turbines.openfast_tower import read_openfast_tower

__all__ = ["read_openfast"]

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
        Electrical [W], for a model that does not say it (without ROSCO's DISCON.IN and ServoDyn's VS_RtTq).
    rated_rotor_speed : float, optional
        [rad/s], likewise.
    blade : str, optional
        "elastodyn" or "beamdyn", the module whose files give the structure of the blade; by default that of CompElast.

    Returns
    -------
    Turbine
        ``notes`` lists what was assumed, and what the model has and the turbine does not hold.

    Raises
    ------
    TurbineDefinitionError
        Naming file and keyword of what is missing, inconsistent, out of range, or would make another turbine here: a
        downwind rotor, blades that differ, teeter, furling, tip masses, water turbines.

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
    aerodyn = TextFile(existing_file(folder, primary.text("AeroFile"), "AeroFile"))
    servodyn = None
    if primary.integer("CompServo", 0) == 1:
        servodyn = TextFile(existing_file(folder, primary.text("ServoFile"), "ServoFile"))
    discon = _discon(servodyn, notes)
    n_blades = elastodyn.integer("NumBl")
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
    drivetrain = read_openfast_drivetrain(elastodyn, servodyn, discon, rating, notes)
    pitch = read_openfast_pitch(servodyn, discon, notes)
    control = read_openfast_control(servodyn, discon, rating, radius, density, notes)
    _name_the_rest(primary, elastodyn, servodyn, aerodyn, notes)
    rotation = _rotation(primary, notes)
    notes.append(f"OpenFAST models have no cut-in and cut-out wind, {CUT_IN:g} and {CUT_OUT:g} m/s assumed")
    notes.append("OpenFAST models have no wind class, IEC class I and turbulence class B assumed")
    return Turbine(
        name=primary.path.stem,
        n_blades=n_blades,
        rotor_orientation="upwind",
        rotor_diameter=2.0 * (tip if tip - radius < _NOMINAL * radius else radius),
        hub_height=tower.height + nacelle.tower_top_to_shaft + nacelle.overhang * float(np.sin(nacelle.tilt)),
        rated_wind_speed=_rated_wind(rating, control, radius, density, notes),
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


def _discon(servodyn: TextFile | None, notes: list[str]) -> TextFile | None:
    """Return ROSCO's parameter file if ServoDyn names one."""
    if servodyn is None:
        notes.append("CompServo: 0, the model has no controller")
        return None
    if servodyn.integer("PCMode", 0) != 5 and servodyn.integer("VSContrl", 0) != 5:
        return None
    name = servodyn.text("DLL_InFile").replace("\\", "/")
    path = servodyn.path.parent / name
    if not path.is_file():
        notes.append(f"{servodyn.path.name}: DLL_InFile {name}: there is no such file, gains are not known")
        return None
    file = TextFile(path, comment="!")
    if "VS_RtPwr" not in file or "PC_GS_angles" not in file:
        notes.append(f"{path.name}: not a DISCON.IN of ROSCO, gains are not known")
        return None
    return file


def _blade_files(
    primary: TextFile, elastodyn: TextFile, aerodyn: TextFile, n_blades: int, structure: str, notes: list[str]
) -> BladeFiles:
    """Open the files of the blade, whose structure is that of ElastoDyn or BeamDyn."""
    numbers = range(1, n_blades + 1)
    name = blade_files(aerodyn, [f"ADBlFile({i})" for i in numbers])
    aero = TextFile(existing_file(aerodyn.path.parent, name, "ADBlFile(1)"))
    elastic_path = elastodyn.path.parent / elastodyn.text("BldFile(1)").replace("\\", "/")
    if structure == "elastodyn":
        name = blade_files(elastodyn, [f"BldFile({i})" for i in numbers])
        elastic = TextFile(existing_file(elastodyn.path.parent, name, "BldFile(1)"))
        if "BDBldFile(1)" in primary and (primary.path.parent / primary.text("BDBldFile(1)")).is_file():
            notes.append("blade: sections of ElastoDyn; BeamDyn's, which the model has too, are left aside")
        return BladeFiles(elastic, None, None, aerodyn, aero)
    name = blade_files(primary, [f"BDBldFile({i})" for i in numbers])
    beam = TextFile(existing_file(primary.path.parent, name, "BDBldFile(1)"))
    sections = TextFile(existing_file(beam.path.parent, beam.text("BldFile"), f"{beam.path.name}: BldFile"))
    elastic_file = TextFile(elastic_path) if elastic_path.is_file() else None
    if elastic_file is not None:
        notes.append(f"blade: sections of BeamDyn ({sections.path.name}), not those of {elastic_file.path.name}")
    return BladeFiles(elastic_file, beam, sections, aerodyn, aero)


def _density(primary: TextFile, aerodyn: TextFile) -> float:
    """Return the density of the air; before OpenFAST 3 it stood in AeroDyn's file only."""
    file = primary if aerodyn.is_default("AirDens") else aerodyn
    return check_number(f"{file.path.name}: AirDens", file.number("AirDens"), 0.1, 10.0)


def _rated_wind(rating: Rating, control: ControlData | None, radius: float, density: float, notes: list[str]) -> float:
    """Return the wind at which the rotor has rated power at its largest power coefficient [m/s]."""
    cp = None if control is None else control.peak_power_coefficient
    if cp is None:
        cp = 0.8 * _BETZ
        how = f"with a power coefficient of {cp:.3f} (0.8 of Betz's), which the model does not say"
    else:
        how = f"with the power coefficient {cp:.3f} of the controller's data"
    wind = (rating.mechanical_power / (0.5 * density * np.pi * radius**2 * cp)) ** (1.0 / 3.0)
    notes.append(f"rated wind speed: {wind:.2f} m/s is where the rotor reaches rated power {how}")
    return float(wind)


_SUPPORT = {
    "CompHydro": "loads of the water",
    "CompSub": "the substructure",
    "CompMooring": "the mooring",
    "CompIce": "ice",
    "CompSoil": "the soil",
}
_PLATFORM = ("PtfmSgDOF", "PtfmSwDOF", "PtfmHvDOF", "PtfmRDOF", "PtfmPDOF", "PtfmYDOF")
_DAMPERS = {"NumBStC": "blades", "NumNStC": "nacelle", "NumTStC": "tower", "NumSStC": "substructure"}


def _name_the_rest(
    primary: TextFile, elastodyn: TextFile, servodyn: TextFile | None, aerodyn: TextFile, notes: list[str]
) -> None:
    """Note what the model has and the turbine does not hold."""
    left = [f"{what} ({key})" for key, what in _SUPPORT.items() if primary.integer(key, 0) != 0]
    if any(elastodyn.flag(key) for key in _PLATFORM):
        left.append("the motion of the platform")
    if left:
        base = elastodyn.number("TowerBsHt")
        notes.append(f"left aside: {', '.join(left)}; the tower is clamped at its base, {base:g} m up")
    for number, where in _DAMPERS.items():
        if servodyn is not None and servodyn.integer(number, 0) > 0:
            notes.append(f"left aside: {servodyn.integer(number)} structural dampers of the {where} ({number})")
    for key, where in (("CompNTMD", "nacelle"), ("CompTTMD", "tower")):  # up to OpenFAST 2
        if servodyn is not None and servodyn.flag(key):
            notes.append(f"left aside: the mass damper of the {where} ({key})")
    if aerodyn.flag("TFinAero"):
        notes.append("left aside: the tail fin (TFinAero)")
    if aerodyn.flag("NacelleDrag"):
        notes.append("left aside: the drag of the nacelle (NacelleDrag)")
    if elastodyn.number("PBrIner(1)", 0.0) or elastodyn.number("BlPIner(1)", 0.0):
        notes.append("left aside: inertias of pitch bearing and blade about the pitch axis (PBrIner, BlPIner)")
    if elastodyn.integer("YawFrctMod", 0) != 0:
        notes.append("left aside: friction of the yaw bearing (YawFrctMod)")
    if primary.number("Gravity", 9.80665) < 9.0:
        notes.append(f"left aside: Gravity {primary.number('Gravity'):g} m/s^2; here it is 9.80665 m/s^2")
