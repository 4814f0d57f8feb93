"""Loads of water and lines on a platform and its motion by the waves: arrays of the kernels, preparation, state."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from wt_gym.base.errors import InflowError, SimulationError
from wt_gym.base.quantities import Array, Integers
from wt_gym.hydrodynamics import loads_kernels as kernels
from wt_gym.hydrodynamics.drag import DragPoints, drag_points, linear_drag, mean_square, motion_of_points
from wt_gym.hydrodynamics.mooring import line_shape, unsolved
from wt_gym.hydrodynamics.mooring_kernels import SOLVED
from wt_gym.hydrodynamics.platform import Platform
from wt_gym.hydrodynamics.potential import fit_radiation
from wt_gym.hydrodynamics.waves import WaveComponents


class PlatformArrays(NamedTuple):
    """Arrays of the kernels; n drag points, m lines, r states of the radiation, c components of the sea."""

    buoyancy: Array  #: Buoyancy at rest [N], x and y of its center [m], shape (3,).
    hydrostatic: Array
    additional_stiffness: Array
    quadratic_damping: Array
    instant_damping: Array
    """Linear damping, and the part of the radiation that follows from the velocity at the end of the step, (6, 6)."""
    radiation_transition: Array  #: State to state, shape (r, r).
    radiation_first: Array  #: Velocity at the start of a step to state, shape (r, 6).
    radiation_last: Array  #: Velocity at its end to state, shape (r, 6).
    radiation_output: Array  #: State to force, shape (6, r).
    point_position: Array  #: In axes of the platform, shape (n, 3).
    point_axis: Array
    point_across: Array  #: Drag over the square of the velocity across the axis, shape (n,).
    point_along: Array
    line_anchor: Array  #: Global axes, shape (m, 3).
    line_fairlead: Array  #: Axes of the platform, shape (m, 3).
    line_length: Array
    line_weight: Array  #: In water per length, shape (m,).
    line_stiffness: Array
    line_friction: Array
    line_rests: Integers  #: 1 where the anchor is on the seabed, shape (m,).
    wave_frequency: Array  #: Shape (c,).
    wave_real: Array
    """Real part of amplitudes: six excitations, elevation, velocities at points; shape (7 + 3 n, c).

    With drift 24 more rows: roots of the forces along each motion, in phase and a quarter later, and against it.
    """
    wave_imaginary: Array
    current: Array  #: Velocity of the water without waves, shape (3,).
    wave_cosine: Array
    wave_sine: Array
    wave_value: Array
    wave_sum: Array
    excitation: Array  #: Wave force and moment about the origin, global axes, shape (6,).
    elevation: Array  #: Of the water at the origin, shape (1,).
    water_velocity: Array  #: At the drag points, shape (n, 3).
    radiation_state: Array  #: At the last accepted step, shape (r,).
    radiation_free: Array  #: State at the end of the step without the velocity there.
    radiation_force: Array  #: Output of `radiation_free`, shape (6,).
    velocity_candidate: Array  #: Velocity of the last call in axes turned by the yaw, shape (6,).
    line_unknown: Array  #: Horizontal and vertical force at the fairlead at the last accepted step, shape (m, 2).
    line_candidate: Array  #: The same of the last call.
    line_direction: Array  #: Horizontal direction from anchor to fairlead, shape (m, 2).
    line_tension: Array  #: At fairlead and anchor, shape (m, 2).
    radiation_sum: Array  #: Work space, shape (r,).
    displacement: Array  #: Work space, shape (6,).
    local_force: Array  #: Work space, shape (6,).


_STATE = (
    "excitation", "elevation", "water_velocity", "radiation_state", "radiation_free", "radiation_force",
    "velocity_candidate", "line_unknown", "line_candidate", "line_direction", "line_tension",
)  # fmt: skip


class PlatformLoads:
    """Loads of water and lines on one platform, which advance in equal steps.

    A step calls these of `wt_gym.hydrodynamics.loads_kernels`: `water_motion` for the time at its end, `platform_force`
    once or several times for the motion there, `accept_step` once.

    Parameters
    ----------
    platform : Platform
    dt : float
        Length of a step [s].
    spacing : float
        Longest piece of a member with its own drag [m].

    Attributes
    ----------
    platform : Platform
    arrays : PlatformArrays
        `set_sea` replaces them by others of the same types.
    radiation : StateSpace
        From velocity to the negative force of the memory of the water.
    """

    def __init__(self, platform: Platform, dt: float, spacing: float = 3.0) -> None:
        self.platform, self.radiation = platform, fit_radiation(platform.radiation)
        points = drag_points(platform.members, platform.plates, platform.water_density, spacing)
        n, m, r = len(points.across), len(platform.lines), len(self.radiation.a)
        transition, first, last = self.radiation.discrete(dt)
        lines, density, gravity = platform.lines, platform.water_density, platform.gravity
        buoyancy = density * gravity * platform.displaced_volume
        arrays: dict[str, NDArray[Any]] = {
            "buoyancy": np.array([buoyancy, *platform.center_of_buoyancy]),
            "hydrostatic": platform.hydrostatic, "additional_stiffness": platform.additional_stiffness,
            "quadratic_damping": platform.quadratic_damping,
            "instant_damping": platform.linear_damping + self.radiation.c @ last,
            "radiation_transition": transition, "radiation_first": first, "radiation_last": last,
            "radiation_output": self.radiation.c,
            "point_position": points.position, "point_axis": points.axis,
            "point_across": points.across, "point_along": points.along,
            "line_anchor": np.reshape([line.anchor for line in lines], (m, 3)),
            "line_fairlead": np.reshape([line.fairlead for line in lines], (m, 3)),
            "line_length": np.array([line.length for line in lines]),
            "line_weight": np.array([line.weight(density, gravity) for line in lines]),
            "line_stiffness": np.array([line.axial_stiffness for line in lines]),
            "line_friction": np.array([line.seabed_friction for line in lines]),
            "line_rests": np.array([line.rests(platform.water_depth) for line in lines], dtype=np.int64),
            "excitation": np.zeros(6), "elevation": np.zeros(1), "water_velocity": np.zeros((n, 3)),
            "radiation_state": np.zeros(r), "radiation_free": np.zeros(r), "radiation_force": np.zeros(6),
            "velocity_candidate": np.zeros(6), "line_unknown": np.zeros((m, 2)), "line_candidate": np.zeros((m, 2)),
            "line_direction": np.zeros((m, 2)), "line_tension": np.zeros((m, 2)), "radiation_sum": np.zeros(r),
            "displacement": np.zeros(6), "local_force": np.zeros(6),
        }  # fmt: skip
        writeable = {name: np.array(array, order="C") for name, array in arrays.items()}
        self._points = points.position
        self.components: WaveComponents | None = None
        self.arrays = PlatformArrays(**writeable, **self._sea(None))
        self.restart(np.zeros(3), np.eye(3), np.zeros(3), np.zeros(3))

    def set_sea(self, components: WaveComponents | None) -> None:
        """Set the waves and the current; without components the water is still.

        The waves have the depth and the gravity of the platform. Wave forces and velocities are those at the place of
        the platform without displacement.

        Raises
        ------
        InflowError
            If a component is outside of the table of the excitation, or nothing has drag in a current.
        """
        if components is not None:
            if any(components.current) and not len(self._points):
                raise InflowError(
                    "current must be (0, 0) for a platform without drag members and plates, which it would not push, "
                    f"got {components.current} m/s"
                )
            components = replace(components, depth=self.platform.water_depth, gravity=self.platform.gravity)
        self.arrays = self.arrays._replace(**self._sea(components))
        self.components = components
        kernels.water_motion(self.arrays, 0.0)

    @property
    def wave_force(self) -> NDArray[np.complex128]:
        """Complex amplitudes at e^{iωt} of the wave force and moment about the origin of the sea, shape (c, 6)."""
        p = self.arrays
        return np.asarray((p.wave_real[:6] + 1j * p.wave_imaginary[:6]).T)

    def linear_damping(self, deviation: ArrayLike) -> Array:
        """Damping (6, 6) of the platform about rest, the quadratic one for standard deviations (6,) of its velocity."""
        platform = self.platform
        return np.asarray(platform.linear_damping + platform.quadratic_damping * mean_square(0.0, deviation)[1])

    def _sea(self, sea: WaveComponents | None) -> dict[str, Any]:
        n_rows = 7 + 3 * len(self._points) + (24 if self.platform.drift is not None else 0)
        if sea is None:
            amplitudes, frequency, current = np.zeros((n_rows, 0), np.complex128), np.zeros(0), np.zeros(3)
        else:
            frequency, current = np.array(sea.frequency), np.array([*sea.current, 0.0])
            amplitudes = self._amplitudes(sea)
        return {
            "wave_frequency": frequency, "wave_real": np.ascontiguousarray(amplitudes.real),
            "wave_imaginary": np.ascontiguousarray(amplitudes.imag), "current": current,
            "wave_cosine": np.zeros(len(frequency)), "wave_sine": np.zeros(len(frequency)),
            "wave_value": np.zeros(n_rows), "wave_sum": np.zeros(n_rows),
        }  # fmt: skip

    def _amplitudes(self, sea: WaveComponents) -> NDArray[np.complex128]:
        """Complex amplitudes at e^{iωt} of the rows of ``wave_real``, shape (rows, component)."""
        elevation = sea.amplitude * np.exp(1j * sea.phase)
        force = elevation[:, None] * self.platform.excitation.at(sea.frequency, sea.direction)
        k, depth = sea.wave_number, self.platform.water_depth
        x, y, z = self._points.T[:, :, None]
        local = elevation * np.exp(-1j * k * (x * np.cos(sea.direction) + y * np.sin(sea.direction)))
        above = np.exp(-2.0 * k * (z + depth))
        decay = sea.frequency * np.exp(k * z) / (1.0 - np.exp(-2.0 * k * depth))
        along, up = local * decay * (1.0 + above), 1j * local * decay * (1.0 - above)
        velocity = np.stack([along * np.cos(sea.direction), along * np.sin(sea.direction), up], axis=1)
        rows = [force.T, elevation[None], velocity.reshape(-1, len(k))]
        if self.platform.drift is not None:
            drift = self.platform.drift.at(sea.frequency, sea.direction).T
            for part in (drift, -drift):  # where it acts along a motion, and against it
                root = elevation * np.sqrt(np.maximum(part, 0.0))
                rows += [root, -1j * root]
        return np.concatenate(rows)

    def restart(
        self, position: ArrayLike, rotation: ArrayLike, velocity: ArrayLike, omega: ArrayLike,
        radiation: ArrayLike | None = None,
    ) -> None:  # fmt: skip
        """Set the motion at the start and solve the lines.

        Parameters
        ----------
        position : array_like, shape (3,)
            Of the origin [m].
        rotation : array_like, shape (3, 3)
            From axes of the platform to global axes.
        velocity, omega : array_like, shape (3,)
            Of the origin [m/s], of the body [rad/s], global axes.
        radiation : array_like, shape (r,), optional
            States of the radiation; by default the water is at rest.

        Raises
        ------
        SimulationError
            If a line cannot be solved.
        """
        p = self.arrays
        p.radiation_state[:] = 0.0 if radiation is None else radiation
        p.line_unknown[:] = 0.0
        position, rotation, velocity, omega = _motion(position, rotation, velocity, omega)
        code = kernels.platform_force(p, position, rotation, velocity, omega, np.zeros(6))
        self.require(code, position, rotation)
        p.line_unknown[:] = p.line_candidate
        kernels.advance_radiation(p)

    def require(self, code: int, position: Array, rotation: Array) -> None:
        """Raise the error of a code of the kernels that is not 0.

        Raises
        ------
        SimulationError
            With the line that cannot be solved, and its place.
        """
        if code == SOLVED:
            return
        for line in self.platform.lines:
            x, y, z = np.asarray(position) + np.asarray(rotation) @ line.fairlead - line.anchor
            if not (np.isfinite([x, y, z]).all() and z > 0.0 and np.hypot(np.hypot(x, y), z) < 1.2 * line.length):
                raise unsolved(float(np.hypot(x, y)), float(z), line.length)
        raise SimulationError(f"mooring lines must be solvable, the platform is at {np.asarray(position).tolist()} m")

    def state(self) -> dict[str, Array]:
        """Arrays that a step changes, by name; writing into them restores a state."""
        return {name: getattr(self.arrays, name) for name in _STATE}

    def static_force(self, position: ArrayLike, rotation: ArrayLike) -> Array:
        """Return force [N] and moment about the displaced origin [N m] of hydrostatics and lines, shape (6,).

        Weight, waves, current and velocity are not in it. The state does not change.

        Raises
        ------
        SimulationError
            If a line cannot be solved.
        """
        p, out = self.arrays, np.zeros(6)
        names = ("line_candidate", "line_direction", "line_tension", "displacement", "local_force")
        p = p._replace(**{name: getattr(p, name).copy() for name in names})
        position, rotation, *_ = _motion(position, rotation, np.zeros(3), np.zeros(3))
        self.require(kernels.static_force(p, position, rotation, out), position, rotation)
        return out

    def current_force(self, rotation: Array) -> Array:
        """Force and moment of the current on the platform at rest, shape (6,), without waves; see `static_force`."""
        p, still = self.arrays, np.zeros(len(self.arrays.point_across))
        points = DragPoints(p.point_position @ rotation.T, p.point_axis @ rotation.T, p.point_across, p.point_along)
        return linear_drag(points, p.current, still, still).force

    def outline(self) -> tuple[Array, Array]:
        """Axes (n, 2, 3) of members and their radii (n,) in axes of the platform, for pictures [m].

        Without members a column from the base of the tower down to the fairleads, and an arm to each of them.
        """
        one = self.platform
        if one.members:
            ends = [(member.start, member.end) for member in one.members]
            return np.array(ends), 0.5 * np.array([member.diameter for member in one.members])
        points = [line.fairlead for line in one.lines]
        low = min((point[2] for point in points), default=-10.0)
        foot = np.array([0.0, 0.0, low])
        ends = [(foot, np.array([0.0, 0.0, one.tower_base])), *((foot, point) for point in points)]
        return np.array(ends), np.full(len(ends), 0.25 * abs(one.tower_base))

    def surface(self, time: float, diameter: float) -> Array:
        """Nodes of the surface of the water along and across the wind for pictures, shape (49, 17, 3) [m].

        It is an ellipse from 0.6 diameters upwind to 1.8 downwind.
        """
        along = -np.cos(np.linspace(0.0, np.pi, 49))[:, None]
        y = 0.6 * diameter * np.sqrt(1.0 - along**2) * np.linspace(-1.0, 1.0, 17)
        x = np.broadcast_to(diameter * (0.6 + 1.2 * along), y.shape)
        level = 0.0 * y if self.components is None else self.components.elevation(time, x, y)
        return np.stack([x, y, level], axis=2)

    def line_points(self, count: int = 30) -> Array:
        """Points of the lines in global axes from anchor to fairlead for pictures, shape (lines, count, 3) [m]."""
        p = self.arrays
        points = np.zeros((len(p.line_length), count, 3))
        for k, (h, v) in enumerate(p.line_candidate):
            shape = line_shape(
                h, v, p.line_length[k], p.line_weight[k], p.line_stiffness[k], rests=bool(p.line_rests[k]), count=count
            )
            points[k, :, :2] = p.line_anchor[k, :2] + shape[:, :1] * p.line_direction[k]
            points[k, :, 2] = p.line_anchor[k, 2] + shape[:, 1]
        return points


def _motion(*values: ArrayLike) -> tuple[Array, ...]:
    """Position, rotation, velocity, angular velocity as the kernels take them."""
    shapes, names = ((3,), (3, 3), (3,), (3,)), ("position", "rotation", "velocity", "omega")
    arrays = tuple(np.array(value, dtype=np.float64, order="C") for value in values)
    for name, shape, array in zip(names, shapes, arrays, strict=True):
        if array.shape != shape:
            raise InflowError(f"{name} must be of shape {shape}, got {array.shape}")
    return arrays


ITERATIONS = 4
"""Of the standard deviations in the drag, which is small against inertia and stiffness."""


class WaveMotion(NamedTuple):
    """Motion of a platform by the waves at time zero, and the memory of the water."""

    displacement: Array  # (6,) from the state of rest [m, rad]
    velocity: Array  # (6,) [m/s, rad/s]
    radiation: Array  # (r,) states of the radiation


class Deviation(NamedTuple):
    """Standard deviations of velocities in a sea, which make its drag linear."""

    platform: Array  # (6,) [m/s, rad/s]
    across: Array  # (n,) of the water relative to the drag points, across their axes [m/s]
    along: Array  # (n,) and along [m/s]


class HarmonicMotion(NamedTuple):
    """Harmonic motion of a platform in its sea: complex amplitudes at e^{iωt} of each component."""

    displacement: NDArray[np.complex128]  # (c, 6) [m, rad]
    velocity: NDArray[np.complex128]  # (c, 6) [m/s, rad/s]
    force: NDArray[np.complex128]  # (c, 6) of the waves, with their drag [N, N m]
    deviation: Deviation


class WaveResponse:
    """Motion of a platform amid the waves of an episode: the harmonic answer of its linear equations of motion.

    With q the displacement (surge, sway, heave, roll, pitch, yaw) from a state of rest, M the mass of all that is rigid
    with the platform and of the added mass A(∞), S the stiffness there and K̂ the memory of the water, the components
    X e^{iωt} of the wave force make (Cummins, Schiffstechnik 9, 1962; Jonkman, NREL/TP-500-41958, 2007, section 2.4)

        [−ω² M + iω (B + K̂(iω)) + S] Q = X + X_d.

    B and X_d stand for the drag with relative velocity, made linear by its mean in a Gaussian sea with its current
    (`wt_gym.hydrodynamics.drag.mean_square`), whose standard deviations are found by iteration.

    Parameters
    ----------
    loads : PlatformLoads
        Of the platform.
    """

    def __init__(self, loads: PlatformLoads) -> None:
        self._loads = loads
        self._started: HarmonicMotion | None = None
        a, b, c = loads.radiation
        self._poles, vectors = np.linalg.eig(a)
        self._states, self._inputs, self._outputs = vectors, np.linalg.solve(vectors, b.astype(complex)), c @ vectors

    def solve(self, mass: Array, stiffness: Array) -> HarmonicMotion:
        """Return the harmonic motion; without waves there are no components, and all deviations are 0.

        Parameters
        ----------
        mass : ndarray, shape (6, 6)
            Of all that is rigid with the platform, with the added mass at infinite frequency.
        stiffness : ndarray, shape (6, 6)
            Of water, lines and weight about the state of rest.
        """
        p, omega = self._loads.arrays, self._loads.arrays.wave_frequency
        n = len(p.point_across)
        water = (p.wave_real + 1j * p.wave_imaginary)[7 : 7 + 3 * n].T.reshape(len(omega), n, 3)
        points = DragPoints(p.point_position, p.point_axis, p.point_across, p.point_along)
        rest = stiffness - omega[:, None, None] ** 2 * mass
        rest = rest + 1j * omega[:, None, None] * (self._outputs * self._memory(omega)[:, None]) @ self._inputs
        velocity = np.zeros((len(omega), 6), complex)
        for _ in range(ITERATIONS):
            deviation = self._deviation(velocity, water)
            drag = linear_drag(points, p.current, deviation.across, deviation.along)
            damping = drag.damping + self._loads.linear_damping(deviation.platform)
            force = self._loads.wave_force + np.einsum("jnk,cnk->cj", drag.transfer, water)
            answer = np.linalg.solve(rest + 1j * omega[:, None, None] * damping, force[:, :, None])[:, :, 0]
            velocity = 1j * omega[:, None] * answer
        return HarmonicMotion(answer, velocity, force, deviation)

    def start(self, mass: Array, stiffness: Array) -> WaveMotion:
        """Return the motion at time zero; see `solve` for the arguments."""
        self._started = motion = self.solve(mass, stiffness)
        memory = self._memory(self._loads.arrays.wave_frequency)
        states = ((motion.velocity @ self._inputs.T) * memory).sum(axis=0) @ self._states.T
        displacement, velocity = np.split(self.platform(0.0), 2)
        return WaveMotion(displacement, velocity, np.ascontiguousarray(states.real))

    def platform(self, time: float) -> Array:
        """Return displacement and velocity (12,) at a time after the last start [s]."""
        motion = self._started
        assert motion is not None
        turn = np.exp(1j * self._loads.arrays.wave_frequency * time)
        return np.concatenate([(turn @ motion.displacement).real, (turn @ motion.velocity).real])

    def _memory(self, omega: Array) -> NDArray[np.complex128]:
        """Answer of each pole of the radiation to each frequency, shape (c, r)."""
        return np.asarray(1.0 / (1j * omega[:, None] - self._poles), dtype=np.complex128)

    def _deviation(self, velocity: NDArray[np.complex128], water: NDArray[np.complex128]) -> Deviation:
        """Standard deviations for the velocities of platform (c, 6) and water at the points (c, n, 3)."""
        p = self._loads.arrays
        relative = water - np.einsum("nij,cj->cni", motion_of_points(p.point_position), velocity)
        whole = 0.5 * (np.abs(relative) ** 2).sum(axis=(0, 2))
        lengthwise = 0.5 * (np.abs(np.einsum("cni,ni->cn", relative, p.point_axis)) ** 2).sum(axis=0)
        across = np.sqrt(np.maximum(whole - lengthwise, 0.0))
        return Deviation(np.sqrt(0.5 * (np.abs(velocity) ** 2).sum(axis=0)), across, np.sqrt(lengthwise))


class NearLoads:
    """Loads on a platform near rest, for linear models: with linear drag, given forces of waves and a given memory.

    `wt_gym.hydrodynamics.loads_kernels.platform_force` makes them from ``arrays``, which `set` prepares for a motion.

    Parameters
    ----------
    platform : Platform
    dt : float
        Length of a step [s].
    sea : WaveComponents or None
        Its current pushes; its waves make the drag linear after `meet_waves`.

    Attributes
    ----------
    loads : PlatformLoads
        In this sea, with their drag.
    arrays : PlatformArrays
        Without waves, drag, and the part of the radiation that belongs to a step.
    """

    def __init__(self, platform: Platform, dt: float, sea: WaveComponents | None) -> None:
        self.loads = PlatformLoads(platform, dt)
        self.loads.set_sea(sea)
        p, n = self.loads.arrays, len(self.loads.arrays.point_across)
        self._points = DragPoints(p.point_position, p.point_axis, p.point_across, p.point_along)
        self._deviation = Deviation(np.zeros(6), np.zeros(n), np.zeros(n))
        self.arrays = p._replace(
            point_across=np.zeros(n), point_along=np.zeros(n), quadratic_damping=np.zeros((6, 6)),
            instant_damping=platform.linear_damping.copy(), excitation=np.zeros(6), elevation=np.zeros(1),
        )  # fmt: skip

    def meet_waves(self, mass: Array, stiffness: Array) -> HarmonicMotion:
        """Make the drag linear for the motion in the sea, which is returned; see `WaveResponse.solve`."""
        motion = WaveResponse(self.loads).solve(mass, stiffness)
        self._deviation = motion.deviation
        self.arrays.instant_damping[:] = self.loads.linear_damping(motion.deviation.platform)
        return motion

    def set(self, memory: Array, waves: Array, rotation: Array, velocity: Array, omega: Array) -> None:
        """Let the next forces be those for a memory of the water (r,), a force of waves (6,) and this motion."""
        p, points = self.arrays, self._points
        p.radiation_force[:], p.excitation[:] = p.radiation_output @ memory, waves
        if p.current.any() or self._deviation.across.any():
            points = points._replace(position=points.position @ rotation.T, axis=points.axis @ rotation.T)
            drag = linear_drag(points, p.current, self._deviation.across, self._deviation.along)
            p.excitation[:] += drag.force - drag.damping @ np.concatenate([velocity, omega])

    def memory_rate(self, memory: Array) -> Array:
        """Rate (r,) of the memory of the water for the motion of the last forces."""
        a, b, _ = self.loads.radiation
        return np.asarray(a @ memory + b @ self.arrays.velocity_candidate)
