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
    executor_of,
)
from wt_gym.commands.program import UNSAFE

if TYPE_CHECKING:
    from wt_gym.experiment.loadcase_runs import LoadCaseConfig

EPILOG = UNSAFE
STOPPED = "the same command resumes with what is in {out}"
PARKED_CASE = "6.1"


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    parser.add_argument("agents", nargs="*", default=["baseline"], help="agents; the first is the reference")
    parser.add_argument("--case", nargs="+", metavar="DLC", help="numbers of the cases (default: all there are)")
    parser.add_argument("--quick", action="store_true", help="fewer wind speeds, seeds and azimuths, shorter runs")
    parser.add_argument(
        "--turbulence", choices=("kaimal", "mann"), default="kaimal", help="spectra of the winds (default: %(default)s)"
    )
    kwargs_help = "more arguments of the environment, e.g. '{\"overspeed_limit\": 1.5}'; winds are the cases'"
    add_shared(
        parser, "env", "out", "fidelity", "env_kwargs", "site", "simulator", "allow_other_environment", *MODELS,
        *WORKERS, out="runs/loadcases", env_kwargs={"help": kwargs_help},
    )  # fmt: skip
    add_climate(parser)
    add_shared(parser.add_argument_group("report"), "title", "no_report", "json")


def configuration(arguments: argparse.Namespace) -> LoadCaseConfig:
    """Configuration of the options."""
    from wt_gym.experiment.loadcase_runs import LoadCaseConfig
    from wt_gym.experiment.loadcases import CASES

    kwargs = environment_of(arguments)
    cases = tuple(arguments.case or CASES)
    if "simulator" in kwargs:  # nobody controls a parked turbine, which needs no environment and has this simulator
        if PARKED_CASE in (arguments.case or ()):
            raise ValueError(f"case {PARKED_CASE}, the parked turbine, must be left out with another simulator")
        cases = tuple(case for case in cases if case != PARKED_CASE)
    return LoadCaseConfig(
        env_id=arguments.env, env_kwargs=kwargs, cases=cases, quick=arguments.quick, turbulence=arguments.turbulence,
        climate=climate_of(arguments),
    )  # fmt: skip


def run(arguments: argparse.Namespace) -> dict[str, Any]:
    """Run load cases, write the report and print the tables."""
    from wt_gym.experiment.loadcase_report import load_case_tables, write_load_case_report
    from wt_gym.experiment.loadcase_runs import REPORT_FILE, run_load_cases

    out = Path(arguments.out)
    with executor_of(arguments) as executor:
        config = configuration(arguments)
        results = run_load_cases(
            agents_of(arguments, arguments.agents, config.env_id, config.env_kwargs), config, out,
            allow_other_environment=arguments.allow_other_environment, executor=executor,
        )  # fmt: skip
    if not arguments.no_report:
        write_load_case_report(results, out / REPORT_FILE, arguments.title)
    print("\n".join(load_case_tables(results)))
    print(f"runs and table: {out}")
    if not arguments.no_report:
        print(f"report: {out / REPORT_FILE}")
    return results.to_json()
