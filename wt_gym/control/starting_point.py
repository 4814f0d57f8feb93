"""Where a turbine starts in a wind, operation or not: below cut-in, in still air, in a wind that changes."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from wt_gym.control.operating_point import OperatingPoint, operating_point
from wt_gym.wind.inflow import start_speed

if TYPE_CHECKING:
    from wt_gym.turbines import Turbine
    from wt_gym.wind import Inflow

__all__ = ["starting_point"]


def starting_point(turbine: Turbine, inflow: Inflow) -> OperatingPoint:
    """State of a turbine at the start of a simulation: the operating point of the wind's speed at time zero.

    Below cut-in the rotor turns as at cut-in, without torque. Above cut-out, where a schedule may end, the pitch is at
    least what the slope of the schedule below cut-out gives.

    Parameters
    ----------
    turbine : Turbine
    inflow : Inflow
    """
    speed = start_speed(inflow)
    if speed > turbine.cut_out:
        return _beyond_cut_out(turbine, speed)
    if speed >= turbine.cut_in:
        return operating_point(turbine, speed)
    return replace(operating_point(turbine, max(turbine.cut_in, 0.1)), generator_torque=0.0)


def _beyond_cut_out(turbine: Turbine, speed: float) -> OperatingPoint:
    """Operating point with the pitch of a schedule that is extrapolated linearly."""
    point, before = operating_point(turbine, speed), 0.95 * turbine.cut_out
    last, earlier = operating_point(turbine, turbine.cut_out).pitch, operating_point(turbine, before).pitch
    pitch = last + (last - earlier) * (speed - turbine.cut_out) / (turbine.cut_out - before)
    return replace(point, pitch=min(max(point.pitch, pitch), turbine.pitch.max_pitch))
