"""Records of the turbines of the catalog, from which episodes in turbulence start: files of the package.

A file holds a turbine under its default controller at wind speeds from cut-in to cut-out. Each column at a wind speed
is stored in 16 bits, between its least and its largest value. ``wt-gym record`` makes the files. The start of an
episode depends on them alone, on every machine. Their canary, samples of a short run (`record_canary`), tells a version
of the package that moves the turbine in another way from the one that recorded it.

Turbines of the user have such files in their cache. They serve the very turbine that was recorded, as long as the
package moves it as it did then; a test checks the records of the package.
"""

import hashlib
import json
import logging
import math
import pickle
import zipfile
import zlib
from collections.abc import Callable
from dataclasses import asdict, dataclass
from functools import cache, lru_cache
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from wt_gym.base.canary import Canary, cached_canary, canary_differences, canary_text
from wt_gym.base.errors import SimulationError
from wt_gym.base.files import write_whole
from wt_gym.base.processes import one_blas_thread
from wt_gym.base.user_cache import user_cache
from wt_gym.control.controllers.names import make_controller
from wt_gym.envs.power import available_power
from wt_gym.envs.running_record import (
    FLOATING_PLAN,
    PLAN,
    ControllerForm,
    Instants,
    Record,
    RecordingPlan,
    RowLayout,
    StartRecorder,
)
from wt_gym.envs.sea import recorded_sea
from wt_gym.envs.wind_sampler import WindOptions, WindSampler
from wt_gym.simulation.contract import fingerprint
from wt_gym.simulation.fidelity import suited_fidelity
from wt_gym.turbine_records import RECORDS
from wt_gym.turbines import BeamStations, Turbine, load_turbine
from wt_gym.wind import TurbulentInflow

_log = logging.getLogger(__name__)
_T = TypeVar("_T")
FOLDER = Path(__file__).parent / "starts"
"""Folder of the records."""
BIN = 2.0
"""Distance of the recorded wind speeds [m/s]."""
_CANARY_PLAN = RecordingPlan(settling=10.0, instants=4, spacing=3.0)
_CANARY_SEED = 7_777_000
_CANARY_SITE = {"air_density": 1.225, "turbulence_class": "B", "rotation": "clockwise"}
_LAST_CODE = 65_535
_SAME = 1e-3
"""Relative difference of dimensions up to which a turbine is the recorded one: a site changes nothing of them."""
_DAMAGED = (OSError, ValueError, KeyError, TypeError, EOFError, zipfile.BadZipFile, zlib.error)
"""Errors of reading a file that is cut off or none of a record."""


@dataclass(frozen=True)
class StartFile:
    """A record as it is stored."""

    turbine: str  #: Name
    dimensions: tuple[float, ...]  #: result of `dimensions`
    fidelity: str
    controller: str  #: Name
    level: float  #: Demanded power over the available one [-]
    kind: str  #: as of `wt_gym.envs.running_record.ControllerForm`
    n_motion: int  #: Numbers of the motion of the structure
    canary: Canary  #: `record_canary` of the version of the package that recorded
    turbine_digest: str = ""  #: `digest_of_turbine` in a record of the user

    @classmethod
    def of(cls, path: Path) -> "StartFile":
        """Head of a file."""
        with np.load(path, allow_pickle=False) as file:
            head = json.loads(str(file["head"]))
        return cls(**head | {"dimensions": tuple(head["dimensions"])})

    def fits(self, turbine: Turbine) -> bool:
        """Return True if name and dimensions are those of a turbine, which may turn in the other sense."""
        sizes = np.abs(self.dimensions), np.abs(dimensions(turbine))
        return self.turbine == turbine.name and np.allclose(*sizes, rtol=_SAME)

    def mirrors(self, turbine: Turbine) -> bool:
        """Return True if the recorded rotor turns in the other sense than that of a turbine."""
        return self.dimensions[0] * dimensions(turbine)[0] < 0.0

    def write(
        self, path: Path, speeds: NDArray[np.float64], rows: NDArray[np.float64], form: ControllerForm
    ) -> None:  # fmt: skip
        """Write the file of a record; the parameters are those of `Record`."""
        codes, low, unit = _packed(rows)
        arrays: dict[str, Any] = {
            "head": json.dumps(asdict(self)), "speeds": speeds, "codes": codes, "low": low, "unit": unit,
            "values": form.values, "sizes": form.sizes, "changing": form.changing,
        }  # fmt: skip
        write_whole(path, lambda file: np.savez_compressed(file, **arrays))

    def read(self, path: Path) -> Record:
        """Read the record."""
        with np.load(path, allow_pickle=False) as file:
            form = ControllerForm(self.kind, file["values"], file["sizes"], file["changing"])
            rows = file["low"][:, None] + file["unit"][:, None] * file["codes"].transpose(0, 2, 1)
            return Record(abs(int(self.dimensions[0])), self.n_motion, file["speeds"], rows, form)


