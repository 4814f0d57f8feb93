"""The page about evaluation: its examples run, its commands are accepted, its files and numbers are so."""

import doctest
import re
import shlex
from pathlib import Path

import pytest

from wt_gym.agents.choices import controller_of, is_controller_name
from wt_gym.agents.evaluation import DEFAULT_WIND_SEEDS, EvaluationConfig
from wt_gym.agents.evaluation_folder import CONFIGURATION_FILE, REPORT_FILE
from wt_gym.agents.sweep_record import SWEEP_FILE
from wt_gym.analysis.results import METRICS_FILE, RUNS_FOLDER, TABLE_FILE, run_file
from wt_gym.analysis.statistics import LEAST_PER_STRATUM, N_RESAMPLES
from wt_gym.commands import evaluate as command
from wt_gym.control.controllers import make_controller
from wt_gym.turbines import load_turbine

ROOT = Path(__file__).resolve().parents[2]
PAGE = ROOT / "docs" / "evaluation.md"
TEXT = PAGE.read_text(encoding="utf-8")
COMMANDS = re.findall(r"^ *(?:scripts/evaluate\.py|wt-gym evaluate) (.*)$", TEXT + command.__doc__, re.MULTILINE)


def test_examples_run():
    result = doctest.testfile(str(PAGE), module_relative=False, optionflags=doctest.NORMALIZE_WHITESPACE)
    assert result.attempted > 10
    assert result.failed == 0


@pytest.mark.parametrize("words", COMMANDS)
def test_commands_are_accepted(words):
    arguments = command.parse_arguments(shlex.split(words))
    turbine = load_turbine("nrel_5mw")
    for agent in arguments.agents:
        choice = agent.split("=", 1)[1] if "=" in agent and ":" not in agent.split("=")[0] else agent
        if is_controller_name(choice):
            name, parameters = controller_of(choice)
            make_controller(name, turbine, **parameters)


def test_commands_are_found():
    assert len(COMMANDS) >= 7


def test_what_the_page_says_is_so():
    for name in (CONFIGURATION_FILE, REPORT_FILE, METRICS_FILE, TABLE_FILE):
        assert f"| `{name}` |" in TEXT
    assert f"| `{RUNS_FOLDER}/{run_file('HASH', '<agent>').replace('_agent_', '<agent>')}` |" in TEXT
    assert f"| `{SWEEP_FILE}` |" in TEXT
    assert f"{N_RESAMPLES:,} bootstrap".replace(",", " ") in TEXT
    assert (LEAST_PER_STRATUM, len(DEFAULT_WIND_SEEDS)) == (3, 6)
    assert EvaluationConfig().skip == 30.0
    assert "(docs/evaluation.md)" in (ROOT / "README.md").read_text(encoding="utf-8")
