"""The state of the aerodynamics: plain arrays that can be copied, compared and continued bit for bit."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from wt_gym.aerodynamics.lattice import LatticePlanform
from wt_gym.aerodynamics.options import AeroOptions

__all__ = ["AeroArrays", "AeroState", "PlanformArrays"]

# Entries of AeroArrays.count
N_ROWS, STEP, LEVELS, PREPARED, CLOSED = range(5)
# Entries of AeroArrays.clock
DT, RESIDUAL, NEXT_DT = range(3)


class PlanformArrays(NamedTuple):
    """What the kernels need of a planform."""

    chord: np.ndarray
    edge_chord: np.ndarray
    polars: np.ndarray
    alpha0: np.ndarray
    kappa: np.ndarray
    moment0: np.ndarray
    slope_angle: np.ndarray
    cylinder_table: np.ndarray

    @classmethod
    def of(cls, planform: LatticePlanform, cylinder_table: np.ndarray) -> "PlanformArrays":
        """Gather the arrays; kappa is circulation per normal velocity of the two-dimensional lattice [m]."""
        return cls(
            planform.chord, planform.edge_chord, planform.polars, planform.alpha0_lattice,
            0.5 * planform.chord * planform.lift_slope, planform.moment0_lattice, planform.slope_angle, cylinder_table,
        )  # fmt: skip


class AeroArrays(NamedTuple):
    """All numbers of the state; the order of axes is row, blade, node, component for the wake.

    ``n_max`` = `AeroOptions.wake_rows`; wake row 0 is the trailing edge, row k the k-th shed row behind it.
    """

    count: np.ndarray  # int64 (5,): rows, step, number of stored levels of gamma, step prepared, far wake on
    clock: np.ndarray  # (3,): last step [s], residual of the decambering [m/s], step under way [s]
    origin: np.ndarray  # (3,) origin of float32 positions [m]
    wake: np.ndarray  # (n_max + 1, n_blade, n_node, 3) positions [m]
    history: np.ndarray  # same shape, velocity at the time before [m/s]
    induced: np.ndarray  # same shape, float32, induced velocity [m/s]
    wake_gamma: np.ndarray  # (n_max, n_blade, n_span) ring k between rows k and k + 1 [m^2/s]
    age: np.ndarray  # (n_max + 1,) time since shed [s]
    shed: np.ndarray  # int64 (n_max + 1,) step at which the row was shed
    free_edge: np.ndarray  # (n_blade, n_node, 3) where the air of the last trailing edge is now [m]
    far: np.ndarray  # far-wake cylinders, see far_wake_kernels
    nodes: np.ndarray  # (n_blade, n_chord + 1, n_node, 3) ring nodes of the last solve [m]
    gamma: np.ndarray  # (n_blade, n_chord, n_span) ring circulations [m^2/s]
    gamma_1: np.ndarray  # one accepted step ago
    gamma_2: np.ndarray  # two accepted steps ago
    source: np.ndarray  # (n_strip,) decambering velocity [m/s]
    source_1: np.ndarray  # decambering velocity over section speed, one accepted step ago [-]
    alpha: np.ndarray  # (n_strip,) effective angle of attack [rad]
    speed: np.ndarray  # (n_strip,) effective speed in the section plane [m/s]
    forces: np.ndarray  # (n_blade, n_chord + 1, n_node, 3) nodal forces [N]
    influence: np.ndarray  # (n_ring, 3, n_point) velocity per ring circulation, of this step
    inverse: np.ndarray  # (n_ring, n_ring)
    response: np.ndarray  # (n_strip, n_strip)
    wake_flow: np.ndarray  # (3, n_point) wake-induced velocity, of this step [m/s]


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
    def empty(cls, planform: LatticePlanform, n_blades: int, options: AeroOptions) -> "AeroState":
        """Arrays of the right shapes, without flow."""
        n_chord, n_span = planform.n_chord, planform.n_span
        n_node, n_max = n_span + 1, options.wake_rows
        n_strip = n_blades * n_span
        n_ring = n_strip * n_chord
        n_point = 2 * n_ring + n_blades * n_chord * n_node
        wake_shape = (n_max + 1, n_blades, n_node, 3)
        bound_shape = (n_blades, n_chord + 1, n_node, 3)
        gamma_shape = (n_blades, n_chord, n_span)
        return cls(
            AeroArrays(
                count=np.zeros(5, dtype=np.int64), clock=np.zeros(3), origin=np.zeros(3),
                wake=np.zeros(wake_shape), history=np.zeros(wake_shape), induced=np.zeros(wake_shape, dtype=np.float32),
                wake_gamma=np.zeros((n_max, n_blades, n_span)), age=np.zeros(n_max + 1),
                shed=np.zeros(n_max + 1, dtype=np.int64), free_edge=np.zeros((n_blades, n_node, 3)),
                far=np.zeros(7 + 4 * n_node), nodes=np.zeros(bound_shape), gamma=np.zeros(gamma_shape),
                gamma_1=np.zeros(gamma_shape), gamma_2=np.zeros(gamma_shape), source=np.zeros(n_strip),
                source_1=np.zeros(n_strip), alpha=np.zeros(n_strip), speed=np.zeros(n_strip),
                forces=np.zeros(bound_shape), influence=np.zeros((n_ring, 3, n_point)),
                inverse=np.zeros((n_ring, n_ring)), response=np.zeros((n_strip, n_strip)),
                wake_flow=np.zeros((3, n_point)),
            )
        )  # fmt: skip

    def copy(self) -> "AeroState":
        """Return an independent copy that continues bit for bit like this state."""
        return AeroState(AeroArrays(*(a.copy() for a in self.arrays)))

    def assign(self, other: "AeroState") -> None:
        """Take over all numbers of ``other`` in place."""
        for mine, theirs in zip(self.arrays, other.arrays, strict=True):
            mine[...] = theirs

    def __eq__(self, other) -> bool:
        """Equal when every number has the same bits."""
        if not isinstance(other, AeroState):
            return NotImplemented
        return all(np.array_equal(a, b, equal_nan=True) for a, b in zip(self.arrays, other.arrays, strict=True))

    __hash__ = None

    @property
    def n_rows(self) -> int:
        """Number of wake rows behind the trailing edge."""
        return int(self.arrays.count[N_ROWS])

    @property
    def nodal_forces(self) -> np.ndarray:
        """Forces on the ring nodes of the last solve, shape (n_blades, n_chord + 1, n_span + 1, 3) [N]."""
        return self.arrays.forces

    @property
    def circulation(self) -> np.ndarray:
        """Circulation of each strip at the trailing edge, shape (n_blades, n_span) [m^2/s]."""
        return self.arrays.gamma[:, -1]

    @property
    def angle_of_attack(self) -> np.ndarray:
        """Effective angle of attack of each strip, shape (n_blades, n_span) [rad]."""
        return self.arrays.alpha.reshape(self.circulation.shape)

    @property
    def section_speed(self) -> np.ndarray:
        """Effective speed in the section plane of each strip, shape (n_blades, n_span) [m/s]."""
        return self.arrays.speed.reshape(self.circulation.shape)

    @property
    def residual(self) -> float:
        """Largest residual of the decambering equations after the last solve [m/s]."""
        return float(self.arrays.clock[RESIDUAL])

    @property
    def wake_nodes(self) -> np.ndarray:
        """Positions of the wake, shape (n_rows + 1, n_blades, n_span + 1, 3), trailing edge first [m]."""
        return self.arrays.wake[: self.n_rows + 1]

    @property
    def wake_circulation(self) -> np.ndarray:
        """Circulation of the wake rings, shape (n_rows, n_blades, n_span) [m^2/s]."""
        return self.arrays.wake_gamma[: self.n_rows]
