"""Choices of a fidelity: coordinates, integrators, several bodies a blade, twist of the tips."""

import warnings
from dataclasses import replace

import gymnasium as gym
import numpy as np
import pytest

from wt_gym.base.errors import SimulationError
from wt_gym.commands import parse
from wt_gym.control import torque_curve
from wt_gym.experiment.run import run_baseline
from wt_gym.multibody.integrators.schemes import make_integrator
from wt_gym.multibody.system import Joint, MultibodySystem
from wt_gym.simulation import FIDELITIES, Fidelity, Simulator
from wt_gym.simulation.fidelity import ELASTODYN_NREL_5MW_TOWER, choose_fidelity, rated_tip_twist, tip_twist
from wt_gym.simulation.turbine_structure import add_sub_bodies
from wt_gym.structure.beam import Beam, BeamSections
from wt_gym.structure.substructure import cut_beam
from wt_gym.turbine_records import RECORDS
from wt_gym.turbines import load_turbine
from wt_gym.wind import SteadyInflow

# ---- coordinates ----------------------------------------------------------------------------------------------------

FEW = {"tower_elements": 4, "blade_elements": 4}
OBSERVER = {"formulation": "observer"}


def run(fidelity, seconds=1.0, turbine="nrel_5mw"):
    """Signals after a coupled run with a step of pitch, and the simulator."""
    simulator = Simulator(turbine, SteadyInflow(9.0), fidelity)
    simulator.reset(rotor_speed=1.1, pitch=0.0)
    signals = simulator.advance(seconds, pitch=0.03, yaw_rate=0.004, generator_torque=25e3)
    return signals, simulator


@pytest.fixture(scope="module")
def modal():
    """The training fidelity on the same few elements."""
    return run(Fidelity(**FEW))[0]


@pytest.mark.parametrize(
    ("choice", "tower", "blade"),
    [
        ({"tower_coordinates": "rigid"}, 0, 3),
        ({"blade_coordinates": "rigid"}, 5, 0),
        ({"tower_coordinates": "nodal", "tower_modes": (1, 1, 0)}, 16, 3),
        ({"tower_coordinates": "nodal", "tower_modes": (1, 1, 1)}, 20, 3),
        ({"blade_coordinates": "nodal", "blade_modes": (1, 1, 0)}, 5, 16),
    ],
)
def test_coordinates_of_each_body(modal, choice, tower, blade):
    """Nodal bodies move like modal ones, rigid ones do not deform."""
    signals, simulator = run(Fidelity(**(FEW | choice)))
    structure = simulator.structure
    counts = [structure.system.bodies[b].n_elastic for b in (structure.tower, *structure.blades)]
    assert counts == [tower, blade, blade, blade]
    assert signals.rotor_speed == pytest.approx(modal.rotor_speed, rel=5e-3)
    assert signals.aero_thrust == pytest.approx(modal.aero_thrust, rel=0.06)
    if blade == 0:
        np.testing.assert_allclose(signals["tip_out_of_plane"], 0.0, atol=1e-9)
    else:
        np.testing.assert_allclose(signals["tip_out_of_plane"], modal["tip_out_of_plane"], rtol=0.12)
    if tower == 0:
        assert signals.tower_top_fore_aft == pytest.approx(0.0, abs=1e-9)
    else:
        assert signals.tower_top_fore_aft == pytest.approx(modal.tower_top_fore_aft, rel=0.12)


def test_everything_rigid_turns():
    signals, simulator = run(Fidelity(tower_coordinates="rigid", blade_coordinates="rigid", stiffest_shaft=0.0, **FEW))
    assert simulator.structure.system.n_u == 1
    assert signals.rotor_speed == pytest.approx(1.1, rel=0.05)


