"""Types of arrays, constants, and angles on the circle."""

import math
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

Array: TypeAlias = NDArray[np.float64]
Integers: TypeAlias = NDArray[np.int64]

AIR_DENSITY = 1.225
"""At sea level in the standard atmosphere [kg/m³] (ISO 2533), where nothing else is given."""

DAY = 86400.0
"""Length of a day [s]."""

GRAVITY = 9.80665
"""Standard acceleration of free fall [m/s²] (3rd CGPM, 1901; ISO 80000-3), as in OpenFAST's model of the NREL 5-MW."""

MOTIONS = ("surge", "sway", "heave", "roll", "pitch", "yaw")
"""Of a body that moves freely, three along axes and three about them, in their order."""


def wrapped(angle: float) -> float:
    """The same direction within [-π, π) [rad], to filter, average or subtract angles where they wrap around."""
    return angle - 2.0 * math.pi * math.floor(angle / (2.0 * math.pi) + 0.5)
