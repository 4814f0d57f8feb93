"""Execution of an experiment: rows in, a table of results out.

An experiment is a list of rows (agent, plant, wind, duration, seed), each a run that depends on nothing else, so that
it can be played anywhere, and again. An executor plays rows in this process, in several processes of this machine, or
on a Ray cluster, and gives each row with its result as soon as that is there, in whatever order. This process alone
writes files: a stopped experiment has every finished run, and plays only the others the next time.

The numbers are the same with every executor, bit for bit, on processors of one kind.
"""

from __future__ import annotations

import multiprocessing
import multiprocessing.connection
import os
import signal
import sys
import threading
import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, Future, ProcessPoolExecutor, wait
from contextlib import ExitStack, nullcontext
from dataclasses import dataclass, field
from multiprocessing.process import BaseProcess
from typing import TYPE_CHECKING, Any, Self, cast

from wt_gym.base.processes import with_variables

if TYPE_CHECKING:
    from wt_gym.experiment.store import RunStore

__all__ = [
    "ATTEMPTS", "ENGINES", "Executor", "Experiment", "ProcessExecutor", "Progress", "ProgressLine", "RayExecutor",
    "SerialExecutor", "Tally", "clock", "executor_for", "played",
]  # fmt: skip

ENGINES = ("local", "ray")
"""Places where rows are played."""
ATTEMPTS = 3
"""Number of times that a row is begun whose process ends each time."""
ONE_THREAD = {"OMP_NUM_THREADS": "1", "NUMBA_NUM_THREADS": "1"}
"""Environment of a process that computes in one thread; read when it imports numpy and numba."""


# ---- progress ----


def clock(seconds: float) -> str:
    """Minutes and seconds, as ``3:05``."""
    minutes, rest = divmod(int(seconds), 60)
    return f"{minutes}:{rest:02d}"


class ProgressLine:
    """A line on standard error that is rewritten in place on a terminal; elsewhere the lines follow each other.

    Parameters
    ----------
    shown : bool
        False keeps it silent.
    interval : float
        Least time between two lines [s]; on a terminal a tenth of it.
    """

    def __init__(self, shown: bool = True, interval: float = 5.0):
        self._shown, self._terminal = shown, sys.stderr.isatty()
        self._interval = 0.1 * interval if self._terminal else interval
        self._last, self._width = -1e9, 0

    def show(self, text: str | Callable[[], str], *, final: bool = False) -> None:
        """Show a text, or the result of a function, if it is time to, and in any case if it is the final one."""
        now = time.monotonic()
        if not self._shown or (now - self._last < self._interval and not final):
            return
        self._last, text = now, text if isinstance(text, str) else text()
        if self._terminal:
            print("\r" + text.ljust(self._width), end="\n" if final else "", file=sys.stderr, flush=True)
            self._width = 0 if final else len(text)
        else:
            print(text, file=sys.stderr, flush=True)


class Progress:
    """Progress of a table: rows that are done, and the simulated time of the one that is being played."""

    def __init__(self, shown: bool = False):
        self._line, self._start = ProgressLine(shown), time.monotonic()
        self._total = self._stored = self._done = 0

    def begin(self, total: int, stored: int) -> None:
        """Take the number of rows and that of those whose results are stored already."""
        self._total, self._stored, self._start = total, stored, time.monotonic()
        if stored:
            self._line.show(f"{stored}/{total} runs are stored already", final=True)

    def follow(self, label: str, duration: float, steps: Iterable[Any]) -> None:
        """Play a run of this process step by step, under the label of its row; its planned duration is in s."""
        start = time.monotonic()
        for step in steps:
            elapsed, simulated = time.monotonic() - start, step.info["time"]
            speed = simulated / max(elapsed, 1e-9)
            self._line.show(
                f"{self._stored + self._done}/{self._total} runs, {label}: {simulated:.0f} of {duration:.0f} s "
                f"simulated in {clock(elapsed)} min ({speed:.0f} x real time)"
            )

    def row(self, label: str, outcome: str = "") -> None:
        """Count a row."""
        self._done += 1
        elapsed, left = time.monotonic() - self._start, self._total - self._stored - self._done
        remaining = f", about {clock(elapsed / self._done * left)} min left" if left else ""
        self._line.show(
            f"{self._stored + self._done}/{self._total} runs, {label}{outcome}; {clock(elapsed)} min{remaining}",
            final=True,
        )

    def __reduce__(self) -> tuple[type[Progress], tuple[bool]]:
        """Be silent in other processes."""
        return Progress, (False,)


