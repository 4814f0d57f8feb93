"""Local observer frames against exact results, the floating-frame tree and the published example."""

from operator import methodcaller

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from envs_tests.physics.cases import rotating_beams
from envs_tests.physics.refusals import refuses
from wt_gym.base.quantities import GRAVITY
from wt_gym.multibody.integrators.schemes import HammingIntegrator
from wt_gym.multibody.observer_frame import observer_frame_matrix_kernels as matrix
from wt_gym.multibody.observer_frame.frame import ObserverFrameSystem
from wt_gym.multibody.observer_frame.observer_frame_body import (
    DISPLACEMENTS,
    REFERENCE_CONDITIONS,
    ObserverFrameError,
    Substructure,
)
from wt_gym.multibody.observer_frame.observer_frame_from_system import observer_frame_from_system
from wt_gym.multibody.observer_frame.observer_frame_integrator import ObserverFrameIntegrator
from wt_gym.multibody.system import Constraint, Joint, MultibodySystem
from wt_gym.structure.beam import Beam, BeamSections, skew
from wt_gym.structure.flexible_body import FlexibleBody, without_second_order
from wt_gym.structure.modes import clamped_modes

LENGTH, EI, MASS = 10.0, 1.4e4, 1.2
CLAMPED = methodcaller("clamp", "beam", "root")
HORIZONTAL = Rotation.from_euler("y", 90, degrees=True).as_matrix()


def slender_beam(factor=1.0, **changes):
    """Beam with different stiffness in its planes and an offset mass."""
    section = {"EA": 2.8e6, "EIx": 4 * factor * EI, "EIy": factor * EI, "GJ": 2e3, "mass": MASS, "Ix": 0.02, "Iy": 0.05}
    return Beam(BeamSections.uniform(LENGTH, **(section | {"offset": (0.02, 0.05)} | changes)), 4)


def integrator(body, step=0.002, *, gravity=(0.0, 0.0, 0.0), hold=None, load=None, options=None, **place):
    """One body, optionally held by the function ``hold(system)`` and loaded at its tip by (value, axes)."""
    options = options or {}
    system = ObserverFrameSystem(gravity, **{k: options.pop(k) for k in ("rigid_modes",) if k in options})
    system.add(body, **place)
    if hold:
        hold(system)
    if load:
        system.load(body.name, "tip", *load)
    return ObserverFrameIntegrator(system, step, **options)


@pytest.mark.parametrize("reference", REFERENCE_CONDITIONS)
def test_elastic_shapes_comply_with_their_reference_condition(reference):
    body = Substructure.from_beam("beam", slender_beam(), reference, 5)
    root = body.marker_shape("root")[:, :5]
    support = {"clamped": 0.0, "simply_supported": LENGTH, "three_quarter": 7.5}[reference]
    element, xi = body.beam.locate(support)
    there = (body.beam.shape(element, xi)[0] @ body.basis[6 * element : 6 * element + 12])[:, :5]
    held = root if reference == "clamped" else np.vstack([root[:3], root[5:], there[:2]])
    assert np.abs(held).max() < 1e-9 * np.abs(body.basis[:, :5]).max()
    np.testing.assert_allclose(body.mass_matrix[:5, :5], np.eye(5), atol=1e-8)


def test_simply_supported_frequencies():
    """n² π² √(EI/m L⁴) for the lower plane of bending."""
    beam = Beam(BeamSections.uniform(LENGTH, EA=1e8, EIx=4e6, EIy=EI, GJ=1e6, mass=MASS, Ix=1e-4, Iy=1e-4), 10)
    body = Substructure.from_beam("beam", beam, "simply_supported", 3)
    expected = (np.pi * np.arange(1, 4)) ** 2 * np.sqrt(EI / (MASS * LENGTH**4))
    np.testing.assert_allclose(body.frequency, expected, rtol=1e-3)


