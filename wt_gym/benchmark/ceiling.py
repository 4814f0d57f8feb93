"""Ceilings of tasks: what a score can be where the wind is known, and what linear laws with more information reach.

A score is read between the yardstick, which has 100, and the ceiling. The numbers stand in ``data/ceilings``, one file
a task, with the record of their making; scripts/studies/ceiling.py makes them.
"""

from __future__ import annotations

import json
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Any

from wt_gym.base.canary import differing
from wt_gym.base.errors import BenchmarkError
from wt_gym.benchmark.tasks import task_file

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from wt_gym.benchmark.tasks import BenchmarkTask

__all__ = ["Ceiling", "ceiling_file", "ceiling_line", "ceiling_of"]


@dataclass(frozen=True)
class Ceiling:
    """What a task holds for who knows the wind.

    Attributes
    ----------
    task : str
    version : int
    definition : str
        Digest of the task.
    fingerprint : dict
        See `wt_gym.benchmark.benchmark_fingerprint`.
    made : dict
        Date, and versions of the software.
    how : dict
        Length of the runs, base controller, winds of the identification, limits, weights.
    explained : dict
        From the wind speed to the share of each output that the model explains.
    improvement : float
        Weighted mean over the winds.
    yardstick : str or None
        Agent that scores 100.
    yardstick_improvement : float or None
        Of the same winds for the same time; None where it ended early in one.
    winds : dict
        From the label of a wind to ``improvement``, ``passes`` (improvement of each run, the one without offsets
        first; None where a limit was broken), ``broken``, ``yardstick``, ``changes`` against the baseline and
        ``offsets_rms_deg``.
    ladder : list of dict
        Rungs: ``name``, ``improvement`` over the base controller as the model forecasts it, and the changes of what it
        is made of.
    """

    task: str
    version: int
    definition: str
    fingerprint: dict[str, Any]
    made: dict[str, str]
    how: dict[str, Any]
    explained: dict[str, dict[str, float]]
    improvement: float
    yardstick: str | None
    yardstick_improvement: float | None
    winds: dict[str, dict[str, Any]]
    ladder: list[dict[str, Any]]

    @property
    def score(self) -> float | None:
        """What is reached where the yardstick has 100 in the same winds; None where that gains nothing."""
        if self.yardstick_improvement is None or self.yardstick_improvement <= 0.0:
            return None
        return 100.0 * self.improvement / self.yardstick_improvement


def ceiling_file(task: BenchmarkTask) -> Path:
    """Where the ceiling of a task stands, or would."""
    return task_file(task.name).parent / "ceilings" / f"{task.name}.json"


def ceiling_of(task: BenchmarkTask, path: Path | None = None) -> Ceiling | None:
    """Ceiling of a task, None if it has not been made, or belongs to another definition of the task.

    Parameters
    ----------
    task : BenchmarkTask
    path : path, optional
        Of the file, by default that in the package.

    Raises
    ------
    wt_gym.base.errors.BenchmarkError
        If its file is damaged.
    """
    path = path or ceiling_file(task)
    if not path.is_file():
        return None
    try:
        values: Mapping[str, Any] = json.loads(path.read_text(encoding="utf-8"))
        found = Ceiling(**{part.name: values[part.name] for part in fields(Ceiling)})
    except (ValueError, KeyError, TypeError) as error:
        raise BenchmarkError(
            f"{path} must be a ceiling of scripts/studies/ceiling.py, it is damaged: {error!r}"
        ) from error
    return found if (found.task, found.definition) == (task.name, task.digest) else None


def ceiling_line(task: BenchmarkTask, ceiling: Ceiling) -> str:
    """What a table says of a ceiling: its height, where it was measured, and with what code."""
    winds = len(ceiling.winds)
    beside = ""
    if ceiling.score is not None:
        beside = (
            f": {ceiling.score:.0f} where `{ceiling.yardstick}` has 100 "
            f"({100 * (ceiling.yardstick_improvement or 0.0):.2f} %)"
        )
    line = (
        f"Ceiling with the wind known: an improvement of {100 * ceiling.improvement:.2f} %{beside}, measured in "
        f"{winds} {'winds' if winds != 1 else 'wind'} of {ceiling.how['duration']:g} s, {ceiling.made['date']}."
    )
    known = (task.reference or {}).get("fingerprint")
    if known and (parts := differing(known, ceiling.fingerprint)):
        line += f" It was made with another {' and '.join(parts)} than the reference numbers."
    return line
