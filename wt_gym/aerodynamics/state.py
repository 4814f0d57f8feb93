"""The state of the aerodynamics: plain arrays that can be copied, compared and continued bit for bit."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from wt_gym.aerodynamics.induction.simd_kernels import WIDTH
from wt_gym.aerodynamics.induction.tree_induction import RingWork, aligned_zeros
from wt_gym.aerodynamics.lattice.planform import LatticePlanform, SheddingEdge, bound_segments, separation_tables
from wt_gym.aerodynamics.options import SEPARATION_LAG, AeroOptions
from wt_gym.aerodynamics.wake.far_wake_kernels import N_CELL, N_FAR, N_TUBE
from wt_gym.base.quantities import Array, Integers


class PlanformArrays(NamedTuple):
    """What the kernels need of a planform."""

    chord: Array  # (n_span,) of the strips [m]
    edge_chord: Array  # (n_span + 1,) at their edges [m]
    # (n_span or n_strip, n_alpha, 3) cl, cd, cm at angles from -pi on, of a blade or of all of them
    polars: Array
    alpha0: Array  # (n_span,) angle of zero lift of the two-dimensional lattice [rad]
    kappa: Array  # (n_span,) circulation per normal velocity of that lattice [m]
    # (n_span,) moment coefficient of that lattice at zero lift, of the chord of the polars
    moment0: Array
    slope_angle: Array  # (n_span,) from the first to the last ring node against the chord line [rad]
    tilt: Array  # (n_span, 2) cosine and sine of slope angle - angle of zero lift
    # (n_span or n_strip, n_alpha, 4), see separation.separation_tables; no angles without dynamic stall
    separation: Array
    cylinder_table: NDArray[np.float32]  # (2, n_axial, n_radial), see far_wake.cylinder_table
    shed_nodes: Integers  # (n_edge + 1,) ring nodes on the shedding edge, see edges.SheddingEdge
    shed_rings: Integers  # (n_edge,) rings that shed there
    shed_chord: Array  # (n_edge + 1,) chord at those nodes [m]
    segments: Integers  # (2, n, 4): without and with a wake, see edges.bound_segments
    segment_core: Array  # (2, n) core radius squared [m^2]
    n_segments: Integers  # (2,)
    sparse_nodes: Integers  # (n_sparse,) nodes of the edge that carry the sparse part of the wake
    sparse_weight: Array  # (n_edge,) share of each ring in its merged ring, see sparse_span
    sparse_place: Array  # (n_edge + 1,) place of a node between its carrying neighbors, 0 … 1

    @classmethod
    def of(cls, planform: LatticePlanform, options: AeroOptions, cylinder_table: NDArray[np.float32]) -> PlanformArrays:
        """Gather the arrays.

        ``kappa`` is circulation per normal velocity of the two-dimensional lattice [m]. It goes with the chord of the
        rings, since the angle of attack is taken from their circulation; so does their moment at zero lift, which
        ``moment0`` refers to the chord of the polars.
        """
        n_chord, n_span = planform.n_chord, planform.n_span
        edge = SheddingEdge.of(n_chord, n_span, planform.edge_chord, options)
        tables = [bound_segments(n_chord, n_span, planform.edge_chord, edge, options, wake) for wake in (False, True)]
        count = np.array([len(core) for _, core in tables])
        segments, cores = np.full((2, count.max(), 4), -1), np.zeros((2, count.max()))
        for k, (segment, core) in enumerate(tables):
            segments[k, : count[k]], cores[k, : count[k]] = segment, core**2
        tilt = planform.slope_angle - planform.alpha0_lattice
        moment0 = planform.moment0_lattice * (planform.ring_chord / planform.chord) ** 2
        stalling = planform.polars if options.dynamic_stall else planform.polars[:, :0]
        return cls(
            planform.chord, planform.edge_chord, planform.polars, planform.alpha0_lattice,
            0.5 * planform.ring_chord * planform.lift_slope, moment0, planform.slope_angle,
            np.column_stack([np.cos(tilt), np.sin(tilt)]), separation_tables(stalling), cylinder_table, edge.nodes,
            edge.rings, edge.chord, segments, cores, count,
            *sparse_span(planform, edge.nodes, options.sparse_span),
        )  # fmt: skip


def carrying_nodes(n_edge: int, stride: int) -> Integers:
    """Nodes of the edge that carry the sparse part of the wake: the last three and every ``stride``-th inboard of them.

    Where the circulation falls steeply, the place of its trailing vortices decides how fast they move.
    """
    return np.unique(np.concatenate([np.arange(max(n_edge - 2, 0), -1, -stride), [0, n_edge - 1, n_edge]]))


def sparse_span(planform: LatticePlanform, edge_nodes: Integers, stride: int) -> tuple[Integers, Array, Array]:
    """Carrying nodes of the sparse wake, shares of the rings in merged rings, places of nodes between neighbors.

    The shares are those of the areas that the rings sweep behind a rotor: the merged ring has the impulse of its parts,
    circulation times area, with which the wake carries the thrust. With shares of the widths, as behind a wing, the
    5-MW rotor would have half a per cent too much power.
    """
    corners = planform.nodes.reshape(-1, 3)[edge_nodes]
    width = np.linalg.norm(np.diff(corners, axis=0), axis=1)
    area = width
    if planform.root_radius is not None:
        area = width * np.maximum(planform.root_radius + 0.5 * (corners[1:, 2] + corners[:-1, 2]), 0.0)
    n_edge = len(width)
    chosen = carrying_nodes(n_edge, stride)
    weight, place = np.empty(n_edge), np.zeros(n_edge + 1)
    for first, last in pairwise(chosen):
        weight[first:last] = area[first:last] / area[first:last].sum()
        place[first + 1 : last] = np.cumsum(width[first : last - 1]) / width[first:last].sum()
    return chosen, weight, place


class AeroConstants(NamedTuple):
    """Numbers of a lattice, as the kernels take them."""

    density: float  # of the air [kg/m^3]
    wake_core: float  # core radius of new wake segments, over the chord
    viscosity: float  # kinematic [m^2/s]
    squire: float  # coefficient of the turbulent growth of cores
    shed_fraction: float  # place of the newest row between trailing edge and the air that left it one step ago
    stall_lag: float  # of the decambering [chords]; 0 with dynamic stall
    separation_lag: float  # of the separation point [chords]
    ground: float  # height [m]; 0 without a ground
    full_rows: int  # rows that are not thinned
    coarse_stride: int  # steps from row to row behind them
    sparse_from: int  # first row of the sparse part; more than there are without one
    sparse_stride: int  # steps from row to row there
    fresh_rows: int  # rows whose induced velocity is computed in every step
    refresh_stride: int  # steps between two computations for the others
    far_wake_rows: int  # oldest rows, from which the cylinders behind the wake are measured
    far_wake: bool  # cylinders continue the wake
    has_ground: bool
    viscous: bool  # polars act on the circulation
    dynamic_stall: bool
    unsteady: bool  # force of the changing circulation
    bernoulli: bool  # loads from pressures, else Joukowski's
    strain: bool  # cores shrink as segments stretch
    curved: bool  # polygons follow the curve through their nodes
    arcs: bool  # segments beside a node act on it as arcs, see local_induction_kernels
    edge_wake: bool  # trailing edges shed
    tip_wake: bool  # tips shed

    @classmethod
    def of(cls, options: AeroOptions, density: float) -> AeroConstants:
        """Numbers of these options."""
        o = options
        has_ground = o.ground_height is not None
        return cls(
            density=float(density), wake_core=float(o.wake_core), viscosity=float(o.viscosity),
            squire=float(o.squire), shed_fraction=float(o.shed_fraction),
            stall_lag=0.0 if o.dynamic_stall else float(o.stall_lag), separation_lag=SEPARATION_LAG,
            ground=0.0 if o.ground_height is None else float(o.ground_height), full_rows=o.full_rows,
            coarse_stride=o.coarse_stride,
            sparse_from=o.wake_rows + 1 if o.sparse_from is None else o.sparse_from, sparse_stride=o.sparse_stride,
            fresh_rows=o.fresh_rows, refresh_stride=o.refresh_stride,
            far_wake_rows=o.far_wake_rows, far_wake=o.far_wake, has_ground=has_ground, viscous=o.viscous,
            dynamic_stall=o.dynamic_stall is not None, unsteady=True, bernoulli=o.load_form == "bernoulli",
            strain=o.core_strain, curved=o.curved_filaments, arcs=True, edge_wake=o.trailing_edge_wake,
            tip_wake=o.tip_wake,
        )  # fmt: skip


class AeroWork(NamedTuple):
    """Work arrays of a lattice: nothing in them outlives a step."""

    bound_sheet: NDArray[np.float32]  # (n_chord + 1, n_blade, n_node, 7), see induction_kernels
    wake_sheet: NDArray[np.float32]  # (n_max + 1, n_blade, n_edge + 1, 7)
    # (n_max + 1 - sparse_from, n_blade, n_sparse, 7), no rows without a sparse part
    sparse_sheet: NDArray[np.float32]
    targets: NDArray[np.float32]  # (2, 3, n_target)
    velocity: NDArray[np.float32]  # (2, 3, n_target)
    scratch: NDArray[np.float32]  # (n,) of the induction kernels
    rows: Integers  # (n_max + 1,) rows whose turn it is
    row_points: Array  # (n_max + 1, n_blade, n_edge + 1, 3) nodes of these rows [m]
    n_turn: Integers  # (1,) their number
    corners: Array  # (2, n_blade, n_corner, 3) ring nodes and newest wake row, and their mirror images
    points: Array  # (3, n_point)
    rings: RingWork
    flow: Array  # (3, n_point)
    normal: Array  # (n_ring, 3)
    area: Array  # (n_ring,)
    swap: Integers  # (n_ring,) for the inverse
    panel: Array  # (n_ring, 4)
    pivots: Array  # (4, n_ring)
    through: Array  # (n_ring,)
    axes: Array  # (n_strip, 3) chord direction
    normals: Array  # (n_strip, 3)
    strip: Array  # (6, n_strip): width, along, potential, right-hand side, derivative, step
    jacobian: Array  # (n_span, n_span)
    lines: Array  # (3, n_edge + 1)
    arc: Array  # (2, 3) place and velocity of one node

    @classmethod
    def empty(
        cls, n_blade: int, n_chord: int, n_span: int, p: PlanformArrays, options: AeroOptions, n_panel: int = 0
    ) -> AeroWork:
        """Arrays of the right shapes."""
        n_edge, n_max = p.shed_rings.size, options.wake_rows
        line_rows = n_chord + (not options.trailing_edge_wake)
        n_sparse = 0 if options.sparse_from is None else max(n_max + 1 - options.sparse_from, 0)
        n_node, n_strip = n_span + 1, n_blade * n_span
        n_ring = n_strip * n_chord
        n_point = n_ring + n_strip * line_rows + n_blade * n_chord * n_node
        n_target = max(n_blade * (n_edge + 1) * (n_max + 1), n_point, n_panel) + WIDTH
        widest = max(n_node, n_edge + 1)
        n_corner = (n_chord + 1) * n_node + n_edge + 1
        single = np.float32
        return cls(
            bound_sheet=aligned_zeros((n_chord + 1, n_blade, n_node, 7), single),
            wake_sheet=aligned_zeros((n_max + 1, n_blade, n_edge + 1, 7), single),
            sparse_sheet=aligned_zeros((n_sparse, n_blade, p.sparse_nodes.size, 7), single),
            targets=aligned_zeros((2, 3, n_target), single), velocity=aligned_zeros((2, 3, n_target), single),
            scratch=aligned_zeros(8 * WIDTH * widest + 14 * n_target, single),
            rows=aligned_zeros(n_max + 1, dtype=np.int64),
            row_points=aligned_zeros((n_max + 1, n_blade, n_edge + 1, 3)), n_turn=aligned_zeros(1, dtype=np.int64),
            corners=aligned_zeros((2, n_blade, n_corner, 3)),
            points=aligned_zeros((3, n_point)), rings=RingWork.empty(n_ring, n_corner, n_point),
            flow=aligned_zeros((3, n_point)),
            normal=aligned_zeros((n_ring, 3)), area=aligned_zeros(n_ring), swap=aligned_zeros(n_ring, dtype=np.int64),
            panel=aligned_zeros((n_ring, 4)), pivots=aligned_zeros((4, n_ring)),
            through=aligned_zeros(n_ring), axes=aligned_zeros((n_strip, 3)), normals=aligned_zeros((n_strip, 3)),
            strip=aligned_zeros((6, n_strip)), jacobian=aligned_zeros((n_span, n_span)),
            lines=aligned_zeros((3, n_edge + 1)), arc=aligned_zeros((2, 3)),
        )  # fmt: skip


class AeroArrays(NamedTuple):
    """All numbers of the state; the order of axes is row, blade, node, component for the wake.

    ``n_max`` = `AeroOptions.wake_rows`, ``n_edge`` = parts of the shedding edge; wake row 0 is that edge, row k the
    k-th shed row behind it.
    """

    n_rows: Integers  # (1,) rows of the wake
    n_steps: Integers  # (1,) steps since the start
    # (1,) stored levels of gamma, up to two; with one, a solution at dt = 0 is steady
    n_levels: Integers
    prepared: Integers  # (1,) 1 when the influences are those of the step under way
    far_wake_on: Integers  # (1,) 1 when cylinders (if the options have them) continue the wake
    dt: Array  # (1,) step under way [s]
    last_dt: Array  # (1,) last accepted step [s]
    residual: Array  # (1,) of the decambering [m/s]
    origin: Array  # (3,) origin of float32 positions [m]
    wake: Array  # (n_max + 1, n_blade, n_edge + 1, 3) positions [m]
    history: Array  # same shape, velocity at the time before [m/s]
    wind: Array  # same shape, undisturbed wind [m/s]
    induced: NDArray[np.float32]  # same shape, float32, induced velocity [m/s]
    wake_gamma: Array  # (n_max, n_blade, n_edge) ring k between rows k and k + 1 [m^2/s]
    volume: Array  # (n_max + 1, n_blade, n_edge + 1, 2) rc^2 l of trailing and spanwise segments [m^3]
    age: Array  # (n_max + 1,) time since shed [s]
    shed: Integers  # (n_max + 1,) step at which the row was shed
    free_edge: Array  # (n_blade, n_edge + 1, 3) where the air of the last shedding edge is now [m]
    frame: Array  # (n_blade, 3, 3) directions of each blade at the last accepted step, see wake_kernels
    # (12,) whether cylinders continue the wake, center and axis of its last rows, share of each cell
    far: Array
    # (5, n_sparse) start, radius and what is measured of the cylinder at each carrying node
    far_tube: Array
    far_ring: Array  # (n_cell, n_sparse) ring circulation per length of their cells [m/s]
    nodes: Array  # (n_blade, n_chord + 1, n_node, 3) ring nodes of the last solve [m]
    gamma: Array  # (n_blade, n_chord, n_span) ring circulations [m^2/s]
    gamma_1: Array  # one accepted step ago
    gamma_2: Array  # two accepted steps ago
    source: Array  # (n_strip,) decambering velocity [m/s]
    source_1: Array  # decambering velocity over section speed, one accepted step ago [-]
    alpha: Array  # (n_strip,) effective angle of attack [rad]
    speed: Array  # (n_strip,) effective speed in the section plane [m/s]
    separation: Array  # (2, n_strip) separation point [chords] now, and in the static polar one step ago
    forces: Array  # (n_blade, n_chord + 1, n_node, 3) nodal forces [N]
    influence: Array  # (n_ring, 3, n_point) velocity per ring circulation, of this step
    inverse: Array  # (n_ring, n_ring)
    response: Array  # (n_strip, n_strip)
    wake_flow: Array  # (3, n_point) wake-induced velocity, of this step [m/s]
    body_strength: Array  # (n_panel,) source strengths of the bodies [m/s]


@dataclass(frozen=True)
class AeroState:
    """State of a `VortexLattice`; change it only through the lattice.

    Attributes
    ----------
    arrays : AeroArrays
        Every number of the state.
    """

    arrays: AeroArrays

    @classmethod
    def empty(cls, planform: LatticePlanform, n_blades: int, options: AeroOptions, n_panel: int = 0) -> AeroState:
        """Arrays of the right shapes, without flow."""
        n_chord, n_span = planform.n_chord, planform.n_span
        n_edge = len(SheddingEdge.of(n_chord, n_span, planform.edge_chord, options).rings)
        n_far = len(carrying_nodes(n_edge, options.sparse_span))
        n_node, n_max = n_edge + 1, options.wake_rows
        n_strip = n_blades * n_span
        n_ring = n_strip * n_chord
        line_rows = n_chord if options.trailing_edge_wake else n_chord + 1
        n_point = n_ring + n_strip * line_rows + n_blades * n_chord * (n_span + 1)
        wake_shape = (n_max + 1, n_blades, n_node, 3)
        bound_shape = (n_blades, n_chord + 1, n_span + 1, 3)
        gamma_shape = (n_blades, n_chord, n_span)
        return cls(
            AeroArrays(
                n_rows=np.zeros(1, dtype=np.int64), n_steps=np.zeros(1, dtype=np.int64),
                n_levels=np.zeros(1, dtype=np.int64), prepared=np.zeros(1, dtype=np.int64),
                far_wake_on=np.zeros(1, dtype=np.int64), dt=np.zeros(1), last_dt=np.zeros(1), residual=np.zeros(1),
                origin=np.zeros(3),
                wake=np.zeros(wake_shape), history=np.zeros(wake_shape), wind=np.zeros(wake_shape),
                induced=np.zeros(wake_shape, dtype=np.float32),
                wake_gamma=np.zeros((n_max, n_blades, n_edge)), volume=np.zeros((*wake_shape[:3], 2)),
                age=np.zeros(n_max + 1),
                shed=np.zeros(n_max + 1, dtype=np.int64), free_edge=np.zeros((n_blades, n_node, 3)),
                frame=np.zeros((n_blades, 3, 3)), far=np.zeros(N_FAR),
                far_tube=np.zeros((N_TUBE, n_far)), far_ring=np.zeros((N_CELL, n_far)),
                nodes=np.zeros(bound_shape), gamma=np.zeros(gamma_shape),
                gamma_1=np.zeros(gamma_shape), gamma_2=np.zeros(gamma_shape), source=np.zeros(n_strip),
                source_1=np.zeros(n_strip), alpha=np.zeros(n_strip), speed=np.zeros(n_strip),
                separation=np.zeros((2, n_strip)),
                forces=np.zeros(bound_shape), influence=aligned_zeros((n_ring, 3, n_point)),
                inverse=aligned_zeros((n_ring, n_ring)), response=aligned_zeros((n_strip, n_strip)),
                wake_flow=aligned_zeros((3, n_point)), body_strength=np.zeros(n_panel),
            )
        )  # fmt: skip

    def clear(self) -> None:
        """Forget everything: no wake, no circulation, no velocities."""
        for array in self.arrays:
            array[...] = 0

    @property
    def _every(self) -> tuple[NDArray[Any], ...]:
        """The arrays, of whichever type."""
        return self.arrays

    def copy(self) -> AeroState:
        """Return an independent copy that continues bit for bit like this state."""
        return AeroState(AeroArrays._make(a.copy() for a in self.arrays))

    def assign(self, other: AeroState) -> None:
        """Take over all numbers of ``other`` in place."""
        for mine, theirs in zip(self._every, other._every, strict=True):
            mine[...] = theirs

    def __eq__(self, other: object) -> bool:
        """Equal when every number has the same bits."""
        if not isinstance(other, AeroState):
            return NotImplemented
        return all(np.array_equal(a, b, equal_nan=True) for a, b in zip(self._every, other._every, strict=True))

    __hash__: ClassVar[Any] = None

    @property
    def n_rows(self) -> int:
        """Number of wake rows behind the trailing edge."""
        return int(self.arrays.n_rows[0])

    @property
    def nodal_forces(self) -> Array:
        """Forces on the ring nodes of the last solve, shape (n_blades, n_chord + 1, n_span + 1, 3) [N]."""
        return self.arrays.forces

    @property
    def circulation(self) -> Array:
        """Circulation of each strip at the trailing edge, shape (n_blades, n_span) [m^2/s]."""
        return self.arrays.gamma[:, -1]

    @property
    def angle_of_attack(self) -> Array:
        """Effective angle of attack of each strip, shape (n_blades, n_span) [rad]."""
        return self.arrays.alpha.reshape(self.circulation.shape)

    @property
    def section_speed(self) -> Array:
        """Effective speed in the section plane of each strip, shape (n_blades, n_span) [m/s]."""
        return self.arrays.speed.reshape(self.circulation.shape)

    @property
    def separation_point(self) -> Array:
        """Separation point of each strip, shape (n_blades, n_span) [chords]; negative without dynamic stall."""
        result: Array = self.arrays.separation[0].reshape(self.circulation.shape)
        return result

    @property
    def residual(self) -> float:
        """Largest residual of the decambering equations after the last solve [m/s]."""
        return float(self.arrays.residual[0])

    @property
    def wake_nodes(self) -> Array:
        """Positions of the wake, shape (n_rows + 1, n_blades, n_edge + 1, 3), shedding edge first [m]."""
        return self.arrays.wake[: self.n_rows + 1]

    @property
    def wake_circulation(self) -> Array:
        """Circulation of the wake rings, shape (n_rows, n_blades, n_edge) [m^2/s]."""
        return self.arrays.wake_gamma[: self.n_rows]
