"""The Tjæreborg 2-MW turbine as a rigid rotor: the classic measurement of dynamic inflow, a step of the pitch.

Three blades of 30.56 m, chord and twist linear along the span, NACA 4412 to 4424 (Øye 1991; Snel & Schepers 1995,
ECN-C--94-107). All sections have one polar, linear up to the angles that occur: c_l = 0.105 (α/deg + 4), c_d = 0.01.
"""

from __future__ import annotations

import numpy as np

from validation.blade_element import BladeElementRotor
from validation.rigid_rotor import RigidRotor
from validation.rotor_transients import Ramp, Response, respond
from wt_gym.aerodynamics import AeroOptions, build_planform, span_distribution
from wt_gym.simulation.blade_lattice import N_ALPHA
from wt_gym.turbines.airfoil import Polar

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
