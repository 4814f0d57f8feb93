"""The start of a simulation: turbine, wake and generator in balance with each other."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from wt_gym.multibody.integrators.schemes import INTEGRATORS
from wt_gym.simulation.model.equilibrium import elastic_equilibrium
from wt_gym.simulation.step import coupling_kernels
from wt_gym.simulation.step.coupling import Coupling

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from wt_gym.simulation.drivetrain.drives import Drives
    from wt_gym.simulation.fidelity import Fidelity
    from wt_gym.wind import Inflow

__all__ = ["Starter"]

PASSES = 3
"""Passes between wake and elastic deformation."""


class Starter:
    """Puts a coupled turbine into a steady state.

    A turbine with constraint equations is balanced without them, and takes over the motion.

    Parameters
    ----------
    coupling : Coupling
    drives : Drives
    """

    def __init__(self, coupling: Coupling, drives: Drives) -> None:
        self.coupling, self.drives = coupling, drives
        embedded = coupling.models.embedded
        self._balanced = coupling if embedded is None else Coupling(embedded)

    def balance(
        self,
        rotor_speed: float,
        azimuth: float,
        generator_torque: float | None,
        inflow: Inflow,
        tower_top: NDArray[np.float64] | None = None,
        wake_thrust: float | None = None,
        motion: NDArray[np.float64] | None = None,
    ) -> None:
        """Balance turbine, wake and air, and begin to move; pitch and yaw are those that the drives have started with.

        Parameters
        ----------
        rotor_speed, azimuth : float
            [rad/s], [rad].
        generator_torque : float or None
            High-speed shaft [N m]; None: what balances the torque of the air.
        inflow : Inflow
        tower_top : array (4,), optional
            Displacement of the tower top along and across the heading of the nacelle [m] and its rates [m/s]; by
            default the balance, at rest.
        wake_thrust : float, optional
            Mean thrust in the time before, to which the wake belongs [N]; by default that of the balance.
        motion : array (n,), optional
            Of the structure (`TurbineStructure.motion`): it continues with its velocities and accelerations, deformed
            as the loads of the start make it.

        Raises
        ------
        SimulationError, MultibodyError, AerodynamicsError
            When there is no balance.
        """
        coupling, balanced = self.coupling, self._balanced
        for array in (*balanced.integrator.inputs, *coupling.integrator.inputs):
            array[:] = 0.0
        for each in {balanced, coupling}:
            each.restart()
        balanced.aero.clear()  # the tower stands in what the last wake slowed
        y = self._rigid_state(rotor_speed, azimuth)
        if motion is not None:
            accelerations = balanced.models.structure.move(y, motion, self.drives.command[1])
            self._find_equilibrium(y, rotor_speed, generator_torque, inflow, wake_thrust, accelerations)
        else:
            self._find_equilibrium(y, rotor_speed, generator_torque, inflow, wake_thrust)
            self._turn_loads(y, rotor_speed, azimuth)
            if tower_top is not None:
                self._sway(y, tower_top)
        if balanced is not coupling:
            y = coupling.models.structure.adopt(balanced.models.structure, y)
            coupling.aero.assign(balanced.aero)
            coupling.integrator.inputs.body_loads[:] = balanced.integrator.inputs.body_loads
            self._act(coupling)
        coupling.begin(y)

    def _act(self, coupling: Coupling) -> None:
        self.drives.act(coupling.integrator.inputs, coupling.models.structure.azimuth_u, first=0)

    def _rigid_state(self, rotor_speed: float, azimuth: float) -> NDArray[np.float64]:
        """Undeformed turbine turning steadily."""
        s = self._balanced.models.structure
        y: NDArray[np.float64] = s.system.initial_state()
        n_y = s.system.n_q + s.system.n_u
        y[s.azimuth_q], y[s.system.n_q + s.azimuth_u] = azimuth, rotor_speed
        y[n_y : n_y + s.system.n_servo] = self.drives.command[1:]
        return y

    def _turn_loads(self, y: NDArray[np.float64], rotor_speed: float, azimuth: float) -> None:
        """Rates of the blades (y, in place) as their balance turns with the rotor past weight, shear and yawed wind.

        Each elastic coordinate has its balance at as many azimuths as there are blades. Its mean and the first harmonic
        that run through them, q = a + b cos ψ + c sin ψ, give the rate Ω (c cos ψ − b sin ψ) of a blade that follows
        slowly changing loads. Without it blades start at rest amid the swing of their weight and ring edgewise for a
        minute. Two blades do not tell three coefficients apart; theirs start at rest.
        """
        s, n = self._balanced.models.structure, self._balanced.models.turbine.n_blades
        if n < 3:
            return
        psi = azimuth + 2.0 * np.pi * np.arange(n) / n
        harmonics = np.column_stack([np.ones(n), np.cos(psi), np.sin(psi)])
        rates = rotor_speed * np.column_stack([np.zeros(n), -np.sin(psi), np.cos(psi)])
        slope = rates @ np.linalg.pinv(harmonics)
        for bodies in zip(*s.parts, strict=True):
            q, u = zip(*(s.elastic(body, y) for body in bodies), strict=True)
            for own, rate in zip(u, slope @ np.array(q), strict=True):
                own[:] = rate

    def _sway(self, y: NDArray[np.float64], tower_top: NDArray[np.float64]) -> None:
        """Displacement and motion of the tower top (y, in place) in its first modes."""
        c = self._balanced
        s, yaw = c.models.structure, self.drives.command[1]
        cos, sin = np.cos(yaw), np.sin(yaw)
        turn = np.array([[cos, -sin], [sin, cos]])  # from the heading to global axes
        c.move_lattice(y)
        moved = turn @ tower_top[:2] - c.integrator.work.r[s.nacelle, :2]
        q, u = s.elastic(s.tower, y)
        q += s.tower_sway @ moved
        u += s.tower_sway @ (turn @ tower_top[2:])

    def _find_equilibrium(
        self,
        y: NDArray[np.float64],
        rotor_speed: float,
        generator_torque: float | None,
        inflow: Inflow,
        wake_thrust: float | None,
        accelerations: float | NDArray[np.float64] = 0.0,
    ) -> None:
        """Wake, loads and elastic state (y, in place) in balance with each other and the generator.

        Balance means the given accelerations: a motion that continues in another wind is not jolted by it.
        """
        c = self._balanced
        s, induced = c.models.structure, None
        for k in range(PASSES):
            last = k == PASSES - 1
            induced = self._balance_air(y, rotor_speed, generator_torque, inflow, induced, last, wake_thrust)
            elastic_equilibrium(s.system, y, c.integrator.inputs, c.integrator.work, s.azimuth_q, s.azimuth_u,
                                _balances_forces(c.models.fidelity), accelerations=accelerations)  # fmt: skip

    def _balance_air(
        self,
        y: NDArray[np.float64],
        rotor_speed: float,
        generator_torque: float | None,
        inflow: Inflow,
        induced: float | None,
        last: bool,
        wake_thrust: float | None,
    ) -> float:
        """Wake and loads for a state of the structure, and the generator under them; returns what the wake induces."""
        c = self._balanced
        s, lattice, x = c.models.structure, c.models.lattice, c.exchange
        inputs, work = c.integrator.inputs, c.integrator.work
        c.move_lattice(y)
        axis = work.rot[s.hub, :, 0].copy()
        wind = c.take_wind(inflow, 0.0)
        induced = lattice.initialize_helix(
            c.aero, x.nodes, x.velocities, wind, work.r[s.hub], axis, rotor_speed, c.models.time_step,
            passes=4 if induced is None else 1, induced=induced, accept=last, wake_thrust=wake_thrust,
        )  # fmt: skip
        loads = inputs.body_loads[1]
        coupling_kernels.rotor_loads(
            c.blade_forces, work.rot, x.elastic, x.points, x.lattice_bodies, x.sub_bodies, loads
        )
        coupling_kernels.tower_drag(y, s.system.tree, work, x.tower, loads[s.tower])
        inputs.body_loads[0] = loads
        _, moment = coupling_kernels.rotor_resultant(c.blade_nodes, c.blade_forces, work.r[s.hub], axis)
        self.drives.load(moment, rotor_speed, generator_torque)
        self._act(c)
        return induced


def _balances_forces(fidelity: Fidelity) -> bool:
    """Whether forces are balanced: accelerations of light nodes would dominate the residual of a bent beam."""
    nodal = "nodal" in (fidelity.blade_coordinates, fidelity.tower_coordinates)
    return nodal or not INTEGRATORS[fidelity.integrator].explicit
