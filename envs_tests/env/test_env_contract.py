"""The environment keeps the contract of Gymnasium and stable-baselines3, on the real simulator."""

import subprocess
import sys
import warnings

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.error import ResetNeeded
from gymnasium.utils.env_checker import check_env
from stable_baselines3.common.env_checker import check_env as sb3_check_env
from stable_baselines3.common.vec_env import DummyVecEnv
from turbine_contract import both_checkers_are_content, random_episode, snapshot_repeats

import wt_gym  # noqa: F401 - registers the environments
from wt_gym.base.errors import ActionError, InflowError, SimulationError

IDS = ("wt_gym/NREL5MW-Steady-v1", "wt_gym/NREL5MW-Turbulent-v1")


@pytest.fixture(scope="module")
def env():
    env = gym.make("wt_gym/NREL5MW-Turbulent-v1", wind_speed=13.0)
    yield env
    env.close()


def rollout(env, actions, seed, **options):
    """Observations, rewards and infos of an episode; stops where it ends."""
    observation, info = env.reset(seed=seed, options=options or None)
    observations, rewards, infos = [observation], [], [info]
    for action in actions:
        observation, reward, terminated, truncated, info = env.step(action)
        observations.append(observation)
        rewards.append(reward)
        infos.append(info)
        if terminated or truncated:
            break
    return np.array(observations), np.array(rewards), infos


@pytest.mark.parametrize("env_id", IDS)
def test_gymnasium_checker_has_nothing_to_say(env_id):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env(gym.make(env_id, render_mode="rgb_array").unwrapped)


@pytest.mark.parametrize("env_id", IDS)
@pytest.mark.parametrize("kwargs", [{}, {"action_mode": "absolute", "pitch": "individual"}])
def test_stable_baselines_checker_has_nothing_to_say(env_id, kwargs):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        sb3_check_env(gym.make(env_id, **kwargs))


def test_blades_that_twist_keep_the_contract():
    both_checkers_are_content("wt_gym/IEA15MW-Steady-v2")
    env = gym.make("wt_gym/IEA15MW-Steady-v2", max_episode_steps=100)
    snapshot_repeats(env.unwrapped)
    assert random_episode(env)


def test_blades_that_twist_in_fine_steps():
    """IEA 15-MW at "engineering-torsion": its tips turn by degrees towards feather."""
    env = gym.make("wt_gym/IEA15MW-Turbulent-v2", fidelity="engineering-torsion", wind_speed=9.0)
    observations, rewards, _ = rollout(env, np.zeros((10, 3), dtype=np.float32), seed=1)
    assert np.isfinite(observations).all()
    assert np.isfinite(rewards).all()
    simulator = env.unwrapped.simulator
    structure, state = simulator.structure, simulator.coupling.integrator.state
    for number, blade in enumerate(structure.blades, 1):
        body, (coordinates, rates) = structure.system.bodies[blade], structure.elastic(blade, state)
        twist = np.degrees(body.markers["tip"].rotation[2] @ coordinates)
        assert -8.0 < twist < -1.0  # about minus z, as pitch feathers; 1e-16 in modes that only bend
        torsion = body.coordinate_names.index(f"blade_{number}_torsion_1")
        assert abs(coordinates[torsion]) > 0.1
        assert rates[torsion] != 0.0


def test_bounds_are_finite_and_kept(env):
    space = env.observation_space
    assert np.isfinite(space.low).all()
    assert np.isfinite(space.high).all()
    rng = np.random.default_rng(0)
    observations, _, _ = rollout(env, rng.uniform(-1, 1, (40, 3)).astype(np.float32), seed=3)
    assert all(space.contains(observation) for observation in observations)


def test_same_seed_same_bits():
    rng = np.random.default_rng(1)
    actions = rng.uniform(-1, 1, (30, 3)).astype(np.float32)
    runs = [rollout(gym.make(IDS[1], sensor_noise=1.0), actions, seed=11) for _ in range(2)]
    assert np.array_equal(runs[0][0], runs[1][0])
    assert np.array_equal(runs[0][1], runs[1][1])
    assert runs[0][2] == runs[1][2]


