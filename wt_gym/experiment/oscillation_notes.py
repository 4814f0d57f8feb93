"""What an evaluation has to say of runs whose rotor speed swings: figures of such runs compare nothing."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Iterable

    import xarray as xr

    from wt_gym.analysis.results import Run

__all__ = ["SWING", "oscillation_notes", "swings"]

SWING = 0.1
"""Deviation of the rotor speed to either side that counts, in rated speeds [-]."""
LEAST_SWINGS = 3
"""Alternations between the two sides from which on a run oscillates."""
_STEADY = 0.02
"""Standard deviation of the wind at the hub over its mean up to which it counts as steady [-]."""


def swings(data: xr.Dataset, rated_speed: float, skip: float = 0.0) -> int:
    """How often the rotor speed goes from one side of a band to the other.

    The band is ±10 % of rated speed. It lies about rated speed, since below it the speed follows the wind; in a steady
    wind, which explains no change, about the median of the run.

    Parameters
    ----------
    data : xarray.Dataset
        With ``rotor_speed`` [rad/s] and ``wind_x`` [m/s] over ``time`` [s].
    rated_speed : float
        [rad/s].
    skip : float
        Start left out [s].

    Returns
    -------
    int
    """
    kept = data["time"].values >= skip
    speed, wind = data["rotor_speed"].values[kept], data["wind_x"].values[kept]
    if speed.size == 0:
        return 0
    steady = float(np.std(wind)) <= _STEADY * abs(float(np.mean(wind)))
    middle = float(np.median(speed)) if steady else rated_speed
    side = np.where(speed > middle + SWING * rated_speed, 1, np.where(speed < middle - SWING * rated_speed, -1, 0))
    visited = side[side != 0]
    return int(np.count_nonzero(np.diff(visited)))


def oscillation_notes(runs: Iterable[Run], rated_speed: float, skip: float) -> dict[str, str]:
    """Sentences on agents under which the rotor speed oscillates.

    Parameters
    ----------
    runs : iterable of Run
    rated_speed : float
        [rad/s].
    skip : float
        Start of each run left out [s].

    Returns
    -------
    dict
        By the name of the agent; nothing of agents whose runs are steady.
    """
    found: dict[str, list[tuple[str, float, float]]] = {}
    for run in runs:
        if swings(run.data, rated_speed, skip) < LEAST_SWINGS:
            continue
        speed = run.data["rotor_speed"].values[run.data["time"].values >= skip] / rated_speed
        found.setdefault(run.agent, []).append((run.wind.name, float(speed.min()), float(speed.max())))
    return {agent: _note(agent, list(cases)) for agent, cases in found.items()}


def _note(agent: str, cases: list[tuple[str, float, float]]) -> str:
    low, high = min(case[1] for case in cases), max(case[2] for case in cases)
    named = ", ".join(case[0] for case in cases[:4]) + (f" and {len(cases) - 4} more" if len(cases) > 4 else "")
    return (
        f"The rotor speed oscillates under {agent} in {named}: it swings between {low:.2f} and {high:.2f} times rated "
        "speed. Its controller does not hold this turbine, and figures of these runs compare nothing."
    )
