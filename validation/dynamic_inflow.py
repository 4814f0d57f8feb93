"""Blade-element theory with memory: Øye's filter for the wake and Loewy's function for the sections.

An engineering model that shares nothing with the lattice but the polars, to compare the lattice's memory with. The
induced velocity of momentum theory, W_qs, passes two first-order filters (Øye 1991; the form of AeroDyn's DBEMT),

    W_int + τ1 W_int' = W_qs + k τ1 W_qs',   W + τ2 W' = W_int,   k = 0.6,
    τ1 = 1.1 R / (V (1 − 1.3 min(a, ½))),    τ2 = (0.39 − 0.26 (r/R)²) τ1,

with the mean induction a of the rotor. A gust that a whole section feels at once acts like a plunging motion: its lift
is that of steady flow times C(k) + ik/2, the circulatory part and the apparent mass (Theodorsen 1935). Behind a rotor
the vortices that the blades before have shed lie in layers under the section; if all blades do the same, C becomes

    C' = [H₁ + 2 J₁ W] / [H₁ + i H₀ + 2 (J₁ + i J₀) W],   W = 1 / (e^{kh + iωT} − 1),

H the Hankel functions of the second kind, T the time from blade to blade and h the distance of two layers in
semi-chords (Loewy 1957, J. Aeronaut. Sci. 24:81). Near the passing frequency of the blades the layers add up.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.interpolate import RegularGridInterpolator
from scipy.special import hankel2, jv

from validation.rotor_transients import Response
from validation.unsteady_airfoil import theodorsen
from wt_gym.simulation.models import N_ALPHA
from wt_gym.turbines.blade_element import BladeElementRotor, blade_element

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

__all__ = ["DynamicRotor", "GustResponse", "loewy", "oye_filter", "oye_times"]

FAST_SHARE = 0.6
"""Øye's k: the part of a change that only the faster filter delays."""


def oye_times(induction: float, radius: float, wind: float, ratio: ArrayLike) -> tuple[float, np.ndarray]:
    """Time constants τ1 and τ2 [s] of Øye's filter at radii ``ratio`` in rotor radii."""
    slow = 1.1 / (1.0 - 1.3 * min(induction, 0.5)) * radius / wind
    return slow, (0.39 - 0.26 * np.asarray(ratio) ** 2) * slow


def oye_filter(omega: Any, slow: Any, fast: Any) -> Any:
    """Complex response of Øye's filter at the circular frequency ``omega`` [rad/s]."""
    return (1.0 + FAST_SHARE * slow * 1j * omega) / ((1.0 + slow * 1j * omega) * (1.0 + fast * 1j * omega))


def loewy(k: Any, spacing: Any, lag: float) -> Any:
    """Lift-deficiency function C' of a blade over the layers that it and the others have shed.

    Parameters
    ----------
    k : array_like
        Reduced frequency.
    spacing : array_like
        Distance of two layers [semi-chords].
    lag : float
        Phase ωT by which the layers differ [rad].
    """
    layers = 1.0 / (np.exp(k * np.asarray(spacing) + 1j * lag) - 1.0)
    above = hankel2(1, k) + 2.0 * jv(1, k) * layers
    return above / (above + 1j * (hankel2(0, k) + 2.0 * jv(0, k) * layers))


@dataclass(frozen=True)
class GustResponse:
    """Thrust by the amplitude of a uniform gust [N s/m], complex, at one frequency.

    Attributes
    ----------
    full : complex
        With Øye's filter and Loewy's function.
    single : complex
        With Øye's filter and Theodorsen's function: without the layers of other blades and turns.
    wake : complex
        With Øye's filter; sections answer at once.
    frozen, equilibrium : float
        Sections answer at once; the induced velocity stays, or follows at once.
    """

    full: complex
    single: complex
    wake: complex
    frozen: float
    equilibrium: float


class DynamicRotor:
    """A rotor of blade elements whose induced velocity follows with a delay.

    Parameters
    ----------
    rotor : BladeElementRotor
    n_span : int
        Sections, of equal length.
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

        Parameters
        ----------
        frequency : float
            [Hz].
        wind, speed, pitch : float
            Mean state [m/s], [rad/s], [rad].
        gust : float
            Step of the derivatives [m/s].

        Returns
        -------
        GustResponse
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
        wake = oye_filter(omega, *oye_times(a, self.rotor.radius, wind, self.radius / self.rotor.radius))
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
