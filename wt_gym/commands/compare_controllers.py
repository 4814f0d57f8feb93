"""Compare controllers in the same winds; changes are against the first.

    wt-gym compare-controllers discon ipc constrained_ipc:level=0.1 --wind-speed 12 15 18 --wind-seeds 1001 1002

A controller is a name of wt-gym list controllers, with parameters behind a colon, a class of your own (file.py:Class),
or any other agent of wt-gym evaluate, as a trained model: that runs in an environment with the same winds. Without
one, discon, rosco (where its package is installed), tsr_tracking, ipc and tuned are compared.
"""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

from wt_gym.base.files import require_writable
from wt_gym.commands.engine_options import add_engine_options, add_model_options, executor_of
from wt_gym.commands.program import FIDELITIES_HELP, OneLineParser, file_ending_in, stoppable, user_errors
from wt_gym.commands.site_options import add_simulator_option, add_site_option

if TYPE_CHECKING:
    import argparse

    from wt_gym.experiment.comparison import ControllerRuns


def parse_arguments(words: list[str] | None = None) -> argparse.Namespace:
    """Read the command line."""
    parser = OneLineParser("compare-controllers", description=__doc__)
    parser.add_argument("controllers", nargs="*", metavar="CONTROLLER")
    parser.add_argument("--turbine", default="nrel_5mw")
    add_site_option(parser)
    add_simulator_option(parser)
    parser.add_argument(
        "--wind-speed", nargs="+", type=float, default=[12.0, 15.0, 18.0], metavar="M_S", help="mean speeds [m/s]"
    )
    parser.add_argument(
        "--wind-seeds",
        nargs="*",
        type=int,
        default=[1001, 1002],
        metavar="SEED",
        help="turbulence seeds; none: steady wind",
    )
    parser.add_argument("--duration", type=float, default=150.0, help="measured, s")
    parser.add_argument("--skip", type=float, default=30.0, help="before it, s")
    parser.add_argument("--fidelity", help=FIDELITIES_HELP)
    parser.add_argument("--control-dt", type=float, help="s")
    add_model_options(parser)
    add_engine_options(parser, "runs")
    parser.add_argument("--report", type=file_ending_in(".html"), metavar="FILE", help="HTML page to write")
    parser.add_argument("--json", action="store_true", help="print one JSON object last")
    return parser.parse_args(words)


def write_report(runs: list[ControllerRuns], turbine: str, arguments: argparse.Namespace) -> None:
    """Write the page of the winds in which every controller has run."""
    from wt_gym.experiment.comparison import in_all_winds, write_comparison

    settings = {
        name: getattr(arguments, name)
        for name in ("turbine", "wind_speed", "wind_seeds", "duration", "skip", "fidelity", "control_dt", "simulator")
    }
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


def main(words: list[str] | None = None) -> None:
    """Run."""
    arguments = parse_arguments(words)

    runs: list[ControllerRuns] = []
    with user_errors(), stoppable("shown are the winds in which every controller has run"):
        from wt_gym.analysis.results import Wind
        from wt_gym.experiment.comparison import ComparisonConfig, run_cases
        from wt_gym.experiment.names import COMPARED, available, named_choices, read_name, with_model_options
        from wt_gym.simulation.fidelity import suited_fidelity
        from wt_gym.turbines import load_turbine
        from wt_gym.turbines.model import with_site

        chosen = arguments.controllers or available(COMPARED)
        given = named_choices(with_model_options(chosen, arguments.algo, arguments.trust))
        names = {label: read_name(text) for label, text in given.items()}
        controllers = {label: (name.target, name.parameters) for label, name in names.items()}
        winds = [Wind(wind, seed) for wind in arguments.wind_speed for seed in (arguments.wind_seeds or [None])]
        if arguments.report:
            require_writable(arguments.report.parent)
        turbine = with_site(load_turbine(arguments.turbine), dict(arguments.site or ()))
        arguments.fidelity = arguments.fidelity or suited_fidelity(turbine)
        settings = ComparisonConfig(
            duration=arguments.duration, skip=arguments.skip, fidelity=arguments.fidelity,
            control_dt=arguments.control_dt, simulator=arguments.simulator,
        )  # fmt: skip
        try:
            with executor_of(arguments) as executor:
                run_cases(
                    turbine, controllers, winds, settings, runs=runs, executor=executor, progress=True,
                )  # fmt: skip
        finally:  # of a stopped series too
            if any(run.done for run in runs):
                show(runs, arguments.json)
                if arguments.report:
                    write_report(runs, turbine.title, arguments)
