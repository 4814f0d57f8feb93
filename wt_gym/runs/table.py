"""A table of runs: those that are kept as they are, the others made and kept."""

from __future__ import annotations

from contextlib import nullcontext
from typing import TYPE_CHECKING, Any

from wt_gym.runs.definition import run_digest

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from wt_gym.runs.store import RunStore
    from wt_gym.runs.tally import Tally

__all__ = ["make_runs"]


def make_runs(
    jobs: Sequence[Any],
    work: Callable[[Sequence[Any]], Iterator[tuple[Any, Any]]],
    *,
    tally: Tally,
    store: RunStore | None = None,
    define: Callable[[Any], dict[str, Any]] | None = None,
    label: Callable[[Any], str] = str,
    begin: Callable[[int, int], None] | None = None,
    told: Callable[[Any, Any, int], None] | None = None,
) -> list[Any]:
    """Results of jobs, each kept as soon as it is there; jobs of the same definition are done once.

    Parameters
    ----------
    jobs : sequence
        Who runs where, in the words of the study.
    work : callable
        Does jobs: gives each, the object that it got, with its result, in whatever order (`Executor.results`).
    tally : Tally
        Of the executor.
    store : RunStore, optional
        Keeps results; what is there is not made again.
    define : callable, optional
        Gives the definition of a job; needed with a store.
    label : callable
        Gives the name of a job.
    begin : callable, optional
        Called before the first job with the number of different runs and of those that were there.
    told : callable, optional
        Called with job, result and number of runs that are there after each.

    Returns
    -------
    list
        Results in the order of the jobs.

    Raises
    ------
    ValueError
        If a file of a run is damaged, or was made by a version of the package with another behavior.
    ChildProcessError
        If runs were lost, because the processes or machines that did them ended again and again.
    """
    definitions = [define(job) if define else {"number": number} for number, job in enumerate(jobs)]
    keys = [run_digest(definition) for definition in definitions]
    single = dict(zip(reversed(keys), zip(reversed(jobs), reversed(definitions), strict=True), strict=True))
    required = {key: single[key] for key in dict.fromkeys(keys)}  # the first job of each definition
    results = {}
    if store is not None:
        for key, (_, definition) in required.items():
            if (found := store.find(definition)) is not None:
                results[key] = found
    left = {id(job): (key, definition) for key, (job, definition) in required.items() if key not in results}
    if begin is not None:
        begin(len(required), len(results))
    with store.session(tally, len(results), label) if store is not None else nullcontext():
        for job, result in work([job for key, (job, _) in required.items() if key not in results]):
            key, definition = left[id(job)]
            results[key] = result if store is None else store.keep(definition, result)
            if told is not None:
                told(job, results[key], len(results))
    return [results[key] for key in keys]
