"""Declared options: a field states its meaning, unit, range and choices once, and everything else follows from that.

A record of options is a subclass of `Options` under `option_record`:

    @option_record
    class TrainingOptions(Options):
        \"\"\"Settings of a training.\"\"\"

        title = "training"

        seed: int = option("random numbers of policy and environments", default=0, low=0, high=2**31)
        learning: str = option("algorithm", default="PPO", choices=("PPO", "SAC"))
        max_seconds: float | None = option("wall time; None: no limit", default=None, unit="s", low=0.0)

From the declarations follow the checks with their messages, the class documentation, the JSON form, the options of a
command (`add_options`, `chosen_options`) and one property test (``envs_tests/unit/test_options.py``). The annotation
decides what a value may be:

========================== ============================================================================
``bool``                   true or false, no number and no text
``int``, ``float``         a number within ``low`` and ``high``; an integral one; a finite one
``str``                    a text, one of ``choices`` where there are any
``Path``                   a text or a path
``tuple[float, float]``    two numbers in order, each within the range
``float | tuple[float, float]``  a number or two in order
``tuple[int, ...]``, ``tuple[float, ...]``, ``tuple[str, ...]``  several values, each as above
``tuple[int, int]``, ``tuple[int, int, int]``  as many integral numbers, each within the range
``Mapping[str, float]``    names, of ``choices`` where there are any, to numbers within the range
``NDArray[np.float64]``    with a ``shape``: a read-only copy of an array of finite numbers within the range
``… | None``               None too
========================== ============================================================================

Other annotations are not checked here but by the ``check`` of the option, a function from value to value, which
raises a `ValueError` without the name of the option, or by `Options.check`, which sees all fields together.
"""

import argparse
import json
import math
import numbers
import os
import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import MISSING, dataclass, field, fields
from functools import wraps
from textwrap import fill
from typing import Any, ClassVar, Self, TypeVar, cast, dataclass_transform

import numpy as np
from numpy.typing import NDArray

from wt_gym.base.errors import did_you_mean

LONGEST = 1e6
"""Longest time that is simulated in one run [s], eleven days: hours of computing at least, so that more is a slip."""
T = TypeVar("T")
_KEY = "option"


