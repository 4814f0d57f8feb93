"""Winds seen in a mirror."""

from dataclasses import replace

import numpy as np
import pytest

from wt_gym.base.errors import InflowError
from wt_gym.wind import MirroredInflow, SteadyInflow, TransientInflow, TurbulenceBox, TurbulentInflow
from wt_gym.wind.inflow import fill_velocity, read_only, velocity_ahead

MIRROR = np.array([1.0, -1.0, 1.0])
STEADY = SteadyInflow(11.0, 90.0, shear_exponent=0.2, veer=0.002, yaw_misalignment=0.3, inclination=0.1)
POINTS = np.random.default_rng(2).uniform([-200.0, -60.0, 40.0], [200.0, 60.0, 140.0], (3, 40, 3))


class Plain:
    """An inflow that is no `PointInflow`."""

    mean_speed, hub_height, description = 11.0, 90.0, "plain"

    def velocity(self, points, time):
        return STEADY.velocity(points, time)


def box():
    return TurbulenceBox.kaimal(11.0, 90.0, 126.0, "B", seed=1, grid=(5, 5), cache=False)


@pytest.mark.parametrize("make", [lambda: STEADY, lambda: TurbulentInflow(box(), STEADY, 3.0), Plain])
def test_the_image_has_the_reflected_velocity_at_the_reflected_point(make):
    inflow = make()
    image = MirroredInflow(inflow)
    np.testing.assert_array_equal(image.velocity(POINTS, 2.5), inflow.velocity(POINTS * MIRROR, 2.5) * MIRROR)
    rows, out = read_only(POINTS.reshape(-1, 3)), np.empty((120, 3))
    fill_velocity(image, rows, 2.5, out)
    np.testing.assert_array_equal(out.reshape(POINTS.shape), image.velocity(POINTS, 2.5))
    distances = (60.0, 120.0, 180.0)
    expected = velocity_ahead(inflow, POINTS * MIRROR, 2.5, distances) * MIRROR
    np.testing.assert_array_equal(velocity_ahead(image, POINTS, 2.5, distances), expected)
    assert MirroredInflow.of(MirroredInflow.of(inflow)) is inflow


def test_the_image_of_a_steady_wind_has_its_angles_on_the_other_side():
    other = replace(STEADY, veer=-STEADY.veer, yaw_misalignment=-STEADY.yaw_misalignment)
    np.testing.assert_allclose(MirroredInflow(STEADY).velocity(POINTS, 0.0), other.velocity(POINTS, 0.0), atol=1e-14)


def test_it_says_what_the_inner_inflow_says():
    gust = TransientInflow.ecd(12.0, 90.0, 126.0, start_time=0.5)
    image = MirroredInflow(gust)
    assert (image.mean_speed, image.hub_height, image.start_speed) == (gust.mean_speed, 90.0, gust.start_speed)
    assert image.description == f"{gust.description}, mirrored"
    with pytest.raises(InflowError):
        MirroredInflow(TurbulentInflow(box(), STEADY)).require_cover(90.0, 300.0)
    with pytest.raises(InflowError, match="finite"):
        image.velocity([0.0, np.nan, 90.0], 0.0)
