"""Jobs in several processes."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from wt_gym.experiment.execute import ATTEMPTS, ProcessExecutor, Tally, executor_for

PROGRAM = """
import time
from wt_gym.experiment.execute import ProcessExecutor

if __name__ == "__main__":
    for job, _ in ProcessExecutor(2).results(time.sleep, (0, 600, 601)):
        print(job, flush=True)
"""


def test_each_job_comes_with_its_result_and_one_thread():
    found = dict(ProcessExecutor(2).results(os.getenv, ("OMP_NUM_THREADS", "NUMBA_NUM_THREADS", "WT_GYM_NOTHING")))
    assert found == {"OMP_NUM_THREADS": "1", "NUMBA_NUM_THREADS": "1", "WT_GYM_NOTHING": None}


def test_a_job_that_fails_ends_all():
    with pytest.raises(ValueError, match="sleep length must be non-negative"):
        list(ProcessExecutor(1).results(time.sleep, (-1, 0)))


def _end_once(mark: str) -> int:
    """Kill this process, unless that has been done as often as the name of the file says."""
    path = Path(mark)
    times = len(path.read_text()) if path.exists() else 0
    if times < int(path.name):
        path.write_text("x" * (times + 1))
        os.kill(os.getpid(), signal.SIGKILL)
    return times


def test_jobs_of_killed_processes_are_begun_again_and_counted_and_lost_after_three_times(tmp_path):
    marks, executor = [str(tmp_path / str(times)) for times in (ATTEMPTS, 0, 1, 2)], ProcessExecutor(2)
    done = {}
    with pytest.raises(ChildProcessError, match=r"1 of 4 jobs were lost: 3 times the process"):
        done.update(executor.results(_end_once, marks))
    assert done == {mark: times for times, mark in enumerate(marks[1:])}
    assert executor.tally == Tally(done=3, retried=ATTEMPTS - 1 + 1 + 2, lost=marks[:1])


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


@pytest.mark.parametrize(
    ("asked", "message"),
    [
        ({"workers": 0}, "at least 1 job must run at a time, got 0"),
        ({"engine": "dask"}, "the engine must be one of local, ray, got 'dask'"),
        ({"address": "auto"}, "the engine must be ray where an address .* is given, got 'auto' without"),
    ],
)
def test_executors_that_are_none_are_refused(asked, message):
    with pytest.raises(ValueError, match=message):
        executor_for(**asked)
