"""The wind of an episode."""

import warnings

import numpy as np
import pytest

from wt_gym.envs import EVALUATION_WIND_SEEDS, TRAINING_WIND_SEEDS
from wt_gym.envs.wind_sampler import WindSampler
from wt_gym.errors import InflowError
from wt_gym.turbines import load_turbine
from wt_gym.wind import SteadyInflow
from wt_gym.wind.iec import turbulence_sigma

TURBINE = load_turbine("nrel_5mw")


def test_evaluation_seeds_are_held_back():
    assert set(TRAINING_WIND_SEEDS).isdisjoint(EVALUATION_WIND_SEEDS)
    sampler = WindSampler(TURBINE, "turbulent", (6.0, 18.0))
    rng = np.random.default_rng(0)
    drawn = {sampler.sample(rng).wind_seed for _ in range(60)}
    assert drawn <= set(TRAINING_WIND_SEEDS)
    assert len(drawn) > 10


def test_speeds_fill_the_range():
    sampler = WindSampler(TURBINE, "steady", (6.0, 18.0))
    rng = np.random.default_rng(0)
    speeds = np.array([sampler.sample(rng).wind_speed for _ in range(300)])
    assert speeds.min() < 6.5
    assert speeds.max() > 17.5
    assert speeds.mean() == pytest.approx(12.0, abs=0.5)


def test_profile_has_the_shear_asked_for():
    wind = WindSampler(TURBINE, "steady", 10.0, shear_exponent=0.2).sample(np.random.default_rng(0))
    speed = wind.inflow.velocity(np.array([[0.0, 0.0, 90.0], [0.0, 0.0, 45.0]]), 0.0)[:, 0]
    np.testing.assert_allclose(speed, [10.0, 10.0 * 0.5**0.2], rtol=1e-9)


@pytest.mark.parametrize("speed", [12.0, 9.0])
def test_turbulence_has_the_standard_deviation_of_its_speed(speed):
    sampler = WindSampler(TURBINE, "turbulent", speed, turbulence_class="B")
    wind = sampler.sample(np.random.default_rng(0), wind_seed=5)
    assert wind.time_offset == 0.0
    box = wind.inflow.box
    assert box.duration >= 600.0
    assert box.mean_speed == wind.inflow.mean_speed == speed
    hub = box.fluctuation[:, box.fluctuation.shape[1] // 2, box.fluctuation.shape[2] // 2, 0]
    assert hub.std() == pytest.approx(turbulence_sigma(speed, "B"), rel=1e-3)
    # The eddies are those of the box made at 12 m/s: the same length, carried along at another speed.
    assert box.time_step * speed == pytest.approx(0.25 * 12.0)


def test_fixing_one_draw_leaves_the_others():
    sampler = WindSampler(TURBINE, "turbulent", (6.0, 18.0))
    free = sampler.sample(np.random.default_rng(4))
    fixed = sampler.sample(np.random.default_rng(4), wind_speed=10.0)
    assert (fixed.wind_speed, fixed.wind_seed) == (10.0, free.wind_seed)


def test_an_inflow_of_ones_own_is_used_as_it_is():
    inflow = SteadyInflow(9.0, veer=0.001)
    sampler = WindSampler(TURBINE, inflow, None)
    wind = sampler.sample(np.random.default_rng(0))
    assert wind.inflow is inflow
    assert (wind.wind_speed, wind.wind_seed) == (9.0, -1)
    with pytest.raises(InflowError, match="inflow of its own"):
        sampler.sample(np.random.default_rng(0), wind_speed=10.0)


@pytest.mark.parametrize(
    ("kind", "kwargs", "message"),
    [
        ("gusty", {"wind_speed": 10.0}, "'steady', 'turbulent'"),
        ("steady", {"wind_speed": 2.0}, "cut-in"),
        ("steady", {"wind_speed": (12.0, 8.0)}, "low <= high"),
        ("steady", {"wind_speed": (6.0, 8.0, 10.0)}, "pair"),
        ("steady", {"wind_speed": "fast"}, "number"),
        ("turbulent", {"wind_speed": 10.0, "turbulence_class": "E"}, "turbulence_class"),
        ("turbulent", {"wind_speed": 10.0, "wind_seeds": ()}, "at least one"),
        ("turbulent", {"wind_speed": 10.0, "wind_seeds": (1.5,)}, "integer"),
    ],
)
def test_impossible_winds_are_refused(kind, kwargs, message):
    with pytest.raises(InflowError, match=message):
        WindSampler(TURBINE, kind, **kwargs)


@pytest.mark.parametrize("drawn", [False, True])
def test_a_mean_speed_at_another_height_is_a_warning(drawn):
    def kind(height):
        inflow = SteadyInflow(9.0, height, shear_exponent=0.2)
        return (lambda rng: inflow) if drawn else [inflow]

    with pytest.warns(UserWarning, match="holds at 10 m, the hub of NREL.* is at 90 m"):
        WindSampler(TURBINE, kind(10.0), None).sample(np.random.default_rng(0))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        WindSampler(TURBINE, kind(90.5), None).sample(np.random.default_rng(0))


def test_only_turbulent_wind_has_known_seeds():
    assert WindSampler(TURBINE, "turbulent", 10.0, wind_seeds=[3, 4]).seeds == (3, 4)
    assert WindSampler(TURBINE, "steady", 10.0).seeds == ()
    assert WindSampler(TURBINE, SteadyInflow(9.0), None).seeds is None


def test_steady_wind_has_no_seed():
    with pytest.raises(InflowError, match="belong to turbulent wind"):
        WindSampler(TURBINE, "steady", 10.0).sample(np.random.default_rng(0), wind_seed=1)
