"""Choices of the vortex-lattice solver, with the measured error of the presets' wakes."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from wt_gym.base.declared import broken, check_fields, count, number, one_of, whole
from wt_gym.base.errors import WtGymError
from wt_gym.base.types import Integers


class AerodynamicsError(WtGymError, ValueError):
    """A lattice, an option or an inflow with which the vortex lattice cannot work."""


SEPARATION_LAG = 4.0
"""Time constant of the separation point with ``dynamic_stall`` in chord lengths traveled [-], Øye's own (1991)."""

RULES = {
    "n_chord n_span wake_rows full_rows coarse_stride sparse_stride sparse_span refresh_stride": whole(1),
    "wind_stride far_wake_rows": whole(1),
    "fresh_rows": whole(0),
    "bound_core wake_core viscosity squire stall_lag": number(0.0),
    "azimuth_step_deg": number(0.0, above=True),
    "tree_tolerance": number(0.0, 0.1, above=True, below=True),
    "shed_fraction": number(0.0, 1.0, above=True),
    "ground_height": number(0.0).or_none,
    "dynamic_stall": one_of("oye").or_none,
    "load_form": one_of("joukowski", "bernoulli"),
    "narrow_strips": one_of("ends", "tip"),
    "induction": one_of("direct", "tree"),
}


