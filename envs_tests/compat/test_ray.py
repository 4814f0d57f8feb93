"""Sweeps on Ray; on demand (``-m slow``), in an environment with the extra ``ray``.

Kernels should be in the cache before, else the first test compiles them.
"""

import json
import os
import signal
import subprocess
import sys
import threading
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

pytestmark = pytest.mark.slow
ray = pytest.importorskip("ray", reason="the extra 'ray' is not installed: pip install '.[ray]'")

from ray.cluster_utils import Cluster  # noqa: E402

from wt_gym.analysis.results import Wind  # noqa: E402
from wt_gym.experiment.evaluation import EvaluationConfig, evaluate  # noqa: E402
from wt_gym.experiment.execute import ATTEMPTS, RayExecutor  # noqa: E402
from wt_gym.experiment.loadcase_runs import LoadCaseConfig, run_load_cases  # noqa: E402
from wt_gym.experiment.loadcases import plan_of  # noqa: E402
from wt_gym.experiment.store import SWEEP_FILE  # noqa: E402
from wt_gym.turbines import load_turbine  # noqa: E402

ray.cloudpickle.register_pickle_by_value(sys.modules[__name__])  # workers do not find the modules of tests
CLONE = Path(__file__).parents[2]
STEADY = "wt_gym/NREL5MW-Steady-v1"
SPEEDS = (8.0, 9.0, 10.0, 11.0, 12.0, 13.0)
CONFIG = EvaluationConfig(env_id=STEADY, winds=tuple(map(Wind, SPEEDS)), duration=60.0, skip=2.0, replay=1.0)
AGENTS = {"discon": "discon"}
COMMAND = [
    *(sys.executable, "-m", "wt_gym", "evaluate", "baseline", "--env", STEADY, "--duration", "60", "--skip", "2"),
    *("--replay", "1", "--no-report", "--wind-speed", *map(str, SPEEDS)),
]
NODE = {"num_cpus": 1, "object_store_memory": 100 * 2**20}


@pytest.fixture(scope="module")
def serial(tmp_path_factory):
    """Files of the runs made one after another in this process."""
    folder = tmp_path_factory.mktemp("serial")
    evaluate(AGENTS, CONFIG, folder=folder, progress=False)
    return files_of(folder)


def files_of(folder: Path) -> dict[str, bytes]:
    """Content of the files of the runs, by name."""
    return {file.name: file.read_bytes() for file in sorted((folder / "runs").iterdir())}


def workers_at_work(pid: int) -> list[int]:
    """Processes below this one that do a job of a sweep."""
    children, found = {}, []
    for entry in Path("/proc").glob("[0-9]*"):
        try:
            stat, title = (entry / "stat").read_text(), (entry / "cmdline").read_bytes()
        except (FileNotFoundError, ProcessLookupError):
            continue
        parent = int(stat.rpartition(")")[2].split()[1])
        children.setdefault(parent, []).append((int(entry.name), title))
    left = [pid]
    while left:
        for child, title in children.get(left.pop(), []):
            left.append(child)
            if title.startswith(b"ray::played"):
                found.append(child)
    return found


def once_at_work(folder: Path, what) -> threading.Thread:
    """Do something when a first run has been kept and another is being made."""

    def watch() -> None:
        until = time.monotonic() + 1200.0
        while time.monotonic() < until:
            if any((folder / "runs").glob("*.nc")) and (working := workers_at_work(os.getpid())):
                what(working)
                return
            time.sleep(0.02)

    thread = threading.Thread(target=watch, daemon=True)
    thread.start()
    return thread


def simulated(speed: float) -> bytes:
    """Signals of a short run."""
    import gymnasium as gym

    import wt_gym  # noqa: F401 - registers the environments

    env = gym.make(STEADY, wind_speed=speed)
    env.reset(seed=0)
    observations = [env.step(np.zeros(env.action_space.shape, np.float32))[0] for _ in range(3)]
    env.close()
    return np.array(observations).tobytes()


