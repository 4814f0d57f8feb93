"""Jobs of a sweep as tasks of a Ray cluster."""

from __future__ import annotations

from collections import deque
from contextlib import ExitStack
from typing import TYPE_CHECKING, Any

import ray
from ray.exceptions import (
    LocalRayletDiedError,
    NodeDiedError,
    ObjectLostError,
    OutOfMemoryError,
    RayTaskError,
    WorkerCrashedError,
)

from wt_gym.runs.ray_cluster import connected, processors, warm_nodes
from wt_gym.runs.tally import Tally

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

__all__ = ["RayExecutor"]

# The process or the machine of a task, or of its result, is gone. Whatever else a task raises is the work's own error.
_GONE = (LocalRayletDiedError, NodeDiedError, ObjectLostError, OutOfMemoryError, WorkerCrashedError)


class RayExecutor:
    """Jobs as tasks of a Ray cluster, a processor each; see `wt_gym.runs.executors.Executor`.

    Ray's own retries are off: what is begun again is counted here. Results come back to this process, which alone
    writes them: the machines need no common file system, but trained models must lie at the same path on all of them.

    Parameters
    ----------
    address : str, optional
        As of `wt_gym.runs.executors.executor_for`.
    workers : int, optional
        Jobs at a time; default: as many as the cluster has processors, also while machines come and go.
    """

    beside = True

    def __init__(self, address: str | None = None, workers: int | None = None):
        self._address, self._workers, self.tally = address, workers, Tally()
        self._stack = ExitStack()

    def __enter__(self) -> RayExecutor:
        self._stack.enter_context(connected(self._address, self._workers))
        return self

    def __exit__(self, *exception: object) -> None:
        self._stack.close()

    def results(
        self,
        work: Callable[[Any], Any],
        jobs: Sequence[Any],
        *,
        begin: Callable[..., None] | None = None,
        given: tuple[Any, ...] = (),
        warm: Callable[[], None] | None = None,
    ) -> Iterator[tuple[Any, Any]]:
        """As `wt_gym.runs.executors.Executor.results`."""
        if not jobs:
            return
        if warm is not None:
            warm_nodes(warm)
        ready = ray.put((begin, given))  # once to each machine, whatever the number of jobs
        left = deque((job, 1) for job in jobs)
        running: dict[ray.ObjectRef, tuple[Any, int]] = {}
        try:
            while left or running:
                # a few more than there are processors, so that none waits for this process; results never pile up
                most = self._workers or processors() + 2
                while left and len(running) < most:
                    job, attempt = left.popleft()
                    running[_do.remote(work, job, ready, ready.hex())] = job, attempt
                for task in ray.wait(list(running))[0]:
                    job, attempt = running.pop(task)
                    try:
                        result = ray.get(task)
                    except _GONE:
                        if self.tally.may_retry(job, attempt):
                            left.append((job, attempt + 1))
                        continue
                    except RayTaskError as error:
                        raise error.cause from None  # what the work has raised, as it would have here
                    self.tally.done += 1
                    yield job, result
        finally:
            for task in running:
                ray.cancel(task, force=True)
        self.tally.raise_lost()


_begun: str | None = None
"""Sweep that this worker process has begun: Ray keeps processes for the next tasks."""


@ray.remote(num_cpus=1, max_retries=0)  # type: ignore[untyped-decorator, unused-ignore]  # typed if Ray is installed
def _do(
    work: Callable[[Any], Any], job: Any, ready: tuple[Callable[..., None] | None, tuple[Any, ...]], sweep: str
) -> Any:
    """Do a job in a worker process of the cluster."""
    global _begun
    begin, given = ready
    if begin is not None and _begun != sweep:
        begin(*given)
        _begun = sweep
    return work(job)
