"""Run the same agents in the same winds in two simulators, and lay their effects side by side.

    wt-gym crosscheck baseline ipc agents/trained/load_reduction_on_linear_optimal --wind-speed 15 18
    wt-gym crosscheck discon ipc tuned --simulator '{"name": "openfast", "changes": {"AeroDyn": {"UA_Mod": 3}}}'

Agents are those of wt-gym evaluate; the first is the baseline, in each simulator for itself. OpenFAST takes about ten
seconds of processor time for a minute of wind and is by far the slower one: --jobs shares the runs among processes.
Every run is kept as soon as it is done, and the same command resumes where it was stopped.

The folder gets report.html, crosscheck.md with figures, crosscheck.json with its numbers, and both evaluations. Runs
start from the steady operating point.
"""

from __future__ import annotations

import shlex
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from wt_gym.commands.engine_options import add_engine_options, add_model_options, executor_of
from wt_gym.commands.evaluation_options import add_other_environment_option
from wt_gym.commands.program import (
    FIDELITIES_HELP,
    UNSAFE,
    OneLineParser,
    folder_path,
    json_value,
    stoppable,
    user_errors,
)
from wt_gym.commands.site_options import OWN_SIMULATOR, add_simulator_option, add_site_option, with_options
from wt_gym.tasks import DEFAULT_ENV

if TYPE_CHECKING:
    import argparse

    from wt_gym.experiment.evaluation import EvaluationConfig


def parse_arguments(words: list[str] | None = None) -> argparse.Namespace:
    """Read the command line."""
    parser = OneLineParser("crosscheck", description=__doc__, epilog=UNSAFE)
    parser.add_argument("agents", nargs="+", help="agents; the first is the baseline")
    parser.add_argument("--env", default=DEFAULT_ENV, help="environment id (default: %(default)s)")
    parser.add_argument(
        "--out", type=folder_path, default="runs/crosscheck", help="folder for the results (default: %(default)s)"
    )
    parser.add_argument("--overwrite", action="store_true", help="remove the crosscheck that is in the folder")
    parser.add_argument(
        "--wind-speed", type=float, nargs="+", default=[15.0], metavar="M_S", help="mean speeds [m/s] (default: 15)"
    )
    parser.add_argument(
        "--wind-seeds", type=int, nargs="+", metavar="SEED", help="turbulence seeds (default: six held-out ones)"
    )
    parser.add_argument("--duration", type=float, default=600.0, help="length of a run [s] (default: %(default)s)")
    parser.add_argument(
        "--skip", type=float, default=60.0, help="start left out of the metrics [s] (default: %(default)s)"
    )
    parser.add_argument("--fidelity", help=FIDELITIES_HELP)
    kwargs_help = 'more arguments of the environment, e.g. \'{"turbine": "iea_15mw"}\''
    parser.add_argument("--env-kwargs", type=json_value, default={}, metavar="JSON", help=kwargs_help)
    add_site_option(parser)
    add_simulator_option(parser, "openfast")
    add_other_environment_option(parser)
    add_model_options(parser)
    add_engine_options(parser, "runs")
    return parser.parse_args(words)


def configuration(arguments: argparse.Namespace, simulator: str | dict[str, Any]) -> EvaluationConfig:
    """Evaluation of the options with one of the simulators."""
    from wt_gym.commands.environment_options import chosen_arguments
    from wt_gym.experiment.evaluation import EvaluationConfig
    from wt_gym.experiment.evaluation_winds import winds_for

    given = {"start": "steady"} | with_options(arguments.env_kwargs, arguments.site, simulator=simulator)
    kwargs = chosen_arguments(arguments.env, given, arguments.fidelity)
    winds = winds_for(arguments.env, kwargs, arguments.wind_speed, arguments.wind_seeds, None, arguments.duration)
    return EvaluationConfig(
        env_id=arguments.env, env_kwargs=kwargs, winds=winds, duration=arguments.duration, skip=arguments.skip,
        replay=0.0,
    )  # fmt: skip


def main(words: list[str] | None = None) -> None:
    """Run both and write the page."""
    arguments = parse_arguments(words)
    out, other = Path(arguments.out), arguments.simulator
    name = other["name"] if isinstance(other, dict) and "name" in other else str(other)
    hint = f"the same command without --overwrite resumes with what is in {out}"
    with user_errors(), stoppable(hint):
        if other == OWN_SIMULATOR:
            raise ValueError(f"--simulator must be another one than {OWN_SIMULATOR}, which the crosscheck runs anyway")
        from wt_gym.analysis.crosscheck import Crosscheck, tables, write_crosscheck
        from wt_gym.experiment.evaluation import evaluate
        from wt_gym.experiment.names import named_choices, own_controller, with_model_options

        configs = [configuration(arguments, simulator) for simulator in (OWN_SIMULATOR, other)]
        given = with_model_options(arguments.agents, arguments.algo, arguments.trust)
        agents = named_choices(given, own_controller(configs[0].env_id, configs[0].env_kwargs))
        found = []
        for config, folder in zip(configs, (OWN_SIMULATOR, name), strict=True):
            with executor_of(arguments) as executor:
                found.append(
                    evaluate(
                        agents, config, folder=out / folder, overwrite=arguments.overwrite,
                        allow_other_environment=arguments.allow_other_environment, executor=executor,
                    )
                )  # fmt: skip
        check = Crosscheck((OWN_SIMULATOR, name), (found[0], found[1]))
        command = shlex.join(["wt-gym", "crosscheck", *(sys.argv[2:] if words is None else words)])
        path, report = write_crosscheck(check, out, command)
    print(tables(check.content))
    print(f"\npage: {path}\nreport: {report}")
