"""Penalty on the largest moments of blades and tower: what a design has to bear once."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from wt_gym.control.design import reference_flap_moment, reference_tower_moment
from wt_gym.envs.rewards.term import bounded_square

if TYPE_CHECKING:
    from wt_gym.envs.rewards.term import Transition

__all__ = ["ExtremeLoads"]


@dataclass(frozen=True)
class ExtremeLoads:
    """Penalty on moments beyond ``margin`` times the reference: x = (moment / M - margin) / ``scale`` where positive.

    The moments are the largest of the step, over all structural steps: the size of the flapwise root moment of the most
    loaded blade against `reference_loads.reference_flap_moment`, and the bending moment of the tower base against
    `reference_loads.reference_tower_moment`. Both penalties have half of the weight. The turbines of the package reach
    the references in normal turbulence about rated wind in a few gusts an hour.
    """

    weight: float = 0.0
    margin: float = 0.9
    scale: float = 0.2
    name: str = "extreme_loads"

    def __call__(self, transition: Transition) -> float:
        """Rate of reward [1/s]."""
        turbine, after = transition.turbine, transition.after
        shares = (
            max(after["root_flap_moment_max"].tolist()) / reference_flap_moment(turbine),
            after["tower_base_moment_max"] / reference_tower_moment(turbine),
        )
        return -0.5 * self.weight * sum(bounded_square((max(s - self.margin, 0.0) / self.scale) ** 2) for s in shares)
