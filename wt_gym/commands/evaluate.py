"""Evaluate agents in held-out winds, and write a report.

    wt-gym evaluate baseline runs/ppo
    wt-gym evaluate baseline first=runs/a second=runs/b ipc --wind-speed 12 15 18 --duration 600
    wt-gym evaluate baseline runs/ppo --engine ray --address ray-head:6379
    wt-gym evaluate discon ipc constrained_ipc:level=0.15 less_travel=ipc+tower_dampers:ipc__limit=0.05

An agent is one of these words or paths, with NAME= in front if you like:

    baseline                   the base controller of residual actions, else discon, by whose name it is shown
    zero, random               the middle of every action (also: constant); even draws
    CONTROLLER[:KEY=VALUE,...] any controller of docs/baselines.md, parts joined with "+", with parameters; write
                               controller:NAME, or ./NAME for a folder, where both could be meant
    FILE.py:CLASS, MODULE:CLASS  a controller of your own, or a class with predict, with :KEY=VALUE,... behind it; its
                               code is run
    FOLDER or FILE.zip         a trained model; the folder of a training with several seeds is one agent a seed. Any
                               model of stable-baselines3 will do (FILE.zip:algo=SAC, or --algo), see
                               docs/howto/own_agent.md

The first is the reference. Every run is kept in the folder of the results as soon as it is done: the same command
resumes. docs/evaluation.md says what the figures mean.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

from wt_gym.commands.options import (
    MODELS,
    WORKERS,
    add_climate,
    add_shared,
    agents_of,
    climate_of,
    environment_of,
    evaluation_of,
    executor_of,
)
from wt_gym.commands.program import UNSAFE

if TYPE_CHECKING:
    from wt_gym.experiment.evaluation import EvaluationConfig

EPILOG = UNSAFE
STOPPED = "the same command without --overwrite resumes with what is in {out}"


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    parser.add_argument("agents", nargs="*", default=["baseline"], help="agents; the first is the reference")
    speeds = "mean speeds [m/s] (default: 15, or the middle of what the environment draws where that is not in it)"
    add_shared(
        parser, "env", "out", "overwrite", "wind_speed", "wind_seeds", "duration", "skip", "fidelity", "env_kwargs",
        "site", "wind", "simulator", "allow_other_environment", *MODELS, *WORKERS, out="runs/evaluation",
        wind_speed={"help": speeds},
    )  # fmt: skip
    parser.add_argument(
        "--draws", type=int, metavar="N",
        help="winds at each speed where something else than turbulence is drawn, as gusts or files (default: six)",
    )  # fmt: skip
    add_climate(parser)
    report = parser.add_argument_group("report")
    report.add_argument(
        "--replay", type=float, default=20.0, metavar="S",
        help="length of the replay, the end of the runs in the first wind [s]; 0: none (default: %(default)s)",
    )  # fmt: skip
    report.add_argument(
        "--crosscheck", metavar="FILE",
        help="crosscheck.json: agents that have the same name in it get its figures of the other simulator beside "
        "those of the evaluation, where that has one mean wind speed",
    )  # fmt: skip
    add_shared(report, "title", "no_report", "json")


def configuration(arguments: argparse.Namespace) -> EvaluationConfig:
    """Configuration of the options."""
    kwargs = environment_of(arguments)
    replay = 0.0 if "simulator" in kwargs else arguments.replay  # others give no shapes
    return evaluation_of(arguments, kwargs, replay=replay, climate=climate_of(arguments))


def run(arguments: argparse.Namespace) -> dict[str, Any]:
    """Evaluate, write the report and print the table."""
    from wt_gym.analysis.report import write_report
    from wt_gym.analysis.results import run_files
    from wt_gym.analysis.summary import results_table, summarize
    from wt_gym.experiment.evaluation import REPORT_FILE, evaluate

    out, crosscheck = Path(arguments.out), None
    with executor_of(arguments) as executor:
        config = configuration(arguments)
        if arguments.crosscheck is not None:
            crosscheck = json.loads(Path(arguments.crosscheck).read_text(encoding="utf-8"))
        agents = agents_of(arguments, arguments.agents, config.env_id, config.env_kwargs)
        evaluation = evaluate(
            agents, config, folder=out, overwrite=arguments.overwrite,
            allow_other_environment=arguments.allow_other_environment, executor=executor,
        )  # fmt: skip
    if not arguments.no_report:
        write_report(evaluation, out / REPORT_FILE, arguments.title, run_files(out), crosscheck)
    print("\n".join([*results_table(evaluation), "", *summarize(evaluation)]))
    print(f"metrics and signals: {out}")
    if not arguments.no_report:
        print(f"report: {out / REPORT_FILE}")
    return evaluation.to_json()
