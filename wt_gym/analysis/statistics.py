"""How far a few winds carry: interquartile mean and stratified bootstrap, of evaluations and of the benchmark.

Both follow Agarwal et al., Deep reinforcement learning at the edge of the statistical precipice, NeurIPS 2021: runs are
pooled over the tasks (here the wind speeds), and resampled within each of them. The percentiles are expanded ones.
"""

from __future__ import annotations

from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np
from scipy.special import ndtr, stdtrit

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from numpy.typing import ArrayLike, NDArray

__all__ = ["LEAST_PER_STRATUM", "N_RESAMPLES", "bootstrap_interval", "interquartile_mean", "stratified_resamples"]

LEAST_PER_STRATUM = 3
"""Winds that each stratum needs for an interval: one or two hardly differ from their resamples."""

N_RESAMPLES = 10_000


def interquartile_mean(values: NDArray[np.float64], axis: int = -1) -> NDArray[np.float64]:
    """Mean of the middle half: a quarter of the values, rounded down, is left out at either end.

    Parameters
    ----------
    values : numpy.ndarray
    axis : int
        Of length n; is gone in the result.

    Returns
    -------
    numpy.ndarray
    """
    values = np.sort(np.moveaxis(np.asarray(values, dtype=np.float64), axis, -1), axis=-1)
    cut = values.shape[-1] // 4
    out: NDArray[np.float64] = values[..., cut : values.shape[-1] - cut].mean(axis=-1)
    return out


@lru_cache(maxsize=64)
def stratified_resamples(strata: Sequence[float], n_resamples: int = N_RESAMPLES, seed: int = 0) -> NDArray[np.intp]:
    """Indices of resamples, drawn with replacement within each stratum.

    Parameters
    ----------
    strata : tuple of float
        What each value belongs to, its wind speed.
    n_resamples, seed : int

    Returns
    -------
    numpy.ndarray of int, shape (n_resamples, n)
        Column k holds indices of the stratum of value k.
    """
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

    Returns
    -------
    low, high : float

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
