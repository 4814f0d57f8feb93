"""Implicit stepping of a system in local observer frames, and what can be seen of it.

The equations and the scheme are derived in :mod:`wt_gym.multibody.observer_frame.frame`.
"""

from collections.abc import Sequence
from typing import cast

import numpy as np
from scipy.spatial.transform import Rotation

from wt_gym.base.quantities import Array
from wt_gym.multibody.integrators.schemes import generalized_alpha
from wt_gym.multibody.observer_frame import observer_frame_kernels as kernels
from wt_gym.multibody.observer_frame.frame import Drive, ObserverFrameSystem, Spring
from wt_gym.multibody.observer_frame.observer_frame_body import ObserverFrameError, Substructure
from wt_gym.structure.beam import skew

PREDICTIONS = {"uniform": kernels.UNIFORM, "accelerated": kernels.MEAN, "printed": kernels.PRINTED}


class ObserverFrameIntegrator:
    """Newmark (¼, ½) or generalized-α stepping of a system in local observer frames.

    Parameters
    ----------
    step : float
        [s]; the paper takes 1/150 of the longest natural period.
    n_iterations : int
        Solutions of a step; above one, loads and constraint directions are renewed with the new q.
    update : str or float
        "step" updates the frames every step; a number [m] is the rigid-body displacement of either end of a body
        from its frame beyond which that body's frame is updated. A rotation counts as the displacement that it gives a
        point at the largest distance which any body of the system has from its origin.
    prediction : str
        Motion of the frames over a step: "uniform", "accelerated" with the mean acceleration since the last update, or
        "printed" with the accelerations of the last instant (eqs 9–12 to the letter).
    spectral_radius : float, optional
        At infinite frequency, 0 … 1: generalized-α scheme, which removes a share of the highest frequencies in every
        step. None: Newmark's, which keeps them.

    Attributes
    ----------
    time : float
        [s].
    state : State
        Frame motions, coordinates (n_bodies, n_max) with rates, multipliers (n_rows,) and the count of frame updates.

    Raises
    ------
    ObserverFrameError
        For a step, number of iterations or threshold that is not positive, an unknown prediction, a spectral radius out
        of range, and for systems that cannot be packed.
    """

    def __init__(
        self,
        system: ObserverFrameSystem,
        step: float,
        n_iterations: int = 1,
        update: str | float = "step",
        prediction: str = "uniform",
        spectral_radius: float | None = None,
    ) -> None:
        if not (np.isfinite(step) and step > 0.0):
            raise ObserverFrameError(f"the time step must be positive, got {step}")
        if int(n_iterations) < 1:
            raise ObserverFrameError(f"n_iterations must be 1 or more, got {n_iterations}")
        if update != "step" and not (isinstance(update, int | float) and update > 0.0):
            raise ObserverFrameError(f"update must be 'step' or a positive displacement [m], got {update!r}")
        self.system, self.step, self.n_iterations = system, float(step), int(n_iterations)
        if prediction not in PREDICTIONS:
            raise ObserverFrameError(f"prediction must be one of {', '.join(PREDICTIONS)}, got {prediction!r}")
        if spectral_radius is not None and not 0.0 <= spectral_radius <= 1.0:
            raise ObserverFrameError(f"spectral_radius must lie in 0 … 1, got {spectral_radius}")
        self._threshold = 0.0 if update == "step" else float(update)
        self.model, self.state, self._work = system.pack(PREDICTIONS[prediction])
        if spectral_radius is not None:
            self.model.rule[:] = generalized_alpha(spectral_radius)
        self.time = 0.0
        self._shapes: dict[tuple[str, str], tuple[Array, Array | None]] = {}
        self._seconds: dict[int, Array] = {}
        self._start()

    def _start(self) -> None:
        """Consistent velocities and accelerations, and the frames set to follow them."""
        if len(self.model.row_kind):
            self._check(kernels.hold_velocities(self.model, self.state, self._work))
        values = self._load_values(self.time, 1)[0]
        # the first accelerations of the bodies become those of the frames
        for _ in range(2 if self.model.prediction != kernels.UNIFORM else 0):
            self._check(kernels.accelerations(values, self.model, self.state, self._work))
            for b, body in enumerate(self.system.bodies):
                rigid = self.state.a[b, body.n - 6 : body.n]
                self.state.acceleration[b] += self.state.rotation[b] @ rigid[:3]
                self.state.alpha[b] += rigid[3:]
        self._check(kernels.accelerations(values, self.model, self.state, self._work))

    def _acting(self, acting: Sequence[Drive] | Sequence[Spring], start: float, n_steps: int) -> Array:
        """What drives and springs say (n_steps, n, 3) at the ends of the coming steps."""
        values = [[one.at(start + k * self.step) for one in acting] for k in range(n_steps)]
        return np.array(values, dtype=float).reshape(n_steps, len(acting), 3)

    def advance(self, n_steps: int = 1) -> None:
        """Take n_steps.

        Raises
        ------
        ObserverFrameError
            When a matrix becomes singular or the motion is no longer finite; ``time`` is that of the last good step.
        """
        ends = self.time + self.step, int(n_steps)
        values = self._load_values(*ends)
        drives, springs = self._acting(self.system.drives, *ends), self._acting(self.system.springs, *ends)
        done = np.zeros(1, dtype=np.int64)
        code = kernels.advance(
            self.step, values, drives, springs, self.n_iterations, self._threshold, self.model, self.state, self._work,
            done,
        )  # fmt: skip
        self.time += self.step * float(done[0])
        self._check(code)

    def _load_values(self, start: float, n_steps: int) -> Array:
        """Loads (n_steps, n_loads, 6) at the ends of the coming steps."""
        loads = self.system.loads
        out = np.zeros((n_steps, len(loads), 6))
        for i, (_, value, _) in enumerate(loads):
            if callable(value):
                out[:, i] = np.array([value(start + k * self.step) for k in range(n_steps)], dtype=float)
            else:
                out[:, i] = value
        return out

    def _check(self, code: int) -> None:
        if code == kernels.SINGULAR_BODY:
            raise ObserverFrameError(
                f"a matrix of the step is singular at t = {self.time:.6g} s: the motion has diverged, or the step "
                f"{self.step} s is too long for the loads"
            )
        if code == kernels.SINGULAR_CONSTRAINTS:
            raise ObserverFrameError(
                f"the constraints are dependent (singular) at t = {self.time:.6g} s, or the motion has diverged"
            )
        if code == kernels.DIVERGED:
            raise ObserverFrameError(f"the motion diverged at t = {self.time:.6g} s; the step is {self.step} s")

    # ---- what is seen ----------------------------------------------------------------------------------------------

    def coordinates(self, body: str) -> Array:
        """Coordinates [q_f, q_r] (n,) of a substructure, a copy."""
        b = self.system._index(body)
        return np.array(self.state.q[b, : self.system.bodies[b].n])

    def displacement(self, body: str, marker: str) -> Array:
        """Displacement and rotation (6,) of a marker from the moving frame, in frame axes [m, rad]."""
        return self._displacement(*self._marker(body, marker))

    def position(self, body: str, marker: str) -> Array:
        """Position (3,) of a marker in the fixed frame [m]."""
        b = self.system._index(body)
        local = self.system.bodies[b].marker_position(marker) + self.displacement(body, marker)[:3]
        return cast("Array", self.state.position[b] + self.state.rotation[b] @ local)

    def orientation(self, body: str, marker: str) -> Array:
        """Rotation (3, 3) of a marker's section to fixed axes."""
        b = self.system._index(body)
        turn = Rotation.from_rotvec(self.displacement(body, marker)[3:]).as_matrix()
        return np.asarray(self.state.rotation[b] @ turn)

    def velocity(self, body: str, marker: str) -> Array:
        """Velocity and angular velocity (6,) of a marker in fixed axes [m/s, rad/s]."""
        b, shape, shorter = self._marker(body, marker)
        n, omega, r = shape.shape[1], self.state.omega[b], self.state.rotation[b]
        field, rate = self._displacement(b, shape, shorter), shape @ self.state.v[b, :n]
        rate[:3] += np.cross(self.state.v[b, n - 3 : n], shape[:3] @ self.state.deformed[b, :n] - shorter)
        point = self.system.bodies[b].marker_position(marker) + field[:3]
        linear = self.state.velocity[b] + r @ (np.cross(omega, point) + rate[:3])
        return np.concatenate([linear, r @ (omega + rate[3:])])

    def _marker(self, body: str, marker: str) -> tuple[int, Array, Array]:
        """Index of the body, shape (6, n) of the marker with rotations of the undeformed body, and ½ qᵀ H q (3,)."""
        b = self.system._index(body)
        place, shorter = self.system.bodies[b].places[marker], np.zeros(3)
        if (body, marker) not in self._shapes:
            bends = self.system.bodies[b].second_order is not None
            self._shapes[body, marker] = place.shape(), place.second_order() if bends else None
        shape, second = self._shapes[body, marker]
        if second is not None:
            known = self.state.deformed[b, : second.shape[2]]
            turn = second @ known
            shape, shorter = shape.copy(), 0.5 * turn @ known
            shape[:3, : len(known)] += turn
        return b, shape, shorter

    def _displacement(self, b: int, shape: Array, shorter: Array) -> Array:
        n = shape.shape[1]
        q = self.state.q[b, :n]
        field: Array = shape @ q
        field[:3] += np.cross(q[n - 3 :], shape[:3] @ self.state.deformed[b, :n] - shorter) - shorter
        return field

    def reaction(self, connection: str) -> Array:
        """Multipliers [N, N m] of a connection by the start of its name, e.g. "support of shaft.B1"."""
        chosen = [i for i, row in enumerate(self.system._rows) if row.connection.startswith(connection)]
        if not chosen:
            known = sorted({row.connection for row in self.system._rows})
            raise ObserverFrameError(f"no connection starts with {connection!r}; there are {known}")
        return self.state.multiplier[chosen]

    def energy(self) -> Array:
        """Kinetic, elastic and gravitational energy (3,) [J] of all substructures and the rotors geared to hinges."""
        total = np.zeros(3)
        total[0] = 0.5 * self.model.row_inertia @ self._work.row_rate**2
        for b, body in enumerate(self.system.bodies):
            q, v = self.state.q[b, : body.n], self.state.v[b, : body.n]
            point, rate = _particle_motion(self, b, body, q, v)
            m = body.particle_mass
            total[0] += 0.5 * np.sum(m[:, None] * rate**2)
            total[1] += 0.5 * q @ body.stiffness @ q
            total[2] -= np.sum(m @ (point @ self.system.gravity))
        return total

    def momentum(self) -> Array:
        """Momentum and angular momentum about the fixed origin (6,) [kg m/s, kg m²/s] of all substructures."""
        total = np.zeros(6)
        for b, body in enumerate(self.system.bodies):
            q, v = self.state.q[b, : body.n], self.state.v[b, : body.n]
            point, rate = _particle_motion(self, b, body, q, v)
            m = body.particle_mass[:, None]
            total += np.concatenate([np.sum(m * rate, axis=0), np.sum(m * np.cross(point, rate), axis=0)])
        return total


def _particle_motion(
    integrator: ObserverFrameIntegrator, b: int, body: Substructure, q: Array, v: Array
) -> tuple[Array, Array]:
    """Positions and velocities (n_p, 3) of the mass points of a body in fixed axes."""
    s, shape = integrator.state, body.particle_shape
    shorter: Array = np.zeros(3)
    known = s.deformed[b, : body.n]
    if body.second_order is not None:
        if b not in integrator._seconds:
            integrator._seconds[b] = body.second_order.particles()
        turn = integrator._seconds[b] @ known[:-6]
        shape, shorter = shape.copy(), 0.5 * turn @ known[:-6]
        shape[:, :, :-6] += turn
    moved = shape @ known - shorter
    local = body.particle_position - shorter + shape @ q + np.cross(q[-3:], moved)
    rate = local @ skew(s.omega[b]).T + shape @ v + np.cross(v[-3:], moved)
    return s.position[b] + local @ s.rotation[b].T, s.velocity[b] + rate @ s.rotation[b].T
