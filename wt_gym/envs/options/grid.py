"""Options of what a grid operator asks for."""

from __future__ import annotations

import os
from collections.abc import Sequence
from typing import Any

import numpy as np

from wt_gym.base.errors import did_you_mean
from wt_gym.envs.arguments import check_number, real_number, real_numbers, shown
from wt_gym.envs.options.group import OptionGroup, option, option_group

__all__ = ["LEAST_LEVEL", "MOVING_KINDS", "REFERENCE_KINDS", "GridOptions", "checked_reference"]

REFERENCE_KINDS = ("reserve", "steps", "ramps", "regulation")
"""Courses of the power reference that are drawn for each episode."""
MOVING_KINDS = ("steps", "ramps", "regulation")
"""Those of them that have a span."""
LEAST_LEVEL = 0.2
"""Least power that is asked for, over what the mean wind allows [-]."""
_ROUNDING = 1e-9


@option_group
class GridOptions(OptionGroup):
    """What a grid operator asks for: a power reference, see `wt_gym.envs.power_reference`."""

    title = "grid"

    reference: str | os.PathLike[str] | Sequence[Any] | np.ndarray | None = option(
        "str, path, sequence or array, optional",
        'Power that is asked for. ``"reserve"``, a constant one; ``"steps"``, ``"ramps"``; ``"regulation"``, a '
        "band-limited signal of an automatic generation control; several of them: each episode draws one; or "
        "your own course: rows of time [s] and positive power [W] with linear interpolation and the ends held, as an "
        "array or as a CSV file (``.csv``). None: nothing is asked for",
        default=None,
        flat="power_reference",
    )
    level: float | Sequence[float] = option(
        "float or (float, float)",
        "Mean of a drawn course over the power that the mean wind of the episode allows, at most rated power; a range "
        "is drawn from",
        default=(0.8, 0.9),
        flat="power_reference_level",
        unit="-",
        allowed=f"{LEAST_LEVEL:g} to 1",
    )
    span: float = option(
        "float",
        "Greatest deviation of a drawn course from its mean, over the same power",
        default=0.1,
        flat="power_reference_span",
        unit="-",
        allowed=f"0 up to where the course would leave {LEAST_LEVEL:g} to 1",
    )
    interval: float = option(
        "float",
        "Mean time between steps, and between the beginnings of ramps",
        default=20.0,
        flat="power_reference_interval",
        unit="s",
        allowed="at least 1",
    )

    def check(self) -> None:
        """Refuse courses and numbers without meaning."""
        reference = None if self.reference is None else checked_reference(self.reference)
        self._set("reference", reference)
        level = real_numbers(self.level)
        single = real_number(self.level)
        low, high = (single, single) if single is not None else level if len(level) == 2 else (np.nan, np.nan)
        if not LEAST_LEVEL <= low <= high <= 1.0:
            raise ValueError(
                f"power_reference_level must be a number or a range (low, high) within {LEAST_LEVEL:g} and 1, got "
                f"{shown(self.level)}"
            )
        self._set("level", (float(low), float(high)))
        self._set_all(check_number, "span", "interval")
        if not self.span >= 0.0:
            raise ValueError(f"power_reference_span must be at least 0, got {self.span!r}")
        self.check_span(reference)
        if not self.interval >= 1.0:
            raise ValueError(f"power_reference_interval must be at least 1 s, got {self.interval!r} s")

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
        low, high = self.level  # type: ignore[misc]  # checked
        if low - self.span < LEAST_LEVEL - _ROUNDING or high + self.span > 1.0 + _ROUNDING:
            raise ValueError(
                f"power_reference_span must keep the course within {LEAST_LEVEL:g} and 1, got {self.span!r} about "
                f"levels of {low:g} to {high:g}"
            )


def checked_reference(given: Any) -> Any:
    """A choice of courses: names as a tuple, a path as it is, rows as a tuple of pairs.

    Parameters
    ----------
    given : object
        As of `GridOptions.reference`.

    Raises
    ------
    ValueError
        If it is none of them.
    """
    if isinstance(given, os.PathLike) or (isinstance(given, str) and given.endswith(".csv")):
        return os.fspath(given)
    names = (given,) if isinstance(given, str) else given
    if isinstance(names, list | tuple) and len(names) and all(isinstance(name, str) for name in names):
        for name in names:
            if name not in REFERENCE_KINDS:
                raise ValueError(
                    f"power_reference must be among {', '.join(REFERENCE_KINDS)}, a .csv file, or rows of time and "
                    f"power, got {name!r}{did_you_mean(name, REFERENCE_KINDS)}"
                )
        return tuple(names)
    try:
        rows = np.asarray(given, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        rows = np.empty(0)
    if rows.ndim != 2 or rows.shape[0] < 1 or rows.shape[1] != 2 or not np.isfinite(rows).all():
        raise ValueError(
            f"power_reference must be among {', '.join(REFERENCE_KINDS)}, a .csv file, or finite rows of time [s] and "
            f"power [W], got {shown(given)}"
        )
    if (np.diff(rows[:, 0]) < 0.0).any():
        raise ValueError(f"power_reference must have times that do not fall, got {shown(given)}")
    if (least := float(rows[:, 1].min())) <= 0.0:
        raise ValueError(
            f"power_reference must have powers above 0 W, got {least:g} W: controllers follow a demand no lower than "
            "20 % of rated power, and 0 in record 13 of the Bladed interface means that nothing is demanded"
        )
    return tuple(map(tuple, rows.tolist()))
