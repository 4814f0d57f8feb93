"""The baseline controller with a region-2 gain that fits the turbine as simulated.

The published gain belongs to the rotor of blade-element momentum theory. The lattice's rotor has its best power at a
higher tip-speed ratio, so that a smaller gain makes more power. `FOUND` holds the multiple of the published gain that
made the most power in coupled runs (the turbine's record); docs/baselines.md says how it was found. It belongs to the
rotor and its drive train, whatever tower or monopile these stand on. Any other turbine gets the gain of the optimum
of its own table, ``rho pi R^5 Cp / (2 lambda^3 N^3)`` times the gearbox efficiency.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

from wt_gym.control.controllers.discon import BaselineParameters, DisconController
from wt_gym.control.controllers.own import own_controller
from wt_gym.control.controllers.parameters import Parameter
from wt_gym.control.controllers.rotor_rules import same_rotor
from wt_gym.control.operating_point import design_point, tracks_tip_speed_ratio
from wt_gym.control.rotor_table import RotorTable, rotor_table
from wt_gym.control.speed_loop import check_speed_loop
from wt_gym.control.torque_loop import check_torque_curve
from wt_gym.turbine_records import RECORDS
from wt_gym.turbines import load_turbine

if TYPE_CHECKING:
    from wt_gym.control.controllers.controller import Controller
    from wt_gym.turbines import Turbine

__all__ = [
    "FOUND",
    "PARAMETERS",
    "found_factor",
    "gain_of_table",
    "retuned_controller",
    "retuned_parameters",
    "with_region_2_gain",
]

FOUND: dict[str, float] = {
    name: record.region_2_gain_factor for name, record in RECORDS.items() if record.region_2_gain_factor is not None
}
"""Multiple of the published region-2 gain, by the turbine of the catalogue with the rotor and drive train."""


def _factor(turbine: Turbine) -> float | None:
    """Factor that a turbine's controller has by default; None where the table of the turbine gives the gain."""
    return None if tracks_tip_speed_ratio(turbine) else found_factor(turbine)


PARAMETERS = (
    Parameter(
        "gain_factor",
        "-",
        "torque over speed squared below rated, in that of `discon`",
        0.0,
        above=True,
        otherwise="the optimum of the turbine's table",
        in_use=_factor,
    ),
)
"""What can be chosen (`wt_gym.control.controllers.parameters`)."""


def gain_of_table(turbine: Turbine, table: RotorTable) -> float:
    """Region-2 gain that holds a rotor at the optimum of its table [N m/(rad/s)^2, high-speed shaft]."""
    ratio, best = table.optimum
    drivetrain = turbine.drivetrain
    moment = 0.5 * turbine.controller_air_density * math.pi * table.radius**5 * best / ratio**3
    return moment * drivetrain.gearbox_efficiency / drivetrain.gear_ratio**3


def with_region_2_gain(parameters: BaselineParameters, gain: float) -> BaselineParameters:
    """Return constants with another region-2 gain [N m/(rad/s)^2]."""
    return replace(parameters, torque=replace(parameters.torque, region_2_gain=gain))


def found_factor(turbine: Turbine) -> float | None:
    """Multiple of the published region-2 gain that was found for the rotor and drive train of a turbine, if any.

    Parameters
    ----------
    turbine : Turbine
    """
    for name, factor in FOUND.items():
        if same_rotor(load_turbine(name), turbine):
            return factor
    return None


def retuned_parameters(turbine: Turbine, gain_factor: float | None = None) -> BaselineParameters:
    """Constants of the baseline controller with a region-2 gain for the turbine as simulated.

    Parameters
    ----------
    turbine : Turbine
    gain_factor : float, optional
        Multiple of the gain of `BaselineParameters.from_turbine`; by default what was found for this rotor, else what
        the table of the turbine gives.
    """
    parameters = BaselineParameters.from_turbine(turbine)
    factor = found_factor(turbine) if gain_factor is None else gain_factor
    if factor is None:
        return with_region_2_gain(parameters, gain_of_table(turbine, rotor_table(turbine)))
    return with_region_2_gain(parameters, factor * parameters.torque.region_2_gain)


def retuned_controller(turbine: Turbine, gain_factor: float | None = None) -> Controller:
    """The turbine's own controller with a torque below rated that fits the turbine as simulated.

    Where it tracks the tip-speed ratio, that ratio takes the place of the gain, which goes with its inverse cube: by
    default the optimum of the turbine's table.

    Parameters
    ----------
    turbine : Turbine
    gain_factor : float, optional
        As of `retuned_parameters`.
    """
    if not tracks_tip_speed_ratio(turbine):
        parameters = retuned_parameters(turbine, gain_factor)
        check_speed_loop(turbine, parameters)
        check_torque_curve(turbine, parameters)
        return DisconController(parameters)
    if gain_factor is None:
        return own_controller(turbine, tip_speed_ratio=rotor_table(turbine).optimum[0])
    return own_controller(turbine, tip_speed_ratio=design_point(turbine).tip_speed_ratio * gain_factor ** (-1 / 3))
