"""Evaluations kept in a folder: stopped and gone on with, refused, overwritten; controllers as agents."""

import json
import re
import shlex
from dataclasses import replace

import gymnasium as gym
import numpy as np
import pytest

from wt_gym.analysis.results import Evaluation, Wind
from wt_gym.base.files import shipped_folder
from wt_gym.commands import evaluate as command
from wt_gym.commands import parse as parse_command
from wt_gym.envs.turbine_env import WindTurbineEnv
from wt_gym.experiment import evaluation as module
from wt_gym.experiment.agents import ConstantAgent
from wt_gym.experiment.environments import (
    AgentExperiment,
    Environments,
    check_environment,
    resolved_arguments,
    with_common_step,
)
from wt_gym.experiment.evaluation import DEFAULT_WIND_SEEDS, EvaluationConfig, EvaluationFolder, evaluate
from wt_gym.experiment.execute import SerialExecutor
from wt_gym.experiment.options import ClimateOptions
from wt_gym.experiment.run import benchmark_fingerprint
from wt_gym.learning.options import TrainingConfig
from wt_gym.tasks import DEFAULT_ENV, TASKS
from wt_gym.turbines import load_turbine
from wt_gym.wind import SteadyInflow

STEADY = "wt_gym/NREL5MW-Steady-v1"
CONFIG = EvaluationConfig(env_id=STEADY, winds=(Wind(9.0), Wind(12.0)), duration=4.0, skip=1.0, replay=1.0)
AGENTS = {"Baseline": "baseline", "Constant": "constant"}
ONE = replace(CONFIG, winds=(Wind(9.0),), duration=2.0, skip=0.0)
RESIDUAL = {"action_mode": "residual"}
pytestmark = pytest.mark.usefixtures("scripted")


@pytest.fixture
def count_runs(monkeypatch):
    """Agents and winds that are run; stops with Ctrl-C where told."""
    done, original = [], module._EvaluationRuns.__call__

    def run(self, row):
        if len(done) == run.stop_after:
            raise KeyboardInterrupt
        done.append((row[0], row[1].speed))
        return original(self, row)

    run.stop_after = None
    monkeypatch.setattr(module._EvaluationRuns, "__call__", run)
    return done, run


def test_a_stopped_evaluation_goes_on_where_it_was(tmp_path, count_runs):
    done, run = count_runs
    run.stop_after = 3
    with pytest.raises(KeyboardInterrupt):
        evaluate(AGENTS, CONFIG, folder=tmp_path, progress=False)
    assert len(list((tmp_path / "runs").glob("*.nc"))) == 3
    assert not (tmp_path / "evaluation.json").exists()
    (tmp_path / "runs" / ".003_constant.nc.99999999999.partial").write_bytes(b"half of a run")

    done.clear()
    run.stop_after = None
    result = evaluate(AGENTS, CONFIG, folder=tmp_path, progress=False)
    assert done == [("Constant", 12.0)]
    assert not list(tmp_path.rglob("*.partial"))
    at_once = evaluate(AGENTS, CONFIG, progress=False)
    assert result.to_json() == at_once.to_json()
    for mine, theirs in zip(result.runs, at_once.runs, strict=True):
        assert mine.data.equals(theirs.data)
        assert (mine.replay is None) == (theirs.replay is None)
    np.testing.assert_array_equal(result.runs[1].replay.blades, at_once.runs[1].replay.blades)
    assert Evaluation.load(tmp_path).to_json() == result.to_json()

    done.clear()
    weighed = evaluate(
        AGENTS, replace(CONFIG, climate=ClimateOptions(iec_class="III")), folder=tmp_path, progress=False
    )
    assert done == []  # another climate weighs the same runs
    assert (result.climate.mean_speed, weighed.climate.mean_speed) == (10.0, 7.5)


def test_another_evaluation_in_the_folder_is_refused_unless_overwritten(tmp_path, count_runs):
    done, _ = count_runs
    first = replace(CONFIG, winds=(Wind(9.0),))
    evaluate(AGENTS, first, folder=tmp_path, progress=False)
    (tmp_path / "notes.txt").write_text("mine")
    before = {file: file.stat().st_mtime_ns for file in tmp_path.rglob("*")}
    done.clear()
    others = {
        "duration": (AGENTS, replace(first, duration=5.0)),
        "agents": ({"Baseline": "baseline", "Constant": "discon"}, first),
        "env_kwargs, winds": (AGENTS, replace(CONFIG, env_kwargs={"sensor_noise": 1.0})),
    }
    for names, (agents, config) in others.items():
        with pytest.raises(ValueError, match=f"holds another evaluation, with other {names}: take another folder"):
            evaluate(agents, config, folder=tmp_path, progress=False)
    assert {file: file.stat().st_mtime_ns for file in tmp_path.rglob("*")} == before
    assert done == []

    evaluate({"Constant": "constant"}, first, folder=tmp_path, overwrite=True, progress=False)
    assert done == [("Constant", 9.0)]
    (file,) = (tmp_path / "runs").glob("*.nc")
    assert re.fullmatch(r"constant_[0-9a-f]{16}\.nc", file.name)
    assert (tmp_path / "notes.txt").read_text() == "mine"


