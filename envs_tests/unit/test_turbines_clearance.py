"""The clearance of an unloaded rotor against calculations by hand."""

import numpy as np
import pytest

from wt_gym.simulation.step.coupling_kernels import signed_clearance, view_from_tower
from wt_gym.simulation.turbine_structure import rotation_x, rotation_y
from wt_gym.turbines import load_turbine
from wt_gym.turbines.variants import unloaded_clearance


def test_of_a_straight_blade_by_hand():
    """NREL/TP-500-38060: overhang 5.01910 m, shaft 1.96256 m above the 87.6 m tower, tilt 5°, cone 2.5°, radius 63 m.

    a = -63 sin 2.5° = -2.74803, q = 63 cos 2.5° = 62.94004; x = 7.76713 cos 5° + q sin 5° = 13.22311;
    z = 1.96256 + 7.76713 sin 5° - q cos 5° = -60.06104, 27.53896 m above the base, where the tower of 6 to 3.87 m has a
    radius of 2.66520 m.
    """
    assert unloaded_clearance(load_turbine("nrel_5mw")) == pytest.approx(13.22311 - 2.66520, abs=2e-4)


def test_of_a_blade_with_prebend_by_hand():
    """IEA 15 MW: overhang 12.09757 m, shaft 4.34946 m above 129.386 m of tower, 6° tilt, 4° cone, 120.97 m, -4 m.

    a = -4 cos 4° - 120.97 sin 4° = -12.42870, q = -4 sin 4° + 120.97 cos 4° = 120.39629; x = 24.52627 cos 6° + q sin 6°
    = 36.97675; z = 4.34946 + 24.52627 sin 6° - q cos 6° = -112.82360, 16.5624 m above the base, where the diameter is
    10 - 0.074 (3.5624 / 13) = 9.97972 m. Without the prebend it would be 3.94 m less.
    """
    assert unloaded_clearance(load_turbine("iea_15mw")) == pytest.approx(36.97675 - 0.5 * 9.97972, abs=2e-4)


@pytest.mark.parametrize("name", ["nrel_5mw", "iea_15mw", "iea_22mw", "nrel_5mw_monopile"])
def test_of_the_same_tip_as_the_simulator_measures_it(name):
    """By matrices: tilt, half a turn, cone; then the kernel that gives the channel ``tip_clearance``."""
    turbine = load_turbine(name)
    nacelle, tower, blade = turbine.nacelle, turbine.tower, turbine.blade
    tilt, base, top = rotation_y(nacelle.tilt), np.array([0.0, 0.0, tower.base_height]), np.array([0, 0, tower.height])
    apex = top + [0.0, 0.0, nacelle.tower_top_to_shaft] + tilt @ [-nacelle.overhang, 0.0, 0.0]
    place = blade.axis_at(blade.length) + np.array([0.0, 0.0, blade.root_radius])
    tip = apex + tilt @ rotation_x(np.pi) @ rotation_y(-turbine.hub.cone) @ place
    view = np.zeros(4)
    stations, radii = tower.diameter_station, 0.5 * tower.diameter
    view_from_tower(tip, base, top.astype(float), np.array([1.0, 0.0, 0.0]), stations, radii, view)
    assert unloaded_clearance(turbine) == pytest.approx(signed_clearance(view), abs=1e-9)
