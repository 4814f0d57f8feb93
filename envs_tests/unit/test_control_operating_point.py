"""Torque curve and steady operating points against the published NREL 5-MW."""

import math
from dataclasses import replace

import numpy as np
import pytest

from wt_gym.base.errors import TurbineDefinitionError
from wt_gym.control import TorqueCurve, operating_point, torque_curve
from wt_gym.control.design import rotor_inertia
from wt_gym.turbines import ControlData, load_turbine

RPM = math.pi / 30
NREL_5MW_TORQUE_CURVE = torque_curve(load_turbine("nrel_5mw"))


@pytest.mark.parametrize(
    ("speed", "torque"),
    [
        (60.0, 0.0),  # region 1
        (70.16224, 0.0),
        (80.0, 921.8302 * (80.0 - 70.16224)),  # region 1 1/2
        (100.0, 2.332287 * 100.0**2),  # region 2
        (120.0, 3935.036 * (120.0 - 110.61864)),  # region 2 1/2
        (121.6805, 5_296_610 / 121.6805),  # region 3
        (125.0, 5_296_610 / 125.0),
        (0.0, 0.0),
        (119.01377, 2.332287 * 119.01377**2),  # transition
    ],
)
def test_torque_of_each_region(speed, torque):
    assert NREL_5MW_TORQUE_CURVE.torque(speed) == pytest.approx(torque, rel=1e-6)
    assert NREL_5MW_TORQUE_CURVE.torque(100.0, constant_power=True) == pytest.approx(52_966.10)


@pytest.mark.parametrize("gain", [2.332287, 0.0])
def test_the_curve_has_no_jumps(gain):
    curve = replace(NREL_5MW_TORQUE_CURVE, region_2_gain=gain)
    for corner in (curve.cut_in_speed, curve.region_2_speed, curve.transition_speed, curve.rated_generator_speed):
        assert curve.torque(corner - 1e-7) == pytest.approx(curve.torque(corner + 1e-7), abs=0.01)


def test_the_rule_reproduces_the_published_curve(turbine):
    # the rule knows the rotor's optimum, none of the published constants of the controller
    optimum = ControlData(peak_power_coefficient=0.482, optimal_tip_speed_ratio=7.55)
    curve, published = TorqueCurve.from_turbine(replace(turbine, control=optimum)), NREL_5MW_TORQUE_CURVE
    assert published == TorqueCurve(70.16224, 91.21091, 121.6805, 2.332287, 5_296_610.0, 0.1)  # Table 7-2
    assert curve.region_2_gain == pytest.approx(published.region_2_gain, rel=2e-3)
    assert curve.cut_in_speed == pytest.approx(published.cut_in_speed, rel=5e-3)
    assert curve.region_2_speed == pytest.approx(published.region_2_speed, rel=5e-3)
    assert curve.rated_generator_speed == pytest.approx(published.rated_generator_speed, rel=1e-4)
    assert curve.rated_power == pytest.approx(published.rated_power, rel=1e-4)


def test_rotor_inertia_of_the_nrel_5mw(turbine):
    # 43 784 725 kg m^2: the inertia behind the published pitch gains.
    assert rotor_inertia(turbine) == pytest.approx(43_784_725, rel=5e-3)


@pytest.mark.parametrize(
    ("wind_speed", "rotor_rpm", "pitch_deg", "tolerance_rpm"),
    [  # NREL/TP-500-38060, Figure 9-1
        (5.0, 7.47, 0.0, 0.25),
        (8.0, 9.14, 0.0, 0.15),
        (10.0, 11.41, 0.0, 0.15),
        (11.0, 11.91, 0.0, 0.1),
        (15.0, 12.1, 10.45, 0.02),
        (25.0, 12.1, 23.47, 0.02),
    ],
)
def test_operating_points_of_the_nrel_5mw(turbine, wind_speed, rotor_rpm, pitch_deg, tolerance_rpm):
    point = operating_point(turbine, wind_speed)
    assert point.rotor_speed / RPM == pytest.approx(rotor_rpm, abs=tolerance_rpm)
    assert math.degrees(point.pitch) == pytest.approx(pitch_deg, abs=1e-6)
    assert 0.0 <= point.generator_torque <= turbine.drivetrain.max_generator_torque


@pytest.mark.parametrize("name", ["nrel_5mw", "iea_15mw", "iea_22mw"])
def test_operating_points_rise_with_the_wind(name):
    turbine = load_turbine(name)
    points = [operating_point(turbine, v) for v in np.arange(turbine.cut_in, turbine.cut_out + 0.1, 0.5)]
    speeds, pitches = np.array([p.rotor_speed for p in points]), np.array([p.pitch for p in points])
    assert np.all(np.diff(speeds) >= 0)
    above = np.arange(turbine.cut_in, turbine.cut_out + 0.1, 0.5) > turbine.rated_wind_speed
    assert np.all(np.diff(pitches[above]) > 0)
    assert speeds[-1] == turbine.drivetrain.rated_rotor_speed


def test_iea_15mw_follows_its_design():
    # NREL/TP-5000-75698: pitch about 12 deg at 15 m/s, rated torque about 19.8 MN m.
    point = operating_point(load_turbine("iea_15mw"), 15.0)
    assert math.degrees(point.pitch) == pytest.approx(12.0, abs=1.0)
    assert point.generator_torque == pytest.approx(19.8e6, rel=0.01)


def test_an_unknown_turbine_gets_a_curve_through_its_rated_point(turbine):
    other = replace(turbine, drivetrain=replace(turbine.drivetrain, rated_power=4.0e6), control=None)
    curve = torque_curve(other)
    assert curve.torque(curve.rated_generator_speed) * curve.rated_generator_speed == pytest.approx(4.0e6 / 0.944)


def test_region_2_that_begins_at_the_least_speed_has_a_region_1_below(turbine):
    """ROSCO's files give both by one number."""
    least = 35.0
    own = replace(turbine.control, region_2_speed=least, cut_in_generator_speed=None)
    slow = replace(turbine.drivetrain, min_rotor_speed=least / turbine.drivetrain.gear_ratio)
    curve = torque_curve(replace(turbine, control=own, drivetrain=slow))
    assert curve.region_2_speed == least
    assert curve.cut_in_speed == pytest.approx(least / 1.3)


def test_bad_input_is_refused(turbine):
    with pytest.raises(ValueError, match="positive wind speed"):
        operating_point(turbine, 0.0)
    with pytest.raises(TurbineDefinitionError, match="cut-in speed < region-2 speed"):
        TorqueCurve(80.0, 70.0, 120.0, 2.3, 5e6)
    with pytest.raises(TurbineDefinitionError, match="passes the rated power"):
        TorqueCurve(70.0, 90.0, 120.0, 4.0, 5e6)
