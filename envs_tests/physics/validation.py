"""Validation cases: named runs that compare quantities with exact or external numbers; their record and report.

A case is registered by decorating the function that computes it, in a module of the folder ``cases``:

>>> @case("pendulum", "Simple pendulum", "elementary mechanics")           # doctest: +SKIP
... def pendulum() -> list[Check]:
...     return [Check("period", 2.006, measure(), 1e-3, "s"), Check("largest angle [rad]", "<= 0.1", swing())]

Checks are the rows of a table: quantity, expected value or bound, obtained value, tolerance, unit and source. The
expected value comes from an exact solution, a publication or an independent computation, never from an earlier output
of this package. A qualitative statement of a paper becomes a check with a numeric criterion: the criterion is written
in ``quantity`` and the published statement in ``source``.

``scripts/validate.py`` runs cases as published. The test suite (``test_cases.py``) runs those that are not ``slow``, or
any case with the coarser arguments ``quick``.
"""

import base64
import importlib
import io
import json
import math
import pkgutil
import subprocess
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from html import escape
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

import wt_gym
from wt_gym.base.files import write_text_whole

ROOT = Path(__file__).resolve().parents[2]
DATA = Path(__file__).parent / "data"
"""Folder of the reference data."""


class absolute(float):  # a kind of number
    """A tolerance in the unit of the quantity; plain numbers are fractions of the expected value."""


@dataclass(frozen=True)
class Check:
    """One quantity compared with its expected value.

    ``quantity``: what is compared; for a qualitative statement, the numeric criterion in words; ``expected``: the exact
    or published number. A string states a bound: ``"<= 1.5"``, ``">= 2"`` or ``"in [a, b]"``; ``obtained``: what this
    package computes; ``tolerance``: largest accepted ``error``, as a fraction of ``expected``; in its unit if it is
    `absolute`, if zero is expected, and for a bound, which it widens; ``unit``: unit of both numbers; ``source`` where
    the expected value comes from.
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

    @property
    def cells(self) -> tuple[str, str, str, str]:
        """Expected and obtained value with their unit, error and tolerance, for a table."""
        unit = f" {self.unit}" if self.unit else ""
        expected = self.expected if isinstance(self.expected, str) else f"{self.expected:.6g}"
        scale, sign = (100.0, " %") if self.is_relative else (1.0, "")
        error, tolerance = f"{scale * self.error:.3g}{sign}", f"{scale * self.tolerance:.3g}{sign}"
        return expected + unit, f"{self.obtained:.6g}{unit}", error, tolerance

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


def worst(  # noqa: PLR0913
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

    ``where`` says what the abscissa ``at`` (n,) counts and how a value of it is written: ``"winds: {:g} m/s"``;
    ``chosen`` (n,) are the points that count, all by default.
    """
    chosen = np.ones(len(at), dtype=bool) if chosen is None else chosen
    error = np.abs(obtained - expected) / (1.0 if isinstance(tolerance, absolute) else np.abs(expected))
    k = int(np.argmax(np.where(chosen, error, -1.0)))
    text = f"{quantity}, worst of {int(chosen.sum())} {where.format(at[k])}"
    return Check(text, expected[k], obtained[k], tolerance, unit, source)


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
    """Checks of a case, figures for the report, and notes that a reader of the numbers needs.

    ``figures`` maps a title to a `Figure`, drawn only for a report.
    """

    checks: list[Check]
    figures: Mapping[str, Figure] = field(default_factory=dict)
    notes: str = ""
    wall_time: float = math.nan

    @property
    def passed(self) -> bool:
        """Whether there is at least one check and all of them pass."""
        return bool(self.checks) and all(check.passed for check in self.checks)


@dataclass(frozen=True)
class Case:
    """A registered case; ``slow`` ones take more than about ten seconds.

    ``quick`` are the arguments with which the test suite runs it, False where it does not; without them the suite runs
    what is not slow as published.
    """

    name: str
    title: str
    source: str
    run: Callable[..., list[Check] | CaseResult]
    slow: bool = False
    quick: Mapping[str, Any] | bool | None = None


