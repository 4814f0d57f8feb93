"""Closed bodies of source panels, their coupling with a lattice, their forces, and the tower as a cylinder."""

import numpy as np
import pytest

from envs_tests.physics.cases.airfoils import UniformStream
from envs_tests.physics.cases.bodies import box_body
from envs_tests.physics.refusals import refuses
from wt_gym.aerodynamics import AerodynamicsError, AeroOptions, VortexLattice, build_planform
from wt_gym.aerodynamics.bodies import body_kernels
from wt_gym.aerodynamics.bodies.body_set import (
    BodySet,
    BodySurface,
    TowerFlow,
    convective_force,
    ellipsoid_body,
    impulse,
    revolution_body,
    tower_body,
)
from wt_gym.aerodynamics.bodies.tower_kernels import flag_wake_segments

# ---- bodies and towers ----------------------------------------------------------------------------------------------

CUBE = np.array([[x, y, z] for x in (0.0, 1.0) for y in (0.0, 1.0) for z in (0.0, 1.0)])
SIDES = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
GROUND = {"ground": 0.0}


@pytest.fixture(scope="module")
def sphere():
    return BodySet([ellipsoid_body((1.0, 1.0, 1.0), 16, 16)])


@pytest.fixture(scope="module")
def scene():
    """Tower on the ground with a nacelle above it."""
    tower = tower_body([0.0, 87.6], [6.0, 3.87], (0, 0, 0), (0, 0, 87.6), 10, 8, **GROUND)
    return BodySet([tower, ellipsoid_body((6.0, 2.0, 2.0), 10, 8, (1.0, 0.0, 90.5), "nacelle")], **GROUND)


def uniform(bodies, stream):
    return np.tile(np.asarray(stream, dtype=float), (bodies.n_panels, 1))


# ---- panels ----


@pytest.mark.parametrize("panel", [5, 40])  # a triangle at a pole and a quadrilateral
@pytest.mark.parametrize("distance", [0.3, 1.0, 4.0])
def test_panel_velocity_is_the_integral_of_point_sources(sphere, panel, distance):
    corners, center = sphere.arrays.corners[panel], sphere.arrays.center[:, panel]
    point = center + distance * np.array([0.48, -0.6, 0.64])
    u = (np.arange(300) + 0.5) / 300
    u, v = np.meshgrid(u, u, indexing="ij")
    u, v = u[..., None], v[..., None]
    a, b, c, d = corners
    at = (1 - u) * (1 - v) * a + u * (1 - v) * b + u * v * c + (1 - u) * v * d
    area = np.linalg.norm(np.cross((1 - v) * (b - a) + v * (c - d), (1 - u) * (d - a) + u * (c - b)), axis=-1) / 300**2
    arm = point - at
    exact = np.einsum("uvi,uv->i", arm, area / np.linalg.norm(arm, axis=-1) ** 3) / (4 * np.pi)
    near = body_kernels.near_velocity(corners, sphere.arrays.normal[panel], *point)
    np.testing.assert_allclose(near, exact, atol=1e-5 * np.linalg.norm(exact))
    used = np.empty((3, 1))
    body_kernels.panel_velocity(sphere.arrays, panel, point[:, None].copy(), 0.0, False, used)
    np.testing.assert_allclose(used[:, 0], exact, atol=2e-3 * np.linalg.norm(exact))


def test_normal_velocity_jumps_by_the_strength(sphere):
    corners, normal, center = sphere.arrays.corners[60], sphere.arrays.normal[60], sphere.arrays.center[:, 60]
    for side, expected in ((1e-7, 0.5), (0.0, 0.5), (-1e-7, -0.5)):
        v = body_kernels.near_velocity(corners, normal, *(center + side * normal))
        assert np.dot(v, normal) == pytest.approx(expected, abs=1e-5)


# ---- flows ----


def test_moving_body_is_a_body_in_a_stream(sphere):
    body = BodySet(sphere.bodies)
    assert not body.place([np.eye(3)], [[0, 0, 0]], [[0, 0, -2.0]])
    moving = body.strengths(uniform(body, [0, 0, 0]))
    np.testing.assert_allclose(moving, sphere.strengths(uniform(sphere, [0, 0, 2.0])), atol=1e-12)
    body.place([np.eye(3)], [[0, 0, 0]], [[0, 0, 0]], [[3.0, 0, 0]])
    # the ball of flat panels stirs the air only by its facets
    assert np.abs(body.strengths(uniform(body, [0, 0, 0]))).max() < 1e-9


