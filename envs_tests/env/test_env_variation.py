"""Plants, sensors and winds that differ from episode to episode."""

import math

import gymnasium as gym
import numpy as np
import pytest

from wt_gym.base.errors import ActionError, InflowError
from wt_gym.control.controllers.names import make_controller
from wt_gym.control.sensors import to_fixed_frame
from wt_gym.envs.instruments import DRIFTING
from wt_gym.envs.turbine_env import WindTurbineEnv
from wt_gym.envs.variation import CHOICES, HELD_BACK, PRESETS, STRUCTURAL, TRAIN, Plants, Variation
from wt_gym.turbines import load_turbine
from wt_gym.wind import SteadyInflow

QUICK = {
    "turbine": "nrel_5mw", "inflow": "turbulent", "wind_speed": 15.0, "wind_seeds": (1,), "start": "steady",
    "action_mode": "residual", "pitch": "fixed-frame", "episode_length": 4.0,
}  # fmt: skip
SHEARED = {"variation": {"shear_exponent": 0.1}}
FEW = {**TRAIN.given, "plants": 2}


def make(**arguments):
    return WindTurbineEnv(**QUICK | arguments)


def course(env, seed=5, steps=6, options=None):
    """Observations and rewards of an episode under drawn actions."""
    rng = np.random.default_rng(0)
    observation, info = env.reset(seed=seed, options=options)
    rows = [np.append(observation, 0.0)]
    for _ in range(steps):
        observation, reward, *_ = env.step(rng.uniform(-1.0, 1.0, env.action_space.shape))
        rows.append(np.append(observation, reward))
    return np.array(rows), info


@pytest.fixture(scope="module")
def plain():
    return course(make())


# ---- what is drawn ----


def test_draws_follow_the_seed_and_stay_in_their_ranges():
    env = make(variation=TRAIN)
    drawn = [env.terms["variation"].drawn() for _ in range(300)]
    for name, ends in TRAIN.given.items():
        found = [one.values[name] for one in drawn]
        if name in CHOICES:
            assert set(found) == set(ends)
        elif name == "sensor_offset":
            assert all(set(one) == set(DRIFTING) for one in found)
            flat = [value for one in found for value in one.values()]
            assert ends[0] <= min(flat) < -0.39
            assert 0.39 < max(flat) <= ends[1]
        else:
            width, half_step = ends[1] - ends[0], 0.06 if name == "sensor_delay" else 0.0
            assert ends[0] - half_step <= min(found) <= ends[0] + 0.05 * width
            assert ends[1] - 0.05 * width <= max(found) <= ends[1] + half_step
    env.terms["variation"].seed(7)
    first = [env.terms["variation"].drawn().values for _ in range(3)]
    env.terms["variation"].seed(7)
    assert first == [env.terms["variation"].drawn().values for _ in range(3)]
    assert first[0] != first[1]


def test_every_quantity_has_its_own_draw():
    alone = make(variation={"yaw_error": TRAIN.yaw_error}).reset(seed=3)[1]["variation"]
    among = make(variation=FEW).reset(seed=3)[1]["variation"]
    assert alone == {"yaw_error": among["yaw_error"]}


def test_the_wind_keeps_speed_seed_and_time():
    env = make(variation={"turbulence_class": ("A",), "shear_exponent": 0.0, "yaw_error": 0.2}, wind_speed=(8.0, 20.0))
    same = make(wind_speed=(8.0, 20.0))
    for seed in (1, 2):
        env.reset(seed=seed)
        same.reset(seed=seed)
        mine, theirs = env.episode_wind, same.episode_wind
        assert (mine.wind_speed, mine.time_offset) == (theirs.wind_speed, theirs.time_offset)
    high, low = np.array([[0.0, 0.0, 140.0]]), np.array([[0.0, 0.0, 40.0]])
    times = np.linspace(0.0, 500.0, 400)
    at = {h: np.mean([mine.inflow.velocity(p, t)[0] for t in times], axis=0) for h, p in (("h", high), ("l", low))}
    assert math.atan2(at["h"][1], at["h"][0]) == pytest.approx(0.2, abs=0.03)
    assert np.hypot(*at["h"][:2]) / np.hypot(*at["l"][:2]) < 1.08  # 1.28 with the usual shear


