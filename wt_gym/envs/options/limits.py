"""Options of the end of an episode."""

from __future__ import annotations

from wt_gym.envs.arguments import check_number
from wt_gym.envs.options.group import OptionGroup, option, option_group

__all__ = ["LimitOptions"]


@option_group
class LimitOptions(OptionGroup):
    """When an episode ends."""

    title = "limits"

    episode_length: float | None = option(
        "float or None",
        "Time after which an episode is truncated; None: never, for a time limit from outside. Tasks have such a "
        "limit: their episodes are made longer by ``max_episode_steps`` of `gymnasium.make`",
        default=120.0,
        unit="s",
        allowed="a multiple of ``control_dt``, at least 1",
    )
    overspeed: float = option(
        "float",
        "Highest rotor speed over rated rotor speed",
        default=1.25,
        flat="overspeed_limit",
        unit="-",
        allowed="above 1",
    )
    standstill: float | None = option(
        "float, optional",
        "Lowest rotor speed over rated rotor speed; 0 allows a stop but no turning backwards, a negative one that too. "
        "Default: 0.2; -1 with a damper, which lets the rotor turn slowly",
        default=None,
        flat="standstill_limit",
        unit="-",
        allowed="at least -1, below 1",
    )

    def check(self) -> None:
        """Refuse limits out of range."""
        if self.episode_length is not None:
            self._set_all(check_number, "episode_length", unit="s")
        self._set_all(check_number, "overspeed", "standstill")
        if not self.overspeed > 1.0:
            raise ValueError(f"overspeed_limit must be above 1, got {self.overspeed!r}")
        if self.standstill is not None and not -1.0 <= self.standstill < 1.0:
            raise ValueError(f"standstill_limit must be at least -1 and below 1, got {self.standstill!r}")
