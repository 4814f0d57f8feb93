"""Runs of the benchmark on the simulator, short ones: repeatable, kept, fair, and taken up again after a stop."""

import json
import re
from functools import cache
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest
from stable_baselines3 import PPO
from turbine_contract import PLAIN

from wt_gym.base.errors import BenchmarkError
from wt_gym.experiment.benchmark import ResultFolder, entry_of, jobs_of, make_env, play_task, run_jobs, wind_score
from wt_gym.experiment.benchmark_tasks import BenchmarkTask, Reference, task_file
from wt_gym.experiment.environments import resolved_arguments
from wt_gym.experiment.run import delivered_power


@cache
def short(name="load-reduction-18", **changes):
    """A task of six short winds."""
    values = json.loads(task_file(name).read_text(encoding="utf-8"))
    return BenchmarkTask.from_json(values | {"duration": 4.0, "skip": 1.0, "reference": None} | changes)


@cache
def played(choice, wind=0, name="load-reduction-18", **changes):
    """Result of an agent in one wind."""
    task = short(name, **changes)
    entry = entry_of(choice)
    return play_task(task, task.winds[wind], entry.make, entry.interface)


def same_numbers(first, second):
    return all(first[key] == second[key] for key in ("metrics", "ending", "duration", "episode_return", "cost"))


def test_a_run_lasts_and_is_the_same_again():
    first = played("discon")
    assert (first["ending"], first["duration"], first["failure"]) == ("time", pytest.approx(4.0), None)
    assert same_numbers(first, played.__wrapped__("discon"))
    json.dumps(first, allow_nan=False)


def test_zero_actions_are_the_baseline():
    assert same_numbers(played("zero"), played("discon"))


def test_winds_and_controllers_differ():
    assert played("discon", wind=1)["metrics"] != played("discon")["metrics"]
    assert played("ipc")["metrics"] != played("discon")["metrics"]
    wide, narrow = (played(f"constrained_ipc:level={x}")["metrics"]["pitch_travel"] for x in (0.01, 10.0))
    assert wide > narrow == pytest.approx(played("discon")["metrics"]["pitch_travel"], rel=1e-6)


def test_power_is_corrected_for_what_the_rotor_stores():
    class Brake:
        """Asks for more torque above what balances the air: the rotor slows down and its energy turns into power."""

        def predict(self, observation, state=None, episode_start=None, deterministic=True):
            return np.array([0.0, 1.0], dtype=np.float32), state

    task = short("below-rated-8")
    brake = play_task(task, task.winds[0], lambda env: Brake())["metrics"]
    base = played("discon", name="below-rated-8")["metrics"]
    assert brake["mean_power"] > 1.01 * base["mean_power"]
    gained = brake["mean_power"] - base["mean_power"]
    assert brake["captured_power"] - base["captured_power"] < 0.25 * gained


def test_overrating_in_gusts_does_not_make_up_for_lulls():
    time, rated = np.arange(0.0, 80.0, 0.2), 5.0e6
    gusts = time % 40.0 < 20.0
    wind = np.where(gusts, rated, 0.6 * rated)
    assert delivered_power(wind, time, rated) == pytest.approx(0.8 * rated, rel=1e-12)
    assert delivered_power(np.where(gusts, 1.1 * rated, wind), time, rated) == pytest.approx(0.8 * rated, rel=1e-12)
    # what a damper by torque passes on to the power, 2 % at the frequency of the tower, costs nothing
    swings = np.where(gusts, rated * (1.0 + 0.02 * np.sin(2.0 * np.pi * time / 3.1)), wind)
    assert delivered_power(swings, time, rated) == pytest.approx(0.8 * rated, rel=1e-3)
    assert delivered_power(0.9 * wind, time, rated) == pytest.approx(0.72 * rated, rel=1e-12)
    # three samples are left after ten seconds, all above rated
    assert delivered_power(np.linspace(0.0, 2.0, 53) * rated, time[:53], rated) == pytest.approx(
        (np.linspace(0.0, 2.0, 53)[:50].sum() + 3.0) / 53 * rated, rel=1e-12
    )


