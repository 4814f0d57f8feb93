"""Changes against the baseline, wind by wind, with intervals, and loads over the life of a wind climate.

Interquartile mean and stratified bootstrap follow Agarwal et al., Deep reinforcement learning at the edge of the
statistical precipice, NeurIPS 2021: runs are pooled over the tasks (here the wind speeds), and resampled within each of
them. The percentiles are expanded ones.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import ndtr, stdtrit

from wt_gym.analysis.metrics import BLADE_EXPONENT, TOWER_EXPONENT, Metric, metric_of
from wt_gym.wind.iec import AVERAGE_OVER_REFERENCE_SPEED, reference_speed

if TYPE_CHECKING:
    from wt_gym.analysis.results import Evaluation, Wind


LEAST_PER_STRATUM = 3
"""Winds that each stratum needs for an interval: one or two hardly differ from their resamples."""
N_RESAMPLES = 10_000


def interquartile_mean(values: NDArray[np.float64], axis: int = -1) -> NDArray[np.float64]:
    """Mean of the middle half: a quarter of the values, rounded down, is left out at either end."""
    values = np.sort(np.moveaxis(np.asarray(values, dtype=np.float64), axis, -1), axis=-1)
    cut = values.shape[-1] // 4
    return np.asarray(values[..., cut : values.shape[-1] - cut].mean(axis=-1))


@lru_cache(maxsize=64)
def stratified_resamples(strata: Sequence[float], n_resamples: int = N_RESAMPLES, seed: int = 0) -> NDArray[np.intp]:
    """Indices (n_resamples, n) drawn with replacement: column k holds those of the stratum, the speed, of value k."""
    rng, labels = np.random.default_rng(seed), np.asarray(strata)
    indices = np.empty((n_resamples, labels.size), dtype=np.intp)
    for label in np.unique(labels):
        members = np.flatnonzero(labels == label)
        indices[:, members] = rng.choice(members, size=(n_resamples, members.size))
    indices.flags.writeable = False  # shared by every caller
    return indices


def bootstrap_interval(
    statistic: Callable[[NDArray[np.intp]], ArrayLike], strata: Sequence[float], level: float = 0.95
) -> tuple[float, float]:
    """Interval of a statistic of a few values, each redrawn within its stratum.

    Between the percentiles of the expanded bootstrap (Hesterberg, The American Statistician 69 (2015) 371, section
    4.3): those of Student's t in place of the normal distribution, and wider by what resamples scatter too little,
    sqrt(n / (n - 1)) of the smallest stratum. For a handful of values the plain percentiles are too close.

    Parameters
    ----------
    statistic : callable
        Gets indices of values, shape (n_resamples, n), and gives the statistic of each row, shape (n_resamples,).
    strata : sequence of float
        What each value belongs to; at least two values to each.
    level : float
        Share of such intervals that hold the truth.

    Raises
    ------
    ValueError
        If a stratum has a single value.
    """
    sizes = np.unique(np.asarray(strata), return_counts=True)[1]
    if sizes.min() < 2:
        raise ValueError(f"an interval needs at least two values in each stratum, got {sizes.tolist()}")
    samples = np.asarray(statistic(stratified_resamples(tuple(strata))))
    wider = float(np.sqrt(sizes.min() / (sizes.min() - 1.0)))
    tail = float(ndtr(wider * stdtrit(np.sum(sizes - 1), 0.5 * (1.0 - level))))
    low, high = np.quantile(samples, [tail, 1.0 - tail])
    return float(low), float(high)


# ---- loads over a life ----

LIFETIME_EXPONENTS = {
    "blade_flap_del": BLADE_EXPONENT,
    "blade_edge_del": BLADE_EXPONENT,
    "tower_fore_aft_del": TOWER_EXPONENT,
    "tower_side_side_del": TOWER_EXPONENT,
}
"""Damage-equivalent loads that are weighted over the wind speeds, and their Woehler exponents."""

SHAPES = (0.5, 10.0)
"""Least and largest Weibull exponent of a wind climate [-]; measured ones lie between 1 and 4."""
LEAST_SHARE = 1e-3
"""Least share of the time in which the wind must be one of operation."""


@dataclass(frozen=True)
class WindClimate:
    """Weibull distribution of the ten-minute mean wind speed at hub height, and the speeds of operation.

    Raises a `ValueError` also where the wind is one of operation for less than a share of `LEAST_SHARE` of the time.
    """

    mean_speed: float
    """Annual mean [m/s]; IEC 61400-1 sets it to 0.2 times the reference speed of the class."""
    shape: float = 2.0
    """Weibull exponent k [-], within `SHAPES`; 2 is the Rayleigh distribution of the standard."""
    cut_in: float = 3.0
    cut_out: float = 25.0
    """cut_in, cut_out: between these the turbine operates [m/s]."""

    def __post_init__(self) -> None:
        for name in ("mean_speed", "shape"):
            value = getattr(self, name)
            if not 0.0 < value < math.inf:
                raise ValueError(f"{name} of a wind climate must be positive and finite, got {value!r}")
        if not 0.0 <= self.cut_in < self.cut_out < math.inf:
            raise ValueError(f"0 <= cut-in < cut-out is needed, got {self.cut_in!r} and {self.cut_out!r} m/s")
        if not SHAPES[0] <= self.shape <= SHAPES[1]:
            raise ValueError(f"shape of a wind climate must lie in {SHAPES[0]} to {SHAPES[1]}, got {self.shape!r}")
        if self.share_below(self.cut_out) - self.share_below(self.cut_in) < LEAST_SHARE:
            raise ValueError(
                f"a wind climate must have winds between cut-in and cut-out, {self.cut_in:g} to {self.cut_out:g} m/s, "
                f"for {LEAST_SHARE:g} of the time; a mean_speed of {self.mean_speed:g} m/s with shape {self.shape:g} "
                "has not"
            )

    @classmethod
    def of_class(
        cls, turbine_class: str, shape: float = 2.0, cut_in: float = 3.0, cut_out: float = 25.0
    ) -> WindClimate:
        """Climate of class "I", "II" or "III" of IEC 61400-1: 10, 8.5 or 7.5 m/s on average."""
        return cls(AVERAGE_OVER_REFERENCE_SPEED * reference_speed(turbine_class), shape, cut_in, cut_out)

    @property
    def scale(self) -> float:
        """Weibull scale A = mean / Γ(1 + 1/k) [m/s]."""
        return self.mean_speed / math.gamma(1.0 + 1.0 / self.shape)

    def share_below(self, speed: float) -> float:
        """Share of the time with a mean wind below a speed [m/s]: 1 − exp(−(v/A)^k)."""
        relative = min(speed / self.scale, 1e9)  # beyond it the share is 1, and a power would overflow
        return -math.expm1(-(relative**self.shape))


def wind_weights(climate: WindClimate, speeds: Sequence[float]) -> NDArray[np.float64]:
    """Share of the operating time that each of some wind speeds stands for, shape (n_speeds,); their sum is 1.

    Every wind between cut-in and cut-out counts for the nearest of the speeds: bins end half-way between neighbors,
    the outermost at cut-in and cut-out. Speeds [m/s] must ascend within cut-in and cut-out.
    """
    values = np.asarray(speeds, dtype=np.float64)
    if values.size == 0 or np.any(np.diff(values) <= 0.0) or values[0] < climate.cut_in or values[-1] > climate.cut_out:
        raise ValueError(
            f"wind speeds must ascend from cut-in {climate.cut_in:g} m/s to cut-out {climate.cut_out:g} m/s, "
            f"got {list(map(float, values))}"
        )
    edges = np.concatenate([[climate.cut_in], 0.5 * (values[1:] + values[:-1]), [climate.cut_out]])
    shares = np.diff([climate.share_below(edge) for edge in edges])
    return np.asarray(shares / shares.sum())


def lifetime_load(loads: NDArray[np.float64], weights: NDArray[np.float64], exponent: float) -> NDArray[np.float64]:
    """Load at 1 Hz throughout that does the damage of all loads in their shares of the time: (Σ w L^m)^(1/m).

    Of damage-equivalent loads (..., n), not negative, their shares of the time (n,), whose sum is 1, and the Woehler
    exponent m [-]; shape (...).
    """
    loads = np.asarray(loads, dtype=np.float64)
    largest = loads.max(axis=-1, keepdims=True)
    # relative to the largest: 1e7 to the tenth power would waste the digits of a float
    relative = np.divide(loads, largest, out=np.zeros_like(loads), where=largest > 0.0)
    return np.asarray(largest[..., 0] * np.sum(weights * relative**exponent, axis=-1) ** (1.0 / exponent))


# ---- changes against the baseline ----

# What counts of these is their sum over the winds, in which no wind may be left out.
_ADD_UP = ("mean_power", "corrected_power", "energy")
NEGLIGIBLE = 0.01
"""Changes below this share do not count even where chance is excluded."""


def is_relative(key: str | Metric, reference: ArrayLike) -> bool:
    """Return True if changes of a metric against some references [SI] are shares of these.

    They are, unless the metric is a count or a margin with a sign, or a reference rounds to zero in the unit shown.
    """
    metric = metric_of(key)
    return metric.share and bool(np.all(np.abs(reference) * metric.factor >= 10.0**-metric.digits))


def relative_change(value: ArrayLike, reference: ArrayLike) -> Any:
    """Difference over the size of the reference [-], arrays or numbers; positive where the value is the larger.

    NaN where the reference is zero, unless the value is zero as well: nothing has changed then.
    """
    difference = np.subtract(value, reference, dtype=float)
    size = np.broadcast_to(np.abs(np.asarray(reference, dtype=float)), difference.shape)
    share = np.where(difference == 0.0, 0.0, np.nan)
    np.divide(difference, size, out=share, where=size > 0.0)
    return share if share.ndim else float(share)


def difference(key: str | Metric, value: ArrayLike, reference: ArrayLike) -> tuple[Any, bool]:
    """Change of a metric against references [SI], value by value; True where it is a share of these (`is_relative`).

    Otherwise it is in the unit shown.
    """
    if is_relative(key, reference):
        return relative_change(value, reference), True
    return np.subtract(value, reference) * metric_of(key).factor, False


@dataclass(frozen=True)
class Estimate:
    """A number and its 95 % interval."""

    value: float
    low: float
    high: float
    """low, high: NaN where there are too few winds for an interval."""
    relative: bool
    """Share of the baseline's value; else it is in the unit shown for the metric."""
    n_winds: int

    @property
    def has_interval(self) -> bool:
        """Return True if there were winds enough for one."""
        return not math.isnan(self.low)

    def kind(self, key: str | Metric) -> str:
        """Meaning of a change of a metric: ``"better"``, ``"worse"``, ``"equal"``, ``"open"`` or ``"none"``.

        ``"better"`` and ``"worse"`` are changes of at least 1 % (or half the last digit shown) whose interval, if there
        is one, excludes zero. ``"equal"`` is shown to be smaller: the whole interval is, or nothing changed at all.
        ``"open"`` is all else: no difference was seen, and none was excluded. ``"none"`` is for metrics without a
        better direction.
        """
        metric = metric_of(key)
        least = NEGLIGIBLE if self.relative else 0.5 * 10.0**-metric.digits
        if metric.better == 0:
            return "none"
        if self.value == 0.0 and not self.has_interval:
            return "equal"
        if self.has_interval and max(abs(self.low), abs(self.high)) < least:
            return "equal"
        if abs(self.value) < least or (self.has_interval and self.low <= 0.0 <= self.high):
            return "open"
        return "better" if self.value * metric.better > 0 else "worse"

    def to_json(self) -> dict[str, Any]:
        """JSON values: None for NaN."""
        return {name: None if value != value else value for name, value in asdict(self).items()}

    @classmethod
    def from_json(cls, record: Mapping[str, Any]) -> Estimate:
        """Read what `to_json` gave."""
        values: dict[str, Any] = {name: math.nan if value is None else value for name, value in record.items()}
        return cls(**values)


