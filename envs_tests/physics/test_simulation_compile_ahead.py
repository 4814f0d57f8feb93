"""Kernels compiled ahead of the first run."""

import dataclasses
import logging
import multiprocessing
import os
import subprocess
import sys
from pathlib import Path

import pytest

from wt_gym.simulation import FIDELITIES, Simulator
from wt_gym.simulation.compilation import (
    HELPER,
    compile_ahead,
    compile_once,
    compile_step,
    compile_structure,
    compiling,
)
from wt_gym.simulation.step.coupling import Coupling
from wt_gym.turbines import load_turbine
from wt_gym.wind import SteadyInflow

STEP = """
import gymnasium as gym, wt_gym
env = gym.make("wt_gym/NREL5MW-Turbulent-v1")
env.reset(seed=0)
env.step(env.action_space.sample())
"""


@pytest.mark.slow
def test_nothing_is_left_for_the_first_step(tmp_path):
    """From an empty cache; the command ends with a step."""
    environment = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path)}
    subprocess.run([sys.executable, "-m", "wt_gym", "compile"], env=environment, check=True)
    before = kernels(tmp_path)
    assert len(before) > 50
    subprocess.run([sys.executable, "-c", STEP], env=environment, check=True)
    assert kernels(tmp_path) == before


@pytest.mark.slow
def test_a_first_environment_compiles_by_itself_and_says_so(tmp_path):
    """Once: the next process finds everything and says nothing."""
    environment = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path)}
    first = subprocess.run([sys.executable, "-c", STEP], env=environment, check=True, capture_output=True, text=True)
    assert first.stderr.count("compiling the simulator of NREL 5-MW") == 1
    before = kernels(tmp_path)
    again = subprocess.run([sys.executable, "-c", STEP], env=environment, check=True, capture_output=True, text=True)
    assert again.stderr == ""
    assert kernels(tmp_path) == before


@pytest.mark.slow
def test_a_start_without_a_step_compiles_what_it_announces():
    """A floating turbine whose blades twist: the next process says nothing."""
    start = "from wt_gym import simulation, wind; s = simulation.Simulator('oc4_nrel_5mw', "
    start += "wind.SteadyInflow(10.0), 'training-torsion'); s.reset(1.0)"
    subprocess.run([sys.executable, "-c", start], check=True)
    assert "compiling" not in subprocess.run([sys.executable, "-c", start], capture_output=True, text=True).stderr


@pytest.fixture
def plain():
    return load_turbine("nrel_5mw"), FIDELITIES["training"]


@pytest.fixture
def told(caplog):
    """What the logger of the package says."""
    caplog.set_level(logging.INFO, "wt_gym")
    return caplog


@pytest.mark.parametrize(("turbine", "fidelity"), [("gebhardt_45m", "gebhardt"), ("nada_small", "mixed")])
def test_free_bodies_begin_to_move_where_they_belong(turbine, fidelity):
    """The first simulator of a machine may be one whose constraint equations hold its bodies together."""
    compile_structure(Simulator(turbine, SteadyInflow(8.0), fidelity, generator="damper").coupling)


def test_a_turbine_that_no_other_process_can_know_is_compiled_by_one(plain, told):
    known_here = dataclasses.replace(plain[0])
    object.__setattr__(known_here, "note", lambda: None)
    compile_ahead(Simulator, known_here, plain[1])
    assert [text[:24] for text in told.messages] == ["nobody helps to compile:"]


def test_without_an_interpreter_one_process_compiles_everything(plain, told, monkeypatch):
    monkeypatch.setattr("wt_gym.simulation.compilation.get_executable", lambda: "/nowhere/python")
    compile_ahead(Simulator, *plain)
    assert [text[:24] for text in told.messages] == ["nobody helps to compile:"]


@pytest.mark.parametrize(
    ("code", "says"),
    [
        ("raise SystemExit(3)", ["the process that helped to compile ended with status 3"]),
        (
            "print('x' * 200_000, flush=True); raise SystemExit(4)",
            ["the process that helped to compile ended with status 4"],
        ),
    ],
)
def test_a_helper_that_fails_leaves_the_work_to_one_process(plain, told, monkeypatch, code, says):
    monkeypatch.setattr("wt_gym.simulation.compilation.HELPER", code)
    compile_ahead(Simulator, *plain)
    assert told.messages == says


def test_a_helper_may_print_and_finds_what_this_process_finds(plain, told, monkeypatch, tmp_path):
    """Before and after its work, more than a pipe holds; a file in the working directory is no module."""
    (tmp_path / "scipy.py").write_text("raise SystemExit(5)")
    monkeypatch.setattr("sys.path", [Path("ignored"), *sys.path])
    code = "print('x' * 200_000, flush=True)\n" + HELPER + "print('x' * 200_000, flush=True)"
    monkeypatch.setattr("wt_gym.simulation.compilation.HELPER", code)
    monkeypatch.chdir(tmp_path)
    compile_ahead(Simulator, *plain)
    assert not told.messages


@pytest.mark.skipif(not hasattr(os, "fork"), reason="processes are not forked here")
def test_a_forked_process_does_not_wait_for_the_threads_of_its_parent():
    with compiling():
        child = multiprocessing.get_context("fork").Process(target=compile_once, args=(Coupling, None, None, None))
        child.start()
        child.join(20.0)
        assert child.exitcode == 0


class NeverRun(Coupling):
    """A kind of coupling that no simulator has had."""

    @classmethod
    def was_compiled(cls):
        return False


def test_what_was_never_run_is_announced_once_and_compiled_with_help(plain, monkeypatch, caplog):
    helped = []

    def with_help(*given):
        helped.append(given)

    monkeypatch.setattr("wt_gym.simulation.compilation.usable_cores", lambda: 2)
    compile_once(NeverRun, *plain, with_help)
    compile_once(NeverRun, *plain, with_help)
    assert caplog.messages == [
        "compiling the simulator of NREL 5-MW baseline, land based: a minute or two, once on this machine"
    ]
    assert helped == [plain, plain]
    with compiling():
        compile_once(NeverRun, *plain, with_help)
    with monkeypatch.context() as alone:
        alone.setenv("WT_GYM_COMPILE_ALONE", "1")
        compile_once(NeverRun, *plain, with_help)
    monkeypatch.setattr("wt_gym.simulation.compilation.usable_cores", lambda: 1)
    compile_once(NeverRun, *plain, with_help)
    assert len(helped) == 2


def test_what_is_compiled_is_not_announced(plain, caplog):
    simulator = Simulator(plain[0], SteadyInflow(8.0))
    simulator.reset(rotor_speed=0.96)
    simulator.advance(0.1, pitch=0.0)
    assert Coupling.was_compiled()
    assert simulator.coupling.is_compiled()
    compile_step(simulator.coupling, plain[0])
    assert not caplog.messages
    compile_step(never := NeverStepped(simulator.coupling.models), plain[0])
    assert len(caplog.messages) == never.compiled == 1


class NeverStepped(Coupling):
    """A coupling of other types."""

    def bundle(self):
        air, *others = super().bundle()
        return (air, 0), *others

    def compile(self):
        self.compiled = 1


def kernels(folder):
    """Compiled kernels in a folder, with the times at which they were written."""
    return {path: path.stat().st_mtime_ns for path in folder.rglob("*.nbc")}
