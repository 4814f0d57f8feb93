"""Induction kernels, far-wake cylinder and tower flow against closed forms."""

import numpy as np
import pytest
from scipy.special import ellipk

from wt_gym.aerodynamics import AerodynamicsError, AeroOptions, tower_perturbation
from wt_gym.aerodynamics.induction.induction_kernels import direct_induction
from wt_gym.aerodynamics.induction.simd_kernels import WIDTH
from wt_gym.aerodynamics.induction.tree_induction import RingWork
from wt_gym.aerodynamics.lattice import section_kernels
from wt_gym.aerodynamics.lattice.bound_kernels import bound_influence, invert
from wt_gym.aerodynamics.lattice.planform import SheddingEdge, bound_segments, separation_tables
from wt_gym.aerodynamics.lattice.section_kernels import decambering, section_state, settle_strips
from wt_gym.aerodynamics.lattice.separation_kernels import STATIC
from wt_gym.aerodynamics.state import AeroArrays
from wt_gym.aerodynamics.vortex_lattice import cylinder_table, ring_velocity
from wt_gym.aerodynamics.wake.far_wake_kernels import (
    ACTIVE,
    AXIS,
    LENGTH,
    LINE,
    N_CELL,
    N_FAR,
    N_TUBE,
    RADIUS,
    SHARE,
    at_own_radius,
    far_wake_velocity,
    share_of_cells,
    transport,
)
from wt_gym.aerodynamics.wake.wake_kernels import velocity_behind_disc


def segment_sum(starts, ends, strengths, points, core2=0.0):
    """Smooth-core Biot-Savart law in float64, (n_points, 3)."""
    r1, r2 = points[:, None] - starts, points[:, None] - ends
    a, b = np.linalg.norm(r1, axis=-1), np.linalg.norm(r2, axis=-1)
    soft = core2 * np.sum((ends - starts) ** 2, axis=-1)
    k = strengths / (4 * np.pi) * (a + b) / (a * b * (a * b + np.einsum("pni,pni->pn", r1, r2)) + soft)
    return np.einsum("pn,pni->pi", k, np.cross(r1, r2))


