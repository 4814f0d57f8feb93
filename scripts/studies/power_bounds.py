"""Least tracking error and most energy that the winds of a task allow, for its page.

    python scripts/studies/power_bounds.py        # ten minutes
    python scripts/studies/power_bounds.py pages  # put the record into the pages

Writes docs/data/power_bounds.json. Two models of a rotor whose wind is known:

**Energy and tracking error.** A quasi-steady rotor takes at most

    P(E, v) = rho A v^3 Cp(lambda) / 2,    lambda = R sqrt(2 E / J) / v,    Cp(lambda) = max over pitch,

of a wind at a kinetic energy E, with v^3 the mean cube of the wind speed over its disc. Over E it has a concave hull
with the edges Cp <= s_j lambda^2 + c_j, which are the same in any wind, since lambda^2 is proportional to E. So both
are solutions of linear programs (power as a concave function of the kinetic energy: Hovgaard, Boyd and Jørgensen, Wind
Energy 18 (2015) 991), in which the rotor stores energy up to the limit of its speed. Direction of the wind, losses of
starts and stops, rates of torque and pitch and loads are left out, which only helps. So is unsteady inflow, in which a
rotor takes more than in a steady wind for some seconds, and less in others.

**Yaw.** Power is taken as

    P = c min(U^3 cos^p(theta - psi), U_rated^3),

with U and theta the mean wind speed and direction over the disc of the rotor and psi the yaw; the exponent p is fitted
to the simulator in steady winds. That leaves the rotor's speed control, the wake and noise of the vane out. A drive of
one rate has three kinds of knowledge:

- the reading of a vane, by the thresholds and filters of `wt_gym.control.controllers.yaw`;
- the direction without turbulence, by two thresholds;
- the whole wind before it blows. A yaw that stands or moves by one step of the drive has its most of
  ``energy - price * travel`` by dynamic programming. So with a price at which it travels at least as far as another
  yaw of such steps, it has at least as much energy.
"""

from __future__ import annotations

import argparse
import itertools
import json
import math
import re
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import gymnasium as gym
import numba
import numpy as np
from scipy.optimize import linprog
from scipy.sparse import block_array, csr_array, diags_array, eye_array
from task_scores import STUDIES

from wt_gym.control.design import rotor_inertia
from wt_gym.control.rotor import rotor_table
from wt_gym.envs.power import efficiency
from wt_gym.envs.turbine_env import turbine_env_of
from wt_gym.experiment.evaluation import EvaluationConfig
from wt_gym.wind import TurningInflow

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from wt_gym.control.rotor import RotorTable
    from wt_gym.turbines import Turbine
    from wt_gym.wind import Inflow

ROOT = Path(__file__).resolve().parents[2]
RECORD = ROOT / "docs" / "data" / "power_bounds.json"
SCORES = ROOT / "docs" / "data" / "task_scores.json"
PAGES = {"PowerTracking": "power_tracking", "FullOperation": "full_operation", "MaxPower": "max_power", "Yaw": "yaw"}
BOUNDED = ("PowerTracking", "FullOperation", "MaxPower")
"""Tasks whose bounds are linear programs."""
MARKED = "(<!-- bound: {} -->\n).*?(<!-- end -->)"
_RINGS, _SPOKES = 4, 12
_MEGA = 1e6


def disc_points(turbine: Turbine) -> NDArray[np.float64]:
    """Points of equal shares of the disc of the rotor (n, 3) [m], which stands across x."""
    ring = turbine.rotor_diameter / 2 * np.sqrt((np.arange(_RINGS) + 0.5) / _RINGS)  # of equal areas
    angle = 2.0 * np.pi * np.arange(_SPOKES) / _SPOKES
    points = np.zeros((_RINGS * _SPOKES, 3))
    points[:, 1] = np.outer(ring, np.sin(angle)).ravel()
    points[:, 2] = turbine.hub_height + np.outer(ring, np.cos(angle)).ravel()
    return points


def disc_speeds(turbine: Turbine, inflow: Inflow, times: NDArray[np.float64]) -> NDArray[np.float64]:
    """Third root of the mean cube of the horizontal wind over the disc of the rotor (n,) [m/s].

    The disc stands across x, the direction of the undisturbed wind of the tasks.

    Parameters
    ----------
    turbine : Turbine
    inflow : Inflow
    times : numpy.ndarray, shape (n,)
        [s].
    """
    points = disc_points(turbine)
    cubes = [np.mean(np.hypot(*inflow.velocity(points, t)[:, :2].T) ** 3) for t in times.tolist()]
    return np.cbrt(cubes)


