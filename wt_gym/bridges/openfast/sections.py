"""Blade and tower of a turbine as ElastoDyn has them: beams that bend in two planes and do nothing else."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from wt_gym.base.constants import GRAVITY
from wt_gym.base.errors import TurbineDefinitionError
from wt_gym.bridges.openfast.mode_shapes import TopBody, bending_shapes

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from wt_gym.turbines import BeamStations, Turbine

__all__ = ["BladeSections", "TowerSections", "blade_sections", "tower_sections"]

_EVEN = 0.02
"""Difference of both bending stiffnesses, over their mean, below which a section has no axes of its own."""
_MOST_STATIONS = 60


@dataclass(frozen=True)
class BladeSections:
    """ElastoDyn's blade.

    Attributes
    ----------
    fraction : ndarray (n,)
        Along the blade, from 0 to 1 (BlFract).
    twist : ndarray (n,)
        Of the axes of bending [rad] (StrcTwst).
    mass, flap, edge : ndarray (n,)
        [kg/m], [N m²], [N m²].
    flap_shapes : ndarray (2, 5)
    edge_shape : ndarray (5,)
    frequencies : ndarray (3,)
        Flap 1, flap 2, edge 1 of the blade without twist, turning at rated speed [Hz].
    """

    fraction: NDArray[np.float64]
    twist: NDArray[np.float64]
    mass: NDArray[np.float64]
    flap: NDArray[np.float64]
    edge: NDArray[np.float64]
    flap_shapes: NDArray[np.float64]
    edge_shape: NDArray[np.float64]
    frequencies: NDArray[np.float64]


@dataclass(frozen=True)
class TowerSections:
    """ElastoDyn's tower.

    Attributes
    ----------
    fraction : ndarray (n,)
        From the base to the top, 0 to 1 (HtFract).
    mass, fore_aft, side_side : ndarray (n,)
        [kg/m], [N m²], [N m²].
    fore_aft_shapes, side_side_shapes : ndarray (2, 5)
    frequencies : ndarray (4,)
        Fore-aft 1, 2 and side-side 1, 2 under a rigid rotor and nacelle [Hz].
    """

    fraction: NDArray[np.float64]
    mass: NDArray[np.float64]
    fore_aft: NDArray[np.float64]
    side_side: NDArray[np.float64]
    fore_aft_shapes: NDArray[np.float64]
    side_side_shapes: NDArray[np.float64]
    frequencies: NDArray[np.float64]


def blade_sections(turbine: Turbine) -> BladeSections:
    """Sections and mode shapes of the blade.

    The bending stiffness is that of a section on which neither an axial force nor a torque acts; its principal axes
    give the structural twist. Mass and stiffness of a curved blade are laid out along z: the mass is kept, the twist
    and the offsets of the centers of mass are lost.
    """
    blade = turbine.blade
    z = _thinned(np.interp(blade.structure.station, blade.axis_station, blade.axis[:, 2]), blade.length)
    station = np.interp(z, blade.axis[:, 2], blade.axis_station)
    stretch = np.gradient(station, z)
    mass = blade.structure.inertia_at(station)[:, 0, 0] * stretch
    flap, edge, twist = _principal(bending_matrices(blade.structure, station), blade.twist_at(z))
    radius, speed = turbine.hub.radius + z, turbine.drivetrain.rated_rotor_speed
    outboard = _from_the_end(z, mass * radius)
    shapes, flaps = bending_shapes(z, mass, flap, 2, pull=speed**2 * outboard)
    edges, edge_1 = bending_shapes(z, mass, edge, 1, pull=speed**2 * outboard)
    in_plane = np.sqrt(max(edge_1[0] ** 2 - (speed / (2.0 * np.pi)) ** 2, 0.0))  # the centrifugal force softens it
    return BladeSections(z / blade.length, twist, mass, flap, edge, shapes, edges[0], np.array([*flaps, in_plane]))


def tower_sections(turbine: Turbine) -> TowerSections:
    """Sections and mode shapes of the tower, under the weight of what stands on it.

    Raises
    ------
    TurbineDefinitionError
        If the tower stands on a monopile, for which ElastoDyn alone has no model.
    """
    tower = turbine.tower
    if tower.support is not None:
        raise TurbineDefinitionError(
            f"{turbine.name}: the tower stands on a monopile; a model is written for towers clamped at their base, "
            "give a model of your own (model='turbine.fst')"
        )
    station = _thinned(tower.structure.station, tower.length)
    mass = tower.structure.inertia_at(station)[:, 0, 0]
    bending = bending_matrices(tower.structure, station)
    fore_aft, side_side = bending[:, 1, 1], bending[:, 0, 0]
    body = _top_body(turbine)
    weight = GRAVITY * (body.mass + _from_the_end(station, mass))
    first, slow = bending_shapes(station, mass, fore_aft, 2, pull=-weight, top=body)
    second, slower = bending_shapes(station, mass, side_side, 2, pull=-weight, top=body)
    frequencies = np.concatenate([slow, slower])
    return TowerSections(station / tower.length, mass, fore_aft, side_side, first, second, frequencies)


def bending_matrices(structure: BeamStations, station: NDArray[np.float64]) -> NDArray[np.float64]:
    """Stiffness (n, 2, 2) against curvatures about x and y of sections without axial force and torque [N m²]."""
    stiffness = structure.stiffness_at(station)
    if structure.shear_rigid:
        return np.linalg.inv(np.linalg.inv(stiffness[:, 2:, 2:])[:, 1:3, 1:3])
    return np.linalg.inv(np.linalg.inv(stiffness)[:, 3:5, 3:5])


def _principal(
    bending: NDArray[np.float64], along: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Flapwise and edgewise stiffness and the angle of their axes, the one next to the twist of the chord."""
    xx, xy, yy = bending[:, 0, 0], bending[:, 0, 1], bending[:, 1, 1]
    mean, half = 0.5 * (xx + yy), 0.5 * (xx - yy)
    size = np.hypot(half, xy)
    angle = -0.5 * np.arctan2(xy, half)  # of the stiffer axis from x, counted as twist: clockwise about z
    twist = along + (angle - along + np.pi / 4) % (np.pi / 2) - np.pi / 4
    even = size < 0.5 * _EVEN * mean
    twist = np.where(even, along, twist)
    # the matrix in axes turned by minus the twist
    edge = mean + half * np.cos(2.0 * twist) - xy * np.sin(2.0 * twist)
    flap = 2.0 * mean - edge
    return flap, edge, twist


