"""Rules that scale the gains of controllers to a turbine: sensitivities and masses from its dimensions."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from wt_gym.turbines import Support, Tower, Turbine

__all__ = ["TowerTop", "flap_moment_sensitivity", "same_rotor", "slower_than_reference", "tower_top"]

_REFERENCE_SPEED = 12.1 * (math.pi / 30.0)
"""Rated speed of the rotor for which times and rates of rules were chosen, that of the NREL 5-MW [rad/s]."""


def flap_moment_sensitivity(turbine: Turbine) -> float:
    """Fall of the flapwise root moment with the pitch of a blade at rated speed [N m/rad], positive.

    ``rho/2 2 pi Omega^2 int c r^2 (r - r_root) dr``: thin-airfoil lift in the speed of rotation alone, without the
    change of induction and without the lag of the wake, hence an upper bound, about 1.5 times what a blade shows.
    """
    blade, speed = turbine.blade, turbine.drivetrain.rated_rotor_speed
    along = np.linspace(0.0, blade.length, 101)
    radius = blade.root_radius + along
    lift = math.pi * turbine.air_density * speed**2 * radius**2 * blade.chord_at(along)
    return float(np.trapezoid(lift * along, along))


def slower_than_reference(turbine: Turbine) -> float:
    """Time of a turn at rated speed over that of a rotor of 12.1 rpm: by how much times of rules are longer [-]."""
    return _REFERENCE_SPEED / turbine.drivetrain.rated_rotor_speed


def same_rotor(one: Turbine, other: Turbine) -> bool:
    """Whether two turbines have the same rotor and drive train, whatever tower or monopile these stand on."""
    from wt_gym.simulation.contract import fingerprint  # the simulator is heavy, and rarely needed here

    def rotor(turbine: Turbine) -> str:
        return fingerprint(turbine.n_blades, turbine.rotor_diameter, turbine.blade, turbine.hub, turbine.drivetrain)

    return rotor(one) == rotor(other)


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
    mass at the top. A monopile bends with the tower, turns and shifts on its foundation, and carries water along.
    """
    hub, nacelle = turbine.hub, turbine.nacelle
    blade = turbine.blade.structure
    rotor = turbine.n_blades * np.trapezoid(blade.inertia[:, 0, 0], blade.station) + hub.mass
    top = float(nacelle.mass + nacelle.yaw_bearing_mass + rotor)
    column = _column(turbine.tower)
    z = np.linspace(0.0, column.station[-1], 201)
    arm, step = z[-1] - z, np.diff(z)[0]
    line = np.interp(z, column.station, column.mass) + column.water(z)

    def frequency(axis: int) -> tuple[float, float, float]:
        """Frequency [rad/s], modal mass [kg] and ratio of deflections under a moment and a force [1/m]."""
        bending = np.interp(z, column.station, column.stiffness[:, axis, axis])
        (shift, turn), (shift_by_moment, turn_by_moment) = column.base(axis)
        slope = _integral(arm / bending, step)
        shape = _integral(slope, step) + shift + turn * z
        by_moment = _integral(_integral(1.0 / bending, step), step)[-1] + shift_by_moment + turn_by_moment * z[-1]
        shares = (shape / shape[-1]) ** 2
        mass = top + float(np.trapezoid(line * shares, z)) + column.lump * float(np.interp(column.lump_at, z, shares))
        return math.sqrt(1.0 / (shape[-1] * mass)), mass, float(by_moment / shape[-1])

    fore_aft, mass, _ = frequency(4)
    side_side, _, ratio = frequency(3)
    return TowerTop(mass, fore_aft, side_side, ratio)


@dataclass(frozen=True)
class _Column:
    """Tower with the support it may stand on: tables from the foot up, a lump of mass, and the ground."""

    station: NDArray[np.float64]  # (n,) [m]
    stiffness: NDArray[np.float64]  # (n, 6, 6)
    mass: NDArray[np.float64]  # (n,) [kg/m]
    lump: float  # [kg]
    lump_at: float  # [m]
    support: Support | None

    def water(self, z: NDArray[np.float64]) -> NDArray[np.float64] | float:
        """Mass per length of the water that moves along [kg/m], at distances from the foot (n,) [m]."""
        return 0.0 if self.support is None else np.where(z <= self.lump_at, self.support.added_mass_at(z), 0.0)

    def base(self, axis: int) -> tuple[tuple[float, float], tuple[float, float]]:
        """Shift [m] and turn [rad] of the foot under a unit force at the top, and under a unit moment."""
        if self.support is None or self.support.foundation is None:
            return (0.0, 0.0), (0.0, 0.0)
        move, sign = (0, 1.0) if axis == 4 else (1, -1.0)  # a push along y turns the foot about -x
        spring = self.support.foundation[np.ix_([move, axis], [move, axis])]
        by_force = np.linalg.solve(spring, [1.0, sign * self.station[-1]])
        by_moment = np.linalg.solve(spring, [0.0, sign])
        return (float(by_force[0]), sign * float(by_force[1])), (float(by_moment[0]), sign * float(by_moment[1]))


def _column(tower: Tower) -> _Column:
    table, support = tower.structure, tower.support
    if support is None:
        return _Column(table.station, table.stiffness, table.inertia[:, 0, 0], 0.0, 0.0, None)
    below = support.structure
    return _Column(
        np.concatenate([below.station, support.length + table.station]),
        np.concatenate([below.stiffness, table.stiffness]),
        np.concatenate([below.inertia[:, 0, 0], table.inertia[:, 0, 0]]),
        support.top_mass,
        support.length,
        support,
    )


def _integral(values: NDArray[np.float64], step: float) -> NDArray[np.float64]:
    """Integral from the start by the trapezoidal rule, shape of the values."""
    return np.concatenate(([0.0], np.cumsum(0.5 * step * (values[1:] + values[:-1]))))
