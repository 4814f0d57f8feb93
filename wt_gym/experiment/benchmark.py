"""The benchmark: agents in frozen tasks, their runs, and their scores over the baseline.

A task (`load_task`) says where an agent runs; `play_task` makes one run of it; `score` compares the runs of an agent
with the reference numbers that stand in the task's file. docs/benchmark.md has the rules.
"""

from __future__ import annotations

import platform
import time
from dataclasses import asdict, dataclass, field
from functools import cache, partial
from typing import TYPE_CHECKING, Any, cast

import gymnasium as gym
import numpy as np

import wt_gym
from wt_gym.analysis.metrics import idle_time
from wt_gym.analysis.statistics import estimate, relative_change
from wt_gym.base.errors import BenchmarkError
from wt_gym.control.controllers import make_controller
from wt_gym.envs.layout import layout_of
from wt_gym.envs.turbine_env import turbine_env_of
from wt_gym.experiment.agents import ConstantAgent, PlannerOptions, load_agent, load_model
from wt_gym.experiment.benchmark_tasks import (
    BenchmarkTask,
    BenchmarkWind,
    Reference,
    ceiling_line,
    ceiling_of,
    load_task,
    reference_of,
    task_names,
)
from wt_gym.experiment.environments import compile_kernels, environment_of_training
from wt_gym.experiment.execute import Experiment, Progress, SerialExecutor
from wt_gym.experiment.names import (
    GROUPS,
    INTERFACE,
    RESIDUAL_INTERFACE,
    default_name,
    each_named,
    env_choices_of,
    fingerprint,
    is_base_controller,
    read_name,
    split_name,
)
from wt_gym.experiment.run import ENDLESS, EpisodePlayer, benchmark_fingerprint, benchmark_metrics
from wt_gym.experiment.store import RunStore, digest, run_definition, run_digest
from wt_gym.turbines import load_turbine

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
    from pathlib import Path

    from wt_gym.control.controllers import Name
    from wt_gym.envs.episode import Agent
    from wt_gym.experiment.execute import Executor
    from wt_gym.experiment.trained_agent import TrainedAgent

__all__ = [
    "INTERFACE", "BenchmarkAgent", "BenchmarkRun", "ResultFolder", "Score", "WindScore", "entries_of", "entry_of",
    "into_page", "jobs_of", "leaderboard", "make_env", "play_task", "run_jobs", "score", "task_fingerprint",
    "to_markdown", "wind_score",
]  # fmt: skip


def make_env(task: BenchmarkTask, wind: BenchmarkWind, interface: dict[str, Any] | None = None) -> gym.Env:
    """Environment of a task for a wind.

    Parameters
    ----------
    interface : dict, optional
        Arguments out of `INTERFACE`, as JSON values; ``controller`` with parameters as a list [name, parameters].

    Raises
    ------
    wt_gym.base.errors.BenchmarkError
        If the interface holds something else.
    """
    interface = dict(interface or {})
    foreign = [name for name in interface if name not in INTERFACE]
    if foreign:
        raise BenchmarkError(
            f"what an agent chooses of the environment must be among {', '.join(INTERFACE)}, got {', '.join(foreign)}"
        )
    if isinstance(interface.get("controller"), list):
        name, parameters = interface["controller"]
        interface["controller"] = partial(make_controller, name, **parameters)
    given = {**task.env_kwargs, **interface}
    given |= {"relative_reward": False, "reward_credit": False, "starts": None}  # compared with other runs
    if wind.transient is not None:
        given |= {"inflow": wind.inflow(_load_turbine(_argument(task, "turbine"))), "wind_speed": None}
    env = gym.make(task.env_id, **given, episode_length=task.duration, max_episode_steps=ENDLESS)
    turbine_env_of(env).outer_steps = ENDLESS
    return env


