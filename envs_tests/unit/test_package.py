"""The package in a clone, in a wheel and in an editable installation: what is in it, and that it works there."""

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
DATA = ("hyperparameters", "recipes", "trained")
"""Folders of ``agents`` that a wheel holds; its scripts are of a clone."""
IMPORTS = "import gymnasium as gym\nimport wt_gym\n"
"""Of the first block of a page: one without imports goes on from there."""
NOT_PACKED = shutil.ignore_patterns("__pycache__", "*.egg-info")


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
def sources(tmp_path_factory):
    """A copy of the sources: building leaves its traces there."""
    folder = tmp_path_factory.mktemp("sources")
    for name in PACKED:
        if (ROOT / name).is_dir():
            shutil.copytree(ROOT / name, folder / name, symlinks=True, ignore=NOT_PACKED)
        else:
            shutil.copy(ROOT / name, folder)
    return folder


@pytest.fixture(scope="module")
def wheel(sources):
    return built(sources, sources / "dist")


def built(sources, folder):
    """The wheel of a folder or an archive of sources."""
    options = ("--no-deps", "--no-index", "--no-build-isolation", "--wheel-dir", folder)
    succeeds(sys.executable, "-m", "pip", "--disable-pip-version-check", "wheel", *options, sources, folder=ROOT.parent)
    (path,) = folder.glob("*.whl")
    return path


@pytest.fixture(scope="module")
def installed(wheel, tmp_path_factory):
    """Folder of an environment with the wheel."""
    return environment(tmp_path_factory.mktemp("installed"), wheel)


def environment(folder, *installed):
    """A virtual environment with what pip is given. What that needs is lent by this interpreter: nothing is fetched."""
    succeeds(sys.executable, "-m", "venv", "--without-pip", folder / "venv", folder=folder)
    python = folder / "venv" / "bin" / "python"
    site = Path(succeeds(python, "-c", "import sysconfig; print(sysconfig.get_path('purelib'))", folder=folder).strip())
    (site / "lent.pth").write_text("\n".join({sysconfig.get_path("purelib"), sysconfig.get_path("platlib")}) + "\n")
    pip = [sys.executable, "-m", "pip", "--disable-pip-version-check", "--python", python]
    options = ("--no-deps", "--no-index", "--no-build-isolation", "--ignore-installed")
    succeeds(*pip, "install", *options, *installed, folder=folder)
    (folder / "work").mkdir()
    return folder


def test_the_sources_have_no_symbolic_links():
    """Git writes them as text files where the system has none or does not allow them."""
    folders = [ROOT / name for name in ("agents", "docs", "envs_tests", "scripts", "wt_gym")]
    assert not [path for folder in folders for path in folder.rglob("*") if path.is_symlink()]


WORKERS = """
import multiprocessing, sys
from pathlib import Path
from wt_gym.base.files import shipped_folder
from wt_gym.learning.hyperparameters import hyperparameters_for
from wt_gym.experiment.run_folder import RunFolder

if __name__ == "__main__":
    with multiprocessing.get_context("spawn").Pool(1) as pool:
        print(pool.apply(RunFolder, ("folder",)).__class__ is RunFolder, RunFolder.__module__)
    print(len(hyperparameters_for("PPO", "wt_gym/LoadReduction-v3")) > 3, shipped_folder())
"""


@pytest.mark.slow
@pytest.mark.parametrize("editable", [False, True])
def test_pickles_workers_and_data_find_their_way(installed, sources, tmp_path, editable):
    folder = environment(tmp_path, "--editable", sources) if editable else installed
    program = folder / "work" / "program.py"
    program.write_text(WORKERS)
    workers, settings = succeeds(folder / "venv" / "bin" / "python", program, folder=folder / "work").splitlines()
    assert workers == "True wt_gym.experiment.run_folder"
    found, agents = settings.split()
    assert found == "True"
    assert Path(agents, "trained", "faults", "model.zip").is_file()
    assert Path(agents, "recipes", "LoadReduction.yml").is_file()
    assert Path(agents).is_relative_to(sources if editable else folder)


@pytest.mark.slow
def test_the_archive_of_the_sources_makes_the_same_wheel(wheel, sources, tmp_path):
    code = "from hatchling.build import build_sdist; import sys; build_sdist(sys.argv[1])"
    succeeds(sys.executable, "-c", code, tmp_path, folder=sources)
    (archive,) = tmp_path.glob("*.tar.gz")
    with zipfile.ZipFile(wheel) as direct, zipfile.ZipFile(built(archive, tmp_path / "dist")) as other:
        contents = [{name: file.read(name) for name in file.namelist()} for file in (direct, other)]
    assert {name for name in contents[0] if contents[0][name] != contents[1].get(name)} == set()
    assert contents[0].keys() == contents[1].keys()


@pytest.mark.slow
def test_the_wheel_holds_the_package_and_nothing_else(wheel):
    with zipfile.ZipFile(wheel) as archive:
        names = archive.namelist()
        (record,) = (name for name in names if name.endswith(".dist-info/METADATA"))
        metadata = email.message_from_bytes(archive.read(record))
        entries = archive.read(record.replace("METADATA", "entry_points.txt")).decode()
    assert {name.split("/")[0] for name in names} == {"wt_gym", record.split("/")[0]}
    assert not [name for name in names if "__pycache__" in name or "tests/" in name]
    packed = {name for name in names if name.startswith("wt_gym/")}
    parts = [("", ROOT / "wt_gym"), *(("wt_gym/", ROOT / "agents" / name) for name in DATA)]
    found = [(start, path) for start, part in parts for path in part.rglob("*") if path.is_file()]
    sources = {start + path.relative_to(ROOT).as_posix() for start, path in found}
    wanted = {name for name in sources if "__pycache__" not in name and not name.endswith((".nbi", ".nbc"))}
    assert packed == wanted
    assert metadata["Version"] == wt_gym.__version__
    assert {"train", "render", "tune", "data"} <= set(metadata.get_all("Provides-Extra"))
    assert "wt-gym = wt_gym.commands:main" in entries


@pytest.mark.slow
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


@pytest.mark.slow
def test_it_takes_no_names_but_its_own(installed):
    python, folder = installed / "venv" / "bin" / "python", installed / "work"
    assert run(python, "-c", "import agents", folder=folder)[0] == 1
    where = succeeds(python, "-c", "import wt_gym; print(wt_gym.__file__)", folder=folder)
    assert Path(where.strip()).is_relative_to(installed / "venv")


@pytest.mark.slow
def test_the_blocks_of_readme_and_first_pages_run(installed):
    pages = {
        page: (ROOT / page).read_text(encoding="utf-8") for page in ("README.md", "docs/learn.md", "docs/check.md")
    }
    blocks = {page: re.findall(r"```python\n(.*?)```", text, re.DOTALL) for page, text in pages.items()}
    assert all(blocks.values())
    python, folder = installed / "venv" / "bin" / "python", installed / "work"
    for block in (block for found in blocks.values() for block in found):
        used = block if "import " in block else IMPORTS + block
        succeeds(python, "-c", used, folder=folder)  # the first one compiles all kernels
    assert (folder / "run.nc").is_file()  # of docs/check.md
