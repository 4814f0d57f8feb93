"""The same bits in another process, in a copy, and whatever the threads of the linear-algebra library."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from wt_gym.simulation import Fidelity, Simulator, SimulatorState
from wt_gym.simulation.state import fingerprint
from wt_gym.wind import SteadyInflow

WIND = SteadyInflow(10.0, 90.0, shear_exponent=0.2)
FINE_BLADES = Fidelity(blade_modes=(4, 3, 1))
"""Modes of 144 degrees of freedom: enough for LAPACK to share them among threads."""


def continue_from(path):
    """Fingerprint of where some steps with moving drives lead from a stored state."""
    simulator = Simulator("nrel_5mw", WIND)
    simulator.restore(SimulatorState.load(path))
    return move_on(simulator)


def move_on(simulator, steps=6):
    """Fingerprint of a simulator after some steps with moving drives."""
    for k in range(steps):
        simulator.advance(simulator.time_step, pitch=(0.01 * k, 0.0, 0.02), yaw_rate=0.003, generator_torque=20e3)
    return digest(simulator)


def digest(simulator):
    """Fingerprint of all numbers of the state."""
    return fingerprint(*simulator.state().arrays.values())


def fresh_start():
    """Fingerprint of a start with finely resolved blades."""
    simulator = Simulator("nrel_5mw", WIND, FINE_BLADES)
    simulator.reset(rotor_speed=1.1)
    return digest(simulator)


@pytest.mark.parametrize("threads", [1, 2])
def test_another_process_computes_the_same_bits(threads, here):
    """It has loaded no kernel before it continues, and has that many threads for linear algebra."""
    path, continued, started = here
    module = "envs_tests.physics.test_simulation_repeatability"
    code = f"from {module} import *; print(continue_from({str(path)!r}), fresh_start())"
    names = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS", "VECLIB_MAXIMUM_THREADS")
    root = Path(__file__).parents[2]
    environment = os.environ | dict.fromkeys(names, str(threads)) | {"PYTHONPATH": str(root)}
    run = subprocess.run([sys.executable, "-c", code], env=environment, cwd=root, capture_output=True, text=True)
    assert run.returncode == 0, run.stderr
    assert run.stdout.split() == [continued, started]


@pytest.fixture(scope="module")
def here(tmp_path_factory):
    """A stored state, and what this process, which has started simulators before, makes of it."""
    simulator = Simulator("nrel_5mw", WIND)
    simulator.reset(rotor_speed=1.1, azimuth=0.4)
    move_on(simulator)
    path = tmp_path_factory.mktemp("state") / "state.npz"
    simulator.state().save(path)
    return path, move_on(simulator), fresh_start()
