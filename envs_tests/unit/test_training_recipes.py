"""Recommended trainings: one a task, as the command reads them."""

import gymnasium as gym
import pytest

from wt_gym.commands import parse as parse_command
from wt_gym.commands.train import configuration
from wt_gym.learning.hyperparameters import recipe_file, recipe_names
from wt_gym.learning.options import PretrainingOptions
from wt_gym.tasks import DEFAULT_ENV, TASKS


@pytest.mark.parametrize("name", recipe_names())
def test_a_recipe_is_a_training_of_its_task(name):
    env_id = TASKS[name].id
    arguments = parse_command("train", ["--recipe", "--env", env_id])
    config = configuration(arguments)
    assert config.env_id == env_id
    assert config.seed == 0
    assert config.total_steps > 0 or config.pretraining is not None
    assert arguments.out.startswith("runs/")
    with gym.make(env_id, **config.env_kwargs) as env:
        assert env.action_space.shape[0] > 0
    assert recipe_file(env_id).read_text().startswith(f"# Recommended training: wt-gym train --recipe --env {env_id}")


def test_recipes_have_folders_of_their_own():
    folders = [parse_command("train", ["--recipe", "--env", TASKS[name].id]).out for name in recipe_names()]
    assert len(set(folders)) == len(folders)


def test_typed_options_come_after_the_recipe():
    arguments = parse_command("train", ["--recipe", "--wind-speed", "15", "--out", "mine", "--seeds", "1", "2"])
    config = configuration(arguments)
    assert (config.env_id, arguments.out, arguments.seeds) == (DEFAULT_ENV, "mine", [1, 2])
    assert config.env_kwargs["wind_speed"] == 15.0
    assert config.pretraining is not None


def test_typed_options_of_a_pretraining_take_the_place_of_single_ones():
    """``--pretrain`` without options keeps those of the recipe."""
    words = ["--recipe", "--env", TASKS["IEA22MW-LoadReduction"].id]
    recipe = configuration(parse_command("train", words)).pretraining
    assert recipe["episodes"] == PretrainingOptions().episodes
    assert configuration(parse_command("train", [*words, "--pretrain"])).pretraining == recipe
    changed = configuration(parse_command("train", [*words, "--pretrain", "rounds=3"])).pretraining
    assert changed == recipe | {"rounds": 3}


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--env", "wt_gym/LoadReduction-v1"], r"did you mean '?wt_gym/LoadReduction-v3"),
        (["--env", "LoadReduction"], "must be one of .*wt_gym/LoadReduction-v3"),
    ],
)
def test_environments_without_a_recipe_are_refused(words, message):
    with pytest.raises(SystemExit, match=message):
        parse_command("train", ["--recipe", *words])
