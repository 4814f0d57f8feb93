"""Twist of the tip at rated thrust, and the fidelity that follows from it."""

import warnings
from dataclasses import replace

import numpy as np
import pytest

from wt_gym.base.errors import SimulationError
from wt_gym.commands import campbell, compare_controllers, design, simulate, tune
from wt_gym.runs.playing import run_baseline
from wt_gym.simulation import FIDELITIES, Simulator
from wt_gym.simulation.fidelity import choose_fidelity, rated_tip_twist, tip_twist
from wt_gym.structure.beam import Beam, BeamSections
from wt_gym.turbine_records import RECORDS
from wt_gym.turbines import load_turbine
from wt_gym.wind import SteadyInflow

NAMES = ("nrel_5mw", "iea_15mw", "iea_22mw", "gebhardt_45m")
SIMULATED = {"nrel_5mw": -0.29, "iea_15mw": -3.76, "iea_22mw": -5.62, "gebhardt_45m": -0.29}
"""Twist of the tip in the simulator at "training-torsion" in steady rated wind, mean of 20 s after 40 s [deg]."""


@pytest.fixture(scope="module")
def turbines():
    return {name: load_turbine(name) for name in NAMES}


def middles(blade, n):
    return (np.arange(n) + 0.5) * blade.length / n


def test_a_straight_blade_twists_by_the_torque_outboard_over_its_stiffness(turbines):
    """Uniform load q at a distance e from the axis: theta = q e L^2 / 2 GJ."""
    blade, length = turbines["nrel_5mw"].blade, turbines["nrel_5mw"].blade.length
    stiffness = np.tile(np.diag([np.inf, np.inf, 1e10, 1e10, 1e10, 2e8]), (len(blade.structure.station), 1, 1))
    level = np.zeros_like(blade.twist)
    straight = replace(
        blade,
        structure=replace(blade.structure, stiffness=stiffness),
        twist=level,
        chord=level + 4.0,
        le_offset=level + 0.5,
    )
    n, q = 200, 3000.0
    force = np.tile([q * length / n, 0.0, 0.0], (n, 1))
    lift = q * 1.0 * length**2 / (2.0 * 2e8)  # the quarter chord lies 1 m ahead of the axis: nose-up
    assert tip_twist(straight, middles(blade, n), force, np.zeros(n)) == pytest.approx(lift, rel=1e-3)
    moment = np.full(n, -q * length / n)
    assert tip_twist(straight, middles(blade, n), force, moment) == pytest.approx(0.0, abs=1e-9)


def test_a_prebent_blade_of_coupled_sections_twists_as_its_finite_elements(turbines):
    """The IEA 22-MW under 1 kN/m downwind at its axis, with moments of 2 kN m/m about z."""
    blade, n = turbines["iea_22mw"].blade, 200
    z = middles(blade, n)
    at_axis = replace(blade, le_offset=np.full_like(blade.le_offset, 0.25))
    force = np.tile([1e3 * blade.length / n, 0.0, 0.0], (n, 1))
    moment = np.full(n, 2e3 * blade.length / n)
    station = blade.structure.station
    axis = np.column_stack([np.interp(station, blade.axis_station, blade.axis[:, k]) for k in range(3)])
    sections = BeamSections(station, blade.structure.stiffness, blade.structure.inertia, axis)
    beam = Beam(sections, np.concatenate([[0.0], blade.station_at(z), [station[-1]]]))
    load = np.zeros((n + 2, 6))
    load[1:-1, :3], load[1:-1, 5] = force, moment
    turned = np.linalg.solve(beam.stiffness[6:, 6:], load.ravel()[6:])[-3:]
    tangent = np.diff(blade.axis_at([z[-1], blade.length]), axis=0)[0]
    expected = turned @ tangent / np.linalg.norm(tangent)
    assert tip_twist(at_axis, z, force, moment) == pytest.approx(expected, rel=0.02)


@pytest.mark.parametrize("name", NAMES)
def test_estimate_of_the_twist_at_rated_thrust(turbines, name):
    twist = np.degrees(rated_tip_twist(turbines[name]))
    assert twist == pytest.approx(SIMULATED[name], rel=0.1, abs=0.1)


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
def test_twist_of_the_simulator(turbines, name):
    turbine = turbines[name]
    fidelity = FIDELITIES["training-torsion"]
    simulator = Simulator(turbine, SteadyInflow(turbine.rated_wind_speed), fidelity)
    structure, twists = simulator.structure, []
    turn = structure.system.bodies[structure.blades[0]].markers["tip"].rotation[2]

    def note(signals):
        state = simulator.coupling.integrator.state
        twists.append(np.degrees(np.mean([turn @ structure.elastic(body, state)[0] for body in structure.blades])))

    run_baseline(simulator, 60.0, on_step=note)
    assert np.mean(twists[-round(20.0 / simulator.time_step) :]) == pytest.approx(SIMULATED[name], abs=0.03)


@pytest.mark.parametrize("name", NAMES)
def test_fidelity_follows_from_the_blade_by_path_and_by_id(turbines, name):
    expected = RECORDS[name].arguments.get("fidelity", "training")
    assert choose_fidelity(turbines[name], None) == expected
    assert Simulator(turbines[name], SteadyInflow(8.0)).fidelity == FIDELITIES[expected]


def test_the_wrong_choice_warns_with_the_twist(turbines):
    large, small = turbines["iea_22mw"], turbines["nrel_5mw"]
    with pytest.warns(UserWarning, match=r"twist by 6\.16 deg at rated thrust, more than 0\.5 deg: .*'training-tor"):
        assert choose_fidelity(large, "training") == "training"
    with pytest.warns(UserWarning, match=r"more than 0\.5 deg: fidelity 'engineering-torsion' suits them, got 'engin"):
        choose_fidelity(large, "engineering")
    with pytest.warns(UserWarning, match=r"twist by 0\.23 deg at rated thrust, less than 0\.5 deg: .* got 'training-t"):
        choose_fidelity(small, "training-torsion")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        choose_fidelity(small, "training-torsion")  # the warning is given once, whatever changes the filters
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for turbine, choice in (
            (large, "training-torsion"),
            (large, "engineering-torsion"),
            (large, "reference"),
            (large, FIDELITIES["training"]),
            (small, "training"),
            (small, "reference"),
        ):
            assert choose_fidelity(turbine, choice) is choice
    with pytest.raises(SimulationError, match="fidelity must be one of"):
        choose_fidelity(small, "coarse")


def test_blades_without_torsional_stiffness_are_refused_unless_a_fidelity_is_named(turbines):
    turbine = turbines["iea_22mw"]
    structure = turbine.blade.structure
    soft = np.array(structure.stiffness)
    soft[:, 5, :] *= 0.3
    soft[:, :5, 5] *= 0.3
    turbine = replace(turbine, blade=replace(turbine.blade, structure=replace(structure, stiffness=soft)))
    with pytest.raises(SimulationError, match=r"at most 10 deg at rated thrust, got \d+ deg from a torsional .*GJ"):
        Simulator(turbine, SteadyInflow(8.0))
    with pytest.warns(UserWarning, match="more than"):
        assert choose_fidelity(turbine, "training") == "training"


def test_commands_leave_the_fidelity_to_the_turbine():
    for command, words in (
        (simulate, []),
        (campbell, []),
        (compare_controllers, ["discon"]),
        (tune, ["discon"]),
        (design, ["linear_optimal", "--out", "x.npz"]),
    ):
        assert command.parse_arguments(words).fidelity is None
