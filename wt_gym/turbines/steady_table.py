"""Tables of steady states that come with an OpenFAST model: power, thrust, speed and pitch over the wind.

OpenFAST has no format for them. Public models bring text files with one line of column names, as CCBlade, WISDEM and
WEIS write them: names with units, or none, between commas or tabs. `find_steady_table` looks for such a file beside a
model and takes it where its largest power is the rated power of the turbine.
"""

from __future__ import annotations

import logging
import re
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from wt_gym.base.errors import TurbineDefinitionError

if TYPE_CHECKING:
    from numpy.typing import NDArray

__all__ = ["SteadyTable", "find_steady_table", "read_steady_table"]

_log = logging.getLogger(__name__)
_RPM = np.pi / 30.0
_COLUMNS = {
    "wind": (r"wind1velx|wind ?speed|v|u", {"m/s": 1.0, "": 1.0}),
    "power": (
        r"gen(erator)? ?(pwr|power)|(rotor )?electrical power",
        {"w": 1.0, "kw": 1e3, "mw": 1e6},
    ),
    "rotor_speed": (
        r"rot(or)? ?speed|rotor rotational speed|rotor rpm",
        {"rpm": _RPM, "rad/s": 1.0, "": _RPM},
    ),
    "pitch": (r"blade ?pitch|bldpitch1|pitch( angle)?", {"deg": np.pi / 180.0, "rad": 1.0}),
    "thrust": (r"(rotor|aero|aerodynamic) ?thrust|thrust", {"n": 1.0, "kn": 1e3, "mn": 1e6}),
}
"""Names of the columns, and factors of their units to SI units; the first two are needed."""
_ENDINGS = (".csv", ".dat", ".txt")
_TOLERANCE = 0.05
"""Largest deviation of the largest power of a table from rated power, over rated power [-]."""


@dataclass(frozen=True)
class SteadyTable:
    """Steady states over the wind; an array is None where the file has no such column.

    Attributes
    ----------
    path : Path
    wind : numpy.ndarray, shape (n,)
        Ascending [m/s].
    power : numpy.ndarray, shape (n,)
        Electrical [W].
    rotor_speed, pitch, thrust : numpy.ndarray or None, shape (n,)
        [rad/s], [rad], [N].
    """

    path: Path
    wind: NDArray[np.float64]
    power: NDArray[np.float64]
    rotor_speed: NDArray[np.float64] | None
    pitch: NDArray[np.float64] | None
    thrust: NDArray[np.float64] | None

    def at(self, wind: float, column: str) -> float | None:
        """Value of a column in a wind [m/s]; None outside the table or without the column.

        Power is interpolated by its cube root, which is linear in the wind at a constant power coefficient.
        """
        values = getattr(self, column)
        if values is None or not self.wind[0] <= wind <= self.wind[-1]:
            return None
        if column == "power":
            return float(np.interp(wind, self.wind, np.cbrt(values)) ** 3)
        return float(np.interp(wind, self.wind, values))


def find_steady_table(model: Path, rated_power: float) -> SteadyTable | None:
    """Return the table that comes with a model, None where there is none.

    It is looked for in the folder of the model, the two folders above it, and the folders ``performance`` in these. Of
    several tables one of OpenFAST goes before others. A file that `read_steady_table` refuses is skipped with a note.

    Parameters
    ----------
    model : Path
        Primary file (``.fst``).
    rated_power : float
        Electrical [W]; the largest power of the table must be within 5 % of it.
    """
    above = [model.resolve().parent, *model.resolve().parents[1:3]]
    folders = [place for folder in above for place in (folder, folder / "performance") if place.is_dir()]
    files = [file for folder in folders for file in sorted(folder.iterdir()) if file.suffix.lower() in _ENDINGS]
    for file in sorted(files, key=lambda file: "openfast" not in file.name.lower()):  # stable: the nearest first
        try:
            table = read_steady_table(file)
        except TurbineDefinitionError as error:  # a time series has the same columns
            _log.warning("not taken as the table of steady states: %s", error)
            continue
        if table is not None and abs(table.power.max() / rated_power - 1.0) <= _TOLERANCE:
            return table
    return None


def read_steady_table(path: Path) -> SteadyTable | None:
    """Read a table, None for a file whose first line does not name the wind and the electrical power.

    Parameters
    ----------
    path : Path

    Raises
    ------
    TurbineDefinitionError
        If a table has a row that is not one of numbers, or winds that do not rise.
    """
    with path.open(encoding="utf-8", errors="replace") as file:
        separator, places = _places(file.readline())
        if not {"wind", "power"} <= places.keys():
            return None
        lines = [line for line in file if line.strip()]
    try:
        rows = [[float(word) for word in line.strip().split(separator)] for line in lines]
        columns = {
            name: np.array([row[place] for row in rows]) * factor if rows else np.zeros(0)
            for name, (place, factor) in places.items()
        }
    except (ValueError, IndexError) as error:
        raise TurbineDefinitionError(f"{path}: a table of steady states must have rows of numbers: {error}") from error
    if not (columns["wind"].size > 1 and np.all(np.diff(columns["wind"]) > 0.0)):
        raise TurbineDefinitionError(f"{path}: a table of steady states must have at least two winds that rise")
    return SteadyTable(path, **{name: columns.get(name) for name in _COLUMNS})  # type: ignore[arg-type]  # two are there


def _places(header: str) -> tuple[str | None, dict[str, tuple[int, float]]]:
    """Separator of a line of column names, and the places of known columns with the factors of their units."""
    separator = next((mark for mark in (",", "\t") if mark in header), None)
    places: dict[str, tuple[int, float]] = {}
    for place, word in enumerate(header.lstrip("#").strip().split(separator)):
        name, unit = _name_and_unit(word)
        for column, (pattern, units) in _COLUMNS.items():
            if column not in places and re.fullmatch(pattern, name) and unit in units:
                places[column] = place, units[unit]
    return separator, places


def _name_and_unit(word: str) -> tuple[str, str]:
    """Name of a column and its unit, in lower case: ``Generator Power [kW]``, ``RotSpeed_(rpm)``."""
    match = re.fullmatch(r"([^(\[]*)[(\[]([^)\]]*)[)\]]", word.strip().lower())
    name, unit = match.groups() if match else (word.lower(), "")
    return name.replace("_", " ").strip(), unit.strip()
