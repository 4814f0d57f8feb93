"""From the state of the coupled system to the signals an engineer reads."""

import math
from typing import NamedTuple

import numpy as np

from wt_gym.simulation import coupling_kernels
from wt_gym.simulation.channels import new_values
from wt_gym.simulation.turbine_structure import rotation_x, rotation_y

__all__ = ["Gauges", "Instant", "Measurement"]


class Gauges(NamedTuple):
    """Where a turbine is measured, and what was read there last."""

    hub: int  # body
    nacelle: int  # body
    blades: np.ndarray  # (n_blades,) bodies
    tip_points: tuple  # Points: the tip of a blade
    root_rotation: np.ndarray  # (n_blades, 3, 3) orientation of the unpitched blade roots in the hub
    tower_base: np.ndarray  # (3,) [m]
    tower_height: np.ndarray  # (n,) above the base [m]
    tower_radius: np.ndarray  # (n,) [m]
    wrench: np.ndarray  # (n_b, 6) forces and moments in the joints, body axes [N, N m]
    tips: np.ndarray  # (n_blades, 3) [m]
    tip_velocity: np.ndarray  # (n_blades, 3) [m/s]
    deflection: np.ndarray  # (n_blades, 3) of the tips, axes of the unpitched roots [m]
    tower_view: np.ndarray  # (n_blades, 4) of the tips, see coupling_kernels.view_from_tower [m]
    clearance: np.ndarray  # (n_blades,) signed distance of the tips from the tower [m]
    nacelle_acceleration: np.ndarray  # (3,) nacelle axes [m/s²]

    @classmethod
    def of(cls, turbine, structure):
        """Gauges of a turbine."""
        n, cone = turbine.n_blades, rotation_y(-turbine.hub.cone)
        return cls(
            hub=structure.hub, nacelle=structure.nacelle, blades=np.array(structure.blades),
            tip_points=structure.tip_points,
            root_rotation=np.array([rotation_x(2.0 * np.pi * i / n) @ cone for i in range(n)]),
            tower_base=np.array([0.0, 0.0, turbine.tower.base_height]),
            tower_height=np.ascontiguousarray(structure.tower_points.position[:, 2]),
            tower_radius=structure.tower_radius, wrench=np.zeros((len(structure.system.bodies), 6)),
            tips=np.zeros((n, 3)), tip_velocity=np.zeros((n, 3)), deflection=np.zeros((n, 3)),
            tower_view=np.zeros((n, 4)), clearance=np.zeros(n), nacelle_acceleration=np.zeros(3),
        )  # fmt: skip


class Instant(NamedTuple):
    """What is measured: structure and air at one time."""

    y: np.ndarray  # (n_state,) state of the structure
    dy: np.ndarray  # (n_state,) its rate
    body_loads: np.ndarray  # (n_b, 6 + n_f) loads of the air on the bodies
    work: tuple  # Work: scratch of the system
    nodes: np.ndarray  # (n_blades, n_points, 3) lattice points [m]
    forces: np.ndarray  # the same, forces of the air on them [N]