def dimensions(turbine: Turbine) -> tuple[float, ...]:
    """Dimensions that tell a turbine from others of its name: blades, diameter and hub height [m], rated power [W].

    The sense of rotation is their sign.
    """
    sense = -1.0 if turbine.rotation == "counter-clockwise" else 1.0
    return (
        sense * turbine.n_blades, turbine.rotor_diameter, turbine.hub_height, turbine.drivetrain.rated_power,
    )  # fmt: skip


def recorded_speeds(turbine: Turbine) -> NDArray[np.float64]:
    """Wind speeds at which a turbine is recorded: cut-in, cut-out, and every `BIN` between them [m/s]."""
    low, high = turbine.cut_in, turbine.cut_out
    between = BIN * np.arange(math.floor(low / BIN) + 1, math.ceil(high / BIN))
    return np.array([low, *between.tolist(), high])


def find_record(turbine: Turbine, level: float, floating: bool = False) -> tuple[StartFile, Record] | None:
    """Record of a turbine, of the package or the user, with the nearest `StartFile.level`; None where there is none.

    With ``floating`` one under a controller that damps the platform goes before others.
    """
    path = _path_of(turbine, level, floating)
    record = None if path is None else _read(path)
    return None if path is None or record is None else (_heads()[path], record)


def user_record_digest(turbine: Turbine) -> str | None:
    """Digest of the records of the user from which episodes of a turbine start; None where there are others or none."""
    paths = {_path_of(turbine, 1.0, floating) for floating in (False, True)}
    own = [path for path in paths if path is not None and path.parent != FOLDER and _read(path) is not None]
    return "-".join(sorted(map(_digest_of_file, own))) or None


def digest_of_turbine(turbine: Turbine) -> str:
    """Digest of all of a turbine that a site leaves as it is."""
    return fingerprint(
        turbine.name, dimensions(turbine)[1:], turbine.n_blades, turbine.blade, turbine.tower, turbine.hub,
        turbine.nacelle, turbine.drivetrain, turbine.pitch, turbine.control,
        *(() if turbine.floater is None else (turbine.floater,)),
    )[:16]  # fmt: skip


def make_recorder(turbine: Turbine, fidelity: str, controller: str, level: float, speed: float) -> StartRecorder:
    """Recorder of a turbine at a mean wind speed [m/s]; the parameters are those of `StartFile`."""
    power = None if level == 1.0 else level * available_power(turbine, speed)
    return StartRecorder(turbine, fidelity, make_controller(controller, turbine), power)


def record_canary(turbine: Turbine, fidelity: str, controller: str, level: float) -> Canary:
    """Canary of a record: instants of a short run in turbulence, at a site that is the same for all.

    Raises
    ------
    wt_gym.base.errors.SimulationError
        If the turbine does not come through the run.
    """

    def measure() -> Canary:
        sited = turbine.with_site(**_CANARY_SITE)
        speed = 1.2 * sited.rated_wind_speed
        inflow = WindSampler(sited, WindOptions(inflow="turbulent")).turbulence(speed, _CANARY_SEED)
        sea = recorded_sea(sited, speed, _CANARY_SEED)
        rows = make_recorder(sited, fidelity, controller, level, speed).run(inflow, _CANARY_PLAN, sea).rows
        n_motion = rows.shape[1] - RowLayout.of(turbine.n_blades, 0).memory.start
        places = RowLayout.of(turbine.n_blades, n_motion)._asdict().items()
        return {f"{part}[{k}]": canary_text(row) for part, place in places for k, row in enumerate(rows.T[place])}

    return cached_canary("record", fingerprint(turbine, fidelity, controller, level), measure)


