"""Closed bodies in the flow: tower, nacelle, hub as surfaces of source panels.

Sources on a closed body make no lift and leave the equations regular: the matrix of normal velocities of one closed
body of vortex rings would lack one rank. The strengths are eliminated from the unknowns of the lattice, see
`body_kernels.couple_bodies`.

Force of the flow on a closed body of sources: Lagally's theorem for unsteady flow.

Sources of the fluxes m at r, of vanishing sum, stand for a body of the volume V that moves with the velocity u in the
velocity v of all that is outside it. The force of the potential flow on the body is

    F = −ρ Σ m (v − u) + d/dt P,    P = −ρ Σ m r + ρ V u

(Lagally 1922; W. E. Cummins, The force and moment on a body in a time-varying potential flow, J. Ship Research 1, 1957;
the last term is the inertia of the fluid that the body displaces). In a steady uniform flow the force is zero. A sphere
in an accelerating stream U has Σ m r = −3/2 V U and so F = 3/2 ρ V dU/dt; one that accelerates in fluid at rest has
Σ m r = 3/2 V u and F = −1/2 ρ V du/dt, its added mass.

Unlike an integral of the pressure the sum needs neither velocities along the surface nor the potential, and it can be
taken strip by strip of a slender body: a strip of the area S has Σ m r = −2 S U dz, so that the force per length is
2 ρ S (dU/dt + U·∇U) − ρ S du/dt, twice and once the mass of the displaced air.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from itertools import pairwise, permutations
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from wt_gym.aerodynamics.bodies import body_kernels, tower_kernels
from wt_gym.aerodynamics.induction.tree_induction import RingWork
from wt_gym.aerodynamics.lattice.bound_kernels import invert
from wt_gym.aerodynamics.options import AerodynamicsError
from wt_gym.base.quantities import Array, Integers

FAR = 3.0
"""Distance over panel radius from which a panel is a point source with quadrupole; its velocity is then within 1e-3."""
MAX_WARP = 0.05
"""Largest distance of a corner from the mean plane, over the longer diagonal: panels are computed as flat."""


class TowerAxis(NamedTuple):
    """Straight axis and radii of a tower."""

    ends: Array  # (2, 3) base and top [m]
    stations: Array  # (n,) distances from the base [m]
    radii: Array  # (n,) [m]


class BodyArrays(NamedTuple):
    """What the kernels need of the panels of all bodies."""

    corners: Array  # (n_panel, 4, 3) in the mean plane, counter-clockwise about the normal [m]
    center: Array  # (3, n_panel) control points: centroids [m]
    normal: Array  # (n_panel, 3) unit, out of the body
    # (n_panel, 8): area [m^2], xx, yy, zz, xy, yz, zx about the centroid [m^4], all over 4 pi,
    far: Array
    # and the square of the distance [m^2] below which the exact velocity is computed
    motion: Array  # (3, n_panel) velocity of the control points [m/s]
    owner: Integers  # (n_panel,) number of the body
    axis: Array  # (2, 3) base and top of the tower [m]
    stations: Array  # (n,) distances from its base [m]; none without a tower
    radii: Array  # (n,) its radii there [m]
    # (n_panel, n_panel): strengths = inverse @ normal velocities that the panels must induce
    inverse: Array


class BodyWork(NamedTuple):
    """Work arrays of `body_kernels.couple_bodies`; the first three are its input."""

    ring_influence: Array  # (n_ring, 3, n_panel) velocity of each unit ring at the control points
    wind: Array  # (n_panel, 3) undisturbed wind there [m/s]
    wake_flow: Array  # (3, n_panel) velocity of the wake there [m/s]
    through: Array  # (n_panel,) normal velocities [m/s]
    # (n_panel, 3, n_point) velocity of each unit panel at the points of the blades
    source_influence: Array
    eliminated: Array  # (n_ring, n_panel) strengths that answer a unit ring, with opposite sign
    start: Array  # (n_panel,) strengths without rings [m/s]
    rings: RingWork
    flags: NDArray[np.int8]  # (n_max + 1, n_blade, n_edge + 1), see tower_kernels.flag_wake_segments


@dataclass(frozen=True)
class BodySurface:
    """Surface of a rigid closed body, or of one that stands open on the ground.

    Parameters
    ----------
    vertices : array_like, shape (n_vertex, 3)
        Corners of the panels in the frame of the body [m].
    quads : array_like of int, shape (n_panel, 4)
        Vertices of each panel, counter-clockwise seen from outside; a triangle repeats its last vertex.
    ground : float or None
        Height of a ground on which the body may stand without a bottom [m], as `BodySet` then closes it by its image.
    name : str
        For messages.
    tower : TowerAxis or None
        What the wake must not cut through, in the frame of the body.

    Attributes
    ----------
    corners : ndarray, shape (n_panel, 4, 3)
        Corners moved into the mean plane of their panel [m].
    center, normal : ndarray, shape (n_panel, 3)
        Centroids [m] and unit normals out of the body.
    area : ndarray, shape (n_panel,)
        [m^2].
    volume : float
        Enclosed volume [m^3].

    Raises
    ------
    AerodynamicsError
        If a panel has no area or is far from flat, if the surface is not closed, or if normals point inwards.
    """

    vertices: Array
    quads: Integers
    ground: float | None = None
    name: str = "body"
    tower: TowerAxis | None = None
    corners: Array = field(init=False, repr=False)
    center: Array = field(init=False, repr=False)
    normal: Array = field(init=False, repr=False)
    area: Array = field(init=False, repr=False)
    volume: float = field(init=False)

    def __post_init__(self) -> None:
        """Check the mesh and compute its panels."""
        vertices, quads = np.array(self.vertices, dtype=np.float64), np.array(self.quads, dtype=np.int64)
        if vertices.ndim != 2 or vertices.shape[1:] != (3,) or not np.isfinite(vertices).all():
            raise AerodynamicsError(f"vertices of {self.name}, shape {vertices.shape}, must be finite (n_vertex, 3)")
        if quads.ndim != 2 or quads.shape[1:] != (4,) or not len(quads):
            raise AerodynamicsError(f"quads of {self.name}, shape {quads.shape}, must be (n_panel, 4)")
        if quads.min() < 0 or quads.max() >= len(vertices):
            raise AerodynamicsError(f"quads of {self.name} name vertices beyond the {len(vertices)} given")
        self._check_edges(vertices, quads)
        panels = _panel_geometry(vertices[quads], self.name)
        reference = np.array([0.0, 0.0, self.ground or 0.0])
        volume = float(np.einsum("pi,pi,p->", panels[1] - reference, panels[2], panels[3]) / 3.0)
        if not volume > 0.0:
            raise AerodynamicsError(f"the normals of {self.name} point inwards: its volume is {volume:.4g} m^3")
        for name, value in zip(
            ("vertices", "quads", "corners", "center", "normal", "area"), (vertices, quads, *panels), strict=True
        ):
            value.flags.writeable = False
            object.__setattr__(self, name, value)
        object.__setattr__(self, "volume", volume)

    @property
    def n_panels(self) -> int:
        """Number of panels."""
        return len(self.quads)

    def _check_edges(self, vertices: Array, quads: Integers) -> None:
        """Each edge must be passed once in each direction, or lie on the ground."""
        start, end = quads.ravel(), np.roll(quads, -1, axis=1).ravel()
        panel = np.repeat(np.arange(len(quads)), 4)
        real = start != end
        start, end, panel = start[real], end[real], panel[real]
        key, reverse = start * len(vertices) + end, end * len(vertices) + start
        _, first, count = np.unique(key, return_index=True, return_counts=True)
        if count.max() > 1:
            k = first[count > 1][0]
            raise AerodynamicsError(
                f"panel {panel[k]} of {self.name} and a neighbor run along their edge {start[k]}-{end[k]} in the same "
                "direction: the normal of one of them is inverted"
            )
        is_open = ~np.isin(key, reverse)
        if self.ground is not None:
            size = np.ptp(vertices, axis=0).max()
            on_ground = np.abs(vertices[:, 2] - self.ground) < 1e-9 * size
            is_open &= ~(on_ground[start] & on_ground[end])
        if is_open.any():
            k = np.flatnonzero(is_open)[0]
            raise AerodynamicsError(
                f"{self.name} is not closed: panel {panel[k]} has no neighbor at its edge {start[k]}-{end[k]} "
                f"({vertices[start[k]]} to {vertices[end[k]]})"
            )


def _panel_geometry(corners: Array, name: str) -> tuple[Array, Array, Array, Array]:
    """Corners (n, 4, 3) in their mean planes, centroids, unit normals and areas."""
    diagonals = corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1]
    normal = 0.5 * np.cross(*diagonals)
    size = np.maximum(*(np.linalg.norm(d, axis=1) for d in diagonals))
    norm = np.linalg.norm(normal, axis=1)
    flat = ~(norm > 1e-10 * size**2)
    if flat.any():
        k = np.flatnonzero(flat)[0]
        raise AerodynamicsError(f"panel {k} of {name} has no area; its corners are {corners[k].tolist()}")
    normal /= norm[:, None]
    middle = corners.mean(axis=1)
    out_of_plane = np.einsum("pki,pi->pk", corners - middle[:, None], normal)
    warp = np.abs(out_of_plane).max(axis=1) / size
    if warp.max() > MAX_WARP:
        k = int(warp.argmax())
        raise AerodynamicsError(
            f"panel {k} of {name} is not flat: a corner lies {warp[k]:.3f} of the diagonal out of its mean plane; at "
            f"most {MAX_WARP} are allowed"
        )
    corners = corners - out_of_plane[..., None] * normal[:, None]
    thirds, areas = _triangles(corners, normal)
    area = areas.sum(axis=1)
    center = np.einsum("pti,pt->pi", thirds.mean(axis=2), areas) / area[:, None]
    return corners, center, normal, area


def _triangles(corners: Array, normal: Array) -> tuple[Array, Array]:
    """Two triangles (n, 2, 3, 3) of each panel and their areas (n, 2), negative beyond a re-entrant corner."""
    triangles = np.stack([corners[:, [0, 1, 2]], corners[:, [0, 2, 3]]], axis=1)
    a, b, c = (triangles[:, :, k] for k in range(3))
    return triangles, 0.5 * np.einsum("pti,pi->pt", np.cross(b - a, c - a), normal)


def _second_moments(corners: Array, center: Array, normal: Array) -> Array:
    """Integrals of x_i x_j about the centroid, (n, 3, 3) [m^4]."""
    triangles, areas = _triangles(corners - center[:, None], normal)
    total = triangles.sum(axis=2)
    pairs = np.einsum("ptki,ptkj->ptij", triangles, triangles) + np.einsum("pti,ptj->ptij", total, total)
    result: Array = np.einsum("ptij,pt->pij", pairs, areas) / 12.0
    return result


class BodySet:
    """All bodies in a flow, each fixed or moved as a rigid body.

    The influence of the panels on each other and its inverse are computed at construction, and again when `place`
    has moved a body.

    Parameters
    ----------
    bodies : sequence of BodySurface
        At their places: the frame of each is the global one until `place` moves it.
    ground : float or None
        Height of a flat ground in which all bodies are mirrored [m].

    Attributes
    ----------
    arrays : BodyArrays
        Panels as they are now, for the kernels.
    names : tuple of str
        Of the bodies.
    first_panel : ndarray of int, shape (n_body + 1,)
        Panels first_panel[b] to first_panel[b + 1] belong to body b.

    Raises
    ------
    AerodynamicsError
        If there is no body, if a body reaches below the ground or is open on another ground, or if two intersect.
    """

    def __init__(self, bodies: Iterable[BodySurface], ground: float | None = None) -> None:
        bodies = tuple(bodies)
        if not bodies:
            raise AerodynamicsError("a set of bodies needs at least one BodySurface")
        self.bodies, self.names = bodies, tuple(body.name for body in bodies)
        self.has_ground, self.ground = ground is not None, float(ground or 0.0)
        for body in bodies:
            if body.ground is not None and body.ground != ground:
                raise AerodynamicsError(f"{body.name} stands on a ground at {body.ground} m, the set has {ground}")
        self.first_panel = np.concatenate([[0], np.cumsum([body.n_panels for body in bodies])])
        towers = [(body.name, body.tower) for body in bodies if body.tower is not None]
        if len(towers) > 1:
            raise AerodynamicsError(f"the bodies {[name for name, _ in towers]} are towers; one is allowed")
        tower = towers[0][1] if towers else TowerAxis(np.zeros((2, 3)), np.zeros(0), np.zeros(0))
        n = self.n_panels
        self.arrays = BodyArrays(
            corners=np.zeros((n, 4, 3)), center=np.zeros((3, n)), normal=np.zeros((n, 3)), far=np.zeros((n, 8)),
            motion=np.zeros((3, n)), owner=np.repeat(np.arange(len(bodies)), np.diff(self.first_panel)),
            axis=tower.ends.copy(), stations=tower.stations.copy(), radii=tower.radii.copy(), inverse=np.zeros((n, n)),
        )  # fmt: skip
        self._part = np.zeros((3, n))
        self._elimination = np.zeros(n, dtype=np.int64), np.zeros((n, 4)), np.zeros((4, n))
        self._frames, self._bent = np.full((len(bodies), 3, 4), np.nan), False
        self.place(np.tile(np.eye(3), (len(bodies), 1, 1)), np.zeros((len(bodies), 3)))
        # no control point may lie in another body: the flux of a uniformly strong surface tells inside and outside
        for (name, mine), (other, theirs) in permutations(zip(self.names, self._panels(), strict=True), 2):
            if _inside(self.arrays.corners[theirs], self.arrays.center[:, mine].T).any():
                raise AerodynamicsError(f"the bodies {name} and {other} intersect")

    @property
    def n_panels(self) -> int:
        """Number of panels of all bodies."""
        return int(self.first_panel[-1])

    @property
    def control_points(self) -> Array:
        """Control points, shape (n_panel, 3) [m]; where the wind is needed."""
        return np.ascontiguousarray(self.arrays.center.T)

    @property
    def area(self) -> Array:
        """Panel areas, shape (n_panel,) [m^2]."""
        return 4.0 * np.pi * self.arrays.far[:, 0]

    def place(
        self,
        rotations: ArrayLike,
        origins: ArrayLike,
        velocities: ArrayLike | None = None,
        angular_velocities: ArrayLike | None = None,
    ) -> bool:
        """Move the bodies.

        A body of revolution that spins about its axis need not be turned: its surface stays where it is.

        Parameters
        ----------
        rotations : array_like, shape (n_body, 3, 3)
            From the frame of each body to the global one.
        origins : array_like, shape (n_body, 3)
            Of those frames [m].
        velocities, angular_velocities : array_like, shape (n_body, 3), optional
            Of the origins [m/s] and frames [rad/s], global; zero by default.

        Returns
        -------
        bool
            Whether a body moved, so that the influence was recomputed.

        Raises
        ------
        AerodynamicsError
            If a body reaches below the ground.
        """
        frames = np.concatenate([np.asarray(rotations), np.asarray(origins)[..., None]], axis=2)
        if frames.shape != self._frames.shape or not np.isfinite(frames).all():
            raise AerodynamicsError(f"frames of {self.names} must be finite, {len(self.bodies)} of them")
        elsewhere = np.flatnonzero((frames != self._frames).any(axis=(1, 2)))
        self._frames[elsewhere] = np.nan  # should a refusal leave the panels between two places
        for k in elsewhere.tolist():
            self._move(k, frames[k, :, :3], frames[k, :, 3])
        self._frames[:] = frames
        moved, self._bent = self._bent or len(elsewhere) > 0, False
        if moved:
            a = self.arrays
            body_kernels.normal_matrix(a, self.ground, self.has_ground, self._part, a.inverse)
            invert(a.inverse, *self._elimination)
            # Air that flows into a closed body must flow out: what the normal velocities at the control points have
            # left over, as they sample a nearby vortex coarsely, is not a source of the body.
            for panels in self._panels():
                share = self.area[panels] / self.area[panels].sum()
                a.inverse[:, panels] -= np.outer(a.inverse[:, panels].sum(axis=1), share)
        velocities = np.zeros_like(frames[:, :, 3]) if velocities is None else np.asarray(velocities)
        spins = np.zeros_like(velocities) if angular_velocities is None else np.asarray(angular_velocities)
        for b, panels in enumerate(self._panels()):
            arm = self.arrays.center[:, panels].T - frames[b, :, 3]
            self.arrays.motion[:, panels] = (velocities[b] + np.cross(spins[b], arm)).T
        return moved

    def bend(self, body: int, vertices: ArrayLike) -> None:
        """Deform a body; the influences follow in the next call of `place`, which must not turn or shift it.

        Parameters
        ----------
        vertices : array_like, shape (n_vertex, 3)
            Where the vertices of its surface are now, global [m].

        Raises
        ------
        AerodynamicsError
            If a panel is no longer flat or reaches below the ground.
        """
        surface, a = self.bodies[body], self.arrays
        vertices = np.asarray(vertices, dtype=np.float64)
        corners, center, normal, area = _panel_geometry(vertices[surface.quads], surface.name)
        self._set_panels(body, corners, center, normal, area)
        if surface.tower is not None:
            low, high = surface.vertices[:, 2].min(), surface.vertices[:, 2].max()
            level = surface.vertices[:, 2]
            a.axis[0] = vertices[level == low].mean(axis=0)
            a.axis[1] = vertices[level == high].mean(axis=0)
        self._bent = True

    def work(self, n_ring: int, n_point: int, wake_shape: tuple[int, int, int], n_corner: int) -> BodyWork:
        """Work arrays for the coupling with a lattice of that many rings, points, wake nodes (row, blade, node), and
        corners of the rings of a blade.
        """
        n = self.n_panels
        return BodyWork(
            ring_influence=np.zeros((n_ring, 3, n)), wind=np.zeros((n, 3)), wake_flow=np.zeros((3, n)),
            through=np.zeros(n), source_influence=np.zeros((n, 3, n_point)), eliminated=np.zeros((n_ring, n)),
            start=np.zeros(n), rings=RingWork.empty(n_ring, n_corner, n), flags=np.zeros(wake_shape, dtype=np.int8),
        )  # fmt: skip

    def strengths(self, flow: ArrayLike) -> Array:
        """Source strengths that make the bodies impermeable, shape (n_panel,) [m/s].

        Parameters
        ----------
        flow : ndarray, shape (n_panel, 3)
            Velocity of everything but the bodies at the control points [m/s].
        """
        relative = np.asarray(flow) - self.arrays.motion.T
        result: Array = -self.arrays.inverse @ np.einsum("pi,pi->p", self.arrays.normal, relative)
        return result

    def velocity(self, points: ArrayLike, strengths: ArrayLike) -> Array:
        """Velocity of the sources at points (..., 3) [m/s]; at a control point, that on the outside."""
        points = np.asarray(points, dtype=np.float64)
        flat = np.ascontiguousarray(points.reshape(-1, 3).T)
        out, part = np.zeros_like(flat), np.empty_like(flat)
        strengths = np.ascontiguousarray(strengths, dtype=np.float64)
        body_kernels.panels_velocity(self.arrays, strengths, flat, self.ground, self.has_ground, part, out)
        return out.T.reshape(points.shape)

    def _panels(self) -> list[slice]:
        """Slice of the panels of each body."""
        return [slice(*ends) for ends in pairwise(self.first_panel)]

    def _move(self, b: int, rotation: Array, origin: Array) -> None:
        body = self.bodies[b]
        corners, center = body.corners @ rotation.T + origin, body.center @ rotation.T + origin
        if body.tower is not None:
            self.arrays.axis[:] = body.tower.ends @ rotation.T + origin
        self._set_panels(b, corners, center, body.normal @ rotation.T, body.area)

    def _set_panels(self, b: int, corners: Array, center: Array, normal: Array, area: Array) -> None:
        """Panels of a body: corners (n, 4, 3), centroids, normals (n, 3) and areas (n,)."""
        body, panels, a = self.bodies[b], self._panels()[b], self.arrays
        a.corners[panels], a.center[:, panels], a.normal[panels] = corners, center.T, normal
        if self.has_ground:
            lowest = float(a.corners[panels][..., 2].min())
            if lowest < self.ground - 1e-9 * np.ptp(body.vertices, axis=0).max():
                raise AerodynamicsError(f"{body.name} reaches to {lowest:.3f} m, below the ground at {self.ground} m")
        center = a.center[:, panels].T
        q = _second_moments(a.corners[panels], center, a.normal[panels])
        near = FAR**2 * np.max(np.sum((a.corners[panels] - center[:, None]) ** 2, axis=2), axis=1)
        a.far[panels] = np.column_stack(
            [area, q[:, 0, 0], q[:, 1, 1], q[:, 2, 2], q[:, 0, 1], q[:, 1, 2], q[:, 2, 0], 4.0 * np.pi * near]
        ) / (4.0 * np.pi)


def _inside(corners: Array, points: Array) -> NDArray[np.bool_]:
    """Whether points (n, 3) are enclosed by panels (m, 4, 3): the panels' solid angles then sum to -4 pi."""
    arms = points[:, None, None] - corners
    sizes = np.linalg.norm(arms, axis=-1)
    total = np.zeros(len(points))
    for i, j, k in ((0, 1, 2), (0, 2, 3)):
        a, b, c = arms[:, :, i], arms[:, :, j], arms[:, :, k]
        ra, rb, rc = sizes[..., i], sizes[..., j], sizes[..., k]
        volume = np.einsum("nmi,nmi->nm", a, np.cross(b, c))
        dot_ab, dot_bc, dot_ca = (np.einsum("nmi,nmi->nm", u, v) for u, v in ((a, b), (b, c), (c, a)))
        total += 2.0 * np.arctan2(volume, ra * rb * rc + dot_ab * rc + dot_bc * ra + dot_ca * rb).sum(axis=1)
    return total < -2.0 * np.pi


