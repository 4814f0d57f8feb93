"""Cache of the user: results that take long, kept for the next process, those not used for longest removed."""

import logging
import os
import sys
from collections.abc import Callable, Iterable
from contextlib import suppress
from pathlib import Path
from typing import TypeVar

_log = logging.getLogger(__name__)
T = TypeVar("T")


def user_cache() -> Path | None:
    """Folder ``$WT_GYM_CACHE``, or without that variable one in the user's cache directory.

    Returns
    -------
    pathlib.Path or None
        It need not exist; None where neither the variable nor a home directory does.
    """
    chosen = os.environ.get("WT_GYM_CACHE")
    try:
        if chosen:
            return Path(chosen).expanduser()
        home = Path.home()
    except RuntimeError:  # no home, or none of the user that the variable names
        return None
    if sys.platform == "win32":
        base = Path(os.environ.get("LOCALAPPDATA") or home / "AppData" / "Local")
    elif sys.platform == "darwin":
        base = home / "Library" / "Caches"
    else:
        base = Path(os.environ.get("XDG_CACHE_HOME") or home / ".cache")
    return base / "wt_gym"


def cached_file(*parts: str) -> Path | None:
    """Path in the cache of the user; None where there is no cache."""
    folder = user_cache()
    return None if folder is None else folder.joinpath(*parts)


def read_cached(
    what: str, file: Path | None, read: Callable[[Path], T], damage: tuple[type[Exception], ...] = (OSError, ValueError)
) -> T | None:
    """Content of a file of the cache; None where there is none, and, with a logged line, where it is damaged."""
    try:
        return None if file is None else read(file)
    except FileNotFoundError:
        return None
    except damage as error:
        _log.warning("cached %s %s is unreadable (%s); it is made again", what, file, error)
        return None


def write_cached(what: str, file: Path | None, write: Callable[[Path], object]) -> bool:
    """Write a file of the cache; a logged line where that cannot be done costs the next process the same work."""
    if file is None:
        return False
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        write(file)
    except OSError as error:
        _log.warning("%s could not be cached in %s (%s)", what, file.parent, error)
        return False
    return True


def prune(files: Iterable[Path], most: float, in_bytes: bool = False) -> None:
    """Remove the files not used for longest, except the newest, until there are at most so many, or so many bytes."""
    known = []
    for file in files:
        with suppress(OSError):  # another process may prune at the same time
            status = file.stat()
            known.append((status.st_mtime, status.st_size if in_bytes else 1, file))
    known.sort(key=lambda one: one[0])
    total = sum(size for _, size, _ in known)
    for _, size, file in known[:-1]:
        if total <= most:
            return
        with suppress(OSError):
            file.unlink(missing_ok=True)
        total -= size
