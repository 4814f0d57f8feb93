"""The lift of attached flow in a static polar: angle of zero lift and lift slope."""

import numpy as np
from numpy.typing import ArrayLike

ZERO_LIFT_RANGE = np.radians(20.0)
"""Largest angle of zero lift of a section [rad]."""
SLOPE_RANGE = np.radians([2.0, 15.0])
"""Distances from the angle of zero lift between which the slope is sought [rad]; nearer, a table's noise rules."""


def attached_lift(alpha: ArrayLike, cl: ArrayLike) -> tuple[float, float] | None:
    """Angle of zero lift and lift slope of the attached flow.

    The slope is the largest secant through the point of zero lift: no line through that point with this slope lies
    below the polar, as the separation point of Kirchhoff's flow needs (Hansen, Gaunaa & Madsen, Risoe-R-1354, 2004).

    Parameters
    ----------
    alpha : array_like, shape (n,)
        Ascending angles of attack [rad].
    cl : array_like, shape (n,)
        Lift coefficients.

    Returns
    -------
    (alpha0, slope) : tuple of float or None
        [rad], [1/rad]; None for a section without lift, such as a cylinder.
    """
    alpha, cl = np.asarray(alpha, dtype=np.float64), np.asarray(cl, dtype=np.float64)
    rising = np.flatnonzero((cl[:-1] < 0.0) & (cl[1:] >= 0.0) & (np.abs(alpha[1:]) < ZERO_LIFT_RANGE))
    if not rising.size:
        return None
    i = rising[np.argmin(np.abs(alpha[rising]))]
    alpha0 = float(alpha[i] - cl[i] * (alpha[i + 1] - alpha[i]) / (cl[i + 1] - cl[i]))
    arm = alpha - alpha0
    linear = (arm >= SLOPE_RANGE[0]) & (arm <= SLOPE_RANGE[1])
    if not np.any(linear):
        return None
    slope = float(np.max(cl[linear] / arm[linear]))
    return (alpha0, slope) if slope > 0.0 else None
