"""Costs of a step for constrained learning, a sum and its parts by name as in Safety-Gymnasium.

By default they say how far the turbine went into the margins that protect it. Each is zero outside its margin and rises
evenly to one at the end of it; all are taken from the extremes over the structural steps of the control step, so that
nothing slips between two samples.

With limits of the user (``cost_limits``) they take the place of the margins:

- ``rotor_speed``, ``tip_clearance``, ``tower_acceleration``: 1 in a step beyond the limit, else 0. The mean over an
  episode is the share of its steps, and a single one violates the limit.
- ``pitch_travel``: travel of the step, mean of the blades, over what the limit allows in its time. The mean over an
  episode is the travel over the limit, which is violated above 1.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from wt_gym.base.constants import DAY
from wt_gym.envs.options.limits import PITCH_TRAVEL
from wt_gym.turbines.variants import unloaded_clearance

if TYPE_CHECKING:
    from collections.abc import Mapping

    from wt_gym.simulation import Signals
    from wt_gym.turbines import Turbine

__all__ = ["CLEARANCE_MARGIN", "COST_NAMES", "OVERSPEED_MARGIN", "PITCH_RATE_MARGIN", "Costs", "violated"]

COST_NAMES = ("overspeed", "clearance", "pitch_rate")
"""Keys of ``info["costs"]`` without limits of the user."""

OVERSPEED_MARGIN = 0.6
"""Part of the way from rated speed to the overspeed limit that is margin: from 110 % on with a limit of 125 %."""

CLEARANCE_MARGIN = 0.3
"""Part of the clearance of the unloaded rotor that is margin, as Germanischer Lloyd's guideline (2010) asks for."""

PITCH_RATE_MARGIN = 0.1
"""Part of the greatest pitch rate that is margin."""


class Costs:
    """Costs of the steps of an environment.

    Parameters
    ----------
    turbine : Turbine
    control_dt : float
        [s]
    overspeed_limit : float
        Rotor speed at which an episode ends, over the rated one.
    limits : mapping, optional
        Of the user, by name of `wt_gym.envs.options.limits.COST_LIMITS`.
    """

    def __init__(
        self,
        turbine: Turbine,
        control_dt: float,
        overspeed_limit: float,
        limits: Mapping[str, float] | None = None,
    ):
        rated = turbine.drivetrain.rated_rotor_speed
        self._speed_margin = OVERSPEED_MARGIN * (overspeed_limit - 1.0) * rated
        self._speed_limit = overspeed_limit * rated - self._speed_margin
        self._clearance = CLEARANCE_MARGIN * unloaded_clearance(turbine)
        self._travel = control_dt * turbine.pitch.max_rate
        self._rated, self._day_share, self._limits = rated, control_dt / DAY, limits

    def of(self, signals: Signals) -> dict[str, float]:
        """Costs by name of the step that led to these signals, each from 0 to 1 but that of the pitch travel."""
        if self._limits is not None:
            return {name: self._beyond(name, limit, signals) for name, limit in self._limits.items()}
        speed = (signals["rotor_speed_max"] - self._speed_limit) / self._speed_margin
        clearance = 1.0 - min(signals["tip_clearance_min"].tolist()) / self._clearance
        rate = 1.0 + (max(signals["pitch_travel"].tolist()) / self._travel - 1.0) / PITCH_RATE_MARGIN
        return {
            "overspeed": min(max(speed, 0.0), 1.0),
            "clearance": min(max(clearance, 0.0), 1.0),
            "pitch_rate": min(max(rate, 0.0), 1.0),
        }

    def _beyond(self, name: str, limit: float, signals: Signals) -> float:
        """Cost by a limit of the user."""
        if name == PITCH_TRAVEL:
            blades = signals["pitch_travel"].tolist()
            return float(sum(blades) / len(blades) / (limit * self._day_share))
        if name == "rotor_speed":
            return float(signals["rotor_speed_max"] > limit * self._rated)
        if name == "tip_clearance":
            return float(min(signals["tip_clearance_min"].tolist()) < limit)
        fore_aft, side_side = (signals[f"nacelle_acceleration_{axis}"] for axis in ("fore_aft", "side_side"))
        return float(math.hypot(fore_aft, side_side) > limit)

    def of_failure(self) -> dict[str, float]:
        """Costs of a step that the simulation did not survive: the whole of each."""
        return dict.fromkeys(COST_NAMES if self._limits is None else self._limits, 1.0)


def violated(means: Mapping[str, float]) -> tuple[str, ...]:
    """Limits of the user that an episode violates.

    Parameters
    ----------
    means : mapping
        Mean costs of its steps by name.
    """
    return tuple(name for name, mean in means.items() if mean > (1.0 if name == PITCH_TRAVEL else 0.0))
