"""Tasks of the benchmark: each one data file, which also holds its reference numbers."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

from wt_gym.base.errors import BenchmarkError, did_you_mean
from wt_gym.runs.definition import digest
from wt_gym.wind import TransientInflow

if TYPE_CHECKING:
    from collections.abc import Mapping

    from wt_gym.turbines import Turbine

__all__ = [
    "BenchmarkTask", "BenchmarkWind", "Limit", "Term", "load_task", "task_file", "task_names",
]  # fmt: skip

_FOLDER = Path(__file__).parent / "data"
_TRANSIENTS = ("EOG", "EDC", "ECD", "EWS-vertical", "EWS-horizontal")
_KEYS = {
    "name", "version", "goal", "env_id", "env_kwargs", "duration", "skip", "winds", "terms", "limits", "clip",
    "candidates",
}  # fmt: skip
_OPTIONAL = {"reference", "yardstick", "baseline"}
# What may change without making other runs or another score of it.
_NOT_FROZEN = ("goal", "candidates", "reference")


@dataclass(frozen=True)
class BenchmarkWind:
    """One wind of a task.

    Attributes
    ----------
    speed : float
        Mean at hub height, of a transient before it [m/s].
    seed : int or None
        Of the turbulence.
    transient : str or None
        ``"EOG"``, ``"EDC"``, ``"ECD"``, ``"EWS-vertical"`` or ``"EWS-horizontal"`` of IEC 61400-1.
    sign : int
        Of its direction or shear, see `wt_gym.wind.TransientInflow`.
    start : float
        Time at which the transient begins [s].
    weight : float
        In means over the winds.
    stratum : int
        Winds with the same number are drawn among each other when the interval of a score is made.
    """

    speed: float
    seed: int | None = None
    transient: str | None = None
    sign: int = 1
    start: float = 0.0
    weight: float = 1.0
    stratum: int = 0

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
        where = self.speed, turbine.hub_height, turbine.rotor_diameter
        kind, _, axis = cast(str, self.transient).partition("-")
        if kind == "EOG":
            return TransientInflow.eog(*where, turbine.turbulence_class, turbine.iec_class, start_time=self.start)
        if kind == "EDC":
            return TransientInflow.edc(*where, turbine.turbulence_class, sign=self.sign, start_time=self.start)
        if kind == "ECD":
            return TransientInflow.ecd(*where, sign=self.sign, start_time=self.start)
        return TransientInflow.ews(*where, turbine.turbulence_class, axis=axis, sign=self.sign, start_time=self.start)


@dataclass(frozen=True)
class Term:
    """Part of what a task improves: ``-weight (value - baseline) / scale``.

    Attributes
    ----------
    metric : str
    weight : float
        Positive where less is better.
    scale : float or None
        In the unit of the metric; None: the baseline's value in the same wind.
    """

    metric: str
    weight: float
    scale: float | None = None


@dataclass(frozen=True)
class Limit:
    """What a run must keep, unless the baseline does not in the same wind.

    Attributes
    ----------
    metric : str
    bound : float
        Of the value, or of its ratio to the baseline's.
    least : bool
        Whether the bound is the least or the most allowed.
    relative : bool
        To the baseline.
    """

    metric: str
    bound: float
    least: bool
    relative: bool

    def broken(self, value: float, baseline: float) -> bool:
        """Whether a value is beyond the bound, and worse than the baseline's."""
        bound = self.bound * baseline if self.relative else self.bound
        return value < min(bound, baseline) if self.least else value > max(bound, baseline)


