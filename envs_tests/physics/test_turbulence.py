"""Turbulence boxes: spectra, coherence, interpolation, Mann's model, and evolution between lidar and rotor."""

import math
import pickle
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import scipy.integrate
from threadpoolctl import threadpool_info, threadpool_limits

from wt_gym.base.errors import InflowError
from wt_gym.control import Lidar
from wt_gym.envs.wind_sampler import WindOptions, WindSampler
from wt_gym.turbines import load_turbine
from wt_gym.wind import (
    SteadyInflow,
    TransientInflow,
    TurbulenceBox,
    TurbulentInflow,
    TurningInflow,
    kaimal,
    turbulence_box,
)
from wt_gym.wind.coherence_kernels import parity_block
from wt_gym.wind.kaimal import sample_gain, variance_read
from wt_gym.wind.mann import MannParameters, distortion, life_time, one_point_spectra, spectral_tensor
from wt_gym.wind.turbulence_box import load
from wt_gym.wind.turbulent import coherence_along, evolved_boxes

# ---- Kaimal ---------------------------------------------------------------------------------------------------------
# At the hub the Fourier coefficients have the modulus of the spectrum and a random phase: exact checks. At the other
# points they are sums of random phases, close to complex normal with the spectrum as variance, independent from
# frequency to frequency and seed to seed. Hence the mean of n periodogram values has the relative standard error 1/√n
# at most, and the mean of n products Re(X_i X_j*)/S the error √((1 + ρ²)/2n) around the coherency ρ. Bounds are four
# standard errors (one false alarm in 16 000 for each number; the seeds are fixed).

SPEED, HUB, DIAMETER = 10.0, 90.0, 126.0
SIGMA = 0.14 * (0.75 * SPEED + 5.6)
TIME_STEP, DURATION = 0.25, 600.0
N_SEEDS = 24
BANDS = np.array([0.0, 0.01, 0.03, 0.1, 0.3, 1.0, 2.0])
STANDARD_ERRORS = 4.0


def formula(frequency, speed=SPEED, sigma=SIGMA):
    """Kaimal spectra of IEC 61400-1 written out for a hub above 60 m, shape (n, 3)."""
    ratios, lengths = np.array([1.0, 0.8, 0.5]), np.array([8.1, 2.7, 0.66]) * 42.0
    n = frequency[:, None] * lengths / speed
    return (ratios * sigma) ** 2 * 4.0 * lengths / speed / (1.0 + 6.0 * n) ** (5.0 / 3.0)


@pytest.fixture(scope="module")
def realizations():
    """Frequencies (n,) and Fourier coefficients (seeds, n, n_z, n_y, 3), |X|² the periodogram [m²/s]."""
    coefficients = []
    for seed in range(N_SEEDS):
        box = TurbulenceBox.kaimal(
            SPEED, HUB, DIAMETER, "B", seed=seed, grid=(5, 3), width=100.0, scaling="none", cache=False,
            spectrum_of="samples",
        )  # fmt: skip
        transform = np.fft.rfft(box.fluctuation.astype(float), axis=0)[1:-1]
        coefficients.append(transform * math.sqrt(2.0 * TIME_STEP / box.fluctuation.shape[0]))
    frequency = np.fft.rfftfreq(round(DURATION / TIME_STEP), TIME_STEP)[1:-1]
    return frequency, np.array(coefficients)


@pytest.mark.parametrize("band", range(BANDS.size - 1))
@pytest.mark.parametrize("point", [(1, 2), (0, 0), (2, 3)])
def test_spectrum(realizations, band, point):
    frequency, coefficients = realizations
    inside = (frequency > BANDS[band]) & (frequency <= BANDS[band + 1])
    ratio = np.abs(coefficients[:, inside, point[0], point[1]]) ** 2 / formula(frequency[inside])
    n = ratio[..., 0].size
    np.testing.assert_allclose(ratio.mean(axis=(0, 1)), 1.0, atol=STANDARD_ERRORS / math.sqrt(n))


