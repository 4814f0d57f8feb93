"""Equations of motion, constraint equations, and the refusals of a multibody system."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from envs_tests.physics.refusals import refuses
from wt_gym.multibody.arrays import MultibodyError
from wt_gym.multibody.constraints.descriptor import descriptor_form
from wt_gym.multibody.integrators.schemes import INTEGRATORS, HammingIntegrator, make_integrator
from wt_gym.multibody.system import Constraint, Joint, MultibodySystem
from wt_gym.multibody.tree import tree_kernels
from wt_gym.structure.beam import Beam, BeamSections, skew
from wt_gym.structure.flexible_body import FlexibleBody, particle_fields
from wt_gym.structure.modes import clamped_modes

# ---- equations of motion --------------------------------------------------------------------------------------------

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


@pytest.mark.parametrize(("complete", "floating"), [(False, False), (True, False), (False, True)])
def test_equations_of_motion_are_those_of_lagrange(complete, floating):
    """d/dt ∂T/∂u = ∂(T − V)/∂q at any state, coordinate by coordinate: also of the terms that do no work."""
    system, floater = MultibodySystem(), None
    if floating:
        floater = FlexibleBody.rigid("floater", 5.0, (0.1, 0.2, -0.8), np.diag([4.0, 5.0, 6.0]))
        floater = system.add(floater, Joint("cardan", offset=(0.3, 0.2, 0.1), name="platform"))
    tower = system.add(
        modal_body("tower", 3, 4, factor=4.0, complete=complete), Joint("revolute", (0.8, 0.6, 0.0), name="lean"),
        floater,
    )  # fmt: skip
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


def floating_pair(added, mass=5.0):
    """A hinged body on a floater with added mass (6, 6), and a state in full motion."""
    system = MultibodySystem()
    floater = FlexibleBody.rigid("floater", mass, (0.0, 0.0, 0.0), np.diag([4.0, 5.0, 6.0]))
    floater = system.add(floater, Joint("cardan", name="platform"))
    system.add(box("load", 2.0, np.diag([0.5, 0.3, 0.4])), Joint("revolute", (0.6, 0.0, 0.8), name="turn",
                                                                 offset=(0.1, 0.2, 1.4)), floater)  # fmt: skip
    system.add_water(floater, added)
    rng = np.random.default_rng(11)
    return system.build(), np.concatenate([0.3 * rng.standard_normal(7), rng.standard_normal(7)])


def test_water_that_moves_with_a_floater_keeps_the_energy():
    root = np.random.default_rng(5).standard_normal((6, 6))
    system, y = floating_pair(20.0 * root @ root.T)
    inertia, _ = system.balance(y, system.new_inputs(), system.new_work())
    dry, _ = floating_pair(np.zeros((6, 6)))[0].balance(y, system.new_inputs(), system.new_work())
    assert np.abs(inertia - dry).max() > 10.0
    step = 1e-5 * system.rates(y)
    change = sum(system.energy(y + step)) - sum(system.energy(y - step))
    assert abs(change) < 1e-8 * sum(np.abs(system.energy(y)))


def test_added_mass_is_mass_without_weight():
    system, y = floating_pair(np.diag([3.0, 3.0, 3.0, 0.0, 0.0, 0.0]))
    heavy, _ = floating_pair(np.zeros((6, 6)), mass=8.0)
    inputs, work = heavy.new_inputs(), heavy.new_work()
    heavy.rates(y, inputs, work)
    inputs.body_loads[:, 0, :3] = 3.0 * work.rot[0].T @ -heavy.gravity
    np.testing.assert_allclose(system.rates(y), heavy.rates(y, inputs, work), rtol=1e-12, atol=1e-12)


def test_a_cardan_joint_moves_as_a_free_one():
    """The same accelerations of a body in the air, whatever its coordinates are."""
    body = FlexibleBody.rigid("body", 2.0, (0.1, -0.3, 0.2), np.diag([1.0, 2.0, 2.5]))
    cardan, free = MultibodySystem(), MultibodySystem()
    cardan.add(body, Joint("cardan", name="platform"))
    free.add(body, Joint("free", name="platform"))
    cardan.build(), free.build()
    y = np.array([0.4, -0.2, 1.0, 0.5, -0.7, 1.1, 0.3, 0.1, -0.6, 0.8, -0.4, 0.9])
    work, other = cardan.new_work(), free.new_work()
    cardan.rates(y, work=work)
    turn = Rotation.from_euler("ZYX", y[[5, 4, 3]])
    np.testing.assert_allclose(work.rot[0], turn.as_matrix(), atol=1e-14)
    z = np.concatenate([y[:3], turn.as_quat()[[3, 0, 1, 2]], y[6:9], work.omega[0]])
    rates = free.rates(z, work=other)
    np.testing.assert_allclose(cardan.rates(y)[6:9], rates[7:10], rtol=1e-12)
    h, spins = 1e-6, []
    for sign in (1.0, -1.0):
        cardan.rates(y + sign * h * cardan.rates(y), work=work)
        spins.append(work.omega[0].copy())
    np.testing.assert_allclose((spins[0] - spins[1]) / (2.0 * h), rates[10:13], rtol=1e-7)


@pytest.mark.parametrize(
    ("joint", "added", "message"),
    [
        ("free", np.eye(6), "Cardan joint"),
        ("cardan", np.eye(3), "symmetric finite matrix"),
        ("cardan", np.triu(np.ones((6, 6))), "symmetric"),
        ("cardan", -np.eye(6), "positive semidefinite"),
    ],
)
def test_added_mass_that_is_none(joint, added, message):
    system = MultibodySystem()
    system.add(box(), Joint(joint, name="platform"))
    refuses(MultibodyError, (message, lambda: system.add_water(0, added)))


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


# ---- constraint equations -------------------------------------------------------------------------------------------

PITCH = {"servo_frequency": 6.0, "servo_damping": 1.0}


def rotor(constrained):
    """Flexible tower, free-turning hub and two pitching flexible blades, jointed or tied by constraint equations."""
    system = MultibodySystem()
    tower = system.add(modal_body("tower", 3, factor=43.0), Joint("fixed"))
    hub = FlexibleBody.rigid("hub", 8.0, (-0.2, 0.0, 0.1), np.diag([2.0, 1.5, 1.5]))
    shaft = Joint(
        "revolute", (1.0, 0.0, 0.0), Rotation.from_euler("y", 0.1).as_matrix(), (-1.0, 0.0, 0.5), name="azimuth"
    )
    hub = system.add(hub, shaft, tower, "tip")
    for i in range(2):
        root = Rotation.from_euler("xy", [np.pi * i, -0.05]).as_matrix()
        place = {"rotation": root, "offset": root @ [0.0, 0.0, 0.4]}
        if constrained:
            blade = system.add(modal_body(f"blade_{i}", 3, factor=7.0), Joint("free", name=f"free_{i}"))
            weld = Constraint("weld", axis=(0.0, 0.0, -1.0), name=f"pitch_{i}", **place, **PITCH)
            system.add_constraint(weld, hub, blade, second_marker="root")
        else:
            joint = Joint("servo", (0.0, 0.0, -1.0), name=f"pitch_{i}", **place, **PITCH)
            system.add(modal_body(f"blade_{i}", 3, factor=7.0), joint, hub)
    return system.build()


def state_pair(rng, scale=0.1):
    """The same motion in both forms: (embedded, state), (constrained, state)."""
    embedded, tied = rotor(False), rotor(True)
    y, z = embedded.initial_state(), tied.initial_state()
    elastic = scale * rng.standard_normal((3, 3))
    rate = scale * rng.standard_normal((3, 3))
    for system, state in ((embedded, y), (tied, z)):
        for row, body in enumerate((0, 2, 3)):
            q, u = system.index(body, "elastic_q"), system.index(body, "elastic_u")
            state[q : q + 3], state[system.n_q + u : system.n_q + u + 3] = elastic[row], rate[row]
        state[system.index(1, "joint_q")] = 0.7
        state[system.n_q + system.index(1, "joint_u")] = 1.3
        n_y = system.n_q + system.n_u
        state[n_y : n_y + 4] = [0.1, -0.2, 0.3, -0.1]
    tied.place_free_bodies(z)
    return embedded, y, tied, z


def loads_pair(rng, embedded, tied):
    inputs = embedded.new_inputs(), tied.new_inputs()
    load = 20.0 * rng.standard_normal((2, 4, 9))
    command = 0.3 * rng.standard_normal((2, 2))
    for i in inputs:
        i.body_loads[:] = load
        i.servo_command[:] = command
    return inputs


@pytest.mark.parametrize(
    ("name", "step", "n", "tolerance", "residual"),
    [("hamming", 0.000625, 32000, 1e-6, 1e-6), ("newmark", 0.002, 200, 1e-4, 1e-5)],
)
def test_trajectories_agree_and_constraints_hold(name, step, n, tolerance, residual):
    """Quaternions, servos and multipliers together: the difference between the forms is that of the scheme."""
    rng = np.random.default_rng(2)
    embedded, y, tied, z = state_pair(rng, 0.05)
    runs = []
    for system, state, inputs in zip((embedded, tied), (y, z), loads_pair(rng, embedded, tied), strict=True):
        integrator = make_integrator(name, system, step)
        for mine, given in zip(integrator.inputs, inputs, strict=True):
            mine[:] = given[0]
        integrator.start(state)
        integrator.advance(n)
        runs.append(integrator.state.copy())
    for body in (0, 2, 3):
        i, j = embedded.index(body, "elastic_q"), tied.index(body, "elastic_q")
        np.testing.assert_allclose(runs[1][j : j + 3], runs[0][i : i + 3], atol=tolerance * np.abs(runs[0][:10]).max())
    assert np.abs(tied.constraint_residuals(runs[1])[0]).max() < residual
    for body in (2, 3):
        q = tied.index(body, "joint_q") + 3
        assert abs(np.linalg.norm(runs[1][q : q + 4]) - 1.0) < 1e-12


def test_four_bar_linkage_turns_about_its_instantaneous_center():
    """A parallelogram linkage closed by a ball joint: both cranks keep equal angles and energy is conserved."""
    system = MultibodySystem()
    bar = np.diag([0.01, 0.01, 1e-4])
    ends = {"origin": np.zeros(3), "end": np.array([0.0, 0.0, -1.0])}
    crank = FlexibleBody.rigid("crank", 1.0, (0.0, 0.0, -0.5), bar, ends)
    coupler = FlexibleBody.rigid(
        "coupler", 2.0, (1.0, 0.0, 0.0), bar, {"origin": np.zeros(3), "end": np.array([2.0, 0, 0])}
    )
    y_axis = (0.0, 1.0, 0.0)
    first = system.add(crank, Joint("revolute", y_axis, name="first"))
    second = system.add(coupler, Joint("revolute", y_axis, name="coupler"), first, "end")
    third = system.add(crank, Joint("revolute", y_axis, offset=(2.0, 0.0, 0.0), name="third"))
    system.add_constraint(Constraint("hinge", axis=y_axis, name="closure"), second, third, "end", "end")
    with pytest.raises(MultibodyError, match="depend on each other"):
        system.build().rates(system.initial_state())  # a planar loop locks three of the five equations twice


IMPLICIT = [("newmark", {}), ("generalized_alpha", {"rho_inf": 0.8}), ("generalized_alpha", {"rho_inf": 0.0})]
CRANK, ROD, SPEED = 0.3, 1.0, 6.0


def slider_crank(flywheel):
    """In-line slider-crank closed by a ball joint on a universal rod: system and state at top dead center."""
    system = MultibodySystem(gravity=(0.0, 0.0, 0.0), stabilization=30.0)
    ends = {"origin": np.zeros(3), "pin": np.array([CRANK, 0.0, 0.0])}
    crank = FlexibleBody.rigid("crank", 1.0, np.zeros(3), np.diag([1.0, 1.0, flywheel]), ends)
    crank = system.add(crank, Joint("revolute", (0.0, 0.0, 1.0), name="crank"))
    slider = FlexibleBody.rigid("slider", 1.0, np.zeros(3), np.eye(3))
    slider = system.add(slider, Joint("prismatic", (1.0, 0.0, 0.0), name="slide"))
    ends = {"origin": np.zeros(3), "end": np.array([-ROD, 0.0, 0.0])}
    rod = FlexibleBody.rigid("rod", 0.5, (-ROD / 2, 0.0, 0.0), np.diag([1e-3, 0.04, 0.04]), ends)
    rod = system.add(rod, Joint("revolute", (0.0, 0.0, 1.0), name="rod"), slider)
    # planar: two of the three equations of the ball are independent, the third is the plane itself
    system.add(
        FlexibleBody.rigid("float", 0.1, np.zeros(3), 1e-3 * np.eye(3)), Joint("prismatic", (0.0, 0.0, 1.0)), rod, "end"
    )
    system.add_constraint(Constraint("ball", name="pin"), crank, 3, "pin", "origin")
    system.build()
    y = system.initial_state()
    y[1] = CRANK + ROD
    y[system.n_q] = SPEED
    y[system.n_q + 2] = -SPEED * CRANK / ROD
    return system, y


def after_a_second(name, system, y, n, **options):
    """Integrator that has taken n steps of 1/n s."""
    integrator = make_integrator(name, system, 1.0 / n, **options)
    integrator.start(y)
    integrator.advance(n)
    return integrator


@pytest.mark.parametrize(("name", "options"), IMPLICIT)
def test_implicit_schemes_keep_their_order_with_constraint_equations(name, options):
    """A light slider-crank, whose speed rises and falls: second order; energy, closure and the slider's path hold."""
    system, y = slider_crank(1.0)
    reference = after_a_second("hamming", system, y, 5000, starter="runge-kutta")
    errors = []
    for n in (1000, 2000):
        integrator = after_a_second(name, system, y, n, **options)
        errors.append(np.linalg.norm(integrator.state - reference.state))
    assert np.log2(errors[0] / errors[1]) == pytest.approx(2.0, abs=0.15)
    assert errors[1] < 1e-5
    angle, slide = integrator.state[:2]
    assert slide == pytest.approx(CRANK * np.cos(angle) + np.sqrt(ROD**2 - (CRANK * np.sin(angle)) ** 2), abs=1e-12)
    assert np.abs(system.constraint_residuals(integrator.state)[0]).max() < 1e-12
    assert sum(system.energy(integrator.state)) == pytest.approx(sum(system.energy(y)), rel=1e-5)


