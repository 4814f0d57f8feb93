"""What a validation case is: a named run that returns checks of quantities against exact or external numbers.

A case is registered by decorating the function that computes it:

>>> @case("pendulum", "Simple pendulum", "elementary mechanics")           # doctest: +SKIP
... def pendulum() -> list[Check]:
...     return [Check("period", 2.006, measure(), 1e-3, "s"), Check("largest swing [rad]", "<= 0.1", swing())]

Checks are the rows of a table: quantity, expected value or bound, what was obtained, tolerance, unit and source. The
 expected value comes from an exact solution, a publication or an independent computation, never from an
earlier output of this package.  A qualitative statement of a paper becomes a check with a numeric criterion: the
criterion is written in ``quantity`` and the published statement in ``source``.
"""

from __future__ import annotations

import importlib
import math
import pkgutil
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

__all__ = [
    "Case", "CaseResult", "Check", "Curve", "Figure", "absolute", "all_cases", "bounds_of", "case", "load_cases",
    "run_case", "worst",
]  # fmt: skip


class absolute(float):  # a kind of number
    """A tolerance in the unit of the quantity; plain numbers are fractions of the expected value."""


@dataclass(frozen=True)
class Check:
    """One quantity compared with its expected value.

    Attributes
    ----------
    quantity
        What is compared; for a qualitative statement, the numeric criterion in words.
    expected
        The exact or published number.  A string states a bound: ``"<= 1.5"``, ``">= 2"`` or ``"in [a, b]"``.
    obtained
        What this package computes.
    tolerance
        Largest accepted ``error``, as a fraction of ``expected``; in its unit if it is `absolute`, if zero is expected,
        and for a bound, which it widens.
    unit
        Unit of both numbers.
    source
        Where the expected value comes from.
    """

    quantity: str
    expected: float | str
    obtained: float
    tolerance: float = 0.0
    unit: str = ""
    source: str = ""

    def __post_init__(self) -> None:
        object.__setattr__(self, "obtained", float(self.obtained))
        if not isinstance(self.expected, str):
            object.__setattr__(self, "expected", float(self.expected))

    @property
    def error(self) -> float:
        """Distance from the expected value: relative or absolute; for a bound, how far outside it is (0 inside)."""
        if isinstance(self.expected, str):
            low, high = bounds_of(self.expected)
            return math.nan if math.isnan(self.obtained) else max(low - self.obtained, self.obtained - high, 0.0)
        difference = abs(self.obtained - self.expected)
        return difference / abs(self.expected) if self.is_relative else difference

    @property
    def is_relative(self) -> bool:
        """Whether ``error`` and ``tolerance`` are fractions of the expected value."""
        return not (isinstance(self.expected, str) or isinstance(self.tolerance, absolute) or self.expected == 0.0)

    @property
    def passed(self) -> bool:
        """Whether the error is within the tolerance; a value that is not a number never passes."""
        return bool(self.error <= self.tolerance)

    def as_dict(self) -> dict[str, Any]:
        """Plain numbers and strings, for JSON; a number that is not finite becomes its name in a string."""
        return {
            "quantity": self.quantity,
            "expected": self.expected if isinstance(self.expected, str) else _finite(self.expected),
            "obtained": _finite(self.obtained),
            "error": _finite(self.error),
            "tolerance": float(self.tolerance),
            "relative": self.is_relative,
            "unit": self.unit,
            "passed": self.passed,
            "source": self.source,
        }


def worst(
    quantity: str,
    where: str,
    at: Sequence[float] | NDArray[np.float64],
    expected: NDArray[np.float64],
    obtained: NDArray[np.float64],
    tolerance: float,
    unit: str = "",
    source: str = "",
    chosen: NDArray[np.bool_] | None = None,
) -> Check:
    """Check of a curve where it fits worst.

    Parameters
    ----------
    quantity : str
    where : str
        What ``at`` counts and how a value of it is written: ``"winds: {:g} m/s"``.
    at, expected, obtained : array (n,)
        Abscissa, expected and obtained values.
    tolerance : float
        Relative, or `absolute`.
    unit, source : str
    chosen : array (n,) of bool, optional
        Points that count; all by default.
    """
    chosen = np.ones(len(at), dtype=bool) if chosen is None else chosen
    error = np.abs(obtained - expected) / (1.0 if isinstance(tolerance, absolute) else np.abs(expected))
    k = int(np.argmax(np.where(chosen, error, -1.0)))
    text = f"{quantity}, worst of {int(chosen.sum())} {where.format(at[k])}"
    return Check(text, expected[k], obtained[k], tolerance, unit, source)


