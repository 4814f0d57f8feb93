"""Damage-equivalent loads with their gradient: rainflow counting pairs samples, and the load depends on their ranges.

With cycles of range S_i and count n_i, L = (sum n_i S_i^m / N)^(1/m). As long as no turning point changes its partner,
S_i is the difference of two samples, so the gradient of L by the samples is exact almost everywhere.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numba
import numpy as np
import torch

if TYPE_CHECKING:
    from numpy.typing import NDArray

__all__ = ["cycle_ends", "damage_equivalent_load"]


@numba.njit(cache=True)
def cycle_ends(signal: NDArray[np.float64]) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Cycles of a signal by rainflow counting (ASTM E1049-85, 5.4.4).

    Parameters
    ----------
    signal : numpy.ndarray, shape (n,)

    Returns
    -------
    ends : numpy.ndarray, shape (n_cycles, 2)
        Samples between which each cycle goes.
    counts : numpy.ndarray, shape (n_cycles,)
        1, or 0.5 for half cycles.
    """
    n = signal.size
    turning = np.empty(n, np.int64)
    turning[0], size = 0, 1
    for k in range(1, n - 1):
        if (signal[k] - signal[turning[size - 1]]) * (signal[k + 1] - signal[k]) < 0.0:
            turning[size] = k
            size += 1
    turning[size] = n - 1
    size += 1
    ends, counts = np.empty((size, 2), np.int64), np.empty(size)
    stack = np.empty(size, np.int64)
    depth = found = 0
    for j in range(size):
        stack[depth] = turning[j]
        depth += 1
        while depth >= 3:
            last = abs(signal[stack[depth - 1]] - signal[stack[depth - 2]])
            before = abs(signal[stack[depth - 2]] - signal[stack[depth - 3]])
            if last < before:
                break
            ends[found] = stack[depth - 3], stack[depth - 2]
            if depth == 3:  # it holds the start: half a cycle
                counts[found] = 0.5
                stack[0], stack[1] = stack[1], stack[2]
                depth = 2
            else:
                counts[found] = 1.0
                stack[depth - 3] = stack[depth - 1]
                depth -= 2
            found += 1
    for j in range(depth - 1):
        ends[found] = stack[j], stack[j + 1]
        counts[found] = 0.5
        found += 1
    return ends[:found], counts[:found]


def damage_equivalent_load(signal: torch.Tensor, duration: float, exponent: float) -> torch.Tensor:
    """Range of as many equal cycles as the time has seconds that damages as the signal does.

    As `wt_gym.analysis.metrics.damage_equivalent_load`, with a gradient.

    Parameters
    ----------
    signal : torch.Tensor, shape (n,)
    duration : float
        [s].
    exponent : float
        Of the S-N curve [-].

    Returns
    -------
    torch.Tensor, shape ()
        In the unit of the signal.
    """
    ends, counts = cycle_ends(signal.detach().numpy().astype(np.float64))
    ranges = (signal[ends[:, 0]] - signal[ends[:, 1]]).abs()
    largest = ranges.detach().max()  # powers of ten of loads in N m would overflow
    if largest == 0.0:
        return signal.sum() * 0.0
    weighted = torch.from_numpy(counts).to(signal.dtype) * (ranges / largest) ** exponent
    return largest * (weighted.sum() / duration) ** (1.0 / exponent)
