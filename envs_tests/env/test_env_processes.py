"""stable-baselines3's processes, begun from a notebook and from a program."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PROCESSES = """
from stable_baselines3.common.env_util import make_vec_env
from stable_baselines3.common.vec_env import SubprocVecEnv
import wt_gym

def main():
    venv = make_vec_env("{id}", n_envs=2, vec_env_cls=SubprocVecEnv, vec_env_kwargs={{"start_method": "{method}"}})
    venv.reset()
    observations, rewards, *_ = venv.step([venv.action_space.sample() for _ in range(2)])
    venv.close()
    print(len(observations), len(rewards))
"""
NAMED = "wt_gym:wt_gym/NREL5MW-Steady-v1"
"""The part before the colon is imported wherever the environment is made."""


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "method", "call", "printed", "error"),
    [
        (NAMED, "forkserver", None, "2 2\n", ""),
        (NAMED, "spawn", None, "2 2\n", ""),
        (NAMED.partition(":")[2], "forkserver", None, "", "NamespaceNotFound: Namespace wt_gym not found"),
        (NAMED, "forkserver", "if __name__ == '__main__':\n    main()", "2 2\n", ""),
        (NAMED, "forkserver", "main()", "", "if __name__ == '__main__':"),
    ],
)
def test_processes_from_a_notebook_or_a_program(tmp_path, name, method, call, printed, error):
    """As in a notebook the main module has no file without a call; the page on trouble has the errors."""
    text = PROCESSES.format(id=name, method=method) + (call or "main()")
    program = tmp_path / "program.py"
    program.write_text(text)
    environment = os.environ | {"PYTHONPATH": str(ROOT), "OMP_NUM_THREADS": "1"}
    command = [sys.executable, *(["-c", text] if call is None else [program])]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=600)
    assert (done.returncode, done.stdout) == (int(bool(error)), printed), done.stderr
    assert error in done.stderr
