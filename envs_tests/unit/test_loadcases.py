"""Load cases: which runs there are, what they come to, and how a study keeps and resumes them."""

import json
import pickle
from dataclasses import replace

import numpy as np
import pytest

from wt_gym.analysis.statistics import WindClimate, wind_weights
from wt_gym.commands import run as run_command
from wt_gym.envs.wind_sampler import TRAINING_WIND_SEEDS
from wt_gym.experiment import environments, execute, loadcase_runs
from wt_gym.experiment.execute import SerialExecutor, Tally
from wt_gym.experiment.loadcase_report import load_case_tables, write_load_case_report
from wt_gym.experiment.loadcase_runs import EXTREMES, PARKED, CaseRun, LoadCaseConfig, LoadCaseResults, run_load_cases
from wt_gym.experiment.loadcases import CASES, DesignSituation, inflow_of, plan_of
from wt_gym.experiment.store import SWEEP_FILE, digest
from wt_gym.simulation.drivetrain.faults import GeneratorLoss, SensorBias, ShutDown, StuckPitch

FATIGUE = ("blade_flap_del", "blade_edge_del", "tower_fore_aft_del", "tower_side_side_del")


def result(flap=1.0, clearance=8.0, ending="time", fatigue=1.0):
    extremes = dict.fromkeys(EXTREMES, flap) | {"tip_clearance_min": clearance, "rotor_speed_max": 1.2}
    return {
        "ending": ending, "failure": None, "time": 80.0, "extremes": extremes,
        "fatigue": dict.fromkeys(FATIGUE, fatigue), "unloaded_clearance": 10.0, "trace": None,
    }  # fmt: skip


def results(case, values, agent="A", wind="NTM", climate=None):
    """Results of one case from speeds and results, seeds counted."""
    runs = [CaseRun(agent, DesignSituation(wind, v, 80.0, seed), r) for seed, (v, r) in enumerate(values)]
    return LoadCaseResults(
        "T", (case,), ("A",), {(case, agent): runs}, climate, {"quick": True, "fidelity": "training"}
    )


# ---- which runs there are ----


@pytest.mark.parametrize("quick", [False, True])
def test_runs_are_told_apart_by_their_hash_and_those_of_1_1_serve_1_2(turbine, quick):
    plan = plan_of(turbine, quick)
    hashes = {case: [digest(c.to_json()) for c in kind.situations(turbine, plan)] for case, kind in CASES.items()}
    assert all(len(set(found)) == len(found) > 0 for found in hashes.values())
    assert hashes["1.1"] == hashes["1.2"]
    rest = [name for case, found in hashes.items() if case != "1.2" for name in found]
    assert len(set(rest)) == len(rest)


def test_the_full_set_is_that_of_the_standard(turbine):
    plan = plan_of(turbine)
    assert plan.speeds == tuple(float(v) for v in range(4, 25, 2))
    runs = {case: kind.situations(turbine, plan) for case, kind in CASES.items()}
    for case in ("1.1", "1.3"):
        assert all(sum(c.speed == v for c in runs[case]) == 6 for v in plan.speeds)
        assert all(c.duration == 630.0 for c in runs[case])
    assert {c.speed for c in runs["1.4"]} == {turbine.rated_wind_speed + d for d in (-2.0, 0.0, 2.0)}
    assert {c.wind for c in runs["1.4"]} == {"ECD+", "ECD-"}
    assert len({(c.wind, c.azimuth) for c in runs["1.5"]}) == 16
    assert len([c for c in runs["2.1"] if c.speed == 12.0 and c.label == "grid loss"]) == 12
    assert {c.speed for c in runs["6.1"]} == {50.0}  # class I
    held_back = {c.seed for found in runs.values() for c in found if c.seed is not None}
    assert not held_back & set(TRAINING_WIND_SEEDS)
    assert not {c.seed for c in runs["1.1"]} & {c.seed for c in runs["1.3"]}


def test_each_fault_case_has_its_faults(turbine):
    plan = plan_of(turbine, quick=True)
    kinds = {
        case: {tuple(type(f) for f in c.faults) for c in CASES[case].situations(turbine, plan)}
        for case in ("2.1", "2.2", "2.3", "4.2", "1.3", "6.1")
    }
    loss = GeneratorLoss, ShutDown
    assert kinds == {
        "2.1": {loss, (SensorBias,)}, "2.2": {(StuckPitch, ShutDown)}, "2.3": {loss}, "4.2": {(ShutDown,)},
        "1.3": {()}, "6.1": {()},
    }  # fmt: skip


