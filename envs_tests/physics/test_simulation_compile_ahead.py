"""Kernels compiled ahead of the first run."""

import os
import subprocess
import sys

import pytest

STEP = """
import gymnasium as gym, wt_gym
env = gym.make("wt_gym/NREL5MW-Turbulent-v0")
env.reset(seed=0)
env.step(env.action_space.sample())
"""


@pytest.mark.slow
def test_nothing_is_left_for_the_first_step(tmp_path):
    """From an empty cache; the command ends with a step."""
    environment = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path)}
    subprocess.run([sys.executable, "-m", "wt_gym", "compile"], env=environment, check=True)
    before = kernels(tmp_path)
    assert len(before) > 50
    subprocess.run([sys.executable, "-c", STEP], env=environment, check=True)
    assert kernels(tmp_path) == before


def kernels(folder):
    """Compiled kernels in a folder, with the times at which they were written."""
    return {path: path.stat().st_mtime_ns for path in folder.rglob("*.nbc")}
