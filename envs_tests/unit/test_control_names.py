"""Names of controllers and agents: what they mean, and classes of one's own."""

import copy
import pickle
import sys

import pytest

from wt_gym.control.controllers import DisconController, make_controller, parse_name
from wt_gym.control.controllers.names import Name, source_digest
from wt_gym.turbines import load_turbine

TURBINE = load_turbine("nrel_5mw")


@pytest.mark.parametrize(
    ("text", "kind", "target", "parameters"),
    [
        ("zero", "word", "zero", {}),
        ("nothing", "word", "zero", {}),
        ("baseline", "controller", "discon", {}),
        ("Baseline PI", "controller", "discon", {}),
        ("baseline+ipc:limit=0.1", "controller", "discon+ipc", {"limit": 0.1}),
        ("controller:anything", "controller", "anything", {}),
        ("a/b.py:Mine", "class", "a/b.py:Mine", {}),
        ("a/b.py:Mine:gain=2,mode=fast,on=True", "class", "a/b.py:Mine", {"gain": 2, "mode": "fast", "on": True}),
        ("a.b:Mine.Inner:gain=2", "class", "a.b:Mine.Inner", {"gain": 2}),
    ],
)
def test_names_mean_one_thing(text, kind, target, parameters):
    name = parse_name(text, ("zero",), {"nothing": "zero"})
    assert name == Name(kind, target, parameters)
    assert parse_name(name.text, ("zero",)) == name


def test_what_is_no_name_is_refused_with_what_is_near():
    with pytest.raises(ValueError, match=r"an agent must be zero, a controller .*got 'ipcc'.*did you mean 'ipc'"):
        parse_name("ipcc", ("zero",))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("discon:", "the colon of 'discon:' must be followed by key=value, or left out"),
        ("a/b.py:Mine:", "must be followed by key=value"),
        ("discon:kp=0.01,", "must be key=value, got ''"),
        ("discon:kp=0.01+ipc:bandwidth=0.3", r"must all stand before the colon.*: discon\+ipc:kp=0.01,bandwidth=0.3$"),
        ("discon:kp=0.01+ipc", r"behind it: discon\+ipc:kp=0.01$"),
    ],
)
def test_parameters_stand_behind_all_names(text, message):
    for read in (parse_name, lambda name: make_controller(name, TURBINE)):
        with pytest.raises(ValueError, match=message):
            read(text)
    assert make_controller("Baseline PI:kp=2e-2", TURBINE).parameters.proportional_gain == 0.02
    assert parse_name("discon:kp=1e+2").parameters == {"kp": 100.0}


def test_classes_of_a_file_and_of_a_module_make_controllers(mine, monkeypatch):
    made = make_controller(f"{mine}:Hold:gain=2.5", TURBINE)
    assert made.gain == 2.5
    assert make_controller(f"{mine}:Hold", TURBINE, gain=3).gain == 3
    assert type(pickle.loads(pickle.dumps(copy.deepcopy(made)))) is type(made)  # one module, however often it is named
    assert make_controller(f"{mine}:Sized", TURBINE).radius == 63.0
    assert isinstance(make_controller(f"{mine}:More", TURBINE).base, DisconController)
    assert make_controller(f"{mine}:retuned:gain_factor=0.9", TURBINE).channels
    mine.rename(mine.with_name("own_module_of_a_test.py"))
    monkeypatch.chdir(mine.parent)
    monkeypatch.setattr(sys, "path", [*sys.path])
    assert make_controller("own_module_of_a_test:Hold:gain=2", TURBINE).gain == 2
    assert len(source_digest("own_module_of_a_test:Hold")) == 64


@pytest.mark.parametrize(
    ("error", "target", "message"),
    [
        (FileNotFoundError, "other.py:Hold", r"no file .*other\.py"),
        (ValueError, "mine.py:Hould", r"has no 'Hould'.*did you mean 'Hold'"),
        (ValueError, "nowhere.at_all:Hold", "no module 'nowhere'"),
        (ValueError, "mine.py:NOTHING", "must be a class, or a function"),
        (ValueError, "mine.py:Rests", "got a class with predict: it acts on observations"),
        (ValueError, "mine.py:Hold:wrong=1", r"mine.py:Hold takes the arguments \(gain=1.0\), got .*'wrong'"),
        (ValueError, "model.zip", "a trained model acts on observations"),
        (ModuleNotFoundError, "broken.py:Hold", "wt_gym_needs_this_one"),
        (ValueError, "mine.py", r"must name a class behind a colon, as mine\.py:Hold"),
        (ValueError, "mine.py:Hold:deep=[]", r"'deep' in .* must be a number, a word"),
    ],
)
def test_classes_that_cannot_be_had_are_refused(error, target, message, mine, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [*sys.path])
    (tmp_path / "model.zip").touch()
    (tmp_path / "broken.py").write_text("import wt_gym_needs_this_one\n")
    with pytest.raises(error, match=message):
        make_controller(target, TURBINE)


def test_models_carry_parameters(tmp_path):
    model = tmp_path / "sac.zip"
    model.touch()
    assert parse_name(f"{model}:algo=SAC") == Name("trained", str(model), {"algo": "SAC"})
    assert parse_name(str(tmp_path)) == Name("trained", str(tmp_path))
    assert parse_name(f"{tmp_path}:trust=True") == Name("trained", str(tmp_path), {"trust": True})
