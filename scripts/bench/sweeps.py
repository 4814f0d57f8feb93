"""Measure sweeps: the same runs one after another, in processes and with Ray, and what it costs to schedule tasks.

    python scripts/bench/sweeps.py scaling --workers 2
    python scripts/bench/sweeps.py overhead --nodes 20 --tasks 1000

Numbers of docs/ray.md. The first prints the wall time of each executor for the same evaluation, start of the processes
included, and whether its files are those of the first, on a machine without other work. The second starts a cluster of
many small nodes on this machine (Ray's own test utility: real schedulers, no network) and gives it tasks that do
nothing. Both need the extra "ray".
"""

import argparse
import json
import shutil
import tempfile
import time
from pathlib import Path

from wt_gym.analysis.results import Wind
from wt_gym.base.process_memory import peak_memory
from wt_gym.experiment.evaluation import EvaluationConfig, evaluate
from wt_gym.experiment.execute import ProcessExecutor, SerialExecutor, executor_for


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
            clock = time.monotonic()
            with make() as executor:
                evaluate({"a": "baseline"}, config, folder=folder / name, executor=executor, progress=False)
                wall = time.monotonic() - clock
            files = sorted((folder / name / "runs").iterdir())
            found = {file.name: file.read_bytes() for file in files}
            reference = reference or found
            stamps = [file.stat().st_mtime for file in files]
            figures[name] = {
                "wall_seconds": round(wall, 1),
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
