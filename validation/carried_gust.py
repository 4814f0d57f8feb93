"""A step of the wind that is carried downstream: its front overtakes the rings that the rotor has shed.

The rows of a wake move with the air about them, which the rotor has slowed; a frozen wind field moves with the mean
speed. Behind the front of a faster wind the rows move faster than those ahead of it, so that it drives them together.
The wake is stronger there for a while, and the thrust gains less than in a wind that changes everywhere at once.

The theory that the lattice is compared with has no blades: rings of a cylinder of the rotor's radius are shed at the
rate of the thrust, F = T / (ρ A) (the jump of the pressure head), and carried with the wind and what they induce on
each other,

    ∂g/∂t + ∂(c g)/∂z = 0,   c g = F at z = 0,   c = V + v(z, t) + u(z),

g the circulation per length, v the change of the wind, u the velocity at the cylinder's own radius (complete elliptic
integral, Branlard & Gaunaa, Wind Energ. 18 (2015)). The disc feels the mean over its area of what the rings induce (the
mutual inductance of two rings, Maxwell), and the thrust follows wind and induced velocity with the slopes of the blade
elements. For a small sinusoidal gust carried with
V the solution is

    g' = g/(V − c) (exp(−iωz/V) − exp(−iωz/c)) + (F' − g)/c exp(−iωz/c);

the first term is missing in a gust that is felt everywhere at once. It was measured on a rotor of 1.8 m in gusts from
an active grid, and found with a free wake: the induced velocity amplified, the load less than that of blade elements
with Øye's filter (Berger et al., Wind Energ. Sci. 7 (2022) 1827).
"""

from __future__ import annotations

import numpy as np
from scipy.special import ellipe, ellipkm1

from validation.case import CaseResult, Check, Curve, Figure, absolute, case
from validation.dynamic_inflow import DynamicRotor
from validation.rotor_transients import WHOLE_FIELD, Ramp, five_megawatt_step, long_wake
from validation.wind_step import ROTOR_SPEED, WIND
from wt_gym.aerodynamics import ENGINEERING, TRAINING
from wt_gym.turbines import load_turbine
from wt_gym.turbines.blade_element import BladeElementRotor

__all__ = ["WINDOWS", "carried_part", "mean_in_windows", "ring_wake_step"]

SOURCE = "transport of the rings of a vortex cylinder, own calculation"
ELEMENTS = "blade elements with Øye's filter, own calculation"
WINDOWS = ((2.0, 4.0), (4.0, 7.0), (7.0, 11.0), (11.0, 16.0), (16.0, 22.0), (22.0, 30.0))
"""Spans of time after the step over which the thrust is averaged [s]."""
CELL, LENGTH = 0.1, 25.0  # of the ring theory, in radii


def at_own_radius(distance):
    """Axial velocity of a semi-infinite cylinder of unit strength at its own radius, ``distance`` radii behind it."""
    z = np.where(np.abs(distance) < 1e-9, 1e-9, distance)
    square = 4.0 + z * z
    return 0.25 * (1.0 + 2.0 * z / np.sqrt(square) * ellipkm1(z * z / square) / np.pi)


def disc_mean_of_cells(edges, n_part: int = 40):
    """Mean over the disc at 0 of the axial velocity of cylinders of unit strength between ``edges``, all in radii.

    A ring of circulation Γ and radius R, z away, makes (2Γ/πkR) [(1 − k²/2) K(k) − E(k)], k² = 4R²/(4R² + z²), in the
    mean over a coaxial disc of radius R; a semi-infinite cylinder that starts at the disc makes ½.
    """
    part = (np.arange(n_part) + 0.5) / n_part
    z = edges[:-1, None] + np.diff(edges)[:, None] * part
    square = 4.0 / (4.0 + z * z)
    ring = (1.0 - 0.5 * square) * ellipkm1(1.0 - square) - ellipe(square)
    return (2.0 / (np.pi * np.sqrt(square)) * ring).mean(axis=1) * np.diff(edges)


