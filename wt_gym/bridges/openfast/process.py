"""One simulation of OpenFAST in a process of its own, which a crash of the library ends and nothing else."""

from __future__ import annotations

import contextlib
import pickle
import subprocess
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from wt_gym.bridges.openfast import worker
from wt_gym.errors import SimulationError

if TYPE_CHECKING:
    from numpy.typing import NDArray

__all__ = ["OpenFASTProcess"]

_LAST_WORDS = 600
"""Characters of OpenFAST's output that a message shows."""
_PATIENCE = 5.0
"""Time that a process is given to end [s]."""


class OpenFASTProcess:
    """A simulation of OpenFAST's library that is running.

    The library keeps its state in global variables and stops its process where Fortran stops: a process for each
    simulation gives both no consequence.

    Parameters
    ----------
    library : Path
    model : Path
        Primary file.
    relay : Path or None
        Library that hands over the demands, see `wt_gym.bridges.openfast.relay`.
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

    Raises
    ------
    SimulationError
        With OpenFAST's message.
    """

    def __init__(self, library: Path, model: Path, relay: Path | None, demands: NDArray[np.float64], log: Path):
        self._log = log
        self._process: subprocess.Popen[bytes] | None = subprocess.Popen(
            [sys.executable, "-I", worker.__file__, str(log)],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, cwd=model.parent,
        )  # fmt: skip
        request = "start", str(library), str(model), None if relay is None else str(relay), demands.tolist()
        self.step, self.names, start = self._ask(*request)
        self.outputs = np.frombuffer(start)

    def advance(self, demands: NDArray[np.float64]) -> NDArray[np.float64]:
        """Advance by one step of OpenFAST for each row of demands.

        Parameters
        ----------
        demands : array (n, 6)

        Returns
        -------
        ndarray (n, n_outputs)

        Raises
        ------
        SimulationError
            With OpenFAST's message; the process has then ended.
        """
        (rows,) = self._ask("advance", demands.ravel().tolist())
        return np.frombuffer(rows).reshape(len(demands), len(self.names))

    def _ask(self, *request: object) -> list[Any]:
        process = self._process
        if process is None or process.stdin is None or process.stdout is None:
            raise SimulationError("OpenFAST is not running")
        answer: str
        values: list[Any]
        try:
            pickle.dump(request, process.stdin, protocol=pickle.HIGHEST_PROTOCOL)
            process.stdin.flush()
            answer, *values = pickle.load(process.stdout)
        except (EOFError, OSError, pickle.UnpicklingError) as error:
            code = self._end()
            raise SimulationError(f"OpenFAST crashed (exit status {code}): {self._last_words()}") from error
        if answer == "failed":
            self._end()
            raise SimulationError(f"OpenFAST: {values[0]}")
        return values

    def _last_words(self) -> str:
        try:
            text = self._log.read_text(encoding="utf-8", errors="replace")
        except OSError:
            return "it left no word"
        return " ".join(text.split())[-_LAST_WORDS:] or "it left no word"

    def _end(self) -> int | None:
        """End the process; its exit status."""
        process, self._process = self._process, None
        if process is None:
            return None
        for stream in (process.stdin, process.stdout):
            if stream is not None:
                with contextlib.suppress(OSError):
                    stream.close()
        try:
            return process.wait(_PATIENCE)
        except subprocess.TimeoutExpired:
            process.kill()
            return process.wait()

    def close(self) -> None:
        """End the simulation."""
        self._end()

    def __del__(self) -> None:
        self._end()
