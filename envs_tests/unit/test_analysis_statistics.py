"""Interquartile mean, stratified bootstrap, loads over a life and changes wind by wind, against numbers by hand."""

import math
from dataclasses import replace

import numpy as np
import pytest
import xarray as xr
from scipy import stats

from wt_gym.analysis.metrics import METRICS
from wt_gym.analysis.results import Evaluation, Run, Wind
from wt_gym.analysis.statistics import (
    N_RESAMPLES,
    Estimate,
    WindClimate,
    bootstrap_interval,
    change_in_winds,
    interquartile_mean,
    level_of,
    lifetime,
    lifetime_change,
    lifetime_load,
    paired_change,
    shared_winds,
    wind_weights,
)
from wt_gym.analysis.summary import format_estimate, results_table, verdict
from wt_gym.base.errors import InflowError


def test_interquartile_mean_is_the_mean_of_the_middle_half():
    values = np.random.default_rng(0).normal(size=(7, 20))
    np.testing.assert_allclose(interquartile_mean(values), stats.trim_mean(values, 0.25, axis=1))
    np.testing.assert_allclose(interquartile_mean(values.T, axis=0), interquartile_mean(values))


def mean_interval(values, strata, **options):
    return bootstrap_interval(lambda k: values[k].mean(axis=-1), strata, **options)


def test_differences_between_strata_make_no_interval():
    values = np.array([1.0, 5.0, 1.0, 5.0, 1.0, 5.0])  # all scatter is between the wind speeds
    assert mean_interval(values, (8.0, 12.0) * 3) == (3.0, 3.0)
    assert mean_interval(values, (8.0,) * 6)[0] < 2.0


def test_interval_of_a_bootstrap_that_is_known_exactly():
    # of {0, 1} the mean is 0, 1/2 or 1 with probability 1/4, 1/2, 1/4
    values = np.array([0.0, 1.0])
    assert mean_interval(values, (8.0, 8.0)) == (0.0, 1.0)
    assert mean_interval(values, (8.0, 8.0), level=0.2) == (0.5, 0.5)


@pytest.mark.parametrize(("strata", "freedom"), [((8.0,) * 6, 5), ((8.0,) * 3 + (12.0,) * 5, 6)])
def test_expanded_percentiles_are_those_of_students_t(strata, freedom):
    """The statistic of a resample is its number: quantiles of 0 to N - 1 are the percentiles themselves."""
    smallest = min(strata.count(label) for label in strata)
    low, high = bootstrap_interval(lambda k: np.arange(len(k), dtype=float), strata, level=0.9)
    percentile = stats.norm.cdf(math.sqrt(smallest / (smallest - 1)) * stats.t.ppf(0.05, freedom))
    assert low / (N_RESAMPLES - 1) == pytest.approx(percentile, rel=1e-9)
    assert high / (N_RESAMPLES - 1) == pytest.approx(1.0 - percentile, rel=1e-9)


def test_an_interval_needs_two_values():
    with pytest.raises(ValueError, match=r"at least two values in each stratum, got \[1, 2\]"):
        mean_interval(np.zeros(3), (8.0, 12.0, 12.0))


def test_weights_of_the_wind_speeds():
    climate = WindClimate.of_class("II")
    assert climate.mean_speed == 8.5
    assert climate.scale == pytest.approx(8.5 * 2 / math.sqrt(math.pi))  # Rayleigh

    def share(low, high):  # with exp(-pi/4 (v / mean)^2), as IEC 61400-1 writes it
        return math.exp(-math.pi / 4 * (low / 8.5) ** 2) - math.exp(-math.pi / 4 * (high / 8.5) ** 2)

    expected = np.array([share(3, 10), share(10, 14), share(14, 25)]) / share(3, 25)
    np.testing.assert_allclose(wind_weights(climate, [8.0, 12.0, 16.0]), expected, rtol=1e-12)
    assert wind_weights(climate, [12.0]) == [1.0]
    weibull = WindClimate(9.0, shape=1.7)
    assert weibull.share_below(11.0) == pytest.approx(stats.weibull_min.cdf(11.0, 1.7, scale=weibull.scale))
    assert stats.weibull_min.mean(1.7, scale=weibull.scale) == pytest.approx(9.0)
    edges = stats.weibull_min.cdf([3.0, 8.25, 16.75, 25.0], 1.7, scale=weibull.scale)
    found = wind_weights(weibull, [8.0, 8.5, 25.0])  # neighbors may be near, and the outermost at the end
    np.testing.assert_allclose(found, np.diff(edges) / (edges[-1] - edges[0]), rtol=1e-12)


