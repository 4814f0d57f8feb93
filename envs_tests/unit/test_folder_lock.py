"""One process works in a folder at a time."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from wt_gym.experiment.store import FolderLock

ROOT = Path(__file__).parents[2]
HOLD = """
import sys
from wt_gym.experiment.store import FolderLock
with FolderLock(sys.argv[1], "work"):
    print("held", flush=True)
    sys.stdin.read()
"""


@pytest.fixture
def holder(tmp_path):
    """Another process that works in a folder until its input ends."""
    command = [sys.executable, "-c", HOLD, str(tmp_path / "run")]
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "text": True}
    with subprocess.Popen(command, env=environment, **pipes) as process:
        assert process.stdout.readline() == "held\n"
        yield process
        process.kill()


def test_another_process_is_refused_by_the_number_of_the_first(holder, tmp_path):
    for _ in range(2):  # whoever is refused leaves the number as it was
        with (
            pytest.raises(ValueError, match=rf"run is in use by another work \(process {holder.pid}\)"),
            FolderLock(tmp_path / "run", "work"),
        ):
            pass
    holder.communicate("")
    with FolderLock(tmp_path / "run", "work"):
        pass


def test_a_killed_process_locks_nothing_and_what_it_left_is_removed(holder, tmp_path):
    (tmp_path / "run" / f".half.{holder.pid}.partial").touch()
    (tmp_path / "run" / "whole").touch()
    holder.kill()
    holder.wait()
    assert (tmp_path / "run" / "work.lock").exists()
    with FolderLock(tmp_path / "run", "work"):
        assert int((tmp_path / "run" / "work.lock").read_text()) == os.getpid()
    assert [path.name for path in (tmp_path / "run").iterdir()] == ["whole"]


def test_no_folder_is_left_where_nothing_was_written(tmp_path):
    with FolderLock(tmp_path / "new" / "run", "work"):
        assert (tmp_path / "new" / "run" / "work.lock").is_file()
    assert not (tmp_path / "new" / "run").exists()


def test_where_a_locked_file_cannot_be_written_the_lock_holds_all_the_same(tmp_path, monkeypatch):
    """As on Windows."""
    refuse = lambda *_, **__: (_ for _ in ()).throw(PermissionError("locked"))  # noqa: E731
    monkeypatch.setattr(Path, "write_text", refuse)
    monkeypatch.setattr(Path, "read_text", refuse)
    with (
        FolderLock(tmp_path, "work"),
        pytest.raises(ValueError, match=r"\(process unknown\)"),
        FolderLock(tmp_path, "work"),
    ):
        pass
