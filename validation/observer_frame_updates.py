"""Updates of the local observer frame: equations (9)–(12) as printed, and updates on demand.

Both on the blade-and-shaft example.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from validation.case import CaseResult, Check, Curve, Figure, case
from validation.observer_frame import (
    BACKWARDS,
    FLAP_LOAD,
    LENGTH,
    PAPER,
    SPEED,
    STEP,
    blade_beam,
    difference,
    edge_load,
    ramp,
    rotor,
    shaft_beam,
    simulate,
    thinned,
)
from wt_gym.multibody.observer_frame.frame import ObserverFrameSystem
from wt_gym.multibody.observer_frame.observer_frame_body import ObserverFrameError, Substructure
from wt_gym.multibody.observer_frame.observer_frame_integrator import ObserverFrameIntegrator

SLOW = 0.2
"""Speed of rotation [rad/s] at which finite elements follow the printed updates."""
PUSH = 10e3
"""Final flap load [N], reached in one second and then removed."""
END = 5.0
THRESHOLDS = (0.01, 0.1, 0.3, 2.0)
"""Displacements that call for an update [m]."""


def turning(speed, n_modes, prediction):
    """Integrator of the example turning freely at a speed [rad/s] while its tip is pushed flapwise."""
    system = ObserverFrameSystem()
    spin = (speed, 0.0, 0.0)
    system.add(Substructure.from_beam("blade", blade_beam(), n_modes=n_modes), angular_velocity=spin)
    shaft = Substructure.from_beam("shaft", shaft_beam(), markers={"front bearing": 2.0})
    system.add(shaft, rotation=BACKWARDS, angular_velocity=spin)
    system.weld("blade", "root", "shaft", "root")
    system.support("shaft", "front bearing", [(0.0, 1.0, 0.0), (0.0, 0.0, 1.0)])
    system.support("shaft", "tip")
    system.load("blade", "tip", ramp(PUSH, 0.0, 1.0), "undeformed")
    return ObserverFrameIntegrator(system, STEP, prediction=prediction)


def follow(speed, n_modes, prediction):
    """Largest relative change of the angular momentum about the shaft until END, and history (n, 2) of time and tip.

    The change is infinite when the motion diverges; the history then ends there.
    """
    run = turning(speed, n_modes, prediction)
    start, worst, history = run.momentum()[3], 0.0, []
    try:
        for _ in range(round(END / STEP / 8)):
            run.advance(8)
            worst = max(worst, abs(run.momentum()[3] / start - 1.0))
            history.append((run.time, run.position("blade", "tip")[0]))
    except ObserverFrameError:
        worst = np.inf
    return worst, np.array(history)


@case("observer-frame-printed-update", "Frame updates (9)–(12) as printed: where they work", f"{PAPER}, eqs. (9)–(12)")
def printed_updates() -> CaseResult:
    """The frame takes φ̈ of the last instant with it: harmless for few modes, and for finite elements turning slowly."""
    cases = ((SLOW, 16, "16 modes"), (SPEED, 16, "16 modes"), (SLOW, None, "finite elements"))
    checks, figures = [], {}
    for speed, n_modes, name in cases:
        worst, history = follow(speed, n_modes, "printed")
        _, known = follow(speed, n_modes, "uniform")
        at = f"{name} at {speed:g} rad/s"
        checks += [
            Check(f"{at}: largest change of the angular momentum about the shaft", "<= 1e-3", worst,
                  source="no torque about the shaft"),
            Check(f"{at}: rms difference of the tip in x₁ from uniformly moving frames", "<= 0.01",
                  difference(known[:, 1], history[:, 1]) if np.isfinite(worst) else np.inf,
                  source="the motion does not depend on the frame"),
        ]  # fmt: skip
        figures[f"Tip along x₁, {at}"] = Figure(
            (Curve(known[:, 0], known[:, 1], "uniform"), Curve(history[:, 0], history[:, 1], "as printed", "--")),
            "time [s]",
            "x₁ [m]",
        )
    worst, history = follow(SPEED, None, "printed")
    steady, _ = follow(SPEED, None, "uniform")
    checks.append(
        Check(f"finite elements at {SPEED:g} rad/s, uniform: largest change of the angular momentum about the shaft",
              "<= 1e-3", steady, source="no torque about the shaft")
    )  # fmt: skip
    fate = f"diverge after {history[-1, 0]:.1f} s" if np.isinf(worst) else f"change the angular momentum by {worst:.1g}"
    notes = (
        f"At {SPEED:g} rad/s finite elements with the printed updates {fate}: the undamped trapezoidal rule lets the "
        "accelerations of the stiffest modes alternate from step to step, and eq. (11) carries them into the frame. "
        "The default lets the frame move uniformly over a step; “accelerated” uses the mean since the last update."
    )
    return CaseResult(checks, figures, notes)


@case("observer-frame-threshold", "Frame updates on demand: tip and speed against updates in every step", PAPER)
def thresholds() -> CaseResult:
    """Load case 1 with 16 modes, updated when the rigid-body displacement exceeds a threshold."""
    edge, _ = edge_load()
    load = ramp(FLAP_LOAD, edge, 3.0)
    known = simulate(rotor(load, "undeformed", n_modes=16), 10.0)
    n_steps = len(known["time"]) - 1
    checks, curves, table = [], [], []
    for threshold in THRESHOLDS:
        run = rotor(load, "undeformed", n_modes=16, update=threshold)
        history = simulate(run, 10.0)
        tip, speed = difference(known["tip"][:, 0], history["tip"][:, 0]), difference(known["speed"], history["speed"])
        share = run.state.n_updates.max() / n_steps
        table.append((threshold, tip, speed, share))
        curves.append(Curve(*thinned(history, "tip", 0), f"{threshold:g} m", "--"))
    source = f"{PAPER}, future work: update by a displacement; the linear theory holds while it is small"
    for threshold, tip, speed, _ in table:
        if threshold > 0.3:
            continue
        at = f"threshold {threshold:g} m ({100 * threshold / LENGTH:.2g} % of the length)"
        checks += [
            Check(
                f"{at}: rms difference of the tip in x₁", f"<= {0.03 if threshold > 0.1 else 0.01}", tip, source=source
            ),
            Check(f"{at}: rms difference of Ω", "<= 0.01", speed, source=source),
        ]
    checks.append(Check(f"updates with {THRESHOLDS[1]:g} m over those in every step", "<= 0.5", table[1][3],
                        source=f"{PAPER}: not necessarily in each step"))  # fmt: skip
    errors = [tip for _, tip, _, _ in table]
    checks.append(Check("the error grows with the threshold: least ratio of the next larger one", ">= 1",
                        min(b / a for a, b in pairwise(errors)),
                        source="first order in the rotation of the body from its frame"))  # fmt: skip
    listed = "; ".join(
        f"{d:g} m: tip {100 * t:.1f} %, Ω {100 * s:.2f} %, {100 * n:.1f} % of the updates" for d, t, s, n in table
    )
    notes = (
        f"{listed}. A threshold of 2 m is a rotation φ of {2.0 / LENGTH:.3f} rad: linear theory adds a moment J ω² φ. "
        "Rotations count with the largest distance of the machine, so that a shaft turning about its own axis is "
        "updated with the blade that it carries."
    )
    figures = {
        "Tip along x₁ by threshold": Figure(
            (Curve(*thinned(known, "tip", 0), "every step"), *curves), "time [s]", "x₁ [m]"
        )
    }
    return CaseResult(checks, figures, notes)