def test_climates_without_meaning_are_refused():
    with pytest.raises(InflowError, match="turbine_class must be one of 'I', 'II', 'III'; got 'V'"):
        WindClimate.of_class("V")
    for arguments, message in (
        ({"mean_speed": 0.0}, "mean_speed of a wind climate must be positive and finite, got 0"),
        ({"shape": 0.01}, "shape of a wind climate must lie in 0.5 to 10.0, got 0.01"),
        ({"shape": 1e3}, "shape of a wind climate must lie in"),
        ({"mean_speed": 1e-300}, r"winds between cut-in and cut-out, 3 to 25 m/s, for 0.001 of the time"),
        ({"mean_speed": 1e300}, "winds between cut-in and cut-out"),
        ({"cut_in": -0.5}, r"0 <= cut-in < cut-out is needed, got -0.5 and 25.0 m/s"),
    ):
        with pytest.raises(ValueError, match=message):
            WindClimate(**{"mean_speed": 8.5} | arguments)
    for speeds in ([12.0, 8.0], [], [12.0, 30.0]):
        with pytest.raises(ValueError, match="ascend from cut-in 3 m/s to cut-out 25 m/s, got"):
            wind_weights(WindClimate(10.0), speeds)


def test_load_over_a_life():
    rows = lifetime_load(np.array([[2.0, 3.0], [0.0, 5.0], [0.0, 0.0]]), np.array([0.25, 0.75]), 4.0)
    assert rows == pytest.approx([(0.25 * 16 + 0.75 * 81) ** 0.25, 5.0 * 0.75**0.25, 0.0])
    large = lifetime_load(np.array([2e40, 3e40]), np.array([0.25, 0.75]), 10.0)
    assert large == pytest.approx(1e40 * (0.25 * 2**10 + 0.75 * 3**10) ** 0.1)


WINDS = tuple(Wind(speed, seed) for speed in (10.0, 14.0) for seed in (1001, 1002, 1003, 1004))
MEAN = {key: 1.0 / metric.factor for key, metric in METRICS.items()} | {"overspeed_count": 0.0}


def evaluation(changes, key="blade_flap_del", ending="time", climate=None):
    """Baseline whose metric differs from wind to wind, and an agent with these relative changes."""
    data = xr.Dataset({}, {"time": [0.0, 1.0]})
    runs = []
    for k, (wind, change) in enumerate(zip(WINDS, changes, strict=True)):
        base = (2.0 + k) * MEAN[key]
        for agent, value in (("Baseline", base), ("PPO", base * (1.0 + change))):
            over = ending if agent == "PPO" and k == 0 else "time"
            runs.append(Run(agent, wind, data, MEAN | {key: value}, 0.0, {}, 60.0, 60.0, over))
    return Evaluation("Turbine", {}, runs, "Baseline", climate=climate)


CHANGES = np.array([-0.5, -0.22, -0.2, -0.18, -0.16, -0.14, -0.12, 0.3])


SPEEDS = tuple(wind.speed for wind in WINDS)


def test_changes_are_taken_wind_by_wind():
    change = paired_change(evaluation(CHANGES), "PPO", "blade_flap_del")
    assert change.value == pytest.approx(CHANGES[2:6].mean())
    assert (change.relative, change.n_winds) == (True, 8)
    interval = bootstrap_interval(lambda k: interquartile_mean(CHANGES[k]), SPEEDS)
    assert (change.low, change.high) == pytest.approx(interval)
    at_speed = paired_change(evaluation(CHANGES), "PPO", "blade_flap_del", 10.0)
    assert at_speed.value == pytest.approx(CHANGES[1:3].mean())
    # of power every wind counts, with its yield: the baseline's wind k has 2 + k
    power = paired_change(evaluation(CHANGES, "corrected_power"), "PPO", "corrected_power")
    assert power.value == pytest.approx(np.average(CHANGES, weights=2.0 + np.arange(8)))


GAINED = 1e3 * np.array([0.0, 0.1, 0.2, 0.4, 0.6, 0.9, 1.6, 4.2])


@pytest.mark.parametrize(
    ("key", "base", "mine", "relative", "change"),
    [
        # of pitch travel 0.1 deg is the least that is shown
        ("pitch_travel", math.radians(0.095), math.radians(0.2), False, 0.2 - 0.095),
        ("pitch_travel", math.radians(0.105), math.radians(0.2), True, 0.2 / 0.105 - 1.0),
        ("mean_power", 500.0, 500.0 + GAINED, False, 1e-3),  # the mean of all eight, in MW
        ("corrected_power", -3e3, -1.5e3, True, 0.5),  # an idle turbine draws half as much: that is gained
    ],
)
def test_changes_of_small_and_negative_values(key, base, mine, relative, change):
    result = change_in_winds(key, np.broadcast_to(mine, 8), np.broadcast_to(base, 8), SPEEDS)
    assert result.relative is relative
    assert result.value == pytest.approx(change)


