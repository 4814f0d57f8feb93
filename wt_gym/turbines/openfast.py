"""Turbines from models of OpenFAST: the primary file (``.fst``) and the files that it names."""

from pathlib import Path

import numpy as np

from wt_gym.base.errors import TurbineDefinitionError
from wt_gym.turbines.checks import check_number, fail
from wt_gym.turbines.control_data import ControlData
from wt_gym.turbines.model import Turbine
from wt_gym.turbines.openfast_blade import BladeFiles, read_openfast_blade
from wt_gym.turbines.openfast_control import Rating, read_controllers, read_openfast_control, read_rating
from wt_gym.turbines.openfast_left_aside import name_the_rest
from wt_gym.turbines.openfast_nacelle import (
    blade_file,
    read_openfast_drivetrain,
    read_openfast_hub,
    read_openfast_nacelle,
    read_openfast_pitch,
    require_plain,
)
from wt_gym.turbines.openfast_text import TextFile, existing_file
from wt_gym.turbines.openfast_tower import read_openfast_tower
from wt_gym.turbines.windio_airfoils import KINEMATIC_VISCOSITY

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
