"""A beam cut into several floating-frame bodies: large deflections from small ones.

Each sub-body deforms linearly (with second-order foreshortening) in its own frame, which is clamped to the tip section
of the sub-body before it. The frames follow the deflected beam, so that only the deflection *within* a sub-body has to
be small; with enough sub-bodies the chain converges to the geometrically exact beam. (Substructuring in the floating
frame of reference: Wu & Haug 1988, Int. J. Numer. Methods Eng. 26, 2211–2226; static tip modes with fixed-interface
modes: Craig & Bampton 1968, AIAA J. 6, 1313–1319.)

The frame of every sub-body is parallel to the frame of the whole beam in the undeformed state; its origin lies on the
reference axis at the cut. Arc lengths are those of the whole beam throughout.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import cast

import numpy as np
from numpy.typing import ArrayLike

from wt_gym.base.quantities import Array, Integers
from wt_gym.structure.beam import Beam, BeamSections
from wt_gym.structure.flexible_body import FlexibleBody, Marker, offset_marker
from wt_gym.structure.modes import ALL_DOFS, lowest_modes, nodal_basis


@dataclass(frozen=True)
class SubBody:
    """One sub-body of a cut beam.

    Attributes
    ----------
    body : FlexibleBody
        With the markers "root" and "tip".
    beam : Beam
        Finite elements of the sub-body in its own frame; node 0 is the cut.
    basis : array (n_dof, n)
        Nodal displacements per elastic coordinate.
    start, end : float
        Arc lengths of the cuts on the whole beam [m].
    """

    body: FlexibleBody
    beam: Beam
    basis: Array
    start: float
    end: float

    def marker(self, s: float, offset: ArrayLike = (0.0, 0.0, 0.0)) -> Marker:
        """A point carried by the section at arc length s of the whole beam, at an offset [m] in frame axes.

        Raises
        ------
        ValueError
            When s lies outside the sub-body.
        """
        if not self.start - 1e-9 <= s <= self.end + 1e-9:
            raise ValueError(f"arc length {s} lies outside the sub-body {self.body.name!r} [{self.start}, {self.end}]")
        return offset_marker(self.beam, self.basis, s, np.asarray(offset, dtype=float))


def cut_beam(
    name: str,
    sections: BeamSections,
    nodes: ArrayLike,
    cuts: int | Sequence[float] | Array,
    coordinates: str = "nodal",
    n_modes: int = 0,
    dofs: Sequence[int] = ALL_DOFS,
    stiffness_damping: float = 0.0,
) -> tuple[SubBody, ...]:
    """Cut a beam into sub-bodies.

    Parameters
    ----------
    name : str
        Pieces are called ``name_1`` … ``name_n``.
    sections : BeamSections
        Of the whole beam.
    nodes : array (n_nodes,) or int
        Arc lengths of the finite-element nodes [m], or the number of equal elements.
    cuts : int or array
        Number of sub-bodies with (nearly) equal numbers of elements, or the arc lengths of the inner cuts; each must be
        one of the nodes.
    coordinates : {"nodal", "modal"}
        Elastic coordinates of a sub-body: the displacements of its nodes behind the cut, or its static tip modes with
        ``n_modes`` vibration modes between fixed ends, which represent the tip marker exactly.
    n_modes : int
        Vibration modes between fixed ends of each sub-body (modal coordinates).
    dofs : sequence of int
        Degrees of freedom of each node that may move; without 2 a straight beam along z is inextensible, (0, 4) is
        bending in the x–z plane.
    stiffness_damping : float
        β [s] of a damping matrix β K.

    Returns
    -------
    tuple of SubBody
        From root to tip.

    Raises
    ------
    ValueError
        For cuts that are not nodes, more sub-bodies than elements, or unknown coordinates.
    """
    if np.isscalar(nodes):
        nodes = np.linspace(sections.station[0], sections.station[-1], int(cast(float, nodes)) + 1)
    nodes = np.asarray(nodes, dtype=float)
    bounds = _bounds(nodes, cuts)
    sub_bodies = []
    for k, (first, last) in enumerate(pairwise(bounds)):
        origin = sections.axis_at(nodes[first])
        own = BeamSections(sections.station, sections.stiffness, sections.inertia, sections.axis - origin)
        beam = Beam(own, nodes[first : last + 1])
        if coordinates == "nodal":
            basis = nodal_basis(beam, dofs)
        elif coordinates == "modal":
            basis = tip_and_interior_modes(beam, n_modes, dofs)
        else:
            raise ValueError(f"coordinates of a sub-body must be 'nodal' or 'modal', got {coordinates!r}")
        body = FlexibleBody.from_beam(f"{name}_{k + 1}", beam, basis)
        if stiffness_damping:
            body = replace(body, damping=stiffness_damping * body.stiffness)
        sub_bodies.append(SubBody(body, beam, basis, float(nodes[first]), float(nodes[last])))
    return tuple(sub_bodies)


def tip_and_interior_modes(beam: Beam, n_modes: int, dofs: Sequence[int] = ALL_DOFS) -> Array:
    """Static tip modes and vibration modes between fixed ends of a beam clamped at node 0.

    Parameters
    ----------
    n_modes : int
        Vibration modes between fixed ends; all of them together with the tip modes span every nodal displacement.
    dofs : sequence of int
        Degrees of freedom of each node that may move.

    Returns
    -------
    array (n_dof, n)
        One static mode for each degree of freedom of the tip, with unit displacement [m] or rotation [rad] there and
        the static shape between, then the vibration modes, mass-normalized, by ascending frequency.
    """
    last = len(beam.nodes) - 1
    interior = np.array([6 * node + dof for node in range(1, last) for dof in dofs], dtype=int)
    tip = np.array([6 * last + dof for dof in dofs])
    static = np.zeros((beam.n_dof, len(tip)))
    static[tip, np.arange(len(tip))] = 1.0
    if len(interior) == 0:
        return static
    inner = np.ix_(interior, interior)
    static[interior] = -np.linalg.solve(beam.stiffness[inner], beam.stiffness[np.ix_(interior, tip)])
    n_modes = min(n_modes, len(interior))
    if n_modes == 0:
        return static
    vibration = np.zeros((beam.n_dof, n_modes))
    vibration[interior] = lowest_modes(beam.stiffness[inner], beam.mass[inner], n_modes)[1]
    return np.hstack([static, vibration])


def sub_body_at(sub_bodies: Sequence[SubBody], s: float) -> int:
    """Number of the sub-body that carries the arc length s [m] of the whole beam; a cut belongs to the outer sub-body.

    Raises
    ------
    ValueError
        When s lies outside the beam.
    """
    if not sub_bodies[0].start - 1e-9 <= s <= sub_bodies[-1].end + 1e-9:
        raise ValueError(f"arc length {s} lies outside the beam [{sub_bodies[0].start}, {sub_bodies[-1].end}]")
    return max(0, int(np.searchsorted([p.start for p in sub_bodies], s + 1e-9) - 1))


def _bounds(nodes: Array, cuts: int | Sequence[float] | Array) -> Integers:
    """Node numbers of both ends and of the cuts."""
    n_elements = len(nodes) - 1
    if np.isscalar(cuts):
        number = cast(float, cuts)
        if not 1 <= int(number) <= n_elements:
            raise ValueError(f"a beam of {n_elements} elements must have 1 … {n_elements} sub-bodies, got {number}")
        return np.round(np.linspace(0, n_elements, int(number) + 1)).astype(int)
    inner = cast("Sequence[float]", cuts)
    found = [int(np.abs(nodes - s).argmin()) for s in inner]
    for s, node in zip(inner, found, strict=True):
        if abs(nodes[node] - s) > 1e-9 * nodes[-1]:
            raise ValueError(f"the cut at {s} is not a node of the beam; the nearest is {nodes[node]}")
    if np.any(np.diff([0, *found, n_elements]) <= 0):
        raise ValueError(f"cuts {list(inner)} must increase inside the beam")
    return np.array([0, *found, n_elements])
