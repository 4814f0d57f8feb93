#!/usr/bin/env python3
"""Named mutants of the physics, most of them in compiled kernels, against the tests that should notice them.

    scripts/mutate_kernels.py               # all, in some minutes
    scripts/mutate_kernels.py kutta wake    # those whose names hold one of the words
    scripts/mutate_kernels.py --list

A mutant of `mutants.json` is one edit of one file: a sign, a factor, an index that somebody might get wrong. It is
made in a temporary copy of the repository, where the tests that are named beside it run in a process of their own; they
must fail. Kernels run uncompiled there, which spares the minutes that a compilation takes: the tests are those on small
arrays. Exit status 1 if a mutant survives, 2 if an edit no longer fits the sources or tests fail without one.
"""

from __future__ import annotations

import argparse
import importlib
import json
import os
import shutil
import signal
import sys
import tempfile
import time
import types
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

import numpy as np

ROOT = Path(__file__).resolve().parent.parent


class Mutant(NamedTuple):
    """One edit: ``old``, which stands in the file once, becomes ``new``; the tests must notice."""

    name: str
    file: str
    old: str
    new: str
    tests: str


MUTANTS = tuple(
    Mutant(**row) for row in json.loads(Path(__file__).with_name("mutants.json").read_text(encoding="utf-8"))
)


def misfits() -> list[str]:
    """What is wrong with the edits, as sentences: text that stands not once in its file, tests that are not there."""
    found = []
    for mutant in MUTANTS:
        count = (ROOT / mutant.file).read_text(encoding="utf-8").count(mutant.old)
        if count != 1:
            found.append(f"{mutant.name}: the text to be changed must stand in {mutant.file} once, found {count} times")
        file, _, test = mutant.tests.partition("::")
        if f"def {test.split('[')[0]}" not in (ROOT / file).read_text(encoding="utf-8"):
            found.append(f"{mutant.name}: there is no {mutant.tests}")
    return found


def interpret() -> None:
    """Have kernels run as the Python that they are, in this process and its forks."""
    compiled = importlib.import_module("wt_gym.base.compiled")
    compiled.kernel = lambda function=None, *_, **__: function or (lambda inner: inner)
    compiled.compiled_for = lambda function, _: function
    compiled.is_compiled = lambda *_: True
    compiled.was_compiled = lambda *_: True
    vectors = types.ModuleType("wt_gym.aerodynamics.induction.simd_kernels")
    vectors.WIDTH = width = 16
    vectors.load = lambda array, at: array.reshape(-1)[at : at + width].copy()
    vectors.store = lambda array, at, vector: array.reshape(-1).__setitem__(slice(at, at + width), vector)
    vectors.spread = lambda number: np.full(width, number, np.float32)
    vectors.reciprocal = lambda vector: np.float32(1.0) / vector
    vectors.reciprocal_root = lambda vector: np.float32(1.0) / np.sqrt(vector)
    sys.modules[vectors.__name__] = vectors


def noticed(tests: list[str], limit: float) -> bool:
    """Return True if the tests fail, or take longer than a limit [s], in a fork of this process."""
    child = os.fork()
    if child == 0:
        os.setsid()
        quiet = os.open(os.devnull, os.O_WRONLY)
        os.dup2(quiet, 1)
        os.dup2(quiet, 2)
        import pytest

        os._exit(int(pytest.main(["-x", "-q", "-p", "no:cacheprovider", "-p", "no:randomly", *tests])))
    end = time.monotonic() + limit
    while time.monotonic() < end:
        done, status = os.waitpid(child, os.WNOHANG)
        if done:
            return status != 0
        time.sleep(0.02)
    os.killpg(child, signal.SIGKILL)
    os.waitpid(child, 0)
    return True


@contextmanager
def clone(*modules: str) -> Iterator[Path]:
    """Temporary copy of the repository that this process works in, with modules that forks share."""
    with tempfile.TemporaryDirectory() as folder:
        copy = Path(folder) / "wt_gym"
        skipped = shutil.ignore_patterns(".git", ".venv", "__pycache__", "shared", "docs", "*.ipynb")
        shutil.copytree(ROOT, copy, symlinks=True, ignore=skipped)
        os.chdir(copy)
        sys.dont_write_bytecode = True
        sys.path[:] = [str(copy), *(entry for entry in sys.path if entry not in ("", str(ROOT), str(ROOT / "scripts")))]
        for name in ("pytest", "hypothesis.extra.numpy", "scipy.stats", *modules):
            importlib.import_module(name)
        yield copy


def main() -> int:
    """Run the mutants."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("words", nargs="*", help="parts of names; by default all mutants")
    parser.add_argument("--list", action="store_true", help="show the mutants and run nothing")
    chosen = parser.parse_args()
    mutants = [m for m in MUTANTS if not chosen.words or any(word in m.name for word in chosen.words)]
    if faults := misfits():
        print("\n".join(faults))
        return 2
    if chosen.list:
        print("\n".join(f"{mutant.name}: {mutant.file}, {mutant.tests}" for mutant in mutants))
        return 0
    survivors, begun = 0, time.monotonic()
    with clone("scipy.signal", "scipy.spatial.transform") as copy:
        interpret()
        quiet = ("-n", "0", "-W", "ignore", "-m", "slow or not slow")
        for tests in dict.fromkeys(mutant.tests for mutant in mutants):
            if noticed([*quiet, tests], 600.0):
                print(f"{tests} fails without a mutant")
                return 2
        for mutant in mutants:
            path = copy / mutant.file
            source = path.read_text(encoding="utf-8")
            path.write_text(source.replace(mutant.old, mutant.new), encoding="utf-8")
            killed = noticed([*quiet, mutant.tests], 600.0)
            path.write_text(source, encoding="utf-8")
            survivors += not killed
            print(f"{'killed  ' if killed else 'SURVIVED'} {mutant.name}", flush=True)
    print(f"{len(mutants)} mutants, {survivors} survived, {time.monotonic() - begun:.0f} s")
    return int(survivors > 0)


if __name__ == "__main__":
    sys.exit(main())
