"""The turbine of Gebhardt et al. 2012, its preset with everything, and every formulation as an environment."""

from dataclasses import replace

import numpy as np
import pytest

from envs_tests.physics.cases import formulations as module
from envs_tests.physics.cases.gebhardt import RPM, boundary_layer, make_simulator, published, simulate
from wt_gym.base.errors import SimulationError
from wt_gym.multibody.integrators.schemes import HammingIntegrator
from wt_gym.multibody.system import Constraint, Joint, MultibodySystem
from wt_gym.simulation import FIDELITIES, Simulator
from wt_gym.simulation.deformed_basis import TangentBlade
from wt_gym.structure.beam import Beam, BeamSections
from wt_gym.structure.flexible_body import FlexibleBody
from wt_gym.structure.modes import clamped_modes
from wt_gym.turbines import load_turbine
from wt_gym.turbines.catalog import GENERATOR_DAMPER, gebhardt_data, gebhardt_turbine
from wt_gym.wind import SteadyInflow

# ---- stand-in -------------------------------------------------------------------------------------------------------
# The stand-in for the turbine of Gebhardt et al. 2012: masses, frequencies, degrees of freedom, torque balance.

STAND_IN = gebhardt_data()["stand_in"]
PITCH_15 = np.radians(12.7)
"""At which the rotor turns at the published 7.4 rpm in 15 m/s (gradient height)."""


def test_masses():
    turbine, blade = gebhardt_turbine(), STAND_IN["blade"]
    moments = [turbine.blade.structure.mass_moment(order) for order in (0, 1, 2)]
    assert moments[0] == pytest.approx(blade["mass_kg"], rel=1e-4)
    assert moments[1] == pytest.approx(blade["first_moment_kgm"], rel=1e-3)
    assert moments[2] == pytest.approx(blade["second_moment_kgm2"], rel=0.01)
    assert turbine.tower.structure.mass_moment(0) == pytest.approx(STAND_IN["tower"]["mass_kg"], rel=1e-4)
    top = turbine.nacelle.mass + turbine.hub.mass + 3.0 * moments[0]
    assert top == pytest.approx(STAND_IN["tower_top_mass_kg"], rel=1e-4)
    radius = turbine.hub.radius
    rotor = turbine.hub.inertia_axial + 3.0 * (moments[2] + 2.0 * radius * moments[1] + moments[0] * radius**2)
    assert rotor == pytest.approx(STAND_IN["rotor_inertia_kgm2"], rel=0.01)


def test_blade_frequencies():
    expected = STAND_IN["blade"]["frequencies_22_nodes_Hz"]
    structure = gebhardt_turbine().blade.structure
    axis = np.column_stack([0.0 * structure.station, 0.0 * structure.station, structure.station])
    beam = Beam(BeamSections(structure.station, structure.stiffness, structure.inertia, axis), 21)
    found = clamped_modes(beam, 4).frequency
    np.testing.assert_allclose(found[:3], [expected[k] for k in ("flap_1", "edge_1", "flap_2")], rtol=0.02)


def test_thirteen_degrees_of_freedom():
    structure = make_simulator(15.0, 7.4, formulation="embedded").structure
    count = gebhardt_data()["published"]["degrees_of_freedom"]
    assert structure.system.n_u == count["tower"] + count["rotor"] + 3 * count["each_blade"]
    assert not structure.shaft_flexible


def test_wind_at_the_hub():
    """0.803 of the reference wind when that blows at the gradient height; all of it when it blows at the hub."""
    height = gebhardt_turbine().hub_height
    point = np.array([[0.0, 0.0, height]])
    assert boundary_layer(15.0).velocity(point, 0.0)[0, 0] == pytest.approx(15.0 * 0.803, rel=2e-3)
    assert boundary_layer(15.0, height).velocity(point, 0.0)[0, 0] == pytest.approx(15.0)


