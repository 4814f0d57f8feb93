"""Options of the observations."""

from __future__ import annotations

from typing import Any

from wt_gym.base.options import Options, as_tuple, option, option_record, shown
from wt_gym.control import Lidar

__all__ = ["MOST_READINGS", "SENSORS", "ObservationOptions"]

MOST_READINGS = 1000
"""Most readings in an observation, and most control steps by which they are late: 200 s at the usual step of 0.2 s."""
SENSORS = ("agent", "all")
"""Who reads late, noisy and shifted sensors."""


def _checked_lidar(lidar: Any) -> Lidar:
    if not isinstance(lidar, Lidar):
        raise ValueError(f"must be a wt_gym.control.Lidar or None, got {shown(lidar)}")
    return lidar


@option_record
class ObservationOptions(Options):
    """Channels of an observation, and how sensors read them."""

    title = "observations"
    objects = {"lidar": Lidar}  # noqa: RUF012 - of the class, as its base says

    channels: str | tuple[str, ...] | None = option(
        "Groups and channels to observe, in any order, or one; default: those of the action mode, see above",
        default=None,
        flat="observation",
        kind="str or sequence of str, optional",
        check=as_tuple,
    )
    noise: float = option(
        "Level of white measurement noise: 0 none, 1 typical instruments",
        default=0.0,
        flat="sensor_noise",
        unit="-",
        low=0.0,
    )
    delay: float = option(
        f"Time by which readings are late, a multiple of ``control_dt`` and at most {MOST_READINGS} of them; with "
        '``sensors="all"`` of the simulator\'s step',
        default=0.0,
        flat="sensor_delay",
        unit="s",
        low=0.0,
    )
    washout: float | None = option(
        "Time constant of a first-order high-pass filter on loads, deflections and accelerations: what lasts of them, "
        "as the offset of a strain gauge or the difference of two simulators, is not observed. Tilt and yaw of "
        "flapwise moments and tip deflections do not pass it. An episode starts with the mean of the time before, "
        "where that is recorded",
        default=None,
        flat="sensor_washout",
        unit="s",
        low=0.0,
        above=True,
    )
    history: int = option(
        "Readings in an observation: the present one, then those of the steps before",
        default=1,
        low=1,
        high=MOST_READINGS,
    )
    sensors: str | None = option(
        "Whose readings are noisy, late and shifted: the agent's alone, channel by channel, or one set of readings at "
        "every step of the simulator, which the base controller and its lidar read too, as on a turbine "
        '(`wt_gym.envs.instruments`). Default: "all" with a variation of plant, sensors or wind, else "agent"',
        default=None,
        choices=SENSORS,
    )
    lidar: Lidar | None = option(
        'Ranges and cone of the group "lidar", a mapping has the arguments of `wt_gym.control.Lidar`, with '
        "``apart=True`` for a channel of each beam. Where the base controller reads a lidar, all else must be as "
        "there; default: the lidar that the base controller reads, if it does, else `wt_gym.control.Lidar.for_rotor`",
        default=None,
        kind="Lidar or mapping, optional",
        check=_checked_lidar,
    )
