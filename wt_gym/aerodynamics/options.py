"""Choices of the vortex-lattice solver, with the measured error of the presets' wakes."""

import math
from dataclasses import replace

import numpy as np

from wt_gym.base.errors import WtGymError
from wt_gym.base.options import Options, option, option_record
from wt_gym.base.quantities import Integers


class AerodynamicsError(WtGymError, ValueError):
    """A lattice, an option or an inflow with which the vortex lattice cannot work."""


SEPARATION_LAG = 4.0
"""Time constant of the separation point with ``dynamic_stall`` in chord lengths traveled [-], Øye's own (1991)."""


@option_record
class AeroOptions(Options):
    """Discretization, wake treatment and physics of a `VortexLattice`.

    Always there: the force of the changing circulation (added mass), and the arcs for which the two segments stand that
    meet in a node of the wake, see `local_induction_kernels`: without them a wake moves the faster the longer its
    segments are.

    Raises
    ------
    AerodynamicsError
        If a value lies outside the range in which it has a meaning.
    """

    title = "aero"
    prefix = "AeroOptions."
    error = AerodynamicsError

    n_chord: int = option("panels along the chord of one blade", default=2, low=1)
    n_span: int = option("panels along the span of one blade", default=18, low=1)
    narrow_strips: str = option(
        "where strips are narrower, see `planform.span_distribution`", default="ends", choices=("ends", "tip")
    )
    azimuth_step_deg: float = option(
        "recommended turn a step; any is taken", default=8.0, unit="deg", low=0, above=True
    )
    wake_rows: int = option("most rows of wake rings that are kept; older rows are dropped", default=135, low=1)
    trailing_edge_wake: bool = option(
        "the trailing edge sheds a wake; it or the tip must: without a wake the flow has no memory", default=True
    )
    tip_wake: bool = option(
        "the tip (the side edge from the trailing corner to the leading edge) sheds a wake", default=False
    )
    full_rows: int = option("rows that keep every shed row; older ones are thinned", default=135, low=1)
    coarse_stride: int = option(
        "rows older than ``full_rows`` keep every such shed row only; the rings between are merged with their "
        "time-weighted mean circulation",
        default=1,
        low=1,
    )
    sparse_from: int | None = option("row beyond which ``sparse_stride`` holds", default=None, otherwise="nowhere")
    sparse_stride: int = option("from there on only every such shed row is kept", default=1, low=1)
    sparse_span: int = option(
        "of its nodes only the last three, every such one inboard of them and the first carry vortices, rings between "
        "merged by the areas that they sweep; the other nodes move with the velocities of these neighbors",
        default=1,
        low=1,
    )
    fresh_rows: int = option("rows whose induced velocity is computed every step", default=135, low=0)
    refresh_stride: int = option(
        "that of older rows is computed in turn every so many steps, in the first third of the rows every quarter of "
        "it; between, it turns with the blade (rows one step apart) or belongs to the air",
        default=1,
        low=1,
    )
    wind_stride: int = option(
        "the wind at rows behind the shedding edge is asked for every so many steps, rows in turn; between, the air "
        "keeps it as it moves. No common divisor with the strides of the rows spreads the work evenly",
        default=1,
        low=1,
    )
    far_wake: bool = option(
        "continue the wake by a semi-infinite vortex cylinder per span boundary (rotors only)", default=True
    )
    far_wake_rows: int = option("oldest rows that give strength, radius and axis of the cylinders", default=90, low=1)
    viscous: bool = option(
        "decambering from the polars, fed back into the boundary condition, with profile drag and moment", default=True
    )
    stall_lag: float = option(
        "time constant of the decambering in chord lengths traveled. It only delays the approach to the polar: it "
        "selects one branch, continuously in time, where a stalled strip has several steady solutions. Not used with "
        "``dynamic_stall``, whose separation point does the same",
        default=1.5,
        unit="-",
        low=0,
    )
    dynamic_stall: str | None = option(
        '"oye": the separation point lags behind that of the static polar; while the flow is still attached, the lift '
        "exceeds the polar and the drag falls below it (Øye 1991; drag of Hansen, Gaunaa & Madsen 2004). Needs "
        "``viscous``",
        default=None,
        otherwise="the static polar, with ``stall_lag``",
        choices=("oye",),
    )
    load_form: str = option(
        '"joukowski": force of the local velocity on every bound segment, with the suction of the leading edge; '
        '"bernoulli": pressure jump of the panels along their normals (Gebhardt et al. 2012, section 3), without it',
        default="joukowski",
        choices=("joukowski", "bernoulli"),
    )
    bound_core: float = option("core of bound segments in the boundary condition, in panel chords", default=0.01, low=0)
    wake_core: float = option("initial core of wake segments in local chords", default=0.1, unit="-", low=0)
    viscosity: float = option("kinematic, of air", default=1.5e-5, unit="m^2/s", low=0)
    squire: float = option(
        "a1 of the turbulent core growth, rc^2 = rc0^2 + 4 * 1.25643 * (nu + a1 |Gamma|) * age", default=1e-4, low=0
    )
    core_strain: bool = option(
        "a stretched segment keeps the volume of its core: rc^2 l grows by 4 * 1.25643 * (nu + a1 |Gamma|) l dt "
        "(Bhagwat & Leishman, AHS Forum 58, 2002); otherwise age alone sets the core",
        default=True,
    )
    curved_filaments: bool = option(
        "move the corners of the wake's trailing polygons outwards by two thirds of the sagitta of their segments, so "
        "that a polygon follows the curve through its nodes with no mean deviation",
        default=True,
    )
    shed_fraction: float = option(
        "place of the newest row between the trailing edge (0) and where the air that passed it a step ago is now (1); "
        "below one half the lumped shed vortex best represents the sheet",
        default=0.25,
        low=0,
        high=1,
        above=True,
    )
    induction: str = option(
        '"tree": moments of far clusters, from 10 000 segments on', default="direct", choices=("direct", "tree")
    )
    tree_tolerance: float = option(
        "rms error over the mean velocity", default=1e-3, low=0, high=0.1, above=True, below=True
    )
    ground_height: float | None = option(
        "of a flat ground that mirrors wake and blades", default=None, unit="m", otherwise="no ground", low=0
    )

    def check(self) -> None:
        """Refuse a lattice without memory, and thinning that contradicts itself."""
        if not (self.trailing_edge_wake or self.tip_wake):
            raise AerodynamicsError(
                "AeroOptions.trailing_edge_wake and tip_wake are both False: a lattice that sheds no wake has no memory"
            )
        if self.dynamic_stall and not self.viscous:
            raise AerodynamicsError(
                f"AeroOptions.dynamic_stall is {self.dynamic_stall!r} with viscous=False; it needs the polars: "
                "viscous=True"
            )
        start, stride, span = self.sparse_from, self.sparse_stride, self.sparse_span
        if start is None and (stride, span) != (1, 1):
            raise AerodynamicsError(
                f"AeroOptions.sparse_stride and sparse_span must be 1 with sparse_from=None, got {stride} and {span}"
            )
        if start is not None and start <= self.full_rows:
            raise AerodynamicsError(
                f"AeroOptions.sparse_from must be None or more than full_rows, {self.full_rows}, got {start}"
            )
        if start is not None and stride % self.coarse_stride:
            raise AerodynamicsError(
                f"AeroOptions.sparse_stride must be a multiple of coarse_stride, {self.coarse_stride}, got {stride}"
            )

    def for_step(self, step_deg: float) -> "AeroOptions":
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
