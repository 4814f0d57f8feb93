"""One line that tells how far a long job is, on standard error."""

from __future__ import annotations

import sys
import time
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable

__all__ = ["ProgressLine", "TimeLeft", "clock"]


def clock(seconds: float) -> str:
    """Minutes and seconds, as ``3:05``."""
    minutes, rest = divmod(int(seconds), 60)
    return f"{minutes}:{rest:02d}"


class ProgressLine:
    """Shows a line now and then: rewritten in place on a terminal, one under the other elsewhere.

    Parameters
    ----------
    shown : bool
        False keeps it silent.
    interval : float
        Least time between two lines [s]; on a terminal a tenth of it.
    """

    def __init__(self, shown: bool = True, interval: float = 5.0):
        self._shown, self._terminal = shown, sys.stderr.isatty()
        self._interval = 0.1 * interval if self._terminal else interval
        self._last, self._width = -1e9, 0

    def show(self, text: str | Callable[[], str], *, final: bool = False) -> None:
        """Show a text, or what a function gives, if it is time to, and in any case if it is the final one."""
        now = time.monotonic()
        if not self._shown or (now - self._last < self._interval and not final):
            return
        self._last, text = now, text if isinstance(text, str) else text()
        if self._terminal:
            print("\r" + text.ljust(self._width), end="\n" if final else "", file=sys.stderr, flush=True)
            self._width = 0 if final else len(text)
        else:
            print(text, file=sys.stderr, flush=True)


class TimeLeft:
    """Time that is left of several jobs of equal length, from now on.

    Parameters
    ----------
    total : int
        Number of jobs.
    """

    def __init__(self, total: int):
        self._total, self._began = total, time.monotonic()

    def text(self, done: int) -> str:
        """Tell how many jobs are done, and the time of those and of the others."""
        passed = time.monotonic() - self._began
        left = passed / done * (self._total - done)
        return f"{done}/{self._total} after {clock(passed)} min, about {clock(left)} min left"
