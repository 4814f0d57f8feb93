"""Memory of this process [MiB], where the system tells; None on Windows without the package psutil."""

from __future__ import annotations

import sys
from importlib.util import find_spec
from pathlib import Path

_MIB = 2**20


def peak_memory() -> float | None:
    """The most memory that this process has had [MiB]."""
    try:
        import resource
    except ModuleNotFoundError:  # Windows
        return _of_psutil("peak_wset")
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak / _MIB if sys.platform == "darwin" else peak / 1024.0  # bytes there, kilobytes elsewhere


def resident_memory() -> float | None:
    """Memory that this process has now [MiB]; where the system does not tell, the most that it ever had."""
    try:
        import resource

        pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    except (ModuleNotFoundError, OSError):  # only Linux has the file
        now = _of_psutil("rss")
        return peak_memory() if now is None else now
    return pages * resource.getpagesize() / _MIB


def _of_psutil(name: str) -> float | None:
    """One of psutil's numbers [MiB]; None where there is no such number or no psutil."""
    if find_spec("psutil") is None:
        return None
    import psutil

    found = getattr(psutil.Process().memory_info(), name, None)
    return None if found is None else found / _MIB