def play_task(
    task: BenchmarkTask,
    wind: BenchmarkWind,
    make_agent: Callable[[gym.Env], Any],
    interface: dict[str, Any] | None = None,
    progress: Progress | None = None,
) -> dict[str, Any]:
    """Run an agent once.

    Parameters
    ----------
    make_agent : callable
        Gets the environment and gives an object with stable-baselines3's ``predict``.
    interface : dict, optional
        See `make_env`.
    progress : Progress, optional
        Shows the simulated time.

    Returns
    -------
    dict
        ``metrics`` (empty if the run ended before its time), ``ending`` (``"time"`` or why it was terminated),
        ``failure``, ``duration`` [s], ``episode_return``, ``cost`` (sum), ``idle_time`` [s]
        (`wt_gym.envs.terminations.IdleClock.total`), ``made_with`` and ``wall_seconds``.
    """
    began = time.monotonic()
    options: dict[str, Any] = {"azimuth": 0.0}
    if wind.transient is None:
        options |= {"wind_speed": wind.speed, "wind_seed": wind.seed, "time_offset": 0.0}
    env = make_env(task, wind, interface)
    try:
        player = EpisodePlayer(env, make_agent(env), seed=wind.seed or 0, options=options)
        (progress or Progress()).follow(f"{task.id}, {wind.label}", task.duration, player)
        run, turbine = player.episode, turbine_env_of(env).turbine
        return {
            "metrics": benchmark_metrics(run.after_start, turbine, task.skip) if run.ending == "time" else {},
            "ending": run.ending,
            "failure": run.failure,
            "duration": run.time,
            "episode_return": run.episode_return,
            "cost": run.cost,
            "idle_time": idle_time(run.data),
            "made_with": {  # for the record: versions decide on no score
                "wt_gym": wt_gym.__version__, "python": platform.python_version(), "numpy": np.__version__,
                "gymnasium": gym.__version__, "machine": platform.machine(),
            },
            "wall_seconds": round(time.monotonic() - began, 1),
        }  # fmt: skip
    finally:
        env.close()


def _argument(task: BenchmarkTask, name: str) -> Any:
    """Argument that the environment of a task is made with."""
    return {**gym.spec(task.env_id).kwargs, **task.env_kwargs}[name]


_load_turbine = cache(load_turbine)


@cache
def _fingerprint(turbine: str, fidelity: str) -> dict[str, Any]:
    return benchmark_fingerprint(_load_turbine(turbine), fidelity)


def task_fingerprint(task: BenchmarkTask) -> dict[str, Any]:
    """Fingerprint of the turbine, the fidelity and the code of a task, see `benchmark_fingerprint`."""
    return _fingerprint(_argument(task, "turbine"), _argument(task, "fidelity"))


class ResultFolder(RunStore):
    """Folder with one JSON file a run, named by its task and its definition."""

    error = BenchmarkError
    required = frozenset({"definition", "agent", "metrics", "ending"})
    indent = 1

    def __init__(self, path: str | Path):
        super().__init__(path, "benchmark", folder="")

    def name(self, definition: dict[str, Any]) -> str:
        """Name of the file of a run."""
        return f"{definition.get('task')}-{run_digest(definition)}.json"

    def __iter__(self) -> Iterator[dict[str, Any]]:
        """All results by name of the file; a `BenchmarkError` if one is damaged, or is not what its name says."""
        for path in sorted(self.path.glob("*-*.json")):
            yield self._read(path)


# ---- agents and rows ----


@dataclass(frozen=True)
class BenchmarkAgent:
    """An agent with the environment it requires."""

    name: str  #: shown in tables
    choice: str
    """From which the agent is made: "zero", "random", "planner", a controller, or the path of a trained model."""
    definition: dict[str, Any]  #: JSON values that tell it from every other agent
    interface: dict[str, Any] = field(default_factory=dict)
    """Arguments of the environment, see `wt_gym.experiment.names.INTERFACE`."""

    def make(self, env: gym.Env) -> Agent:
        """Make the agent for an environment; it has stable-baselines3's ``predict``."""
        layout = layout_of(env)
        if self.definition["kind"] == "controller":  # the base controller, which the environment runs
            return ConstantAgent(layout)
        agent = load_agent(self.choice, layout, env)
        if self.definition["kind"] == "trained":
            cast("TrainedAgent", agent).enter(layout)
        return agent


def entry_of(text: str) -> BenchmarkAgent:
    """Agent of one word, path or ``NAME=CHOICE``, as of `wt_gym.experiment.names.read_name`.

    Raises a `ValueError` if it is no agent, or a setting of a planner is out of range.
    """
    label, choice = split_name(text)
    name = read_name(choice)
    return _entry(label or default_name(name), name)


