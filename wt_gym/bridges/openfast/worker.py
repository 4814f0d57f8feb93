"""One simulation of OpenFAST's library in a process of its own, see `wt_gym.base.processes`.

Imports the standard library alone.
"""

import ctypes
import os
from collections.abc import Sequence
from typing import Any

_TEXT = 1025  # Length of OpenFAST's messages (IntfStrLen)
_NAME = 20  # Length of the name of a channel (ChanLen)
_MOST_CHANNELS = 4000
_FATAL = 4
_INPUTS = 51
"""Fixed inputs of FAST_Update: torque, power, yaw position and rate, three pitches, brake, flaps and cables."""
N_DEMANDS = 6
"""Numbers of a row of demands: pitch of three blades [rad], torque [N m], yaw [rad], yaw rate [rad/s]."""


class Failure(Exception):
    """OpenFAST refuses or gives up."""


class OpenFAST:
    """One simulation of the library, which answers requests."""

    def start(
        self, library: str, model: str, relay: str | None, row: Sequence[float]
    ) -> tuple[float, list[str], bytes]:
        """Load the library and initialize at a row of demands; its step [s], names of the outputs and their values.

        Parameters
        ----------
        library, model : str
            Paths.
        relay : str or None
            Path of the library that hands over the demands; None: they are inputs of FAST_Update.
        """
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
        raw = names.raw
        parts = [raw[_NAME * k : _NAME * (k + 1)] for k in range(count.value)]
        self.inputs, self.outputs = (ctypes.c_double * _INPUTS)(), (ctypes.c_double * count.value)()
        self.sizes = ctypes.c_int(_INPUTS), ctypes.c_int(count.value)
        self.demand(row)
        self.call("FAST_Start", self.turbine, *self.sizes, self.inputs, self.outputs)
        return step.value, [part.decode("ascii", "replace").strip(" \0") for part in parts], bytes(self.outputs)

    def call(self, name: str, *values: Any) -> None:
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

    def advance(self, rows: Sequence[float]) -> bytes:
        """One step a row of demands; the bytes of all outputs."""
        taken, over = [], ctypes.c_bool(False)
        for k in range(0, len(rows), N_DEMANDS):
            self.demand(rows[k : k + N_DEMANDS])
            self.call("FAST_Update", self.turbine, *self.sizes, self.inputs, self.outputs, over)
            if over.value:
                raise Failure("the simulation is at its end (TMax)")
            taken.append(bytes(self.outputs))
        return b"".join(taken)


begin, FAILURES = OpenFAST, (Failure, OSError, AttributeError, ValueError)