def test_a_class_scales_the_turbulence_of_the_same_box():
    hub = np.array([[0.0, 0.0, 90.0]])

    def speeds(**arguments):
        env = make(**arguments)
        env.reset(seed=4)
        inflow = env.episode_wind.inflow
        return np.array([inflow.velocity(hub, t)[0, 0] for t in np.arange(0.0, 60.0, 0.5)])

    base, varied = speeds(turbulence_class="B"), speeds(variation={"turbulence_class": ("A",)}, turbulence_class="B")
    direct = speeds(turbulence_class="A")
    assert varied == pytest.approx(direct, rel=1e-7)  # boxes are of single precision
    assert (varied - 15.0) / (base - 15.0) == pytest.approx(16.0 / 14.0, rel=1e-6)


# ---- without a variation, and with one that changes nothing ----


@pytest.mark.parametrize(
    "arguments",
    [
        {"variation": {}},
        {"variation": Variation()},
        {"sensors": "all"},
        {"variation": {"pitch_gain": 1.0, "yaw_error": 0.0, "sensor_offset": 0.0, "sensor_delay": 0.0}},
        {"variation": {"dead_sensor": [""], "sensor_noise": 0.0}, "sensors": "agent"},
    ],
    ids=["empty", "object", "all sensors", "neutral", "no dead sensor"],
)
def test_what_changes_nothing_is_the_same_bit_for_bit(arguments, plain):
    rows, info = plain
    found, _ = course(make(**arguments))
    assert np.array_equal(found, rows)
    assert "variation" not in info


def test_the_nominal_plant_among_the_set_runs_as_the_turbine_does(plain):
    found, info = course(make(variation={"tower_frequency": 1.0, "drive_lag": 0.0}))
    assert info["variation"] == {"plant": 0, "tower_frequency": 1.0, "drive_lag": 0.0}
    assert np.array_equal(found, plain[0])


# ---- JSON, presets ----


@pytest.mark.parametrize("name", PRESETS)
def test_variations_have_a_form_in_json(name):
    variation = PRESETS[name]
    assert Variation.from_json(variation.to_json()) == variation
    assert make(variation=name).options.variation == make(variation=variation.as_dict()).options.variation == variation
    spec = gym.make("wt_gym/LoadReduction-v3", variation=variation).spec
    assert gym.make(type(spec).from_json(spec.to_json())).unwrapped.options.variation == variation


def test_what_is_held_back_is_no_part_of_the_training():
    assert set(HELD_BACK.given) == set(TRAIN.given)
    for name in TRAIN.given:
        train, test = getattr(TRAIN, name), getattr(HELD_BACK, name)
        if name in CHOICES:
            assert not set(train) & set(test)
        else:
            assert test[0] >= train[1] or test[1] <= train[0], name
    turbine = load_turbine("nrel_5mw")
    for name in STRUCTURAL:
        shared = {p[name] for p in Plants(turbine, TRAIN).values} & {p[name] for p in Plants(turbine, HELD_BACK).values}
        assert len(shared) <= 1, name  # the end that both have


# ---- plants ----


def test_the_set_of_plants_is_a_latin_hypercube_and_each_is_made_once():
    turbine = load_turbine("nrel_5mw")
    plants = Plants(turbine, Variation(tower_frequency=(0.9, 1.1), blade_stiffness=(0.8, 1.2), plants=5))
    levels = {"tower_frequency": (0.9, 0.95, 1.0, 1.05, 1.1), "blade_stiffness": (0.8, 0.9, 1.0, 1.1, 1.2)}
    for name, of_name in levels.items():
        assert sorted(row[name] for row in plants.values) == pytest.approx(of_name)
    assert [row["tower_frequency"] for row in plants.values] == [
        row["tower_frequency"] for row in Plants(turbine, Variation(tower_frequency=(0.9, 1.1), plants=5)).values
    ]
    assert plants.turbine(3) is plants.turbine(3)
    ratio = plants.turbine(3).tower.structure.stiffness[:, 4, 4] / turbine.tower.structure.stiffness[:, 4, 4]
    assert ratio == pytest.approx(plants.values[3]["tower_frequency"] ** 2)
    assert len(Plants(turbine, Variation(air_density=0.9))) == 1


def test_simulators_are_made_once_a_plant():
    env, made = make(variation={"tower_frequency": (0.9, 1.1), "plants": 3}), []
    maker = env.operation.make_simulator
    env.operation.make_simulator = lambda *given: made.append(given[0]) or maker(*given)
    env.reset(seed=0)
    seen = {env.reset()[1]["variation"]["plant"] for _ in range(12)}
    assert seen == {0, 1, 2}
    assert len(made) == 3
    assert len({turbine.tower.structure.stiffness[0, 4, 4] for turbine in made}) == 3
    env.close()
    assert env.simulator is None


