"""Runs without a simulator: definitions, the store, and tables that make what is missing."""

import json
import os
import subprocess
import sys
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from wt_gym.experiment.execute import Experiment
from wt_gym.experiment.store import SWEEP_FILE, RunStore, described, run_definition, run_digest

defined = partial(run_definition, wind={"speed": 9.0}, duration=10.0, skip=2.0, fingerprint={})


def definition(job):
    speed = job[0]
    return defined(wind={"speed": speed}, fingerprint={"kernels": "a"}, agent={"name": "discon"})


class Rows(Experiment):
    """Rows (speed, name) whose calls are counted."""

    def __init__(self, done, work):
        self.done, self.work = done, work

    def definition(self, row):
        return definition(row)

    def __call__(self, row):
        self.done.append(row)
        return self.work(row)


def made(rows, store, done, work=lambda row: {"speed": row[0]}):
    return Rows(done, work).table(rows, store=store, progress=False)


def test_what_decides_on_a_run_is_plain_data():
    run = defined(env_kwargs={"pitch": np.float64(1.0)}, task="t", seed=None)
    assert run == {
        "wind": {"speed": 9.0}, "duration": 10.0, "skip": 2.0, "fingerprint": {}, "env_kwargs": {"pitch": 1.0},
        "task": "t",
    }  # fmt: skip


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
        ("{}", "is damaged, or no result: it must have definition"),
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


MADE = """
import functools, numpy as np
from dataclasses import dataclass
from wt_gym.envs.fatigue import BladeFatigue
from wt_gym.envs.rewards import FunctionTerm
from wt_gym.experiment.store import run_definition, run_digest
from wt_gym.wind import SteadyInflow
from wt_gym.wind.iec import reference_speed

class Wave:
    def __init__(self, height):
        self.height, self.table = height, np.arange(1000.0) * height

class Told:
    __slots__ = ("x",)
    def to_dict(self):
        return {"x": self.x}

def run(height=2.0, level=0.5):
    told = Told()
    told.x = level
    kwargs = {
        "wave": Wave(height), "told": told, "inflow": [SteadyInflow(8.0)], "kind": Wave, "names": {"b", "a", "c"},
        "reward": {"terms": (BladeFatigue(weight=level), FunctionTerm(reference_speed))},
        "call": functools.partial(reference_speed, turbine_class="I"), "small": np.array([1.0, height]),
    }
    return run_definition(wind={}, duration=10.0, skip=2.0, fingerprint={}, env_kwargs=kwargs)
"""


def test_objects_made_twice_have_one_digest_in_all_processes():
    names = {"__name__": "made"}
    exec(MADE, names)
    here = names["run"]()
    assert here == names["run"]()
    assert "0x" not in json.dumps(here)
    for seed in ("1", "2"):
        command = [sys.executable, "-c", f"__name__ = 'made'\n{MADE}\nprint(run_digest(run()))"]
        environment = {**os.environ, "PYTHONHASHSEED": seed}
        done = subprocess.run(command, capture_output=True, text=True, check=True, env=environment)
        assert done.stdout.strip() == run_digest(here)


def test_what_differs_in_content_has_another_digest():
    names = {"__name__": "made"}
    exec(MADE, names)
    digests = [run_digest(names["run"](*given)) for given in ((2.0, 0.5), (2.5, 0.5), (2.0, 0.6))]
    assert len(set(digests)) == 3
    large = np.arange(1000.0)
    other = large.copy()
    other[500] += 1e-9
    assert described(large) == described(large[:]) != described(other)
    assert described(large) != described(large.reshape(10, 100))


@pytest.mark.parametrize(
    ("value", "message"),
    [
        (lambda step: 0.0, r"env_kwargs\['x'\] must be a function or class of a module.*<lambda>"),
        (iter([1]), r"env_kwargs\['x'\] must be plain data.*list_iterator"),
        (object(), r"env_kwargs\['x'\] must be plain data"),
        ({(1, 2): 3}, r"keys of env_kwargs\['x'\] must be texts or numbers, got \(1, 2\)"),
        ([np.random.default_rng(1)], r"env_kwargs\['x'\]\[0\] must be plain data"),
    ],
)
def test_what_has_no_description_is_refused(value, message):
    with pytest.raises(ValueError, match=message):
        defined(env_kwargs={"x": value})


def test_what_refers_to_itself_is_refused():
    value = {}
    value["x"] = [value]
    with pytest.raises(ValueError, match=r"value\['x'\]\[0\] must not refer to itself"):
        described(value)


def test_plain_data_is_as_a_file_gives_it_back():
    value = {"a": (1, 2.5, None, True), 3: "x", "p": Path("a") / "b", "n": np.float32(0.5), "i": np.int64(3)}
    assert described(value) == {"a": [1, 2.5, None, True], "3": "x", "p": os.path.join("a", "b"), "n": 0.5, "i": 3}