def test_turned_body_in_a_turned_stream():
    c, s = np.cos(0.7), np.sin(0.7)
    turn, shift = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1.0]]), np.array([1.0, 2.0, 3.0])
    one = BodySet([ellipsoid_body((3.0, 1.0, 1.0), 10, 12)])
    stream, point = np.array([2.0, 0.5, 0.3]), np.array([[-2.0, 1.5, 0.6]])
    before = one.velocity(point, one.strengths(uniform(one, stream)))
    assert one.place([turn], [shift])
    after = one.velocity(point @ turn.T + shift, one.strengths(uniform(one, turn @ stream)))
    np.testing.assert_allclose(after, before @ turn.T, atol=1e-10)
    assert not one.place([turn], [shift])


def test_float32_targets(scene):
    rng = np.random.default_rng(3)
    s = scene.strengths(uniform(scene, [8.0, 0, 0]))
    points = rng.uniform((-40, -40, 1), (100, 40, 140), (500, 3))
    points[:100] = rng.uniform((-5, -5, 1), (-2.9, 5, 95), (100, 3))
    origin = np.array([3.0, 1.0, 80.0])
    targets = np.zeros((3, 512), dtype=np.float32)
    targets[:, :500] = (points - origin).T
    velocity = np.ones_like(targets)
    body_kernels.add_body_velocity(scene.arrays, s, targets, velocity, 500, origin, 0.0, True)
    np.testing.assert_allclose(velocity[:, :500].T - 1.0, scene.velocity(points, s), atol=8e-4)
    assert np.all(velocity[:, 500:] == 1.0)


# ---- coupling ----


def test_elimination_equals_the_full_problem(scene):
    """Rings and panels together: the flow at the blades is that of the panels that answer these very rings."""
    rng = np.random.default_rng(5)
    n_ring, n_point = 7, 23
    points = np.ascontiguousarray(rng.uniform((-8, -8, 20), (-4, 8, 85), (n_point, 3)).T)
    influence, wake_flow = rng.normal(size=(n_ring, 3, n_point)), rng.normal(size=(3, n_point))
    gamma = rng.normal(size=n_ring)
    work = scene.work(n_ring, n_point, (0, 0, 0), 0)
    work.ring_influence[:] = rng.normal(size=work.ring_influence.shape)
    work.wind[:] = [9.0, 1.0, 0.0]
    work.wake_flow[:] = rng.normal(size=work.wake_flow.shape)
    on_bodies = work.wind + work.wake_flow.T + np.einsum("r,rcp->pc", gamma, work.ring_influence)
    full = scene.strengths(on_bodies)
    expected = wake_flow + np.einsum("r,rcp->cp", gamma, influence) + scene.velocity(points.T, full).T
    body_kernels.couple_bodies(scene.arrays, work, points, 0.0, True, influence, wake_flow)
    np.testing.assert_allclose(wake_flow + np.einsum("r,rcp->cp", gamma, influence), expected, atol=1e-10)
    strengths = np.zeros(scene.n_panels)
    body_kernels.body_strengths(work, gamma, strengths)
    np.testing.assert_allclose(strengths, full, atol=1e-10)


ANGLES = -np.pi + 2 * np.pi * np.arange(360) / 360
FLAT = np.stack([2 * np.pi * np.sin(ANGLES), 0 * ANGLES, 0 * ANGLES], axis=-1)


def wing(bodies=None, **choices):
    """Rectangular wing of 1 m chord and 4 m span along y, its lift upwards in a wind along x."""
    options = AeroOptions(n_chord=2, n_span=8, wake_rows=30, full_rows=30, far_wake=False, viscous=False, **choices)
    span = np.linspace(0.0, 4.0, 9)
    axis = np.stack([0 * span, 0 * span, span], axis=-1)
    planform = build_planform(span, axis, 1 + 0 * span, 0 * span, 0.25 + 0 * span, np.tile(FLAT, (8, 1, 1)), 2)
    return VortexLattice(planform, 1, options, bodies=bodies)


