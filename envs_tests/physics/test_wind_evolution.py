"""Turbulence on its way to the rotor: coherence along the wind, against the model's formula."""

import math
import pickle
from dataclasses import replace

import numpy as np
import pytest

from wt_gym.control import Lidar
from wt_gym.wind import SteadyInflow, TransientInflow, TurbulenceBox, TurbulentInflow, TurningInflow
from wt_gym.wind.turbulent import coherence_along, evolved_boxes

SPEED, HUB, DIAMETER = 15.0, 90.0, 126.0
DISTANCES = (63.0, 189.0)
HUB_POINT = np.array([0.0, 0.0, HUB])


@pytest.fixture(scope="module")
def boxes():
    return [
        TurbulenceBox.kaimal(SPEED, HUB, DIAMETER, "B", seed=seed, grid=(5, 5), cache=False) for seed in range(100, 124)
    ]


def intensity_of(box):
    """Root of the sum of the three variances over the mean speed, of the samples as they are."""
    return math.sqrt(sum(box.fluctuation[..., c].var(axis=0).mean() for c in range(3))) / SPEED


def ahead_of(distance):
    return np.array([[[-distance, 0.0, HUB]]])


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
        fields = (box, *evolved_boxes(box, DISTANCES))
        transforms = [np.fft.rfft(f.fluctuation[..., component].astype(float), axis=0) for f in fields]
        intensity += intensity_of(box) / len(boxes)
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
                expected = coherence_along(places[j] - places[i], frequency[band] / SPEED, intensity, HUB).mean()
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


def test_stronger_turbulence_changes_more(boxes):
    """Boxes of one field at two scales: coherence over a diameter by the intensity of each."""
    frequency, band = np.fft.rfftfreq(boxes[0].fluctuation.shape[0], boxes[0].time_step), slice(40, 200)
    for scale in (0.5, 1.0, 1.5):
        summed, expected = np.zeros(3), []
        for box in boxes:
            scaled = replace(box, scale=scale)
            (seen,) = evolved_boxes(scaled, (126.0,))
            assert seen.scale == scale
            first, second = (np.fft.rfft(b.fluctuation[..., 0].astype(float), axis=0)[band] for b in (box, seen))
            power = (np.abs(first) ** 2).sum(axis=(1, 2))
            summed[0] += ((first.conj() * second).sum(axis=(1, 2)) / power).sum().real
            summed[1] += ((np.abs(second) ** 2).sum(axis=(1, 2)) / power).sum()
            summed[2] += power.size
            expected.append(coherence_along(126.0, frequency[band] / SPEED, scale * intensity_of(box), HUB).mean())
        measured = summed[0] / math.sqrt(summed[1] * summed[2])
        assert measured == pytest.approx(np.mean(expected), abs=0.05)


def test_a_lidar_sees_what_will_have_changed(boxes):
    wind = TurbulentInflow(boxes[0], SteadyInflow(SPEED, HUB, shear_exponent=0.2))
    times = np.arange(0.0, 600.0, 0.5)
    arrives = np.array([wind.velocity(HUB_POINT, t)[0] for t in times])
    frozen, real = (Lidar((100.0,), 0.0, 1, frozen=frozen) for frozen in (True, False))
    seen = {lidar: [lidar.read(wind, t - 100.0 / SPEED, 0.0, HUB)[0] for t in times] for lidar in (frozen, real)}
    np.testing.assert_allclose(seen[frozen], arrives, atol=1e-9)
    assert 0.5 < np.corrcoef(seen[real], arrives)[0, 1] < 0.97
    assert np.mean(seen[real]) == pytest.approx(arrives.mean(), abs=1e-3)
    # of the wind that arrives it knows more from near
    near = Lidar((20.0,), 0.0, 1)
    nearer = [near.read(wind, t - 20.0 / SPEED, 0.0, HUB)[0] for t in times]
    assert np.corrcoef(nearer, arrives)[0, 1] > np.corrcoef(seen[real], arrives)[0, 1] + 0.02


def test_the_profile_of_a_box_does_not_change(boxes):
    samples = boxes[0].fluctuation + np.linspace(-1.0, 1.0, 5, dtype=np.float32)[:, None, None]
    box = TurbulenceBox(samples, 0.25, 10.0, 10.0, 40.0, SPEED, HUB, holds_profile=True)
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
    for time in (21.0, 24.0, 29.0):
        here = gust.velocity(HUB_POINT, time)
        np.testing.assert_allclose(gust.velocity_ahead(ahead_of(120.0), time - 10.0, [120.0])[0, 0], here, rtol=1e-9)
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
