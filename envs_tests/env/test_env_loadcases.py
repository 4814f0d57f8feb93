"""Load cases in the simulator: what an agent does not survive is a result, and processes give the same files."""

from dataclasses import replace
from unittest.mock import Mock

import gymnasium as gym
import pytest
from turbine_contract import PLAIN

from wt_gym.base.errors import SimulationError
from wt_gym.envs.layout import layout_of
from wt_gym.experiment.agents import load_agent
from wt_gym.experiment.execute import executor_for
from wt_gym.experiment.loadcase_runs import EXTREMES, LoadCaseConfig, run_agent, run_load_cases, run_parked
from wt_gym.experiment.loadcases import CASES, DesignSituation, plan_of
from wt_gym.simulation.drivetrain.faults import GeneratorLoss, ShutDown
from wt_gym.turbines import load_turbine


@pytest.fixture(scope="module")
def env():
    made = gym.make("wt_gym/LoadReduction-v3", max_episode_steps=10**9, **PLAIN)
    yield made
    made.close()


@pytest.fixture(scope="module")
def baseline(env):
    return load_agent("baseline", layout_of(env))


def test_a_runaway_is_a_result(env, baseline, monkeypatch):
    monkeypatch.setattr(env.unwrapped, "limits", replace(env.unwrapped.limits, overspeed=1.06))
    result = run_agent(env, baseline, DesignSituation("EOG", 14.0, 60.0, faults=(GeneratorLoss(33.0),)))
    assert (result["ending"], result["failure"]) == ("overspeed", None)
    assert 33.0 < result["time"] < 36.0
    assert result["extremes"]["rotor_speed_max"] > 1.06 * 1.267
    assert set(result["extremes"]) == set(EXTREMES)


def test_a_start_that_fails_is_a_result(env, baseline, monkeypatch):
    env.reset(seed=0)
    monkeypatch.setattr(env.unwrapped.simulator, "reset", Mock(side_effect=SimulationError("no start")))
    result = run_agent(env, baseline, DesignSituation("EOG", 14.0, 60.0))
    assert (result["ending"], result["failure"], result["extremes"]) == ("failure", "no start", None)


def test_a_turbine_that_is_shut_down_has_come_through(env, baseline):
    faults = (GeneratorLoss(31.0), ShutDown(31.2))
    result = run_agent(env, baseline, DesignSituation("EOG", 14.0, 60.0, faults=faults))
    assert result["ending"] == "stopped"
    assert result["extremes"]["rotor_speed_max"] < 1.2 * 1.267
    assert result["trace"]["time"][0] == pytest.approx(30.0)


def test_a_parked_turbine_idles():
    turbine = load_turbine("nrel_5mw")
    result = run_parked(turbine, "training", DesignSituation("EWM", 50.0, 33.0, 1001))
    assert result["ending"] == "time"
    assert result["extremes"]["rotor_speed_max"] < 0.3 * turbine.drivetrain.rated_rotor_speed


@pytest.mark.slow
def test_processes_write_the_same_files(tmp_path):
    plan = replace(plan_of(load_turbine("nrel_5mw"), quick=True), length=10.0, speeds=(12.0,), seeds=2)
    config = LoadCaseConfig(cases=("1.3", "4.2", "6.1"), plan=plan)
    agents = {"Baseline PI": "baseline", "ipc": "ipc"}
    runs = 2 * (2 + len(CASES["4.2"].situations(load_turbine("nrel_5mw"), plan))) + 2
    files = []
    for workers in (1, 2):
        with executor_for(workers=workers) as executor:
            run_load_cases(agents, config, tmp_path / str(workers), executor=executor, progress=False)
        files.append({path.name: path.read_bytes() for path in (tmp_path / str(workers) / "runs").iterdir()})
    assert len(files[0]) == runs
    assert files[0] == files[1]
