"""The command that records running turbines."""

import pickle
import re
from dataclasses import replace

import numpy as np
import pytest

from wt_gym.commands import record
from wt_gym.control.controllers import make_controller
from wt_gym.control.controllers.controller import memory_of
from wt_gym.envs import record_store as recording
from wt_gym.envs.record_store import StartFile, digest_of_turbine, recorded_speeds
from wt_gym.envs.running_record import PLAN, Instants, RowLayout
from wt_gym.turbines import load_turbine


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ([], "TURBINE must name a file, or --package be there"),
        (["--package", "nrel_6mw"], "TURBINE must be of gebhardt_45m, .*, got nrel_6mw"),
    ],
)
def test_what_cannot_be_recorded_is_refused(words, message, capsys):
    with pytest.raises(SystemExit) as end:
        record.main(words)
    assert re.search(message, f"{end.value.code} {capsys.readouterr().err}")


def test_finished_runs_are_not_made_again(tmp_path, monkeypatch):
    """An interrupted recording continues: where all runs are there it only writes the record."""
    recorded = recording.RecordedTurbine("nrel_5mw")
    turbine = load_turbine("nrel_5mw")
    memory, rng = memory_of(make_controller("discon", turbine)), np.random.default_rng(0)
    n_columns = RowLayout.of(3, 2).memory.start
    speeds = recorded_speeds(turbine)
    for speed in speeds:
        for run in range(recorded.runs):
            rows = speed + 0.01 * rng.normal(size=(PLAN.instants, n_columns))
            memories = [memory._replace(values=np.nan_to_num(memory.values) + k) for k in range(PLAN.instants)]
            (tmp_path / f"{speed:g}-{run}.pickle").write_bytes(pickle.dumps(Instants(rows, memories)))
    monkeypatch.setattr(recording, "record_canary", lambda *_: {"speed": "1"})
    monkeypatch.setattr(recording, "_store_run", lambda *_: pytest.fail("a run"))
    recording.make_record(recorded, tmp_path / "record.npz", tmp_path, 1, lambda *_: pytest.fail("a run"))
    assert list(tmp_path.glob("*.pickle")) == []
    head = StartFile.of(tmp_path / "record.npz")
    assert (head.turbine_digest, head.canary) == (digest_of_turbine(turbine), {"speed": "1"})
    assert (head.n_motion, head.controller, head.level) == (2, "discon", 1.0)
    with np.load(tmp_path / "record.npz") as file:
        assert file["codes"].shape[::2] == (len(speeds), recorded.runs * PLAN.instants)
        np.testing.assert_allclose(file["low"][:, 0], speeds, atol=0.1)


def test_runs_are_kept_apart_by_all_on_which_they_depend(monkeypatch):
    plain = recording.RecordedTurbine("nrel_5mw")
    stronger = replace(load_turbine("nrel_5mw"), hub=replace(load_turbine("nrel_5mw").hub, mass=6e4))
    changes = {"fidelity": "training-torsion"}, {"controller": "discon+yaw"}, {"level": 0.9}, {"runs": 4}
    keys = [plain.key, *(replace(plain, **change).key for change in changes)]
    monkeypatch.setattr(recording, "load_turbine", lambda _: stronger)
    assert len({*keys, plain.key}) == 6


def test_turbines_of_one_name_get_a_file_each(tmp_path, monkeypatch):
    """Also where one of them was recorded before: neither file nor runs are those of the other."""
    turbine = load_turbine("nrel_5mw")
    other = replace(turbine, hub=replace(turbine.hub, mass=6e4))
    made = []

    def make_record(recorded, path, pieces, *_):
        made.append((path, pieces, recorded.run_fidelity))
        path.touch()

    monkeypatch.setenv("WT_GYM_CACHE", str(tmp_path))
    monkeypatch.setenv("OMP_NUM_THREADS", "1")
    monkeypatch.setattr(recording, "make_record", make_record)
    for present in (turbine, other):
        for module in ("wt_gym.turbines", "wt_gym.envs.record_store"):
            monkeypatch.setattr(f"{module}.load_turbine", lambda _, one=present: one)
        record.main(["model.yaml"])
    paths, pieces, fidelities = zip(*made, strict=True)
    assert len({*paths}) == len({*pieces}) == 2
    assert {*fidelities} == {"training"}
