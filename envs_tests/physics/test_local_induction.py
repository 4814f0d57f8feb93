"""Self-induction of polygons of vortex segments: rings of any number of corners move as the ring they stand for."""

import math

import numpy as np
import pytest

from wt_gym.aerodynamics.wake.local_induction_kernels import CORE_CUT, SHEET_CUT, local_velocity, take_segment

RING, CORE = 1.0, 0.05


def corners(count):
    angle = 2.0 * math.pi * np.arange(count) / count
    return RING * np.column_stack([np.cos(angle), np.sin(angle), np.zeros(count)])


def induced(points, k, x):
    """Velocity of the segment from corner k to the next, by the law of the induction kernels."""
    a, b = points[k], points[(k + 1) % len(points)]
    p, r = x - a, x - b
    np_, nr = np.linalg.norm(p), np.linalg.norm(r)
    share = np_ * nr * (np_ * nr + p @ r) + (CORE * np.linalg.norm(b - a)) ** 2
    return (np_ + nr) * np.cross(p, r) / share / (4.0 * math.pi)


class TestRing:
    """Speed of a thin ring with the core of Lamb and Oseen: G / (4 pi R) (ln(8 R / rc) - 0.558) (Saffman)."""

    exact = (math.log(8.0 * RING / CORE) - 0.558) / (4.0 * math.pi * RING)

    @pytest.mark.parametrize("count", [6, 8, 12, 24, 45])
    def test_speed_does_not_depend_on_the_corners(self, count):
        points, out = corners(count), np.zeros(3)
        rest = sum(induced(points, k, points[0]) for k in range(1, count - 1))
        local_velocity(points[-1], points[0], points[1], CORE_CUT * CORE, 1.0, out)
        assert (rest + out)[2] == pytest.approx(self.exact, rel=0.02)
        assert rest[2] < 0.8 * self.exact  # what straight segments alone give
        np.testing.assert_allclose(out[:2], 0.0, atol=1e-15)

    def test_opposite_circulation_moves_back(self):
        points, out = corners(12), np.zeros(3)
        local_velocity(points[-1], points[0], points[1], CORE_CUT * CORE, -1.0, out)
        assert out[2] < 0.0

    def test_straight_filaments_and_filaments_shorter_than_the_core_stay(self):
        out = np.ones(3)
        local_velocity(np.array([-1.0, 0, 0]), np.zeros(3), np.array([2.0, 0, 0]), 0.1, 1.0, out)
        np.testing.assert_array_equal(out, 0.0)
        points = corners(45)
        local_velocity(points[-1], points[0], points[1], 0.2, 1.0, out)
        np.testing.assert_array_equal(out, 0.0)

    def test_cuts(self):
        """Geometric mean distances: exp(0.558) / 2 of a Lamb-Oseen core, b exp(-3/2) of a flat sheet."""
        assert pytest.approx(0.5 * math.exp(0.558), abs=1e-3) == CORE_CUT
        assert pytest.approx(0.5 * math.exp(0.5) * math.exp(-1.5), abs=1e-3) == SHEET_CUT


def test_a_segment_is_taken_away_whole():
    points, x = corners(8), np.array([0.3, -0.2, 0.5])
    node = np.array([*points[1], 1.0 / (4.0 * math.pi), (CORE * np.linalg.norm(points[1] - points[0])) ** 2, 0.0, 1.0])
    out = induced(points, 0, x)
    take_segment(node, points[0], x, out)
    np.testing.assert_allclose(out, 0.0, atol=1e-15)
