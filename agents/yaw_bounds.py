"""Energy that the yaw of a rotor can win, by what is known of the wind.

Power is taken as

    P = c min(U, U_rated)^3 cos^3(theta - psi),

with U and theta the mean wind speed and direction over the disc of the rotor and psi the yaw. That leaves the rotor's
speed control and the wake out. What a drive of one rate can win is asked for with three kinds of knowledge:

- the reading of a vane, by the thresholds and filters of `wt_gym.control.controllers.yaw`;
- the direction without turbulence, by two thresholds;
- the whole wind before it blows. Yaw moves by one step of the drive or not at all, so the most of
  ``energy - price * travel`` is found by dynamic programming, exactly: no yaw of that mean travel has more energy.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numba
import numpy as np

from wt_gym.agents.power_bounds import disc_points

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
    cube : numpy.ndarray, shape (n, steps)
        Of the wind speed over the disc, at most rated [m^3/s^3].
    dt : float
        [s].
    rate : float
        Of the yaw drive [rad/s].
    """

    vane: NDArray[np.float64]
    rotor: NDArray[np.float64]
    mean: NDArray[np.float64]
    cube: NDArray[np.float64]
    dt: float
    rate: float


def directions_of(
    turbine: Turbine,
    inflows: Sequence[Inflow],
    wandering: Sequence[Sequence[NDArray[np.float64]]],
    dt: float,
    rated_speed: float,
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
    rated_speed : float
        Wind speed beyond which power no longer rises [m/s].
    """
    points = np.vstack([[0.0, 0.0, turbine.hub_height], disc_points(turbine)])
    vane, rotor, mean, cube = [], [], [], []
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
                cube.append(np.minimum(np.hypot(disc[:, 0], disc[:, 1]), rated_speed) ** 3)
    rate = turbine.nacelle.max_yaw_rate
    return Directions(np.array(vane), np.array(rotor), np.array(mean), np.array(cube), dt, rate)


def by_thresholds(
    winds: Directions, dead_band: float, stop: float, slow: float, fast: float, *, turbulence: bool = True
) -> Yawed:
    """Yaw by a dead band (`wt_gym.control.controllers.yaw.YawByDeadBand`), at zero at first.

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
    energy, travel = _thresholds(read, winds.rotor, winds.cube, winds.rate * winds.dt, dead_band, stop, *keep)
    return Yawed(energy / float(winds.cube.sum()), travel / len(read))


@numba.njit(cache=True)
def _thresholds(
    read: NDArray[np.float64],
    rotor: NDArray[np.float64],
    cube: NDArray[np.float64],
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
            energy += cube[i, k] * max(math.cos(rotor[i, k] - yaw), 0.0) ** 3
    return energy, travel


def with_wind_known(winds: Directions, price: float, widest: float = math.radians(75.0)) -> Yawed:
    """Most of the mean energy less a price of travel, with the wind known from the start.

    Parameters
    ----------
    winds : Directions
    price : float
        Of a radian, over the energy of an episode in which the rotor always faces the wind.
    widest : float
        Yaw, to either side, that no episode needs more of [rad].
    """
    step = winds.rate * winds.dt
    half = math.ceil(widest / step)
    of_step = price * step * float(winds.cube.sum()) / len(winds.cube)
    energy, travel = _programmed(winds.rotor, winds.cube, step, half, of_step)
    return Yawed(energy / float(winds.cube.sum()), travel / len(winds.rotor))


@numba.njit(cache=True)
def _programmed(
    rotor: NDArray[np.float64], cube: NDArray[np.float64], step: float, half: int, price: float
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
                after[j] += cube[i, k] * max(math.cos(rotor[i, k] - (j - half) * step), 0.0) ** 3
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
            energy += cube[i, k] * max(math.cos(rotor[i, k] - (j - half) * step), 0.0) ** 3
    return energy, travel


def with_wind_known_at(winds: Directions, travel: float, rounds: int = 12) -> Yawed:
    """Most energy of a mean travel at least as large [rad], with the wind known from the start.

    Energy is concave in the travel, so the price that is halved in turns meets it; of the last two prices that with
    more travel is taken.
    """
    low, high = 0.0, 1.0
    found = with_wind_known(winds, low)
    if found.travel < travel:
        raise ValueError(
            f"with the wind known no yaw has more travel than {found.travel:.3g} rad, got {travel:.3g} rad"
        )
    for _ in range(rounds):
        price = 0.5 * (low + high)
        at = with_wind_known(winds, price)
        if at.travel >= travel:
            low, found = price, at
        else:
            high = price
    return found
