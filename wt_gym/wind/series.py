"""Winds that follow a time series (steps, ramps, records, events), and files of them.

CSV: the first line that is neither empty nor begins with ``#`` names the columns; time [s] and speed [m/s] are needed,
the others are zero without: direction [deg], vertical_speed [m/s], shear_exponent, horizontal_shear, vertical_shear,
gust [m/s], upflow [deg]. Directions are ours: against +x, counter-clockwise from above positive.

Uniform wind files (``.wnd``, ``.hh``) have lines of 8 or 9 numbers without names, ``!``, ``#`` and ``%`` beginning a
comment, and what follows the numbers is not read: time [s],
speed [m/s], direction [deg], vertical speed [m/s], horizontal linear shear, power-law exponent, vertical linear shear,
gust [m/s], and upflow [deg]. Directions are InflowWind's: a positive one blows towards −y (from the left looking
downwind), so that its sign is turned when it is read; so is nothing else.
"""

import csv
import math
import os
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from wt_gym.base.errors import InflowError, did_you_mean
from wt_gym.base.files import decoded_text
from wt_gym.base.quantities import Array
from wt_gym.wind.inflow import POSITIVE, PointInflow, check_flag, check_numbers, require_number, set_read_only
from wt_gym.wind.inflow_kernels import series_velocity

COLUMNS = (
    "speed", "direction", "vertical_speed", "shear_exponent", "horizontal_shear", "vertical_shear", "gust", "upflow",
)  # fmt: skip
"""Columns of a series, in the order of its table."""

_BOUNDS = {
    "speed": ("m/s", 0.0, 200.0),
    "direction": ("rad", -100.0, 100.0),
    "vertical_speed": ("m/s", -100.0, 100.0),
    "shear_exponent": ("(no unit)", -1.0, 1.0),
    "horizontal_shear": ("(no unit)", -10.0, 10.0),
    "vertical_shear": ("(no unit)", -10.0, 10.0),
    "gust": ("m/s", -200.0, 200.0),
    "upflow": ("rad", -0.5 * math.pi, 0.5 * math.pi),
}


