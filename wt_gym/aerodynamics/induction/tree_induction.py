"""Work arrays of the induction, big calls split over threads, and the tree code.

The compiled functions are in `tree_induction_kernels` and `induction_kernels`; they allocate nothing, so the
arrays are made here, once.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any, NamedTuple, TypeVar

import numpy as np
from numpy.typing import DTypeLike, NDArray

from wt_gym.aerodynamics.induction.induction_kernels import direct_induction
from wt_gym.aerodynamics.induction.simd_kernels import WIDTH
from wt_gym.aerodynamics.induction.tree_induction_kernels import (
    BRANCHES,
    DIGIT,
    LIST,
    MEASURES,
    RECORD,
    STACK,
    TARGETS,
    TILE,
    grow_tree,
    order_targets,
    order_tiles,
    plant_leaves,
    tile_count,
    walk_blocks,
)
from wt_gym.aerodynamics.options import AerodynamicsError
from wt_gym.base.quantities import Array

LINES = 128
"""Bytes that the processor fetches together: two cache lines."""


def aligned_zeros(shape: int | tuple[int, ...], dtype: DTypeLike = np.float64) -> NDArray[Any]:
    """Zeros of a shape and type, in C order, in cache lines of their own.

    Vectors of 16 float32 numbers then lie in one cache line each, and threads do not wait for each other's writes.

    Parameters
    ----------
    shape : int or tuple of int
    dtype : data type

    Returns
    -------
    ndarray
    """
    size = int(np.prod(shape)) * np.dtype(dtype).itemsize
    memory = np.zeros(size + 2 * LINES, dtype=np.uint8)
    first = -memory.ctypes.data % LINES
    return memory[first : first + size].view(dtype).reshape(shape)


PADDED = 16
"""Points are repeated up to a multiple of this number: what is left over of vectors the compiler takes one by one."""


class RingWork(NamedTuple):
    """Work arrays of `bound_kernels.bound_influence`."""

    points: Array  # (3, n) repeated points [m]
    distance: Array  # (n_corner, n) of the corners of one blade [m]
    rings: Array  # (n_ring + 1, 3, n) velocity of each ring, and of none

    @classmethod
    def empty(cls, n_ring: int, n_corner: int, n_point: int) -> RingWork:
        """Arrays of the right shapes."""
        n = -(-n_point // PADDED) * PADDED
        return cls(aligned_zeros((3, n)), aligned_zeros((n_corner, n)), aligned_zeros((n_ring + 1, 3, n)))


class Tree(NamedTuple):
    """Arrays of the clusters of a sheet and of the order of the targets."""

    centers: NDArray[np.float32]  # (3, n_tile) middle nodes of the tiles [m]
    keys: NDArray[np.int32]  # (n_key,) of the sort, n_key the larger of tiles and targets
    spare_keys: NDArray[np.int32]  # (n_key,)
    spare_order: NDArray[np.int32]  # (n_key,)
    count: NDArray[np.int32]  # type: ignore[assignment]  # (DIGIT,) of the sort; hides the method of tuples
    tiles: NDArray[np.int32]  # (n_tile,) tiles in the order of the curve
    order: NDArray[np.int32]  # (n_key,) targets likewise
    bounds: NDArray[np.int32]  # (n_tile, 5) rows, sheet and nodes of a tile
    records: NDArray[np.float32]  # (n_cluster, RECORD) moments of each cluster, leaves first
    measures: NDArray[np.float32]  # (n_cluster, MEASURES) sizes
    reach: NDArray[np.float32]  # (n_cluster,) least distance [m]
    parts: NDArray[np.int32]  # (n_cluster, 2) first and last + 1 part
    root: NDArray[np.int32]  # (1,) number of the last cluster, which holds all others


class Block(NamedTuple):
    """Arrays of one block of targets, one set for each thread."""

    targets: NDArray[np.float32]  # (3, TARGETS) [m]
    velocity: NDArray[np.float32]  # (3, TARGETS) [m/s]
    segments: NDArray[np.float32]  # (2 TILE², 8) of one tile
    spheres: NDArray[np.float32]  # (1 + TARGETS / WIDTH, 4) center and radius of the block and of its vectors [m]
    far: NDArray[np.int32]  # (LIST,) gathered clusters
    near: NDArray[np.int32]  # (LIST,) gathered tiles
    group_far: NDArray[np.int32]  # (2 LIST,) clusters as one vector of targets sees them
    group_near: NDArray[np.int32]  # (LIST,) tiles as one vector of targets sees them
    stack: NDArray[np.int32]  # (STACK,) of the walk
    scratch: NDArray[np.float32]  # (4 WIDTH (TILE + 1)²,) vectors from the nodes of a tile
    acted: NDArray[np.int32]  # (2,) count of clusters and of tiles that acted on a vector of targets


Arrays = TypeVar("Arrays", Tree, Block)


def make_tree(n_row: int, n_sheet: int, n_node: int, n_target: int) -> Tree:
    """Work arrays for sheets of up to (n_row, n_sheet, n_node, 7) and up to n_target targets."""
    n_tile = tile_count(n_row, n_sheet, n_node)
    n_cluster, level = n_tile, n_tile
    while level > 1:
        level = -(-level // BRANCHES)
        n_cluster += level
    n_key = max(n_tile, n_target)
    integers = {
        "keys": n_key,
        "spare_keys": n_key,
        "spare_order": n_key,
        "count": DIGIT,
        "tiles": n_tile,
        "order": n_key,
        "bounds": (n_tile, 5),
        "parts": (n_cluster, 2),
        "root": 1,
    }
    reals = {
        "centers": (3, n_tile),
        "records": (n_cluster, RECORD),
        "measures": (n_cluster, MEASURES),
        "reach": n_cluster,
    }
    return _arrays(Tree, integers, reals)


def make_block() -> Block:
    """Work arrays of one thread."""
    integers = {"far": LIST, "near": LIST, "group_far": 2 * LIST, "group_near": LIST, "stack": STACK, "acted": 2}
    reals: dict[str, int | tuple[int, ...]] = {
        "targets": (3, TARGETS),
        "velocity": (3, TARGETS),
        "segments": (2 * TILE * TILE, 8),
        "spheres": (1 + TARGETS // WIDTH, 4),
        "scratch": 4 * WIDTH * (TILE + 1) ** 2,
    }
    return _arrays(Block, integers, reals)


def _arrays(
    kind: type[Arrays], integers: Mapping[str, int | tuple[int, ...]], reals: Mapping[str, int | tuple[int, ...]]
) -> Arrays:
    """Fill a named tuple with int32 and float32 arrays of the given shapes."""
    arrays = {name: aligned_zeros(shape, np.int32) for name, shape in integers.items()}
    arrays |= {name: aligned_zeros(shape, np.float32) for name, shape in reals.items()}
    return kind(**arrays)


# ---- threads ----

CHUNKS = 8  # parts of a range for each thread: some take longer than others

_pools: dict[int, ThreadPoolExecutor] = {}  # by number of threads

# The threads of a pool exist only in the process that started them.
if hasattr(os, "register_at_fork"):  # processes can be forked
    os.register_at_fork(after_in_child=_pools.clear)


def split_range(part: Callable[[int, int, int], None], n: int, step: int, n_threads: int) -> None:
    """Call ``part(first, last, thread)`` for equal parts of range(n), which the threads take in turn.

    The calling thread is number 0. The others are started at the first call and kept. They are Python threads, so
    ``part`` must release the interpreter's lock for most of its time, as a compiled function with ``nogil`` does.
    Unlike parallel compiled functions they survive a fork: a child process starts its own.

    Parameters
    ----------
    step : int
        Parts start at multiples of this.
    n_threads : int
        At least 1.
    """
    if n_threads < 1:
        raise AerodynamicsError(f"the number of threads is {n_threads}; it must be at least 1")
    n_step = -(-n // step)
    n_chunk = min(n_step, CHUNKS * n_threads) if n_threads > 1 else 1
    bounds = [min(n, n_step * k // max(n_chunk, 1) * step) for k in range(n_chunk + 1)]
    chunks = iter(range(n_chunk))  # the interpreter's lock gives each number to one thread

    def work(thread: int) -> None:
        for k in chunks:
            part(bounds[k], bounds[k + 1], thread)

    waiting = [_pool(n_threads).submit(work, t) for t in range(1, n_threads)]
    try:
        work(0)
    finally:
        for result in waiting:
            result.result()


def run_beside(function: Callable[[], None], other: Callable[[], None], n_threads: int) -> None:
    """Call two functions at once, ``other`` in the calling thread; one after the other with one thread."""
    if n_threads == 1:
        function()
        other()
        return
    result = _pool(n_threads).submit(function)
    try:
        other()
    finally:
        result.result()


def _pool(n_threads: int) -> ThreadPoolExecutor:
    if n_threads not in _pools:
        _pools[n_threads] = ThreadPoolExecutor(max_workers=n_threads - 1, thread_name_prefix="induction")
    return _pools[n_threads]


def split_direct(
    sheet: NDArray[np.float32],
    targets: NDArray[np.float32],
    velocity: NDArray[np.float32],
    scratch: Sequence[NDArray[np.float32]],
) -> None:
    """Add the velocity of all segments at all targets, in as many threads as there are rows of ``scratch``.

    Parameters
    ----------
    sheet : float32, (n_row, n_sheet, n_node, 7)
    targets, velocity : float32, (3, n)
        n is a multiple of 16.
    scratch : sequence of float32, (at least 128 n_node,)
        One for each thread.
    """
    if len(sheet) == 0:
        return

    def part(first: int, last: int, thread: int) -> None:
        direct_induction(sheet, targets, velocity, first, last, scratch[thread])

    split_range(part, targets.shape[1], WIDTH, len(scratch))


class TreeInduction:
    """Velocity of vortex sheets by the tree code, with its work arrays.

    Parameters
    ----------
    n_row, n_sheet, n_node : int
        Largest sheet.
    n_target : int
        Most targets of one call.
    n_threads : int
        Threads that share the targets.

    Raises
    ------
    AerodynamicsError
        If a size is below 1, a call exceeds the sizes, or its limit is not positive.
    """

    def __init__(self, n_row: int, n_sheet: int, n_node: int, n_target: int, n_threads: int = 1) -> None:
        sizes = {"n_row": n_row, "n_sheet": n_sheet, "n_node": n_node, "n_target": n_target, "n_threads": n_threads}
        for name, size in sizes.items():
            if size < 1:
                raise AerodynamicsError(f"TreeInduction: {name} is {size}; it must be at least 1")
        self.tree = make_tree(n_row, n_sheet, n_node, n_target)
        self.blocks = [make_block() for _ in range(n_threads)]

    def add_velocity(
        self,
        sheet: NDArray[np.float32],
        targets: NDArray[np.float32],
        velocity: NDArray[np.float32],
        limit: float,
        n_threads: int | None = None,
    ) -> None:
        """Add the velocity of all sheets at all targets.

        Parameters
        ----------
        sheet : float32, (n_row, n_sheet, n_node, 7)
            See `induction_kernels`.
        targets, velocity : float32, (3, n)
            Positions [m] and velocities [m/s].
        limit : float
            Root mean square error of the velocity that may be made, to its order of magnitude [m/s].
        n_threads : int, optional
            Use no more than these.
        """
        n_threads = n_threads or len(self.blocks)
        n = targets.shape[1]
        n_tile = tile_count(*sheet.shape[:3])
        if n_tile > len(self.tree.tiles) or n > len(self.tree.order):
            raise AerodynamicsError(
                f"the tree code was called with a sheet of {n_tile} tiles and {n} targets; its work arrays are made"
                f" for {len(self.tree.tiles)} tiles and {len(self.tree.order)} targets"
            )
        if not limit > 0.0:
            raise AerodynamicsError(f"the error limit of the tree code is {limit} m/s; it must be positive")
        if n == 0:
            return
        self._plant(sheet, targets, n, limit, n_threads)

        def part(first: int, last: int, thread: int) -> None:
            walk_blocks(sheet, self.tree, targets, n, velocity, first, last, self.blocks[thread])

        split_range(part, -(-n // TARGETS), 1, n_threads)

    def _plant(
        self, sheet: NDArray[np.float32], targets: NDArray[np.float32], n_target: int, limit: float, n_threads: int
    ) -> None:
        """Build the tree of a sheet and put the targets in order."""
        n_tile = order_tiles(sheet, self.tree)  # with the keys that the targets take next

        def part(first: int, last: int, thread: int) -> None:
            plant_leaves(sheet, self.tree, first, last, self.blocks[thread].segments)

        def leaves() -> None:
            split_range(part, n_tile, 1, n_threads)

        run_beside(lambda: order_targets(targets, n_target, self.tree), leaves, n_threads)
        grow_tree(self.tree, n_tile, limit)
