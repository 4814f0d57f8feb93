"""Instruments of an episode, with noise, offsets and delay, and the response to pitch."""

import math
from collections import deque
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from wt_gym.base.quantities import wrapped
from wt_gym.control import Channel, LowPass
from wt_gym.simulation import Signals
from wt_gym.simulation.channels import ODD, channel_table
from wt_gym.turbines import Turbine

TIME_CONSTANT = 10.0
"""Time constant of the mean about which deviations are multiplied [s]."""


class PitchGain:
    """Blades that move by a gain [-] times the deviation of their demands from the recent mean."""

    def __init__(self, gain: float):

        self.gain, self._mean = gain, LowPass(TIME_CONSTANT)

    def start(self, pitch: NDArray[np.float64]) -> None:
        """Start in steady state at pitch angles [rad]."""
        self._mean.reset(float(np.mean(pitch)))

    def moved(self, demand: NDArray[np.float64], dt: float) -> NDArray[np.float64]:
        """Angles that the drives go to for a demand on each blade in a step of length dt [rad, s]."""
        mean = self._mean.update(float(np.add.reduce(demand)) / len(demand), dt)
        out: NDArray[np.float64] = mean + self.gain * (demand - mean)
        return out

    def read(self, signals: Signals) -> Signals:
        """Signals as the encoders of the blades give them; the given ones stay as they are."""
        read, mean = Signals(signals.values.copy(), signals.n_blades), self._mean.value
        for name in ("pitch", "pitch_command"):
            read.set(name, mean + (signals[name] - mean) / self.gain)
        read.set("pitch_rate", signals["pitch_rate"] / self.gain)
        return read


WIND_SPEED = "wind_speed"
DRIFTING = (
    "root_flap_moment", "root_edge_moment", "tip_out_of_plane", "tip_in_plane", "tower_top_fore_aft",
    "tower_top_side_side", "nacelle_acceleration_fore_aft", "nacelle_acceleration_side_side",
    "tower_base_fore_aft_moment", "tower_base_side_side_moment", WIND_SPEED, "yaw_error",
)  # fmt: skip
"""Sensors that have an offset; the blades share theirs."""
_PLACES = {channel.name: k for k, channel in enumerate(channel_table(1)) if not channel.name.endswith("_1")}
"""Places of the signals of no blade, the same for every number of blades."""


class InstrumentTable:
    """Noise and scale of the signals of a turbine.

    Parameters
    ----------
    channels : mapping
        Channel of the observation by the name of the signal that it reads, "wind_speed" and the means of the blades
        (``root_flap_moment_mean``) among them (`wt_gym.envs.channels.Observable.of_signals`).
    lidar_noise : float
        Of a reading of the lidar [m/s].

    Attributes
    ----------
    places : numpy.ndarray of int, shape (n_noisy,)
        Signals with noise.
    noise : numpy.ndarray, shape (n_noisy,)
        Standard deviations at level 1, in the units of the signals, with the sign of an image for a rotor that turns
        counter-clockwise.
    """

    def __init__(self, turbine: Turbine, channels: Mapping[str, Channel], lidar_noise: float):
        table = channel_table(turbine.n_blades, turbine.n_lines)
        image = turbine.rotation != "clockwise"
        index = {channel.name: k for k, channel in enumerate(table)}
        sign = {channel.name: -1.0 if image and channel.parity == ODD else 1.0 for channel in table}
        noisy = [name for name in index if name in channels and channels[name].noise > 0.0]
        self.places = np.array([index[name] for name in noisy], dtype=np.int64)
        self.noise = np.array([sign[name] * channels[name].noise for name in noisy])
        self.wind_noise, self.lidar_noise = channels[WIND_SPEED].noise, lidar_noise
        self._wind_scale = channels[WIND_SPEED].scale
        self._shifts: dict[str, tuple[list[int], float]] = {}
        for name in (one for one in DRIFTING if one != WIND_SPEED):
            of_blades = [channel.name for channel in table if channel.group == name]
            channel = channels[name if name in index else f"{name}_mean"]
            self._shifts[name] = [index[one] for one in of_blades], channel.scale * sign[of_blades[0]]
        self.size = len(table)

    def offsets(self, shifts: Mapping[str, float]) -> tuple[NDArray[np.float64], float]:
        """Offsets of all signals in their units and of the wind speed [m/s], for shifts in scales of the channels."""
        values = np.zeros(self.size)
        for name in shifts.keys() - {WIND_SPEED}:
            places, scale = self._shifts[name]
            values[places] = shifts[name] * scale
        return values, self._wind_scale * shifts.get(WIND_SPEED, 0.0)


class Instruments:
    """Instruments that read the signals of an episode.

    Parameters
    ----------
    level : float
        Of the noise [-].
    delay : int
        Readings by which they are late.
    shifts : mapping
        See `InstrumentTable.offsets`.
    n_seen : int
        Readings of the lidar.
    seed : int
        Of the noise.
    """

    instant: tuple[float, float]  #: time and yaw of the last readings [s, rad]; the lidar has looked there and then

    def __init__(
        self, table: InstrumentTable, level: float, delay: int, shifts: Mapping[str, float], n_seen: int, seed: int
    ):
        self._table, self._level = table, level
        self.offset, self._wind_offset = table.offsets(shifts)
        self._shifted = bool(np.any(self.offset))
        self._turns = level > 0.0 or self._shifted
        self._late: deque[NDArray[np.float64]] = deque(maxlen=delay + 1)
        self._rng = np.random.default_rng(seed)
        self._of_lidar = np.zeros(n_seen)

    def take(self, signals: Signals) -> Signals:
        """Read once; before there are readings late enough, the first one stands for them."""
        self._late.append(signals.values.copy())
        late, place = Signals(self._late[0], signals.n_blades), _PLACES
        self.instant = late["time"], late["yaw"]
        values = late.values.copy()
        values[place["time"]] = signals["time"]
        speed = self._wind_offset
        if self._level > 0.0:
            table, normal = self._table, self._rng.standard_normal(len(self._table.places) + 1 + len(self._of_lidar))
            n = len(table.places)
            values[table.places] += self._level * table.noise * normal[:n]
            speed += self._level * table.wind_noise * normal[n]
            self._of_lidar = self._level * table.lidar_noise * normal[n + 1 :]
        if self._shifted:
            values += self.offset
        if self._turns:
            values[place["yaw_error"]] = wrapped(values[place["yaw_error"]])
        if speed:
            x, y = values[place["wind_x"]], values[place["wind_y"]]
            true = math.hypot(x, y)
            if true > 0.0:
                share = max(true + speed, 0.0) / true  # a cup turns one way
                values[place["wind_x"]], values[place["wind_y"]] = share * x, share * y
        return Signals(values, signals.n_blades)

    def seen(self, look: NDArray[np.float64]) -> NDArray[np.float64]:
        """Readings of the lidar for a look, in the order of its readings [m/s]."""
        return np.add(look, self._of_lidar)
