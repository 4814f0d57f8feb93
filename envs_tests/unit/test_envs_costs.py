"""The clearance of the unloaded rotor, from which the margin of the tips is taken, against geometry."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from wt_gym.turbines import load_turbine
from wt_gym.turbines.variants import unloaded_clearance

# tilt, cone [deg], radius of the hub, length of the blade, prebend [m] as published (NREL/TP-500-38060, -5000-75698)
PUBLISHED = {"nrel_5mw": (5.0, 2.5, 1.5, 61.5, 0.0), "iea_15mw": (6.0, 4.0, 3.97, 117.0, 4.0)}


@pytest.mark.parametrize("name", PUBLISHED)
def test_unloaded_clearance_is_that_of_the_tip_turned_into_place(name):
    """The tip of the blade that points down, by rotations of cone, azimuth and tilt, from the tower at its height."""
    turbine = load_turbine(name)
    nacelle, tower = turbine.nacelle, turbine.tower
    tilt, cone, hub_radius, length, prebend = PUBLISHED[name]
    tip = Rotation.from_euler("Y", -cone, degrees=True).apply([-prebend, 0.0, hub_radius + length])
    tip = Rotation.from_euler("X", 180.0, degrees=True).apply(tip) - [nacelle.overhang, 0.0, 0.0]
    tip = Rotation.from_euler("Y", tilt, degrees=True).apply(tip)
    radius = 0.5 * tower.diameter_at(tower.length + nacelle.tower_top_to_shaft + tip[2])
    assert unloaded_clearance(turbine) == pytest.approx(np.hypot(tip[0], tip[1]) - radius, abs=1e-6)
