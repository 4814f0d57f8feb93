"""Campbell diagram: frequencies and damping of a turbine's modes against rotor speed or wind speed.

    wt-gym campbell                                    # structure without air, 0 ... 1.1 times rated speed
    wt-gym campbell --wind-speed 4 8 12 16 20 24       # in operation, with quasi-steady aerodynamics
    wt-gym campbell --turbine iea_15mw --out runs/campbell.png --csv runs/campbell.csv

In operation rotor speed and pitch follow the baseline controller's steady schedule. The generator turns at constant
speed unless --free-generator is given.
"""

from __future__ import annotations

import argparse
import math
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from wt_gym.base.errors import did_you_mean
from wt_gym.base.files import require_writable, whole_file
from wt_gym.commands.options import add_shared, turbine_of
from wt_gym.commands.program import FIDELITIES_HELP

if TYPE_CHECKING:
    from wt_gym.simulation.campbell import CampbellDiagram
    from wt_gym.turbines import Turbine

LARGEST_OVERSPEED = 5.0  # in rated rotor speeds


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    add_shared(
        parser, "turbine", "site", "fidelity", "wind_speed",
        fidelity={"help": f"{FIDELITIES_HELP}; not gebhardt, whose constrained form has no linear model"},
    )  # fmt: skip
    parser.add_argument("--rotor-speed", type=float, nargs="+", metavar="RPM", help="rotor speeds [rpm]")
    parser.add_argument("--pitch", type=float, metavar="DEG", help="blade pitch, with rotor speeds only (default: 0)")
    parser.add_argument("--aerodynamics", choices=("none", "frozen_wake", "quasi_steady"), help="default: see above")
    parser.add_argument("--free-generator", action="store_true", help="constant torque instead of constant speed")
    parser.add_argument("--azimuths", type=int, default=6, help="over which models are averaged (default: %(default)s)")
    parser.add_argument("--out", type=Path, help="figure (format by its ending: png, svg, pdf)")
    parser.add_argument("--csv", type=Path, help="tidy table")
    add_shared(parser, "json")


def check(parser: argparse.ArgumentParser, arguments: argparse.Namespace) -> None:
    """Refuse what cannot be drawn before anything is computed."""
    if arguments.rotor_speed and arguments.wind_speed:
        parser.error("give --rotor-speed or --wind-speed, not both")
    if arguments.wind_speed and arguments.pitch is not None:
        parser.error(
            "--pitch goes with --rotor-speed; with --wind-speed the schedule of the controller gives the pitch"
        )
    for value in arguments.rotor_speed or ():
        if not 0.0 <= value < math.inf:
            parser.error(f"--rotor-speed {value}: allowed are finite speeds from 0")
    for value in arguments.wind_speed or ():
        if not 0.0 < value < math.inf:
            parser.error(f"--wind-speed {value}: allowed are finite speeds above 0")
    if arguments.pitch is not None and not abs(arguments.pitch) <= 180.0:
        parser.error(f"--pitch {arguments.pitch}: allowed are -180 ... 180 degrees")
    if arguments.azimuths < 1:
        parser.error(f"--azimuths {arguments.azimuths}: at least one is needed")
    from wt_gym.simulation import FIDELITIES

    if arguments.fidelity not in (None, *FIDELITIES):
        parser.error(
            f"--fidelity must be one of {', '.join(FIDELITIES)}, got {arguments.fidelity}"
            + did_you_mean(arguments.fidelity, FIDELITIES)
        )
    if arguments.fidelity and FIDELITIES[arguments.fidelity].formulation != "embedded":
        parser.error(
            f"--fidelity {arguments.fidelity}: linear models need the embedded formulation, not the constrained"
        )
    if arguments.out:
        from matplotlib.backend_bases import FigureCanvasBase

        known = FigureCanvasBase.get_supported_filetypes()
        if arguments.out.suffix.lower().lstrip(".") not in known:
            parser.error(f"--out {arguments.out}: endings of figures are {', '.join(sorted(known))}")