@dataclass(frozen=True)
class RotorHull:
    """Concave hull of the power coefficient over the square of the tip-speed ratio.

    Attributes
    ----------
    slope, intercept : numpy.ndarray, shape (n,)
        Cp <= slope lambda^2 + intercept.
    area : float
        rho A / 2 [kg/m].
    radius : float
        [m].
    """

    slope: NDArray[np.float64]
    intercept: NDArray[np.float64]
    area: float
    radius: float

    @classmethod
    def of(cls, table: RotorTable) -> RotorHull:
        """Hull of a table of coefficients; a rotor that stands takes nothing."""
        x = np.concatenate([[0.0], table.tip_speed_ratio**2])
        y = np.concatenate([[0.0], np.maximum(table.power.max(axis=1), 0.0)])
        kept: list[int] = []
        for k in range(len(x)):
            while len(kept) > 1:
                a, b = kept[-2], kept[-1]
                if (y[b] - y[a]) * (x[k] - x[a]) > (y[k] - y[a]) * (x[b] - x[a]):
                    break
                kept.pop()
            kept.append(k)
        slope = np.diff(y[kept]) / np.diff(x[kept])
        # a rotor that turns faster than the best ratio takes less; left out, the bound stays one
        rising = np.append(slope[slope > 0.0], 0.0)
        intercept = np.append((y[kept][:-1] - slope * x[kept][:-1])[slope > 0.0], y.max())
        return cls(rising, intercept, 0.5 * table.air_density * math.pi * table.radius**2, table.radius)

    @property
    def peak(self) -> float:
        """Largest power coefficient."""
        return float(self.intercept[-1])


def energy_bound(turbine: Turbine, speeds: NDArray[np.float64], dt: float, fastest: float) -> float:
    """Mean electrical power [W] of a turbine that always takes the most of the wind, with what its rotor then holds.

    Parameters
    ----------
    turbine : Turbine
    speeds : numpy.ndarray, shape (n,)
        Wind of the disc at the ends of the steps [m/s].
    dt : float
        [s].
    fastest : float
        Greatest rotor speed over rated [-].

    Raises
    ------
    ValueError
        If the linear program has no solution.
    """
    program = _Program(turbine, speeds, dt, fastest)
    price = program.nothing()
    price[program.power] = -1.0 / len(speeds)
    price[program.energy.stop - 1] = -program.shaft / (len(speeds) * dt)
    found = program.least(price, turbine.drivetrain.rated_power)
    return -found - program.shaft * program.held / (len(speeds) * dt)


def tracking_bound(
    turbine: Turbine, speeds: NDArray[np.float64], demanded: NDArray[np.float64], dt: float, skip: float, fastest: float
) -> float:
    """Least mean size of the tracking error [W] after a start.

    Parameters
    ----------
    turbine : Turbine
    speeds : numpy.ndarray, shape (n,)
        Wind of the disc [m/s].
    demanded : numpy.ndarray, shape (n,)
        Electrical power [W].
    dt : float
        [s].
    skip : float
        Length of the start, in which errors do not count [s].
    fastest : float
        Greatest rotor speed over rated [-].

    Raises
    ------
    ValueError
        If the linear program has no solution.
    """
    program = _Program(turbine, speeds, dt, fastest)
    counted = np.arange(len(speeds)) * dt >= skip
    price = program.nothing()
    price[program.error] = counted / counted.sum()
    return program.least(price, max(turbine.drivetrain.rated_power, float(demanded.max())), demanded)


