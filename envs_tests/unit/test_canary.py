"""Identity of a version of the package by its behavior: changes that count are detected, others are not."""

import json

import numpy as np
import pytest

from wt_gym.base import canary as storage
from wt_gym.base.canary import CANARY, TOLERANCE, cached_canary, canary_differences, canary_text, differing
from wt_gym.control.controllers.additions import ResidualPitch
from wt_gym.envs.canary import canary_of, environment_canary
from wt_gym.envs.faults import FaultTerm
from wt_gym.envs.terminations import Limits
from wt_gym.envs.turbine_env import WindTurbineEnv
from wt_gym.experiment.store import RunStore, run_digest


@pytest.fixture(scope="module")
def present(turbine):
    return environment_canary(turbine, "training", WindTurbineEnv)


def doubled_residual(monkeypatch):
    acting = ResidualPitch.acting
    monkeypatch.setattr(ResidualPitch, "acting", lambda self, wanted, *more: acting(self, 2.0 * wanted, *more))


def rewarded_termination(monkeypatch):
    punish = Limits.punish

    def flipped(self, reward, terms):
        return reward + self.penalty, punish(self, reward, terms)[1]

    monkeypatch.setattr(Limits, "punish", flipped)


def larger_faults(monkeypatch):
    size = FaultTerm._size
    monkeypatch.setattr(FaultTerm, "_size", lambda self, kind, share, sign: size(self, kind, 0.5 + 0.5 * share, sign))


@pytest.mark.parametrize(
    ("change", "channel"),
    [
        (doubled_residual, "residual/pitch"),
        (rewarded_termination, "termination/reward"),
        (larger_faults, "draws/fault size"),
    ],
)
def test_a_change_of_the_control_loop_is_detected(change, channel, turbine, present, monkeypatch):
    change(monkeypatch)
    differences = canary_differences(present, environment_canary(turbine, "training", WindTurbineEnv))
    assert len(differences) < len(present) / 2
    assert any(line.startswith(channel) for line in differences), differences


def test_the_same_version_has_the_same_numbers(turbine, present):
    assert canary_differences(present, environment_canary(turbine, "training", WindTurbineEnv)) == []
    assert canary_differences(present, canary_of(turbine, "training", WindTurbineEnv)) == []
    assert 200 < sum(len(text.split()) for text in present.values()) < 1000


def test_moved_and_commented_files_only_measure_again(tmp_path, monkeypatch):
    """The canary is measured once for each state of the files; what counts is that it compares equal."""
    monkeypatch.setenv("WT_GYM_CACHE", str(tmp_path))
    monkeypatch.setattr(storage, "_known", {})
    measured = []

    def measure():
        measured.append(1)
        return {"reward": canary_text([0.1, 0.2])}

    first = cached_canary("test", "turbine", measure)
    storage._known.clear()
    assert cached_canary("test", "turbine", measure) == first
    assert len(measured) == 1
    monkeypatch.setattr(storage, "package_digest", lambda: "another state of the files")
    storage._known.clear()
    assert differing({CANARY: first}, {CANARY: cached_canary("test", "turbine", measure)}) == []
    assert len(measured) == 2


def test_a_damaged_canary_is_measured_again(tmp_path, monkeypatch, caplog):
    monkeypatch.setenv("WT_GYM_CACHE", str(tmp_path))
    for content in (None, b"{", b"\xff"):
        monkeypatch.setattr(storage, "_known", {})
        for file in (tmp_path / "canaries").glob("*.json"):
            file.write_bytes(content)
        assert cached_canary("test", "", lambda: {"a": "1"}) == {"a": "1"}
        assert ("is unreadable" in caplog.text) == (content is not None)
    assert json.loads(file.read_text()) == {"a": "1"}


def test_the_digest_of_the_package_is_that_of_the_bytes_of_its_files(tmp_path, monkeypatch):
    folder = tmp_path / "wt_gym" / "base"
    (folder / "__pycache__").mkdir(parents=True)
    (folder / "canary.py").write_text("x = 1\n")
    monkeypatch.setattr(storage, "__file__", str(folder / "canary.py"))
    digest = storage.package_digest.__wrapped__
    first = digest()
    (folder / "__pycache__" / "canary.pyc").write_text("compiled")
    assert digest() == first
    (folder / "gains.json").write_text("1")
    assert digest() != first


def test_differences_are_measured_by_the_range_of_a_channel():
    values = np.array([10.0, 12.0, 11.0])
    first = {"speed": canary_text(values), "power": canary_text([5e6]), "seed": "3"}
    within = first | {"speed": canary_text(values + 0.9 * TOLERANCE * 2.0), "power": canary_text([5e6 * (1 + 5e-5)])}
    assert canary_differences(first, within) == []
    beyond = first | {"speed": canary_text(values + 1.5 * TOLERANCE * 2.0), "power": canary_text([6e6])}
    assert canary_differences(first, beyond) == ["power by 0.17 of its range", "speed by 0.00015 of its range"]
    assert canary_differences(first, first | {"speed": "10 12"}) == ["speed in its form"]
    assert canary_differences(first, first | {"speed": "SimulationError"}) == ["speed in its form"]
    assert canary_differences(first, first | {"more": "1"}) == ["more in its form"]
    assert canary_differences({"speed": "nan 1"}, {"speed": "nan 1"}) == []
    assert canary_differences({"speed": "nan 1"}, {"speed": "1 1"}) == ["speed in its form"]


def test_a_stored_run_of_another_behavior_is_refused_with_the_way_out(tmp_path):
    def definition(reward):
        return {"wind": {"speed": 9.0}, "fingerprint": {"turbine": "a", CANARY: {"reward": reward}}}

    assert run_digest(definition("1 2")) == run_digest(definition("1 3")) != run_digest({"wind": {"speed": 9.0}})
    store = RunStore(tmp_path)
    store.keep(definition("1 2"), {"power": 1.0})
    assert store.find(definition("1 2.00001"))["power"] == 1.0
    with pytest.raises(ValueError, match=r"another behavior \(reward by 0.5 of its range\): take another folder, or"):
        store.find(definition("1 3"))