def run_kernel(sheet, points):
    n = len(points)
    padded = -(-n // WIDTH) * WIDTH
    targets = np.full((3, padded), 1e3, dtype=np.float32)
    targets[:, :n] = points.T
    velocity = np.zeros_like(targets)
    direct_induction(sheet, targets, velocity, 0, padded, np.zeros(8 * WIDTH * sheet.shape[2], dtype=np.float32))
    return velocity[:, :n].T


def line_sheet(line):
    """One polyline with unit circulation as a sheet of one column."""
    sheet = np.zeros((len(line), 1, 1, 7), dtype=np.float32)
    sheet[:, 0, 0, :3] = line
    sheet[1:, 0, 0, 3] = 1 / (4 * np.pi)
    sheet[..., 4] = sheet[..., 6] = 1e-12
    return sheet


@pytest.mark.parametrize("n", [1, 3, 4, 30, 97])
def test_blocked_inverse(n):
    matrix = np.random.default_rng(n).standard_normal((n, n))
    inverse = matrix.copy()
    invert(inverse, np.zeros(n, dtype=np.int64), np.zeros((n, 4)), np.zeros((4, n)))
    assert np.abs(inverse @ matrix - np.eye(n)).max() < 1e-12 * np.linalg.cond(matrix)


@pytest.mark.parametrize("n_point", [1, 16, 37])
@pytest.mark.parametrize(
    ("n_blade", "n_chord", "n_span", "ground", "wake", "tip"),
    [(3, 2, 4, False, True, False), (1, 1, 3, True, False, False), (2, 3, 2, True, True, True)],
)
def test_influence_of_the_bound_rings_is_that_of_their_segments(n_blade, n_chord, n_span, ground, wake, tip, n_point):
    """Also where a call before has left something in the work arrays, and corners of no wake are not numbers."""
    rng, per_blade = np.random.default_rng(n_point), n_chord * n_span
    options = AeroOptions(n_chord=n_chord, n_span=n_span, tip_wake=tip, wake_rows=5)
    edge = SheddingEdge.of(n_chord, n_span, np.ones(n_span + 1), options)
    segments, core = bound_segments(n_chord, n_span, np.linspace(1.0, 2.0, n_span + 1), edge, options, wake)
    corners = np.empty((1 + ground, n_blade, (n_chord + 1) * (n_span + 1) + len(edge.nodes), 3))
    corners[:] = rng.normal(scale=3.0, size=corners.shape[1:])
    if ground:
        corners[1, ..., 2] = -20.0 - corners[1, ..., 2]
    if not wake:
        corners[:, :, (n_chord + 1) * (n_span + 1) :] = np.nan
    points = rng.normal(scale=3.0, size=(3, n_point))
    influence = np.full((n_blade * per_blade, 3, n_point), 7.0)
    work = RingWork.empty(len(influence), corners.shape[2], n_point)
    for _ in range(2):
        bound_influence(corners, segments, core**2, len(segments), points, work, influence)
    expected = np.zeros_like(influence)
    for image, sign in zip(corners, (1.0, -1.0), strict=False):
        for b in range(n_blade):
            for (start, end, plus, minus), radius in zip(segments, core, strict=True):
                ends = image[b, start][None], image[b, end][None]
                velocity = sign * segment_sum(*ends, np.ones(1), points.T, radius**2).T
                if plus >= 0:
                    expected[b * per_blade + plus] += velocity
                if minus >= 0:
                    expected[b * per_blade + minus] -= velocity
    np.testing.assert_allclose(influence, expected, rtol=0.0, atol=1e-12 * np.abs(expected).max())


def test_straight_infinite_and_semi_infinite_vortex():
    points = np.array([[0.3, 0.4, 0.0], [2.0, 0.0, 0.0]])
    distance = np.array([0.5, 2.0])
    long = run_kernel(line_sheet(np.array([[0, 0, -4e3], [0, 0, -30.0], [0, 0, 30.0], [0, 0, 4e3]])), points)
    half = run_kernel(line_sheet(np.array([[0, 0, 0], [0, 0, 30.0], [0, 0, 4e3]])), points)
    np.testing.assert_allclose(np.linalg.norm(long, axis=1), 1 / (2 * np.pi * distance), rtol=2e-4)
    np.testing.assert_allclose(np.linalg.norm(half, axis=1), 1 / (4 * np.pi * distance), rtol=1e-3)
    assert long[1, 1] > 0  # right-handed about its direction


def test_ring_on_its_axis():
    angle = np.linspace(0, 2 * np.pi, 721)
    ring = np.stack([np.cos(angle), np.sin(angle), 0 * angle], -1)
    z = np.array([0.0, 0.5, 2.0])
    velocity = run_kernel(line_sheet(ring), np.stack([0 * z, 0 * z, z], -1))
    np.testing.assert_allclose(velocity[:, 2], 0.5 / (1 + z**2) ** 1.5, rtol=1e-4)
    np.testing.assert_allclose(ring_velocity(z, 0 * z, 0.0)[0], 0.5 / (1 + z**2) ** 1.5, rtol=1e-12)
    off = np.array([[0.6, 0.0, 0.4]])
    u, v = ring_velocity(np.array([0.4]), np.array([0.6]), 0.0)
    np.testing.assert_allclose(run_kernel(line_sheet(ring), off)[0, [2, 0]], [u[0], v[0]], rtol=1e-4)


def far_wake(*radii):
    """Cylinders about z from the origin on, measured on rows one meter long, without strength yet."""
    # not a type of this module: what the kernels were compiled for is remembered in their cache by name
    wake = AeroArrays(**dict.fromkeys(AeroArrays._fields, np.zeros(1)))._replace(
        far=np.zeros(N_FAR), far_tube=np.zeros((N_TUBE, len(radii))), far_ring=np.zeros((N_CELL, len(radii)))
    )
    wake.far[[ACTIVE, AXIS + 2]] = 1.0
    wake.far[SHARE:] = 1.0
    wake.far_tube[RADIUS], wake.far_tube[LENGTH] = radii, 1.0
    return wake


def cylinder(points, ring=1.0, line=0.0, radius=1.0):
    wake = far_wake(radius)
    wake.far_ring[:] = ring
    wake.far_tube[LINE] = line * (1.0 + 0.05**2 * radius**2)
    return velocity_of(wake, points)


def velocity_of(wake, points):
    targets, velocity = np.ascontiguousarray(points.T, dtype=np.float32), np.zeros((3, len(points)), dtype=np.float32)
    far_wake_velocity(wake, cylinder_table(), targets, velocity, np.zeros((8, len(points)), np.float32))
    return velocity.T


def test_cells_behind_the_first_act_as_the_changes_of_all_their_cylinders():
    """A strong tip and a root of the opposite sign, against every cylinder of every cell."""
    radii, strength = np.array([8.0, 40.0, 52.0, 60.0]), np.array([-0.8, 0.1, 0.3, 1.0])
    wake = far_wake(*radii)
    growth = 1.0 + 0.08 * np.arange(N_CELL)[:, None]
    wake.far_ring[:] = growth * strength
    radius, angle = np.meshgrid([5.0, 30.0, 45.0, 55.0, 65.0], np.linspace(0.0, 6.0, 5))
    across = np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=-1).reshape(-1, 2)
    lengths = 0.5 * 60.0 * 1.4 ** np.arange(N_CELL)
    starts = np.concatenate([[0.0], np.cumsum(lengths)[:-1]])
    changes = np.diff(growth * strength, axis=0, prepend=0.0)
    for z, tolerance in ((-400.0, 1e-4), (-20.0, 2e-3), (0.0, 3e-3)):
        points = np.column_stack([across, np.full(len(across), z)])
        exact = 0.0
        for start, change in zip(starts, changes, strict=True):
            for ring, size in zip(change, radii, strict=True):
                exact = exact + ring * cylinder((points - [0.0, 0.0, start]) / size)
        found = velocity_of(wake, points)
        np.testing.assert_allclose(found, exact, atol=tolerance)


