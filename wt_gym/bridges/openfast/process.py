"""One simulation of OpenFAST in a process of its own, which a crash of the library ends and nothing else."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from wt_gym.base.child_process import ChildEndedError, ChildFailedError, ChildProcess
from wt_gym.base.errors import SimulationError
from wt_gym.bridges.openfast import worker

if TYPE_CHECKING:
    from numpy.typing import NDArray

__all__ = ["OpenFASTProcess"]

_LAST_WORDS = 600
"""Characters of OpenFAST's output that a message shows."""


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
        self._child = ChildProcess(Path(worker.__file__), (), log, model.parent)
        start = str(library), str(model), None if relay is None else str(relay), demands.tolist()
        self.step, self.names, outputs = self._ask("start", *start)
        self.outputs = np.frombuffer(outputs)

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
