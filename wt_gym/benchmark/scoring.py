"""Scores: 0 is the baseline controller, 100 the best known agent, paired wind by wind."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from wt_gym.analysis.statistics import bootstrap_interval
from wt_gym.base.errors import BenchmarkError
from wt_gym.benchmark.reference import reference_of

if TYPE_CHECKING:
    from collections.abc import Mapping

    from wt_gym.benchmark.reference import Reference
    from wt_gym.benchmark.tasks import BenchmarkTask, BenchmarkWind

__all__ = ["Score", "WindScore", "score", "wind_score"]


@dataclass(frozen=True)
class WindScore:
    """Score of one run.

    Attributes
    ----------
    wind : str
    score : float
    improvement : float or None
        None for a run that ended before its time.
    broken : tuple of str
        Limits that were not kept, or how the run ended.
    """

    wind: str
    score: float
    improvement: float | None
    broken: tuple[str, ...]


@dataclass(frozen=True)
class Score:
    """Score of an agent in a task.

    Attributes
    ----------
    score : float
        Weighted mean over the winds.
    low, high : float
        95 % interval over the winds.
    better : float
        Share of the winds with a score above zero.
    winds : tuple of WindScore
    """

    score: float
    low: float
    high: float
    better: float
    winds: tuple[WindScore, ...]


def wind_score(task: BenchmarkTask, wind: BenchmarkWind, result: Mapping[str, Any], reference: Reference) -> WindScore:
    """Score of the run in one wind: clipped, and the least one where the run ended early or a limit was not kept."""
    if result["ending"] != "time":
        return WindScore(wind.label, task.clip[0], None, (result["ending"],))
    metrics, baseline = result["metrics"], reference.baseline[wind.label]
    gained, broken = task.improvement(metrics, baseline), task.broken_limits(metrics, baseline)
    value = min(max(100.0 * gained / reference.best_improvement, task.clip[0]), task.clip[1])
    return WindScore(wind.label, task.clip[0] if broken else value, gained, broken)


def score(task: BenchmarkTask, results: Mapping[str, Mapping[str, Any]], reference: Reference | None = None) -> Score:
    """Score of an agent.

    Parameters
    ----------
    task : BenchmarkTask
    results : mapping
        From the label of every wind to its result: ``definition`` (`wt_gym.benchmark.run_definition`) and what
        `wt_gym.benchmark.play` gives.
    reference : Reference, optional
        By default that of the task.

    Returns
    -------
    Score

    Raises
    ------
    wt_gym.base.errors.BenchmarkError
        If the task has no reference numbers, a wind is missing, or a result was made with another turbine, fidelity
        or physics than the reference.
    """
    reference = reference or reference_of(task)
    missing = [wind.label for wind in task.winds if wind.label not in results]
    if missing:
        raise BenchmarkError(f"task {task.name}: no result in {len(missing)} winds, the first is {missing[0]}")
    for wind in task.winds:
        reference.check(task, results[wind.label]["definition"])
    rows = tuple(wind_score(task, wind, results[wind.label], reference) for wind in task.winds)
    values = np.array([row.score for row in rows])
    weights, strata = np.array([wind.weight for wind in task.winds]), [wind.stratum for wind in task.winds]
    low, high = bootstrap_interval(lambda k: np.average(values[k], axis=-1, weights=weights[k]), strata)
    return Score(float(np.average(values, weights=weights)), low, high, float(np.mean(values > 0.0)), rows)
