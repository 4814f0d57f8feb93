"""The Tjæreborg 2-MW turbine as a rigid rotor: the classic measurement of dynamic inflow, a step of the pitch.

Three blades of 30.56 m, chord and twist linear along the span, NACA 4412 to 4424 (Øye 1991; Snel & Schepers 1995,
ECN-C--94-107). All sections have one polar, linear up to the angles that occur: c_l = 0.105 (α/deg + 4), c_d = 0.01.
"""

from __future__ import annotations

import numpy as np

from validation.case import CaseResult, Check, Curve, Figure, case
from validation.dynamic_inflow import DynamicRotor
from validation.rigid_rotor import RigidRotor
from validation.rotor_transients import Ramp, Response, long_wake, respond
from wt_gym.aerodynamics import ENGINEERING, TRAINING, AeroOptions, build_planform, span_distribution
from wt_gym.simulation.models import N_ALPHA
from wt_gym.turbines.airfoil import Polar
from wt_gym.turbines.blade_element import BladeElementRotor

SOURCE = "Øye 1991; Snel & Schepers 1995, ECN-C--94-107 (Tjæreborg, test II.4)"
__all__ = ["PITCH_TEST", "TIP", "WIND", "blade_elements", "pitch_steps", "rotor"]

ROOT, TIP = 6.46, 30.56
"""First aerodynamic section and tip [m]."""
ROTOR_SPEED = 22.36 * np.pi / 30.0
WIND = 8.7
"""Wind of test II.4 [m/s]."""
FLAP_RADIUS = 2.75
"""Where the flap moment was measured [m]."""
PITCH_TEST = Ramp(np.radians(0.07), np.radians(3.70), 0.0, 3.63 / 6.0, 30.0)
"""Pitch of test II.4: up by 3.63° at 6°/s, back after 30 s."""
STEPS = {"up": (0.0, 30.0), "back": (30.0, 60.0)}
"""Times between which the answers to the two steps are measured [s], as in the test itself."""
INBOARD, OUTBOARD = 0.5 * TIP, 0.95 * TIP
"""Radii at which the recovery of the loads is compared [m]."""
SLOPE, ZERO_LIFT, DRAG = np.degrees(0.105), np.radians(-4.0), 0.01
AIR_DENSITY = 1.225


def chord(z):
    """Chord [m] at a distance from the root [m]."""
    return 3.30 - (3.30 - 0.90) * np.asarray(z, dtype=float) / (TIP - ROOT)


def twist(z):
    """Twist [rad]: 8° at the root, none at the tip."""
    return np.radians(8.0) * (1.0 - np.asarray(z, dtype=float) / (TIP - ROOT))


def polar(z=0.0):
    """Polar of every section, continued over the full circle by a sine."""
    alpha = np.linspace(-np.pi, np.pi, N_ALPHA + 1)
    return Polar(alpha, SLOPE * np.sin(alpha - ZERO_LIFT), DRAG + 0.0 * alpha, 0.0 * alpha)


def rotor(options: AeroOptions) -> RigidRotor:
    """Three blades on the vortex lattice."""
    edges = span_distribution(0.0, TIP - ROOT, options.n_span)
    table = polar()
    strip = np.column_stack((table.cl, table.cd, table.cm))[:-1]
    axis = np.column_stack([0.0 * edges, 0.0 * edges, edges])
    planform = build_planform(
        edges, axis, chord(edges), twist(edges), 0.25 + 0.0 * edges, np.tile(strip, (options.n_span, 1, 1)),
        options.n_chord,
    )  # fmt: skip
    return RigidRotor(planform, 3, ROOT, TIP, 0.0, AIR_DENSITY)


def blade_elements() -> BladeElementRotor:
    """Three blades of blade-element theory."""
    return BladeElementRotor(3, ROOT, TIP - ROOT, TIP, 0.0, AIR_DENSITY, chord, twist, polar)


