"""Courses of the demanded power: within their span, repeated by the seed, of the spectrum that they should have."""

import copy
import math

import numpy as np
import pytest

from wt_gym.envs.options import EnvOptions, GridOptions
from wt_gym.envs.options.grid import REFERENCE_KINDS
from wt_gym.envs.power_reference import (
    DRAWN,
    FAST,
    RAMP_RATE,
    REGULATION_STEP,
    SLOW,
    PowerReference,
    PowerReferenceDraws,
    regulation_signal,
)
from wt_gym.envs.rewards import available_power
from wt_gym.envs.wind_sampler import EpisodeWind
from wt_gym.turbines import load_turbine
from wt_gym.wind import SteadyInflow

TURBINE = load_turbine("nrel_5mw")


def drawn(kind, seed=0, speed=14.0, wind_seed=3, **options):
    draws = PowerReferenceDraws(TURBINE, GridOptions(reference=kind, **options))
    wind = EpisodeWind(SteadyInflow(speed, 90.0), speed, wind_seed, 0.0)
    return draws.draw(np.random.default_rng(seed), wind)


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
    slopes = np.diff(ramps.powers) / np.diff(ramps.times)
    np.testing.assert_allclose(np.abs(slopes[1::2]), RAMP_RATE * 5e6)
    np.testing.assert_allclose(slopes[::2], 0.0)


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
    chosen = PowerReferenceDraws(TURBINE, GridOptions(reference="reserve"))
    wind = EpisodeWind(SteadyInflow(14.0, 90.0), 14.0, 3, 0.0)
    assert chosen.draw(np.random.default_rng(0), wind, rows).at(15.0) == 4e6
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
        ({"reference": [[0.0, 1.0], [-1.0, 2.0]]}, "times that do not fall"),
        ({"reference": [[0.0, -1.0]]}, "powers that are not negative"),
        ({"reference": 4e6}, "got 4000000.0"),
        ({"reference": [[0.0, math.nan]]}, "finite rows"),
        ({"level": 1.2}, "power_reference_level must be a number or a range"),
        ({"level": (0.9, 0.8)}, "power_reference_level"),
        ({"level": "high"}, "power_reference_level"),
        ({"level": (0.8, 0.9), "span": 0.2}, "power_reference_span must be at least 0 and keep"),
        ({"span": -0.1}, "power_reference_span"),
        ({"interval": 0.5}, "power_reference_interval must be at least 1 s"),
    ],
)
def test_what_has_no_meaning_is_refused(given, message):
    with pytest.raises(ValueError, match=message):
        GridOptions(**given)
