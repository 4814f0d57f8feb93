"""Front of flap DEL against pitch travel: gains of individual pitch, bands that constrain it, and a lidar.

    python scripts/studies/load_travel_front.py --jobs 2
    python scripts/studies/load_travel_front.py runs/ppo --jobs 2      # compare agents with the front

Writes docs/data/load_travel_front.csv and .svg, and prints the table of docs/benchmark.md. Runs are results of the
benchmark: those that stand in the folder --out are not repeated.
"""

from __future__ import annotations

import argparse
import csv
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from wt_gym.analysis.statistics import bootstrap_interval, relative_change
from wt_gym.base.files import whole_file
from wt_gym.base.picture_style import COLORS, INK, LINE_STYLES, MARKERS, SVG, baseline, label_points, plain
from wt_gym.commands import benchmark as command
from wt_gym.commands.options import MODELS, WORKERS, add_shared
from wt_gym.commands.program import OneLineParser, stoppable, user_errors
from wt_gym.experiment.benchmark import BenchmarkAgent, entries_of, entry_of
from wt_gym.experiment.names import BASELINE, LEVELS, with_model_options

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from wt_gym.experiment.benchmark_tasks import BenchmarkTask

DATA = Path(__file__).resolve().parents[2] / "docs" / "data"
BANDWIDTHS = (0.025, 0.05, 0.1, 0.2, 0.4)
"""Gains of individual pitch, in rated rotor speeds."""

FAMILIES = {
    "individual pitch, gain": tuple(f"ipc:bandwidth={x:g}" for x in BANDWIDTHS),
    "individual pitch, band": tuple(f"constrained_ipc:level={x:g}" for x in LEVELS),
}
"""Curves of the front, from little to much pitch travel and back: controllers that know only what has arrived."""

WITH_LIDAR = {"band, with a lidar": tuple(f"lidar+constrained_ipc:level={x:g}" for x in LEVELS)}
"""Drawn and compared with the front, but not part of it: what lidar preview is worth without learning."""

AGENTS = "agents"
"""What the table calls the family of those that are compared with the front."""

_METRICS = ("captured_power", "blade_flap_del", "tower_fore_aft_del", "tower_side_side_del")


def front_entries() -> list[BenchmarkAgent]:
    """Everything that runs: the baseline controller first."""
    families = (*FAMILIES.values(), *WITH_LIDAR.values())
    return [entry_of(choice) for choice in (BASELINE, *(x for family in families for x in family))]


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
    family_of = {agent: family for family, agents in {**FAMILIES, **WITH_LIDAR}.items() for agent in agents}
    _refuse_early(task, results)
    rows = []
    for agent, runs in results.items():
        own = [runs[wind.label]["metrics"] for wind in task.winds]
        base = [results[BASELINE][wind.label]["metrics"] for wind in task.winds]
        changes = {m: _changes(own, base, m) for m in _METRICS}
        flap = changes["blade_flap_del"]
        row = {"task": task.id, "wind_speed": task.winds[0].speed, "agent": agent}
        family = BASELINE if agent == BASELINE else family_of.get(agent, AGENTS)
        row |= {"family": family, "winds": len(own)}
        row |= {"pitch_duty_cycle": float(np.mean([metrics["pitch_duty_cycle"] for metrics in own]))}
        row |= {metric: float(values.mean()) for metric, values in changes.items()}
        rows.append(row | {"flap_sem": float(flap.std(ddof=1) / np.sqrt(flap.size))})
    return rows


def _refuse_early(task: BenchmarkTask, results: Mapping[str, Mapping[str, Mapping[str, Any]]]) -> None:
    """Refuse runs that did not last."""
    for agent, runs in results.items():
        early = [label for label, run in runs.items() if run["ending"] != "time"]
        if early:
            raise ValueError(f"{agent} must complete every wind of {task.id}, it ended early in {', '.join(early)}")


def _changes(own: Sequence[Mapping[str, float]], base: Sequence[Mapping[str, float]], metric: str) -> np.ndarray:
    """Relative change of a metric in each wind."""
    return np.array([relative_change(a[metric], b[metric]) for a, b in zip(own, base, strict=True)])


@dataclass(frozen=True)
class FrontDistance:
    """Where an agent lies against the front of one task; negative is below it, which is better.

    Attributes
    ----------
    task : str
    wind_speed : float
        [m/s]
    agent : str
    flap : float
        Its change of the flap DEL [-].
    duty : float
        Its pitch duty cycle [-].
    load, load_interval
        Change of the flap DEL less that of the front at the same duty cycle [-], with 95 % of the bootstrap.
    travel, travel_interval
        Duty cycle relative to the least one with which the front has the same flap DEL, less one [-]; -1 where no
        point of it has.
    """

    task: str
    wind_speed: float
    agent: str
    flap: float
    duty: float
    load: float
    load_interval: tuple[float, float]
    travel: float
    travel_interval: tuple[float, float]


