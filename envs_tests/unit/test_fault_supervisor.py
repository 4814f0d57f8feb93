"""The supervisor of faults: what it finds, what it puts in the place of readings; sound ones pass as they are."""

import math
from dataclasses import replace

import numpy as np
import pytest

from wt_gym.control import Demand
from wt_gym.control.controllers.controller import lidar_of, parts_of
from wt_gym.control.controllers.fault_supervisor import FaultSupervisor, fault_supervisor_of
from wt_gym.control.controllers.linear_optimal import linear_part
from wt_gym.control.controllers.names import make_controller
from wt_gym.control.controllers.supervisor import supervisor_of
from wt_gym.control.design import reference_flap_moment
from wt_gym.turbines import load_turbine

TURBINE = load_turbine("nrel_5mw")
DRIVE = TURBINE.drivetrain
RATED, N, REFERENCE = DRIVE.rated_rotor_speed, DRIVE.gear_ratio, reference_flap_moment(TURBINE)
DT = 0.1


def readings(k, pitch):
    """A turbine above rated wind that turns in a shear, its blades where they are."""
    speed = RATED * (1.01 + 0.01 * math.sin(0.3 * DT * k))
    azimuth, torque = 1.3 * DT * k, 40e3
    signals = {
        "rotor_speed": speed, "generator_speed": N * speed, "generator_torque": torque, "azimuth": azimuth,
        "generator_power": DRIVE.generator_efficiency * torque * N * speed, "yaw_error": 0.05 * math.sin(0.7 * k),
        "wind_x": 15.0 + math.sin(k), "wind_y": 0.0,
        "nacelle_acceleration_fore_aft": 0.0, "nacelle_acceleration_side_side": 0.0,
    }  # fmt: skip
    for b in range(3):
        signals[f"pitch_{b + 1}"] = pitch[b]
        place = azimuth + 2.0 * math.pi * b / 3.0
        signals[f"root_flap_moment_{b + 1}"] = REFERENCE * (0.5 + 0.1 * math.cos(place) + 0.01 * math.sin(k))
    return signals


def fly(choice, spoil=lambda k, signals: None, steps=100, follow=None, **parameters):
    """Controller and its demands (steps, 5), with drives that are ideal unless ``follow`` moves them."""
    controller = make_controller(choice, TURBINE, **parameters)
    pitch, rows = np.full(3, 0.2), []
    held = Demand(pitch.copy(), 0.0, 40e3)
    for k in range(steps):
        signals = readings(k, pitch)
        spoil(k, signals)
        if k == 0:
            controller.start(signals, held)
        demand = controller.step(signals, DT)
        rows.append((*demand.pitch, demand.yaw_rate, demand.generator_torque))
        moved = np.clip(demand.pitch, pitch - 0.14 * DT, pitch + 0.14 * DT)
        pitch = moved if follow is None else follow(k, pitch, moved)
    return controller, np.array(rows)


def put(name, value, first=30, last=10_000):
    """Readings of one channel from a sample on to another; a function of what is read, or a number."""

    def spoil(k, signals):
        if first <= k < last:
            signals[name] = value(signals[name]) if callable(value) else value

    return spoil


def individual(rows):
    return np.ptp(rows[:, :3], axis=1)


@pytest.mark.parametrize("base", ["discon", "ipc+yaw", "linear_optimal+yaw"])
def test_sound_readings_pass_and_demands_are_those_of_the_controller(base):
    guarded, found = fly(f"{base}+fault_supervisor")
    _, plain = fly(base)
    np.testing.assert_array_equal(found, plain)
    assert guarded.alarms == ()
    assert fault_supervisor_of(guarded) is guarded
    assert fault_supervisor_of(guarded.base) is None
    assert [type(part).__name__ for part in parts_of(guarded)] == [
        type(part).__name__ for part in parts_of(make_controller(base, TURBINE))
    ]


@pytest.mark.parametrize("torque", [40e3, 0.0])
@pytest.mark.parametrize("name", ["rotor_speed", "generator_speed"])
@pytest.mark.parametrize("factor", [0.0, 0.97, 1.05])
def test_a_wrong_speed_is_outvoted(name, factor, torque):
    """Without torque the greater of two counts: a rotor that is taken for slow runs away."""

    def spoil(k, signals, wrong=True):
        signals["generator_torque"] = torque
        signals["generator_power"] *= torque / 40e3
        if wrong and k >= 30:
            signals[name] *= factor

    if torque == 0.0 and factor > 1.0:
        return
    choice = "ipc" if torque else "discon"
    guarded, found = fly(f"{choice}+fault_supervisor", spoil)
    _, sound = fly(choice, lambda k, signals: spoil(k, signals, False))
    np.testing.assert_allclose(found, sound, rtol=1e-12, atol=1e-12)
    assert guarded.alarms == (name,)


