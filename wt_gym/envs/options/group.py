"""Options of the environment in groups: each field documented once, checked when it is made, with a form in JSON."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, fields
from functools import wraps
from textwrap import fill
from typing import Any, ClassVar, NamedTuple, Self, TypeVar, dataclass_transform

import numpy as np

from wt_gym.base.errors import did_you_mean
from wt_gym.envs.arguments import shown

__all__ = ["Described", "OptionGroup", "described", "option", "option_group", "plain_value", "section"]

T = TypeVar("T")
_KEY = "option"


@dataclass(frozen=True)
class _Words:
    """What is said about a field."""

    kind: str
    meaning: str
    flat: str
    unit: str
    allowed: str


class Described(NamedTuple):
    """A field of a group, as documentation shows it.

    Attributes
    ----------
    name : str
        Within its group.
    flat : str
        As an argument of the environment by itself.
    kind, unit, allowed, meaning : str
        Unit and allowed values are empty where the type says all.
    default : object
    """

    name: str
    flat: str
    kind: str
    unit: str
    allowed: str
    meaning: str
    default: Any

    @property
    def default_text(self) -> str:
        """Default in a few characters."""
        text = repr(self.default)
        return text if len(text) < 40 else f"{text[:20]} … {text[-8:]}"

    @property
    def text(self) -> str:
        """Meaning, unit, allowed values and default in one paragraph."""
        text = f"{self.meaning} [{self.unit}]." if self.unit else f"{self.meaning}."
        allowed = f" Allowed: {self.allowed}." if self.allowed else ""
        return f"{text}{allowed} Default: ``{self.default_text}``."


def option(kind: str, meaning: str, *, default: Any, flat: str = "", unit: str = "", allowed: str = "") -> Any:
    """Field of a group.

    Parameters
    ----------
    kind : str
        Type in words.
    meaning : str
        What it is, without a full stop at the end.
    default : object
    flat : str
        Its name as an argument of the environment by itself; "" for the same.
    unit : str
    allowed : str
        Range.
    """
    return field(default=default, metadata={_KEY: _Words(kind, meaning, flat, unit, allowed)})


def described(group: Any) -> tuple[Described, ...]:
    """Fields of a group with what is said about them, in order."""
    found = [(one, one.metadata[_KEY]) for one in fields(group) if _KEY in one.metadata]
    return tuple(
        Described(one.name, words.flat or one.name, words.kind, words.unit, words.allowed, words.meaning, one.default)
        for one, words in found
    )


def section(entries: Iterable[tuple[str, str, str]], indent: str = "    ") -> str:
    """Entries (names, type, text) in the form of a section of NumPy's docstrings."""
    lines = []
    for name, kind, text in entries:
        inner = f"{indent}    "
        lines += [
            f"{indent}{name} : {kind}",
            fill(text, 120, initial_indent=inner, subsequent_indent=inner, break_on_hyphens=False),
        ]
    return "\n".join(lines)


@dataclass_transform(frozen_default=True, field_specifiers=(option, field))
def option_group(cls: type[T]) -> type[T]:
    """Make a frozen dataclass that remembers which of its fields were given, documented by what its fields say."""
    made = dataclass(frozen=True, repr=False)(cls)
    names, plain = [one.name for one in fields(made)], made.__init__  # type: ignore[arg-type]

    @wraps(plain)
    def init(self: Any, *args: Any, **kwargs: Any) -> None:
        if refused := [name for name in kwargs if name not in names]:
            raise TypeError(self._unknown(refused[0]))
        object.__setattr__(self, "_given", frozenset((*names[: len(args)], *kwargs)))
        plain(self, *args, **kwargs)

    made.__init__ = init  # type: ignore[method-assign]
    entries = section((one.name, one.kind, one.text) for one in described(made))
    made.__doc__ = f"{(cls.__doc__ or '').rstrip()}\n\n    Attributes\n    ----------\n{entries}\n    "
    return made