@pytest.mark.parametrize("n_modes", [3, None])
def test_matrices_are_the_inertia_of_the_mass_points(n_modes):
    """M q̈ + 2 G q̇ + (Ġ + D) q + M₀ᵀ a_c + J̇₀ᵀ − J₂ᵀ = Σ m Nᵀ a for any motion of the frame."""
    rng = np.random.default_rng(1)
    body = Substructure.from_beam("beam", slender_beam(), "clamped", n_modes)
    run = integrator(body, options={"rigid_modes": "undeformed"})
    q, v, a = 0.1 * rng.standard_normal((3, body.n))
    center, omega, alpha = rng.standard_normal((3, 3))
    run.state.acceleration[0], run.state.omega[0], run.state.alpha[0] = center, omega, alpha
    forces = np.zeros(body.n)
    matrix.inner_forces(0, run.model, run.state, q, v, forces)
    obtained = body.mass_matrix @ a - forces - body.stiffness @ q
    shape = np.einsum("pia,an->pin", body.beam.particle_shape, body.basis)
    x, w = body.beam.particle_position + shape @ q, skew(omega)
    point = center + x @ (skew(alpha) + w @ w).T + 2.0 * (shape @ v) @ w.T + shape @ a
    expected = np.einsum("p,pin,pi->n", body.beam.particle_mass, shape, point)
    np.testing.assert_allclose(obtained, expected, atol=1e-9 * np.abs(expected).max() + 1e-12 * np.abs(forces).max())
    squares = np.array([*(omega * omega - omega @ omega), *(omega[[0, 0, 1]] * omega[[1, 2, 2]])])
    by_parts = body.mass_matrix @ a + 2.0 * np.einsum("k,kij,j->i", omega, body.gyro, v) + body.first_moment @ center
    by_parts += np.einsum("k,kij,j->i", alpha, body.gyro, q) + np.einsum("k,kij,j->i", squares, body.second, q)
    by_parts += body.reference_moment @ (skew(alpha) + w @ w).ravel()
    np.testing.assert_allclose(by_parts, expected, atol=1e-9 * np.abs(expected).max())


def test_rotation_modes_of_the_deformed_body():
    """The renewed rows are the integrals of e_k × (s + u)."""
    body = Substructure.from_beam("beam", slender_beam(), "clamped", 3)
    q = np.append([0.4, -0.3, 0.2], np.zeros(6))
    run = integrator(body, coordinates=q)
    shape = np.einsum("pia,an->pin", body.beam.particle_shape, body.basis)
    place = body.beam.particle_position + shape @ q
    for k in range(3):
        shape[:, :, 6 + k] = np.cross(np.eye(3)[k], place)
    m = body.beam.particle_mass
    lower = np.tril(np.einsum("p,pia,pib->ab", m, shape, shape))
    np.testing.assert_allclose(np.tril(run.model.second[0, :3].sum(axis=0)), lower, atol=1e-9 * lower.max())
    for k in range(3):
        skewed = np.tril(np.einsum("p,pia,ij,pjb->ab", m, shape, skew(np.eye(3)[k]), shape))
        np.testing.assert_allclose(np.tril(run.model.gyro[0, k]), skewed, atol=1e-9 * lower.max())


def test_envelope_factors_solve():
    rng = np.random.default_rng(2)
    n, first = 9, np.array([0, 0, 1, 1, 3, 3, 0, 0, 0])
    a = rng.standard_normal((n, n)) + 8.0 * np.eye(n)
    for i in range(n):
        a[i, : first[i]] = a[: first[i], i] = 0.0
    low, up, x = np.tril(a), np.tril(a.T), rng.standard_normal(n)
    expected = np.linalg.solve(a, x)
    assert matrix.factorize_envelope(0, n, first, low, up, True)
    matrix.solve_envelope(n, first, low, up, x)
    np.testing.assert_allclose(x, expected, rtol=1e-10)


@pytest.mark.parametrize("prediction", ["uniform", "accelerated", "printed"])
def test_free_rigid_body_keeps_its_momentum(prediction):
    """Second order in the step."""
    errors = []
    for step in (0.004, 0.002):
        body = Substructure.from_beam("beam", slender_beam(), "clamped", 0)
        run = integrator(
            body, step, velocity=(1, 2, 3), angular_velocity=(0.4, -0.6, 0.8), options={"prediction": prediction}
        )
        start = run.momentum()
        run.advance(round(2.0 / step))
        change = np.abs(run.momentum() - start)
        assert change[:3].max() < 1e-5 * np.linalg.norm(start[:3])
        errors.append(change[3:].max() / np.linalg.norm(start[3:]))
    assert errors[0] < 1e-5
    assert errors[0] / errors[1] == pytest.approx(4.0, rel=0.1)


