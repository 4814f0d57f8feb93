"""The spectrum of turbulence as it is read: between the samples, at whatever speed a box is carried along."""

import math

import numpy as np
import pytest

from wt_gym.envs.options.wind import WindOptions
from wt_gym.envs.wind_sampler import WindSampler
from wt_gym.turbines import load_turbine
from wt_gym.wind import TurbulenceBox, TurbulentInflow
from wt_gym.wind.kaimal import sample_gain, variance_read
from wt_gym.wind.mann import MannParameters, one_point_spectra

TURBINE = load_turbine("nrel_5mw")
HUB = 90.0
FINE = 16
"""Readings in one interval of a box."""


def iec_spectrum(frequency, speed, sigma):
    """Kaimal spectra of IEC 61400-1 written out for a hub above 60 m, shape (n, 3)."""
    ratios, lengths = np.array([1.0, 0.8, 0.5]), np.array([8.1, 2.7, 0.66]) * 42.0
    n = frequency[:, None] * lengths / speed
    return (ratios * sigma) ** 2 * 4.0 * lengths / speed / (1.0 + 6.0 * n) ** (5.0 / 3.0)


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
        ratio = read[inside] / iec_spectrum(frequency[inside], speed, sigma)
        np.testing.assert_allclose(ratio, 1.0, rtol=0.01)
    np.testing.assert_allclose(wind.std(axis=0), sigma * np.array([1.0, 0.8, 0.5]), rtol=2e-3)


def test_boxes_take_no_more_memory_than_their_record():
    boxes = [
        WindSampler(TURBINE, WindOptions("turbulent", speed)).sample(np.random.default_rng(0), wind_seed=3).inflow.box
        for speed in (6.5, 12.0, 24.9)
    ]
    assert {box.fluctuation.shape for box in boxes} == {(2400, 17, 17, 3)}
    assert {box.fluctuation.dtype for box in boxes} == {np.dtype(np.float32)}


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