@dataclass(frozen=True, eq=False)
class SeriesInflow(PointInflow):
    """Wind whose numbers change with time, in straight lines between the times of a table.

    The wind along its direction at a point is (InflowWind's uniform wind, Platt, Jonkman and Jonkman, InflowWind User's
    Guide, section on uniform wind files)

        V (z/hub_height)^shear_exponent
          + V (horizontal_shear y' + vertical_shear (z - hub_height))/reference_length + gust

    with V the speed and y' the distance of the point from the hub axis to the left of the wind's direction. It and the
    vertical speed are turned up by ``upflow``. At z ≤ 0 the power law is zero; with a negative exponent it keeps its
    speed below a tenth of the hub height, as `SteadyInflow`. Before the first and after the last time the table's ends
    hold. The wind changes everywhere at once, or, with ``travels``, is carried along its mean direction at its mean
    speed, so that a lidar sees it coming.

    Parameters
    ----------
    times : ndarray, shape (n,)
        Not decreasing [s]; a time that stands twice is a step.
    table : ndarray, shape (n, 8)
        The columns `COLUMNS`: speed [m/s], direction against +x, counter-clockwise from above positive [rad], vertical
        speed [m/s], power-law exponent, linear shears over the reference length [-], gust [m/s], upflow [rad].
    hub_height : float
        Height at which the speed holds [m].
    reference_length : float
        Over which the linear shears hold [m], the rotor diameter.
    time_offset : float
        Time in the table at time zero [s].
    name : str
        What the series is, in words.

    Raises
    ------
    InflowError
        If shapes do not fit, times decrease or a number is out of range.

    Examples
    --------
    >>> wind = SeriesInflow.of({"time": [0.0, 10.0, 10.0], "speed": [8.0, 8.0, 12.0]})
    >>> [float(wind.velocity([0.0, 0.0, 90.0], t)[0]) for t in (9.9, 10.0, 60.0)]
    [8.0, 12.0, 12.0]
    """

    times: Array
    table: Array
    hub_height: float = 90.0
    reference_length: float = 126.0
    time_offset: float = 0.0
    travels: bool = False
    name: str = "series"

    def __post_init__(self) -> None:
        times, table = (np.array(a, dtype=np.float64, order="C") for a in (self.times, self.table))
        if times.ndim != 1 or times.size < 1 or table.shape != (times.size, len(COLUMNS)):
            raise InflowError(
                f"times and table must have shapes (n,) and (n, {len(COLUMNS)}) with n of at least 1; got "
                f"{times.shape} and {table.shape}"
            )
        if not np.isfinite(times).all():
            raise InflowError(f"times must be finite; row {int(np.argmin(np.isfinite(times)))} is not")
        if times.size > 1:
            _check_times(times)
        for column, (name, (unit, low, high)) in enumerate(_BOUNDS.items()):
            good = (table[:, column] >= low) & (table[:, column] <= high)  # not for NaN either
            if not good.all():
                row = int(np.argmin(good))
                raise InflowError(
                    f"{name} must lie in [{low:g}, {high:g}] {unit}; got {table[row, column]:g} at {times[row]:g} s"
                )
        set_read_only(self, times=times, table=table)
        check_numbers(self, hub_height=("m", *POSITIVE), reference_length=("m", *POSITIVE), time_offset=("s",))
        check_flag(self, "travels")

    @classmethod
    def of(cls, columns: Mapping[str, Array | list[float]], **more: Any) -> "SeriesInflow":
        """Of columns by name.

        Parameters
        ----------
        columns : mapping
            ``time``, ``speed`` and any of `COLUMNS`, of equal lengths; what is missing is zero.
        **more
            Further parameters of the class.

        Raises
        ------
        InflowError
            If a column is unknown, missing or of another length.
        """
        unknown = [name for name in columns if name not in ("time", *COLUMNS)]
        if unknown or "time" not in columns or "speed" not in columns:
            what = f"unknown {unknown}" if unknown else "time or speed missing"
            raise InflowError(f"columns of a series must be time and speed, and may be {', '.join(COLUMNS)}; {what}")
        try:
            arrays = {name: np.asarray(values, dtype=np.float64) for name, values in columns.items()}
        except (TypeError, ValueError) as error:
            raise InflowError(f"the columns of a series must be numbers: {error}") from error
        sizes = {name: array.shape for name, array in arrays.items()}
        if len(set(sizes.values())) > 1 or arrays["time"].ndim != 1:
            raise InflowError(f"the columns of a series must be as long as each other; got {sizes}")
        table = np.zeros((arrays["time"].size, len(COLUMNS)))
        for name, array in arrays.items():
            if name != "time":
                table[:, COLUMNS.index(name)] = array
        return cls(arrays["time"], table, **more)

    @classmethod
    def ramp(
        cls,
        before: float,
        after: float,
        time: float,
        duration: float = 0.0,
        *,
        shear_exponent: float = 0.0,
        **more: Any,
    ) -> "SeriesInflow":
        """A wind speed that changes in a straight line.

        Parameters
        ----------
        before, after : float
            Speeds at hub height [m/s].
        time : float
            At which it begins to change [s].
        duration : float
            Of the change [s]; 0 is a step.
        **more
            Further parameters of the class.
        """
        start = require_number(time, "time", "s")
        length = require_number(duration, "duration", "s", 0.0)
        speeds = [require_number(v, name, "m/s", 0.0, 200.0) for v, name in ((before, "before"), (after, "after"))]
        what = f"ramp in {length:g} s" if length else "step"
        name = f"{what} from {speeds[0]:g} to {speeds[1]:g} m/s at {start:g} s"
        columns = {"time": [start, start + length], "speed": speeds, "shear_exponent": [shear_exponent] * 2}
        return cls.of(columns, **{"name": name, **more})

    @property
    def duration(self) -> float:
        """Length of the series [s]."""
        return float(self.times[-1] - self.times[0])

    @cached_property
    def mean_speed(self) -> float:
        """Mean over the series of the speed at hub height, gust included [m/s]."""
        return self._mean(self.table[:, 0] + self.table[:, 6])

    @property
    def start_speed(self) -> float:
        """Speed at hub height at time zero [m/s], the gust included."""
        at = int(np.searchsorted(self.times, self.time_offset, side="right")) - 1  # the later one of a step
        if 0 <= at < self.times.size - 1:
            low, high = self.times[at], self.times[at + 1]
            share = (self.time_offset - low) / (high - low)
        else:
            at, share = max(at, 0), 0.0
        speed = self.table[:, 0] + self.table[:, 6]
        return float(speed[at] if share == 0.0 else (1.0 - share) * speed[at] + share * speed[at + 1])

    @property
    def description(self) -> str:
        """One line that tells a person what wind this is."""
        parts = [f"{self.name}: {self._range(0, 'm/s')} at {self.hub_height:g} m"]
        for column, label, unit, scale in (
            (3, "power-law profile, exponent", "", 1.0), (4, "horizontal shear", "", 1.0),
            (5, "vertical shear", "", 1.0), (1, "direction", "deg", 180.0 / math.pi),
            (2, "vertical speed", "m/s", 1.0), (6, "gust", "m/s", 1.0), (7, "upflow", "deg", 180.0 / math.pi),
        ):  # fmt: skip
            if self.table[:, column].any():
                parts.append(f"{label} {self._range(column, unit, scale)}")
        if not self.table[:, 3:6].any():
            parts.insert(1, "uniform profile")
        if self.duration:
            parts.append(f"{self.duration:g} s")
        if self.time_offset:
            parts.append(f"from {self.time_offset:g} s")
        return ", ".join(parts)

    def _range(self, column: int, unit: str, scale: float = 1.0) -> str:
        values = scale * self.table[:, column]
        low, high = f"{values.min():.4g}", f"{values.max():.4g}"
        return f"{low if low == high else f'{low} to {high}'} {unit}".strip()

    def _mean(self, values: Array) -> float:
        return float(np.trapezoid(values, self.times) / self.duration if self.duration else values[-1])

    @cached_property
    def _travel(self) -> tuple[float, float]:
        """Time by which a point is late for its distance [s/m], and the direction in which it counts [rad]."""
        slow = not self.travels or self.mean_speed <= 0.0
        return (0.0 if slow else 1.0 / self.mean_speed), self._mean(self.table[:, 1])

    def _fill(self, rows: Array, time: float, out: Array) -> int:
        return int(series_velocity(
            rows, time + self.time_offset, self.times, self.table, self.hub_height, self.reference_length,
            *self._travel, out,
        ))  # fmt: skip

    def __setstate__(self, state: dict[str, Any]) -> None:
        for name, value in state.items():
            object.__setattr__(self, name, value)
        for array in (self.times, self.table):  # pickle drops the flag; without it another form of the kernel would run
            array.setflags(write=False)

    def _key(self) -> tuple[object, ...]:
        numbers = self.hub_height, self.reference_length, self.time_offset, self.travels, self.name
        return (*numbers, self.times.tobytes(), self.table.tobytes())

    def __eq__(self, other: object) -> bool:
        return self._key() == other._key() if isinstance(other, SeriesInflow) else NotImplemented

    def __hash__(self) -> int:
        return hash(self._key())

    def __repr__(self) -> str:
        return f"<SeriesInflow: {self.description}>"


def _check_times(times: Array) -> None:
    """Refuse times that decrease, or stand more than twice."""
    steps = np.diff(times)
    if (steps < 0.0).any():
        row = int(np.argmax(steps < 0.0))
        raise InflowError(f"times must not decrease; {times[row + 1]:g} s follows {times[row]:g} s")
    same = steps == 0.0
    if (same[1:] & same[:-1]).any():
        row = int(np.argmax(same[1:] & same[:-1]))
        raise InflowError(f"a time must be given at most twice (a step), got {times[row]:g} s more often")


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
