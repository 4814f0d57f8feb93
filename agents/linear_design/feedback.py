"""Feedback from disturbances by least squares: a quadratic that stands for the lifetime cost, fitted anew where it was.

Under offsets that are linear in the disturbances, loads are linear in the coefficients. The cost is not quadratic in
the loads, so each pass takes the quadratic that touches it at the loads of the pass before (iteratively reweighted
least squares): of a damage-equivalent load L with weights w that grow with the local amplitude,

    L = L_k (1 + Q/Q_k)/2,    Q = sum w x^2,

and of the travel |r| = (r^2/|r_k| + |r_k|)/2.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from scipy.ndimage import maximum_filter1d, minimum_filter1d
from scipy.signal import fftconvolve

from wt_gym.agents.linear_design.identification import respond
from wt_gym.analysis.lifetime_cost import LIFETIME_COST_WEIGHTS
from wt_gym.analysis.metrics import BLADE_EXPONENT, TOWER_EXPONENT, damage_equivalent_load
from wt_gym.control.optimal.past import bin_means, spread_over_bins, without_lasting

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from wt_gym.agents.linear_design.recording import Recording

__all__ = ["Feedback", "FeedbackOptions", "Forecast", "Weighted", "fit_feedback", "forecast"]


@dataclass(frozen=True)
class FeedbackOptions:
    """How a feedback is fitted.

    Attributes
    ----------
    travel_weight : float
        Factor on the cost of the pitch travel [-]: one point of a front.
    power_weight : float
        Cost of the power that offsets take, over that of the same share of energy [-].
    amplitude_exponent : float
        Of the weights of flapwise loads in the local amplitude; twice that of the tower's at most. The exponent of
        fatigue less two would be exact, and would fit single cycles.
    ridge : float
        Over the diagonal of the normal equations [-].
    passes : int
    washout : float
        Time constant of what lasts in the mean channel, which no offset answers [s].
    still : float
        Rate below which travel counts as a square [rad/s].
    window : float
        Of the local amplitude [s].
    smooth : float
        Length over which a load's slow part is taken off [s].
    skip : float
        Start of each run that does not count [s].
    weights : dict
        Of the cost, see `LIFETIME_COST_WEIGHTS`.
    """

    travel_weight: float = 1.0
    power_weight: float = 1.0
    amplitude_exponent: float = 4.0
    ridge: float = 3e-3
    passes: int = 4
    washout: float = 30.0
    still: float = math.radians(0.3)
    window: float = 5.0
    smooth: float = 20.0
    skip: float = 20.0
    weights: dict[str, float] = field(default_factory=lambda: dict(LIFETIME_COST_WEIGHTS))


MEAN_READS, TILT_YAW_READS = (0, 3, 5), (1, 2, 4)
"""Outputs that the mean offset, and tilt and yaw, answer."""
LASTING = (1, 2)
"""Outputs of which the lasting part counts too."""


@dataclass(frozen=True)
class Weighted:
    """Scales and bins of features.

    Attributes
    ----------
    scale : numpy.ndarray, shape (6,)
        Units of the outputs.
    bins : tuple of (int, int)
    """

    scale: NDArray[np.float64]
    bins: tuple[tuple[int, int], ...]


@dataclass(frozen=True)
class Feedback:
    """Offsets from the past of disturbances.

    Attributes
    ----------
    gains : numpy.ndarray, shape (3, 6, n_delays)
        From filtered disturbances over their scale to offsets [rad].
    """

    gains: NDArray[np.float64]


@dataclass(frozen=True)
class Forecast:
    """What a feedback is expected to do to a recorded run.

    Attributes
    ----------
    offsets : numpy.ndarray, shape (3, n)
    loads : numpy.ndarray, shape (2, n + 1)
        Tower base [N m].
    flap, pitch : numpy.ndarray, shape (n_blades, n + 1)
    """

    offsets: NDArray[np.float64]
    tower: NDArray[np.float64]
    flap: NDArray[np.float64]
    pitch: NDArray[np.float64]


def filtered(run: Recording, scale: NDArray[np.float64], washout: float) -> NDArray[np.float64]:
    """Scaled outputs (6, n) at the instants of offsets, without what lasts where that must not count."""
    scaled = run.outputs[:, :-1] / scale[:, None]
    return np.stack([
        row if k in LASTING else without_lasting(row, washout, run.dt) for k, row in enumerate(scaled)
    ])  # fmt: skip


def features(run: Recording, scale: NDArray[np.float64], bins: Sequence[tuple[int, int]], washout: float):
    """Features of mean and of tilt and yaw, (n_features, n) each."""
    past = filtered(run, scale, washout)
    return tuple(np.concatenate([bin_means(past[k], bins) for k in reads]) for reads in (MEAN_READS, TILT_YAW_READS))


def to_blades(values: NDArray[np.float64], azimuth: NDArray[np.float64], n_blades: int) -> NDArray[np.float64]:
    """Values (..., n_blades, n) of mean, tilt and yaw (..., 3, n)."""
    angles = azimuth[None] + 2.0 * math.pi / n_blades * np.arange(n_blades)[:, None]
    return values[..., 0:1, :] + values[..., 1:2, :] * np.cos(angles) + values[..., 2:3, :] * np.sin(angles)
