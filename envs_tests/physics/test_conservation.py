"""Conservation laws of the whole turbine in every formulation: energy, momentum, angular momentum, power in the air."""

import copy
from dataclasses import replace

import numpy as np
import pytest

from wt_gym.multibody.integrators.schemes import make_integrator
from wt_gym.multibody.observer_frame.observer_frame_from_system import observer_frame_from_system
from wt_gym.multibody.observer_frame.observer_frame_integrator import ObserverFrameIntegrator
from wt_gym.multibody.system import Joint
from wt_gym.multibody.tree import output_kernels
from wt_gym.simulation import FIDELITIES, Simulator
from wt_gym.simulation.turbine_structure import build_structure
from wt_gym.turbines import load_turbine
from wt_gym.wind import SteadyInflow

TIP = np.array([[0.0, 0.0, 61.0]])
SPEED = 1.2  # [rad/s] of the rotor
COARSE = {"integrator": "generalized_alpha", "tower_elements": 6, "blade_elements": 6}
NODAL = {"tower_coordinates": "nodal", "blade_coordinates": "nodal", **COARSE}
MIXED = {"formulation": "constrained", "blade_coordinates": "nodal", **COARSE, "blade_elements": 4}
LINEAR = {"formulation": "observer", "frame_displacement": "linear"}
# name: fidelity, integrator, step [s], bounds of the drift of energy in 20 s and in 600 s, and of free momenta in 20 s
FORMS = {
    "embedded": ({}, "hamming", 0.01, 2e-8, 1e-6, 2e-8),
    "yaw spring": ({"yaw_drive": "spring"}, "newmark", 0.02, 1e-6, 3e-6, 5e-6),
    "constrained": ({"formulation": "constrained"}, "hamming", 0.01, 2e-8, 1e-6, 2e-8),
    "nodal": (NODAL, "newmark", 0.02, 1e-6, 2e-6, 5e-6),
    # constraint equations under an implicit scheme: the trapezoidal rule lets multipliers grow over minutes, so energy
    # is that of a scheme that damps them; free bodies move in axes that turn with them: momentum to second order only
    "mixed": (MIXED, "generalized_alpha", 0.05, 3e-5, 1e-4, 5e-4),
    "several bodies": ({"blade_bodies": 3, **COARSE}, "newmark", 0.02, 1e-6, 3e-6, 5e-6),
    "observer": ({"formulation": "observer"}, "observer", 0.01, 5e-5, 3e-4, 1e-4),
    "observer, linear": (LINEAR, "observer", 0.01, 5e-5, 3e-4, 1e-4),
}


def undamped(turbine):
    """The turbine without damping of material, shaft and yaw drive."""
    return replace(
        turbine,
        blade=replace(turbine.blade, damping_ratio=0.0),
        tower=replace(turbine.tower, damping_ratio=0.0),
        drivetrain=replace(turbine.drivetrain, damper=0.0),
        nacelle=replace(turbine.nacelle, yaw_damper=0.0),
    )


class Run:
    """A turbine without air that turns from its undeformed shape on: on its foundation, or afloat without weight.

    ``energies`` (n, 3) are kinetic, elastic and gravitational, ``momenta`` (n, 6) those about the fixed origin.
    """

    def __init__(self, form, duration, afloat=False, reverses=False):
        changes, name, step, *self.bounds = FORMS[form]
        name = "newmark" if afloat and form == "mixed" else name
        turbine = undamped(load_turbine("nrel_5mw"))
        turbine = replace(turbine, drivetrain=replace(turbine.drivetrain, gearbox_reverses=reverses))
        self.fidelity = replace(FIDELITIES["training"], **changes)
        self.structure = build_structure(turbine, self.fidelity, TIP)
        self.system = system = floating(self.structure.system) if afloat else self.structure.system
        y = system.initial_state()
        y[system.n_q + self.structure.azimuth_u + (6 if afloat else 0)] = SPEED
        if afloat:
            y[:3], y[system.n_q : system.n_q + 6] = (1.0, 2.0, 3.0), (1.0, -2.0, 0.5, 0.01, -0.02, 0.015)
        system.place_free_bodies(y)
        self.energies, self.momenta = [], []
        advance, look = self.observed(y, step) if name == "observer" else self.tree(y, name, step)
        for k in range(round(2.0 * duration) + 1):
            if k > 0:
                advance(round(0.5 / step))
            energy, momenta = look()
            self.energies.append(energy)
            self.momenta.append(momenta)
        self.energies, self.momenta = np.array(self.energies), np.array(self.momenta)

    def tree(self, y, name, step):
        system = self.system
        options = {} if name == "hamming" or system.constraints else {"tangent": "structure"}
        integrator = make_integrator(name, system, step, **options)
        integrator.start(y, check=False)
        return integrator.advance, lambda: (system.energy(integrator.state), momenta_of(system, integrator.state))

    def observed(self, y, step):
        displacement = self.fidelity.frame_displacement
        bodies = observer_frame_from_system(self.system, self.structure.beams, y, displacement=displacement)
        integrator = ObserverFrameIntegrator(bodies, step)
        return integrator.advance, lambda: (integrator.energy(), integrator.momentum())

    def drift_of_energy(self):
        """Largest change of the sum, over the kinetic energy at the start."""
        total = self.energies.sum(axis=1)
        return np.abs(total - total[0]).max() / self.energies[0, 0]

    def exchanged(self):
        """Smallest range that a kind of energy went through, over the same."""
        return np.ptp(self.energies, axis=0).min() / self.energies[0, 0]


