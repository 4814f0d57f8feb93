"""Turbulent winds: a box of turbulence carried along by a mean wind, steady or along a path, and what it was ahead.

Turbulence that changes on its way to the rotor: what it was where a lidar sees it.

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

import math
from abc import abstractmethod
from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.random import Generator
from numpy.typing import ArrayLike
from scipy import fft

from wt_gym.base.errors import InflowError
from wt_gym.base.quantities import Array
from wt_gym.wind.iec import length_scale
from wt_gym.wind.inflow import PointInflow, check_numbers, fill_in, set_read_only
from wt_gym.wind.inflow_kernels import add_tower_points, mean_velocity, turbulent_velocity
from wt_gym.wind.steady import OnSteadyWind, SteadyInflow
from wt_gym.wind.turbulence_box import TurbulenceBox


def coherence_along(distance: ArrayLike, wavenumber: ArrayLike, intensity: float, hub_height: float) -> Array:
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
    result: Array = np.exp(-0.5 * decay * np.asarray(distance) * np.hypot(wavenumber, offset))
    return result


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


_Mean = tuple[tuple[float, ...], float, float]
"""A mean wind as the kernels take it: profile, direction and inclination [rad]."""


def _fill_carried(
    box: TurbulenceBox, rows: Array, time: float, mean: _Mean, scale: float, time_step: float, out: Array
) -> int:
    """Fill in a mean wind with a box carried along; the first row that is not finite, or -1."""
    place = time_step, box.spacing_y, box.spacing_z, box.y_center, box.z_bottom
    bad = int(turbulent_velocity(rows, time, *mean, box.fluctuation, scale, *place, out))
    if bad < 0 and box.tower.shape[1] > 0:
        add_tower_points(rows, time, *mean, box.fluctuation, box.tower, scale, *place, out)
    return bad


class CarriedInflow(PointInflow):
    """Base of winds with a box, whose fields ahead of the rotor are made when they are first seen.

    Attributes
    ----------
    box : TurbulenceBox or None
    """

    box: TurbulenceBox | None
    _evolved: dict[tuple[float, ...], tuple[TurbulenceBox, ...]]

    @abstractmethod
    def _fill_from(self, box: Any, rows: Array, time: float, out: Array) -> int:
        """Fill in the wind with a box in place of that of the rotor; the first row that is not finite, or -1."""

    def __getstate__(self) -> dict[str, Any]:
        """What a copy or a pickle takes along: the field ahead is remade."""
        return {**self.__dict__, "_evolved": {}}

    def __setstate__(self, state: dict[str, Any]) -> None:
        for name, value in state.items():
            object.__setattr__(self, name, value)

    def _fill(self, rows: Array, time: float, out: Array) -> int:
        return self._fill_from(self.box, rows, time, out)

    def _fill_ahead(self, gates: Array, time: float, distances: tuple[float, ...], out: Array) -> int:
        if self.box is None:
            return super()._fill_ahead(gates, time, distances, out)
        if distances not in self._evolved:
            self._evolved[distances] = evolved_boxes(self.box, distances)
        before = 0
        for rows, box, seen in zip(gates, self._evolved[distances], out, strict=True):
            bad = self._fill_from(box, rows, time, seen)
            if bad >= 0:
                return before + bad
            before += len(rows)
        return -1


BEYOND_GRID = ("refuse", "hold")


@dataclass(frozen=True)
class TurbulentInflow(OnSteadyWind, CarriedInflow):
    """Frozen turbulence on a mean profile (Taylor's hypothesis).

    In the frame of the mean wind, u(x, y, z, t) = mean(z) + box(y, z, t + time_offset − x/U), U the hub speed. Between
    the samples the box is interpolated linearly in y, z and time; below its grid it follows the tower points, where it
    has any; else outside its grid it keeps the values of the nearest edge, below the ground too; in time it repeats. A
    rotor that reaches beyond the grid is refused (``beyond_grid``).

    What is seen ahead of the rotor (`velocity_ahead`) is not yet quite what arrives, see `wt_gym.wind.turbulent`.

    Yaw misalignment and inclination of the mean wind turn the whole field, about the vertical axis through the
    origin and about the hub; veer turns the mean only, not the fluctuations.

    Parameters
    ----------
    box
        The turbulence.
    steady
        The mean wind; speed and hub height within 1 % of the box's. By default uniform at the box's speed.
    time_offset
        Time in the box [s] that passes the origin at time zero.
    beyond_grid
        What becomes of a rotor that reaches beyond the grid: ``"refuse"``, or ``"hold"`` with a warning.

    Raises
    ------
    InflowError
        The mean wind does not fit the box, or a parameter is not finite.

    Examples
    --------
    >>> box = TurbulenceBox.kaimal(8.0, 90.0, 126.0, "B", seed=1, grid=(3, 3), cache=False)
    >>> wind = TurbulentInflow(box, SteadyInflow(8.0, 90.0, shear_exponent=0.2))
    >>> wind.velocity([[0.0, 0.0, 90.0], [0.0, 20.0, 120.0]], time=12.5).shape
    (2, 3)
    """

    box: TurbulenceBox
    steady: SteadyInflow = None  # type: ignore[assignment]  # none: filled in
    time_offset: float = 0.0
    beyond_grid: str = "refuse"
    _evolved: dict[tuple[float, ...], tuple[TurbulenceBox, ...]] = field(
        default_factory=dict, init=False, repr=False, compare=False
    )

    def __post_init__(self) -> None:
        if not isinstance(self.box, TurbulenceBox):
            raise InflowError(f"box must be a TurbulenceBox; got {type(self.box).__name__}")
        fill_in(self, steady=SteadyInflow(self.box.mean_speed, self.box.hub_height))
        self._check_steady()
        self.box.require_fitting(self.steady)
        check_numbers(self, time_offset=("s",))
        if self.beyond_grid not in BEYOND_GRID:
            raise InflowError(
                f"beyond_grid must be one of {', '.join(map(repr, BEYOND_GRID))}; got {self.beyond_grid!r}"
            )

    @cached_property
    def _mean_wind(self) -> _Mean:
        """The mean wind as the kernels take it."""
        steady = self.steady
        return steady.kernel_profile, steady.yaw_misalignment, steady.inclination

    @property
    def description(self) -> str:
        """One line that tells a person what wind this is."""
        offset = f", from {self.time_offset:g} s" if self.time_offset else ""
        steady, box = self.steady.profile_description, self.box
        profile = f"{box.profile_description}, on a {steady}" if box.holds_profile else steady
        held = ", held at the edge of its grid" if self.beyond_grid == "hold" else ""
        return f"{box.description}, {box.duration:g} s{offset}, {profile}{held}"

    def require_cover(self, hub_height: float, rotor_diameter: float) -> None:
        """Refuse a rotor that the grid does not reach around, or warn, as ``beyond_grid`` says (`Inflow`)."""
        self.box.require_cover(hub_height, rotor_diameter, hold=self.beyond_grid == "hold")

    def _fill_from(self, box: TurbulenceBox, rows: Array, time: float, out: Array) -> int:
        return _fill_carried(box, rows, time + self.time_offset, self._mean_wind, box.scale, box.time_step, out)


_SLOWEST = 1e-3
"""Speed of the air in a calm [m/s]: the kernels divide by it."""
_SPACING = 1.0
"""Of the knots of a drawn path [s]."""
_TURNS = 0.4
"""Share of the range, at both of its ends, within which a path turns."""
_BRIEFEST = 0.5
"""Least time of a short rise or fall over that of one through the whole range [-]."""


@dataclass(frozen=True, eq=False)
class PathInflow(CarriedInflow):
    """Frozen turbulence carried along by a mean wind whose speed changes with time.

    The mean speed V(t) at the hub follows straight lines between the knots of the path and is the same at all places at
    once. Turbulence is a field in space (Taylor's hypothesis): with the way ``s(t) = ∫ V dt`` that the air has come,

    u(x, y, z, t) = mean(z) V(t) + scale(t) box(y, z, s(t) − x)

    Kaimal's spectra and coherence depend on frequency through f/V alone, so the field has at each speed the spectrum
    that IEC 61400-1 gives for it, as long as the mean changes little while an eddy passes: ``|dV/dt| << V²/L`` with L
    of 340 m at hub heights from 60 m on. A rise of 32 m/s in 300 s has 0.17 m/s² at its steepest, which is a quarter of
    V²/L at 15 m/s, and as much at 7.6 m/s; slower winds than that carry their eddies through a rise. The box repeats
    itself in space. What is seen ahead of the rotor (`velocity_ahead`) has changed as at the speed of the box.

    Parameters
    ----------
    times : ndarray, shape (n,)
        Increasing [s]; before and after them the speed stays as at the ends.
    speeds : ndarray, shape (n,)
        Mean speeds at hub height [m/s], 0 to 200.
    profile : SteadyInflow
        Mean wind whose speed the path replaces: its hub height, shear, veer and directions hold.
    box : TurbulenceBox, optional
        Without one the wind has no turbulence.
    scales : ndarray, shape (n,), optional
        Factors on the box at the times [-]; by default 1.
    offset : float
        Way in the box that passes the origin at time zero [m].

    Raises
    ------
    InflowError
        If shapes differ, times do not increase or a number is out of range.

    Examples
    --------
    >>> wind = PathInflow([0.0, 100.0], [4.0, 24.0], SteadyInflow(1.0, 90.0))
    >>> [float(wind.velocity([0.0, 0.0, 90.0], t)[0]) for t in (-5.0, 50.0, 200.0)]
    [4.0, 14.0, 24.0]
    """

    times: Array
    speeds: Array
    profile: SteadyInflow
    box: TurbulenceBox | None = None
    scales: Array | None = None
    offset: float = 0.0
    _evolved: dict[tuple[float, ...], tuple[TurbulenceBox, ...]] = field(default_factory=dict, init=False, repr=False)

    def __post_init__(self) -> None:
        times, speeds = (np.array(a, dtype=np.float64) for a in (self.times, self.speeds))
        scales = np.ones_like(times) if self.scales is None else np.array(self.scales, dtype=np.float64)
        if times.ndim != 1 or times.size < 1 or not times.shape == speeds.shape == scales.shape:
            raise InflowError(
                f"times, speeds and scales of a path must be as many; got shapes {times.shape}, {speeds.shape} and "
                f"{scales.shape}"
            )
        if not (np.isfinite(times).all() and np.all(np.diff(times) > 0.0)):
            raise InflowError("the times of a path must be finite and increase")
        for name, values, most in (("speeds", speeds, 200.0), ("scales", scales, 100.0)):
            if not np.all((values >= 0.0) & (values <= most)):  # not for NaN either
                raise InflowError(
                    f"{name} of a path must lie between 0 and {most:g}; got {values.min()} to {values.max()}"
                )
        if not isinstance(self.profile, SteadyInflow):
            raise InflowError(f"profile must be a SteadyInflow; got {type(self.profile).__name__}")
        if self.box is not None and not isinstance(self.box, TurbulenceBox):
            raise InflowError(f"box must be a TurbulenceBox or None; got {type(self.box).__name__}")
        set_read_only(self, times=times, speeds=speeds, scales=scales)
        check_numbers(self, offset=("m",))

    @cached_property
    def _knots(self) -> tuple[list[float], list[float], list[float], list[float]]:
        """Times, speeds, scales and way of the air at the knots, as numbers; the way is 0 at the first."""
        way = np.concatenate([[0.0], np.cumsum(np.diff(self.times) * 0.5 * (self.speeds[1:] + self.speeds[:-1]))])
        return self.times.tolist(), self.speeds.tolist(), self.scales.tolist(), way.tolist()  # type: ignore[union-attr]

    def _at(self, time: float) -> tuple[float, float, float]:
        """Speed [m/s], scale [-] and way since the first knot [m] at a time."""
        times, speeds, scales, way = self._knots
        k = bisect_right(times, time) - 1
        if k < 0:
            return speeds[0], scales[0], speeds[0] * (time - times[0])
        past = time - times[k]
        if k == len(times) - 1:
            return speeds[k], scales[k], way[k] + speeds[k] * past
        share = past / (times[k + 1] - times[k])
        speed = speeds[k] + share * (speeds[k + 1] - speeds[k])
        return speed, scales[k] + share * (scales[k + 1] - scales[k]), way[k] + 0.5 * (speeds[k] + speed) * past

    def speed(self, time: float) -> float:
        """Mean speed at hub height at a time [m/s]."""
        return self._at(float(time))[0]

    @property
    def mean_speed(self) -> float:
        """Mean over the path of the speed at hub height [m/s]."""
        times, speeds, _, way = self._knots
        return way[-1] / (times[-1] - times[0]) if len(times) > 1 else speeds[0]

    @property
    def start_speed(self) -> float:
        """Speed at hub height at time zero [m/s], turbulence left out."""
        return self.speed(0.0)

    @property
    def hub_height(self) -> float:
        """Hub height [m]."""
        return self.profile.hub_height

    @property
    def description(self) -> str:
        """One line that tells a person what wind this is."""
        ends = f"{self.speeds.min():.3g} to {self.speeds.max():.3g} m/s in {self.times[-1] - self.times[0]:g} s"
        turbulence = "" if self.box is None else f", with {self.box.description}, from {self.offset:.0f} m"
        return f"mean speed along a path, {ends}{turbulence}"

    def require_cover(self, hub_height: float, rotor_diameter: float) -> None:
        """Refuse a rotor that the grid of the box does not reach around, see `TurbulenceBox.require_cover`."""
        if self.box is not None:
            self.box.require_cover(hub_height, rotor_diameter, hold=False)

    @cached_property
    def _rest(self) -> _Mean:
        """Profile without its speed, and the directions, as the kernels take them."""
        return self.profile.kernel_profile[1:], self.profile.yaw_misalignment, self.profile.inclination

    def _fill_from(self, box: TurbulenceBox | None, rows: Array, time: float, out: Array) -> int:
        speed, scale, way = self._at(time)
        speed = max(speed, _SLOWEST)
        rest, direction, inclination = self._rest
        mean = (speed, *rest), direction, inclination
        if box is None:
            return int(mean_velocity(rows, *mean, out))
        # the kernels ask for times at the current speed: way and spacing of the samples, both over it
        came = (way - self._at(0.0)[2] + self.offset) / speed
        return _fill_carried(box, rows, came, mean, scale * box.scale, box.time_step * box.mean_speed / speed, out)


def speed_path(
    rng: Generator, low: float, high: float, swing: tuple[float, float], duration: float, start: float | None = None
) -> tuple[Array, Array]:
    """Draw a path of the mean speed that rises and falls within a range.

    From its start, by default uniform over the range, the speed goes up and down in half cosines, beginning upwards in
    the lower half of the range. It turns at speeds that are uniform over the upper and the lower two fifths of the
    range. A rise or fall through the whole range takes a time that is uniform between two; a shorter one takes as much
    less, but not less than half of that.

    Parameters
    ----------
    rng : numpy.random.Generator
    low, high : float
        Of the mean speed [m/s].
    swing : (float, float)
        Shortest and longest time of a rise or fall through the whole range [s].
    duration : float
        Of the path, at least [s].
    start : float, optional
        Speed at its start [m/s].

    Returns
    -------
    times, speeds : ndarray, shape (n,)
        [s], [m/s].
    """
    drawn, width = float(rng.uniform(low, high)), high - low
    begun = drawn if start is None else start
    rises, length, legs = begun < low + 0.5 * width, 0.0, []
    before = begun
    while length < duration:
        turn = _TURNS * width * float(rng.random())
        after, takes = (high - turn if rises else low + turn), float(rng.uniform(*swing))
        share = abs(after - before) / width if width > 0.0 else 0.0
        takes *= max(share, _BRIEFEST)
        legs.append((length, takes, before, after))
        length, before, rises = length + takes, after, not rises
    times = np.asarray(np.arange(math.ceil(duration / _SPACING) + 1) * _SPACING, dtype=np.float64)
    table = np.array(legs)
    begins, takes_, from_, to = table[np.searchsorted(table[:, 0], times, side="right") - 1].T
    half_cosine = 0.5 * (1.0 - np.cos(np.pi * (times - begins) / takes_))
    return times, np.asarray(from_ + half_cosine * (to - from_), dtype=np.float64)
