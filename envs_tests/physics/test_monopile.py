"""Towers on monopiles: beams on foundations against closed forms, and turbines on them in an environment."""

from dataclasses import replace

import gymnasium as gym
import numpy as np
import pytest

from envs_tests.physics.refusals import refuses
from wt_gym.analysis.scene import cut_at_sea_level
from wt_gym.base.errors import SimulationError, TurbineDefinitionError
from wt_gym.control.design import tower_top
from wt_gym.simulation import Fidelity, Simulator
from wt_gym.simulation.turbine_structure import tower_beam
from wt_gym.structure.beam import Beam, BeamSections, pile_head_stiffness
from wt_gym.structure.flexible_body import FlexibleBody
from wt_gym.structure.modes import clamped_modes
from wt_gym.turbines import BeamStations, Support, load_turbine
from wt_gym.wind import SteadyInflow

LENGTH, EI, MASS = 50.0, 4e11, 6000.0
SECTIONS = BeamSections.uniform(LENGTH, EA=1e12, EIx=EI, EIy=EI, GJ=3e11, mass=MASS)
SPRINGS = np.diag([2.6e9, 2.6e9, 1e11, 2.6e11, 2.6e11, 1e13])
SPRINGS[0, 4] = SPRINGS[4, 0] = -2.2e10
SPRINGS[1, 3] = SPRINGS[3, 1] = 2.2e10
PILE = dict(EA=1e12, EI=EI, GJ=3e11, axial=1e8, torsional=1e9)


def uniform_support(**changes):
    stations = BeamStations(SECTIONS.station, SECTIONS.stiffness, SECTIONS.inertia)
    return Support(
        **(dict(base_height=-30.0, diameter_station=[0.0, 50.0], diameter=[6.0, 6.0], structure=stations) | changes)
    )


@pytest.mark.parametrize(("move", "turn", "sign"), [(0, 4, 1.0), (1, 3, -1.0)])
def test_static_deflection_on_springs(move, turn, sign):
    """A force F at the tip bends the beam by F L³/3EI and turns it on its foundation by F L and F."""
    beam = Beam(SECTIONS, 10, SPRINGS)
    load = np.zeros(beam.n_dof)
    load[-6 + move] = 1e6
    tip = np.linalg.solve(beam.stiffness, load)[-6 + move]
    spring = SPRINGS[np.ix_([move, turn], [move, turn])]
    base = np.linalg.solve(spring, [1e6, sign * 1e6 * LENGTH])
    assert tip == pytest.approx(1e6 * LENGTH**3 / (3.0 * EI) + base[0] + sign * base[1] * LENGTH, rel=1e-9)


def test_water_adds_inertia_and_no_weight():
    """A cantilever in water swings more slowly by √(m/(m + ρ π D²/4)); what it weighs in the air's books stays."""
    support = uniform_support(base_height=-60.0)
    dry, wet = Beam(SECTIONS, 8), Beam(SECTIONS, 8, added_mass=support.added_mass_at)
    water = 1025.0 * np.pi * 6.0**2 / 4.0
    for plane in ((0, 4), (1, 3)):
        before, after = (clamped_modes(beam, 3, node_dofs=plane).frequency for beam in (dry, wet))
        assert after == pytest.approx(before * np.sqrt(MASS / (MASS + water)), rel=1e-9)
    axial = [clamped_modes(beam, 1, node_dofs=(2,)).frequency[0] for beam in (dry, wet)]
    assert axial[0] == axial[1]
    basis = clamped_modes(wet, 2, node_dofs=(0, 4)).shape
    bodies = [FlexibleBody.from_beam("pile", beam, basis) for beam in (dry, wet)]
    assert bodies[0].inertia.mass == bodies[1].inertia.mass
    assert np.array_equal(bodies[0].inertia.c1, bodies[1].inertia.c1)
    assert bodies[1].inertia.m0 == pytest.approx(np.eye(2), abs=1e-9)


def test_added_mass_ends_at_sea_level():
    support = uniform_support(base_height=-20.0)
    assert np.all(support.added_mass_at([0.0, 20.0]) > 0.0)
    assert support.added_mass_at(20.1) == 0.0
    assert uniform_support(water_density=0.0).added_mass_at(0.0) == 0.0


def test_a_lump_is_a_mass_of_its_node():
    tip = np.zeros((6, 6))
    tip[:3, :3] = 5e4 * np.eye(3)
    expected = clamped_modes(Beam(SECTIONS, 6), 3, tip_mass=tip, node_dofs=(0, 4)).frequency
    beam = Beam(SECTIONS, 6, lumps=[(6, 5e4)])
    assert clamped_modes(beam, 3, node_dofs=(0, 4)).frequency == pytest.approx(expected, rel=1e-9)
    assert beam.particle_mass.sum() == pytest.approx(MASS * LENGTH + 5e4)


