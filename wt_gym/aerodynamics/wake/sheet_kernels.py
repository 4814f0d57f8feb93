"""Bound lattice and wake as sheets of merged segments, ready for `direct_induction`."""

from wt_gym.aerodynamics.induction.induction_kernels import FOUR_PI
from wt_gym.aerodynamics.lattice.load_kernels import chordwise_strength, spanwise_strength
from wt_gym.base.compiled import kernel

NO_CIRCULATION = 1e-12  # [m^2/s]
LAMB = 4.0 * 1.25643  # growth of the Lamb-Oseen core, rc^2 = 4 * 1.25643 nu t


@kernel(fastmath=False)
def _segment(sheet, entry, strength, core):
    """Strength and core (rc l)^2 of one segment, entries ``entry`` and ``entry + 1`` of a node."""
    # Products with such a strength become denormal numbers, on which the processor is ten times slower.
    sheet[entry] = strength / FOUR_PI if abs(strength) >= NO_CIRCULATION else 0.0
    # A core of zero would divide zero by zero at a target on the segment.
    sheet[entry + 1] = max(core, 1e-12)


@kernel(fastmath=False)
def _length2(p, q):
    return (p[0] - q[0]) ** 2 + (p[1] - q[1]) ** 2 + (p[2] - q[2]) ** 2


@kernel(fastmath=False, inline="always")
def build_bound_sheet(a, p, o, sheet):
    """Write the bound rings, merged with the newest wake rings where they touch, relative to ``a.origin``.

    sheet : float32 (n_chord + 1, n_blade, n_node, 7).
    """
    nodes, gamma = a.nodes, a.gamma
    n_blade, n_row, n_node, _ = nodes.shape
    n_chord, n_span = n_row - 1, n_node - 1
    n_trailing = n_span if o.edge_wake else 0
    wake = a.n_rows[0] > 0
    for k in range(n_row):
        for b in range(n_blade):
            for j in range(n_node):
                here = nodes[b, k, j]
                for c in range(3):
                    sheet[k, b, j, c] = here[c] - a.origin[c]
                core2 = (o.wake_core * p.edge_chord[j]) ** 2
                trailing, trailing_core, span, span_core = 0.0, 1.0, 0.0, 1.0
                if k > 0:
                    trailing = chordwise_strength(gamma, b, k - 1, j, False)
                    if wake and o.tip_wake and j == n_span:
                        trailing -= a.wake_gamma[0, b, n_trailing + n_chord - k]
                    trailing_core = core2 * _length2(here, nodes[b, k - 1, j])
                if j > 0:
                    span = spanwise_strength(gamma, b, k, j - 1, False)
                    if wake and o.edge_wake and k == n_chord:
                        span += a.wake_gamma[0, b, j - 1]
                    span_core = core2 * _length2(here, nodes[b, k, j - 1])
                _segment(sheet[k, b, j], 3, trailing, trailing_core)
                _segment(sheet[k, b, j], 5, span, span_core)


@kernel(fastmath=False, inline="always")
def _bend_weights(a, o, k):
    """Row ``middle`` and the weights of the rows before, at and after it with which the corners of row k move.

    Corners move against the second derivative with respect to age, by two thirds of the mean of two sagittas.
    """
    middle = min(k, a.n_rows[0] - 1)
    if not o.curved or middle < 3:
        return 0, 0.0, 0.0
    before, behind = a.age[middle] - a.age[middle - 1], a.age[middle + 1] - a.age[middle]
    weight = (before * before + behind * behind) / (12.0 * (before + behind))
    return middle, weight / before, weight / behind


@kernel(fastmath=False, inline="always")
def _place_corner(a, k, b, j, middle, fore, aft, corner):
    """Position of node j of row k as a corner of the sheet, relative to ``a.origin``."""
    for c in range(3):
        corner[c] = a.wake[k, b, j, c] - a.origin[c]
    if aft > 0.0:
        for c in range(3):
            x = a.wake[middle, b, j, c]
            bend = aft * (a.wake[middle + 1, b, j, c] - x) - fore * (x - a.wake[middle - 1, b, j, c])
            corner[c] -= bend


