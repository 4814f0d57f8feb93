"""The set-up is done once, and again where the clone was moved, changed, or left by an interrupted one."""

import shutil
import subprocess
from pathlib import Path

import pytest

SETUP = Path(__file__).resolve().parents[2] / "scripts" / "setup.sh"
WHOLE = 6
"""Calls of a set-up: environment, four installations, bytecode."""
# Stands for an interpreter: notes what it is asked to do, and copies itself where an environment is wanted. A file
# "cut" ends it there as a signal would.
PYTHON = """#!/bin/sh
echo "$@" >>"$PWD/calls"
if [ "$1 $2" = "-m venv" ]; then mkdir -p "$3/bin" && cp "$0" "$3/bin/python"; fi
if [ "$2" = pip ] && [ -f cut ]; then kill -TERM $$; fi
"""


@pytest.fixture
def clone(tmp_path):
    clone = tmp_path / "clone"
    (clone / "scripts").mkdir(parents=True)
    shutil.copy(SETUP, clone / "scripts")
    for name in ("pyproject.toml", "constraints.txt"):
        (clone / name).write_text(name)
    (tmp_path / "python").write_text(PYTHON)
    (tmp_path / "python").chmod(0o755)
    return clone


def calls(clone, status=0, **variables):
    """Calls of the interpreter by a set-up, except for the questions whether it is there."""
    env = {"PYTHON": str(clone.parent / "python"), "PATH": "/usr/bin:/bin", **variables}
    command = ["bash", clone / "scripts" / "setup.sh"]
    done = subprocess.run(command, env=env, capture_output=True, text=True, check=False)
    assert (done.returncode == 0) == (status == 0), done.stderr
    log = clone / "calls"
    lines = log.read_text().splitlines() if log.exists() else []
    log.unlink(missing_ok=True)
    return [line for line in lines if not line.startswith("-c")]


def test_it_is_done_once(clone):
    venv, *installs, bytecode = calls(clone)
    assert venv == "-m venv .venv"
    wanted = ["hatchling>=1.27", "torch", ".[train,test,tune,docs]", "rosco>=2.10,<3"]
    assert [line.split()[-1] for line in installs] == wanted
    assert all("--no-compile" in line for line in installs)
    assert bytecode.startswith("- gymnasium ")
    assert calls(clone) == []


def test_torch_is_the_build_for_cpus_and_comes_alone(clone):
    """Another index is asked for one package; a name that only it knows can come from nowhere else."""
    (torch,) = [line for line in calls(clone) if line.endswith(" torch")]
    assert "--extra-index-url https://download.pytorch.org/whl/cpu" in torch
    assert "--no-deps" in torch
    shutil.rmtree(clone / ".venv")
    (torch,) = [line for line in calls(clone, TORCH_INDEX="https://example.org/simple") if line.endswith(" torch")]
    assert "--extra-index-url https://example.org/simple" in torch


def test_an_environment_with_all_serves_what_needs_less(clone):
    """The demo installs what training needs; tests complete it in place, and the demo then finds all it needs."""
    *_, extras, _ = calls(clone, EXTRAS="train")
    assert extras.split()[-1] == ".[train]"
    assert calls(clone, EXTRAS="train") == []
    (clone / ".venv" / "installed").write_text("")
    assert len(calls(clone)) == WHOLE
    assert (clone / ".venv" / "installed").exists()
    assert calls(clone, EXTRAS="train") == calls(clone) == []


@pytest.mark.parametrize("move", [shutil.move, shutil.copytree])
def test_a_moved_or_copied_clone_is_brought_up_to_date_in_place(clone, move):
    calls(clone)
    (clone / ".venv" / "installed").write_text("")
    other = clone.with_name("other")
    move(clone, other)
    assert len(calls(other)) == WHOLE
    assert (other / ".venv" / "installed").exists()
    assert calls(other) == []


@pytest.mark.parametrize("name", ["pyproject.toml", "constraints.txt", ".venv/bin/python"])
def test_other_requirements_and_a_lost_interpreter_are_installed(clone, name):
    calls(clone)
    (clone / name).unlink()
    if not name.startswith(".venv"):
        (clone / name).write_text("another version")
    assert len(calls(clone)) == WHOLE


def test_an_interrupted_set_up_is_made_anew(clone):
    (clone / "cut").write_text("")
    calls(clone, status=1)
    (clone / ".venv" / "half").write_text("")
    (clone / "cut").unlink()
    assert len(calls(clone)) == WHOLE
    assert not (clone / ".venv" / "half").exists()
    assert calls(clone) == []