@pytest.mark.parametrize("band", range(BANDS.size - 1))
@pytest.mark.parametrize(
    ("first", "second"),
    [((1, 2), (1, 3)), ((1, 2), (2, 2)), ((0, 0), (0, 1)), ((0, 1), (2, 4)), ((2, 4), (0, 0)), ((1, 0), (1, 4))],
)
def test_coherence(realizations, band, first, second):
    frequency, coefficients = realizations
    inside = (frequency > BANDS[band]) & (frequency <= BANDS[band + 1])
    distance = math.hypot(50.0 * (first[0] - second[0]), 25.0 * (first[1] - second[1]))
    f = frequency[inside]
    expected = np.exp(-12.0 * np.sqrt((f * distance / SPEED) ** 2 + (0.12 * distance / (8.1 * 42.0)) ** 2))
    a, b = coefficients[:, inside, first[0], first[1]], coefficients[:, inside, second[0], second[1]]
    coherency = a * b.conj() / formula(f)
    n = coherency[..., 0].size
    tolerance = STANDARD_ERRORS * math.sqrt(np.mean(1.0 + expected**2) / 2.0 / n)
    np.testing.assert_allclose(coherency.real.mean(axis=(0, 1)), expected.mean(), atol=tolerance)
    np.testing.assert_allclose(coherency.imag.mean(axis=(0, 1)), 0.0, atol=tolerance)  # no phase between points


def test_components_are_independent(realizations):
    frequency, coefficients = realizations
    hub = coefficients[:, :, 1, 2] / np.sqrt(formula(frequency))
    tolerance = STANDARD_ERRORS / math.sqrt(2.0 * hub[..., 0].size)
    for first, second in ((0, 1), (0, 2), (1, 2)):
        assert abs(np.mean((hub[..., first] * hub[..., second].conj()).real)) < tolerance


def test_every_harmonic_at_the_hub_follows_the_spectrum(realizations):
    """Without scaling, in each bin of every seed, to the rounding of float32."""
    frequency, coefficients = realizations
    power = np.abs(coefficients[:, :, 1, 2]) ** 2
    np.testing.assert_allclose(power / formula(frequency), np.ones(power.shape), rtol=2e-4)


def test_phases_at_the_hub_are_uniform(realizations):
    _, coefficients = realizations
    phase = np.angle(coefficients[:, :, 1, 2]).ravel()
    for order in (1, 2, 3):
        mean = np.exp(1j * order * phase).mean()
        assert abs(mean) < STANDARD_ERRORS / math.sqrt(phase.size)


def hub_series(speed, duration, time_step, **options):
    box = TurbulenceBox.kaimal(
        speed, HUB, DIAMETER, "B", duration=duration, time_step=time_step, grid=(3, 3), cache=False,
        spectrum_of="samples", **options,
    )  # fmt: skip
    return box.fluctuation[:, 1, 1].astype(float)


@pytest.mark.parametrize("scaling", ["low_frequency", "uniform"])
def test_scaled_sigma_is_the_target(scaling):
    for seed in (1, 2, 3):
        series = hub_series(SPEED, DURATION, TIME_STEP, seed=seed, scaling=scaling)
        np.testing.assert_allclose(series.std(axis=0) / SIGMA, [1.0, 0.8, 0.5], rtol=1e-6)


def test_range_that_loads_the_structure():
    """RMS in 0.2–1.9 Hz at 12 m/s, class B, 400 s: by default that of the spectrum in every seed."""
    n = 1600
    frequency = np.fft.rfftfreq(n, 0.25)
    inside = (frequency >= 0.2) & (frequency <= 1.9)
    edges = np.arange(0.2, 1.9, 1e-4) + 5e-5
    sigma = 0.14 * (0.75 * 12.0 + 5.6)
    expected = math.sqrt(1e-4 * kaimal.kaimal_spectrum(edges, 12.0, HUB, sigma)[:, 0].sum())
    assert expected == pytest.approx(0.5494, abs=1e-4)

    def band(seed, scaling):
        transform = np.fft.rfft(hub_series(12.0, 400.0, 0.25, seed=seed, scaling=scaling)[:, 0])[inside]
        return math.sqrt(2.0 * (np.abs(transform) ** 2).sum()) / n

    for seed in range(1, 5):
        assert band(seed, "low_frequency") == pytest.approx(expected, rel=0.003)
        assert band(seed, "uniform") == pytest.approx(expected / 0.9242, rel=0.003)


