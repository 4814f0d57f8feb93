"""Filters and sensor channels."""

import math

import numpy as np
import pytest

from wt_gym.base.quantities import wrapped
from wt_gym.control import Channel, LowPass, NacelleAnemometer
from wt_gym.control.sensors import to_fixed_frame
from wt_gym.envs.layout import ObservationLayout
from wt_gym.envs.observation_kernels import read_signals


def test_low_pass_step_response_is_exact():
    low_pass = LowPass(2.0)
    low_pass.reset(1.0)
    for _ in range(10):
        value = low_pass.update(3.0, 0.2)
    assert value == pytest.approx(3.0 - 2.0 * math.exp(-1.0), rel=1e-12)
    through = LowPass(0.0)
    through.reset(1.0)
    assert through.update(7.5, 0.2) == 7.5


def test_anemometer_measures_horizontal_speed_and_starts_steady():
    anemometer = NacelleAnemometer()
    assert anemometer.reset(3.0, 4.0, 0.1) == (5.0, 0.1)
    speed, direction = anemometer.update(6.0, 8.0, 0.2, 1.0)
    assert speed == pytest.approx(10.0 - 5.0 * math.exp(-1.0))
    assert direction == pytest.approx(0.2 - 0.1 * math.exp(-0.2))


@pytest.mark.parametrize("start", [0.0, 1.0, 3.1, -3.1])
def test_a_vane_is_filtered_around_the_circle(start):
    """What it reads moves with the wind, wherever the scale begins anew."""
    swings = 0.3 * np.sin(0.5 * np.arange(60))
    vanes = NacelleAnemometer(), NacelleAnemometer()
    vanes[0].reset(8.0, 0.0, 0.0)
    vanes[1].reset(8.0, 0.0, start)
    for swing in swings:
        (_, straight), (_, turned) = (
            vane.update(8.0, 0.0, wrapped(middle + swing), 0.2)
            for vane, middle in zip(vanes, (0.0, start), strict=True)
        )
        assert -math.pi <= turned < math.pi
        assert abs(wrapped(turned - start - straight)) < 1e-12


@pytest.mark.parametrize(
    ("angle", "wanted"), [(0.25, 0.25), (math.pi, -math.pi), (3.5, 3.5 - 2 * math.pi), (-20.0, -20.0 + 6 * math.pi)]
)
def test_angles_are_wrapped_to_half_a_turn(angle, wanted):
    assert wrapped(angle) == pytest.approx(wanted, abs=1e-15)


def test_what_is_observed_of_the_blades_are_the_coordinates_of_the_fixed_frame():
    random = np.random.default_rng(4)
    signals, parts = random.normal(size=20) * 1e6, np.array([0, 1, 2, 2, 0, 1])
    blades = random.permutation(20)[:18].reshape(6, 3)
    places, into, cyclic_into = np.array([19, 3]), np.array([7, 0]), np.arange(1, 7)
    for azimuth in random.uniform(0.0, 7.0, 50):
        values = np.full(8, np.nan)
        read_signals(signals, places, into, blades, parts, azimuth, cyclic_into, values)
        np.testing.assert_array_equal(values[[7, 0]], signals[[19, 3]])
        whole = to_fixed_frame(signals[blades], azimuth)
        np.testing.assert_array_equal(values[1:7], whole[np.arange(6), parts])


def test_an_observation_stays_within_its_bounds_after_rounding():
    random = np.random.default_rng(5)
    for _ in range(300):
        offset, scale, middle = random.normal(size=3) * 10.0 ** random.uniform(-6, 6, 3)
        reach = abs(random.normal()) * 10.0 ** random.uniform(-6, 6)
        low, high = middle - reach, middle + reach
        layout = ObservationLayout([Channel("x", "-", offset, abs(scale), low, high, 0.0, "")])
        for value in (low, high, np.nextafter(low, high), np.nextafter(high, low), -np.inf, np.inf, 2 * high + 1.0):
            observation, saturated = layout.normalize(np.array([value]))
            assert observation.dtype == np.float32
            assert layout.low <= observation <= layout.high
            assert bool(saturated) == (not low <= value <= high)
