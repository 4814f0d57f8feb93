"""The geometry of a blade or wing as a vortex lattice: camber surface, shedding edges, tables of separation.

Static polars split into attached and fully separated flow, the tables of the dynamic stall model.

The flow about a section is a mixture: attached up to the separation point, f chords behind the leading edge (f = 1 at
the trailing edge), separated behind it. In Kirchhoff's flow past a flat plate the lift is cl = cla (alpha - alpha0)
((1 + sqrt f) / 2)^2. Solved for f, this gives the static separation point fst(alpha) of any polar, and what remains is
the lift of fully separated flow: cl_st = fst cla (alpha - alpha0) + (1 - fst) cl_fs (Oeye, 4th IEA Symposium on the
Aerodynamics of Wind Turbines, 1991; Hansen, Gaunaa & Madsen, Risoe-R-1354, 2004).

Polars that lose their lift within a few degrees fall faster than Kirchhoff's flow: then cl_fs would fall, too, at once.
A circulation, which cannot follow at once, would belong to several angles of attack, and the lattice, the more so the
finer its steps, would jump from one to the other. Such a fall is therefore given to the separation point: cl_fs is
replaced by the largest lift below it that does not fall with the angle, and fst follows from the polar.
"""

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from numbers import Integral
from typing import TypeAlias, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from wt_gym.aerodynamics.options import AerodynamicsError, AeroOptions
from wt_gym.base.attached_flow import attached_lift
from wt_gym.base.quantities import Array, Integers

MOST_LISTED = 8  # panels that a message names
SECTION_FIELDS = ("alpha0_lattice", "lift_slope", "moment0_lattice", "slope_angle")
ARRAY_FIELDS = ("nodes", "chord", "edge_chord", "span_edges", "polars", *SECTION_FIELDS)
Camber: TypeAlias = Callable[[float, ArrayLike], tuple[ArrayLike, ArrayLike]]
"""Height and slope of a camber line, in chords, at a span coordinate [m] and chord fractions."""
FINE_PANELS = 48  # the zero-lift angle of measured camber lines is converged to 0.05 degrees


@dataclass(frozen=True)
class SectionLattice:
    """Properties of the two-dimensional lattice of one camber line.

    Attributes
    ----------
    heights : ndarray, shape (n_chord + 1,)
        Heights of the ring nodes above the chord line, in chords.
    zero_lift_angle : float
        Angle of attack at which the section of this lattice has no circulation [rad].
    lift_slope : float
        K in cl = K sin(alpha - zero_lift_angle); 2 pi for a flat section, slightly more with camber [1/rad].
    zero_lift_moment : float
        Moment coefficient about the quarter chord at zero lift, nose-up positive.
    slope_angle : float
        Direction from the first to the last ring node against the chord line [rad].
    """

    heights: Array
    zero_lift_angle: float
    lift_slope: float
    zero_lift_moment: float
    slope_angle: float


