"""The named mutants: each edit fits the sources as they are; the tests beside them notice each."""

import subprocess
import sys
from importlib import import_module
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]


def test_every_edit_fits_the_sources(monkeypatch):
    monkeypatch.syspath_prepend(ROOT / "scripts")
    script = import_module("mutate_kernels")
    assert len({mutant.name for mutant in script.MUTANTS}) == len(script.MUTANTS) >= 40
    assert script.misfits() == []
    monkeypatch.setattr(script, "MUTANTS", [script.MUTANTS[0]._replace(old="no such text", tests="README.md::test_no")])
    assert len(script.misfits()) == 2


@pytest.mark.slow
def test_no_named_mutant_survives():
    done = subprocess.run([sys.executable, "scripts/mutate_kernels.py"], cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
