"""Fatigue in the reward: moments freed of their slow mean, squared, and exact damage by rainflow counting."""

import itertools
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import ClassVar, cast

from wt_gym.analysis.metrics import BLADE_EXPONENT, TOWER_EXPONENT
from wt_gym.control.design import reference_flap_moment, reference_tower_moment
from wt_gym.control.sensors import to_harmonic
from wt_gym.envs.terms import HighPass, Transition, bounded_square
from wt_gym.simulation import Signals
from wt_gym.turbines import Turbine

LOADS = ("flap_mean", "flap_tilt", "flap_yaw", "tower_fore_aft", "tower_side_side")
"""Loads of the fatigue terms, each over the reference of its term and freed of its mean."""


class RainflowCounter:
    """Damage of a load by rainflow cycles, after every sample exactly that of the history so far.

    Counting follows ASTM E1049-85, section 5.4.4: of the last three turning points the older range Y is counted as soon
    as the newer range X reaches it, as a half cycle where Y holds the start of the history, as a full one elsewhere;
    what is left at the end counts as half cycles. The current sample stands for a turning point, which decides nothing
    too early, because the range that ends in it can only grow before it turns. Damage never falls: a range that X just
    reaches has the same damage in the residue, as two halves, as it has when counted.

    Parameters
    ----------
    exponent : float
        Woehler exponent m [-].
    scale : float
        Range that counts as 1, in the unit of the load.

    Attributes
    ----------
    closed : float
        Sum of n_i (S_i / scale)^m over the counted cycles [-].
    turning_points : list of float
        Residue, the current sample last.
    """

    def __init__(self, exponent: float, scale: float = 1.0):
        if not (exponent > 0.0 and scale > 0.0):
            raise ValueError(f"exponent and scale must be positive, got {exponent!r} and {scale!r}")
        self.exponent, self.scale = float(exponent), float(scale)
        self.closed = 0.0
        self.turning_points: list[float] = []

    def add(self, value: float) -> None:
        """Take the next sample."""
        points = self.turning_points
        if points and value == points[-1]:
            return
        if len(points) >= 2 and (value > points[-1]) == (points[-1] > points[-2]):
            points[-1] = value
        else:
            points.append(value)
        while len(points) >= 3:
            older, newer = abs(points[-2] - points[-3]), abs(points[-1] - points[-2])
            if newer < older:
                break
            if len(points) == 3:
                self.closed += 0.5 * self._damage(older)
                del points[0]
            else:
                self.closed += self._damage(older)
                del points[-3:-1]

    @property
    def damage(self) -> float:
        """Sum of n_i (S_i / scale)^m over counted cycles and the half cycles of the residue [-]."""
        points = self.turning_points
        return self.closed + 0.5 * sum(self._damage(abs(b - a)) for a, b in itertools.pairwise(points))

    def _damage(self, span: float) -> float:
        """Damage of one full cycle [-]."""
        return float((span / self.scale) ** self.exponent)


@dataclass(eq=False)
class BladeFatigue:
    """Penalty on the flapwise root moments freed of their mean: blade by blade and in the fixed frame.

    With m_b the high-passed moment of blade b at azimuth psi_b the tilt and yaw moments of the rotor are
    ``m_t = 2/N sum m_b cos psi_b`` and ``m_y = 2/N sum m_b sin psi_b`` (Coleman's transformation, e.g. Bir,
    NREL/CP-500-42553). The penalty is on ``x^2 = ((1 - s) mean(m_b^2) + s (m_t^2 + m_y^2) / 2) / (scale M)^2`` with M
    of `reference_loads.reference_flap_moment`. For three blades ``mean(m_b^2) = m_0^2 + (m_t^2 + m_y^2) / 2``,
    m_0 being the mean of the blades: the share s takes weight from m_0, which follows the turbulence that is common to
    all blades and that nobody can control much.

    Parameters
    ----------
    scale : float
        x is 1 for a moment of this share of the reference moment [-].
    fixed_frame : float
        Share s of the tilt and yaw moments, from 0 to 1 [-].
    time_constant : float
        Of the high-pass filter [s]; the load of one turn passes.
    """

    weight: float = 1.5
    scale: float = 0.35
    fixed_frame: float = 0.5
    time_constant: float = 10.0
    name: str = "blade_fatigue"
    begins_with_means: ClassVar[bool] = True
    rows: ClassVar[tuple[list[int], list[int]]] = [0, 1, 2], [0]
    """Places among `LOADS`, and of those whose slow part the filter takes off: what turns passes it."""
    loads: tuple[float, ...] = field(default=(0.0, 0.0, 0.0), init=False)
    _filters: list[HighPass] = field(default_factory=list, init=False)

    def reset(self, turbine: Turbine, signals: Signals) -> None:
        """Start an episode with the mean moment of all blades, of the signals given, as the mean of each."""
        n = turbine.n_blades
        mean = sum(signals["root_flap_moment"].tolist()) / n
        self._filters = [HighPass(self.time_constant, mean) for _ in range(n)]
        self._reference = self.reference(turbine)

    def reference(self, turbine: Turbine) -> float:
        """Moment for which x is 1 [N m]."""
        return self.scale * reference_flap_moment(turbine)

    def __call__(self, transition: Transition) -> float:
        """Rate of reward [1/s]."""
        if not self._filters:
            self.reset(transition.turbine, transition.before)
        after, dt = transition.after, transition.dt
        measured = after["root_flap_moment"].tolist()  # numbers one by one: arrays of three are slow
        moments = [high_pass(moment, dt) for high_pass, moment in zip(self._filters, measured, strict=True)]
        tilt, yaw = to_harmonic(moments, after["azimuth"])
        single = sum([m * m for m in moments]) / len(moments)
        square = (1.0 - self.fixed_frame) * single + self.fixed_frame * 0.5 * (tilt * tilt + yaw * yaw)
        reference = self._reference
        self.loads = sum(moments) / len(moments) / reference, tilt / reference, yaw / reference
        return -self.weight * bounded_square(square / (self._reference * self._reference))


