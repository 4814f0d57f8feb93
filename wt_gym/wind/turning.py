"""A wind that turns: any inflow with a direction that changes with time."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from wt_gym.base.errors import InflowError
from wt_gym.wind.protocol import Inflow, WrappedInflow, velocity_ahead

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.random import Generator
    from numpy.typing import NDArray

__all__ = ["TurningInflow"]


@dataclass(frozen=True)
class TurningInflow(WrappedInflow):
    """Another inflow, turned as a whole about the vertical through the tower by an angle that changes with time.

    The wind at a point x is R u(R^T x, t) with R the turn by the direction d(t): the whole field of the inner inflow,
    its turbulence too, blows from where the wind comes at that time.

    Parameters
    ----------
    inner : Inflow
    times : ndarray, shape (n,)
        Increasing [s].
    directions : ndarray, shape (n,)
        Counter-clockwise from above, against the inner inflow's direction [rad]; between the times in straight lines,
        before and after them as at the ends.

    Raises
    ------
    InflowError
        If times and directions have different shapes, are not finite, or times do not increase.
    """

    times: NDArray[np.float64]
    directions: NDArray[np.float64]

    def __post_init__(self) -> None:
        times, directions = (np.array(a, dtype=np.float64) for a in (self.times, self.directions))
        if times.ndim != 1 or times.size < 1 or times.shape != directions.shape:
            raise InflowError(f"times and directions must be as many; got shapes {times.shape} and {directions.shape}")
        if not (np.isfinite(times).all() and np.isfinite(directions).all() and np.all(np.diff(times) > 0.0)):
            raise InflowError("times and directions must be finite, times increasing")
        for name, array in (("times", times), ("directions", directions)):
            array.setflags(write=False)
            object.__setattr__(self, name, array)

    @classmethod
    def by(cls, inner: Inflow, angle: float) -> TurningInflow:
        """Another inflow turned by an angle that stays [rad]."""
        return cls(inner, np.zeros(1), np.array([angle]))

    @classmethod
    def wandering(
        cls, inner: Inflow, start: float, deviation: float, time_constant: float, duration: float, rng: Generator
    ) -> TurningInflow:
        """Direction that wanders about its start as an Ornstein-Uhlenbeck process.

        Parameters
        ----------
        inner : Inflow
        start : float
            Direction at time zero, and mean [rad].
        deviation : float
            Standard deviation in the long run [rad].
        time_constant : float
            Time over which deviations are forgotten [s].
        duration : float
            Time until which it wanders [s].
        rng : numpy.random.Generator
        """
        step = 0.05 * time_constant
        times = np.arange(math.ceil(duration / step) + 1) * step
        keep, directions = math.exp(-step / time_constant), np.zeros(times.size)
        kicks = deviation * math.sqrt(1.0 - keep * keep) * rng.standard_normal(times.size)
        for k in range(1, times.size):
            directions[k] = keep * directions[k - 1] + kicks[k]
        turned: NDArray[np.float64] = start + directions
        return cls(inner, np.asarray(times, dtype=np.float64), turned)

    def direction(self, time: float) -> float:
        """Direction at a time [rad]."""
        return float(np.interp(time, self.times, self.directions))

    @property
    def description(self) -> str:
        """One line that tells a person what wind this is."""
        low, high = np.degrees(self.directions.min()), np.degrees(self.directions.max())
        turning = f"from {low:.0f} to {high:.0f} deg" if high - low > 0.5 else f"{low:.0f} deg"
        return f"{self.inner.description}, turned {turning}"

    def _fill(self, rows: NDArray[np.float64], time: float, out: NDArray[np.float64]) -> int:
        return self._fill_turned(rows, time, self.inner.velocity, out)

    def _fill_ahead(
        self, gates: NDArray[np.float64], time: float, distances: tuple[float, ...], out: NDArray[np.float64]
    ) -> int:
        return self._fill_turned(gates, time, partial(velocity_ahead, self.inner, distances=distances), out)

    def _fill_turned(
        self,
        points: NDArray[np.float64],
        time: float,
        velocity: Callable[[NDArray[np.float64], float], NDArray[np.float64]],
        out: NDArray[np.float64],
    ) -> int:
        angle = self.direction(time)
        cos, sin = math.cos(angle), math.sin(angle)
        turn = np.array([[cos, sin, 0.0], [-sin, cos, 0.0], [0.0, 0.0, 1.0]])  # R^T on columns, R on rows
        finite = np.isfinite(points).all(axis=-1)
        if not finite.all():
            return int(np.argmin(finite))
        out[...] = np.asarray(velocity(points @ turn.T, time)) @ turn
        return -1
