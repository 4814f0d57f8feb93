"""Action mapping: physical meaning of actions, exact inverse, limits, refusal of bad actions."""

import math
from dataclasses import replace

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.wrappers import RescaleAction
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from wt_gym.base.errors import ActionError
from wt_gym.control import ActionMap, Demand, torque_curve
from wt_gym.control.actions import ROUNDING, AgentSetpoint

DT = 0.2


@pytest.fixture
def hold():
    return Demand(np.full(3, 0.1), 0.0, 20e3)


def decoded(action_map, action, previous):
    """Demand at the end of a step with an action from a demand."""
    return action_map.demand(action_map.decode(np.asarray(action), action_map.start(previous)))


def test_rates_of_the_nrel_5mw(turbine, hold):
    action_map, step = ActionMap(turbine, DT), math.radians(8.0) * DT
    demand = decoded(action_map, [1.0, -1.0, 0.5], hold)
    np.testing.assert_allclose(demand.pitch, 0.1 + step, rtol=1e-6)
    assert demand.yaw_rate == pytest.approx(-math.radians(0.3), rel=1e-6)
    assert demand.generator_torque == pytest.approx(20e3 + 0.5 * 15e3 * DT, rel=1e-9)
    rests = decoded(action_map, np.zeros(3), hold)
    assert np.array_equal(rests.pitch, hold.pitch)
    assert (rests.yaw_rate, rests.generator_torque) == (0.0, 20e3)
    blades = ActionMap(turbine, DT, pitch="individual")
    assert blades.names == ("pitch_1_rate", "pitch_2_rate", "pitch_3_rate", "yaw_rate", "generator_torque_rate")
    each = decoded(blades, [1.0, 0.0, -1.0, 0.0, 0.0], hold).pitch
    np.testing.assert_allclose(each, [0.1 + step, 0.1, 0.1 - step], rtol=1e-6)


@pytest.mark.parametrize("mode", ["rate", "absolute"])
@pytest.mark.parametrize("pitch", ["collective", "individual"])
def test_a_turbine_without_yaw_drive_has_no_yaw_component(turbine, hold, mode, pitch):
    fixed = replace(turbine, nacelle=replace(turbine.nacelle, max_yaw_rate=0.0))
    action_map, full = ActionMap(fixed, DT, mode, pitch), ActionMap(turbine, DT, mode, pitch)
    assert action_map.names == tuple(name for name in full.names if name != "yaw_rate")
    action = np.linspace(-0.9, 0.9, action_map.size)
    demand, other = decoded(action_map, action, hold), decoded(full, np.insert(action, -1, 0.0), hold)
    np.testing.assert_array_equal(demand.pitch, other.pitch)
    assert (demand.yaw_rate, demand.generator_torque) == (0.0, other.generator_torque)
    np.testing.assert_allclose(action_map.encode(demand, hold), action, atol=1e-12)


def test_offsets_themselves_are_reached_at_the_greatest_rate(turbine, hold):
    spans = {"pitch": 0.04, "pitch_mean": 0.02, "pitch_rate": 0.1}
    action_map = ActionMap(turbine, DT, "residual", "fixed-frame", ("pitch", "torque"), spans, residual="offset")
    assert action_map.names[0] == "pitch_mean_offset"
    np.testing.assert_allclose(action_map.high[:3], [0.02, 0.04, 0.04])
    setpoint, step = action_map.start(hold), 0.1 * DT
    courses = []
    for _ in range(4):
        setpoint = action_map.decode(np.array([1.0, -0.5, 0.1, 1.0]), setpoint)
        courses.append(setpoint)
    curve = torque_curve(turbine)
    torque = 0.05 * curve.rated_power / curve.rated_generator_speed * DT  # 5 % of the rated torque a second
    for k, one in enumerate(courses, start=1):
        wanted = [min(k * step, 0.02), max(-k * step, -0.02), min(k * step, 0.004)]
        np.testing.assert_allclose(one.pitch, wanted, rtol=1e-12)
        assert one.generator_torque == pytest.approx(k * torque, rel=1e-6)