def wing_nodes(lattice, height, incidence):
    """Blade axes x, y, z become up, downwind and across."""
    x, y, z = np.moveaxis(lattice.planform.nodes, -1, 0)
    c, s = np.cos(incidence), np.sin(incidence)
    return np.stack([c * y + s * x, 2.0 - z, c * x - s * y + height], axis=-1)[None]


def fly(lattice, steps, height=0.0):
    nodes, state = wing_nodes(lattice, height, np.radians(5.0)), lattice.new_state()
    wind = np.tile([10.0, 0, 0], (*nodes.shape[:3], 1))
    lattice.body_wind[:] = [10.0, 0, 0]
    lattice.reset(state, nodes, 0 * nodes, wind)
    for k in range(steps):
        lattice.convect_wake(state, UniformStream([10.0, 0.0, 0.0]), 0.05 * k, 0.05)
        lattice.solve(state, nodes, 0 * nodes, wind, 0.05)
        lattice.accept(state)
    return state


def test_distant_body_changes_nothing():
    ball = BodySet([ellipsoid_body((0.8, 0.8, 0.8), 8, 8, (0.0, 0.0, 400.0))])
    state, alone = fly(wing(ball), 5), fly(wing(), 5)
    np.testing.assert_allclose(state.circulation, alone.circulation, rtol=1e-5)
    np.testing.assert_allclose(state.wake_nodes, alone.wake_nodes, atol=1e-4)


def test_wing_over_a_body_feels_the_ground():
    """The wall of a wide box in place of the mirror image, without the box's own disturbance of the wind."""
    x = np.concatenate([[-8.0, -5, -3, -2], np.linspace(-1.25, 1.75, 7), [2.5, 3.5, 5.5, 8]])
    y = np.concatenate([[-9.0, -6, -4], np.linspace(-3, 3, 9), [4, 6, 9]])
    box = box_body([x, y, np.array([-6.0, -3, -1, 0])])
    lift = []
    for lattice in (wing(BodySet([box])), wing(ground_height=0.0), wing()):
        nodes, state = wing_nodes(lattice, 0.7, np.radians(5.0)), lattice.new_state()
        lattice.reset(state, nodes, 0 * nodes, np.tile([10.0, 0, 0], (*nodes.shape[:3], 1)))
        lift.append(state.circulation.copy())
    solid, image, free = lift
    assert np.abs(image / free - 1).max() > 0.05
    np.testing.assert_allclose(solid - free, image - free, atol=0.1 * np.abs(image - free).max())


# ---- refusals ----


def test_cube_is_accepted():
    body = BodySurface(CUBE, SIDES)
    assert body.volume == pytest.approx(1.0)
    assert body.area.sum() == pytest.approx(6.0)


def test_bad_surfaces_and_sets_are_refused():
    ball = ellipsoid_body((1.0, 1.0, 1.0), 6, 6)
    standing = tower_body([0, 20], [2, 2], (0, 0, 0), (0, 0, 20), 6, 4, ground=0.0)
    refuses(
        AerodynamicsError,
        ("inverted", lambda: BodySurface(CUBE, [*SIDES[:5], SIDES[5][::-1]])),
        ("inwards", lambda: BodySurface(CUBE, [q[::-1] for q in SIDES])),
        ("not closed", lambda: BodySurface(CUBE, SIDES[:5])),
        ("no area", lambda: BodySurface(CUBE * [1.0, 1.0, 0.0], SIDES)),
        ("not flat", lambda: BodySurface(CUBE + 0.5 * (CUBE.sum(axis=1) == 3)[:, None] * [1, 0, 0], SIDES)),
        ("finite", lambda: BodySurface(CUBE * np.nan, SIDES)),
        ("intersect", lambda: BodySet([ball, ellipsoid_body((1.0, 1.0, 1.0), 6, 6, (0.8, 0, 0), "other")])),
        ("below the ground", lambda: BodySet([ball], ground=0.0)),
        ("stands on a ground", lambda: BodySet([standing])),
        ("at least one", lambda: BodySet([])),
        ("increasing", lambda: revolution_body([0, 0], [1, 1], 6)),
        ("positive", lambda: tower_body([0, 20], [2, 0], (0, 0, 0), (0, 0, 20), 6, 4)),
        ("ground", lambda: wing(BodySet([ellipsoid_body((0.8, 0.8, 0.8), 8, 8, (0.0, 0.0, 4.0))], ground=0.0))),
    )