class Measurement:
    """Channel values of one simulator.

    Parameters
    ----------
    turbine : Turbine
    structure : TurbineStructure

    Attributes
    ----------
    gauges : Gauges
    values : array (n_channels,)
        In the order of :func:`wt_gym.simulation.channels.channel_table`, as of the last :meth:`take`.
    """

    def __init__(self, turbine, structure):
        self.turbine, self.structure = turbine, structure
        self.gauges = Gauges.of(turbine, structure)
        self.values, self._at = new_values(turbine.n_blades)

    def take(self, time, instant, torque, command, inflow, extremes=None):
        """Fill ``values``; the kinematics of the system are brought up to date.

        Parameters
        ----------
        time : float
            [s].
        instant : Instant
        torque : float
            Of the generator [N m, high-speed shaft].
        command : array (2 + n_blades,)
            Of the drives: generator torque [N m], yaw and pitch [rad].
        inflow : Inflow
        extremes : Extremes, optional
            Since the last sample; by default the present values.
        """
        s, work, y = self.structure, instant.work, instant.y
        n_y = s.system.n_q + s.system.n_u
        coupling_kernels.read_gauges(y, instant.dy, instant.body_loads, s.system.tree, work, self.gauges)
        self.values[0] = time
        self._rotor(y, torque)
        self._air(instant)
        self._wind_and_yaw(y, n_y, inflow.velocity(work.r[s.hub], time))
        self._tower_signals(work)
        self._blade_signals(y, n_y, command)
        self._extremes(extremes)

    def _rotor(self, y, torque):
        """Speeds, torques and electrical power."""
        s, v, at, drive = self.structure, self.values, self._at, self.turbine.drivetrain
        generator_speed = speed = y[s.system.n_q + s.azimuth_u]
        azimuth = y[s.azimuth_q]
        if s.shaft_flexible:
            azimuth += y[s.system.index(s.hub, "joint_q")]
            speed += y[s.system.n_q + s.system.index(s.hub, "joint_u")]
        v[at["rotor_speed"]] = speed
        v[at["azimuth"]] = azimuth % (2.0 * math.pi)
        v[at["generator_speed"]], v[at["generator_torque"]] = generator_speed * drive.gear_ratio, torque
        v[at["generator_power"]] = generator_speed * drive.gear_ratio * torque * drive.generator_efficiency
        shaft = self.gauges.wrench[s.hub]
        v[at["shaft_torque"]], v[at["rotor_thrust"]] = -shaft[3], -shaft[0]

    def _air(self, instant):
        """Thrust, torque and power of the air."""
        v, at, hub = self.values, self._at, self.structure.hub
        centre, axis = instant.work.r[hub], instant.work.rot[hub, :, 0]
        thrust, torque = coupling_kernels.rotor_resultant(instant.nodes, instant.forces, centre, axis)
        v[at["aero_thrust"]], v[at["aero_torque"]] = thrust, torque
        v[at["aero_power"]] = torque * v[at["rotor_speed"]]

    def _wind_and_yaw(self, y, n_y, wind):
        """Angle of the nacelle against the tower top, and the undisturbed wind at the hub against it."""
        s, v, at = self.structure, self.values, self._at
        yaw, rate = y[n_y], y[n_y + s.system.n_servo]
        if s.yaw_flexible:
            yaw += y[s.system.index(s.nacelle, "joint_q")]
            rate += y[s.system.n_q + s.system.index(s.nacelle, "joint_u")]
        v[1:4] = wind
        v[at["yaw"]], v[at["yaw_rate"]] = yaw, rate
        v[at["yaw_error"]] = math.remainder(math.atan2(wind[1], wind[0]) - yaw, 2.0 * math.pi)

    def _tower_signals(self, work):
        """Tower-top motion and tower-base loads."""
        s, v, at = self.structure, self.values, self._at
        v[at["tower_top_fore_aft"]], v[at["tower_top_side_side"]] = work.r[s.nacelle, 0], work.r[s.nacelle, 1]
        base, acceleration = self.gauges.wrench[s.tower], self.gauges.nacelle_acceleration
        v[at["tower_base_fore_aft_moment"]], v[at["tower_base_side_side_moment"]] = -base[4], -base[3]
        v[at["tower_base_torsion"]] = -base[5]
        v[at["nacelle_acceleration_fore_aft"]] = acceleration[0]
        v[at["nacelle_acceleration_side_side"]] = acceleration[1]

    def _blade_signals(self, y, n_y, command):
        """Pitch, tip deflections, root moments and clearances."""
        s, v, at, n = self.structure, self.values, self._at, self.turbine.n_blades
        # the yaw drive is the first servo, the pitch drives follow
        pitch = y[n_y + 1 : n_y + 1 + n]
        rate = n_y + s.system.n_servo
        v[at["pitch"]], v[at["pitch_rate"]] = pitch, y[rate + 1 : rate + 1 + n]
        v[at["pitch_command"]] = command[2:]
        v[at["tip_out_of_plane"]], v[at["tip_in_plane"]] = self.gauges.deflection[:, :2].T
        roots = self.gauges.wrench[self.gauges.blades]
        v[at["root_edge_moment"]], v[at["root_flap_moment"]] = -roots[:, 3], -roots[:, 4]
        v[at["root_torsion"]], v[at["tip_clearance"]] = -roots[:, 5], self.gauges.clearance

    def _extremes(self, extremes):
        """Largest and smallest values since the last sample."""
        v, at = self.values, self._at
        if extremes is None:
            base = math.hypot(v[at["tower_base_fore_aft_moment"]], v[at["tower_base_side_side_moment"]])
            v[at["rotor_speed_max"]], v[at["tower_base_moment_max"]] = v[at["rotor_speed"]], base
            v[at["root_flap_moment_max"]] = np.abs(v[at["root_flap_moment"]])
            v[at["tip_out_of_plane_max"]] = v[at["tip_out_of_plane"]]
            v[at["tip_clearance_min"]] = v[at["tip_clearance"]]
            return
        for name, value in extremes._asdict().items():
            v[at[name]] = value if len(value) > 1 or isinstance(at[name], slice) else value[0]
