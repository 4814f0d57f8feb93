"""The wrappers of Gymnasium around single and vector environments, and trainings in the style of CleanRL."""

import gymnasium as gym
import numpy as np
import pytest
from gymnasium import wrappers
from gymnasium.wrappers import vector as vector_wrappers

import wt_gym  # noqa: F401 - registers the environments

ID = "wt_gym/LoadReduction-v3"
STEPS = 5

SINGLE = {
    "ClipAction": lambda env: wrappers.ClipAction(env),
    "ClipReward": lambda env: wrappers.ClipReward(env, -1.0, 1.0),
    "DelayObservation": lambda env: wrappers.DelayObservation(env, 2),
    "DiscretizeAction": lambda env: wrappers.DiscretizeAction(env, 3),
    "DtypeObservation": lambda env: wrappers.DtypeObservation(env, np.float64),
    "FlattenObservation": wrappers.FlattenObservation,
    "FrameStackObservation": lambda env: wrappers.FrameStackObservation(env, 3),
    "MaxAndSkipObservation": lambda env: wrappers.MaxAndSkipObservation(env, 2),
    "NormalizeObservation": wrappers.NormalizeObservation,
    "NormalizeReward": wrappers.NormalizeReward,
    "RecordEpisodeStatistics": wrappers.RecordEpisodeStatistics,
    "RepeatAction": lambda env: wrappers.RepeatAction(env, 2),
    "RescaleAction": lambda env: wrappers.RescaleAction(env, np.float32(5.0), np.float32(5.3)),
    "ReshapeObservation": lambda env: wrappers.ReshapeObservation(env, (1, *env.observation_space.shape)),
    "StickyAction": lambda env: wrappers.StickyAction(env, 0.25),
    "TimeAwareObservation": wrappers.TimeAwareObservation,
    "TimeLimit": lambda env: wrappers.TimeLimit(env, STEPS),
    "TransformAction": lambda env: wrappers.TransformAction(env, np.negative, env.action_space),
    "TransformObservation": lambda env: wrappers.TransformObservation(env, np.negative, None),
    "TransformReward": lambda env: wrappers.TransformReward(env, lambda reward: 0.01 * reward),
}
VECTOR = {
    "ClipAction": vector_wrappers.ClipAction,
    "ClipReward": lambda env: vector_wrappers.ClipReward(env, -1.0, 1.0),
    "DtypeObservation": lambda env: vector_wrappers.DtypeObservation(env, np.float64),
    "FlattenObservation": vector_wrappers.FlattenObservation,
    "NormalizeObservation": vector_wrappers.NormalizeObservation,
    "NormalizeReward": vector_wrappers.NormalizeReward,
    "RecordEpisodeStatistics": vector_wrappers.RecordEpisodeStatistics,
    "RescaleAction": lambda env: vector_wrappers.RescaleAction(env, np.float32(5.0), np.float32(5.3)),
    "TransformReward": lambda env: vector_wrappers.TransformReward(env, lambda reward: 0.01 * reward),
}


def ends(space):
    """Lowest, highest and a random action."""
    if not isinstance(space, gym.spaces.Box):
        return [space.sample()]
    return [space.low, space.high, space.sample()]


@pytest.mark.parametrize("name", SINGLE)
@pytest.mark.filterwarnings("error::UserWarning")
def test_wrappers(scripted, name):
    env = SINGLE[name](gym.make(ID, max_episode_steps=20))
    env.action_space.seed(0)
    observation, _ = env.reset(seed=1)
    assert env.observation_space.contains(observation)
    for action in ends(env.action_space):
        observation, reward, terminated, truncated, _ = env.step(action)
        assert env.observation_space.contains(observation)
        assert np.isfinite(reward)
        assert not terminated
        assert not truncated
    assert "\n" not in str(env)
    env.close()


@pytest.mark.parametrize("name", VECTOR)
@pytest.mark.parametrize("mode", ["vector_entry_point", "sync"])
@pytest.mark.filterwarnings("error::UserWarning")
def test_vector_wrappers(scripted, name, mode):
    envs = VECTOR[name](gym.make_vec(ID, num_envs=2, vectorization_mode=mode))
    envs.action_space.seed(0)
    observations, _ = envs.reset(seed=1)
    for actions in ends(envs.action_space):
        observations, rewards, *_ = envs.step(actions)
        assert envs.observation_space.contains(observations)
        assert np.isfinite(rewards).all()
    assert "\n" not in str(envs) + repr(envs)
    envs.close()


@pytest.mark.filterwarnings("ignore::DeprecationWarning")
def test_an_episode_becomes_a_film(tmp_path):
    """With the extra ``train``, which `scripts/demo` installs."""
    moviepy = pytest.importorskip("moviepy.video.io.VideoFileClip")
    plain = gym.make("wt_gym/NREL5MW-Steady-v1", render_mode="rgb_array", max_episode_steps=STEPS)
    env = wrappers.RecordVideo(plain, str(tmp_path / "films"))
    env.reset(seed=1)
    while not env.step(env.action_space.sample())[3]:
        pass
    env.close()
    (film,) = (tmp_path / "films").glob("*.mp4")
    with moviepy.VideoFileClip(str(film)) as clip:
        assert clip.size == [960, 540]
        assert clip.fps * clip.duration == pytest.approx(STEPS + 1, abs=1.0)


def cleanrl_environment():
    """Environment as CleanRL's ``ppo_continuous_action.py`` makes it."""
    env = gym.make(ID, max_episode_steps=STEPS)
    env = wrappers.FlattenObservation(env)
    env = wrappers.RecordEpisodeStatistics(env)
    env = wrappers.ClipAction(env)
    env = wrappers.NormalizeObservation(env)
    env = wrappers.TransformObservation(env, lambda obs: np.clip(obs, -10, 10), env.observation_space)
    env = wrappers.NormalizeReward(env, gamma=0.99)
    return wrappers.TransformReward(env, lambda reward: np.clip(reward, -10, 10))


def test_loop_of_cleanrl(scripted):
    envs = gym.vector.SyncVectorEnv([cleanrl_environment] * 2)
    assert isinstance(envs.single_action_space, gym.spaces.Box)
    envs.reset(seed=1)
    rng, lengths = np.random.default_rng(0), []
    for _ in range(3 * (STEPS + 1)):
        actions = rng.normal(scale=2.0, size=envs.action_space.shape)  # unbounded, as a Gaussian policy has it
        observations, rewards, _, truncated, infos = envs.step(actions)
        assert np.isfinite(observations).all()
        assert np.isfinite(rewards).all()
        if truncated.any():
            lengths += infos["episode"]["l"][infos["_episode"]].tolist()
    assert lengths == [STEPS] * 6
    envs.close()
