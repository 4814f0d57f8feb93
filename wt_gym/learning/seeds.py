"""The same training with several seeds, and trainings that the same command begins and resumes, as on a cluster."""

import json
from collections.abc import Iterable, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np

from wt_gym.base.files import write_text_whole
from wt_gym.experiment.run_folder import SEEDS_FILE, RunFolder, read_plan, seed_folder
from wt_gym.learning.callbacks import FIGURES, StopRequest, stop_on_signals
from wt_gym.learning.options import TrainingConfig
from wt_gym.learning.train import resume, train

_RECENT = 10  # episodes


def train_seeds(
    config: TrainingConfig, folder: str | Path, seeds: Iterable[int], *, overwrite: bool = False, progress: bool = True
) -> dict[str, Any]:
    """Train with every seed instead of that of the configuration, each in a folder ``seed-<n>``.

    Parameters
    ----------
    folder : str or path
        Gets the folders and ``seeds.json``: seeds, configuration and, in the end, the summary.
    overwrite, progress
        As `wt_gym.learning.train.train`.

    Returns
    -------
    dict
        ``status`` ("finished" or "interrupted"), ``stopped_by`` and ``runs``, a row for each seed that was trained.
    """
    seeds, folder = list(seeds), Path(folder)
    if not seeds or len(set(seeds)) < len(seeds):
        raise ValueError(f"seeds must be given and differ from each other, got {seeds}")
    configs = [replace(config, seed=seed) for seed in seeds]  # refuses a bad one before the first is trained
    with RunFolder(folder) as run, stop_on_signals() as stop:
        run.refuse_used(overwrite)
        for seed in seeds:  # now, not when its turn comes
            RunFolder(seed_folder(folder, seed)).refuse_used(overwrite)
        run.clear()
        plan = {"seeds": seeds, "config": asdict(config.with_hyperparameters())}
        _write(folder, plan)
        records = (
            train(c, seed_folder(folder, c.seed), overwrite=overwrite, progress=progress, stop=stop) for c in configs
        )
        return _collect(folder, plan, seeds, records, stop)


def resume_seeds(
    folder: str | Path, *, total_steps: int | None = None, max_seconds: float | None = None, progress: bool = True
) -> dict[str, Any]:
    """Resume `train_seeds` where it was stopped: with the seed it was at, then with those that have not begun.

    Parameters are those of `wt_gym.learning.train.resume`; new limits hold for every seed, from now on. Errors: a
    `FileNotFoundError` if the folder holds no training of several seeds, a `ValueError` if a file is damaged.
    """
    folder = Path(folder)
    plan = read_plan(folder)
    seeds, config = plan["seeds"], TrainingConfig.from_dict(plan["config"]).limited(total_steps, max_seconds)
    plan["config"] = asdict(config)

    def resume_seed(seed: int, stop: StopRequest) -> dict[str, Any]:
        run = RunFolder(seed_folder(folder, seed))
        record = run.record() if run.model.exists() else {}  # none: stopped by force before anything was saved
        if config.continues(record.get("config")):
            return _continued(config, run, record, progress=progress, stop=stop)
        return train(replace(config, seed=seed), run.path, overwrite=True, progress=progress, stop=stop)

    with RunFolder(folder), stop_on_signals() as stop:
        _write(folder, plan)  # the next one to resume has these limits, however this ends
        return _collect(folder, plan, seeds, (resume_seed(seed, stop) for seed in seeds), stop)


