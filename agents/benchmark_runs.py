"""Runs of the benchmark, several beside each other, each kept as soon as it is done."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

from wt_gym.agents.compilation import compile_kernels
from wt_gym.agents.executors import SerialExecutor
from wt_gym.agents.progress import ProgressLine
from wt_gym.agents.sweep_record import sweep_recorded
from wt_gym.benchmark import ResultFolder, play, run_definition
from wt_gym.benchmark.run import make_env

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from wt_gym.agents.entries import Entry
    from wt_gym.agents.executors import Executor
    from wt_gym.benchmark import BenchmarkTask, BenchmarkWind

__all__ = ["Job", "definition_of", "jobs_of", "results_of", "run_jobs"]


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


def _run(job: Job, on_step=None) -> dict[str, Any]:
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
        Of `wt_gym.agents.executors`, entered: does the runs, by default one after another.
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
    left = [job for job in jobs if not folder.has(definition_of(job))]
    line, done = ProgressLine(progress), len(jobs) - len(left)

    def finished(job: Job, result: dict[str, Any]) -> None:
        nonlocal done
        done += 1
        folder.write(result)
        ended = "" if result["ending"] == "time" else f", ended after {result['duration']:g} s: {result['ending']}"
        line.show(f"{done} of {len(jobs)}: {job.label} in {result['wall_seconds']:g} s{ended}", final=True)

    def run_here(job: Job) -> dict[str, Any]:
        return _run(job, lambda t: line.show(f"{done} of {len(jobs)}: {job.label}, {t:.0f} s"))

    work = _run if executor.beside else run_here
    warm = partial(_warm, left[0]) if left else None
    with sweep_recorded(folder.path, executor.tally, len(jobs) - len(left), lambda job: job.label):
        for job, result in executor.results(work, left, warm=warm):
            finished(job, result)
    return len(left)


def results_of(task: BenchmarkTask, entry: Entry, folder: ResultFolder) -> dict[str, dict[str, Any]]:
    """Results of an entry in a task by the label of the wind.

    Raises
    ------
    FileNotFoundError
        If one was not made.
    """
    return {wind.label: folder.read(definition_of(Job(task, wind, entry))) for wind in task.winds}
