"""Least tracking error and most energy that the winds of a task allow, for its page.

    python scripts/studies/power_bounds.py        # ten minutes
    python scripts/studies/power_bounds.py pages  # put the record into the pages

Writes docs/data/power_bounds.json. A quasi-steady rotor takes at most

    P(E, v) = rho A v^3 Cp(lambda) / 2,    lambda = R sqrt(2 E / J) / v,    Cp(lambda) = max over pitch,

of a wind at a kinetic energy E, with v^3 the mean cube of the wind speed over its disc. Over E it has a concave hull
with the edges Cp <= s_j lambda^2 + c_j, which are the same in any wind, since lambda^2 is proportional to E. So both
are solutions of linear programs (power as a concave function of the kinetic energy: Hovgaard, Boyd and Jørgensen, Wind
Energy 18 (2015) 991), in which the rotor stores energy up to the limit of its speed. Direction of the wind, losses of
starts and stops, rates of torque and pitch and loads are left out, which only helps. So is unsteady inflow, in which a
rotor takes more than in a steady wind for some seconds, and less in others.
"""

import argparse
import json
import math

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linprog
from scipy.sparse import block_array, csr_array, diags_array, eye_array
from study_pages import DATA, TASK_PAGES, read_json, renew
from task_scores import STUDIES

from wt_gym.control.design import rotor_inertia
from wt_gym.control.rotor import RotorTable, rotor_table
from wt_gym.envs.power import efficiency
from wt_gym.envs.turbine_env import turbine_env_of
from wt_gym.experiment.evaluation import EvaluationConfig
from wt_gym.turbines import Turbine
from wt_gym.wind import Inflow

RECORD = DATA / "power_bounds.json"
PAGES = {"PowerTracking": "power_tracking", "FullOperation": "full_operation", "MaxPower": "max_power"}
_RINGS, _SPOKES = 4, 12
_MEGA = 1e6


def disc_speeds(turbine: Turbine, inflow: Inflow, times: NDArray[np.float64]) -> NDArray[np.float64]:
    """Third root of the mean cube of the horizontal wind over the disc of the rotor (n,) [m/s].

    The disc stands across x, the direction of the undisturbed wind of the tasks.

    Parameters
    ----------
    times : numpy.ndarray, shape (n,)
        [s].
    """
    ring = turbine.rotor_diameter / 2 * np.sqrt((np.arange(_RINGS) + 0.5) / _RINGS)  # of equal areas
    angle = 2.0 * np.pi * np.arange(_SPOKES) / _SPOKES
    points = np.zeros((_RINGS * _SPOKES, 3))
    points[:, 1] = np.outer(ring, np.sin(angle)).ravel()
    points[:, 2] = turbine.hub_height + np.outer(ring, np.cos(angle)).ravel()
    cubes = [np.mean(np.hypot(*inflow.velocity(points, t)[:, :2].T) ** 3) for t in times.tolist()]
    return np.cbrt(cubes)


def hull_edges(table: RotorTable) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Slope and intercept (n,) of the edges of the hull of a table: Cp <= slope lambda^2 + intercept.

    A rotor that stands takes nothing. One that turns faster than the best ratio takes less, which is left out.
    """
    x = np.concatenate([[0.0], table.tip_speed_ratio**2])
    y = np.concatenate([[0.0], np.maximum(table.power.max(axis=1), 0.0)])
    corners: list[int] = []
    for k in range(len(x)):
        while len(corners) > 1:
            a, b = corners[-2:]
            if (y[b] - y[a]) * (x[k] - x[a]) > (y[k] - y[a]) * (x[b] - x[a]):
                break
            corners.pop()
        corners.append(k)
    slope = np.diff(y[corners]) / np.diff(x[corners])
    intercept = y[corners][:-1] - slope * x[corners][:-1]
    return np.append(slope[slope > 0.0], 0.0), np.append(intercept[slope > 0.0], y.max())


def energy_bound(turbine: Turbine, speeds: NDArray[np.float64], dt: float, fastest: float) -> float:
    """Mean electrical power [W] of a turbine that always takes the most of the wind, with the energy it holds at last.

    Parameters
    ----------
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
    price, per_joule = np.zeros((4, len(speeds))), efficiency(turbine) / (len(speeds) * dt)
    price[1] = -1.0 / len(speeds)
    price[3, -1] = -per_joule
    least = _least(price, turbine, speeds, dt, fastest, turbine.drivetrain.rated_power)
    return -least - per_joule * _held(turbine)


