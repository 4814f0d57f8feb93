"""The cheap fidelities against the reference: long runs of the coupled NREL 5-MW turbine in one wind each.

At fidelity "reference" a run takes as long as the wind blows. Its means are therefore kept in a table, with a
fingerprint of the turbine, the fidelity, the wind and the control that made them; a change of one of these needs a new
table:

    python -m envs_tests.physics.cases.fidelities                     # records, and which are out of date
    python -m envs_tests.physics.cases.fidelities --renew             # run what is missing or out of date again: hours
    python -m envs_tests.physics.cases.fidelities --renew NAME ...    # these, whatever their state
"""

from __future__ import annotations

import argparse
import csv
import dataclasses
import sys
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from envs_tests.physics.validation import DATA, CaseResult, Check, Curve, Figure, case
from wt_gym.aerodynamics import AeroOptions
from wt_gym.analysis.metrics import damage_equivalent_load
from wt_gym.simulation import Simulator
from wt_gym.simulation.contract import fingerprint
from wt_gym.simulation.fidelity import Fidelity, fidelity
from wt_gym.turbines import load_turbine
from wt_gym.wind import Inflow, SteadyInflow, TurbulenceBox, TurbulentInflow

if TYPE_CHECKING:
    from wt_gym.control.controllers.discon import BaselineParameters


TABLE = DATA / "reference_runs.csv"
HEADER = """\
# Means of the coupled NREL 5-MW turbine once the wake of the start has gone (cases/fidelities.py): at
# fidelity "reference", and beside it with 1 x 10 panels and 230 rows of wake, none thinned, and an open end. Made with
# python -m envs_tests.physics.cases.fidelities --renew
"""
TURBINE = "nrel_5mw"
CONTROL_DT = 0.2
SHEAR = 0.14
BOX_PERIOD = 600.0
GAINS = {0.4: 10.3, 0.7: 8.6, 1.0: 7.65, 1.4: 6.8}
"""Torque over the square of the generator speed, relative to the published one, and the tip-speed ratio near which the
rotor then settles (from its power coefficient), with which a run starts."""
QUANTITIES = {
    "rotor_speed": "rad/s", "aero_power": "kW", "generator_power": "kW", "power_deviation": "kW",
    "aero_thrust": "kN", "flap_DEL": "MN m", "tower_fore_aft_DEL": "MN m", "tower_side_side_DEL": "MN m",
    "pitch_travel": "deg",
}  # fmt: skip
OPEN_WAKE = Fidelity(
    "open wake",
    AeroOptions(n_chord=1, n_span=10, azimuth_step_deg=8.0, wake_rows=230, full_rows=230, fresh_rows=230,
                refresh_stride=1, wind_stride=1, far_wake=False, squire=2e-3),
)  # fmt: skip
"""A short wake of which nothing is thinned and that nothing continues: what a closure is to improve on."""
RECORDED = {"reference": fidelity("reference"), "open wake": OPEN_WAKE}


class StaleRecordError(LookupError):
    """A record is missing or was made with another turbine, fidelity, wind or control."""


@dataclass(frozen=True)
class Experiment:
    """One wind and one control.

    ``wind``: mean at hub height [m/s]; ``seed`` of the turbulence; None: steady and uniform; ``gain``: torque is this
    times the published gain times the square of the generator speed, at any speed, and the pitch stays 0; None: the
    baseline controller; ``duration``, ``skip`` of the run, and of its beginning that is left out: the wake of the start
    is then gone [s].
    """

    name: str
    wind: float
    seed: int | None
    gain: float | None
    duration: float
    skip: float

    def inflow(self) -> Inflow:
        """Wind of the run."""
        if self.seed is None:
            return SteadyInflow(self.wind)
        turbine = load_turbine(TURBINE)
        height, diameter = 90.0, turbine.rotor_diameter
        box = TurbulenceBox.kaimal(self.wind, height, diameter, seed=self.seed, duration=BOX_PERIOD)
        return TurbulentInflow(box, steady=SteadyInflow(self.wind, hub_height=height, shear_exponent=SHEAR))


