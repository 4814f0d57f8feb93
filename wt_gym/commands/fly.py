"""Export an agent or a controller, run library and original in the same wind, and say how far they agree.

    wt-gym fly runs/ppo --out runs/flight --wind-speed 15 --wind-seeds 1001 --duration 120
    wt-gym fly constrained_ipc+tower_dampers --out runs/flight --openfast /opt/openfast/bin/openfast

Four runs from the same steady start: in this package's simulator with Python and with the library as controller, in
OpenFAST with the library through ServoDyn (its driver) and with Python (its library, docs/howto/openfast.md). Runs that
OpenFAST is missing for are left out and named. No run has the sensor noise of a training. FOLDER/openfast is the model
that the driver runs.

Exit status: 0 they agree (demands here within 1e-5 rad, 1e-5 of the greatest torque and 1e-5 rad/s of yaw, loads in
OpenFAST within 0.1 %, with a lidar 0.5 %, from standstill 1 %), 1 they do not, or what was asked for is refused.
"""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING, Any

from wt_gym.commands.loads import table
from wt_gym.commands.options import add_scene, add_shared, scene_of
from wt_gym.commands.program import UNSAFE

if TYPE_CHECKING:
    from wt_gym.deployment.export.openfast_flight import Flight

EPILOG = UNSAFE


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    parser.add_argument("agent", help="path of a trained model, its folder or its file, or a controller")
    turbine_help = "of a controller (default: nrel_5mw)"
    add_shared(parser, out="runs/flight", turbine={"default": None, "help": turbine_help})
    add_scene(parser, 120.0)
    add_shared(parser, skip={"default": 20.0, "help": "start left out of the loads [s] (default: %(default)s)"})
    parser.add_argument("--openfast", metavar="PATH", help="OpenFAST's driver (default: on the path)")
    parser.add_argument("--openfast-library", metavar="PATH", help="OpenFAST's library (default: where it is found)")
    parser.add_argument("--hold-missing", action="store_true", help="as of wt-gym export")
    add_shared(parser, "json")


def run(arguments: argparse.Namespace) -> dict[str, Any]:
    """Fly."""
    if not 0.0 <= arguments.skip < arguments.duration:
        raise ValueError(f"--skip must be from 0 to below --duration, got {arguments.skip:g}")
    from wt_gym.deployment.export.openfast_flight import fly

    flight = fly(
        arguments.agent, arguments.out, scene_of(arguments), duration=arguments.duration, skip=arguments.skip,
        hold_missing=arguments.hold_missing, driver=arguments.openfast, library=arguments.openfast_library,
    )  # fmt: skip
    print(_text(flight))
    arguments.status = 0 if flight.agrees else 1
    return {
        "pitch_rad": flight.pitch, "torque": flight.torque, "yaw_rate_rad_s": flight.yaw_rate,
        "changes": flight.changes, "metrics": flight.metrics, "missing": flight.missing, "agrees": flight.agrees,
    }  # fmt: skip


def _text(flight: Flight) -> str:
    """Loads and differences in lines."""
    from wt_gym.deployment.export.openfast_flight import LARGEST_DIFFERENCE

    lines = [
        f"wt_gym, library against Python: pitch within {flight.pitch:.1e} rad, torque within {flight.torque:.1e} of "
        f"the greatest, yaw within {flight.yaw_rate:.1e} rad/s (limit {LARGEST_DIFFERENCE:g}), without sensor noise"
    ]
    if flight.changes:
        largest = max(flight.changes, key=lambda load: abs(flight.changes[load]))
        lines.append(
            f"OpenFAST, library against Python: loads within {100.0 * abs(flight.changes[largest]):.3f} %, the largest "
            f"change of {largest} (limit {100.0 * flight.limit:g} %)"
        )
    lines += [f"left out: {run}: {why}" for run, why in flight.missing.items()]
    return "\n".join([table(flight.metrics, None), "", *lines, f"OpenFAST model: {flight.primary}"])
