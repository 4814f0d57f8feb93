"""Jobs in several processes."""

import os
import subprocess
import sys
import time
from pathlib import Path

import pytest

from wt_gym.agents.workers import check_workers, in_processes

PROGRAM = """
import time
from wt_gym.agents.workers import in_processes

if __name__ == "__main__":
    for job, _ in in_processes(time.sleep, (0, 600, 601), 2):
        print(job, flush=True)
"""


def test_each_job_comes_with_its_result_and_one_thread():
    found = dict(in_processes(os.getenv, ("OMP_NUM_THREADS", "NUMBA_NUM_THREADS", "WT_GYM_NOTHING"), 2))
    assert found == {"OMP_NUM_THREADS": "1", "NUMBA_NUM_THREADS": "1", "WT_GYM_NOTHING": None}


def test_a_job_that_fails_ends_all():
    with pytest.raises(ValueError, match="sleep length must be non-negative"):
        list(in_processes(time.sleep, (-1, 0), 1))


def test_workers_end_with_a_process_that_is_killed(tmp_path):
    """They hold its output open: that ends when the last of them has."""
    program = tmp_path / "program.py"
    program.write_text(PROGRAM)
    environment = os.environ | {"PYTHONPATH": str(Path(__file__).parents[2])}
    with subprocess.Popen([sys.executable, str(program)], stdout=subprocess.PIPE, env=environment) as process:
        assert process.stdout.readline() == b"0\n"
        process.kill()
        rest, _ = process.communicate(timeout=60.0)
    assert rest == b""


def test_no_worker_is_refused():
    with pytest.raises(ValueError, match="at least 1 job must run at a time, got 0"):
        check_workers(0)
