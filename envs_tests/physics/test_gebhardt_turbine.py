"""The stand-in for the turbine of Gebhardt et al. 2012: masses, frequencies, degrees of freedom, torque balance."""

import numpy as np
import pytest

from envs_tests.physics.cases.gebhardt import RPM, boundary_layer, make_simulator, published, simulate
from wt_gym.structure.beam import Beam, BeamSections
from wt_gym.structure.modes import clamped_modes
from wt_gym.turbines.catalogue import GENERATOR_DAMPER, gebhardt_data, gebhardt_turbine

STAND_IN = gebhardt_data()["stand_in"]
PITCH = np.radians(12.7)
"""At which the rotor turns at the published 7.4 rpm in 15 m/s (gradient height)."""


def beam_frequencies(structure, n_elements):
    """Lowest frequencies [Hz] of a straight clamped beam."""
    axis = np.column_stack([0.0 * structure.station, 0.0 * structure.station, structure.station])
    beam = Beam(BeamSections(structure.station, structure.stiffness, structure.inertia, axis), n_elements)
    return clamped_modes(beam, 4).frequency


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
    found = beam_frequencies(gebhardt_turbine().blade.structure, 21)
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
    run = simulate(make_simulator(15.0, rpm, formulation="embedded"), PITCH, 0.5, rpm * RPM)
    assert np.all(np.isfinite(run.flap))
    np.testing.assert_allclose(run.speed / RPM, rpm, rtol=0.02)
    assert run.power.mean() == pytest.approx(power, rel=0.03)
    # prismatic cantilever under the generator's moment, M L²/2EI; the weight on top adds about a tenth
    tower = STAND_IN["tower"]
    lean = GENERATOR_DAMPER * run.speed.mean() * 68.0**2 / (2.0 * tower["EI_Nm2"])
    assert run.side_side.mean() == pytest.approx(-1.1 * lean, rel=0.2)
