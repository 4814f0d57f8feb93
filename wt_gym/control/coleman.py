"""Multi-blade (Coleman) coordinates: what the blades do together, seen from the frame that does not turn.

With the azimuth psi_b of blade b, zero when it points up,

    mean = sum(x_b) / n,   tilt = 2 / n sum(x_b cos psi_b),   yaw = 2 / n sum(x_b sin psi_b),

    x_b = mean + tilt cos psi_b + yaw sin psi_b,

each the inverse of the other for three blades (Coleman & Feingold, NACA TR 1351, 1958; Bossanyi, Wind Energ. 6 (2003)
119). A mean downwind force pushes all blades, tilt is more of it above than below, yaw more of it on the side of
positive psi.
"""

import math

import numpy as np

__all__ = ["FIXED_FRAME", "directions", "to_blades", "to_fixed_frame"]

FIXED_FRAME = ("mean", "tilt", "yaw")


def directions(azimuth: float, n_blades: int) -> np.ndarray:
    """One, cosine and sine of the azimuth of every blade (3, n_blades), blade 1 at ``azimuth`` [rad]."""
    # numbers one by one: arrays of three are slow
    psi = [azimuth + 2.0 * math.pi / n_blades * b for b in range(n_blades)]
    return np.array([[1.0] * n_blades, [math.cos(p) for p in psi], [math.sin(p) for p in psi]])


def to_fixed_frame(values, azimuth: float) -> np.ndarray:
    """Mean, tilt and yaw (..., 3) of a value of every blade (..., n_blades), blade 1 at ``azimuth`` [rad]."""
    values = np.asarray(values, dtype=np.float64)
    n_blades = values.shape[-1]
    return values @ directions(azimuth, n_blades).T * (np.array([1.0, 2.0, 2.0]) / n_blades)


def to_blades(coordinates, azimuth: float, n_blades: int) -> np.ndarray:
    """Value of every blade (..., n_blades) from mean, tilt and yaw (..., 3), blade 1 at ``azimuth`` [rad]."""
    return np.asarray(coordinates, dtype=np.float64) @ directions(azimuth, n_blades)
