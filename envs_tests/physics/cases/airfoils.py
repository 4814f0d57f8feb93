"""Thin airfoils in unsteady flow with the vortex lattice: sudden start, oscillation, gusts."""

from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import hankel2, ive, kve

from envs_tests.physics.validation import CaseResult, Check, Curve, Figure, absolute, case
from wt_gym.aerodynamics import AeroOptions, AeroState, LatticePlanform, VortexLattice, build_planform

# ---- wings as inviscid vortex lattices ------------------------------------------------------------------------------
# Wings lie in the y–z plane with the chord along +y and the span along +z; the lift points along +x.

INVISCID: dict[str, Any] = {
    "viscous": False, "far_wake": False, "bound_core": 1e-4, "wake_core": 1e-3, "squire": 0.0, "viscosity": 0.0,
}  # fmt: skip
"""Potential flow with vortices as thin as single precision allows."""
MIRRORED = {"ground_height": 0.0}
"""The plane z = 0 as plane of symmetry: the images of wing and wake are the other half."""
DRIFTING = {"fresh_rows": 0, "refresh_stride": 10**9}
"""A wake that drifts with the stream: at small incidence the velocity it induces on itself is of second order."""
STRIPS_OF_A_SECTION = 8
"""Strips of the half wing that stands for a section."""


class UniformStream:
    """An inflow of one velocity everywhere.

    ``velocity`` (3,) [m/s].
    """

    def __init__(self, velocity: ArrayLike):
        self.vector = np.asarray(velocity, dtype=np.float64)

    @classmethod
    def at_incidence(cls, alpha: float, speed: float = 1.0) -> "UniformStream":
        """Stream that meets a wing in the y–z plane at the angle of attack ``alpha`` [rad]."""
        return cls(speed * np.array([np.sin(alpha), np.cos(alpha), 0.0]))

    def velocity(self, points: ArrayLike, time: ArrayLike) -> NDArray[np.float64]:
        """Wind at the points (..., 3) [m/s]."""
        return np.broadcast_to(self.vector, np.shape(points))


def half_span_edges(half_span: float, n_span: int, inset: float = 0.25) -> np.ndarray:
    """Even span edges from the plane of symmetry at z = 0 to ``inset`` panel widths before the tip (Hough 1973)."""
    return half_span / (n_span + inset) * np.arange(n_span + 1)


def flat_planform(
    edges: ArrayLike,
    chord: float | NDArray[np.float64],
    n_chord: int,
    le_offset: float | NDArray[np.float64] = 0.25,
    polar: NDArray[np.float64] | None = None,
) -> LatticePlanform:
    """Flat wing whose reference axis is the z axis.

    ``edges`` (n_span + 1,): span coordinates of the lattice [m]; ``chord``, ``le_offset`` (n_span + 1,): chord [m] and
    distance from the leading edge to the axis, in chords; ``n_chord``: panels along the chord; ``polar`` (n_alpha, 3)
    of the sections, on even angles from -pi on; a flat plate's in potential flow if not given.
    """
    edges = np.asarray(edges, dtype=np.float64)
    one = np.ones_like(edges)
    if polar is None:
        angles = np.linspace(-np.pi, np.pi, 360, endpoint=False)
        polar = np.column_stack([2.0 * np.pi * np.sin(angles), 0.0 * angles, 0.0 * angles])
    axis = np.column_stack([0.0 * edges, 0.0 * edges, edges])
    polars = np.tile(polar, (edges.size - 1, 1, 1))
    return build_planform(edges, axis, chord * one, 0.0 * one, le_offset * one, polars, n_chord)


def two_dimensional_planform(n_chord: int, polar: NDArray[np.float64] | None = None) -> LatticePlanform:
    """Half of a very long wing, to be mirrored at z = 0; its first strip, one chord wide, is the section.

    The strips grow threefold outwards up to 512 panel chords: half a panel chord away from a longer segment, the
    difference of two nearly equal products in the Biot-Savart kernel is lost in single precision, and the outer strips
    become unstable. With 8, 16, 24 panels the aspect ratio is 590, 330, 230.
    """
    widths = np.minimum(3.0 ** np.arange(STRIPS_OF_A_SECTION), 512.0 / n_chord)
    return flat_planform(np.concatenate(([0.0], np.cumsum(widths))), 1.0, n_chord, polar=polar)


