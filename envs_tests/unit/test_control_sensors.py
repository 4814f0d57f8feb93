"""Filters and sensor channels."""

import math

import pytest

from wt_gym.control import Channel, LowPass, NacelleAnemometer


def test_low_pass_step_response_is_exact():
    low_pass = LowPass(2.0)
    low_pass.reset(1.0)
    for _ in range(10):
        value = low_pass.update(3.0, 0.2)
    assert value == pytest.approx(3.0 - 2.0 * math.exp(-1.0), rel=1e-12)


def test_zero_time_constant_passes_through():
    low_pass = LowPass(0.0)
    low_pass.reset(1.0)
    assert low_pass.update(7.5, 0.2) == 7.5


def test_anemometer_measures_horizontal_speed_and_starts_steady():
    anemometer = NacelleAnemometer()
    assert anemometer.reset(3.0, 4.0, 0.1) == (5.0, 0.1)
    speed, direction = anemometer.update(6.0, 8.0, 0.2, 1.0)
    assert speed == pytest.approx(10.0 - 5.0 * math.exp(-1.0))
    assert direction == pytest.approx(0.2 - 0.1 * math.exp(-0.2))


def test_impossible_sensors_are_refused():
    with pytest.raises(ValueError, match="must not be negative"):
        LowPass(-1.0)
    with pytest.raises(ValueError, match="scale > 0"):
        Channel("speed", "m/s", 0.0, 0.0, 0.0, 1.0, 0.0, "")
