"""Masses, inertias and stiffnesses of hub, nacelle and drivetrain that a file leaves to be computed.

Masses follow the regressions of the NREL cost and scaling model in its revision of 2015, as WISDEM documents them
(Fingersh, Hand and Laxson, NREL/TP-500-40566, for the method; wisdem.readthedocs.io, NREL CSM, for the coefficients).
Inertias and the torsion of the shaft follow WISDEM's DrivetrainSE (Guo, Parsons, King, Dykes and Veers,
NREL/TP-5000-63008), except where a function says otherwise. Such numbers are good to some 20 %; what turns on them
most, the frequency of the tower, goes with the square root of the mass.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["Machine"]

_SHELL = 2.0 / 3.0
"""Inertia of a thin spherical shell about a diameter over mass times radius squared."""

GENERATOR_TIME_CONSTANT = 0.75
"""Kinetic energy of a geared generator at rated speed over rated power [s]."""


@dataclass(frozen=True)
class Machine:
    """What the regressions take.

    Attributes
    ----------
    rated_power : float
        [W].
    rated_speed : float
        Of the rotor [rad/s].
    gear_ratio : float
        1 for a direct drive.
    rotor_diameter, hub_diameter : float
        [m].
    n_blades : int
    blade_mass : float
        Of one blade [kg].
    """

    rated_power: float
    rated_speed: float
    gear_ratio: float
    rotor_diameter: float
    hub_diameter: float
    n_blades: int
    blade_mass: float

    @property
    def direct_drive(self) -> bool:
        """Whether there is no gearbox."""
        return self.gear_ratio <= 1.0

    @property
    def rotor_torque(self) -> float:
        """Rated torque of the rotor without losses [N m]."""
        return self.rated_power / self.rated_speed

    def hub_mass(self) -> float:
        """Return the mass of hub shell, pitch system and spinner [kg]."""
        shell = 2.3 * self.blade_mass + 1320.0
        bearings = 0.1295 * self.n_blades * self.blade_mass + 491.31
        pitch_system = bearings * (1.0 + 0.3280) + 555.0
        spinner = max(15.5 * self.rotor_diameter - 980.0, 0.0)  # below a rotor of 63 m the regression is negative
        return shell + pitch_system + spinner

    def hub_inertia(self, mass: float) -> float:
        """Return the inertia of a hub about any axis through its center, as a spherical shell [kg m^2]."""
        return _SHELL * mass * (0.5 * self.hub_diameter) ** 2

    def generator_mass(self) -> float:
        """Return the mass of the generator [kg].

        That of a direct drive is 18.5 kg per kN m of rated torque, in between those of the IEA 15-MW (19.6; 371.6 t)
        and the IEA 22-MW turbine (17.3; 508 t): the regression of the cost model, 37.7, is of machines of 2005.
        """
        if self.direct_drive:
            return 18.5e-3 * self.rotor_torque
        return 2.3e-3 * self.rated_power + 3400.0

    def generator_inertia(self, mass: float, radius: float | None) -> float:
        """Return the inertia of the generator's rotor about the high-speed shaft [kg m^2].

        That of a direct drive is a disk of half the generator's mass (DrivetrainSE). That of a geared machine stores
        0.75 s of rated power at rated speed, in between the NREL 5-MW (0.81 s: 534.1 kg m^2 at 1173.7 rpm,
        NREL/TP-500-38060) and the WindPACT 1.5-MW turbine (0.63 s: 53.04 kg m^2 at 1800 rpm, NREL/SR-500-32495); the
        disk of DrivetrainSE stores several times as much.

        Parameters
        ----------
        mass : float
            Of the generator [kg].
        radius : float or None
            Of the generator of a direct drive [m]; by default 0.75 % of the rotor diameter, as in DrivetrainSE.
        """
        if self.direct_drive:
            radius = 0.0075 * self.rotor_diameter if radius is None else radius
            return 0.25 * mass * radius**2
        return 2.0 * GENERATOR_TIME_CONSTANT * self.rated_power / (self.rated_speed * self.gear_ratio) ** 2

    def nacelle_mass(self, generator_mass: float) -> float:
        """Return the mass of all that stands on the yaw bearing but the rotor, without the yaw system [kg].

        A direct drive has no shaft, gearbox or fast shaft of its own: its hub turns on the bearings of its generator.
        """
        kilowatt, diameter = 1e-3 * self.rated_power, self.rotor_diameter
        shaft = 0.0 if self.direct_drive else 13.0 * (self.blade_mass * kilowatt * 1e-3) ** 0.65 + 775.0
        bearings = 2.0 * 0.0001 * diameter**3.5
        gearbox = 0.0 if self.direct_drive else self.rotor_torque / 200.0
        fast_shaft = 0.0 if self.direct_drive else 0.19894 * kilowatt
        brake = 0.00122 * self.rotor_torque
        bedplate = diameter**2.2
        cooling = 0.08 * kilowatt
        cover = 1.2817 * kilowatt + 428.19
        platforms = 0.125 * bedplate
        transformer = 1.9150 * kilowatt + 1910.0
        parts = (shaft, bearings, gearbox, fast_shaft, brake, generator_mass, bedplate, cooling, cover, platforms)
        return float(sum(parts)) + transformer

    def yaw_mass(self) -> float:
        """Return the mass of the yaw system [kg]."""
        return float(1.5 * 0.0009 * self.rotor_diameter**3.314)

    def nacelle_center(self, overhang: float, shaft_height: float) -> NDArray[np.float64]:
        """Return the center of mass of a nacelle from the tower top (3,) [m].

        No published rule gives it. A geared machine has it a fifth of the overhang behind the yaw axis, in between the
        NREL 5-MW (0.38) and the NREL 2.8-127 (0.0) turbines; a direct drive, whose generator hangs before the tower,
        0.45 of the overhang before it, in between the IEA 15-MW (0.43) and IEA 22-MW (0.47). Its height is three
        quarters of the hub's, in between 0.5 and 0.81 of these four.
        """
        x = -0.45 * overhang if self.direct_drive else 0.2 * overhang
        return np.array([x, 0.0, 0.75 * shaft_height])

    def nacelle_inertia(self, mass: float) -> NDArray[np.float64]:
        """Return the inertia of a nacelle about its center of mass (3, 3) [kg m^2].

        Radii of gyration of 0.017 rotor diameters in pitch and yaw and 0.012 in roll: the means of the NREL 5-MW, NREL
        2.8-127, IEA 15-MW and IEA 22-MW turbines (0.010 to 0.021). The rotor has some twenty times as much.
        """
        return mass * self.rotor_diameter**2 * np.diag([0.012**2, 0.017**2, 0.017**2])

    def shaft_damping(self, stiffness: float, damping_ratio: float, rotor_inertia: float) -> float:
        """Return the damping of the shaft's torsion [N m s/rad], from a fraction of critical as in DrivetrainSE.

        Critical is 2 sqrt(k I) with the inertia I of the rotor.

        Parameters
        ----------
        stiffness : float
            Seen from the low-speed shaft [N m/rad].
        damping_ratio : float
            [-].
        rotor_inertia : float
            Of blades and hub about the shaft [kg m^2].
        """
        return 2.0 * damping_ratio * float(np.sqrt(stiffness * rotor_inertia))


def shaft_stiffness(diameter: float, thickness: float, length: float, shear_modulus: float) -> float:
    """Return the torsional stiffness G J / L of a hollow shaft [N m/rad].

    Parameters
    ----------
    diameter, thickness, length : float
        Outer diameter, wall thickness and length [m].
    shear_modulus : float
        [Pa].
    """
    inner = max(diameter - 2.0 * thickness, 0.0)
    return shear_modulus * np.pi / 32.0 * (diameter**4 - inner**4) / length
