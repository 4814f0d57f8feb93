"""The front of flap DEL against pitch travel: what individual pitch costs in travel, what a band around it saves."""

from __future__ import annotations

import csv
from typing import TYPE_CHECKING, Any

import numpy as np

from wt_gym.agents.entries import BASELINE, LEVELS, Entry, entry_of

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    from wt_gym.benchmark import BenchmarkTask

__all__ = ["BANDWIDTHS", "FAMILIES", "draw_front", "front_entries", "front_rows", "write_csv"]

BANDWIDTHS = (0.025, 0.05, 0.1, 0.2, 0.4)
"""Gains of individual pitch, in rated rotor speeds."""

FAMILIES = {
    "individual pitch, gain": tuple(f"ipc:bandwidth={x:g}" for x in BANDWIDTHS),
    "individual pitch, band": tuple(f"constrained_ipc:level={x:g}" for x in LEVELS),
}
"""Curves of the front, from little to much pitch travel and back."""

_METRICS = ("captured_power", "blade_flap_del", "tower_fore_aft_del", "tower_side_side_del")


def front_entries() -> list[Entry]:
    """Everything that runs: the baseline controller first."""
    return [entry_of(choice) for choice in (BASELINE, *(x for family in FAMILIES.values() for x in family))]


def front_rows(task: BenchmarkTask, results: Mapping[str, Mapping[str, Mapping[str, Any]]]) -> list[dict[str, Any]]:
    """Points of the front in one task.

    Parameters
    ----------
    task : BenchmarkTask
    results : mapping
        Name of an entry to its results by the label of the wind; the baseline among them.

    Returns
    -------
    list of dict
        ``task``, ``wind_speed`` [m/s], ``agent``, ``family``; ``pitch_duty_cycle``, mean over the winds [-]; the
        relative changes of power and DELs against the baseline in the same wind, mean over the winds [-], and
        ``flap_sem``, the standard error of that of the flap DEL [-].

    Raises
    ------
    ValueError
        If a run ended before its time.
    """
    family_of = {agent: family for family, agents in FAMILIES.items() for agent in agents}
    rows = []
    for agent, runs in results.items():
        early = [label for label, run in runs.items() if run["ending"] != "time"]
        if early:
            raise ValueError(f"{agent} did not last in {', '.join(early)} of {task.id}: there is no front")
        own = [runs[wind.label]["metrics"] for wind in task.winds]
        base = [results[BASELINE][wind.label]["metrics"] for wind in task.winds]
        changes = {m: np.array([a[m] / b[m] - 1.0 for a, b in zip(own, base, strict=True)]) for m in _METRICS}
        flap = changes["blade_flap_del"]
        row = {"task": task.id, "wind_speed": task.winds[0].speed, "agent": agent}
        row |= {"family": family_of.get(agent, BASELINE), "winds": len(own)}
        row |= {"pitch_duty_cycle": float(np.mean([metrics["pitch_duty_cycle"] for metrics in own]))}
        row |= {metric: float(values.mean()) for metric, values in changes.items()}
        rows.append(row | {"flap_sem": float(flap.std(ddof=1) / np.sqrt(flap.size))})
    return rows


def write_csv(rows: Sequence[Mapping[str, Any]], path: Path) -> Path:
    """Write the points as a table."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, list(rows[0]), lineterminator="\n")
        writer.writeheader()
        writer.writerows({k: f"{v:.6g}" if isinstance(v, float) else v for k, v in row.items()} for row in rows)
    return path


def draw_front(rows: Sequence[Mapping[str, Any]], path: Path) -> Path:
    """Draw the change of the flap DEL over the pitch duty cycle, one picture a task."""
    import matplotlib as mpl

    mpl.use("Agg")
    import matplotlib.pyplot as plt

    mpl.rcParams["svg.hashsalt"] = "front"
    tasks = sorted({(row["wind_speed"], row["task"]) for row in rows})
    figure, axes = plt.subplots(
        1, len(tasks), figsize=(4.4 * len(tasks), 4.0), layout="constrained", sharey=True, squeeze=False
    )
    for axis, (speed, task) in zip(axes[0], tasks, strict=True):
        own = [row for row in rows if row["task"] == task]
        for family, marker in zip((*FAMILIES, BASELINE), "osD", strict=True):
            points = sorted((row for row in own if row["family"] == family), key=lambda row: row["pitch_duty_cycle"])
            duty, flap, error = (
                [100.0 * row[key] for row in points] for key in ("pitch_duty_cycle", "blade_flap_del", "flap_sem")
            )
            axis.errorbar(duty, flap, error, marker=marker, ms=5, lw=1.2, capsize=2, label=family)
            for row, x, y in zip(points, duty, flap, strict=True):
                setting = row["agent"].rpartition("=")[2] if "=" in row["agent"] else ""
                axis.annotate(setting, (x, y), xytext=(4, 4), textcoords="offset points", fontsize=8, color="0.35")
        axis.set_title(f"{speed:g} m/s", fontsize=11)
        axis.set_xlabel("pitch duty cycle [%]")
        axis.axhline(0, color="0.8", lw=0.8, zorder=0)
        axis.spines[["top", "right"]].set_visible(False)
    axes[0][0].set_ylabel("flap DEL against the baseline [%]")
    axes[0][0].legend(frameon=False, fontsize=9)
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, metadata={"Date": None})
    plt.close(figure)
    return path
