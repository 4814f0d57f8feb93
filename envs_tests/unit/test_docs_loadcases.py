"""The page about load cases: its tables and the sizes of its sets are those of the code."""

import re
from pathlib import Path

import pytest

from wt_gym.agents.loadcases.cases import CASES, plan_of
from wt_gym.runs.definition import digest
from wt_gym.turbines import load_turbine

ROOT = Path(__file__).resolve().parents[2]
PAGE = ROOT / "docs" / "loadcases.md"
TEXT = PAGE.read_text(encoding="utf-8")


def test_every_case_stands_on_the_page_with_its_factor():
    section = TEXT.split("## What is run")[1].split("## ")[0]
    rows = dict(re.findall(r"^\| (\d\.\d) \|(?:[^|]*\|){3} (\d\.\d+) \|", section, re.MULTILINE))
    assert rows == {case: f"{kind.factor or 1.0}" for case, kind in CASES.items()}


@pytest.mark.parametrize(
    ("quick", "said"),
    [(False, r"Full set: (\d+) runs, (\d+) h (\d+) min"), (True, "quick set: (\\d+) runs, ()(\\d+) min")],
)
def test_the_size_of_the_sets_is_what_the_page_says(quick, said):
    turbine = load_turbine("nrel_5mw")
    conditions = {
        digest(c.to_json()): c for kind in CASES.values() for c in kind.conditions(turbine, plan_of(turbine, quick))
    }
    runs, hours, minutes = re.search(said, TEXT).groups()
    simulated = sum(condition.duration for condition in conditions.values())
    assert len(conditions) == int(runs)
    assert round(simulated / 60.0) == 60 * int(hours or 0) + int(minutes)
