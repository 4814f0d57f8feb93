"""Options of a dial: factors on the weights of the reward that change within an episode."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from wt_gym.base.errors import did_you_mean
from wt_gym.base.options import Options, option, option_record, real_number, shown

__all__ = ["DIAL_DRAWS", "DIAL_NAMES", "LEAST_FACTOR", "MOST_FACTOR", "DialOptions", "checked_dial"]

DIAL_NAMES = ("fatigue", "power", "travel")
"""What a dial weighs against each other, in the order of columns and channels."""
DIAL_DRAWS = ("log_uniform", "simplex")
"""How the factors of an episode are drawn."""
LEAST_FACTOR, MOST_FACTOR = 1 / 64, 64.0
"""Range of every factor that is given [-]."""


def checked_dial(weights: Any) -> Any:
    """Check weights of a dial: a name of `DIAL_DRAWS`, a mapping of all names, or rows as a tuple of tuples.

    Raises
    ------
    ValueError
        If they are none of them; the message lacks the name of the argument.
    """
    if isinstance(weights, str) and weights in DIAL_DRAWS:
        return weights
    allowed = (
        f"must be one of {', '.join(DIAL_DRAWS)}, a mapping of {', '.join(DIAL_NAMES)} to factors from "
        f"{LEAST_FACTOR:g} to {MOST_FACTOR:g}, or finite rows of rising time [s] and these factors, got "
    )
    if isinstance(weights, Mapping):
        if wrong := [name for name in weights if name not in DIAL_NAMES]:
            raise ValueError(f"{allowed}{shown(wrong[0])}{did_you_mean(wrong[0], DIAL_NAMES)}")
        factors = {name: real_number(weights.get(name, 1.0)) for name in DIAL_NAMES}
        if not all(_is_factor(factor) for factor in factors.values()):
            raise ValueError(allowed + shown(dict(weights)))
        return factors
    try:
        rows = np.asarray(weights, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        rows = np.empty(0)
    if (
        rows.ndim != 2 or not len(rows) or rows.shape[1] != 1 + len(DIAL_NAMES) or not np.isfinite(rows).all()
        or (np.diff(rows[:, 0]) <= 0.0).any() or not all(map(_is_factor, rows[:, 1:].ravel().tolist()))
    ):  # fmt: skip
        near = did_you_mean(weights, DIAL_DRAWS) if isinstance(weights, str) else ""
        raise ValueError(f"{allowed}{shown(weights)}{near}")
    return tuple(map(tuple, rows.tolist()))


def _is_factor(value: float | None) -> bool:
    return value is not None and LEAST_FACTOR <= value <= MOST_FACTOR


def _checked_range(ends: tuple[float, float]) -> tuple[float, float]:
    if not ends[0] < 1.0 <= ends[1]:
        raise ValueError(f"must be (low, high) from below 1 to 1 or more, got {ends}")
    return ends


@option_record
class DialOptions(Options):
    """Factors on the weights of fatigue, power and travel in the reward, see `wt_gym.envs.dial`."""

    title = "dial"
    switch = "weights"

    weights: str | Mapping[str, float] | Sequence[Any] | np.ndarray | None = option(
        'Factors on the weights of the reward. ``"log_uniform"``: each is drawn by itself, evenly in its logarithm; '
        '``"simplex"``: together, evenly among those with one sum; a mapping such as ``{"travel": 2.0}``: constant, '
        "those left out are 1; or rows of time [s], fatigue, power and travel, each of which holds up to the next. "
        "All are scaled to the sum 3, because only their ratios count. None: there is no dial",
        default=None,
        flat="dial_weights",
        unit="-",
        kind="str, mapping, sequence or array, optional",
        allowed="1/64 to 64",
        check=checked_dial,
    )
    range: tuple[float, float] = option(
        'Range of the drawn factors before they are scaled; of ``"simplex"`` the lower end counts',
        default=(0.25, 4.0),
        flat="dial_range",
        unit="-",
        low=LEAST_FACTOR,
        high=MOST_FACTOR,
        check=_checked_range,
    )
    interval: float = option(
        "Mean time between changes of drawn factors, which are drawn evenly between a half and one and a half of it",
        default=20.0,
        flat="dial_interval",
        unit="s",
        low=1.0,
    )
