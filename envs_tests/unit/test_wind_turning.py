"""A wind whose direction changes."""

import math

import numpy as np
import pytest

from wt_gym.base.errors import InflowError
from wt_gym.wind import SteadyInflow, TransientInflow, TurbulenceBox, TurbulentInflow, TurningInflow


def test_a_turned_wind_is_the_wind_from_there():
    """Against the misalignment that the steady wind itself can have, with shear; and a box of turbulence as a whole."""
    points = np.random.default_rng(1).uniform(-80.0, 80.0, (20, 3)) + np.array([0.0, 0.0, 100.0])
    angle = 0.4
    plain, own = (SteadyInflow(9.0, 90.0, shear_exponent=0.2, yaw_misalignment=a) for a in (0.0, angle))
    turned = TurningInflow(plain, [0.0], [angle])
    np.testing.assert_allclose(turned.velocity(points, 3.0), own.velocity(points, 3.0), atol=1e-12)
    box = TurbulenceBox.kaimal(9.0, 90.0, 126.0, "B", seed=1, grid=(5, 5), duration=60.0, cache=False)
    turned = TurningInflow(TurbulentInflow(box, plain), [0.0], [angle])
    np.testing.assert_allclose(turned.velocity(points, 3.0), TurbulentInflow(box, own).velocity(points, 3.0), atol=1e-9)


def test_direction_runs_in_straight_lines_and_stays():
    wind = TurningInflow(SteadyInflow(10.0), [10.0, 20.0], [0.0, 0.5])
    for time, angle in ((0.0, 0.0), (15.0, 0.25), (99.0, 0.5)):
        u, v, _ = wind.velocity([0.0, 0.0, 90.0], time)
        assert math.atan2(v, u) == pytest.approx(angle)
    assert (wind.mean_speed, wind.hub_height) == (10.0, SteadyInflow(10.0).hub_height)
    assert "from 0 to 29 deg" in wind.description


def test_wandering_has_its_deviation_and_memory():
    rng = np.random.default_rng(3)
    wind = TurningInflow.wandering(SteadyInflow(8.0), 0.3, 0.1, 60.0, 200_000.0, rng)
    deviation = wind.directions - 0.3
    assert deviation[0] == 0.0
    assert deviation.std() == pytest.approx(0.1, rel=0.05)
    lag = 20  # twenty steps are one time constant
    assert np.mean(deviation[lag:] * deviation[:-lag]) / 0.01 == pytest.approx(math.exp(-1.0), abs=0.07)


@pytest.mark.parametrize(
    ("times", "directions"), [([0.0, 1.0], [0.0]), ([1.0, 0.0], [0.0, 0.0]), ([0.0], [np.nan]), ([], [])]
)
def test_nonsense_is_refused(times, directions):
    with pytest.raises(InflowError, match="times"):
        TurningInflow(SteadyInflow(8.0), times, directions)


def test_a_point_that_is_not_finite_is_named():
    gust = TransientInflow.eog(10.0, 90.0, 126.0)
    with pytest.raises(InflowError, match="point 1 of 2"):
        TurningInflow(gust, [0.0], [0.1]).velocity([[0.0, 0.0, 90.0], [0.0, np.nan, 90.0]], 0.0)
