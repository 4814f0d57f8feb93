"""Options of the reward."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING

from wt_gym.envs.arguments import check_flag, check_number
from wt_gym.envs.options.group import OptionGroup, option, option_group
from wt_gym.envs.rewards import compose

if TYPE_CHECKING:
    from wt_gym.envs.rewards.compose import Part

__all__ = ["RewardOptions"]


@option_group
class RewardOptions(OptionGroup):
    """What a step earns."""

    title = "rewards"

    terms: Mapping[str, float] | Part | Iterable[Part] | None = option(
        "mapping, str, callable, RewardTerm or iterable of them, optional",
        'Weights by name; or the terms alone: names (``"power"``), functions of a transition that give a rate in 1/s, '
        "terms of your own. See `wt_gym.envs.rewards.compose`",
        default=None,
        flat="reward",
    )
    relative: bool = option(
        "bool",
        "Take off what the base controller alone earns in the same wind. A second turbine runs beside the first, at "
        "twice the cost, in the first episode from a beginning; what it earns is kept in memory and in the user's "
        "cache (see ``starts``), unless controller, reward, simulator or wind are yours",
        default=False,
        flat="relative_reward",
    )
    vector: bool = option(
        "bool",
        "Give the terms as an array instead of their sum, as multi-objective libraries take it; named in "
        "``reward_names``, with a ``reward_space``",
        default=False,
        flat="vector_reward",
    )
    termination_penalty: float = option(
        "float",
        "Subtracted from the reward when an episode is terminated",
        default=120.0,
        unit="-",
        allowed="at least 0",
    )

    def check(self) -> None:
        """Refuse unknown terms, weights without meaning and texts for flags."""
        self._set_all(check_number, "termination_penalty")
        if self.termination_penalty < 0.0:
            raise ValueError(f"termination_penalty must be finite and not negative, got {self.termination_penalty!r}")
        self._set_all(check_flag, "relative", "vector")
        compose(self.terms)
