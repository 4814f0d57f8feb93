"""Metamorphic tests of the environments: what must not change when the world is turned, moved, scaled or renamed.

Two episodes that physics cannot tell apart give the same observations, rewards and figures of merit, to rounding: the
wake is kept in single precision and observations are float32.
"""

import math
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import NamedTuple

import gymnasium as gym
import numpy as np
import pytest

import wt_gym.agents
from wt_gym.analysis.metrics import METRICS, run_metrics
from wt_gym.control.controllers.catalogue import CONTROLLERS
from wt_gym.simulation.recorder import Recorder
from wt_gym.tasks import TASKS
from wt_gym.turbines import load_turbine
from wt_gym.wind import TurbulentInflow
from wt_gym.wind.protocol import PointInflow

AGENTS = sorted(path.parent for path in (Path(wt_gym.agents.__file__).parent / "trained").glob("*/model.zip"))
ANGLES = (30.0, 90.0, 180.0, 237.0)
STEPS = 25
ROUNDING = 2e-4
"""Of observations, whose scale is about 1: float32 of a value of 10 rounds by 1e-6, and what it does grows since."""
FORCES = ("moment", "torsion", "torque", "power", "thrust")
"""Parts of the names of signals and of metrics that are forces, moments or powers."""
WIND = {"wind_speed": 13.0, "wind_seeds": (1,)}


class Course(NamedTuple):
    """What an episode was."""

    observations: np.ndarray
    rewards: np.ndarray
    metrics: dict
    signals: dict


def play(env, options=None, agent=None, steps=STEPS, order=None):
    """An episode of an agent, or of actions that are the same each time; `order` permutes their components."""
    bare = env.unwrapped
    observation, _ = env.reset(seed=5, options=options)
    recorder = Recorder(bare.simulator)
    recorder.append(bare.signals)
    observations, rewards = [observation], []
    size = env.action_space.shape[0]
    for k in range(steps):
        if agent is None:
            action = 0.5 * np.sin(0.4 * k + 2.0 * np.arange(size))
            action = action if order is None else action[order]
        else:
            action, _ = agent.predict(observation, deterministic=True)
        observation, reward, terminated, _, _ = env.step(np.asarray(action, np.float32))
        assert not terminated
        observations.append(observation)
        rewards.append(reward)
        recorder.append(bare.signals)
    run = recorder.to_dataset()
    signals = {name: run[name].values for name in run.data_vars}
    return Course(np.array(observations), np.array(rewards), run_metrics(run, bare.turbine), signals)


def assert_same(first, second, factor=1.0):
    """Equal courses; figures of merit that are forces, moments or powers are ``factor`` times as large."""
    np.testing.assert_allclose(second.observations, first.observations, atol=ROUNDING)
    np.testing.assert_allclose(second.rewards, first.rewards, atol=ROUNDING)
    assert second.rewards.sum() == pytest.approx(first.rewards.sum(), abs=ROUNDING)
    for name, value in first.metrics.items():
        scaled = factor if METRICS[name].unit.split()[0] in ("MW", "MWh", "MN", "kN") else 1.0
        size = 1e-3 / METRICS[name].factor  # a thousandth of the unit that is shown
        assert second.metrics[name] == pytest.approx(scaled * value, rel=1e-4, abs=size), name


@cache
def task_env(name, controller=None):
    arguments = {} if controller is None else {"controller": controller}
    if "wind_speed" not in TASKS[name].arguments or TASKS[name].arguments["inflow"] == "turbulent":
        arguments |= {"wind_seeds": (1,)}
    return gym.make(TASKS[name].ids[-1], **arguments)


@cache
def straight(name, controller=None):
    return play(task_env(name, controller))


# ---- turned ----


@pytest.mark.parametrize("angle", ANGLES)
@pytest.mark.parametrize("name", [pytest.param(n, marks=pytest.mark.slow) if n.startswith("IEA") else n for n in TASKS])
def test_a_turned_world_is_the_same_task(name, angle):
    assert_same(straight(name), play(task_env(name), {"yaw": math.radians(angle)}))