def ring_wake_step(rotor: DynamicRotor, wind: Ramp, speed: float, carried: float, duration: float = 100.0, dt=0.1):
    """Thrust [N] after a step of the wind at constant rotor speed, by transport of rings.

    Parameters
    ----------
    rotor : DynamicRotor
        Gives the thrust before the step and its slopes with wind and induced velocity there.
    wind : Ramp
    speed : float
        [rad/s].
    carried : float
        Speed with which the change is carried downstream [m/s].
    duration, dt : float
        [s].

    Returns
    -------
    time, thrust : ndarray, shape (n,)
    """
    radius, density = rotor.rotor.radius, rotor.rotor.air_density
    before, induced, small = wind.before, rotor.equilibrium(wind.before, speed, 0.0), 0.01
    thrust = rotor.loads(before, speed, 0.0, induced)[0]
    change = np.array([small, 0.0])[:, None]
    by_wind = (rotor.loads(before + small, speed, 0.0, induced)[0] - thrust) / small
    by_wake = (thrust - rotor.loads(before, speed, 0.0, induced + change)[0]) / small
    rate = 1.0 / (density * np.pi * radius**2)
    edges = np.arange(0.0, LENGTH + 0.5 * CELL, CELL)
    share = disc_mean_of_cells(edges)
    rest = 0.5 - share.sum()
    own = at_own_radius(edges[:, None] - edges)
    own, own_tail = own[:, :-1] - own[:, 1:], own[:, -1]
    strength = np.full(len(edges) - 1, 0.5 * before)
    for _ in range(300):
        sheet = own @ strength + own_tail * strength[-1]
        strength = 0.5 * strength + 0.5 * rate * thrust / (before - 0.5 * (sheet[1:] + sheet[:-1]))
    start = share @ strength + rest * strength[-1]
    times = np.arange(0.0, duration, dt)
    found = np.empty(len(times))
    for i, time in enumerate(times):
        gust = wind(time + 1e-9 - edges * radius / carried) - before
        slowing = share @ strength + rest * strength[-1] - start
        found[i] = thrust + by_wind * gust[0] - by_wake * slowing
        speeds = before + gust - own @ strength - own_tail * strength[-1]
        flux = np.concatenate([[rate * found[i]], speeds[1:] * strength])
        strength = strength + dt / (CELL * radius) * (flux[:-1] - flux[1:])
    return times, found


def mean_in_windows(time, thrust, before: float, settled: float):
    """Means over `WINDOWS` of the change of a thrust by its lasting change."""
    inside = [(time > low) & (time <= high) for low, high in WINDOWS]
    return np.array([thrust[span].mean() - before for span in inside]) / (settled - before)


def carried_part(options):
    """Change of the thrust by its lasting change in `WINDOWS`: wind everywhere at once, and what carrying adds."""
    means = []
    for carried in (WHOLE_FIELD, WIND.before):
        run = five_megawatt_step(options, WIND, rotor_speed=ROTOR_SPEED, duration=100.0, settling=100.0,
                                 carried=carried)  # fmt: skip
        before = run.thrust[(run.time > -6.0) & (run.time < -1.0)].mean()  # tips before the hub feel a front early
        means.append(mean_in_windows(run.time, run.thrust, before, run.overshoot("thrust").settled))
    return means[0], means[1] - means[0]


def five_megawatt_elements() -> DynamicRotor:
    """The rotor of the NREL 5-MW turbine as blade elements."""
    return DynamicRotor(BladeElementRotor.of_turbine(load_turbine("nrel_5mw")), 30)


@case("carried-gust", "Rigid 5-MW rotor at constant speed, wind step 8 → 9 m/s at once and carried along", SOURCE,
      slow=True)  # fmt: skip
def carried_gust() -> CaseResult:
    """Thrust by its lasting change: at once within 0.04 of Øye's filter, what carrying adds within 0.03 of theory."""
    rotor = five_megawatt_elements()
    elements = rotor.respond(WIND, lambda time: 0.0 * time, ROTOR_SPEED, 100.0)
    found = elements.overshoot("thrust")
    at_once = mean_in_windows(elements.time, elements.thrust, found.before, found.settled)
    theory = []
    for carried in (WHOLE_FIELD, WIND.before):
        time, thrust = ring_wake_step(rotor, WIND, ROTOR_SPEED, carried)
        theory.append(mean_in_windows(time, thrust, elements.thrust[0], thrust[-50:].mean()))
    added = theory[1] - theory[0]
    runs = {"training": TRAINING, "engineering": ENGINEERING, "8 turns, open": long_wake(8.0, 24, n_span=10)}
    checks, curves, lines = [], [], []
    middles = [0.5 * (low + high) for low, high in WINDOWS]
    for name, options in runs.items():
        whole, part = carried_part(options)
        for (low, high), wanted, got in zip(WINDOWS, at_once, whole, strict=True):
            checks.append(Check(f"{name}, {low:g}–{high:g} s: thrust, wind everywhere at once", wanted, got,
                                absolute(0.04), source=ELEMENTS))  # fmt: skip
        for (low, high), wanted, got in zip(WINDOWS, added, part, strict=True):
            checks.append(Check(f"{name}, {low:g}–{high:g} s: what carrying the wind adds", wanted, got, absolute(0.03),
                                source=SOURCE))  # fmt: skip
        curves.append(Curve(middles, part, name, "o"))
        lines.append(f"{name}: at once {np.round(whole, 3)}, carrying adds {np.round(part, 3)}")
    lines.append(f"theory: at once {np.round(at_once, 3)}, carrying adds {np.round(added, 3)}")
    curves.append(Curve(middles, added, "transport of rings"))
    figure = Figure(tuple(curves), "time [s]", "thrust by its lasting change, carried minus at once")
    return CaseResult(checks, {"carried step": figure}, "\n".join(lines))
