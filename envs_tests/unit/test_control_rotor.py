"""The rotor by blade elements, and design points from it, against published numbers."""

import math
from dataclasses import replace

import numpy as np
import pytest

from wt_gym.control.design import design_point, full_power_wind, speed_filter, speed_loop, trim_pitch
from wt_gym.control.operating_point import operating_point
from wt_gym.control.rotor import blade_element_table, fine_pitch, rotor_of, rotor_table
from wt_gym.turbines import ControlData, load_turbine


def bare(name):
    """A turbine of whose controller nothing is published."""
    return replace(load_turbine(name), control=None)


@pytest.mark.parametrize(
    ("name", "ratio", "power"),
    # NREL/TP-500-38060: 0.482 at 7.55; NREL/TP-5000-75698: 0.489 at 9; windIO's file of the IEA 22-MW: 9.15
    [("nrel_5mw", 7.55, 0.482), ("iea_15mw", 9.0, 0.489), ("iea_22mw", 9.15, None)],
)
def test_the_optimum_is_the_published_one(name, ratio, power):
    found = rotor_of(load_turbine(name)).optimum
    assert found[0] == pytest.approx(ratio, rel=0.02)
    assert abs(math.degrees(found[1])) < 1.5
    if power is not None:
        assert found[2] == pytest.approx(power, rel=0.02)


def test_splines_hold_what_is_solved():
    turbine = load_turbine("nrel_5mw")
    rotor, wind = rotor_of(turbine), np.array([4.0, 8.0, 12.3, 17.7, 24.9])
    speed, pitch = np.array([0.75, 0.96, 1.267, 1.267, 1.267]), np.radians([0.0, 0.0, 4.1, 14.3, 23.3])
    solved = rotor.elements.solve(wind, speed, pitch)
    np.testing.assert_allclose(rotor.power(wind, speed, pitch), solved["power"], rtol=0.01)
    np.testing.assert_allclose(rotor.thrust(wind, speed, pitch), solved["thrust"], rtol=0.01)
    beyond = rotor.elements.solve(2.0, 1.267, 0.0)  # a tip-speed ratio of 40
    assert rotor.power(2.0, 1.267, 0.0)[0] == beyond["power"][0]


def test_trim_pitch_of_the_nrel_5mw():
    """NREL/TP-500-38060, Table 7-1: 3.83 deg at 12 m/s to 23.47 deg at 25 m/s."""
    winds = np.array([12.0, 15.0, 20.0, 25.0])
    published = np.array([3.83, 10.45, 17.47, 23.47])
    np.testing.assert_allclose(np.degrees(trim_pitch(bare("nrel_5mw"), winds)), published, atol=0.6)
    np.testing.assert_allclose(np.degrees(trim_pitch(load_turbine("nrel_5mw"), winds)), published, atol=1e-9)
    assert full_power_wind(bare("nrel_5mw")) == pytest.approx(11.4, rel=0.03)


def test_pitch_sensitivity_of_the_nrel_5mw():
    """The published line is -25.52 (1 + theta/6.302 deg) MW/rad; section 7.3, with a frozen wake."""
    turbine = bare("nrel_5mw")
    rotor, speed = rotor_of(turbine), turbine.drivetrain.rated_rotor_speed
    for wind, pitch in ((15.0, 10.45), (20.0, 17.47), (25.0, 23.47)):
        published = -25.52e6 * (1.0 + pitch / 6.302)
        frozen, slopes = (made(wind, speed, math.radians(pitch)) for made in (rotor.frozen_pitch_slope, rotor.slopes))
        assert frozen == pytest.approx(published, rel=0.09)
        assert frozen < slopes.torque_pitch * speed < 0.0  # more than with a wake in equilibrium
        assert slopes.torque_wind > 0.0 > slopes.torque_speed
        assert slopes.thrust_wind > 0.0 > slopes.thrust_pitch


@pytest.mark.parametrize(("name", "published"), [("nrel_5mw", 0.6), ("iea_15mw", 0.2), ("iea_22mw", 0.2)])
def test_frequency_rule_gives_the_published_frequency(name, published):
    assert speed_loop(bare(name)).natural_frequency == pytest.approx(published, rel=0.1)


@pytest.mark.parametrize(("limit", "turned"), [("by_pitch_rate", "pitch"), ("by_tower", "tower")])
def test_frequency_rule_follows_its_limits(limit, turned):
    """Slower drives and a softer tower lower the frequency in proportion."""
    turbine = bare("nrel_5mw")
    if turned == "pitch":
        changed = replace(turbine, pitch=replace(turbine.pitch, max_rate=0.5 * turbine.pitch.max_rate))
    else:
        table = turbine.tower.structure
        soft = replace(table, stiffness=0.25 * table.stiffness)
        changed = replace(turbine, tower=replace(turbine.tower, structure=soft))
    assert getattr(speed_loop(changed), limit) == pytest.approx(0.5 * getattr(speed_loop(turbine), limit))
    assert speed_loop(changed).natural_frequency < speed_loop(turbine).natural_frequency


@pytest.mark.parametrize("damping", [None, 0.7, 1.2])
def test_frequency_rule_keeps_the_lag_of_the_speed_filter(damping):
    """As large as that of the NREL 5-MW at 0.6 rad/s, whatever the filter."""
    control = ControlData(speed_filter_frequency=1.1, speed_filter_damping=damping)
    turbine = replace(load_turbine("nrel_5mw"), control=control)
    x = speed_loop(turbine).by_filter / 1.1
    answer = 1.0 / (1.0 + 1j * x) if damping is None else 1.0 / (1.0 - x**2 + 2j * damping * x)
    assert -np.angle(answer) == pytest.approx(math.atan(0.6 / 1.570796))
    assert speed_loop(turbine).natural_frequency == speed_loop(turbine).by_filter
    assert speed_filter(load_turbine("iea_15mw"))[1] == 0.7


def test_published_numbers_go_before_the_rotor():
    known, unknown = design_point(load_turbine("nrel_5mw")), design_point(bare("nrel_5mw"))
    assert (known.peak_power_coefficient, known.tip_speed_ratio, known.natural_frequency) == (0.482, 7.55, 0.6)
    assert known.pitch_sensitivity == pytest.approx(-25.52e6 / 5.296610e6)
    assert unknown.peak_power_coefficient != known.peak_power_coefficient
    large = load_turbine("iea_22mw")  # windIO's file: a schedule from -1.2834 deg, a tip-speed ratio of 9.15
    assert fine_pitch(large) == pytest.approx(math.radians(-1.2834), abs=1e-5)
    point = operating_point(large, 8.2848)
    assert point.rotor_speed * 142.0 / 8.2848 == pytest.approx(9.15)
    assert math.degrees(point.pitch) == pytest.approx(-1.07716, abs=1e-4)


def test_any_turbine_has_its_table_at_once(tmp_path, monkeypatch):
    monkeypatch.setenv("WT_GYM_CACHE", str(tmp_path))
    turbine = load_turbine("iea_22mw")
    table = rotor_table(turbine)
    assert table is blade_element_table(turbine)
    assert table.made_by == "blade elements"
    rotor, point = rotor_of(turbine), (12.0, 0.7, math.radians(8.0))
    assert table.torque(*point) * point[1] == pytest.approx(float(rotor.power(*point)[0]), rel=0.02)
