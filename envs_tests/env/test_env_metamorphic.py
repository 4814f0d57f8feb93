"""Episodes that physics cannot tell apart, turned, moved, scaled, renamed or mirrored, are equal to rounding.

The wake is kept in single precision and observations are float32.
"""

import math
import re
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import gymnasium as gym
import numpy as np
import pytest

from wt_gym.analysis.metrics import METRICS, run_metrics
from wt_gym.base.files import shipped_folder
from wt_gym.base.quantities import AIR_DENSITY
from wt_gym.control.controllers import COMPILED, CONTROLLERS, lidar_of
from wt_gym.envs.channels import OBSERVATION_GROUPS
from wt_gym.experiment.environments import trained_arguments
from wt_gym.experiment.trained_agent import TrainedAgent
from wt_gym.simulation import Recorder, channel_table
from wt_gym.tasks import TASKS
from wt_gym.turbines import load_turbine
from wt_gym.turbines.variants import mirrored
from wt_gym.wind.iec import TransientInflow
from wt_gym.wind.inflow import MirroredInflow, PointInflow, TurningInflow
from wt_gym.wind.steady import SteadyInflow
from wt_gym.wind.turbulence_box import TurbulenceBox
from wt_gym.wind.turbulent import PathInflow, TurbulentInflow

AGENTS = sorted(path.parent for path in (shipped_folder() / "trained").glob("*/model.zip"))
STEPS = 25
ROUNDING = 2e-4
"""Of observations, whose scale is about 1: float32 of a value of 10 rounds by 1e-6, and the difference grows."""
FORCES = ("moment", "torsion", "torque", "power", "thrust")
"""Parts of the names of signals and of metrics that are forces, moments or powers."""
TURBULENT = "wt_gym/NREL5MW-Turbulent-v1"
WIND = {"wind_speed": 13.0, "wind_seeds": (1,)}
OWN = {"observation": ("measurable",), "sensor_washout": 20.0, "action_spans": None, "reward_credit": False}
"""Of an environment whose base controller has no observer."""


class Course(NamedTuple):
    """Observations, rewards, figures of merit and signals of an episode."""

    observations: np.ndarray
    rewards: np.ndarray
    metrics: dict
    signals: dict


class Waves:
    """Actions that are the same each time; `order` permutes their components."""

    def __init__(self, size, order=None, amplitude=0.5):
        self.components, self.amplitude, self.k = np.arange(size)[order or slice(None)], amplitude, 0

    def predict(self, observation, deterministic=True):
        self.k += 1
        return self.amplitude * np.sin(0.4 * self.k + 2.0 * self.components), None


class Mirrored:
    """An agent that sees an environment in the mirror and acts through it."""

    def __init__(self, agent, layout):
        self.agent, self.layout = agent, layout

    def predict(self, observation, deterministic=True):
        seen = observation * self.layout.observation.parity.astype(np.float32)
        action, state = self.agent.predict(seen, deterministic=deterministic)
        return action * self.layout.action.parity, state


def play(env, options=None, agent=None):
    """Course of an episode of an agent."""
    bare, agent = env.unwrapped, agent or Waves(env.action_space.shape[0])
    observation, _ = env.reset(seed=5, options=options)
    recorder = Recorder(bare.simulator)
    recorder.append(bare.signals)
    observations, rewards = [observation], []
    for _ in range(STEPS):
        action, _ = agent.predict(observation, deterministic=True)
        observation, reward, terminated, _, _ = env.step(np.asarray(action, np.float32))
        assert not terminated
        observations.append(observation)
        rewards.append(reward)
        recorder.append(bare.signals)
    run = recorder.to_dataset()
    signals = {name: run[name].values for name in run.data_vars}
    return Course(np.array(observations), np.array(rewards), run_metrics(run, bare.turbine), signals)


def assert_same(first, second, factor=1.0, rounding=ROUNDING):
    """Equal courses; figures of merit that are forces, moments or powers are ``factor`` times as large."""
    np.testing.assert_allclose(second.observations, first.observations, atol=rounding)
    np.testing.assert_allclose(second.rewards, first.rewards, atol=rounding)
    assert second.rewards.sum() == pytest.approx(first.rewards.sum(), abs=rounding)
    for name, value in first.metrics.items():
        scaled = factor if METRICS[name].unit.split()[0] in ("MW", "MWh", "MN", "kN") else 1.0
        size = 1e-3 / METRICS[name].factor  # a thousandth of the unit that is shown
        assert second.metrics[name] == pytest.approx(scaled * value, rel=rounding / 2.0, abs=size), name