def seeds_table(runs: list[dict[str, Any]]) -> list[str]:
    """Lines of a table: each seed's best model, and mean and standard deviation over the seeds."""
    columns = {
        "steps": (12, "d"),
        "episode_return": (7, "+.2f"),
        "mean_power": (7, "+.2%"),
        "blade_flap_del": (9, "+.1%"),
    }
    lines = ["seed   steps  return  best: steps  return   power  flap DEL   (against the baseline, other winds)"]
    for run in runs:
        best, recent = run["best"] or {}, run["recent_return"]
        cells = [(recent, 7, ".1f"), *((best.get(name), *form) for name, form in columns.items())]
        texts = [("-" if value is None else f"{value:{form}}").rjust(width) for value, width, form in cells]
        lines.append(" ".join([f"{run['seed']:4d} {run['steps']:7d}", *texts]))
    for name, (_, pattern) in list(columns.items())[1:]:
        values = [run["best"][name] for run in runs if run["best"] and run["best"][name] is not None]
        if len(values) > 1:
            mean, deviation = np.mean(values), np.std(values, ddof=1)
            lines.append(f"{FIGURES[name]}: {mean:{pattern}}, standard deviation {deviation:{pattern[1:]}}")
    return lines


def _write(folder: Path, plan: dict[str, Any]) -> None:
    write_text_whole(folder / SEEDS_FILE, json.dumps(plan, indent=1, default=str) + "\n")


def _collect(
    folder: Path, plan: dict[str, Any], seeds: list[int], records: Iterable[dict[str, Any]], stop: StopRequest
) -> dict[str, Any]:
    """Run the trainings until somebody asks to stop; write and return the summary."""
    runs = []
    for seed, record in zip(seeds, records, strict=True):
        recent = record["curve"]["episode_return"][-_RECENT:]
        row = {"seed": seed, "status": record["status"], "steps": record["steps"]}
        row["recent_return"] = float(np.mean(recent)) if recent else None
        runs.append(row | {"best": (record["evaluation"] or {}).get("best")})
        if stop.signal_number is not None:
            break
    interrupted = len(runs) < len(seeds) or runs[-1]["status"] == "interrupted"
    if not interrupted:
        RunFolder(folder).remove_recordings()
    summary = {
        "status": "interrupted" if interrupted else "finished",
        "stopped_by": stop.name if interrupted else None,
        "runs": runs,
    }
    _write(folder, {**plan, "summary": summary})
    return summary


def resume_or_train(config: TrainingConfig, folder: str | Path, seeds: Sequence[int] | None = None) -> dict[str, Any]:
    """Train, or resume where the folder holds this training already; a ValueError where it holds another one.

    Parameters
    ----------
    seeds : sequence of int, optional
        Train with each of them; by default with that of the configuration.

    Returns
    -------
    dict
        The record, as it is of a training that has done its steps; of several seeds the summary.
    """
    folder = Path(folder)
    if seeds is not None:
        if not (folder / SEEDS_FILE).is_file():
            return train_seeds(config, folder, seeds)
        plan = read_plan(folder)
        _refuse_other(config, plan["config"], folder)
        if plan["seeds"] != list(seeds):
            raise ValueError(f"the seeds must be {plan['seeds']}, those of the training in {folder}; got {list(seeds)}")
        return resume_seeds(folder, total_steps=config.total_steps, max_seconds=config.max_seconds)
    if (folder / SEEDS_FILE).is_file():
        raise ValueError(f"{folder} holds a training with the seeds {read_plan(folder)['seeds']}: give --seeds")
    run = RunFolder(folder)
    if not run.model.is_file():  # nothing, or stopped by force before anything was saved
        return train(config, folder, overwrite=run.used)
    record = run.record()
    _refuse_other(config, record.get("config"), folder)
    if record["config"]["seed"] != config.seed:
        raise ValueError(
            f"the seed must be {record['config']['seed']}, that of the training in {folder}; got {config.seed}"
        )
    return _continued(config, run, record)


def _continued(config: TrainingConfig, run: RunFolder, record: dict[str, Any], **more: Any) -> dict[str, Any]:
    """Resume a training with the limits of a configuration, unless its steps are done."""
    if record.get("status") == "finished" and record.get("steps", 0) >= config.total_steps:
        return record
    return resume(run.path, total_steps=config.total_steps, max_seconds=config.max_seconds, **more)


def _refuse_other(config: TrainingConfig, record: Any, folder: Path) -> None:
    if not config.continues(record):
        raise ValueError(f"{folder} holds a training with another configuration: take another folder, or --overwrite")
