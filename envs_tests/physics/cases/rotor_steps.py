"""Rotors whose wind or pitch changes: steps, gusts, oscillation and the passing of the tower."""

from dataclasses import replace
from typing import Any

import numpy as np
from scipy.special import ellipe, ellipkm1

from envs_tests.physics.cases.dynamic_inflow import (
    INERTIA,
    WHOLE_FIELD,
    DynamicRotor,
    Ramp,
    Response,
    five_megawatt_step,
    loewy,
    long_wake,
    respond,
)
from envs_tests.physics.cases.rotor import RigidRotor
from envs_tests.physics.validation import CaseResult, Check, Curve, Figure, absolute, case
from wt_gym.aerodynamics import (
    ENGINEERING,
    TRAINING,
    AeroOptions,
    build_planform,
    span_distribution,
    tower_perturbation,
)
from wt_gym.simulation import FIDELITIES, Simulator
from wt_gym.simulation.models import N_ALPHA
from wt_gym.turbines import Polar, load_turbine
from wt_gym.turbines.blade_element import BladeElementRotor
from wt_gym.wind import SteadyInflow
from wt_gym.wind.iec import turbulence_sigma
from wt_gym.wind.kaimal import kaimal_spectrum

# ---- a step of the wind ---------------------------------------------------------------------------------------------
# The rotor turns with its inertia against a torque that grows with the square of its speed, as below rated power. While
# it speeds up, the wake keeps the induction of before, and takes half a minute to follow.

STEP_SOURCE = "unthinned wake of 16 turns with an open end; blade elements with Øye's filter, own calculation"
WIND = Ramp(8.0, 9.0)
ROTOR_SPEED = 0.95
"""At the start [rad/s]."""
DURATION = 100.0
"""After the step [s]."""


def five_megawatt_elements(n_span: int = 30) -> DynamicRotor:
    """The rotor of the NREL 5-MW turbine as blade elements."""
    return DynamicRotor(BladeElementRotor.of_turbine(load_turbine("nrel_5mw")), n_span)


def element_step():
    """The same step in blade-element theory with Øye's filter."""

    def acceleration(torque, speed, settled):
        return (torque - settled * (speed / ROTOR_SPEED) ** 2) / INERTIA

    return five_megawatt_elements().respond(
        WIND, lambda time: 0.0 * time, ROTOR_SPEED, DURATION, acceleration=acceleration
    )


@case("wind-step", "Rigid 5-MW rotor, wind step 8 → 9 m/s: overshoot of thrust and rotor speed", STEP_SOURCE, slow=True)
def wind_step() -> CaseResult:
    """Overshoot of the fidelities within 0.03 of the change of that of a long unthinned wake."""
    settings: dict[str, Any] = {"coupled": True, "rotor_speed": ROTOR_SPEED, "duration": DURATION, "settling": 100.0}
    runs = {
        "16 turns, open": five_megawatt_step(long_wake(16.0, 24, n_span=10), WIND, **settings),
        "blade elements with Øye's filter": element_step(),
        "training": five_megawatt_step(TRAINING, WIND, **settings),
        "engineering": five_megawatt_step(ENGINEERING, WIND, **settings),
    }
    checks, lines = [], []
    signals = {"thrust": "thrust", "rotor speed": "rotor_speed"}
    wanted = {name: runs["16 turns, open"].overshoot(signal).ratio for name, signal in signals.items()}
    for run_name, run in runs.items():
        found = {name: run.overshoot(signal) for name, signal in signals.items()}
        if run_name != "16 turns, open":
            checks += [
                Check(f"{run_name}: change of the {name} to the extreme by the lasting one", wanted[name],
                      found[name].ratio, absolute(0.03), source=STEP_SOURCE)
                for name in signals
            ]  # fmt: skip
        lines.append(f"{run_name}: " + ", ".join(f"{name} {found[name].ratio:.3f}" for name in signals))
    figures = {
        f"{name} after a wind step": Figure(tuple(
            Curve(run.time[run.time > -5.0], getattr(run, signal)[run.time > -5.0], label)
            for label, run in runs.items()
        ), "time [s]", f"{name} [{unit}]")
        for (name, signal), unit in zip(signals.items(), ("N", "rad/s"), strict=True)
    }  # fmt: skip
    return CaseResult(checks, figures, "\n".join(lines))