def test_a_used_environment_repeats_a_fresh_one(env):
    actions = np.zeros((10, 3), dtype=np.float32)
    rollout(env, actions, seed=5)
    rollout(env, np.ones((25, 3), dtype=np.float32), seed=6)
    again = rollout(env, actions, seed=5)
    fresh = rollout(gym.make("wt_gym/NREL5MW-Turbulent-v1", wind_speed=13.0), actions, seed=5)
    assert np.array_equal(again[0], fresh[0])


@pytest.mark.parametrize("bad", [[np.nan, 0, 0], [0, np.inf, 0], [0, 0, 1.5], [0, 0], np.zeros((1, 3))])
def test_a_refused_action_leaves_everything_as_it_was(env, bad):
    raw = env.unwrapped
    raw.reset(seed=4)
    raw.step(np.array([0.2, 0.0, -0.1]))
    before, demand = raw.simulator.state(), raw.demand
    with pytest.raises(ActionError):
        raw.step(bad)
    assert raw.simulator.state() == before
    assert raw.demand is demand
    raw.step(np.zeros(3))


def test_objects_are_fresh_every_step(env):
    observation, info = env.reset(seed=0)
    kept = observation.copy()
    next_observation, _, _, _, next_info = env.step(np.ones(3, dtype=np.float32))
    assert next_observation is not observation
    assert next_info is not info
    assert np.array_equal(observation, kept)
    action = np.zeros(3, dtype=np.float32)
    env.step(action)
    action[:] = 1.0
    assert np.array_equal(env.unwrapped._action, np.zeros(3))


def test_reset_options_fix_the_start(env):
    _, info = env.reset(options={"wind_speed": 9.0, "wind_seed": 77, "rotor_speed": 1.0, "pitch": 0.05, "azimuth": 2.0})
    signals = env.unwrapped.signals
    assert (info["wind_speed"], info["wind_seed"]) == (9.0, 77)
    assert signals["rotor_speed"] == pytest.approx(1.0, rel=1e-6)
    assert signals["azimuth"] == pytest.approx(2.0, abs=0.01)  # the shaft is twisted by its torque
    assert signals["pitch_1"] == pytest.approx(0.05, abs=2e-3)
    with pytest.raises(ValueError, match="no option 'wind'; did you mean"):
        env.reset(options={"wind": 9.0})
    with pytest.raises(InflowError, match="and 50 m/s"):
        env.reset(options={"wind_speed": 60.0})


def test_a_refused_reset_leaves_no_episode_running(env):
    env.reset(seed=0)
    with pytest.raises((ValueError, SimulationError), match="rotor_speed"):
        env.reset(options={"wind_speed": 20.0, "rotor_speed": np.nan})
    with pytest.raises(ResetNeeded):
        env.unwrapped.step(np.zeros(3))
    env.reset(seed=0)
    env.step(np.zeros(3, dtype=np.float32))


def test_start_is_near_steady_operation():
    env = gym.make(IDS[0], wind_speed=8.0, shear_exponent=0.0)
    env.reset(seed=0)
    powers = [env.step(np.zeros(3, dtype=np.float32))[4]["generator_power"] for _ in range(50)]
    assert np.ptp(powers) < 0.1 * np.mean(powers)


def test_longest_rates_reach_the_limits_and_stay_there():
    env = gym.make(IDS[0], wind_speed=12.0, standstill_limit=0.0, episode_length=20.0)
    env.reset(seed=0)
    for _ in range(70):  # 90 deg at 8 deg/s take 56 steps
        _, _, terminated, _, _ = env.step(np.array([1.0, 0.0, -1.0], dtype=np.float32))
        assert not terminated
    turbine = env.unwrapped.turbine
    assert env.unwrapped.demand.pitch[0] == turbine.pitch.max_pitch
    assert env.unwrapped.signals["pitch_1"] == pytest.approx(turbine.pitch.max_pitch, abs=0.02)
    assert env.unwrapped.signals["generator_torque"] == 0.0


