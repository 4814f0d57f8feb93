"""Tune the parameters of a controller on training winds.

    wt-gym tune constrained_ipc --trials 40 --out tuned.json
    wt-gym tune mine/controller.py:Mine --space gain=0.1:2:log --trials 20
    wt-gym tune retuned --wind-speed 8 --wind-seeds 1 2 3 --weights mean_power=-1 --trials 15

Needs the extra "tune".
"""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

from wt_gym.commands.program import FIDELITIES_HELP, OneLineParser, file_ending_in, stoppable, user_errors
from wt_gym.commands.site_options import add_site_option

if TYPE_CHECKING:
    import argparse


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


def parse_arguments(words: list[str] | None = None) -> argparse.Namespace:
    """Read the command line."""
    parser = OneLineParser("tune", description=__doc__)
    parser.add_argument("controller", help="of wt-gym list controllers, or file.py:Class")
    parser.add_argument("--turbine", default="nrel_5mw")
    add_site_option(parser)
    parser.add_argument("--reference", default="discon", help="that the cost compares with")
    parser.add_argument(
        "--wind-speed", nargs="+", type=float, default=[12.0, 15.0, 18.0], metavar="M_S", help="mean speeds [m/s]"
    )
    parser.add_argument(
        "--wind-seeds",
        nargs="+",
        type=int,
        default=[1, 2],
        metavar="SEED",
        help="turbulence seeds of training, 1 to 24",
    )
    parser.add_argument("--duration", type=float, default=150.0, help="measured, s")
    parser.add_argument("--skip", type=float, default=30.0, help="before it, s")
    parser.add_argument("--fidelity", help=FIDELITIES_HELP)
    parser.add_argument("--weights", nargs="+", type=weight, help="of the cost, as mean_power=-5 blade_flap_del=1")
    parser.add_argument(
        "--space", nargs="+", type=interval, metavar="NAME=LOW:HIGH[:log]", help="what is searched (default: "
        "the known parameters of the controller, of a class of your own its SPACE)",
    )  # fmt: skip
    parser.add_argument("--trials", type=int, default=30)
    parser.add_argument("--seed", type=int, default=0, help="of the search")
    parser.add_argument("--out", type=file_ending_in(".json"), metavar="FILE", help="JSON file for the record")
    parser.add_argument("--json", action="store_true", help="print one JSON object last")
    return parser.parse_args(words)


def main(words: list[str] | None = None) -> None:
    """Run."""
    arguments = parse_arguments(words)

    kept = f"the trials so far are in {arguments.out}" if arguments.out else "--out would keep the trials"
    with user_errors(), stoppable(kept):
        from wt_gym.experiment.tuning import Cost, SearchRange, TuningTask, parameters_text, tune
        from wt_gym.turbines import load_turbine
        from wt_gym.turbines.model import with_site

        turbine = with_site(load_turbine(arguments.turbine), dict(arguments.site or ()))
        task = TuningTask(
            arguments.controller, arguments.reference, tuple(arguments.wind_speed), tuple(arguments.wind_seeds),
            arguments.duration, arguments.skip, arguments.fidelity,
            Cost(dict(arguments.weights)) if arguments.weights else Cost(),
            {name: SearchRange(*limits) for name, limits in arguments.space} if arguments.space else None,
        )  # fmt: skip
        record = tune(turbine, task, arguments.trials, arguments.seed, arguments.out, progress=True)
    print(f"best: cost {record['best']['cost']:+.4f} with {parameters_text(record['best']['parameters'])}")
    if arguments.json:
        print(json.dumps(record))