# ---- tower as a cylinder, wake ----


def test_tower_flow_is_the_doublet_of_the_local_diameter():
    rng = np.random.default_rng(2)
    base, top = np.array([1.0, -2.0, 3.0]), np.array([4.0, 1.0, 80.0])
    stations, diameters = np.array([0.0, 30.0, 75.0]), np.array([6.0, 5.0, 3.0])
    points, wind = rng.uniform(-20, 100, (5, 7, 3)), rng.normal(size=(5, 7, 3))
    height = np.linalg.norm(top - base)
    axis = (top - base) / height
    along = (points - base) @ axis
    radius = 0.5 * np.interp(along, stations, diameters)
    r = points - base - along[..., None] * axis
    r2 = (r**2).sum(-1)
    v = wind - (wind @ axis)[..., None] * axis
    fade = 0.5 * (1 + np.tanh(2 * np.minimum(along, height - along) / radius))
    doublet = v - 2 * ((v * r).sum(-1) / r2)[..., None] * r
    expected = wind + (fade * radius**2 / np.maximum(r2, radius**2))[..., None] * doublet
    TowerFlow(base, stations, diameters).add(points, wind, top)
    np.testing.assert_allclose(wind, expected, atol=1e-12)


def test_tower_flow_refuses():
    flow, points = TowerFlow((0, 0, 0), [0, 80], [6, 4]), np.zeros((4, 3))
    refuses(
        AerodynamicsError,
        ("positive", lambda: TowerFlow((0, 0, 0), [0, 80], [6, np.nan])),
        ("must be above its base", lambda: flow.add(points, points.copy(), np.zeros(3))),
        ("contiguous", lambda: flow.add(points, np.zeros((3, 4)).T, np.array([0, 0, 80.0]))),
    )


def test_wake_segments_near_the_tower_are_marked():
    rng = np.random.default_rng(4)
    base, top = np.array([0.5, 0, -1.0]), np.array([1.0, 0.5, 20.0])
    stations, radii, height = np.array([0.0, 21.0]), np.array([2.0, 1.0]), np.linalg.norm(top - base)
    wake = rng.uniform((-8, -8, -6), (8, 8, 28), (40, 2, 5, 3))
    flags = np.empty((40, 2, 5), dtype=np.int8)
    count = flag_wake_segments(wake, 39, base, top, stations, radii, 1.2, flags)
    u = np.linspace(0, 1, 4001)[:, None]
    axis = (top - base) / height

    def clearance(start, end):
        """Least distance over radii, and the distance beyond the ends there, of points on the segment."""
        arm = start + u * (end - start) - base
        along = arm @ axis
        radius = np.interp(along, stations, radii)
        ratio = np.linalg.norm(arm - along[:, None] * axis, axis=1) / radius
        inside = (along > -0.2 * radius) & (along < height + 0.2 * radius)
        return ratio[inside].min() if inside.any() else np.inf

    expected, unsure = np.zeros_like(flags), 0
    for k, b, j in np.ndindex(flags.shape):
        for bit, start in ((1, wake[k - 1, b, j]), (2, wake[k, b, j - 1])):
            if k >= 2 and (bit == 1 or j > 0):
                ratio = clearance(start, wake[k, b, j])
                unsure += abs(ratio - 1.2) < 0.05
                expected[k, b, j] += bit * (ratio < 1.2)
    # the taper moves the nearest point a little off the one nearest to the axis
    assert np.sum(flags != expected) <= unsure
    assert np.sum(expected > 0) > 30
    assert count == np.sum(flags & 1) + np.sum(flags >> 1)


# ---- forces ---------------------------------------------------------------------------------------------------------

DENSITY = 1.2
STILL = np.zeros(3)


