"""A library with the Bladed interface as a controller.

Such libraries keep their state in global variables. So each instance loads a private copy of the file, whose variables
are its own, and unloads it when it is closed. What the original depends on is found because the original is loaded,
too, but never called. An isolated library runs in a process of its own (`wt_gym.base.processes`), so that a crash
is an error of the controller and not the end of the training.
"""

import _ctypes
import contextlib
import ctypes
import logging
import math
import os
import shutil
import sys
import weakref
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from wt_gym.base.errors import ControllerError, SimulationError
from wt_gym.base.files import HeldFolder
from wt_gym.base.options import Options, option, option_record
from wt_gym.base.processes import ChildEndedError, ChildProcess
from wt_gym.control.actions import Demand
from wt_gym.control.bladed import worker
from wt_gym.control.bladed.records import (
    AZIMUTH,
    FIRST_CALL,
    LAST_CALL,
    MAX_BLADES,
    MESSAGE_LENGTH,
    RECORDS,
    STEP,
    channels_read,
    check_points,
    demand_of,
    lidar_indices,
    new_swap,
    write_demand,
    write_lidar,
    write_platform,
    write_readings,
    write_turbine,
)
from wt_gym.control.controllers.controller import Readings
from wt_gym.control.sensors import Lidar
from wt_gym.turbines import Turbine

_log = logging.getLogger(__name__)

DEFAULT_FUNCTION = "DISCON"
"""Name of the function of the interface."""


def check_library(path: Path, function: str) -> None:
    """Refuse what cannot be loaded.

    Raises
    ------
    FileNotFoundError, ValueError
        If there is no such file; if it is not a library of this machine, or has no such function.
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
    """One instance of a controller library, isolated: in a process of its own.

    Raises
    ------
    FileNotFoundError, ValueError
        See `check_library`.
    """

    def __init__(self, path: Path, function: str = DEFAULT_FUNCTION, isolated: bool = False):
        check_library(path, function)
        self.path = path
        self._folder = HeldFolder("wt_gym_bladed_")
        self.output_name = str(self._folder.path / "controller")
        """Where the library may write files: in a folder that goes with it."""
        self._prints = self._folder.path / "prints.txt"
        self._called = False
        self._child: ChildProcess | None = None
        if isolated:
            self._child = ChildProcess(Path(worker.__file__), (str(path), function), self._prints)
        else:
            copy = self._folder.path / path.name
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
        """Call the library once; it changes the records ``avrSWAP``.

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
        self._folder.remove()


def _unload(library: ctypes.CDLL) -> None:
    """Unload a library; ctypes itself never does."""
    if sys.platform == "win32":
        _ctypes.FreeLibrary(library._handle)
    else:
        _ctypes.dlclose(library._handle)


@option_record
class BladedOptions(Options):
    """Parameters of a `BladedController`."""

    title = "bladed"

    library: Path | None = option("path of the library", default=None, unit="-", otherwise="must be given")
    input_file: Path | None = option("path of its parameter file", default=None, unit="-", otherwise="none")
    function: str = option("name of its function", default=DEFAULT_FUNCTION, unit="-")
    interval: float | None = option(
        "longest time between calls; within a longer step of the controller the readings go linearly from the last to "
        "the current ones", default=None, unit="s", low=0.0, above=True, otherwise="the controller's step",
    )  # fmt: skip
    individual_pitch: bool = option(
        "whether each blade has its own demand: records 42 to 44 or record 45", default=True, unit="-"
    )
    isolated: bool = option(
        "whether it runs in a process of its own, so that a crash of it ends the episode and not this process",
        default=False, unit="-",
    )  # fmt: skip
    lidar: bool | Lidar = option(
        "lidar that it reads; True: three gates by the rotor's size", default=False, unit="-", kinds=(Lidar,)
    )


def _indices(given_by: str) -> np.ndarray:
    """Indices of all records that one side writes."""
    return np.array(sorted(n - 1 for record in RECORDS if record.given_by == given_by for n in record.numbers))


