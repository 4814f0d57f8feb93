"""Fields of the dataclasses that recorded numbers name: a new option must not make all of them out of date."""

from __future__ import annotations

from dataclasses import field, fields
from typing import TYPE_CHECKING, Any, TypeVar

if TYPE_CHECKING:
    from dataclasses import Field

    from _typeshed import DataclassInstance

__all__ = ["counting_fields", "later_field"]

_LATER = "later"
T = TypeVar("T")


def later_field(default: T) -> T:
    """Field of a dataclass that came after numbers had been recorded: its default is what they were made with."""
    made: T = field(default=default, metadata={_LATER: True})
    return made


def counting_fields(value: DataclassInstance) -> list[Field[Any]]:
    """Fields of a dataclass instance that tell it from others, in their order: without later ones at their default."""
    return [f for f in fields(value) if not (f.metadata.get(_LATER) and getattr(value, f.name) == f.default)]
