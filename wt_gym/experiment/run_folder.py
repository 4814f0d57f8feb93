"""The folder of a training: what it holds, and a lock against two trainings in it."""

import json
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from wt_gym.base.files import read_json, write_text_whole
from wt_gym.experiment.store import FolderLock
from wt_gym.experiment.trained_agent import (
    BEST_MODEL_FILE,
    BEST_NORMALIZATION_FILE,
    MODEL_FILE,
    NORMALIZATION_FILE,
    RECORD_FILE,
    read_record,
)

SEEDS_FILE = "seeds.json"
"""Plan and summary of a training with several seeds."""

_BUFFER_FILE = "replay_buffer.pkl"
_CHECKPOINTS, _TENSORBOARD = "checkpoints", "tensorboard"
_FILES = (
    MODEL_FILE, NORMALIZATION_FILE, RECORD_FILE, BEST_MODEL_FILE, BEST_NORMALIZATION_FILE, _BUFFER_FILE, SEEDS_FILE,
)  # fmt: skip
_CHECKPOINT_FILES = ("*_steps.zip", "*_steps.pkl")
_RECORDINGS = "recordings"


def seed_folder(folder: Path, seed: int) -> Path:
    """Folder of one seed in that of a training with several."""
    return folder / f"seed-{seed}"


def read_plan(folder: Path) -> dict[str, Any]:
    """Read the plan of a training with several seeds: which ones are its own, whatever other folders there are.

    Returns ``seeds``, ``config`` (`wt_gym.learning.options.TrainingConfig.to_json`) and, once there is one,
    ``summary``. Raises a `FileNotFoundError` if the folder holds no such training, a `ValueError` if the plan is
    damaged.
    """
    file = folder / SEEDS_FILE
    plan: dict[str, Any] = read_json(file)
    seeds = plan.get("seeds")
    if not (isinstance(seeds, list) and seeds and all(isinstance(seed, int) for seed in seeds) and "config" in plan):
        raise ValueError(f"{file} is damaged: it must name the seeds and the configuration of a training")
    return plan


class RunFolder(FolderLock):
    """Folder of one training; a context that holds its lock, see `FolderLock`."""

    subfolders = (_CHECKPOINTS,)

    def __init__(self, path: str | Path):
        super().__init__(path, "training")
        self.model = self.path / MODEL_FILE  #: as it was last saved
        self.normalization, self.buffer = self.path / NORMALIZATION_FILE, self.path / _BUFFER_FILE  #: of the model
        self.checkpoints = self.path / _CHECKPOINTS  #: models on the way
        self.tensorboard = self.path / _TENSORBOARD  #: figures

    @property
    def recordings(self) -> Path:
        """Folder of the recorded episodes of a pretraining; all seeds of a training have one."""
        with_seeds = (self.path.parent / SEEDS_FILE).is_file()
        return (self.path.parent if with_seeds else self.path) / _RECORDINGS

    def remove_recordings(self) -> None:
        """Remove the recorded episodes in this folder, which nothing needs after the training."""
        shutil.rmtree(self.path / _RECORDINGS, ignore_errors=True)

    @property
    def used(self) -> bool:
        """Whether a training has been here."""
        return any(True for _ in self._left())

    def refuse_used(self, overwrite: bool) -> None:
        """Refuse a folder in which a training has been, unless that is to be overwritten."""
        if self.used and not overwrite:
            raise ValueError(f"{self.path} holds a training already: resume it, overwrite it, or take another folder")

    def record(self) -> dict[str, Any]:
        """Read the record; a `FileNotFoundError` if there is none, a `ValueError` if it is damaged."""
        file = self.path / RECORD_FILE
        if not file.is_file():
            more = "; a stopped pretraining resumes by the command that began it" if self.recordings.is_dir() else ""
            raise FileNotFoundError(f"{self.path} holds no training: there is no {RECORD_FILE}{more}")
        return read_record(file)

    def write_record(self, record: dict[str, Any]) -> None:
        """Write the record; arguments of an environment that JSON does not know are written as text."""
        text = json.dumps(record, indent=1, default=str) + "\n"
        write_text_whole(self.path / RECORD_FILE, text)

    def clear(self) -> None:
        """Remove what a training left here, and nothing else; folders of single seeds stay."""
        for file in list(self._left()):
            file.unlink()
        for folder in (self.checkpoints, self.tensorboard):
            if folder.is_dir() and not any(folder.iterdir()):
                folder.rmdir()

    def _left(self) -> Iterator[Path]:
        """Files that a training writes, as far as they are here."""
        yield from (self.path / name for name in _FILES if (self.path / name).is_file())
        for pattern in _CHECKPOINT_FILES:
            yield from self.checkpoints.glob(pattern)
        yield from self.tensorboard.glob("**/events.out.tfevents.*")
