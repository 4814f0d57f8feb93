"""Compiled loads of the water on a rigid platform; the arrays are those of `wt_gym.hydrodynamics.loads`."""

import math

from wt_gym.base.compiled import kernel
from wt_gym.hydrodynamics.mooring_kernels import mooring_force


@kernel
def _circle(angle):
    """Cosine and sine, to 1e-15 of the angle and 1e-13; without branches, several times as fast as the C library.

    Taylor's series at a quarter of the angle within half a turn, doubled twice.
    """
    turns = angle * (0.5 / math.pi)
    x = (turns - math.floor(turns + 0.5)) * (0.5 * math.pi)
    y = x * x
    s = x * (
        1.0 - y / 6.0 * (1.0 - y / 20.0 * (1.0 - y / 42.0 * (1.0 - y / 72.0 * (1.0 - y / 110.0 * (1.0 - y / 156.0)))))
    )
    c = 1.0 - y / 2.0 * (1.0 - y / 12.0 * (1.0 - y / 30.0 * (1.0 - y / 56.0 * (1.0 - y / 90.0 * (1.0 - y / 132.0)))))
    s, c = 2.0 * s * c, 1.0 - 2.0 * s * s
    return 1.0 - 2.0 * s * s, 2.0 * s * c


@kernel
def _multiply(matrix, vector, out):
    """Set the product of a matrix and a vector, four rows at a time."""
    n_rows, n = matrix.shape
    whole = n_rows - n_rows % 4
    for r in range(0, whole, 4):
        a, b, c, d = 0.0, 0.0, 0.0, 0.0
        for k in range(n):
            x = vector[k]
            a += matrix[r, k] * x
            b += matrix[r + 1, k] * x
            c += matrix[r + 2, k] * x
            d += matrix[r + 3, k] * x
        out[r], out[r + 1], out[r + 2], out[r + 3] = a, b, c, d
    for r in range(whole, n_rows):
        a = 0.0
        for k in range(n):
            a += matrix[r, k] * vector[k]
        out[r] = a


@kernel
def water_motion(p, time):
    """Set excitation, elevation and velocity of the water at the drag points for a time [s].

    A direct sum over the components of the sea, exact at any time.
    """
    frequency, cosine, sine = p.wave_frequency, p.wave_cosine, p.wave_sine
    for c in range(frequency.shape[0]):
        cosine[c], sine[c] = _circle(frequency[c] * time)
    _multiply(p.wave_real, cosine, p.wave_value)
    _multiply(p.wave_imaginary, sine, p.wave_sum)
    for r in range(p.wave_value.shape[0]):
        p.wave_value[r] -= p.wave_sum[r]
    for i in range(6):
        p.excitation[i] = p.wave_value[i]
    p.elevation[0] = p.wave_value[6]
    n_points = p.water_velocity.shape[0]
    for k in range(n_points):
        for i in range(3):
            p.water_velocity[k, i] = p.current[i] + p.wave_value[7 + 3 * k + i]
    first = 7 + 3 * n_points
    if p.wave_value.shape[0] > first:  # slow drift
        for i in range(6):
            for half in range(4):
                root = p.wave_value[first + 6 * half + i]
                p.excitation[i] += root * root if half < 2 else -root * root


@kernel
def _static_loads(p, position, rotation, cosine, sine, yaw, out):
    """Add buoyancy and stiffness; the stiffness of the water acts in axes turned by the yaw.

    The tilt is the rotation vector of what is left of the rotation without its yaw. Its length is the angle between the
    axes z of sea and platform, so that equal stiffness in roll and pitch conserves energy at any angle.
    """
    n0 = cosine * rotation[0, 2] + sine * rotation[1, 2]
    n1 = cosine * rotation[1, 2] - sine * rotation[0, 2]
    across = math.sqrt(n0 * n0 + n1 * n1)
    factor = math.atan2(across, rotation[2, 2]) / across if across > 1e-9 else 1.0
    roll, pitch = -n1 * factor, n0 * factor
    q = p.displacement
    q[0] = cosine * position[0] + sine * position[1]
    q[1] = cosine * position[1] - sine * position[0]
    q[2], q[3], q[4], q[5] = position[2], roll, pitch, yaw
    f = p.local_force
    for i in range(6):
        total = 0.0
        for j in range(6):
            total -= p.hydrostatic[i, j] * q[j]
        f[i] = total
    f[2] += p.buoyancy[0]
    f[3] += p.buoyancy[0] * p.buoyancy[2]
    f[4] -= p.buoyancy[0] * p.buoyancy[1]
    _add_turned(f, cosine, sine, out)
    q[0], q[1] = position[0], position[1]
    q[3] = cosine * roll - sine * pitch
    q[4] = sine * roll + cosine * pitch
    for i in range(6):
        for j in range(6):
            out[i] -= p.additional_stiffness[i, j] * q[j]


@kernel
def _add_turned(f, cosine, sine, out):
    """Add force and moment in axes turned by the yaw to those in global axes."""
    for i in (0, 3):
        out[i] += cosine * f[i] - sine * f[i + 1]
        out[i + 1] += sine * f[i] + cosine * f[i + 1]
        out[i + 2] += f[i + 2]


