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

import numpy as np

from wt_gym.structure.beam import BeamSections
from wt_gym.structure.flexible_body import BodyInertia, FlexibleBody, Marker
from wt_gym.structure.modes import clamped_modes

__all__ = ["COORDINATES", "body_from_beam", "circular_sections"]

COORDINATES = ("nodal", "modal", "rigid")


def body_from_beam(
    name,
    beam,
    coordinates="modal",
    *,
    n_modes=6,
    dofs=(0, 1, 2, 3, 4, 5),
    tip_mass=None,
    damping_ratio=0.0,
    markers=None,
) -> FlexibleBody:
    """A body clamped to its frame at node 0 of a beam, in the coordinates of one's choice.

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
        Mass matrix of what the tip carries; shapes the modes (modal coordinates).
    damping_ratio : float
        Ratio of the critical damping in the body alone, without what its tip carries: of each mode (modal), or of the
        first mode with damping in proportion to the stiffness (nodal).
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
        raise ValueError(f"coordinates of body {name!r} are {coordinates!r}; allowed: {', '.join(COORDINATES)}")
    if coordinates == "rigid":
        return _rigid(name, beam, markers)
    if coordinates == "modal":
        modes = clamped_modes(beam, n_modes, tip_mass=tip_mass, node_dofs=dofs)
        names = [f"{name}_mode_{i + 1}" for i in range(modes.shape.shape[1])]
        return FlexibleBody.from_beam(name, beam, modes.shape, damping_ratio, markers, names)
    keep = [(node, dof) for node in range(1, len(beam.nodes)) for dof in dofs]
    basis = np.eye(beam.n_dof)[:, [6 * node + dof for node, dof in keep]]
    kind = ("x", "y", "z", "turn_x", "turn_y", "turn_z")
    names = [f"{name}_node_{node}_{kind[dof]}" for node, dof in keep]
    body = FlexibleBody.from_beam(name, beam, basis, markers=markers, coordinate_names=names)
    first = clamped_modes(beam, 1, node_dofs=dofs).frequency[0]
    return replace(body, damping=damping_ratio / (np.pi * first) * body.stiffness)


def _rigid(name, beam, markers):
    """The undeformed beam as one rigid body."""
    mass, centre = beam.particle_mass.sum(), beam.particle_mass @ beam.particle_position / beam.particle_mass.sum()
    arm = beam.particle_position - centre
    inertia = np.einsum("p,pi,pj->ij", beam.particle_mass, arm, arm)
    inertia = np.trace(inertia) * np.eye(3) - inertia
    none = np.zeros
    points = {
        key: Marker(beam.sections.axis_at(s), none((3, 0)), none((3, 0, 0)), none((3, 0)))
        for key, s in ({"root": beam.nodes[0], "tip": beam.nodes[-1]} | dict(markers or {})).items()
    }
    return FlexibleBody(name, BodyInertia.rigid(mass, centre, inertia), none((0, 0)), none((0, 0)), points)


def circular_sections(length, diameter, *, youngs_modulus, shear_modulus, density, inner_diameter=0.0) -> BeamSections:
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
