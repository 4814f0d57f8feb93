"""Ice on one blade: a mass at its leading edge, less lift and more drag.

The mass per length is that of the GL guideline for the certification of wind turbines (Germanischer Lloyd, edition
2010, chapter 4, ice load on rotor blades): it rises in a straight line from the rotor axis to

    mu_E = rho_E k c_min (c_max + c_min),   k = 0.00675 + 0.3 exp(-0.32 R / 1 m),   rho_E = 700 kg/m^3

at half the radius R and stays there up to the tip; c_max is the largest chord and c_min that of the tip, to which the
contour is continued in a straight line. The coefficients of the sections change over the span as the mass does: at
the full value lift falls by 30 % and drag doubles. Published losses of iced sections lie about these: 30 % of the lift
and 50 % more drag (Zanon, De Gennaro and Kuehnelt, Renewable Energy 115 (2018) 760, NREL 5-MW), 35 % and 97 % for
glaze ice (Energies 18 (2025) 3448).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from wt_gym.turbines.beam import BeamStations, inertia_matrix
from wt_gym.turbines.checks import check_number, fail

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from wt_gym.turbines.blade import Blade

__all__ = ["BladeIce", "ice_mass", "iced_polar", "iced_structure", "spread"]

LIFT_LOSS, MORE_DRAG = 0.3, 1.0
"""Share of the lift that is lost and of the drag that is added under full ice [-]."""
_DENSITY = 700.0
_TIP = (0.7, 0.9)
"""Shares of the length through whose chords the line to the chord of the tip goes."""


@dataclass(frozen=True)
class BladeIce:
    """Ice on one blade of a turbine.

    Attributes
    ----------
    blade : int
        From 1 on.
    level : float
        Mass, loss of lift and drag over those of full ice [-].
    """

    blade: int
    level: float

    def __post_init__(self) -> None:
        if isinstance(self.blade, bool) or not isinstance(self.blade, int) or self.blade < 1:
            raise fail("BladeIce.blade", self.blade, "a whole number from 1 on")
        check_number("BladeIce.level", self.level, 0.0, 2.0, open_low=True)


def spread(blade: Blade, z: NDArray[np.float64]) -> NDArray[np.float64]:
    """Share of the full value at distances from the root along z [m]: from 0 at the axis to 1 at half the radius."""
    tip = blade.root_radius + blade.length
    share: NDArray[np.float64] = np.minimum(2.0 * (blade.root_radius + z) / tip, 1.0)
    return share


def ice_mass(blade: Blade) -> float:
    """Mass of full ice per length in the outer half of a blade, mu_E [kg/m]."""
    inner, outer = blade.chord_at(np.array(_TIP) * blade.length)
    tip = max(float(outer + (1.0 - _TIP[1]) / (_TIP[1] - _TIP[0]) * (outer - inner)), 0.0)
    k = 0.00675 + 0.3 * math.exp(-0.32 * (blade.root_radius + blade.length))
    return float(_DENSITY * k * tip * (blade.chord.max() + tip))


def iced_structure(blade: Blade, level: float) -> BeamStations:
    """Sections of a blade with ice at the leading edge; arguments as of `BladeIce`."""
    beam = blade.structure
    z = np.interp(beam.station, blade.axis_station, blade.axis[:, 2])
    mass = level * ice_mass(blade) * spread(blade, z)
    ahead, twist = blade.le_offset_at(z) * blade.chord_at(z), blade.twist_at(z)
    # the leading edge lies at -ahead along the chord, which the twist turns by minus itself about z
    x, y = -ahead * np.sin(twist), -ahead * np.cos(twist)
    ice = inertia_matrix(mass, x, y, mass * y**2, mass * x**2, mass * x * y)
    return replace(beam, inertia=beam.inertia + ice)


def iced_polar(polar: NDArray[np.float64], share: float) -> NDArray[np.float64]:
    """Polar (n, 3) of lift, drag and moment with a share of full ice [-]."""
    factors = np.array([1.0 - LIFT_LOSS * share, 1.0 + MORE_DRAG * share, 1.0 - LIFT_LOSS * share])
    iced: NDArray[np.float64] = polar * factors
    return iced
