"""Blade-element momentum theory for a rigid rotor in a uniform axial wind, to compare the lattice with.

Every section is solved on its own (Ning, Wind Energy 17 (2014) 1327): the inflow angle at which the momentum of the
annulus takes up the polar's forces, with Prandtl's losses at tip and root and Buhl's thrust above a = 0.4.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq

__all__ = ["BladeElementResult", "BladeElementRotor", "blade_element"]


@dataclass(frozen=True)
class BladeElementRotor:
    """A rotor as blade-element theory sees it.

    Attributes
    ----------
    n_blades : int
    root_radius, length : float
        Distance of the blade root from the axis, and length of the blade [m].
    radius : float
        Radius of the disc to which coefficients refer [m].
    cone : float
        [rad].
    air_density : float
        [kg/m^3].
    chord_at, twist_at : callable
        Chord [m] and twist [rad] at a distance from the root [m].
    polar_at : callable
        `Polar` at a distance from the root [m].
    """

    n_blades: int
    root_radius: float
    length: float
    radius: float
    cone: float
    air_density: float
    chord_at: Callable
    twist_at: Callable
    polar_at: Callable

    @classmethod
    def of_turbine(cls, turbine) -> BladeElementRotor:
        """Rotor of a turbine of the catalogue; coefficients refer to the nominal diameter."""
        blade = turbine.blade
        return cls(
            turbine.n_blades, blade.root_radius, blade.length, 0.5 * turbine.rotor_diameter, turbine.hub.cone,
            turbine.air_density, blade.chord_at, blade.twist_at, blade.polar_at,
        )  # fmt: skip


@dataclass(frozen=True)
class BladeElementResult:
    """Blade-element momentum solution; arrays are of shape (n_span,).

    Attributes
    ----------
    power, thrust : float
        [W], [N] of the rotor.
    cp, ct : float
        Referred to the nominal diameter.
    span : ndarray
        Distance of the sections from the axis, along the blade [m].
    alpha : ndarray
        Angle of attack [rad].
    speed : ndarray
        In the section plane [m/s].
    axial, tangential : ndarray
        Induction factors a and a'.
    cl, cd : ndarray
    force : ndarray, shape (n_span, 2)
        Force per length along the axis and in the direction of motion [N/m].
    """

    power: float
    thrust: float
    cp: float
    ct: float
    span: np.ndarray
    alpha: np.ndarray
    speed: np.ndarray
    axial: np.ndarray
    tangential: np.ndarray
    cl: np.ndarray
    cd: np.ndarray
    force: np.ndarray


def blade_element(rotor: BladeElementRotor, wind: float, rotor_speed: float, pitch: float = 0.0, n_span: int = 60):
    """Solve a rotor without tilt, tower and deflection.

    Parameters
    ----------
    rotor : BladeElementRotor
    wind : float
        [m/s].
    rotor_speed : float
        [rad/s].
    pitch : float
        [rad].
    n_span : int
        Sections, of equal length.

    Returns
    -------
    BladeElementResult
    """
    cos_cone, n_blades = np.cos(rotor.cone), rotor.n_blades
    edges = np.linspace(0.0, rotor.length, n_span + 1)
    middle, width = 0.5 * (edges[1:] + edges[:-1]), np.diff(edges)
    along = rotor.root_radius + middle
    radius, tip, root = along * cos_cone, (rotor.root_radius + rotor.length) * cos_cone, rotor.root_radius * cos_cone
    rows = []
    for z, r in zip(middle, radius, strict=True):
        section = _Section(
            rotor.polar_at(z), float(rotor.chord_at(z)), float(rotor.twist_at(z)) + pitch, r, tip, root, n_blades,
            wind * cos_cone, rotor_speed * r,
        )  # fmt: skip
        rows.append(section.solve())
    phi, alpha, speed, axial, tangential, cl, cd, chord = np.array(rows).T
    pressure = 0.5 * rotor.air_density * speed**2 * chord
    normal, driving = cl * np.cos(phi) + cd * np.sin(phi), cl * np.sin(phi) - cd * np.cos(phi)
    thrust = n_blades * float(np.sum(pressure * normal * width)) * cos_cone
    power = n_blades * float(np.sum(pressure * driving * radius * width)) * rotor_speed
    reference = 0.5 * rotor.air_density * np.pi * rotor.radius**2 * wind**2
    return BladeElementResult(
        power=power, thrust=thrust, cp=power / (reference * wind), ct=thrust / reference, span=along, alpha=alpha,
        speed=speed, axial=axial, tangential=tangential, cl=cl, cd=cd,
        force=np.column_stack((pressure * normal * cos_cone, pressure * driving)),
    )  # fmt: skip


@dataclass(frozen=True)
class _Section:
    polar: object
    chord: float
    angle: float
    radius: float
    tip: float
    root: float
    n_blades: int
    wind: float
    rotation: float

    def solve(self):
        """Return inflow angle, angle of attack, speed, a, a', cl, cd and chord."""
        small = 1e-6
        if self._residual(small) * self._residual(0.5 * np.pi) < 0.0:
            bracket = (small, 0.5 * np.pi)
        elif self._residual(-0.25 * np.pi) * self._residual(-small) < 0.0:
            bracket = (-0.25 * np.pi, -small)  # the rotor drives the air
        else:
            bracket = (0.5 * np.pi + small, np.pi - small)
        phi = brentq(self._residual, *bracket, xtol=1e-12)
        cl, cd, a, b = self._induction(phi)
        speed = np.hypot(self.wind * (1.0 - a), self.rotation * (1.0 + b))
        return phi, phi - self.angle, speed, a, b, cl, cd, self.chord

    def _residual(self, phi):
        _, _, a, b = self._induction(phi)
        ratio = self.rotation / self.wind
        return np.sin(phi) / (1.0 - a) - np.cos(phi) / ratio / (1.0 + b)

    def _induction(self, phi):
        """Lift, drag, a and a' of the momentum balance at an inflow angle."""
        cl, cd, _ = (float(x) for x in self.polar.coefficients(phi - self.angle))
        s, c = np.sin(phi), np.cos(phi)
        normal, tangential = cl * c + cd * s, cl * s - cd * c
        loss = 1.0
        for distance in ((self.tip - self.radius) / self.radius, (self.radius - self.root) / self.root):
            loss *= 2.0 / np.pi * np.arccos(np.exp(-0.5 * self.n_blades * distance / max(abs(s), 1e-9)))
        solidity = self.n_blades * self.chord / (2.0 * np.pi * self.radius)
        k = solidity * normal / (4.0 * loss * s * s)
        k_turn = solidity * tangential / (4.0 * loss * s * c)
        if k <= 2.0 / 3.0 or phi < 0.0:
            a = k / (1.0 + k)
        else:  # Buhl, NREL/TP-500-36834 (2005), solved for a
            g1, g2 = 2.0 * loss * k - (10.0 / 9.0 - loss), 2.0 * loss * k - loss * (4.0 / 3.0 - loss)
            g3 = 2.0 * loss * k - (25.0 / 9.0 - 2.0 * loss)
            a = (g1 - np.sqrt(g2)) / g3 if abs(g3) > 1e-6 else 1.0 - 0.5 / np.sqrt(g2)
        return cl, cd, a, k_turn / (1.0 - k_turn)