def change_in_winds(key: str | Metric, values: ArrayLike, baseline: ArrayLike, speeds: Sequence[float]) -> Estimate:
    """Change of a metric against the baseline in the same winds.

    The interquartile mean of the changes in each wind, for power and energy the change of their sums, because what one
    wind costs another must earn; with a bootstrap interval stratified by wind speed. Relative where `is_relative` of
    the baseline's values.

    Parameters
    ----------
    values, baseline : array_like, shape (n_winds,)
        SI unit, at least one.
    speeds : sequence of float, length n_winds
        Mean wind speeds [m/s].
    """
    mine, base = np.asarray(values, dtype=float), np.asarray(baseline, dtype=float)
    changes, relative = difference(key, mine, base)
    if key not in _ADD_UP:
        return estimate(speeds, lambda k: interquartile_mean(changes[k]), relative)
    if not relative:
        return estimate(speeds, lambda k: changes[k].mean(axis=-1), relative)
    return estimate(speeds, lambda k: relative_change(mine[k].sum(axis=-1), base[k].sum(axis=-1)), relative)


def estimate(
    strata: Sequence[float], statistic: Callable[[NDArray[np.intp]], ArrayLike], relative: bool,
    least: int = LEAST_PER_STRATUM,
) -> Estimate:  # fmt: skip
    """Statistic of all winds, and its `bootstrap_interval` where every stratum has the least number of winds.

    Parameters
    ----------
    strata : sequence of float, length n_winds
    statistic : callable
        From indices of winds, shape (..., n_winds), to the statistic of each row, shape (...).
    """
    value = float(np.asarray(statistic(np.arange(len(strata)))))
    low = high = math.nan
    if min(Counter(strata).values()) >= least:
        low, high = bootstrap_interval(statistic, strata)
    return Estimate(value, low, high, relative, len(strata))


