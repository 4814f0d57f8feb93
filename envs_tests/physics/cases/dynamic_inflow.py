"""Memory of the wake: steps of wind and pitch on a rigid rotor, and blade elements with memory."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import RegularGridInterpolator
from scipy.optimize import least_squares
from scipy.special import hankel2, jv

from envs_tests.physics.cases.airfoils import theodorsen
from envs_tests.physics.cases.rotor import RigidRotor
from envs_tests.physics.cases.tools import blade_element
from wt_gym.aerodynamics import AeroOptions
from wt_gym.simulation.models import N_ALPHA
from wt_gym.turbines import load_turbine
from wt_gym.turbines.blade_element import BladeElementRotor

if TYPE_CHECKING:
    from envs_tests.physics.cases.rotor import RotorStep


# ---- steps on the lattice -------------------------------------------------------------------------------------------
# A wake takes several rotor radii of travel to follow a change of the rotor's thrust. Until then the rotor works in the
# induction of before: its loads overshoot, and come back with two time constants.

INERTIA = 38_759_228.0 + 97.0**2 * 534.116
"""Of rotor and generator of the NREL 5-MW turbine about the slow shaft [kg m^2] (NREL/TP-500-38060)."""
FITTED_TIMES = (0.2, 60.0)
"""Range of the time constants that are looked for [s]."""
WHOLE_FIELD = np.inf
"""Speed with which a change of the wind is carried downstream: it is felt everywhere at once."""


@dataclass(frozen=True)
class Ramp:
    """A quantity that goes from one value to another, linearly, and back again if told so.

    ``start``, ``duration`` of the ramp [s]; ``back``: time at which the way back begins [s]; never by default.
    """

    before: float
    after: float
    start: float = 0.0
    duration: float = 0.0
    back: float = np.inf

    def __call__(self, time: Any) -> Any:
        """Value at a time [s] or times."""
        return self.before + (self.after - self.before) * (self._share(time, self.start) - self._share(time, self.back))

    def _share(self, time: Any, start: float) -> Any:
        return np.clip((np.asarray(time) - start) / max(self.duration, 1e-9), 0.0, 1.0)


@dataclass(frozen=True)
class VaryingWind:
    """Uniform wind along x that varies in time.

    ``speed``: speed [m/s] at a time [s]; ``carried``: speed with which changes are carried downstream from x = 0 [m/s];
    infinite: everywhere at once.
    """

    speed: Callable[..., Any]
    carried: float = WHOLE_FIELD

    def velocity(self, points: ArrayLike, time: ArrayLike) -> np.ndarray:
        """Wind (..., 3) [m/s] at points (..., 3)."""
        velocity = np.zeros(np.shape(points))
        velocity[..., 0] = self.speed(np.asarray(time) - np.asarray(points)[..., 0] / self.carried)
        return velocity


@dataclass(frozen=True)
class Overshoot:
    """What a quantity did after a step.

    ``before``, ``extreme``, ``settled``: steady before the step, the value furthest beyond the settled one, and the end
    of the run; ``recovery``: time from the extreme until the quantity stays within a tenth of the overshoot [s];
    ``mean_time``: area of the overshoot from the extreme on, by its height [s]: the time constant of one exponential.
    """

    before: float
    extreme: float
    settled: float
    recovery: float
    mean_time: float

    @property
    def ratio(self) -> float:
        """Change to the extreme by the change that remains: 1 without overshoot."""
        return (self.extreme - self.before) / (self.settled - self.before)


@dataclass(frozen=True)
class TwoExponentials:
    """y = settled + fast exp(-t / fast_time) + slow exp(-t / slow_time), fitted from the extreme on.

    ``fast_time``, ``slow_time`` [s]; ``residual``: root mean square of the misfit by the size of the transient.
    """

    settled: float
    fast: float
    slow: float
    fast_time: float
    slow_time: float
    residual: float


@dataclass(frozen=True)
class Response:
    """Signals of a run; time 0 is the step, times before it belong to the settled start.

    ``time`` (n,) [s]; ``wind``, ``pitch``, ``rotor_speed`` (n,) [m/s], [rad], [rad/s]; ``thrust``, ``torque`` (n,) of
    the air on the rotor [N], [N m]; ``flap`` (n,): mean moment of the blades out of the plane at the root, or at
    ``flap_radius`` [N m]; ``radius`` (n_edge,): distance of the span edges of the blades from the axis [m]; empty
    without a lattice; ``axial`` (n, n_edge): axial force on the nodes at the span edges, of all blades [N].
    """

    time: np.ndarray
    wind: np.ndarray
    pitch: np.ndarray
    rotor_speed: np.ndarray
    thrust: np.ndarray
    torque: np.ndarray
    flap: np.ndarray
    radius: np.ndarray = field(default_factory=lambda: np.empty(0))
    axial: np.ndarray = field(default_factory=lambda: np.empty((0, 0)))

    def axial_at(self, radius: float) -> np.ndarray:
        """Axial force at the span edge nearest to a radius [N], shape (n,)."""
        return self.axial[:, int(np.argmin(np.abs(self.radius - radius)))]

    def overshoot(
        self, name: str | np.ndarray, start: float = 0.0, end: float = np.inf, settling: float = 5.0
    ) -> Overshoot:
        """Measure the answer of a signal to a step at ``start`` [s], settled in the last ``settling`` s to ``end``.

        ``name`` is that of a signal, or the signal itself, shape (n,).
        """
        y, end = self._signal(name), min(end, self.time[-1])
        before = y[(self.time > start - settling) & (self.time <= start)].mean()
        settled = y[(self.time > end - settling) & (self.time <= end)].mean()
        inside = np.flatnonzero((self.time > start) & (self.time <= end))
        away = (y[inside] - settled) * np.sign(settled - before)
        top = int(np.argmax(away))
        outside = np.flatnonzero(np.abs(away) > 0.1 * abs(away[top]))
        recovery = self.time[inside[outside[-1]]] - self.time[inside[top]] if outside.size else 0.0
        mean_time = np.trapezoid(away[top:], self.time[inside[top:]]) / away[top]
        return Overshoot(float(before), float(y[inside[top]]), float(settled), float(recovery), float(mean_time))

    def _signal(self, name: str | np.ndarray) -> np.ndarray:
        return getattr(self, name) if isinstance(name, str) else name

    def fit(self, name: str | np.ndarray, start: float = 0.0, end: float = np.inf) -> TwoExponentials:
        """Fit two exponentials to a signal between ``start`` and ``end`` [s], from its extreme on."""
        found = self.overshoot(name, start, end)
        inside = (self.time > start) & (self.time <= end)
        time, y = self.time[inside], self._signal(name)[inside]
        top = int(np.argmin(np.abs(y - found.extreme)))
        time, y = time[top:] - time[top], y[top:]

        def linear(times):
            base = np.column_stack([np.ones_like(time), *(np.exp(-time / t) for t in times)])
            factors = np.linalg.lstsq(base, y, rcond=None)[0]
            return factors, base @ factors - y

        best = min(
            (
                least_squares(lambda x: linear(np.exp(x))[1], np.log(guess), bounds=np.log(FITTED_TIMES))
                for guess in ((1.0, 6.0), (3.0, 15.0))
            ),
            key=lambda fit: fit.cost,
        )
        times = np.exp(best.x)
        factors, misfit = linear(times)
        fast, slow = np.argsort(times)
        return TwoExponentials(
            float(factors[0]), float(factors[1 + fast]), float(factors[1 + slow]), float(times[fast]),
            float(times[slow]), float(np.sqrt(np.mean(misfit**2)) / max(np.abs(y - factors[0]).max(), 1e-30)),
        )  # fmt: skip


def respond(  # noqa: PLR0913
    rotor: RigidRotor,
    options: AeroOptions,
    wind: Callable[..., Any] | float = 8.0,
    pitch: Callable[..., Any] | float = 0.0,
    rotor_speed: float = 1.0,
    duration: float = 60.0,
    settling: float = 60.0,
    acceleration: Callable[..., Any] | None = None,
    carried: float = WHOLE_FIELD,
    flap_radius: float = 0.0,
    dt: float | None = None,
) -> Response:
    """Let a rotor settle, then answer to what wind and pitch do from time 0 on.

    ``options``: the time step turns the rotor by ``azimuth_step_deg`` at ``rotor_speed``; ``wind``, ``pitch``: wind
    speed [m/s] and pitch [rad] at a time [s], for example a `Ramp`; constant before time 0; ``rotor_speed`` at the
    start [rad/s]; ``duration``, ``settling``: time after and before the step [s]; ``acceleration`` as for
    `RigidRotor.march`, but from time 0 on: ``acceleration(torque, rotor_speed, settled_torque)`` with the mean torque
    of the last turn before the step, which a generator law in balance needs; ``carried``: speed with which a change of
    the wind is carried downstream [m/s]; ``flap_radius``: distance from the axis at which the flap moment is taken [m];
    ``dt``: time step [s] instead of that of the options.
    """
    wind, pitch = (x if callable(x) else (lambda time, x=x: x + 0.0 * time) for x in (wind, pitch))
    dt = dt or np.radians(options.azimuth_step_deg) / rotor_speed
    n_before = round(settling / dt)
    rest = n_before * dt
    per_turn = round(2.0 * np.pi / rotor_speed / dt)
    torques = []

    def speeding(torque, speed):
        torques.append(torque)
        if acceleration is None or len(torques) <= n_before:
            return 0.0
        return acceleration(torque, speed, float(np.mean(torques[n_before - per_turn : n_before])))

    steps = rotor.march(options, VaryingWind(lambda time: wind(time - rest), carried), rotor_speed,
                        lambda time: pitch(time - rest), dt, n_before + round(duration / dt), speeding)  # fmt: skip
    rows, axial = [], []
    for step in steps:
        rows.append((step.time - rest, step.speed, step.thrust, step.torque, _flap(rotor, step, flap_radius)))
        axial.append(step.forces[..., 0].sum(axis=(0, 1)))
    time, speed, thrust, torque, flap = np.array(rows).T
    radius = rotor.root_radius + rotor.planform.span_edges
    return Response(time, wind(time), pitch(time), speed, thrust, torque, flap, radius, np.array(axial))


def _flap(rotor: RigidRotor, step: RotorStep, radius: float) -> float:
    """Mean moment of the axial forces beyond a radius, about the line of that radius in the rotor plane [N m]."""
    angles = step.azimuth + 2.0 * np.pi / rotor.n_blades * np.arange(rotor.n_blades)
    along = np.stack([0.0 * angles, -np.sin(angles), np.cos(angles)], axis=-1)
    arm = np.einsum("bijc,bc->bij", step.nodes, along) - radius
    return float((step.forces[..., 0] * np.maximum(arm, 0.0)).sum() / rotor.n_blades)


def five_megawatt_step(
    options: AeroOptions,
    wind: Callable[..., Any] | float = Ramp(8.0, 9.0),
    pitch: Callable[..., Any] | float = 0.0,
    coupled: bool = False,
    rotor_speed: float = 0.95,
    **settings: Any,
) -> Response:
    """Rigid NREL 5-MW rotor after a step of wind or pitch.

    ``wind``, ``pitch`` [m/s], [rad]; ``coupled`` from the step on, let the rotor turn with its inertia against a torque
    that grows with the square of its speed, in balance before; otherwise at constant speed; ``rotor_speed`` before the
    step [rad/s]; ``options``: further arguments of `respond`.
    """

    def acceleration(torque, speed, settled):
        return (torque - settled * (speed / rotor_speed) ** 2) / INERTIA

    rotor = RigidRotor.of_turbine(load_turbine("nrel_5mw"), options)
    return respond(rotor, options, wind, pitch, rotor_speed, acceleration=acceleration if coupled else None, **settings)


def long_wake(
    turns: float, steps_per_turn: int = 36, n_chord: int = 1, n_span: int = 12, **options: Any
) -> AeroOptions:
    """Wake of ``turns`` turns, every row free and computed anew in every step by the tree code, with an open end."""
    rows = round(turns * steps_per_turn)
    chosen: dict[str, Any] = {
        "n_chord": n_chord, "n_span": n_span, "azimuth_step_deg": 360.0 / steps_per_turn, "wake_rows": rows,
        "full_rows": rows, "fresh_rows": rows, "far_wake": False, "squire": 1e-3, "induction": "tree",
        "tree_tolerance": 3e-3,
    }  # fmt: skip
    return AeroOptions(**(chosen | options))


# ---- blade elements with memory -------------------------------------------------------------------------------------
# An engineering model that shares nothing with the lattice but the polars. The induced velocity of momentum theory,
# W_qs, passes two first-order filters with the mean induction a of the rotor (Øye 1991; the form of AeroDyn's DBEMT),
#
#     W_int + τ1 W_int' = W_qs + k τ1 W_qs',   W + τ2 W' = W_int,   k = 0.6,
#     τ1 = 1.1 R / (V (1 − 1.3 min(a, ½))),    τ2 = (0.39 − 0.26 (r/R)²) τ1.
#
# The lift in a gust that a whole section feels at once is that of steady flow times C(k) + ik/2, circulatory part and
# apparent mass (Theodorsen 1935). Over the vortices that the blades before have shed in layers, C becomes
#
#     C' = [H₁ + 2 J₁ W] / [H₁ + i H₀ + 2 (J₁ + i J₀) W],   W = 1 / (e^{kh + iωT} − 1),
#
# H the Hankel functions of the second kind, T the time from blade to blade and h the distance of two layers in
# semi-chords (Loewy 1957, J. Aeronaut. Sci. 24:81).

FAST_SHARE = 0.6
"""Øye's k: the part of a change that only the faster filter delays."""