@dataclass(frozen=True)
class AeroOptions:
    """Discretization, wake treatment and physics of a `VortexLattice`.

    Always there: the force of the changing circulation (added mass), and the arcs for which the two segments stand that
    meet in a node of the wake, see `local_induction_kernels`: without them a wake moves the faster the longer its
    segments are.

    Parameters
    ----------
    n_chord, n_span : int
        Panels along the chord and along the span of one blade.
    narrow_strips : str
        Where the strips of a blade are narrower: "ends", or "tip" for few of them, see `planform.span_distribution`.
    azimuth_step_deg : float
        Recommended turn of the rotor in one aerodynamic step [deg]; the solver itself takes any time step.
    wake_rows : int
        Most rows of wake rings that are kept; older rows are dropped.
    trailing_edge_wake, tip_wake : bool
        Edges that shed a wake: the trailing edge, and the tip of a blade (the side edge from the trailing corner to the
        leading edge). At least one must: without a wake the flow has no memory.
    full_rows, coarse_stride : int
        Rows older than the first ``full_rows`` keep only every ``coarse_stride``-th shed row; the rings between are
        merged with their time-weighted mean circulation. ``coarse_stride=1`` keeps all.
    sparse_from, sparse_stride, sparse_span : int
        From row ``sparse_from`` on (None: nowhere) only every ``sparse_stride``-th shed row is kept, and of its nodes
        only the last three, every ``sparse_span``-th inboard of them and the first carry vortices, rings between merged
        by the areas that they sweep; the other nodes move with the velocities of these neighbors. With
        ``sparse_from=None`` both must be 1.
    fresh_rows, refresh_stride : int
        The induced velocity of the first ``fresh_rows`` rows is computed every step, that of an older row in turn every
        ``refresh_stride`` steps, in the first third of the rows every ``refresh_stride // 4``. Between, it turns with
        the blade (rows one step apart) or belongs to the air.
    wind_stride : int
        The undisturbed wind at wake rows behind the shedding edge is asked for every ``wind_stride`` steps, rows in
        turn; between, the air keeps its wind as it moves. No common divisor with the strides of the rows spreads the
        work evenly.
    far_wake : bool
        Continue the wake behind its last row by a semi-infinite vortex cylinder per span boundary (rotors only).
    far_wake_rows : int
        Number of the oldest rows from which strength, radius and axis of those cylinders are measured.
    viscous : bool
        Decambering from the airfoil polars, fed back into the boundary condition, with profile drag and moment.
    stall_lag : float
        Time constant of the decambering in chord lengths traveled [-]. It only delays the approach to the polar: it
        selects one branch, continuously in time, where a stalled strip has several steady solutions. Not used with
        ``dynamic_stall``, whose separation point does the same.
    dynamic_stall : str or None
        None: the static polar, with ``stall_lag``. "oye": the separation point lags behind that of the static polar;
        while the flow is still attached, the lift exceeds the polar and the drag falls below it (Øye 1991; drag of
        Hansen, Gaunaa & Madsen 2004). Needs ``viscous``.
    load_form : str
        "joukowski": force of the local velocity on every bound segment, with the suction of the leading edge;
        "bernoulli": pressure jump of the panels along their normals (Gebhardt et al. 2012, section 3), without it.
    bound_core : float
        Core radius of bound segments in the boundary condition, in panel chords [-].
    wake_core : float
        Initial core radius of wake segments in local chords [-].
    viscosity : float
        Kinematic viscosity of air [m^2/s].
    squire : float
        Coefficient a1 of the turbulent core growth, rc^2 = rc0^2 + 4 * 1.25643 * (nu + a1 |Gamma|) * age [-].
    core_strain : bool
        A stretched segment keeps the volume of its core: rc^2 l grows by 4 * 1.25643 * (nu + a1 |Gamma|) l dt, so that
        the core shrinks where the filament is drawn out (Bhagwat & Leishman, AHS Forum 58, 2002). Otherwise age alone
        sets the core.
    curved_filaments : bool
        Move the corners of the wake's trailing polygons outwards by two thirds of the sagitta of their segments, so
        that a polygon follows the curve through its nodes with no mean deviation; an error of the azimuth step squared.
    shed_fraction : float
        Position of the newest wake row between the trailing edge (0) and the place to which the air that passed the
        trailing edge one step ago has moved (1). Below one half the lumped shed vortex best represents the sheet.
    induction : str
        "direct": every segment at every target; "tree": far clusters of segments by their moments, for wakes of more
        than some 10 000 segments.
    tree_tolerance : float
        Error of the tree code, root mean square, relative to the mean induced velocity.
    ground_height : float or None
        Height of a flat ground, not negative [m]; the wake and the blades are then mirrored in it. None: no ground.

    Raises
    ------
    AerodynamicsError
        If a value lies outside the range in which it has a meaning.
    """

    n_chord: int = 2
    n_span: int = 18
    narrow_strips: str = "ends"
    azimuth_step_deg: float = 8.0
    wake_rows: int = 135
    trailing_edge_wake: bool = True
    tip_wake: bool = False
    full_rows: int = 135
    coarse_stride: int = 1
    sparse_from: int | None = None
    sparse_stride: int = 1
    sparse_span: int = 1
    fresh_rows: int = 135
    refresh_stride: int = 1
    wind_stride: int = 1
    far_wake: bool = True
    far_wake_rows: int = 90
    viscous: bool = True
    stall_lag: float = 1.5
    dynamic_stall: str | None = None
    load_form: str = "joukowski"
    bound_core: float = 0.01
    wake_core: float = 0.1
    viscosity: float = 1.5e-5
    squire: float = 1e-4
    core_strain: bool = True
    curved_filaments: bool = True
    shed_fraction: float = 0.25
    induction: str = "direct"
    tree_tolerance: float = 1e-3
    ground_height: float | None = None

    def __post_init__(self) -> None:
        """Refuse values without meaning, and thinning that contradicts itself."""
        check_fields(self, RULES, AerodynamicsError)
        if not (self.trailing_edge_wake or self.tip_wake):
            raise AerodynamicsError(
                "AeroOptions.trailing_edge_wake and tip_wake are both False: a lattice that sheds no wake has no memory"
            )
        if self.dynamic_stall and not self.viscous:
            raise AerodynamicsError(
                f"AeroOptions.dynamic_stall is {self.dynamic_stall!r} with viscous=False; it needs the polars: "
                "viscous=True"
            )
        if self.sparse_from is None and (self.sparse_stride != 1 or self.sparse_span != 1):
            raise AerodynamicsError(
                f"AeroOptions.sparse_stride is {self.sparse_stride} and sparse_span {self.sparse_span} with "
                "sparse_from=None; both must be 1 there, or sparse_from a row number: nothing else thins by them"
            )
        if self.sparse_from is not None and not count(self.sparse_from, int(self.full_rows) + 1):
            allowed = f"None or more than full_rows, {self.full_rows}, a whole number"
            raise broken(self, "sparse_from", allowed, AerodynamicsError)
        if self.sparse_from is not None and self.sparse_stride % self.coarse_stride:
            allowed = f"a multiple of coarse_stride, {self.coarse_stride}"
            raise broken(self, "sparse_stride", allowed, AerodynamicsError)

    def for_step(self, step_deg: float) -> AeroOptions:
        """Options for a step that turns the rotor by another angle than the recommended one.

        What makes a thinned wake right is how far its rows lie apart and how many turns they reach, not how many steps
        that takes: in steps of 3 instead of 8 degrees every third row leaves two fifths of the turns, and a rotor that
        runs fast for its wind then has 2 to 11 % too much power. So strides become the longest that leave rows no
        further apart than at ``azimuth_step_deg`` (case ``iea-15mw-rotor``); what is not thinned stays so.

        Parameters
        ----------
        step_deg : float
            Turn of the rotor in one step [deg].

        Returns
        -------
        AeroOptions
            Equal to these where strides stay.
        """
        steps = self.azimuth_step_deg / step_deg
        coarse = max(math.floor(self.coarse_stride * steps + 1e-9), 1) if self.coarse_stride > 1 else 1
        apart = max(math.floor(self.sparse_stride * steps / coarse + 1e-9), 1) if self.sparse_stride > 1 else 1
        thinned = replace(self, coarse_stride=coarse, sparse_stride=apart * coarse if self.sparse_stride > 1 else 1)
        if thinned == self:
            return self
        # rows take turns at asking for their wind: with a common divisor of the strides many would ask together
        turns = self.wind_stride
        while turns > 1 and math.gcd(turns, coarse * apart) > 1:
            turns += 1
        return replace(thinned, wind_stride=turns)

    def row_numbers(self) -> Integers:
        """Steps since each row of a full wake was shed, newest first, given the thinning of old rows.

        Returns
        -------
        ndarray of int, shape (wake_rows,)
        """
        numbers: list[int] = []
        step = 0
        while len(numbers) < self.wake_rows:
            row = len(numbers) + 1
            stride = self.coarse_stride if row > self.full_rows else 1
            if self.sparse_from is not None and row > self.sparse_from:
                stride = self.sparse_stride
            if step % stride == 0:
                numbers.append(step)
            step += 1
        return np.array(numbers)