def front_distance(
    task: BenchmarkTask, results: Mapping[str, Mapping[str, Mapping[str, Any]]], agent: str
) -> FrontDistance:
    """Compare an agent with the front at equal travel and at equal load.

    Each family is a curve: straight lines from the baseline through its points in the order of their duty cycle. The
    front at a duty cycle is the lowest of them; a curve never rises again, and beyond its last point stays where it is.
    Both figures are of means over the winds, and each resample of winds (`wt_gym.analysis.statistics`) has a front of
    its own.

    Parameters
    ----------
    task : BenchmarkTask
    results : mapping
        As of `front_rows`.
    agent : str

    Raises
    ------
    ValueError
        If a run ended before its time.
    """
    _refuse_early(task, results)
    base = [results[BASELINE][wind.label]["metrics"] for wind in task.winds]

    def values(name: str) -> np.ndarray:
        own = [results[name][wind.label]["metrics"] for wind in task.winds]
        return np.array([[metrics["pitch_duty_cycle"] for metrics in own], _changes(own, base, "blade_flap_del")])

    curves = [np.array([values(name) for name in (BASELINE, *family)]) for family in FAMILIES.values()]
    mine, winds = values(agent), len(task.winds)

    def figures(chosen: np.ndarray) -> tuple[float, float]:
        duty, flap = mine[:, chosen].mean(axis=1)
        means = [curve[..., chosen].mean(axis=-1) for curve in curves]
        means = [mean[np.argsort(mean[:, 0])] for mean in means]
        for mean in means:  # nobody has to take more travel and more load
            mean[:, 1] = np.minimum.accumulate(mean[:, 1])
        load = flap - min(np.interp(duty, *mean.T) for mean in means)
        return load, duty / min(_least_duty(mean[:, 0], mean[:, 1], flap) for mean in means) - 1.0

    load, travel = figures(np.arange(winds))
    samples: dict[bytes, tuple[float, float]] = {}

    def resampled(indices: np.ndarray, figure: int) -> np.ndarray:
        for row in indices:
            if row.tobytes() not in samples:
                samples[row.tobytes()] = figures(row)
        return np.array([samples[row.tobytes()][figure] for row in indices])

    load_interval, travel_interval = (bootstrap_interval(partial(resampled, figure=k), [0] * winds) for k in range(2))
    duty, flap = mine.mean(axis=1)
    return FrontDistance(
        task.id, task.winds[0].speed, agent, float(flap), float(duty), float(load), load_interval, float(travel),
        travel_interval,
    )  # fmt: skip


def _least_duty(duty: np.ndarray, flap: np.ndarray, required: float) -> float:
    """Least duty cycle at which a curve comes down to a flap DEL; infinite if it never does."""
    if flap[0] <= required:
        return float(duty[0])
    for k in np.flatnonzero(flap[1:] <= required):
        share = (flap[k] - required) / (flap[k] - flap[k + 1])
        return float(duty[k] + share * (duty[k + 1] - duty[k]))
    return np.inf


def distance_table(distances: Sequence[FrontDistance]) -> list[str]:
    """Lines of a table in Markdown."""
    lines = [
        "| wind | agent | flap DEL | pitch duty | flap DEL at equal travel | travel at equal flap DEL |",
        "|---|---|---|---|---|---|",
    ]
    for d in distances:
        load = f"{100 * d.load:+.1f} points [{100 * d.load_interval[0]:+.1f}, {100 * d.load_interval[1]:+.1f}]"
        travel = f"{d.travel:+.0%} [{d.travel_interval[0]:+.0%}, {d.travel_interval[1]:+.0%}]"
        lines.append(
            f"| {d.wind_speed:g} m/s | {d.agent} | {100 * d.flap:+.1f} % | {100 * d.duty:.1f} % | {load} | {travel} |"
        )
    return lines


