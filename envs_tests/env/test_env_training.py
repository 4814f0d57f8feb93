"""Training: resuming, stopping by signals, folders and their locks, evaluation in other winds, seeds, damaged files."""

import json
import os
import pickle
import signal
import subprocess
import sys
from dataclasses import MISSING, replace
from unittest.mock import Mock

import gymnasium as gym
import numpy as np
import pytest
import torch

from envs_tests.env.scripted_simulator import Swinging
from wt_gym.commands import parse as parse_command
from wt_gym.commands import run as run_command
from wt_gym.commands import train as train_command
from wt_gym.envs.wind_sampler import EVALUATION_WIND_SEEDS, TRAINING_WIND_SEEDS
from wt_gym.experiment import evaluation
from wt_gym.experiment.agents import ConstantAgent
from wt_gym.experiment.names import named_choices
from wt_gym.experiment.run_folder import RunFolder
from wt_gym.experiment.trained_agent import TrainedAgent
from wt_gym.learning import callbacks
from wt_gym.learning import seeds as seeds_module
from wt_gym.learning.callbacks import SELECTION_WIND_SEEDS, SelectionEvaluation
from wt_gym.learning.options import TrainingConfig
from wt_gym.learning.seeds import resume_seeds, seeds_table, train_seeds
from wt_gym.learning.train import resume, train

STEADY = "wt_gym/NREL5MW-Steady-v1"
pytestmark = pytest.mark.usefixtures("scripted_module")
SMALL = TrainingConfig(
    env_id=STEADY,
    env_kwargs={"wind_speed": 12.0, "episode_length": 5.0},
    hyperparameters={"n_steps": 32, "batch_size": 32, "n_epochs": 1, "normalize_observations": True},
    total_steps=64,
    n_envs=1,
    eval_every=0,
    eval_seconds=15.0,
    tensorboard=False,
)
OFF_POLICY = {"learning_starts": 16, "buffer_size": 500, "batch_size": 16}


def parameters(folder):
    return torch.cat([p.detach().flatten() for p in TrainedAgent.load(folder).model.policy.parameters()])


def test_a_resumed_training_goes_on_in_every_account(tmp_path, caplog):
    config = replace(
        SMALL, hyperparameters=SMALL.hyperparameters | {"learning_rate": "lin_1e-3"}, eval_every=32, tensorboard=True
    )
    first = train(config, tmp_path, progress=False)
    assert first["status"] == "finished"
    second = resume(tmp_path, total_steps=128, progress=False)
    assert second["steps"] == 128
    assert second["config"] == first["config"] | {"total_steps": 128}
    assert [(s["from_step"], s["to_step"]) for s in second["sessions"]] == [(0, 64), (64, 128)]
    assert second["wall_seconds"] == pytest.approx(sum(s["seconds"] for s in second["sessions"]))
    for name, before in first["curve"].items():
        assert second["curve"][name][: len(before)] == before
    assert second["curve"]["steps"] == [25, 50, 89, 114]  # episodes of 25 steps; the one at step 64 was left
    assert second["evaluation"]["curve"]["steps"] == [32, 64, 96, 128]
    assert second["evaluation"]["baseline"] == first["evaluation"]["baseline"]
    agent = TrainedAgent.load(tmp_path)
    assert agent.model.num_timesteps == 128
    assert agent.normalization.obs_rms.count == pytest.approx(128 + 2, abs=0.1)  # and two resets
    scalars = read_scalars(tmp_path / "tensorboard")
    rates = {round(value / 1e-3, 6) for _, value in scalars["train/learning_rate"]}
    assert rates == {1 - 32 / 64, 0.0, 1 - 96 / 128}
    assert [step for step, _ in scalars["episode/return"]][-1] == 128
    assert {"episode/length_s", "episode/mean_power_mw", "reward/power", "evaluation/blade_flap_del"} <= set(scalars)
    best = TrainedAgent.load(tmp_path / "best_model.zip")
    assert best.model.num_timesteps == second["evaluation"]["best"]["steps"]
    assert best.normalization.obs_rms.count < best.model.num_timesteps + 3
    assert "training" not in caplog.text  # its own evaluations know the model and its winds


def read_scalars(folder):
    accumulator = pytest.importorskip("tensorboard.backend.event_processing.event_accumulator")
    scalars = {}
    for file in sorted(folder.iterdir()):
        events = accumulator.EventAccumulator(str(file)).Reload()
        for tag in events.Tags()["scalars"]:
            scalars.setdefault(tag, []).extend((event.step, event.value) for event in events.Scalars(tag))
    return scalars


