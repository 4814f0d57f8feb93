"""Wind for those who ask in every step: the same as that of everybody else."""

import math

import numpy as np
import pytest

from wt_gym.base.errors import InflowError
from wt_gym.wind import SteadyInflow, TransientInflow, TurbulenceBox, TurbulentInflow, TurningInflow
from wt_gym.wind.inflow import fill_velocity, read_only

POINTS = read_only(np.random.default_rng(0).uniform(5.0, 150.0, (40, 3)))


class Doubled(SteadyInflow):
    """One that has its own way to a velocity."""

    def velocity(self, points, time):
        return 2.0 * super().velocity(points, time)


class Slanted:
    """One that knows nothing of the package."""

    mean_speed, hub_height, description = 8.0, 90.0, "slanted"

    def velocity(self, points, time):
        return np.stack([8.0 + 0.01 * points[..., 2], np.sin(points[..., 1] + time), 0.0 * points[..., 0]], axis=-1)


def turbulent():
    box = TurbulenceBox.kaimal(8.0, 90.0, 126.0, "B", seed=1, grid=(3, 3), cache=False, duration=60.0)
    return TurbulentInflow(box, SteadyInflow(8.0, 90.0, shear_exponent=0.2))


@pytest.mark.parametrize(
    "inflow",
    [
        SteadyInflow(8.0, shear_exponent=0.2),
        TransientInflow.eog(12.0, 90.0, 126.0, start_time=1.0),
        turbulent(),
        TurningInflow(turbulent(), [0.0, 10.0], [0.0, 1.0]),
        Doubled(8.0),
        Slanted(),
    ],
    ids=lambda inflow: type(inflow).__name__,
)
def test_it_is_the_velocity(inflow):
    memory = np.full((60, 3), np.nan)
    fill_velocity(inflow, POINTS, 4.3, memory[:40])
    np.testing.assert_array_equal(memory[:40], inflow.velocity(POINTS, 4.3))
    assert np.isnan(memory[40:]).all()


def test_what_is_no_wind_is_refused():
    class Flat(Slanted):
        def velocity(self, points, time):
            return super().velocity(points, time)[..., 0]

    with pytest.raises(InflowError, match=r"shape \(40,\) at points of shape \(40, 3\)"):
        fill_velocity(Flat(), POINTS, 0.0, np.empty((40, 3)))
    astray = np.array([[0.0, 0.0, 90.0], [0.0, math.nan, 90.0]])
    with pytest.raises(InflowError, match="point 1 of 2"):
        fill_velocity(SteadyInflow(8.0), read_only(astray), 0.0, np.empty((2, 3)))
