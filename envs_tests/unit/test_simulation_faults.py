"""Faults of drives and sensors: what they do to commands and readings, when, and to nothing else."""

import math
import pickle
from dataclasses import replace

import numpy as np
import pytest

from wt_gym.base.errors import ActionError
from wt_gym.control.design import rotor_inertia
from wt_gym.simulation import Signals, Simulator, channel_table
from wt_gym.simulation.drivetrain.drives import Drives, LinearDamper
from wt_gym.simulation.drivetrain.faults import (
    GeneratorLoss,
    PitchMisalignment,
    SensorBias,
    ShutDown,
    SlowPitch,
    StuckPitch,
    checked_faults,
)
from wt_gym.wind import SteadyInflow

RATED, DT = 12.1 * np.pi / 30, 0.1
RATE = math.radians(8.0)


@pytest.fixture
def drives(turbine):
    made = Drives(turbine)
    made.start(0.1, 0.0, RATED, 40e3)
    return made


def commands(drives, faults, demand, steps=30, torque=40e3):
    """Commands after each step, (steps, 5)."""
    clock = [0.0]
    drives.fail(faults, lambda: clock[0])
    found = []
    for _ in range(steps):
        drives.follow(demand, 0.0, torque, DT, RATED)
        found.append(drives.command.copy())
        clock[0] += DT
    return np.array(found)


def test_a_stuck_blade_stays_and_the_others_follow(drives):
    found = commands(drives, [StuckPitch(1.0, 2)], np.full(3, 0.6))
    assert np.all(found[10:, 3] == found[9, 3])
    assert found[9, 3] == pytest.approx(0.1 + 10 * DT * RATE)
    np.testing.assert_allclose(found[29, [2, 4]], 0.1 + 30 * DT * RATE)


def test_a_slow_drive_turns_at_its_rate_and_arrives(drives):
    found = commands(drives, [SlowPitch(1.0, 2, 0.25 * RATE)], np.full(3, 0.3), steps=80)
    np.testing.assert_allclose(found[9, 2:], 0.1 + 10 * DT * RATE)
    np.testing.assert_allclose(found[14, 3], found[9, 3] + 5 * DT * 0.25 * RATE)
    np.testing.assert_allclose(found[-1, 2:], 0.3)


def test_a_blade_that_slipped_stands_beside_its_drive_also_at_the_end_of_the_range(drives, turbine):
    """The encoder shows what was demanded, the blade stands two degrees away, below the range of the drive too."""
    offset, low = -math.radians(2.0), turbine.pitch.min_pitch
    fault = PitchMisalignment(1.0, 3, offset)
    found = commands(drives, [fault], np.full(3, low), steps=40)
    sound = commands(drives, [], np.full(3, low), steps=1)
    assert sound.shape == (1, 5)
    np.testing.assert_allclose(found[9, 4], found[9, 2])
    assert found[12, 4] - found[12, 2] == pytest.approx(-math.radians(4.0) * 3 * DT)  # at the rate at which it slips
    np.testing.assert_allclose(found[-1, 2:] - low, [0.0, 0.0, offset], atol=1e-12)
    now = {"time": 4.0, "pitch_3": low + offset, "pitch_2": low}
    values = np.array([now.get(channel.name, 0.0) for channel in channel_table(3)])
    read = fault.read(Signals(values, 3))
    assert read["pitch_3"] == pytest.approx(low)
    assert read["pitch_2"] == low
    assert fault.read(Signals(np.zeros_like(values), 3))["pitch_3"] == 0.0  # not yet


def test_a_lost_generator_brakes_no_more(drives):
    found = commands(drives, [GeneratorLoss(1.0)], np.full(3, 0.1))
    assert np.all(found[:10, 0] == 40e3)
    assert np.all(found[10:, 0] == 0.0)
    assert drives.torque(RATED) == 0.0


def test_a_shut_down_feathers_at_its_rate_and_lets_the_torque_go(drives, turbine):
    found = commands(drives, [ShutDown(1.0, 0.5 * RATE)], np.full(3, 0.1), steps=400)
    np.testing.assert_allclose(found[19, 2:], 0.1 + 10 * DT * 0.5 * RATE)
    np.testing.assert_allclose(found[-1, 2:], 0.5 * np.pi)
    assert found[10, 0] == pytest.approx(40e3 - turbine.drivetrain.max_torque_rate * DT)
    assert found[-1, 0] == 0.0


def test_no_shut_down_is_faster_than_the_drive(drives, turbine):
    found = commands(drives, [ShutDown(0.0, 1.0)], np.full(3, 0.1), steps=2)
    np.testing.assert_allclose(np.diff(found[:, 2]), turbine.pitch.max_rate * DT)


