"""Dynamic stall of the S809 airfoil that pitches far: Øye's model alone, with a shed wake, and in the lattice.

Chord and speed are 1, so that the reduced frequency is k = ω / 2. The airfoil pitches about its quarter chord.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.optimize import brentq

from validation.case import CaseResult, Check, Curve, Figure, absolute, case
from validation.lifting_tools import UniformStream, WingFlow, two_dimensional_planform
from validation.phase_vi import PhaseSixBlade
from validation.unsteady_airfoil import exact_lift
from wt_gym.aerodynamics.lattice.planform import separation_tables

if TYPE_CHECKING:
    from numpy.typing import NDArray


SOURCE = "Øye 1991; Hansen, Gaunaa & Madsen 2004, Risø-R-1354; polar: Ramsay et al. 1995, NREL/TP-442-7817"
INDEPENDENT = "Øye's model with A = 4 on the measured polar, an independent computation"
LAG = 4.0
"""Time constant of the separation point in chords."""
N_ALPHA = 720
LOOPS = {
    (8.0, 10.0, 0.026): (1.12, 0.96, 0.78),
    (8.0, 10.0, 0.050): (1.24, 0.98, 0.73),
    (8.0, 10.0, 0.077): (1.35, 0.98, 0.70),
    (14.0, 10.0, 0.026): (1.14, 1.13, 0.92),
    (14.0, 10.0, 0.050): (1.27, 1.24, 0.87),
    (14.0, 10.0, 0.077): (1.38, 1.33, 0.83),
    (20.0, 10.0, 0.077): (1.20, 1.05, 0.67),
    (14.0, 5.5, 0.077): (1.19, 1.16, 0.89),
}
"""Mean and amplitude of the angle of attack [deg], k; largest cl, cl at the mean on rising and falling branch."""
JONES = np.array([[0.165, 0.335], [0.0455, 0.300]])
"""Wagner's function 1 - sum A exp(-b s), s in semi-chords (Jones 1938)."""


def s809_polar():
    """Measured two-dimensional polar, shape (720, 3) from -π on."""
    alpha = -np.pi + 2.0 * np.pi / N_ALPHA * np.arange(N_ALPHA)
    return np.column_stack(PhaseSixBlade("measured").polar_at(3.0).coefficients(alpha))


@dataclass(frozen=True)
class Pitching:
    """Angle of attack [rad] as a sine of time about a mean."""

    mean: float
    amplitude: float
    k: float

    @property
    def omega(self):
        """[rad per time in which the stream passes a chord]."""
        return 2.0 * self.k

    def angle(self, time):
        """[rad]."""
        return self.mean + self.amplitude * np.sin(self.omega * time)

    def rate(self, time):
        """[rad per time]."""
        return self.amplitude * self.omega * np.cos(self.omega * time)

    def steps(self, longest):
        """Time step not longer than ``longest``, and the number of steps in a period."""
        period = 2.0 * np.pi / self.omega
        n = 4 * int(np.ceil(period / longest / 4.0))
        return period / n, n


class StallingSection:
    """Tables of Øye's model for one polar (n_alpha, 3), between which it interpolates linearly.

    ``monotone`` as in `separation_tables`: the tables of the lattice, or those of the published model.
    """

    def __init__(self, polar, monotone=True):
        step = 2.0 * np.pi / len(polar)
        self._alpha = -np.pi + step * np.arange(len(polar))
        self._attached, self._separated, self._point, _ = separation_tables([polar], monotone)[0].T

    def static_point(self, alpha):
        """Separation point of the static polar [chords]."""
        return np.interp(alpha, self._alpha, self._point)

    def lift(self, alpha, point):
        """Lift coefficient with the flow separated ``point`` chords aft."""
        attached, separated = (np.interp(alpha, self._alpha, x) for x in (self._attached, self._separated))
        return point * attached + (1.0 - point) * separated

    def balance(self, base, share, point):
        """Angle of attack base + share F / 2π and lift coefficient F that belong to each other."""
        share /= 2.0 * np.pi
        lift = brentq(lambda f: self.lift(base + share * f, point) - f, -8.0, 8.0, xtol=1e-10)
        return base + share * lift, lift