def test_speed_of_a_cylinder_at_its_own_radius():
    """Half of 1/2 + z k K(k) / (2 pi R), k^2 = 4 R^2 / (4 R^2 + z^2); the mean of the two sides of the table."""
    z = np.array([-5.0, -1.0, -0.3, -1e-3, 0.3, 1.0, 5.0])
    k2 = 4.0 / (4.0 + z**2)
    exact = 0.5 * (0.5 + z * np.sqrt(k2) * ellipk(k2) / (2.0 * np.pi))
    np.testing.assert_allclose([at_own_radius(d) for d in z], exact, rtol=1e-6)
    inside, outside = (cylinder(np.stack([r + 0 * z, 0 * z, z], -1))[:, 2] for r in (0.8, 1.2))
    np.testing.assert_allclose(0.5 * (inside + outside), exact, atol=0.02)


class TestTransport:
    """A cylinder of radius 1 m behind rows that pass at 1 m/s, three radii behind the rotor."""

    way, duration = 3.0, 1.0

    def march(self, wake, flux, steps, dt, speed=1.0, wander2=0.0):
        for _ in range(steps):
            transport(wake, np.array([flux]), 1.0, self.way, 1.0, self.duration, speed, 1e-9, wander2, dt)
        return wake.far_ring[:, 0]

    def test_weak_cylinders_keep_flux_and_speed(self):
        ring = self.march(far_wake(1.0), 1e-4, 50, -1.0)
        np.testing.assert_allclose(ring, 1e-4, rtol=1e-3)

    def test_a_step_arrives_after_the_way_to_the_cell(self):
        """Cells end at 0.5, 1.2, 2.18, ... m: nothing overshoots, and behind them is less than in front."""
        wake = far_wake(1.0)
        ring = self.march(wake, 1e-4, 12, 0.05)
        assert np.all(np.diff(ring) < 0.0)
        assert ring[0] > 0.6e-4
        assert ring[3] < 0.1e-4
        np.testing.assert_allclose(self.march(wake, 1e-4, 2000, 0.05), 1e-4, rtol=1e-3)

    def test_circulation_is_conserved(self):
        """What enters is in the cells as long as nothing has passed the last one."""
        wake = far_wake(1.0)
        lengths = 0.5 * 1.4 ** np.arange(N_CELL)
        ring = self.march(wake, 1e-4, 10, 0.01)
        assert ring @ lengths == pytest.approx(1e-4 * 0.1, rel=1e-3)

    def test_steady_strengths_obey_the_flux_of_an_ideal_wake(self):
        """Far behind: g c = F with c = V - g / 2, over the same where the rows are: the wake of momentum theory."""
        strength = 0.5
        here = 1.0 - strength * at_own_radius(self.way)
        flux = -strength * here
        wake = far_wake(1.0)
        wake.far_tube[LENGTH] = here * self.duration
        far = -self.march(wake, flux, 60, -1.0, here)[-1]
        assert far * (1.0 - 0.5 * far) == pytest.approx(-flux, rel=0.02)
        assert far > strength

    def test_mixing_lets_it_go_with_the_wind(self):
        calm, mixed = (self.march(far_wake(1.0), -0.3, 60, -1.0, wander2=w)[-1] for w in (0.0, 6.25))
        assert abs(mixed) < 0.95 * abs(calm)


