"""Loads over a life: damage-equivalent loads weighted by how often each wind speed blows."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from wt_gym.wind.iec import AVERAGE_OVER_REFERENCE_SPEED, reference_speed

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

__all__ = ["LEAST_SHARE", "SHAPES", "WindClimate", "lifetime_load", "wind_weights"]

SHAPES = (0.5, 10.0)
"""Least and largest Weibull exponent of a wind climate [-]; measured ones lie between 1 and 4."""
LEAST_SHARE = 1e-3
"""Of the time that the wind has to be one of operation."""


@dataclass(frozen=True)
class WindClimate:
    """Weibull distribution of the ten-minute mean wind speed at hub height, and the speeds of operation.

    Attributes
    ----------
    mean_speed : float
        Annual mean [m/s]; IEC 61400-1 sets it to 0.2 times the reference speed of the class.
    shape : float
        Weibull exponent k [-]; 2 is the Rayleigh distribution of the standard.
    cut_in, cut_out : float
        Between these the turbine operates [m/s].

    Raises
    ------
    ValueError
        If mean or exponent is not positive and finite, the exponent is none of `SHAPES`, cut-out does not exceed
        cut-in, or the wind lies between them for less than a share of `LEAST_SHARE` of the time.
    """

    mean_speed: float
    shape: float = 2.0
    cut_in: float = 3.0
    cut_out: float = 25.0

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
    """Share of the operating time that each of some wind speeds stands for.

    Every wind between cut-in and cut-out counts for the nearest of the speeds: bins end half-way between neighbors,
    the outermost at cut-in and cut-out.

    Parameters
    ----------
    climate : WindClimate
    speeds : sequence of float
        Ascending, each within cut-in and cut-out [m/s].

    Returns
    -------
    numpy.ndarray, shape (n_speeds,)
        Their sum is 1.

    Raises
    ------
    ValueError
        If the speeds do not ascend or lie outside.
    """
    values = np.asarray(speeds, dtype=np.float64)
    if values.size == 0 or np.any(np.diff(values) <= 0.0) or values[0] < climate.cut_in or values[-1] > climate.cut_out:
        raise ValueError(
            f"wind speeds must ascend from cut-in {climate.cut_in:g} m/s to cut-out {climate.cut_out:g} m/s, "
            f"got {list(map(float, values))}"
        )
    edges = np.concatenate([[climate.cut_in], 0.5 * (values[1:] + values[:-1]), [climate.cut_out]])
    shares = np.diff([climate.share_below(edge) for edge in edges])
    out: NDArray[np.float64] = shares / shares.sum()
    return out


def lifetime_load(loads: NDArray[np.float64], weights: NDArray[np.float64], exponent: float) -> NDArray[np.float64]:
    """Load at 1 Hz throughout that does the damage of all loads in their shares of the time: (Σ w L^m)^(1/m).

    Parameters
    ----------
    loads : numpy.ndarray, shape (..., n)
        Damage-equivalent loads, not negative.
    weights : numpy.ndarray, shape (n,)
        Shares of the time; their sum is 1.
    exponent : float
        Woehler exponent m [-].

    Returns
    -------
    numpy.ndarray, shape (...)
        In the unit of the loads.
    """
    loads = np.asarray(loads, dtype=np.float64)
    largest = loads.max(axis=-1, keepdims=True)
    # relative to the largest: 1e7 to the tenth power would waste the digits of a float
    relative = np.divide(loads, largest, out=np.zeros_like(loads), where=largest > 0.0)
    out: NDArray[np.float64] = largest[..., 0] * np.sum(weights * relative**exponent, axis=-1) ** (1.0 / exponent)
    return out
