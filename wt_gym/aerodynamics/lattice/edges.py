"""Which edges of a blade shed the wake, and which segments its rings and the newest wake rings are made of."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from wt_gym.aerodynamics.options import AeroOptions

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

__all__ = ["SheddingEdge", "bound_segments"]


@dataclass(frozen=True)
class SheddingEdge:
    """The line along which one blade sheds its wake: trailing edge from root to tip, then the tip to the leading edge.

    Attributes
    ----------
    nodes : ndarray, shape (n_edge + 1,)
        Ring nodes on the line, as row * (n_span + 1) + column.
    rings : ndarray, shape (n_edge,)
        Ring, as row * n_span + strip, whose circulation each part of the line sheds.
    chord : ndarray, shape (n_edge + 1,)
        Local chord at the nodes [m].
    """

    nodes: NDArray[np.int64]
    rings: NDArray[np.int64]
    chord: NDArray[np.float64]

    @classmethod
    def of(cls, n_chord: int, n_span: int, edge_chord: ArrayLike, options: AeroOptions) -> SheddingEdge:
        """Edges that the options let shed."""
        n_node = n_span + 1
        corner = n_chord * n_node + n_span
        nodes, rings = [corner], []
        if options.trailing_edge_wake:
            nodes = [n_chord * n_node + j for j in range(n_node)]
            rings = [(n_chord - 1) * n_span + j for j in range(n_span)]
        if options.tip_wake:
            nodes += [i * n_node + n_span for i in range(n_chord - 1, -1, -1)]
            rings += [i * n_span + n_span - 1 for i in range(n_chord - 1, -1, -1)]
        line = np.array(nodes)
        return cls(line, np.array(rings), np.asarray(edge_chord, dtype=np.float64)[line % n_node])


def bound_segments(
    n_chord: int, n_span: int, edge_chord: NDArray[np.float64], edge: SheddingEdge, options: AeroOptions, has_wake: bool
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Distinct segments of the rings of one blade, with the newest wake rings if there is a wake.

    A newest wake ring lies between the shedding edge and the newest wake row and has the circulation of the ring it
    continues (Kutta condition). Where the sides of rings with equal circulation coincide nothing remains.

    Parameters
    ----------
    edge : SheddingEdge
    has_wake : bool

    Returns
    -------
    segments : ndarray, shape (n_segment, 4)
        Start, end, ring to which the segment counts positive and ring to which it counts negative (-1: none). Corners
        are the ring nodes followed by the nodes of the newest wake row.
    core : ndarray, shape (n_segment,)
        Core radius [m].
    """
    n_node = n_span + 1
    n_bound = (n_chord + 1) * n_node
    loops = []
    for i in range(n_chord):
        for j in range(n_span):
            fore, aft = i * n_node + j, (i + 1) * n_node + j
            loops.append((i * n_span + j, (fore, fore + 1, aft + 1, aft)))
    if has_wake:
        for e, ring in enumerate(edge.rings):
            loops.append((ring, (edge.nodes[e], edge.nodes[e + 1], n_bound + e + 1, n_bound + e)))
    sides: dict[tuple[int, int], dict[int, int]] = {}
    for ring, corners in loops:
        for start, end in zip(corners, corners[1:] + corners[:1], strict=True):
            key, sign = ((start, end), 1) if start < end else ((end, start), -1)
            rings = sides.setdefault(key, {})
            rings[ring] = rings.get(ring, 0) + sign
    chord = np.concatenate([np.tile(edge_chord, n_chord + 1), edge.chord])
    segments, cores = [], []
    for (start, end), rings in sides.items():
        plus = [ring for ring, sign in rings.items() if sign > 0]
        minus = [ring for ring, sign in rings.items() if sign < 0]
        if not plus and not minus:
            continue
        segments.append((start, end, *(plus or [-1]), *(minus or [-1])))
        share = options.wake_core if end >= n_bound else options.bound_core / n_chord
        cores.append(share * 0.5 * (chord[start] + chord[end]))
    return np.array(segments, dtype=np.int64), np.array(cores)
