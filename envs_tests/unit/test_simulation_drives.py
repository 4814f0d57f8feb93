"""The laws of pitch, yaw and generator drives: limits, starts, refusals."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.signal import lsim

from wt_gym.base.errors import ActionError
from wt_gym.simulation.drivetrain.drives import Drives, LinearDamper, TorqueCommand, available_torque, pitch_delay

RATED = 12.1 * np.pi / 30
DT = 0.1


@pytest.fixture
def inputs():
    """Inputs of a structure with two velocities, the second one the generator's."""
    return SimpleNamespace(
        dof_force=np.zeros((2, 2)), servo_command=np.zeros((2, 4)), servo_rate=np.zeros((2, 4)),
        servo_interval=np.zeros((2, 4)),
    )  # fmt: skip


@pytest.mark.parametrize(("speed", "share"), [(-0.1, 0.0), (0.0, 0.0), (0.025, 0.5), (0.05, 1.0), (1.0, 1.0)])
def test_a_slow_generator_brakes_with_less_torque(turbine, speed, share):
    largest = turbine.drivetrain.max_generator_torque
    assert available_torque(turbine.drivetrain, speed * RATED) == pytest.approx(share * largest)


def test_a_standing_rotor_bears_no_torque_at_the_start(turbine):
    drives = Drives(turbine)
    drives.start(0.0, 0.0, 0.0)
    drives.load(4e6, 0.0)  # what a standing rotor would need to be balanced
    assert drives.torque(0.0) == 0.0
    drives.load(4e6, 0.025 * RATED)
    assert drives.torque(0.0) == pytest.approx(0.5 * turbine.drivetrain.max_generator_torque)
    drives.load(97.0 * 20e3, RATED)
    assert drives.torque(RATED) == pytest.approx(20e3)
    drives.load(-1e6, RATED)
    assert drives.torque(RATED) == 0.0


@pytest.mark.parametrize("make", [TorqueCommand, lambda drivetrain: LinearDamper(5e6, drivetrain)])
def test_the_generator_gets_the_power_that_the_gearbox_leaves(turbine, make):
    """0.9 of the rotor's power arrives at the generator: torque N Omega = 0.9 moment Omega, also at the balance."""
    drivetrain = replace(turbine.drivetrain, gearbox_efficiency=0.9)
    law = make(drivetrain)
    if law.damping:
        moment = law.damping * RATED
        assert law.moment(np.zeros(1)) == 0.0  # the damper stands in the structure
    else:
        command = np.array([20e3])
        moment = law.moment(command)
        assert law.balance(moment, RATED) == pytest.approx(20e3)
    arrives = law.torque(np.array([20e3]), RATED) * drivetrain.gear_ratio * RATED
    assert arrives == pytest.approx(0.9 * moment * RATED)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((0.0, 0.0, 0.0, 43e3), r"generator_torque is 43000\.0 N m; allowed at a rotor speed of 0 rad/s: 0 … 0 N m"),
        ((0.0, 0.0, RATED, -1.0), "generator_torque is -1"),
        ((0.0, 0.0, RATED, np.nan), "generator_torque"),
        ((2.0, 0.0, RATED, None), "at the start; must be"),
        ((20.0, 0.0, RATED, None), "degrees"),
        (((0.0, 0.1), 0.0, RATED, None), "3 angles"),
        ((0.0, np.inf, RATED, None), "yaw"),
    ],
)
def test_what_a_drive_refuses_changes_no_command(turbine, arguments, message):
    drives = Drives(turbine)
    drives.start(0.1, 0.2, RATED, 10e3)
    before = drives.command.copy()
    with pytest.raises(ActionError, match=message):
        drives.start(*arguments)
    assert np.array_equal(drives.command, before)


def test_a_start_may_miss_the_range_by_a_tenth_of_a_radian(turbine):
    low, high = turbine.pitch.min_pitch, turbine.pitch.max_pitch
    drives = Drives(turbine)
    for pitch in (low - 0.05, low - 0.1, high + 0.05, high + 0.1):
        drives.start(pitch, 0.0, RATED)
        assert drives.command[2:].tolist() == [pitch] * 3
    for pitch in (low - 0.11, high + 0.11):
        with pytest.raises(ActionError, match="at the start; must be"):
            drives.start(pitch, 0.0, RATED)


def test_half_a_turn_is_an_angle(turbine):
    drives = Drives(turbine)
    assert drives.pitch.vector((-np.pi, 0.0, np.pi)).tolist() == [-np.pi, 0.0, np.pi]
    for degrees in (-3.2, 3.2):
        with pytest.raises(ActionError, match="are these degrees"):
            drives.pitch.vector(degrees)


def test_a_load_changes_the_torque_alone(turbine):
    drives = Drives(turbine)
    drives.start(0.1, 0.3, RATED, 10e3)
    drives.load(97.0 * 20e3, RATED)
    np.testing.assert_allclose(drives.command, [20e3, 0.3, 0.1, 0.1, 0.1])


