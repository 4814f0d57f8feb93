"""The induction of big wakes, done between the compiled calls of a step by the tree code, in several threads."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

import numpy as np

from wt_gym.aerodynamics.induction.aligned import aligned_zeros
from wt_gym.aerodynamics.induction.simd_kernels import WIDTH
from wt_gym.aerodynamics.induction.tree_induction import TreeInduction, split_direct
from wt_gym.aerodynamics.wake.far_wake_kernels import far_wake_velocity
from wt_gym.aerodynamics.wake.wake_kernels import fold_images, mean_induced, pad_targets, wake_sheets

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from wt_gym.aerodynamics.options import AeroOptions
    from wt_gym.aerodynamics.state import AeroConstants, AeroState, AeroWork, PlanformArrays

__all__ = ["SplitInduction", "SplitLattice"]

SLOWEST = 0.01
"""Mean induced velocity [m/s] below which the tolerance of the tree code is no longer relative to it."""


class SplitLattice(Protocol):
    """What of a `VortexLattice` the induction of its wake takes."""

    @property
    def options(self) -> AeroOptions:
        """With the tolerance of the tree code."""

    @property
    def arrays(self) -> PlanformArrays:
        """With the table of the far wake."""

    @property
    def constants(self) -> AeroConstants:
        """Numbers as the kernels take them."""

    @property
    def work(self) -> AeroWork:
        """Work arrays."""


class SplitInduction:
    """Velocities of bound lattice, wake and far wake for one lattice, outside of its compiled step.

    Parameters
    ----------
    lattice : SplitLattice
        With the tolerance of the tree code in its options.
    threads : int
        At least 1.
    """

    def __init__(self, lattice: SplitLattice, threads: int) -> None:
        o, w = lattice.options, lattice.work
        self._lattice, self._work, self.threads = lattice, w, threads
        n_row, n_blade, n_node, _ = w.wake_sheet.shape
        widest = max(n_node, w.bound_sheet.shape[2])
        self._scratch = [aligned_zeros(8 * WIDTH * widest, np.float32) for _ in range(threads)]
        self._lane = np.zeros(8 * w.targets.shape[2], dtype=np.float32)
        self._tree = TreeInduction(n_row, n_blade, n_node, w.targets.shape[2], threads)
        self._tolerance = o.tree_tolerance

    def at_points(self, state: AeroState, n_threads: int) -> None:
        """Velocity of the wake, without its newest ring, at the points of the blades, into ``state``."""
        a, w = state.arrays, self._work
        n = w.points.shape[1]
        w.targets[0, :, :n] = w.points - a.origin[:, None]
        self.at_targets(state, w.bound_sheet[:0], 1, n, n_threads)
        a.wake_flow[:] = w.velocity[0, :, :n]

    def at_targets(
        self, state: AeroState, bound_sheet: NDArray[np.float32], first: int, n_target: int, n_threads: int
    ) -> None:
        """Velocity at the first ``n_target`` targets of the work arrays, into their velocity, by so many threads.

        What induces it: ``bound_sheet``, the wake from row ``first`` on and the far wake.
        """
        a, w, constants = state.arrays, self._work, self._lattice.constants
        wake_sheet, sparse_sheet = wake_sheets(a, constants, w, first)
        scratch = self._scratch[:n_threads]
        n_padded = pad_targets(w, n_target, constants, a.origin)
        limit = self._tolerance * max(mean_induced(a, state.n_rows + 1), SLOWEST)
        for image in range(2 if constants.has_ground else 1):
            targets = np.ascontiguousarray(w.targets[image, :, :n_padded])
            velocity = np.zeros_like(targets)
            # in the order of `induced_at`, for the same rounding
            split_direct(bound_sheet, targets, velocity, scratch)
            self._tree.add_velocity(wake_sheet, targets, velocity, limit, n_threads)
            split_direct(sparse_sheet, targets, velocity, scratch)
            if a.far[0] > 0.0:
                table = self._lattice.arrays.cylinder_table
                far_wake_velocity(a, table, targets, velocity, self._lane[: 8 * n_padded].reshape(8, n_padded))
            w.velocity[image, :, :n_padded] = velocity
        fold_images(constants, w, n_target)
