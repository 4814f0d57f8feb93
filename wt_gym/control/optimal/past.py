"""The past of measured quantities as a controller uses it: without what lasts, in bins of delays that widen."""

from __future__ import annotations

import itertools
import math
from typing import TYPE_CHECKING

import numpy as np
from scipy.signal import lfilter

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

__all__ = ["bin_means", "delay_bins", "spread_over_bins", "without_lasting"]


def delay_bins(longest: float, dt: float, fine: int = 6, growth: float = 1.3) -> tuple[tuple[int, int], ...]:
    """Bins [first, last) of delays in steps: single steps, then wider and wider ones.

    Parameters
    ----------
    longest : float
        Delay that the last bin reaches [s].
    dt : float
        [s].
    fine : int
        Number of bins of one step.
    growth : float
        Of the width from one bin to the next.
    """
    end = max(round(longest / dt), fine)
    edges = list(range(fine + 1))
    width = 1.0
    while edges[-1] < end:
        width *= growth
        edges.append(min(edges[-1] + max(round(width), 1), end))
    return tuple(itertools.pairwise(edges))


def without_lasting(series: NDArray[np.float64], time_constant: float, dt: float) -> NDArray[np.float64]:
    """Series (..., n) minus its first-order low-pass, which starts in steady state; 0: as it is."""
    if time_constant == 0.0:
        return series
    kept = math.exp(-dt / time_constant)
    lasting, _ = lfilter([1.0 - kept], [1.0, -kept], series, axis=-1, zi=kept * series[..., :1])
    out: NDArray[np.float64] = series - lasting
    return out


def bin_means(series: NDArray[np.float64], bins: Sequence[tuple[int, int]]) -> NDArray[np.float64]:
    """Means over bins of delays (n_bins, n) of a series (n,) that stood at its first value before."""
    longest = max(last for _, last in bins)
    sums = np.concatenate([[0.0], np.cumsum(np.concatenate([np.full(longest, series[0]), series]))])
    now = np.arange(series.size) + longest + 1
    return np.stack([(sums[now - first] - sums[now - last]) / (last - first) for first, last in bins])


def spread_over_bins(coefficients: NDArray[np.float64], bins: Sequence[tuple[int, int]]) -> NDArray[np.float64]:
    """Coefficient of each delay (..., n_delays) of coefficients of bin means (..., n_bins)."""
    widths = np.array([last - first for first, last in bins])
    return np.repeat(coefficients / widths, widths, axis=-1)
