"""Who does the jobs of a sweep: this process, several of this machine, or those of a Ray cluster.

A job is a run that depends on nothing but what it is given, so it can be done anywhere, and again. An executor gives
each job with its result as soon as that is done, in whatever order; the caller, who alone writes files, keeps it. Who
is stopped keeps what was done, and skips it the next time.

The numbers are the same with every executor, bit for bit, on processors of one kind.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Protocol

from wt_gym.agents.workers import Tally, check_workers, in_processes

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

__all__ = ["ENGINES", "Executor", "ProcessExecutor", "SerialExecutor", "executor_for"]

ENGINES = ("local", "ray")
"""Where jobs are done."""


class Executor(Protocol):
    """Does jobs; a context that holds what that needs.

    Attributes
    ----------
    beside : bool
        Whether jobs are done in other processes: what they need is then made there.
    tally : Tally
        What became of the jobs so far.
    """

    beside: bool
    tally: Tally

    def results(
        self,
        work: Callable[[Any], Any],
        jobs: Sequence[Any],
        *,
        begin: Callable[..., None] | None = None,
        given: tuple = (),
        warm: Callable[[], None] | None = None,
    ) -> Iterator[tuple[Any, Any]]:
        """Do jobs; give each with its result as soon as it is done.

        An error that a job raises ends all. Where the process or the machine of a job is gone, the job is begun again,
        `wt_gym.agents.workers.ATTEMPTS` times at most, and counted.

        Parameters
        ----------
        work : callable
            Takes a job and gives its result; a function of a module, as are the others.
        jobs : sequence
            The longest first, so that none is left alone in the end.
        begin : callable, optional
            Called with what is ``given`` in each process before its first job.
        given : tuple
        warm : callable, optional
            Called once on each machine before the first job, to have its kernels in the cache.

        Raises
        ------
        ChildProcessError
            In the end, if jobs were lost.
        """

    def __enter__(self) -> Executor:
        """Make ready."""

    def __exit__(self, *exception) -> None:
        """Leave what was begun."""


class SerialExecutor:
    """Jobs one after another, in this process."""

    beside = False

    def __init__(self):
        self.tally = Tally()

    def results(self, work, jobs, *, begin=None, given=(), warm=None) -> Iterator[tuple[Any, Any]]:
        """As `Executor.results`."""
        if jobs and begin is not None:
            begin(*given)
        for job in jobs:
            result = work(job)
            self.tally.done += 1
            yield job, result

    def __enter__(self) -> SerialExecutor:
        return self

    def __exit__(self, *exception) -> None:
        pass


class ProcessExecutor:
    """Jobs beside each other, in processes of this machine.

    Parameters
    ----------
    workers : int

    Raises
    ------
    ValueError
        If there is no worker.
    """

    beside = True

    def __init__(self, workers: int):
        check_workers(workers)
        self.workers, self.tally = workers, Tally()

    def results(self, work, jobs, *, begin=None, given=(), warm=None) -> Iterator[tuple[Any, Any]]:
        """As `Executor.results`."""
        if jobs and warm is not None:
            warm()
        return in_processes(work, jobs, min(self.workers, max(len(jobs), 1)), begin, given, self.tally)

    def __enter__(self) -> ProcessExecutor:
        return self

    def __exit__(self, *exception) -> None:
        pass


def executor_for(engine: str = "local", workers: int | None = None, address: str | None = None) -> Executor:
    """Executor as a command line asks for it.

    Parameters
    ----------
    engine : {"local", "ray"}
    workers : int, optional
        Jobs at a time; default: one, and with Ray as many as the cluster has processors.
    address : str, optional
        Of a Ray cluster, as "auto" or "ray-head:6379"; default: that of the environment variable ``RAY_ADDRESS``, else
        a Ray of this machine alone begins and ends with the executor.

    Returns
    -------
    Executor

    Raises
    ------
    ValueError
        If there is no such engine, no worker, or an address for another engine than Ray.
    """
    if engine not in ENGINES:
        raise ValueError(f"the engine must be one of {', '.join(ENGINES)}, got {engine!r}")
    if workers is not None:
        check_workers(workers)
    if engine == "ray":
        from wt_gym.agents.distributed.ray_executor import RayExecutor  # in the extra "ray"

        return RayExecutor(address, workers)
    if address is not None:
        raise ValueError(
            f"the engine must be ray where an address (of a Ray cluster) is given, got {address!r} without"
        )
    return SerialExecutor() if workers in (None, 1) else ProcessExecutor(workers)
