"""List what there is by name: controllers with their parameters, turbines, tasks, channels, trained agents.

    wt-gym list controllers
    wt-gym list controllers discon ipc --turbine iea_22mw
    wt-gym list turbines

A parameter of a controller stands behind its name: ipc+yaw:bandwidth=0.3,dead_band=0.1. Of several parts with a
parameter of the same name PART__PARAMETER tells which. The defaults that follow from the turbine are shown for
--turbine.
"""

import argparse
import sys
from typing import Any

from wt_gym.base.errors import did_you_mean
from wt_gym.commands.options import add_shared


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    parser.add_argument("what", choices=tuple(_TABLES), metavar="WHAT", help=", ".join(_TABLES))
    parser.add_argument("names", nargs="*", metavar="NAME", help="only these (by default all)")
    add_shared(
        parser, "turbine", "json",
        turbine={"default": None, "help": "turbine whose defaults of controllers and channels are shown"},
    )  # fmt: skip


def controllers(turbine: Any = None) -> list[dict[str, Any]]:
    """Every built-in controller with its parameters, those that it has for the turbine."""
    from wt_gym.control.controllers import (
        ADDITIONS,
        BASES,
        CONTROLLERS,
        GUARDS,
        WRAPPERS,
        controller_summary,
        declared_parameters,
    )
    from wt_gym.control.controllers.names import default_text

    kinds = dict.fromkeys(BASES, "base") | dict.fromkeys(WRAPPERS, "works inside a base")
    kinds |= dict.fromkeys(ADDITIONS, "addition") | dict.fromkeys(GUARDS, "around all parts")
    return [
        {
            "name": name,
            "kind": kinds.get(name, "several parts"),
            "what": controller_summary(name),
            "parameters": [
                {
                    "name": parameter.name,
                    "unit": parameter.unit,
                    "default": default_text(parameter, turbine),
                    "allowed": parameter.allowed,
                    "meaning": parameter.meaning,
                }
                for parameter in declared_parameters(name)
                if parameter.belongs_to(turbine)
            ],
        }
        for name in CONTROLLERS
    ]


def turbines(turbine: Any = None) -> list[dict[str, Any]]:
    """The catalog."""
    from wt_gym.turbines import catalog, load_turbine

    rows = []
    for name in catalog():
        found = load_turbine(name)
        power = found.drivetrain.rated_power
        size = f"{power / 1e6:.3g} MW" if power >= 1e5 else f"{power:.3g} W"
        rows.append({"name": name, "what": f"{found.name}: {size}, rotor {found.rotor_diameter:.4g} m"})
    return rows


def tasks(turbine: Any = None) -> list[dict[str, Any]]:
    """Tasks by id."""
    from wt_gym.tasks import TASKS

    return [{"name": task.id, "what": f"{task.goal} Score: {task.score}"} for task in TASKS.values()]


def channels(turbine: Any = None) -> list[dict[str, Any]]:
    """Signals of a simulation; those of the blades one by one."""
    from wt_gym.simulation import channel_table

    table = channel_table(3) if turbine is None else channel_table(turbine.n_blades, turbine.n_lines)
    return [
        {"name": channel.name, "what": f"[{channel.unit}] {channel.description}", "openfast": channel.openfast}
        for channel in table
    ]


def agents(turbine: Any = None) -> list[dict[str, Any]]:
    """Trained agents that come with the project."""
    from wt_gym.base.files import shipped_folder

    folder = shipped_folder() / "trained"
    found = sorted(path for path in folder.iterdir() if path.is_dir() and any(path.glob("*.zip")))
    return [{"name": path.name, "what": f"trained policy, {path}"} for path in found]


_TABLES = {
    "controllers": controllers, "turbines": turbines, "tasks": tasks, "channels": channels, "agents": agents,
}  # fmt: skip


def run(arguments: argparse.Namespace) -> dict[str, Any]:
    """Show the table, or give its rows."""
    from wt_gym.turbines import load_turbine

    rows = _TABLES[arguments.what](None if arguments.turbine is None else load_turbine(arguments.turbine))
    known = [row["name"] for row in rows]
    for name in arguments.names:
        if name not in known:
            raise ValueError(
                f"{arguments.what} must be among {', '.join(known)}; got {name!r}{did_you_mean(name, known)}"
            )
    rows = [row for row in rows if not arguments.names or row["name"] in arguments.names]
    if not arguments.json:
        _show(rows)
    return {arguments.what: rows}


def _show(rows: list[dict[str, Any]]) -> None:
    """Print rows as text."""
    out = sys.stdout
    if not any("parameters" in row for row in rows):
        width = max((len(row["name"]) for row in rows), default=0)
        for row in rows:
            out.write(f"{row['name']:{width}}  {row['what']}\n")
        return
    for row in rows:
        out.write(f"{row['name']} ({row['kind']}): {row['what']}\n")
        cells = [(p["name"], f"[{p['unit']}]", p["default"], p["meaning"]) for p in row["parameters"]]
        widths = [max(len(cell[k]) for cell in cells) for k in range(3)]
        for cell in cells:
            start = "  ".join(f"{text:{width}}" for text, width in zip(cell[:3], widths, strict=True))
            out.write(f"    {start}  {cell[3]}\n")
        out.write("\n")