_CASES: dict[str, Case] = {}
Run = TypeVar("Run", bound="Callable[..., list[Check] | CaseResult]")


def case(
    name: str, title: str, source: str, *, slow: bool = False, quick: Mapping[str, Any] | bool | None = None
) -> Callable[[Run], Run]:
    """Register the decorated function (returns checks or a `CaseResult`) as the case ``name``.

    Called without arguments it makes the published numbers; ``slow`` and ``quick`` are those of `Case`.

    Raises `ValueError` if another function already carries the name.
    """

    def register(function: Run) -> Run:
        known = _CASES.get(name)
        if known is not None and (known.run.__module__, known.run.__qualname__) != (
            function.__module__,
            function.__qualname__,
        ):
            raise ValueError(f"validation case {name!r} is already defined in {known.run.__module__}")
        _CASES[name] = Case(name, title, source, function, slow, quick)
        return function

    return register


def load_cases() -> dict[str, Case]:
    """Import every module of the folder ``cases`` and return the registered cases by name, in alphabetical order."""
    package = importlib.import_module("envs_tests.physics.cases")
    for module in pkgutil.iter_modules(package.__path__):
        importlib.import_module(f"{package.__name__}.{module.name}")
    return dict(sorted(_CASES.items()))


def run_case(case: Case, **arguments: Any) -> CaseResult:
    """Run a case and return its result with the wall time [s] filled in, whichever form the case returned."""
    start = time.perf_counter()
    outcome = case.run(**arguments)
    wall_time = time.perf_counter() - start
    if isinstance(outcome, CaseResult):
        return CaseResult(outcome.checks, outcome.figures, outcome.notes, wall_time)
    return CaseResult(list(outcome), wall_time=wall_time)


def read_table(name: str) -> tuple[NDArray[np.float64], list[str]]:
    """Numbers (n_rows, n_columns) and column names of a file of the reference data."""
    lines = [line for line in (DATA / name).read_text(encoding="utf-8").splitlines() if line and line[0] != "#"]
    return np.array([[float(cell) for cell in line.split(",")] for line in lines[1:]]), lines[0].split(",")


# ---- the record of the last runs: cases that are run again replace their entries, the others stay with their date ----


def as_dict(case: Case, result: CaseResult) -> dict[str, Any]:
    """Plain data of one case, for JSON."""
    return {
        "name": case.name,
        "title": case.title,
        "source": case.source,
        "slow": case.slow,
        "passed": result.passed,
        "wall_time_s": result.wall_time if math.isfinite(result.wall_time) else None,
        "notes": result.notes,
        "checks": [check.as_dict() for check in result.checks],
    }


def read_record(path: Path) -> dict[str, dict[str, Any]]:
    """Entries by the names of the cases, in alphabetical order.

    Raises `ValueError` if the file is no record.
    """
    try:
        cases = json.loads(path.read_text(encoding="utf-8"))["cases"]
    except (ValueError, KeyError, TypeError) as error:
        raise ValueError(f"{path} is not a record of validation cases: {error!r}") from error
    return {name: cases[name] for name in sorted(cases)}


def source_commit(record: Path | None = None, root: Path = ROOT) -> str | None:
    """Commit of the sources as they are now; to be asked before the cases run, while it is that of the code in memory.

    Changes of ``record``, which every case changes, do not count; ``root`` is the folder of the clone.

    Returns short hash, with a "+" if the tree has changes; None without git, or where the folder is no clone of its
    own.
    """
    if not (root / ".git").exists():  # another clone may lie around it
        return None
    left_out = []
    if record is not None and record.resolve().is_relative_to(root.resolve()):  # git knows no place outside
        left_out.append(f":(exclude){record.resolve().relative_to(root.resolve()).as_posix()}")
    try:
        commit = _git(root, "rev-parse", "--short", "HEAD")
        return commit + "+" * bool(_git(root, "status", "--porcelain", "--", ".", *left_out))
    except (OSError, subprocess.CalledProcessError):
        return None


def _git(root: Path, *arguments: str) -> str:
    result = subprocess.run(["git", *arguments], cwd=root, capture_output=True, text=True, check=True)
    return result.stdout.strip()


