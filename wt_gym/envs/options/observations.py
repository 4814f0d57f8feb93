"""Options of the observations."""

from __future__ import annotations

import math
from collections.abc import Sequence

from wt_gym.base.errors import did_you_mean
from wt_gym.control import Lidar
from wt_gym.envs.arguments import check_names, check_number, shown
from wt_gym.envs.options.group import OptionGroup, option, option_group

__all__ = ["MOST_READINGS", "SENSORS", "ObservationOptions"]

MOST_READINGS = 1000
"""Most readings in an observation, and most control steps by which they are late: 200 s at the usual step of 0.2 s."""

SENSORS = ("agent", "all")
"""Who reads late, noisy and shifted sensors."""


@option_group
class ObservationOptions(OptionGroup):
    """What an observation holds, and how sensors read it."""

    title = "observations"
    objects = {"lidar": Lidar}  # noqa: RUF012 - of the class, as its base says

    channels: str | Sequence[str] | None = option(
        "str or sequence of str, optional",
        "Groups and channels to observe, in any order, or one; default: those of the action mode, see above",
        default=None,
        flat="observation",
    )
    noise: float = option(
        "float",
        "Level of white measurement noise: 0 none, 1 typical instruments",
        default=0.0,
        flat="sensor_noise",
        unit="-",
        allowed="at least 0",
    )
    delay: float = option(
        "float",
        "Time by which readings are late",
        default=0.0,
        flat="sensor_delay",
        unit="s",
        allowed=f'a multiple of ``control_dt``, 0 to {MOST_READINGS} of them; with ``sensors="all"`` of the '
        "simulator's step",
    )
    washout: float | None = option(
        "float, optional",
        "Time constant of a first-order high-pass filter on loads, deflections and accelerations: what lasts of them, "
        "as the offset of a strain gauge or the difference of two simulators, is not observed. Tilt and yaw of "
        "flapwise moments and tip deflections do not pass it. An episode starts with the mean of the time before, "
        "where that is recorded",
        default=None,
        flat="sensor_washout",
        unit="s",
        allowed="positive",
    )
    history: int = option(
        "int",
        "Readings in an observation: the present one, then those of the steps before",
        default=1,
        allowed=f"1 to {MOST_READINGS}",
    )
    sensors: str | None = option(
        '{"agent", "all"}, optional',
        "Whose readings are noisy, late and shifted: the agent's alone, channel by channel, or one set of readings at "
        "every step of the simulator, which the base controller and its lidar read too, as on a turbine "
        '(`wt_gym.envs.instruments`). Default: "all" with a variation of plant, sensors or wind, else "agent"',
        default=None,
    )
    lidar: Lidar | None = option(
        "Lidar or mapping, optional",
        'Ranges and cone of the group "lidar", a mapping has the arguments of `wt_gym.control.Lidar`, with '
        "``apart=True`` for a channel of each beam. Where the base controller reads a lidar, all else must be as "
        "there; default: the lidar that the base controller reads, if it does, else `wt_gym.control.Lidar.for_rotor`",
        default=None,
    )

    def check(self) -> None:
        """Refuse names and numbers of the wrong type or out of range."""
        if isinstance(self.channels, str):
            self._set("channels", (self.channels,))
        self._set_all(check_names, "channels")
        self._set_all(check_number, "noise")
        if self.noise < 0.0:
            raise ValueError(f"sensor_noise must be finite and not negative, got {self.noise!r}")
        self._set_all(check_number, "delay", unit="s")
        if self.delay < 0.0:
            raise ValueError(f"sensor_delay must be 0 to {MOST_READINGS} control steps, got {self.delay!r} s")
        self._set_all(check_number, "washout", unit="s")
        if self.washout is not None and self.washout <= 0.0:
            raise ValueError(f"sensor_washout must be positive or None, got {self.washout!r} s")
        history = check_number("history", self.history, finite=False)
        if not (1 <= history <= MOST_READINGS and history == math.floor(history)):
            raise ValueError(
                f"history must be a whole number of readings, 1 to {MOST_READINGS}, got {shown(self.history)}"
            )
        self._set("history", int(history))
        if self.sensors is not None and self.sensors not in SENSORS:
            raise ValueError(
                f"sensors must be one of {SENSORS} or None, got {shown(self.sensors)}"
                f"{did_you_mean(self.sensors, SENSORS)}"
            )
        if self.lidar is not None and not isinstance(self.lidar, Lidar):
            raise ValueError(f"lidar must be a wt_gym.control.Lidar or None, got {shown(self.lidar)}")
