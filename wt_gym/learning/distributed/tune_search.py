"""Search of hyperparameters with Ray Tune: many trainings beside each other on a cluster.

As `wt_gym.learning.training.search`, with trials that do not wait for each other: hyperparameters are drawn at random
from the same spaces, and trials that lag behind are ended early by asynchronous successive halving (Li et al., "A
System for Massively Parallel Hyperparameter Tuning", MLSys 2020).
"""

from __future__ import annotations

import json
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from ray import tune
from ray.tune.schedulers import ASHAScheduler
from ray.tune.search import BasicVariantGenerator

from wt_gym.base.files import json_values, write_text_whole
from wt_gym.experiment.environments import compile_kernels_of
from wt_gym.experiment.execute import connected, warm_nodes
from wt_gym.experiment.run_folder import RunFolder
from wt_gym.learning.training.search import SPACES, Choice, Range, check_search, tried, write_best

if TYPE_CHECKING:
    from collections.abc import Callable

    from wt_gym.learning.training.config import TrainingConfig

__all__ = ["tune_search"]

_PLAN, _TRIALS = "search.json", "tune"
_FAILURES = 2  # of processes and machines; each begins the trial again


def tune_search(
    config: TrainingConfig,
    folder: str | Path,
    trials: int,
    progress: Callable[[str], None] | None = None,
    address: str | None = None,
) -> dict[str, Any]:
    """Search the hyperparameters of the highest return against the baseline's at the end of a training.

    Parameters
    ----------
    config, folder, trials, progress
        As of `wt_gym.learning.training.search.search`. The number of trials is fixed when the search begins.
    address : str, optional
        As of `wt_gym.experiment.execute.executor_for`.

    Returns
    -------
    dict
        As of `wt_gym.learning.training.search.search`.

    Raises
    ------
    ValueError
        As there.
    """
    check_search(config, trials)
    with RunFolder(folder) as run, connected(address):
        _claim(run.path / _PLAN, config, trials)
        warm_nodes(partial(compile_kernels_of, config.env_id, config.env_kwargs))
        results = _tuner(config, run.path, trials).fit()
        ended = [result for result in results if result.error is None and result.metrics and result.metrics.get("done")]
        rows = [(_hyperparameters(config, result.config), result.metrics["episode_return"]) for result in ended]
        if progress is not None:
            for found, value in rows:
                progress(f"return {value:+.2f} with {found}")
        best = max(rows, key=lambda row: row[1], default=None)
        status = "finished" if len(ended) >= trials else "interrupted"
        return {
            "status": status,
            "stopped_by": "SIGINT" if status == "interrupted" else None,
            "best": None if best is None else write_best(config, run.path, best[0], best[1], len(ended)),
            "value": None if best is None else best[1],
            "trials": len(ended),
        }


def _claim(file: Path, config: TrainingConfig, trials: int) -> None:
    """Keep what is searched, or refuse another search in the folder."""
    given = json_values({"trials": trials, **config.with_hyperparameters().to_json()})
    if file.exists():
        kept = json.loads(file.read_text(encoding="utf-8"))
        if changed := [name for name in given if kept.get(name) != given[name]]:
            raise ValueError(
                f"the configuration must be that of the search in this folder, got other {', '.join(changed)}"
            )
    write_text_whole(file, json.dumps(given, indent=1) + "\n")


def _tuner(config: TrainingConfig, folder: Path, trials: int) -> tune.Tuner:
    """Tuner of a new search, or of one to resume."""

    def trial(found: dict[str, Any]) -> None:
        _trial(config, _hyperparameters(config, found))

    trainable = tune.with_resources(trial, {"cpu": 1})
    path = folder.absolute() / _TRIALS
    if tune.Tuner.can_restore(str(path)):
        return tune.Tuner.restore(str(path), trainable, resume_unfinished=True, resume_errored=True)
    space = SPACES[config.algorithm]
    keys = {name: part.key(config.resolved.get(name)) for name, part in space.items()}
    present = {name: key for name, key in keys.items() if key is not None}
    generator = BasicVariantGenerator(points_to_evaluate=[present], random_state=np.random.RandomState(config.seed))
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
    from wt_gym.learning.train import train

    def report(steps: int, figures: dict[str, Any]) -> bool:
        tune.report({"episode_return": figures["episode_return"], "steps": steps})
        return True

    train(tried(config, hyperparameters), "training", on_evaluation=report, overwrite=True, progress=False)
