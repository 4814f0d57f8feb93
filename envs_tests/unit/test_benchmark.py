"""The benchmark without a simulator: tasks, fingerprint, scores, reference numbers, results on disk, the table."""

import dataclasses
import hashlib
import json
import re
from pathlib import Path

import numpy as np
import pytest

from wt_gym.base.errors import BenchmarkError
from wt_gym.commands import benchmark as command
from wt_gym.commands import run as run_command
from wt_gym.control.bladed import rosco_library
from wt_gym.envs.wind_sampler import EVALUATION_WIND_SEEDS, TRAINING_WIND_SEEDS
from wt_gym.experiment import benchmark as benchmark_runs
from wt_gym.experiment import benchmark_tasks
from wt_gym.experiment.benchmark import (
    ResultFolder,
    entries_of,
    entry_of,
    into_page,
    jobs_of,
    leaderboard,
    score,
    to_markdown,
)
from wt_gym.experiment.benchmark_tasks import (
    BenchmarkTask,
    Reference,
    load_task,
    make_reference,
    reference_of,
    task_file,
    task_names,
    write_reference,
)
from wt_gym.experiment.names import INTERFACE, LEVELS
from wt_gym.experiment.store import run_digest

TASK = load_task("load-reduction-15")
PAGE = (Path(__file__).resolve().parents[2] / "docs" / "benchmark.md").read_text(encoding="utf-8")
PRINT = {"turbine": "a", "fidelity": "b", "code": "c"}
BASE = {
    "captured_power": 5e6, "blade_flap_del": 6e6, "blade_edge_del": 6e6, "tower_fore_aft_del": 1.5e7,
    "tower_side_side_del": 5e6, "pitch_duty_cycle": 0.05, "torque_rate": 400.0, "rotor_speed_ratio_max": 1.06,
    "pitch_travel": 3.0, "tracking_rms": 4e4, "demanded_energy": 0.99,
}  # fmt: skip


def baseline_of(task):
    """Metrics of the baseline in every wind, other ones in each."""
    return {
        wind.label: {key: value * (1.0 + 0.01 * k) for key, value in BASE.items()} for k, wind in enumerate(task.winds)
    }


def results(task, changes=None, ending="time", fingerprint=PRINT, agent="agent"):
    """Results whose metrics differ by factors from the baseline's."""
    changed = {}
    for label, metrics in baseline_of(task).items():
        wind = next(wind for wind in task.winds if wind.label == label)
        definition = {"task": task.name, "version": task.version, "wind": wind.definition, "agent": {"name": agent}}
        changed[label] = {
            "definition": definition | {"fingerprint": fingerprint},
            "agent": agent,
            "ending": ending,
            "metrics": {key: value * (changes or {}).get(key, 1.0) for key, value in metrics.items()},
        }
    return changed


@pytest.fixture
def reference():
    return make_reference(TASK, results(TASK), {"better": results(TASK, {"blade_flap_del": 0.8})})


@pytest.mark.parametrize("name", task_names())
def test_tasks_keep_the_rules(name):
    task = load_task(name)
    seeds = {wind.seed for wind in task.winds if wind.transient is None}
    assert seeds <= set(EVALUATION_WIND_SEEDS) - set(TRAINING_WIND_SEEDS)
    assert len(seeds) >= 6 or all(wind.transient for wind in task.winds)
    assert task.id == f"{name}-v{task.version}"
    assert all(term.weight < 0 for term in task.terms if term.metric == "captured_power")
    limited = {limit.metric for limit in task.limits}
    assert "rotor_speed_ratio_max" in limited
    assert limited & {"captured_power", "demanded_energy"}
    assert [entry.name for entry in entries_of(task.measures)] == list(task.measures)
    assert entries_of([task.baseline])[0].definition["kind"] == "controller"


