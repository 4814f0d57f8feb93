"""Nodal, modal or rigid: the choice of coordinates of one body, and beams of circular section.

Nada & Al-Shahrani (2019, Mech. Sci. 10, 35–46) write the position of a point of body i in the floating frame of
reference as

    rⁱ = Rⁱ + Aⁱ(θⁱ) (ū₀ⁱ + Sⁱ Bⁱ q_fⁱ),

with the Cartesian position Rⁱ of the body frame, its Euler parameters θⁱ, the shape functions Sⁱ of two-node
three-dimensional beam elements, and the matrix Bⁱ that picks the element's nodal coordinates. They mix three sets in
one model:

* *Cartesian* coordinates and Euler parameters alone for a body without q_f (nacelle, rotor hub);
* *nodal* coordinates q_f, the displacements and rotations of the nodes, for a body that turns fast (blades), with the
  geometric stiffness of the rotation;
* *modal* coordinates p with q_f = B_m p, the lowest eigenvectors of K_ff − ω² M_ff under the body's boundary
  conditions, for a body that deflects in simple shapes (the tower).

Here the same three are three bases for one function, `body_from_beam`. The reference coordinates (Rⁱ, θⁱ) belong to the
joint: a ``free`` joint has exactly three positions and four Euler parameters; every other joint is what is left of them
after its constraints are eliminated. The second-order (foreshortening) displacement that gives the geometric stiffness
is part of every flexible body, nodal or modal.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from wt_gym.structure.beam import BeamSections
from wt_gym.structure.flexible_body import FlexibleBody, shape_damping
from wt_gym.structure.modes import clamped_modes

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from wt_gym.structure.beam import Beam

__all__ = ["ALL_DOFS", "COORDINATES", "body_from_beam", "circular_sections", "nodal_basis", "node_names"]

COORDINATES = ("nodal", "modal", "rigid")
ALL_DOFS = (0, 1, 2, 3, 4, 5)
"""Degrees of freedom of a node: displacements along x, y, z and rotations about them."""
DOF_NAMES = ("x", "y", "z", "turn_x", "turn_y", "turn_z")


def body_from_beam(
    name: str,
    beam: Beam,
    coordinates: str = "modal",
    *,
    n_modes: int = 6,
    dofs: Sequence[int] = ALL_DOFS,
    tip_mass: NDArray[np.float64] | None = None,
    damping_ratio: float = 0.0,
    markers: Mapping[str, float] | None = None,
) -> FlexibleBody:
    """A body whose frame lies at node 0 of a beam, clamped there or on its foundation, in the chosen coordinates.

    Parameters
    ----------
    name : str
    beam : Beam
    coordinates : {"nodal", "modal", "rigid"}
        q_f itself; the lowest modes p of the clamped beam, q_f = B_m p; or no elastic coordinates.
    n_modes : int
        Number of modes (modal coordinates).
    dofs : sequence of int
        Degrees of freedom of each node that may move; without 2 a straight beam along z is inextensible, which the
        second-order displacement takes into account and explicit integrators like.
    tip_mass : array (6, 6), optional
        Mass matrix of what the tip carries; shapes the modes.
    damping_ratio : float
        Ratio of the critical damping of each mode in the body alone, without what its tip carries.
    markers : dict of str to float, optional
        Arc lengths of named points on the axis besides "root" and "tip".

    Returns
    -------
    FlexibleBody

    Raises
    ------
    ValueError
        For coordinates that are not one of `COORDINATES`.
    """
    if coordinates not in COORDINATES:
        raise ValueError(f"coordinates of body {name!r} are {coordinates!r}; must be one of {', '.join(COORDINATES)}")
    if coordinates == "modal":
        modes = clamped_modes(beam, n_modes, tip_mass=tip_mass, node_dofs=dofs)
        names = [f"{name}_mode_{i + 1}" for i in range(modes.shape.shape[1])]
        return FlexibleBody.from_beam(name, beam, modes.shape, damping_ratio, markers, names)
    dofs = dofs if coordinates == "nodal" else ()
    names = [f"{name}_{node}" for node in node_names(beam, dofs)]
    body = FlexibleBody.from_beam(name, beam, nodal_basis(beam, dofs), markers=markers, coordinate_names=names)
    if not dofs or damping_ratio == 0.0:
        return body
    return replace(body, damping=_nodal_damping(beam, dofs, damping_ratio, tip_mass))


def nodal_basis(beam: Beam, dofs: Sequence[int] = ALL_DOFS) -> NDArray[np.float64]:
    """Unit displacements (n_dof, n) of all nodes of a beam that move, in the given degrees of freedom of a node."""
    return np.eye(beam.n_dof)[:, _moving(beam, dofs)]


def node_names(beam: Beam, dofs: Sequence[int] = ALL_DOFS) -> list[str]:
    """Names of the coordinates of `nodal_basis`."""
    return [f"node_{node}_{DOF_NAMES[dof]}" for node in range(beam.first_free, len(beam.nodes)) for dof in dofs]


def _moving(beam: Beam, dofs: Sequence[int]) -> list[int]:
    """Rows of the moving degrees of freedom among all of a beam."""
    return [6 * node + dof for node in range(beam.first_free, len(beam.nodes)) for dof in dofs]


def _nodal_damping(
    beam: Beam, dofs: Sequence[int], damping_ratio: float, tip_mass: NDArray[np.float64] | None
) -> NDArray[np.float64]:
    """Damping matrix of nodal coordinates, damped as the body of all its modes is.

    With modes Φ, shaped by what the tip carries, and their damping matrix C the nodes have P C Pᵀ, P = M Φ (Φᵀ M Φ)⁻¹.
    Damping in proportion to the stiffness would overdamp the highest modes beyond what explicit steps can follow.
    """
    rows = _moving(beam, dofs)
    mass = beam.mass.copy()
    if tip_mass is not None:
        mass[-6:, -6:] += tip_mass
    shapes = clamped_modes(beam, len(rows), tip_mass=tip_mass, node_dofs=dofs).shape[rows]
    momentum = mass[np.ix_(rows, rows)] @ shapes
    stiffness, inertia = (shapes.T @ matrix[np.ix_(rows, rows)] @ shapes for matrix in (beam.stiffness, beam.mass))
    out: NDArray[np.float64] = momentum @ shape_damping(stiffness, inertia, damping_ratio) @ momentum.T
    return out


def circular_sections(
    length: float,
    diameter: float,
    *,
    youngs_modulus: float,
    shear_modulus: float,
    density: float,
    inner_diameter: float = 0.0,
) -> BeamSections:
    """Sections of a straight uniform rod or tube along z.

    With the second moment of area I = π (D⁴ − d⁴)/64 the section has EA, equal bending stiffness EI about every
    transverse axis, torsional stiffness G·2I, mass ρA and rotary inertia ρI (the polar one is 2ρI). Cut by `Beam`, each
    element has the 12 nodal coordinates and the matrices of the three-dimensional two-node element of circular section.

    Parameters
    ----------
    length, diameter, inner_diameter : float
        [m].
    youngs_modulus, shear_modulus : float
        [Pa].
    density : float
        [kg/m³].

    Raises
    ------
    ValueError
        For dimensions without meaning.
    """
    if not (length > 0.0 and diameter > inner_diameter >= 0.0):
        raise ValueError(
            f"a tube needs length > 0 and diameter > inner_diameter >= 0, got {length}, {diameter}, {inner_diameter}"
        )
    area = np.pi * (diameter**2 - inner_diameter**2) / 4.0
    second_moment = np.pi * (diameter**4 - inner_diameter**4) / 64.0
    return BeamSections.uniform(
        length,
        EA=youngs_modulus * area,
        EIx=youngs_modulus * second_moment,
        EIy=youngs_modulus * second_moment,
        GJ=2.0 * shear_modulus * second_moment,
        mass=density * area,
        Ix=density * second_moment,
        Iy=density * second_moment,
    )
