"""Options of the end of an episode, and limits beyond which steps cost."""

from __future__ import annotations

from collections.abc import Mapping

from wt_gym.base.options import Options, not_empty, option, option_record

__all__ = ["COST_LIMITS", "PITCH_TRAVEL", "LimitOptions"]

PITCH_TRAVEL = "pitch_travel"
COST_LIMITS = {PITCH_TRAVEL: "rad/d", "rotor_speed": "-", "tip_clearance": "m", "tower_acceleration": "m/s^2"}
"""Names and units of the limits beyond which steps cost."""


@option_record
class LimitOptions(Options):
    """When an episode ends, and what costs."""

    title = "limits"

    episode_length: float | None = option(
        "Time after which an episode is truncated, a multiple of ``control_dt``; None: never, for a time limit from "
        "outside. Tasks have such a limit: their episodes are made longer by ``max_episode_steps`` of `gymnasium.make`",
        default=120.0,
        unit="s",
        low=0.0,
        above=True,
    )
    overspeed: float = option(
        "Highest rotor speed over rated rotor speed",
        default=1.25,
        flat="overspeed_limit",
        unit="-",
        low=1.0,
        above=True,
    )
    standstill: float | None = option(
        "Lowest rotor speed over rated rotor speed; 0 allows a stop but no turning backwards, a negative one that too. "
        "Default: 0.2; -1 with a damper, which lets the rotor turn slowly",
        default=None,
        flat="standstill_limit",
        unit="-",
        low=-1.0,
        high=1.0,
        below=True,
    )
    costs: Mapping[str, float] | None = option(
        'Limits beyond which a step costs, in place of the margins of ``info["costs"]`` (`wt_gym.envs.costs`): '
        "``pitch_travel``, mean of the blades [rad/d]; ``rotor_speed`` over rated [-]; ``tip_clearance`` [m]; "
        "``tower_acceleration``, of the nacelle in the horizontal plane [m/s^2]. They do not end an episode",
        default=None,
        flat="cost_limits",
        choices=tuple(COST_LIMITS),
        low=0.0,
        above=True,
        check=not_empty,
    )