class OptionGroup:
    """Base of the groups of options.

    A group remembers which of its fields were given: those take the place of what an id of the environment says, the
    others do not.
    """

    title: ClassVar[str]
    """Argument of the environment that takes the group."""
    objects: ClassVar[dict[str, type]] = {}
    """Classes whose objects have a form in JSON, their arguments, by the fields that take them."""
    _given: frozenset[str]

    def __post_init__(self) -> None:
        """Check every field by itself and with the others of the group."""
        for one in described(self):
            self._set(one.name, _kept(getattr(self, one.name)))
        for name, kind in self.objects.items():
            value, flat = getattr(self, name), {one.name: one.flat for one in described(self)}[name]
            if isinstance(value, Mapping):
                try:
                    self._set(name, kind(**{key: _kept(part) for key, part in value.items()}))
                except (TypeError, ValueError) as error:
                    raise ValueError(f"{flat} must be a {kind.__name__}, or its arguments by name: {error}") from error
        self.check()

    def check(self) -> None:
        """Refuse what has no meaning; values that are numbers become such."""

    def __repr__(self) -> str:
        """Say what was given."""
        given = [
            f"{name}={value!r}" if isinstance(value, OptionGroup) else f"{name}={shown(value)}"
            for name, value in self.given.items()
        ]
        return f"{type(self).__name__}({', '.join(given)})"

    @property
    def given(self) -> dict[str, Any]:
        """Fields that were given when it was made, with their values."""
        return {one.name: getattr(self, one.name) for one in described(self) if one.name in self._given}

    def as_dict(self) -> dict[str, Any]:
        """Fields that were given, as values of JSON.

        Returns
        -------
        dict
            `from_dict` makes an equal group of it.

        Raises
        ------
        ValueError
            If an object has no form in JSON; the message names its field.
        """
        classes = tuple(self.objects.values())
        return {
            name: plain_value(
                f"{self.title}.{name}",
                _arguments_of(value) if isinstance(value, classes) else value,
            )
            for name, value in self.given.items()
        }

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> Self:
        """Make a group of a mapping of names of fields to values.

        Raises
        ------
        ValueError
            If there is no such field; the message names the one that it resembles.
        """
        return cls(**cls.named(values))

    @classmethod
    def named(cls, values: Any) -> Mapping[str, Any]:
        """Values by names of fields, not checked any further.

        Raises
        ------
        ValueError
            If they are no mapping, or there is no such field; the message names the one that it resembles.
        """
        if not isinstance(values, Mapping):
            raise ValueError(f"{cls.title} must be a {cls.__name__} or a mapping of options, got {shown(values)}")
        known = [one.name for one in described(cls)]
        for name in values:
            if name not in known:
                raise ValueError(cls._unknown(name))
        return values

    @classmethod
    def _unknown(cls, name: object) -> str:
        """Message about a name of no field; the flat name of one is known too."""
        by_flat = {one.flat: one.name for one in described(cls)}
        near = (
            f"; did you mean {by_flat[str(name)]!r}?" if name in by_flat else did_you_mean(name, by_flat.values(), ".")
        )
        return f"{cls.title} has no option {name!r}{near} Its options are {', '.join(by_flat.values())}"

    def to_json(self) -> str:
        """Text of `as_dict`."""
        return json.dumps(self.as_dict())

    @classmethod
    def from_json(cls, text: str) -> Self:
        """Make a group of the text of `to_json`."""
        return cls.from_dict(json.loads(text))

    def _set(self, name: str, value: Any) -> None:
        """Put a value into a field while the group is made."""
        object.__setattr__(self, name, value)

    def _set_all(self, check: Callable[..., Any], *names: str, **options: Any) -> None:
        """Put fields through a check that takes name and value; None stays where it is the default."""
        for one in described(self):
            value = getattr(self, one.name)
            if one.name in names and not (value is None and one.default is None):
                self._set(one.name, check(one.flat, value, **options))


def _arguments_of(value: Any) -> dict[str, Any]:
    """What a dataclass is made with."""
    return {one.name: getattr(value, one.name) for one in fields(value)}


def _kept(value: Any) -> Any:
    """A value that can be read more than once, and is the same from JSON: iterators and lists become tuples."""
    return tuple(value) if isinstance(value, Iterator | list) else value


def plain_value(name: str, value: Any) -> Any:
    """Form of a value in JSON.

    Parameters
    ----------
    name : str
        For the message.
    value : object

    Raises
    ------
    ValueError
        If it has none.
    """
    if value is None or isinstance(value, bool | int | float | str):
        return value
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, np.ndarray):
        return value.tolist()
    if isinstance(value, os.PathLike):
        return os.fspath(value)
    if isinstance(value, list | tuple | range):
        return [plain_value(f"{name}[{k}]", part) for k, part in enumerate(value)]
    if isinstance(value, Mapping) and all(isinstance(key, str) for key in value):
        return {key: plain_value(f"{name}[{key!r}]", part) for key, part in value.items()}
    raise ValueError(f"{name} must be a number, a text, a list or a mapping for a form in JSON, got {shown(value)}")
