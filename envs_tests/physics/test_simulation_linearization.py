"""Linear models of the turbine: exact properties, forecast of the simulation, modes, doors."""

import csv
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from envs_tests.physics.cases.tools import mass_matrix, rate_jacobian
from envs_tests.physics.cases.turbine_modes import weightless_simulator
from wt_gym.base.errors import SimulationError
from wt_gym.commands import parse as parse_command
from wt_gym.simulation import FIDELITIES, Simulator
from wt_gym.simulation.campbell import campbell
from wt_gym.simulation.linear_model import LinearModel, multiblade_model
from wt_gym.simulation.linearization import linearize
from wt_gym.wind import SteadyInflow, TransientInflow

RPM = np.pi / 30.0
RATED = 12.1 * RPM


@pytest.fixture(scope="module")
def simulator():
    return Simulator("nrel_5mw", inflow=SteadyInflow(18.0))


@pytest.fixture(scope="module")
def weightless():
    return weightless_simulator()


@pytest.fixture(scope="module")
def operating(simulator):
    """Linear model at 18 m/s in multi-blade coordinates."""
    return linearize(simulator, rotor_speed=RATED, pitch=np.radians(14.92), multiblade=True)


def test_nodal_tower_has_the_modes_of_a_modal_one():
    """Its inner nodes move no point of the blades; the model was not finite for that."""
    parked = {"rotor_speed": 0.0, "aerodynamics": "none", "generator": "locked", "outputs": ("rotor_speed",)}
    found = []
    for changes in ({}, {"tower_coordinates": "nodal", "tower_elements": 6, "integrator": "generalized_alpha"}):
        fidelity = replace(FIDELITIES["training"], **changes)
        modes = Simulator("nrel_5mw", SteadyInflow(8.0), fidelity).linearize(**parked).modes()
        found.append(sorted(mode.frequency for mode in modes if mode.frequency > 0.0)[:8])
    np.testing.assert_allclose(found[1], found[0], rtol=5e-3)


def test_rotating_oscillators_split_by_the_rotor_speed():
    """Three equal oscillators of frequency ω: eigenvalues ω, ω − Ω, ω + Ω in multi-blade coordinates."""
    names = tuple(f"blade_{i}_flap_1{s}" for s in ("", "_rate") for i in (1, 2, 3))
    a = np.block([[np.zeros((3, 3)), np.eye(3)], [-25.0 * np.eye(3), np.zeros((3, 3))]])
    none = np.zeros((6, 0)), np.zeros((0, 6)), np.zeros((0, 0))
    model = multiblade_model(LinearModel(a, *none, names, (), ()), 0.3, 1.2)
    frequency = {mode.name: 2.0 * np.pi * mode.frequency for mode in model.modes()}
    assert frequency == pytest.approx({"flap_1 regressive": 3.8, "flap_1 collective": 5.0, "flap_1 progressive": 6.2})


def test_isotropic_rotor_has_one_matrix_in_multiblade_coordinates(weightless):
    """Without gravity and air nothing depends on the azimuth (rows relative to their largest entry)."""
    models = [
        linearize(weightless, rotor_speed=RATED, azimuth=a, n_azimuths=1, aerodynamics="none", multiblade=True)
        for a in (0.0, 0.4, 1.9)
    ]
    for key in "AB":
        first = getattr(models[0], key)
        size = np.abs(first).max(axis=1, keepdims=True) + 1e-12
        for model in models[1:]:
            assert (np.abs(getattr(model, key) - first) / size).max() < 1e-6


