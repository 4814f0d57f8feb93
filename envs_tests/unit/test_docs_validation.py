"""Hand-written pages agree with the record of the validation: which cases fail, and tables copied from it."""

import json
import re
from pathlib import Path

import pytest

from validation.case import load_cases

ROOT = Path(__file__).resolve().parents[2]
RECORD = json.loads((ROOT / "docs" / "data" / "validation.json").read_text(encoding="utf-8"))["cases"]
FAILING = [name for name, case in RECORD.items() if not all(check["passed"] for check in case["checks"])]


def page(name):
    return (ROOT / "docs" / f"{name}.md").read_text(encoding="utf-8")


def section(text, heading):
    """What stands below a heading, up to the next one."""
    return re.search(rf"^## {re.escape(heading)}\n(.*?)(?=^## |\Z)", text, re.MULTILINE | re.DOTALL)[1]


def rows(text):
    """Cells of the rows of the tables in a text, without headings."""
    tables = re.findall(r"^\|[-|]+\|\n((?:\|.*\|\n)+)", text, re.MULTILINE)
    return [[cell.strip() for cell in line[1:-1].split(" | ")] for table in tables for line in table.splitlines()]


WHY = section(page("aerodynamics"), "What does not pass, and why")
NAMED = [name for row in rows(WHY) for name in re.findall(r"`([^`]+)`", row[0])]


@pytest.mark.parametrize("name", FAILING)
def test_every_case_with_a_failing_check_is_explained(name):
    assert name in NAMED


@pytest.mark.parametrize("name", NAMED)
def test_no_case_in_the_table_passes_whole(name):
    """A case that is not in the record may have failed when the page was written."""
    assert name in load_cases()
    assert name in FAILING or name not in RECORD


def test_the_table_is_read_at_all():
    assert len(NAMED) > 10
    assert len({*NAMED}) == len(NAMED)
    assert all(len(row) == 4 and all(row) for row in rows(WHY))


def copied(case):
    """Rows of numbers in the notes of a case: what is before the colon, and the numbers after it, as on the pages."""
    lines = [line.rsplit(": ", 1) for line in RECORD[case]["notes"].splitlines()[1:]]
    return [(name, numbers.replace("-", "−").split(", ")) for name, numbers in lines]


def test_table_of_coupled_formulations_is_that_of_the_record():
    """All but the time of a step, which is another one on each machine."""
    found = [row for row in rows(section(page("formulations"), "All of them in the environment")) if len(row) == 7]
    recorded = [(", ".join([name, *numbers[5:]]), numbers[1:5]) for name, numbers in copied("formulations-coupled")]
    assert [", ".join(row[:2]) for row in found] == [name for name, _ in recorded]  # and how it ended, if early
    for row, (_, numbers) in zip(found, recorded, strict=True):
        assert [cell.removesuffix(" %") for cell in row[3:]] == ["–" if x == "nan" else x for x in numbers]


def test_table_of_the_reduction_study_is_that_of_the_record():
    text = page("formulations").split("(`observer-turbine-reduction`)")[1].split("\n## ")[0]
    found, recorded = rows(text), copied("observer-turbine-reduction")
    assert [row[1:6] for row in found] == [numbers[:5] for _, numbers in recorded]


def test_the_steady_states_of_the_iea_22mw_are_those_of_the_record():
    notes = RECORD["iea22-steady"]["notes"].replace("-", "−").replace("−0.0 %", "0.0 %").replace("+0.0 %", "0.0 %")
    recorded = rows(notes.replace("−−−", "---"))
    found = rows(section(page("validation"), "Steady states of the IEA 22-MW"))
    assert len(recorded) == 10
    assert found == recorded
