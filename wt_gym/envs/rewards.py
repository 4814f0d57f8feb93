"""Terms of the reward: their choice, their weights and their sum."""

from __future__ import annotations

import copy
import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeAlias, cast

from wt_gym.base.errors import did_you_mean
from wt_gym.base.options import Options, check_mapping, check_number, option, option_record, shown
from wt_gym.control.design import reference_flap_moment, reference_tower_moment
from wt_gym.envs.fatigue import BladeFatigue, Damage, TowerForeAftFatigue, TowerSideSideFatigue
from wt_gym.envs.platform_rewards import PlatformMotion
from wt_gym.envs.power import Power
from wt_gym.envs.power_reference import PowerTracking
from wt_gym.envs.terms import RewardTerm, Transition, bounded_square
from wt_gym.simulation import Signals
from wt_gym.turbines import Turbine

if TYPE_CHECKING:
    Part: TypeAlias = str | RewardTerm | Callable[[Transition], float]


class FunctionTerm:
    """A rate of reward that a function gives for a step.

    Parameters
    ----------
    function : callable
        Takes a `wt_gym.envs.terms.Transition`, gives a rate [1/s].
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


@dataclass(frozen=True)
class TipDeflection:
    """Penalty on downwind deflection of the tips: x = deflection / (``scale`` * blade length), mean over the blades."""

    weight: float = 0.0
    scale: float = 0.15
    name: str = "tip_deflection"

    def __call__(self, transition: Transition) -> float:
        """Rate of reward [1/s]."""
        turbine = transition.turbine
        reference = self.scale * turbine.blade.length
        tips = transition.after["tip_out_of_plane"].tolist()
        return -self.weight * sum(bounded_square((max(tip, 0.0) / reference) ** 2) for tip in tips) / turbine.n_blades


@dataclass(frozen=True)
class TowerLoad:
    """Penalty on changes of the tower-base moment, which are what wears a tower.

    x = |dM| / (``scale`` * dt * M_ref): the length of the change of the moment vector over the step, against ``scale``
    times the moment of the Betz thrust at rated wind at hub height per second.
    """

    weight: float = 0.0
    scale: float = 0.25
    name: str = "tower_load"

    def __call__(self, transition: Transition) -> float:
        """Rate of reward [1/s]."""
        before, after = transition.before, transition.after
        change = math.hypot(
            after["tower_base_fore_aft_moment"] - before["tower_base_fore_aft_moment"],
            after["tower_base_side_side_moment"] - before["tower_base_side_side_moment"],
        )
        reference = self.scale * transition.dt * reference_tower_moment(transition.turbine)
        return -self.weight * bounded_square((change / reference) ** 2)


@dataclass(frozen=True)
class ActuatorUse:
    """Penalty on actuator use: mean of |rate| / greatest rate over the blades' pitch, the yaw drive and the torque.

    The share of the pitch system is the actuator duty cycle, by the way that the blades turned in all time steps of the
    simulator. Torque counts by its change over the step. A turbine without yaw drive, or with a damper as generator,
    has the mean of the others.
    """

    weight: float = 0.1
    name: str = "actuator_use"

    def __call__(self, transition: Transition) -> float:
        """Rate of reward [1/s]."""
        turbine, before, after = transition.turbine, transition.before, transition.after
        travel: float = sum(after["pitch_travel"].tolist()) / turbine.n_blades
        uses = [travel / transition.dt / turbine.pitch.max_rate]
        if turbine.drivetrain.takes_torque:
            torque: float = abs(after["generator_torque"] - before["generator_torque"]) / transition.dt
            uses.append(torque / turbine.drivetrain.max_torque_rate)
        if turbine.nacelle.max_yaw_rate > 0.0:
            uses.append(abs(after["yaw_rate"]) / turbine.nacelle.max_yaw_rate)
        return -self.weight * sum([min(use, 1.0) for use in uses]) / len(uses)


@dataclass(frozen=True)
class Overspeed:
    """Penalty on rotor speed above ``margin`` times rated: x = excess / (``scale`` * rated)."""

    weight: float = 0.4
    margin: float = 1.02
    scale: float = 0.1
    name: str = "overspeed"

    def __call__(self, transition: Transition) -> float:
        """Rate of reward [1/s]."""
        rated = transition.turbine.drivetrain.rated_rotor_speed
        excess = max(transition.after["rotor_speed"] / rated - self.margin, 0.0)
        return -self.weight * bounded_square((excess / self.scale) ** 2)


@dataclass(frozen=True)
class HighSpeed(Overspeed):
    """Penalty on rotor speed near its limit, for controllers that let the speed swing: as `Overspeed` from 115 % on."""

    weight: float = 0.0
    margin: float = 1.15
    scale: float = 0.05
    name: str = "high_speed"


@dataclass(frozen=True)
class ExtremeLoads:
    """Penalty on moments beyond ``margin`` times the reference: x = (moment / M - margin) / ``scale`` where positive.

    The moments are the largest of the step, over all structural steps: the size of the flapwise root moment of the most
    loaded blade against `reference_loads.reference_flap_moment`, and the bending moment of the tower base against
    `reference_loads.reference_tower_moment`. Both penalties have half of the weight. The turbines of the package reach
    the references in normal turbulence about rated wind in a few gusts an hour.
    """

    weight: float = 0.0
    margin: float = 0.9
    scale: float = 0.2
    name: str = "extreme_loads"

    def __call__(self, transition: Transition) -> float:
        """Rate of reward [1/s]."""
        turbine, after = transition.turbine, transition.after
        shares = (
            max(after["root_flap_moment_max"].tolist()) / reference_flap_moment(turbine),
            after["tower_base_moment_max"] / reference_tower_moment(turbine),
        )
        return -0.5 * self.weight * sum(bounded_square((max(s - self.margin, 0.0) / self.scale) ** 2) for s in shares)


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
    PlatformMotion,
    HighSpeed,
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
    if reward is None or isinstance(reward, Mapping):
        for name in reward or ():
            _check_name(name)
        weights = DEFAULT_WEIGHTS | check_mapping("reward", reward or {})
        terms: list[RewardTerm] = [cls(weight=weights[name]) for name, cls in _TERMS.items()]
    elif isinstance(reward, str | Iterable) or callable(reward):
        terms = [_term(part) for part in ([reward] if isinstance(reward, str) or callable(reward) else reward)]
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
            raise ValueError(f"the weight of reward term {term.name!r} must be finite and not negative, got {weight}")
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


def reset(
    terms: Iterable[RewardTerm],
    turbine: Turbine,
    signals: Signals,
    averaged: Signals | None = None,
    demanded_power: float | None = None,
) -> None:
    """Let the terms that remember something forget it.

    Parameters
    ----------
    signals : Signals
        First signals of the episode.
    averaged : Signals, optional
        The same with running means in place of the loads, for terms with the attribute ``begins_with_means``.
    demanded_power : float, optional
        Demand of a grid operator [W].

    Raises
    ------
    ValueError
        If a term needs a demanded power, and there is none.
    """
    for term in terms:
        if demanded_power is None and getattr(term, "needs_reference", False):
            raise ValueError(f"the reward term {term.name} needs a power_reference of the environment, got None")
        if hasattr(term, "reset"):
            begins_with_means = averaged is not None and getattr(term, "begins_with_means", False)
            term.reset(turbine, averaged if begins_with_means else signals)


def worst_rate(terms: Iterable[RewardTerm]) -> float:
    """Lower bound of the reward of one second of operation [1/s]."""
    return sum(float(getattr(term, "worst_rate", -term.weight)) for term in terms)


def total(terms: Iterable[RewardTerm], transition: Transition) -> tuple[float, dict[str, float]]:
    """Reward of a step, the sum of its terms, and the terms by name, each multiplied by the length of the step."""
    values = {term.name: float(term(transition)) * transition.dt for term in terms}
    return float(sum(values.values())), values


@option_record
class RewardOptions(Options):
    """The reward of a step."""

    title = "rewards"

    terms: Mapping[str, float] | Part | Iterable[Part] | None = option(
        'Weights by name; or the terms alone: names (``"power"``), functions of a transition that give a rate in 1/s, '
        "terms of your own. See `wt_gym.envs.rewards.compose`",
        default=None,
        flat="reward",
        kind="mapping, str, callable, RewardTerm or iterable of them, optional",
    )
    relative: bool = option(
        "Take off what the base controller alone earns in the same wind. A second turbine runs beside the first, at "
        "twice the cost, in the first episode from a beginning; what it earns is kept in memory and in the user's "
        "cache (see ``starts``), unless controller, reward, simulator or wind are yours",
        default=False,
        flat="relative_reward",
    )
    credit: bool = option(
        "Pay what an action does to the loads of the next 15 s in its own step, by the observer of the base "
        "controller; needs ``relative_reward``. The return of an episode stays, see `wt_gym.envs.credit`",
        default=False,
        flat="reward_credit",
    )
    vector: bool = option(
        "Give the terms as an array instead of their sum, as multi-objective libraries take it; named in "
        "``reward_names``, with a ``reward_space``",
        default=False,
        flat="vector_reward",
    )
    termination_penalty: float = option(
        "Subtracted from the reward when an episode is terminated", default=120.0, unit="-", low=0.0
    )

    def check(self) -> None:
        """Refuse unknown terms, weights without meaning, and credit without the controller alone."""
        compose(self.terms)
        if self.credit and not self.relative:
            raise ValueError("reward_credit must come with relative_reward=True, got it without")