def panels_of(planform: LatticePlanform) -> dict[str, int]:
    """Options with the numbers of panels of this planform."""
    return {"n_chord": planform.n_chord, "n_span": planform.n_span}


def steady_wing(
    planform: LatticePlanform, alpha: float, **options: Any
) -> tuple[VortexLattice, AeroState, UniformStream]:
    """Lattice and state of a half wing, mirrored at z = 0, with a straight wake of one row, two thousand spans long."""
    chosen = INVISCID | MIRRORED | panels_of(planform) | {"wake_rows": 1} | options
    lattice = VortexLattice(planform, 1, AeroOptions(**chosen), 1.0)
    stream = UniformStream.at_incidence(alpha)
    state = lattice.new_state()
    nodes = planform.nodes[None].copy()
    still = np.zeros_like(nodes)
    edge = 0.25 * nodes[:, -2] + 0.75 * nodes[:, -1]
    length = 2e3 * (planform.span_edges[-1] - planform.span_edges[0])
    lattice.initialize_wake(state, nodes, still, still + stream.vector, [edge + length * stream.vector], [length])
    return lattice, state, stream


def steady_coefficients(state: AeroState, stream: UniformStream, area: float) -> tuple[float, float]:
    """Lift and drag coefficient of a half wing of this area in a unit stream in the x–y plane."""
    total = state.nodal_forces.sum(axis=(0, 1, 2)) / (0.5 * area)
    along = stream.vector
    return float(total @ [along[1], -along[0], 0.0]), float(total @ along)


def far_field_drag(circulation: ArrayLike, edges: ArrayLike) -> float:
    """Induced drag of a mirrored half wing with a straight wake, from the Trefftz plane, density 1 [N].

    Half of ∫ Γ w dz over the half span, with the downwash w of the two-dimensional point vortices in which the strips
    of both halves end, taken at the middle of each strip (Munk 1921; Katz & Plotkin, Low-Speed Aerodynamics, 8.4).
    """
    half, span = np.asarray(circulation), np.asarray(edges)
    whole, ends = np.r_[half[::-1], half], np.r_[-span[:0:-1], span]
    trailing = np.diff(np.concatenate(([0.0], whole, [0.0])))
    middle = 0.5 * (ends[1:] + ends[:-1])
    downwash = (trailing / (2.0 * np.pi * (ends - middle[:, None]))).sum(axis=1)
    return 0.25 * abs(float(np.sum(whole * downwash * np.diff(ends))))


class WingFlow:
    """A half wing, mirrored at z = 0, marched in time from rest or from an impulsive start.

    ``n_steps``: number of steps for which wake rows are kept; ``dt`` [s]; ``drifting``: let the wake drift with the
    stream instead of moving freely; ``options``: further `AeroOptions`.
    """

    def __init__(
        self,
        planform: LatticePlanform,
        stream: UniformStream,
        n_steps: int,
        dt: float,
        drifting: bool = True,
        **options: Any,
    ):
        rows = {"wake_rows": n_steps + 1, "full_rows": n_steps + 1, "fresh_rows": n_steps + 1}
        chosen = INVISCID | MIRRORED | panels_of(planform) | rows | (DRIFTING if drifting else {}) | options
        self.lattice = VortexLattice(planform, 1, AeroOptions(**chosen), 1.0)
        self.state = self.lattice.new_state()
        self.stream, self.dt, self.n_done = stream, float(dt), 0
        self.nodes = planform.nodes[None].copy()
        self.still = np.zeros_like(self.nodes)
        self.wind = self.still + stream.vector

    def start_from_rest(self) -> None:
        """Begin without circulation; the first step brings wind and motion, without the impulse of the start."""
        self.lattice.reset(self.state, self.nodes, self.still, self.still)

    def start_moving(self, nodes: NDArray[np.float64], velocities: NDArray[np.float64]) -> None:
        """Begin with the circulation of this motion (1, n_chord + 1, n_span + 1, 3), without a wake."""
        self.lattice.reset(self.state, nodes, velocities, self.wind)

    def step(
        self,
        nodes: NDArray[np.float64] | None = None,
        velocities: NDArray[np.float64] | None = None,
        gust: NDArray[np.float64] | None = None,
    ) -> NDArray[np.float64]:
        """Forces on the ring nodes (n_chord + 1, n_span + 1, 3) after one more step; at rest where nothing is given.

        ``gust`` (1, n_chord + 1, n_span + 1, 3) is the velocity of the air beside the stream at the nodes [m/s]; the
        wake drifts with the stream, as in linear theory.
        """
        self.lattice.convect_wake(self.state, self.stream, self.n_done * self.dt, self.dt)
        forces = self.lattice.solve(
            self.state,
            self.nodes if nodes is None else nodes,
            self.still if velocities is None else velocities,
            self.wind if gust is None else self.wind + gust,
            self.dt,
        )
        self.lattice.accept(self.state)
        self.n_done += 1
        return forces[0]

    def section_lift(self, forces: NDArray[np.float64]) -> float:
        """Lift coefficient of the first strip of a mirrored wing: half of its force acts on the nodes at z = 0."""
        width = self.lattice.planform.span_edges[1] - self.lattice.planform.span_edges[0]
        return float(2.0 * forces[:, 0, 0].sum() / (0.5 * width))

    def section_moment(self, forces: NDArray[np.float64]) -> float:
        """Moment coefficient of that strip about the reference axis, nose-up positive, chord 1."""
        width = self.lattice.planform.span_edges[1] - self.lattice.planform.span_edges[0]
        return float(-2.0 * forces[:, 0, 0] @ self.nodes[0, :, 0, 1] / (0.5 * width))