@dataclass(frozen=True)
class Option:
    """Declaration of a field.

    Attributes
    ----------
    name : str
        Within its record.
    meaning : str
        Without a full stop at the end.
    default : object
    flat : str
        As an argument of the environment, or an option of a command, by itself.
    kind : str
        Type as documentation shows it.
    unit : str
        "" or "-" where the value has none.
    low, high : float
        Range of the number, or of each of several.
    above, below : bool
        The ends ``low`` and ``high`` themselves are refused.
    choices : tuple of str
        Allowed texts, or names of a mapping.
    check : callable or None
        From a value that fits the annotation to the value that is stored.
    allowed_text : str
        Allowed values in words where the declaration does not say all.
    annotation : str
        Of the field, without spaces.
    kinds : tuple of type
        Classes of the objects that the annotation allows; without them objects are not checked here.
    otherwise : str
        Meaning of the default None.
    in_use : callable or None
        From a subject, as a turbine, to the value that it has where the default is None; None where it has none.
    only_of : callable or None
        From a subject to whether it has this option; None: every subject does.
    shape : tuple of int and str
        Of an array; a name stands for the same length, at least one, in all arrays of a record.
    ascending : int
        Least number of entries of a grid, whose entries ascend strictly; 0: no grid.
    infinite : bool
        Infinity is an entry, as of a rigid section.
    """

    name: str
    meaning: str
    default: Any
    flat: str = ""
    kind: str = ""
    unit: str = ""
    low: float = -math.inf
    high: float = math.inf
    above: bool = False
    below: bool = False
    choices: tuple[str, ...] = ()
    check: Callable[[Any], Any] | None = None
    allowed_text: str = ""
    annotation: str = ""
    kinds: tuple[type, ...] = ()
    otherwise: str = ""
    in_use: Callable[[Any], Any] | None = None
    only_of: Callable[[Any], bool] | None = None
    shape: tuple[int | str, ...] = ()
    ascending: int = 0
    infinite: bool = False

    @property
    def takes_none(self) -> bool:
        """None is a value."""
        return "None" in self._parts

    @property
    def _parts(self) -> list[str]:
        return self.annotation.split("|")

    @property
    def range_text(self) -> str:
        """Range of the number in words; empty where all numbers are allowed."""
        unit = f" {self.unit}" if self.unit not in ("", "-") else ""
        low, high = (str(end) if isinstance(end, int) and float(f"{end:g}") != end else f"{end:g}"
                     for end in (self.low, self.high))  # fmt: skip
        if self.low == -math.inf and self.high == math.inf:
            return f"in{unit}" if unit else ""
        if self.high == math.inf:
            return f"{'above' if self.above else 'of at least'} {low}{unit}"
        if self.low == -math.inf:
            return f"{'below' if self.below else 'of at most'} {high}{unit}"
        if not (self.above or self.below):
            return f"from {low} to {high}{unit}"
        return f"{'above' if self.above else 'at least'} {low} and {'below' if self.below else 'at most'} {high}{unit}"

    @property
    def allowed(self) -> str:
        """Allowed values in words, as messages name them."""
        if self.allowed_text:
            return self.allowed_text
        words = [word for part in self._parts if (word := self._words_of(part))]
        if self.takes_none:
            words.append(f"None ({self.otherwise})" if self.otherwise else "None")
        return words[0] if len(words) == 1 else f"{', '.join(words[:-1])} or {words[-1]}" if words else ""

    def _words_of(self, part: str) -> str:
        numbers_text, names = self.range_text, ", ".join(self.choices)
        if part == "str" and self.choices:
            return f"one of {names}"
        if part.startswith("tuple[") and self.kinds:
            return f"at least one {self.kinds[0].__name__}"
        if part == "tuple[str,...]":
            return f"some of {names}, each once" if names else "names"
        if part == "Mapping[str,float]":
            return f"numbers {numbers_text} by name{f', of {names}' if names else ''}".replace("  ", " ")
        simple = {
            "bool": "true or false", "int": f"a whole number {numbers_text}", "float": f"a number {numbers_text}",
            "str": "a text", "Path": "a path", "tuple[float,float]": f"two numbers (low, high) {numbers_text}",
            "tuple[int,int]": f"two whole numbers {numbers_text}",
            "tuple[int,int,int]": f"three whole numbers {numbers_text}",
            "tuple[int,...]": f"whole numbers {numbers_text}", "tuple[float,...]": f"numbers {numbers_text}",
        }  # fmt: skip
        return simple.get(part, f"a {part}" if part.isidentifier() and part != "None" else "").strip()

    def default_of(self, subject: Any) -> Any:
        """Default; where it is None, the value that a subject has by itself; None without a subject."""
        return self.in_use(subject) if self.default is None and self.in_use and subject is not None else self.default

    def belongs_to(self, subject: Any) -> bool:
        """Whether a subject has this option; without one, whether any does."""
        return subject is None or self.only_of is None or self.only_of(subject)

    @property
    def default_text(self) -> str:
        """Default in a few characters."""
        text = repr(self.default)
        return text if len(text) < 40 else f"{text[:20]} … {text[-8:]}"

    @property
    def text(self) -> str:
        """Meaning, unit, allowed values and default in one paragraph."""
        text = f"{self.meaning} [{self.unit}]." if self.unit else f"{self.meaning}."
        range_text = self.allowed_text or (self.range_text if not self.range_text.startswith("in ") else "")
        allowed = f" Allowed: {range_text}." if range_text else ""
        if self.default is MISSING:
            return f"{text}{allowed}"
        default = self.otherwise if self.default is None and self.otherwise else f"``{self.default_text}``"
        return f"{text}{allowed} Default: {default}."

    def checked(self, value: Any, sizes: dict[str, int] | None = None) -> Any:
        """Return the value as it is stored: numbers as float or int, sequences as tuples, arrays as read-only copies.

        Parameters
        ----------
        value : object
        sizes : dict, optional
            Lengths of the arrays of the record by the names in their shapes; new ones are put in.

        Raises
        ------
        ValueError
            If it is not allowed; the message names the option, what is allowed and the value.
        """
        if value is None and self.takes_none:
            return None
        if isinstance(value, np.ndarray) and not value.ndim:
            value = value.item()
        result = self._array(value, {} if sizes is None else sizes) if self.shape else self._fitting(value)
        if result is None:
            wrong = self._wrong_name(value)
            near = did_you_mean(wrong, self.choices) if isinstance(wrong, str) and self.choices else ""
            raise ValueError(f"{self.flat} must be {self.allowed}, got {shown(value)}{near}")
        if self.check is None:
            return result
        try:
            return self.check(result)
        except ValueError as error:
            raise type(error)(f"{self.flat} {error}") from error

    def _fitting(self, value: Any) -> Any:
        """Value in the form of the first part of the annotation that it fits; None where it fits none."""
        known = False
        for part in self._parts:
            form = _FORMS.get(part)
            if form is not None:
                known = True
                if (result := form(self, value)) is not None:
                    return result
            elif self.kinds:
                known = True
                several = value if part.startswith("tuple[") and isinstance(value, tuple) else ()
                if isinstance(value, self.kinds) or (several and all(isinstance(each, self.kinds) for each in several)):
                    return value
            elif part != "None":
                return value
        return None if known else value

    def _array(self, value: Any, sizes: dict[str, int]) -> NDArray[np.float64]:
        sides = [sizes.get(side, side) if isinstance(side, str) else side for side in self.shape]
        text = f"({', '.join(map(str, sides))}{',' if len(sides) == 1 else ''})"
        try:
            array = np.array(value, dtype=np.float64, order="C")
        except (TypeError, ValueError) as error:
            raise ValueError(f"{self.flat} must be numbers of shape {text}, got {shown(value)}") from error
        fixed = [n if isinstance(side, str) and n else side for n, side in zip(array.shape, sides, strict=False)]
        if array.shape != tuple(fixed) or array.ndim != len(sides):
            raise ValueError(f"{self.flat} must be of shape {text}, got shape {array.shape}")
        bad = np.isnan(array) | (np.isinf(array) & (not self.infinite)) | (array < self.low) | (array > self.high)
        if np.any(bad):
            index = tuple(int(i) for i in np.argwhere(bad)[0])
            place = f"{self.flat}[{', '.join(map(str, index))}]"
            kind = "" if self.infinite else "finite "
            raise ValueError(f"{place} must be a {kind}number {self.range_text}".rstrip() + f", got {array[index]:g}")
        if self.ascending:
            check_ascending(self.flat, array, self.ascending)
        sizes |= {side: n for side, n in zip(self.shape, array.shape, strict=True) if isinstance(side, str)}
        array.flags.writeable = False
        return array

    def _wrong_name(self, value: Any) -> Any:
        """First name that is no choice."""
        names = value if isinstance(value, Iterable) and not isinstance(value, str) else (value,)
        return next((name for name in names if isinstance(name, str) and name not in self.choices), None)

    def within(self, number: float | None) -> bool:
        """Whether a number is finite and within the range."""
        if number is None or not math.isfinite(number) or not self.low <= number <= self.high:
            return False
        return not (self.above and number == self.low) and not (self.below and number == self.high)


