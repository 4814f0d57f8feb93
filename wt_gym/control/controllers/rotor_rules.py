"""Rules that scale the gains of controllers to a turbine: sensitivities and masses from its dimensions."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from wt_gym.turbines import Turbine

__all__ = ["TowerTop", "flap_moment_sensitivity", "tower_top"]


def flap_moment_sensitivity(turbine: Turbine) -> float:
    """Fall of the flapwise root moment with the pitch of a blade at rated speed [N m/rad], positive.

    ``rho/2 2 pi Omega^2 int c r^2 (r - r_root) dr``: thin-aerofoil lift in the speed of rotation alone, without the
    change of induction and without the lag of the wake, hence an upper bound, about 1.5 times what a blade shows.
    """
    blade, speed = turbine.blade, turbine.drivetrain.rated_rotor_speed
    along = np.linspace(0.0, blade.length, 101)
    radius = blade.root_radius + along
    lift = math.pi * turbine.air_density * speed**2 * radius**2 * blade.chord_at(along)
    return float(np.trapezoid(lift * along, along))


@dataclass(frozen=True)
class TowerTop:
    """A tower as a spring with a mass on it, in its first bending mode.

    Attributes
    ----------
    mass : float
        Nacelle, rotor and a share of the tower [kg].
    fore_aft, side_side : float
        Natural frequencies [rad/s].
    force_per_moment : float
        Side force at the top that bends the tower as far as a moment about the wind's axis does [1/m].
    """

    mass: float
    fore_aft: float
    side_side: float
    force_per_moment: float


def tower_top(turbine: Turbine) -> TowerTop:
    """First bending modes of a tower, from the deflection under a force at its top.

    The tower's own mass counts with the square of that deflection (Rayleigh's quotient). Rotor and nacelle are a point
    mass at the top.
    """
    structure, hub, nacelle = turbine.tower.structure, turbine.hub, turbine.nacelle
    z = np.linspace(0.0, structure.station[-1], 201)
    arm, step = z[-1] - z, np.diff(z)[0]
    blade = turbine.blade.structure
    rotor = turbine.n_blades * np.trapezoid(blade.inertia[:, 0, 0], blade.station) + hub.mass
    top = float(nacelle.mass + nacelle.yaw_bearing_mass + rotor)

    def frequency(axis: int) -> tuple[float, float, float]:
        """Frequency [rad/s], modal mass [kg] and ratio of deflections under a moment and a force [1/m]."""
        bending = np.interp(z, structure.station, structure.stiffness[:, axis, axis])
        slope = _integral(arm / bending, step)
        shape = _integral(slope, step)
        by_moment = _integral(_integral(1.0 / bending, step), step)[-1]
        line = np.interp(z, structure.station, structure.inertia[:, 0, 0])
        mass = top + float(np.trapezoid(line * (shape / shape[-1]) ** 2, z))
        return math.sqrt(1.0 / (shape[-1] * mass)), mass, float(by_moment / shape[-1])

    fore_aft, mass, _ = frequency(4)
    side_side, _, ratio = frequency(3)
    return TowerTop(mass, fore_aft, side_side, ratio)


def _integral(values: np.ndarray, step: float) -> np.ndarray:
    """Integral from the start by the trapezoidal rule, shape of the values."""
    return np.concatenate(([0.0], np.cumsum(0.5 * step * (values[1:] + values[:-1]))))