EXPERIMENTS = {
    e.name: e
    for e in (
        *(Experiment(f"steady-gain-{gain}", 8.0, None, gain, 260.0, 140.0) for gain in GAINS),
        *(Experiment(f"turbulent-gain-{gain}", 8.0, 3, gain, 400.0, 80.0) for gain in GAINS),
        *(Experiment(f"{v:.0f}-m-s-seed-{seed}", v, seed, None, 400.0, 80.0) for v in (8.0, 12.0) for seed in (3, 5)),
    )
}


def conduct(experiment: Experiment, choice: str | Fidelity, save_to: Path | None = None) -> dict[str, float]:
    """Run an experiment and average it.

    ``save_to``: file (NetCDF) for all signals. Returns dict of `QUANTITIES`. Damage-equivalent loads at 1 Hz have the
    exponents 10 (mean of the blade roots) and 4 (tower).
    """
    from wt_gym.control.controllers.discon import BaselineParameters
    from wt_gym.experiment.run import run_baseline

    simulator = Simulator(TURBINE, inflow=experiment.inflow(), fidelity=choice)
    turbine = simulator.turbine
    start: dict[str, Any] = {}
    if experiment.gain is not None:
        law = BaselineParameters.from_turbine(turbine)
        radius = 0.5 * turbine.rotor_diameter
        speed = GAINS[experiment.gain] * experiment.wind / radius
        start = {"parameters": constant_gain(law, experiment.gain), "start": {"rotor_speed": speed}}
    run = run_baseline(simulator, experiment.duration, CONTROL_DT, **start).to_dataset()
    if save_to is not None:
        run.to_netcdf(save_to, engine="h5netcdf")
    run = run.isel(time=np.flatnonzero(run.time.values >= experiment.skip))
    span = experiment.duration - experiment.skip
    flap = [damage_equivalent_load(run[f"root_flap_moment_{b + 1}"].values, span, 10.0) for b in range(3)]
    return {
        "rotor_speed": float(run.rotor_speed.mean()),
        "aero_power": float(run.aero_power.mean()) / 1e3,
        "generator_power": float(run.generator_power.mean()) / 1e3,
        "power_deviation": float(run.generator_power.std()) / 1e3,
        "aero_thrust": float(run.aero_thrust.mean()) / 1e3,
        "flap_DEL": float(np.mean(flap)) / 1e6,
        "tower_fore_aft_DEL": damage_equivalent_load(run.tower_base_fore_aft_moment.values, span, 4.0) / 1e6,
        "tower_side_side_DEL": damage_equivalent_load(run.tower_base_side_side_moment.values, span, 4.0) / 1e6,
        "pitch_travel": float(np.degrees(np.abs(np.diff(run.pitch_1.values)).sum())),
    }


def constant_gain(law: BaselineParameters, gain: float) -> BaselineParameters:
    """Constants with which the baseline controller is T = gain K ω² at any speed, and never pitches.

    The regions beside region 2 are moved out of reach.
    """
    torque = replace(
        law.torque, cut_in_speed=1.0, region_2_speed=2.0, rated_generator_speed=1e4,
        region_2_gain=gain * law.torque.region_2_gain, rated_power=1e14,
    )  # fmt: skip
    return replace(law, torque=torque, reference_speed=1e4)


def stamp(experiment: Experiment, choice: str | Fidelity) -> str:
    """Fingerprint of all that decides the numbers of a run but the code; the same on any machine."""
    return _stamp(experiment, fidelity(choice))


@lru_cache
def _stamp(experiment: Experiment, choice: Fidelity) -> str:
    inflow = experiment.inflow()
    wind = [SHEAR, BOX_PERIOD, CONTROL_DT]
    if experiment.seed is not None:
        box = cast("TurbulentInflow", inflow).box
        samples = box.scale * box.fluctuation[:, ::4, ::4]
        wind += [float(samples.std()), float(np.diff(samples, axis=0).std()), float(np.abs(samples).max())]
    return fingerprint(*(_rounded(part, 5) for part in (experiment, wind)),
                       *(_rounded(part, 9) for part in (load_turbine(TURBINE), choice)))[:12]  # fmt: skip


