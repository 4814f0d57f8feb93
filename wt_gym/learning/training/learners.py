"""Who learns: stable-baselines3 in this process; RLlib's is `wt_gym.learning.distributed.rllib_learner`."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

from stable_baselines3.common.callbacks import CallbackList

from wt_gym.learning.training.callbacks import EpisodeFigures
from wt_gym.learning.training.models import save_replay_buffer

if TYPE_CHECKING:
    from collections.abc import Sequence

    from stable_baselines3.common.base_class import BaseAlgorithm
    from stable_baselines3.common.callbacks import BaseCallback

    from wt_gym.experiment.run_folder import RunFolder
    from wt_gym.learning.training.config import TrainingConfig

__all__ = ["Learner", "LocalLearner"]


class Learner(Protocol):
    """Takes the steps of a training and improves its model.

    Attributes
    ----------
    engine : str
        Of `wt_gym.experiment.execute.ENGINES`.
    packages : tuple of str
        Whose versions the record names.
    figures : tuple of BaseCallback
        Callbacks that look at every single step, for those who show them.
    samples_here : bool
        Whether the environments of this process are stepped; otherwise one stands for all.
    """

    engine: str
    packages: tuple[str, ...]
    figures: tuple[BaseCallback, ...]
    samples_here: bool

    def check(self, config: TrainingConfig) -> None:
        """Refuse a configuration that this one cannot learn by.

        Raises
        ------
        ValueError
        """

    def learn(
        self, config: TrainingConfig, model: BaseAlgorithm, run: RunFolder, callbacks: Sequence[BaseCallback]
    ) -> None:
        """Learn until the steps of the configuration are done or a callback says no."""

    def save(self, model: BaseAlgorithm, run: RunFolder) -> None:
        """Write what resuming needs beside model and statistics."""


class LocalLearner:
    """stable-baselines3 in this process."""

    engine = "local"
    packages: tuple[str, ...] = ("stable-baselines3", "sb3-contrib", "torch", "gymnasium")
    samples_here = True

    def __init__(self) -> None:
        self.figures: tuple[BaseCallback, ...] = (EpisodeFigures(),)

    def check(self, config: TrainingConfig) -> None:
        """It takes every configuration."""

    def learn(
        self, config: TrainingConfig, model: BaseAlgorithm, run: RunFolder, callbacks: Sequence[BaseCallback]
    ) -> None:
        """As `Learner.learn`."""
        steps = config.total_steps - model.num_timesteps
        model.learn(steps, callback=CallbackList(list(callbacks)), reset_num_timesteps=False)

    def save(self, model: BaseAlgorithm, run: RunFolder) -> None:
        """As `Learner.save`."""
        save_replay_buffer(model, run.buffer)
