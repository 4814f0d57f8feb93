"""The script that renames: in a small tree, once and for all, and nothing that only looks alike."""

import importlib
import importlib.util
from pathlib import Path

import pytest

from wt_gym import deprecated

SCRIPT = Path(__file__).resolve().parents[2] / "scripts" / "rename.py"

OLD = '''"""Own code with a colour."""  # rename: keep
from wt_gym.agents.contenders import Contenders  # rename: keep
from wt_gym.control import Aim

Aimed = "Aim of the game"  # `Aim` is a class
present = f"{Aim(1)} {Aimed}"


def step(simulator, env, go_on):
    """Go on.

    aim : Aim
    """
    simulator.advance(0.1, 0.0, go_on=go_on)
    return env.unwrapped.aim, {"aim": 1}, "generalised-alpha", "normalised"
'''
NEW = OLD.replace("control import Aim", "control import AgentSetpoint").replace("`Aim`", "`AgentSetpoint`")
NEW = NEW.replace("{Aim(1)}", "{AgentSetpoint(1)}").replace("aim : Aim", "aim : AgentSetpoint")
NEW = NEW.replace("go_on=go_on", "accumulate=go_on").replace("unwrapped.aim", "unwrapped.setpoint")
NEW = NEW.replace("normalised", "normalized")


@pytest.fixture(scope="module")
def script():
    spec = importlib.util.spec_from_file_location("rename_script", SCRIPT)
    loaded = importlib.util.module_from_spec(spec)
    __import__("sys").modules[spec.name] = loaded  # its dataclass looks for its module
    spec.loader.exec_module(loaded)
    return loaded


@pytest.fixture
def tree(tmp_path):
    (tmp_path / "mine.py").write_text(OLD, encoding="utf-8")
    (tmp_path / "notes.md").write_text("Aim high, with `Contenders`: `train --go-on`, colours.\n", encoding="utf-8")
    (tmp_path / "record.json").write_text('{"normalised": true}', encoding="utf-8")
    return tmp_path


def test_a_tree_is_renamed_once(script, tree, capsys):
    assert script.rename(tree) == 2
    assert (tree / "mine.py").read_text(encoding="utf-8") == NEW
    assert (tree / "notes.md").read_text(encoding="utf-8") == (
        "Aim high, with `AgentPool`: `train --resume-if-exists`, colors.\n"
    )
    assert (tree / "record.json").read_text(encoding="utf-8") == '{"normalised": true}'
    assert "mine.py:3: from wt_gym.control import AgentSetpoint" in capsys.readouterr().out
    assert script.rename(tree) == 0


def test_a_dry_run_and_spelling_can_be_chosen(script, tree):
    assert script.rename(tree, dry_run=True) == 2
    assert (tree / "mine.py").read_text(encoding="utf-8") == OLD
    script.rename(tree, spelling=False)
    assert '"normalised"' in (tree / "mine.py").read_text(encoding="utf-8")


def test_what_is_deprecated_is_in_the_table(script):
    """Public names that changed are renamed by the script, letter for letter or by their spelling."""
    renamer = script.Renamer()
    for names in deprecated.NAMES.values():
        for old, new in names.items():
            assert renamer.text("mine.py", f"x = {old}\n") == f"x = {new}\n"
    for old, new in deprecated.MODULES.items():
        assert renamer.text("mine.py", f"import {old}\n") == f"import {new}\n"


@pytest.mark.filterwarnings("ignore::DeprecationWarning")
def test_names_that_left_a_module_are_imported_from_where_they_are(script):
    renamer = script.Renamer()
    for module, moved in deprecated.MOVED.items():
        for old, place in moved.items():
            scope = {}
            exec(renamer.text("mine.py", f"from {module} import {old} as mine\n"), scope)
            where, _, new = place.rpartition(".")
            assert scope["mine"] is getattr(importlib.import_module(where), new)
    text = """if x:
    from wt_gym.agents.workers import (
        ProcessExecutor,  # one
        in_processes,
    )
"""
    assert renamer.text("mine.py", text) == (
        "if x:\n    from wt_gym.runs.executors import ProcessExecutor\n"
        "    from wt_gym.experiment.former import in_processes\n"
    )


def test_this_repository_has_no_former_names_left(script, capsys):
    assert script.rename(SCRIPT.parents[1], dry_run=True) == 0, capsys.readouterr().out
