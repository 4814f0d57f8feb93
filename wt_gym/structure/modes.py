"""Vibration modes of a beam, the choice of a reduced basis, and of the coordinates of one body: nodal, modal or rigid.

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

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from wt_gym.base.quantities import Array
from wt_gym.structure import eigen_kernels
from wt_gym.structure.beam import Beam, BeamSections, skew
from wt_gym.structure.flexible_body import FlexibleBody, shape_damping


@dataclass(frozen=True)
class Modes:
    """Mass-normalized modes of a beam.

    Attributes
    ----------
    frequency : array (n,)
        Natural frequencies [Hz], ascending.
    shape : array (n_dof, n)
        Nodal displacements, mass-normalized (shapeᵀ M shape = 1, attached masses included).
    kind : tuple of str
        "flap" (motion along x), "edge" (along y), "torsion" or "axial", by the largest share of kinetic energy.
    """

    frequency: Array
    shape: Array
    kind: tuple[str, ...]


def clamped_modes(
    beam: Beam,
    n: int = 20,
    tip_mass: Array | None = None,
    spin: ArrayLike = 0.0,
    center: ArrayLike | None = None,
    node_dofs: Sequence[int] = (0, 1, 2, 3, 4, 5),
) -> Modes:
    """Modes of a beam, clamped at node 0 or on its foundation, optionally spinning with a constant angular velocity.

    Parameters
    ----------
    n : int
        Number of modes.
    tip_mass : array (6, 6), optional
        Mass matrix of a rigid body fixed to the last node.
    spin : float or array (3,)
        Angular velocity [rad/s]; a number means about x (a rotor turning about +x).
    center : array (3,), optional
        A point on the spin axis in the body frame, default the origin.
    node_dofs : sequence of int
        Degrees of freedom of each node that may move; (0, 4) gives bending in the x–z plane, (1, 3) in the y–z plane.

    Returns
    -------
    Modes
        For a spinning beam the modes of M ü + (K + K_spin) u = 0; gyroscopic terms couple the modes of one beam only
        weakly and are part of the multibody equations.
    """
    stiffness, mass = beam.stiffness.copy(), beam.mass.copy()
    if tip_mass is not None:
        mass[-6:, -6:] += tip_mass
    omega = np.array([spin, 0.0, 0.0]) if np.isscalar(spin) else np.asarray(spin, dtype=float)
    if np.any(omega != 0.0):
        stiffness += spin_stiffness(beam, omega, center)
    free = np.array([6 * node + k for node in range(beam.first_free, beam.n_dof // 6) for k in node_dofs])
    n = min(n, len(free))
    block = np.ix_(free, free)
    value, vector = lowest_modes(stiffness[block], mass[block], n)
    shape = np.zeros((beam.n_dof, n))
    shape[free] = vector
    return named_modes(beam, value, shape)


def named_modes(beam: Beam, value: Array, shape: Array) -> Modes:
    """`Modes` from λ (n,) [rad²/s²] and mass-normalized shapes (n_dof, n), which receive the signs of their tips."""
    shape = shape * _tip_sign(shape)
    return Modes(np.sqrt(np.maximum(value, 0.0)) / (2.0 * np.pi), shape, tuple(_kind(beam, s) for s in shape.T))


def lowest_modes(stiffness: ArrayLike, mass: ArrayLike, n: int) -> tuple[Array, Array]:
    """Lowest solutions of K φ = λ M φ with symmetric matrices; independent of the threads of any library.

    Parameters
    ----------
    stiffness, mass : array (n_dof, n_dof)
        K, and the positive definite M.
    n : int
        Number of solutions.

    Returns
    -------
    (array (n,), array (n_dof, n))
        λ, ascending, and the vectors φ with φᵀ M φ = 1.

    Raises
    ------
    ValueError
        When the mass matrix is not positive definite, or a matrix is not finite.
    """
    stiffness, mass = (np.array(matrix, dtype=float, order="C") for matrix in (stiffness, mass))
    lower, reduced, vectors = (np.zeros_like(mass) for _ in range(3))
    code = eigen_kernels.symmetric_modes(stiffness, mass, lower, reduced, vectors)
    if code == eigen_kernels.NOT_DEFINITE:
        raise ValueError("the mass matrix of a beam is not positive definite: some motion of its nodes moves no mass")
    value = np.diag(reduced)
    if code == eigen_kernels.NOT_CONVERGED or not np.isfinite(value.sum()):
        raise ValueError("no vibration modes were found: a matrix of the beam is not finite")
    lowest = np.argsort(value, kind="stable")[:n]
    return value[lowest], vectors[lowest].T


def spin_stiffness(beam: Beam, omega: Array, center: ArrayLike | None = None) -> Array:
    """Centrifugal stiffness (n_dof, n_dof): spin softening plus the geometric part of the centrifugal tension.

    From the potential −½ Σ m |ω × r|² of the mass points with r = x₀ + S q + ½ qᵀ H q, second order in q:

        K = Σ m (Sᵀ ω̃ ω̃ S + (ω̃ ω̃ x₀)·H).
    """
    center = np.zeros(3) if center is None else np.asarray(center, dtype=float)
    from wt_gym.structure.flexible_body import particle_fields  # circular by nature: fields know beams

    fields = particle_fields(beam, np.eye(beam.n_dof))
    w = skew(omega) @ skew(omega)
    pull = (beam.particle_position - center) @ w.T
    linear = np.einsum("p,pia,ij,pjb->ab", beam.particle_mass, fields.linear, w, fields.linear, optimize=True)
    result: Array = linear + fields.contract_second(beam.particle_mass[:, None] * pull)
    return result


def select_modes(modes: Modes, **count: int) -> list[int]:
    """Indices of the lowest modes of each kind.

    Parameters
    ----------
    **count
        Number required of each kind, e.g. ``flap=2, edge=1, torsion=0``.

    Returns
    -------
    list of int
        In the order of the keywords, each kind by ascending frequency.

    Raises
    ------
    ValueError
        When fewer modes of a kind were computed than required.
    """
    chosen = []
    for kind, number in count.items():
        found = [i for i, k in enumerate(modes.kind) if k == kind]
        if len(found) < number:
            raise ValueError(
                f"{kind} modes must be at most {len(found)}, the number among the {len(modes.kind)} computed modes; "
                f"got {number}"
            )
        chosen += found[:number]
    return chosen


def _tip_sign(shape: Array) -> Array:
    """Signs that make the dominant tip displacement (or rotation) of each mode positive."""
    tip = shape[-6:]
    dominant = np.abs(tip * np.array([1.0, 1.0, 1.0, 10.0, 10.0, 10.0])[:, None]).argmax(axis=0)
    return np.where(tip[dominant, np.arange(shape.shape[1])] < 0.0, -1.0, 1.0)


def _kind(beam: Beam, shape: Array) -> str:
    """Name of a mode by the share of kinetic energy in x, y, z displacement and in the rotation about z."""
    u = np.einsum("pia,a->pi", beam.particle_shape, shape)
    axial = np.zeros_like(shape)
    axial[5::6] = shape[5::6]
    twist = np.einsum("pia,a->pi", beam.particle_shape, axial)
    m = beam.particle_mass
    energy_twist = np.sum(m[:, None] * twist**2)
    energy = m @ (u - twist) ** 2
    names = ("flap", "edge", "axial", "torsion")
    return names[int(np.argmax([*energy, energy_twist]))]


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
    tip_mass: Array | None = None,
    damping_ratio: float = 0.0,
    markers: Mapping[str, float] | None = None,
) -> FlexibleBody:
    """A body whose frame lies at node 0 of a beam, clamped there or on its foundation, in the chosen coordinates.

    Parameters
    ----------
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


def nodal_basis(beam: Beam, dofs: Sequence[int] = ALL_DOFS) -> Array:
    """Unit displacements (n_dof, n) of all nodes of a beam that move, in the given degrees of freedom of a node."""
    return np.eye(beam.n_dof)[:, _moving(beam, dofs)]


def node_names(beam: Beam, dofs: Sequence[int] = ALL_DOFS) -> list[str]:
    """Names of the coordinates of `nodal_basis`."""
    return [f"node_{node}_{DOF_NAMES[dof]}" for node in range(beam.first_free, len(beam.nodes)) for dof in dofs]


def _moving(beam: Beam, dofs: Sequence[int]) -> list[int]:
    """Rows of the moving degrees of freedom among all of a beam."""
    return [6 * node + dof for node in range(beam.first_free, len(beam.nodes)) for dof in dofs]


def _nodal_damping(beam: Beam, dofs: Sequence[int], damping_ratio: float, tip_mass: Array | None) -> Array:
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
    result: Array = momentum @ shape_damping(stiffness, inertia, damping_ratio) @ momentum.T
    return result


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
