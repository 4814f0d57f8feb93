"""Convergence of the lattice of a rigid rotor, and the cheap fidelities against it."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from envs_tests.physics.cases.rotor import RigidRotor, UniformWind, turn, vertex, wake_options
from envs_tests.physics.validation import DATA, CaseResult, Check, Curve, Figure, absolute, case, read_table
from wt_gym.aerodynamics import AeroOptions, VortexLattice
from wt_gym.simulation.fidelity import FIDELITIES
from wt_gym.turbines import load_turbine

if TYPE_CHECKING:
    from envs_tests.physics.cases.rotor import RotorRun


# ---- panels, steps and wake -----------------------------------------------------------------------------------------

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


# ---- a converged lattice --------------------------------------------------------------------------------------------
# The converged lattice has a free wake with an open end: nothing continues it, merges its rows or leaves them without a
# new velocity in a step, so that it rests on no model of the far wake. What its length, panels and time step leave is
# extrapolated. `python -m envs_tests.physics.cases.rotor_convergence` makes the table again.

RATIOS = (5.0, 6.0, 7.0, 7.55, 8.0, 9.0, 10.0, 11.0)
TABLE = "nrel5mw_converged.csv"
HEADER = """\
# Cp and Ct of the rigid NREL 5-MW rotor (cone 2.5 deg, no tilt, pitch 0, 8 m/s, polars fed back) on a free-wake
# lattice, extrapolated in the length of the wake, the panels and the time step, and how uncertain they are. Made with
# python -m envs_tests.physics.cases.rotor_convergence
"""
RUNGS = ("training", "engineering")
TOLERANCE, OPTIMUM_TOLERANCE = 0.02, 0.5
WAKE_SETTLES = 90.0
"""Time after which the wake of the start has gone [s]; the mean of the last `MEAN_TURNS` is taken."""
MEAN_TURNS = 4
LIFTING_LINE = {7.55: (0.503, 0.006), 10.0: (0.478, 0.008)}
"""Cp of an independent free-wake lifting line with the drag of the polars, and how uncertain it is.

