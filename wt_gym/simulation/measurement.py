"""From the state of the coupled system to the signals an engineer reads."""

import math

import numpy as np

from wt_gym.simulation import coupling_kernels
from wt_gym.simulation.channels import new_values
from wt_gym.simulation.turbine_structure import rotation_x, rotation_y

__all__ = ["Measurement"]


class Measurement:
    """Channel values of one simulator.

    Parameters
    ----------
    turbine : Turbine
    structure : TurbineStructure

    Attributes
    ----------
    values : array (n_channels,)
        In the order of :func:`wt_gym.simulation.channels.channel_table`, as of the last :meth:`take`.
    """

    def __init__(self, turbine, structure):
        self.turbine, self.structure = turbine, structure
        n = turbine.n_blades
        self.values, self._at = new_values(n)
        self._blades = np.array(structure.blades)
        self._root_rotation = np.array(
            [rotation_x(2.0 * np.pi * i / n) @ rotation_y(-turbine.hub.cone) for i in range(n)]
        )
        base = np.array([0.0, 0.0, turbine.tower.base_height])
        self._tower = base, np.ascontiguousarray(structure.tower_points.position[:, 2]), structure.tower_radius
        self._tips, self._tip_velocity, self._deflection = np.zeros((n, 3)), np.zeros((n, 3)), np.zeros((n, 3))
        self._clearance, self._totals = np.zeros(n), np.zeros(5)
        self._wrench = np.zeros((len(structure.system.bodies), 6))

    def take(self, time, y, dy, body_loads, work, nodes, forces, command, inflow):
        """Fill ``values``.

        Parameters
        ----------
        time : float
            [s].
        y, dy : array (n_state,)
            State and its rate.
        body_loads : array (n_b, 6 + n_f)
            Aerodynamic loads of the bodies.
        work : Work
            Scratch of the system; its kinematics are brought up to date.
        nodes, forces : array (n_blades, n_points, 3)
            Lattice points [m] and forces of the air on them [N].
        command : array (2 + n_blades,)
            Generator torque [N m], yaw and pitch demands [rad] after rate limits.
        inflow : Inflow
        """
        s, v = self.structure, self.values
        system = s.system
        n_y = system.n_q + system.n_u
        work.servo_acceleration[:] = dy[n_y + system.n_servo :]
        rates = dy[system.n_q : n_y]
        coupling_kernels.observe(
            y, rates, body_loads, system.tree, work, s.hub, s.nacelle, self._blades, s.tip_points, nodes, forces,
            self._tower, self._root_rotation, y[n_y + 1 : n_y + 1 + len(self._blades)], self._wrench, self._tips,
            self._tip_velocity, self._deflection, self._clearance, self._totals,
        )  # fmt: skip
        v[0] = time
        self._rotor(y, command)
        self._wind_and_yaw(y, n_y, inflow.velocity(work.r[s.hub], time))
        self._tower_signals(work)
        self._blade_signals(y, n_y, command)

    def _rotor(self, y, command):
        """Speeds, torques and powers."""
        s, v, at, drive = self.structure, self.values, self._at, self.turbine.drivetrain
        generator_speed = speed = y[s.system.n_q + s.azimuth_u]
        azimuth = y[s.azimuth_q]
        if s.shaft_flexible:
            azimuth += y[s.system.index(s.hub, "joint_q")]
            speed += y[s.system.n_q + s.system.index(s.hub, "joint_u")]
        thrust, torque = self._totals[0], self._totals[1]
        v[at["rotor_speed"]] = speed
        v[at["azimuth"]] = azimuth % (2.0 * math.pi)
        v[at["generator_speed"]], v[at["generator_torque"]] = generator_speed * drive.gear_ratio, command[0]
        v[at["generator_power"]] = generator_speed * drive.gear_ratio * command[0] * drive.generator_efficiency
        v[at["aero_power"]], v[at["aero_torque"]], v[at["aero_thrust"]] = torque * speed, torque, thrust
        v[at["shaft_torque"]], v[at["rotor_thrust"]] = -self._wrench[s.hub, 3], -self._wrench[s.hub, 0]

    def _wind_and_yaw(self, y, n_y, wind):
        """Undisturbed wind at the hub against the nacelle."""
        v, at = self.values, self._at
        v[1:4] = wind
        v[at["yaw"]], v[at["yaw_rate"]] = y[n_y], y[n_y + self.structure.system.n_servo]
        v[at["yaw_error"]] = math.remainder(math.atan2(wind[1], wind[0]) - y[n_y], 2.0 * math.pi)

    def _tower_signals(self, work):
        """Tower-top motion and tower-base loads."""
        s, v, at = self.structure, self.values, self._at
        v[at["tower_top_fore_aft"]], v[at["tower_top_side_side"]] = work.r[s.nacelle, 0], work.r[s.nacelle, 1]
        base = self._wrench[s.tower]
        v[at["tower_base_fore_aft_moment"]], v[at["tower_base_side_side_moment"]] = -base[4], -base[3]
        v[at["tower_base_torsion"]] = -base[5]
        v[at["nacelle_acceleration_fore_aft"]] = self._totals[2]
        v[at["nacelle_acceleration_side_side"]] = self._totals[3]

    def _blade_signals(self, y, n_y, command):
        """Pitch, tip deflections, root moments and clearances."""
        s, v, at, n = self.structure, self.values, self._at, self.turbine.n_blades
        # the yaw drive is the first servo, the pitch drives follow
        pitch = y[n_y + 1 : n_y + 1 + n]
        rate = n_y + s.system.n_servo
        v[at["pitch"]], v[at["pitch_rate"]] = pitch, y[rate + 1 : rate + 1 + n]
        v[at["pitch_command"]] = command[2:]
        v[at["tip_out_of_plane"]], v[at["tip_in_plane"]] = self._deflection[:, 0], self._deflection[:, 1]
        roots = self._wrench[self._blades]
        v[at["root_edge_moment"]], v[at["root_flap_moment"]] = -roots[:, 3], -roots[:, 4]
        v[at["root_torsion"]], v[at["tip_clearance"]] = -roots[:, 5], self._clearance
