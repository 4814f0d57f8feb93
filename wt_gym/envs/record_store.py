"""Records of running turbines that are kept: in memory, and on disk for other processes."""

from __future__ import annotations

import contextlib
import hashlib
import logging
import os
import pickle
import threading
import zipfile
from functools import cache
from typing import TYPE_CHECKING, Any, NamedTuple

import filelock
import numpy as np

from wt_gym.control.controllers.memory import Memory
from wt_gym.envs import running_record
from wt_gym.envs.running_record import Record, StartRecorder
from wt_gym.files import whole_file
from wt_gym.simulation.state import fingerprint
from wt_gym.sources import sources_digest
from wt_gym.user_cache import user_cache
from wt_gym.wind import MirroredInflow

if TYPE_CHECKING:
    from contextlib import AbstractContextManager
    from pathlib import Path

    from wt_gym.control.controllers import Controller
    from wt_gym.envs.wind_sampler import WindSampler
    from wt_gym.turbines import Turbine
    from wt_gym.wind import Inflow

__all__ = ["digest_of_controller", "kept_record"]

_log = logging.getLogger(__name__)
_FORMAT = 8  # raise when what a record holds changes
RECORD_SEED = 7_777_000
"""First seed of the turbulence in which a turbine is recorded, none of an evaluation or training."""
_MOST, _MOST_FILES = 32, 200
_MOST_BYTES, _MOST_FILE_BYTES = 300_000_000, 2_000_000_000
"""Records in memory and files, at most: some 2 MB each, 35 MB of a controller with a long memory."""
_PARTS = ("now", "history", "thrust", "before")
_records: dict[str, Record | None] = {}
_warned: set[str] = set()
_lock = threading.Lock()


class Kept(NamedTuple):
    """What stands on the disk: a record, or None where the turbine could not run."""

    record: Record | None


def kept_record(recorder: StartRecorder, identity: str, winds: WindSampler, speed: float) -> Record | None:
    """Record at a wind speed: from memory, from the disk, or made now.

    Parameters
    ----------
    recorder : StartRecorder
    identity : str
        Of its controller, see `digest_of_controller`.
    winds : WindSampler
        Of which the turbulence is.
    speed : float
        [m/s].

    Returns
    -------
    Record or None
        None where the turbine cannot run in that wind; that is kept as a record is.
    """
    lengths = running_record.RECORDING_PLAN
    parts = _FORMAT, lengths, recorder.turbine, recorder.fidelity, winds.turbulence_key, speed, _sources(), identity
    key = fingerprint(*parts)[:32]
    with _lock:
        if key in _records:
            return _records[key]
    folder = _folder()
    with _alone(folder, key):
        kept = _load(folder, key, recorder)
        if kept is None:
            _tell(recorder.turbine)
            seeds = range(RECORD_SEED, RECORD_SEED + lengths.runs)
            inflows: list[Inflow] = [winds.turbulence(speed, seed) for seed in seeds]
            if recorder.turbine.rotation == "counter-clockwise":  # the image of what is recorded of the other rotor
                inflows = [MirroredInflow(inflow) for inflow in inflows]
            kept = Kept(recorder.record(inflows))
            _store(folder, key, kept)
    with _lock:
        new = _size(kept.record)
        while _records and (len(_records) >= _MOST or new + sum(map(_size, _records.values())) > _MOST_BYTES):
            _records.pop(next(iter(_records)))
        _records[key] = kept.record
    return kept.record


def _tell(turbine: Turbine) -> None:
    """Once."""
    if turbine.name not in _warned:
        _warned.add(turbine.name)
        _log.warning(
            "recording how %s runs in turbulence, so that episodes begin amid its operation: half a minute for each "
            "wind speed, once on this machine",
            turbine.name,
        )


def digest_of_controller(controller: Controller) -> str:
    """Digest of a built-in controller: of its parameters, and of what it remembers; the sources have their own."""
    return hashlib.sha256(pickle.dumps(controller)).hexdigest()


@cache
def _sources() -> str:
    """Digest of all that makes a record: how another version of it runs is not how this one does."""
    return sources_digest("wt_gym.envs.running_record", "wt_gym.envs.wind_sampler")


def _folder() -> Path | None:
    """Where records are kept, None if there is no such place."""
    cache = user_cache()
    if cache is None:
        return None
    folder = cache / "starts"
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        _log.warning("records of the running turbine cannot be kept in %s (%s)", folder, error)
        return None
    return folder


def _alone(folder: Path | None, key: str) -> AbstractContextManager[Any]:
    """Have other processes and threads wait that want the same record."""
    if folder is None or not os.access(folder, os.W_OK):
        return contextlib.nullcontext()
    return filelock.FileLock(folder / f"{key}.lock")


def _load(folder: Path | None, key: str, recorder: StartRecorder) -> Kept | None:
    """What stands on the disk, None if there is nothing that is sound."""
    path = None if folder is None else folder / f"{key}.npz"
    if path is None or not path.is_file():
        return None
    try:
        with np.load(path, allow_pickle=False) as file:
            if "failed" in file:
                return Kept(None)
            step, parts = float(file["step"]), {name: file[name] for name in _PARTS}
            values = np.tile(file["values"], (len(file["sizes"]), 1))
            values[:, file["changing"]] = file["changes"]
            memory, changing = Memory(values, file["sizes"]), file["changing_parts"]
        if any(len(part) != len(memory.sizes) or not np.isfinite(part).all() for part in parts.values()):
            raise ValueError("its parts do not fit together")
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile) as error:
        _log.warning("record %s of the running turbine is unreadable (%s); it is made again", path, error)
        return None
    return Kept(Record(recorder, step, **parts, memory=memory, changing=changing))


def _store(folder: Path | None, key: str, kept: Kept) -> None:
    """Keep a record, or that there is none; one that cannot be written costs the time of the next making."""
    if folder is None:
        return
    path = folder / f"{key}.npz"
    try:
        with whole_file(path) as partial, partial.open("wb") as file:
            np.savez(file, **_arrays(kept.record))
        total = 0
        newest_first = sorted(folder.glob("*.npz"), key=lambda one: one.stat().st_mtime, reverse=True)
        for number, old in enumerate(newest_first):
            total += old.stat().st_size
            if number and (number >= _MOST_FILES or total > _MOST_FILE_BYTES):
                old.unlink(missing_ok=True)
                old.with_suffix(".lock").unlink(missing_ok=True)
    except OSError as error:
        _log.warning("a record of the running turbine could not be kept in %s (%s)", folder, error)


def _size(record: Record | None) -> int:
    """Bytes of what a record holds most of."""
    return 0 if record is None else record.memory.values.nbytes + sum(getattr(record, n).nbytes for n in _PARTS)


def _arrays(record: Record | None) -> dict[str, Any]:
    """Arrays of the file of a record."""
    if record is None:
        return {"failed": True}
    values, sizes = record.memory  # hardly any of the values change
    changing = np.flatnonzero((values != values[0]).any(axis=0))
    return {name: getattr(record, name) for name in _PARTS} | {
        "step": record.step,
        "sizes": sizes,
        "values": values[0],
        "changing": changing,
        "changes": values[:, changing],
        "changing_parts": record.changing,
    }
