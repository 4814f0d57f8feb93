"""Fields of the dataclasses that recorded numbers name: a new option must not make all of them out of date."""

from dataclasses import field, fields

__all__ = ["counting_fields", "later_field"]

_LATER = "later"


def later_field(default):
    """Field of a dataclass that came after numbers had been recorded: its default is what they were made with."""
    return field(default=default, metadata={_LATER: True})


def counting_fields(value):
    """Fields of a dataclass instance that tell it from others, in their order: without later ones at their default."""
    return [f for f in fields(value) if not (f.metadata.get(_LATER) and getattr(value, f.name) == f.default)]
