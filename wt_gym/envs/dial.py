"""The dial: factors on the weights of fatigue, power and travel in the reward, which change within an episode.

The reward of a step is the sum of its terms, each times the factor of its kind (`DIALED`), other terms and the penalty
of an early end as they are. Only the ratios of the factors decide which policy is best, so all are scaled to the sum of
their number: equal ones leave the reward as it is. The factors that an observation shows hold for the step that follows
it; those to come are not known to an agent.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from wt_gym.base.options import options_of
from wt_gym.envs.options.dial import DIAL_NAMES, DialOptions

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping
    from typing import Self


__all__ = ["DIALED", "DRAWN", "DialCourse", "DialDraws", "dialed", "factor_of", "scaled"]

DIALED = {
    "fatigue": ("blade_fatigue", "tower_fore_aft_fatigue", "tower_side_side_fatigue", "damage"),
    "power": ("power", "power_tracking"),
    "travel": ("actuator_use",),
}
"""Reward terms by the factor that they get."""
DRAWN = 3600.0
"""Length of a drawn course [s]; its last factors are held."""
_WEIGHTS = options_of(DialOptions)[0]
_KIND = {term: DIAL_NAMES.index(name) for name, terms in DIALED.items() for term in terms}


def factor_of(term: str, factors: tuple[float, ...]) -> float:
    """Factor on a reward term.

    Parameters
    ----------
    term : str
        Its name.
    factors : tuple of float
        In the order of `DIAL_NAMES`.
    """
    kind = _KIND.get(term)
    return 1.0 if kind is None else factors[kind]


def scaled(factors: Iterable[float]) -> tuple[float, ...]:
    """Factors with the same ratios and the sum of their number."""
    given = tuple(map(float, factors))
    size = len(given) / sum(given)
    return tuple(size * factor for factor in given)


@dataclass(frozen=True)
class DialCourse:
    """Factors over time, each row holding up to the next.

    Attributes
    ----------
    times : tuple of float
        Rising [s].
    factors : tuple of tuple of float
        In the order of `DIAL_NAMES`, a row a time, with the sum of their number.
    """

    times: tuple[float, ...]
    factors: tuple[tuple[float, ...], ...]

    def __deepcopy__(self, memo: dict[int, Any]) -> Self:
        return self  # never changes

    def at(self, time: float) -> tuple[float, ...]:
        """Factors at a time [s]; before the first row its own."""
        return self.factors[max(bisect_right(self.times, time) - 1, 0)]

    def changed(self, time: float, factors: tuple[float, ...]) -> DialCourse:
        """Give a course that is this one before a time [s] and holds other factors from then on."""
        kept = [k for k, begin in enumerate(self.times) if begin < time]
        before = tuple(self.times[k] for k in kept), tuple(self.factors[k] for k in kept)
        return DialCourse((*before[0], time), (*before[1], factors))

    @classmethod
    def of(cls, given: Any) -> Self:
        """Course of constant factors by name, or of rows of time and factors, checked as of `DialOptions.weights`."""
        checked = _WEIGHTS.checked(given)
        if isinstance(checked, str):
            raise ValueError(f"dial_weights must be a mapping or rows here, got {checked!r}")
        if isinstance(checked, dict):
            return cls((0.0,), (scaled(checked.values()),))
        return cls(tuple(row[0] for row in checked), tuple(scaled(row[1:]) for row in checked))


class DialDraws:
    """Draws the dial of episodes.

    Parameters
    ----------
    options : DialOptions
        With weights.
    terms : iterable of str
        Of the reward.

    Raises
    ------
    ValueError
        If no term of the reward gets a factor.
    """

    def __init__(self, options: DialOptions, terms: Iterable[str]):
        names = tuple(terms)
        if not any(term in _KIND for term in names):
            raise ValueError(f"dial_weights needs one of the reward terms {', '.join(_KIND)}, got {', '.join(names)}")
        self._options = options

    def draw(self, rng: np.random.Generator, chosen: Any = None) -> DialCourse:
        """Draw the course of an episode.

        Parameters
        ----------
        rng : numpy.random.Generator
            One number is drawn of it, whatever the choice.
        chosen : object, optional
            In place of the weights of the options.

        Raises
        ------
        ValueError
            If what is chosen has no meaning.
        """
        own = np.random.default_rng(int(rng.integers(2**63)))
        given = _WEIGHTS.checked(self._options.weights if chosen is None else chosen)
        if not isinstance(given, str):
            return DialCourse.of(given)
        times, factors = [0.0], [self._drawn(given, own)]
        while times[-1] < DRAWN:
            times.append(times[-1] + self._options.interval * own.uniform(0.5, 1.5))
            factors.append(self._drawn(given, own))
        return DialCourse(tuple(times), tuple(factors))

    def factors(self, rng: np.random.Generator) -> tuple[float, ...]:
        """Draw factors as they hold between two changes, or those of a moment of a course that is given."""
        given = _WEIGHTS.checked(self._options.weights)
        if isinstance(given, str):
            return self._drawn(given, rng)
        course = DialCourse.of(given)
        return course.factors[int(rng.integers(len(course.factors)))]

    def _drawn(self, draw: str, rng: np.random.Generator) -> tuple[float, ...]:
        low, high = cast("tuple[float, float]", self._options.range)
        n = len(DIAL_NAMES)
        if draw == "simplex":
            shares = rng.dirichlet(np.ones(n))
            return tuple((low + n * (1.0 - low) * shares).tolist())
        return scaled(np.exp(rng.uniform(math.log(low), math.log(high), n)).tolist())


def dialed(terms: Mapping[str, float], factors: tuple[float, ...]) -> dict[str, float]:
    """Reward terms times their factors."""
    return {name: factor_of(name, factors) * value for name, value in terms.items()}
