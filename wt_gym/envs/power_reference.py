"""The power that a grid operator asks for: options, drawn courses and those of the user, channels, reward term.

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
import os
from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any, ClassVar, Self, cast

import numpy as np

from wt_gym.base.errors import did_you_mean
from wt_gym.base.options import Options, as_pair, option, option_record, options_of, shown
from wt_gym.control import Channel
from wt_gym.control.design import rotor_inertia
from wt_gym.envs.channels import Observed, Situation
from wt_gym.envs.power import available_power, efficiency
from wt_gym.envs.terms import Request, Term, Transition
from wt_gym.envs.wind_sampler import EpisodeWind
from wt_gym.simulation import Signals
from wt_gym.turbines import Turbine

if TYPE_CHECKING:
    from wt_gym.envs.operation import Operation

AHEAD = (2.0, 5.0, 10.0)
"""Times for which the reference is known in advance [s]: a schedule, not a regulation signal, is."""
DRAWN = 3600.0
"""Length of a drawn course [s]; its last value is held."""
LEAST_WIND = 1.0
"""Mean wind for whose power is asked in a weaker one [m/s]."""
RAMP_RATE = 0.01
"""Rate of ramps, over rated power [1/s]."""
REGULATION_STEP = 2.0
"""Time between values of a regulation signal [s]."""
FAST, SLOW = 2.0 * math.pi / 60.0, 2.0 * math.pi / 900.0
"""Corner frequencies of a regulation signal [rad/s]: of its low-pass and its high-pass filter."""
_DEVIATION = 0.5  # Standard deviation of a regulation signal before it is cut off, over the span [-]
REFERENCE_KINDS = ("reserve", "steps", "ramps", "regulation")
"""Courses of the power reference that are drawn for each episode."""
MOVING_KINDS = ("steps", "ramps", "regulation")
"""Those of them that have a span."""
LEAST_LEVEL = 0.2
"""Least power that is asked for, over what the mean wind allows [-]."""
_ROUNDING = 1e-9


def _checked_reference(reference: Any) -> Any:
    """Choice of courses: names as a tuple, a path as it is, rows as a tuple of pairs."""
    if isinstance(reference, os.PathLike) or (isinstance(reference, str) and reference.endswith(".csv")):
        return os.fspath(reference)
    names = (reference,) if isinstance(reference, str) else reference
    allowed = (
        f"must be among {', '.join(REFERENCE_KINDS)}, a .csv file, or finite rows of time [s] that does not fall and "
        "power [W], got "
    )
    if isinstance(names, list | tuple) and len(names) and all(isinstance(name, str) for name in names):
        if wrong := [name for name in names if name not in REFERENCE_KINDS]:
            raise ValueError(f"{allowed}{wrong[0]!r}{did_you_mean(wrong[0], REFERENCE_KINDS)}")
        return tuple(names)
    try:
        rows = np.asarray(reference, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        rows = np.empty(0)
    finite = rows.ndim == 2 and len(rows) and rows.shape[1] == 2 and np.isfinite(rows).all()
    if not finite or (np.diff(rows[:, 0]) < 0.0).any():
        raise ValueError(allowed + shown(reference))
    if (least := float(rows[:, 1].min())) <= 0.0:
        raise ValueError(
            f"must have powers above 0 W, got {least:g} W: controllers follow a demand no lower than 20 % of rated "
            "power, and 0 in record 13 of the Bladed interface means that nothing is demanded"
        )
    return tuple(map(tuple, rows.tolist()))


@option_record
class GridOptions(Options):
    """Demand of a grid operator: a power reference, see `wt_gym.envs.power_reference`."""

    title = "grid"
    switch = "reference"

    reference: str | os.PathLike[str] | Sequence[Any] | np.ndarray | None = option(
        'Demanded power. ``"reserve"``, a constant one; ``"steps"``, ``"ramps"``; ``"regulation"``, a '
        "band-limited signal of an automatic generation control; several of them: each episode draws one; or "
        "your own schedule: rows of time [s] and positive power [W] with linear interpolation and the ends held, as an "
        "array or as a CSV file (``.csv``). None: no demand",
        default=None,
        flat="power_reference",
        kind="str, path, sequence or array, optional",
        check=_checked_reference,
    )
    level: float | tuple[float, float] = option(
        "Mean of a drawn course over the power that the mean wind of the episode allows, at most rated power; a range "
        "is drawn from",
        default=(0.8, 0.9),
        flat="power_reference_level",
        unit="-",
        low=LEAST_LEVEL,
        high=1.0,
        check=as_pair,
    )
    span: float = option(
        "Greatest deviation of a drawn course from its mean, over the same power; the course stays within "
        f"{LEAST_LEVEL:g} and 1",
        default=0.1,
        flat="power_reference_span",
        unit="-",
        low=0.0,
    )
    interval: float = option(
        "Mean time between steps, and between the beginnings of ramps",
        default=20.0,
        flat="power_reference_interval",
        unit="s",
        low=1.0,
    )

    def check(self) -> None:
        """Refuse a span with which a course would leave its limits."""
        self.check_span(self.reference)

    def check_span(self, reference: Any) -> None:
        """As `check`, of another reference."""
        if not isinstance(reference, tuple) or not set(reference) & set(MOVING_KINDS):
            return
        low, high = as_pair(self.level)
        if low - self.span < LEAST_LEVEL - _ROUNDING or high + self.span > 1.0 + _ROUNDING:
            raise ValueError(
                f"power_reference_span must keep the course within {LEAST_LEVEL:g} and 1, got {self.span!r} about "
                f"levels of {low:g} to {high:g}"
            )


@dataclass(frozen=True)
class PowerReference:
    """Power over time, linear between its points; at a step the later value holds."""

    kind: str  #: ``"series"`` for one of the user's
    times: tuple[float, ...]  #: Not falling [s]
    powers: tuple[float, ...]  #: [W]

    def __deepcopy__(self, memo: dict[int, Any]) -> Self:
        return self  # never changes

    @property
    def key(self) -> Self:
        """Tells it from others."""
        return self

    def equip(self, operation: Operation) -> None:
        """Put it into the operation of a turbine."""
        operation.reference = self

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


def _rows_of_file(path: str) -> Any:
    """Rows of a CSV file of two columns, with a head or without one; a `ValueError` if it holds none, or other ones."""
    with open(path, newline="", encoding="utf-8") as file:
        lines = [line for line in csv.reader(file) if line and not line[0].lstrip().startswith("#")]
    if lines and not _numeric(lines[0]):
        lines = lines[1:]
    bad = next((line for line in lines if len(line) != 2 or not _numeric(line)), None)
    if bad is not None or not lines:
        raise ValueError(f"power_reference: {path} must hold rows of time [s] and power [W], got {bad or 'none'}")
    return _REFERENCE.checked([[float(value) for value in line] for line in lines])


def _numeric(line: list[str]) -> bool:
    try:
        return all(math.isfinite(float(value)) for value in line)
    except ValueError:
        return False


_REFERENCE = options_of(GridOptions)[0]


class PowerReferenceTerm(Term):
    """Power reference of an environment, of options with one.

    Raises
    ------
    OSError
        If a file cannot be read.
    ValueError
        If a file has no meaning.
    """

    option = "power_reference"

    def __init__(self, turbine: Turbine, options: GridOptions):
        self._turbine, self._options = turbine, options
        self._choice = self._courses(options.reference)

    def _courses(self, reference: Any) -> PowerReference | tuple[str, ...]:
        """Course of the user, or names of those that are drawn."""
        checked = _REFERENCE.checked(reference)
        self._options.check_span(checked)
        if isinstance(checked, str):
            checked = _rows_of_file(checked)
        if isinstance(checked[0], str):
            return cast("tuple[str, ...]", checked)
        times, powers = zip(*checked, strict=True)
        return PowerReference("series", times, powers)

    def mean_share(self, wind_speed: float) -> float:
        """Mean power that is asked for in a wind [m/s], over rated power [-].

        Of drawn courses that is the middle of the levels times what the wind allows, of a course of the user the mean
        of its powers, whatever the wind.
        """
        if isinstance(self._choice, PowerReference):
            mean = float(np.mean(self._choice.powers))
        else:
            mean = float(np.mean(self._options.level)) * self._full(wind_speed)
        return mean / self._turbine.drivetrain.rated_power

    def _full(self, wind_speed: float) -> float:
        """Power that a mean wind [m/s] allows, never nothing: a demand of 0 W is none in the Bladed interface [W]."""
        return available_power(self._turbine, max(wind_speed, LEAST_WIND))

    def draw(self, request: Request) -> None:
        """Draw the reference of an episode."""
        choice = request.options.get(self.option)
        request.drawn[self.option] = self.drawn(request.rng, request.wind, choice)

    def drawn(self, rng: np.random.Generator, wind: EpisodeWind, choice: Any = None) -> PowerReference:
        """Reference of an episode, or of a choice in place of that of the options.

        One number of the generator is drawn, whatever the kind. Seed and speed of the wind decide too: the same random
        numbers give another reference in another wind.
        """
        seed = int(rng.integers(2**63))
        courses = self._choice if choice is None else self._courses(choice)
        if isinstance(courses, PowerReference):
            return courses
        own = np.random.default_rng((seed, max(wind.wind_seed, -1) + 1, round(1e3 * float(wind.wind_speed))))
        kind = courses[int(own.integers(len(courses)))]
        full = self._full(float(wind.wind_speed))
        low, high = as_pair(self._options.level)
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

    def groups(self) -> dict[str, list[Observed]]:
        """Demand, error and stores of energy, all of which a controller knows; the forecast of a schedule apart."""
        rated, half = self._turbine.drivetrain.rated_power, 0.5 * rotor_inertia(self._turbine)
        factor, full = available_power(self._turbine, 1.0), half * self._turbine.drivetrain.rated_rotor_speed**2
        demand = ("W", 0.8 * rated, 0.15 * rated, 0.0, 2 * rated, 0.0)
        error = ("W", 0.0, 0.05 * rated, -2 * rated, 2 * rated, 5e-3 * rated, "electrical power less what is asked for")
        headroom = ("W", 0.1 * rated, 0.25 * rated, -2 * rated, 2 * rated, 0.0,
                    "power that the estimated wind allows less what is asked for")  # fmt: skip
        energy = ("J", full, 0.2 * full, 0.0, 4 * full, 2e-3 * full, "kinetic energy of rotor and generator")
        forecast = {f"demanded_power_in_{t:g}_s": f"power that is asked for in {t:g} s" for t in AHEAD}
        demands = [
            Observed(Channel(name, *demand, text), function=demanded_power, index=k)
            for k, (name, text) in enumerate({"demanded_power": "power that is asked for", **forecast}.items())
        ]
        allowed = partial(power_headroom, factor, 1.5 * rated)
        present = [
            demands[0],
            Observed(Channel("power_error", *error), function=power_error),
            Observed(Channel("power_headroom", *headroom), function=allowed, estimates=True),
            Observed(Channel("rotor_energy", *energy), function=partial(rotor_energy, half)),
        ]
        return {"power_reference": present, "power_forecast": demands[1:]}


def demanded_power(situation: Situation) -> list[float]:
    """Power that is asked for, now and in the times `AHEAD` [W]."""
    operation = situation.operation
    return [operation.reference.at(operation.signals["time"] + ahead) for ahead in (0.0, *AHEAD)]


def power_error(situation: Situation) -> float:
    """Electrical power less what is asked for [W]."""
    return float(situation.signals["generator_power"] - situation.operation.demanded_power)


def rotor_energy(half_inertia: float, situation: Situation) -> float:
    """Kinetic energy of rotor and generator [J]."""
    return float(half_inertia * situation.signals["rotor_speed"] ** 2)


def power_headroom(factor: float, most: float, situation: Situation) -> float:
    """Power that the wind of the estimator allows less what is asked for [W]."""
    return float(min(factor * situation.sensors.estimator.wind**3, most) - situation.operation.demanded_power)


def regulation_signal(rng: np.random.Generator) -> tuple[list[float], list[float]]:
    """Draw a regulation signal: times [s] and shares within -1 and 1 [-]."""
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


@dataclass(eq=False)
class PowerTracking:
    """Penalty on the tracking error, with the kinetic energy of the rotor as a store that is to be given back.

    The rate is ``-w (sqrt(1 + x^2) - 1) - w f dF/dt / (s P_rated)`` with ``x = (P - P_demanded) / (s P_rated)`` at the
    end of the step: quadratic for errors within the scale s, even beyond, the same above and below the reference.

    - The error always counts, also where the wind allows less than what is asked for: a turbine that makes less than
      it could loses as much for every joule then as in any lull. Being even, the penalty gives nothing for shifting
      energy from one deficit to another, and torque that swings about the reference costs.
    - F is how much kinetic energy of rotor and generator, times the efficiency of the drivetrain, is missing to that
      of the start of the episode; never negative. That start may be above rated speed, where controllers hold a rotor
      as a store: what they hold there is not to be sold either. Being a function of the state, ``F`` sums to what is
      missing at the end: taking energy out of the rotor in a lull costs nothing if it comes back, an episode that ends
      with a slower rotor pays f > 1 times what the deficit would have cost, and one that ends with a faster rotor gets
      nothing for it.

    Parameters
    ----------
    scale : float
        s [-].
    missing : float
        f [-].
    """

    weight: float = 0.0
    scale: float = 0.05
    missing: float = 1.1
    name: str = "power_tracking"
    needs_reference: ClassVar[bool] = True
    _started = False

    @property
    def worst_rate(self) -> float:
        """Lower bound of the rate [1/s].

        It holds where power and demanded power lie between nothing and twice the rated power, and
        whose rotor loses no more than that.
        """
        most = 2.0 / self.scale
        return -self.weight * (math.hypot(1.0, most) - 1.0 + self.missing * most)

    def reset(self, turbine: Turbine, signals: Signals) -> None:
        """Start an episode."""
        self._started, self._unit = True, self.scale * turbine.drivetrain.rated_power
        self._half_inertia = 0.5 * rotor_inertia(turbine) * efficiency(turbine)
        self._full = self._half_inertia * max(signals["rotor_speed"], 0.0) ** 2

    def __call__(self, transition: Transition) -> float:
        """Rate of reward [1/s].

        Raises
        ------
        ValueError
            If nothing is asked for.
        """
        if transition.demanded_power is None:
            raise ValueError("the reward term power_tracking needs a power_reference, got an environment without")
        if not self._started:
            self.reset(transition.turbine, transition.before)
        before, after = transition.before, transition.after
        error = (after["generator_power"] - transition.demanded_power) / self._unit
        grown = (self._lack(after["rotor_speed"]) - self._lack(before["rotor_speed"])) / (transition.dt * self._unit)
        return -self.weight * (math.hypot(1.0, error) - 1.0 + self.missing * grown)

    def _lack(self, rotor_speed: float) -> float:
        """Kinetic energy that is missing [J]."""
        return float(max(self._full - self._half_inertia * max(rotor_speed, 0.0) ** 2, 0.0))