class _Program:
    """Linear program of a rotor: powers and energies in MW and MJ.

    Unknowns, n of each: power of the air, electrical power, error, and kinetic energy at the ends of the steps.
    """

    def __init__(self, turbine: Turbine, speeds: NDArray[np.float64], dt: float, fastest: float) -> None:
        self.n, self.shaft = len(speeds), efficiency(turbine)
        self.air, self.power, self.error, self.energy = (slice(k * self.n, (k + 1) * self.n) for k in range(4))
        inertia, rated = rotor_inertia(turbine), turbine.drivetrain.rated_rotor_speed
        self.held = 0.5 * inertia * rated**2
        self._most = fastest**2 * self.held / _MEGA
        n, one, none = self.n, eye_array(self.n), csr_array((self.n, self.n))
        step = diags_array([np.ones(n), -np.ones(n - 1)], offsets=[0, -1])
        self._balance = block_array([[-dt * one, dt / self.shaft * one, none, step]], format="csr")
        self._start = np.zeros(n)
        self._start[0] = self.held / _MEGA
        self._rows, self._bounds = [], []
        hull = RotorHull.of(rotor_table(turbine))
        begin = csr_array(diags_array([np.ones(n - 1)], offsets=[-1], shape=(n, n)))
        for slope, intercept in zip(hull.slope, hull.intercept, strict=True):
            rise = hull.area * speeds * slope * 2.0 * hull.radius**2 / inertia
            constant = hull.area * speeds**3 * intercept / _MEGA
            constant[0] += 0.5 * rise[0] * self._start[0]
            # of the mean energy of the step: no more than the concave power at either end
            self._rows.append([one, none, none, -0.5 * diags_array(rise) @ (begin + one)])
            self._bounds.append(constant)

    def nothing(self) -> NDArray[np.float64]:
        """Price of nothing (4 n,)."""
        return np.zeros(4 * self.n)

    def least(
        self, price: NDArray[np.float64], most_power: float, demanded: NDArray[np.float64] | None = None
    ) -> float:
        """Least price times 1e6; errors count from demanded power [W]."""
        rows, bounds, one = list(self._rows), list(self._bounds), eye_array(self.n)
        if demanded is not None:
            rows += [[None, one, -one, None], [None, -one, -one, None]]
            bounds += [demanded / _MEGA, -demanded / _MEGA]
        limits = np.zeros((4 * self.n, 2))
        limits[self.air, 1] = limits[self.error, 1] = np.inf
        limits[self.power, 1], limits[self.energy, 1] = most_power / _MEGA, self._most
        solved = linprog(
            price, A_ub=block_array(rows, format="csr"), b_ub=np.concatenate(bounds), A_eq=self._balance,
            b_eq=self._start, bounds=limits, method="highs",
        )  # fmt: skip
        if solved.fun is None:
            raise ValueError(f"the bound of the power was not found: {solved.message}")
        return float(solved.fun * _MEGA)


def measured(tasks: Sequence[str] = BOUNDED) -> list[dict[str, float | str]]:
    """Bounds in each wind of the tables; for MaxPower also what a controller has of them in steady winds."""
    rows: list[dict[str, float | str]] = []
    for task in tasks:
        study = STUDIES[task]
        for part in study.parts:
            config = EvaluationConfig(study.env_id, part.arguments, part.winds, duration=study.duration)
            env = gym.make(study.env_id, **part.arguments | {"relative_reward": False})
            plain = turbine_env_of(env)
            for wind in part.winds:
                options = {"azimuth": 0.0, "wind_speed": wind.speed, "wind_seed": wind.seed}
                env.reset(seed=config.seed_in(wind), options=options)
                dt = plain.control_dt
                times = dt * np.arange(1, round(study.duration / dt) + 1)
                speeds = disc_speeds(plain.turbine, plain.operation.wind.inflow, times)
                found: dict[str, float | str] = {"task": task, "wind": wind.label}
                fastest = plain.options.limits.overspeed
                if (reference := plain.operation.reference) is None:
                    found["power"] = energy_bound(plain.turbine, speeds[times > study.skip], dt, fastest)
                else:
                    demanded = np.array([reference.at(t) for t in times.tolist()])
                    found["error"] = tracking_bound(plain.turbine, speeds, demanded, dt, study.skip, fastest)
                rows.append(found)
                print(found, flush=True)
            env.close()
        if task == "MaxPower":
            for speed in sorted({wind.speed for part in study.parts for wind in part.winds}):
                power, inflow, turbine = steady_power(speed, controller="retuned")
                still = np.repeat(disc_speeds(turbine, inflow, np.zeros(1)), 3000)
                share = power / energy_bound(turbine, still, 0.1, fastest)
                rows.append({"task": task, "steady": speed, "share": share})
                print(rows[-1], flush=True)
    return rows


