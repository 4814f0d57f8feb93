"""Steps of wind and pitch on a rigid rotor: overshoot of the loads and the time constants of the wake.

A wake takes several rotor radii of travel to follow a change of the rotor's thrust. Until then the rotor works in the
induction of before: its loads overshoot, and come back with two time constants.

>>> from validation.rotor_transients import five_megawatt_step                    # doctest: +SKIP
>>> run = five_megawatt_step(options, coupled=True)                                # any AeroOptions
>>> run.overshoot("thrust"), run.overshoot("rotor_speed"), run.fit("thrust")       # doctest: +SKIP
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.optimize import least_squares

from validation.rigid_rotor import RigidRotor
from wt_gym.aerodynamics import AeroOptions
from wt_gym.turbines import load_turbine

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from validation.rigid_rotor import RotorStep

__all__ = [
    "Overshoot",
    "Ramp",
    "Response",
    "TwoExponentials",
    "VaryingWind",
    "five_megawatt_step",
    "long_wake",
    "respond",
]

INERTIA = 38_759_228.0 + 97.0**2 * 534.116
"""Of rotor and generator of the NREL 5-MW turbine about the slow shaft [kg m^2] (NREL/TP-500-38060)."""
FITTED_TIMES = (0.2, 60.0)
"""Range of the time constants that are looked for [s]."""
WHOLE_FIELD = np.inf
"""Speed with which a change of the wind is carried downstream: it is felt everywhere at once."""


@dataclass(frozen=True)
class Ramp:
    """A quantity that goes from one value to another, linearly, and back again if told so.

    Attributes
    ----------
    before, after : float
    start, duration : float
        Of the ramp [s].
    back : float
        Time at which the way back begins [s]; never by default.
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

    Attributes
    ----------
    speed : callable
        Speed [m/s] at a time [s].
    carried : float
        Speed with which changes are carried downstream from x = 0 [m/s]; infinite: everywhere at once.
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

    Attributes
    ----------
    before, extreme, settled : float
        Steady before the step, the value furthest beyond the settled one, and the end of the run.
    recovery : float
        Time from the extreme until the quantity stays within a tenth of the overshoot [s].
    mean_time : float
        Area of the overshoot from the extreme on, by its height [s]: the time constant of one exponential.
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

    Attributes
    ----------
    settled, fast, slow : float
    fast_time, slow_time : float
        [s].
    residual : float
        Root mean square of the misfit by the size of the transient.
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

    Attributes
    ----------
    time : ndarray, shape (n,)
        [s].
    wind, pitch, rotor_speed : ndarray, shape (n,)
        [m/s], [rad], [rad/s].
    thrust, torque : ndarray, shape (n,)
        Of the air on the rotor [N], [N m].
    flap : ndarray, shape (n,)
        Mean moment of the blades out of the plane at the root, or at ``flap_radius`` [N m].
    radius : ndarray, shape (n_edge,)
        Distance of the span edges of the blades from the axis [m]; empty without a lattice.
    axial : ndarray, shape (n, n_edge)
        Axial force on the nodes at the span edges, of all blades [N].
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


def respond(
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

    Parameters
    ----------
    rotor : RigidRotor
    options : AeroOptions
        The time step turns the rotor by ``azimuth_step_deg`` at ``rotor_speed``.
    wind, pitch : callable or float
        Wind speed [m/s] and pitch [rad] at a time [s], for example a `Ramp`; constant before time 0.
    rotor_speed : float
        At the start [rad/s].
    duration, settling : float
        Time after and before the step [s].
    acceleration : callable, optional
        As for `RigidRotor.march`, but from time 0 on: ``acceleration(torque, rotor_speed, settled_torque)`` with the
        mean torque of the last turn before the step, which a generator law in balance needs.
    carried : float
        Speed with which a change of the wind is carried downstream [m/s].
    flap_radius : float
        Distance from the axis at which the flap moment is taken [m].
    dt : float, optional
        Time step [s] instead of that of the options.

    Returns
    -------
    Response
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

    Parameters
    ----------
    options : AeroOptions
    wind, pitch : callable or float
        [m/s], [rad].
    coupled : bool
        From the step on, let the rotor turn with its inertia against a torque that grows with the square of its speed,
        in balance before; otherwise at constant speed.
    rotor_speed : float
        Before the step [rad/s].
    **settings
        Further arguments of `respond`.
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
