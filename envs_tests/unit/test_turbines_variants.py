"""Turbines that turn counter-clockwise, their mirror image, and the clearance of an unloaded rotor by hand."""

from dataclasses import replace

import numpy as np
import pytest

from wt_gym.base.errors import TurbineDefinitionError
from wt_gym.control.controllers.additions import SideSideDamper
from wt_gym.control.rotor import rotor_table
from wt_gym.simulation.contract import fingerprint
from wt_gym.turbines import load_turbine
from wt_gym.turbines.variants import clockwise_image, mirrored, unloaded_clearance
from wt_gym.turbines.windio_writer import require_same, write_windio

CLOCKWISE = load_turbine("nrel_5mw")
OTHER = load_turbine("nrel_5mw", rotation="counter-clockwise")


def lopsided(turbine):
    """A turbine whose nacelle and tower know left and right, in every number that can."""
    rng = np.random.default_rng(3)
    root = rng.normal(size=(6, 6))
    coupling = 0.05 * (root @ root.T) / np.abs(root @ root.T).max()
    table, nacelle = turbine.tower.structure, turbine.nacelle
    size = np.sqrt(np.where(np.isinf(table.stiffness), 1.0, table.stiffness).diagonal(axis1=1, axis2=2))
    coupled = (
        table.stiffness
        + np.where(np.isinf(table.stiffness[0]).any(axis=0), 0.0, 1.0)
        * np.where(np.isinf(table.stiffness[0]).any(axis=1)[:, None], 0.0, coupling)
        * size[:, :, None]
        * size[:, None, :]
    )
    skewed = nacelle.inertia + 0.1 * nacelle.inertia[0, 0] * (1.0 - np.eye(3))
    return replace(
        turbine,
        nacelle=replace(nacelle, cm=nacelle.cm + np.array([0.0, 0.8, 0.0]), inertia=skewed),
        tower=replace(turbine.tower, structure=replace(table, stiffness=coupled)),
    )


def test_rotation_is_clockwise_unless_it_is_given():
    assert CLOCKWISE.rotation == "clockwise"
    assert OTHER.rotation == "counter-clockwise"
    assert load_turbine("nrel_5mw", rotation="clockwise") is CLOCKWISE
    with pytest.raises(TurbineDefinitionError, match=r"rotation must be one of clockwise, .* got 'left'"):
        load_turbine("nrel_5mw", rotation="left")
    turbine = CLOCKWISE.with_site(rotation="counter-clockwise")
    assert turbine.rotation == "counter-clockwise"


def test_it_is_written_beside_the_windio_file(tmp_path):
    written = write_windio(OTHER, tmp_path / "turbine.yaml")
    require_same(OTHER, load_turbine(written[0]))
    written[1].unlink()
    assert load_turbine(written[0]).rotation == "clockwise"  # windIO has no key for it


def test_the_image_of_the_image_is_the_turbine():
    for turbine in (lopsided(CLOCKWISE), load_turbine("nrel_5mw_monopile")):
        assert fingerprint(mirrored(mirrored(turbine))) == fingerprint(turbine)
        assert fingerprint(clockwise_image(mirrored(turbine))) == fingerprint(turbine)
        assert clockwise_image(turbine) is turbine


def test_a_turbine_that_is_alike_on_both_sides_is_its_own_image_but_for_the_rotation():
    assert fingerprint(mirrored(CLOCKWISE)) == fingerprint(OTHER) != fingerprint(CLOCKWISE)


def test_energies_of_the_image_are_those_of_the_turbine():
    """Bending to one side, of the image to the other, takes the same energy, and so does a turn."""
    turbine = lopsided(CLOCKWISE)
    image, rng = mirrored(turbine), np.random.default_rng(0)
    turn = rng.normal(size=3)
    inertia, reflected = turbine.nacelle.inertia, image.nacelle.inertia
    pseudovector = turn * [-1.0, 1.0, -1.0]
    assert pseudovector @ reflected @ pseudovector == pytest.approx(turn @ inertia @ turn, rel=1e-12)
    assert image.nacelle.cm.tolist() == [turbine.nacelle.cm[0], -turbine.nacelle.cm[1], turbine.nacelle.cm[2]]
    strain = np.array([0.0, 0.0, 1e-3, 2e-3, -1e-3, 3e-3])  # the sections do not shear
    other = strain * [1.0, -1.0, 1.0, -1.0, 1.0, -1.0]
    for matrix, seen in ((turbine.tower.structure, image.tower.structure),):
        stiffness, its = (np.where(np.isinf(m.stiffness), 0.0, m.stiffness) for m in (matrix, seen))
        np.testing.assert_allclose(other @ its @ other, strain @ stiffness @ strain, rtol=1e-12)
        assert np.abs(stiffness - its).max() > 1e-3 * np.abs(stiffness).max()


def test_rules_for_the_rotor_are_those_of_the_clockwise_turbine():
    assert rotor_table(CLOCKWISE.with_site(rotation="counter-clockwise")) is rotor_table(CLOCKWISE)
    assert SideSideDamper(OTHER).gain == -SideSideDamper(CLOCKWISE).gain


def test_clearance_of_a_blade_with_prebend_by_hand():
    """IEA 15 MW: overhang 12.09757 m, shaft 4.34946 m above 129.386 m of tower, 6° tilt, 4° cone, 120.97 m, -4 m.

    a = -4 cos 4° - 120.97 sin 4° = -12.42870, q = -4 sin 4° + 120.97 cos 4° = 120.39629; x = 24.52627 cos 6° + q sin 6°
    = 36.97675; z = 4.34946 + 24.52627 sin 6° - q cos 6° = -112.82360, 16.5624 m above the base, where the diameter is
    10 - 0.074 (3.5624 / 13) = 9.97972 m. Without the prebend it would be 3.94 m less.
    """
    assert unloaded_clearance(load_turbine("iea_15mw")) == pytest.approx(36.97675 - 0.5 * 9.97972, abs=2e-4)
