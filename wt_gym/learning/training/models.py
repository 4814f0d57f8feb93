"""Models of stable-baselines3 from hyperparameters, fresh or as a run folder holds them."""

from __future__ import annotations

import pickle
from functools import partial
from typing import TYPE_CHECKING, Any, cast

import numpy as np
import torch
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.buffers import ReplayBuffer
from stable_baselines3.common.off_policy_algorithm import OffPolicyAlgorithm
from stable_baselines3.common.utils import LinearSchedule

from wt_gym.base.files import write_whole
from wt_gym.experiment.trained_agent import ALGORITHM_CLASSES, DAMAGE, TrainedAgent
from wt_gym.learning.training.array_ppo import ArrayPPO
from wt_gym.learning.training.hyperparameters import of_each_copy

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path
    from typing import BinaryIO

    from stable_baselines3.common.vec_env import VecNormalize

    from wt_gym.experiment.run_folder import RunFolder
    from wt_gym.learning.training.config import TrainingConfig

__all__ = ["load_model", "make_model", "save_model", "save_replay_buffer"]

_OF_THE_POLICY = ("net_arch", "log_std_init", "activation_fn", "n_quantiles", "n_critics")
_OF_THE_ENVIRONMENT = ("normalize_observations", "normalize_rewards")
_LEARNING_CLASSES: dict[str, type[BaseAlgorithm]] = {**ALGORITHM_CLASSES, "PPO": ArrayPPO}
_ACTIVATIONS = {"tanh": torch.nn.Tanh, "relu": torch.nn.ReLU, "elu": torch.nn.ELU}


def make_model(config: TrainingConfig, venv: VecNormalize) -> BaseAlgorithm:
    """Fresh model of a configuration.

    Raises
    ------
    ValueError
        If the hyperparameters do not go together.
    """
    chosen = of_each_copy(config.resolved, venv.num_envs)
    values = {name: _value(entry) for name, entry in chosen.items() if name not in _OF_THE_ENVIRONMENT}
    policy = {name: values.pop(name) for name in _OF_THE_POLICY if name in values}
    try:
        return _LEARNING_CLASSES[config.algorithm](
            "MlpPolicy", venv, policy_kwargs=policy, seed=config.seed, device="cpu", **values
        )
    except AssertionError as error:  # stable-baselines3's own checks of one value against another
        raise ValueError(f"the hyperparameters do not go together: {error}") from error


def _value(entry: Any) -> Any:
    """What stable-baselines3 takes for an entry."""
    if isinstance(entry, str) and entry.startswith("lin_"):
        return LinearSchedule(float(entry.removeprefix("lin_")), 0.0, 1.0)
    if isinstance(entry, str):
        return _ACTIVATIONS.get(entry, entry)
    return list(entry) if isinstance(entry, tuple) else entry


def save_model(model: BaseAlgorithm, model_file: Path, normalization_file: Path) -> None:
    """Write a model and the statistics of its environment."""
    write_whole(normalization_file, partial(pickle.dump, model.get_vec_normalize_env()))
    write_whole(model_file, cast("Callable[[BinaryIO], None]", model.save))


def save_replay_buffer(model: BaseAlgorithm, path: Path) -> None:
    """Write the replay buffer of a model that has one."""
    if isinstance(model, OffPolicyAlgorithm):
        write_whole(path, cast("Callable[[BinaryIO], None]", model.save_replay_buffer))


def load_model(config: TrainingConfig, venv: VecNormalize, folder: RunFolder, buffered: bool = True) -> BaseAlgorithm:
    """Model as a training left it, with statistics, optimizer and replay buffer, to resume it.

    The environments are seeded by training seed and steps, so that they do not repeat their first episodes.

    Parameters
    ----------
    config : TrainingConfig
    venv : VecNormalize
        Gets the statistics of the folder.
    folder : RunFolder
    buffered : bool
        Whether the replay buffer belongs to the model.

    Raises
    ------
    FileNotFoundError
        If something is missing.
    ValueError
        If something is damaged, or does not fit the environment.
    """
    # of its own training
    agent = TrainedAgent.load(folder.model, config.algorithm, trust=True, classes=_LEARNING_CLASSES)
    if agent.normalization is None:
        raise FileNotFoundError(f"{folder.normalization} is missing: resuming a training requires its statistics")
    # there are statistics of observations only where these are normalized
    vars(venv).update({name: rms for name, rms in vars(agent.normalization).items() if name in ("obs_rms", "ret_rms")})
    model = agent.model
    try:
        model.set_env(venv)
    except (AssertionError, ValueError) as error:
        raise ValueError(f"the model in {folder.path} does not fit the environment: {error}") from error
    if buffered and isinstance(model, OffPolicyAlgorithm):
        model.replay_buffer = _read_replay_buffer(folder.buffer, venv.num_envs)
    model.set_random_seed(int(np.random.SeedSequence((config.seed, model.num_timesteps)).generate_state(1)[0] >> 1))
    return model


def _read_replay_buffer(path: Path, n_envs: int) -> ReplayBuffer:
    """Replay buffer of an earlier session."""
    if not path.is_file():
        raise FileNotFoundError(f"{path} is missing: resuming a training requires its replay buffer")
    try:
        with path.open("rb") as file:
            buffer = pickle.load(file)
    except DAMAGE as error:
        raise ValueError(f"the replay buffer {path} is damaged: {type(error).__name__}: {error}") from error
    if not isinstance(buffer, ReplayBuffer) or buffer.n_envs != n_envs:
        raise ValueError(
            f"{path} must hold a replay buffer for {n_envs} environments, got {getattr(buffer, 'n_envs', buffer)!r:.80}"
        )
    return buffer
