"""Read the model of another program as a turbine: the primary file of an OpenFAST model (.fst), of release 2 to 5.

    wt-gym import model.fst                            # what was read, assumed and left aside
    wt-gym import model.fst --out turbine.yaml         # and written as a windIO file, for --turbine turbine.yaml
    wt-gym import model.fst --rated-power 5000 --rated-rotor-speed 12.1   # [kW], [rpm], where the model has none

The windIO file stands alone, with the numbers of the controller beside it (NAME.control.json). It is read back and
compared with the model before the command ends. Commands that take --turbine take model.fst itself as well.

The turbine then runs for 100 s under its own controller in nine steady winds from cut-in to cut-out, beside the table
of steady states that comes with the model, if any (--no-check leaves that out; it takes a minute or two). Where a run
does not hold its operating point within 2 % of rated speed, makes less than 90 % of the table's power, or less than
99 % of rated power above rated wind, the command says so and ends with status 3.
"""

from __future__ import annotations

import argparse
import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

from wt_gym.base.files import require_writable
from wt_gym.commands.options import add_shared
from wt_gym.commands.program import file_ending_in

if TYPE_CHECKING:
    from wt_gym.turbines import ControlData, Turbine

STOPPED = "what was read stands above"
_RPM = math.pi / 30.0
_FAILED_CHECK = 3
"""Exit status."""


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    parser.add_argument("model", type=Path, help="primary file of the model (.fst)")
    parser.add_argument(
        "--out", type=file_ending_in(".yaml", ".yml"), metavar="YAML", help="windIO file to write (.yaml or .yml)"
    )
    parser.add_argument("--blade", choices=("elastodyn", "beamdyn"), help="its structure (default: as CompElast says)")
    parser.add_argument("--rated-power", type=float, metavar="KW", help="electrical, for a model that does not say it")
    parser.add_argument("--rated-rotor-speed", type=float, metavar="RPM", help="for a model that does not say it")
    parser.add_argument(
        "--check", choices=("openfast_io",),
        help="read it with this package too, and compare what both read (extra openfast)",
    )  # fmt: skip
    parser.add_argument("--no-check", action="store_true", help="leave out the runs in nine steady winds")
    add_shared(parser, "json")


def check(arguments: argparse.Namespace) -> None:
    """Refuse other files, and ratings without meaning."""
    if arguments.model.suffix.lower() != ".fst":
        raise ValueError(f"{arguments.model}: must be the primary file of an OpenFAST model, .fst")
    rating = {"--rated-power": arguments.rated_power, "--rated-rotor-speed": arguments.rated_rotor_speed}
    for option, value in rating.items():
        if value is not None and not 0.0 < value < math.inf:
            raise ValueError(f"{option} {value}: must be a positive number")


def summary(turbine: Turbine) -> list[tuple[str, float, str]]:
    """Return the main numbers of a turbine with their units."""
    import numpy as np

    blade, tower, train = turbine.blade, turbine.tower, turbine.drivetrain
    about_root = blade.structure.mass_moment(2)
    mass = blade.structure.mass_moment(0)
    inertia = turbine.hub.inertia_axial + turbine.n_blades * float(
        np.cos(turbine.hub.cone) ** 2
        * (about_root + 2.0 * turbine.hub.radius * blade.structure.mass_moment(1) + turbine.hub.radius**2 * mass)
    )
    platform = turbine.floater
    afloat = [] if platform is None else [
        ("platform mass with ballast", platform.mass, "kg"),
        ("displaced volume", platform.displaced_volume, "m^3"),
        ("mooring lines", len(platform.lines), ""),
    ]  # fmt: skip
    return [
        ("blades", turbine.n_blades, ""),
        ("rotor diameter", turbine.rotor_diameter, "m"),
        ("hub height", turbine.hub_height, "m"),
        ("rated power", train.rated_power / 1e3, "kW"),
        ("rated rotor speed", train.rated_rotor_speed / _RPM, "rpm"),
        ("rated wind speed", turbine.rated_wind_speed, "m/s"),
        ("gear ratio", train.gear_ratio, ""),
        ("cone", math.degrees(turbine.hub.cone), "deg"),
        ("tilt", math.degrees(turbine.nacelle.tilt), "deg"),
        ("prebend at the tip", 0.0 - float(blade.axis[-1, 0]), "m"),
        ("blade mass", mass, "kg"),
        ("blade, first moment about the root", blade.structure.mass_moment(1), "kg m"),
        ("blade, second moment about the root", about_root, "kg m^2"),
        ("rotor inertia", inertia, "kg m^2"),
        ("hub mass", turbine.hub.mass, "kg"),
        ("nacelle mass", turbine.nacelle.mass, "kg"),
        ("tower mass", tower.structure.mass_moment(0), "kg"),
        ("tower base", tower.base_height, "m"),
        ("airfoils", len(blade.airfoils), ""),
        ("stations of the blade", blade.structure.station.size, ""),
        ("stations of the tower", tower.structure.station.size, ""),
        *afloat,
    ]


def control_summary(control: ControlData) -> list[tuple[str, str]]:
    """Return the known numbers of a controller with their names, tables by their ends."""
    import dataclasses

    import numpy as np

    rows = []
    for item in dataclasses.fields(control):
        value = getattr(control, item.name)
        if isinstance(value, np.ndarray):
            rows.append((item.name, f"{value.size} values, {value[0]:.4g} ... {value[-1]:.4g}"))
        elif value is not None:
            rows.append((item.name, str(value) if isinstance(value, bool) else f"{value:.6g}"))
    return rows