# ---- a step of the pitch --------------------------------------------------------------------------------------------
# Three blades of 30.56 m, chord and twist linear along the span, NACA 4412 to 4424 (Øye 1991; Snel & Schepers 1995,
# ECN-C--94-107). All sections have one polar, linear up to the angles that occur: c_l = 0.105 (α/deg + 4), c_d = 0.01.

TJAEREBORG = "Øye 1991; Snel & Schepers 1995, ECN-C--94-107 (Tjæreborg, test II.4)"

ROOT, TIP = 6.46, 30.56
"""First aerodynamic section and tip [m]."""
TJAEREBORG_SPEED = 22.36 * np.pi / 30.0
TJAEREBORG_WIND = 8.7
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


def tjaereborg_rotor(options: AeroOptions) -> RigidRotor:
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


def pitch_steps(options: AeroOptions, settling: float = 50.0, duration: float = 60.0) -> Response:
    """Run test II.4 on the lattice; the way back begins at 30 s."""
    return respond(
        tjaereborg_rotor(options),
        options,
        TJAEREBORG_WIND,
        PITCH_TEST,
        TJAEREBORG_SPEED,
        duration,
        settling,
        flap_radius=FLAP_RADIUS,
    )


def _published_bounds(name: str, run: Response):
    """Published bounds of one run."""
    checks = []
    for step, (start, end) in STEPS.items():
        torque, thrust = run.overshoot("torque", start, end), run.overshoot("thrust", start, end)
        label = f"{name}, pitch {step}"
        checks += [
            Check(f"{label}: change of torque to the extreme by the lasting one", "in [3, 7]", torque.ratio,
                  source=TJAEREBORG),
            Check(f"{label}: change of thrust to the extreme by the lasting one", "in [1.5, 1.9]", thrust.ratio,
                  source=TJAEREBORG),
            Check(f"{label}: time until a tenth of the torque's overshoot is left", "in [6, 14]", torque.recovery,
                  unit="s", source=TJAEREBORG),
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


@case("tjaereborg", "Tjæreborg 2-MW rotor: overshoot after steps of the pitch", TJAEREBORG, slow=True)
def tjaereborg() -> CaseResult:
    """Published bounds with both thinned wakes and with twelve turns of unthinned one."""
    runs = {
        "training": pitch_steps(TRAINING),
        "engineering": pitch_steps(ENGINEERING),
        "12 turns, open": pitch_steps(long_wake(12.0, 24)),
    }
    checks = [check for name, run in runs.items() for check in _published_bounds(name, run)]
    blades = BladeElementRotor(3, ROOT, TIP - ROOT, TIP, 0.0, AIR_DENSITY, chord, twist, polar)
    element = DynamicRotor(blades).respond(
        lambda time: TJAEREBORG_WIND + 0.0 * time, PITCH_TEST, TJAEREBORG_SPEED, 60.0
    )
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


# ---- oscillating wind -----------------------------------------------------------------------------------------------
# A small sum of sines on the mean wind shows all frequencies in one run of the lattice. Beside it stands an independent
# theory of the same polars: blade elements whose sections lag with Loewy's function and whose induced velocity lags
# with Øye's filter (`dynamic_inflow`). Both fall below what quasi-steady sections would do, by the same share.

LOEWY_SOURCE = "Loewy 1957, Theodorsen 1935 and Øye 1991 on blade-element theory with the same polars, own calculation"
FREQUENCIES = 0.04 * np.array([1, 3, 5, 7, 9, 11, 15, 19, 22])
"""Multiples of one frequency [Hz]: all periods end after 25 s."""
PHASES = np.array([0.0, 2.1, 4.0, 1.0, 5.1, 3.3, 0.6, 2.8, 4.6])
AMPLITUDE = 0.05
"""Of each sine [m/s]."""
BAND = (0.25, 0.9)
"""Frequencies [Hz] between which the fluctuations are summed up."""
STATES = {8.0: (0.96, 0.0), 12.0: (1.267, np.radians(3.8)), 18.0: (1.267, np.radians(14.9))}
"""Wind speed [m/s]: rotor speed [rad/s] and pitch [rad] of the NREL 5-MW turbine."""
GUST_OPTIONS = AeroOptions(
    n_chord=2, n_span=14, azimuth_step_deg=4.0, wake_rows=270, full_rows=270, fresh_rows=60, refresh_stride=6,
    far_wake_rows=135, squire=1e-3,
)  # fmt: skip
"""Three turns of unthinned wake, 17 steps in the shortest period."""


def gust_theory(wind: float, frequencies=FREQUENCIES):
    """Responses of the blade-element theory at the mean state of a wind speed, a list of `GustResponse`."""
    rotor = five_megawatt_elements(40)
    return [rotor.gust_response(f, wind, *STATES[wind]) for f in frequencies]


def gust_response(options: AeroOptions, wind: float, settling: float = 40.0, duration: float = 50.0,
             frequencies=FREQUENCIES) -> np.ndarray:  # fmt: skip
    """Complex thrust of the lattice by the amplitude of the wind [N s/m] at each frequency.

    ``wind``: one of `STATES` [m/s]; ``settling``, ``duration``: time before the fit and of the fit [s]; the wind
    oscillates in both; ``frequencies`` (n,) [Hz].
    """
    speed, pitch = STATES[wind]
    phases = PHASES[: len(frequencies)]

    def oscillating(time):
        angle = 2.0 * np.pi * np.multiply.outer(np.asarray(time), frequencies) + phases
        return wind + AMPLITUDE * np.sin(angle).sum(axis=-1)

    rotor = RigidRotor.of_turbine(load_turbine("nrel_5mw"), options)
    run = respond(rotor, options, oscillating, pitch, speed, duration, settling)
    fitted = run.time > 0.0
    time = run.time[fitted]
    angle = 2.0 * np.pi * np.multiply.outer(time, frequencies) + phases
    base = np.column_stack([np.ones_like(time), time, np.sin(angle), np.cos(angle)])
    sine, cosine = np.linalg.lstsq(base, run.thrust[fitted], rcond=None)[0][2:].reshape(2, -1)
    return (sine + 1j * cosine) / AMPLITUDE


def share_of_fluctuations(wind: float, response, quasi_steady) -> float:
    """Standard deviation of the thrust in `BAND` by the quasi-steady one, in uniform wind with Kaimal's spectrum."""
    low, high = BAND
    f = FREQUENCIES
    inside = (f >= low) & (f <= high)
    f = f[inside]
    weight = kaimal_spectrum(f, wind, 90.0, turbulence_sigma(wind, "B"))[:, 0] * np.gradient(f)
    return float(np.sqrt(weight @ np.abs(response[inside]) ** 2 / (weight @ np.abs(quasi_steady[inside]) ** 2)))


def _lags(wind, obtained, expected):
    """Amplitude and phase at every frequency."""
    checks = []
    for f, value, reference in zip(FREQUENCIES, obtained, expected, strict=True):
        name = f"{wind:g} m/s, {f:.2f} Hz"
        checks += [
            Check(f"{name}: thrust by wind", abs(reference) / 1e3, abs(value) / 1e3, 0.08, "kN s/m",
                  source=LOEWY_SOURCE),
            Check(f"{name}: phase", np.degrees(np.angle(reference)), np.degrees(np.angle(value)), absolute(6.0), "deg",
                  source=LOEWY_SOURCE),
        ]  # fmt: skip
    return checks


@case("rotor-gust", "Rigid 5-MW rotor in uniform wind that oscillates: the lag of the thrust", LOEWY_SOURCE, slow=True)
def rotor_gust() -> CaseResult:
    """Amplitude within 8 % and phase within 6° at 8, 12 and 18 m/s, 0.04 to 0.88 Hz; the share in 0.25–0.9 Hz."""
    checks, figures, lines = [], {}, []
    f = np.linspace(0.02, 1.0, 99)
    for wind in STATES:
        responses = gust_theory(wind)
        expected = np.array([r.full for r in responses])
        frozen = np.array([r.frozen for r in responses])
        obtained = gust_response(GUST_OPTIONS, wind)
        checks += _lags(wind, obtained, expected)
        shares = [share_of_fluctuations(wind, x, frozen) for x in (expected, obtained)]
        name = f"{wind:g} m/s, {BAND[0]:g}–{BAND[1]:g} Hz: fluctuations over quasi-steady ones"
        checks.append(Check(name, shares[0], shares[1], 0.06, source=LOEWY_SOURCE))
        for label, preset, tolerance in (("training", TRAINING, 0.1), ("engineering", ENGINEERING, 0.08)):
            shares.append(share_of_fluctuations(wind, gust_response(preset, wind), frozen))
            checks.append(Check(f"{name}, {label}", shares[0], shares[-1], tolerance, source=LOEWY_SOURCE))
        lines.append(
            f"{wind:g} m/s: theory {shares[0]:.3f}, lattice {shares[1]:.3f}, training {shares[2]:.3f}, engineering"
            f" {shares[3]:.3f}; equilibrium of the induction would give {responses[0].equilibrium / frozen[0]:.3f}"
        )
        curves = gust_theory(wind, f)
        figures[f"thrust over quasi-steady thrust, {wind:g} m/s"] = Figure((
            Curve(f, [abs(r.full) / r.frozen for r in curves], "Loewy and Øye"),
            Curve(f, [abs(r.single) / r.frozen for r in curves], "Theodorsen and Øye", "--"),
            Curve(f, [abs(r.wake) / r.frozen for r in curves], "Øye alone", ":"),
            Curve(FREQUENCIES, np.abs(obtained) / frozen, "lattice", "o"),
        ), "frequency [Hz]", "amplitude")  # fmt: skip
        figures[f"phase of the thrust, {wind:g} m/s"] = Figure((
            Curve(f, [np.degrees(np.angle(r.full)) for r in curves], "Loewy and Øye"),
            Curve(FREQUENCIES, np.degrees(np.angle(obtained)), "lattice", "o"),
        ), "frequency [Hz]", "phase [deg]")  # fmt: skip
    notes = (
        "Quasi-steady: the polars on the gust at once, with the induced velocity of the mean wind. Fluctuations of "
        "thrust in 0.25–0.9 Hz over those: " + "; ".join(lines) + ". The dip is the frequency at which the blades pass "
        "(0.46 and 0.60 Hz): there the layers of shed vortices under the blades add up (Loewy). Strip theory has no "
        "trailing vortices that answer at once; they take the few per cent by which the lattice lies lower."
    )
    return CaseResult(checks, figures, notes)


# ---- a step that is carried along -----------------------------------------------------------------------------------
# Behind the front of a faster wind, carried downstream, the rows of the wake move faster than those ahead of it and
# drive them together: the thrust gains less than in a wind that changes everywhere at once (measured on a rotor of 1.8
# m: Berger et al., Wind Energ. Sci. 7 (2022) 1827). The lattice is compared with rings of a cylinder of the rotor's
# radius that are shed at the rate of the thrust, F = T / (ρ A), and carried with the wind and what they induce on each
# other,
#
#     ∂g/∂t + ∂(c g)/∂z = 0,   c g = F at z = 0,   c = V + v(z, t) + u(z),
#
# g the circulation per length, v the change of the wind, u the velocity at the cylinder's own radius (complete elliptic
# integral, Branlard & Gaunaa, Wind Energ. 18 (2015)). The disc feels the mean over its area of what the rings induce
# (the mutual inductance of two rings, Maxwell); the thrust follows wind and induced velocity as in blade elements.

RING_SOURCE = "transport of the rings of a vortex cylinder, own calculation"
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

    ``rotor``: gives the thrust before the step and its slopes with wind and induced velocity there; ``speed`` [rad/s];
    ``carried``: speed with which the change is carried downstream [m/s]; ``duration``, ``dt`` [s]. Returns ``time``,
    ``thrust`` (n,).
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


@case("carried-gust", "Rigid 5-MW rotor at constant speed, wind step 8 → 9 m/s at once and carried along", RING_SOURCE,
      slow=True, quick={"names": ("training",)})  # fmt: skip
def carried_gust(names=("training", "engineering", "8 turns, open")) -> CaseResult:
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
    for name in names:
        whole, part = carried_part(runs[name])
        for (low, high), wanted, got in zip(WINDOWS, at_once, whole, strict=True):
            checks.append(Check(f"{name}, {low:g}–{high:g} s: thrust, wind everywhere at once", wanted, got,
                                absolute(0.04), source=ELEMENTS))  # fmt: skip
        for (low, high), wanted, got in zip(WINDOWS, added, part, strict=True):
            checks.append(Check(f"{name}, {low:g}–{high:g} s: what carrying the wind adds", wanted, got, absolute(0.03),
                                source=RING_SOURCE))  # fmt: skip
        curves.append(Curve(middles, part, name, "o"))
        lines.append(f"{name}: at once {np.round(whole, 3)}, carrying adds {np.round(part, 3)}")
    lines.append(f"theory: at once {np.round(at_once, 3)}, carrying adds {np.round(added, 3)}")
    curves.append(Curve(middles, added, "transport of rings"))
    figure = Figure(tuple(curves), "time [s]", "thrust by its lasting change, carried minus at once")
    return CaseResult(checks, {"carried step": figure}, "\n".join(lines))


# ---- the tower before the blades ------------------------------------------------------------------------------------
# The cylinder of the tower disturbs a wind that the rotor has slowed by its induced velocity. Each section of a blade
# meets that disturbance once a turn; its harmonics add up where they are multiples of the number of blades. Sections
# answer with Loewy's function, since all blades do the same a passing time apart (`dynamic_inflow`), and the induced
# velocity has no time to follow.

SHADOW_WIND = 8.0
SHADOW_SPEED = 0.963
"""In balance with the baseline's torque at this wind [rad/s]."""
TORQUE_GAIN = 2.332287
"""Of the baseline below rated power [N m s²/rad²], generator side (NREL/TP-500-38060, table 7-1)."""
HARMONICS = (3, 6)
SHADOW_SOURCE = "doublet in the slowed wind, blade elements with Loewy's function, own calculation"


def strip_theory(slowed: bool = True, lag: bool = True):
    """Amplitudes of the thrust's harmonics [N], complex with the azimuth's sign, shape (2,).

    ``slowed`` False: the undisturbed wind meets the tower; ``lag`` False: sections answer at once.
    """
    rotor, turbine = five_megawatt_elements(), load_turbine("nrel_5mw")
    induced, tower = rotor.equilibrium(SHADOW_WIND, SHADOW_SPEED, 0.0), turbine.tower
    axial, turning = SHADOW_WIND * rotor.cos_cone - induced[0], SHADOW_SPEED * rotor.radius + induced[1]
    small = 0.01
    ahead, behind = (rotor.forces(axial + sign * small, turning, 0.0)[0] for sign in (1.0, -1.0))
    slope = (ahead - behind) / (2.0 * small) * rotor.rotor.n_blades * rotor.width * rotor.cos_cone
    felt = SHADOW_WIND - (rotor.mean_induction(induced, SHADOW_WIND) * SHADOW_WIND if slowed else 0.0)
    psi = np.radians(np.arange(0.0, 360.0, 0.5))
    cone, tilt = turbine.hub.cone, turbine.nacelle.tilt
    along = rotor.radius / rotor.cos_cone
    upwind, out = -along * np.sin(cone), along * np.cos(cone)
    ahead_of_shaft = turbine.nacelle.overhang
    rise, across = out * np.cos(psi)[:, None], -out * np.sin(psi)[:, None]
    x = (upwind - ahead_of_shaft) * np.cos(tilt) + rise * np.sin(tilt)
    z = turbine.hub_height - (upwind * np.sin(tilt)) + rise * np.cos(tilt)
    points = np.stack([x, np.broadcast_to(across, x.shape), z], axis=-1)
    wind = np.zeros_like(points)
    wind[..., 0] = felt
    base = np.array([0.0, 0.0, tower.base_height])
    top = np.array([0.0, 0.0, tower.base_height + tower.length])
    dip = tower_perturbation(points, wind, base, top, tower.diameter_station, tower.diameter)[..., 0]
    passing = 2.0 * np.pi / (rotor.rotor.n_blades * SHADOW_SPEED)
    found = []
    for n in HARMONICS:
        omega = n * SHADOW_SPEED
        k = 0.5 * omega * rotor.chord / np.hypot(axial, turning)
        answer = loewy(k, axial * passing / (0.5 * rotor.chord), omega * passing) + 0.5j * k if lag else 1.0 + 0.0 * k
        gust = 2.0 * np.mean(dip * np.exp(-1j * n * psi)[:, None], axis=0)
        found.append(np.conj((slope * gust) @ answer))
    return np.array(found)


def measured_harmonics(fidelity, duration: float = 100.0, turns: int = 6):
    """Harmonics of the thrust that the tower makes [N], complex, shape (2,): with it less without it."""
    found = []
    for shadow in (True, False):
        body = fidelity.tower_body if shadow else None
        simulator = Simulator(
            "nrel_5mw",
            inflow=SteadyInflow(SHADOW_WIND),
            fidelity=replace(fidelity, tower_shadow=shadow, tower_body=body),
        )
        torque = TORQUE_GAIN * (97.0 * SHADOW_SPEED) ** 2
        signals = simulator.reset(rotor_speed=SHADOW_SPEED, pitch=0.0, generator_torque=torque)
        rows = []
        while signals.time < duration:
            torque = TORQUE_GAIN * signals.generator_speed**2
            signals = simulator.advance(0.1, pitch=(0.0, 0.0, 0.0), generator_torque=torque)
            rows.append((signals.azimuth, signals.aero_thrust))
        azimuth, thrust = np.array(rows).T
        azimuth = np.unwrap(azimuth)
        last = azimuth > azimuth[-1] - 2.0 * np.pi * turns
        fluctuation = thrust[last] - thrust[last].mean()
        found.append([2.0 * np.mean(fluctuation * np.exp(1j * n * azimuth[last])) for n in HARMONICS])
    return np.subtract(*np.array(found))


@case("tower-shadow", "5-MW turbine at 8 m/s: thrust at multiples of the blades' passing of the tower", SHADOW_SOURCE,
      slow=True)  # fmt: skip
def tower_shadow() -> CaseResult:
    """Third and sixth harmonic of the thrust within 0.25 of strip theory; half the time step changes 0.05 of it."""
    theory, lines, checks = strip_theory(), [], []
    rigid: dict[str, Any] = {"tower_coordinates": "rigid", "blade_coordinates": "rigid"}
    training = replace(FIDELITIES["training"], name="rigid", **rigid)
    engineering = replace(FIDELITIES["engineering"], name="rigid", **rigid)
    cheap = {}
    for name, fidelity in (("training", training), ("engineering", engineering)):
        cheap[name] = measured_harmonics(fidelity)
        for n, wanted, got in zip(HARMONICS, theory, cheap[name], strict=True):
            checks.append(Check(f"{name}: amplitude of harmonic {n}", abs(wanted) / 1e3, abs(got) / 1e3, 0.25, "kN",
                                source=SHADOW_SOURCE))  # fmt: skip
    half = measured_harmonics(replace(training, time_step=0.05))
    for n, wanted, got in zip(HARMONICS, cheap["training"], half, strict=True):
        checks.append(Check(f"training, half the time step: amplitude of harmonic {n}", abs(wanted) / 1e3,
                            abs(got) / 1e3, 0.05, "kN", source="with the whole time step"))  # fmt: skip
    body = measured_harmonics(replace(training, tower_body=(16, 24)))
    for name, values in (("theory", theory), ("theory, undisturbed wind", strip_theory(slowed=False)),
                         ("theory, sections that answer at once", strip_theory(lag=False)),
                         *cheap.items(), ("training with the tower as a closed body", body)):  # fmt: skip
        told = ", ".join(
            f"{n}P {abs(v) / 1e3:.2f} kN {np.degrees(np.angle(v)):.0f}°" for n, v in zip(HARMONICS, values, strict=True)
        )
        lines.append(f"{name}: {told}")
    return CaseResult(checks, {}, "\n".join(lines))
