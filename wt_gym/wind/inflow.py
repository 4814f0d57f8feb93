"""The contract of an inflow, the undisturbed wind at any points and time, and inflows made of another one."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any, Protocol, runtime_checkable

import numpy as np
from numpy.random import Generator
from numpy.typing import ArrayLike, NDArray

from wt_gym.base.errors import InflowError
from wt_gym.base.quantities import Array

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

    def velocity(self, points: Array, time: float) -> Array:
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

        def _fill(self, rows: Array, time: float, out: Array) -> int: ...

    def velocity(self, points: ArrayLike, time: float) -> Array:
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

    def fill_velocity(self, points: Array, time: float, out: Array) -> None:
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

    def velocity_ahead(self, points: Array, time: float, distances: Sequence[float]) -> Array:
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

    def _fill_ahead(self, gates: Array, time: float, distances: tuple[float, ...], out: Array) -> int:
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

    def rotor_effective_speed(self, time: ArrayLike, rotor_diameter: float) -> float | Array:
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


def fill_velocity(inflow: Inflow, points: Array, time: float, out: Array) -> None:
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


def velocity_ahead(inflow: Inflow, points: Array, time: float, distances: Sequence[float]) -> Array:
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
    """An inflow made of another one, with the same speed, hub height and bounds."""

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


def _checked(points: ArrayLike, time: float) -> tuple[Array, float]:
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


def read_only(array: Array) -> Array:
    """View that is read-only, whatever the caller passed, so that one compiled signature serves every call."""
    view = array.view()
    view.setflags(write=False)
    return view


def _require_finite(bad: int, rows: Array) -> None:
    """Raise for the point that a kernel found wanting, if any."""
    if bad >= 0:
        raise InflowError(f"every point must be finite; point {bad} of {len(rows)} is {rows[bad].tolist()}")


POSITIVE = (0.0, math.inf, True)
"""Bounds of a positive number, of `check_numbers`."""


def check_numbers(record: object, **bounds: tuple[Any, ...]) -> None:
    """Make fields of a frozen record floats, within the bounds (unit, minimum, maximum, open minimum) of their names.

    Raises
    ------
    InflowError
        As `require_number`.
    """
    for name, (unit, *limits) in bounds.items():
        object.__setattr__(record, name, require_number(getattr(record, name), name, unit, *limits))


def fill_in(record: object, **defaults: object) -> None:
    """Put defaults into the fields of a frozen record that are None."""
    for name, value in defaults.items():
        if getattr(record, name) is None:
            object.__setattr__(record, name, value)


def check_flag(record: object, name: str) -> None:
    """Refuse a field of a record that is neither True nor False."""
    if not isinstance(value := getattr(record, name), bool):
        raise InflowError(f"{name} must be True or False; got {value!r}")


def set_read_only(record: object, **arrays: NDArray[Any]) -> None:
    """Put arrays into the fields of a frozen record, and make them read-only."""
    for name, array in arrays.items():
        array.setflags(write=False)
        object.__setattr__(record, name, array)


def require_number(
    value: float,
    name: str,
    unit: str,
    minimum: float = -math.inf,
    maximum: float = math.inf,
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


_REFLECTION = np.array([1.0, -1.0, 1.0])


@dataclass(frozen=True)
class MirroredInflow(WrappedInflow):
    """The mirror image of another inflow at the plane y = 0.

    With S = diag(1, -1, 1) the wind at a point x is S u(S x, t): what blew to the left blows to the right, and
    direction, veer, horizontal shear, gusts and turbulence change sides. Both reflections are exact in floating-point
    numbers, so that the image of the image is the inner inflow bit for bit.
    """

    @classmethod
    def of(cls, inflow: Inflow) -> Inflow:
        """Return the mirror image of an inflow, of a mirror image what is seen in it."""
        return inflow.inner if isinstance(inflow, cls) else cls(inflow)

    @property
    def description(self) -> str:
        """One line that tells a person what wind this is."""
        return f"{self.inner.description}, mirrored"

    def _fill(self, rows: Array, time: float, out: Array) -> int:
        fill_velocity(self.inner, read_only(rows * _REFLECTION), time, out)
        out[:, 1] *= -1.0
        return -1

    def _fill_ahead(self, gates: Array, time: float, distances: tuple[float, ...], out: Array) -> int:
        np.multiply(velocity_ahead(self.inner, gates * _REFLECTION, time, distances), _REFLECTION, out=out)
        return -1


@dataclass(frozen=True)
class TurningInflow(WrappedInflow):
    """Another inflow, turned as a whole about the vertical through the tower by an angle that changes with time.

    The wind at a point x is R u(R^T x, t) with R the turn by the direction d(t): the whole field of the inner inflow,
    its turbulence too, blows from where the wind comes at that time.

    Parameters
    ----------
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

    times: Array
    directions: Array

    def __post_init__(self) -> None:
        times, directions = (np.array(a, dtype=np.float64) for a in (self.times, self.directions))
        if times.ndim != 1 or times.size < 1 or times.shape != directions.shape:
            raise InflowError(f"times and directions must be as many; got shapes {times.shape} and {directions.shape}")
        if not (np.isfinite(times).all() and np.isfinite(directions).all() and np.all(np.diff(times) > 0.0)):
            raise InflowError("times and directions must be finite, times increasing")
        set_read_only(self, times=times, directions=directions)

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
        times = np.arange(math.ceil(duration / step) + 1, dtype=np.float64) * step
        keep, directions = math.exp(-step / time_constant), np.zeros(times.size)
        kicks = deviation * math.sqrt(1.0 - keep * keep) * rng.standard_normal(times.size)
        for k in range(1, times.size):
            directions[k] = keep * directions[k - 1] + kicks[k]
        return cls(inner, times, start + directions)

    def direction(self, time: float) -> float:
        """Direction at a time [rad]."""
        return float(np.interp(time, self.times, self.directions))

    @property
    def description(self) -> str:
        """One line that tells a person what wind this is."""
        low, high = np.degrees(self.directions.min()), np.degrees(self.directions.max())
        turning = f"from {low:.0f} to {high:.0f} deg" if high - low > 0.5 else f"{low:.0f} deg"
        return f"{self.inner.description}, turned {turning}"

    def _fill(self, rows: Array, time: float, out: Array) -> int:
        return self._fill_turned(rows, time, self.inner.velocity, out)

    def _fill_ahead(self, gates: Array, time: float, distances: tuple[float, ...], out: Array) -> int:
        return self._fill_turned(gates, time, partial(velocity_ahead, self.inner, distances=distances), out)

    def _fill_turned(self, points: Array, time: float, velocity: Callable[[Array, float], Array], out: Array) -> int:
        angle = self.direction(time)
        cos, sin = math.cos(angle), math.sin(angle)
        turn = np.array([[cos, sin, 0.0], [-sin, cos, 0.0], [0.0, 0.0, 1.0]])  # R^T on columns, R on rows
        finite = np.isfinite(points).all(axis=-1)
        if not finite.all():
            return int(np.argmin(finite))
        out[...] = np.asarray(velocity(points @ turn.T, time)) @ turn
        return -1