def update_record(path: Path, results: Iterable[tuple[Case, CaseResult]], commit: str | None = None) -> Path:
    """Put results into a record, which is begun if there is none, with the time (UTC), version and commit.

    Raises `ValueError` if the file is there and is no record.
    """
    cases = read_record(path) if path.exists() else {}
    now = datetime.now(UTC).isoformat(timespec="minutes").removesuffix("+00:00") + "Z"
    for case, result in results:
        cases[case.name] = {"date": now, "version": wt_gym.__version__, "commit": commit, **as_dict(case, result)}
    path.parent.mkdir(parents=True, exist_ok=True)
    # one check a line: a later run shows in the history which numbers it moved
    text = ",\n".join(f"{json.dumps(name)}: {_entry(cases[name])}" for name in sorted(cases))
    write_text_whole(path, f'{{"cases": {{\n{text}\n}}}}\n')
    return path


def _entry(case: Mapping[str, Any]) -> str:
    head = json.dumps({key: value for key, value in case.items() if key != "checks"}, ensure_ascii=False)
    checks = ",\n  ".join(json.dumps(check, ensure_ascii=False) for check in case["checks"])
    return f'{head[:-1]}, "checks": [\n  {checks}]}}'


# ---- the report: every number and plot on one self-contained HTML page -----------------------------------------------


def write_report(folder: str | Path, results: list[tuple[Case, CaseResult]]) -> Path:
    """Write ``validation.html`` into a folder (created if missing) and return its path."""
    from wt_gym.analysis.page import Row, Section, table, write_page

    cases = [
        Row(
            f"<a href='#{escape(case.name)}'>{escape(case.name)}</a>",
            (
                escape(case.title),
                f"{sum(check.passed for check in result.checks)}/{len(result.checks)}",
                _mark(result.passed),
                f"{result.wall_time:.1f} s",
            ),
        )
        for case, result in results
    ]
    sections = [Section("cases", "Cases", table(("case", "title", "checks", "", "time"), cases, (1,)))]
    for case, result in results:
        rows = [
            Row(
                escape(check.quantity) + (f"<br><small>{escape(check.source)}</small>" if check.source else ""),
                (*map(escape, check.cells), _mark(check.passed)),
            )
            for check in result.checks
        ]
        content = table(("quantity", "expected", "obtained", "error", "tolerance", ""), rows)
        content += f"<pre>{escape(result.notes)}</pre>" if result.notes else ""
        content += "".join(
            f"<figure><img alt='{escape(title)}' src='data:image/png;base64,{_image(title, figure)}'></figure>"
            for title, figure in result.figures.items()
        )
        sections.append(Section(case.name, case.title, content, f"{case.name} · {case.source}", case.name))
    return write_page(
        Path(folder) / "validation.html",
        title="Validation of wt_gym",
        result=f"{sum(result.passed for _, result in results)} of {len(results)} cases pass",
        facts={"version": wt_gym.__version__},
        sections=sections,
    )


def _mark(passed: bool) -> str:
    return "pass" if passed else "<strong>FAIL</strong>"


def _image(title: str, figure: Figure) -> str:
    """A figure as PNG in base64."""
    from matplotlib.figure import Figure as Canvas

    canvas = Canvas(figsize=(8.0, 4.5))
    axes = canvas.add_subplot()
    for curve in figure.curves:
        axes.plot(curve.x, curve.y, curve.style, label=curve.label or None, linewidth=1.2, markersize=4)
    axes.set(title=title, xlabel=figure.x_label, ylabel=figure.y_label)
    if figure.equal_axes:
        axes.set_aspect("equal")
    if figure.log_x:
        axes.set_xscale("log")
    if figure.log_y:
        axes.set_yscale("log")
    if any(curve.label for curve in figure.curves):
        axes.legend(fontsize="small", ncols=2 if len(figure.curves) > 6 else 1)
    axes.grid(alpha=0.3)
    stream = io.BytesIO()
    canvas.savefig(stream, format="png", dpi=110, bbox_inches="tight")
    return base64.b64encode(stream.getvalue()).decode("ascii")
