"""Search hyperparameters for a training; needs the extra "tune".

    wt-gym search --trials 50 --steps 60000 --wind-speed 15 --out runs/search
    wt-gym train --hyperparameters runs/search/best.yml --wind-speed 15

Every trial is a training, judged against the baseline controller in held-out winds. The study lives in the
folder: the same command resumes where an earlier one was stopped.

Exit status: as of wt-gym train.
"""

import argparse
import signal
import sys
from functools import partial
from typing import Any

from wt_gym.commands.options import add_shared
from wt_gym.commands.program import UNSAFE
from wt_gym.commands.train import add_training_options, configuration

EPILOG = UNSAFE
STOPPED = "the same command resumes"


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    parser.add_argument("--trials", type=int, default=30, help="altogether (default: %(default)s)")
    parser.add_argument("--steps", type=int, default=60_000, help="of each trial (default: %(default)s)")
    parser.add_argument("--seed", type=int, default=0, help="of search and trainings (default: %(default)s)")
    add_training_options(parser)
    add_shared(parser, "out", "json", out="runs/search")


def run(arguments: argparse.Namespace) -> dict[str, Any]:
    """Search."""
    from wt_gym.learning.search import BEST_FILE, search

    config = configuration(arguments, total_steps=arguments.steps, seed=arguments.seed, tensorboard=False)
    result = search(config, arguments.out, arguments.trials, partial(print, file=sys.stderr, flush=True))
    if result["best"] is not None:
        print(f"best of {result['trials']} trials: return against the baseline's {result['value']:+.2f}; "
              f"wt-gym train --hyperparameters {arguments.out}/{BEST_FILE}")  # fmt: skip
    if result["status"] == "interrupted":
        print(f"ended by {result['stopped_by']}; the same command resumes", file=sys.stderr)
        arguments.status = 128 + signal.Signals[result["stopped_by"]]
    return result
