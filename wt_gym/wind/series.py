"""A wind that is the same over the rotor except for shear, and follows a time series: steps, ramps, records, events."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from wt_gym.base.errors import InflowError
from wt_gym.wind.inflow_kernels import series_velocity
from wt_gym.wind.protocol import PointInflow, require_number

if TYPE_CHECKING:
    from collections.abc import Mapping
    from typing import Any

    from numpy.typing import NDArray

__all__ = ["COLUMNS", "SeriesInflow"]

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
    travels : bool
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

    times: NDArray[np.float64]
    table: NDArray[np.float64]
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
        for name, array in (("times", times), ("table", table)):
            array.setflags(write=False)
            object.__setattr__(self, name, array)
        for name, unit in (("hub_height", "m"), ("reference_length", "m")):
            number = require_number(getattr(self, name), name, unit, 0.0, open_minimum=True)
            object.__setattr__(self, name, number)
        object.__setattr__(self, "time_offset", require_number(self.time_offset, "time_offset", "s"))
        if not isinstance(self.travels, bool):
            raise InflowError(f"travels must be True or False; got {self.travels!r}")

    @classmethod
    def of(cls, columns: Mapping[str, NDArray[np.float64] | list[float]], **more: Any) -> SeriesInflow:
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
    def step(
        cls, before: float, after: float, time: float, *, shear_exponent: float = 0.0, **more: Any
    ) -> SeriesInflow:
        """A step of the wind speed.

        Parameters
        ----------
        before, after : float
            Speeds at hub height [m/s].
        time : float
            Of the step [s].
        shear_exponent : float
        **more
            Further parameters of the class.
        """
        return cls.ramp(before, after, time, 0.0, shear_exponent=shear_exponent, **more)

    @classmethod
    def ramp(
        cls, before: float, after: float, time: float, duration: float, *, shear_exponent: float = 0.0, **more: Any
    ) -> SeriesInflow:
        """A wind speed that changes in a straight line.

        Parameters
        ----------
        before, after : float
            Speeds at hub height [m/s].
        time : float
            At which it begins to change [s].
        duration : float
            Of the change [s]; 0 is a step.
        shear_exponent : float
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

    def _mean(self, values: NDArray[np.float64]) -> float:
        return float(np.trapezoid(values, self.times) / self.duration if self.duration else values[-1])

    @cached_property
    def _travel(self) -> tuple[float, float]:
        """Time by which a point is late for its distance [s/m], and the direction in which it counts [rad]."""
        slow = not self.travels or self.mean_speed <= 0.0
        return (0.0 if slow else 1.0 / self.mean_speed), self._mean(self.table[:, 1])

    def _fill(self, rows: NDArray[np.float64], time: float, out: NDArray[np.float64]) -> int:
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


def _check_times(times: NDArray[np.float64]) -> None:
    """Refuse times that decrease, or stand more than twice."""
    steps = np.diff(times)
    if (steps < 0.0).any():
        row = int(np.argmax(steps < 0.0))
        raise InflowError(f"times must not decrease; {times[row + 1]:g} s follows {times[row]:g} s")
    same = steps == 0.0
    if (same[1:] & same[:-1]).any():
        row = int(np.argmax(same[1:] & same[:-1]))
        raise InflowError(f"a time must be given at most twice (a step), got {times[row]:g} s more often")