def test_runs_of_another_behavior_are_not_continued(tmp_path):
    fingerprint = benchmark_fingerprint(load_turbine("nrel_5mw"), "training")
    assert fingerprint.keys() == {"turbine", "fidelity", "canary"}
    folder = EvaluationFolder(tmp_path, AGENTS, CONFIG)
    folder.begin(fingerprint, overwrite=False)
    first = (tmp_path / "configuration.json").read_text()
    place = "residual/reward"
    numbers = np.array(fingerprint["canary"][place].split(), float)
    rounded = fingerprint["canary"] | {place: " ".join(map(str, numbers + 0.5e-4 * np.ptp(numbers)))}
    EvaluationFolder(tmp_path, AGENTS, CONFIG).begin(fingerprint | {"canary": rounded}, overwrite=False)
    assert (tmp_path / "configuration.json").read_text() == first
    others = fingerprint["canary"] | {place: " ".join(map(str, 2.0 * numbers))}
    with pytest.raises(
        ValueError, match=r"other turbine, behavior \(residual/reward by .* range\): take another folder"
    ):
        folder.begin(fingerprint | {"canary": others, "turbine": "y"}, overwrite=False)


class Trained(ConstantAgent):
    """Rests, and has the record of a training in an environment."""

    def __init__(self, env_id=STEADY, in_layout=None, **env_kwargs):
        super().__init__(gym.make(env_id, **in_layout or env_kwargs).unwrapped.layout)
        self.record = {"environment": resolved_arguments(env_id, env_kwargs)}


@pytest.mark.parametrize(
    ("trained", "here", "message"),
    [
        ({"sensor_noise": 1.0}, {}, r"mine: .* sensor_noise 1.0, here 0.0; give"),
        ({}, {"sensor_delay": 0.2}, r"sensor_delay 0.0, here 0.2;"),
        ({"controller": "ipc"}, {"sensor_noise": 0.5}, r"another environment: with sensor_noise 0.0, here 0.5;"),
    ],
)
def test_models_are_not_taken_into_another_environment_unasked(trained, here, message, count_runs):
    config = replace(ONE, env_kwargs=RESIDUAL | {"inflow": "steady"} | here)
    mine = Trained("wt_gym/NREL5MW-Turbulent-v1", config.env_kwargs, **RESIDUAL | trained)
    with pytest.raises(ValueError, match=message):
        evaluate({"mine": mine}, config, progress=False)
    assert count_runs[0] == []
    evaluate({"mine": mine}, config, allow_other_environment=True, progress=False)
    assert count_runs[0] == [("mine", 9.0)]


def test_residual_actions_of_a_model_mean_what_they_meant():
    """Those of another mode are the environment's."""
    meant = {"action_spans": {"pitch_rate": 0.02}, "residual_fade": 0.02, "controller": "ipc:bandwidth=0.3"}
    mine = Trained(**RESIDUAL, **meant)
    environments = Environments(STEADY, RESIDUAL)
    env = environments.environment_of(mine, mine.record)
    assert {name: env.spec.kwargs[name] for name in meant} == meant
    assert environments.environment_of(mine, mine.record, as_given=True) is environments.plain
    environments.close()
    rates = Trained(action_spans={"pitch_rate": 0.02})
    with pytest.raises(ValueError, match=r"action_spans \{'pitch_rate': 0.02\}, here \{\};"):
        evaluate({"rates": rates}, ONE, progress=False)


@pytest.mark.parametrize("allow", [False, True])
def test_a_model_sees_what_it_saw_in_its_training(allow, monkeypatch):
    """Two readings of rotor and lidar, in an environment that shows others to the rest."""
    mine, lengths = Trained(**RESIDUAL, observation=["rotor", "lidar"], history=2), set()
    rest = np.zeros(gym.make(STEADY, **RESIDUAL).action_space.shape)
    monkeypatch.setattr(mine, "predict", lambda seen, *_, **__: (rest, lengths.add(len(seen))))
    config = replace(ONE, env_kwargs=RESIDUAL)
    runs = evaluate({"baseline": "baseline", "mine": mine}, config, allow_other_environment=allow, progress=False).runs
    assert lengths == {10}
    assert runs[0].metrics == runs[1].metrics


