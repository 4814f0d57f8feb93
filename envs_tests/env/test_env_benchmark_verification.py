"""Archives of results, and runs that are repeated to verify them."""

import hashlib
import io
import json
import lzma
import tarfile

import gymnasium as gym
import pytest
from stable_baselines3 import PPO
from turbine_contract import PLAIN

from wt_gym.base.errors import BenchmarkError
from wt_gym.commands import run as run_command
from wt_gym.experiment.benchmark import ResultFolder, entry_of, jobs_of, run_jobs
from wt_gym.experiment.benchmark_archive import drawn, opened, pack, read_archive, verify, write_archive
from wt_gym.experiment.benchmark_tasks import BenchmarkTask, task_file
from wt_gym.experiment.environments import resolved_arguments


@pytest.fixture(scope="module")
def task():
    values = json.loads(task_file("load-reduction-18").read_text(encoding="utf-8"))
    return BenchmarkTask.from_json(values | {"duration": 3.0, "skip": 1.0, "reference": None})


@pytest.fixture(autouse=True)
def short(task, monkeypatch):
    monkeypatch.setattr("wt_gym.experiment.benchmark_archive.load_task", lambda name: task)


@pytest.fixture(scope="module")
def entry(task, tmp_path_factory):
    """Archive of a controller with parameters, even draws and a model, the folder of the model, and the results."""
    root = tmp_path_factory.mktemp("entry")
    model, folder = root / "model", ResultFolder(root / "runs")
    kwargs = PLAIN | {"pitch": "collective", "observation": ["rotor", "pitch"]}
    env = gym.make("wt_gym/LoadReduction-v3", **kwargs)
    PPO("MlpPolicy", env, n_steps=8, batch_size=8, seed=0).save(model / "model.zip")
    environment = resolved_arguments("wt_gym/LoadReduction-v3", kwargs)
    record = {"algorithm": "PPO", "environment": environment, "control_dt": 0.1}
    (model / "training.json").write_text(json.dumps(record), encoding="utf-8")
    agents = ["constrained_ipc:level=0.1", "random", f"mine={model}"]
    jobs = [job for job in jobs_of([task], [entry_of(text) for text in agents]) if job.wind == task.winds[0]]
    run_jobs(jobs, folder, progress=False)
    file = root / "entry.tar.xz"
    assert pack(folder, [model], file) == {
        "runs": 3, "models": 1, "bytes": file.stat().st_size, "missing": [],
    }  # fmt: skip
    return file, model, folder


def test_runs_of_an_archive_are_repeated_from_the_archive_alone(entry, tmp_path):
    file, model, runs = entry
    again = tmp_path / "again.tar.xz"
    pack(runs, [model], again)
    assert again.read_bytes() == file.read_bytes()
    with opened(file) as (folder, models):
        made = verify(folder, models, sample=None)
    assert {one.label.partition(" in ")[0] for one in made} == {"constrained_ipc:level=0.1", "random", "mine"}
    assert [(one.same, one.deviation, one.other) for one in made] == [(True, 0.0, ())] * 3


def test_a_sample_is_drawn_by_seed():
    samples = [drawn(range(20), 5, seed) for seed in range(50)]
    assert all(len(set(one)) == 5 and one == sorted(one) for one in samples)
    assert set().union(*samples) == set(range(20))
    assert drawn(range(20), 5, 7) == samples[7]
    assert drawn(range(20), None, 0) == drawn(range(20), 20, 0) == list(range(20))


def test_a_metric_that_was_changed_is_found(entry, tmp_path, capsys):
    file, _, _ = entry
    with opened(file) as (folder, models):
        result = next(one for one in folder if one["agent"] == "random")
        result["metrics"]["blade_flap_del"] *= 0.999
        changed = ResultFolder(tmp_path)
        changed.keep(result["definition"], result)
        (made,) = verify(changed, models)
        assert (made.same, made.metric) == (False, "blade_flap_del")
        assert made.deviation == pytest.approx(1e-3, rel=0.01)
    with pytest.raises(SystemExit, match="1"):
        run_command("benchmark", ["verify", str(tmp_path)])
    assert "0 of 1 repeated runs have the recorded metrics" in capsys.readouterr().out


def test_other_sources_are_named_and_compared_all_the_same(entry, tmp_path):
    result = next(one for one in entry[2] if one["agent"] == "random")
    result["definition"]["fingerprint"]["canary"]["residual/return"] = "0"
    folder = ResultFolder(tmp_path)
    folder.keep(result["definition"], result)
    (made,) = verify(folder, {})
    assert (made.same, made.other) == (True, ("behavior (residual/return by 1 of its range)",))


def test_models_that_are_not_there_are_named(entry, tmp_path):
    _, model, folder = entry
    with pytest.raises(BenchmarkError, match="model of 'mine' must be in the archive or be given"):
        verify(folder, {}, sample=None)
    assert pack(folder, [], tmp_path / "poor.tar.xz")["missing"] == ["mine"]
    assert all(one.same for one in verify(folder, {}, [f"any={model}"], sample=None))


@pytest.mark.parametrize("name", ["runs/../../outside.json", "/runs/outside", "other/file.json"])
def test_members_stay_in_their_folders(tmp_path, name):
    data, whole = b"{}", io.BytesIO()
    manifest = json.dumps({name: hashlib.sha256(data).hexdigest()}).encode()
    with tarfile.open(fileobj=whole, mode="w") as archive:
        for member, content in (("manifest.json", manifest), (name, data)):
            about = tarfile.TarInfo(member)
            about.size = len(content)
            archive.addfile(about, io.BytesIO(content))
    file = tmp_path / "bad.tar.xz"
    file.write_bytes(lzma.compress(whole.getvalue()))
    (tmp_path / "in").mkdir()
    with pytest.raises(BenchmarkError, match="names of members must be"):
        read_archive(file, tmp_path / "in")


def test_damaged_archives_are_refused(tmp_path):
    run = tmp_path / "a-1.json"
    run.write_text("{}", encoding="utf-8")
    file = tmp_path / "a.tar.xz"
    write_archive(file, [run], {})
    whole = lzma.decompress(file.read_bytes())
    file.write_bytes(lzma.compress(whole.replace(b"{}", b"[]")))
    with pytest.raises(BenchmarkError, match=r"damaged: runs/a-1\.json"):
        read_archive(file, tmp_path)
    file.write_bytes(b"not an archive")
    with pytest.raises(BenchmarkError, match="must be an archive"):
        read_archive(file, tmp_path)
