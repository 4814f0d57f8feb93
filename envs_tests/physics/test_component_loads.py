"""Loads in joints and sections: balance with the joint below, and ElastoDyn's outputs of the same names beside them."""

import re

import numpy as np
import pytest
from openfast_library import openfast_library

from wt_gym.base.errors import SimulationError
from wt_gym.bridges.openfast import VARIABLE, OpenFASTSimulator, run_folder
from wt_gym.bridges.openfast.process import OpenFASTProcess
from wt_gym.experiment.run import run_baseline
from wt_gym.simulation import Recorder, Simulator
from wt_gym.simulation.component_loads import ComponentLoads
from wt_gym.turbines import load_turbine
from wt_gym.turbines.variants import mirrored
from wt_gym.wind import SteadyInflow, TurbulenceBox, TurbulentInflow

LIBRARY = openfast_library()
GAGES = {1: 3, 3: 8, 5: 13, 7: 18, 9: 23}
"""Node of ElastoDyn, of 25 in the middles of equal parts, at each of our sections with an odd number."""
UNITS = {"N": 1e3, "N m": 1e3, "m": 1.0}


def moving(turbine="nrel_5mw", yaw=0.1, **options):
    """A simulator amid pitch, yaw and vibrations."""
    simulator = Simulator(turbine, SteadyInflow(12.0, 90.0, shear_exponent=0.2), **options)
    simulator.reset(rotor_speed=1.2, pitch=0.05, yaw=yaw)
    for k in range(10):
        simulator.advance(0.2, pitch=(0.05, 0.06, 0.02 * (k % 3)), generator_torque=40e3, yaw_rate=np.sign(yaw) * 4e-3)
    return simulator


def by_name(loads):
    return {channel.name: value for channel, value in zip(loads.channels, loads.read(), strict=True)}


def test_sections_near_the_root_bear_what_the_joint_bears():
    """Weight, inertia and air of all that lies beyond are those of the multibody system; its modes are few."""
    simulator = moving()
    loads = ComponentLoads(simulator, "sections")
    wrench = -simulator.coupling.gauges.wrench
    air, beam = simulator.coupling, loads._beams[1]
    for lumps in (beam._lumps, loads._blade_air):  # all of the blade is beyond
        lumps.share[:], lumps.shift[:] = 1.0, 0.0
    for body, *forces in zip(simulator.structure.blades, air.blade_nodes, air.blade_forces, strict=True):
        total = loads._beyond(body, beam, loads._blade_air, *forces)[0][0]
        np.testing.assert_allclose(total[:3], wrench[body, :3], atol=10.0)
        np.testing.assert_allclose(total[3:], wrench[body, 3:], atol=1e-3 * np.linalg.norm(wrench[body, 3:]))


def test_loads_follow_from_each_other():
    simulator = moving()
    found, signals = by_name(ComponentLoads(simulator, "sections")), simulator.signals
    yaw, pitch, azimuth = signals.yaw, signals.pitch[0], signals.azimuth
    x, y = found["yaw_bearing_moment_x"], found["yaw_bearing_moment_y"]
    assert found["tower_top_moment_x"] == pytest.approx(np.cos(yaw) * x - np.sin(yaw) * y)
    y, z = found["hub_rotating_moment_y"], found["hub_rotating_moment_z"]
    assert found["hub_fixed_moment_y"] == pytest.approx(np.cos(azimuth) * y - np.sin(azimuth) * z)
    x, y = found["root_coned_moment_1_x"], found["root_coned_moment_1_y"]
    assert signals.root_flap_moment[0] == pytest.approx(np.cos(pitch) * y + np.sin(pitch) * x)
    # moments fall to those of the joints at the ends
    moments = [found[f"tower_section_{k}_moment_y"] for k in range(1, 10)]
    ends = signals.tower_base_moment_y, found["tower_top_moment_y"]
    line = np.polynomial.Polynomial.fit(np.arange(0.1, 0.95, 0.1), moments, 2)
    np.testing.assert_allclose(line([0.0, 1.0]), ends, atol=0.01 * ends[0])


def test_a_rotor_that_turns_the_other_way_has_the_mirror_image():
    turbine = load_turbine("nrel_5mw")
    one, other = (ComponentLoads(moving(t, y), "sections") for t, y in ((turbine, 0.1), (mirrored(turbine), -0.1)))
    signs = np.array([channel.parity for channel in one.channels])
    np.testing.assert_allclose(other.read(), signs * one.read(), rtol=1e-9, atol=1e-3)


def test_what_has_no_loads_is_refused():
    simulator = Simulator("nrel_5mw", SteadyInflow(9.0), "training")
    with pytest.raises(SimulationError, match="loads must be one of none, joints, sections; got 'all'"):
        Recorder(simulator, loads="all")
    with pytest.raises(SimulationError, match="call reset"):
        ComponentLoads(simulator, "joints").read()