def tracking_bound(
    turbine: Turbine, speeds: NDArray[np.float64], demanded: NDArray[np.float64], dt: float, skip: float, fastest: float
) -> float:
    """Least mean size of the tracking error [W] after a start.

    Parameters
    ----------
    turbine, speeds, dt, fastest
        As of `energy_bound`.
    demanded : numpy.ndarray, shape (n,)
        Electrical power [W].
    skip : float
        Length of the start, in which errors do not count [s].

    Raises
    ------
    ValueError
        If the linear program has no solution.
    """
    counted = np.arange(len(speeds)) * dt >= skip
    price = np.zeros((4, len(speeds)))
    price[2] = counted / counted.sum()
    most = max(turbine.drivetrain.rated_power, float(demanded.max()))
    return _least(price, turbine, speeds, dt, fastest, most, demanded)


def _held(turbine: Turbine) -> float:
    """Kinetic energy at rated speed [J]."""
    return 0.5 * rotor_inertia(turbine) * turbine.drivetrain.rated_rotor_speed**2


def _least(
    price: NDArray[np.float64], turbine: Turbine, speeds: NDArray[np.float64], dt: float, fastest: float,
    most_power: float, demanded: NDArray[np.float64] | None = None,
) -> float:  # fmt: skip
    """Least price (4, n) of power of the air, electrical power, error [W], and kinetic energy after the steps [J].

    The program is in MW and MJ.
    """
    n, one, none = len(speeds), eye_array(len(speeds)), csr_array((len(speeds), len(speeds)))
    table, start = rotor_table(turbine), np.zeros(n)
    start[0] = _held(turbine) / _MEGA
    area = 0.5 * table.air_density * math.pi * table.radius**2
    before = csr_array(diags_array([np.ones(n - 1)], offsets=[-1], shape=(n, n)))
    rows, bounds = [], []
    for slope, intercept in zip(*hull_edges(table), strict=True):
        rise = area * speeds * slope * 2.0 * table.radius**2 / rotor_inertia(turbine)
        constant = area * speeds**3 * intercept / _MEGA
        constant[0] += 0.5 * rise[0] * start[0]
        # of the mean energy of the step: no more than the concave power at either end
        rows.append([one, none, none, -0.5 * diags_array(rise) @ (before + one)])
        bounds.append(constant)
    if demanded is not None:
        rows += [[None, one, -one, None], [None, -one, -one, None]]
        bounds += [demanded / _MEGA, -demanded / _MEGA]
    balance = [[-dt * one, dt / efficiency(turbine) * one, none, one - before]]
    most = np.repeat([np.inf, most_power / _MEGA, np.inf, fastest**2 * start[0]], n)
    solved = linprog(
        price.ravel(), A_ub=block_array(rows, format="csr"), b_ub=np.concatenate(bounds),
        A_eq=block_array(balance, format="csr"), b_eq=start, bounds=np.stack([np.zeros(4 * n), most], 1),
        method="highs",
    )  # fmt: skip
    if solved.fun is None:
        raise ValueError(f"the bound of the power was not found: {solved.message}")
    return float(solved.fun * _MEGA)


def measured() -> list[dict[str, float | str]]:
    """Bounds in each wind of the tables; for MaxPower also the share that a controller has of them in steady winds."""
    rows: list[dict[str, float | str]] = []
    for task in PAGES:
        study = STUDIES[task]
        for part in study.parts:
            config = EvaluationConfig(study.env_id, part.arguments, part.winds, duration=study.duration)
            env = gym.make(study.env_id, **part.arguments | {"relative_reward": False})
            plain = turbine_env_of(env)
            for wind in part.winds:
                options = {"azimuth": 0.0, "wind_speed": wind.speed, "wind_seed": wind.seed}
                env.reset(seed=config.seed_in(wind), options=options)
                dt, fastest = plain.control_dt, plain.options.limits.overspeed
                times = dt * np.arange(1, round(study.duration / dt) + 1)
                speeds = disc_speeds(plain.turbine, plain.operation.wind.inflow, times)
                row: dict[str, float | str] = {"task": task, "wind": wind.label}
                if (reference := plain.operation.reference) is None:
                    row["power"] = energy_bound(plain.turbine, speeds[times > study.skip], dt, fastest)
                else:
                    demanded = np.array([reference.at(t) for t in times.tolist()])
                    row["error"] = tracking_bound(plain.turbine, speeds, demanded, dt, study.skip, fastest)
                rows.append(row)
            env.close()
        if task == "MaxPower":
            speeds = sorted({wind.speed for part in study.parts for wind in part.winds})
            rows += [{"task": task, "steady": speed, "share": steady_share(speed, fastest)} for speed in speeds]
    return rows


