"""The collective edgewise mode: all blades against hub and generator, as a speed controller meets it.

Where hub and generator are light, the hub swings far in this mode and the measured speed with it. A pitch loop that
answers feeds the mode, since filter, drive and time step turn its phase by more than half a turn there.

One assumed shape w(s) along the blade, its deflection under the inertial load m(s) r(s) of an accelerating rotor, gives
the clamped frequency by Rayleigh's quotient and, with the speed of the rigid rotor as second coordinate,

``J a + P q" = T``, ``P a + M (q" + 2 zeta w_e q' + w_e^2 q) = kappa T``

with ``M = n int m w^2 ds``, ``P = n int m r w ds`` and ``kappa = int w r^2 ds / int r^3 ds`` for a torque that grows
with r^2 along the blade. Blade and hub then swing with ``w_r = w_e / sqrt(1 - P^2 / (J M))``.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.integrate import cumulative_trapezoid

from wt_gym.control.operating_point import rotor_inertia

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from wt_gym.turbines import Turbine

__all__ = ["DriveMode", "drive_mode"]


@dataclass(frozen=True)
class DriveMode:
    """The mode of a free rotor.

    Attributes
    ----------
    frequency : float
        Of all blades against hub and generator [rad/s].
    clamped_frequency : float
        Of a blade on a hub that is held [rad/s].
    response : float
        Amplitude of the hub's acceleration at ``frequency`` with a unit of damping, over that of a rigid rotor [-].
    damping_ratio : float
        Of the blade's material [-].
    """

    frequency: float
    clamped_frequency: float
    response: float
    damping_ratio: float

    def amplification(self) -> float:
        """Amplitude of the speed at the mode's frequency over that of a rigid rotor under the same torque [-].

        Damped by the material alone: the air damps edgewise motion little, and feeds it near stall.
        """
        damping = 2.0 * self.damping_ratio * self.clamped_frequency * self.frequency
        return self.response / damping if damping > 0.0 else math.inf


def drive_mode(turbine: Turbine) -> DriveMode:
    """Collective edgewise mode of a turbine at rest, with a stiff shaft."""
    blade, n = turbine.blade, turbine.n_blades
    s, mass = blade.structure.station, blade.structure.inertia[:, 0, 0]
    r = (blade.root_radius + s) * math.cos(turbine.hub.cone)
    load = mass * r
    shape = _deflection(s, load, blade.structure.stiffness[:, 3, 3])
    clamped_squared = np.trapezoid(load * shape, s) / np.trapezoid(mass * shape**2, s)
    modal_mass, shared = n * np.trapezoid(mass * shape**2, s), n * np.trapezoid(load * shape, s)
    squared = clamped_squared / (1.0 - shared**2 / (rotor_inertia(turbine) * modal_mass))
    blade_share = np.trapezoid(shape * r**2, s) / np.trapezoid(r**3, s)
    response = abs(clamped_squared - squared + squared * shared * blade_share / modal_mass)
    return DriveMode(math.sqrt(squared), math.sqrt(clamped_squared), float(response), blade.damping_ratio)


def _deflection(
    s: NDArray[np.float64], load: NDArray[np.float64], bending_stiffness: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Deflection of a cantilever under a distributed load [N/m]: the load integrated four times."""
    shear = _from_tip(s, load)
    return _from_root(s, _from_root(s, _from_tip(s, shear) / bending_stiffness))


def _from_root(s: NDArray[np.float64], y: NDArray[np.float64]) -> NDArray[np.float64]:
    out: NDArray[np.float64] = cumulative_trapezoid(y, s, initial=0.0)
    return out


def _from_tip(s: NDArray[np.float64], y: NDArray[np.float64]) -> NDArray[np.float64]:
    whole = _from_root(s, y)
    out: NDArray[np.float64] = whole[-1] - whole
    return out
