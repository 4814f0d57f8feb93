"""Agents on the real environment: predict(), training with its files, reproducible evaluation and the report."""

import csv
import json
import shutil
import subprocess
import sys

import gymnasium as gym
import numpy as np
import pytest

from envs_tests.env.scripted_simulator import Swinging
from wt_gym.analysis.metrics import LIMIT_METRICS, METRICS, PLATFORM_METRICS, TRACKING_METRICS
from wt_gym.analysis.report import write_report
from wt_gym.analysis.results import Evaluation, Wind
from wt_gym.analysis.statistics import WindClimate
from wt_gym.analysis.summary import summarize
from wt_gym.base.errors import ActionError
from wt_gym.commands import main
from wt_gym.experiment.agents import ConstantAgent, load_agent
from wt_gym.experiment.evaluation import EvaluationConfig, evaluate
from wt_gym.experiment.names import BASELINE
from wt_gym.experiment.trained_agent import TrainedAgent
from wt_gym.learning.train import TrainingConfig, train

TURBULENT = "wt_gym/NREL5MW-Turbulent-v1"
STEADY = "wt_gym/NREL5MW-Steady-v1"
pytestmark = pytest.mark.usefixtures("scripted_module")


def test_constant_agent():
    env = gym.make(STEADY)
    layout = env.unwrapped.layout
    agent = ConstantAgent(layout, [0.0, 0.5, -1.0])
    np.testing.assert_array_equal(agent.predict(np.zeros(31))[0], np.float32([0.0, 0.5, -1.0]))
    assert agent.predict(np.zeros((4, 31)))[0].shape == (4, 3)
    with pytest.raises(ActionError):
        ConstantAgent(layout, [0.0, 2.0, 0.0])


@pytest.fixture(scope="module")
def trained(tmp_path_factory, scripted_module):
    folder = tmp_path_factory.mktemp("ppo")
    config = TrainingConfig(
        env_id=STEADY,
        env_kwargs={"wind_speed": (10.0, 14.0), "episode_length": 10.0},
        hyperparameters={"n_steps": 64, "batch_size": 32, "n_epochs": 2, "normalize_observations": True},
        total_steps=256,
        n_envs=1,
        checkpoint_steps=128,
        eval_every=0,
        tensorboard=False,
    )
    return folder, train(config, folder, progress=False)


def test_training_leaves_model_statistics_record_and_checkpoints(trained, tmp_path):
    folder, record = trained
    assert record["steps"] == 256
    assert record == json.loads((folder / "training.json").read_text()) | {"config": record["config"]}
    assert len(record["curve"]["steps"]) >= 4
    agent = TrainedAgent.load(folder)
    assert agent.record["algorithm"] == "PPO"
    assert agent.normalization.obs_rms.count > 250
    checkpoint = folder / "checkpoints" / "ppo_128_steps.zip"
    agent = TrainedAgent.load(checkpoint)
    assert agent.normalization.obs_rms.count == pytest.approx(129.0, abs=1.0)
    assert agent.record["algorithm"] == "PPO"
    assert agent.record["checkpoint"] == agent.model.num_timesteps == 128
    (tmp_path / "checkpoints").mkdir()
    lone = shutil.copy(checkpoint, tmp_path / "checkpoints")
    shutil.copy(folder / "training.json", tmp_path)
    with pytest.raises(FileNotFoundError, match="normalized observations"):
        TrainedAgent.load(lone)


def test_trained_agent_normalizes_the_observation(trained):
    folder, _ = trained
    agent = TrainedAgent.load(folder / "model.zip")
    env = gym.make(STEADY, wind_speed=12.0)
    observation, _ = env.reset(seed=0)
    statistics = agent.normalization.obs_rms
    scaled = np.clip((observation - statistics.mean) / np.sqrt(statistics.var + 1e-8), -10, 10)
    expected, _ = agent.model.predict(scaled.astype(np.float32), deterministic=True)
    np.testing.assert_allclose(agent.predict(observation)[0], expected, atol=1e-6)
    assert env.action_space.contains(agent.predict(observation)[0])


def test_a_model_for_another_environment_is_refused(trained):
    env = gym.make(STEADY, pitch="individual")
    with pytest.raises(ValueError, match=r"trained with pitch as component 5 of the observation, .* has pitch_1 there"):
        load_agent(str(trained[0]), env.unwrapped.layout).check_fits(env.unwrapped.layout)
    unknown = TrainedAgent(TrainedAgent.load(trained[0]).model)
    with pytest.raises(ValueError, match="shapes"):
        unknown.check_fits(env.unwrapped.layout)

    names = list(trained[1]["action"])
    names[2] = "torque"
    agent = TrainedAgent.load(trained[0])
    agent.record = trained[1] | {"action": names}
    with pytest.raises(ValueError, match="torque as component 2 of the action, the environment has generator_torque_r"):
        agent.check_fits(gym.make(STEADY).unwrapped.layout)


@pytest.fixture(scope="module")
def evaluation(trained):
    winds = (Wind(12.0, 1001), Wind(16.0, 1002))
    config = EvaluationConfig(env_id=TURBULENT, winds=winds, duration=15.0, skip=5.0)
    return config, evaluate({BASELINE: "baseline", "PPO": str(trained[0])}, config, progress=False)


