"""What every inflow offers: the undisturbed wind at any points and time."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol, runtime_checkable

import numpy as np

from wt_gym.base.errors import InflowError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import ArrayLike, NDArray

__all__ = [
    "Inflow",
    "PointInflow",
    "WrappedInflow",
    "fill_velocity",
    "read_only",
    "require_cover",
    "require_number",
    "start_speed",
    "velocity_ahead",
]

_N_RINGS = 8
_N_AZIMUTHS = 24


@runtime_checkable
class Inflow(Protocol):
    """The undisturbed wind u(x, t) in the global frame (x downwind, y left looking downwind, z up from the ground)."""

    @property
    def mean_speed(self) -> float:
        """Mean wind speed at hub height [m/s]."""

    @property
    def hub_height(self) -> float:
        """Height [m] at which :attr:`mean_speed` holds."""

    @property
    def description(self) -> str:
        """One line that tells a person what wind this is."""

    def velocity(self, points: NDArray[np.float64], time: float) -> NDArray[np.float64]:
        """Wind velocity [m/s], shape (..., 3), at points [m] of shape (..., 3), to be read only, and a time [s]."""


class PointInflow:
    """Shared door of the inflows: checks what comes in and calls the compiled kernel of the subclass."""

    if TYPE_CHECKING:  # what the subclasses have, as fields or properties

        @property
        def hub_height(self) -> float: ...

        @property
        def mean_speed(self) -> float: ...

        @property
        def description(self) -> str: ...

        def _fill(self, rows: NDArray[np.float64], time: float, out: NDArray[np.float64]) -> int: ...

    def velocity(self, points: ArrayLike, time: float) -> NDArray[np.float64]:
        """Undisturbed wind velocity at points and a time.

        Parameters
        ----------
        points
            Positions in the global frame [m], shape (..., 3).
        time
            Time [s], any finite number.

        Returns
        -------
        numpy.ndarray
            Velocity in the global frame [m/s], float64, the shape of ``points``; a new array.

        Raises
        ------
        InflowError
            ``points`` does not end in three components, or a point or the time is not finite.
        """
        positions, time = _checked(points, time)
        rows = read_only(positions.reshape(-1, 3))
        out = np.empty((rows.shape[0], 3))
        _require_finite(self._fill(rows, time, out), rows)
        return out.reshape(positions.shape)

    def fill_velocity(self, points: NDArray[np.float64], time: float, out: NDArray[np.float64]) -> None:
        """`velocity` for those who ask in every step, without new arrays or checks of shapes.

        Parameters
        ----------
        points
            Positions in the global frame [m], read-only float64 (n, 3) in C order.
        time
            Time [s], any finite number.
        out
            Receives the velocity in the global frame [m/s], float64 (n, 3) in C order.

        Raises
        ------
        InflowError
            A point is not finite.
        """
        _require_finite(self._fill(points, time, out), points)

    def velocity_ahead(
        self, points: NDArray[np.float64], time: float, distances: Sequence[float]
    ) -> NDArray[np.float64]:
        """Wind where a lidar sees it: unlike in `velocity`, turbulence changes on its way from there to the rotor.

        Parameters
        ----------
        points
            Positions in the global frame [m], shape (n, m, 3).
        time
            Time [s], any finite number.
        distances
            Ahead of the rotor [m], for each of the n groups of points.

        Returns
        -------
        numpy.ndarray
            Velocity in the global frame [m/s], float64, shape (n, m, 3).

        Raises
        ------
        InflowError
            The points are not as many groups as there are distances, or a point or the time is not finite.
        """
        positions, time = _checked(points, time)
        if positions.ndim != 3 or len(positions) != len(distances):
            raise InflowError(
                f"points must have shape (n, m, 3) for n = {len(distances)} distances; got {positions.shape}"
            )
        out = np.empty(positions.shape)
        bad = self._fill_ahead(read_only(positions), time, tuple(distances), out)
        _require_finite(bad, positions.reshape(-1, 3))
        return out

    def _fill_ahead(
        self, gates: NDArray[np.float64], time: float, distances: tuple[float, ...], out: NDArray[np.float64]
    ) -> int:
        """Fill in the wind at points ahead; that of an inflow that does not change on its way."""
        return self._fill(read_only(gates.reshape(-1, 3)), time, out.reshape(-1, 3))

    def require_cover(self, hub_height: float, rotor_diameter: float) -> None:
        """Refuse a rotor that reaches to where the inflow has no wind: one without bounds refuses none.

        Parameters
        ----------
        hub_height, rotor_diameter
            Of the turbine [m].

        Raises
        ------
        InflowError
            If the rotor reaches beyond the inflow's bounds.
        """

    @property
    def start_speed(self) -> float:
        """Wind speed at hub height at time zero [m/s], turbulence left out: a turbine starts at its operating point."""
        return self.mean_speed

    def rotor_effective_speed(self, time: ArrayLike, rotor_diameter: float) -> float | NDArray[np.float64]:
        """Mean over the rotor disc of the wind component along x.

        The disc stands upright at x = 0 with its center at hub height and faces −x. The mean is taken over 192
        points of equal area.

        Parameters
        ----------
        time
            Time or times [s].
        rotor_diameter
            Diameter of the disc [m].

        Returns
        -------
        float or numpy.ndarray
            Rotor-effective wind speed [m/s], the shape of ``time``.
        """
        radius = 0.5 * require_number(rotor_diameter, "rotor_diameter", "m", 0.0, open_minimum=True)
        ring = radius * np.sqrt((np.arange(_N_RINGS) + 0.5) / _N_RINGS)
        azimuth = 2.0 * np.pi * np.arange(_N_AZIMUTHS) / _N_AZIMUTHS
        disc = np.zeros((_N_RINGS, _N_AZIMUTHS, 3))
        disc[..., 1] = np.outer(ring, np.sin(azimuth))
        disc[..., 2] = self.hub_height + np.outer(ring, np.cos(azimuth))
        times = np.asarray(time, dtype=np.float64)
        means = [float(self.velocity(disc, t)[..., 0].mean()) for t in times.ravel()]
        return means[0] if times.ndim == 0 else np.array(means).reshape(times.shape)

    def __str__(self) -> str:
        return self.description


def fill_velocity(inflow: Inflow, points: NDArray[np.float64], time: float, out: NDArray[np.float64]) -> None:
    """Wind of any inflow at points, as `PointInflow.fill_velocity`.

    Raises
    ------
    InflowError
        The inflow gives velocities of another shape than the points, or refuses a point.
    """
    if isinstance(inflow, PointInflow) and type(inflow).velocity is PointInflow.velocity:
        inflow.fill_velocity(points, time, out)
        return
    wind = np.asarray(inflow.velocity(points, time), dtype=np.float64)
    if wind.shape != points.shape:
        raise InflowError(
            f"the inflow gives velocities of shape {wind.shape} at points of shape {points.shape}; they must have the "
            "same"
        )
    out[...] = wind


def velocity_ahead(
    inflow: Inflow, points: NDArray[np.float64], time: float, distances: Sequence[float]
) -> NDArray[np.float64]:
    """Wind where a lidar sees it, of any inflow: one that is not a `PointInflow` does not change on its way.

    Parameters
    ----------
    inflow
        A `PointInflow`, or anything with `velocity`.
    points, time, distances
        See there.

    Returns
    -------
    numpy.ndarray
        Velocity in the global frame [m/s], float64, shape (n, m, 3).
    """
    if isinstance(inflow, PointInflow):
        return inflow.velocity_ahead(points, time, distances)
    return np.asarray(inflow.velocity(points, time))


def require_cover(inflow: Inflow, hub_height: float, rotor_diameter: float) -> None:
    """`PointInflow.require_cover` of any inflow: one that has no such method has no bounds."""
    check = getattr(inflow, "require_cover", None)
    if check is not None:
        check(hub_height, rotor_diameter)


def start_speed(inflow: Inflow) -> float:
    """`PointInflow.start_speed` of any inflow: of one that does not say it the mean speed."""
    return float(getattr(inflow, "start_speed", inflow.mean_speed))


@dataclass(frozen=True)
class WrappedInflow(PointInflow):
    """An inflow made of another one, with the same speed, hub height and bounds.

    Parameters
    ----------
    inner : Inflow
    """

    inner: Inflow

    @property
    def mean_speed(self) -> float:
        """Mean wind speed at hub height [m/s]."""
        return self.inner.mean_speed

    @property
    def start_speed(self) -> float:
        """Wind speed at hub height at time zero [m/s], turbulence left out."""
        return start_speed(self.inner)

    @property
    def hub_height(self) -> float:
        """Hub height [m]."""
        return self.inner.hub_height

    def require_cover(self, hub_height: float, rotor_diameter: float) -> None:
        """Refuse a rotor for which the inner inflow has no wind."""
        require_cover(self.inner, hub_height, rotor_diameter)


def _checked(points: ArrayLike, time: float) -> tuple[NDArray[np.float64], float]:
    """Points as an array of numbers and a finite time."""
    try:
        positions = np.ascontiguousarray(points, dtype=np.float64)
        time = float(time)
    except (TypeError, ValueError) as error:
        raise InflowError(f"points must be an array of numbers and time a number: {error}") from error
    if positions.ndim == 0 or positions.shape[-1] != 3:
        raise InflowError(f"points must have shape (..., 3); got {positions.shape}")
    if not math.isfinite(time):
        raise InflowError(f"time must be finite; got {time}")
    return positions, time


def read_only(array: NDArray[np.float64]) -> NDArray[np.float64]:
    """View that is read-only, whatever the caller passed, so that one compiled signature serves every call."""
    view = array.view()
    view.setflags(write=False)
    return view


def _require_finite(bad: int, rows: NDArray[np.float64]) -> None:
    """Raise for the point that a kernel found wanting, if any."""
    if bad >= 0:
        raise InflowError(f"every point must be finite; point {bad} of {len(rows)} is {rows[bad].tolist()}")


def require_number(
    value: float,
    name: str,
    unit: str,
    minimum: float = -math.inf,
    maximum: float = math.inf,
    *,
    open_minimum: bool = False,
) -> float:
    """Return ``value`` as a float if it is a finite number within bounds; raise InflowError that names it if not."""
    try:
        if isinstance(value, bool | str):  # which float would take
            raise TypeError(f"must be a number, got {value!r}")
        number = float(value)
    except (TypeError, ValueError, OverflowError) as error:
        raise InflowError(f"{name} must be a number [{unit}]; got {value!r:.100}") from error
    below = number <= minimum if open_minimum else number < minimum
    if not math.isfinite(number) or below or number > maximum:
        bracket = "(" if open_minimum or minimum == -math.inf else "["
        closing = ")" if maximum == math.inf else "]"
        raise InflowError(f"{name} must lie in {bracket}{minimum:g}, {maximum:g}{closing} {unit}; got {value!r}")
    return number
