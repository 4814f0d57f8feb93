"""Files of TurbSim (``.bts``) as the wind of episodes: looked through once, read where an episode begins in one."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

from wt_gym.errors import InflowError
from wt_gym.wind import TurbulenceBox, TurbulentInflow

__all__ = ["WindFile", "is_wind_file", "wind_files_of", "with_whole_paths"]

_SUFFIX = ".bts"
# A file of ten minutes takes some ten to a hundred megabytes in memory.
_BOXES_IN_MEMORY = 8


def is_wind_file(value: Any) -> bool:
    """Whether an argument is the path of a file of wind, by its suffix."""
    return isinstance(value, str | os.PathLike) and os.fspath(value)[-len(_SUFFIX) :] in (_SUFFIX, _SUFFIX.upper())


def with_whole_paths(arguments: Mapping[str, Any]) -> dict[str, Any]:
    """Arguments of an environment in which the files of wind have whole paths, as texts.

    They then mean the same files in JSON, in other processes and in other working directories.

    Parameters
    ----------
    arguments : mapping
        Of `wt_gym.envs.turbine_env.WindTurbineEnv`.

    Returns
    -------
    dict
    """
    given: Any = arguments.get("inflow")
    if is_wind_file(given):
        return {**arguments, "inflow": os.path.abspath(given)}
    if isinstance(given, list | tuple):
        return {**arguments, "inflow": [os.path.abspath(one) if is_wind_file(one) else one for one in given]}
    return dict(arguments)


def wind_files_of(arguments: Mapping[str, Any]) -> dict[str, str]:
    """Digests of the files of wind among the arguments of an environment, by their whole paths.

    Raises
    ------
    InflowError
        If one cannot be read.
    """
    given: Any = arguments.get("inflow")
    return {os.path.abspath(one): _digest(one) for one in (given if isinstance(given, list | tuple) else [given])
            if is_wind_file(one)}  # fmt: skip


def _digest(path: str | os.PathLike) -> str:
    try:
        return hashlib.sha256(Path(path).read_bytes()).hexdigest()[:16]
    except OSError as error:
        raise InflowError(f"{os.fspath(path)} cannot be read: {error.strerror}") from error


@dataclass(frozen=True)
class WindFile:
    """A file of wind that was found whole.

    Attributes
    ----------
    path : str
        Whole.
    mean_speed : float
        At the hub [m/s].
    hub_height : float
        [m].
    description : str
    duration : float
        Length of the record [s].
    periodic : bool
        Whether its end leads smoothly to its beginning.
    """

    path: str
    mean_speed: float
    hub_height: float
    description: str
    duration: float
    periodic: bool

    @classmethod
    def found(cls, path: str | os.PathLike) -> WindFile:
        """Look through a file, unless this process has done so and the file is as it was.

        Raises
        ------
        InflowError
            If it is missing or damaged; the message names it.
        """
        whole = os.path.abspath(path)
        return _found(whole, _state(whole))

    def inflow(self, time_offset: float) -> TurbulentInflow:
        """The wind from a time in the record [s] on.

        Raises
        ------
        InflowError
            If the file has gone or was damaged since, or the time is no number.
        """
        return TurbulentInflow(_box(self.path, _state(self.path)), time_offset=time_offset)

    def latest_start(self, length: float | None) -> float:
        """Time in the record before which an episode can begin [s].

        A periodic record can be entered anywhere. One that is not jumps at its end, which no gust does: episodes begin
        early enough to be over by then at the rotor, and at its beginning where their length is not known. What lies
        far ahead of the rotor or behind it, for a lidar or the wake, meets the jump the time of its way earlier or
        later.

        Parameters
        ----------
        length : float or None
            Of the episode [s].
        """
        if self.periodic:
            return self.duration
        return 0.0 if length is None else max(0.0, self.duration - length)


def _state(path: str) -> tuple[int, int] | None:
    """What tells of a change of a file, None where there is none."""
    try:
        found = Path(path).stat()
    except OSError:  # reading it says why
        return None
    return found.st_mtime_ns, found.st_size


@lru_cache(maxsize=1024)
def _found(path: str, state: tuple[int, int] | None) -> WindFile:
    box = _box(path, state)
    return WindFile(path, box.mean_speed, box.hub_height, box.description, box.duration, box.periodic)


@lru_cache(maxsize=_BOXES_IN_MEMORY)
def _box(path: str, state: tuple[int, int] | None) -> TurbulenceBox:
    """Read a file; ``state`` has a file that was changed read again."""
    try:
        box = TurbulenceBox.from_bts(path)
    except InflowError as error:
        raise InflowError(" ".join(str(error).split())) from error
    return replace(box, description=f"{Path(path).name}: {box.description}")
