"""IEC 61400-1 formulas against values worked out from the standard, and the transients built on them."""

import math

import numpy as np
import pytest

from wt_gym.base.errors import InflowError
from wt_gym.wind import SteadyInflow, TransientInflow, iec
from wt_gym.wind.kaimal import coherence_decay, kaimal_spectrum

HUB, DIAMETER = 90.0, 126.0
# speed, class: NTM sigma, ETM sigma (class I), EOG gust, EDC angle [deg], ECD angle [deg], EWS amplitude
CHECK_VALUES = [
    (12.0, "B", 2.0440, 3.1226, 5.1886, 29.8588, 60.0000, 5.9433),
    (12.0, "A", 2.3360, 3.5686, 5.9298, 34.0656, 60.0000, 6.4352),
    (11.4, "B", 1.9810, 3.0742, 5.0287, 30.4545, 63.1579, 5.8371),
]


@pytest.mark.parametrize(("speed", "category", "ntm", "etm", "eog", "edc", "ecd", "ews"), CHECK_VALUES)
def test_amplitudes(speed, category, ntm, etm, eog, edc, ecd, ews):
    site = (speed, HUB, DIAMETER, category)
    assert iec.turbulence_sigma(speed, category) == pytest.approx(ntm, abs=6e-5)
    assert iec.turbulence_sigma(speed, category, "ETM", "I") == pytest.approx(etm, abs=6e-5)
    assert iec.operating_gust_amplitude(*site) == pytest.approx(eog, abs=6e-5)
    assert math.degrees(iec.direction_change_amplitude(*site)) == pytest.approx(edc, abs=6e-5)
    assert math.degrees(iec.coherent_gust_direction(speed)) == pytest.approx(ecd, abs=6e-5)
    assert iec.wind_shear_amplitude(*site) == pytest.approx(ews, abs=6e-5)


def test_kaimal_constants_of_a_turbsim_summary():
    """TurbSim's certification case: 37 m hub, category C, 7.351 m/s."""
    assert iec.turbulence_sigma(7.351, "C") == pytest.approx(1.334, abs=5e-4)
    assert iec.length_scale(37.0) == pytest.approx(25.9)
    # S_u(0) = 4 sigma^2 L_u / V and kappa(0) = 12 (0.12 / L_c)
    length = kaimal_spectrum([0.0], 7.351, 37.0, 1.0)[0, 0] * 7.351 / 4.0
    assert length == pytest.approx(209.79, abs=5e-3)
    assert coherence_decay(0.0, 7.351, 37.0) / 12.0 == pytest.approx(0.000572, abs=5e-7)


def test_extreme_wind_speed():
    assert iec.extreme_wind_speed(HUB, HUB, "I", 1) == pytest.approx(56.0)
    assert iec.extreme_wind_speed(HUB, HUB, "II") == pytest.approx(1.4 * 42.5)
    assert iec.extreme_wind_speed(2.0 * HUB, HUB, "III", 50, turbulent=True) == pytest.approx(37.5 * 2.0**0.11)


def test_gust_is_limited_by_the_yearly_extreme():
    # class III: V_e1 = 42 m/s, so 1.35 (42 - 40) = 2.7 m/s is the smaller one
    assert iec.operating_gust_amplitude(40.0, HUB, DIAMETER, "A", "III") == pytest.approx(2.7)


def test_kaimal_spectrum_integrates_to_the_variance():
    frequency = np.concatenate([[0.0], np.logspace(-7, 6, 40001)])
    variance = np.trapezoid(kaimal_spectrum(frequency, 12.0, HUB, 2.0), frequency, axis=0)
    np.testing.assert_allclose(variance, [4.0, 0.64 * 4.0, 0.25 * 4.0], rtol=1e-3)


@pytest.mark.parametrize(
    "call",
    [
        lambda: iec.turbulence_sigma(8.0, "D"),
        lambda: iec.turbulence_sigma(8.0, "A", "XTM"),
        lambda: iec.reference_speed("IV"),
        lambda: iec.extreme_wind_speed(90.0, 90.0, "I", 10),
        lambda: TransientInflow.ews(8.0, HUB, DIAMETER, axis="diagonal"),
        lambda: TransientInflow.edc(8.0, HUB, DIAMETER, sign=0),
        lambda: TransientInflow.eog(0.0, HUB, DIAMETER),
        lambda: TransientInflow(8.0, "EOG", 1.0, 0.0, DIAMETER),
        lambda: TransientInflow(SteadyInflow(8.0), "EOG", math.nan, 0.0, DIAMETER),
    ],
)
def test_wrong_choices_are_refused(call):
    with pytest.raises(InflowError):
        call()


