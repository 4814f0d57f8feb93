"""A turbine that responds more or less to pitch than its model.

With a gain g the blades move to ``s + g (d - s)``, where d is the demand on a blade and s the mean of the demands on
all blades, low-pass filtered over `TIME_CONSTANT`. The encoders read the scale of the demand: ``s + (θ - s) / g`` for a
blade at θ. To controller and agent the turbine is then one whose loads, speed and motion respond g times as much to
every change of pitch faster than the filter, individual or collective, at the same operating point.

A scaled lift curve, chord or density does something else: it multiplies the response to the wind by the same factor as
the response to pitch, so that their ratio, on which feedforward depends, stays, and it moves rated wind. That is the
quantity ``air_density`` of a variation.

Range and rate limits of the drives hold for the blades: with g = 1.25 the demand can change at four fifths of the rate.
Recorded signals and rewards have the motion of the blades, and pitch travel thus counts g times.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from wt_gym.control.sensors import LowPass
from wt_gym.simulation import Signals

if TYPE_CHECKING:
    from numpy.typing import NDArray

__all__ = ["TIME_CONSTANT", "PitchGain"]

TIME_CONSTANT = 10.0
"""Of the mean about which deviations are multiplied [s]."""


class PitchGain:
    """Blades that move by a factor times the deviation of their demands from the recent mean.

    Parameters
    ----------
    gain : float
        g [-].

    Attributes
    ----------
    gain : float
    mean : float
        Filtered mean of the demands on all blades [rad].
    """

    def __init__(self, gain: float):
        if not gain > 0.0:
            raise ValueError(f"the gain of the pitch must be positive, got {gain!r}")
        self.gain, self._mean = gain, LowPass(TIME_CONSTANT)

    @property
    def mean(self) -> float:
        """Filtered mean of the demands on all blades [rad]."""
        return self._mean.value

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
        read = Signals(signals.values.copy(), signals.n_blades)
        for name in ("pitch", "pitch_command"):
            read.set(name, self.mean + (signals[name] - self.mean) / self.gain)
        read.set("pitch_rate", signals["pitch_rate"] / self.gain)
        return read
