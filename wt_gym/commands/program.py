"""What the commands share: how they are called, and how they end where something is refused or missing."""

import argparse
import io
import json
import os
import select
import signal
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NoReturn

import gymnasium as gym

import wt_gym
from wt_gym.base.errors import WtGymError, plain_numbers

UNSAFE = """Models, statistics and replay buffers (.zip, .pkl) are pickled Python objects, which can run any code when
they are loaded, and so can files of your own (file.py:Class): take none from strangers."""

FIDELITIES_HELP = (
    "training, engineering (with -torsion: blades that twist) or reference (default: training, with -torsion where the "
    "tips twist by more than 0.5 deg at rated thrust)"
)
"""What options called ``--fidelity`` take."""

CLONE = Path(wt_gym.__file__).resolve().parents[1]
"""Folder that holds the package; of a clone, the one with ``docs`` and ``scripts``."""

IN_CLONE = (CLONE / "envs_tests").is_dir()

_OF_BROKEN_PIPE = 128 + 13
_EXTRAS = {
    "minari": "data", "onnx": "export", "onnxruntime": "export", "openfast_io": "openfast", "optuna": "tune",
    "ray": "ray", "sb3_contrib": "train", "stable_baselines3": "train", "torch": "train", "yaml": "train",
    "zmq": "serve",
}  # fmt: skip


def _installation(extra: str) -> str:
    """Command that installs an extra, in a clone into its own environment."""
    if not IN_CLONE:
        return f"in a clone of the project: pip install '.[{extra}]'"
    return f".venv/bin/pip install -e '.[{extra}]'"


class OneLineParser(argparse.ArgumentParser):
    """A parser, of a command of ``wt-gym``, that keeps descriptions as they are written and errors in one line."""

    def __init__(self, command: str | None = None, **options: Any):
        if command is not None:
            options["prog"] = f"wt-gym {command}"
        super().__init__(formatter_class=argparse.RawDescriptionHelpFormatter, **options)

    def error(self, message: str) -> NoReturn:
        """End the program with status 2."""
        self.exit(2, f"error: {' '.join(message.split())}; see --help\n")


def json_value(text: str) -> Any:
    """Value of an option that takes JSON, for the parser."""
    try:
        return json.loads(text)
    except (ValueError, RecursionError) as error:  # the latter where brackets are nested a thousand deep
        raise argparse.ArgumentTypeError(f"{text:.60} is not valid JSON: {error}") from error


_OF_FILES = (".csv", ".html", ".json", ".md", ".nc", ".npz", ".outb", ".png", ".yaml", ".yml", ".zip")


def file_ending_in(*endings: str) -> Callable[[str], Path]:
    """Type of an option that names a file to write, for the parser: refuses another ending before anything runs."""

    def path_of(text: str) -> Path:
        if not text.lower().endswith(endings) or Path(text).is_dir():
            raise argparse.ArgumentTypeError(f"must be a file that ends in {', '.join(endings)}, got {text}")
        return Path(text)

    return path_of


def folder_path(text: str) -> str:
    """Type of an option that names a folder to write to, for the parser: refuses a file, and the name of one."""
    if Path(text).is_file() or text.lower().endswith(_OF_FILES):
        raise argparse.ArgumentTypeError(f"must be a folder, got {text}")
    return text


@contextmanager
def user_errors() -> Iterator[None]:
    """End the program with one line and status 1 where what the user asked for is refused, or needs an extra.

    Where the reader of the output has gone (``| head``), it ends silently, with the status of other programs.
    """
    try:
        yield
        sys.stdout.flush()
    except BrokenPipeError as error:
        if not _nobody_reads():
            sys.exit(f"error: {error}")
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # for what Python writes at its end
        sys.exit(_OF_BROKEN_PIPE)
    except ModuleNotFoundError as error:
        if error.name not in _EXTRAS:
            raise
        sys.exit(f"error: {error.name} is not installed; {_installation(_EXTRAS[error.name])}")
    except (WtGymError, ValueError, OSError, gym.error.Error) as error:
        sys.exit(f"error: {plain_numbers(' '.join(str(error).split()))}")


def _nobody_reads() -> bool:
    """Whether the other end of the output is closed; where the system cannot say (Windows), it is not."""
    if not hasattr(select, "poll"):
        return False
    asked = select.poll()
    asked.register(sys.stdout.fileno(), 0)
    return any(event & select.POLLERR for _, event in asked.poll(0))


def write_any_character() -> None:
    """Have a terminal or file whose encoding lacks a character, such as Greek ones on Windows, show another one."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")


class _Terminated(KeyboardInterrupt):
    """SIGTERM came."""


@contextmanager
def stoppable(hint: str) -> Iterator[None]:
    """Let SIGTERM end the program as Ctrl-C does, with a line and status 130 or 143, once what is under way is safe.

    The hint tells what is there, and how to resume.
    """

    def terminate(*_: object) -> NoReturn:
        raise _Terminated

    former = signal.signal(signal.SIGTERM, terminate)
    try:
        yield
    except KeyboardInterrupt as stop:
        print(f"\nstopped; {hint}", file=sys.stderr)
        sys.exit(128 + (signal.SIGTERM if isinstance(stop, _Terminated) else signal.SIGINT))
    finally:
        signal.signal(signal.SIGTERM, former)