def revolution_body(
    stations: ArrayLike,
    radii: ArrayLike,
    n_around: int,
    origin: ArrayLike = (0.0, 0.0, 0.0),
    axis: ArrayLike = (0.0, 0.0, 1.0),
    name: str = "body",
    ground: float | None = None,
) -> BodySurface:
    """Body of revolution from its profile; flat ends are closed by discs.

    The cross-sections are regular polygons with the area of the circle, which gives the flow around them the right
    strength with few panels.

    Parameters
    ----------
    stations : array_like, shape (n,)
        Increasing distances along the axis from ``origin`` [m].
    radii : array_like, shape (n,)
        Radii there, positive except at the ends, which may be zero [m].
    n_around : int
        Panels around, at least 3.
    origin, axis : array_like, shape (3,)
        Start of the axis [m] and its direction.
    name : str
        For messages.
    ground : float or None
        If the first station lies on a ground at this height, and the axis is vertical, there is no disc.

    Raises
    ------
    AerodynamicsError
        If the profile makes no body.
    """
    stations, radii, origin, axis = (np.asarray(x, dtype=np.float64) for x in (stations, radii, origin, axis))
    if n_around < 3:
        raise AerodynamicsError(f"n_around of {name} is {n_around}; must be at least 3 panels")
    if stations.ndim != 1 or stations.shape != radii.shape or len(stations) < 2 or np.any(np.diff(stations) <= 0.0):
        raise AerodynamicsError(f"{name} needs at least two radii {radii} at increasing stations {stations}")
    if not (np.all(radii[1:-1] > 0.0) and radii[0] >= 0.0 and radii[-1] >= 0.0 and radii.max() > 0.0):
        raise AerodynamicsError(f"radii of {name} are {radii}; they must be positive, at the ends at least zero")
    if not np.linalg.norm(axis) > 0.0:
        raise AerodynamicsError(f"the axis of {name} is {axis}; it must have a direction")
    axis = axis / np.linalg.norm(axis)
    side = np.cross(axis, np.eye(3)[np.argmin(np.abs(axis))])
    side /= np.linalg.norm(side)
    angle = 2.0 * np.pi / n_around * (np.arange(n_around) + 0.5)
    circle = np.cos(angle)[:, None] * side + np.sin(angle)[:, None] * np.cross(axis, side)
    scale = np.sqrt(2.0 * np.pi / n_around / np.sin(2.0 * np.pi / n_around))
    vertices: list[Array] = []
    rings = []
    for s, r in zip(stations, radii, strict=True):
        rings.append(len(vertices) + (np.arange(n_around) if r > 0.0 else np.zeros(n_around, dtype=int)))
        vertices += list(origin + s * axis + scale * r * circle) if r > 0.0 else [origin + s * axis]
    standing = ground is not None and abs(origin[2] + stations[0] - ground) < 1e-9 * np.ptp(stations)
    standing = standing and axis[2] > 1.0 - 1e-12
    discs = []
    for end in (0, -1):
        disc = radii[end] > 0.0 and not (end == 0 and standing)
        discs.append([np.full(n_around, len(vertices))] if disc else [])
        vertices += [origin + stations[end] * axis] if disc else []
    rings = discs[0] + rings + discs[1]
    quads = []
    for low, high in pairwise(rings):
        ring = np.column_stack([low, np.roll(low, -1), np.roll(high, -1), high])
        # A triangle starts with its two different vertices, so that the repeated one comes last.
        quads += list(np.roll(ring, -2, axis=1) if low[0] == low[1] else ring)
    return BodySurface(np.array(vertices), np.array(quads), ground if standing else None, name)


