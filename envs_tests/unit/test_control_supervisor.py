"""Supervisory control: its states, set points and what it hands to the base controller, on a rotor of a few lines."""

import math

import numpy as np
import pytest

from envs_tests.unit.simple_rotor import SimpleRotor
from wt_gym.base.errors import ControllerError
from wt_gym.control import Demand
from wt_gym.control.controllers import STATES, DisconController, lidar_of, make_controller, supervisor_of
from wt_gym.control.controllers.controller import AtSetPoint, WithDemandedPower
from wt_gym.control.controllers.tsr_tracking import SpeedExclusion, resonant_speed
from wt_gym.turbines import load_turbine

DT = 0.1
TURBINE = load_turbine("nrel_5mw")
RATED = TURBINE.drivetrain.rated_rotor_speed
GEAR = TURBINE.drivetrain.gear_ratio


def readings(wind, speed, pitch=0.0, torque=0.0):
    """Signals that the controllers read."""
    return {"wind_x": wind, "wind_y": 0.0, "rotor_speed": speed, "generator_speed": GEAR * speed,
            "generator_torque": torque} | {f"pitch_{b}": pitch for b in (1, 2, 3)}  # fmt: skip


class Rotor(SimpleRotor):
    """That of the turbine under a controller, with drives that follow at once."""

    def __init__(self, controller, wind, speed=0.0, pitch=0.5 * math.pi, torque=0.0):
        super().__init__(TURBINE, speed)
        self.controller, self.pitch, self.torque, self.energy = controller, pitch, torque, 0.0
        self.states, self.fastest = [], speed
        controller.start(readings(wind, speed, pitch, torque), Demand(np.full(3, pitch), 0.0, torque))

    def run(self, seconds, wind):
        """Time in a wind, a number or a function of the time since the start of the run."""
        for k in range(round(seconds / DT)):
            v = wind(k * DT) if callable(wind) else wind
            demand = self.controller.step(readings(v, self.speed, self.pitch, self.torque), DT)
            self.pitch, self.torque = float(demand.pitch[0]), demand.generator_torque
            self.advance(DT, v, self.pitch, self.torque)
            self.energy += DT * self.torque * GEAR * self.speed
            self.fastest = max(self.fastest, self.speed)
            state = supervisor_of(self.controller).state
            if not self.states or self.states[-1] != state:
                self.states.append(state)
        return self


def supervised(name="discon+supervisor", **parameters):
    return make_controller(name, TURBINE, **({"averaging": 20.0} | parameters))


def test_production_at_rated_is_the_base_controller_bit_for_bit():
    base, controller = DisconController(), supervised()
    demand = Demand(np.full(3, 0.2), 0.0, 4e4)
    for one in (base, controller):
        one.start(readings(16.0, RATED, 0.2, 4e4), demand)
    for k in range(300):
        read = readings(16.0 + math.sin(0.1 * k), RATED * (1.0 + 0.05 * math.sin(0.07 * k)), 0.2, 4e4)
        one, other = base.step(read, DT), controller.step(read, DT)
        assert np.array_equal(one.pitch, other.pitch)
        assert one.generator_torque == other.generator_torque
    assert controller.state == "production"


@pytest.mark.parametrize("wind", [5.0, 14.0, 22.0])
def test_a_start_goes_from_feather_on_its_ramp_to_the_power_of_the_base(wind):
    """In strong wind the rotor would spin up within seconds; it takes the time of the ramp."""
    rotor, beyond = Rotor(supervised(run_up=80.0), wind), []
    for _ in range(2600):
        rotor.run(DT, wind)
        if rotor.controller.state == "start_up":
            beyond.append(rotor.speed / RATED - rotor.controller._ramp)
    assert rotor.states == ["parked", "start_up", "production"]
    assert max(beyond) < 0.12
    assert rotor.torque * GEAR * rotor.speed > (0.9 if wind > 12.0 else 0.2 * (wind / 12.0) ** 3) * 5e6
    assert rotor.fastest < 1.1 * RATED


