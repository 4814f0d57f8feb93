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
from wt_gym.commands.site_options import add_simulator_option, add_site_option, add_wind_option, with_options
from wt_gym.tasks import DEFAULT_ENV

if TYPE_CHECKING:
    from wt_gym.experiment.evaluation import EvaluationConfig


def parse_arguments(words: list[str] | None = None) -> argparse.Namespace:
    """Read the command line."""
    parser = OneLineParser("evaluate", description=__doc__, epilog=UNSAFE)
    parser.add_argument("agents", nargs="*", default=["baseline"], help="agents; the first is the reference")
    parser.add_argument("--env", default=DEFAULT_ENV, help="environment id (default: %(default)s)")
    parser.add_argument(
        "--out", type=folder_path, default="runs/evaluation", help="folder for the results (default: %(default)s)"
    )
    parser.add_argument("--overwrite", action="store_true", help="remove the evaluation that is in the folder")
    parser.add_argument(
        "--wind-speed", type=float, nargs="+", metavar="M_S",
        help="mean speeds [m/s] (default: 15, or the middle of what the environment draws where that is not in it)",
    )  # fmt: skip
    parser.add_argument(
        "--wind-seeds", type=int, nargs="+", metavar="SEED", help="turbulence seeds (default: six held-out ones)"
    )
    parser.add_argument(
        "--draws", type=int, metavar="N",
        help="winds at each speed where something else than turbulence is drawn, as gusts or files (default: six)",
    )  # fmt: skip
    parser.add_argument("--duration", type=float, default=600.0, help="length of a run [s] (default: %(default)s)")
    parser.add_argument(
        "--skip", type=float, default=30.0, help="start left out of the metrics [s] (default: %(default)s)"
    )
    parser.add_argument("--fidelity", help=FIDELITIES_HELP)
    kwargs_help = 'more arguments of the environment, e.g. \'{"pitch": "individual"}\''
    parser.add_argument("--env-kwargs", type=json_value, default={}, metavar="JSON", help=kwargs_help)
    add_site_option(parser)
    add_wind_option(parser)
    add_simulator_option(parser)
    add_other_environment_option(parser)
    add_model_options(parser)
    add_engine_options(parser, "runs")
    add_climate_options(parser)
    report = parser.add_argument_group("report")
    report.add_argument("--title", help="title of the report")
    report.add_argument(
        "--replay", type=float, default=20.0, metavar="S",
        help="length of the replay, the end of the runs in the first wind [s]; 0: none (default: %(default)s)",
    )  # fmt: skip
    report.add_argument(
        "--crosscheck", metavar="FILE",
        help="crosscheck.json: agents that have the same name in it get its figures of the other simulator beside "
        "those of the evaluation, where that has one mean wind speed",
    )  # fmt: skip
    report.add_argument("--no-report", action="store_true", help="write signals and metrics only")
    report.add_argument("--json", action="store_true", help="print the metrics as JSON at the end")
    return parser.parse_args(words)


def configuration(arguments: argparse.Namespace) -> EvaluationConfig:
    """Configuration of the options."""
    from wt_gym.commands.environment_options import chosen_arguments
    from wt_gym.experiment.evaluation import EvaluationConfig, winds_for

    given = with_options(arguments.env_kwargs, arguments.site, arguments.wind, arguments.simulator)
    kwargs = chosen_arguments(arguments.env, given, arguments.fidelity)
    return EvaluationConfig(
        env_id=arguments.env,
        env_kwargs=kwargs,
        winds=winds_for(
            arguments.env, kwargs, arguments.wind_speed, arguments.wind_seeds, arguments.draws, arguments.duration
        ),
        duration=arguments.duration,
        skip=arguments.skip,
        replay=0.0 if "simulator" in kwargs else arguments.replay,  # others give no shapes
        iec_class=arguments.iec_class,
        mean_wind_speed=arguments.mean_wind_speed,
        weibull_shape=arguments.weibull_shape,
    )


def main(words: list[str] | None = None) -> None:
    """Evaluate."""
    arguments = parse_arguments(words)

    out = Path(arguments.out)
    without = " without --overwrite" if arguments.overwrite else ""
    hint = f"the same command{without} resumes with what is in {out}"
    with user_errors(), stoppable(hint), executor_of(arguments) as executor:
        from wt_gym.analysis.report import write_report
        from wt_gym.analysis.results import run_files
        from wt_gym.analysis.summary import results_table, summarize
        from wt_gym.experiment.evaluation import REPORT_FILE, evaluate
        from wt_gym.experiment.names import named_choices, own_controller, with_model_options

        chosen = configuration(arguments)
        crosscheck = None
        if arguments.crosscheck is not None:
            crosscheck = json.loads(Path(arguments.crosscheck).read_text(encoding="utf-8"))
        agents = with_model_options(arguments.agents, arguments.algo, arguments.trust)
        evaluation = evaluate(
            named_choices(agents, own_controller(chosen.env_id, chosen.env_kwargs)), chosen, folder=out,
            overwrite=arguments.overwrite, allow_other_environment=arguments.allow_other_environment, executor=executor,
        )  # fmt: skip
        if not arguments.no_report:
            write_report(evaluation, out / REPORT_FILE, arguments.title, run_files(out), crosscheck)
    print("\n".join([*results_table(evaluation), "", *summarize(evaluation)]))
    print(f"metrics and signals: {out}")
    if not arguments.no_report:
        print(f"report: {out / REPORT_FILE}")
    if arguments.json:
        print(json.dumps(evaluation.to_json(), default=str))
