"""Series in time of the quadratics of a design: values of mean, tilt and yaw at the blades, and weights of loads."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from scipy.ndimage import maximum_filter1d, minimum_filter1d
from scipy.signal import fftconvolve

if TYPE_CHECKING:
    from numpy.typing import NDArray

__all__ = ["POWER", "TOWER", "amplitude_weights", "to_blades", "without_slow"]

TOWER = (6, 7)
POWER = 8
"""Places of `wt_gym.learning.linear_design.recording.LOADS` behind the six outputs in the responses of a plant."""


def to_blades(values: NDArray[np.float64], azimuth: NDArray[np.float64], n_blades: int) -> NDArray[np.float64]:
    """Values (..., n_blades, n) of mean, tilt and yaw (..., 3, n), blade 1 at ``azimuth`` (n,) [rad]."""
    angles = azimuth + 2.0 * math.pi / n_blades * np.arange(n_blades)[:, None]
    out: NDArray[np.float64] = (
        values[..., 0:1, :] + values[..., 1:2, :] * np.cos(angles) + values[..., 2:3, :] * np.sin(angles)
    )
    return out


def without_slow(series: NDArray[np.float64], length: int) -> NDArray[np.float64]:
    """Series (..., n) without a smooth mean."""
    window = np.hanning(2 * (length // 2) + 3)[1:-1]
    window /= window.sum()
    half = window.size // 2
    padded = np.pad(series, [(0, 0)] * (series.ndim - 1) + [(half, half)], mode="edge")
    smooth: NDArray[np.float64] = fftconvolve(
        padded, window.reshape((1,) * (series.ndim - 1) + (-1,)), "valid", axes=-1
    )
    return series - smooth


def amplitude_weights(series: NDArray[np.float64], exponent: float, window: int) -> NDArray[np.float64]:
    """Weights (..., n) of the local range over its 90 % quantile, within bounds that keep single cycles from ruling."""
    span = maximum_filter1d(series, window, axis=-1) - minimum_filter1d(series, window, axis=-1)
    common = np.quantile(span, 0.9, axis=-1, keepdims=True)
    out: NDArray[np.float64] = np.clip((span / common) ** exponent, 0.02, 6.0)
    return out
