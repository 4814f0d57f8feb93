"""The closed bodies of a turbine in the flow: tower, and hub and nacelle together."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from wt_gym.aerodynamics import AerodynamicsError, BodySet, revolution_body, tower_body
from wt_gym.base.errors import SimulationError

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from wt_gym.aerodynamics import BodySurface
    from wt_gym.simulation.fidelity import Fidelity
    from wt_gym.turbines import Turbine

__all__ = ["NACELLE", "nacelle_surface", "place_nacelle", "turbine_bodies"]

NACELLE = "nacelle"
"""Name of the body of hub and nacelle."""
SLENDERNESS = 0.75
"""Radius of the body of hub and nacelle over the hub radius: the blade roots and their vortices pass outside."""
ROOT_GAP = 0.05
"""Least distance of that body from the lattice of the blades, in hub radii: room for side-side deflections."""
TOWER_GAP = 0.25
"""Least distance of that body from the top of the tower, in radii of the body."""
HEADING_STEP = math.radians(0.25)
"""The body is turned in steps of this angle [rad]; the influence of all bodies is inverted again at each."""


def turbine_bodies(turbine: Turbine, fidelity: Fidelity, nodes: NDArray[np.float64]) -> BodySet | None:
    """Closed bodies that a fidelity puts into the flow, with the nacelle at zero yaw.

    Parameters
    ----------
    turbine : Turbine
    fidelity : Fidelity
    nodes : array (..., 3)
        Lattice nodes of an undeformed blade in the blade frame [m].

    Returns
    -------
    BodySet or None

    Raises
    ------
    SimulationError
        If the bodies cannot be built, or would intersect the blades or each other.
    """
    if fidelity.tower_body is None and fidelity.nacelle_body is None:
        return None
    tower, ground, surfaces = turbine.tower, fidelity.aero.ground_height, []
    base, top = np.array([0.0, 0.0, tower.base_height]), np.array([0.0, 0.0, tower.height])
    try:
        nacelle = None
        if fidelity.nacelle_body is not None:
            nacelle = nacelle_surface(turbine, *fidelity.nacelle_body)
            _check_blades(turbine, nacelle, nodes)
        if fidelity.tower_body is not None:
            if nacelle is not None:
                top[2] = _free_height(turbine, nacelle)
            around, along = fidelity.tower_body
            surfaces.append(tower_body(tower.diameter_station, tower.diameter, base, top, around, along, ground=ground))
        if nacelle is not None:
            surfaces.append(nacelle)
        return BodySet(surfaces, ground)
    except AerodynamicsError as error:
        raise SimulationError(f"the bodies of {turbine.name} cannot stand in the flow: {error}") from error


def nacelle_surface(turbine: Turbine, n_around: int, n_along: int) -> BodySurface:
    """Hub and nacelle as one body of revolution about the shaft, which the rotation of the hub leaves as it is.

    A turbine gives no shape of its nacelle. The body has three quarters of the hub radius throughout, less than most
    nacelles, so that the root vortices pass outside. Its nose is half an ellipsoid, one hub radius long upwind of the
    apex. Its tail is half a ball that ends as far downwind of the nacelle's center of mass as the back of the hub, one
    hub radius downwind of the apex, lies upwind of it; at least a tower-top radius downwind of the yaw axis, and at
    least three hub radii behind the nose.

    Parameters
    ----------
    turbine : Turbine
    n_around, n_along : int
        Panels; those along are shorter at the ends.

    Returns
    -------
    BodySurface
        In global coordinates, for zero yaw and an undeformed tower.

    Raises
    ------
    SimulationError
        If the hub has no radius.
    """
    hub, nacelle, tower = turbine.hub, turbine.nacelle, turbine.tower
    if not hub.radius > 0.0:
        raise SimulationError(
            f"Fidelity.nacelle_body needs a hub with a radius; that of {turbine.name} is {hub.radius}"
        )
    radius = SLENDERNESS * hub.radius
    front = -nacelle.overhang - hub.radius
    back = max(2.0 * nacelle.cm[0] + nacelle.overhang - hub.radius, 0.5 * tower.diameter[-1], front + 3.0 * hub.radius)
    along = front + 0.5 * (back - front) * (1.0 - np.cos(np.linspace(0.0, np.pi, n_along + 1)))
    nose = np.clip((front + hub.radius - along) / hub.radius, 0.0, 1.0)
    tail = np.clip((along - back + radius) / radius, 0.0, 1.0)
    radii = radius * np.sqrt(np.maximum(1.0 - nose**2 - tail**2, 0.0))
    radii[[0, -1]] = 0.0
    return revolution_body(along, radii, n_around, _shaft_on_yaw_axis(turbine), _shaft(turbine), NACELLE)


def place_nacelle(bodies: BodySet | None, rotation: NDArray[np.float64], angular_velocity: NDArray[np.float64]) -> None:
    """Turn the body of hub and nacelle, if there is one, to the heading of the nacelle, in steps of `HEADING_STEP`.

    Parameters
    ----------
    bodies : BodySet or None
    rotation : array (3, 3)
        From nacelle axes to global ones.
    angular_velocity : array (3,)
        Of the nacelle, global [rad/s]; the rate of the heading moves the surface.
    """
    if bodies is None or NACELLE not in bodies.names:
        return
    heading = HEADING_STEP * round(math.atan2(rotation[1, 0], rotation[0, 0]) / HEADING_STEP)
    n, b = len(bodies.names), bodies.names.index(NACELLE)
    rotations, spins = np.tile(np.eye(3), (n, 1, 1)), np.zeros((n, 3))
    c, s = math.cos(heading), math.sin(heading)
    rotations[b, :2, :2] = (c, -s), (s, c)
    spins[b, 2] = angular_velocity[2]
    bodies.place(rotations, np.zeros((n, 3)), None, spins)


def _shaft(turbine: Turbine) -> NDArray[np.float64]:
    """Unit vector along the shaft, downwind, at zero yaw."""
    tilt = turbine.nacelle.tilt
    return np.array([math.cos(tilt), 0.0, -math.sin(tilt)])


def _shaft_on_yaw_axis(turbine: Turbine) -> NDArray[np.float64]:
    return np.array([0.0, 0.0, turbine.tower.height + turbine.nacelle.tower_top_to_shaft])


def _check_blades(turbine: Turbine, surface: BodySurface, nodes: NDArray[np.float64]) -> None:
    """Refuse a body that comes close to the lattice of the blades at any pitch."""
    hub, x = turbine.hub, np.reshape(nodes, (-1, 3))
    outward = (hub.radius + x[:, 2]) * math.cos(hub.cone)
    least = float((outward - np.hypot(x[:, 0], x[:, 1]) * abs(math.sin(hub.cone))).min())
    arms = surface.vertices - _shaft_on_yaw_axis(turbine)
    widest = float(np.linalg.norm(np.cross(arms, _shaft(turbine)), axis=1).max())
    if widest > least - ROOT_GAP * hub.radius:
        raise SimulationError(
            f"Fidelity.nacelle_body of {turbine.name}: the body reaches {widest:.3f} m from the shaft, the blade roots "
            f"come to {least:.3f} m; the gap must be at least {ROOT_GAP * hub.radius:.3f} m"
        )


def _free_height(turbine: Turbine, surface: BodySurface) -> float:
    """Height at which the body of the tower ends below that of the nacelle, whatever the yaw [m]."""
    tower, hub, shaft = turbine.tower, turbine.hub, _shaft(turbine)
    arms = surface.vertices - _shaft_on_yaw_axis(turbine)
    widest = float(np.linalg.norm(np.cross(arms, shaft), axis=1).max())
    # the lower side of a cylinder, over the disc on which the tower ends
    lowest = tower.height + turbine.nacelle.tower_top_to_shaft
    lowest -= widest / shaft[0] + 0.5 * tower.diameter[-1] * abs(shaft[2] / shaft[0])
    height = min(tower.height, lowest - TOWER_GAP * SLENDERNESS * hub.radius)
    if not height > tower.base_height:
        raise SimulationError(
            f"Fidelity.nacelle_body of {turbine.name}: the body reaches down to {lowest:.3f} m and leaves no tower body"
        )
    return float(height)
