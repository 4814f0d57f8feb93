"""Controllers that follow a demanded power: by which quantity each way holds the rotor back."""

import math
from functools import cache

import numpy as np
import pytest

from envs_tests.unit.simple_rotor import SimpleRotor
from wt_gym.control import Demand, operating_point
from wt_gym.control.bladed.records import new_swap, write_readings
from wt_gym.control.bladed.rosco import _course, with_values
from wt_gym.control.controllers import LidarFeedforward, WithDemandedPower, make_controller
from wt_gym.control.controllers.controller import demanded_power_of
from wt_gym.control.controllers.power_tracking import WAYS
from wt_gym.envs.power_reference import PowerReference
from wt_gym.simulation import Signals, channel_table
from wt_gym.turbines import load_turbine

TURBINE = load_turbine("nrel_5mw")
DRIVE = TURBINE.drivetrain
RATED_SPEED = DRIVE.rated_rotor_speed * DRIVE.gear_ratio
DT = 0.1


def readings(generator_speed, demanded=None):
    given = {"generator_speed": generator_speed}
    return given if demanded is None else given | {"demanded_power": demanded}


def spun(name, speed, wind, demanded, demand, seconds):
    """Rotor speed [rad/s], pitch [rad] and electrical power [W] after each step, in a wind over the time."""
    controller, rotor, gear = make_controller(name, TURBINE), SimpleRotor(TURBINE, speed), DRIVE.gear_ratio
    controller.start(readings(speed * gear, demanded), demand)
    for k in range(round(seconds / DT)):
        demand = controller.step(readings(rotor.speed * gear, demanded), DT)
        rotor.advance(DT, wind(k * DT), float(demand.pitch[0]), demand.generator_torque)
        power = demand.generator_torque * rotor.speed * gear * DRIVE.generator_efficiency
        yield rotor.speed, float(demand.pitch[0]), power


@cache
def settled(name, wind, demanded):
    """Speed [rad/s, generator], pitch [rad] and electrical power [W] in a steady wind."""
    point = operating_point(TURBINE, wind)
    demand = Demand(np.full(3, point.pitch), 0.0, point.generator_torque)
    *_, (speed, pitch, power) = spun(name, point.rotor_speed, lambda time: wind, demanded, demand, 400.0)
    return speed * DRIVE.gear_ratio, pitch, power


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("share", [0.6, 0.95])
def test_every_way_makes_the_demanded_power_where_the_wind_allows_it(way, share):
    speed, pitch, power = settled(f"discon+derate_{way}", 15.0, share * 5e6)
    assert power == pytest.approx(share * 5e6, rel=2e-3)
    least_speed = 1.05 * 91.2110 / (0.99 * RATED_SPEED)
    wanted = {"speed": max(share, least_speed), "kinetic": 1.05}.get(way, 1.0)
    assert speed == pytest.approx(wanted * RATED_SPEED, rel=3e-3)
    assert pitch > settled("discon", 15.0, None)[1]


def test_by_pitch_a_share_of_what_the_wind_allows_is_left_below_rated():
    _, pitch, power = settled("discon+derate_pitch", 8.0, 0.8 * 5e6)
    _, fine, whole = settled("discon", 8.0, None)
    assert pitch > fine + math.radians(1.0)
    assert power == pytest.approx(0.8 * whole, rel=0.04)
    _, other, full = settled("discon+derate_torque", 8.0, 0.8 * 5e6)
    assert (other, full) == (fine, pytest.approx(whole, rel=1e-3))


@pytest.mark.parametrize("way", WAYS)
def test_without_a_demand_and_at_full_level_the_torque_ways_are_the_base(way):
    """Bit for bit, but for the store, which has another reference speed and reads the speed without its filter."""
    base, tracked = make_controller("discon", TURBINE), make_controller(f"discon+derate_{way}", TURBINE)
    demand = Demand(np.full(3, 0.1), 0.0, 4e4)
    speeds = RATED_SPEED * (1.0 + 0.05 * np.sin(0.3 * np.arange(300)))
    for controller in (base, tracked):
        controller.start(readings(speeds[0]), demand)
    pairs = [(base.step(readings(s), DT), tracked.step(readings(s), DT)) for s in speeds.tolist()]
    same = all(np.array_equal(a.pitch, b.pitch) and a.generator_torque == b.generator_torque for a, b in pairs)
    assert same == (way != "kinetic")


