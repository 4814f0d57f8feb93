"""Beams, modes and inertia integrals, cut beams, and bodies in nodal, modal and rigid coordinates."""

import numpy as np
import pytest
from scipy.linalg import eigh
from scipy.spatial.transform import Rotation

from envs_tests.physics.cases.tools import frequencies
from envs_tests.physics.refusals import refuses
from wt_gym.base.errors import TurbineDefinitionError
from wt_gym.base.quantities import GRAVITY
from wt_gym.multibody.system import Joint, MultibodySystem
from wt_gym.simulation import Fidelity
from wt_gym.simulation.turbine_structure import (
    add_sub_bodies,
    averaged_over_yaw,
    build_structure,
    rotor_nacelle_inertia,
)
from wt_gym.structure.beam import Beam, BeamSections, skew
from wt_gym.structure.flexible_body import (
    BodyInertia,
    FlexibleBody,
    offset_marker,
    particle_fields,
    without_second_order,
)
from wt_gym.structure.modes import (
    body_from_beam,
    circular_sections,
    clamped_modes,
    lowest_modes,
    select_modes,
    spin_stiffness,
)
from wt_gym.structure.substructure import cut_beam, sub_body_at, tip_and_interior_modes
from wt_gym.turbines import load_turbine
from wt_gym.turbines.blade import inertia_matrix

# ---- beams ----------------------------------------------------------------------------------------------------------

LENGTH = 12.0


def solve_static(beam, load):
    """Nodal displacements (n_dof,) of the beam clamped at its root under nodal loads (n_dof,)."""
    u = np.zeros(beam.n_dof)
    u[6:] = np.linalg.solve(beam.stiffness[6:, 6:], load[6:])
    return u


def uniform(n_elements=3, **changes):
    properties = {"EA": 3e8, "EIx": 5e6, "EIy": 2e6, "GJ": 1e6, "mass": 20.0, "Ix": 0.4, "Iy": 0.9} | changes
    return Beam(BeamSections.uniform(LENGTH, **properties), n_elements)


STIFF = np.diag([np.inf, np.inf, 1e9, 5e6, 2e6, 1e6])
SECTION = inertia_matrix(1.0, 0.0, 0.0, 0.1, 0.1, 0.0)


def prismatic(stiffness=STIFF, inertia=SECTION, station=(0.0, LENGTH), axis=None):
    """Tables of one section along the z axis, or along another axis (n, 3)."""
    n, s = len(station), np.asarray(station)
    axis = np.column_stack([0.0 * s, 0.0 * s, s]) if axis is None else axis
    return BeamSections(s, np.tile(stiffness, (n, 1, 1)), np.tile(inertia, (n, 1, 1)), axis)


def test_beams_without_meaning_are_refused():
    off_axis = np.diag([3.0, 3.0, 3.0, 0.4, 0.4, 0.8])  # without the moment of inertia that its center brings
    off_axis[5, 1] = off_axis[1, 5] = 3.0 * 0.5
    s = np.array([0.0, 1.0, 2.0])
    assert prismatic(station=s).axis_at([0.5, 2.0])[:, 2] == pytest.approx([0.5, 2.0])
    refuses(
        TurbineDefinitionError,
        ("ascending", lambda: prismatic(station=[0.0, 2.0, 1.0])),
        ("BeamSections.axis", lambda: prismatic(station=s, axis=np.zeros((2, 3)))),
        ("positive semidefinite", lambda: prismatic(inertia=-np.eye(6))),
    )
    refuses(
        ValueError,
        (r"section inertia at 0\.000 m is not positive", lambda: Beam(prismatic(inertia=off_axis), 1)),
        ("must not run against its z axis", lambda: Beam(prismatic(axis=np.array([[0, 0, 0], [0, 0, -LENGTH]])), 1)),
        ("at least two increasing arc lengths", lambda: Beam(uniform().sections, [0.0])),
        ("increasing arc lengths", lambda: Beam(uniform().sections, [0.0, 3.0, 3.0])),
        ("lie outside the section table", lambda: Beam(uniform().sections, [0.0, LENGTH + 0.1])),
        ("lie outside the section table", lambda: Beam(uniform().sections, [-0.1, LENGTH])),
    )


