"""Least tracking error and most energy of a quasi-steady rotor whose wind is known.

The rotor takes at most

    P(E, v) = rho A v^3 Cp(lambda) / 2,    lambda = R sqrt(2 E / J) / v,    Cp(lambda) = max over pitch,

of a wind at a kinetic energy E, with v^3 the mean cube of the wind speed over its disc. Over E it has a concave hull
with the edges Cp <= s_j lambda^2 + c_j, which are the same in any wind, since lambda^2 is proportional to E. So both
are solutions of linear programs (power as a concave function of the kinetic energy: Hovgaard, Boyd and Jørgensen, Wind
Energy 18 (2015) 991), in which the rotor stores energy up to the limit of its speed.

Direction of the wind, losses of starts and stops, rates of torque and pitch and loads are left out, which only helps.
So is unsteady inflow, in which a rotor takes more than in a steady wind for some seconds, and less in others.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.optimize import linprog
from scipy.sparse import block_array, csr_array, diags_array, eye_array

from wt_gym.control.design import rotor_inertia
from wt_gym.control.rotor import rotor_table
from wt_gym.envs.rewards.power import efficiency

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from wt_gym.control.rotor import RotorTable
    from wt_gym.turbines import Turbine
    from wt_gym.wind import Inflow

__all__ = ["RotorHull", "disc_points", "disc_speeds", "energy_bound", "tracking_bound"]

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