@dataclass(frozen=True)
class LatticePlanform:
    """One blade as a lattice of vortex rings, in the blade frame (z root to tip, x suction side, y trailing edge).

    Attributes
    ----------
    nodes : ndarray, shape (n_chord + 1, n_span + 1, 3)
        Corners of the rings [m], each a quarter of a panel chord behind the panel edge.
    chord : ndarray, shape (n_span,)
        Mean chord of each strip, to which the coefficients of its polar refer [m].
    edge_chord : ndarray, shape (n_span + 1,)
        Chord at the span edges [m].
    span_edges : ndarray, shape (n_span + 1,)
        Span coordinates from which the lattice was built [m].
    polars : ndarray, shape (n_span, n_alpha, 3) or (n_blades n_span, n_alpha, 3)
        cl, cd, cm of each strip of a blade, or of all blades, at ``n_alpha`` angles of attack, evenly spaced from -pi
        (included) to pi (excluded).
    alpha0_lattice, lift_slope, moment0_lattice, slope_angle : ndarray, shape (n_span,)
        Properties of the strip's two-dimensional lattice, see `SectionLattice`.
    root_radius : float or None
        Distance of z = 0 from the axis about which the blade turns [m]; None for a wing.

    Raises
    ------
    AerodynamicsError
        For wrong shapes, values that are not finite, chords or lift slopes that are not positive, panels without area,
        and nodes that do not run from root to tip and from the leading to the trailing edge.
    """

    nodes: Array
    chord: Array
    edge_chord: Array
    span_edges: Array
    polars: Array
    alpha0_lattice: Array
    lift_slope: Array
    moment0_lattice: Array
    slope_angle: Array
    root_radius: float | None = None

    def __post_init__(self) -> None:
        """Check shapes, orientation and values, then make the arrays read-only."""
        arrays = {name: numeric_array(name, getattr(self, name)) for name in ARRAY_FIELDS}
        for name, array in arrays.items():
            object.__setattr__(self, name, array)
        n_span = self.chord.size
        if self.nodes.ndim != 3 or self.nodes.shape[1:] != (n_span + 1, 3) or self.nodes.shape[0] < 2:
            raise AerodynamicsError(f"nodes have shape {self.nodes.shape}; must be (n_chord + 1, {n_span + 1}, 3)")
        of_edges, of_strips = ("edge_chord", "span_edges"), ("chord", *SECTION_FIELDS)
        for name, n in (*((x, n_span + 1) for x in of_edges), *((x, n_span) for x in of_strips)):
            if arrays[name].shape != (n,):
                raise AerodynamicsError(f"{name} has shape {arrays[name].shape}; must be ({n},)")
            if not np.all(np.isfinite(arrays[name])):
                raise AerodynamicsError(f"{name} is not finite: {arrays[name]}")
        if not np.all(np.diff(self.span_edges) > 0.0):
            raise AerodynamicsError(f"span edges must increase from root to tip; given {self.span_edges}")
        if not np.all(self.chord > 0.0):
            raise AerodynamicsError(f"every chord must be positive; given {self.chord}")
        if np.any(self.edge_chord < 0.0):
            raise AerodynamicsError(f"edge chords must be at least 0, got {self.edge_chord}")
        if not np.all(self.ring_chord > 0.0):
            raise AerodynamicsError(f"of the two edge chords of a strip one must be positive; given {self.edge_chord}")
        if not np.all(self.lift_slope > 0.0):
            raise AerodynamicsError(f"every lift_slope must be positive; given {self.lift_slope}")
        if self.polars.ndim != 3 or len(self.polars) % n_span or self.polars.shape[2] != 3 or not len(self.polars):
            raise AerodynamicsError(
                f"polars have shape {self.polars.shape}; must be ({n_span}, n_alpha, 3), or so many times the blades"
            )
        if self.polars.shape[1] < 8 or not np.all(np.isfinite(self.polars)):
            raise AerodynamicsError("polars must have at least 8 angles and finite coefficients")
        _check_panels(self.nodes)
        for array in arrays.values():
            array.setflags(write=False)

    @property
    def ring_chord(self) -> Array:
        """Chord of the rings of each strip, which join its two edges, shape (n_span,) [m].

        The mean of the edges; not that of the strip where the chord is curved or has a kink, as at the tip of a blade.
        """
        return 0.5 * (self.edge_chord[1:] + self.edge_chord[:-1])

    @property
    def n_chord(self) -> int:
        """Panels along the chord."""
        return int(self.nodes.shape[0]) - 1

    @property
    def n_span(self) -> int:
        """Panels along the span."""
        return int(self.nodes.shape[1]) - 1