def test_the_digest_follows_what_scores_depend_on():
    values = json.loads(task_file("load-reduction-15").read_text(encoding="utf-8"))
    same = BenchmarkTask.from_json(values | {"goal": "another text", "reference": None})
    assert same.digest == TASK.digest
    other = BenchmarkTask.from_json(values | {"duration": 599.0})
    assert other.digest != TASK.digest


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"extra": 1}, r"unknown \['extra'\]"),
        ({"skip": 600.0}, "skip must be"),
        ({"clip": [0.0, 100.0]}, "clip must be"),
        ({"winds": [{"speed": 15.0, "seeds": [1, 2, 3]}]}, "winds must be at least 6 different ones"),
        ({"winds": [{"speed": 15.0, "seeds": [1] * 6}]}, "winds must be at least 6 different ones"),
        ({"winds": [{"speed": 15.0, "transient": "tornado"}]}, "seeds or one of"),
        ({"terms": {"blade_flap_del": {"scale": 1.0}}}, "must have a weight"),
        ({"limits": {"captured_power": {"about": 1.0}}}, "must be one of least, most"),
    ],
)
def test_files_without_meaning_are_refused(wrong, message):
    values = json.loads(task_file("load-reduction-15").read_text(encoding="utf-8"))
    with pytest.raises(BenchmarkError, match=message):
        BenchmarkTask.from_json(values | wrong)


def test_the_baseline_scores_zero_and_the_best_a_hundred(reference):
    zero = score(TASK, results(TASK), reference)
    assert (zero.score, zero.low, zero.high, zero.better) == (0.0, 0.0, 0.0, 0.0)
    best = score(TASK, results(TASK, {"blade_flap_del": 0.8}), reference)
    assert best.score == pytest.approx(100.0)
    assert best.better == 1.0
    assert reference.best_improvement == pytest.approx(0.2 * 0.2)


@pytest.mark.parametrize(
    ("metric", "factors"),
    [
        *((metric, (1.2, 1.1, 1.0, 0.95, 0.9)) for metric in (
            "blade_flap_del", "tower_fore_aft_del", "tower_side_side_del", "pitch_duty_cycle", "torque_rate")),
        ("captured_power", (0.996, 1.0, 1.01)),
    ],
)  # fmt: skip
def test_scores_rise_with_power_and_fall_with_every_load_and_every_use(reference, metric, factors):
    found = [score(TASK, results(TASK, {metric: factor}), reference).score for factor in factors]
    assert np.all(np.diff(found) > 0.0)
    assert found[factors.index(1.0)] == 0.0


def test_scores_are_clipped(reference):
    loads = ("blade_flap_del", "tower_fore_aft_del", "tower_side_side_del", "blade_edge_del")
    assert score(TASK, results(TASK, dict.fromkeys(loads, 0.01)), reference).score == TASK.clip[1]
    assert score(TASK, results(TASK, dict.fromkeys(loads, 9.0)), reference).score == TASK.clip[0]


@pytest.mark.parametrize(
    ("changes", "ending", "broken"),
    [
        ({"blade_flap_del": 0.5, "captured_power": 0.994}, "time", "captured_power"),
        ({"blade_flap_del": 0.5, "rotor_speed_ratio_max": 1.1}, "time", "rotor_speed_ratio_max"),
        ({"blade_flap_del": 0.5}, "standstill", "standstill"),
        ({}, "failure", "failure"),
    ],
)
def test_broken_limits_and_early_ends_get_the_least_score(reference, changes, ending, broken):
    found = score(TASK, results(TASK, changes, ending), reference)
    assert found.score == TASK.clip[0]
    assert {wind.broken for wind in found.winds} == {(broken,)}


def test_what_the_baseline_does_itself_is_no_offense():
    base = {"rotor_speed_ratio_max": 1.12}  # times 1.06 is above the limit
    reference = make_reference(TASK, results(TASK, base), {"x": results(TASK, base | {"blade_flap_del": 0.9})})
    assert score(TASK, results(TASK, base), reference).score == 0.0
    found = score(TASK, results(TASK, {"rotor_speed_ratio_max": 1.13}), reference)
    assert found.score == TASK.clip[0]


def test_one_bad_wind_pulls_down_its_share(reference):
    mixed = results(TASK, {"blade_flap_del": 0.8})
    first = TASK.winds[0].label
    mixed[first] = mixed[first] | {"ending": "overspeed", "metrics": {}}
    found = score(TASK, mixed, reference)
    assert found.score == pytest.approx((5 * 100.0 - 100.0) / 6)
    assert found.low < found.score < found.high
    assert found.better == pytest.approx(5 / 6)


