"""Trainings by RLlib, PPO and SAC of its new API stack, and searches by Ray Tune, on a Ray cluster (extra ``ray``).

Files and records are those of every other training. A search is that of `wt_gym.learning.search`, with trials that do
not wait for each other: hyperparameters are drawn at random from the same spaces, and trials that lag behind are ended
early by asynchronous successive halving (Li et al., "A System for Massively Parallel Hyperparameter Tuning", MLSys
2020).
"""

from __future__ import annotations

import json
import pickle
import shutil
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import numpy as np
from ray import tune
from ray.rllib.algorithms.ppo import PPOConfig
from ray.rllib.algorithms.sac import SACConfig
from ray.rllib.core import DEFAULT_MODULE_ID
from ray.rllib.core.rl_module.default_model_config import DefaultModelConfig
from ray.tune.registry import register_env
from ray.tune.schedulers import ASHAScheduler
from ray.tune.search import BasicVariantGenerator
from stable_baselines3.common.callbacks import CallbackList
from stable_baselines3.common.running_mean_std import RunningMeanStd

from wt_gym.base.files import write_whole
from wt_gym.experiment.environments import compile_kernels_of
from wt_gym.experiment.execute import connected, processors, warm_nodes
from wt_gym.experiment.run_folder import RunFolder
from wt_gym.learning.hyperparameters import of_each_copy
from wt_gym.learning.models import read_replay_buffer
from wt_gym.learning.rllib_environment import (
    first_weights,
    make_runner_env,
    runner_report,
    set_runner_statistics,
    take_weights,
)
from wt_gym.learning.search import (
    SPACES,
    Choice,
    Range,
    check_search,
    claim,
    present_keys,
    search_result,
    tried,
    write_best,
)  # fmt: skip
from wt_gym.learning.train import Learner, train

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from ray.rllib.algorithms.algorithm import Algorithm
    from ray.rllib.algorithms.algorithm_config import AlgorithmConfig
    from stable_baselines3.common.base_class import BaseAlgorithm
    from stable_baselines3.common.callbacks import BaseCallback
    from stable_baselines3.common.vec_env import VecNormalize

    from wt_gym.learning.options import TrainingConfig


SAMPLE_TIMEOUT = 1800.0
"""Time that a runner has for its part of a batch [s]. RLlib's own 60 s are shorter than a first compilation, and it
throws away what comes later."""

_ALGORITHMS, _ENV = ("PPO", "SAC"), "wt_gym"
_UNKNOWN = {  # and what may be given all the same, because it means nothing
    "PPO": {"use_sde": (False,), "sde_sample_freq": (), "target_kl": (), "linear_policy": (False,)},
    "SAC": {"use_sde": (False,), "sde_sample_freq": (), "log_std_init": (), "linear_policy": (False,)},
}
# Where the files leave them out: those of stable-baselines3, not RLlib's.
_DEFAULTS: dict[str, dict[str, Any]] = {
    "PPO": {"clip_range": 0.2, "ent_coef": 0.0, "vf_coef": 0.5, "max_grad_norm": 0.5, "activation_fn": "tanh"},
    "SAC": {"ent_coef": "auto", "target_entropy": "auto", "activation_fn": "relu"},
}
_LEAST_STEPS = 500  # of an iteration of SAC: between two looks at clock and signals


def check_settings(config: TrainingConfig) -> None:
    """Refuse settings that RLlib lacks, by a ValueError."""
    if config.algorithm not in _ALGORITHMS:
        raise ValueError(f"with Ray the algorithm must be one of {', '.join(_ALGORITHMS)}, got {config.algorithm!r}")
    if config.budgets:
        raise ValueError(f"with Ray budgets must be left out, got {config.budgets!r}")
    values, unknown = config.resolved, _UNKNOWN[config.algorithm]
    for name, value in values.items():
        if name in unknown and value not in unknown[name]:
            raise ValueError(
                f"with Ray {name} of {config.algorithm} must be {(*unknown[name], 'left out')[0]}, got {value!r}"
            )
        if isinstance(value, str) and value.startswith("lin_") and name != "learning_rate":
            raise ValueError(f"with Ray {name} must be a number, only the learning rate can fall; got {value!r}")
    if values["normalize_observations"]:
        raise ValueError("with Ray normalize_observations must be false, got true")
    if values.get("activation_fn") == "elu":
        raise ValueError("with Ray activation_fn must be tanh or relu, got 'elu'")
    if config.algorithm == "SAC" and values.get("ent_coef", "auto") != "auto":
        raise ValueError(f"with Ray ent_coef of SAC must be auto, got {values['ent_coef']!r}")


