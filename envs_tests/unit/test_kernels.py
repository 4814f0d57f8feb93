"""Single kernels on small arrays against closed forms: what a wrong sign, factor or index changes at once.

They also run uncompiled, as `scripts/mutate_kernels.py` does.
"""

from collections import namedtuple

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from wt_gym.aerodynamics.lattice.bound_kernels import geometry
from wt_gym.aerodynamics.lattice.load_kernels import bernoulli_loads, joukowski_loads
from wt_gym.aerodynamics.wake.wake_kernels import age_rows, convect, place_newest_row, shedding_edge
from wt_gym.multibody.system import Constraint, Joint, MultibodySystem
from wt_gym.multibody.tree.rate_kernels import position_rates, prescribe_servos
from wt_gym.multibody.tree.rotation_kernels import quaternion_rotation, rotation_exp, tangent_bias
from wt_gym.multibody.tree.tree_kernels import SPHERICAL
from wt_gym.simulation.step.coupling_kernels import rotor_resultant, signed_clearance, tip_deflection, view_from_tower
from wt_gym.simulation.step.energy_kernels import wind_at_disc
from wt_gym.simulation.step.measurement_kernels import (
    PER_BLADE,
    ROTOR_SPEED,
    SINGLE,
    TOWER_BASE_FORE_AFT,
    TOWER_BASE_SIDE_SIDE,
    TOWER_TOP_FORE_AFT,
    TOWER_TOP_SIDE_SIDE,
    _rotor,
    _tower,
)
from wt_gym.simulation.step.wind_kernels import points_ahead
from wt_gym.structure.flexible_body import FlexibleBody


def exponential(t):
    rot, tangent = np.zeros((3, 3)), np.zeros((3, 3))
    rotation_exp(t, rot, tangent)
    return rot, tangent


class TestRotations:
    vectors = (np.array([0.4, -0.9, 0.6]), np.array([2e-5, 1e-5, -3e-5]))

    @pytest.mark.parametrize("t", vectors)
    def test_rotation_vectors(self, t):
        rot, tangent = exponential(t)
        np.testing.assert_allclose(rot, Rotation.from_rotvec(t).as_matrix(), atol=1e-12)
        td, h = np.array([0.3, 0.5, -0.7]), 1e-6
        rate = (exponential(t + h * td)[0] - exponential(t - h * td)[0]) / (2.0 * h) @ rot.T
        np.testing.assert_allclose(tangent @ td, [rate[2, 1], rate[0, 2], rate[1, 0]], atol=1e-8)

    @pytest.mark.parametrize("t", [*vectors, np.array([0.05, 0.06, -0.02])])
    def test_acceleration_of_a_rotation_vector_with_constant_rate(self, t):
        td, out, h = np.array([0.3, 0.5, -0.7]), np.zeros(3), 1e-4
        tangent_bias(t, td, out)
        change = (exponential(t + h * td)[1] - exponential(t - h * td)[1]) / (2.0 * h)
        np.testing.assert_allclose(out, change @ td, atol=1e-6)

    def test_quaternions(self):
        q, rot = np.array([0.5, 0.1, -0.7, 0.3]), np.zeros((3, 3))
        quaternion_rotation(q, rot)
        np.testing.assert_allclose(rot, Rotation.from_quat(q[[1, 2, 3, 0]]).as_matrix(), atol=1e-12)

    def test_rates_of_quaternions(self):
        q, spin, dy, h = np.array([0.5, 0.1, -0.7, 0.5]), np.array([0.3, -0.4, 0.8]), np.zeros(4), 1e-6
        q /= np.linalg.norm(q)
        first = np.zeros(1, dtype=np.int64)
        position_rates(q, spin, np.full(3, -1), np.array([SPHERICAL]), first, first, dy)
        turned = (Rotation.from_quat(q[[1, 2, 3, 0]]) * Rotation.from_rotvec(h * spin)).as_quat()[[3, 0, 1, 2]]
        turned *= np.sign(turned @ q)
        np.testing.assert_allclose(dy, (turned - q) / h, atol=1e-5)