def ellipsoid_body(
    semi_axes: ArrayLike, n_around: int, n_along: int, origin: ArrayLike = (0.0, 0.0, 0.0), name: str = "ellipsoid"
) -> BodySurface:
    """Ellipsoid with its poles on the x axis of its frame, for hubs, nacelles and tests.

    Parameters
    ----------
    semi_axes : array_like, shape (3,)
        Along x, y and z [m].
    n_around, n_along : int
        Panels around the x axis, and from pole to pole (at equal steps of the eccentric angle).
    origin : array_like, shape (3,)
        Center [m].
    name : str
        For messages.

    Raises
    ------
    AerodynamicsError
        If a semi-axis is not positive or there are too few panels.
    """
    semi_axes = np.asarray(semi_axes, dtype=np.float64)
    if semi_axes.shape != (3,) or not np.all(semi_axes > 0.0):
        raise AerodynamicsError(f"semi-axes of {name} are {semi_axes}; must be three positive lengths [m]")
    if n_along < 2:
        raise AerodynamicsError(f"n_along of {name} is {n_along}; must be at least 2 panels")
    angle = np.linspace(np.pi, 0.0, n_along + 1)
    radii = np.sin(angle)
    radii[[0, -1]] = 0.0
    ball = revolution_body(np.cos(angle), radii, n_around, axis=(1.0, 0.0, 0.0), name=name)
    return BodySurface(ball.vertices * semi_axes + np.asarray(origin), ball.quads, name=name)