def oye_times(induction: float, radius: float, wind: float, ratio: ArrayLike) -> tuple[float, np.ndarray]:
    """Time constants τ1 and τ2 [s] of Øye's filter at radii ``ratio`` in rotor radii."""
    slow = 1.1 / (1.0 - 1.3 * min(induction, 0.5)) * radius / wind
    return slow, (0.39 - 0.26 * np.asarray(ratio) ** 2) * slow


def loewy(k: Any, spacing: Any, lag: float) -> Any:
    """Lift-deficiency function C' of a blade over the layers that it and the others have shed.

    ``k``: reduced frequency; ``spacing``: distance of two layers [semi-chords]; ``lag``: phase ωT by which the layers
    differ [rad].
    """
    layers = 1.0 / (np.exp(k * np.asarray(spacing) + 1j * lag) - 1.0)
    above = hankel2(1, k) + 2.0 * jv(1, k) * layers
    return above / (above + 1j * (hankel2(0, k) + 2.0 * jv(0, k) * layers))


@dataclass(frozen=True)
class GustResponse:
    """Thrust by the amplitude of a uniform gust [N s/m], complex, at one frequency.

    ``full`` with Øye's filter and Loewy's function; ``single`` with Øye's filter and Theodorsen's function: without the
    layers of other blades and turns; ``wake`` with Øye's filter; sections answer at once; ``frozen``, ``equilibrium``:
    sections answer at once; the induced velocity stays, or follows at once.
    """

    full: complex
    single: complex
    wake: complex
    frozen: float
    equilibrium: float