@pytest.mark.parametrize(("sample", "wind"), [(26.5, 29.0), (14.0, 29.0), (10.0, 1.0)])
def test_one_reading_does_not_start_a_parked_turbine(sample, wind):
    """Parked in a storm or a calm the turbine stands although the wind of the first instant would do."""
    rotor = Rotor(supervised(), sample).run(60.0, lambda t: sample if t < 0.5 else wind)
    assert rotor.states == ["parked"]
    late = Rotor(supervised(averaging=60.0), 1.0).run(29.0, 8.0)  # the time of the filter has to pass
    assert late.states == ["parked"]
    assert late.run(2.0, 8.0).states == ["parked", "start_up"]


def test_an_agent_has_no_share_but_in_production():
    rotor = Rotor(supervised(), 8.0)
    shares = {state: [] for state in STATES}
    for seconds, wind in ((200.0, 8.0), (200.0, 1.0)):
        for _ in range(round(seconds / DT)):
            rotor.run(DT, wind)
            shares[rotor.controller.state].append(rotor.controller.agent_share)
    assert not any(shares["parked"] + shares["start_up"] + shares["shut_down"])
    assert min(map(len, (shares["parked"], shares["start_up"], shares["shut_down"]))) > 10
    assert shares["production"][0] < 0.01
    assert shares["production"][-1] == 1.0


@pytest.mark.parametrize("wind", [18.0, 27.5])
def test_an_offset_beyond_what_acts_is_held_there(wind):
    """At both ends of what acts the set point is that of the offset, and no less."""
    controller = supervised()
    rotor = Rotor(controller, 20.0, RATED, 0.3, 4e4).run(100.0, lambda t: min(20.0 + 0.1 * t, wind))
    for asked in (0.3, -1.0):
        controller.asked = held = controller.acting_offset(asked)
        rotor.run(60.0, wind)
        wanted, _ = controller.set_points(controller.mean_wind)
        assert abs(held) < abs(asked)
        assert controller.set_point == pytest.approx(wanted + held, abs=1e-2)


def test_a_calm_stops_the_turbine_and_a_wind_starts_it_again():
    rotor = Rotor(supervised(), 8.0, 0.75 * RATED, 0.0, 2e4).run(60.0, 8.0)
    rotor.run(300.0, lambda t: max(8.0 - 0.1 * t, 1.0))
    assert rotor.states == ["production", "shut_down", "parked"]
    assert rotor.speed < 0.1 * RATED
    assert rotor.torque == 0.0
    assert rotor.pitch == pytest.approx(0.5 * math.pi)
    rotor.run(300.0, 7.0)
    assert rotor.states[3:] == ["start_up", "production"]


def test_a_storm_holds_the_turbine_back_then_stops_it_and_hysteresis_keeps_it():
    rotor = Rotor(supervised(), 20.0, RATED, 0.3, 4e4).run(20.0, 20.0)
    rotor.run(180.0, lambda t: min(20.0 + 0.1 * t, 27.0))
    supervisor = supervisor_of(rotor.controller)
    share, power = supervisor.set_points(27.0)
    assert rotor.states == ["production", "soft_cut_out"]
    assert rotor.speed / RATED == pytest.approx(share, rel=0.02)
    assert rotor.torque * GEAR * rotor.speed / 5.297e6 == pytest.approx(power, rel=0.03)
    rotor.run(120.0, lambda t: min(27.0 + 0.1 * t, 32.0))
    assert rotor.states[2:] == ["shut_down", "parked"]
    assert rotor.fastest < 1.15 * RATED
    rotor.run(120.0, 28.5)  # below cut-out, above the wind of a restart
    assert rotor.states[-1] == "parked"
    rotor.run(300.0, 24.0)
    assert [state for state in rotor.states[4:] if state != "production"] == ["start_up", "soft_cut_out"]


def test_a_hard_cut_out_never_holds_back():
    controller = supervised(cut_out=25.0, least_speed=1.0, least_power=1.0)
    rotor = Rotor(controller, 20.0, RATED, 0.3, 4e4).run(60.0, 24.5)
    assert rotor.states == ["production"]
    rotor.run(60.0, 26.0)
    assert rotor.states == ["production", "shut_down", "parked"]


