"""Constraint equations with Lagrange multipliers against the embedded form and exact results."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from wt_gym.multibody.arrays import MultibodyError
from wt_gym.multibody.constraints.descriptor import descriptor_form
from wt_gym.multibody.integrators.schemes import HammingIntegrator, make_integrator
from wt_gym.multibody.system import Constraint, Joint, MultibodySystem
from wt_gym.multibody.tree import output_kernels, tree_kernels
from wt_gym.structure.beam import Beam, BeamSections
from wt_gym.structure.flexible_body import FlexibleBody
from wt_gym.structure.modes import clamped_modes

PITCH = {"servo_frequency": 6.0, "servo_damping": 1.0}


def flexible(name, factor=10.0):
    sections = BeamSections.uniform(
        10.0, EA=2.8e7, EIx=4 * factor * 1e4, EIy=factor * 1e4, GJ=2e3, mass=1.2, Ix=0.02, Iy=0.05, offset=(0.02, 0.05)
    )
    beam = Beam(sections, 8)
    return FlexibleBody.from_beam(name, beam, clamped_modes(beam, 3).shape)


def rotor(constrained):
    """Flexible tower, free-turning hub and two pitching flexible blades, jointed or tied by constraint equations."""
    system = MultibodySystem()
    tower = system.add(flexible("tower", 60.0), Joint("fixed"))
    hub = FlexibleBody.rigid("hub", 8.0, (-0.2, 0.0, 0.1), np.diag([2.0, 1.5, 1.5]))
    shaft = Joint(
        "revolute", (1.0, 0.0, 0.0), Rotation.from_euler("y", 0.1).as_matrix(), (-1.0, 0.0, 0.5), name="azimuth"
    )
    hub = system.add(hub, shaft, tower, "tip")
    for i in range(2):
        root = Rotation.from_euler("xy", [np.pi * i, -0.05]).as_matrix()
        place = {"rotation": root, "offset": root @ [0.0, 0.0, 0.4]}
        if constrained:
            blade = system.add(flexible(f"blade_{i}"), Joint("free", name=f"free_{i}"))
            weld = Constraint("weld", axis=(0.0, 0.0, -1.0), name=f"pitch_{i}", **place, **PITCH)
            system.add_constraint(weld, hub, blade, second_marker="root")
        else:
            joint = Joint("servo", (0.0, 0.0, -1.0), name=f"pitch_{i}", **place, **PITCH)
            system.add(flexible(f"blade_{i}"), joint, hub)
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


def test_accelerations_of_both_forms_agree():
    rng = np.random.default_rng(0)
    for _ in range(5):
        embedded, y, tied, z = state_pair(rng)
        one, two = loads_pair(rng, embedded, tied)
        work = tied.new_work()
        a, b = embedded.rates(y, one), tied.rates(z, two, work)
        scale = np.abs(a[embedded.n_q : embedded.n_q + embedded.n_u]).max()
        for body in (0, 2, 3):
            i, j = embedded.n_q + embedded.index(body, "elastic_u"), tied.n_q + tied.index(body, "elastic_u")
            np.testing.assert_allclose(b[j : j + 3], a[i : i + 3], atol=1e-9 * scale)
        i, j = embedded.n_q + embedded.index(1, "joint_u"), tied.n_q + tied.index(1, "joint_u")
        assert b[j] == pytest.approx(a[i], abs=1e-9 * scale)
        assert np.abs(work.residual).max() < 1e-13
        assert np.abs(work.residual_rate).max() < 1e-12


def test_multipliers_are_the_root_loads_of_the_embedded_form():
    rng = np.random.default_rng(1)
    embedded, y, tied, z = state_pair(rng)
    one, two = loads_pair(rng, embedded, tied)
    work, tied_work = embedded.new_work(), tied.new_work()
    dy, dz = embedded.rates(y, one, work), tied.rates(z, two, tied_work)
    wrench, tied_wrench = np.zeros((4, 6)), np.zeros((4, 6))
    for system, state, rate, inputs, w, out in (
        (embedded, y, dy, one, work, wrench),
        (tied, z, dz, two, tied_work, tied_wrench),
    ):
        tree_kernels.kinematics(state, system.tree, w)
        acceleration = rate[system.n_q : system.n_q + system.n_u]
        output_kernels.joint_wrenches(state, acceleration, inputs.body_loads[0], system.tree, w, out)
    multipliers = tied_work.multipliers.reshape(2, 6)
    np.testing.assert_allclose(multipliers, wrench[2:], atol=1e-9 * np.abs(wrench).max())
    np.testing.assert_allclose(tied_wrench, wrench, atol=1e-9 * np.abs(wrench).max())


def test_descriptor_form_with_quaternions_gives_the_same_accelerations_and_multipliers():
    """Eqs. (7)–(11) of Gebhardt et al. with four quaternion components and a norm condition for each blade."""
    rng = np.random.default_rng(3)
    _, _, tied, z = state_pair(rng)
    inputs = loads_pair(rng, *[rotor(True)] * 2)[1]
    work = tied.new_work()
    rates = tied.rates(z, inputs, work)[tied.n_q : tied.n_q + tied.n_u]
    form = descriptor_form(tied, z, inputs)
    assert form.jacobian.shape == (2 * 7, tied.n_q)
    acceleration, multipliers = form.solve()
    np.testing.assert_allclose(form.to_velocities @ acceleration, rates, atol=1e-9 * np.abs(rates).max())
    # the paper's multipliers act with the opposite sign; the norm condition transmits nothing
    np.testing.assert_allclose(-multipliers[:12], work.multipliers, atol=1e-8 * np.abs(work.multipliers).max())
    np.testing.assert_allclose(multipliers[12:], 0.0, atol=1e-8 * np.abs(work.multipliers).max())


def test_trajectories_agree_over_twenty_seconds_and_constraints_hold():
    rng = np.random.default_rng(2)
    embedded, y, tied, z = state_pair(rng, 0.05)
    one, two = loads_pair(rng, embedded, tied)
    runs = []
    for system, state, inputs in ((embedded, y, one), (tied, z, two)):
        integrator = HammingIntegrator(system, 0.000625)
        for mine, given in zip(integrator.inputs, inputs, strict=True):
            mine[:] = given[0]
        integrator.start(state)
        integrator.advance(32000)
        runs.append(integrator.state.copy())
    for body in (0, 2, 3):
        i, j = embedded.index(body, "elastic_q"), tied.index(body, "elastic_q")
        np.testing.assert_allclose(runs[1][j : j + 3], runs[0][i : i + 3], atol=1e-6 * np.abs(runs[0][:10]).max())
    position, _ = tied.constraint_residuals(runs[1])
    assert np.abs(position).max() < 1e-6
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


def slide_at(angle):
    """Position of the slider x = r cos φ + √(l² − r² sin² φ)."""
    return CRANK * np.cos(angle) + np.sqrt(ROD**2 - (CRANK * np.sin(angle)) ** 2)


def test_slider_follows_its_crank():
    """A heavy flywheel keeps its speed."""
    system, y = slider_crank(1e6)
    integrator = HammingIntegrator(system, 0.001)
    integrator.start(y)
    integrator.advance(1000)
    angle, slide = integrator.state[0], integrator.state[1]
    assert angle == pytest.approx(SPEED, rel=1e-4)
    assert slide == pytest.approx(slide_at(angle), abs=1e-7)


def after_a_second(name, system, y, n, **options):
    """Integrator that has taken n steps of 1/n s."""
    integrator = make_integrator(name, system, 1.0 / n, **options)
    integrator.start(y)
    integrator.advance(n)
    return integrator


@pytest.mark.parametrize(
    ("name", "options"),
    [("newmark", {}), ("generalized_alpha", {"rho_inf": 0.8}), ("generalized_alpha", {"rho_inf": 0.0})],
)
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
    assert integrator.state[1] == pytest.approx(slide_at(integrator.state[0]), abs=1e-12)
    assert np.abs(system.constraint_residuals(integrator.state)[0]).max() < 1e-12
    assert sum(system.energy(integrator.state)) == pytest.approx(sum(system.energy(y)), rel=1e-5)


@pytest.mark.parametrize(
    ("name", "options"),
    [("newmark", {}), ("generalized_alpha", {"rho_inf": 0.8}), ("generalized_alpha", {"rho_inf": 0.0})],
)
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
    ("name", "options", "error"),
    [
        ("newmark", {}, 1.1e-3),
        ("generalized_alpha", {"rho_inf": 0.8}, 1.1e-3),
        ("generalized_alpha", {"rho_inf": 0.0}, 7.0e-3),
    ],
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


def test_newmark_with_welded_free_blades_agrees_with_the_embedded_form():
    """Quaternions, servos and multipliers together: the difference between the forms is that of the scheme, h²."""
    rng = np.random.default_rng(2)
    embedded, y, tied, z = state_pair(rng, 0.05)
    one, two = loads_pair(rng, embedded, tied)
    runs = []
    for system, state, inputs in ((embedded, y, one), (tied, z, two)):
        integrator = make_integrator("newmark", system, 0.002)
        for mine, given in zip(integrator.inputs, inputs, strict=True):
            mine[:] = given[0]
        integrator.start(state)
        integrator.advance(500)
        runs.append(integrator.state.copy())
    for body in (0, 2, 3):
        i, j = embedded.index(body, "elastic_q"), tied.index(body, "elastic_q")
        np.testing.assert_allclose(runs[1][j : j + 3], runs[0][i : i + 3], atol=1e-4 * np.abs(runs[0][:10]).max())
    assert np.abs(tied.constraint_residuals(runs[1])[0]).max() < 1e-5


@pytest.mark.parametrize("kwargs", [{"kind": "glue"}, {"axis": (0.0, 2.0, 0.0)}])
def test_bad_constraints_are_refused(kwargs):
    with pytest.raises(MultibodyError):
        Constraint(**kwargs)


def test_constraint_on_a_missing_marker_is_refused():
    system = MultibodySystem()
    body = system.add(FlexibleBody.rigid("a", 1.0, np.zeros(3), np.eye(3)), Joint("free"))
    with pytest.raises(MultibodyError, match="nose"):
        system.add_constraint(Constraint("ball"), None, body, second_marker="nose")
