"""Blades on joints against blades held by Lagrange multipliers: the same turbine twice.

The NREL 5-MW turns under the air loads of one instant of a simulation at 11 m/s, which the blades carry in their own
frames, while its pitch and yaw drives follow moving commands. The generator holds the rotor near its speed by a torque
that rises with it (slip).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from validation.case import CaseResult, Check, Curve, Figure, case
from wt_gym.multibody.constraints.descriptor import descriptor_form
from wt_gym.multibody.integrators.schemes import HammingIntegrator
from wt_gym.multibody.tree import output_kernels, tree_kernels
from wt_gym.simulation import FIDELITIES, Simulator
from wt_gym.wind import SteadyInflow

SOURCE = "both forms follow from the same kinetic energy; Gebhardt et al. 2012, eqs. (2)–(11)"
FORMS = ("embedded", "constrained")
SPEED = 1.2
"""Rotor speed that the generator holds [rad/s]."""
PITCH = (0.02, 0.05, 0.08)
"""Pitch at the start [rad]."""
SLIP = 4e7
"""Rise of the generator's torque with the speed of the shaft [N m s/rad]: the speed settles within a second."""
GAINS = (0.0, 2.0, 10.0, 40.0)
"""Baumgarte's gains of the runs without projection [1/s]."""
TURNED_AWAY = 1.0
"""Angle by which a difference of the azimuth is divided [rad]."""


@cache
def _turbines(name):
    """For each form: simulator and state after four seconds of coupled simulation, and the loads at that time."""
    simulators = {}
    for form in FORMS:
        fidelity = replace(FIDELITIES[name], formulation=form)
        simulators[form] = Simulator("nrel_5mw", SteadyInflow(11.0, shear_exponent=0.2), fidelity)
    embedded = simulators["embedded"]
    embedded.reset(rotor_speed=SPEED, pitch=0.02, azimuth=0.3)
    signals = embedded.advance(4.0, pitch=PITCH, generator_torque=38e3)
    state = embedded.coupling.integrator.state.copy()
    states = {"embedded": state}
    tied = simulators["constrained"].structure
    states["constrained"] = tied.adopt(embedded.structure, state)
    for simulator in simulators.values():
        simulator.structure.system.tree.dof_damping[simulator.structure.azimuth_u] = SLIP
    return simulators, states, embedded.coupling.integrator.inputs.body_loads[1].copy(), signals.generator_torque


def _set_inputs(inputs, structure, loads, torque, start, interval):
    """Loads, generator torque and the moving commands of the drives over one interval [s]."""
    inputs.body_loads[:] = loads
    inputs.dof_force[:, structure.azimuth_u] = -97.0 * torque
    inputs.reference_rate[:, structure.azimuth_u] = SPEED
    for end, t in enumerate((start, start + interval)):
        inputs.servo_command[end, 0] = 0.02 * (1.0 - np.cos(0.3 * t))
        inputs.servo_command[end, 1:] = _pitch_demand(t)


def _pitch_demand(t):
    """Pitch demands (3,) that leave PITCH smoothly [rad]."""
    return np.array(PITCH) + np.array([0.05, 0.02, -0.02]) * (1.0 - np.cos(0.8 * t))


@dataclass(frozen=True)
class _Run:
    """Histories of a run.

    ``coordinates`` (n_times, n) are the elastic ones of tower and blades and the azimuth, ten times a second; speed the
    least and largest rotor speed [rad/s]; position and velocity the largest constraint residuals [m or rad; per second]
    of the states from which steps start, drift those before the projection, with the largest | |q| − 1 | of a
    quaternion before it is rescaled.
    """

    coordinates: np.ndarray
    speed: tuple[float, float]
    position: float = 0.0
    velocity: float = 0.0
    drift: tuple[float, float, float] = (0.0, 0.0, 0.0)


def _run(name, form, duration, step, starter="adams"):
    """Run one form of a fidelity; constraint residuals are taken at every step."""
    simulators, states, loads, torque = _turbines(name)
    structure = simulators[form].structure
    system = structure.system
    integrator = HammingIntegrator(system, step, starter=starter)
    _set_inputs(integrator.inputs, structure, loads, torque, 0.0, step)
    integrator.start(states[form])
    rows, speeds, position, velocity = [], [], 0.0, 0.0
    every = round(0.1 / step)
    for k in range(round(duration / step)):
        _set_inputs(integrator.inputs, structure, loads, torque, k * step, step)
        integrator.advance()
        if system.constraints:
            position = max(position, np.abs(integrator.work.residual).max())
            velocity = max(velocity, np.abs(integrator.work.residual_rate).max())
        if (k + 1) % every == 0:
            y = integrator.state
            elastic = [structure.elastic(b, y)[0] for b in (structure.tower, *structure.blades)]
            rows.append(np.concatenate([*elastic, [y[structure.azimuth_q]]]))
            speeds.append(y[system.n_q + structure.azimuth_u])
    return _Run(np.array(rows), (min(speeds), max(speeds)), float(position), float(velocity), integrator.drift)