def test_a_gust_and_an_overspeed_stop_at_once_and_torque_falls_with_the_square_of_the_speed():
    rotor = Rotor(supervised(averaging=600.0), 18.0, RATED, 0.25, 4e4).run(5.0, 18.0).run(15.0, 48.0)
    assert "shut_down" in rotor.states
    rotor = Rotor(supervised(averaging=600.0), 14.0, 1.21 * RATED, 0.2, 4e4).run(DT, 14.0)
    assert rotor.states == ["shut_down"]
    speed, torque = rotor.speed, rotor.torque
    while rotor.speed > 0.7 * RATED:
        rotor.run(DT, 14.0)
    read_at = rotor.controller._first_speed * RATED
    assert rotor.torque / torque == pytest.approx((read_at / speed) ** 2, rel=0.05)
    rotor.run(20.0, 14.0)
    assert rotor.torque == 0.0


@pytest.mark.parametrize(("wind", "pitch", "share"), [(18.0, 0.25, 1.0), (9.0, 0.0, 0.1)])
def test_the_set_point_moves_no_faster_than_a_start_up_or_without_pitch_ten_times_as_fast(wind, pitch, share):
    controller = supervised()
    rotor = Rotor(controller, wind, RATED, pitch, 3e4).run(DT, wind)
    for controller.asked in (-0.2, 0.1):
        before = controller.set_point
        rotor.run(DT, wind)
        change = -math.copysign(DT / (share * controller.run_up), -controller.asked)
        assert controller.set_point - before == pytest.approx(change)


def test_an_agent_moves_the_set_point_within_its_limits():
    controller = supervised()
    rotor = Rotor(controller, 18.0, RATED, 0.25, 4e4).run(10.0, 18.0)
    controller.asked = -0.2
    rotor.run(60.0, 18.0)
    assert rotor.speed / RATED == pytest.approx(0.8, rel=0.02)
    assert rotor.torque * GEAR * rotor.speed == pytest.approx(0.8 * 5.297e6, rel=0.03)
    controller.asked = 0.3
    rotor.run(60.0, 18.0)
    assert controller.set_point == 1.0
    controller.asked = -5.0
    rotor.run(60.0, 18.0)
    assert controller.set_point == pytest.approx(controller.cut_in_speed)


@pytest.mark.parametrize(("wind", "share"), [(16.0, 0.5), (27.0, 0.4), (27.0, 0.9)])
def test_a_demanded_power_is_followed_up_to_that_of_the_set_point(wind, share):
    controller = supervised("discon+derate_torque+supervisor", averaging=5.0)
    rotor = Rotor(controller, 20.0, RATED, 0.3, 4e4)
    step = controller.step
    controller.step = lambda signals, dt: step(WithDemandedPower(signals, share * 5e6, "reference"), dt)
    rotor.run(180.0, lambda t: 20.0 + (wind - 20.0) * min(t / 70.0, 1.0))
    assert "shut_down" not in rotor.states
    _, power = controller.set_points(wind)
    assert rotor.torque * GEAR * rotor.speed / 5.297e6 == pytest.approx(min(share, power), rel=0.02)


@pytest.mark.parametrize("wind", [6.0, 8.0, 10.0])
def test_the_estimated_wind_is_the_true_one_whatever_the_set_point(wind):
    """At the hand-over, while the set point rises, and while an agent moves it."""
    controller = supervised("tsr_tracking+supervisor")
    rotor, estimated = Rotor(controller, wind), []
    for k in range(2400):
        controller.asked = -0.2 if k > 1200 else 0.0
        rotor.run(DT, wind)
        if controller.state == "production":
            estimated.append(controller.base.wind)
    assert len(estimated) > 1000
    assert max(estimated) < 1.1 * wind
    assert max(abs(np.array(estimated[150:]) - wind)) < 0.1 * wind