def test_a_support_and_its_tower_are_one_beam():
    """A uniform tower of 80 m on a dry support of 50 m of the same tube vibrates as a tube of 130 m does."""
    land = load_turbine("nrel_5mw").tower
    station = np.array([0.0, 80.0])
    table = BeamStations(station, SECTIONS.stiffness, SECTIONS.inertia)
    tower = replace(
        land, base_height=20.0, height=100.0, diameter_station=station, diameter=[6.0, 6.0], structure=table,
        support=uniform_support(water_density=0.0),
    )  # fmt: skip
    beam = tower_beam(tower, 16)
    whole = Beam(BeamSections.uniform(130.0, EA=1e12, EIx=EI, EIy=EI, GJ=3e11, mass=MASS), 26)
    assert beam.node_position[0] == pytest.approx([0.0, 0.0, -50.0])
    assert beam.node_position[-1] == pytest.approx([0.0, 0.0, 80.0])
    expected = clamped_modes(whole, 3, node_dofs=(0, 4)).frequency
    assert clamped_modes(beam, 3, node_dofs=(0, 4)).frequency == pytest.approx(expected, rel=1e-7)


def test_pile_in_uniform_springs():
    """Long piles: Hetényi's closed form; a rigid one: k L, k L²/2 and k L³/3 about its head."""
    k, beta = 5e7, (5e7 / (4.0 * EI)) ** 0.25
    long = pile_head_stiffness(8.0 / beta, lambda depth: k, **PILE)
    expected = [4.0 * EI * beta**3, -2.0 * EI * beta**2, 2.0 * EI * beta]
    assert [long[0, 0], long[0, 4], long[4, 4]] == pytest.approx(expected, rel=1e-4)
    assert long[1, 3] == pytest.approx(-long[0, 4])
    stiff = pile_head_stiffness(20.0, lambda depth: k, **(PILE | {"EI": 1e18, "EA": 1e18, "GJ": 1e18}))
    assert [stiff[0, 0], stiff[0, 4], stiff[4, 4]] == pytest.approx([k * 20, -k * 200, k * 8000 / 3], rel=1e-4)
    assert [stiff[2, 2], stiff[5, 5]] == pytest.approx([1e8 * 20, 1e9 * 20], rel=1e-4)


def test_soil_that_stiffens_with_depth_counts_from_the_head():
    growing = pile_head_stiffness(20.0, lambda depth: 1e6 * depth, **(PILE | {"EI": 1e18}))
    assert growing[0, 0] == pytest.approx(1e6 * 20.0**2 / 2.0, rel=1e-4)
    assert growing[4, 4] == pytest.approx(1e6 * 20.0**4 / 4.0, rel=1e-4)


def test_shear_under_the_tip_of_a_rigid_pile():
    """A spring k at the depth L adds k, k L and k L² to the head: a shift to +x goes with a turn about -y."""
    stiff = PILE | {"EI": 1e18, "EA": 1e18, "GJ": 1e18}
    free, held = (pile_head_stiffness(20.0, lambda d: 5e7, **stiff, base_lateral=k) for k in (0.0, 1e8))
    expected = np.zeros((6, 6))
    expected[0, 0] = expected[1, 1] = 1e8
    expected[0, 4] = expected[4, 0] = -1e8 * 20.0
    expected[1, 3] = expected[3, 1] = 1e8 * 20.0
    expected[3, 3] = expected[4, 4] = 1e8 * 400.0
    np.testing.assert_allclose(held - free, expected, atol=1e-4 * 1e8 * 400.0)
    np.testing.assert_allclose((held - free)[:2], expected[:2], atol=1e-4 * 1e8 * 20.0)


