"""Reward terms. A reward is the sum of its terms, each a rate in 1/s times the control step.

Every term is bounded: power lies within [-w, w] and each penalty within [-w, 0] per second, w being the term's weight.
So the worst reward a second of operation can bring is known (`worst_rate`), and a penalty for ending an episode early
can be set against it. Penalties grow as ``x^2 / (1 + x^2)``: quadratic for small x, half of the weight at x = 1.
Any callable with a ``name``, a ``weight`` and the same signature joins in.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

from wt_gym.envs.observations import reference_flap_moment

if TYPE_CHECKING:
    from wt_gym.simulation import Signals
    from wt_gym.turbines import Turbine

__all__ = [
    "ActuatorUse",
    "Overspeed",
    "Power",
    "RewardTerm",
    "TipDeflection",
    "TowerLoad",
    "Transition",
    "compose",
    "total",
    "worst_rate",
]


@dataclass(frozen=True)
class Transition:
    """One control step as the reward sees it.

    Attributes
    ----------
    turbine : Turbine
    before, after : Signals
        Signals at the beginning and the end of the step.
    dt : float
        Length of the step [s].
    """

    turbine: Turbine
    before: Signals
    after: Signals
    dt: float


class RewardTerm(Protocol):
    """A part of the reward: its name in ``info["reward_terms"]``, its weight, and its value for a step."""

    name: str
    weight: float

    def __call__(self, transition: Transition) -> float:
        """Rate of reward [1/s] in [-weight, weight]."""
        ...


def _bounded_square(x: float) -> float:
    """Penalty x^2 / (1 + x^2) in [0, 1)."""
    return x * x / (1.0 + x * x)


@dataclass(frozen=True)
class Power:
    """Electrical power over rated power; above rated the excess is subtracted twice, down to -1 at twice rated."""

    weight: float = 1.0
    name: str = "power"

    def __call__(self, transition: Transition) -> float:
        """Rate of reward [1/s]."""
        ratio = transition.after["generator_power"] / transition.turbine.drivetrain.rated_power
        value = ratio if ratio <= 1.0 else 1.0 - 2.0 * (ratio - 1.0)
        return self.weight * max(-1.0, value)


@dataclass(frozen=True)
class TipDeflection:
    """Penalty on downwind deflection of the tips: x = deflection / (``scale`` * blade length), mean over the blades."""

    weight: float = 0.1
    scale: float = 0.15
    name: str = "tip_deflection"

    def __call__(self, transition: Transition) -> float:
        """Rate of reward [1/s]."""
        turbine = transition.turbine
        reference = self.scale * turbine.blade.length
        tips = (transition.after[f"tip_out_of_plane_{b + 1}"] for b in range(turbine.n_blades))
        return -self.weight * sum(_bounded_square(max(tip, 0.0) / reference) for tip in tips) / turbine.n_blades


@dataclass(frozen=True)
class TowerLoad:
    """Penalty on changes of the tower-base moment, which are what wears a tower.

    x = |dM| / (``scale`` * dt * M_ref): the length of the change of the moment vector over the step, against ``scale``
    times the moment of the Betz thrust at rated wind at hub height per second.
    """

    weight: float = 0.2
    scale: float = 0.25
    name: str = "tower_load"

    def __call__(self, transition: Transition) -> float:
        """Rate of reward [1/s]."""
        before, after = transition.before, transition.after
        change = math.hypot(
            after["tower_base_fore_aft_moment"] - before["tower_base_fore_aft_moment"],
            after["tower_base_side_side_moment"] - before["tower_base_side_side_moment"],
        )
        return -self.weight * _bounded_square(
            change / (self.scale * transition.dt * self._reference(transition.turbine))
        )

    @staticmethod
    def _reference(turbine: Turbine) -> float:
        """Tower-base moment of the Betz thrust at rated wind [N m]."""
        thrust = reference_flap_moment(turbine) * turbine.n_blades / (turbine.rotor_diameter / 3)
        return thrust * turbine.hub_height


@dataclass(frozen=True)
class ActuatorUse:
    """Penalty on actuator use: mean of |rate| / greatest rate over the blades' pitch, the yaw drive and the torque.

    The share of the pitch system is the actuator duty cycle. Torque counts by its change over the step. A turbine
    without yaw drive has the mean of the other two.
    """

    weight: float = 0.1
    name: str = "actuator_use"

    def __call__(self, transition: Transition) -> float:
        """Rate of reward [1/s]."""
        turbine, before, after = transition.turbine, transition.before, transition.after
        pitch = sum(abs(after[f"pitch_rate_{b + 1}"]) for b in range(turbine.n_blades)) / turbine.n_blades
        torque = abs(after["generator_torque"] - before["generator_torque"]) / transition.dt
        uses = [pitch / turbine.pitch.max_rate, torque / turbine.drivetrain.max_torque_rate]
        if turbine.nacelle.max_yaw_rate > 0.0:
            uses.append(abs(after["yaw_rate"]) / turbine.nacelle.max_yaw_rate)
        return -self.weight * sum(min(use, 1.0) for use in uses) / len(uses)


@dataclass(frozen=True)
class Overspeed:
    """Penalty on rotor speed above ``margin`` times rated: x = excess / (``scale`` * rated)."""

    weight: float = 0.6
    margin: float = 1.02
    scale: float = 0.1
    name: str = "overspeed"

    def __call__(self, transition: Transition) -> float:
        """Rate of reward [1/s]."""
        rated = transition.turbine.drivetrain.rated_rotor_speed
        excess = max(transition.after["rotor_speed"] / rated - self.margin, 0.0)
        return -self.weight * _bounded_square(excess / self.scale)


_TERMS = {term.name: term for term in (Power, TipDeflection, TowerLoad, ActuatorUse, Overspeed)}


def compose(reward: Mapping[str, float] | Iterable[RewardTerm] | None) -> tuple[RewardTerm, ...]:
    """Terms of a reward.

    Parameters
    ----------
    reward : None, mapping or iterable of RewardTerm
        None: all terms with their default weights. A mapping of names to weights changes those weights (zero drops the
        term). An iterable gives the terms themselves.

    Returns
    -------
    tuple of RewardTerm

    Raises
    ------
    ValueError
        If a name is unknown, a weight is negative, two terms share a name, or no term is left.
    """
    if reward is None:
        reward = {}
    if isinstance(reward, Mapping):
        unknown = [name for name in reward if name not in _TERMS]
        if unknown:
            raise ValueError(f"reward has no terms {unknown}; there are {tuple(_TERMS)}")
        terms = [cls(weight=float(reward[name])) if name in reward else cls() for name, cls in _TERMS.items()]
    else:
        terms = list(reward)
    for term in terms:
        if not (callable(term) and hasattr(term, "name") and hasattr(term, "weight")):
            raise ValueError(f"a reward term needs a name, a weight and must be callable, got {term!r}")
        if not 0 <= term.weight < math.inf:
            raise ValueError(
                f"the weight of reward term {term.name!r} must be finite and not negative, got {term.weight}"
            )
    terms = tuple(term for term in terms if term.weight > 0)
    if not terms or len({term.name for term in terms}) != len(terms):
        raise ValueError(f"reward needs at least one term and different names, got {[term.name for term in terms]}")
    return terms


def worst_rate(terms: Iterable[RewardTerm]) -> float:
    """Lower bound of the reward of one second of operation [1/s]."""
    return -sum(term.weight for term in terms)


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
