"""Functions of earlier versions by what does their work today; `wt_gym.deprecated` leads their former names here."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from wt_gym.control.controllers.names import Name
from wt_gym.experiment.names import each_seed, read_name
from wt_gym.runs.executors import ProcessExecutor, Tally
from wt_gym.runs.store import RunStore

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterable, Iterator
    from contextlib import AbstractContextManager
    from pathlib import Path

__all__ = ["check_workers", "expand_seeds", "in_processes", "kind_of", "sweep_recorded"]


def check_workers(workers: int) -> None:
    """Refuse a number of processes below one, as `wt_gym.runs.executors.ProcessExecutor` does.

    Raises
    ------
    ValueError
    """
    ProcessExecutor(workers)


def in_processes(
    work: Callable[[Any], Any],
    jobs: Iterable[Any],
    workers: int,
    begin: Callable[..., None] | None = None,
    given: tuple[Any, ...] = (),
    tally: Tally | None = None,
) -> Iterator[tuple[Any, Any]]:
    """Do jobs by a `wt_gym.runs.executors.ProcessExecutor`; give each with its result as soon as it is done.

    Raises
    ------
    ValueError
        If there is no worker.
    ChildProcessError
        In the end, if jobs were lost.
    """
    executor = ProcessExecutor(workers)
    if tally is not None:
        executor.tally = tally
    return executor.results(work, list(jobs), begin=begin, given=given)


def sweep_recorded(
    folder: Path, tally: Tally, found: int, label: Callable[[Any], str] = str
) -> AbstractContextManager[None]:
    """Do jobs, and add a row to ``sweep.json``: `wt_gym.runs.RunStore.session` of a folder."""
    return RunStore(folder).session(tally, found, label)


def kind_of(choice: str, words: Collection[str], more: Collection[str] = ()) -> str:
    """What a choice is: "word" where it is one of ``words``, else the kind that `names.read_name` tells.

    Raises
    ------
    ValueError
        If it is none.
    """
    return "word" if choice in words else read_name(choice).kind


def expand_seeds(choice: str, kind: str) -> list[tuple[str, str]]:
    """Suffix and path of each seed of a training: `wt_gym.experiment.names.each_seed` of a path.

    Raises
    ------
    FileNotFoundError
        If no seed has been trained.
    ValueError
        If the plan of the training is damaged.
    """
    return each_seed(Name("trained", choice)) if kind == "trained" else [("", choice)]