def test_absolute_demands_lie_about_the_operating_points_of_the_winds(turbine, hold):
    """5 degrees beyond them on both sides, within the limits of the turbine."""
    action_map = ActionMap(turbine, DT, mode="absolute", wind_speeds=(15.0, 15.0))
    point = math.radians(10.45)
    for action, offset in ((-1.0, -5.0), (0.0, 0.0), (1.0, 5.0)):
        demand = decoded(action_map, [action, 0.0, action], hold)
        np.testing.assert_allclose(demand.pitch, point + math.radians(offset), rtol=1e-3)
    assert demand.generator_torque == pytest.approx(47_402.91, rel=1e-6)
    wide = ActionMap(turbine, DT, mode="absolute", wind_speeds=(6.0, 18.0))
    assert wide.low[0] == turbine.pitch.min_pitch
    assert wide.high[0] == pytest.approx(math.radians(14.92 + 5.0), rel=1e-3)


class TestResidual:
    """Offsets from the demand of a controller."""

    base = Demand(np.array([0.10, 0.11, 0.12]), 1e-3, 40e3)

    def map(self, turbine, **choices):
        return ActionMap(turbine, DT, "residual", **choices)

    def test_zero_is_the_controller(self, turbine, hold):
        for pitch in ("collective", "individual", "fixed-frame"):
            action_map = self.map(turbine, pitch=pitch)
            setpoint = action_map.decode(np.zeros(action_map.size), action_map.start(hold))
            demand = action_map.demand(setpoint, self.base, azimuth=1.0, rotor_speed=1.2)
            np.testing.assert_array_equal(demand.pitch, self.base.pitch)
            assert (demand.yaw_rate, demand.generator_torque) == (1e-3, 40e3)

    def test_offsets_move_with_the_action_and_end_at_their_limits(self, turbine, hold):
        action_map = self.map(turbine)
        assert action_map.names == ("pitch_offset_rate", "yaw_rate", "generator_torque_offset_rate")
        setpoint = action_map.decode(np.array([1.0, 0.0, -1.0]), action_map.start(hold))
        rated = 5_296_610.0 / 121.6805
        assert setpoint.pitch[0] == pytest.approx(math.radians(1.5) * DT)
        assert setpoint.generator_torque == pytest.approx(-0.05 * rated * DT, rel=1e-3)
        for _ in range(100):
            setpoint = action_map.decode(np.array([1.0, 0.0, -1.0]), setpoint)
        assert setpoint.pitch[0] == pytest.approx(math.radians(4.0))
        assert setpoint.generator_torque == pytest.approx(-0.1 * rated, rel=1e-3)
        demand = action_map.demand(setpoint, self.base)
        np.testing.assert_allclose(demand.pitch, self.base.pitch + math.radians(4.0))

    def test_tilt_and_yaw_reach_the_blades_with_the_azimuth_ahead(self, turbine, hold):
        """Blade 1 up, a delay of 0.1 s: it gets the tilt of the azimuth that it has then."""
        action_map = self.map(turbine, pitch="fixed-frame", components=("pitch",), delay=0.1)
        assert action_map.names == ("pitch_mean_offset_rate", "pitch_tilt_offset_rate", "pitch_yaw_offset_rate")
        setpoint = action_map.decode(np.array([0.0, 1.0, -0.5]), action_map.start(hold))
        step = math.radians(1.5) * DT
        psi = 0.12 + 2.0 * np.pi / 3.0 * np.arange(3)
        expected = self.base.pitch + step * np.cos(psi) - 0.5 * step * np.sin(psi)
        np.testing.assert_allclose(action_map.demand(setpoint, self.base, 0.0, 1.2).pitch, expected, rtol=1e-12)

    def test_components_left_out_are_the_controllers(self, turbine, hold):
        for mode in ("rate", "absolute", "residual"):
            action_map = ActionMap(turbine, DT, mode, components=("torque",))
            assert action_map.needs_controller
            assert action_map.size == 1
            demand = action_map.demand(action_map.decode(np.array([0.5]), action_map.start(hold)), self.base)
            np.testing.assert_array_equal(demand.pitch, self.base.pitch)
            assert demand.yaw_rate == 1e-3
            assert demand.generator_torque != 40e3
        assert not ActionMap(turbine, DT, components=("pitch", "torque")).needs_controller

    @pytest.mark.parametrize(
        ("speed", "beneath", "offset", "torque"),
        [
            (1.267, 40e3, 5e3, 1.03 * 5e6 / 0.944 / 97.0 / 1.267),  # no more than 1.03 of rated power
            (1.2, 40e3, 1e3, 41e3),
            (1.267, 46.5e3, 5e3, 46.5e3),  # the controller alone may load more
            (0.5, 40e3, 5e3, 45e3),
            (0.0, 40e3, 5e3, 45e3),
        ],
    )
    def test_residual_torque_does_not_overload(self, turbine, speed, beneath, offset, torque):
        action_map = self.map(turbine, spans={"torque": 5e3})
        demand = action_map.demand(
            AgentSetpoint(np.zeros(1), 0.0, offset), Demand(np.zeros(3), 0.0, beneath), 0.0, speed
        )
        assert demand.generator_torque == pytest.approx(torque, rel=1e-6)


