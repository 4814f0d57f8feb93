"""A wind whose mean speed follows a path: its means, its turbulence at each speed, and paths that are drawn."""

import copy
import pickle

import numpy as np
import pytest

from wt_gym.base.errors import InflowError
from wt_gym.wind import MirroredInflow, PathInflow, SteadyInflow, TurbulenceBox, TurbulentInflow
from wt_gym.wind.turbulent import speed_path

HUB = np.array([[0.0, 0.0, 90.0]])
PROFILE = SteadyInflow(1.0, 90.0, shear_exponent=0.2)


@pytest.fixture(scope="module")
def box():
    return TurbulenceBox.kaimal(12.0, 90.0, 126.0, "B", seed=3, duration=600.0, grid=(5, 5), cache=False)


def test_the_mean_follows_the_path_with_its_profile():
    wind = PathInflow([0.0, 100.0, 200.0], [0.0, 32.0, 8.0], PROFILE)
    heights = np.array([[0.0, 0.0, 90.0], [500.0, -30.0, 45.0]])
    for time, speed in ((-20.0, 0.0), (25.0, 8.0), (150.0, 20.0), (999.0, 8.0)):
        seen = wind.velocity(heights, time)
        steady = SteadyInflow(max(speed, 1e-3), 90.0, shear_exponent=0.2).velocity(heights, time)
        np.testing.assert_allclose(seen, steady, rtol=1e-12)
        assert wind.speed(time) == pytest.approx(speed)
    assert wind.start_speed == 0.0
    assert wind.mean_speed == pytest.approx(0.5 * (16.0 + 20.0))


def test_turbulence_on_a_constant_path_is_that_of_the_box_carried_along(box):
    """At one speed the path is the frozen field of `TurbulentInflow`, also upstream and down the tower."""
    points = np.array([[0.0, 0.0, 90.0], [40.0, 33.0, 61.0], [-55.0, -20.0, 130.0], [0.0, 0.0, 12.0]])
    steady = SteadyInflow(18.0, 90.0, shear_exponent=0.2)
    frozen = TurbulentInflow(box.carried_along(18.0, 1.3, "other"), steady, time_offset=40.0)
    wind = PathInflow([0.0, 600.0], [18.0, 18.0], PROFILE, box, [1.3, 1.3], offset=40.0 * 18.0)
    for time in (-3.0, 0.0, 12.34, 480.0):
        np.testing.assert_allclose(wind.velocity(points, time), frozen.velocity(points, time), atol=2e-5)


def test_a_lidar_sees_the_turbulence_of_the_box_on_its_way(box):
    """Turbulence changes on its way to the rotor as at the speed of the box."""
    ahead = np.array([[[-120.0, 0.0, 90.0], [-120.0, 30.0, 70.0]]])
    frozen = TurbulentInflow(box, SteadyInflow(12.0, 90.0, shear_exponent=0.2), time_offset=40.0)
    wind = PathInflow([0.0], [12.0], PROFILE, box, offset=40.0 * 12.0)
    seen = wind.velocity_ahead(ahead, 5.0, (120.0,))
    np.testing.assert_allclose(seen, frozen.velocity_ahead(ahead, 5.0, (120.0,)), atol=2e-5)
    assert np.abs(seen - wind.velocity(ahead, 5.0)).max() > 0.05


def test_the_air_comes_as_far_as_the_mean_carries_it(box):
    """Between knots the way is that of a uniform acceleration: the same place of the box at the same way."""
    rising = PathInflow([0.0, 50.0], [4.0, 24.0], PROFILE, box)
    way = 0.5 * (4.0 + 24.0) * 50.0
    still = PathInflow([0.0], [24.0], PROFILE, box, offset=way)
    np.testing.assert_allclose(rising.velocity(HUB, 50.0), still.velocity(HUB, 0.0), atol=1e-6)
    half = 4.0 * 25.0 + 0.5 * (20.0 / 50.0) * 25.0**2
    still = PathInflow([0.0], [14.0], PROFILE, box, offset=half)
    np.testing.assert_allclose(rising.velocity(HUB, 25.0), still.velocity(HUB, 0.0), atol=1e-6)


def test_the_spectrum_moves_with_the_speed(box):
    """Half of the variance lies below a frequency that is proportional to the mean speed."""

    def median_frequency(speed):
        duration = 7200.0 / speed  # once through the box
        times = np.linspace(0.0, duration, 4096, endpoint=False)
        wind = PathInflow([0.0], [speed], PROFILE, box)
        u = np.array([wind.velocity(HUB, t)[0, 0] for t in times]) - speed
        power = np.abs(np.fft.rfft(u)[1:]) ** 2
        return (1 + np.searchsorted(np.cumsum(power), 0.5 * power.sum())) / duration

    assert median_frequency(24.0) / median_frequency(8.0) == pytest.approx(3.0, rel=1e-3)


def test_a_mirror_image_and_copies_are_the_same_wind(box):
    wind = PathInflow([0.0, 60.0], [3.0, 30.0], PROFILE, box, [0.5, 2.0], offset=123.0)
    point = np.array([[10.0, 25.0, 100.0]])
    seen = wind.velocity(point, 31.0)
    mirrored = MirroredInflow.of(wind).velocity(point * [1.0, -1.0, 1.0], 31.0)
    assert np.array_equal(mirrored * [1.0, -1.0, 1.0], seen)
    for other in (copy.deepcopy(wind), pickle.loads(pickle.dumps(wind))):
        assert np.array_equal(other.velocity(point, 31.0), seen)


def test_a_calm_is_a_wind():
    wind = PathInflow([0.0, 10.0], [0.0, 0.0], PROFILE)
    assert np.abs(wind.velocity(HUB, 5.0)).max() < 2e-3


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"speeds": [1.0]}, "as many"),
        ({"times": [1.0, 1.0]}, "increase"),
        ({"speeds": [1.0, -0.1]}, "speeds of a path must lie between 0 and 200"),
        ({"scales": [1.0, np.nan]}, "scales of a path"),
        ({"profile": 8.0}, "SteadyInflow"),
        ({"box": 1}, "TurbulenceBox"),
    ],
)
def test_what_is_no_path_is_refused(change, message):
    given = {"times": [0.0, 1.0], "speeds": [3.0, 4.0], "profile": PROFILE} | change
    with pytest.raises(InflowError, match=message):
        PathInflow(**given)


def test_a_drawn_path_rises_and_falls_within_its_range_as_slowly_as_asked():
    for seed in range(20):
        times, speeds = speed_path(np.random.default_rng(seed), 0.0, 32.0, (200.0, 400.0), 1800.0, start=5.0)
        assert speeds[0] == 5.0
        assert times[-1] >= 1800.0
        assert 0.0 <= speeds.min() < 0.4 * 32.0
        assert 0.6 * 32.0 < speeds.max() <= 32.0
        # half cosines: pi/2 of the mean slope, which a short swing has in half the shortest time at least
        assert np.abs(np.diff(speeds)).max() <= 0.5 * np.pi * 32.0 / 200.0
    one, other = (speed_path(np.random.default_rng(seed), 0.0, 32.0, (200.0, 400.0), 600.0)[1] for seed in (1, 2))
    assert not np.array_equal(one, other)
