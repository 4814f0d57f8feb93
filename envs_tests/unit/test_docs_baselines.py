"""The page about the baselines: its examples run, and it names every controller."""

import doctest
from pathlib import Path

import pytest

from wt_gym.control.controllers import CONTROLLERS, controller_parameters
from wt_gym.control.controllers import controller as contract

PAGE = Path(__file__).resolve().parents[2] / "docs" / "baselines.md"


def test_examples_run():
    result = doctest.testfile(str(PAGE), module_relative=False, optionflags=doctest.NORMALIZE_WHITESPACE)
    assert result.attempted > 0
    assert result.failed == 0


def test_examples_of_the_contract_run():
    assert doctest.testmod(contract).failed == 0


@pytest.mark.parametrize("name", CONTROLLERS)
def test_every_controller_stands_on_the_page(name):
    assert f"| `{name}` |" in PAGE.read_text(encoding="utf-8")
    assert controller_parameters(name) is not None