# ---- Wagner and Theodorsen ------------------------------------------------------------------------------------------
# The airfoil is the first strip of a very long half wing that the ground mirrors. Chord, stream and density are 1, so
# that a step of one panel chord is 1 / n_chord and the reduced frequency is k = ω / 2.

WAGNER_SOURCE = "Wagner 1925; φ(s) from the inverse transform of Theodorsen's C(k), computed to all digits shown"
WAGNER = (
    (0.5, 0.55566), (1.0, 0.60061), (2.0, 0.66929), (4.0, 0.75797), (5.0, 0.78820), (10.0, 0.87504), (20.0, 0.93665),
    (40.0, 0.97027),
)  # fmt: skip
"""Travel in semi-chords and lift over its final value."""
THEODORSEN_SOURCE = "Theodorsen 1935, NACA TR-496: C(k) from Hankel functions, with the apparent mass"
FREQUENCIES = {0.05: 8, 0.1: 8, 0.2: 8, 0.3: 8, 0.5: 8, 1.0: 16}
"""Reduced frequency and the panels along the chord that it needs."""
AMPLITUDE = 1e-4
"""Of the angle of attack [rad]: small, so that the linear theory applies."""


def wagner_response(n_chord: int, distance: float) -> tuple[np.ndarray, np.ndarray]:
    """Travel in semi-chords, up to a distance, and lift over its final value after a sudden start, both (n_steps,)."""
    dt = 1.0 / n_chord
    n_steps = round(0.5 * distance / dt)
    flow = WingFlow(two_dimensional_planform(n_chord), UniformStream.at_incidence(AMPLITUDE), n_steps, dt)
    flow.start_from_rest()
    lift = np.array([flow.section_lift(flow.step()) for _ in range(n_steps)])
    return 2.0 * dt * np.arange(1, n_steps + 1), lift / (2.0 * np.pi * AMPLITUDE)


@case("wagner", "Lift of a flat plate after a sudden start (Wagner)", WAGNER_SOURCE, quick={"distance": 6.0})
def wagner(distance=41.0) -> CaseResult:
    """Step response at 32 panels and one panel chord a step, from s = 0.5 on within 1 %."""
    travel, lift = wagner_response(32, distance)
    coarse_travel, coarse = wagner_response(16, distance)
    known = [row for row in WAGNER if row[0] < distance]
    middle = 0.5 * coarse_travel[0]
    checks = [
        Check(f"φ(s = {s:g}), 32 panels", value, np.interp(s, travel, lift), 0.01, source=WAGNER_SOURCE)
        for s, value in known
    ]
    checks += [
        Check(f"φ(s = {s:g}), 16 panels, s from the middle of the first step", value,
              np.interp(s + middle, coarse_travel, coarse), 0.005, source=WAGNER_SOURCE)
        for s, value in known
    ]  # fmt: skip
    s, value = np.array(WAGNER).T
    curves = [Curve(s, value, "Wagner", "ko"), Curve(travel[3:], lift[3:], "32 panels")]
    for n_chord in (4, 8):
        travel, lift = wagner_response(n_chord, distance)
        curves.append(Curve(travel[3:], lift[3:], f"{n_chord} panels", "--"))
    at_two = ", ".join(
        f"{n}: {100 * (np.interp(2.0, *wagner_response(n, 3.0)) / WAGNER[2][1] - 1):.2f}" for n in (4, 8, 16, 32)
    )
    notes = (
        "The lift is Wagner's half a step ago, an error of first order in the step. Error at s = 2 in % by panels "
        f"along the chord: {at_two}. Counted from the middle of the first step, 16 panels are within 0.3 % from s = "
        "0.5 and within 0.01 % from s = 2 to 10. The first two steps are left out of the picture."
    )
    return CaseResult(checks, {"lift after a sudden start": Figure(tuple(curves), "s [semi-chords]", "φ")}, notes)


