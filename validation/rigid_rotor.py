"""A rigid rotor in a uniform wind, straight on the vortex lattice: no structure, no tower."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from wt_gym.aerodynamics import AeroOptions, AeroState, LatticePlanform, VortexLattice
from wt_gym.simulation.models import blade_planform

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from wt_gym.aerodynamics.vortex_lattice import UndisturbedWind
    from wt_gym.turbines import Turbine

__all__ = ["RigidRotor", "RotorRun", "RotorStep", "UniformWind"]


@dataclass(frozen=True)
class UniformWind:
    """The same wind everywhere and always.

    Attributes
    ----------
    speed : float
        [m/s].
    tilt : float
        Angle by which the rotor's axis points up against the wind [rad]; the axis stays x, the wind turns instead.
    """

    speed: float
    tilt: float = 0.0

    def velocity(self, points: ArrayLike, time: ArrayLike) -> np.ndarray:
        """Wind (..., 3) [m/s] at points (..., 3)."""
        vector = [self.speed * np.cos(self.tilt), 0.0, self.speed * np.sin(self.tilt)]
        return np.broadcast_to(vector, np.shape(points))


@dataclass(frozen=True)
class RotorStep:
    """A marching rotor at the end of one step.

    Attributes
    ----------
    time, azimuth, speed : float
        [s], [rad], [rad/s].
    state : AeroState
        Of the lattice.
    nodes, forces : ndarray, shape (n_blades, n_chord + 1, n_span + 1, 3)
        Positions of the ring nodes [m], the center of the hub at 0, and the forces of the air on them [N].
    """

    time: float
    azimuth: float
    speed: float
    state: AeroState
    nodes: np.ndarray
    forces: np.ndarray

    @property
    def thrust(self) -> float:
        """Force along the axis [N]."""
        return float(self.forces[..., 0].sum())

    @property
    def torque(self) -> float:
        """Moment about the axis [N m]."""
        return float((self.nodes[..., 1] * self.forces[..., 2] - self.nodes[..., 2] * self.forces[..., 1]).sum())


@dataclass(frozen=True)
class RotorRun:
    """What a rotor in a uniform wind has come to.

    Attributes
    ----------
    power, thrust : ndarray, shape (n_steps,)
        [W], [N] at every step.
    steps_per_turn : int
    reference_power, reference_thrust : float
        rho A V^3 / 2 [W] and rho A V^2 / 2 [N].
    span : ndarray, shape (n_span,)
        Distance of the strips' middles from the axis, along the blade [m].
    alpha, speed : ndarray, shape (n_span,)
        Effective angle of attack [rad] and speed in the section plane [m/s] of the first blade at the last step.
    circulation : ndarray, shape (n_span,)
        [m^2/s], first blade, last step.
    coefficients : ndarray, shape (n_span, 3)
        cl, cd, cm of the strips' polars at ``alpha``.
    force : ndarray, shape (n_span, 3)
        Force per length on the first blade at the last step [N/m], in the frame that turns with it: along the axis, in
        the direction of motion, along the blade. See `RigidRotor.strip_force`.
    """

    power: np.ndarray
    thrust: np.ndarray
    steps_per_turn: int
    reference_power: float
    reference_thrust: float
    span: np.ndarray
    alpha: np.ndarray
    speed: np.ndarray
    circulation: np.ndarray
    coefficients: np.ndarray
    force: np.ndarray

    @property
    def cp(self) -> float:
        """Power coefficient, mean of the last turn."""
        return float(self.power[-self.steps_per_turn :].mean() / self.reference_power)

    @property
    def ct(self) -> float:
        """Thrust coefficient, mean of the last turn."""
        return float(self.thrust[-self.steps_per_turn :].mean() / self.reference_thrust)

    @property
    def drift(self) -> float:
        """Relative change of the power from the turn before the last to the last: how well the wake has settled."""
        last, before = self.power[-self.steps_per_turn :], self.power[-2 * self.steps_per_turn : -self.steps_per_turn]
        return float(last.mean() / before.mean() - 1.0)


@dataclass(frozen=True)
class RigidRotor:
    """Equal rigid blades on a hub.

    Attributes
    ----------
    planform : LatticePlanform
        One blade, z from its root.
    n_blades : int
    root_radius : float
        Distance of the blade root from the axis along the blade [m].
    radius : float
        Radius of the disc to which coefficients refer [m].
    cone : float
        Positive tips upwind [rad].
    air_density : float
        [kg/m^3].
    """

    planform: LatticePlanform
    n_blades: int
    root_radius: float
    radius: float
    cone: float = 0.0
    air_density: float = 1.225

    @classmethod
    def of_turbine(cls, turbine: Turbine, options: AeroOptions) -> RigidRotor:
        """Rotor of a turbine of the catalogue; coefficients refer to the nominal diameter."""
        return cls(
            blade_planform(turbine, options), turbine.n_blades, turbine.blade.root_radius,
            0.5 * turbine.rotor_diameter, turbine.hub.cone, turbine.air_density,
        )  # fmt: skip

    def motion(
        self, azimuth: float, rotor_speed: float, pitch: float, pitch_rate: float = 0.0
    ) -> tuple[np.ndarray, np.ndarray]:
        """Positions and velocities (n_blades, n_chord + 1, n_span + 1, 3) of the ring nodes, center of the hub at 0."""
        pitched = self.planform.nodes @ turn("z", -pitch).T
        turning = np.cross([0.0, 0.0, -pitch_rate], pitched)
        hinge = turn("y", -self.cone).T
        local, moving = (pitched + np.array([0.0, 0.0, self.root_radius])) @ hinge, turning @ hinge
        angles = azimuth + 2.0 * np.pi / self.n_blades * np.arange(self.n_blades)
        nodes = np.array([local @ turn("x", angle).T for angle in angles])
        velocities = np.array([moving @ turn("x", angle).T for angle in angles])
        return nodes, velocities + np.cross([rotor_speed, 0.0, 0.0], nodes)

    def march(
        self,
        options: AeroOptions,
        inflow: UndisturbedWind,
        rotor_speed: float,
        pitch: Callable[[float], float],
        dt: float,
        n_steps: int,
        acceleration: Callable[[float, float], float] | None = None,
    ) -> Iterator[RotorStep]:
        """Start with a helical wake in momentum balance and step with the free wake; a generator of `RotorStep`.

        Parameters
        ----------
        options : AeroOptions
        inflow : object with ``velocity(points (..., 3), time) -> (..., 3)``
        rotor_speed : float
            At the start [rad/s].
        pitch : callable
            Pitch [rad] at a time [s].
        dt : float
            [s].
        n_steps : int
        acceleration : callable, optional
            ``acceleration(torque, rotor_speed)`` [rad/s^2], given the torque of the air [N m]; by default none.
        """
        lattice = VortexLattice(self.planform, self.n_blades, options, self.air_density)
        state = lattice.new_state()
        nodes, velocities = self.motion(0.0, rotor_speed, pitch(0.0))
        stream = inflow.velocity(nodes, 0.0)
        lattice.initialize_helix(state, nodes, velocities, stream, np.zeros(3), [1.0, 0.0, 0.0], rotor_speed, dt)
        azimuth, speed = 0.0, rotor_speed
        for k in range(n_steps):
            time = (k + 1) * dt
            lattice.convect_wake(state, inflow, time - dt, dt)
            azimuth += speed * dt
            rate = (pitch(time) - pitch(time - dt)) / dt
            nodes, velocities = self.motion(azimuth, speed, pitch(time), rate)
            forces = lattice.solve(state, nodes, velocities, inflow.velocity(nodes, time), dt)
            lattice.accept(state)
            step = RotorStep(time, azimuth, speed, state, nodes, forces)
            yield step
            if acceleration is not None:
                speed += dt * acceleration(step.torque, speed)

    def run(self, options: AeroOptions, wind: float, rotor_speed: float, pitch: float = 0.0, turns: float = 4.0,
            tilt: float = 0.0, steps_per_turn: int | None = None) -> RotorRun:  # fmt: skip
        """Start with a helical wake in momentum balance and turn ``turns`` times with the free wake.

        Parameters
        ----------
        options : AeroOptions
        wind : float
            [m/s].
        rotor_speed : float
            [rad/s].
        pitch : float
            [rad].
        turns : float
            At least two, for the mean and its drift.
        tilt : float
            Angle of the axis to the wind [rad].
        steps_per_turn : int, optional
            By default those of ``options.azimuth_step_deg``.

        Returns
        -------
        RotorRun
        """
        steps = steps_per_turn or round(360.0 / options.azimuth_step_deg)
        dt = 2.0 * np.pi / rotor_speed / steps
        history = []
        for step in self.march(options, UniformWind(wind, tilt), rotor_speed, lambda time: pitch, dt,
                               round(turns * steps)):  # fmt: skip
            history.append((step.torque * rotor_speed, step.thrust))
        return self.result(step.state, np.array(history), wind, steps, step.azimuth)

    def result(self, state: AeroState, history: np.ndarray, wind: float, steps: int, azimuth: float) -> RotorRun:
        """Collect a run from the last state and the power and thrust of all steps (n_steps, 2)."""
        edges = self.planform.span_edges
        pressure = 0.5 * self.air_density * np.pi * self.radius**2 * wind**2
        alpha = state.angle_of_attack[0].copy()
        table = np.linspace(-np.pi, np.pi, self.planform.polars.shape[1] + 1)
        polars = np.concatenate([self.planform.polars, self.planform.polars[:, :1]], axis=1)
        coefficients = np.array(
            [[np.interp(a, table, p) for p in polar.T] for a, polar in zip(alpha, polars, strict=True)]
        )
        return RotorRun(
            power=history[:, 0],
            thrust=history[:, 1],
            steps_per_turn=steps,
            reference_power=pressure * wind,
            reference_thrust=pressure,
            span=self.root_radius + 0.5 * (edges[1:] + edges[:-1]),
            alpha=alpha,
            speed=state.section_speed[0].copy(),
            circulation=state.circulation[0].copy(),
            coefficients=coefficients,
            force=self.strip_force(state, coefficients[:, 1]) @ turn("x", azimuth) * [1.0, -1.0, 1.0],
        )

    def strip_force(self, state: AeroState, drag_coefficient: np.ndarray) -> np.ndarray:
        """Force per length (n_span, 3) on the strips of the first blade [N/m], global.

        The lattice gives half of each strip's force to either edge. What edges have in common with their neighbors
        can be shared out again, but not what changes from strip to strip: at the tip, where the load falls like a
        root, the strips before the last would have 5 % too little and the last 6 to 8 % too much. So that part is taken
        from circulation and drag of the strips themselves.
        """
        nodes, circulation = state.arrays.nodes[0], state.circulation[0]
        span = nodes[0, 1:] - nodes[0, :-1]
        width = np.linalg.norm(span, axis=1)[:, None]
        span = span / width
        aft = nodes[-1, 1:] + nodes[-1, :-1] - nodes[0, 1:] - nodes[0, :-1]
        aft = aft - np.sum(aft * span, axis=1)[:, None] * span
        aft /= np.linalg.norm(aft, axis=1)[:, None]
        normal = np.cross(aft, span)
        angle = (state.angle_of_attack[0] - self.planform.slope_angle)[:, None]
        along, across = aft * np.cos(angle) + normal * np.sin(angle), normal * np.cos(angle) - aft * np.sin(angle)
        speed = state.section_speed[0]
        lift = self.air_density * circulation * speed
        drag = 0.5 * self.air_density * speed**2 * self.planform.chord * drag_coefficient
        own = lift[:, None] * across + drag[:, None] * along
        half = 0.5 * own * width
        at_edges = np.concatenate([half, np.zeros((1, 3))]) + np.concatenate([np.zeros((1, 3)), half])
        return own + self._force_per_length(state.nodal_forces[0].sum(axis=0) - at_edges)

    def _force_per_length(self, at_edges: np.ndarray) -> np.ndarray:
        """Strip forces per length (n_span, 3) from the forces at the span edges (n_span + 1, 3).

        The lattice gives half of each strip's force to either edge, so the strips' forces follow one by one only up to
        an alternating part; the mean of the edges' densities has none.
        """
        edges = self.planform.span_edges
        width = np.diff(edges)
        share = np.concatenate([[0.5 * width[0]], 0.5 * (width[1:] + width[:-1]), [0.5 * width[-1]]])
        density = at_edges / share[:, None]
        return 0.5 * (density[1:] + density[:-1])


def turn(axis: str, angle: float) -> np.ndarray:
    """Matrix (3, 3) of the rotation by ``angle`` [rad] about x, y or z."""
    c, s = np.cos(angle), np.sin(angle)
    if axis == "x":
        return np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]])
    if axis == "y":
        return np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