def test_lateral_components_without_coherence():
    options = {"scaling": "none", "lateral_coherence": False, "spectrum_of": "samples", "cache": False}
    box = TurbulenceBox.kaimal(SPEED, HUB, DIAMETER, "B", seed=1, grid=(3, 3), width=2.0, **options)
    transform = np.fft.rfft(box.fluctuation.astype(float), axis=0)[1:-1]
    frequency = np.fft.rfftfreq(2400, TIME_STEP)[1:-1]
    whitened = transform * math.sqrt(2.0 * TIME_STEP / 2400) / np.sqrt(formula(frequency))[:, None, None]
    product = (whitened[:, 1, 1] * whitened[:, 1, 2].conj()).real.mean(axis=0)
    coherence = np.exp(-12.0 * np.hypot(frequency / SPEED, 0.12 / (8.1 * 42.0)))  # one meter apart
    tolerance = STANDARD_ERRORS * np.sqrt(np.array([np.mean(1.0 + coherence**2), 1.0, 1.0]) / 2.0 / frequency.size)
    assert np.all(np.abs(product - [coherence.mean(), 0.0, 0.0]) < tolerance)


def test_mirror_blocks_are_the_whole_coherence_matrix():
    """In the even-odd basis the coherence matrix has these four blocks and nothing else, exactly."""
    n_y, n_z, spacing_y, spacing_z = 5, 7, 9.0, 6.0
    decay = np.array([0.004, 0.05])
    table = kaimal._coherence_table(decay, SimpleNamespace(grid=(n_y, n_z), spacing=(spacing_y, spacing_z)))
    z, y = np.meshgrid(spacing_z * np.arange(n_z), spacing_y * np.arange(n_y), indexing="ij")
    distance = np.hypot(z.ravel()[:, None] - z.ravel(), y.ravel()[:, None] - y.ravel())
    basis_y, basis_z = kaimal._reflection_basis(n_y), kaimal._reflection_basis(n_z)
    basis = np.kron(basis_z, basis_y)
    np.testing.assert_allclose(basis @ basis.T, np.eye(n_y * n_z), atol=1e-14)
    transformed = basis @ np.exp(-decay[:, None, None] * distance) @ basis.T
    index = np.arange(n_y * n_z).reshape(n_z, n_y)
    for rows in kaimal._halves(n_z):
        for columns in kaimal._halves(n_y):
            m_z, m_y = index[rows, columns].shape
            own = index[rows, columns].ravel()
            backward = np.full((decay.size, own.size, own.size), np.nan)
            parity_block(table, m_z, m_y, backward)
            lower, block = np.tril(np.ones(backward.shape[1:], dtype=bool)), transformed[:, own[:, None], own]
            np.testing.assert_allclose(backward[:, lower], block[:, ::-1, ::-1][:, lower], atol=1e-13)
            assert np.isnan(backward[:, ~lower]).all()
            transformed[:, own[:, None], own] = 0.0
    np.testing.assert_allclose(transformed, 0.0, atol=1e-13)


def test_coherence_that_is_none_changes_no_sample(monkeypatch):
    """In slow wind nearly all of it at the fastest frequencies, where it would be denormal."""
    slow = {"grid": (9, 9), "duration": 60.0, "cache": False, "seed": 11}
    decay = kaimal.coherence_decay(np.array([1.9]), 3.0, HUB)
    table = kaimal._coherence_table(decay, SimpleNamespace(grid=(9, 9), spacing=(18.0, 18.0)))
    assert (table == 0.0).mean() > 0.9
    cut = TurbulenceBox.kaimal(3.0, HUB, DIAMETER, "B", **slow)
    monkeypatch.setattr(kaimal, "_NOTHING", 0.0)
    turbulence_box._made_box.cache_clear()
    whole = TurbulenceBox.kaimal(3.0, HUB, DIAMETER, "B", **slow)
    np.testing.assert_array_equal(cut.fluctuation, whole.fluctuation)


def test_one_thread_factorizes(monkeypatch):
    """Several wait for each other where the cores have other work, and the last bits would depend on their number."""
    seen, cholesky = [], np.linalg.cholesky

    def watched(matrices):
        seen.extend(one["num_threads"] for one in threadpool_info() if one["user_api"] == "blas")
        return cholesky(matrices)

    monkeypatch.setattr(np.linalg, "cholesky", watched)
    with threadpool_limits(limits=2, user_api="blas"):
        TurbulenceBox.kaimal(SPEED, HUB, DIAMETER, "B", seed=11, duration=10.0, grid=(5, 5), cache=False)
    assert set(seen) == {1}