HUB_POINT = np.array([0.0, 0.0, HUB])


def hub_speed_and_direction(inflow, time):
    u, v, _ = inflow.velocity(HUB_POINT, time)
    return math.hypot(u, v), math.atan2(v, u)


def test_operating_gust_in_time():
    inflow = TransientInflow.eog(12.0, HUB, DIAMETER, start_time=30.0)
    for before_or_after in (0.0, 30.0, 40.5, 100.0):
        assert hub_speed_and_direction(inflow, before_or_after)[0] == pytest.approx(12.0)
    # at half time sin(3 pi/2) = -1 and 1 - cos(pi) = 2: the peak is V + 0.74 V_gust
    assert hub_speed_and_direction(inflow, 35.25)[0] == pytest.approx(12.0 + 0.74 * 5.1886, abs=1e-4)
    # at T/6 the sine is 1 and 1 - cos(pi/3) = 1/2
    assert hub_speed_and_direction(inflow, 31.75)[0] == pytest.approx(12.0 - 0.185 * 5.1886, abs=1e-4)
    # the profile underneath is the normal one and the gust is the same at every height
    low = np.array([0.0, 0.0, 30.0])
    assert inflow.velocity(low, 35.25)[0] == pytest.approx(12.0 * (1.0 / 3.0) ** 0.2 + 0.74 * 5.1886, abs=1e-4)


def test_direction_change_in_time():
    inflow = TransientInflow.edc(12.0, HUB, DIAMETER, sign=-1, start_time=5.0)
    expected = {0.0: 0.0, 5.0: 0.0, 8.0: -0.5 * 29.8588, 11.0: -29.8588, 60.0: -29.8588}
    for time, angle in expected.items():
        speed, direction = hub_speed_and_direction(inflow, time)
        assert speed == pytest.approx(12.0)
        assert math.degrees(direction) == pytest.approx(angle, abs=1e-3)


def test_coherent_gust_in_time():
    inflow = TransientInflow.ecd(12.0, HUB, DIAMETER)
    for time, share in {-1.0: 0.0, 0.0: 0.0, 10.0 / 3.0: 0.25, 5.0: 0.5, 10.0: 1.0, 99.0: 1.0}.items():
        speed, direction = hub_speed_and_direction(inflow, time)
        assert speed == pytest.approx(12.0 + 15.0 * share)
        assert math.degrees(direction) == pytest.approx(60.0 * share)


def test_extreme_shear_in_time():
    up = TransientInflow.ews(12.0, HUB, DIAMETER, axis="vertical", sign=1)
    left = TransientInflow.ews(12.0, HUB, DIAMETER, axis="horizontal", sign=1)
    points = np.array([[0.0, 0.0, HUB + 31.5], [0.0, 31.5, HUB], [0.0, -63.0, HUB], [0.0, -200.0, HUB]])
    normal = 12.0 * (points[:, 2] / HUB) ** 0.2
    np.testing.assert_allclose(up.velocity(points, 12.0)[:, 0], normal, rtol=1e-12)
    # at 6 s: 2 A over the distance from the hub in diameters; held beyond the rotor's edge
    change = 2.0 * 5.9433
    np.testing.assert_allclose(up.velocity(points, 6.0)[:, 0] - normal, [change / 4, 0, 0, 0], atol=1e-4)
    expected = np.array([0.0, change / 4, -change / 2, -change / 2])
    np.testing.assert_allclose(left.velocity(points, 6.0)[:, 0] - normal, expected, atol=1e-4)


def test_transient_says_what_it_is():
    inflow = TransientInflow.ecd(12.0, HUB, DIAMETER, start_time=30.0)
    assert inflow.description.startswith("IEC ECD at 30 s, amplitude 15 m/s, turning 60 deg")
    assert (inflow.mean_speed, inflow.hub_height) == (12.0, HUB)
    assert inflow == TransientInflow.ecd(12.0, HUB, DIAMETER, start_time=30.0)
