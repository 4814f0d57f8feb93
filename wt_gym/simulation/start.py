"""The start of a simulation: turbine, wake and generator in balance with each other."""

from wt_gym.simulation import coupling_kernels
from wt_gym.simulation.coupling import Coupling
from wt_gym.simulation.equilibrium import elastic_equilibrium

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

    def __init__(self, coupling, drives):
        self.coupling, self.drives = coupling, drives
        embedded = coupling.models.embedded
        self._balanced = coupling if embedded is None else Coupling(embedded)

    def balance(self, rotor_speed, azimuth, generator_torque, inflow):
        """Balance turbine, wake and air, and begin to move; pitch and yaw are those that the drives have started with.

        Parameters
        ----------
        rotor_speed, azimuth : float
            [rad/s], [rad].
        generator_torque : float or None
            High-speed shaft [N m]; None: what balances the torque of the air.
        inflow : Inflow

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
        self._find_equilibrium(y, rotor_speed, generator_torque, inflow)
        if balanced is not coupling:
            y = coupling.models.structure.adopt(balanced.models.structure, y)
            coupling.aero.assign(balanced.aero)
            coupling.integrator.inputs.body_loads[:] = balanced.integrator.inputs.body_loads
            self._act(coupling)
        coupling.begin(y)

    def _act(self, coupling):
        self.drives.act(coupling.integrator.inputs, coupling.models.structure.azimuth_u, first=0)

    def _rigid_state(self, rotor_speed, azimuth):
        """Undeformed turbine turning steadily."""
        s = self._balanced.models.structure
        y, n_y = s.system.initial_state(), s.system.n_q + s.system.n_u
        y[s.azimuth_q], y[s.system.n_q + s.azimuth_u] = azimuth, rotor_speed
        y[n_y : n_y + s.system.n_servo] = self.drives.command[1:]
        return y

    def _find_equilibrium(self, y, rotor_speed, generator_torque, inflow):
        """Wake, loads and elastic state (y, in place) in balance with each other and the generator."""
        c = self._balanced
        s, lattice, x = c.models.structure, c.models.lattice, c.exchange
        inputs, work = c.integrator.inputs, c.integrator.work
        induced = None
        for k in range(PASSES):
            c.move_lattice(y)
            axis = work.rot[s.hub, :, 0].copy()
            wind = c.take_wind(inflow, 0.0)
            induced = lattice.initialise_helix(
                c.aero, x.nodes, x.velocities, wind, work.r[s.hub], axis, rotor_speed, c.models.time_step,
                passes=4 if induced is None else 1, induced=induced, accept=k == PASSES - 1,
            )  # fmt: skip
            loads = inputs.body_loads[1]
            coupling_kernels.rotor_loads(c.blade_forces, work.rot, x.elastic, x.points, x.carriers, x.pieces, loads)
            coupling_kernels.tower_drag(y, s.system.tree, work, x.tower, loads[s.tower])
            inputs.body_loads[0] = loads
            _, moment = coupling_kernels.rotor_resultant(c.blade_nodes, c.blade_forces, work.r[s.hub], axis)
            self.drives.load(moment, rotor_speed, generator_torque)
            self._act(c)
            elastic_equilibrium(s.system, y, inputs, work, s.azimuth_q, s.azimuth_u,
                                _balances_forces(c.models.fidelity))  # fmt: skip


def _balances_forces(fidelity):
    """Whether forces are balanced and not accelerations, in which those of small nodes outshout a bent beam."""
    nodal = "nodal" in (fidelity.blade_coordinates, fidelity.tower_coordinates)
    return nodal or fidelity.integrator != "hamming"
