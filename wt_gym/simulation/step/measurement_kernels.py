"""From the state of the coupled system to the signals an engineer reads: the end of the compiled step.

What laws written in Python know, the torque and the commands, is filled in after it (`measure_rest`).
"""

import math

from wt_gym.base.compiled import kernel
from wt_gym.simulation.step.coupling_kernels import read_gauges, rotor_resultant

SINGLE = (
    "wind_x", "rotor_speed", "azimuth", "generator_speed", "generator_torque", "generator_power", "aero_power",
    "aero_torque", "aero_thrust", "yaw", "yaw_rate", "yaw_error", "tower_top_fore_aft", "tower_top_side_side",
    "tower_base_fore_aft_moment", "tower_base_side_side_moment", "tower_base_torsion", "nacelle_acceleration_fore_aft",
    "nacelle_acceleration_side_side", "shaft_torque", "rotor_thrust", "rotor_speed_max", "tower_base_moment_max",
    "tower_top_x", "tower_top_y", "tower_base_moment_x", "tower_base_moment_y",
)  # fmt: skip
PER_BLADE = (
    "pitch", "pitch_rate", "pitch_command", "tip_out_of_plane", "tip_in_plane", "root_flap_moment", "root_edge_moment",
    "root_torsion", "tip_clearance", "tip_clearance_min", "tip_out_of_plane_max", "root_flap_moment_max",
    "pitch_travel",
)  # fmt: skip
(
    WIND_X, ROTOR_SPEED, AZIMUTH, GENERATOR_SPEED, GENERATOR_TORQUE, GENERATOR_POWER, AERO_POWER,
    AERO_TORQUE, AERO_THRUST, YAW, YAW_RATE, YAW_ERROR, TOWER_TOP_FORE_AFT, TOWER_TOP_SIDE_SIDE,
    TOWER_BASE_FORE_AFT, TOWER_BASE_SIDE_SIDE, TOWER_BASE_TORSION, ACCELERATION_FORE_AFT,
    ACCELERATION_SIDE_SIDE, SHAFT_TORQUE, ROTOR_THRUST, ROTOR_SPEED_MAX, TOWER_BASE_MAX,
    TOWER_TOP_X, TOWER_TOP_Y, TOWER_BASE_X, TOWER_BASE_Y,
    PITCH, PITCH_RATE, PITCH_COMMAND, TIP_OUT_OF_PLANE, TIP_IN_PLANE, ROOT_FLAP, ROOT_EDGE,
    ROOT_TORSION, TIP_CLEARANCE, TIP_CLEARANCE_MIN, TIP_OUT_OF_PLANE_MAX, ROOT_FLAP_MAX, PITCH_TRAVEL,
) = range(len(SINGLE) + len(PER_BLADE))  # fmt: skip
"""Places in the array ``at``; what stands there is the place of the channel, or of that of blade 1, in the signals."""


@kernel(fastmath=False)
def measure(y, dy, body_loads, nodes, forces, tree, work, g):
    """Read the gauges and fill the channels, see `fill_channels`; the kinematics are brought up to date.

    Parameters
    ----------
    y, dy, body_loads, nodes, forces
        See `measurement.MeasuredState`.
    tree, work : arrays of the multibody system
    g : Gauges
    """
    read_gauges(y, dy, body_loads, tree, work, g)
    fill_channels(y, nodes, forces, tree, work, g)


@kernel(separate=True, fastmath=False)
def fill_channels(y, nodes, forces, tree, work, g):
    """Fill the channels but those of `measure_rest`, those of extremes with the present values.

    Kinematics and gauges are up to date; arguments as for `measure`.
    """
    n_y, indices, values, at = tree.n_q + tree.n_u, g.indices, g.values, g.at
    _rotor(y, g, indices, values, at)
    thrust, moment = rotor_resultant(nodes, forces, work.r[g.hub], work.rot[g.hub, :, 0])
    values[at[AERO_THRUST]], values[at[AERO_TORQUE]] = thrust, moment
    values[at[AERO_POWER]] = moment * values[at[ROTOR_SPEED]]
    yaw, rate = y[n_y], y[n_y + tree.n_servo]
    if indices.yaw_q >= 0:
        yaw, rate = yaw + y[indices.yaw_q], rate + y[indices.yaw_u]
    values[at[YAW]], values[at[YAW_RATE]] = yaw, rate
    for c in range(3):
        values[at[WIND_X] + c] = g.hub_wind[c]
    error = math.atan2(g.hub_wind[1], g.hub_wind[0]) - yaw
    if g.tower_moves:
        base = work.rot[indices.tower]
        error -= math.atan2(base[1, 0], base[0, 0])
    values[at[YAW_ERROR]] = error - 2.0 * math.pi * math.floor(error / (2.0 * math.pi) + 0.5)
    _tower(work, g, indices, values, at)
    _blades(y, n_y, tree.n_servo, g, values, at)


@kernel(fastmath=False)
def measure_rest(time, torque, efficiency, command, values, at):
    """Fill in what the compiled step does not know.

    Parameters
    ----------
    time : float
        [s].
    torque : float
        Of the generator [N m, high-speed shaft].
    efficiency : float
        Of the generator.
    command : (2 + n_blades,)
        Of the drives: generator torque [N m], yaw and pitch [rad].
    values : (n_channels,)
    at : int64 (n,)
        Where the channels stand in it, in the order of `SINGLE` and `PER_BLADE`.
    """
    values[0] = time
    values[at[GENERATOR_TORQUE]] = torque
    values[at[GENERATOR_POWER]] = values[at[GENERATOR_SPEED]] * torque * efficiency
    for i in range(command.shape[0] - 2):
        values[at[PITCH_COMMAND] + i] = command[2 + i]


