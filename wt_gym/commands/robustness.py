"""Run agents on turbines, with sensors and in winds that they were not made for, and show what is left of their gain.

    wt-gym robustness ipc agents/trained/load_reduction_on_linear_optimal
    wt-gym robustness runs/ppo --wind-speed 15 18 --conditions delay servo --jobs 2
    wt-gym robustness --list

Agents are those of wt-gym evaluate. In every condition each is compared with the baseline controller (--reference) and
with the controller that it acts on top of, in the same winds; the gain is that of the load-reduction tasks of the
benchmark, and "kept" is the share of the nominal gain over the base controller of an agent. Every run is kept in the
folder of the results as soon as it is done: the same command resumes. docs/howto/variation.md describes the conditions.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING

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
from wt_gym.tasks import DEFAULT_ENV

if TYPE_CHECKING:
    import argparse


def parse_arguments(words: list[str] | None = None) -> argparse.Namespace:
    """Read the command line."""
    parser = OneLineParser("robustness", description=__doc__, epilog=UNSAFE)
    parser.add_argument("agents", nargs="*", help="agents, see wt-gym evaluate")
    parser.add_argument("--list", action="store_true", help="list the conditions")
    parser.add_argument("--reference", default="discon", help="what all are compared with (default: %(default)s)")
    which = "conditions beside the nominal; faults: all with a fault (default: all without)"
    parser.add_argument("--conditions", nargs="+", metavar="NAME", help=which)
    parser.add_argument("--env", default=DEFAULT_ENV, help="environment id (default: %(default)s)")
    kwargs_help = 'more arguments of the environment, e.g. \'{"turbulence_class": "B"}\''
    parser.add_argument("--env-kwargs", type=json_value, default={}, metavar="JSON", help=kwargs_help)
    parser.add_argument("--fidelity", help=FIDELITIES_HELP)
    parser.add_argument("--wind-speed", type=float, nargs="+", default=[15.0], metavar="M_S", help="mean speeds [m/s]")
    parser.add_argument(
        "--wind-seeds", type=int, nargs="+", metavar="SEED", help="turbulence seeds (default: six held-out ones)"
    )
    parser.add_argument("--duration", type=float, default=600.0, help="length of a run [s] (default: %(default)s)")
    parser.add_argument(
        "--skip", type=float, default=30.0, help="start left out of the metrics [s] (default: %(default)s)"
    )
    parser.add_argument(
        "--out", type=folder_path, default="runs/robustness", help="folder for the results (default: %(default)s)"
    )
    parser.add_argument("--overwrite", action="store_true", help="remove the evaluations that are in the folder")
    add_other_environment_option(parser)
    add_model_options(parser)
    add_engine_options(parser, "runs")
    parser.add_argument("--json", action="store_true", help="print the results as JSON at the end")
    return parser.parse_args(words)


def main(words: list[str] | None = None) -> None:
    """Run."""
    arguments = parse_arguments(words)
    if arguments.list:
        from wt_gym.experiment.robustness import CONDITIONS, FAULT_CONDITIONS

        known = CONDITIONS | FAULT_CONDITIONS
        width = max(map(len, known))
        print("\n".join(f"{one.name:{width}}  {one.text}" for one in known.values()))
        return

    out = Path(arguments.out)

    hint = f"the same command resumes with what is in {out}"
    with user_errors(), stoppable(hint), executor_of(arguments) as executor:
        from wt_gym.commands.environment_options import chosen_arguments
        from wt_gym.experiment.evaluation import EvaluationConfig, winds_for
        from wt_gym.experiment.names import named_choices, with_model_options
        from wt_gym.experiment.robustness import chosen, run_robustness

        if not arguments.agents:
            raise ValueError("agents must be named, for example ipc; got none")
        conditions = chosen(arguments.conditions)
        kwargs = chosen_arguments(arguments.env, arguments.env_kwargs, arguments.fidelity)
        agents = named_choices(
            with_model_options([arguments.reference, *arguments.agents], arguments.algo, arguments.trust)
        )
        winds = winds_for(arguments.env, kwargs, arguments.wind_speed, arguments.wind_seeds, None, arguments.duration)
        config = EvaluationConfig(
            env_id=arguments.env, env_kwargs=kwargs, winds=winds, duration=arguments.duration, skip=arguments.skip
        )
        found = run_robustness(
            agents, config, conditions, folder=out, overwrite=arguments.overwrite,
            allow_other_environment=arguments.allow_other_environment, executor=executor,
        )  # fmt: skip
    print(found.to_markdown())
    print(f"results: {out}")
    if arguments.json:
        print(json.dumps(found.to_json(), default=str))
