"""From a description of the reward to its terms, and from a step to its reward."""

from __future__ import annotations

import copy
import math
from collections.abc import Callable, Iterable, Mapping
from typing import TYPE_CHECKING, TypeAlias, cast

from wt_gym.base.errors import did_you_mean
from wt_gym.envs.arguments import check_mapping, check_number, shown
from wt_gym.envs.rewards.damage import Damage
from wt_gym.envs.rewards.extremes import ExtremeLoads
from wt_gym.envs.rewards.fatigue import BladeFatigue, TowerForeAftFatigue, TowerSideSideFatigue
from wt_gym.envs.rewards.function import FunctionTerm
from wt_gym.envs.rewards.loads import TipDeflection, TowerLoad
from wt_gym.envs.rewards.operation import ActuatorUse, Overspeed
from wt_gym.envs.rewards.power import Power
from wt_gym.envs.rewards.tracking import PowerTracking

if TYPE_CHECKING:
    from wt_gym.envs.rewards.term import RewardTerm, Transition
    from wt_gym.simulation import Signals
    from wt_gym.turbines import Turbine

    Part: TypeAlias = str | RewardTerm | Callable[[Transition], float]

__all__ = ["DEFAULT_WEIGHTS", "compose", "reset", "total", "worst_rate"]

_CLASSES = (
    Power,
    BladeFatigue,
    TowerForeAftFatigue,
    TowerSideSideFatigue,
    ActuatorUse,
    Overspeed,
    TipDeflection,
    TowerLoad,
    ExtremeLoads,
    Damage,
    PowerTracking,
)
_TERMS = {term.name: type(term) for term in (cls() for cls in _CLASSES)}

DEFAULT_WEIGHTS: dict[str, float] = {name: cls().weight for name, cls in _TERMS.items()}
"""Weight of every term that has a name; those with weight 0 are there on request."""


def compose(reward: Mapping[str, float] | Part | Iterable[Part] | None) -> tuple[RewardTerm, ...]:
    """Terms of a reward.

    Parameters
    ----------
    reward : None, mapping, str, callable, RewardTerm or iterable of the latter three
        None: the terms with their `DEFAULT_WEIGHTS`. A mapping of names to weights changes those weights (zero drops
        the term). A part or an iterable of parts stands for itself alone: the name of a term, with its default weight
        or, where that is zero, 1; a function of a `Transition` that gives a rate [1/s]; a term.

    Returns
    -------
    tuple of RewardTerm
        New objects at every call, terms given are copied: no two environments share the memory of a term.

    Raises
    ------
    ValueError
        If a name is unknown, a weight is negative, two terms share a name, or no term is left.

    Examples
    --------
    >>> [term.name for term in compose("power")]
    ['power']
    >>> [term.name for term in compose(["power", lambda step: -abs(step.after["tower_top_fore_aft"])])]
    ['power', 'function']
    """
    if reward is None:
        reward = {}
    if isinstance(reward, Mapping):
        for name in reward:
            _check_name(name)
        weights = check_mapping("reward", reward)
        terms: list[RewardTerm] = [
            cls(weight=weights[name]) if name in reward else cls() for name, cls in _TERMS.items()
        ]
    elif isinstance(reward, str) or callable(reward):
        terms = [_term(reward)]
    elif isinstance(reward, Iterable):
        terms = [_term(part) for part in reward]
    else:
        raise ValueError(
            "reward must map names of terms to weights, or be a name, a function of a step, a term or several of them, "
            f"got {shown(reward)}"
        )
    for term in terms:
        if not (callable(term) and hasattr(term, "name") and hasattr(term, "weight")):
            raise ValueError(f"a reward term needs a name, a weight and must be callable, got {term!r}")
        weight = check_number(f"the weight of reward term {term.name!r}", term.weight, finite=False)
        if not 0 <= weight < math.inf:
            raise ValueError(
                f"the weight of reward term {term.name!r} must be finite and not negative, got {term.weight}"
            )
    kept = tuple(copy.deepcopy(term) for term in terms if term.weight > 0)
    if not kept or len({term.name for term in kept}) != len(kept):
        raise ValueError(f"reward needs at least one term and different names, got {[term.name for term in kept]}")
    return kept


def _check_name(name: object) -> None:
    if name not in _TERMS:
        raise ValueError(f"reward has no term {name!r}{did_you_mean(name, _TERMS, '.')} There are {', '.join(_TERMS)}")


def _term(part: Part) -> RewardTerm:
    """Term that a name, a function or a term stands for."""
    if isinstance(part, str):
        _check_name(part)
        return _TERMS[part](weight=DEFAULT_WEIGHTS[part] or 1.0)
    if callable(part) and not hasattr(part, "weight"):
        return FunctionTerm(part)
    return cast("RewardTerm", part)


def reset(terms: Iterable[RewardTerm], turbine: Turbine, signals: Signals, averaged: Signals | None = None) -> None:
    """Let the terms that remember something forget it.

    Parameters
    ----------
    terms : iterable of RewardTerm
    turbine : Turbine
    signals : Signals
        First signals of the episode.
    averaged : Signals, optional
        The same with running means in place of the loads, for terms with the attribute ``begins_with_means``.
    """
    for term in terms:
        if hasattr(term, "reset"):
            begins_with_means = averaged is not None and getattr(term, "begins_with_means", False)
            term.reset(turbine, averaged if begins_with_means else signals)


def worst_rate(terms: Iterable[RewardTerm]) -> float:
    """Lower bound of the reward of one second of operation [1/s]."""
    return sum(float(getattr(term, "worst_rate", -term.weight)) for term in terms)


def total(terms: Iterable[RewardTerm], transition: Transition) -> tuple[float, dict[str, float]]:
    """Reward of a step and its terms.

    Returns
    -------
    reward : float
        Sum of the terms.
    values : dict
        Name to value, each already multiplied by the step's length.
    """
    values = {term.name: float(term(transition)) * transition.dt for term in terms}
    return float(sum(values.values())), values