def test_damper_holds_the_published_point():
    """Half a revolution from the published point at 15 m/s: the speed stays, and the tower bears the reaction."""
    rpm, power = published(15.0)
    run = simulate(make_simulator(15.0, rpm, formulation="embedded"), PITCH_15, 0.5, rpm * RPM)
    assert np.all(np.isfinite(run.flap))
    np.testing.assert_allclose(run.speed / RPM, rpm, rtol=0.02)
    assert run.power.mean() == pytest.approx(power, rel=0.03)
    # prismatic cantilever under the generator's moment, M L²/2EI; the weight on top adds about a tenth
    tower = STAND_IN["tower"]
    lean = GENERATOR_DAMPER * run.speed.mean() * 68.0**2 / (2.0 * tower["EI_Nm2"])
    assert run.side_side.mean() == pytest.approx(-1.1 * lean, rel=0.2)


# ---- everything at once ---------------------------------------------------------------------------------------------
# The preset with all that Gebhardt et al. 2012 name, its multipliers, gain and drift, and modes of deformed blades.

PITCH, RPM_15 = np.radians(12.8), published(15.0)[0]
OMEGA = np.array([1.2, 0.0, 0.0])


@pytest.fixture(scope="module")
def full():
    """A quarter of a revolution at the published point of 15 m/s, with modes of the deformed blades."""
    made = make_simulator(15.0, RPM_15, fidelity="gebhardt-full")
    fidelity = replace(made.fidelity, blade_basis="deformed")
    simulator = Simulator(made.turbine, made.inflow, fidelity, generator=made.drives.generator)
    simulator.reset(rotor_speed=RPM_15 * RPM, pitch=PITCH)
    simulator.constraint_drift()
    signals = simulator.advance(15 * simulator.time_step, pitch=PITCH)
    return simulator, signals


@pytest.mark.slow
def test_everything_is_there(full):
    """Free blades with quaternions on 22 nodes, wakes from two edges, ground, tower and nacelle as closed bodies."""
    simulator, signals = full
    system, options = simulator.structure.system, simulator.fidelity.aero
    assert len(system.quaternions) == 3
    assert system.n_u - system.n_constraints == 13
    assert len(simulator.structure.blade_field[0].nodes) == 22
    assert options.trailing_edge_wake
    assert options.tip_wake
    assert options.ground_height == 0.0
    assert set(simulator.lattice.bodies.names) == {"tower", "nacelle"}
    assert np.isfinite(signals.values).all()
    assert signals.rotor_speed / RPM == pytest.approx(RPM_15, rel=0.02)


@pytest.mark.slow
def test_multipliers_are_the_loads_of_the_roots(full):
    """Against the moments that follow from the motion of all bodies, tip to root (Newton–Euler, `joint_wrenches`)."""
    simulator, signals = full
    multipliers = simulator.root_multipliers()
    names = ("root_edge_moment", "root_flap_moment", "root_torsion")
    moments = -np.stack([signals[name] for name in names], axis=1)
    np.testing.assert_allclose(multipliers[:, 3:], moments, atol=1e-8 * np.abs(moments).max())
    assert np.linalg.norm(multipliers[:, :3], axis=1).max() > 5e4  # the pull of 10 t that turn
    again = simulator.root_multipliers()
    np.testing.assert_array_equal(again, multipliers)


@pytest.mark.slow
def test_drift_before_projection_is_seen(full):
    """Steps drift by more than what is left after them, and both are small."""
    simulator, _ = full
    drift = simulator.constraint_drift(restart=False)
    assert 0.0 < drift.position < 1e-7
    assert 0.0 < drift.velocity < 1e-6
    assert 0.0 < drift.norm < 1e-8
    assert np.abs(simulator.coupling.integrator.work.residual).max() < 0.1 * drift.position


