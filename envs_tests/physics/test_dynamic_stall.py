"""Dynamic stall: tables of the separation point, its motion in time, and its place in the lattice and the simulator."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from envs_tests.physics.cases.airfoils import UniformStream, WingFlow, flat_planform, half_span_edges
from envs_tests.physics.cases.stall import Pitching, lattice_loop, s809_polar
from wt_gym.aerodynamics import TRAINING, AerodynamicsError, AeroOptions
from wt_gym.aerodynamics.lattice.planform import separation_tables
from wt_gym.aerodynamics.lattice.section_kernels import ATTACHED, DRAG, POINT, SEPARATED
from wt_gym.aerodynamics.lattice.separation_kernels import advance_separation, separation_drag
from wt_gym.base.attached_flow import attached_lift
from wt_gym.simulation import FIDELITIES, Simulator
from wt_gym.wind import SteadyInflow

ALPHA = -np.pi + 2.0 * np.pi / 720 * np.arange(720)


def kirchhoff_polar():
    """Polar of Kirchhoff's flow whose separation point moves from 12 to 22 degrees; also that point and the line."""
    slope, arm = 6.0, ALPHA - np.radians(-3.0)
    point = np.clip((np.radians(22.0) - np.abs(arm)) / np.radians(10.0), 0.0, 1.0)
    line = slope * arm
    lift = np.where(np.abs(arm) < np.radians(30.0), line * (0.5 + 0.5 * np.sqrt(point)) ** 2, np.sin(2.0 * ALPHA))
    return np.column_stack([lift, 0.01 + np.sin(ALPHA) ** 2, 0.0 * ALPHA]), point, line


def test_kirchhoffs_flow_is_taken_apart():
    polar, point, line = kirchhoff_polar()
    alpha0, slope = attached_lift(ALPHA, polar[:, 0])
    assert np.degrees(alpha0) == pytest.approx(-3.0, abs=1e-9)
    assert slope == pytest.approx(6.0, rel=1e-9)
    table = separation_tables([polar], monotone=False)[0]
    below = np.abs(ALPHA - alpha0) < np.radians(30.0)
    np.testing.assert_allclose(table[below, POINT], point[below], atol=1e-7)
    np.testing.assert_allclose(table[below, ATTACHED], line[below], atol=1e-9)
    # a plate in fully separated flow keeps a quarter of its lift, half of it where it has just come to be attached
    deep, attached = below & (point == 0.0), below & (point == 1.0)
    np.testing.assert_allclose(table[deep, SEPARATED], 0.25 * line[deep], atol=1e-9)
    np.testing.assert_allclose(table[attached, SEPARATED], 0.5 * line[attached], atol=1e-6)


@pytest.mark.parametrize("polar", [kirchhoff_polar()[0], s809_polar()], ids=["kirchhoff", "S809"])
def test_the_mixture_at_the_static_point_is_the_polar(polar):
    table = separation_tables([polar])[0]
    mixed = table[:, POINT] * table[:, ATTACHED] + (1.0 - table[:, POINT]) * table[:, SEPARATED]
    np.testing.assert_allclose(mixed, polar[:, 0], atol=1e-12)
    assert np.all((table[:, POINT] >= 0.0) & (table[:, POINT] <= 1.0))
    # no memory far from attached flow: a rotor at standstill, air from behind
    far = np.abs(ALPHA) > np.radians(55.0)
    np.testing.assert_array_equal(table[far, ATTACHED], table[far, SEPARATED])
    assert np.all(table[far, DRAG] == 0.0)


def test_fully_separated_lift_does_not_fall():
    """The S809 loses a third of its lift between 17 and 20 degrees: the separation point moves, not this lift."""
    near = np.abs(ALPHA - attached_lift(ALPHA, s809_polar()[:, 0])[0]) < np.radians(39.5)
    published, own = (separation_tables([s809_polar()], monotone)[0][near] for monotone in (False, True))
    assert np.diff(published[:, SEPARATED]).min() < -0.02
    assert np.diff(own[:, SEPARATED]).min() >= 0.0
    assert np.diff(own[:, ATTACHED]).min() > 0.0
    assert np.all(np.abs(own[:, SEPARATED]) <= np.abs(published[:, SEPARATED]) + 1e-12)


def test_fine_steps_bring_no_jumps():
    """With the published tables the lift jumps by 1.3 in one of these steps, where the circulation has two answers."""
    lift = lattice_loop(Pitching(np.radians(20.0), np.radians(10.0), 0.077), s809_polar(), 8, dynamic_stall="oye")[1]
    assert np.abs(np.diff(lift)).max() < 0.1


def test_a_cylinder_has_no_attached_flow():
    polar = np.column_stack([0.0 * ALPHA, 0.5 + 0.0 * ALPHA, 0.0 * ALPHA])
    assert attached_lift(ALPHA, polar[:, 0]) is None
    assert np.all(separation_tables([polar]) == 0.0)


def moving_point(static_of_step, dt, before=None):
    """Separation points after steps of ``dt`` (a sequence) in which the static point takes the given values."""
    alpha = np.linspace(-np.pi, np.pi, 8, endpoint=False)
    table = np.zeros((1, alpha.size, 4))
    table[0, :, POINT] = np.linspace(0.0, 1.0, alpha.size)  # linear in alpha: every static point has an angle
    angle_of = lambda f: -np.pi + f * (alpha[-1] + np.pi)  # noqa: E731
    p = SimpleNamespace(chord=np.array([2.0]), separation=table)
    o = SimpleNamespace(separation_lag=4.0)
    start = static_of_step[0] if before is None else before
    a = SimpleNamespace(alpha=np.zeros(1), speed=np.array([30.0]), dt=np.zeros(1), last_dt=np.zeros(1),
                        separation=np.array([[start], [static_of_step[0]]]))  # fmt: skip
    points = []
    for static, step in zip(static_of_step, dt, strict=True):
        a.alpha[0], a.dt[0] = angle_of(static), step
        advance_separation.py_func(p, o, a)
        a.last_dt[0] = step
        points.append(a.separation[0, 0])
    return np.array(points)


