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


def run(*command):
    environment = os.environ | {"PYTHONPATH": str(ROOT), "OMP_NUM_THREADS": "1"}
    return subprocess.run([sys.executable, *command], env=environment, capture_output=True, text=True, timeout=600)


@pytest.mark.slow
@pytest.mark.parametrize("method", ["forkserver", "spawn"])
def test_an_id_that_names_the_package_works_from_a_notebook(method):
    """As in a notebook, the main module has no file that a process could import."""
    done = run("-c", PROCESSES.format(id=NAMED, method=method) + "main()")
    assert (done.returncode, done.stdout) == (0, "2 2\n"), done.stderr


@pytest.mark.slow
def test_without_it_the_process_knows_no_such_id():
    """What the page on trouble says of this message."""
    done = run("-c", PROCESSES.format(id=NAMED.partition(":")[2], method="forkserver") + "main()")
    assert done.returncode == 1
    assert "NamespaceNotFound: Namespace wt_gym not found" in done.stderr


@pytest.mark.slow
@pytest.mark.parametrize("guarded", [True, False])
def test_a_program_begins_processes_where_it_is_run_only(tmp_path, guarded):
    """What the page on trouble says of programs."""
    program = tmp_path / "program.py"
    call = "if __name__ == '__main__':\n    main()" if guarded else "main()"
    program.write_text(PROCESSES.format(id=NAMED, method="forkserver") + call)
    done = run(program)
    assert (done.returncode, done.stdout) == ((0, "2 2\n") if guarded else (1, "")), done.stderr
    assert guarded or "if __name__ == '__main__':" in done.stderr
