"""Turbulence boxes kept on disk by their parameters, so that a wind is synthesized once.

Files live in ``$WT_GYM_CACHE/turbulence``, or without that variable in the user's cache directory. Each holds, one
after the other in NumPy's format, the parameters of a box, a checksum and the samples: read in a third of the time
that an archive of them takes. A file that cannot be read, or that belongs to other parameters, is made again; a
directory that cannot be written costs only the time of the next synthesis and is reported to the log. The folder is
kept below :data:`MAX_BYTES` by removing the boxes not used for longest.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import logging
import os
import tempfile
import tokenize
import zipfile
import zlib
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from wt_gym.base.user_cache import user_cache
from wt_gym.wind.kaimal import KaimalParameters
from wt_gym.wind.mann import MannParameters

if TYPE_CHECKING:
    from numpy.typing import NDArray

__all__ = ["MAX_BYTES", "cache_file", "load", "store"]

MAX_BYTES = 2 * 1024**3

_FORMAT = 4  # raise when the synthesis changes its results
# What numpy raises on damaged files: the errors of syntax and tokens where a bit of an array's header is wrong.
_DAMAGE = (
    OSError, ValueError, KeyError, TypeError, EOFError, OverflowError, MemoryError, BufferError, SyntaxError,
    tokenize.TokenError, zipfile.BadZipFile,
)  # fmt: skip
_log = logging.getLogger(__name__)

_Parameters = KaimalParameters | MannParameters


def cache_file(parameters: _Parameters) -> Path | None:
    """File in which the box of these parameters is or would be kept."""
    folder = user_cache()
    if folder is None:
        return None
    digest = hashlib.sha256(_label(parameters).encode()).hexdigest()[:20]
    return folder / "turbulence" / f"{parameters.model}-{digest}.npy"


def _label(parameters: _Parameters) -> str:
    return json.dumps({"format": _FORMAT, **parameters.as_dict()}, sort_keys=True)


def load(parameters: _Parameters) -> NDArray[np.float32] | None:
    """Fluctuations (n_times, n_z, n_y, 3) from the cache, or None if there is no intact file."""
    path = cache_file(parameters)
    if path is None:
        return None
    try:
        with path.open("rb") as file:
            label, checksum, fluctuation = (np.load(file, allow_pickle=False) for _ in range(3))
        if zlib.crc32(fluctuation.data) != checksum:
            raise ValueError("its samples do not have their checksum")
    except FileNotFoundError:
        return None
    except _DAMAGE as error:
        _log.warning("cached turbulence %s is unreadable (%s); it is made again", path, error)
        return None
    shape = (parameters.n_times, parameters.grid[1], parameters.grid[0], 3)
    if str(label) != _label(parameters) or fluctuation.shape != shape or fluctuation.dtype != np.float32:
        _log.warning("cached turbulence %s holds another box; it is made again", path)
        return None
    found: NDArray[np.float32] = fluctuation
    with contextlib.suppress(OSError):  # a read-only cache is still a good cache
        os.utime(path)
    return found


def store(parameters: _Parameters, fluctuation: NDArray[np.float32]) -> None:
    """Write the box so that other processes see either the whole file or none."""
    path = cache_file(parameters)
    if path is None:
        return
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        handle, name = tempfile.mkstemp(prefix=path.stem, suffix=".partial", dir=path.parent)
        try:
            with os.fdopen(handle, "wb") as file:
                for array in (np.array(_label(parameters)), np.uint32(zlib.crc32(fluctuation.data)), fluctuation):
                    np.save(file, array)
            os.replace(name, path)
        except BaseException:
            os.unlink(name)
            raise
        _prune(path)
    except OSError as error:
        _log.warning("turbulence could not be cached in %s (%s)", path.parent, error)


def _prune(newest: Path) -> None:
    """Remove the boxes not used for longest until the folder is within its limit; ``newest`` stays."""
    boxes = []
    for path in [*newest.parent.glob("kaimal-*"), *newest.parent.glob("mann-*")]:
        with contextlib.suppress(FileNotFoundError):  # another process may prune at the same time
            status = path.stat()
            boxes.append((status.st_mtime, status.st_size, path))
    total = sum(size for _, size, _ in boxes)
    for _, size, path in sorted(boxes):
        if total <= MAX_BYTES:
            return
        if path != newest:
            path.unlink(missing_ok=True)
            total -= size
