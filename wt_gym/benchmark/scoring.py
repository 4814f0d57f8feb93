"""Scores: 0 is the baseline controller, 100 the best known agent, paired wind by wind."""

from __future__ import annotations

import math
from dataclasses import dataclass
from statistics import NormalDist
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.special import stdtrit

from wt_gym.benchmark.reference import reference_of
from wt_gym.errors import BenchmarkError

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from wt_gym.benchmark.reference import Reference
    from wt_gym.benchmark.tasks import BenchmarkTask, BenchmarkWind

__all__ = ["Score", "WindScore", "bootstrap_interval", "score", "wind_score"]

_RESAMPLES = 10_000


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
    wt_gym.errors.BenchmarkError
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
    weights = np.array([wind.weight for wind in task.winds])
    low, high = bootstrap_interval(values, weights, [wind.stratum for wind in task.winds])
    return Score(float(np.average(values, weights=weights)), low, high, float(np.mean(values > 0.0)), rows)


def bootstrap_interval(
    values: np.ndarray, weights: np.ndarray, strata: Sequence[int], level: float = 0.95, seed: int = 0
) -> tuple[float, float]:
    """Interval of a weighted mean by drawing the values of each stratum anew.

    The percentiles are those of the expanded bootstrap (Hesterberg, The American Statistician 69 (2015) 371, section
    4.3): for a handful of winds the plain percentile interval is too narrow.

    Parameters
    ----------
    values, weights : numpy.ndarray, shape (n,)
    strata : sequence of int
        One a value; each stratum has at least two.
    level : float
    seed : int
        Of the draws.

    Returns
    -------
    low, high : float
    """
    rng, strata = np.random.default_rng(seed), np.asarray(strata)
    sums, freedom, expansion = np.zeros(_RESAMPLES), 0, 0.0
    for stratum in np.unique(strata):
        own = np.flatnonzero(strata == stratum)
        if own.size < 2:
            raise BenchmarkError(f"an interval needs at least two winds in each stratum, stratum {stratum} has one")
        sums += (weights * values)[rng.choice(own, (_RESAMPLES, own.size))].sum(axis=1)
        freedom += own.size - 1
        expansion = max(expansion, math.sqrt(own.size / (own.size - 1)))
    tail = NormalDist().cdf(expansion * float(stdtrit(freedom, 0.5 * (1.0 - level))))
    low, high = np.quantile(sums / weights.sum(), [tail, 1.0 - tail])
    return float(low), float(high)