def numeric_array(name: str, values: ArrayLike) -> Array:
    """Contiguous array of double precision; `AerodynamicsError` with this name for anything else than numbers."""
    try:
        return np.ascontiguousarray(values, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise AerodynamicsError(f"{name} must be an array of numbers: {error}") from error


def _panel_sides(nodes: Array) -> tuple[Array, Array]:
    """Mean vectors along chord and span of every panel, shape (..., n_chord, n_span, 3)."""
    along, across = nodes[..., 1:, :, :] - nodes[..., :-1, :, :], nodes[..., 1:, :] - nodes[..., :-1, :]
    return 0.5 * (along[..., 1:, :] + along[..., :-1, :]), 0.5 * (across[..., 1:, :, :] + across[..., :-1, :, :])


def check_areas(nodes: Array) -> None:
    """Refuse panels without area.

    Parameters
    ----------
    nodes : ndarray, shape (..., n_chord + 1, n_span + 1, 3)
        Corners of the panels of one or more blades [m].

    Raises
    ------
    AerodynamicsError
        That names the panels by blade (if there are several), place along the chord and along the span.
    """
    chordwise, spanwise = _panel_sides(nodes)
    area = np.linalg.norm(np.cross(chordwise, spanwise), axis=-1)
    scale = np.linalg.norm(chordwise, axis=-1) * np.linalg.norm(spanwise, axis=-1)
    flat = ~(area > 1e-6 * np.maximum(scale, 1e-12))
    if np.any(flat):
        where = "(blade, chord, span)" if nodes.ndim > 3 else "(chord, span)"
        raise AerodynamicsError(f"every panel must have an area; panels {where} have none: {_listed(flat)}")


def _listed(wrong: NDArray[np.bool_]) -> str:
    """Indices of the first panels for which ``wrong`` holds, as text."""
    places = np.argwhere(wrong).tolist()
    return f"{places[:MOST_LISTED]}" + (f" and {len(places) - MOST_LISTED} more" if places[MOST_LISTED:] else "")


def _check_panels(nodes: Array) -> None:
    """Refuse non-finite nodes, rings without area, rings turned inside out and blades against their own frame."""
    if not np.all(np.isfinite(nodes)):
        raise AerodynamicsError("nodes of the lattice must be finite")
    check_areas(nodes)
    chordwise, spanwise = _panel_sides(nodes)
    if np.any(np.einsum("ijk,ijk->ij", chordwise[:, 1:], chordwise[:, :-1]) < 0.0):
        raise AerodynamicsError("the chord direction must turn by at most 90 degrees between neighboring strips")
    folded = np.einsum("ijk,ijk->ij", chordwise[1:], chordwise[:-1]) <= 0.0
    if np.any(folded):
        raise AerodynamicsError(
            f"panels (chord, span) folded back onto the next one along the chord: {_listed(folded)}; rows of nodes "
            "must follow each other from the leading to the trailing edge"
        )
    against = (
        (spanwise[..., 2] <= 0.0, "the span of panels must run to larger z, from root to tip"),
        (chordwise.sum(axis=0, keepdims=True)[..., 1] <= 0.0, "the chord of strips must run to larger y, from the "
         "leading to the trailing edge, which takes a twist between -90 and 90 degrees"),
        (np.cross(chordwise, spanwise)[..., 0] <= 0.0, "chord x span of panels must point to larger x, the suction "
         "side"),
    )  # fmt: skip
    for wrong, need in against:
        if np.any(wrong):
            raise AerodynamicsError(f"in the blade frame {need}; panels (chord, span) that do not: {_listed(wrong)}")


def section_lattice(
    slope: Callable[[Array], ArrayLike], n_chord: int, height: Callable[[float], ArrayLike] | None = None
) -> SectionLattice:
    """Build the lattice of one camber line and solve it in two dimensions.

    Every panel gets the slope of the camber line at its collocation point (three quarters of the panel), which with
    the vortex at its first quarter makes the lift of a parabolic camber line exact for any number of panels (James,
    Comput. Methods Appl. Mech. Eng. 1 (1972) 59). Camber lines loaded at the rear are far from parabolic: with one
    panel the slope at three quarters misses up to 6 degrees of zero-lift angle. So all panels turn together until
    the zero-lift angle is that of `FINE_PANELS` panels; for the parabola that changes nothing.

    Parameters
    ----------
    slope : callable
        dh/dx of the camber line at chord fractions x in [0, 1].
    n_chord : int
        Number of panels.
    height : callable, optional
        Camber h(x) in chords, used at the first node; zero if not given.
    """
    start = 0.0 if height is None else float(np.asarray(height(0.25 / n_chord)))
    slopes = _collocation_slopes(slope, n_chord)
    exact = _solve_section(0.0, _collocation_slopes(slope, FINE_PANELS)).zero_lift_angle
    for _ in range(3):  # the zero-lift angle turns with the panels almost one to one
        slopes = slopes + exact - _solve_section(start, slopes).zero_lift_angle
    return _solve_section(start, slopes)


def _collocation_slopes(slope: Callable[[Array], ArrayLike], n_chord: int) -> Array:
    return np.asarray(slope((np.arange(n_chord) + 0.75) / n_chord), dtype=np.float64)


def _solve_section(start: float, slopes: Array) -> SectionLattice:
    """Solve the lattice that begins at height ``start`` and has these panel slopes."""
    panel = 1.0 / slopes.size
    heights = start + np.concatenate(([0.0], np.cumsum(slopes * panel)))
    stations = (np.arange(slopes.size + 1) + 0.25) * panel
    x_vortex, h_vortex = stations[:-1], heights[:-1]
    x_col, h_col = 0.5 * (stations[:-1] + stations[1:]), 0.5 * (heights[:-1] + heights[1:])
    dx, dh = x_col[:, None] - x_vortex, h_col[:, None] - h_vortex
    normal_x, normal_h = -slopes / np.hypot(1.0, slopes), 1.0 / np.hypot(1.0, slopes)
    # A vortex that carries lift sends the air behind it down: (u, w) = G/(2 pi r^2) (h, -x).
    influence = (dh * normal_x[:, None] - dx * normal_h[:, None]) / (2.0 * np.pi * (dx**2 + dh**2))
    along, across = (-np.linalg.solve(influence, n) for n in (normal_x, normal_h))
    lift_cos, lift_sin = 2.0 * along.sum(), 2.0 * across.sum()
    zero_lift = -np.arctan2(lift_cos, lift_sin)
    at_zero = along * np.cos(zero_lift) + across * np.sin(zero_lift)
    arm = (x_vortex - 0.25) * np.cos(zero_lift) + h_vortex * np.sin(zero_lift)
    return SectionLattice(
        heights, float(zero_lift), float(np.hypot(lift_cos, lift_sin)), float(-2.0 * at_zero @ arm),
        float(np.arctan2(heights[-1] - heights[0], 1.0)),
    )  # fmt: skip


def span_distribution(
    root: float,
    tip: float,
    n_span: int,
    refinement: float = 0.3,
    inset: tuple[float, float] = (0.0, 0.25),
    towards: str = "ends",
) -> Array:
    """Span edges of a lattice between root and tip.

    Parameters
    ----------
    root, tip : float
        Ends of the lifting surface [m].
    n_span : int
        Number of panels.
    refinement : float
        0 spaces the edges evenly, 1 by cosines towards both ends, or by sines towards the tip.
    inset : tuple of float
        Distance of the first and last edge from root and tip in widths of their panels. A quarter at a free end
        removes most of the error of a coarse lattice, which is a lattice too long by that much (Hough, J. Aircraft
        10 (1973) 314): with 10 panels the lift of a wing is 1-2 % low instead of 5 % high.
    towards : str
        "ends" or "tip": where the panels are narrower. The blades of a rotor lose their lift over a few hundredths of
        the radius at the tip, Prandtl's (1 - a) V 2 pi / (n_blades Omega) / pi, and gradually at the root.

    Returns
    -------
    edges : ndarray, shape (n_span + 1,)

    Raises
    ------
    AerodynamicsError
        If the tip does not lie beyond the root, or ``towards`` is unknown.
    """
    if not tip > root:
        raise AerodynamicsError(f"the tip ({tip}) must lie beyond the root ({root})")
    if towards not in ("ends", "tip"):
        raise AerodynamicsError(f"towards is {towards!r}; must be 'ends' or 'tip'")
    even = np.linspace(0.0, 1.0, n_span + 1)
    uneven = 0.5 * (1.0 - np.cos(np.pi * even)) if towards == "ends" else np.sin(0.5 * np.pi * even)
    edges = (1.0 - refinement) * even + refinement * uneven
    before, behind = inset[0] * (edges[1] - edges[0]), inset[1] * (edges[-1] - edges[-2])
    result: Array = root + (tip - root) * (edges + before) / (1.0 + before + behind)
    return result


def build_planform(  # noqa: PLR0913
    span_edges: ArrayLike,
    axis: ArrayLike,
    chord: ArrayLike,
    twist: ArrayLike,
    le_offset: ArrayLike,
    polars: ArrayLike,
    n_chord: int,
    camber: Camber | None = None,
    strip_chord: ArrayLike | None = None,
    root_radius: float | None = None,
) -> LatticePlanform:
    """Lattice of a blade from its planform at the span edges.

    Parameters
    ----------
    span_edges : array_like, shape (n_span + 1,)
        Increasing span coordinates [m]; passed to ``camber``.
    axis : array_like, shape (n_span + 1, 3)
        Points of the reference axis in the blade frame [m].
    chord, twist, le_offset : array_like, shape (n_span + 1,)
        Chord [m], twist (positive turns the leading edge to -x) [rad], distance from leading edge to axis / chord.
    polars : array_like, shape (n_span, n_alpha, 3) or (n_blades n_span, n_alpha, 3)
        cl, cd, cm of the strips of a blade, or of all blades, on an even grid of angles from -pi (included) to pi
        (excluded).
    n_chord : int
        Panels along the chord.
    camber : callable, optional
        ``camber(span, x)`` gives height and slope (both in chords) of the camber line at chord fractions x, positive
        towards the suction side. Flat if not given.
    strip_chord : array_like, shape (n_span,), optional
        Mean chords of the strips, to which their polars refer; by default the mean of the two edges.
    root_radius : float, optional
        See `LatticePlanform`.

    Raises
    ------
    AerodynamicsError
        For wrong shapes, spans that do not increase, chords that are not positive, panels without area, bad polars,
        and a blade against its frame: an axis towards smaller z, or a twist of 90 degrees or more.
    """
    given = {"span_edges": span_edges, "chord": chord, "twist": twist, "le_offset": le_offset, "axis": axis}
    span_edges, chord, twist, le_offset, axis = (numeric_array(name, values) for name, values in given.items())
    n_edge = span_edges.size
    if not isinstance(cast(object, n_chord), Integral) or n_chord < 1 or n_edge < 2:
        raise AerodynamicsError(f"a lattice needs at least one panel each way; n_chord={n_chord}, span edges={n_edge}")
    for name, array, shape in (("axis", axis, (n_edge, 3)), ("chord", chord, (n_edge,)), ("twist", twist, (n_edge,)),
                               ("le_offset", le_offset, (n_edge,))):  # fmt: skip
        if array.shape != shape or not np.all(np.isfinite(array)):
            raise AerodynamicsError(f"{name} has shape {array.shape}, must have shape {shape} and be finite")
    sections = [_edge_section(camber, z, n_chord) for z in span_edges]
    stations = (np.arange(n_chord + 1) + 0.25) / n_chord
    heights = np.array([s.heights for s in sections])
    along = (stations[None, :] - le_offset[:, None]) * chord[:, None]
    above = heights * chord[:, None]
    cos, sin = np.cos(twist)[:, None], np.sin(twist)[:, None]
    nodes = np.empty((n_chord + 1, n_edge, 3))
    nodes[..., 0] = (axis[:, :1] + above * cos + along * sin).T
    nodes[..., 1] = (axis[:, 1:2] - above * sin + along * cos).T
    nodes[..., 2] = np.broadcast_to(axis[:, 2], (n_chord + 1, n_edge))
    # The rings of a strip join two edges, so its section is the mean of theirs.
    strips = [_mean_section(a, b, n_chord) for a, b in pairwise(sections)]
    return LatticePlanform(
        nodes=nodes,
        chord=0.5 * (chord[1:] + chord[:-1]) if strip_chord is None else numeric_array("strip_chord", strip_chord),
        edge_chord=chord,
        span_edges=span_edges,
        polars=numeric_array("polars", polars),
        alpha0_lattice=np.array([s.zero_lift_angle for s in strips]),
        lift_slope=np.array([s.lift_slope for s in strips]),
        moment0_lattice=np.array([s.zero_lift_moment for s in strips]),
        slope_angle=np.array([s.slope_angle for s in strips]),
        root_radius=root_radius,
    )


def _edge_section(camber: Camber | None, z: float, n_chord: int) -> SectionLattice:
    if camber is None:
        return section_lattice(np.zeros_like, n_chord)
    return section_lattice(lambda x: camber(z, x)[1], n_chord, lambda x: camber(z, x)[0])


def _mean_section(a: SectionLattice, b: SectionLattice, n_chord: int) -> SectionLattice:
    heights = 0.5 * (a.heights + b.heights)
    return _solve_section(float(heights[0]), np.diff(heights) * n_chord)


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

    nodes: Integers
    rings: Integers
    chord: Array

    @classmethod
    def of(cls, n_chord: int, n_span: int, edge_chord: ArrayLike, options: AeroOptions) -> "SheddingEdge":
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
    n_chord: int, n_span: int, edge_chord: Array, edge: SheddingEdge, options: AeroOptions, has_wake: bool
) -> tuple[Integers, Array]:
    """Distinct segments of the rings of one blade, with the newest wake rings if there is a wake.

    A newest wake ring lies between the shedding edge and the newest wake row and has the circulation of the ring it
    continues (Kutta condition). Where the sides of rings with equal circulation coincide nothing remains.

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


FADE = np.radians([40.0, 50.0])
"""Distances from the angle of zero lift between which attached flow goes over into the static polar [rad]. Beyond, no
boundary layer can hold on; as in AeroDyn, whose unsteady model ends at 45 degrees."""


def separation_tables(polars: ArrayLike, monotone: bool = True) -> Array:
    """Tables of the dynamic stall model on the angles of the polars.

    Parameters
    ----------
    polars : array_like, shape (n_span, n_alpha, 3)
        cl, cd, cm at angles of attack evenly spaced from -pi (included) to pi (excluded).
    monotone : bool
        The lift of fully separated flow does not fall with the angle of attack; False: as published.

    Returns
    -------
    ndarray, shape (n_span, n_alpha, 4)
        Lift coefficient of attached flow, of fully separated flow, static separation point [chords], and drag
        coefficient above that at zero lift. The mixture of the two lifts at the static separation point is the polar.
    """
    polars = np.asarray(polars, dtype=np.float64)
    n_alpha = polars.shape[1]
    if n_alpha == 0:
        return np.zeros((len(polars), 0, 4))
    alpha = -np.pi + 2.0 * np.pi / n_alpha * np.arange(n_alpha)
    return np.array([_table(alpha, polar[:, 0], polar[:, 1], monotone) for polar in polars])


def _table(alpha: Array, cl: Array, cd: Array, monotone: bool) -> Array:
    """Columns (n_alpha, 4) of one section."""
    line = attached_lift(alpha, cl)
    if line is None:
        return np.column_stack([cl, cl, np.zeros_like(cl), np.zeros_like(cl)])
    alpha0, slope = line
    arm = alpha - alpha0
    potential = slope * arm
    share = np.clip((FADE[1] - np.abs(arm)) / (FADE[1] - FADE[0]), 0.0, 1.0)
    ratio = np.divide(cl, potential, out=np.ones_like(cl), where=np.abs(arm) > 1e-9)
    root = np.clip(2.0 * np.sqrt(np.maximum(ratio, 0.0)) - 1.0, 0.0, 1.0)
    root[~_connected(root > 0.0, int(np.searchsorted(alpha, alpha0)))] = 0.0
    root[share == 0.0] = 0.0
    # No steeper than the polar, which is attached where it lies above the line: on the side of negative lift it may.
    attached = np.where(root == 1.0, cl, potential)
    separated = np.where(root == 0.0, cl, attached * (1.0 + 3.0 * root) / (4.0 * (1.0 + root)))
    point = root**2
    if monotone:
        limit = _without_fall(separated, arm)
        point = np.where(limit == separated, point, (cl - limit) / np.where(attached == limit, 1.0, attached - limit))
        separated = limit
    attached, separated = (share * lift + (1.0 - share) * cl for lift in (attached, separated))
    return np.column_stack([attached, separated, point, share * (cd - np.interp(alpha0, alpha, cd))])


def _connected(within: NDArray[np.bool_], center: int) -> NDArray[np.bool_]:
    """Entries of ``within`` (n,) that hold from index ``center`` outwards without a gap."""
    below, above = within[:center][::-1], within[center:]
    return np.concatenate([np.logical_and.accumulate(below)[::-1], np.logical_and.accumulate(above)])


def _without_fall(lift: Array, arm: Array) -> Array:
    """Largest lift not above ``lift`` (n,) that grows with the distance ``arm`` from zero lift; both sides alike."""
    limit = lift.copy()
    for side in (1.0, -1.0):
        within = np.flatnonzero((side * arm >= 0.0) & (side * arm <= FADE[0]))[:: int(side)]  # outwards
        limit[within] = side * np.minimum.accumulate(side * lift[within][::-1])[::-1]
    return limit