def theodorsen(k: Any) -> Any:
    """Lift-deficiency function C(k) = H₁⁽²⁾ / (H₁⁽²⁾ + i H₀⁽²⁾)."""
    return hankel2(1, k) / (hankel2(1, k) + 1j * hankel2(0, k))


def exact_lift(motion: str, k: Any) -> Any:
    """Complex lift coefficient of a unit amplitude of plunge velocity (downwards) or of pitch about the quarter chord.

    cl = 2 [π b² (V α̇ + ḧ − b a α̈) + 2 π V b C (V α + ḣ + b (½ − a) α̇)], h positive downwards,
    with b = ½, V = 1, ω = 2 k (Theodorsen 1935, eq. XVIII).
    """
    k = np.asarray(k, dtype=float)
    rate = 2j * k
    if motion == "plunge":
        return 2.0 * (np.pi / 4.0 * rate + np.pi * theodorsen(k))
    a = -0.5
    return 2.0 * (np.pi / 4.0 * (rate - 0.5 * a * rate**2) + np.pi * theodorsen(k) * (1.0 + 0.5 * (0.5 - a) * rate))


@lru_cache(maxsize=64)
def oscillating_lift(
    motion: str, k: float, n_chord: int, steps_per_panel: float = 1.0, shed_fraction: float = 0.25,
    load_form: str = "joukowski",
) -> complex:  # fmt: skip
    """Complex lift coefficient of the lattice for a unit amplitude of the motion; see `exact_lift`.

    The motion starts from zero angle of attack; the last of its periods is fitted with one harmonic and a straight
    line, which takes up what is left of the start.
    """
    omega = 2.0 * k
    dt = 1.0 / (n_chord * steps_per_panel)
    period = round(2.0 * np.pi / (omega * dt))
    dt = 2.0 * np.pi / (omega * period)  # whole steps in a period
    n_steps = max(2, 2 + round(2.0 * k)) * period
    planform = two_dimensional_planform(n_chord)
    flow = WingFlow(planform, UniformStream.at_incidence(0.0), n_steps, dt, shed_fraction=shed_fraction,
                    load_form=load_form)  # fmt: skip

    def motion_at(time: float) -> tuple[np.ndarray, np.ndarray]:
        """Displacement along x and its rate at all nodes; the axis of pitch, the quarter chord, lies at y = 0."""
        sine, cosine = AMPLITUDE * np.sin(omega * time), AMPLITUDE * np.cos(omega * time)
        nodes, velocities = flow.nodes.copy(), flow.still.copy()
        if motion == "plunge":
            nodes[..., 0] += (cosine - AMPLITUDE) / omega
            velocities[..., 0] = -sine
        else:
            nodes[..., 0] -= flow.nodes[..., 1] * sine
            velocities[..., 0] = -flow.nodes[..., 1] * omega * cosine
        return nodes, velocities

    flow.start_moving(*motion_at(0.0))
    lift = np.array([flow.section_lift(flow.step(*motion_at((m + 1) * dt))) for m in range(n_steps)])[-period:]
    phase = omega * dt * np.arange(n_steps - period + 1, n_steps + 1)
    base = np.column_stack([np.sin(phase), np.cos(phase), np.ones(period), phase])
    fit = np.linalg.lstsq(base, lift, rcond=None)[0] / AMPLITUDE
    return complex(fit[0], fit[1])


def _compare(motion: str, k: float, obtained: complex) -> list[Check]:
    """Checks of amplitude (2 %) and phase (2°) against Theodorsen."""
    exact = exact_lift(motion, k)
    label = f"{motion}, k = {k:g}"
    return [
        Check(f"{label}: amplitude of cl", abs(exact), abs(obtained), 0.02, source=THEODORSEN_SOURCE),
        Check(f"{label}: phase of cl", np.degrees(np.angle(exact)), np.degrees(np.angle(obtained)), absolute(2.0),
              "deg", source=THEODORSEN_SOURCE),
    ]  # fmt: skip