def test_the_base_controller_and_the_scales_are_those_of_the_nominal_turbine():
    env, plain = make(variation={"air_density": 0.85, "pitch_rate": 0.5}), make()
    env.reset(seed=1)
    assert env.simulator.turbine.air_density == pytest.approx(0.85 * env.turbine.air_density)
    assert env.simulator.turbine.pitch.max_rate == pytest.approx(0.5 * env.turbine.pitch.max_rate)
    assert env.controller.parameters == make_controller("discon", plain.turbine).parameters
    assert np.array_equal(env.observation_space.low, plain.observation_space.low)


# ---- response to pitch ----


def test_pitch_gain_multiplies_the_response_of_the_loads():
    """In steady wind, a small step of tilt: the flapwise tilt moment changes by the gain."""

    def response(gain):
        env = make(
            inflow="steady", wind_speed=16.0, shear_exponent=0.0, variation={"pitch_gain": gain}, episode_length=20.0,
            action_components=("pitch",),
        )  # fmt: skip
        still, moved = (tilt_moment(env, tilt) for tilt in (0.0, 1.0))
        return moved - still

    def tilt_moment(env, tilt):
        env.reset(seed=0, options={"azimuth": 0.0})
        moments = []
        for k in range(60):
            env.step(np.where(env.action_names == "pitch_tilt_offset_rate", tilt * (k == 0), 0.0))
            moments.append(to_fixed_frame(env.signals["root_flap_moment"], env.signals["azimuth"])[1])
        return np.mean(moments[20:])

    one = response(1.0)
    assert abs(one) > 1e4
    assert response(1.25) / one == pytest.approx(1.25, rel=0.03)
    assert response(0.75) / one == pytest.approx(0.75, rel=0.03)


def test_encoders_read_the_scale_of_the_demand():
    env = make(variation={"pitch_gain": 1.25}, observation=("pitch",), pitch="individual", episode_length=20.0)
    env.reset(seed=2)
    for _ in range(10):
        env.step(np.where(env.action_names == env.action_names[0], 0.3, 0.0))
    demand, true, read = (
        p - p.mean() for p in (env.demand.pitch, env.signals["pitch"], env.operation.readings()["pitch"])
    )
    assert true == pytest.approx(1.25 * demand, rel=0.1, abs=1e-3)
    assert read == pytest.approx(demand, rel=0.1, abs=1e-3)
    assert np.abs(demand).max() > 0.01


# ---- sensors ----


class Notes:
    """A controller that keeps what it has read."""

    channels = ("rotor_speed", "root_flap_moment", "yaw_error", "wind_x")

    def __init__(self, turbine):
        self._base, self.read = make_controller("discon", turbine), []

    def start(self, readings, demand):
        self.read = [{name: np.copy(readings[name]) for name in self.channels}]
        self._base.start(readings, demand)

    def step(self, readings, dt):
        self.read.append({name: np.copy(readings[name]) for name in self.channels})
        return self._base.step(readings, dt)


@pytest.mark.parametrize("sensors", ["agent", "all"])
def test_who_reads_the_instruments(sensors):
    variation = {"sensor_offset": 0.4, "sensor_noise": 1.0}
    env = make(
        variation=variation, sensors=sensors, controller=Notes, control_dt=0.1, observation=("root_flap_moment_1",)
    )
    env.reset(seed=1)
    seen, truth = [], []
    for k in range(6):
        if k:
            env.step(np.zeros(env.action_space.shape))
        seen.append(env.operation.readings()["root_flap_moment"].copy())
        truth.append(env.signals["root_flap_moment"].copy())
    by_controller = [row["root_flap_moment"] for row in env.controller.read]
    assert all(np.abs(s - t).min() > 0.0 for s, t in zip(seen, truth, strict=True))
    # the reading at the start is read by `start` and by the first step
    expected = seen if sensors == "all" else truth
    assert np.array_equal(by_controller[0], expected[0])
    assert np.array_equal(by_controller[1:], expected[:-1])