def test_runs_have_the_shortest_control_step_of_environment_and_trainings():
    agents = {"discon": "discon", "shipped": str(shipped_folder() / "trained" / "iea15mw")}  # trained at 0.1 s
    assert with_common_step(agents, DEFAULT_ENV, {"starts": 3}) == {"starts": 3, "control_dt": 0.1}
    for given in ({"control_dt": 0.4}, {"control_dt": 0.1}):
        assert with_common_step(agents, DEFAULT_ENV, given) == given
    assert with_common_step(agents, TASKS["Gusts"].id, {}) == {}
    assert with_common_step({"discon": "discon"}, DEFAULT_ENV, {}) == {}


def test_a_controller_without_observer_runs_beneath_the_actions_of_a_task_with_one():
    there = Environments(DEFAULT_ENV, {})
    assert there.environment_of("ipc", {}).unwrapped.options.controller.base == "ipc"
    there.close()


def test_a_model_brings_the_controller_it_was_trained_on():
    config = replace(ONE, env_kwargs=RESIDUAL, winds=(Wind(14.0),), duration=4.0)
    mine = Trained(**RESIDUAL, controller="ipc")
    agents = {"baseline": "baseline", "ipc": "ipc", "mine": mine}  # all rest: only the base controllers differ
    found = {run.agent: run.metrics for run in evaluate(agents, config, progress=False).runs}
    assert found["mine"] == found["ipc"] != found["baseline"]
    found = evaluate({"baseline": "baseline", "mine": mine}, config, allow_other_environment=True, progress=False).runs
    assert found[0].metrics == found[1].metrics


def test_fidelity_inflow_and_an_idle_controller_are_free():
    env = gym.make(STEADY, inflow="gusts", wind_speed=9.0, fidelity="engineering")
    arguments = resolved_arguments("wt_gym/NREL5MW-Turbulent-v1", {"controller": "ipc", "action_spans": {}})
    check_environment({"environment": arguments}, env)  # nothing runs beneath rates
    check_environment({}, env)


def test_a_record_says_what_an_id_meant_then():
    """The id may mean another action in the version that reads the record."""
    env, arguments = gym.make("wt_gym/LoadReduction-v3"), resolved_arguments("wt_gym/LoadReduction-v3", {})
    check_environment({"environment": arguments}, env)
    with pytest.raises(ValueError, match=r"residual_fade False, here True;"):
        check_environment({"environment": arguments | {"residual_fade": False}}, env)


def test_folders_that_cannot_be_used_are_refused_before_the_first_run(tmp_path, count_runs):
    done, _ = count_runs
    with pytest.raises(ValueError, match="must be names or paths, got objects for Mine"):
        EvaluationFolder(tmp_path, {"Mine": ConstantAgent}, CONFIG)
    (tmp_path / "file").write_text("")
    with pytest.raises(OSError, match="file"):
        evaluate(AGENTS, CONFIG, folder=tmp_path / "file", progress=False)
    (tmp_path / "configuration.json").write_text("{")
    with pytest.raises(ValueError, match=r"configuration\.json is damaged"):
        evaluate(AGENTS, CONFIG, folder=tmp_path, progress=False)
    (tmp_path / "configuration.json").unlink()
    (tmp_path / "evaluation.json").write_text(json.dumps({"runs": []}))  # of a version that kept no configuration
    with pytest.raises(ValueError, match="holds another evaluation"):
        evaluate(AGENTS, CONFIG, folder=tmp_path, progress=False)
    assert done == []


def test_controllers_run_beneath_residual_actions_and_act_where_nothing_does():
    config = replace(ONE, env_kwargs=RESIDUAL | {"pitch": "fixed-frame"}, winds=(Wind(16.0),), duration=4.0)
    agents = {"Baseline": "baseline", "discon": "discon", "ipc": "ipc", "weak": "controller:ipc:limit=0.001"}
    base, discon, ipc, weak = (run.data for run in evaluate(agents, config, progress=False).runs)
    assert base.equals(discon.assign_attrs(base.attrs))
    np.testing.assert_array_equal(base["pitch_1"], base["pitch_2"])
    spread = [float(np.abs(data["pitch_1"] - data["pitch_2"]).max()) for data in (ipc, weak)]
    assert 0.002 > spread[1] > 0.0  # two blades, each within the limit
    assert spread[0] > spread[1]
    agents = {"Baseline": "baseline", "discon": "discon", "damped": "fore_aft_damper"}
    base, discon, damped = evaluate(agents, replace(ONE, winds=(Wind(16.0),)), progress=False).runs
    assert base.metrics == discon.metrics
    assert base.metrics["pitch_travel"] != damped.metrics["pitch_travel"]
    with pytest.raises(ValueError, match="pitch must be 'individual' for a controller of individual pitch"):
        evaluate({"ipc": "ipc"}, ONE, progress=False)


