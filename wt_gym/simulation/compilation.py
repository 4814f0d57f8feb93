"""The first simulator of a machine compiles by itself; the user is told, and another process helps."""

from __future__ import annotations

import logging
import multiprocessing
import os
from contextlib import contextmanager
from multiprocessing.spawn import get_executable
from threading import RLock
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from wt_gym.simulation.fidelity import Fidelity
    from wt_gym.simulation.step.coupling import Coupling
    from wt_gym.turbines import Turbine

__all__ = ["COMPILE_ALONE", "announce_compilation", "compile_once", "compiling"]

COMPILE_ALONE = "WT_GYM_COMPILE_ALONE"
"""Environment variable with which a process has no other one help it to compile."""

_log = logging.getLogger(__name__)
_one_at_a_time = RLock()
_under_way = False
_announced: set[tuple[type, str]] = set()


def compile_once(
    coupling: type[Coupling], turbine: Turbine, fidelity: Fidelity, with_help: Callable[[Turbine, Fidelity], None]
) -> None:
    """Compile what a simulator needs, where no simulator of its kind ever was, and say so, because it takes a minute.

    Another process helps where there is a core for it, unless this one is itself a worker of many, or the environment
    variable ``WT_GYM_COMPILE_ALONE`` is set.

    Parameters
    ----------
    coupling : type
        Of the simulator.
    turbine, fidelity
        As of `wt_gym.simulation.Simulator`.
    with_help : callable
        Compiles what the simulator of a turbine at a fidelity needs, in two processes.
    """
    with _one_at_a_time:  # other threads wait, and find it done
        if _under_way or coupling.was_compiled():
            return
        _announce(coupling, turbine)
        if _cores() > 1 and get_executable() and not _is_worker():
            with_help(turbine, fidelity)


def announce_compilation(coupling: Coupling, turbine: Turbine) -> None:
    """Tell the user that a start has to compile the step of a formulation or of bodies that have not run yet."""
    if not (_under_way or coupling.is_compiled()):
        _announce(type(coupling), turbine)


@contextmanager
def compiling() -> Iterator[None]:
    """Simulators that are made within neither say anything nor have another process help them."""
    global _under_way
    with _one_at_a_time:
        before, _under_way = _under_way, True
        try:
            yield
        finally:
            _under_way = before


def _announce(coupling: type[Coupling], turbine: Turbine) -> None:
    """Once."""
    if (coupling, turbine.name) not in _announced:
        _announced.add((coupling, turbine.name))
        _log.warning("compiling the simulator of %s: a minute or two, once on this machine", turbine.name)


def _is_worker() -> bool:
    """One of many processes, which all begin at once, or another one that was told to compile alone."""
    return multiprocessing.parent_process() is not None or COMPILE_ALONE in os.environ


def _restart() -> None:
    """In a forked process, where no other thread continues what it had begun."""
    global _one_at_a_time, _under_way
    _one_at_a_time, _under_way = RLock(), False


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_restart)


def _cores() -> int:
    """Cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