# ---- experiments ----


class Experiment:
    """Rows of runs: a callable that plays a row, and the names and identities of rows.

    Subclasses say what a row is, in plain data. A copy of the experiment goes to every process that plays rows.
    """

    progress: Progress = Progress()

    def __call__(self, row: Any) -> Any:
        """Play a row."""
        raise NotImplementedError

    def prepare(self) -> None:
        """Make what rows need in another process, before its first row."""

    def warm(self) -> None:
        """Compile the kernels of the rows, once on each machine whose other processes play them."""

    def definition(self, row: Any) -> dict[str, Any]:
        """JSON values that decide on the numbers of a row; rows of the same definition are played once."""
        raise NotImplementedError

    def label(self, row: Any) -> str:
        """Name of a row."""
        return str(row)

    def outcome(self, row: Any, result: Any) -> str:
        """End of a sentence about a row that was played."""
        return ""

    def table(
        self, rows: Sequence[Any], executor: Executor | None = None, store: RunStore | None = None,
        progress: bool = True,
    ) -> list[Any]:  # fmt: skip
        """Results of rows, in their order; each is stored as soon as it is there.

        Parameters
        ----------
        executor : Executor, optional
            Entered; by default the rows are played one after another in this process.
        store : RunStore, optional
            Results in it are not made again.
        progress : bool
            Show progress on standard error.

        Raises
        ------
        ValueError
            If a file of a run is damaged, or was made by a version of the package with another behavior.
        ChildProcessError
            If rows were lost, because the processes or machines that played them ended again and again.
        """
        return [result for _, result in sorted(self.played(rows, executor, store, progress), key=lambda pair: pair[0])]

    def played(
        self, rows: Sequence[Any], executor: Executor | None = None, store: RunStore | None = None,
        progress: bool = True,
    ) -> Iterator[tuple[int, Any]]:  # fmt: skip
        """Numbers of rows with their results as soon as these are there; arguments as of `table`."""
        from wt_gym.experiment.store import run_digest

        executor = SerialExecutor() if executor is None else executor
        definitions = [self.definition(row) for row in rows]
        numbers: dict[str, list[int]] = {}
        for number, definition in enumerate(definitions):
            numbers.setdefault(run_digest(definition), []).append(number)
        missing, stored = list[list[int]](), list[tuple[list[int], Any]]()
        for same in numbers.values():
            if store is not None and (result := store.find(definitions[same[0]])) is not None:
                stored.append((same, result))
            else:
                missing.append(same)
        self.progress = Progress(progress)
        self.progress.begin(len(numbers), len(stored))
        for same, result in stored:
            yield from ((number, result) for number in same)
        same_of_row = {id(rows[same[0]]): same for same in missing}
        with store.session(executor.tally, len(stored), self.label) if store is not None else nullcontext():
            for row, made in executor.results(self, [rows[same[0]] for same in missing]):
                same = same_of_row[id(row)]
                result = made if store is None else store.keep(definitions[same[0]], made)
                self.progress.row(self.label(row), self.outcome(row, result))
                yield from ((number, result) for number in same)


# ---- executors ----


@dataclass
class Tally:
    """Counts of the rows of an executor.

    A row whose simulation diverged is done: that is its result. These counts are of processes and machines.
    """

    done: int = 0  #: rows with a result
    retried: int = 0  #: times that a row was begun again because the process or the machine that played it was gone
    lost: list[Any] = field(default_factory=list)  #: rows given up after `ATTEMPTS` of these

    def may_retry(self, row: Any, attempt: int) -> bool:
        """Whether a row whose process is gone is to be begun once more; counts it."""
        if attempt < ATTEMPTS:
            self.retried += 1
            return True
        self.lost.append(row)
        return False

    def raise_lost(self) -> None:
        """Raise a `ChildProcessError` if rows were lost."""
        if self.lost:
            raise ChildProcessError(
                f"{len(self.lost)} of {self.done + len(self.lost)} jobs were lost: {ATTEMPTS} times the process that "
                "did them has ended; was there too little memory for so many at a time? what was done is kept"
            )


class Executor:
    """Plays rows; a context that holds what that needs.

    Attributes
    ----------
    beside : bool
        Whether rows are played in other processes.
    """

    beside = True

    def __init__(self) -> None:
        self.tally = Tally()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exception: object) -> None:
        pass

    def results(self, work: Callable[[Any], Any], rows: Sequence[Any]) -> Iterator[tuple[Any, Any]]:
        """Play rows; give each with its result as soon as it is there.

        An error that a row raises ends all. Where the process or the machine of a row is gone, the row is begun again,
        `ATTEMPTS` times at most, and counted.

        Parameters
        ----------
        work : callable
            From a row to its result: an `Experiment`, or a function of a module.
        rows : sequence
            The longest first, so that none is left alone in the end.

        Raises
        ------
        ChildProcessError
            In the end, if rows were lost.
        """
        raise NotImplementedError


