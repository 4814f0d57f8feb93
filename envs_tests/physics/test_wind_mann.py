"""Mann's uniform shear turbulence against closed forms, the equation of rapid distortion and direct integration."""

import math

import numpy as np
import pytest
import scipy.integrate

from wt_gym.base.errors import InflowError
from wt_gym.wind import TurbulenceBox
from wt_gym.wind.mann import (
    MannParameters,
    distortion,
    life_time,
    one_point_spectra,
    spectral_tensor,
)
from wt_gym.wind.turbulence_box import load

SITE = {"mean_speed": 10.0, "hub_height": 90.0, "rotor_diameter": 126.0, "turbulence_class": "B"}
LENGTH, N_SEEDS = 33.6, 16


def parameters(seed=1, shear=3.9, **changes):
    arguments = {
        **SITE, "seed": seed, "duration": 100.0, "time_step": 0.5, "grid": (5, 5), "width": 80.0, "turbulence": "NTM",
        "turbine_class": "I", "scaling": "none", "spectrum_of": "samples",
    }  # fmt: skip
    return MannParameters(shear=shear, **{**arguments, **changes})


@pytest.fixture(scope="module")
def waves():
    """Fourier coefficients, (n_seeds, n_frequencies, n_z, n_y, 3), whose squares are the variances of the harmonics."""
    boxes = np.array([parameters(seed).synthesize() for seed in range(N_SEEDS)], dtype=np.float64)
    return np.fft.rfft(boxes, axis=1)[:, 1:-1] * math.sqrt(2.0) / boxes.shape[1]


def test_without_shear_the_spectra_are_those_of_von_karman():
    """F₁ = 9/55 (1 + k²)^(−5/6), F₂ = F₃ = 3/110 (3 + 8k²)(1 + k²)^(−11/6) for L = αε^(2/3) = 1 (Mann 1998, 2.8)."""
    k = np.geomspace(2e-3, 3e3, 60)
    spectra = one_point_spectra(k, 1.0, 0.0)
    across = 3.0 / 110.0 * (3.0 + 8.0 * k**2) * (1.0 + k**2) ** (-11.0 / 6.0)
    np.testing.assert_allclose(spectra[:, 0], 9.0 / 55.0 * (1.0 + k**2) ** (-5.0 / 6.0), rtol=3e-4)
    np.testing.assert_allclose(spectra[:, 1], across, rtol=3e-4)
    np.testing.assert_allclose(spectra[:, 2], across, rtol=3e-4)
    np.testing.assert_allclose(spectra[:, 3], 0.0, atol=1e-12)


def test_the_parameters_of_the_standard_give_its_sigma():
    """IEC 61400-1, annex C.1: with Γ = 3.9, σ of the isotropic turbulence is 0.55 σ₁; v and w have 0.7 and 0.5 σ₁.

    The isotropic σ² is 9/55 B(1/2, 1/3) αε^(2/3) L^(2/3) = 0.688 αε^(2/3) L^(2/3).
    """
    made = parameters()
    isotropic = math.sqrt(0.6883 * made.dissipation * made.length ** (2.0 / 3.0))
    assert made.length == pytest.approx(0.8 * 42.0)
    assert made.sigma[0] == pytest.approx(0.14 * (0.75 * 10.0 + 5.6))
    np.testing.assert_allclose(np.array([isotropic, *made.sigma[1:]]) / made.sigma[0], [0.55, 0.7, 0.5], atol=0.025)


def test_waves_are_free_of_divergence():
    k = np.random.default_rng(0).normal(size=(3, 200)) * np.geomspace(0.02, 50.0, 200)
    uu, vv, ww, uv, uw, vw = np.moveaxis(spectral_tensor(*k, 3.9), -1, 0)
    tensor = np.array([[uu, uv, uw], [uv, vv, vw], [uw, vw, ww]])
    size = np.linalg.norm(k, axis=0) * (uu + vv + ww)
    assert np.all(np.abs(np.einsum("in,ijn->jn", k, tensor)) < 1e-9 * size)


@pytest.mark.parametrize("k", [(0.3, 0.5, -0.4), (-0.2, 0.05, 0.6), (1.5, -0.8, 0.2), (0.02, 0.4, -1.0)])
def test_distortion_solves_the_linear_equation_of_a_sheared_wave(k):
    """dk₃/dτ = −k₁, du_i/dτ = (2 k_i k₁/k² − δ_i1) u₃ with τ the shear times time (Mann 1994, 3.5)."""
    k1, k2, k3 = k
    beta = float(life_time(np.linalg.norm(k), 3.9))
    k30, zeta1, zeta2, factor = (float(value) for value in distortion(k1, k2, k3, beta))
    assert k30 == pytest.approx(k3 + beta * k1)

    def rate(tau, u):
        wave = np.array([k1, k2, k30 - k1 * tau])
        return (2.0 * wave * k1 / (wave @ wave) - [1.0, 0.0, 0.0]) * u[2]

    before = np.cross([k1, k2, k30], [0.3, -0.7, 0.5])
    after = scipy.integrate.solve_ivp(rate, (0.0, beta), before, rtol=1e-10, atol=1e-12).y[:, -1]
    expected = [before[0] + zeta1 * before[2], before[1] + zeta2 * before[2], factor * before[2]]
    np.testing.assert_allclose(after, expected, rtol=1e-6)