def test_parked_frequencies_are_those_of_the_mass_damping_and_stiffness_matrices(simulator):
    """Generator locked: eigenvalues of A against those of M, C and K, with C as bodies and joints have it."""
    model = linearize(simulator, rotor_speed=0.0, aerodynamics="none", generator="locked", multiblade=True)
    system, y = simulator.structure.system, model.operating_point.states[0]
    mass, n = mass_matrix(system, y), system.n_u
    stiffness = -(mass @ rate_jacobian(system, y, step=1e-5)[:, :n])
    free = [i for i in range(n) if i != simulator.structure.azimuth_u]
    at = np.ix_(free, free)
    damping = np.diag(system.tree.dof_damping)
    for b, body in enumerate(system.bodies):
        first = system.index(b, "elastic_u")
        own = slice(first, first + body.n_elastic)
        damping[own, own] += body.damping
    lower = -np.linalg.solve(mass[at], np.hstack([stiffness[at], damping[at]]))
    roots = np.linalg.eigvals(np.vstack([np.eye(len(free), 2 * len(free), len(free)), lower]))
    exact = np.sort(np.abs(roots[roots.imag > 0.0])) / (2.0 * np.pi)
    obtained = np.sort([mode.natural_frequency for mode in model.modes()])
    np.testing.assert_allclose(obtained, exact, rtol=1e-5)
    assert {mode.name for mode in model.modes()} >= {"flap_1 yaw", "flap_1 tilt", "fore_aft_1", "shaft_torsion"}


def test_modes_of_the_turbine_in_operation(operating):
    """Aerodynamic damping by its kind: flapwise large, tower fore-aft some percent, edgewise and side-side little."""
    damping = {mode.name: mode.damping for mode in operating.modes()}
    assert damping["flap_1 collective"] > 0.3
    assert 0.03 < damping["fore_aft_1"] < 0.12
    assert damping["fore_aft_1"] > 3.0 * damping["side_side_1"]
    for name in ("edge_1 regressive", "edge_1 progressive", "side_side_1"):
        assert 0.0 < damping[name] < 0.03
    for mode in operating.modes():
        assert sum(mode.participation.values()) == pytest.approx(1.0)


def test_static_gains_have_their_signs(operating):
    """First accelerations and aerodynamic loads after a change: feathering unloads, wind loads, torque brakes."""
    d = {(o, i): operating.D[operating.output_names.index(o), operating.input_names.index(i)]
         for o in operating.output_names for i in operating.input_names}  # fmt: skip
    rate = operating.B[operating.state_names.index("azimuth_rate"), operating.input_names.index("generator_torque")]
    # the nacelle gives way to the reaction: the relative speed changes faster than with the generator's inertia alone
    assert -2.0 < rate * 534.116 * 97.0 < -1.0
    assert d["aero_thrust", "wind_speed"] > 0.0
    assert d["aero_torque", "wind_speed"] > 0.0
    assert d["wind_x", "wind_speed"] == pytest.approx(1.0)
    c = operating.C[operating.output_names.index("aero_thrust"), operating.state_names.index("pitch_collective")]
    assert c < 0.0


def test_trim_is_the_operating_point_of_the_simulation(operating, simulator):
    """Mean signals against a settled run of the coupled simulation with its free wake."""
    point = operating.operating_point
    simulator.reset(rotor_speed=RATED, pitch=np.radians(14.92))
    torque, means = point.generator_torque, []
    for k in range(250):
        s = simulator.advance(0.2, pitch=np.radians(14.92), generator_torque=torque)
        torque += 2e4 * (s.rotor_speed - RATED)
        if k >= 200:
            means.append([s.aero_thrust, s.generator_torque, s.tip_out_of_plane.mean(), s.tower_top_fore_aft])
    p = point.signals
    trimmed = [p.aero_thrust, p.generator_torque, p.tip_out_of_plane.mean(), p.tower_top_fore_aft]
    np.testing.assert_allclose(trimmed, np.mean(means, axis=0), rtol=0.05)


def test_rigid_shaft_leaves_the_wake_to_the_rotor(operating):
    """A shaft that hardly twists damps the tower like one that does not; its wake once turned with the first blade."""
    rigid = Simulator("nrel_5mw", SteadyInflow(18.0), replace(FIDELITIES["training"], stiffest_shaft=0.5))
    model = linearize(rigid, rotor_speed=RATED, pitch=np.radians(14.92), multiblade=True, outputs=("rotor_speed",))
    assert not [name for name in model.state_names if "shaft" in name]
    bent = [{mode.name: mode for mode in one.modes()}["fore_aft_1"] for one in (model, operating)]
    assert bent[0].frequency == pytest.approx(bent[1].frequency, rel=5e-3)
    assert bent[0].damping == pytest.approx(bent[1].damping, rel=0.03)


