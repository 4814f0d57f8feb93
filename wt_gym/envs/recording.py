"""Makes records of running turbines: those of the package, of the catalog under default controllers, and the user's."""

from __future__ import annotations

import logging
import pickle
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass
from functools import lru_cache
from multiprocessing import get_context
from typing import TYPE_CHECKING

import numpy as np

from wt_gym.base.blas_threads import one_blas_thread
from wt_gym.base.errors import SimulationError
from wt_gym.base.files import write_whole
from wt_gym.control.controllers.names import make_controller
from wt_gym.envs.record_store import (
    FOLDER,
    StartFile,
    digest_of_turbine,
    dimensions,
    make_recorder,
    record_canary,
    recorded_speeds,
)
from wt_gym.envs.running_record import PLAN, ControllerForm, Instants, RowLayout, StartRecorder
from wt_gym.envs.wind_sampler import WindOptions, WindSampler
from wt_gym.simulation.contract import fingerprint
from wt_gym.simulation.fidelity import suited_fidelity
from wt_gym.turbine_records import RECORDS
from wt_gym.turbines import load_turbine
from wt_gym.wind import TurbulentInflow

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from wt_gym.base.canary import Canary
    from wt_gym.turbines import Turbine

__all__ = ["CATALOG", "RecordedTurbine", "make_record"]

_log = logging.getLogger(__name__)
_SEED = 7_777_000
"""First seed of the recorded turbulence, none of an evaluation or training; a thousand for each m/s."""
_RUNS = {"nrel_5mw": 12, "iea_15mw": 8, "iea_22mw": 8}
"""Winds at a wind speed: most for turbines of tasks."""
_ATTEMPTS = 3
"""Winds of a run: a gust may stop a turbine at cut-out by its overspeed."""


@dataclass(frozen=True)
class RecordedTurbine:
    """A turbine and its controller.

    Attributes
    ----------
    turbine : str
        Name or path.
    controller : str
        Name.
    level : float
        Demanded power over the available one [-]; 1: nothing is demanded.
    fidelity : str, optional
        Of the runs, by default that which suits the blades (`wt_gym.simulation.fidelity.suited_fidelity`).
    runs : int
        Winds at a wind speed.
    """

    turbine: str
    controller: str = "discon"
    level: float = 1.0
    fidelity: str | None = None
    runs: int = 8

    @property
    def name(self) -> str:
        """Name of the file in the package."""
        return self.turbine if self.level == 1.0 else f"{self.turbine}-{self.level:g}"

    @property
    def run_fidelity(self) -> str:
        """Fidelity of the runs."""
        return suited_fidelity(load_turbine(self.turbine)) if self.fidelity is None else self.fidelity

    @property
    def key(self) -> str:
        """Digest of all on which the runs depend, besides the program."""
        turbine = load_turbine(self.turbine)
        return fingerprint(turbine, self.run_fidelity, self.controller, self.level, self.runs, PLAN)[:16]

    def recorder(self, speed: float) -> StartRecorder:
        """Recorder at a wind speed [m/s]."""
        return make_recorder(load_turbine(self.turbine), self.run_fidelity, self.controller, self.level, speed)

    def canary(self) -> Canary:
        """Canary of the record."""
        return record_canary(load_turbine(self.turbine), self.run_fidelity, self.controller, self.level)

    def inflow(self, speed: float, run: int) -> TurbulentInflow:
        """Wind of a run at a wind speed [m/s]."""
        return _winds(load_turbine(self.turbine)).turbulence(speed, _SEED + 1000 * round(speed) + run)

    def run(self, speed: float, run: int) -> Instants:
        """Record a run at a wind speed [m/s], in another wind where the turbine does not come through that of the run.

        Raises
        ------
        wt_gym.base.errors.SimulationError
            If it comes through none of `_ATTEMPTS`.
        """
        recorder = self.recorder(speed)
        for attempt in range(_ATTEMPTS - 1):
            try:
                return recorder.run(self.inflow(speed, run + attempt * self.runs), PLAN)
            except SimulationError as error:
                _log.info("%s does not run in wind %d at %g m/s (%s)", self.turbine, run, speed, error)
        return recorder.run(self.inflow(speed, run + (_ATTEMPTS - 1) * self.runs), PLAN)


CATALOG = (
    *(RecordedTurbine(name, runs=_RUNS.get(name, 4)) for name in RECORDS),
    RecordedTurbine("nrel_5mw", "discon+derate_kinetic", 0.85, runs=8),
)
"""Records of the package: they serve every id of an environment with its default options."""


@lru_cache(maxsize=1)
def _winds(turbine: Turbine) -> WindSampler:
    return WindSampler(turbine, WindOptions(inflow="turbulent"))


def make_record(
    recorded: RecordedTurbine, path: Path, pieces: Path, processes: int, report: Callable[[int, int], None]
) -> None:
    """Record a turbine, and write the file.

    Parameters
    ----------
    path : pathlib.Path
        Of the file.
    pieces : pathlib.Path
        Folder of the runs that are done: they are not made again. With the file they are removed.
    report : callable
        Gets the number of finished runs, and of all.

    Raises
    ------
    wt_gym.base.errors.SimulationError
        If the turbine cannot run in a wind.
    """
    turbine = load_turbine(recorded.turbine)
    speeds = recorded_speeds(turbine)
    runs = [(speed, run) for speed in speeds.tolist() for run in range(recorded.runs)]
    pieces.mkdir(parents=True, exist_ok=True)
    files = [pieces / f"{speed:g}-{run}.pickle" for speed, run in runs]
    done = sum(file.is_file() for file in files)
    with ProcessPoolExecutor(processes, mp_context=get_context("spawn")) as pool:
        work = [
            pool.submit(_store_run, recorded, *run, file)
            for run, file in zip(runs, files, strict=True)
            if not file.is_file()
        ]
        try:
            for future in as_completed(work):
                future.result()
                done += 1
                report(done, len(runs))
        finally:  # after an interrupt or a failure nobody waits for the runs that have not begun
            pool.shutdown(wait=False, cancel_futures=True)
    results: list[Instants] = [pickle.loads(file.read_bytes()) for file in files]
    memories = [memory for result in results for memory in result.memories]
    controller = make_controller(recorded.controller, turbine)
    form = ControllerForm.of(controller, memories)
    rows = np.array([result.rows for result in results])
    numbers = form.numbers(memories).reshape(*rows.shape[:2], -1)
    rows = np.concatenate([rows, numbers], axis=-1).reshape(len(speeds), -1, rows.shape[-1] + numbers.shape[-1])
    digest = "" if path.parent == FOLDER else digest_of_turbine(turbine)
    head = StartFile(
        turbine.name, dimensions(turbine), recorded.run_fidelity, recorded.controller, recorded.level, form.kind,
        results[0].rows.shape[1] - RowLayout.of(turbine.n_blades, 0).memory.start,
        recorded.canary(), digest,
    )  # fmt: skip
    head.write(path, speeds, rows, form)
    for file in files:
        file.unlink()


def _store_run(recorded: RecordedTurbine, speed: float, run: int, file: Path) -> None:
    """Record a run into a file."""
    with one_blas_thread():
        result = recorded.run(speed, run)
    write_whole(file, lambda stream: pickle.dump(result, stream))
