"""windIO files turned into turbines."""

from __future__ import annotations

import hashlib
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wt_gym.base.constants import AIR_DENSITY
from wt_gym.base.errors import TurbineDefinitionError
from wt_gym.turbines.model import Turbine
from wt_gym.turbines.source import Node, WindioFile, read_windio
from wt_gym.turbines.windio_blade import read_blade
from wt_gym.turbines.windio_control import own_control_file, read_control, with_own_constants, with_own_fields
from wt_gym.turbines.windio_nacelle import read_drivetrain, read_hub, read_machine, read_nacelle, read_pitch, rpm
from wt_gym.turbines.windio_tower import read_support, read_tower

__all__ = ["own_file", "read_turbine"]

_BESIDE = "the .control.json beside it"

_CLASS_NUMBERS = {"1": "I", "2": "II", "3": "III", "4": "IV"}

_loaded: dict[str, Turbine] = {}


def own_file(name: str) -> Path:
    """Path of a file of the package by its name in the folder of turbines."""
    return Path(__file__).parent / "data" / name


def read_turbine(
    path: Path, water_depth: float | None = None, foundation: NDArray[np.float64] | None = None
) -> Turbine:
    """Read a windIO file.

    Parameters
    ----------
    path : Path
    water_depth, foundation
        As of `wt_gym.turbines.load_turbine`.

    Returns
    -------
    Turbine
        The same object for the same content of the file in one process.

    Raises
    ------
    TurbineDefinitionError
        As of `wt_gym.turbines.load_turbine`.
    """
    beside = own_control_file(path)
    try:
        content = path.read_bytes()
        constants = None if beside is None else beside.read_text(encoding="utf-8-sig")
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
        own = with_own_constants(own, constants, _BESIDE, notes)
    values: dict[str, Any] = dict(
        name=root.text("name"),
        n_blades=n_blades,
        rotor_orientation=str(_default(assembly, "rotor_orientation", "upwind", notes)).lower(),
        rotor_diameter=assembly.number("rotor_diameter", 1.0, 1000.0) if "rotor_diameter" in assembly else diameter,
        hub_height=assembly.number("hub_height", 1.0, 1000.0) if "hub_height" in assembly else height,
        rated_wind_speed=_rated_wind_speed(root, rated_power, 0.5 * diameter, drivetrain.rated_rotor_speed, notes),
        cut_in=float(_default(assembly, "cut_in_wind_speed", 3.0, notes)),
        cut_out=float(_default(assembly, "cut_out_wind_speed", 25.0, notes)),
        air_density=AIR_DENSITY,  # windIO's turbine files carry none
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
        turbine = Turbine(**values)
        return turbine if constants is None else with_own_fields(turbine, constants, _BESIDE)
    except TurbineDefinitionError as error:
        # say the same in the words of the file
        text = str(error)
        for field, key in _FILE_KEYS.items():
            text = text.replace(f"Turbine.{field}:", f"assembly.{key} (Turbine.{field}):")
        raise TurbineDefinitionError(text) from error


def _default(node: Node, key: str, default: object, notes: list[str]) -> Any:
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
            "control.optimal_tsr: missing, and outputs.cases has no case at rated power; one of them must be there"
        )
    wind = speed * radius / root.at("control").number("optimal_tsr", 0.1, 50.0)
    notes.append(f"rated wind speed: not in the file, {wind:.2f} m/s is where rated speed has control.optimal_tsr")
    return wind
