"""The scripts about training run as printed: from any folder, with .venv where their interpreter lacks packages."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from wt_gym.commands import COMMANDS, module_of

SCRIPTS = Path(__file__).resolve().parents[2] / "scripts"
BARE = [sys.executable, "-I", "-S"]  # an interpreter without any package


@pytest.fixture
def clone(tmp_path):
    (tmp_path / "scripts").mkdir()
    for name in ("train.py", "use_venv.py"):
        shutil.copy(SCRIPTS / name, tmp_path / "scripts")
    return tmp_path


def start(clone, *options):
    # -I leaves the script's folder out of the path, where an ordinary start has it
    code = f"import runpy, sys; sys.path.insert(0, {str(clone / 'scripts')!r}); sys.argv = sys.argv[1:]; "
    code += "runpy.run_path(sys.argv[0], run_name='__main__')"
    command = [*BARE, "-c", code, clone / "scripts" / "train.py", *options]
    return subprocess.run(command, capture_output=True, text=True, check=False, cwd="/")


def test_without_packages_one_line_says_what_to_do(clone):
    done = start(clone)
    assert done.returncode == 1
    assert done.stderr.startswith("error: gymnasium, numba, stable_baselines3 not installed; run scripts/test once")
    assert done.stderr.count("\n") == 1


def test_the_interpreter_of_the_clone_takes_over(clone):
    python = clone / ".venv" / "bin" / "python"
    python.parent.mkdir(parents=True)
    python.write_text('#!/bin/sh\necho "took over: $@"\n')
    python.chmod(0o755)
    done = start(clone, "--steps", "5")
    assert done.stdout == f"took over: {clone / 'scripts' / 'train.py'} --steps 5\n"


def test_scripts_find_the_package_beside_them(tmp_path):
    command = [sys.executable, SCRIPTS / "train.py", "--help"]
    done = subprocess.run(command, capture_output=True, text=True, check=True, cwd=tmp_path, env={})
    assert "take none from strangers" in done.stdout
    assert "usage: scripts/train.py" in done.stdout


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_is_a_script_of_the_clone(command):
    script = SCRIPTS / f"{command.replace('-', '_')}.py"
    assert f"from wt_gym.commands.{module_of(command)} import main" in script.read_text(encoding="utf-8")
    assert os.access(script, os.X_OK)