def _flag(_: Option, value: Any) -> bool | None:
    return bool(value) if isinstance(value, bool | np.bool_) else None


def _whole(declared: Option, value: Any) -> int | None:
    is_whole = isinstance(value, numbers.Integral) and not isinstance(value, bool | np.bool_)
    is_whole = is_whole and real_number(value) is not None  # itself is compared: a float has no 63 bits
    return int(value) if is_whole and declared.within(int(value)) else None


def _number(declared: Option, value: Any) -> float | None:
    number = real_number(value)
    return number if declared.within(number) else None


def _name(declared: Option, value: Any) -> str | None:
    return value if isinstance(value, str) and (not declared.choices or value in declared.choices) else None


def _path(_: Option, value: Any) -> Any:
    return value if isinstance(value, str | os.PathLike) else None


def _pair(declared: Option, value: Any) -> tuple[float, ...] | None:
    ends = real_numbers(value) if not isinstance(value, numbers.Real) else ()
    return ends if len(ends) == 2 and ends[0] <= ends[1] and all(map(declared.within, ends)) else None


def _several(form: Callable[[Option, Any], Any], once: bool = False, count: int = 0) -> Callable[[Option, Any], Any]:
    def forms(declared: Option, value: Any) -> tuple[Any, ...] | None:
        if not isinstance(value, Iterable) or isinstance(value, str | bytes | Mapping):
            return None
        parts = tuple(form(declared, part) for part in value)
        wrong = None in parts or (once and len(set(parts)) < len(parts)) or (count and len(parts) != count)
        return None if wrong else parts

    return forms


