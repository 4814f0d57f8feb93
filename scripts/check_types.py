#!/usr/bin/env python3
"""Check the types of the whole package: mypy on a copy in which ``agents`` is the package ``wt_gym.agents``.

mypy looks for modules in folders of their names only; run in a clone it checks ``wt_gym`` without ``agents``. The copy
is kept in ``.mypy_cache``, with what mypy remembers of it. Arguments go to mypy.
"""

import shutil
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
COPY = ROOT / ".mypy_cache" / "package"


def copy_sources() -> None:
    """Bring the copy up to date; files that are as they were keep their times, which spares mypy to read them."""
    shutil.rmtree(COPY, ignore_errors=True)
    rest = shutil.ignore_patterns("__pycache__", "data", "trained", "hyperparameters")
    shutil.copytree(ROOT / "scripts" / "fuzzing", COPY / "fuzzing", ignore=rest)
    shutil.copytree(ROOT / "wt_gym", COPY / "wt_gym", ignore=rest)
    physics = "envs_tests/physics"
    shutil.copytree(ROOT / physics / "cases", COPY / physics / "cases", ignore=rest)
    shutil.copy(ROOT / physics / "validation.py", COPY / physics)
    shutil.rmtree(COPY / "wt_gym" / "agents")
    shutil.copytree(ROOT / "agents", COPY / "wt_gym" / "agents", ignore=rest)


if __name__ == "__main__":
    copy_sources()
    command = [
        sys.executable,
        "-m",
        "mypy",
        "--config-file",
        "../../pyproject.toml",
        "--cache-dir",
        "../of_package",
        *(sys.argv[1:] or ("wt_gym", "fuzzing", "envs_tests")),
    ]
    sys.exit(subprocess.run(command, cwd=COPY).returncode)
