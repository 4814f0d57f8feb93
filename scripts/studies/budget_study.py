"""How often an agent violates limits in drawn winds and faults, for the page about budgets.

    python scripts/studies/budget_study.py run      # the same command resumes where it ended
    python scripts/studies/budget_study.py show     # the tables so far
    python scripts/studies/budget_study.py pages    # put them into docs/howto/budgets.md

The agent plays all episodes. Its base controller alone and the agent under a safety filter play the first ones
(--paired) and each in which the agent violates a limit: the same winds, faults and starts, so that violations are told
apart that the agent adds. The controller of the task plays the first ones too. Results are kept in the folder after
each chunk; "pages" keeps their sums in docs/data/budget_study.json, from which "show" and "pages" work without it.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
from concurrent.futures import ProcessPoolExecutor
from functools import lru_cache
from multiprocessing import get_context
from pathlib import Path
from typing import TYPE_CHECKING, Any

import gymnasium as gym
import numpy as np
from scipy.stats import binomtest
from study_pages import DATA, ROOT, TRAINED, markdown, read_json, renew

from wt_gym.analysis.metrics import damage_equivalent_load
from wt_gym.base.files import write_text_whole
from wt_gym.envs import SafetyFilter
from wt_gym.envs.options import registered_arguments
from wt_gym.envs.terminations import violated
from wt_gym.experiment.trained_agent import MODEL_FILE, RECORD_FILE, TrainedAgent, model_digests, read_record

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence

RECORD, PAGE, AGENT = DATA / "budget_study.json", ROOT / "docs" / "howto" / "budgets.md", TRAINED / "faults"
TASK, BASE, PLAIN, FILTERED = POLICIES = ("task", "base", "agent", "filtered")
NAMES = {
    TASK: "controller of the task", BASE: "base controller", PLAIN: "agent", FILTERED: "agent under the filter",
}  # fmt: skip
LIMITS = {"pitch_travel": 6000.0, "rotor_speed": 1.15, "tip_clearance": 3.2, "tower_acceleration": 1.0}
"""Of the pages; an operator has others."""
TEXTS = {
    "pitch_travel": "pitch travel above {:g} rad/d",
    "rotor_speed": "rotor speed above {:g} of rated",
    "tip_clearance": "tip clearance below {:g} m",
    "tower_acceleration": "tower acceleration above {:g} m/s²",
}
FIGURES = (
    ("most", "pitch_travel", "most pitch travel [rad/d]", 0),
    ("most", "rotor_speed", "highest rotor speed [of rated]", 3),
    ("most", "tip_clearance", "least tip clearance [m]", 2),
    ("most", "tower_acceleration", "largest tower acceleration [m/s²]", 2),
    ("mean", "travel", "mean pitch travel [rad/d]", 0),
    ("mean", "flap", "mean flap DEL of 30 s [MN m]", 3),
    ("mean", "power", "mean power [MW]", 3),
)
"""Rows of the table: part and name in a count, text, and digits."""
FIRST_SEED = 10_000_000
"""Of the episodes; those of trainings are small numbers."""
WIND_SEEDS = tuple(range(5001, 5033))
"""Turbulence that no training and no selection has met, few enough for the cache to keep all boxes."""
DURATION, FAULT_TIME = 30.0, 5.0
"""Of an episode, and when its fault begins [s]."""
HORIZON, WATCH = 5.0, 0.75
"""Of the safety filter."""
CHUNK = 20
"""Episodes after which results are written."""
FLAP_EXPONENT = 10.0


@lru_cache
def environment(policy: str, agent: Path) -> Any:
    """Environment of a policy, once in a process; controllers alone have the cheapest observation."""
    config = read_record(agent / RECORD_FILE)["config"]
    kwargs = config["env_kwargs"] | {
        "relative_reward": False, "starts": None, "wind_seeds": WIND_SEEDS, "episode_length": DURATION,
        "fault_time": FAULT_TIME, "start": "steady", "cost_limits": LIMITS,
    }  # fmt: skip
    env_id = config["env_id"]
    if policy in (TASK, BASE):
        kwargs |= {"observation": ("rotor",)}
    if policy == TASK:
        own = registered_arguments(env_id, {})["controller"]
        kwargs |= {"controller": own, "residual_fade": False, "residual_washout": None}
    env = gym.make(env_id, disable_env_checker=True, **kwargs)
    return SafetyFilter(env, horizon=HORIZON, watch=WATCH) if policy == FILTERED else env


_loaded = lru_cache(TrainedAgent.load)
"""The agent of a folder, once in a process."""


def play(policy: str, agent: Path, episode: int) -> dict[str, Any]:
    """Play one episode.

    Parameters
    ----------
    policy : str
        Of `POLICIES`.
    agent : path
        Folder of the agent.
    episode : int
        Number of the episode: the same wind, fault and start for each policy.

    Returns
    -------
    dict
        As JSON values.
    """
    env, model = environment(policy, agent), _loaded(agent)
    plain = env.unwrapped
    observation, info = env.reset(seed=FIRST_SEED + episode)
    fault = info["fault"]
    if policy in (PLAIN, FILTERED):
        model.enter(plain.layout)
    still = np.zeros(env.action_space.shape, dtype=np.float32)
    sums = dict.fromkeys(LIMITS, 0.0)
    speed, clearance, acceleration, power = 0.0, math.inf, 0.0, 0.0
    flap, ended, truncated, steps = [], False, False, 0
    while not (ended or truncated):
        action = still if policy in (TASK, BASE) else model.predict(observation)[0]
        observation, _, ended, truncated, info = env.step(action)
        steps += 1
        signals = plain.signals
        for name, cost in info["costs"].items():
            sums[name] += cost
        speed = max(speed, float(signals["rotor_speed_max"]))
        clearance = min(clearance, *signals["tip_clearance_min"].tolist())
        axes = (float(signals[f"nacelle_acceleration_{axis}"]) for axis in ("fore_aft", "side_side"))
        acceleration = max(acceleration, math.hypot(*axes))
        power += float(signals["generator_power"])
        flap.append(signals["root_flap_moment"].tolist())
    lasted = steps * plain.control_dt
    loads = np.array(flap).T
    return {
        "episode": episode, "kind": fault["kind"], "size": round(fault["size"], 4), "blade": fault["blade"],
        "wind": round(float(info["wind_speed"]), 2), "steps": steps, "ending": info.get("termination", "time"),
        "violated": list(violated({name: total / steps for name, total in sums.items()})),
        "speed": round(speed / plain.turbine.drivetrain.rated_rotor_speed, 4), "clearance": round(clearance, 3),
        "acceleration": round(acceleration, 4),
        "travel": round(sums["pitch_travel"] / steps * LIMITS["pitch_travel"], 1),
        "flap": round(float(np.mean([damage_equivalent_load(one, lasted, FLAP_EXPONENT) for one in loads])) / 1e6, 4),
        "power": round(power / steps / 1e6, 4), "filtered": round(float(info.get("filtered_share", 0.0)), 6),
    }  # fmt: skip


def setup(agent: Path) -> dict[str, Any]:
    """What all results of a folder have in common."""
    return {
        "limits": LIMITS, "first_seed": FIRST_SEED, "wind_seeds": [WIND_SEEDS[0], WIND_SEEDS[-1]], "duration": DURATION,
        "fault_time": FAULT_TIME, "horizon": HORIZON, "watch": WATCH, "model": model_digests(agent)[MODEL_FILE],
    }  # fmt: skip


def read(folder: Path) -> dict[str, dict[int, dict[str, Any]]]:
    """Results of a folder by policy and episode; a line that was cut off while it was written counts for nothing."""
    found: dict[str, dict[int, dict[str, Any]]] = {policy: {} for policy in POLICIES}
    for policy, rows in found.items():
        path = folder / f"{policy}.jsonl"
        for line in path.read_text(encoding="utf-8").splitlines() if path.is_file() else ():
            if line.endswith("}"):
                row = json.loads(line)
                rows[row["episode"]] = row
    return found


def run(folder: Path, agent: Path, episodes: int, paired: int, jobs: int) -> None:
    """Play what is missing in the folder.

    Raises
    ------
    ValueError
        If the folder holds results of another agent, or with other limits.
    """
    folder.mkdir(parents=True, exist_ok=True)
    mine, head = setup(agent), folder / "setup.json"
    if head.is_file() and (theirs := read_json(head)) != mine:
        other = ", ".join(name for name in mine if theirs.get(name) != mine[name])
        raise ValueError(f"the results in {folder} have another {other}: give --out another folder")
    write_text_whole(head, json.dumps(mine) + "\n")
    found = read(folder)
    with ProcessPoolExecutor(jobs, mp_context=get_context("spawn")) as pool:
        play_each = pool.map if jobs > 1 else map
        for first in range(0, episodes, CHUNK):
            chunk = range(first, min(first + CHUNK, episodes))
            for policy in (PLAIN, BASE, FILTERED, TASK):
                wanted = [
                    k
                    for k in chunk
                    if policy == PLAIN or k < paired or (policy != TASK and found[PLAIN][k]["violated"])
                ]
                missing = [k for k in wanted if k not in found[policy]]
                rows = list(play_each(play, [policy] * len(missing), [agent] * len(missing), missing))
                found[policy] |= {row["episode"]: row for row in rows}
                append(folder / f"{policy}.jsonl", rows)
            if (first // CHUNK) % 10 == 0:
                beyond = sum(bool(row["violated"]) for row in found[PLAIN].values())
                print(f"{len(found[PLAIN])} of {episodes} episodes, {beyond} with a violation", flush=True)


def append(path: Path, rows: Sequence[dict[str, Any]]) -> None:
    """Add lines to a file, behind the end of one that was cut off."""
    if not rows:
        return
    cut = path.is_file() and not path.read_bytes().endswith(b"\n")
    with path.open("a", encoding="utf-8") as file:
        file.write(("\n" if cut else "") + "".join(json.dumps(row) + "\n" for row in rows))


def summary(found: dict[str, dict[int, dict[str, Any]]], head: dict[str, Any]) -> dict[str, Any]:
    """Sums of results, as JSON values.

    The other policies are counted in the episodes up to the first that one of them lacks ("paired"); "beyond" lists all
    episodes in which the agent violates a limit, beside what the others do there; "acceleration" is the largest of the
    tower [m/s^2].
    """
    agent = found[PLAIN]
    n = next(k for k in range(len(agent) + 1) if k not in agent)
    paired = next(k for k in range(n + 1) if k == n or any(k not in found[policy] for policy in POLICIES))
    kinds = sorted({agent[k]["kind"] for k in range(n)}, key=lambda kind: (kind != "none", kind))
    beyond = []
    for k in (k for k in range(n) if agent[k]["violated"]):
        rows = {policy: found[policy].get(k) for policy in (PLAIN, BASE, FILTERED)}
        own = {name: agent[k][name] for name in ("episode", "kind", "wind", "violated", "ending")}
        own |= {policy: rows[policy] and rows[policy]["violated"] for policy in (BASE, FILTERED)}
        beyond.append(own | {"acceleration": {policy: row["acceleration"] for policy, row in rows.items() if row}})
    return {
        "setup": head,
        "episodes": n,
        "paired": paired,
        PLAIN: counted(agent[k] for k in range(n)),
        "paired_counts": {policy: counted(found[policy][k] for k in range(paired)) for policy in POLICIES if paired},
        "kinds": {kind: counted(agent[k] for k in range(n) if agent[k]["kind"] == kind) for kind in kinds},
        "filtered": {
            kind: filtered_of(found[FILTERED][k] for k in range(paired) if agent[k]["kind"] == kind) for kind in kinds
        },
        "beyond": beyond,
    }


def filtered_of(rows: Iterable[dict[str, Any]]) -> float | None:
    """Share of the steps that the filter replaced, None of no episodes."""
    pairs = [(row["filtered"] * row["steps"], row["steps"]) for row in rows]
    return float(f"{sum(p[0] for p in pairs) / sum(p[1] for p in pairs):.4g}") if pairs else None


def counted(rows: Iterable[dict[str, Any]]) -> dict[str, Any]:
    """Violations, extremes and means of episodes."""
    rows = list(rows)
    means = {name: float(f"{np.mean([row[name] for row in rows]):.5g}") for name in ("travel", "flap", "power")}
    return {
        "episodes": len(rows), "any": sum(bool(row["violated"]) for row in rows),
        "ended": sum(row["ending"] != "time" for row in rows),
        "limits": {name: sum(name in row["violated"] for row in rows) for name in LIMITS},
        "most": {
            "pitch_travel": max(row["travel"] for row in rows), "rotor_speed": max(row["speed"] for row in rows),
            "tip_clearance": min(row["clearance"] for row in rows),
            "tower_acceleration": max(row["acceleration"] for row in rows),
        },
        "mean": means, "filtered": filtered_of(rows),
    }  # fmt: skip


def share(count: int, n: int) -> str:
    """A count per thousand episodes with its exact 95 % interval (Clopper and Pearson, 1934)."""
    interval = binomtest(count, n).proportion_ci(0.95, method="exact")
    most, low, high = (
        f"{1e3 * value:.0f}" if value >= 0.01 else f"{1e3 * value:.2g}"
        for value in (count / n, interval.low, interval.high)
    )
    return f"{count} ({most} ‰, {low} to {high} ‰)"


def added(record: dict[str, Any]) -> int:
    """Episodes of the agent with a violation in which the base controller violates nothing, or was not played yet."""
    return sum(not row[BASE] for row in record["beyond"])


def tables(record: dict[str, Any]) -> str:
    """Markdown of a summary."""
    names = dict(
        zip(POLICIES, ("controller of the task", "base controller", "agent", "agent under the filter"), strict=True)
    )
    columns = [("agent", record[PLAIN]), *((names[name], one) for name, one in record["paired_counts"].items())]

    def line(text: str, cell: Callable[[dict[str, Any]], str]) -> list[str]:
        return [text, *(cell(one) for _, one in columns)]

    counts = [
        line(TEXTS[name].format(limit), lambda one, name=name: share(one["limits"][name], one["episodes"]))
        for name, limit in record["setup"]["limits"].items()
    ]
    numbers = [
        line(text, lambda one, kind=kind, name=name, digits=digits: f"{one[kind][name]:.{digits}f}")
        for kind, name, text, digits in FIGURES
    ]
    faults = []
    for kind, one in record["kinds"].items():
        beyond, replaced = [row for row in record["beyond"] if row["kind"] == kind], record["filtered"][kind]
        alike = (str(sum(bool(row[policy]) for row in beyond)) for policy in (BASE, FILTERED))
        acted = "–" if replaced is None else f"{100.0 * replaced:.2f} %"
        faults.append([kind, str(one["episodes"]), str(one["any"]), *alike, acted])
    only = share(added(record), record[PLAIN]["episodes"])
    heads = ("fault", "episodes", "with a violation", "of these the base controller too",
             "of these under the filter", "steps replaced")  # fmt: skip
    return "\n\n".join([
        markdown(["episodes with", *(f"{text}, {one['episodes']} episodes" for text, one in columns)], [
            *counts,
            line("any of them", lambda one: share(one["any"], one["episodes"])),
            ["any, and none seen under the base controller", only, *["–"] * (len(columns) - 1)],
            line("an early end", lambda one: str(one["ended"])),
            *numbers,
            line("steps replaced", lambda one: f"{100.0 * one['filtered']:.2f} %"),
        ]),
        markdown(heads, faults),
    ])  # fmt: skip


def record_of(folder: Path | None) -> dict[str, Any]:
    """Summary of a folder, or the record that is kept."""
    if folder is None:
        return read_json(RECORD)
    found = read(folder)
    if 0 not in found[PLAIN]:
        raise ValueError(f"{folder} has no results yet")
    return summary(found, read_json(folder / "setup.json"))


def main(words: list[str] | None = None) -> int:
    """Play, or renew the page."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("command", choices=("run", "pages", "show"))
    parser.add_argument("--out", type=Path, help="folder of the results; without it show and pages take the record")
    parser.add_argument("--agent", type=Path, default=AGENT, help="folder of the agent")
    parser.add_argument("--episodes", type=int, default=10_000, help="of the agent")
    parser.add_argument("--paired", type=int, default=1_000, help="first ones that all policies play")
    parser.add_argument("--jobs", type=int, default=1, help="processes")
    arguments = parser.parse_args(words)
    if arguments.command == "run":
        arguments.out = arguments.out or ROOT / "runs" / "budget_study"
        run(arguments.out, arguments.agent, arguments.episodes, arguments.paired, arguments.jobs)
    record = record_of(arguments.out)
    text = tables(record)
    if arguments.command == "pages":
        write_text_whole(RECORD, json.dumps(record, indent=1, ensure_ascii=False) + "\n")
        renew(PAGE, {"budget study": lambda _: text})
    print(text)
    return 0


if __name__ == "__main__":
    sys.exit(main())
