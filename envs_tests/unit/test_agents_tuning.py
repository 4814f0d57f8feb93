"""Tuning and comparison with a made-up simulator: the search finds the least cost, the record says how."""

import json
import math
from dataclasses import replace

import pytest

from wt_gym.analysis.page import format_estimate
from wt_gym.analysis.results import Wind
from wt_gym.base.errors import InflowError
from wt_gym.commands.tune import interval
from wt_gym.experiment import comparison, tuning
from wt_gym.experiment.benchmark_tasks import load_task
from wt_gym.experiment.comparison import ControllerRuns, change, comparison_table, run_cases
from wt_gym.experiment.tuning import Cost, SearchRange, TuningTask, tune
from wt_gym.turbines import load_turbine

METRICS = {
    "mean_power": 5e6, "captured_power": 5e6, "blade_flap_del": 6e6, "blade_edge_del": 6e6, "tower_fore_aft_del": 1.5e7,
    "tower_side_side_del": 6e6, "pitch_duty_cycle": 0.04, "torque_rate": 400.0, "rotor_speed_max": 1.3,
}  # fmt: skip


def made_up(turbine, controllers, cases, *_):
    """Metrics whose flap load is least at bandwidth 0.3."""
    runs = []
    for label, (_, parameters) in controllers.items():
        load = 6e6 * (0.8 + math.log(parameters["bandwidth"] / 0.3) ** 2) if parameters else 6e6
        runs.append(ControllerRuns(label, {c: METRICS | {"blade_flap_del": load} for c in cases}, {}))
    return runs


def test_the_search_finds_the_least_cost_and_says_how(monkeypatch, tmp_path):
    optuna = pytest.importorskip("optuna")
    monkeypatch.setattr(tuning, "run_cases", made_up)
    task = TuningTask("ipc", seeds=(3,), space={"bandwidth": SearchRange(0.03, 1.0, log=True)})
    path = tmp_path / "tuned.json"
    record = tune(load_turbine("nrel_5mw"), task, trials=30, output=path)
    assert record["best"]["cost"] == pytest.approx(-0.2 * 0.2, abs=0.002)
    assert record["best"]["parameters"]["bandwidth"] == pytest.approx(0.3, rel=0.15)
    assert record["trials"][0]["parameters"] == {"bandwidth": 0.2}  # the default comes first
    read = json.loads(path.read_text())
    assert read["task"]["seeds"] == [3]
    assert read["task"]["cost"]["weights"]["captured_power"] == -1.0
    assert read["versions"]["optuna"] == optuna.__version__
    assert len(read["trials"]) == 30


def test_cost():
    turbine = load_turbine("nrel_5mw")
    worse = METRICS | {"captured_power": 0.996 * 5e6, "blade_flap_del": 0.9 * 6e6, "pitch_duty_cycle": 0.14}
    assert Cost().of(worse, METRICS, turbine) == pytest.approx(0.004 - 0.2 * 0.1 + 0.1 * 0.1)
    sold = METRICS | {"captured_power": 0.98 * 5e6}
    assert Cost().of(sold, METRICS, turbine) == pytest.approx(0.02 + 10 * 0.015)
    restless = METRICS | {"torque_rate": 400.0 + 0.2 * turbine.drivetrain.max_torque_rate}
    assert Cost().of(restless, METRICS, turbine) == pytest.approx(0.05 * 0.2)
    passive = replace(turbine, drivetrain=replace(turbine.drivetrain, max_torque_rate=0.0, generator_damping=1e7))
    assert Cost().of(restless, METRICS, passive) == 0.0  # its torque is nobody's choice


def test_the_cost_is_what_the_benchmark_scores():
    task, turbine = load_task("load-reduction-15"), load_turbine("nrel_5mw")
    other = {key: value * (1.0 + 0.01 * k) for k, (key, value) in enumerate(METRICS.items())}
    assert Cost().of(other, METRICS, turbine) == pytest.approx(-task.improvement(other, METRICS), rel=1e-12)


@pytest.mark.parametrize("name", ["constrained_ipc+tower_dampers", "lidar+constrained_ipc+tower_dampers", "retuned"])
def test_the_first_trial_are_the_defaults(name):
    space = TuningTask(name).space
    defaults = tuning._defaults(name, space)
    assert set(defaults) == {key for key in space if not key.endswith(("lead", "gain_factor"))}  # those are rules
    if "+" in name:
        assert defaults["constrained_ipc__level"] == 0.1
        assert defaults["side_side_damper__damping"] == 0.03
        assert defaults["constrained_ipc__fade"] == pytest.approx(math.radians(3.0))