def test_piles_and_supports_refuse_nonsense():
    def pile(**changes):
        return lambda: pile_head_stiffness(**(dict(length=30.0, lateral=lambda d: 1e7) | PILE | changes))

    def support(**changes):
        return lambda: uniform_support(**changes)

    refuses(
        ValueError,
        ("length of a pile", pile(length=-1.0)),
        ("EI of a pile", pile(EI=0.0)),
        ("torsional of a pile is inf", pile(torsional=np.inf)),
        ("lateral", pile(lateral=lambda d: -d)),
        ("somewhere positive", pile(lateral=lambda d: 0.0)),
        ("must be finite", pile(lateral=lambda d: np.inf)),
    )
    nrel = load_turbine("nrel_5mw")
    refuses(
        TurbineDefinitionError,
        ("positive definite", support(foundation=np.zeros((6, 6)))),
        ("shape", support(foundation=np.eye(3))),
        ("symmetric", support(foundation=SPRINGS + np.triu(1e9 * np.ones((6, 6)), 1))),
        ("water_density", support(water_density=-1.0)),
        ("a grid from 0 to 50 m", support(diameter_station=[0.0, 40.0])),
        (
            "one at the base of the tower, 0 m up",
            lambda: replace(nrel, tower=replace(nrel.tower, support=uniform_support())),
        ),
        ("75 m where the monopile begins", lambda: load_turbine("iea_15mw", water_depth=80.0)),
        ("water_depth", lambda: load_turbine("iea_15mw", water_depth=-1.0)),
        ("foundation", lambda: load_turbine("iea_15mw", foundation=SPRINGS)),
        ("no components.monopile", lambda: load_turbine("nrel_5mw", water_depth=20.0)),
        ("no windIO file", lambda: load_turbine("gebhardt_45m", water_depth=20.0)),
    )


def test_monopile_of_a_windio_file():
    """Sections of NREL/TP-5000-75698 at the sea bed, 30 m of water, the depth that is asked for."""
    support = load_turbine("iea_15mw_monopile").tower.support
    assert (support.base_height, support.length) == (-30.0, pytest.approx(45.0))
    assert support.structure.stiffness[0, 4, 4] == pytest.approx(4.2748e12, rel=1e-4)
    assert support.structure.inertia[0, 0, 0] == pytest.approx(14429.96, rel=1e-4)
    assert support.diameter == pytest.approx(np.full(support.diameter.size, 10.0))
    deeper = load_turbine("iea_15mw", water_depth=40.0, foundation=SPRINGS).tower.support
    assert (deeper.base_height, deeper.length) == (-40.0, pytest.approx(55.0))
    assert np.array_equal(deeper.foundation, SPRINGS)
    assert load_turbine("iea_15mw").tower.support is None


def test_oc3_masses_and_stiffnesses():
    """Published of the OC3 tower: 4306.5 and 1953.9 kg/m, 474.5e9 and 89.49e9 N m² at its ends; pile 9517 kg/m."""
    tower = load_turbine("nrel_5mw_monopile").tower
    assert tower.structure.inertia[[0, -1], 0, 0] == pytest.approx([4306.51, 1953.87], rel=1e-5)
    assert tower.structure.stiffness[[0, -1], 4, 4] == pytest.approx([474.49e9, 89.488e9], rel=1e-4)
    assert tower.support.structure.inertia[0, 0, 0] == pytest.approx(9517.14, rel=1e-5)
    assert tower.support.structure.stiffness[0, 4, 4] == pytest.approx(1037.13e9, rel=1e-5)


@pytest.mark.parametrize(
    "changes",
    [{"formulation": "observer"}, {"tower_shapes": (((1.0,),), ((1.0,),)), "tower_modes": (1, 1, 0)}],
    ids=lambda changes: next(iter(changes)),
)
def test_what_needs_a_clamped_tower_is_refused(changes):
    with pytest.raises(SimulationError, match=f"Fidelity.{next(iter(changes))} = "):
        Simulator("nrel_5mw_monopile", SteadyInflow(10.0), Fidelity("clamped", **changes))


def test_rigid_towers_stay_rigid_on_springs():
    simulator = Simulator("nrel_5mw_monopile", SteadyInflow(10.0), Fidelity("rigid tower", tower_coordinates="rigid"))
    assert simulator.structure.system.bodies[simulator.structure.tower].n_elastic == 0


def test_ground_loads_carry_the_weight_and_the_moment_to_the_sea_bed():
    """Weight of all that stands there; the moment grows by the shear times the depth; asking changes nothing."""
    simulator = Simulator("nrel_5mw_monopile", SteadyInflow(10.0))
    simulator.reset(1.2)
    for _ in range(50):
        signals = simulator.advance(0.2, np.radians(2.0), generator_torque=30e3)
    kept, before = simulator.state(), signals.values.copy()
    loads = simulator.ground_loads()
    assert np.array_equal(simulator.signals.values, before)
    tower, blade = simulator.turbine.tower, simulator.structure.blade_inertia.mass
    steel = tower_beam(tower, 10).particle_mass.sum()
    nacelle, hub = simulator.turbine.nacelle, simulator.turbine.hub
    mass = steel + 3 * blade + hub.mass + nacelle.mass + nacelle.yaw_bearing_mass
    assert loads[2] == pytest.approx(-9.81 * mass, rel=0.02)
    assert loads[4] == pytest.approx(signals.tower_base_moment_y + 30.0 * loads[0], rel=1e-12)
    assert loads[3] == pytest.approx(signals.tower_base_moment_x - 30.0 * loads[1], rel=1e-12)
    assert loads[0] == pytest.approx(signals.rotor_thrust, rel=0.2)
    simulator.advance(0.2, 0.0)
    simulator.restore(kept)
    assert np.array_equal(simulator.ground_loads(), loads)


