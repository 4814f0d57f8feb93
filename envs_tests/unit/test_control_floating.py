"""Controllers of floating turbines: gains on land, feedback of the platform's pitch, ROSCO's with its records."""

import importlib.util
import math

import numpy as np
import pytest

from wt_gym.base.errors import ControllerError
from wt_gym.control import Demand
from wt_gym.control.bladed.records import channels_read, new_swap, write_platform
from wt_gym.control.bladed.rosco import _feedback_values, tuned_input
from wt_gym.control.controllers import make_controller
from wt_gym.control.controllers.floating_feedback import FloatingFeedback
from wt_gym.control.controllers.own import own_parameters
from wt_gym.control.design import DESIGN_WIND, full_power_wind, platform_pitch_frequency, rotor_inertia, trim_pitch
from wt_gym.control.rotor import rotor_of
from wt_gym.turbines import load_turbine

NAMES = ("oc4_nrel_5mw", "volturnus_iea_15mw")
needs_rosco = pytest.mark.skipif(importlib.util.find_spec("rosco") is None, reason="the package rosco is not installed")


@pytest.mark.parametrize(("name", "period"), [("oc4_nrel_5mw", 26.0), ("volturnus_iea_15mw", 28.5)])
def test_pitch_frequency_is_that_of_free_decays_of_openfast(name, period):
    """The lines and the frequency dependence of the added mass are left out of the rule."""
    assert 2.0 * math.pi / platform_pitch_frequency(load_turbine(name)) == pytest.approx(period, rel=0.05)


def test_gains_on_land_are_those_of_the_reference_runs():
    turbine = load_turbine("oc4_nrel_5mw")
    land, own = own_parameters(turbine, land_gains=True), own_parameters(turbine)
    assert (land.proportional_gain, land.integral_gain) == pytest.approx((0.01882681, 0.008068634))
    assert (own.proportional_gain, own.integral_gain) == pytest.approx((0.006275604, 0.0008965149))
    assert land.constant_power
    assert not own.constant_power
    assert own.rated_torque == pytest.approx(43093.55, rel=1e-4)
    assert own_parameters(turbine, constant_power=True).constant_power
    with pytest.raises(ValueError, match="land_gains must be left out for NREL 5-MW"):
        make_controller("discon", load_turbine("nrel_5mw"), land_gains=True)