@pytest.mark.slow
def test_bodies_stand_where_the_tower_is(full):
    """The axis of the body ends on the bent tower, and its panels move as the tower does."""
    simulator, signals = full
    coupling, structure = simulator.coupling, simulator.structure
    coupling.resume()  # bodies of a step stand where the tower was before it
    bodies = simulator.lattice.bodies
    tower = simulator.geometry()["tower"]
    ends = bodies.arrays.axis
    np.testing.assert_allclose(ends[0], tower[0], atol=1e-12)
    along = ends[1, 2]
    expected = [np.interp(along, tower[:, 2], tower[:, k]) for k in range(2)]
    np.testing.assert_allclose(ends[1, :2], expected, atol=2e-3 * np.abs(tower[-1, :2]).max())
    nacelle = bodies.first_panel[bodies.names.index("nacelle")]
    y, work = coupling.integrator.state, coupling.integrator.work
    n = structure.nacelle
    arm = bodies.control_points[nacelle] - work.r[n]
    moves = work.rot[n] @ (work.v[n] + np.cross(work.omega[n], work.rot[n].T @ arm))
    np.testing.assert_allclose(bodies.arrays.motion[:, nacelle], moves, atol=1e-12)
    q, _ = structure.elastic(structure.tower, y)
    assert np.abs(q).max() > 0.0
    heading = work.rot[n][:2, 0] / np.linalg.norm(work.rot[n][:2, 0])  # the bent tower turns the nacelle
    assert signals.tower_top_fore_aft == pytest.approx(heading @ tower[-1, :2], abs=1e-9)


@pytest.mark.slow
def test_the_tower_bears_the_force_on_its_body(full):
    """The given load is that of the strips by virtual work: its power is that of the forces on the moving strips."""
    simulator, _ = full
    coupling, structure = simulator.coupling, simulator.structure
    moving, y, work = coupling.moving, coupling.integrator.state, coupling.integrator.work
    coupling.move_lattice(y)
    assert np.abs(moving.force[1]).max() > 1.0
    load = np.zeros_like(coupling.exchange.tower.given)
    moving.load(y, work, load)
    np.testing.assert_array_equal(load, coupling.exchange.tower.given)
    _, velocity = moving._motion(moving._middles, y, work)
    force = 2.0 * moving.force[1] - moving.force[0]
    q, rate = structure.elastic(structure.tower, y)
    assert load[6 : 6 + len(q)] @ rate == pytest.approx(np.einsum("pi,pi->", force, velocity), rel=1e-9)
    np.testing.assert_allclose(load[:3], force.sum(axis=0), rtol=1e-12)


@pytest.mark.slow
def test_tangent_of_a_straight_spinning_blade(full):
    """Without deformation the tangent has the spinning modes, whose stiffening the rotating-beam cases have proved."""
    beam, _ = full[0].structure.blade_field
    tangent = TangentBlade(beam, np.array([[0.0, 0.0, 30.0]]), (0.0, 0.0, -1.8))
    modes, _ = tangent.modes(np.zeros(beam.n_dof), OMEGA)
    expected = clamped_modes(beam, len(modes.frequency), spin=OMEGA, center=(0.0, 0.0, -1.8), node_dofs=range(5))
    np.testing.assert_allclose(modes.frequency, expected.frequency, rtol=1e-9)


@pytest.mark.slow
def test_tangent_of_a_bent_loaded_blade(full):
    """K_t and M_t against second differences of the potential and the kinetic energy of all mass points."""
    beam, basis = full[0].structure.blade_field
    place, force = np.array([[0.3, 0.5, 30.0]]), np.array([[2e4, -5e3, 1e3]])
    tangent = TangentBlade(beam, place, (0.0, 0.0, -1.8))
    fields, mass, second = tangent._fields, beam.particle_mass, tangent._fields.second
    at = tangent._points

    def position(u):
        return fields.position + fields.linear @ u + 0.5 * np.einsum("pijk,j,k->pi", second, u, u, optimize=True)

    def potential(u):
        speed = np.cross(OMEGA, position(u) - tangent.center)
        moved = (at.linear @ u + 0.5 * np.einsum("pijk,j,k->pi", at.second, u, u))[0]
        return 0.5 * u @ beam.stiffness @ u - 0.5 * mass @ np.sum(speed**2, axis=1) - force[0] @ moved

    u = 2.0 * basis @ [1.0, 0.3, -0.2] / np.abs(basis[-6:-3]).max()
    stiffness, inertia = tangent.matrices(u, OMEGA, force)
    for direction in (0.2 * basis @ np.random.default_rng(0).normal(size=(3, 4))).T:
        curvature = potential(u + direction) - 2.0 * potential(u) + potential(u - direction)
        assert direction @ stiffness @ direction == pytest.approx(curvature, rel=1e-4)
        rate = 0.5 * (position(u + direction) - position(u - direction))
        assert direction @ inertia @ direction == pytest.approx(mass @ np.sum(rate**2, axis=1), rel=1e-9)