@pytest.mark.parametrize(
    ("n_modes", "kind"),
    [(4, {"reference": "simply_supported"}), (None, {"reference": "simply_supported"}),
     (4, {"displacement": "second_order"})],
)  # fmt: skip
def test_free_flexible_body_keeps_momentum_and_energy(n_modes, kind):
    body = Substructure.from_beam("beam", slender_beam(), n_modes=n_modes, **kind)
    rates = np.zeros(body.n)
    rates[:4] = 0.3
    run = integrator(body, 0.001, velocity=(1, 2, 3), angular_velocity=(0.4, -0.6, 0.8), rates=rates)
    start, energy = run.momentum(), run.energy().sum()
    run.advance(2000)
    assert np.abs(run.momentum() - start)[:3].max() < 1e-4 * np.linalg.norm(start[:3])
    assert np.abs(run.momentum() - start)[3:].max() < 1e-3 * np.linalg.norm(start[3:])
    assert run.energy().sum() == pytest.approx(energy, rel=1e-3)


@pytest.mark.parametrize("reference", REFERENCE_CONDITIONS)
def test_static_deflection_and_reactions(reference):
    """A clamped beam under a tip load comes to rest at P L³/3EI; the clamp carries P and P L."""
    body = Substructure.from_beam("beam", slender_beam(offset=(0.0, 0.0)), reference, None, damping_time=0.3)
    run = integrator(body, 0.05, hold=CLAMPED, load=(np.array([0.5, 2.0, 0, 0, 0, 0]), "fixed"))
    run.advance(800)
    tip = run.position("beam", "tip")
    np.testing.assert_allclose(tip[:2], [0.5e3 / 3 / EI, 2e3 / 3 / (4 * EI)], rtol=2e-3)
    # the trapezoidal rule leaves the stiffest modes oscillating from step to step: their mean is the reaction
    force, moment = [], []
    for _ in range(100):
        run.advance()
        force.append(run.reaction("support of beam.root"))
        moment.append(run.reaction("clamp of beam.root"))
    np.testing.assert_allclose(np.mean(force, axis=0), [0.5, 2.0, 0.0], atol=0.01)
    np.testing.assert_allclose(np.sort(np.abs(np.mean(moment, axis=0))), [0.0, 5.0, 20.0], atol=0.1)


def test_load_in_the_deformed_state_balances_eq_4():
    """At rest K q = Nᵀ R′p + Pᵀ (u × R′p), solved here by fixed-point iteration of the tip flexibility."""
    beam = slender_beam(offset=(0.0, 0.0))
    body = Substructure.from_beam("beam", beam, "clamped", None, damping_time=0.3)
    force = np.array([60.0, 0.0, 0.0])
    flexibility = np.linalg.inv(beam.stiffness[6:, 6:])[-6:, -6:]
    expected = {"undeformed": flexibility[:, :3] @ force, "deformed": np.zeros(6), "turned": np.zeros(6)}
    for _ in range(200):
        u = expected["deformed"]
        p = force + np.cross(u[3:], force)
        expected["deformed"] = flexibility @ np.concatenate([p, np.cross(u[:3], p)])
        u = expected["turned"]
        expected["turned"] = flexibility[:, :3] @ (force + np.cross(u[3:], force))
    for axes, field in expected.items():
        run = integrator(
            body, 0.05, hold=CLAMPED, load=(np.append(force, np.zeros(3)), axes), options={"n_iterations": 3}
        )
        run.advance(600)
        np.testing.assert_allclose(run.displacement("beam", "tip"), field, atol=1e-3 * np.abs(field).max())
    assert expected["deformed"][0] > 1.02 * expected["undeformed"][0]


def test_consistent_load_is_the_beam_column():
    """EI u'' = F (L − x) + F θ_L (u_L − u): the bending moment of a turned force about the deflected axis."""
    beam = Beam(BeamSections.uniform(LENGTH, EA=1e9, EIx=4 * EI, EIy=EI, GJ=2e3, mass=MASS, Ix=0.02, Iy=0.05), 8)
    body = Substructure.from_beam("beam", beam, "clamped", None, damping_time=0.3)
    force, slope = 50.0, 0.1
    for _ in range(100):
        k = np.sqrt(force * slope / EI)
        b = force / (EI * k**3)
        tip = b * np.tan(k * LENGTH) - force * LENGTH / (EI * k**2)
        a = -tip - force * LENGTH / (EI * k**2)
        slope = -force / (EI * k**2) - a * k * np.sin(k * LENGTH) + b * k * np.cos(k * LENGTH)
    load = (np.array([force, 0, 0, 0, 0, 0.0]), "consistent")
    run = integrator(body, 0.05, hold=CLAMPED, load=load, options={"n_iterations": 3})
    run.advance(800)
    assert tip > 1.02 * force * LENGTH**3 / (3 * EI)
    assert run.displacement("beam", "tip")[0] == pytest.approx(tip, rel=1e-3)


