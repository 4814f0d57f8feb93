"""Search of hyperparameters with Optuna: trainings judged against the baseline controller in other winds.

The winds are those by which a training chooses its best model (`SELECTION_WIND_SEEDS`). The study lives in the folder
and resumes there; what it has found is a YAML file that training takes.
"""

from __future__ import annotations

import json
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import yaml

from wt_gym.base.files import json_values, write_text_whole
from wt_gym.experiment.run_folder import RunFolder
from wt_gym.experiment.tuning import SearchRange
from wt_gym.learning.callbacks import stop_on_signals
from wt_gym.learning.hyperparameters import replaced
from wt_gym.learning.train import train

if TYPE_CHECKING:
    from collections.abc import Callable

    import optuna
    from optuna.distributions import BaseDistribution
    from optuna.trial import TrialState

    from wt_gym.learning.callbacks import StopRequest
    from wt_gym.learning.options import TrainingConfig


BEST_FILE = "best.yml"
_STORAGE, _PLAN = "search.db", "search.json"
_FALLING = "lin_"  # a learning rate that falls to zero still does in a trial, from another one
_SHARED: dict[str, SearchRange | tuple[Any, ...]] = {
    "learning_rate": SearchRange(1e-5, 3e-3, log=True),
    "gamma": (0.95, 0.97, 0.98, 0.99, 0.995),
    "net_arch": ([64, 64], [128, 128], [256, 256]),
}
_OFF_POLICY: dict[str, SearchRange | tuple[Any, ...]] = _SHARED | {
    "batch_size": (128, 256, 512),
    "learning_starts": (1000, 2000, 5000, 10_000),
    "tau": SearchRange(0.001, 0.05, log=True),
    "update_every": (1, 4, 8, 16, 32),  # the updates keep pace with it: gradient_steps is -1
}
SPACES: dict[str, dict[str, SearchRange | tuple[Any, ...]]] = {
    "PPO": _SHARED
    | {
        "rollout_steps": (1024, 2048, 4096, 8192, 16384),
        "batch_size": (64, 128, 256, 512, 2048),
        "n_epochs": SearchRange(3, 15),
        "gae_lambda": SearchRange(0.85, 1.0),
        "clip_range": SearchRange(0.1, 0.4),
        "ent_coef": SearchRange(1e-7, 1e-2, log=True),
        "log_std_init": SearchRange(-2.5, 0.0),
    },
    "SAC": _OFF_POLICY,
    "TQC": _OFF_POLICY | {"top_quantiles_to_drop_per_net": SearchRange(0, 6)},
}
"""What is searched, by algorithm: intervals, or one of several values."""


def _claim(folder: Path, config: TrainingConfig) -> None:
    """Write the plan of a search into a folder; refuse another search in it."""
    file, given = folder / _PLAN, json_values(asdict(config.with_hyperparameters()))
    if file.exists():
        before = json.loads(file.read_text(encoding="utf-8"))
        if changed := [name for name in given if before.get(name) != given[name]]:
            raise ValueError(
                f"the configuration must be that of the search in this folder, got other {', '.join(changed)}"
            )
    write_text_whole(file, json.dumps(given, indent=1) + "\n")


def _present(config: TrainingConfig) -> dict[str, Any]:
    """First trial of a search: the current hyperparameters, where they lie in the search space, as Optuna has them."""
    found: dict[str, Any] = {}
    for name, part in SPACES[config.algorithm].items():
        value = config.resolved.get(name)
        value = float(value.removeprefix(_FALLING)) if isinstance(value, str) else value
        if isinstance(part, SearchRange) and isinstance(value, int | float) and part.low <= value <= part.high:
            found[name] = value
        elif isinstance(part, tuple) and value in part:
            found[name] = json.dumps(value)
    return found


def _distributions(algorithm: str) -> dict[str, BaseDistribution]:
    """Search space as Optuna has it, which keeps texts, not lists."""
    from optuna.distributions import CategoricalDistribution, FloatDistribution, IntDistribution

    found: dict[str, BaseDistribution] = {}
    for name, part in SPACES[algorithm].items():
        if isinstance(part, tuple):
            found[name] = CategoricalDistribution([json.dumps(value) for value in part])
        elif isinstance(part.low, int):
            found[name] = IntDistribution(part.low, int(part.high))
        else:
            found[name] = FloatDistribution(part.low, part.high, log=part.log)
    return found


