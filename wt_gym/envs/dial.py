"""The dial: factors on the weights of fatigue, power and travel in the reward, which change within an episode.

The reward of a step is the sum of its terms, each times the factor of its kind (`DIALED`), other terms and the penalty
of an early end as they are. Only the ratios of the factors decide which policy is best, so all are scaled to the sum of
their number: equal ones leave the reward as it is. The factors that an observation shows hold for the step that follows
it; those to come are not known to an agent.
"""

from __future__ import annotations

import math
from bisect import bisect_left, bisect_right
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Self, cast

import numpy as np

from wt_gym.base.errors import did_you_mean
from wt_gym.base.options import Options, option, option_record, options_of, real_number, shown
from wt_gym.control import Channel
from wt_gym.envs.channels import Observed, Situation
from wt_gym.envs.terms import Beginning, Request, Term

if TYPE_CHECKING:
    from wt_gym.envs.builder import Parts
    from wt_gym.envs.operation import Operation

DIAL_NAMES = ("fatigue", "power", "travel")
"""Names of the factors, in the order of columns and channels."""
_DRAWS = ("log_uniform", "simplex")
LEAST_FACTOR, MOST_FACTOR = 1 / 64, 64.0
"""Range of every factor of the user [-]."""
DIALED = {
    "fatigue": ("blade_fatigue", "tower_fore_aft_fatigue", "tower_side_side_fatigue", "damage"),
    "power": ("power", "power_tracking"),
    "travel": ("actuator_use",),
}
"""Reward terms by the factor that they get."""
DRAWN = 3600.0
"""Length of a drawn course [s]; its last factors are held."""
_KIND = {term: DIAL_NAMES.index(name) for name, terms in DIALED.items() for term in terms}


