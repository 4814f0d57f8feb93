"""Spectra of recorded signals."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy import signal as scipy_signal

if TYPE_CHECKING:
    from numpy.typing import NDArray

__all__ = ["power_spectral_density"]


def power_spectral_density(
    signal: NDArray[np.float64], time_step: float, segment_duration: float = 60.0
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """One-sided power spectral density by Welch's method.

    Segments with a Hann window overlap by half; the mean of each is removed. Welch, IEEE Trans. Audio Electroacoustics
    15 (1967) 70.

    Parameters
    ----------
    signal : numpy.ndarray, shape (n,)
        Evenly sampled.
    time_step : float
        [s]
    segment_duration : float
        Length of a segment [s]: the inverse of the resolution in frequency. Cut to the length of the signal.

    Returns
    -------
    frequency : numpy.ndarray, shape (m,)
        Without zero [Hz].
    density : numpy.ndarray, shape (m,)
        Unit of the signal squared per Hz; its integral over frequency is the variance.

    Raises
    ------
    ValueError
        If the signal has less than eight samples or the time step is not positive.
    """
    signal = np.asarray(signal, dtype=np.float64)
    if signal.ndim != 1 or signal.size < 8 or not time_step > 0:
        raise ValueError(
            f"a spectrum needs at least 8 samples and a positive time step, got {signal.shape}, {time_step!r} s"
        )
    samples = min(signal.size, max(8, round(segment_duration / time_step)))
    frequency, density = scipy_signal.welch(signal, fs=1.0 / time_step, nperseg=samples, detrend="constant")
    return frequency[1:], density[1:]
