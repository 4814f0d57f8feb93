"""The power that a grid operator asks for: drawn courses, and those of the user.

A drawn course is a level, over the power that the mean wind of the episode allows (at most rated), and what moves
about it by no more than a span:

- ``reserve``: nothing does;
- ``steps``: another power, drawn evenly, after times drawn evenly between a half and one and a half of the interval;
- ``ramps``: the same powers, to which the course ramps with `RAMP_RATE` of rated power a second; the times are those
  between beginnings, and a ramp that has not ended when the next one begins is broken off;
- ``regulation``: the signal of an automatic generation control as fast units get it (PJM's RegD is one): noise between
  two corner frequencies, so that it moves within seconds, and over minutes asks for no energy; a value every two
  seconds, linear between them, cut off at the span where it saturates.

Courses are drawn from the random numbers of the episode, so that a seed repeats them.
"""

from __future__ import annotations

import csv
import math
from bisect import bisect_right
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from wt_gym.envs.options.grid import checked_reference
from wt_gym.envs.rewards.power import available_power

if TYPE_CHECKING:
    from collections.abc import Sequence
    from typing import Self

    from wt_gym.envs.options.grid import GridOptions
    from wt_gym.envs.wind_sampler import EpisodeWind
    from wt_gym.turbines import Turbine

__all__ = ["AHEAD", "DRAWN", "RAMP_RATE", "PowerReference", "PowerReferenceDraws"]

AHEAD = (2.0, 5.0, 10.0)
"""Times for which the reference is known in advance [s]: a schedule, not a regulation signal, is."""
DRAWN = 3600.0
"""Length of a drawn course [s]; its last value is held."""
LEAST_WIND = 1.0
"""Mean wind for whose power is asked in a weaker one [m/s]."""
RAMP_RATE = 0.01
"""Of ramps, over rated power [1/s]."""
REGULATION_STEP = 2.0
"""Between values of a regulation signal [s]."""
FAST, SLOW = 2.0 * math.pi / 60.0, 2.0 * math.pi / 900.0
"""Corner frequencies of a regulation signal [rad/s]: of its low-pass and its high-pass filter."""
_DEVIATION = 0.5
"""Standard deviation of a regulation signal before it is cut off, over the span [-]."""


@dataclass(frozen=True)
class PowerReference:
    """Power over time, linear between its points; at a step the later value holds.

    Attributes
    ----------
    kind : str
        ``"series"`` for one of the user's.
    times : tuple of float
        Not falling [s].
    powers : tuple of float
        [W].
    """

    kind: str
    times: tuple[float, ...]
    powers: tuple[float, ...]

    def __deepcopy__(self, memo: dict[int, Any]) -> Self:
        return self  # never changes

    def at(self, time: float) -> float:
        """Power at a time [W]; before the first point and behind the last one theirs."""
        times, powers = self.times, self.powers
        k = bisect_right(times, time)
        if k == 0:
            return powers[0]
        if k == len(times):
            return powers[-1]
        begin, end = times[k - 1], times[k]
        return powers[k - 1] + (time - begin) / (end - begin) * (powers[k] - powers[k - 1])

    @classmethod
    def of_rows(cls, rows: Sequence[tuple[float, float]]) -> Self:
        """Course of rows of time [s] and power [W]."""
        times, powers = zip(*rows, strict=True)
        return cls("series", tuple(map(float, times)), tuple(map(float, powers)))


def _rows_of_file(path: str) -> Any:
    """Rows of a CSV file of two columns, with a head or without one.

    Raises
    ------
    ValueError
        If it holds none, or other ones.
    """
    with open(path, newline="", encoding="utf-8") as file:
        lines = [line for line in csv.reader(file) if line and not line[0].lstrip().startswith("#")]
    if lines and not _numeric(lines[0]):
        lines = lines[1:]
    bad = next((line for line in lines if len(line) != 2 or not _numeric(line)), None)
    if bad is not None or not lines:
        raise ValueError(f"power_reference: {path} must hold rows of time [s] and power [W], got {bad or 'none'}")
    return checked_reference([[float(value) for value in line] for line in lines])


def _numeric(line: list[str]) -> bool:
    try:
        return all(math.isfinite(float(value)) for value in line)
    except ValueError:
        return False