def test_what_wind_seeds_leave_open_is_drawn_from_seeds_of_no_training(monkeypatch):
    seeds, reset = [], WindTurbineEnv.reset

    def note(self, *, seed=None, options=None):
        seeds.append(seed)
        return reset(self, seed=seed, options=options)

    monkeypatch.setattr(WindTurbineEnv, "reset", note)
    winds = (Wind(9.0), Wind(12.0))
    evaluate(AGENTS, replace(CONFIG, env_kwargs={"inflow": "gusts"}, winds=winds), progress=False)
    first, second = seeds[0], seeds[2]
    assert seeds == [first, first, second, second]  # every agent meets the same gusts
    assert first != second
    # a training draws with its seed and one a copy more, and after a resume with any of 32 bits
    with pytest.raises(ValueError, match="seed must be"):
        TrainingConfig(seed=2**32)
    assert min(first, second) > 2**32 + 256


@pytest.mark.parametrize(
    ("record", "note"),
    [
        ({"wind_seeds": [1, 5, 7]}, "Model was trained on wind seeds 5, 7 of this evaluation"),
        (None, "Nothing is known of the training of Model: there is no training.json beside its model. It runs on"),
        ({"wind_seeds": [1]}, None),
        ({"wind_seeds": None}, None),
    ],
)
def test_what_a_training_has_met_is_said(record, note, monkeypatch, caplog):
    monkeypatch.setattr(SerialExecutor, "results", lambda *_: ())
    model = Trained()
    model.record = record
    winds = tuple(Wind(9.0, seed) for seed in (5, 7, 1001))
    with pytest.raises(ValueError, match="zip"):  # before any run
        evaluate({"Baseline": "baseline", "Model": model}, replace(CONFIG, winds=winds), progress=False)
    (*texts,) = (entry.getMessage() for entry in caplog.records)
    assert len(texts) == (note is not None)
    assert all(text.startswith(note) and "\n" not in text for text in texts)


TRANSIENT = """--env-kwargs '{"gusts": ["EOG", "EDC", "ECD", "EWS"]}'"""
"""Gusts without turbulence among them."""


@pytest.mark.parametrize(
    ("words", "speeds", "seeds", "draws"),
    [
        ("", {15.0}, DEFAULT_WIND_SEEDS, {None}),
        ("--wind-speed 12 18 --wind-seeds 3", {12.0, 18.0}, (3,), {None}),
        ("--env wt_gym/NREL5MW-Steady-v1", {15.0}, (None,), {None}),
        ("--env wt_gym/NREL5MW-Steady-v1 --env-kwargs '{\"wind_speed\": 9.0}'", {9.0}, (None,), {None}),
        (f"--env wt_gym/Gusts-v3 {TRANSIENT}", {15.0}, (None,), {1, 2, 3, 4, 5, 6}),
        (f"--env wt_gym/Gusts-v3 {TRANSIENT} --wind-speed 8 10 --draws 2", {8.0, 10.0}, (None,), {1, 2}),
        ("--env wt_gym/Gusts-v3", {15.0}, DEFAULT_WIND_SEEDS, {None}),  # of which extreme turbulence has one
        (
            "--env wt_gym/NREL5MW-Steady-v1 --draws 3 --env-kwargs '{\"wind_direction\": [0.1, 0.2]}'",
            {15.0}, (None,), {1, 2, 3},
        ),
        (
            "--env wt_gym/NREL5MW-Steady-v1 --env-kwargs "
            "'{\"inflow\": \"extreme-turbulent\", \"standstill_limit\": -0.5}'",
            {50.0}, DEFAULT_WIND_SEEDS, {None},
        ),
    ],
)  # fmt: skip
def test_the_command_asks_for_winds_that_the_environment_has(words, speeds, seeds, draws):
    winds = command.configuration(parse_command("evaluate", shlex.split(words))).winds
    assert sorted({wind.speed for wind in winds}) == pytest.approx(sorted(speeds))
    assert {wind.seed for wind in winds} == set(seeds)
    assert {wind.draw for wind in winds} == draws
    assert len(winds) == len(speeds) * len(seeds) * len(draws)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ("--env wt_gym/NREL5MW-Steady-v1 --wind-seeds 3", r"has none; got \[3\]"),
        ("--draws 2", "draws must be left out: .*; give turbulence seeds"),
        ("--env wt_gym/NREL5MW-Steady-v1 --draws 2", "one run in it is all"),
        (f"--env wt_gym/Gusts-v3 {TRANSIENT} --draws 0", "draws must be at least 1, got 0"),
        (
            '--wind-speed 12 --env-kwargs \'{"inflow": "extreme", "standstill_limit": -0.5}\'',
            r"speeds must be left out, .*; got \[12.0\] m/s",
        ),
    ],
)
def test_the_command_refuses_what_the_wind_ignores(words, message):
    with pytest.raises(ValueError, match=message):
        command.configuration(parse_command("evaluate", shlex.split(words)))