# ---- of an evaluation ----


def shared_winds(evaluation: Evaluation, agent: str, speed: float | None = None) -> list[Wind]:
    """Winds, of one speed or all, that both the agent and the baseline completed."""
    return [
        wind
        for wind in evaluation.winds
        if speed in (None, wind.speed)
        and all(evaluation.run(name, wind).complete for name in (agent, evaluation.baseline))
    ]


def paired_change(evaluation: Evaluation, agent: str, key: str, speed: float | None = None) -> Estimate | None:
    """Change of a metric against the baseline, as `change_in_winds`, over the winds of a mean speed [m/s] or all.

    None where no wind can be compared.
    """
    winds = shared_winds(evaluation, agent, speed)
    mine, base = (_values(evaluation, name, winds, key) for name in (agent, evaluation.baseline))
    return None if mine is None or base is None else change_in_winds(key, mine, base, [wind.speed for wind in winds])


def level_of(evaluation: Evaluation, agent: str, key: str, speed: float | None = None) -> Estimate | None:
    """Mean of a metric of an agent over the winds both completed, in the unit shown, with a bootstrap interval."""
    winds = shared_winds(evaluation, agent, speed)
    values = _values(evaluation, agent, winds, key)
    if values is None:
        return None
    shown = values * metric_of(key).factor
    return estimate([wind.speed for wind in winds], lambda k: shown[k].mean(axis=-1), False)


def lifetime(evaluation: Evaluation, agent: str, key: str) -> float | None:
    """Damage-equivalent load [N m] over the operating life of a wind climate; ``key`` is one of `LIFETIME_EXPONENTS`.

    None without a climate, or where a run of the agent ended early.
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

    return estimate([wind.speed for wind in evaluation.winds], ratio, True)


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
