"""The turbine of Gebhardt et al. 2012 as an environment: contract, fixed yaw, damper or torque, boundary layer."""

import gymnasium as gym
import numpy as np
import pytest
from turbine_contract import both_checkers_are_content, random_episode, snapshot_repeats

from envs_tests.physics.cases.gebhardt import boundary_layer
from wt_gym.base.errors import ActionError, InflowError, TurbineDefinitionError
from wt_gym.control import operating_point
from wt_gym.control.rotor import rotor_table
from wt_gym.envs.wind_sampler import WindOptions, WindSampler
from wt_gym.turbines import load_turbine
from wt_gym.turbines.catalog import GENERATOR_DAMPER
from wt_gym.turbines.variants import with_damper

IDS = ("wt_gym/Gebhardt45m-Steady-v1", "wt_gym/Gebhardt45m-Turbulent-v1")
TURBINE = load_turbine("gebhardt_45m")
HEIGHTS = np.array([[0.0, 0.0, z] for z in (5.0, 40.0, 70.0, 110.0, 275.0)])


def test_both_checkers_have_nothing_to_say():
    both_checkers_are_content(IDS[1], generator="damper")


@pytest.mark.parametrize(("env_id", "generator", "names"), [(IDS[0], "torque", ("pitch_rate", "generator_torque_rate")),
                                                            (IDS[1], "damper", ("pitch_rate",))])  # fmt: skip
def test_no_action_is_dead(env_id, generator, names):
    """Each component moves something; there is none for the yaw that is fixed, nor for the torque of a damper."""
    env = gym.make(env_id, generator=generator, wind_speed=12.0).unwrapped
    assert env.layout.action.names == names
    assert not any("yaw_rate" in name for name in env.layout.observation.names)
    env.reset(seed=1)
    start = env.snapshot()
    still, *_ = env.step(np.zeros(len(names)))
    for k in range(len(names)):
        env.restore(start)
        moved, *_ = env.step(np.eye(len(names))[k])
        assert np.abs(moved - still).max() > 1e-3


@pytest.mark.parametrize("kwargs", [{}, pytest.param({"action_mode": "residual"}, marks=pytest.mark.slow)])
@pytest.mark.parametrize("generator", ["torque", "damper"])
def test_random_actions_do_not_break_an_episode(generator, kwargs):
    truncated = random_episode(gym.make(IDS[1], generator=generator, wind_speed=14.0, **kwargs).unwrapped)
    if kwargs or generator == "damper":
        assert truncated


def test_snapshots_continue_bit_for_bit():
    snapshot_repeats(gym.make(IDS[1], generator="damper", wind_speed=13.0, sensor_noise=1.0).unwrapped)


def test_the_damper_takes_power_with_the_square_of_the_speed():
    """P = c Ω² of the paper, 2.0e6 N m s: 2.3 MW at 10.2 rpm, the rated speed under the damper."""
    env = gym.make(IDS[0], generator="damper", wind_speed=16.0).unwrapped
    env.reset(seed=0)
    for _ in range(5):
        *_, info = env.step([0.0])
    assert info["generator_power"] == pytest.approx(GENERATOR_DAMPER * info["rotor_speed"] ** 2, rel=1e-9)
    assert env.turbine.drivetrain.rated_rotor_speed * 30.0 / np.pi == pytest.approx(10.24, abs=0.01)
    with pytest.raises(ActionError, match="damper takes no demand"):
        env.reset(options={"generator_torque": 1e5})


def test_operating_points_of_the_damper_balance_air_and_generator():
    turbine = with_damper(TURBINE)
    table = rotor_table(turbine)
    for wind in (10.0, 16.0, 18.0):
        point = operating_point(turbine, wind)
        torque = table.torque(wind, point.rotor_speed, point.pitch)
        assert torque == pytest.approx(GENERATOR_DAMPER * point.rotor_speed, rel=0.05)
        assert point.generator_torque == 0.0


