"""Controllers of the library behind the observation and action of an environment."""

import gymnasium as gym
import numpy as np
import pytest

from wt_gym.base.errors import WtGymError
from wt_gym.control.controllers import IndividualPitch, make_controller
from wt_gym.control.sensors import from_harmonic, to_harmonic
from wt_gym.envs.layout import layout_of
from wt_gym.experiment.agents import ControllerAgent

TURBULENT = "wt_gym/NREL5MW-Turbulent-v1"


@pytest.fixture(scope="module")
def envs():
    """One environment a choice of arguments."""
    made = {}

    def make(**arguments):
        key = tuple(sorted(arguments.items()))
        if key not in made:
            made[key] = gym.make(TURBULENT, wind_speed=15.0, **arguments)
        return made[key]

    return make


@pytest.mark.parametrize(("mode", "name"), [("rate", "ipc+tower_dampers"), ("absolute", "discon")])
def test_demands_are_those_of_the_controller(envs, mode, name):
    env = envs(action_mode=mode, pitch="individual")
    raw, agent = env.unwrapped, ControllerAgent(layout_of(env), name)
    controller = make_controller(name, raw.turbine)
    observation, _ = env.reset(seed=1)
    controller.start(raw.signals, raw.demand)
    for _ in range(25):
        expected = controller.step(raw.signals, raw.control_dt)
        action, _ = agent.predict(observation)
        assert action.dtype == np.float32
        observation, *_ = env.step(action)
        # float32 of observation and action
        np.testing.assert_allclose(raw.demand.pitch, expected.pitch, atol=1e-4)
        assert raw.demand.generator_torque == pytest.approx(expected.generator_torque, rel=1e-3)


@pytest.mark.parametrize(("mode", "pitch"), [("rate", "collective"), ("absolute", "individual")])
def test_late_observations_are_the_controllers_late_measurements(envs, mode, pitch):
    """It steps on what was measured three steps ago, with its own memory, in two episodes one after the other."""
    env = envs(action_mode=mode, pitch=pitch, sensor_delay=0.6)
    raw, agent = env.unwrapped, ControllerAgent(layout_of(env), "discon")
    for seed in (1, 2):
        controller = make_controller("discon", raw.turbine)
        observation, _ = env.reset(seed=seed)
        speeds = [raw.signals["generator_speed"]]
        controller.start(raw.signals, raw.demand)
        for k in range(25):
            expected = controller.step({"generator_speed": speeds[max(k - 3, 0)]}, raw.control_dt)
            observation, *_ = env.step(agent.predict(observation)[0])
            speeds.append(raw.signals["generator_speed"])
            np.testing.assert_allclose(raw.demand.pitch, expected.pitch, atol=1e-5)
            assert raw.demand.generator_torque == pytest.approx(expected.generator_torque, rel=1e-5)


def test_a_new_episode_starts_afresh_and_a_batch_is_many(envs):
    env = envs(action_mode="rate", pitch="individual")
    agent = ControllerAgent(layout_of(env), "tsr_tracking+ipc")
    first, _ = env.reset(seed=1)
    one, _ = agent.predict(first)
    observation = first
    for _ in range(5):
        observation, *_ = env.step(agent.predict(observation)[0])
    again, _ = agent.predict(first)
    np.testing.assert_array_equal(one, again)
    batch, state = agent.predict(np.stack([first, first]), None, np.ones(2, dtype=bool))
    np.testing.assert_array_equal(batch, np.stack([one, one]))
    assert state is None


class _Tilt:
    """A turning pitch of constant tilt, through individual pitch at its limit; speed and torque held."""

    channels = ("azimuth", "rotor_speed")

    def __init__(self, turbine, simulator_step):
        self.turbine, self.simulator_step = turbine, simulator_step

    def start(self, signals, demand):
        self.demand = demand
        self.addition = IndividualPitch(
            self.turbine, bandwidth=1.0, limit=0.02, rate_limit=0.06, fade=False, simulator_step=self.simulator_step
        )
        self.addition.start(signals)

    def step(self, signals, dt):
        moments = from_harmonic(1e7, 0.0, signals["azimuth"])
        seen = {name: signals[name] for name in self.channels}
        seen |= {f"root_flap_moment_{b}": moment for b, moment in enumerate(moments, start=1)}
        return self.addition.step(seen, dt, self.demand)


@pytest.mark.parametrize("mode", ["rate", "absolute"])
def test_individual_pitch_at_the_control_step_arrives_at_its_azimuth(envs, mode):
    """Two steps of the simulator in one of the controller, between which the environment moves the demand evenly."""
    env = envs(action_mode=mode, pitch="individual")
    raw, off = env.unwrapped, {}
    for step in (0.1, None):
        agent = ControllerAgent(layout_of(env), _Tilt(raw.turbine, step))
        observation, _ = env.reset(seed=1)
        for _ in range(20):
            observation, *_ = env.step(agent.predict(observation)[0])
        tilt, yaw = to_harmonic(raw.signals.pitch, raw.signals["azimuth"])
        off[step] = np.arctan2(yaw, tilt)
    assert abs(np.degrees(off[0.1])) < 0.5
    assert off[None] == pytest.approx(-0.05 * raw.signals["rotor_speed"], abs=0.01)  # half a step early


def test_missing_channels_and_collective_pitch_are_refused(envs):
    blind = gym.make(TURBULENT, wind_speed=15.0, pitch="individual", observation=("rotor", "power", "pitch"))
    with pytest.raises(KeyError, match=r"^the .*azimuth_sin and azimuth_cos .*it has rotor_speed") as refused:
        ControllerAgent(layout_of(blind), "ipc")
    assert isinstance(refused.value, WtGymError)  # a command says it in one line
    with pytest.raises(ValueError, match="individual"):
        ControllerAgent(layout_of(envs(action_mode="rate", pitch="collective")), "ipc")
    residual = gym.make(TURBULENT, wind_speed=15.0, action_mode="residual", pitch="fixed-frame")
    partly = gym.make(TURBULENT, wind_speed=15.0, action_components=("torque",))
    for env in (residual, partly):
        with pytest.raises(ValueError, match="base controller"):
            ControllerAgent(layout_of(env), "discon")
