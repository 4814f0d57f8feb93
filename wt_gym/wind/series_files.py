"""Files of winds that follow a time series: CSV tables with named columns, and InflowWind's uniform wind files.

CSV: the first line that is neither empty nor begins with ``#`` names the columns; time [s] and speed [m/s] are needed,
the others are zero without: direction [deg], vertical_speed [m/s], shear_exponent, horizontal_shear, vertical_shear,
gust [m/s], upflow [deg]. Directions are ours: against +x, counter-clockwise from above positive.

Uniform wind files (``.wnd``, ``.hh``) have lines of 8 or 9 numbers without names, ``!``, ``#`` and ``%`` beginning a
comment, and what follows the numbers is not read: time [s],
speed [m/s], direction [deg], vertical speed [m/s], horizontal linear shear, power-law exponent, vertical linear shear,
gust [m/s], and upflow [deg]. Directions are InflowWind's: a positive one blows towards −y (from the left looking
downwind), so that its sign is turned when it is read; so is nothing else.
"""

from __future__ import annotations

import csv
import re
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from wt_gym.base.errors import InflowError, did_you_mean
from wt_gym.base.files import decoded_text
from wt_gym.wind.series import COLUMNS, SeriesInflow

if TYPE_CHECKING:
    import os
    from collections.abc import Sequence
    from os import PathLike
    from typing import Any

__all__ = ["read_csv", "read_uniform"]

_COMMENT = re.compile("[!#%].*")
_ANGLES = ("direction", "upflow")
_UNIFORM = (
    "time", "speed", "direction", "vertical_speed", "horizontal_shear", "shear_exponent", "vertical_shear", "gust",
    "upflow",
)  # fmt: skip


def read_csv(path: str | os.PathLike[str], **more: Any) -> SeriesInflow:
    """Read a CSV file.

    Parameters
    ----------
    path
        The file.
    **more
        Of `SeriesInflow`: ``hub_height``, ``reference_length``, ``travels``, ``time_offset``.

    Raises
    ------
    InflowError
        If the file cannot be read, a column is unknown, missing or named twice, or a line is damaged; the message names
        file and line.
    """
    rows = [
        (number, [cell.strip() for cell in next(csv.reader([line]))])
        for number, line in _lines(path)
        if not line.startswith("#")
    ]
    if not rows:
        raise InflowError(f"{path} is empty: its first line must name the columns, time and speed among them")
    (_, names), *body = rows
    _check_names(path, names)
    if not body:
        raise InflowError(f"{path} must have lines of numbers below the names of its columns")
    return _series(path, names, body, 1.0, more)


def read_uniform(path: str | os.PathLike[str], **more: Any) -> SeriesInflow:
    """Read a uniform wind file of InflowWind.

    Parameters
    ----------
    path
        The file.
    **more
        Of `SeriesInflow`: ``hub_height`` and ``reference_length`` stand in InflowWind's input file, not in this one.

    Raises
    ------
    InflowError
        If the file cannot be read, is a binary file, or a line is damaged; the message names file and line.
    """
    body = [(number, _COMMENT.sub("", line).replace(",", " ").split()) for number, line in _lines(path)]
    body = [(number, cells) for number, cells in body if cells]
    if not body:
        raise InflowError(f"{path} must have lines of 8 or 9 numbers (uniform wind file), got none")
    number, first = body[0]
    width = 9 if _number(first[8:9]) is not None else 8
    if len(first) < width:
        raise InflowError(
            f"{path}, line {number}: lines of a uniform wind file must have 8 or 9 numbers, got {len(first)}"
        )
    return _series(path, _UNIFORM[:width], [(number, cells[:width]) for number, cells in body], -1.0, more)


def _number(cells: list[str]) -> float | None:
    """Return the number in the only cell as Fortran may write it (1.0D+03), None for anything else."""
    try:
        return float(cells[0].lower().replace("d", "e"))
    except (IndexError, ValueError):
        return None


def _lines(path: str | os.PathLike[str]) -> list[tuple[int, str]]:
    """Lines that hold something, with their numbers from 1."""
    try:
        data = Path(path).read_bytes()
    except OSError as error:
        raise InflowError(f"cannot read the wind file {path}: {error}") from error
    if b"\0" in data:
        raise InflowError(
            f"{path} must be a text file, it has bytes of 0. Binary .wnd files (TurbSim, Bladed) are not read; TurbSim "
            "also writes .bts"
        )
    lines = enumerate(decoded_text(data).split("\n"), 1)
    return [(number, line.strip()) for number, line in lines if line.strip()]


def _check_names(path: str | os.PathLike[str], names: list[str]) -> None:
    allowed = ("time", *COLUMNS)
    for name in names:
        if name not in allowed:
            near = did_you_mean(name, allowed)
            raise InflowError(f"{path}: columns must be among {', '.join(allowed)}; got {name!r}{near}")
        if names.count(name) > 1:
            raise InflowError(f"{path}: every column must be named once, got {name!r} twice")
    for name in ("time", "speed"):
        if name not in names:
            raise InflowError(f"{path}: the column {name!r} must be there, got {', '.join(names)}")


def _series(
    path: str | PathLike[str],
    names: Sequence[str],
    body: Sequence[tuple[int, list[str]]],
    sign: float,
    more: dict[str, Any],
) -> SeriesInflow:
    """Series of the rows of a file; ``sign`` turns its directions into ours."""
    values = np.empty((len(body), len(names)))
    for row, (number, cells) in enumerate(body):
        if len(cells) != len(names):
            raise InflowError(f"{path}, line {number}: {len(names)} numbers are needed, one a column; got {len(cells)}")
        for column, cell in enumerate(cells):
            value = _number([cell])
            if value is None:
                raise InflowError(f"{path}, line {number}: {names[column]} must be a number; got {cell!r}")
            values[row, column] = value
    if not np.isfinite(values).all():
        row = int(np.argmin(np.isfinite(values).all(axis=1)))
        raise InflowError(f"{path}, line {body[row][0]}: every number must be finite; got {body[row][1]}")
    again = np.concatenate(([False], (values[1:] == values[:-1]).all(axis=1)))  # a row that stands there twice
    columns = dict(zip(names, values[~again].T, strict=True))
    for name in _ANGLES:
        if name in columns:
            columns[name] = np.radians(columns[name])
    if "direction" in columns:
        columns["direction"] = sign * np.unwrap(columns["direction"])
    try:
        return SeriesInflow.of(columns, **{"name": Path(path).name, **more})
    except InflowError as error:
        raise InflowError(f"{path}: {error}") from error
