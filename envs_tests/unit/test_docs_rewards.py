"""The page about the rewards says what the code does and what the table of the study shows."""

import csv
import re
from pathlib import Path

import pytest
import reward_study as study

from wt_gym.envs import rewards
from wt_gym.envs.turbine_env import WindTurbineEnv

ROOT = Path(__file__).resolve().parents[2]
PAGE = (ROOT / "docs" / "rewards.md").read_text(encoding="utf-8")
KINDS = {"controller": str, "seed": int}


@pytest.fixture(scope="module")
def rows():
    with (ROOT / "docs" / "data" / "reward_study.csv").open(newline="", encoding="utf-8") as file:
        return [{key: KINDS.get(key, float)(value) for key, value in row.items()} for row in csv.DictReader(file)]


@pytest.fixture(scope="module")
def lifetimes(rows):
    return study.lifetime(row for row in rows if row["controller"] not in study.LIBRARY)


def against_cost(table, weights=None):
    return study.correlation([study.total_rate(row, weights) for row in table], [row["cost"] for row in table])


def test_weights_on_the_pages():
    listed = {name: float(weight) for name, weight in re.findall(r"^\| `(\w+)` \| ([\d.]+) \|", PAGE, re.MULTILINE)}
    assert listed == rewards.DEFAULT_WEIGHTS
    table = re.findall(r"^ *\| (\w+) +\| ([\d.]+) +\|", WindTurbineEnv.__doc__, re.MULTILINE)
    default = {name: weight for name, weight in rewards.DEFAULT_WEIGHTS.items() if weight > 0}
    assert {name: float(weight) for name, weight in table if name in rewards.DEFAULT_WEIGHTS} == default


def test_the_default_reward_ranks_the_controllers(rows, lifetimes):
    assert len(lifetimes) == 22
    assert len(rows) >= 23 * 3 * 2
    assert against_cost(lifetimes) <= -0.8
    runs = study.differences(row for row in rows if row["controller"] not in study.LIBRARY)
    assert against_cost(runs) <= -0.8


def test_figures_of_the_page(lifetimes):
    stated = re.search(r"default reward \| \*\*(\S+)\*\*", PAGE)
    assert float(stated[1].replace("−", "-")) == pytest.approx(against_cost(lifetimes), abs=0.0051)
    stated = re.search(r"earlier weights \| (\S+)", PAGE)
    assert float(stated[1].replace("−", "-")) == pytest.approx(
        against_cost(lifetimes, study.FORMER_WEIGHTS), abs=0.0051
    )


def test_figures_of_the_tasks(rows, lifetimes):
    """One row a reward: lifetime cost, then cost and energy in single winds."""
    runs = study.differences(row for row in rows if row["controller"] not in study.LIBRARY)
    shown, tasks = {}, study.task_weights()
    for names, *cells in re.findall(r"^\| ((?:`\w[\w-]+`(?:, )?)+)" + r" \| (\S+)" * 6 + r" \|$", PAGE, re.MULTILINE):
        for name in re.findall(r"`([\w-]+)`", names):
            shown[name] = [float(cell.replace("−", "-")) for cell in cells]
    assert set(shown) == set(tasks)
    for name, weights in tasks.items():
        found = [against_cost(lifetimes, weights)]
        for wind in (8.0, 12.0, 16.0):
            table = [row for row in runs if row["wind_speed"] == wind]
            found.append(against_cost(table, weights))
            if wind == 8.0:
                totals = [study.total_rate(row, weights) for row in table]
                energy = [study.correlation(totals, [row[key] for row in table]) for key in ("mean_power", "power")]
        assert shown[name] == pytest.approx([*found, *energy], abs=0.0051), name


@pytest.mark.parametrize(
    ("term", "load"),
    [("blade_fatigue", "flap"), ("tower_fore_aft_fatigue", "fore_aft"), ("tower_side_side_fatigue", "side_side")],
)
def test_each_fatigue_term_follows_its_load(lifetimes, term, load):
    assert study.correlation([row[term] for row in lifetimes], [row[load] for row in lifetimes]) < -0.65
