"""Serve an agent to turbines under ROSCO, over ZeroMQ in ROSCO's own format.

    wt-gym serve my_agent/model.zip
    wt-gym serve my_set_points.py:MyFarm --address 'tcp://*:5555' --stay

An agent is a trained one with residual actions on the pitch, or a class of your own (file.py:Class) with predict, or
with update_setpoints(id, time, measurements) as users of ROSCO write it; zero leaves ROSCO alone. ROSCO needs ZMQ_Mode
1 in its DISCON.IN, and a library built with ZeroMQ. Any number of turbines may report, each with its ZMQ_ID. The
server ends with the last of them, --turbines says how many there are. Needs the extra "serve" (pyzmq).
"""

import argparse
import logging

from wt_gym.commands.options import MODELS, add_shared
from wt_gym.commands.program import UNSAFE
from wt_gym.tasks import DEFAULT_ENV

EPILOG = UNSAFE
STOPPED = "turbines that are still running wait for answers: end their simulations"
IDLE = 600.0
"""Time without a message after which the server ends [s], unless it stays."""


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    parser.add_argument("agent", metavar="AGENT")
    where = parser.add_mutually_exclusive_group()
    where.add_argument("--port", type=int, default=5555, help="on this machine alone (default: %(default)s)")
    where.add_argument("--address", help="of ZeroMQ, as tcp://*:5555 for turbines on other machines")
    add_shared(
        parser, env={"default": None, "help": f"environment of a class (default: {DEFAULT_ENV})"},
        turbine={"default": None, "metavar": "NAME", "help": "of a class (default: that of the environment)"},
    )  # fmt: skip
    parser.add_argument(
        "--lead", type=float, metavar="S", help="time by which the azimuth of pitch in the fixed frame leads (default: "
        "the delay of the pitch drive at the interval of the messages)",
    )  # fmt: skip
    parser.add_argument(
        "--timeout", type=float, metavar="S",
        help=f"end where no message comes for so long (default: {IDLE:g}; with --stay none)",
    )  # fmt: skip
    parser.add_argument(
        "--turbines", type=int, default=1, metavar="N",
        help="end with the last call of all turbines when so many have reported (default: %(default)s)",
    )  # fmt: skip
    parser.add_argument("--stay", action="store_true", help="wait for the next simulation, until Ctrl-C")
    parser.add_argument("--log", metavar="FILE", help="write the log into a file too")
    add_shared(parser, *MODELS)


def run(arguments: argparse.Namespace) -> None:
    """Serve."""
    if not 0 < arguments.port < 65536:
        raise ValueError(f"port must be from 1 to 65535, got {arguments.port}")
    import zmq  # noqa: F401 - refused before anything is loaded

    from wt_gym.bridges.rosco import RoscoServer
    from wt_gym.deployment.serving import answers_of
    from wt_gym.experiment.names import with_model_options

    handlers: list[logging.Handler] = [logging.StreamHandler()]
    if arguments.log is not None:
        handlers.append(logging.FileHandler(arguments.log, encoding="utf-8"))
    logging.basicConfig(format="%(asctime)s %(levelname)s %(message)s", level=logging.INFO, handlers=handlers)
    (choice,) = with_model_options([arguments.agent], arguments.algo, arguments.trust)
    answers = answers_of(choice, arguments.env, arguments.turbine, arguments.lead)
    address = arguments.address or f"tcp://127.0.0.1:{arguments.port}"
    idle = None if arguments.stay else IDLE
    with RoscoServer(address, answers, idle if arguments.timeout is None else arguments.timeout) as server:
        print(f"listening at {server.address}; Ctrl-C ends", flush=True)
        count = server.serve(arguments.stay, arguments.turbines)
    print(f"{count} messages answered")
