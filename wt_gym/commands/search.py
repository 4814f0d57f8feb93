"""Search hyperparameters for a training; needs the extra "tune", or with --engine ray the extra "ray".

    wt-gym search --trials 50 --steps 60000 --wind-speed 15 --out runs/search
    wt-gym search --engine ray --address ray-head:6379 --trials 200 --steps 60000 --out runs/wide
    wt-gym train --hyperparameters runs/search/best.yml --wind-speed 15

Every trial is a training, judged against the baseline controller in held-out winds. The study lives in the
folder: the same command resumes where an earlier one was stopped.

Exit status: as of wt-gym train.
"""

import argparse
import json
import signal
import sys
from functools import partial

from wt_gym.commands.engine_options import add_address_options
from wt_gym.commands.program import UNSAFE, OneLineParser, folder_path, user_errors
from wt_gym.commands.training_options import add_training_options, config_from


def parse_arguments(words: list[str] | None = None) -> argparse.Namespace:
    """Read the command line."""
    parser = OneLineParser("search", description=__doc__, epilog=UNSAFE)
    parser.add_argument("--trials", type=int, default=30, help="altogether (default: %(default)s)")
    parser.add_argument("--steps", type=int, default=60_000, help="of each trial (default: %(default)s)")
    parser.add_argument("--seed", type=int, default=0, help="of search and trainings (default: %(default)s)")
    parser.add_argument(
        "--out", type=folder_path, default="runs/search", help="folder for the results (default: %(default)s)"
    )
    parser.add_argument("--json", action="store_true", help="print the result as JSON at the end")
    add_training_options(parser)
    add_address_options(parser)
    return parser.parse_args(words)


def main(words: list[str] | None = None) -> None:
    """Search."""
    arguments = parse_arguments(words)

    def progress(line: str) -> None:
        print(line, file=sys.stderr, flush=True)

    with user_errors():
        from wt_gym.learning.training.search import BEST_FILE, search

        if arguments.engine == "ray":
            from wt_gym.learning.distributed.tune_search import tune_search

            search = partial(tune_search, address=arguments.address)
        elif arguments.address is not None:
            raise ValueError("--address belongs to a Ray cluster: give --engine ray too")
        config = config_from(arguments, total_steps=arguments.steps, seed=arguments.seed, tensorboard=False)
        result = search(config, arguments.out, arguments.trials, progress)
    if result["best"] is not None:
        print(f"best of {result['trials']} trials: return against the baseline's {result['value']:+.2f}; "
              f"wt-gym train --hyperparameters {arguments.out}/{BEST_FILE}")  # fmt: skip
    if arguments.json:
        print(json.dumps(result))
    if result["status"] == "interrupted":
        print(f"ended by {result['stopped_by']}; the same command resumes", file=sys.stderr)
        sys.exit(128 + signal.Signals[result["stopped_by"]])