Servos = namedtuple("Servos", ["servo_rate", "servo_interval", "servo_command"])


def test_a_prescribed_servo_ends_on_its_command_and_its_rate_is_that_of_its_angle():
    length = 0.4
    inputs = Servos(np.array([[0.2], [0.7]]), np.full((2, 1), length), np.array([[0.0], [1.3]]))

    def state(tau):
        y = np.zeros(2)
        prescribe_servos(y, tau, inputs, 0)
        return y

    assert state(0.0)[1] == pytest.approx(0.2)
    assert state(1.0) == pytest.approx([1.3, 0.7])
    assert state(0.25)[1] == pytest.approx(0.2 + 0.5 * (10 * 0.25**3 - 15 * 0.25**4 + 6 * 0.25**5))
    for tau in (0.2, 0.5, 0.9):
        slope = (state(tau + 1e-5)[0] - state(tau - 1e-5)[0]) / (2e-5 * length)
        assert slope == pytest.approx(state(tau)[1], rel=1e-6)


def test_a_geared_rotor_and_a_damper_slow_a_wheel():
    """(J + n² j) α = M − c ω about a fixed axis."""
    system = MultibodySystem(gravity=(0.0, 0.0, 0.0))
    wheel = FlexibleBody.rigid("wheel", 1.0, np.zeros(3), np.diag([0.6, 0.6, 2.0]))
    joint = Joint("revolute", (0.0, 0.0, 1.0), damping=0.3, rotor_inertia=0.05, rotor_ratio=-10.0, name="turn")
    system.add(wheel, joint)
    system.build()
    y, inputs = system.initial_state(), system.new_inputs()
    y[1] = 1.5
    inputs.dof_force[:] = 4.0
    inputs.reference_rate[:] = 0.2
    assert system.rates(y, inputs)[1] == pytest.approx((4.0 - 0.3 * (1.5 - 0.2)) / (2.0 + 100.0 * 0.05))


# ---- lattice ---------------------------------------------------------------------------------------------------------

DENSITY = 1.2


def flat_wing(n_chord, width=3.0, chord=2.0):
    """Ring nodes of a plate along z with the stream along y, its points, normals and areas."""
    nodes = np.zeros((1, n_chord + 1, 2, 3))
    nodes[0, :, :, 1] = np.linspace(0.0, chord, n_chord + 1)[:, None]
    nodes[0, :, 1, 2] = width
    points = np.zeros((3, n_chord + n_chord + 2 * n_chord))
    normal, area = np.zeros((n_chord, 3)), np.zeros(n_chord)
    geometry(nodes, n_chord, points, normal, area)
    return nodes, points, normal, area


def loads(form, n_chord, gamma, rate, stream=(0.0, 30.0, 0.0)):
    """Forces at the nodes of a plate whose trailing edge sheds a wake."""
    nodes, points, normal, area = flat_wing(n_chord)
    forces = np.zeros_like(nodes)
    flow = np.repeat(np.array(stream)[:, None], points.shape[1], axis=1)
    form(nodes, np.reshape(gamma, (1, n_chord, 1)), np.asarray(rate, dtype=float), flow, normal, area, DENSITY, True,
         False, forces)  # fmt: skip
    return nodes, forces


def test_geometry_of_a_plate():
    _, points, normal, area = flat_wing(2)
    np.testing.assert_allclose(normal, [[1.0, 0.0, 0.0]] * 2)
    np.testing.assert_allclose(area, 3.0)
    np.testing.assert_allclose(points[:, :2].T, [[0.0, 0.5, 1.5], [0.0, 1.5, 1.5]])
    np.testing.assert_allclose(points[:, 2:4].T, [[0.0, 0.0, 1.5], [0.0, 1.0, 1.5]])
    np.testing.assert_allclose(points[:, 4:].T, [[0.0, 0.5, 0.0], [0.0, 0.5, 3.0], [0.0, 1.5, 0.0], [0.0, 1.5, 3.0]])


