"""Scores of controllers and shipped agents in each task, for the pages of docs/tasks.

    python scripts/studies/task_scores.py                      # the tables
    python scripts/studies/task_scores.py run                  # measure all tasks, a quarter of an hour on a free core
    python scripts/studies/task_scores.py run Yaw MaxPower     # some of them: the others keep their figures
    python scripts/studies/task_scores.py pages                # put the tables into the pages

Writes docs/data/task_scores.json. A study is one table of a page: agents in the same winds, the first of them the base
controller with zero actions. Runs are stored in runs/task_scores as soon as they are done: "run" resumes them.
"""

import argparse
import math
import re
import sys
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from itertools import cycle
from pathlib import Path
from typing import Any

import numpy as np
from study_pages import (
    DATA,
    ROOT,
    STEADY,
    TASK_PAGES,
    TRAINED,
    filled,
    markdown,
    percent,
    read_json,
    signed,
    with_runs,
    write_entries,
)

import wt_gym
from envs_tests.physics.validation import source_commit
from wt_gym.analysis.metrics import METRICS
from wt_gym.analysis.page import format_estimate
from wt_gym.analysis.results import Run, Wind
from wt_gym.analysis.statistics import (
    LIFETIME_EXPONENTS,
    Estimate,
    WindClimate,
    estimate,
    lifetime_load,
    relative_change,
    wind_weights,
)
from wt_gym.base.files import read_toml, write_text_whole
from wt_gym.commands.program import stoppable, user_errors
from wt_gym.envs.faults import FAULT_KINDS
from wt_gym.envs.wind_sampler import EVALUATION_WIND_SEEDS, GUSTS
from wt_gym.experiment.evaluation import EvaluationConfig, evaluate
from wt_gym.tasks import TASKS
from wt_gym.turbines import load_turbine

RECORD = DATA / "task_scores.json"
RANDOM = "random"
"""Word for even draws of the actions."""
_TRAINED = "agents/trained/"
_DASH = "–"
_NOT_IN_NAMES = re.compile(r"[^\w.+=-]+")


@dataclass(frozen=True)
class Column:
    """A column of a table."""

    key: str  #: Of `wt_gym.analysis.metrics.METRICS`, or "yaw_error_rms".
    heading: str
    how: str
    """"change": relative change against the first agent in each wind, mean and 95 % interval over the winds; "total":
    the change of the sum over the winds; "climate": that of the mean in the turbine's wind climate; "life": that of the
    load over a life in that climate; "level": the mean itself; "most": the largest."""