@case(
    "theodorsen",
    "Oscillating flat plate, plunge and pitch (Theodorsen)",
    THEODORSEN_SOURCE,
    slow=True,
    quick={"frequencies": {0.1: 8, 0.3: 8}},
)
def theodorsen_case(frequencies=FREQUENCIES) -> CaseResult:
    """Amplitude and phase of the lift for k = 0.05 … 1 with 8 and 16 panels."""
    checks, figures = [], {}
    k = np.geomspace(0.03, 1.2, 60)
    marks = np.array(list(frequencies))
    for motion in ("plunge", "pitch"):
        obtained = [oscillating_lift(motion, x, n) for x, n in frequencies.items()]
        for x, value in zip(frequencies, obtained, strict=True):
            checks += _compare(motion, x, value)
        exact = exact_lift(motion, k)
        figures[f"amplitude of the lift in {motion}"] = Figure((
            Curve(k, np.abs(exact), "Theodorsen"),
            Curve(marks, np.abs(obtained), "lattice", "o"),
        ), "k", "|cl| per rad", log_x=True)  # fmt: skip
        figures[f"phase of the lift in {motion}"] = Figure((
            Curve(k, np.degrees(np.angle(exact)), "Theodorsen"),
            Curve(marks, np.degrees(np.angle(obtained)), "lattice", "o"),
        ), "k", "phase [deg]", log_x=True)  # fmt: skip
    panels = ", ".join(f"k = {x:g}: {n}" for x, n in frequencies.items())
    notes = f"Panels along the chord ({panels}); one panel chord a step. Pitch is about the quarter chord."
    return CaseResult(checks, figures, notes)


@case("theodorsen-convergence", "Convergence of the unsteady lift in panels, step and wake", THEODORSEN_SOURCE)
def theodorsen_convergence() -> CaseResult:
    """Extrapolated lift at k = 0.5 and 1, and what coarse chords, other steps and shed positions cost."""
    checks, curves = [], []
    counts = (1, 2, 4, 8, 16)
    for k in (0.5, 1.0):
        exact = exact_lift("plunge", k)
        lift = np.array([oscillating_lift("plunge", k, n) for n in counts])
        extrapolated = (4.0 * lift[-1] - lift[-2]) / 3.0  # takes out the second order
        source = THEODORSEN_SOURCE
        name = f"plunge, k = {k:g}, extrapolated from 8 and 16 panels"
        checks.append(Check(f"{name}: amplitude of cl", abs(exact), abs(extrapolated), 0.005, source=source))
        checks.append(
            Check(f"{name}: phase error", 0.0, np.degrees(np.angle(extrapolated / exact)), 0.5, "deg", source=source)
        )
        curves.append(Curve(counts, np.abs(lift / exact - 1.0), f"k = {k:g}, step 1 panel", "o-"))
    for label, steps, shed in (("step ½ panel", 2.0, 0.25), ("step 2 panels", 0.5, 0.25), ("shed at ½", 1.0, 0.5)):
        lift = np.array([oscillating_lift("plunge", 0.5, n, steps, shed) for n in counts[1:]])
        curves.append(Curve(counts[1:], np.abs(lift / exact_lift("plunge", 0.5) - 1.0), f"k = 0.5, {label}", "x--"))
    size = ", ".join(
        f"{n}: {100 * abs(abs(oscillating_lift('plunge', 1.0, n) / exact_lift('plunge', 1.0)) - 1):.1f}" for n in counts
    )
    notes = (
        f"Error of the lift amplitude at k = 1 in % by panels along the chord: {size}; of second order. A step is one "
        "panel chord. The Kutta-Joukowski sum misses the vorticity -Γ̇/V of the last quarter panel, ρ Γ̇ p/4 of lift "
        "per span (p = panel chord); half of the last ring in the added mass takes it into account, with the whole "
        "ring the error would be of first order, 3 % with 16 panels at k = 1. Steps of half a panel, or a newest row "
        "further behind than a quarter of the way, converge with the square root of the panel size only."
    )
    figure = Figure(tuple(curves), "panels along the chord", "|cl / exact - 1|", log_x=True, log_y=True)
    return CaseResult(checks, {"error of the unsteady lift": figure}, notes)


