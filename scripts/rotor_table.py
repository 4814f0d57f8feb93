#!/usr/bin/env python
"""Measure the table of power and thrust coefficients of a turbine, which controllers with a wind estimate read."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from wt_gym.control.rotor_measurement import measure_rotor
from wt_gym.turbines import load_turbine


def main() -> None:
    """Run."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("turbine", help="name in the catalogue or path of a windIO file")
    parser.add_argument("output", type=Path, help="JSON file to write")
    parser.add_argument("--fidelity", default="training")
    arguments = parser.parse_args()
    turbine = load_turbine(arguments.turbine)
    table = measure_rotor(
        turbine, arguments.fidelity, lambda done, count: print(f"{done} of {count} pitches", flush=True)
    )
    table.save(arguments.output)
    ratio, best = table.optimum
    print(f"{turbine.name}: Cp {best:.4f} at tip-speed ratio {ratio:.2f}; written to {arguments.output}")


if __name__ == "__main__":
    main()