def test_winds_are_weighted():
    task = load_task("full-range")
    reference = make_reference(task, results(task), {"x": results(task, {"blade_flap_del": 0.9})})
    mixed = results(task)
    for wind in task.winds:
        if wind.speed == 8.0:
            mixed[wind.label] = results(task, {"blade_flap_del": 0.9})[wind.label]
    found = score(task, mixed, reference)
    assert found.score == pytest.approx(100.0 * 0.30 / 0.74)
    # drawn within the wind speeds: where all winds of a speed agree, nothing is uncertain
    assert (found.low, found.high) == pytest.approx((found.score, found.score))


def test_other_fingerprints_are_refused_with_the_way_out(reference):
    made = results(TASK, fingerprint=PRINT | {"code": "x", "turbine": "y"})
    with pytest.raises(BenchmarkError, match=r"another code and turbine .* reference --task load-reduction-15"):
        score(TASK, made, reference)


def test_other_versions_and_missing_winds_are_refused(reference):
    made = results(dataclasses.replace(TASK, version=1))
    with pytest.raises(BenchmarkError, match=r"load-reduction-15-v1 has no score in load-reduction-15-v3"):
        score(TASK, made, reference)
    made = results(TASK)
    del made[TASK.winds[3].label]
    with pytest.raises(BenchmarkError, match=f"no result in 1 winds, the first is {TASK.winds[3].label}"):
        score(TASK, made, reference)


def test_tasks_without_reference_or_changed_since_are_refused(reference):
    with pytest.raises(BenchmarkError, match="has no reference numbers yet"):
        reference_of(dataclasses.replace(TASK, reference=None))
    changed = dataclasses.replace(TASK, reference=dataclasses.asdict(reference), digest="0" * 16)
    with pytest.raises(BenchmarkError, match="another definition of the task"):
        reference_of(changed)


def test_references_need_a_baseline_that_lasts_and_a_better_agent():
    better = results(TASK, {"blade_flap_del": 0.9})
    with pytest.raises(
        BenchmarkError,
        match=r"baseline controller must complete every wind, it ended in 15 m/s, seed 1007 \(overspeed\)",
    ):
        make_reference(TASK, results(TASK, ending="overspeed"), {"x": better})
    with pytest.raises(BenchmarkError, match="no candidate is better"):
        make_reference(TASK, results(TASK), {"x": results(TASK, {"blade_flap_del": 1.1})})


def test_the_best_known_keeps_the_limits():
    loses = results(TASK, {"blade_flap_del": 0.3, "captured_power": 0.9})
    made = make_reference(TASK, results(TASK), {"loses": loses, "x": results(TASK, {"blade_flap_del": 0.9})})
    assert (made.best_agent, made.improvements["loses"]) == ("x", None)


def test_writing_a_reference_changes_nothing_else(tmp_path, reference):
    path = tmp_path / "task.json"
    values = json.loads(task_file(TASK.name).read_text(encoding="utf-8"))
    path.write_text(json.dumps(values | {"reference": None}), encoding="utf-8")
    write_reference(TASK, reference, path)
    written = json.loads(path.read_text(encoding="utf-8"))
    assert Reference(**written.pop("reference")) == reference
    assert written == {key: value for key, value in values.items() if key != "reference"}
    assert [file.name for file in tmp_path.iterdir()] == ["task.json"]


def test_results_are_kept_by_what_defines_them(tmp_path):
    folder, (first, *_) = ResultFolder(tmp_path / "new"), results(TASK).values()
    folder.keep(first["definition"], first)
    assert list(folder) == [folder.read(first["definition"])] == [first]
    assert run_digest(first["definition"]) in folder.file(first["definition"]).name
    assert run_digest(dict(reversed(first["definition"].items()))) == run_digest(first["definition"])
    assert run_digest(first["definition"] | {"agent": {"name": "other"}}) != run_digest(first["definition"])


@pytest.fixture
def with_reference(monkeypatch, reference):
    task = dataclasses.replace(TASK, reference=dataclasses.asdict(reference))
    monkeypatch.setattr("wt_gym.experiment.benchmark.load_task", lambda name: task)