def test_off_policy_training_keeps_its_replay_buffer(tmp_path):
    train(replace(SMALL, algorithm="TQC", hyperparameters=OFF_POLICY), tmp_path, progress=False)
    record = resume(tmp_path, total_steps=96, progress=False)
    assert record["algorithm"] == "TQC" == type(TrainedAgent.load(tmp_path).model).__name__
    assert record["config"]["hyperparameters"]["tau"] == 0.005  # of the package's file
    buffer = tmp_path / "replay_buffer.pkl"
    with buffer.open("rb") as file:
        assert pickle.load(file).pos == 96
    buffer.unlink()
    with pytest.raises(FileNotFoundError, match="requires its replay buffer"):
        resume(tmp_path, total_steps=128, progress=False)


def test_copies_without_a_vector_environment_train_in_processes(tmp_path, monkeypatch):
    monkeypatch.setattr(gym.spec(STEADY), "vector_entry_point", None)
    assert train(replace(SMALL, n_envs=2), tmp_path, progress=False)["steps"] == 64


def test_a_resumed_training_meets_other_winds_and_evaluation_changes_nothing(tmp_path):
    config = replace(SMALL, env_kwargs=SMALL.env_kwargs | {"wind_speed": (10.0, 14.0)})
    train(config, tmp_path, progress=False)
    before = parameters(tmp_path)
    again = resume(tmp_path, total_steps=128, progress=False)["curve"]["episode_return"]
    whole = train(replace(config, total_steps=128), tmp_path / "whole", progress=False)["curve"]["episode_return"]
    assert again[:2] == whole[:2]
    assert again[2] != whole[0]
    train(replace(config, eval_every=16), tmp_path / "evaluated", progress=False)
    assert torch.equal(parameters(tmp_path / "evaluated"), before)


def test_evaluation_is_in_winds_of_its_own_and_asks_the_baseline_once(monkeypatch):
    asked = []

    def spy(agents, config, **options):
        (agent,) = agents.values()
        asked.append((agent, config.winds))
        return evaluation.evaluate(agents, config, **options)

    monkeypatch.setattr(callbacks, "evaluate", spy)
    config = TrainingConfig(eval_winds=2, eval_seconds=15.0, env_kwargs={"wind_speed": (12.0, 16.0)})
    env = gym.make(config.env_id, **config.env_kwargs)
    judge = SelectionEvaluation(config, env.unwrapped.wind)
    zero = ConstantAgent(env.unwrapped.layout)
    assert set(judge(zero).values()) == {0.0}  # zero offsets are the baseline
    judge(zero)
    assert [agent == "baseline" for agent, _ in asked] == [True, False, False]
    assert [wind.speed for wind in judge.winds] == [13.0, 15.0]
    seeds = {wind.seed for _, winds in asked for wind in winds}
    assert seeds == set(SELECTION_WIND_SEEDS[:2])
    assert not set(SELECTION_WIND_SEEDS) & {*TRAINING_WIND_SEEDS, *EVALUATION_WIND_SEEDS[:6]}
    pool = {"wind_seeds": list(SELECTION_WIND_SEEDS[1:])}
    with pytest.raises(ValueError, match="eval_winds must be at most 1, "):
        SelectionEvaluation(config, gym.make(config.env_id, **pool).unwrapped.wind)


def test_a_policy_that_stops_the_rotor_has_a_return_and_no_loads(monkeypatch):
    config = TrainingConfig(env_id=STEADY, env_kwargs={"wind_speed": 12.0}, eval_seconds=30.0)
    env = gym.make(config.env_id, **config.env_kwargs).unwrapped
    judge, agent = SelectionEvaluation(config, env.wind), ConstantAgent(env.layout)
    assert judge(agent)["blade_flap_del"] is not None  # with the runs of the baseline
    monkeypatch.setattr(Swinging, "script", {1.0: {"rotor_speed": 0.0}})
    figures = judge(agent)
    assert figures["episode_return"] < -100.0
    assert figures["blade_flap_del"] is None


