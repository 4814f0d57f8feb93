"""Finite wings with the vortex lattice: lift slopes, induced drag, sudden acceleration, conservation of circulation.

Every wing is a half wing mirrored in the plane of symmetry z = 0, in a stream of speed and density one.
"""

from __future__ import annotations

import numpy as np

from validation.case import CaseResult, Check, Curve, Figure, case
from validation.lifting_tools import (
    UniformStream,
    WingFlow,
    far_field_drag,
    flat_planform,
    half_span_edges,
    steady_coefficients,
    steady_wing,
    two_dimensional_planform,
)
from validation.unsteady_airfoil import WAGNER, WAGNER_SOURCE

RECTANGULAR = {4.0: (3.6120, 0.3152), 6.0: (4.2146, 0.3678), 8.0: (4.5861, 0.4002), 12.0: (5.0217, 0.4382),
               20.0: (5.4335, 0.4742)}  # fmt: skip
"""Aspect ratio: lift slope [1/rad], lift coefficient at 5 degrees, converged."""
RECTANGULAR_SOURCE = "lifting-surface theory, straight wake, converged; computed independently"
SMALL = 1e-3
"""Angle of attack from which lift slopes are taken [rad]."""
FIVE_DEGREES = np.radians(5.0)
CORE = 0.02
"""Core of the free wake in chords: thinner ones are noise in single precision where a node lies on a segment."""


def rectangular_wing(aspect: float, n_chord: int, n_half_span: int, inset: float, alpha: float):
    """Lift coefficient, and induced drag by Joukowski and by the far field, of a flat rectangular wing of chord 1."""
    planform = flat_planform(half_span_edges(0.5 * aspect, n_half_span, inset), 1.0, n_chord)
    _, state, stream = steady_wing(planform, alpha)
    lift, drag = steady_coefficients(state, stream, 0.5 * aspect)
    return lift, drag, far_field_drag(state.circulation[0], planform.span_edges) / (0.25 * aspect)


@case("rectangular-wings", "Flat rectangular wings: lift slope, lift at 5°, induced drag", RECTANGULAR_SOURCE)
def rectangular_wings() -> CaseResult:
    """Aspect ratios 4 … 20, even lattices up to the tips and the lattice a quarter panel inside them."""
    checks, curves = [], []
    far = "Trefftz-plane integral over the same wake (Munk 1921)"
    for aspect, (slope, lift_at_five) in RECTANGULAR.items():
        coarse, fine = (rectangular_wing(aspect, n, 5 * n, 0.0, SMALL)[0] / SMALL for n in (4, 8))
        inset = rectangular_wing(aspect, 4, 20, 0.25, SMALL)[0] / SMALL
        lift, drag, far_drag = rectangular_wing(aspect, 8, 40, 0.25, FIVE_DEGREES)
        name = f"AR {aspect:g}"
        text = RECTANGULAR_SOURCE
        checks += [
            Check(f"{name}: lift slope, 8 × 40 panels a half", slope, fine, 0.01, "1/rad", source=text),
            Check(f"{name}: lift slope, extrapolated from 4 × 20 and 8 × 40", slope, 2.0 * fine - coarse, 0.003,
                  "1/rad", source=text),
            Check(f"{name}: lift slope, 4 × 20 panels a quarter panel inside the tips", slope, inset, 0.01, "1/rad",
                  source=text),
            Check(f"{name}: lift coefficient at 5°", lift_at_five, lift, 0.01, source=text),
            Check(f"{name}: induced drag at 5° by Joukowski", far_drag, drag, 0.02, source=far),
        ]  # fmt: skip
        sizes = (1, 2, 4, 8)
        for label, edge, style in (("to the tips", 0.0, "o-"), ("inside the tips", 0.25, "x--")):
            values = [rectangular_wing(aspect, n, 5 * n, edge, SMALL)[0] / SMALL / slope - 1.0 for n in sizes]
            curves.append(Curve([1.0 / n for n in sizes], values, f"{name}, {label}", style))
    notes = (
        "Joukowski's drag equals the far-field drag within 0.02 %: where bound vortices and trailing edge are straight "
        "and the wake lies along the stream, Munk's theorems hold for the discrete lattice as well. A lattice that "
        "stops a quarter panel before the tips (Hough 1973) has the error of one with ten times as many panels."
    )
    figure = Figure(tuple(curves), "1 / panels along the chord", "error of the lift slope")
    return CaseResult(checks, {"convergence of the lift slope": figure}, notes)