@pytest.mark.parametrize("name", CONTROLLERS)
def test_a_turned_world_is_the_same_for_every_controller(name):
    """Yaw acts in a wind from the side: the drive turns within the episode."""
    task, controller = ("Yaw", "discon+yaw") if name == "yaw" else ("LoadReduction", name)
    env = task_env(task, controller)
    nothing = np.zeros((STEPS, env.action_space.shape[0]))

    class Rest:
        def predict(self, observation, deterministic=True):
            return nothing[0], None

    first, turned = (play(env, {"yaw": math.radians(angle)}, Rest()) for angle in (0.0, 237.0))
    assert_same(first, turned)


@pytest.mark.parametrize("folder", AGENTS, ids=lambda path: path.name)
def test_a_turned_world_is_the_same_for_every_shipped_agent(folder):
    pytest.importorskip("stable_baselines3")
    from wt_gym.agents.trained_agent import TrainedAgent
    from wt_gym.agents.trained_environment import trained_arguments

    agent = TrainedAgent.load(folder)
    arguments = trained_arguments(agent.record) | {"wind_seeds": (1,)}
    env = gym.make("wt_gym/NREL5MW-Turbulent-v1", **arguments)
    first, turned = (play(env, {"yaw": math.radians(angle)}, agent) for angle in (0.0, 237.0))
    assert_same(first, turned)


def test_what_is_named_after_a_global_axis_turns_and_the_rest_does_not():
    first, turned = straight("LoadReduction"), play(task_env("LoadReduction"), {"yaw": math.radians(90.0)})
    for name in ("tower_top", "tower_base_moment"):
        x, y = first.signals[f"{name}_x"], first.signals[f"{name}_y"]
        size = np.abs(x).max() + np.abs(y).max()
        np.testing.assert_allclose(turned.signals[f"{name}_x"], -y, atol=1e-4 * size)
        np.testing.assert_allclose(turned.signals[f"{name}_y"], x, atol=1e-4 * size)
    differing = {
        name
        for name, values in first.signals.items()
        if not np.allclose(turned.signals[name], values, rtol=1e-3, atol=1e-3 * np.abs(values).max() + 1e-9)
    }
    assert differing == {
        "wind_x", "wind_y", "yaw", "tower_top_x", "tower_top_y", "tower_base_moment_x", "tower_base_moment_y",
    }  # fmt: skip


# ---- moved in space and time ----


class Moved(PointInflow):
    """A wind seen from a place further downwind, at a later time.

    Frozen turbulence is carried along: what passes here now has passed there before.
    """

    def __init__(self, inner, downwind, later):
        self.inner, self.downwind, self.later = inner, np.array([downwind, 0.0, 0.0]), later

    mean_speed = property(lambda self: self.inner.mean_speed)
    hub_height = property(lambda self: self.inner.hub_height)
    description = property(lambda self: f"{self.inner.description}, seen from elsewhere")

    def _fill(self, rows, time, out):
        out[...] = self.inner.velocity(rows + self.downwind, time + self.later)
        return -1


def turbulence(env):
    """The turbulent inflow of an episode."""
    env.reset(seed=5)
    inflow = env.unwrapped.episode_wind.inflow
    assert isinstance(inflow, TurbulentInflow)
    return inflow


def test_frozen_turbulence_carries_an_episode_along():
    env = task_env("LoadReduction")
    inflow = turbulence(env)
    later = 40.0
    moved = Moved(inflow, later * inflow.mean_speed, later)
    assert_same(play(env, {"inflow": inflow}), play(env, {"inflow": moved}))


@pytest.mark.parametrize("samples", [1, 997])
def test_a_shifted_time_is_the_same_episode(samples):
    """The box starts later, and the episode as much later in it; or a period of it later."""
    env = task_env("LoadReduction")
    inflow = turbulence(env)
    box = inflow.box
    rolled = replace(box, fluctuation=np.roll(box.fluctuation, samples, axis=0))
    shifted = TurbulentInflow(rolled, inflow.steady, inflow.time_offset + samples * box.time_step)
    first = play(env, {"inflow": inflow})
    assert_same(first, play(env, {"inflow": shifted}))
    assert_same(first, play(env, {"inflow": TurbulentInflow(box, inflow.steady, inflow.time_offset + box.duration)}))


