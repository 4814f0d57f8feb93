"""A class of the user that gives set points, as users of ROSCO write them for its server."""

from __future__ import annotations

import math
from dataclasses import astuple, fields
from typing import TYPE_CHECKING, Any, Protocol

from wt_gym.base.errors import ControllerError
from wt_gym.bridges.rosco import READINGS, SET_POINTS, Message, SetPoints

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

__all__ = ["GivesSetPoints", "OwnSetPoints", "readings_by_name"]

_DEGREES = tuple(field.name for field in (*READINGS, *SET_POINTS) if field.unit == "deg")


class GivesSetPoints(Protocol):
    """What ROSCO's server takes as a wind-farm controller."""

    def update_setpoints(
        self, turbine_id: int, current_time: float, measurements: Mapping[str, float], /
    ) -> Mapping[str, float]:
        """Set points by ROSCO's names and in its units from readings by its names; what is left out is neutral."""
        ...


def readings_by_name(message: Message) -> dict[str, float]:
    """Readings by ROSCO's names and in its units."""
    values: list[float] = []
    for value in astuple(message):
        values += value if isinstance(value, tuple) else [value]
    named = {field.name: float(value) for field, value in zip(READINGS, values, strict=True)}
    return named | {name: math.degrees(named[name]) for name in _DEGREES if name in named}


class OwnSetPoints:
    """Set points of a class with ``update_setpoints(id, time, measurements)``, one object for all turbines.

    Parameters
    ----------
    make : callable
        Makes the object.

    Raises
    ------
    wt_gym.base.errors.ControllerError
        If it has no such method.
    """

    def __init__(self, make: Callable[[], Any]):
        self._own: GivesSetPoints = make()
        if not callable(getattr(self._own, "update_setpoints", None)):
            raise ControllerError(f"{self._own!r} must have update_setpoints(id, time, measurements)")

    def answer(self, message: Message) -> SetPoints:
        """Set points for a turbine from its readings.

        Raises
        ------
        wt_gym.base.errors.ControllerError
            If one has another name, or is not finite.
        """
        given = self._own.update_setpoints(message.turbine_id, message.time, readings_by_name(message))
        names = {field.name: own.name for field, own in zip(SET_POINTS, fields(SetPoints), strict=True)}
        if unknown := [name for name in given if name not in names]:
            raise ControllerError(f"set points must be among {', '.join(names)}, got {', '.join(unknown)}")
        if wrong := [f"{name} = {value!r}" for name, value in given.items() if not math.isfinite(value)]:
            raise ControllerError(f"set points must be finite, got {', '.join(wrong)}")
        return SetPoints(**{names[k]: math.radians(v) if k in _DEGREES else float(v) for k, v in given.items()})

    def forget(self, turbine_id: int) -> None:
        """Turbines are remembered by the object alone."""
