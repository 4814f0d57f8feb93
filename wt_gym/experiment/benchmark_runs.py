"""Runs of the benchmark: agents in the environments they want, several beside each other, each kept when it is done."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import partial
from typing import TYPE_CHECKING, Any, cast

from wt_gym.benchmark import INTERFACE, ResultFolder, play, run_definition
from wt_gym.benchmark.run import make_env
from wt_gym.envs.layout import layout_of
from wt_gym.experiment.compilation import compile_kernels
from wt_gym.experiment.constant import ConstantAgent
from wt_gym.experiment.names import (
    GROUPS,
    RESIDUAL_INTERFACE,
    default_name,
    each_named,
    env_choices_of,
    fingerprint,
    is_base_controller,
    read_name,
    split_name,
)
from wt_gym.experiment.planning import check_settings
from wt_gym.experiment.pool import load_agent, load_model
from wt_gym.experiment.trained_environment import environment_of_training
from wt_gym.runs.executors import SerialExecutor
from wt_gym.runs.progress import ProgressLine
from wt_gym.runs.table import make_runs

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Sequence

    import gymnasium as gym

    from wt_gym.benchmark import BenchmarkTask, BenchmarkWind
    from wt_gym.control.controllers import Name
    from wt_gym.envs.episode import Agent
    from wt_gym.experiment.trained_agent import TrainedAgent
    from wt_gym.runs.executors import Executor

__all__ = ["Entry", "Job", "definition_of", "entries_of", "entry_of", "jobs_of", "results_of", "run_jobs"]


@dataclass(frozen=True)
class Entry:
    """An agent with the environment it requires.

    Attributes
    ----------
    name : str
        Shown in tables.
    choice : str
        From which the agent is made: "zero", "random", "planner", a controller, or the path of a trained model.
    definition : dict
        JSON values that tell it from every other agent.
    interface : dict
        Arguments of the environment, see `wt_gym.benchmark.INTERFACE`.
    """

    name: str
    choice: str
    definition: dict[str, Any]
    interface: dict[str, Any] = field(default_factory=dict)

    def make(self, env: gym.Env) -> Agent:
        """Make the agent for an environment; it has stable-baselines3's ``predict``."""
        layout = layout_of(env)
        if self.definition["kind"] == "controller":  # the base controller, which the environment runs
            return ConstantAgent(layout)
        agent = load_agent(self.choice, layout, env)
        if self.definition["kind"] == "trained":
            cast("TrainedAgent", agent).enter(layout)
        return agent


def entry_of(text: str) -> Entry:
    """Entry of one word, path or ``NAME=CHOICE``.

    Parameters
    ----------
    text : str
        "zero" (zero actions on the baseline controller), "random" (even draws), "planner", with parameters as
        ``planner:horizon=2.0``, a controller (`wt_gym.control.controllers.CONTROLLERS`, joined with "+"), with
        parameters as ``constrained_ipc:level=0.1``, or the path of a trained model or its folder.

    Raises
    ------
    ValueError
        If it is none of them, or a setting of a planner is out of range.
    """
    label, choice = split_name(text)
    name = read_name(choice)
    return _entry(label or default_name(name), name)


def _entry(label: str, name: Name) -> Entry:
    """Entry of a name."""
    text = name.text
    if name.kind == "word" and name.target == "planner":
        check_settings(name.parameters)
        return Entry(label, text, {"kind": "planner", "parameters": name.parameters})
    if name.kind == "word":
        return Entry(label, text, {"kind": name.target})
    if name.kind == "trained":
        return _trained(label, name)
    if name.kind == "class":
        known = fingerprint(text)
        source = {"class": known["class"], "parameters": name.parameters, "sha256": [*known["sha256"].values()]}
        if not is_base_controller(text):
            return Entry(label, text, {"kind": "class", **source}, env_choices_of(text))
        residual = {**RESIDUAL_INTERFACE, "controller": [name.target, name.parameters]}
        return Entry(label, text, {"kind": "controller", **source}, residual)
    definition: dict[str, Any] = {"kind": "controller", "controller": name.target, "parameters": name.parameters}
    if files := fingerprint(text).get("sha256"):  # a library of others, with its input files
        definition["sha256"] = [*files.values()]
    return Entry(label, text, definition, {**RESIDUAL_INTERFACE, "controller": [name.target, name.parameters]})


