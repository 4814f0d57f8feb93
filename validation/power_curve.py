"""Cp and Ct of the rigid NREL 5-MW rotor against tip-speed ratio: a converged lattice, and the fidelities against it.

The converged lattice has a free wake with an open end: nothing continues it, merges its rows or leaves them without a
new velocity in a step, so that it rests on no model of the far wake. What its length, panels and time step leave is
extrapolated. `python -m validation.power_curve` makes the table again.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from validation.case import CaseResult, Check, Curve, Figure, absolute, case
from validation.nrel5mw_rotor import vertex
from validation.rigid_rotor import RigidRotor
from validation.tree_tools import read_table
from wt_gym.aerodynamics import AeroOptions
from wt_gym.simulation.fidelity import FIDELITIES
from wt_gym.turbines import load_turbine

WIND = 8.0
RATIOS = (5.0, 6.0, 7.0, 7.55, 8.0, 9.0, 10.0, 11.0)
DATA = Path(__file__).parent / "data"
TABLE = "nrel5mw_converged.csv"
HEADER = """\
# Cp and Ct of the rigid NREL 5-MW rotor (cone 2.5 deg, no tilt, pitch 0, 8 m/s, polars fed back) on a free-wake
# lattice, extrapolated in the length of the wake, the panels and the time step, and how uncertain they are. Made with
# python -m validation.power_curve
"""
RUNGS = ("training", "engineering")
TOLERANCE, OPTIMUM_TOLERANCE = 0.02, 0.5
SETTLE = 90.0
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

    Raises
    ------
    FileNotFoundError
        If the table has not been made.
    """
    if not (DATA / TABLE).exists():
        raise FileNotFoundError(f"{TABLE} is not there; make it: python -m validation.power_curve")
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


def settled(rung, ratio, steps_per_turn=None):
    """Cp and Ct of the rigid rotor with the lattice and wake of a fidelity, settled."""
    turbine = load_turbine("nrel_5mw")
    options = FIDELITIES[rung].aero_for(turbine.drivetrain.rated_rotor_speed)
    rotor = RigidRotor.of_turbine(turbine, options)
    speed = ratio * WIND / rotor.radius
    return means(rotor.run(options, WIND, speed, 0.0, SETTLE * speed / (2.0 * np.pi), steps_per_turn=steps_per_turn))


def steps_in_simulator(rung, ratio):
    """Steps in a turn at `WIND` with the time step that the coupled simulator has."""
    turbine = load_turbine("nrel_5mw")
    step = FIDELITIES[rung].step_for(turbine.drivetrain.rated_rotor_speed)
    return round(2.0 * np.pi / (ratio * WIND / (0.5 * turbine.rotor_diameter)) / step)


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
    curves: dict[str, list[Curve]] = {"Cp": [], "Ct": []}
    checks, lines = [], [f"{'':34s}" + "".join(f"{ratio:>16g}" for ratio in table[:, 0])]
    lines.append(f"{'converged lattice':34s}" + "".join(f"{cp:9.4f}{ct:7.3f}" for cp, ct in table[:, 1:3]))
    for rung in RUNGS:
        azimuth = FIDELITIES[rung].aero.azimuth_step_deg
        for text, in_simulator in ((f"{WIND:g} m/s", True), (f"{azimuth:g} deg a step", False)):
            steps = [steps_in_simulator(rung, ratio) if in_simulator else None for ratio in table[:, 0]]
            found = np.array([settled(rung, ratio, n) for ratio, n in zip(table[:, 0], steps, strict=True)])
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


if __name__ == "__main__":
    write_table()