@pytest.fixture(scope="module")
def box():
    return TurbulenceBox.kaimal(SPEED, HUB, DIAMETER, "B", seed=11, duration=100.0, grid=(9, 9), cache=False)


POINTS = np.random.default_rng(5).uniform([-100.0, -90.0, 5.0], [600.0, 90.0, 180.0], size=(200, 3))


def test_taylor_advection(box):
    """u(x, t) = u(0, t − x/U), exactly."""
    inflow = TurbulentInflow(box, SteadyInflow(SPEED, HUB, shear_exponent=0.2))
    for point in POINTS[:50]:
        upstream = [0.0, point[1], point[2]]
        passed = inflow.velocity(upstream, 40.0 - point[0] / SPEED)
        np.testing.assert_allclose(inflow.velocity(point, 40.0), passed, rtol=0.0, atol=1e-11)


def test_periodic_in_time(box):
    inflow = TurbulentInflow(box)
    here = inflow.velocity(POINTS, 12.3)
    for periods in (-3, 1, 1000):
        np.testing.assert_allclose(inflow.velocity(POINTS, 12.3 + 100.0 * periods), here, atol=1e-8)
    # across the seam the wind is as smooth as elsewhere: continuous
    seam = inflow.velocity(np.array([[0.0, 3.0, 80.0]]), 100.0 - 1e-9) - inflow.velocity([[0.0, 3.0, 80.0]], 0.0)
    np.testing.assert_allclose(seam, 0.0, atol=1e-7)


def test_mean_profile_is_added(box):
    steady = SteadyInflow(SPEED, HUB, roughness_length=0.1, veer=0.001)
    difference = TurbulentInflow(box, steady).velocity(POINTS, 7.0) - TurbulentInflow(box).velocity(POINTS, 7.0)
    expected = steady.velocity(POINTS, 0.0) - [SPEED, 0.0, 0.0]
    np.testing.assert_allclose(difference, expected, atol=1e-12)


def test_yaw_and_inclination_turn_the_whole_field(box):
    """Turning the field and the observer together changes nothing."""
    yaw, rise = 0.4, 0.1
    turn = np.array([[math.cos(yaw), -math.sin(yaw), 0.0], [math.sin(yaw), math.cos(yaw), 0.0], [0.0, 0.0, 1.0]])
    lift = np.array([[math.cos(rise), 0.0, -math.sin(rise)], [0.0, 1.0, 0.0], [math.sin(rise), 0.0, math.cos(rise)]])
    rotation = turn @ lift
    hub = np.array([0.0, 0.0, HUB])
    straight = TurbulentInflow(box)
    turned = TurbulentInflow(box, SteadyInflow(SPEED, HUB, yaw_misalignment=yaw, inclination=rise))
    moved = hub + (POINTS - hub) @ rotation.T
    np.testing.assert_allclose(
        turned.velocity(moved, 21.0), straight.velocity(POINTS, 21.0) @ rotation.T, rtol=0.0, atol=1e-10
    )


def test_rotor_effective_speed_filters_turbulence(box):
    """The disc mean follows the grid mean over the disc and varies less than the hub."""
    inflow = TurbulentInflow(box)
    times = np.arange(0.0, 100.0, 1.0)
    effective = inflow.rotor_effective_speed(times, DIAMETER)
    assert effective.shape == times.shape
    assert effective.mean() == pytest.approx(SPEED, abs=0.05)
    hub = np.array([inflow.velocity([0.0, 0.0, HUB], t)[0] for t in times])
    assert effective.std() < hub.std()
    z, y = np.meshgrid(box.z, box.y, indexing="ij")
    disc = np.hypot(z - HUB, y) < 0.5 * DIAMETER
    coarse = SPEED + box.fluctuation[::4, disc, 0].mean(axis=1)
    assert np.corrcoef(coarse, effective)[0, 1] > 0.95


# ---- interpolation --------------------------------------------------------------------------------------------------

TURBINE = load_turbine("nrel_5mw")
FINE = 16
"""Readings in one interval of a box."""


