"""Feed-forward by lidar: its filter against its transfer function, shifts, fade, where its readings come from."""

import cmath
import math
from dataclasses import replace

import gymnasium as gym
import numpy as np
import pytest

from wt_gym.control import Demand, Lidar, operating_point
from wt_gym.control.controllers.controller import Combined, lidar_of, readings_of
from wt_gym.control.controllers.discon import DisconController, nrel_5mw_parameters
from wt_gym.control.controllers.lidar_feedforward import LidarFeedforward
from wt_gym.control.controllers.names import make_controller
from wt_gym.envs.layout import layout_of
from wt_gym.experiment.agents import ControllerAgent
from wt_gym.experiment.run import run_controller
from wt_gym.simulation import Simulator
from wt_gym.turbines import load_turbine
from wt_gym.turbines.variants import with_damper
from wt_gym.wind import SteadyInflow, TurbulenceBox, TurbulentInflow

MEAN, STEP, RATED = 16.0, 0.05, nrel_5mw_parameters().reference_speed / 97


def seen(controller, wind, time, **changes):
    """Readings in a wind that travels at the mean speed, given as function of the time at the tower."""
    gates = enumerate(controller.lidar.ranges, start=1)
    values = {f"lidar_{k}": wind(time + gate / MEAN) for k, gate in gates}
    return {"generator_speed": 97 * RATED, "rotor_speed": RATED} | values | changes


def demand(pitch=0.25):
    return Demand(np.full(3, pitch), 0.0, 40_000.0)


@pytest.mark.parametrize("frequency", [0.05, 0.3, 1.0])
@pytest.mark.parametrize("delay", [0.0, 0.5])
def test_the_wind_is_low_passed_without_lag(frequency, delay, turbine):
    """exp(i w / kU) / (1 + i w / kU) exp(-i w delay): the wind at the tower, early by the lag of the filter."""
    controller = make_controller("lidar", turbine, delay=delay)
    amplitude = 1e-3  # so small that U is the mean
    time = np.arange(0.0, 60.0 + 20 * math.pi / frequency, STEP)
    controller.start(seen(controller, lambda t: MEAN, 0.0), demand())
    found = []
    for t in time:
        controller.step(seen(controller, lambda t: MEAN + amplitude * math.sin(frequency * t), t), STEP)
        found.append((controller.wind - MEAN) / amplitude)
    turn = frequency / (controller.wavenumber * MEAN)
    expected = cmath.exp(1j * turn) / (1 + 1j * turn) * cmath.exp(-1j * frequency * delay)
    late = time >= time[-1] - 10 * math.pi / frequency
    wave = np.exp(1j * frequency * time[late])
    response = 2j * (np.array(found)[late] * wave.conj()).mean()
    # the filter takes readings that are held over a step: half a step early
    assert response == pytest.approx(expected * cmath.exp(0.5j * frequency * STEP), abs=0.01)


@pytest.mark.parametrize(("mean", "gusts", "speed"), [(MEAN, 0.0, 1.0), (9.0, 1.0, 0.8), (-1.0, 0.0, 1.0)])
def test_in_a_steady_wind_below_rated_and_in_a_calm_it_is_the_base(mean, gusts, speed, turbine):
    alone, wrapped = make_controller("discon", turbine), make_controller("lidar", turbine)

    def now(t):
        turns = {"generator_speed": 97 * speed * (RATED + 0.02 * math.sin(2.0 * t)), "rotor_speed": speed * RATED}
        return seen(wrapped, lambda at: mean + gusts * math.sin(at), t, **turns)

    for controller in (alone, wrapped):
        controller.start(now(0.0), demand(0.25 if speed == 1.0 else 0.0))
    for k in range(600):
        assert np.array_equal(alone.step(now(0.1 * k), 0.1).pitch, wrapped.step(now(0.1 * k), 0.1).pitch)
    assert mean > 0.0 or len(wrapped._at) == 1


@pytest.mark.parametrize("name", ["discon", "retuned", "tsr_tracking"])
def test_a_shift_moves_the_next_demand(name, turbine):
    now = {f"pitch_{b}": 0.25 for b in (1, 2, 3)}
    now |= {"generator_speed": 97 * RATED, "rotor_speed": RATED, "generator_torque": 40_000.0}
    made = []
    for change in (0.0, 0.004):
        controller = make_controller(name, turbine)
        controller.start(now, demand())
        controller.step(now, 0.1)
        controller.shift_pitch(change)
        made.append([controller.step(now, 0.1).pitch for _ in range(3)])
    # without a speed error by just so much, and it stays, whatever the gain schedule does with the integral
    assert np.subtract(*made[::-1]) == pytest.approx(np.full((3, 3), 0.004), rel=2e-2)