def test_winds_are_those_of_the_models(turbine):
    extreme = inflow_of(DesignSituation("ETM", 12.0, 130.0, 1001), turbine).description
    sigma = 2.0 * 0.14 * (0.072 * (10.0 / 2.0 + 3.0) * (12.0 / 2.0 - 4.0) + 10.0)  # class IB
    assert f"with sigma_u {sigma:.3g} m/s" in extreme
    shear = inflow_of(DesignSituation("EWS-horizontal-", 12.0, 70.0), turbine)
    assert (shear.kind, shear.speed_amplitude < 0.0) == ("EWS-horizontal", True)
    gust = inflow_of(DesignSituation("ECD-", 12.0, 80.0), turbine)
    assert gust.direction_amplitude == pytest.approx(-np.radians(60.0))  # 720 deg / V


# ---- what they come to ----


@pytest.mark.parametrize(
    ("case", "expected"),
    [
        ("1.1", 1.25 * 1.5 * 3.0),  # the mean of the seeds, extrapolated
        ("1.3", 1.35 * 3.0),
        ("2.1", 1.35 * 4.5),  # the mean of the larger half of 1, 2, 4 and 5
        ("2.2", 1.1 * 4.5),
        ("2.3", 1.1 * 3.0),
    ],
)
def test_design_loads_are_means_of_realizations_times_the_factors(case, expected):
    values = [(12.0, result(x)) for x in (1.0, 2.0, 4.0, 5.0)] + [(18.0, result(2.9))] * 4
    value = results(case, values).value(case, "A", "blade_flap_max")
    assert value.design == pytest.approx(expected)
    assert value.where == "NTM, 12 m/s"


def test_the_deflection_counts_for_the_clearance():
    """10 m unloaded, 8 and 6 m left: 3 m of deflection on average, times 1.35 and 1.1."""
    value = results("1.3", [(12.0, result(clearance=8.0)), (12.0, result(clearance=6.0))]).value(
        "1.3", "A", "tip_clearance_min"
    )
    assert (value.characteristic, value.design) == (pytest.approx(7.0), pytest.approx(10.0 - 1.35 * 1.1 * 3.0))


def test_what_a_case_says_nothing_about_has_no_value():
    assert results("1.1", [(12.0, result())]).value("1.1", "A", "tower_base_max") is None
    assert results("1.2", [(12.0, result())]).value("1.2", "A", "blade_flap_max") is None
    parked = results("6.1", [(50.0, result())], agent=PARKED, wind="EWM")
    assert parked.value("6.1", PARKED, "tip_clearance_min") is None
    assert parked.value("6.1", PARKED, "rotor_speed_max").design == 1.2
    nothing = result(ending="failure") | {"extremes": None, "fatigue": None, "failure": "diverged", "time": 3.0}
    assert results("1.4", [(12.0, nothing)]).value("1.4", "A", "blade_flap_max") is None


def test_lifetime_loads_weigh_speeds_by_the_climate_and_seeds_alike():
    climate = WindClimate(10.0)
    values = [(8.0, result(fatigue=1.0)), (8.0, result(fatigue=3.0)), (16.0, result(fatigue=2.0))]
    share = wind_weights(climate, [8.0, 16.0])
    expected = (share[0] * (1.0 + 3.0**10) / 2.0 + share[1] * 2.0**10) ** 0.1
    found = results("1.2", values, climate=climate)
    assert found.lifetime("A", "blade_flap_del") == pytest.approx(expected)
    failed = results("1.2", [*values, (16.0, result(ending="overspeed"))], climate=climate)
    assert failed.lifetime("A", "blade_flap_del") is None


def test_failures_are_shown_as_results(tmp_path):
    trace = {name: [0.0, 1.0] for name in (
        "time", "wind_x", "rotor_speed", "generator_power", "pitch_1", "root_flap_moment_1",
        "tower_base_fore_aft_moment",
    )}  # fmt: skip
    found = results(
        "1.4", [(11.4, result(2e7) | {"trace": trace}), (11.4, result(3e7, ending="overspeed"))], wind="ECD+"
    )
    assert found.survived("1.4", "A") == (1, 2)
    assert "| 1.4 | A | 1 of 2 (1 overspeed) | 33.8 †" in "\n".join(load_case_tables(found))
    page = write_load_case_report(found, tmp_path / "report.html").read_text()
    assert "A does not come through DLC 1.4." in page
    assert "DLC 1.4, A, ECD+, 11.4 m/s, seed 1: overspeed after 80.0 s" in page
    assert "<!--" not in page.split("<script>")[0]
    assert json.dumps(found.to_json())


