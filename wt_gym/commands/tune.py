"""Tune the parameters of a controller on training winds.

    wt-gym tune constrained_ipc --trials 40 --out tuned.json
    wt-gym tune mine/controller.py:Mine --space gain=0.1:2:log --trials 20
    wt-gym tune retuned --wind-speed 8 --wind-seeds 1 2 3 --weights mean_power=-1 --trials 15

Needs the extra "tune".
"""

import argparse
from typing import Any

from wt_gym.commands.options import add_shared, turbine_of
from wt_gym.commands.program import file_ending_in

STOPPED = "the trials so far are in the file of --out, if it was given"


def weight(text: str) -> tuple[str, float]:
    """Metric and weight from ``metric=weight``."""
    name, _, value = text.partition("=")
    return name, float(value)


def interval(text: str) -> tuple[str, tuple[float, float, bool]]:
    """Parameter and interval from ``parameter=low:high`` or ``parameter=low:high:log``."""
    name, _, limits = text.partition("=")
    low, high, *log = limits.split(":")
    if log not in ([], ["log"]) or not name or not float(low) < float(high):
        raise ValueError(f"an interval must be parameter=low:high or parameter=low:high:log, got {text!r}")
    return name, (float(low), float(high), bool(log))


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    parser.add_argument("controller", help="of wt-gym list controllers, or file.py:Class")
    parser.add_argument("--reference", default="discon", help="that the cost compares with (default: %(default)s)")
    add_shared(
        parser, "turbine", "site", wind_speed=[12.0, 15.0, 18.0],
        wind_seeds={"default": [1, 2], "help": "turbulence seeds of training, 1 to 24"},
        duration={"default": 150.0, "help": "measured time [s] (default: %(default)s)"},
        skip={"help": "time before it [s] (default: %(default)s)"}, fidelity={},
    )  # fmt: skip
    parser.add_argument("--weights", nargs="+", type=weight, help="of the cost, as mean_power=-5 blade_flap_del=1")
    parser.add_argument(
        "--space", nargs="+", type=interval, metavar="NAME=LOW:HIGH[:log]", help="what is searched (default: "
        "the known parameters of the controller, of a class of your own its SPACE)",
    )  # fmt: skip
    parser.add_argument("--trials", type=int, default=30)
    parser.add_argument("--seed", type=int, default=0, help="of the search")
    parser.add_argument("--out", type=file_ending_in(".json"), metavar="FILE", help="JSON file for the record")
    add_shared(parser, "json")


def run(arguments: argparse.Namespace) -> dict[str, Any]:
    """Tune."""
    from wt_gym.experiment.tuning import Cost, SearchRange, TuningTask, parameters_text, tune

    turbine = turbine_of(arguments)
    cost = Cost(dict(arguments.weights)) if arguments.weights else Cost()
    task = TuningTask(
        arguments.controller, arguments.reference, tuple(arguments.wind_speed), tuple(arguments.wind_seeds),
        arguments.duration, arguments.skip, arguments.fidelity, cost,
        {name: SearchRange(*limits) for name, limits in arguments.space} if arguments.space else None,
    )  # fmt: skip
    record = tune(turbine, task, arguments.trials, arguments.seed, arguments.out, progress=True)
    print(f"best: cost {record['best']['cost']:+.4f} with {parameters_text(record['best']['parameters'])}")
    return record