def swinging_tree(time, displacement="linear"):
    """Swinging beam in the floating-frame tree: hinge angle, modal coordinates."""
    beam = slender_beam()
    basis = clamped_modes(beam, 4).shape
    body = FlexibleBody.from_beam("beam", beam, basis)
    if displacement == "linear":
        body = without_second_order(body, beam, basis)
    system = MultibodySystem()
    system.add(body, Joint("revolute", (0.0, 1.0, 0.0), name="swing"))
    system.build()
    y = system.initial_state()
    y[0] = np.pi / 2
    run = HammingIntegrator(system, 0.0005)
    run.start(y)
    run.advance(round(time / 0.0005))
    return run.state[0], run.state[1:5]


def swing(step, time, displacement="linear", **options):
    """The same beam in an observer frame."""
    body = Substructure.from_beam("beam", slender_beam(), "clamped", 4, displacement=displacement)
    hinge = methodcaller("hinge", "beam", "root", (0.0, 1.0, 0.0))
    run = integrator(body, step, gravity=(0.0, 0.0, -GRAVITY), hold=hinge, rotation=HORIZONTAL, options=options)
    run.advance(round(time / step))
    rotation = run.state.rotation[0]
    angle = np.arctan2(rotation[0, 2], rotation[2, 2])
    q = run.coordinates("beam")
    return angle + q[-2], q[:4], run


@pytest.mark.parametrize("displacement", DISPLACEMENTS)
def test_swinging_beam_agrees_with_the_floating_frame_tree(displacement):
    """With rotation modes of the deformed body both are the same equations: only Newmark's error O(h²) remains."""
    angle, elastic = swinging_tree(0.5, displacement)
    errors = []
    for step in (0.004, 0.002, 0.001):
        found, q, _ = swing(step, 0.5, displacement)
        errors.append(abs(found - angle))
        assert abs(abs(q[0]) - abs(elastic[0])) < 0.2 * (step / 0.004) ** 2 * abs(elastic[0])
    assert errors[2] < 3e-5
    assert errors[0] / errors[1] == pytest.approx(4.0, rel=0.2)
    assert errors[1] / errors[2] == pytest.approx(4.0, rel=0.2)


@pytest.mark.parametrize("radius", [None, 0.0, 0.6, 1.0])
@pytest.mark.parametrize("phase", [0.3, 400.0])
def test_a_clamped_mode_obeys_the_difference_equations_of_the_scheme(radius, phase):
    """x, h ẋ and h² a of an oscillator with ω h = phase, by matrices from Chung & Hulbert's printed form.

    Newmark's formulas, and (1−αm) a₊ + αm a + (ω h)² ((1−αf) x₊ + αf x) = 0.
    """
    body = Substructure.from_beam("beam", slender_beam(), "clamped", 2)
    options = {"rigid_modes": "undeformed", "spectral_radius": radius}
    step = phase / body.frequency[0]
    run = integrator(body, step, hold=CLAMPED, coordinates=np.append([1e-4], np.zeros(7)), options=options)
    r = radius
    beta, gamma, am, af = (0.25, 0.5, 0.0, 0.0) if r is None else (
        1.0 / (1.0 + r) ** 2, (3.0 - r) / (2.0 + 2.0 * r), (2.0 * r - 1.0) / (r + 1.0), r / (r + 1.0)
    )  # fmt: skip
    now = np.array([[1.0, 0.0, -beta], [0.0, 1.0, -gamma], [(1.0 - af) * phase**2, 0.0, 1.0 - am]])
    past = np.array([[1.0, 1.0, 0.5 - beta], [0.0, 1.0, 1.0 - gamma], [-af * phase**2, 0.0, -am]])
    x = 1e-4 * np.array([1.0, 0.0, -(phase**2)])
    for _ in range(30):
        run.advance()
        x = np.linalg.solve(now, past @ x)
        assert run.coordinates("beam")[0] == pytest.approx(x[0], abs=1e-10)
        assert step * run.state.v[0, 0] == pytest.approx(x[1], abs=1e-9)
    if radius is not None and phase > 1.0:
        assert np.abs(np.linalg.eigvals(np.linalg.solve(now, past))).max() == pytest.approx(radius, abs=0.02)


