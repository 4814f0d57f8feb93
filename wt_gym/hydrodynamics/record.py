"""Base of the records of this package."""

from typing import Any, ClassVar

import numpy as np

from wt_gym.base.errors import TurbineDefinitionError
from wt_gym.base.options import ArrayOptions, options_of, shown


class Record(ArrayOptions):
    """Validated record with read-only arrays; records with equal fields are equal."""

    error: ClassVar[type[Exception]] = TurbineDefinitionError

    def __eq__(self, other: object) -> bool:
        if type(other) is not type(self):
            return NotImplemented
        names = [declared.name for declared in options_of(self)]
        return all(_is_equal(getattr(self, name), getattr(other, name)) for name in names)

    def __hash__(self) -> int:
        values = (getattr(self, declared.name) for declared in options_of(self))
        return hash((type(self), *(value.tobytes() if isinstance(value, np.ndarray) else value for value in values)))


def _is_equal(value: Any, other: Any) -> bool:
    if isinstance(value, np.ndarray) and isinstance(other, np.ndarray):
        return np.array_equal(value, other)
    return bool(value == other) and not isinstance(value, np.ndarray)


def fail(field: str, value: Any, allowed: str) -> TurbineDefinitionError:
    """Return the error about a field: what is allowed, and the value."""
    return TurbineDefinitionError(f"{field} must be {allowed}, got {shown(value)}")