class SerialExecutor(Executor):
    """Rows one after another, in this process."""

    beside = False

    def results(self, work: Callable[[Any], Any], rows: Sequence[Any]) -> Iterator[tuple[Any, Any]]:
        """As `Executor.results`."""
        for row in rows:
            result = work(row)
            self.tally.done += 1
            yield row, result


class ProcessExecutor(Executor):
    """Rows beside each other, in processes of this machine; a `ValueError` if there is no worker.

    Where a row raises an error, or the caller goes no further, rows under way are ended and no other begins.
    """

    def __init__(self, workers: int):
        super().__init__()
        _check_workers(workers)
        self.workers = workers

    def results(self, work: Callable[[Any], Any], rows: Sequence[Any]) -> Iterator[tuple[Any, Any]]:
        """As `Executor.results`."""
        if not rows:
            return
        if isinstance(work, Experiment):
            work.warm()
        spawn = multiprocessing.get_context("spawn")  # compiled kernels do not survive a fork
        reader, writer = spawn.Pipe(duplex=False)
        left = deque((row, 1) for row in rows)
        running: dict[Future[Any], tuple[ProcessPoolExecutor, Any, int]] = {}

        def pool() -> ProcessPoolExecutor:
            """Pool of one process: where that ends, no other row is lost."""
            return pools.enter_context(ProcessPoolExecutor(1, spawn, _begin, (reader,)))

        with ExitStack() as pools:
            pools.callback(reader.close)
            pools.callback(writer.close)
            pools.enter_context(with_variables(ONE_THREAD))
            free = [pool() for _ in range(min(self.workers, len(rows)))]
            try:
                while left or running:
                    while free and left:
                        row, attempt = left.popleft()
                        try:
                            future = free[-1].submit(played, work, row)
                        except BrokenExecutor:  # ended while it had nothing to do
                            free[-1] = pool()
                            future = free[-1].submit(played, work, row)
                        running[future] = free.pop(), row, attempt
                    for future in wait(running, return_when=FIRST_COMPLETED).done:
                        its_pool, row, attempt = running.pop(future)
                        try:
                            result = future.result()
                        except BrokenExecutor:
                            free.append(pool())
                            if self.tally.may_retry(row, attempt):
                                left.appendleft((row, attempt + 1))
                            continue
                        free.append(its_pool)
                        self.tally.done += 1
                        yield row, result
            except BaseException:
                writer.close()  # ends the processes
                raise
        self.tally.raise_lost()


