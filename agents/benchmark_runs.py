"""Runs of the benchmark, several beside each other, each kept as soon as it is done."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from wt_gym.agents.compilation import compile_kernels
from wt_gym.agents.progress import ProgressLine
from wt_gym.agents.workers import check_workers, in_processes
from wt_gym.benchmark import ResultFolder, play, run_definition
from wt_gym.benchmark.run import make_env

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from wt_gym.agents.entries import Entry
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


def run_jobs(jobs: Sequence[Job], folder: ResultFolder, workers: int = 1, progress: bool = True) -> int:
    """Make the runs that the folder does not hold yet.

    Parameters
    ----------
    jobs : sequence of Job
    folder : ResultFolder
    workers : int
        Processes; kernels are compiled before they start.
    progress : bool
        Show progress on standard error.

    Returns
    -------
    int
        Number of runs made.

    Raises
    ------
    ValueError
        If there is no worker.
    """
    check_workers(workers)
    left = [job for job in jobs if not folder.has(definition_of(job))]
    line, done = ProgressLine(progress), len(jobs) - len(left)

    def finished(job: Job, result: dict[str, Any]) -> None:
        nonlocal done
        done += 1
        folder.write(result)
        ended = "" if result["ending"] == "time" else f", ended after {result['duration']:g} s: {result['ending']}"
        line.show(f"{done} of {len(jobs)}: {job.label} in {result['wall_seconds']:g} s{ended}", final=True)

    if workers == 1 or len(left) < 2:
        for job in left:
            finished(job, _run(job, lambda t, job=job: line.show(f"{done} of {len(jobs)}: {job.label}, {t:.0f} s")))
        return len(left)
    first = left[0]
    compile_kernels(make_env(first.task, first.wind, first.entry.interface))
    for job, result in in_processes(_run, left, workers):
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
