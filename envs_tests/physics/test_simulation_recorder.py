"""Recorded signals: Lagrange multipliers beside the channels where constraint equations hold the blades."""

from dataclasses import replace

import gymnasium as gym
import numpy as np
import pytest
import xarray as xr

import wt_gym  # noqa: F401 - registers the environments
from wt_gym.base.constants import GRAVITY
from wt_gym.base.errors import SimulationError
from wt_gym.simulation import FIDELITIES, Recorder, Simulator
from wt_gym.wind import SteadyInflow

CONSTRAINED = replace(FIDELITIES["training"], formulation="constrained")
NAMES = ["root_multiplier_force", "root_multiplier_moment"]


def moved(simulator, recorder=None, steps=15):
    """Signals (steps + 1, n) of a run with moving drives, recorded or not."""
    rows = [simulator.reset(rotor_speed=1.1, azimuth=0.4)]
    for k in range(steps):
        if recorder is not None:
            recorder.append(rows[-1])
        rows.append(simulator.advance(0.2, pitch=(0.02 * (k % 3), 0.03, 0.0), yaw_rate=0.003, generator_torque=28e3))
    return np.array([signals.values for signals in rows])


@pytest.mark.parametrize("integrator", ["hamming", "generalized_alpha"])
def test_multipliers_are_recorded_and_disturb_nothing(integrator):
    """The moments are those of the channels, and the run is that without a recorder bit for bit."""
    simulator = Simulator(
        "nrel_5mw", SteadyInflow(9.0, shear_exponent=0.2), replace(CONSTRAINED, integrator=integrator)
    )
    recorder, unrecorded = Recorder(simulator), moved(simulator)
    kept = simulator.state()
    np.testing.assert_array_equal(moved(simulator, recorder), unrecorded)
    assert simulator.state() == kept
    run = recorder.to_dataset()
    assert [run[name].dims for name in NAMES] == [("time", "blade", "component")] * 2
    assert [run[name].attrs["units"] for name in NAMES] == ["N", "N m"]
    assert run.blade.values.tolist() == [1, 2, 3]
    for channel, component in (("root_edge_moment", "x"), ("root_flap_moment", "y"), ("root_torsion", "z")):
        for blade in (1, 2, 3):
            found = run.root_multiplier_moment.sel(blade=blade, component=component).values
            known = run[f"{channel}_{blade}"].values
            np.testing.assert_allclose(found, -known, atol=1e-7 * np.abs(run.root_flap_moment_1.values).max())
    structure, pull = simulator.structure, -run.root_multiplier_force.sel(component="z").values
    assert pull.max() > structure.system.bodies[structure.blades[0]].inertia.mass * GRAVITY  # it hangs and turns


def test_a_file_of_a_recorded_environment_brings_them_back(tmp_path):
    env = gym.make("wt_gym/NREL5MW-Steady-v1", fidelity=CONSTRAINED, wind_speed=9.0)
    _, info = env.reset(seed=0)
    recorder = Recorder(env.unwrapped.simulator)
    for _ in range(3):
        *_, info = env.step(env.action_space.sample())
        recorder.append(env.unwrapped.signals)
    assert "root_multipliers" not in info
    recorder.save(tmp_path / "run.nc")
    last = env.unwrapped.simulator.root_multipliers()
    with xr.open_dataset(tmp_path / "run.nc", engine="h5netcdf") as run:
        found = np.concatenate([run[name].values[-1] for name in NAMES], axis=1)
        assert run.component.values.tolist() == ["x", "y", "z"]
    np.testing.assert_array_equal(found, last)


def test_other_instants_have_none():
    """Signals of an earlier instant, and those before a failed step."""
    simulator = Simulator("nrel_5mw", SteadyInflow(9.0), CONSTRAINED)
    early = simulator.reset(rotor_speed=1.0)
    late = simulator.advance(0.2, pitch=0.0, generator_torque=28e3)
    recorder = Recorder(simulator)
    recorder.append(early)
    recorder.append(late)
    simulator.inflow = SteadyInflow(200.0)
    with pytest.raises(SimulationError, match="simulation failed"):
        simulator.advance(20.0, pitch=0.0)
    recorder.append(late)
    known = recorder.to_dataset().root_multiplier_moment.notnull().all(("blade", "component"))
    assert known.values.tolist() == [False, True, False]
    recorder.clear()
    assert recorder.to_dataset().root_multiplier_force.shape == (0, 3, 3)


@pytest.mark.parametrize("formulation", ["embedded", "observer"])
def test_without_constraint_equations_nobody_asks_for_multipliers(formulation, monkeypatch):
    simulator = Simulator("nrel_5mw", SteadyInflow(9.0), replace(CONSTRAINED, formulation=formulation))
    monkeypatch.setattr(Simulator, "root_multipliers", lambda self: pytest.fail("asked"))
    recorder = Recorder(simulator)
    recorder.append(simulator.reset(rotor_speed=1.0))
    assert set(recorder.to_dataset().sizes) == {"time"}
