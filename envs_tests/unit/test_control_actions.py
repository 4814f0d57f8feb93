"""Action mapping: physical meaning of actions, exact inverse, limits, refusal of bad actions."""

import math
from dataclasses import replace

import numpy as np
import pytest

from wt_gym.control import ActionMap, Demand
from wt_gym.errors import ActionError
from wt_gym.turbines import load_turbine

DT = 0.2


@pytest.fixture(scope="module")
def turbine():
    return load_turbine("nrel_5mw")


@pytest.fixture
def hold():
    return Demand(np.full(3, 0.1), 0.0, 20e3)


def test_rates_of_the_nrel_5mw(turbine, hold):
    action_map = ActionMap(turbine, DT)
    demand = action_map.decode(np.array([1.0, -1.0, 0.5]), hold)
    np.testing.assert_allclose(demand.pitch, 0.1 + math.radians(8.0) * DT, rtol=1e-6)
    assert demand.yaw_rate == pytest.approx(-math.radians(0.3), rel=1e-6)
    assert demand.generator_torque == pytest.approx(20e3 + 0.5 * 15e3 * DT, rel=1e-9)


@pytest.mark.parametrize("mode", ["rate", "absolute"])
@pytest.mark.parametrize("pitch", ["collective", "individual"])
def test_a_turbine_without_yaw_drive_has_no_yaw_component(turbine, hold, mode, pitch):
    fixed = replace(turbine, nacelle=replace(turbine.nacelle, max_yaw_rate=0.0))
    action_map, full = ActionMap(fixed, DT, mode, pitch), ActionMap(turbine, DT, mode, pitch)
    assert action_map.names == tuple(name for name in full.names if name != "yaw_rate")
    action = np.linspace(-0.9, 0.9, action_map.size)
    demand, other = action_map.decode(action, hold), full.decode(np.insert(action, -1, 0.0), hold)
    np.testing.assert_array_equal(demand.pitch, other.pitch)
    assert (demand.yaw_rate, demand.generator_torque) == (0.0, other.generator_torque)
    np.testing.assert_allclose(action_map.encode(demand, hold), action, atol=1e-12)


def test_zero_rates_hold_the_demands_exactly(turbine, hold):
    demand = ActionMap(turbine, DT).decode(np.zeros(3), hold)
    assert np.array_equal(demand.pitch, hold.pitch)
    assert (demand.yaw_rate, demand.generator_torque) == (0.0, 20e3)


def test_absolute_demands_span_the_limits(turbine, hold):
    action_map = ActionMap(turbine, DT, mode="absolute")
    low, high = action_map.decode(-np.ones(3), hold), action_map.decode(np.ones(3), hold)
    np.testing.assert_allclose(low.pitch, turbine.pitch.min_pitch)
    np.testing.assert_allclose(high.pitch, turbine.pitch.max_pitch)
    assert low.generator_torque == 0.0
    assert high.generator_torque == pytest.approx(47_402.91, rel=1e-6)


def test_individual_pitch_moves_each_blade(turbine, hold):
    action_map = ActionMap(turbine, DT, pitch="individual")
    assert action_map.names == ("pitch_1_rate", "pitch_2_rate", "pitch_3_rate", "yaw_rate", "generator_torque_rate")
    demand = action_map.decode(np.array([1.0, 0.0, -1.0, 0.0, 0.0]), hold)
    step = math.radians(8.0) * DT
    np.testing.assert_allclose(demand.pitch, [0.1 + step, 0.1, 0.1 - step], rtol=1e-6)


def test_demands_end_at_the_limits_of_the_turbine(turbine):
    action_map = ActionMap(turbine, DT)
    at_bottom = Demand(np.full(3, turbine.pitch.min_pitch), 0.0, 0.0)
    demand = action_map.decode(-np.ones(3), at_bottom)
    np.testing.assert_array_equal(demand.pitch, turbine.pitch.min_pitch)
    assert demand.generator_torque == 0.0
    at_top = Demand(np.full(3, turbine.pitch.max_pitch), 0.0, turbine.drivetrain.max_generator_torque)
    demand = action_map.decode(np.ones(3), at_top)
    np.testing.assert_array_equal(demand.pitch, turbine.pitch.max_pitch)
    assert demand.generator_torque == turbine.drivetrain.max_generator_torque


@pytest.mark.parametrize("mode", ["rate", "absolute"])
@pytest.mark.parametrize("pitch", ["collective", "individual"])
def test_encode_is_the_inverse_of_decode(turbine, hold, mode, pitch):
    action_map = ActionMap(turbine, DT, mode, pitch)
    rng = np.random.default_rng(3)
    for _ in range(20):
        action = rng.uniform(-0.9, 0.9, action_map.size)
        demand = action_map.decode(action, hold)
        np.testing.assert_allclose(action_map.encode(demand, hold), action, atol=1e-12)


def test_encode_gives_the_nearest_action_when_the_demand_is_too_fast(turbine, hold):
    wanted = Demand(hold.pitch + 1.0, 0.0, 0.0)
    np.testing.assert_array_equal(ActionMap(turbine, DT).encode(wanted, hold), [1.0, 0.0, -1.0])


@pytest.mark.parametrize(
    ("action", "message"),
    [
        ([0.0, math.nan, 0.0], r"yaw_rate \(component 1\) = nan"),
        ([math.inf, 0.0, 0.0], r"pitch_rate \(component 0\) = inf"),
        ([0.0, 0.0, -1.01], r"generator_torque_rate \(component 2\) = -1.01"),
        ([0.0, 0.0], r"shape \(3,\)"),
        ([[0.0, 0.0, 0.0]], r"shape \(3,\)"),
        ("full power", "must be 3 numbers"),
    ],
)
def test_bad_actions_are_refused_with_the_value(turbine, action, message):
    with pytest.raises(ActionError, match=message):
        ActionMap(turbine, DT).validate(action)


def test_rounding_beyond_one_is_put_on_one(turbine):
    np.testing.assert_array_equal(ActionMap(turbine, DT).validate([1.0 + 5e-7, -1.0 - 5e-7, 0.0]), [1.0, -1.0, 0.0])


@pytest.mark.parametrize("kwargs", [{"mode": "speed"}, {"pitch": "cyclic"}, {"control_dt": 0.0}])
def test_unknown_choices_are_refused(turbine, kwargs):
    with pytest.raises(ValueError, match="got"):
        ActionMap(turbine, **{"control_dt": DT} | kwargs)