class TestShareOfCells:
    """How much of a cell acts whose rings have wandered."""

    def shares(self, wander2, way=2.0):
        wake = far_wake(1.0)
        share_of_cells(wake, way, 1.0, wander2)
        return wake.far[SHARE:]

    def test_orderly_wakes_act_whole(self):
        np.testing.assert_array_equal(self.shares(0.0), 1.0)

    @pytest.mark.parametrize("wander", [0.05, 0.1, 0.15])
    def test_a_widened_ring_off_the_axis(self, wander):
        """Lamb's ring at the middle of a cell, of the same impulse, wider by s^2 in R^2 and s off the axis."""
        ends = 2.0 + np.concatenate([[0.0], np.cumsum(0.5 * 1.4 ** np.arange(N_CELL))])
        z = 0.5 * (ends[1:] + ends[:-1])
        spread = wander * z
        radius = np.sqrt(1.0 + spread**2)
        widened = ring_velocity(-z / radius, spread / radius, 0.0)[0] / radius**3
        orderly = ring_velocity(-z, 0.0 * z, 0.0)[0]
        np.testing.assert_allclose(self.shares(wander**2), widened / orderly, rtol=0.012)


def test_vortex_cylinder_on_its_axis_and_far_away():
    z = np.array([-20.0, -6.0, -2.0, -0.5, 0.0, 0.5, 3.0])
    axis = cylinder(np.stack([0 * z, 0 * z, 2 * z], -1), radius=2.0)[:, 2]
    np.testing.assert_allclose(axis, 0.5 * (1 + z / np.sqrt(1 + z**2)), atol=3e-3)  # the core takes 0.25 %
    far = cylinder(np.array([[6.0, 0.0, -8.0]]))[0]
    np.testing.assert_allclose(far, -0.25 * np.array([6.0, 0, -8.0]) / 1000.0, atol=5e-5)  # a sink of strength pi