def test_the_page_answers_first_and_names_common_failures_once(tmp_path):
    """Both agents fail DLC 1.4, one fails DLC 1.5 too; the worst load is that of the cases that were come through."""
    runs = {
        (case, agent): [CaseRun(agent, DesignSituation("NTM", 12.0, 80.0, 0), result(flap, ending=ending))]
        for case, agent, flap, ending in (
            ("1.3", "A", 1e6, "time"), ("1.3", "B", 2e6, "time"), ("1.4", "A", 9e6, "overspeed"),
            ("1.4", "B", 9e6, "overspeed"), ("1.5", "A", 3.2e6, "time"), ("1.5", "B", 9e6, "tower_strike"),
        )
    }  # fmt: skip
    settings = {"quick": True, "fidelity": "training"}
    found = LoadCaseResults("T", ("1.3", "1.4", "1.5"), ("A", "B"), runs, None, settings)
    page = write_load_case_report(found, tmp_path / "report.html").read_text(encoding="utf-8")
    header, verdict = page.split("</header>")[0], page.split("<section id='verdict'>")[1].split("</section>")[0]
    assert "No agent comes through DLC 1.4; B does not come through DLC 1.5." in header
    assert verdict.index("class='legend'") < verdict.index("<table>")
    rows = {row.split("</th>")[0].split("</i>")[-1]: row for row in verdict.split("<tr>")[2:]}
    assert "Lost 1 of 3 runs" in rows["A"]
    assert "4.3 \u2020<small class='note'>DLC 1.5</small>" in rows["A"]  # 1.35 times 3.2 MN m
    assert "2.7 \u2020<small class='note'>DLC 1.3</small>" in rows["B"]
    assert page.index("<section id='verdict'>") < page.index("class='plot'")
    assert "loadcases.json" not in page  # there is none beside the page
    (tmp_path / "loadcases.json").write_text("{}")
    page = write_load_case_report(found, tmp_path / "report.html").read_text(encoding="utf-8")
    assert "href='loadcases.json'" in page


# ---- how a study keeps and resumes runs ----


@pytest.fixture
def counted(monkeypatch):
    """Runs that are not simulated: what was asked for, in order; a condition in ``stop`` interrupts."""
    made, stop = [], set()

    def run(env, agent, condition):
        if len(made) in stop:
            raise KeyboardInterrupt
        made.append(condition)
        return result(float(len(made)))

    monkeypatch.setattr(loadcase_runs, "run_agent", run)
    monkeypatch.setattr(loadcase_runs, "run_parked", lambda turbine, fidelity, condition: run(None, None, condition))
    made_and_stop = type("Counted", (), {"made": made, "stop": stop})
    return made_and_stop


def quick(*cases):
    return LoadCaseConfig(cases=cases, quick=True)


def files(folder):
    return {path.name: path.read_bytes() for path in (folder / "runs").iterdir()}


def test_an_interrupted_study_goes_on_with_what_it_has(tmp_path, counted):
    counted.stop.add(3)
    with pytest.raises(KeyboardInterrupt):
        run_load_cases({"A": "baseline"}, quick("1.5"), tmp_path, progress=False)
    before = files(tmp_path)
    assert len(before) == 3
    counted.stop.clear()
    found = run_load_cases({"A": "baseline"}, quick("1.5"), tmp_path, progress=False)
    assert len(counted.made) == len(set(counted.made)) == 8
    after = files(tmp_path)
    assert len(after) == 8
    assert before.items() <= after.items()
    assert found.survived("1.5", "A") == (8, 8)
    again = run_load_cases({"other name": "baseline"}, quick("1.5"), tmp_path, progress=False)
    assert len(counted.made) == 8
    assert [r.result for r in again.runs["1.5", "other name"]] == [r.result for r in found.runs["1.5", "A"]]


