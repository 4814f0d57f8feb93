"""The time of messages whose times have seven digits: exact where they come at even intervals."""

from __future__ import annotations

import math

__all__ = ["MessageClock", "rounding"]

_EVEN = 0.05
"""By which share an interval may differ from the one before and still be the same."""


def rounding(time: float) -> float:
    """Greatest error of a time as ROSCO writes it, half a unit of its seventh digit [s]."""
    return 0.5 * 10.0 ** (math.floor(math.log10(abs(time))) - 6) if time else 0.0


class MessageClock:
    """Time and interval of messages.

    Parameters
    ----------
    time : float
        Of the first message [s].

    Attributes
    ----------
    time : float
        Of the last message [s].
    interval : float or None
        Between messages [s]; None before the second one.
    """

    def __init__(self, time: float):
        self.time = self._begin = time
        self.interval: float | None = None
        self._count = 0

    def continues(self, time: float, longest: float) -> bool:
        """Whether a time lies behind the last one by at most so much [s], as far as its digits tell."""
        return (
            -2.0 * rounding(time)
            <= time - self.time
            <= max(longest, 10.0 * (self.interval or 0.0)) + 2.0 * rounding(time)
        )

    def tick(self, time: float) -> bool:
        """Take the time of a message; whether the interval is a new one."""
        elapsed = time - self.time
        if self.interval is not None and abs(elapsed - self.interval) <= _EVEN * self.interval + 2.0 * rounding(time):
            self._count += 1
            if abs(self._begin + self._count * self.interval - time) > rounding(time) + rounding(self._begin):
                self.interval = (time - self._begin) / self._count  # which more messages tell more exactly
            self.time = self._begin + self._count * self.interval
            return False
        if elapsed <= 2.0 * rounding(time):  # the same message again
            return False
        self.interval, self._begin, self._count, self.time = elapsed, self.time, 1, time
        return True
