"""Metamorphic tests of the environments: what must not change when the world is turned, moved, scaled or renamed.

Two episodes that physics cannot tell apart give the same observations, rewards and figures of merit, to rounding: the
wake is kept in single precision and observations are float32.
"""

import math
import re
from dataclasses import replace
from functools import cache
from typing import NamedTuple

import gymnasium as gym
import numpy as np
import pytest

from wt_gym.analysis.metrics import METRICS, run_metrics
from wt_gym.base.constants import AIR_DENSITY
from wt_gym.base.files import shipped_folder
from wt_gym.control.controllers import COMPILED, CONTROLLERS, lidar_of
from wt_gym.envs.channels import OBSERVATION_GROUPS
from wt_gym.simulation.channels import channel_table
from wt_gym.simulation.recorder import Recorder
from wt_gym.tasks import TASKS
from wt_gym.turbines import load_turbine
from wt_gym.turbines.variants import mirrored
from wt_gym.wind import MirroredInflow, SteadyInflow, TransientInflow, TurbulentInflow, TurningInflow
from wt_gym.wind.inflow import PointInflow

AGENTS = sorted(path.parent for path in (shipped_folder() / "trained").glob("*/model.zip"))
ANGLES = (*(pytest.param(angle, marks=pytest.mark.slow) for angle in (30.0, 90.0, 180.0)), 237.0)
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
    return gym.make(TASKS[name].id, **arguments)


@cache
def straight(name, controller=None):
    return play(task_env(name, controller))


# ---- turned ----


@pytest.mark.parametrize("angle", ANGLES)
@pytest.mark.parametrize(
    "name", [pytest.param(n, marks=pytest.mark.slow) if n.startswith(("IEA", "Dial")) else n for n in TASKS]
)
def test_a_turned_world_is_the_same_task(name, angle):
    assert_same(straight(name), play(task_env(name), {"yaw": math.radians(angle)}))


VARIED = {
    "pitch_gain": 1.2, "tower_frequency": 0.93, "blade_stiffness": 0.9, "air_density": 0.95, "drive_lag": 0.2,
    "sensor_delay": 0.1, "sensor_offset": (-0.4, 0.4), "sensor_noise": 1.0,
}  # fmt: skip
"""What may vary without a side."""


def test_a_turned_world_is_the_same_with_a_variation():
    variation = {**VARIED, "yaw_error": 0.2, "shear_exponent": -0.1, "turbulence_class": ("A",)}
    env = gym.make(TASKS["LoadReduction"].id, wind_seeds=(1,), variation=variation, controller="constrained_ipc")
    assert_same(play(env), play(env, {"yaw": math.radians(30.0)}))


# libraries get their readings in single precision
OURS = [name for name in CONTROLLERS if name not in COMPILED]
FEW = ("ipc", "tower_dampers", "lidar", "linear_optimal", "yaw")
"""Controllers that read a direction each in their own way."""


@pytest.mark.parametrize("name", [name if name in FEW else pytest.param(name, marks=pytest.mark.slow) for name in OURS])
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
    from wt_gym.experiment.environments import trained_arguments
    from wt_gym.experiment.trained_agent import TrainedAgent

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