def test_the_life_time_is_that_of_its_formula():
    """For small kL, ₂F₁(a, b; c; −x²) → x^(−2a) Γ(c)Γ(b−a)/(Γ(b)Γ(c−a)): β ~ Γ (kL)^(−1) times a constant."""
    a, b, c = 1.0 / 3.0, 17.0 / 6.0, 4.0 / 3.0
    constant = math.gamma(c) * math.gamma(b - a) / (math.gamma(b) * math.gamma(c - a))
    k = 1e-4
    assert life_time(k, 3.9) == pytest.approx(3.9 * k ** (-2 / 3) / math.sqrt(constant * k ** (2.0 * a)), rel=1e-4)
    assert life_time(1e3, 2.0) == pytest.approx(2.0 * 1e3 ** (-2 / 3), rel=1e-5)


def test_boxes_have_the_one_point_spectra_of_the_model(waves):
    """Within three and a half standard errors, of as many independent values as there are seeds and harmonics."""
    made = parameters()
    variance = made.unscaled_variance
    cospectrum = 2.0 * one_point_spectra(made.wave_number, made.length, made.shear, made.dissipation)[:, 3]
    cospectrum *= made.wave_number[0]
    for band in (slice(0, 5), slice(5, 20), slice(20, 60), slice(60, 99)):
        part, n = waves[:, band], N_SEEDS * (band.stop - band.start)
        power = (np.abs(part) ** 2).mean(axis=(0, 2, 3)).sum(axis=0)
        np.testing.assert_allclose(power / variance[band].sum(axis=0), 1.0, atol=3.5 / math.sqrt(n))
        stress = (part[..., 0] * part[..., 2].conj()).real.mean(axis=(0, 2, 3)).sum()
        scale = np.sqrt(variance[band, 0].sum() * variance[band, 2].sum())
        assert stress / scale == pytest.approx(cospectrum[band].sum() / scale, abs=3.5 / math.sqrt(n))


def test_the_upper_of_two_points_is_reached_first(waves):
    """Cross-spectrum of u 20 m apart in height, against ∬ Φ e^(i k₃ Δz) on a grid of its own: eddies lean forward."""
    made, k = parameters(), np.linspace(-12.0, 12.0, 401)
    band = slice(2, 10)  # 0.03 to 0.10 Hz
    cross, power = 0.0, 0.0
    for k1 in -made.wave_number[band] * LENGTH:
        tensor = spectral_tensor(k1, k[:, None], k, 3.9)[..., 0]
        cross, power = cross + (tensor * np.exp(1j * k * 20.0 / LENGTH)).sum(), power + tensor.sum()
    found = (waves[:, band, 1:, :, 0] * waves[:, band, :-1, :, 0].conj()).mean(axis=(0, 2, 3)).sum()
    found /= (np.abs(waves[:, band, :, :, 0]) ** 2).mean(axis=(0, 2, 3)).sum()
    expected = cross / power
    assert expected.imag > 0.1  # at +ω, what leads has the greater phase
    assert found == pytest.approx(expected, abs=0.06)


@pytest.mark.parametrize("scaling", ["low_frequency", "uniform"])
def test_scaled_boxes_have_the_sigma_that_is_wanted(scaling):
    made = parameters(scaling=scaling)
    np.testing.assert_allclose(made.harmonic_variance.sum(axis=0), made.sigma**2, rtol=1e-12)


def test_boxes_are_made_once_and_repeat(tmp_path, monkeypatch):
    monkeypatch.setenv("WT_GYM_CACHE", str(tmp_path))
    small = {**SITE, "seed": 3, "duration": 20.0, "grid": (3, 3)}
    box = TurbulenceBox.mann(**small)
    (file,) = (tmp_path / "turbulence").iterdir()
    assert file.name.startswith("mann-")
    np.testing.assert_array_equal(TurbulenceBox.mann(**small, cache=False).fluctuation, box.fluctuation)
    np.testing.assert_array_equal(load(MannParameters(**small)), box.fluctuation)
    assert not np.array_equal(TurbulenceBox.mann(**small, shear=0.0, cache=False).fluctuation, box.fluctuation)
    assert np.abs(box.fluctuation.mean(axis=0)).max() < 1e-5


@pytest.mark.parametrize(("change", "message"), [({"shear": -1.0}, "shear"), ({"length": 0.0}, "length")])
def test_parameters_without_meaning_are_refused(change, message):
    with pytest.raises(InflowError, match=message):
        TurbulenceBox.mann(**SITE, seed=1, **change)