def assert_same_signals(first, second, factor=lambda name: 1.0):
    """Equal signals, each times a factor that its name decides."""
    for name, values in first.items():
        size = np.abs(values).max() + 1e-12
        np.testing.assert_allclose(second[name] / size, factor(name) * values / size, atol=1e-3, err_msg=name)


# ---- turned and mirrored ----

VARIED = {
    "pitch_gain": 1.2, "tower_frequency": 0.93, "blade_stiffness": 0.9, "air_density": 0.95, "drive_lag": 0.2,
    "sensor_delay": 0.1, "sensor_offset": (-0.4, 0.4), "sensor_noise": 1.0,
}  # fmt: skip
"""Variation without a side."""


class Case(NamedTuple):
    """An environment, the folder of an agent in it, and the amplitude of the actions without one."""

    id: str
    arguments: dict
    folder: Path | None = None
    amplitude: float = 0.5

    def envs(self, *turbines):
        """The environment, or one for each turbine."""
        given = [{"turbine": turbine} for turbine in turbines] or [{}]
        return [gym.make(self.id, **self.arguments | one) for one in given]

    def agent(self, env):
        """The agent, which acts in the mirror on a rotor that turns counter-clockwise."""
        size, layout = env.action_space.shape[0], env.unwrapped.layout
        if self.folder is None:
            waves = Waves(size, amplitude=self.amplitude)
            return Mirrored(waves, layout) if env.unwrapped.turbine.rotation == "counter-clockwise" else waves
        agent = TrainedAgent.load(self.folder)
        agent.enter(layout)
        return agent


def case_of(name):
    """Case of a task, a controller that runs alone, a shipped agent, or a variation of the plant."""
    seed = {"wind_seeds": (1,)}
    if name in TASKS:
        return Case(TASKS[name].id, seed if TASKS[name].arguments["inflow"] == "turbulent" else {})
    if name in CONTROLLERS:  # yaw acts in a wind from the side: the drive turns within the episode
        task, controller = ("Yaw", "discon+yaw") if name == "yaw" else ("LoadReduction", name)
        return Case(TASKS[task].id, seed | OWN | {"controller": controller}, amplitude=0.0)
    if name == "variation":
        return Case(TASKS["LoadReduction"].id, seed | OWN | {"variation": VARIED, "controller": "constrained_ipc"})
    folder = shipped_folder() / "trained" / name
    return Case(TURBULENT, trained_arguments(TrainedAgent.load(folder).record) | seed, folder)


# libraries get their readings in single precision
NAMES = [*TASKS, *(name for name in CONTROLLERS if name not in COMPILED), *(path.name for path in AGENTS), "variation"]
TURNED = {
    *(name for name in TASKS if not name.startswith(("IEA", "Dial"))), *(path.name for path in AGENTS),
    "ipc", "tower_dampers", "lidar", "linear_optimal", "yaw", "variation",
}  # fmt: skip
"""Cases of the suite, the others are slow: controllers that read a direction each in their own way."""
MIRRORED = {
    "LoadReduction", "Gusts", "Yaw", "FullOperation", "tower_dampers", "constrained_ipc", "lidar", "yaw", "variation",
    AGENTS[0].name,
}  # fmt: skip


def slow_without(fast):
    """Names of the cases, of which all but some are left to the long checks."""
    return [name if name in fast else pytest.param(name, marks=pytest.mark.slow) for name in NAMES]


def assert_turned_with_the_hull(env):
    """Equal courses where wind and waves turn by 120°, like the columns and lines of the hull.

    Its sensors do not turn, so actions do not follow them; nor does damping by |v| v along its axes, left out here.
    """
    env.reset(seed=5)
    sea, hull, courses = env.unwrapped.simulator.sea, "platform", []
    for turn in np.radians([0.0, 120.0]):
        course = play(env, {"yaw": turn, "sea": replace(sea, direction=sea.direction + turn)})
        seen = course.observations[:, [hull not in name for name in env.unwrapped.observation_names]]
        metrics = {name: value for name, value in course.metrics.items() if hull not in name}
        courses.append(course._replace(observations=seen, metrics=metrics))
    assert_same(*courses, rounding=0.015)
    for x, y in (("surge", "sway"), ("roll", "pitch"), ("surge_acceleration", "sway_acceleration")):
        first, second = (run.signals[f"{hull}_{x}"] + 1j * run.signals[f"{hull}_{y}"] for run in courses)
        np.testing.assert_allclose(second, first * np.exp(1j * turn), atol=0.01 * np.abs(first).max())


