"""The baseline controller against numbers worked out by hand from its published constants."""

import math
from dataclasses import replace

import numpy as np
import pytest

from wt_gym.control import Demand, TorqueCurve
from wt_gym.control.controllers.discon import BaselineParameters, DisconController, nrel_5mw_parameters
from wt_gym.turbines import load_turbine

DT = 0.0125
NREL_5MW = nrel_5mw_parameters()


def started(speed, pitch, torque=math.nan, parameters=NREL_5MW):
    controller = DisconController(parameters)
    controller.start({"generator_speed": speed}, Demand(pitch, 0.0, torque))
    return controller


def commands(controller, speed, dt=DT):
    demand = controller.step({"generator_speed": speed}, dt)
    return demand.pitch, demand.generator_torque


def test_pitched_blades_hold_constant_power_up_to_the_torque_limit_others_follow_the_curve():
    _, command = commands(started(118.0, math.radians(1.01)), 118.0)
    assert command == pytest.approx(5_296_610 / 118.0)
    assert commands(started(100.0, math.radians(1.01)), 100.0)[1] == 47_402.91
    assert commands(started(105.0, 0.0), 105.0)[1] == pytest.approx(2.332287 * 105.0**2, rel=1e-6)


@pytest.mark.parametrize(("speed", "pitch_deg"), [(118.0, 1.01), (128.0, 1.01), (128.0, 0.0)])
def test_torque_of_rated_power_at_rated_speed_is_held_above_it_too(speed, pitch_deg):
    """The detuned law of OC3-Hywind (NREL/TP-500-47535, section 4.2): power rises with the speed."""
    controller = started(speed, math.radians(pitch_deg), parameters=replace(NREL_5MW, constant_power=False))
    assert commands(controller, speed)[1] == pytest.approx(43_093.55, rel=1e-6)


@pytest.mark.parametrize(("speed", "side"), [(122.9096, 1.0), (60.0, -1.0)])
def test_torque_rate_limit(speed, side):
    _, command = commands(started(speed, 0.0, torque=20_000.0), speed)
    assert command == pytest.approx(20_000.0 + side * 15_000.0 * DT)


def test_filter():
    controller = started(120.0, 0.0)
    commands(controller, 122.0)
    memory = math.exp(-DT * 1.570796)
    assert controller.filtered_speed == pytest.approx(memory * 120.0 + (1 - memory) * 122.0, rel=1e-12)


def test_pitch_of_the_pi_law():
    # From 0.1 rad: GK = 1/(1 + 0.1/0.1099965) = 0.5238016; the integral that holds 0.1 rad is 0.1/(GK KI).
    controller = started(123.4096, 0.1)
    command, _ = commands(controller, 123.4096)
    factor = 1 / (1 + 0.1 / 0.1099965)
    assert factor == pytest.approx(0.5238016, rel=1e-6)
    integral = 0.1 / (factor * 0.008068634) + 0.5 * DT
    demand = factor * (0.01882681 * 0.5 + 0.008068634 * integral)
    assert demand == pytest.approx(0.1 + 0.0049571, abs=1e-6)
    # That is faster than 8 deg/s allows within one call.
    np.testing.assert_allclose(command, 0.1 + 0.1396263 * DT, rtol=1e-9)
    slow, _ = commands(started(123.4096, 0.1), 123.4096, 0.1)
    np.testing.assert_allclose(slow, demand + factor * 0.008068634 * 0.5 * (0.1 - DT), rtol=1e-9)


def test_integral_is_clamped_at_fine_pitch():
    controller = started(100.0, 0.0)
    for _ in range(1000):
        pitch, _ = commands(controller, 100.0, 0.1)
    assert controller.speed_integral == 0.0
    np.testing.assert_array_equal(pitch, 0.0)
    # Without windup the pitch acts as soon as the filtered speed passes the reference.
    controller = started(122.9, 0.0)
    pitch, _ = commands(controller, 124.0, 1.0)
    assert np.all(pitch > 0.0)


def test_rate_limit_holds_for_each_blade():
    controller = started(122.9096, [0.1, 0.2, 0.0])
    pitch, _ = commands(controller, 122.9096)
    step = 0.1396263 * DT
    np.testing.assert_allclose(pitch, [0.1, 0.2 - step, step], atol=1e-9)


def test_gain_rule_reproduces_the_published_gains():
    parameters = BaselineParameters.by_rule(load_turbine("nrel_5mw"))
    assert parameters.proportional_gain == pytest.approx(0.01882681, rel=5e-3)
    assert parameters.integral_gain == pytest.approx(0.008068634, rel=5e-3)
    assert parameters.reference_speed == pytest.approx(122.9096, rel=1e-5)
    assert parameters.corner_frequency == pytest.approx(1.570796, rel=1e-6)


def test_published_constants_serve_the_nrel_5mw():
    """NREL/TP-500-38060, Tables 7-1 and 7-2, with the digits of the published source."""
    curve = TorqueCurve(70.16224, 91.21091, 121.6805, 2.332287, 5_296_610.0, 0.1)
    published = BaselineParameters(
        1.570796, 0.01882681, 0.008068634, 0.1099965, 122.9096, 0.0, 1.570796, 0.1396263, curve, 47_402.91, 15_000.0,
        0.01745329,
    )  # fmt: skip
    assert published == NREL_5MW
    assert BaselineParameters.from_turbine(load_turbine("nrel_5mw_monopile")) == NREL_5MW