def _entry(label: str, name: Name) -> BenchmarkAgent:
    """Agent of a name."""
    text = name.text
    if name.kind == "word" and name.target == "planner":
        PlannerOptions.from_dict(name.parameters)
        return BenchmarkAgent(label, text, {"kind": "planner", "parameters": name.parameters})
    if name.kind == "word":
        return BenchmarkAgent(label, text, {"kind": name.target})
    if name.kind == "trained":  # in the environment of its training, or in the one that it chooses
        from wt_gym.experiment.trained_agent import model_digests  # torch takes seconds to import

        agent, chosen = load_model(name), env_choices_of(text)
        record = agent.record or {}
        algorithm = record.get("algorithm") or type(agent.model).__name__
        definition = {"kind": "trained", "algorithm": algorithm, "sha256": model_digests(name.target)}
        return BenchmarkAgent(label, text, definition, environment_of_training(record, INTERFACE) | chosen)
    if name.kind == "class":
        known = fingerprint(text)
        source = {"class": known["class"], "parameters": name.parameters, "sha256": [*known["sha256"].values()]}
        if not is_base_controller(text):
            return BenchmarkAgent(label, text, {"kind": "class", **source}, env_choices_of(text))
        residual = {**RESIDUAL_INTERFACE, "controller": [name.target, name.parameters]}
        return BenchmarkAgent(label, text, {"kind": "controller", **source}, residual)
    definition = {"kind": "controller", "controller": name.target, "parameters": name.parameters}
    if files := fingerprint(text).get("sha256"):  # a library of others, with its input files
        definition["sha256"] = [*files.values()]
    return BenchmarkAgent(label, text, definition, {**RESIDUAL_INTERFACE, "controller": [name.target, name.parameters]})


def entries_of(texts: Iterable[str]) -> list[BenchmarkAgent]:
    """Entries of a command line, each once; the folder of a training with several seeds is one a seed.

    Raises a `ValueError` if one is not an agent, or two different ones have the same name.
    """
    entries: dict[str, BenchmarkAgent] = {}
    for label, text in each_named(texts, groups=GROUPS):
        entry = _entry(label, read_name(text))
        if entries.setdefault(entry.name, entry) != entry:
            raise ValueError(f"two agents are called {entry.name!r}; give them names as NAME=CHOICE")
    return list(entries.values())


@dataclass(frozen=True)
class BenchmarkRun:
    """One agent in one wind of a task."""

    task: BenchmarkTask
    wind: BenchmarkWind
    entry: BenchmarkAgent

    @property
    def label(self) -> str:
        """Short name for progress."""
        return f"{self.entry.name} in {self.task.id}, {self.wind.label}"

    @property
    def definition(self) -> dict[str, Any]:
        """Definition of the run as `wt_gym.experiment.store.run_definition`, with name and version of the task."""
        return run_definition(
            wind=self.wind.definition, duration=self.task.duration, skip=self.task.skip,
            fingerprint=task_fingerprint(self.task), agent={"name": self.entry.name, **self.entry.definition},
            env_id=self.task.env_id, env_kwargs=self.task.env_kwargs, interface=self.entry.interface,
            task=self.task.name, version=self.task.version,
        )  # fmt: skip


def jobs_of(tasks: Iterable[BenchmarkTask], entries: Sequence[BenchmarkAgent]) -> list[BenchmarkRun]:
    """Every entry in every wind of every task."""
    return [BenchmarkRun(task, wind, entry) for task in tasks for entry in entries for wind in task.winds]


class _BenchmarkRuns(Experiment):
    """Rows of the benchmark: `BenchmarkRun`."""

    def __init__(self, first: BenchmarkRun):
        self._first = first

    def definition(self, row: BenchmarkRun) -> dict[str, Any]:
        return row.definition

    def label(self, row: BenchmarkRun) -> str:
        return row.label

    def outcome(self, row: BenchmarkRun, result: dict[str, Any]) -> str:
        ended = "" if result["ending"] == "time" else f", ended after {result['duration']:g} s: {result['ending']}"
        return f" in {result['wall_seconds']:g} s{ended}"

    def warm(self) -> None:
        compile_kernels(make_env(self._first.task, self._first.wind, self._first.entry.interface))

    def __call__(self, row: BenchmarkRun) -> dict[str, Any]:
        result = play_task(row.task, row.wind, row.entry.make, row.entry.interface, self.progress)
        return {"definition": row.definition, "agent": row.entry.name, **result}


def run_jobs(
    jobs: Sequence[BenchmarkRun], folder: ResultFolder, executor: Executor | None = None, progress: bool = True
) -> int:
    """Make the runs that the folder does not hold yet; return their number.

    Executor, progress and errors are as of `wt_gym.experiment.evaluation.evaluate`.
    """
    executor = SerialExecutor() if executor is None else executor
    before = executor.tally.done
    if jobs:
        _BenchmarkRuns(jobs[0]).table(jobs, executor, folder, progress)
    return executor.tally.done - before


# ---- scores ----


@dataclass(frozen=True)
class WindScore:
    """Score of one run."""

    wind: str
    score: float
    improvement: float | None  #: none for a run that ended before its time
    broken: tuple[str, ...]  #: limits that were not kept, or how the run ended