@dataclass(eq=False)
class _TowerFatigue:
    """Penalty on a bending moment of the tower base freed of its mean; x = moment / (``scale`` M).

    M is the moment of the Betz thrust at rated wind at hub height.

    Parameters
    ----------
    scale : float
        x is 1 for a moment of this share of M [-].
    time_constant : float
        Of the high-pass filter [s].
    """

    weight: float
    scale: float
    time_constant: float = 10.0
    name: str = ""
    channel: ClassVar[str]
    rows: ClassVar[tuple[list[int], list[int]]]
    begins_with_means: ClassVar[bool] = True
    loads: tuple[float, ...] = field(default=(0.0,), init=False)
    _filter: HighPass | None = field(default=None, init=False)

    def reset(self, turbine: Turbine, signals: Signals) -> None:
        """Start an episode with the first moment as the mean."""
        self._filter = HighPass(self.time_constant, signals[self.channel])
        self._reference = self.reference(turbine)

    def reference(self, turbine: Turbine) -> float:
        """Moment for which x is 1 [N m]."""
        return self.scale * reference_tower_moment(turbine)

    def __call__(self, transition: Transition) -> float:
        """Rate of reward [1/s]."""
        if self._filter is None:
            self.reset(transition.turbine, transition.before)
        x = cast("HighPass", self._filter)(transition.after[self.channel], transition.dt) / self._reference
        self.loads = (x,)
        return -self.weight * bounded_square(x * x)


@dataclass(eq=False)
class TowerForeAftFatigue(_TowerFatigue):
    __doc__ = (_TowerFatigue.__doc__ or "").replace("a bending moment", "the fore-aft moment")

    weight: float = 1.0
    scale: float = 0.33
    name: str = "tower_fore_aft_fatigue"
    channel: ClassVar[str] = "tower_base_fore_aft_moment"
    rows: ClassVar[tuple[list[int], list[int]]] = [3], [3]


@dataclass(eq=False)
class TowerSideSideFatigue(_TowerFatigue):
    __doc__ = (_TowerFatigue.__doc__ or "").replace("a bending moment", "the side-side moment")

    weight: float = 1.0
    scale: float = 0.08
    name: str = "tower_side_side_fatigue"
    channel: ClassVar[str] = "tower_base_side_side_moment"
    rows: ClassVar[tuple[list[int], list[int]]] = [4], [4]


def present_loads(terms: Iterable[object]) -> list[float]:
    """`LOADS` of the last step, as the terms have them; zero of a term that is not there."""
    found = [0.0] * len(LOADS)
    for term in terms:
        if isinstance(term, BladeFatigue | _TowerFatigue):
            first = term.rows[0][0]
            found[first : first + len(term.loads)] = term.loads
    return found


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


@dataclass(eq=False)
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
    loads : sequence of Load, optional
        Default: `default_loads` of the turbine.

    Attributes
    ----------
    counters : dict of str to RainflowCounter
        By channel, of the current episode.
    """

    weight: float = 0.0
    loads: Sequence[Load] | None = None
    name: str = "damage"
    counters: dict[str, RainflowCounter] = field(default_factory=dict, init=False)
    worst_rate: ClassVar[float] = -math.inf
    """Lower bound of the rate [1/s]: there is none."""

    def __post_init__(self) -> None:
        self._given = self.loads

    def reset(self, turbine: Turbine, signals: Signals) -> None:
        """Start an episode with the first sample."""
        self.loads = default_loads(turbine) if self._given is None else self._given
        self.counters = {load.channel: RainflowCounter(load.exponent, load.reference) for load in self.loads}
        self._take(signals)
        self.damage = 0.0

    def __call__(self, transition: Transition) -> float:
        """Rate of reward [1/s]."""
        if not self.counters:
            self.reset(transition.turbine, transition.before)
        self._take(transition.after)
        damage = sum(load.share * self.counters[load.channel].damage for load in self.loads or ())
        grown, self.damage = damage - self.damage, damage
        return -self.weight * grown / transition.dt

    def _take(self, signals: Signals) -> None:
        for channel, counter in self.counters.items():
            counter.add(signals[channel])