@pytest.mark.parametrize(("profile", "expected"), [
    ({"shear_exponent": 0.16}, boundary_layer(15.0).velocity(HEIGHTS, 0.0)[:, 0]),
    ({"roughness_length": 0.03}, 15.0 * np.log(HEIGHTS[:, 2] / 0.03) / np.log(275.0 / 0.03)),
])  # fmt: skip
def test_winds_of_a_boundary_layer(profile, expected):
    """The drawn speed holds at the gradient height; the paper's profile, and the logarithmic one."""
    sampler = WindSampler(TURBINE, WindOptions("steady", (12.0, 20.0), reference_height=275.0, **profile))
    wind = sampler.sample(np.random.default_rng(0), wind_speed=15.0)
    np.testing.assert_allclose(wind.inflow.velocity(HEIGHTS, 0.0)[:, 0], expected, rtol=1e-12)
    at_hub = wind.inflow.velocity(np.array([[0.0, 0.0, TURBINE.hub_height]]), 0.0)[0, 0]
    assert wind.wind_speed == pytest.approx(at_hub)
    rng = np.random.default_rng(1)
    drawn = [sampler.sample(rng).inflow.velocity(HEIGHTS[-1:], 0.0)[0, 0] for _ in range(20)]
    assert 12.0 <= min(drawn) < 14.0 < 18.0 < max(drawn) <= 20.0


@pytest.mark.parametrize(("kwargs", "error", "text"), [
    ({"generator": "damper", "action_components": ("pitch", "torque")}, ValueError, "the generator is a damper"),
    ({"generator": "damper", "action_spans": {"torque_rate": 1.0}}, ValueError, "takes no torque"),
    ({"turbine": "nrel_5mw", "generator": "damper"}, TurbineDefinitionError, "generator_damping"),
    ({"turbine": with_damper(TURBINE), "generator": "torque"}, TurbineDefinitionError, "takes no demand"),
    ({"action_components": ("yaw",)}, ValueError, "no yaw drive"),
    ({"roughness_length": 0.03, "shear_exponent": 0.2}, InflowError, "exclude each other"),
    ({"inflow": "extreme", "standstill_limit": -0.5, "roughness_length": 0.1}, InflowError, "length=0.1 belongs"),
    ({"reference_height": 275.0, "wind_speed": 90.0}, InflowError, "at the hub"),
])  # fmt: skip
def test_what_makes_no_sense_is_refused(kwargs, error, text):
    with pytest.raises(error, match=text):
        gym.make(IDS[0], **kwargs)


@pytest.mark.slow
def test_the_machine_as_they_built_it():
    """Damper, potential flow with bodies and ground, boundary layer: an episode of random pitch actions."""
    env = gym.make(
        IDS[0], generator="damper", fidelity="gebhardt-full", wind_speed=(15.0, 20.0), shear_exponent=0.16,
        reference_height=275.0, action_mode="residual", episode_length=60.0,
    ).unwrapped  # fmt: skip
    env.action_space.seed(5)
    _, info = env.reset(seed=4)
    truncated = False
    while not truncated:
        observation, _, terminated, truncated, info = env.step(env.action_space.sample())
        assert not terminated
    assert np.isfinite(observation).all()
    assert 4.0 < info["rotor_speed"] * 30.0 / np.pi < 13.0


def test_the_baseline_controller_holds_the_light_rotor_about_rated_wind():
    """Without the notch at the collective edgewise mode hub and pitch swing at 4 Hz here, to 19.7 rpm of 16."""
    env = gym.make("wt_gym/Gebhardt45m-Turbulent-v1", action_mode="residual", episode_length=60.0)
    env.reset(seed=1, options={"wind_speed": 12.0, "wind_seed": 1, "time_offset": 0.0})
    speeds, over = [], False
    while not over:
        *_, terminated, over, info = env.step(np.zeros(env.action_space.shape, dtype=np.float32))
        assert not terminated
        speeds.append(info["rotor_speed"])
    rpm = np.array(speeds) * 30 / np.pi
    assert rpm.max() < 17.5
    assert np.diff(rpm[100:]).std() < 0.1  # from 20 s on; it was 1 to 2.5