def answer_in_phase(controller, turbine, amplitude=0.3):
    """Pitch in phase with the velocity of the hub, over it [rad s/m], of a rotor that is quasi-steady and linear."""
    wind = DESIGN_WIND * full_power_wind(turbine)
    speed, pitch = turbine.drivetrain.rated_rotor_speed, float(trim_pitch(turbine, np.array([wind]))[0])
    slopes, inertia, gear = (
        rotor_of(turbine).slopes(wind, speed, pitch),
        rotor_inertia(turbine),
        turbine.drivetrain.gear_ratio,
    )
    p, dt = platform_pitch_frequency(turbine), 0.05
    readings = dict.fromkeys(controller.channels, 0.0)
    readings |= {"generator_speed": gear * speed, "rotor_speed": speed}
    controller.start(readings, Demand(np.full(3, pitch), 0.0, 43.0e3))
    torque, excess, rows = None, 0.0, []
    for k in range(int(16 * 2.0 * math.pi / p / dt)):
        velocity = amplitude * math.sin(p * k * dt)
        readings |= {
            "generator_speed": gear * (speed + excess), "rotor_speed": speed + excess,
            "platform_pitch_rate": velocity / turbine.hub_height,
        }  # fmt: skip
        demand = controller.step(readings, dt)
        torque = demand.generator_torque if torque is None else torque
        moment = slopes.torque_speed * excess + slopes.torque_pitch * (demand.pitch[0] - pitch)
        moment -= slopes.torque_wind * velocity + gear * (demand.generator_torque - torque)
        excess += dt * moment / inertia
        rows.append((k * dt, demand.pitch[0]))
    time, angle = np.array(rows[len(rows) // 2 :]).T  # whole periods
    basis = np.column_stack([np.sin(p * time), np.cos(p * time), np.ones(len(time))])
    return float(np.linalg.lstsq(basis, angle, rcond=None)[0][0]) / amplitude, -slopes.torque_wind / slopes.torque_pitch


@pytest.mark.parametrize("land", [False, True])
def test_feedback_takes_away_what_the_speed_loop_does_to_the_platform(land):
    """Within a tenth of the pitch that holds the speed, g: the filter of the speed and the step are not in the rule."""
    turbine = load_turbine("oc4_nrel_5mw")
    alone, g = answer_in_phase(make_controller("discon", turbine, land_gains=land), turbine)
    with_feedback, _ = answer_in_phase(make_controller("floating", turbine, land_gains=land), turbine)
    assert alone < -0.05 * g
    assert abs(with_feedback) < 0.1 * g
    half, _ = answer_in_phase(make_controller("floating", turbine, land_gains=land, share=0.5), turbine)
    assert half == pytest.approx(0.5 * (alone + with_feedback), abs=0.02 * g)


def test_feedback_turns_with_the_nacelle_and_keeps_its_limit():
    turbine = load_turbine("oc4_nrel_5mw")
    changes = []
    for yaw, roll, pitch in ((0.0, 0.0, 0.01), (0.5 * math.pi, -0.01, 0.0), (0.0, 0.01, 0.0), (0.0, 0.0, 1.0)):
        controller = make_controller("floating:limit=0.02", turbine)
        readings = dict.fromkeys(controller.channels, 0.0) | {
            "generator_speed": 97.0 * 1.267, "rotor_speed": 1.267, "yaw": yaw, "platform_roll_rate": roll,
            "platform_pitch_rate": pitch,
        }  # fmt: skip
        controller.start(readings, Demand(np.full(3, 0.2), 0.0, 43.0e3))
        base = make_controller("discon", turbine)
        base.start(readings, Demand(np.full(3, 0.2), 0.0, 43.0e3))
        for _ in range(50):
            change = controller.step(readings, 0.1).pitch - base.step(readings, 0.1).pitch
        changes.append(float(change[0]))
    assert changes[0] > 0.002  # a hub that moves downwind is met by blades that feather
    assert changes[1] == pytest.approx(changes[0], rel=1e-9)
    assert changes[2] == pytest.approx(0.0, abs=1e-12)
    assert changes[3] == pytest.approx(0.02, rel=1e-9)


def test_refusals():
    with pytest.raises(ControllerError, match="that of a floating turbine, got 'NREL 5-MW"):
        make_controller("floating", load_turbine("nrel_5mw"))
    with pytest.raises(ControllerError, match="must stand on discon, retuned or tsr_tracking, got object"):
        FloatingFeedback(load_turbine("oc4_nrel_5mw"), object())


def test_records_of_a_platform():
    """OpenFAST's: 37 the heading, 1001 to 1018 the motion, 83 the angular acceleration across the nacelle."""
    names = channels_read(3, floats=True)
    assert set(names) > set(channels_read(3))
    signals = dict.fromkeys(names, 0.0) | {
        "yaw": 0.5 * math.pi, "platform_surge": 3.0, "platform_yaw": 0.1, "platform_heave_rate": 0.2,
        "platform_roll_acceleration": 0.4, "platform_pitch_acceleration": 0.7, "platform_yaw_acceleration": 0.5,
    }  # fmt: skip
    swap = new_swap()
    write_platform(swap, signals)
    assert swap[[36, 1000, 1005, 1008, 1015, 1016, 1017]] == pytest.approx([1.670796, 3.0, 0.1, 0.2, 0.4, 0.7, 0.5])
    assert swap[81:84] == pytest.approx([0.7, -0.4, 0.5])  # a nacelle that heads along y


@needs_rosco
def test_feedback_of_rosco_is_near_the_tuned_one_of_the_package():
    turbine = load_turbine("volturnus_iea_15mw")
    assert "UMaineSemi" in str(tuned_input(turbine))
    values = _feedback_values(turbine, 2)
    assert values["Fl_Kp"] == pytest.approx(-9.1984, rel=0.15)
    assert values["F_FlCornerFreq"][0] == pytest.approx(0.213, rel=0.05)
    assert tuned_input(load_turbine("oc4_nrel_5mw")) is None


@needs_rosco
def test_rosco_has_the_feedback_that_is_asked_for():
    for name in NAMES:
        for mode in (0, 1, 2):
            controller = make_controller(f"rosco:floating={mode}", load_turbine(name))
            with open(controller.input_file, encoding="utf-8") as file:
                lines = [line for line in file if line.partition("!")[2].split()[:1] == ["Fl_Mode"]]
            assert [line.split()[0] for line in lines] == [str(mode)]
            controller.close()
    with pytest.raises(ValueError, match="floating must be left out for NREL 5-MW"):
        make_controller("rosco:floating=1", load_turbine("nrel_5mw"))