@pytest.mark.parametrize("name", ["nrel_5mw", "nrel_5mw_monopile", "iea_15mw_monopile"])
def test_tower_dampers_know_the_tower_with_its_pile(name):
    """Spring and ratio of deflections are those of the finite elements; the frequency is a Rayleigh quotient."""
    turbine = load_turbine(name)
    rule, beam = tower_top(turbine), tower_beam(turbine.tower, 24)
    moving = [6 * node + dof for node in range(beam.first_free, len(beam.nodes)) for dof in (0, 1, 3, 4)]
    stiffness = beam.stiffness[np.ix_(moving, moving)]
    for move, turn, sign, frequency in ((0, 4, 1.0, rule.fore_aft), (1, 3, -1.0, rule.side_side)):
        loads = np.zeros((beam.n_dof, 2))
        loads[-6 + move, 0], loads[-6 + turn, 1] = 1.0, sign
        by_force, by_moment = np.linalg.solve(stiffness, loads[moving])[moving.index(beam.n_dof - 6 + move)]
        assert 1.0 / (rule.mass * frequency**2) == pytest.approx(by_force, rel=0.005)
        assert rule.force_per_moment == pytest.approx(by_moment / by_force, rel=0.005)
    point = np.zeros((6, 6))
    hub, nacelle, blade = turbine.hub, turbine.nacelle, turbine.blade.structure
    rotor = hub.mass + turbine.n_blades * np.trapezoid(blade.inertia[:, 0, 0], blade.station)
    point[:3, :3] = (nacelle.mass + nacelle.yaw_bearing_mass + rotor) * np.eye(3)
    exact = clamped_modes(beam, 1, tip_mass=point, node_dofs=(0, 4)).frequency[0]
    assert rule.fore_aft == pytest.approx(2.0 * np.pi * exact, rel=0.02)


def test_a_nodal_tower_stands_on_a_monopile():
    simulator = Simulator("nrel_5mw_monopile", SteadyInflow(10.0), Fidelity("nodal", tower_coordinates="nodal"))
    signals = simulator.reset(1.2)
    modal = Simulator("nrel_5mw_monopile", SteadyInflow(10.0)).reset(1.2)
    assert signals.tower_top_fore_aft == pytest.approx(modal.tower_top_fore_aft, rel=0.01)


def test_environment_on_a_monopile():
    """The tower base feels the thrust on the lever above it, the picture reaches the sea bed, snapshots hold."""
    environment = gym.make("wt_gym/NREL5MW-Steady-v1", turbine="nrel_5mw_monopile", wind_speed=10.0).unwrapped
    environment.reset(seed=1)
    action = np.zeros(environment.action_space.shape, dtype=np.float32)
    for _ in range(20):
        environment.step(action)
    kept = environment.snapshot()
    rewards = []
    for _ in range(2):
        environment.restore(kept)
        rewards.append([environment.step(action)[1] for _ in range(5)])
    assert rewards[0] == rewards[1]
    simulator = environment.simulator
    signals, shapes = simulator.signals, simulator.geometry()
    assert shapes["tower"][0, 2] == pytest.approx(-20.0, abs=0.02)
    assert shapes["tower"][-1, 2] == pytest.approx(simulator.turbine.tower.height, abs=0.1)
    assert 0.7 < signals.tower_base_fore_aft_moment / (80.0 * signals.rotor_thrust) < 1.3


def test_pictures_show_what_stands_in_the_water():
    column = np.array([[0.0, 0.0, -20.0, 3.0], [0.0, 0.0, 10.0, 3.0], [1.0, 0.0, 80.0, 2.0]])
    below, above = cut_at_sea_level(column)
    assert below[:, 2] == pytest.approx([-20.0, 0.0])
    assert above[:, 2] == pytest.approx([0.0, 10.0, 80.0])
    below, above = cut_at_sea_level(column[1:])
    assert (len(below), len(above)) == (0, 2)