_READ = _indices("simulation")
"""Readings, status, time and interval among them."""
_DEMANDS = _indices("controller")
_AZIMUTH = int(np.flatnonzero(_READ == AZIMUTH)[0])


class BladedController:
    """A compiled controller with the Bladed interface (``DISCON``) behind the contract of controllers.

    The library is called with the readings of `wt_gym.control.bladed.records`, and its demands hold until the next
    call. Pitch drives, rate limits and torque limits are the simulator's.

    A library has one memory and cannot be copied. So that snapshots and copies of environments work all the same, this
    object keeps all readings since the start: a copy loads the library again and repeats the calls when it is first
    asked for a demand. A library that depends on anything but its readings is refused then.

    Parameters
    ----------
    input_file : str or path, optional
        Handed to the library by its absolute path.
    **parameters
        Of `BladedOptions`.

    Raises
    ------
    FileNotFoundError, ValueError, wt_gym.base.errors.ControllerError
        If a file does not exist; if there is no library, or it cannot be loaded; for more than three blades.
    """

    def __init__(
        self, turbine: Turbine, library: str | Path | None = None, input_file: str | Path | None = None,
        **parameters: Any,
    ) -> None:  # fmt: skip
        o = BladedOptions(library=library, input_file=input_file, **parameters)  # type: ignore[arg-type]  # checked
        if o.library is None:
            raise ValueError("the controller 'bladed' must be given a library: bladed:path/of/the/library.so")
        if turbine.n_blades > MAX_BLADES:
            raise ControllerError(
                f"the Bladed interface has records for at most {MAX_BLADES} blades, the turbine has {turbine.n_blades}"
            )
        self.turbine = turbine
        self.library = Path(o.library).expanduser().resolve()
        self.input_file = "" if o.input_file is None else str(Path(o.input_file).expanduser().resolve())
        if self.input_file and not Path(self.input_file).is_file():
            raise FileNotFoundError(f"there is no input file {self.input_file} of the controller library")
        self.function, self.interval = o.function, o.interval
        self.individual_pitch, self.isolated = o.individual_pitch, o.isolated
        check_library(self.library, o.function)
        self.lidar = (Lidar.for_rotor(turbine.rotor_diameter) if o.lidar is True else o.lidar) or None
        """Lidar that `wt_gym.control.controllers.lidar_of` returns."""
        if self.lidar is not None:
            check_points(self.lidar, "on the Bladed interface")
        self.channels = channels_read(turbine.n_blades, self.lidar, turbine.floater is not None)
        self._read = np.concatenate([_READ, lidar_indices(self.lidar)])
        self._kept = np.concatenate([self._read, _DEMANDS])  # what is noted of a call
        self._loaded: Library | None = None
        self._swap = new_swap()
        self._calls: list[np.ndarray] = []  # records of each call, up to the last one that is not zero
        self._begin = self._now = math.nan
        self._readings = self._swap[self._read]
        self._warned: set[str] = set()

    # ---- the contract ----------------------------------------------------------------------------------------------

    def start(self, signals: Readings, demand: Demand) -> None:
        """Load the library afresh; the current demand holds where it demands nothing.

        Its first call waits for the first step, which tells the interval of the calls: libraries make their filters
        for it.
        """
        self.close()
        self._begin = self._now = signals["time"]
        self._calls = []
        self._load(demand)
        self._write(signals)
        self._readings = self._swap[self._read]

    def step(self, signals: Readings, dt: float) -> Demand:
        """Demand for the next ``dt`` [s].

        Raises
        ------
        wt_gym.base.errors.SimulationError
            If the library says that it failed, or demands what is not finite.
        """
        self._revive()
        if not self._calls:
            self._call(FIRST_CALL, 0.0, dt / self._count(dt))
        time = signals["time"]
        elapsed = time - self._now
        if elapsed > 1e-9:
            swap, before, count = self._swap, self._readings, self._count(elapsed)
            self._write(signals)
            after = swap[self._read]
            change = after - before
            change[_AZIMUTH] = math.remainder(change[_AZIMUTH], 2.0 * math.pi)
            for k in range(1, count + 1):
                swap[self._read] = after if k == count else before + np.float32(k / count) * change
                self._call(STEP, self._now + k / count * elapsed - self._begin, elapsed / count)
            self._readings, self._now = after, time
        pitch, yaw_rate, torque = demand_of(self._swap, self.turbine.n_blades, self.individual_pitch)
        return Demand(pitch, yaw_rate, torque)

    def close(self) -> None:
        """Make the last call and unload the library."""
        if self._loaded is None:
            return
        loaded, self._loaded = self._loaded, None
        self._swap[0] = LAST_CALL
        try:
            if loaded.alive and self._calls:
                loaded.call(self._swap, self.input_file)
        finally:
            loaded.close()

    # ---- calls -----------------------------------------------------------------------------------------------------

    def _load(self, demand: Demand | None) -> None:
        """Load the library, and write what the turbine is and what is demanded before the first call."""
        self._loaded = Library(self.library, self.function, self.isolated)
        self._swap = new_swap()
        write_turbine(self._swap, self.turbine, self.individual_pitch, (self.input_file, self._loaded.output_name))
        if demand is not None:
            write_demand(self._swap, demand)

    def _write(self, signals: Readings) -> None:
        """Write the readings of an instant."""
        write_readings(self._swap, signals, self.turbine.n_blades)
        if self.turbine.floater is not None:
            write_platform(self._swap, signals)
        if self.lidar is not None:
            write_lidar(self._swap, signals, self.lidar, self.turbine.hub_height, self.turbine.rotation)

    def _count(self, elapsed: float) -> int:
        """Calls in an interval of the controller."""
        return 1 if self.interval is None else max(1, math.ceil(elapsed / self.interval - 1e-6))

    def _call(self, status: int, time: float, interval: float) -> None:
        """Call the library, and note the call."""
        swap = self._swap
        swap[0], swap[1], swap[2] = status, time, interval
        self._calls.append(swap[self._kept].copy())
        self._answer(swap)

    def _answer(self, swap: np.ndarray) -> None:
        """Have the library answer to records, and look at what it says."""
        assert self._loaded is not None
        flag, message = self._loaded.call(swap, self.input_file)
        if flag < 0:
            raise SimulationError(
                f"the controller library {self.library.name} failed: {message or 'without a message'}"
            )
        if flag > 0 and message not in self._warned:
            self._warned.add(message)
            _log.warning("controller library %s: %s", self.library.name, message)
        demanded = swap[41:48].tolist()
        if not math.isfinite(sum(demanded)):
            raise SimulationError(
                f"the controller library {self.library.name} demands what is not finite: pitch {demanded[:4]} rad, "
                f"torque {demanded[5]} N m, yaw rate {demanded[6]} rad/s"
            )

    # ---- copies ----------------------------------------------------------------------------------------------------

    def __getstate__(self) -> dict[str, Any]:
        """Everything but the loaded library; noted calls never change and are shared."""
        return self.__dict__ | {
            "_loaded": None,
            "_swap": self._swap.copy(),
            "_calls": list(self._calls),
            "_warned": set(self._warned),
        }

    def __deepcopy__(self, memo: dict[int, Any]) -> "BladedController":
        made = object.__new__(type(self))
        made.__dict__.update(self.__getstate__())
        return made

    def _revive(self) -> None:
        """Bring a library of its own to where that of the original was."""
        if self._loaded is not None:
            return
        if math.isnan(self._begin):
            raise RuntimeError(f"{type(self).__name__}.step was called before start")
        expected = self._swap
        self._load(None)
        self._swap[self._kept] = expected[self._kept]
        for call in self._calls:
            self._swap[self._kept] = call
            self._answer(self._swap)
        if not np.array_equal(self._swap[_DEMANDS], expected[_DEMANDS]):
            raise SimulationError(
                f"a copy of the controller library {self.library.name} does not repeat its demands: it depends on more "
                "than its readings, so that neither snapshots nor copies of it are possible"
            )
