"""Agents on the real environment: predict(), training with its files, reproducible evaluation and the report."""

import csv
import json
import math
import shutil
import subprocess
import sys

import gymnasium as gym
import numpy as np
import pytest

import wt_gym  # noqa: F401 - registers the environments
from wt_gym.analysis.metrics import LIMIT_METRICS, METRICS, TRACKING_METRICS
from wt_gym.analysis.report import write_report
from wt_gym.analysis.results import Evaluation, Wind
from wt_gym.analysis.statistics import WindClimate
from wt_gym.analysis.summary import summarize
from wt_gym.base.errors import ActionError, SimulationError
from wt_gym.commands import main
from wt_gym.control.controllers import BaselineController
from wt_gym.envs.layout import layout_of
from wt_gym.experiment.agents import ConstantAgent, ControllerAgent, load_agent
from wt_gym.experiment.evaluation import EvaluationConfig, evaluate
from wt_gym.experiment.names import BASELINE, named_choices
from wt_gym.experiment.trained_agent import TrainedAgent
from wt_gym.learning.train import TrainingConfig, train
from wt_gym.simulation import Simulator

TURBULENT = "wt_gym/NREL5MW-Turbulent-v1"
STEADY = "wt_gym/NREL5MW-Steady-v1"


def demands(env, agent, steps=25, **options):
    """Demands of pitch and torque over an episode under an agent."""
    observation, _ = env.reset(seed=1, options={"azimuth": 0.0, **options})
    rows = []
    for _ in range(steps):
        action, _ = agent.predict(observation)
        observation, *_ = env.step(action)
        rows.append([*env.unwrapped.demand.pitch, env.unwrapped.demand.generator_torque])
    return np.array(rows)


@pytest.mark.parametrize("mode", ["rate", "absolute"])
@pytest.mark.parametrize("pitch", ["collective", "individual"])
def test_baseline_demands_what_its_controller_commands(mode, pitch):
    env = gym.make(TURBULENT, wind_speed=13.0, action_mode=mode, pitch=pitch)
    agent, controller = ControllerAgent(layout_of(env)), BaselineController()
    observation, _ = env.reset(seed=1)
    raw = env.unwrapped
    controller.start(raw.signals["generator_speed"], raw.demand.pitch, raw.demand.generator_torque)
    for _ in range(40):
        expected_pitch, expected_torque = controller.step(raw.signals["generator_speed"], raw.control_dt)
        action, _ = agent.predict(observation)
        observation, *_ = env.step(action)
        np.testing.assert_allclose(raw.demand.pitch, expected_pitch, atol=2e-5)
        assert raw.demand.generator_torque == pytest.approx(expected_torque, rel=2e-5)


def test_baseline_starts_afresh_in_a_new_episode():
    env = gym.make(TURBULENT)
    agent = ControllerAgent(layout_of(env))
    demands(env, agent, wind_speed=16.0)
    again = demands(env, agent, wind_speed=9.0)
    fresh = demands(env, ControllerAgent(layout_of(env)), wind_speed=9.0)
    np.testing.assert_allclose(again, fresh)


def test_baseline_serves_vector_environments():
    vec = gym.make_vec(TURBULENT, num_envs=2, vectorization_mode="sync", wind_speed=13.0)
    agent = ControllerAgent(layout_of(vec))
    observations, _ = vec.reset(seed=[1, 2])
    single = gym.make(TURBULENT, wind_speed=13.0)
    one = ControllerAgent(layout_of(single))
    observation, _ = single.reset(seed=1)
    for _ in range(5):
        actions, _ = agent.predict(observations)
        assert actions.shape == (2, 3)
        action, _ = one.predict(observation)
        np.testing.assert_array_equal(actions[0], action)
        observations, *_ = vec.step(actions)
        observation, *_ = single.step(action)


@pytest.mark.parametrize("observation", [("rotor", "pitch"), ("power", "pitch"), ("rotor", "power")])
def test_baseline_needs_its_measurements(observation):
    env = gym.make(STEADY, observation=observation)
    with pytest.raises(KeyError, match="the observation has no channel"):
        ControllerAgent(layout_of(env))


