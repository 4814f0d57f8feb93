"""Convergence of the rigid NREL 5-MW rotor: span, chord, time step, length of the wake and its closure."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from validation.case import CaseResult, Check, Curve, Figure, case
from validation.nrel5mw_rotor import wake_options
from validation.rigid_rotor import RigidRotor, UniformWind, turn
from wt_gym.aerodynamics import VortexLattice
from wt_gym.turbines import load_turbine

if TYPE_CHECKING:
    from validation.rigid_rotor import RotorRun


WIND, ROTOR_SPEED = 8.0, 9.15 * np.pi / 30.0
"""[m/s], [rad/s]; pitch 0, tip-speed ratio 7.55."""
BASE = {"turns": 3.0, "steps_per_turn": 30, "n_span": 12, "n_chord": 1}
"""From here one choice at a time is refined."""
SPANS, CHORDS, STEPS = (8, 12, 16, 24), (1, 2, 4), (20, 30, 45, 60)
OPEN_WAKES, CLOSED_WAKES = (3, 6, 12, 24), (1.5, 3, 6)
"""Turns of wake without and with continuation by vortex cylinders."""
CLOSURE_TOLERANCE = 0.01
HELIX = {3: 0.590, 6: 0.560, 12: 0.550, 24: 0.548}
"""Cp with 3, 6, 12 and 24 turns of rigid prescribed helix, 12 × 1 panels, steps of 10 deg, tip-speed ratio 7.55, no
drag: an independent lattice. Its helix and section geometry are not known, so that only ratios are compared."""
BETZ_INDUCTION = 1.0 / 3.0
"""Induction with which the rigid helix is carried away."""


def settled(**changes):
    """Run of the rotor with the base choices changed, until the wake has settled.

    The start is a helix in momentum balance; its error is gone when the wake has been shed anew once, and the ends of
    long wakes without continuation matter little for the blades.
    """
    choice = BASE | changes
    turns = choice["turns"]
    options = wake_options(**choice)
    rotor = RigidRotor.of_turbine(load_turbine("nrel_5mw"), options)
    return rotor.run(options, WIND, ROTOR_SPEED, 0.0, turns + 7.0 if turns <= 6 else 0.6 * turns + 6.0)


@case(
    "nrel-5mw-convergence",
    "Convergence of Cp and Ct of the rigid NREL 5-MW rotor in span, chord, time step and wake length",
    "the finest lattice and the longest wake of each row",
    slow=True,
)
def nrel_5mw_convergence() -> CaseResult:
    """One choice refined at a time; the last refinement changes the coefficients by no more than the tolerance."""
    base = settled()
    studies: dict[str, list[tuple[float, RotorRun]]] = {
        "strips along the span": [(n, base if n == 12 else settled(n_span=n)) for n in SPANS],
        "panels along the chord": [(n, base if n == 1 else settled(n_chord=n)) for n in CHORDS],
        "steps a turn": [(n, base if n == 30 else settled(steps_per_turn=n)) for n in STEPS],
        "turns of wake, continued": [(n, base if n == 3 else settled(turns=n)) for n in CLOSED_WAKES],
        "turns of wake, open end": [(n, settled(turns=n, closure=False)) for n in OPEN_WAKES],
    }
    checks, lines = [], ["Cp and Ct at 8 m/s, 9.15 rpm, pitch 0; change against the last of each row"]
    tolerances = {"panels along the chord": 0.005}
    for name, rows in studies.items():
        (_, last), (value, before) = rows[-1], rows[-2]
        tolerance = tolerances.get(name, 0.01)
        for quantity in ("cp", "ct"):
            expected, found = getattr(last, quantity), getattr(before, quantity)
            text = f"{quantity.capitalize()} with {value:g} {name} against {rows[-1][0]:g}"
            checks.append(Check(text, expected, found, tolerance, source="finest of the row"))
        for value, run in rows:
            lines.append(
                f"{name:>26s}{value:5g}   Cp {run.cp:.4f} {100 * (run.cp / last.cp - 1):+6.2f} %   "
                f"Ct {run.ct:.4f} {100 * (run.ct / last.ct - 1):+6.2f} %   last turn {100 * run.drift:+5.2f} %"
            )
    longest = studies["turns of wake, open end"][-1][1]
    for quantity in ("cp", "ct"):
        text = f"{quantity.capitalize()} with 3 turns of wake continued against 24 turns with an open end"
        expected = getattr(longest, quantity)
        checks.append(Check(text, expected, getattr(base, quantity), CLOSURE_TOLERANCE, source="longest wake"))
    figures = {
        f"{label} against {name}": Figure(
            (Curve([n for n, _ in rows], [getattr(run, quantity) for _, run in rows], label, "o-"),), name, label
        )
        for name, rows in studies.items()
        for quantity, label in (("cp", "Cp"), ("ct", "Ct"))
        if "turns" not in name
    }
    for quantity, label in (("cp", "Cp"), ("ct", "Ct")):
        figures[f"{label} against the length of the wake"] = Figure(tuple(
            Curve([n for n, _ in rows], [getattr(run, quantity) for _, run in rows], name, "o-")
            for name, rows in studies.items() if "turns" in name
        ), "turns", label, log_x=True)  # fmt: skip
    lines.append("Base: 1 × 12 panels, 30 steps a turn, 3 turns of free wake continued by vortex cylinders.")
    return CaseResult(checks, figures, "\n".join(lines))


def rigid_helix(turns, steps_per_turn=36, closure=False):
    """Cp without drag of the rotor in front of a rigid helical wake of some turns."""
    options = replace(
        wake_options(turns, steps_per_turn, 12), viscous=False, far_wake=closure, fresh_rows=0, refresh_stride=1000
    )
    rotor = RigidRotor.of_turbine(load_turbine("nrel_5mw"), options)
    lattice, inflow = VortexLattice(rotor.planform, rotor.n_blades, options, rotor.air_density), UniformWind(WIND)
    state = lattice.new_state()
    nodes, velocities = rotor.motion(0.0, ROTOR_SPEED, 0.0)
    ages = (np.arange(options.wake_rows) + options.shed_fraction) * 2.0 * np.pi / ROTOR_SPEED / steps_per_turn
    edge = 0.25 * nodes[:, -2] + 0.75 * nodes[:, -1]
    drift = np.array([WIND * (1.0 - BETZ_INDUCTION), 0.0, 0.0])
    wake = np.array([edge @ turn("x", -ROTOR_SPEED * age).T + drift * age for age in ages])
    lattice.initialize_wake(state, nodes, velocities, inflow.velocity(nodes, 0.0), wake, ages, far_wake=closure)
    power = (state.nodal_forces * velocities).sum()
    return float(power / (0.5 * rotor.air_density * np.pi * rotor.radius**2 * WIND**3))


@case(
    "rigid-helix",
    "Cp of the NREL 5-MW rotor in front of 3 to 24 turns of rigid helix, and the closure of a short one",
    "independent lattice, 12 × 1 panels, 10 deg steps",
)
def rigid_helix_length() -> CaseResult:
    """Cp relative to 24 turns; a short wake continued by vortex cylinders against 24 turns."""
    open_end = {turns: rigid_helix(turns) for turns in HELIX}
    source = "independent lattice with a rigid helix"
    checks = [
        Check(
            f"Cp with {n} turns over Cp with 24", HELIX[n] / HELIX[24], open_end[n] / open_end[24], 0.005, source=source
        )
        for n in (3, 6, 12)
    ]
    closed = {turns: rigid_helix(turns, closure=True) for turns in (1.5, 3, 6)}
    checks += [
        Check(f"Cp with {n} turns continued by vortex cylinders", open_end[24], closed[n], CLOSURE_TOLERANCE,
              source="24 turns")
        for n in (3, 6)
    ]  # fmt: skip
    figure = Figure((
        Curve(list(HELIX), list(HELIX.values()), "independent lattice", "s--"),
        Curve(list(open_end), list(open_end.values()), "open end", "o-"),
        Curve(list(closed), list(closed.values()), "continued by vortex cylinders", "^-"),
    ), "turns of rigid helix", "Cp without drag", log_x=True)  # fmt: skip
    notes = "Cp open: " + ", ".join(f"{n} turns {cp:.4f}" for n, cp in open_end.items())
    notes += "; continued: " + ", ".join(f"{n:g} turns {cp:.4f}" for n, cp in closed.items())
    return CaseResult(checks, {"Cp against the length of a rigid wake": figure}, notes)