@pytest.mark.parametrize("name", ["discon", "tsr_tracking"])
@pytest.mark.parametrize(("end", "side"), [(0.0, 1.0), (1.570796, -1.0)])
def test_a_shift_ends_at_the_limit(name, end, side, turbine):
    now = {f"pitch_{b}": end for b in (1, 2, 3)}
    now |= {"generator_speed": 97 * RATED, "rotor_speed": RATED, "generator_torque": 40_000.0}
    controller = make_controller(name, turbine)
    controller.start(now, demand(end + 0.001 * side))
    controller.shift_pitch(-0.01 * side)
    controller.shift_pitch(0.005 * side)
    assert controller.step(now, 0.1).pitch == pytest.approx(np.full(3, end + 0.005 * side), abs=2e-4)


def test_the_pitch_follows_the_steady_curve(turbine):
    """From 16 to 17 m/s by as much as the steady pitch rises, where the rotor speed never leaves rated."""
    controller = make_controller("lidar", turbine, gain=1.0)
    start, end = operating_point(turbine, 16.0).pitch, operating_point(turbine, 17.0).pitch

    def wind(t):
        return min(max(16.0 + (t - 40.0) / 20.0, 16.0), 17.0)

    controller.start(seen(controller, wind, 0.0), demand(start))
    pitch = [controller.step(seen(controller, wind, 0.1 * k), 0.1).pitch[0] for k in range(900)]
    assert pitch[0] == pytest.approx(start, abs=1e-12)
    assert pitch[-1] == pytest.approx(end, abs=1e-4)
    assert np.all(np.diff(pitch) >= -1e-12)


def test_nothing_moves_before_the_air_has_come(turbine):
    """The farthest gate's first air needs 1.5 diameters at the mean speed."""
    controller = make_controller("lidar", turbine, fade=False)
    controller.start(seen(controller, lambda t: MEAN, 0.0), demand())
    steps = (seen(controller, lambda t: MEAN + 0.5 * math.sin(t), 0.1 * k) for k in range(200))
    moved = [abs(controller.step(now, 0.1).pitch[0] - 0.25) > 1e-9 for now in steps]
    assert moved.index(True) * 0.1 == pytest.approx(1.5 * turbine.rotor_diameter / MEAN, rel=0.05)


@pytest.mark.parametrize("mean", [0.05, 1.0, 16.0])
def test_it_keeps_what_it_needs_of_the_readings(mean, turbine):
    """Not more than one a hundredth of the filter's lag, over the way from the farthest gate."""
    controller = make_controller("lidar", turbine)
    now = {"generator_speed": 97 * RATED, "rotor_speed": RATED} | {f"lidar_{k}": mean for k in (1, 2, 3)}
    controller.start(now, demand())
    for _ in range(4000):
        controller.step(now, 0.1)
    assert 2 < len(controller._at) <= 100 * controller.wavenumber * controller.lidar.ranges[-1] + 3
    kept = controller._traveled - controller._at[0]
    assert kept == pytest.approx(min(mean * 400.0, controller.lidar.ranges[-1] - 1 / controller.wavenumber), rel=0.2)


def test_the_air_comes_at_the_speed_of_the_mean_wind(turbine):
    """After a slow rise from 12 to 18 m/s a small step is met when it is at the tower, at the speed of the new wind."""
    controller = make_controller("lidar", turbine, delay=0.0)

    def wind(x, t):
        """At a distance ahead of the tower; the step travels at 18 m/s and is there after 300 s."""
        return min(12.0 + max(t - 20.0, 0.0) / 10.0, 18.0) + (0.01 if t + x / 18.0 >= 300.0 else 0.0)

    def now(t):
        gates = enumerate(controller.lidar.ranges, start=1)
        return {"generator_speed": 97 * RATED, "rotor_speed": RATED} | {f"lidar_{k}": wind(x, t) for k, x in gates}

    controller.start(now(0.0), demand())
    found = {}
    for k in range(3300):
        controller.step(now(0.1 * k), 0.1)
        found[round(0.1 * k, 1)] = controller.wind
    lag = 1.0 / (controller.wavenumber * 18.0)  # begins so much before it is there, then is 1 - exp(-1) of it
    assert found[round(300.0 - lag - 0.3, 1)] == pytest.approx(18.0, abs=1e-4)
    assert found[300.0] == pytest.approx(18.0 + 0.01 * -math.expm1(-1.0), abs=4e-4)


def test_what_is_below_the_schedule_does_not_jump(turbine):
    controller = make_controller("tsr_tracking", turbine, thrust_limit=0.8)
    now = {"generator_speed": 97 * RATED, "rotor_speed": RATED, "generator_torque": 40_000.0}
    now |= {f"pitch_{b}": 0.0 for b in (1, 2, 3)}
    controller.start(now, demand(0.0))
    controller._wind.reset(10.6)
    assert controller._least_pitch() > 0.02
    controller.shift_pitch(0.0)
    assert controller._pitch == 0.0


