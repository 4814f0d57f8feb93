"""Training with stable-baselines3 and sb3-contrib: PPO, SAC and TQC, to be stopped, resumed and repeated."""

from __future__ import annotations

import importlib.util
import os
import sys
import time
from contextlib import closing
from dataclasses import asdict, replace
from importlib.metadata import version
from typing import TYPE_CHECKING, Any, cast

import torch
from stable_baselines3.common.logger import Logger, configure
from stable_baselines3.common.vec_env import unwrap_vec_wrapper

import wt_gym
from wt_gym.envs.layout import layout_of
from wt_gym.envs.terminations import PITCH_TRAVEL
from wt_gym.envs.wind_sampler import TRAINING_WIND_SEEDS
from wt_gym.experiment.environments import resolved_arguments, trained_arguments
from wt_gym.experiment.execute import executor_for
from wt_gym.experiment.run_folder import RunFolder
from wt_gym.experiment.trained_agent import BEST_MODEL_FILE, BEST_NORMALIZATION_FILE, RECORD_FILE, TrainedAgent
from wt_gym.learning.callbacks import (
    FIGURES,
    Checkpoints,
    EpisodeFigures,
    Evaluations,
    SelectionEvaluation,
    Watch,
    stop_on_signals,
)
from wt_gym.learning.environments import BudgetedVecEnv, BudgetUpdates, make_training_env
from wt_gym.learning.linear_env import make_modeled
from wt_gym.learning.models import load_model, make_model, save_model, save_replay_buffer
from wt_gym.learning.options import PretrainingOptions, TrainingConfig

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from stable_baselines3.common.base_class import BaseAlgorithm
    from stable_baselines3.common.callbacks import BaseCallback
    from stable_baselines3.common.vec_env import VecNormalize

    from wt_gym.learning.callbacks import StopRequest

__all__ = ["resume", "train"]

_PACKAGES = ("stable-baselines3", "sb3-contrib", "torch", "gymnasium")  # the record names their versions
LINEAR_ID = "wt_gym/LoadReduction-Linear-v0"
_MODELS = 64
"""Linear models side by side."""
_CURVE = ("steps", "episode_return", "episode_length")
_EVALUATION_CURVE = ("steps", *FIGURES)


def train(
    config: TrainingConfig,
    folder: str | Path,
    *,
    progress: bool = True,
    overwrite: bool = False,
    on_evaluation: Callable[[int, dict[str, Any]], bool] | None = None,
    stop: StopRequest | None = None,
) -> dict[str, Any]:
    """Train a policy.

    SIGINT and SIGTERM end the training after the step in which they come; everything is written, and `resume`
    continues it.

    Parameters
    ----------
    folder : str or path
        Gets ``model.zip``, ``vecnormalize.pkl`` (the statistics), ``training.json`` (the record), ``checkpoints/``,
        ``best_model.zip`` with its statistics, ``tensorboard/``, and the replay buffer of SAC and TQC.
    progress : bool
        Show progress on standard error.
    overwrite : bool
        Remove an earlier training from the folder.
    on_evaluation : callable, optional
        Called with steps and figures after every evaluation; training stops where it gives False.
    stop : StopRequest, optional
        Looked at after every step; default: one that SIGINT and SIGTERM set.

    Returns
    -------
    dict
        The record: algorithm, configuration, status, steps, wall_seconds, control_dt, the learning curve, and the
        evaluations. ``status`` is "finished", "time limit", "interrupted" (``stopped_by`` names the signal) or
        "stopped" (by ``on_evaluation``).

    Raises
    ------
    ValueError
        If the folder holds a training already or another process trains in it, or the environment cannot be made.
    """
    config = config.with_hyperparameters()
    with RunFolder(folder) as run:
        run.refuse_used(overwrite)
        if config.linear_steps:
            make_modeled(config.env_id, config.env_kwargs)  # refuses one without a linear model
        with closing(make_training_env(config)) as venv:
            model = make_model(config, venv)
            session = _Session(config, run, venv, model, {}, on_evaluation)
            run.clear()  # nothing can be refused any more
            if config.pretraining is not None:
                session.pretrain(progress, stop)
            if config.linear_steps:
                session.learn_on_linear_model(progress, stop)
            record = session.learn(progress, stop)
            run.remove_recordings()
            return record


