"""Measure sweeps: the same runs one after another, in processes and with Ray, and what it costs to schedule tasks.

    python scripts/bench/sweeps.py scaling --workers 2
    python scripts/bench/sweeps.py overhead --nodes 20 --tasks 1000

The first prints wall and processor time of each executor for the same evaluation, start of the processes included, and
whether its files are those of the first; on a machine with other work the processor time is the better measure. The
second starts a cluster of many small nodes on this machine (Ray's own test utility: real schedulers, no network) and
gives it tasks that do nothing. Both need the extra "ray".
"""

import argparse
import json
import os
import shutil
import sys
import tempfile
import threading
import time
from pathlib import Path

from wt_gym.analysis.results import Wind
from wt_gym.base.process_memory import peak_memory
from wt_gym.experiment.evaluation import EvaluationConfig, evaluate
from wt_gym.runs.executors import ProcessExecutor, SerialExecutor, executor_for

if not Path("/proc/self/stat").exists():
    sys.exit("error: processor times are read from /proc, which only Linux has")
_TICKS = os.sysconf("SC_CLK_TCK")


def cpu_below() -> dict[int, float]:
    """Processor time [s] of this process and of all below it, by process."""
    times, children = {}, {}
    for entry in Path("/proc").glob("[0-9]*"):
        try:
            fields = (entry / "stat").read_text().rpartition(")")[2].split()
        except (FileNotFoundError, ProcessLookupError):
            continue
        pid = int(entry.name)
        children.setdefault(int(fields[1]), []).append(pid)
        times[pid] = (int(fields[11]) + int(fields[12])) / _TICKS
    found, left = {}, [os.getpid()]
    while left:
        pid = left.pop()
        found[pid] = times.get(pid, 0.0)
        left += children.get(pid, [])
    return found


class CpuTime(threading.Thread):
    """Adds up the processor time of this process and of those that it starts, while it runs."""

    def __init__(self):
        super().__init__(daemon=True)
        self._first, self._last, self._ended = cpu_below(), {}, threading.Event()
        self.start()

    def run(self) -> None:
        while not self._ended.wait(0.5):
            self._last |= cpu_below()

    def end(self) -> float:
        """Processor time since the start [s]; a process that ends loses its last half second at most."""
        self._last |= cpu_below()
        self._ended.set()
        return sum(seconds - self._first.get(pid, 0.0) for pid, seconds in self._last.items())


def scaling(arguments: argparse.Namespace) -> dict:
    """Make the same evaluation with each executor."""
    winds = tuple(Wind(8.0 + 0.5 * k) for k in range(arguments.runs))
    config = EvaluationConfig(
        env_id=arguments.env, winds=winds, duration=arguments.duration, skip=2.0, replay=0.0
    )  # fmt: skip
    folder, reference, figures = Path(tempfile.mkdtemp()), None, {}
    executors = {
        "serial": SerialExecutor,
        "processes": lambda: ProcessExecutor(arguments.workers),
        "ray": lambda: executor_for("ray", arguments.workers),
    }
    try:
        evaluate(
            {"a": "baseline"}, EvaluationConfig(arguments.env, winds=winds[:1], duration=5.0, skip=1.0), progress=False
        )
        for name, make in executors.items():
            clock, cpu = time.monotonic(), CpuTime()
            with make() as executor:
                evaluate({"a": "baseline"}, config, folder=folder / name, executor=executor, progress=False)
                wall = time.monotonic() - clock
                seconds = cpu.end()
            files = sorted((folder / name / "runs").iterdir())
            found = {file.name: file.read_bytes() for file in files}
            reference = reference or found
            stamps = [file.stat().st_mtime for file in files]
            figures[name] = {
                "wall_seconds": round(wall, 1), "cpu_seconds": round(seconds, 1),
                "first_to_last_run_seconds": round(max(stamps) - min(stamps), 1), "same_files": found == reference,
            }  # fmt: skip
            print(name, figures[name], flush=True)
    finally:
        shutil.rmtree(folder)
    return figures


def nothing(job: int) -> int:
    """Do what takes no time."""
    return job


def overhead(arguments: argparse.Namespace) -> dict:
    """Schedule tasks that do nothing on many small nodes."""
    from ray.cluster_utils import Cluster

    node = {"num_cpus": 1, "object_store_memory": 80 * 2**20}
    started = time.monotonic()
    cluster = Cluster(initialize_head=True, head_node_args={**node, "num_cpus": 0})
    try:
        for _ in range(arguments.nodes):
            cluster.add_node(**node)
        cluster.wait_for_nodes()
        with executor_for("ray", address=cluster.address) as executor:
            list(executor.results(nothing, range(arguments.nodes)))  # starts the workers
            ready, cpu = time.monotonic(), time.process_time()
            done = [job for job, _ in executor.results(nothing, range(arguments.tasks))]
            wall, cpu = time.monotonic() - ready, time.process_time() - cpu
    finally:
        cluster.shutdown()
    assert sorted(done) == list(range(arguments.tasks))
    return {
        "nodes": arguments.nodes, "tasks": arguments.tasks, "start_seconds": round(ready - started, 1),
        "wall_seconds": round(wall, 2), "ms_a_task": round(1e3 * wall / arguments.tasks, 2),
        "driver_cpu_ms_a_task": round(1e3 * cpu / arguments.tasks, 2),
        "peak_memory_of_driver_mb": int(peak_memory() or 0.0),
    }  # fmt: skip


def main() -> None:
    """Measure."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    commands = parser.add_subparsers(dest="command", required=True)
    one = commands.add_parser("scaling")
    one.add_argument("--env", default="wt_gym/NREL5MW-Steady-v1")
    one.add_argument("--runs", type=int, default=8)
    one.add_argument("--duration", type=float, default=600.0, help="of a run [s]")
    one.add_argument("--workers", type=int, default=2)
    two = commands.add_parser("overhead")
    two.add_argument("--nodes", type=int, default=20)
    two.add_argument("--tasks", type=int, default=1000)
    arguments = parser.parse_args()
    print(json.dumps({"scaling": scaling, "overhead": overhead}[arguments.command](arguments)))


if __name__ == "__main__":
    main()
