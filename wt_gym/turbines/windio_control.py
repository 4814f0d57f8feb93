"""The turbine's own controller in a windIO file: the section ``control``, and a file of published constants beside it.

windIO gives gains from the speed of the rotor [rpm] to pitch [deg] and torque [N m], with the signs of ROSCO's input
files (negative), and schedules in degrees; `ControlData` holds them on the generator side, in SI units and positive.

A JSON file ``NAME.control.json`` beside ``NAME.yaml`` holds what windIO has no keys for, under the names of
`ControlData`; an angle may be given in degrees under its name with ``_deg``. What stands there goes before the section
of the windIO file. Numbers of the turbine without a windIO key stand in its object ``turbine`` (`OWN_FIELDS`).
"""

from __future__ import annotations

import json
from dataclasses import fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from wt_gym.base.errors import TurbineDefinitionError
from wt_gym.turbines.control_data import ControlData
from wt_gym.turbines.source import Node, within
from wt_gym.turbines.windio_nacelle import rpm

if TYPE_CHECKING:
    from wt_gym.turbines.model import Turbine

__all__ = ["OWN_FIELDS", "own_control_file", "read_control", "with_own_constants", "with_own_fields"]

OWN_FIELDS = {
    "": ("air_density", "design_air_density", "rotation"),
    "pitch": ("max_pitch", "servo_frequency", "servo_damping"),
    "drivetrain": ("gearbox_reverses", "torque_lag", "min_rotor_speed"),
    "nacelle": ("max_yaw_rate",),
}
"""Fields of a turbine and of its parts that a windIO file has no keys for, or keys with a smaller range."""

_DEGREE = np.pi / 180.0
_READ = {
    "fine_pitch": "fine pitch",
    "optimal_tsr": "tip-speed ratio",
    "region2_k": "torque gain of region 2",
    "gen_torque_kp": "torque gains",
    "gen_torque_ki": "torque gains",
    "constant_power": "constant power or torque",
    "pitch_kp": "pitch gains",
    "pitch_ki": "pitch gains",
    "lpf_frequency": "speed filter",
    "lpf_damping": "speed filter",
    "min_pitch_table": "least pitch over the wind",
    "pitch_actuator_frequency": "pitch actuator",
    "pitch_actuator_damping": "pitch actuator",
}
"""Keys that end up in `ControlData`, with the words for them."""
_ELSEWHERE = frozenset(
    {
        "max_gen_torque",
        "max_pitch_limit",
        "max_pitch_rate",
        "max_torque_rate",
        "min_pitch_limit",
        "min_rotor_speed",
        "rated_power",
        "rated_rotor_speed",
        "yaw_rate",
    }
)
"""Keys that the readers of drivetrain, nacelle and pitch system take."""


def read_control(root: Node, gear_ratio: float, notes: list[str]) -> ControlData | None:
    """Read the numbers of the controller from ``control``.

    Parameters
    ----------
    root : Node
        The file.
    gear_ratio : float
        Generator speed over rotor speed.
    notes : list of str
        Gets what was read and what was left aside.

    Returns
    -------
    ControlData or None
        None for a file that says nothing about its controller.

    Raises
    ------
    TurbineDefinitionError
        Naming the key path that is wrong.
    """
    node = root.at("control")
    values: dict[str, Any] = {}
    ignored = sorted(key for key in node.data if key not in _READ and key not in _ELSEWHERE)
    _numbers(node, gear_ratio, values)
    _pitch_gains(node, gear_ratio, values, notes)
    if "min_pitch_table" in node:
        table = node.at("min_pitch_table")
        wind = table.array("wind_speed")
        values["min_pitch_wind"], values["min_pitch"] = wind, _DEGREE * table.array("min_pitch", wind.size)
    used = list(dict.fromkeys(words for key, words in _READ.items() if key in node))
    if used:
        notes.append(f"control: the turbine's own controller has {', '.join(used)} from the file")
    if "pitch_actuator_frequency" in node:
        notes.append(
            "control.pitch_actuator_frequency: kept in Turbine.control only; the pitch drives of the simulation follow "
            "their demand at up to max_pitch_rate unless PitchSystem.servo_frequency is set"
        )
    if ignored:
        notes.append(f"control: {', '.join(ignored)} not used")
    if not values:
        return None
    with within("control"):
        return ControlData(**values)


def _numbers(node: Node, gear_ratio: float, values: dict[str, Any]) -> None:
    """Read what is a single number; zero stands for what a file does not know."""
    torque_gain = 1.0 / (rpm * gear_ratio)
    known: dict[str, tuple[str, float]] = {
        "optimal_tsr": ("optimal_tip_speed_ratio", 1.0),
        "region2_k": ("region_2_gain", torque_gain**2),
        "lpf_frequency": ("speed_filter_frequency", 1.0),
        "lpf_damping": ("speed_filter_damping", 1.0),
        "pitch_actuator_frequency": ("pitch_actuator_frequency", 1.0),
        "pitch_actuator_damping": ("pitch_actuator_damping", 1.0),
    }
    for key, (name, scale) in known.items():
        if key in node and (value := node.number(key, 0.0, 1e12)) > 0.0:
            values[name] = scale * value
    if "fine_pitch" in node:
        values["fine_pitch"] = node.number("fine_pitch", -90.0, 90.0, _DEGREE)
    if "constant_power" in node:
        values["constant_power"] = bool(node.number("constant_power", 0.0, 1.0))
    gains = {key: node.number(key, -1e12, 1e12) for key in ("gen_torque_kp", "gen_torque_ki") if key in node}
    if len(gains) == 2 and all(gains.values()):
        if gains["gen_torque_kp"] * gains["gen_torque_ki"] < 0.0:
            raise TurbineDefinitionError(
                f"{node.where('gen_torque_kp')}: {gains['gen_torque_kp']:g} and gen_torque_ki "
                f"{gains['gen_torque_ki']:g} must have the same sign"
            )
        values["torque_proportional_gain"] = torque_gain * abs(gains["gen_torque_kp"])
        values["torque_integral_gain"] = torque_gain * abs(gains["gen_torque_ki"])