def tower_body(
    stations: ArrayLike,
    diameters: ArrayLike,
    base: ArrayLike,
    top: ArrayLike,
    n_around: int,
    n_along: int,
    ground: float | None = None,
    name: str = "tower",
) -> BodySurface:
    """Tower as a closed body: frusta between base and top, discs at free ends.

    Parameters
    ----------
    stations, diameters : array_like, shape (n,)
        Outer diameters [m] at increasing distances from the base [m].
    base, top : array_like, shape (3,)
        Ends of the straight axis [m].
    n_around, n_along : int
        Panels around and along.
    ground : float or None
        Height of the ground [m]; a tower that starts there has no bottom.
    name : str
        For messages.

    Raises
    ------
    AerodynamicsError
        If base and top coincide or the diameters are not positive at increasing stations.
    """
    base, stations, diameters = (np.asarray(x, dtype=np.float64) for x in (base, stations, diameters))
    end = np.asarray(top, dtype=np.float64)
    axis = end - base
    height = float(np.linalg.norm(axis))
    if not height > 0.0:
        raise AerodynamicsError(f"the top of the {name} must be above its base, got base {base} and top {end}")
    if stations.shape != diameters.shape or np.any(np.diff(stations) <= 0.0) or not np.all(diameters > 0.0):
        raise AerodynamicsError(f"{name} diameters {diameters} must be positive, at increasing stations {stations}")
    if n_along < 1:
        raise AerodynamicsError(f"n_along of {name} is {n_along}; must be at least 1 panel")
    along = np.linspace(0.0, height, n_along + 1)
    body = revolution_body(along, 0.5 * np.interp(along, stations, diameters), n_around, base, axis, name, ground)
    return replace(body, tower=TowerAxis(np.array([base, base + axis]), stations, 0.5 * diameters))


