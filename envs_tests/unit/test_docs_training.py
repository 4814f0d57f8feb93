"""The page about training: its examples run, its commands are accepted, its files exist."""

import doctest
import re
import shlex
from importlib import import_module
from pathlib import Path

import pytest

from wt_gym.agents.training.config import TrainingConfig
from wt_gym.agents.training.held_back import SELECTION_WIND_SEEDS
from wt_gym.agents.training.hyperparameters import ALGORITHMS, read_hyperparameters
from wt_gym.commands.training_options import config_from

ROOT = Path(__file__).resolve().parents[2]
PAGE = ROOT / "docs" / "training.md"
TEXT = PAGE.read_text(encoding="utf-8")
README = (ROOT / "README.md").read_text(encoding="utf-8")
BLOCKS = re.findall(r"^```(\w*)\n(.*?)^```", TEXT + README, re.MULTILINE | re.DOTALL)
LINES = [line for language, block in BLOCKS if not language for line in block.splitlines()]
COMMANDS = [line.split("#")[0].strip() for line in LINES if re.match(r"scripts/(train|search|evaluate)\.py", line)]
TRAINING, YAML = re.findall(r"```yaml\n(.*?)```", TEXT, re.DOTALL)


def test_examples_run():
    result = doctest.testfile(str(PAGE), module_relative=False, optionflags=doctest.NORMALIZE_WHITESPACE)
    assert result.attempted > 5
    assert result.failed == 0


def arguments_of(command):
    """What a script makes of a command."""
    script, *words = shlex.split(command)
    return import_module(f"wt_gym.commands.{Path(script).stem}").parse_arguments(words)


@pytest.mark.parametrize("command", dict.fromkeys(COMMANDS))
def test_commands_are_accepted(command, tmp_path):
    file = tmp_path / "training.yml"
    file.write_text(TRAINING)
    arguments = arguments_of(
        command.replace("--config mine.yml", f"--config {file}").replace("agents/", f"{ROOT}/agents/")
    )
    if "evaluate" in command or getattr(arguments, "resume", None):
        return
    if "hyperparameters" in arguments:
        arguments.hyperparameters = tmp_path / "mine.yml"
        arguments.hyperparameters.write_text(YAML)
    assert config_from(arguments).resolved["learning_rate"]


def test_commands_are_found():
    assert len(set(COMMANDS)) >= 10


def test_the_file_of_hyperparameters_can_be_read(tmp_path):
    file = tmp_path / "mine.yml"
    file.write_text(YAML)
    assert read_hyperparameters(file, "PPO", "wt_gym/FullRange-v1")["n_steps"] == 2048


def test_what_the_page_says_is_so():
    for path in set(re.findall(r"`((?:agents|scripts)/[\w/]+(?:\.\w+)?)`", TEXT)):
        assert (ROOT / path).exists(), path
    for name in ALGORITHMS:
        assert f"`{name.lower()}.yml`" in TEXT or f"/{name.lower()}.yml`" in TEXT
    seeds = re.search(r"`SELECTION_WIND_SEEDS`, (\d+) down to (\d+)", TEXT)
    assert (int(seeds[1]), int(seeds[2])) == (SELECTION_WIND_SEEDS[0], SELECTION_WIND_SEEDS[-1])
    defaults = TrainingConfig()
    assert f"`--eval-every` steps ({defaults.eval_every:,}".replace(",", " ") in TEXT
    assert f"`--checkpoint-steps` ({defaults.checkpoint_steps:,})".replace(",", " ") in TEXT
    assert "(docs/training.md)" in README