@dataclass(frozen=True)
class Score:
    """Score of an agent in a task."""

    score: float  #: weighted mean over the winds
    low: float  #: lower end of the 95 % interval over the winds
    high: float  #: upper end
    better: float  #: share of the winds with a score above zero
    winds: tuple[WindScore, ...]


def wind_score(task: BenchmarkTask, wind: BenchmarkWind, result: Mapping[str, Any], reference: Reference) -> WindScore:
    """Score of the run in one wind: clipped, and the least one where the run ended early or a limit was not kept."""
    if result["ending"] != "time":
        return WindScore(wind.label, task.clip[0], None, (result["ending"],))
    metrics, baseline = result["metrics"], reference.baseline[wind.label]
    gained, broken = task.improvement(metrics, baseline), task.broken_limits(metrics, baseline)
    value = min(max(100.0 * gained / reference.best_improvement, task.clip[0]), task.clip[1])
    return WindScore(wind.label, task.clip[0] if broken else value, gained, broken)


def score(task: BenchmarkTask, results: Mapping[str, Mapping[str, Any]], reference: Reference | None = None) -> Score:
    """Score of an agent from its results by the label of the wind.

    Parameters
    ----------
    reference : Reference, optional
        By default that of the task.

    Raises
    ------
    wt_gym.base.errors.BenchmarkError
        If the task has no reference numbers, a wind is missing, or a result was made with another turbine, fidelity or
        physics than the reference.
    """
    reference = reference or reference_of(task)
    missing = [wind.label for wind in task.winds if wind.label not in results]
    if missing:
        raise BenchmarkError(f"task {task.name}: no result in {len(missing)} winds, the first is {missing[0]}")
    for wind in task.winds:
        reference.check(task, results[wind.label]["definition"])
    rows = tuple(wind_score(task, wind, results[wind.label], reference) for wind in task.winds)
    values, weights = np.array([row.score for row in rows]), np.array([wind.weight for wind in task.winds])
    strata = [wind.stratum for wind in task.winds]
    mean = estimate(strata, lambda k: np.average(values[k], axis=-1, weights=weights[k]), False, least=2)
    return Score(mean.value, mean.low, mean.high, float(np.mean(values > 0.0)), rows)


_SHOWN = {
    "captured_power": "power",
    "blade_flap_del": "flap DEL",
    "tower_fore_aft_del": "tower f-a DEL",
    "tower_side_side_del": "tower s-s DEL",
}
"""Metrics whose mean relative change against the baseline is shown."""
_SHOWN_WHERE_SCORED = {"tracking_rms": "tracking error"}
"""The same in tasks that score them."""


def leaderboard(results: Iterable[Mapping[str, Any]]) -> dict[str, Any]:
    """Scores of all agents in all tasks.

    Parameters
    ----------
    results : iterable of dict
        As `ResultFolder` gives them.

    Returns
    -------
    dict
        ``tasks``: name to a list of rows, the best first; a row has ``agent``, ``winds`` (runs made), ``score`` (as
        `Score`) or ``refused`` (why there is none), ``changes`` against the baseline and
        ``pitch_travel`` over that of the baseline. ``references``: name to the best known agent; ``ceilings``: name to
        ``improvement`` and ``score`` where the wind is known, and a ``line`` on both.
    """
    runs: dict[tuple[str, str], list[Mapping[str, Any]]] = {}
    for result in results:
        definition = result["definition"]
        entry = run_digest({key: value for key, value in definition.items() if key != "wind"})
        runs.setdefault((definition["task"], entry), []).append(result)
    unknown = sorted({name for name, _ in runs} - {*task_names()})
    if unknown:
        raise BenchmarkError(f"tasks of results must be among {', '.join(task_names())}, got {', '.join(unknown)}")
    tasks, references, ceilings = {}, {}, {}
    for name in sorted({name for name, _ in runs}):
        task = load_task(name)
        rows = [_row(task, own) for (of, _), own in runs.items() if of == name]
        tasks[name] = sorted(rows, key=lambda row: -row["score"]["score"] if row["score"] else np.inf)
        if task.reference is not None:
            references[name] = {key: task.reference[key] for key in ("best_agent", "best_improvement")}
        if (ceiling := ceiling_of(task)) is not None:
            ceilings[name] = {
                "improvement": ceiling.improvement, "score": ceiling.score, "line": ceiling_line(task, ceiling),
            }  # fmt: skip
    return {"tasks": tasks, "references": references, "ceilings": ceilings}


