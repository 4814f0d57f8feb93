"""The unsteady vortex-lattice method: blades on their camber surfaces, free wake, loads."""

import numpy as np

from wt_gym.aerodynamics import step_kernels
from wt_gym.aerodynamics.errors import AerodynamicsError
from wt_gym.aerodynamics.far_wake import cylinder_table
from wt_gym.aerodynamics.induction_kernels import MAX_LANES, build_sheet
from wt_gym.aerodynamics.lattice import LatticePlanform
from wt_gym.aerodynamics.options import AeroOptions
from wt_gym.aerodynamics.state import AeroState, PlanformArrays
from wt_gym.aerodynamics.wake_kernels import velocity_at_points

__all__ = ["VortexLattice"]


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

    Raises
    ------
    AerodynamicsError
        If the number of blades or the density makes no sense.
    """

    def __init__(self, planform: LatticePlanform, n_blades: int, options: AeroOptions, air_density: float = 1.225):
        if n_blades < 1:
            raise AerodynamicsError(f"n_blades is {n_blades}; at least one blade is needed")
        if not 0.0 < air_density < np.inf:
            raise AerodynamicsError(f"air_density is {air_density}; it must be positive and finite")
        self.planform, self.n_blades, self.options, self.air_density = planform, n_blades, options, float(air_density)
        self.nodes_shape = (n_blades, planform.n_chord + 1, planform.n_span + 1, 3)
        self._p = PlanformArrays.of(planform, cylinder_table())
        n_node, n_max = planform.n_span + 1, options.wake_rows
        n_point = n_blades * planform.n_chord * (2 * planform.n_span + n_node)
        n_target = max(n_blades * n_node * (n_max + 1), n_point) + 2 * MAX_LANES
        self._sheet = np.zeros((planform.n_chord + 1 + n_max, n_blades, n_node, 7), dtype=np.float32)
        self._targets = np.zeros((2, 3, n_target), dtype=np.float32)
        self._velocity = np.zeros((2, 3, n_target), dtype=np.float32)
        self._scratch = np.zeros((4 * n_node + 10) * MAX_LANES + 6 * n_target, dtype=np.float32)
        self._rows = np.zeros(n_max + 1, dtype=np.int64)
        self._points = np.zeros((3, n_point))
        self._has_ground = options.ground_height is not None
        self._ground = float(options.ground_height) if self._has_ground else 0.0

    def new_state(self) -> AeroState:
        """Return an empty state; call `reset` before using it."""
        return AeroState.empty(self.planform, self.n_blades, self.options)

    def reset(self, state: AeroState, nodes, velocities, wind) -> None:
        """Start from rest without a wake: the flow has just begun (impulsive start).

        Parameters
        ----------
        nodes, velocities, wind : ndarray, shape (n_blades, n_chord + 1, n_span + 1, 3)
            Positions [m] and velocities [m/s] of the ring nodes and undisturbed wind there [m/s], global.
        """
        self._clear(state, nodes)
        self._solve(state, nodes, velocities, wind, 0.0, first=True)
        self.accept(state)

    def initialise_wake(
        self, state: AeroState, nodes, velocities, wind, wake_rows, ages, far_wake: bool = False
    ) -> None:
        """Start with a prescribed wake in steady state: all rings of a strip have its circulation.

        Parameters
        ----------
        nodes, velocities, wind : ndarray, shape (n_blades, n_chord + 1, n_span + 1, 3)
            As for `reset`.
        wake_rows : ndarray, shape (n_rows, n_blades, n_span + 1, 3)
            Positions of the rows behind the trailing edge, newest first [m].
        ages : ndarray, shape (n_rows,)
            Time since each row was shed [s].
        far_wake : bool
            Close the wake with vortex cylinders (if the options have them) although it has not its full length.
        """
        wake_rows = np.asarray(wake_rows, dtype=np.float64)
        n_rows = len(wake_rows)
        if not 1 <= n_rows <= self.options.wake_rows:
            raise AerodynamicsError(f"{n_rows} wake rows given; between 1 and {self.options.wake_rows} are allowed")
        self._clear(state, nodes)
        a = state.arrays
        a.wake[1 : n_rows + 1] = wake_rows
        a.age[1 : n_rows + 1] = ages
        a.shed[1 : n_rows + 1] = -np.arange(1, n_rows + 1)
        a.count[0] = n_rows
        a.count[4] = int(far_wake)
        for _ in range(25):
            before = a.gamma[:, -1].copy()
            a.wake_gamma[:n_rows] = before
            a.count[3] = 0
            self._solve(state, nodes, velocities, wind, 0.0, first=True, place=False)
            # The wake answers a change of circulation with about half its size: half a step converges fast.
            a.gamma[:, -1] = 0.5 * (a.gamma[:, -1] + before)
            if np.abs(a.gamma[:, -1] - before).max() <= 1e-5 * np.abs(before).max():
                break
        a.wake_gamma[:n_rows] = a.gamma[:, -1]
        a.count[3] = 0
        self._solve(state, nodes, velocities, wind, 0.0, first=True, place=False)
        self._accept(state, place=False, all_rows=True)

    def initialise_helix(
        self, state: AeroState, nodes, velocities, wind, centre, axis, rotor_speed, dt, passes=5
    ) -> None:
        """Start a rotor with a full wake of helices in the momentum balance of its own thrust.

        Parameters
        ----------
        nodes, velocities, wind : ndarray, shape (n_blades, n_chord + 1, n_span + 1, 3)
            As for `reset`.
        centre, axis : array_like, shape (3,)
            Rotor centre [m] and unit vector of the shaft; positive rotation is about ``axis``, which points downwind.
        rotor_speed : float
            [rad/s], positive about ``axis``.
        dt : float
            Aerodynamic time step that will follow [s].
        passes : int
            Fixed-point passes between thrust and wake.
        """
        centre, axis = np.asarray(centre, dtype=np.float64), np.asarray(axis, dtype=np.float64)
        axis = axis / np.linalg.norm(axis)
        nodes = np.asarray(nodes, dtype=np.float64)
        stream = np.asarray(wind, dtype=np.float64).mean(axis=(0, 1, 2))
        speed = float(np.linalg.norm(stream))
        radius = float(np.linalg.norm(np.cross(nodes - centre, axis), axis=-1).max())
        ages = self._steady_ages(dt)
        edge = 0.25 * nodes[:, -2] + 0.75 * nodes[:, -1]
        induction = 0.2
        for _ in range(passes):
            rows = self._helix(edge, centre, axis, rotor_speed, ages, stream, induction, radius)
            self.initialise_wake(state, nodes, velocities, wind, rows, ages, far_wake=True)
            thrust = float(state.nodal_forces.sum(axis=(0, 1, 2)) @ axis)
            loading = thrust / max(0.5 * self.air_density * np.pi * radius**2 * speed**2, 1e-9)
            # Momentum theory up to a = 0.4; beyond it the wake is turbulent and the start need not be better.
            target = 0.5 * (1.0 - np.sqrt(1.0 - min(max(loading, 0.0), 0.96)))
            induction = 0.5 * (induction + target)
        self._set_rows(state, ages)

    def convect_wake(self, state: AeroState, inflow, time: float, dt: float) -> None:
        """Move the free wake from ``time`` to ``time + dt``.

        Parameters
        ----------
        inflow : object with ``velocity(points (..., 3), time) -> (..., 3)``
            Undisturbed wind; evaluated once for all wake nodes.

        Raises
        ------
        AerodynamicsError
            If the inflow is not finite or ``dt`` is not positive.
        """
        if not 0.0 < dt < np.inf:
            raise AerodynamicsError(f"dt is {dt}; it must be positive and finite")
        o, a = self.options, state.arrays
        wind = np.ascontiguousarray(inflow.velocity(a.wake[: state.n_rows + 1], time), dtype=np.float64)
        if not np.isfinite(wind.sum()):
            raise AerodynamicsError(f"the inflow is not finite at wake nodes at time {time} s")
        step_kernels.convect_wake(a, wind, float(dt), o.full_rows, o.coarse_stride, o.shed_fraction)

    def solve(self, state: AeroState, nodes, velocities, wind, dt: float) -> np.ndarray:
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
        """
        return self._solve(state, nodes, velocities, wind, float(dt), first=False)

    def accept(self, state: AeroState) -> None:
        """End the step: shed the newest ring and compute the velocities that move the wake next."""
        self._accept(state, place=True)

    def induced_velocity(self, state: AeroState, points) -> np.ndarray:
        """Velocity of bound and wake vortices at any points (..., 3) [m/s]; accuracy of float32."""
        points = np.asarray(points, dtype=np.float64)
        flat = np.ascontiguousarray(points.reshape(-1, 3).T)
        out = np.empty_like(flat)
        a, n_row = state.arrays, self.planform.n_chord + 1
        sheet = self._build_sheet(state)
        chunk = self._targets.shape[2] - 2 * MAX_LANES
        for start in range(0, flat.shape[1], chunk):
            part = np.ascontiguousarray(flat[:, start : start + chunk])
            result = np.empty_like(part)
            velocity_at_points(
                sheet[: n_row + state.n_rows], part, self._targets, self._velocity, self._scratch, a.origin,
                self._ground, self._has_ground, a.far, self._p.cylinder_table, result,
            )  # fmt: skip
            out[:, start : start + chunk] = result
        return out.T.reshape(points.shape)

    def _build_sheet(self, state):
        a, o = state.arrays, self.options
        build_sheet(
            a.nodes, a.gamma, a.wake, a.wake_gamma, state.n_rows, a.age, self._p.edge_chord, o.wake_core, o.viscosity,
            o.squire, a.origin, a.far[0] == 0.0, self._sheet,
        )  # fmt: skip
        return self._sheet

    def _clear(self, state, nodes):
        nodes = np.asarray(nodes, dtype=np.float64)
        if nodes.shape != self.nodes_shape:
            raise AerodynamicsError(f"nodes have shape {nodes.shape}; {self.nodes_shape} is needed")
        for array in state.arrays:
            array[...] = 0
        state.arrays.origin[:] = nodes.mean(axis=(0, 1, 2))
        state.arrays.nodes[:] = nodes

    def _solve(self, state, nodes, velocities, wind, dt, first, place=True):
        o, a = self.options, state.arrays
        nodes, velocities, wind = (np.ascontiguousarray(x, dtype=np.float64) for x in (nodes, velocities, wind))
        for name, array in (("nodes", nodes), ("velocities", velocities), ("wind", wind)):
            if array.shape != self.nodes_shape:
                raise AerodynamicsError(f"{name} have shape {array.shape}; {self.nodes_shape} is needed")
            if not np.isfinite(array.sum()):
                raise AerodynamicsError(f"{name} are not finite")
        if not a.count[3]:
            step_kernels.prepare(
                self._p, a, nodes, self._sheet, self._targets, self._velocity, self._scratch, self._points,
                o.bound_core, o.wake_core, o.viscosity, o.squire, o.shed_fraction, o.far_wake, o.far_wake_rows,
                self._ground, self._has_ground, place,
            )  # fmt: skip
        step_kernels.solve(
            self._p, a, nodes, velocities, wind, dt, self.air_density, o.viscous, o.stall_lag, o.unsteady, first,
            self._points,
        )  # fmt: skip
        return a.forces

    def _accept(self, state, place, all_rows=False):
        o = self.options
        step_kernels.accept(
            self._p, state.arrays, self._sheet, self._rows, self._targets, self._velocity, self._scratch,
            o.wake_core, o.viscosity, o.squire, o.wake_rows if all_rows else o.fresh_rows, o.refresh_stride,
            o.shed_fraction, self._ground, self._has_ground, place,
        )  # fmt: skip

    def _steady_ages(self, dt):
        """Ages of the rows of a full wake, given the thinning of old rows."""
        o = self.options
        number = np.arange(o.wake_rows)
        beyond = np.maximum(number - o.full_rows + 1, 0)
        return (number + beyond * (o.coarse_stride - 1) + o.shed_fraction) * dt

    def _set_rows(self, state, ages):
        """Shed numbers of the rows of a full wake that was not computed step by step."""
        a, o = state.arrays, self.options
        number = np.arange(o.wake_rows)
        beyond = np.maximum(number - o.full_rows + 1, 0)
        a.shed[1:] = -(number + beyond * (o.coarse_stride - 1))

    @staticmethod
    def _helix(edge, centre, axis, rotor_speed, ages, stream, induction, radius):
        """Rows of trailing-edge nodes turned back and carried downstream, shape (n_rows, n_blades, n_node, 3)."""
        arm = edge - centre
        along = arm @ axis
        normal = arm - along[..., None] * axis
        sideways = np.cross(axis, normal)
        rows = np.empty((len(ages), *edge.shape))
        axial_speed = float(stream @ axis)
        distance, time = 0.0, 0.0
        for k, age in enumerate(ages):
            slowing = 1.0 - induction * (1.0 + distance / np.sqrt(distance**2 + radius**2))
            distance += abs(axial_speed) * slowing * (age - time)
            time = age
            drift = stream * age - axial_speed * age * axis
            angle = -rotor_speed * age
            turned = normal * np.cos(angle) + sideways * np.sin(angle) + along[..., None] * axis
            rows[k] = centre + turned + drift + np.copysign(distance, axial_speed) * axis
        return rows
