"""The small Bladed library through which any build of OpenFAST takes demands from this package."""

from __future__ import annotations

import hashlib
import os
import sysconfig
from pathlib import Path
from tempfile import TemporaryDirectory

from wt_gym.base.errors import SimulationError
from wt_gym.base.user_cache import user_cache
from wt_gym.bridges.compiler import CompilerError, compile_library, library_name

__all__ = ["relay_library"]

_SOURCE = Path(__file__).with_name("relay.c")


def relay_library() -> Path:
    """Path of the library, compiled at the first call and kept in the cache.

    Raises
    ------
    SimulationError
        If there is no compiler, or it fails.
    """
    stamp = hashlib.sha256(_SOURCE.read_bytes() + sysconfig.get_platform().encode()).hexdigest()[:16]
    cache = user_cache()
    if cache is None:
        raise SimulationError("no folder for compiled files: set WT_GYM_CACHE")
    path = cache / "openfast" / library_name(f"relay-{stamp}")
    if path.is_file():
        return path
    path.parent.mkdir(parents=True, exist_ok=True)
    with TemporaryDirectory(dir=path.parent) as folder:
        made = Path(folder) / path.name
        try:
            compile_library(_SOURCE, made)
        except CompilerError as error:
            raise SimulationError(
                f"OpenFAST takes demands through a small library, which a C compiler makes: {error}; with a build of "
                "OpenFAST whose ServoDyn takes inputs (PCMode 4) give commands='inputs'"
            ) from error
        os.replace(made, path)
    return path
