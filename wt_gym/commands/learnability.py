"""Measure whether a task can be learned: what its actions exclude, what its rewards tell, how noisy that is.

    wt-gym learnability
    wt-gym learnability wt_gym/IEA15MW-LoadReduction-v4
    wt-gym learnability wt_gym/LoadReduction-v3 --env-kwargs '{"reward_credit": false}'

The first use records a linear model of the turbine. docs/howto/learnability.md explains the numbers.
"""

import argparse
import json
from dataclasses import asdict
from typing import Any

from wt_gym.base.options import add_options as add_record
from wt_gym.base.options import chosen_options
from wt_gym.commands.options import add_shared
from wt_gym.tasks import DEFAULT_ENV


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    from wt_gym.learning.learnability import LearnabilityOptions

    parser.add_argument("task", nargs="?", default=DEFAULT_ENV, help="environment id (default: %(default)s)")
    parser.add_argument("--env-kwargs", type=json.loads, default={}, metavar="JSON", help="arguments on top of the id")
    add_record(parser, LearnabilityOptions, "speeds", "seeds", "duration", "noise", "discount", "trace")
    add_shared(parser, "json")


def run(arguments: argparse.Namespace) -> dict[str, Any]:
    """Measure and print."""
    from wt_gym.control.sensors import FIXED_FRAME
    from wt_gym.learning.learnability import DECISIONS, LearnabilityOptions, measure

    options = LearnabilityOptions(**chosen_options(arguments, LearnabilityOptions))
    found = measure(arguments.task, arguments.env_kwargs, options)
    print(f"bound of the actions: {100.0 * found.bound:.0f} % of linear_optimal's improvement of the lifetime cost")
    for horizon, values in found.alignment.items():
        print(f"alignment, horizon {horizon:g} s: " + ", ".join(
            f"{name} {value:.2f}" for name, value in zip(FIXED_FRAME, values, strict=True)
        ))  # fmt: skip
    print(f"signal to noise of a gradient from {DECISIONS} decisions: {found.signal:.2f}")
    return {"task": arguments.task, **asdict(found)}
