"""Courses of the demanded power: within their span, repeated by the seed, of the spectrum that they should have."""

import copy
import math

import numpy as np
import pytest

from wt_gym.envs.options import EnvOptions
from wt_gym.envs.power import available_power
from wt_gym.envs.power_reference import (
    DRAWN,
    FAST,
    RAMP_RATE,
    REFERENCE_KINDS,
    REGULATION_STEP,
    SLOW,
    GridOptions,
    PowerReference,
    PowerReferenceTerm,
    regulation_signal,
)
from wt_gym.envs.wind_sampler import EpisodeWind
from wt_gym.turbines import load_turbine
from wt_gym.wind import SteadyInflow

TURBINE = load_turbine("nrel_5mw")


def drawn(kind, seed=0, speed=14.0, wind_seed=3, **options):
    draws = PowerReferenceTerm(TURBINE, GridOptions(reference=kind, **options))
    wind = EpisodeWind(SteadyInflow(speed, 90.0), speed, wind_seed, 0.0)
    return draws.drawn(np.random.default_rng(seed), wind)


@pytest.mark.parametrize("kind", REFERENCE_KINDS)
@pytest.mark.parametrize("speed", [9.0, 14.0])
def test_courses_stay_within_their_span_of_a_level_of_what_the_wind_allows(kind, speed):
    full = available_power(TURBINE, speed)
    for seed in range(5):
        course = drawn(kind, seed, speed, level=(0.7, 0.8), span=0.15)
        values = np.array([course.at(time) for time in np.arange(-5.0, 1.2 * DRAWN, 0.7)])
        assert course.kind == kind
        assert 0.55 * full <= values.min() + 1e-6
        assert values.max() <= 0.95 * full + 1e-6
        assert (np.ptp(values) == 0.0) == (kind == "reserve")
        assert values[0] == course.powers[0]
        assert values[-1] == course.powers[-1]


def test_the_seed_and_the_wind_decide():
    assert drawn("regulation", 1) == drawn("regulation", 1)
    assert drawn("regulation", 1) != drawn("regulation", 2)
    assert drawn("regulation", 1) != drawn("regulation", 1, wind_seed=4)
    kinds = {drawn(REFERENCE_KINDS, seed).kind for seed in range(40)}
    assert kinds == set(REFERENCE_KINDS)
    course = drawn("steps")
    assert copy.deepcopy(course) is course


def test_steps_step_and_ramps_ramp():
    steps, ramps = drawn("steps", interval=10.0), drawn("ramps", interval=10.0)
    times = np.array(steps.times)
    assert set(np.diff(times)[1::2]) == {0.0}
    assert np.diff(times)[::2].min() >= 5.0
    assert np.diff(times)[::2].max() <= 15.0
    at = steps.times[2]
    assert steps.at(at) == steps.powers[2] != steps.at(at - 1e-6) == steps.powers[1]
    slopes = np.diff(ramps.powers) / np.diff(ramps.times) / (RAMP_RATE * 5e6)
    np.testing.assert_allclose(np.abs(slopes), np.abs(slopes).round(), atol=1e-9)
    assert set(np.abs(slopes).round()) == {0.0, 1.0}


@pytest.mark.parametrize("kind", ["steps", "ramps"])
def test_beginnings_are_an_interval_apart(kind):
    """Also of ramps that take longer than that: at most 20 s for 20 % of rated power."""
    course = drawn(kind, interval=8.0)
    times, powers = np.array(course.times), np.array(course.powers)
    moving = np.flatnonzero(np.diff(powers) != 0.0)
    begins = times[moving]
    assert np.diff(begins).min() >= 4.0 - 1e-9
    assert np.diff(begins).max() <= 12.0 + 1e-9
    assert np.diff(begins).mean() == pytest.approx(8.0, rel=0.04)
    assert (np.diff(times) >= 0.0).all()


