"""The catalogue's turbine of Nada & Al-Shahrani 2019: numbers of its data, plate theory, rod theory."""

import numpy as np
import pytest

from wt_gym.simulation.turbine_structure import tower_beam
from wt_gym.structure.modes import clamped_modes
from wt_gym.turbines import catalogue, load_turbine
from wt_gym.turbines.catalogue import nada_data, nada_speed, plate_polar

TURBINE, DATA = load_turbine("nada_small"), nada_data()
STAND_IN = DATA["stand_in"]


def test_the_catalogue_knows_it():
    assert "nada_small" in catalogue()


def test_sizes_are_those_of_the_data():
    assert TURBINE.rotor_diameter == pytest.approx(0.5)
    assert TURBINE.hub_height == pytest.approx(0.6)
    assert TURBINE.tower.diameter.tolist() == [0.01, 0.01]
    assert TURBINE.nacelle.overhang == STAND_IN["hub"]["overhang_m"]
    assert TURBINE.blade.chord_at(np.array([0.0, 0.22])) == pytest.approx([0.05, 0.025])
    assert np.degrees(TURBINE.blade.twist_at(np.array([0.0, 0.22]))) == pytest.approx([18.0, 2.0])


def test_masses():
    """Copper rod ρ A L; strip ρ t c L of mean chord 37.5 mm; all on the tower top together 0.25 kg."""
    tower, blade = TURBINE.tower.structure, TURBINE.blade.structure
    mass = np.trapezoid(tower.inertia[:, 0, 0], tower.station)
    assert mass == pytest.approx(DATA["computed"]["tower_mass_kg"], rel=2e-3)
    strip = np.trapezoid(blade.inertia[:, 0, 0], blade.station)
    assert strip == pytest.approx(1200.0 * 0.002 * 0.0375 * 0.22, rel=1e-12)
    assert TURBINE.nacelle.mass + TURBINE.hub.mass + 3 * strip == pytest.approx(0.25)


@pytest.mark.parametrize(("top", "name"), [(0.0, "bare_tower_bending_Hz"), (0.25, "tower_with_top_mass_Hz")])
def test_frequencies_of_the_rod(top, name):
    """Euler–Bernoulli, computed independently of this package."""
    mass = np.zeros((6, 6))
    mass[:3, :3] = top * np.eye(3)
    found = clamped_modes(tower_beam(TURBINE.tower, 12), 3, tip_mass=mass, node_dofs=(0, 4)).frequency
    np.testing.assert_allclose(found, DATA["computed"][name], rtol=5e-3)


def test_the_strip_bends_across_its_flat_side():
    """In its own axes E c t³/12 and E t c³/12 are the principal stiffnesses of every section, at its twist."""
    structure, z = TURBINE.blade.structure, TURBINE.blade.aero_station
    chord, twist = TURBINE.blade.chord_at(z), TURBINE.blade.twist_at(z)
    bending = structure.stiffness[:, 3:5, 3:5]
    values = np.linalg.eigvalsh(bending)
    np.testing.assert_allclose(values[:, 0], 3e9 * chord * 0.002**3 / 12.0, rtol=1e-9)
    np.testing.assert_allclose(values[:, 1], 3e9 * 0.002 * chord**3 / 12.0, rtol=1e-9)
    # a moment along the chord meets the soft stiffness; feathering, about -z, turns the trailing edge from y towards x
    chordwise = np.column_stack([np.sin(twist), np.cos(twist)])
    along = np.einsum("ni,nij,nj->n", chordwise, bending, chordwise)
    np.testing.assert_allclose(along, values[:, 0], rtol=1e-9)


def test_polar_of_a_plate():
    """2 π per radian and no moment about the quarter chord when attached; Hoerner's 1.98 across; even and odd parts."""
    polar = plate_polar(np.radians(8.0), np.radians(1.0), 0.0)
    lift, drag, moment = polar.coefficients(np.radians([-2.0, 2.0, 90.0, 178.0]))
    assert lift[1] == pytest.approx(2.0 * np.pi * np.radians(2.0), rel=0.01)
    assert drag[1] == pytest.approx(lift[1] * np.tan(np.radians(2.0)), rel=1e-6)
    assert lift[0] == pytest.approx(-lift[1])
    assert drag[0] == pytest.approx(drag[1])
    assert abs(moment[1]) < 1e-3
    assert drag[2] == pytest.approx(1.0 / (0.222 + 0.283), rel=1e-6)
    assert moment[2] == pytest.approx(-0.25 * drag[2], rel=1e-6)
    assert moment[3] == pytest.approx(-0.5 * 2.0 * np.pi * np.sin(np.radians(2.0)), rel=0.01)


def test_rated_is_the_test():
    drive = TURBINE.drivetrain
    assert nada_speed() == 160.0
    assert drive.rated_power == pytest.approx(drive.generator_damping * 160.0**2)
    assert TURBINE.rated_wind_speed == DATA["published"]["test_wind_speed_m_s"] == 8.0
