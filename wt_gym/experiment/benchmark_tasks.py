"""Tasks of the benchmark: a data file each, with its reference numbers; and the ceilings of their scores."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from wt_gym.base.canary import differing
from wt_gym.base.errors import BenchmarkError, did_you_mean
from wt_gym.base.files import write_text_whole
from wt_gym.experiment.store import digest
from wt_gym.wind import TransientInflow

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    from wt_gym.turbines import Turbine

__all__ = [
    "BenchmarkTask", "BenchmarkWind", "Ceiling", "Limit", "Reference", "ScoreTerm", "ceiling_file", "ceiling_line",
    "ceiling_of", "improvement", "load_task", "make_reference", "reference_of", "task_file", "task_names",
    "transient_inflow", "write_reference",
]  # fmt: skip

_FOLDER = Path(__file__).parent / "benchmark_data"
_TRANSIENTS = ("EOG", "EDC", "ECD", "EWS-vertical", "EWS-horizontal")
_KEYS = {
    "name", "version", "goal", "env_id", "env_kwargs", "duration", "skip", "winds", "terms", "limits", "clip",
    "candidates",
}  # fmt: skip
_OPTIONAL = {"reference", "yardstick", "baseline"}
_LIMITS = {"least": (True, False), "most": (False, False), "least_ratio": (True, True), "most_ratio": (False, True)}
"""Kinds of limits: whether the bound is the least allowed, and whether it is relative to the baseline."""
# What may change without making other runs or another score of it.
_NOT_FROZEN = ("goal", "candidates", "reference")


@dataclass(frozen=True)
class BenchmarkWind:
    """One wind of a task."""

    speed: float  #: mean at hub height, of a transient before it [m/s]
    seed: int | None = None  #: of the turbulence
    transient: str | None = None
    """``"EOG"``, ``"EDC"``, ``"ECD"``, ``"EWS-vertical"`` or ``"EWS-horizontal"`` of IEC 61400-1."""
    sign: int = 1  #: of its direction or shear, see `wt_gym.wind.TransientInflow`
    start: float = 0.0  #: time at which the transient begins [s]
    weight: float = 1.0  #: in means over the winds
    stratum: int = 0  #: winds with the same number are drawn among each other when the interval of a score is made

    @property
    def label(self) -> str:
        """Short name, one a wind of a task."""
        if self.transient is None:
            return f"{self.speed:g} m/s, seed {self.seed}"
        sign = "" if self.transient == "EOG" else "+" if self.sign > 0 else "-"
        return f"{self.transient}{sign} at {self.speed:g} m/s"

    @property
    def definition(self) -> dict[str, Any]:
        """What a run in this wind depends on, as JSON values."""
        if self.transient is None:
            return {"speed": self.speed, "seed": self.seed}
        return {"speed": self.speed, "transient": self.transient, "sign": self.sign, "start": self.start}

    def inflow(self, turbine: Turbine) -> TransientInflow:
        """Give the transient for a turbine."""
        return transient_inflow(turbine, cast(str, self.transient), self.speed, self.sign, self.start)


def transient_inflow(turbine: Turbine, kind: str, speed: float, sign: int, start: float) -> TransientInflow:
    """Transient of IEC 61400-1 for the class of a turbine; kind, speed, sign and start as of `BenchmarkWind`."""
    where, turbulence = (speed, turbine.hub_height, turbine.rotor_diameter), turbine.turbulence_class
    kind, _, axis = kind.partition("-")
    if kind == "EOG":
        return TransientInflow.eog(*where, turbulence, turbine.iec_class, start_time=start)
    if kind == "EDC":
        return TransientInflow.edc(*where, turbulence, sign=sign, start_time=start)
    if kind == "ECD":
        return TransientInflow.ecd(*where, sign=sign, start_time=start)
    return TransientInflow.ews(*where, turbulence, axis=axis, sign=sign, start_time=start)


@dataclass(frozen=True)
class ScoreTerm:
    """Part of what a task improves: ``-weight (value - baseline) / scale``."""

    metric: str
    weight: float  #: positive where less is better
    scale: float | None = None  #: in the unit of the metric; None: the baseline's value in the same wind


def improvement(terms: Iterable[ScoreTerm], metrics: Mapping[str, float], baseline: Mapping[str, float]) -> float:
    """Sum of terms over the baseline in the same wind; a `BenchmarkError` if its metric without a scale is 0."""
    total = 0.0
    for term in terms:
        before = baseline[term.metric]
        if term.scale is None and before == 0.0:
            raise BenchmarkError(f"{term.metric} of the baseline must not be 0, or needs a scale")
        total -= term.weight * (metrics[term.metric] - before) / (before if term.scale is None else term.scale)
    return total


@dataclass(frozen=True)
class Limit:
    """What a run must keep, unless the baseline does not in the same wind."""

    metric: str
    bound: float  #: of the value, or of its ratio to the baseline's
    least: bool  #: whether the bound is the least or the most allowed
    relative: bool  #: to the baseline

    def broken(self, value: float, baseline: float) -> bool:
        """Whether a value is beyond the bound, and worse than the baseline's."""
        bound = self.bound * baseline if self.relative else self.bound
        return value < min(bound, baseline) if self.least else value > max(bound, baseline)


