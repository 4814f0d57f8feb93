"""Files that are there when they are whole, beside processes that write, were killed, or have no room."""

import os
import signal
import subprocess
import sys

import pytest

from wt_gym.base.files import remove_partial, require_writable, whole_file, write_text_whole, write_whole


def test_a_file_keeps_its_content_where_writing_fails(tmp_path):
    path = tmp_path / "table.json"
    write_text_whole(path, "old")
    with pytest.raises(OSError, match="no room"), whole_file(path) as partial:  # noqa: PT012
        partial.write_text("half")
        raise OSError("no room")
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]


def test_what_killed_processes_left_is_removed_and_what_others_write_stays(tmp_path):
    sleeper = subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE)
    try:
        running = tmp_path / f".run.nc.{sleeper.pid}.partial"
        left = f".run.nc.{os.getpid()}.partial", ".run.nc.x.partial", ".a.99999999999.partial"
        for name in (running.name, *left):
            (tmp_path / name).write_text("")
        (tmp_path / "run.nc").write_text("")
        remove_partial(tmp_path)
        assert sorted(file.name for file in tmp_path.iterdir()) == [running.name, "run.nc"]
    finally:
        sleeper.kill()
        assert sleeper.wait() == -signal.SIGKILL
    remove_partial(tmp_path)
    assert not running.exists()


def test_a_place_that_cannot_be_written_is_found_at_once(tmp_path):
    require_writable(tmp_path / "new" / "folder")
    (tmp_path / "file").write_text("")
    with pytest.raises(OSError, match="file"):
        require_writable(tmp_path / "file" / "folder")


@pytest.mark.parametrize("number", ["os.getpid", "threading.get_ident"])
def test_processes_and_threads_that_write_the_same_file_do_not_disturb_each_other(tmp_path, monkeypatch, number):
    path = tmp_path / "file"
    with whole_file(path) as mine:
        mine.write_bytes(b"mine")
        with monkeypatch.context() as patch:
            patch.setattr(f"wt_gym.base.files.{number}", lambda: -1)
            write_whole(path, lambda file: file.write(b"theirs"))
        assert path.read_bytes() == b"theirs"
    assert path.read_bytes() == b"mine"