@pytest.mark.parametrize("name", slow_without(TURNED))
def test_a_turned_world_is_the_same(name):
    case = case_of(name)
    (env,) = case.envs()
    if (floater := env.unwrapped.turbine.floater) is not None:
        undamped = replace(floater, quadratic_damping=np.zeros((6, 6)))
        assert_turned_with_the_hull(*case.envs(replace(env.unwrapped.turbine, floater=undamped)))
        return
    assert_same(*(play(env, {"yaw": math.radians(angle)}, case.agent(env)) for angle in (0.0, 237.0)))


def test_what_is_named_after_a_global_axis_turns_and_the_rest_does_not():
    (env,) = case_of("LoadReduction").envs()
    first, turned = (play(env, {"yaw": math.radians(angle)}) for angle in (0.0, 90.0))
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


LEFT_AND_RIGHT = np.array([1.0, -1.0, 1.0])


def image_of(inflow):
    """Mirror image at y = 0 of a wind or a box, of its own numbers and not by reflected points."""
    if isinstance(inflow, SteadyInflow):
        return replace(inflow, veer=-inflow.veer, yaw_misalignment=-inflow.yaw_misalignment)
    if isinstance(inflow, TransientInflow):
        turned = replace(inflow, steady=image_of(inflow.steady), direction_amplitude=-inflow.direction_amplitude)
        # an extreme shear across the wind, which has an amplitude of speed, is on the other side
        return replace(turned, speed_amplitude=-inflow.speed_amplitude) if inflow.kind == "EWS-horizontal" else turned
    if isinstance(inflow, TurbulenceBox):
        fluctuation = np.ascontiguousarray(inflow.fluctuation[:, :, ::-1]) * LEFT_AND_RIGHT.astype(np.float32)
        return replace(inflow, fluctuation=fluctuation, y_center=0.0 - inflow.y_center)
    if isinstance(inflow, TurbulentInflow):
        return TurbulentInflow(image_of(inflow.box), image_of(inflow.steady), inflow.time_offset)
    if isinstance(inflow, PathInflow):
        return replace(inflow, profile=image_of(inflow.profile), box=image_of(inflow.box))
    if isinstance(inflow, TurningInflow):
        return TurningInflow(image_of(inflow.inner), inflow.times, -inflow.directions)
    return MirroredInflow.of(inflow)


def mirrored_courses(case, yaw=0.15):
    """Environments of a case with a turbine and its mirror image, and their courses in a wind and its image.

    The evolution of turbulence ahead of a lidar is drawn for each box, also for the image of a box: with a lidar both
    see the same box, one of them in a mirror.
    """
    turbine = load_turbine(case.arguments.get("turbine", gym.spec(case.id).kwargs.get("turbine", "nrel_5mw")))
    envs = case.envs(turbine, mirrored(turbine))
    bare = envs[0].unwrapped
    bare.reset(seed=5)
    inflow, courses = bare.episode_wind.inflow, []
    has_lidar = lidar_of(bare.controller) is not None or any("lidar" in name for name in bare.observation_names)
    image = MirroredInflow(inflow) if has_lidar else image_of(inflow)
    points = np.random.default_rng(0).uniform([-200.0, -70.0, 20.0], [200.0, 70.0, 160.0], (100, 3))
    for time in (0.0, 2.0, 5.0):
        seen = inflow.velocity(points * LEFT_AND_RIGHT, time) * LEFT_AND_RIGHT
        np.testing.assert_allclose(image.velocity(points, time), seen, atol=1e-4)
    for env, wind, side in zip(envs, (inflow, image), (1.0, -1.0), strict=True):
        courses.append(play(env, {"inflow": wind, "azimuth": 0.5, "yaw": side * yaw}, case.agent(env)))
    return envs, *courses


def assert_mirrored(envs, first, second):
    """Equal rewards and figures; observations and signals with the signs of their parity."""
    layout = envs[1].unwrapped.layout.observation
    assert_same(first, second._replace(observations=second.observations * layout.parity))
    signs = {channel.name: channel.parity for channel in channel_table(envs[0].unwrapped.turbine.n_blades)}
    assert_same_signals(first.signals, second.signals, signs.__getitem__)


