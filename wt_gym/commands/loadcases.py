"""Run design load cases of IEC 61400-1 with agents and controllers, and write a report.

    wt-gym loadcases --quick
    wt-gym loadcases baseline ipc runs/ppo --jobs 2
    wt-gym loadcases baseline runs/ppo --case 1.3 1.4 2.3 --quick
    wt-gym loadcases baseline runs/ppo --engine ray --address ray-head:6379

Agents are those of wt-gym evaluate: words, controllers, classes of your own (file.py:Class), folders or files of
trained models, with NAME= in front if you like. What fails, a turbine that runs away or a blade that strikes the tower,
is a result. Every run is kept in the folder of the results, under the hash of all it depends on: the same command goes
on where it was stopped, and another one takes what is there. docs/loadcases.md says what is run, and what the numbers
mean.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import TYPE_CHECKING

from wt_gym.commands.engine_options import add_engine_options, add_model_options, executor_of
from wt_gym.commands.evaluation_options import add_climate_options, add_other_environment_option
from wt_gym.commands.program import (
    FIDELITIES_HELP,
    UNSAFE,
    OneLineParser,
    folder_path,
    json_value,
    stoppable,
    user_errors,
)
from wt_gym.commands.site_options import add_simulator_option, add_site_option, with_options
from wt_gym.tasks import DEFAULT_ENV

if TYPE_CHECKING:
    from wt_gym.experiment.loadcase_runs import LoadCaseConfig


PARKED_CASE = "6.1"


def parse_arguments(words: list[str] | None = None) -> argparse.Namespace:
    """Read the command line."""
    parser = OneLineParser("loadcases", description=__doc__, epilog=UNSAFE)
    parser.add_argument("agents", nargs="*", default=["baseline"], help="agents; the first is the reference")
    parser.add_argument("--case", nargs="+", metavar="DLC", help="numbers of the cases (default: all there are)")
    parser.add_argument("--quick", action="store_true", help="fewer wind speeds, seeds and azimuths, shorter runs")
    parser.add_argument(
        "--turbulence", choices=("kaimal", "mann"), default="kaimal", help="spectra of the winds (default: %(default)s)"
    )
    parser.add_argument("--env", default=DEFAULT_ENV, help="environment id (default: %(default)s)")
    parser.add_argument(
        "--out", type=folder_path, default="runs/loadcases", help="folder for the results (default: %(default)s)"
    )
    parser.add_argument("--fidelity", help=FIDELITIES_HELP)
    kwargs_help = "more arguments of the environment, e.g. '{\"overspeed_limit\": 1.5}'; winds are the cases'"
    parser.add_argument("--env-kwargs", type=json_value, default={}, metavar="JSON", help=kwargs_help)
    add_site_option(parser)
    add_simulator_option(parser)
    add_other_environment_option(parser)
    add_model_options(parser)
    add_engine_options(parser, "runs")
    add_climate_options(parser)
    report = parser.add_argument_group("report")
    report.add_argument("--title", help="title of the report")
    report.add_argument("--no-report", action="store_true", help="write runs and table only")
    report.add_argument("--json", action="store_true", help="print the table as JSON at the end")
    return parser.parse_args(words)


def configuration(arguments: argparse.Namespace) -> LoadCaseConfig:
    """Configuration of the options."""
    from wt_gym.commands.environment_options import chosen_arguments
    from wt_gym.experiment.loadcase_runs import LoadCaseConfig
    from wt_gym.experiment.loadcases import CASES

    given = with_options(arguments.env_kwargs, arguments.site, simulator=arguments.simulator)
    kwargs = chosen_arguments(arguments.env, given, arguments.fidelity)
    cases = tuple(arguments.case or CASES)
    if "simulator" in kwargs:  # nobody controls a parked turbine, which needs no environment and has this simulator
        if PARKED_CASE in (arguments.case or ()):
            raise ValueError(f"case {PARKED_CASE}, the parked turbine, must be left out with another simulator")
        cases = tuple(case for case in cases if case != PARKED_CASE)
    return LoadCaseConfig(
        env_id=arguments.env,
        env_kwargs=kwargs,
        cases=cases,
        quick=arguments.quick,
        turbulence=arguments.turbulence,
        iec_class=arguments.iec_class,
        mean_wind_speed=arguments.mean_wind_speed,
        weibull_shape=arguments.weibull_shape,
    )


def main(words: list[str] | None = None) -> None:
    """Run load cases."""
    arguments = parse_arguments(words)

    out = Path(arguments.out)
    hint = f"the same command resumes with what is in {out}"
    with user_errors(), stoppable(hint), executor_of(arguments) as executor:
        from wt_gym.experiment.loadcase_report import load_case_tables, write_load_case_report
        from wt_gym.experiment.loadcase_runs import REPORT_FILE, run_load_cases
        from wt_gym.experiment.names import named_choices, own_controller, with_model_options

        chosen = configuration(arguments)
        agents = with_model_options(arguments.agents, arguments.algo, arguments.trust)
        results = run_load_cases(
            named_choices(agents, own_controller(chosen.env_id, chosen.env_kwargs)), chosen, out,
            allow_other_environment=arguments.allow_other_environment, executor=executor,
        )  # fmt: skip
        if not arguments.no_report:
            write_load_case_report(results, out / REPORT_FILE, arguments.title)
    print("\n".join(load_case_tables(results)))
    print(f"runs and table: {out}")
    if not arguments.no_report:
        print(f"report: {out / REPORT_FILE}")
    if arguments.json:
        print(json.dumps(results.to_json()))
