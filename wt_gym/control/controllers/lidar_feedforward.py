"""Collective pitch ahead of the wind: feed-forward from a lidar on the nacelle."""

import math
from bisect import bisect_left
from collections.abc import Sequence
from typing import Any, Protocol, runtime_checkable

import numpy as np

from wt_gym.base.options import Options, option, option_record
from wt_gym.control.actions import Demand
from wt_gym.control.controllers.additions import AboveRated, FadeParameters, fade_option
from wt_gym.control.controllers.controller import Controller, Readings
from wt_gym.control.operating_point import operating_point
from wt_gym.control.sensors import Lidar, LowPass
from wt_gym.turbines import Turbine

_WINDS = np.linspace(1.0, 40.0, 157)
SPACING = 0.01
"""Of readings that are kept, in lags of the filter: a slow wind does not fill the memory."""


@option_record
class LidarOptions(Options):
    """Parameters of a `LidarFeedforward` by rule."""

    title = "lidar"

    filter_length: float = option(
        "lag of the filter on the wind in rotor diameters", default=0.42, unit="-", low=0.0, above=True
    )
    delay: float = option("delay of the pitch against the filtered wind at the tower", default=0.5, unit="s", low=0.0)
    gain: float = option("share of the slope of the steady pitch over the wind", default=0.6, unit="-", low=0.0)
    lidar: Lidar | None = option(
        "the instrument", default=None, unit="-", kinds=(Lidar,), otherwise="three gates by the rotor's size"
    )
    fade: bool | float | FadeParameters = fade_option()


@runtime_checkable
class ShiftablePitch(Controller, Protocol):
    """Controller whose collective pitch can be moved from outside without its integral fighting back."""

    def shift_pitch(self, change: float) -> None:
        """Move the pitch of the next demand by so much [rad]."""
        ...


