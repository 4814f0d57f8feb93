#!/usr/bin/env python3
"""Least tracking error and most energy that the winds of a task's table allow, for its page.

    scripts/power_bounds.py        # a minute
    scripts/power_bounds.py pages  # put the record into the pages

Nothing is simulated: the wind over the disc of the rotor and a table of the rotor's power are all that is needed
(`wt_gym.agents.power_bounds`). The record is docs/data/power_bounds.json.
"""

import argparse
import json
import re
from pathlib import Path

import numpy as np
import use_venv  # noqa: F401 - finds packages and interpreter

ROOT = Path(__file__).resolve().parent.parent
RECORD = ROOT / "docs" / "data" / "power_bounds.json"
SCORES = ROOT / "docs" / "data" / "task_scores.json"
PAGES = {"PowerTracking": "power_tracking", "FullOperation": "full_operation"}
MARKED = "(<!-- bound: {} -->\n).*?(<!-- end -->)"


def measured() -> list[dict[str, float | str]]:
    """Bounds in each wind of the tables."""
    import gymnasium as gym

    from wt_gym.agents.evaluation_config import EvaluationConfig
    from wt_gym.agents.power_bounds import disc_speeds, energy_bound, tracking_bound
    from wt_gym.agents.task_scores import STUDIES
    from wt_gym.envs.turbine_env import turbine_env_of

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
    return rows


def sentence(task: str, rows: list[dict[str, float | str]], runs: list[dict]) -> str:
    """What the page says."""
    own = [row for row in rows if row["task"] == task]
    winds = {row["wind"]: row for row in own}

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
    most = np.mean([row["power"] for row in own]) / 1e6
    shares = [
        f"`{agent}` has {100.0 * mean(agent, 'corrected_power') / 1e6 / most:.1f} %"
        for agent in dict.fromkeys(run["agent"] for run in runs if run["agent"] != "random")
    ]
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
        RECORD.write_text(json.dumps(measured(), indent=1) + "\n")
    pages()


if __name__ == "__main__":
    main()