def test_held_back_seeds_and_empty_spaces_are_refused():
    with pytest.raises(ValueError, match=r"seeds must be whole numbers from 1 to 24, got \(1, 1001\)"):
        TuningTask("ipc", seeds=(1, 1001))
    with pytest.raises(ValueError, match="the controller to tune must be among"):
        TuningTask("discon")
    assert set(TuningTask("ipc+yaw").space) >= {"ipc__bandwidth", "yaw__dead_band"}


def test_winds_without_meaning_are_refused_before_the_first_run(monkeypatch):
    monkeypatch.setattr(comparison, "simulator_maker", lambda *_, **__: pytest.fail("a simulator was made"))
    with pytest.raises(InflowError, match="speed must lie in"):
        run_cases(load_turbine("nrel_5mw"), {"discon": ("discon", {})}, [Wind(12.0), Wind(1e9)])


def test_changes_and_table():
    cases = [Wind(15.0, seed) for seed in (1, 2, 3)]
    first = ControllerRuns("discon", {c: METRICS for c in cases}, {})
    factors = (0.7, 0.8, 0.9)
    other = {c: METRICS | {"blade_flap_del": f * 6e6} for c, f in zip(cases, factors, strict=True)}
    second = ControllerRuns("ipc", other, {})
    estimate = change(second, first, 15.0, "blade_flap_del")
    assert estimate.value == pytest.approx(-0.2)
    assert estimate.relative
    assert estimate.has_interval
    assert f" {format_estimate('blade_flap_del', estimate)} |" in comparison_table([first, second])
    assert change(second, first, 12.0, "blade_flap_del") is None


@pytest.mark.parametrize("metric", ["mean_power", "blade_flap_del"])
def test_a_reference_of_zero_leaves_values(metric):
    cases = [Wind(3.0, seed) for seed in (1, 2)]
    first = ControllerRuns("discon", {c: METRICS | {metric: 0.0} for c in cases}, {})
    second = ControllerRuns("ipc", {c: METRICS | {metric: 5e5} for c in cases}, {})
    assert change(second, first, 3.0, metric) is None
    row = comparison_table([first, second]).splitlines()[-1]
    assert ("0.500 MW" if metric == "mean_power" else "0.50 MN m") in row


@pytest.mark.parametrize(
    ("choice", "parameters", "message"),
    [
        ("ipc", {"bandwidths": 0.1}, "last: .*bandwidths"),
        ("mine.py:Mine", {"gian": 1.0}, r"last: mine.py:Mine takes the arguments \(gain=1.0\), got .*'gian'"),
        ("agent.py:Agent", {"gian": 1.0}, r"last: agent.py:Agent takes the arguments \(gain=1.0\), got .*'gian'"),
    ],
)
def test_what_cannot_be_made_is_refused_before_the_first_run(choice, parameters, message, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    for name, needed in (("mine", "channels = ()\n    def start(self, *_): pass\n    def step(self, *_): pass"),
                         ("agent", "def predict(self, *_, **__): pass")):  # fmt: skip
        (tmp_path / f"{name}.py").write_text(
            f"class {name.title()}:\n    {needed}\n    def __init__(self, gain=1.0): pass\n"
        )
    monkeypatch.setattr(comparison, "run_controller", lambda *_, **__: pytest.fail("a run was made"))
    monkeypatch.setattr(comparison, "play", lambda *_, **__: pytest.fail("a run was made"))
    chosen = {"discon": ("discon", {}), "last": (choice, parameters)}
    with pytest.raises(ValueError, match=message):
        run_cases(load_turbine("nrel_5mw"), chosen, [Wind(12.0)])


def test_a_class_of_ones_own_is_tuned(monkeypatch, tmp_path):
    pytest.importorskip("optuna")
    monkeypatch.setattr(tuning, "run_cases", made_up)
    (tmp_path / "mine.py").write_text(
        "class Mine:\n    SPACE = {'bandwidth': (0.03, 1.0, True)}\n"
        "    def __init__(self, bandwidth=0.2):\n        pass\n"
    )
    task = TuningTask(f"{tmp_path / 'mine.py'}:Mine", reference="baseline", seeds=(3,))
    assert (task.reference, task.space) == ("discon", {"bandwidth": SearchRange(0.03, 1.0, log=True)})
    record = tune(load_turbine("nrel_5mw"), task, trials=3)
    assert record["trials"][0]["parameters"] == {"bandwidth": 0.2}  # the default comes first


def test_intervals_of_the_command_line():
    assert interval("gain=0.1:2") == ("gain", (0.1, 2.0, False))
    assert interval("gain=0.1:2:log") == ("gain", (0.1, 2.0, True))
    for wrong in ("gain=2:0.1", "gain=1", "=1:2", "gain=1:2:even"):
        with pytest.raises(ValueError, match=r"interval|unpack"):
            interval(wrong)