def test_a_shifted_gauge_is_shifted_back_and_individual_pitch_goes_on():
    shift = 0.3 * REFERENCE
    guarded, found = fly("ipc+fault_supervisor", put("root_flap_moment_2", lambda value: value + shift))
    _, sound = fly("ipc")
    assert guarded.alarms == ("gauge_shift_2",)
    assert np.abs(found[:, :3] - sound[:, :3]).max() < np.radians(0.1)
    _, plain = fly("ipc", put("root_flap_moment_2", lambda value: value + shift))
    assert np.abs(plain[:, :3] - sound[:, :3]).max() > np.radians(0.5)
    guarded, _ = fly("ipc+fault_supervisor", put("root_flap_moment_2", lambda value: value + shift, last=60))
    assert abs(guarded._shift[1]) < 0.05 * REFERENCE  # one that ends leaves nothing


def test_a_dead_gauge_is_replaced_by_what_the_others_leave():
    """A third of the signal is missing from two blades, none from what stands for the third one."""
    guarded, found = fly("ipc+fault_supervisor", put("root_flap_moment_1", 0.0), steps=300)
    _, sound = fly("ipc", steps=300)
    _, plain = fly("ipc", put("root_flap_moment_1", 0.0), steps=300)
    assert guarded.alarms == ("gauge_1", "gauge_shift_1")
    wrong = [np.abs(rows[100:, :3] - sound[100:, :3]).max() for rows in (found, plain)]
    assert wrong[0] < 0.2 * wrong[1]


@pytest.mark.parametrize("base", ["ipc", "linear_optimal"])
def test_one_gauge_alone_ends_individual_pitch(base):
    def spoil(k, signals):
        if k >= 30:
            signals |= {"root_flap_moment_1": 0.0, "root_flap_moment_3": 1e6}

    guarded, found = fly(f"{base}+fault_supervisor", spoil, fade_time=1.0)
    assert {"gauge_1", "gauge_3"} < set(guarded.alarms)
    assert individual(found[:30]).max() > 1e-3
    assert individual(found[50:]).max() < 1e-12  # frozen after 0.5 s, faded out a second later
    if base == "linear_optimal":
        # what the guard takes off is not believed to act
        assert linear_part(guarded)._sum[1:] == pytest.approx(0.0, abs=1e-4)


def test_with_a_dead_gauge_the_mean_moment_does_not_swing_with_the_rotor():
    """Of two blades in a shear the mean swings once a revolution; what all blades do together passes at once."""
    seen = []

    class Listener:
        channels = ()

        def start(self, signals):
            pass

        def step(self, signals, dt, demand):
            seen.append([signals[f"root_flap_moment_{b + 1}"] / REFERENCE for b in range(3)])
            return demand

    guarded = FaultSupervisor(TURBINE, make_controller("discon", TURBINE), Listener())
    pitch = np.full(3, 0.2)
    for k in range(300):
        signals = readings(k, pitch)
        put("root_flap_moment_3", 0.0)(k, signals)
        if k == 0:
            guarded.start(signals, Demand(pitch.copy(), 0.0, 40e3))
        pitch = guarded.step(signals, DT).pitch
    mean, two = np.mean(seen, axis=1)[150:], np.mean(np.array(seen)[150:, :2], axis=1)
    together = [0.5 + 0.01 * math.sin(k) for k in range(150, 300)]
    assert np.abs(mean - together).max() < 0.002
    assert np.abs(two - together).max() > 0.03


@pytest.mark.parametrize(("rate", "noticed"), [(0.0, True), (0.01, True), (0.14, False)])
def test_a_drive_that_does_not_follow_is_found_by_its_model(rate, noticed):
    def follow(k, pitch, moved):
        if k >= 30:
            moved[2] = np.clip(moved[2], pitch[2] - rate * DT, pitch[2] + rate * DT)
        return moved

    guarded, found = fly("ipc+fault_supervisor", follow=follow, steps=200)
    assert guarded.alarms == (("drive_3",) if noticed else ())
    assert (individual(found[-30:]).max() < 1e-12) == noticed


def test_what_is_asked_for_beside_the_controller_counts_too():
    """An agent's offsets move blades: the model of the drives follows the demands that they get."""
    guarded, told = (make_controller("discon+fault_supervisor", TURBINE) for _ in range(2))
    pitch = np.full(3, 0.2)
    for controller in (guarded, told):
        controller.start(readings(0, pitch), Demand(pitch, 0.0, 40e3))
    for k in range(60):
        demand = [controller.step(readings(k, pitch), DT) for controller in (guarded, told)][1]
        offset = np.radians([0.4, -0.2, -0.2]) * min(k, 10)
        told.take_demand(Demand(demand.pitch + offset, 0.0, demand.generator_torque))
        pitch = np.clip(demand.pitch + offset, pitch - 0.14 * DT, pitch + 0.14 * DT)
    assert told.alarms == ()
    assert "drive_1" in guarded.alarms


