"""Multi-blade (Coleman) coordinates: what the blades do together, seen from the frame that does not turn.

With the azimuth psi_b of blade b in the sense of rotation, zero when it points up,

    mean = sum(x_b) / n,   tilt = 2 / n sum(x_b cos psi_b),   yaw = 2 / n sum(x_b sin psi_b),

    x_b = mean + tilt cos psi_b + yaw sin psi_b,

each the inverse of the other for three blades (Coleman & Feingold, NACA TR 1351, 1958; Bossanyi, Wind Energ. 6 (2003)
119). A mean downwind force pushes all blades, tilt is more of it above than below, yaw more of it on the side of
positive psi: the right, looking downwind, of a clockwise rotor, the left of a counter-clockwise one.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import ArrayLike, NDArray

__all__ = [
    "FIXED_FRAME", "from_harmonic", "harmonic_of_blades", "to_blades", "to_fixed_frame", "to_harmonic",
]  # fmt: skip

FIXED_FRAME = ("mean", "tilt", "yaw")


def _directions(azimuth: float, n_blades: int) -> NDArray[np.float64]:
    """One, cosine and sine of the azimuth of every blade, shape (3, n_blades), blade 1 at ``azimuth`` [rad]."""
    psi = [azimuth + 2.0 * math.pi / n_blades * b for b in range(n_blades)]
    return np.array([[1.0] * n_blades, [math.cos(p) for p in psi], [math.sin(p) for p in psi]])


def to_fixed_frame(values: ArrayLike, azimuth: float) -> NDArray[np.float64]:
    """Mean, tilt and yaw (..., 3) of a value of every blade (..., n_blades), blade 1 at ``azimuth`` [rad]."""
    values = np.asarray(values, dtype=np.float64)
    n_blades = values.shape[-1]
    out: NDArray[np.float64] = (values[..., None, :] * _directions(azimuth, n_blades)).sum(axis=-1) * (
        np.array([1.0, 2.0, 2.0]) / n_blades
    )
    return out


def to_blades(coordinates: Sequence[float] | NDArray[np.float64], azimuth: float, n_blades: int) -> list[float]:
    """Value of every blade from mean, tilt and yaw, blade 1 at ``azimuth`` [rad]."""
    mean, tilt, yaw = coordinates
    return [mean + change for change in harmonic_of_blades(tilt, yaw, azimuth, n_blades)]


def to_harmonic(
    values: Sequence[float] | NDArray[np.float64], azimuth: float, harmonic: int = 1
) -> tuple[float, float]:
    """Cosine (tilt) and sine (yaw) component of a quantity of the blades.

    ``2/B sum x_b cos(n psi_b)`` and ``2/B sum x_b sin(n psi_b)`` with ``psi_b = azimuth + 2 pi b / B``, b = 0 … B - 1.

    Parameters
    ----------
    values : array_like, shape (n_blades,)
    azimuth : float
        Of blade 1, zero when it points up [rad].
    harmonic : int
        n: 1 for loads once per revolution, 2 for twice.
    """
    # numbers one by one: arrays of three are slow
    n_blades, cosine, sine = len(values), 0.0, 0.0
    for b, value in enumerate(values):
        angle = harmonic * (azimuth + 2.0 * math.pi * b / n_blades)
        cosine += value * math.cos(angle)
        sine += value * math.sin(angle)
    return 2.0 / n_blades * cosine, 2.0 / n_blades * sine


def from_harmonic(tilt: float, yaw: float, azimuth: float, n_blades: int = 3, harmonic: int = 1) -> NDArray[np.float64]:
    """Values of the blades ``tilt cos(n psi_b) + yaw sin(n psi_b)``, shape (n_blades,); see `to_harmonic`."""
    return np.array(harmonic_of_blades(tilt, yaw, azimuth, n_blades, harmonic))


def harmonic_of_blades(tilt: float, yaw: float, azimuth: float, n_blades: int, harmonic: int = 1) -> list[float]:
    """The same as a list, for callers that use numbers one by one."""
    angles = [harmonic * (azimuth + 2.0 * math.pi * b / n_blades) for b in range(n_blades)]
    return [tilt * math.cos(angle) + yaw * math.sin(angle) for angle in angles]
