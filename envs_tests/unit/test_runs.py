"""The layer of runs without a simulator: definitions, the store, and tables that make what is missing."""

import json

import numpy as np
import pytest

from wt_gym.runs import RunDefinition, RunStore, make_runs
from wt_gym.runs.executors import SerialExecutor
from wt_gym.runs.store import SWEEP_FILE


def definition(job):
    speed = job[0]
    return RunDefinition({"speed": speed}, 10.0, 2.0, {"kernels": "a"}, agent={"name": "discon"}).to_json()


def made(jobs, store, done, work=lambda job: {"speed": job[0]}):
    executor = SerialExecutor()

    def counted(job):
        done.append(job)
        return work(job)

    return make_runs(
        jobs, lambda left: executor.results(counted, left), tally=executor.tally, store=store, define=definition
    )


def test_what_decides_on_a_run_is_plain_data():
    run = RunDefinition({"speed": 9.0}, 10.0, 2.0, {}, env_kwargs={"pitch": np.float64(1.0)}, more={"task": "t"})
    assert run.to_json() == {
        "wind": {"speed": 9.0}, "duration": 10.0, "skip": 2.0, "fingerprint": {}, "env_kwargs": {"pitch": 1.0},
        "task": "t",
    }  # fmt: skip
    assert run.digest != RunDefinition({"speed": 9.0}, 10.0, 2.0, {}, seed=0).digest


def test_a_table_makes_each_run_once_and_what_is_missing(tmp_path):
    jobs, done, store = [(9.0, "a"), (12.0, "b"), (9.0, "c")], [], RunStore(tmp_path)
    first = made(jobs, store, done)
    assert [result["speed"] for result in first] == [9.0, 12.0, 9.0]
    assert done == jobs[:2]  # the third is the first by another name
    assert made([*jobs, (15.0, "d")], store, done)[:3] == first
    assert done == [*jobs[:2], (15.0, "d")]
    rows = json.loads((tmp_path / SWEEP_FILE).read_text())
    assert [(row["found"], row["made"]) for row in rows] == [(0, 2), (2, 1)]


def test_a_stopped_table_has_what_was_made(tmp_path):
    def stop(job):
        if job[0] > 10.0:
            raise KeyboardInterrupt
        return {}

    jobs, done, store = [(9.0, "a"), (12.0, "b")], [], RunStore(tmp_path)
    with pytest.raises(KeyboardInterrupt):
        made(jobs, store, done, stop)
    assert [store.find(definition(job)) is not None for job in jobs] == [True, False]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("{", "is damaged: "),
        ("[]", "is damaged, or no result: it must have definition"),
        ('{"definition": {"speed": 1}}', "is not what its name says"),
    ],
)
def test_damaged_and_changed_files_are_told(tmp_path, text, message):
    store = RunStore(tmp_path)
    store.keep(definition((9.0,)), {})
    store.file(definition((9.0,))).write_text(text)
    with pytest.raises(ValueError, match=message):
        made([(9.0, "a")], store, [])


def test_numbers_that_are_not_finite_are_not_written(tmp_path):
    store = RunStore(tmp_path)
    with pytest.raises(ValueError, match="JSON compliant"):
        store.keep(definition((9.0,)), {"power": float("nan")})
    assert store.find(definition((9.0,))) is None
