"""Vibration modes of a beam and the choice of a reduced basis."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from wt_gym.structure import eigen_kernels
from wt_gym.structure.beam import skew

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import ArrayLike, NDArray

    from wt_gym.structure.beam import Beam

__all__ = ["Modes", "clamped_modes", "lowest_modes", "named_modes", "select_modes"]


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

    frequency: NDArray[np.float64]
    shape: NDArray[np.float64]
    kind: tuple[str, ...]


def clamped_modes(
    beam: Beam,
    n: int = 20,
    tip_mass: NDArray[np.float64] | None = None,
    spin: ArrayLike = 0.0,
    center: ArrayLike | None = None,
    node_dofs: Sequence[int] = (0, 1, 2, 3, 4, 5),
) -> Modes:
    """Modes of a beam, clamped at node 0 or on its foundation, optionally spinning with a constant angular velocity.

    Parameters
    ----------
    beam : Beam
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


def named_modes(beam: Beam, value: NDArray[np.float64], shape: NDArray[np.float64]) -> Modes:
    """`Modes` from λ (n,) [rad²/s²] and mass-normalized shapes (n_dof, n), which receive the signs of their tips."""
    shape = shape * _tip_sign(shape)
    return Modes(np.sqrt(np.maximum(value, 0.0)) / (2.0 * np.pi), shape, tuple(_kind(beam, s) for s in shape.T))


def lowest_modes(stiffness: ArrayLike, mass: ArrayLike, n: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
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


def spin_stiffness(beam: Beam, omega: NDArray[np.float64], center: ArrayLike | None = None) -> NDArray[np.float64]:
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
    out: NDArray[np.float64] = linear + fields.contract_second(beam.particle_mass[:, None] * pull)
    return out


def select_modes(modes: Modes, **count: int) -> list[int]:
    """Indices of the lowest modes of each kind.

    Parameters
    ----------
    modes : Modes
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


def _tip_sign(shape: NDArray[np.float64]) -> NDArray[np.float64]:
    """Signs that make the dominant tip displacement (or rotation) of each mode positive."""
    tip = shape[-6:]
    dominant = np.abs(tip * np.array([1.0, 1.0, 1.0, 10.0, 10.0, 10.0])[:, None]).argmax(axis=0)
    return np.where(tip[dominant, np.arange(shape.shape[1])] < 0.0, -1.0, 1.0)


def _kind(beam: Beam, shape: NDArray[np.float64]) -> str:
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
