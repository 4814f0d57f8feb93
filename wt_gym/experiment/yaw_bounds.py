"""Energy that the yaw of a rotor can win, by what is known of the wind.

Power is taken as

    P = c min(U^3 cos^p(theta - psi), U_rated^3),

with U and theta the mean wind speed and direction over the disc of the rotor and psi the yaw; the exponent p is fitted
to the simulator in steady winds. That leaves the rotor's speed control, the wake and noise of the vane out. What a
drive of one rate can win is asked for with three kinds of knowledge:

- the reading of a vane, by the thresholds and filters of `wt_gym.control.controllers.additions`;
- the direction without turbulence, by two thresholds;
- the whole wind before it blows. A yaw that stands or moves by one step of the drive has its most of
  ``energy - price * travel`` by dynamic programming. So with a price at which it travels at least as far as another
  yaw of such steps, it has at least as much energy.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

import numba
import numpy as np

from wt_gym.experiment.power_bounds import disc_points

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from wt_gym.turbines import Turbine
    from wt_gym.wind import Inflow

__all__ = ["Directions", "Yawed", "by_thresholds", "directions_of", "with_wind_known", "with_wind_known_at"]


class Yawed(NamedTuple):
    """What a yaw wins: energy over that of a rotor that always faces the wind, and mean travel of an episode [rad]."""

    energy: float
    travel: float


@dataclass(frozen=True)
class Directions:
    """Directions in episodes of one length.

    Attributes
    ----------
    vane, rotor, mean : numpy.ndarray, shape (n, steps)
        Of the wind at the hub, over the disc of the rotor, and without turbulence [rad].
    speed : numpy.ndarray, shape (n, steps)
        Of the wind over the disc [m/s].
    rated_speed : float
        Wind speed beyond which power no longer rises [m/s].
    exponent : float
        p, see above.
    dt : float
        [s].
    rate : float
        Of the yaw drive [rad/s].
    """

    vane: NDArray[np.float64]
    rotor: NDArray[np.float64]
    mean: NDArray[np.float64]
    speed: NDArray[np.float64]
    rated_speed: float
    exponent: float
    dt: float
    rate: float

    @cached_property
    def cube(self) -> NDArray[np.float64]:
        """Cubed speed, shape (n, steps) [m^3/s^3]."""
        return self.speed**3

    @cached_property
    def most(self) -> float:
        """Energy of a rotor that always faces the wind, in the unit of the kernels."""
        return float(np.sum(np.minimum(self.speed, self.rated_speed) ** 3))


def directions_of(
    turbine: Turbine,
    inflows: Sequence[Inflow],
    wandering: Sequence[Sequence[NDArray[np.float64]]],
    dt: float,
    rated_speed: float,
    exponent: float,
) -> Directions:
    """Directions of inflows along x that are turned.

    Parameters
    ----------
    turbine : Turbine
    inflows : sequence of Inflow
    wandering : sequence of sequence of numpy.ndarray, shape (steps,)
        Directions by which each inflow is turned [rad]: one episode each, and one of its mirror image.
    dt : float
        [s].
    rated_speed, exponent : float
        As of `Directions`.
    """
    points = np.vstack([[0.0, 0.0, turbine.hub_height], disc_points(turbine)])
    vane, rotor, mean, speed = [], [], [], []
    for inflow, draws in zip(inflows, wandering, strict=True):
        times = dt * np.arange(1, len(draws[0]) + 1)
        wind = np.array([inflow.velocity(points, t)[:, :2] for t in times.tolist()])
        hub, disc = wind[:, 0], wind[:, 1:].mean(axis=1)
        read, met = np.arctan2(hub[:, 1], hub[:, 0]), np.arctan2(disc[:, 1], disc[:, 0])
        for draw in draws:
            for side in (1.0, -1.0):
                vane.append(side * read + draw)
                rotor.append(side * met + draw)
                mean.append(draw)
                speed.append(np.hypot(disc[:, 0], disc[:, 1]))
    return Directions(
        np.array(vane), np.array(rotor), np.array(mean), np.array(speed),
        rated_speed, exponent, dt, turbine.nacelle.max_yaw_rate,
    )  # fmt: skip


def by_thresholds(
    winds: Directions, dead_band: float, stop: float, slow: float, fast: float, *, turbulence: bool = True
) -> Yawed:
    """Yaw by a dead band (`wt_gym.control.controllers.additions.YawByDeadBand`), at zero at first.

    Errors are taken for less than half a turn, so nothing is wrapped.

    Parameters
    ----------
    winds : Directions
    dead_band, stop : float
        Filtered yaw error at which the drive starts and stops [rad].
    slow, fast : float
        Time constants of the filters at rest and while turning [s]; 0: none.
    turbulence : bool
        Whether a vane is read, or the direction without turbulence.
    """
    read = winds.vane if turbulence else winds.mean
    keep = [math.exp(-winds.dt / tau) if tau > 0.0 else 0.0 for tau in (slow, fast)]
    step, power = winds.rate * winds.dt, (winds.rated_speed**3, winds.exponent)
    energy, travel = _thresholds(read, winds.rotor, winds.cube, *power, step, dead_band, stop, *keep)
    return Yawed(energy / winds.most, travel / len(read))


@numba.njit(cache=True)
def _power(cube: float, error: float, rated: float, exponent: float) -> float:
    """Of a cubed wind speed at a yaw error, in the unit of the cube."""
    power: float = min(cube * max(math.cos(error), 0.0) ** exponent, rated)
    return power


@numba.njit(cache=True)
def _thresholds(
    read: NDArray[np.float64],
    rotor: NDArray[np.float64],
    cube: NDArray[np.float64],
    rated: float,
    exponent: float,
    step: float,
    dead_band: float,
    stop: float,
    keep_slow: float,
    keep_fast: float,
) -> tuple[float, float]:
    """Energy and travel of all episodes."""
    energy = travel = 0.0
    for i in range(len(read)):
        yaw, turning = 0.0, 0
        slow, fast = min(max(read[i, 0], -dead_band), dead_band), read[i, 0]
        for k in range(read.shape[1]):
            error = read[i, k] - yaw
            slow = error + keep_slow * (slow - error)
            fast = error + keep_fast * (fast - error)
            if turning == 0 and abs(slow) > dead_band:
                turning = 1 if slow > 0.0 else -1
            elif turning != 0 and turning * fast <= stop:
                turning, slow = 0, fast
            yaw += turning * step
            travel += abs(turning) * step
            energy += _power(cube[i, k], rotor[i, k] - yaw, rated, exponent)
    return energy, travel


def with_wind_known(winds: Directions, price: float) -> Yawed:
    """Most of the mean energy less a price of travel, with the wind known from the start, of yaws in whole steps.

    Parameters
    ----------
    winds : Directions
    price : float
        Of a radian, over the energy of an episode in which the rotor always faces the wind.
    """
    step = winds.rate * winds.dt
    # a yaw beyond every direction, from zero, has less energy and more travel
    half = math.ceil(float(np.abs(winds.rotor).max()) / step)
    of_step = price * step * winds.most / len(winds.rotor)
    power = winds.rated_speed**3, winds.exponent
    energy, travel = _programmed(winds.rotor, winds.cube, *power, step, half, of_step)
    return Yawed(energy / winds.most, travel / len(winds.rotor))


@numba.njit(cache=True)
def _programmed(
    rotor: NDArray[np.float64],
    cube: NDArray[np.float64],
    rated: float,
    exponent: float,
    step: float,
    half: int,
    price: float,
) -> tuple[float, float]:
    """Energy and travel of all episodes, from zero yaw."""
    n = 2 * half + 1
    after, value = np.zeros(n), np.zeros(n)
    moves = np.zeros((rotor.shape[1], n), np.int8)
    energy = travel = 0.0
    for i in range(len(rotor)):
        after[:] = 0.0
        for k in range(rotor.shape[1] - 1, -1, -1):
            for j in range(n):  # what is taken of this step at a yaw, and after
                after[j] += _power(cube[i, k], rotor[i, k] - (j - half) * step, rated, exponent)
            for j in range(n):
                best, move = after[j], 0
                if j > 0 and after[j - 1] - price > best:
                    best, move = after[j - 1] - price, -1
                if j < n - 1 and after[j + 1] - price > best:
                    best, move = after[j + 1] - price, 1
                value[j], moves[k, j] = best, move
            after[:] = value
        j = half
        for k in range(rotor.shape[1]):
            move = moves[k, j]
            j += move
            travel += abs(move) * step
            energy += _power(cube[i, k], rotor[i, k] - (j - half) * step, rated, exponent)
    return energy, travel


def with_wind_known_at(winds: Directions, travel: float, rounds: int = 12) -> Yawed:
    """Energy that no yaw in whole steps exceeds at a mean travel [rad], with the wind known from the start.

    The price is bisected: a higher one has no more travel. Of the last two that with more travel is taken, which is at
    least the one that is asked for.

    Raises
    ------
    ValueError
        If energy does not rise up to so much travel.
    """
    low, high = 0.0, 1.0
    found = with_wind_known(winds, low)
    if found.travel < travel:
        raise ValueError(
            f"travel must be at most {found.travel:.3g} rad, where energy ends to rise, got {travel:.3g} rad"
        )
    while with_wind_known(winds, high).travel >= travel > 0.0:
        high *= 2.0
    for _ in range(rounds):
        price = 0.5 * (low + high)
        at = with_wind_known(winds, price)
        if at.travel >= travel:
            low, found = price, at
        else:
            high = price
    return found
