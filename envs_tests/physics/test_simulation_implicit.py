"""The coupled turbine by implicit schemes, with blades of one body and of several."""

from dataclasses import replace

import gymnasium as gym
import numpy as np
import pytest

from wt_gym.control import torque_curve
from wt_gym.multibody.integrators.schemes import make_integrator
from wt_gym.multibody.system import Joint, MultibodySystem
from wt_gym.simulation import FIDELITIES, Simulator
from wt_gym.structure.beam import BeamSections
from wt_gym.structure.substructure import add_chain, cut_beam
from wt_gym.turbines import load_turbine
from wt_gym.wind import SteadyInflow

TRAINING = FIDELITIES["training"]
IMPLICIT = replace(TRAINING, integrator="generalized_alpha")
SEVERAL = replace(IMPLICIT, blade_bodies=4, blade_modes=(2, 1, 1))


def spinning_chain():
    """A rod of three bodies that turns about its root."""
    sections = BeamSections.uniform(10.0, EA=1e8, EIx=2e5, EIy=1e5, GJ=1e5, mass=8.0, Ix=0.1, Iy=0.1)
    system = MultibodySystem()
    sub_bodies = cut_beam("rod", sections, 6, 3, "nodal", dofs=(0, 1, 3, 4, 5))
    add_chain(system, sub_bodies, Joint("revolute", axis=(1.0, 0.0, 0.0), name="turn"))
    return system.build()


@pytest.mark.parametrize(("name", "options"), [("newmark", {}), ("generalized_alpha", {"rho_inf": 0.6})])
def test_the_matrix_of_the_structure_leads_to_the_same_motion(name, options):
    """Newton's matrix changes the way of the iteration, not where it ends."""
    system, ends = spinning_chain(), []
    for tangent in ("difference", "structure"):
        integrator = make_integrator(name, system, 0.01, tangent=tangent, tolerance=1e-11, max_iterations=60, **options)
        y = system.initial_state()
        y[system.n_q] = 4.0
        integrator.start(y)
        integrator.advance(100)
        ends.append(integrator.state.copy())
    turned = ends[0][0]
    assert turned > 1.0
    np.testing.assert_allclose(ends[1], ends[0], atol=1e-7)


def test_a_tangent_that_does_not_exist_is_refused():
    with pytest.raises(ValueError, match="must be 'difference' or 'structure', got 'exact'"):
        make_integrator("newmark", spinning_chain(), 0.01, tangent="exact")


def motion(fidelity, turbine="nrel_5mw", seconds=4.0, speed=1.05):
    """Signals (n_steps, 5) of a short run with a step of pitch, and the simulator."""
    simulator = Simulator(turbine, SteadyInflow(9.0, hub_height=90.0, shear_exponent=0.2), fidelity)
    simulator.reset(rotor_speed=speed)
    rows = []
    for k in range(round(seconds / 0.2)):
        s = simulator.advance(0.2, pitch=0.03 * (k > 5), generator_torque=25e3)
        rows.append([s.rotor_speed, s.tip_out_of_plane[0], s.tip_in_plane[0], s.root_flap_moment[0],
                     s.root_edge_moment[0]])  # fmt: skip
    return np.array(rows), simulator


@pytest.mark.slow
@pytest.mark.parametrize("integrator", ["newmark", "generalized_alpha"])
def test_implicit_steps_converge_to_the_explicit_ones(integrator):
    """Second order: steps of 3/8 the length leave a seventh of the difference."""
    expected, _ = motion(replace(TRAINING, max_substep=0.0125))
    scale, errors = np.abs(expected).max(axis=0), []
    for step in (0.034, 0.0125):
        found, simulator = motion(replace(TRAINING, integrator=integrator, max_substep=step))
        assert simulator.coupling.scheme.n_sub == {0.034: 3, 0.0125: 8}[step]
        errors.append((np.abs(found - expected).max(axis=0) / scale).max())
    assert errors[0] < 0.015
    assert 4.5 < errors[0] / errors[1] < 10.0


def test_the_blades_of_the_ids_twist():
    """IEA 15-MW at 9 m/s: blades that twist carry 200 kN less, two thirds of what those that bend are above HAWC2.

    The axial force of the shaft has the rotor's weight in it, which is the same for both.
    """
    curve, thrust = torque_curve(load_turbine("iea_15mw")), {}
    for version, fidelity in enumerate(("training", gym.spec("wt_gym/IEA15MW-Steady-v2").kwargs["fidelity"])):
        simulator = Simulator("iea_15mw", SteadyInflow(9.0, hub_height=150.0), fidelity)
        signals, found = simulator.reset(rotor_speed=0.67), []
        for _ in range(100):
            signals = simulator.advance(0.2, pitch=0.0, generator_torque=curve.torque(signals.generator_speed))
            found.append(signals.rotor_thrust)
        thrust[version] = np.mean(found[50:])
    assert 150e3 < thrust[0] - thrust[1] < 250e3


@pytest.fixture(scope="module")
def several():
    """A run with blades of four bodies."""
    return motion(SEVERAL)


def test_blades_of_several_bodies_run_and_continue_bit_for_bit(several):
    """They start in the balance of those of one body, short and stiff as these are; a snapshot goes on bit for bit."""
    rows, simulator = several
    one, _ = motion(TRAINING, seconds=0.2)
    np.testing.assert_allclose(rows[0, [0, 1, 3]], one[0, [0, 1, 3]], rtol=0.01)
    assert simulator.structure.system.n_u == 7 + 3 * 4 * 5
    state = simulator.state()
    ahead = simulator.advance(1.0, pitch=0.03, generator_torque=25e3).values.copy()
    simulator.restore(state)
    again = simulator.advance(1.0, pitch=0.03, generator_torque=25e3).values
    np.testing.assert_array_equal(again, ahead)


@pytest.mark.slow
def test_more_bodies_converge():
    """The tip of the 15-MW turbine's blade, which bends far and twists: the change halves from doubling to doubling."""
    tips = [motion(replace(SEVERAL, blade_bodies=n), "iea_15mw", 0.2, 0.68)[0][0, 1] for n in (4, 8, 16)]
    assert abs(tips[2] - tips[1]) < 0.5 * abs(tips[1] - tips[0])