@pytest.mark.parametrize(("name", "options"), IMPLICIT)
def test_a_free_body_stays_on_its_circle_whatever_the_step(name, options):
    """A body welded to a shaft, 1.5 m off its axis, turns by half a radian in a step: speed and angle are exact.

    Displaced along global axes it would be ψ²/12, here two parts in a hundred, behind its own speed in every step.
    """
    system, speed, step, n = MultibodySystem((0.0, 0.0, 0.0), projection=False), 5.0, 0.1, 200
    shaft = system.add(
        FlexibleBody.rigid("shaft", 1.0, np.zeros(3), 0.1 * np.eye(3)),
        Joint("revolute", (0.0, 0.0, 1.0), Rotation.from_euler("y", 0.3).as_matrix(), name="azimuth"),
    )
    arm = system.add(
        FlexibleBody.rigid("arm", 3.0, (0.2, 0.1, -0.3), np.diag([2.0, 3.0, 4.0])), Joint("free", name="free")
    )
    system.add_constraint(Constraint("weld", offset=(1.5, 0.0, 0.0), name="held"), shaft, arm)
    system.build()
    y = system.initial_state()
    y[system.n_q + system.index(shaft, "joint_u")] = speed
    system.place_free_bodies(y)
    integrator = make_integrator(name, system, step, **options)
    integrator.start(y)
    integrator.advance(n)
    end = integrator.state
    assert end[system.index(shaft, "joint_q")] == pytest.approx(n * speed * step, rel=1e-10)
    assert end[system.n_q + system.index(shaft, "joint_u")] == pytest.approx(speed, rel=1e-10)
    position, velocity = (np.abs(residual).max() for residual in system.constraint_residuals(end))
    assert position < 1e-9
    assert velocity < 1e-9


