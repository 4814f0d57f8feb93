"""RLlib learns: PPO and SAC of its new API stack, with the files and records of every other training."""

from __future__ import annotations

import pickle
import shutil
from functools import partial
from typing import TYPE_CHECKING, Any, cast

import numpy as np
from ray.rllib.core import DEFAULT_MODULE_ID
from stable_baselines3.common.callbacks import CallbackList

from wt_gym.base.files import write_whole
from wt_gym.experiment.environments import compile_kernels_of
from wt_gym.experiment.execute import connected, processors, warm_nodes
from wt_gym.learning.distributed.rllib_environment import runner_report, set_runner_statistics
from wt_gym.learning.distributed.rllib_settings import check_settings, rllib_config
from wt_gym.learning.distributed.rllib_weights import first_weights, take_weights

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from pathlib import Path

    from ray.rllib.algorithms.algorithm import Algorithm
    from stable_baselines3.common.base_class import BaseAlgorithm
    from stable_baselines3.common.callbacks import BaseCallback
    from stable_baselines3.common.running_mean_std import RunningMeanStd
    from stable_baselines3.common.vec_env import VecNormalize

    from wt_gym.experiment.run_folder import RunFolder
    from wt_gym.learning.training.config import TrainingConfig

__all__ = ["RllibLearner"]


