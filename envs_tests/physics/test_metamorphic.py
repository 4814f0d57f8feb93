"""Metamorphic tests of the simulator: a world that is turned about the vertical or seen in a mirror is the same."""

import math
from dataclasses import replace

import numpy as np
import pytest

from wt_gym.aerodynamics import TRAINING, VortexLattice, build_planform, span_distribution
from wt_gym.simulation import FIDELITIES, Simulator
from wt_gym.simulation.channels import channel_table, parities
from wt_gym.simulation.turbine_structure import averaged_over_yaw
from wt_gym.turbines import load_turbine
from wt_gym.turbines.variants import mirrored
from wt_gym.wind import SteadyInflow, TransientInflow, TurbulenceBox, TurbulentInflow, TurningInflow

GLOBAL = ("wind_x", "wind_y", "yaw", "tower_top_x", "tower_top_y", "tower_base_moment_x", "tower_base_moment_y")
NAMES = [channel.name for channel in channel_table(3)]


def played(simulator, side=1.0, seconds=4.0, yaw=0.1, angle=0.0):
    """Signals (n, n_channels) of a nacelle that yaws to the side of the sign, its heading shifted by an angle."""
    rows = [simulator.reset(1.1, pitch=0.1, azimuth=0.4, yaw=angle + side * yaw).values]
    for k in range(round(seconds / 0.2)):
        pitch = 0.1 + 0.02 * np.sin(0.5 * k + np.arange(3))
        rows.append(simulator.advance(0.2, pitch, side * 0.004, 40e3).values)
    return np.array(rows)


def course(simulator, inflow, angle, seconds=4.0):
    """Signals in a sheared wind from the side, all turned by an angle."""
    simulator.inflow = TurningInflow.by(inflow, angle)
    return played(simulator, 1.0, seconds, angle=angle)


def assert_turned(first, second, angle, tolerance):
    """The same signals; those along global axes are turned."""
    cos, sin = math.cos(angle), math.sin(angle)
    for k, name in enumerate(NAMES):
        if name not in GLOBAL:
            size = np.abs(first[:, k]).max() + 1e-12
            np.testing.assert_allclose(second[:, k] / size, first[:, k] / size, atol=tolerance, err_msg=name)
    for stem in ("wind", "tower_top", "tower_base_moment"):
        (x, y), (u, v) = ([part[:, NAMES.index(f"{stem}_{axis}")] for axis in "xy"] for part in (first, second))
        size = np.hypot(x, y).max()
        np.testing.assert_allclose(u / size, (cos * x - sin * y) / size, atol=tolerance, err_msg=stem)
        np.testing.assert_allclose(v / size, (sin * x + cos * y) / size, atol=tolerance, err_msg=stem)
    k = NAMES.index("yaw")
    np.testing.assert_allclose(second[:, k], first[:, k] + angle, atol=1e-9)


WIND = SteadyInflow(13.0, 90.0, shear_exponent=0.2, veer=0.001, yaw_misalignment=0.2, inclination=0.1)


@pytest.fixture(scope="module")
def simulator():
    return Simulator("nrel_5mw", WIND)


@pytest.fixture(scope="module")
def straight(simulator):
    return course(simulator, WIND, 0.0)


@pytest.mark.parametrize("degrees", [30.0, 90.0, 180.0, 237.0])
def test_a_turned_world_is_the_same(simulator, straight, degrees):
    angle = math.radians(degrees)
    assert_turned(straight, course(simulator, WIND, angle), angle, 1e-5)


def test_a_gust_from_any_side_is_the_same(simulator):
    gust = TransientInflow.ecd(12.0, 90.0, 126.0, start_time=0.5)
    first, second = (course(simulator, gust, angle) for angle in (0.0, 2.0))
    assert_turned(first, second, 2.0, 2e-5)  # the nacelle accelerates by 0.8 m/s², and wakes are of single precision


@pytest.mark.slow
@pytest.mark.parametrize(
    ("fidelity", "tolerance"),
    [
        (replace(FIDELITIES["training"], name="spring", yaw_drive="spring"), 1e-5),
        (FIDELITIES["training-torsion"], 1e-5),
        (FIDELITIES["engineering"], 1e-4),
    ],
    ids=lambda given: getattr(given, "name", None),
)
def test_a_turned_world_is_the_same_at_every_fidelity(fidelity, tolerance):
    simulator = Simulator("nrel_5mw", WIND, fidelity)
    first, second = (course(simulator, WIND, angle, 2.0) for angle in (0.0, 2.0))
    assert_turned(first, second, 2.0, tolerance)


