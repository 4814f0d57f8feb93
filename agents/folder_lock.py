"""A lock on a folder, against two processes that write into it."""

from __future__ import annotations

import fcntl
import os
from pathlib import Path
from typing import cast

from wt_gym.files import remove_partial

__all__ = ["FolderLock"]


class FolderLock:
    """Holds a folder for one process while it is entered, and leaves no folder behind where nothing was written.

    What killed processes had begun to write there is removed. Needs POSIX file locks.

    The lock is the operating system's and ends with the process, however that ends: a file that a killed process left
    behind locks nothing. In the file stands the number of the process that holds it.

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
        self._lock: int | None = None
        self._made = False

    def __enter__(self):
        self._made = not self.path.exists()
        self.path.mkdir(parents=True, exist_ok=True)
        while self._lock is None:
            self._lock = self._taken()
        os.truncate(self._lock, 0)
        os.write(self._lock, f"{os.getpid()}\n".encode())
        for folder in (self.path, *(self.path / name for name in self.subfolders)):
            remove_partial(folder)
        return self

    def _taken(self) -> int | None:
        """Descriptor of the locked file; None where it was removed in between and has to be tried again."""
        descriptor, kept = os.open(self._lock_file, os.O_RDWR | os.O_CREAT, 0o644), False
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
            # between opening and locking the file may have been removed by the one who held it
            if self._lock_file.exists() and os.path.samestat(os.fstat(descriptor), self._lock_file.stat()):
                kept = True
                return descriptor
            return None
        except BlockingIOError:
            holder = os.read(descriptor, 100).decode(errors="replace").strip() or "unknown"
            raise ValueError(f"{self.path} is in use by another {self._work} (process {holder})") from None
        finally:
            if not kept:
                os.close(descriptor)

    def __exit__(self, *_exception) -> None:
        self._lock_file.unlink(missing_ok=True)
        os.close(cast(int, self._lock))
        self._lock = None
        if self._made and not any(self.path.iterdir()):  # refused before anything was written
            self.path.rmdir()