def test_offsets_are_in_scales_and_shared_by_the_blades():
    env = make(variation={"sensor_offset": 0.4})
    env.reset(seed=1)
    read, true = env.operation.readings(), env.signals
    shift = read["root_flap_moment"] - true["root_flap_moment"]
    channel = next(c for c in make(observation=("root_flap_moment_mean",)).layout.observation.channels)
    assert shift == pytest.approx(0.4 * channel.scale)
    assert read["wind_x"] - true["wind_x"] == pytest.approx(1.6, rel=0.01)
    assert read["rotor_speed"] == true["rotor_speed"]
    assert read["generator_power"] == true["generator_power"]


def test_delay_makes_all_readings_late_together():
    env = make(variation={"sensor_delay": 0.3}, control_dt=0.1, lidar={"ranges": [60.0]}, observation=("lidar",))
    env.reset(seed=1)
    truth, looks = [env.signals], [env.operation.seen()]
    for _ in range(8):
        env.step(np.zeros(env.action_space.shape))
        truth.append(env.signals)
        looks.append(env.operation.seen())
        read, late = env.operation.readings(), truth[max(len(truth) - 4, 0)]
        for name in ("azimuth", "rotor_speed", "root_flap_moment_1", "yaw_error"):
            assert read[name] == late[name]
        assert read["time"] == truth[-1]["time"]
    exact = make(control_dt=0.1, lidar={"ranges": [60.0]}, observation=("lidar",))
    exact.reset(seed=1)
    assert looks[:4] == [looks[0]] * 4
    assert looks[0] == pytest.approx(exact.operation.seen())
    assert not np.array_equal(looks[4], looks[3])


def test_noise_of_options_reaches_the_controller_where_all_read_the_sensors():
    base = make(observation=("rotor_speed",), control_dt=0.1, controller=Notes)
    noisy = make(observation=("rotor_speed",), control_dt=0.1, controller=Notes, sensor_noise=1.0, sensors="all")
    agents = make(observation=("rotor_speed",), control_dt=0.1, controller=Notes, sensor_noise=1.0)
    for env in (base, noisy, agents):
        env.reset(seed=1)
        for _ in range(3):
            env.step(np.zeros(env.action_space.shape))
    first = [float(env.controller.read[0]["rotor_speed"]) for env in (base, noisy, agents)]
    assert first[0] == first[2] != first[1]
    assert first[1] == pytest.approx(first[0], abs=0.01)


def test_the_noise_of_instruments_has_its_level():
    env = make(variation={"sensor_noise": 2.0}, observation=("root_flap_moment_1", "rotor_speed"))
    env.reset(seed=1)
    instruments, true = env.operation.instruments, env.signals
    reads = np.array([instruments.take(true).values - true.values for _ in range(4000)])
    index = {name: k for k, name in enumerate(true)}
    for channel in env.layout.observation.channels:
        assert reads[:, index[channel.name]].std() == pytest.approx(2.0 * channel.noise, rel=0.05)
        assert abs(reads[:, index[channel.name]].mean()) < 0.15 * channel.noise
    assert reads[:, index["wind_x"]].std() == pytest.approx(0.4, rel=0.06)
    assert reads[:, index["aero_thrust"]].std() == 0.0


def test_a_dead_sensor_reads_zero_for_everyone():
    env = make(variation={"dead_sensor": ["root_flap_moment_1"]}, controller=Notes, control_dt=0.1)
    env.reset(seed=1)
    env.step(np.zeros(env.action_space.shape))
    assert [row["root_flap_moment"][0] for row in env.controller.read] == [0.0, 0.0]
    assert env.operation.readings()["root_flap_moment_1"] == 0.0
    assert env.operation.readings()["root_flap_moment_2"] == env.signals["root_flap_moment_2"]
    with pytest.raises(ActionError, match="channels of a sensor fault must be among"):
        make(variation={"dead_sensor": ["root_flap"]})


# ---- the contract ----


@pytest.mark.parametrize(
    ("arguments", "error", "message"),
    [
        ({"variation": "training"}, ValueError, "variation must be a Variation, a mapping or one of train, held_back"),
        ({"sensors": "all", "sensor_delay": 0.05}, ValueError, "sensor_delay must be a multiple"),
        ({"inflow": SteadyInflow(9.0), "wind_speed": None} | SHEARED, InflowError, "vary_shear_exponent must be left"),
        ({"roughness_length": 0.03} | SHEARED, InflowError, "vary_shear_exponent and roughness_length exclude each"),
    ],
)
def test_wrong_arguments_are_refused(arguments, error, message):
    with pytest.raises(error, match=message):
        make(**arguments)