@dataclass(frozen=True)
class BenchmarkTask:
    """A frozen task."""

    name: str
    version: int  #: results of different versions have nothing to do with each other
    goal: str
    env_id: str
    env_kwargs: dict[str, Any]
    """Arguments of the environment; agents can replace those of `wt_gym.experiment.names.INTERFACE` alone."""
    duration: float  #: length of a run [s]
    skip: float  #: start left out of the metrics [s]
    winds: tuple[BenchmarkWind, ...]  #: default trainings use none of them
    terms: tuple[ScoreTerm, ...]
    limits: tuple[Limit, ...]
    clip: tuple[float, float]  #: least and greatest score of a wind
    candidates: tuple[str, ...]  #: agents among which the best known is looked for when the reference is renewed
    digest: str  #: of everything on which scores depend
    reference: dict[str, Any] | None = None  #: fields of `Reference`
    yardstick: str | None = None  #: controller that scores 100; None: the best of the candidates
    baseline: str = "discon"  #: controller that scores 0

    @classmethod
    def from_json(cls, values: dict[str, Any]) -> BenchmarkTask:
        """Read the content of a task's file; a `BenchmarkError` if something is missing, unknown or without meaning."""
        name = values.get("name", "?")
        missing, unknown = sorted(_KEYS - set(values)), sorted(set(values) - _KEYS - _OPTIONAL)
        if missing or unknown:
            raise BenchmarkError(
                f"task {name}: fields must be {', '.join(sorted(_KEYS))}; got none of {missing}, and unknown {unknown}"
            )
        if not 0.0 <= values["skip"] < values["duration"]:
            raise BenchmarkError(f"task {name}: skip must be at least 0 and less than the duration")
        low, high = values["clip"]
        if not low < 0.0 < 100.0 <= high:
            raise BenchmarkError(f"task {name}: clip must be a range around 0 and 100, got {values['clip']}")
        if bool(values["candidates"]) == bool(values.get("yardstick")):
            raise BenchmarkError(
                f"task {name}: there must be either a yardstick or candidates, got {values.get('yardstick')!r} and "
                f"{values['candidates']}"
            )
        winds = _winds(name, values["winds"])
        if len(winds) < 6 or len({wind.label for wind in winds}) < len(winds):
            raise BenchmarkError(
                f"task {name}: winds must be at least 6 different ones, got {[w.label for w in winds]}"
            )
        terms, limits = [], []
        for metric, given in values["terms"].items():
            if not {"weight"} <= set(given) <= {"weight", "scale"} or given.get("scale", 1.0) <= 0.0:
                raise BenchmarkError(
                    f"task {name}: the term {metric} must have a weight and may have a positive scale, got {given}"
                )
            terms.append(ScoreTerm(metric, **given))
        for metric, given in values["limits"].items():
            if len(given) != 1 or not set(given) <= set(_LIMITS):
                raise BenchmarkError(
                    f"task {name}: the limit of {metric} must be one of {', '.join(_LIMITS)}, got {given}"
                )
            ((kind, bound),) = given.items()
            limits.append(Limit(metric, float(bound), *_LIMITS[kind]))
        return cls(**values | {
            "winds": winds, "terms": tuple(terms), "limits": tuple(limits), "clip": (float(low), float(high)),
            "duration": float(values["duration"]), "skip": float(values["skip"]),
            "candidates": tuple(values["candidates"]),
            "digest": digest({key: value for key, value in values.items() if key not in _NOT_FROZEN}),
        })  # fmt: skip

    @property
    def measures(self) -> tuple[str, ...]:
        """Agents with which the reference numbers are made: the yardstick, or all candidates for what scores 100."""
        return self.candidates if self.yardstick is None else (self.yardstick,)

    @property
    def id(self) -> str:
        """Name and version."""
        return f"{self.name}-v{self.version}"

    def improvement(self, metrics: Mapping[str, float], baseline: Mapping[str, float]) -> float:
        """Sum of the terms over the baseline in the same wind; zero for the baseline itself."""
        return improvement(self.terms, metrics, baseline)

    def broken_limits(self, metrics: Mapping[str, float], baseline: Mapping[str, float]) -> tuple[str, ...]:
        """Metrics whose limit is not kept."""
        return tuple(x.metric for x in self.limits if x.broken(metrics[x.metric], baseline[x.metric]))