@kernel
def _damping(p, velocity, omega, cosine, sine, out):
    """Add radiation, linear and quadratic damping in axes turned by the yaw.

    The states of the radiation at the end of the step are ``radiation_free`` + ``radiation_last`` u, u the velocity
    there; what does not depend on u is known since the last step.
    """
    u, f = p.velocity_candidate, p.local_force
    u[0] = cosine * velocity[0] + sine * velocity[1]
    u[1] = cosine * velocity[1] - sine * velocity[0]
    u[2] = velocity[2]
    u[3] = cosine * omega[0] + sine * omega[1]
    u[4] = cosine * omega[1] - sine * omega[0]
    u[5] = omega[2]
    for i in range(6):
        total = -p.radiation_force[i]
        for j in range(6):
            total -= (p.instant_damping[i, j] + p.quadratic_damping[i, j] * math.fabs(u[j])) * u[j]
        f[i] = total
    _add_turned(f, cosine, sine, out)


@kernel
def _drag(p, rotation, velocity, omega, out):
    """Add Morison's drag at the points, with the velocity of the water relative to the platform."""
    for k in range(p.point_position.shape[0]):
        b0, b1, b2 = p.point_position[k, 0], p.point_position[k, 1], p.point_position[k, 2]
        r0 = rotation[0, 0] * b0 + rotation[0, 1] * b1 + rotation[0, 2] * b2
        r1 = rotation[1, 0] * b0 + rotation[1, 1] * b1 + rotation[1, 2] * b2
        r2 = rotation[2, 0] * b0 + rotation[2, 1] * b1 + rotation[2, 2] * b2
        b0, b1, b2 = p.point_axis[k, 0], p.point_axis[k, 1], p.point_axis[k, 2]
        a0 = rotation[0, 0] * b0 + rotation[0, 1] * b1 + rotation[0, 2] * b2
        a1 = rotation[1, 0] * b0 + rotation[1, 1] * b1 + rotation[1, 2] * b2
        a2 = rotation[2, 0] * b0 + rotation[2, 1] * b1 + rotation[2, 2] * b2
        v0 = p.water_velocity[k, 0] - velocity[0] - omega[1] * r2 + omega[2] * r1
        v1 = p.water_velocity[k, 1] - velocity[1] - omega[2] * r0 + omega[0] * r2
        v2 = p.water_velocity[k, 2] - velocity[2] - omega[0] * r1 + omega[1] * r0
        axial = v0 * a0 + v1 * a1 + v2 * a2
        v0, v1, v2 = v0 - axial * a0, v1 - axial * a1, v2 - axial * a2
        across = p.point_across[k] * math.sqrt(v0 * v0 + v1 * v1 + v2 * v2)
        along = p.point_along[k] * math.fabs(axial) * axial
        f0, f1, f2 = across * v0 + along * a0, across * v1 + along * a1, across * v2 + along * a2
        out[0] += f0
        out[1] += f1
        out[2] += f2
        out[3] += r1 * f2 - r2 * f1
        out[4] += r2 * f0 - r0 * f2
        out[5] += r0 * f1 - r1 * f0


@kernel
def static_force(p, position, rotation, out):
    """Set force and moment of hydrostatics and lines; returns the code of `mooring_force`."""
    yaw = math.atan2(rotation[1, 0] - rotation[0, 1], rotation[0, 0] + rotation[1, 1])
    for i in range(6):
        out[i] = 0.0
    _static_loads(p, position, rotation, math.cos(yaw), math.sin(yaw), yaw, out)
    return mooring_force(p, position, rotation, out)


@kernel(separate=True)
def platform_force(p, position, rotation, velocity, omega, out):
    """Set force and moment of the water and the lines on a platform at the end of a step.

    Contains buoyancy, stiffness, lines, drag, damping, radiation and the excitation that `water_motion` has set, but
    neither weight nor the force of the added mass A(∞). It may be called several times in a step; `accept_step` ends
    the step.

    Parameters
    ----------
    p : PlatformArrays
    position : ndarray, shape (3,)
        Of the origin: the point at still water on the axis of the platform at rest [m].
    rotation : ndarray, shape (3, 3)
        From axes of the platform to global axes.
    velocity, omega : ndarray, shape (3,)
        Of the origin [m/s], of the body [rad/s], global axes.
    out : ndarray, shape (6,)
        Force [N] and moment about the displaced origin [N m] in global axes.

    Returns
    -------
    int
        0, or 1 where a line cannot be solved.
    """
    yaw = math.atan2(rotation[1, 0] - rotation[0, 1], rotation[0, 0] + rotation[1, 1])
    cosine, sine = math.cos(yaw), math.sin(yaw)
    for i in range(6):
        out[i] = p.excitation[i]
    _static_loads(p, position, rotation, cosine, sine, yaw, out)
    _damping(p, velocity, omega, cosine, sine, out)
    _drag(p, rotation, velocity, omega, out)
    return mooring_force(p, position, rotation, out)


@kernel
def accept_step(p):
    """Make the end of the last call of `platform_force` the start of the next step.

    The radiation advances exactly for a velocity that is linear within the step (first-order hold).
    """
    _multiply(p.radiation_last, p.velocity_candidate, p.radiation_state)
    for i in range(p.radiation_state.shape[0]):
        p.radiation_state[i] += p.radiation_free[i]
    advance_radiation(p)
    for k in range(p.line_unknown.shape[0]):
        p.line_unknown[k, 0] = p.line_candidate[k, 0]
        p.line_unknown[k, 1] = p.line_candidate[k, 1]


@kernel
def advance_radiation(p):
    """Set the part of states and force at the end of the next step that does not depend on the velocity there."""
    _multiply(p.radiation_first, p.velocity_candidate, p.radiation_sum)
    _multiply(p.radiation_transition, p.radiation_state, p.radiation_free)
    for i in range(p.radiation_state.shape[0]):
        p.radiation_free[i] += p.radiation_sum[i]
    _multiply(p.radiation_output, p.radiation_free, p.radiation_force)
