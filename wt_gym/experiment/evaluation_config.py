"""Where and how long agents are evaluated."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from wt_gym.analysis.results import Wind
from wt_gym.base.options import check_duration
from wt_gym.envs.options import with_whole_paths
from wt_gym.envs.wind_sampler import LARGEST_WIND_SEED
from wt_gym.experiment.evaluation_winds import DEFAULT_WIND_SEEDS, USUAL_SPEED
from wt_gym.tasks import DEFAULT_ENV

__all__ = ["FIRST_SEED", "LEAST_MEASURED", "EvaluationConfig"]

FIRST_SEED = 2**40
"""Seeds of the environment in evaluations begin here, far beyond those of any training: what a wind seed does not
decide (gusts, directions, own inflows, noise) is never what a training has drawn."""
LEAST_MEASURED = 2.0
"""A metric of a few samples says nothing: runs that end earlier than this after the skipped start have none [s]."""
_SEEDS_A_WIND, _MOST_WINDS, _MOST_SEED = 1000, 2**20, 2**32


@dataclass(frozen=True)
class EvaluationConfig:
    """Where and how long to evaluate.

    Attributes
    ----------
    env_id : str
    env_kwargs : dict
        Arguments of the environment besides episode length; files of wind get whole paths.
    winds : tuple of Wind
        What is asked for; by default six held-out turbulence seeds at 15 m/s. Those that fit an environment are given
        by `wt_gym.experiment.evaluation_winds.winds_for`. Runs are labeled by the winds that they had.
    duration : float
        Length of a run [s].
    skip : float
        Start left out of the metrics [s].
    seed : int
        Of what the wind seeds do not decide: gusts, directions, your own inflows, measurement noise; counted from
        `FIRST_SEED` on, so that no training has met it.
    replay : float
        Length of the end of the runs in the first wind whose shapes are kept for a replay [s]; 0: none.
    iec_class : str, optional
        "I", "II" or "III": the wind climate for loads over a life; by default that of the turbine.
    mean_wind_speed : float, optional
        Annual mean wind speed at hub height in place of that of the class [m/s].
    weibull_shape : float
        Weibull exponent of the climate [-].

    Raises
    ------
    ValueError
        If nothing is left to evaluate, a time or seed is out of range, winds are missing or stand twice, or the
        arguments of the environment hold a length of the episodes.
    """

    env_id: str = DEFAULT_ENV
    env_kwargs: dict[str, Any] = field(default_factory=dict)
    winds: tuple[Wind, ...] = tuple(Wind(USUAL_SPEED, seed) for seed in DEFAULT_WIND_SEEDS)
    duration: float = 600.0
    skip: float = 30.0
    seed: int = 0
    replay: float = 20.0
    iec_class: str | None = None
    mean_wind_speed: float | None = None
    weibull_shape: float = 2.0

    def __post_init__(self) -> None:
        if not (self.skip >= 0.0 and self.duration >= self.skip + LEAST_MEASURED):
            raise ValueError(
                f"the skipped start must be at least 0 and the duration {LEAST_MEASURED:g} s longer or more, got "
                f"{self.skip:g} and {self.duration:g} s"
            )
        check_duration("the duration", self.duration)
        check_duration("the length of the replay", self.replay)
        if not 0 <= self.seed <= _MOST_SEED:
            raise ValueError(f"the seed must be from 0 to {_MOST_SEED}, got {self.seed!r}")
        if not self.winds or len(set(self.winds)) < len(self.winds) or len(self.winds) > _MOST_WINDS:
            labels = ", ".join(wind.label for wind in self.winds[:100])
            raise ValueError(f"1 to {_MOST_WINDS} winds must be given, each once, got {labels}")
        object.__setattr__(self, "env_kwargs", with_whole_paths(self.env_kwargs))
        for seed in (wind.seed for wind in self.winds if wind.seed is not None):
            if not 0 <= seed <= LARGEST_WIND_SEED:
                raise ValueError(f"a wind seed must be from 0 to {LARGEST_WIND_SEED}, got {seed!r}")
        for name in ("episode_length", "max_episode_steps"):
            if name in self.env_kwargs:
                raise ValueError(f"{name} follows from the duration of the evaluation; leave it out of env_kwargs")

    def seed_in(self, wind: Wind) -> int:
        """Seed of the environment in a wind: what the wind leaves open is drawn for each, once for all agents.

        Each seed and place of a wind has its own number: its last three digits are those of the seed, then come the
        place and the rest of the seed.
        """
        rest, first = divmod(self.seed, _SEEDS_A_WIND)
        return FIRST_SEED + first + _SEEDS_A_WIND * (self.winds.index(wind) + _MOST_WINDS * rest)

    def replay_in(self, wind: Wind) -> float:
        """Length of the replay of a run in a wind [s]."""
        return self.replay if wind == self.winds[0] else 0.0
