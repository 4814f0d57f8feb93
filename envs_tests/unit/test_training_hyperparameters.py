"""Hyperparameters from YAML: those of the package, layers of files and options, and what is refused."""

import pytest
from stable_baselines3.common.utils import LinearSchedule

from wt_gym.experiment.trained_agent import ALGORITHM_CLASSES
from wt_gym.learning.environments import make_training_env
from wt_gym.learning.hyperparameters import (
    ALGORITHMS,
    hyperparameters_for,
    of_each_copy,
    read_hyperparameters,
    replaced,
)
from wt_gym.learning.models import make_model
from wt_gym.learning.options import TrainingConfig
from wt_gym.tasks import TASKS

TASK, STEADY = "wt_gym/LoadReduction-v3", "wt_gym/NREL5MW-Steady-v1"


@pytest.mark.parametrize("name", TASKS)
def test_a_task_looks_ahead_as_long_as_it_takes(name):
    """10 s with credit, 20 s for the motion of the tower, 30 s for the energy of the rotor, 200 s for the yaw drive."""
    task = TASKS[name]
    least = {"Yaw": 200.0, "MaxPower": 30.0, "Gusts": 20.0, "FullOperation": 20.0}.get(name, 10.0)
    gamma = hyperparameters_for("PPO", task.id)["gamma"]
    assert task.arguments["control_dt"] / (1.0 - gamma) > 0.999 * least


@pytest.mark.parametrize("algorithm", ALGORITHMS)
def test_models_are_made_with_what_the_files_say(algorithm):
    config = TrainingConfig(algorithm, STEADY, hyperparameters={"learning_rate": "lin_1e-3", "activation_fn": "elu"})
    venv = make_training_env(config)
    model = make_model(config, venv)
    venv.close()
    assert isinstance(model, ALGORITHM_CLASSES[algorithm])
    assert model.gamma == config.resolved["gamma"] == venv.gamma
    assert model.lr_schedule(0.5) == pytest.approx(0.5e-3)
    assert isinstance(model.learning_rate, LinearSchedule)
    assert "ELU" in str(model.policy)
    assert f"out_features={config.resolved['net_arch'][0]}" in str(model.policy)


def test_files_lie_on_top_of_the_package_and_options_on_top_of_files(tmp_path):
    file = tmp_path / "mine.yml"
    file.write_text(f"default:\n  gamma: 0.9\n  n_epochs: 3\n{TASK}:\n  gamma: 0.95\n  learning_rate: 1e-3\n")
    values = hyperparameters_for("PPO", TASK, file, {"n_epochs": 4})
    assert (values["gamma"], values["n_epochs"], values["learning_rate"]) == (0.95, 4, 1e-3)
    assert values["rollout_steps"] == 16384
    assert hyperparameters_for("PPO", STEADY, file)["gamma"] == 0.9


def test_steps_between_updates_are_shared_by_the_copies_or_counted_for_each(tmp_path):
    file = tmp_path / "mine.yml"
    file.write_text("default: {n_steps: 64}\n")
    each = hyperparameters_for("PPO", TASK, file)
    assert each["n_steps"] == 64
    assert "rollout_steps" not in each
    over_all = hyperparameters_for("PPO", TASK, file, {"rollout_steps": 600})
    assert "n_steps" not in over_all
    assert [of_each_copy(over_all, n)["n_steps"] for n in (1, 8, 7, 1000)] == [600, 75, 85, 2]
    assert of_each_copy(each, 8)["n_steps"] == 64
    sac = hyperparameters_for("SAC", TASK, overrides={"update_every": 16})
    assert [of_each_copy(sac, n)["train_freq"] for n in (1, 8, 100)] == [16, 2, 1]
    assert replaced(TrainingConfig(hyperparameters=each).resolved, {"rollout_steps": 512}).keys() == over_all.keys()


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("default: [", "not valid YAML"),
        ("[1, 2]", "must map environment ids"),
        ("default: 5", "section 'default' of PPO: .* must be .* a mapping"),
        ("default:\n  gama: 0.9", "no option 'gama'; did you mean 'gamma'"),
        ("default:\n  tau: 0.9", "section 'default' of PPO: hyperparameters has no option 'tau'"),
        ("default: {n_steps: 64, rollout_steps: 512}", "steps must be given once, got rollout_steps .* and n_steps"),
        ("default:\n  learning_rate: lin_fast", "learning_rate must be a number .* or lin_"),
        ("default:\n  learning_rate: lin_true", "learning_rate must be a number .* or lin_"),
        ("default:\n  net_arch: []", "net_arch must have one to eight layers"),
        ("CartPole: {gamma: 0.9}", "sections must be 'default' or the id of an environment, got 'CartPole'"),
        ("default: !!python/object/apply:os.getcwd []", "not valid YAML"),
    ],
)
def test_files_that_are_refused(text, message, tmp_path):
    file = tmp_path / "mine.yml"
    file.write_text(text)
    with pytest.raises(ValueError, match=message) as caught:
        read_hyperparameters(file, "PPO", TASK)
    assert "\n" not in str(caught.value)