def scaled(turbine, s, published=False):
    """A turbine with the same motions in air of s times the density: all masses, stiffnesses and torques are s times.

    Gravity and lengths stay, and with them all speeds, angles and frequencies. The published numbers of its controller
    are left out, so that gains follow from rules, or kept: those that are torques or powers s times.
    """
    if turbine.control is None or not published:
        control = None
    else:
        names = ("region_2_gain", "rated_mechanical_power", "torque_proportional_gain", "torque_integral_gain",
                 "power_per_pitch")  # fmt: skip
        known = {name: getattr(turbine.control, name) for name in names}
        control = replace(
            turbine.control,
            air_density=s * (turbine.control.air_density or AIR_DENSITY),
            **{name: None if value is None else s * value for name, value in known.items()},
        )

    def beam(stations):
        return replace(stations, stiffness=s * stations.stiffness, inertia=s * stations.inertia)

    def times(part, *names):
        return replace(part, **{name: s * getattr(part, name) for name in names})

    support = turbine.tower.support
    if support is not None:  # in water that is denser too
        support = times(replace(support, structure=beam(support.structure)), "top_mass", "water_density")
        support = support if support.foundation is None else times(support, "foundation")

    return replace(
        turbine,
        control=control,
        air_density=s * turbine.air_density,
        blade=replace(turbine.blade, structure=beam(turbine.blade.structure)),
        tower=replace(turbine.tower, structure=beam(turbine.tower.structure), support=support),
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
        pytest.param("LoadReduction", "discon", marks=pytest.mark.slow),
        ("LoadReduction", "ipc+tower_dampers"),
        pytest.param("FullRange", "discon", marks=pytest.mark.slow),
        ("MaxPower", "discon"),
    ],
)
def test_density_mass_and_stiffness_scaled_alike_change_no_motion(task, controller):
    """Every term of the equations of motion is a force: times s all of them, it is the same motion."""
    turbine, scales = load_turbine("nrel_5mw"), (0.8, 1.25)
    courses = [
        play(gym.make(TASKS[task].id, turbine=scaled(turbine, s), controller=controller, wind_seeds=(1,)))
        for s in scales
    ]
    ratio = scales[1] / scales[0]
    assert_same(*courses, factor=ratio)
    first, second = (course.signals for course in courses)
    for name in first:
        factor = ratio if any(part in name for part in FORCES) else 1.0
        size = np.abs(first[name]).max() + 1e-12
        np.testing.assert_allclose(second[name] / size, factor * first[name] / size, atol=1e-3, err_msg=name)


@pytest.mark.parametrize(
    ("task", "controller", "turbine"),
    [
        ("LoadReduction", "discon", "nrel_5mw"),
        ("FullRange", "retuned", "nrel_5mw"),
        pytest.param("LoadReduction", "tuned", "nrel_5mw", marks=pytest.mark.slow),
        pytest.param("LoadReduction", "tsr_tracking+yaw", "nrel_5mw", marks=pytest.mark.slow),
        pytest.param("MaxPower", "discon", "nrel_5mw", marks=pytest.mark.slow),
        pytest.param("LoadReduction", "discon", "nrel_5mw_monopile", marks=pytest.mark.slow),
        pytest.param("LoadReduction", "discon", "iea_15mw", marks=pytest.mark.slow),
        pytest.param("FullRange", "discon", "iea_22mw", marks=pytest.mark.slow),
    ],
)
def test_the_published_turbine_hides_no_absolute_number(task, controller, turbine):
    """Itself, with the numbers of its own controller, and in air and of material half as dense again."""
    turbine, ratio = load_turbine(turbine), 1.5
    first, second = (
        play(gym.make(TASKS[task].id, turbine=t, controller=controller, wind_seeds=(1,), start="steady"))
        for t in (turbine, scaled(turbine, ratio, published=True))
    )
    assert_same(first, second, factor=ratio)
    for name, values in first.signals.items():
        factor = ratio if any(part in name for part in FORCES) else 1.0
        size = np.abs(values).max() + 1e-12
        np.testing.assert_allclose(second.signals[name] / size, factor * values / size, atol=1e-3, err_msg=name)


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


# ---- mirrored ----

LEFT_AND_RIGHT = np.array([1.0, -1.0, 1.0])