def rllib_config(config: TrainingConfig, runners: int, session: int) -> AlgorithmConfig:
    """Configuration of RLlib's new API stack.

    Parameters
    ----------
    runners : int
        Processes that step the environments, which divide among them; 0: the one that learns.
    session : int
        Steps done before: a resumed training meets other winds than it began with.
    """
    check_settings(config)
    envs, rest = divmod(config.n_envs, max(1, runners))
    if rest or not envs:
        raise ValueError(f"{config.n_envs} environments cannot be divided among {runners} runners")
    values = _DEFAULTS[config.algorithm] | of_each_copy(config.resolved, config.n_envs)
    register_env(_ENV, make_runner_env)  # by Ray, in every process that asks for it
    settings, fragment = (_ppo if config.algorithm == "PPO" else _sac)(values, config, runners)
    context = {
        "env_id": config.env_id,
        "env_kwargs": config.env_kwargs,
        "mark": [config.seed, session],
        "gamma": values["gamma"] if values["normalize_rewards"] else None,
    }
    return (
        settings.environment(
            _ENV,
            env_config=context,
            normalize_actions=config.algorithm == "SAC",  # its squashed actions lie in -1 to 1
            clip_actions=True,  # as stable-baselines3: the environment refuses what lies outside
        )
        .framework("torch")
        .env_runners(
            num_env_runners=runners,
            num_envs_per_env_runner=envs,
            gym_env_vectorize_mode="vector_entry_point",
            rollout_fragment_length=fragment,
            sample_timeout_s=SAMPLE_TIMEOUT,
        )
        .fault_tolerance(restart_failed_env_runners=True)
        .rl_module(
            model_config=DefaultModelConfig(
                fcnet_hiddens=list(values["net_arch"]),
                fcnet_activation=values["activation_fn"],
                head_fcnet_hiddens=[],
                vf_share_layers=False,
                free_log_std=config.algorithm == "PPO",
            )
        )
        .debugging(seed=config.seed, log_level="ERROR")
    )


def _rate(value: Any, steps: int) -> Any:
    """Learning rate, or RLlib's schedule of one that falls to zero over the training."""
    if isinstance(value, str):
        return [[0, float(value.removeprefix("lin_"))], [steps, 0.0]]
    return value


def _ppo(values: dict[str, Any], config: TrainingConfig, runners: int) -> tuple[AlgorithmConfig, int]:
    """PPO as of stable-baselines3: no penalty of the divergence, no clipping of values."""
    settings = PPOConfig().training(
        lr=_rate(values["learning_rate"], config.total_steps),
        gamma=values["gamma"],
        lambda_=values["gae_lambda"],
        train_batch_size_per_learner=values["n_steps"] * config.n_envs,
        minibatch_size=min(values["batch_size"], values["n_steps"] * config.n_envs),
        num_epochs=values["n_epochs"],
        clip_param=values["clip_range"],
        entropy_coeff=values["ent_coef"],
        vf_loss_coeff=values["vf_coef"],
        vf_clip_param=float("inf"),
        use_kl_loss=False,
        grad_clip=values["max_grad_norm"],
        grad_clip_by="global_norm",
    )
    return settings, values["n_steps"]