@pytest.mark.parametrize("order", [1, -1])
def test_a_stuck_blade_is_not_shut_down_in_whatever_order_faults_are_named(drives, order):
    faults = [StuckPitch(0.5, 1), ShutDown(1.0)][::order]
    found = commands(drives, faults, np.full(3, 0.1), steps=200)
    np.testing.assert_allclose(found[-1, 2:], [0.1, 0.5 * np.pi, 0.5 * np.pi])


def test_feather_is_a_right_angle_also_for_blades_that_can_turn_further(turbine):
    """From either side of it, at the greatest rate of the 5-MW pitch drive, 8 deg/s, unless another is named."""
    far = replace(turbine, pitch=replace(turbine.pitch, max_pitch=2.0))
    drives = Drives(far)
    drives.start((1.0, 1.9, 0.5 * np.pi), 0.0, RATED, 40e3)
    found = commands(drives, [ShutDown(0.0)], np.zeros(3))
    np.testing.assert_allclose(found[0, 2:], [1.0 + RATE * DT, 1.9 - RATE * DT, 0.5 * np.pi])
    assert ShutDown(0.0).rate == pytest.approx(RATE)
    found = commands(drives, [ShutDown(0.0)], np.zeros(3), steps=100)
    np.testing.assert_allclose(found[-1, 2:], 0.5 * np.pi)


def test_a_turbine_with_a_damper_shuts_down(turbine):
    drives = Drives(turbine, LinearDamper(1e6, turbine.drivetrain))
    drives.start(0.1, 0.0, RATED)
    found = commands(drives, [ShutDown(0.0)], np.full(3, 0.1), steps=10, torque=0.0)
    np.testing.assert_allclose(found[-1, 2:], 0.1 + 10 * DT * RATE)


@pytest.mark.parametrize("dt", [0.01, 0.1, 2.0])
def test_a_fault_begins_with_the_first_step_at_its_time(dt):
    """Sums of steps miss it by rounding, not by more than a millionth of a step."""
    fault = GeneratorLoss(1.0)
    assert fault.begun(1.0 - 0.9e-6 * dt, dt)
    assert not fault.begun(1.0 - 1.1e-6 * dt, dt)


def test_the_first_and_the_last_blade_can_be_stuck(drives):
    found = commands(drives, [StuckPitch(0.0), StuckPitch(0.0, 3)], np.full(3, 0.6), steps=3)
    np.testing.assert_allclose(found[-1, 2:], [0.1, 0.1 + 3 * DT * RATE, 0.1])
    with pytest.raises(ActionError, match="blade 0 cannot be stuck"):
        drives.fail([StuckPitch(0.0, 0)], lambda: 0.0)


def test_drives_are_sound_again_without_faults(drives, turbine):
    commands(drives, [StuckPitch(0.0), ShutDown(0.0), GeneratorLoss(0.0)], np.full(3, 0.3))
    drives.start(0.1, 0.0, RATED, 40e3)
    sound = Drives(turbine)
    sound.start(0.1, 0.0, RATED, 40e3)
    np.testing.assert_array_equal(commands(drives, [], np.full(3, 0.3)), commands(sound, [], np.full(3, 0.3)))
    assert drives.generator is drives.sound_generator


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: StuckPitch(-1.0), "time of a fault must be a finite number of at least 0 s, got -1"),
        (lambda: GeneratorLoss(math.nan), "time of a fault"),
        (
            lambda: SlowPitch(1.0, 1, -0.1),
            "rate of a slow pitch drive must be a finite number of at least 0 rad/s, got",
        ),
        (lambda: PitchMisalignment(1.0, 1, math.nan), "offset of a blade must be a finite number rad, got nan"),
        (lambda: ShutDown(1.0, 0.0), "pitch rate of a shut-down must be a finite number above 0 rad/s, got 0"),
        (lambda: SensorBias(1.0, ()), "channels of a sensor"),
        (lambda: SensorBias(1.0, "pitch_1"), "channels of a sensor"),
        (lambda: SensorBias(-0.5, ("pitch_1",)), "time of a fault must be a finite number of at least 0 s, got -0.5"),
        (lambda: SensorBias(1.0, ("pitch_1",), math.inf), "the factor of a sensor must be a finite number, got inf"),
        (lambda: SensorBias(1.0, ("pitch_1",), True), "factor of a sensor must be a finite number, got True"),
        (lambda: ShutDown("now"), "time of a fault must be a finite number of at least 0 s, got 'now'"),
        (lambda: checked_faults([SensorBias(1.0, ("time",))], 3), r"got \['time'\]"),
        (
            lambda: checked_faults([SensorBias(1.0, ("color",))], 3),
            r"channels of a sensor fault must be among .*; got \['color'\]",
        ),
        (lambda: checked_faults(["stuck"], 3), "a fault is a StuckPitch"),
        (lambda: checked_faults(3, 3), "a fault is a StuckPitch"),
    ],
)
def test_faults_without_meaning_are_refused(make, message):
    with pytest.raises(ActionError, match=message):
        make()


