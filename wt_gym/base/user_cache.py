"""Where results that take long are kept for the next process."""

import os
import sys
from pathlib import Path

__all__ = ["user_cache"]


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
