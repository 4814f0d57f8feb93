"""Declared options: what every record of options refuses, takes and gives back, whatever its fields are."""

import argparse
import importlib.util
import math
import pkgutil
from dataclasses import MISSING

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import wt_gym
import wt_gym.control.controllers.names
from wt_gym.base.options import Options, add_options, chosen_options, named_value, option, option_record, options_of


@option_record
class Training(Options):
    """Settings of a training."""

    title = "training"

    seed: int = option("random numbers", default=0, low=0, high=2**63 - 1)
    algorithm: str = option("who learns", default="PPO", choices=("PPO", "SAC"))
    max_seconds: float | None = option("wall time", default=None, unit="s", low=0.0, above=True)
    speed: float | tuple[float, float] = option("wind", default=15.0, unit="m/s", low=3, high=30, flat="wind_speed")
    layers: tuple[int, ...] = option("widths", default=(64, 64), low=1)
    terms: tuple[str, ...] = option("parts of the reward", default=("power",), choices=("power", "flap", "tower"))
    limits: "dict[str, float] | None" = option("not checked here", default=None)
    weights: "Mapping[str, float] | None" = option("by name", default=None, choices=("power", "flap"), low=0)  # noqa: F821
    quiet: bool = option("print nothing", default=False)
    even: int = option("number", default=2, check=lambda value: _even(value))


def _even(value):
    if value % 2:
        raise ValueError(f"must be even, got {value}")
    return value


WRONG = {
    "seed": (-1, 2**63, 1.5, True, "1", None, math.nan),
    "algorithm": ("TD3", 1, None, ""),
    "max_seconds": (0.0, -1, math.inf, math.nan, "1", True),
    "speed": (2.9, 31, (12, 10), (3, 31), (1, 2, 3), "15", None, [5], math.nan),
    "layers": (0, (0,), (1.5,), "64", None),
    "terms": ("power", ("power", "power"), ("tip",), None, 3),
    "weights": ({"tip": 1.0}, {"power": -1}, {"power": "1"}, [1, 2], "power"),
    "quiet": (0, 1, "false", None),
    "even": (3, None, 2.0),
}
RIGHT = {
    "seed": (0, np.int64(3), 2**63 - 1), "algorithm": ("SAC",), "max_seconds": (None, 1, np.float32(0.5)),
    "speed": (3, 30.0, [5, 12], (5, 5)), "layers": ([32], (8, 16, 32)), "terms": (["flap", "power"], {"tower"}),
    "weights": ({"power": 0, "flap": 2}, None), "quiet": (True, np.bool_(False)), "even": (4,),
}  # fmt: skip


@pytest.mark.parametrize(("name", "value"), [(name, value) for name, values in WRONG.items() for value in values])
def test_a_wrong_value_is_named_with_what_is_allowed(name, value):
    flat = "wind_speed" if name == "speed" else name
    with pytest.raises(ValueError, match=rf"^{flat} must be .*, got "):
        Training(**{name: value})


@pytest.mark.parametrize(("name", "value"), [(name, value) for name, values in RIGHT.items() for value in values])
def test_a_right_value_comes_back_from_json(name, value):
    record = Training(**{name: value})
    again = Training.from_json(record.to_json())
    assert again == record
    assert list(again.given) == [name]


def test_ends_of_a_range_stand_in_full_where_digits_would_be_lost():
    with pytest.raises(ValueError, match="seed must be a whole number from 0 to 9223372036854775807, got -1"):
        Training(seed=-1)


def test_near_names_are_offered():
    with pytest.raises(ValueError, match="algorithm must be one of PPO, SAC, got 'PPOO'; did you mean 'PPO'"):
        Training(algorithm="PPOO")
    with pytest.raises(TypeError, match="training has no option 'sed'; did you mean 'seed'"):
        Training(sed=1)
    with pytest.raises(ValueError, match="no option 'wind_speed'; did you mean 'speed'"):
        Training.from_dict({"wind_speed": 12})


