"""A rotor in wind that oscillates everywhere at once: the lag of its thrust against blade-element theory with memory.

A small sum of sines on the mean wind shows all frequencies in one run of the lattice. Beside it stands an independent
theory of the same polars: blade elements whose sections lag with Loewy's function and whose induced velocity lags with
Øye's filter (`dynamic_inflow`). Both fall below what quasi-steady sections would do, by the same share.
"""

from __future__ import annotations

import numpy as np

from validation.case import CaseResult, Check, Curve, Figure, absolute, case
from validation.dynamic_inflow import DynamicRotor
from validation.rigid_rotor import RigidRotor
from validation.rotor_transients import respond
from wt_gym.aerodynamics import ENGINEERING, TRAINING, AeroOptions
from wt_gym.turbines import load_turbine
from wt_gym.turbines.blade_element import BladeElementRotor
from wt_gym.wind.iec import turbulence_sigma
from wt_gym.wind.kaimal import kaimal_spectrum

SOURCE = "Loewy 1957, Theodorsen 1935 and Øye 1991 on blade-element theory with the same polars, own calculation"
FREQUENCIES = 0.04 * np.array([1, 3, 5, 7, 9, 11, 15, 19, 22])
"""Multiples of one frequency [Hz]: all periods end after 25 s."""
PHASES = np.array([0.0, 2.1, 4.0, 1.0, 5.1, 3.3, 0.6, 2.8, 4.6])
AMPLITUDE = 0.05
"""Of each sine [m/s]."""
BAND = (0.25, 0.9)
"""Frequencies [Hz] between which the fluctuations are summed up."""
STATES = {8.0: (0.96, 0.0), 12.0: (1.267, np.radians(3.8)), 18.0: (1.267, np.radians(14.9))}
"""Wind speed [m/s]: rotor speed [rad/s] and pitch [rad] of the NREL 5-MW turbine."""
OPTIONS = AeroOptions(
    n_chord=2, n_span=14, azimuth_step_deg=4.0, wake_rows=270, full_rows=270, fresh_rows=60, refresh_stride=6,
    far_wake_rows=135, squire=1e-3,
)  # fmt: skip
"""Three turns of unthinned wake, 17 steps in the shortest period."""


def theory(wind: float, frequencies=FREQUENCIES):
    """Responses of the blade-element theory at the mean state of a wind speed, a list of `GustResponse`."""
    rotor = DynamicRotor(BladeElementRotor.of_turbine(load_turbine("nrel_5mw")))
    return [rotor.gust_response(f, wind, *STATES[wind]) for f in frequencies]


def measured(options: AeroOptions, wind: float, settling: float = 40.0, duration: float = 50.0,
             frequencies=FREQUENCIES) -> np.ndarray:  # fmt: skip
    """Complex thrust of the lattice by the amplitude of the wind [N s/m] at each frequency.

    Parameters
    ----------
    options : AeroOptions
    wind : float
        One of `STATES` [m/s].
    settling, duration : float
        Time before the fit and of the fit [s]; the wind oscillates in both.
    frequencies : ndarray, shape (n,)
        [Hz].
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


def _checks(wind, obtained, expected):
    """Amplitude and phase at every frequency."""
    checks = []
    for f, value, reference in zip(FREQUENCIES, obtained, expected, strict=True):
        name = f"{wind:g} m/s, {f:.2f} Hz"
        checks += [
            Check(f"{name}: thrust by wind", abs(reference) / 1e3, abs(value) / 1e3, 0.08, "kN s/m", source=SOURCE),
            Check(f"{name}: phase", np.degrees(np.angle(reference)), np.degrees(np.angle(value)), absolute(6.0), "deg",
                  source=SOURCE),
        ]  # fmt: skip
    return checks


@case("rotor-gust", "Rigid 5-MW rotor in uniform wind that oscillates: the lag of the thrust", SOURCE, slow=True)
def rotor_gust() -> CaseResult:
    """Amplitude within 8 % and phase within 6° at 8, 12 and 18 m/s, 0.04 to 0.88 Hz; the share in 0.25–0.9 Hz."""
    checks, figures, lines = [], {}, []
    f = np.linspace(0.02, 1.0, 99)
    for wind in STATES:
        responses = theory(wind)
        expected = np.array([r.full for r in responses])
        frozen = np.array([r.frozen for r in responses])
        obtained = measured(OPTIONS, wind)
        checks += _checks(wind, obtained, expected)
        shares = [share_of_fluctuations(wind, x, frozen) for x in (expected, obtained)]
        name = f"{wind:g} m/s, {BAND[0]:g}–{BAND[1]:g} Hz: fluctuations over quasi-steady ones"
        checks.append(Check(name, shares[0], shares[1], 0.06, source=SOURCE))
        for label, preset, tolerance in (("training", TRAINING, 0.1), ("engineering", ENGINEERING, 0.08)):
            shares.append(share_of_fluctuations(wind, measured(preset, wind), frozen))
            checks.append(Check(f"{name}, {label}", shares[0], shares[-1], tolerance, source=SOURCE))
        lines.append(
            f"{wind:g} m/s: theory {shares[0]:.3f}, lattice {shares[1]:.3f}, training {shares[2]:.3f}, engineering"
            f" {shares[3]:.3f}; equilibrium of the induction would give {responses[0].equilibrium / frozen[0]:.3f}"
        )
        curves = theory(wind, f)
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