@pytest.mark.parametrize("form", [joukowski_loads, bernoulli_loads])
@pytest.mark.parametrize("n_chord", [1, 2, 4])
def test_lift_of_a_bound_vortex_is_that_of_kutta_and_joukowski(n_chord, form):
    """Rings of equal strength leave one vortex at the leading side: ρ V Γ b, towards the suction side."""
    _, forces = loads(form, n_chord, np.full(n_chord, 5.0), np.zeros(n_chord))
    np.testing.assert_allclose(forces.sum(axis=(0, 1, 2)), [DENSITY * 30.0 * 5.0 * 3.0, 0.0, 0.0], atol=1e-9)
    if form is joukowski_loads:
        np.testing.assert_allclose(forces[0, 1:], 0.0, atol=1e-9)


@pytest.mark.parametrize("form", [joukowski_loads, bernoulli_loads])
def test_pressure_of_a_changing_circulation(form):
    """ρ A dΓ/dt on each ring along its normal, at its middle; on half of the last one, which reaches past the edge."""
    for ring, part in ((0, 1.0), (1, 1.0), (2, 0.5)):
        rate = np.zeros(3)
        rate[ring] = 7.0
        nodes, forces = loads(form, 3, np.zeros(3), rate)
        size = DENSITY * 2.0 * 7.0 * part
        np.testing.assert_allclose(forces.sum(axis=(0, 1, 2)), [size, 0.0, 0.0], atol=1e-12)
        at = (forces[..., 0] * nodes[..., 1]).sum() / size * 1.5 - ring  # in panel chords from the start of the ring
        assert at == pytest.approx(0.25 if form is bernoulli_loads or ring == 2 else 0.5)


def test_the_wake_leaves_at_the_trailing_edge_and_continues_behind_it():
    nodes, edge = flat_wing(2)[0], np.zeros((1, 2, 3))
    shed = np.array([4, 5])
    shedding_edge(nodes, shed, edge)
    np.testing.assert_allclose(edge[0], [[0.0, 1.75, 0.0], [0.0, 1.75, 3.0]])
    wake = np.zeros((2, 1, 2, 3))
    wake[0] = edge
    for way, place in ((2.0, 1.75 + 0.25 * 2.0), (-2.0, 1.75 + 0.25 * 2.0)):  # reversed flow: as far behind the edge
        free = edge + np.array([0.4, way, 0.0])
        place_newest_row(nodes, shed, free, 0.25, wake)
        np.testing.assert_allclose(wake[1, 0], [[0.1, place, 0.0], [0.1, place, 3.0]])


def test_points_ahead_are_exact_for_a_steady_acceleration():
    dt, velocity = 0.1, np.array([[1.0, -2.0, 3.0]])
    earlier = velocity - dt * np.array([[0.5, 0.2, -1.0]])
    points = np.zeros((2, 3))
    points_ahead(np.array([[4.0, 5.0, 6.0]]), velocity, earlier, dt, points)
    expected = np.array([4.0, 5.0, 6.0]) + dt * velocity[0] + 0.5 * dt**2 * np.array([0.5, 0.2, -1.0])
    np.testing.assert_allclose(points, [expected, [0.0, 0.0, 0.0]])
    np.testing.assert_array_equal(earlier, velocity)


Air = namedtuple("Air", ["n_rows", "wake", "wind", "induced", "history"])


