"""How well the model of a linear controller fits: what is left of its own effect in the disturbances that it finds.

A model explains y(t) of what is measured, and the disturbance d is the rest. If the turbine answers 1 + g times as
strongly and tau later, what is left of the controller's own effect is

    d = (1 + g) y(t - tau) - y(t) + d0 = g y - (1 + g) tau dy/dt + ...

to first order in tau, so the regressions of the changes of d on those of y and of dy/dt give a gain g and a lag
(1 + g) tau (least squares with an
exponential window: Ljung, System Identification, 1999, section 11.2). Feedback makes y an answer to earlier d0, so both
are biased: a model that fits has values of its own, which late readings, slow drives, weak or strong blades and dead
gauges move. Changes, not values, are compared: the slow part of d0 is the largest. Values need decisions in
neighboring intervals; a controller that is asked less often than its design has intervals shows zeros.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

__all__ = ["FIT_TIME", "LEAST_CHANGE", "ModelFit"]

FIT_TIME = 30.0
"""Time constant of the window [s]."""
LEAST_CHANGE = 1e-4
"""Added to the mean square of the changes of y, over their scale: without an effect of its own there is no fit."""


class ModelFit:
    """Gain and lag of several outputs, one value at every interval.

    Parameters
    ----------
    n : int
        Outputs.
    interval : float
        [s].

    Attributes
    ----------
    values : numpy.ndarray, shape (2 n,)
        Gains [-] and lags [s].
    """

    def __init__(self, n: int, interval: float) -> None:
        self._interval, self._kept = interval, math.exp(-interval / FIT_TIME)
        self._past = np.zeros((2, 2, n))  # d and y, of the last time and of that before
        self._sums = np.zeros((4, n))
        self._count = 0.0
        self.values = np.zeros(2 * n)

    def start(self) -> None:
        """Forget everything."""
        self._past[:] = self._sums[:] = self.values[:] = 0.0
        self._count = 0.0

    def update(self, disturbance: NDArray[np.float64], explained: NDArray[np.float64], passed: int = 1) -> None:
        """Take the values of an interval.

        Parameters
        ----------
        disturbance, explained : numpy.ndarray, shape (n,)
            Over their scale.
        passed : int
            Intervals since the last time; where it is not one, no change is taken from it.
        """
        if passed != 1:
            self._count = 0.0
        if self._count > 1.5:
            change = 0.5 * (disturbance - self._past[0, 1])
            along = 0.5 * (explained - self._past[1, 1])
            rate = (explained - 2.0 * self._past[1, 0] + self._past[1, 1]) / self._interval
            new = np.stack([change * along, along**2, change * rate, rate**2])
            self._sums += (1.0 - self._kept) * (new - self._sums)
            n = len(change)
            self.values[:n] = self._sums[0] / (self._sums[1] + LEAST_CHANGE)
            self.values[n:] = -self._sums[2] / (self._sums[3] + LEAST_CHANGE)
        self._past[:, 1] = self._past[:, 0]
        self._past[0, 0], self._past[1, 0] = disturbance, explained
        self._count += 1.0
