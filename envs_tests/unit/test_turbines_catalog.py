"""The turbines of the catalog against published numbers, the physics of their frames, plate and rod theory."""

import copy
import pickle
import subprocess
import sys

import numpy as np
import pytest

from wt_gym.base.errors import TurbineDefinitionError
from wt_gym.simulation.turbine_structure import tower_beam
from wt_gym.structure.modes import clamped_modes
from wt_gym.turbines import Turbine, catalog, load_turbine
from wt_gym.turbines.catalog import nada_data, plate_polar


@pytest.fixture(scope="module")
def nrel() -> Turbine:
    return load_turbine("nrel_5mw")


@pytest.fixture(scope="module")
def iea() -> Turbine:
    return load_turbine("iea_15mw")


def test_catalog_loads_and_caches():
    assert catalog() == (
        "gebhardt_45m", "iea_15mw", "iea_15mw_monopile", "iea_22mw", "nada_small", "nrel_5mw", "nrel_5mw_monopile",
        "oc4_nrel_5mw", "volturnus_iea_15mw",
    )  # fmt: skip
    for name in catalog():
        assert load_turbine(name) is load_turbine(name)


def test_importing_the_package_does_not_import_windio():
    code = "import sys, wt_gym.turbines; sys.exit('windIO' in sys.modules or 'xarray' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_nrel_mass_properties(nrel):
    """NREL/TP-500-38060, Table 2-2."""
    structure = nrel.blade.structure
    mass, first, second = (structure.mass_moment(k) for k in range(3))
    assert mass == pytest.approx(17740, rel=1e-6)
    assert first == pytest.approx(363231, rel=5e-3)
    assert second == pytest.approx(11776047, rel=5e-3)
    tower = nrel.tower.structure  # section 6; the table has 11 stations
    assert tower.mass_moment(0) == pytest.approx(347460, rel=1e-4)
    assert tower.mass_moment(1) / tower.mass_moment(0) == pytest.approx(38.234, rel=2e-3)


def test_nrel_numbers_outside_the_blade(nrel):
    d, n = nrel.drivetrain, nrel.nacelle
    assert d.rated_power / d.generator_efficiency == pytest.approx(5296610, rel=1e-6)
    rated_torque = d.rated_power / d.generator_efficiency / (d.rated_rotor_speed * d.gear_ratio)
    assert rated_torque == pytest.approx(43093.55, rel=1e-5)
    assert d.generator_inertia * d.gear_ratio**2 == pytest.approx(5025500, rel=1e-4)
    assert n.inertia[2, 2] + n.mass * n.cm[0] ** 2 == pytest.approx(2607890)
    apex = nrel.tower.height + n.tower_top_to_shaft + n.overhang * np.sin(n.tilt)
    assert (nrel.tower.height, n.overhang, apex) == pytest.approx((87.6, 5.0191, 90.0), abs=1e-3)
    assert (nrel.blade.damping_ratio, nrel.tower.damping_ratio) == (0.00477465, 0.01)
    assert nrel.pitch.max_rate == pytest.approx(np.radians(8))
    assert n.max_yaw_rate == pytest.approx(np.radians(0.3))
    assert [note for note in nrel.notes if not note.startswith("control: ")] == []  # nothing was assumed


def test_nrel_planform_at_its_stations(nrel):
    blade = nrel.blade
    z = blade.aero_station
    np.testing.assert_allclose(blade.chord_at(z), blade.chord, rtol=1e-12)
    np.testing.assert_allclose(blade.chord_at([14.35, 43.05]), [4.652, 3.01])
    np.testing.assert_allclose(np.degrees(blade.twist_at([0.0, 14.35])), [13.308, 11.48])
    np.testing.assert_allclose(blade.le_offset_at([20.0, 50.0]), 0.375, atol=2e-3)
    assert blade.le_offset_at(0.0) == pytest.approx(0.5)
    np.testing.assert_array_equal(blade.axis_at([0.0, 30.0])[:, :2], 0.0)
    for outside in (-0.1, 61.6, np.nan):
        with pytest.raises(TurbineDefinitionError, match=r"61\.5"):
            blade.chord_at(outside)


def test_polars_are_exact_at_airfoil_stations_and_linear_between(nrel):
    blade = nrel.blade
    for z, index in zip(blade.airfoil_station, blade.airfoil_index, strict=True):
        assert blade.polar_at(z) is blade.airfoils[index].polar
    a, b = blade.airfoil_station[8], blade.airfoil_station[10]  # DU25 to DU21 with a DU25 in between
    alpha = np.radians([-5.0, 3.0, 12.0])
    middle = 0.5 * (blade.airfoil_station[9] + b)
    mixed = blade.polar_at(middle).coefficients(alpha)
    for got, p, q in zip(
        mixed, blade.polar_at(a).coefficients(alpha), blade.polar_at(b).coefficients(alpha), strict=True
    ):
        np.testing.assert_allclose(got, 0.5 * (p + q), atol=1e-12)
    camber, slope = blade.camber_at(50.0, [0.0, 0.5, 1.0])
    assert camber[1] > 0.025
    assert slope[0] > 0.0 > slope[2]


def test_published_lift_of_the_outer_airfoil(nrel):
    cl, cd, _ = nrel.blade.polar_at(50.0).coefficients(np.radians(5.0))
    assert cl == pytest.approx(1.011, abs=2e-3)  # NACA64_A17 table at 5 deg
    assert 0.005 < cd < 0.008


