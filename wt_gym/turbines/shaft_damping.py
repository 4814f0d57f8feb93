"""Damping of the shaft's torsion by the converter, and the inertias that swing against each other.

The rotor J_r and the geared generator J_g = N^2 J_hss turn against each other on the spring k of the shaft with
omega^2 = k (1/J_r + 1/J_g). A torque c (Omega_g - mean) that the converter adds brakes the generator's part of this
motion: with the mode (-J_g, J_r)/(J_r + J_g) of unit twist and its mass mu = J_r J_g/(J_r + J_g) it adds the damping
ratio

    zeta = c (J_r/(J_r + J_g))^2 / (2 omega mu),   so that   c = 2 zeta omega J_g (J_r + J_g)/J_r.

Industry's controllers add such a torque at the frequency of the shaft to the demand (Burton, Jenkins, Sharpe and
Bossanyi, Wind Energy Handbook, 2nd ed. 2011, section 8.3.6).
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from wt_gym.turbines.checks import check_number
from wt_gym.turbines.shaft_damper import STRONGEST, ShaftDamper

if TYPE_CHECKING:
    from wt_gym.turbines.blade import Blade
    from wt_gym.turbines.model import Hub, Turbine

__all__ = ["rotor_inertia_without_generator", "shaft_damper_of"]


def shaft_damper_of(turbine: Turbine, damping_ratio: float) -> ShaftDamper:
    """Damper that adds a damping ratio to the torsion of a turbine's shaft, its blades taken as rigid.

    Parameters
    ----------
    turbine : Turbine
    damping_ratio : float
        zeta, at most `STRONGEST` [-].

    Raises
    ------
    TurbineDefinitionError
        If the ratio is out of range.
    """
    check_number("damping_ratio of a ShaftDamper", damping_ratio, 0.0, STRONGEST, open_low=True)
    drivetrain = turbine.drivetrain
    rotor = rotor_inertia_without_generator(turbine.blade, turbine.hub, turbine.n_blades)
    generator = drivetrain.generator_inertia * drivetrain.gear_ratio**2
    frequency = math.sqrt(drivetrain.spring * (1.0 / rotor + 1.0 / generator))
    return ShaftDamper(2.0 * damping_ratio * frequency * generator * (rotor + generator) / rotor, frequency)


def rotor_inertia_without_generator(blade: Blade, hub: Hub, n_blades: int) -> float:
    """Inertia of straight, unconed blades and hub about the shaft [kg m^2].

    Parameters
    ----------
    blade : Blade
    hub : Hub
    n_blades : int
    """
    m0, m1, m2 = (blade.structure.mass_moment(k) for k in range(3))
    return float(n_blades * (m2 + 2.0 * hub.radius * m1 + hub.radius**2 * m0) + hub.inertia_axial)