def test_a_span_counts_for_courses_that_have_one():
    assert 0.0 < drawn("reserve", speed=0.0).powers[0] < 0.02 * 5e6  # in a calm
    assert drawn("reserve", level=0.95).powers[0] == pytest.approx(0.95 * 5e6)
    assert GridOptions(reference=[[0.0, 1.5e6]], level=0.25).level == (0.25, 0.25)
    assert GridOptions(reference="steps", level=0.6, span=0.4).span == 0.4  # 0.6 - 0.4 is below 0.2 as a number
    draws = PowerReferenceTerm(TURBINE, GridOptions(reference=[[0.0, 1.5e6]], level=0.25))
    wind = EpisodeWind(SteadyInflow(14.0, 90.0), 14.0, 3, 0.0)
    with pytest.raises(ValueError, match=r"power_reference_span must keep the course within 0\.2 and 1, got 0\.1"):
        draws.drawn(np.random.default_rng(0), wind, "steps")


def test_the_mean_share_is_that_of_the_courses():
    for speed in (8.0, 14.0):
        draws = PowerReferenceTerm(TURBINE, GridOptions(reference="reserve", level=(0.6, 0.8)))
        courses = [drawn("reserve", seed, speed, level=(0.6, 0.8)).powers[0] for seed in range(200)]
        assert draws.mean_share(speed) == pytest.approx(np.mean(courses) / 5e6, rel=0.02)
    draws = PowerReferenceTerm(TURBINE, GridOptions(reference=[[0.0, 2e6], [9.0, 4e6]]))
    assert draws.mean_share(8.0) == draws.mean_share(14.0) == pytest.approx(0.6)


def test_regulation_has_its_power_between_its_corners_and_asks_for_no_energy():
    signals = np.array([regulation_signal(np.random.default_rng(seed))[1] for seed in range(40)])
    assert np.abs(signals).max() == 1.0
    assert 0.35 < signals.std() < 0.5
    power = (np.abs(np.fft.rfft(signals - signals.mean(axis=1, keepdims=True))) ** 2).mean(axis=0)
    rate = 2.0 * math.pi * np.fft.rfftfreq(signals.shape[1], REGULATION_STEP)
    between = power[(rate > SLOW) & (rate < FAST)].mean()
    assert power[rate > 4.0 * FAST].mean() < 0.02 * between
    assert power[(rate > 0.0) & (rate < 0.3 * SLOW)].mean() < 0.5 * between
    quarters = signals[:, : 4 * (signals.shape[1] // 4)].reshape(40, 4, -1).mean(axis=2)
    assert quarters.std() < 0.15


def test_courses_of_the_user(tmp_path):
    rows = [[0.0, 4e6], [10.0, 4e6], [10.0, 3e6], [20.0, 5e6]]
    file = tmp_path / "course.csv"
    file.write_text("time_s,power_w\n" + "\n".join(f"{t},{p}" for t, p in rows), encoding="utf-8")
    for given in (rows, np.array(rows), str(file), file):
        course = drawn(given)
        assert isinstance(course, PowerReference)
        assert [course.at(t) for t in (-1.0, 5.0, 10.0, 15.0, 99.0)] == [4e6, 4e6, 3e6, 4e6, 5e6]
    chosen = PowerReferenceTerm(TURBINE, GridOptions(reference="reserve"))
    wind = EpisodeWind(SteadyInflow(14.0, 90.0), 14.0, 3, 0.0)
    assert chosen.drawn(np.random.default_rng(0), wind, rows).at(15.0) == 4e6
    file.write_text("time,power\n1,a\n", encoding="utf-8")
    with pytest.raises(ValueError, match="must hold rows of time"):
        drawn(str(file))
    options = EnvOptions(grid=GridOptions(reference=rows))
    again = EnvOptions.from_json(options.to_json())
    assert again.grid.reference == options.grid.reference == tuple(map(tuple, rows))


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"reference": "step"}, "did you mean 'steps'"),
        ({"reference": []}, "power_reference must be among reserve, steps, ramps, regulation, a .csv file"),
        ({"reference": [[0.0, 4e6], [1.0, 0.0]]}, "powers above 0 W, got 0 W"),
        ({"reference": [[0.0, math.nan]]}, "finite rows"),
        ({"reference": "steps", "level": 0.3, "span": 0.11}, "power_reference_span must keep"),
    ],
)
def test_wrong_references_are_refused(given, message):
    with pytest.raises(ValueError, match=message):
        GridOptions(**given)
