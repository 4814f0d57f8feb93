"""Options of the end of an episode, and limits beyond which steps cost."""

from __future__ import annotations

from collections.abc import Mapping

from wt_gym.base.errors import did_you_mean
from wt_gym.envs.arguments import check_mapping, check_number
from wt_gym.envs.options.group import OptionGroup, option, option_group

__all__ = ["COST_LIMITS", "PITCH_TRAVEL", "LimitOptions"]

PITCH_TRAVEL = "pitch_travel"
COST_LIMITS = {PITCH_TRAVEL: "rad/d", "rotor_speed": "-", "tip_clearance": "m", "tower_acceleration": "m/s^2"}
"""Names and units of the limits beyond which steps cost."""


@option_group
class LimitOptions(OptionGroup):
    """When an episode ends, and what costs."""

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

    costs: Mapping[str, float] | None = option(
        "mapping, optional",
        'Limits beyond which a step costs, in place of the margins of ``info["costs"]`` (`wt_gym.envs.costs`): '
        "``pitch_travel``, mean of the blades [rad/d]; ``rotor_speed`` over rated [-]; ``tip_clearance`` [m]; "
        "``tower_acceleration``, of the nacelle in the horizontal plane [m/s^2]. They do not end an episode",
        default=None,
        flat="cost_limits",
        allowed="positive",
    )

    def check(self) -> None:
        """Refuse limits out of range."""
        if self.costs is not None:
            self._set("costs", _checked_costs(self.costs))
        if self.episode_length is not None:
            self._set_all(check_number, "episode_length", unit="s")
        self._set_all(check_number, "overspeed", "standstill")
        if not self.overspeed > 1.0:
            raise ValueError(f"overspeed_limit must be above 1, got {self.overspeed!r}")
        if self.standstill is not None and not -1.0 <= self.standstill < 1.0:
            raise ValueError(f"standstill_limit must be at least -1 and below 1, got {self.standstill!r}")


def _checked_costs(given: Mapping[str, float]) -> dict[str, float]:
    limits = check_mapping("cost_limits", given)
    for name, limit in limits.items():
        if name not in COST_LIMITS:
            raise ValueError(
                f"cost_limits must have the names {', '.join(COST_LIMITS)}, got {name!r}"
                f"{did_you_mean(name, COST_LIMITS)}"
            )
        if not 0.0 < limit < float("inf"):
            raise ValueError(f"cost_limits[{name!r}] must be positive [{COST_LIMITS[name]}], got {limit!r}")
    if not limits:
        raise ValueError(f"cost_limits must have at least one of {', '.join(COST_LIMITS)}, got none")
    return limits
