"""Search of hyperparameters with a made-up training: it finds the best, goes on where it was, writes what it found."""

import math
import signal
from dataclasses import replace

import pytest

from wt_gym.learning import search as searching
from wt_gym.learning.hyperparameters import hyperparameters_for
from wt_gym.learning.options import TrainingConfig
from wt_gym.learning.search import BEST_FILE, SPACES, search

pytest.importorskip("optuna")
TASK = "wt_gym/NREL5MW-Steady-v1"  # whose hyperparameters lie in the search space
CONFIG = TrainingConfig(env_id=TASK, total_steps=300, eval_every=100, tensorboard=False)


def distance(values):
    """Decades from the best learning rate."""
    return abs(math.log10(float(str(values["learning_rate"]).removeprefix("lin_")) / 1e-4))


class MadeUp:
    """A training whose return is best at a learning rate of 1e-4, and which can be told to stop."""

    def __init__(self):
        self.tried, self.interrupt_at = [], None

    def __call__(self, config, folder, *, on_evaluation, stop, **_):
        self.tried.append(config.hyperparameters)
        if len(self.tried) == self.interrupt_at:
            stop.signal_number = signal.SIGTERM
            return {"status": "interrupted"}
        final = -(distance(config.hyperparameters) ** 2)
        for steps in (100, 200, 300):
            if not on_evaluation(steps, {"episode_return": final}):
                return {"status": "stopped"}
        return {"status": "finished", "evaluation": {"curve": {"episode_return": [final - 1.0, final]}}}


@pytest.fixture
def made_up(monkeypatch):
    trainings = MadeUp()
    monkeypatch.setattr(searching, "train", trainings)
    return trainings


def test_the_search_finds_the_best_and_training_takes_it(made_up, tmp_path):
    result = search(CONFIG, tmp_path, 12)
    assert result["status"] == "finished"
    assert result["trials"] == 12 == len(made_up.tried)
    distances = [distance(values) for values in made_up.tried]
    assert result["value"] == pytest.approx(-(min(distances) ** 2))
    assert min(distances) < distances[0]
    present = hyperparameters_for("PPO", TASK)
    assert {name: made_up.tried[0][name] for name in present} == present  # the first
    found = hyperparameters_for("PPO", TASK, tmp_path / BEST_FILE)
    assert found == result["best"]
    assert distance(found) ** 2 == pytest.approx(-result["value"])


def test_a_stopped_search_goes_on(made_up, tmp_path):
    made_up.interrupt_at = 3
    first = search(CONFIG, tmp_path, 4)
    assert (first["status"], first["stopped_by"], first["trials"]) == ("interrupted", "SIGTERM", 2)
    second = search(CONFIG, tmp_path, 4)
    assert (second["status"], second["trials"]) == ("finished", 4)
    assert len(made_up.tried) == 5
    assert search(CONFIG, tmp_path, 4) == second


@pytest.mark.parametrize("algorithm", SPACES)
def test_what_is_searched_can_be_trained(algorithm, made_up, tmp_path):
    search(
        TrainingConfig(algorithm, hyperparameters={"learning_rate": "lin_1e-3"}, total_steps=300, eval_every=100),
        tmp_path,
        5,
    )
    for values in made_up.tried:
        TrainingConfig(algorithm, hyperparameters=values)  # refuses what is out of range
    assert set(SPACES[algorithm]) <= set(made_up.tried[0])


def test_searches_without_meaning_are_refused(made_up, tmp_path):
    with pytest.raises(ValueError, match="number of trials"):
        search(CONFIG, tmp_path, 0)
    with pytest.raises(ValueError, match="eval_every"):
        search(TrainingConfig(eval_every=0), tmp_path, 3)
    search(CONFIG, tmp_path, 1)
    with pytest.raises(ValueError, match="must be that of the search in this folder, got other total_steps"):
        search(replace(CONFIG, total_steps=400), tmp_path, 2)