def check_speeds(arguments: argparse.Namespace, turbine: Turbine) -> None:
    """Refuse speeds that no rotor of this kind reaches, before anything is compiled."""
    rated = turbine.drivetrain.rated_rotor_speed * 30.0 / math.pi
    allowed = (
        ("--rotor-speed", arguments.rotor_speed, LARGEST_OVERSPEED * rated, f"{LARGEST_OVERSPEED:g} x rated", "rpm"),
        ("--wind-speed", arguments.wind_speed, turbine.cut_out, "cut-out", "m/s"),
    )
    for option, values, largest, what, unit in allowed:
        for value in values or ():
            if value > largest:
                raise ValueError(f"{option} {value:g}: {turbine.name} takes at most {largest:.4g} {unit} ({what})")


def compute(arguments: argparse.Namespace) -> CampbellDiagram:
    """Diagram of the options."""
    import numpy as np

    from wt_gym.control.operating_point import operating_point
    from wt_gym.experiment.execute import ProgressLine
    from wt_gym.simulation import Simulator
    from wt_gym.simulation.campbell import campbell
    from wt_gym.wind import SteadyInflow

    line = ProgressLine(shown=sys.stderr.isatty())
    turbine = turbine_of(arguments)
    check_speeds(arguments, turbine)
    inflow = SteadyInflow(turbine.rated_wind_speed, hub_height=turbine.hub_height)
    simulator = Simulator(turbine, inflow=inflow, fidelity=arguments.fidelity)
    speeds = arguments.rotor_speed
    if speeds is None and arguments.wind_speed is None:
        speeds = np.linspace(0.0, 1.1, 6) * turbine.drivetrain.rated_rotor_speed * 30.0 / np.pi
    return campbell(
        simulator, rotor_speeds=None if arguments.wind_speed else np.asarray(speeds) * np.pi / 30.0,
        wind_speeds=arguments.wind_speed, schedule=lambda wind: operating_point(turbine, wind),
        pitch=np.radians(arguments.pitch or 0.0), aerodynamics=arguments.aerodynamics,
        generator="free" if arguments.free_generator else "locked", n_azimuths=arguments.azimuths,
        on_point=lambda done, count: line.show(f"{done} of {count} operating points", final=done == count),
    )  # fmt: skip


def show(diagram: CampbellDiagram) -> None:
    """Print the diagram as a table."""
    print(f"{diagram.turbine}: {diagram.description}; damped frequency [Hz] and damping ratio [%]")
    print(f"{'wind [m/s]':>24}  " + "".join(f"{v:15.2f}" for v in diagram.wind_speed))
    print(f"{'rotor [rpm]':>24}  " + "".join(f"{v * 30 / math.pi:15.2f}" for v in diagram.rotor_speed))
    for name, frequency, damping in zip(diagram.names, diagram.frequency, diagram.damping, strict=True):
        cells = "".join(f"{f:8.3f} {100 * d:6.2f}" for f, d in zip(frequency, damping, strict=True))
        print(f"{name.replace('_', ' '):>24}  {cells}")


STOPPED = "a diagram is written when all its points are done"


def run(arguments: argparse.Namespace) -> dict[str, Any]:
    """Compute, print and draw the diagram."""
    files = [path for path in (arguments.csv, arguments.out) if path]
    for path in files:
        require_writable(path.parent)
    diagram = compute(arguments)
    show(diagram)
    if arguments.csv:
        diagram.to_csv(arguments.csv)
    if arguments.out:
        with whole_file(arguments.out) as partial:
            diagram.figure().savefig(partial, format=arguments.out.suffix.removeprefix("."), dpi=150)
    for path in files:
        print(f"written: {path}")
    return {"turbine": diagram.turbine, "abscissa": diagram.abscissa, "rows": diagram.rows()}