def interrupted(folder, send, number, *options):
    """Record of a training by the script that gets a signal; what it wrote, and its lock, are checked on the way."""
    command = [sys.executable, "-m", "wt_gym", "train", "--env", STEADY, "--wind-speed", "12", "--out", folder]
    command += ["--steps", "100000000", "--eval-every", "0", *options]
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    process = subprocess.Popen(command, text=True, start_new_session=True, **pipes)
    try:
        assert process.stderr.readline().startswith("training ")
        assert int((folder / "training.lock").read_text()) == process.pid
        send(process.pid, number)
        output, errors = process.communicate()
    finally:
        process.kill()
    assert process.returncode == 128 + number
    assert f"ended by {number.name}; resume with: wt-gym train --resume {folder}" in output
    assert "Traceback" not in errors
    assert not (folder / "training.lock").exists()
    record = json.loads((folder / "training.json").read_text())
    assert (record["status"], record["stopped_by"]) == ("interrupted", number.name)
    assert TrainedAgent.load(folder).model.num_timesteps == record["steps"]
    return record


def test_sigterm_ends_the_training_and_it_goes_on(tmp_path):
    record = interrupted(tmp_path / "run", os.kill, signal.SIGTERM, "--algo", "sac", "--n-envs", "1")
    again = resume(tmp_path / "run", max_seconds=0.0, progress=False)
    assert again["status"] == "time limit"
    assert again["steps"] == record["steps"] + 1


@pytest.mark.slow
def test_ctrl_c_reaches_all_processes_and_the_training_decides(tmp_path):
    record = interrupted(tmp_path / "run", os.killpg, signal.SIGINT, "--n-envs", "2")
    assert record["steps"] % 2 == 0


def test_one_training_at_a_time_in_a_folder(tmp_path):
    with RunFolder(tmp_path), pytest.raises(ValueError, match=rf"in use by another training \(process {os.getpid()}\)"):
        train(SMALL, tmp_path, progress=False)
    assert not list(tmp_path.iterdir())


def test_a_dead_training_holds_nobody_up_and_only_what_a_training_wrote_is_cleared(tmp_path):
    dead = subprocess.run([sys.executable, "-c", "import os; print(os.getpid())"], capture_output=True, check=True)
    (tmp_path / "training.lock").write_bytes(dead.stdout)
    (tmp_path / "checkpoints").mkdir()
    mine, left = (tmp_path / "checkpoints" / name for name in ("mine.pt", "ppo_5_steps.zip"))
    mine.touch()
    with RunFolder(tmp_path) as run:
        assert int((tmp_path / "training.lock").read_text()) == os.getpid()
        assert not run.used
        left.touch()
        assert run.used
        run.clear()
        assert (mine.exists(), left.exists()) == (True, False)


def test_a_training_is_overwritten_on_demand_only(tmp_path):
    train(replace(SMALL, checkpoint_steps=32), tmp_path, progress=False)
    (tmp_path / "notes.txt").write_text("mine")
    with pytest.raises(ValueError, match="holds a training already"):
        train(SMALL, tmp_path, progress=False)
    assert (tmp_path / "checkpoints" / "ppo_32_steps.zip").exists()
    train(SMALL, tmp_path, overwrite=True, progress=False)
    assert not (tmp_path / "checkpoints").exists()
    assert (tmp_path / "notes.txt").read_text() == "mine"


def test_a_refused_training_leaves_no_folder(tmp_path):
    with pytest.raises(ValueError, match="episode_length must be"):
        train(replace(SMALL, env_kwargs={"episode_length": "long"}), tmp_path / "new", progress=False)
    assert not (tmp_path / "new").exists()


def test_checkpoints_by_time_and_by_steps(monkeypatch):
    now, saved = [0.0], []
    monkeypatch.setattr(callbacks.time, "monotonic", lambda: now[0])
    checkpoints = callbacks.Checkpoints(100, 1.0, lambda: saved.append(checkpoints.num_timesteps))
    checkpoints.num_timesteps = 0
    checkpoints._on_training_start()
    for steps, seconds in [(50, 30.0), (90, 61.0), (98, 62.0), (102, 63.0), (150, 122.0), (160, 124.0)]:
        checkpoints.num_timesteps, now[0] = steps, seconds
        assert checkpoints._on_step()
    assert saved == [90, 102, 160]


