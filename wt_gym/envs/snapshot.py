"""An environment in the middle or at the end of an episode."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from wt_gym.envs.episode_start import Beginning
    from wt_gym.envs.reward_store import Course
    from wt_gym.envs.wind_sampler import EpisodeWind

__all__ = ["EnvSnapshot", "TwinSnapshot"]


@dataclass(frozen=True)
class EnvSnapshot:
    """What an environment continues from, see `wt_gym.envs.WindTurbineEnv.snapshot`.

    Attributes
    ----------
    simulator : object or None
        State of the simulator; None of one that failed.
    operation, kept : dict
        What the operation of the turbine and the environment are in the midst of.
    sensors : dict
        What the sensors remember.
    wind : EpisodeWind
    random : dict
        State of the random numbers.
    variation : dict or None
        State of those of the variation.
    twin : TwinSnapshot or None
        Of the turbine under the controller alone, with a relative reward.
    pictured : tuple or None
        Course of the signals in the picture.
    """

    simulator: Any
    operation: dict[str, Any]
    kept: dict[str, Any]
    sensors: dict[str, Any]
    wind: EpisodeWind
    random: dict[str, Any]
    variation: dict[str, Any] | None
    twin: TwinSnapshot | None
    pictured: tuple[Any, ...] | None


@dataclass(frozen=True)
class TwinSnapshot:
    """Where the controller alone is.

    Attributes
    ----------
    beginning : Beginning
        Of the episode.
    course : Course
        What it earned from there.
    steps : int
        That were simulated.
    state : EnvSnapshot or None
        Of the simulation; None where none runs.
    """

    beginning: Beginning
    course: Course
    steps: int
    state: EnvSnapshot | None
