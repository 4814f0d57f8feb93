"""A controller library with the Bladed interface, loaded for one turbine.

Such libraries keep their state in global variables. So each instance loads a private copy of the file, whose variables
are its own, and unloads it when it is closed. What the original depends on is found because the original is loaded,
too, but never called. An isolated library runs in a process of its own (`wt_gym.base.child_process`), so that a crash
is an error of the controller and not the end of the training.
"""

from __future__ import annotations

import _ctypes
import contextlib
import ctypes
import logging
import os
import shutil
import sys
import tempfile
import weakref
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from wt_gym.base.child_process import ChildEndedError, ChildProcess
from wt_gym.base.errors import SimulationError
from wt_gym.control.bladed import worker
from wt_gym.control.bladed.records import MESSAGE_LENGTH

if TYPE_CHECKING:
    from collections.abc import Iterator

__all__ = ["DEFAULT_FUNCTION", "Library", "check_library"]

_log = logging.getLogger(__name__)

DEFAULT_FUNCTION = "DISCON"
"""Name of the function of the interface."""


def check_library(path: Path, function: str) -> None:
    """Refuse what cannot be loaded.

    Raises
    ------
    FileNotFoundError
        If there is no such file.
    ValueError
        If it is not a library of this machine, or has no such function.
    """
    if not path.is_file():
        raise FileNotFoundError(f"there is no controller library {path}")
    try:
        library = _anchor(path)
    except OSError as error:
        raise ValueError(f"{path} must be a shared library of this machine: {error}") from error
    if not hasattr(library, function):
        raise ValueError(
            f"{path} has no function {function!r}; the Bladed interface calls it {DEFAULT_FUNCTION}, and "
            "function=NAME chooses another"
        )


@cache
def _anchor(path: Path) -> ctypes.CDLL:
    """The library itself, never called: it keeps what it depends on loaded."""
    return ctypes.CDLL(str(path))


class Library:
    """One instance of a controller library.

    Parameters
    ----------
    path : pathlib.Path
    function : str
    isolated : bool
        Whether it runs in a process of its own.

    Raises
    ------
    FileNotFoundError, ValueError
        See `check_library`.
    """

    def __init__(self, path: Path, function: str = DEFAULT_FUNCTION, isolated: bool = False):
        check_library(path, function)
        self.path = path
        # where Windows holds a file of it a moment longer, the folder stays
        self._folder = tempfile.TemporaryDirectory(prefix="wt_gym_bladed_", ignore_cleanup_errors=True)
        self.output_name = str(Path(self._folder.name) / "controller")
        """Where the library may write files: in a folder that goes with it."""
        self._prints = Path(self._folder.name) / "prints.txt"
        self._called = False
        self._child: ChildProcess | None = None
        if isolated:
            self._child = ChildProcess(Path(worker.__file__), (str(path), function), self._prints)
        else:
            copy = Path(self._folder.name) / path.name
            shutil.copy(path, copy)
            library = ctypes.CDLL(str(copy))
            self._library, self._function = library, getattr(library, function)
            self._function.restype = None
            self._flag, self._message = ctypes.c_int32(0), ctypes.create_string_buffer(MESSAGE_LENGTH)
            self._fixed = ctypes.c_char_p(self.output_name.encode()), self._message
            self._unload = weakref.finalize(self, _unload, library)

    @property
    def alive(self) -> bool:
        """Whether it can be called: not after its process has ended."""
        return self._child is None or self._child.alive

    def call(self, swap: np.ndarray, input_file: str) -> tuple[int, str]:
        """Call the library once; it changes the records.

        Parameters
        ----------
        swap : numpy.ndarray, float32
            ``avrSWAP``.
        input_file : str

        Returns
        -------
        flag : int
            0: all is well, above 0: the message is a warning, below 0: the simulation is to end.
        message : str

        Raises
        ------
        wt_gym.base.errors.SimulationError
            If the process of an isolated library ended.
        """
        if self._child is not None:
            return self._call_child(self._child, swap, input_file)
        self._flag.value, self._message.value = 0, b""
        arguments = ctypes.c_void_p(swap.ctypes.data), ctypes.byref(self._flag), input_file.encode(), *self._fixed
        if self._called:
            self._function(*arguments)
        else:
            with self._printed():
                self._function(*arguments)
            self._called = True
        return self._flag.value, self._message.value.decode(errors="replace").strip()

    @contextlib.contextmanager
    def _printed(self) -> Iterator[None]:
        """Have what the library prints logged, at level debug, instead of in the middle of a progress line."""
        sys.stdout.flush()
        with self._prints.open("w+b") as prints:
            kept = os.dup(1)
            os.dup2(prints.fileno(), 1)
            try:
                yield
            finally:
                self._flush()
                os.dup2(kept, 1)
                os.close(kept)
                prints.seek(0)
                _log.debug("%s printed: %s", self.path.name, prints.read().decode(errors="replace"))

    def _flush(self) -> None:
        """Have what was printed written, by Fortran's library if the controller uses it and by that of C."""
        if hasattr(self._library, "_gfortran_flush_i4"):
            self._library._gfortran_flush_i4(None)
        if sys.platform != "win32":
            ctypes.CDLL(None).fflush(None)

    def _call_child(self, child: ChildProcess, swap: np.ndarray, input_file: str) -> tuple[int, str]:
        try:
            flag, message, records = child.ask("call", input_file.encode(), self.output_name.encode(), swap.tobytes())
        except ChildEndedError as error:
            last = error.printed.rpartition("\n")[2]
            raise SimulationError(
                f"the controller library {self.path.name} ended its process {error.how}" + (f": {last}" if last else "")
            ) from error
        swap[:] = np.frombuffer(records, dtype=np.float32)
        return flag, message.decode(errors="replace").strip()

    def close(self) -> None:
        """Unload the library; it is not told, see `BladedController.close`."""
        if self._child is not None:
            self._child.close()
        else:
            self._unload()
        self._folder.cleanup()


def _unload(library: ctypes.CDLL) -> None:
    """Unload a library; ctypes itself never does."""
    if sys.platform == "win32":
        _ctypes.FreeLibrary(library._handle)
    else:
        _ctypes.dlclose(library._handle)