def test_the_table_ranks_agents_and_says_why_some_have_no_score(with_reference):
    rows = [
        *results(TASK, agent="none").values(),
        *results(TASK, {"blade_flap_del": 0.8}, agent="good").values(),
        *results(TASK, {"blade_flap_del": 0.8, "captured_power": 0.9}, agent="lossy").values(),
        *list(results(TASK, agent="part").values())[:2],
        *results(TASK, agent="old", fingerprint=PRINT | {"code": "x"}).values(),
    ]
    board = leaderboard(rows)
    found = board["tasks"][TASK.name]
    assert [row["agent"] for row in found[:3]] == ["good", "none", "lossy"]
    assert {row["agent"] for row in found[3:]} == {"part", "old"}
    assert found[0]["changes"]["blade_flap_del"] == pytest.approx(-0.2)
    text = to_markdown(board)
    assert "| good | 100.0 | 100.0 … 100.0 | 100 % | +0.0 % | -20.0 % |" in text
    assert "captured_power × 6" in text
    assert "| part | – | – | 2 of 6 winds run |" in text
    assert "another code than the reference" in text
    json.dumps(board, allow_nan=False)


def test_tables_find_their_place_in_a_page():
    blank = "a page\n\n<!-- leaderboard -->\n\n<!-- end of the leaderboard -->\n"
    page = into_page("first\n", blank)
    assert "\n\nfirst\n\n<!-- end of the leaderboard -->" in page
    again = into_page("second\n", page)
    assert "first\n\n<!--" not in again
    assert again == into_page("second\n", blank)
    with pytest.raises(BenchmarkError, match="no place for a table"):
        into_page("first\n", "a page")


def test_results_of_unknown_tasks_are_refused():
    (first, *_) = results(TASK).values()
    with pytest.raises(BenchmarkError, match=r"tasks of results must be among .*, got other"):
        leaderboard([first | {"definition": first["definition"] | {"task": "other"}}])


def test_entries_of_words():
    names = [entry.name for entry in entries_of(["baselines", "ipc"])]
    assert names.count("ipc") == 1
    assert {"zero", "random", "discon", "retuned"} < set(names)
    assert sum(name.startswith("constrained_ipc") for name in names) == len(LEVELS) == 5
    entry = entry_of("mine=constrained_ipc:level=0.1,limit=0.05")
    assert (entry.name, entry.choice) == ("mine", "constrained_ipc:level=0.1,limit=0.05")
    assert entry.interface["controller"] == ["constrained_ipc", {"level": 0.1, "limit": 0.05}]
    assert entry_of("planner:horizon=1.0").definition["parameters"] == {"horizon": 1.0}
    with pytest.raises(ValueError, match=r"horizon must be a number .* at most 600 s"):  # before anything is compiled
        entry_of("planner:horizon=1e9")


def test_an_entry_of_rosco_is_known_by_its_library():
    """Two releases of the package are two agents."""
    pytest.importorskip("rosco", reason="the package rosco is not installed")
    (digest,) = entry_of("rosco").definition["sha256"]
    assert digest == hashlib.sha256(rosco_library().read_bytes()).hexdigest()
    assert "rosco" in [entry.name for entry in entries_of(["baselines"])]


def test_two_agents_of_one_name_are_refused():
    with pytest.raises(ValueError, match="two agents are called 'a'"):
        entries_of(["a=ipc", "a=retuned"])


@pytest.fixture
def sweeps(monkeypatch):
    """The jobs of each sweep; nothing is simulated: whatever is not the baseline lowers the flap DEL by a tenth."""
    asked, run_jobs = [], benchmark_runs.run_jobs

    def run(self, job):
        found = results(job.task, {} if job.entry.choice == job.task.baseline else {"blade_flap_del": 0.9})[
            job.wind.label
        ]
        return found | {"definition": job.definition, "agent": job.entry.name, "wall_seconds": 0.1}

    def note(jobs, *more):
        asked.append(jobs)
        return run_jobs(jobs, *more)

    monkeypatch.setattr(benchmark_runs._BenchmarkRuns, "__call__", run)
    monkeypatch.setattr(benchmark_runs, "run_jobs", note)
    return asked


