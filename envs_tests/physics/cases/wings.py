"""Finite wings with the vortex lattice, and the strips at the tips of wings and rotors."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.special import gammaln

from envs_tests.physics.cases.airfoils import (
    WAGNER,
    WAGNER_SOURCE,
    UniformStream,
    WingFlow,
    far_field_drag,
    flat_planform,
    half_span_edges,
    steady_coefficients,
    steady_wing,
    two_dimensional_planform,
)
from envs_tests.physics.cases.rotor import RigidRotor
from envs_tests.physics.validation import CaseResult, Check, Curve, Figure, case
from wt_gym.aerodynamics import AeroOptions, VortexLattice, build_planform, span_distribution
from wt_gym.aerodynamics.options import ENGINEERING, REFERENCE, TRAINING
from wt_gym.simulation.models import TOWARDS_ENDS, TOWARDS_TIP
from wt_gym.turbines import load_turbine

# ---- wings ----------------------------------------------------------------------------------------------------------
# Every wing is a half wing mirrored in the plane of symmetry z = 0, in a stream of speed and density one.

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

    Returns ``travel``: in semi-chords, from the middle of the first step, over which the lattice spreads the start.
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


@case(
    "sudden-acceleration",
    "Rectangular wings set in motion at once at 5°",
    ACCELERATION_SOURCE,
    slow=True,
    quick={"aspects": (4.0,)},
)
def sudden_acceleration_case(aspects=tuple(RECTANGULAR)) -> CaseResult:
    """Impulse of the apparent mass, early growth as Wagner, steady lift, and who gets there first."""
    checks = [
        Check("section: impulse of the start over ρ π c²/4 V sin α", 1.0, starting_impulse(16), 0.01,
              source="apparent mass of a flat plate (Lamb, Hydrodynamics, art. 71)"),
    ]  # fmt: skip
    curves, lifts, ninety = [], {}, []
    for aspect in aspects:
        steady = RECTANGULAR[aspect][1]
        travel, lift = sudden_acceleration(aspect)
        lifts[aspect] = lift
        checks.append(Check(f"AR {aspect:g}: lift after 30 chords", steady, lift[-1], 0.01, source=RECTANGULAR_SOURCE))
        started = np.flatnonzero(lift[3:] >= 0.9 * lift[-1])[0] + 3
        ninety.append(float(travel[started]))
        curves.append(Curve(travel[3:], lift[3:], f"AR {aspect:g}"))
    if len(aspects) < len(RECTANGULAR):
        return CaseResult(checks)
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


# ---- other methods than the lattice ---------------------------------------------------------------------------------
# All circulations are linear: they stand for unit angle of attack, or for unit angle against the helices of the wake.


def _semicircles(low, high, n):
    """Edges (n + 1,) and stations (n,) of a span by cosines, to which the root of the circulation at an end is exact.

    Edges are the zeros of the Chebyshev polynomial of the first kind, stations those of the second (Lan 1974).
    """
    middle, half = 0.5 * (low + high), 0.5 * (high - low)
    edges = middle - half * np.cos((2.0 * np.arange(n + 1) + 1.0) * np.pi / (2.0 * (n + 1)))
    return edges, middle - half * np.cos(np.arange(1, n + 1) * np.pi / (n + 1))


def _over_span(low: float, high: float, stations: np.ndarray, values: np.ndarray) -> Callable[..., Any]:
    """The function of the span through values that fall to zero at both ends like square roots."""
    middle, half = 0.5 * (low + high), 0.5 * (high - low)

    def angle(place):
        return np.arccos(np.clip((np.asarray(place) - middle) / half, -1.0, 1.0))

    spline = CubicSpline(np.r_[0.0, angle(stations)[::-1], np.pi], np.r_[0.0, values[::-1], 0.0])
    return lambda place: spline(angle(place))


def lifting_surface(
    half_span: float, chord: Callable[..., Any], n_span: int = 80, n_chord: int = 8
) -> Callable[..., Any]:
    """Circulation along a flat wing with straight half-chord line by the quasi-vortex lattice, unit stream and angle.

    Cosines along span and chord integrate the square-root singularities of tips and leading edge (C. E. Lan,
    J. Aircraft 11 (1974) 518); horseshoe vortices with straight wakes.

    ``half_span`` [m]; ``chord``: chord at places along the span, symmetric [m]; ``n_span``, ``n_chord``: strips of one
    half and vortices along the chord. Returns circulation at places along the span [m²/s].
    """
    edges, stations = _semicircles(-half_span, half_span, 2 * n_span)
    k = np.arange(1, n_chord + 1)
    vortex, control = (
        0.5 * (1.0 - np.cos((2 * k - 1) * np.pi / (2 * n_chord))) - 0.5,
        0.5 * (1.0 - np.cos(k * np.pi / n_chord)) - 0.5,
    )
    right = stations[n_span:]  # symmetry: unknowns of one half, velocities of both
    x, y = np.ravel(control[:, None] * chord(right)), np.tile(right, n_chord)
    begin = np.ravel(vortex[:, None] * chord(edges[:-1])), np.tile(edges[:-1], n_chord)
    end = np.ravel(vortex[:, None] * chord(edges[1:])), np.tile(edges[1:], n_chord)
    upwash = _horseshoes(x[:, None], y[:, None], begin, end).reshape(x.size, n_chord, 2 * n_span)
    both = upwash[:, :, n_span:] + upwash[:, :, n_span - 1 :: -1]
    strength = np.linalg.solve(both.reshape(x.size, -1), -np.ones(x.size))
    half = strength.reshape(n_chord, n_span).sum(axis=0)
    return _over_span(-half_span, half_span, stations, np.r_[half[::-1], half])


def _horseshoes(x, y, begin, end):
    """Upwash in their plane of unit horseshoes with legs along +x (Katz & Plotkin, Low-Speed Aerodynamics, 12.1)."""
    ax, ay, bx, by = x - begin[0], y - begin[1], x - end[0], y - end[1]
    a, b = np.hypot(ax, ay), np.hypot(bx, by)
    lx, ly = ax - bx, ay - by
    across = ax * by - bx * ay
    along = (lx * ax + ly * ay) / a - (lx * bx + ly * by) / b
    bound = np.divide(along, across, out=np.zeros_like(along), where=np.abs(across) > 1e-14)
    return (bound - (1.0 + ax / a) / ay + (1.0 + bx / b) / by) / (4.0 * np.pi)


def outermost_strips(n: int) -> np.ndarray:
    """Circulation of strips at a tip over the exact one at their middles, outermost first, for even narrow strips.

    With the last edge a quarter strip before the tip, vortices at the edges k = 0, 1, … and no further downwash at the
    middles between them have the strengths Γ(k + 1/2) / k!, strip j thus the circulation Γ(j + 3/2) / j!, which tends
    to the root of the distance j + 3/4 from the tip.
    """
    j = np.arange(n)
    return np.exp(gammaln(j + 1.5) - gammaln(j + 1.0)) / np.sqrt(j + 0.75)


# ---- rotors ----


def helix_induction(radius, helix: float, pitch: float, n_blades: int):
    """Velocity at a blade of helices of unit circulation that begin on all blades: against the axis and the motion.

    J. W. Wrench, The calculation of propeller induction factors, David Taylor Model Basin report 1116 (1957); closed
    formulas in place of Kapteyn series, right within 1e-4.

    ``radius``: points on the blades [m]; ``helix``: radius of the helices [m]; ``pitch``: advance of the helices over
    their angle [m/rad].
    """
    y0, y = helix / pitch, radius / pitch
    root0, root = np.sqrt(1.0 + y0**2), np.sqrt(1.0 + y**2)
    inside = radius < helix
    power = n_blades * (np.log(y0 * (root - 1.0) / (y * (root0 - 1.0))) + root - root0)
    share = np.exp(-np.abs(power)) / -np.expm1(-np.abs(power))  # 1 / (1/U - 1) inside, 1 / (U - 1) outside
    curved = ((9.0 * y0**2 + 2.0) / root0**3 + (3.0 * y**2 - 2.0) / root**3) / (24.0 * n_blades)
    factor = np.sqrt(root0 / root) / (2.0 * n_blades * y0)
    factor = factor * np.where(inside, -share - curved * np.log1p(share), share - curved * np.log1p(share))
    per_turn = n_blades / (4.0 * np.pi)
    axial = per_turn / pitch * (np.where(inside, 1.0, 0.0) - 2.0 * n_blades * y0 * factor)
    turning = per_turn / radius * (np.where(inside, 0.0, 1.0) + 2.0 * n_blades * y0 * factor)
    return axial, turning


def _downwash(root, pitch, n_blades, n):
    """Stations, angle of the helices there, and velocity across the helices per circulation of a strip (n, n)."""
    edges, stations = _semicircles(root, 1.0, n)
    angle = np.arctan2(pitch, stations)
    axial, turning = np.array([helix_induction(stations, edge, pitch, n_blades) for edge in edges]).transpose(1, 2, 0)
    across = axial * np.cos(angle)[:, None] - turning * np.sin(angle)[:, None]
    return stations, angle, np.diff(across, axis=1)


def lifting_line_blade(chord: float, root: float, pitch: float, n_blades: int, n: int = 80) -> Callable[..., Any]:
    """Circulation along narrow blades of one chord and radius one at unit angle to undisturbed helices.

    Γ / (π c) + w(Γ) = W, with the sections' lift slope 2π and the resultant W of a unit wind and the rotation.
    """
    stations, _, downwash = _downwash(root, pitch, n_blades, n)
    strength = np.linalg.solve(downwash + np.eye(n) / (np.pi * chord), np.hypot(1.0, stations / pitch))
    return _over_span(root, 1.0, stations, strength)


def optimum_circulation(root: float, pitch: float, n_blades: int, n: int = 80) -> Callable[..., Any]:
    """Circulation of least loss (Betz 1919, Goldstein 1929): its helices move like a rigid screw of unit speed."""
    stations, angle, downwash = _downwash(root, pitch, n_blades, n)
    strength = np.linalg.solve(downwash, 0.5 * np.cos(angle))  # at the blade half of what is far behind
    return _over_span(root, 1.0, stations, strength)


# ---- strips at tips -------------------------------------------------------------------------------------------------
# Totals hide what happens at a tip. Here every strip outboard of 0.85 of the span is compared at its middle. Wakes are
# prescribed, so that nothing but the lattice and its planform counts.

RUNGS = {"training": TRAINING, "engineering": ENGINEERING, "reference": REFERENCE}
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
    quick={"aspects": (20.0,), "rungs": ("training",)},
)
def tip_strips_wing(aspects=(8.0, 20.0), rungs=tuple(RUNGS)) -> CaseResult:
    """The quasi-vortex lattice against known lift slopes; strips of the lattice against it."""
    checks, lines, curves = [], [], []
    for aspect, (slope, _) in RECTANGULAR.items():
        found = lift_slope(aspect, lifting_surface(0.5 * aspect, np.ones_like))
        checks.append(Check(f"quasi-vortex lattice: lift slope, AR {aspect:g}", slope, found, 1e-3, "1/rad",
                            source=RECTANGULAR_SOURCE))  # fmt: skip
    for aspect in aspects:
        half_span = 0.5 * aspect
        exact = lifting_surface(half_span, np.ones_like)
        for rung in rungs:
            options = RUNGS[rung]
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

    ``circulation``, ``alpha``, ``speed`` (n_span,) [m²/s], [rad], [m/s]; ``power``, ``thrust`` of all blades [W], [N].
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

    ``edges`` (n_span + 1,); ``angle``: angle against the helices along the span; by default one, given by the blades'
    pitch. If given, by the polars of the strips, since the twist of a strip is the mean of its edges; ``steepness``:
    lift slope over 2π where ``angle`` is given: blades narrow as a lifting line that induce as much as wide ones.
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