def _pitch_gains(node: Node, gear_ratio: float, values: dict[str, Any], notes: list[str]) -> None:
    """Read the gain schedules of the pitch controller, on one grid."""
    given = [key for key in ("pitch_kp", "pitch_ki") if key in node]
    if len(given) < 2:
        if given:
            notes.append(f"{node.where(given[0])}: not used, since only one of pitch_kp and pitch_ki is in the file")
        return
    grids, gains = [], []
    for key, column in (("pitch_kp", "kp"), ("pitch_ki", "ki")):
        table = node.at(key)
        grids.append(_DEGREE * table.array("pitch_angle"))
        gains.append(table.array(column, grids[-1].size))
    if not (gains[0].any() and gains[1].any()):
        notes.append(f"{node.where('pitch_kp')}: not used, all gains of pitch_kp or pitch_ki are zero")
        return
    # most files have the signs of ROSCO: more speed with a negative gain means more pitch
    sign = -1.0 if gains[1].sum() < 0.0 else 1.0
    scale = sign * _DEGREE / (rpm * gear_ratio)
    grid = grids[0] if np.array_equal(grids[0], grids[1]) else np.union1d(grids[0], grids[1])
    values["gain_pitch"] = grid
    values["pitch_proportional_gain"] = scale * np.interp(grid, grids[0], gains[0])
    values["pitch_integral_gain"] = scale * np.interp(grid, grids[1], gains[1])


def own_control_file(path: Path) -> Path | None:
    """Return the file of published constants beside a windIO file, None where there is none."""
    beside = path.with_name(f"{path.stem}.control.json")
    return beside if beside.is_file() else None


def _own_object(text: str, name: str) -> dict[str, Any]:
    """Return the content of a file ``NAME.control.json``.

    Raises
    ------
    TurbineDefinitionError
        If the text is not a JSON object.
    """
    try:
        content = json.loads(text)
    except ValueError as error:
        raise TurbineDefinitionError(f"{name}: not JSON: {error}") from error
    if not isinstance(content, dict):
        raise TurbineDefinitionError(f"{name}: must be a JSON object with the names of ControlData, got {content!r}")
    return content


def with_own_fields(turbine: Turbine, text: str, name: str) -> Turbine:
    """Return a turbine with the fields in the object ``turbine`` of a file ``NAME.control.json``.

    Parameters
    ----------
    turbine : Turbine
    text : str
        JSON.
    name : str
        Of the file, for messages.

    Raises
    ------
    TurbineDefinitionError
        For a key that is none of `OWN_FIELDS`, or a value out of range.
    """
    given = _own_object(text, name).get("turbine", {})
    known = {f"{part}.{field}" if part else field for part, fields in OWN_FIELDS.items() for field in fields}
    if not isinstance(given, dict) or not given.keys() <= known:
        raise TurbineDefinitionError(
            f"{name}: turbine must be an object with keys among {sorted(known)}, got {given!r}"
        )
    for part, names in OWN_FIELDS.items():
        prefix = f"{part}." if part else ""
        values = {field: given[prefix + field] for field in names if prefix + field in given}
        with within(name):
            if part:
                values = {part: replace(getattr(turbine, part), **values)}
            turbine = replace(turbine, **values)
    return turbine


def with_own_constants(control: ControlData | None, text: str, name: str, notes: list[str]) -> ControlData | None:
    """Return control data with the constants of a file ``NAME.control.json``.

    Parameters
    ----------
    control : ControlData or None
        What the windIO file says.
    text : str
        JSON.
    name : str
        Of the file, for messages.
    notes : list of str
        Gets a line with the source that the file names.

    Raises
    ------
    TurbineDefinitionError
        If the text is not a JSON object, or has a key or value that `ControlData` does not.
    """
    content = _own_object(text, name)
    content.pop("turbine", None)
    source = content.pop("source", None)
    known = {f.name for f in fields(ControlData)}
    values: dict[str, Any] = {}
    for key, value in content.items():
        plain = key.removesuffix("_deg")
        if plain not in known:
            raise TurbineDefinitionError(f"{name}: keys must be among {', '.join(sorted(known))}; got {key!r}")
        try:
            values[plain] = np.radians(value) if key != plain else value
        except TypeError as error:
            raise TurbineDefinitionError(f"{name}: {key} must be numbers, got {value!r}") from error
    if not values:
        return control
    with within(name):
        made = replace(control or ControlData(), **values)
    notes.append(f"control: published constants of the controller from {source or name}")
    return made