def _finite(value: float) -> float | str:
    return float(value) if math.isfinite(value) else str(float(value))


def bounds_of(text: str) -> tuple[float, float]:
    """Lowest and highest accepted value of a bound written as ``<= a``, ``>= a`` or ``in [a, b]``."""
    stripped = text.strip()
    if stripped.startswith("<="):
        return -math.inf, float(stripped[2:])
    if stripped.startswith(">="):
        return float(stripped[2:]), math.inf
    if stripped.startswith("in [") and stripped.endswith("]"):
        low, high = (float(part) for part in stripped[4:-1].split(","))
        return low, high
    raise ValueError(f"expected value {text!r} is not a bound; write '<= a', '>= a' or 'in [a, b]'")


@dataclass(frozen=True)
class Curve:
    """A line of a figure: ``x`` and ``y`` of equal length; ``style`` is a matplotlib format string such as ``"o"``."""

    x: Any
    y: Any
    label: str = ""
    style: str = "-"


@dataclass(frozen=True)
class Figure:
    """Curves with named axes; drawn by the validation report."""

    curves: tuple[Curve, ...]
    x_label: str = ""
    y_label: str = ""
    log_x: bool = False
    log_y: bool = False
    equal_axes: bool = False


@dataclass(frozen=True)
class CaseResult:
    """What a case returns: its checks, figures for the report, and notes a reader of the numbers needs.

    ``figures`` maps a title to a `Figure`, to a pair ``(x, y)`` of series, or to a function without arguments that
    returns a matplotlib figure (called only when a report is drawn).
    """

    checks: list[Check]
    figures: Mapping[str, Any] = field(default_factory=dict)
    notes: str = ""
    wall_time: float = math.nan

    @property
    def passed(self) -> bool:
        """Whether there is at least one check and all of them pass."""
        return bool(self.checks) and all(check.passed for check in self.checks)


@dataclass(frozen=True)
class Case:
    """A registered validation case; ``slow`` ones take more than about ten seconds."""

    name: str
    title: str
    source: str
    run: Callable[[], list[Check] | CaseResult]
    slow: bool = False


_CASES: dict[str, Case] = {}
Run = TypeVar("Run", bound="Callable[[], list[Check] | CaseResult]")


def case(name: str, title: str, source: str, *, slow: bool = False) -> Callable[[Run], Run]:
    """Register the decorated function (no arguments; returns checks or a `CaseResult`) as the case ``name``.

    Raises
    ------
    ValueError
        If another function already carries the name.
    """

    def register(function: Run) -> Run:
        known = _CASES.get(name)
        if known is not None and (known.run.__module__, known.run.__qualname__) != (
            function.__module__,
            function.__qualname__,
        ):
            raise ValueError(f"validation case {name!r} is already defined in {known.run.__module__}")
        _CASES[name] = Case(name, title, source, function, slow)
        return function

    return register


def load_cases() -> dict[str, Case]:
    """Import every module of this package and return the registered cases by name, in alphabetical order."""
    package = importlib.import_module(__package__)
    for module in pkgutil.iter_modules(package.__path__):
        importlib.import_module(f"{__package__}.{module.name}")
    return dict(sorted(_CASES.items()))


def all_cases() -> tuple[Case, ...]:
    """Every case of the package, in alphabetical order of their names."""
    return tuple(load_cases().values())


def run_case(chosen: Case) -> CaseResult:
    """Run a case and return its result with the wall time [s] filled in, whichever form the case returned."""
    start = time.perf_counter()
    outcome = chosen.run()
    wall_time = time.perf_counter() - start
    if isinstance(outcome, CaseResult):
        return CaseResult(outcome.checks, outcome.figures, outcome.notes, wall_time)
    return CaseResult(list(outcome), wall_time=wall_time)