@pytest.mark.parametrize(
    ("name", "options", "error"), [(*one, error) for one, error in zip(IMPLICIT, (1.1e-3, 1.1e-3, 7.0e-3), strict=True)]
)
def test_a_tied_top_moves_to_second_order(name, options, error):
    """An asymmetric top on a ball joint under gravity, its origin off the joint: all terms of the origin's motion act.

    Errors after a second in 50 steps against fine steps of an explicit scheme; without any one of the terms they are
    twice as large at least, or fall to first order with the step.
    """
    system = MultibodySystem((0.0, 0.0, -9.81))
    top = system.add(FlexibleBody.rigid("top", 3.0, (0.2, 0.1, -0.3), np.diag([2.0, 3.0, 4.0])), Joint("free"))
    system.add_constraint(Constraint("ball", second_offset=(-1.5, 0.2, 0.1)), None, top)
    system.build()
    y, origin, spin = system.initial_state(), np.array([1.5, -0.2, -0.1]), np.array([1.0, 2.0, 3.0])
    q, u = system.index(top, "joint_q"), system.n_q + system.index(top, "joint_u")
    y[q : q + 3], y[u : u + 3], y[u + 3 : u + 6] = origin, np.cross(spin, origin), spin
    reference = after_a_second("hamming", system, y, 800, starter="runge-kutta").state
    errors = [np.abs(after_a_second(name, system, y, n, **options).state - reference).max() for n in (25, 50)]
    assert errors[1] < 1.25 * error
    assert np.log2(errors[0] / errors[1]) == pytest.approx(2.0, abs=0.1)


