"""Terminations, truncation, penalties and failures of the environment, with a scripted simulator."""

from dataclasses import replace

import numpy as np
import pytest
from gymnasium.error import ResetNeeded

from envs_tests.env.scripted_simulator import ScriptedSimulator, use
from wt_gym.base.errors import ControllerError
from wt_gym.envs.turbine_env import WindTurbineEnv
from wt_gym.turbines import load_turbine
from wt_gym.turbines.variants import unloaded_clearance

HOLD = np.zeros(3, dtype=np.float32)
RATED = 12.1 * np.pi / 30


@pytest.fixture
def make_env(monkeypatch):
    def make(script=None, break_at=None, **kwargs):
        simulator = type("Scripted", (ScriptedSimulator,), {"script": script or {}, "break_at": break_at})
        use(monkeypatch, simulator)
        return WindTurbineEnv(wind_speed=12.0, **kwargs)

    return make


def run(env, steps=1000):
    """Hold the demands until the episode ends."""
    env.reset(seed=0)
    for k in range(1, steps + 1):
        result = env.step(HOLD)
        if result[2] or result[3]:
            return k, result
    raise AssertionError("the episode did not end")


def test_truncation_is_only_the_time(make_env):
    steps, (_, _, terminated, truncated, info) = run(make_env(episode_length=10.0))
    assert (steps, terminated, truncated) == (50, False, True)
    assert "termination" not in info
    assert "termination" not in info["reward_terms"]


@pytest.mark.parametrize(
    ("script", "reason"),
    [
        ({1.0: {"rotor_speed": 1.26 * RATED}}, "overspeed"),
        ({1.0: {"rotor_speed": 0.19 * RATED}}, "standstill"),
        ({1.0: {"rotor_speed_max": 1.26 * RATED}}, "overspeed"),  # over again at the end of the step
        ({1.0: {"tip_clearance_min_2": -0.01}}, "tower_strike"),
    ],
)
def test_terminations(make_env, script, reason):
    env = make_env(script)
    steps, (_, reward, terminated, truncated, info) = run(env)
    assert (steps, terminated, truncated, info["termination"]) == (5, True, False, reason)
    assert info["reward_terms"]["termination"] == -120.0
    assert reward == pytest.approx(sum(info["reward_terms"].values()))
    assert reward < -95.0
    with pytest.raises(ResetNeeded):
        env.step(HOLD)
    env.reset()
    env.step(HOLD)


def test_info_holds_the_extremes_of_the_step(make_env):
    env = make_env({0.2: {"tip_clearance_min_3": 2.5, "rotor_speed_max": 1.1 * RATED}})
    _, info = env.reset(seed=0)
    assert (info["tip_clearance_min"], info["rotor_speed_max"]) == (11.0, info["rotor_speed"])
    *_, info = env.step(HOLD)
    assert (info["tip_clearance_min"], info["rotor_speed_max"]) == (2.5, 1.1 * RATED)


def test_limits_are_adjustable_and_a_termination_at_the_time_limit_is_no_truncation(make_env):
    steps, _ = run(make_env({1.0: {"rotor_speed": 1.26 * RATED}}, overspeed_limit=1.3, episode_length=4.0))
    assert steps == 20
    env = make_env({1.0: {"rotor_speed": 0.0}, 2.0: {"rotor_speed": -0.01}}, standstill_limit=0.0, episode_length=2.0)
    steps, (_, _, terminated, truncated, info) = run(env)
    assert (steps, terminated, truncated, info["termination"]) == (10, True, False, "standstill")


@pytest.mark.parametrize("broken", [{"break_at": 1.0}, {"script": {1.0: {"tower_top_fore_aft": np.nan}}}])
def test_failed_simulation_terminates_with_the_last_good_observation(make_env, broken):
    env = make_env(**broken)
    observation, _ = env.reset(seed=0)
    for _ in range(4):
        observation, *_ = env.step(HOLD)
    last, reward, terminated, truncated, info = env.step(HOLD)
    assert (terminated, truncated, info["termination"]) == (True, False, "failure")
    assert "1.0 s" in info["failure"]
    assert np.array_equal(last, observation)
    assert reward == sum(info["reward_terms"].values()) == -120.0
    env.reset()
    env.step(HOLD)


def test_weights_and_penalty_can_be_chosen(make_env):
    env = make_env({0.4: {"rotor_speed": 3.0}}, reward={"power": 2.0, "overspeed": 0.0}, termination_penalty=7.0)
    env.reset(seed=0)
    *_, info = env.step(HOLD)
    assert "overspeed" not in info["reward_terms"]
    assert info["reward_terms"]["power"] == pytest.approx(2.0 * 0.2, rel=1e-6)
    *_, info = env.step(HOLD)
    assert info["reward_terms"]["termination"] == -7.0


def test_sensors_stay_at_the_end_of_their_range_and_say_so(make_env):
    env = make_env({0.2: {"nacelle_acceleration_fore_aft": 35.0}})
    env.reset(seed=0)
    observation, *_, info = env.step(HOLD)
    assert info["saturated"] == ("nacelle_acceleration_fore_aft",)
    assert env.layout.observation.value(observation, "nacelle_acceleration_fore_aft") == pytest.approx(20.0)