def pitch_steps(options: AeroOptions, settling: float = 50.0, duration: float = 60.0) -> Response:
    """Run test II.4 on the lattice; the way back begins at 30 s."""
    return respond(rotor(options), options, WIND, PITCH_TEST, ROTOR_SPEED, duration, settling, flap_radius=FLAP_RADIUS)


def _checks(name: str, run: Response):
    """Published bounds of one run."""
    checks = []
    for step, (start, end) in STEPS.items():
        torque, thrust = run.overshoot("torque", start, end), run.overshoot("thrust", start, end)
        label = f"{name}, pitch {step}"
        checks += [
            Check(f"{label}: change of torque to the extreme by the lasting one", "in [3, 7]", torque.ratio,
                  source=SOURCE),
            Check(f"{label}: change of thrust to the extreme by the lasting one", "in [1.5, 1.9]", thrust.ratio,
                  source=SOURCE),
            Check(f"{label}: time until a tenth of the torque's overshoot is left", "in [6, 14]", torque.recovery,
                  unit="s", source=SOURCE),
        ]  # fmt: skip
    fit = run.fit("thrust", *STEPS["up"])
    recovery = [run.overshoot(run.axial_at(r), *STEPS["up"]).mean_time for r in (OUTBOARD, INBOARD)]
    back = run.overshoot("thrust", *STEPS["back"]).mean_time / run.overshoot("thrust", *STEPS["up"]).mean_time
    checks += [
        Check(f"{name}: slow by fast time constant of the thrust", ">= 2.5", fit.slow_time / fit.fast_time,
              source="Øye 1991: two time constants, 1 / (0.39 - 0.26 r²/R²)"),
        Check(f"{name}: recovery at 0.95 R by that at 0.5 R", "<= 1", recovery[0] / recovery[1],
              source="Øye 1991: the tip is faster"),
        Check(f"{name}: recovery after the way back by that after the first step", ">= 1", back,
              source="Pirrung & Madsen 2018: slower towards high load"),
    ]  # fmt: skip
    return checks


def _line(name: str, run: Response) -> str:
    """Torque and thrust of one run in words."""
    parts = []
    for signal, scale, unit in (("torque", 1e3, "kN m"), ("thrust", 1e3, "kN")):
        up, back = (run.overshoot(signal, *times) for times in STEPS.values())
        values = np.array([up.before, up.extreme, up.settled, back.extreme, back.settled]) / scale
        parts.append(f"{signal} " + " → ".join(f"{x:.0f}" for x in values) + f" {unit}")
    fit = run.fit("thrust", *STEPS["up"])
    return f"{name}: {', '.join(parts)}; time constants of the thrust {fit.fast_time:.1f} and {fit.slow_time:.1f} s"


@case("tjaereborg", "Tjæreborg 2-MW rotor: overshoot after steps of the pitch", SOURCE, slow=True)
def tjaereborg() -> CaseResult:
    """Published bounds with both thinned wakes and with twelve turns of unthinned one."""
    runs = {
        "training": pitch_steps(TRAINING),
        "engineering": pitch_steps(ENGINEERING),
        "12 turns, open": pitch_steps(long_wake(12.0, 24)),
    }
    checks = [check for name, run in runs.items() for check in _checks(name, run)]
    element = DynamicRotor(blade_elements()).respond(lambda time: WIND + 0.0 * time, PITCH_TEST, ROTOR_SPEED, 60.0)
    runs["blade elements with Øye's filter"] = element
    lines = [_line(name, run) for name, run in runs.items()]
    lines.append("measured: torque 260 → 155…170 → 225…235 → 350…360 → 260 kN m (read off figures, ± 15 kN m)")
    figures = {
        f"{signal} after pitch steps": Figure(tuple(
            Curve(run.time[run.time > -5.0], getattr(run, signal)[run.time > -5.0] / 1e3, name)
            for name, run in runs.items()
        ), "time [s]", f"{signal} [{unit}]")
        for signal, unit in (("torque", "kN m"), ("thrust", "kN"))
    }  # fmt: skip
    return CaseResult(checks, figures, "\n".join(lines))