def _path_of(turbine: Turbine, level: float, floating: bool) -> Path | None:
    """File of the record of a turbine with the nearest level: one of the package, else one of the user."""
    named = [path for path, file in _heads().items() if file.fits(turbine)]
    fitting = [path for path in named if path.parent == FOLDER and _is_of_catalog(path.stem, turbine)]
    if not fitting:
        fitting = [path for path in named if path.parent != FOLDER and _is_of_user(path, turbine)]
    heads = _heads()
    distances = {
        path: (abs(heads[path].level - level), (heads[path].controller == "floating") != floating) for path in fitting
    }
    return min(fitting, key=distances.__getitem__, default=None)


@lru_cache(maxsize=64)
def _is_of_catalog(stem: str, turbine: Turbine) -> bool:
    """Return True if structure and blades of a turbine are those of the record of the package with this file name."""
    name = stem if stem in RECORDS else stem.rpartition("-")[0]  # without the level
    recorded = load_turbine(name)
    return recorded is turbine or np.allclose(_structure(recorded), _structure(turbine), rtol=_SAME)


def _structure(turbine: Turbine) -> list[float]:
    """Numbers that tell structures and blades of the same dimensions from one another, as integrals along them."""
    blade, support = turbine.blade, turbine.tower.support
    planform = [float(np.trapezoid(np.abs(values), blade.aero_station)) for values in (blade.chord, blade.twist)]
    below = [0.0] * 4 if support is None else _beam(support.structure)
    ground = None if support is None else support.foundation
    return [
        *planform, *_beam(blade.structure), *_beam(turbine.tower.structure), *below,
        0.0 if ground is None else float(np.trace(ground)),
        turbine.hub.mass, turbine.nacelle.mass, turbine.drivetrain.rated_rotor_speed,
    ]  # fmt: skip


def _beam(beam: BeamStations) -> list[float]:
    """Mass, and integrals of the two bending stiffnesses and of their flexibility."""
    bending = np.diagonal(beam.stiffness, axis1=1, axis2=2)[:, 3:5].T
    values = beam.inertia[:, 0, 0], *bending, (1.0 / bending).sum(axis=0)
    return [float(np.trapezoid(each, beam.station)) for each in values]


@lru_cache(maxsize=64)
def _is_of_user(path: Path, turbine: Turbine) -> bool:
    """Return True if a record of the user is of this turbine, and was made by this program."""
    head = _heads()[path]
    if head.turbine_digest != digest_of_turbine(turbine):
        return False
    try:
        present = record_canary(turbine, head.fidelity, head.controller, head.level)
        differences = canary_differences(head.canary, present)
    except SimulationError as error:
        differences = [str(error)]
    if differences:
        _log.warning("the record %s is of another behavior (%s): record again", path, differences[0])
    return not differences


@lru_cache(maxsize=1)
def _heads() -> dict[Path, StartFile]:
    """Files of the package, and of the user those that can be read."""
    heads: dict[Path, StartFile] = {path: StartFile.of(path) for path in sorted(FOLDER.glob("*.npz"))}
    own = user_folder()
    for path in [] if own is None else sorted(own.glob("*.npz")):
        head = _unless_damaged(path, StartFile.of)
        if head is not None:
            heads[path] = head
    return heads


def _unless_damaged(path: Path, read: Callable[[Path], _T]) -> _T | None:
    """Content of a file of the user; None, with a logged line, where it cannot be read."""
    try:
        return read(path)
    except _DAMAGED as error:
        _log.warning("the record %s is left aside, it cannot be read (%s): record again", path, error)
        return None


def user_folder() -> Path | None:
    """Folder of the records of the user; None where there is no cache of the user."""
    cache = user_cache()
    return None if cache is None else cache / "running"


@lru_cache(maxsize=4)
def _read(path: Path) -> Record | None:
    """Record of a file; None where one of the user is damaged."""
    read = _heads()[path].read
    return read(path) if path.parent == FOLDER else _unless_damaged(path, read)


