"""Stiffness of a pile in the ground, seen from its head."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from wt_gym.structure.beam import Beam, BeamSections

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import ArrayLike, NDArray

__all__ = ["pile_head_stiffness"]

ELEMENTS_PER_LENGTH = 8
"""Elements to the length 1/β = (4 EI/k)^¼ over which the deflection of a pile dies away: 1e-5 of the stiffness."""


def pile_head_stiffness(
    length: float,
    lateral: Callable[[NDArray[np.float64]], ArrayLike],
    *,
    EA: float,
    EI: float,
    GJ: float,
    axial: float,
    torsional: float,
    base_lateral: float = 0.0,
) -> NDArray[np.float64]:
    """Stiffness of the head of an upright pile on springs along its length (Winkler), all else condensed statically.

    The ground resists the displacement of the pile by k(d) per length at the depth d. On a pile much longer than
    1/β = (4 EI/k)^¼ with a constant k the head has (M. Hetényi, Beams on Elastic Foundation, 1946, section 10)

        K_uu = 4 EI β³,   K_uθ = ∓2 EI β²,   K_θθ = 2 EI β.

    Parameters
    ----------
    length : float
        Embedded length [m].
    lateral : callable
        k [N/m²] at depths (n,) below the head [m].
    EA, EI, GJ : float
        Axial [N], bending and torsional stiffness [N m²] of the pile.
    axial, torsional : float
        Friction along the shaft against settlement [N/m²] and against twist [N m/(rad m)].
    base_lateral : float
        Shear under the tip [N/m].

    Returns
    -------
    array (6, 6)
        For `wt_gym.turbines.Support.foundation`: displacements along and rotations about x, y, z (up).

    Raises
    ------
    ValueError
        For lengths or stiffnesses that are not positive.
    """
    depth = np.linspace(0.0, length, 201)
    springs = np.asarray(lateral(depth), dtype=float) * np.ones_like(depth)
    given = {"length": length, "EA": EA, "EI": EI, "GJ": GJ, "axial": axial, "torsional": torsional}
    for name, value in given.items():
        if not (np.isfinite(value) and value > 0.0):
            raise ValueError(f"{name} of a pile is {value}; it must be positive and finite")
    if not (np.all(np.isfinite(springs)) and np.all(springs >= 0.0) and np.any(springs > 0.0)):
        raise ValueError("lateral springs of a pile must be finite, nowhere negative, and somewhere positive [N/m^2]")
    beta = (springs.max() / (4.0 * EI)) ** 0.25
    sections = BeamSections.uniform(length, EA=EA, EIx=EI, EIy=EI, GJ=GJ, mass=1.0)
    beam = Beam(sections, max(int(np.ceil(ELEMENTS_PER_LENGTH * beta * length)), 8))
    total = beam.stiffness.copy()
    x, w = np.polynomial.legendre.leggauss(4)
    for e, (low, high) in enumerate(zip(beam.nodes[:-1], beam.nodes[1:], strict=True)):
        shape = beam.shape(np.full(4, e), 0.5 * (x + 1.0))
        # the beam's z axis points up from the tip of the pile
        place = low + 0.5 * (x + 1.0) * (high - low)
        resisting = np.zeros((4, 6))
        resisting[:, :2] = np.asarray(lateral(length - place), dtype=float).reshape(-1, 1) * np.ones((4, 1))
        resisting[:, 2], resisting[:, 5] = axial, torsional
        weight = 0.5 * w * (high - low)
        i = slice(6 * e, 6 * e + 12)
        total[i, i] += np.einsum("g,gk,gka,gkb->ab", weight, resisting, shape, shape, optimize=True)
    total[0, 0] += base_lateral
    total[1, 1] += base_lateral
    inner, head = slice(0, -6), slice(-6, None)
    condensed = total[head, head] - total[head, inner] @ np.linalg.solve(total[inner, inner], total[inner, head])
    return 0.5 * (condensed + condensed.T)