def test_a_checkpoint_is_enough_to_go_on_after_a_crash(tmp_path, monkeypatch):
    config = replace(SMALL, checkpoint_steps=40, total_steps=128, eval_every=64)

    def crash(*_):
        raise KeyboardInterrupt  # as by a second Ctrl-C

    monkeypatch.setattr(SelectionEvaluation, "__call__", crash)
    with pytest.raises(KeyboardInterrupt):
        train(config, tmp_path, progress=False)
    monkeypatch.undo()
    assert RunFolder(tmp_path).record()["status"] == "running"
    record = resume(tmp_path, progress=False)
    assert record["status"] == "finished"
    assert record["sessions"][-1]["from_step"] == 40


@pytest.fixture(scope="module")
def finished(tmp_path_factory, scripted_module):
    folder = tmp_path_factory.mktemp("run")
    train(SMALL, folder, progress=False)
    return folder


@pytest.fixture
def copied(finished, tmp_path):
    for name in ("model.zip", "vecnormalize.pkl", "training.json"):
        (tmp_path / name).write_bytes((finished / name).read_bytes())
    return tmp_path


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("model.zip", None, "damaged"),
        ("vecnormalize.pkl", None, "statistics .* are damaged"),
        ("vecnormalize.pkl", pickle.dumps([1, 2]), "holds no statistics"),
        ("training.json", None, "training.json is damaged"),
        ("training.json", b"\xff\xfe", "training.json is damaged"),
        ("training.json", b"{}", "names no algorithm"),
        ("training.json", b'{"algorithm": "XYZ"}', "algorithm must be one of"),
        ("training.json", b'{"algorithm": "SAC"}', "is not a model of SAC"),
    ],
)
def test_damaged_agents_are_refused_in_a_line(copied, name, content, message):
    """Files with other content, or of half their length."""
    whole = (copied / name).read_bytes()
    (copied / name).write_bytes(whole[: len(whole) // 2] if content is None else content)
    with pytest.raises(ValueError, match=message):
        TrainedAgent.load(copied)


def test_nothing_is_left_to_resume(copied, tmp_path):
    with pytest.raises(ValueError, match="has done its 64 steps"):
        resume(copied, progress=False)
    with pytest.raises(FileNotFoundError, match="holds no training"):
        resume(tmp_path / "nothing")


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"config": None}, "must be a TrainingConfig or a mapping"),
        ({"config": MISSING}, "must be a TrainingConfig or a mapping"),
        ({"config": {"n_steps": 64}}, "training has no option 'n_steps'"),
        ({"curve": {"steps": [1, 2]}}, "its curve must have the columns"),
        ({"wall_seconds": "long"}, "wall_seconds is 'long'"),
        ({"environment": {}}, "has other arguments now .*: "),
    ],
)
def test_damaged_records_are_not_resumed(copied, changes, message):
    record = json.loads((copied / "training.json").read_text()) | changes
    record = {name: value for name, value in record.items() if value is not MISSING}
    (copied / "training.json").write_text(json.dumps(record))
    with pytest.raises(ValueError, match=message):
        resume(copied, total_steps=128, progress=False)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"env_kwargs": {"vector_reward": True}}, "vector_reward"),
        ({"hyperparameters": {"color": 1}}, "hyperparameters of PPO: .* has no option 'color'"),
    ],
)
def test_incompatible_options_are_refused(changes, message):
    with pytest.raises(ValueError, match=message):
        replace(SMALL, **changes)


def test_several_seeds_one_after_another(tmp_path):
    config = replace(SMALL, eval_every=64)
    summary = train_seeds(config, tmp_path, [3, 5], progress=False)
    assert [(run["seed"], run["steps"], run["status"]) for run in summary["runs"]] == [
        (3, 64, "finished"), (5, 64, "finished"),
    ]  # fmt: skip
    assert not torch.equal(parameters(tmp_path / "seed-3"), parameters(tmp_path / "seed-5"))
    assert json.loads((tmp_path / "seeds.json").read_text())["summary"] == summary
    returns = [run["best"]["episode_return"] for run in summary["runs"]]
    assert f"return against the baseline's: {np.mean(returns):+.2f}" in "\n".join(seeds_table(summary["runs"]))
    with pytest.raises(ValueError, match="differ from each other"):
        train_seeds(config, tmp_path / "other", [1, 1], progress=False)
    done = (tmp_path / "seed-3" / "training.json").read_bytes()
    for file in (tmp_path / "seed-5").iterdir():
        file.unlink()
    assert [run["status"] for run in resume_seeds(tmp_path, progress=False)["runs"]] == ["finished", "finished"]
    assert (tmp_path / "seed-3" / "training.json").read_bytes() == done
    for more in ({"total_steps": 96}, {}):
        assert [run["steps"] for run in resume_seeds(tmp_path, progress=False, **more)["runs"]] == [96, 96]
    (tmp_path / "seeds.json").write_text("{}")
    with pytest.raises(ValueError, match=r"seeds\.json is damaged"):
        resume_seeds(tmp_path, progress=False)


