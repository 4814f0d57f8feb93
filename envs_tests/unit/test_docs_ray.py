"""The page on Ray says what is there; without Ray."""

import re
import shlex
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from wt_gym.commands import benchmark, evaluate, loadcases, search, train

ROOT = Path(__file__).resolve().parents[2]
PAGE = ROOT / "docs" / "ray.md"
TEXT = PAGE.read_text(encoding="utf-8")
COMMANDS = re.findall(r"scripts/(train|evaluate|search)\.py ([^#\n]*)", TEXT)
OTHERS = [("benchmark", "run ipc --engine ray --address auto"), ("loadcases", "ipc --engine ray --address auto")]
MODULES = {"train": train, "evaluate": evaluate, "search": search, "benchmark": benchmark, "loadcases": loadcases}


@pytest.mark.parametrize(("command", "words"), [*COMMANDS, *OTHERS])
def test_commands_are_accepted(command, words):
    assert MODULES[command].parse_arguments(shlex.split(words)).engine == "ray"


def test_its_set_up_is_that_of_the_package():
    pins = dict(line.split("==") for line in (ROOT / "constraints-ray.txt").read_text().splitlines() if "==" in line)
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["optional-dependencies"]
    assert any(need.startswith("ray[rllib]") for need in extras["ray"])
    assert pins["gymnasium"] == "1.2.2"  # RLlib's
    assert {"ray", "torch", "numba", "stable_baselines3"} <= set(pins)
    assert "(docs/ray.md)" in (ROOT / "README.md").read_text(encoding="utf-8")


def test_nothing_imports_ray_that_does_not_ask_for_it():
    program = (
        "import sys, wt_gym.agents.train, wt_gym.agents.evaluation, wt_gym.runs.executors, "
        "wt_gym.agents.training.search, wt_gym.agents.benchmark_runs; sys.exit('ray' in sys.modules)"
    )
    assert subprocess.run([sys.executable, "-c", program], cwd=ROOT, check=False).returncode == 0
