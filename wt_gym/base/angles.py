"""Angles on the circle: what is filtered, averaged or differenced across the place where they wrap around."""

import math


def wrapped(angle: float) -> float:
    """The same direction within [-π, π) [rad]."""
    return angle - 2.0 * math.pi * math.floor(angle / (2.0 * math.pi) + 0.5)
