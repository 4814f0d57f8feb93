"""Where a turbine starts in a wind, operation or not: below cut-in, in still air, in a wind that changes."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from wt_gym.control.operating_point import OperatingPoint, operating_point
from wt_gym.wind.protocol import start_speed

if TYPE_CHECKING:
    from wt_gym.turbines import Turbine
    from wt_gym.wind import Inflow

__all__ = ["starting_point"]


def starting_point(turbine: Turbine, inflow: Inflow) -> OperatingPoint:
    """State of a turbine at the start of a simulation: the operating point of the wind's speed at time zero.

    Below cut-in the rotor turns as at cut-in, without torque; what the wind and the controller make of it follows.

    Parameters
    ----------
    turbine : Turbine
    inflow : Inflow
    """
    speed = start_speed(inflow)
    if speed >= turbine.cut_in:
        return operating_point(turbine, speed)
    return replace(operating_point(turbine, max(turbine.cut_in, 0.1)), generator_torque=0.0)