# ---- refusals -------------------------------------------------------------------------------------------------------

REFLECTION = np.diag([1.0, 1.0, -1.0])


def box(name="box", mass=1.0, inertia=None):
    return FlexibleBody.rigid(name, mass, np.zeros(3), np.eye(3) if inertia is None else inertia)


def flying():
    """A free box."""
    system = MultibodySystem()
    system.add(box(), Joint("free", name="fly"))
    return system.build()


def tied():
    """Two free boxes welded together, with a consistent state."""
    system = MultibodySystem()
    system.add(box("first"), Joint("free", name="one"))
    system.add(box("second"), Joint("free", name="two"))
    system.add_constraint(Constraint("weld", offset=(1.0, 0.0, 0.0), name="glue"), 0, 1)
    y = system.build().initial_state()
    y[7] = 1.0
    return system, y


@pytest.mark.parametrize(
    ("make", "kwargs", "message"),
    [
        (Joint, {"rotation": 2.0 * np.eye(3)}, "not orthogonal"),
        (Joint, {"rotation": REFLECTION}, "reflection"),
        (Joint, {"rotation": "upright"}, "rotation must be numbers, got 'upright'"),
        (Joint, {"offset": (0.0, 0.0)}, "offset must be three finite numbers, got "),
        (Joint, {"kind": "revolute", "axis": (1.0, 1.0, 0.0)}, "not a unit vector"),
        (Joint, {"stiffness": 5.0}, "must be 0, got 5.0: joint type 'fixed' does not support it; allowed: revolute"),
        (Joint, {"kind": "servo"}, "servo_frequency must be a finite number > 0, got 0.0"),
        (Joint, {"kind": "revolute", "stiffness": -1.0}, "stiffness must be a finite number >= 0, got -1.0"),
        (Joint, {"kind": "glue"}, "must be one of fixed, revolute"),
        (Constraint, {"kind": "glue"}, "must be one of"),
        (Constraint, {"axis": (0.0, 2.0, 0.0)}, "not a unit vector"),
        (Constraint, {"second_rotation": REFLECTION}, "second_rotation is a reflection"),
        (Constraint, {"second_offset": (1.0,)}, "second_offset must be"),
        (Constraint, {"servo_frequency": -2.0}, "servo_frequency must be a finite number >= 0, got -2.0"),
        (box, {"mass": -1.0}, "body 'box': mass must be a finite number >= 0, got -1.0"),
        (box, {"mass": np.nan}, "body 'box': mass must be a finite number >= 0, got nan"),
        (box, {"inertia": np.diag([1.0, 1.0, -1.0])}, "body 'box': its inertia is negative for a motion"),
        (box, {"inertia": np.eye(3) + 3.0 * np.eye(3)[[1, 0, 2]] * [1, 1, 0]}, "its inertia is negative for a motion"),
        (box, {"inertia": np.eye(3) + 0.5 * np.eye(3, k=1) * [0, 1, 0]}, "its inertia is not symmetric"),
    ],
)
def test_malformed_parts(make, kwargs, message):
    with pytest.raises(MultibodyError, match=message):
        MultibodySystem().add(make(**kwargs), Joint("free"))


