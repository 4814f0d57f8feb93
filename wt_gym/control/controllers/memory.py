"""What a controller remembers, as numbers that can be kept and put into another one of the same kind.

All that a controller remembers lies in plain attributes (`wt_gym.control.controllers.controller`). The numbers among
them, and among the attributes of its parts, come here in a fixed order: attributes, entries of dictionaries and
sequences as they stand, arrays element by element. Whole numbers and flags stay what they are when they are put back.
"""

from __future__ import annotations

import math
from collections import deque
from functools import cached_property, partial
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from wt_gym.control.optimal.design_file import LinearDesign
from wt_gym.control.sensors import Lidar
from wt_gym.turbines import Turbine

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from numpy.typing import NDArray

    from wt_gym.control.controllers.controller import Controller

__all__ = ["Memory", "changing_parts", "memory_of", "remember"]

_CONSTANT = (str, bytes, Turbine, Lidar, LinearDesign, type(None), np.random.Generator)
_LISTS = (list, deque)
_NUMBER = (bool, int, float, np.number)


class Memory(NamedTuple):
    """Numbers of a controller.

    Attributes
    ----------
    values : numpy.ndarray, shape (n,)
    sizes : numpy.ndarray, shape (n_parts,), int
        Of the parts: numbers, arrays, and lists of numbers, which may grow and shrink.
    """

    values: NDArray[np.float64]
    sizes: NDArray[np.int_]


def memory_of(controller: Controller) -> Memory:
    """All numbers in a controller."""
    parts = [np.ravel(value).astype(np.float64) for value, _ in _numbers(controller)]
    return Memory(np.concatenate([np.zeros(0), *parts]), np.array([part.size for part in parts], dtype=int))


def changing_parts(memories: Sequence[Memory]) -> NDArray[np.bool_]:
    """Which parts differ between memories of one controller, shape (n_parts,), bool: the others are its parameters."""
    first = _split(memories[0])
    changing = np.zeros(len(first), dtype=bool)
    for memory in memories[1:]:
        for k, (part, other) in enumerate(zip(first, _split(memory), strict=True)):
            changing[k] = changing[k] or not np.array_equal(part, other, equal_nan=True)
    return changing


def _split(memory: Memory) -> list[NDArray[np.float64]]:
    return np.split(memory.values[: memory.sizes.sum()], np.cumsum(memory.sizes)[:-1])


def remember(controller: Controller, memory: Memory, changing: NDArray[np.bool_]) -> None:
    """Put numbers into a controller.

    Parameters
    ----------
    controller : Controller
        Its own copies of everything that changes.
    memory : Memory
        Of a controller of the same kind.
    changing : numpy.ndarray, shape (n_parts,), bool
        Which parts to put; the others, its parameters, stay.

    Raises
    ------
    ValueError
        If the controller has other parts.
    """
    numbers = list(_numbers(controller))
    fixed = [not isinstance(value, _LISTS) for value, _ in numbers]
    if len(numbers) != len(memory.sizes) or any(
        is_fixed and np.size(value) != size
        for is_fixed, (value, _), size in zip(fixed, numbers, memory.sizes, strict=True)
    ):
        raise ValueError(f"the controller {type(controller).__name__} has other parts than those that are remembered")
    for (value, put), part, changes in zip(numbers, _split(memory), changing, strict=True):
        if changes and not np.array_equal(np.ravel(value), part, equal_nan=True):
            put(_like(value, part))


def _like(value: Any, numbers: NDArray[np.float64]) -> Any:
    """Numbers in the form of a value."""
    if isinstance(value, np.ndarray):
        return numbers.reshape(value.shape).astype(value.dtype)
    if isinstance(value, _LISTS):
        width = len(value[0]) if len(value) and isinstance(value[0], tuple) else 0
        entries = [tuple(row) for row in numbers.reshape(-1, width).tolist()] if width else numbers.tolist()
        return deque(entries, value.maxlen) if isinstance(value, deque) else entries
    number = float(numbers[0])
    return number if isinstance(value, float) or not math.isfinite(number) else type(value)(number)


def _numbers(thing: Any) -> Iterator[tuple[Any, Callable[[Any], None]]]:
    """Numbers, arrays and lists of numbers in a thing, each with a function that replaces it."""
    for value, put in _parts(thing):
        yield from _numbers_at(value, put)


def _numbers_at(value: Any, put: Callable[[Any], None]) -> Iterator[tuple[Any, Callable[[Any], None]]]:
    """Those of a value that something holds."""
    if isinstance(value, np.ndarray):
        if value.dtype.kind in "biuf":
            yield value, put
    elif isinstance(value, _NUMBER) or _is_series(value):
        yield value, put
    elif isinstance(value, tuple):
        entries = list(value)
        for k, entry in enumerate(value):
            yield from _numbers_at(entry, partial(_put_into_tuple, entries, type(value), put, k))
    elif not (isinstance(value, _CONSTANT) or callable(value)):
        yield from _numbers(value)


def _is_series(value: Any) -> bool:
    """Whether it is a list of numbers, or of tuples of as many numbers each."""
    if not isinstance(value, _LISTS):
        return False
    if all(isinstance(entry, tuple) for entry in value):
        return len({len(entry) for entry in value}) < 2 and all(isinstance(v, _NUMBER) for e in value for v in e)
    return all(isinstance(entry, _NUMBER) for entry in value)


def _put_into_tuple(entries: list[Any], kind: type, put: Callable[[Any], None], k: int, entry: Any) -> None:
    """Replace a tuple by one with another entry, and with those that were replaced before."""
    entries[k] = entry
    put(kind(*entries) if hasattr(kind, "_fields") else kind(entries))


def _parts(thing: Any) -> Iterator[tuple[Any, Callable[[Any], None]]]:
    """What an object, a dictionary or a list holds, each with a function that replaces it."""
    if isinstance(thing, dict):
        for key in thing:
            yield thing[key], partial(thing.__setitem__, key)
    elif isinstance(thing, _LISTS):
        for k in range(len(thing)):
            yield thing[k], partial(thing.__setitem__, k)
    else:
        slots = [name for kind in type(thing).__mro__ for name in getattr(kind, "__slots__", ())]
        for name in (*getattr(thing, "__dict__", {}), *slots):
            derived = isinstance(getattr(type(thing), name, None), cached_property)  # there once it was asked for
            if hasattr(thing, name) and not derived:
                yield getattr(thing, name), partial(object.__setattr__, thing, name)
