"""Loads of single strips at tips of wings and rotors, with the panels of the fidelities, against exact and fine ones.

Totals hide what happens at a tip. Here every strip outboard of 0.85 of the span is compared at its middle. Wakes are
prescribed, so that nothing but the lattice and its planform counts.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.interpolate import CubicSpline

from validation.case import CaseResult, Check, Curve, Figure, case
from validation.lifting_surfaces import RECTANGULAR, RECTANGULAR_SOURCE
from validation.lifting_tools import flat_planform, steady_wing
from validation.rigid_rotor import RigidRotor
from validation.tip_theory import (
    lifting_line_blade,
    lifting_surface,
    optimum_circulation,
    outermost_strips,
)
from wt_gym.aerodynamics import AeroOptions, VortexLattice, build_planform, span_distribution
from wt_gym.aerodynamics.options import ENGINEERING, REFERENCE, TRAINING
from wt_gym.simulation.models import TOWARDS_ENDS, TOWARDS_TIP
from wt_gym.turbines import load_turbine

__all__ = ["blade_strips", "helical_flow", "turbine_strips", "wing_strips"]

RUNGS = {"training": TRAINING, "engineering": ENGINEERING, "reference": REFERENCE}
SMALL = 1e-3
"""Angle of attack at which circulations are taken, which are linear [rad]."""
OUTBOARD = 0.85
INSIDE, OUTERMOST = 0.02, 0.04
"""Largest error of strips, and of the outermost one, of which 2.3 % are those of any even lattice."""
STATIONS = (0.9, 0.92, 0.95, 0.97)
ROOT, PITCH, BLADES = 0.15, 1.0 / 7.0, 3
"""Of the rotors of one chord: radius of the root over that of the tip, 1 / tip-speed ratio, number of blades."""
NARROW, WIDE = 0.005, 0.04
"""Chords of those blades over the radius: a lifting line, and the outer blade of a model rotor in a tunnel."""
THIN: dict[str, Any] = {"bound_core": 1e-3, "wake_core": 1e-2, "squire": 0.0}
INVISCID: dict[str, Any] = {"viscous": False, "far_wake": False, "viscosity": 0.0} | THIN


def rung_edges(options, root, tip, inset=(0.25, 0.25)):
    """Span edges with the spacing of the strips that carry lift of a blade."""
    narrow = options.narrow_strips
    towards = TOWARDS_TIP if narrow == "tip" else TOWARDS_ENDS
    return span_distribution(root, tip, options.n_span, towards, inset, narrow)


def middles(edges):
    """Middles of the strips."""
    return 0.5 * (edges[1:] + edges[:-1])


# ---- wings ----


def wing_strips(edges, n_chord, **options):
    """Circulation over angle of attack (n_span,) of the strips of a flat rectangular half wing of chord one."""
    _, state, _ = steady_wing(flat_planform(edges, 1.0, n_chord), SMALL, **options)
    return state.circulation[0] / SMALL


def lift_slope(aspect, circulation):
    """Lift slope [1/rad] from the circulation along the half span of a wing of chord one."""
    angle = np.linspace(0.0, 0.5 * np.pi, 2001)
    half_span = 0.5 * aspect
    return 2.0 * np.trapezoid(circulation(half_span * np.sin(angle)) * np.cos(angle), angle)


@case(
    "tip-strips-wing",
    "Circulation of the strips of rectangular wings near the tip, with the panels of the fidelities",
    "quasi-vortex lattice (Lan 1974), converged",
)
def tip_strips_wing() -> CaseResult:
    """The quasi-vortex lattice against known lift slopes; strips of the lattice against it."""
    checks, lines, curves = [], [], []
    for aspect, (slope, _) in RECTANGULAR.items():
        found = lift_slope(aspect, lifting_surface(0.5 * aspect, np.ones_like))
        checks.append(Check(f"quasi-vortex lattice: lift slope, AR {aspect:g}", slope, found, 1e-3, "1/rad",
                            source=RECTANGULAR_SOURCE))  # fmt: skip
    for aspect in (8.0, 20.0):
        half_span = 0.5 * aspect
        exact = lifting_surface(half_span, np.ones_like)
        for rung, options in RUNGS.items():
            edges = rung_edges(options, 0.0, half_span, (0.0, 0.25))
            place = middles(edges)
            error = wing_strips(edges, options.n_chord) / exact(place) - 1.0
            checks += _strip_checks(f"AR {aspect:g}, {rung}", place / half_span, error, "quasi-vortex lattice")
            curves.append(Curve(place / half_span, 100.0 * error, f"AR {aspect:g}, {rung}", "o-"))
        for n in (8, 16, 40, 80, 160):
            for inset in (0.25, 0.0):
                edges = span_distribution(0.0, half_span, n, 0.0, (0.0, inset))
                error = wing_strips(edges, 2) / exact(middles(edges)) - 1.0
                text = ", ".join(f"{100.0 * x:+.1f}" for x in error[:-5:-1])
                lines.append(f"AR {aspect:g}, {n} even strips, last edge {inset:g} strips before the tip: {text} %")
    text = ", ".join(f"{100.0 * x:+.1f}" for x in outermost_strips(4) - 1.0)
    lines.append(f"narrow even strips, a quarter before the tip, exact solution of the lattice: {text} %")
    notes = "\n".join(("Errors of the outermost strips, outermost first:", *lines))
    figure = Figure(tuple(curves), "span", "error of the circulation [%]")
    return CaseResult(checks, {"strips of rectangular wings": figure}, notes)


def _strip_checks(name, place, error, source):
    """Largest error of the strips outboard of `OUTBOARD` but for the last, and that of the last."""
    inner = error[:-1][place[:-1] >= OUTBOARD]
    worst = 0.0 if inner.size == 0 else float(inner[np.argmax(np.abs(inner))])
    rest = f"{name}: circulation of {inner.size} strips outboard of {OUTBOARD:g}, the worst"
    last = f"{name}: circulation of the outermost strip, middle at {place[-1]:.3f}"
    return [
        Check(rest, 1.0, 1.0 + worst, INSIDE, source=source),
        Check(last, 1.0, 1.0 + float(error[-1]), OUTERMOST, source=source),
    ]


# ---- rotors in a prescribed helical wake ----


@dataclass(frozen=True)
class HelicalFlow:
    """Blades in steady flow before a wake of undisturbed helices, of the first blade.

    Attributes
    ----------
    circulation, alpha, speed : ndarray, shape (n_span,)
        [m²/s], [rad], [m/s].
    power, thrust : float
        Of all blades [W], [N].
    """

    circulation: np.ndarray
    alpha: np.ndarray
    speed: np.ndarray
    power: float
    thrust: float


def helical_flow(rotor: RigidRotor, options, wind, rotor_speed, drift, turns=8, steps=36) -> HelicalFlow:
    """Steady flow before helices that move with the speed ``drift`` along the axis, ``turns`` of them, end open."""
    rows = turns * steps
    options = replace(
        options, wake_rows=rows, full_rows=rows, coarse_stride=1, sparse_from=None, sparse_stride=1, sparse_span=1,
        fresh_rows=0, refresh_stride=10**9, far_wake=False, induction="direct",
    )  # fmt: skip
    lattice = VortexLattice(rotor.planform, rotor.n_blades, options, rotor.air_density)
    state = lattice.new_state()
    nodes, velocities = rotor.motion(0.0, rotor_speed, 0.0)
    ages = (np.arange(rows) + options.shed_fraction) * 2.0 * np.pi / rotor_speed / steps
    edge = 0.25 * nodes[:, -2] + 0.75 * nodes[:, -1]
    cos, sin = np.cos(rotor_speed * ages)[:, None, None], -np.sin(rotor_speed * ages)[:, None, None]
    x, y, z = np.moveaxis(edge, -1, 0)
    wake = np.stack([x + drift * ages[:, None, None], cos * y - sin * z, sin * y + cos * z], axis=-1)
    air = np.broadcast_to([wind, 0.0, 0.0], nodes.shape)
    lattice.initialize_wake(state, nodes, velocities, air, wake, ages)
    force = state.nodal_forces
    torque = (nodes[..., 1] * force[..., 2] - nodes[..., 2] * force[..., 1]).sum()
    return HelicalFlow(
        state.circulation[0].copy(), state.angle_of_attack[0].copy(), state.section_speed[0].copy(),
        float(torque) * rotor_speed, float(force[..., 0].sum()),
    )  # fmt: skip


def blade_strips(edges, n_chord, chord, angle: Callable[..., Any] | None = None, steepness=1.0):
    """Circulation (n_span,) over a small angle of blades of one chord and radius one, twisted like undisturbed helices.

    Parameters
    ----------
    edges : ndarray, shape (n_span + 1,)
    n_chord : int
    chord : float
    angle : callable, optional
        Angle against the helices along the span; by default one, given by the blades' pitch. If given, by the
        polars of the strips, since the twist of a strip is the mean of its edges.
    steepness : float
        Lift slope over 2π where ``angle`` is given: blades narrow as a lifting line that induce as much as wide ones.
    """
    return 0.5 * sum(sign * _turned_blades(edges, n_chord, chord, sign * SMALL, angle, steepness) / SMALL
                     for sign in (1.0, -1.0))  # fmt: skip


def _turned_blades(edges, n_chord, chord, small, angle, steepness):
    place, one = middles(edges), np.ones_like(edges)
    attack = np.linspace(-np.pi, np.pi, 720, endpoint=False)
    own = np.zeros_like(place) if angle is None else small * angle(place)
    polars = np.zeros((place.size, attack.size, 3))
    polars[..., 0] = 2.0 * np.pi * steepness * np.sin(attack + own[:, None])
    twist = np.arctan2(PITCH, edges) - (small if angle is None else 0.0)
    axis = np.column_stack([0.0 * edges, 0.0 * edges, edges])
    planform = build_planform(edges, axis, chord * one, twist, 0.25 * one, polars, n_chord)
    rotor = RigidRotor(planform, BLADES, 0.0, 1.0, air_density=1.0)
    options = AeroOptions(n_chord=n_chord, n_span=place.size, **(INVISCID | {"viscous": angle is not None}))
    return helical_flow(rotor, options, 1.0, 1.0 / PITCH, 1.0, turns=8).circulation


def through_strips(place, values, root=ROOT):
    """Function of the radius through the values of fine strips of blades of radius one, zero at both ends."""

    def angle(x):
        return np.arccos(np.clip((2.0 * np.asarray(x) - 1.0 - root) / (1.0 - root), -1.0, 1.0))

    spline = CubicSpline(np.r_[0.0, angle(place)[::-1], np.pi], np.r_[0.0, values[::-1], 0.0])
    return lambda x: spline(angle(x))


@case(
    "tip-strips-rotor",
    "Circulation of the strips of rotors of one chord near the tip, with the panels of the fidelities",
    "lifting line with induction factors of Wrench (1957); a fine lattice; Betz 1919, Goldstein 1929, Prandtl 1919",
    slow=True,
)
def tip_strips_rotor() -> CaseResult:
    """Narrow blades against a lifting line, a rotor of least loss, wide blades against a fine lattice."""
    checks, curves, lines = [], [], []
    fast = 1.0 / 40.0
    tip = 2.0 / np.pi * np.arccos(np.exp(-0.5 * BLADES * (1.0 - 0.95) * np.sqrt(1.0 + 1.0 / fast**2)))
    prandtl = 2.0 * np.pi * fast / BLADES * 0.95**2 / (0.95**2 + fast**2) * tip
    found = float(optimum_circulation(ROOT, fast, BLADES)(0.95))
    checks.append(
        Check("optimum circulation at 0.95 R, tip-speed ratio 40", prandtl, found, 2e-3, source="Prandtl's limit")
    )
    line = {chord: lifting_line_blade(chord, ROOT, PITCH, BLADES) for chord in (NARROW, 0.01, 0.02, WIDE)}
    optimum, steepness = optimum_circulation(ROOT, PITCH, BLADES), 16.0

    def of_least_loss(radius):
        """Angle with which blades of this steepness have the optimum circulation."""
        resultant = np.hypot(1.0, radius / PITCH)
        induced = 0.5 * np.cos(np.arctan2(PITCH, radius))
        return (optimum(radius) / (np.pi * NARROW * steepness) + induced) / resultant

    for rung, options in RUNGS.items():
        edges = rung_edges(options, ROOT, 1.0)
        place = middles(edges)
        kinds = {
            "narrow blades": blade_strips(edges, options.n_chord, NARROW) / line[NARROW](place) - 1.0,
            "least loss": blade_strips(edges, options.n_chord, NARROW, of_least_loss, steepness) / optimum(place) - 1.0,
        }
        for kind, error in kinds.items():
            checks += _strip_checks(f"{kind}, {rung}", place, error, "lifting line")
            curves.append(Curve(place, 100.0 * error, f"{kind}, {rung}", "o-"))
    for chord in (0.01, 0.02, WIDE):
        edges = span_distribution(ROOT, 1.0, 64, 0.3, (0.25, 0.25))
        fine = through_strips(middles(edges), blade_strips(edges, 4 if chord == WIDE else 2, chord))
        ratios = ", ".join(f"{100.0 * (line[chord](x) / fine(x) - 1.0):+.1f}" for x in STATIONS)
        lines.append(f"chord {chord:g} R: lifting line over fine lattice at 0.9, 0.92, 0.95, 0.97 R: {ratios} %")
    for rung, options in RUNGS.items():
        edges = rung_edges(options, ROOT, 1.0)
        place = middles(edges)
        error = blade_strips(edges, options.n_chord, WIDE) / fine(place) - 1.0
        checks += _strip_checks(f"wide blades, {rung}", place, error, "4 x 64 panels")
        curves.append(Curve(place, 100.0 * error, f"wide blades, {rung}", "x--"))
    figure = Figure(tuple(curves), "r/R", "error of the circulation [%]")
    return CaseResult(checks, {"strips of rotors of one chord": figure}, "\n".join(lines))


# ---- turbines ----


def turbine_strips(turbine, options, ratio=7.55, wind=8.0, drift=0.7, share=1.0):
    """Radius over that of the tip (n_span,) and steady flow of the strips of a turbine before prescribed helices.

    ``share`` narrows the rings about the quarter chord while the polars keep their chord: towards a lifting line.
    """
    rotor = RigidRotor.of_turbine(turbine, options)
    if share != 1.0:
        blade, planform = turbine.blade, rotor.planform
        edges = planform.span_edges
        narrow = build_planform(
            edges, blade.axis_at(edges), share * planform.edge_chord, blade.twist_at(edges),
            0.25 - (0.25 - blade.le_offset_at(edges)) / share, planform.polars, options.n_chord, blade.camber_at,
            planform.chord, blade.root_radius,
        )  # fmt: skip
        rotor = replace(rotor, planform=narrow)
    flow = helical_flow(rotor, options, wind, ratio * wind / rotor.radius, drift * wind, turns=4, steps=36)
    tip = rotor.root_radius + turbine.blade.length
    return (rotor.root_radius + middles(rotor.planform.span_edges)) / tip, flow


@case(
    "tip-strips-turbines",
    "Circulation of the strips of turbines near the tip, with the panels of the fidelities, in a prescribed wake",
    "2 x 64 panels",
    slow=True,
)
def tip_strips_turbines() -> CaseResult:
    """NREL 5-MW and IEA 15-MW, polars fed back; the notes compare with a lifting line in the same wake."""
    checks, curves, lines = [], [], []
    for name, ratio in (("nrel_5mw", 7.55), ("iea_15mw", 9.0)):
        turbine, options = load_turbine(name), replace(REFERENCE, n_chord=2, n_span=64)
        place, best = turbine_strips(turbine, options, ratio)
        root = float(place[0] - (place[1] - place[0]))
        fine = through_strips(place, best.circulation, root)
        # rings so narrow need thin cores
        _, line = turbine_strips(turbine, replace(options, n_chord=1, **THIN), ratio, share=0.1)
        _, thin = turbine_strips(turbine, replace(options, **THIN), ratio)
        narrow, wide = (through_strips(place, flow.circulation, root) for flow in (line, thin))
        ratios = ", ".join(f"{100.0 * (narrow(x) / wide(x) - 1.0):+.1f}" for x in (0.3, 0.5, 0.7, 0.8, *STATIONS))
        totals = [100.0 * (a / b - 1.0) for a, b in ((line.power, thin.power), (line.thrust, thin.thrust))]
        lines.append(
            f"{name}, lifting line over 2 x 64 panels: power {totals[0]:+.1f} %, thrust {totals[1]:+.1f} %; "
            f"circulation at 0.3, 0.5, 0.7, 0.8, 0.9, 0.92, 0.95, 0.97 R [%]: {ratios}"
        )
        for rung, options in RUNGS.items():
            place, flow = turbine_strips(turbine, replace(options, squire=REFERENCE.squire), ratio)
            error = flow.circulation / fine(place) - 1.0
            checks += _strip_checks(f"{name}, {rung}", place, error, "2 x 64 panels")
            outer = place >= OUTBOARD
            curves.append(Curve(place[outer], 100.0 * error[outer], f"{name}, {rung}", "o-"))
            strips = ", ".join(f"{100.0 * e:+.1f} at {r:.3f}" for r, e in zip(place[outer], error[outer], strict=True))
            totals = [100.0 * (a / b - 1.0) for a, b in ((flow.power, best.power), (flow.thrust, best.thrust))]
            lines.append(f"{name}, {rung}: power {totals[0]:+.1f} %, thrust {totals[1]:+.1f} %; strips [%]: {strips}")
    figure = Figure(tuple(curves), "r/R", "error of the circulation [%]")
    return CaseResult(checks, {"strips of turbines": figure}, "\n".join(lines))