def _top_body(turbine: Turbine) -> TopBody:
    """Rotor and nacelle as one rigid body on the tower."""
    nacelle, hub, n = turbine.nacelle, turbine.hub, turbine.n_blades
    m0, m1, m2 = (turbine.blade.structure.mass_moment(k) for k in range(3))
    radius = hub.radius
    rotor = n * m0 + hub.mass
    shaft = nacelle.tower_top_to_shaft + nacelle.overhang * np.sin(nacelle.tilt)
    disc = 0.5 * n * (m2 + 2.0 * radius * m1 + radius**2 * m0) + hub.inertia_transverse
    mass = rotor + nacelle.mass + nacelle.yaw_bearing_mass
    height = (rotor * shaft + nacelle.mass * nacelle.cm[2]) / mass
    about = disc + rotor * (shaft - height) ** 2 + nacelle.inertia[1, 1]
    about += nacelle.mass * (nacelle.cm[2] - height) ** 2 + nacelle.yaw_bearing_mass * height**2
    return TopBody(float(mass), float(height), float(about))


def _from_the_end(x: NDArray[np.float64], density: NDArray[np.float64]) -> NDArray[np.float64]:
    """Integral of a density from each point to the end, exact for one that is linear between the points."""
    parts = 0.5 * (density[1:] + density[:-1]) * np.diff(x)
    return np.append(np.cumsum(parts[::-1])[::-1], 0.0)


def _thinned(points: NDArray[np.float64], length: float) -> NDArray[np.float64]:
    """Stations of a table, no more than ElastoDyn's tables comfortably hold, from 0 to the length."""
    points = np.unique(np.round(points, 9))
    if points.size > _MOST_STATIONS:
        points = np.linspace(0.0, length, _MOST_STATIONS)
    points[0], points[-1] = 0.0, length
    return points
