"""A lock on a folder, against two processes that write into it."""

from __future__ import annotations

import os
from contextlib import suppress
from pathlib import Path
from typing import Self

from filelock import FileLock, Timeout

from wt_gym.base.files import remove_partial

__all__ = ["FolderLock"]


class FolderLock:
    """Holds a folder for one process while it is entered, and leaves no folder behind where nothing was written.

    What killed processes had begun to write there is removed.

    The lock is the operating system's and ends with the process, however that ends: a file that a killed process left
    behind locks nothing. In the file stands the number of the process that holds it, where the system lets anyone write
    and read a locked file (Windows does not).

    Parameters
    ----------
    path : str or path
        Created when the lock is taken.
    work : str
        What is done there, for the name of the file and the message.

    Raises
    ------
    ValueError
        On entering, if another process works there.
    OSError
        On entering, if the folder cannot be made.
    """

    subfolders: tuple[str, ...] = ()
    """Folders in this one that the work writes to."""

    def __init__(self, path: str | Path, work: str):
        self.path, self._work = Path(path), work
        self._lock_file = self.path / f"{work}.lock"
        self._lock: FileLock | None = None
        self._made = False

    def __enter__(self) -> Self:
        self._made = not self.path.exists()
        self.path.mkdir(parents=True, exist_ok=True)
        lock = FileLock(self._lock_file, timeout=0, thread_local=False)
        try:
            lock.acquire()
        except Timeout:
            raise ValueError(f"{self.path} is in use by another {self._work} (process {self._holder()})") from None
        self._lock = lock
        with suppress(PermissionError):
            self._lock_file.write_text(f"{os.getpid()}\n", encoding="utf-8")
        for folder in (self.path, *(self.path / name for name in self.subfolders)):
            remove_partial(folder)
        return self

    def _holder(self) -> str:
        """Number of the process that works there."""
        with suppress(OSError):
            return self._lock_file.read_text(encoding="utf-8", errors="replace").strip() or "unknown"
        return "unknown"

    def __exit__(self, *_exception: object) -> None:
        lock, self._lock = self._lock, None
        with suppress(PermissionError):  # first, so that who takes a lock on a file has the file of that name
            self._lock_file.unlink(missing_ok=True)
        if lock is not None:
            lock.release()
        with suppress(PermissionError):  # Windows removes no file that is open
            if os.name == "nt":
                self._lock_file.unlink(missing_ok=True)
        if self._made and not any(self.path.iterdir()):  # refused before anything was written
            self.path.rmdir()
