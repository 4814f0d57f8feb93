"""Work arrays for the influence of the bound rings at the points of the blades or of bodies."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from wt_gym.aerodynamics.induction.aligned import aligned_zeros

if TYPE_CHECKING:
    from numpy.typing import NDArray

__all__ = ["RingWork"]

PADDED = 16
"""Points are repeated up to a multiple of this number: what is left over of vectors the compiler takes one by one."""


class RingWork(NamedTuple):
    """Work arrays of `bound_kernels.bound_influence`."""

    points: NDArray[np.float64]  # (3, n) repeated points [m]
    distance: NDArray[np.float64]  # (n_corner, n) of the corners of one blade [m]
    rings: NDArray[np.float64]  # (n_ring + 1, 3, n) velocity of each ring, and of none

    @classmethod
    def empty(cls, n_ring: int, n_corner: int, n_point: int) -> RingWork:
        """Arrays of the right shapes."""
        n = -(-n_point // PADDED) * PADDED
        return cls(aligned_zeros((3, n)), aligned_zeros((n_corner, n)), aligned_zeros((n_ring + 1, 3, n)))
