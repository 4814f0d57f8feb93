"""Jobs in several processes beside each other."""

from __future__ import annotations

import multiprocessing
import multiprocessing.connection
import os
import threading
from concurrent.futures import ProcessPoolExecutor, as_completed
from contextlib import contextmanager
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
    further, those that have not begun are not done.

    Parameters
    ----------
    work : callable
        Takes a job; a function of a module.
    jobs : sequence
        Hashable.
    workers : int
        Processes.
    begin : callable, optional
        Called first in each process with what is ``given``.
    """
    spawn = multiprocessing.get_context("spawn")  # compiled kernels do not survive a fork
    with _one_thread(), ProcessPoolExecutor(min(workers, len(jobs)), spawn, _begin, (begin, given)) as pool:
        futures = {pool.submit(work, job): job for job in jobs}
        try:
            for future in as_completed(futures):
                yield futures[future], future.result()
        except BaseException:
            pool.shutdown(cancel_futures=True)
            raise


def _begin(begin: Callable[..., None] | None, given: tuple) -> None:
    """Begin as a worker process."""
    threading.Thread(target=_end_with_parent, daemon=True).start()
    if begin is not None:
        begin(*given)


def _end_with_parent() -> None:
    """End this process when the one that gives it work has gone, however that went: nobody would ever call it again."""
    multiprocessing.connection.wait([multiprocessing.parent_process().sentinel])
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