@dataclass(frozen=True)
class Part:
    """Winds of a study with arguments of the environment of their own."""

    winds: tuple[Wind, ...]
    name: str = ""
    arguments: dict[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Study:
    """Agents in the winds of a task."""

    task: str  #: Of `wt_gym.tasks.TASKS`.
    agents: tuple[str, ...]
    """Words and paths as for `wt_gym.experiment.agents.load_agent`, or `RANDOM`; the base controller first."""
    parts: tuple[Part, ...]
    columns: tuple[Column, ...]
    duration: float = 330.0
    skip: float = 30.0  #: duration, skip: length of a run, and of its start that does not count [s]
    arguments: dict[str, dict[str, Any]] = field(default_factory=dict)
    """Arguments of the environment for single agents."""

    @property
    def env_id(self) -> str:
        """Id of the task."""
        return TASKS[self.task].id


_SHORT = (
    "corrected_power", "blade_flap_del", "tower_fore_aft_del", "pitch_travel", "tracking_rms", "yaw_error_rms",
    "yaw_travel", "blade_flap_max", "tower_base_max", "rotor_speed_max",
)  # fmt: skip
"""Columns of the table of a page, in which there is room for four."""
_ROWS = 8


def _winds(speeds: Iterable[float], seeds: int) -> tuple[Wind, ...]:
    """Each speed with each of some held-out seeds, in the order in which ``wt-gym evaluate`` takes them."""
    return tuple(Wind(speed, seed) for speed in speeds for seed in EVALUATION_WIND_SEEDS[:seeds])


def _gusts(kind: str, speeds: Iterable[float], draws: int) -> Part:
    """Draws of one kind of gust."""
    seeds = EVALUATION_WIND_SEEDS if kind == "ETM" else (None,) * draws
    winds = tuple(
        Wind(speed, seed, None if kind == "ETM" else draw)
        for speed in speeds
        for draw, seed in zip(range(1, draws + 1), seeds, strict=False)
    )
    return Part(winds, kind, {"gusts": (kind,)})


def _parts(winds: dict[str, Any]) -> tuple[Part, ...]:
    """Winds of a study: of each kind of gust, of each kind of fault, of consecutive seeds, or of held-out seeds."""
    speeds = winds["speeds"]
    if "gusts" in winds:
        return tuple(_gusts(kind, speeds, winds["gusts"]) for kind in GUSTS)
    if "fault_time" in winds:
        return tuple(
            Part(_winds([speed], 1), kind, STEADY | {"fault_kinds": kind, "fault_time": winds["fault_time"]})
            for kind, speed in zip(FAULT_KINDS, cycle(speeds), strict=False)
        )
    if "first_seed" in winds:
        drawn = tuple(Wind(speed, winds["first_seed"] + k) for k, speed in enumerate(speeds))
    else:
        drawn = _winds(speeds, winds["seeds"])
    return (Part(drawn, arguments=(STEADY if winds.get("steady") else {}) | winds.get("arguments", {})),)


def _read_studies(path: Path) -> dict[str, Study]:
    """Studies of the file, by the name of the table."""
    tables = read_toml(path)
    columns, studies = tables.pop("columns"), {}
    for name, table in tables.items():
        shown = tuple(Column(*columns[key]) for key in table.pop("columns"))
        agents, parts = tuple(table.pop("agents")), _parts(table.pop("winds"))
        studies[name] = Study(table.pop("task", name), agents, parts, shown, **table)
    return studies


STUDIES = _read_studies(Path(__file__).with_suffix(".toml"))
"""Studies on docs/studies/tasks.md, and in short on the pages of the tasks, by the name of the table."""
STORM_CONTROLLER = STUDIES["FullOperation in storm"].agents[-1]
"""Controller of FullOperation that holds rated speed and power up to a cut-out at 30 m/s."""


def agent_label(agent: str, resting: bool = False) -> str:
    """How an agent is called in a table."""
    if resting:
        return f"`{agent}` as base controller: zero actions"
    if agent == RANDOM:
        return "random actions"
    return f"`{agent.removeprefix(_TRAINED)}`" + (", trained" if agent.startswith(_TRAINED) else "")


def measure(
    study: Study,
    on_progress: Callable[[str], None] = lambda text: None,
    folder: Path | None = None,
    overwrite: bool = False,
) -> list[dict[str, Any]]:
    """Run every agent of a study in each of its winds.

    Parameters
    ----------
    on_progress : callable
        Gets a line after each agent.
    folder : path, optional
        Keeps each run as soon as it is done, a folder an agent as of `wt_gym.experiment.evaluation.evaluate`; what was
        stopped resumes with the runs that are there.
    overwrite : bool
        Repeat runs that are there.

    Returns
    -------
    list of dict
        A run each, JSON values: the agent, part and wind, how it ended, its return, and metrics in SI units.

    Raises
    ------
    ValueError
        If the folder holds runs of another study, or of other code.
    """
    rows = []
    for part in study.parts:
        for agent in study.agents:
            config = EvaluationConfig(
                study.env_id, part.arguments | study.arguments.get(agent, {}), part.winds, duration=study.duration,
                skip=study.skip, replay=0.0,
            )  # fmt: skip
            choice = str(TRAINED / agent.removeprefix(_TRAINED)) if agent.startswith(_TRAINED) else agent
            kept = None if folder is None else folder / _NOT_IN_NAMES.sub("_", f"{part.name} {agent}".strip())
            runs = evaluate({agent: choice}, config, folder=kept, overwrite=overwrite, progress=False).runs
            on_progress(f"{study.env_id}{part.name and ', ' + part.name}: {agent}")
            rows += [_kept(run, part, study) for run in runs]
    return rows


def _kept(run: Run, part: Part, study: Study) -> dict[str, Any]:
    """Plain data of a run."""
    values, keys = dict(run.metrics), [column.key for column in study.columns]
    if values and "yaw_error_rms" in keys:
        error = run.data["yaw_error"].values[run.data["time"].values > study.skip]
        values["yaw_error_rms"] = float(np.sqrt(np.mean(error**2)))
    return {
        "agent": run.agent,
        "part": part.name,
        "wind": run.wind.label,
        "speed": run.wind.speed,
        "ending": run.ending,
        "duration": round(run.duration, 3),
        "return": float(f"{run.episode_return:.6g}"),
        "metrics": {key: float(f"{values[key]:.6g}") for key in keys if key in values},
    }


def score_table(name: str, runs: Sequence[Mapping[str, Any]], short: bool = False) -> str:
    """Table of a study, Markdown.

    The return is that of an episode as long as those of the task, as the environment gives it: against the base
    controller with zero actions, the first agent, in the same wind. Of a run that lasted it is its share, of one that
    ended early all of it, against as much of the base controller's as its time.

    Parameters
    ----------
    name : str
        Of `STUDIES`.
    runs : sequence of mapping
        As `measure` gives them.
    short : bool
        For a page: at most six columns, and eight rows.
    """
    study, by_agent = STUDIES[name], {}
    columns = [column for column in study.columns if column.key in _SHORT][:4] if short else study.columns
    agents = [agent for agent in study.agents if not short or len(study.agents) <= _ROWS or agent != RANDOM]
    for run in runs:
        by_agent.setdefault(run["agent"], {})[run["part"], run["wind"]] = run
    base = by_agent[study.agents[0]]
    lasting = TASKS[study.task].episode / study.duration

    def row(agent: str) -> list[str]:
        own, first = by_agent.get(agent, {}), agent == study.agents[0]
        returns = [
            (run["return"] - base[wind]["return"] * run["duration"] / base[wind]["duration"])
            * (lasting if run["ending"] == "time" else 1.0)
            for wind, run in own.items()
        ]
        cells = [_cell(study, column, own, base, first) for column in columns]
        survived = [] if short else [f"{sum(run['ending'] == 'time' for run in own.values())} of {len(own)}"]
        return [agent_label(agent, first), *cells, signed(np.mean(returns), 1), *survived]

    headings = ("", *(column.heading for column in columns), "return", *([] if short else ["survived"]))
    return markdown(headings, [row(agent) for agent in agents])


def _cell(study: Study, column: Column, own: Mapping[Any, Any], base: Mapping[Any, Any], first: bool) -> str:
    """A figure over the winds that both agents came through; that of the first in its unit, of the others a change."""
    winds = [wind for wind in base if all(runs[wind]["ending"] == "time" for runs in (own, base))]
    if not winds or (column.how == "life" and len(winds) < len(base)):
        return _DASH
    mine, theirs = (np.array([runs[wind]["metrics"][column.key] for wind in winds]) for runs in (own, base))
    if column.how in ("life", "climate"):
        weights = _weights(study, [base[wind]["speed"] for wind in winds])
        exponent = LIFETIME_EXPONENTS[column.key] if column.how == "life" else 1.0
        mine, theirs = (np.atleast_1d(lifetime_load(x, weights / weights.sum(), exponent)) for x in (mine, theirs))
    if first or column.how in ("level", "most"):
        return _level(column, mine)
    if column.how == "change":
        return format_estimate(column.key, mean_change(mine, theirs))
    return percent(relative_change(mine.sum(), theirs.sum()), 2 if column.how in ("total", "climate") else 1)


def mean_change(values: np.ndarray, baseline: np.ndarray) -> Estimate:
    """Mean relative change over winds of all speeds, of which there are too few for an interval by speed."""
    changes = relative_change(values, baseline)
    return estimate([0.0] * len(changes), lambda k: changes[k].mean(axis=-1), True)


def _weights(study: Study, speeds: list[float]) -> np.ndarray:
    """Share of the time of each wind in the climate of the task's turbine; the winds of a speed share its weight."""
    turbine = load_turbine(TASKS[study.task].arguments["turbine"])
    single = sorted(set(speeds))
    # winds beyond cut-out stand for those of a storm, each for its own bin
    storm = single[-1] > turbine.cut_out
    first, last = (single[0] - 1.0, single[-1] + 1.0) if storm else (turbine.cut_in, turbine.cut_out)
    climate = WindClimate.of_class(turbine.iec_class, cut_in=first, cut_out=last)
    shares = dict(zip(single, wind_weights(climate, single), strict=True))
    return np.array([shares[speed] / speeds.count(speed) for speed in speeds])


def _level(column: Column, values: np.ndarray) -> str:
    """A figure in its unit: the mean, or the largest."""
    value = values.max() if column.how == "most" else values.mean()
    if column.key == "yaw_error_rms":
        return f"{math.degrees(value):.1f}°"
    metric = METRICS[column.key]
    unit = "°" if metric.unit == "deg" else f" {metric.unit}"
    return f"{signed(value * metric.factor, metric.digits, plus=False)}{unit}"


def kinds_table(name: str, key: str, runs: Sequence[Mapping[str, Any]]) -> str:
    """The largest of a metric in each part of a study, Markdown; how many runs ended early, where some did."""
    study, metric = STUDIES[name], METRICS[key]

    def cell(part: Part, agent: str) -> str:
        own = [run for run in runs if (run["part"], run["agent"]) == (part.name, agent)]
        ended = sum(run["ending"] != "time" for run in own)
        largest = max(run["metrics"].get(key, -math.inf) for run in own) * metric.factor
        return f"{largest:.{metric.digits}f}" + (f" ({ended} of {len(own)} ended)" if ended else "")

    headings = (f"{metric.label.lower()} [{metric.unit}]", *(agent_label(agent) for agent in study.agents))
    return markdown(headings, [[part.name, *(cell(part, agent) for agent in study.agents)] for part in study.parts])


def run(names: list[str], folder: Path, overwrite: bool) -> None:
    """Measure tasks and keep the figures of each as soon as it is done."""
    commit, started = source_commit(RECORD), time.process_time()

    def on_progress(text: str) -> None:
        print(f"{time.process_time() - started:6.0f} s  {text}", flush=True)

    for name in names:
        begun, runs = time.process_time(), measure(STUDIES[name], on_progress, folder / name, overwrite)
        made = {
            "date": datetime.now(UTC).strftime("%Y-%m-%d"), "version": wt_gym.__version__, "commit": commit,
            "processor_time_s": round(time.process_time() - begun), "env_id": STUDIES[name].env_id, "runs": runs,
        }  # fmt: skip
        record = read_json(RECORD) | {name: made}
        write_entries(RECORD, {key: record[key] for key in STUDIES if key in record}, with_runs)


def tables(text: str, record: dict) -> str:
    """A page with its tables as the record has them."""

    def scores(name: str) -> str:
        study = record[name]
        survived = sum(run["ending"] == "time" for run in study["runs"])
        return (
            f"Measured in `{study['env_id']}`; the return of an episode is against the first row in the same wind. "
            f"{survived} of {len(study['runs'])} runs survive.\n\n{score_table(name, study['runs'], short=True)}"
        )

    return filled(text, {"scores": scores})


def main() -> int:
    """Show, measure, or renew the pages."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("command", nargs="?", choices=("show", "run", "pages"), default="show")
    parser.add_argument("names", nargs="*", metavar="TABLE", help=f"which (default: all): {', '.join(STUDIES)}")
    parser.add_argument("--out", type=Path, default=ROOT / "runs" / "task_scores", help="folder of the runs")
    parser.add_argument("--overwrite", action="store_true", help="repeat runs that are there")
    arguments = parser.parse_args()
    if unknown := [name for name in arguments.names if name not in STUDIES]:
        parser.error(f"unknown table {', '.join(unknown)}; known: {', '.join(STUDIES)}")
    names = arguments.names or list(STUDIES)
    if arguments.command == "run":
        with user_errors(), stoppable(f"the same command resumes with the runs in {arguments.out}"):
            run(names, arguments.out, arguments.overwrite)
    record = read_json(RECORD)
    if arguments.command == "pages":
        for page in sorted(TASK_PAGES.glob("*.md")):
            if page.stem != "index":
                write_text_whole(page, tables(page.read_text(encoding="utf-8"), record))
        return 0
    for name in (name for name in names if name in record):
        print(f"\n{name}: {record[name]['env_id']}, {record[name]['date']}\n{score_table(name, record[name]['runs'])}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