def test_malformed_systems():
    twice, missing, built = MultibodySystem(), MultibodySystem(), flying()
    for name in ("first", "second"):
        twice.add(box(name), Joint("revolute", name="swing"))
    missing.add(box(), Joint("free"))
    missing.add(box("none", 0.0, np.zeros((3, 3))), Joint("fixed"), 0)  # a body without mass carries a joint
    refuses(
        MultibodyError,
        ("occur twice: swing, swing_rate", twice.build),
        ("nose", lambda: missing.add_constraint(Constraint("ball"), None, 0, second_marker="nose")),
        ("'late' comes too late", lambda: built.add(box("late"), Joint("free"))),
        ("'late' comes too late", lambda: built.add_constraint(Constraint(name="late"), None, 0)),
    )


def test_use_before_build():
    system = MultibodySystem()
    system.add(box(), Joint("free"))
    uses = [lambda: system.rates(np.zeros(13)), lambda: system.energy(np.zeros(13)), system.initial_state]
    uses += [system.new_work, system.new_inputs]
    uses += [lambda name=name: make_integrator(name, system, 0.01) for name in INTEGRATORS]
    refuses(MultibodyError, *(("not built yet", use) for use in uses))


@pytest.mark.parametrize("factor", [1.1, 0.0, np.nan])
def test_quaternions_that_are_not_of_unit_length(factor):
    system = flying()
    y = system.initial_state()
    y[3:7] *= factor
    uses = [system.rates, system.energy, lambda y: descriptor_form(system, y)]
    uses += [make_integrator(name, system, 0.01).start for name in INTEGRATORS]
    uses += [lambda y: make_integrator("hamming", system, 0.01).start(y, check=False)]
    message = f"body 'box': its quaternion .* has norm {factor:.9g}"
    refuses(MultibodyError, *((message, lambda use=use: use(y)) for use in uses))


