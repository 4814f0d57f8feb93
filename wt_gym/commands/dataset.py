"""Record a Minari data set of an agent at work, for offline learning (extra "data": minari).

    wt-gym dataset baseline wt_gym/nrel5mw/baseline-v0
    wt-gym dataset ipc wt_gym/nrel5mw/ipc-v0 --episodes 50 --noise 0.1
    wt-gym dataset runs/ppo wt_gym/load-reduction/ppo-v0

An agent is baseline, random, a controller with parameters behind a colon, or the path of a trained model. Controllers
act on the rates of every blade and of the torque, a trained model as it was trained. Winds are those of training.
"""

import argparse
import json

from wt_gym.commands.program import UNSAFE, OneLineParser, folder_path, json_value, stoppable, user_errors
from wt_gym.commands.site_options import add_site_option, add_wind_option, with_options


def parse_arguments(words: list[str] | None = None) -> argparse.Namespace:
    """Read the command line."""
    parser = OneLineParser("dataset", description=__doc__, epilog=UNSAFE)
    parser.add_argument("agent")
    parser.add_argument("id", help="id of the data set, namespace/name-vN")
    parser.add_argument("--env", help="environment id (default: wt_gym/NREL5MW-Turbulent-v1, or that of the training)")
    parser.add_argument(
        "--env-kwargs", type=json_value, default={}, metavar="JSON", help="arguments of the environment"
    )
    add_site_option(parser)
    add_wind_option(parser)
    parser.add_argument("--allow-other-environment", action="store_true", help="take a trained model into other noise, "
        "action spans or a base controller than those of its training")  # fmt: skip
    parser.add_argument("--episodes", type=int, default=20, help="number of episodes (default: %(default)s)")
    parser.add_argument("--noise", type=float, default=0.0, help="standard deviation on actions (default: %(default)s)")
    parser.add_argument("--seed", type=int, default=0, help="of the first episode (default: %(default)s)")
    parser.add_argument(
        "--out", type=folder_path, default="runs/datasets", help="root of Minari's data sets (default: %(default)s)"
    )
    parser.add_argument("--json", action="store_true", help="print what was recorded as JSON at the end")
    return parser.parse_args(words)


def main(words: list[str] | None = None) -> None:
    """Record."""
    arguments = parse_arguments(words)

    def show(number: int, earned: float) -> None:
        print(f"episode {number} of {arguments.episodes}: return {earned:.1f}", flush=True)

    with user_errors(), stoppable(f"the episodes that were done are in {arguments.out}"):
        import minari  # noqa: F401 - refused before anything is made

        from wt_gym.commands.environment_options import environment_arguments
        from wt_gym.learning.datasets import DatasetConfig, record_dataset

        kwargs = with_options(arguments.env_kwargs, arguments.site, arguments.wind)
        if arguments.env is not None:
            environment_arguments(arguments.env, kwargs)
        config = DatasetConfig(
            arguments.agent, arguments.id, arguments.env, kwargs, arguments.episodes, arguments.noise,
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
