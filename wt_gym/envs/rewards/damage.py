"""Fatigue damage as a reward term, counted while the episode runs."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from wt_gym.analysis.metrics import BLADE_EXPONENT, TOWER_EXPONENT
from wt_gym.control.design import reference_flap_moment, reference_tower_moment
from wt_gym.envs.rewards.rainflow_counter import RainflowCounter

if TYPE_CHECKING:
    from wt_gym.envs.rewards.term import Transition
    from wt_gym.simulation import Signals
    from wt_gym.turbines import Turbine

__all__ = ["Damage", "Load"]


@dataclass(frozen=True)
class Load:
    """A load whose damage counts.

    Attributes
    ----------
    channel : str
        Signal of the simulator [N m].
    exponent : float
        Woehler exponent m [-].
    reference : float
        Damage-equivalent load at 1 Hz that does a damage of 1 per second [N m].
    share : float
        Factor on the damage [-].
    """

    channel: str
    exponent: float
    reference: float
    share: float


def default_loads(turbine: Turbine) -> tuple[Load, ...]:
    """Flapwise moments of the blades, fore-aft and side-side moment of the tower base, a third each.

    The references are 0.5 times `reference_flap_moment`, and 0.25 and 0.04 times the tower-base moment of the Betz
    thrust at rated wind: about the loads of the NREL 5-MW under its baseline controller at 16 m/s.
    """
    flap, tower, n = 0.5 * reference_flap_moment(turbine), reference_tower_moment(turbine), turbine.n_blades
    blades = tuple(Load(f"root_flap_moment_{b + 1}", BLADE_EXPONENT, flap, 1 / (3 * n)) for b in range(n))
    fore_aft = Load("tower_base_fore_aft_moment", TOWER_EXPONENT, 0.25 * tower, 1 / 3)
    return (*blades, fore_aft, Load("tower_base_side_side_moment", TOWER_EXPONENT, 0.04 * tower, 1 / 3))


class Damage:
    """Penalty on the fatigue damage that a step adds, by exact rainflow counting.

    The rate is minus the weight times the growth of ``sum share n_i (S_i / reference)^m`` over the rainflow cycles of
    the samples at the control steps, half cycles of the residue included: with a damage-equivalent load of its
    reference each load costs ``share`` per second, and an episode sums to the damage that
    `wt_gym.analysis.metrics.damage_equivalent_load` gives for the same samples.

    It is meant for evaluation: most of the damage comes at once, when a large cycle grows, which is hard to learn from,
    and with m = 10 a step's rate has no bound, so that `wt_gym.envs.rewards.worst_rate` is minus infinity and an early
    end may pay.

    Parameters
    ----------
    weight : float
    loads : sequence of Load, optional
        Default: `default_loads` of the turbine.
    name : str

    Attributes
    ----------
    counters : dict of str to RainflowCounter
        By channel, of the present episode.
    """

    def __init__(self, weight: float = 0.0, loads: Sequence[Load] | None = None, name: str = "damage"):
        self.weight, self.name = weight, name
        self._given = None if loads is None else tuple(loads)
        self._started = False

    @property
    def worst_rate(self) -> float:
        """Lower bound of the rate [1/s]: there is none."""
        return -math.inf

    def reset(self, turbine: Turbine, signals: Signals) -> None:
        """Start an episode with the first sample."""
        self._started = True
        self.loads = default_loads(turbine) if self._given is None else self._given
        self.counters = {load.channel: RainflowCounter(load.exponent, load.reference) for load in self.loads}
        self._take(signals)
        self.damage = 0.0

    def __call__(self, transition: Transition) -> float:
        """Rate of reward [1/s]."""
        if not self._started:
            self.reset(transition.turbine, transition.before)
        self._take(transition.after)
        damage = sum(load.share * self.counters[load.channel].damage for load in self.loads)
        grown, self.damage = damage - self.damage, damage
        return -self.weight * grown / transition.dt

    def _take(self, signals: Signals) -> None:
        for channel, counter in self.counters.items():
            counter.add(signals[channel])
