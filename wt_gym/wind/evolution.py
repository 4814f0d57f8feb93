"""Turbulence that changes on its way to the rotor: what it was where a lidar sees it.

Taylor's frozen turbulence reaches the rotor as it was seen. Real turbulence loses its resemblance with the way, small
eddies first. With k = f/U, the magnitude-squared coherence of two points at a distance d along the wind is

    gamma^2 = exp(-a d sqrt(k^2 + b^2)),   a = 8.4 sigma/U + 0.05,   b = 0.25 L^-1.24

(Simley and Pao, American Control Conference 2015, 3708, Eq. 7, from large-eddy simulation), sigma^2 = sigma_u^2 +
sigma_v^2 + sigma_w^2 and L = 8.1 Lambda_1 the integral length of IEC 61400-1 [m]. As its logarithm is linear in d, the
field that is seen from one gate of a lidar after the other is a Markov chain, for every harmonic of a box

    u_d = rho u_0 + sqrt(1 - rho^2) u',   rho = gamma(d),

and so on from d to the next gate, u' a field independent of all nearer ones with the same spectra and coherence across
the wind (the unfreezing of Bossanyi, Torque 2012, and of Chen, Guo, Schlipf and Cheng, Wind Energ. Sci. 7 (2022) 539).
u' is u_0 with a random phase for each harmonic, the same at all points and in all components: independent of it, and of
the same strength as it, in the mean over the phases.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from scipy import fft

from wt_gym.wind.iec import length_scale

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import ArrayLike, NDArray

    from wt_gym.wind.turbulence_box import TurbulenceBox

__all__ = ["coherence_along", "evolved_boxes"]


def coherence_along(
    distance: ArrayLike, wavenumber: ArrayLike, intensity: float, hub_height: float
) -> NDArray[np.float64]:
    """Coherence of the wind at two points along its direction, gamma (the root of the magnitude-squared one).

    Parameters
    ----------
    distance : array_like
        Between the points [m].
    wavenumber : array_like
        f/U [1/m].
    intensity : float
        Root of the sum of the three variances over the mean speed [-].
    hub_height : float
        [m]

    Returns
    -------
    numpy.ndarray
        Broadcast of distance and wavenumber [-].
    """
    decay = 8.4 * intensity + 0.05
    offset = 0.25 * (8.1 * length_scale(hub_height)) ** -1.24
    out: NDArray[np.float64] = np.exp(-0.5 * decay * np.asarray(distance) * np.hypot(wavenumber, offset))
    return out


def evolved_boxes(box: TurbulenceBox, distances: Sequence[float]) -> tuple[TurbulenceBox, ...]:
    """Turbulence as it is at distances ahead of where it is ``box``.

    Parameters
    ----------
    box : TurbulenceBox
        What arrives at the rotor.
    distances : sequence of float
        Ahead of the rotor [m].

    Returns
    -------
    tuple of TurbulenceBox
        For each distance what would arrive there if nothing changed on the way: to be carried along like ``box``.
    """
    samples = box.fluctuation
    n_times = samples.shape[0]
    # mean square on the line between samples a and b: (a^2 + ab + b^2)/3 = (a^2 + b^2)/2 - (b - a)^2/6
    steps = np.diff(samples, axis=0, append=samples[:1]).astype(np.float64)
    variance = samples.var(axis=0, dtype=np.float64) - (steps**2).mean(axis=0) / 6.0
    intensity = box.scale * math.sqrt(max(0.0, float(variance.mean(axis=(0, 1)).sum()))) / box.mean_speed
    wavenumber = fft.rfftfreq(n_times, box.time_step * box.mean_speed)
    arriving = fft.rfft(samples, axis=0)
    # the phases belong to the box: other turbulence, other changes, but the same in its mirror image at y = 0
    corners = np.sort(np.abs(samples[0, [0, -1], 0]), axis=0)
    rng = np.random.default_rng(corners.view(np.uint32).ravel())
    filters, transfer, reached = {}, np.ones(wavenumber.size, dtype=np.complex128), 0.0
    for distance in sorted(set(distances)):
        kept = coherence_along(distance - reached, wavenumber, intensity, box.hub_height)
        phase = rng.uniform(0.0, 2.0 * math.pi, wavenumber.size)
        phase[0], kept[0] = 0.0, 1.0  # what a box holds as profile stays
        if n_times % 2 == 0:
            phase[-1] = 0.0  # the last harmonic has no sine
        transfer = kept * transfer + np.sqrt(1.0 - kept * kept) * np.exp(1j * phase)
        filters[distance], reached = transfer, distance
    boxes = {}
    for distance, transfer in filters.items():
        seen, tower = (
            fft.irfft(part * transfer.astype(np.complex64).reshape(-1, *(1,) * (part.ndim - 1)), n_times, axis=0)
            for part in (arriving, fft.rfft(box.tower, axis=0))
        )
        seen.setflags(write=False)
        boxes[distance] = replace(
            box, fluctuation=seen, tower=tower, description=f"{box.description}, {distance:g} m ahead"
        )
    return tuple(boxes[distance] for distance in distances)