def always_killed(speed: float) -> bytes:
    """Signals of a short run, but for one that its process never survives."""
    if speed == SPEEDS[1]:
        os.kill(os.getpid(), signal.SIGKILL)
    return simulated(speed)


def failing(speed: float) -> bytes:
    """Raise an error, as a mistake in the work would."""
    raise FloatingPointError(f"no run at {speed:g} m/s")


def test_a_worker_that_is_killed_costs_no_run(serial, tmp_path):
    with RayExecutor(workers=2) as executor:
        watch = once_at_work(tmp_path, lambda working: os.kill(working[0], signal.SIGKILL))
        evaluate(AGENTS, CONFIG, folder=tmp_path, executor=executor, progress=False)
        watch.join()
    assert json.loads((tmp_path / SWEEP_FILE).read_text()) == [{"found": 0, "made": 6, "retried": 1, "lost": []}]
    assert files_of(tmp_path) == serial


def test_jobs_that_no_process_survives_are_lost_and_errors_of_the_work_are_raised():
    with RayExecutor(workers=2) as executor:
        done = {}
        with pytest.raises(ChildProcessError, match="1 of 3 jobs were lost"):
            done.update(executor.results(always_killed, SPEEDS[:3]))
        assert done == {speed: simulated(speed) for speed in (SPEEDS[0], SPEEDS[2])}
        assert (executor.tally.retried, executor.tally.lost) == (ATTEMPTS - 1, [SPEEDS[1]])
        with pytest.raises(FloatingPointError, match="no run at 8 m/s"):
            list(executor.results(failing, SPEEDS[:1]))


def test_a_machine_that_is_lost_costs_no_run(serial, tmp_path):
    cluster = Cluster(initialize_head=True, head_node_args=NODE | {"num_cpus": 0})
    try:
        _, second = cluster.add_node(**NODE), cluster.add_node(**NODE)
        cluster.wait_for_nodes()
        with RayExecutor(cluster.address) as executor:
            watch = once_at_work(tmp_path, lambda _: cluster.remove_node(second, allow_graceful=False))
            evaluate(AGENTS, CONFIG, folder=tmp_path, executor=executor, progress=False)
            watch.join()
    finally:
        cluster.shutdown()
    (row,) = json.loads((tmp_path / SWEEP_FILE).read_text())
    assert (row["made"], row["lost"]) == (6, [])
    assert 1 <= row["retried"] <= 3  # what was queued there may count too
    assert files_of(tmp_path) == serial


def test_a_sweep_whose_driver_is_killed_goes_on(serial, tmp_path):
    command = [*COMMAND, "--engine", "ray", "--jobs", "2", "--out", str(tmp_path)]
    with subprocess.Popen(command, cwd=CLONE, stderr=subprocess.DEVNULL) as driver:
        until = time.monotonic() + 1200.0
        while not any((tmp_path / "runs").glob("*.nc")) and time.monotonic() < until:
            time.sleep(0.02)
        driver.kill()
    left = {file.name for file in (tmp_path / "runs").glob("*.nc")}
    assert 0 < len(left) < 6
    subprocess.run(command, cwd=CLONE, check=True, capture_output=True)
    (row,) = json.loads((tmp_path / SWEEP_FILE).read_text())  # the killed one could write none
    assert row == {"found": len(left), "made": 6 - len(left), "retried": 0, "lost": []}
    assert files_of(tmp_path) == serial


def test_load_cases_are_the_same_files(tmp_path):
    plan = replace(plan_of(load_turbine("nrel_5mw"), quick=True), length=10.0, speeds=(12.0,), seeds=2)
    config = LoadCaseConfig(cases=("1.3", "6.1"), plan=plan)
    with RayExecutor(workers=2) as executor:
        there = run_load_cases({"ipc": "ipc"}, config, tmp_path / "there", executor=executor, progress=False)
    here = run_load_cases({"ipc": "ipc"}, config, tmp_path / "here", progress=False)
    assert len(files_of(tmp_path / "here")) == 2 + 2
    assert files_of(tmp_path / "there") == files_of(tmp_path / "here")
    assert there.to_json() == here.to_json()
