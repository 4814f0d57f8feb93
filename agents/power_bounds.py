"""What no controller can pass: least tracking error and most energy of a quasi-steady rotor whose wind is known.

The rotor takes at most

    P(E, v) = rho A v^3 Cp(lambda) / 2,    lambda = R sqrt(2 E / J) / v,    Cp(lambda) = max over pitch,

of a wind v at a kinetic energy E. Over E its concave hull has edges Cp <= s_j lambda^2 + c_j, which are the same in any
wind, since lambda^2 is proportional to E. So the least error is the solution of a linear program (power as a concave
function of the kinetic energy: Hovgaard, Boyd and Jørgensen, Wind Energy 18 (2015) 991). What the bounds leave out only
helps: the direction of the wind, losses of starts and stops, rates of torque and pitch, loads. Unsteady inflow lets a
rotor take more than the steady one for a few seconds, and is left out too.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, cast

import numpy as np
from scipy.optimize import linprog
from scipy.sparse import block_array, csr_array, diags_array, eye_array

from wt_gym.control.design import rotor_inertia
from wt_gym.control.rotor_table import rotor_table
from wt_gym.envs.rewards.power import DiscWind, efficiency

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from wt_gym.control.rotor_table import RotorTable
    from wt_gym.simulation.channels import Signals
    from wt_gym.turbines import Turbine
    from wt_gym.wind import Inflow

__all__ = ["RotorHull", "disc_speeds", "energy_bound", "tracking_bound"]


def disc_speeds(turbine: Turbine, inflow: Inflow, times: NDArray[np.float64]) -> NDArray[np.float64]:
    """Mean wind over the disc of the rotor (n,) [m/s] at evenly spaced times [s].

    Parameters
    ----------
    turbine : Turbine
    inflow : Inflow
    times : numpy.ndarray, shape (n,)
    """
    disc, step = DiscWind(turbine), float(times[1] - times[0])
    velocity = inflow.velocity(np.array([[0.0, 0.0, turbine.hub_height]]), float(times[0]))
    x, y = float(velocity[0, 0]), float(velocity[0, 1])
    signals = [cast("Signals", {"wind_x": x, "wind_y": y, "time": t}) for t in times.tolist()]
    found = [disc.begin(inflow, signals[0]), *(disc.advance(inflow, now, step) for now in signals[1:])]
    return np.array(found)


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


def energy_bound(turbine: Turbine, speeds: NDArray[np.float64]) -> float:
    """Mean electrical power [W] of a turbine that always takes the most of the wind, up to rated power.

    Parameters
    ----------
    turbine : Turbine
    speeds : numpy.ndarray, shape (n,)
        Mean wind over the disc [m/s].
    """
    hull = RotorHull.of(rotor_table(turbine))
    power = efficiency(turbine) * hull.area * hull.peak * speeds**3
    return float(np.minimum(power, turbine.drivetrain.rated_power).mean())


def tracking_bound(
    turbine: Turbine, speeds: NDArray[np.float64], demanded: NDArray[np.float64], dt: float, skip: float, fastest: float
) -> float:
    """Least mean size of the tracking error [W] after a start.

    Parameters
    ----------
    turbine : Turbine
    speeds : numpy.ndarray, shape (n,)
        Mean wind over the disc [m/s].
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
    hull, n, shaft = RotorHull.of(rotor_table(turbine)), len(speeds), efficiency(turbine)
    inertia, drive = rotor_inertia(turbine), turbine.drivetrain
    mega = 1e6  # numbers near one
    # unknowns: aerodynamic power a, electrical power p, error e, energy E at the ends of the steps
    aero, power, error, energy = (slice(k * n, (k + 1) * n) for k in range(4))
    step = diags_array([np.ones(n), -np.ones(n - 1)], offsets=[0, -1])
    balance = block_array([[-dt * eye_array(n), dt / shaft * eye_array(n), csr_array((n, n)), step]], format="csr")
    before = np.zeros(n)
    most = 0.5 * inertia * (fastest * drive.rated_rotor_speed) ** 2 / mega
    before[0] = 0.5 * inertia * drive.rated_rotor_speed**2 / mega
    rows, bounds = [], []
    begin = csr_array(diags_array([np.ones(n - 1)], offsets=[-1], shape=(n, n)))
    for slope, intercept in zip(hull.slope, hull.intercept, strict=True):
        rise = hull.area * speeds**3 * slope * 2.0 * hull.radius**2 / (inertia * speeds**2)
        constant = hull.area * speeds**3 * intercept / mega
        constant[0] += rise[0] * before[0]
        rows.append([eye_array(n), csr_array((n, n)), csr_array((n, n)), -diags_array(rise) @ begin])
        bounds.append(constant)
    wide = eye_array(n)
    rows += [[None, wide, -wide, None], [None, -wide, -wide, None]]
    bounds += [demanded / mega, -demanded / mega]
    counted = np.arange(n) * dt >= skip
    price = np.zeros(4 * n)
    price[error] = counted / counted.sum()
    limits = np.zeros((4 * n, 2))
    limits[aero, 1] = limits[error, 1] = np.inf
    limits[power, 1], limits[energy, 1] = max(drive.rated_power, demanded.max()) / mega, most
    solved = linprog(
        price, A_ub=block_array(rows, format="csr"), b_ub=np.concatenate(bounds), A_eq=balance, b_eq=before,
        bounds=limits, method="highs-ipm",
    )  # fmt: skip
    if solved.x is None:
        raise ValueError(f"the least tracking error was not found: {solved.message}")
    return float(solved.fun * mega)
