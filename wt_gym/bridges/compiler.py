"""C compilers: the one of the machine, or that of the PyPI wheel ``ziglang``, which compiles for other machines too."""

import importlib.util
import os
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

from wt_gym.base.errors import WtGymError

TARGETS = {
    "linux": "x86_64-linux-gnu.2.17",
    "linux-arm": "aarch64-linux-gnu.2.17",
    "windows": "x86_64-windows-gnu",
    "macos": "x86_64-macos",
    "macos-arm": "aarch64-macos",
}
"""Machines that ``ziglang`` compiles for, by the names that are accepted."""
_FLAGS = ("-std=c99", "-O2", "-shared", "-fPIC", "-Wall", "-Wextra", "-Werror", "-pedantic")
_ENDINGS = {"windows": ".dll", "macos": ".dylib", "macos-arm": ".dylib"}


class CompilerError(WtGymError):
    """There is no compiler, or it refused a source."""


def library_name(stem: str, target: str | None = None) -> str:
    """File name of a library for this machine, or for one of `TARGETS`."""
    here = {"win32": ".dll", "darwin": ".dylib"}.get(sys.platform, ".so")
    return stem + (here if target is None else _ENDINGS.get(target, ".so"))


def find_compiler(target: str | None = None) -> list[str]:
    """Command of a C compiler: ``$CC``, ``cc``, ``gcc`` or ``clang`` for this machine, else that of ``ziglang``.

    Parameters
    ----------
    target : str, optional
        Of `TARGETS`; by default this machine.
    """
    if target is not None and target not in TARGETS:
        raise ValueError(f"the target must be one of {', '.join(TARGETS)}, got {target!r}")
    if target is None:
        if chosen := os.environ.get("CC"):
            return shlex.split(chosen)
        for name in ("cc", "gcc", "clang"):
            if found := shutil.which(name):
                return [found]
    if importlib.util.find_spec("ziglang") is not None:
        return [sys.executable, "-m", "ziglang", "cc", *(() if target is None else ("-target", TARGETS[target]))]
    what = "a C compiler" if target is None else f"a compiler for {target}"
    raise CompilerError(f"there is no {what} here; pip install ziglang brings one")


def compile_library(source: Path, library: Path, target: str | None = None, flags: tuple[str, ...] = ()) -> None:
    """Compile one C99 source to a shared library.

    Parameters
    ----------
    target : str, optional
        See `find_compiler`.
    flags : tuple of str
        More options of the compiler.
    """
    command = [*find_compiler(target), *_FLAGS, *flags, "-o", str(library), str(source)]
    if target is None or not target.startswith("windows"):
        command.append("-lm")
    done = subprocess.run(command, capture_output=True, text=True)
    if done.returncode:
        raise CompilerError(f"{command[0]} could not compile {source.name}:\n{done.stderr.strip()}")
