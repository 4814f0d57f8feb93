"""Pages of the documentation: their examples run, their commands are accepted, what they say is that of the code.

Tables that are compared with records and figures that are computed anew stand in the other files ``test_docs_*``.
"""

import doctest
import re
import shlex
from functools import cache
from importlib import import_module
from pathlib import Path

import gymnasium as gym
import pytest

from wt_gym.agents.evaluation import DEFAULT_WIND_SEEDS, EvaluationConfig
from wt_gym.agents.evaluation_folder import CONFIGURATION_FILE, REPORT_FILE
from wt_gym.agents.loadcases.cases import CASES
from wt_gym.agents.loadcases.study import LoadCaseConfig
from wt_gym.agents.names import controller_of, is_controller_name
from wt_gym.agents.training.config import TrainingConfig
from wt_gym.agents.training.hyperparameters import ALGORITHMS, read_hyperparameters
from wt_gym.agents.training.selection import SELECTION_WIND_SEEDS
from wt_gym.analysis.results import METRICS_FILE, RUNS_FOLDER, TABLE_FILE, run_file
from wt_gym.analysis.statistics import LEAST_PER_STRATUM, N_RESAMPLES
from wt_gym.commands import evaluate, loadcases
from wt_gym.commands.training_options import config_from
from wt_gym.control.controllers import CONTROLLERS, controller_parameters, make_controller
from wt_gym.control.controllers import controller as contract
from wt_gym.runs.store import SWEEP_FILE
from wt_gym.turbines import load_turbine

ROOT = Path(__file__).resolve().parents[2]
# pages in docs/ with their number of examples, at least
EXAMPLES = {"ray": 6, "training": 6, "baselines": 1, "evaluation": 11, "loadcases": 5}


@cache
def text_of(page):
    return (ROOT / page).read_text(encoding="utf-8")


TRAINING, YAML = re.findall(r"```yaml\n(.*?)```", text_of("docs/training.md"), re.DOTALL)


NAMES = ("train", "search", "evaluate", "loadcases", "benchmark")
CALL = re.compile(rf"^ *(?:scripts/|wt-gym )({'|'.join(NAMES)})(?:\.py)?((?: [^#\n]*)?)", re.MULTILINE)


def commands():
    """Lines that call a script or a command: name and arguments."""
    pages = [ROOT / "README.md", *(ROOT / "docs").glob("*.md"), *(ROOT / "docs" / "tasks").glob("*.md")]
    texts = [page.read_text(encoding="utf-8") for page in sorted(pages)] + [evaluate.__doc__, loadcases.__doc__]
    return sorted({(name, words.strip()) for text in texts for name, words in CALL.findall(text)})


COMMANDS = commands()


@pytest.mark.parametrize("page", EXAMPLES)
def test_examples_run(page):
    path = str(ROOT / "docs" / f"{page}.md")
    result = doctest.testfile(path, module_relative=False, optionflags=doctest.NORMALIZE_WHITESPACE)
    assert result.attempted >= EXAMPLES[page]
    assert result.failed == 0


def test_examples_of_the_contract_of_controllers_run():
    assert doctest.testmod(contract).failed == 0


@pytest.mark.parametrize(("name", "words"), COMMANDS)
def test_commands_are_accepted(name, words, tmp_path):
    """With the controllers and the training that they name."""
    file = tmp_path / "training.yml"
    file.write_text(TRAINING)
    words = words.replace("--config mine.yml", f"--config {file}").replace("agents/", f"{ROOT}/agents/")
    arguments = import_module(f"wt_gym.commands.{name}").parse_arguments(shlex.split(words))
    if isinstance(getattr(arguments, "env", None), str):
        assert arguments.env in gym.registry
    if name in ("evaluate", "loadcases"):
        for agent in arguments.agents:
            choice = agent.split("=", 1)[1] if "=" in agent and ":" not in agent.split("=")[0] else agent
            if is_controller_name(choice):
                controller, parameters = controller_of(choice)
                make_controller(controller, load_turbine("nrel_5mw"), **parameters)
    if name == "loadcases":
        assert loadcases.configuration(arguments).quick == ("--quick" in words)
    if name in ("train", "search") and not getattr(arguments, "resume", None):
        if "hyperparameters" in arguments:
            arguments.hyperparameters = tmp_path / "mine.yml"
            arguments.hyperparameters.write_text(YAML)
        assert config_from(arguments).resolved["learning_rate"]


def test_commands_are_found():
    names = [name for name, _ in COMMANDS]
    assert all(names.count(name) >= number for name, number in zip(NAMES, (20, 1, 12, 8, 2), strict=True)), names


def spaced(number):
    return f"{number:,}".replace(",", " ")


SAID = [
    ("README.md", *(f"(docs/{page}.md)" for page in ("ray", "training", "evaluation", "loadcases"))),
    ("docs/baselines.md", *(f"| `{name}` |" for name in CONTROLLERS), "\n<!-- generated: parameters -->\n"),
    (
        "docs/training.md",
        *(f"{name.lower()}.yml`" for name in ALGORITHMS),
        f"`SELECTION_WIND_SEEDS`, {SELECTION_WIND_SEEDS[0]} down to {SELECTION_WIND_SEEDS[-1]}",
        f"`--eval-every` steps ({spaced(TrainingConfig().eval_every)}",
        f"`--checkpoint-steps` ({spaced(TrainingConfig().checkpoint_steps)})",
    ),
    (
        "docs/evaluation.md",
        *(f"| `{name}` |" for name in (CONFIGURATION_FILE, REPORT_FILE, METRICS_FILE, TABLE_FILE, SWEEP_FILE)),
        f"| `{RUNS_FOLDER}/{run_file('HASH', '<agent>').replace('_agent_', '<agent>')}` |",
        f"{spaced(N_RESAMPLES)} bootstrap",
    ),
]


@pytest.mark.parametrize(("page", "words"), [(page, word) for page, *words in SAID for word in words])
def test_the_page_says_what_the_code_does(page, words):
    assert words in text_of(page)


@pytest.mark.parametrize("page", ["README.md", "docs/training.md"])
def test_files_are_there(page):
    for path in set(re.findall(r"`?((?:agents|scripts)/[\w/]+(?:\.\w+)?)`", text_of(page))):
        assert (ROOT / path).exists(), path


def test_defaults_that_pages_name():
    assert (LEAST_PER_STRATUM, len(DEFAULT_WIND_SEEDS), EvaluationConfig().skip) == (3, 6, 30.0)
    assert LoadCaseConfig().cases == tuple(CASES)
    assert all(controller_parameters(name) is not None for name in CONTROLLERS)


def test_the_file_of_hyperparameters_can_be_read(tmp_path):
    file = tmp_path / "mine.yml"
    file.write_text(YAML)
    assert read_hyperparameters(file, "PPO", "wt_gym/FullRange-v1")["n_steps"] == 2048
