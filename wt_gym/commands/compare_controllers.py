"""Compare controllers in the same winds; changes are against the first.

    wt-gym compare-controllers discon ipc constrained_ipc:level=0.1 --wind-speed 12 15 18 --wind-seeds 1001 1002

A controller is a name of wt-gym list controllers, with parameters behind a colon, a class of your own (file.py:Class),
or any other agent of wt-gym evaluate, as a trained model: that runs in an environment with the same winds. Without
one, discon, rosco (where its package is installed), tsr_tracking, ipc and tuned are compared.
"""

from __future__ import annotations

import itertools
import json
import sys
from typing import TYPE_CHECKING

from wt_gym.base.files import require_writable
from wt_gym.commands.options import MODELS, WORKERS, add_shared, agents_of, executor_of, turbine_of
from wt_gym.commands.program import file_ending_in
from wt_gym.runs.progress import TimeLeft

if TYPE_CHECKING:
    import argparse

    from wt_gym.experiment.comparison import Case, ControllerRuns

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
    from wt_gym.experiment.comparison import in_all_winds
    from wt_gym.experiment.comparison_page import write_comparison

    names = ("turbine", "wind_speed", "wind_seeds", "duration", "skip", "fidelity", "control_dt", "simulator")
    settings = {name: getattr(arguments, name) for name in names}
    print(f"report: {write_comparison(in_all_winds(runs), arguments.report, turbine, settings)}")


def show(runs: list[ControllerRuns], as_json: bool) -> None:
    """Print the table of the winds in which every controller has run, and what failed."""
    from wt_gym.analysis.metrics import idle_sentence
    from wt_gym.experiment.comparison import in_all_winds, table

    runs = in_all_winds(runs)
    print(table(runs))
    for run in runs:
        for message in dict.fromkeys(run.failures.values()):
            cases = [case.label for case, own in run.failures.items() if own == message]
            print(f"{run.name} at {'; '.join(cases)}: {message}")
        if sentence := idle_sentence(run.name, ((case.label, time) for case, time in run.idle.items())):
            print(sentence)
    if as_json:
        rows = [
            {"controller": r.name, "wind_speed": c.wind_speed, "seed": c.seed, **m}
            for r in runs
            for c, m in r.metrics.items()
        ]
        print(json.dumps(rows), flush=True)


def run(arguments: argparse.Namespace) -> None:
    """Run, and show what was done of a stopped series too."""
    from wt_gym.experiment.comparison import Case, run_cases
    from wt_gym.experiment.names import COMPARED, available, read_name

    names = agents_of(arguments, arguments.controllers or available(COMPARED))
    controllers = {label: ((name := read_name(text)).target, name.parameters) for label, text in names.items()}
    cases = [Case(wind, seed) for wind in arguments.wind_speed for seed in (arguments.wind_seeds or [None])]
    if arguments.report:
        require_writable(arguments.report.parent)
    turbine = turbine_of(arguments)
    left, numbers = TimeLeft(len(cases) * len(controllers)), itertools.count(1)

    def progress(name: str, case: Case) -> None:
        print(f"run {left.text(next(numbers))}: {name} at {case.label}", file=sys.stderr, flush=True)

    runs: list[ControllerRuns] = []
    try:
        with executor_of(arguments) as executor:
            run_cases(
                turbine, controllers, cases, arguments.duration, arguments.skip, arguments.fidelity,
                arguments.control_dt, progress, runs, simulator=arguments.simulator, executor=executor,
            )  # fmt: skip
    finally:
        if any(run.done for run in runs):
            show(runs, arguments.json)
            if arguments.report:
                write_report(runs, turbine.title, arguments)