def test_a_recorder_stores_loads_with_the_signals():
    simulator = Simulator("nrel_5mw", SteadyInflow(9.0))
    recorder, early = Recorder(simulator, loads="joints"), simulator.reset(rotor_speed=1.0)
    recorder.append(simulator.advance(0.2, pitch=0.0, generator_torque=28e3))
    recorder.append(early)  # its loads have passed
    force = recorder.to_dataset().tower_top_force_x
    assert (force.attrs["openfast_name"], force.attrs["units"]) == ("YawBrFxp", "N")
    assert force.values[0] == by_name(ComponentLoads(simulator, "joints"))["tower_top_force_x"]
    assert np.isnan(force.values[1])


def compared(turbine, wind, monkeypatch):
    """Loads of the last 40 of 60 s under the turbine's controller, ours and ElastoDyn's (n, n_loads), and names."""
    ours = ComponentLoads(Simulator(turbine, wind), "sections")
    theirs_of = {}
    for channel in ours.channels:
        match = re.fullmatch(r"(TwHt|Spn)(\d)(.*)", channel.openfast)
        if match is None or int(match[2]) in GAGES:
            gage = "" if match is None else f"{match[1]}{list(GAGES).index(int(match[2])) + 1}{match[3]}"
            theirs_of[channel.openfast] = gage or channel.openfast
    plain, advance, outputs = run_folder.elastodyn_outputs, OpenFASTProcess.advance, {}

    def watched(process, demands):
        table = advance(process, demands)
        outputs.update(zip((name.lower() for name in process.names), table[-1], strict=True))
        return table

    monkeypatch.setattr(run_folder, "elastodyn_outputs", lambda n: (*plain(n), *theirs_of.values()))
    monkeypatch.setattr(OpenFASTProcess, "advance", watched)
    nodes = tuple(GAGES.values())
    changes = {"BldNodes": 25, "NBlGages": 5, "BldGagNd": nodes, "TwrNodes": 25, "NTwGages": 5, "TwrGagNd": nodes}
    openfast = OpenFASTSimulator(turbine, wind, openfast_library=LIBRARY, changes={"ElastoDyn": changes})
    units = {c.openfast: UNITS[c.unit] for c in ours.channels}
    tables = []
    for simulator in (ours.simulator, openfast):
        rows = []

        def note(signals, simulator=simulator, rows=rows):
            if signals.time > 20.0 and simulator is openfast:
                rows.append([outputs[name.lower()] for name in theirs_of.values()])
            elif signals.time > 20.0:
                values = dict(zip(units, ours.read(), strict=True))
                rows.append([values[name] / units[name] for name in theirs_of])

        run_baseline(simulator, 60.0, on_step=note)
        tables.append(np.array(rows))
    return np.array(list(theirs_of)), *tables


@pytest.mark.slow
@pytest.mark.skipif(LIBRARY is None, reason=f"no library of OpenFAST: {VARIABLE} is not set")
def test_loads_in_a_steady_wind_are_those_of_openfast(monkeypatch):
    """Mean and standard deviation of every component against the size of its vector; deflections within 2 mm, too."""
    names, ours, theirs = compared(load_turbine("nrel_5mw"), SteadyInflow(9.0, 90.0, shear_exponent=0.2), monkeypatch)
    vectors = np.array([re.sub(r"[xyz](?=[abcnpst]\d?$)", "", name) for name in names])
    for vector in np.unique(vectors):
        one, other = ours[:, vectors == vector], theirs[:, vectors == vector]
        size = np.sqrt((other**2).sum(axis=1).mean())
        np.testing.assert_allclose(one.mean(axis=0), other.mean(axis=0), atol=0.09 * size + 2e-3, err_msg=vector)
        np.testing.assert_allclose(one.std(axis=0), other.std(axis=0), atol=0.08 * size, err_msg=vector)


@pytest.mark.slow
@pytest.mark.skipif(LIBRARY is None, reason=f"no library of OpenFAST: {VARIABLE} is not set")
def test_loads_in_turbulence_follow_those_of_openfast(monkeypatch):
    """Blade elements swing more than a vortex lattice, by up to a third in the moments of hub and tower top."""
    turbine = load_turbine("nrel_5mw")
    box = TurbulenceBox.kaimal(14.0, 90.0, turbine.rotor_diameter, "B", seed=3)
    names, ours, theirs = compared(turbine, TurbulentInflow(box, SteadyInflow(14.0, 90.0)), monkeypatch)
    for name in (
        "YawBrMyn", "YawBrMzn", "YawBrFxp", "LSSTipMys", "LSSTipMzs", "LSSTipMya", "LSShftFza", "RootMyc1", "RootFxb1",
        "RootFyb2", "Spn5MLyb1", "Spn7MLyb3", "Spn9TDxb1", "TwHt5MLyt", "TwHt9MLxt", "TwHt9TDxt", "TwrBsFxt",
    ):  # fmt: skip
        one, other = ours[:, names == name].ravel(), theirs[:, names == name].ravel()
        assert np.corrcoef(one, other)[0, 1] > 0.9, name
        assert 0.65 < one.std() / other.std() < 1.05, name
