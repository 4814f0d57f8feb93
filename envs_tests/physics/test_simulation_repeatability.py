"""The same bits in another process, in a copy, and whatever the threads of the linear-algebra library."""

import copy
import os
import pickle
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import gymnasium
import numpy as np
import pytest

from wt_gym.base.compiled import way_to_compile
from wt_gym.simulation import FIDELITIES, Fidelity, Simulator, SimulatorState
from wt_gym.simulation.contract import fingerprint
from wt_gym.turbines import load_turbine
from wt_gym.turbines.variants import mirrored, with_electrical
from wt_gym.wind import SteadyInflow, TurbulenceBox, TurbulentInflow

WIND = SteadyInflow(10.0, 90.0, shear_exponent=0.2)
LONG = 150
"""Steps: kernels that a fresh process had compiled otherwise showed after 37 to 86 of them."""
FINE_BLADES = Fidelity(blade_modes=(4, 3, 1))
"""Modes of 144 degrees of freedom: enough for LAPACK to share them among threads."""


def continue_from(path):
    """Fingerprint of where some steps with moving drives lead from a stored state."""
    simulator = Simulator("nrel_5mw", WIND)
    simulator.restore(SimulatorState.load(path))
    return move_on(simulator, LONG)


def move_on(simulator, steps=6):
    """Fingerprint of a simulator after some steps with moving drives."""
    for k in range(steps):
        pitch = 0.01 * (k % 6), 0.0, 0.02
        simulator.advance(simulator.time_step, pitch=pitch, yaw_rate=0.003, generator_torque=20e3)
    return digest(simulator)


def digest(simulator):
    """Fingerprint of all numbers of the state."""
    return fingerprint(*simulator.state().arrays.values())


def fresh_start():
    """Fingerprint of a start with finely resolved blades."""
    simulator = Simulator("nrel_5mw", WIND, FINE_BLADES)
    simulator.reset(rotor_speed=1.1)
    return digest(simulator)


@pytest.mark.skipif(way_to_compile() == "plain", reason="bits depend on what was loaded before")
@pytest.mark.parametrize("threads", [pytest.param(1, marks=pytest.mark.slow), 2])
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
    return path, move_on(simulator, LONG), fresh_start()


def duplicates(original):
    """A deep copy, a copy and what a pickle brings back."""
    return copy.deepcopy(original), copy.copy(original), pickle.loads(pickle.dumps(original))


def test_signals_are_copied():
    simulator = Simulator("nrel_5mw", WIND)
    signals = simulator.reset(rotor_speed=1.1)
    for duplicate in duplicates(signals):
        assert duplicate == signals
        assert duplicate.rotor_speed == signals.rotor_speed
    with pytest.raises(AttributeError, match=r"a signal must be one of .*; got 'nonsense'"):
        signals.nonsense  # noqa: B018


slow = pytest.mark.slow  # kernels that no id uses compile long
NREL, TRAINING = load_turbine("nrel_5mw"), FIDELITIES["training"]
OBSERVER = {"formulation": "observer"}
DAMPED = OBSERVER | {"integrator": "generalized_alpha", "spectral_radius": 0.5}
KINDS = {
    "training": (NREL, {}),
    "dynamic stall": (NREL, {"aero": replace(TRAINING.aero, dynamic_stall="oye")}),
    "lag and damper of the converter": (with_electrical(NREL, 0.1, shaft_damping=0.1), {}),
    "counter-clockwise": (mirrored(NREL), {}),
    "several bodies": (NREL, {"blade_bodies": 4, "integrator": "generalized_alpha"}),
    "observer": (NREL, OBSERVER),
    "observer, three quarters": (
        NREL,
        OBSERVER | DAMPED | {"reference_condition": "three_quarter", "frame_update": 0.2},
    ),
    "observer, springs": (NREL, OBSERVER | {"yaw_drive": "spring", "stiffest_shaft": 0.5}),
    "bodies of tower and nacelle": (NREL, {"tower_body": (8, 8), "nacelle_body": (8, 8)}),
    "everything": (load_turbine("gebhardt_45m"), None),
}
FAST = list(KINDS)[:4]


@pytest.mark.parametrize("kind", [pytest.param(kind, marks=() if kind in FAST else slow) for kind in KINDS])
def test_snapshots_and_copies_continue_bit_for_bit(kind, tmp_path):
    turbine, changes = KINDS[kind]
    fidelity = FIDELITIES["gebhardt-full"] if changes is None else replace(TRAINING, **changes)
    simulator, other = (Simulator(turbine, WIND, fidelity) for _ in range(2))
    for one, speed, yaw in ((simulator, 1.1, 0.1), (other, 0.9, -0.3)):
        one.reset(rotor_speed=speed, yaw=yaw)
        move_on(one)
    assert copy.deepcopy(simulator).signals == simulator.signals
    simulator.state().save(tmp_path / "state.npz")
    kept, twins = simulator.state(), duplicates(simulator)
    expected = move_on(simulator)
    assert [move_on(twin) for twin in twins] == [expected] * 3
    for one, state in ((simulator, kept), (other, SimulatorState.load(tmp_path / "state.npz"))):
        one.restore(state)
        assert one.state() == kept
        assert move_on(one) == expected


def test_copies_of_a_started_environment_continue_bit_for_bit():
    box = TurbulenceBox.kaimal(9.0, 90.0, 126.0, "B", seed=3, grid=(3, 3), duration=60.0, cache=False)
    inflow = TurbulentInflow(box, SteadyInflow(9.0, 90.0, shear_exponent=0.2))
    env = gymnasium.make("wt_gym/NREL5MW-Steady-v1", inflow=inflow, sensor_noise=1.0, render_mode="rgb_array")
    env.reset(seed=1)
    actions = np.random.default_rng(2).uniform(-1.0, 1.0, (4, *env.action_space.shape)).astype(np.float32)
    env.step(actions[0])
    twins = copy.deepcopy(env), pickle.loads(pickle.dumps(env))

    def rest(of):
        return [of.step(action) for action in actions[1:]]

    expected, state = rest(env), env.unwrapped.simulator.state()
    for twin in twins:
        for (observation, reward, *_), (again, same, *_) in zip(expected, rest(twin), strict=True):
            np.testing.assert_array_equal(again, observation)
            assert same == reward
        assert twin.unwrapped.simulator.state() == state
        assert twin.render().shape == env.render().shape