def test_an_agent_that_feathers_cannot_score():
    class Feather:
        """Turns the blades out of the wind as far as the actions reach."""

        def predict(self, observation, state=None, episode_start=None, deterministic=True):
            return np.ones(1, dtype=np.float32), state

    interface = {"action_mode": "absolute", "pitch": "collective", "action_components": ["pitch"]}
    task, baseline = short(), played("discon")
    wind = task.winds[0]
    reference = Reference(task.digest, {}, {wind.label: baseline["metrics"]}, "ipc", 0.02, {})
    feather = play_task(task, wind, lambda env: Feather(), interface)
    assert wind_score(task, wind, baseline, reference).score == 0.0
    assert wind_score(task, wind, feather, reference).score == task.clip[0]
    assert feather["metrics"]["captured_power"] < 0.9 * baseline["metrics"]["captured_power"]


def test_transients_come_when_the_task_says():
    task = short("gust-survival", duration=12.0, skip=2.0)
    wind = next(wind for wind in task.winds if wind.transient == "ECD")
    inflow = make_env(task, wind).unwrapped.wind.sample(np.random.default_rng(0)).inflow
    calm, blown = (inflow.velocity(np.array([[0.0, 0.0, 90.0]]), wind.start + t)[0] for t in (-1.0, 11.0))
    assert np.hypot(*calm[:2]) == pytest.approx(wind.speed, rel=1e-6)
    assert np.hypot(*blown[:2]) == pytest.approx(wind.speed + 15.0, rel=1e-3)


def test_a_series_goes_on_where_it_was_stopped(tmp_path, monkeypatch):
    task, entries, folder, made = short(), [entry_of("discon")], ResultFolder(tmp_path), []
    jobs = jobs_of([task], entries)

    def stop_in_the_third(self, job):
        if len(made) == 2:
            raise KeyboardInterrupt
        made.append(job)
        return {"definition": job.definition, "agent": "discon"} | played("discon")

    with monkeypatch.context() as patch:
        patch.setattr("wt_gym.experiment.benchmark._BenchmarkRuns.__call__", stop_in_the_third)
        with pytest.raises(KeyboardInterrupt):
            run_jobs(jobs, folder, progress=False)
        assert [result["definition"] for result in folder] == sorted(
            (job.definition for job in jobs[:2]), key=lambda definition: folder.file(definition).name
        )
        made[:] = jobs[:1]  # room for one more
        with pytest.raises(KeyboardInterrupt):
            run_jobs(jobs, folder, progress=False)
    assert made[1] == jobs[2]
    assert run_jobs(jobs[:4], folder, progress=False) == 1
    assert same_numbers(folder.read(jobs[0].definition), played("discon"))
    assert folder.read(jobs[3].definition)["metrics"] != played("discon")["metrics"]
    with pytest.raises(FileNotFoundError):
        folder.read(jobs[-1].definition)


@pytest.fixture(scope="module")
def model(tmp_path_factory):
    """Folder of a model that was made and never trained, with the record of a training."""
    folder = tmp_path_factory.mktemp("runs") / "mine"
    kwargs = PLAIN | {"pitch": "collective", "observation": ["rotor", "pitch"], "wind_speed": [10.0, 20.0]}
    env = gym.make("wt_gym/LoadReduction-v3", **kwargs)
    folder.mkdir()
    PPO("MlpPolicy", env, n_steps=8, batch_size=8, seed=0).save(folder / "model.zip")
    environment = resolved_arguments("wt_gym/LoadReduction-v3", kwargs)
    record = {"algorithm": "PPO", "environment": environment, "control_dt": 0.2}
    (folder / "training.json").write_text(json.dumps(record), encoding="utf-8")
    return folder


