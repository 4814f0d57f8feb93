"""Winds without a file: steady, seen in a mirror, turning, on a path, and gusts of IEC 61400-1; asked in any way."""

import copy
import dataclasses
import math
import pickle

import numpy as np
import pytest

from wt_gym.base.errors import InflowError
from wt_gym.wind import iec
from wt_gym.wind.iec import TransientInflow
from wt_gym.wind.inflow import MirroredInflow, TurningInflow, fill_velocity, read_only, velocity_ahead
from wt_gym.wind.kaimal import coherence_decay, kaimal_spectrum
from wt_gym.wind.steady import SteadyInflow
from wt_gym.wind.turbulence_box import TurbulenceBox
from wt_gym.wind.turbulent import PathInflow, TurbulentInflow, speed_path

HUB, DIAMETER = 90.0, 126.0
AT_HUB = np.array([0.0, 0.0, HUB])
HEIGHTS = np.array([1.0, 10.0, 27.0, 90.0, 153.0, 400.0])
COLUMN = np.column_stack([np.zeros_like(HEIGHTS), np.zeros_like(HEIGHTS), HEIGHTS])
MIRROR = np.array([1.0, -1.0, 1.0])
POINTS = np.random.default_rng(2).uniform([-200.0, -60.0, 40.0], [200.0, 60.0, 140.0], (3, 40, 3))
SHEARED = SteadyInflow(11.0, HUB, shear_exponent=0.2, veer=0.002, yaw_misalignment=0.3, inclination=0.1)
PROFILE = SteadyInflow(1.0, HUB, shear_exponent=0.2)


class Doubled(SteadyInflow):
    """One that has its own way to a velocity."""

    def velocity(self, points, time):
        return 2.0 * super().velocity(points, time)


class Slanted:
    """One that knows nothing of the package."""

    mean_speed, hub_height, description = 8.0, HUB, "slanted"

    def velocity(self, points, time):
        return np.stack([8.0 + 0.01 * points[..., 2], np.sin(points[..., 1] + time), 0.0 * points[..., 0]], axis=-1)


@pytest.fixture(scope="module")
def box():
    return TurbulenceBox.kaimal(12.0, HUB, DIAMETER, "B", seed=3, duration=600.0, grid=(5, 5), cache=False)


def box_at(speed):
    return TurbulenceBox.kaimal(speed, HUB, DIAMETER, "B", seed=1, duration=60.0, grid=(5, 5), cache=False)


def turbulent(speed=11.0):
    return TurbulentInflow(box_at(speed), dataclasses.replace(SHEARED, speed=speed), 3.0)


def speed_and_direction(inflow, time):
    u, v, _ = inflow.velocity(AT_HUB, time)
    return math.hypot(u, v), math.atan2(v, u)


# --- steady: profiles and signs of the angles ---------------------------------------------------------------------


@pytest.mark.parametrize(
    ("profile", "expected"),
    [
        ({}, 11.4 + 0.0 * HEIGHTS),
        ({"shear_exponent": 0.14}, 11.4 * (HEIGHTS / 90.0) ** 0.14),
        ({"roughness_length": 0.03}, 11.4 * np.log(HEIGHTS / 0.03) / np.log(90.0 / 0.03)),
    ],
)
def test_profiles(profile, expected):
    wind = SteadyInflow(11.4, HUB, **profile)
    np.testing.assert_allclose(wind.velocity(COLUMN, 0.0)[:, 0], expected, rtol=1e-13)
    np.testing.assert_array_equal(wind.velocity(COLUMN, 3.0)[:, 1:], 0.0)
    ground = wind.velocity(np.array([[0.0, 0.0, 0.0], [5.0, 3.0, -1e-9], [0.0, 0.0, -200.0]]), 0.0)
    np.testing.assert_array_equal(ground[:, 0], 0.0 if profile else 11.4)


def test_positive_yaw_turns_left_veer_with_height_and_inclination_up():
    """+y is left looking downwind: counter-clockwise from above; the magnitude stays."""
    wind = SteadyInflow(8.0, HUB, veer=0.002, yaw_misalignment=0.1, inclination=math.radians(8.0))
    velocity = wind.velocity(COLUMN, 0.0)
    np.testing.assert_allclose(np.arctan2(velocity[:, 1], velocity[:, 0]), 0.1 + 0.002 * (HEIGHTS - 90.0), rtol=1e-12)
    np.testing.assert_allclose(velocity[:, 2], 8.0 * math.sin(math.radians(8.0)), rtol=1e-12)
    np.testing.assert_allclose(np.linalg.norm(velocity, axis=1), 8.0)