# ---- Küssner and Sears ----------------------------------------------------------------------------------------------
# The gust is at rest in the air and carried over the chord by the stream: every collocation point meets it at its own
# time. (A gust that the whole chord feels at once is a plunging motion, with Wagner's and Theodorsen's functions.)
# Chord, stream and density are 1; s counts semi-chords, and the reduced frequency is k = ω / 2.

KUSSNER_SOURCE = "Küssner 1936, von Kármán & Sears 1938; ψ(s) from its inverse Laplace transform"
KUSSNER = (
    (0.5, 0.30581), (1.0, 0.41669), (2.0, 0.55081), (4.0, 0.69454), (8.0, 0.82255), (16.0, 0.91177), (32.0, 0.95988),
)  # fmt: skip
"""Travel in semi-chords since the leading edge met the gust, and lift over its final value."""
SEARS_SOURCE = "Sears 1941, J. Aeronaut. Sci. 8:104; S(k) from Hankel functions, gust phase at mid-chord"
SEARS = (
    (0.05, 0.91422, -8.067), (0.1, 0.83735, -11.258), (0.2, 0.71949, -12.819), (0.3, 0.63602, -11.391),
    (0.5, 0.52648, -4.797), (0.7, 0.45718, 3.987), (1.0, 0.38957, 18.862),
)  # fmt: skip
"""Reduced frequency, amplitude and phase [deg] of S."""
GUST = 1e-4
"""Velocity of the gust: small, so that the linear theory applies."""
LEADING_EDGE, MID_CHORD = -0.25, 0.25
"""On the y axis of the wing; the quarter chord lies at 0."""


def kussner(s):
    """Küssner's function at travels s > 0 in semi-chords, by quadrature.

    ψ = 1 − ∫ e^{−x(s−1)} (I₀ + I₁) / (x² [(K₁ − K₀)² + π² (I₀ + I₁)²]) dx over x from 0 to ∞: the branch cut of
    e^{−p} / (p² [K₀(p) + K₁(p)]).
    """
    s = np.asarray(s, dtype=float)
    u = np.linspace(np.log(1e-7), np.log(4e3), 40001)
    x = np.exp(u)
    i, k = ive(0, x) + ive(1, x), kve(1, x) - kve(0, x)  # e^{-x} I, e^{x} K
    damped = np.exp(-2.0 * x)
    integrand = i / (x * (k**2 * damped**2 + np.pi**2 * i**2))
    return 1.0 - np.trapezoid(np.exp(-x * s[..., None]) * integrand, u, axis=-1)


def sears(k):
    """Sears' function, gust phase taken at mid-chord: 2i / (πk [H₁⁽²⁾ + i H₀⁽²⁾])."""
    return 2j / (np.pi * k * (hankel2(1, k) + 1j * hankel2(0, k)))


@lru_cache(maxsize=8)
def sharp_edged_gust(n_chord: int, distance: float) -> tuple[np.ndarray, np.ndarray]:
    """Lift after the leading edge has met a gust, over its final value.

    The stream passes one panel a step, and the gust's edge is spread over one panel.

    Returns ``travel``, ``lift`` (n_steps,): semi-chords.
    """
    dt = 1.0 / n_chord
    n_steps = round(0.5 * distance / dt)
    flow = WingFlow(two_dimensional_planform(n_chord), UniformStream.at_incidence(0.0), n_steps, dt)
    flow.start_from_rest()
    along, lift = flow.nodes[..., 1], np.empty(n_steps)
    for m in range(n_steps):
        behind = LEADING_EDGE + (m + 1) * dt - along
        gust = flow.still.copy()
        gust[..., 0] = GUST * np.clip(behind * n_chord + 0.5, 0.0, 1.0)
        lift[m] = flow.section_lift(flow.step(gust=gust))
    return 2.0 * dt * np.arange(1, n_steps + 1), lift / (2.0 * np.pi * GUST)


