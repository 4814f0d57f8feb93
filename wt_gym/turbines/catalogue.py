"""Turbines by name, from a windIO file or from an OpenFAST model."""

import hashlib
import importlib.util
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wt_gym.errors import TurbineDefinitionError
from wt_gym.turbines.checks import fail
from wt_gym.turbines.model import Turbine
from wt_gym.turbines.source import Node, WindioFile, read_windio
from wt_gym.turbines.windio_blade import read_blade
from wt_gym.turbines.windio_control import own_control_file, read_control, with_own_constants
from wt_gym.turbines.windio_nacelle import read_drivetrain, read_hub, read_machine, read_nacelle, read_pitch, rpm
from wt_gym.turbines.windio_tower import read_support, read_tower

__all__ = ["AIR_DENSITY", "catalogue", "load_turbine", "turbine_file"]

AIR_DENSITY = 1.225
"""At sea level in the standard atmosphere [kg/m^3]; windIO's turbine files carry none."""

IEA_15MW_WATER_DEPTH = 30.0
"""For which the monopile of that turbine was designed [m] (NREL/TP-5000-75698)."""

_CLASS_NUMBERS = {"1": "I", "2": "II", "3": "III", "4": "IV"}

_loaded: dict[str, Turbine] = {}


def _own_file(name: str) -> Path:
    return Path(__file__).parent / "data" / name


def _windio_example(name: str) -> Path:
    # Found without importing windIO, which is slow and, for a file read before, not needed.
    spec = importlib.util.find_spec("windIO")
    if spec is None or spec.origin is None:
        raise TurbineDefinitionError("the package windIO is not installed: pip install windIO")
    return Path(spec.origin).parent / "examples" / "turbine" / name


_FILES: dict[str, Callable[[], Path]] = {
    "nrel_5mw": lambda: _own_file("nrel_5mw.yaml"),
    "iea_15mw": lambda: _windio_example("IEA-15-240-RWT.yaml"),
    "iea_22mw": lambda: _windio_example("IEA-22-280-RWT.yaml"),
}


def _gebhardt() -> Turbine:
    from wt_gym.turbines.gebhardt_turbine import gebhardt_turbine  # which takes its sections from this catalogue

    return gebhardt_turbine()


def _nada() -> Turbine:
    from wt_gym.turbines.nada_turbine import nada_turbine

    return nada_turbine()


@cache
def _iea_15mw_monopile() -> Turbine:
    return load_turbine("iea_15mw", water_depth=IEA_15MW_WATER_DEPTH)


def _nrel_5mw_monopile() -> Turbine:
    from wt_gym.turbines.oc3_monopile import oc3_turbine

    return oc3_turbine()


_BUILT: dict[str, Callable[[], Turbine]] = {
    "gebhardt_45m": _gebhardt,
    "nada_small": _nada,
    "iea_15mw_monopile": _iea_15mw_monopile,
    "nrel_5mw_monopile": _nrel_5mw_monopile,
}
"""Turbines that no windIO file describes, or none alone."""


def catalogue() -> tuple[str, ...]:
    """Return the names that ``load_turbine`` knows."""
    return (*_FILES, *_BUILT)


def load_turbine(
    name_or_path: str | Path,
    water_depth: float | None = None,
    foundation: NDArray[np.float64] | None = None,
    rotation: str | None = None,
) -> Turbine:
    """Load a turbine of the catalogue, any windIO file (version 2 or 1) or any OpenFAST model.

    Parameters
    ----------
    name_or_path : str or Path
        A name of ``catalogue()``, the path of a YAML file, or that of the primary file of an OpenFAST model (``.fst``,
        see `read_openfast`).
    water_depth : float, optional
        Puts the tower on the monopile of the file, in water of this depth [m]. By default a tower is clamped at its
        base.
    foundation : ndarray (6, 6), optional
        Stiffness of the ground under that monopile (see `Support`), by default rigid.
    rotation : {"clockwise", "counter-clockwise"}, optional
        Direction in which the rotor turns, seen looking downwind. By default that of the file: OpenFAST models say it
        (MirrorRotor), windIO has no key for it and means clockwise.

    Returns
    -------
    Turbine
        Frozen; the same object for the same content of the file in one process. ``turbine.notes`` lists what had to be
        assumed because the file does not say it.

    Raises
    ------
    TurbineDefinitionError
        If the name or path is unknown, the file is no YAML, does not fit windIO's schema, lacks a number the simulator
        needs or contradicts itself. The message names the file, the key path and what is allowed.

    Examples
    --------
    >>> load_turbine("nrel_5mw").rotor_diameter
    126.0
    >>> load_turbine("nrel_5mw", rotation="counter-clockwise").rotation
    'counter-clockwise'
    """
    turbine = _load(name_or_path, water_depth, foundation)
    return turbine if rotation is None or rotation == turbine.rotation else replace(turbine, rotation=rotation)


