"""Base of the records that describe a turbine, and checks of what belongs together in them."""

from typing import Any

import numpy as np

from wt_gym.base.errors import TurbineDefinitionError
from wt_gym.base.options import ArrayOptions, Option, shown
from wt_gym.base.quantities import Array


def fail(field: str, value: Any, allowed: str) -> TurbineDefinitionError:
    """Return the error about a field: what is allowed, and the value."""
    return TurbineDefinitionError(f"{field} must be {allowed}, got {shown(value)}")


def check_number(field: str, value: Any, low: float, high: float, *, open_low: bool = False) -> float:
    """Return a finite number in [low, high], or (low, high] with ``open_low``."""
    return float(_checked(field, value, annotation="float", low=low, high=high, above=open_low))


def check_array(field: str, value: Any, *shape: int | str, **declared: Any) -> Array:
    """Return a read-only copy of an array of finite numbers; ``declared`` as of `wt_gym.base.options.Option`."""
    array: Array = _checked(field, value, shape=shape, **declared)
    return array


def _checked(field: str, value: Any, **declared: Any) -> Any:
    try:
        return Option(field, "", None, field, **declared).checked(value)
    except ValueError as error:
        raise TurbineDefinitionError(str(error)) from error


def check_symmetric(field: str, matrices: Array) -> None:
    """Require every matrix of a stack (n, k, k) to be symmetric."""
    for i, matrix in enumerate(matrices):
        finite = np.where(np.isfinite(matrix), matrix, 0.0)
        if not np.allclose(finite, finite.T, rtol=0.0, atol=1e-9 * max(np.abs(finite).max(), 1e-300)):
            raise fail(f"{field}[{i}]", matrix.tolist(), "a symmetric matrix")


def check_span(field: str, station: Array, length: float) -> None:
    """Require a grid (n,) to start at 0 and to end at ``length`` [m]."""
    if abs(station[0]) > 1e-6 * length or abs(station[-1] - length) > 1e-6 * length:
        raise fail(field, [float(station[0]), float(station[-1])], f"a grid from 0 to {length:g} m")


class ArrayRecord(ArrayOptions):
    """Base of the records that describe a turbine; their arrays are read-only."""

    error = TurbineDefinitionError