def floating(system):
    """The system with a free first body and without weight."""
    other = copy.copy(system)
    other.joints = [Joint("free", name="afloat"), *system.joints[1:]]
    other.gravity, other.tree, other._compiled_rates = np.zeros(3), None, None
    return other.build()


def momenta_of(system, y):
    """Momentum and angular momentum about the fixed origin (6,) of bodies and geared rotors."""
    work, tree = system.new_work(), system.tree
    output_kernels.energies(y, tree, work)
    rates, out = y[system.n_q : system.n_q + system.n_u], np.zeros(6)
    tensors = system.rotor_tensors
    for b, body in enumerate(system.bodies):
        n, u, rot, w = body.n_elastic, tree.elastic_u[b], work.rot[b], work.omega[b]
        own = work.inertia[b] - tensors[b]
        p = rot @ (
            tree.mass[b] * work.v[b]
            + np.cross(w, work.first_moment[b])
            + work.coupling_lin[b, :, :n] @ rates[u : u + n]
        )
        h = rot @ (np.cross(work.first_moment[b], work.v[b]) + own @ w + work.coupling_ang[b, :, :n] @ rates[u : u + n])
        joint, parent = system.joints[b], system.parents[b]
        if joint.rotor_inertia > 0.0:
            along = work.rot[parent] @ joint.rotation @ joint.axis
            spin = along @ work.rot[parent] @ work.omega[parent] + joint.rotor_ratio * rates[tree.joint_u[b]]
            h += joint.rotor_inertia * spin * along
        out += np.concatenate([p, np.cross(work.r[b], p) + h])
    return out


@pytest.mark.parametrize("form", [pytest.param(f, marks=pytest.mark.slow) if f == "mixed" else f for f in FORMS])
def test_energy_of_a_turning_turbine(form):
    run = Run(form, 20.0)
    assert run.exchanged() > 5e-4, "the test must move energy between its forms"
    assert run.drift_of_energy() < run.bounds[0]


@pytest.mark.slow
@pytest.mark.parametrize("form", FORMS)
def test_energy_of_a_turning_turbine_over_ten_minutes(form):
    run = Run(form, 600.0)
    assert run.exchanged() > 5e-4
    assert run.drift_of_energy() < run.bounds[1]


@pytest.mark.parametrize(
    ("form", "reverses"), [(form, False) for form in FORMS] + [("embedded", True), ("observer", True)]
)
def test_momentum_and_angular_momentum_of_a_turbine_afloat(form, reverses):
    """Nothing from outside: all six stay, while rotor, nacelle and tower exchange them."""
    run = Run(form, 20.0, afloat=True, reverses=reverses)
    change = np.abs(run.momenta - run.momenta[0]).max(axis=0)
    size = np.abs(run.momenta[0].reshape(2, 3)).max(axis=1)
    assert change[:3].max() < run.bounds[2] * size[0]
    assert change[3:].max() < run.bounds[2] * size[1]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("changes", "reverses", "bound"),
    [
        ({}, False, 3e-5),
        ({}, True, 3e-5),
        ({"formulation": "constrained"}, False, 3e-5),
        ({"blade_bodies": 3, **COARSE}, False, 3e-4),
        ({"formulation": "observer"}, False, 4e-4),
        (LINEAR, False, 4e-4),
    ],
    ids=["embedded", "reversing gearbox", "constrained", "several bodies", "observer", "observer, linear"],
)
def test_power_balance_in_the_air(changes, reverses, bound):
    """Without damping the energy of the turbine changes by the work of the air, generator and drives, and nothing else.

    The torque swings and the nacelle yaws; the bound is over the work of the air.
    """
    turbine = undamped(load_turbine("nrel_5mw"))
    turbine = replace(turbine, drivetrain=replace(turbine.drivetrain, gearbox_reverses=reverses))
    simulator = Simulator(turbine, SteadyInflow(9.0), replace(FIDELITIES["training"], **changes))
    simulator.reset(rotor_speed=1.05, pitch=0.0, generator_torque=2.5e4)
    balance, system, dt = simulator.coupling.exchange.energy, simulator.structure.system, simulator.time_step
    energy, given, of_air = [], [], []
    for k in range(round(20.0 / dt)):
        yaw_rate, torque = 0.004 if k % 100 < 50 else 0.0, 2.5e4 + 1e4 * np.sin(0.5 * k * dt)
        simulator.advance(dt, pitch=0.0, yaw_rate=yaw_rate, generator_torque=torque)
        energy.append(sum(system.energy(simulator.coupling.integrator.history.y[-1])))
        given.append(balance.given[0])
        of_air.append(balance.of_air[0])
    given = np.array(given)
    work = np.concatenate([[0.0], np.cumsum(0.5 * dt * (given[1:] + given[:-1]))])
    assert np.ptp(work) > 0.05 * dt * sum(of_air)
    error = np.abs(np.array(energy) - energy[0] - work).max()
    assert error < bound * dt * sum(of_air)
