"""Who does the jobs of a sweep: this process, several of this machine, or those of a Ray cluster.

A job is a run that depends on nothing but what it is given, so it can be done anywhere, and again. An executor gives
each job with its result as soon as that is done, in whatever order; the caller, who alone writes files, keeps it. Who
is stopped keeps what was done, and skips it the next time.

The numbers are the same with every executor, bit for bit, on processors of one kind.
"""

from __future__ import annotations

import multiprocessing
import multiprocessing.connection
import os
import signal
import threading
from collections import deque
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, Future, ProcessPoolExecutor, wait
from contextlib import ExitStack, contextmanager
from multiprocessing.process import BaseProcess
from typing import TYPE_CHECKING, Any, Protocol, cast

from wt_gym.runs.tally import ATTEMPTS, ONE_THREAD, Tally

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

__all__ = [
    "ATTEMPTS",
    "ENGINES",
    "ONE_THREAD",
    "Executor",
    "ProcessExecutor",
    "SerialExecutor",
    "Tally",
    "executor_for",
]

ENGINES = ("local", "ray")
"""Where jobs are done."""


def _check_workers(workers: int) -> None:
    """Refuse a number of processes that can do nothing.

    Raises
    ------
    ValueError
    """
    if workers < 1:
        raise ValueError(f"at least 1 job must run at a time, got {workers}")


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
        given: tuple[Any, ...] = (),
        warm: Callable[[], None] | None = None,
    ) -> Iterator[tuple[Any, Any]]:
        """Do jobs; give each with its result as soon as it is done.

        An error that a job raises ends all. Where the process or the machine of a job is gone, the job is begun again,
        `ATTEMPTS` times at most, and counted.

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

    def __exit__(self, *exception: object) -> None:
        """Leave what was begun."""


class SerialExecutor:
    """Jobs one after another, in this process."""

    beside = False

    def __init__(self) -> None:
        self.tally = Tally()

    def results(
        self,
        work: Callable[[Any], Any],
        jobs: Sequence[Any],
        *,
        begin: Callable[..., None] | None = None,
        given: tuple[Any, ...] = (),
        warm: Callable[[], None] | None = None,
    ) -> Iterator[tuple[Any, Any]]:
        """As `Executor.results`."""
        if jobs and begin is not None:
            begin(*given)
        for job in jobs:
            result = work(job)
            self.tally.done += 1
            yield job, result

    def __enter__(self) -> SerialExecutor:
        return self

    def __exit__(self, *exception: object) -> None:
        pass


class ProcessExecutor:
    """Jobs beside each other, in processes of this machine.

    Where a job raises an error, or the caller goes no further, jobs under way are ended and no other begins.

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
        _check_workers(workers)
        self.workers, self.tally = workers, Tally()

    def results(
        self,
        work: Callable[[Any], Any],
        jobs: Sequence[Any],
        *,
        begin: Callable[..., None] | None = None,
        given: tuple[Any, ...] = (),
        warm: Callable[[], None] | None = None,
    ) -> Iterator[tuple[Any, Any]]:
        """As `Executor.results`."""
        if not jobs:
            return
        if warm is not None:
            warm()
        spawn = multiprocessing.get_context("spawn")  # compiled kernels do not survive a fork
        reader, writer = spawn.Pipe(duplex=False)
        left = deque((job, 1) for job in jobs)
        running: dict[Future[Any], tuple[ProcessPoolExecutor, Any, int]] = {}

        def pool() -> ProcessPoolExecutor:
            """Give a pool of one process: where that ends, no other job is lost."""
            return pools.enter_context(ProcessPoolExecutor(1, spawn, _begin, (reader,)))

        with ExitStack() as pools:
            pools.callback(reader.close)
            pools.callback(writer.close)
            pools.enter_context(_one_thread())
            free = [pool() for _ in range(min(self.workers, len(jobs)))]
            try:
                while left or running:
                    while free and left:
                        job, attempt = left.popleft()
                        try:
                            future = free[-1].submit(_work, work, job, begin, given)
                        except BrokenExecutor:  # ended while it had nothing to do
                            free[-1] = pool()
                            future = free[-1].submit(_work, work, job, begin, given)
                        running[future] = free.pop(), job, attempt
                    for future in wait(running, return_when=FIRST_COMPLETED).done:
                        its_pool, job, attempt = running.pop(future)
                        try:
                            result = future.result()
                        except BrokenExecutor:
                            free.append(pool())
                            if self.tally.may_retry(job, attempt):
                                left.appendleft((job, attempt + 1))
                            continue
                        free.append(its_pool)
                        self.tally.done += 1
                        yield job, result
            except BaseException:
                writer.close()  # ends the processes
                raise
        self.tally.raise_lost()

    def __enter__(self) -> ProcessExecutor:
        return self

    def __exit__(self, *exception: object) -> None:
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
        _check_workers(workers)
    if engine == "ray":
        from wt_gym.runs.ray_executor import RayExecutor  # in the extra "ray"

        return RayExecutor(address, workers)
    if address is not None:
        raise ValueError(
            f"the engine must be ray where an address (of a Ray cluster) is given, got {address!r} without"
        )
    return SerialExecutor() if workers in (None, 1) else ProcessExecutor(workers)


_begun = False
"""Whether this worker process has begun."""


def _work(work: Callable[[Any], Any], job: Any, begin: Callable[..., None] | None, given: tuple[Any, ...]) -> Any:
    """Do a job in a worker process."""
    global _begun
    if not _begun and begin is not None:
        begin(*given)
    _begun = True
    return work(job)


def _begin(told: multiprocessing.connection.Connection) -> None:
    """Begin as a worker process."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C reaches all; the one that gives work decides
    threading.Thread(target=_end_when, args=(told,), daemon=True).start()


def _end_when(told: multiprocessing.connection.Connection) -> None:
    """End this process when it is told to, or the one that gives it work has gone, however that went."""
    multiprocessing.connection.wait([told, cast(BaseProcess, multiprocessing.parent_process()).sentinel])
    os._exit(1)


@contextmanager
def _one_thread() -> Iterator[None]:
    """Have processes that start meanwhile compute in one thread."""
    before = {name: os.environ.get(name) for name in ONE_THREAD}
    os.environ.update(ONE_THREAD)
    try:
        yield
    finally:
        for name, value in before.items():
            os.environ.pop(name) if value is None else os.environ.update({name: value})