def test_an_episode_starts_from_the_mean_of_the_blades_at_rest(turbine):
    previous = Demand(np.array([0.1, 0.2, 0.6]), 0.01, 20e3)
    wanted = {"collective": [0.3], "individual": [0.1, 0.2, 0.6], "fixed-frame": [0.3, 0.0, 0.0]}
    for pitch, angles in wanted.items():
        setpoint = ActionMap(turbine, DT, pitch=pitch).start(previous)
        np.testing.assert_allclose(setpoint.pitch, angles, rtol=1e-12)
        assert (setpoint.yaw_rate, setpoint.generator_torque) == (0.0, 20e3)
    setpoint = ActionMap(turbine, DT, "residual").start(previous)
    assert (setpoint.pitch.tolist(), setpoint.yaw_rate, setpoint.generator_torque) == ([0.0], 0.0, 0.0)


def test_absolute_tilt_and_yaw_lie_about_nothing(turbine):
    """Rows of the action vector; only a yaw rate changes its sign in the mirror image."""
    action_map = ActionMap(turbine, DT, "absolute", "fixed-frame", wind_speeds=(15.0, 15.0))
    assert action_map.names == ("pitch_mean", "pitch_tilt", "pitch_yaw", "yaw_rate", "generator_torque")
    assert action_map.units == ("rad", "rad", "rad", "rad/s", "N m")
    assert action_map.parity.tolist() == [1.0, 1.0, 1.0, -1.0, 1.0]
    four, yaw_rate = math.radians(4.0), math.radians(0.3)
    np.testing.assert_allclose(action_map.low[1:], [-four, -four, -yaw_rate, 0.0], rtol=1e-6)
    np.testing.assert_allclose(action_map.high[1:], [four, four, yaw_rate, 47_402.91], rtol=1e-6)
    row = action_map.table()[3]
    assert (row["name"], row["unit"], row["min"]) == ("yaw_rate", "rad/s", action_map.low[3])


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_demands_end_at_the_limits_of_the_turbine(turbine, side):
    drive = turbine.pitch
    angle, torque = (drive.min_pitch, 0.0) if side < 0.0 else (drive.max_pitch, turbine.drivetrain.max_generator_torque)
    demand = decoded(ActionMap(turbine, DT), side * np.ones(3), Demand(np.full(3, angle), 0.0, torque))
    np.testing.assert_array_equal(demand.pitch, angle)
    assert demand.generator_torque == torque