def test_the_class_documents_its_fields():
    assert "speed : float or (float, float)" in Training.__doc__
    assert "Allowed: from 3 to 30 m/s." in Training.__doc__


def test_a_command_takes_the_options():
    parser = argparse.ArgumentParser()
    add_options(parser, Training, "seed", "speed", "terms", "quiet", "algorithm")
    add_options(parser, Training, "weights", weights="weight")
    words = ["--wind-speed", "5", "12", "--terms", "flap", "--no-quiet", "--weight", "power=1e-3", "--weight", "flap=2"]
    chosen = chosen_options(parser.parse_args(words), Training)
    weights = {"power": 1e-3, "flap": 2.0}
    assert Training(**chosen).given == {"speed": (5.0, 12.0), "terms": ("flap",), "quiet": False, "weights": weights}
    assert chosen_options(parser.parse_args(["--wind-speed", "12"]), Training) == {"speed": 12}
    assert chosen_options(parser.parse_args([]), Training) == {}


@pytest.mark.parametrize(
    ("word", "value"),
    [
        ("learning_rate=1e-3", 1e-3), ("n_steps=2048", 2048), ("net_arch=[128, 64]", [128, 64]),
        ("ent_coef=auto", "auto"),
        ("learning_rate=lin_3e-4", "lin_3e-4"), ("normalize_observations=true", True), ("limit=inf", "inf"),
    ],
)  # fmt: skip
def test_words_of_a_command_line_are_names_and_values(word, value):
    assert named_value(word) == (word.partition("=")[0], value)


@pytest.mark.parametrize("word", ["gamma", "=0.9", "gamma=", "net_arch=[64", "deep=" + "[" * 100_000])
def test_words_that_cannot_be_read_are_refused_in_a_line(word):
    with pytest.raises(argparse.ArgumentTypeError, match=r"NAME=VALUE|a number, a word or JSON") as caught:
        named_value(word)
    assert len(str(caught.value)) < 200


def records():
    """Every record of the package."""
    for module in pkgutil.walk_packages(wt_gym.__path__, "wt_gym."):
        if (
            module.name.rpartition(".")[2] in {"options", "config", "settings", "fidelity", "hyperparameters"}
            or ".options." in module.name
        ):
            importlib.import_module(module.name)
    waiting, found = [Options], []
    while waiting:
        waiting += (children := waiting.pop().__subclasses__())
        found += [child for child in children if child.__module__.startswith("wt_gym.")]
    return sorted(found, key=lambda record: record.__qualname__)


CASES = [pytest.param(kind, one, id=f"{kind.__name__}.{one.name}") for kind in records() for one in options_of(kind)]
PLAIN = {
    "bool", "int", "float", "str", "None", "tuple[float,float]", "tuple[int,...]", "tuple[float,...]", "tuple[str,...]",
}  # fmt: skip
SCALARS = st.one_of(st.integers(), st.floats(), st.text(max_size=5), st.booleans(), st.none())
ARRAYS = st.sampled_from([np.array(0.5), np.array([1.0, 2.0]), np.eye(6)])
LISTS, TABLES = st.lists(SCALARS, max_size=3), st.dictionaries(st.text(max_size=5), SCALARS, max_size=2)
VALUES = st.one_of(SCALARS, LISTS, TABLES, ARRAYS)


@pytest.mark.parametrize(("record", "declared"), CASES)
@settings(max_examples=30, deadline=None)
@given(value=VALUES)
def test_any_value_is_stored_in_its_form_or_refused_by_name(record, declared, value):
    try:
        stored = declared.checked(value)
    except ValueError as error:
        if declared.flat not in str(error):
            raise
        return
    if set(declared.annotation.split("|")) <= PLAIN and declared.check is None:
        assert declared.checked(stored) == stored


@pytest.mark.parametrize(("record", "declared"), CASES)
def test_a_default_is_allowed_and_documented(record, declared):
    assert declared.meaning
    assert not declared.meaning.endswith(".")
    if declared.default is not None and declared.default is not MISSING:
        declared.checked(declared.default)
    assert f"{declared.name} : " in record.__doc__
