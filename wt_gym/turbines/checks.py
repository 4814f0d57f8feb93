"""Checks shared by the turbine dataclasses: each failure names the field, what was given and what is allowed."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from wt_gym.base.errors import TurbineDefinitionError

__all__ = [
    "ArrayRecord", "check_array", "check_ascending", "check_number", "check_span", "check_symmetric", "fail", "short",
]  # fmt: skip


def short(value: Any, limit: int = 80) -> str:
    """Return ``repr(value)`` cut to ``limit`` characters, so that a long table does not drown the message."""
    text = repr(value)
    return text if len(text) <= limit else text[: limit - 3] + "..."


def fail(field: str, value: Any, allowed: str) -> TurbineDefinitionError:
    """Build (not raise) the one error of this package: field, value given, values allowed."""
    return TurbineDefinitionError(f"{field}: got {short(value)}, must be {allowed}")


def check_number(field: str, value: Any, low: float, high: float, *, open_low: bool = False) -> float:
    """Return ``value`` as float if it is a finite number in [low, high] (or (low, high] with ``open_low``).

    Raises
    ------
    TurbineDefinitionError
        If it is not a number, not finite, or out of range.
    """
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
    """Return ``value`` as a read-only float64 array of the given shape.

    Parameters
    ----------
    value : array_like
        The data; always copied, so that nobody else can write to it.
    shape : sequence of int or None
        Expected shape; ``None`` stands for any length of at least one.
    low, high : float
        Inclusive range of every entry.
    infinite : bool
        Whether ``+inf`` is allowed (a rigid section property).

    Raises
    ------
    TurbineDefinitionError
        On wrong type, shape, range, or entries that are not finite.
    """
    try:
        array = np.array(value, dtype=np.float64, order="C")
    except (TypeError, ValueError) as error:
        raise fail(field, value, f"an array of numbers with shape {_shape_text(shape)}") from error
    matches = array.ndim == len(shape) and all(
        n >= 1 if size is None else n == size for n, size in zip(array.shape, shape, strict=True)
    )
    if not matches:
        raise fail(field, f"shape {array.shape}", f"shape {_shape_text(shape)}")
    bad = np.isnan(array) | (~np.isfinite(array) & (not infinite)) | (array < low) | (array > high)
    if np.any(bad):
        index = tuple(int(i) for i in np.argwhere(bad)[0])
        where = f"{field}[{', '.join(map(str, index))}]"
        raise fail(where, float(array[index]), f"a {'' if infinite else 'finite '}number in [{low:g}, {high:g}]")
    array.flags.writeable = False
    return array


def check_ascending(field: str, array: NDArray[np.float64]) -> None:
    """Require strictly ascending entries (at least two).

    Raises
    ------
    TurbineDefinitionError
        Naming the first entry that does not exceed the one before it.
    """
    if array.size < 2:
        raise fail(field, array.tolist(), "at least two strictly ascending numbers")
    steps = np.diff(array)
    if np.any(steps <= 0.0):
        i = int(np.argmax(steps <= 0.0))
        raise fail(f"{field}[{i + 1}]", float(array[i + 1]), f"a number above {field}[{i}] = {array[i]:g} (ascending)")


def check_symmetric(field: str, matrices: NDArray[np.float64]) -> None:
    """Require every matrix of a stack (n, k, k) to be symmetric.

    Raises
    ------
    TurbineDefinitionError
        Naming the first matrix that is not.
    """
    for i, matrix in enumerate(matrices):
        finite = np.where(np.isfinite(matrix), matrix, 0.0)
        if not np.allclose(finite, finite.T, rtol=0.0, atol=1e-9 * max(np.abs(finite).max(), 1e-300)):
            raise fail(f"{field}[{i}]", matrix.tolist(), "a symmetric matrix")


def check_span(field: str, station: NDArray[np.float64], length: float) -> None:
    """Require a grid (n,) to start at 0 and to end at ``length`` [m].

    Raises
    ------
    TurbineDefinitionError
        Giving both ends and the length.
    """
    if abs(station[0]) > 1e-6 * length or abs(station[-1] - length) > 1e-6 * length:
        raise fail(field, [float(station[0]), float(station[-1])], f"a grid from 0 to {length:g} m")


def _summary(value: Any) -> str:
    if isinstance(value, np.ndarray):
        return repr(value.tolist()) if value.size <= 9 else f"<array {value.shape}>"
    if isinstance(value, tuple) and value and isinstance(value[0], ArrayRecord):
        return f"<{len(value)} of {type(value[0]).__name__}>"
    return repr(value)


def _shape_text(shape: Sequence[int | None]) -> str:
    return "(" + ", ".join("n" if size is None else str(size) for size in shape) + ")"


class ArrayRecord:
    """Base of the frozen dataclasses that hold arrays: keeps them read-only through pickling and copying.

    NumPy does not carry the read-only flag through pickle or ``copy.deepcopy``; worker processes would otherwise get
    a turbine whose tables can be changed by accident.
    """

    __dataclass_fields__: ClassVar[dict[str, dataclasses.Field[Any]]]  # of the subclasses

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
