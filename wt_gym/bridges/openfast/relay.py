"""The small Bladed library through which any build of OpenFAST takes demands from this package."""

from __future__ import annotations

import hashlib
import importlib.util
import os
import shutil
import subprocess
import sys
import sysconfig
from pathlib import Path
from tempfile import TemporaryDirectory

from wt_gym.errors import SimulationError
from wt_gym.user_cache import user_cache

__all__ = ["compiler", "relay_library"]

_SOURCE = Path(__file__).with_name("relay.c")
_COMPILERS = ("cc", "gcc", "clang")
_SUFFIX = {"win32": ".dll", "darwin": ".dylib"}.get(sys.platform, ".so")


def compiler() -> list[str] | None:
    """Words of a command that compiles C: ``$CC``, cc, gcc, clang, or that of the PyPI package ``ziglang``."""
    chosen = os.environ.get("CC")
    if chosen and shutil.which(chosen.split()[0]):
        return chosen.split()
    for name in _COMPILERS:
        if found := shutil.which(name):
            return [found]
    if importlib.util.find_spec("ziglang") is not None:
        return [sys.executable, "-m", "ziglang", "cc"]
    return None


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
    path = cache / "openfast" / f"relay-{stamp}{_SUFFIX}"
    if path.is_file():
        return path
    command = compiler()
    if command is None:
        raise SimulationError(
            "OpenFAST takes demands through a small library, for which a C compiler is needed: install gcc or clang, "
            "or pip install ziglang; with a build of OpenFAST whose ServoDyn takes inputs (PCMode 4) give "
            "commands='inputs'"
        )
    path.parent.mkdir(parents=True, exist_ok=True)
    with TemporaryDirectory(dir=path.parent) as folder:
        made = Path(folder) / path.name
        words = [*command, "-O2", "-shared", *([] if sys.platform == "win32" else ["-fPIC"]), "-o", str(made)]
        done = subprocess.run([*words, str(_SOURCE)], capture_output=True, text=True, check=False)
        if done.returncode != 0:
            raise SimulationError(f"{' '.join(command)} does not compile {_SOURCE.name}: {done.stderr.strip()[-500:]}")
        os.replace(made, path)
    return path
