"""Warnings that are printed once in a process.

Python prints a warning once for each place, and again after any library has changed the filters of warnings.
"""

from __future__ import annotations

import warnings

_messages: set[str] = set()


def warn_once(message: str, stacklevel: int = 1) -> None:
    """Warn, unless the same message has been given in this process.

    The message names its turbine, so that another turbine has another one; ``stacklevel`` is as of `warnings.warn`,
    counted from the caller.
    """
    if message not in _messages:
        warnings.warn(message, stacklevel=stacklevel + 1)
        _messages.add(message)  # not where a filter has made an error of it


def forget_warnings() -> None:
    """Give all warnings again, for tests."""
    _messages.clear()
