"""The unsteady vortex-lattice method: blades on their camber surfaces, free wake, loads."""

import math
from functools import lru_cache
from itertools import pairwise
from numbers import Integral
from typing import Protocol, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import ellipe, ellipkm1

from wt_gym.aerodynamics import step_kernels
from wt_gym.aerodynamics.bodies.body_set import BodyArrays, BodySet, BodyWork
from wt_gym.aerodynamics.induction.simd_kernels import WIDTH
from wt_gym.aerodynamics.induction.tree_induction import TreeInduction, aligned_zeros, run_beside, split_direct
from wt_gym.aerodynamics.lattice.planform import LatticePlanform, check_areas, numeric_array
from wt_gym.aerodynamics.options import AerodynamicsError, AeroOptions
from wt_gym.aerodynamics.state import AeroArrays, AeroConstants, AeroState, AeroWork, PlanformArrays
from wt_gym.aerodynamics.wake.far_wake_kernels import far_wake_velocity
from wt_gym.aerodynamics.wake.wake_kernels import (
    fold_images,
    mean_induced,
    pad_targets,
    place_newest_row,
    rows_for_wind,
    shedding_edge,
    store_wind,
    wake_sheets,
)
from wt_gym.base.quantities import Array, Integers


def ring_velocity(axial: Array, radial: Array, core: float) -> tuple[Array, Array]:
    """Velocity of a vortex ring of unit radius and unit circulation.

    Parameters
    ----------
    axial, radial : ndarray
        Position relative to the ring's center, in ring radii.
    core : float
        Softening of the distance to the ring, in ring radii.

    Returns
    -------
    axial_velocity, radial_velocity : ndarray
        Positive axial velocity inside the ring (Lamb, Hydrodynamics, art. 161).
    """
    axial, radial = np.broadcast_arrays(axial, radial)
    far2 = (1.0 + radial) ** 2 + axial**2 + core**2
    near2 = (1.0 - radial) ** 2 + axial**2 + core**2
    k, e = ellipkm1(near2 / far2), ellipe(1.0 - near2 / far2)
    root = np.sqrt(far2)
    u = (k + (1.0 - radial**2 - axial**2 - core**2) / near2 * e) / (2.0 * np.pi * root)
    safe = np.maximum(radial, 1e-6)
    v = axial / safe * (-k + (1.0 + radial**2 + axial**2 + core**2) / near2 * e) / (2.0 * np.pi * root)
    return u, np.where(radial > 1e-6, v, 0.0)


@lru_cache(maxsize=2)
def cylinder_table(n_axial: int = 193, n_radial: int = 129, core: float = 0.05) -> NDArray[np.float32]:
    """Velocity of the cylinder r = 1, z > 0 with unit tangential vorticity per length.

    The rings of the cylinder are summed along z. Far upstream it acts as a sink of strength pi in its first disc;
    that closed form starts the sum.

    Returns
    -------
    table : ndarray, shape (2, n_axial, n_radial), float32
        Axial and radial velocity at z / (1 + |z|) evenly spaced over [-1, 1] and r / (1 + r) over [0, 1].
    """
    p = np.linspace(-1.0, 1.0, n_axial)
    q = np.linspace(0.0, 1.0, n_radial)
    limit = 0.998
    z_grid = np.clip(p, -limit, limit) / (1.0 - np.abs(np.clip(p, -limit, limit)))
    r_grid = (np.minimum(q, limit) / (1.0 - np.minimum(q, limit)))[:, None]
    # Between neighboring table lines a dozen steps, fine where the ring is near.
    steps = np.unique(np.concatenate([np.linspace(a, b, 13) for a, b in pairwise(z_grid)]))
    u, v = ring_velocity(steps, r_grid, core)
    dz = np.diff(steps)
    distance = np.sqrt(steps[0] ** 2 + r_grid**2)
    u0, v0 = -0.25 * steps[0] / distance**3, -0.25 * r_grid / distance**3
    sums = [
        np.concatenate([c0, c0 + np.cumsum(0.5 * (c[:, 1:] + c[:, :-1]) * dz, axis=1)], axis=1)
        for c, c0 in ((u, u0), (v, v0))
    ]
    at_grid = np.searchsorted(steps, z_grid - 1e-12)
    table = np.stack([s[:, at_grid].T for s in sums]).astype(np.float32)
    table[:, :, -1] = 0.0  # infinitely far from the axis
    table[:, 0] = 0.0  # infinitely far upstream
    table.setflags(write=False)
    return table