def show(turbine: Turbine) -> None:
    """Print what was read, and what was assumed and left aside."""
    print(turbine.heading)
    for name, value, unit in summary(turbine):
        print(f"  {name:36}{value:14.6g} {unit}".rstrip())
    if turbine.control is not None:
        print("controller (generator side, SI units and radians)")
        for name, text in control_summary(turbine.control):
            print(f"  {name:36}{text}")
    print("assumed and left aside")
    for note in turbine.notes:
        print(f"  - {note}")


def show_controller(turbine: Turbine) -> None:
    """Print which controller is the baseline and why, and what its check says."""
    import importlib.util
    import warnings

    from wt_gym.control.controllers import make_controller
    from wt_gym.control.controllers.own import own_law
    from wt_gym.control.operating_point import tracks_tip_speed_ratio

    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        make_controller("discon", turbine)
    print("baseline")
    print(f"  discon: {own_law(turbine)}")
    if tracks_tip_speed_ratio(turbine):
        there = "" if importlib.util.find_spec("rosco") else " (extra rosco, not installed)"
        print(
            f"  ROSCO's library runs with these numbers as the controller rosco{there}; the baseline is discon, which "
            "needs no library and continues from snapshots"
        )
    for warning in caught:
        print(f"  - {warning.message}")


_COLUMNS = (
    ("rotor_speed", "speed", "rpm", 1.0 / _RPM, 2),
    ("pitch", "pitch", "deg", 180.0 / math.pi, 2),
    ("power", "power", "kW", 1e-3, 1),
    ("thrust", "thrust", "kN", 1e-3, 1),
)


def check_steady(turbine: Turbine, model: Path) -> list[dict[str, Any]]:
    """Run the turbine in nine steady winds and print a row for each; return the rows."""
    from wt_gym.experiment.execute import ProgressLine, clock
    from wt_gym.experiment.steady_check import DURATION, steady_check, steady_winds, verdict
    from wt_gym.turbines.openfast_control import find_steady_table

    table, winds, line = find_steady_table(model, turbine.drivetrain.rated_power), steady_winds(turbine), ProgressLine()

    def progress(count: int, seconds: float) -> None:
        line.show(f"steady winds: {count}/{len(winds)} after {clock(seconds)}", final=count == len(winds))

    print(f"check: {DURATION:g} s in {len(winds)} steady winds under discon", end="")
    print(f", beside {table.path.name}" if table else "; no table of steady states comes with the model", flush=True)
    points = steady_check(turbine, progress)
    print(f"{'wind':>6}" + "".join(f"{title:>{19 if table else 9}}" for _, title, *_ in _COLUMNS) + "   verdict")
    print(f"{'m/s':>6}" + "".join(f"{unit:>{19 if table else 9}}" for _, _, unit, *_ in _COLUMNS))
    rows = []
    for point in points:
        row: dict[str, Any] = {"wind_m_s": point.wind, "verdict": verdict(turbine, point, table) or "right"}
        text = f"{point.wind:6.2f}"
        for name, _, unit, scale, digits in _COLUMNS:
            value, reference = scale * getattr(point, name), None if table is None else table.at(point.wind, name)
            row[f"{name}_{unit}"] = None if math.isnan(value) else value
            text += f"{value:9.{digits}f}"
            if table is not None:
                row[f"table_{name}_{unit}"] = None if reference is None else scale * reference
                text += " /" + (f"{'-':>8}" if reference is None else f"{scale * reference:8.{digits}f}")
        print(f"{text}   {row['verdict']}")
        rows.append(row)
    wrong = [row["wind_m_s"] for row in rows if row["verdict"] != "right"]
    if wrong:
        print(f"CHECK FAILED at {', '.join(f'{wind:g}' for wind in wrong)} m/s: no fair baseline in these winds")
    else:
        print("check passed")
    return rows


def run(arguments: argparse.Namespace) -> dict[str, Any]:
    """Read, show, write and check."""
    from wt_gym.base.errors import TurbineDefinitionError
    from wt_gym.turbines import load_turbine
    from wt_gym.turbines.openfast import compare_with_openfast_io, read_openfast
    from wt_gym.turbines.windio_writer import require_same, write_windio

    if arguments.out:
        require_writable(arguments.out.parent)
    turbine = read_openfast(
        arguments.model,
        None if arguments.rated_power is None else 1e3 * arguments.rated_power,
        None if arguments.rated_rotor_speed is None else _RPM * arguments.rated_rotor_speed,
        arguments.blade,
    )
    show(turbine)
    if arguments.check:
        for line in compare_with_openfast_io(arguments.model):
            print(line)
    written: list[Path] = []
    if arguments.out:
        written = write_windio(turbine, arguments.out, f"the OpenFAST model {arguments.model.name}")
        try:
            require_same(turbine, load_turbine(arguments.out))
        except TurbineDefinitionError as error:
            raise TurbineDefinitionError(f"{arguments.out}, read back, is another turbine: {error}") from error
    for path in written:
        print(f"written: {path}")
    show_controller(turbine)
    rows = [] if arguments.no_check else check_steady(turbine, arguments.model)
    if any(row["verdict"] != "right" for row in rows):
        arguments.status = _FAILED_CHECK
    return {
        "check": rows,
        "turbine": turbine.name,
        "summary": [{"name": name, "value": value, "unit": unit} for name, value, unit in summary(turbine)],
        "control": dict(control_summary(turbine.control)) if turbine.control is not None else None,
        "notes": list(turbine.notes),
        "written": [str(path) for path in written],
    }
