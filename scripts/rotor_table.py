#!/usr/bin/env python3
"""Measure the table of power and thrust coefficients of a turbine, which controllers with a wind estimate read."""

from __future__ import annotations

import argparse
from pathlib import Path

import use_venv  # noqa: F401 - finds packages and interpreter

from wt_gym.commands.program import FIDELITIES_HELP
from wt_gym.control.rotor_measurement import measure_rotor
from wt_gym.turbine_records import FOLDER, RECORDS
from wt_gym.turbines import load_turbine


def main() -> None:
    """Run."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("turbine", help="name in the catalogue or path of a windIO file")
    places = parser.add_mutually_exclusive_group(required=True)
    places.add_argument("output", type=Path, nargs="?", help="JSON file to write")
    places.add_argument("--record", action="store_true", help="write into the record of a turbine of the catalogue")
    parser.add_argument("--fidelity", help=FIDELITIES_HELP)
    arguments = parser.parse_args()
    if arguments.record and arguments.turbine not in RECORDS:
        parser.error(f"--record needs a name of the catalogue ({', '.join(RECORDS)}), got {arguments.turbine!r}")
    turbine = load_turbine(arguments.turbine)
    table = measure_rotor(
        turbine, arguments.fidelity, lambda done, count: print(f"{done} of {count} pitches", flush=True)
    )
    if arguments.record:
        arguments.output = FOLDER / f"{arguments.turbine}.json"
        table.put_into(arguments.output)
    else:
        table.save(arguments.output)
    ratio, best = table.optimum
    print(f"{turbine.name}: Cp {best:.4f} at tip-speed ratio {ratio:.2f}; written to {arguments.output}")


if __name__ == "__main__":
    main()