def adversarial_actions(rng, n, size):
    """Random, corner, bang-bang and slow actions in stretches of random length."""
    actions = np.empty((0, size))
    while len(actions) < n:
        length = int(rng.integers(5, 60))
        kind = rng.integers(4)
        if kind == 0:
            stretch = rng.uniform(-1, 1, (length, size))
        elif kind == 1:
            stretch = np.tile(rng.choice([-1.0, 1.0], size), (length, 1))
        elif kind == 2:
            stretch = np.where(np.arange(length)[:, None] % 2 == 0, 1.0, -1.0) * rng.choice([-1.0, 1.0], size)
        else:
            stretch = np.cumsum(rng.normal(0, 0.1, (length, size)), axis=0).clip(-1, 1)
        actions = np.concatenate([actions, stretch])
    return actions[:n].astype(np.float32)


def run_adversary(env, n, seed):
    """Step through adversarial actions, resetting at episode ends; returns how the episodes ended."""
    rng, endings = np.random.default_rng(seed), []
    env.reset(seed=seed)
    for action in adversarial_actions(rng, n, env.action_space.shape[0]):
        observation, reward, terminated, truncated, info = env.step(action)
        assert env.observation_space.contains(observation)
        assert np.isfinite(reward)
        if terminated or truncated:
            endings.append(info.get("termination", "time"))
            env.reset()
    return endings


@pytest.mark.parametrize(
    ("n", "kwargs"),
    [
        (2_000, {"wind_speed": (3.0, 25.0), "wind_seeds": (1, 2, 3)}),
        (500, {"wind_speed": (4.0, 24.0), "pitch": "individual", "action_mode": "absolute", "sensor_noise": 1.0}),
        pytest.param(10_000, {"wind_speed": (3.0, 25.0), "standstill_limit": 0.0}, marks=pytest.mark.slow),
    ],
)
def test_adversarial_actions_never_break_the_environment(n, kwargs):
    env = gym.make("wt_gym/NREL5MW-Turbulent-v1", episode_length=60.0, **kwargs)
    endings = run_adversary(env, n, seed=1)
    assert endings


@pytest.mark.parametrize("mode", ["sync", pytest.param("async", marks=pytest.mark.slow)])
def test_gymnasium_vector_environment(mode):
    # other processes would record the running turbine at full length
    kwargs = {"vector_kwargs": {"context": "spawn"}, "start": "steady"} if mode == "async" else {}
    vec = gym.make_vec(IDS[1], num_envs=2, vectorization_mode=mode, wind_speed=12.0, **kwargs)
    try:
        observations, _ = vec.reset(seed=0)
        assert observations.shape == vec.observation_space.shape
        observations, rewards, *_, infos = vec.step(np.zeros((2, 3), dtype=np.float32))
        assert rewards.shape == (2,)
        assert infos["reward_terms"]["power"].shape == (2,)
    finally:
        vec.close()


def test_stable_baselines_vector_environment():
    vec = DummyVecEnv([lambda: gym.make(IDS[0], wind_speed=10.0)] * 2)
    assert vec.reset().shape == (2, *vec.observation_space.shape)
    _, rewards, dones, infos = vec.step(np.zeros((2, 3), dtype=np.float32))
    assert rewards.shape == (2,)
    assert not dones.any()
    assert "power" in infos[0]["reward_terms"]


def test_render_gives_a_picture():
    env = gym.make(IDS[0], render_mode="rgb_array", wind_speed=10.0, control_dt=0.4)
    env.reset(seed=0)
    env.step(np.zeros(3, dtype=np.float32))
    picture = env.render()
    assert picture.dtype == np.uint8
    assert picture.shape == (540, 960, 3)
    assert picture.std() > 10
    assert env.metadata["render_fps"] == 2


def test_import_is_light():
    code = (
        "import sys, time; t = time.perf_counter(); import wt_gym; print(time.perf_counter() - t);"
        "print([m for m in ('numba', 'scipy', 'xarray', 'torch', 'matplotlib', 'plotly') if m in sys.modules])"
    )
    seconds, heavy = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    ).stdout.splitlines()
    assert heavy == "[]"
    assert float(seconds) < 1.0