def test_step_response_of_the_separation_point_is_exact():
    """Its distance from the static point falls by exp(-dt V / (A c)) in each step, whatever the steps."""
    dt = np.array([0.01, 0.05, 0.1, 0.1, 0.3, 0.02, 1.0])
    points = moving_point([0.2] * dt.size, dt, before=0.9)
    np.testing.assert_allclose(points, 0.2 + 0.7 * np.exp(-np.cumsum(dt) * 30.0 / (4.0 * 2.0)), rtol=1e-12)


def test_a_steady_ramp_of_the_static_point_is_followed_exactly():
    """df/dt = (g t - f) / tau from f(0) = 0: f = g (t - tau + tau exp(-t / tau))."""
    dt, tau, rate = np.full(12, 0.07), 4.0 * 2.0 / 30.0, 0.9
    time = np.cumsum(dt)
    points = moving_point(rate * (time - dt[0]), dt)
    lag = tau * -np.expm1(-time / tau)
    # the first step does not know the slope yet; what it misses dies away
    missed = rate * (dt[0] - tau * -np.expm1(-dt[0] / tau)) * np.exp(-(time - dt[0]) / tau)
    np.testing.assert_allclose(points, rate * (time - lag) - missed, atol=1e-12)


def test_the_separation_point_stays_on_the_chord():
    points = moving_point([0.0, 0.0, 1.0, 1.0, 0.0, 0.0, 1.0], [0.5] * 7)
    assert points.min() >= 0.0
    assert points.max() <= 1.0


def test_drag_of_the_separated_flow():
    """None when static; up to a quarter less than the polar's while the flow of a stalled angle is still attached."""
    polar, point, _ = kirchhoff_polar()
    table = separation_tables([polar], monotone=False)[0]
    stalled = np.radians(24.0)
    rise = np.interp(stalled, ALPHA, polar[:, 1]) - np.interp(np.radians(-3.0), ALPHA, polar[:, 1])
    assert separation_drag.py_func(table, 1.0, stalled) == pytest.approx(-0.25 * rise, rel=1e-6)
    assert separation_drag.py_func(table, 0.0, stalled) == 0.0
    assert separation_drag.py_func(table, -1.0, stalled) == 0.0
    partly = np.radians(14.0)
    assert separation_drag.py_func(table, np.interp(partly, ALPHA, point), partly) == pytest.approx(0.0, abs=1e-9)


def stalled_wing(**options):
    """State of a partly stalled wing of aspect ratio 12, 40 chords after its start."""
    planform = flat_planform(half_span_edges(6.0, 6), 1.0, 1, polar=kirchhoff_polar()[0])
    flow = WingFlow(planform, UniformStream.at_incidence(np.radians(14.0)), 40, 1.0, viscous=True, **options)
    flow.start_moving(flow.nodes, flow.still)
    for _ in range(40):
        flow.step()
    return flow.state


def test_a_steady_stalled_wing_is_that_of_the_polar():
    state = stalled_wing(dynamic_stall="oye")
    polar, point, _ = kirchhoff_polar()
    alpha, speed = state.angle_of_attack[0], state.section_speed[0]
    assert 0.5 < point[np.searchsorted(ALPHA, alpha.max())] < 0.9  # partly separated, before the lift falls
    static = np.interp(alpha, ALPHA, separation_tables([polar])[0][:, POINT])
    np.testing.assert_allclose(state.separation_point[0], static, atol=2e-3)
    lift = 2.0 * state.circulation[0] / speed
    np.testing.assert_allclose(lift, np.interp(alpha, ALPHA, polar[:, 0]), atol=5e-3)


def test_the_separation_point_takes_the_place_of_the_lagging_decambering():
    one, other = (stalled_wing(dynamic_stall="oye", stall_lag=lag) for lag in (0.0, 5.0))
    np.testing.assert_array_equal(one.circulation, other.circulation)
    assert np.all(stalled_wing().separation_point < 0.0)


def test_a_simulation_starts_with_static_points():
    fidelity = replace(FIDELITIES["training"], aero=replace(TRAINING, dynamic_stall="oye"))
    sim = Simulator("nrel_5mw", SteadyInflow(15.0, shear_exponent=0.2), fidelity)
    sim.reset(rotor_speed=1.2, pitch=0.0)
    aero = sim.coupling.aero
    tables = sim.lattice.arrays.separation
    static = [[np.interp(x, ALPHA, t[:, POINT]) for x, t in zip(row, tables, strict=True)]
              for row in aero.angle_of_attack]  # fmt: skip
    np.testing.assert_allclose(aero.separation_point, static, atol=1e-9)
    sim.advance(1.0, pitch=0.2, generator_torque=43e3)
    assert np.abs(aero.separation_point - static).max() > 0.02


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"dynamic_stall": "gormont"}, "dynamic_stall must be one of oye or None"),
        ({"dynamic_stall": "oye", "viscous": False}, "viscous=True"),
    ],
)
def test_refusals(change, message):
    with pytest.raises(AerodynamicsError, match=message):
        AeroOptions(**change)
