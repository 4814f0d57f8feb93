"""Reference numbers of a task: the baseline's metrics in every wind, and how much the best known agent improves."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from wt_gym.base.canary import differing
from wt_gym.base.errors import BenchmarkError
from wt_gym.base.files import write_text_whole
from wt_gym.benchmark.tasks import task_file

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from wt_gym.benchmark.tasks import BenchmarkTask

__all__ = ["Reference", "make_reference", "reference_of", "write_reference"]


@dataclass(frozen=True)
class Reference:
    """Numbers that scores of a task are made with.

    Attributes
    ----------
    definition : str
        Digest of the task for which they were made.
    fingerprint : dict
        See `wt_gym.benchmark.benchmark_fingerprint`.
    baseline : dict
        From the label of a wind to the metrics of the baseline controller.
    best_agent : str
    best_improvement : float
        Weighted mean over the winds of what scores 100.
    improvements : dict
        Mean improvement of every candidate; None for one that broke a limit.
    """

    definition: str
    fingerprint: dict[str, Any]
    baseline: dict[str, dict[str, float]]
    best_agent: str
    best_improvement: float
    improvements: dict[str, float | None]

    def check(self, task: BenchmarkTask, definition: Mapping[str, Any]) -> None:
        """Refuse a result that cannot be compared with these numbers.

        Raises
        ------
        wt_gym.base.errors.BenchmarkError
            If it belongs to another task or version, or was made with another turbine, fidelity or physics.
        """
        if (definition["task"], definition["version"]) != (task.name, task.version):
            raise BenchmarkError(f"a result of {definition['task']}-v{definition['version']} has no score in {task.id}")
        parts = differing(definition["fingerprint"], self.fingerprint)
        if parts:
            raise BenchmarkError(
                f"a result of {task.id} was made with another {' and '.join(parts)} than the reference numbers: run "
                f"the agent again, or, if the reference is the older one, wt-gym benchmark reference --task "
                f"{task.name}"
            )


def reference_of(task: BenchmarkTask) -> Reference:
    """Reference numbers in the file of a task.

    Raises
    ------
    wt_gym.base.errors.BenchmarkError
        If there are none, or the task has been changed since.
    """
    renew = f"wt-gym benchmark reference --task {task.name} makes them"
    if task.reference is None:
        raise BenchmarkError(f"the task {task.id} has no reference numbers yet: {renew}")
    reference = Reference(**task.reference)
    if reference.definition != task.digest:
        raise BenchmarkError(f"the reference numbers of {task.id} belong to another definition of the task: {renew}")
    return reference


def make_reference(
    task: BenchmarkTask,
    baseline: Mapping[str, Mapping[str, Any]],
    candidates: Mapping[str, Mapping[str, Mapping[str, Any]]],
) -> Reference:
    """Make reference numbers from runs.

    Parameters
    ----------
    task : BenchmarkTask
    baseline : mapping
        Results of the baseline controller by the label of the wind.
    candidates : mapping
        Name of an agent to its results. The best is the one with the largest mean improvement among those that keep
        every limit in every wind.

    Raises
    ------
    wt_gym.base.errors.BenchmarkError
        If the baseline did not run to the end in every wind, or no candidate is better than it.
    """
    ended = [f"{wind.label} ({baseline[wind.label]['ending']})" for wind in task.winds
             if baseline[wind.label]["ending"] != "time"]  # fmt: skip
    if ended:
        raise BenchmarkError(
            f"task {task.name}: the baseline controller must complete every wind, it ended in {', '.join(ended)}"
        )
    weights = [wind.weight for wind in task.winds]
    metrics = {wind.label: dict(baseline[wind.label]["metrics"]) for wind in task.winds}
    found: dict[str, float | None] = {}
    for name, results in candidates.items():
        keeps = all(_keeps(task, results[label], metrics[label]) for label in metrics)
        gains = [task.improvement(results[label]["metrics"], metrics[label]) for label in metrics] if keeps else None
        found[name] = None if gains is None else float(np.average(gains, weights=weights))
    allowed = {name: value for name, value in found.items() if value is not None}
    best = max(allowed, key=allowed.__getitem__, default=None)
    if best is None or allowed[best] <= 0.0:
        raise BenchmarkError(f"task {task.name}: no candidate is better than the baseline within the limits: {found}")
    fingerprint = dict(baseline[task.winds[0].label]["definition"]["fingerprint"])
    return Reference(task.digest, fingerprint, metrics, best, allowed[best], found)


def _keeps(task: BenchmarkTask, result: Mapping[str, Any], baseline: Mapping[str, float]) -> bool:
    """Whether a run lasted and kept every limit."""
    return result["ending"] == "time" and not task.broken_limits(result["metrics"], baseline)


def write_reference(task: BenchmarkTask, reference: Reference, path: Path | None = None) -> Path:
    """Write reference numbers into the file of a task; nothing else in it changes.

    Parameters
    ----------
    task : BenchmarkTask
    reference : Reference
    path : path, optional
        Of the file, by default that in the package.
    """
    path = path or task_file(task.name)
    values = json.loads(path.read_text(encoding="utf-8"))
    values["reference"] = asdict(reference)
    write_text_whole(path, json.dumps(values, indent=1) + "\n")
    return path