def test_baseline_holds_rated_speed_above_rated_wind():
    env = gym.make(STEADY, wind_speed=16.0, episode_length=60.0)
    agent = ControllerAgent(layout_of(env))
    observation, _ = env.reset(seed=0)
    truncated = False
    while not truncated:
        observation, _, terminated, truncated, _ = env.step(agent.predict(observation)[0])
        assert not terminated
    signals = env.unwrapped.signals
    assert signals["rotor_speed"] * 30 / math.pi == pytest.approx(12.1, abs=0.15)
    assert signals["generator_power"] == pytest.approx(5e6, rel=0.02)


def test_constant_agent():
    env = gym.make(STEADY)
    layout = env.unwrapped.layout
    agent = ConstantAgent(layout, [0.0, 0.5, -1.0])
    np.testing.assert_array_equal(agent.predict(np.zeros(31))[0], np.float32([0.0, 0.5, -1.0]))
    assert agent.predict(np.zeros((4, 31)))[0].shape == (4, 3)
    with pytest.raises(ActionError):
        ConstantAgent(layout, [0.0, 2.0, 0.0])


@pytest.fixture(scope="module")
def trained(tmp_path_factory):
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


def test_training_leaves_model_statistics_record_and_checkpoints(trained):
    folder, record = trained
    assert record["steps"] == 256
    assert record == json.loads((folder / "training.json").read_text()) | {"config": record["config"]}
    assert len(record["curve"]["steps"]) >= 4
    names = {path.name for path in (folder / "checkpoints").iterdir()}
    assert {"ppo_128_steps.zip", "ppo_vecnormalize_128_steps.pkl"} <= names
    agent = TrainedAgent.load(folder)
    assert agent.record["algorithm"] == "PPO"
    assert agent.normalization.obs_rms.count > 250


def test_a_checkpoint_comes_with_its_own_statistics(trained, tmp_path):
    folder, record = trained
    agent = TrainedAgent.load(folder / "checkpoints" / "ppo_128_steps.zip")
    assert agent.normalization.obs_rms.count == pytest.approx(129.0, abs=1.0)
    assert agent.record["algorithm"] == record["algorithm"]
    assert agent.record["checkpoint"] == agent.model.num_timesteps == 128
    (tmp_path / "checkpoints").mkdir()
    lone = tmp_path / "checkpoints" / "ppo_128_steps.zip"
    shutil.copy(folder / "checkpoints" / "ppo_128_steps.zip", lone)
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


@pytest.mark.parametrize(
    ("what", "k", "name", "message"),
    [
        ("observation", 4, "power", "power as component 4 of the observation, the environment has .*_demand there"),
        ("action", 2, "torque", "torque as component 2 of the action, the environment has generator_torque_rate there"),
    ],
)
def test_a_model_for_other_components_of_the_same_shape_is_refused(trained, what, k, name, message):
    folder, record = trained
    agent = TrainedAgent.load(folder)
    layout = gym.make(STEADY).unwrapped.layout
    agent.check_fits(layout)
    names = list(record[what])
    names[k] = name
    agent.record = record | {what: names}
    with pytest.raises(ValueError, match=message):
        agent.check_fits(layout)
    with pytest.raises(FileNotFoundError, match="no trained model"):
        TrainedAgent.load(trained[0] / "nothing")


def test_time_limit_ends_the_training(tmp_path):
    config = TrainingConfig(
        env_id=STEADY,
        env_kwargs={"wind_speed": 12.0},
        hyperparameters={"n_steps": 32, "batch_size": 32},
        total_steps=10**7,
        n_envs=2,
        max_seconds=1.0,
        eval_every=0,
        tensorboard=False,
    )
    record = train(config, tmp_path, progress=False)
    assert record["status"] == "time limit"
    assert record["steps"] < 10**5


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
        *LIMIT_METRICS,
    }  # no power is demanded, nothing limited
    replay = result.run("PPO", Wind(12.0, 1001)).replay
    assert replay.blades.shape[:3] == (75, 3, 2)  # shorter than the replay: all of it
    np.testing.assert_allclose(replay.time[[0, -1]], [0.2, 15.0])
    assert result.run("PPO", Wind(16.0, 1002)).replay is None  # only of the first wind