def test_undeformed_rotation_modes_err_by_the_deflection():
    """With constant matrices the moment of the axial force about the deflection is missing: an error of order u/L."""
    angle, elastic = swinging_tree(0.5)
    found, _, run = swing(0.001, 0.5, rigid_modes="undeformed")
    deflection = np.abs(run.displacement("beam", "tip")[0]) / LENGTH
    assert 3e-5 < abs(found - angle) < deflection
    assert np.abs(elastic[0]) > 0.0


def test_shaft_about_its_own_axis_is_updated_on_demand():
    """Its ends do not move; its rotation counts with the reach of the machine.

    Linear theory gives a body turned by φ the centrifugal moment J ω² φ, up to 1 % of the torque here.
    """
    body = Substructure.from_beam("shaft", slender_beam(offset=(0.0, 0.0)), "clamped", 0)
    torque = (np.array([0, 0, 0, 0, 0, 0.05]), "fixed")
    run = integrator(body, 0.01, load=torque, options={"update": 0.1})
    run.advance(400)
    inertia = LENGTH * 0.07
    turned = np.arctan2(*run.orientation("shaft", "tip")[1::-1, 0])
    assert run.state.n_updates[0] >= 5
    assert turned == pytest.approx(0.5 * 0.05 / inertia * 16.0, rel=0.01)


class TestFromSystem:
    """The same bodies and joints in local observer frames."""

    def test_spherical_pendulum_on_a_turned_joint_keeps_energy_and_swings_like_the_tree(self):
        tree = MultibodySystem()
        turn = Rotation.from_euler("xyz", (0.3, -0.2, 0.5)).as_matrix()
        bob = FlexibleBody.rigid("bob", 2.0, (0.1, 0.0, -1.0), np.diag([0.2, 0.3, 0.1]), {"end": (0.1, 0.0, -1.0)})
        first = tree.add(bob, Joint("spherical", rotation=turn, offset=(0.5, 0.0, 0.0)))
        other = FlexibleBody.rigid("other", 1.0, (0.0, 0.0, -0.5), np.diag([0.1, 0.1, 0.1]), {"end": (0.0, 0.0, -1.0)})
        tree.add(other, Joint("revolute", (0.0, 1.0, 0.0), offset=(0.0, 0.0, -0.1)), first, "end")
        y = tree.build().initial_state()
        y[4], y[5:8], y[8] = 0.4, (0.3, 0.5, -0.2), 0.7
        observed = observer_frame_from_system(tree, y=y)
        run = ObserverFrameIntegrator(observed, 0.0005)
        known = HammingIntegrator(tree, 0.001)
        known.start(y)
        run.advance(2000)
        known.advance(1000)
        position, rotation = rotating_beams.body_pose(tree, known.state, 1)
        np.testing.assert_allclose(run.position("other", "end"), position + rotation @ (0.0, 0.0, -1.0), atol=2e-5)

    def test_refusals(self):
        def made(joint, body=None, fields=None):
            tree = MultibodySystem()
            tree.add(body or FlexibleBody.rigid("bob", 1.0, (0.0, 0.0, -1.0), 0.01 * np.eye(3)), joint)
            return observer_frame_from_system(tree.build(), *([] if fields is None else [fields]))

        def behind_gear(joint):
            tree = MultibodySystem()
            gear = FlexibleBody.rigid("gear", 0.0, np.zeros(3), np.zeros((3, 3)))
            gear = tree.add(gear, Joint("servo", (0.0, 0.0, 1.0), servo_frequency=2.0, name="drive"))
            bob = tree.add(FlexibleBody.rigid("bob", 1.0, (0.0, 0.0, -1.0), 0.01 * np.eye(3)), joint, gear)
            tree.add(FlexibleBody.rigid("free", 1.0, np.zeros(3), np.eye(3)), Joint("spherical"), bob)
            return observer_frame_from_system(tree.build())

        beam, hinge = slender_beam(), Joint("revolute")
        body = FlexibleBody.from_beam("beam", beam, clamped_modes(beam, 3).shape)
        tied = MultibodySystem()
        tied.add(FlexibleBody.rigid("bob", 1.0, np.zeros(3), np.eye(3)), Joint("free"))
        tied.add_constraint(Constraint("hinge", servo_frequency=2.0, name="pitch"), None, 0)
        two, arm = Joint("servo", servo_frequency=1.0, name="second"), Joint("fixed", offset=(0, 0, 0.1), name="arm")
        across = Joint("revolute", (1.0, 0.0, 0.0), stiffness=1.0, name="across")
        refuses(
            ObserverFrameError,
            ("prismatic joint", lambda: made(Joint("prismatic", name="slide"))),
            ("its beam and basis", lambda: made(hinge, body)),
            ("was not made from", lambda: made(hinge, body, {"beam": (beam, clamped_modes(beam, 2).shape)})),
            (r"\['blade'\]", lambda: made(hinge, body, {"blade": (beam, np.zeros((1, 1)))})),
            ("'pitch': only the weld", lambda: observer_frame_from_system(tied.build())),
            ("'second': two servos", lambda: behind_gear(two)),
            ("'arm': it must not be offset", lambda: behind_gear(arm)),
            ("'across': a spring behind a servo", lambda: behind_gear(across)),
        )


