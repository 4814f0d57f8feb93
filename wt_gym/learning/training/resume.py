"""A training that the same command begins and resumes, as the jobs of a cluster are begun again."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from wt_gym.experiment.run_folder import SEEDS_FILE, RunFolder, read_plan
from wt_gym.learning.train import resume, train
from wt_gym.learning.training.seeds import resume_seeds, train_seeds

if TYPE_CHECKING:
    from collections.abc import Sequence

    from wt_gym.learning.training.config import TrainingConfig
    from wt_gym.learning.training.learners import Learner

__all__ = ["resume_or_train"]


def resume_or_train(
    config: TrainingConfig, folder: str | Path, seeds: Sequence[int] | None = None, *, learner: Learner | None = None
) -> dict[str, Any]:
    """Train, or resume where the folder holds this training already.

    Parameters
    ----------
    config : TrainingConfig
    folder : str or path
    seeds : sequence of int, optional
        Train with each of them; by default with that of the configuration.
    learner : Learner, optional
        As of `wt_gym.learning.train.train`.

    Returns
    -------
    dict
        The record; of several seeds the summary. A training that has done its steps gives what is there.

    Raises
    ------
    ValueError
        If the folder holds another training, or a damaged one.
    """
    folder = Path(folder)
    limits: dict[str, Any] = {"total_steps": config.total_steps, "max_seconds": config.max_seconds}
    if seeds is not None:
        if not (folder / SEEDS_FILE).is_file():
            return train_seeds(config, folder, seeds, learner=learner)
        plan = read_plan(folder)
        _refuse_other(config, plan["config"], folder)
        if plan["seeds"] != list(seeds):
            raise ValueError(f"the seeds must be {plan['seeds']}, those of the training in {folder}; got {list(seeds)}")
        return resume_seeds(folder, **limits, learner=learner)
    if (folder / SEEDS_FILE).is_file():
        raise ValueError(f"{folder} holds a training with the seeds {read_plan(folder)['seeds']}: give --seeds")
    run = RunFolder(folder)
    if not run.model.is_file():  # nothing, or stopped by force before anything was saved
        return train(config, folder, overwrite=run.used, learner=learner)
    record = run.record()
    _refuse_other(config, record.get("config"), folder)
    if record["config"]["seed"] != config.seed:
        raise ValueError(
            f"the seed must be {record['config']['seed']}, that of the training in {folder}; got {config.seed}"
        )
    if record["status"] == "finished" and record["steps"] >= config.total_steps:
        return record
    return resume(folder, **limits, learner=learner)


def _refuse_other(config: TrainingConfig, record: Any, folder: Path) -> None:
    if not config.continues(record):
        raise ValueError(f"{folder} holds a training with another configuration: take another folder, or --overwrite")
