"""Agents in conditions that they were not made for: what is left of their gain."""

import json
from dataclasses import replace

import gymnasium as gym
import pytest

from wt_gym.analysis.results import Wind
from wt_gym.commands import run as run_command
from wt_gym.envs.faults import FAULT_KINDS, NO_FAULT
from wt_gym.envs.variation import Variation
from wt_gym.experiment import robustness
from wt_gym.experiment.benchmark_tasks import load_task
from wt_gym.experiment.evaluation import EvaluationConfig
from wt_gym.experiment.robustness import (
    CONDITIONS,
    COST_TASK,
    FAULT_CONDITIONS,
    FAULT_TIME,
    NOMINAL,
    Gain,
    Robustness,
    base_of,
    chosen,
    run_robustness,
)
from wt_gym.experiment.store import SWEEP_FILE

TASK = "wt_gym/LoadReduction-v3"
WINDS = (Wind(15.0, 1001), Wind(15.0, 1002), Wind(18.0, 1001))
TERMS = [term.metric for term in load_task(COST_TASK).terms]


def metrics(**changes):
    return dict.fromkeys(TERMS, 1.0) | changes


@pytest.mark.parametrize(
    ("choice", "env_id", "arguments", "base"),
    [
        ("agents/trained/load_reduction", TASK, {}, "linear_optimal"), ("ipc", TASK, {}, None),
        ("zero", TASK, {"controller": "ipc"}, "ipc"), ("zero", "wt_gym/NREL5MW-Turbulent-v1", {}, None),
    ],
)  # fmt: skip
def test_the_base_of_an_agent(choice, env_id, arguments, base):
    assert base_of(choice, env_id, arguments) == base


def test_gains_are_paired_wind_by_wind():
    runs = {
        "discon": {wind: metrics() for wind in WINDS},
        "better": {wind: metrics(blade_flap_del=0.9 - 0.1 * k) for k, wind in enumerate(WINDS)},
        "late": {wind: None if k == 1 else metrics() for k, wind in enumerate(WINDS)},
    }
    gain = robustness._gain(runs, "better", "discon")
    assert gain.by_wind == pytest.approx((0.02, 0.04, 0.06))  # the flapwise load weighs 0.2
    assert gain.value == pytest.approx(0.04)
    assert (gain.low, gain.high) == (None, None)  # one wind at 18 m/s
    early = robustness._gain(runs, "late", "discon")
    assert early.value is None
    assert [one is None for one in early.by_wind] == [False, True, False]


def test_what_is_kept_is_a_share_of_the_nominal_gain_over_the_base():
    def gain(value):
        return Gain(value, None, None, (value,))

    conditions = chosen(["delay", "servo"])
    found = Robustness(
        {}, "discon", {"discon": None, "agent": "ipc"}, conditions,
        {one.name: {"agent": gain(0.1)} for one in conditions},
        {name: {"agent": gain(value)} for name, value in ((NOMINAL, 0.02), ("delay", 0.015), ("servo", None))},
    )  # fmt: skip
    assert found.kept(NOMINAL, "agent") == 1.0
    assert found.kept("delay", "agent") == pytest.approx(0.75)
    assert found.kept("servo", "agent") is None
    rows = found.to_markdown().splitlines()
    assert any(row.startswith("| all readings 0.2 s late | +10.00 % | +1.50 % | 75 % |") for row in rows)
    assert any("1 runs ended early" in row for row in rows)
    assert json.loads(json.dumps(found.to_json()))["kept"]["delay"]["agent"] == pytest.approx(0.75)


def test_conditions_are_variations_of_one_environment():
    assert [one.name for one in chosen()] == list(CONDITIONS)
    assert [one.name for one in chosen(["delay", "delay"])] == [NOMINAL, "delay"]
    assert len(CONDITIONS) == 17
    for one in CONDITIONS.values():
        env = gym.make(TASK, variation=one.variation.as_dict()).unwrapped
        assert env.options.variation == one.variation
        assert ("variation" not in env.terms) == (one.name == NOMINAL)
    with pytest.raises(ValueError, match=r"a condition must be faults or one of nominal, .*, got 'dely'; did you mean"):
        chosen(["dely"])


def test_every_fault_is_a_condition():
    assert [one.name for one in chosen(["faults", "delay"])] == [NOMINAL, *FAULT_CONDITIONS, "delay"]
    assert {one.fault for one in FAULT_CONDITIONS.values()} == set(FAULT_KINDS) - {NO_FAULT}
    env = gym.make(TASK, start="steady", **FAULT_CONDITIONS["fault-dead-moment"].arguments).unwrapped
    told = [env.reset(seed=seed)[1]["fault"] for seed in (1, 2)]
    assert {(one["kind"], one["time"]) for one in told} == {("dead_moment", FAULT_TIME)}


def test_runs_are_kept_and_the_same_call_resumes(tmp_path):
    config = EvaluationConfig(TASK, {"start": "steady"}, (Wind(15.0, 1001), Wind(15.0, 1002)), duration=3.0, skip=1.0)
    agents, seen = {"discon": "discon", "still": "zero", "ipc": "ipc"}, [NOMINAL, "gain-high", "delay"]
    conditions = chosen(seen[1:])
    ipc = {"controller": "ipc", "observation": None, "reward_credit": False}
    config = replace(config, env_kwargs=config.env_kwargs | ipc)
    found = run_robustness(agents, config, conditions, folder=tmp_path, progress=False)
    assert found.bases == {"discon": None, "still": "ipc", "ipc": None}
    for name in seen:
        # zero actions are the base controller, whatever the condition
        assert found.over_base[name]["still"].by_wind == (0.0, 0.0)
        assert found.over_reference[name]["still"] == found.over_reference[name]["ipc"]
    gains = {name: found.over_reference[name]["ipc"].by_wind for name in seen}
    assert len(set(gains.values())) == 3
    again = run_robustness(agents, config, conditions, folder=tmp_path, progress=False)
    assert again == found
    for name in seen:
        assert json.loads((tmp_path / name / SWEEP_FILE).read_text())[-1]["found"] == 6
    assert json.loads((tmp_path / "robustness.json").read_text())["conditions"]["delay"] == {"sensor_delay": 0.2}
    varied = replace(config, env_kwargs={"variation": Variation(pitch_gain=1.1)})
    with pytest.raises(ValueError, match="variation must be left out of env_kwargs"):
        run_robustness(agents, varied, conditions, folder=tmp_path)
    with pytest.raises(ValueError, match="the first condition must be 'nominal'"):
        run_robustness(agents, config, conditions[1:], folder=tmp_path)


def test_the_command(tmp_path, capsys):
    run_command("robustness", ["--list"])
    assert capsys.readouterr().out.count("\n") == len(CONDITIONS) + len(FAULT_CONDITIONS)
    run_command("robustness", [
        "ipc", "--conditions", "gain-high", "--wind-seeds", "1001", "--duration", "4", "--skip", "1", "--json",
        "--env-kwargs", '{"start": "steady"}', "--out", str(tmp_path / "out"),
    ])  # fmt: skip
    out = capsys.readouterr().out
    assert "| response to pitch × 1.25 |" in out
    assert json.loads(out.splitlines()[-1])["conditions"] == {NOMINAL: {}, "gain-high": {"pitch_gain": 1.25}}
    with pytest.raises(SystemExit, match="error: agents must be named"):
        run_command("robustness", ["--out", str(tmp_path / "no")])
