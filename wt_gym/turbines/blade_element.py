"""Blade-element momentum theory of a rigid rotor in a uniform axial wind, for many operating points at once.

Each section is solved on its own (Ning, Wind Energy 17 (2014) 1327): the inflow angle at which the momentum of the
annulus balances the forces of the polar, with Prandtl's losses at tip and root and Buhl's thrust above a = 0.4
(NREL/TP-500-36834). The residual has one root in each bracket of that paper; bisection finds it to rounding, for all
sections and points together.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from wt_gym.base.quantities import Array
from wt_gym.turbines import Turbine
from wt_gym.turbines.airfoil import Polar

_SMALL = 1e-6
_BISECTIONS = 46  # Halvings of a bracket of at most pi/2: the inflow angle is then known to 3e-14 rad


@dataclass(frozen=True)
class BladeElementRotor:
    """A rotor as blade-element theory sees it."""

    n_blades: int
    root_radius: float
    """Distance of the blade root from the axis [m]."""
    length: float
    """Of the blade [m]."""
    radius: float
    """Radius of the disc to which coefficients refer [m]."""
    cone: float
    """[rad]."""
    air_density: float
    """[kg/m^3]."""
    chord_at: Callable[[ArrayLike], Array]
    """Chord [m] at a distance from the root [m]."""
    twist_at: Callable[[ArrayLike], Array]
    """Twist [rad] likewise."""
    polar_at: Callable[[float], Polar]
    """`Polar` at a distance from the root [m]."""

    @classmethod
    def of_turbine(cls, turbine: Turbine) -> "BladeElementRotor":
        """Rotor of a turbine; coefficients refer to the nominal diameter."""
        blade = turbine.blade
        return cls(
            turbine.n_blades, blade.root_radius, blade.length, 0.5 * turbine.rotor_diameter, turbine.hub.cone,
            turbine.air_density, blade.chord_at, blade.twist_at, blade.polar_at,
        )  # fmt: skip


class BladeElements:
    """The sections of a rotor, of equal length, ready to be solved.

    Attributes
    ----------
    width : float
        Length of a section [m].
    span, radius : ndarray, shape (n_span,)
        Distance of the sections from the axis along the blade, and radius of their circles [m].
    chord, twist : ndarray, shape (n_span,)
        [m], [rad].
    polars : list of Polar
        Of every section.
    """

    def __init__(self, rotor: BladeElementRotor, n_span: int = 60):
        edges = np.linspace(0.0, rotor.length, n_span + 1)
        middle, cos = 0.5 * (edges[1:] + edges[:-1]), np.cos(rotor.cone)
        self.rotor, self.width = rotor, rotor.length / n_span
        self.span = rotor.root_radius + middle
        self.radius = self.span * cos
        self.chord = np.array([float(rotor.chord_at(z)) for z in middle])
        self.twist = np.array([float(rotor.twist_at(z)) for z in middle])
        self.polars = [rotor.polar_at(z) for z in middle]
        # distances to tip and root in Prandtl's losses, over the radius of the section and of the root
        tip, root = (rotor.root_radius + rotor.length) * cos, rotor.root_radius * cos
        self._ends = (tip - self.radius) / self.radius, (self.radius - root) / root

    def coefficients(self, alpha: Array) -> tuple[Array, Array]:
        """Lift and drag coefficient of every section at angles of attack (points, n_span) [rad]."""
        wrapped = np.where(np.abs(alpha) <= np.pi, alpha, np.mod(alpha + np.pi, 2.0 * np.pi) - np.pi)
        cl, cd = np.empty_like(wrapped), np.empty_like(wrapped)
        for k, polar in enumerate(self.polars):
            cl[:, k] = np.interp(wrapped[:, k], polar.alpha, polar.cl)
            cd[:, k] = np.interp(wrapped[:, k], polar.alpha, polar.cd)
        return cl, cd

    def solve(self, wind: ArrayLike, rotor_speed: ArrayLike, pitch: ArrayLike) -> dict[str, Array]:
        """Solve points of shape (n,), or numbers: wind [m/s], rotor speed [rad/s], pitch [rad].

        Returns
        -------
        dict
            ``power`` [W] and ``thrust`` [N] of shape (n,); ``alpha``, ``speed``, ``axial``, ``tangential``, ``cl``,
            ``cd``, ``normal`` and ``driving`` (forces per length across the section and in the direction of motion
            [N/m]) of shape (n, n_span).
        """
        given = (np.atleast_1d(np.asarray(x, dtype=np.float64)) for x in (wind, rotor_speed, pitch))
        points = np.broadcast_arrays(*given)
        wind_, speed_, pitch_ = (x[:, None] for x in points)
        angle = self.twist[None, :] + pitch_
        along, across = wind_ * np.cos(self.rotor.cone), speed_ * self.radius[None, :]
        phi = self._inflow_angle(angle, across / along)
        axial, tangential = self._induction(phi, angle)
        return self._forces(phi, phi - angle, axial, tangential, along, across, speed_)

    def frozen_wake(
        self,
        wind: float,
        rotor_speed: float,
        pitch: float,
        pitch_changes: ArrayLike,
        wind_changes: ArrayLike = 0.0,
        speed_changes: ArrayLike = 0.0,
    ) -> dict[str, Array]:
        """Forces at a changed pitch, wind and speed while the induced velocities stay those of a steady point.

        Parameters
        ----------
        wind, rotor_speed, pitch : float
            Steady point [m/s], [rad/s], [rad].
        pitch_changes, wind_changes, speed_changes : array_like, shape (n,)
            [rad], [m/s], [rad/s].

        Returns
        -------
        dict
            As `solve`.
        """
        steady = self.solve(wind, rotor_speed, pitch)
        changes = (np.asarray(x, dtype=np.float64) for x in (pitch_changes, wind_changes, speed_changes))
        turned, winds, speeds = (np.atleast_1d(x)[:, None] for x in np.broadcast_arrays(*changes))
        winds, speeds = winds + wind, speeds + rotor_speed
        axial, tangential = steady["axial"] * (wind / winds), steady["tangential"] * (rotor_speed / speeds)
        along, across = winds * np.cos(self.rotor.cone), speeds * self.radius[None, :]
        phi = np.arctan2(along * (1.0 - axial), across * (1.0 + tangential))
        alpha = phi - self.twist[None, :] - pitch - turned
        return self._forces(phi, alpha, axial, tangential, along, across, speeds[:, 0])

    def _forces(
        self,
        phi: Array,
        alpha: Array,
        axial: Array,
        tangential: Array,
        along: Array | float,
        across: Array,
        rotor_speed: Array | float,
    ) -> dict[str, Array]:
        """Forces of the sections and of the rotor from the inflow."""
        rotor, cos_cone = self.rotor, np.cos(self.rotor.cone)
        cl, cd = self.coefficients(alpha)
        speed = np.hypot(along * (1.0 - axial), across * (1.0 + tangential))
        pressure = 0.5 * rotor.air_density * speed**2 * self.chord[None, :]
        normal = pressure * (cl * np.cos(phi) + cd * np.sin(phi))
        driving = pressure * (cl * np.sin(phi) - cd * np.cos(phi))
        moment = rotor.n_blades * np.sum(driving * self.radius[None, :], axis=1) * self.width
        return {
            "power": moment * np.ravel(rotor_speed),
            "thrust": rotor.n_blades * np.sum(normal, axis=1) * self.width * cos_cone,
            "alpha": alpha, "speed": speed, "axial": axial, "tangential": tangential, "cl": cl, "cd": cd,
            "normal": normal, "driving": driving,
        }  # fmt: skip

    def _inflow_angle(self, angle: Array, ratio: Array) -> Array:
        """Root of the residual in the first of three brackets with a change of sign [rad]."""

        def residual(phi: Array) -> Array:
            axial, tangential = self._induction(phi, angle)
            with np.errstate(divide="ignore", invalid="ignore"):
                return np.sin(phi) / (1.0 - axial) - np.cos(phi) / ratio / (1.0 + tangential)

        whole = np.ones_like(angle)
        usual = residual(_SMALL * whole) * residual(0.5 * np.pi * whole) < 0.0
        # the rotor drives the air
        driving = ~usual & (residual(-0.25 * np.pi * whole) * residual(-_SMALL * whole) < 0.0)
        low = np.where(usual, _SMALL, np.where(driving, -0.25 * np.pi, 0.5 * np.pi + _SMALL))
        high = np.where(usual, 0.5 * np.pi, np.where(driving, -_SMALL, np.pi - _SMALL))
        sign = np.sign(residual(low))
        for _ in range(_BISECTIONS):
            middle = 0.5 * (low + high)
            same = np.sign(residual(middle)) == sign
            low, high = np.where(same, middle, low), np.where(same, high, middle)
        return 0.5 * (low + high)

    def _induction(self, phi: Array, angle: Array) -> tuple[Array, Array]:
        """Induction factors a and a' of the momentum balance at inflow angles, each (points, n_span)."""
        cl, cd = self.coefficients(phi - angle)
        s, c = np.sin(phi), np.cos(phi)
        normal, tangential = cl * c + cd * s, cl * s - cd * c
        n_blades, loss = self.rotor.n_blades, np.ones_like(phi)
        for distance in self._ends:
            exponent = -0.5 * n_blades * distance[None, :] / np.maximum(np.abs(s), 1e-9)
            loss = loss * (2.0 / np.pi * np.arccos(np.exp(exponent)))
        solidity = n_blades * self.chord[None, :] / (2.0 * np.pi * self.radius[None, :])
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            k = solidity * normal / (4.0 * loss * s * s)
            k_turn = solidity * tangential / (4.0 * loss * s * c)
            # Buhl's thrust, solved for a
            g1 = 2.0 * loss * k - (10.0 / 9.0 - loss)
            g2 = np.maximum(2.0 * loss * k - loss * (4.0 / 3.0 - loss), 0.0)
            g3 = 2.0 * loss * k - (25.0 / 9.0 - 2.0 * loss)
            heavy = np.where(np.abs(g3) > 1e-6, (g1 - np.sqrt(g2)) / g3, 1.0 - 0.5 / np.sqrt(g2))
            axial = np.where((k <= 2.0 / 3.0) | (phi < 0.0), k / (1.0 + k), heavy)
            return axial, k_turn / (1.0 - k_turn)