def steady_power(speed: float, direction: float = 0.0, controller: str = "discon") -> tuple[float, Inflow, Turbine]:
    """Mean power [W] of the NREL 5-MW in a steady wind [m/s, rad] in the last of two minutes, with both."""
    env = gym.make(
        "wt_gym/NREL5MW-Steady-v1", wind_speed=speed, wind_direction=direction, controller=controller,
        action_mode="residual", episode_length=120.0,
    )  # fmt: skip
    env.reset(seed=0)
    plain, idle = turbine_env_of(env), np.zeros(env.action_space.shape, np.float32)
    found = []
    for _ in range(round(120.0 / plain.control_dt)):
        env.step(idle)
        found.append(plain.signals["generator_power"])
    env.close()
    return float(np.mean(found[len(found) // 2 :])), plain.operation.wind.inflow, plain.turbine


# ---- yaw ----


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
    """Yaw by a dead band (`wt_gym.control.controllers.yaw.YawByDeadBand`), at zero at first.

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


YAW_SPEEDS, YAW_SEEDS, YAW_DRAWS = (7.0, 9.0, 11.0), range(1, 17), 6
"""Mean winds [m/s] and turbulence seeds, and directions that are drawn for each."""
BASE, HAND = (8.0, 0.5, 30.0, 5.0), (math.degrees(0.14), math.degrees(0.1), 10.0, 2.0)
"""Thresholds [deg] and filters [s] of `discon+yaw`, and of the dead band of the page."""
_YAW_DT = 0.5


def yaw_exponent() -> float:
    """Exponent of the cosine of the yaw error in the power, fitted to the simulator in steady winds below rated."""
    error = math.radians(20.0)
    power = {
        (speed, direction): steady_power(speed, direction)[0]
        for speed, direction in itertools.product((7.0, 9.0), (-error, 0.0, error))
    }
    shares = [value / power[speed, 0.0] for (speed, direction), value in power.items() if direction]
    return float(np.mean(np.log(shares)) / math.log(math.cos(error)))


def yaw_directions(exponent: float) -> Directions:
    """Winds of the task, with directions drawn as there."""
    env = gym.make("wt_gym/Yaw-v3", relative_reward=False, start="steady")
    plain = turbine_env_of(env)
    (low, high), wander = plain.options.wind.direction, plain.options.wind.wander
    length = env.spec.max_episode_steps * plain.control_dt
    times, rng = _YAW_DT * np.arange(1, round(length / _YAW_DT) + 1), np.random.default_rng(0)
    inflows, wandering = [], []
    for speed, seed in itertools.product(YAW_SPEEDS, YAW_SEEDS):
        env.reset(options={"wind_speed": speed, "wind_seed": seed})
        inflow = plain.operation.wind.inflow.inner
        draws = [
            TurningInflow.wandering(inflow, rng.uniform(low, high), *wander, length, rng) for _ in range(YAW_DRAWS)
        ]
        inflows.append(inflow)
        wandering.append([np.array([draw.direction(t) for t in times.tolist()]) for draw in draws])
    env.close()
    return directions_of(plain.turbine, inflows, wandering, _YAW_DT, plain.turbine.rated_wind_speed, exponent)


def yaw_measured() -> list[dict[str, float | str]]:
    """Energy and travel over those of `discon+yaw`, by what is known."""
    exponent = yaw_exponent()
    winds = yaw_directions(exponent)

    def dead_band(band: float, stop: float, slow: float, fast: float, *, turbulence: bool = True) -> Yawed:
        return by_thresholds(winds, math.radians(band), math.radians(stop), slow, fast, turbulence=turbulence)

    base = dead_band(*BASE)

    def best(grid: itertools.product, *, turbulence: bool) -> tuple[Yawed, tuple[float, ...]]:
        """Thresholds with the most energy of those with no more travel than the base."""
        tried = [(band, band - gap, *filters) for band, gap, *filters in grid if gap <= band]
        found = [(dead_band(*one, turbulence=turbulence), one) for one in tried]
        return max(pair for pair in found if pair[0].travel <= base.travel)

    bands, gaps = np.arange(3.0, 12.01, 0.5).tolist(), (0.1, 0.25, 0.5, 1.0, 1.5, 2.0, 3.0, 4.0, 6.0, 8.0)
    filters = (2.0, 3.0, 5.0, 8.0, 10.0, 15.0, 20.0, 30.0), (0.0, 0.5, 1.0, 2.0, 5.0)
    found = {
        "page": (dead_band(*HAND), HAND),
        "vane": best(itertools.product(bands, gaps, *filters), turbulence=True),
        "direction": best(itertools.product(bands, gaps, (0.0,), (0.0,)), turbulence=False),
        "wind": (with_wind_known_at(winds, base.travel), ()),
        "facing": (Yawed(1.0, math.nan), ()),
    }
    rows: list[dict[str, float | str]] = []
    for known, (yawed, parameters) in found.items():
        row = {"task": "Yaw", "known": known, "exponent": exponent, "energy": yawed.energy / base.energy - 1.0}
        if known != "facing":
            row["travel"] = yawed.travel / base.travel - 1.0
        rows.append(row | {"parameters": list(parameters)})
        print(rows[-1], flush=True)
    return rows


# ---- the pages ----


def sentence(task: str, rows: list[dict[str, float | str]], runs: list[dict]) -> str:
    """What the page says."""
    own = [row for row in rows if row["task"] == task]
    if task == "Yaw":
        energy = {row["known"]: f"{100.0 * row['energy']:+.2f} %" for row in own}
        travel = next(f"{100.0 * row['travel']:+.0f} %" for row in own if row["known"] == "page").replace("-", "−")
        return (
            f"A model of the yaw ([how](../benchmark.md#bounds-of-power)) says what is to be won with no more travel "
            f"than that of `discon+yaw`: thresholds on the vane, the best of a grid, {energy['vane']} energy, "
            f"thresholds on the direction without turbulence {energy['direction']}. No yaw that knows the whole wind "
            f"has more than {energy['wind']} at that travel. A rotor that always faces the wind has "
            f"{energy['facing']}. The last dead band of the table has {energy['page']} in the model, with {travel} "
            f"travel."
        )
    winds = {row["wind"]: row for row in own if "wind" in row}

    def mean(agent: str, key: str) -> float:
        """Of an agent in these winds."""
        return float(np.mean([run["metrics"][key] for run in runs if run["agent"] == agent and run["wind"] in winds]))

    if task == "PowerTracking":
        least = np.mean([row["error"] for row in own]) / 1e3
        base = mean("discon+derate_kinetic", "tracking_mean") / 1e3
        need = "no error is necessary" if least < 0.05 else f"the mean size of the error is at least {least:.1f} kW"
        return (
            f"Bound ([how](../benchmark.md#bounds-of-power)): with the wind known, {need} in these winds; "
            f"`discon+derate_kinetic`, which does not know it, has {base:.1f} kW."
        )
    most = np.mean([row["power"] for row in winds.values()]) / 1e6
    shares = [
        f"`{agent}` has {100.0 * mean(agent, 'corrected_power') / 1e6 / most:.1f} %"
        for agent in dict.fromkeys(run["agent"] for run in runs if run["agent"] != "random")
    ]
    if task == "MaxPower":
        steady = {row["steady"]: f"{100.0 * row['share']:.1f} %" for row in own if "steady" in row}
        speeds = ", ".join(f"{speed:g}" for speed in steady)
        return (
            f"Bound ([how](../benchmark.md#bounds-of-power)): a quasi-steady rotor that knows the wind and always "
            f"takes the most of it makes {most:.3f} MW in these winds. Of this {', '.join(shares)}. In steady winds "
            f"`retuned` misses a part of it too: at {speeds} m/s it has {', '.join(steady.values())}."
        )
    base = {run["wind"]: run["metrics"]["corrected_power"] for run in runs if run["agent"] == runs[0]["agent"]}
    missing = [100.0 * (1.0 - base[row["wind"]] / row["power"]) for row in own]
    return (
        f"Bound ([how](../benchmark.md#bounds-of-power)): a turbine that always takes the most of the wind, without "
        f"cut-out, starts and stops, makes {most:.3f} MW along these paths. Of this {', '.join(shares)}; the base "
        f"controller misses {min(missing):.1f} to {max(missing):.1f} % by path."
    )


def pages() -> None:
    """Put the sentences into the pages."""
    rows, scores = json.loads(RECORD.read_text()), json.loads(SCORES.read_text())
    for task, name in PAGES.items():
        page = ROOT / "docs" / "tasks" / f"{name}.md"
        text, marked = page.read_text(), re.compile(MARKED.format(task), re.DOTALL)
        if not marked.search(text):
            raise SystemExit(f"{page} must have a block <!-- bound: {task} --> … <!-- end -->")
        said = sentence(task, rows, scores[task]["runs"])
        page.write_text(marked.sub(lambda found, said=said: f"{found[1]}{said}\n{found[2]}", text))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", nargs="?", choices=["pages"])
    if parser.parse_args().what is None:
        RECORD.write_text(json.dumps(measured() + yaw_measured(), indent=1) + "\n")
    pages()


if __name__ == "__main__":
    main()