def _winds(name: str, groups: list[dict[str, Any]]) -> tuple[BenchmarkWind, ...]:
    """Winds of the groups of a file; the seeds of a group are a stratum, all transients are one."""
    winds = []
    for stratum, group in enumerate(groups, start=1):
        given = dict(group)
        seeds = given.pop("seeds", None)
        if set(given) - {"speed", "transient", "sign", "start", "weight"} or (seeds is None) == (
            given.get("transient") not in _TRANSIENTS
        ):
            raise BenchmarkError(f"task {name}: a group of winds must have seeds or one of {_TRANSIENTS}, got {group}")
        if seeds is None:
            winds.append(BenchmarkWind(**given))
        else:
            winds += [BenchmarkWind(**given, seed=seed, stratum=stratum) for seed in seeds]
    return tuple(winds)


def task_names() -> tuple[str, ...]:
    """Names of all tasks."""
    return tuple(sorted(path.stem for path in _FOLDER.glob("*.json")))


def task_file(name: str) -> Path:
    """Path of a task's file; a `wt_gym.base.errors.BenchmarkError` if there is no such task."""
    if name not in task_names():
        raise BenchmarkError(
            f"task must be one of {', '.join(task_names())}; got {name!r}{did_you_mean(name, task_names())}"
        )
    return _FOLDER / f"{name}.json"


def load_task(name: str) -> BenchmarkTask:
    """Read a task; a `wt_gym.base.errors.BenchmarkError` if there is no such task, or its file is damaged."""
    return BenchmarkTask.from_json(json.loads(task_file(name).read_text(encoding="utf-8")))


# ---- reference numbers ----


@dataclass(frozen=True)
class Reference:
    """Numbers that scores of a task are made with."""

    definition: str  #: digest of the task for which they were made
    fingerprint: dict[str, Any]  #: see `wt_gym.experiment.run.benchmark_fingerprint`
    baseline: dict[str, dict[str, float]]  #: from the label of a wind to the metrics of the baseline controller
    best_agent: str
    best_improvement: float  #: weighted mean over the winds of what scores 100
    improvements: dict[str, float | None]  #: mean improvement of every candidate; None for one that broke a limit

    def check(self, task: BenchmarkTask, definition: Mapping[str, Any]) -> None:
        """Refuse a result of another task or version, turbine, fidelity or physics by a `BenchmarkError`."""
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
    """Reference numbers in the file of a task; a `BenchmarkError` if there are none, or the task has changed since."""
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
        keeps = all(
            results[label]["ending"] == "time" and not task.broken_limits(results[label]["metrics"], metrics[label])
            for label in metrics
        )
        gains = [task.improvement(results[label]["metrics"], metrics[label]) for label in metrics] if keeps else None
        found[name] = None if gains is None else float(np.average(gains, weights=weights))
    allowed = {name: value for name, value in found.items() if value is not None}
    best = max(allowed, key=allowed.__getitem__, default=None)
    if best is None or allowed[best] <= 0.0:
        raise BenchmarkError(f"task {task.name}: no candidate is better than the baseline within the limits: {found}")
    fingerprint = dict(baseline[task.winds[0].label]["definition"]["fingerprint"])
    return Reference(task.digest, fingerprint, metrics, best, allowed[best], found)