def image_of(inflow):
    """The wind that is another one's mirror image at y = 0, of its own numbers and not by reflected points."""
    if isinstance(inflow, SteadyInflow):
        return replace(inflow, veer=-inflow.veer, yaw_misalignment=-inflow.yaw_misalignment)
    if isinstance(inflow, TransientInflow):
        turned = replace(inflow, steady=image_of(inflow.steady), direction_amplitude=-inflow.direction_amplitude)
        # an extreme shear across the wind, which has an amplitude of speed, is on the other side
        return replace(turned, speed_amplitude=-inflow.speed_amplitude) if inflow.kind == "EWS-horizontal" else turned
    if isinstance(inflow, TurbulentInflow):
        fluctuation = np.ascontiguousarray(inflow.box.fluctuation[:, :, ::-1]) * LEFT_AND_RIGHT.astype(np.float32)
        box = replace(inflow.box, fluctuation=fluctuation, y_center=0.0 - inflow.box.y_center)
        return TurbulentInflow(box, image_of(inflow.steady), inflow.time_offset)
    assert isinstance(inflow, TurningInflow)
    return TurningInflow(image_of(inflow.inner), inflow.times, -inflow.directions)


class Mirrored:
    """An agent that sees an environment in the mirror and acts through it."""

    def __init__(self, agent, layout):
        self.agent, self.layout = agent, layout

    def predict(self, observation, deterministic=True):
        seen = observation * self.layout.observation.parity.astype(np.float32)
        action, state = self.agent.predict(seen, deterministic=deterministic)
        return action * self.layout.action.parity, state


class Waves:
    """Actions that are the same each time."""

    def __init__(self, size):
        self.size, self.k = size, 0

    def predict(self, observation, deterministic=True):
        self.k += 1
        return 0.5 * np.sin(0.4 * self.k + 2.0 * np.arange(self.size)), None


class Rest(Waves):
    def predict(self, observation, deterministic=True):
        return np.zeros(self.size), None


def mirrored_envs(name, **arguments):
    """An environment and that of the counter-clockwise turbine."""
    arguments = TASKS[name].arguments | arguments if name in TASKS else arguments
    spec = TASKS[name].id if name in TASKS else name
    turbine = load_turbine(arguments.get("turbine", "nrel_5mw"))
    return tuple(gym.make(spec, **{**arguments, "turbine": t}) for t in (turbine, mirrored(turbine)))


def mirrored_courses(envs, agents, yaw=0.15, lidar=False):
    """Courses of both environments in a wind and its mirror image, by the agents of both.

    What a lidar sees of turbulence is drawn anew for each box, and for the image of a box too: with one it is the same
    box, seen in a mirror.
    """
    envs[0].reset(seed=5)
    inflow, courses = envs[0].unwrapped.episode_wind.inflow, []
    image = MirroredInflow(inflow) if lidar else image_of(inflow)
    points = np.random.default_rng(0).uniform([-200.0, -70.0, 20.0], [200.0, 70.0, 160.0], (100, 3))
    for time in (0.0, 2.0, 5.0):
        seen = inflow.velocity(points * LEFT_AND_RIGHT, time) * LEFT_AND_RIGHT
        np.testing.assert_allclose(image.velocity(points, time), seen, atol=1e-4)
    for env, agent, wind, side in zip(envs, agents, (inflow, image), (1.0, -1.0), strict=True):
        courses.append(play(env, {"inflow": wind, "azimuth": 0.5, "yaw": side * yaw}, agent, steps=STEPS))
    return courses


def assert_mirrored(envs, first, second):
    """Equal rewards and figures; observations and signals with the signs of their parity."""
    layout = envs[1].unwrapped.layout.observation
    assert_same(first, second._replace(observations=second.observations * layout.parity))
    signs = {channel.name: channel.parity for channel in channel_table(envs[0].unwrapped.turbine.n_blades)}
    for name, values in second.signals.items():
        size = np.abs(first.signals[name]).max() + 1e-12
        np.testing.assert_allclose(values / size, signs[name] * first.signals[name] / size, atol=1e-3, err_msg=name)


def slow_but(names, fast):
    """Parameters of which all but some are left to the long checks."""
    return [name if name in fast else pytest.param(name, marks=pytest.mark.slow) for name in names]


