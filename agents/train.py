"""Training with stable-baselines3's PPO; observations come in scales of about one, rewards are normalised."""

from __future__ import annotations

import json
import time
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import gymnasium as gym
import numpy as np
import torch
from stable_baselines3 import PPO
from stable_baselines3.common.callbacks import BaseCallback, CallbackList, CheckpointCallback
from stable_baselines3.common.monitor import Monitor
from stable_baselines3.common.vec_env import DummyVecEnv, SubprocVecEnv, VecEnv, VecNormalize

import wt_gym
from agents.progress import ProgressLine, clock
from agents.trained import MODEL_FILE, NORMALISATION_FILE, RECORD_FILE
from wt_gym.envs.layout import layout_of

if TYPE_CHECKING:
    from collections.abc import Callable

__all__ = ["TrainingConfig", "make_training_env", "train"]


@dataclass(frozen=True)
class TrainingConfig:
    """What to train on, for how long, and how.

    Attributes
    ----------
    env_id : str
    env_kwargs : dict
        Arguments of the environment.
    total_steps : int
        Environment steps over all copies; the last rollout of ``n_steps`` a copy is finished beyond them.
    max_seconds : float or None
        Wall time after which training stops, whatever the steps.
    n_envs : int
        Copies of the environment, one process each if more than one.
    seed : int
    checkpoint_steps : int
        Steps between checkpoints.
    gamma : float
        Discount per control step; 0.98 at 0.2 s looks about 10 s ahead.
    n_steps, batch_size, n_epochs, learning_rate, gae_lambda, log_std_init, hidden
        As in stable-baselines3; ``hidden`` are the layers of both networks. ``log_std_init`` keeps the first, random
        policy gentle enough for episodes to last.
    normalise_observations : bool
        By running statistics of the training; observations have scales of about one without.
    """

    env_id: str = "wt_gym/LoadReduction-v0"
    env_kwargs: dict[str, Any] = field(default_factory=dict)
    total_steps: int = 200_000
    max_seconds: float | None = None
    n_envs: int = 1
    seed: int = 0
    checkpoint_steps: int = 50_000
    gamma: float = 0.98
    n_steps: int = 1024
    batch_size: int = 256
    n_epochs: int = 6
    learning_rate: float = 4e-4
    gae_lambda: float = 0.95
    log_std_init: float = -1.2
    normalise_observations: bool = False
    hidden: tuple[int, ...] = (64, 64)


def make_training_env(config: TrainingConfig) -> VecEnv:
    """Copies of the environment with statistics of rewards.

    The kernels are compiled, or read from the cache, here before any worker starts; workers are started by forkserver
    or spawn, because a fork would copy the threads of numba and torch in a broken state.

    Returns
    -------
    VecNormalize
    """
    makers = [_maker(config.env_id, config.env_kwargs) for _ in range(config.n_envs)]
    if config.n_envs == 1:
        venv: VecEnv = DummyVecEnv(makers)
    else:
        _compile(config)
        venv = SubprocVecEnv(makers, start_method="forkserver")
    venv.seed(config.seed)
    return VecNormalize(venv, norm_obs=config.normalise_observations, gamma=config.gamma)


def _maker(env_id: str, kwargs: dict[str, Any]) -> Callable[[], gym.Env]:
    """Give a function that builds one monitored environment, in this process or another."""

    def make() -> gym.Env:
        import wt_gym  # noqa: F401 - registers the environments in a fresh process

        return Monitor(gym.make(env_id, **kwargs))

    return make


def _compile(config: TrainingConfig) -> None:
    """Run one step, so that every kernel is in the cache."""
    env = gym.make(config.env_id, **config.env_kwargs)
    env.reset(seed=0)
    env.step(np.zeros(env.action_space.shape, dtype=np.float32))
    env.close()


class _Watch(BaseCallback):
    """Keeps the learning curve, shows progress and stops at the time limit."""

    def __init__(self, config: TrainingConfig, control_dt: float, shown: bool):
        super().__init__()
        self._config, self._control_dt = config, control_dt
        self._line, self._started = ProgressLine(shown), time.monotonic()
        self.curve: dict[str, list] = {"steps": [], "episode_return": [], "episode_length": []}

    @property
    def seconds(self) -> float:
        """Time since the start [s]."""
        return time.monotonic() - self._started

    def _on_step(self) -> bool:
        for info in self.locals["infos"]:
            if "episode" in info:
                self.curve["steps"].append(int(self.num_timesteps))
                self.curve["episode_return"].append(float(info["episode"]["r"]))
                self.curve["episode_length"].append(float(info["episode"]["l"]) * self._control_dt)
        self._line.show(self.text())
        limit = self._config.max_seconds
        return limit is None or self.seconds < limit

    def text(self) -> str:
        """Describe the state of the training."""
        limit, seconds = self._config.max_seconds, self.seconds
        recent = self.curve["episode_return"][-10:]
        returns = f"mean return of the last {len(recent)} {np.mean(recent):.1f}" if recent else "none finished yet"
        return (
            f"training {self.num_timesteps} of about {self._config.total_steps} steps, {clock(seconds)}"
            f"{f' of {clock(limit)}' if limit is not None else ''} min, {self.num_timesteps / max(seconds, 1e-9):.0f}"
            f" steps/s, {len(self.curve['steps'])} episodes, {returns}"
        )

    def finish(self) -> None:
        """Show the last line."""
        self._line.show(self.text(), final=True)


def train(config: TrainingConfig, folder: str | Path, *, progress: bool = True) -> dict[str, Any]:
    """Train a PPO policy.

    Parameters
    ----------
    config : TrainingConfig
    folder : str or path
        Gets ``model.zip``, ``vecnormalize.pkl`` (the statistics), ``training.json`` (the record) and ``checkpoints/``.
    progress : bool
        Show progress on standard error.

    Returns
    -------
    dict
        The record: algorithm, configuration, steps, wall_seconds, control_dt and the learning curve.
    """
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    # The networks are small: more threads only take time from the simulations.
    torch.set_num_threads(1)
    venv = make_training_env(config)
    try:
        layout, seeds = layout_of(venv), venv.get_attr("wind")[0].seeds
        model = PPO(
            "MlpPolicy",
            venv,
            learning_rate=config.learning_rate,
            n_steps=config.n_steps,
            batch_size=config.batch_size,
            n_epochs=config.n_epochs,
            gamma=config.gamma,
            gae_lambda=config.gae_lambda,
            policy_kwargs={"net_arch": list(config.hidden), "log_std_init": config.log_std_init},
            seed=config.seed,
            device="cpu",
        )
        watch = _Watch(config, layout.control_dt, progress)
        checkpoints = CheckpointCallback(
            max(1, config.checkpoint_steps // config.n_envs), str(folder / "checkpoints"), "ppo", save_vecnormalize=True
        )
        model.learn(config.total_steps, callback=CallbackList([watch, checkpoints]))
        watch.finish()
        model.save(folder / MODEL_FILE)
        venv.save(str(folder / NORMALISATION_FILE))
    finally:
        venv.close()
    record = {
        "algorithm": "PPO",
        "steps": int(model.num_timesteps),
        "wall_seconds": watch.seconds,
        "control_dt": layout.control_dt,
        "observation": list(layout.observation.names),
        "action": list(layout.action.names),
        "normalised": config.normalise_observations,
        "wind_seeds": None if seeds is None else list(seeds),
        "wt_gym": wt_gym.__version__,
        "config": asdict(config),
        "curve": watch.curve,
    }
    (folder / RECORD_FILE).write_text(json.dumps(record, indent=1, default=str) + "\n", encoding="utf-8")
    return record
