"""Design a controller for a turbine from recorded simulation.

    wt-gym design linear_optimal --turbine nrel_5mw --out mine.npz
    wt-gym evaluate linear_optimal:file=mine.npz

Base controller, plant and disturbances are recorded in training winds, with and without drawn offsets of the pitch; the
feedback follows by least squares. Recordings lie beside the file, in a folder of its name with .runs behind it: a
stopped design resumes from them, and other weights need no other recordings.
"""

import argparse
import math
import sys
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from wt_gym.base.options import add_options as add_record
from wt_gym.base.options import chosen_options
from wt_gym.commands.options import WORKERS, add_shared, executor_of, turbine_of
from wt_gym.commands.program import file_ending_in

STOPPED = "runs that are done are in {out}.runs and are not made again"
DESIGNS = ("linear_optimal",)
"""Controllers that are designed."""


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options; angles are in degrees, power in per cent."""
    from wt_gym.learning.options import FeedbackOptions, LinearDesignTask

    parser.add_argument("controller", choices=DESIGNS)
    parser.add_argument(
        "--out", type=file_ending_in(".npz"), required=True, metavar="FILE.npz", help="file of the design"
    )
    add_shared(
        parser, "turbine", "site", "fidelity",
        wind_speed={"help": "winds of the designs [m/s] (default: 1.05, 1.32, 1.58 times rated)"},
    )  # fmt: skip
    add_record(parser, LinearDesignTask, "seeds", "base", "excited", "duration", "waves")
    degrees = partial(parser.add_argument, type=float, metavar="DEG")
    degrees("--excitation", nargs=2, metavar=("MEAN", "TILT_YAW"), help="largest drawn offsets, deg (default: 0.2 0.6)")
    degrees("--limit", help="largest offset, deg (default: what the pitch drives can follow at rated speed, at most 4)")
    degrees("--rate-limit", metavar="DEG/S", help="largest rate of offsets, deg/s (default: likewise, at most 3)")
    degrees("--fade", help="collective pitch above fine pitch from which on offsets act in full, deg (default: 3)")
    parser.add_argument(
        "--fine-speed", nargs=2, type=float, metavar=("LOW", "HIGH"), help="rotor speed over the rated one at which "
        "offsets begin and act in full at fine pitch; 0 0: they do not act there (default: 0.97 1.02)",
    )  # fmt: skip
    add_record(parser, FeedbackOptions, "travel_weight", "power_weight")
    parser.add_argument(
        "--least-power", type=float, metavar="PERCENT", help="change of power that the forecast must keep at every "
        "wind speed, %% (default: -0.3)",
    )  # fmt: skip
    add_shared(parser, *WORKERS, "json")


def run(arguments: argparse.Namespace) -> dict[str, Any]:
    """Make the design."""
    from wt_gym.base.files import require_writable
    from wt_gym.control.controllers.linear_optimal import default_limits, save_design
    from wt_gym.learning.linear_design import default_speeds, design
    from wt_gym.learning.options import Excitation, FeedbackOptions, LinearDesignTask, design_task
    from wt_gym.learning.recording import Recording, RecordingStore

    out: Path = arguments.out
    turbine = turbine_of(arguments)
    limits: dict[str, Any] = dict(zip(("limit", "rate_limit"), default_limits(turbine), strict=True))
    angles = {name: getattr(arguments, name) for name in ("limit", "rate_limit", "fade")}
    task = design_task(
        turbine, speeds=tuple(arguments.wind_speed or default_speeds(turbine)), fidelity=arguments.fidelity,
        feedback=chosen_options(arguments, FeedbackOptions),
        **(limits | {name: math.radians(value) for name, value in angles.items() if value is not None}),
        **chosen_options(arguments, LinearDesignTask),
    )  # fmt: skip
    if arguments.excitation is not None:
        task = replace(task, excitation=Excitation(*map(math.radians, arguments.excitation)))
    if (fine := arguments.fine_speed) is not None:
        task = replace(task, fine_speed=None if fine == [0.0, 0.0] else tuple(fine))
    if arguments.least_power is not None:
        task = replace(task, least_power=arguments.least_power / 100.0)
    require_writable(out.resolve().parent)
    store = RecordingStore(out.with_name(f"{out.name}.runs"), Recording)
    with executor_of(arguments) as executor:
        made = design(turbine, task, store, executor, partial(print, file=sys.stderr, flush=True))
    save_design(made, out)
    print(f"{out}: use it as linear_optimal:file={out}")
    return made.record
