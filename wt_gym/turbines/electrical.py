"""Generator and converter beyond a torque that is there at once and one efficiency: lag, losses, damping of the shaft.

*Lag.* The converter controls the currents, and with them the torque T, towards the demand T_d by a closed loop whose
lag is of first order: tau dT/dt = T_d - T. The current loops of full converters have bandwidths of tens to hundreds of
rad/s; reference turbines model the whole path from demand to torque by such a lag (DTU Wind Energy Controller: Hansen
and Henriksen, DTU Wind Energy E-0028, 2013). `Drivetrain.max_torque_rate` still limits the rate.

*Losses.* The difference between shaft power and electrical power, with the speed x and the torque t of the generator
over their rated values and the losses L at rated operation, is

    L [c t^2 + i (x + x^2) / 2 + k (1 + 10 t + 5 t^2 + 10 x t + 5 x^2 t^2) / 31],   c + i + k = 1:

copper losses with the square of the current and so of the torque; iron losses of hysteresis and eddy currents, in
proportion to the frequency and to its square; converter losses, a part that is always there, one in proportion to the
current of generator and grid, and one with their squares (Polinder et al., IEEE Transactions on Energy Conversion 21,
2006, 725, sections II.C and II.D, for direct-drive and geared generators with full converters). The current of the grid
side is taken in proportion to the shaft power. L follows from the efficiency of the turbine's generator, which is that
at rated operation; a generator without torque is off and has no losses.

*Damping of the shaft.* See `wt_gym.turbines.shaft_damping` and `wt_gym.simulation.drivetrain.drives.DampingTorque`.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

from wt_gym.turbines.loss_shares import LONGEST_LAG, LossShares
from wt_gym.turbines.shaft_damping import shaft_damper_of

if TYPE_CHECKING:
    from wt_gym.turbines.model import Drivetrain, Turbine

__all__ = ["LONGEST_LAG", "LossShares", "electrical_power", "with_electrical"]


def electrical_power(drivetrain: Drivetrain, speed: float, torque: float) -> float:
    """Electrical power [W] of a generator with a map of losses.

    Parameters
    ----------
    drivetrain : Drivetrain
        With ``losses``.
    speed : float
        Of the generator, high-speed shaft [rad/s].
    torque : float
        [N m].
    """
    shares, efficiency = drivetrain.losses, drivetrain.generator_efficiency
    if shares is None:
        return speed * torque * efficiency
    if torque == 0.0:
        return 0.0
    shaft = drivetrain.rated_power / efficiency
    rated_speed = drivetrain.rated_rotor_speed * drivetrain.gear_ratio
    x, t = speed / rated_speed, torque * rated_speed / shaft
    p = x * t
    of_converter = (1.0 + 10.0 * t + 5.0 * t**2 + 10.0 * p + 5.0 * p**2) / 31.0
    losses = shares.copper * t**2 + 0.5 * shares.iron * (x + x**2) + shares.converter * of_converter
    return shaft * (p - (1.0 - efficiency) * losses)


def with_electrical(
    turbine: Turbine, torque_lag: float = 0.0, losses: LossShares | None = None, shaft_damping: float = 0.0
) -> Turbine:
    """Return a turbine with a lag of the generator torque, a map of losses, a damper; without any the turbine itself.

    Parameters
    ----------
    turbine : Turbine
    torque_lag : float
        tau [s]; 0: as the turbine has it.
    losses : LossShares, optional
        By default as the turbine has them.
    shaft_damping : float
        Damping ratio that the converter adds to the torsion of the shaft; 0: as the turbine has it [-].

    Raises
    ------
    TurbineDefinitionError
        If a value is out of range, or the generator takes no torque.
    """
    given: dict[str, Any] = {}
    if torque_lag != 0.0:
        given["torque_lag"] = torque_lag
    if losses is not None:
        given["losses"] = losses
    if shaft_damping != 0.0:
        given["shaft_damper"] = shaft_damper_of(turbine, shaft_damping)
    return replace(turbine, drivetrain=replace(turbine.drivetrain, **given)) if given else turbine
