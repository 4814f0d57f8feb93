"""Write a trained agent or a controller in a form that needs neither this package nor PyTorch.

    wt-gym export agents/trained/load_reduction --to onnx --out exported
    wt-gym export constrained_ipc+tower_dampers --to discon --out exported
    wt-gym export runs/ppo --to openfast --out flight --wind-speed 15 --duration 300

onnx: the policy of a trained agent from measured channels in SI units to the action, scaling and clipping inside, with
a card of what it is made for. Needs the extra "export" (onnx, onnxruntime).

discon: a controller, or a trained agent on its controller, from measurements to demands as one C99 file and a library
with the Bladed interface for OpenFAST, Bladed, HAWC2 and QBlade, with a parameter file. Needs a C compiler, or ziglang.

openfast: that library in a folder with turbine and wind, which OpenFAST's driver runs: openfast FOLDER/model.fst. An
agent runs in the turbine and wind of its training, a controller in those of wt_gym/LoadReduction-v3; wt-gym loads
reads what OpenFAST writes.
"""

import argparse
from typing import Any

from wt_gym.commands.options import add_scene, add_shared, scene_of
from wt_gym.commands.program import UNSAFE

EPILOG = UNSAFE


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    parser.add_argument("agent", help="path of a trained model, its folder or its file; for discon a controller too")
    parser.add_argument("--to", choices=tuple(_FORMS), default="onnx", help="form (default: %(default)s)")
    add_shared(parser, out={"required": True, "help": "folder for the files"})
    discon = parser.add_argument_group("discon and openfast")
    turbine_help = "of a controller (default: that of --model, else nrel_5mw)"
    add_shared(discon, turbine={"default": None, "help": turbine_help})
    discon.add_argument("--interval", type=float, help="step of a controller in s (default: that of the simulator)")
    discon.add_argument("--target", help="machine: linux, linux-arm, windows, macos, macos-arm (default: this one)")
    discon.add_argument(
        "--drive", action="store_true", help="pitch drives and rate limits in the library, for codes without them"
    )
    discon.add_argument(
        "--hold-missing", action="store_true",
        help="hold channels that the interface does not have at the middle of their scale",
    )  # fmt: skip
    openfast = parser.add_argument_group("openfast")
    add_scene(openfast, 600.0)
    openfast.add_argument("--model", metavar="FST", help="model of your own for the turbine (default: one is written)")
    add_shared(parser, "json")


def run(arguments: argparse.Namespace) -> dict[str, Any]:
    """Export."""
    made = _FORMS[arguments.to](arguments)
    for file in made["files"]:
        print(file)
    if arguments.to == "onnx":
        print(f"actions equal those of the policy within {made['largest_difference']:.1e}")
    elif made["held"]:
        print(f"held at the middle of their scale: {', '.join(made['held'])}")
    if made.get("lidar_points"):
        of = len(made["lidar"]["ranges"]) * made["lidar"]["n_beams"]
        print(f"OpenFAST reads {made['lidar_points']} of {of} points of the lidar, without evolution: README.md")
    return made


def _onnx(arguments: argparse.Namespace) -> dict[str, Any]:
    import onnx  # noqa: F401 - refused before anything is made
    import onnxruntime  # noqa: F401

    from wt_gym.deployment.export.policy import export_onnx

    return export_onnx(arguments.agent, arguments.out)


def _discon(arguments: argparse.Namespace) -> dict[str, Any]:
    from wt_gym.deployment.export.discon import export_discon

    return export_discon(
        arguments.agent, arguments.out, turbine=arguments.turbine, interval=arguments.interval,
        target=arguments.target, hold_missing=arguments.hold_missing, drive=arguments.drive,
    )  # fmt: skip


def _openfast(arguments: argparse.Namespace) -> dict[str, Any]:
    from wt_gym.control.controllers import parse_name
    from wt_gym.deployment.export.openfast_flight import export_openfast

    if arguments.interval is not None or arguments.target is not None or arguments.drive:
        raise ValueError("--interval, --target and --drive must be left out with --to openfast, which sets them")
    if arguments.model is not None and arguments.turbine is None and parse_name(arguments.agent).kind != "trained":
        arguments.turbine = arguments.model  # an agent has the turbine of its training
    return export_openfast(
        arguments.agent, arguments.out, scene_of(arguments), duration=arguments.duration,
        hold_missing=arguments.hold_missing, model=arguments.model,
    )  # fmt: skip


_FORMS = {"onnx": _onnx, "discon": _discon, "openfast": _openfast}
