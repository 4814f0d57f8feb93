"""Force of the air on closed bodies, and bodies that move with the tower."""

import numpy as np
import pytest

from wt_gym.aerodynamics.bodies.body_set import BodySet, convective_force, ellipsoid_body, impulse, tower_body

DENSITY = 1.2
STILL = np.zeros(3)


@pytest.fixture(scope="module")
def sphere():
    return BodySet([ellipsoid_body((1.0, 1.0, 1.0), 24, 24)])


def solved(bodies, flow, velocity=STILL):
    """Fluxes (n,) of a body in a flow (n, 3) that moves with a velocity, arms from the origin (n, 3)."""
    n = len(bodies.names)
    bodies.place(np.tile(np.eye(3), (n, 1, 1)), np.zeros((n, 3)), np.tile(velocity, (n, 1)))
    return bodies.strengths(flow) * bodies.area, bodies.control_points


def uniform(bodies, stream):
    return np.tile(np.asarray(stream, dtype=float), (bodies.n_panels, 1))


def test_no_force_in_a_steady_stream(sphere):
    """D'Alembert's paradox."""
    stream = np.array([7.0, -3.0, 2.0])
    flux, _ = solved(sphere, uniform(sphere, stream))
    force = convective_force(flux, uniform(sphere, stream), STILL, DENSITY)
    assert np.linalg.norm(force) < 1e-9 * DENSITY * np.pi * stream @ stream


@pytest.mark.parametrize(("stream", "velocity", "expected"), [(1.0, 0.0, 1.5), (0.0, 1.0, -0.5), (1.0, 1.0, 1.0)])
def test_impulse_of_a_sphere(sphere, stream, velocity, expected):
    """F = dP/dt: 3/2 ρV dU/dt in a stream, −1/2 ρV du/dt of its own, ρV d/dt moving with the fluid (Lamb, art. 92)."""
    u = np.array([velocity, 0.0, 0.0])
    flux, arm = solved(sphere, uniform(sphere, (stream, 0.0, 0.0)), u)
    volume = 4.0 / 3.0 * np.pi
    momentum = impulse(flux, arm, volume, u, DENSITY)
    np.testing.assert_allclose(momentum, [expected * DENSITY * volume, 0.0, 0.0], atol=0.01 * DENSITY * volume)


@pytest.mark.parametrize("distance", [1.8, 3.0])
def test_a_source_attracts_a_sphere(sphere, distance):
    """F = ρ m² a³ / (4 π d (d² − a²)²) towards the source (Milne-Thomson, Theoretical Hydrodynamics, 16.41)."""
    strength, place = 5.0, np.array([0.0, 0.0, distance])
    arm = sphere.control_points - place
    flow = strength * arm / (4.0 * np.pi * np.linalg.norm(arm, axis=1)[:, None] ** 3)
    flux, _ = solved(sphere, flow)
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
