"""Reward terms. A reward is the sum of its terms, each a rate in 1/s times the control step.

Every default term is bounded: power lies within [-w, 2 w] and each penalty within [-w, 0] per second, w being the
term's weight. So the worst reward a second of operation can bring is known (`worst_rate`), and a penalty for ending an
episode early can be set against it. Penalties grow as ``x^2 / (1 + x^2)``: quadratic for small x, half of the weight at
x = 1. Any callable with a ``name``, a ``weight`` and the same signature joins in; one that remembers something has a
``reset(turbine, signals)`` too. ``docs/rewards.md`` shows how the terms rank controllers.
"""

from wt_gym.envs.rewards.compose import DEFAULT_WEIGHTS, compose, reset, total, worst_rate
from wt_gym.envs.rewards.damage import Damage, Load
from wt_gym.envs.rewards.extremes import ExtremeLoads
from wt_gym.envs.rewards.fatigue import AVERAGED, BladeFatigue, TowerForeAftFatigue, TowerSideSideFatigue
from wt_gym.envs.rewards.function import FunctionTerm
from wt_gym.envs.rewards.loads import TipDeflection, TowerLoad
from wt_gym.envs.rewards.operation import ActuatorUse, Overspeed
from wt_gym.envs.rewards.power import Power, available_power
from wt_gym.envs.rewards.rainflow_counter import RainflowCounter
from wt_gym.envs.rewards.term import RewardTerm, Transition
from wt_gym.envs.rewards.tracking import PowerTracking

__all__ = [
    "AVERAGED",
    "DEFAULT_WEIGHTS",
    "ActuatorUse",
    "BladeFatigue",
    "Damage",
    "ExtremeLoads",
    "FunctionTerm",
    "Load",
    "Overspeed",
    "Power",
    "PowerTracking",
    "RainflowCounter",
    "RewardTerm",
    "TipDeflection",
    "TowerForeAftFatigue",
    "TowerLoad",
    "TowerSideSideFatigue",
    "Transition",
    "available_power",
    "compose",
    "reset",
    "total",
    "worst_rate",
]
