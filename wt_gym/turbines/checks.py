"""Checks of turbine data: each failure names the field, what was given and what is allowed.

A record declares its fields: the annotation has type and range, the text under it meaning and unit.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from functools import cache
from types import NoneType
from typing import Any, ClassVar, Protocol, get_args, get_type_hints

import numpy as np
from numpy.typing import ArrayLike, NDArray

from wt_gym.base.errors import TurbineDefinitionError

__all__ = [
    "ArrayRecord", "OneOf", "Range", "Table", "check_array", "check_ascending", "check_number", "check_span",
    "check_symmetric", "fail", "short",
]  # fmt: skip


def short(value: Any, limit: int = 80) -> str:
    """Return ``repr(value)`` cut to ``limit`` characters, so that a long table does not drown the message."""
    text = repr(value)
    return text if len(text) <= limit else text[: limit - 3] + "..."


def fail(field: str, value: Any, allowed: str) -> TurbineDefinitionError:
    """Build (not raise) the one error of this package: field, value given, values allowed."""
    return TurbineDefinitionError(f"{field}: got {short(value)}, must be {allowed}")


def check_number(field: str, value: Any, low: float, high: float, *, open_low: bool = False) -> float:
    """Return ``value`` as float if it is a finite number in [low, high] (or (low, high] with ``open_low``)."""
    allowed = f"a finite number in {'(' if open_low else '['}{low:g}, {high:g}]"
    if isinstance(value, bool) or not isinstance(value, (int, float, np.integer, np.floating)):
        raise fail(field, value, allowed)
    number = float(value)
    if not math.isfinite(number) or not low <= number <= high or (open_low and number == low):
        raise fail(field, value, allowed)
    return number


def check_array(
    field: str,
    value: ArrayLike,
    shape: Sequence[int | None],
    *,
    low: float = -math.inf,
    high: float = math.inf,
    infinite: bool = False,
) -> NDArray[np.float64]:
    """Return ``value`` as a read-only float64 array of the given shape, always a copy.

    Parameters
    ----------
    shape : sequence of int or None
        ``None`` stands for any length of at least one.
    low, high : float
        Inclusive range of every entry.
    infinite : bool
        Whether ``+inf`` is allowed (a rigid section property).
    """
    text = "(" + ", ".join("n" if size is None else str(size) for size in shape) + ")"
    try:
        array = np.array(value, dtype=np.float64, order="C")
    except (TypeError, ValueError) as error:
        raise fail(field, value, f"an array of numbers with shape {text}") from error
    matches = array.ndim == len(shape) and all(
        n >= 1 if size is None else n == size for n, size in zip(array.shape, shape, strict=True)
    )
    if not matches:
        raise fail(field, f"shape {array.shape}", f"shape {text}")
    bad = np.isnan(array) | (~np.isfinite(array) & (not infinite)) | (array < low) | (array > high)
    if np.any(bad):
        index = tuple(int(i) for i in np.argwhere(bad)[0])
        where = f"{field}[{', '.join(map(str, index))}]"
        raise fail(where, float(array[index]), f"a {'' if infinite else 'finite '}number in [{low:g}, {high:g}]")
    array.flags.writeable = False
    return array


def check_ascending(field: str, array: NDArray[np.float64]) -> None:
    """Require strictly ascending entries (at least two)."""
    if array.size < 2:
        raise fail(field, array.tolist(), "at least two strictly ascending numbers")
    steps = np.diff(array)
    if np.any(steps <= 0.0):
        i = int(np.argmax(steps <= 0.0))
        raise fail(f"{field}[{i + 1}]", float(array[i + 1]), f"a number above {field}[{i}] = {array[i]:g} (ascending)")


def check_symmetric(field: str, matrices: NDArray[np.float64]) -> None:
    """Require every matrix of a stack (n, k, k) to be symmetric."""
    for i, matrix in enumerate(matrices):
        finite = np.where(np.isfinite(matrix), matrix, 0.0)
        if not np.allclose(finite, finite.T, rtol=0.0, atol=1e-9 * max(np.abs(finite).max(), 1e-300)):
            raise fail(f"{field}[{i}]", matrix.tolist(), "a symmetric matrix")


def check_span(field: str, station: NDArray[np.float64], length: float) -> None:
    """Require a grid (n,) to start at 0 and to end at ``length`` [m]."""
    if abs(station[0]) > 1e-6 * length or abs(station[-1] - length) > 1e-6 * length:
        raise fail(field, [float(station[0]), float(station[-1])], f"a grid from 0 to {length:g} m")


class _Kind(Protocol):
    """What a field may hold."""

    def check(self, field: str, value: Any, sizes: dict[str, int]) -> Any:
        """Return the value to be stored; ``sizes`` has the lengths of the arrays before it by name."""


@dataclasses.dataclass(frozen=True)
class Range:
    """Finite numbers in [low, high], or (low, high] with ``above``; whole ones only with ``whole``."""

    low: float
    high: float
    above: bool = False
    whole: bool = False

    def check(self, field: str, value: Any, sizes: dict[str, int]) -> float:
        """Return the number."""
        if not self.whole:
            return check_number(field, value, self.low, self.high, open_low=self.above)
        if isinstance(value, bool) or not isinstance(value, int) or not self.low <= value <= self.high:
            raise fail(field, value, f"an integer from {self.low:g} to {self.high:g}")
        return value


class Table:
    """Arrays of finite numbers in [low, high].

    Parameters
    ----------
    *shape : int or str
        A name stands for the same length in all tables of a record.
    ascending : int
        Least number of entries of a grid, whose entries ascend; 0: no grid.
    infinite : bool
        Whether ``+inf`` is allowed.
    """

    def __init__(
        self,
        *shape: int | str,
        low: float = -math.inf,
        high: float = math.inf,
        ascending: int = 0,
        infinite: bool = False,
    ):
        self.shape, self.low, self.high = shape, low, high
        self.ascending, self.infinite = ascending, infinite

    def check(self, field: str, value: ArrayLike, sizes: dict[str, int]) -> NDArray[np.float64]:
        """Return a read-only copy of the array."""
        shape = [sizes.get(size) if isinstance(size, str) else size for size in self.shape]
        array = check_array(field, value, shape, low=self.low, high=self.high, infinite=self.infinite)
        if array.size < self.ascending or (self.ascending and array.size > 1):
            check_ascending(field, array)
        sizes |= {size: n for size, n in zip(self.shape, array.shape, strict=True) if isinstance(size, str)}
        return array


class OneOf:
    """Words."""

    def __init__(self, *words: str):
        self.words = words

    def check(self, field: str, value: Any, sizes: dict[str, int]) -> Any:
        """Return the word."""
        if value not in self.words:
            raise fail(field, value, " or ".join(map(repr, self.words)))
        return value


@dataclasses.dataclass(frozen=True)
class _Instance:
    """Instances of a class, such as another record."""

    kind: type[Any]
    optional: bool

    def check(self, field: str, value: Any, sizes: dict[str, int]) -> Any:
        """Return the instance."""
        if not isinstance(value, self.kind):
            words = ["True", "False"] if self.kind is bool else [self.kind.__name__]
            raise fail(field, value, " or ".join([*words, "None"] if self.optional else words))
        return value


@cache
def _declared(record: type[Any]) -> tuple[tuple[str, bool, _Kind], ...]:
    """Return name, whether None is allowed, and kind of the fields that a record declares."""
    hints = get_type_hints(record, include_extras=True)
    out: list[tuple[str, bool, _Kind]] = []
    for field in dataclasses.fields(record):
        hint, kinds = hints[field.name], getattr(hints[field.name], "__metadata__", ())
        parts = get_args(get_args(hint)[0] if kinds else hint)
        optional = NoneType in parts
        plain = next((part for part in parts if part is not NoneType), None) if optional else hint
        if kinds:
            out.append((field.name, optional, kinds[0]))
        elif isinstance(plain, type) and (plain is bool or dataclasses.is_dataclass(plain)):
            out.append((field.name, optional, _Instance(plain, optional)))
    return tuple(out)


def _summary(value: Any) -> str:
    if isinstance(value, np.ndarray):
        return repr(value.tolist()) if value.size <= 9 else f"<array {value.shape}>"
    if isinstance(value, tuple) and value and isinstance(value[0], ArrayRecord):
        return f"<{len(value)} of {type(value[0]).__name__}>"
    return repr(value)


class ArrayRecord:
    """Base of the frozen dataclasses that describe a turbine: checks the fields and keeps arrays read-only.

    NumPy does not carry the read-only flag through pickle or ``copy.deepcopy``; worker processes would otherwise get
    a turbine whose tables can be changed by accident.
    """

    __dataclass_fields__: ClassVar[dict[str, dataclasses.Field[Any]]]  # of the subclasses

    def __post_init__(self) -> None:
        """Check each field as it is declared, then what belongs together."""
        sizes: dict[str, int] = {}
        for name, optional, kind in _declared(type(self)):  # type: ignore[arg-type]  # hashable
            value = getattr(self, name)
            if value is not None or not optional:
                self._set(**{name: kind.check(f"{self._label()}.{name}", value, sizes)})
        self._check()

    def _check(self) -> None:
        """Check what belongs together."""

    def _label(self) -> str:
        """Name in messages."""
        return type(self).__name__

    def __copy__(self) -> ArrayRecord:
        """Return the record itself: nothing in it changes."""
        return self

    def __deepcopy__(self, memo: dict[int, object]) -> ArrayRecord:
        """Return the record itself: nothing in it changes."""
        return self

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Restore the fields and take the write permission from every array."""
        for name, value in state.items():
            if isinstance(value, np.ndarray):
                value.flags.writeable = False
            object.__setattr__(self, name, value)

    def __repr__(self) -> str:
        """Return the fields, tables only by their shape."""
        fields = ", ".join(f"{item.name}={_summary(getattr(self, item.name))}" for item in dataclasses.fields(self))
        return f"{type(self).__name__}({fields})"

    def _set(self, **fields: Any) -> None:
        """Store checked values in a frozen dataclass (only used while it is being built)."""
        for name, value in fields.items():
            object.__setattr__(self, name, value)