def read_at_hub(inflow, fine=FINE):
    """Wind at the hub over one period [m/s], shape (n, 3), and the interval [s]: points upwind meet it at once."""
    box = inflow.box
    dt = box.time_step / fine
    times = dt * np.arange(fine * box.fluctuation.shape[0])
    points = np.column_stack([-inflow.mean_speed * times, 0.0 * times, np.full(times.size, HUB)])
    return inflow.velocity(points, 0.0), dt


@pytest.mark.parametrize("speed", [1.3, 3.0, 3.6, 6.0, 6.5, 9.7, 12.0, 12.5, 18.1, 24.9])
@pytest.mark.parametrize("seed", [3, 1017])
def test_the_spectrum_at_the_hub_is_the_standards_up_to_one_hertz(speed, seed):
    """At every harmonic but the first, which carries what the record leaves out."""
    sampler = WindSampler(TURBINE, WindOptions("turbulent", speed, shear_exponent=0.0, turbulence_class="B"))
    wind, dt = read_at_hub(sampler.sample(np.random.default_rng(0), wind_seed=seed).inflow)
    n = len(wind)
    frequency = np.fft.rfftfreq(n, dt)
    read = (np.abs(np.fft.rfft(wind, axis=0)) ** 2) * 2.0 * dt / n
    sigma = 0.14 * (0.75 * speed + 5.6)
    for low, high in ((0.005, 0.1), (0.1, 0.45), (0.45, 0.55), (0.65, 0.75), (0.85, 0.95)):
        inside = (frequency > low) & (frequency < high) & (np.arange(frequency.size) > 1)
        ratio = read[inside] / formula(frequency[inside], speed, sigma)
        np.testing.assert_allclose(ratio, 1.0, rtol=0.01)
    np.testing.assert_allclose(wind.std(axis=0), sigma * np.array([1.0, 0.8, 0.5]), rtol=2e-3)


def test_samples_of_the_spectrum_lose_by_interpolation_what_the_formula_says():
    """A box of the spectrum's samples has sinc^4 of it: the loss that the default makes up for."""
    options = {"seed": 5, "grid": (3, 3), "duration": 300.0, "cache": False}
    bare, full = (
        read_at_hub(TurbulentInflow(TurbulenceBox.kaimal(10.0, HUB, 126.0, "B", spectrum_of=what, **options)), 64)[0]
        for what in ("samples", "interpolated")
    )
    lost = np.abs(np.fft.rfft(bare, axis=0)[2:600]) ** 2 / np.abs(np.fft.rfft(full, axis=0)[2:600]) ** 2
    x = np.arange(2, 600) / 1200.0
    np.testing.assert_allclose(lost, (np.sinc(x) ** 4)[:, None] * np.ones(3), rtol=1e-3)


@pytest.mark.parametrize("place", [0.01, 0.25, 0.49])
def test_share_of_the_variance_between_samples(place):
    """A harmonic read in straight lines, phases and places in the cell integrated: (2 + cos 2 pi x)/3."""
    n = 100
    k = round(place * n)
    phase, s = np.meshgrid(2.0 * math.pi * np.arange(n) / n, (np.arange(400) + 0.5) / 400)
    line = (1.0 - s) * np.cos(phase) + s * np.cos(phase + 2.0 * math.pi * k / n)
    expected = 2.0 * (line**2).mean() * np.sinc(k / n) ** -4
    assert variance_read(n, "interpolated")[k - 1] == pytest.approx(expected, rel=1e-5)
    assert sample_gain(n, "interpolated")[k - 1] == pytest.approx(np.sinc(k / n) ** -4, rel=1e-12)
    assert sample_gain(n, "samples")[k - 1] == variance_read(n, "samples")[k - 1] == 1.0


