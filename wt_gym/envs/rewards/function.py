"""A function as a reward term."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable

    from wt_gym.envs.rewards.term import Transition

__all__ = ["FunctionTerm"]


class FunctionTerm:
    """A rate of reward that a function gives for a step.

    Parameters
    ----------
    function : callable
        Takes a `wt_gym.envs.rewards.Transition`, gives a rate [1/s].
    weight : float
        Factor on the rate.
    name : str, optional
        By default that of the function; of one without a name "function".
    """

    worst_rate = -math.inf
    """Nothing is known of the function."""

    def __init__(self, function: Callable[[Transition], float], weight: float = 1.0, name: str | None = None):
        own = getattr(function, "__name__", "<>")
        self.function, self.weight = function, weight
        self.name = name or (own if own.isidentifier() else "function")

    def __call__(self, transition: Transition) -> float:
        """Rate of reward [1/s]."""
        rate = float(self.function(transition))
        if not math.isfinite(rate):
            raise ValueError(f"the reward function {self.name!r} must give a finite rate [1/s], got {rate}")
        return self.weight * rate