def test_the_wake_moves_with_wind_and_induction_by_adams_and_bashforth():
    """Exact for a velocity that is linear in time, also where the step changes; the newest row takes an Euler step."""
    last, now, ratio = 0.2, 0.1, 0.5
    wake, history = np.zeros((3, 1, 1, 3)), np.full((3, 1, 1, 3), 1.0)
    wind, induced = np.full((3, 1, 1, 3), 5.0), np.full((3, 1, 1, 3), -2.0, dtype=np.float32)
    convect(Air(np.array([2]), wake, wind, induced, history), now, ratio)
    np.testing.assert_allclose(wake[0], now * 3.0)
    np.testing.assert_allclose(wake[1:], now * 3.0 + 0.5 * now**2 * (3.0 - 1.0) / last)
    np.testing.assert_allclose(history, 3.0)


Ages = namedtuple(
    "Ages", ["n_rows", "wake", "wake_gamma", "age", "shed", "volume", "induced", "history", "wind", "n_steps"]
)
Thinning = namedtuple("Thinning", ["coarse_stride", "full_rows", "sparse_stride", "sparse_from", "shed_fraction"])


def test_a_thinned_wake_keeps_its_circulation():
    """What was shed is ∫ Γ dt over the rings, whichever rows have left; the newest row is a quarter of a step old."""
    dt, n = 0.5, 9
    flow = [np.zeros((n + 1, 1, 2, 3)) for _ in range(4)]
    a = Ages(np.array([0]), flow[0], np.zeros((n, 1, 1)), np.zeros(n + 1), np.zeros(n + 1, dtype=np.int64),
             np.zeros((n + 1, 1, 2, 2)), *flow[1:], np.zeros(1, dtype=np.int64))  # fmt: skip
    o = Thinning(3, 2, 1, 100, 0.25)
    given = 0.0
    for step in range(1, 16):
        a.n_steps[0] = step
        a.wake[0] = step
        a.n_rows[0] = age_rows(a, o, dt)
        rows = a.n_rows[0]
        a.wake_gamma[0] = 10.0 + step**2
        given += 10.0 + step**2
        assert a.age[:2] == pytest.approx([0.0, 0.25 * dt])
        np.testing.assert_allclose(a.wake[1 : rows + 1, 0, 0, 0], a.shed[1 : rows + 1])
    assert rows < n
    assert (a.shed[3:rows] % 3 == 0).all()  # the last row is where the wake began
    kept = a.wake_gamma[1:rows, 0, 0] @ np.diff(a.age[1 : rows + 1])
    assert kept == pytest.approx((given - a.wake_gamma[0, 0, 0]) * dt)


def pendulum(tied):
    """Two rigid links about skew axes, the second one jointed or tied by constraint equations."""
    system = MultibodySystem()
    first = FlexibleBody.rigid(
        "first", 2.0, (0.1, 0.0, 0.3), np.diag([0.5, 0.4, 0.3]), {"end": np.array([0.2, 0.0, 0.7])}
    )
    second = FlexibleBody.rigid("second", 1.0, (0.0, 0.2, 0.4), np.diag([0.3, 0.2, 0.2]), {"root": np.zeros(3)})
    first = system.add(first, Joint("revolute", (0.48, 0.8, 0.36), name="swing"))
    place = {"rotation": Rotation.from_euler("xz", [0.4, 0.2]).as_matrix(), "offset": (0.05, 0.1, 0.0)}
    if tied:
        second = system.add(second, Joint("free", name="place"))
        system.add_constraint(Constraint("weld", name="tie", **place), first, second, "end", "root")
    else:
        system.add(second, Joint("fixed", **place), first, "end")
    return system.build()


def test_a_tied_body_moves_as_a_jointed_one():
    accelerations = []
    for tied in (False, True):
        system = pendulum(tied)
        y, work = system.initial_state(), system.new_work()
        y[system.index(0, "joint_q")], y[system.n_q + system.index(0, "joint_u")] = 0.7, 2.5
        if tied:
            system.place_free_bodies(y)
        accelerations.append(system.rates(y, system.new_inputs(), work)[system.n_q + system.index(0, "joint_u")])
    assert np.abs(work.residual).max() < 1e-13
    assert np.abs(work.residual_rate).max() < 1e-12
    assert accelerations[1] == pytest.approx(accelerations[0], rel=1e-9)