@pytest.mark.slow
def test_a_blade_without_load_keeps_its_modes():
    """At rest, in still air without weight, the modes of the deformed state are the fixed ones."""
    made = make_simulator(15.0, RPM_15, formulation="embedded", fidelity="gebhardt-full")
    basis = replace(made.fidelity, blade_basis="deformed", moving_bodies=False)
    simulator = Simulator(made.turbine, SteadyInflow(0.0), basis, generator=made.drives.generator)
    simulator.structure.system.tree.gravity[:] = 0.0
    simulator.reset(rotor_speed=0.0)
    simulator.advance(2 * simulator.time_step, pitch=0.0)
    rest, now = simulator.structure.blade_field[1], simulator.coupling.basis.basis
    np.testing.assert_allclose(now, rest, atol=1e-7 * np.abs(rest).max())


@pytest.mark.parametrize("gain", [5.0, 20.0])
def test_gain_pulls_in_what_has_drifted(gain):
    """Without projection φ̈ + 2 α φ̇ + α² φ = 0 exactly: φ = φ₀ (1 + α t) exp(−α t)."""
    system = MultibodySystem(stabilization=gain, projection=False)
    ends = {"origin": np.zeros(3), "end": np.array([0.0, 0.0, -1.0])}
    bob = FlexibleBody.rigid("bob", 2.0, (0.0, 0.0, -0.7), np.diag([0.1, 0.1, 0.1]), ends)
    free = system.add(bob, Joint("free", name="bob_frame"))
    system.add_constraint(Constraint("ball", name="pivot"), None, free)
    system.build()
    y = system.initial_state()
    y[:3], y[system.n_q + 4] = (0.01, -0.02, 0.005), 1.0
    integrator = HammingIntegrator(system, 0.002, starter="runge-kutta")
    integrator.start(y, check=False)
    integrator.advance(100)
    left = integrator.state[:3]
    expected = np.array([0.01, -0.02, 0.005]) * (1.0 + 0.2 * gain) * np.exp(-0.2 * gain)
    np.testing.assert_allclose(left, expected, atol=1e-7)
    assert integrator.drift.position == pytest.approx(0.02, rel=0.01)


def test_gain_and_projection_reach_the_system():
    fidelity = replace(FIDELITIES["gebhardt"], stabilization=25.0, projection=False)
    system = Simulator("gebhardt_45m", SteadyInflow(12.0), fidelity).structure.system
    assert (system.tree.stabilization, system.tree.projection) == (25.0, 0)


def test_multipliers_need_constraints_and_a_stable_gain():
    simulator = Simulator("gebhardt_45m", SteadyInflow(12.0), "training")
    simulator.reset(rotor_speed=1.2, pitch=0.1)
    with pytest.raises(SimulationError, match="no multipliers without constraint equations"):
        simulator.root_multipliers()
    assert simulator.constraint_drift() == (0.0, 0.0, 0.0)
    stiff = replace(FIDELITIES["gebhardt"], stabilization=200.0)
    with pytest.raises(SimulationError, match="stability limit"):
        Simulator("gebhardt_45m", SteadyInflow(12.0), stiff).reset(rotor_speed=1.0, pitch=0.1)


# ---- formulations as environments -----------------------------------------------------------------------------------

KNOWN = {combination.label: combination for combination in module.COMBINATIONS}
IDS = {"NREL5MW": "nrel_5mw", "IEA15MW": "iea_15mw"}


@pytest.mark.parametrize("pair", module.NODAL_AND_MODAL, ids=lambda pair: pair[0])
def test_nodal_blades_vibrate_as_modal_ones(pair):
    turbine = load_turbine(IDS[pair[0]])
    nodal, modal = (module.parked_frequencies(turbine, KNOWN[f"{pair[0]}, {name}"].fidelity) for name in pair[1:])
    np.testing.assert_allclose(nodal, modal, rtol=5e-3)
    assert np.abs(nodal / modal - 1.0).max() > 1e-5  # other elements, other coordinates
