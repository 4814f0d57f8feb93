"""Jobs in several processes beside each other."""

from __future__ import annotations

import multiprocessing
import multiprocessing.connection
import os
import signal
import threading
from collections import deque
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, Future, ProcessPoolExecutor, wait
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from multiprocessing.process import BaseProcess
from typing import TYPE_CHECKING, Any, cast

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator

__all__ = ["ATTEMPTS", "ONE_THREAD", "Tally", "check_workers", "in_processes"]

ATTEMPTS = 3
"""Times that a job is begun whose process ends each time."""
ONE_THREAD = {"OMP_NUM_THREADS": "1", "NUMBA_NUM_THREADS": "1"}
"""Environment of a process that computes in one thread; read when it imports numpy and numba."""


def check_workers(workers: int) -> None:
    """Refuse a number of processes that can do nothing.

    Raises
    ------
    ValueError
    """
    if workers < 1:
        raise ValueError(f"at least 1 job must run at a time, got {workers}")


@dataclass
class Tally:
    """What became of the jobs of a sweep.

    A job whose simulation diverged is done: that is its result. What counts here is what happens to processes and
    machines.

    Attributes
    ----------
    done : int
        Jobs with a result.
    retried : int
        Times that a job was begun anew because the process or the machine that did it was gone.
    lost : list
        Jobs given up after `ATTEMPTS` of these.
    """

    done: int = 0
    retried: int = 0
    lost: list[Any] = field(default_factory=list)

    def may_retry(self, job: Any, attempt: int) -> bool:
        """Whether a job whose process is gone is to be begun once more; counts it."""
        if attempt < ATTEMPTS:
            self.retried += 1
            return True
        self.lost.append(job)
        return False

    def raise_lost(self) -> None:
        """Say that jobs were lost.

        Raises
        ------
        ChildProcessError
            If there are any.
        """
        if self.lost:
            raise ChildProcessError(
                f"{len(self.lost)} of {self.done + len(self.lost)} jobs were lost: {ATTEMPTS} times the process that "
                "did them has ended; was there too little memory for so many at a time? what was done is kept"
            )


def in_processes(
    work: Callable[[Any], Any],
    jobs: Iterable[Any],
    workers: int,
    begin: Callable[..., None] | None = None,
    given: tuple = (),
    tally: Tally | None = None,
) -> Iterator[tuple[Any, Any]]:
    """Do jobs in processes; give each with its result as soon as it is done, in whatever order that is.

    Kernels should be in the cache before (`wt_gym.agents.compilation`). Where a job raises an error, or the caller goes
    no further, jobs under way are ended and no other begins. Where a process ends that was not told to (it was killed,
    or memory ran out), its job is begun again in a new one, `ATTEMPTS` times at most; the others go on.

    Parameters
    ----------
    work : callable
        Takes a job; a function of a module.
    jobs : iterable
    workers : int
        Processes.
    begin : callable, optional
        Called with what is ``given`` in each process before its first job.
    tally : Tally, optional
        Counts.

    Raises
    ------
    ChildProcessError
        In the end, if jobs were lost.
    """
    spawn = multiprocessing.get_context("spawn")  # compiled kernels do not survive a fork
    reader, writer = spawn.Pipe(duplex=False)
    tally = Tally() if tally is None else tally
    left, again = iter(jobs), deque[tuple[Any, int]]()
    running: dict[Future, tuple[ProcessPoolExecutor, Any, int]] = {}

    def pool() -> ProcessPoolExecutor:
        """Give a pool of one process: where that ends, no other job is lost."""
        return pools.enter_context(ProcessPoolExecutor(1, spawn, _begin, (reader,)))

    with ExitStack() as pools:
        pools.callback(reader.close)
        pools.callback(writer.close)
        pools.enter_context(_one_thread())
        free = [pool() for _ in range(workers)]
        try:
            while True:
                while free and (work_left := again.popleft() if again else _first(left)) is not None:
                    job, attempt = work_left
                    try:
                        future = free[-1].submit(_work, work, job, begin, given)
                    except BrokenExecutor:  # ended while it had nothing to do
                        free[-1] = pool()
                        future = free[-1].submit(_work, work, job, begin, given)
                    running[future] = free.pop(), job, attempt
                if not running:
                    break
                for future in wait(running, return_when=FIRST_COMPLETED).done:
                    its_pool, job, attempt = running.pop(future)
                    try:
                        result = future.result()
                    except BrokenExecutor:
                        free.append(pool())
                        if tally.may_retry(job, attempt):
                            again.append((job, attempt + 1))
                        continue
                    free.append(its_pool)
                    tally.done += 1
                    yield job, result
        except BaseException:
            writer.close()  # ends the processes
            raise
    tally.raise_lost()


def _first(jobs: Iterator[Any]) -> tuple[Any, int] | None:
    """Give the next job with the number of its attempt, None where there is none."""
    return next(((job, 1) for job in jobs), None)


_begun = False
"""Whether this worker process has begun."""


def _work(work: Callable[[Any], Any], job: Any, begin: Callable[..., None] | None, given: tuple) -> Any:
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
