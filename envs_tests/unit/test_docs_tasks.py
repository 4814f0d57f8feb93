"""The pages of the tasks: tables are those of the record, the record is of today's tasks."""

import re

import fault_study as FAULTS
import pytest
import task_scores as SCRIPT
from study_pages import TASK_PAGES as FOLDER
from study_pages import read_json
from task_scores import RANDOM, STUDIES, Part, Study, measure, score_table

from wt_gym.analysis.results import Wind
from wt_gym.envs.wind_sampler import GUSTS, TRAINING_WIND_SEEDS
from wt_gym.experiment import evaluation
from wt_gym.experiment.robustness import FAULT_CONDITIONS, NOMINAL
from wt_gym.tasks import TASKS

TASK_PAGES = {path.stem: path.read_text(encoding="utf-8") for path in sorted(FOLDER.glob("*.md"))}
del TASK_PAGES["index"]
RECORD = read_json(SCRIPT.RECORD)


@pytest.mark.parametrize("page", TASK_PAGES)
def test_tables_are_those_of_the_record(page):
    text = TASK_PAGES[page]
    assert SCRIPT.tables(text, RECORD) == text


def test_the_record_of_faults_has_every_condition():
    record = read_json(FAULTS.RECORD)
    met = {row["condition"] for row in record["runs"]}
    assert met == {NOMINAL, *FAULT_CONDITIONS} - set(FAULTS.WITHOUT_YAW)
    for agent in FAULTS.AGENTS:
        winds = [(row["condition"], row["wind"]) for row in record["runs"] if row["agent"] == agent]
        assert len(winds) == len(set(winds)) == 4 * len(met)


def test_every_task_has_its_page_and_every_study_its_table():
    titles = {re.match(r"# (\S+)\n", text)[1]: text for text in TASK_PAGES.values()}
    assert set(titles) == set(TASKS)
    for name, text in titles.items():
        assert f"`{TASKS[name].id}`" in text
        assert f"{TASKS[name].episode:g} s of {TASKS[name].arguments['control_dt']:g} s a step" in text
    shown = re.findall(r"<!-- scores: ([^>]+?) -->", "".join(TASK_PAGES.values()))
    assert sorted(shown) == sorted(TASKS)
    whole = (FOLDER.parent / "studies" / "tasks.md").read_text(encoding="utf-8")
    assert sorted(re.findall(r"<!-- generated: study scores ([^>]+?) -->", whole)) == sorted(STUDIES) == sorted(RECORD)


def test_the_table_of_a_page_is_short_and_a_part_of_the_whole():
    for name in TASKS:
        short, whole = (score_table(name, RECORD[name]["runs"], short) for short in (True, False))
        rows = [line.strip("| ").split(" | ") for line in short.splitlines()]
        assert {len(row) for row in rows[1:]} <= {2, 3, 4, 5, 6}
        assert len(rows) <= 2 + 8
        assert all(cell in whole for row in rows[2:] for cell in row)


@pytest.mark.parametrize("name", STUDIES)
def test_the_record_is_that_of_the_study(name):
    study, runs = STUDIES[name], RECORD[name]["runs"]
    recorded = RECORD[name]["env_id"]
    assert recorded.rpartition("-v")[0] == study.env_id.rpartition("-v")[0]
    assert [run["agent"] for run in runs] == [
        agent for part in study.parts for agent in study.agents for _ in part.winds
    ]
    for agent in study.agents:
        own = [run for run in runs if run["agent"] == agent]
        assert [run["speed"] for run in own] == [wind.speed for part in study.parts for wind in part.winds]
        assert [run["wind"] for run in own] == [run["wind"] for run in runs if run["agent"] == study.agents[0]]
    seeds = {wind.seed for part in study.parts for wind in part.winds} - {None}
    assert seeds.isdisjoint(TRAINING_WIND_SEEDS)
    if recorded == study.env_id:  # else the table names the earlier version, with its base controller
        assert study.agents[0] == TASKS[study.task].arguments.get("controller", "discon")


def test_gusts_of_every_kind_and_both_signs_were_met():
    runs = [run for run in RECORD["Gusts"]["runs"] if run["agent"] == "discon"]
    assert {run["part"] for run in runs} == set(GUSTS)
    forms = {"EDC": "turning ", "ECD": "turning ", "EWS-vertical at": "amplitude ", "EWS-horizontal at": "amplitude "}
    for form, before in forms.items():
        winds = [run["wind"] for run in runs if f"IEC {form}" in run["wind"]]
        assert {wind.split(before)[1].startswith("-") for wind in winds} == {True, False}, form
    assert all("seed" in run["wind"] for run in runs if run["part"] == "ETM")


def test_ranges_of_speeds_are_those_of_the_tasks():
    """Tables of a task are in its winds, unless their name says that they are not."""
    for name, study in STUDIES.items():
        if name in TASKS:
            low, high = TASKS[name].arguments["wind_speed"]
            speeds = [wind.speed for part in study.parts for wind in part.winds]
            assert low <= min(speeds) < max(speeds) <= high
            assert len(speeds) >= 4
            assert RANDOM in study.agents


def test_runs_that_ended_early_are_counted_and_not_compared():
    """Figures over the winds that both came through; the return of a short run counts whole, against as much time."""
    study = STUDIES["MaxPower"]
    winds = [wind.label for wind in study.parts[0].winds]

    def run(agent, wind, power, ending="time"):
        metrics = {column.key: 1e6 for column in study.columns} | {"corrected_power": power}
        made = {"agent": agent, "part": "", "wind": wind, "speed": 8.0, "ending": ending, "return": 330.0}
        made["duration"] = 330.0 if ending == "time" else 30.0
        return made | {"metrics": metrics if ending == "time" else {}}

    runs = [run(agent, wind, 1e6) for agent in study.agents if agent != "tsr_tracking" for wind in winds]
    runs += [run("tsr_tracking", wind, 1.1e6, "time" if k else "overspeed") for k, wind in enumerate(winds)]
    row = next(line for line in score_table("MaxPower", runs).splitlines() if "tsr_tracking" in line)
    assert "| +10.00 % | = |" in row
    assert f"| +{(330.0 - 30.0) / 6:.1f} | 5 of 6 |" in row


def test_a_scoring_that_was_stopped_goes_on_where_it_was(tmp_path, monkeypatch):
    """Two agents in two winds of some seconds: the second call makes only what the first one left."""
    study = Study(
        "LoadReduction", ("discon", RANDOM),
        (Part((Wind(12.0, 1001), Wind(16.0, 1001)), arguments={"start": "steady"}),), (STUDIES["Yaw"].columns[0],),
        duration=8.0, skip=2.0,
    )  # fmt: skip
    begun, player = [], evaluation.EpisodePlayer

    def stopped_at_the_fourth(env, agent, **more):
        begun.append(agent)
        if len(begun) == 4:
            raise KeyboardInterrupt
        return player(env, agent, **more)

    monkeypatch.setattr(evaluation, "EpisodePlayer", stopped_at_the_fourth)
    with pytest.raises(KeyboardInterrupt):
        measure(study, folder=tmp_path)
    runs = measure(study, folder=tmp_path)
    assert len(begun) == 5
    assert [(run["agent"], run["speed"]) for run in runs] == [
        ("discon", 12.0), ("discon", 16.0), (RANDOM, 12.0), (RANDOM, 16.0),
    ]  # fmt: skip
    assert measure(study, folder=tmp_path) == runs
    assert len(begun) == 5
    assert measure(study) == runs  # what is read is what was made