def test_a_nacelle_that_turns_sees_its_loads_in_its_own_axes(simulator):
    """Across the wind the thrust, which goes with the rotor, bends the tower along the nacelle and not along x."""
    inflow = SteadyInflow(10.0, 90.0, yaw_misalignment=0.5 * math.pi)
    simulator.inflow = inflow
    signals = simulator.reset(1.1, yaw=0.5 * math.pi)
    assert signals.tower_base_fore_aft_moment > 5.0 * abs(signals.tower_base_side_side_moment)
    assert signals.tower_top_fore_aft > 5.0 * abs(signals.tower_top_side_side)
    # a push along +y bends the tower about -x
    assert signals.tower_base_moment_x == pytest.approx(-signals.tower_base_fore_aft_moment, rel=1e-3)
    assert signals.tower_top_y == pytest.approx(signals.tower_top_fore_aft, rel=1e-3)


def test_tower_modes_have_no_preferred_plane(simulator):
    """Each bending shape along x has its like along y, of a round tower under whatever stands on it."""
    _, shapes = simulator.structure.tower_field
    along, across = shapes[0::6, :2], shapes[1::6, 2:4]
    np.testing.assert_allclose(np.abs(across), np.abs(along), rtol=1e-9, atol=1e-12)
    assert np.abs(along).max() > 0.0


