"""One simulation of OpenFAST's library in a process of its own, see `wt_gym.base.child_process`.

Imports the standard library alone.
"""

import ctypes
import os
from collections.abc import Sequence

_TEXT = 1025
"""Length of OpenFAST's messages (IntfStrLen)."""
_NAME = 20
"""Length of the name of a channel (ChanLen)."""
_MOST_CHANNELS = 4000
_FATAL = 4
_INPUTS = 51
"""Fixed inputs of FAST_Update: torque, power, yaw position and rate, three pitches, brake, flaps and cables."""
N_DEMANDS = 6
"""Numbers of a row of demands: pitch of three blades [rad], torque [N m], yaw [rad], yaw rate [rad/s]."""


class Failure(Exception):
    """OpenFAST refuses or gives up."""


class OpenFAST:
    """One simulation of the library.

    Parameters
    ----------
    library, model : str
        Paths.
    relay : str or None
        Path of the library that hands over the demands; None: they are inputs of FAST_Update.
    """

    def __init__(self, library: str, model: str, relay: str | None):
        self.lib = ctypes.CDLL(library)
        self.error, self.message = ctypes.c_int(0), ctypes.create_string_buffer(_TEXT)
        self.fatal, self.turbine = _FATAL, ctypes.c_int(0)
        self.demands: ctypes.Array[ctypes.c_double] | None = None
        if relay is not None:
            self.demands = (ctypes.c_double * 5).in_dll(ctypes.CDLL(relay), "wt_gym_demands")
        self.call("FAST_AllocateTurbines", ctypes.c_int(1))
        count, fatal = ctypes.c_int(), ctypes.c_int()
        step, output_step, end = ctypes.c_double(), ctypes.c_double(), ctypes.c_double()
        names = ctypes.create_string_buffer(_NAME * _MOST_CHANNELS + 1)
        path = ctypes.create_string_buffer(os.fsencode(model), _TEXT)
        refs = [ctypes.byref(value) for value in (fatal, count, step, output_step, end, self.error)]
        self.lib.FAST_Sizes(ctypes.byref(self.turbine), path, *refs, self.message, names, None, None)
        self.check("FAST_Sizes")
        self.fatal = fatal.value or _FATAL
        self.step, raw = step.value, names.raw
        parts = (raw[_NAME * k : _NAME * (k + 1)] for k in range(count.value))
        self.names = [part.decode("ascii", "replace").strip(" \0") for part in parts]
        self.inputs, self.outputs = (ctypes.c_double * _INPUTS)(), (ctypes.c_double * count.value)()
        self.sizes = ctypes.c_int(_INPUTS), ctypes.c_int(count.value)
        self.over = ctypes.c_bool(False)

    def call(self, name: str, *values: ctypes.c_int) -> None:
        """Call a function whose last arguments are error and message."""
        getattr(self.lib, name)(*map(ctypes.byref, values), ctypes.byref(self.error), self.message)
        self.check(name)

    def check(self, name: str) -> None:
        """Raise for an error."""
        if self.error.value >= self.fatal:
            said = " ".join(self.message.value.decode("utf-8", "replace").split())
            raise Failure(said or f"{name} failed with error {self.error.value}")

    def demand(self, row: Sequence[float]) -> None:
        """Hand over a row of demands."""
        *pitch, torque, yaw, yaw_rate = row
        if self.demands is not None:
            self.demands[:] = [*pitch, torque, yaw_rate]
        else:
            self.inputs[0], self.inputs[2], self.inputs[3] = torque, yaw, yaw_rate
            self.inputs[4:7] = [*pitch]

    def start(self, row: Sequence[float]) -> None:
        """Initialize at the first row of demands."""
        self.demand(row)
        n_in, n_out = (ctypes.byref(size) for size in self.sizes)
        turbine, error = ctypes.byref(self.turbine), ctypes.byref(self.error)
        self.lib.FAST_Start(turbine, n_in, n_out, self.inputs, self.outputs, error, self.message)
        self.check("FAST_Start")

    def advance(self, rows: Sequence[float]) -> bytes:
        """One step a row of demands; the bytes of all outputs."""
        n_in, n_out = (ctypes.byref(size) for size in self.sizes)
        turbine, over, error = ctypes.byref(self.turbine), ctypes.byref(self.over), ctypes.byref(self.error)
        taken = []
        for k in range(0, len(rows), N_DEMANDS):
            self.demand(rows[k : k + N_DEMANDS])
            self.lib.FAST_Update(turbine, n_in, n_out, self.inputs, self.outputs, over, error, self.message)
            self.check("FAST_Update")
            if self.over.value:
                raise Failure("the simulation is at its end (TMax)")
            taken.append(bytes(self.outputs))
        return b"".join(taken)


class Simulation:
    """What answers requests."""

    def __init__(self) -> None:
        self._openfast: OpenFAST | None = None

    def start(
        self, library: str, model: str, relay: str | None, row: Sequence[float]
    ) -> tuple[float, list[str], bytes]:
        """Load the library and initialize; its step [s], names of the outputs and their values."""
        self._openfast = openfast = OpenFAST(library, model, relay)
        openfast.start(row)
        return openfast.step, openfast.names, bytes(openfast.outputs)

    def advance(self, rows: Sequence[float]) -> bytes:
        """One step a row of demands; the bytes of all outputs."""
        if self._openfast is None:
            raise Failure("nothing was started")
        return self._openfast.advance(rows)


begin, FAILURES = Simulation, (Failure, OSError, AttributeError, ValueError)
