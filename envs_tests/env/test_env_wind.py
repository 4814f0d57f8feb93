"""The wind of an episode."""

import warnings

import numpy as np
import pytest

from wt_gym.base.errors import InflowError
from wt_gym.envs import EVALUATION_WIND_SEEDS, TRAINING_WIND_SEEDS
from wt_gym.envs.wind_sampler import GUSTS, WindOptions, WindSampler
from wt_gym.turbines import load_turbine
from wt_gym.wind import SteadyInflow, TransientInflow
from wt_gym.wind.iec import turbulence_sigma

TURBINE = load_turbine("nrel_5mw")


def deviation(samples):
    """Standard deviation of the straight lines between samples of a periodic series without mean."""
    samples = samples.astype(float)
    after = np.roll(samples, -1)
    return np.sqrt(((samples**2 + samples * after + after**2) / 3.0).mean())


def test_evaluation_seeds_are_held_back():
    assert set(TRAINING_WIND_SEEDS).isdisjoint(EVALUATION_WIND_SEEDS)
    sampler = WindSampler(TURBINE, WindOptions("turbulent", (6.0, 18.0)))
    rng = np.random.default_rng(0)
    drawn = {sampler.sample(rng).wind_seed for _ in range(60)}
    assert drawn <= set(TRAINING_WIND_SEEDS)
    assert len(drawn) > 10