@pytest.mark.parametrize(("wind", "speed", "pitch"), [(8.0, 0.5966, 0.0), (12.0, 0.7917, 0.1167)])
def test_large_floating_rotor_has_an_operating_point(wind, speed, pitch):
    """Blades bend by more than ten meters and the lines are far from where slopes are taken first."""
    arguments = {"rotor_speed": speed, "pitch": pitch, "n_azimuths": 1, "outputs": ("aero_thrust",)}
    model = Simulator("volturnus_iea_15mw", SteadyInflow(wind)).linearize(**arguments)
    assert model.operating_point.residual < 1e-6
    surge = next(mode for mode in model.modes() if mode.name == "platform_surge")
    assert 0.01 < surge.damping < 0.1
    with pytest.raises(SimulationError, match="no steady operating point"):
        Simulator("iea_15mw", SteadyInflow(12.0)).linearize(wind_speed=40.0, rotor_speed=speed, n_azimuths=1)


def test_present_state_can_be_linearized_and_stays(simulator):
    simulator.reset(rotor_speed=RATED, pitch=np.radians(14.92), azimuth=0.5)
    simulator.advance(1.0, pitch=np.radians(14.92), generator_torque=38e3)
    before = simulator.state()
    model = linearize(simulator, outputs=("rotor_speed", "root_flap_moment"))
    assert simulator.state() == before
    assert model.output_names == ("rotor_speed", *(f"root_flap_moment_{i}" for i in (1, 2, 3)))
    assert "blade_1_flap_1" in model.state_names
    y = before.arrays["history_y"][-1]
    np.testing.assert_array_equal(model.operating_point.states[0], y)


def test_inputs_of_a_multiblade_model_are_told_apart(operating, weightless):
    """Each name once; the collective demand is that of the model of the single blades."""
    assert len(set(operating.input_names)) == len(operating.input_names) == operating.B.shape[1]
    assert {"pitch_collective", "pitch_cosine", "pitch_sine"} <= set(operating.input_names)
    pitch = [operating.input_names.index(f"pitch_{part}") for part in ("collective", "cosine", "sine")]
    assert np.linalg.matrix_rank(operating.B[:, pitch]) == 3
    single = linearize(weightless, rotor_speed=RATED, n_azimuths=1, aerodynamics="none")
    blades = [single.input_names.index(f"pitch_{i}") for i in (1, 2, 3)]
    collective = single.B[:, single.input_names.index("pitch_collective")]
    np.testing.assert_allclose(single.B[:, blades].sum(axis=1), collective, atol=1e-6 * np.abs(collective).max())


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"rotor_speed": 1.0, "aerodynamics": "magic"}, "aerodynamics must be .* got 'magic'"),
        ({"rotor_speed": 1.0, "generator": "broken"}, "generator must be .* got 'broken'"),
        ({"rotor_speed": -1.0}, "rotor_speed is -1"),
        ({"rotor_speed": 1.0, "n_azimuths": 0}, "n_azimuths"),
        (
            {"rotor_speed": 0.0, "aerodynamics": "none", "outputs": ("thrust",)},
            "output must be one of .*, got 'thrust'",
        ),
    ],
)
def test_arguments_without_meaning_are_refused(simulator, arguments, message):
    with pytest.raises(SimulationError, match=message):
        linearize(simulator, **arguments)


def test_unsteady_wind_needs_a_speed():
    simulator = Simulator("nrel_5mw", inflow=TransientInflow.eog(10.0, 90.0, 126.0))
    with pytest.raises(SimulationError, match="give wind_speed"):
        linearize(simulator, rotor_speed=1.0)


def test_selection_and_response(operating):
    model = operating.select(inputs=("generator_torque",), outputs=("rotor_speed",))
    assert model.B.shape[1] == model.C.shape[0] == 1
    time = np.arange(0.0, 2.0, 0.01)
    out = model.response(time, {"generator_torque": 1000.0})
    assert out.shape == (200, 1)
    # the rotor answers a torque like one inertia of 43.8e6 kg m², somewhat held by the air
    undamped = -97.0 * 1000.0 * 1.99 / 43_784_725.0
    assert 0.6 < out[-1, 0] / undamped < 1.0
    with pytest.raises(SimulationError, match="input 'wind'"):
        model.response(time, {"wind": 1.0})
    with pytest.raises(SimulationError, match="equally spaced"):
        model.response(np.array([0.0, 1.0, 3.0]))