def test_a_shifted_place_across_the_wind_is_the_same_episode():
    """A grid of more columns, of which the rotor meets the same."""
    env = task_env("LoadReduction")
    inflow = turbulence(env)
    box = inflow.box
    wider = np.concatenate([box.fluctuation[:, :, :1], box.fluctuation, box.fluctuation[:, :, -1:]], axis=2)
    wide = TurbulentInflow(replace(box, fluctuation=wider), inflow.steady, inflow.time_offset)
    assert_same(play(env, {"inflow": inflow}), play(env, {"inflow": wide}))


# ---- scaled ----


def scaled(turbine, s):
    """A turbine with the same motions in air of s times the density: all masses, stiffnesses and torques are s times.

    Without published numbers of a controller, which belong to the turbine as it is: gains follow from rules.
    """

    def beam(stations):
        return replace(stations, stiffness=s * stations.stiffness, inertia=s * stations.inertia)

    def times(part, *names):
        return replace(part, **{name: s * getattr(part, name) for name in names})

    return replace(
        turbine,
        control=None,
        air_density=s * turbine.air_density,
        blade=replace(turbine.blade, structure=beam(turbine.blade.structure)),
        tower=replace(turbine.tower, structure=beam(turbine.tower.structure)),
        hub=times(turbine.hub, "mass", "inertia_axial", "inertia_transverse"),
        nacelle=times(turbine.nacelle, "mass", "inertia", "yaw_bearing_mass", "yaw_spring", "yaw_damper"),
        drivetrain=times(
            turbine.drivetrain, "generator_inertia", "spring", "damper", "rated_power", "max_generator_torque",
            "max_torque_rate", "generator_damping",
        ),
    )  # fmt: skip


@pytest.mark.parametrize(
    ("task", "controller"),
    [
        ("LoadReduction", "discon"),
        ("LoadReduction", "ipc+tower_dampers"),
        ("FullRange", "discon"),
        ("MaxPower", "discon"),
    ],
)
def test_density_mass_and_stiffness_scaled_alike_change_no_motion(task, controller):
    """Every term of the equations of motion is a force: times s all of them, it is the same motion."""
    turbine, scales = load_turbine("nrel_5mw"), (0.8, 1.25)
    courses = [
        play(gym.make(TASKS[task].ids[-1], turbine=scaled(turbine, s), controller=controller, wind_seeds=(1,)))
        for s in scales
    ]
    ratio = scales[1] / scales[0]
    assert_same(*courses, factor=ratio)
    first, second = (course.signals for course in courses)
    for name in first:
        factor = ratio if any(part in name for part in FORCES) else 1.0
        size = np.abs(first[name]).max() + 1e-12
        np.testing.assert_allclose(second[name] / size, factor * first[name] / size, atol=1e-3, err_msg=name)


# ---- blades renamed ----


def renamed(name, n_blades=3):
    """What a signal of a blade is called when each blade takes the name of the one behind it."""
    stem, _, number = name.rpartition("_")
    return f"{stem}_{int(number) % n_blades + 1}" if number in ("1", "2", "3") else name


@pytest.mark.parametrize("mode", ["individual", "fixed-frame", "collective"])
@pytest.mark.parametrize("controller", ["discon", "constrained_ipc", "ipc_2p"])
def test_blades_have_no_rank(mode, controller):
    """Blade 1 starts where blade 2 did, with its actions: everything is the same under other names."""
    env = gym.make(
        "wt_gym/NREL5MW-Turbulent-v1", action_mode="residual", pitch=mode, controller=controller, **WIND,
        action_components=("pitch",), observation=("rotor", "pitch", "blades", "fixed_frame", "tower"),
    )  # fmt: skip
    first = play(env, {"azimuth": 0.5})
    order = [1, 2, 0] if mode == "individual" else None
    second = play(env, {"azimuth": 0.5 + 2.0 * math.pi / 3.0}, order=order)
    names = [channel.name for channel in env.unwrapped.layout.observation.channels]
    places = [names.index(renamed(name)) for name in names]
    assert_same(first._replace(observations=first.observations[:, places]), second)
    for name, values in second.signals.items():
        other = first.signals[renamed(name)]
        if name == "azimuth":
            other = (other + 2.0 * math.pi / 3.0) % (2.0 * math.pi)
        size = np.abs(other).max() + 1e-12
        np.testing.assert_allclose(values / size, other / size, atol=1e-3, err_msg=name)
