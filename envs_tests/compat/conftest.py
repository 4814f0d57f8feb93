"""What the tests of other libraries share."""

import pytest

from envs_tests.env.scripted_simulator import ScriptedSimulator, use


@pytest.fixture
def scripted(monkeypatch):
    """Let the environments of this process have a simulator of constant signals: what counts is the interface."""
    use(monkeypatch, ScriptedSimulator)