def test_campbell_diagram(simulator, tmp_path):
    diagram = campbell(simulator, rotor_speeds=np.array([0.0, 6.0, 12.1]) * RPM)
    row = {name: frequency for name, frequency in zip(diagram.names, diagram.frequency, strict=True)}
    assert np.isfinite(diagram.frequency).all()
    assert np.all(np.diff(row["flap_1 progressive"]) > 0.0)
    assert np.all(np.diff(row["flap_1 regressive"]) < 0.0)
    # the support is soft: about one rotor speed either side of the blade's own frequency of 0.73 Hz
    shift = 12.1 / 60.0
    assert row["flap_1 progressive"][-1] - shift == pytest.approx(0.729, rel=0.05)
    assert row["flap_1 regressive"][-1] + shift == pytest.approx(0.729, rel=0.05)
    diagram.to_csv(tmp_path / "table.csv")
    with open(tmp_path / "table.csv", newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == len(diagram.rows()) == 3 * len(diagram.names)
    diagram.figure().savefig(tmp_path / "figure.png")
    assert (tmp_path / "figure.png").stat().st_size > 10_000


@pytest.mark.parametrize(
    ("name", "highest"), [("nrel_5mw", 1.1), ("nrel_5mw", 1.2), pytest.param("iea_15mw", 1.2, marks=pytest.mark.slow)]
)
def test_branches_have_the_names_of_the_modes_where_these_are_clear(name, highest):
    """Above rated speed the two first modes of the tower mix and swap their names, and so did whole branches."""
    simulator = Simulator(name, inflow=SteadyInflow(18.0))
    speeds = np.linspace(0.0, highest, 6) * simulator.turbine.drivetrain.rated_rotor_speed
    diagram = campbell(simulator, rotor_speeds=speeds)
    assert len(set(diagram.names)) == len(diagram.names)
    clear = []
    for k, speed in enumerate(speeds[:3]):
        model = simulator.linearize(rotor_speed=speed, aerodynamics="none", generator="locked", multiblade=True)
        for mode in model.modes():
            if mode.participation.get(mode.name, 0.0) > 0.9:
                clear.append((k, mode.name))
                assert diagram.frequency[diagram.names.index(mode.name), k] == pytest.approx(mode.frequency, rel=1e-9)
    assert {(0, "side_side_1"), (0, "fore_aft_1"), (1, "side_side_1"), (1, "fore_aft_1")} <= set(clear)


def test_campbell_over_wind_follows_the_schedule(simulator):
    schedule = {8.0: SimpleNamespace(rotor_speed=9.16 * RPM, pitch=0.0),
                18.0: SimpleNamespace(rotor_speed=RATED, pitch=np.radians(14.92))}  # fmt: skip
    diagram = campbell(simulator, wind_speeds=[8.0, 18.0], schedule=schedule.get, n_azimuths=3)
    np.testing.assert_allclose(diagram.pitch, [0.0, np.radians(14.92)])
    assert diagram.abscissa == "wind_speed"
    assert np.nanmax(diagram.damping) > 0.3
    with pytest.raises(SimulationError, match="schedule"):
        campbell(simulator, wind_speeds=[8.0])
    with pytest.raises(SimulationError, match="either"):
        campbell(simulator)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--out", "a.xyz"], "endings of figures are"),
        (["--wind-speed", "0"], "wind_speed must be numbers above 0 m/s"),
        (["--rotor-speed", "-1"], "rotor_speed must be numbers of at least 0 rpm"),
        (["--wind-speed", "8", "--pitch", "3"], "--pitch goes with --rotor-speed"),
        (["--azimuths", "0"], "azimuths must be a whole number of at least 1"),
        (["--fidelity", "gebhardt"], "linear models need the embedded formulation"),
        (["--fidelity", "nope"], "--fidelity must be one of training"),
    ],
)
def test_what_the_command_refuses_before_it_computes(capsys, arguments, message):
    with pytest.raises(SystemExit, match="2"):
        parse_command("campbell", arguments)
    assert message in capsys.readouterr().err