def test_rows_of_a_constraint_are_rates_of_each_other_also_where_it_is_violated():
    """φ̇ = B u everywhere; of the position dφ/dt = φ̇, and dφ̇/dt = γ for constant u."""
    system = pendulum(True)
    rng, n = np.random.default_rng(5), system.n_q
    y = system.initial_state()
    y[: n + system.n_u] += 0.4 * rng.standard_normal(n + system.n_u)
    quaternion = slice(system.index(1, "joint_q") + 3, system.index(1, "joint_q") + 7)
    y[quaternion] /= np.linalg.norm(y[quaternion])

    def rows(state):
        work = system.new_work()
        motion = system.rates(state, system.new_inputs(), work)[:n]
        return work, motion

    work, motion = rows(y)
    h, step = 1e-5, np.zeros_like(y)
    step[:n] = motion
    ahead, behind = rows(y + h * step)[0], rows(y - h * step)[0]
    np.testing.assert_allclose(work.jacobian @ y[n : n + system.n_u], work.residual_rate, atol=1e-12)
    rate = (ahead.residual[:3] - behind.residual[:3]) / (2.0 * h)
    np.testing.assert_allclose(rate, work.residual_rate[:3], atol=1e-8)
    change = (ahead.residual_rate[:3] - behind.residual_rate[:3]) / (2.0 * h)
    np.testing.assert_allclose(change, work.gamma[:3], atol=1e-7)


# ---- between blades, tower and signals -------------------------------------------------------------------------------


def test_mean_wind_over_the_disc():
    """By the shares of the nodes, of all blades: |V|³ and |V|² with all three components."""
    wind = np.zeros((2, 3, 2, 3))
    wind[:, 0, :] = [[[2.0, 1.0, 2.0], [0.0, 0.0, 0.0]], [[0.0, 0.0, 0.0], [0.0, 4.0, 0.0]]]
    assert wind_at_disc(wind, np.array([0.25, 0.75])) == pytest.approx(
        (0.125 * 27 + 0.375 * 64, 0.125 * 9 + 0.375 * 16)
    )


def test_thrust_and_torque_of_forces_at_the_blades():
    rng = np.random.default_rng(3)
    nodes, forces = rng.standard_normal((2, 2, 4, 3))
    center, axis = np.array([1.0, 2.0, 3.0]), np.array([0.6, 0.48, 0.64])
    moment = np.cross(nodes - center, forces).sum(axis=(0, 1))
    assert rotor_resultant(nodes, forces, center, axis) == pytest.approx(
        (forces.sum(axis=(0, 1)) @ axis, moment @ axis)
    )


@pytest.mark.parametrize(
    ("view", "expected"),
    [
        ((5.0, 0.0, -9.0, 2.0), 3.0), ((3.0, -4.0, -9.0, 2.0), 3.0), ((-5.0, 3.0, -9.0, 2.0), 1.0),
        ((-5.0, 0.0, -9.0, 2.0), -7.0), ((5.0, 0.0, 4.0, 2.0), 5.0),
    ],
)  # fmt: skip
def test_clearance(view, expected):
    assert signed_clearance(np.array(view)) == pytest.approx(expected)


def test_view_of_a_tip_from_a_bent_tower():
    """Heading 90° to the left; the tower leans by 1 m to x at its top and tapers from 3 m to 1 m of radius."""
    out = np.zeros(4)
    base, top = np.zeros(3), np.array([1.0, 0.0, 80.0])
    view_from_tower(np.array([2.5, -6.0, 40.0]), base, top, np.array([0.0, 0.9, 0.1]), np.array([0.0, 20.0, 80.0]),
                    np.array([3.0, 2.5, 1.0]), out)  # fmt: skip
    np.testing.assert_allclose(out, [6.0, -2.0, -40.0, 2.0])


