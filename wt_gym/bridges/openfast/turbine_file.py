"""A turbine as a JSON file, whole, so that outputs of OpenFAST can be read without the model they were made with."""

from __future__ import annotations

import dataclasses
import json
from typing import TYPE_CHECKING, Any

import numpy as np

from wt_gym.base.errors import TurbineDefinitionError
from wt_gym.base.files import write_text_whole
from wt_gym.turbines import (
    Airfoil,
    BeamStations,
    Blade,
    ControlData,
    Drivetrain,
    Hub,
    Nacelle,
    PitchSystem,
    Polar,
    RotationalAugmentation,
    Support,
    Tower,
    Turbine,
)

if TYPE_CHECKING:
    from pathlib import Path

__all__ = ["TURBINE_FILE", "read_turbine", "write_turbine"]

TURBINE_FILE = "turbine.json"
"""Name of the file beside a primary file that is written here."""
_RECORDS: dict[str, type[Any]] = {
    record.__name__: record
    for record in (
        Airfoil, BeamStations, Blade, ControlData, Drivetrain, Hub, Nacelle, PitchSystem, Polar, RotationalAugmentation,
        Support, Tower, Turbine,
    )
}  # fmt: skip


def write_turbine(turbine: Turbine, path: Path) -> None:
    """Write a turbine; `read_turbine` gives the same one, to the last bit."""
    write_text_whole(path, json.dumps(_plain(turbine)) + "\n")


def read_turbine(path: Path) -> Turbine:
    """Read a turbine that `write_turbine` has written.

    Raises
    ------
    TurbineDefinitionError
        If the file is not such a one.
    """
    try:
        found = _made(json.loads(path.read_text(encoding="utf-8")))
    except (json.JSONDecodeError, UnicodeDecodeError, KeyError, TypeError) as error:
        raise TurbineDefinitionError(
            f"{path} must be the file of a turbine that was written here: {error!r}"
        ) from error
    if not isinstance(found, Turbine):
        raise TurbineDefinitionError(f"{path} must be the file of a turbine that was written here")
    return found


def _plain(value: Any) -> Any:
    if dataclasses.is_dataclass(value):
        fields = {item.name: _plain(getattr(value, item.name)) for item in dataclasses.fields(value) if item.init}
        return {"record": type(value).__name__, "fields": fields}
    if isinstance(value, np.ndarray):
        return {"array": value.tolist(), "type": value.dtype.name}
    if isinstance(value, tuple | list):
        return [_plain(item) for item in value]
    return value.item() if isinstance(value, np.generic) else value


def _made(value: Any) -> Any:
    if isinstance(value, list):
        return tuple(_made(item) for item in value)
    if not isinstance(value, dict):
        return value
    if "array" in value:
        return np.array(value["array"], dtype=value["type"])
    return _RECORDS[value["record"]](**{name: _made(item) for name, item in value["fields"].items()})
