"""The command line ``wt-gym``: one module a command, which imports nothing heavy before it knows what to do."""

import argparse
import json
import keyword
import sys
from importlib import import_module
from typing import Any

import wt_gym
from wt_gym.base.errors import did_you_mean
from wt_gym.commands.program import OneLineParser, stoppable, user_errors, write_any_character

COMMANDS = {
    "train": "train a policy: PPO, SAC or TQC",
    "search": "search hyperparameters for a training",
    "evaluate": "compare agents and controllers in held-out winds, with a report",
    "learnability": "whether a task can be learned: bound of its actions, alignment and noise of its gradient",
    "robustness": "agents on other turbines, with worse sensors and in other winds: what is left of their gain",
    "crosscheck": "the same agents and winds in OpenFAST, changes side by side",
    "loadcases": "design load cases of IEC 61400-1: extreme and fatigue loads, faults",
    "benchmark": "agents in frozen tasks, and their scores",
    "dataset": "record an agent at work as a Minari data set",
    "compare-controllers": "controllers side by side in the same winds, without environments",
    "tune": "tune the parameters of a controller",
    "design": "design the linear optimal controller of a turbine",
    "export": "write an agent or a controller as a Bladed library, a model that OpenFAST runs, or an ONNX file",
    "fly": "an exported agent and the original in the same wind, here and in OpenFAST",
    "loads": "loads of runs of OpenFAST, side by side",
    "serve": "serve an agent to turbines under ROSCO, over ZeroMQ",
    "simulate": "operating points under the baseline controller, signals as NetCDF",
    "campbell": "frequencies and damping against rotor or wind speed",
    "import": "read an OpenFAST model as a turbine, and write it as a windIO file",
    "describe": "an environment: observations with unit, range and source, actions, reward, base controller",
    "list": "controllers with their parameters, turbines, tasks, channels, trained agents",
    "compile": "compile the simulator ahead of the first run, in two processes",
    "record": "record how turbines run in turbulence, for the starts of their episodes",
}


def module_of(command: str) -> Any:
    """Return the module of a command: its name has ``_`` for ``-``, and one more behind a word of Python."""
    name = command.replace("-", "_")
    return import_module(f"wt_gym.commands.{name}_" if keyword.iskeyword(name) else f"wt_gym.commands.{name}")


def parser_of(command: str) -> OneLineParser:
    """Return the parser of a command."""
    module = module_of(command)
    parser = OneLineParser(command, description=module.__doc__, epilog=getattr(module, "EPILOG", None))
    parser.set_defaults(status=0)
    module.add_options(parser)
    return parser


def parse(command: str, words: list[str] | None = None) -> argparse.Namespace:
    """Read the options of a command.

    Its module has a docstring, which is the description, ``add_options``, which takes the parser, and may have a text
    ``EPILOG``, ``check``, which takes the arguments and refuses what does not go together by a `ValueError`, and
    ``parse``, which takes parser and words where one reading does not do.
    """
    module, parser, words = module_of(command), parser_of(command), words or []
    arguments: argparse.Namespace = (
        module.parse(parser, words) if hasattr(module, "parse") else parser.parse_args(words)
    )
    if hasattr(module, "check"):
        try:
            module.check(arguments)
        except ValueError as error:
            parser.error(str(error))
    return arguments


def run(command: str, words: list[str]) -> None:
    """Run a command, print its result as JSON where that is asked for, and end with its status.

    ``run`` of its module takes the arguments, of which it may set ``status``, and gives the result, None where there is
    none to print. ``STOPPED`` tells what is there after Ctrl-C or SIGTERM: a text with names of arguments in braces.
    """
    module, arguments = module_of(command), parse(command, words)
    arguments.words = words
    stopped: str = getattr(module, "STOPPED", "nothing is left to do")
    with user_errors(), stoppable(stopped.format_map(vars(arguments))):
        result = module.run(arguments)
        if result is not None and arguments.json:
            print(json.dumps(result, default=str))
    if arguments.status:
        sys.exit(arguments.status)


def main(words: list[str] | None = None) -> None:
    """Run the command that the first word names, by default of the command line, with the others as its options."""
    width = max(map(len, COMMANDS))
    parser = OneLineParser(
        prog="wt-gym",
        usage="wt-gym COMMAND [OPTIONS]",
        description="Learning to control a wind turbine, on an aeroelastic simulator.\n\n"
        + "\n".join(f"  {name:{width}}  {text}" for name, text in COMMANDS.items()),
        epilog="wt-gym COMMAND --help has the options of a command.",
    )
    parser.add_argument("--version", action="version", version=f"wt_gym {wt_gym.__version__}")
    parser.add_argument("command", metavar="COMMAND", help=argparse.SUPPRESS)
    parser.add_argument("words", nargs=argparse.REMAINDER, default=[], metavar="OPTIONS", help=argparse.SUPPRESS)
    write_any_character()
    chosen = parser.parse_args(words)
    if chosen.command not in COMMANDS:
        near = did_you_mean(chosen.command, COMMANDS)
        parser.error(f"COMMAND must be one of {', '.join(COMMANDS)}, got {chosen.command!r}{near}")
    run(chosen.command, chosen.words)