def test_vortex_cylinder_is_the_sum_of_its_rings():
    points = np.array([[0.5, 0.0, -0.7], [0.0, 0.8, 0.3], [1.5, 0.0, 0.4], [0.0, 2.5, -1.0]])
    edges = np.concatenate([np.linspace(0, 4, 1001), np.geomspace(4.02, 2000, 500)])
    middle, width = 0.5 * (edges[1:] + edges[:-1]), np.diff(edges)
    r = np.hypot(points[:, 0], points[:, 1])
    u, v = ring_velocity(points[:, 2:] - middle, r[:, None], 0.05)
    velocity = cylinder(points)
    np.testing.assert_allclose(velocity[:, 2], u @ width, atol=3e-3)
    np.testing.assert_allclose(np.einsum("pi,pi->p", velocity[:, :2], points[:, :2]) / r, v @ width, atol=3e-3)


def test_axial_lines_turn_the_flow_outside_only():
    velocity = cylinder(np.array([[0.2, 0.0, 30.0], [4.0, 0.0, 60.0]]), ring=0.0, line=5.0)
    np.testing.assert_allclose(velocity[1, 1], 5.0 / (2 * np.pi * 4.0), rtol=2e-3)
    assert abs(velocity[0, 1]) < 1e-3


def test_tower_flow_vanishes_into_stagnation_and_doubles_beside():
    points = np.array([[-3.0, 0, 50], [0, 3.0, 50], [-30.0, 0, 50], [-3.0, 0, 200]])
    wind = np.tile([10.0, 0, 0], (4, 1))
    velocity = tower_perturbation(points, wind, (0, 0, 0), (0, 0, 80), [0, 80], [6.0, 6.0])
    np.testing.assert_allclose(velocity[:, 0], [-10, 10, -0.1, 0], atol=1e-9)
    with pytest.raises(AerodynamicsError, match="positive"):
        tower_perturbation(points, wind, (0, 0, 0), (0, 0, 80), [0, 80], [6.0, 0.0])


def stalling_polar(n=720, width=2.0):
    """Lift 2 pi sin(alpha) in attached flow, a plate's beyond 20 degrees: (n, 3) from -pi to pi."""
    alpha = np.linspace(-np.pi, np.pi, n, endpoint=False)
    attached = 1.0 / (1.0 + np.exp((np.abs(np.degrees(alpha)) - 20.0) / width))
    cl = attached * 2 * np.pi * np.sin(alpha) + (1 - attached) * np.sin(2 * alpha)
    return np.column_stack([cl, 0.01 + np.sin(alpha) ** 2, 0.0 * alpha])


@pytest.mark.parametrize("point", [STATIC, 0.0, 0.4, 1.0])
@pytest.mark.parametrize("along", [60.0, 3.0, -8.0])
@pytest.mark.parametrize("across", [-12.0, 0.7, 9.0])
def test_rates_of_the_section_are_those_of_differences(along, across, point):
    """Decambering velocity and speed by central differences over the normal velocity."""
    table = separation_tables([stalling_polar()])[0]
    fixed = along, np.array([np.cos(0.3), np.sin(0.3)]), stalling_polar(), 0.05, 3.0, 8.0, table, point
    step = 1e-5
    low, high = (section_state(across + sign * step, *fixed) for sign in (-1, 1))
    _, _, _, wanted_rate, speed_rate = section_state(across, *fixed)
    assert wanted_rate == pytest.approx((high[2] - low[2]) / (2 * step), rel=2e-3, abs=2e-3)
    assert speed_rate == pytest.approx((high[1] - low[1]) / (2 * step), abs=1e-8)