def resume(
    folder: str | Path,
    *,
    total_steps: int | None = None,
    max_seconds: float | None = None,
    progress: bool = True,
    stop: StopRequest | None = None,
) -> dict[str, Any]:
    """Resume a training that was stopped, or is to have more steps.

    Steps, schedules, curves and statistics continue; environments start new episodes, in other winds than the first.

    Parameters
    ----------
    folder : str or path
        As `train` left it.
    total_steps : int, optional
        Altogether; default: as before.
    max_seconds : float, optional
        From now on; default: as before.
    progress, stop
        As of `train`.

    Returns
    -------
    dict
        As of `train`.

    Raises
    ------
    FileNotFoundError
        If the folder holds no training.
    ValueError
        If the training is finished and has done its steps, or a file is damaged.
    """
    RunFolder(folder).record()  # before the lock makes a folder
    with RunFolder(folder) as run:
        record = run.record()
        config = TrainingConfig(**TrainingConfig.named(record.get("config"))).limited(total_steps, max_seconds)
        arguments, before = resolved_arguments(config.env_id, config.env_kwargs), trained_arguments(record)
        if differing := [name for name in {**before, **arguments} if before.get(name) != arguments.get(name)]:
            raise ValueError(
                f"{config.env_id} has other arguments now than when the training in {run.path} began: "
                f"{', '.join(differing)}; start a new one, or give those of then by --env-kwargs"
            )
        with closing(make_training_env(config)) as venv:
            model = load_model(config, venv, run)
            # one that was stopped at its last step still lacks its last evaluation: that is made up for
            if model.num_timesteps >= config.total_steps and record.get("status") == "finished":
                raise ValueError(
                    f"the training in {run.path} has done its {config.total_steps} steps: give it more to resume"
                )
            return _Session(config, run, venv, model, record, None).learn(progress, stop)