def convective_force(flux: Array, flow: Array, velocity: ArrayLike, density: float) -> Array:
    """−ρ Σ m (v − u) [N].

    Parameters
    ----------
    flux : array (..., n)
        Strengths times areas of panels [m³/s].
    flow : array (..., n, 3)
        Velocity of everything outside the body at the panels [m/s].
    velocity : array (..., 3)
        Of the body [m/s].
    density : float
        [kg/m³].

    Returns
    -------
    array (..., 3)
    """
    result: Array = -density * np.einsum("...n,...ni->...i", flux, flow - np.asarray(velocity)[..., None, :])
    return result


def impulse(flux: Array, arm: Array, volume: ArrayLike, velocity: Array, density: float) -> Array:
    """P = −ρ Σ m r + ρ V u [kg m/s].

    Parameters
    ----------
    flux : array (..., n)
        [m³/s].
    arm : array (..., n, 3)
        From a point that moves with the body to the panels [m].
    volume : array (...)
        [m³].
    velocity : array (..., 3)
        Of the body [m/s].
    density : float
        [kg/m³].

    Returns
    -------
    array (..., 3)
    """
    inertia = np.asarray(volume)[..., None] * velocity
    result: Array = density * (inertia - np.einsum("...n,...ni->...i", flux, arm))
    return result