def test_cases_share_runs_and_a_parked_turbine_is_run_once(tmp_path, counted):
    found = run_load_cases({"A": "baseline", "B": "ipc"}, quick("1.1", "1.2", "6.1"), tmp_path, progress=False)
    assert len(counted.made) == 2 * 6 + 2
    assert len(files(tmp_path)) == 14
    assert found.rows() == [("1.1", "A"), ("1.1", "B"), ("1.2", "A"), ("1.2", "B"), ("6.1", PARKED)]
    assert json.loads((tmp_path / "loadcases.json").read_text())["cases"]


def test_other_agents_arguments_and_turbulence_are_other_runs(tmp_path, counted):
    config = quick("1.1")
    for agent, changed in (
        ("baseline", config),
        ("constant", config),
        ("baseline", replace(config, env_kwargs={"overspeed_limit": 1.4})),
        ("baseline", replace(config, turbulence="mann")),
    ):
        run_load_cases({"A": agent}, changed, tmp_path, progress=False)
    assert len(counted.made) == len(files(tmp_path)) == 4 * 6


class Elsewhere:
    """Does jobs as other processes would, to which everything is sent; the last one first."""

    beside = True

    def __init__(self):
        self.tally = Tally()

    def results(self, work, rows):
        work = sent(work)
        work.warm()
        for row in reversed(rows):
            result = sent(execute.played(sent(work), sent(row)))
            self.tally.done += 1
            yield row, result


def sent(value):
    return pickle.loads(pickle.dumps(value))


@pytest.fixture
def elsewhere(monkeypatch):
    """An executor for which no kernels are compiled: the environments that would be are in its ``compiled``."""
    compiled = []
    monkeypatch.setattr(environments, "compile_kernels", compiled.append)
    monkeypatch.setattr(execute, "_prepared", None)  # of worker processes, which this one stands for
    executor = Elsewhere()
    executor.compiled = compiled
    return executor


def test_an_executor_makes_the_same_files(tmp_path, monkeypatch, elsewhere):
    monkeypatch.setattr(
        loadcase_runs, "run_agent", lambda env, agent, condition: result(condition.speed + condition.seed)
    )
    monkeypatch.setattr(loadcase_runs, "run_parked", lambda turbine, fidelity, condition: result(condition.seed))
    agents, config, found = {"A": "baseline", "B": "ipc"}, quick("1.1", "6.1"), {}
    for executor in (elsewhere, SerialExecutor()):
        folder = tmp_path / str(executor.beside)
        table = run_load_cases(agents, config, folder, executor=executor, progress=False)
        found[executor.beside] = table.to_json(), files(folder)
        counts = json.loads((folder / SWEEP_FILE).read_text())
        assert counts == [{"found": 0, "made": 2 * 6 + 2, "retried": 0, "lost": []}]
        assert len(files(folder)) == 2 * 6 + 2
        assert len(elsewhere.compiled) == 1
    assert found[True] == found[False]


def test_a_machine_with_another_behavior_is_refused(tmp_path, monkeypatch, elsewhere, counted):
    codes = iter([{"canary": {"x": text}} for text in ("1", "2")])  # of the work, elsewhere
    monkeypatch.setattr(environments, "benchmark_fingerprint", lambda *_: next(codes))
    with pytest.raises(ValueError, match=r"has another behavior \(x by 0.5 of its range\)"):
        run_load_cases({"A": "baseline"}, quick("2.3"), tmp_path, executor=elsewhere, progress=False)
    assert not elsewhere.compiled
    assert not files(tmp_path)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--jobs", "0"], "at least 1 job"),
        (["--env-kwargs", '{"wind_speed": 9}'], "wind_speed follows from the load cases"),
        (["--env-kwargs", '{"color": 9}'], "the environment has no argument 'color'"),
        (["no controller=baseline"], "named otherwise than 'no controller'"),
        (["--out", "/dev/null/there"], "/dev/null/there"),
    ],
)
def test_bad_arguments_take_one_line(words, message, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(loadcase_runs._LoadCaseRuns, "table", lambda *_: pytest.fail("runs were begun"))
    with pytest.raises(SystemExit) as end:
        run_command("loadcases", words)
    assert message in end.value.code
    assert "\n" not in end.value.code
    assert not list(tmp_path.iterdir())


def test_a_parked_turbine_is_refused_to_another_simulator(tmp_path):
    config = LoadCaseConfig("wt_gym/LoadReduction-v3", {"simulator": lambda *_: None}, cases=("6.1",), quick=True)
    with pytest.raises(ValueError, match=r"without a parked turbine, got 6\.1"):
        run_load_cases({"discon": "discon"}, config, tmp_path)