def _replaced(config: TrainingConfig, trial: optuna.Trial | optuna.trial.FrozenTrial) -> dict[str, Any]:
    """Hyperparameters of a configuration with those of a trial."""
    found = {name: json.loads(v) if isinstance(v, str) else v for name, v in trial.params.items()}
    if isinstance(config.resolved["learning_rate"], str):
        found["learning_rate"] = f"{_FALLING}{found['learning_rate']}"
    return replaced(config.resolved, found)


def search(
    config: TrainingConfig, folder: str | Path, trials: int, progress: Callable[[str], None] | None = None
) -> dict[str, Any]:
    """Search the hyperparameters of the highest return against the baseline's at the end of a training.

    The first trial are the current hyperparameters, where they lie in the search space. Trials that lag behind the
    others are ended early.

    Parameters
    ----------
    config : TrainingConfig
        Of every trial, except for the hyperparameters that are searched.
    folder : str or path
        Gets the study ``search.db``, a folder for each trial and ``best.yml``; the study of an earlier session resumes.
    trials : int
        Altogether, with those of earlier sessions.
    progress : callable, optional
        Called with a line after every trial.

    Returns
    -------
    dict
        ``status`` ("finished" or "interrupted"), ``stopped_by``, ``best`` (hyperparameters), ``value`` and ``trials``,
        the number of those that have ended.
    """
    import optuna  # in the extra "tune"

    if not 1 <= trials <= 100_000:
        raise ValueError(f"the number of trials must be from 1 to 100000, got {trials}")
    if not config.eval_every:
        raise ValueError("eval_every of a search must be above 0, which compares evaluations; got 0")
    optuna.logging.set_verbosity(optuna.logging.WARNING)
    with RunFolder(folder) as run, stop_on_signals() as stop:
        _claim(run.path, config)
        study = optuna.create_study(
            storage=f"sqlite:///{(run.path / _STORAGE).absolute()}",
            study_name="search",
            direction="maximize",
            sampler=optuna.samplers.TPESampler(seed=config.seed),
            pruner=optuna.pruners.MedianPruner(n_startup_trials=5, n_warmup_steps=config.total_steps // 3),
            load_if_exists=True,
        )
        if not _ended(study):
            study.enqueue_trial(_present(config))
        best = _write_best(study, config, run.path)
        while _ended(study) < trials and stop.signal_number is None:
            trial = study.ask(_distributions(config.algorithm))
            state, value = _run_trial(trial, config, run.path, stop)
            done = study.tell(trial, value, state)
            if progress is not None:
                result = state.name.lower() if done.value is None else f"return {done.value:+.2f}"
                progress(f"trial {trial.number}: {result} with {trial.params}")
            best = _write_best(study, config, run.path)
        ended = _ended(study)
        return {
            "status": "finished" if ended >= trials else "interrupted",
            "stopped_by": None if ended >= trials else stop.name,
            "best": best,
            "value": study.best_value if best else None,
            "trials": ended,
        }


def _run_trial(
    trial: optuna.Trial, config: TrainingConfig, folder: Path, stop: StopRequest
) -> tuple[TrialState, float | None]:
    """Train with the hyperparameters of a trial; give the return against the baseline's of the last evaluation."""
    from optuna.trial import TrialState

    def keep(steps: int, figures: dict[str, Any]) -> bool:
        trial.report(figures["episode_return"], steps)
        return not trial.should_prune()

    record = train(
        replace(config, hyperparameters=_replaced(config, trial)), folder / f"trial-{trial.number}",
        on_evaluation=keep, overwrite=True, progress=False, stop=stop,
    )  # fmt: skip
    if record["status"] in ("interrupted", "stopped"):
        return TrialState.FAIL if record["status"] == "interrupted" else TrialState.PRUNED, None
    return TrialState.COMPLETE, float(record["evaluation"]["curve"]["episode_return"][-1])


def _ended(study: optuna.Study) -> int:
    """Number of trials with a result, those that were ended early among them."""
    return sum(trial.state.name in ("COMPLETE", "PRUNED") for trial in study.trials)


def _write_best(study: optuna.Study, config: TrainingConfig, folder: Path) -> dict[str, Any] | None:
    """Write the hyperparameters of the best trial as training takes them; None before there is one."""
    if not any(trial.state.name == "COMPLETE" for trial in study.trials):
        return None
    best: dict[str, Any] = json_values(_replaced(config, study.best_trial))
    text = (
        f"# {config.algorithm}: best of {_ended(study)} trials of {config.total_steps} steps, return against the "
        f"baseline's {study.best_value:+.2f}\n"
        + yaml.safe_dump({config.env_id: best}, sort_keys=False, default_flow_style=None)
    )
    write_text_whole(folder / BEST_FILE, text)
    return best
