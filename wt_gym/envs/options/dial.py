"""Options of a dial: factors on the weights of the reward that change within an episode."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from wt_gym.base.errors import did_you_mean
from wt_gym.envs.arguments import check_number, real_number, real_numbers, shown
from wt_gym.envs.options.group import OptionGroup, option, option_group

__all__ = ["DIAL_DRAWS", "DIAL_NAMES", "LEAST_FACTOR", "MOST_FACTOR", "DialOptions", "checked_dial"]

DIAL_NAMES = ("fatigue", "power", "travel")
"""What a dial weighs against each other, in the order of columns and channels."""
DIAL_DRAWS = ("log_uniform", "simplex")
"""How the factors of an episode are drawn."""
LEAST_FACTOR, MOST_FACTOR = 1 / 64, 64.0
"""Range of every factor that is given [-]."""


@option_group
class DialOptions(OptionGroup):
    """Factors on the weights of fatigue, power and travel in the reward, see `wt_gym.envs.dial`."""

    title = "dial"

    weights: str | Mapping[str, float] | Sequence[Any] | np.ndarray | None = option(
        "str, mapping, sequence or array, optional",
        'Factors on the weights of the reward. ``"log_uniform"``: each is drawn by itself, evenly in its logarithm; '
        '``"simplex"``: together, evenly among those with one sum; a mapping such as ``{"travel": 2.0}``: constant, '
        "those left out are 1; or rows of time [s], fatigue, power and travel, each of which holds up to the next. "
        "All are scaled to the sum 3, because only their ratios count. None: there is no dial",
        default=None,
        flat="dial_weights",
        unit="-",
        allowed="1/64 to 64",
    )
    range: Sequence[float] = option(
        "(float, float)",
        'Range of the drawn factors before they are scaled; of ``"simplex"`` the lower end counts',
        default=(0.25, 4.0),
        flat="dial_range",
        unit="-",
        allowed="within 1/64 and 64, from below 1 to at least 1",
    )
    interval: float = option(
        "float",
        "Mean time between changes of drawn factors, which are drawn evenly between a half and one and a half of it",
        default=20.0,
        flat="dial_interval",
        unit="s",
        allowed="at least 1",
    )

    def check(self) -> None:
        """Refuse draws, factors and times without meaning."""
        if self.weights is not None:
            self._set("weights", checked_dial(self.weights))
        ends = real_numbers(self.range)
        if len(ends) != 2 or not LEAST_FACTOR <= ends[0] < 1.0 <= ends[1] <= MOST_FACTOR:
            raise ValueError(
                f"dial_range must be (low, high) within {LEAST_FACTOR:g} and {MOST_FACTOR:g}, from below 1 to 1 "
                f"or more, got {shown(self.range)}"
            )
        self._set("range", (float(ends[0]), float(ends[1])))
        self._set_all(check_number, "interval", unit="s")
        if not self.interval >= 1.0:
            raise ValueError(f"dial_interval must be at least 1 s, got {self.interval!r} s")


def checked_dial(given: Any) -> Any:
    """A choice of factors: a name of `DIAL_DRAWS`, a mapping of all names, or rows as a tuple of tuples.

    Parameters
    ----------
    given : object
        As of `DialOptions.weights`.

    Raises
    ------
    ValueError
        If it is none of them.
    """
    if isinstance(given, str):
        if given not in DIAL_DRAWS:
            raise ValueError(
                f"dial_weights must be one of {', '.join(DIAL_DRAWS)}, a mapping or rows, got {given!r}"
                f"{did_you_mean(given, DIAL_DRAWS)}"
            )
        return given
    if isinstance(given, Mapping):
        for name, value in given.items():
            if name not in DIAL_NAMES:
                raise ValueError(
                    f"dial_weights must have the names {', '.join(DIAL_NAMES)}, got {shown(name)}"
                    f"{did_you_mean(name, DIAL_NAMES)}"
                )
            _check_factors(real_number(value), value)
        return {name: float(given.get(name, 1.0)) for name in DIAL_NAMES}
    try:
        rows = np.asarray(given, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        rows = np.empty(0)
    if rows.ndim != 2 or not len(rows) or rows.shape[1] != 1 + len(DIAL_NAMES) or not np.isfinite(rows).all():
        raise ValueError(
            f"dial_weights must be one of {', '.join(DIAL_DRAWS)}, a mapping of {', '.join(DIAL_NAMES)} to factors, or "
            f"finite rows of time [s] and these factors, got {shown(given)}"
        )
    if (np.diff(rows[:, 0]) <= 0.0).any():
        raise ValueError(f"dial_weights must have times that rise, got {shown(given)}")
    for value in rows[:, 1:].ravel().tolist():
        _check_factors(value, value)
    return tuple(map(tuple, rows.tolist()))


def _check_factors(value: float | None, given: Any) -> None:
    if value is None or not math.isfinite(value) or not LEAST_FACTOR <= value <= MOST_FACTOR:
        raise ValueError(f"dial_weights must be factors from {LEAST_FACTOR:g} to {MOST_FACTOR:g}, got {shown(given)}")