def steady_share(speed: float, fastest: float) -> float:
    """Power of `retuned` on the NREL 5-MW in a steady wind [m/s], in the last of two minutes, over its bound."""
    env = gym.make(
        "wt_gym/NREL5MW-Steady-v1", wind_speed=speed, controller="retuned", action_mode="residual", episode_length=120.0
    )
    env.reset(seed=0)
    plain, idle, power = turbine_env_of(env), np.zeros(env.action_space.shape, np.float32), []
    for _ in range(round(120.0 / plain.control_dt)):
        env.step(idle)
        power.append(plain.signals["generator_power"])
    env.close()
    still = np.repeat(disc_speeds(plain.turbine, plain.operation.wind.inflow, np.zeros(1)), 3000)
    return float(np.mean(power[len(power) // 2 :])) / energy_bound(plain.turbine, still, 0.1, fastest)


def sentence(task: str, rows: list[dict[str, float | str]], runs: list[dict]) -> str:
    """The sentence of a page."""
    own = [row for row in rows if row["task"] == task]
    winds = {row["wind"]: row for row in own if "wind" in row}
    start = "Bound ([how](../studies/benchmark.md#bounds-of-power)): "

    def mean(agent: str, key: str) -> float:
        """Mean over these winds."""
        return float(np.mean([run["metrics"][key] for run in runs if run["agent"] == agent and run["wind"] in winds]))

    if task == "PowerTracking":
        least = np.mean([row["error"] for row in own]) / 1e3
        base = mean("discon+derate_kinetic", "tracking_mean") / 1e3
        need = "no error is necessary" if least < 0.05 else f"the mean size of the error is at least {least:.1f} kW"
        return (
            f"{start}with the wind known, {need} in these winds; "
            f"`discon+derate_kinetic`, which does not know it, has {base:.1f} kW."
        )
    most = np.mean([row["power"] for row in winds.values()]) / 1e6
    shares = ", ".join(
        f"`{agent}` has {100.0 * mean(agent, 'corrected_power') / 1e6 / most:.1f} %"
        for agent in dict.fromkeys(run["agent"] for run in runs if run["agent"] != "random")
    )
    if task == "MaxPower":
        steady = {row["steady"]: f"{100.0 * row['share']:.1f} %" for row in own if "steady" in row}
        speeds = ", ".join(f"{speed:g}" for speed in steady)
        return (
            f"{start}a quasi-steady rotor that knows the wind and always "
            f"takes the most of it makes {most:.3f} MW in these winds. Of this {shares}. In steady winds "
            f"`retuned` misses a part of it too: at {speeds} m/s it has {', '.join(steady.values())}."
        )
    base = {run["wind"]: run["metrics"]["corrected_power"] for run in runs if run["agent"] == runs[0]["agent"]}
    missing = [100.0 * (1.0 - base[row["wind"]] / row["power"]) for row in own]
    return (
        f"{start}a turbine that always takes the most of the wind, without "
        f"cut-out, starts and stops, makes {most:.3f} MW along these paths. Of this {shares}; the base "
        f"controller misses {min(missing):.1f} to {max(missing):.1f} % by path."
    )


def bound(task: str) -> str:
    """The sentence of a page, from the records."""
    return sentence(task, read_json(RECORD), read_json(DATA / "task_scores.json")[task]["runs"])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", nargs="?", choices=["pages"])
    if parser.parse_args().what is None:
        RECORD.write_text(json.dumps(measured(), indent=1) + "\n")
    for name in PAGES.values():
        renew(TASK_PAGES / f"{name}.md", {"bound": bound})


if __name__ == "__main__":
    main()