def test_rotor_effective_speed():
    assert SteadyInflow(8.0).rotor_effective_speed(0.0, 126.0) == pytest.approx(8.0)
    # second-order mean of a power law over the disc: 1 + a (a - 1) / 8 (R/H)^2, next term fourth order
    a, ratio = 0.2, 20.0 / 90.0
    mean = SteadyInflow(8.0, 90.0, shear_exponent=a).rotor_effective_speed([0.0, 1.0], 40.0)
    np.testing.assert_allclose(mean, 8.0 * (1.0 + a * (a - 1.0) / 8.0 * ratio**2), rtol=1e-4)


def test_any_leading_shape():
    inflow = SteadyInflow(8.0, shear_exponent=0.2)
    assert inflow.velocity([0, 0, 90], 0).tolist() == pytest.approx([8.0, 0.0, 0.0])
    assert inflow.velocity(np.empty((0, 3)), 0.0).shape == (0, 3)
    points = np.random.default_rng(1).uniform(1.0, 200.0, size=(3, 4, 2, 3))
    seen = inflow.velocity(points[::-1, :, ::-1], 0.0)
    assert (seen.shape, seen.dtype) == (points.shape, np.float64)
    np.testing.assert_array_equal(seen, inflow.velocity(points, 0.0)[::-1, :, ::-1])


@pytest.mark.parametrize(
    ("points", "time"),
    [
        ([0.0, 0.0, math.nan], 0.0), ([[0.0, 0.0, 90.0], [math.inf, 0.0, 90.0]], 0.0), ([0.0, 0.0, 90.0], math.nan),
        ([0.0, 0.0, 90.0], math.inf), ([0.0, 0.0, 90.0], "noon"), ([0.0, 90.0], 0.0), (90.0, 0.0), ("abc", 0.0),
    ],
)  # fmt: skip
def test_points_and_times_that_make_no_sense_are_refused(points, time):
    with pytest.raises(InflowError):
        SteadyInflow(8.0, shear_exponent=0.2).velocity(points, time)


@pytest.mark.parametrize(
    "change",
    [
        {"speed": -1.0}, {"speed": math.nan}, {"speed": "fast"}, {"hub_height": 0.0}, {"shear_exponent": -1.1},
        {"jet_height": 30.0}, {"jet_height": 100.0, "jet_share": 0.0}, {"roughness_length": 0.0},
        {"roughness_length": 90.0}, {"shear_exponent": 0.2, "roughness_length": 0.03}, {"yaw_misalignment": 20.0},
        {"inclination": 8.0}, {"veer": 1.0},
    ],
)  # fmt: skip
def test_parameters_out_of_range_are_refused(change):
    with pytest.raises(InflowError):
        SteadyInflow(**{"speed": 8.0, **change})


# --- every wind, asked in every step or in a mirror ---------------------------------------------------------------


@pytest.mark.parametrize(
    "make",
    [
        lambda: SHEARED, lambda: TransientInflow.eog(12.0, HUB, DIAMETER, start_time=1.0), turbulent, Slanted,
        lambda: TurningInflow(turbulent(), [0.0, 10.0], [0.0, 1.0]), lambda: Doubled(8.0),
    ],
)  # fmt: skip
def test_a_filled_memory_and_the_image_in_a_mirror_hold_the_velocity(make):
    """The image has the reflected velocity at the reflected point, also ahead of the rotor."""
    inflow, rows, distances = make(), read_only(POINTS.reshape(-1, 3)), (60.0, 120.0, 180.0)
    image = MirroredInflow(inflow)
    np.testing.assert_array_equal(image.velocity(POINTS, 2.5), inflow.velocity(POINTS * MIRROR, 2.5) * MIRROR)
    for wind in (inflow, image):
        memory = np.full((140, 3), np.nan)
        fill_velocity(wind, rows, 2.5, memory[:120])
        np.testing.assert_array_equal(memory[:120].reshape(POINTS.shape), wind.velocity(POINTS, 2.5))
        assert np.isnan(memory[120:]).all()
    expected = velocity_ahead(inflow, POINTS * MIRROR, 2.5, distances) * MIRROR
    np.testing.assert_array_equal(velocity_ahead(image, POINTS, 2.5, distances), expected)
    assert MirroredInflow.of(MirroredInflow.of(inflow)) is inflow