def test_runs_that_will_have_no_score_are_warned_of_before_the_first(sweeps, monkeypatch, tmp_path, capsys):
    made = make_reference(TASK, results(TASK), {"ipc": results(TASK, {"blade_flap_del": 0.9})})
    present = jobs_of([TASK], entries_of(["zero"]))[0].definition["fingerprint"]
    fits = dataclasses.asdict(dataclasses.replace(made, fingerprint=present))
    older = dataclasses.asdict(dataclasses.replace(made, fingerprint=present | {"turbine": "x", "code": "y"}))
    said, run_jobs = [], benchmark_runs.run_jobs
    monkeypatch.setattr(benchmark_runs, "run_jobs", lambda *a: said.append(capsys.readouterr().err) or run_jobs(*a))
    for number, reference in enumerate((fits, older, None)):
        task = dataclasses.replace(TASK, reference=reference)
        monkeypatch.setattr(command, "chosen", lambda names, task=task: [task])
        run_command("benchmark", ["run", "zero", "--out", str(tmp_path / str(number))])
        capsys.readouterr()  # what came after the warning
    assert said[0] == ""
    assert said[1].startswith(
        "warning: runs of load-reduction-15 will have no score: the reference numbers were made with another code, "
        "turbine; "
    )
    assert "benchmark reference --task load-reduction-15 makes them again" in said[1]
    assert said[2].startswith("warning: the task load-reduction-15-v3 has no reference numbers yet")
    assert [text.count("\n") for text in said] == [0, 1, 1]


def test_all_tasks_of_a_command_are_one_sweep_each_against_its_own_baseline(sweeps, monkeypatch, tmp_path, capsys):
    tasks, written = [load_task("load-reduction-12"), load_task("power-tracking")], {}
    monkeypatch.setattr(command, "chosen", lambda names: tasks)
    monkeypatch.setattr(benchmark_tasks, "write_reference", lambda task, made: written.update({task.name: made}))
    run_command("benchmark", ["reference", "--out", str(tmp_path / "runs")])
    (jobs,) = sweeps
    assert {job.task.name for job in jobs} == set(written) == {"load-reduction-12", "power-tracking"}
    names = {job.entry.name for job in jobs if job.task.name == "power-tracking"}
    assert names == {"discon+derate_torque", "linear_optimal+derate_kinetic"}
    for task in tasks:
        made = written[task.name]
        assert made.baseline == baseline_of(task)
        assert set(made.improvements) == set(task.measures)
        assert made.fingerprint != PRINT
    known = dataclasses.replace(tasks[1], reference=dataclasses.asdict(made))
    monkeypatch.setattr("wt_gym.experiment.benchmark.load_task", lambda name: known)
    better = {"tracking_rms": 0.5, "blade_flap_del": 0.9}
    text = to_markdown(leaderboard(results(known, better, fingerprint=made.fingerprint, agent="good").values()))
    assert "over `discon+derate_torque`" in text
    assert "| tracking error |" in text
    row = next(line for line in text.splitlines() if line.startswith("| good |"))
    assert "| -50.0 % | +0.0 % | -10.0 % |" in row


def test_the_page_has_the_tasks_as_they_are():
    rows = dict(re.findall(r"^\| `([\w-]+-v\d+)` \|.*\| (.*) \|$", PAGE, re.MULTILINE))
    tasks = [load_task(name) for name in task_names()]
    assert rows == {task.id: f"{len(task.winds)} of {task.duration:g} s" for task in tasks}
    for task in tasks:
        assert task.skip == (90.0 if task.name.startswith("floating") else 30.0)
        assert {wind.seed for wind in task.winds} <= {None, *range(1007, 1013)}
    assert set(INTERFACE) <= set(re.findall(r"`(\w+)`", PAGE))


def test_the_page_has_the_weights_as_they_are():
    table = re.findall(r"^\| (`\w+`.*?) \| ([^|]+) \| [^|]+ \|$", PAGE, re.MULTILINE)
    weights = {}
    for names, values in table:
        if not re.search(r"-v\d", names):
            numbers = [float(value.replace("−", "-")) for value in values.split(", ")]
            weights |= dict(zip(re.findall(r"`(\w+)`", names), numbers, strict=True))
    for name in ("load-reduction-12", "load-reduction-15", "load-reduction-18", "full-range", "faults"):
        assert {term.metric: term.weight for term in load_task(name).terms} == weights
