"""Jobs in several processes beside each other."""

from __future__ import annotations

import multiprocessing
import multiprocessing.connection
import os
import signal
import threading
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, ProcessPoolExecutor, wait
from contextlib import contextmanager
from itertools import islice
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

__all__ = ["check_workers", "in_processes"]

# Each process computes in one thread; read when a process imports numpy and numba.
_THREADS = ("OMP_NUM_THREADS", "NUMBA_NUM_THREADS")


def check_workers(workers: int) -> None:
    """Refuse a number of processes that can do nothing.

    Raises
    ------
    ValueError
    """
    if workers < 1:
        raise ValueError(f"at least 1 job must run at a time, got {workers}")


def in_processes(
    work: Callable[[Any], Any],
    jobs: Sequence[Any],
    workers: int,
    begin: Callable[..., None] | None = None,
    given: tuple = (),
) -> Iterator[tuple[Any, Any]]:
    """Do jobs in processes; give each with its result as soon as it is done, in whatever order that is.

    Kernels should be in the cache before (`wt_gym.agents.compilation`). Where a job fails, or the caller goes no
    further, jobs under way are ended and no other begins.

    Parameters
    ----------
    work : callable
        Takes a job; a function of a module.
    jobs : sequence
    workers : int
        Processes.
    begin : callable, optional
        Called first in each process with what is ``given``.

    Raises
    ------
    ChildProcessError
        If a process ends that was not told to.
    """
    spawn = multiprocessing.get_context("spawn")  # compiled kernels do not survive a fork
    reader, writer = spawn.Pipe(duplex=False)
    left, running = iter(jobs), {}
    try:
        with _one_thread(), ProcessPoolExecutor(workers, spawn, _begin, (reader, begin, given)) as pool:
            try:
                running = {pool.submit(work, job): job for job in islice(left, workers)}
                while running:
                    for future in wait(running, return_when=FIRST_COMPLETED).done:
                        job, result = running.pop(future), future.result()
                        running |= {pool.submit(work, job): job for job in islice(left, 1)}
                        yield job, result
            except BaseException:
                writer.close()  # ends the processes
                raise
    except BrokenExecutor as error:
        raise ChildProcessError(
            f"one of {workers} processes has ended; was there too little memory for so many? what was done is kept"
        ) from error
    finally:
        writer.close()
        reader.close()


def _begin(told: multiprocessing.connection.Connection, begin: Callable[..., None] | None, given: tuple) -> None:
    """Begin as a worker process."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C reaches all; the one that gives work decides
    threading.Thread(target=_end_when, args=(told,), daemon=True).start()
    if begin is not None:
        begin(*given)


def _end_when(told: multiprocessing.connection.Connection) -> None:
    """End this process when it is told to, or the one that gives it work has gone, however that went."""
    multiprocessing.connection.wait([told, multiprocessing.parent_process().sentinel])
    os._exit(1)


@contextmanager
def _one_thread() -> Iterator[None]:
    """Have processes that start meanwhile compute in one thread."""
    before = {name: os.environ.get(name) for name in _THREADS}
    os.environ.update(dict.fromkeys(_THREADS, "1"))
    try:
        yield
    finally:
        for name, value in before.items():
            os.environ.pop(name) if value is None else os.environ.update({name: value})
