"""Systems without what only POSIX has, such as Windows: imports, locks, files, a step, the command line."""

import io
import os
import subprocess
import sys
from pathlib import Path

from wt_gym.base.files import remove_partial
from wt_gym.base.processes import peak_memory, resident_memory
from wt_gym.commands.program import write_any_character

ROOT = Path(__file__).parents[2]
ELSEWHERE = """
import importlib.abc, os, pathlib, select, signal, subprocess, multiprocessing.util, sys, tempfile
import gymnasium, matplotlib.pyplot, numba, sb3_contrib, scipy.optimize, stable_baselines3, torch, xarray

POSIX = {"fcntl", "resource", "pwd", "grp", "termios", "tty", "pty", "syslog"}

class Blocker(importlib.abc.MetaPathFinder):
    def find_spec(self, name, path=None, target=None):
        if name in POSIX:
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)

for name in POSIX:
    sys.modules.pop(name, None)
sys.meta_path.insert(0, Blocker())
for name in ("fork", "killpg", "getuid", "geteuid", "sched_getaffinity", "register_at_fork", "getpgid", "sysconf"):
    if hasattr(os, name):
        delattr(os, name)
for name in ("SIGKILL", "SIGHUP", "SIGUSR1", "SIGALRM", "pthread_kill", "alarm", "pause"):
    if hasattr(signal, name):
        delattr(signal, name)
"""
"""Makes a process lack what Windows lacks, once the modules of others are loaded, which go by the system's name."""

IMPORTS = """
import importlib, pkgutil
import wt_gym

lacking = set()
for module in pkgutil.walk_packages(wt_gym.__path__, "wt_gym."):
    if module.name.endswith("__main__"):
        continue
    try:
        importlib.import_module(module.name)
    except ModuleNotFoundError as error:
        lacking.add(error.name)
print(*sorted(lacking - {"minari", "optuna"}))
"""
USE = """
from wt_gym.experiment.store import FolderLock
from wt_gym.learning.environments import START_METHOD
from wt_gym.base.files import remove_partial, write_text_whole
from wt_gym.base.processes import peak_memory, resident_memory
import json
import gymnasium as gym, wt_gym

folder = pathlib.Path(sys.argv[1])
with FolderLock(folder, "work"):
    write_text_whole(folder / "file.txt", "ω")
    remove_partial(folder)
    try:
        with FolderLock(folder, "work"):
            print("taken twice")
    except ValueError as error:
        print(type(error).__name__)
print(sorted(path.name for path in folder.iterdir()))
env = gym.make("wt_gym/NREL5MW-Steady-v1")
env.reset(seed=0)
print(len(env.step(env.action_space.sample())))
"""


def elsewhere(code, *words):
    """Lines that a program prints in a process without POSIX."""
    environment = os.environ | {"PYTHONPATH": str(ROOT), "PYTHONIOENCODING": "utf-8", "WT_GYM_COMPILE_ALONE": "1"}
    command = [sys.executable, "-W", "ignore", "-c", ELSEWHERE + code, *map(str, words)]
    done = subprocess.run(command, env=environment, capture_output=True, encoding="utf-8", cwd=ROOT)
    assert done.returncode == 0, done.stderr
    return done.stdout.splitlines()


def test_every_module_is_imported_without_posix():
    assert elsewhere(IMPORTS) == [""]


def test_an_environment_steps_and_a_folder_is_locked_without_posix(tmp_path):
    refused, left, parts = elsewhere(USE, tmp_path / "run")
    assert (refused, left, parts) == ("ValueError", "['file.txt']", "5")


def test_the_memory_of_this_process_is_known():
    resident, peak = resident_memory(), peak_memory()
    ballast = bytearray(64 * 2**20)
    ballast[::4096] = b"x" * len(ballast[::4096])
    assert 48.0 < resident_memory() - resident < 80.0
    assert peak_memory() >= max(peak, resident_memory() - 1.0)
    del ballast


def test_no_process_is_asked_where_asking_would_end_it(tmp_path, monkeypatch):
    """On Windows ``os.kill(number, 0)`` is Ctrl-C."""
    asked = []
    monkeypatch.setattr(os, "kill", lambda *given: asked.append(given))
    monkeypatch.setattr("wt_gym.base.files.os.name", "nt")
    (tmp_path / ".run.nc.1.partial").touch()
    monkeypatch.setattr(Path, "unlink", lambda *_, **__: (_ for _ in ()).throw(PermissionError("open")))
    files = list(tmp_path.glob(".*.partial"))
    remove_partial(tmp_path)
    assert (asked, len(files)) == ([], 1)


def test_a_character_that_a_terminal_lacks_stops_nothing(monkeypatch):
    raw = io.BytesIO()
    monkeypatch.setattr(sys, "stdout", io.TextIOWrapper(raw, encoding="cp1252", newline=""))
    write_any_character()
    print("ω → 1", flush=True)
    assert raw.getvalue() == b"? ? 1\n"


def test_the_help_of_every_command_is_shown_in_any_encoding():
    from wt_gym.commands import COMMANDS

    code = (
        "import sys\nfrom wt_gym.commands import COMMANDS, main\n"
        "for command in COMMANDS:\n"
        "    try:\n        main([command, '--help'])\n"
        "    except SystemExit as end:\n        assert not end.code, end.code\n"
    )
    environment = os.environ | {"PYTHONPATH": str(ROOT), "PYTHONIOENCODING": "ascii"}
    done = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True)
    assert done.returncode == 0, done.stderr.decode(errors="replace")
    assert done.stdout.count(b"usage: ") == len(COMMANDS)


def test_text_files_name_their_encoding():
    """The encoding of a system is another one on Windows."""
    programs = [*(ROOT / "wt_gym").rglob("*.py"), *(ROOT / "scripts").glob("*.py")]
    command = [sys.executable, "-m", "ruff", "check", "--preview", "--select", "PLW1514", "--quiet", "--isolated"]
    done = subprocess.run([*command, *map(str, programs)], capture_output=True, encoding="utf-8")
    assert done.returncode == 0, done.stdout
