"""Rewards that a controller alone has earned, kept: in memory, and on disk for other processes."""

from __future__ import annotations

import logging
import threading
import zipfile
from array import array
from collections import OrderedDict
from typing import TYPE_CHECKING

import numpy as np

from wt_gym.base.files import whole_file
from wt_gym.base.user_cache import user_cache

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

__all__ = ["MOST_FILES", "MOST_NUMBERS", "Course", "kept_course", "new_course", "store_course"]

_log = logging.getLogger(__name__)
MOST_NUMBERS = 8_000_000
"""Rewards in memory, 64 MB; the course that was asked for longest ago goes first."""
MOST_FILES = 4096
"""Files on disk, of some 30 kB for a minute by steps of 0.1 s; the oldest go first."""
_BETWEEN = 64
"""Files written between two looks at how many there are."""
_courses: OrderedDict[str, Course] = OrderedDict()
_lock, _one_writes = threading.Lock(), threading.Lock()
_written = 0


class Course:
    """Reward terms of each step from the beginning of an episode on; they are appended and never change.

    Parameters
    ----------
    key : str or None
        Name under which it is kept; None: it is not.
    names : tuple of str
        Of the terms.

    Attributes
    ----------
    ended : bool
        Whether the episode was terminated with the last step.
    """

    def __init__(self, key: str | None, names: tuple[str, ...]):
        self.key, self.names, self.ended = key, names, False
        self._numbers = array("d")  # step after step
        self._kept = 0  # steps that stand on the disk

    def __len__(self) -> int:
        return len(self._numbers) // len(self.names)

    def terms(self, step: int) -> dict[str, float]:
        """Terms of a step, or of the last one."""
        first = min(step, len(self) - 1) * len(self.names)
        return dict(zip(self.names, self._numbers[first : first + len(self.names)], strict=True))

    def append(self, step: int, terms: Mapping[str, float], ended: bool) -> None:
        """Add the terms of a step, unless another turbine has come there first: it has earned the same."""
        with _lock:
            if step == len(self) and not self.ended:
                self._numbers.extend([terms[name] for name in self.names])
                self.ended = ended

    def load(self, path: Path) -> None:
        """Take over what stands in a file, if there is one and it is sound."""
        try:
            with np.load(path, allow_pickle=False) as file:
                names, rows, ended = tuple(file["names"].tolist()), file["rows"], bool(file["ended"])
            if (
                names != self.names
                or rows.shape[1:] != (len(names),)
                or rows.dtype != np.float64
                or not np.isfinite(rows).all()
            ):
                raise ValueError(f"it holds {names}, an array {rows.dtype}{rows.shape}")
        except FileNotFoundError:
            return
        except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile) as error:
            _log.warning("recorded rewards %s are unreadable (%s); they are recorded again", path, error)
            return
        self._numbers, self.ended, self._kept = array("d", rows.ravel().tolist()), ended, len(rows)

    def save(self, path: Path) -> None:
        """Write what has been added since it was read or written; a file that cannot be written costs another run."""
        with _one_writes:  # turbines in several threads may have the same course
            with _lock:
                rows, ended = np.array(self._numbers).reshape(-1, len(self.names)), self.ended
            if len(rows) <= self._kept:
                return
            try:
                path.parent.mkdir(parents=True, exist_ok=True)
                with whole_file(path) as partial, partial.open("wb") as file:
                    np.savez(file, names=np.array(self.names), rows=rows, ended=ended)
                self._kept = len(rows)
                _tidy(path.parent)
            except OSError as error:
                _log.warning("recorded rewards could not be kept in %s (%s)", path.parent, error)


def new_course(names: tuple[str, ...]) -> Course:
    """Give an empty course that is not kept."""
    return Course(None, names)


def kept_course(key: str, names: tuple[str, ...]) -> Course:
    """Course of a key: from memory, from the disk, or an empty one that is kept from now on."""
    with _lock:
        if key in _courses:
            _courses.move_to_end(key)
            return _courses[key]
    course, path = Course(key, names), _path(key)
    if path is not None:
        course.load(path)
    with _lock:
        course = _courses.setdefault(key, course)  # another thread may have been faster
        _courses.move_to_end(key)
        total = sum(len(one) * len(one.names) for one in _courses.values())
        while total > MOST_NUMBERS and len(_courses) > 1:
            _, oldest = _courses.popitem(last=False)
            total -= len(oldest) * len(oldest.names)
    return course


def store_course(course: Course) -> None:
    """Keep a course on the disk, as far as it has been recorded."""
    path = None if course.key is None else _path(course.key)
    if path is not None:
        course.save(path)


def _path(key: str) -> Path | None:
    """File of a key, None if there is no place for it."""
    cache = user_cache()
    return None if cache is None else cache / "twins" / key[:2] / f"{key}.npz"


def _tidy(folder: Path) -> None:
    """Remove the oldest files, once in a while."""
    global _written
    _written += 1
    if _written % _BETWEEN:
        return
    files = [(file.stat().st_mtime, file) for file in folder.parent.glob("*/*.npz")]
    for _, file in sorted(files, key=lambda one: one[0])[:-MOST_FILES]:
        file.unlink(missing_ok=True)
