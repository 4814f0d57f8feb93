#!/usr/bin/env python3
"""Record a Minari data set of an agent at work, for offline learning (extra "data": minari).

    scripts/dataset.py baseline wt_gym/nrel5mw/baseline-v0
    scripts/dataset.py ipc wt_gym/nrel5mw/ipc-v0 --episodes 50 --noise 0.1
    scripts/dataset.py runs/ppo wt_gym/load-reduction/ppo-v0

An agent is baseline, random, a controller with parameters behind a colon, or the path of a trained model. Controllers
act on the rates of every blade and of the torque, a trained model as it was trained. Winds are those of training.
"""

import argparse
import json

import use_venv  # noqa: F401 - finds packages and interpreter

from wt_gym.agents.training.arguments import UNSAFE, OneLineParser


def parse_arguments() -> argparse.Namespace:
    """Read the command line."""
    parser = OneLineParser(description=__doc__, epilog=UNSAFE)
    parser.add_argument("agent")
    parser.add_argument("id", help="id of the data set, namespace/name-vN")
    parser.add_argument("--env", help="environment id (default: wt_gym/NREL5MW-Turbulent-v0, or that of the training)")
    parser.add_argument(
        "--env-kwargs", type=json.loads, default={}, metavar="JSON", help="arguments of the environment"
    )
    parser.add_argument("--allow-other-environment", action="store_true", help="take a trained model into other noise, "
        "action spans or a controller beneath than those of its training")  # fmt: skip
    parser.add_argument("--episodes", type=int, default=20, help="number of episodes (default: %(default)s)")
    parser.add_argument("--noise", type=float, default=0.0, help="standard deviation on actions (default: %(default)s)")
    parser.add_argument("--seed", type=int, default=0, help="of the first episode (default: %(default)s)")
    parser.add_argument("--out", default="runs/datasets", help="root of Minari's data sets (default: %(default)s)")
    parser.add_argument("--json", action="store_true", help="print what was recorded as JSON at the end")
    return parser.parse_args()


def main() -> None:
    """Record."""
    arguments = parse_arguments()
    from wt_gym.agents.command_line import environment_arguments, user_errors
    from wt_gym.agents.datasets import DatasetConfig, record_dataset

    def show(number: int, earned: float) -> None:
        print(f"episode {number} of {arguments.episodes}: return {earned:.1f}", flush=True)

    with user_errors():
        try:
            import minari  # noqa: F401
        except ImportError as error:
            raise ValueError("minari is not installed; it comes with the extra 'data'") from error
        if arguments.env is not None:
            environment_arguments(arguments.env, arguments.env_kwargs)
        config = DatasetConfig(
            arguments.agent, arguments.id, arguments.env, arguments.env_kwargs, arguments.episodes, arguments.noise,
            arguments.seed, allow_other_environment=arguments.allow_other_environment,
        )  # fmt: skip
        dataset = record_dataset(config, arguments.out, show)
    found = {
        "id": dataset.id,
        "folder": arguments.out,
        "episodes": int(dataset.total_episodes),
        "steps": int(dataset.total_steps),
    }
    print(f"{found['episodes']} episodes, {found['steps']} steps: {arguments.out}/{dataset.id}")
    if arguments.json:
        print(json.dumps(found))


if __name__ == "__main__":
    main()
