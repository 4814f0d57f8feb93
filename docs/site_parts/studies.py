"""Results of the studies, from their records: the tables of docs/studies.

``docs/data/studies.json`` has tables that no script of ``scripts/studies`` makes; all others are made from their runs.
"""

import re

import ceiling
import dial_front
import fault_study
import pandas as pd
import reward_study
import task_scores
from study_pages import DATA, markdown, read_json, signed

from envs_tests.physics.validation import read_record
from wt_gym.envs.rewards import DEFAULT_WEIGHTS
from wt_gym.experiment.benchmark import leaderboard as scored
from wt_gym.experiment.benchmark import to_markdown
from wt_gym.experiment.benchmark_archive import opened
from wt_gym.experiment.benchmark_tasks import ceiling_of, load_task, task_names


def study(name, *words):
    """Table of a study, or for a name of the script that makes it, its table."""
    return f"{MAKERS[name](*words) if name in MAKERS else stored(name)}\n"


def stored(name):
    """Table of ``studies.json``."""
    headings, *rows = read_json(DATA / "studies.json")[name]
    return markdown(headings, rows)


def noted(case):
    """Table in the notes of a validation case, one for each value of its first column."""
    head, _, *rows = read_record(DATA / "validation.json")[case]["notes"].splitlines()
    headings, cells = _cells(head), [_cells(row) for row in rows]
    parts = {}
    for first, *rest in cells:
        parts.setdefault(first, []).append(rest)
    return "\n\n".join(f"**{headings[0]} {first}**\n\n{markdown(headings[1:], own)}" for first, own in parts.items())


def _cells(row):
    return [cell.strip() for cell in row.strip("| ").split(" | ")]


def steady(case):
    """Steady states of a case and their differences from published ones: a table a quantity."""
    head, _, *rows = re.findall(r"^\|.*$", read_record(DATA / "validation.json")[case]["notes"], re.MULTILINE)
    headings, cells = _cells(head), [_cells(row) for row in rows]
    own = [k for k, name in enumerate(headings) if k and name not in ("OpenFAST", "HAWC2")]
    return "\n\n".join(
        markdown([headings[0], *headings[k : k + 3]], [[row[0], *row[k : k + 3]] for row in cells]) for k in own
    )


def listed(case):
    """Numbers in the notes of a validation case, a row a line."""
    _, *lines = read_record(DATA / "validation.json")[case]["notes"].splitlines()
    size, rows = len(LISTED[case]) - 1, []
    for name, numbers in (line.rsplit(": ", 1) for line in lines):
        cells = numbers.replace("nan", "–").split(", ")
        rows.append([", ".join([name, *cells[size:]]), *cells[:size]])  # behind the numbers is how a run ended
    return markdown(LISTED[case], rows)


def estimated():
    """Estimated against rotor-effective wind."""
    pattern = r"(\d+ m/s): correlation (\S+), rms (\S+ m/s), mean error (\S+ m/s)"
    found = re.findall(pattern, read_record(DATA / "validation.json")["wind-estimate"]["notes"])
    return markdown(["wind", "correlation", "rms error", "mean error"], found)


def scores(*words):
    """Whole table of a task."""
    name = " ".join(words)
    return task_scores.score_table(name, read_json(task_scores.RECORD)[name]["runs"])


def kinds(name, key):
    """Largest of a metric in each part of a study."""
    return task_scores.kinds_table(name, key, read_json(task_scores.RECORD)[name]["runs"])


def kept():
    """Gain that is kept with a fault: a table an agent."""
    headings, _, *rows = fault_study.table(read_json(fault_study.RECORD)).splitlines()
    head, cells = _cells(headings), [_cells(row) for row in rows]
    tables = []
    for k in range(2, len(head), 3):
        name = re.match(r"(`.*`)", head[k])[1]
        own = markdown(["fault", "gain", "kept", "flap DEL"], [[row[0], *row[k : k + 3]] for row in cells])
        tables.append(f"**{name}**\n\n{own}")
    return "\n\n".join(tables)


def leaderboard():
    """Scores of all runs of the archive."""
    with opened(DATA / "leaderboard.tar.xz") as (folder, _):
        return to_markdown(scored(list(folder)))


def ceilings():
    """Ceilings of the benchmark's tasks."""
    found = {load_task(name).id: ceiling_of(load_task(name)) for name in task_names()}
    return ceiling.ceiling_table({name: one for name, one in found.items() if one is not None})


def rewards(part):
    """Correlations of the terms with loads and cost, or the controllers with their lifetimes."""
    result = reward_study.analyze(pd.read_csv(reward_study.RECORD), DEFAULT_WEIGHTS)
    if part == "correlations":
        found = reward_study.correlations(result["lifetimes"])
        found = found.rename(index={"total": "default reward", "former_total": "earlier weights"})
        columns = ["cost", *(name for name in found.columns if name != "cost")]
        rows = [[name, *(signed(found.loc[name, key], 2) for key in columns)] for name in found.index]
        return markdown(["", *columns], rows)
    library = result["library"].assign(controller=lambda x: x["controller"] + " (library)")
    table = pd.concat([result["lifetimes"], library])
    columns = ["flap", "fore_aft", "side_side", "mean_power", "pitch_duty", "cost"]
    rows = [
        [row["controller"], *(signed(100.0 * row[key], 1) for key in columns), signed(row["total"], 4)]
        for _, row in table.sort_values("cost").iterrows()
    ]
    return markdown(["controller", *(f"{key} [%]" for key in columns), "reward [1/s]"], rows)


LISTED = {
    "formulations-coupled": ["formulation", "ms a step", "power [%]", "flap DEL [%]", "tip [%]", "frequencies [%]"],
    "observer-turbine-reduction": [
        "blade", "tip, mean u/L", "largest", "root moment [MN m]", "largest", "DEL [MN m]", "step [ms]",
    ],
}  # fmt: skip
"""Headings of the tables of `listed`."""

MAKERS = {
    "noted": noted,
    "listed": listed,
    "steady": steady,
    "estimated": estimated,
    "scores": scores,
    "kinds": kinds,
    "kept": kept,
    "leaderboard": leaderboard,
    "ceilings": ceilings,
    "rewards": rewards,
    "dial": lambda: dial_front.tables(read_json(dial_front.RECORD)),
}