@dataclass(frozen=True)
class BenchmarkTask:
    """A frozen task.

    Attributes
    ----------
    name : str
    version : int
        Results of different versions have nothing to do with each other.
    goal : str
    env_id : str
    env_kwargs : dict
        Arguments of the environment; agents can replace those of `wt_gym.benchmark.INTERFACE` alone.
    duration, skip : float
        Length of a run, and the start left out of the metrics [s].
    winds : tuple of BenchmarkWind
        Default trainings use none of them.
    terms : tuple of Term
    limits : tuple of Limit
    clip : (float, float)
        Least and greatest score of a wind.
    candidates : tuple of str
        Agents among which the best known is looked for when the reference is renewed.
    digest : str
        Of everything on which scores depend.
    reference : dict or None
        See `wt_gym.benchmark.reference`.
    yardstick : str or None
        Controller that scores 100; None: the best of the candidates.
    baseline : str
        Controller that scores 0.
    """

    name: str
    version: int
    goal: str
    env_id: str
    env_kwargs: dict[str, Any]
    duration: float
    skip: float
    winds: tuple[BenchmarkWind, ...]
    terms: tuple[Term, ...]
    limits: tuple[Limit, ...]
    clip: tuple[float, float]
    candidates: tuple[str, ...]
    digest: str
    reference: dict[str, Any] | None = None
    yardstick: str | None = None
    baseline: str = "discon"

    @classmethod
    def from_json(cls, values: dict[str, Any]) -> BenchmarkTask:
        """Read the content of a task's file.

        Raises
        ------
        wt_gym.base.errors.BenchmarkError
            If something is missing, unknown or without meaning.
        """
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
        return cls(
            name=name,
            version=int(values["version"]),
            goal=values["goal"],
            env_id=values["env_id"],
            env_kwargs=dict(values["env_kwargs"]),
            duration=float(values["duration"]),
            skip=float(values["skip"]),
            winds=winds,
            terms=tuple(_term(name, metric, given) for metric, given in values["terms"].items()),
            limits=tuple(_limit(name, metric, given) for metric, given in values["limits"].items()),
            clip=(float(low), float(high)),
            candidates=tuple(values["candidates"]),
            digest=digest({key: value for key, value in values.items() if key not in _NOT_FROZEN}),
            reference=values.get("reference"),
            yardstick=values.get("yardstick"),
            baseline=values.get("baseline", cls.baseline),
        )

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
        total = 0.0
        for term in self.terms:
            before = baseline[term.metric]
            if term.scale is None and before == 0.0:
                raise BenchmarkError(f"task {self.name}: {term.metric} of the baseline must not be 0, or needs a scale")
            total -= term.weight * (metrics[term.metric] - before) / (before if term.scale is None else term.scale)
        return total

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


def _term(name: str, metric: str, given: dict[str, Any]) -> Term:
    if not {"weight"} <= set(given) <= {"weight", "scale"} or given.get("scale", 1.0) <= 0.0:
        raise BenchmarkError(
            f"task {name}: the term {metric} must have a weight and may have a positive scale, got {given}"
        )
    return Term(metric, **given)


def _limit(name: str, metric: str, given: dict[str, float]) -> Limit:
    kinds = {"least": (True, False), "most": (False, False), "least_ratio": (True, True), "most_ratio": (False, True)}
    if len(given) != 1 or not set(given) <= set(kinds):
        raise BenchmarkError(f"task {name}: the limit of {metric} must be one of {', '.join(kinds)}, got {given}")
    ((kind, bound),) = given.items()
    return Limit(metric, float(bound), *kinds[kind])


def task_names() -> tuple[str, ...]:
    """Names of all tasks."""
    return tuple(sorted(path.stem for path in _FOLDER.glob("*.json")))


def task_file(name: str) -> Path:
    """Path of a task's file.

    Parameters
    ----------
    name : str
        Of the task.

    Raises
    ------
    wt_gym.base.errors.BenchmarkError
        If there is no such task.
    """
    if name not in task_names():
        raise BenchmarkError(
            f"task must be one of {', '.join(task_names())}; got {name!r}{did_you_mean(name, task_names())}"
        )
    return _FOLDER / f"{name}.json"


def load_task(name: str) -> BenchmarkTask:
    """Read a task.

    Parameters
    ----------
    name : str
        As of `task_file`.

    Raises
    ------
    wt_gym.base.errors.BenchmarkError
        If there is no such task, or its file is damaged.
    """
    return BenchmarkTask.from_json(json.loads(task_file(name).read_text(encoding="utf-8")))