@pytest.mark.parametrize("first", [True, False])
def test_decambering_converges_quadratically_within_a_blade(first):
    """One blade, whose coupling Newton's method knows: the residual falls with its square, thick root sections too."""

    class Planform:
        chord, kappa = np.array([3.0, 4.0, 2.5]), np.array([3.0, 4.0, 2.5]) * 2.8
        tilt = np.column_stack([np.cos([0.4, 0.1, 0.0]), np.sin([0.4, 0.1, 0.0])])
        polars, alpha0 = np.array([stalling_polar()] * 3), np.array([0.3, 0.05, -0.02])
        separation = np.zeros((3, 0, 4))

    response = -np.array([[6.0, 0.8, 0.2], [0.8, 8.0, 0.8], [0.2, 0.8, 5.0]])
    potential, along = np.array([60.0, 110.0, 90.0]), np.array([20.0, 45.0, 70.0])
    residuals = []
    for iterations in range(5):
        source = np.zeros(3)
        residuals.append(
            decambering.py_func(potential, along, response, np.array([0.2, 0.05, 0.0]), first, 0.1, 1.5, Planform, 1,
                                0.0, iterations, np.full(3, STATIC), np.zeros((3, 3)), np.zeros(3), np.zeros(3),
                                np.zeros(3), source)
        )  # fmt: skip
    assert residuals[0] > 0.3
    assert residuals[2] < 3e-3 * residuals[0]
    assert residuals[4] < 1e-9


def test_strips_between_two_solutions_are_solved_alone(monkeypatch):
    """Behind a steep stall: the strips end at a solution each, in the direction of the residual, others stay."""
    monkeypatch.setattr(section_kernels, "strip_residual", section_kernels.strip_residual.py_func)

    class Planform:
        chord, kappa, alpha0 = np.full(3, 4.0), np.full(3, 11.2), np.zeros(3)
        tilt = np.column_stack([np.ones(3), np.zeros(3)])
        polars = np.array([stalling_polar(width=0.1)] * 3)
        separation = np.zeros((3, 0, 4))

    response = -np.diag([8.0, 8.0, 6.0])
    potential, along, previous = np.array([150.0, 135.0, 0.0]), np.array([28.0, 45.0, 70.0]), np.array([0.0, 0.2, 0.0])
    given = potential, along, response, previous, 0.1, 0.6, Planform, np.full(3, STATIC)

    def residual(k, source):
        return section_kernels.strip_residual(k, source[k], *given, source)

    source = np.array([0.0, 12.0, 0.0])
    before = [residual(k, source) for k in range(3)]
    settled = source.copy()
    settle_strips.py_func(*given, np.array([30.0, 47.0, 70.0]), settled)
    assert before[0] > 1.0 > -1.0 > before[1]
    assert settled[0] > source[0]
    assert settled[1] < source[1]
    assert abs(before[2]) < 1e-4 * 70.0
    assert settled[2] == source[2]
    np.testing.assert_allclose([residual(k, settled) for k in range(2)], 0.0, atol=1e-6)


def test_velocity_behind_the_disc_is_a_mean_over_area_and_one_passing():
    """Two blades of a rotor about x: induced velocity a + b r, older rows than a passing count for nothing."""
    radii, spin = np.array([1.0, 2.0, 4.0]), 2.0
    passing = np.pi / spin
    age = np.array([0.0, 0.5 * passing, passing, 2.0 * passing])
    wake = np.zeros((4, 2, 3, 3))
    wake[:, 0, :, 2], wake[:, 1, :, 2] = radii, -radii
    wake += [5.0, 0.0, 90.0]
    induced = np.zeros_like(wake, dtype=np.float32)
    induced[..., 0], induced[..., 2] = -(1.0 + 0.5 * radii), 0.25
    induced[3] = 100.0
    mean, center, axis = np.full(3, 7.0), np.array([5.0, 0.0, 90.0]), np.array([1.0, 0.0, 0.0])
    velocity_behind_disc(wake, induced, age, np.array([3]), center, axis, -spin, mean)
    expected = -(1.0 + 0.5 * (1.5 * 3.0 + 3.0 * 12.0) / 15.0)  # trapezoids over the rings 1..2 and 2..4
    np.testing.assert_allclose(mean, [expected, 0.0, 0.25], rtol=1e-6)
    velocity_behind_disc(wake, induced, age, np.array([0]), center, axis, spin, mean)
    np.testing.assert_array_equal(mean, 0.0)
