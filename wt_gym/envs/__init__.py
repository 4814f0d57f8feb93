"""The Gymnasium layer: environment, observations, rewards and the wind of an episode."""

from wt_gym.envs.channels import OBSERVATION_GROUPS
from wt_gym.envs.fatigue import BladeFatigue, Damage, TowerForeAftFatigue, TowerSideSideFatigue
from wt_gym.envs.layout import EnvLayout, ObservationLayout, layout_of
from wt_gym.envs.power import Power
from wt_gym.envs.rewards import ActuatorUse, Overspeed, TipDeflection, TowerLoad
from wt_gym.envs.terms import RewardTerm, Transition
from wt_gym.envs.turbine_env import WindTurbineEnv
from wt_gym.envs.variation import Variation
from wt_gym.envs.vector_env import WindTurbineVectorEnv
from wt_gym.envs.wind_sampler import EVALUATION_WIND_SEEDS, TRAINING_WIND_SEEDS
from wt_gym.envs.wrappers import SafetyFilter, VectorReward

__all__ = [
    "EVALUATION_WIND_SEEDS",
    "OBSERVATION_GROUPS",
    "TRAINING_WIND_SEEDS",
    "ActuatorUse",
    "BladeFatigue",
    "Damage",
    "EnvLayout",
    "ObservationLayout",
    "Overspeed",
    "Power",
    "RewardTerm",
    "SafetyFilter",
    "TipDeflection",
    "TowerForeAftFatigue",
    "TowerLoad",
    "TowerSideSideFatigue",
    "Transition",
    "Variation",
    "VectorReward",
    "WindTurbineEnv",
    "WindTurbineVectorEnv",
    "layout_of",
]
