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
from wt_gym.base.options import Options, option, option_record
from wt_gym.base.options import add_options as add_record
from wt_gym.commands.options import add_shared, turbine_of, with_record
from wt_gym.commands.program import FIDELITIES_HELP

if TYPE_CHECKING:
    from wt_gym.simulation.campbell import CampbellDiagram

LARGEST_OVERSPEED = 5.0  # in rated rotor speeds


@option_record
class CampbellOptions(Options):
    """Points of the diagram, and its model."""

    title = "diagram"

    rotor_speed: tuple[float, ...] | None = option("rotor speeds", default=None, unit="rpm", low=0.0)
    wind_speed: tuple[float, ...] | None = option("mean wind speeds", default=None, unit="m/s", low=0.0, above=True)
    pitch: float | None = option(
        "blade pitch, with rotor speeds only", default=None, unit="deg", low=-180.0, high=180.0, otherwise="0"
    )
    aerodynamics: str | None = option(
        "model of the air", default=None, choices=("none", "frozen_wake", "quasi_steady"), otherwise="see above"
    )
    free_generator: bool = option("constant torque instead of constant speed", default=False)
    azimuths: int = option("over which models are averaged", default=6, low=1)

    def check(self) -> None:
        """Refuse both kinds of points, and a pitch where the controller gives it."""
        if self.rotor_speed and self.wind_speed:
            raise ValueError("give --rotor-speed or --wind-speed, not both")
        if self.wind_speed and self.pitch is not None:
            raise ValueError("--pitch goes with --rotor-speed; with --wind-speed the controller gives the pitch")


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    add_shared(
        parser, "turbine", "site", "fidelity",
        fidelity={"help": f"{FIDELITIES_HELP}; not gebhardt, whose constrained form has no linear model"},
    )  # fmt: skip
    add_record(parser, CampbellOptions)
    parser.add_argument("--out", type=Path, help="figure (format by its ending: png, svg, pdf)")
    parser.add_argument("--csv", type=Path, help="tidy table")
    add_shared(parser, "json")


def check(arguments: argparse.Namespace) -> None:
    """Refuse what cannot be drawn before anything is computed."""
    with_record(arguments, CampbellOptions)
    from wt_gym.simulation import FIDELITIES

    if arguments.fidelity not in (None, *FIDELITIES):
        raise ValueError(
            f"--fidelity must be one of {', '.join(FIDELITIES)}, got {arguments.fidelity}"
            + did_you_mean(arguments.fidelity, FIDELITIES)
        )
    if arguments.fidelity and FIDELITIES[arguments.fidelity].formulation != "embedded":
        raise ValueError(
            f"--fidelity {arguments.fidelity}: linear models need the embedded formulation, not the constrained"
        )
    if arguments.out:
        from matplotlib.backend_bases import FigureCanvasBase

        known = FigureCanvasBase.get_supported_filetypes()
        if arguments.out.suffix.lower().lstrip(".") not in known:
            raise ValueError(f"--out {arguments.out}: endings of figures are {', '.join(sorted(known))}")


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
    rated = turbine.drivetrain.rated_rotor_speed * 30.0 / math.pi
    for name, largest, what in (
        ("rotor_speed", LARGEST_OVERSPEED * rated, f"rpm ({LARGEST_OVERSPEED:g} x rated)"),
        ("wind_speed", turbine.cut_out, "m/s (cut-out)"),
    ):
        if (fastest := max(getattr(arguments, name) or (0.0,))) > largest:  # before anything is compiled
            option_name = name.replace("_", "-")
            raise ValueError(f"--{option_name} {fastest:g}: {turbine.name} takes at most {largest:.4g} {what}")
    inflow = SteadyInflow(turbine.rated_wind_speed, hub_height=turbine.hub_height)
    simulator = Simulator(turbine, inflow=inflow, fidelity=arguments.fidelity)
    speeds = arguments.rotor_speed
    if speeds is None and arguments.wind_speed is None:
        speeds = np.linspace(0.0, 1.1, 6) * rated
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