def test_states_of_wrong_length_or_not_finite():
    system = flying()
    with pytest.raises(MultibodyError, match=r"state has shape \(12,\); must be \(13,\)"):
        system.rates(np.zeros(12))
    y = system.initial_state()
    y[7] = np.inf
    with pytest.raises(MultibodyError, match="not finite in fly_0_rate"):
        make_integrator("newmark", system, 0.01).start(y)


@pytest.mark.parametrize("name", list(INTEGRATORS))
def test_starts_off_the_constraints(name):
    system, y = tied()
    integrator = make_integrator(name, system, 0.01)
    y[7] += 0.01
    with pytest.raises(MultibodyError, match=r"constraint 'glue': its position residual is 0.01 m"):
        integrator.start(y)
    integrator.start(y, check=False)
    y[7] -= 0.01
    y[system.n_q + 6] = 0.5
    with pytest.raises(MultibodyError, match=r"constraint 'glue': its velocity residual is 0.5 m/s"):
        integrator.start(y)


def test_a_start_is_put_onto_the_constraints():
    """Residuals within the tolerance vanish at the start and stay so at every step."""
    system, y = tied()
    y[7] += 2e-6
    y[system.n_q + 5] = 2.0
    y[system.n_q + 11] = 2.0
    y[system.n_q + 7] = 2.0
    integrator = HammingIntegrator(system, 0.01)
    integrator.start(y)
    assert np.abs(system.constraint_residuals(integrator.state)[0]).max() < 1e-12
    for _ in range(200):
        integrator.advance()
        assert np.abs(integrator.work.residual).max() < 1e-9
        assert np.abs(integrator.work.residual_rate).max() < 1e-5


def test_stabilization_beyond_its_limit():
    system = MultibodySystem(stabilization=150.0)
    system.add(box("first"), Joint("free", name="one"))
    system.add_constraint(Constraint("ball", name="pin"), None, 0)
    system.build()
    with pytest.raises(MultibodyError, match=r"α = 150 1/s .* α h = 1.5; allowed with 3 corrector pass"):
        HammingIntegrator(system, 0.01).start(system.initial_state())