def test_commands_follow_demands_at_the_greatest_rates(turbine, inputs):
    drives = Drives(turbine)
    drives.start(0.1, 0.0, RATED, 20e3)
    drives.follow((1.0, 0.1, -1.0), 1.0, 1e9, DT, RATED)
    reach = np.radians(8.0) * DT
    np.testing.assert_allclose(drives.command, [21.5e3, np.radians(0.3) * DT, 0.1 + reach, 0.1, 0.1 - reach], rtol=1e-6)
    drives.act(inputs, 1, 1)
    assert inputs.dof_force[1, 1] == pytest.approx(-21.5e3 * 97.0)
    assert not inputs.dof_force[0].any()
    for _ in range(120):
        drives.follow((3.0, 0.1, -1.0), 0.0, -1.0, DT, RATED)
    np.testing.assert_allclose(drives.command[2:], [turbine.pitch.max_pitch, 0.1, turbine.pitch.min_pitch])
    assert drives.command[0] == 0.0


@pytest.mark.parametrize("rate", [-1.0, -0.001, 0.002, 1.0])
def test_the_yaw_drive_turns_both_ways(turbine, rate):
    drives = Drives(turbine)
    drives.start(0.1, 0.3, RATED)
    assert drives.command.tolist() == [0.0, 0.3, 0.1, 0.1, 0.1]
    for _ in range(2):
        drives.follow(np.full(3, 0.1), rate, 0.0, DT, RATED)
    turned = 2.0 * DT * min(abs(rate), np.radians(0.3)) * np.sign(rate)
    np.testing.assert_allclose(drives.command, [0.0, 0.3 + turned, 0.1, 0.1, 0.1], rtol=1e-6)


@pytest.mark.parametrize("frequency", [None, 10.0])
def test_an_ideal_pitch_stands_half_a_step_behind_its_command(turbine, inputs, frequency):
    """With the rate of the command; a servo gets the command alone. At the start nothing moves."""
    drives = Drives(replace(turbine, pitch=replace(turbine.pitch, servo_frequency=frequency)))
    drives.start(0.1, 0.0, RATED)
    drives.act(inputs, 1, 0)
    np.testing.assert_array_equal(inputs.servo_command, [[0.0, 0.1, 0.1, 0.1]] * 2)
    assert not inputs.servo_rate.any()
    assert not inputs.servo_interval.any()
    drives.follow((0.102, 0.1, 0.096), 0.0, 0.0, DT, RATED)
    drives.act(inputs, 1)
    moved, ideal = np.array([0.002, 0.0, -0.004]), frequency is None
    np.testing.assert_array_equal(inputs.servo_command[0], [0.0, 0.1, 0.1, 0.1])
    np.testing.assert_allclose(inputs.servo_command[1, 1:], 0.1 + (0.5 if ideal else 1.0) * moved, rtol=1e-12)
    np.testing.assert_allclose(inputs.servo_rate[1, 1:], moved / DT if ideal else 0.0, atol=1e-12)
    np.testing.assert_array_equal(inputs.servo_interval, [[0.0, *[DT if ideal else 0.0] * 3]] * 2)
    drives.start(0.1, 0.0, RATED)
    drives.act(inputs, 1, 0)
    assert not inputs.servo_interval.any()


def test_delay_of_the_pitch(turbine):
    """Interval and half a step of an ideal drive, or 2 zeta/omega: the lag of a servo behind a slow ramp."""
    servo = replace(turbine.pitch, servo_frequency=10.0, servo_damping=0.7)
    ideal = replace(turbine.pitch, servo_frequency=None)
    assert pitch_delay(ideal, 0.2, 0.05) == pytest.approx(0.225)
    assert pitch_delay(ideal, 0.2) == pytest.approx(0.3)
    assert pitch_delay(servo, 0.2, 0.05) == pytest.approx(0.34)
    time = np.linspace(0.0, 5.0, 2001)
    out = lsim(([100.0], [1.0, 14.0, 100.0]), time, time)[1]
    assert pitch_delay(servo, 0.0) == pytest.approx(time[-1] - out[-1], rel=1e-6)


def test_one_angle_is_that_of_every_blade(turbine):
    pitch = Drives(turbine).pitch
    for given, wanted in ((0.1, [0.1] * 3), ((0.1, 0.2, 0.3), [0.1, 0.2, 0.3])):
        assert pitch.vector(given).tolist() == wanted
    assert LinearDamper(0.0, turbine.drivetrain).torque(np.zeros(1), 1.0) == 0.0


def test_a_linear_damper_takes_no_demand(turbine, inputs):
    damper = LinearDamper(5e6, turbine.drivetrain)
    drives = Drives(turbine, damper)
    drives.start(0.0, 0.0, 0.5)
    drives.load(1e6, 0.5)
    drives.follow(np.zeros(3), 0.0, 0.0, DT, 0.5)
    drives.act(inputs, 1, 1)
    assert not inputs.dof_force.any()  # it acts as a damper of the structure
    assert drives.torque(0.5) == pytest.approx(5e6 * 0.5 / 97.0)
    with pytest.raises(ActionError, match="linear damper takes no demand"):
        drives.follow(np.zeros(3), 0.0, 10.0, DT, 0.5)
    with pytest.raises(ActionError, match="linear damper takes no demand"):
        drives.start(0.0, 0.0, 0.5, 10.0)
    with pytest.raises(ActionError, match="damping is -1"):
        LinearDamper(-1.0, turbine.drivetrain)
    with pytest.raises(ActionError, match="damping is inf"):
        LinearDamper(np.inf, turbine.drivetrain)