class PowerReferenceDraws:
    """Draws the power reference of episodes.

    Parameters
    ----------
    turbine : Turbine
    options : GridOptions
        With a reference.

    Raises
    ------
    OSError
        If a file cannot be read.
    ValueError
        If a file has no meaning.
    """

    def __init__(self, turbine: Turbine, options: GridOptions):
        self._turbine, self._options = turbine, options
        self._given = self._choice(options.reference)

    def _choice(self, reference: Any) -> PowerReference | tuple[str, ...]:
        checked = checked_reference(reference)
        self._options.check_span(checked)
        if isinstance(checked, str):
            checked = _rows_of_file(checked)
        if isinstance(checked[0], str):
            return checked
        return PowerReference.of_rows(checked)

    def mean_share(self, wind_speed: float) -> float:
        """Mean power that is asked for in a wind [m/s], over rated power [-].

        Of drawn courses that is the middle of the levels times what the wind allows, of a course of the user the mean
        of its powers, whatever the wind.
        """
        if isinstance(self._given, PowerReference):
            mean = float(np.mean(self._given.powers))
        else:
            mean = float(np.mean(self._options.level)) * self._full(wind_speed)
        return mean / self._turbine.drivetrain.rated_power

    def _full(self, wind_speed: float) -> float:
        """What a mean wind [m/s] allows, never nothing: a demand of 0 W is none in the Bladed interface [W]."""
        return available_power(self._turbine, max(wind_speed, LEAST_WIND))

    def draw(self, rng: np.random.Generator, wind: EpisodeWind, chosen: Any = None) -> PowerReference:
        """Draw the reference of an episode.

        Parameters
        ----------
        rng : numpy.random.Generator
            One number is drawn of it, whatever the kind.
        wind : EpisodeWind
            Its seed and speed decide too: the same random numbers give another reference in another wind.
        chosen : object, optional
            In place of the reference of the options.

        Raises
        ------
        ValueError
            If what is chosen has no meaning.
        """
        seed = int(rng.integers(2**63))
        given = self._given if chosen is None else self._choice(chosen)
        if isinstance(given, PowerReference):
            return given
        own = np.random.default_rng((seed, max(wind.wind_seed, -1) + 1, round(1e3 * float(wind.wind_speed))))
        kind = given[int(own.integers(len(given)))]
        full = self._full(float(wind.wind_speed))
        low, high = cast("tuple[float, float]", self._options.level)
        level, span = full * own.uniform(low, high), full * self._options.span
        times, shares = self._course(kind, own, span)
        return PowerReference(kind, tuple(times), tuple((level + span * np.asarray(shares)).tolist()))

    def _course(self, kind: str, rng: np.random.Generator, span: float) -> tuple[list[float], list[float]]:
        """Times [s] and deviations over the span."""
        if kind == "reserve":
            return [0.0], [0.0]
        if kind == "regulation":
            return regulation_signal(rng)
        rate = RAMP_RATE * self._turbine.drivetrain.rated_power
        times, shares, begin = [0.0], [rng.uniform(-1.0, 1.0)], 0.0
        while begin < DRAWN:
            begin += self._options.interval * rng.uniform(0.5, 1.5)
            if begin < times[-1]:  # in the midst of a ramp, which ends where it has come to
                part = (begin - times[-2]) / (times[-1] - times[-2])
                shares[-1] = shares[-2] + part * (shares[-1] - shares[-2])
                times[-1] = begin
            else:
                times.append(begin)
                shares.append(shares[-1])
            level = rng.uniform(-1.0, 1.0)
            takes = 0.0 if kind == "steps" else abs(level - shares[-1]) * span / rate
            times.append(begin + takes)
            shares.append(level)
        return times, shares


def regulation_signal(rng: np.random.Generator) -> tuple[list[float], list[float]]:
    """Draw a regulation signal.

    Parameters
    ----------
    rng : numpy.random.Generator

    Returns
    -------
    times : list of float
        [s].
    shares : list of float
        Within -1 and 1 [-].
    """
    count = round(DRAWN / REGULATION_STEP) + 1
    settled = round(4.0 / SLOW / REGULATION_STEP)
    noise = rng.standard_normal(settled + count)
    fast, slow = -math.expm1(-FAST * REGULATION_STEP), -math.expm1(-SLOW * REGULATION_STEP)
    first = second = mean = 0.0
    found = []
    for value in noise.tolist():
        first += fast * (value - first)
        second += fast * (first - second)
        mean += slow * (second - mean)
        found.append(second - mean)
    # deviation of white noise behind two equal low-pass filters; what the high-pass takes off is small
    keep = (1.0 - fast) ** 2
    deviation = math.sqrt(fast**4 * (1.0 + keep) / (1.0 - keep) ** 3)
    signal = np.clip(_DEVIATION / deviation * np.array(found[settled:]), -1.0, 1.0)
    return (REGULATION_STEP * np.arange(count)).tolist(), signal.tolist()