def test_prescribed_tower_shapes_and_yaw_spring(modal):
    fidelity = Fidelity(tower_modes=(2, 2, 0), tower_shapes=ELASTODYN_NREL_5MW_TOWER, yaw_drive="spring", **FEW)
    signals, simulator = run(fidelity)
    names = simulator.structure.system.coordinate_names
    assert names[:5] == ["fore_aft_1", "fore_aft_2", "side_side_1", "side_side_2", "yaw_twist"]
    assert signals.tower_top_fore_aft == pytest.approx(modal.tower_top_fore_aft, rel=0.12)
    # the spring twists by the yaw moment: less than a hundredth of a radian
    state = dict(zip(simulator.structure.system.state_names, simulator.coupling.integrator.state, strict=True))
    assert 0.0 < abs(state["yaw_twist"]) < 0.01
    # the nacelle stands where the spring has let it turn, not where its drive is
    assert signals.yaw == pytest.approx(state["yaw"] + state["yaw_twist"], rel=1e-12)
    assert signals.yaw_rate == pytest.approx(state["yaw_rate"] + state["yaw_twist_rate"], rel=1e-12)
    assert signals.yaw_error == pytest.approx(-signals.yaw, rel=1e-9)


def test_the_published_configuration_has_no_linear_model():
    simulator = Simulator("nrel_5mw", SteadyInflow(9.0), "gebhardt")
    with pytest.raises(SimulationError, match="embedded form"):
        simulator.linearize(rotor_speed=1.1)


def test_blades_that_twist_are_damped_more_at_high_frequencies():
    """The default is resolved where the scheme is made; what is given stands."""
    bends, twists = (replace(Fidelity(), integrator="generalized_alpha", blade_modes=m) for m in ((2, 1, 0), (2, 1, 1)))
    assert (bends.spectral_radius, bends.scheme_radius, twists.scheme_radius) == (None, 0.8, 0.3)
    assert [replace(f, spectral_radius=0.6).scheme_radius for f in (bends, twists)] == [0.6, 0.6]
    assert replace(twists, spectral_radius=0.0).scheme_radius == 0.0
    named = {name: f.scheme_radius for name, f in FIDELITIES.items() if f.integrator == "generalized_alpha"}
    assert named == {"training-torsion": 0.3, "engineering-torsion": 0.3}


def test_a_snapshot_with_a_stretched_quaternion_is_refused():
    simulator = Simulator("nrel_5mw", SteadyInflow(9.0), "gebhardt")
    simulator.reset(rotor_speed=1.1)
    state = simulator.state()
    first, body = simulator.structure.system.quaternions[0]
    state.arrays["history_y"][-1, first : first + 4] *= 1.01
    with pytest.raises(SimulationError, match=f"body '{body}': its quaternion .* has norm 1.01"):
        simulator.restore(state)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"tower_modes": (0, 0, 0)}, "tower_modes must have at least one mode"),
        ({"integrator": "rk45"}, "must be one of hamming, newmark, generalized_alpha"),
        ({"blade_bodies": 8}, "blade_bodies is 8 with .* an implicit integrator"),
        ({"blade_bodies": 4, "integrator": "newmark", "blade_coordinates": "rigid"}, "must have 'modal' or 'nodal'"),
        ({"moving_bodies": True}, "needs a tower_body or a nacelle_body"),
        ({"tower_shapes": ELASTODYN_NREL_5MW_TOWER, "tower_modes": (3, 2, 0)}, r"holds \(2, 2\) shapes"),
        ({"tower_shapes": ELASTODYN_NREL_5MW_TOWER, "tower_coordinates": "nodal"}, "needs modal coordinates"),
        ({"tower_shapes": ((1.0,), (1.0,))}, r"tower_shapes must be two tuples .*, got \(\(1.0,\), \(1.0,\)\)"),
        ({"blade_basis": "deformed", "blade_coordinates": "nodal"}, "needs blade_coordinates 'modal'"),
        ({"frame_update": 0.1}, r"frame_update is 0\.1, but the formulation is 'embedded'"),
        ({"frame_displacement": "linear"}, "frame_displacement is 'linear', but the formulation is 'embedded'"),
        ({"reference_condition": "three_quarter"}, "reference_condition is 'three_quarter', but the formulation"),
    ],
)
def test_fidelities_without_meaning_are_refused(change, message):
    with pytest.raises(SimulationError, match=message):
        replace(FIDELITIES["training"], **change)