def _mapping(declared: Option, value: Any) -> dict[str, float] | None:
    if not isinstance(value, Mapping) or not all(isinstance(_name(declared, key), str) for key in value):
        return None
    parts = {key: _number(declared, number) for key, number in value.items()}
    return None if None in parts.values() else parts  # type: ignore[return-value]


_FORMS: dict[str, Callable[[Option, Any], Any]] = {
    "bool": _flag, "int": _whole, "float": _number, "str": _name, "Path": _path, "tuple[float,float]": _pair,
    "tuple[int,...]": _several(_whole), "tuple[float,...]": _several(_number), "tuple[str,...]": _several(_name, True),
    "tuple[int,int]": _several(_whole, count=2), "tuple[int,int,int]": _several(_whole, count=3),
    "Mapping[str,float]": _mapping,
}  # fmt: skip


def option(
    meaning: str, *, default: Any = MISSING, choices: Iterable[str] = (), allowed: str = "", **declared: Any
) -> Any:
    """Field of a record.

    Parameters
    ----------
    meaning : str
        Without a full stop at the end.
    default : object, optional
        Without one the field must be given.
    choices : iterable of str
    allowed : str
        Allowed values in words, in place of those that follow from the declaration.
    **declared
        Further attributes of `Option`; ``flat`` and ``kind`` are by default the name and the annotation of the field.
    """
    content = Option("", meaning, default, choices=tuple(choices), allowed_text=allowed, **declared)
    if isinstance(default, dict):
        return field(default_factory=default.copy, metadata={_KEY: content})
    return field(default=default, metadata={_KEY: content})


def options_of(record: Any) -> tuple[Option, ...]:
    """Options of a record, an instance or its class, in order."""
    declared: tuple[Option, ...] = record._declared
    return declared


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


def _declared(cls: Any) -> tuple[Option, ...]:
    """Declarations of a dataclass with names and annotations filled in."""
    found = []
    for one in fields(cls):
        if _KEY in one.metadata:
            said: Option = one.metadata[_KEY]
            text = one.type.__name__ if isinstance(one.type, type) else re.sub(r"(\w+\.)+(?=\w)", "", str(one.type))
            annotation, kind = text.replace(" ", ""), said.kind or _kind_text(text, said)
            values = said.__dict__ | {
                "name": one.name, "flat": said.flat or f"{cls.prefix}{one.name}", "kind": kind,
                "annotation": annotation,
            }  # fmt: skip
            found.append(Option(**values))
    return tuple(found)


def _kind_text(annotation: str, said: Option) -> str:
    """Type of a field in NumPy's words."""
    if said.shape:
        sides = ", ".join(map(str, said.shape))
        return f"ndarray, shape ({sides}{',' if len(said.shape) == 1 else ''}){', optional' * ('None' in annotation)}"
    parts = [part.strip() for part in annotation.split("|")]
    words = [f"{{{', '.join(map(repr, said.choices))}}}" if part == "str" and said.choices else part for part in parts]
    plain = [word.replace("tuple[float, float]", "(float, float)") for word in words if word != "None"]
    text = " or ".join(plain)
    return f"{text}, optional" if "None" in words else text


