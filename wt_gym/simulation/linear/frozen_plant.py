"""Structure and air of a turbine as one function of state and inputs, with the wake frozen."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

import numpy as np
from scipy.spatial.transform import Rotation

from wt_gym.aerodynamics import AeroState
from wt_gym.aerodynamics.wake.wake_kernels import velocity_behind_disc
from wt_gym.base.errors import SimulationError
from wt_gym.multibody.tree import tree_kernels
from wt_gym.simulation.model.turbine_bodies import place_nacelle
from wt_gym.simulation.step import coupling_kernels
from wt_gym.simulation.step.coupling import Coupling
from wt_gym.simulation.step.coupling_data import TowerAir
from wt_gym.simulation.step.measurement import MeasuredState, Measurement

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from wt_gym.aerodynamics.state import AeroArrays
    from wt_gym.simulation.state import SimulatorState
    from wt_gym.turbines import Turbine
    from wt_gym.wind import Inflow

__all__ = ["AERODYNAMICS", "FrozenPlant", "LinearizedSimulator", "Wake"]

AERODYNAMICS = ("quasi_steady", "frozen_wake", "none")
ROUNDING = 1e-9
"""Speed of a lattice point that is none [m/s]."""
NEAR_WAKE = 0.5
"""Age up to which the wake follows the circulation of the blades in quasi-steady aerodynamics [s].