def drawn_inflow(rng):
    return SteadyInflow(rng.uniform(9.0, 11.0), 90.0)


@pytest.mark.parametrize(
    ("kwargs", "labels"),
    [
        ({"inflow": drawn_inflow}, r"(9|10)\.\d+ m/s, draw [12] \(steady (9|10)\.\d+ m/s at 90 m, uniform profile\)"),
        ({"inflow": SteadyInflow(9.0, 90.0)}, r"9 m/s, draw [12] \(steady 9 m/s at 90 m, uniform profile\)"),
        ({"inflow": "gusts"}, r"15 m/s, draw [12] \(IEC E.*\)"),
        ({"inflow": "turbulent"}, r"15 m/s, seed 100[12]"),
        ({"inflow": "steady"}, r"15 m/s, draw [12]"),
        ({"inflow": "extreme-turbulent", "standstill_limit": -0.5}, r"50 m/s, seed 100[12]"),
        ({"inflow": "extreme", "standstill_limit": -0.5}, r"70 m/s, draw [12]"),
    ],
)
def test_runs_are_labeled_by_the_wind_that_they_had(kwargs, labels, monkeypatch):
    """Asked for two seeds at 15 m/s, whatever the wind of the environment is."""
    monkeypatch.setattr(module, "run_metrics", lambda *_: {"mean_power": 1.0})
    winds = (Wind(15.0, 1001), Wind(15.0, 1002))
    config = EvaluationConfig(STEADY, kwargs, winds, duration=3.0, skip=1.0, replay=0.0)
    agents = {"a": "constant", "b": "constant"}
    result = evaluate(agents, config, progress=False)
    assert len(result.winds) == 2
    assert all(re.fullmatch(labels, wind.label) for wind in result.winds), [wind.label for wind in result.winds]
    for wind in result.winds:  # both agents met it, and its speed is recorded
        assert {result.run(name, wind).data.attrs["wind_speed"] for name in agents} == {wind.speed}
    in_operation = all(wind.speed < 25.0 for wind in result.winds)
    assert (result.climate is not None) == in_operation


def test_agents_that_did_not_meet_one_wind_are_not_compared(monkeypatch):
    monkeypatch.setattr(module, "run_metrics", lambda *_: {"mean_power": 1.0})
    count = iter(range(100))
    kwargs = {"inflow": lambda rng: SteadyInflow(9.0 + 0.1 * next(count), 90.0)}
    config = EvaluationConfig(STEADY, kwargs, (Wind(9.0),), duration=3.0, skip=1.0, replay=0.0)
    with pytest.raises(ValueError, match=r"met different winds .* must follow from the random generator"):
        evaluate({"a": "constant", "b": "constant"}, config, progress=False)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"duration": 20.0, "skip": 30.0}, "duration must be 2 s longer than skip"),
        ({"env_kwargs": {"max_episode_steps": 50}}, "max_episode_steps follows"),
        ({"winds": (Wind(9.0), Wind(9.0))}, "each once, got 9 m/s, 9 m/s"),
    ],
)
def test_configurations_without_meaning_are_refused(changes, message, count_runs):
    with pytest.raises(ValueError, match=message):
        evaluate(AGENTS, replace(CONFIG, **changes), progress=False)
    assert count_runs[0] == []


def test_refused_agents_leave_no_environment_open(monkeypatch):
    closed = []
    monkeypatch.setattr(WindTurbineEnv, "close", lambda self: closed.append(self))
    with pytest.raises(FileNotFoundError, match=r"no trained model at \./nobody"):
        AgentExperiment({"Nobody": "./nobody"}, "wt_gym/LoadReduction-v3", {})
    assert len(closed) == 1