class LidarFeedforward:
    """A controller whose pitch follows the wind that a lidar sees coming, ahead of the rotor speed.

    In steady wind v the pitch is theta(v). The wind v_L that is about to arrive moves the pitch of the controller by
    ``d theta = share * d/dv theta(v_L) dv_L``, as a shift of its integral (Schlipf, Schlipf and Kuehn, Wind Energy 16
    (2013) 1107; Guo, Schlipf and Cheng, Wind Energ. Sci. 8 (2023) 149): feedback, gain schedule and limits of the
    angle stay what they are and only correct what the lidar did not see.

    The air is taken to travel frozen at its mean speed U, low-pass filtered over 30 s. With X = int U dt a reading of
    the gate at d, taken at X_0, speaks of the air at ``d - (X - X_0)`` ahead of the tower. The readings of all gates
    that speak of the air at ``1/k - U delay`` are averaged, and their mean is low-pass filtered along X with the
    wavenumber k, which lags by 1/k: what is smaller than the rotor passes a few beams, but does not move the rotor.
    Nothing moves until the air that the farthest gate saw first has come to the tower. The overhang of the rotor and a
    yaw error, by which the air comes along another way than the shaft's, are not taken into account.

    Parameters
    ----------
    **parameters
        Of `LidarOptions`; the lag of the filter, 1/k, must be no longer than the way to the nearest gate.

    Attributes
    ----------
    wavenumber : float
        k, where the filter begins to hold back [rad/m].
    wind : float
        Filtered wind that the pitch follows [m/s]; NaN before the first step.

    Raises
    ------
    ValueError
        If the generator is a damper: over the wind the pitch that holds it goes up and down.
    """

    def __init__(self, turbine: Turbine, base: ShiftablePitch, **parameters: Any):
        o, diameter = LidarOptions(**parameters), turbine.rotor_diameter
        if not turbine.drivetrain.takes_torque:
            raise ValueError(
                f"{turbine.name} has a damper as generator: its steady pitch must be a function of the wind speed"
            )
        if not isinstance(base, ShiftablePitch):
            raise TypeError(f"a feed-forward needs a controller whose pitch can be shifted (shift_pitch), got {base!r}")
        lidar, lag = o.lidar or Lidar.for_rotor(diameter), o.filter_length * diameter
        if min(lidar.ranges) < lag:
            raise ValueError(
                f"the nearest gate of the lidar, {min(lidar.ranges):g} m, must not lie nearer than the lag of the "
                f"filter, {lag:g} m: a range or filter_length is too small"
            )
        self.base, self.lidar, self.wavenumber, self.delay = base, lidar, 1.0 / lag, o.delay
        self.fade, self.winds = AboveRated.of_turbine(turbine, o.fade), _WINDS
        self.steady_pitch = o.gain * np.array([operating_point(turbine, wind).pitch for wind in _WINDS.tolist()])
        self._readings = tuple(f"lidar_{k + 1}" for k in range(len(lidar.ranges)))
        self.channels = tuple(dict.fromkeys((*base.channels, "rotor_speed", *self._readings)))
        self._travel_speed = LowPass(30.0)
        self.wind, self._traveled, self._share = math.nan, 0.0, 0.0
        self._forget()

    def start(self, signals: Readings, demand: Demand) -> None:
        """Start the base from the current demand; of the wind only the current reading of the lidar is known."""
        self.base.start(signals, demand)
        self._forget()
        if self.fade is not None:
            self.fade.start(float(np.mean(demand.pitch)))

    def step(self, signals: Readings, dt: float) -> Demand:
        """Demand of the base, its pitch moved with the wind that is about to arrive."""
        coming = self._coming(signals)
        if math.isnan(self.wind):
            self.wind = coming
        else:
            step = self.wavenumber * max(self._travel_speed.value, 0.0) * dt
            before, self.wind = self.wind, coming + math.exp(-step) * (self.wind - coming)
            if self._traveled >= max(self.lidar.ranges) and self._share > 0.0:
                self.base.shift_pitch(self._share * (self._pitch_in(self.wind) - self._pitch_in(before)))
        demand = self.base.step(signals, dt)
        if self.fade is not None:
            self._share = self.fade.update(list(map(float, demand.pitch)), signals["rotor_speed"], dt)
        self._traveled += max(self._travel_speed.update(self._mean(self._seen[-1]), dt), 0.0) * dt
        return demand

    def _forget(self) -> None:
        """Know nothing of the air ahead."""
        self.wind = math.nan
        self._at: list[float] = []  # travel X of the air at each reading [m]
        self._seen: list[tuple[float, ...]] = []  # readings of all gates [m/s]
        self._traveled = 0.0
        self._share = 0.0 if self.fade is not None else 1.0

    def _coming(self, signals: Readings) -> float:
        """Take a reading; mean over the gates of what they saw of the air that the filter is to get now [m/s]."""
        seen = tuple(signals[name] for name in self._readings)
        if not self._seen:
            self._travel_speed.reset(self._mean(seen))
        if self._at and self._traveled - self._at[-1] < SPACING / self.wavenumber:  # in a calm the last one counts
            self._seen[-1] = seen
        else:
            self._at.append(self._traveled)
            self._seen.append(seen)
        ahead = 1.0 / self.wavenumber - max(self._travel_speed.value, 0.0) * self.delay
        places = [self._traveled - (gate - ahead) for gate in self.lidar.ranges]
        old = bisect_left(self._at, min(places)) - 1  # the last reading before all places is still needed
        if old > 0:
            del self._at[:old], self._seen[:old]
        return self._mean([self._read(k, place) for k, place in enumerate(places)])

    def _read(self, gate: int, place: float) -> float:
        """Reading of a gate when the air had traveled so far [m/s]; outside of what is kept the nearest reading."""
        at, seen = self._at, self._seen
        k = bisect_left(at, place)
        if k in (0, len(at)):
            return seen[max(k - 1, 0)][gate]
        part = (place - at[k - 1]) / (at[k] - at[k - 1])
        return seen[k - 1][gate] + part * (seen[k][gate] - seen[k - 1][gate])

    def _pitch_in(self, wind: float) -> float:
        return float(np.interp(wind, self.winds, self.steady_pitch))

    @staticmethod
    def _mean(values: Sequence[float]) -> float:
        return sum(values) / len(values)
