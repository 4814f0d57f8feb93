"""Memory and threads of this process, and child processes.

A child process does one work and answers requests: what it does to itself, a crash included, stays there. Compiled
libraries keep their state in global variables and stop their process where they give up. A worker, a file that uses the
standard library alone and so starts in a moment, holds such a library in a process of its own. It defines
``begin(*arguments)``, which gives an object whose methods answer requests, and ``FAILURES``, the exceptions that are
answers and not its end. Requests and answers are pickles over standard input and output of this file, run as a script;
what the worker prints goes to a log.
"""

from __future__ import annotations

import contextlib
import importlib.util
import os
import pickle
import subprocess
import sys
import weakref
from collections.abc import Iterator, Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any, cast

if TYPE_CHECKING:
    from contextlib import AbstractContextManager

    from threadpoolctl import ThreadpoolController

_MIB = 2**20
_PATIENCE = 5.0
"""Time that a process is given to end [s]."""
_UNBUFFERED = {"GFORTRAN_UNBUFFERED_PRECONNECTED": "y"}
"""What Fortran has printed is then in the log after a crash."""


def peak_memory() -> float | None:
    """The most memory that this process has had [MiB]; None on Windows without the package psutil."""
    try:
        import resource
    except ModuleNotFoundError:  # Windows
        return _of_psutil("peak_wset")
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak / _MIB if sys.platform == "darwin" else peak / 1024.0  # bytes there, kilobytes elsewhere


def resident_memory() -> float | None:
    """Memory that this process has now [MiB]; where the system does not tell, the most that it ever had."""
    try:
        import resource

        pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    except (ModuleNotFoundError, OSError):  # only Linux has the file
        now = _of_psutil("rss")
        return peak_memory() if now is None else now
    return pages * resource.getpagesize() / _MIB


def _of_psutil(name: str) -> float | None:
    """One of psutil's numbers [MiB]; None where there is no such number or no psutil."""
    if importlib.util.find_spec("psutil") is None:
        return None
    import psutil

    found = getattr(psutil.Process().memory_info(), name, None)
    return None if found is None else found / _MIB


@cache
def _blas() -> ThreadpoolController:
    """Libraries of linear algebra of NumPy and SciPy, which are loaded before they are looked up."""
    import numpy  # noqa: F401
    import scipy.linalg  # noqa: F401
    from threadpoolctl import ThreadpoolController

    return ThreadpoolController().select(user_api="blas")


@contextlib.contextmanager
def with_variables(values: Mapping[str, str]) -> Iterator[None]:
    """Set variables of this process, which processes that start meanwhile inherit, and set them back at the end."""
    before = {name: os.environ.get(name) for name in values}
    os.environ.update(values)
    try:
        yield
    finally:
        for name, value in before.items():
            os.environ.pop(name) if value is None else os.environ.update({name: value})


def one_blas_thread() -> AbstractContextManager[Any]:
    """Limit the BLAS libraries of NumPy and SciPy to one thread each; at the end they have as many as before.

    With several threads, products of large matrices are rounded differently, so runs are not repeatable. On busy cores
    the threads also wait for each other, a thousand times as long as the factorization of a small matrix takes.

    The limit holds from the call on, so use it in a ``with`` statement. The number belongs to the process or to the
    calling thread, which depends on how a library was built. So work that needs the limit takes it, and who starts
    threads with such work side by side holds it around them: otherwise the first of them to end sets the number back
    for the others.
    """
    limit: AbstractContextManager[Any] = _blas().limit(limits=1)
    return limit


class ChildFailedError(RuntimeError):
    """A request failed with a message; the process continues."""


class ChildEndedError(RuntimeError):
    """The process is gone.

    Attributes
    ----------
    how : str
        "by signal 6" or "with exit status 2".
    printed : str
        All that it has printed.
    """

    def __init__(self, how: str, printed: str):
        super().__init__(f"the process ended {how}: {printed}")
        self.how, self.printed = how, printed


class ChildProcess:
    """A worker in a process of its own, which ends with this object.

    The arguments are those of its ``begin``; the log receives what it prints; it runs in the folder, by default the
    present one.
    """

    def __init__(self, worker: Path, arguments: Sequence[str], log: Path, folder: Path | None = None):
        self._log = log
        with log.open("wb") as prints:
            self._process = subprocess.Popen(
                [sys.executable, "-I", __file__, str(worker), *arguments],
                stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=prints, cwd=folder, env=os.environ | _UNBUFFERED,
            )  # fmt: skip
        self._end = weakref.finalize(self, _end, self._process)

    @property
    def alive(self) -> bool:
        """Whether it can be asked: not after its end."""
        return self._end.alive

    def ask(self, name: str, *values: object) -> Any:
        """Result of a method of the worker, called with plain values.

        Raises
        ------
        ChildFailedError
            If it raises one of its failures.
        ChildEndedError
            If the process is gone.
        """
        requests, answers = cast("IO[bytes]", self._process.stdin), cast("IO[bytes]", self._process.stdout)
        if not self.alive:
            raise self._ended()
        try:
            pickle.dump((name, *values), requests, protocol=pickle.HIGHEST_PROTOCOL)
            requests.flush()
            done, answer = pickle.load(answers)
        except (EOFError, OSError, pickle.UnpicklingError) as error:
            self._end()
            raise self._ended() from error
        if not done:
            raise ChildFailedError(answer)
        return answer

    def _ended(self) -> ChildEndedError:
        code, printed = self._process.returncode, ""
        with contextlib.suppress(FileNotFoundError):  # its folder may be gone
            printed = self._log.read_text(encoding="utf-8", errors="replace").strip()
        return ChildEndedError(f"by signal {-code}" if code < 0 else f"with exit status {code}", printed)

    def close(self) -> None:
        """End it."""
        self._end()


def _end(process: subprocess.Popen[bytes]) -> None:
    """End a process, which ends by itself when nothing more can be asked, or by force where it hangs."""
    for stream in (process.stdin, process.stdout):
        with contextlib.suppress(OSError):  # the process may be gone before it has read all
            cast("IO[bytes]", stream).close()
    try:
        process.wait(_PATIENCE)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()


def _serve(worker: str, *arguments: str) -> None:
    """Answer requests until there are no more, as the child process."""
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # what the worker prints must not get among the answers
    spec = importlib.util.spec_from_file_location(Path(worker).stem, worker)
    assert spec is not None  # of a file that ends in .py
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    served, failures = module.begin(*arguments), module.FAILURES
    while True:
        try:
            name, *values = pickle.load(sys.stdin.buffer)
        except EOFError:
            return
        answer: tuple[bool, Any]
        try:
            answer = True, getattr(served, name)(*values)
        except failures as error:
            answer = False, str(error)
        pickle.dump(answer, answers, protocol=pickle.HIGHEST_PROTOCOL)
        answers.flush()


if __name__ == "__main__":
    _serve(*sys.argv[1:])
