"""The task from standstill to storm: starts, states that are seen, what its reward ranks, and copies of it."""

import math

import gymnasium as gym
import numpy as np
import pytest

from wt_gym.control import Demand
from wt_gym.control.controllers import STATES, supervisor_of
from wt_gym.experiment.environments import Environments
from wt_gym.tasks import TASKS
from wt_gym.wind import PathInflow, SteadyInflow

ID = TASKS["FullOperation"].id
PROFILE = SteadyInflow(1.0, 90.0, shear_exponent=0.2)
FAST = "discon+supervisor:averaging=10,restart_delay=2"


def make(**more):
    """The task without what makes records."""
    return gym.make(
        ID, **({"relative_reward": False, "starts": None, "start": "steady", "wind_seeds": (5,)} | more)
    ).unwrapped


def path(*knots):
    """Steady wind along a path of (time, speed)."""
    times, speeds = np.array(knots, dtype=float).T
    return PathInflow(times, speeds, PROFILE)


def play(env, seconds, action=None):
    """Steps of a held action; the states that were passed, the return, and the last info."""
    action = np.zeros(env.action_space.shape) if action is None else action
    states, total, info, observation = [], 0.0, {}, None
    for _ in range(round(seconds / env.control_dt)):
        observation, reward, terminated, _, info = env.step(action)
        total += reward
        if not states or states[-1] != info["state"]:
            states.append(info["state"])
        if terminated:
            break
    return states, total, info, observation


@pytest.mark.parametrize(("speed", "state"), [(0.0, "parked"), (2.0, "parked"), (10.0, "production"), (31.0, "parked")])
def test_an_episode_starts_as_the_turbine_stands_in_the_wind(speed, state):
    env = make()
    observation, info = env.reset(seed=1, options={"wind_speed": speed, "wind_seed": 5})
    assert info["state"] == state
    assert info["wind_speed"] == speed
    assert (info["rotor_speed"] == 0.0) == (state == "parked")
    one_hot = [env.layout.observation.value(observation, f"state_{name}") for name in STATES]
    assert one_hot == [float(name == state) for name in STATES]
    if state == "parked":
        assert env.signals["pitch_1"] == pytest.approx(0.5 * math.pi)


def test_seeds_decide_on_path_and_turbulence():
    env = make()
    chosen = {"wind_speed": 12.0, "wind_seed": 5}
    winds = []
    for seed in (1, 2):
        env.reset(seed=seed, options=chosen)
        winds.append(env.episode_wind.inflow)
    assert np.array_equal(winds[0].speeds, winds[1].speeds)
    assert winds[0].offset == winds[1].offset == 0.0
    env.reset(seed=1)
    first = env.episode_wind.inflow
    env.reset(seed=1)
    assert np.array_equal(env.episode_wind.inflow.speeds, first.speeds)
    env.reset(seed=2)
    assert not np.array_equal(env.episode_wind.inflow.speeds, first.speeds)
    assert first.speeds.max() <= 32.0
    sigma = first.scales * first.box.scale * 0.14 * (0.75 * 12.0 + 5.6)
    at = np.argmin(abs(first.speeds - 18.0))
    assert sigma[at] == pytest.approx(0.14 * (0.75 * first.speeds[at] + 5.6), rel=1e-6)


def test_a_start_from_standstill_to_power_in_the_free_wake():
    env = make(controller=FAST + ",run_up=30")
    env.reset(seed=3, options={"inflow": path((0.0, 11.0)), "rotor_speed": 0.0, "pitch": 0.5 * math.pi,
                               "generator_torque": 0.0})  # fmt: skip
    states, _, info, _ = play(env, 90.0)
    assert states == ["parked", "start_up", "production"]
    assert info["generator_power"] > 2.5e6
    assert info["rotor_speed_max"] < 1.15 * env.limits.rated


def test_an_agent_moves_neither_blades_nor_torque_of_a_parked_turbine():
    """In a calm a torque offset would give power below cut-in, and tilt and yaw would turn the blades."""
    env = make(controller=FAST)
    env.reset(seed=3, options={"inflow": path((0.0, 2.0)), "rotor_speed": 0.05, "pitch": 1.5, "generator_torque": 0.0})
    states, _, info, _ = play(env, 3.0, np.ones(5))
    assert states == ["parked"]
    assert env.setpoint.generator_torque > 1000.0
    assert info["generator_power"] == 0.0
    assert np.array_equal(env.demand.pitch, env.operation.base.pitch)
    assert env.setpoint.set_point == 0.0  # nothing is wound up that would not act in production


def test_a_storm_ends_in_a_parked_turbine_and_nothing_breaks():
    env = make(controller=FAST)
    env.reset(seed=3, options={"inflow": path((0.0, 22.0), (40.0, 34.0))})
    states, _, info, observation = play(env, 60.0)
    assert states == ["production", "soft_cut_out", "shut_down", "parked"]
    assert "termination" not in info
    assert np.isfinite(observation).all()
    assert abs(info["rotor_speed"]) < 0.1 * env.limits.rated
    assert max(env.signals["root_flap_moment_max"]) < 15e6