@pytest.mark.parametrize("name", slow_without(MIRRORED))
def test_a_mirrored_world_is_the_same(name):
    envs, first, second = mirrored_courses(case_of(name))
    assert_mirrored(envs, first, second)
    assert np.abs(first.signals["tower_top_side_side"]).max() > 0.0


@pytest.mark.parametrize("pitch", ["collective", "individual", "fixed-frame"])
def test_every_observation_of_a_mirrored_world(pitch):
    """All groups and all single channels, with noise, delay, memory and a lidar, and every component of an action."""
    absent = "disturbances", "model_fit", "platform", "platform_position", "wave"
    groups = tuple(name for name in OBSERVATION_GROUPS if name not in absent)
    arguments = {
        "action_mode": "residual", "pitch": pitch, "controller": "tsr_tracking", "observation": groups,
        "action_components": ("pitch", "yaw", "torque"), "residual_fade": True, "residual_washout": 20.0, **WIND,
    }  # fmt: skip
    with pytest.raises(ValueError, match=r"observation has .*; must be among") as refusal:
        gym.make(TURBULENT, **(arguments | {"observation": ("nothing",)}))
    families = str(refusal.value).rpartition("channels ")[2].partition(";")[0]
    every = tuple(
        name if not count else f"{name}_{k}"
        for name, count in re.findall(r"(\w+?)(?:_1 … (\d))?(?:, |$)", families)
        for k in range(1, int(count or 1) + 1)
    )
    assert {"rotor_speed", "azimuth_sin", "tip_in_plane_3"} <= {*every}
    arguments |= {"observation": every, "sensor_noise": 1.0, "sensor_delay": 0.2, "history": 2}
    envs, first, second = mirrored_courses(Case(TURBULENT, arguments))
    layout, other = (env.unwrapped.layout.observation for env in envs)
    assert layout.names == other.names
    np.testing.assert_array_equal(layout.parity, other.parity)
    assert_mirrored(envs, first, second)


@pytest.mark.parametrize("sensors", ["agent", "all"])
def test_beams_of_a_lidar_in_a_mirrored_world(sensors):
    """Left and right beams change places, and count in the sense of rotation: each channel sees the same, noise too."""
    arguments = {
        "action_mode": "residual", "controller": "lidar", "observation": ("lidar",), "sensors": sensors,
        "lidar": {"ranges": [63.0, 126.0, 189.0], "apart": True}, "sensor_noise": 1.0, "start": "steady", **WIND,
    }  # fmt: skip
    envs, first, second = mirrored_courses(Case(TURBULENT, arguments))
    assert np.abs(first.observations[:, 1] - first.observations[:, 3]).max() > 0.05
    assert_mirrored(envs, first, second)


def test_disturbances_of_a_mirrored_world():
    """Disturbances that linear optimal pitch knows, and offsets as actions."""
    arguments = {
        "action_mode": "residual", "residual_form": "offset", "pitch": "fixed-frame", "action_components": ("pitch",),
        "controller": "linear_optimal", "control_dt": 0.1, "observation": ("disturbances", "model_fit"),
        "wind_speed": 16.0, "wind_seeds": (1,),
    }  # fmt: skip
    envs, first, second = mirrored_courses(Case(TURBULENT, arguments))
    assert np.abs(first.observations).max() > 0.5
    assert_mirrored(envs, first, second)


def test_a_twin_and_pictures_of_a_mirrored_world():
    """The controller alone beside the agent; a uniform wind has no side, a picture has."""
    rewards, pictures = [], []
    for site in ({"rotation": "counter-clockwise"}, {}):
        env = gym.make(
            "wt_gym/NREL5MW-Steady-v1", site=site, wind_speed=9.0, action_mode="residual", relative_reward=True,
            action_components=("pitch",), render_mode="rgb_array",
        )  # fmt: skip
        env.reset(seed=1)
        rewards.append([env.step(env.action_space.high)[1] for _ in range(5)])
        pictures.append(env.render())
        assert env.unwrapped.simulator.mirrored == bool(site)
    np.testing.assert_allclose(*rewards, atol=ROUNDING)
    assert np.abs(pictures[0].astype(float) - pictures[1]).max() > 50.0


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


@pytest.fixture(scope="module")
def turbulence():
    """An environment and the turbulent inflow of its episode."""
    (env,) = case_of("LoadReduction").envs()
    env.reset(seed=5)
    return env, env.unwrapped.episode_wind.inflow