# ---- curved planforms ------------------------------------------------------------------------------------------------

CIRCLE_SOURCE = "circular wing, exact lifting-surface solution (Jordan 1973; van Spiegel 1959)"
ELLIPSE_SOURCE = "Van Dyke 1964, lifting line of third order: 2π/[1 + 2/A + 16 (ln πA − 9/8)/(πA)²]"


def elliptic_wing(half_span: float, half_chord: float, n_chord: int, n_half_span: int):
    """Lift slope, Joukowski over far-field drag and span efficiency (far field) of an elliptic wing.

    Even strips, the last edge a quarter panel before the tip, where the chord is still positive: no panel is without
    area. With cosine spacing the error of the lift slope is ten times larger.
    """
    edges = half_span_edges(half_span, n_half_span)
    chord = 2.0 * half_chord * np.sqrt(1.0 - (edges / half_span) ** 2)
    _, state, stream = steady_wing(flat_planform(edges, chord, n_chord, 0.5), SMALL)
    area = 0.5 * np.pi * half_span * half_chord
    lift, drag = steady_coefficients(state, stream, area)
    far_drag = far_field_drag(state.circulation[0], edges) / (0.5 * area)
    aspect = 4.0 * half_span / (np.pi * half_chord)
    return lift / SMALL, drag / far_drag, lift**2 / (np.pi * aspect * far_drag)


@case("elliptic-wings", "Circular and elliptic flat wings: lift slope, induced drag", CIRCLE_SOURCE)
def elliptic_wings() -> CaseResult:
    """Lift slope of the circle (exact) and of slender ellipses (matched expansion), Munk's bound of induced drag."""
    checks = []
    circle = {n: elliptic_wing(1.0, 1.0, n, 20) for n in (4, 8, 16)}
    checks.append(
        Check("circle: lift slope, 8 × 20 panels a half", 1.7900, circle[8][0], 0.01, "1/rad", source=CIRCLE_SOURCE)
    )
    checks.append(Check("circle: Joukowski over far-field drag, extrapolated from 8 and 16 panels", 1.0,
                        2.0 * circle[16][1] - circle[8][1], 0.02, source="Munk 1921"))  # fmt: skip
    aspects, slopes = (8.0, 12.0, 20.0), []
    for aspect in aspects:
        slope, _, efficiency = elliptic_wing(0.125 * np.pi * aspect, 0.5, 4, 40)
        slopes.append(slope)
        expected = 2.0 * np.pi / (1.0 + 2.0 / aspect + 16.0 * (np.log(np.pi * aspect) - 1.125) / (np.pi * aspect) ** 2)
        checks.append(
            Check(f"ellipse, AR {aspect:g}: lift slope", expected, slope, 0.01, "1/rad", source=ELLIPSE_SOURCE)
        )
        checks.append(Check(f"ellipse, AR {aspect:g}: span efficiency", "in [0.99, 1.0005]", efficiency,
                            source="at most 1 (Munk 1921), nearly elliptic loading"))  # fmt: skip
    a = np.linspace(5.0, 25.0, 50)
    theory = 2.0 * np.pi / (1.0 + 2.0 / a + 16.0 * (np.log(np.pi * a) - 1.125) / (np.pi * a) ** 2)
    curves = (Curve(a, theory, "Van Dyke"), Curve(aspects, slopes, "lattice", "o"))
    raw = ", ".join(f"{n}: {value[1]:.3f}" for n, value in circle.items())
    notes = (
        f"Joukowski over far-field drag of the circle by panels along the chord: {raw}. On a round planform the "
        "suction of the leading edge acts on skewed segments and converges with the first order in the chordwise "
        "panels; on straight edges it is exact at once. Lift does not suffer."
    )
    figures = {"lift slope of elliptic wings": Figure(curves, "aspect ratio", "lift slope [1/rad]")}
    return CaseResult(checks, figures, notes)


# ---- sudden acceleration ---------------------------------------------------------------------------------------------

ACCELERATION_SOURCE = "Katz & Plotkin, Low-Speed Aerodynamics, Figs 13.34-13.38"


