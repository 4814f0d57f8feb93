"""Record a Minari data set of an agent at work, for offline learning (extra "data": minari).

    wt-gym dataset baseline wt_gym/nrel5mw/baseline-v0
    wt-gym dataset ipc wt_gym/nrel5mw/ipc-v0 --episodes 50 --noise 0.1
    wt-gym dataset runs/ppo wt_gym/load-reduction/ppo-v0

An agent is baseline, random, a controller with parameters behind a colon, or the path of a trained model. Controllers
act on the rates of every blade and of the torque, a trained model as it was trained. Winds are those of training.
"""

import argparse
from typing import Any

from wt_gym.base.options import add_options as add_record
from wt_gym.base.options import chosen_options
from wt_gym.commands.options import add_shared, environment_of
from wt_gym.commands.program import UNSAFE

EPILOG = UNSAFE
STOPPED = "the episodes that were done are in {out}"


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    from wt_gym.learning.options import DatasetConfig

    parser.add_argument("agent")
    parser.add_argument("id", help="id of the data set, namespace/name-vN")
    default = "wt_gym/NREL5MW-Turbulent-v1, or that of the training"
    add_shared(
        parser, "env", "env_kwargs", "site", "wind", "allow_other_environment", "out",
        env={"default": None, "help": f"environment id (default: {default})"}, out="runs/datasets",
    )  # fmt: skip
    add_record(parser, DatasetConfig, "episodes", "noise", "seed")
    add_shared(parser, "json")


def run(arguments: argparse.Namespace) -> dict[str, Any]:
    """Record."""
    import minari  # noqa: F401 - refused before anything is made

    from wt_gym.learning.datasets import record_dataset
    from wt_gym.learning.options import DatasetConfig

    config = DatasetConfig(
        agent=arguments.agent, dataset_id=arguments.id, env_id=arguments.env, env_kwargs=environment_of(arguments),
        allow_other_environment=arguments.allow_other_environment, **chosen_options(arguments, DatasetConfig),
    )  # fmt: skip

    def show(number: int, earned: float) -> None:
        print(f"episode {number} of {config.episodes}: return {earned:.1f}", flush=True)

    dataset = record_dataset(config, arguments.out, show)
    episodes, steps = int(dataset.total_episodes), int(dataset.total_steps)
    print(f"{episodes} episodes, {steps} steps: {arguments.out}/{dataset.id}")
    return {"id": dataset.id, "folder": arguments.out, "episodes": episodes, "steps": steps}