def _load(name_or_path: str | Path, water_depth: float | None, foundation: NDArray[np.float64] | None) -> Turbine:
    """Load a turbine as its file describes it; see `load_turbine`."""
    if foundation is not None and water_depth is None:
        raise fail("foundation", "a stiffness", "None without a water_depth")
    if isinstance(name_or_path, str) and name_or_path in _BUILT and water_depth is not None:
        raise fail("water_depth", water_depth, f"None for {name_or_path!r}, which no windIO file describes")
    if isinstance(name_or_path, str) and name_or_path in _BUILT:
        return _BUILT[name_or_path]()
    path = turbine_file(name_or_path)
    if path.suffix.lower() == ".fst":
        return _openfast(path, water_depth)
    beside = own_control_file(path)
    try:
        content = path.read_bytes()
        constants = None if beside is None else beside.read_text(encoding="utf-8")
    except OSError as error:
        raise TurbineDefinitionError(f"{path}: cannot be read: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise TurbineDefinitionError(f"{beside}: must be UTF-8 text: {error}") from error
    key = hashlib.sha256(content + b"\0" + (constants or "").encode()).hexdigest()
    if water_depth is None and key in _loaded:
        return _loaded[key]
    file: WindioFile | None = None
    try:
        file = read_windio(path, content)
        turbine = _build(file, water_depth, foundation, constants)
    except TurbineDefinitionError as error:
        raise TurbineDefinitionError(f"{path}: {error}{_resembling(error, file)}") from error
    if water_depth is None and file.alone:
        _loaded[key] = turbine
    return turbine


def _resembling(error: TurbineDefinitionError, file: WindioFile | None) -> str:
    """Return the unknown key of a file that may be meant for the missing one of an error, beginning with ``;``."""
    path, _, rest = str(error).partition(": ")
    if file is None or not rest.startswith("missing") or path not in file.resembling:
        return ""
    return f"; the file has {file.resembling[path]!r} there"


def _openfast(path: Path, water_depth: float | None) -> Turbine:
    from wt_gym.turbines.openfast import read_openfast  # which most users never need

    if water_depth is not None:
        raise fail("water_depth", water_depth, "None for an OpenFAST model, whose substructure is left aside")
    try:
        return read_openfast(path)
    except TurbineDefinitionError as error:
        raise TurbineDefinitionError(f"{path}: {error}") from error


def turbine_file(name_or_path: str | Path) -> Path:
    """Return the path of the file behind a name of the catalogue, or the given path if it is a file.

    Raises
    ------
    TurbineDefinitionError
        If it is neither, or a turbine of the catalogue that has no file.
    """
    if isinstance(name_or_path, str) and name_or_path in _FILES:
        return _FILES[name_or_path]()
    if isinstance(name_or_path, str) and name_or_path in _BUILT:
        raise TurbineDefinitionError(
            f"turbine {name_or_path!r} has no windIO file, the package builds it: load_turbine({name_or_path!r}); with "
            f"a file are {', '.join(map(repr, _FILES))}"
        )
    allowed = f"one of {', '.join(map(repr, catalogue()))} or the path of a windIO file or OpenFAST model (.fst)"
    if not isinstance(name_or_path, (str, Path)):
        raise fail("turbine", name_or_path, allowed)
    path = Path(name_or_path).expanduser()
    if path.is_dir():
        raise fail("turbine", str(name_or_path), f"{allowed} (this is a folder)")
    if not path.is_file():
        raise fail("turbine", str(name_or_path), f"{allowed} (there is no such file)")
    return path


_FILE_KEYS = {
    "n_blades": "number_of_blades",
    "rotor_orientation": "rotor_orientation",
    "rotor_diameter": "rotor_diameter",
    "hub_height": "hub_height",
    "cut_in": "cut_in_wind_speed",
    "cut_out": "cut_out_wind_speed",
    "iec_class": "turbine_class",
    "turbulence_class": "turbulence_class",
}
"""Keys of the ``assembly`` section behind the fields of a turbine."""


def _build(
    file: WindioFile,
    water_depth: float | None,
    foundation: NDArray[np.float64] | None,
    constants: str | None = None,
) -> Turbine:
    """Turn a file, and constants beside it, into a turbine, on its monopile if the depth of the water is given."""
    root = file.root
    notes = list(file.notes)
    assembly = root.at("assembly")
    control = root.at("control", "a mapping with rated_rotor_speed, max_gen_torque and the limits of the actuators")
    power_node = assembly if "rated_power" in assembly else control
    rated_power = power_node.number("rated_power", 1.0, 1e9)
    n_blades = int(_default(assembly, "number_of_blades", 3, notes))
    hub_node = root.at("components.hub")
    hub_radius = hub_node.number("diameter", 0.0, 30.0, 0.5)
    blade = read_blade(root, hub_radius, control.number("rated_rotor_speed", 1e-3, 1000.0, rpm), notes)
    diameter = (
        2.0 * (hub_radius + blade.length) * float(np.cos(hub_node.number("cone_angle", 0.0, 50.0, np.pi / 180.0)))
    )
    machine = read_machine(root, rated_power, diameter, n_blades, blade.structure.mass_moment(0), notes)
    hub = read_hub(root, machine, notes)
    drivetrain = read_drivetrain(root, blade, hub, machine, notes)
    tower = read_tower(root, notes)
    if water_depth is not None:
        notes[:] = [note for note in notes if not note.startswith("components.monopile:")]
        tower = replace(tower, support=read_support(root, tower, water_depth, foundation, notes))
    nacelle = read_nacelle(root, blade, hub, machine, notes)
    height = tower.height + root.at("components.drivetrain.outer_shape").number("distance_tt_hub", 0.0, 20.0)
    own = read_control(root, drivetrain.gear_ratio, notes)
    if constants is not None:
        own = with_own_constants(own, constants, "the .control.json beside it", notes)
    values: dict[str, Any] = dict(
        name=root.text("name"),
        n_blades=n_blades,
        rotor_orientation=str(_default(assembly, "rotor_orientation", "upwind", notes)).lower(),
        rotor_diameter=assembly.number("rotor_diameter", 1.0, 1000.0) if "rotor_diameter" in assembly else diameter,
        hub_height=assembly.number("hub_height", 1.0, 1000.0) if "hub_height" in assembly else height,
        rated_wind_speed=_rated_wind_speed(root, rated_power, 0.5 * diameter, drivetrain.rated_rotor_speed, notes),
        cut_in=float(_default(assembly, "cut_in_wind_speed", 3.0, notes)),
        cut_out=float(_default(assembly, "cut_out_wind_speed", 25.0, notes)),
        air_density=AIR_DENSITY,
        blade=blade,
        tower=tower,
        hub=hub,
        nacelle=nacelle,
        drivetrain=drivetrain,
        pitch=read_pitch(root, notes),
        iec_class=_iec_class(_default(assembly, "turbine_class", "I", notes)),
        turbulence_class=str(_default(assembly, "turbulence_class", "B", notes)).upper(),
        notes=tuple(notes),
        control=own,
    )
    try:
        return Turbine(**values)
    except TurbineDefinitionError as error:
        # say the same in the words of the file
        text = str(error)
        for field, key in _FILE_KEYS.items():
            text = text.replace(f"Turbine.{field}:", f"assembly.{key} (Turbine.{field}):")
        raise TurbineDefinitionError(text) from error


def _default(node: Node, key: str, default, notes: list[str]):
    """Return an entry that the schema has checked, or the schema's default with a note."""
    if key in node:
        return node.data[key]
    notes.append(f"{node.where(key)}: not in the file, {default} assumed")
    return default


def _iec_class(value: str | int) -> str:
    text = str(value).upper()
    return _CLASS_NUMBERS.get(text, text)


def _rated_wind_speed(root: Node, power: float, radius: float, speed: float, notes: list[str]) -> float:
    """Return the lowest wind of ``outputs.cases`` at rated power, else that of the optimal tip-speed ratio [m/s]."""
    winds = []
    if "outputs.cases" in root:
        for case in root.at("outputs").items("cases"):
            if "integrated.electrical_power" in case and "configuration.wind_speed" in case:
                reached = case.at("integrated").number("electrical_power", -1e9, 1e9)
                if reached >= 0.999 * power:
                    winds.append(case.at("configuration").number("wind_speed", 0.0, 200.0))
    if winds:
        return min(winds)
    if "control.optimal_tsr" not in root:
        raise TurbineDefinitionError(
            "control.optimal_tsr: missing, and outputs.cases has no case at rated power; one of them is needed"
        )
    wind = speed * radius / root.at("control").number("optimal_tsr", 0.1, 50.0)
    notes.append(f"rated wind speed: not in the file, {wind:.2f} m/s is where rated speed has control.optimal_tsr")
    return wind
