"""Where OpenFAST's C library is."""

from __future__ import annotations

import ctypes.util
import os
import sys
from pathlib import Path

from wt_gym.base.errors import SimulationError

__all__ = ["VARIABLE", "find_library"]

VARIABLE = "WT_GYM_OPENFAST_LIBRARY"
"""Environment variable with the path of the library."""

_NAMES = {"win32": ("openfastlib.dll", "libopenfastlib.dll"), "darwin": ("libopenfastlib.dylib",)}
_FOLDERS = ("lib", "Library/bin", "bin")


def find_library(given: str | os.PathLike[str] | None = None) -> Path:
    """Path of OpenFAST's C library.

    Parameters
    ----------
    given : str or path, optional
        By default `VARIABLE`, else the library of the conda environment or of this Python, else that of the system.

    Raises
    ------
    SimulationError
        If it is not found; the message says how to get one.
    """
    chosen = given or os.environ.get(VARIABLE)
    if chosen:
        path = Path(chosen).expanduser()
        if path.is_file():
            return path.resolve()
        where = "openfast_library" if given else VARIABLE
        raise SimulationError(f"{where} must be the path of OpenFAST's library (libopenfastlib); got {chosen}: no file")
    names = _NAMES.get(sys.platform, ("libopenfastlib.so",))
    for prefix in (os.environ.get("CONDA_PREFIX"), sys.prefix):
        for folder in _FOLDERS if prefix else ():
            for name in names:
                path = Path(str(prefix), folder, name)
                if path.is_file():
                    return path
    if found := ctypes.util.find_library("openfastlib"):
        return Path(found)
    raise SimulationError(
        "OpenFAST's library (libopenfastlib, version 5) is not here: conda install -c conda-forge openfast, or build "
        f"OpenFAST with -DBUILD_SHARED_LIBS=ON; then give its path as openfast_library=... or in {VARIABLE}"
    )
