"""Exceptions raised at the doors of wt_gym, which name what was given, what is allowed and where, and warnings."""

import difflib
import re
import warnings
from collections.abc import Iterable

__all__ = [
    "ActionError", "BenchmarkError", "ControllerError", "InflowError", "ServerError", "SimulationError",
    "TurbineDefinitionError", "WtGymError", "did_you_mean", "plain_numbers", "warn_once",
]  # fmt: skip

_NUMPY_SCALAR = re.compile(r"\bnp\.(?:\w+\(([^()]*)\)|(True|False)_)")
"""Representation of a scalar of NumPy: np.float64(1.0), np.str_('a'), np.True_."""
_warnings: set[str] = set()


class WtGymError(Exception):
    """Base class of every exception this package raises on purpose.

    Scalars of NumPy in the message read as plain numbers: 1.0 for np.float64(1.0).
    """

    def __init__(self, *args: object) -> None:
        super().__init__(*(plain_numbers(arg) if isinstance(arg, str) else arg for arg in args))


class TurbineDefinitionError(WtGymError, ValueError):
    """A turbine file or dataclass is incomplete, inconsistent or out of range."""


class InflowError(WtGymError, ValueError):
    """An inflow was asked for that cannot be built or evaluated."""


class ActionError(WtGymError, ValueError):
    """An action or command has the wrong shape, is not finite or lies outside its space."""


class ControllerError(WtGymError, ValueError):
    """A controller gave a demand that the turbine cannot be asked for; the controller is to be mended, no action."""


class BenchmarkError(WtGymError, ValueError):
    """A task, a result or a reference of the benchmark is unknown, damaged, or does not belong to the others."""


class SimulationError(WtGymError, RuntimeError):
    """The simulation left the range in which it has meaning (divergence, tower strike, broken state)."""


class ServerError(WtGymError, RuntimeError):
    """A server cannot listen at its address, or hears nothing for too long."""


def plain_numbers(text: str) -> str:
    """Return a message in which scalars of NumPy read as plain numbers."""
    return _NUMPY_SCALAR.sub(r"\1\2", text)


def did_you_mean(name: object, known: Iterable[str], otherwise: str = "") -> str:
    """End of a message about an unknown name, which asks for the known name that it resembles most.

    Where no name is near, ``otherwise`` stands there: a full stop where the message continues.

    Examples
    --------
    >>> did_you_mean("sped", ["speed", "shear"])
    "; did you mean 'speed'?"
    """
    names = {one.lower(): one for one in known}
    near = difflib.get_close_matches(str(name).lower(), names, 1)
    return f"; did you mean {names[near[0]]!r}?" if near else otherwise


def warn_once(message: str, stacklevel: int = 1) -> None:
    """Warn, unless the same message has been given in this process.

    Python prints a warning once for each place, and again after any library has changed the filters of warnings. The
    message names its turbine, so that another turbine has another one; ``stacklevel`` is as of `warnings.warn`, counted
    from the caller.
    """
    if message not in _warnings:
        warnings.warn(message, stacklevel=stacklevel + 1)
        _warnings.add(message)  # not where a filter has made an error of it


def forget_warnings() -> None:
    """Give all warnings again, for tests."""
    _warnings.clear()
