"""Files of wind as the wind of episodes: looked through once, read where an episode begins in one."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any, cast

from wt_gym.base.errors import InflowError
from wt_gym.envs.options.environment import flat_arguments
from wt_gym.envs.options.wind import is_wind_file
from wt_gym.wind import SeriesInflow, TurbulentInflow, wind_from
from wt_gym.wind.files import SUFFIXES, files_of, is_wind_path, whole_description
from wt_gym.wind.inflow import require_cover

__all__ = ["SUFFIXES", "WindFile", "is_wind_file", "wind_files_of", "with_whole_paths"]

# A file of ten minutes takes some ten to a hundred megabytes in memory.
_WINDS_IN_MEMORY = 8


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

    Raises
    ------
    InflowError
        If a mapping names no files.
    """
    arguments = _with_inflow(arguments)
    given: Any = arguments.get("inflow")
    if isinstance(given, list | tuple):
        return {**arguments, "inflow": [_whole(one) for one in given]}
    return {**arguments, "inflow": _whole(given)} if is_wind_file(given) else dict(arguments)


def _with_inflow(arguments: Mapping[str, Any]) -> Mapping[str, Any]:
    """Arguments by their flat names where the wind is a group."""
    return flat_arguments(arguments) if "wind" in arguments else arguments


def _whole(given: Any) -> Any:
    if is_wind_path(given):
        return os.path.abspath(given)
    return whole_description(given) if is_wind_file(given) else given


def wind_files_of(arguments: Mapping[str, Any]) -> dict[str, str]:
    """Digests of the files of wind among the arguments of an environment, by their whole paths.

    Raises
    ------
    InflowError
        If one cannot be read.
    """
    given: Any = _with_inflow(arguments).get("inflow")
    described = [one for one in (given if isinstance(given, list | tuple) else [given]) if is_wind_file(one)]
    paths = [os.path.abspath(one) for one in described if is_wind_path(one)]
    paths += [path for one in described for path in files_of(whole_description(one))]
    return {path: _digest(path) for path in dict.fromkeys(paths)}


def _digest(path: str) -> str:
    try:
        return hashlib.sha256(Path(path).read_bytes()).hexdigest()[:16]
    except OSError as error:
        raise InflowError(f"{path} cannot be read: {error.strerror}") from error


@dataclass(frozen=True)
class WindFile:
    """A file of wind that was found whole.

    Attributes
    ----------
    key : str
        Its whole description, as JSON.
    turbine_size : (float, float)
        Hub height and rotor diameter of the turbine that it is for [m].
    mean_speed : float
        At the hub [m/s].
    hub_height : float
        [m].
    description : str
    duration : float
        Length of the record [s].
    periodic : bool
        Whether its end leads smoothly to its beginning.
    is_series : bool
        Whether it is the course of an event, which an episode meets from its beginning.
    """

    key: str
    turbine_size: tuple[float, float]
    mean_speed: float
    hub_height: float
    description: str
    duration: float
    periodic: bool
    is_series: bool

    @classmethod
    def found(
        cls, given: str | os.PathLike[str] | Mapping[str, Any], hub_height: float, rotor_diameter: float
    ) -> WindFile:
        """Look through a file, unless this process has done so and the file is as it was.

        Raises
        ------
        InflowError
            If it is missing or damaged, or its grid does not reach around the rotor; the message names it.
        """
        whole = whole_description(given)
        try:
            key = json.dumps(whole, sort_keys=True)
        except TypeError as error:
            raise InflowError(f"the description of a wind must be numbers, texts and lists of them: {error}") from error
        size = float(hub_height), float(rotor_diameter)
        found = _found(key, _state(key), size)
        require_cover(found.inflow(0.0), *size)
        return found

    @property
    def path(self) -> str:
        """Whole path, of several files the first."""
        return files_of(json.loads(self.key))[0]

    def inflow(self, time_offset: float) -> TurbulentInflow | SeriesInflow:
        """The wind from a time in the record [s] on.

        Raises
        ------
        InflowError
            If the file has gone or was damaged since, or the time is not a number.
        """
        wind = _wind(self.key, _state(self.key), self.turbine_size)
        return replace(wind, time_offset=wind.time_offset + time_offset)

    def latest_start(self, length: float | None) -> float:
        """Time in the record before which an episode can begin [s].

        A periodic record can be entered anywhere. One that is not jumps at its end, which no gust does: episodes begin
        early enough to be over by then at the rotor, and at its beginning where their length is not known. What lies
        far ahead of the rotor or behind it, for a lidar or the wake, meets the jump the time of its way earlier or
        later. A series is met from its beginning.

        Parameters
        ----------
        length : float or None
            Of the episode [s].
        """
        if self.is_series:
            return 0.0
        if self.periodic:
            return self.duration
        return 0.0 if length is None else max(0.0, self.duration - length)


def _state(key: str) -> tuple[tuple[int, int] | None, ...]:
    """What tells of a change of the files, None where there is none."""
    return tuple(_state_of(path) for path in files_of(json.loads(key)))


def _state_of(path: str) -> tuple[int, int] | None:
    try:
        found = Path(path).stat()
    except OSError:  # reading it says why
        return None
    return found.st_mtime_ns, found.st_size


@lru_cache(maxsize=1024)
def _found(key: str, state: tuple[Any, ...], size: tuple[float, float]) -> WindFile:
    wind = _wind(key, state, size)
    of_all = key, size, wind.mean_speed, wind.hub_height, wind.description
    if isinstance(wind, SeriesInflow):
        return WindFile(*of_all, wind.duration, periodic=False, is_series=True)
    return WindFile(*of_all, wind.box.duration, wind.box.periodic, is_series=False)


@lru_cache(maxsize=_WINDS_IN_MEMORY)
def _wind(key: str, state: tuple[Any, ...], size: tuple[float, float]) -> TurbulentInflow | SeriesInflow:
    """Read a file; ``state`` has a file that was changed read again."""
    try:
        wind = wind_from(json.loads(key), *size)
    except InflowError as error:
        raise InflowError(" ".join(str(error).split())) from error
    return cast("TurbulentInflow | SeriesInflow", wind)
