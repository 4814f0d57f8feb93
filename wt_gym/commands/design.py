"""Design a controller for a turbine from recorded simulation.

    wt-gym design linear_optimal --turbine nrel_5mw --out mine.npz
    wt-gym evaluate linear_optimal:file=mine.npz

Base controller, plant and disturbances are recorded in training winds, with and without drawn offsets of the pitch; the
feedback follows by least squares. Recordings lie beside the file, in a folder of its name with .runs behind it: a
stopped design resumes from them, and other weights need no other recordings.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
from dataclasses import replace
from pathlib import Path

from wt_gym.commands.engine_options import add_engine_options, executor_of
from wt_gym.commands.program import FIDELITIES_HELP, OneLineParser, file_ending_in, stoppable, user_errors
from wt_gym.commands.site_options import add_site_option

DESIGNS = ("linear_optimal",)
"""Controllers that are designed."""


def parse_arguments(words: list[str] | None = None) -> argparse.Namespace:
    """Read the command line."""
    parser = OneLineParser("design", description=__doc__)
    parser.add_argument("controller", choices=DESIGNS)
    parser.add_argument("--turbine", default="nrel_5mw")
    add_site_option(parser)
    parser.add_argument(
        "--out", type=file_ending_in(".npz"), required=True, metavar="FILE.npz", help="file of the design"
    )
    parser.add_argument("--base", help="base controller (default: side_side_damper)")
    parser.add_argument(
        "--wind-speed",
        nargs="+",
        type=float,
        metavar="M_S",
        help="winds of the designs [m/s] (default: 1.05, 1.32, 1.58 times rated)",
    )
    parser.add_argument(
        "--wind-seeds", nargs="+", type=int, metavar="SEED", help="of the training winds, 1 to 24 (default: 1 to 6)"
    )
    parser.add_argument("--excited", type=int, help="seeds that are run with drawn offsets too (default: 3)")
    parser.add_argument("--excitation", nargs=2, type=float, metavar=("MEAN", "TILT_YAW"), help="largest drawn "
                        "offsets, deg (default: 0.2 0.6)")  # fmt: skip
    parser.add_argument("--duration", type=float, help="of a run, s (default: 300)")
    parser.add_argument(
        "--limit",
        type=float,
        metavar="DEG",
        help="largest offset, deg (default: what the pitch drives can follow at rated speed, at most 4)",
    )
    parser.add_argument(
        "--rate-limit",
        type=float,
        metavar="DEG/S",
        help="largest rate of offsets, deg/s (default: likewise, at most 3)",
    )
    parser.add_argument("--fade", type=float, metavar="DEG", help="collective pitch above fine pitch from which on "
                        "offsets act in full, deg (default: 3)")  # fmt: skip
    parser.add_argument("--fine-speed", nargs=2, type=float, metavar=("LOW", "HIGH"), help="rotor speed over the "
                        "rated one at which offsets begin and act in full at fine pitch; 0 0: they do not act there "
                        "(default: 0.97 1.02)")  # fmt: skip
    parser.add_argument("--travel-weight", type=float, help="factor on the cost of pitch travel (default: 1)")
    parser.add_argument("--power-weight", type=float, help="factor on the cost of power (default: 1)")
    parser.add_argument("--least-power", type=float, metavar="PERCENT", help="change of power that the forecast must "
                        "keep at every wind speed, %% (default: -0.3)")  # fmt: skip
    parser.add_argument("--fidelity", help=FIDELITIES_HELP)
    add_engine_options(parser, "runs")
    parser.add_argument("--json", action="store_true", help="print one JSON object last")
    return parser.parse_args(words)


def main(words: list[str] | None = None) -> None:
    """Run."""
    arguments = parse_arguments(words)
    out: Path = arguments.out
    with user_errors(), stoppable(f"runs that are done are in {out}.runs and are not made again"):
        from wt_gym.base.files import require_writable
        from wt_gym.control.controllers.linear_optimal import default_limits, save_design
        from wt_gym.learning.linear_design.design import LinearDesignTask, default_speeds, design
        from wt_gym.learning.linear_design.feedback import FeedbackOptions
        from wt_gym.learning.linear_design.recording import Excitation, Recording, RecordingStore
        from wt_gym.simulation.fidelity import suited_fidelity
        from wt_gym.turbines import load_turbine
        from wt_gym.turbines.model import with_site

        turbine = with_site(load_turbine(arguments.turbine), dict(arguments.site or ()))
        arguments.fidelity = arguments.fidelity or suited_fidelity(turbine)
        speeds = arguments.wind_speed or default_speeds(turbine)
        limit, rate_limit = default_limits(turbine)
        given = {
            "base": arguments.base,
            "seeds": tuple(arguments.wind_seeds) if arguments.wind_seeds else None,
            "excited": arguments.excited,
            "duration": arguments.duration,
            "limit": limit if arguments.limit is None else math.radians(arguments.limit),
            "rate_limit": rate_limit if arguments.rate_limit is None else math.radians(arguments.rate_limit),
            "fade": None if arguments.fade is None else math.radians(arguments.fade),
        }
        if arguments.excitation is not None:
            mean, tilt_yaw = map(math.radians, arguments.excitation)
            given["excitation"] = Excitation(mean, tilt_yaw)
        if arguments.fine_speed is not None:
            low, high = arguments.fine_speed
            given["fine_speed"] = (low, high)
        if arguments.least_power is not None:
            given["least_power"] = arguments.least_power / 100.0
        weights = {"travel_weight": arguments.travel_weight, "power_weight": arguments.power_weight}
        task = LinearDesignTask(
            speeds=tuple(speeds), fidelity=arguments.fidelity,
            feedback=replace(FeedbackOptions(), **{k: v for k, v in weights.items() if v is not None}),
            **{key: value for key, value in given.items() if value is not None},
        )  # fmt: skip
        if arguments.fine_speed == [0.0, 0.0]:
            task = replace(task, fine_speed=None)
        require_writable(out.resolve().parent)
        store = RecordingStore(out.with_name(f"{out.name}.runs"), Recording)
        with executor_of(arguments) as executor:
            made = design(turbine, task, store, executor, lambda line: print(line, file=sys.stderr, flush=True))
        save_design(made, out)
    print(f"{out}: use it as linear_optimal:file={out}")
    if arguments.json:
        print(json.dumps(made.record))
