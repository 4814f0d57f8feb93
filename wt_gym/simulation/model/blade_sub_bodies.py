"""Blades of several floating-frame bodies: large deflections, and the torsion that bending makes, from small ones.

A blade is cut into sub-bodies (:mod:`wt_gym.structure.substructure`), each a body whose frame is clamped to the tip
section of the sub-body before it. The lattice nodes of a blade are shared out among the sub-bodies that carry their
sections.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from wt_gym.base.errors import SimulationError
from wt_gym.multibody.system import Joint, Points
from wt_gym.structure.flexible_body import offset_marker
from wt_gym.structure.modes import clamped_modes, select_modes
from wt_gym.structure.substructure import cut_beam, sub_body_at

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from numpy.typing import NDArray

    from wt_gym.multibody.system import MultibodySystem
    from wt_gym.simulation.fidelity import Fidelity
    from wt_gym.structure.beam import Beam
    from wt_gym.structure.flexible_body import FlexibleBody
    from wt_gym.structure.substructure import SubBody
    from wt_gym.turbines import Blade

__all__ = ["SubBodyNodes", "add_sub_bodies", "cut_blade", "sub_body_points", "tip_of_last_sub_body"]


class SubBodyNodes(NamedTuple):
    """Which lattice nodes of a blade each of its n sub-bodies carries, and room for them; short rows end in zeros."""

    count: NDArray[np.int64]  # type: ignore[assignment]  # (n,); hides the method of tuples
    node: NDArray[np.int64]  # (n, n_most) among the nodes of a blade
    position: NDArray[np.float64]  # (n_most, 3) scratch: of the nodes of one sub-body, or their forces
    velocity: NDArray[np.float64]  # (n_most, 3) scratch


def cut_blade(blade: Blade, beam: Beam, fidelity: Fidelity, dofs: tuple[int, ...]) -> tuple[SubBody, ...]:
    """Sub-bodies of a blade, from root to tip.

    Nodal sub-bodies have the displacements of their nodes as coordinates, modal ones the static shapes of their tip,
    one for each degree of freedom.

    The damping of a sub-body is in proportion to its stiffness, direction by direction, C_jk = K_jk √(β_j β_k), as in
    geometrically exact beam codes (Wang et al., Wind Energy 20, 2017, 1439, section 2): β = 2 ζ/ω, with the lowest
    frequency ω of the whole blade, clamped, for flap, edge and torsion. These modes then have the published ratio, and
    higher ones more, in proportion to their frequencies.

    Parameters
    ----------
    blade : Blade
    beam : Beam
        Of the whole blade.
    fidelity : Fidelity
    dofs : tuple of int
        Degrees of freedom of a node that may move.

    Returns
    -------
    tuple of Piece

    Raises
    ------
    SimulationError
        If there are more sub-bodies than finite elements.
    """
    if fidelity.blade_bodies > fidelity.blade_elements:
        raise SimulationError(
            f"Fidelity.blade_bodies is {fidelity.blade_bodies}: Fidelity.blade_elements = {fidelity.blade_elements} "
            f"make at most as many bodies"
        )
    if np.abs(beam.sections.axis[0]).max() > 1e-9:
        raise SimulationError(
            f"Fidelity.blade_bodies is {fidelity.blade_bodies}: the axis of the blade begins at "
            f"{beam.sections.axis[0]} m from the pitch axis; sub-bodies need one that begins there"
        )
    sub_bodies = cut_beam(
        "blade", beam.sections, beam.nodes, fidelity.blade_bodies, fidelity.blade_coordinates, dofs=dofs
    )
    by_dof = np.sqrt(_damping_times(blade, beam, dofs))
    damped = []
    for sub_body in sub_bodies:
        scale = np.tile(by_dof[list(dofs)], sub_body.basis.shape[1] // len(dofs))
        body = replace(sub_body.body, damping=scale[:, None] * sub_body.body.stiffness * scale)
        damped.append(replace(sub_body, body=body))
    return tuple(damped)


def _damping_times(blade: Blade, beam: Beam, dofs: tuple[int, ...]) -> NDArray[np.float64]:
    """β [s] of displacements and rotations along and about x, y, z (6,)."""
    if blade.damping_ratio == 0.0:
        return np.zeros(6)
    torsion = int(5 in dofs)
    modes = clamped_modes(beam, min(len(dofs) * beam.n_elements, 40), node_dofs=dofs)
    flap, edge = ((0 in dofs), (1 in dofs))
    chosen = select_modes(modes, flap=int(flap), edge=int(edge), torsion=torsion)
    found = iter(blade.damping_ratio / (np.pi * modes.frequency[chosen]))
    times = [next(found) if present else 0.0 for present in (flap, edge, torsion)]
    return np.array([times[0], times[1], max(times[:2]), times[1], times[0], times[2]])


def add_sub_bodies(
    system: MultibodySystem, sub_bodies: Sequence[SubBody], add_root: Callable[[FlexibleBody], int], name: str
) -> tuple[int, ...]:
    """Add the sub-bodies of a blade, each fixed to the tip of the one before; returns their indices from the root on.

    Parameters
    ----------
    system : MultibodySystem
    sub_bodies : sequence of SubBody
    add_root : callable
        Adds the first body and returns its index.
    name : str
        Of the blade.
    """
    parts: list[int] = []
    for k, sub_body in enumerate(sub_bodies, start=1):
        own = f"{name}_piece_{k}"
        names = tuple(f"{own}_{i + 1}" for i in range(sub_body.basis.shape[1]))
        body = replace(sub_body.body, name=own, coordinate_names=names)
        parts.append(system.add(body, Joint("fixed"), parts[-1], "tip") if parts else add_root(body))
    return tuple(parts)


def sub_body_points(sub_bodies: Sequence[SubBody], points: NDArray[np.float64]) -> tuple[Points, SubBodyNodes]:
    """Shapes of points (n_points, 3) in the frame of the whole blade, shared out among its sub-bodies.

    Returns
    -------
    points : Points
        position (n_sub_bodies, n_most, 3), linear (n_sub_bodies, n_most, 3, n_f),
        second (n_sub_bodies, n_most, 3, n_f, n_f).
    nodes : SubBodyNodes
    """
    sections = sub_bodies[0].beam.sections
    arc = np.interp(points[:, 2], sections.axis[:, 2], sections.station)
    carrier = np.array([sub_body_at(sub_bodies, s) for s in arc])
    count = np.bincount(carrier, minlength=len(sub_bodies))
    most, n_f = int(count.max()), max(p.basis.shape[1] for p in sub_bodies)
    node = np.zeros((len(sub_bodies), most), dtype=np.int64)
    shapes = Points(np.zeros((len(sub_bodies), most, 3)), np.zeros((len(sub_bodies), most, 3, n_f)),
                    np.zeros((len(sub_bodies), most, 3, n_f, n_f)))  # fmt: skip
    for k, sub_body in enumerate(sub_bodies):
        second, origin, n = (
            sub_body.beam.second_order_field(sub_body.basis),
            _origin(sub_bodies, k),
            sub_body.basis.shape[1],
        )
        for row, i in enumerate(np.flatnonzero(carrier == k)):
            node[k, row] = i
            offset = points[i] - origin - sub_body.beam.sections.axis_at(arc[i])
            marker = offset_marker(sub_body.beam, sub_body.basis, arc[i], offset, second)
            shapes.position[k, row] = marker.position
            shapes.linear[k, row, :, :n], shapes.second[k, row, :, :n, :n] = marker.linear, marker.second
    return shapes, SubBodyNodes(count.astype(np.int64), node, np.zeros((most, 3)), np.zeros((most, 3)))


def tip_of_last_sub_body(sub_bodies: Sequence[SubBody], tip: NDArray[np.float64]) -> Points:
    """The tip of a blade (3,), given in its frame, as a point of the last sub-body."""
    last = sub_bodies[-1]
    offset = tip - _origin(sub_bodies, -1) - last.beam.sections.axis_at(last.end)
    marker = offset_marker(last.beam, last.basis, last.end, offset)
    return Points(marker.position[None], np.ascontiguousarray(marker.linear[None]), marker.second[None].copy())


def _origin(sub_bodies: Sequence[SubBody], k: int) -> NDArray[np.float64]:
    """Origin of the frame of sub-body k in the frame of the blade (3,) [m]: all are parallel to it."""
    return sub_bodies[0].beam.sections.axis_at(sub_bodies[k].start)
