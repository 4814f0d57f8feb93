"""Penalties on loads as they stand: of use beside the default terms, weight 0 by default."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from wt_gym.control.design import reference_tower_moment
from wt_gym.envs.rewards.term import bounded_square

if TYPE_CHECKING:
    from wt_gym.envs.rewards.term import Transition

__all__ = ["TipDeflection", "TowerLoad"]


@dataclass(frozen=True)
class TipDeflection:
    """Penalty on downwind deflection of the tips: x = deflection / (``scale`` * blade length), mean over the blades."""

    weight: float = 0.0
    scale: float = 0.15
    name: str = "tip_deflection"

    def __call__(self, transition: Transition) -> float:
        """Rate of reward [1/s]."""
        turbine = transition.turbine
        reference = self.scale * turbine.blade.length
        tips = transition.after["tip_out_of_plane"].tolist()
        return -self.weight * sum(bounded_square((max(tip, 0.0) / reference) ** 2) for tip in tips) / turbine.n_blades


@dataclass(frozen=True)
class TowerLoad:
    """Penalty on changes of the tower-base moment, which are what wears a tower.

    x = |dM| / (``scale`` * dt * M_ref): the length of the change of the moment vector over the step, against ``scale``
    times the moment of the Betz thrust at rated wind at hub height per second.
    """

    weight: float = 0.0
    scale: float = 0.25
    name: str = "tower_load"

    def __call__(self, transition: Transition) -> float:
        """Rate of reward [1/s]."""
        before, after = transition.before, transition.after
        change = math.hypot(
            after["tower_base_fore_aft_moment"] - before["tower_base_fore_aft_moment"],
            after["tower_base_side_side_moment"] - before["tower_base_side_side_moment"],
        )
        reference = self.scale * transition.dt * reference_tower_moment(transition.turbine)
        return -self.weight * bounded_square((change / reference) ** 2)
