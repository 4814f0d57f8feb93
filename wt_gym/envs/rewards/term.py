"""What a reward term sees and what it offers."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    import numpy as np

    from wt_gym.simulation import Signals
    from wt_gym.turbines import Turbine
    from wt_gym.wind import Inflow

__all__ = ["HighPass", "RewardTerm", "Transition", "bounded_square"]


@dataclass(frozen=True)
class Transition:
    """One control step as the reward sees it.

    Attributes
    ----------
    turbine : Turbine
    before, after : Signals
        Signals at the beginning and the end of the step; ``after["time"]`` is the time [s].
    dt : float
        Length of the step [s].
    inflow : Inflow, optional
        The undisturbed wind of the episode.
    action : numpy.ndarray, shape (n_act,), optional
        The validated action that led here.
    demanded_power : float, optional
        That a grid operator asks for at the end of the step [W].
    """

    turbine: Turbine
    before: Signals
    after: Signals
    dt: float
    inflow: Inflow | None = None
    action: np.ndarray | None = None
    demanded_power: float | None = None


class RewardTerm(Protocol):
    """A part of the reward: its name in ``info["reward_terms"]``, its weight, and its value for a step.

    A term that remembers something between steps also has ``reset(turbine, signals)``, called at the start of every
    episode with the first signals, and keeps its memory in plain attributes, so that ``copy.deepcopy`` is a snapshot.
    With a true attribute ``begins_with_means`` it gets the running means of root and tower moments in their place.
    A term whose rate is not bounded by its weight says so by an attribute ``worst_rate`` [1/s].
    """

    if TYPE_CHECKING:  # read only: a frozen dataclass will do

        @property
        def name(self) -> str: ...

        @property
        def weight(self) -> float: ...

    else:
        name: str
        weight: float

    def __call__(self, transition: Transition) -> float:
        """Rate of reward [1/s], at least -weight."""
        ...


def bounded_square(square: float) -> float:
    """Penalty x^2 / (1 + x^2) in [0, 1) of a square x^2."""
    return square / (1.0 + square) if square < math.inf else 1.0


class HighPass:
    """First-order high-pass filter, exact for a signal held over the step.

    Parameters
    ----------
    time_constant : float
        [s]
    mean : float
        What the filter takes for the mean of the signal at the start.
    """

    def __init__(self, time_constant: float, mean: float):
        self._time_constant, self.mean = float(time_constant), float(mean)
        self._dt, self._share = 0.0, 0.0

    def __call__(self, value: float, dt: float) -> float:
        """Deviation of ``value`` from the mean of the last ``time_constant`` seconds."""
        if dt != self._dt:
            self._dt, self._share = dt, 1.0 - math.exp(-dt / self._time_constant)
        self.mean += self._share * (value - self.mean)
        return value - self.mean