def test_names_put_it_on_the_inside_of_the_base(turbine):
    for name in ("lidar+fore_aft_damper", "fore_aft_damper+lidar", "discon+fore_aft_damper+lidar"):
        made = make_controller(name, turbine, filter_length=0.4)
        assert isinstance(made, Combined)
        assert isinstance(made.base, LidarFeedforward)
        assert isinstance(made.base.base, DisconController)
        assert made.base.wavenumber == pytest.approx(1 / (0.4 * turbine.rotor_diameter))
    assert lidar_of(make_controller("ipc", turbine)) is None
    assert lidar_of(made) == Lidar.for_rotor(turbine.rotor_diameter)
    with pytest.raises(ValueError, match="has a damper as generator"):
        make_controller("lidar", with_damper(load_turbine("gebhardt_45m")))
    with pytest.raises(TypeError, match="whose pitch can be shifted"):
        LidarFeedforward(turbine, made)


def test_readings_are_those_of_the_lidar_in_the_inflow(turbine):
    inflow = SteadyInflow(14.0, turbine.hub_height, shear_exponent=0.2)
    signals = {"time": 3.0, "yaw": 0.1, "rotor_speed": 1.2}
    controller = make_controller("lidar", turbine)
    found = readings_of(controller, signals, inflow, turbine.hub_height)
    expected = Lidar.for_rotor(turbine.rotor_diameter).read(inflow, 3.0, 0.1, turbine.hub_height)
    assert [found[f"lidar_{k}"] for k in (1, 2, 3)] == pytest.approx(expected, rel=1e-14)
    assert found["rotor_speed"] == 1.2
    assert readings_of(make_controller("discon", turbine), signals, inflow, turbine.hub_height) is signals


def test_beneath_an_agent_it_reads_what_the_observation_shows(monkeypatch):
    # a running start has it hear what was before, and a twin, unless its course is known, hears too
    plain = {"start": "steady", "relative_reward": False, "reward_credit": False}
    env = gym.make("wt_gym/LoadReduction-v3", controller="lidar+constrained_ipc", observation=("lidar",), **plain)
    env.reset(seed=3)  # canary runs of new sources hear too
    heard, step = [], LidarFeedforward.step
    monkeypatch.setattr(LidarFeedforward, "step", lambda s, r, dt: (heard.append(r["lidar_2"]), step(s, r, dt))[1])
    observation, _ = env.reset(seed=3)
    shown = [float(env.unwrapped.layout.observation.value(observation, "lidar_2"))]
    for _ in range(3):
        observation, *_ = env.step(np.zeros(env.action_space.shape))
        shown.append(float(env.unwrapped.layout.observation.value(observation, "lidar_2")))
    env.close()
    assert heard[::2] == pytest.approx(shown[:3], rel=1e-5)  # two steps of the simulator in one of the agent's


def test_it_steadies_the_rotor_in_turbulence(turbine):
    """Published: up to 40 % less deviation of the rotor speed (Guo et al. 2023); the feedback alone sees gusts late."""
    steady = SteadyInflow(16.0, turbine.hub_height, shear_exponent=0.2)
    box = TurbulenceBox.kaimal(16.0, turbine.hub_height, turbine.rotor_diameter, "B", seed=5)
    simulator = Simulator(turbine, TurbulentInflow(box, steady))
    frozen = replace(Lidar.for_rotor(turbine.rotor_diameter), frozen=True)
    deviations = []
    for name, options in (("discon", {}), ("lidar", {}), ("lidar", {"lidar": frozen})):
        recorder = run_controller(simulator, make_controller(name, turbine, **options), 90.0)
        deviations.append(float(recorder.to_dataset()["rotor_speed"].values[300:].std()))
    feedback, changing, unchanged = deviations
    assert unchanged < 0.8 * feedback
    assert unchanged < changing < 0.95 * feedback


def test_as_an_agent_it_needs_the_lidar_of_the_observation():
    more = {"action_mode": "rate", "pitch": "collective", "action_components": None}
    more["observation"] = ("rotor", "power", "pitch", "lidar")
    env = gym.make("wt_gym/NREL5MW-Turbulent-v1", **more, wind_speed=16.0, max_episode_steps=1000)
    agent = ControllerAgent(layout_of(env), "lidar")
    observation, _ = env.reset(seed=1)
    for _ in range(100):
        observation, *_ = env.step(agent.predict(observation)[0])
    (controller,) = agent._controllers
    shown = [env.unwrapped.layout.observation.value(observation, f"lidar_{k}") for k in (1, 2, 3)]
    assert len(controller._seen) > 40
    assert abs(np.subtract(controller._seen, shown)).sum(axis=1).min() < 2.0  # of the observation before this one
    env.close()
    other = gym.make("wt_gym/NREL5MW-Turbulent-v1", **more, lidar=Lidar((50.0, 100.0, 150.0)))
    with pytest.raises(ValueError, match=r"the controller reads Lidar.* the observation has Lidar"):
        ControllerAgent(layout_of(other), "lidar")
    other.close()


def test_an_observation_has_the_lidar_of_the_base_controller():
    lidar = Lidar([70, 140])
    env = gym.make(
        "wt_gym/LoadReduction-v3", observation=("lidar",), reward_credit=False,
        controller=lambda t: make_controller("lidar", t, lidar=lidar),
    )  # fmt: skip
    assert env.unwrapped.layout.lidar == lidar
    assert env.unwrapped.layout.observation.names == ("lidar_1", "lidar_2")
    env.close()
