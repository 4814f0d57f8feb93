#!/usr/bin/env python3
"""Evaluate agents in winds held back from training, and write a report.

Agents are "baseline", "constant", or the folder or zip file of a trained model, each with a name in front if you like:

    scripts/evaluate.py baseline runs/ppo
    scripts/evaluate.py baseline first=runs/a second=runs/b --wind-speed 8 12 16 --duration 600
"""

import argparse
import json
from pathlib import Path

import use_venv  # noqa: F401 - finds packages and interpreter

from agents.training.arguments import UNSAFE, OneLineParser


def parse_arguments() -> argparse.Namespace:
    """Read the command line."""
    parser = OneLineParser(description=__doc__, epilog=UNSAFE)
    parser.add_argument("agents", nargs="*", default=["baseline"], help="agents; the first is the yardstick")
    parser.add_argument("--env", default="wt_gym/LoadReduction-v0", help="environment id (default: %(default)s)")
    parser.add_argument("--out", default="runs/evaluation", help="folder for the results (default: %(default)s)")
    parser.add_argument("--wind-speed", type=float, nargs="+", default=[15.0], metavar="M_S", help="mean speeds [m/s]")
    parser.add_argument(
        "--wind-seeds", type=int, nargs="+", metavar="SEED", help="turbulence seeds (default: two held back)"
    )
    parser.add_argument("--duration", type=float, default=600.0, help="length of a run [s] (default: %(default)s)")
    parser.add_argument(
        "--skip", type=float, default=30.0, help="start left out of the metrics [s] (default: %(default)s)"
    )
    parser.add_argument("--fidelity", help="training, engineering or reference")
    kwargs_help = 'more arguments of the environment, e.g. \'{"pitch": "individual"}\''
    parser.add_argument("--env-kwargs", type=json.loads, default={}, metavar="JSON", help=kwargs_help)
    parser.add_argument("--title", help="title of the report")
    parser.add_argument("--no-report", action="store_true", help="write signals and metrics only")
    parser.add_argument("--json", action="store_true", help="print the metrics as JSON at the end")
    return parser.parse_args()


def main() -> None:
    """Evaluate."""
    arguments = parse_arguments()
    from agents.command_line import environment_arguments, user_errors
    from agents.evaluation import EvaluationConfig, default_names, evaluate
    from wt_gym.analysis.report import write_report
    from wt_gym.analysis.results import Wind
    from wt_gym.analysis.summary import summarise
    from wt_gym.envs.wind_sampler import EVALUATION_WIND_SEEDS

    with user_errors():
        turbulent = environment_arguments(arguments.env, arguments.env_kwargs)["inflow"] == "turbulent"
        seeds = [None] if not turbulent else arguments.wind_seeds or EVALUATION_WIND_SEEDS[:2]
        kwargs = dict(arguments.env_kwargs)
        if arguments.fidelity:
            kwargs["fidelity"] = arguments.fidelity
        config = EvaluationConfig(
            env_id=arguments.env,
            env_kwargs=kwargs,
            winds=tuple(Wind(speed, seed) for speed in arguments.wind_speed for seed in seeds),
            duration=arguments.duration,
            skip=arguments.skip,
        )
        evaluation = evaluate(default_names(arguments.agents), config)
    out = Path(arguments.out)
    table = evaluation.save(out)
    print("\n".join(summarise(evaluation)))
    print(f"metrics and signals: {table.parent}")
    if not arguments.no_report:
        print(f"report: {write_report(evaluation, out / 'report.html', arguments.title)}")
    if arguments.json:
        print(json.dumps(evaluation.to_json(), default=str))


if __name__ == "__main__":
    main()