def entries_of(texts: Iterable[str]) -> list[Entry]:
    """Entries of a command line, each once; the folder of a training with several seeds is one a seed.

    Raises
    ------
    ValueError
        If one is not an agent, or two different ones have the same name.
    """
    entries: dict[str, Entry] = {}
    for label, text in each_named(texts, groups=GROUPS):
        entry = _entry(label, read_name(text))
        if entries.setdefault(entry.name, entry) != entry:
            raise ValueError(f"two agents are called {entry.name!r}; give them names as NAME=CHOICE")
    return list(entries.values())


def _trained(label: str, name: Name) -> Entry:
    """Entry of a trained model, in the environment it was trained in, or in the one that it chooses."""
    from wt_gym.experiment.trained_agent import model_digests

    agent, chosen = load_model(name), env_choices_of(name.text)
    record = agent.record or {}
    algorithm = record.get("algorithm") or type(agent.model).__name__
    definition = {"kind": "trained", "algorithm": algorithm, "sha256": model_digests(name.target)}
    return Entry(label, name.text, definition, environment_of_training(record, INTERFACE) | chosen)


@dataclass(frozen=True)
class Job:
    """One agent in one wind of a task."""

    task: BenchmarkTask
    wind: BenchmarkWind
    entry: Entry

    @property
    def label(self) -> str:
        """Short name for progress."""
        return f"{self.entry.name} in {self.task.id}, {self.wind.label}"


def definition_of(job: Job) -> dict[str, Any]:
    """What decides on the numbers of a job."""
    return run_definition(job.task, job.wind, {"name": job.entry.name, **job.entry.definition}, job.entry.interface)


def jobs_of(tasks: Iterable[BenchmarkTask], entries: Sequence[Entry]) -> list[Job]:
    """Every entry in every wind of every task."""
    return [Job(task, wind, entry) for task in tasks for entry in entries for wind in task.winds]


def _run(job: Job, on_step: Callable[[float], None] | None = None) -> dict[str, Any]:
    """Make one run."""
    result = play(job.task, job.wind, job.entry.make, job.entry.interface, on_step)
    return {"definition": definition_of(job), "agent": job.entry.name, **result}


def _warm(job: Job) -> None:
    """Have the kernels of a job in the cache."""
    compile_kernels(make_env(job.task, job.wind, job.entry.interface))


def run_jobs(jobs: Sequence[Job], folder: ResultFolder, executor: Executor | None = None, progress: bool = True) -> int:
    """Make the runs that the folder does not hold yet.

    Parameters
    ----------
    jobs : sequence of Job
    folder : ResultFolder
    executor : Executor, optional
        Of `wt_gym.runs.executors`, entered: does the runs, by default one after another.
    progress : bool
        Show progress on standard error.

    Returns
    -------
    int
        Number of runs made.

    Raises
    ------
    ChildProcessError
        If runs were lost, because the processes or machines that did them ended again and again.
    """
    executor = SerialExecutor() if executor is None else executor
    line, count = ProgressLine(progress), {"runs": len(jobs), "there": 0, "made": 0}

    def begin(runs: int, there: int) -> None:
        count.update(runs=runs, there=there)

    def finished(job: Job, result: dict[str, Any], there: int) -> None:
        count.update(there=there, made=count["made"] + 1)
        ended = "" if result["ending"] == "time" else f", ended after {result['duration']:g} s: {result['ending']}"
        line.show(f"{there} of {count['runs']}: {job.label} in {result['wall_seconds']:g} s{ended}", final=True)

    def run_here(job: Job) -> dict[str, Any]:
        return _run(job, lambda t: line.show(f"{count['there']} of {count['runs']}: {job.label}, {t:.0f} s"))

    def work(left: Sequence[Job]) -> Iterator[tuple[Job, dict[str, Any]]]:
        warm = partial(_warm, left[0]) if left else None
        return executor.results(_run if executor.beside else run_here, left, warm=warm)

    make_runs(
        jobs, work, tally=executor.tally, store=folder, define=definition_of, label=lambda job: job.label, begin=begin,
        told=finished,
    )  # fmt: skip
    return count["made"]


def results_of(task: BenchmarkTask, entry: Entry, folder: ResultFolder) -> dict[str, dict[str, Any]]:
    """Results of an entry in a task by the label of the wind.

    Raises
    ------
    FileNotFoundError
        If one was not made.
    """
    return {wind.label: folder.read(definition_of(Job(task, wind, entry))) for wind in task.winds}