@lru_cache(maxsize=32)
def gust_waves(k: float, n_chord: int) -> tuple[complex, complex]:
    """Complex lift and moment about the quarter chord in waves of reduced frequency k, over 2π w₀/V.

    The last of at least three periods, at least twenty chords long, is fitted with one harmonic and a straight line.

    Returns ``lift``, ``moment``: relative to the gust at mid-chord.
    """
    omega = 2.0 * k
    period = round(2.0 * np.pi / omega * n_chord)
    dt = 2.0 * np.pi / (omega * period)  # whole steps in a period
    n_steps = max(3, 1 + int(np.ceil(20.0 * n_chord / period))) * period
    flow = WingFlow(two_dimensional_planform(n_chord), UniformStream.at_incidence(0.0), n_steps, dt)

    def gust(time):
        velocity = flow.still.copy()
        velocity[..., 0] = GUST * np.sin(omega * (time - (flow.nodes[..., 1] - MID_CHORD)))
        return velocity

    flow.start_from_rest()
    signal = np.empty((n_steps, 2))
    for m in range(n_steps):
        forces = flow.step(gust=gust((m + 1) * dt))
        signal[m] = flow.section_lift(forces), flow.section_moment(forces)
    phase = omega * dt * np.arange(n_steps - period + 1, n_steps + 1)
    base = np.column_stack([np.sin(phase), np.cos(phase), np.ones(period), phase])
    fit = np.linalg.lstsq(base, signal[-period:], rcond=None)[0] / (2.0 * np.pi * GUST)
    return complex(fit[0, 0], fit[1, 0]), complex(fit[0, 1], fit[1, 1])


@case(
    "kussner", "Lift of a flat plate that enters a sharp-edged gust (Küssner)", KUSSNER_SOURCE, quick={"distance": 9.0}
)
def kussner_case(distance=33.0) -> CaseResult:
    """Step response at 16 panels and one panel chord a step, from s = 0.5 on within 2 %."""
    travel, lift = sharp_edged_gust(16, distance)
    checks = [
        Check(f"ψ(s = {s:g}), 16 panels", value, np.interp(s, travel, lift), 0.02, source=KUSSNER_SOURCE)
        for s, value in KUSSNER
        if s < distance
    ]
    curves = [Curve(travel, kussner(travel), "Küssner", "k"), Curve(travel, lift, "16 panels", ".")]
    coarse = sharp_edged_gust(8, distance)
    curves.append(Curve(*coarse, "8 panels", "x"))
    notes = (
        "Each collocation point meets the gust at its own time; the edge is spread over one panel. With 8 panels the "
        f"error is {100 * (np.interp(1.0, *coarse) / KUSSNER[1][1] - 1):.1f} % at s = 1."
    )
    return CaseResult(checks, {"lift in a sharp-edged gust": Figure(tuple(curves), "s [semi-chords]", "ψ")}, notes)


@case(
    "sears",
    "Flat plate in sinusoidal gusts carried over it by the stream (Sears)",
    SEARS_SOURCE,
    slow=True,
    quick={"table": (SEARS[3], SEARS[5])},
)
def sears_case(table=SEARS) -> CaseResult:
    """Amplitude within 2 % and phase within 2° for k = 0.05 … 1; the lift acts at the quarter chord."""
    checks, obtained = [], []
    for frequency, amplitude, phase in table:
        lift, moment = gust_waves(frequency, 8 if frequency <= 0.5 else 16)
        obtained.append(lift)
        checks += [
            Check(f"k = {frequency:g}: amplitude of S", amplitude, abs(lift), 0.02, source=SEARS_SOURCE),
            Check(f"k = {frequency:g}: phase of S", phase, np.degrees(np.angle(lift)), absolute(2.0), "deg",
                  source=SEARS_SOURCE),
            Check(f"k = {frequency:g}: center of pressure before the quarter chord, in chords", 0.0,
                  abs(moment / lift), 0.01,
                  source="Sears 1941: the lift of the gust acts at the quarter chord"),
        ]  # fmt: skip
    k, marks = np.geomspace(0.04, 1.2, 60), np.array(table)[:, 0]
    figures = {
        "amplitude of the lift in waves": Figure((
            Curve(k, np.abs(sears(k)), "Sears"),
            Curve(marks, np.abs(obtained), "lattice", "o"),
        ), "k", "|S|", log_x=True),
        "phase of the lift in waves": Figure((
            Curve(k, np.degrees(np.angle(sears(k))), "Sears"),
            Curve(marks, np.degrees(np.angle(obtained)), "lattice", "o"),
        ), "k", "phase at mid-chord [deg]", log_x=True),
    }  # fmt: skip
    return CaseResult(checks, figures, "8 panels along the chord up to k = 0.5, then 16; one panel chord a step.")
