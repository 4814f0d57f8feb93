"""Arguments of the environment of the wrong type, as JSON and command lines bring them: refused in one line each."""

from __future__ import annotations

import math
import numbers
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

__all__ = [
    "LONGEST",
    "check_duration",
    "check_flag",
    "check_mapping",
    "check_names",
    "check_number",
    "check_whole_steps",
    "real_number",
    "real_numbers",
    "shown",
]

LONGEST = 1e6
"""Longest time that is simulated in one run [s], eleven days: hours of computing at least, so that more is a slip."""


def check_number(name: str, value: Any, unit: str = "", *, finite: bool = True) -> float:
    """Return a real number, which neither a truth value nor a text is.

    Parameters
    ----------
    name : str
        Of the argument.
    value : object
    unit : str
        For the message.
    finite : bool
        Refuse NaN and infinity.

    Raises
    ------
    ValueError
    """
    found = real_number(value)
    if found is None or (finite and not math.isfinite(found)):
        kind = "a finite number" if finite else "a number"
        raise ValueError(f"{name} must be {kind}{f' in {unit}' if unit else ''}, got {shown(value)}")
    return found


def check_duration(name: str, value: Any, least: float = 0.0) -> float:
    """Return a time that can be simulated: a number of ``least`` to `LONGEST` [s].

    Parameters
    ----------
    name : str
        Of the argument.
    value : object
    least : float

    Raises
    ------
    ValueError
    """
    found = real_number(value)
    if found is None or not least <= found <= LONGEST:
        raise ValueError(f"{name} must lie between {least:g} and {LONGEST:g} s, got {shown(value)}")
    return found


def check_whole_steps(name: str, time: float, control_dt: float, least: int) -> int:
    """Return how many control steps a time is.

    Parameters
    ----------
    name : str
        Of the argument.
    time, control_dt : float
        [s]
    least : int
        Fewest steps that are allowed.

    Raises
    ------
    ValueError
        If it is not a whole number of them.
    """
    count = round(time / control_dt)
    if not (count >= least and math.isclose(count * control_dt, time, rel_tol=1e-9, abs_tol=1e-12)):
        raise ValueError(
            f"{name} must be a multiple of control_dt = {control_dt} s, at least {least} of them, got {time!r}"
        )
    return count


def check_flag(name: str, value: Any) -> bool:
    """Return a truth value, which no text or number is: "false" would count as true.

    Raises
    ------
    ValueError
    """
    if not isinstance(value, bool | np.bool_):
        raise ValueError(f"{name} must be true or false, got {shown(value)}")
    return bool(value)


def check_names(name: str, value: Any) -> tuple[str, ...]:
    """Return several texts; a text alone or a mapping is none of that kind.

    Raises
    ------
    ValueError
    """
    several = isinstance(value, Iterable) and not isinstance(value, str | bytes | Mapping)
    parts = tuple(value) if several else (None,)
    if not all(isinstance(part, str) for part in parts):
        raise ValueError(f"{name} must be a list of names, got {shown(parts if several else value)}")
    return parts


def check_mapping(name: str, value: Any) -> dict[str, float]:
    """Return a mapping of names to numbers.

    Raises
    ------
    ValueError
    """
    if not isinstance(value, Mapping):
        raise ValueError(f"{name} must map names to numbers, got {shown(value)}")
    return {key: check_number(f"{name}[{key!r}]", number, finite=False) for key, number in value.items()}


def real_number(value: Any) -> float | None:
    """Give a real number as it is; None for anything else, truth values and texts among them."""
    if isinstance(value, np.ndarray) and value.ndim == 0:
        value = value.item()
    if isinstance(value, bool) or not isinstance(value, numbers.Real):
        return None
    try:
        return float(value)
    except OverflowError:  # a whole number of more than 308 digits
        return None


def real_numbers(value: Any) -> tuple[float, ...]:
    """Give one real number or those of a flat sequence; none of them where anything else is among them."""
    several = isinstance(value, list | tuple) or (isinstance(value, np.ndarray) and value.ndim > 0)
    parts = tuple(value) if several else (value,)
    found = [real_number(part) for part in parts]
    numbers = tuple(number for number in found if number is not None)
    return numbers if len(numbers) == len(found) else ()


def shown(value: Any) -> str:
    """How a refused value stands in a message: on one line, and shortened."""
    return f"{value!r:.100}".replace("\n", " ")
