"""The wheel: what is in it, and that it works where nothing of a clone is at hand."""

import email
import os
import re
import shutil
import subprocess
import sys
import sysconfig
import zipfile
from pathlib import Path

import pytest

import wt_gym
from wt_gym.commands import COMMANDS

ROOT = Path(__file__).resolve().parents[2]
PACKED = ("wt_gym", "agents", "pyproject.toml", "README.md", "LICENSE")
IMPORTS = "import gymnasium as gym\nimport wt_gym\n"
"""Of the first block of a page: one without imports goes on from there."""
NOT_PACKED = shutil.ignore_patterns("__pycache__", "*.egg-info")

pytestmark = pytest.mark.slow


def run(*command, folder, timeout=1800):
    """Run a command without the variables that lead back to the clone; give what it prints."""
    variables = {name: value for name, value in os.environ.items() if not name.startswith(("PYTHON", "VIRTUAL_ENV"))}
    done = subprocess.run(
        [str(word) for word in command], cwd=folder, env=variables, capture_output=True, text=True, timeout=timeout,
    )  # fmt: skip
    return done.returncode, done.stdout, done.stderr


def succeeds(*command, folder):
    status, output, errors = run(*command, folder=folder)
    assert status == 0, errors
    return output


@pytest.fixture(scope="module")
def wheel(tmp_path_factory):
    """The wheel of a copy of the sources: building leaves its traces there."""
    folder = tmp_path_factory.mktemp("sources")
    for name in PACKED:
        if (ROOT / name).is_dir():
            shutil.copytree(ROOT / name, folder / name, symlinks=True, ignore=NOT_PACKED)
        else:
            shutil.copy(ROOT / name, folder)
    pip = [sys.executable, "-m", "pip", "--disable-pip-version-check"]
    succeeds(
        *pip, "wheel", "--no-deps", "--no-index", "--no-build-isolation", "--wheel-dir", "dist", ".", folder=folder
    )
    (path,) = (folder / "dist").glob("*.whl")
    return path


@pytest.fixture(scope="module")
def installed(wheel, tmp_path_factory):
    """Folder of an environment with the wheel. What it needs is lent by this interpreter: nothing is fetched."""
    folder = tmp_path_factory.mktemp("installed")
    succeeds(sys.executable, "-m", "venv", "--without-pip", folder / "venv", folder=folder)
    python = folder / "venv" / "bin" / "python"
    pip = [sys.executable, "-m", "pip", "--disable-pip-version-check", "--python", python]
    succeeds(*pip, "install", "--no-deps", "--no-index", wheel, folder=folder)
    site = Path(succeeds(python, "-c", "import sysconfig; print(sysconfig.get_path('purelib'))", folder=folder).strip())
    (site / "lent.pth").write_text("\n".join({sysconfig.get_path("purelib"), sysconfig.get_path("platlib")}) + "\n")
    (folder / "work").mkdir()
    return folder


def test_the_wheel_holds_the_package_and_nothing_else(wheel):
    with zipfile.ZipFile(wheel) as archive:
        names = archive.namelist()
        (record,) = (name for name in names if name.endswith(".dist-info/METADATA"))
        metadata = email.message_from_bytes(archive.read(record))
        entries = archive.read(record.replace("METADATA", "entry_points.txt")).decode()
    assert {name.split("/")[0] for name in names} == {"wt_gym", record.split("/")[0]}
    assert not [name for name in names if "__pycache__" in name or "test" in name.lower()]
    packed = {name for name in names if name.startswith("wt_gym/")}
    parts = (("", ROOT / "wt_gym"), ("wt_gym/", ROOT / "agents"))
    found = [(start, path) for start, part in parts for path in part.rglob("*") if path.is_file()]
    sources = {start + path.relative_to(ROOT).as_posix() for start, path in found}
    wanted = {name for name in sources if "__pycache__" not in name and not name.endswith((".nbi", ".nbc"))}
    assert packed == wanted
    assert metadata["Version"] == wt_gym.__version__
    assert {"train", "render", "tune", "data"} <= set(metadata.get_all("Provides-Extra"))
    assert "wt-gym = wt_gym.commands:main" in entries


def test_the_command_works_where_it_is_installed(installed):
    program, folder = installed / "venv" / "bin" / "wt-gym", installed / "work"
    text = succeeds(program, "--help", folder=folder)
    assert all(f"  {command} " in text for command in COMMANDS)
    assert succeeds(program, "--version", folder=folder).split() == ["wt_gym", wt_gym.__version__]
    for command in COMMANDS:
        assert f"usage: wt-gym {command}" in succeeds(program, command, "--help", folder=folder)
    assert "load-reduction-15" in succeeds(program, "benchmark", "tasks", folder=folder)
    status, _, errors = run(program, "benchmark", "reference", folder=folder)
    assert (status, errors.count("\n")) == (1, 1)
    assert "a clone of the project" in errors


def test_it_takes_no_names_but_its_own(installed):
    python, folder = installed / "venv" / "bin" / "python", installed / "work"
    assert run(python, "-c", "import agents", folder=folder)[0] == 1
    where = succeeds(python, "-c", "import wt_gym.agents; print(wt_gym.agents.__file__)", folder=folder)
    assert Path(where.strip()).is_relative_to(installed / "venv")


def test_the_blocks_of_readme_and_quick_start_run(installed):
    pages = {page: (ROOT / page).read_text(encoding="utf-8") for page in ("README.md", "docs/quickstart.md")}
    blocks = {page: re.findall(r"```python\n(.*?)```", text, re.DOTALL) for page, text in pages.items()}
    assert all(blocks.values())
    python, folder = installed / "venv" / "bin" / "python", installed / "work"
    for block in (block for found in blocks.values() for block in found):
        used = block if "import " in block else IMPORTS + block
        succeeds(python, "-c", used, folder=folder)  # the first one compiles all kernels
    assert (folder / "run.nc").is_file()  # of the block "Without Gymnasium"