@pytest.mark.parametrize("name", slow_but(TASKS, ("LoadReduction", "Gusts", "Yaw")))
def test_a_mirrored_world_is_the_same_task(name):
    wind = {} if TASKS[name].arguments["inflow"] != "turbulent" else {"wind_seeds": (1,)}
    envs = mirrored_envs(name, **wind)
    size = envs[0].action_space.shape[0]
    courses = mirrored_courses(envs, (Waves(size), Mirrored(Waves(size), envs[1].unwrapped.layout)))
    assert_mirrored(envs, *courses)
    assert np.abs(courses[0].signals["tower_top_side_side"]).max() > 0.0


@pytest.mark.parametrize("name", slow_but(OURS, ("tower_dampers", "constrained_ipc", "lidar", "yaw")))
def test_a_mirrored_world_is_the_same_for_every_controller(name):
    """Yaw acts in a wind from the side: the drive turns within the episode."""
    task, controller = ("Yaw", "discon+yaw") if name == "yaw" else ("LoadReduction", name)
    envs = mirrored_envs(task, controller=controller, wind_seeds=(1,))
    lidar = lidar_of(envs[0].unwrapped.controller) is not None
    courses = mirrored_courses(envs, [Rest(env.action_space.shape[0]) for env in envs], lidar=lidar)
    assert_mirrored(envs, *courses)


def test_a_mirrored_world_is_the_same_with_a_variation():
    """Noise and offsets of what has a side are those of the image."""
    envs = mirrored_envs("LoadReduction", controller="constrained_ipc", wind_seeds=(1,), variation=VARIED)
    size = envs[0].action_space.shape[0]
    courses = mirrored_courses(envs, (Waves(size), Mirrored(Waves(size), envs[1].unwrapped.layout)))
    assert_mirrored(envs, *courses)


def test_a_side_side_damper_that_forgot_the_rotation_would_show():
    envs = mirrored_envs("LoadReduction", controller="side_side_damper", wind_seeds=(1,))
    (damper,) = envs[1].unwrapped.controller.additions
    damper.gain *= -1.0
    first, second = mirrored_courses(envs, [Rest(env.action_space.shape[0]) for env in envs])
    torque = first.signals["generator_torque"]
    assert np.abs(second.signals["generator_torque"] - torque).max() > 1e-3 * torque.max()


@pytest.mark.parametrize("folder", slow_but(AGENTS, AGENTS[:1]), ids=lambda path: path.name)
def test_a_mirrored_world_is_the_same_for_every_shipped_agent(folder):
    """Trained on a rotor that turns clockwise, it sees the other one in a mirror of its own."""
    pytest.importorskip("stable_baselines3")
    from wt_gym.experiment.environments import trained_arguments
    from wt_gym.experiment.trained_agent import TrainedAgent

    agents = [TrainedAgent.load(folder) for _ in range(2)]
    arguments = trained_arguments(agents[0].record) | {"wind_seeds": (1,)}
    envs = mirrored_envs("wt_gym/NREL5MW-Turbulent-v1", **arguments)
    for agent, env in zip(agents, envs, strict=True):
        agent.enter(env.unwrapped.layout)
    assert_mirrored(envs, *mirrored_courses(envs, agents, lidar=True))