def test_what_is_no_wind_is_refused_and_the_point_that_is_not_finite_named():
    class Flat(Slanted):
        def velocity(self, points, time):
            return super().velocity(points, time)[..., 0]

    with pytest.raises(InflowError, match=r"shape \(40,\) at points of shape \(40, 3\)"):
        fill_velocity(Flat(), read_only(POINTS[0]), 0.0, np.empty((40, 3)))
    astray, gust = np.array([[0.0, 0.0, 90.0], [0.0, math.nan, 90.0]]), TransientInflow.eog(10.0, HUB, DIAMETER)
    with pytest.raises(InflowError, match="point 1 of 2"):
        fill_velocity(SHEARED, read_only(astray), 0.0, np.empty((2, 3)))
    for wind in (SHEARED, TurningInflow(gust, [0.0], [0.1]), MirroredInflow(gust)):
        with pytest.raises(InflowError, match=r"point 1 of 2 is \[0\.0, nan, 90\.0\]"):
            wind.velocity(astray, 0.0)


def test_the_image_says_what_the_inner_inflow_says_with_angles_on_the_other_side():
    other = dataclasses.replace(SHEARED, veer=-SHEARED.veer, yaw_misalignment=-SHEARED.yaw_misalignment)
    np.testing.assert_allclose(MirroredInflow(SHEARED).velocity(POINTS, 0.0), other.velocity(POINTS, 0.0), atol=1e-14)
    gust = TransientInflow.ecd(12.0, HUB, DIAMETER, start_time=0.5)
    image = MirroredInflow(gust)
    assert (image.mean_speed, image.hub_height, image.start_speed) == (gust.mean_speed, HUB, gust.start_speed)
    assert image.description == f"{gust.description}, mirrored"
    with pytest.raises(InflowError):
        MirroredInflow(turbulent()).require_cover(HUB, 300.0)


# --- a direction that changes -------------------------------------------------------------------------------------


def test_a_turned_wind_is_the_wind_from_there():
    """Against the misalignment that the steady wind itself can have, with shear; and a box of turbulence as a whole."""
    points = np.random.default_rng(1).uniform(-80.0, 80.0, (20, 3)) + np.array([0.0, 0.0, 100.0])
    plain, own = (SteadyInflow(9.0, HUB, shear_exponent=0.2, yaw_misalignment=a) for a in (0.0, 0.4))
    made = box_at(9.0)
    for inner, expected in ((plain, own), (TurbulentInflow(made, plain), TurbulentInflow(made, own))):
        turned = TurningInflow(inner, [0.0], [0.4])
        np.testing.assert_allclose(turned.velocity(points, 3.0), expected.velocity(points, 3.0), atol=1e-9)


def test_direction_runs_in_straight_lines_and_stays():
    wind = TurningInflow(SteadyInflow(10.0), [10.0, 20.0], [0.0, 0.5])
    for time, angle in ((0.0, 0.0), (15.0, 0.25), (99.0, 0.5)):
        assert speed_and_direction(wind, time)[1] == pytest.approx(angle)
    assert (wind.mean_speed, wind.hub_height) == (10.0, SteadyInflow(10.0).hub_height)
    assert "from 0 to 29 deg" in wind.description
    for times, directions in (([0.0, 1.0], [0.0]), ([1.0, 0.0], [0.0, 0.0]), ([0.0], [np.nan]), ([], [])):
        with pytest.raises(InflowError, match="times"):
            TurningInflow(SteadyInflow(8.0), times, directions)


def test_wandering_has_its_deviation_and_memory():
    rng = np.random.default_rng(3)
    wind = TurningInflow.wandering(SteadyInflow(8.0), 0.3, 0.1, 60.0, 200_000.0, rng)
    deviation = wind.directions - 0.3
    assert deviation[0] == 0.0
    assert deviation.std() == pytest.approx(0.1, rel=0.05)
    lag = 20  # twenty steps are one time constant
    assert np.mean(deviation[lag:] * deviation[:-lag]) / 0.01 == pytest.approx(math.exp(-1.0), abs=0.07)


# --- a mean speed that follows a path -----------------------------------------------------------------------------