def test_metrics_leave_out_the_start(evaluation):
    _, result = evaluation
    run = result.run(BASELINE, Wind(16.0, 1002))
    power = run.data["generator_power"].values[1 + 25 :]  # after the first step and 5 s
    assert run.metrics["mean_power"] == pytest.approx(power.mean())


def test_a_run_that_fails_in_its_first_step_can_be_reported(monkeypatch, tmp_path):
    def fail(*_args, **_kwargs):
        raise SimulationError("diverged")

    monkeypatch.setattr(Simulator, "advance", fail)
    config = EvaluationConfig(env_id=STEADY, winds=(Wind(12.0),), duration=8.0, skip=4.0)
    result = evaluate({BASELINE: "baseline", "Constant": "constant"}, config, progress=False)
    assert result.runs[0].data["time"].values.tolist() == [0.0]
    assert "nan" not in " ".join(summarize(result))
    write_report(result, tmp_path / "report.html")


def test_vector_rewards_are_evaluated_by_their_sum():
    runs = [
        evaluate(
            {"Constant": "constant"},
            EvaluationConfig(
                env_id=STEADY, env_kwargs={"vector_reward": vector}, winds=(Wind(9.0),), duration=4.0, skip=1
            ),
            progress=False,
        ).runs[0]
        for vector in (False, True)
    ]
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


def test_report_is_one_file_that_needs_no_network(evaluation, tmp_path):
    _, result = evaluation
    page = write_report(result, tmp_path / "report.html", "A test").read_text(encoding="utf-8")
    assert page.count("A test") == 2
    # changes, front, learning curve, spectra, and a wind of each speed
    assert page.count("data-figure=") == 4 + len(result.speeds)
    assert 'src="http' not in page
    assert "<!--" not in page.split("<script>")[0]
    for agent in result.agents:
        assert agent in page


def test_names_on_the_command_line(trained):
    folder = str(trained[0])
    assert named_choices(["baseline", folder]) == {BASELINE: "discon", trained[0].name: folder}
    assert named_choices(["a=baseline", f"b={folder}"]) == {"a": "discon", "b": folder}
    with pytest.raises(ValueError, match="two agents"):
        named_choices([folder, folder])


@pytest.mark.parametrize(
    ("command", "message"),
    [
        (["evaluate", "no/such/agent"], "got 'no/such/agent'"),
        (["evaluate", "--env", STEADY, "--wind-speed", "60"], "between 0 and 50 m/s"),
        (["evaluate", "--env", "CartPole-v1"], "must be one of wt_gym/"),
        (["evaluate", "--env", "NoSuchEnv-v0"], "NoSuchEnv"),
        (["evaluate", "--env-kwargs", '{"episode_length": 50}'], "episode_length"),
        (["evaluate", "--env-kwargs", '{"color": 1}'], "no argument 'color'"),
        (["evaluate", "--duration", "20", "--skip", "30"], "duration must be 2 s longer than skip"),
        (["train", "--env", "CartPole-v1"], "must be one of wt_gym/"),
        (["train", "--wind-speed", "60"], "between 0.5 and 50 m/s"),
        (["train", "--env-kwargs", "[1]"], "must be a JSON object"),
        (["train", "--steps", "-5", "--wind-speed", "12"], "total_steps must be a whole number from 0"),
        (["train", "--max-seconds", "nan"], "max_seconds must be a number"),
        (["train", "--hyper", "gama=0.9"], "no option 'gama'"),
        (["simulate", "--wind-speed", "nan"], "wind_speed must be numbers from 0 to 50 m/s, got (nan,)"),
        (["simulate", "--duration", "0"], "duration must be a number from 1 to 1e+06 s, got 0.0"),
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
