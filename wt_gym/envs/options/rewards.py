"""Options of the reward."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING

from wt_gym.base.options import Options, option, option_record
from wt_gym.envs.rewards import compose

if TYPE_CHECKING:
    from wt_gym.envs.rewards.compose import Part

__all__ = ["RewardOptions"]


@option_record
class RewardOptions(Options):
    """What a step earns."""

    title = "rewards"

    terms: Mapping[str, float] | Part | Iterable[Part] | None = option(
        'Weights by name; or the terms alone: names (``"power"``), functions of a transition that give a rate in 1/s, '
        "terms of your own. See `wt_gym.envs.rewards.compose`",
        default=None,
        flat="reward",
        kind="mapping, str, callable, RewardTerm or iterable of them, optional",
    )
    relative: bool = option(
        "Take off what the base controller alone earns in the same wind. A second turbine runs beside the first, at "
        "twice the cost, in the first episode from a beginning; what it earns is kept in memory and in the user's "
        "cache (see ``starts``), unless controller, reward, simulator or wind are yours",
        default=False,
        flat="relative_reward",
    )
    vector: bool = option(
        "Give the terms as an array instead of their sum, as multi-objective libraries take it; named in "
        "``reward_names``, with a ``reward_space``",
        default=False,
        flat="vector_reward",
    )
    termination_penalty: float = option(
        "Subtracted from the reward when an episode is terminated", default=120.0, unit="-", low=0.0
    )

    def check(self) -> None:
        """Refuse unknown terms and weights without meaning."""
        compose(self.terms)
