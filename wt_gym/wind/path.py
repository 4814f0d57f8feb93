"""A wind whose mean speed follows a path while turbulence is carried along by it: from calm to storm and back."""

from __future__ import annotations

import math
from bisect import bisect_right
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from wt_gym.base.errors import InflowError
from wt_gym.wind.carried import CarriedInflow
from wt_gym.wind.inflow_kernels import add_tower_points, mean_velocity, turbulent_velocity
from wt_gym.wind.protocol import require_number
from wt_gym.wind.steady import SteadyInflow
from wt_gym.wind.turbulence_box import TurbulenceBox

if TYPE_CHECKING:
    from numpy.random import Generator
    from numpy.typing import NDArray

__all__ = ["PathInflow", "speed_path"]

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

    times: NDArray[np.float64]
    speeds: NDArray[np.float64]
    profile: SteadyInflow
    box: TurbulenceBox | None = None
    scales: NDArray[np.float64] | None = None
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
        for name, array in (("times", times), ("speeds", speeds), ("scales", scales)):
            array.setflags(write=False)
            object.__setattr__(self, name, array)
        object.__setattr__(self, "offset", require_number(self.offset, "offset", "m"))

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
    def _rest(self) -> tuple[tuple[float, ...], float, float]:
        """Profile without its speed, and the directions, as the kernels take them."""
        return self.profile.kernel_profile[1:], self.profile.yaw_misalignment, self.profile.inclination

    def _fill_from(
        self, box: TurbulenceBox | None, rows: NDArray[np.float64], time: float, out: NDArray[np.float64]
    ) -> int:
        speed, scale, way = self._at(time)
        speed = max(speed, _SLOWEST)
        rest, direction, inclination = self._rest
        mean = (speed, *rest), direction, inclination
        if box is None:
            return int(mean_velocity(rows, *mean, out))
        # the kernels ask for times at the present speed: way and spacing of the samples, both over it
        place = box.time_step * box.mean_speed / speed, box.spacing_y, box.spacing_z, box.y_center, box.z_bottom
        came = (way - self._at(0.0)[2] + self.offset) / speed
        bad = int(turbulent_velocity(rows, came, *mean, box.fluctuation, scale * box.scale, *place, out))
        tower = box.tower
        if bad < 0 and tower is not None and tower.shape[1] > 0:
            add_tower_points(rows, came, *mean, box.fluctuation, tower, scale * box.scale, *place, out)
        return bad


def speed_path(
    rng: Generator,
    low: float,
    high: float,
    swing: tuple[float, float],
    duration: float,
    start: float | None = None,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
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
