"""Tables of potential flow for hulls of upright columns and pontoons, by panels; needs the extra ``floating``.

>>> from wt_gym.hydrodynamics.design import Column, panel_flow
>>> spar = Column((0.0, 0.0), (-20.0, 0.0), (3.0,))
>>> flow = panel_flow([spar], frequency=[0.4, 0.8], heading=[0.0])  # doctest: +SKIP
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from wt_gym.base.errors import TurbineDefinitionError
from wt_gym.base.options import option, option_record
from wt_gym.base.quantities import GRAVITY, Array
from wt_gym.hydrodynamics.potential import ExcitationTable, RadiationTable
from wt_gym.hydrodynamics.record import Record, fail

_DOFS = ("Surge", "Sway", "Heave", "Roll", "Pitch", "Yaw")


@option_record
class Column(Record):
    """Upright column of circular pieces on one axis."""

    position: Array = option("axis in x and y", unit="m", shape=(2,), low=-500, high=500)
    height: Array = option(
        "heights of the ends of pieces; the last is 0 where it pierces the water", unit="m", shape=("height",),
        low=-500, high=0, ascending=2,
    )  # fmt: skip
    radius: Array = option("radius of each piece from the lowest", unit="m", shape=("piece",), low=0.1, high=100)

    def check(self) -> None:
        """Check the numbers."""
        if len(self.radius) != len(self.height) - 1:
            raise fail("Column.radius", self.radius, f"one for each of {len(self.height) - 1} pieces")

    def contains(self, points: Array) -> NDArray[np.bool_]:
        """Whether points (n, 3) are inside."""
        across = np.hypot(*(points[:, :2] - self.position).T)
        piece = np.clip(np.searchsorted(self.height, points[:, 2]) - 1, 0, len(self.radius) - 1)
        inside = (points[:, 2] > self.height[0]) & (points[:, 2] < self.height[-1]) & (across < self.radius[piece])
        return np.asarray(inside, dtype=np.bool_)

    def panels(self, size: float) -> Array:
        """Corners of panels, shape (n, 4, 3), against the clock from outside."""
        count = int(np.ceil(2.0 * np.pi * max(self.radius) / size / 4.0)) * 4
        profile = [(0.0, self.height[0])]  # radius and height from the middle of the bottom to the middle of the top
        for k, radius in enumerate(self.radius):
            profile += [(radius, self.height[k]), (radius, self.height[k + 1])]
        if self.height[-1] < 0.0:
            profile.append((0.0, self.height[-1]))
        r, z = _divided(profile, size).T
        angle = np.linspace(0.0, 2.0 * np.pi, count + 1)
        grid = np.stack([
            self.position[0] + np.outer(r, np.cos(angle)), self.position[1] + np.outer(r, np.sin(angle)),
            np.repeat(z[:, None], count + 1, axis=1)], axis=2)  # fmt: skip
        return _quads(grid)


@option_record
class Pontoon(Record):
    """Horizontal box between two points, as from the axis of one column to that of another."""

    start: Array = option("middle of one end in x and y", unit="m", shape=(2,), low=-500, high=500)
    end: Array = option("middle of the other end", unit="m", shape=(2,), low=-500, high=500)
    width: float = option("width", unit="m", low=0.1, high=100)
    bottom: float = option("height of the bottom", unit="m", low=-500, high=0)
    top: float = option("height of the top", unit="m", low=-500, high=0, below=True)

    def check(self) -> None:
        """Check that it has a volume."""
        if self.top <= self.bottom or np.hypot(*(self.end - self.start)) <= 0.0:
            raise fail("Pontoon", [self.bottom, self.top], "a box whose top is above its bottom, with a length")

    def _axes(self) -> tuple[Array, Array, float]:
        length = float(np.hypot(*(self.end - self.start)))
        along = (self.end - self.start) / length
        return along, np.array([-along[1], along[0]]), length

    def contains(self, points: Array) -> NDArray[np.bool_]:
        """Whether points (n, 3) are inside."""
        along, aside, length = self._axes()
        place = points[:, :2] - self.start
        inside = (place @ along > 0.0) & (place @ along < length) & (np.abs(place @ aside) < 0.5 * self.width)
        inside &= (points[:, 2] > self.bottom) & (points[:, 2] < self.top)
        return np.asarray(inside, dtype=np.bool_)

    def panels(self, size: float) -> Array:
        """Corners of panels, shape (n, 4, 3), against the clock from outside; the ends are open."""
        along, aside, length = self._axes()
        half = 0.5 * self.width
        corners = [(-half, self.bottom), (half, self.bottom), (half, self.top), (-half, self.top), (-half, self.bottom)]
        y, z = _divided(corners, size).T
        x = np.linspace(0.0, length, int(np.ceil(length / size)) + 1)
        flat = self.start + x[:, None, None] * along + y[:, None] * aside
        return _quads(np.concatenate([flat, np.broadcast_to(z[:, None], (*flat.shape[:2], 1))], axis=2))


class PanelFlow(NamedTuple):
    """Facts of a hull for `wt_gym.hydrodynamics.Platform`."""

    radiation: RadiationTable
    excitation: ExcitationTable
    hydrostatic: Array  #: Stiffness of water plane and buoyancy, shape (6, 6).
    displaced_volume: float  #: [m^3].
    center_of_buoyancy: Array  #: In x and y [m].


def panel_flow(
    hull: Sequence[Column | Pontoon], frequency: ArrayLike, heading: ArrayLike, *, size: float = 3.0,
    water_depth: float = 200.0, water_density: float = 1025.0, gravity: float = GRAVITY, is_mirrored: bool = False,
) -> PanelFlow:  # fmt: skip
    """Return the tables of a hull by the boundary element method of capytaine.

    Panels inside of another part are left out, so that parts may overlap. Added mass at zero and infinite frequency is
    that in deep water. A lid within the water plane removes irregular frequencies.

    Parameters
    ----------
    hull : sequence of Column or Pontoon
    frequency : array_like, shape (n,)
        Ascending, above 0 [rad/s].
    heading : array_like, shape (m,)
        Ascending [rad].
    size : float
        Longest side of a panel [m]: about an eighth of the shortest wave, a sixth of a diameter.
    water_depth, water_density, gravity : float
        [m], [kg/m^3], [m/s^2].
    is_mirrored : bool
        The hull is its own image in the plane of x and z, and the headings are those of one side.

    Raises
    ------
    TurbineDefinitionError
        If capytaine is not installed, or the hull has no water plane.
    """
    try:
        import capytaine
    except ImportError as error:
        raise TurbineDefinitionError("panel_flow needs capytaine: pip install wt_gym[floating]") from error
    omega, beta = np.asarray(frequency, np.float64), np.asarray(heading, np.float64)
    stiffness, volume, center = _hydrostatics(hull, water_density * gravity)
    if stiffness[2, 2] <= 0.0:
        raise fail("hull", stiffness[2, 2], "one that pierces the surface of the water")
    mesh = _mesh(capytaine, hull, size)
    body = capytaine.FloatingBody(
        mesh=mesh, lid_mesh=mesh.generate_lid(), dofs=capytaine.rigid_body_dofs(rotation_center=(0.0, 0.0, 0.0))
    )
    common = {"body": body, "rho": water_density, "g": gravity}
    solver = capytaine.BEMSolver()

    def radiation(w: float, depth: float) -> tuple[Array, Array]:
        problems = [
            capytaine.RadiationProblem(omega=w, radiating_dof=dof, water_depth=depth, **common) for dof in _DOFS
        ]
        results = [solver.solve(problem) for problem in problems]
        added = np.array([[result.added_masses[dof] for result in results] for dof in _DOFS])
        return added, np.array([[result.radiation_dampings[dof] for result in results] for dof in _DOFS])

    def excitation(w: float, angle: float) -> list[complex]:
        problem = capytaine.DiffractionProblem(omega=w, wave_direction=angle, water_depth=water_depth, **common)
        pressure = capytaine.bem.airy_waves.froude_krylov_force(problem)
        forces = solver.solve(problem).forces
        return [np.conj(pressure[dof] + forces[dof]) for dof in _DOFS]  # its waves have the factor e^{-iωt}

    tables = [radiation(0.0, np.inf), *(radiation(w, water_depth) for w in omega)]
    force = np.array([[excitation(w, angle) for angle in beta] for w in omega])
    added, damping = (np.array([table[k] for table in tables]) for k in range(2))
    damping[0] = 0.0
    return PanelFlow(
        RadiationTable(np.concatenate([[0.0], omega]), added, damping, radiation(np.inf, np.inf)[0]),
        ExcitationTable(omega, beta, force.real, force.imag, is_mirrored=is_mirrored), stiffness, volume, center,
    )  # fmt: skip


def _divided(corners: list[tuple[float, float]], size: float) -> Array:
    """Points (n, 2) of a line over corners, at most a size apart."""
    points = [np.array(corners[:1])]
    for start, end in pairwise(corners):
        n = int(np.ceil(np.hypot(end[0] - start[0], end[1] - start[1]) / size - 1e-9))
        points.append(np.linspace(start, end, n + 1)[1:])
    return np.concatenate(points)


def _quads(grid: Array) -> Array:
    """Panels between the points of a grid (i, j, 3)."""
    corners = [grid[:-1, :-1], grid[:-1, 1:], grid[1:, 1:], grid[1:, :-1]]
    return np.stack(corners, axis=2).reshape(-1, 4, 3)


def _mesh(capytaine: Any, hull: Sequence[Column | Pontoon], size: float) -> Any:
    """Mesh of the panels that are in no other part."""
    panels = []
    for part in hull:
        own = part.panels(size)
        middle = own.mean(axis=1)
        outside = np.ones(len(own), dtype=bool)
        for other in hull:
            if other is not part:
                outside &= ~other.contains(middle)
        panels.append(own[outside])
    corners = np.concatenate(panels)
    return capytaine.Mesh(corners.reshape(-1, 3), np.arange(4 * len(corners)).reshape(-1, 4)).merged()


def _hydrostatics(hull: Sequence[Column | Pontoon], specific_weight: float) -> tuple[Array, float, Array]:
    """Stiffness (6, 6), volume and horizontal center of buoyancy of the union of all parts, layer by layer."""
    ends: set[float] = set()
    reach = 0.0
    for part in hull:
        if isinstance(part, Column):
            ends |= set(part.height.tolist())
            reach = max(reach, float(np.abs(part.position).max() + part.radius.max()))
        else:
            ends |= {part.bottom, part.top}
            reach = max(reach, float(np.abs([part.start, part.end]).max() + part.width))
    n = 1000
    side = 2.0 * reach / n
    line = -reach + side * (np.arange(n) + 0.5)
    x, y = (values.ravel() for values in np.meshgrid(line, line))
    levels, volume, moment = sorted(ends), 0.0, np.zeros(3)
    area, first, second = 0.0, np.zeros(2), np.zeros((2, 2))
    for low, high in pairwise(levels):
        middle = 0.5 * (low + high)
        points = np.column_stack([x, y, np.full_like(x, middle)])
        inside = np.any([part.contains(points) for part in hull], axis=0)
        place = points[inside]
        layer = place.sum(axis=0) * side**2 * (high - low)
        volume, moment = volume + inside.sum() * side**2 * (high - low), moment + layer
        if high == 0.0:
            area, first = inside.sum() * side**2, place[:, :2].sum(axis=0) * side**2
            second = place[:, :2].T @ place[:, :2] * side**2
    stiffness = np.zeros((6, 6))
    stiffness[2, 2] = area
    stiffness[2, 3] = stiffness[3, 2] = first[1]
    stiffness[2, 4] = stiffness[4, 2] = -first[0]
    stiffness[3, 3], stiffness[4, 4] = second[1, 1] + moment[2], second[0, 0] + moment[2]
    stiffness[3, 4] = stiffness[4, 3] = -second[0, 1]
    return specific_weight * stiffness, float(volume), moment[:2] / volume
