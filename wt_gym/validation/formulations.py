"""Blades on joints against blades held by Lagrange multipliers: the same turbine twice.

The NREL 5-MW turns under the air loads of one instant of a simulation at 11 m/s, which the blades carry in their own
frames, while its pitch and yaw drives follow moving commands.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np

from wt_gym.multibody import output_kernels, tree_kernels
from wt_gym.multibody.descriptor import descriptor_form
from wt_gym.multibody.system import HammingIntegrator
from wt_gym.simulation import FIDELITIES, Simulator
from wt_gym.validation.case import CaseResult, Check, Curve, Figure, case
from wt_gym.wind import SteadyInflow

SOURCE = "both forms follow from the same kinetic energy; Gebhardt et al. 2012, eqs. (2)–(11)"
FORMS = ("embedded", "constrained")
INTERVAL = 0.1
"""Time between changes of the commands [s]."""


@cache
def _turbines():
    """For each form: structure and state after two seconds of coupled simulation, and the loads at that time."""
    simulators = {}
    for form in FORMS:
        fidelity = replace(FIDELITIES["training"], formulation=form)
        simulators[form] = Simulator("nrel_5mw", SteadyInflow(11.0, shear_exponent=0.2), fidelity)
    embedded = simulators["embedded"]
    embedded.reset(rotor_speed=1.2, pitch=0.02, azimuth=0.3)
    signals = embedded.advance(2.0, pitch=(0.02, 0.05, 0.08), yaw_rate=0.004, generator_torque=38e3)
    state = embedded._integrator.state.copy()
    states = {"embedded": state}
    tied = simulators["constrained"].structure
    states["constrained"] = tied.adopt(embedded.structure, state)
    structures = {form: simulators[form].structure for form in FORMS}
    return structures, states, embedded._integrator.inputs.body_loads[1].copy(), signals.generator_torque


def _set_inputs(inputs, structure, loads, torque, start):
    """Loads, generator torque and the moving commands of the drives over one interval."""
    inputs.body_loads[:] = loads
    inputs.dof_force[:, structure.azimuth_u] = -97.0 * torque
    for end, t in enumerate((start, start + INTERVAL)):
        inputs.servo_command[end, 0] = 0.02 * np.sin(0.3 * t)
        inputs.servo_command[end, 1:] = 0.05 + 0.05 * np.sin(0.8 * t + np.array([0.0, 2.1, 4.2]))


def _run(form, duration, step):
    """Elastic and joint coordinates every second, and the worst constraint residuals."""
    structures, states, loads, torque = _turbines()
    structure = structures[form]
    system = structure.system
    integrator = HammingIntegrator(system, step)
    integrator.start(states[form])
    rows, drift, norm = [], 0.0, 0.0
    for k in range(round(duration / INTERVAL)):
        _set_inputs(integrator.inputs, structure, loads, torque, k * INTERVAL)
        integrator.advance(round(INTERVAL / step))
        if (k + 1) % round(1.0 / INTERVAL) == 0:
            y = integrator.state
            elastic = [structure.elastic(b, y)[0] for b in (structure.tower, *structure.blades)]
            rows.append(np.concatenate([*elastic, [y[structure.azimuth_q]]]))
            if system.constraints:
                drift = max(drift, np.abs(system.constraint_residuals(y.copy())[0]).max())
                quaternions = [system.index(b, "joint_q") + 3 for b in structure.blades]
                norm = max(norm, *(abs(np.linalg.norm(y[q : q + 4]) - 1.0) for q in quaternions))
    return np.array(rows), drift, norm


@case("formulations-accelerations", "Constrained and embedded form: accelerations, multipliers, hub loads", SOURCE)
def accelerations():
    """One state, three solutions: embedded, constrained, and eq. (7) with quaternions."""
    structures, states, loads, torque = _turbines()
    results = {}
    for form in FORMS:
        system = structures[form].system
        inputs, work = system.new_inputs(), system.new_work()
        _set_inputs(inputs, structures[form], loads, torque, 0.0)
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
    form = descriptor_form(structures["constrained"].system, states["constrained"], two[4])
    paper, paper_multipliers = form.solve()
    scale, load = np.abs(one[0]).max(), np.abs(one[1]).max()
    return [
        Check("largest difference of an acceleration / largest acceleration", 0.0, _gap(one[0], two[0], scale), 1e-9),
        Check("multipliers against hub loads of the embedded form / largest", 0.0,
              _gap(two[2].reshape(-1, 6), one[1][blades], load), 1e-9),
        Check("all joint loads of both forms / largest", 0.0, _gap(two[1], one[1], load), 1e-9),
        Check("eq. (7) with quaternions: accelerations / largest", 0.0,
              _gap(form.to_velocities @ paper, two[3], scale), 1e-9),
        Check("eq. (7) with quaternions: multipliers / largest", 0.0,
              _gap(-paper_multipliers[: len(two[2])], two[2], load), 1e-9),
    ]  # fmt: skip


def _gap(a, b, scale):
    return float(np.abs(a - b).max() / scale)


@case("formulations-trajectories", "Constrained and embedded form: 20 s of a loaded, pitching, yawing turbine", SOURCE)
def trajectories():
    """The same commands and loads; difference of all elastic coordinates and the azimuth, and its order in the step."""
    gaps, steps = [], (0.01, 0.005, 0.0025)
    for step in steps:
        runs = [_run(form, 20.0, step)[0] for form in FORMS]
        gaps.append(_gap(*runs, np.abs(runs[0][:, :-1]).max()))
    return CaseResult(
        [Check("largest difference over 20 s / largest coordinate, step 0.0025 s", 0.0, gaps[-1], 1e-6)],
        {"difference against step": Figure((Curve(steps, gaps, style="o-"),), "step [s]", "difference", True, True)},
        "The difference is the integration error of the constraint equations: it falls with the step.",
    )


@case("formulations-drift", "Constrained form: constraint drift over 600 s", SOURCE, slow=True)
def drift():
    """Baumgarte stabilisation at α = β = 10 1/s, step 0.025 s."""
    _, position, norm = _run("constrained", 600.0, 0.025)
    return [
        Check("largest constraint residual over 600 s", "<= 1e-6", position, 0.0, "m"),
        Check("largest error of a quaternion norm", "<= 1e-8", norm, 0.0),
    ]
