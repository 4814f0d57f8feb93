"""The Gymnasium layer: environment, observations, rewards and the wind of an episode."""

from wt_gym.envs.layout import EnvLayout, ObservationLayout, layout_of
from wt_gym.envs.observations import OBSERVATION_GROUPS
from wt_gym.envs.rewards import ActuatorUse, Overspeed, Power, RewardTerm, TipDeflection, TowerLoad, Transition
from wt_gym.envs.turbine_env import WindTurbineEnv
from wt_gym.envs.wind_sampler import EVALUATION_WIND_SEEDS, TRAINING_WIND_SEEDS

__all__ = [
    "EVALUATION_WIND_SEEDS",
    "OBSERVATION_GROUPS",
    "TRAINING_WIND_SEEDS",
    "ActuatorUse",
    "EnvLayout",
    "ObservationLayout",
    "Overspeed",
    "Power",
    "RewardTerm",
    "TipDeflection",
    "TowerLoad",
    "Transition",
    "WindTurbineEnv",
    "layout_of",
]
