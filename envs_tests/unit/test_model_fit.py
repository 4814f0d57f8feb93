"""Fit of a linear controller's model: plants that answer more strongly or later are told by their gain and lag."""

import numpy as np
import pytest

from wt_gym.control.controllers.linear_optimal import FIT_TIME, ModelFit

STEP = 0.1


def course(steps=3000, seed=1):
    """What a model explains: smooth noise, fine enough for a delay of a part of a step."""
    rng = np.random.default_rng(seed)
    time = np.arange(-50, steps + 50) * STEP
    frequencies, phases = rng.uniform(0.3, 3.0, (40, 1)), rng.uniform(0.0, 6.28, (40, 1))

    def at(when):
        return np.sin(frequencies * when + phases).sum(0)

    return time[50:-50], at


@pytest.mark.parametrize(("gain", "lag"), [(0.0, 0.0), (0.25, 0.0), (-0.25, 0.0), (0.0, 0.1), (0.0, -0.05), (0.2, 0.1)])
def test_gain_and_lag_of_a_plant_are_found(gain, lag):
    time, at = course()
    explained = at(time)
    disturbance = (1.0 + gain) * at(time - lag) - explained
    fit = ModelFit(1, STEP)
    for d, y in zip(disturbance, explained, strict=True):
        fit.update(np.array([d]), np.array([y]))
    frequency = 2.0  # of most of the changes [rad/s]: a lag takes (w tau)^2 / 2 off the gain
    assert fit.values[0] == pytest.approx(gain, abs=(frequency * lag) ** 2 + 0.01)
    assert fit.values[1] == pytest.approx((1.0 + gain) * lag, abs=0.01 + 0.1 * abs(lag))


def test_without_an_effect_there_is_no_fit_and_a_start_forgets():
    fit = ModelFit(2, STEP)
    rng = np.random.default_rng(3)
    for _ in range(100):
        fit.update(rng.normal(size=2), np.zeros(2))
    np.testing.assert_array_equal(fit.values, 0.0)
    for _ in range(100):
        fit.update(*rng.normal(size=(2, 2)))
    assert fit.values.any()
    fit.start()
    np.testing.assert_array_equal(fit.values, 0.0)


def test_changes_begin_anew_after_a_gap():
    """A jump between intervals that are not neighbors is no change within one."""
    time, at = course(400)
    plain, gapped = ModelFit(1, STEP), ModelFit(1, STEP)
    for k, y in enumerate(at(time)):
        plain.update(np.array([0.2 * y]), np.array([y]))
        gapped.update(np.array([0.2 * y + 50.0 * (k >= 200)]), np.array([y]), passed=5 if k == 200 else 1)
    assert gapped.values[0] == pytest.approx(plain.values[0], abs=0.01)


def test_the_window_forgets():
    fit, (time, at) = ModelFit(1, STEP), course(round(8.0 * FIT_TIME / STEP))
    explained = at(time)
    for k, y in enumerate(explained):
        fit.update(np.array([(0.4 if k < len(explained) // 4 else 0.1) * y]), np.array([y]))
    assert fit.values[0] == pytest.approx(0.1, abs=0.01)