@pytest.mark.parametrize("name", ["root_flap_moment_2", "rotor_speed", "pitch_1", "yaw_error"])
def test_what_is_believed_is_what_the_parts_read_next_and_leaves_no_trace(name):
    """Of an instant that is looked at before the controller acts on it, as an agent does."""
    twins = [make_controller("ipc+yaw+fault_supervisor", TURBINE) for _ in range(2)]
    pitch, demand = np.full(3, 0.2), Demand(np.full(3, 0.2), 0.0, 40e3)
    for k in range(60):
        signals = readings(k, pitch)
        if k >= 20:
            signals[name] = 0.0
        believed = twins[1].believed(signals) if k > 0 else signals
        if 0 < k < 20:
            assert believed is signals
        if k == 50:  # well after it was found
            true = 0.0 if name == "yaw_error" else readings(k, pitch)[name]  # a dead vane holds the nacelle
            assert believed[name] == pytest.approx(true, rel=0.05)
            assert believed["root_flap_moment_1"] == signals["root_flap_moment_1"]
        for controller in twins:
            if k == 0:
                controller.start(signals, demand)
        first, second = (controller.step(signals, DT) for controller in twins)
        np.testing.assert_array_equal(first.pitch, second.pitch)
        pitch = first.pitch


def test_of_the_individual_pitch_of_an_agent_acts_what_the_supervisor_leaves():
    guarded = make_controller("discon+fault_supervisor", TURBINE)
    base = Demand(np.full(3, 0.2), 0.0, 40e3)
    asked = Demand(np.array([0.23, 0.2, 0.2]), 0.01, 41e3)
    assert guarded.with_agent(base, asked) is asked
    for share, pitch in ((0.5, [0.22, 0.205, 0.205]), (0.0, [0.21, 0.21, 0.21])):
        guarded.share = share
        found = guarded.with_agent(base, asked)
        np.testing.assert_allclose(found.pitch, pitch, atol=1e-12)
        assert (found.yaw_rate, found.generator_torque) == (asked.yaw_rate, asked.generator_torque)


@pytest.mark.parametrize("value", [0.0, lambda angle: angle + np.radians(4.0)])
def test_an_encoder_that_jumps_is_no_drive_that_fails(value):
    guarded, found = fly("ipc+fault_supervisor", put("pitch_2", value))
    _, sound = fly("ipc")
    np.testing.assert_array_equal(found, sound)
    assert guarded.alarms == ("encoder_2",)


def test_a_vane_that_is_not_believed_holds_the_nacelle():
    turning = {"yaw__dead_band": 0.05, "yaw__slow": 2.0}
    for value in (0.0, lambda angle: angle + 0.4):
        guarded, found = fly("yaw+fault_supervisor", put("yaw_error", value), steps=150, **turning)
        assert guarded.alarms == ("vane",)
        assert np.all(found[36:, 3] == 0.0)
    _, plain = fly("yaw", put("yaw_error", lambda angle: angle + 0.4), steps=150, **turning)
    assert np.any(plain[:, 3] != 0.0)
    guarded, _ = fly("yaw+fault_supervisor", lambda k, signals: signals.update(yaw_error=math.pi * (-1.0) ** k))
    assert guarded.alarms == ()  # straight from behind, either side of it
    steady, _ = fly("yaw+fault_supervisor", lambda k, signals: signals.update(yaw_error=0.0, wind_x=15.0))
    assert steady.alarms == ()  # a wind that does not change either


@pytest.mark.parametrize("stuck", [True, False])
def test_a_supervisor_among_the_parts_stops_a_turbine_whose_blade_is_stuck(stuck):
    def follow(k, pitch, moved):
        if stuck and k >= 30:
            moved[0] = pitch[0]
        return moved

    guarded, found = fly("discon+supervisor+ipc+fault_supervisor", follow=follow, steps=300, stop_deviation=0.02)
    supervisor = supervisor_of(guarded)
    assert supervisor.stopped == stuck
    assert (supervisor.state in ("shut_down", "parked")) == stuck
    if stuck:
        assert found[-1, 1] > 0.5
    guarded.start(readings(0, np.full(3, 0.2)), Demand(np.full(3, 0.2), 0.0, 40e3))
    assert not supervisor.stopped
    assert guarded.alarms == ()


def test_turbines_without_what_it_compares_are_refused():
    with pytest.raises(ValueError, match="needs at least 3 blades, which it compares, got 2"):
        make_controller("discon+fault_supervisor", replace(TURBINE, n_blades=2))
    assert lidar_of(make_controller("lidar+ipc+fault_supervisor", TURBINE)) is not None
