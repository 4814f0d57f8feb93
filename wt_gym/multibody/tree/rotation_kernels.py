"""Compiled rotations in space: rotation vectors, their rates, quaternions."""

import math

from wt_gym.base.compiled import kernel


@kernel
def rotation_exp(t, rot, tangent):
    """Rotation exp(t̃) and the tangent T with ω = T ṫ (both in the frame before the rotation)."""
    a2 = t[0] * t[0] + t[1] * t[1] + t[2] * t[2]
    if a2 > 1e-8:
        a = math.sqrt(a2)
        s, c = math.sin(a) / a, (1.0 - math.cos(a)) / a2
        d = (1.0 - s) / a2
    else:
        s, c, d = 1.0 - a2 / 6.0, 0.5 - a2 / 24.0, 1.0 / 6.0 - a2 / 120.0
    for i in range(3):
        for j in range(3):
            outer = t[i] * t[j]
            rot[i, j] = c * outer
            tangent[i, j] = d * outer
        rot[i, i] += 1.0 - c * a2
        tangent[i, i] += 1.0 - d * a2
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        rot[i, j] -= s * t[k]
        rot[j, i] += s * t[k]
        tangent[i, j] -= c * t[k]
        tangent[j, i] += c * t[k]


@kernel
def tangent_bias(t, td, out):
    """Angular acceleration Ṫ ṫ of a rotation vector t that moves with constant rate ṫ.

    With T = 1 + c t̃ + d t̃²: Ṫ ṫ = ċ t × ṫ + ḋ t × (t × ṫ) + d ṫ × (t × ṫ).
    """
    a2 = t[0] * t[0] + t[1] * t[1] + t[2] * t[2]
    if a2 > 1e-2:
        a = math.sqrt(a2)
        d = (a - math.sin(a)) / (a2 * a)
        c_slope = (0.5 * a * math.sin(a) - 1.0 + math.cos(a)) / (a2 * a2)
        d_slope = 0.5 * ((1.0 - math.cos(a)) / a2 - 3.0 * d) / a2
    else:
        d = 1.0 / 6.0 - a2 / 120.0 + a2 * a2 / 5040.0
        c_slope = -1.0 / 24.0 + a2 / 360.0 - a2 * a2 / 13440.0
        d_slope = -1.0 / 120.0 + a2 / 2520.0 - a2 * a2 / 120960.0
    twice = 2.0 * (t[0] * td[0] + t[1] * td[1] + t[2] * td[2])
    c0 = t[1] * td[2] - t[2] * td[1]
    c1 = t[2] * td[0] - t[0] * td[2]
    c2 = t[0] * td[1] - t[1] * td[0]
    e0 = twice * d_slope * t[0] + d * td[0]
    e1 = twice * d_slope * t[1] + d * td[1]
    e2 = twice * d_slope * t[2] + d * td[2]
    out[0] = twice * c_slope * c0 + e1 * c2 - e2 * c1
    out[1] = twice * c_slope * c1 + e2 * c0 - e0 * c2
    out[2] = twice * c_slope * c2 + e0 * c1 - e1 * c0


@kernel
def quaternion_rotation(q, rot):
    """Rotation matrix of a scalar-first quaternion; divides by |q|² so that drift of the norm does no harm."""
    w, x, y, z = q[0], q[1], q[2], q[3]
    n = 2.0 / (w * w + x * x + y * y + z * z)
    rot[0, 0] = 1.0 - n * (y * y + z * z)
    rot[0, 1] = n * (x * y - w * z)
    rot[0, 2] = n * (x * z + w * y)
    rot[1, 0] = n * (x * y + w * z)
    rot[1, 1] = 1.0 - n * (x * x + z * z)
    rot[1, 2] = n * (y * z - w * x)
    rot[2, 0] = n * (x * z - w * y)
    rot[2, 1] = n * (y * z + w * x)
    rot[2, 2] = 1.0 - n * (x * x + y * y)


@kernel
def cross_add(a, b, out):
    """Out += a × b."""
    out[0] += a[1] * b[2] - a[2] * b[1]
    out[1] += a[2] * b[0] - a[0] * b[2]
    out[2] += a[0] * b[1] - a[1] * b[0]


@kernel
def cardan_rotation(angles, rot):
    """Rotation R_z(ψ) R_y(θ) R_x(φ) by roll φ, pitch θ and yaw ψ, ``angles`` (3,) [rad]."""
    cr, sr = math.cos(angles[0]), math.sin(angles[0])
    cp, sp = math.cos(angles[1]), math.sin(angles[1])
    cy, sy = math.cos(angles[2]), math.sin(angles[2])
    rot[0, 0], rot[0, 1], rot[0, 2] = cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr
    rot[1, 0], rot[1, 1], rot[1, 2] = sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr
    rot[2, 0], rot[2, 1], rot[2, 2] = -sp, cp * sr, cp * cr
