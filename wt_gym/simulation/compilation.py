"""Compile the kernels of a turbine before they are needed, in two processes at once, and tell the user.

A process compiles one kernel after another. What moves the structure and what moves the air do not call each other:
each is compiled in a process of its own, into the cache that both share. The first continues with the step that calls
both, the other one, which is done earlier, with what a start calls and with the wind.
"""

import json
import logging
import math
import multiprocessing
import os
import pickle
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from multiprocessing.spawn import get_executable
from threading import RLock
from typing import IO, Protocol, cast

import numpy as np

from wt_gym.base.compiled import argument_types
from wt_gym.simulation.channels import Signals
from wt_gym.simulation.fidelity import Fidelity
from wt_gym.simulation.fidelity import fidelity as fidelity_of
from wt_gym.simulation.models import build_lattice
from wt_gym.simulation.step.coupling import Coupling
from wt_gym.turbines import Turbine
from wt_gym.wind import SteadyInflow

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
        # one of many processes, which all begin at once, or another one that is to compile alone
        is_worker = multiprocessing.parent_process() is not None or COMPILE_ALONE in os.environ
        if usable_cores() > 1 and get_executable() and not is_worker:
            with_help(turbine, fidelity)


def compile_step(coupling: Coupling, turbine: Turbine) -> None:
    """Say that the step of a formulation or of bodies is new, and compile it: the next process finds it."""
    if not (_under_way or coupling.is_compiled()):
        _announce(type(coupling), turbine)
        coupling.compile()


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


def _restart() -> None:
    """In a forked process, where no other thread continues what it had begun."""
    global _one_at_a_time, _under_way
    _one_at_a_time, _under_way = RLock(), False


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_restart)


def usable_cores() -> int:
    """Cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


HELPER = """
import json, sys
sys.path[:] = json.loads(sys.stdin.buffer.readline())
from wt_gym.simulation import Simulator
from wt_gym.simulation.compilation import help_to_compile
help_to_compile(Simulator)
"""
_AIR_IS_READY = b"air\n"


class _Simulator(Protocol):
    """What is compiled: `wt_gym.simulation.Simulator`, whose first one calls this module and is handed to it."""

    coupling: Coupling

    def __init__(self, turbine: Turbine, inflow: SteadyInflow, fidelity: str | Fidelity) -> None: ...

    def reset(self, rotor_speed: float) -> Signals: ...


def compile_ahead(simulator: type[_Simulator], turbine: Turbine, fidelity: str | Fidelity) -> None:
    """Compile what the simulator of a turbine needs, in this process and another one, which is new and ends with it.

    Where there can be no other process, or where it fails, this one does all the work.

    Parameters
    ----------
    simulator : type
        `wt_gym.simulation.Simulator`.
    turbine, fidelity
        As of `wt_gym.simulation.Simulator`.
    """
    with compiling(), _help(turbine, fidelity) as helper:
        coupling = simulator(turbine, SteadyInflow(8.0), fidelity).coupling
        compile_structure(coupling)
        if helper is not None:
            air = cast(IO[bytes], helper.stdout)
            next((line for line in air if line == _AIR_IS_READY), None)  # or the helper has ended
        if coupling.models.lattice.split is None:
            coupling.compiled_step()
        if helper is not None and helper.wait():
            _log.info("the process that helped to compile ended with status %d", helper.returncode)


@contextmanager
def _help(turbine: Turbine, fidelity: str | Fidelity) -> Iterator[subprocess.Popen[bytes] | None]:
    """A process that has begun to compile the air; None where none can be had."""
    try:
        with tempfile.TemporaryFile() as given:
            given.write(json.dumps([path for path in sys.path if isinstance(path, str)]).encode() + b"\n")
            pickle.dump((turbine, fidelity), given)
            given.seek(0)
            helper = subprocess.Popen(
                [get_executable(), "-P", "-c", HELPER],
                stdin=given,
                stdout=subprocess.PIPE,
                stderr=subprocess.DEVNULL,  # what goes wrong there goes wrong here again
                env=os.environ | {COMPILE_ALONE: "1"},
            )
    # what only this process knows cannot be pickled, and there may be no more processes, or no interpreter to run
    except (pickle.PicklingError, AttributeError, TypeError, ValueError, RecursionError, OSError) as error:
        _log.info("nobody helps to compile: %s", error)
        yield None
        return
    with helper:
        try:
            yield helper
        finally:
            helper.kill()  # nothing, if it has ended


def help_to_compile(simulator: type[_Simulator]) -> None:
    """Compile the air, say so, and compile a start: what the other process does."""
    turbine, fidelity = pickle.load(sys.stdin.buffer)  # of the process that began this one
    with compiling(), os.fdopen(os.dup(1), "wb") as answer, open(os.devnull, "wb") as nowhere:
        os.dup2(nowhere.fileno(), 1)  # nobody reads what else is printed
        _compile_air(turbine, fidelity)
        answer.write(_AIR_IS_READY)
        answer.flush()
        started = simulator(turbine, SteadyInflow(8.0), fidelity)
        started.reset(rotor_speed=turbine.drivetrain.rated_rotor_speed)
        started.coupling.wind.compile()  # the wind of a step


def compile_structure(coupling: Coupling) -> None:
    """What moves the structure, by letting it begin to move, and what only the compiled step calls."""
    structure = coupling.models.structure
    coupling.begin_motion(structure.adopt(structure, structure.system.initial_state()))  # free bodies in place
    for kernel, arguments in coupling.parts_without_air():
        kernel.compile(argument_types(arguments))


def _compile_air(turbine: Turbine, fidelity: str | Fidelity) -> None:
    """What moves the air, by starting the wake of a plain rotor of as many blades and panels."""
    lattice = build_lattice(turbine, fidelity_of(fidelity))
    n_blades, n_along, n_across, _ = lattice.nodes_shape
    reach, speed, axis = 50.0, 1.0, np.array([1.0, 0.0, 0.0])
    angle = 2.0 * math.pi * np.arange(n_blades)[:, None, None] / n_blades
    radius = np.linspace(0.1 * reach, reach, n_across)
    along = 0.1 * reach * np.linspace(-0.25, 0.75, n_along)[:, None]  # the leading edge looks where the blade goes
    flow_angle = np.arctan2(8.0, speed * radius)
    outwards = np.stack([np.zeros_like(angle), -np.sin(angle), np.cos(angle)], axis=-1)
    ahead = np.stack([np.zeros_like(angle), -np.cos(angle), -np.sin(angle)], axis=-1)
    sideways = (along * np.cos(flow_angle))[..., None]
    nodes = radius[:, None] * outwards - sideways * ahead + (along * np.sin(flow_angle))[..., None] * axis
    velocities = speed * np.cross(axis, nodes)
    wind = np.broadcast_to(8.0 * axis, nodes.shape)
    lattice.initialize_helix(lattice.new_state(), nodes, velocities, wind, np.zeros(3), axis, speed, 0.1, passes=1)