def test_the_excluded_band_lies_in_measured_speeds():
    """Under a set point of 0.8 the speed that is held is not within the band."""
    large = load_turbine("iea_22mw")
    base = make_controller("tsr_tracking", large)
    base.exclusion = band = SpeedExclusion.of_turbine(large, 0.08)
    gear = large.drivetrain.gear_ratio
    for wind in np.linspace(4.0, 10.0, 13):
        speed = 0.7 * large.drivetrain.rated_rotor_speed
        read = readings(wind, speed) | {"generator_speed": gear * speed}
        base.start(AtSetPoint(read, 0.8), Demand(np.zeros(3), 0.0, 1e6))
        base._wind.reset(wind)
        shift = max(base._shift.value, 0.0) * base.parameters.rated_speed
        tracked = 0.8 * (base._speed.value - base._errors(600.0)[0] + shift)
        assert not band.low + 1e-9 < tracked < band.high - 1e-9


def test_its_place_is_around_the_base_and_before_the_additions():
    controller = supervised("discon+ipc+supervisor+lidar")
    assert supervisor_of(controller) is controller.base
    assert lidar_of(controller) is controller.base.base.lidar is not None
    assert supervisor_of(make_controller("ipc", TURBINE)) is None
    large = load_turbine("iea_22mw")
    band = make_controller("discon+supervisor", large, resonance=0.08).base.exclusion
    assert band.low < resonant_speed(large) * large.drivetrain.gear_ratio < band.high


@pytest.mark.parametrize(
    ("name", "parameters", "error", "message"),
    [
        ("rosco+supervisor", {"start_stop": True}, TypeError, "rosco without derate and start_stop"),
        ("rosco+supervisor", {"derate": "torque"}, TypeError, "rosco without derate and start_stop"),
        ("discon+supervisor", {"cut_out": 5.0}, ControllerError, "cut-in < restart"),
        ("discon+supervisor", {"least_power": 0.9}, ValueError, "least_power must be at most"),
        ("discon+supervisor", {"resonance": 0.1}, ValueError, "tracks the tip-speed ratio"),
        ("discon+supervisor", {"overspeed": 0.9}, ValueError, "above 1"),
    ],
)
def test_what_does_not_fit_is_refused(name, parameters, error, message):
    if name.startswith("rosco"):
        pytest.importorskip("rosco")
    with pytest.raises(error, match=message):
        supervised(name, **parameters)


def test_resonant_speeds_are_within_the_range_of_the_large_turbines_alone():
    assert resonant_speed(TURBINE) is not None  # 6.7 rpm, just below the least speed of 6.9
    large = load_turbine("iea_22mw")
    speed = resonant_speed(large)
    assert large.drivetrain.min_rotor_speed < speed < large.drivetrain.rated_rotor_speed
    with pytest.raises(ValueError, match="resonance must be 0 for"):
        SpeedExclusion.of_turbine(load_turbine("nrel_5mw_monopile"), 0.1)


def test_a_set_point_waits_at_the_ends_of_the_band_and_crosses_it_quickly():
    band = SpeedExclusion(4.0, 5.0, 0.5)
    assert [band.moved(w, DT) for w in (3.0, 3.9, 4.2, 4.8, 4.99)] == [3.0, 3.9, 4.0, 4.0, 4.0]
    path = [band.moved(5.1, DT) for _ in range(30)]
    assert path[0] == pytest.approx(4.05)
    assert path[-1] == pytest.approx(5.1)
    assert np.diff(path).max() <= 0.05 + 1e-12
    assert [band.moved(w, DT) for w in (4.9, 4.5, 4.01)][-1] == pytest.approx(5.0, abs=0.11)
    for _ in range(40):
        last = band.moved(3.5, DT)
    assert last == 3.5
    above = SpeedExclusion(4.0, 5.0, 0.5, least=4.5)  # nothing below the band to wait at
    assert above.moved(4.6, DT) == 5.0
    band = SpeedExclusion(40.0, 60.0, 4.0)
    path = [band.moved(wanted, DT) for wanted in [39.0] + 250 * [100.0]]  # no jump behind the band
    assert abs(np.diff(path)).max() <= 4.0 * DT + 1e-9
    assert path[-1] == 100.0
    assert band.moved(109.0, DT) == 109.0  # away from the band nothing is held