class DynamicRotor:
    """A rotor of blade elements whose induced velocity follows with a delay.

    ``n_span``: sections, of equal length.
    """

    def __init__(self, rotor: BladeElementRotor, n_span: int = 40):
        edges = np.linspace(0.0, rotor.length, n_span + 1)
        z = 0.5 * (edges[1:] + edges[:-1])
        self.rotor, self.width, self.n_span = rotor, rotor.length / n_span, n_span
        self.cos_cone = np.cos(rotor.cone)
        self.radius = (rotor.root_radius + z) * self.cos_cone
        self.chord, self.twist = np.array([float(rotor.chord_at(x)) for x in z]), rotor.twist_at(z)
        self.step = 2.0 * np.pi / N_ALPHA
        angles = -np.pi + self.step * np.arange(N_ALPHA + 1)
        self.polars = np.array([np.column_stack(rotor.polar_at(x).coefficients(angles)[:2]) for x in z])

    def forces(self, axial: np.ndarray, turning: np.ndarray, pitch: float) -> tuple[np.ndarray, np.ndarray]:
        """Forces per length out of the plane and in the direction of motion [N/m] from the air's velocities [m/s]."""
        phi = np.arctan2(axial, turning)
        place = (phi - self.twist - pitch + np.pi) / self.step
        below = np.clip(place.astype(int), 0, N_ALPHA - 1)
        part, section = (place - below)[:, None], np.arange(self.n_span)
        cl, cd = ((1.0 - part) * self.polars[section, below] + part * self.polars[section, below + 1]).T
        pressure = 0.5 * self.rotor.air_density * (axial**2 + turning**2) * self.chord
        return (pressure * (cl * np.cos(phi) + cd * np.sin(phi)), pressure * (cl * np.sin(phi) - cd * np.cos(phi)))

    def loads(self, wind: float, speed: float, pitch: float, induced: np.ndarray) -> tuple[float, float]:
        """Thrust [N] and torque [N m] with the induced velocities (2, n_span), against the wind and with the turn."""
        normal, driving = self.forces(wind * self.cos_cone - induced[0], speed * self.radius + induced[1], pitch)
        scale = self.rotor.n_blades * self.width
        return scale * normal.sum() * self.cos_cone, scale * (driving @ self.radius)

    def equilibrium(self, wind: float, speed: float, pitch: float) -> np.ndarray:
        """Induced velocities (2, n_span) of momentum theory [m/s]."""
        result = blade_element(self.rotor, wind, speed, pitch, self.n_span)
        return np.array([result.axial * wind * self.cos_cone, result.tangential * speed * self.radius])

    def mean_induction(self, induced: np.ndarray, wind: float) -> float:
        """Induction factor averaged over the area of the disc."""
        return float(induced[0] @ self.radius / self.radius.sum() / wind)

    def gust_response(
        self, frequency: float, wind: float, speed: float, pitch: float = 0.0, gust: float = 0.01
    ) -> GustResponse:
        """Linear response to a small sinusoidal change of the wind everywhere at once.

        ``frequency`` [Hz]; ``wind``, ``speed``, ``pitch``: mean state [m/s], [rad/s], [rad]; ``gust``: step of the
        derivatives [m/s].
        """
        omega = 2.0 * np.pi * frequency
        induced = self.equilibrium(wind, speed, pitch)
        slope = (self.equilibrium(wind + gust, speed, pitch) - self.equilibrium(wind - gust, speed, pitch)) / (2 * gust)
        axial, turning = wind * self.cos_cone - induced[0], speed * self.radius + induced[1]

        def derivative(d_axial: np.ndarray | float, d_turning: np.ndarray | float) -> np.ndarray:
            ahead = self.forces(axial + gust * d_axial, turning + gust * d_turning, pitch)[0]
            behind = self.forces(axial - gust * d_axial, turning - gust * d_turning, pitch)[0]
            return (ahead - behind) / (2.0 * gust) * self.rotor.n_blades * self.width * self.cos_cone

        by_wind = derivative(self.cos_cone, 0.0)
        by_wake = derivative(-slope[0], slope[1])
        a = self.mean_induction(induced, wind)
        slow, fast = oye_times(a, self.rotor.radius, wind, self.radius / self.rotor.radius)
        wake = (1.0 + FAST_SHARE * slow * 1j * omega) / ((1.0 + slow * 1j * omega) * (1.0 + fast * 1j * omega))
        k = 0.5 * omega * self.chord / np.hypot(axial, turning)
        passing = 2.0 * np.pi / (self.rotor.n_blades * speed)
        layered = loewy(k, axial * passing / (0.5 * self.chord), omega * passing)
        by_gust = by_wind + wake * by_wake
        return GustResponse(
            complex(by_gust @ (layered + 0.5j * k)),
            complex(by_gust @ (theodorsen(k) + 0.5j * k)),
            complex(by_gust.sum()),
            float(by_wind.sum()),
            float((by_wind + by_wake).sum()),
        )

    def respond(
        self,
        wind: Callable[..., Any],
        pitch: Callable[..., Any],
        speed: float,
        duration: float = 60.0,
        dt: float = 0.05,
        acceleration: Callable[..., Any] | None = None,
    ) -> Response:
        """Answer to wind and pitch in time from equilibrium; sections answer at once.

        Arguments are those of `rotor_transients.respond`; the signals before time 0 cover 6 s.
        """
        table = self._table(wind, pitch, speed, duration)
        n_before = round(6.0 / dt)
        times = dt * np.arange(-n_before, round(duration / dt) + 1)
        target = table(wind(times[0]), speed, pitch(times[0]))
        delayed, induced = (1.0 - FAST_SHARE) * target, target.copy()
        settled = self.loads(wind(times[0]), speed, pitch(times[0]), induced)[1]
        rows = []
        for time in times:
            v, beta = float(wind(time)), float(pitch(time))
            thrust, torque = self.loads(v, speed, beta, induced)
            rows.append((time, v, beta, speed, thrust, torque, np.nan))
            target = table(v, speed, beta)
            a = self.mean_induction(target, v)
            slow, fast = oye_times(a, self.rotor.radius, v, self.radius / self.rotor.radius)
            keep_slow, keep_fast = np.exp(-dt / slow), np.exp(-dt / fast)
            delayed = (1.0 - FAST_SHARE) * target + keep_slow * (delayed - (1.0 - FAST_SHARE) * target)
            through = delayed + FAST_SHARE * target
            induced = through + keep_fast * (induced - through)
            if acceleration is not None and time >= 0.0:
                speed += dt * acceleration(torque, speed, settled)
        return Response(*np.array(rows).T)

    def _table(
        self, wind: Callable[..., Any], pitch: Callable[..., Any], speed: float, duration: float
    ) -> Callable[[float, float, float], np.ndarray]:
        """Induced velocities of momentum theory between tabulated tip-speed ratios and pitch angles."""
        times = np.linspace(0.0, duration, 401)
        winds, pitches = np.unique(np.round(wind(times), 9)), np.unique(np.round(pitch(times), 9))
        steady = np.ptp(winds) < 1e-6
        ratios = speed / (winds[0] * np.array([1.01, 0.99]) if steady else np.linspace(
            0.85 * winds.min(), 1.2 * winds.max(), 25)[::-1])  # fmt: skip
        angles = np.linspace(pitches.min(), pitches.max() + 1e-6, 9 if np.ptp(pitches) > 1e-6 else 2)
        factors = np.array([[self._factors(1.0, ratio, angle) for angle in angles] for ratio in ratios])
        lookup = RegularGridInterpolator((ratios, angles), factors)

        def induced(v: float, omega: float, beta: float) -> np.ndarray:
            a, turning = lookup((omega / v, np.clip(beta, angles[0], angles[-1])))
            return np.array([a * v * self.cos_cone, turning * omega * self.radius])

        return induced

    def _factors(self, wind: float, speed: float, pitch: float) -> np.ndarray:
        result = blade_element(self.rotor, wind, speed, pitch, self.n_span)
        return np.array([result.axial, result.tangential])
