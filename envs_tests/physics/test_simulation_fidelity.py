"""What a fidelity lets a user choose, and what it refuses: short coupled runs of every choice."""

from dataclasses import replace

import numpy as np
import pytest

from wt_gym.base.errors import SimulationError
from wt_gym.simulation import FIDELITIES, Fidelity, Simulator
from wt_gym.simulation.fidelity import ELASTODYN_NREL_5MW_TOWER
from wt_gym.turbines import load_turbine
from wt_gym.wind import SteadyInflow

FEW = {"tower_elements": 4, "blade_elements": 4}


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


def elastic_count(simulator, *bodies):
    return [simulator.structure.system.bodies[b].n_elastic for b in bodies]


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
    assert elastic_count(simulator, structure.tower, *structure.blades) == [tower, blade, blade, blade]
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


def test_the_published_configuration_has_thirteen_degrees_of_freedom():
    """Gebhardt et al. 2012: 31 velocities less 18 constraint equations, which hold during a coupled run."""
    signals, simulator = run("gebhardt", 0.4)
    system = simulator.structure.system
    assert (system.n_u, system.n_constraints) == (31, 18)
    assert system.n_u - system.n_constraints == 13
    assert signals.rotor_speed == pytest.approx(1.1, rel=0.02)
    assert np.abs(system.constraint_residuals(simulator.coupling.integrator.state)[0]).max() < 1e-9


def test_the_published_configuration_has_no_linear_model():
    simulator = Simulator("nrel_5mw", SteadyInflow(9.0), "gebhardt")
    with pytest.raises(SimulationError, match="embedded form"):
        simulator.linearize(rotor_speed=1.1)


def test_fewer_corrector_passes_take_shorter_steps():
    """ω h stays within 0.276, 0.78 and 1.08 with one, two and three passes, and the runs agree.

    The pitch drives have a servo: an ideal one changes its rate within one aerodynamic step, which the three long
    sub-steps do not resolve as well as ten short ones.
    """
    turbine = load_turbine("nrel_5mw")
    turbine = replace(turbine, pitch=replace(turbine.pitch, servo_frequency=4.0 * np.pi))
    runs = [run(Fidelity(corrections=n, **FEW), 0.4, turbine) for n in (1, 2, 3)]
    steps = [simulator.coupling.integrator.step for _, simulator in runs]
    assert steps[0] < steps[1] <= steps[2]
    for signals, _ in runs[:2]:
        assert signals.rotor_speed == pytest.approx(runs[2][0].rotor_speed, rel=1e-4)


def test_blades_that_twist_are_damped_more_at_high_frequencies():
    """The default is resolved where the scheme is made; what is given stands."""
    bends, twists = (replace(Fidelity(), integrator="generalized_alpha", blade_modes=m) for m in ((2, 1, 0), (2, 1, 1)))
    assert (bends.spectral_radius, bends.scheme_radius, twists.scheme_radius) == (None, 0.8, 0.3)
    assert [replace(f, spectral_radius=0.6).scheme_radius for f in (bends, twists)] == [0.6, 0.6]
    assert replace(twists, spectral_radius=0.0).scheme_radius == 0.0
    named = {name: f.scheme_radius for name, f in FIDELITIES.items() if f.integrator == "generalized_alpha"}
    assert named == {"training-torsion": 0.3, "engineering-torsion": 0.3}
    for fidelity in (bends, twists):
        simulator = Simulator("nrel_5mw", SteadyInflow(9.0), fidelity)
        simulator.reset(rotor_speed=1.1)
        given = Simulator("nrel_5mw", SteadyInflow(9.0), replace(fidelity, spectral_radius=fidelity.scheme_radius))
        given.reset(rotor_speed=1.1)
        ends = [s.advance(1.0, 0.0, generator_torque=2e4)["root_flap_moment_1"] for s in (simulator, given)]
        assert ends[0] == ends[1]


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
        ({"tower_modes": (2.5, 2, 1)}, "three whole counts"),
        ({"tower_modes": (2, 2)}, "three whole counts"),
        ({"corrections": 0}, "at least 1"),
        ({"corrections": 1.5}, "a whole number"),
        ({"tower_coordinates": "exact"}, "tower_coordinates must be one of modal, nodal, rigid, got 'exact'"),
        ({"blade_coordinates": "exact"}, "blade_coordinates"),
        ({"yaw_drive": "loose"}, "must be one of stiff, spring"),
        ({"starter": "euler"}, "must be one of adams, runge-kutta"),
        ({"integrator": "rk45"}, "must be one of hamming, newmark, generalized_alpha"),
        ({"blade_bodies": 8}, "blade_bodies is 8 with .* an implicit integrator"),
        ({"tower_body": (8, 2)}, "tower_body is .* at least 3"),
        ({"nacelle_body": (4, 8)}, "nacelle_body is .* at least 5"),
        ({"nacelle_body": (8, 8, 8)}, "must be None or two counts"),
        ({"nacelle_body": (8, 8.5)}, "nacelle_body"),
        ({"nacelle_body": True}, "nacelle_body is True"),
        ({"tower_shapes": ELASTODYN_NREL_5MW_TOWER, "tower_modes": (3, 2, 0)}, r"holds \(2, 2\) shapes"),
        ({"tower_shapes": ELASTODYN_NREL_5MW_TOWER, "tower_coordinates": "nodal"}, "needs modal coordinates"),
    ],
)
def test_fidelities_without_meaning_are_refused(change, message):
    with pytest.raises(SimulationError, match=message):
        replace(FIDELITIES["training"], **change)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"blade_modes": (30, 1, 0)}, "flap modes must be at most .* got 30"),
        ({"tower_modes": (60, 1, 0)}, "fore_aft modes must be at most .*, got 60"),
    ],
)
def test_more_modes_than_the_elements_have(change, message):
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