def test_evaluation_covers_agents_and_winds(evaluation):
    _, result = evaluation
    assert result.agents == [BASELINE, "PPO"]
    assert len(result.runs) == 4
    for run in result.runs:
        assert set(run.data.data_vars) >= {"generator_power", "root_flap_moment_1", "tower_base_fore_aft_moment"}
        assert run.data["generator_power"].attrs["units"] == "W"
        assert run.episode_return == pytest.approx(sum(run.reward_terms.values()))
    base = result.run(BASELINE, Wind(16.0, 1002))
    assert base.complete
    np.testing.assert_allclose(base.data["time"], np.arange(76) * 0.2)
    assert set(base.metrics) == set(METRICS) - {
        *TRACKING_METRICS,
        *PLATFORM_METRICS,
        *LIMIT_METRICS,
    }  # no power is demanded, nothing limited, nothing floats
    power = base.data["generator_power"].values[1 + 25 :]  # after the first step and 5 s
    assert base.metrics["mean_power"] == pytest.approx(power.mean())
    replay = result.run("PPO", Wind(12.0, 1001)).replay
    assert replay.blades.shape[:3] == (75, 3, 2)  # shorter than the replay: all of it
    np.testing.assert_allclose(replay.time[[0, -1]], [0.2, 15.0])
    assert result.run("PPO", Wind(16.0, 1002)).replay is None  # only of the first wind


def test_a_run_that_fails_in_its_first_step_can_be_reported(monkeypatch, tmp_path):
    monkeypatch.setattr(Swinging, "break_at", 0.1)
    config = EvaluationConfig(env_id=STEADY, winds=(Wind(12.0),), duration=8.0, skip=4.0)
    result = evaluate({BASELINE: "baseline", "Constant": "constant"}, config, progress=False)
    assert result.runs[0].data["time"].values.tolist() == [0.0]
    assert "nan" not in " ".join(summarize(result))
    write_report(result, tmp_path / "report.html")


def test_vector_rewards_are_evaluated_by_their_sum():
    runs = []
    for vector in (False, True):
        config = EvaluationConfig(STEADY, {"vector_reward": vector}, (Wind(9.0),), duration=4.0, skip=1)
        runs += evaluate({"Constant": "constant"}, config, progress=False).runs
    assert runs[1].episode_return == pytest.approx(runs[0].episode_return, rel=1e-6)
    assert runs[1].reward_terms == runs[0].reward_terms


def test_evaluation_is_saved_and_read_back(evaluation, tmp_path):
    _, result = evaluation
    table = json.loads(result.save(tmp_path).read_text())
    assert table["mean"][BASELINE] == result.mean_metrics(BASELINE)
    loaded = Evaluation.load(tmp_path)
    assert loaded.to_json() == result.to_json()
    assert loaded.runs[0].data.equals(result.runs[0].data)
    np.testing.assert_array_equal(loaded.runs[0].replay.wake, result.runs[0].replay.wake)
    assert loaded.climate == result.climate == WindClimate.of_class("I")
    rows = list(csv.DictReader((tmp_path / "metrics.csv").open()))
    assert [row["agent"] for row in rows] == [BASELINE, "PPO"] * 2
    assert float(rows[2]["blade_flap_del"]) == result.runs[2].metrics["blade_flap_del"]


@pytest.mark.parametrize(
    ("command", "message"),
    [
        (["evaluate", "no/such/agent"], "got 'no/such/agent'"),
        (["evaluate", "--env", STEADY, "--wind-speed", "60"], "between 0 and 50 m/s"),
        (["evaluate", "--env", "CartPole-v1"], "must be one of wt_gym/"),
        (["evaluate", "--env-kwargs", '{"episode_length": 50}'], "episode_length"),
        (["train", "--wind-speed", "60"], "between 0.5 and 50 m/s"),
        (["train", "--env-kwargs", "[1]"], "must be a JSON object"),
        (["simulate", "--wind-speed", "nan"], "wind_speed must be numbers from 0 to 50 m/s, got (nan,)"),
        (["simulate", "--turbulent", "--wind-speed", "0.1"], "from 0.5 m/s with --turbulent, got 0.1"),
        (["simulate", "--duration", "-5"], "duration must be a number from 1 to 1e+06 s, got -5.0"),
        (["simulate", "--wave-period", "12"], "--wave-period must have waves: --wave-height above 0 m"),
    ],
)
def test_errors_of_the_user_take_one_line(command, message, tmp_path):
    with pytest.raises(SystemExit) as ended:
        main([*command, "--out", str(tmp_path / ("out.nc" if command[0] == "simulate" else "out"))])
    error = ended.value.code  # Python prints a text that is given as exit status, and ends with status 1
    assert error.startswith("error: ")
    assert message in error
    assert "\n" not in error


def test_the_evaluation_prints_json_and_writes_a_report(tmp_path):
    arguments = ["baseline", "constant", "--env", STEADY, "--wind-speed", "9", "--duration", "8", "--skip", "4"]
    done = subprocess.run(
        [sys.executable, "-m", "wt_gym", "evaluate", *arguments, "--out", tmp_path, "--json"],
        capture_output=True, text=True, check=True,
    )  # fmt: skip
    table = json.loads(done.stdout.splitlines()[-1])
    assert set(table["mean"]) == {BASELINE, "zero"}
    assert (tmp_path / "report.html").stat().st_size > 4e6
    assert "1/2 runs, discon at 9 m/s" in done.stderr
