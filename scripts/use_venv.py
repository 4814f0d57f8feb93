"""Lets a script beside it run as it is printed, from any folder: imported first.

The packages of this clone are found without being installed. Where the interpreter lacks the packages they need, the
one of .venv, which scripts/demo and scripts/test set up, takes over.
"""

import importlib.util
import os
import subprocess
import sys
from pathlib import Path

_ROOT = Path(__file__).resolve().parents[1]
_PYTHON = _ROOT / ".venv" / ("Scripts/python.exe" if os.name == "nt" else "bin/python")

sys.path.insert(0, str(_ROOT))
for _stream in (sys.stdout, sys.stderr):
    _stream.reconfigure(errors="replace")  # where the encoding of a terminal or file lacks a character
_missing = [name for name in ("gymnasium", "numba", "stable_baselines3") if importlib.util.find_spec(name) is None]
if _missing:
    if _PYTHON.exists() and Path(sys.prefix).resolve() != _PYTHON.parents[1].resolve():
        if os.name == "nt":  # which gives the prompt back at once where one program takes the place of another
            sys.exit(subprocess.run([str(_PYTHON), *sys.argv]).returncode)
        os.execv(_PYTHON, [str(_PYTHON), *sys.argv])
    if _missing != ["stable_baselines3"]:  # without it all runs but training and what loads trained agents
        sys.exit(f"error: {', '.join(_missing)} not installed; run scripts/test once, or pip install '{_ROOT}[train]'")