def test_the_mean_over_the_yaw_is_that_over_every_angle():
    rng = np.random.default_rng(1)
    mass = rng.normal(size=(6, 6))
    mass = mass + mass.T
    turned = []
    for angle in 2.0 * np.pi * np.arange(7) / 7:
        c, s = np.cos(angle), np.sin(angle)
        turn = np.kron(np.eye(2), [[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
        turned.append(turn @ mass @ turn.T)
    np.testing.assert_allclose(averaged_over_yaw(mass), np.mean(turned, axis=0), atol=1e-14)


# ---- mirrored ----

MIRROR = np.array([1.0, -1.0, 1.0])
LEFT = SteadyInflow(11.0, 90.0, shear_exponent=0.2, veer=0.002, yaw_misalignment=0.3, inclination=0.1)
RIGHT = replace(LEFT, veer=-0.002, yaw_misalignment=-0.3)


def mirrored_winds():
    """Pairs of inflows that are each other's mirror image at y = 0."""
    box = TurbulenceBox.kaimal(11.0, 90.0, 126.0, "B", seed=1, grid=(5, 5), cache=False)
    yield LEFT, RIGHT
    # the columns go the other way, as the lateral component does
    across = np.ascontiguousarray(box.fluctuation[:, :, ::-1]) * MIRROR.astype(np.float32)
    yield TurbulentInflow(box, LEFT, 3.0), TurbulentInflow(replace(box, fluctuation=across), RIGHT, 3.0)
    for make in (TransientInflow.ecd, TransientInflow.edc):
        kind = {"turbulence_class": "B"} if make is TransientInflow.edc else {}
        yield tuple(make(11.0, 90.0, 126.0, sign=sign, start_time=1.0, **kind) for sign in (1, -1))
    shear = (TransientInflow.ews(11.0, 90.0, 126.0, "B", axis="horizontal", sign=sign) for sign in (1, -1))
    yield tuple(shear)


def test_every_wind_has_a_mirror_image():
    points = np.random.default_rng(2).uniform([-200.0, -100.0, 20.0], [200.0, 100.0, 160.0], (40, 3))
    for one, other in mirrored_winds():
        for time in (0.0, 2.5, 7.0):
            seen = one.velocity(points, time)
            np.testing.assert_allclose(other.velocity(points * MIRROR, time), seen * MIRROR, atol=1e-5)
        assert np.abs(other.velocity(points, 7.0) - seen).max() > 0.1


def symmetric_blade():
    """A twisted blade of symmetric sections, whose mirror image has the same polars."""
    angles = -np.pi + 2.0 * np.pi * np.arange(360) / 360
    polar = np.stack([1.1 * np.sin(2.0 * angles) + 4.0 * np.sin(angles), 0.01 + np.sin(angles) ** 2, 0 * angles], -1)
    edges = span_distribution(4.0, 60.0, TRAINING.n_span)
    axis = np.stack([0.0 * edges, 0.0 * edges, edges], -1)
    twist, chord = 0.25 * (1.0 - edges / 60.0), 4.0 - 0.04 * edges
    polars = np.tile(polar, (TRAINING.n_span, 1, 1))
    return build_planform(edges, axis, chord, twist, 0.25 + 0.0 * edges, polars, TRAINING.n_chord)


def rotor_forces(inflow, mirror):
    """Nodal forces (40, 3, ...) of a rotor that begins to turn, clockwise or as its mirror image."""
    planform, speed, dt, center = symmetric_blade(), 1.2, 0.1, np.array([-5.0, 0.0, 90.0])
    solver = VortexLattice(planform, 3, TRAINING, 1.225)
    state, found = solver.new_state(), []
    for k in range(41):
        angles = 0.3 + speed * dt * k + 2.0 * np.pi * np.arange(3) / 3
        turns = [np.array([[1, 0, 0], [0, np.cos(a), -np.sin(a)], [0, np.sin(a), np.cos(a)]]) for a in angles]
        nodes = np.array([planform.nodes @ turn.T for turn in turns])
        velocities = np.cross([speed, 0.0, 0.0], nodes)
        nodes, velocities = (nodes + center) * mirror, velocities * mirror
        if k == 0:
            solver.reset(state, nodes, velocities, inflow.velocity(nodes, 0.0))
            continue
        solver.convect_wake(state, inflow, (k - 1) * dt, dt)
        found.append(np.array(solver.solve(state, nodes, velocities, inflow.velocity(nodes, k * dt), dt)))
        solver.accept(state)
    return np.array(found)


def test_a_rotor_that_turns_the_other_way_has_the_mirrored_forces():
    """Wing and wake of the vortex lattice, in a sheared wind from the side."""
    forces, mirrored = rotor_forces(LEFT, np.ones(3)), rotor_forces(RIGHT, MIRROR)
    size = np.abs(forces).max()
    assert np.abs(forces[..., 1]).max() > 0.05 * size
    np.testing.assert_allclose(mirrored / size, forces * MIRROR / size, atol=1e-5)


# ---- a turbine that turns the other way ----

CLOCKWISE = load_turbine("nrel_5mw")
OTHER = mirrored(CLOCKWISE)
SIGNS = parities(3)


def lopsided(turbine):
    """A turbine whose nacelle has its mass on the left, and products of inertia."""
    nacelle = turbine.nacelle
    inertia = nacelle.inertia + 0.1 * nacelle.inertia[0, 0] * (1.0 - np.eye(3))
    return replace(turbine, nacelle=replace(nacelle, cm=nacelle.cm + np.array([0.0, 0.8, 0.0]), inertia=inertia))


def assert_mirrored(first, second, tolerance=0.0, signs=SIGNS):
    """Signals of a turbine and of its image, each over the largest of its channel."""
    size = np.abs(first).max(axis=0) + 1e-300
    for k, name in enumerate(NAMES):
        np.testing.assert_allclose(second[:, k] / size[k], signs[k] * first[:, k] / size[k], atol=tolerance,
                                   rtol=0.0, err_msg=name)  # fmt: skip


@pytest.fixture(scope="module")
def pair():
    """A turbine that is not alike on both sides, and its mirror image."""
    return Simulator(lopsided(CLOCKWISE), LEFT), Simulator(mirrored(lopsided(CLOCKWISE)), RIGHT)


@pytest.fixture(scope="module")
def clockwise_course(pair):
    pair[0].inflow = LEFT
    return played(pair[0], 1.0)


def test_a_counter_clockwise_turbine_has_the_mirrored_signals(pair, clockwise_course):
    pair[1].inflow = RIGHT
    second = played(pair[1], -1.0)
    assert_mirrored(clockwise_course, second)
    # what is odd is not nothing, so that a sign shows
    odd = clockwise_course[:, SIGNS < 0.0]
    assert np.all(np.abs(odd).max(axis=0) > 1e-3)
    np.testing.assert_array_equal(pair[1].ground_loads(), pair[0].ground_loads() * [1, -1, 1, -1, 1, -1])


@pytest.mark.parametrize("case", range(5))
def test_in_every_kind_of_wind(pair, case):
    """Boxes interpolate from the other side, which rounds otherwise."""
    one, other = list(mirrored_winds())[case]
    pair[0].inflow, pair[1].inflow = one, other
    assert_mirrored(played(pair[0], 1.0, 2.0), played(pair[1], -1.0, 2.0), 1e-6)


def test_it_turns_counter_clockwise():
    """Of shapes, not of signs: a blade that points up moves to the left, and the wake turns to the right."""
    for turbine, side in ((CLOCKWISE, -1.0), (OTHER, 1.0)):
        simulator = Simulator(turbine, SteadyInflow(11.0, 90.0))
        signals = simulator.reset(1.2)
        tip = [simulator.geometry()["blades"][0, 0, -1].copy()]
        for _ in range(2):
            signals = simulator.advance(0.1, signals.pitch, 0.0, signals.generator_torque)
            tip.append(simulator.geometry()["blades"][0, 0, -1].copy())
        assert tip[0][2] > 140.0
        assert side * (tip[1][1] - tip[0][1]) > 6.0  # 1.2 rad/s, 63 m, 0.1 s
        assert side * (tip[2][1] - tip[1][1]) > 6.0
        assert 0.0 < signals.azimuth < 0.3
        # the generator passes the torque of the air on to the nacelle: the tower bends to where an upper blade moves
        assert side * signals.tower_top_side_side > 0.0
        assert signals.aero_torque > 0.0
        assert signals.generator_power > 0.0


def test_shapes_are_reflected(pair):
    pair[0].inflow, pair[1].inflow = LEFT, RIGHT
    for simulator, side in zip(pair, (1.0, -1.0), strict=True):
        played(simulator, side, 1.0)
    one, other = (simulator.geometry() for simulator in pair)
    assert set(one) == set(other)
    for name, values in one.items():
        signs = {"tower_radius": 1.0, "wake_circulation": -1.0}.get(name, MIRROR)
        np.testing.assert_array_equal(other[name], values * signs, err_msg=name)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("turbine", "fidelity"),
    [
        ("nrel_5mw", "engineering"),
        ("nrel_5mw", "training-torsion"),
        ("nrel_5mw", replace(FIDELITIES["training"], name="spring", yaw_drive="spring")),
        ("nrel_5mw", replace(FIDELITIES["training"], name="bodies", tower_body=(8, 8), nacelle_body=(8, 8))),
        ("nrel_5mw", replace(FIDELITIES["training"], name="constrained", formulation="constrained")),
        ("nrel_5mw", replace(FIDELITIES["training"], name="ground", aero=replace(TRAINING, ground_height=0.0))),
        ("nrel_5mw_monopile", "training"),
    ],
    ids=lambda given: getattr(given, "name", given),
)
def test_at_every_fidelity(turbine, fidelity):
    """Tower and ground, whose bodies and images are reflected with it, constraint equations, and a pile in the sea."""
    turbine = lopsided(load_turbine(turbine))
    one, other = Simulator(turbine, LEFT, fidelity), Simulator(mirrored(turbine), RIGHT, fidelity)
    assert_mirrored(played(one, 1.0, 1.0), played(other, -1.0, 1.0))
    np.testing.assert_array_equal(other.ground_loads(), one.ground_loads() * [1, -1, 1, -1, 1, -1])
    if one.fidelity.formulation == "constrained":
        np.testing.assert_array_equal(other.root_multipliers(), one.root_multipliers())


@pytest.mark.slow
def test_linear_models_are_mirrored():
    """The response to wind from the side and to yaw, of the model of the one and of the other."""
    wind = replace(LEFT, speed=16.0)
    arguments = {"rotor_speed": 1.267, "pitch": 0.2, "multiblade": True, "n_azimuths": 2}
    one = Simulator(lopsided(CLOCKWISE), wind).linearize(yaw=0.1, **arguments)
    image = replace(wind, veer=-wind.veer, yaw_misalignment=-wind.yaw_misalignment)
    other = Simulator(mirrored(lopsided(CLOCKWISE)), image).linearize(yaw=-0.1, **arguments)
    assert one.operating_point.yaw == -other.operating_point.yaw
    np.testing.assert_array_equal(other.operating_point.outputs, one.operating_point.outputs * SIGNS)
    names = {channel.name: channel.parity for channel in channel_table(3)}
    outputs = np.array([names.get(name, 1) for name in one.output_names])
    time = np.linspace(0.0, 4.0, 41)
    for name, sign in (("wind_y", -1), ("yaw", -1), ("wind_x", 1), ("pitch_cosine", 1), ("generator_torque", 1)):
        first = one.response(time, {name: 0.01})
        second = other.response(time, {name: sign * 0.01})
        np.testing.assert_array_equal(second, first * outputs, err_msg=name)
    modes = [(m.name, m.frequency, m.damping) for m in one.modes()]
    for mode, (name, frequency, damping) in zip(other.modes(), modes, strict=True):
        assert mode.name == name
        assert (mode.frequency, mode.damping) == pytest.approx((frequency, damping), rel=1e-6)
    # the same state, a tower bent to the left, has the same side-side displacement
    k = one.state_names.index("side_side_1")
    row = one.output_names.index("tower_top_side_side")
    assert other.C[row, k] == one.C[row, k] != 0.0