def test_the_mean_follows_the_path_with_its_profile():
    wind = PathInflow([0.0, 100.0, 200.0], [0.0, 32.0, 8.0], PROFILE)
    heights = np.array([[0.0, 0.0, 90.0], [500.0, -30.0, 45.0]])
    for time, speed in ((-20.0, 0.0), (25.0, 8.0), (150.0, 20.0), (999.0, 8.0)):
        steady = SteadyInflow(max(speed, 1e-3), 90.0, shear_exponent=0.2).velocity(heights, time)
        np.testing.assert_allclose(wind.velocity(heights, time), steady, rtol=1e-12)
        assert wind.speed(time) == pytest.approx(speed)
    assert wind.start_speed == 0.0
    assert wind.mean_speed == pytest.approx(0.5 * (16.0 + 20.0))
    calm = PathInflow([0.0, 10.0], [0.0, 0.0], PROFILE)
    assert np.abs(calm.velocity(AT_HUB, 5.0)).max() < 2e-3


def test_turbulence_on_a_constant_path_is_that_of_the_box_carried_along(box):
    """At one speed the path is the frozen field of `TurbulentInflow`, also upstream and down the tower."""
    points = np.array([[0.0, 0.0, 90.0], [40.0, 33.0, 61.0], [-55.0, -20.0, 130.0], [0.0, 0.0, 12.0]])
    steady = SteadyInflow(18.0, 90.0, shear_exponent=0.2)
    frozen = TurbulentInflow(box.carried_along(18.0, 1.3, "other"), steady, time_offset=40.0)
    wind = PathInflow([0.0, 600.0], [18.0, 18.0], PROFILE, box, [1.3, 1.3], offset=40.0 * 18.0)
    for time in (-3.0, 0.0, 12.34, 480.0):
        np.testing.assert_allclose(wind.velocity(points, time), frozen.velocity(points, time), atol=2e-5)


def test_a_lidar_sees_the_turbulence_of_the_box_on_its_way(box):
    """Turbulence changes on its way to the rotor as at the speed of the box."""
    ahead = np.array([[[-120.0, 0.0, 90.0], [-120.0, 30.0, 70.0]]])
    frozen = TurbulentInflow(box, SteadyInflow(12.0, 90.0, shear_exponent=0.2), time_offset=40.0)
    wind = PathInflow([0.0], [12.0], PROFILE, box, offset=40.0 * 12.0)
    seen = wind.velocity_ahead(ahead, 5.0, (120.0,))
    np.testing.assert_allclose(seen, frozen.velocity_ahead(ahead, 5.0, (120.0,)), atol=2e-5)
    assert np.abs(seen - wind.velocity(ahead, 5.0)).max() > 0.05


def test_the_air_comes_as_far_as_the_mean_carries_it(box):
    """Between knots the way is that of a uniform acceleration: the same place of the box at the same way."""
    rising = PathInflow([0.0, 50.0], [4.0, 24.0], PROFILE, box)
    for time, speed, way in (
        (50.0, 24.0, 0.5 * (4.0 + 24.0) * 50.0),
        (25.0, 14.0, 4.0 * 25.0 + 0.5 * (20.0 / 50.0) * 25.0**2),
    ):
        still = PathInflow([0.0], [speed], PROFILE, box, offset=way)
        np.testing.assert_allclose(rising.velocity(AT_HUB, time), still.velocity(AT_HUB, 0.0), atol=1e-6)


def test_the_spectrum_moves_with_the_speed(box):
    """Half of the variance lies below a frequency that is proportional to the mean speed."""

    def median_frequency(speed):
        duration = 7200.0 / speed  # once through the box
        times = np.linspace(0.0, duration, 4096, endpoint=False)
        wind = PathInflow([0.0], [speed], PROFILE, box)
        u = np.array([wind.velocity(AT_HUB, t)[0] for t in times]) - speed
        power = np.abs(np.fft.rfft(u)[1:]) ** 2
        return (1 + np.searchsorted(np.cumsum(power), 0.5 * power.sum())) / duration

    assert median_frequency(24.0) / median_frequency(8.0) == pytest.approx(3.0, rel=1e-3)


def test_a_mirror_image_and_copies_of_a_path_are_the_same_wind(box):
    wind = PathInflow([0.0, 60.0], [3.0, 30.0], PROFILE, box, [0.5, 2.0], offset=123.0)
    point = np.array([[10.0, 25.0, 100.0]])
    seen = wind.velocity(point, 31.0)
    assert np.array_equal(MirroredInflow.of(wind).velocity(point * MIRROR, 31.0) * MIRROR, seen)
    for other in (copy.deepcopy(wind), pickle.loads(pickle.dumps(wind))):
        assert np.array_equal(other.velocity(point, 31.0), seen)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"speeds": [1.0]}, "as many"), ({"times": [1.0, 1.0]}, "increase"), ({"box": 1}, "TurbulenceBox"),
        ({"speeds": [1.0, -0.1]}, "speeds of a path must lie between 0 and 200"), ({"profile": 8.0}, "SteadyInflow"),
        ({"scales": [1.0, np.nan]}, "scales of a path"),
    ],
)  # fmt: skip
def test_what_is_no_path_is_refused(change, message):
    with pytest.raises(InflowError, match=message):
        PathInflow(**({"times": [0.0, 1.0], "speeds": [3.0, 4.0], "profile": PROFILE} | change))