def test_bend_twist_coupling_of_a_full_section_matrix():
    """A tip torque on a section with K₄₅ bends the beam: κ_y = C₄₅ T, δ = κ L²/2."""
    k = np.diag([1e8, 1e8, 1e9, 5e6, 2e6, 1e6])
    k[4, 5] = k[5, 4] = 5e5
    beam = Beam(prismatic(k), 3)
    load = np.zeros(beam.n_dof)
    load[-1] = 1000.0
    curvature = np.linalg.inv(k)[4, 5] * 1000.0
    assert solve_static(beam, load)[-6] == pytest.approx(curvature * LENGTH**2 / 2, rel=1e-9)


def test_rigid_motions_strain_nothing_and_carry_the_right_mass():
    angle = np.linspace(0.0, 0.4, 9)
    s = 10.0 * angle
    axis = np.column_stack([-10.0 * (1.0 - np.cos(angle)), 0.0 * s, 10.0 * np.sin(angle)])
    beam = Beam(prismatic(inertia=inertia_matrix(3.0, 0.1, 0.2, 0.22, 0.33, 0.06), station=s, axis=axis), 6)
    rigid = np.concatenate([transport(p) for p in beam.node_position])
    assert np.abs(beam.stiffness @ rigid).max() < 1e-6 * np.abs(beam.stiffness).max()
    mass = rigid.T @ beam.mass @ rigid
    center = beam.particle_mass @ beam.particle_position / beam.particle_mass.sum()
    np.testing.assert_allclose(mass[:3, :3], 12.0 * np.eye(3), rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(mass[3:, :3], 12.0 * skew(center), atol=1e-8)


def test_mass_points_have_the_inertia_of_their_sections():
    """A rigid straight beam has ∫ Tᵀ I T ds, T = [[1, −(s z)~], [0, 1]], by quadrature that is exact for s²."""
    section = inertia_matrix(3.0, 0.1, 0.2, 0.22, 0.33, 0.09)
    beam = Beam(prismatic(inertia=section), 3, lumps=[(2, 7.0)])
    rigid = np.concatenate([transport(p) for p in beam.node_position])
    x, w = np.polynomial.legendre.leggauss(2)
    expected = transport([0.0, 0.0, 8.0]).T[:, :3] @ (7.0 * transport([0.0, 0.0, 8.0])[:3])
    for place, weight in zip(0.5 * LENGTH * (x + 1.0), 0.5 * LENGTH * w, strict=True):
        expected = expected + weight * transport([0.0, 0.0, place]).T @ section @ transport([0.0, 0.0, place])
    np.testing.assert_allclose(rigid.T @ beam.mass @ rigid, expected, rtol=1e-9, atol=1e-9)


def transport(place):
    """Velocities (6, 6) of a section at a place, per rigid velocity of the origin."""
    return np.block([[np.eye(3), -skew(place)], [np.zeros((3, 3)), np.eye(3)]])


def test_signs_and_order_of_the_shapes():
    """Every shape has its largest tip displacement, a turn over 0.1 m, positive."""
    modes = clamped_modes(uniform(12), 40)
    tip = modes.shape[-6:] * np.array([1.0, 1.0, 1.0, 10.0, 10.0, 10.0])[:, None]
    assert np.all(tip[np.abs(tip).argmax(axis=0), np.arange(tip.shape[1])] > 0.0)
    assert select_modes(modes, edge=1, flap=2) == [
        *select_modes(modes, edge=1), *[i for i, kind in enumerate(modes.kind) if kind == "flap"][:2],
    ]  # fmt: skip


@pytest.mark.parametrize(("spin", "axis"), [(1.3, [1.3, 0.0, 0.0]), ([0.4, -0.7, 0.9], [0.4, -0.7, 0.9])])
def test_centrifugal_stiffness_is_that_of_the_potential(bent, spin, axis):
    """The second derivative of −½ Σ m |ω × (r − c)|², in steps, by the displacements of second order."""
    beam, basis = bent
    fields, m, center, h = particle_fields(beam, basis), beam.particle_mass, np.array([0.5, 0.2, -3.0]), 0.1

    def potential(q):
        r = fields.position + fields.linear @ q + 0.5 * np.einsum("pijk,j,k->pi", fields.second, q, q)
        return -0.5 * np.sum(m[:, None] * np.cross(axis, r - center) ** 2)

    unit, expected = h * np.eye(4), np.zeros((4, 4))
    for j in range(4):
        for k in range(4):
            for a in (1, -1):
                for b in (1, -1):
                    # the terms of fourth order leave two steps, and their difference is exact
                    for step, share in ((1.0, 4.0 / 3.0), (2.0, -1.0 / 12.0)):
                        expected[j, k] += share * a * b * potential(step * (a * unit[j] + b * unit[k])) / (4.0 * h**2)
    omega = np.array(axis)
    found = basis.T @ spin_stiffness(beam, omega, center) @ basis
    np.testing.assert_allclose(found, expected, atol=1e-6 * np.abs(expected).max())
    spun = clamped_modes(beam, 3, spin=spin, center=center).frequency
    free = slice(6, None)
    stiffness = (beam.stiffness + spin_stiffness(beam, omega, center))[free, free]
    value = eigh(stiffness, beam.mass[free, free], eigvals_only=True)[:3]
    np.testing.assert_allclose(spun, np.sqrt(value) / (2.0 * np.pi), rtol=1e-9)


def test_modes_that_do_not_exist_are_refused():
    with pytest.raises(ValueError, match="torsion"):
        select_modes(clamped_modes(uniform(2), 3), torsion=5)


@pytest.fixture(scope="module")
def bent():
    """A beam with a point mass and its mass beside the axis, and four shapes with bending both ways and twist."""
    sections = BeamSections.uniform(LENGTH, EA=3e8, EIx=5e6, EIy=2e6, GJ=1e6, mass=20.0, Ix=0.4, Iy=0.9,
                                    offset=(0.1, 0.3))  # fmt: skip
    beam = Beam(sections, 3, lumps=[(2, 7.0)])
    loads = np.zeros((beam.n_dof, 4))
    loads[[-6, -5, -4, -1], range(4)] = 2e3, 3e3, 1e7, 2e4
    return beam, np.column_stack([solve_static(beam, load) for load in loads.T])


class TestInertiaIntegrals:
    """Integrals against direct sums over the displaced mass points, and foreshortening against beam theory."""

    def test_displaced_mass_points(self):
        beam = uniform(4, offset=(0.1, 0.3))
        basis = clamped_modes(beam, 3).shape
        fields = particle_fields(beam, basis)
        inertia = BodyInertia.from_particles(beam.particle_mass, fields)
        q = 1e-3 * np.array([0.5, -1.0, 0.7])
        x = fields.position + fields.linear @ q + 0.5 * np.einsum("pijk,j,k->pi", fields.second, q, q)
        m = beam.particle_mass
        first = inertia.c0 + inertia.c1 @ q + 0.5 * np.einsum("ijk,j,k->i", inertia.c2, q, q)
        np.testing.assert_allclose(first, m @ x, rtol=1e-12, atol=1e-9)
        tensor = -np.einsum("p,pij,pjk->ik", m, skew(x), skew(x))
        second = inertia.j0 + np.einsum("k,kij", q, inertia.j1) + 0.5 * np.einsum("k,l,klij", q, q, inertia.j2)
        np.testing.assert_allclose(second, tensor, atol=1e-6 * np.abs(q).max() * tensor.max())
        velocity = fields.linear + np.einsum("pijk,k->pij", fields.second, q)
        coupling = np.einsum("p,pij,pjk->ki", m, skew(x), velocity)
        np.testing.assert_allclose(
            inertia.d0 + np.einsum("kji,j->ki", inertia.d1, q), coupling, atol=1e-5 * np.abs(coupling).max()
        )

    def test_elastic_energy_and_spin_to_the_order_they_are_kept(self, bent):
        """M = Σ m Vᵀ V is exact with m2; Σ m r × V, V = S + H q, is even and odd in q: its cubic part cancels."""
        beam, basis = bent
        fields, m = particle_fields(beam, basis), beam.particle_mass
        kept = BodyInertia.from_particles(m, fields, complete=True)
        q = np.array([0.3, -0.2, 0.4, 0.1])

        def motion(q):
            place = fields.position + fields.linear @ q + 0.5 * np.einsum("pijk,j,k->pi", fields.second, q, q)
            velocity = fields.linear + fields.second @ q
            return place, velocity

        def spin(q):
            place, velocity = motion(q)
            return np.einsum("p,pij,pjk->ki", m, skew(place), velocity)

        velocity = motion(q)[1]
        mass = kept.m0 + kept.m1 @ q + np.einsum("kmlj,m,j->kl", kept.m2, q, q)
        np.testing.assert_allclose(mass, np.einsum("p,pik,pil->kl", m, velocity, velocity), rtol=1e-9, atol=1e-9)
        even = 0.5 * (spin(q) + spin(-q)) - spin(0.0 * q)
        np.testing.assert_allclose(np.einsum("kjli,j,l->ki", kept.d2, q, q), even, atol=1e-9 * np.abs(even).max())
        brief = BodyInertia.from_particles(m, fields)
        assert brief.d2.size == brief.m2.size == 0

    def test_second_order_shortcuts_are_those_of_every_mass_point(self, bent):
        beam, basis = bent
        fields, random = particle_fields(beam, basis), np.random.default_rng(0)
        q, force = random.normal(size=4), random.normal(size=(len(beam.particle_mass), 3))
        np.testing.assert_allclose(fields.second_along(q), fields.second @ q, atol=1e-12)
        np.testing.assert_allclose(
            fields.contract_second(force), np.einsum("pi,pijk->jk", force, fields.second), atol=1e-11
        )

    def test_mass_points_beside_the_axis_turn_with_their_section(self, bent):
        """The second derivative of exp(θ̃) d by q, in steps, for points at an offset d from the axis."""
        beam, basis = bent
        fields, h, unit = particle_fields(beam, basis), 1e-2, np.eye(4)
        for p in (0, 5, 17):
            theta, d = fields._rotation[fields._gauss[p]], fields._offset[p]
            expected = np.zeros((3, 4, 4))
            for j in range(4):
                for k in range(4):
                    corners = [
                        a * b * Rotation.from_rotvec(theta @ (h * (a * unit[j] + b * unit[k]))).apply(d)
                        for a in (1, -1) for b in (1, -1)
                    ]  # fmt: skip
                    expected[:, j, k] = sum(corners) / (4.0 * h**2)
            found = fields.second[p] - beam.second_order_field(basis).at_gauss()[fields._gauss[p]]
            np.testing.assert_allclose(found, expected, atol=1e-3 * np.abs(expected).max())

    def test_without_second_order_points_move_along_straight_lines(self, bent):
        beam, basis = bent
        whole = FlexibleBody.from_beam("blade", beam, basis, markers={"middle": 6.0})
        body, q = without_second_order(whole, beam, basis), np.array([0.3, -0.2, 0.4, 0.1])
        fields, m, kept = particle_fields(beam, basis), beam.particle_mass, body.inertia
        x = fields.position + fields.linear @ q
        np.testing.assert_allclose(kept.c0 + kept.c1 @ q, m @ x, rtol=1e-12, atol=1e-9)
        tensor = kept.j0 + np.einsum("k,kij", q, kept.j1) + 0.5 * np.einsum("k,l,klij", q, q, kept.j2)
        np.testing.assert_allclose(tensor, -np.einsum("p,pij,pjk->ik", m, skew(x), skew(x)), rtol=1e-9, atol=1e-6)
        spin = kept.d0 + np.einsum("kji,j->ki", kept.d1, q)
        np.testing.assert_allclose(spin, np.einsum("p,pij,pjk->ki", m, skew(x), fields.linear), rtol=1e-9, atol=1e-6)
        assert not kept.c2.any()
        assert not kept.m1.any()
        for key, marker in body.markers.items():
            assert not marker.second.any()
            assert whole.markers[key].second.any() == (key != "root")
            assert np.array_equal(marker.linear, whole.markers[key].linear)

    def test_foreshortening_along_the_beam_is_the_one_at_its_mass_points(self, bent):
        beam, basis = bent
        field = beam.second_order_field(basis)
        x = 0.5 * (np.polynomial.legendre.leggauss(4)[0] + 1.0)
        places = [a + xi * (b - a) for a, b in zip(beam.nodes, beam.nodes[1:], strict=False) for xi in x]
        at = field.at_gauss()
        for s, second in zip(places, at, strict=True):
            np.testing.assert_allclose(field.at(s), second, atol=1e-12 * np.abs(at).max())
        assert not field.at(0.0).any()

    def test_a_rigid_body_has_its_inertia_about_the_origin(self):
        """Steiner: I + m (|c|² 1 − c cᵀ)."""
        center, own = np.array([1.0, -2.0, 0.5]), np.diag([3.0, 4.0, 5.0])
        body = FlexibleBody.rigid("hub", 10.0, center, own, {"tip": [0.0, 0.0, 2.0]})
        expected = own + 10.0 * (center @ center * np.eye(3) - np.outer(center, center))
        np.testing.assert_allclose(body.inertia.j0, expected)
        assert body.inertia.c0.tolist() == [10.0, -20.0, 5.0]
        assert (body.n_elastic, body.markers["tip"].position.tolist()) == (0, [0.0, 0.0, 2.0])
        assert FlexibleBody.rigid("hub", 10.0, center, own).markers["origin"].position.tolist() == [0.0] * 3

    def test_an_offset_point_moves_with_its_section(self, bent):
        """By u + θ × d."""
        beam, basis = bent
        offset = np.array([0.3, -0.4, 0.1])
        marker = offset_marker(beam, basis, 7.3, offset)
        shift, turn = beam.linear_field(7.3, basis)
        np.testing.assert_allclose(marker.position, [0.3, -0.4, 7.4])
        np.testing.assert_allclose(marker.linear, shift + np.cross(turn.T, offset).T)
        np.testing.assert_array_equal(marker.rotation, turn)

    @pytest.mark.parametrize("angle", [0.0, 0.5], ids=["straight", "arc"])
    def test_second_order_displacement_of_bending_with_twist(self, angle):
        """The second derivative of ∫ exp(θ̃) t ds, in fine steps, by the amplitudes of three rotation fields θ(s).

        A straight beam under a moment and a torque, κ and τ, bends and twists as a helix does: its tip moves sideways
        by ∫ ½ θ_x θ_z ds = κ τ L³/6, and shortens by κ² L³/6.
        """
        beam = uniform(3)
        if angle:
            turned = np.linspace(0.0, angle, 13)
            axis = LENGTH / angle * np.column_stack([np.cos(turned) - 1.0, 0.0 * turned, np.sin(turned)])
            beam = Beam(prismatic(station=LENGTH / angle * turned, axis=axis), 6)
        loads = np.zeros((beam.n_dof, 3))
        loads[-3:] = np.diag([4e4, 3e4, 2e4])  # moments and a torque at the tip
        basis = np.column_stack([solve_static(beam, load) for load in loads.T])
        share = (np.arange(40) + 0.5) / 40
        middle = np.concatenate([a + (b - a) * share for a, b in zip(beam.nodes, beam.nodes[1:], strict=False)])
        rotation = np.array([beam.linear_field(s, basis)[1] for s in middle])
        parts = np.repeat(np.diff(beam.node_position, axis=0) / 40, 40, axis=0)  # of straight elements

        def tip(q):
            return Rotation.from_rotvec(rotation @ q).apply(parts).sum(axis=0)

        # the unit rotations are below 0.6 rad: a step of 1 % leaves 1e-5 of the fourth derivative
        h, unit = 1e-2, np.eye(3)
        expected = np.zeros((3, 3, 3))
        for j in range(3):
            for k in range(3):
                corners = [a * b * tip(h * (a * unit[j] + b * unit[k])) for a in (1, -1) for b in (1, -1)]
                expected[:, j, k] = sum(corners) / (4.0 * h**2)
        found = offset_marker(beam, basis, beam.nodes[-1], np.zeros(3)).second
        np.testing.assert_allclose(found, expected, atol=2e-4 * np.abs(expected).max())
        if not angle:
            kappa, tau = 4e4 / 5e6, 2e4 / 1e6
            assert found[0, 0, 2] == pytest.approx(kappa * tau * LENGTH**3 / 6, rel=1e-6)
            assert found[2, 0, 0] == pytest.approx(-(kappa**2) * LENGTH**3 / 3, rel=1e-6)

    def test_euler_buckling_of_a_body_under_its_tip_weight(self):
        """A massless column under a tip weight loses its stiffness at P = π²EI/4L²."""
        critical = np.pi**2 * 2e6 / (4 * LENGTH**2)
        beam = uniform(8, mass=1e-3, Ix=1e-6, Iy=1e-6, EIx=1e9)
        basis = clamped_modes(beam, 4, node_dofs=(0, 4)).shape
        signs = []
        for factor in (0.98, 1.02):
            system = MultibodySystem()
            tower = system.add(FlexibleBody.from_beam("tower", beam, basis), Joint("fixed"))
            top = FlexibleBody.rigid("top", factor * critical / GRAVITY, np.zeros(3), np.zeros((3, 3)))
            system.add(top, Joint("fixed"), tower, "tip")
            system.build()
            n, y = system.n_q, system.initial_state()
            columns = [system.rates(y + 1e-6 * unit)[n:] / 1e-6 for unit in np.eye(2 * n)[:n]]
            signs.append(np.linalg.eigvals(np.array(columns).T).real.max())
        assert signs[0] < 0 < signs[1], "restoring below the critical load, buckling above it"


class TestLowestModes:
    """The own eigenvalue solver against LAPACK's."""

    @pytest.mark.parametrize("n", [1, 2, 40])
    def test_of_random_matrices(self, n):
        random = np.random.default_rng(n)
        a, b = random.standard_normal((2, n, n))
        stiffness, mass = a + a.T, b @ b.T + np.eye(n)
        expected = eigh(stiffness, mass, eigvals_only=True)
        value, vector = lowest_modes(stiffness, mass, max(n - 1, 1))
        np.testing.assert_allclose(value, expected[: len(value)], atol=1e-12 * np.abs(expected).max())
        np.testing.assert_allclose(vector.T @ mass @ vector, np.eye(len(value)), atol=1e-12)
        np.testing.assert_allclose(stiffness @ vector, mass @ vector * value, atol=1e-11 * np.abs(expected).max())

    def test_matrices_without_meaning_are_refused(self):
        with pytest.raises(ValueError, match="not positive definite"):
            lowest_modes(np.eye(3), np.diag([1.0, 0.0, 1.0]), 1)
        with pytest.raises(ValueError, match="not finite"):
            lowest_modes(np.full((3, 3), np.nan), np.eye(3), 1)


class TestDamping:
    """A damping ratio belongs to the body alone; what it carries lowers it with the frequency."""

    RATIO = 0.02

    @staticmethod
    def ratios(body, added):
        """Frequencies [rad/s] and damping ratios of a body with an added mass matrix of its coordinates."""
        mass = body.inertia.m0 + added
        n = len(mass)
        lower = -np.linalg.solve(mass, np.hstack((body.stiffness, body.damping)))
        a = np.block([[np.zeros((n, n)), np.eye(n)], [lower]])
        roots = np.linalg.eigvals(a)
        roots = roots[roots.imag > 0.0]
        roots = roots[np.abs(roots).argsort()]
        return np.abs(roots), -roots.real / np.abs(roots)

    def test_nodes_are_damped_as_the_modes_are(self):
        """The tower of the 5-MW turbine under its rotor, in plane modes and in displacements of its nodes."""
        turbine, found = load_turbine("nrel_5mw"), []
        for kind in ("modal", "nodal"):
            fidelity = Fidelity(tower_coordinates=kind, tower_elements=8, tower_modes=(2, 0, 0))
            structure = build_structure(turbine, fidelity, np.zeros((1, 3)))
            tower, blade = (structure.system.bodies[i] for i in (structure.tower, structure.blades[0]))
            tip = np.vstack((tower.markers["tip"].linear, tower.markers["tip"].rotation))
            top = averaged_over_yaw(rotor_nacelle_inertia(turbine, blade.inertia))
            found.append(self.ratios(tower, tip.T @ top @ tip))
        (omega, ratio), (nodal_omega, nodal_ratio) = found
        np.testing.assert_allclose(nodal_omega[:2], omega, rtol=1e-6)
        np.testing.assert_allclose(nodal_ratio[:2], ratio, rtol=1e-6)
        assert ratio[0] == pytest.approx(0.01 * omega[0] / (2.0 * np.pi * 0.889), rel=0.04)


# ---- coordinates ----------------------------------------------------------------------------------------------------


class TestCoordinates:
    """One body in nodal, modal and rigid coordinates."""

    @staticmethod
    def beam():
        tube = circular_sections(
            2.0, 0.05, youngs_modulus=7e10, shear_modulus=2.7e10, density=2700.0, inner_diameter=0.04
        )
        return Beam(tube, 4)

    def test_rigid_body_keeps_mass_center_and_inertia(self):
        flexible, rigid = (body_from_beam("tube", self.beam(), kind) for kind in ("nodal", "rigid"))
        assert rigid.n_elastic == 0
        assert rigid.inertia.mass == pytest.approx(flexible.inertia.mass)
        assert rigid.inertia.mass == pytest.approx(2700.0 * 2.0 * np.pi / 4.0 * (0.05**2 - 0.04**2))
        np.testing.assert_allclose(rigid.inertia.c0, flexible.inertia.c0, atol=1e-12)
        np.testing.assert_allclose(rigid.inertia.j0, flexible.inertia.j0, atol=1e-12)
        np.testing.assert_allclose(rigid.markers["tip"].position, [0.0, 0.0, 2.0])

    def test_modal_stiffness_is_diagonal_and_damping_the_ratio(self):
        body = body_from_beam("tube", self.beam(), "modal", n_modes=5, damping_ratio=0.02)
        omega = np.sqrt(np.diag(body.stiffness))
        np.testing.assert_allclose(np.diag(body.damping), 2.0 * 0.02 * omega, rtol=1e-9)
        np.testing.assert_allclose(body.inertia.m0, np.eye(5), atol=1e-9)

    def test_every_mode_of_a_nodal_body_has_the_damping_ratio(self):
        body = body_from_beam("tube", self.beam(), "nodal", damping_ratio=0.02)
        squares, modes = eigh(body.stiffness, body.inertia.m0)
        damping = modes.T @ body.damping @ modes
        expected = np.diag(2.0 * 0.02 * np.sqrt(squares))
        np.testing.assert_allclose(damping, expected, atol=1e-6 * expected.max())

    def test_nodal_coordinates_are_the_nodes(self):
        body = body_from_beam("tube", self.beam(), "nodal", dofs=(0, 4))
        assert body.n_elastic == 8
        assert body.coordinate_names[:2] == ("tube_node_1_x", "tube_node_1_turn_y")
        np.testing.assert_allclose(body.markers["tip"].linear[0], [0, 0, 0, 0, 0, 0, 1, 0], atol=1e-12)

    def test_bad_input_is_refused(self):
        with pytest.raises(ValueError, match="must be one of nodal, modal, rigid"):
            body_from_beam("tube", self.beam(), "exact")
        with pytest.raises(ValueError, match="inner_diameter"):
            circular_sections(1.0, 0.1, youngs_modulus=1.0, shear_modulus=1.0, density=1.0, inner_diameter=0.2)


# ---- cut beams and references ---------------------------------------------------------------------------------------


class TestSubstructure:
    """A beam cut into bodies behaves as the whole for small motions, and bad cuts are refused."""

    @staticmethod
    def sections():
        return BeamSections.uniform(12.0, EA=3e8, EIx=5e6, EIy=2e6, GJ=1e6, mass=20.0, Ix=0.4, Iy=0.9)

    @pytest.mark.parametrize(("coordinates", "n_modes"), [("nodal", 0), ("modal", 100)])
    def test_small_vibrations_are_those_of_the_whole_beam(self, coordinates, n_modes):
        """The chain has the same degrees of freedom, so that its frequencies are those of the uncut matrices."""
        beam = Beam(self.sections(), 6)
        expected = np.sqrt(eigh(beam.stiffness[6:, 6:], beam.mass[6:, 6:], eigvals_only=True))
        sub_bodies = cut_beam("beam", self.sections(), 6, 3, coordinates, n_modes)
        system = MultibodySystem((0.0, 0.0, 0.0))
        add_sub_bodies(system, sub_bodies, lambda body: system.add(body, Joint("fixed")), "beam")
        found = frequencies(system.build(), system.initial_state(), step=1e-6)
        np.testing.assert_allclose(found[:12], expected[:12], rtol=1e-5)

    def test_given_cuts_and_owners(self):
        sub_bodies = cut_beam("beam", self.sections(), np.array([0.0, 1.0, 4.0, 6.0, 12.0]), [4.0, 6.0])
        assert [(p.start, p.end) for p in sub_bodies] == [(0.0, 4.0), (4.0, 6.0), (6.0, 12.0)]
        assert [sub_body_at(sub_bodies, s) for s in (0.0, 3.9, 4.0, 12.0)] == [0, 0, 1, 2]
        marker = sub_bodies[2].marker(9.0, (0.1, 0.0, 0.0))
        np.testing.assert_allclose(marker.position, [0.1, 0.0, 3.0])

    def test_static_shapes_of_the_tip_and_their_damping(self):
        """Between fixed ends, Hermite's cubics: a unit shift of the tip bends by 3 x² - 2 x³, a turn by L (x³ - x²)."""
        shapes = tip_and_interior_modes(Beam(self.sections(), 4), 0)
        x = np.array([0.25, 0.5, 0.75, 1.0])
        np.testing.assert_allclose(shapes[6::6, 0], 3.0 * x**2 - 2.0 * x**3)
        np.testing.assert_allclose(shapes[6::6, 4], 12.0 * (x**3 - x**2), atol=1e-12)
        np.testing.assert_allclose(shapes[-6:], np.eye(6))
        assert tip_and_interior_modes(Beam(self.sections(), 1), 3).shape == (12, 6)
        whole = tip_and_interior_modes(Beam(self.sections(), 4), 5)
        assert whole.shape == (30, 11)
        assert not whole[-6:, 6:].any()  # the rest vibrate between fixed ends
        damped = cut_beam("beam", self.sections(), 4, 2, stiffness_damping=0.1)[1].body
        np.testing.assert_allclose(damped.damping, 0.1 * damped.stiffness)

    @pytest.mark.parametrize(
        ("cut", "message"),
        [
            ((4, [5.0]), "not a node"), ((4, 5), "must have 1 … 4 sub-bodies"), ((4, [6.0, 3.0]), "must increase"),
            ((4, 2, "exact"), "'nodal' or 'modal'"),
        ],
    )  # fmt: skip
    def test_bad_cuts_are_refused(self, cut, message):
        with pytest.raises(ValueError, match=message):
            cut_beam("beam", self.sections(), *cut)

    def test_places_outside_are_refused(self):
        sub_bodies = cut_beam("beam", self.sections(), 4, 2)
        for use in (
            lambda: sub_body_at(sub_bodies, 13.0), lambda: sub_body_at(sub_bodies, -0.1),
            lambda: sub_bodies[1].marker(5.9), lambda: sub_bodies[0].marker(9.0),
        ):  # fmt: skip
            with pytest.raises(ValueError, match="outside"):
                use()
        assert sub_body_at(sub_bodies, 6.0 - 5e-10) == 1  # rounding of the cut belongs to the outer piece