def test_a_signal_ends_all_seeds(tmp_path, monkeypatch):
    ask = SelectionEvaluation.__call__

    def late(self, agent):  # while the last model is evaluated: that training is done, the next must not begin
        os.kill(os.getpid(), signal.SIGTERM)
        return ask(self, agent)

    monkeypatch.setattr(SelectionEvaluation, "__call__", late)
    summary = train_seeds(replace(SMALL, eval_every=1000), tmp_path, [1, 2], progress=False)
    assert (summary["status"], summary["stopped_by"]) == ("interrupted", "SIGTERM")
    assert [run["status"] for run in summary["runs"]] == ["finished"]
    assert not (tmp_path / "seed-2").exists()
    monkeypatch.undo()
    assert [run["seed"] for run in resume_seeds(tmp_path, progress=False)["runs"]] == [1, 2]


def test_more_steps_hold_for_every_seed_however_often_the_series_is_stopped(tmp_path, monkeypatch):
    train_seeds(SMALL, tmp_path, [1, 2], progress=False)

    def stop_at_once(folder, **options):
        os.kill(os.getpid(), signal.SIGTERM)
        return resume(folder, **options)

    with monkeypatch.context() as patch:
        patch.setattr(seeds_module, "resume", Mock(side_effect=MemoryError))
        with pytest.raises(MemoryError):
            resume_seeds(tmp_path, total_steps=80, progress=False)
        assert json.loads((tmp_path / "seeds.json").read_text())["config"]["total_steps"] == 80
        patch.setattr(seeds_module, "resume", stop_at_once)
        summary = resume_seeds(tmp_path, total_steps=96, progress=False)
    assert (summary["status"], [run["seed"] for run in summary["runs"]]) == ("interrupted", [1])
    assert json.loads((tmp_path / "seeds.json").read_text())["config"]["total_steps"] == 96
    steps = [run["steps"] for run in resume_seeds(tmp_path, progress=False)["runs"]]
    assert steps == [64 + 1 + 32, 64 + 32]  # the first was stopped after one more step; rollouts are of 32


def test_a_seed_that_was_stopped_at_its_last_step_holds_up_no_other(tmp_path):
    train_seeds(replace(SMALL, eval_every=1000), tmp_path, [1, 2], progress=False)
    record = RunFolder(tmp_path / "seed-1").record()
    stopped = record["evaluation"] | {"curve": {name: [] for name in record["evaluation"]["curve"]}, "best": None}
    RunFolder(tmp_path / "seed-1").write_record(record | {"status": "interrupted", "evaluation": stopped})
    (tmp_path / "seed-2" / "model.zip").unlink()
    summary = resume_seeds(tmp_path, progress=False)
    assert (summary["status"], [run["status"] for run in summary["runs"]]) == ("finished", ["finished"] * 2)
    assert RunFolder(tmp_path / "seed-1").record()["evaluation"]["curve"]["steps"] == [64]  # made up for


def test_seeds_of_an_overwritten_series_are_not_those_of_the_new_one(tmp_path):
    train_seeds(SMALL, tmp_path, [1, 2, 3], progress=False)
    other = replace(SMALL, hyperparameters=SMALL.hyperparameters | {"gamma": 0.5})
    train_seeds(other, tmp_path, [1, 2], overwrite=True, progress=False)
    before = RunFolder(tmp_path / "seed-3").record()
    assert list(named_choices([f"mine={tmp_path}"])) == ["mine seed 1", "mine seed 2"]
    # as if the second series had been stopped before its second seed
    (tmp_path / "seed-2" / "training.json").write_text(json.dumps(before | {"config": before["config"] | {"seed": 2}}))
    assert [run["seed"] for run in resume_seeds(tmp_path, progress=False)["runs"]] == [1, 2]
    assert RunFolder(tmp_path / "seed-2").record()["config"]["hyperparameters"]["gamma"] == 0.5
    (tmp_path / "seeds.json").unlink()
    with pytest.raises(ValueError, match="seed-3 holds a training already"):
        train_seeds(SMALL, tmp_path, [4, 3], progress=False)
    assert not (tmp_path / "seed-4").exists()


