"""How far the blades of an unloaded turbine pass from its tower."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from wt_gym.turbines.model import Turbine

__all__ = ["unloaded_clearance"]


def unloaded_clearance(turbine: Turbine) -> float:
    """Distance of the tip of an undeformed blade from the tower's surface, where it passes it at zero pitch [m].

    The tip, on the blade's axis, lies at the prebend ``p`` (negative upwind), the sweep ``s`` and the distance
    ``R`` from the rotor's apex along the blade. With cone ``c`` it is ``a = p cos c - R sin c`` downwind of the apex
    along the shaft, on a circle of the radius ``q = hypot(s, p sin c + R cos c)``. The apex is the overhang ``h``
    upwind of the tower's axis along a shaft of tilt ``t``, which crosses that axis ``d`` above the tower's top. At the
    lowest point of its circle, in front of the tower's axis, the tip is therefore

        x = (h - a) cos t + q sin t             upwind of the axis,
        z = d + (h - a) sin t - q cos t         above the tower's top

    (rotations about y by tilt and cone; OpenFAST has the same angles, ElastoDyn's ``ShftTilt`` and ``PreCone`` with the
    other sign). The tower stands upright and is cut at the height of the tip: that its wall leans is neglected (for 1°
    an error of 0.02 %). A tip above the tower's top is measured to its rim, one below the tower's base to the base's
    diameter, as the simulator does (`wt_gym.simulation.step.coupling_kernels.signed_clearance`).

    Parameters
    ----------
    turbine : Turbine

    Returns
    -------
    float
        [m]

    Examples
    --------
    >>> from wt_gym.turbines import load_turbine
    >>> round(unloaded_clearance(load_turbine("nrel_5mw")), 1)
    10.6
    """
    nacelle, tower, blade, cone = turbine.nacelle, turbine.tower, turbine.blade, turbine.hub.cone
    prebend, sweep, length = blade.axis_at(blade.length)
    reach = blade.root_radius + length
    ahead = nacelle.overhang - (prebend * math.cos(cone) - reach * math.sin(cone))
    circle = math.hypot(sweep, prebend * math.sin(cone) + reach * math.cos(cone))
    upwind = ahead * math.cos(nacelle.tilt) + circle * math.sin(nacelle.tilt)
    above = nacelle.tower_top_to_shaft + ahead * math.sin(nacelle.tilt) - circle * math.cos(nacelle.tilt)
    station = min(max(tower.length + above, 0.0), tower.length)
    gap = float(upwind - 0.5 * tower.diameter_at(station))
    return math.hypot(max(gap, 0.0), above) if above > 0.0 else gap
