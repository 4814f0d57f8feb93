"""Everything of Gebhardt, Preidikman, Jørgensen & Massa 2012 at once: the fidelity "gebhardt-full".

Free blades with quaternions held by multipliers, 22 nodes a blade, wakes from trailing edges and tips, tower and
nacelle as closed bodies that move with the structure and load the tower, the ground; in the paper's two winds. The same
statements are asked of it as of the leaner configuration (`validation.gebhardt_results`).
"""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np

from validation.case import CaseResult, Check, Curve, Figure, case
from validation.gebhardt_results import (
    GEBHARDT,
    LATTICE,
    RPM,
    blade_statements,
    figures,
    make_simulator,
    operating_points,
    overview,
    published,
    simulate,
    solved,
    tower_statements,
)
from validation.gebhardt_sensitivity import balance
from wt_gym.simulation import Simulator

FULL = "gebhardt-full"
PITCHES = (-5.0, 0.0, 3.0, 6.0, 9.0, 12.5)
"""Of the torque of Bernoulli's loads [deg]."""


@case("gebhardt-2012-full", "45 m / 68 m turbine, everything together: Figures 1–10", GEBHARDT, slow=True)
def everything() -> CaseResult:
    """Reference wind at the gradient height, all parts of the model at once."""
    pitch, low, high = solved(None, LATTICE, FULL)
    rpm = published(15.0)[0]
    floating = make_simulator(15.0, rpm, None, "embedded", gravity=False, fidelity=FULL)
    weightless = simulate(floating, pitch, 5.0, rpm * RPM)
    blades = blade_statements(low, high, weightless, pitch)
    checks = [*operating_points(low, high), *tower_statements(low, high), *blades]
    return CaseResult(checks, figures(low, high), "\n".join([*overview(pitch, low, high), *without_suction()]))


def without_suction():
    """Torque of the air over that of the generator at the published point, with Bernoulli's loads: lines of text."""
    rpm = published(15.0)[0]
    lattice = replace(LATTICE, load_form="bernoulli")
    simulator = make_simulator(15.0, rpm, None, "embedded", lattice=lattice, fidelity=FULL)
    shares = [float(balance(simulator, np.radians(p), [rpm])[0]) for p in PITCHES]
    best = int(np.argmax(shares))
    return [
        "Loads by Joukowski's law. Bernoulli's, the pressure on panels without the suction of the leading edge, give",
        f"at most {100.0 * shares[best]:.0f} % of the torque that the published point at 15 m/s needs, at a pitch of "
        f"{PITCHES[best]:.0f} deg; there is no calibrated pitch with them.",
    ]


def coupled_run(wind, pitch, revolutions=3.0, **changes):
    """Simulator, rows of signals over some revolutions from the published speed, and seconds of computing."""
    rpm = published(wind)[0]
    made = make_simulator(wind, rpm, fidelity=FULL)
    simulator = Simulator(made.turbine, made.inflow, replace(made.fidelity, **changes), generator=made.drives.generator)
    simulator.reset(rotor_speed=rpm * RPM, pitch=pitch)
    simulator.advance(simulator.time_step, pitch=pitch)  # compiles
    begin, rows = time.perf_counter(), []
    for _ in range(round(60.0 * revolutions)):
        rows.append(simulator.advance(simulator.time_step, pitch=pitch))
    return simulator, rows, time.perf_counter() - begin


@case("gebhardt-2012-basis", "45 m / 68 m turbine: modes of the blades at rest and in the deformed state", GEBHARDT,
      slow=True)  # fmt: skip
def deformed_basis() -> CaseResult:
    """What it changes to compute the modes anew at each step, in deflections and frequencies, and what it costs."""
    pitch, wind, checks, lines = np.radians(12.78), 20.0, [], []
    (fixed, rows, cost), (moving, others, more) = (
        coupled_run(wind, pitch, blade_basis=basis) for basis in ("fixed", "deformed")
    )
    for name, unit in (("tip_out_of_plane", "m"), ("tip_in_plane", "m"), ("root_flap_moment", "N m"),
                       ("rotor_speed", "rad/s"), ("tower_top_fore_aft", "m")):  # fmt: skip
        a, b = (np.array([row[name] for row in series]) for series in (rows, others))
        difference = float(np.abs(a - b).max() / np.abs(a).max())
        checks.append(Check(f"{name}: largest difference over its largest value", "<= 0.005", difference))
        lines.append(f"{name}: largest {np.abs(a).max():.4g} {unit}, difference {np.abs(a - b).max():.2g} {unit}")
    names = fixed.structure.system.bodies[fixed.structure.blades[0]].coordinate_names
    rest = rest_frequencies(fixed)
    for name, f, g, h in zip(names, rest, frequencies_in(fixed), moving.coupling.basis.frequency, strict=True):
        checks.append(
            Check(f"{name}: frequency in the fixed basis over that in the deformed state", "in [0.99, 1.01]", g / h)
        )
        lines.append(f"{name}: {f:.4f} Hz at rest, turning and loaded {g:.4f} Hz in the fixed basis, {h:.4f} Hz anew")
    steps = len(rows)
    lines.append(
        f"Cost of a step: {1e3 * cost / steps:.0f} ms with fixed modes, {1e3 * more / steps:.0f} ms with new ones."
    )
    shown = Figure(tuple(
        Curve(np.arange(steps) / 60.0, [row["tip_out_of_plane"][0] for row in series], label)
        for series, label in ((rows, "modes at rest"), (others, "modes of the deformed blade"))
    ), "revolutions", "tip out of plane [m]")  # fmt: skip
    return CaseResult(checks, {"deflection of blade 1": shown}, "\n".join(lines))


def rest_frequencies(simulator):
    """Frequencies [Hz] of the modes of a blade at rest."""
    beam, basis = simulator.structure.blade_field
    return np.sqrt(np.diag(basis.T @ beam.stiffness @ basis)) / (2.0 * np.pi)


def frequencies_in(simulator):
    """Frequencies [Hz] of the turning, loaded blades in the fixed basis: Rayleigh–Ritz with the tangent matrices."""
    from wt_gym.simulation.deformed_basis import DeformedBasis

    coupling, structure = simulator.coupling, simulator.structure
    present = DeformedBasis(coupling.models)
    coupling.move_lattice(coupling.integrator.state)
    stiffness, mass = present.tangent_of(coupling.integrator.state, coupling.integrator.work, coupling.blade_forces)
    basis = structure.blade_field[1]
    k, m = basis.T @ stiffness @ basis, basis.T @ mass @ basis
    value, vector = np.linalg.eig(np.linalg.solve(m, k))
    # in the order of the coordinates: each mode by its largest part
    order = [int(np.argmax(np.abs(vector[i]))) for i in range(len(value))]
    return np.sqrt(value.real[order]) / (2.0 * np.pi)