def sudden_acceleration(aspect: float, alpha: float = SMALL, n_chord: int = 6, chords: float = 30.0, **options):
    """Lift coefficient of a rectangular wing after it has been set in motion at once, scaled from ``alpha`` to 5°.

    Returns
    -------
    travel : ndarray
        In semi-chords, from the middle of the first step, over which the lattice spreads the start.
    lift : ndarray
    """
    n_strip = round(1.25 * aspect)
    n_steps = round(chords * n_chord)
    planform = flat_planform(half_span_edges(0.5 * aspect, n_strip), 1.0, n_chord)
    flow = WingFlow(planform, UniformStream.at_incidence(alpha), n_steps, 1.0 / n_chord, **options)
    flow.start_from_rest()
    lift = np.zeros(n_steps)
    for m in range(n_steps):
        flow.step()
        lift[m] = steady_coefficients(flow.state, flow.stream, 0.5 * aspect)[0]
    return (2.0 * np.arange(n_steps) + 1.0) / n_chord, lift * FIVE_DEGREES / alpha


def starting_impulse(n_chord: int, **options) -> float:
    """Impulse of a very short step in which a section is set in motion, over ρ π c²/4 times its velocity."""
    dt = 1e-3
    flow = WingFlow(two_dimensional_planform(n_chord), UniformStream.at_incidence(0.0), 2, dt, **options)
    flow.start_from_rest()
    flow.step()  # a level in time without circulation, from which the next step takes its rate
    velocities = flow.still.copy()
    velocities[..., 0] = -SMALL
    return 0.5 * flow.section_lift(flow.step(velocities=velocities)) * dt / (0.25 * np.pi * SMALL)


@case("sudden-acceleration", "Rectangular wings set in motion at once at 5°", ACCELERATION_SOURCE, slow=True)
def sudden_acceleration_case() -> CaseResult:
    """Impulse of the apparent mass, early growth as Wagner, steady lift, and who gets there first."""
    checks = [
        Check("section: impulse of the start over ρ π c²/4 V sin α", 1.0, starting_impulse(16), 0.01,
              source="apparent mass of a flat plate (Lamb, Hydrodynamics, art. 71)"),
    ]  # fmt: skip
    curves, lifts, ninety = [], {}, []
    for aspect, (_, steady) in RECTANGULAR.items():
        travel, lift = sudden_acceleration(aspect)
        lifts[aspect] = lift
        checks.append(Check(f"AR {aspect:g}: lift after 30 chords", steady, lift[-1], 0.01, source=RECTANGULAR_SOURCE))
        started = np.flatnonzero(lift[3:] >= 0.9 * lift[-1])[0] + 3
        ninety.append(float(travel[started]))
        curves.append(Curve(travel[3:], lift[3:], f"AR {aspect:g}"))
    for s, value in WAGNER[1:4]:
        # what the trailing vortices take away is of the order of 1/AR
        at = {a: float(np.interp(s, travel, lifts[a])) / (2.0 * np.pi * FIVE_DEGREES) for a in (12.0, 20.0)}
        infinite = (20.0 * at[20.0] - 12.0 * at[12.0]) / 8.0
        checks.append(
            Check(f"lift over 2π α at s = {s:g}, extrapolated in 1/AR", value, infinite, 0.02, source=WAGNER_SOURCE)
        )
    order = min(np.diff(ninety))
    checks.append(Check("travel to 90 % of the final lift grows with the aspect ratio: least difference", ">= 0", order,
                        unit="semi-chords", source=ACCELERATION_SOURCE))  # fmt: skip
    s, value = np.array(WAGNER).T
    curves.append(Curve(s, value * 2.0 * np.pi * FIVE_DEGREES, "AR ∞ (Wagner)", "k--"))
    _, free = sudden_acceleration(4.0, FIVE_DEGREES, drifting=False, wake_core=CORE)
    curves.append(Curve(travel[3:], free[3:], "AR 4, free wake at 5°", ":"))
    notes = (
        f"Travel to 90 % of the final lift: {', '.join(f'{x:.1f}' for x in ninety)} semi-chords. The expected steady "
        "values are linear in the angle of attack: the lift is computed at 0.001 rad and scaled to 5°. At 5° itself "
        f"the free wake of AR 4 ends at {free[-1]:.4f} instead of {lifts[4.0][-1]:.4f}."
    )
    return CaseResult(checks, {"lift after sudden acceleration": Figure(tuple(curves), "s [semi-chords]", "CL")}, notes)


# ---- conservation ----------------------------------------------------------------------------------------------------

KELVIN = "Kelvin's and Helmholtz's theorems"