def test_arrays_are_read_only_also_after_pickle_and_copy(nrel):
    for turbine in (nrel, pickle.loads(pickle.dumps(nrel)), copy.deepcopy(nrel)):
        for array in (turbine.blade.chord, turbine.blade.structure.stiffness, turbine.blade.airfoils[0].polar.cl):
            with pytest.raises(ValueError, match="read-only"):
                array[0] = 1.0
        with pytest.raises(AttributeError):
            turbine.name = "other"
        np.testing.assert_array_equal(turbine.blade.chord_at([1.0, 2.0]), nrel.blade.chord_at([1.0, 2.0]))


def test_iea_blade(iea):
    """IEA-15-240-RWT definition report: 117 m, 4 m prebend upwind; the 6x6 tables integrate to 66.9 t."""
    blade = iea.blade
    assert blade.length == pytest.approx(117.0)
    assert 66.5e3 < blade.structure.mass_moment(0) < 69e3
    assert blade.axis_at(117.0) == pytest.approx([-4.0, 0.0, 117.0])
    assert blade.structure.length == pytest.approx(117.0 + 0.15, abs=0.03)
    assert blade.station_at(117.0) == pytest.approx(blade.structure.length)
    assert not blade.structure.shear_rigid
    outer = blade.structure.station > 0.3 * blade.structure.length
    stiffness, inertia = blade.structure.stiffness[outer], blade.structure.inertia[outer]
    assert np.all(stiffness[:, 3, 3] > 1.5 * stiffness[:, 4, 4])
    assert np.all(inertia[:, 2, 3] > 0.0)
    assert np.all(inertia[:, 3, 3] > inertia[:, 4, 4])


def test_iea_thickness_blend_follows_the_table(iea):
    blade = iea.blade
    thickness = [blade.airfoils[i].relative_thickness for i in blade.airfoil_index]
    assert thickness[0] == 1.0
    assert thickness[-1] == pytest.approx(0.211, abs=1e-3)
    assert np.all(np.diff(thickness) < 1e-9)


def test_iea_nacelle_tower_and_drivetrain(iea):
    """Numbers of the ElastoDyn and ServoDyn files of the reference model."""
    assert iea.nacelle.overhang == pytest.approx(12.097571763912535)
    assert iea.nacelle.tower_top_to_shaft == pytest.approx(4.349459414248071, rel=1e-6)
    assert iea.drivetrain.generator_efficiency == pytest.approx(0.95756, abs=1e-5)
    assert iea.drivetrain.generator_inertia == pytest.approx(1836784, rel=1e-6)
    assert iea.tower.structure.mass_moment(0) == pytest.approx(853463, rel=1e-3)
    assert (iea.tower.base_height, iea.tower.height, iea.hub_height) == (15.0, 144.386, 150.0)
    assert iea.rated_wind_speed == pytest.approx(10.59, rel=5e-3)
    tt = iea.nacelle.inertia + iea.nacelle.mass * (
        iea.nacelle.cm @ iea.nacelle.cm * np.eye(3) - np.outer(iea.nacelle.cm, iea.nacelle.cm)
    )
    np.testing.assert_allclose(np.diag(tt), [21487147.94, 39542087.73, 27479914.07], rtol=1e-6)
    assert any("monopile" in note for note in iea.notes)


@pytest.mark.parametrize("name", ["nrel_10mw", "no/such/file.yaml", "", 5])
def test_unknown_turbine_names_the_catalog(name):
    with pytest.raises(TurbineDefinitionError, match=r"iea_15mw.*nrel_5mw"):
        load_turbine(name)


NADA, NADA_DATA = load_turbine("nada_small"), nada_data()


def test_masses_of_nada():
    """Copper rod ρ A L; strip ρ t c L of mean chord 37.5 mm; all on the tower top together 0.25 kg."""
    tower, blade = NADA.tower.structure, NADA.blade.structure
    mass = np.trapezoid(tower.inertia[:, 0, 0], tower.station)
    assert mass == pytest.approx(NADA_DATA["computed"]["tower_mass_kg"], rel=2e-3)
    strip = np.trapezoid(blade.inertia[:, 0, 0], blade.station)
    assert strip == pytest.approx(1200.0 * 0.002 * 0.0375 * 0.22, rel=1e-12)
    assert NADA.nacelle.mass + NADA.hub.mass + 3 * strip == pytest.approx(0.25)


@pytest.mark.parametrize(("top", "name"), [(0.0, "bare_tower_bending_Hz"), (0.25, "tower_with_top_mass_Hz")])
def test_frequencies_of_the_rod(top, name):
    """Euler–Bernoulli, computed independently of this package."""
    mass = np.zeros((6, 6))
    mass[:3, :3] = top * np.eye(3)
    found = clamped_modes(tower_beam(NADA.tower, 12), 3, tip_mass=mass, node_dofs=(0, 4)).frequency
    np.testing.assert_allclose(found, NADA_DATA["computed"][name], rtol=5e-3)


def test_the_strip_bends_across_its_flat_side():
    """In its own axes E c t³/12 and E t c³/12 are the principal stiffnesses of every section, at its twist."""
    structure, z = NADA.blade.structure, NADA.blade.aero_station
    chord, twist = NADA.blade.chord_at(z), NADA.blade.twist_at(z)
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