def executor_for(engine: str = "local", workers: int | None = None, address: str | None = None) -> Executor:
    """Executor as a command line asks for it.

    Parameters
    ----------
    engine : {"local", "ray"}
    workers : int, optional
        Rows at a time; default: one, and with Ray as many as the cluster has processors.
    address : str, optional
        Of a Ray cluster, as "auto" or "ray-head:6379"; default: that of the environment variable ``RAY_ADDRESS``, else
        a Ray of this machine alone begins and ends with the executor.

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
        return RayExecutor(address, workers)
    if address is not None:
        raise ValueError(
            f"the engine must be ray where an address (of a Ray cluster) is given, got {address!r} without"
        )
    return SerialExecutor() if workers in (None, 1) else ProcessExecutor(workers)


def _check_workers(workers: int) -> None:
    if workers < 1:
        raise ValueError(f"at least 1 job must run at a time, got {workers}")


_prepared: tuple[str, Any] | None = None
"""Experiment that this worker process plays, with its mark."""


def played(work: Callable[[Any], Any], row: Any, mark: str = "") -> Any:
    """Play a row in a worker process, which prepares an experiment once.

    The mark tells experiments apart where a process plays rows of several.
    """
    global _prepared
    if not isinstance(work, Experiment):
        return work(row)
    if _prepared is None or _prepared[0] != mark:
        work.prepare()
        _prepared = mark, work
    return _prepared[1](row)


def _begin(messages: multiprocessing.connection.Connection) -> None:
    """Begin as a worker process, which ends when it is asked to, or the one that gives it work has gone."""

    def end() -> None:
        multiprocessing.connection.wait([messages, cast(BaseProcess, multiprocessing.parent_process()).sentinel])
        os._exit(1)

    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C reaches all; the one that gives work decides
    threading.Thread(target=end, daemon=True).start()


# ---- Ray, in the extra "ray" ----

_OBJECT_STORE = 300 * 2**20  # bytes: a result is some MB, and is fetched as soon as it is there


class RayExecutor(Executor):
    """Rows as tasks of a Ray cluster, a processor each.

    Ray's own retries are off: what is begun again is counted here. Results come back to this process, which alone
    writes them: the machines need no common file system, but trained models must lie at the same path on all of them.
    A connection of this process is used and left.

    Parameters
    ----------
    address : str, optional
        As of `executor_for`.
    workers : int, optional
        Rows at a time; default: as many as the cluster has processors, also while machines come and go.
    """

    def __init__(self, address: str | None = None, workers: int | None = None):
        super().__init__()
        self._address, self._workers, self._connects = address or os.environ.get("RAY_ADDRESS"), workers, False

    def __enter__(self) -> Self:
        """Connect; a ConnectionError if there is no cluster at the address."""
        import ray

        self._connects = not ray.is_initialized()
        if not self._connects:
            return self
        handlers = dict[int, Any]()
        if threading.current_thread() is threading.main_thread():  # which alone can set them
            handlers = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
        own = {"num_cpus": self._workers, "object_store_memory": _OBJECT_STORE, "include_dashboard": False}
        ray.init(
            address=self._address or "local",
            # several workers of a machine would each start as many threads as it has processors
            runtime_env={"env_vars": ONE_THREAD},
            log_to_driver=False,
            logging_level="warning",
            **({} if self._address else own),
        )
        for number, handler in handlers.items():
            signal.signal(number, handler)  # Ray has put its own in their place
        return self

    def __exit__(self, *exception: object) -> None:
        if self._connects:
            import ray

            ray.shutdown()

    def results(self, work: Callable[[Any], Any], rows: Sequence[Any]) -> Iterator[tuple[Any, Any]]:
        """As `Executor.results`."""
        import ray
        from ray import exceptions

        if not rows:
            return
        if isinstance(work, Experiment):
            _warm_nodes(work.warm)
        # The process or the machine of a task, or of its result, is gone; other errors are the work's own.
        gone = (
            exceptions.LocalRayletDiedError, exceptions.NodeDiedError, exceptions.ObjectLostError,
            exceptions.OutOfMemoryError, exceptions.WorkerCrashedError,
        )  # fmt: skip
        play = ray.remote(num_cpus=1, max_retries=0)(played)
        stored = ray.put(work)  # once to each machine, whatever the number of rows
        left = deque((row, 1) for row in rows)
        running: dict[Any, tuple[Any, int]] = {}
        try:
            while left or running:
                # a few more than there are processors, so that none waits for this process; results never pile up
                most = self._workers or max(1, int(ray.cluster_resources().get("CPU", 1))) + 2
                while left and len(running) < most:
                    row, attempt = left.popleft()
                    running[play.remote(stored, row, stored.hex())] = row, attempt
                for task in ray.wait(list(running))[0]:
                    row, attempt = running.pop(task)
                    try:
                        result = ray.get(task)
                    except gone:
                        if self.tally.may_retry(row, attempt):
                            left.append((row, attempt + 1))
                        continue
                    except exceptions.RayTaskError as error:
                        raise error.cause from None  # what the work has raised, as it would have here
                    self.tally.done += 1
                    yield row, result
        finally:
            for task in running:
                ray.cancel(task, force=True)
        self.tally.raise_lost()


def _warm_nodes(warm: Callable[[], None]) -> None:
    """Call a function once on each machine of the cluster, all at the same time.

    A first step compiles for a minute and more, and twenty workers that start cold compile the same twenty times.
    """
    import ray
    from ray.exceptions import RayTaskError
    from ray.util.scheduling_strategies import NodeAffinitySchedulingStrategy

    nodes = [
        node["NodeID"] for node in ray.nodes() if node["Alive"] and node.get("Resources", {}).get("CPU", 0.0) >= 1.0
    ]
    call = ray.remote(num_cpus=1)(lambda: warm())
    # a node that goes meanwhile does no harm: soft affinity warms another one twice
    tasks = [call.options(scheduling_strategy=NodeAffinitySchedulingStrategy(node, soft=True)) for node in nodes]
    try:
        ray.get([task.remote() for task in tasks])
    except RayTaskError as error:
        raise error.cause from None  # as it would have been raised here