def write_csv(rows: Sequence[Mapping[str, Any]], path: Path) -> Path:
    """Write the points as a table."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with whole_file(path) as partial, partial.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, list(rows[0]), lineterminator="\n")
        writer.writeheader()
        writer.writerows({k: f"{v:.6g}" if isinstance(v, float) else v for k, v in row.items()} for row in rows)
    return path


def draw_front(rows: Sequence[Mapping[str, Any]], path: Path) -> Path:
    """Draw the change of the flap DEL over the pitch duty cycle, one picture a task."""
    tasks = sorted({(row["wind_speed"], row["task"]) for row in rows})
    figure = Figure(figsize=(4.2 * len(tasks) + 0.6, 4.6), layout="constrained")
    grid = figure.subplots(1, len(tasks), sharey=True, squeeze=False)
    named = []
    for axis, (speed, task) in zip(grid[0], tasks, strict=True):
        plain(axis, "pitch duty cycle [%]", "", f"{speed:g} m/s")
        own = [row for row in rows if row["task"] == task]
        places: list[tuple[float, float]] = []
        bare: list[tuple[float, float]] = []
        texts: list[str] = []
        colors: list[str] = []
        for k, family in enumerate((*FAMILIES, *WITH_LIDAR)):
            points = sorted((row for row in own if row["family"] == family), key=lambda row: row["pitch_duty_cycle"])
            duty, flap, error = (
                [100.0 * row[key] for row in points] for key in ("pitch_duty_cycle", "blade_flap_del", "flap_sem")
            )
            axis.errorbar(duty, flap, error, marker=MARKERS[k], ls=LINE_STYLES[k], color=COLORS[k + 1], ms=4, lw=1.2,
                          elinewidth=0.7, capsize=2, alpha=0.85, label=family)  # fmt: skip
            if family in WITH_LIDAR:  # the settings are those of the curve without
                bare += zip(duty, flap, strict=True)
                continue
            places += zip(duty, flap, strict=True)
            texts += [row["agent"].rpartition("=")[2] for row in points]
            colors += [COLORS[k + 1]] * len(points)
        agents = [row for row in own if row["family"] == AGENTS]
        at = [(100.0 * row["pitch_duty_cycle"], 100.0 * row["blade_flap_del"]) for row in agents]
        if agents:
            axis.errorbar(*zip(*at, strict=True), [100.0 * row["flap_sem"] for row in agents], marker="*", ms=9, ls="",
                          color=COLORS[0], elinewidth=0.7, capsize=2, label="trained agents, controllers")  # fmt: skip
        bare += [(100.0 * row["pitch_duty_cycle"], 0.0) for row in own if row["family"] == BASELINE]
        axis.plot(*bare[-1], "D", color=INK, ms=5, label=f"{BASELINE}, the baseline")
        baseline(axis, 0.0)
        named.append((axis, at, [row["agent"] for row in agents], places, texts, colors, bare))
    grid[0][0].set_ylabel("change of flap DEL against the baseline [%]", fontsize=9, color=INK)
    grid[0][0].set_xlim(left=0.0)
    figure.legend(
        *grid[0][0].get_legend_handles_labels(), loc="outside upper center", ncols=3, frameon=False, fontsize=8
    )
    for axis, at, agents_here, places, texts, colors, bare in named:
        axis.margins(x=0.12, y=0.08)
        label_points(axis, [*at, *places, *bare], [*agents_here, *texts],
                     [*[COLORS[0]] * len(at), *colors], 7.5)  # fmt: skip
    path.parent.mkdir(parents=True, exist_ok=True)
    with whole_file(path) as partial, mpl.rc_context({**SVG, "svg.hashsalt": "front"}):
        figure.savefig(partial, format=path.suffix.removeprefix("."), metadata={"Date": None})
    return path


def make_front(arguments: argparse.Namespace) -> list[dict[str, Any]]:
    """Run controllers and agents; write table and figure; give the rows of the table."""
    entries, rows, distances = front_entries(), [], []
    agents = with_model_options(arguments.agents, arguments.algo, arguments.trust)
    others = [entry for entry in entries_of(agents) if entry not in entries]
    if taken := {entry.name for entry in entries} & {entry.name for entry in others}:
        raise ValueError(f"{', '.join(sorted(taken))} belongs to the front itself: give the agent another name")
    asked = [(task, [*entries, *others]) for task in command.chosen(arguments.task)]
    for (task, _), results in zip(asked, command.results(arguments, asked), strict=True):
        rows += front_rows(task, results)
        compared = [*(name for names in WITH_LIDAR.values() for name in names), *(entry.name for entry in others)]
        distances += [front_distance(task, results, name) for name in compared]
    table = write_csv(rows, arguments.data / "load_travel_front.csv")
    print(f"table: {table}\nfigure: {draw_front(rows, arguments.data / 'load_travel_front.svg')}")
    print("\n".join(distance_table(distances)))
    return rows


def parse_arguments(words: list[str] | None = None) -> argparse.Namespace:
    """Read the command line."""
    parser = OneLineParser(description=__doc__)
    parser.add_argument("agents", nargs="*", metavar="AGENT", help="as of wt-gym benchmark run")
    parser.add_argument("--task", nargs="+", default=["load-reduction"], metavar="NAME", help="(default: %(default)s)")
    parser.add_argument("--out", type=Path, default=Path(command.KEPT), metavar="DIR", help="runs (%(default)s)")
    parser.add_argument("--data", type=Path, default=DATA, metavar="DIR", help="folder of table and figure")
    add_shared(parser, *WORKERS)
    add_shared(parser, *MODELS)
    return parser.parse_args(words)


if __name__ == "__main__":
    arguments = parse_arguments()
    with user_errors(), stoppable("the same command resumes with the runs that are stored"):
        make_front(arguments)