def test_what_a_turbine_does_not_have_cannot_fail(drives, turbine):
    with pytest.raises(ActionError, match="blade 4 cannot be stuck; the turbine has the blades 1 to 3"):
        drives.fail([GeneratorLoss(0.0), StuckPitch(0.0, 4)], lambda: 0.0)
    assert drives.generator is drives.sound_generator
    damped = Drives(turbine, LinearDamper(1e6, turbine.drivetrain))
    with pytest.raises(ActionError, match="damper"):
        damped.fail([GeneratorLoss(0.0)], lambda: 0.0)


def test_a_wrong_sensor_changes_what_is_read_from_its_time_on():
    names = [channel.name for channel in channel_table(3)]
    values = np.arange(len(names), dtype=float)
    bias = SensorBias(0.5, ("rotor_speed", "generator_speed"), 0.9, 2.0)
    early, late = Signals(values.copy(), 3), Signals(values.copy(), 3)
    early.values[0], late.values[0] = 0.4, 0.5
    assert bias.read(early) is early
    read = bias.read(late)
    for name in names:
        wrong = name in bias.channels
        assert read[name] == pytest.approx(0.9 * late[name] + 2.0 if wrong else late[name])
    assert late["rotor_speed"] == values[names.index("rotor_speed")]


def test_a_biased_vane_reads_directions():
    signals = Signals(np.zeros(len(channel_table(3))), 3)
    names = [channel.name for channel in channel_table(3)]
    signals.values[names.index("yaw_error")], signals.values[names.index("azimuth")] = 3.0, 6.0
    read = SensorBias(0.0, ("yaw_error", "azimuth"), 1.0, 0.5).read(signals)
    assert read.yaw_error == pytest.approx(3.5 - 2.0 * math.pi)
    assert read.azimuth == pytest.approx(6.5 - 2.0 * math.pi)
    signals.values[names.index("azimuth")] = 4.0  # within the range nothing is folded
    truth = SensorBias(0.0, ("yaw_error", "azimuth", "pitch_1")).read(signals)
    assert truth.azimuth == 4.0
    np.testing.assert_array_equal(truth.values, signals.values)  # without factor and offset a sensor reads the truth


# ---- in the simulator ----


@pytest.fixture(scope="module")
def simulator():
    return Simulator("nrel_5mw", SteadyInflow(14.0), "training")


def run(simulator, faults, duration=3.0):
    """Signals after every step."""
    simulator.faults = faults
    first = simulator.reset(rotor_speed=RATED, pitch=0.15, generator_torque=43e3)
    found = [first]
    for _ in range(round(duration / simulator.time_step)):
        found.append(simulator.advance(simulator.time_step, pitch=0.2, generator_torque=43e3))
    return found


def test_faults_that_have_not_begun_change_no_bit_and_leave_none_behind(simulator):
    sound = run(simulator, ())
    n = round(0.2 / simulator.time_step)  # the blades are on their way
    failed = run(simulator, (StuckPitch(n * simulator.time_step), GeneratorLoss(1.0)))
    assert failed[: n + 1] == sound[: n + 1]
    assert failed[n + 1] != sound[n + 1]
    assert run(simulator, ()) == sound


def test_without_its_generator_the_rotor_takes_up_the_moment_of_the_air(simulator, turbine):
    """I dΩ/dt = M while the blades stay where they are, but for the shaft and the blades, which swing about it."""
    found = run(simulator, (GeneratorLoss(0.0), StuckPitch(0.0, 1), StuckPitch(0.0, 2), StuckPitch(0.0, 3)), 3.0)[3:]
    speed = np.array([signals.rotor_speed for signals in found])
    moment = np.array([signals.aero_torque for signals in found])
    assert found[0].generator_torque == 0.0
    step = simulator.time_step
    taken_up = np.concatenate(([0.0], np.cumsum(0.5 * step * (moment[1:] + moment[:-1]))))
    drift = np.polyfit(step * np.arange(speed.size), rotor_inertia(turbine) * speed - taken_up, 1)[0]
    assert abs(drift) < 0.03 * moment.mean()


def test_copies_take_their_faults_along(simulator):
    run(simulator, (StuckPitch(0.3, 2),), 0.6)
    copy = pickle.loads(pickle.dumps(simulator))
    assert copy.faults == simulator.faults
    ends = [s.advance(0.6, pitch=0.25, generator_torque=43e3) for s in (simulator, copy)]
    assert ends[0] == ends[1]
    assert ends[0].pitch_command[1] < ends[0].pitch_command[0]


def test_a_simulator_refuses_faults_it_cannot_have_and_stays_sound(simulator):
    with pytest.raises(ActionError, match="blade 9"):
        simulator.faults = (StuckPitch(0.0, 9),)
    assert simulator.faults == ()
