"""Options of the environment, in groups."""

from wt_gym.envs.options.actions import ActionOptions
from wt_gym.envs.options.controller import ControllerOptions
from wt_gym.envs.options.dial import DialOptions
from wt_gym.envs.options.electrical import ElectricalOptions
from wt_gym.envs.options.environment import (
    EnvOptions,
    env_arguments,
    environment_options,
    flat_arguments,
    registered_arguments,
)
from wt_gym.envs.options.faults import FaultOptions
from wt_gym.envs.options.grid import GridOptions
from wt_gym.envs.options.limits import LimitOptions
from wt_gym.envs.options.observations import ObservationOptions
from wt_gym.envs.options.rewards import RewardOptions
from wt_gym.envs.options.variation import Variation
from wt_gym.envs.options.wind import WindOptions

__all__ = [
    "ActionOptions",
    "ControllerOptions",
    "DialOptions",
    "ElectricalOptions",
    "EnvOptions",
    "FaultOptions",
    "GridOptions",
    "LimitOptions",
    "ObservationOptions",
    "RewardOptions",
    "Variation",
    "WindOptions",
    "env_arguments",
    "environment_options",
    "flat_arguments",
    "registered_arguments",
]
