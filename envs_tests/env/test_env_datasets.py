"""Minari data sets: recorded as played, read back with the environment they come from."""

import gymnasium as gym
import numpy as np
import pytest

import wt_gym  # noqa: F401 - registers the environments
from wt_gym.learning.datasets import record_dataset
from wt_gym.learning.options import DatasetConfig

minari = pytest.importorskip("minari")

SHORT = {"wind_speed": 14.0, "inflow": "steady", "episode_length": 2.0}


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    folder = tmp_path_factory.mktemp("datasets")
    config = DatasetConfig("ipc:bandwidth=0.3", "wt_gym/test/ipc-v0", env_kwargs=SHORT, episodes=2, noise=0.2, seed=7)
    returns = []
    return folder, config, record_dataset(config, folder, lambda _, earned: returns.append(earned)), returns


def test_episodes_can_be_played_again(recorded):
    _, _, dataset, returns = recorded
    assert (dataset.total_episodes, dataset.total_steps) == (2, 20)
    env = dataset.recover_environment()
    assert env.spec.kwargs["pitch"] == "individual"
    for number, episode in enumerate(dataset):
        observation, _ = env.reset(seed=7 + number)
        np.testing.assert_array_equal(episode.observations[0], observation)
        for k, action in enumerate(episode.actions):
            observation, reward, _, _, info = env.step(action)
            np.testing.assert_array_equal(episode.observations[k + 1], observation)
            assert episode.rewards[k] == pytest.approx(reward)
            assert episode.infos["cost"][k + 1] == pytest.approx(info["cost"])
        assert episode.truncations[-1]
        assert returns[number] == pytest.approx(episode.rewards.sum())


def test_it_is_found_with_its_reference_scores(recorded, monkeypatch):
    folder, config, _, returns = recorded
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(folder))
    metadata = minari.load_dataset(config.dataset_id).storage.metadata
    assert metadata["ref_max_score"] == pytest.approx(np.mean(returns))
    assert metadata["ref_min_score"] != metadata["ref_max_score"]
    assert metadata["algorithm_name"] == "ipc:bandwidth=0.3"


def test_noise_changes_the_actions_within_their_bounds(recorded):
    _, _, dataset, _ = recorded
    first, second = (episode.actions for episode in dataset)
    assert np.abs(np.concatenate([first, second])).max() <= 1.0
    assert gym.spaces.Box(-1.0, 1.0, first.shape, np.float32).contains(first)
    assert not np.array_equal(first, second)


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"agent": "nothing"}, "an agent must be baseline.*got 'nothing'"),
        ({"episodes": 0}, "episodes and random_episodes must be at least 1"),
        ({"noise": -1.0}, "noise must be"),
        ({"dataset_id": "wt_gym/test/ipc-v0"}, "is a data set wt_gym/test/ipc-v0"),
    ],
)
def test_what_cannot_be_recorded_is_refused(recorded, wrong, message):
    given = {"agent": "ipc", "dataset_id": "wt_gym/test/other-v0", "env_kwargs": SHORT} | wrong
    with pytest.raises(ValueError, match=message):
        record_dataset(DatasetConfig(**given), recorded[0])