def _sac(values: dict[str, Any], config: TrainingConfig, runners: int) -> tuple[AlgorithmConfig, int]:
    """SAC from a plain buffer, with as many updates after as many steps as stable-baselines3's."""
    fragment, batch = values["train_freq"], values["batch_size"]
    rate = _rate(values["learning_rate"], config.total_steps)
    sampled = fragment * config.n_envs
    updates = sampled if values["gradient_steps"] < 0 else values["gradient_steps"]
    # RLlib takes "intensity / native ratio" updates a round, and counts one runner too many in the ratio
    native = batch / (fragment * (config.n_envs // max(1, runners)) * (runners + 1))
    settings = (
        SACConfig()
        .training(
            actor_lr=rate,
            critic_lr=rate,
            alpha_lr=rate,
            lr=None,
            gamma=values["gamma"],
            tau=values["tau"],
            train_batch_size_per_learner=batch,
            training_intensity=updates * native,
            num_steps_sampled_before_learning_starts=values["learning_starts"],
            target_entropy=values["target_entropy"],
            replay_buffer_config={"type": "EpisodeReplayBuffer", "capacity": values["buffer_size"]},
        )
        .reporting(min_time_s_per_iteration=0, min_sample_timesteps_per_iteration=min(_LEAST_STEPS, config.total_steps))
    )
    return settings, fragment


class RllibLearner(Learner):
    """RLlib on a Ray cluster; see `wt_gym.learning.train.Learner`.

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
    samples_here = False

    def __init__(self, address: str | None = None, runners: int | None = None):
        if runners is not None and runners < 0:
            raise ValueError(f"the number of runners must be 0 or more, got {runners}")
        self._address, self._runners = address, runners
        self._algorithm: Algorithm | None = None

    def check(self, config: TrainingConfig) -> None:
        """As `Learner.check`."""
        check_settings(config)
        if self._runners and config.n_envs % self._runners:
            raise ValueError(f"{config.n_envs} environments cannot be divided among {self._runners} runners")

    def learn(
        self, config: TrainingConfig, model: BaseAlgorithm, run: RunFolder, callbacks: Sequence[BaseCallback]
    ) -> None:
        """As `Learner.learn`."""
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
        """As `Learner.save`.

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
            algorithm.local_replay_buffer.set_state(read_replay_buffer(folder / "replay_buffer.pkl"))
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
            returns = RunningMeanStd(epsilon=0.0)
            for report in reports:
                returns.update_from_moments(*report["statistics"])
            vars(venv.ret_rms).update(vars(returns))
            episodes = [{"episode": episode} for report in reports for episode in report["episodes"]]
            callback.update_locals({"infos": episodes})
            going = callback.on_step()
        callback.on_training_end()


def _each_runner(algorithm: Algorithm, ask: Callable[[Any], Any]) -> list[Any]:
    """Ask every runner that steps environments."""
    remote = algorithm.config.num_env_runners > 0
    answers: list[Any] = algorithm.env_runner_group.foreach_env_runner(ask, local_env_runner=not remote)
    return answers


_TRIALS = "tune"
_FAILURES = 2  # of processes and machines; each begins the trial again


def tune_search(
    config: TrainingConfig,
    folder: str | Path,
    trials: int,
    progress: Callable[[str], None] | None = None,
    address: str | None = None,
) -> dict[str, Any]:
    """Search as `wt_gym.learning.search.search` does; the number of trials is fixed when the search begins.

    Parameters
    ----------
    address : str, optional
        As of `wt_gym.experiment.execute.executor_for`.
    """
    check_search(config, trials)
    with RunFolder(folder) as run, connected(address):
        claim(run.path, config, trials=trials)
        warm_nodes(partial(compile_kernels_of, config.env_id, config.env_kwargs))
        results = _tuner(config, run.path, trials).fit()
        ended = [result for result in results if result.error is None and result.metrics and result.metrics.get("done")]
        rows = [(_hyperparameters(config, result.config), result.metrics["episode_return"]) for result in ended]
        if progress is not None:
            for found, value in rows:
                progress(f"return {value:+.2f} with {found}")
        best = max(rows, key=lambda row: row[1], default=None)
        written = None if best is None else write_best(config, run.path, *best, len(ended))
        return search_result(len(ended), trials, "SIGINT", written, best and best[1])


def _tuner(config: TrainingConfig, folder: Path, trials: int) -> tune.Tuner:
    """Tuner of a new search, or of one to resume."""

    def trial(found: dict[str, Any]) -> None:
        _trial(config, _hyperparameters(config, found))

    trainable = tune.with_resources(trial, {"cpu": 1})
    path = folder.absolute() / _TRIALS
    if tune.Tuner.can_restore(str(path)):
        return tune.Tuner.restore(str(path), trainable, resume_unfinished=True, resume_errored=True)
    space = SPACES[config.algorithm]
    random = np.random.RandomState(config.seed)
    generator = BasicVariantGenerator(points_to_evaluate=[present_keys(config)], random_state=random)
    scheduler = ASHAScheduler(
        time_attr="steps", max_t=2 * config.total_steps, grace_period=max(1, config.total_steps // 3)
    )
    return tune.Tuner(
        trainable,
        param_space={name: _domain(part) for name, part in space.items()},
        tune_config=tune.TuneConfig(
            metric="episode_return", mode="max", num_samples=trials, search_alg=generator, scheduler=scheduler
        ),
        run_config=tune.RunConfig(
            name=_TRIALS,
            storage_path=str(folder.absolute()),
            failure_config=tune.FailureConfig(max_failures=_FAILURES),
            verbose=0,
        ),
    )


def _domain(part: Range | Choice) -> Any:
    """Ray's domain of a part of the search space."""
    if not isinstance(part, Range):
        return tune.choice([part.key(value) for value in part.values])  # Ray would take a list apart
    if isinstance(part.low, int):
        return tune.randint(part.low, part.high + 1)
    return (tune.loguniform if part.log else tune.uniform)(part.low, part.high)


def _hyperparameters(config: TrainingConfig, found: dict[str, Any]) -> dict[str, Any]:
    """Hyperparameters of the keys by which Ray knows them."""
    space = SPACES[config.algorithm]
    return {name: key if isinstance(space[name], Range) else json.loads(key) for name, key in found.items()}


def _trial(config: TrainingConfig, hyperparameters: dict[str, Any]) -> None:
    """Train on a machine of the cluster, in the folder that Tune has given the trial, and report each evaluation."""

    def report(steps: int, figures: dict[str, Any]) -> bool:
        tune.report({"episode_return": figures["episode_return"], "steps": steps})
        return True

    train(tried(config, hyperparameters), "training", on_evaluation=report, overwrite=True, progress=False)