# Errors against a converged lattice and REFERENCE: scripts/validate.py run power-curve-ladder turbulence-ladder.
# Rows 24 degrees apart: three blades then have corners at the same azimuths, and the polygons of a turn lie as
# regularly as the curves they stand for. 40 degrees are too far; so are 32, where the corners lie between each other.
# Three and a half turns at 8 degrees a step: 8 steps in full, 156 with every third row, behind the first ones with six
# of eleven nodes.
TRAINING = AeroOptions(
    n_chord=1, n_span=10, narrow_strips="tip", azimuth_step_deg=8.0, wake_rows=60, full_rows=8, coarse_stride=3,
    sparse_from=12, sparse_stride=3, sparse_span=3, fresh_rows=0, refresh_stride=16, wind_stride=10, far_wake_rows=16,
    squire=2e-3,
)  # fmt: skip
# Four turns: 16 steps in full, 168 with every third row.
ENGINEERING = AeroOptions(
    n_chord=2, n_span=16, azimuth_step_deg=8.0, wake_rows=72, full_rows=16, coarse_stride=3, sparse_from=32,
    sparse_stride=3, sparse_span=3, fresh_rows=1, refresh_stride=8, wind_stride=3, far_wake_rows=22, squire=1e-3,
)  # fmt: skip
# 11 turns at 9 rpm, 15 at 12 rpm, all of them free and recomputed every step; every second row beyond the first 200.
# The tree code stays well below the error that it is allowed: 3e-3 gives less than 1e-3 (test_tree_induction.py).
REFERENCE = AeroOptions(
    n_chord=4, n_span=24, azimuth_step_deg=7.5, wake_rows=480, full_rows=200, coarse_stride=2, fresh_rows=480,
    refresh_stride=1, far_wake=False, squire=1e-3, induction="tree", tree_tolerance=3e-3,
)  # fmt: skip