def heaving_wing(n_steps, **options):
    """Flow and history (n_steps, n_span) of the circulation of a wing that heaves, with a free wake."""
    n_chord = 4
    planform = flat_planform(half_span_edges(2.0, 6), 1.0, n_chord)
    dt = 1.0 / n_chord
    flow = WingFlow(planform, UniformStream.at_incidence(0.05), n_steps, dt, drifting=False, wake_core=CORE, **options)
    flow.start_from_rest()
    history = np.zeros((n_steps, planform.n_span))
    for m in range(n_steps):
        time = (m + 1) * dt
        nodes, velocities = flow.nodes.copy(), flow.still.copy()
        nodes[..., 0] += 0.1 * (1.0 - np.cos(time))
        velocities[..., 0] = 0.1 * np.sin(time)
        flow.step(nodes, velocities)
        history[m] = flow.state.circulation[0]
    return flow, history


def circuit(flow, y_begin, y_end, z, half_height=1.5, n=1500):
    """Circulation of the induced velocity round a rectangle in the plane z = const, about +z."""
    t, weight = np.polynomial.legendre.leggauss(n)
    corners = np.array([[-half_height, y_begin], [half_height, y_begin], [half_height, y_end], [-half_height, y_end]])
    total = 0.0
    for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        points = np.full((n, 3), z)
        points[:, :2] = 0.5 * (a + b) + 0.5 * t[:, None] * (b - a)
        velocity = flow.lattice.induced_velocity(flow.state, points)
        total += float(weight @ velocity[:, :2] @ (0.5 * (b - a)))
    return total


@case("vortex-conservation", "Circulation is conserved: wake rings, thinned wakes, closed circuits", KELVIN)
def vortex_conservation() -> CaseResult:
    """A heaving wing with a free wake; circuits round wing and wake are integrals of the induced velocity."""
    n_steps = 40
    flow, history = heaving_wing(n_steps)
    kept = flow.state.wake_circulation[:, 0]
    shed = history[::-1][: len(kept)]
    size = float(np.abs(history).max())
    checks = [
        Check("largest change of a wake ring since it was shed", 0.0, np.abs(kept - shed).max(), 0.0, "m²/s",
              source=KELVIN),
    ]  # fmt: skip
    thinned, thin_history = heaving_wing(n_steps, full_rows=10, coarse_stride=3)
    state = thinned.state
    ages = state.arrays.age[: state.n_rows + 1]
    stored = (state.wake_circulation[1:, 0] * np.diff(ages[1:])[:, None]).sum(axis=0)
    given = thin_history[::-1][1 : 1 + round((ages[-1] - ages[1]) / thinned.dt)].sum(axis=0) * thinned.dt
    checks.append(Check("thinned wake: change of ∫Γ dt over its rings, relative", 0.0,
                        np.abs(stored - given).max() / np.abs(given).max(), 1e-12, source=KELVIN))  # fmt: skip
    z = 0.5 * (flow.lattice.planform.span_edges[0] + flow.lattice.planform.span_edges[1])
    end = float(flow.state.wake_nodes[..., 1].max())
    whole = circuit(flow, -2.0, end + 2.0, z)
    checks.append(Check("circulation round wing and whole wake over the largest of the wing", 0.0, whole / size, 1e-4,
                        source="Kelvin: it was zero before the start"))  # fmt: skip
    # between two spanwise segments of the wake, rows 8 and 9, behind which ring 8 goes on
    y = float(flow.state.wake_nodes[8:10, 0, :2, 1].mean())
    part = circuit(flow, -2.0, y, z)
    ring = float(flow.state.wake_circulation[8, 0, 0])
    sign = np.sign(part * ring)
    checks.append(Check("circulation of a circuit that cuts the wake: circulation of the ring it cuts", ring,
                        sign * part, 5e-3, "m²/s", source="Stokes: the segments it encloses"))  # fmt: skip
    notes = (
        "Circuits lie in the middle of the innermost strip; the velocity has the accuracy of single precision, and the "
        "circuit that cuts the wake passes between segments whose cores of 0.02 chords reach a little beyond it."
    )
    figure = Figure((
        Curve(np.arange(1, n_steps + 1), history[:, 0], "bound, when shed"),
        Curve(n_steps - np.arange(len(kept)), kept[:, 0], "in the wake at the end", "x"),
    ), "step", "Γ of strip 1")  # fmt: skip
    return CaseResult(checks, {"circulation of the innermost strip": figure}, notes)