def test_trained_models_run_as_they_were_trained(model):
    entry = entry_of(str(model))
    assert entry.name == "mine"
    assert entry.interface["pitch"] == "collective"
    assert entry.interface["observation"] == ["rotor", "pitch"]
    assert "wind_speed" not in entry.interface
    task = short()
    result = play_task(task, task.winds[0], entry.make, entry.interface)
    assert result["ending"] == "time"
    assert result["metrics"] != played("zero")["metrics"]
    with pytest.raises(BenchmarkError, match=r"must be among action_mode, .*, got wind_speed, fidelity"):
        make_env(task, task.winds[0], {"wind_speed": 5.0, "fidelity": "engineering"})


def test_a_model_of_another_task_keeps_its_own_bounds(model):
    """Gusts has four degrees of the mean and no fade; the ids of load reduction have others."""
    path, task = model / "training.json", short()
    before = path.read_text(encoding="utf-8")
    kwargs = PLAIN | {"pitch": "collective", "action_components": ["pitch"]}
    other = {"environment": resolved_arguments("wt_gym/Gusts-v3", kwargs)}
    path.write_text(json.dumps(json.loads(before) | other), encoding="utf-8")
    interface = entry_of(str(model)).interface
    path.write_text(before, encoding="utf-8")
    env = make_env(task, task.winds[0], interface).unwrapped
    assert env.layout.action.pitch_high == pytest.approx(np.radians([4.0]))
    assert env.operation.residual is None


def test_another_model_is_another_run(model):
    task = short()
    before = jobs_of([task], [entry_of(f"x={model}")])[0].definition
    assert before == jobs_of([task], [entry_of(f"x={model}")])[0].definition
    content = (model / "model.zip").read_bytes()
    env = gym.make("wt_gym/LoadReduction-v3", **PLAIN | {"pitch": "collective", "observation": ["rotor", "pitch"]})
    PPO("MlpPolicy", env, n_steps=8, batch_size=8, seed=1).save(model / "model.zip")
    after = jobs_of([task], [entry_of(f"x={model}")])[0].definition
    (model / "model.zip").write_bytes(content)
    assert after["agent"]["sha256"] != before["agent"]["sha256"]


def at_step(model, control_dt):
    """The model's entry as one that was trained with another control step [s]."""
    path = model / "training.json"
    path.write_text(json.dumps(json.loads(path.read_text(encoding="utf-8")) | {"control_dt": control_dt}), "utf-8")
    return entry_of(str(model))


def test_a_model_of_a_longer_control_step_holds_its_actions(model):
    entry, task = at_step(model, 0.3), short()
    env = make_env(task, task.winds[0], entry.interface)
    agent, asked = entry.make(env), []
    predict = agent.model.predict
    agent.model.predict = lambda *given: asked.append(1) or predict(*given)
    observation, _ = env.reset(seed=0)
    for episodes in (1, 2):  # the second one begins amid a hold
        actions = []
        for k in range(7):
            action, _ = agent.predict(observation, episode_start=np.array([k == 0]))
            observation, *_ = env.step(action)
            actions.append(action.tolist())
        assert actions[0] == actions[1] == actions[2] != actions[3] == actions[4] == actions[5] != actions[6]
        assert len(asked) == 3 * episodes


def test_models_whose_control_step_does_not_fit_are_refused(model):
    task = short()
    for step, more, message in ((0.25, {}, "of 0.25 s, that of the"), (0.4, {"history": 2}, "must be the same, got 0")):
        entry = at_step(model, step)
        with pytest.raises(ValueError, match=message):
            play_task(task, task.winds[0], entry.make, entry.interface | more)


def test_the_example_of_the_page_runs(capsys):
    page = (Path(__file__).resolve().parents[2] / "docs" / "benchmark.md").read_text(encoding="utf-8")
    (example,) = (x for x in re.findall(r"^```python\n(.*?)^```", page, re.MULTILINE | re.DOTALL) if "play_task(" in x)
    exec(compile(example, "docs/benchmark.md", "exec"), {})
    assert capsys.readouterr().out.startswith("time 1")