def write_reference(task: BenchmarkTask, reference: Reference, path: Path | None = None) -> Path:
    """Write reference numbers into a file of a task, by default that in the package; nothing else in it changes."""
    path = path or task_file(task.name)
    values = json.loads(path.read_text(encoding="utf-8"))
    values["reference"] = asdict(reference)
    write_text_whole(path, json.dumps(values, indent=1) + "\n")
    return path


# ---- ceilings ----


@dataclass(frozen=True)
class Ceiling:
    """What a task holds for who knows the wind."""

    task: str
    version: int
    definition: str  #: digest of the task
    fingerprint: dict[str, Any]  #: see `wt_gym.experiment.run.benchmark_fingerprint`
    made: dict[str, str]  #: date, and versions of the software
    how: dict[str, Any]  #: length of the runs, base controller, winds of the identification, limits, weights
    explained: dict[str, dict[str, float]]  #: from the wind speed to the share of each output that the model explains
    improvement: float  #: weighted mean over the winds
    yardstick: str | None  #: agent that scores 100
    yardstick_improvement: float | None  #: of the same winds for the same time; None where it ended early in one
    winds: dict[str, dict[str, Any]]
    """From the label of a wind to ``improvement``, ``passes`` (improvement of each run, the one without offsets
    first; None where a limit was broken), ``broken``, ``yardstick``, ``changes`` against the baseline and
    ``offsets_rms_deg``."""

    @property
    def score(self) -> float | None:
        """What is reached where the yardstick has 100 in the same winds; None where that gains nothing."""
        if self.yardstick_improvement is None or self.yardstick_improvement <= 0.0:
            return None
        return 100.0 * self.improvement / self.yardstick_improvement


def ceiling_file(task: BenchmarkTask) -> Path:
    """Where the ceiling of a task stands, or would."""
    return task_file(task.name).parent / "ceilings" / f"{task.name}.json"


def ceiling_of(task: BenchmarkTask, path: Path | None = None) -> Ceiling | None:
    """Ceiling of a task, None if it has not been made, or belongs to another definition of the task.

    Its file is by default that in the package; a `wt_gym.base.errors.BenchmarkError` if that is damaged.
    """
    path = path or ceiling_file(task)
    if not path.is_file():
        return None
    try:
        values: Mapping[str, Any] = json.loads(path.read_text(encoding="utf-8"))
        found = Ceiling(**{part.name: values[part.name] for part in fields(Ceiling)})
    except (ValueError, KeyError, TypeError) as error:
        raise BenchmarkError(
            f"{path} must be a ceiling of scripts/studies/ceiling.py, it is damaged: {error!r}"
        ) from error
    return found if (found.task, found.definition) == (task.name, task.digest) else None


def ceiling_line(task: BenchmarkTask, ceiling: Ceiling) -> str:
    """What a table says of a ceiling: its height, where it was measured, and with what code."""
    winds = len(ceiling.winds)
    beside = ""
    if ceiling.score is not None:
        beside = (
            f": {ceiling.score:.0f} where `{ceiling.yardstick}` has 100 "
            f"({100 * (ceiling.yardstick_improvement or 0.0):.2f} %)"
        )
    line = (
        f"Ceiling with the wind known: an improvement of {100 * ceiling.improvement:.2f} %{beside}, measured in "
        f"{winds} {'winds' if winds != 1 else 'wind'} of {ceiling.how['duration']:g} s, {ceiling.made['date']}."
    )
    known = (task.reference or {}).get("fingerprint")
    if known and (parts := differing(known, ceiling.fingerprint)):
        line += f" It was made with another {' and '.join(parts)} than the reference numbers."
    return line
