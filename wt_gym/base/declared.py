"""Rules for the fields of a frozen record, declared in one table per record."""

from __future__ import annotations

import math
import numbers
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from wt_gym.base.errors import did_you_mean


@dataclass(frozen=True)
class Rule:
    """A test of values, what is allowed in words, and the names among which there is a choice."""

    fits: Callable[[Any], bool]
    allowed: str
    names: tuple[str, ...] = ()

    @property
    def or_none(self) -> Rule:
        """The same for a field that can be left out."""
        return Rule(lambda value: value is None or self.fits(value), f"None or {self.allowed}", self.names)


def count(value: Any, least: int = 0) -> bool:
    """Whether a value is a whole number, no truth value, of at least the least."""
    return not isinstance(value, bool) and isinstance(value, numbers.Integral) and int(value) >= least


def whole(least: int) -> Rule:
    """Whole numbers from the least on."""
    return Rule(lambda value: count(value, least), f"a whole number of at least {least}")


def counts(many: int, least: int, words: str) -> Rule:
    """As many whole numbers, each from the least on."""

    def fits(value: Any) -> bool:
        return isinstance(value, tuple | list) and len(value) == many and all(count(one, least) for one in value)

    return Rule(fits, words)


def number(low: float, high: float = math.inf, *, above: bool = False, below: bool = False, unit: str = "") -> Rule:
    """Finite numbers from low to high; with ``above`` and ``below`` without these ends."""
    if high == math.inf:
        allowed = f"a finite number {'above' if above else 'of at least'} {low:g}"
    else:
        allowed = f"in {'(' if above else '['}{low:g}, {high:g}{')' if below else ']'}"

    def fits(value: Any) -> bool:
        if isinstance(value, bool) or not isinstance(value, numbers.Real):
            return False
        x = float(value)
        return low <= x <= high and math.isfinite(x) and not (above and x == low) and not (below and x == high)

    return Rule(fits, f"{allowed} {unit}".rstrip())


def one_of(*names: str) -> Rule:
    """Names."""
    allowed = f"one of {', '.join(names)}" if len(names) > 1 else repr(names[0])
    return Rule(lambda value: isinstance(value, str) and value in names, allowed, names)


def check_fields(record: object, rules: Mapping[str, Rule], error: type[Exception]) -> None:
    """Check a record by a table of rules; a key has the names of one field or more, with spaces between.

    Raises
    ------
    Exception
        Of the class given, about the first field that breaks its rule: its name, value and what is allowed.
    """
    for names, rule in rules.items():
        for name in names.split():
            value = getattr(record, name)
            if not rule.fits(value):
                raise broken(record, name, rule.allowed, error, rule.names)


def broken(record: object, name: str, allowed: str, error: type[Exception], known: Iterable[str] = ()) -> Exception:
    """The error of a field that has a value which is not allowed."""
    value = getattr(record, name)
    near = did_you_mean(value, known) if isinstance(value, str) else ""
    return error(f"{type(record).__name__}.{name} is {value!r}; must be {allowed}{near}")
