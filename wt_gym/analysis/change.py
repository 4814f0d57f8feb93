"""Change of a metric against a reference: a share of it, or a difference where no share makes sense."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from wt_gym.analysis.metrics import METRICS

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

__all__ = ["difference", "is_relative", "relative_change"]

_NEVER_RELATIVE = ("overspeed_count", "tip_clearance_min")
"""Counts, and margins with a sign: a clearance from 0.1 to 0.3 m is 0.2 m more, not 200 %."""


def is_relative(key: str, reference: ArrayLike) -> bool:
    """Return True if changes of a metric against some references are shares of these.

    They are, unless the metric is a count or a margin with a sign, or a reference rounds to zero in the unit shown.

    Parameters
    ----------
    key : str
        Of `wt_gym.analysis.metrics.METRICS`.
    reference : array_like
        SI unit.
    """
    metric = METRICS[key]
    return key not in _NEVER_RELATIVE and bool(np.all(np.abs(reference) * metric.factor >= 10.0**-metric.digits))


def relative_change(value: ArrayLike, reference: ArrayLike) -> Any:
    """Difference over the size of the reference [-]; more is more where the reference is negative, too.

    Parameters
    ----------
    value, reference : array_like
        Of one shape, or one of them a number.

    Returns
    -------
    numpy.ndarray or float
        NaN where the reference is zero, unless the value is zero as well: nothing has changed then.
    """
    difference = np.subtract(value, reference, dtype=float)
    size = np.abs(np.broadcast_to(np.asarray(reference, dtype=float), difference.shape))
    share = np.full(difference.shape, np.nan)
    np.divide(difference, size, out=share, where=size > 0.0)
    share = np.where(difference == 0.0, 0.0, share)
    return share if share.ndim else float(share)


def difference(key: str, value: float, reference: float) -> tuple[float, bool]:
    """Change of a metric against a reference.

    Parameters
    ----------
    key : str
        Of `wt_gym.analysis.metrics.METRICS`.
    value, reference : float
        SI unit.

    Returns
    -------
    difference : float
        Share of the reference, or in the unit shown.
    relative : bool
        Whether it is a share, see `is_relative`.
    """
    if is_relative(key, reference):
        return relative_change(value, reference), True
    return (value - reference) * METRICS[key].factor, False