SLOWEST = 0.01
"""Mean induced velocity [m/s] below which the tolerance of the tree code is no longer relative to it."""


class SplitInduction:
    """Velocities of bound lattice, wake and far wake for one lattice, outside of its compiled step.

    Parameters
    ----------
    lattice : VortexLattice
        With the tolerance of the tree code in its options.
    threads : int
        At least 1.
    """

    def __init__(self, lattice: "VortexLattice", threads: int) -> None:
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


PASSES = 25
"""Most passes between a prescribed wake and the circulation of the blades."""
BALANCED, ROUGHLY_BALANCED = 2e-5, 2e-3
"""Change of the circulation in a pass, over the circulation, with which a balance is found, or good enough on the way
to another wake."""
UNBALANCED = 0.05
"""Largest change of the circulation in the last of them, over the circulation."""
SMALLEST_THRUST = 0.2
"""Thrust over an earlier one from which on the circulation of the wake is taken in proportion."""


class UndisturbedWind(Protocol):
    """A wind that the wake moves in."""

    def velocity(self, points: Array, time: float) -> ArrayLike:
        """Velocity (..., 3) at points (..., 3) in global coordinates, at a time [s]."""


class VortexLattice:
    """N equal blades (or wings) in unsteady potential flow with decambering from airfoil polars.

    A step from t to t + dt is ``convect_wake``, then ``solve`` as often as the structure iterates, then ``accept``.
    The lattice holds no state of the flow, only work arrays: one lattice may serve many states, one at a time.

    Parameters
    ----------
    planform : LatticePlanform
        One blade; all blades are equal.
    n_blades : int
        Number of blades.
    options : AeroOptions
        Wake treatment and physics. ``n_chord`` and ``n_span`` are those of the planform.
    air_density : float
        [kg/m^3].
    bodies : BodySet, optional
        Closed bodies in the flow, on the ground of the options. Set `body_wind` before each `solve`.
    threads : int
        Threads that share the tree code of a big wake; the numbers do not depend on it. Direct sums take one thread.

    Attributes
    ----------
    body_wind : ndarray, shape (n_panel, 3)
        Undisturbed wind at ``bodies.control_points`` at the end of the step [m/s]; to be written by the caller.

    Raises
    ------
    AerodynamicsError
        If the number of blades or the density makes no sense, the planform has other numbers of panels than the
        options, or the bodies have another ground.
    """

    def __init__(
        self,
        planform: LatticePlanform,
        n_blades: int,
        options: AeroOptions,
        air_density: float = 1.225,
        bodies: BodySet | None = None,
        threads: int = 1,
    ) -> None:
        if not isinstance(cast(object, n_blades), Integral) or n_blades < 1:
            raise AerodynamicsError(f"n_blades is {n_blades!r}; must be a whole number of at least 1")
        panels, chosen = (planform.n_chord, planform.n_span), (options.n_chord, options.n_span)
        if panels != chosen:
            raise AerodynamicsError(
                f"the planform has {panels[0]} x {panels[1]} panels (chord x span), the options have n_chord x n_span "
                f"= {chosen[0]} x {chosen[1]}; they must agree"
            )
        if len(planform.polars) not in (planform.n_span, n_blades * planform.n_span):
            raise AerodynamicsError(
                f"the planform has {len(planform.polars)} polars; must be one a strip of one or all blades"
            )
        if not 0.0 < air_density < np.inf:
            raise AerodynamicsError(f"air_density is {air_density}; it must be positive and finite")
        self.planform, self.n_blades, self.options, self.air_density = planform, n_blades, options, float(air_density)
        self.nodes_shape = (n_blades, planform.n_chord + 1, planform.n_span + 1, 3)
        self.arrays = PlanformArrays.of(planform, options, cylinder_table())
        self.constants = AeroConstants.of(options, air_density)
        self.n_edge = self.arrays.shed_rings.size
        self._row_numbers = options.row_numbers()
        n_panel = bodies.n_panels if bodies else 0
        self.work = AeroWork.empty(n_blades, planform.n_chord, planform.n_span, self.arrays, options, n_panel)
        self.bodies = bodies
        self.body_arrays: tuple[BodyArrays | None, BodyWork | None] = (
            None,
            None,
        )  # bodies and work arrays, as the kernels take them
        self.body_wind = np.zeros((0, 3))
        if bodies is not None:
            ground = bodies.ground if bodies.has_ground else None
            if ground != options.ground_height:
                raise AerodynamicsError(
                    f"the bodies stand on a ground at {ground} m, the lattice has ground_height {options.ground_height}"
                )
            n_ring, wake_shape = n_blades * planform.n_chord * planform.n_span, (options.wake_rows + 1, n_blades)
            n_point, n_corner = self.work.points.shape[1], self.work.corners.shape[2]
            work = bodies.work(n_ring, n_point, (*wake_shape, self.n_edge + 1), n_corner)
            self.body_arrays = bodies.arrays, work
            self.body_wind = work.wind
        if threads < 1:
            raise AerodynamicsError(f"threads is {threads}; must be at least one")
        # With the tree code the induction of the wake is done between the compiled calls instead of within them
        self.split = SplitInduction(self, threads) if options.induction == "tree" else None

    def new_state(self) -> AeroState:
        """Return an empty state; call `reset` before using it."""
        return AeroState.empty(self.planform, self.n_blades, self.options, self.bodies.n_panels if self.bodies else 0)

    def reset(self, state: AeroState, nodes: ArrayLike, velocities: ArrayLike, wind: ArrayLike) -> None:
        """Start from rest without a wake: the flow has just begun (impulsive start).

        Parameters
        ----------
        nodes, velocities, wind : ndarray, shape (n_blades, n_chord + 1, n_span + 1, 3)
            Positions [m] and velocities [m/s] of the ring nodes and undisturbed wind there [m/s], global.

        Raises
        ------
        AerodynamicsError
            For arrays of another shape or not finite, panels without area, and a flow so strong that the forces are
            not finite.
        """
        self._clear(state, self._checked_nodes(nodes))
        self._solve(state, nodes, velocities, wind, 0.0, first=True)
        self.accept(state)
        # No rate can be taken from an impulsive start: it is not a level in time.
        state.arrays.n_levels[0] = 0

    def initialize_wake(
        self,
        state: AeroState,
        nodes: ArrayLike,
        velocities: ArrayLike,
        wind: ArrayLike,
        wake_rows: ArrayLike,
        ages: ArrayLike,
        far_wake: bool = False,
    ) -> None:
        """Start with a prescribed wake in steady state: all rings of a strip have its circulation.

        Parameters
        ----------
        nodes, velocities, wind : ndarray, shape (n_blades, n_chord + 1, n_span + 1, 3)
            As for `reset`.
        wake_rows : ndarray, shape (n_rows, n_blades, n_edge + 1, 3)
            Positions of the rows behind the shedding edge, newest first [m]; the newest is kept off the blade, see
            `wake_kernels.place_newest_row`.
        ages : ndarray, shape (n_rows,)
            Time since each row was shed [s]: positive, and more from row to row.
        far_wake : bool
            Close the wake with vortex cylinders (if the options have them) although it has not its full length.

        Raises
        ------
        AerodynamicsError
            As for `reset`, for rows or ages of another shape, not finite or out of order, and when the circulations of
            wake and blades find no balance.
        """
        wake_rows, ages = self._checked_rows(wake_rows, ages)
        self._checked_nodes(nodes)
        nodes, velocities, wind = self._checked_motion(nodes, velocities, wind)
        change = self._balance(state, nodes, velocities, wind, wake_rows, ages, far_wake)
        self._accept(state, place=False, all_rows=True)
        if not change <= UNBALANCED:
            raise AerodynamicsError(
                f"blades and prescribed wake find no balance: the circulation still changes by {change:.3g} of its "
                f"size after {PASSES} passes; rows of the wake may lie too close together"
            )

    def _balance(  # noqa: PLR0913
        self,
        state: AeroState,
        nodes: Array,
        velocities: Array,
        wind: Array,
        wake_rows: Array,
        ages: Array,
        far_wake: bool,
        tolerance: float = BALANCED,
        guess: Array | None = None,
    ) -> float:
        """Start with a prescribed wake, except for its velocities.

        Returns the change of the circulation in the last pass, over its size. Nodes, velocities and wind are checked
        already.

        The wake answers a change of circulation with about half its size. From pass to pass half of the change is
        taken at first, then what a secant through the last two passes gives (Aitken's relaxation, Irons & Tuck 1969).
        ``guess`` is the circulation (n_blades, n_chord, n_span) to begin with.
        """
        n_rows = len(wake_rows)
        self._clear(state, nodes)
        a = state.arrays
        if guess is not None:
            a.gamma[:] = guess
        a.wake[1 : n_rows + 1] = wake_rows
        shedding_edge(a.nodes, self.arrays.shed_nodes, a.wake[0])
        place_newest_row(a.nodes, self.arrays.shed_nodes, a.wake[1].copy(), 1.0, a.wake)
        a.age[1 : n_rows + 1] = ages
        a.wind[: n_rows + 1] = wind.mean(axis=(0, 1, 2))
        a.shed[1 : n_rows + 1] = -np.arange(1, n_rows + 1)
        a.n_rows[0] = n_rows
        a.far_wake_on[0] = int(far_wake)
        share, last = 0.5, None
        for _ in range(PASSES):
            before = self._shed_circulation(a)
            a.wake_gamma[:n_rows] = before
            self._solve_steady(state, nodes, velocities, wind)
            step = self._shed_circulation(a) - before
            change = np.abs(step).max()
            if last is not None and (square := np.sum((step - last) ** 2)) > 0.0:
                share = min(max(-share * float(np.sum(last * (step - last)) / square), 0.2), 1.0)
            last = step
            a.gamma.reshape(self.n_blades, -1)[:, self.arrays.shed_rings] = before + share * step
            if change <= tolerance * np.abs(before).max():
                break
        a.wake_gamma[:n_rows] = self._shed_circulation(a)
        self._solve_steady(state, nodes, velocities, wind)
        return float(change / max(np.abs(before).max(), 1e-9))

    def _shed_circulation(self, a: AeroArrays) -> Array:
        """Circulation that each part of the shedding edge continues, a copy (n_blades, n_edge)."""
        return a.gamma.reshape(self.n_blades, -1)[:, self.arrays.shed_rings]

    def initialize_helix(  # noqa: PLR0913
        self,
        state: AeroState,
        nodes: ArrayLike,
        velocities: ArrayLike,
        wind: ArrayLike,
        center: ArrayLike,
        axis: ArrayLike,
        rotor_speed: float,
        dt: float,
        passes: int = 5,
        induced: float | None = None,
        accept: bool = True,
        wake_thrust: float | None = None,
    ) -> float:
        """Start a rotor with a full wake of helices in the momentum balance of its own thrust, or of an earlier one.

        Without a wake where there is no such balance, as for a rotor that is driven backwards in still air.

        Parameters
        ----------
        nodes, velocities, wind : ndarray, shape (n_blades, n_chord + 1, n_span + 1, 3)
            As for `reset`.
        center, axis : array_like, shape (3,)
            Rotor center [m] and unit vector of the shaft; positive rotation is about ``axis``, which points downwind.
        rotor_speed : float
            [rad/s], positive about ``axis``.
        dt : float
            Aerodynamic time step that will follow [s].
        passes : int
            Fixed-point passes between thrust and wake.
        induced : float, optional
            To begin with, together with the circulation in the state, as an earlier call for nearly the same rotor has
            left them [m/s]; by default a fifth of the wind, and no circulation.
        accept : bool
            End the start with the velocities that move the wake on. False for a start that only serves another call:
            the state cannot be marched.
        wake_thrust : float, optional
            Mean thrust of the rotor over the time in which the wake was shed [N], where loads change: the wake then has
            circulation in the proportion of that thrust to the current one, the mean of the blades. Rows younger than a
            quarter of a turn keep the current circulation of their own blade, in a share that falls with their age.
            Where the current thrust is less than a fifth of the earlier one, the wake stays its own.

        Returns
        -------
        induced : float
            Velocity of the wake at the rotor along the axis [m/s].

        Raises
        ------
        AerodynamicsError
            As for `reset`, and for an axis without length, a time step that is not positive, values not finite.
        """
        center, axis = _vector("center", center), _vector("axis", axis)
        if not np.linalg.norm(axis) > 0.0:
            raise AerodynamicsError(f"axis is {axis}; it must have a length")
        if not 0.0 < dt < np.inf:
            raise AerodynamicsError(f"dt is {dt}; it must be positive and finite")
        if not math.isfinite(rotor_speed):
            raise AerodynamicsError(f"rotor_speed is {rotor_speed}; it must be finite")
        if not isinstance(cast(object, passes), Integral) or passes < 1:
            raise AerodynamicsError(f"passes is {passes!r}; must be a whole number of at least 1")
        nodes, velocities, wind = self._checked_motion(nodes, velocities, wind)
        check_areas(nodes)
        axis = axis / np.linalg.norm(axis)
        stream = wind.mean(axis=(0, 1, 2))
        speed = float(abs(stream @ axis))
        radius = float(np.linalg.norm(np.cross(nodes - center, axis), axis=-1).max())
        numbers = self._row_numbers
        ages = np.asarray((numbers + self.options.shed_fraction) * dt, dtype=np.float64)
        edge = np.empty((self.n_blades, self.n_edge + 1, 3))
        shedding_edge(nodes, self.arrays.shed_nodes, edge)
        # Rows closer than those that a hundredth of the speed of the tips parts do not come to a balance.
        closest = 0.01 * float(np.linalg.norm(velocities, axis=-1).max())
        guess, slowest = None if induced is None else state.arrays.gamma.copy(), 2.0 * closest
        if induced is None:
            induced = -0.2 * speed
        for k in range(passes):
            rows = self._helix(edge, center, axis, rotor_speed, ages, stream, induced, slowest, radius)
            enough = BALANCED if k == passes - 1 else ROUGHLY_BALANCED
            change = self._balance(state, nodes, velocities, wind, rows, ages, True, enough, guess)
            if not change <= UNBALANCED:
                self.reset(state, nodes, velocities, wind)
                return induced
            guess = state.arrays.gamma.copy()
            thrust = float(state.nodal_forces.sum(axis=(0, 1, 2)) @ axis)
            # T = -2 rho A (U + v) v, also for a rotor that drives the air. Beyond v = -0.4 U the wake is turbulent and
            # the start need not be better; in still air it is carried away by what a hovering rotor induces.
            pressure = thrust / (2.0 * self.air_density * np.pi * radius**2) * np.copysign(1.0, stream @ axis)
            target = np.sqrt(0.25 * speed**2 - min(pressure, 0.24 * speed**2)) - 0.5 * speed
            induced, slowest = 0.5 * (induced + target), max(0.5 * np.sqrt(abs(pressure)), closest)
        if wake_thrust and thrust / wake_thrust > SMALLEST_THRUST:
            own = state.arrays.wake_gamma[: len(numbers)]
            recent = np.exp(-ages * abs(rotor_speed) / (0.5 * np.pi))[:, None, None]
            own[:] = recent * own + (1.0 - recent) * (wake_thrust / thrust) * own.mean(axis=1, keepdims=True)
            self._solve_steady(state, nodes, velocities, wind)
        if accept:
            self._accept(state, place=False, all_rows=True)
            state.arrays.shed[1:] = -numbers
        return float(induced)

    def convect_wake(self, state: AeroState, inflow: UndisturbedWind, time: float, dt: float) -> None:
        """Move the free wake from ``time`` to ``time + dt``.

        Parameters
        ----------
        inflow : UndisturbedWind
            Evaluated once for all wake nodes.

        Raises
        ------
        AerodynamicsError
            If the inflow is not finite or has a wrong shape, or ``dt`` is not positive.
        """
        if not 0.0 < dt < np.inf:
            raise AerodynamicsError(f"dt is {dt}; it must be positive and finite")
        self.take_wind(state, inflow, time)
        step_kernels.convect_wake(self.constants, state.arrays, float(dt))

    def take_wind(self, state: AeroState, inflow: UndisturbedWind, time: float) -> None:
        """Ask for the undisturbed wind at the wake, or at those of its rows whose turn it is; for `convect_wake`.

        Raises
        ------
        AerodynamicsError
            If the inflow is not finite or has another shape than the points.
        """
        a, w = state.arrays, self.work
        points = w.row_points[: rows_for_wind(*self.turn_of_rows(state))]
        wind = np.ascontiguousarray(inflow.velocity(points, time), dtype=np.float64)
        if wind.shape != points.shape:
            raise AerodynamicsError(
                f"the inflow gives velocities of shape {wind.shape} at wake nodes of shape {points.shape}; they must "
                "have the same"
            )
        if not store_wind(wind, w.rows, a.wind):
            raise AerodynamicsError(f"the inflow is not finite at wake nodes at time {time} s")

    def turn_of_rows(self, state: AeroState) -> tuple[Array, Integers, Integers, Integers, int, Integers, Array]:
        """Arguments of `wake_kernels.rows_for_wind`: the same arrays in every step."""
        a, w = state.arrays, self.work
        return a.wake, a.shed, a.n_rows, a.n_steps, self.options.wind_stride, w.rows, w.row_points

    def solve(self, state: AeroState, nodes: ArrayLike, velocities: ArrayLike, wind: ArrayLike, dt: float) -> Array:
        """Circulation and loads for the given motion at the end of the step; may be repeated.

        The influence of the wake and of the rings on each other is computed at the first call of a step and kept.

        Parameters
        ----------
        nodes, velocities, wind : ndarray, shape (n_blades, n_chord + 1, n_span + 1, 3)
            As for `reset`.
        dt : float
            The step given to `convect_wake` [s].

        Returns
        -------
        forces : ndarray, shape (n_blades, n_chord + 1, n_span + 1, 3)
            Forces of the air on the ring nodes [N], global; ``state.nodal_forces``, overwritten by the next call.

        Raises
        ------
        AerodynamicsError
            As for `reset`, and if ``dt`` is not positive.
        """
        if not 0.0 < dt < np.inf:
            raise AerodynamicsError(f"dt is {dt}; it must be positive and finite")
        return self._solve(state, nodes, velocities, wind, float(dt), first=False)

    def accept(self, state: AeroState) -> None:
        """End the step: shed the newest ring and compute the velocities that move the wake next."""
        self._accept(state, place=True)

    def induced_velocity(self, state: AeroState, points: ArrayLike) -> Array:
        """Velocity of bound and wake vortices and of the bodies at any points (..., 3) [m/s]; accuracy of float32."""
        points = np.asarray(points, dtype=np.float64)
        flat = np.ascontiguousarray(points.reshape(-1, 3).T)
        out = np.empty_like(flat)
        a, w = state.arrays, self.work
        step_kernels.write_sheets(self.arrays, self.constants, a, w, *self.body_arrays)
        chunk = w.targets.shape[2] - WIDTH
        for start in range(0, flat.shape[1], chunk):
            part = np.ascontiguousarray(flat[:, start : start + chunk])
            result = np.empty_like(part)
            step_kernels.velocity_at_points(self.arrays, self.constants, a, w, w.bound_sheet, 0, part, result)
            out[:, start : start + chunk] = result
        velocity = out.T.reshape(points.shape)
        return velocity + self.bodies.velocity(points, a.body_strength) if self.bodies else velocity

    def _checked_nodes(self, nodes: ArrayLike) -> Array:
        """Contiguous nodes of the right shape, finite, of panels with an area."""
        nodes = numeric_array("nodes", nodes)
        if nodes.shape != self.nodes_shape:
            raise AerodynamicsError(f"nodes have shape {nodes.shape}; must be {self.nodes_shape}")
        if not np.isfinite(nodes.sum()):
            raise AerodynamicsError("nodes are not finite")
        check_areas(nodes)
        return nodes

    @staticmethod
    def _clear(state: AeroState, nodes: Array) -> None:
        state.clear()
        state.arrays.origin[:] = nodes.mean(axis=(0, 1, 2))
        state.arrays.nodes[:] = nodes

    def _solve(
        self, state: AeroState, nodes: ArrayLike, velocities: ArrayLike, wind: ArrayLike, dt: float, first: bool
    ) -> Array:
        nodes, velocities, wind = self._checked_motion(nodes, velocities, wind)
        if not state.arrays.prepared[0]:
            check_areas(nodes)
            self.prepare(state, nodes)
        return self._solve_prepared(state, nodes, velocities, wind, dt, first)

    def _solve_steady(self, state: AeroState, nodes: Array, velocities: Array, wind: Array) -> None:
        """Steady solution with the wake as it stands, of arguments that are checked."""
        self.prepare(state, nodes, place=False)
        self._solve_prepared(state, nodes, velocities, wind, 0.0, first=True)

    def _solve_prepared(
        self, state: AeroState, nodes: Array, velocities: Array, wind: Array, dt: float, first: bool
    ) -> Array:
        a = state.arrays
        if not np.isfinite(self.body_wind.sum()):
            raise AerodynamicsError("the wind at the bodies is not finite")
        step_kernels.solve(self.arrays, self.constants, a, self.work, nodes, velocities, wind, dt, first)
        if not np.isfinite(a.forces).all():
            raise AerodynamicsError(self._why_not_finite(state, nodes, velocities, wind))
        return a.forces

    def _checked_motion(self, nodes: ArrayLike, velocities: ArrayLike, wind: ArrayLike) -> tuple[Array, Array, Array]:
        """Contiguous arrays of what `reset` and `solve` take, of the right shape and finite."""
        given = {"nodes": nodes, "velocities": velocities, "wind": wind}
        arrays = []
        for name, values in given.items():
            array = numeric_array(name, values)
            if array.shape != self.nodes_shape:
                raise AerodynamicsError(f"{name} have shape {array.shape}; must be {self.nodes_shape}")
            if not np.isfinite(array.sum()):
                raise AerodynamicsError(f"{name} are not finite")
            arrays.append(array)
        return arrays[0], arrays[1], arrays[2]

    def _checked_rows(self, wake_rows: ArrayLike, ages: ArrayLike) -> tuple[Array, Array]:
        """Arrays of a prescribed wake, of the right shape, finite and in order."""
        wake_rows, ages = numeric_array("wake_rows", wake_rows), numeric_array("ages", ages)
        n_rows, needed = len(wake_rows), (self.n_blades, self.n_edge + 1, 3)
        if not 1 <= n_rows <= self.options.wake_rows:
            raise AerodynamicsError(f"{n_rows} wake rows given; between 1 and {self.options.wake_rows} are allowed")
        for name, array, shape in (("wake_rows", wake_rows, (n_rows, *needed)), ("ages", ages, (n_rows,))):
            if array.shape != shape:
                raise AerodynamicsError(f"{name} have shape {array.shape}; must be {shape}")
            if not np.all(np.isfinite(array)):
                wrong = np.flatnonzero(~np.isfinite(array.reshape(n_rows, -1)).all(axis=1))
                raise AerodynamicsError(f"{name} are not finite in rows {wrong[:8].tolist()}")
        if not np.all(np.diff(ages, prepend=0.0) > 0.0):
            raise AerodynamicsError(f"ages are {ages} s; they must be positive and increase from row to row")
        return wake_rows, ages

    def _why_not_finite(self, state: AeroState, nodes: Array, velocities: Array, wind: Array) -> str:
        """Message with the largest numbers that led to forces that are not finite."""
        a = state.arrays
        rows = slice(0, state.n_rows + 1)
        largest = {
            "coordinate of a node": (nodes, "m"),
            "velocity of a node": (velocities, "m/s"),
            "wind at a node": (wind, "m/s"),
            "wind at the wake": (a.wind[rows], "m/s"),
            "coordinate of the wake": (a.wake[rows], "m"),
        }
        parts = [f"{name} {np.abs(values).max():.3g} {unit}" for name, (values, unit) in largest.items()]
        return f"the forces are not finite; largest {', '.join(parts)}: all must be finite and of a physical size"

    def prepare(self, state: AeroState, nodes: Array, place: bool = True) -> None:
        """Compute what a step needs once, before its first `solve`; `solve` does it if it was not done."""
        p, o, a, w = self.arrays, self.constants, state.arrays, self.work
        split = self.split
        if split is None:
            step_kernels.prepare(p, o, a, w, nodes, place, *self.body_arrays)
            return

        def wake_flow(n_threads: int = 1) -> None:
            if state.n_rows:
                split.at_points(state, n_threads)

        def boundary() -> None:
            step_kernels.prepare_boundary(p, o, a, w, nodes, *self.body_arrays)

        step_kernels.prepare_wake(p, o, a, w, nodes, place, *self.body_arrays)
        if self.bodies:  # they answer the flow of the wake
            wake_flow(split.threads)
            boundary()
        else:
            run_beside(boundary, wake_flow, split.threads)

    def _accept(self, state: AeroState, place: bool, all_rows: bool = False) -> None:
        p, o, a, w = self.arrays, self.constants, state.arrays, self.work
        if self.split is None:
            step_kernels.accept(p, o, a, w, place, all_rows, *self.body_arrays)
            return
        n_target = step_kernels.shed_newest(p, o, a, w, place, all_rows, *self.body_arrays)
        self.split.at_targets(state, w.bound_sheet, 0, n_target, self.split.threads)
        step_kernels.store_induced(p, o, a, w, n_target, *self.body_arrays)

    @staticmethod
    def _helix(  # noqa: PLR0913
        edge: Array,
        center: Array,
        axis: Array,
        rotor_speed: float,
        ages: Array,
        stream: Array,
        induced: float,
        slowest: float,
        radius: float,
    ) -> Array:
        """Rows of trailing-edge nodes turned back and carried downstream, shape (n_rows, n_blades, n_node, 3).

        ``induced`` is the axial velocity at the rotor [m/s], twice that far away, positive downstream; the wake moves
        no slower than with ``slowest``.
        """
        arm = edge - center
        along = arm @ axis
        normal = arm - along[..., None] * axis
        sideways = np.cross(axis, normal)
        axial_speed = float(stream @ axis)
        distances, distance, time = [], 0.0, 0.0
        for age in ages.tolist():
            # the vorticity moves with the mean of the speeds on the two sides of its sheet
            here = abs(axial_speed) + 0.5 * induced * (1.0 + distance / math.sqrt(distance**2 + 4.0 * radius**2))
            distance += max(here, slowest) * (age - time)
            distances.append(distance)
            time = age
        age, angle = ages[:, None], (-rotor_speed * ages)[:, None, None, None]
        drift = stream * age - axial_speed * age * axis
        turned = normal * np.cos(angle) + sideways * np.sin(angle) + along[..., None] * axis
        downstream = np.copysign(distances, axial_speed)[:, None] * axis
        return center + turned + drift[:, None, None] + downstream[:, None, None]


def _vector(name: str, values: ArrayLike) -> Array:
    """Three finite numbers."""
    vector = numeric_array(name, values)
    if vector.shape != (3,) or not np.all(np.isfinite(vector)):
        raise AerodynamicsError(f"{name} must be three finite numbers, got {vector}")
    return vector
