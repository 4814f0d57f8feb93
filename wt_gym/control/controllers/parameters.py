"""What a parameter of a controller is: name, unit, allowed values and meaning, declared once beside the controller.

A module with a controller declares its parameters as ``PARAMETERS``. The default is that of the function that takes the
parameter, so that it stands nowhere twice. `wt_gym.control.controllers.catalogue` joins both to one table, from which
the words ``name:key=value`` are checked and which the command ``wt-gym list controllers`` and the documentation print.
"""

from __future__ import annotations

import inspect
import math
import numbers
import os
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    from wt_gym.turbines import Turbine

__all__ = ["PATH", "Parameter", "with_defaults"]

PATH = "a path"
"""What words stand for that name files."""


@dataclass(frozen=True)
class Parameter:
    """A parameter of a controller.

    Attributes
    ----------
    name : str
    unit : str
        Of its value, "-" where it has none.
    meaning : str
    low, high : float
        Least and greatest number.
    above : bool
        Whether the number must be above ``low``, not at least ``low``.
    otherwise : str
        What holds where the default is None.
    in_use : callable or None
        Value that a turbine's controller has where the default is None, from the turbine; None where it has none.
    switch : bool
        Whether True and False are allowed.
    kind : str
        Name of a class whose objects are allowed too, from Python only; "" for none.
    only_object : bool
        Whether no number is allowed, only such an object, a switch or a word.
    only_of : callable or None
        Whether the controller of a turbine takes it, from the turbine; None where that of every turbine does.
    word : str
        What a word stands for, as "a path"; "" where no word is allowed.
    default : object
        Of the function that takes the parameter.
    """

    name: str
    unit: str
    meaning: str
    low: float = -math.inf
    high: float = math.inf
    above: bool = False
    otherwise: str = ""
    in_use: Callable[[Turbine], float | None] | None = None
    switch: bool = False
    kind: str = ""
    only_object: bool = False
    only_of: Callable[[Turbine], bool] | None = None
    word: str = ""
    default: Any = inspect.Parameter.empty

    def taken(self, turbine: Turbine | None) -> bool:
        """Whether the controller of a turbine takes it; without a turbine, whether that of any does."""
        return turbine is None or self.only_of is None or self.only_of(turbine)

    @property
    def allowed(self) -> str:
        """Allowed values in words."""
        unit = "" if self.unit == "-" else f" {self.unit}"
        words = []
        if self.switch:
            words += ["True", "False"]
        if self.word:
            words.append(self.word)
        elif not self.only_object:
            words.append(f"a number {_range(self.low, self.high, self.above)}{unit}".replace("  ", " "))
        if self.kind:
            words.append(f"a {self.kind} (from Python)")
        if self.default is None:
            words.append(f"None ({self.otherwise})" if self.otherwise else "None")
        return words[0] if len(words) == 1 else f"{', '.join(words[:-1])} or {words[-1]}"

    def default_text(self, turbine: Turbine | None = None) -> str:
        """Default in words; of a turbine where it follows from the turbine.

        Angles in degrees behind the radians.
        """
        value = self.default
        if value is None and turbine is not None and self.in_use is not None:
            value = self.in_use(turbine)
        if value is None:
            return self.otherwise or "None"
        if isinstance(value, bool) or not isinstance(value, numbers.Real):
            return str(value)
        degrees = f" ({math.degrees(value):.4g}°)" if self.unit == "rad" and value else ""
        return f"{value:.4g}{degrees}"

    def check(self, value: Any, controller: str) -> None:
        """Refuse a value that is not allowed.

        Parameters
        ----------
        value : object
        controller : str
            Name of the controller, for the message.

        Raises
        ------
        ValueError
            With what is given and what is allowed.
        """
        if value is None and self.default is None:
            return
        if isinstance(value, bool):
            fits = self.switch
        elif isinstance(value, str | os.PathLike):
            fits = bool(self.word)
        elif isinstance(value, numbers.Real):
            number = float(value)
            fits = not (self.only_object or self.word) and math.isfinite(number) and self.low <= number <= self.high
            fits = fits and not (self.above and number == self.low)
        else:
            fits = bool(self.kind) and type(value).__name__ == self.kind
        if not fits:
            raise ValueError(
                f"{self.name} of controller {controller!r} must be {self.allowed}, got {value!r} ({self.meaning})"
            )


def _range(low: float, high: float, above: bool) -> str:
    """A range in words."""
    if low == -math.inf and high == math.inf:
        return ""
    if high == math.inf:
        return f"above {low:.4g}" if above else f"of at least {low:.4g}"
    return f"above {low:.4g} up to {high:.4g}" if above else f"from {low:.4g} to {high:.4g}"


def with_defaults(parameters: Iterable[Parameter], *makers: Callable[..., Any]) -> tuple[Parameter, ...]:
    """Give parameters the defaults of the functions that take them; the first that knows one counts.

    Raises
    ------
    TypeError
        If no function takes a parameter.
    """
    found: dict[str, Any] = {}
    for maker in makers:
        for key, taken in inspect.signature(maker).parameters.items():
            if taken.kind is not inspect.Parameter.VAR_KEYWORD:
                found.setdefault(key, taken.default)
    missing = [parameter.name for parameter in parameters if parameter.name not in found]
    if missing:
        raise TypeError(f"{', '.join(missing)}: declared, but no parameter of {', '.join(map(repr, makers))}")
    return tuple(replace(parameter, default=found[parameter.name]) for parameter in parameters)