@kernel(fastmath=False)
def _rotor(y, g, indices, values, at):
    """Speeds and what the shaft bears."""
    generator_speed, azimuth = y[indices.azimuth_u], y[indices.azimuth_q]
    speed = generator_speed
    if indices.torsion_q >= 0:
        azimuth, speed = azimuth + y[indices.torsion_q], speed + y[indices.torsion_u]
    values[at[ROTOR_SPEED]] = values[at[ROTOR_SPEED_MAX]] = speed
    values[at[AZIMUTH]] = azimuth - 2.0 * math.pi * math.floor(azimuth / (2.0 * math.pi))
    values[at[GENERATOR_SPEED]] = generator_speed * indices.gear_ratio
    values[at[SHAFT_TORQUE]], values[at[ROTOR_THRUST]] = -g.wrench[g.hub, 3], -g.wrench[g.hub, 0]


@kernel(fastmath=False)
def _tower(work, g, indices, values, at):
    """Tower-top motion and tower-base loads: along axes of the base, and along and across the heading of the nacelle.

    The axes of the base are the global ones on the ground; on a floater they move with it, and displacements are those
    against it. The heading is the level part of the nacelle's x axis, seen from the base. With the unit vectors f along
    it and s to its left the displacement d has the components d·f and d·s, and the moment M the components M·s (a push
    along f bends the tower about s) and M·f.
    """
    base, axis = g.wrench[indices.tower], work.rot[g.nacelle, :, 0]
    x, y, moment_x, moment_y = work.r[g.nacelle, 0], work.r[g.nacelle, 1], -base[3], -base[4]
    ahead, aside = axis[0], axis[1]
    if g.tower_moves:
        x, y, ahead, aside = 0.0, 0.0, 0.0, 0.0
        foot, turn = work.r[indices.tower], work.rot[indices.tower]
        for i in range(3):
            x += turn[i, 0] * (work.r[g.nacelle, i] - foot[i])
            y += turn[i, 1] * (work.r[g.nacelle, i] - foot[i])
            ahead += turn[i, 0] * axis[i]
            aside += turn[i, 1] * axis[i]
    level = 1.0 / math.hypot(ahead, aside)
    cos, sin = ahead * level, aside * level
    values[at[TOWER_TOP_X]], values[at[TOWER_TOP_Y]] = x, y
    values[at[TOWER_BASE_X]], values[at[TOWER_BASE_Y]] = moment_x, moment_y
    values[at[TOWER_TOP_FORE_AFT]], values[at[TOWER_TOP_SIDE_SIDE]] = cos * x + sin * y, cos * y - sin * x
    values[at[TOWER_BASE_FORE_AFT]] = cos * moment_y - sin * moment_x
    values[at[TOWER_BASE_SIDE_SIDE]] = cos * moment_x + sin * moment_y
    values[at[TOWER_BASE_TORSION]] = -base[5]
    values[at[TOWER_BASE_MAX]] = math.hypot(base[4], base[3])
    values[at[ACCELERATION_FORE_AFT]] = g.nacelle_acceleration[0]
    values[at[ACCELERATION_SIDE_SIDE]] = g.nacelle_acceleration[1]


@kernel(fastmath=False)
def _blades(y, n_y, n_servo, g, values, at):
    """Pitch, tip deflections, root moments and clearances."""
    for i in range(g.blades.shape[0]):
        root = g.wrench[g.blades[i]]
        # the yaw drive is the first servo, the pitch drives follow
        values[at[PITCH] + i], values[at[PITCH_RATE] + i] = y[n_y + 1 + i], y[n_y + n_servo + 1 + i]
        values[at[TIP_OUT_OF_PLANE] + i] = values[at[TIP_OUT_OF_PLANE_MAX] + i] = g.deflection[i, 0]
        values[at[TIP_IN_PLANE] + i] = g.deflection[i, 1]
        values[at[ROOT_EDGE] + i], values[at[ROOT_FLAP] + i] = -root[3], -root[4]
        values[at[ROOT_TORSION] + i], values[at[ROOT_FLAP_MAX] + i] = -root[5], abs(root[4])
        values[at[TIP_CLEARANCE] + i] = values[at[TIP_CLEARANCE_MIN] + i] = g.clearance[i]
        values[at[PITCH_TRAVEL] + i] = 0.0


@kernel(fastmath=False)
def measure_extremes(extremes, values, at):
    """Fill the channels of extremes and ways with what a monitor has seen; extremes: `Extremes`."""
    values[at[ROTOR_SPEED_MAX]] = extremes.rotor_speed_max[0]
    values[at[TOWER_BASE_MAX]] = extremes.tower_base_moment_max[0]
    for i in range(extremes.tip_clearance_min.shape[0]):
        values[at[TIP_CLEARANCE_MIN] + i] = extremes.tip_clearance_min[i]
        values[at[TIP_OUT_OF_PLANE_MAX] + i] = extremes.tip_out_of_plane_max[i]
        values[at[ROOT_FLAP_MAX] + i] = extremes.root_flap_moment_max[i]
        values[at[PITCH_TRAVEL] + i] = extremes.pitch_travel[i]