def test_missing_metrics_are_not_compared():
    whole = evaluation(np.zeros(8), climate=WindClimate(10.0))
    lacking = [replace(run, metrics={}) if run.agent == "PPO" else run for run in whole.runs]
    assert paired_change(replace(whole, runs=lacking), "PPO", "blade_flap_del") is None
    assert level_of(replace(whole, runs=lacking), "PPO", "blade_flap_del") is None
    still = [replace(run, metrics=run.metrics | {"blade_flap_del": 0.0}) for run in whole.runs]
    assert lifetime(replace(whole, runs=still), "Baseline", "blade_flap_del") == 0.0
    assert lifetime_change(replace(whole, runs=still), "PPO", "blade_flap_del") is None


@pytest.mark.parametrize(("seeds", "has"), [(2, False), (3, True)])
def test_too_few_winds_have_no_interval(seeds, has):
    whole = evaluation(CHANGES)
    few = replace(whole, runs=[run for run in whole.runs if run.wind.seed <= 1000 + seeds])
    assert paired_change(few, "PPO", "blade_flap_del").has_interval == has


def test_winds_that_were_lost_are_left_out():
    lost = evaluation(CHANGES, ending="overspeed", climate=WindClimate(10.0))
    assert shared_winds(lost, "PPO") == list(WINDS[1:])
    assert paired_change(lost, "PPO", "blade_flap_del").n_winds == 7
    assert lifetime(lost, "PPO", "blade_flap_del") is None
    assert lifetime_change(lost, "PPO", "blade_flap_del") is None
    assert lifetime(lost, "Baseline", "blade_flap_del") > 0.0
    assert verdict(lost, "PPO").kind == "lost"


def test_lifetime_of_several_seeds():
    climate = WindClimate(10.0)
    result = evaluation(np.full(8, -0.1), climate=climate)
    slow, fast = wind_weights(climate, [10.0, 14.0])
    loads = [(2.0 + k) * 1e6 for k in range(8)]
    expected = (slow * np.mean(np.power(loads[:4], 10)) + fast * np.mean(np.power(loads[4:], 10))) ** 0.1
    assert lifetime(result, "Baseline", "blade_flap_del") == pytest.approx(expected)
    change = lifetime_change(result, "PPO", "blade_flap_del")
    assert (change.value, change.low, change.high) == pytest.approx((-0.1, -0.1, -0.1))
    assert change.relative
    assert "lifetime | PPO" in results_table(result)[-1]
    assert lifetime(replace(result, climate=None), "Baseline", "blade_flap_del") is None


def test_levels_are_means_in_the_unit_shown():
    level = level_of(evaluation(np.zeros(8), "pitch_duty_cycle"), "PPO", "pitch_duty_cycle", 14.0)
    assert level.value == pytest.approx(np.mean([6.0, 7.0, 8.0, 9.0]))
    assert level.low < level.value < level.high
    assert not level.relative


@pytest.mark.parametrize(
    ("estimate", "key", "kind", "text"),
    [
        (Estimate(-0.184, -0.2, -0.16, True, 6), "blade_flap_del", "better", "\u221218.4 % [\u221220.0, \u221216.0]"),
        (Estimate(-0.05, -0.2, 0.1, True, 6), "blade_flap_del", "open", "\u22125.0 % [\u221220.0, +10.0]"),
        (Estimate(0.005, 0.001, 0.008, True, 6), "blade_flap_del", "equal", "+0.5 % [+0.1, +0.8]"),
        (Estimate(3.4, 3.0, 4.0, True, 6), "pitch_travel", "worse", "\u00d7 4.4 [4.0, 5.0]"),
        (Estimate(-1e-5, -2e-5, 2e-5, True, 6), "corrected_power", "equal", "0.0 % [0.0, 0.0]"),
        (Estimate(1.5, math.nan, math.nan, False, 1), "pitch_travel", "worse", "+1.5 deg"),
        (Estimate(-0.19, math.nan, math.nan, True, 4), "blade_flap_del", "better", "\u221219.0 %"),
        (Estimate(0.0, 0.0, 0.0, False, 6), "yaw_travel", "equal", "="),
        (Estimate(0.5, 0.4, 0.6, True, 6), "rotor_speed_mean", "none", "+50.0 % [+40.0, +60.0]"),
    ],
)
def test_what_an_estimate_means_and_how_it_is_written(estimate, key, kind, text):
    assert estimate.kind(key) == kind
    assert format_estimate(key, estimate) == text


def test_extremes_stay_extremes_and_events_are_counted():
    result = evaluation(np.zeros(8), "rotor_speed_max")
    counted = [replace(run, metrics=run.metrics | {"overspeed_count": 2.0}) for run in result.runs]
    overall = replace(result, runs=counted).overall_metrics("PPO")
    assert overall["rotor_speed_max"] == pytest.approx(9.0 * MEAN["rotor_speed_max"])
    assert overall["overspeed_count"] == 16.0
    assert result.overall_metrics("PPO", 10.0)["rotor_speed_max"] == pytest.approx(5.0 * MEAN["rotor_speed_max"])
