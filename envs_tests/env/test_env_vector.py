"""Many turbines in one process: equal to single ones, in every mode of autoreset; stable-baselines3's interface."""

import copy
import pickle

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.error import ClosedEnvironmentError, ResetNeeded
from gymnasium.vector import AutoresetMode
from stable_baselines3.common.vec_env import DummyVecEnv
from threadpoolctl import threadpool_info, threadpool_limits
from turbine_contract import PLAIN

from wt_gym.base.errors import ActionError, ControllerError
from wt_gym.control import Lidar
from wt_gym.envs.vector_env import WindTurbineVectorEnv
from wt_gym.learning.environments import TurbineVecEnv

ID = "wt_gym/LoadReduction-v3"
STEPS = 9


def make(mode=AutoresetMode.NEXT_STEP, n=3, limit=4, **kwargs):
    return gym.make_vec(ID, n, autoreset_mode=mode, max_episode_steps=limit, **PLAIN, **kwargs)


def actions(n, size):
    return np.random.default_rng(0).uniform(-1.0, 1.0, (STEPS, n, size)).astype(np.float32)


def single_episodes(k, given, limit=4):
    """Transitions of one environment that begins anew when its episode is over: what every mode must contain."""
    env = gym.make(ID, max_episode_steps=limit, **PLAIN)
    observation, _ = env.reset(seed=7 + k)
    found = []
    for action in given:
        after, reward, terminated, truncated, info = env.step(action)
        found.append((observation, action, reward, terminated, truncated, after, info["time"]))
        observation = env.reset()[0] if terminated or truncated else after
    return found


def assert_same(mine, theirs):
    assert len(mine) == len(theirs)
    for a, b in zip(mine, theirs, strict=True):
        for x, y in zip(a, b, strict=True):
            np.testing.assert_array_equal(x, y)


def transitions(env):
    """Transitions of each turbine, whichever mode; actions of a step that only resets are not used up."""
    mode, n = env.metadata["autoreset_mode"], env.num_envs
    assert env.autoreset_mode is mode
    given = actions(n, env.single_action_space.shape[0])
    used, found = [0] * n, [[] for _ in range(n)]
    before, _ = env.reset(seed=7)
    over = np.zeros(n, dtype=bool)
    while min(used) < STEPS:
        if mode is AutoresetMode.DISABLED and over.any():
            before, _ = env.reset(options={"reset_mask": over})
        chosen = np.array([given[min(u, STEPS - 1)][k] for k, u in enumerate(used)])
        after, rewards, terminated, truncated, infos = env.step(chosen)
        for k in range(n):
            if mode is AutoresetMode.NEXT_STEP and over[k]:
                assert (rewards[k], terminated[k], truncated[k]) == (0.0, False, False)
                continue
            last, time = after[k], infos["time"][k]
            if mode is AutoresetMode.SAME_STEP and (terminated[k] or truncated[k]):
                last, time = infos["final_obs"][k], infos["final_info"]["time"][k]
            if used[k] < STEPS:
                found[k].append((before[k], chosen[k], rewards[k], terminated[k], truncated[k], last, time))
                used[k] += 1
        over, before = terminated | truncated, after
    return found


@pytest.mark.parametrize("mode", list(AutoresetMode))
def test_every_mode_holds_the_transitions_of_single_environments(mode):
    env = make(mode)
    assert isinstance(env, WindTurbineVectorEnv)
    found = transitions(env)
    for k in range(env.num_envs):
        assert_same(found[k], single_episodes(k, actions(3, 3)[:, k]))
    env.close()


def test_threads_change_nothing():
    assert_all = [transitions(make(AutoresetMode.SAME_STEP, threads=threads)) for threads in (1, 3)]
    for one, three in zip(*assert_all, strict=True):
        assert_same(one, three)


def test_side_by_side_linear_algebra_has_one_thread():
    """A number of the whole process, which a thread that makes a turbine or a wind would set back for the others."""

    def threads_of(_):
        with threadpool_limits(limits=1, user_api="blas"):
            pass
        return {one["num_threads"] for one in threadpool_info() if one["user_api"] == "blas"}

    env = make(n=2, threads=2)
    with threadpool_limits(limits=2, user_api="blas"):
        assert env._each(threads_of, range(2)) == [{1}, {1}]
        assert threads_of(0) == {2}
    env.close()


def test_a_refused_action_moves_no_turbine():
    env = make(n=2)
    env.reset(seed=0)
    with pytest.raises(ActionError):
        env.step(np.array([[0.0, 0.0, 0.0], [0.0, np.nan, 0.0]]))
    *_, infos = env.step(np.zeros((2, 3)))
    np.testing.assert_allclose(infos["time"], 0.2)
    with pytest.raises(ValueError, match="2 actions are needed"):
        env.step(np.zeros((3, 3)))