def _checked_weights(weights: Any) -> Any:
    """Weights as a name of `_DRAWS`, a mapping of all names, or rows as a tuple of tuples."""
    if isinstance(weights, str) and weights in _DRAWS:
        return weights
    allowed = (
        f"must be one of {', '.join(_DRAWS)}, a mapping of {', '.join(DIAL_NAMES)} to factors from {LEAST_FACTOR:g} to "
        f"{MOST_FACTOR:g}, or finite rows of rising time [s] and these factors, got "
    )
    if isinstance(weights, Mapping):
        if wrong := [name for name in weights if name not in DIAL_NAMES]:
            raise ValueError(f"{allowed}{shown(wrong[0])}{did_you_mean(wrong[0], DIAL_NAMES)}")
        factors = {name: real_number(weights.get(name, 1.0)) for name in DIAL_NAMES}
        if not all(map(_is_factor, factors.values())):
            raise ValueError(allowed + shown(dict(weights)))
        return factors
    try:
        rows = np.asarray(weights, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        rows = np.empty(0)
    if (
        rows.ndim != 2 or not len(rows) or rows.shape[1] != 1 + len(DIAL_NAMES) or not np.isfinite(rows).all()
        or (np.diff(rows[:, 0]) <= 0.0).any() or not all(map(_is_factor, rows[:, 1:].ravel().tolist()))
    ):  # fmt: skip
        near = did_you_mean(weights, _DRAWS) if isinstance(weights, str) else ""
        raise ValueError(f"{allowed}{shown(weights)}{near}")
    return tuple(map(tuple, rows.tolist()))


def _is_factor(value: float | None) -> bool:
    return value is not None and LEAST_FACTOR <= value <= MOST_FACTOR


def _checked_range(ends: tuple[float, float]) -> tuple[float, float]:
    if not ends[0] < 1.0 <= ends[1]:
        raise ValueError(f"must be (low, high) from below 1 to 1 or more, got {ends}")
    return ends


@option_record
class DialOptions(Options):
    """Factors on the weights of fatigue, power and travel in the reward, see `wt_gym.envs.dial`."""

    title = "dial"
    prefix = "dial_"
    switch = "weights"

    weights: str | Mapping[str, float] | Sequence[Any] | np.ndarray | None = option(
        'Factors on the weights of the reward. ``"log_uniform"``: each is drawn by itself, evenly in its logarithm; '
        '``"simplex"``: together, evenly among those with one sum; a mapping such as ``{"travel": 2.0}``: constant, '
        "those left out are 1; or rows of time [s], fatigue, power and travel, each of which holds up to the next. "
        "All are scaled to the sum 3, because only their ratios count. None: there is no dial",
        default=None, unit="-", kind="str, mapping, sequence or array, optional",
        allowed="1/64 to 64", check=_checked_weights,
    )  # fmt: skip
    range: tuple[float, float] = option(
        'Range of the drawn factors before they are scaled; of ``"simplex"`` the lower end counts',
        default=(0.25, 4.0), unit="-", low=LEAST_FACTOR, high=MOST_FACTOR, check=_checked_range,
    )  # fmt: skip
    interval: float = option(
        "Mean time between changes of drawn factors, which are drawn evenly between a half and one and a half of it",
        default=20.0, unit="s", low=1.0,
    )  # fmt: skip


_WEIGHTS = options_of(DialOptions)[0]


def dial_of(env: Parts) -> DialTerm | None:
    """Dial of an environment, None without one."""
    return cast("DialTerm | None", env.terms.get("dial"))


def factor_of(term: str, factors: Sequence[float]) -> float:
    """Factor on a reward term, of factors in the order of `DIAL_NAMES`."""
    kind = _KIND.get(term)
    return 1.0 if kind is None else factors[kind]


def constant_factors(weights: Mapping[str, float]) -> tuple[float, ...]:
    """Factors of a mapping in the order of `DIAL_NAMES`, not scaled; 1 where left out."""
    return tuple(_WEIGHTS.checked(weights).values())


def scaled(factors: Iterable[float]) -> tuple[float, ...]:
    """Factors with the same ratios and the sum of their number."""
    numbers = tuple(map(float, factors))
    size = len(numbers) / sum(numbers)
    return tuple(size * factor for factor in numbers)


@dataclass(frozen=True)
class DialCourse:
    """Factors over time, each row holding up to the next."""

    times: tuple[float, ...]  #: Rising [s]
    factors: tuple[tuple[float, ...], ...]  #: rows in the order of `DIAL_NAMES`, each with the sum of their number

    def __deepcopy__(self, memo: dict[int, Any]) -> Self:
        return self  # never changes

    def at(self, time: float) -> tuple[float, ...]:
        """Factors at a time [s]; before the first row its own."""
        return self.factors[max(bisect_right(self.times, time) - 1, 0)]

    def changed(self, time: float, factors: tuple[float, ...]) -> DialCourse:
        """Course that is this one before a time [s] and holds other factors from then on."""
        k = bisect_left(self.times, time)
        return DialCourse((*self.times[:k], time), (*self.factors[:k], factors))

    @classmethod
    def of(cls, weights: Any) -> Self:
        """Course of constant factors by name, or of rows of time and factors, as of `DialOptions`."""
        checked = _WEIGHTS.checked(weights)
        if isinstance(checked, str):
            raise ValueError(f"dial_weights must be a mapping or rows here, got {checked!r}")
        if isinstance(checked, dict):
            return cls((0.0,), (scaled(checked.values()),))
        return cls(tuple(row[0] for row in checked), tuple(scaled(row[1:]) for row in checked))


class DialTerm(Term):
    """Dial of an environment, of options with weights, names of reward terms, and the operation, which has the time.

    Raises
    ------
    ValueError
        If no term of the reward gets a factor.
    """

    option = "dial"
    remembered = ("course",)

    def __init__(self, options: DialOptions, terms: Iterable[str], operation: Operation):
        if not _KIND.keys() & (names := tuple(terms)):
            raise ValueError(f"dial_weights needs one of the reward terms {', '.join(_KIND)}, got {', '.join(names)}")
        self._options, self._operation = options, operation
        self.course: DialCourse | None = None

    # ---- draws ----

    def draw(self, request: Request) -> None:
        """Draw the course of an episode; a numbered beginning comes with any factors."""
        request.drawn["dial"] = self.drawn(request.episode_rng, request.options.get(self.option))

    def drawn(self, rng: np.random.Generator, weights: Any = None) -> DialCourse:
        """Course of an episode, of weights in place of those of the options; one number of the generator is drawn."""
        own = np.random.default_rng(int(rng.integers(2**63)))
        weights = _WEIGHTS.checked(self._options.weights if weights is None else weights)
        if not isinstance(weights, str):
            return DialCourse.of(weights)
        times, factors = [0.0], [self._drawn(weights, own)]
        while times[-1] < DRAWN:
            times.append(times[-1] + self._options.interval * own.uniform(0.5, 1.5))
            factors.append(self._drawn(weights, own))
        return DialCourse(tuple(times), tuple(factors))

    def factors(self, rng: np.random.Generator) -> tuple[float, ...]:
        """Draw factors as they hold between two changes, or those of a moment of a course of the options."""
        weights = self._options.weights
        if isinstance(weights, str):
            return self._drawn(weights, rng)
        course = DialCourse.of(weights)
        return course.factors[int(rng.integers(len(course.factors)))]

    def _drawn(self, draw: str, rng: np.random.Generator) -> tuple[float, ...]:
        low, high = self._options.range
        n = len(DIAL_NAMES)
        if draw == "simplex":
            shares = rng.dirichlet(np.ones(n))
            return tuple((low + n * (1.0 - low) * shares).tolist())
        return scaled(np.exp(rng.uniform(math.log(low), math.log(high), n)).tolist())

    # ---- episode ----

    def begin(self, beginning: Beginning) -> None:
        """Start an episode."""
        self.course = beginning.drawn["dial"]

    @property
    def present(self) -> tuple[float, ...]:
        """Factors of the current instant."""
        return cast("DialCourse", self.course).at(self._operation.signals["time"])

    def turn(self, factors: tuple[float, ...], lead: float) -> None:
        """Hold other factors from a lead after the current instant on [s]."""
        self.course = cast("DialCourse", self.course).changed(self._operation.signals["time"] + lead, factors)

    def adjust(self, _: float, terms: dict[str, float], __: int, time: float) -> tuple[float, dict[str, float]]:
        """Multiply the terms of a step by the factors of its beginning."""
        factors = cast("DialCourse", self.course).at(time)
        terms = {name: factor_of(name, factors) * value for name, value in terms.items()}
        return float(sum(terms.values())), terms

    def info(self) -> dict[str, Any]:
        """Present factors by name."""
        return {"dial": dict(zip(DIAL_NAMES, self.present, strict=True))}

    def groups(self) -> dict[str, list[Observed]]:
        """Present factors; not those to come."""
        row, text = ("-", 0.0, 1.0, -12.0, 2.0, 0.0), "binary logarithm of the factor on the weight of {} in the reward"
        channels = [Channel(f"dial_{name}", *row, text.format(name)) for name in DIAL_NAMES]
        return {"dial": [Observed(one, function=self.logarithms, index=k) for k, one in enumerate(channels)]}

    def logarithms(self, _: Situation) -> list[float]:
        """Binary logarithms of the current factors."""
        return [math.log2(factor) for factor in self.present]