def test_tip_deflection_does_not_see_the_pitch():
    """A pitched blade without deflection: its tip turns with the root, and what is left is the bending in hub axes."""
    hub, cone = Rotation.from_euler("xz", [0.3, 0.2]).as_matrix(), Rotation.from_euler("y", 0.05).as_matrix()
    root, rest, bent = np.array([1.0, 2.0, 3.0]), np.array([0.4, 0.2, 60.0]), np.array([3.0, -0.5, -0.1])
    pitch, out = 0.3, np.zeros(3)
    turned = np.array([[np.cos(pitch), np.sin(pitch), 0.0], [-np.sin(pitch), np.cos(pitch), 0.0], [0.0, 0.0, 1.0]])
    tip = root + hub @ cone @ (turned @ rest + bent)
    tip_deflection(tip, root, hub, cone, rest, pitch, out)
    np.testing.assert_allclose(out, bent, atol=1e-12)


Work = namedtuple("Work", ["r", "rot"])
Signals = namedtuple("Signals", ["wrench", "nacelle", "hub", "nacelle_acceleration", "tower_moves"])
Places = namedtuple("Places", ["tower", "azimuth_q", "azimuth_u", "torsion_q", "torsion_u", "gear_ratio"])
AT = np.arange(1, 1 + len(SINGLE) + len(PER_BLADE))


def read(values, *places):
    return [values[AT[place]] for place in places]


@pytest.mark.parametrize("tilt", [None, (0.0, 0.0, 0.0), (0.8, 0.1, -0.2)])
def test_tower_signals_turn_with_the_nacelle(tilt):
    """A push along the heading bends the tower fore-aft, one to its left side-side, whatever the heading.

    On a floater that is tilted and away from its place the signals are the same, seen from the base of the tower.
    """
    places = Places(0, 0, 0, -1, -1, 97.0)
    base = Rotation.from_euler("ZYX", [0.0, 0.0, 0.0] if tilt is None else tilt)
    foot = np.zeros(3) if tilt is None else np.array([4.0, -2.0, 10.0])
    for heading in (0.0, 0.5, 2.5):
        forward = np.array([np.cos(heading), np.sin(heading), 0.0])
        left = np.array([-np.sin(heading), np.cos(heading), 0.0])
        push = 3e5 * forward + 1e5 * left
        moment = np.cross([0.0, 0.0, 80.0], push)
        nacelle = base * Rotation.from_euler("ZY", [heading, -0.1])
        top = foot + base.apply(0.4 * forward + 0.1 * left + [0.0, 0.0, 80.0])
        work = Work(np.array([foot, top]), np.array([base.as_matrix(), nacelle.as_matrix()]))
        # what the foundation does to the tower keeps it up: minus what the push does
        wrench = np.array([np.concatenate([-push, -moment]), np.zeros(6)])
        gauges = Signals(wrench, 1, 0, np.array([0.3, 0.2, 0.1]), tilt is not None)
        values = np.zeros(len(AT) + 1)
        _tower(work, gauges, places, values, AT)
        found = read(values, TOWER_TOP_FORE_AFT, TOWER_TOP_SIDE_SIDE, TOWER_BASE_FORE_AFT, TOWER_BASE_SIDE_SIDE)
        assert found == pytest.approx([0.4, 0.1, 80.0 * 3e5, -80.0 * 1e5])


def test_speed_of_the_rotor_is_that_of_both_ends_of_the_shaft():
    values = np.zeros(len(AT) + 1)
    gauges = Signals(np.zeros((1, 6)), 0, 0, np.zeros(3), False)
    _rotor(np.array([0.2, 0.1, 1.2, 0.05]), gauges, Places(0, 0, 2, 1, 3, 97.0), values, AT)
    assert read(values, ROTOR_SPEED, ROTOR_SPEED + 1, ROTOR_SPEED + 2) == pytest.approx([1.25, 0.3, 1.2 * 97.0])
