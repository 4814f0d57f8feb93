"""Environments to train on."""

from __future__ import annotations

import multiprocessing
import signal
from functools import partial
from typing import TYPE_CHECKING, Any

import gymnasium as gym
from stable_baselines3.common.monitor import Monitor
from stable_baselines3.common.vec_env import DummyVecEnv, SubprocVecEnv, VecEnv, VecMonitor, VecNormalize

from wt_gym.experiment.environments import compile_kernels
from wt_gym.learning.training.budgets import BudgetedVecEnv, allowed_costs
from wt_gym.learning.training.turbine_vec_env import TurbineVecEnv

if TYPE_CHECKING:
    from collections.abc import Callable

    from wt_gym.learning.training.config import TrainingConfig

__all__ = ["START_METHOD", "make_training_env", "monitored", "normalized"]

START_METHOD = "forkserver" if "forkserver" in multiprocessing.get_all_start_methods() else "spawn"
"""How processes that step environments begin: the former where there is one (not on Windows), because it is faster.

A fork would copy the threads of numba and torch in a broken state, once the kernels have been compiled or read from the
cache.
"""


def make_training_env(config: TrainingConfig) -> VecNormalize:
    """Copies of the environment with statistics of rewards.

    Several copies of an environment of this package are stepped by threads of this process, others in processes of
    their own.

    Raises
    ------
    ValueError
        If the environment cannot be made with these arguments.
    """
    first = _make(gym.make, config)
    if config.n_envs == 1:
        venv: VecEnv = DummyVecEnv([lambda: Monitor(first)])
    elif str(first.spec.vector_entry_point).startswith("wt_gym.") and not first.spec.additional_wrappers:
        first.close()
        venv = VecMonitor(_make(partial(TurbineVecEnv, num_envs=config.n_envs), config))
    else:
        compile_kernels(first)
        venv = SubprocVecEnv([monitored(config.env_id, config.env_kwargs)] * config.n_envs, start_method=START_METHOD)
    if config.budgets:
        venv = BudgetedVecEnv(venv, allowed_costs(config.budgets))
    return normalized(venv, config)


def normalized(venv: VecEnv, config: TrainingConfig) -> VecNormalize:
    """Statistics of rewards, and of observations where the configuration wants them, around environments."""
    hyperparameters = config.resolved
    return VecNormalize(
        venv,
        norm_obs=hyperparameters["normalize_observations"],
        norm_reward=hyperparameters["normalize_rewards"],
        gamma=hyperparameters["gamma"],
    )


def _make(make: Callable[..., Any], config: TrainingConfig) -> Any:
    """Make environments of an id with its arguments."""
    try:
        return make(config.env_id, **config.env_kwargs)
    except (TypeError, AttributeError) as error:  # an argument of another type, as from JSON
        raise ValueError(f"{config.env_id} cannot be made with the arguments {config.env_kwargs}: {error}") from error


def monitored(env_id: str, kwargs: dict[str, Any]) -> Callable[[], gym.Env]:
    """Give a function that makes a monitored environment in a process of its own."""

    def make() -> gym.Env:
        import wt_gym  # noqa: F401 - registers the environments in a fresh process

        # Ctrl-C reaches every process of the terminal; the training process alone decides when the others end.
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        signal.signal(signal.SIGTERM, signal.SIG_IGN)
        return Monitor(gym.make(env_id, **kwargs))

    return make