Corrected at the tip, where its last two nodes (r > 62.5 m) carried an extrapolated circulation instead of one that
falls to zero (worth 1.2 % of Cp with 31 nodes, 4.3 % with 19), and extrapolated in the length of its open wake.
"""


# ---- the converged lattice ----


def open_wake(ratio, turns, run_turns, n_span=10, n_chord=1, steps=30):
    """Cp and Ct with some turns of free wake and an open end, mean of the last `MEAN_TURNS` of ``run_turns`` turns."""
    rows = turns * steps
    options = AeroOptions(
        n_chord=n_chord, n_span=n_span, azimuth_step_deg=360.0 / steps, wake_rows=rows, full_rows=rows, fresh_rows=rows,
        far_wake=False, squire=1e-3, induction="tree", tree_tolerance=3e-3,
    )  # fmt: skip
    rotor = RigidRotor.of_turbine(load_turbine("nrel_5mw"), options)
    return means(rotor.run(options, WIND, ratio * WIND / rotor.radius, 0.0, run_turns))


def means(run):
    """Cp and Ct of a run, mean of the last `MEAN_TURNS`."""
    last = slice(-MEAN_TURNS * run.steps_per_turn, None)
    return np.array([run.power[last].mean() / run.reference_power, run.thrust[last].mean() / run.reference_thrust])


def converged(ratio):
    """Cp and Ct of the converged lattice, and how uncertain they are, each of shape (2,).

    Wake: 12 and 24 turns of 1 x 10 panels and 30 steps a turn. What an open end leaves out of the induction falls with
    the square of its distance, so that a third of the last step is still to come. Panels and steps: differences with 6
    turns of wake, which are those of 12 turns within 0.2 %; what they leave is taken to fall with the square of the
    refinement. The uncertainty is all that is extrapolated, and 0.5 %: those 0.2 %, and the wandering of the means,
    since the wake of a heavily loaded rotor loses its order.
    """
    short, long = open_wake(ratio, 12, 18), open_wake(ratio, 24, 32)
    coarse = open_wake(ratio, 6, 10)
    finer = {"n_span": (10, 24), "steps": (30, 60), "n_chord": (1, 3)}
    value, rest = long, [(long - short) / 3.0]
    for name, (few, many) in finer.items():
        change = open_wake(ratio, 6, 10, **{name: many}) - coarse
        value = value + change
        rest.append(change / ((many / few) ** 2 - 1.0))
    return value + sum(rest), np.abs(rest).sum(axis=0) + 0.005 * value


def converged_table():
    """Rows of the table: tip-speed ratio, Cp, Ct and their uncertainties.

    Raises `FileNotFoundError` if the table has not been made.
    """
    if not (DATA / TABLE).exists():
        raise FileNotFoundError(f"{TABLE} is not there; make it: python -m envs_tests.physics.cases.rotor_convergence")
    return read_table(TABLE)[0]


def write_table() -> None:
    """Compute the converged lattice at all tip-speed ratios and write the table."""
    rows = []
    for ratio in RATIOS:
        (cp, ct), (cp_error, ct_error) = converged(ratio)
        rows.append(f"{ratio:g},{cp:.4f},{ct:.4f},{cp_error:.4f},{ct_error:.4f}")
        print(rows[-1], flush=True)
    heading = "tip_speed_ratio,Cp,Ct,Cp_uncertainty,Ct_uncertainty\n"
    (DATA / TABLE).write_text(HEADER + heading + "\n".join(rows) + "\n", encoding="utf-8")


@case(
    "converged-rotor",
    "Rigid NREL 5-MW rotor with 24 turns of free wake and an open end, extrapolated",
    "independent free-wake lifting line",
    slow=True,
)
def converged_rotor() -> CaseResult:
    """The table against a lifting line; computed again at one ratio, against the table."""
    table = converged_table()
    checks = []
    for ratio, (cp, uncertain) in LIFTING_LINE.items():
        row = table[table[:, 0] == ratio][0]
        name = f"Cp of the table, tip-speed ratio {ratio:g}"
        checks += [
            Check(name, cp, row[1], 0.02, source="lifting line"),
            Check(f"{name}, within the uncertainties of both", cp, row[1], absolute(uncertain + float(row[3])), "",
                  source=f"lifting line ± {uncertain:g}, table ± {row[3]:g}"),
        ]  # fmt: skip
    value, _ = converged(7.55)
    row = table[table[:, 0] == 7.55][0]
    checks += [
        Check(f"{name} at 7.55, computed again", row[k], value[k - 1], absolute(row[k + 2]), "", source="table")
        for k, name in ((1, "Cp"), (2, "Ct"))
    ]
    return CaseResult(checks)


# ---- the fidelities ----


def settled_rung(rung, ratio, steps_per_turn=None):
    """Cp and Ct of the rigid rotor with the lattice and wake of a fidelity, settled."""
    turbine = load_turbine("nrel_5mw")
    options = FIDELITIES[rung].aero_for(turbine.drivetrain.rated_rotor_speed)
    rotor = RigidRotor.of_turbine(turbine, options)
    speed = ratio * WIND / rotor.radius
    return means(
        rotor.run(options, WIND, speed, 0.0, WAKE_SETTLES * speed / (2.0 * np.pi), steps_per_turn=steps_per_turn)
    )


@case(
    "power-curve-ladder",
    "Cp and Ct of the rigid NREL 5-MW rotor at the cheap fidelities, tip-speed ratios 5 to 11",
    "the converged lattice, case converged-rotor",
    slow=True,
)
def power_curve_ladder() -> CaseResult:
    """Coefficients and the place of the largest Cp, with the time step of the simulator at 8 m/s and at rated speed."""
    table = converged_table()
    optimum = vertex(table[:, 0], table[:, 1])
    turbine = load_turbine("nrel_5mw")
    curves: dict[str, list[Curve]] = {"Cp": [], "Ct": []}
    checks, lines = [], [f"{'':34s}" + "".join(f"{ratio:>16g}" for ratio in table[:, 0])]
    lines.append(f"{'converged lattice':34s}" + "".join(f"{cp:9.4f}{ct:7.3f}" for cp, ct in table[:, 1:3]))
    for rung in RUNGS:
        azimuth = FIDELITIES[rung].aero.azimuth_step_deg
        step = FIDELITIES[rung].step_for(turbine.drivetrain.rated_rotor_speed)
        for text, in_simulator in ((f"{WIND:g} m/s", True), (f"{azimuth:g} deg a step", False)):
            # in the simulator, the time step is one
            turn = 2.0 * np.pi / (table[:, 0] * WIND / (0.5 * turbine.rotor_diameter)) / step
            steps = [round(n) if in_simulator else None for n in turn]
            found = np.array([settled_rung(rung, ratio, n) for ratio, n in zip(table[:, 0], steps, strict=True)])
            for k, name in enumerate(("Cp", "Ct")):
                checks += [
                    Check(f"{rung}, {text}: {name} at {row[0]:g}", row[1 + k], value, TOLERANCE)
                    for row, value in zip(table, found[:, k], strict=True)
                ]
                curves[name].append(Curve(table[:, 0], found[:, k], f"{rung}, {text}", "o-"))
            place = vertex(table[:, 0], found[:, 0])
            checks.append(
                Check(f"{rung}, {text}: ratio of the largest Cp", optimum, place, absolute(OPTIMUM_TOLERANCE), "")
            )
            changes = 100.0 * (found / table[:, 1:3] - 1.0)
            lines.append(f"{f'{rung}, {text}':34s}" + "".join(f"{cp:+7.1f}%{ct:+7.1f}%" for cp, ct in changes))
    figures = {
        name: Figure(
            (Curve(table[:, 0], table[:, 1 + k], "converged lattice", "k--"), *curves[name]), "tip-speed ratio", name
        )
        for k, name in enumerate(("Cp", "Ct"))
    }
    return CaseResult(checks, figures, "\n".join(lines))


# ---- fast pitch -----------------------------------------------------------------------------------------------------

WINDS = {8.0: 7.55, 11.4: 7.0}
"""Wind [m/s] and tip-speed ratio, which is held."""
RATE, ANGLE = np.radians(8.0), np.radians(10.0)
SETTLE, HOLD = 25.0, 12.0
"""Time before the ramp, and after each ramp [s]."""


def ramps(time):
    """Pitch [rad]: 0, up to `ANGLE` at `RATE`, and back after `HOLD`."""
    up, down = RATE * (time - SETTLE), ANGLE - RATE * (time - SETTLE - ANGLE / RATE - HOLD)
    return min(max(up, 0.0), ANGLE, max(down, 0.0))


def ramp_run(options, rung, wind):
    """Time [s], thrust [N] and torque [N m] of the rigid rotor at the time step that the rung has in the simulator."""
    turbine = load_turbine("nrel_5mw")
    rotor = RigidRotor.of_turbine(turbine, options)
    speed = WINDS[wind] * wind / rotor.radius
    dt = FIDELITIES[rung].step_for(turbine.drivetrain.rated_rotor_speed)
    n_steps = round((SETTLE + 2.0 * (ANGLE / RATE + HOLD)) / dt)
    steps = rotor.march(options, UniformWind(wind), speed, ramps, dt, n_steps)
    return np.array([(step.time, step.thrust, step.torque) for step in steps]).T


@case(
    "pitch-ramp",
    "Rigid NREL 5-MW rotor pitched at 8 deg/s to 10 deg and back: rows in turn against all rows in every step",
    "the same lattice with every row of the wake computed anew in every step",
    quick=False,
)
def pitch_ramp() -> CaseResult:
    """Largest difference at any instant from the ramp on, over the change that the first ramp makes."""
    checks, figures, lines = [], {}, []
    rated_speed = load_turbine("nrel_5mw").drivetrain.rated_rotor_speed
    for rung in RUNGS:
        options = FIDELITIES[rung].aero_for(rated_speed)
        every = replace(options, fresh_rows=options.wake_rows, refresh_stride=1)
        for wind in WINDS:
            time, *found = ramp_run(options, rung, wind)
            _, *expected = ramp_run(every, rung, wind)
            before, after = time < SETTLE, time >= SETTLE
            for name, obtained, exact in zip(("thrust", "torque"), found, expected, strict=True):
                change = exact[before][-1] - exact[after].min()
                error = np.abs(obtained - exact)[after] / change
                checks.append(Check(f"{rung}, {wind:g} m/s: largest error of {name} over its change", f"<= {TOLERANCE}",
                                    error.max(), source="every row in every step"))  # fmt: skip
                lines.append(
                    f"{rung:12s} {wind:5g} m/s {name}: change {change:.4g}, largest error {100 * error.max():.2f} % at "
                    f"{time[after][error.argmax()] - SETTLE:.1f} s, rms {100 * np.sqrt((error**2).mean()):.2f} %; "
                    f"before the ramp {100 * (obtained[before][-1] / exact[before][-1] - 1):+.2f} %"
                )
                figures[f"{name}, {rung}, {wind:g} m/s"] = Figure((
                    Curve(time[after] - SETTLE, exact[after], "every row in every step", "--"),
                    Curve(time[after] - SETTLE, obtained[after], rung),
                ), "time [s]", name)  # fmt: skip
    return CaseResult(checks, figures, "\n".join(lines))


if __name__ == "__main__":
    write_table()
