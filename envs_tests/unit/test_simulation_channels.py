"""Signals by name, one after another and as a dict."""

import ast
from pathlib import Path

import numpy as np
import pytest

from wt_gym.simulation import Signals, channel_table, channels


@pytest.fixture
def signals():
    return Signals(np.arange(float(len(channel_table(2)))), 2)


def test_signals_iterate_as_a_dict(signals):
    names = [channel.name for channel in channel_table(2)]
    assert list(signals) == list(signals.keys()) == names
    assert len(signals) == len(names)
    assert dict(signals) == dict(signals.items()) == signals.to_dict() == signals.as_dict()
    assert signals.to_dict() == {name: float(k) for k, name in enumerate(names)}
    assert all(type(value) is float for value in signals.to_dict().values())


def test_signals_know_their_names(signals):
    assert "rotor_speed" in signals
    assert "pitch_2" in signals
    assert "pitch" in signals
    assert "pitch_3" not in signals
    assert 3 not in signals
    assert signals  # whatever its values are


def test_type_checkers_know_which_signals_are_those_of_all_blades():
    tree = ast.parse(Path(channels.__file__).read_text(encoding="utf-8"))
    (definition,) = (node for node in tree.body if isinstance(node, ast.ClassDef) and node.name == "Signals")
    declared = [node.target.id for node in ast.walk(definition) if isinstance(node, ast.AnnAssign)]
    table = channel_table(2)
    assert [name for name in declared if not name.startswith("__")] == list(
        dict.fromkeys(channel.group for channel in table if channel.group != channel.name)
    )