def test_observation_shows_the_physical_values(make_env):
    env = make_env()
    observation, _ = env.reset(seed=0)
    for name in ("rotor_speed", "generator_speed", "generator_torque", "tip_in_plane_3", "root_flap_moment_1"):
        expected = env.signals[name]
        assert env.layout.observation.value(observation, name) == pytest.approx(expected, rel=1e-6), name
    observation, *_ = env.step(np.array([0.5, -0.25, 1.0], dtype=np.float32))
    value = env.layout.observation.value
    assert value(observation, "previous_yaw_rate") == -0.25
    assert value(observation, "pitch_demand") == pytest.approx(env.demand.pitch[0], rel=1e-6)
    with pytest.raises(KeyError, match="no channel 'power'"):
        value(observation, "power")


def test_noise_comes_from_the_seed(make_env):
    env = make_env(sensor_noise=1.0)
    first, second = env.reset(seed=3)[0], env.reset(seed=3)[0]
    assert np.array_equal(first, second)
    clean = make_env().reset(seed=3)[0]
    difference = np.abs(first - clean)
    assert difference.max() > 0
    index = env.layout.observation.index
    assert difference[index("pitch_demand")] == difference[index("azimuth_sin")] == 0


@pytest.mark.parametrize("control_dt", [0.05, 0.15, 0.25])
def test_control_step_must_be_one_the_simulator_can_take(make_env, control_dt):
    with pytest.raises(ValueError, match=r"control_dt must be a multiple of .* aerodynamic step of 0\.1 s"):
        make_env(control_dt=control_dt, episode_length=3.0)


def test_a_standing_rotor_starts_without_torque(make_env):
    env = make_env()
    env.reset(seed=0)
    rated = env.demand.generator_torque
    assert rated > 30e3
    env.reset(seed=0, options={"rotor_speed": 0.0})
    assert (env.demand.generator_torque, env.signals["generator_torque"]) == (0.0, 0.0)
    env.reset(seed=0, options={"rotor_speed": 0.02 * RATED})
    assert env.demand.generator_torque == pytest.approx(0.4 * env.turbine.drivetrain.max_generator_torque)
    env.reset(seed=0, options={"generator_torque": 12e3})
    env.step(HOLD)
    assert (env.demand.generator_torque, env.signals["generator_torque"]) == (12e3, 12e3)


class Broken:
    """A controller that demands what it was made with, from its third step on."""

    channels = ()

    def __init__(self, pitch):
        self.pitch = pitch

    def start(self, signals, demand):
        self.first, self.steps = demand, 0

    def step(self, signals, dt):
        self.steps += 1
        return self.first if self.steps < 3 else replace(self.first, pitch=self.pitch)


@pytest.mark.parametrize("pitch", [np.full(3, np.nan), np.zeros(2), 0.1])
def test_a_broken_controller_beneath_is_named_and_ends_the_episode(make_env, pitch):
    env = make_env(action_mode="residual", controller=Broken(pitch))
    env.reset(seed=0)
    env.step(HOLD)
    with pytest.raises(ControllerError, match="of the controller Broken must"):
        env.step(HOLD)
    with pytest.raises(ResetNeeded):
        env.step(HOLD)
    env.reset(seed=0)
    env.step(HOLD)


def test_a_feature_that_is_off_has_no_term(make_env):
    on = {"dial_weights": "simplex", "fault_kinds": "all", "power_reference": "steps", "relative_reward": True}
    assert set(make_env().terms) == {"lidar", "idle"}
    terms = make_env(**on, variation="train", start="steady").terms
    assert list(terms) == ["lidar", "idle", "variation", "fault", "power_reference", "twin", "dial"]


QUIET = {f"tip_clearance_min_{blade}": 40.0 for blade in (1, 2, 3)}


@pytest.mark.parametrize(
    ("extremes", "name", "cost"),
    [
        ({}, "overspeed", 0.0),
        ({"rotor_speed_max": 1.09 * RATED}, "overspeed", 0.0),
        ({"rotor_speed_max": 1.175 * RATED}, "overspeed", 0.5),
        ({"rotor_speed_max": 1.3 * RATED}, "overspeed", 1.0),
        ({"tip_clearance_min_1": 0.15 * unloaded_clearance(load_turbine("nrel_5mw"))}, "clearance", 0.5),
        ({"tip_clearance_min_2": -0.1}, "clearance", 1.0),
        ({"pitch_travel_3": 0.89 * 0.2 * np.radians(8.0)}, "pitch_rate", 0.0),
        ({"pitch_travel_3": 0.95 * 0.2 * np.radians(8.0)}, "pitch_rate", 0.5),
        ({"pitch_travel_3": 0.2 * np.radians(8.0)}, "pitch_rate", 1.0),
    ],
)
def test_costs_rise_evenly_through_their_margins(make_env, extremes, name, cost):
    env = make_env({0.2: QUIET | extremes})
    env.reset(seed=0)
    *_, info = env.step(HOLD)
    assert info["costs"][name] == pytest.approx(cost, abs=1e-9)
    assert info["cost"] == sum(info["costs"].values()) == pytest.approx(cost, abs=1e-9)


def test_margin_of_overspeed_follows_the_limit_and_a_failure_costs_everything(make_env):
    costs = []
    for arguments in ({"script": {0.2: QUIET | {"rotor_speed_max": 1.07 * RATED}}}, {"break_at": 0.2}):
        env = make_env(**arguments, overspeed_limit=1.1)
        env.reset(seed=0)
        costs.append(env.step(HOLD)[4]["costs"])
    assert costs[0]["overspeed"] == pytest.approx(0.5)
    assert costs[1] == {"overspeed": 1.0, "clearance": 1.0, "pitch_rate": 1.0}
