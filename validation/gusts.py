"""A thin airfoil that flies through gusts: Küssner's sharp edge and Sears' waves, with the vortex lattice.

The gust is at rest in the air and carried over the chord by the stream: every collocation point meets it at its own
time. (A gust that the whole chord feels at once is a plunging motion, with Wagner's and Theodorsen's functions.)
Chord, stream and density are 1; s counts semi-chords, and the reduced frequency is k = ω / 2.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from scipy.special import hankel2, ive, kve

from validation.case import CaseResult, Check, Curve, Figure, absolute, case
from validation.lifting_tools import UniformStream, WingFlow, two_dimensional_planform

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

    Returns
    -------
    travel, lift : ndarray, shape (n_steps,)
        Semi-chords.
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

    Returns
    -------
    lift, moment : complex
        Relative to the gust at mid-chord.
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


@case("kussner", "Lift of a flat plate that enters a sharp-edged gust (Küssner)", KUSSNER_SOURCE)
def kussner_case() -> CaseResult:
    """Step response at 16 panels and one panel chord a step, from s = 0.5 on within 2 %."""
    travel, lift = sharp_edged_gust(16, 33.0)
    checks = [
        Check(f"ψ(s = {s:g}), 16 panels", value, np.interp(s, travel, lift), 0.02, source=KUSSNER_SOURCE)
        for s, value in KUSSNER
    ]
    curves = [Curve(travel, kussner(travel), "Küssner", "k"), Curve(travel, lift, "16 panels", ".")]
    coarse = sharp_edged_gust(8, 33.0)
    curves.append(Curve(*coarse, "8 panels", "x"))
    notes = (
        "Each collocation point meets the gust at its own time; the edge is spread over one panel. With 8 panels the "
        f"error is {100 * (np.interp(1.0, *coarse) / KUSSNER[1][1] - 1):.1f} % at s = 1."
    )
    return CaseResult(checks, {"lift in a sharp-edged gust": Figure(tuple(curves), "s [semi-chords]", "ψ")}, notes)


@case("sears", "Flat plate in sinusoidal gusts carried over it by the stream (Sears)", SEARS_SOURCE, slow=True)
def sears_case() -> CaseResult:
    """Amplitude within 2 % and phase within 2° for k = 0.05 … 1; the lift acts at the quarter chord."""
    checks, obtained = [], []
    for frequency, amplitude, phase in SEARS:
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
    k, marks = np.geomspace(0.04, 1.2, 60), np.array(SEARS)[:, 0]
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
