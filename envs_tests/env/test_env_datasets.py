"""Minari data sets: recorded as played, read back with the environment they come from."""

import numpy as np
import pytest

from wt_gym.learning.datasets import record_dataset
from wt_gym.learning.options import DatasetConfig

minari = pytest.importorskip("minari")

SHORT = {"wind_speed": 14.0, "inflow": "steady", "episode_length": 2.0}


@pytest.fixture(scope="module")
def recorded(tmp_path_factory, scripted_module):
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
        assert np.abs(episode.actions).max() <= 1.0
        assert returns[number] == pytest.approx(episode.rewards.sum())


def test_it_is_found_with_its_reference_scores(recorded, monkeypatch):
    folder, config, _, returns = recorded
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(folder))
    metadata = minari.load_dataset(config.dataset_id).storage.metadata
    assert metadata["ref_max_score"] == pytest.approx(np.mean(returns))
    assert metadata["ref_min_score"] != metadata["ref_max_score"]
    assert metadata["algorithm_name"] == "ipc:bandwidth=0.3"


def test_a_second_data_set_of_the_name_is_refused(recorded):
    with pytest.raises(ValueError, match="is a data set wt_gym/test/ipc-v0"):
        record_dataset(recorded[1], recorded[0])
