"""How far a few winds carry: interquartile mean and stratified bootstrap.

Both follow Agarwal et al., Deep reinforcement learning at the edge of the statistical precipice, NeurIPS 2021: runs are
pooled over the tasks (here the wind speeds), and resampled within each of them.
"""

from __future__ import annotations

from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

__all__ = ["LEAST_PER_STRATUM", "N_RESAMPLES", "interquartile_mean", "percentile_interval", "stratified_resamples"]

LEAST_PER_STRATUM = 3
"""Winds that each stratum needs for an interval: one or two hardly differ from their resamples."""

N_RESAMPLES = 10_000


def interquartile_mean(values: np.ndarray, axis: int = -1) -> np.ndarray:
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
    return values[..., cut : values.shape[-1] - cut].mean(axis=-1)


@lru_cache(maxsize=64)
def stratified_resamples(strata: Sequence[float], n_resamples: int = N_RESAMPLES, seed: int = 0) -> np.ndarray:
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


def percentile_interval(samples: np.ndarray, level: float = 0.95) -> tuple[float, float]:
    """Interval between the percentiles of a bootstrap distribution.

    Parameters
    ----------
    samples : numpy.ndarray, shape (n_resamples,)
        The statistic of each resample.
    level : float
        Share of the distribution inside.
    """
    low, high = np.quantile(samples, [0.5 * (1.0 - level), 0.5 * (1.0 + level)])
    return float(low), float(high)
