"""Filters of controllers, exact for an input held over each step, whatever its length."""

from __future__ import annotations

import math

import numpy as np
from scipy.linalg import expm

from wt_gym.control.sensors import LowPass

__all__ = ["BandLimitedIntegrator", "LowPass", "SecondOrderLowPass"]


class BandLimitedIntegrator:
    """Integral of a signal without its slow part: ``s / (s + w)^2``, a high-pass filter twice over the integral.

    Far above the corner it integrates; a constant input, and a drifting one, give nothing in the end. From an
    acceleration it makes the velocity of a vibration. With ``e = exp(-w dt)`` the two states, both from the input u,

        ``x1 <- e x1 + (1 - e) u / w``,
        ``x2 <- e x2 + dt e x1 + (1 - e - w dt e) u / w^2``,

    give the output ``x1 - w x2`` exactly for an input held over dt.

    Parameters
    ----------
    corner : float
        w [rad/s].
    """

    def __init__(self, corner: float):
        if not 0.0 < corner < math.inf:
            raise ValueError(f"the corner of a band-limited integrator must be positive, got {corner!r} rad/s")
        self.corner = float(corner)
        self._first = self._second = 0.0

    def reset(self, value: float = 0.0) -> float:
        """Start in the steady state of a constant input: nothing comes out."""
        self._first, self._second = value / self.corner, value / self.corner**2
        return 0.0

    def update(self, value: float, dt: float) -> float:
        """Take the input of a step of ``dt`` [s] and return the output at its end."""
        w = self.corner
        e = math.exp(-w * dt)
        first = self._first
        self._first = e * first + (1.0 - e) / w * value
        self._second = e * self._second + dt * e * first + (1.0 - e - w * dt * e) / w**2 * value
        return self._first - w * self._second


class SecondOrderLowPass:
    """Low-pass filter ``w^2/(s^2 + 2 zeta w s + w^2)``, exact for an input held over a step.

    Parameters
    ----------
    frequency : float
        w [rad/s].
    damping_ratio : float
        zeta [-].
    """

    def __init__(self, frequency: float, damping_ratio: float):
        if not (0.0 < frequency < math.inf and 0.0 < damping_ratio < math.inf):
            raise ValueError(
                "a second-order filter needs a positive frequency and damping ratio, got "
                f"{frequency!r} rad/s and {damping_ratio!r}"
            )
        self.frequency, self.damping_ratio = float(frequency), float(damping_ratio)
        self.reset(math.nan)

    def reset(self, value: float) -> float:
        """Start in steady state at a value, as a new filter does: nothing of former steps stays."""
        self.value, self._rate = float(value), 0.0
        self._step, self._transition = math.nan, (math.nan,) * 4
        return self.value

    def update(self, value: float, dt: float) -> float:
        """Take the value of a step of length ``dt`` [s] and return the filtered one."""
        if dt != self._step:
            w, z = self.frequency, self.damping_ratio
            matrix = expm(dt * np.array([[0.0, 1.0], [-(w**2), -2.0 * z * w]]))
            self._step, self._transition = dt, tuple(matrix.ravel().tolist())
        a, b, c, d = self._transition
        deviation = self.value - value
        self.value, self._rate = value + a * deviation + b * self._rate, c * deviation + d * self._rate
        return self.value
