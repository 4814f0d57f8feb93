"""Costs of a step for constrained learning: how far the turbine went into the margins that protect it.

Each cost is zero outside its margin and rises evenly to one at the end of it; all are taken from the extremes over the
structural steps of the control step, so that nothing slips between two samples.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from wt_gym.turbines.clearance import unloaded_clearance

if TYPE_CHECKING:
    from wt_gym.simulation import Signals
    from wt_gym.turbines import Turbine

__all__ = ["CLEARANCE_MARGIN", "COST_NAMES", "OVERSPEED_MARGIN", "PITCH_RATE_MARGIN", "Costs"]

COST_NAMES = ("overspeed", "clearance", "pitch_rate")
"""Keys of ``info["costs"]``."""

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
    """

    def __init__(self, turbine: Turbine, control_dt: float, overspeed_limit: float):
        rated = turbine.drivetrain.rated_rotor_speed
        self._speed_margin = OVERSPEED_MARGIN * (overspeed_limit - 1.0) * rated
        self._speed_limit = overspeed_limit * rated - self._speed_margin
        self._clearance = CLEARANCE_MARGIN * unloaded_clearance(turbine)
        self._travel = control_dt * turbine.pitch.max_rate

    def of(self, signals: Signals) -> dict[str, float]:
        """Costs by name, each from 0 to 1, of the step that led to these signals."""
        speed = (signals["rotor_speed_max"] - self._speed_limit) / self._speed_margin
        clearance = 1.0 - min(signals["tip_clearance_min"].tolist()) / self._clearance
        rate = 1.0 + (max(signals["pitch_travel"].tolist()) / self._travel - 1.0) / PITCH_RATE_MARGIN
        return {
            "overspeed": min(max(speed, 0.0), 1.0),
            "clearance": min(max(clearance, 0.0), 1.0),
            "pitch_rate": min(max(rate, 0.0), 1.0),
        }

    @staticmethod
    def of_failure() -> dict[str, float]:
        """Costs of a step that the simulation did not survive: the whole of each."""
        return dict.fromkeys(COST_NAMES, 1.0)
