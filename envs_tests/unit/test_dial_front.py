"""Hypervolume against exact volumes, and parts of the cost."""

import numpy as np
import pytest
from dial_front import PARTS, SETTINGS, cost_parts, covered, hypervolume

from wt_gym.analysis.metrics import LIFETIME_COST_WEIGHTS
from wt_gym.envs.dial import DIAL_NAMES


def test_volumes_of_boxes_and_their_union():
    one = np.ones(3)
    assert hypervolume([[0.5, 0.5, 0.5], [0.6, 0.7, 0.8]], one) == pytest.approx(0.125)  # one dominates the other
    assert hypervolume([[0.5, 0.0, 0.0], [0.0, 0.5, 0.0]], one) == pytest.approx(0.75)
    assert hypervolume([[0.0, 0.0, 1.0]], one) == hypervolume([[2.0, 0.0, 0.0]], one) == 0.0


def test_any_points_against_counting():
    rng = np.random.default_rng(4)
    points, samples = rng.uniform(size=(8, 3)), rng.uniform(size=(200_000, 3))
    dominated = (samples[:, None] >= points).all(axis=2).any(axis=1)
    assert hypervolume(points, np.ones(3)) == pytest.approx(dominated.mean(), abs=4e-3)


def test_a_policy_covers_by_a_reference_beyond_all_points():
    """Of one point each and the other an edge of it: (0.1, 1.1, 1.1) over (1.1, 1.1, 1.1)."""
    several = dict.fromkeys(SETTINGS, (0.0, 0.0, 0.0))
    assert covered(dict.fromkeys(SETTINGS, (1.0, 0.0, 0.0)) | {"power": (0.0, 1.0, 1.0)}, several) == pytest.approx(
        (0.1 * 1.1 * 1.1 + 1.1 * 0.1 * 0.1 - 0.1**3) / 1.1**3
    )


def test_parts_of_the_cost():
    base = {name: 2.0 for parts in PARTS.values() for name in parts} | {"pitch_duty_cycle": 0.05}
    now = dict(base, blade_flap_del=1.0, mean_power=1.98, pitch_duty_cycle=0.15)
    weights = LIFETIME_COST_WEIGHTS
    expected = (-0.5 * weights["blade_flap_del"], 0.01, 0.1 * weights["pitch_duty_cycle"])
    assert cost_parts(now, base) == pytest.approx(expected)
    assert tuple(PARTS) == DIAL_NAMES