@dataclass_transform(frozen_default=True, field_specifiers=(option, field))
def option_record(cls: type[T]) -> type[T]:
    """Make a frozen dataclass that remembers which fields were given, documented by their declarations."""
    made: Any = dataclass(frozen=True, repr=False, eq=getattr(cls, "by_value", True))(cls)
    names, plain = [one.name for one in fields(made)], made.__init__
    made._declared = _declared(made)

    @wraps(plain)
    def init(self: Any, *args: Any, **kwargs: Any) -> None:
        if refused := [name for name in kwargs if name not in names]:
            raise TypeError(self._unknown(refused[0]))
        object.__setattr__(self, "_given", frozenset((*names[: len(args)], *kwargs)))
        plain(self, *args, **kwargs)

    made.__init__ = init
    entries = section((one.name, one.kind, one.text) for one in made._declared)
    made.__doc__ = f"{(cls.__doc__ or '').rstrip()}\n\n    Attributes\n    ----------\n{entries}\n    "
    result: type[T] = made
    return result


class Options:
    """Base of records of options.

    A record remembers which of its fields were given: in an environment those take the place of what the id says, the
    others do not.
    """

    title: ClassVar[str]
    """Name of the record in messages; argument of the environment that takes it."""
    objects: ClassVar[dict[str, type]] = {}
    """Classes whose objects have a form in JSON, their arguments, by the fields that take them."""
    error: ClassVar[type[Exception]] = ValueError
    """Class of the errors about values."""
    prefix: ClassVar[str] = ""
    """Beginning of the flat names of fields that have none of their own."""
    switch: ClassVar[str] = ""
    """Field without which, where it is None, the others have no meaning."""
    by_value: ClassVar[bool] = True
    """Records with equal fields are equal; otherwise only a record and itself."""
    _declared: ClassVar[tuple[Option, ...]] = ()
    _given: frozenset[str]

    def __post_init__(self) -> None:
        """Check every field by itself and with the others of the record."""
        sizes: dict[str, int] = {}
        for one in self._declared:
            value = _reusable(getattr(self, one.name))
            if kind := self.objects.get(one.name, next((k for k in one.kinds if issubclass(k, Options)), None)):
                value = self._object(one, kind, value)
            try:
                self._set(one.name, one.checked(value, sizes))
            except ValueError as error:
                raise (error if isinstance(error, self.error) else self.error(str(error))) from error
        self.check()

    def check(self) -> None:
        """Refuse what has no meaning together."""

    def _object(self, declared: Option, kind: type, value: Any) -> Any:
        """Objects of mappings of their arguments; what is no mapping stays."""
        if isinstance(value, tuple):
            return tuple(self._object(declared, kind, part) for part in value)
        if not isinstance(value, Mapping):
            return value
        try:
            return kind(**{key: _reusable(part) for key, part in value.items()})
        except (TypeError, ValueError) as error:
            raise self.error(f"{declared.flat} must be a {kind.__name__}, or its arguments by name: {error}") from error

    def __repr__(self) -> str:
        """Say what was given."""
        given = [
            f"{name}={repr(value) if isinstance(value, Options) else shown(value)}"
            for name, value in self.given.items()
        ]
        return f"{type(self).__name__}({', '.join(given)})"

    @property
    def given(self) -> dict[str, Any]:
        """Fields that were given when it was made, with their values."""
        return {one.name: getattr(self, one.name) for one in self._declared if one.name in self._given}

    def as_dict(self, all_fields: bool = False) -> dict[str, Any]:
        """Fields that were given, or all, as values of JSON; `from_dict` makes an equal record of it.

        Raises
        ------
        ValueError
            If an object has no form in JSON; the message names its field.
        """
        values: dict[str, Any] = {one.name: getattr(self, one.name) for one in self._declared if all_fields}
        values = values or self.given
        classes = tuple(self.objects.values())
        made = {
            name: {one.name: getattr(value, one.name) for one in fields(cast(Any, value))}
            for name, value in values.items()
            if isinstance(value, classes)
        }
        return {name: plain_value(f"{self.title}.{name}", value) for name, value in (values | made).items()}

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> Self:
        """Make a record of a mapping of names of fields to values.

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
        known = {one.name for one in cls._declared}
        for name in values:
            if name not in known:
                raise ValueError(cls._unknown(name))
        return values

    @classmethod
    def _unknown(cls, name: object) -> str:
        """Message about a name of no field; the flat name of one is known too."""
        by_flat = {one.flat: one.name for one in cls._declared}
        near = (
            f"; did you mean {by_flat[str(name)]!r}?" if name in by_flat else did_you_mean(name, by_flat.values(), ".")
        )
        return f"{cls.title} has no option {name!r}{near} Its options are {', '.join(by_flat.values())}"

    def to_json(self) -> str:
        """Text of `as_dict`."""
        return json.dumps(self.as_dict())

    @classmethod
    def from_json(cls, text: str) -> Self:
        """Make a record of the text of `to_json`."""
        return cls.from_dict(json.loads(text))

    def _set(self, name: str, value: Any) -> None:
        """Put a value into a field while the record is made."""
        object.__setattr__(self, name, value)


class ArrayOptions(Options):
    """Options with arrays, which are read-only, in the record itself and in its copies.

    NumPy does not carry the read-only flag through pickle or ``copy.deepcopy``; worker processes would otherwise get
    a record whose tables can be changed by accident.
    """

    by_value: ClassVar[bool] = False

    def __init_subclass__(cls) -> None:
        cls.title, cls.prefix = cls.__name__, f"{cls.__name__}."

    def __copy__(self) -> Self:
        """Return the record itself: nothing in it changes."""
        return self

    def __deepcopy__(self, memo: dict[int, object]) -> Self:
        """Return the record itself: nothing in it changes."""
        return self

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Restore the fields and take the write permission from every array."""
        for name, value in state.items():
            if isinstance(value, np.ndarray):
                value.flags.writeable = False
            self._set(name, value)


