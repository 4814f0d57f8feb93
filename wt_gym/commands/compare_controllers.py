"""Compare controllers in the same winds; changes are against the first.

    wt-gym compare-controllers discon ipc constrained_ipc:level=0.1 --wind-speed 12 15 18 --wind-seeds 1001 1002

A controller is a name of wt-gym list controllers, with parameters behind a colon, a class of your own (file.py:Class),
or any other agent of wt-gym evaluate, as a trained model: that runs in an environment with the same winds. Without
one, discon, rosco (where its package is installed), tsr_tracking, ipc and tuned are compared.
"""

from __future__ import annotations

import argparse
import json
from typing import TYPE_CHECKING

from wt_gym.base.files import require_writable
from wt_gym.commands.options import MODELS, WORKERS, add_shared, agents_of, executor_of, turbine_of
from wt_gym.commands.program import file_ending_in

if TYPE_CHECKING:
    from wt_gym.experiment.comparison import ControllerRuns

STOPPED = "shown are the winds in which every controller has run"


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    parser.add_argument("controllers", nargs="*", metavar="CONTROLLER")
    add_shared(
        parser, "turbine", "site", "simulator", wind_speed=[12.0, 15.0, 18.0],
        wind_seeds={"nargs": "*", "default": [1001, 1002], "help": "turbulence seeds; none: steady wind"},
        duration={"default": 150.0, "help": "measured time [s] (default: %(default)s)"},
        skip={"help": "time before it [s] (default: %(default)s)"},
    )  # fmt: skip
    parser.add_argument("--control-dt", type=float, metavar="S", help="step of the controller [s]")
    add_shared(parser, "fidelity", *MODELS, *WORKERS)
    parser.add_argument("--report", type=file_ending_in(".html"), metavar="FILE", help="HTML page to write")
    add_shared(parser, "json")


def write_report(runs: list[ControllerRuns], turbine: str, arguments: argparse.Namespace) -> None:
    """Write the page of the winds in which every controller has run."""
    from wt_gym.experiment.comparison import in_all_winds, write_comparison

    names = ("turbine", "wind_speed", "wind_seeds", "duration", "skip", "fidelity", "control_dt", "simulator")
    settings = {name: getattr(arguments, name) for name in names}
    print(f"report: {write_comparison(in_all_winds(runs), arguments.report, turbine, settings)}")


def show(runs: list[ControllerRuns], as_json: bool) -> None:
    """Print the table of the winds in which every controller has run, and what failed."""
    from wt_gym.analysis.metrics import idle_sentence
    from wt_gym.experiment.comparison import comparison_table, in_all_winds

    runs = in_all_winds(runs)
    print(comparison_table(runs))
    for run in runs:
        for message in dict.fromkeys(run.failures.values()):
            winds = [wind.label for wind, own in run.failures.items() if own == message]
            print(f"{run.name} at {'; '.join(winds)}: {message}")
        if sentence := idle_sentence(run.name, ((wind.label, time) for wind, time in run.idle.items())):
            print(sentence)
    if as_json:
        rows = [
            {"controller": r.name, "wind_speed": c.speed, "seed": c.seed, **m}
            for r in runs
            for c, m in r.metrics.items()
        ]
        print(json.dumps(rows), flush=True)


def run(arguments: argparse.Namespace) -> None:
    """Run, and show what was done of a stopped series too."""
    from wt_gym.analysis.results import Wind
    from wt_gym.experiment.comparison import ComparisonConfig, run_cases
    from wt_gym.experiment.names import COMPARED, available, read_name

    names = agents_of(arguments, arguments.controllers or available(COMPARED))
    controllers = {label: ((name := read_name(text)).target, name.parameters) for label, text in names.items()}
    winds = [Wind(wind, seed) for wind in arguments.wind_speed for seed in (arguments.wind_seeds or [None])]
    if arguments.report:
        require_writable(arguments.report.parent)
    turbine = turbine_of(arguments)
    settings = ComparisonConfig(
        duration=arguments.duration, skip=arguments.skip, fidelity=arguments.fidelity,
        control_dt=arguments.control_dt, simulator=arguments.simulator,
    )  # fmt: skip
    runs: list[ControllerRuns] = []
    try:
        with executor_of(arguments) as executor:
            run_cases(turbine, controllers, winds, settings, runs=runs, executor=executor, progress=True)
    finally:
        if any(run.done for run in runs):
            show(runs, arguments.json)
            if arguments.report:
                write_report(runs, turbine.heading, arguments)
