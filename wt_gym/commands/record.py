"""Record how turbines run in turbulence: from such records episodes start amid their operation.

    wt-gym record model.fst                 # a turbine of your own
    wt-gym record --package                 # the turbines of the catalog, in a clone of the project
    wt-gym record --package nrel_5mw

The turbine runs under its baseline controller, every 2 m/s from cut-in to cut-out, in 10 to 15 minutes on two cores;
the record stays in the user's cache (WT_GYM_CACHE). Episodes of a turbine without a record start at the operating point
of the wind. An interrupted command continues where it was, as long as program and turbine are the same.
"""

from __future__ import annotations

import argparse
import os
import re
import time
from collections.abc import Callable
from itertools import count
from typing import TYPE_CHECKING

from wt_gym.commands.options import add_shared
from wt_gym.commands.program import FIDELITIES_HELP, IN_CLONE

if TYPE_CHECKING:
    from wt_gym.envs.record_store import RecordedTurbine

STOPPED = "the runs that are done stay: the same command continues"


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    parser.add_argument(
        "turbines", nargs="*", metavar="TURBINE", help="windIO files and OpenFAST models; with --package records of it"
    )
    parser.add_argument("--floating", action="store_true", help="under floating feedback, for episodes under it")
    parser.add_argument("--package", action="store_true", help="make the records of the package")
    add_shared(
        parser, fidelity={"help": f"of the runs: {FIDELITIES_HELP} (default: by the blades)"},
        jobs={"default": 2, "help": "processes (default: %(default)s)"},
    )  # fmt: skip


def check(arguments: argparse.Namespace) -> None:
    """Refuse a call without records to make."""
    if arguments.package and not IN_CLONE:
        raise ValueError("--package needs a clone of the project")
    if arguments.package and arguments.floating:
        raise ValueError("--floating must be left out with --package, whose records have names of their own")
    if not (arguments.package or arguments.turbines):
        raise ValueError("TURBINE must name a file, or --package be there")


def run(arguments: argparse.Namespace) -> None:
    """Make the records."""
    os.environ["OMP_NUM_THREADS"] = "1"  # of the processes
    from wt_gym.base.canary import package_digest
    from wt_gym.envs.record_store import FOLDER, make_record, user_folder
    from wt_gym.experiment.execute import clock

    version = package_digest()[:16]
    records = _of_package(arguments.turbines) if arguments.package else _of_user(arguments)
    user = user_folder()
    if user is None:
        raise OSError("there is no cache of the user for records: set WT_GYM_CACHE to a folder")
    user.mkdir(parents=True, exist_ok=True)
    folder = FOLDER if arguments.package else user
    began = time.monotonic()
    for number, (name, recorded) in enumerate(records.items(), 1):
        path, pieces = folder / f"{name}.npz", user / "runs" / version / recorded.key
        make_record(recorded, path, pieces, arguments.jobs, _report(f"record {number}/{len(records)}, {name}"))
        size, passed = path.stat().st_size / 1e3, clock(time.monotonic() - began)
        print(f"{path}: {size:.0f} kB after {passed}", flush=True)


def _of_package(names: list[str]) -> dict[str, RecordedTurbine]:
    """Records of the package by name, all or some."""
    from wt_gym.envs.record_store import CATALOG

    records = {recorded.name: recorded for recorded in CATALOG}
    unknown = sorted(set(names) - set(records))
    if unknown:
        raise ValueError(f"TURBINE must be of {', '.join(records)}, got {', '.join(unknown)}")
    return {name: recorded for name, recorded in records.items() if name in names or not names}


def _of_user(arguments: argparse.Namespace) -> dict[str, RecordedTurbine]:
    """Records of the user's turbines, by names of files: turbines of one name have a file each."""
    from wt_gym.envs.record_store import RecordedTurbine, digest_of_turbine
    from wt_gym.turbines import load_turbine

    records, controller = {}, "floating" if arguments.floating else "discon"
    for path in arguments.turbines:
        turbine = load_turbine(path)
        name = re.sub(r"\W+", "_", turbine.name).strip("_").lower()
        file = f"{name}-{digest_of_turbine(turbine)}" + "-floating" * arguments.floating
        records[file] = RecordedTurbine(path, controller, fidelity=arguments.fidelity)
    return records


def _report(label: str) -> Callable[[int, int], None]:
    """Progress line of the finished runs and of all, with the time that is left by those that this process has made."""
    from wt_gym.experiment.execute import ProgressLine, clock

    line, began, made = ProgressLine(interval=30.0), time.monotonic(), count(1)

    def report(done: int, total: int) -> None:
        left = clock((time.monotonic() - began) / next(made) * (total - done))
        line.show(f"{label}: {done}/{total} runs, {left} left", final=done == total)

    return report