def add_options(parser: argparse._ActionsContainer, record: type[Options], *names: str, **words: str) -> None:
    """Add options of a record to a command; those that are not typed stay out of the result.

    Parameters
    ----------
    parser : argparse.ArgumentParser or group of it
    record : type
        Subclass of `Options`.
    *names : str
        Fields, by default all.
    **words : str
        Option of the command by field, without dashes in front, where it is not the flat name.
    """
    for one in options_of(record):
        if names and one.name not in names:
            continue
        flag = f"--{words.get(one.name, one.flat).replace('_', '-')}"
        unit = f" [{one.unit}]" if one.unit not in ("", "-") else ""
        default = f" (default: {text})" if (text := _default_word(one)) else ""
        settings: dict[str, Any] = {
            "dest": f"{record.title}.{one.name}", "default": argparse.SUPPRESS,
            "help": f"{one.meaning}{unit}{default}".replace("%", "%%"),
        }  # fmt: skip
        parts = [part for part in one._parts if part != "None"]
        if parts == ["bool"]:
            parser.add_argument(flag, action=argparse.BooleanOptionalAction, **settings)
            continue
        if parts[0].startswith(("Mapping[", "dict[")):
            parser.add_argument(flag, nargs="*", action="extend", type=named_value, metavar="NAME=VALUE", **settings)
            continue
        settings["nargs"] = "+" if any(part.startswith("tuple[") for part in parts) else None
        kinds = {part.removeprefix("tuple[").partition(",")[0] for part in parts}
        settings["type"] = next((kind for kind in (int, float, str) if kinds == {kind.__name__}), word_value)
        settings["metavar"] = (one.unit.upper().replace("/", "_") if unit else "") or (
            "|".join(one.choices) if one.choices and len(one.choices) < 6 else one.flat.rpartition("_")[2].upper()
        )
        parser.add_argument(flag, **settings)


def _default_word(one: Option) -> str:
    """Default as one types it; "" where there is nothing to say."""
    if one.default is None or isinstance(one.default, dict):
        return one.otherwise
    return " ".join(map(str, one.default)) if isinstance(one.default, tuple) else f"{one.default}"


def word_value(word: str) -> Any:
    """Value of a word of a command line or a file: a number, else JSON, else the word itself.

    Raises
    ------
    ValueError
        If a list, a mapping or a text in quotes is not complete.
    """
    for kind in (int, float):
        try:
            number = kind(word)
        except ValueError:
            continue
        if math.isfinite(number):
            return number
    try:
        return json.loads(word)
    except (ValueError, RecursionError) as error:  # the latter where brackets are nested a thousand deep
        if word[:1] in ("[", "{", '"'):
            raise ValueError(f"a value must be a number, a word or JSON, got {word:.60}") from error
        return word