@case("formulations-accelerations", "Constrained and embedded form: accelerations, multipliers, hub loads", SOURCE)
def accelerations() -> list[Check]:
    """One state, three solutions: embedded, constrained, and eq. (7) with quaternions."""
    simulators, states, loads, torque = _turbines("training")
    structures = {form: simulators[form].structure for form in FORMS}
    results = {}
    for form in FORMS:
        system = structures[form].system
        inputs, work = system.new_inputs(), system.new_work()
        _set_inputs(inputs, structures[form], loads, torque, 0.0, 0.1)
        y = states[form]
        rate = system.rates(y, inputs, work)
        u = rate[system.n_q : system.n_q + system.n_u]
        common = [structures[form].elastic(b, rate[: system.n_q + system.n_u])[1] for b in range(len(system.bodies))]
        wrench = np.zeros((len(system.bodies), 6))
        tree_kernels.kinematics(y, system.tree, work)
        multipliers = work.multipliers.copy()
        output_kernels.joint_wrenches(y, u, loads, system.tree, work, wrench)
        results[form] = np.concatenate([*common, [u[structures[form].azimuth_u]]]), wrench, multipliers, u, inputs
    one, two = results["embedded"], results["constrained"]
    blades = list(structures["embedded"].blades)
    descriptor = descriptor_form(structures["constrained"].system, states["constrained"], two[4])
    paper, paper_multipliers = descriptor.solve()
    scale, load = np.abs(one[0]).max(), np.abs(one[1]).max()
    return [
        Check("largest difference of an acceleration / largest acceleration", 0.0, _gap(one[0], two[0], scale), 1e-9),
        Check("multipliers against hub loads of the embedded form / largest", 0.0,
              _gap(two[2].reshape(-1, 6), one[1][blades], load), 1e-9),
        Check("all joint loads of both forms / largest", 0.0, _gap(two[1], one[1], load), 1e-9),
        Check("eq. (7) with quaternions: accelerations / largest", 0.0,
              _gap(descriptor.to_velocities @ paper, two[3], scale), 1e-9),
        Check("eq. (7) with quaternions: multipliers / largest", 0.0,
              _gap(-paper_multipliers[: len(two[2])], two[2], load), 1e-9),
    ]  # fmt: skip


def _gap(a, b, scale):
    return float(np.abs(a - b).max() / scale)


def coordinate_gaps(name, step, duration=20.0, starter="runge-kutta"):
    """Largest difference of each coordinate between the forms, by the largest size of that coordinate itself.

    The azimuth, which grows with time, is compared with one radian.
    """
    one, two = (_run(name, form, duration, step, starter).coordinates for form in FORMS)
    size = np.abs(one).max(axis=0)
    size[-1] = TURNED_AWAY
    return np.abs(one - two).max(axis=0) / size


@case(
    "formulations-trajectories",
    "Constrained and embedded form: 20 s of a loaded, pitching, yawing turbine",
    SOURCE,
    slow=True,
)
def trajectories() -> CaseResult:
    """The same commands and loads; every coordinate against its own size, and the difference over the step."""
    simulators = _turbines("training")[0]
    structure = simulators["embedded"].structure
    names = [n for b in (structure.tower, *structure.blades) for n in structure.system.bodies[b].coordinate_names]
    names.append("azimuth")
    steps, own = (0.01, 0.005, 0.0025), simulators["constrained"].coupling.scheme.h
    gaps = [coordinate_gaps("training", step) for step in steps]
    product = coordinate_gaps("training", own, starter="adams")
    finest = gaps[-1]
    checks = [
        Check(f"{name}: largest difference over 20 s / its largest value, step {steps[-1]} s", 0.0, gap, 1e-6)
        for name, gap in zip(names, finest, strict=True)
    ]
    notes = [
        "Three Runge–Kutta steps start the runs. The difference is the integration error of the constraint equations;",
        "its largest value by step: "
        + ", ".join(f"{g.max():.2e} at {s} s" for g, s in zip(gaps, steps, strict=True))
        + ".",
        f"At the step of the training fidelity, {own:.4g} s, and with its starters: {product.max():.2e} "
        f"({names[int(product.argmax())]}), median {np.median(product):.2e}.",
    ]
    figure = Figure((Curve(steps, [g.max() for g in gaps], style="o-"),), "step [s]", "difference", True, True)
    return CaseResult(checks, {"largest difference against step": figure}, "\n".join(notes))


