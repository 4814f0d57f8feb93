"""Factors on the weights of the reward: what is drawn, what is given, what is refused."""

import copy
import math

import numpy as np
import pytest

from wt_gym.envs.dial import DIALED, DialCourse, DialOptions, DialTerm, factor_of, scaled
from wt_gym.envs.options import EnvOptions
from wt_gym.envs.rewards import DEFAULT_WEIGHTS

TERMS = tuple(DEFAULT_WEIGHTS)


def courses(n=200, **options):
    draws = DialTerm(DialOptions(**options), TERMS, None)
    return [draws.drawn(np.random.default_rng(seed)) for seed in range(n)]


@pytest.mark.parametrize("weights", ["log_uniform", "simplex"])
def test_drawn_factors_have_one_sum_and_stay_within_the_range(weights):
    found = courses(weights=weights, range=(0.5, 3.0))
    factors = np.array([row for course in found for row in course.factors])
    np.testing.assert_allclose(factors.sum(axis=1), 3.0, rtol=1e-12)
    if weights == "simplex":
        assert factors.min() >= 0.5
        np.testing.assert_allclose(factors.mean(axis=0), 1.0, atol=0.01)
        assert factors.max() > 1.9  # of 2, in a corner
    else:
        ratios = np.log(factors[:, 0] / factors[:, 1]) / math.log(6.0)
        assert np.abs(ratios).max() <= 1.0 + 1e-12
        # the difference of two even draws: triangular, with the variance 1/6
        assert ratios.var() == pytest.approx(1 / 6, rel=0.03)


def test_changes_are_some_tens_of_seconds_apart():
    for course in courses(20, weights="log_uniform", interval=30.0):
        gaps = np.diff(course.times)
        assert gaps.min() >= 15.0
        assert gaps.max() <= 45.0
        assert gaps.mean() == pytest.approx(30.0, rel=0.1)
        assert course.times[-1] >= 3600.0
        assert len(set(course.factors)) == len(course.factors)


def test_a_row_holds_up_to_the_next():
    course = DialCourse.of([[0.0, 1.0, 1.0, 1.0], [10.0, 2.0, 1.0, 1.0]])
    assert course.at(-1.0) == course.at(0.0) == course.at(9.99) == (1.0, 1.0, 1.0)
    assert course.at(10.0) == course.at(1e4) == (1.5, 0.75, 0.75)
    turned = course.changed(5.0, (0.5, 0.5, 2.0))
    assert [turned.at(t) for t in (4.9, 5.0, 20.0)] == [(1.0, 1.0, 1.0), (0.5, 0.5, 2.0), (0.5, 0.5, 2.0)]
    assert course.at(5.0) == (1.0, 1.0, 1.0)
    assert copy.deepcopy(course) is course


def test_only_ratios_count():
    assert scaled((2.0, 2.0, 2.0)) == (1.0, 1.0, 1.0)
    assert DialCourse.of({"travel": 4.0}).factors == DialCourse.of({"fatigue": 0.25, "power": 0.25}).factors


def test_every_dialed_term_is_one_of_the_reward_and_others_stay():
    assert {term for terms in DIALED.values() for term in terms} <= set(DEFAULT_WEIGHTS)
    names = ("blade_fatigue", "power", "actuator_use", "overspeed", "termination", "function")
    assert [factor_of(name, (2.0, 0.25, 0.75)) for name in names] == [2.0, 0.25, 0.75, 1.0, 1.0, 1.0]
    with pytest.raises(ValueError, match="dial_weights needs one of the reward terms"):
        DialTerm(DialOptions(weights="simplex"), ["overspeed", "function"], None)


def test_factors_of_a_pretraining_are_those_between_two_changes():
    rng = np.random.default_rng(3)
    drawn = [DialTerm(DialOptions(weights="log_uniform"), TERMS, None).factors(rng) for _ in range(50)]
    assert len(set(drawn)) == 50
    assert {DialTerm(DialOptions(weights={"power": 2.0}), TERMS, None).factors(rng) for _ in range(5)} == {
        (0.75, 1.5, 0.75)
    }
    rows = [[0.0, 1.0, 1.0, 1.0], [10.0, 2.0, 1.0, 1.0]]
    given = {DialTerm(DialOptions(weights=rows), TERMS, None).factors(rng) for _ in range(30)}
    assert given == {(1.0, 1.0, 1.0), (1.5, 0.75, 0.75)}


@pytest.mark.parametrize(
    "weights",
    [
        {"fatige": 1.0}, {"power": 0.0}, [[0.0, 1.0, 1.0]], [[0.0, 1.0, 1.0, 1.0], [0.0, 1.0, 1.0, 2.0]],
        [[0.0, 1.0, 100.0, 1.0]],
    ],
)  # fmt: skip
def test_wrong_weights_are_refused(weights):
    with pytest.raises(ValueError, match="dial_weights must be one of log_uniform, simplex, "):
        DialOptions(weights=weights)


def test_ranges_without_a_dial_are_refused():
    with pytest.raises(ValueError, match="dial_range, dial_interval must be left out, or given with dial_weights"):
        EnvOptions.from_dict({"dial_range": (0.5, 2.0), "dial_interval": 20.0})