def test_a_drawn_path_rises_and_falls_within_its_range_as_slowly_as_asked():
    for seed in range(20):
        times, speeds = speed_path(np.random.default_rng(seed), 0.0, 32.0, (200.0, 400.0), 1800.0, start=5.0)
        assert speeds[0] == 5.0
        assert times[-1] >= 1800.0
        assert 0.0 <= speeds.min() < 0.4 * 32.0
        assert 0.6 * 32.0 < speeds.max() <= 32.0
        # half cosines: pi/2 of the mean slope, which a short swing has in half the shortest time at least
        assert np.abs(np.diff(speeds)).max() <= 0.5 * np.pi * 32.0 / 200.0
    one, other = (speed_path(np.random.default_rng(seed), 0.0, 32.0, (200.0, 400.0), 600.0)[1] for seed in (1, 2))
    assert not np.array_equal(one, other)


# --- IEC 61400-1: values worked out from the standard, and the transients built on them ----------------------------

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
    assert kaimal_spectrum([0.0], 7.351, 37.0, 1.0)[0, 0] * 7.351 / 4.0 == pytest.approx(209.79, abs=5e-3)
    assert coherence_decay(0.0, 7.351, 37.0) / 12.0 == pytest.approx(0.000572, abs=5e-7)


def test_extreme_wind_speed_limits_the_gust():
    assert iec.extreme_wind_speed(HUB, HUB, "I", 1) == pytest.approx(56.0)
    assert iec.extreme_wind_speed(HUB, HUB, "II") == pytest.approx(1.4 * 42.5)
    assert iec.extreme_wind_speed(2.0 * HUB, HUB, "III", 50, turbulent=True) == pytest.approx(37.5 * 2.0**0.11)
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


def test_operating_gust_in_time():
    """At half time sin(3 pi/2) = -1 and 1 - cos(pi) = 2: the peak; at T/6 the sine is 1 and 1 - cos(pi/3) = 1/2."""
    inflow = TransientInflow.eog(12.0, HUB, DIAMETER, start_time=30.0)
    for time, share in {0.0: 0.0, 30.0: 0.0, 40.5: 0.0, 100.0: 0.0, 35.25: 0.74, 31.75: -0.185}.items():
        assert speed_and_direction(inflow, time)[0] == pytest.approx(12.0 + share * 5.1886, abs=1e-4)
    # the profile underneath is the normal one and the gust is the same at every height
    low = np.array([0.0, 0.0, 30.0])
    assert inflow.velocity(low, 35.25)[0] == pytest.approx(12.0 * (1.0 / 3.0) ** 0.2 + 0.74 * 5.1886, abs=1e-4)


def test_direction_change_and_coherent_gust_in_time():
    turning = TransientInflow.edc(12.0, HUB, DIAMETER, sign=-1, start_time=5.0)
    for time, angle in {0.0: 0.0, 5.0: 0.0, 8.0: -0.5 * 29.8588, 11.0: -29.8588, 60.0: -29.8588}.items():
        expected = (12.0, math.radians(angle))
        assert speed_and_direction(turning, time) == pytest.approx(expected, abs=1e-5)
    rising = TransientInflow.ecd(12.0, HUB, DIAMETER)
    for time, share in {-1.0: 0.0, 0.0: 0.0, 10.0 / 3.0: 0.25, 5.0: 0.5, 10.0: 1.0, 99.0: 1.0}.items():
        assert speed_and_direction(rising, time) == pytest.approx((12.0 + 15.0 * share, math.radians(60.0 * share)))
    later = TransientInflow.ecd(12.0, HUB, DIAMETER, start_time=30.0)
    assert later.description.startswith("IEC ECD at 30 s, amplitude 15 m/s, turning 60 deg")
    assert (later.mean_speed, later.hub_height) == (12.0, HUB)
    assert later == TransientInflow.ecd(12.0, HUB, DIAMETER, start_time=30.0)


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