def coupled_drift(duration, **changes):
    """The shipped preset in the wind with moving pitch and yaw: residuals after each aerodynamic step, and drift."""
    fidelity = replace(FIDELITIES["gebhardt"], **changes)
    simulator = Simulator("nrel_5mw", SteadyInflow(11.0, shear_exponent=0.2), fidelity)
    simulator.reset(rotor_speed=SPEED, pitch=PITCH)
    work, position = simulator.coupling.integrator.work, 0.0
    simulator.constraint_drift()
    for k in range(round(duration / simulator.time_step)):
        t = k * simulator.time_step
        torque = 30e3 + 60e3 * (simulator.signals.rotor_speed - SPEED)
        simulator.advance(simulator.time_step, _pitch_demand(t), 0.004 * np.sin(0.3 * t), max(torque, 0.0))
        position = max(position, float(np.abs(work.residual).max()))
    return position, simulator.constraint_drift(), simulator.signals.rotor_speed


@case("formulations-drift", "Constrained form: constraint drift over 600 s", SOURCE, slow=True)
def drift() -> CaseResult:
    """The preset of Gebhardt et al. at its own step with its own starters; residuals at every step."""
    simulator = _turbines("gebhardt")[0]["constrained"]
    step, starter = simulator.coupling.integrator.step, simulator.fidelity.starter
    run = _run("gebhardt", "constrained", 600.0, step, starter)
    position, coupled, speed = coupled_drift(30.0)
    return CaseResult(
        [
            Check("largest constraint residual of all steps", "<= 1e-6", run.position, unit="m or rad"),
            Check("largest residual of a step before the projection", "<= 1e-6", run.drift.position, unit="m or rad"),
            Check("largest error of a quaternion norm before rescaling", "<= 1e-8", run.drift.norm),
            Check("largest constraint residual, 30 s in the wind", "<= 1e-6", position, unit="m or rad"),
            Check("the same before the projection", "<= 1e-6", coupled.position, unit="m or rad"),
            Check("largest error of a quaternion norm, 30 s in the wind", "<= 1e-8", coupled.norm),
            Check("least rotor speed", f">= {0.8 * SPEED}", run.speed[0], unit="rad/s"),
            Check("largest rotor speed", f"<= {1.2 * SPEED}", run.speed[1], unit="rad/s"),
        ],
        notes=(
            f"Step {step:.4g} s, starter {starter}; largest residual of velocities {run.velocity:.2e} m/s or rad/s. "
            f"Rotor speed in the wind at the end {speed:.3f} rad/s. States are put back onto the constraints after "
            f"each step, quaternions rescaled. Before that the rates of a step are off by at most "
            f"{run.drift.velocity:.2e} m/s or rad/s, in the wind {coupled.velocity:.2e}."
        ),
    )


@case("formulations-gain", "Constrained form: drift over Baumgarte's gain, without projection", SOURCE, slow=True)
def gain() -> CaseResult:
    """30 s in the wind with moving pitch and yaw; stabilization alone, weak, as shipped and strong, and none."""
    found = {gain: coupled_drift(30.0, projection=False, stabilization=gain)[1] for gain in GAINS}
    projected = coupled_drift(30.0)[1]
    own = found[10.0].position
    checks = [
        Check("drift of positions with projection", "<= 1e-6", projected.position, unit="m or rad"),
        Check("with the shipped gain alone", "<= 1e-6", own, unit="m or rad"),
        Check("without either over that with the shipped gain", ">= 10", found[0.0].position / own),
    ]
    lines = [
        f"α = {gain} 1/s: |φ| up to {drift.position:.2e}, |φ̇| up to {drift.velocity:.2e}"
        for gain, drift in found.items()
    ]
    lines.append(f"with projection: {projected.position:.2e} and {projected.velocity:.2e} before it")
    return CaseResult(checks, notes="\n".join(lines))
