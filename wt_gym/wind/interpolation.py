"""Effect of linear interpolation between the samples of a box on its spectrum.

Samples dt apart are read by linear interpolation. A harmonic of frequency f, x = f dt, keeps the amplitude sinc²(x),
sinc(x) = sin(πx)/(πx): the Fourier transform of the triangle with which linear interpolation convolves the samples
(Oppenheim and Schafer, Discrete-Time Signal Processing, section 4.6). The rest appears as images at |m/dt ± f| with the
amplitudes sinc²(m ± x). Together they hold the share (2 + cos 2πx)/3 of the variance: the mean square on the line from
a to b is (a² + ab + b²)/3. Samples whose amplitudes are divided by sinc² therefore give the interpolated wind exactly
the required spectrum up to half the sampling frequency. x depends only on the number of the harmonic in the record, so
that this holds at every speed at which a box is carried along.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

__all__ = ["SPECTRUM_OF", "sample_gain", "variance_read"]

SPECTRUM_OF = ("interpolated", "samples")
"""Of what a box has the spectrum and the standard deviation: of the wind as it is read, or of the bare samples."""


def sample_gain(n_times: int, spectrum_of: str) -> NDArray[np.float64]:
    """Variance of the samples over the required one, of the harmonics 1, 2, … below half the sampling frequency.

    Parameters
    ----------
    n_times
        Number of samples.
    spectrum_of
        Of `SPECTRUM_OF`.

    Returns
    -------
    numpy.ndarray
        Shape ((n_times - 1) // 2,).
    """
    place = _places(n_times)
    return np.ones(place.size) if spectrum_of == "samples" else np.sinc(place) ** -4


def variance_read(n_times: int, spectrum_of: str) -> NDArray[np.float64]:
    """Variance that counts for the standard deviation of a box over the required one, by harmonic with its images.

    Parameters
    ----------
    n_times, spectrum_of
        As of `sample_gain`.

    Returns
    -------
    numpy.ndarray
        Shape ((n_times - 1) // 2,).
    """
    place = _places(n_times)
    if spectrum_of == "samples":
        return np.ones(place.size)
    return (2.0 + np.cos(2.0 * np.pi * place)) / 3.0 * sample_gain(n_times, spectrum_of)


def _places(n_times: int) -> NDArray[np.float64]:
    """Frequencies of the harmonics times the sampling interval."""
    return np.arange(1, (n_times - 1) // 2 + 1) / n_times