def test_seeds_masks_and_numbers_are_checked():
    with pytest.raises(ResetNeeded, match="call reset"):
        make(n=2).step(np.zeros((2, 3)))
    closed = make(n=2)
    closed.reset(seed=0)
    closed.close()
    with pytest.raises(ClosedEnvironmentError):
        closed.reset(seed=0)
    env = make(AutoresetMode.DISABLED, n=2, limit=1)
    for seed in ([1, 2, 3], 1.5, "ab"):
        with pytest.raises(ValueError, match="seed must be an integer or a sequence of 2, got"):
            env.reset(seed=seed)
    with pytest.raises(ValueError, match=r"options of reset must be a dict, got \['yaw'\]"):
        env.reset(options=["yaw"])
    with pytest.raises(ValueError, match="reset_mask must be 2 bools"):
        env.reset(options={"reset_mask": [False, False]})
    env.reset(seed=[1, None])
    env.step(np.zeros((2, 3)))
    with pytest.raises(ResetNeeded, match=r"turbines \[0, 1\] are over"):
        env.step(np.zeros((2, 3)))
    with pytest.raises(ValueError, match=r"threads must be a whole number of at least 1, got 1\.5"):
        WindTurbineVectorEnv(1, threads=1.5)
    with pytest.raises(ValueError, match=r"autoreset_mode must be one of 'NextStep' \('NEXT_STEP'\), .*, got 'same_st"):
        WindTurbineVectorEnv(1, autoreset_mode="same_step")


@pytest.mark.parametrize("mode", AutoresetMode)
def test_modes_of_autoreset_have_a_name_and_a_value(mode):
    for given in (mode, mode.name, mode.value):
        env = make(given, n=1)
        assert env.autoreset_mode is env.metadata["autoreset_mode"] is mode


@pytest.mark.parametrize(
    ("threads", "error", "over"),
    [
        (1, ControllerError("none"), r"\[1\]"),
        (2, ControllerError("none"), r"\[1\]"),
        (2, KeyboardInterrupt(), r"\[0, 1\]"),
    ],
)
def test_a_turbine_whose_step_fails_has_to_begin_again(threads, error, over, monkeypatch):
    """After an interrupt all of them."""
    env = make(AutoresetMode.DISABLED, n=2, threads=threads)
    env.reset(seed=0)

    def fail(action):
        raise error

    with monkeypatch.context() as patch:
        patch.setattr(env.envs[1], "advance", fail)
        with pytest.raises(type(error)):
            env.step(np.zeros((2, 3)))
    with pytest.raises(ResetNeeded, match=over):
        env.step(np.zeros((2, 3)))
    if isinstance(error, ControllerError):
        env.reset(options={"reset_mask": np.array([False, True])})
        np.testing.assert_allclose(env.step(np.zeros((2, 3)))[4]["time"], [0.4, 0.2])


def test_a_lidar_looks_once_for_observation_and_controller(monkeypatch):
    env = gym.make(ID, **PLAIN | {"controller": "lidar", "observation": ("rotor", "lidar")}).unwrapped
    env.reset(seed=0)
    looks, read = [], Lidar.read

    def looked(lidar, inflow, time, yaw, height, rotation):
        looks.append(time)
        return read(lidar, inflow, time, yaw, height)

    monkeypatch.setattr(Lidar, "read", looked)
    observation, *_ = env.step(np.zeros(3))
    np.testing.assert_allclose(looks, [0.1, 0.2], rtol=1e-12)  # at 0 s it has looked for the reset
    seen = read(env.layout.lidar, env.episode_wind.inflow, 0.2, env.signals["yaw"], env.turbine.hub_height)
    observed = [env.layout.observation.value(observation, f"lidar_{k}") for k in (1, 2, 3)]
    np.testing.assert_allclose(observed, seen, rtol=1e-6)


def test_iterators_serve_all_turbines_and_rewards_come_by_terms():
    env = make(n=2, wind_seeds=iter([3, 4]), vector_reward=True)
    assert [e.wind.seeds for e in env.envs] == [(3, 4), (3, 4)]
    env.reset(seed=0)
    assert env.step(np.zeros((2, 3)))[1].shape == (2, len(env.envs[0].reward_names))


def test_the_interface_of_stable_baselines3_gives_what_its_own_gives():
    mine = TurbineVecEnv(ID, 2, max_episode_steps=3, **PLAIN)
    theirs = DummyVecEnv([lambda: gym.make(ID, max_episode_steps=3, **PLAIN)] * 2)
    given = actions(2, 3)
    for venv in (mine, theirs):
        venv.seed(5)
    np.testing.assert_array_equal(mine.reset(), theirs.reset())
    for action in given:
        a, b = mine.step(action), theirs.step(action)
        for x, y in zip(a[:3], b[:3], strict=True):
            np.testing.assert_array_equal(x.astype(y.dtype), y)
        for x, y in zip(a[3], b[3], strict=True):
            assert x.keys() == y.keys()
            assert (x["time"], x["TimeLimit.truncated"]) == (y["time"], y["TimeLimit.truncated"])
            np.testing.assert_array_equal(x.get("terminal_observation", 0.0), y.get("terminal_observation", 0.0))
    assert [info["time"] for info in mine.reset_infos] == [0.0, 0.0]
    assert mine.get_attr("control_dt") == [0.2, 0.2]
    mine.close()


@pytest.mark.parametrize("copied", [copy.deepcopy, lambda env: pickle.loads(pickle.dumps(env))])
def test_copies_continue_as_the_original(copied):
    env = make(n=2, threads=2)
    env.reset(seed=0)
    other, action = copied(env), np.full((2, 3), 0.5, np.float32)
    for mine, theirs in zip(env.step(action)[:4], other.step(action)[:4], strict=True):
        np.testing.assert_array_equal(mine, theirs)
    env.close()
    other.step(action)
    with pytest.raises(ClosedEnvironmentError):
        copied(env).step(action)
    other.close()
