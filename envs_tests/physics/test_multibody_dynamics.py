"""Equations of motion against exact results: energy, momentum, pendulum, heavy top, rotating beams."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from wt_gym.base.constants import GRAVITY
from wt_gym.multibody.arrays import MultibodyError
from wt_gym.multibody.integrators.schemes import HammingIntegrator
from wt_gym.multibody.system import Joint, MultibodySystem
from wt_gym.multibody.tree import tree_kernels
from wt_gym.structure.beam import Beam, BeamSections, skew
from wt_gym.structure.flexible_body import FlexibleBody, particle_fields
from wt_gym.structure.modes import clamped_modes

LENGTH, EI, MASS = 10.0, 1.4e4, 1.2


def slender_beam(n_elements=8, factor=1.0):
    """Beam with clearly different flap and edge stiffness and an offset mass."""
    sections = BeamSections.uniform(
        LENGTH, EA=2.8e7, EIx=4 * factor * EI, EIy=factor * EI, GJ=2e3, mass=MASS, Ix=0.02, Iy=0.05, offset=(0.02, 0.05)
    )
    return Beam(sections, n_elements)


def modal_body(name="beam", n=4, n_elements=8, factor=1.0, complete=False):
    """Flexible body in its lowest clamped modes."""
    beam = slender_beam(n_elements, factor)
    return FlexibleBody.from_beam(name, beam, clamped_modes(beam, n).shape, complete=complete)


def chain(complete=False):
    """Tower, yawing nacelle, free-spinning shaft with torsion, two pitched blades, and a free ball on a blade tip."""
    system = MultibodySystem()
    tower = system.add(modal_body("tower", 4, factor=40.0), Joint("fixed"))
    nacelle = FlexibleBody.rigid("nacelle", 5.0, (0.3, 0.1, 0.5), np.diag([2.0, 3.0, 4.0]))
    nacelle = system.add(nacelle, Joint("revolute", (0.0, 0.0, 1.0), name="yaw", stiffness=50.0), tower, "tip")
    tilt = Rotation.from_euler("y", 0.1).as_matrix()
    shaft = FlexibleBody.rigid("shaft", 1.0, (-0.5, 0.0, 0.0), np.diag([0.5, 0.2, 0.2]))
    shaft = system.add(shaft, Joint("revolute", (1.0, 0.0, 0.0), tilt, (0.0, 0.0, 0.8), name="azimuth"), nacelle)
    hub = FlexibleBody.rigid("hub", 2.0, (0.1, 0.0, 0.0), np.diag([0.5, 0.3, 0.3]))
    torsion = Joint("revolute", (1.0, 0.0, 0.0), None, (-2.0, 0.0, 0.0), stiffness=400.0, name="torsion")
    hub = system.add(hub, torsion, shaft)
    for i in range(2):
        root = Rotation.from_euler("xy", [np.pi * i, -0.05]).as_matrix()
        joint = Joint("fixed", rotation=root @ Rotation.from_euler("z", -0.2).as_matrix(), offset=root @ [0, 0, 0.5])
        blade = system.add(modal_body(f"blade{i}", 4, factor=10.0, complete=complete), joint, hub)
    ball = FlexibleBody.rigid("ball", 0.5, (0.2, 0.1, 0.3), np.diag([0.2, 0.3, 0.4]))
    system.add(ball, Joint("spherical", name="ball"), blade, "tip")
    return system.build()


def started_chain(rng, complete=False):
    """Chain spinning with deflections of some percent of the length."""
    system = chain(complete)
    y = system.initial_state()
    for body in (0, 4, 5):
        first = system.index(body, "elastic_q")
        y[first : first + 4] = 0.1 * rng.standard_normal(4)
    y[system.n_q + system.index(1, "joint_u")] = 0.2
    y[system.n_q + system.index(2, "joint_u")] = 1.5
    y[system.n_q + system.index(6, "joint_u") + np.arange(3)] = [0.5, -1.0, 2.0]
    return system, y


def test_energy_is_conserved_without_loads_and_damping():
    system, y = started_chain(np.random.default_rng(1))
    integrator = HammingIntegrator(system, 0.0005)
    integrator.start(y)
    start = np.array(system.energy(y))
    exchanged = 0.0
    for _ in range(15):
        integrator.advance(2000)
        now = np.array(system.energy(integrator.state))
        exchanged = max(exchanged, abs(now[2] - start[2]))
        assert abs(now.sum() - start.sum()) < 3e-6 * start[0]
    assert exchanged > 0.05 * start[0], "the test must move energy between its forms"


@pytest.mark.parametrize("complete", [False, True])
def test_equations_of_motion_follow_from_the_energies(complete):
    """d/dt (kinetic + elastic + potential) vanishes for any state: no term of the inertia forces is missing."""
    rng = np.random.default_rng(2)
    system, _ = started_chain(rng, complete)
    for _ in range(5):
        y = system.initial_state()
        y[: system.n_q] += 0.15 * rng.standard_normal(system.n_q)
        y[system.n_q :] = rng.standard_normal(system.n_u)
        quaternion = slice(system.index(6, "joint_q"), system.index(6, "joint_q") + 4)
        y[quaternion] /= np.linalg.norm(y[quaternion])
        dy = system.rates(y)
        h = 1e-6
        change = (sum(system.energy(y + h * dy)) - sum(system.energy(y - h * dy))) / (2.0 * h)
        kinetic_power = np.abs(dy[system.n_q :] @ y[system.n_q :])
        assert abs(change) < 1e-6 * kinetic_power


@pytest.mark.parametrize("complete", [False, True])
def test_equations_of_motion_are_those_of_lagrange(complete):
    """d/dt ∂T/∂u = ∂(T − V)/∂q at any state, coordinate by coordinate: also of the terms that do no work."""
    system = MultibodySystem()
    tower = system.add(
        modal_body("tower", 3, 4, factor=4.0, complete=complete), Joint("revolute", (0.8, 0.6, 0.0), name="lean")
    )
    hub = FlexibleBody.rigid("hub", 2.0, (0.3, 0.1, 0.2), np.diag([0.5, 0.3, 0.4]))
    hub = system.add(hub, Joint("revolute", (0.6, 0.0, 0.8), offset=(0.1, 0.2, 0.4), name="turn"), tower, "tip")
    tilt = Rotation.from_euler("xy", [0.9, -0.3]).as_matrix()
    system.add(modal_body("blade", 3, 4, complete=complete), Joint("fixed", rotation=tilt, offset=(0.0, 0.5, 0.0)), hub)
    system.build()
    rng, n = np.random.default_rng(4), system.n_u
    y = np.concatenate([0.15 * rng.standard_normal(n), rng.standard_normal(n)])
    dy, unit, h = system.rates(y), np.eye(2 * n), 1e-4

    def momentum(state):
        return np.array([system.energy(state + e)[0] - system.energy(state - e)[0] for e in unit[n:]]) / 2.0

    def lagrangian(state):
        kinetic, elastic, potential = system.energy(state)
        return kinetic - elastic - potential

    change = (momentum(y + h * dy) - momentum(y - h * dy)) / (2.0 * h)
    slope = np.array([lagrangian(y + h * e) - lagrangian(y - h * e) for e in unit[:n]]) / (2.0 * h)
    np.testing.assert_allclose(change, slope, atol=1e-5 * np.abs(slope).max())


def test_free_body_keeps_momentum_and_falls():
    """A free flexible body gains momentum from gravity only and keeps its angular momentum about the mass center."""
    system = MultibodySystem()
    system.add(modal_body("beam", 4, complete=True), Joint("free", name="float"))
    system.build()
    rng = np.random.default_rng(3)
    y = system.initial_state()
    y[7:11] = 0.05 * rng.standard_normal(4)
    y[system.n_q : system.n_q + 6] = [1.0, 2.0, 3.0, 0.4, -0.6, 0.8]

    def momenta(state):
        inertia = system.bodies[0].inertia
        rot = Rotation.from_quat(state[[4, 5, 6, 3]]).as_matrix()
        q, v, w, qd = state[7:11], rot.T @ state[11:14], state[14:17], state[17:21]
        mc = inertia.c0 + inertia.c1 @ q + 0.5 * np.einsum("ijk,j,k->i", inertia.c2, q, q)
        tensor = inertia.j0 + np.einsum("k,kij->ij", q, inertia.j1)
        tensor = tensor + 0.5 * np.einsum("k,l,klij->ij", q, q, inertia.j2)
        c = inertia.c1 + inertia.c2 @ q
        d = inertia.d0 + np.einsum("kji,j->ki", inertia.d1, q) + np.einsum("kjli,j,l->ki", inertia.d2, q, q)
        p = inertia.mass * v + np.cross(w, mc) + c @ qd
        spin = np.cross(mc, v) + tensor @ w + d.T @ qd - np.cross(mc, p) / inertia.mass
        return rot @ p, rot @ spin

    integrator = HammingIntegrator(system, 0.0005)
    integrator.start(y)
    p0, l0 = momenta(y)
    integrator.advance(8000)
    p1, l1 = momenta(integrator.state)
    fall = system.bodies[0].inertia.mass * np.array([0.0, 0.0, -GRAVITY]) * 4.0
    np.testing.assert_allclose(p1, p0 + fall, atol=1e-6 * np.linalg.norm(p0))
    np.testing.assert_allclose(l1, l0, atol=1e-6 * np.linalg.norm(l0))


def test_mass_matrix_of_a_bent_and_twisted_blade_is_that_of_its_mass_points():
    """Rotation and deformation couple to third order, deformations among themselves exactly; 10 % bent."""
    beam = slender_beam()
    basis = clamped_modes(beam, 10).shape
    body, fields = FlexibleBody.from_beam("beam", beam, basis, complete=True), particle_fields(beam, basis)
    system = MultibodySystem()
    system.add(body, Joint("free", name="float"))
    work = system.build().new_work()
    bent = np.zeros(10)
    bent[:3] = np.linalg.lstsq(body.markers["tip"].linear[:, :3], [0.1 * LENGTH, 0.03 * LENGTH, 0.0], rcond=None)[0]
    bent[3:] = 0.02 * np.random.default_rng(5).standard_normal(7)

    def difference(q):
        y = system.initial_state()
        y[7:17] = q
        tree_kernels.kinematics(y, system.tree, work)
        tree_kernels.assemble(y, np.zeros((1, 16)), system.tree, work)
        mass = np.tril(work.mass) + np.tril(work.mass, -1).T
        place = fields.position + fields.linear @ q + 0.5 * np.einsum("pijk,j,k->pi", fields.second, q, q)
        points = np.concatenate(
            [np.broadcast_to(np.eye(3), (len(place), 3, 3)), -skew(place), fields.linear + fields.second @ q], axis=2
        )
        exact = np.einsum("p,pia,pib->ab", beam.particle_mass, points, points, optimize=True)
        assert np.linalg.eigvalsh(mass[6:, 6:])[0] > 0.0
        np.testing.assert_allclose(mass[6:, 6:], exact[6:, 6:], rtol=1e-9, atol=1e-9 * np.abs(exact[6:, 6:]).max())
        return np.abs(mass - exact)[3:6, 6:].max()

    assert difference(bent) / difference(0.5 * bent) == pytest.approx(8.0, rel=0.05)


def test_pendulum_period():
    """Released horizontally: T = 4 K(1/√2) √(L/g)."""
    system = MultibodySystem()
    bob = FlexibleBody.rigid("bob", 1.0, (0.0, 0.0, -1.0), np.zeros((3, 3)))
    system.add(bob, Joint("revolute", (0.0, 1.0, 0.0), name="swing"))
    system.build()
    y = system.initial_state()
    y[0] = np.pi / 2
    integrator = HammingIntegrator(system, 0.002)
    integrator.start(y)
    angle = []
    for _ in range(3000):
        integrator.advance()
        angle.append(integrator.state[0])
    angle = np.array(angle)
    down = np.flatnonzero((angle[:-1] > 0) & (angle[1:] <= 0))
    crossing = down + angle[down] / (angle[down] - angle[down + 1])
    assert np.diff(crossing)[0] * 0.002 == pytest.approx(4.0 * 1.8540746773013719 * np.sqrt(1.0 / GRAVITY), rel=1e-7)


def test_steady_precession_of_a_heavy_top():
    """A fast top at nutation angle θ precesses steadily at the root of A Ω² cos θ − C s Ω + m g l = 0."""
    mass, length, axial, transverse = 2.0, 0.5, 0.3, 0.8  # inertia about the fixed point
    spin, theta = 40.0, 0.4
    coefficients = [(transverse - axial) * np.cos(theta), -axial * spin, mass * GRAVITY * length]
    precession = np.roots(coefficients).min()
    about_center = np.diag([transverse - mass * length**2, transverse - mass * length**2, axial])
    system = MultibodySystem()
    system.add(FlexibleBody.rigid("top", mass, (0.0, 0.0, length), about_center), Joint("spherical"))
    system.build()
    y = system.initial_state()
    orientation = Rotation.from_euler("y", theta)
    y[:4] = orientation.as_quat()[[3, 0, 1, 2]]
    y[4:7] = orientation.inv().apply([0.0, 0.0, precession]) + np.array([0.0, 0.0, spin])
    integrator = HammingIntegrator(system, 0.0005)
    integrator.start(y)
    integrator.advance(4000)
    axis = Rotation.from_quat(integrator.state[[1, 2, 3, 0]]).apply([0.0, 0.0, 1.0])
    assert np.arccos(axis[2]) == pytest.approx(theta, abs=1e-6)
    assert np.arctan2(axis[1], axis[0]) == pytest.approx(precession * 2.0, abs=1e-5)


ROTATING = [  # η = Ω √(m L⁴/EI): flap 1, flap 2, lag 1 as ω √(m L⁴/EI); Wright et al. 1982, zero hub radius
    (0, 3.5160, 22.0345, 3.5160),
    (2, 4.1373, 22.6149, 3.6218),
    (6, 7.3604, 26.8091, 4.2632),
    (12, 13.1702, 37.6031, 5.4270),
]


@pytest.mark.parametrize(("eta", "flap_1", "flap_2", "lag_1"), ROTATING)
@pytest.mark.parametrize("coordinates", ["modal", "nodal"])
def test_rotating_cantilever_frequencies(eta, flap_1, flap_2, lag_1, coordinates):
    """Eigenvalues of the linearized equations of motion of a beam on a driven hub."""
    sections = BeamSections.uniform(LENGTH, EA=1e8, EIx=EI, EIy=EI, GJ=1e6, mass=MASS, Ix=1e-7, Iy=1e-7)
    beam = Beam(sections, 8 if coordinates == "nodal" else 12)
    if coordinates == "modal":
        basis = clamped_modes(beam, 12).shape
    else:
        # bending coordinates only: the second-order field already keeps the axis inextensible
        keep = [6 * node + k for node in range(1, 9) for k in (0, 1, 3, 4)]
        basis = np.eye(beam.n_dof)[:, keep]
    system = MultibodySystem(gravity=(0.0, 0.0, 0.0))
    body = FlexibleBody.from_beam("blade", beam, basis)
    joint = Joint("servo", (1.0, 0.0, 0.0), servo_frequency=1.0, servo_damping=0.0, name="hub")
    system.add(body, joint)
    system.build()
    n = body.n_elastic
    unit = np.sqrt(MASS * LENGTH**4 / EI)
    y = system.initial_state()
    y[-1] = eta / unit  # spin; the servo's angle is zero, so it does not accelerate
    jacobian = np.zeros((n, 2 * n))
    scale = 1e-4 / np.maximum(np.abs(basis).max(axis=0), 1e-3)
    base = system.rates(y)[n : 2 * n]
    assert np.abs(base).max() < 1e-6 * max(1.0, eta) * 10
    for k in range(2 * n):
        step = np.zeros(system.n_state)
        step[k] = scale[k % n]
        up, down = system.rates(y + step)[n : 2 * n], system.rates(y - step)[n : 2 * n]
        jacobian[:, k] = (up - down) / (2.0 * step[k])
    a = np.block([[np.zeros((n, n)), np.eye(n)], [jacobian]])
    frequency = np.sort(np.abs(np.linalg.eigvals(a).imag))[::2] * unit
    for expected in (flap_1, flap_2, lag_1):
        assert np.min(np.abs(frequency / expected - 1.0)) < 0.005


def test_singular_mass_matrix_is_named():
    system = MultibodySystem()
    system.add(FlexibleBody.rigid("nothing", 0.0, np.zeros(3), np.zeros((3, 3))), Joint("revolute", (1.0, 0.0, 0.0)))
    system.build()
    with pytest.raises(MultibodyError, match="mass matrix"):
        system.rates(system.initial_state())


def test_step_beyond_the_stability_limit_is_named():
    system = MultibodySystem()
    body = FlexibleBody.rigid("mass", 1.0, np.zeros(3), np.eye(3))
    system.add(body, Joint("prismatic", (1.0, 0.0, 0.0), stiffness=1.0, name="slide"))
    system.build()
    integrator = HammingIntegrator(system, 3.0)
    integrator.start(np.array([1.0, 0.0]), check=False)
    with pytest.raises(MultibodyError, match="stability limit"):
        integrator.advance(2000)


def test_divergence_that_spoils_the_mass_matrix_is_still_called_divergence():
    """A flexible body beyond the stability limit: its mass matrix turns indefinite long before numbers overflow."""
    system = MultibodySystem()
    system.add(modal_body("beam", 4), Joint("free"))
    system.build()
    y = system.initial_state()
    y[7:11] = 0.02
    integrator = HammingIntegrator(system, 0.05)
    integrator.start(y, check=False)
    with pytest.raises(MultibodyError, match="stability limit"):
        integrator.advance(20000)
