"""Fast parts of the validation of the lattice on wings: Wagner, Theodorsen, lifting surfaces, Goland's wing."""

import numpy as np
import pytest

from envs_tests.physics.cases.airfoils import (
    KUSSNER,
    SEARS,
    exact_lift,
    flat_planform,
    gust_waves,
    kussner,
    oscillating_lift,
    sears,
    sharp_edged_gust,
    steady_coefficients,
    steady_wing,
)
from envs_tests.physics.cases.flutter import LinearLattice, Resolution, dominant_mode, growth, linear_flutter
from envs_tests.physics.cases.wings import RECTANGULAR, rectangular_wing, starting_impulse, sudden_acceleration
from envs_tests.physics.validation import load_cases, run_case


@pytest.mark.parametrize("name", ["wagner", "elliptic-wings", "vortex-conservation", "goland-strip-theory"])
def test_case(name):
    result = run_case(load_cases()[name])
    assert result.checks
    failed = [f"{c.quantity}: expected {c.expected}, obtained {c.obtained:.6g}" for c in result.checks if not c.passed]
    assert not failed, "\n".join(failed)


@pytest.mark.parametrize("aspect", [4.0, 20.0])
def test_rectangular_wing(aspect):
    lift, drag, far_drag = rectangular_wing(aspect, 4, 20, 0.25, 1e-3)
    assert lift / 1e-3 == pytest.approx(RECTANGULAR[aspect][0], rel=0.003)
    assert drag == pytest.approx(far_drag, rel=0.02)


def test_mirrored_half_is_the_whole_wing():
    """The image in z = 0 of a half wing against both halves in one lattice without a mirror."""
    edges = np.linspace(0.0, 2.0, 6)
    _, half, stream = steady_wing(flat_planform(edges, 1.0, 2), 0.05)
    whole_edges = np.r_[-edges[:0:-1], edges]
    _, whole, _ = steady_wing(flat_planform(whole_edges, 1.0, 2), 0.05, ground_height=None)
    np.testing.assert_allclose(half.circulation[0], whole.circulation[0, 5:], rtol=1e-5)
    assert steady_coefficients(half, stream, 2.0) == pytest.approx(steady_coefficients(whole, stream, 4.0), rel=1e-5)


@pytest.mark.parametrize("motion", ["plunge", "pitch"])
@pytest.mark.parametrize("k", [0.1, 0.3])
def test_theodorsen(motion, k):
    ratio = oscillating_lift(motion, k, 8) / exact_lift(motion, k)
    assert abs(ratio) == pytest.approx(1.0, abs=0.02)
    assert np.degrees(np.angle(ratio)) == pytest.approx(0.0, abs=2.0)


def test_gust_functions_have_the_published_values():
    s, value = np.array(KUSSNER).T
    np.testing.assert_allclose(kussner(s), value, atol=1.1e-5)
    k, amplitude, phase = np.array(SEARS).T
    np.testing.assert_allclose(np.abs(sears(k)), amplitude, atol=1e-5)
    np.testing.assert_allclose(np.degrees(np.angle(sears(k))), phase, atol=1e-3)


def test_kussner():
    travel, lift = sharp_edged_gust(16, 9.0)
    for s, value in KUSSNER[:5]:
        assert np.interp(s, travel, lift) == pytest.approx(value, rel=0.02)


@pytest.mark.parametrize("k", [0.3, 0.7])
def test_sears(k):
    lift, moment = gust_waves(k, 8)
    assert abs(lift / sears(k)) == pytest.approx(1.0, abs=0.02)
    assert np.degrees(np.angle(lift / sears(k))) == pytest.approx(0.0, abs=2.0)
    assert abs(moment / lift) < 0.015  # the lift acts at the quarter chord


def test_starting_impulse_is_the_apparent_mass():
    assert starting_impulse(16) == pytest.approx(1.0, rel=0.01)


def test_sudden_acceleration():
    _, lift = sudden_acceleration(4.0)
    assert lift[-1] == pytest.approx(RECTANGULAR[4.0][1], rel=0.01)


def test_linear_lattice_is_theodorsen_for_a_long_wing():
    edges = np.concatenate(([0.0], np.cumsum(4.0 ** np.arange(5))))
    lattice = LinearLattice(1.0, 0.25, edges, 8, 60.0)
    first = np.zeros((len(lattice.middle), 1))
    first[0] = 1.0
    heave, twist = np.ones_like(first), np.zeros_like(first)
    k = 0.3
    # the force on the first strip alone, by the virtual displacement of that strip
    both = lattice.modal_forces(np.hstack([heave, first]), np.hstack([twist, twist]), 2.0 * k, 1.0, 1.0)
    lift = both[1, 0] / (-2j * k) / (0.5 * lattice.width[0])  # heave upwards, per downward velocity
    assert abs(lift / exact_lift("plunge", k)) == pytest.approx(1.0, abs=0.01)
    assert np.degrees(np.angle(lift / exact_lift("plunge", k))) == pytest.approx(0.0, abs=1.0)


def test_dominant_mode_of_a_known_signal():
    time = 1e-3 * np.arange(1, 900)
    one, two = -3.0 + 70.0j, -20.0 + 110.0j
    motion = np.column_stack([np.exp(one * time).real + np.exp(two * time).imag, np.exp((one) * time).imag])
    assert dominant_mode(time, motion) == pytest.approx(one, rel=1e-4)


def test_goland_wing_flutters_between_165_and_195_m_s():
    """Coarse lattice; published 165 m/s, converged 171 m/s, 4 x 6 panels 173 m/s; about 69 rad/s."""
    coarse = Resolution(4, 6, 8.0, 0.6)
    slow, fast = growth(165.0, coarse), growth(195.0, coarse)
    assert slow.real < 0.0 < fast.real
    assert 60.0 < fast.imag < slow.imag < 75.0
    assert linear_flutter(4, 6)[0] == pytest.approx(171.8, rel=0.01)