def test_the_level_is_followed_where_nothing_is_read():
    assert settled("discon+derate_torque:power_level=0.7", 15.0, None)[2] == pytest.approx(3.5e6, rel=2e-3)
    assert settled("discon+derate_torque:power_level=0.7", 15.0, 4e6)[2] == pytest.approx(4e6, rel=2e-3)


def lull(name, demanded=4.2e6):
    """Energy missing [J] in a lull of 12 s in a wind that suffices otherwise, and speed at the end over rated."""
    demand, rated = Demand(np.full(3, 0.1), 0.0, 3.5e4), DRIVE.rated_rotor_speed
    steps = spun(name, rated, lambda time: 10.2 if 150.0 <= time < 162.0 else 13.0, demanded, demand, 240.0)
    speeds, _, power = np.array(list(steps)).T
    return DT * np.maximum(demanded - power[1400:], 0.0).sum(), speeds[-1] / rated


def test_the_rotor_as_a_store_carries_over_a_lull_and_recovers():
    by_torque, _ = lull("discon+derate_torque")
    from_store, after = lull("discon+derate_kinetic")
    assert by_torque > 5e6
    assert from_store < 0.5 * by_torque
    assert after > 1.03


def test_the_store_ends_where_it_is_shut():
    """In a lasting lull the rotor settles on the curve, as without a store, and does not stall."""
    speed, _, power = settled("discon+derate_kinetic", 9.0, 4.5e6)
    _, _, whole = settled("discon", 9.0, None)
    assert speed > 0.7 * RATED_SPEED
    assert power == pytest.approx(whole, rel=0.05)


def test_its_place_and_the_laws_of_its_base():
    assert isinstance(make_controller("discon+derate_torque+lidar", TURBINE), LidarFeedforward)
    large = load_turbine("iea_15mw")  # whose own controller tracks the tip-speed ratio: its pitch law, a torque curve
    assert make_controller("derate_torque", large).parameters.gain_table is not None


def test_demanded_power_is_a_reading_and_record_13():
    plain = Signals(np.zeros(len(channel_table(3))), 3)
    assert demanded_power_of(plain) is None
    asked = WithDemandedPower(plain, 4.2e6)
    assert demanded_power_of(asked) == 4.2e6
    assert asked["rotor_speed"] == 0.0
    swap = new_swap()
    write_readings(swap, asked, 3)
    assert swap[12] == np.float32(4.2e6)
    write_readings(swap, plain, 3)
    assert swap[12] == 0.0


def test_rosco_takes_a_demand_as_it_is():
    plain = Signals(np.zeros(len(channel_table(3))), 3)
    rows = {power: _course(WithDemandedPower(plain, power), 5e6).splitlines()[2].split()[1] for power in (0.0, 2e6)}
    assert rows == {0.0: "0.000000", 2e6: "0.400000"}
    assert _course(plain, 5e6).splitlines()[2].split()[1] == "1.000000"


def test_roscos_files_hold_the_course_from_the_start_on():
    course = PowerReference("steps", (0.0, 10.0, 10.0, 30.0), (4e6, 4e6, 4.5e6, 4e6))
    signals = Signals(np.zeros(len(channel_table(3))), 3)
    signals.set("time", 5.0)
    rows = np.array([
        list(map(float, line.split()))
        for line in _course(WithDemandedPower(signals, 4e6, course), 5e6).splitlines() if not line.startswith("!")
    ])  # fmt: skip
    assert (np.diff(rows[:, 0]) > 0.0).all()
    np.testing.assert_allclose(rows[:4], [[0.0, 0.8], [5.0, 0.8], [5.01, 0.9], [25.0, 0.8]])
    assert rows[-1, 0] >= 1e5
    text = with_values("0 ! PRC_Mode - mode\n1 ! Other\n", {"PRC_Mode": 2, "OL_Mode": 1})
    assert text == "2 ! PRC_Mode - mode\n1 ! Other\n1 ! OL_Mode\n"
