"""Former public names: each gives the present thing, with a warning; old records and option files are read."""

import importlib
import json
import warnings
from pathlib import Path

import numpy as np
import pytest

from wt_gym.commands.train import parse_arguments
from wt_gym.control import Channel
from wt_gym.deprecated import GONE, MODULES, MOVED, NAMES, renamed_arguments, renamed_attribute
from wt_gym.envs.layout import ObservationLayout
from wt_gym.experiment import former
from wt_gym.experiment.trained_agent import read_record
from wt_gym.learning.training.config import TrainingConfig
from wt_gym.runs.executors import Tally
from wt_gym.runs.store import SWEEP_FILE
from wt_gym.simulation import Fidelity, Simulator

FORMER = [(module, old, new) for module, names in NAMES.items() for old, new in names.items()]


@pytest.mark.parametrize(("module", "old", "new"), FORMER)
def test_former_names_give_the_present_ones(module, old, new):
    loaded = importlib.import_module(module)
    with pytest.warns(DeprecationWarning, match=f"{module}.{old} is deprecated, use {module}.{new}"):
        former = getattr(loaded, old)
    assert former is getattr(loaded, new)
    assert new in loaded.__all__
    assert old not in loaded.__all__


@pytest.mark.parametrize("module", NAMES)
def test_other_names_are_still_missing(module):
    with pytest.raises(AttributeError, match=f"module '{module}' has no attribute 'nothing'"):
        _ = importlib.import_module(module).nothing


@pytest.mark.parametrize(("old", "new"), MODULES.items())
def test_former_modules_hold_the_present_names(old, new):
    if "ray" in new:
        pytest.importorskip("ray")
    with pytest.warns(DeprecationWarning, match=f"{old} is deprecated, use {new}"):
        former = importlib.import_module(old)
    present = importlib.import_module(new)
    for name in set(present.__all__) - MOVED.get(old, {}).keys():
        assert getattr(former, name) is getattr(present, name)
    for name, present_name in NAMES.get(new, {}).items():
        with pytest.warns(DeprecationWarning, match=name):
            assert getattr(former, name) is getattr(present, present_name)
    assert present.__name__ == present.__spec__.name == new


@pytest.mark.parametrize(("module", "name"), [(module, name) for module, names in MOVED.items() for name in names])
def test_names_of_former_modules_are_found_where_they_are(module, name):
    place, _, new = MOVED[module][name].rpartition(".")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # about the module
        former = importlib.import_module(module)
    with pytest.warns(DeprecationWarning, match=f"{module}.{name} is deprecated, use {MOVED[module][name]}"):
        assert getattr(former, name) is getattr(importlib.import_module(place), new)
    with pytest.raises(AttributeError, match="has no attribute 'nothing'"):
        _ = former.nothing


@pytest.mark.parametrize("module", [*GONE, "wt_gym.agents.fuzzing.run"])
def test_modules_that_left_the_package_say_where_they_are(module):
    with pytest.raises(ModuleNotFoundError, match=r"not part of the package any more: in a clone .* scripts/(\w+)"):
        importlib.import_module(module)
    place = next(place for gone, place in GONE.items() if module.startswith(gone)).split(",")[0]
    assert (Path(__file__).parents[2] / place).exists()


def test_former_functions_do_their_work(tmp_path):
    with pytest.raises(ValueError, match="at least 1 job"):
        former.check_workers(0)
    assert sorted(former.in_processes(abs, iter([-2, 3]), 2)) == [(-2, 2), (3, 3)]
    tally = Tally()
    with former.sweep_recorded(tmp_path, tally, 4):
        tally.done += 2
    row = {"found": 4, "made": 2, "retried": 0, "lost": []}
    assert json.loads((tmp_path / SWEEP_FILE).read_text()) == [row]
    assert [former.kind_of(x, ("zero",)) for x in ("zero", "discon", str(tmp_path))] == [
        "word",
        "controller",
        "trained",
    ]
    assert former.expand_seeds("discon", "controller") == [("", "discon")]
    assert former.expand_seeds(str(tmp_path), "trained") == [("", str(tmp_path))]


def test_arguments_are_taken_by_their_former_names():
    @renamed_arguments(old="new")
    def double(new):
        """Twice."""
        return 2 * new

    with pytest.warns(DeprecationWarning, match="argument old of double") as caught:
        assert double(old=3) == 6
    assert caught[0].filename == __file__
    assert (double(new=3), double(3), double.__doc__) == (6, 6, "Twice.")
    with pytest.raises(TypeError, match="give one of them"):
        double(old=3, new=3)


def test_attributes_are_read_by_their_former_names():
    class Thing:
        new = 5
        old = renamed_attribute("old", "new")

    with pytest.warns(DeprecationWarning, match="Thing.old is deprecated, use Thing.new"):
        assert Thing().old == 5


OLD_FIELD, OLD_METHOD = "stabilisation", "normalise"  # rename: keep
OLD_OPTION, OLD_KEY = "--go-on", "go_on"  # rename: keep
OLD_FLAG = "normalise_observations"  # rename: keep
OLD_ARGUMENTS = ("go_on", "thrust_before")  # rename: keep


def test_a_fidelity_takes_and_gives_its_former_field():
    with pytest.warns(DeprecationWarning, match=OLD_FIELD):
        made = Fidelity(**{OLD_FIELD: 3.0})
    assert made == Fidelity(stabilization=3.0)
    with pytest.warns(DeprecationWarning, match=OLD_FIELD):
        assert getattr(made, OLD_FIELD) == 3.0


def test_a_layout_has_its_former_method():
    layout = ObservationLayout([Channel("x", "-", 1.0, 2.0, -4.0, 4.0, 0.0, "")])
    with pytest.warns(DeprecationWarning, match=OLD_METHOD):
        former = getattr(layout, OLD_METHOD)
    assert former(np.array([3.0]))[0] == layout.normalize(np.array([3.0]))[0] == 1.0


def test_a_simulator_takes_former_arguments():
    for method, old in zip((Simulator.advance, Simulator.reset), OLD_ARGUMENTS, strict=True):
        # the call fails for want of a simulator, behind the warning
        with pytest.warns(DeprecationWarning, match=old), pytest.raises(AttributeError):
            method(None, 1.0, 0.0, **{old: 1.0})


def test_a_training_takes_its_former_option(tmp_path, capsys):
    assert parse_arguments([OLD_OPTION]).resume_if_exists
    assert f"warning: {OLD_OPTION} is deprecated, use --resume-if-exists" in capsys.readouterr().err
    file = tmp_path / "run.yml"
    file.write_text(f"{OLD_KEY}: true\n")
    assert parse_arguments(["--config", str(file)]).resume_if_exists
    assert not parse_arguments(["--config", str(file), "--overwrite"]).resume_if_exists
    assert OLD_OPTION in capsys.readouterr().err


def test_hyperparameters_and_records_are_read_by_former_names(tmp_path):
    with pytest.warns(DeprecationWarning, match=OLD_FLAG):
        config = TrainingConfig(hyperparameters={OLD_FLAG: True})
    assert config.resolved["normalize_observations"] is True
    with warnings.catch_warnings():
        warnings.simplefilter("error")  # a record is no mistake of its reader
        old = config.to_json() | {"hyperparameters": {OLD_FLAG: True}}
        assert TrainingConfig.from_json(old) == config
        assert config.continues(old)
    record = tmp_path / "training.json"
    record.write_text('{"algorithm": "PPO", "normalised": true}')  # rename: keep
    assert read_record(record)["normalized"] is True