class TowerFlow:
    """Velocity that a tower adds to the wind.

    At each height the tower is an infinite cylinder of the local diameter: with a the radius, r the vector from the
    axis and V the wind across the axis, v = a^2/r^2 (V - 2 (V . r) r / r^2) (doublet in a uniform stream, e.g. Katz &
    Plotkin, Low-Speed Aerodynamics, section 3.11). It fades over one radius beyond each end. Inside the tower, which
    no blade reaches before the simulation ends, the value of the surface holds.

    Parameters
    ----------
    base : array_like, shape (3,)
        Lower end of the tower axis [m].
    stations : array_like, shape (n,)
        Increasing distances from the base at which diameters are given [m].
    diameters : array_like, shape (n,)
        Outer diameters [m].

    Raises
    ------
    AerodynamicsError
        If the diameters are not positive at increasing stations.
    """

    def __init__(self, base: ArrayLike, stations: ArrayLike, diameters: ArrayLike) -> None:
        base, stations, diameters = (np.array(x, dtype=np.float64) for x in (base, stations, diameters))
        if base.shape != (3,) or not np.isfinite(base).all():
            raise AerodynamicsError(f"the tower base is {base}; must be three finite coordinates [m]")
        increasing = stations.ndim == 1 and stations.size and bool(np.all(np.diff(stations) > 0.0))
        if not increasing or stations.shape != diameters.shape or not np.all(diameters > 0.0):
            raise AerodynamicsError(f"tower diameters {diameters} must be positive, at increasing stations {stations}")
        self.base, self.stations, self.radii = base, stations, 0.5 * diameters

    def add(self, points: Array, wind: Array, top: Array, base: Array | None = None) -> None:
        """Add the flow past the tower to the wind, in place.

        Parameters
        ----------
        points : ndarray, shape (..., 3)
            Where the wind is felt [m]; float64, contiguous.
        wind : ndarray, shape (..., 3)
            Undisturbed wind there [m/s], changed; float64, contiguous.
        top : ndarray, shape (3,)
            Upper end of the tower axis [m].
        base : ndarray, shape (3,), optional
            Lower end [m], where it moves.

        Raises
        ------
        AerodynamicsError
            If base and top coincide, or the wind is not contiguous and could not be changed in place.
        """
        if not wind.flags.c_contiguous:
            raise AerodynamicsError(f"the wind, with strides {wind.strides}, must be contiguous")
        flat = wind.reshape(-1, 3)
        base = self.base if base is None else base
        if not tower_kernels.add_tower_flow(points.reshape(-1, 3), flat, base, top, self.stations, self.radii):
            raise AerodynamicsError(f"the tower top must be above its base, got base {base} and top {top}")


def tower_perturbation(
    points: ArrayLike, wind: ArrayLike, base: ArrayLike, top: ArrayLike, stations: ArrayLike, diameters: ArrayLike
) -> Array:
    """Velocity that a tower adds to the wind, for a single use: see `TowerFlow`, which checks its tower only once.

    Parameters
    ----------
    points, wind : ndarray, shape (..., 3)
        Where the wind is felt [m] and the undisturbed wind there [m/s].
    base, top : array_like, shape (3,)
        Ends of the tower axis [m].
    stations, diameters : array_like, shape (n,)
        Outer diameters at increasing distances from the base [m].

    Returns
    -------
    velocity : ndarray, shape (..., 3)
        To be added to the wind [m/s].

    Raises
    ------
    AerodynamicsError
        If base and top coincide or the diameters are not positive at increasing stations.
    """
    undisturbed = np.asarray(wind, dtype=np.float64)
    disturbed = undisturbed.copy()
    TowerFlow(base, stations, diameters).add(
        np.ascontiguousarray(points, dtype=np.float64), disturbed, np.asarray(top, dtype=np.float64)
    )
    return disturbed - undisturbed