@pytest.mark.parametrize("mode", ["rate", "absolute"])
@pytest.mark.parametrize("pitch", ["collective", "individual"])
def test_encode_is_the_inverse_of_decode(turbine, hold, mode, pitch):
    action_map = ActionMap(turbine, DT, mode, pitch)
    rng = np.random.default_rng(3)
    for _ in range(20):
        action = rng.uniform(-0.9, 0.9, action_map.size)
        demand = decoded(action_map, action, hold)
        np.testing.assert_allclose(action_map.encode(demand, hold), action, atol=1e-12)
    if mode == "rate":  # the nearest action where the demand is too fast
        wanted = Demand(hold.pitch + 1.0, 0.0, 0.0)
        np.testing.assert_array_equal(action_map.encode(wanted, hold)[[0, -2, -1]], [1.0, 0.0, -1.0])


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


def test_rounding_beyond_one_is_put_on_one_and_no_more(turbine):
    action_map = ActionMap(turbine, DT)
    for beyond in (5e-7, 0.999 * ROUNDING):
        np.testing.assert_array_equal(action_map.validate([1.0 + beyond, -1.0 - beyond, 0.0]), [1.0, -1.0, 0.0])
    for beyond in (1.001 * ROUNDING, 1e-4):
        with pytest.raises(ActionError, match="within"):
            action_map.validate([1.0 + beyond, 0.0, 0.0])


@settings(deadline=None)
@given(end=st.floats(1e-3, 1e4), ratio=st.floats(0.5, 256.0), negative=st.booleans())
def test_rescale_action_takes_the_ends_of_any_range(turbine, end, ratio, negative):
    """Ranges whose distance from zero is up to 256 times their width (`ROUNDING`); float32 as in any policy."""
    far, near = np.float32(end), np.float32(end - end / ratio)
    low, high = (-far, -near) if negative else (near, far)
    assume(max(abs(low), abs(high)) <= 256.0 * (high - low))
    env = gym.Env()
    env.action_space = gym.spaces.Box(-1.0, 1.0, (3,), np.float32)
    scaled = RescaleAction(env, low, high)
    for limit, wanted in ((scaled.action_space.low, -1.0), (scaled.action_space.high, 1.0)):
        action = ActionMap(turbine, DT).validate(scaled.action(limit))
        np.testing.assert_allclose(action, np.full(3, wanted), rtol=0.0, atol=ROUNDING)
        assert np.abs(action).max() <= 1.0


@pytest.mark.parametrize(
    ("kwargs", "message"),
    [
        ({"mode": "speed"}, "got 'speed'"),
        ({"pitch": "cyclic"}, "needs action_mode='residual', got 'rate'"),
        ({"control_dt": 0.0}, "got 0.0 s"),
        ({"components": ("nacelle",)}, "got"),
        ({"components": ()}, "got"),
        ({"components": "pitch"}, "got 'pitch'"),
        ({"spans": {"pitch": math.inf}}, "got inf"),
        ({"spans": {"torque_rate": 0}}, "got 0"),
        ({"spans": {"blade": 1.0}}, "action_spans has no 'blade'; there are"),
        ({"spans": {"pitch_rate": 1.0}}, r"action_spans\['pitch_rate'\] must be positive and at most"),
        ({"residual": "offset"}, "residual='offset' needs action_mode='residual', got 'rate'"),
    ],
)
def test_unknown_choices_are_refused(turbine, kwargs, message):
    with pytest.raises(ValueError, match=message):
        ActionMap(turbine, **{"control_dt": DT} | kwargs)


@pytest.mark.parametrize(("mode", "pitch"), [("residual", "collective"), ("rate", "fixed-frame")])
def test_what_has_no_inverse_or_too_few_blades_is_refused(turbine, hold, mode, pitch):
    with pytest.raises(ValueError, match="let it be the base controller"):
        ActionMap(turbine, DT, mode, pitch).encode(hold, hold)
    with pytest.raises(ValueError, match="needs three blades or more, the turbine has 2"):
        ActionMap(replace(turbine, n_blades=2), DT, "residual", "fixed-frame")