def test_frozen_turbulence_carries_an_episode_along(turbulence):
    env, inflow = turbulence
    later = 40.0
    moved = Moved(inflow, later * inflow.mean_speed, later)
    assert_same(play(env, {"inflow": inflow}), play(env, {"inflow": moved}))


def test_a_shifted_time_is_the_same_episode(turbulence):
    """The box starts later, and the episode as much later in it; or a period of it later."""
    env, inflow = turbulence
    box, samples = inflow.box, 997
    rolled = replace(box, fluctuation=np.roll(box.fluctuation, samples, axis=0))
    shifted = TurbulentInflow(rolled, inflow.steady, inflow.time_offset + samples * box.time_step)
    first = play(env, {"inflow": inflow})
    assert_same(first, play(env, {"inflow": shifted}))
    assert_same(first, play(env, {"inflow": TurbulentInflow(box, inflow.steady, inflow.time_offset + box.duration)}))


def test_a_shifted_place_across_the_wind_is_the_same_episode(turbulence):
    """A grid of more columns, of which the rotor meets the same."""
    env, inflow = turbulence
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
    ("task", "controller", "turbine", "published"),
    [
        ("LoadReduction", "ipc+tower_dampers", "nrel_5mw", False),
        ("MaxPower", "discon", "nrel_5mw", False),
        ("LoadReduction", "discon", "nrel_5mw", True),
        ("FullRange", "retuned", "nrel_5mw", True),
        pytest.param("LoadReduction", "tuned", "nrel_5mw", True, marks=pytest.mark.slow),
        pytest.param("LoadReduction", "tsr_tracking+yaw", "nrel_5mw", True, marks=pytest.mark.slow),
        pytest.param("MaxPower", "discon", "nrel_5mw", True, marks=pytest.mark.slow),
        pytest.param("LoadReduction", "discon", "nrel_5mw_monopile", True, marks=pytest.mark.slow),
        pytest.param("LoadReduction", "discon", "iea_15mw", True, marks=pytest.mark.slow),
        pytest.param("FullRange", "discon", "iea_22mw", True, marks=pytest.mark.slow),
    ],
)
def test_density_mass_and_stiffness_scaled_alike_change_no_motion(task, controller, turbine, published):
    """Every term of the equations of motion is a force: all of them times a ratio, it is the same motion."""
    turbine, ratio, arguments = load_turbine(turbine), 1.5, OWN | {"controller": controller, "start": "steady"}
    turbines = (turbine if published else scaled(turbine, 1.0), scaled(turbine, ratio, published))
    first, second = (play(gym.make(TASKS[task].id, turbine=one, wind_seeds=(1,), **arguments)) for one in turbines)
    assert_same(first, second, factor=ratio)
    factor = {name: ratio if any(part in name for part in FORCES) else 1.0 for name in first.signals}
    assert_same_signals(first.signals, second.signals, factor.__getitem__)


# ---- blades renamed ----


def renamed(name, n_blades=3):
    """What a signal of a blade is called when each blade takes the name of the one behind it."""
    stem, _, number = name.rpartition("_")
    return f"{stem}_{int(number) % n_blades + 1}" if number in ("1", "2", "3") else name


@pytest.mark.parametrize(
    ("mode", "controller"), [("individual", "constrained_ipc"), ("fixed-frame", "ipc_2p"), ("collective", "discon")]
)
def test_blades_have_no_rank(mode, controller):
    """Blade 1 starts where blade 2 did, with its actions: everything is the same under other names."""
    env = gym.make(
        TURBULENT, action_mode="residual", pitch=mode, controller=controller, **WIND,
        action_components=("pitch",), observation=("rotor", "pitch", "blades", "fixed_frame", "tower"),
    )  # fmt: skip
    first = play(env, {"azimuth": 0.5})
    order = [1, 2, 0] if mode == "individual" else None
    waves = Waves(env.action_space.shape[0], order)
    second = play(env, {"azimuth": 0.5 + 2.0 * math.pi / 3.0}, waves)
    names = [channel.name for channel in env.unwrapped.layout.observation.channels]
    places = [names.index(renamed(name)) for name in names]
    assert_same(first._replace(observations=first.observations[:, places]), second)
    turned = {name: first.signals[renamed(name)] for name in second.signals}
    turned["azimuth"] = (turned["azimuth"] + 2.0 * math.pi / 3.0) % (2.0 * math.pi)
    assert_same_signals(turned, second.signals)