@pytest.fixture(scope="module")
def fine_sphere():
    return BodySet([ellipsoid_body((1.0, 1.0, 1.0), 24, 24)])


def solved(bodies, flow, velocity=STILL):
    """Fluxes (n,) of a body in a flow (n, 3) that moves with a velocity, arms from the origin (n, 3)."""
    n = len(bodies.names)
    bodies.place(np.tile(np.eye(3), (n, 1, 1)), np.zeros((n, 3)), np.tile(velocity, (n, 1)))
    return bodies.strengths(flow) * bodies.area, bodies.control_points


@pytest.mark.parametrize(("stream", "velocity", "expected"), [(1.0, 0.0, 1.5), (0.0, 1.0, -0.5), (1.0, 1.0, 1.0)])
def test_impulse_of_a_sphere(fine_sphere, stream, velocity, expected):
    """F = dP/dt: 3/2 ρV dU/dt in a stream, −1/2 ρV du/dt of its own, ρV d/dt moving with the fluid (Lamb, art. 92)."""
    u = np.array([velocity, 0.0, 0.0])
    flux, arm = solved(fine_sphere, uniform(fine_sphere, (stream, 0.0, 0.0)), u)
    volume = 4.0 / 3.0 * np.pi
    momentum = impulse(flux, arm, volume, u, DENSITY)
    np.testing.assert_allclose(momentum, [expected * DENSITY * volume, 0.0, 0.0], atol=0.01 * DENSITY * volume)


@pytest.mark.parametrize("distance", [1.8, 3.0])
def test_a_source_attracts_a_sphere(fine_sphere, distance):
    """F = ρ m² a³ / (4 π d (d² − a²)²) towards the source (Milne-Thomson, Theoretical Hydrodynamics, 16.41)."""
    strength, place = 5.0, np.array([0.0, 0.0, distance])
    arm = fine_sphere.control_points - place
    flow = strength * arm / (4.0 * np.pi * np.linalg.norm(arm, axis=1)[:, None] ** 3)
    flux, _ = solved(fine_sphere, flow)
    force = convective_force(flux, flow, STILL, DENSITY)
    exact = DENSITY * strength**2 / (4.0 * np.pi * distance * (distance**2 - 1.0) ** 2)
    np.testing.assert_allclose(force, [0.0, 0.0, exact], atol=0.02 * exact)


def test_strip_of_a_long_cylinder():
    """At mid-height of a slender tower 2 ρ S dU/dt per length in an accelerating stream, −ρ S du/dt of its own."""
    radius, height, along = 1.0, 60.0, 60
    tower = tower_body([0.0, height], [2.0, 2.0], STILL, (0.0, 0.0, height), 24, along, ground=0.0)
    bodies = BodySet([tower], 0.0)
    middle = np.abs(bodies.arrays.center[2] - 20.5) < 0.5
    section = np.pi * radius**2 * height / along
    for stream, velocity, expected in ((1.0, 0.0, 2.0), (0.0, 1.0, -1.0)):
        u = np.array([velocity, 0.0, 0.0])
        flux, arm = solved(bodies, uniform(bodies, (stream, 0.0, 0.0)), u)
        momentum = impulse(flux[middle], arm[middle], section, u, DENSITY)
        assert momentum[0] == pytest.approx(expected * DENSITY * section, rel=0.02)


def test_a_bent_body_is_the_body_built_there():
    """Vertices that are shifted and turned as a whole give the panels, influences and axis of a body placed there."""
    ends = STILL, np.array([0.0, 0.0, 30.0])
    straight = tower_body([0.0, 30.0], [4.0, 2.0], *ends, 10, 6)
    one, two = BodySet([straight]), BodySet([straight])
    c, s = np.cos(0.1), np.sin(0.1)
    turn, shift = np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]]), np.array([1.0, -2.0, 3.0])
    one.place(turn[None], shift[None])
    two.bend(0, straight.vertices @ turn.T + shift)
    assert two.place(np.eye(3)[None], STILL[None])
    assert not two.place(np.eye(3)[None], STILL[None])
    for name in ("corners", "center", "normal", "far", "axis", "inverse"):
        np.testing.assert_allclose(getattr(two.arrays, name), getattr(one.arrays, name), atol=1e-9)
