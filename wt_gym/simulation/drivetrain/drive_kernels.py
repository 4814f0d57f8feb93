"""Commands of the drives as inputs of the structure."""

from wt_gym.base.compiled import kernel


@kernel(fastmath=False)
def act(command, before, step, moment, ideal, azimuth_u, first, dof_force, servo_command, servo_rate, servo_interval):
    """Write all commands into the inputs of the structure (2, ...), at both ends of a step or at its end alone.

    Parameters
    ----------
    command : (2 + n_blades,)
        Generator torque, yaw and pitch [rad].
    before : (n_blades,)
        Pitch command one step ago [rad].
    step : float
        Length of the step since [s]; 0 at the start.
    moment : float
        With which the generator brakes the rotor [N m].
    ideal : bool
        Whether the pitch follows its command without a servo: then it lags half a step behind.
    azimuth_u : int
        The velocity of the generator.
    first : int
        0 for both ends, 1 for the end.
    dof_force, servo_command, servo_rate, servo_interval
        See `Inputs`; the yaw drive is the first servo, the pitch drives follow.
    """
    for end in range(first, 2):
        dof_force[end, azimuth_u] = -moment
        servo_command[end, 0] = command[1]
        for b in range(before.shape[0]):
            pitch = command[2 + b]
            servo_command[end, 1 + b] = pitch
            if ideal:
                rate = (pitch - before[b]) / step if step > 0.0 else 0.0
                servo_command[end, 1 + b] -= 0.5 * step * rate
                servo_rate[end, 1 + b] = rate
                servo_interval[0, 1 + b] = servo_interval[1, 1 + b] = step