@pytest.mark.parametrize("pitch", ["collective", "individual", "fixed-frame"])
def test_every_observation_of_a_mirrored_world(pitch):
    """All groups and all single channels, with noise, delay, memory and a lidar, and every component of an action."""
    groups = tuple(name for name in OBSERVATION_GROUPS if name not in ("disturbances", "model_fit"))
    arguments = {
        "action_mode": "residual", "pitch": pitch, "controller": "tsr_tracking", "observation": groups,
        "action_components": ("pitch", "yaw", "torque"), "residual_fade": True, "residual_washout": 20.0, **WIND,
    }  # fmt: skip
    with pytest.raises(ValueError, match=r"observation has .*; must be among") as refusal:
        gym.make("wt_gym/NREL5MW-Turbulent-v1", **(arguments | {"observation": ("nothing",)}))
    families = str(refusal.value).rpartition("channels ")[2].partition(";")[0]
    every = tuple(
        name if not count else f"{name}_{k}"
        for name, count in re.findall(r"(\w+?)(?:_1 … (\d))?(?:, |$)", families)
        for k in range(1, int(count or 1) + 1)
    )
    assert {"rotor_speed", "azimuth_sin", "tip_in_plane_3"} <= {*every}
    arguments |= {"observation": every, "sensor_noise": 1.0, "sensor_delay": 0.2, "history": 2}
    envs = mirrored_envs("wt_gym/NREL5MW-Turbulent-v1", **arguments)
    layout, other = (env.unwrapped.layout.observation for env in envs)
    assert layout.names == other.names
    assert set(every) - set(OBSERVATION_GROUPS) <= set(layout.names)
    np.testing.assert_array_equal(layout.parity, other.parity)
    size = envs[0].action_space.shape[0]
    first, second = mirrored_courses(envs, (Waves(size), Mirrored(Waves(size), envs[1].unwrapped.layout)), lidar=True)
    assert_mirrored(envs, first, second)
    # a channel with the wrong parity shows
    for k, name in enumerate(layout.names):
        if np.abs(first.observations[:, k]).max() > 0.01:
            assert np.abs(second.observations[:, k] + layout.parity[k] * first.observations[:, k]).max() > ROUNDING, (
                name
            )


@pytest.mark.parametrize("sensors", ["agent", "all"])
def test_beams_of_a_lidar_in_a_mirrored_world(sensors):
    """Left and right beams change places, and count in the sense of rotation: each channel sees the same, noise too."""
    envs = mirrored_envs(
        "wt_gym/NREL5MW-Turbulent-v1", action_mode="residual", controller="lidar", observation=("lidar",),
        lidar={"ranges": [63.0, 126.0, 189.0], "apart": True}, sensors=sensors, sensor_noise=1.0, start="steady",
        **WIND,
    )  # fmt: skip
    size = envs[0].action_space.shape[0]
    first, second = mirrored_courses(envs, (Waves(size), Mirrored(Waves(size), envs[1].unwrapped.layout)), lidar=True)
    assert np.abs(first.observations[:, 1] - first.observations[:, 3]).max() > 0.05
    assert_mirrored(envs, first, second)


def test_disturbances_of_a_mirrored_world():
    """What linear optimal pitch knows, and offsets as actions."""
    envs = mirrored_envs(
        "wt_gym/NREL5MW-Turbulent-v1", action_mode="residual", residual_form="offset", pitch="fixed-frame",
        action_components=("pitch",), controller="linear_optimal", control_dt=0.1,
        observation=("disturbances", "model_fit"), **(WIND | {"wind_speed": 16.0}),
    )  # fmt: skip
    size = envs[0].action_space.shape[0]
    first, second = mirrored_courses(envs, (Waves(size), Mirrored(Waves(size), envs[1].unwrapped.layout)))
    assert np.abs(first.observations).max() > 0.5
    assert_mirrored(envs, first, second)


def test_a_twin_and_pictures_of_a_mirrored_world():
    """The controller alone beside the agent, and the environment from the word for its rotation."""
    env = gym.make(
        "wt_gym/NREL5MW-Steady-v1", site={"rotation": "counter-clockwise"}, wind_speed=9.0, action_mode="residual",
        action_components=("pitch",), relative_reward=True, render_mode="rgb_array",
    )  # fmt: skip
    plain = gym.make(
        "wt_gym/NREL5MW-Steady-v1", wind_speed=9.0, action_mode="residual", action_components=("pitch",),
        relative_reward=True, render_mode="rgb_array",
    )  # fmt: skip
    assert env.unwrapped.turbine.rotation == "counter-clockwise"
    pictures = []
    for each in (env, plain):
        each.reset(seed=1)
        rewards = [each.step(each.action_space.high)[1] for _ in range(5)]
        pictures.append(each.render())
        assert each.unwrapped.simulator.mirrored == (each is env)
        if each is env:
            kept = rewards
    np.testing.assert_allclose(rewards, kept, atol=ROUNDING)  # a uniform wind knows no side
    assert np.abs(pictures[0].astype(float) - pictures[1]).max() > 50.0