def test_the_set_point_of_an_agent_holds_the_turbine_back():
    env = make()
    env.reset(seed=3, options={"inflow": path((0.0, 16.0))})
    play(env, 20.0, np.array([0.0, 0.0, 0.0, 0.0, -1.0]))
    supervisor = supervisor_of(env.controller)
    assert env.setpoint.set_point == pytest.approx(-0.3)
    assert supervisor.asked == env.setpoint.set_point
    play(env, 15.0)
    assert env.signals["rotor_speed"] / env.limits.rated == pytest.approx(0.7, abs=0.03)
    assert env.signals["generator_power"] == pytest.approx(0.7 * 5e6, rel=0.1)


def test_a_set_point_needs_a_supervisor_and_residual_actions():
    with pytest.raises(ValueError, match="needs a base controller with a supervisor"):
        make(controller="discon", observation=("measurable",))
    with pytest.raises(ValueError, match="needs action_mode='residual'"):
        make(action_mode="rate")


class Never:
    """A turbine that stays parked, whatever the wind."""

    channels = ("rotor_speed",)

    def start(self, signals, demand):
        """Take over the pitch."""
        self._pitch = demand.pitch.copy()

    def step(self, signals, dt):
        """Return the demand to feather without torque."""
        self._pitch = np.minimum(self._pitch + dt * 0.1, 0.5 * math.pi)
        return Demand(self._pitch.copy(), 0.0, 0.0)


def test_the_real_rosco_starts_is_held_back_in_storm_and_starts_again_under_the_supervisor():
    pytest.importorskip("rosco")
    env = make(controller="rosco+supervisor:averaging=10,restart_delay=2,run_up=30")
    knots = (0.0, 14.0), (90.0, 14.0), (110.0, 29.0), (130.0, 29.0), (140.0, 32.0), (180.0, 32.0), (190.0, 14.0)
    options = {"inflow": path(*knots), "rotor_speed": 0.0, "pitch": 0.5 * math.pi, "generator_torque": 0.0}
    env.reset(seed=3, options=options)
    states, _, info, _ = play(env, 88.0)
    assert states == ["parked", "start_up", "production"]
    assert info["generator_power"] == pytest.approx(5e6, rel=0.02)
    states, _, info, _ = play(env, 42.0)
    assert states == ["production", "soft_cut_out"]
    supervisor = env.operation.supervisor
    speed, power = supervisor.set_points(29.0)
    assert info["rotor_speed"] == pytest.approx(speed * supervisor.rated_speed, rel=0.1)
    assert info["generator_power"] == pytest.approx(power * 5e6, rel=0.15)
    states, _, info, _ = play(env, 160.0)
    assert states[1:] == ["shut_down", "parked", "start_up", "production"]
    assert info["generator_power"] == pytest.approx(5e6, rel=0.02)


@pytest.mark.parametrize(("speed", "parked"), [(2.0, True), (10.0, False), (26.0, True)])
def test_an_episode_of_the_real_rosco_starts_as_the_turbine_stands_in_the_wind(speed, parked):
    pytest.importorskip("rosco")
    env = make(controller="rosco:start_stop=True", **WITHOUT_STATES)
    info = env.reset(seed=1, options={"wind_speed": speed, "wind_seed": 5})[1]
    assert (info["rotor_speed"] == 0.0) == parked
    assert "state" not in info


def test_a_controller_without_supervisor_is_evaluated_without_set_point_and_states():
    there = Environments(ID, {"start": "steady"})
    other = there.environment_of("discon", {}).unwrapped
    assert other.options.controller.base == "discon"
    assert not any("set_point" in name for name in other.action_names)
    assert not {f"state_{state}" for state in STATES} & set(other.observation_names.tolist())
    same = there.environment_of("linear_optimal+supervisor", {}).unwrapped
    assert list(same.action_names) == list(there.plain.unwrapped.action_names)
    there.close()


WITHOUT_STATES = {"observation": ("measurable",), "action_components": ("pitch", "torque")}


@pytest.mark.parametrize("speed", [9.0, 15.0, 26.0])
def test_a_turbine_that_never_produces_earns_less(speed):
    """In moderate wind, above rated, and in a storm in which a hard cut-out stands."""
    options = {"inflow": path((0.0, speed))}
    producing = make()
    producing.reset(seed=3, options=options)
    parked = make(controller=Never(), **WITHOUT_STATES)
    parked.reset(seed=3, options=options | {"rotor_speed": 0.0, "pitch": 0.5 * math.pi, "generator_torque": 0.0})
    action, still = np.zeros(5), np.zeros(4)
    earned = [0.0, 0.0]
    for _ in range(200):
        earned[0] += producing.step(action)[1]
        earned[1] += parked.step(still)[1]
    assert earned[0] > earned[1] + 2.0


def test_an_overspeed_for_energy_ends_the_episode_and_costs_more_than_it_earns():
    env = make(controller="discon+supervisor:overspeed=2.0,averaging=60")
    env.reset(seed=3, options={"inflow": path((0.0, 18.0)), "rotor_speed": 1.3 * 1.267, "pitch": 0.2,
                               "generator_torque": 4e4})  # fmt: skip
    _, total, info, _ = play(env, 60.0)
    assert info["termination"] == "overspeed"
    assert total < -500.0