@pytest.mark.parametrize("fidelity", [*FIDELITIES.values(), Fidelity(tower_modes=(2, 2, 0),
                                      tower_shapes=ELASTODYN_NREL_5MW_TOWER, tower_body=(8, 8))])  # fmt: skip
def test_a_fidelity_comes_back_from_json_as_the_same_key(fidelity):
    again = Fidelity.from_json(fidelity.to_json())
    assert (again, hash(again)) == (fidelity, hash(fidelity))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"blade_modes": (30, 1, 0)}, "flap modes must be at most .* got 30"),
        ({"tower_modes": (60, 1, 0)}, "fore_aft modes must be at most .*, got 60"),
        ({"blade_bodies": 30, "integrator": "newmark"}, "make at most as many bodies"),
    ],
)
def test_more_modes_or_bodies_than_the_elements_have(change, message):
    with pytest.raises(SimulationError, match=message):
        Simulator("nrel_5mw", SteadyInflow(9.0), Fidelity(**change))


@pytest.mark.parametrize("rung", ["training", "engineering", "training-torsion"])
@pytest.mark.parametrize("name", ["nrel_5mw", "iea_15mw", "gebhardt_45m", "nada_small"])
def test_wakes_reach_as_many_turns_on_every_turbine(name, rung):
    """At rated speed, with rows no further apart than 24 degrees: a large rotor has more steps in a turn."""
    speed, fidelity = load_turbine(name).drivetrain.rated_rotor_speed, FIDELITIES[rung]
    rows = fidelity.aero_for(speed).row_numbers() * np.degrees(fidelity.step_for(speed) * speed)
    least = {"training": 2.7, "engineering": 3.0}[rung.removesuffix("-torsion")]
    assert rows[-1] / 360.0 > least
    assert np.diff(rows).max() < 24.0 + 1e-6


# ---- implicit schemes -----------------------------------------------------------------------------------------------

TRAINING = FIDELITIES["training"]
IMPLICIT = replace(TRAINING, integrator="generalized_alpha")
SEVERAL = replace(IMPLICIT, blade_bodies=4, blade_modes=(2, 1, 1))


def spinning_chain():
    """A rod of three bodies that turns about its root."""
    sections = BeamSections.uniform(10.0, EA=1e8, EIx=2e5, EIy=1e5, GJ=1e5, mass=8.0, Ix=0.1, Iy=0.1)
    system = MultibodySystem()
    sub_bodies = cut_beam("rod", sections, 6, 3, "nodal", dofs=(0, 1, 3, 4, 5))
    turn = Joint("revolute", axis=(1.0, 0.0, 0.0), name="turn")
    add_sub_bodies(system, sub_bodies, lambda body: system.add(body, turn), "rod")
    return system.build()


@pytest.mark.parametrize(("name", "options"), [("newmark", {}), ("generalized_alpha", {"rho_inf": 0.6})])
def test_the_matrix_of_the_structure_leads_to_the_same_motion(name, options):
    """Newton's matrix changes the way of the iteration, not where it ends."""
    system, ends = spinning_chain(), []
    for tangent in ("difference", "structure"):
        integrator = make_integrator(name, system, 0.01, tangent=tangent, tolerance=1e-11, max_iterations=60, **options)
        y = system.initial_state()
        y[system.n_q] = 4.0
        integrator.start(y)
        integrator.advance(100)
        ends.append(integrator.state.copy())
    turned = ends[0][0]
    assert turned > 1.0
    np.testing.assert_allclose(ends[1], ends[0], atol=1e-7)