class _Session:
    """One go of a training, from a fresh or a loaded model."""

    def __init__(
        self,
        config: TrainingConfig,
        run: RunFolder,
        venv: VecNormalize,
        model: BaseAlgorithm,
        before: dict[str, Any],
        on_evaluation: Callable[[int, dict[str, Any]], bool] | None,
    ):
        self._config, self._run, self._model = config, run, model
        # The networks are small: more threads only take time from the simulations.
        torch.set_num_threads(1)
        self._layout, self._wind = layout_of(venv), venv.get_attr("wind")[0]
        self._first_step = model.num_timesteps
        self._seconds_before = _entry(before, "wall_seconds", float, 0.0)
        self._sessions = list(_entry(before, "sessions", list, []))
        self._curve = _curve(before, _CURVE, self._first_step)
        evaluated = _entry(before, "evaluation", dict, None) or {}
        self._pretraining, self._linear = before.get("pretraining"), before.get("linear")
        budgeted = unwrap_vec_wrapper(venv, BudgetedVecEnv)
        self._budgets = None if budgeted is None else BudgetUpdates(budgeted, before.get("budgets"))
        self._evaluations = None
        if config.eval_every:
            self._evaluations = Evaluations(
                config.eval_every,
                SelectionEvaluation(config, self._wind, evaluated),
                lambda: TrainedAgent(model, venv, {"wind_seeds": list(self._wind.seeds or ())}),
                _curve({"curve": evaluated.get("curve", {})}, _EVALUATION_CURVE, self._first_step),
                self._save_best,
                on_evaluation,
            )

    def pretrain(self, progress: bool, stop: StopRequest | None) -> None:
        """Change the fresh model by gradient on an identified one; KeyboardInterrupt where somebody asks to stop."""
        from wt_gym.learning.pretraining import Execution, pretrain

        config = self._config
        began = time.monotonic()
        workers = min(config.n_envs, os.cpu_count() or 1)
        options = PretrainingOptions.from_dict(config.pretraining or {})

        def say(line: str) -> None:
            if progress:
                print(line, file=sys.stderr, flush=True)

        def check() -> None:
            if request.signal_number is not None:
                raise KeyboardInterrupt(
                    f"the pretraining was stopped by {request.name}; its recordings are in {self._run.recordings}, and "
                    "the same command resumes with them"
                )

        with stop_on_signals(stop) as request, executor_for("local", workers, None) as executor:
            self._pretraining = pretrain(
                self._model, config.env_id, config.env_kwargs, options,
                Execution(executor, say, check, self._run.recordings), config.seed,
                (config.budgets or {}).get(PITCH_TRAVEL),
            )  # fmt: skip
        self._pretraining["seconds"] = round(time.monotonic() - began, 1)

    def learn_on_linear_model(self, progress: bool, stop: StopRequest | None) -> None:
        """Train the fresh policy on the linear model of the environment; KeyboardInterrupt where asked to stop."""
        config, began = self._config, time.monotonic()
        before = replace(config, total_steps=config.linear_steps, linear_steps=0, max_seconds=None)
        modeled = {**config.env_kwargs, "modeled": config.env_id}
        linear = replace(before, env_id=LINEAR_ID, env_kwargs=modeled, n_envs=_MODELS)
        with stop_on_signals(stop) as request, closing(make_training_env(linear)) as venv:
            model = make_model(linear, venv)
            watch = Watch(before, self._layout.control_dt, {name: [] for name in _CURVE}, request, progress)
            model.learn(config.linear_steps, watch)
            watch.finish()
            if request.signal_number is not None:
                raise KeyboardInterrupt(
                    f"the training on the linear model was stopped by {request.name}; the same command begins it again"
                )
            self._model.policy.load_state_dict(model.policy.state_dict())
            mine = cast("VecNormalize", self._model.get_vec_normalize_env())
            mine.ret_rms = venv.ret_rms
            if mine.norm_obs:
                mine.obs_rms = venv.obs_rms
        self._linear = {
            "steps": int(model.num_timesteps), "seconds": round(time.monotonic() - began, 1),
            "wind_seeds": list(TRAINING_WIND_SEEDS),
        }  # fmt: skip

    def learn(self, progress: bool, stop: StopRequest | None) -> dict[str, Any]:
        """Train until the steps are done, time is over or somebody asks to stop; give the record."""
        config, model = self._config, self._model
        with stop_on_signals(stop) as self._stop, closing(self._logger()):
            self._watch = Watch(config, self._layout.control_dt, self._curve, self._stop, progress)
            checkpoints = Checkpoints(config.checkpoint_steps, config.checkpoint_minutes, self._checkpoint)
            every = (self._watch, EpisodeFigures(), self._budgets, self._evaluations, checkpoints)
            callbacks: list[BaseCallback] = [callback for callback in every if callback is not None]
            self._run.write_record(self._record("running"))
            # no step needs no episode, and the first one may take minutes to begin
            if config.total_steps > 0 or self._evaluations is not None:
                model.learn(config.total_steps - model.num_timesteps, callbacks, reset_num_timesteps=False)
            self._watch.finish()
            status = self._watch.ended
            if status == "finished" and model.num_timesteps < config.total_steps:
                status = "stopped"
            if self._evaluations is not None and status in ("finished", "time limit"):
                self._evaluations.finish()
                model.logger.dump(model.num_timesteps)
            record = self._record(status)
            self._save(record)
        return record

    def _logger(self) -> Logger:
        """Logger of the model, which writes to TensorBoard if that is wanted and installed."""
        silent = self._config.tensorboard is False or importlib.util.find_spec("tensorboard") is None
        logger = Logger(None, []) if silent else configure(str(self._run.tensorboard), ["tensorboard"])
        self._model.set_logger(logger)
        return logger

    def _save(self, record: dict[str, Any]) -> None:
        """Write all that resuming needs."""
        save_replay_buffer(self._model, self._run.buffer)
        save_model(self._model, self._run.model, self._run.normalization)
        self._run.write_record(record)

    def _checkpoint(self) -> None:
        """Keep the model of this step, and write all that resuming needs."""
        folder, prefix, steps = self._run.checkpoints, self._config.algorithm.lower(), self._model.num_timesteps
        folder.mkdir(exist_ok=True)
        statistics = folder / f"{prefix}_vecnormalize_{steps}_steps.pkl"
        save_model(self._model, folder / f"{prefix}_{steps}_steps.zip", statistics)
        self._save(self._record("running"))

    def _save_best(self) -> None:
        save_model(self._model, self._run.path / BEST_MODEL_FILE, self._run.path / BEST_NORMALIZATION_FILE)

    def _record(self, status: str) -> dict[str, Any]:
        """How it was trained, as JSON values."""
        config, layout, steps = self._config, self._layout, int(self._model.num_timesteps)
        seconds = self._watch.seconds
        session = {"from_step": self._first_step, "to_step": steps, "seconds": seconds, "status": status}
        return {
            "algorithm": config.algorithm,
            "status": status,
            "stopped_by": self._stop.name if status == "interrupted" else None,
            "steps": steps,
            "wall_seconds": self._seconds_before + seconds,
            "control_dt": layout.control_dt,
            "rotation": layout.turbine.rotation,
            "observation": list(layout.observation.names),
            "action": list(layout.action.names),
            "normalized": config.resolved["normalize_observations"],
            "wind_seeds": self._wind_seeds(),
            "wt_gym": wt_gym.__version__,
            "versions": {name: version(name) for name in _PACKAGES},
            "config": asdict(config),
            "environment": resolved_arguments(config.env_id, config.env_kwargs),
            "pretraining": self._pretraining,
            "linear": self._linear,
            "budgets": None if self._budgets is None else self._budgets.record(config.budgets or {}),
            "curve": self._curve,
            "evaluation": None if self._evaluations is None else self._evaluations.record(),
            "sessions": [*self._sessions, session],
        }

    def _wind_seeds(self) -> list[int] | None:
        """Seeds of all turbulence that the model may have met; None for winds of other kinds."""
        if self._wind.seeds is None:
            return None
        options = self._config.pretraining
        before = () if options is None else PretrainingOptions.from_dict(options).wind_seeds
        linear = (self._linear or {}).get("wind_seeds", ())
        return sorted({*map(int, self._wind.seeds), *before, *linear})


def _entry(record: dict[str, Any], name: str, kind: type, missing: Any) -> Any:
    """Entry of the record of an earlier session."""
    value = record.get(name)
    if value is None:
        return missing
    if not isinstance(value, kind):
        raise ValueError(f"{RECORD_FILE} is damaged: {name} is {value!r:.80}")
    return value


def _curve(record: dict[str, Any], names: tuple[str, ...], steps: int) -> dict[str, list[Any]]:
    """Curve of an earlier session up to the steps of its model, or an empty one."""
    curve: dict[str, Any] = _entry(record, "curve", dict, {}) or {name: [] for name in names}
    columns: list[Any] = [curve.get(name) for name in names]
    if not all(isinstance(column, list) and len(column) == len(columns[0]) for column in columns):
        raise ValueError(f"{RECORD_FILE} is damaged: its curve must have the columns {', '.join(names)} of one length")
    kept = sum(step <= steps for step in curve["steps"])
    return {name: column[:kept] for name, column in zip(names, columns, strict=True)}
