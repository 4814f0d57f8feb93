"""Thin airfoils in unsteady flow: Wagner's step response and Theodorsen's oscillations, with the vortex lattice.

The airfoil is the first strip of a very long half wing that the ground mirrors. Chord, stream and density
are 1, so that a step of one panel chord is 1 / n_chord and the reduced frequency is k = ω / 2.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np
from scipy.special import hankel2

from validation.case import CaseResult, Check, Curve, Figure, absolute, case
from validation.lifting_tools import UniformStream, WingFlow, two_dimensional_planform

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


def wagner_response(
    n_chord: int, distance: float, steps_per_panel: float = 1.0, shed_fraction: float = 0.25
) -> tuple[np.ndarray, np.ndarray]:
    """Lift after a sudden start, over its final value.

    Parameters
    ----------
    n_chord : int
        Panels along the chord.
    distance : float
        Travel in semi-chords.
    steps_per_panel : float
        Steps in which the stream passes one panel.
    shed_fraction : float
        Where the newest wake row lies on the path of the last step.

    Returns
    -------
    travel, lift : ndarray, shape (n_steps,)
    """
    dt = 1.0 / (n_chord * steps_per_panel)
    n_steps = round(0.5 * distance / dt)
    flow = WingFlow(
        two_dimensional_planform(n_chord), UniformStream.at_incidence(AMPLITUDE), n_steps, dt,
        shed_fraction=shed_fraction,
    )  # fmt: skip
    flow.start_from_rest()
    lift = np.array([flow.section_lift(flow.step()) for _ in range(n_steps)])
    return 2.0 * dt * np.arange(1, n_steps + 1), lift / (2.0 * np.pi * AMPLITUDE)


@case("wagner", "Lift of a flat plate after a sudden start (Wagner)", WAGNER_SOURCE)
def wagner() -> CaseResult:
    """Step response at 32 panels and one panel chord a step, from s = 0.5 on within 1 %."""
    travel, lift = wagner_response(32, 41.0)
    coarse_travel, coarse = wagner_response(16, 41.0)
    middle = 0.5 * coarse_travel[0]
    checks = [
        Check(f"φ(s = {s:g}), 32 panels", value, np.interp(s, travel, lift), 0.01, source=WAGNER_SOURCE)
        for s, value in WAGNER
    ]
    checks += [
        Check(f"φ(s = {s:g}), 16 panels, s from the middle of the first step", value,
              np.interp(s + middle, coarse_travel, coarse), 0.005, source=WAGNER_SOURCE)
        for s, value in WAGNER
    ]  # fmt: skip
    s, value = np.array(WAGNER).T
    curves = [Curve(s, value, "Wagner", "ko"), Curve(travel[3:], lift[3:], "32 panels")]
    for n_chord in (4, 8):
        travel, lift = wagner_response(n_chord, 41.0)
        curves.append(Curve(travel[3:], lift[3:], f"{n_chord} panels", "--"))
    at_two = ", ".join(
        f"{n}: {100 * (np.interp(2.0, *wagner_response(n, 3.0)) / WAGNER[2][1] - 1):.2f}" for n in (4, 8, 16, 32)
    )
    notes = (
        "What the lattice sheds in a step stands for a piece of the sheet one step long, and so does the starting "
        "vortex: the lift is Wagner's half a step ago, an error of first order in the step, and 1 % at s = 0.5 takes "
        f"32 panels. Error at s = 2 in % by panels along the chord: {at_two}. Counted from the middle of the first "
        "step, 16 panels are within 0.3 % from s = 0.5 and within 0.01 % from s = 2 to 10. (Counting the last ring in "
        "full in the added mass adds ρ Γ̇ p/4, p = panel chord, which happens to cancel the half step after a sudden "
        "start, but spoils the lift of oscillations: theodorsen-convergence.) The first step has no force of the "
        "changing circulation, the second one from a difference of first order; both are left out of the picture."
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


@case("theodorsen", "Oscillating flat plate, plunge and pitch (Theodorsen)", THEODORSEN_SOURCE, slow=True)
def theodorsen_case() -> CaseResult:
    """Amplitude and phase of the lift for k = 0.05 … 1 with 8 and 16 panels."""
    checks, figures = [], {}
    k = np.geomspace(0.03, 1.2, 60)
    marks = np.array(list(FREQUENCIES))
    for motion in ("plunge", "pitch"):
        obtained = [oscillating_lift(motion, x, n) for x, n in FREQUENCIES.items()]
        for x, value in zip(FREQUENCIES, obtained, strict=True):
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
    panels = ", ".join(f"k = {x:g}: {n}" for x, n in FREQUENCIES.items())
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
        "panel chord, so that one or two panels have no more than three or six steps in a period here. The bound "
        "vortices hold the circulation only up to the middle between the last of them and the first of the wake, a "
        "quarter panel before the trailing edge; the Kutta-Joukowski sum misses the vorticity -Γ̇/V of that quarter "
        "panel, ρ Γ̇ p/4 of lift per span (p = panel chord). Half of the last ring in the added mass takes it into "
        "account; with the whole ring the error would be of first order, 3 % with 16 panels at k = 1. The wake must "
        "continue the quarter points of the plate: steps of one panel with the newest row a quarter of the way. Steps "
        "of half a panel, or a row further behind, converge with the square root of the panel size only; with steps of "
        "two panels errors happen to cancel here."
    )
    figure = Figure(tuple(curves), "panels along the chord", "|cl / exact - 1|", log_x=True, log_y=True)
    return CaseResult(checks, {"error of the unsteady lift": figure}, notes)