@pytest.mark.parametrize("scaling", ["low_frequency", "uniform"])
def test_mann_boxes_make_up_for_it_too(scaling):
    options = {
        "mean_speed": 10.0, "hub_height": HUB, "rotor_diameter": 126.0, "turbulence_class": "B", "seed": 1,
        "duration": 600.0, "time_step": 0.25, "grid": None, "width": None, "turbulence": "NTM", "turbine_class": "I",
        "scaling": scaling,
    }  # fmt: skip
    parameters = MannParameters(**options)
    n = parameters.n_times
    read = parameters.harmonic_variance * (np.sinc(np.arange(1, n // 2) / n) ** 4)[:, None]
    wave = parameters.wave_number
    model = 2.0 * one_point_spectra(wave, parameters.length, 3.9, parameters.dissipation)[:, :3] * wave[0]
    factor = read[1:] / model[1:]
    np.testing.assert_allclose(factor, np.ones_like(factor) * factor[0], rtol=1e-9)
    if scaling == "low_frequency":
        np.testing.assert_allclose(factor, 1.0, rtol=1e-9)
    total = (read * variance_read(n, "interpolated")[:, None]).sum(axis=0)
    np.testing.assert_allclose(total, parameters.sigma**2, rtol=1e-9)


# ---- Mann -----------------------------------------------------------------------------------------------------------

SITE = {"mean_speed": 10.0, "hub_height": 90.0, "rotor_diameter": 126.0, "turbulence_class": "B"}
LENGTH, MANN_SEEDS = 33.6, 16


def parameters(seed=1, shear=3.9, **changes):
    arguments = {
        **SITE, "seed": seed, "duration": 100.0, "time_step": 0.5, "grid": (5, 5), "width": 80.0, "turbulence": "NTM",
        "turbine_class": "I", "scaling": "none", "spectrum_of": "samples",
    }  # fmt: skip
    return MannParameters(shear=shear, **{**arguments, **changes})


@pytest.fixture(scope="module")
def waves():
    """Fourier coefficients, (n_seeds, n_frequencies, n_z, n_y, 3), whose squares are the variances of the harmonics."""
    boxes = np.array([parameters(seed).synthesize() for seed in range(MANN_SEEDS)], dtype=np.float64)
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
        part, n = waves[:, band], MANN_SEEDS * (band.stop - band.start)
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


def test_boxes_are_made_once_and_repeat(tmp_path, monkeypatch):
    monkeypatch.setenv("WT_GYM_CACHE", str(tmp_path))
    small = {**SITE, "seed": 3, "duration": 20.0, "grid": (3, 3)}
    box = TurbulenceBox.mann(**small)
    (file,) = (tmp_path / "turbulence").iterdir()
    assert file.name.startswith("mann-")
    np.testing.assert_array_equal(TurbulenceBox.mann(**small, cache=False).fluctuation, box.fluctuation)
    kept = load(MannParameters(**small))
    np.testing.assert_array_equal(kept, box.fluctuation)
    assert not np.array_equal(TurbulenceBox.mann(**small, shear=0.0, cache=False).fluctuation, box.fluctuation)
    assert np.abs(box.fluctuation.mean(axis=0)).max() < 1e-5


@pytest.mark.parametrize(("change", "message"), [({"shear": -1.0}, "shear"), ({"length": 0.0}, "length")])
def test_parameters_without_meaning_are_refused(change, message):
    with pytest.raises(InflowError, match=message):
        TurbulenceBox.mann(**SITE, seed=1, **change)


# ---- evolution ------------------------------------------------------------------------------------------------------

FAST = 15.0
DISTANCES = (63.0, 189.0)
HUB_POINT = np.array([0.0, 0.0, HUB])


@pytest.fixture(scope="module")
def boxes():
    return [
        TurbulenceBox.kaimal(FAST, HUB, DIAMETER, "B", seed=seed, grid=(5, 5), cache=False) for seed in range(100, 124)
    ]


def test_formula_by_hand():
    # class B at 15 m/s: sigma_u = 0.14 (0.75 * 15 + 5.6) = 2.359 m/s, L = 8.1 * 42 m = 340.2 m
    intensity = 2.359 * math.sqrt(1.0 + 0.64 + 0.25) / 15.0
    a, b = 8.4 * intensity + 0.05, 0.25 * 340.2**-1.24
    assert a == pytest.approx(1.866, abs=1e-3)
    for distance, frequency in ((50.0, 0.02), (150.0, 0.1)):
        squared = math.exp(-a * distance * math.sqrt((frequency / 15.0) ** 2 + b * b))
        assert coherence_along(distance, frequency / 15.0, intensity, HUB) == pytest.approx(
            math.sqrt(squared), rel=1e-6
        )


@pytest.mark.parametrize("component", [0, 1, 2])
def test_coherence_between_gates_and_rotor(boxes, component):
    """Averaged over 24 boxes and bands of frequency; n harmonics scatter by sqrt((1 - c^2) / 2 n) about the mean c."""
    n_times, step = boxes[0].fluctuation.shape[0], boxes[0].time_step
    frequency = np.fft.rfftfreq(n_times, step)
    places = (0.0, *DISTANCES)
    spectra = np.zeros((3, 3, frequency.size), dtype=complex)
    intensity = 0.0
    for box in boxes:
        scaled = replace(box, scale=1.5)  # the turbulence that is met counts, not that of the samples
        fields = (scaled, *evolved_boxes(scaled, DISTANCES))
        transforms = [np.fft.rfft(f.fluctuation[..., component].astype(float), axis=0) for f in fields]
        # root of the sum of the three variances over the mean speed, of the samples as they are
        intensity += 1.5 * math.sqrt(box.fluctuation.var(axis=0).mean(axis=(0, 1)).sum()) / FAST / len(boxes)
        power = (np.abs(transforms[0]) ** 2).sum(axis=(1, 2))
        power[0] = 1.0  # there is no mean
        for i in range(3):
            for j in range(3):
                spectra[i, j] += (transforms[i].conj() * transforms[j]).sum(axis=(1, 2)) / power
    for low, high in ((3, 15), (15, 40), (40, 100), (100, 200)):
        band = slice(low, high)
        summed = spectra[..., band].sum(axis=-1)
        for i in range(3):
            for j in range(i + 1, 3):
                measured = summed[i, j] / math.sqrt(summed[i, i].real * summed[j, j].real)
                expected = coherence_along(places[j] - places[i], frequency[band] / FAST, intensity, HUB).mean()
                scatter = math.sqrt((1.0 - expected**2) / (2.0 * len(boxes) * (high - low)))
                assert measured.real == pytest.approx(expected, abs=4.0 * scatter + 0.01)
                assert abs(measured.imag) < 4.0 * scatter + 0.01


def test_what_is_seen_is_as_strong_as_what_arrives(boxes):
    """The variance is that of the box in the mean over boxes, and where many harmonics count in each."""
    shares, fast = [], []
    for box in boxes:
        (seen,) = evolved_boxes(box, (126.0,))
        before, after = (np.abs(np.fft.rfft(b.fluctuation.astype(float), axis=0)) ** 2 for b in (box, seen))
        shares.append(after[1:].sum() / before[1:].sum())
        fast.append(after[300:-1].sum() / before[300:-1].sum())
    assert np.mean(shares) == pytest.approx(1.0, abs=0.06)
    np.testing.assert_allclose(fast, 1.0, atol=0.1)


def test_a_lidar_sees_what_will_have_changed(boxes):
    wind = TurbulentInflow(boxes[0], SteadyInflow(FAST, HUB, shear_exponent=0.2))
    times = np.arange(0.0, 600.0, 0.5)
    arrives = np.array([wind.velocity(HUB_POINT, t)[0] for t in times])
    frozen, real = (Lidar((100.0,), 0.0, 1, frozen=frozen) for frozen in (True, False))
    seen = {lidar: [lidar.read(wind, t - 100.0 / FAST, 0.0, HUB)[0] for t in times] for lidar in (frozen, real)}
    np.testing.assert_allclose(seen[frozen], arrives, atol=1e-9)
    assert 0.5 < np.corrcoef(seen[real], arrives)[0, 1] < 0.97
    assert np.mean(seen[real]) == pytest.approx(arrives.mean(), abs=1e-3)
    # of the wind that arrives it knows more from near
    near = Lidar((20.0,), 0.0, 1)
    nearer = [near.read(wind, t - 20.0 / FAST, 0.0, HUB)[0] for t in times]
    assert np.corrcoef(nearer, arrives)[0, 1] > np.corrcoef(seen[real], arrives)[0, 1] + 0.02


def test_the_profile_of_a_box_does_not_change(boxes):
    samples = boxes[0].fluctuation + np.linspace(-1.0, 1.0, 5, dtype=np.float32)[:, None, None]
    box = TurbulenceBox(samples, 0.25, 10.0, 10.0, 40.0, FAST, HUB, holds_profile=True)
    (seen,) = evolved_boxes(box, (150.0,))
    np.testing.assert_allclose(seen.fluctuation.mean(axis=0), box.fluctuation.mean(axis=0), atol=1e-4)


def test_it_is_the_same_each_time_and_in_copies(boxes):
    wind = TurbulentInflow(boxes[0])
    lidar = Lidar.for_rotor(DIAMETER)
    readings = lidar.read(wind, 33.0, 0.1, HUB)
    copy = pickle.loads(pickle.dumps(wind))
    assert copy == wind
    np.testing.assert_array_equal(lidar.read(copy, 33.0, 0.1, HUB), readings)
    # gates see the same air whether others look too, the nearest first
    np.testing.assert_array_equal(Lidar(lidar.ranges[:2]).read(wind, 33.0, 0.1, HUB), readings[:2])
    np.testing.assert_allclose(Lidar(lidar.ranges[::-1]).read(wind, 33.0, 0.1, HUB), readings[::-1], rtol=1e-12)


def test_turned_wind_changes_as_much(boxes):
    wind, angle = TurbulentInflow(boxes[0]), 0.3
    turned = TurningInflow(wind, np.zeros(1), np.array([angle]))
    lidar = Lidar.for_rotor(DIAMETER)
    for time in (0.0, 21.0):
        expected = lidar.read(wind, time, 0.0, HUB)
        np.testing.assert_allclose(lidar.read(turned, time, angle, HUB), expected, rtol=1e-9)


@pytest.mark.parametrize(("make", "value"), [("eog", 0), ("edc", 1), ("ecd", 0)])
def test_a_gust_is_seen_before_it_arrives(make, value):
    gust = getattr(TransientInflow, make)(12.0, HUB, DIAMETER, start_time=20.0)
    ahead = np.array([[[-120.0, 0.0, HUB]]])
    for time in (21.0, 24.0, 29.0):
        here = gust.velocity(HUB_POINT, time)
        np.testing.assert_allclose(gust.velocity_ahead(ahead, time - 10.0, [120.0])[0, 0], here, rtol=1e-9)
        np.testing.assert_allclose(gust.velocity([120.0, 0.0, HUB], time + 10.0), here, rtol=1e-9)
        assert abs(here[value] - gust.velocity(HUB_POINT, 0.0)[value]) > 0.05


def test_a_gust_travels_along_an_oblique_wind():
    steady = SteadyInflow(12.0, HUB, yaw_misalignment=0.4, inclination=0.1)
    gust = TransientInflow(steady, "EOG", 6.0, 0.0, DIAMETER, 20.0)
    along = np.array([math.cos(0.1) * math.cos(0.4), math.cos(0.1) * math.sin(0.4), math.sin(0.1)])
    for distance in (-120.0, 60.0):
        there = gust.velocity(HUB_POINT + distance * along, 25.0 + distance / 12.0)
        np.testing.assert_allclose(there, gust.velocity(HUB_POINT, 25.0), rtol=1e-9)


def test_a_gust_that_does_not_travel_acts_everywhere():
    at_once = TransientInflow(SteadyInflow(12.0, HUB), "EOG", 6.0, 0.0, DIAMETER, 20.0, travels=False)
    points = np.array([[-500.0, 0.0, HUB], [0.0, 0.0, HUB], [500.0, 0.0, HUB]])
    for time in (0.0, 23.0, 25.25):
        velocity = at_once.velocity(points, time)
        np.testing.assert_array_equal(velocity, velocity[[1, 1, 1]])


def test_the_mirror_image_of_a_box_evolves_into_the_mirror_images(boxes):
    """Reflection at y = 0: another order of the points across, v with another sign."""
    sign = np.array([1.0, -1.0, 1.0], dtype=np.float32)
    fields = evolved_boxes(boxes[0], DISTANCES)
    image = replace(boxes[0], fluctuation=np.ascontiguousarray(boxes[0].fluctuation[:, ::-1] * sign))
    for seen, field in zip(evolved_boxes(image, DISTANCES), fields, strict=True):
        np.testing.assert_allclose(seen.fluctuation, field.fluctuation[:, ::-1] * sign, rtol=0.0, atol=1e-5)
    other = evolved_boxes(boxes[1], DISTANCES)[0]
    assert not np.allclose(other.fluctuation, fields[0].fluctuation, atol=0.1)  # another box changes in another way
