"""One simulation of OpenFAST in a process of its own, which a crash of the library ends and nothing else.

Also the places of OpenFAST's library and driver, and the small Bladed library through which any build of OpenFAST takes
demands from this package.
"""

import ctypes.util
import hashlib
import os
import shutil
import sys
import sysconfig
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from wt_gym.base.errors import SimulationError
from wt_gym.base.processes import ChildEndedError, ChildFailedError, ChildProcess
from wt_gym.base.quantities import Array
from wt_gym.base.user_cache import user_cache
from wt_gym.bridges.compiler import CompilerError, compile_library, library_name
from wt_gym.bridges.openfast import worker

_LAST_WORDS = 600  # Characters of OpenFAST's output that a message shows


class OpenFASTProcess:
    """A simulation of OpenFAST's library that is running.

    The library keeps its state in global variables and stops its process where Fortran stops: a process for each
    simulation gives both no consequence.

    Parameters
    ----------
    model : Path
        Primary file.
    relay : Path or None
        Library that hands over the demands (`relay_library`).
    demands : array (6,)
        At time zero: pitch of three blades [rad], torque [N m], yaw [rad], yaw rate [rad/s].
    log : Path
        Receives what OpenFAST prints.

    Attributes
    ----------
    step : float
        Of OpenFAST [s].
    names : list of str
        Of the outputs.
    outputs : ndarray (n_outputs,)
        At time zero.
    """

    def __init__(self, library: Path, model: Path, relay: Path | None, demands: Array, log: Path):
        self._child = ChildProcess(Path(worker.__file__), (), log, model.parent)
        start = str(library), str(model), None if relay is None else str(relay), demands.tolist()
        self.step, self.names, outputs = self._ask("start", *start)
        self.outputs = np.frombuffer(outputs)

    def advance(self, demands: Array) -> Array:
        """Advance by one step of OpenFAST for each row of demands (n, 6); outputs (n, n_outputs)."""
        rows = self._ask("advance", demands.ravel().tolist())
        return np.frombuffer(rows).reshape(len(demands), len(self.names))

    def _ask(self, name: str, *values: object) -> Any:
        if not self._child.alive:
            raise SimulationError("OpenFAST is not running")
        try:
            return self._child.ask(name, *values)
        except ChildFailedError as error:
            self._child.close()
            raise SimulationError(f"OpenFAST: {error}") from error
        except ChildEndedError as error:
            words = " ".join(error.printed.split())[-_LAST_WORDS:] or "it printed nothing"
            raise SimulationError(f"OpenFAST crashed ({error.how}): {words}") from error

    def close(self) -> None:
        """End the simulation."""
        self._child.close()


VARIABLE = "WT_GYM_OPENFAST_LIBRARY"
"""Environment variable with the path of the library."""

_NAMES = {"win32": ("openfastlib.dll", "libopenfastlib.dll"), "darwin": ("libopenfastlib.dylib",)}
_FOLDERS = ("lib", "Library/bin", "bin")


DRIVER_VARIABLE = "WT_GYM_OPENFAST"
"""Environment variable with the path of the driver."""


def _named(given: str | os.PathLike[str] | None, argument: str, variable: str, what: str) -> Path | None:
    """Return the file that an argument or an environment variable names, None where neither does."""
    chosen = given or os.environ.get(variable)
    if not chosen:
        return None
    path = Path(chosen).expanduser()
    if path.is_file():
        return path.resolve()
    where = argument if given else variable
    raise SimulationError(f"{where} must be the path of OpenFAST's {what}; got {chosen}: no file")


def find_library(given: str | os.PathLike[str] | None = None) -> Path:
    """Path of OpenFAST's C library.

    Parameters
    ----------
    given : str or path, optional
        By default `VARIABLE`, else the library of the conda environment or of this Python, else that of the system.

    Raises
    ------
    SimulationError
        If it is not found; the message says how to get one.
    """
    if path := _named(given, "openfast_library", VARIABLE, "library (libopenfastlib)"):
        return path
    names = _NAMES.get(sys.platform, ("libopenfastlib.so",))
    for prefix in (os.environ.get("CONDA_PREFIX"), sys.prefix):
        for folder in _FOLDERS if prefix else ():
            for name in names:
                path = Path(str(prefix), folder, name)
                if path.is_file():
                    return path
    if found := ctypes.util.find_library("openfastlib"):
        return Path(found)
    raise SimulationError(
        "OpenFAST's library (libopenfastlib, version 5) is not here: conda install -c conda-forge openfast, or build "
        f"OpenFAST with -DBUILD_SHARED_LIBS=ON; then give its path as openfast_library=... or in {VARIABLE}"
    )


_SOURCE = Path(__file__).with_name("relay.c")


def find_driver(given: str | os.PathLike[str] | None = None) -> Path:
    """Path of OpenFAST's driver.

    Parameters
    ----------
    given : str or path, optional
        By default `DRIVER_VARIABLE`, else ``openfast`` on the path or beside the library that `VARIABLE` names.

    Raises
    ------
    SimulationError
        If it is not found; the message says how to get one.
    """
    if path := _named(given, "openfast", DRIVER_VARIABLE, "driver (openfast)"):
        return path
    library = os.environ.get(VARIABLE)
    beside = [str(Path(library).parent), str(Path(library).parent.parent / "bin")] if library else []
    for folder in (None, *beside):
        if driver := shutil.which("openfast", path=folder):
            return Path(driver).resolve()
    raise SimulationError(
        "OpenFAST's driver (openfast, version 5) is not here: conda install -c conda-forge openfast, or build it; "
        f"then have it on the path, or give its path in {DRIVER_VARIABLE}"
    )


def relay_library() -> Path:
    """Path of the library, compiled at the first call and kept in the cache."""
    stamp = hashlib.sha256(_SOURCE.read_bytes() + sysconfig.get_platform().encode()).hexdigest()[:16]
    cache = user_cache()
    if cache is None:
        raise SimulationError("no folder for compiled files: set WT_GYM_CACHE")
    path = cache / "openfast" / library_name(f"relay-{stamp}")
    if path.is_file():
        return path
    path.parent.mkdir(parents=True, exist_ok=True)
    with TemporaryDirectory(dir=path.parent) as folder:
        made = Path(folder) / path.name
        try:
            compile_library(_SOURCE, made)
        except CompilerError as error:
            raise SimulationError(
                f"OpenFAST takes demands through a small library, which a C compiler makes: {error}; with a build of "
                "OpenFAST whose ServoDyn takes inputs (PCMode 4) give commands='inputs'"
            ) from error
        os.replace(made, path)
    return path