def _rounded(value: Any, digits: int) -> Any:
    """The same nested value with every float written to some digits: the last ones differ between machines."""
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return tuple((f.name, _rounded(getattr(value, f.name), digits)) for f in dataclasses.fields(value))
    if isinstance(value, np.ndarray):
        return tuple(_rounded(item, digits) for item in value.tolist())
    if isinstance(value, (tuple, list)):
        return tuple(_rounded(item, digits) for item in value)
    return f"{value:.{digits}g}" if isinstance(value, float) else value


def read_records() -> dict[tuple[str, str], dict[str, str]]:
    """Rows of the table by experiment and fidelity."""
    if not TABLE.exists():
        return {}
    lines = [line for line in TABLE.read_text(encoding="utf-8").splitlines() if not line.startswith("#")]
    return {(row["experiment"], row["fidelity"]): row for row in csv.DictReader(lines)}


def recorded(name: str, which: str = "reference") -> dict[str, float]:
    """Means of an experiment from the table.

    Raises `StaleRecordError` if there is none, or it was made with something else than what is there now.
    """
    row = read_records().get((name, which))
    if row is not None and row["stamp"] == stamp(EXPERIMENTS[name], RECORDED[which]):
        return {quantity: float(row[quantity]) for quantity in QUANTITIES}
    problem = "is missing" if row is None else "was made with another turbine, fidelity, wind or control"
    raise StaleRecordError(
        f"the record of {name} at fidelity {which!r} in {TABLE.name} {problem}; "
        f"renew it: python -m envs_tests.physics.cases.fidelities --renew {name}"
    )


def renew(name: str, which: str, save_to: Path | None = None) -> dict[str, float]:
    """Run an experiment and put its means into the table."""
    experiment, choice = EXPERIMENTS[name], RECORDED[which]
    means = conduct(experiment, choice, save_to)
    rows = read_records()  # again: others may have written meanwhile
    row = {"experiment": name, "fidelity": which, "stamp": stamp(experiment, choice)}
    rows[name, which] = row | {quantity: f"{value:.6g}" for quantity, value in means.items()}
    order = [key for e in EXPERIMENTS for f in RECORDED if (key := (e, f)) in rows]
    columns = ("experiment", "fidelity", "stamp", *QUANTITIES)
    lines = [",".join(columns), *(",".join(rows[key][column] for column in columns) for key in order)]
    TABLE.write_text(HEADER + "\n".join(lines) + "\n", encoding="utf-8")
    return means


def main(arguments: Sequence[str] | None = None) -> int:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--renew", action="store_true", help="run what is missing or out of date, or what is named")
    parser.add_argument("--fidelity", choices=tuple(RECORDED), help="only records of this fidelity")
    parser.add_argument("--save", type=Path, metavar="DIR", help="write all signals of the runs to DIR")
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"of {', '.join(EXPERIMENTS)}")
    options = parser.parse_args(arguments)
    unknown = [name for name in options.names if name not in EXPERIMENTS]
    if unknown:
        parser.error(f"unknown experiment {', '.join(unknown)}; must be one of {', '.join(EXPERIMENTS)}")
    stale = 0
    for name in options.names or EXPERIMENTS:
        for which in [options.fidelity] if options.fidelity else RECORDED:
            try:
                state = f"power {recorded(name, which)['aero_power']:.1f} kW"
                wanted = bool(options.names)
            except StaleRecordError as error:
                state, wanted = str(error), True
                stale += not options.renew
            if options.renew and wanted:
                path = options.save and options.save / f"{name}-{which.replace(' ', '-')}.nc"
                state = f"renewed: power {renew(name, which, path)['aero_power']:.1f} kW"
            print(f"{name:24s}{which:12s}{state}", flush=True)
    return int(stale > 0)


# ---- comparison -----------------------------------------------------------------------------------------------------
# The reference comes from the table. Runs last until the wake of the start has left
# every fidelity, and 320 s more in turbulence.

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


if __name__ == "__main__":
    sys.exit(main())
