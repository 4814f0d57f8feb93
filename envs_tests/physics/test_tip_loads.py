"""Loads of single strips at tips: against exact solutions, with polars of thin airfoils, where the chord is bent."""

from dataclasses import replace

import numpy as np
import pytest

from envs_tests.physics.cases.airfoils import flat_planform, half_span_edges, steady_wing
from envs_tests.physics.cases.rotor import RigidRotor
from envs_tests.physics.cases.wings import (
    NARROW,
    PITCH,
    ROOT,
    RUNGS,
    blade_strips,
    helix_induction,
    lifting_line_blade,
    lifting_surface,
    middles,
    optimum_circulation,
    outermost_strips,
    rung_edges,
    through_strips,
    turbine_strips,
    wing_strips,
)
from wt_gym.aerodynamics import AerodynamicsError, build_planform
from wt_gym.aerodynamics.options import TRAINING
from wt_gym.simulation.model.blade_lattice import blade_planform
from wt_gym.turbines import load_turbine


def test_strips_of_a_rectangular_wing():
    exact = lifting_surface(10.0, np.ones_like, 40, 6)
    edges = rung_edges(TRAINING, 0.0, 10.0, (0.0, 0.25))
    ratio = wing_strips(edges, TRAINING.n_chord) / exact(middles(edges))
    np.testing.assert_allclose(ratio[:-1], 1.0, atol=0.01)
    assert ratio[-1] == pytest.approx(1.0, abs=0.03)


def test_outermost_strips_are_the_exact_solution_of_an_even_lattice():
    """No downwash at the middles between the vortices, beyond what the first 4000 leave out."""
    j = np.arange(4000)
    circulation = outermost_strips(4000) * np.sqrt(j + 0.75)
    vortices = np.diff(circulation, prepend=0.0)
    for place in (0.5, 1.5, 7.5):
        single = 1.0 / (place - j)
        # vortices far away are half of the inverse root of their distance
        rest = -0.5 * np.log((np.sqrt(4000.0) + np.sqrt(place)) / (np.sqrt(4000.0) - np.sqrt(place))) / np.sqrt(place)
        assert vortices @ single + rest == pytest.approx(0.0, abs=1e-4)


def test_helix_induction_is_that_of_many_short_segments():
    helix, pitch, n_blades = 0.9, PITCH, 3
    angle = np.r_[np.linspace(0.0, 0.3, 600), np.arange(0.301, 240.0 * np.pi, 0.02)]
    for radius in (0.5, 0.97):
        total = np.zeros(3)
        for blade in range(n_blades):
            turned = angle + 2.0 * np.pi * blade / n_blades
            points = np.column_stack([pitch * angle, helix * np.sin(turned), helix * np.cos(turned)])
            to = [0.0, 0.0, radius] - 0.5 * (points[1:] + points[:-1])
            total += (np.cross(np.diff(points, axis=0), to) / np.linalg.norm(to, axis=1)[:, None] ** 3).sum(axis=0)
        axial, turning = helix_induction(np.array([radius]), helix, pitch, n_blades)
        np.testing.assert_allclose(-total[:2] / (4.0 * np.pi), [axial[0], turning[0]], atol=2e-3)


def test_optimum_circulation_tends_to_that_of_prandtl():
    pitch, radius = 1.0 / 40.0, np.array([0.6, 0.8, 0.9, 0.95])
    tip = 2.0 / np.pi * np.arccos(np.exp(-1.5 * (1.0 - radius) * np.sqrt(1.0 + 1.0 / pitch**2)))
    expected = 2.0 * np.pi * pitch / 3.0 * radius**2 / (radius**2 + pitch**2) * tip
    np.testing.assert_allclose(optimum_circulation(ROOT, pitch, 3)(radius), expected, rtol=1e-3)


def test_strips_of_narrow_blades_are_those_of_a_lifting_line():
    edges = rung_edges(TRAINING, ROOT, 1.0)
    ratio = blade_strips(edges, TRAINING.n_chord, NARROW) / lifting_line_blade(NARROW, ROOT, PITCH, 3)(middles(edges))
    np.testing.assert_allclose(ratio[-5:-1], 1.0, atol=0.005)
    assert ratio[-1] == pytest.approx(1.0, abs=0.02)


def test_strips_at_the_tip_of_a_turbine_are_those_of_a_fine_lattice():
    """The chord of the 5-MW has a kink within the outermost strip."""
    turbine = load_turbine("nrel_5mw")
    place, best = turbine_strips(turbine, replace(TRAINING, n_span=40, squire=1e-3))
    fine = through_strips(place, best.circulation, 2.0 * place[0] - place[1])
    for rung in ("training", "engineering"):
        place, flow = turbine_strips(turbine, replace(RUNGS[rung], squire=1e-3))
        np.testing.assert_allclose(flow.circulation[place > 0.85] / fine(place[place > 0.85]), 1.0, atol=0.015)


# ---- polars of thin airfoils change nothing ----


