"""What of a residual pitch reaches the blades: share of the fade and washout, against the formulas of both."""

import math

import numpy as np
import pytest

from wt_gym.control.controllers import AboveRated, FadeParameters
from wt_gym.control.controllers.additions import ResidualPitch

RATED = 1.2
OFFSETS = np.array([0.03, 0.01, -0.02])
FADE = FadeParameters(pitch=(0.01, 0.03), speed=(0.8, 1.0), time_constant=5.0)


def fade():
    return AboveRated(FADE, 0.0, RATED)


# half way up a ramp x^2 (3 - 2 x) stands 1/2, a quarter up 5/32
@pytest.mark.parametrize(
    ("pitch", "speed", "share"),
    [(0.0, 1.0, 0.0), (0.02, 1.0, 0.5), (0.015, 1.0, 5 / 32), (0.02, 0.9, 0.25), (0.05, 0.8, 0.0), (0.05, 1.0, 1.0)],
)
def test_a_faded_offset_acts_with_the_share_of_both_ramps(pitch, speed, share):
    residual = ResidualPitch(fade(), None, 3)
    residual.start(pitch, speed * RATED, 0.1)
    assert residual.share == pytest.approx(share, abs=1e-12)
    for _ in range(3):
        acting = residual.acting(OFFSETS, np.full(3, pitch), speed * RATED, 0.1)
        np.testing.assert_allclose(acting, share * OFFSETS, atol=1e-12)
    assert (residual.fades, residual.washes, residual.mean) == (True, False, 0.0)


def test_the_share_follows_the_pitch_of_the_controller_with_the_time_constant():
    """From fine pitch towards 0.1 rad: 0.1 (1 - exp(-t/5 s)), which passes the middle of the ramp at 5 ln 1.25 s."""
    residual, dt = ResidualPitch(fade(), None, 1), 5.0 * math.log(1.25) / 4
    residual.start(0.0, RATED, dt)
    for _ in range(4):
        acting = residual.acting(OFFSETS[:1], np.array([0.05, 0.1, 0.15]), RATED, dt)
    assert residual.share == pytest.approx(0.5)
    assert acting == pytest.approx(0.5 * OFFSETS[:1])


@pytest.mark.parametrize(("n_mean", "mean"), [(3, 0.02 / 3), (1, 0.03)])
def test_what_lasts_of_the_mean_is_washed_out(n_mean, mean):
    """A lasting offset: its mean decays as exp(-t/tau), the rest stays; from a new start all acts again."""
    tau, dt = 4.0, 0.5
    residual = ResidualPitch(fade(), tau, n_mean)
    for _ in range(2):
        residual.start(0.02, RATED, dt)
        assert residual.mean == 0.0
        for k in range(1, 9):
            acting = residual.acting(OFFSETS, np.full(3, 0.02), RATED, dt)
            left = mean * math.exp(-k * dt / tau)
            expected = OFFSETS.copy()
            expected[:n_mean] += left - mean
            np.testing.assert_allclose(acting, 0.5 * expected, atol=1e-12)
            assert residual.mean == pytest.approx(0.5 * left)


def test_a_washout_is_a_positive_time_and_takes_nothing_off_tilt_and_yaw():
    residual = ResidualPitch(None, 0.5, 1)
    assert (residual.share, residual.mean) == (1.0, 0.0)
    residual.start(0.0, RATED, 0.1)
    assert residual.acting(OFFSETS[:1], np.zeros(3), RATED, 0.1) == pytest.approx(OFFSETS[:1] * math.exp(-0.2))
    cyclic = ResidualPitch(None, 4.0, 0)
    cyclic.start(0.0, 0.0, 0.1)
    np.testing.assert_array_equal(cyclic.acting(OFFSETS[:2], np.zeros(3), 0.0, 0.1), OFFSETS[:2])
    assert (cyclic.share, cyclic.mean, cyclic.fades, cyclic.washes) == (1.0, 0.0, False, False)
    for washout in (0.0, math.nan):
        with pytest.raises(ValueError, match="residual_washout must be a positive time"):
            ResidualPitch(None, washout, 3)
