"""The rigid IEA 15-MW rotor up to light winds, where its least speed of 5 rpm is tip-speed ratios of 11 to 16.

Such a rotor is heavily loaded (thrust coefficients from 0.9 to 1.3): the annuli outboard are beyond the induction of
one half, where momentum theory is an empirical thrust, and wakes roll up within a diameter. So this compares what two
theories make of it. Up to a ratio of 11 the cheap fidelities, in the steps of the environments and at that least speed,
are held to the lattice with three turns of wake.
"""

from __future__ import annotations

import numpy as np

from validation.case import CaseResult, Check, Curve, Figure, case
from validation.nrel5mw_rotor import POWER_TOLERANCE, THRUST_TOLERANCE, wake_options
from validation.rigid_rotor import RigidRotor
from wt_gym.simulation import FIDELITIES
from wt_gym.turbines import load_turbine
from wt_gym.turbines.blade_element import BladeElementRotor, blade_element

TIP_SPEED_RATIOS, WIND, TURNS = (8.0, 9.0, 11.0, 13.0, 16.0), 5.0, 12.0
CHEAP, HIGHEST_RATIO, CHEAP_TOLERANCE = ("training", "engineering"), 11.0, 0.02
LEAST_SPEED = 5.0 * 2.0 * np.pi / 60.0
"""Of the rotor in operation [rad/s]: there a step is the smallest part of a turn."""
BLADE_ELEMENTS = "blade-element momentum theory with the same polars, Prandtl's and Buhl's corrections"
LATTICE = "lattice with three turns of wake before its closure"


@case(
    "iea-15mw-rotor",
    "Cp and Ct of the rigid IEA 15-MW rotor at tip-speed ratios 8 to 16",
    "blade-element momentum theory; NREL/TP-5000-75698 (largest Cp 0.489 at 9)",
    slow=True,
)
def iea15mw_rotor() -> CaseResult:
    """Blade elements, a lattice with three turns of wake, and the cheap fidelities in the environment's steps."""
    turbine = load_turbine("iea_15mw")
    element, rated = BladeElementRotor.of_turbine(turbine), turbine.drivetrain.rated_rotor_speed
    rows, checks = [], []
    for ratio in TIP_SPEED_RATIOS:
        speed = ratio * WIND / element.radius
        theory = blade_element(element, WIND, speed)
        lattice = _run(turbine, wake_options(3.0), speed, None)
        cheap = [
            _run(turbine, rung.aero_for(rated), speed, round(2.0 * np.pi / (LEAST_SPEED * rung.step_for(rated))))
            for rung in (FIDELITIES[name] for name in CHEAP)
        ]
        rows.append((ratio, *(x for found in (theory, lattice, *cheap) for x in (found.cp, found.ct))))
        checks += [
            Check(f"Cp at tip-speed ratio {ratio:g}", theory.cp, lattice.cp, POWER_TOLERANCE, source=BLADE_ELEMENTS),
            Check(f"Ct at tip-speed ratio {ratio:g}", theory.ct, lattice.ct, THRUST_TOLERANCE, source=BLADE_ELEMENTS),
        ]
        if ratio <= HIGHEST_RATIO:
            checks += [
                Check(f"{label} of {name} at tip-speed ratio {ratio:g}", due, found, CHEAP_TOLERANCE, source=LATTICE)
                for name, one in zip(CHEAP, cheap, strict=True)
                for label, due, found in (("Cp", lattice.cp, one.cp), ("Ct", lattice.ct, one.ct))
            ]
    table = np.array(rows)
    checks.append(Check("largest Cp", 0.489, table[:, 3].max(), 0.03, source="NREL/TP-5000-75698"))
    names = ("blade elements", "lattice, 3 turns of wake", *CHEAP)
    heading = " ratio" + "".join(f"{name:>27s}" for name in names)
    lines = [heading, "      " + f"{'Cp':>18s}{'Ct':>9s}" * len(names)]
    lines += [f"{row[0]:6g}" + "".join(f"{x:18.3f}{y:9.3f}" for x, y in row[1:].reshape(-1, 2)) for row in table]
    marks = ("--", "o", "s", "^")
    figures = {
        label: Figure(tuple(
            Curve(table[:, 0], table[:, 1 + column + 2 * k], name, mark)
            for k, (name, mark) in enumerate(zip(names, marks, strict=True))
        ), "tip-speed ratio", label)
        for column, label in enumerate(("Cp", "Ct"))
    }  # fmt: skip
    return CaseResult(checks, figures, "\n".join(lines))


def _run(turbine, options, speed, steps_per_turn):
    """Run of the rigid rotor without tilt."""
    return RigidRotor.of_turbine(turbine, options).run(options, WIND, speed, turns=TURNS, steps_per_turn=steps_per_turn)
