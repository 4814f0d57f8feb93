"""The tables of the page about the baselines are those of the code and of the record."""

import re
from importlib import import_module
from pathlib import Path

import pytest

from validation.record import read_record
from wt_gym.control.controllers import (
    ADDITIONS,
    BASES,
    WRAPPERS,
    declared_parameters,
)

DOCS = Path(__file__).resolve().parents[2] / "docs"
PAGE = DOCS / "baselines.md"


def test_the_table_of_parameters_is_that_of_the_code(monkeypatch):
    pytest.importorskip("sphinx")  # of the package that fills the page
    monkeypatch.syspath_prepend(DOCS)
    text = import_module("site_parts.options").parameters()
    for name in (*BASES, *WRAPPERS, *ADDITIONS):
        for parameter in declared_parameters(name):
            assert f"| `{name}` | `{parameter.name}` | {parameter.unit} |" in text
            assert parameter.meaning in text


def test_the_tables_are_those_of_the_record():
    text, record = PAGE.read_text(encoding="utf-8"), read_record(DOCS / "data" / "validation.json")
    assert record["controllers"]["notes"] in text
    found = re.findall(
        r"(\d+) m/s: correlation (\S+), rms (\S+) m/s, mean error (\S+) m/s", record["wind-estimate"]["notes"]
    )
    assert len(found) == 3
    for wind, correlation, rms, mean in found:
        assert f"| {wind} m/s | {correlation} | {rms} m/s | {mean} m/s |" in text