@cache
def _digest_of_file(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()[:16]


def _packed(rows: NDArray[np.float64]) -> tuple[NDArray[np.uint16], NDArray[np.float64], NDArray[np.float64]]:
    """Codes (n_speeds, n_columns, n_instants), and least value and unit of the columns (n_speeds, n_columns)."""
    if not np.isfinite(rows).all():
        raise ValueError("a record must be of finite numbers")
    low, high = rows.min(axis=1), rows.max(axis=1)
    whole = (rows == np.round(rows)).all(axis=1) & (high - low <= _LAST_CODE)
    unit = np.where(whole, 1.0, (high - low) / _LAST_CODE)
    codes = np.round((rows - low[:, None]) / np.where(unit > 0.0, unit, 1.0)[:, None])
    return codes.transpose(0, 2, 1).astype(np.uint16), low, unit


_SEED = 7_777_000  # First seed of the recorded turbulence, none of an evaluation or training; a thousand for each m/s
_RUNS = {"nrel_5mw": 12, "iea_15mw": 8, "iea_22mw": 8, "oc4_nrel_5mw": 12, "volturnus_iea_15mw": 16}
"""Winds at a wind speed: most for turbines of tasks."""
_ATTEMPTS = 3  # Winds of a run: a gust may stop a turbine at cut-out by its overspeed


@dataclass(frozen=True)
class RecordedTurbine:
    """A turbine and its controller.

    Attributes
    ----------
    fidelity : str, optional
        Of the runs, by default that which suits the blades (`wt_gym.simulation.fidelity.suited_fidelity`).
    """

    turbine: str  #: Name or path
    controller: str = "discon"  #: Name
    level: float = 1.0  #: Demanded power over the available one [-]; 1: nothing is demanded
    fidelity: str | None = None
    runs: int = 8  #: Winds at a wind speed

    @property
    def name(self) -> str:
        """Name of the file in the package."""
        apart = [f"{self.level:g}"] * (self.level != 1.0) + ["floating"] * (self.controller == "floating")
        return "-".join([self.turbine, *apart])

    @property
    def run_fidelity(self) -> str:
        """Fidelity of the runs."""
        return suited_fidelity(load_turbine(self.turbine)) if self.fidelity is None else self.fidelity

    @property
    def key(self) -> str:
        """Digest of all on which the runs depend, besides the program."""
        turbine = load_turbine(self.turbine)
        return fingerprint(turbine, self.run_fidelity, self.controller, self.level, self.runs, PLAN, FLOATING_PLAN)[:16]

    def canary(self) -> Canary:
        """Canary of the record."""
        return record_canary(load_turbine(self.turbine), self.run_fidelity, self.controller, self.level)

    def inflow(self, speed: float, run: int) -> TurbulentInflow:
        """Wind of a run at a wind speed [m/s]."""
        winds = WindSampler(load_turbine(self.turbine), WindOptions(inflow="turbulent"))
        return winds.turbulence(speed, _SEED + 1000 * round(speed) + run)

    def run(self, speed: float, run: int) -> Instants:
        """Record a run at a wind speed [m/s], in another wind where the turbine does not come through that of the run.

        Raises
        ------
        wt_gym.base.errors.SimulationError
            If it comes through none of `_ATTEMPTS`.
        """
        turbine = load_turbine(self.turbine)
        recorder = make_recorder(turbine, self.run_fidelity, self.controller, self.level, speed)
        for attempt in range(_ATTEMPTS):
            try:
                inflow = self.inflow(speed, run + attempt * self.runs)
                return recorder.run(inflow, sea=recorded_sea(turbine, speed, _SEED + run))
            except SimulationError as error:
                _log.info("%s does not run in wind %d at %g m/s (%s)", self.turbine, run, speed, error)
                failure = error
        raise failure


CATALOG = (
    *(RecordedTurbine(name, runs=_RUNS.get(name, 4)) for name in RECORDS),
    RecordedTurbine("nrel_5mw", "discon+derate_kinetic", 0.85, runs=8),
    RecordedTurbine("volturnus_iea_15mw", "floating", runs=_RUNS["volturnus_iea_15mw"]),
)
"""Records of the package: they serve every id of an environment with its default options."""


def make_record(
    recorded: RecordedTurbine, path: Path, pieces: Path, processes: int, report: Callable[[int, int], None]
) -> None:
    """Record a turbine, and write the file.

    Parameters
    ----------
    pieces : pathlib.Path
        Folder of the runs that are done: they are not made again. With the file they are removed.
    report : callable
        Gets the number of finished runs, and of all.

    Raises
    ------
    wt_gym.base.errors.SimulationError
        If the turbine cannot run in a wind.
    """
    from concurrent.futures import ProcessPoolExecutor, as_completed  # of no use to an environment
    from multiprocessing import get_context

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
