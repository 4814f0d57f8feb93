"""Agents against the baseline in the same winds: differences wind by wind, and what they come to."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from wt_gym.analysis.change import is_relative, relative_change
from wt_gym.analysis.lifetime import lifetime_load, wind_weights
from wt_gym.analysis.metrics import BLADE_EXPONENT, METRICS, TOWER_EXPONENT
from wt_gym.analysis.statistics import LEAST_PER_STRATUM, bootstrap_interval, interquartile_mean

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import ArrayLike, NDArray

    from wt_gym.analysis.results import Evaluation, Wind

__all__ = ["LIFETIME_EXPONENTS", "Estimate", "level_of", "lifetime", "lifetime_change", "paired_change", "shared_winds"]

LIFETIME_EXPONENTS = {
    "blade_flap_del": BLADE_EXPONENT,
    "blade_edge_del": BLADE_EXPONENT,
    "tower_fore_aft_del": TOWER_EXPONENT,
    "tower_side_side_del": TOWER_EXPONENT,
}
"""Damage-equivalent loads that are weighted over the wind speeds, and their Woehler exponents."""

# What counts of these is their sum over the winds, in which no wind may be left out.
_ADD_UP = ("mean_power", "corrected_power", "energy")
# Differences below this share do not count even where chance is excluded.
_NEGLIGIBLE = 0.01


@dataclass(frozen=True)
class Estimate:
    """A number and its 95 % interval.

    Attributes
    ----------
    value : float
    low, high : float
        NaN where there are too few winds for an interval.
    relative : bool
        Whether it is a share of the baseline's value; else it is in the unit shown for the metric.
    n_winds : int
    """

    value: float
    low: float
    high: float
    relative: bool
    n_winds: int

    @property
    def has_interval(self) -> bool:
        """Whether there were winds enough for one."""
        return not math.isnan(self.low)

    def kind(self, key: str) -> str:
        """What a change of a metric means: ``"better"``, ``"worse"``, ``"equal"``, ``"open"`` or ``"none"``.

        ``"better"`` and ``"worse"`` are changes of at least 1 % (or half the last digit shown) whose interval, if there
        is one, excludes zero. ``"equal"`` is shown to be smaller: the whole interval is, or nothing changed at all.
        ``"open"`` is all else: no difference was seen, and none was excluded. ``"none"`` is for metrics without a
        better direction.
        """
        metric = METRICS[key]
        least = _NEGLIGIBLE if self.relative else 0.5 * 10.0**-metric.digits
        if metric.better == 0:
            return "none"
        if self.value == 0.0 and not self.has_interval:
            return "equal"
        if self.has_interval and max(abs(self.low), abs(self.high)) < least:
            return "equal"
        if abs(self.value) < least or (self.has_interval and self.low <= 0.0 <= self.high):
            return "open"
        return "better" if self.value * metric.better > 0 else "worse"


def shared_winds(evaluation: Evaluation, agent: str, speed: float | None = None) -> list[Wind]:
    """Winds, of one speed or all, that both the agent and the baseline completed."""
    return [
        wind
        for wind in evaluation.winds
        if speed in (None, wind.speed)
        and all(evaluation.run(name, wind).complete for name in (agent, evaluation.baseline))
    ]


def paired_change(evaluation: Evaluation, agent: str, key: str, speed: float | None = None) -> Estimate | None:
    """Change of a metric against the baseline in the same winds.

    The interquartile mean of the changes in each wind both completed, for power and energy the change of their sums,
    because what one wind costs another must earn; with a bootstrap interval stratified by wind speed. Relative where
    `wt_gym.analysis.change.is_relative` of the baseline's values.

    Parameters
    ----------
    evaluation : Evaluation
    agent : str
    key : str
        Of `METRICS`.
    speed : float, optional
        Only winds of this mean speed [m/s].

    Returns
    -------
    Estimate or None
        None where no wind can be compared.
    """
    winds = shared_winds(evaluation, agent, speed)
    mine, base = (_values(evaluation, name, winds, key) for name in (agent, evaluation.baseline))
    if mine is None or base is None:
        return None
    relative = is_relative(key, base)
    changes = relative_change(mine, base) if relative else (mine - base) * METRICS[key].factor
    speeds = tuple(wind.speed for wind in winds)
    if key in _ADD_UP:
        if relative:
            return _estimate(speeds, lambda k: relative_change(mine[k].sum(axis=-1), base[k].sum(axis=-1)), relative)
        return _estimate(speeds, lambda k: changes[k].mean(axis=-1), relative)
    return _estimate(speeds, lambda k: interquartile_mean(changes[k], axis=-1), relative)


def level_of(evaluation: Evaluation, agent: str, key: str, speed: float | None = None) -> Estimate | None:
    """Mean of a metric of an agent over the winds both completed, in the unit shown, with a bootstrap interval."""
    winds = shared_winds(evaluation, agent, speed)
    values = _values(evaluation, agent, winds, key)
    if values is None:
        return None
    shown = values * METRICS[key].factor
    return _estimate(tuple(wind.speed for wind in winds), lambda k: shown[k].mean(axis=-1), False)


def lifetime(evaluation: Evaluation, agent: str, key: str) -> float | None:
    """Damage-equivalent load over the operating life of a wind climate.

    Parameters
    ----------
    evaluation : Evaluation
        With a climate.
    agent : str
    key : str
        Of `LIFETIME_EXPONENTS`.

    Returns
    -------
    float or None
        Unit of the load, N m; None without a climate, or where a run of the agent ended early.
    """
    loads, weights = _lifetime_inputs(evaluation, agent, key)
    return None if loads is None or weights is None else float(lifetime_load(loads, weights, LIFETIME_EXPONENTS[key]))


def lifetime_change(evaluation: Evaluation, agent: str, key: str) -> Estimate | None:
    """Relative change of `lifetime` against the baseline, with a paired bootstrap interval; None without either."""
    mine, weights = _lifetime_inputs(evaluation, agent, key)
    base, _ = _lifetime_inputs(evaluation, evaluation.baseline, key)
    if mine is None or weights is None or base is None or not np.any(base > 0.0):
        return None
    exponent = LIFETIME_EXPONENTS[key]

    def ratio(k: NDArray[np.intp]) -> NDArray[np.float64]:
        loads = (lifetime_load(each[k], weights, exponent) for each in (mine, base))
        return np.asarray(relative_change(*loads))

    return _estimate(tuple(wind.speed for wind in evaluation.winds), ratio, True)


def _lifetime_inputs(
    evaluation: Evaluation, agent: str, key: str
) -> tuple[NDArray[np.float64] | None, NDArray[np.float64] | None]:
    """Loads of an agent in every wind, and the share of the time of each; the winds of a speed share its weight."""
    values = _values(evaluation, agent, evaluation.winds, key)
    if evaluation.climate is None or values is None or not all(run.complete for run in evaluation.runs_of(agent)):
        return None, None
    speeds = [wind.speed for wind in evaluation.winds]
    shares = dict(zip(evaluation.speeds, wind_weights(evaluation.climate, evaluation.speeds), strict=True))
    return values, np.array([shares[speed] / speeds.count(speed) for speed in speeds])


def _values(evaluation: Evaluation, agent: str, winds: list[Wind], key: str) -> NDArray[np.float64] | None:
    """Metric of an agent in some winds, shape (n_winds,); None where there are none, or a run lacks it."""
    tables = [evaluation.run(agent, wind).metrics for wind in winds]
    return np.array([table[key] for table in tables]) if tables and all(key in table for table in tables) else None


def _estimate(
    strata: tuple[float, ...], statistic: Callable[[NDArray[np.intp]], ArrayLike], relative: bool
) -> Estimate:
    """Statistic of all winds, and its interval where every wind speed has winds enough."""
    value = float(np.asarray(statistic(np.arange(len(strata)))))
    low = high = math.nan
    if min(strata.count(speed) for speed in set(strata)) >= LEAST_PER_STRATUM:
        low, high = bootstrap_interval(statistic, strata)
    return Estimate(value, low, high, relative, len(strata))