@pytest.mark.parametrize("n_chord", [1, 3])
def test_polar_of_a_flat_plate_leaves_an_elliptic_wing_alone(n_chord):
    """Aspect ratio 2: the downwash is strongly curved along the chord, most of all at the tip."""
    edges = half_span_edges(1.0, 12)
    chord = 4.0 / np.pi * np.sqrt(1.0 - edges**2)
    planform = flat_planform(edges, chord, n_chord, 0.5)
    _, linear, _ = steady_wing(planform, 0.1)
    _, fed_back, _ = steady_wing(planform, 0.1, viscous=True)
    np.testing.assert_allclose(fed_back.circulation, linear.circulation, rtol=2e-5)
    np.testing.assert_allclose(fed_back.nodal_forces, linear.nodal_forces, atol=2e-5 * linear.nodal_forces.max())


# ---- polars refer to the chord of the strip, the lattice has that of its rings ----


def long_wing(strip_chord, n_chord=2, zero_lift=0.0, moment=0.0, camber=None):
    """A half wing of aspect ratio 4000 with rings of chord one, mirrored, whose polars refer to another chord."""
    edges = np.array([0.0, 800.0, 1600.0, 2000.0])
    angles = np.linspace(-np.pi, np.pi, 720, endpoint=False)
    polar = np.column_stack([2.0 * np.pi * np.sin(angles - zero_lift), 0.0 * angles, moment + 0.0 * angles])
    one, axis = np.ones(4), np.column_stack([0.0 * edges, 0.0 * edges, edges])
    polars = np.tile(polar, (3, 1, 1))
    return build_planform(edges, axis, one, 0.0 * one, 0.25 * one, polars, n_chord, camber, np.full(3, strip_chord))


@pytest.mark.parametrize("strip_chord", [0.85, 1.0, 1.2])
def test_circulation_and_angle_of_a_strip_go_with_the_chord_of_its_polar(strip_chord):
    _, state, _ = steady_wing(long_wing(strip_chord), 0.1, viscous=True)
    assert state.angle_of_attack[0, 0] == pytest.approx(0.1, rel=2e-3)
    assert state.circulation[0, 0] == pytest.approx(np.pi * strip_chord * np.sin(0.1), rel=2e-3)


@pytest.mark.parametrize("strip_chord", [0.85, 1.2])
def test_moment_at_zero_lift_goes_with_the_chord_of_the_polar(strip_chord):
    """A cambered lattice has a moment of its own, which that of the polar replaces."""

    def camber(span, x):
        return 0.16 * x * (1.0 - x), 0.16 * (1.0 - 2.0 * x)

    own = long_wing(1.0, 4, camber=camber)
    assert own.moment0_lattice[0] < -0.05
    zero_lift = own.alpha0_lattice[0]
    planform = long_wing(strip_chord, 4, zero_lift, -0.02, camber)
    _, state, _ = steady_wing(planform, zero_lift, viscous=True)
    force, place = state.nodal_forces[0], planform.nodes
    moment = -(force[..., 0] * place[..., 1] - force[..., 1] * place[..., 0])[:, 0].sum() / 400.0
    assert moment == pytest.approx(0.5 * strip_chord**2 * -0.02, abs=5e-4)


def test_strips_of_a_turbine_have_their_mean_chord():
    blade, planform = load_turbine("nrel_5mw").blade, blade_planform(load_turbine("nrel_5mw"), TRAINING)
    low, high = planform.span_edges[-2:]
    assert planform.chord[-1] == pytest.approx(blade.chord_at(np.linspace(low, high, 2001)).mean(), rel=2e-3)
    assert planform.ring_chord[-1] == pytest.approx(0.5 * (blade.chord_at(low) + blade.chord_at(high)))


def test_edges_without_chord_are_refused():
    planform = long_wing(1.0)
    with pytest.raises(AerodynamicsError, match="one must be positive"):
        replace(planform, edge_chord=np.array([1.0, 1.0, 0.0, 0.0]))


def test_forces_of_strips_are_not_smeared_out():
    """Nodes carry half of either strip beside them; across the sections the strips still have their own forces."""
    turbine = load_turbine("nrel_5mw")
    rotor = RigidRotor.of_turbine(turbine, TRAINING)
    run = rotor.run(TRAINING, 8.0, 7.55 * 8.0 / rotor.radius, 0.0, 1.0)
    inflow = run.alpha + turbine.blade.twist_at(middles(rotor.planform.span_edges))
    lift, drag = rotor.air_density * run.circulation * run.speed, run.coefficients[:, 1]
    along = lift * np.cos(inflow)
    along += 0.5 * rotor.air_density * run.speed**2 * rotor.planform.chord * drag * np.sin(inflow)
    np.testing.assert_allclose(run.force[3:, 0], along[3:], rtol=0.015)
    assert 3.0 * run.force[:, 0] @ np.diff(rotor.planform.span_edges) == pytest.approx(run.thrust[-1], rel=2e-3)
