"""Statistics of Kaimal boxes against IEC 61400-1, and the exact properties of frozen turbulence.

At the hub the Fourier coefficients have the modulus of the spectrum and a random phase: exact checks. At the other
points they are sums of random phases, close to complex normal with the spectrum as variance, independent from frequency
to frequency and seed to seed. Hence the mean of n periodogram values has the relative standard error 1/√n at most, and
the mean of n products Re(X_i X_j*)/S the error √((1 + ρ²)/2n) around the coherency ρ. Bounds are four standard errors
(one false alarm in 16 000 for each number; the seeds are fixed).
"""

import math
from types import SimpleNamespace

import numpy as np
import pytest
from threadpoolctl import threadpool_info, threadpool_limits

from wt_gym.wind import SteadyInflow, TurbulenceBox, TurbulentInflow, kaimal, turbulence_box
from wt_gym.wind.coherence_kernels import parity_block

SPEED, HUB, DIAMETER = 10.0, 90.0, 126.0
SIGMA = 0.14 * (0.75 * SPEED + 5.6)
TIME_STEP, DURATION = 0.25, 600.0
N_SEEDS = 24
BANDS = np.array([0.0, 0.01, 0.03, 0.1, 0.3, 1.0, 2.0])
STANDARD_ERRORS = 4.0


def formula(frequency):
    """Kaimal spectra written out for a hub above 60 m, shape (n, 3)."""
    columns = []
    for sigma, length in ((SIGMA, 8.1 * 42.0), (0.8 * SIGMA, 2.7 * 42.0), (0.5 * SIGMA, 0.66 * 42.0)):
        n = frequency * length / SPEED
        columns.append(sigma**2 / frequency * 4.0 * n / (1.0 + 6.0 * n) ** (5.0 / 3.0))
    return np.stack(columns, axis=-1)


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


@pytest.mark.parametrize(
    ("speed", "duration", "time_step", "expected"),
    [
        (8.0, 600.0, 0.05, (0.932, 0.971, 0.980)),
        (12.0, 600.0, 0.05, (0.952, 0.977, 0.977)),
        (12.0, 600.0, 0.25, (0.945, 0.963, 0.941)),
        (20.0, 600.0, 0.05, (0.968, 0.980, 0.971)),
    ],
)
def test_unscaled_sigma(speed, duration, time_step, expected):
    """Shares of σ that harmonics from 1/T to half the sampling rate hold: sums of the spectrum computed elsewhere."""
    sigma = 0.14 * (0.75 * speed + 5.6) * np.array([1.0, 0.8, 0.5])
    for seed in (1, 2):
        series = hub_series(speed, duration, time_step, seed=seed, scaling="none")
        np.testing.assert_allclose(series.std(axis=0) / sigma, expected, atol=6e-4)


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


def test_points_beside_the_hub():
    """In the mean over seeds σ² is the target; where many harmonics add up, every single seed has the spectrum."""
    boxes = [
        TurbulenceBox.kaimal(SPEED, HUB, DIAMETER, "B", seed=s, grid=(5, 3), cache=False, spectrum_of="samples")
        for s in range(N_SEEDS)
    ]
    fields = np.array([box.fluctuation[..., 0] for box in boxes], dtype=float)
    variance = fields.var(axis=1) / SIGMA**2
    error = variance.std(axis=0) / math.sqrt(N_SEEDS)
    assert np.all(np.abs(variance.mean(axis=0) - 1.0) <= STANDARD_ERRORS * error + 1e-6)
    frequency = np.fft.rfftfreq(fields.shape[1], TIME_STEP)
    inside = (frequency >= 0.2) & (frequency <= 1.9)
    power = 2.0 * (np.abs(np.fft.rfft(fields, axis=1)[:, inside]) / fields.shape[1]) ** 2
    shares = formula(frequency[inside])[:, 0] / DURATION
    scatter = math.sqrt((shares**2).sum()) / shares.sum()
    np.testing.assert_allclose(power.sum(axis=1) / shares.sum(), 1.0, atol=STANDARD_ERRORS * scatter)


def test_lateral_components_without_coherence():
    box = TurbulenceBox.kaimal(
        SPEED,
        HUB,
        DIAMETER,
        "B",
        seed=1,
        grid=(3, 3),
        width=2.0,
        scaling="none",
        lateral_coherence=False,
        spectrum_of="samples",
        cache=False,
    )
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


def test_samples_are_met_at_the_grid(box):
    inflow = TurbulentInflow(box)
    for it, iz, iy in ((0, 0, 0), (399, 8, 8), (17, 3, 5)):
        velocity = inflow.velocity([0.0, box.y[iy], box.z[iz]], it * TIME_STEP)
        np.testing.assert_allclose(velocity, box.fluctuation[it, iz, iy] + [SPEED, 0.0, 0.0], atol=1e-9)


def test_periodic_in_time(box):
    inflow = TurbulentInflow(box)
    here = inflow.velocity(POINTS, 12.3)
    for periods in (-3, 1, 1000):
        np.testing.assert_allclose(inflow.velocity(POINTS, 12.3 + 100.0 * periods), here, atol=1e-8)
    # across the seam the wind is as smooth as elsewhere: continuous
    seam = inflow.velocity(np.array([[0.0, 3.0, 80.0]]), 100.0 - 1e-9) - inflow.velocity([[0.0, 3.0, 80.0]], 0.0)
    np.testing.assert_allclose(seam, 0.0, atol=1e-7)


def test_time_offset_shifts_the_box(box):
    shifted = TurbulentInflow(box, time_offset=33.7)
    np.testing.assert_allclose(
        shifted.velocity(POINTS, 5.0), TurbulentInflow(box).velocity(POINTS, 38.7), rtol=0.0, atol=1e-11
    )


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
