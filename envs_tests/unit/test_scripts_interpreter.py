"""Tools of a clone run as printed: from any folder, with .venv where their interpreter lacks packages."""

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
SCRIPTS = ROOT / "scripts"
TOOL = "fuzz.py"
TOOLS = [path.name for path in sorted(SCRIPTS.glob("*.py")) if "\nimport use_venv" in path.read_text(encoding="utf-8")]
BARE = [sys.executable, "-I", "-S"]  # an interpreter without any package


@pytest.fixture
def clone(tmp_path):
    (tmp_path / "scripts").mkdir()
    for name in (*TOOLS, "use_venv.py"):
        shutil.copy(SCRIPTS / name, tmp_path / "scripts")
    return tmp_path


def start(clone, *options, tool=TOOL):
    # -I leaves the script's folder out of the path, where an ordinary start has it
    code = f"import runpy, sys; sys.path.insert(0, {str(clone / 'scripts')!r}); sys.argv = sys.argv[1:]; "
    code += "runpy.run_path(sys.argv[0], run_name='__main__')"
    command = [*BARE, "-c", code, clone / "scripts" / tool, *options]
    return subprocess.run(command, capture_output=True, text=True, check=False, cwd="/")


@pytest.mark.parametrize("tool", TOOLS)
def test_without_packages_one_line_says_what_to_do(clone, tool):
    """The interpreter is looked for before any package is imported."""
    done = start(clone, tool=tool)
    assert done.returncode == 1
    assert done.stderr.startswith("error: gymnasium, numba, stable_baselines3 not installed; run scripts/test once")
    assert done.stderr.count("\n") == 1


def test_the_interpreter_of_the_clone_takes_over(clone):
    python = clone / ".venv" / "bin" / "python"
    python.parent.mkdir(parents=True)
    python.write_text('#!/bin/sh\necho "took over: $@"\n')
    python.chmod(0o755)
    done = start(clone, "--steps", "5")
    assert done.stdout == f"took over: {clone / 'scripts' / TOOL} --steps 5\n"


def test_tools_find_the_package_beside_them(tmp_path):
    command = [sys.executable, SCRIPTS / TOOL, "--help"]
    done = subprocess.run(command, capture_output=True, text=True, check=True, cwd=tmp_path, env={})
    assert f"usage: {TOOL}" in done.stdout


@pytest.mark.parametrize(("name", "calls"), [("demo", ["compile", "train", "evaluate"]), ("test", ["compile"])])
def test_demo_and_test_call_the_commands_of_the_clone(name, calls, tmp_path):
    """With a set-up and programs that stand for others, and note how they are called."""
    (tmp_path / "scripts").mkdir()
    shutil.copy(SCRIPTS / name, tmp_path / "scripts")
    (tmp_path / "scripts" / "setup.sh").write_text(f"set -euo pipefail\ncd {tmp_path}\n")
    programs = tmp_path / ".venv" / "bin"
    programs.mkdir(parents=True)
    for program in ("wt-gym", "python", "ruff", "typos", "mypy"):
        (programs / program).write_text(f'#!/bin/sh\necho "{program} $1" >>calls\n')
        (programs / program).chmod(0o755)
    subprocess.run(["bash", tmp_path / "scripts" / name], check=True, cwd="/", capture_output=True)
    called = (tmp_path / "calls").read_text().splitlines()
    assert [line.removeprefix("wt-gym ") for line in called if line.startswith("wt-gym ")] == calls


def test_a_checkout_runs_as_a_module():
    command = [sys.executable, "-m", "wt_gym", "--version"]
    assert subprocess.run(command, capture_output=True, text=True, check=True, cwd=ROOT, env={}).stdout.startswith(
        "wt_gym "
    )