class RllibLearner:
    """RLlib on a Ray cluster; see `wt_gym.learning.training.learners.Learner`.

    A model of stable-baselines3 mirrors RLlib's policy: it is what is evaluated and written.

    Parameters
    ----------
    address : str, optional
        As of `wt_gym.experiment.execute.executor_for`.
    runners : int, optional
        Processes that step the environments, a processor each; 0: the one that learns. Default: as many as there are
        processors, and at most one an environment, such that the environments can be divided.
    """

    engine = "ray"
    packages: tuple[str, ...] = ("ray", "stable-baselines3", "torch", "gymnasium")
    figures: tuple[BaseCallback, ...] = ()
    samples_here = False

    def __init__(self, address: str | None = None, runners: int | None = None):
        if runners is not None and runners < 0:
            raise ValueError(f"the number of runners must be 0 or more, got {runners}")
        self._address, self._runners = address, runners
        self._algorithm: Algorithm | None = None

    def check(self, config: TrainingConfig) -> None:
        """As `wt_gym.learning.training.learners.Learner.check`."""
        check_settings(config)
        if self._runners and config.n_envs % self._runners:
            raise ValueError(f"{config.n_envs} environments cannot be divided among {self._runners} runners")

    def learn(
        self, config: TrainingConfig, model: BaseAlgorithm, run: RunFolder, callbacks: Sequence[BaseCallback]
    ) -> None:
        """As `wt_gym.learning.training.learners.Learner.learn`."""
        with connected(self._address):
            warm_nodes(partial(compile_kernels_of, config.env_id, config.env_kwargs))
            runners = self._runners_for(config)
            self._algorithm = rllib_config(config, runners, model.num_timesteps).build_algo()
            try:
                self._begin(model, run)
                self._loop(config, model, CallbackList(list(callbacks)))
                self.save(model, run)  # while RLlib is there
            finally:
                self._algorithm.stop()
                self._algorithm = None

    def save(self, model: BaseAlgorithm, run: RunFolder) -> None:
        """As `wt_gym.learning.training.learners.Learner.save`.

        Two checkpoints stay: the model beside them may still be that of the former.
        """
        if self._algorithm is None:
            return  # saved when it ended
        for old in run.former_checkpoints(model.num_timesteps)[:-1]:
            shutil.rmtree(old)
        folder = run.rllib(model.num_timesteps)
        partial_folder = folder.with_name(f".{folder.name}.partial")
        for left in (partial_folder, folder):
            if left.exists():
                shutil.rmtree(left)
        self._algorithm.save_to_path(str(partial_folder.absolute()))
        buffer = self._algorithm.local_replay_buffer
        if buffer is not None:
            write_whole(partial_folder / "replay_buffer.pkl", partial(pickle.dump, buffer.get_state()))
        partial_folder.rename(folder)

    def _runners_for(self, config: TrainingConfig) -> int:
        """Processes that step the environments."""
        if self._runners is not None:
            return self._runners
        most = min(processors(), config.n_envs)
        return max(n for n in range(1, most + 1) if config.n_envs % n == 0)

    def _begin(self, model: BaseAlgorithm, run: RunFolder) -> None:
        """Start from the networks of a fresh model, or from a checkpoint."""
        algorithm, venv = cast("Algorithm", self._algorithm), cast("VecNormalize", model.get_vec_normalize_env())
        if model.num_timesteps == 0:
            weights = algorithm.learner_group.get_weights()[DEFAULT_MODULE_ID]
            weights = {**weights, **first_weights(model)}
            algorithm.learner_group.set_weights({DEFAULT_MODULE_ID: weights})
            algorithm.env_runner_group.sync_weights(from_worker_or_learner_group=algorithm.learner_group)
            return
        folder = run.rllib(model.num_timesteps)
        if not folder.is_dir():
            raise FileNotFoundError(f"{folder} is missing: resuming a training requires RLlib's checkpoint")
        algorithm.restore_from_path(str(folder.absolute()))
        for other in run.former_checkpoints(model.num_timesteps):
            shutil.rmtree(other)  # of a session that was killed before its model was written
        if algorithm.local_replay_buffer is not None:
            algorithm.local_replay_buffer.set_state(_read_buffer(folder / "replay_buffer.pkl"))
        rms = venv.ret_rms
        share = float(rms.count) / max(1, algorithm.config.num_env_runners)
        _each_runner(algorithm, partial(set_runner_statistics, mean=float(rms.mean), var=float(rms.var), count=share))

    def _loop(self, config: TrainingConfig, model: BaseAlgorithm, callback: CallbackList) -> None:
        """Learn batch by batch."""
        callback.init_callback(model)
        callback.on_training_start({}, {})
        going, algorithm = True, cast("Algorithm", self._algorithm)
        venv = cast("VecNormalize", model.get_vec_normalize_env())
        while going and model.num_timesteps < config.total_steps:
            algorithm.train()
            reports = [report for report in _each_runner(algorithm, runner_report) if report is not None]
            model.num_timesteps += sum(report["steps"] for report in reports)
            weights = algorithm.learner_group.get_weights()[DEFAULT_MODULE_ID]
            take_weights(model, weights)
            _merge(venv.ret_rms, [report["statistics"] for report in reports])
            episodes = [{"episode": episode} for report in reports for episode in report["episodes"]]
            callback.update_locals({"infos": episodes})
            going = callback.on_step()
        callback.on_training_end()


def _each_runner(algorithm: Algorithm, ask: Callable[[Any], Any]) -> list[Any]:
    """Ask every runner that steps environments."""
    remote = algorithm.config.num_env_runners > 0
    answers: list[Any] = algorithm.env_runner_group.foreach_env_runner(ask, local_env_runner=not remote)
    return answers


def _merge(whole: RunningMeanStd, statistics: list[tuple[float, float, float]]) -> None:
    """Put the statistics of the runners together (Chan et al. 1979)."""
    count = sum(n for _, _, n in statistics)
    mean = sum(m * n for m, _, n in statistics) / count
    whole.var = np.asarray(sum((v + (m - mean) ** 2) * n for m, v, n in statistics) / count)
    whole.mean, whole.count = np.asarray(mean), count


def _read_buffer(path: Path) -> dict[str, Any]:
    """Replay buffer of an earlier session; pickled, as every model here."""
    if not path.is_file():
        raise FileNotFoundError(f"{path} is missing: resuming a training requires its replay buffer")
    with path.open("rb") as file:
        buffer: dict[str, Any] = pickle.load(file)
    return buffer