def _shown(task: BenchmarkTask) -> dict[str, str]:
    """Metrics whose change is shown, and how they are called."""
    scored = {term.metric for term in task.terms}
    return {key: label for key, label in _SHOWN_WHERE_SCORED.items() if key in scored} | _SHOWN


def _row(task: BenchmarkTask, results: list[Mapping[str, Any]]) -> dict[str, Any]:
    """One agent in one task."""
    labels = {digest(wind.definition): wind.label for wind in task.winds}
    labeled = [(labels.get(digest(result["definition"]["wind"])), result) for result in results]
    by_wind = {label: result for label, result in labeled if label is not None}
    row = {
        "agent": results[0]["agent"],
        "winds": f"{len(by_wind)} of {len(task.winds)}",
        "score": None,
        "refused": None,
    }
    try:
        reference = reference_of(task)
        row["score"] = asdict(score(task, by_wind, reference))
        row |= _changes(task, by_wind, reference)
    except BenchmarkError as error:
        row["refused"] = str(error)
    return row


def _changes(task: BenchmarkTask, by_wind: Mapping[str, Mapping[str, Any]], reference: Reference) -> dict[str, Any]:
    """Mean changes over the winds; none where a run ended early."""
    winds = [wind for wind in task.winds if by_wind[wind.label]["metrics"]]
    if len(winds) < len(task.winds):
        return {"changes": {}, "pitch_travel": None}
    weights = [wind.weight for wind in winds]

    def mean(metric: str) -> float:
        pairs = [(by_wind[w.label]["metrics"][metric], reference.baseline[w.label][metric]) for w in winds]
        return float(np.average([relative_change(*pair) for pair in pairs], weights=weights))

    still = any(reference.baseline[wind.label]["pitch_travel"] == 0.0 for wind in winds)
    changes = {metric: mean(metric) for metric in _shown(task)}
    return {"changes": changes, "pitch_travel": None if still else 1.0 + mean("pitch_travel")}


def to_markdown(board: Mapping[str, Any]) -> str:
    """Tables of a `leaderboard`, one a task."""
    from wt_gym.analysis.page import Row, markdown  # with plotly

    lines = []
    for name, rows in board["tasks"].items():
        task, best = load_task(name), board["references"].get(name)
        lines += [f"### {task.id}", ""]
        if best is not None:
            gained = f"{100 * best['best_improvement']:.2f} % over `{task.baseline}`"
            lines += [f"100 is `{best['best_agent']}`, an improvement of {gained}.", ""]
        if name in board["ceilings"]:
            lines += [board["ceilings"][name]["line"], ""]
        shown = _shown(task)
        head = ["agent", "score", "95 % interval", "better in", *shown.values(), "pitch travel", "penalties"]
        lines += markdown(head, [Row(row["agent"], _cells(row, shown)) for row in rows])
        lines += ["", *(f"- {row['agent']}: {row['refused']}" for row in rows if row["refused"])]
        lines += [""] * (lines[-1] != "")
    return "\n".join(lines).rstrip("\n") + "\n"


def into_page(table: str, page: str, part: str = "leaderboard") -> str:
    """Put a table between the lines ``<!-- part -->`` and ``<!-- end of the part -->`` that a page must have."""
    first, last = f"<!-- {part} -->", f"<!-- end of the {part} -->"
    before, begin, rest = page.partition(first)
    _, end, after = rest.partition(last)
    if not (begin and end):
        raise BenchmarkError(f"the page has no place for a table: it needs the lines {first} and {last}")
    return f"{before}{begin}\n\n{table}\n{end}{after}"


def _cells(row: Mapping[str, Any], shown: Collection[str]) -> list[str]:
    """Cells of a row, with the changes of some metrics."""
    if row["score"] is None:
        return ["–", "–", f"{row['winds']} winds run", *["–"] * len(shown), "–", "–"]
    found, changes = row["score"], row["changes"]
    broken = [reason for wind in found["winds"] for reason in wind["broken"]]
    penalties = ", ".join(f"{reason} × {broken.count(reason)}" for reason in dict.fromkeys(broken))
    travel = row["pitch_travel"]
    return [
        f"{found['score']:.1f}",
        f"{found['low']:.1f} … {found['high']:.1f}",
        f"{100 * found['better']:.0f} %",
        *(f"{100 * changes[metric]:+.1f} %" if changes and np.isfinite(changes[metric]) else "–" for metric in shown),
        "–" if travel is None else f"× {travel:.2f}",
        penalties or "none",
    ]