Between 0.25 and 2 s the response of the NREL 5-MW to steps of pitch, torque and wind changes by less than 3 %.
"""


class LinearizedSimulator(Protocol):
    """What of a `wt_gym.simulation.Simulator` linear models are made from; it builds on this module itself."""

    @property
    def turbine(self) -> Turbine:
        """The turbine."""

    @property
    def inflow(self) -> Inflow:
        """Its wind."""

    @property
    def mirrored(self) -> bool:
        """Whether structure and air are those of the mirror image."""

    @property
    def coupling(self) -> Coupling:
        """Structure and air in their present state."""

    def state(self) -> SimulatorState:
        """Copy of the present state."""


@dataclass(frozen=True)
class Wake:
    """A lattice whose wake stands still, and the rotor's position for which it was made.

    Attributes
    ----------
    aero : AeroState
    source : array (n_strip,)
        Decambering of the reference, where each solution starts, so that the loads are a smooth function.
    angle : float
        Rotor azimuth [rad].
    center, axis : array (3,)
        Hub [m] and shaft direction.
    slowing : array (3,)
        What the rotor adds to the wind at the tower [m/s].
    """

    aero: AeroState
    source: NDArray[np.float64]
    angle: float
    center: NDArray[np.float64]
    axis: NDArray[np.float64]
    slowing: NDArray[np.float64]


class _Gust:
    """A steady inflow with a uniform change."""

    def __init__(self, inflow: Inflow) -> None:
        self.inflow, self.change = inflow, np.zeros(3)

    def velocity(self, points: NDArray[np.float64], time: float) -> NDArray[np.float64]:
        return self.inflow.velocity(points, time) + self.change


class FrozenPlant:
    """Rates and channels of a turbine as functions of the state of its structure.

    Parameters
    ----------
    simulator : Simulator
        Its models are used, its state is left alone.
    inflow : SteadyInflow
    aerodynamics : str
        "quasi_steady", "frozen_wake" or "none".
    hold_speed : bool
        A reaction on the generator keeps its speed exactly; the reaction is found with each evaluation.

    Attributes
    ----------
    elastic : array of int
        Velocities of all coordinates but the generator azimuth; for this structure also the indices of the coordinates.
    blade_elastic : list of list of int
        Those of each blade.
    reach : array (n_u,)
        Largest speed of a point of the rotor for a unit rate of each coordinate.
    torque, reaction : float
        Commanded generator torque and the torque that held the speed in the last evaluation [N m, high-speed shaft].
    wake : Wake or None
        To be set before evaluations with air.
    """

    def __init__(
        self,
        simulator: LinearizedSimulator,
        inflow: Inflow,
        aerodynamics: str = "quasi_steady",
        hold_speed: bool = False,
    ) -> None:
        if aerodynamics not in AERODYNAMICS:
            raise SimulationError(f"aerodynamics must be one of {', '.join(AERODYNAMICS)}, got {aerodynamics!r}")
        models = simulator.coupling.models
        self.turbine, self.lattice, self.structure = models.turbine, models.lattice, models.structure
        self.fidelity, self.time_step, self.tower_flow = models.fidelity, models.time_step, models.tower_flow
        self.system, self.n_blades = self.structure.system, self.turbine.n_blades
        system = self.system
        if system.n_q != system.n_u or system.n_constraints:
            raise SimulationError("only a structure in embedded form without quaternions can be linearized")
        if models.fidelity.reference_condition != "clamped":
            raise SimulationError(
                f"Fidelity.reference_condition is {models.fidelity.reference_condition!r}; linear models of observer "
                "frames need 'clamped', with which their equations are those of the structure's coordinates"
            )
        self.inflow, self._wind = inflow, _Gust(inflow)
        self.with_air, self.hold_speed = aerodynamics != "none", hold_speed
        self._near_wake = NEAR_WAKE if aerodynamics == "quasi_steady" else 0.0
        self._allocate()
        s, n_q = self.structure, system.n_q
        self.elastic = np.array([i for i in range(system.n_u) if i != s.azimuth_u])
        self.blade_elastic = [
            [system.index(b, "elastic_u") + k for b in parts for k in range(system.bodies[b].n_elastic)]
            for parts in s.parts
        ]
        rates = [self._reach_of(n_q + i) for i in range(system.n_u)]
        self.reach = np.array(rates)
        self._servo_reach = np.array(
            [self._reach_of(n_q + system.n_u + system.n_servo + i) for i in range(system.n_servo)]
        )

    def _allocate(self) -> None:
        """Arrays of the exchange between structure and air."""
        n, shape = self.n_blades, self.lattice.nodes_shape
        self.work, self.inputs = self.system.new_work(), self.system.new_inputs()
        self._nodes, self._velocities, self._forces = np.zeros(shape), np.zeros(shape), np.zeros(shape)
        flat = (n, shape[1] * shape[2], 3)
        self._flat = tuple(a.reshape(flat) for a in (self._nodes, self._velocities, self._forces))
        self._lattice_bodies = self.structure.lattice_bodies
        self._tower = TowerAir.of(self.turbine, self.structure)
        self._tower_axis = self._tower.position.copy()
        self._measurement = Measurement(self.turbine, self.structure)
        self._base = np.zeros(2 + n + 3)  # torque, yaw, pitch of each blade, change of the wind
        self._command = self._base.copy()
        self.wake: Wake | None = None
        self.reaction = 0.0

    def _move(self, y: NDArray[np.float64]) -> None:
        """Kinematics and lattice points of the state y."""
        s, work = self.structure, self.work
        tree_kernels.kinematics(y, self.system.tree, work)
        self._elastic = [np.array(part) for part in zip(*(s.elastic(b, y) for b in self._lattice_bodies), strict=True)]
        coupling_kernels.rotor_motion(
            work.rot, work.r, work.v, work.omega, *self._elastic, s.lattice_points, self._lattice_bodies,
            s.sub_body_nodes, *self._flat[:2],
        )  # fmt: skip

    def _reach_of(self, i: int) -> float:
        """Largest speed of lattice points [m/s] at a unit rate i; one where none moves, as by inner tower nodes."""
        y = self.system.initial_state()
        y[i] = 1.0
        self._move(y)
        speed = float(np.linalg.norm(self._velocities, axis=-1).max())
        return speed if speed > ROUNDING else 1.0

    # ---- inputs ------------------------------------------------------------------------------------------------------

    @property
    def torque(self) -> float:
        """Commanded generator torque, high-speed shaft [N m]."""
        return float(self._base[0])

    def set_commands(self, torque: float, yaw: float, pitch: ArrayLike) -> None:
        """Commands of the operating point: torque [N m], yaw [rad] and pitch (n_blades,) [rad]."""
        self._base[0], self._base[1], self._base[2:-3] = torque, yaw, pitch
        self.change_inputs(np.zeros_like(self._base))

    def change_inputs(self, change: NDArray[np.float64]) -> None:
        """Inputs that differ from the operating point by ``change``: torque, yaw, pitch of each blade, wind (3)."""
        self._command = self._base + change
        self._wind.change = self._command[-3:]
        self._set_torque(self._command[0])
        self.inputs.servo_command[:] = self._command[1:-3]

    def _set_torque(self, torque: float) -> None:
        drive = self.turbine.drivetrain
        self.inputs.dof_force[:, self.structure.azimuth_u] = -torque * drive.gear_ratio / drive.gearbox_efficiency

    def inputs_of(self, motion: float, speed: float, torque: float) -> dict[str, tuple[NDArray[np.float64], float]]:
        """Changes of the inputs by name, and by how much the named quantity changes.

        Parameters
        ----------
        motion, speed, torque : float
            Displacement [m] and velocity [m/s] of the rotor's points, and torque [N m].

        Returns
        -------
        dict of str to (array, float)
        """
        unit = np.eye(len(self._base))
        yaw, pitch = motion / self._servo_reach[0], motion / self._servo_reach[1]
        out = {f"pitch_{i + 1}": (pitch * unit[2 + i], pitch) for i in range(self.n_blades)}
        out["pitch_collective"] = (pitch * unit[2:-3].sum(axis=0), pitch)
        out["yaw"] = (yaw * unit[1], yaw)
        if not self.hold_speed:
            out["generator_torque"] = (torque * unit[0], torque)
        hub = np.array([[0.0, 0.0, self.turbine.hub_height]])
        wind = self.inflow.velocity(hub, 0.0)[0]
        size = np.linalg.norm(wind)
        along = wind / size if size > 0.0 else np.array([1.0, 0.0, 0.0])
        out["wind_speed"] = (speed * along @ unit[-3:], speed)
        for k, axis in enumerate("xyz"):
            out[f"wind_{axis}"] = (speed * unit[-3 + k], speed)
        return out

    def step_of(self, i: int, motion: float, speed: float) -> float:
        """Change of the state's entry i that moves points of the rotor by ``motion`` [m] or ``speed`` [m/s]."""
        n_u, n_s = self.system.n_u, self.system.n_servo
        if i < n_u:
            return float(motion / self.reach[i])
        if i < 2 * n_u:
            return float(speed / self.reach[i - n_u])
        if i < 2 * n_u + n_s:
            return float(motion / self._servo_reach[i - 2 * n_u])
        return float(speed / self._servo_reach[i - 2 * n_u - n_s])

    def steady_state(
        self, azimuth: float, rotor_speed: float, q: NDArray[np.float64], u: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """State with the drives at rest at their commands and elastic coordinates q and rates u (n_elastic,)."""
        y: NDArray[np.float64] = self.system.initial_state()
        n = self.system.n_u
        y[self.elastic], y[n + self.elastic] = q, u
        y[self.structure.azimuth_q], y[n + self.structure.azimuth_u] = azimuth, rotor_speed
        y[2 * n : 2 * n + self.system.n_servo] = self._base[1:-3]
        return y

    # ---- wake --------------------------------------------------------------------------------------------------------

    def new_wake(self, y: NDArray[np.float64], rotor_speed: float) -> Wake | None:
        """Helical wake in momentum balance with the rotor in the state y (None without air)."""
        if not self.with_air:
            return None
        self._move(y)
        center, axis = self._shaft()
        aero = self.lattice.new_state()
        self.lattice.initialize_helix(
            aero, self._nodes, self._velocities, self._wind_at_blades(np.zeros(3)), center, axis, rotor_speed,
            self.time_step,
        )  # fmt: skip
        return self._frozen(aero, self._angle(y), center, axis)

    def present_wake(self, aero: AeroState, y: NDArray[np.float64]) -> Wake | None:
        """The wake of a running simulation in the state y, frozen (None without air)."""
        if not self.with_air:
            return None
        self._move(y)
        aero = aero.copy()
        aero.arrays.n_levels[0] = 1  # a solution at dt = 0 is steady
        return self._frozen(aero, self._angle(y), *self._shaft())

    def _frozen(self, aero: AeroState, angle: float, center: NDArray[np.float64], axis: NDArray[np.float64]) -> Wake:
        """Freeze the wake of a lattice that belongs to the present nodes; its youngest rings follow the blades.

        A ring of the near wake takes the circulation of its strip at the trailing edge, like the newest ring: its
        influence joins that of the strip's last bound ring, and what it induced goes out of the frozen velocity.
        """
        a, rings, slowing = aero.arrays, self.lattice.arrays.shed_rings, np.zeros(3)
        velocity_behind_disc(
            a.wake, a.induced, a.age, a.n_rows, center, axis, self.work.omega[self.structure.hub, 0], slowing
        )
        wind = self._wind_at_blades(slowing)
        self.lattice._solve(aero, self._nodes, self._velocities, wind, 0.0, first=True)
        near = np.flatnonzero(a.age[1 : aero.n_rows] < self._near_wake) + 1
        if len(near):
            points, probe = self.lattice.work.points.copy(), aero.copy()
            for array in (probe.arrays.gamma, probe.arrays.wake_gamma, probe.arrays.far, probe.arrays.body_strength):
                array[...] = 0.0
            probe.arrays.n_rows[0] = near[-1] + 1
            per_blade = a.gamma[0].size
            for b in range(self.n_blades):
                for e, ring in enumerate(rings):
                    probe.arrays.wake_gamma[near, b, e] = 1.0
                    velocity = self.lattice.induced_velocity(probe, points.T).T
                    probe.arrays.wake_gamma[near, b, e] = 0.0
                    a.influence[b * per_blade + ring] += velocity
                    a.wake_flow[:] -= a.gamma[b].flat[ring] * velocity
            self._invert(a)
            self.lattice._solve(aero, self._nodes, self._velocities, wind, 0.0, first=True)
        return Wake(aero, a.source.copy(), angle, center, axis, slowing)

    def _invert(self, a: AeroArrays) -> None:
        """Solution of the boundary condition for a changed influence of the rings."""
        n_blade, n_chord, n_span = a.gamma.shape
        chord = a.nodes[:, 1:] - a.nodes[:, :-1]
        span = a.nodes[:, :, 1:] - a.nodes[:, :, :-1]
        normal = np.cross(chord[:, :, 1:] + chord[:, :, :-1], span[:, 1:] + span[:, :-1]).reshape(-1, 3)
        normal /= np.linalg.norm(normal, axis=1, keepdims=True)
        a.inverse[:] = np.linalg.inv(np.einsum("scr,rc->rs", a.influence[:, :, : len(normal)], normal))
        by_strip = a.inverse.reshape(n_blade, n_chord, n_span, n_blade, n_chord, n_span)[:, -1].sum(axis=3)
        a.response[:] = by_strip.reshape(a.response.shape)

    def _shaft(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        hub = self.structure.hub
        return self.work.r[hub].copy(), self.work.rot[hub, :, 0].copy()

    def _angle(self, y: NDArray[np.float64]) -> float:
        return float(y[self.structure.azimuth_q] + y[self.system.index(self.structure.hub, "joint_q")])

    def _wind_at_blades(self, slowing: NDArray[np.float64]) -> NDArray[np.float64]:
        """Undisturbed wind at the lattice nodes, with the blocking of the tower in a wind changed by ``slowing``."""
        wind = self._wind.velocity(self._nodes, 0.0)
        if self.lattice.bodies:
            nacelle = self.structure.nacelle
            place_nacelle(self.lattice.bodies, self.work.rot[nacelle], self.work.omega[nacelle])
            self.lattice.body_wind[:] = self._wind.velocity(self.lattice.bodies.control_points, 0.0)
        if self.fidelity.tower_shadow and self.fidelity.tower_body is None:
            wind = np.array(wind + slowing, dtype=np.float64)
            self.tower_flow.add(self._nodes, wind, self.work.r[self.structure.nacelle])
            wind -= slowing
        return wind

    # ---- evaluation --------------------------------------------------------------------------------------------------

    def _load(self, y: NDArray[np.float64]) -> None:
        """Loads of the air for the state y into the inputs; kinematics are up to date."""
        self._move(y)
        if not self.with_air:
            return
        wake = self.wake
        if wake is None:
            raise SimulationError("the wake of a plant with air must be set before it is evaluated")
        # the wake turns with the rotor: the lattice is solved where the rotor stood
        turn = Rotation.from_rotvec((self._angle(y) - wake.angle) * wake.axis).as_matrix()
        nodes = wake.center + (self._nodes - wake.center) @ turn
        wake.aero.arrays.source[:] = wake.source
        forces = self.lattice._solve(
            wake.aero, nodes, self._velocities @ turn, self._wind_at_blades(wake.slowing) @ turn, 0.0, first=True
        )
        self._forces[:] = forces @ turn.T
        loads = self.inputs.body_loads
        coupling_kernels.rotor_loads(
            self._flat[2], self.work.rot, self._elastic[0], self.structure.lattice_points, self._lattice_bodies,
            self.structure.sub_body_nodes, loads[1],
        )  # fmt: skip
        self._tower.wind[:] = self._wind.velocity(self._tower_axis, 0.0)
        coupling_kernels.tower_drag(y, self.system.tree, self.work, self._tower, loads[1][self.structure.tower])
        loads[0] = loads[1]

    def rates(self, y: NDArray[np.float64]) -> NDArray[np.float64]:
        """dy/dt (n_state,) of the structure in the state y."""
        self._load(y)
        dy: NDArray[np.float64] = self.system.rates(y, self.inputs, self.work)
        if not self.hold_speed:
            return dy
        k, torque = self.system.n_q + self.structure.azimuth_u, self._command[0]
        # accelerations are linear in the torque: a second evaluation tells which one stops the generator's
        other = torque + self.turbine.drivetrain.max_generator_torque
        self._set_torque(other)
        slope = (self.system.rates(y, self.inputs, self.work) - dy) / (other - torque)
        self._set_torque(torque)
        self.reaction = torque - dy[k] / slope[k]
        out: NDArray[np.float64] = dy + (self.reaction - torque) * slope
        return out

    def acceleration(self, y: NDArray[np.float64]) -> NDArray[np.float64]:
        """u̇ (n_u,) in the state y."""
        return self.rates(y)[self.system.n_q : self.system.n_q + self.system.n_u]

    def outputs(self, y: NDArray[np.float64], dy: NDArray[np.float64]) -> NDArray[np.float64]:
        """All channels (n_channels,) for the state y whose rates dy were just computed."""
        nodes, _, forces = self._flat
        instant = MeasuredState(y, dy, self.inputs.body_loads[1], self.work, nodes, forces)
        torque = self.reaction if self.hold_speed else self._command[0]
        self._measurement.take(0.0, instant, torque, self._command[:-3], self._wind)
        out: NDArray[np.float64] = self._measurement.values.copy()
        return out
