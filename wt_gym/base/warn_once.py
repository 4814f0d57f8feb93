"""Warnings that are printed once in a process.

Python prints a warning once for each place, and again after any library has changed the filters of warnings.
"""

from __future__ import annotations

import warnings

__all__ = ["forget_warnings", "warn_once"]

_messages: set[str] = set()


def warn_once(message: str, stacklevel: int = 1) -> None:
    """Warn, unless the same message has been given in this process.

    Parameters
    ----------
    message : str
        It names its turbine, so that another turbine has another message.
    stacklevel : int
        As of `warnings.warn`, counted from the caller.
    """
    if message not in _messages:
        warnings.warn(message, stacklevel=stacklevel + 1)
        _messages.add(message)  # not where a filter has made an error of it


def forget_warnings() -> None:
    """Give all warnings again, for tests."""
    _messages.clear()