def oye_loop(
    section: StallingSection, motion: Pitching, shed_wake=False, periods=3
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Lift coefficient over the last period (n + 1,), first and last point at the mean on the rising branch.

    Without a wake this is Øye's model on the angle of attack itself. With one, the flow at three quarters of the chord
    is that of the pitching plate, slowed by the wake that it sheds, and the lift has the plate's apparent mass:

        cl = F(αE, f) + π α̇ c/2V,   αE = α + α̇ c/2V - q + F/2π,   F/2π = q (1 - A1 - A2) + y1 + y2,
        ẏi = bi 2V/c (Ai q - yi).

    q is the angle that a plate without stall would need for this lift, so that the wake is that of the lift as it is;
    without stall F = 2π αE, and this is the state-space form of Hansen, Gaunaa & Madsen.
    """
    dt, n = motion.steps(0.02)
    amplitudes, rates = JONES[0], 2.0 * JONES[1]
    direct = 1.0 - amplitudes.sum()
    point, wake, lift = section.static_point(motion.angle(0.0)), np.zeros(2), []
    if shed_wake:
        wake = amplitudes * section.lift(motion.angle(0.0), point) / (2.0 * np.pi)
    for i in range(periods * n + 1):
        angle, rate = motion.angle(i * dt), motion.rate(i * dt)
        effective, circulatory = angle, section.lift(angle, point)
        if shed_wake:
            effective, circulatory = section.balance(
                angle + 0.5 * rate + wake.sum() / direct, 1.0 - 1.0 / direct, point
            )
            q = (circulatory / (2.0 * np.pi) - wake.sum()) / direct
            wake = amplitudes * q + (wake - amplitudes * q) * np.exp(-rates * dt)
        static = section.static_point(effective)
        point = static + (point - static) * np.exp(-dt / LAG)
        lift.append(circulatory + (0.5 * np.pi * rate if shed_wake else 0.0))
    return np.degrees(motion.angle(dt * np.arange(n + 1))), np.array(lift[-n - 1 :])


def lattice_loop(
    motion: Pitching, polar=None, n_chord=2, periods=2.25, **options
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Angle [deg] and lift coefficient of the vortex lattice over the last period, (n + 1,) each.

    Parameters
    ----------
    motion : Pitching
    polar : ndarray, shape (n_alpha, 3), optional
        Of the section; a flat plate's if not given.
    n_chord : int
        Panels along the chord; a step is one panel.
    **options
        `AeroOptions`.
    """
    dt, n = motion.steps(1.0 / n_chord)
    start, n_steps = round((periods % 1.0) * n), round(periods * n)
    planform = two_dimensional_planform(n_chord, polar)
    flow = WingFlow(planform, UniformStream.at_incidence(0.0), n_steps, dt, **({"viscous": True} | options))

    def motion_at(time):
        """Nodes and their velocities; the quarter chord lies at x = y = 0."""
        sine, cosine = np.sin(motion.angle(time)), np.cos(motion.angle(time))
        nodes, velocities = flow.nodes.copy(), flow.still.copy()
        x, y = flow.nodes[..., 0], flow.nodes[..., 1]
        nodes[..., 0], nodes[..., 1] = cosine * x - sine * y, sine * x + cosine * y
        velocities[..., 0], velocities[..., 1] = -motion.rate(time) * nodes[..., 1], motion.rate(time) * nodes[..., 0]
        return nodes, velocities

    flow.start_moving(*motion_at(-start * dt))
    times = dt * np.arange(1 - start, n_steps - start + 1)
    lift = np.array([flow.section_lift(flow.step(*motion_at(time))) for time in times])
    return np.degrees(motion.angle(times[-n - 1 :])), lift[-n - 1 :]


def landmarks(lift):
    """Largest lift of a loop, and the lift at the mean angle on the rising and on the falling branch."""
    return float(lift.max()), float(lift[0]), float(lift[len(lift) // 2])


def attached_response(k=0.1, n_chord=4):
    """Ratio of the lattice's lift to Theodorsen's, and C(k) from it: a flat plate pitching by one degree."""
    motion = Pitching(0.0, np.radians(1.0), k)
    lift = lattice_loop(motion, n_chord=n_chord, periods=3.0, dynamic_stall="oye")[1][:-1]
    phase = 2.0 * np.pi * np.arange(lift.size) / lift.size
    base = np.column_stack([np.sin(phase), np.cos(phase), np.ones_like(phase), phase])  # the line: rest of the start
    sine, cosine = np.linalg.lstsq(base, lift, rcond=None)[0][:2] / motion.amplitude
    obtained, rate = complex(sine, cosine), 2j * k
    apparent_mass = 0.5 * np.pi * (rate + 0.25 * rate**2)
    return obtained / exact_lift("pitch", k), (obtained - apparent_mass) / (2.0 * np.pi * (1.0 + 0.5 * rate))


@case("dynamic-stall", "Dynamic stall of the S809 airfoil in pitch", SOURCE)
def dynamic_stall() -> CaseResult:
    """Loops of the lift: the model alone, the lattice against the model with its own shed wake, attached flow."""
    polar = s809_polar()
    published, section = StallingSection(polar, monotone=False), StallingSection(polar)
    checks, figures, lines = [], {}, []
    for (mean, amplitude, k), expected in LOOPS.items():
        motion = Pitching(np.radians(mean), np.radians(amplitude), k)
        label = f"{mean:g} ± {amplitude:g}°, k = {k:g}"
        angle, alone = oye_loop(published, motion)
        names = ("largest cl", "cl at the mean, rising", "cl at the mean, falling")
        checks += [
            Check(f"{label}, model alone: {name}", value, obtained, absolute(0.03), source=INDEPENDENT)
            for name, value, obtained in zip(names, expected, landmarks(alone), strict=True)
        ]
        with_wake = oye_loop(section, motion, shed_wake=True)
        lattice = lattice_loop(motion, polar, dynamic_stall="oye")
        checks += [
            Check(f"{label}, lattice: {name}", value, obtained, absolute(0.05), source="ODE with Jones's wake")
            for name, value, obtained in zip(names, landmarks(with_wake[1]), landmarks(lattice[1]), strict=True)
        ]
        static = section.lift(np.radians(angle), section.static_point(np.radians(angle)))
        figures[f"lift, {label}"] = Figure((
            Curve(angle, static, "static polar", "k:"),
            Curve(angle, alone, "Øye's model alone", "--"),
            Curve(*with_wake, "with a shed wake (ODE)"),
            Curve(*lattice, "vortex lattice"),
        ), "angle of attack [deg]", "cl")  # fmt: skip
        quasi_static = landmarks(lattice_loop(motion, polar)[1])
        lines.append(
            f"{label}: largest cl {lattice[1].max():.3f} in the lattice, {quasi_static[0]:.3f} there without the model,"
            f" {landmarks(oye_loop(section, motion)[1])[0]:.3f} of the model alone with the lattice's tables"
        )
    ratio, deficiency = attached_response()
    source = "Theodorsen 1935"
    checks += [
        Check("attached, k = 0.1: |C|", 0.850, abs(deficiency), 0.005, source=source),
        Check("attached, k = 0.1: phase of C", -11.7, np.degrees(np.angle(deficiency)), absolute(0.2), "deg",
              source=source),
        Check("attached, k = 0.1: lift over Theodorsen's", 1.0, abs(ratio), 0.002, source=source),
    ]  # fmt: skip
    lines.append(
        "The lattice's tables do not let the fully separated lift fall between 18 and 20°, which takes 0.02 to 0.04 "
        "from the largest lift. It takes the angle of attack from the circulation, the equations at three quarters of "
        "the chord; both agree to first order in the frequency, and to 0.01 at 8 ± 10°. Loops of a polar compressed to "
        "small angles differ from the equations as much: it is not the large angle."
    )
    lines.append(
        "Measured loops of this airfoil (Ohio State) were reported with largest lift coefficients of 1.4 to 1.8 at "
        "± 10° and the highest frequency: a leading-edge vortex lifts too, which this model does not have."
    )
    return CaseResult(checks, figures, "\n".join(lines))
