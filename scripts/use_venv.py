"""Lets a script beside it run as it is printed, from any folder: imported first.

The packages of this clone are found without being installed. Where the interpreter lacks the packages they need, the
one of .venv, which scripts/demo and scripts/test set up, takes over.
"""

import importlib.util
import os
import sys
from pathlib import Path

_ROOT = Path(__file__).resolve().parents[1]
_PYTHON = _ROOT / ".venv" / "bin" / "python"

sys.path.insert(0, str(_ROOT))
_missing = [name for name in ("gymnasium", "numba", "stable_baselines3") if importlib.util.find_spec(name) is None]
if _missing:
    if _PYTHON.exists() and Path(sys.prefix).resolve() != _PYTHON.parents[1].resolve():
        os.execv(_PYTHON, [str(_PYTHON), *sys.argv])
    if _missing != ["stable_baselines3"]:  # without it all runs but training and what loads trained agents
        sys.exit(f"error: {', '.join(_missing)} not installed; run scripts/test once, or pip install '{_ROOT}[train]'")
