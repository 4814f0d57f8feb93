"""Options of what a grid operator asks for."""

from __future__ import annotations

import os
from collections.abc import Sequence
from typing import Any

import numpy as np

from wt_gym.base.errors import did_you_mean
from wt_gym.base.options import Options, as_pair, option, option_record, shown

__all__ = ["LEAST_LEVEL", "MOVING_KINDS", "REFERENCE_KINDS", "GridOptions", "checked_reference"]

REFERENCE_KINDS = ("reserve", "steps", "ramps", "regulation")
"""Courses of the power reference that are drawn for each episode."""
MOVING_KINDS = ("steps", "ramps", "regulation")
"""Those of them that have a span."""
LEAST_LEVEL = 0.2
"""Least power that is asked for, over what the mean wind allows [-]."""
_ROUNDING = 1e-9


def checked_reference(reference: Any) -> Any:
    """Check a choice of courses: names as a tuple, a path as it is, rows as a tuple of pairs.

    Raises
    ------
    ValueError
        If it is none of them; the message lacks the name of the argument.
    """
    if isinstance(reference, os.PathLike) or (isinstance(reference, str) and reference.endswith(".csv")):
        return os.fspath(reference)
    names = (reference,) if isinstance(reference, str) else reference
    allowed = (
        f"must be among {', '.join(REFERENCE_KINDS)}, a .csv file, or finite rows of time [s] that does not fall and "
        "power [W], got "
    )
    if isinstance(names, list | tuple) and len(names) and all(isinstance(name, str) for name in names):
        if wrong := [name for name in names if name not in REFERENCE_KINDS]:
            raise ValueError(f"{allowed}{wrong[0]!r}{did_you_mean(wrong[0], REFERENCE_KINDS)}")
        return tuple(names)
    try:
        rows = np.asarray(reference, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        rows = np.empty(0)
    if rows.ndim != 2 or rows.shape[0] < 1 or rows.shape[1] != 2 or not np.isfinite(rows).all():
        raise ValueError(allowed + shown(reference))
    if (np.diff(rows[:, 0]) < 0.0).any():
        raise ValueError(allowed + shown(reference))
    if (least := float(rows[:, 1].min())) <= 0.0:
        raise ValueError(
            f"must have powers above 0 W, got {least:g} W: controllers follow a demand no lower than 20 % of rated "
            "power, and 0 in record 13 of the Bladed interface means that nothing is demanded"
        )
    return tuple(map(tuple, rows.tolist()))


@option_record
class GridOptions(Options):
    """Demand of a grid operator: a power reference, see `wt_gym.envs.power_reference`."""

    title = "grid"
    switch = "reference"

    reference: str | os.PathLike[str] | Sequence[Any] | np.ndarray | None = option(
        'Power that is asked for. ``"reserve"``, a constant one; ``"steps"``, ``"ramps"``; ``"regulation"``, a '
        "band-limited signal of an automatic generation control; several of them: each episode draws one; or "
        "your own course: rows of time [s] and positive power [W] with linear interpolation and the ends held, as an "
        "array or as a CSV file (``.csv``). None: nothing is asked for",
        default=None,
        flat="power_reference",
        kind="str, path, sequence or array, optional",
        check=checked_reference,
    )
    level: float | tuple[float, float] = option(
        "Mean of a drawn course over the power that the mean wind of the episode allows, at most rated power; a range "
        "is drawn from",
        default=(0.8, 0.9),
        flat="power_reference_level",
        unit="-",
        low=LEAST_LEVEL,
        high=1.0,
        check=as_pair,
    )
    span: float = option(
        "Greatest deviation of a drawn course from its mean, over the same power; the course stays within "
        f"{LEAST_LEVEL:g} and 1",
        default=0.1,
        flat="power_reference_span",
        unit="-",
        low=0.0,
    )
    interval: float = option(
        "Mean time between steps, and between the beginnings of ramps",
        default=20.0,
        flat="power_reference_interval",
        unit="s",
        low=1.0,
    )

    def check(self) -> None:
        """Refuse a span with which a course would leave its limits."""
        self.check_span(self.reference)

    def check_span(self, reference: Any) -> None:
        """Refuse a span with which a course that is drawn would leave its limits.

        Parameters
        ----------
        reference : object
            As `checked_reference` returns it, or None.

        Raises
        ------
        ValueError
            If one of the kinds moves about its level, and the span is too large for that.
        """
        if not isinstance(reference, tuple) or not set(reference) & set(MOVING_KINDS):
            return
        low, high = self.level  # type: ignore[misc]  # a pair
        if low - self.span < LEAST_LEVEL - _ROUNDING or high + self.span > 1.0 + _ROUNDING:
            raise ValueError(
                f"power_reference_span must keep the course within {LEAST_LEVEL:g} and 1, got {self.span!r} about "
                f"levels of {low:g} to {high:g}"
            )