# ---- the same words again ----

FILE = """
algo: ppo
env: wt_gym/NREL5MW-Steady-v1
env_kwargs: {wind_speed: 12.0, episode_length: 5.0}
hyper: {n_steps: 32, batch_size: 32, n_epochs: 1, net_arch: [8, 8], learning_rate: 1.0e-3}
steps: 64
n_envs: 1
eval_every: 0
tensorboard: false
"""


def run_train(capsys, *words):
    """Call the command in this process; give the record it prints."""
    run_command("train", [*map(str, words), "--json"])
    return json.loads(capsys.readouterr().out.splitlines()[-1])


def test_the_same_words_begin_and_go_on(tmp_path, capsys):
    file = tmp_path / "run.yml"
    file.write_text(FILE + f"out: {tmp_path / 'run'}\nresume_if_exists: true\nseeds: [3, 5]\n")
    first = run_train(capsys, "--config", file)
    assert [(run["seed"], run["steps"]) for run in first["runs"]] == [(3, 64), (5, 64)]
    before = parameters(tmp_path / "run" / "seed-5")
    again = run_train(capsys, "--config", file)  # done: nothing happens
    assert again["runs"] == first["runs"]
    assert torch.equal(parameters(tmp_path / "run" / "seed-5"), before)
    more = run_train(capsys, "--config", file, "--steps", "96")
    assert [run["steps"] for run in more["runs"]] == [96, 96]
    assert not torch.equal(parameters(tmp_path / "run" / "seed-5"), before)
    with pytest.raises(SystemExit, match="holds a training with another configuration"):
        run_train(capsys, "--config", file, "--hyper", "gamma=0.5")
    with pytest.raises(SystemExit, match=r"the seeds must be \[3, 5\], .*; got \[7\]"):
        run_train(capsys, "--config", file, "--seeds", "7")


def test_one_seed_goes_on_too(tmp_path, capsys):
    file = tmp_path / "run.yml"
    file.write_text(FILE)
    words = ("--config", file, "--resume-if-exists", "--out", tmp_path / "run", "--hyper", "n_epochs=2")
    config = run_train(capsys, *words)["config"]
    options = config["algorithm"], config["total_steps"], config["eval_every"], config["tensorboard"]
    assert options == ("PPO", 64, 0, False)
    assert config["env_kwargs"] == {"wind_speed": 12.0, "episode_length": 5.0}
    chosen = {"n_steps": 32, "n_epochs": 2, "net_arch": [8, 8], "learning_rate": 1e-3}
    assert {name: config["hyperparameters"][name] for name in chosen} == chosen
    assert len(run_train(capsys, *words)["sessions"]) == 1
    more = run_train(capsys, *words, "--steps", "96")
    assert [(s["from_step"], s["to_step"]) for s in more["sessions"]] == [(0, 64), (64, 96)]
    with pytest.raises(SystemExit, match=r"the seed must be 0, .*; got 1"):
        run_train(capsys, *words, "--seed", "1")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("- algo", "must map options of the training to values"),
        ("algo: [", "is not valid YAML"),
        ("resume: runs/ppo", "resume belongs on the command line"),
        ("steps: {a: 1}", "steps must be a number, a word, a list or true or false"),
    ],
)
def test_bad_files_are_refused(text, message, tmp_path):
    file = tmp_path / "run.yml"
    file.write_text(text)
    with pytest.raises(SystemExit, match=message):
        parse_command("train", ["--config", str(file)])


def test_a_file_gives_way_to_what_is_typed(tmp_path):
    file = tmp_path / "run.yml"
    file.write_text("seed: 3\nresume_if_exists: true\njson: false\ntensorboard: false\nhyper: {learning_rate: 3e-4}\n")
    parsed = parse_command("train", ["--config", str(file)])
    assert (parsed.resume_if_exists, parsed.json) == (True, False)
    config = train_command.configuration(parsed)
    assert (config.seed, config.tensorboard) == (3, False)
    assert config.resolved["learning_rate"] == 3e-4  # which YAML takes for a word
    assert parse_command("train", ["--config", str(file), "--seeds", "0", "1"]).seeds == [0, 1]
    parsed = parse_command("train", ["--config", str(file), "--overwrite"])
    assert (parsed.overwrite, parsed.resume_if_exists) == (True, False)
    assert not parse_command("train", ["--config", str(file), "--no-resume-if-exists"]).resume_if_exists