@kernel(fastmath=False, separate=True)
def build_wake_sheet(a, p, o, first, last, grow, newest, sheet):
    """Write wake rows first..last as a sheet of merged segments, relative to ``a.origin``.

    Row 0 holds the ring nodes at the shedding edge, from which the trailing segments of row 1 come. A segment shared by
    two rings carries the difference of their circulations. The sheet ends where the sparse part begins. While a far
    wake is active the last spanwise segments of the wake are left out: the cylinders continue there.

    Parameters
    ----------
    a, p, o : AeroArrays, PlanformArrays, AeroConstants
    first, last : int
        Rows to write.
    grow : float
        Time by which the cores grow now [s]; negative: cores as if the segments had kept their length since shed.
    newest : bool
        With the newest ring, between edge and row 1. Without it, it belongs to the unknowns of the boundary condition,
        and only rows from 1 on are meant to be used.
    sheet : float32 (n_max + 1, n_blade, n_edge + 1, 7)
    """
    wake, age, n_rows = a.wake, a.age, a.n_rows[0]
    _, n_blade, n_node, _ = wake.shape
    n_bound = a.nodes.shape[2]
    closed = a.far[0] == 0.0
    end = min(n_rows, o.sparse_from)
    for k in range(first, min(last, end) + 1):
        middle, fore, aft = _bend_weights(a, o, k)
        for b in range(n_blade):
            for j in range(n_node):
                here = sheet[k, b, j]
                if k == 0:
                    row, column = p.shed_nodes[j] // n_bound, p.shed_nodes[j] % n_bound
                    for c in range(3):
                        here[c] = a.nodes[b, row, column, c] - a.origin[c]
                    _segment(here, 3, 0.0, 1.0)
                    _segment(here, 5, 0.0, 1.0)
                    continue
                _place_corner(a, k, b, j, middle, fore, aft, here)
                trailing, span = 0.0, 0.0
                if newest or k > 1:
                    trailing = (a.wake_gamma[k - 1, b, j - 1] if j > 0 else 0.0) - (
                        a.wake_gamma[k - 1, b, j] if j < n_node - 1 else 0.0
                    )
                if j > 0:
                    span = a.wake_gamma[k, b, j - 1] if k < end else 0.0
                    if (newest or k > 1) and (closed or k < n_rows):
                        span -= a.wake_gamma[k - 1, b, j - 1]
                core2 = (o.wake_core * p.shed_chord[j]) ** 2
                start = wake[k - 1, b, j]
                if k == 1:
                    row, column = p.shed_nodes[j] // n_bound, p.shed_nodes[j] % n_bound
                    start = a.nodes[b, row, column]
                for side in range(2):
                    strength = trailing if side == 0 else span
                    if side == 1:
                        start = wake[k, b, max(j - 1, 0)]
                    length2 = _length2(wake[k, b, j], start)
                    spread = LAMB * (o.viscosity + o.squire * abs(strength))
                    core = (core2 + spread * age[k]) * length2
                    if o.strain:
                        # rows 1 and 2 are still being laid down; their segments get their length now
                        length = length2**0.5
                        if grow < 0.0 or k <= 2:
                            a.volume[k, b, j, side] = core / max(length, 1e-9)
                        else:
                            a.volume[k, b, j, side] += spread * length * grow
                        core = a.volume[k, b, j, side] * length
                    _segment(here, 3 + 2 * side, strength, core)


@kernel(fastmath=False, separate=True)
def build_sparse_sheet(a, p, o, grow, sheet):
    """Write the rows from ``sparse_from`` on, in which only the carrying nodes hold vortices.

    Rings between two carrying nodes are merged with their mean circulation, weighted as in `state.sparse_span`. The
    sheet starts with the spanwise segments that close its first rings; cores are those of the segment of the wake next
    to the node.

    Parameters
    ----------
    a, p, o, grow
        As for `build_wake_sheet`.
    sheet : float32 (n_max + 1 - sparse_from, n_blade, n_sparse, 7)
    """
    wake, age, n_rows = a.wake, a.age, a.n_rows[0]
    n_sparse = p.sparse_nodes.shape[0]
    closed = a.far[0] == 0.0
    for k in range(o.sparse_from, n_rows + 1):
        middle, fore, aft = _bend_weights(a, o, k)
        starts = k == o.sparse_from
        for b in range(wake.shape[1]):
            # circulation of the merged rings ahead of the row and behind it, inboard and outboard of the node
            ahead_in, behind_in = 0.0, 0.0
            for i in range(n_sparse):
                j = p.sparse_nodes[i]
                ahead_out, behind_out = 0.0, 0.0
                if i < n_sparse - 1:
                    for strip in range(j, p.sparse_nodes[i + 1]):
                        if not starts:
                            ahead_out += p.sparse_weight[strip] * a.wake_gamma[k - 1, b, strip]
                        if k < n_rows:
                            behind_out += p.sparse_weight[strip] * a.wake_gamma[k, b, strip]
                here = sheet[k - o.sparse_from, b, i]
                _place_corner(a, k, b, j, middle, fore, aft, here)
                core2 = (o.wake_core * p.shed_chord[j]) ** 2
                for side in range(2):
                    strength = ahead_in - ahead_out
                    start, next_start = wake[k - 1, b, j], wake[k - 1, b, j]
                    if side == 1:
                        strength = behind_in - ahead_in if (closed or k < n_rows) else 0.0
                        start, next_start = wake[k, b, p.sparse_nodes[max(i - 1, 0)]], wake[k, b, max(j - 1, 0)]
                    length2, next2 = _length2(wake[k, b, j], start), _length2(wake[k, b, j], next_start)
                    spread = LAMB * (o.viscosity + o.squire * abs(strength))
                    core = (core2 + spread * age[k]) * length2
                    if o.strain and not (starts and side == 0):  # that segment belongs to the sheet before
                        length = max(next2**0.5, 1e-9)
                        if grow < 0.0:
                            a.volume[k, b, j, side] = (core2 + spread * age[k]) * length
                        else:
                            a.volume[k, b, j, side] += spread * length * grow
                        core = a.volume[k, b, j, side] / length * length2
                    _segment(here, 3 + 2 * side, strength, core)
                ahead_in, behind_in = ahead_out, behind_out
