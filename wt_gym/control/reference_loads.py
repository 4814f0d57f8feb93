"""Loads of the Betz thrust at rated wind: what rewards, observations and controllers measure moments by."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from wt_gym.turbines import Turbine

__all__ = ["reference_flap_moment", "reference_tower_moment"]


def reference_flap_moment(turbine: Turbine) -> float:
    """Root moment of a blade that carries its share of the Betz thrust at rated wind at 2/3 of the radius [N m].

    12.4 MN m for the NREL 5-MW, whose mean flapwise moment at rated is about 10 MN m.
    """
    radius = turbine.rotor_diameter / 2
    dynamic_pressure = 0.5 * turbine.air_density * turbine.rated_wind_speed**2
    thrust = 8 / 9 * dynamic_pressure * math.pi * radius**2
    return thrust / turbine.n_blades * 2 / 3 * radius


def reference_tower_moment(turbine: Turbine) -> float:
    """Tower-base moment of the Betz thrust at rated wind [N m]."""
    thrust = reference_flap_moment(turbine) * turbine.n_blades / (turbine.rotor_diameter / 3)
    return thrust * turbine.hub_height
