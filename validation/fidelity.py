"""What the cheap fidelities cost in accuracy: the coupled turbine at each of them against fidelity "reference".

The reference comes from the table of `validation.reference_runs`. Runs last until the wake of the start has left every
fidelity, and 320 s more in turbulence.
"""

from validation.case import CaseResult, Check, Curve, Figure, case
from validation.reference_runs import EXPERIMENTS, GAINS, QUANTITIES, conduct, recorded

RUNGS = ("training", "engineering")
GAIN_TOLERANCE = 0.015
TOLERANCES = {
    "generator_power": 0.015, "aero_thrust": 0.015, "flap_DEL": 0.08, "tower_fore_aft_DEL": 0.08,
    "tower_side_side_DEL": 0.08,
}  # fmt: skip
SOURCE = 'the same simulator at fidelity "reference": ten times the panels, three times the wake, every row free'


@case("gain-sweep", "Power against the gain of the torque law, 8 m/s steady and turbulent, coupled", SOURCE, slow=True)
def gain_sweep() -> CaseResult:
    """Mean aerodynamic power at four gains, absolute and relative to that of gain 1."""
    checks, figures, lines = [], {}, ["power of the air [kW] at gains " + ", ".join(f"{gain:g}" for gain in GAINS)]
    for wind in ("steady", "turbulent"):
        names = {gain: f"{wind}-gain-{gain}" for gain in GAINS}
        powers = {
            which: {gain: recorded(name, which)["aero_power"] for gain, name in names.items()}
            for which in ("reference", "open wake")
        }
        for rung in RUNGS:
            powers[rung] = {gain: conduct(EXPERIMENTS[name], rung)["aero_power"] for gain, name in names.items()}
            for gain, power in powers[rung].items():
                reference, text = powers["reference"], f"{rung}, {wind}, gain × {gain:g}"
                checks.append(Check(f"{text}: power", reference[gain], power, GAIN_TOLERANCE, "kW"))
                if gain != 1.0:
                    expected, found = reference[gain] / reference[1.0], power / powers[rung][1.0]
                    checks.append(Check(f"{text}: power over that of gain 1", expected, found, GAIN_TOLERANCE))
        for which, row in powers.items():
            values = " ".join(f"{power:8.1f} ({100 * (power / row[1.0] - 1):+5.1f} %)" for power in row.values())
            lines.append(f"{wind:10s}{which:12s}{values}")
        curves = (Curve(list(row), list(row.values()), which, "o-") for which, row in powers.items())
        figures[f"power, {wind} wind"] = Figure(tuple(curves), "gain over the published one", "power [kW]")
    return CaseResult(checks, figures, "\n".join(lines))


@case("turbulence-ladder", "Power and loads in turbulence, 8 and 12 m/s, two seeds, coupled", SOURCE, slow=True)
def turbulence_ladder() -> CaseResult:
    """Means and damage-equivalent loads under the baseline controller."""
    names = [name for name, experiment in EXPERIMENTS.items() if experiment.gain is None]
    checks = []
    lines = [f"{'':31s}" + "".join(f"{quantity:>20s}" for quantity in QUANTITIES),
             f"{'':31s}" + "".join(f"{unit:>20s}" for unit in QUANTITIES.values())]  # fmt: skip
    for name in names:
        reference = recorded(name)
        runs = {"open wake": recorded(name, "open wake")} | {rung: conduct(EXPERIMENTS[name], rung) for rung in RUNGS}
        lines.append(f"{name:16s}{'reference':15s}" + "".join(f"{reference[key]:20.4g}" for key in QUANTITIES))
        for which, run in runs.items():
            lines.append(f"{'':16s}{which:15s}" + "".join(_change(run[key], reference[key]) for key in QUANTITIES))
        checks += [
            Check(f"{rung}, {name}: {key}", reference[key], runs[rung][key], tolerance, QUANTITIES[key])
            for rung in RUNGS
            for key, tolerance in TOLERANCES.items()
        ]
    return CaseResult(checks, notes="\n".join(lines))


def _change(value, reference):
    """Difference in per cent, where there is something to compare with."""
    return f"{f'{100.0 * (value / reference - 1.0):+.1f} %' if reference else '':>20s}"