def named_value(word: str) -> tuple[str, Any]:
    """Name and value of ``NAME=VALUE``, as the type of an option that takes a mapping.

    Raises
    ------
    argparse.ArgumentTypeError
        If there is no name, no value, or `word_value` refuses it.
    """
    name, _, value = word.partition("=")
    if not (name.strip() and value):
        raise argparse.ArgumentTypeError(f"{word:.60} must be NAME=VALUE")
    try:
        return name.strip(), word_value(value)
    except ValueError as error:
        raise argparse.ArgumentTypeError(str(error)) from error


def chosen_options(arguments: argparse.Namespace, record: type[Options]) -> dict[str, Any]:
    """Fields of a record that a command line gave, by name; a single value stands for several too."""
    prefix = f"{record.title}."
    values = {name.removeprefix(prefix): value for name, value in vars(arguments).items() if name.startswith(prefix)}
    for one in options_of(record):
        value = values.get(one.name)
        if one._parts[0].startswith(("Mapping[", "dict[")) and value is not None:
            values[one.name] = dict(value)
        elif isinstance(value, list) and len(value) == 1 and {"float", "int"} & set(one._parts):
            values[one.name] = value[0]
    return values


def _reusable(value: Any) -> Any:
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
    if isinstance(value, Options):
        return value.as_dict()
    if isinstance(value, list | tuple | range):
        return [plain_value(f"{name}[{k}]", part) for k, part in enumerate(value)]
    if isinstance(value, Mapping) and all(isinstance(key, str) for key in value):
        return {key: plain_value(f"{name}[{key!r}]", part) for key, part in value.items()}
    raise ValueError(f"{name} must be a number, a text, a list or a mapping for a form in JSON, got {shown(value)}")


def as_pair(value: float | tuple[float, float]) -> tuple[float, float]:
    """Low and high end of a number or of two in order, as the `Option.check` of such an option."""
    return value if isinstance(value, tuple) else (value, value)


def as_tuple(value: str | tuple[str, ...]) -> tuple[str, ...]:
    """Several names of one or several, as the `Option.check` of such an option."""
    return (value,) if isinstance(value, str) else tuple(value)


def not_empty(value: T) -> T:
    """Refuse a sequence or a mapping of nothing, as the `Option.check` of such an option."""
    if not value:
        raise ValueError(f"must have at least one, got {shown(value)}")
    return value


def check_number(name: str, value: Any, unit: str = "", *, finite: bool = True) -> float:
    """Return a real number, which neither a truth value nor a text is, NaN and infinity only without ``finite``.

    Raises
    ------
    ValueError
        With the name of the argument, what it must be, and ``unit``.
    """
    found = real_number(value)
    if found is None or (finite and not math.isfinite(found)):
        kind = "a finite number" if finite else "a number"
        raise ValueError(f"{name} must be {kind}{f' in {unit}' if unit else ''}, got {shown(value)}")
    return found


def check_whole_steps(name: str, time: float, control_dt: float, least: int) -> int:
    """Return how many steps of ``control_dt`` [s] a time [s] is.

    Raises
    ------
    ValueError
        If it is not a whole number of them, at least ``least``.
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


def check_mapping(name: str, value: Any) -> dict[str, float]:
    """Return a mapping of names to numbers.

    Raises
    ------
    ValueError
    """
    if not isinstance(value, Mapping):
        raise ValueError(f"{name} must map names to numbers, got {shown(value)}")
    return {key: check_number(f"{name}[{key!r}]", number, finite=False) for key, number in value.items()}


def check_ascending(name: str, array: NDArray[np.float64], least: int = 2) -> None:
    """Require at least so many entries (n,), strictly ascending.

    Raises
    ------
    ValueError
    """
    if array.size < least:
        raise ValueError(f"{name} must have at least {least} strictly ascending numbers, got {array.tolist()}")
    if np.any(falls := np.diff(array) <= 0.0):
        i = int(np.argmax(falls))
        raise ValueError(f"{name}[{i + 1}] must be above {name}[{i}] = {array[i]:g} (ascending), got {array[i + 1]:g}")


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
    if isinstance(value, np.ndarray):
        return f"{value.tolist()!r:.100}" if value.size <= 9 else f"array of shape {value.shape}"
    return f"{value!r:.100}".replace("\n", " ")