class TestErrors:
    """Each mistake is named."""

    def body(self, **changes):
        return Substructure.from_beam("beam", slender_beam(), **({"n_modes": 3} | changes))

    def system(self):
        system = ObserverFrameSystem()
        system.add(self.body())
        return system

    def test_substructures_options_and_names(self):
        def integrated(step=0.1, **options):
            return lambda: ObserverFrameIntegrator(self.system(), step, **options)

        second, system = self.body(displacement="second_order"), self.system()
        refuses(
            ObserverFrameError,
            ("welded", lambda: self.body(reference="welded")),
            ("500", lambda: self.body(n_modes=500)),
            ("far", lambda: self.body(markers={"far": 12.0})),
            ("must be one of linear, second_order, got 'cubic'", lambda: self.body(displacement="cubic")),
            (
                "needs the reference 'clamped'",
                lambda: self.body(displacement="second_order", reference="simply_supported"),
            ),
            ("time step", integrated(0.0)),
            ("time step", integrated(float("nan"))),
            ("n_iterations", integrated(n_iterations=0)),
            ("update", integrated(update=-1.0)),
            ("wild", integrated(prediction="wild")),
            ("spectral_radius must lie in 0 … 1, got -0.1", integrated(spectral_radius=-0.1)),
            ("spectral_radius must lie in 0 … 1, got 1.1", integrated(spectral_radius=1.1)),
            ("spectral_radius must lie in 0 … 1, got nan", integrated(spectral_radius=np.nan)),
            ("need the rigid_modes 'deformed'", lambda: integrator(second, options={"rigid_modes": "undeformed"})),
            ("'deformed' adds the moment of the deflection", lambda: integrator(second, load=(np.ones(6), "deformed"))),
            ("exists already", lambda: system.add(self.body())),
            ("no marker 'elbow'", lambda: system.support("beam", "elbow")),
            ("no substructure is named 'arm'", lambda: system.load("arm", "tip", np.zeros(6))),
            (r"load axes must be one of .*, got 'wind'", lambda: system.load("beam", "tip", np.zeros(6), "wind")),
        )

    def test_constraints_and_masses(self):
        redundant, violated, light = self.system(), self.system(), ObserverFrameSystem()
        redundant.clamp("beam", "root")
        redundant.hinge("beam", "root", (1.0, 0.0, 0.0))
        violated.add(Substructure.from_beam("other", slender_beam(), n_modes=3), position=(0.0, 0.1, 0.0))
        violated.join("beam", "root", "other", "root")
        thread = BeamSections.uniform(LENGTH, EA=1e6, EIx=EI, EIy=EI, GJ=2e3, mass=1.0, Ix=0.0, Iy=0.0)
        light.add(Substructure.from_beam("thread", Beam(thread, 2), n_modes=0))
        refuses(
            ObserverFrameError,
            (
                r"inconsistent constraints: support of beam\.root repeats",
                lambda: ObserverFrameIntegrator(redundant, 0.01),
            ),
            (r"violated by -0\.1", lambda: ObserverFrameIntegrator(violated, 0.01)),
            ("'thread': the mass matrix is singular", lambda: ObserverFrameIntegrator(light, 0.01)),
        )

    def test_divergence(self):
        """A follower load far beyond the tip's stiffness."""
        run = integrator(self.body(), 0.01, hold=CLAMPED, load=(np.array([1e5, 0, 0, 0, 0, 0.0]), "deformed"))
        with pytest.raises(ObserverFrameError, match=r"diverged|too long"):
            run.advance(5000)
