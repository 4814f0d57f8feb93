#!/usr/bin/env python3
"""Least tracking error and most energy that the winds of a task allow, for its page.

    scripts/power_bounds.py        # ten minutes
    scripts/power_bounds.py pages  # put the record into the pages

The wind over the disc of the rotor and a table of the rotor's power are all that is needed
(`wt_gym.experiment.power_bounds`); for the yaw also how power falls with the yaw error, which is simulated in steady
winds (`wt_gym.experiment.yaw_bounds`). The record is docs/data/power_bounds.json.
"""

from __future__ import annotations

import argparse
import itertools
import json
import math
import re
from pathlib import Path
from typing import TYPE_CHECKING

import use_venv  # noqa: F401 - finds packages and interpreter

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    from wt_gym.experiment.yaw_bounds import Directions
    from wt_gym.turbines import Turbine
    from wt_gym.wind import Inflow

ROOT = Path(__file__).resolve().parent.parent
RECORD = ROOT / "docs" / "data" / "power_bounds.json"
SCORES = ROOT / "docs" / "data" / "task_scores.json"
PAGES = {"PowerTracking": "power_tracking", "FullOperation": "full_operation", "MaxPower": "max_power", "Yaw": "yaw"}
BOUNDED = ("PowerTracking", "FullOperation", "MaxPower")
"""Tasks whose bounds are linear programs."""
MARKED = "(<!-- bound: {} -->\n).*?(<!-- end -->)"


def measured(tasks: Sequence[str] = BOUNDED) -> list[dict[str, float | str]]:
    """Bounds in each wind of the tables; for MaxPower also what a controller has of them in steady winds."""
    import gymnasium as gym

    from wt_gym.envs.turbine_env import turbine_env_of
    from wt_gym.experiment.evaluation_config import EvaluationConfig
    from wt_gym.experiment.power_bounds import disc_speeds, energy_bound, tracking_bound
    from wt_gym.experiment.task_scores import STUDIES

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
    import gymnasium as gym

    from wt_gym.envs.turbine_env import turbine_env_of

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
    import gymnasium as gym

    from wt_gym.envs.turbine_env import turbine_env_of
    from wt_gym.experiment.yaw_bounds import directions_of
    from wt_gym.wind import TurningInflow

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
    from wt_gym.experiment.yaw_bounds import Yawed, by_thresholds, with_wind_known_at

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
