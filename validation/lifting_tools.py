"""Wings as inviscid vortex lattices, for the cases that compare the lattice with lifting-surface theory.

Wings lie in the y–z plane with the chord along +y and the span along +z; the lift points along +x.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from wt_gym.aerodynamics import AeroOptions, LatticePlanform, VortexLattice, build_planform

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from wt_gym.aerodynamics import AeroState

__all__ = [
    "UniformStream",
    "WingFlow",
    "far_field_drag",
    "flat_planform",
    "half_span_edges",
    "panels_of",
    "steady_coefficients",
    "steady_wing",
    "two_dimensional_planform",
]

INVISCID: dict[str, Any] = {
    "viscous": False, "far_wake": False, "bound_core": 1e-4, "wake_core": 1e-3, "squire": 0.0, "viscosity": 0.0,
}  # fmt: skip
"""Potential flow with vortices as thin as single precision allows."""
MIRRORED = {"ground_height": 0.0}
"""The plane z = 0 as plane of symmetry: the images of wing and wake are the other half."""
DRIFTING = {"fresh_rows": 0, "refresh_stride": 10**9}
"""A wake that drifts with the stream: at small incidence the velocity it induces on itself is of second order."""
STRIPS_OF_A_SECTION = 8
"""Strips of the half wing that stands for a section."""


class UniformStream:
    """An inflow of one velocity everywhere.

    Parameters
    ----------
    velocity : array_like, shape (3,)
        [m/s].
    """

    def __init__(self, velocity: ArrayLike):
        self.vector = np.asarray(velocity, dtype=np.float64)

    @classmethod
    def at_incidence(cls, alpha: float, speed: float = 1.0) -> UniformStream:
        """Stream that meets a wing in the y–z plane at the angle of attack ``alpha`` [rad]."""
        return cls(speed * np.array([np.sin(alpha), np.cos(alpha), 0.0]))

    def velocity(self, points: ArrayLike, time: ArrayLike) -> NDArray[np.float64]:
        """Wind at the points (..., 3) [m/s]."""
        return np.broadcast_to(self.vector, np.shape(points))


def half_span_edges(half_span: float, n_span: int, inset: float = 0.25) -> np.ndarray:
    """Even span edges from the plane of symmetry at z = 0 to ``inset`` panel widths before the tip (Hough 1973)."""
    return half_span / (n_span + inset) * np.arange(n_span + 1)


def flat_planform(
    edges: ArrayLike,
    chord: float | NDArray[np.float64],
    n_chord: int,
    le_offset: float | NDArray[np.float64] = 0.25,
    polar: NDArray[np.float64] | None = None,
) -> LatticePlanform:
    """Flat wing whose reference axis is the z axis.

    Parameters
    ----------
    edges : array_like, shape (n_span + 1,)
        Span coordinates of the lattice [m].
    chord, le_offset : float or array_like, shape (n_span + 1,)
        Chord [m] and distance from the leading edge to the axis, in chords.
    n_chord : int
        Panels along the chord.
    polar : ndarray, shape (n_alpha, 3), optional
        Of the sections, on even angles from -pi on; a flat plate's in potential flow if not given.
    """
    edges = np.asarray(edges, dtype=np.float64)
    one = np.ones_like(edges)
    if polar is None:
        angles = np.linspace(-np.pi, np.pi, 360, endpoint=False)
        polar = np.column_stack([2.0 * np.pi * np.sin(angles), 0.0 * angles, 0.0 * angles])
    axis = np.column_stack([0.0 * edges, 0.0 * edges, edges])
    polars = np.tile(polar, (edges.size - 1, 1, 1))
    return build_planform(edges, axis, chord * one, 0.0 * one, le_offset * one, polars, n_chord)


def two_dimensional_planform(n_chord: int, polar: NDArray[np.float64] | None = None) -> LatticePlanform:
    """Half of a very long wing, to be mirrored at z = 0; its first strip, one chord wide, is the section.

    The strips grow threefold outwards up to 512 panel chords: half a panel chord away from a longer segment, the
    difference of two nearly equal products in the Biot-Savart kernel is lost in single precision, and the outer strips
    become unstable. With 8, 16, 24 panels the aspect ratio is 590, 330, 230.
    """
    widths = np.minimum(3.0 ** np.arange(STRIPS_OF_A_SECTION), 512.0 / n_chord)
    return flat_planform(np.concatenate(([0.0], np.cumsum(widths))), 1.0, n_chord, polar=polar)


def panels_of(planform: LatticePlanform) -> dict[str, int]:
    """Options with the numbers of panels of this planform."""
    return {"n_chord": planform.n_chord, "n_span": planform.n_span}


def steady_wing(
    planform: LatticePlanform, alpha: float, **options: Any
) -> tuple[VortexLattice, AeroState, UniformStream]:
    """Lattice and state of a half wing, mirrored at z = 0, with a straight wake of one row, two thousand spans long.

    Returns
    -------
    lattice : VortexLattice
    state : AeroState
    stream : UniformStream
    """
    chosen = INVISCID | MIRRORED | panels_of(planform) | {"wake_rows": 1} | options
    lattice = VortexLattice(planform, 1, AeroOptions(**chosen), 1.0)
    stream = UniformStream.at_incidence(alpha)
    state = lattice.new_state()
    nodes = planform.nodes[None].copy()
    still = np.zeros_like(nodes)
    edge = 0.25 * nodes[:, -2] + 0.75 * nodes[:, -1]
    length = 2e3 * (planform.span_edges[-1] - planform.span_edges[0])
    lattice.initialize_wake(state, nodes, still, still + stream.vector, [edge + length * stream.vector], [length])
    return lattice, state, stream


def steady_coefficients(state: AeroState, stream: UniformStream, area: float) -> tuple[float, float]:
    """Lift and drag coefficient of a half wing of this area in a unit stream in the x–y plane."""
    total = state.nodal_forces.sum(axis=(0, 1, 2)) / (0.5 * area)
    along = stream.vector
    return float(total @ [along[1], -along[0], 0.0]), float(total @ along)


def far_field_drag(circulation: ArrayLike, edges: ArrayLike) -> float:
    """Induced drag of a mirrored half wing with a straight wake, from the Trefftz plane, density 1 [N].

    Half of ∫ Γ w dz over the half span, with the downwash w of the two-dimensional point vortices in which the strips
    of both halves end, taken at the middle of each strip (Munk 1921; Katz & Plotkin, Low-Speed Aerodynamics, 8.4).
    """
    half, span = np.asarray(circulation), np.asarray(edges)
    whole, ends = np.r_[half[::-1], half], np.r_[-span[:0:-1], span]
    trailing = np.diff(np.concatenate(([0.0], whole, [0.0])))
    middle = 0.5 * (ends[1:] + ends[:-1])
    downwash = (trailing / (2.0 * np.pi * (ends - middle[:, None]))).sum(axis=1)
    return 0.25 * abs(float(np.sum(whole * downwash * np.diff(ends))))


class WingFlow:
    """A half wing, mirrored at z = 0, marched in time from rest or from an impulsive start.

    Parameters
    ----------
    planform : LatticePlanform
    stream : UniformStream
    n_steps : int
        Number of steps for which wake rows are kept.
    dt : float
        [s].
    drifting : bool
        Let the wake drift with the stream instead of moving freely.
    **options
        Further `AeroOptions`.
    """

    def __init__(
        self,
        planform: LatticePlanform,
        stream: UniformStream,
        n_steps: int,
        dt: float,
        drifting: bool = True,
        **options: Any,
    ):
        rows = {"wake_rows": n_steps + 1, "full_rows": n_steps + 1, "fresh_rows": n_steps + 1}
        chosen = INVISCID | MIRRORED | panels_of(planform) | rows | (DRIFTING if drifting else {}) | options
        self.lattice = VortexLattice(planform, 1, AeroOptions(**chosen), 1.0)
        self.state = self.lattice.new_state()
        self.stream, self.dt, self.n_done = stream, float(dt), 0
        self.nodes = planform.nodes[None].copy()
        self.still = np.zeros_like(self.nodes)
        self.wind = self.still + stream.vector

    def start_from_rest(self) -> None:
        """Begin without circulation; the first step brings wind and motion, without the impulse of the start."""
        self.lattice.reset(self.state, self.nodes, self.still, self.still)

    def start_moving(self, nodes: NDArray[np.float64], velocities: NDArray[np.float64]) -> None:
        """Begin with the circulation of this motion (1, n_chord + 1, n_span + 1, 3), without a wake."""
        self.lattice.reset(self.state, nodes, velocities, self.wind)

    def step(
        self,
        nodes: NDArray[np.float64] | None = None,
        velocities: NDArray[np.float64] | None = None,
        gust: NDArray[np.float64] | None = None,
    ) -> NDArray[np.float64]:
        """Forces on the ring nodes (n_chord + 1, n_span + 1, 3) after one more step; at rest where nothing is given.

        ``gust`` (1, n_chord + 1, n_span + 1, 3) is the velocity of the air beside the stream at the nodes [m/s]; the
        wake drifts with the stream, as in linear theory.
        """
        self.lattice.convect_wake(self.state, self.stream, self.n_done * self.dt, self.dt)
        forces = self.lattice.solve(
            self.state,
            self.nodes if nodes is None else nodes,
            self.still if velocities is None else velocities,
            self.wind if gust is None else self.wind + gust,
            self.dt,
        )
        self.lattice.accept(self.state)
        self.n_done += 1
        return forces[0]

    def section_lift(self, forces: NDArray[np.float64]) -> float:
        """Lift coefficient of the first strip of a mirrored wing: half of its force acts on the nodes at z = 0."""
        width = self.lattice.planform.span_edges[1] - self.lattice.planform.span_edges[0]
        return float(2.0 * forces[:, 0, 0].sum() / (0.5 * width))

    def section_moment(self, forces: NDArray[np.float64]) -> float:
        """Moment coefficient of that strip about the reference axis, nose-up positive, chord 1."""
        width = self.lattice.planform.span_edges[1] - self.lattice.planform.span_edges[0]
        return float(-2.0 * forces[:, 0, 0] @ self.nodes[0, :, 0, 1] / (0.5 * width))
