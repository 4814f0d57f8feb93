"""The wrappers of Gymnasium work on the environment as they are documented."""

import gymnasium as gym
import numpy as np
import pytest
from gymnasium import wrappers

import wt_gym  # noqa: F401 - registers the environments

ID = "wt_gym/NREL5MW-Steady-v1"


def make(**kwargs):
    # with a limit from outside: TimeAwareObservation looks for it
    return gym.make(ID, wind_speed=12.0, episode_length=None, max_episode_steps=3, **kwargs)


def rollout(env, action=None):
    """Observations of an episode of three steps and its last info; every observation lies in its space."""
    observations, done = [env.reset(seed=1)[0]], False
    while not done:
        zero = np.zeros(env.action_space.shape, dtype=np.float32)
        observation, _, terminated, truncated, info = env.step(zero if action is None else action)
        observations.append(observation)
        done = terminated or truncated
    assert all(env.observation_space.contains(observation) for observation in observations)
    assert len(observations) == 4
    return np.array(observations), info


@pytest.fixture(scope="module")
def plain():
    return rollout(make())[0]


def test_time_aware_observation_adds_the_step(plain):
    observations, _ = rollout(wrappers.TimeAwareObservation(make(), normalize_time=False))
    np.testing.assert_array_equal(observations[:, :-1], plain)
    np.testing.assert_array_equal(observations[:, -1], [0, 1, 2, 3])


def test_frame_stack_observation_holds_the_last_ones(plain):
    observations, _ = rollout(wrappers.FrameStackObservation(make(), 2))
    np.testing.assert_array_equal(observations[:, 1], plain)
    np.testing.assert_array_equal(observations[1:, 0], plain[:-1])


def test_normalize_observation_centers(plain):
    env = wrappers.NormalizeObservation(make())
    observations, _ = rollout(env)
    assert observations.dtype == np.float32
    # the running mean begins with 1e-4 of an observation that is zero
    np.testing.assert_allclose(env.obs_rms.mean, plain.astype(float).sum(axis=0) / (4 + 1e-4), atol=1e-6)


def test_record_episode_statistics_sums_the_rewards():
    env, single = wrappers.RecordEpisodeStatistics(make()), make()
    _, info = rollout(env)
    single.reset(seed=1)
    total = sum(single.step(np.zeros(3, dtype=np.float32))[1] for _ in range(3))
    assert info["episode"]["l"] == 3
    assert info["episode"]["r"] == pytest.approx(total, rel=1e-12)


def test_clip_action_takes_what_the_environment_refuses():
    beyond = np.full(3, 5.0, dtype=np.float32)
    clipped, _ = rollout(wrappers.ClipAction(make()), beyond)
    np.testing.assert_array_equal(clipped, rollout(make(), np.ones(3, dtype=np.float32))[0])


def test_rescale_action_maps_the_ends():
    low, high = np.full(3, -10.0, dtype=np.float32), np.full(3, 10.0, dtype=np.float32)
    scaled, _ = rollout(wrappers.RescaleAction(make(), low, high), high)
    np.testing.assert_array_equal(scaled, rollout(make(), np.ones(3, dtype=np.float32))[0])


def test_vector_wrappers_on_a_vector_environment(plain):
    vec = gym.make_vec(ID, num_envs=2, vectorization_mode="sync", wind_speed=12.0, episode_length=0.6)
    vec = wrappers.vector.RecordEpisodeStatistics(vec)
    observations, _ = vec.reset(seed=[1, 1])
    np.testing.assert_array_equal(observations, [plain[0]] * 2)
    for _ in range(3):
        observations, _, _, truncated, infos = vec.step(np.zeros((2, 3), dtype=np.float32))
    assert truncated.all()
    np.testing.assert_array_equal(observations, [plain[-1]] * 2)
    np.testing.assert_array_equal(infos["episode"]["l"], [3, 3])
    vec.close()


def test_record_video_writes_an_episode(tmp_path):
    pytest.importorskip("moviepy")
    folder = tmp_path / "videos"
    env = wrappers.RecordVideo(make(render_mode="rgb_array"), str(folder), episode_trigger=lambda k: k == 0)
    rollout(env)
    env.close()
    (video,) = folder.glob("*.mp4")
    assert video.stat().st_size > 1000


def test_human_rendering_opens_a_window_of_the_picture(monkeypatch):
    pygame = pytest.importorskip("pygame")
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")  # needs no display
    env = wrappers.HumanRendering(make(render_mode="rgb_array"))
    env.reset(seed=1)
    env.step(np.zeros(3, dtype=np.float32))
    assert env.render_mode == "human"
    assert pygame.display.get_surface().get_size() == (960, 540)
    env.close()