def motion(fidelity, turbine="nrel_5mw", seconds=4.0, speed=1.05):
    """Signals (n_steps, 5) of a short run with a step of pitch, and the simulator."""
    simulator = Simulator(turbine, SteadyInflow(9.0, hub_height=90.0, shear_exponent=0.2), fidelity)
    simulator.reset(rotor_speed=speed)
    rows = []
    for k in range(round(seconds / 0.2)):
        s = simulator.advance(0.2, pitch=0.03 * (k > 5), generator_torque=25e3)
        rows.append([s.rotor_speed, s.tip_out_of_plane[0], s.tip_in_plane[0], s.root_flap_moment[0],
                     s.root_edge_moment[0]])  # fmt: skip
    return np.array(rows), simulator


@pytest.mark.slow
@pytest.mark.parametrize("integrator", ["newmark", "generalized_alpha"])
def test_implicit_steps_converge_to_the_explicit_ones(integrator):
    """Second order: steps of 3/8 the length leave a seventh of the difference."""
    expected, _ = motion(replace(TRAINING, max_substep=0.0125))
    scale, errors = np.abs(expected).max(axis=0), []
    for step in (0.034, 0.0125):
        found, simulator = motion(replace(TRAINING, integrator=integrator, max_substep=step))
        assert simulator.coupling.scheme.n_sub == {0.034: 3, 0.0125: 8}[step]
        errors.append((np.abs(found - expected).max(axis=0) / scale).max())
    assert errors[0] < 0.015
    assert 4.5 < errors[0] / errors[1] < 10.0


def test_the_blades_of_the_ids_twist():
    """IEA 15-MW at 9 m/s: blades that twist carry 200 kN less, two thirds of what those that bend are above HAWC2.

    The axial force of the shaft has the rotor's weight in it, which is the same for both.
    """
    curve, thrust = torque_curve(load_turbine("iea_15mw")), {}
    for version, fidelity in enumerate(("training", gym.spec("wt_gym/IEA15MW-Steady-v2").kwargs["fidelity"])):
        simulator = Simulator("iea_15mw", SteadyInflow(9.0, hub_height=150.0), fidelity)
        signals, found = simulator.reset(rotor_speed=0.67), []
        for _ in range(100):
            signals = simulator.advance(0.2, pitch=0.0, generator_torque=curve.torque(signals.generator_speed))
            found.append(signals.rotor_thrust)
        thrust[version] = np.mean(found[50:])
    assert 150e3 < thrust[0] - thrust[1] < 250e3


@pytest.mark.slow  # kernels that no id uses
def test_blades_of_several_bodies_start_in_the_balance_of_those_of_one():
    """Short and stiff as these blades are."""
    rows, simulator = motion(SEVERAL, seconds=0.2)
    one, _ = motion(TRAINING, seconds=0.2)
    np.testing.assert_allclose(rows[0, [0, 1, 3]], one[0, [0, 1, 3]], rtol=0.01)
    assert simulator.structure.system.n_u == 7 + 3 * 4 * 5


@pytest.mark.slow
def test_more_bodies_converge():
    """The tip of the 15-MW turbine's blade, which bends far and twists: the change halves from doubling to doubling."""
    tips = [motion(replace(SEVERAL, blade_bodies=n), "iea_15mw", 0.2, 0.68)[0][0, 1] for n in (4, 8, 16)]
    assert abs(tips[2] - tips[1]) < 0.5 * abs(tips[1] - tips[0])


# ---- twist of the tips ----------------------------------------------------------------------------------------------

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
    structure = replace(blade.structure, stiffness=stiffness)
    straight = replace(blade, structure=structure, twist=level, chord=level + 4.0, le_offset=level + 0.5)
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
        for turbine, choice in (
            *((large, one) for one in ("training-torsion", "engineering-torsion", "reference", FIDELITIES["training"])),
            *((small, one) for one in ("training", "reference")),
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
        ("simulate", []),
        ("campbell", []),
        ("compare-controllers", ["discon"]),
        ("tune", ["discon"]),
        ("design", ["linear_optimal", "--out", "x.npz"]),
    ):
        assert parse(command, words).fidelity is None