@pytest.mark.parametrize("speed", [12.0, 9.0])
def test_turbulence_has_the_standard_deviation_of_its_speed(speed):
    sampler = WindSampler(TURBINE, WindOptions("turbulent", speed, turbulence_class="B"))
    wind = sampler.sample(np.random.default_rng(0), wind_seed=5)
    assert wind.time_offset == 0.0
    box = wind.inflow.box
    assert box.duration >= 600.0
    assert box.mean_speed == wind.inflow.mean_speed == speed
    hub = box.scale * box.fluctuation[:, box.fluctuation.shape[1] // 2, box.fluctuation.shape[2] // 2, 0]
    assert deviation(hub) == pytest.approx(turbulence_sigma(speed, "B"), rel=1e-3)
    # The eddies are those of the box made at 12 m/s: the same length, carried along at another speed.
    assert box.time_step * speed == pytest.approx(0.25 * 12.0)


@pytest.mark.parametrize("speed", [12.0, 20.0])
def test_extreme_turbulence_is_the_same_field_at_its_own_standard_deviation(speed):
    winds = {}
    for model in ("NTM", "ETM"):
        sampler = WindSampler(TURBINE, WindOptions("turbulent", speed, turbulence_model=model))
        box = sampler.sample(np.random.default_rng(0), wind_seed=5).inflow.box
        winds[model] = box.scale * box.fluctuation
    normal, extreme = (turbulence_sigma(speed, "B", model, "I") for model in ("NTM", "ETM"))
    assert extreme > 1.3 * normal
    np.testing.assert_allclose(winds["ETM"], winds["NTM"] * extreme / normal, rtol=1e-5, atol=1e-6)


def test_winds_of_one_seed_share_their_samples():
    """A pool of winds is held once in memory, whatever the speeds and intensities of the episodes."""
    samplers = [WindSampler(TURBINE, WindOptions("turbulent", speed)) for speed in (12.0, 9.0, 7.5)]
    samplers.append(WindSampler(TURBINE, WindOptions("turbulent", 12.0, turbulence_model="ETM")))
    boxes = [sampler.sample(np.random.default_rng(0), wind_seed=5).inflow.box for sampler in samplers]
    assert all(np.shares_memory(box.fluctuation, boxes[0].fluctuation) for box in boxes)
    assert len({box.scale for box in boxes}) == 4


@pytest.mark.parametrize(("years", "factor"), [(50, 1.0), (1, 0.8)])
def test_extreme_winds_are_those_of_the_class(years, factor):
    # class I: reference speed 50 m/s
    steady = WindSampler(TURBINE, WindOptions("extreme", (6.0, 18.0), return_period=years))
    wind = steady.sample(np.random.default_rng(0))
    assert steady.options == ()
    assert wind.wind_speed == pytest.approx(1.4 * 50.0 * factor)
    speed = wind.inflow.velocity(np.array([[0.0, 0.0, 45.0]]), 0.0)[0, 0]
    assert speed == pytest.approx(1.4 * 50.0 * factor * 0.5**0.11)
    gusty = WindSampler(TURBINE, WindOptions("extreme-turbulent", None, seeds=(3,), return_period=years))
    wind = gusty.sample(np.random.default_rng(0))
    assert (gusty.options, gusty.seeds) == (("wind_seed", "time_offset"), (3,))
    assert (wind.wind_speed, wind.wind_seed) == (pytest.approx(50.0 * factor), 3)
    samples = wind.inflow.box.scale * wind.inflow.box.fluctuation
    hub = samples[:, samples.shape[1] // 2, samples.shape[2] // 2, 0]
    assert deviation(hub) == pytest.approx(0.11 * 50.0 * factor, rel=1e-3)
    with pytest.raises(InflowError, match="follows from the turbine's class"):
        gusty.sample(np.random.default_rng(0), wind_speed=30.0)


@pytest.mark.parametrize("exponent", [0.0, 0.3])
def test_gusts_stand_on_the_shear_asked_for(exponent):
    sampler, kinds = WindSampler(TURBINE, WindOptions("gusts", 10.0, shear_exponent=exponent)), set()
    rng = np.random.default_rng(0)
    for _ in range(20):
        inflow = sampler.sample(rng).inflow
        kinds.add(inflow.kind)
        speed = inflow.velocity(np.array([[0.0, 0.0, 90.0], [0.0, 0.0, 45.0]]), 0.0)[:, 0]
        np.testing.assert_allclose(speed, [10.0, 10.0 * 0.5**exponent], rtol=1e-9)
    assert len(kinds) == 5


def kind_of(wind):
    """Short name of a gust."""
    return wind.inflow.kind[:3] if isinstance(wind.inflow, TransientInflow) else "ETM"


def draw_gusts(n=40, **kwargs):
    sampler = WindSampler(TURBINE, WindOptions("gusts", 10.0, seeds=(5, 6), **kwargs))
    return [sampler.sample(np.random.default_rng(seed)) for seed in range(n)]


@pytest.mark.parametrize("gusts", [("EOG",), ("ECD", "ETM"), GUSTS])
def test_gusts_are_those_that_are_named(gusts):
    winds = draw_gusts(gusts=gusts)
    assert {kind_of(wind) for wind in winds} == set(gusts)
    assert {wind.wind_seed for wind in winds if kind_of(wind) == "ETM"} == ({5, 6} if "ETM" in gusts else set())
    assert {wind.wind_seed for wind in winds if kind_of(wind) != "ETM"} <= {-1}


def test_gusts_follow_from_the_seed_and_not_from_the_order_of_their_names():
    told = [[wind.inflow.description for wind in draw_gusts(gusts=gusts)] for gusts in (GUSTS, GUSTS, GUSTS[::-1])]
    assert told[0] == told[1] == told[2]
    assert len(set(told[0])) > 20


def test_extreme_turbulence_among_gusts_is_that_of_turbulent_wind():
    """Its seed and its time are drawn, and can be fixed; transients know neither."""
    sampler = WindSampler(TURBINE, WindOptions("gusts", 10.0, gusts=("ETM",), seeds=(5,)))
    alone = WindSampler(TURBINE, WindOptions("turbulent", 10.0, turbulence_model="ETM", seeds=(5,)))
    winds = [one.sample(np.random.default_rng(3)) for one in (sampler, alone)]
    points = np.array([[0.0, 0.0, 90.0], [0.0, 20.0, 60.0]])
    assert winds[0].time_offset == winds[1].time_offset > 0.0
    np.testing.assert_array_equal(*(wind.inflow.velocity(points, 7.0) for wind in winds))
    assert (sampler.options, sampler.seeds) == (alone.options, (5,))
    fixed = sampler.sample(np.random.default_rng(3), wind_seed=6)
    assert (fixed.wind_seed, fixed.time_offset) == (6, 0.0)
    mixed = WindSampler(TURBINE, WindOptions("gusts", 10.0, gusts=("EOG", "ETM")))
    held_back = {mixed.sample(np.random.default_rng(seed), wind_seed=1001).wind_seed for seed in range(12)}
    assert held_back == {-1, 1001}
    with pytest.raises(InflowError, match="belong to turbulent wind"):
        WindSampler(TURBINE, WindOptions("gusts", 10.0)).sample(np.random.default_rng(0), wind_seed=5)


def test_draws_fill_the_range_and_fixing_one_leaves_the_others():
    sampler = WindSampler(TURBINE, WindOptions("turbulent", (6.0, 18.0)))
    free = sampler.sample(np.random.default_rng(4))
    fixed = sampler.sample(np.random.default_rng(4), wind_speed=10.0)
    assert (fixed.wind_speed, fixed.wind_seed) == (10.0, free.wind_seed)
    sampler, rng = WindSampler(TURBINE, WindOptions("steady", (6.0, 18.0))), np.random.default_rng(0)
    speeds = np.array([sampler.sample(rng).wind_speed for _ in range(300)])
    assert 6.0 <= speeds.min() < 6.5
    assert 17.5 < speeds.max() <= 18.0
    assert speeds.mean() == pytest.approx(12.0, abs=0.5)


def test_an_inflow_of_ones_own_is_used_as_it_is():
    inflow = SteadyInflow(9.0, veer=0.001)
    sampler = WindSampler(TURBINE, WindOptions(inflow, None))
    wind = sampler.sample(np.random.default_rng(0))
    assert wind.inflow is inflow
    assert (wind.wind_speed, wind.wind_seed) == (9.0, -1)
    with pytest.raises(InflowError, match="inflow of its own"):
        sampler.sample(np.random.default_rng(0), wind_speed=10.0)
    with pytest.raises(InflowError, match="'steady' is an option of the environment"):  # once: did you mean 'steady'?
        sampler.given("steady")


@pytest.mark.parametrize(
    ("kind", "kwargs", "message"),
    [
        ("gusty", {"speed": 10.0}, "'steady', 'turbulent'"),
        ("steady", {"speed": -1.0}, "between 0 and 50 m/s"),
        ("turbulent", {"speed": 0.0}, "do not pass in still air"),
        ("steady", {"speed": 10.0, "turbulence_model": "ETM"}, "belongs to the inflows 'turbulent' and 'path'"),
        ("turbulent", {"speed": 10.0, "gusts": ("EOG",)}, "belongs to inflow='gusts'"),
        ("gusts", {"speed": 10.0, "turbulence": "mann"}, "'gusts' with ETM"),
        ("steady", {"speed": 10.0, "return_period": 1}, "belongs to the inflows"),
        ("steady", {"speed": 10.0, "wander": (0.1, 0.5)}, "at least 1 s"),
    ],
)
def test_impossible_winds_are_refused(kind, kwargs, message):
    with pytest.raises(InflowError, match=message):
        WindSampler(TURBINE, WindOptions(kind, **kwargs))


@pytest.mark.parametrize("drawn", [False, True])
def test_a_mean_speed_at_another_height_is_a_warning(drawn):
    def kind(height):
        inflow = SteadyInflow(9.0, height, shear_exponent=0.2)
        return (lambda rng: inflow) if drawn else [inflow]

    with pytest.warns(UserWarning, match="holds at 10 m, the hub of NREL.* is at 90 m"):
        WindSampler(TURBINE, WindOptions(kind(10.0), None)).sample(np.random.default_rng(0))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        WindSampler(TURBINE, WindOptions(kind(90.5), None)).sample(np.random.default_rng(0))


def test_only_turbulent_wind_has_known_seeds():
    assert WindSampler(TURBINE, WindOptions("turbulent", 10.0, seeds=[3, 4])).seeds == (3, 4)
    steady = WindSampler(TURBINE, WindOptions("steady", 10.0))
    assert steady.seeds == ()
    assert WindSampler(TURBINE, WindOptions(SteadyInflow(9.0), None)).seeds is None
    with pytest.raises(InflowError, match="belong to turbulent wind"):
        steady.sample(np.random.default_rng(0), wind_seed=1)
