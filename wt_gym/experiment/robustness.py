"""Agents on turbines, with sensors and in winds that they were not made for: the share of their gain that is left.

Every condition is a variation of the environment (`wt_gym.envs.variation`), or a fault in it
(`wt_gym.envs.faults`), in which all agents meet the same winds. The gain of an agent is that of the load-reduction
tasks of the benchmark, wind by wind against a reference in the same condition: the baseline controller, and the
controller that the agent acts on top of.
"""

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np

from wt_gym.analysis.results import Evaluation, Wind
from wt_gym.analysis.statistics import estimate
from wt_gym.base.errors import did_you_mean
from wt_gym.base.files import read_toml, write_text_whole
from wt_gym.control.controllers.names import BASELINE
from wt_gym.envs.layout import layout_of
from wt_gym.envs.options import Variation, registered_arguments
from wt_gym.experiment.agents import load_model
from wt_gym.experiment.benchmark_tasks import load_task
from wt_gym.experiment.environments import trained_arguments
from wt_gym.experiment.evaluation import EvaluationConfig, evaluate
from wt_gym.experiment.execute import Executor, ProgressLine
from wt_gym.experiment.names import own_controller, read_name
from wt_gym.experiment.run import benchmark_metrics
from wt_gym.turbines import Turbine

NOMINAL = "nominal"
RESULTS_FILE, TABLE_FILE = "robustness.json", "robustness.md"
COST_TASK = "load-reduction-15"
"""Task of the benchmark whose terms are the gain."""
FAULT_TIME = 25.0
"""At which the faults of conditions begin [s]."""


@dataclass(frozen=True)
class Condition:
    """What differs from the nominal turbine, sensors and wind."""

    name: str
    text: str
    variation: Variation = field(default_factory=Variation)
    fault: str = ""  #: kind of `wt_gym.envs.faults.FAULT_KINDS` that breaks; "" for none

    @property
    def arguments(self) -> dict[str, Any]:
        """Arguments of the environment."""
        if self.fault:
            return {"faults": {"kinds": [self.fault], "time": FAULT_TIME}}
        return {} if self.name == NOMINAL else {"variation": self.variation.as_dict()}


_ALL = {
    name: Condition(name, one["text"], Variation(**one.get("variation", {})), one.get("fault", ""))
    for name, one in read_toml(Path(__file__).with_suffix(".toml")).items()
}
"""Those without and with a fault, by name."""
CONDITIONS = {name: one for name, one in _ALL.items() if not one.fault}
"""Conditions without a fault."""
FAULT_CONDITIONS = {name: one for name, one in _ALL.items() if one.fault}
"""Conditions with a fault that begins at `FAULT_TIME` and lasts, by name."""
FAULTS = "faults"
"""Stands for all of `FAULT_CONDITIONS`."""


def chosen(names: Iterable[str] | None = None) -> tuple[Condition, ...]:
    """Conditions by their names, the nominal one first; by default those without faults, "faults" for all with one."""
    given = list(CONDITIONS if names is None else names)
    given = [one for name in given for one in (FAULT_CONDITIONS if name == FAULTS else (name,))]
    for name in given:
        if name not in _ALL:
            raise ValueError(
                f"a condition must be {FAULTS} or one of {', '.join(_ALL)}, got {name!r}"
                f"{did_you_mean(name, (FAULTS, *_ALL))}"
            )
    return tuple(_ALL[name] for name in dict.fromkeys((NOMINAL, *given)))


@dataclass(frozen=True)
class Gain:
    """Mean gain over the winds, with its 95 % interval."""

    value: float | None  #: none where a run ended early
    low: float | None  #: lower end of the interval; None where there are too few winds
    high: float | None  #: upper end
    by_wind: tuple[float | None, ...]  #: none for a run that ended early


@dataclass(frozen=True)
class Robustness:
    """Gains of agents in conditions."""

    settings: dict[str, Any]  #: environment, winds and lengths
    reference: str  #: the first agent
    bases: dict[str, str | None]  #: name of the controller that an agent acts on top of, None without one
    conditions: tuple[Condition, ...]
    over_reference: dict[str, dict[str, Gain]]  #: `Gain` over the reference by condition and agent
    over_base: dict[str, dict[str, Gain]]  #: `Gain` over the base controller
    idle: dict[str, list[str]] = field(default_factory=dict)
    """Sentences on agents under which the turbine made no power without a reason, by condition."""

    def kept(self, condition: str, agent: str) -> float | None:
        """Share of the nominal gain over the base controller that is left; None where there was none."""
        own, nominal = (self.over_base[name].get(agent) for name in (condition, NOMINAL))
        if own is None or nominal is None or own.value is None or nominal.value is None or nominal.value <= 0.0:
            return None
        return own.value / nominal.value

    def to_json(self) -> dict[str, Any]:
        """All of it, as JSON values."""
        gains = {
            name: {c: {agent: asdict(gain) for agent, gain in of.items()} for c, of in getattr(self, name).items()}
            for name in ("over_reference", "over_base")
        }
        return (
            vars(self)
            | gains
            | {
                "conditions": {one.name: one.arguments.get("variation", one.arguments) for one in self.conditions},
                "kept": {
                    one.name: {a: self.kept(one.name, a) for a in self.over_base[one.name]} for one in self.conditions
                },
            }
        )

    def to_markdown(self) -> str:
        """One table an agent."""
        from wt_gym.analysis.page import Row, markdown  # with plotly

        lines = []
        for agent in (name for name in self.bases if name != self.reference):
            base = self.bases[agent]
            lines += [f"### {agent}", ""]
            rows = []
            for one in self.conditions:
                share = self.kept(one.name, agent)
                gains = self.over_reference[one.name][agent], self.over_base[one.name].get(agent)
                kept = "–" if share is None else f"{100.0 * share:.0f} %"
                rows.append(Row(one.text, [*map(_shown, gains), kept]))
            head = ["condition", f"gain over {self.reference}", f"gain over {base or '–'}", "kept"]
            lines += [*markdown(head, rows), ""]
        lines += [f"{condition}: {sentence}" for condition, found in self.idle.items() for sentence in found]
        return "\n".join(lines)


def _shown(gain: Gain | None) -> str:
    """Gain in percent, with its interval."""
    if gain is None:
        return "–"
    if gain.value is None:
        return f"{sum(one is None for one in gain.by_wind)} runs ended early"
    text = f"{100.0 * gain.value:+.2f} %"
    if gain.low is None or gain.high is None:
        return text
    return f"{text} ({100.0 * gain.low:+.2f} to {100.0 * gain.high:+.2f})"


def base_of(choice: str, env_id: str, env_kwargs: Mapping[str, Any]) -> str | None:
    """Name of the controller that an agent acts on top of.

    Of a trained residual agent the controller of its training, of a controller None: it is one itself.
    """
    name = read_name(choice)
    if name.kind == "controller":
        return None
    if name.kind == "trained":
        arguments = trained_arguments(load_model(name).record or {})
        if arguments:
            residual = arguments.get("action_mode") == "residual"
            found = arguments.get("controller", BASELINE)
            return found if residual and isinstance(found, str) else None
    residual = registered_arguments(env_id, env_kwargs).get("action_mode") == "residual"
    return own_controller(env_id, env_kwargs) if residual else None


def run_robustness(
    agents: Mapping[str, str],
    config: EvaluationConfig,
    conditions: Sequence[Condition] = tuple(CONDITIONS.values()),
    *,
    folder: str | Path,
    overwrite: bool = False,
    allow_other_environment: bool = False,
    executor: Executor | None = None,
    progress: bool = True,
) -> Robustness:
    """Run agents in conditions; each condition is an evaluation of its own in the folder, whose runs are kept.

    Parameters
    ----------
    agents : mapping
        Name to word or path; the first is the reference. The controllers that agents act on top of are run too.
    config : EvaluationConfig
        Nominal environment, winds and lengths.
    conditions : sequence of Condition
        The nominal one first.
    folder : str or path
        Gets a folder a condition, and the results as JSON and Markdown.
    overwrite, allow_other_environment, executor, progress
        As of `wt_gym.experiment.evaluation.evaluate`.

    Raises
    ------
    ValueError, OSError, ChildProcessError
        As of `wt_gym.experiment.evaluation.evaluate`; and if the nominal environment has a variation.
    """
    if "variation" in config.env_kwargs or any(name.startswith("vary_") for name in config.env_kwargs):
        raise ValueError("variation must be left out of env_kwargs: the conditions are variations")
    if not conditions or conditions[0].name != NOMINAL:
        raise ValueError(f"the first condition must be {NOMINAL!r}, got {[one.name for one in conditions]}")
    folder, given = Path(folder), dict(agents)
    bases = {name: base_of(choice, config.env_id, config.env_kwargs) for name, choice in given.items()}
    everyone = dict(given)
    for base in dict.fromkeys(base for base in bases.values() if base is not None):
        if all(choice != base for choice in everyone.values()):
            everyone[base] = base
    label = {choice: name for name, choice in reversed(everyone.items())}
    shown = {name: None if base is None else label[base] for name, base in bases.items()}
    reference, line = next(iter(given)), ProgressLine(progress)
    env = gym.make(config.env_id, **config.env_kwargs)
    turbine = layout_of(env).turbine
    env.close()
    over_reference: dict[str, dict[str, Gain]] = {}
    over_base: dict[str, dict[str, Gain]] = {}
    idle: dict[str, list[str]] = {}
    for one in conditions:
        line.show(f"{one.name}: {one.text}", final=True)
        found = evaluate(
            everyone, replace(config, env_kwargs={**config.env_kwargs, **one.arguments}, replay=0.0),
            folder=folder / one.name, overwrite=overwrite, allow_other_environment=allow_other_environment,
            executor=executor, progress=progress,
        )  # fmt: skip
        idle[one.name] = list(found.idle_sentences.values())
        metrics = _metrics(found, turbine, config.skip)
        over_reference[one.name] = {name: _gain(metrics, name, reference) for name in given if name != reference}
        over_base[one.name] = {name: _gain(metrics, name, base) for name, base in shown.items() if base is not None}
    settings = {
        "env_id": config.env_id, "env_kwargs": registered_arguments(config.env_id, config.env_kwargs),
        "winds": [asdict(wind) for wind in config.winds], "duration": config.duration, "skip": config.skip,
        "cost": COST_TASK,
    }  # fmt: skip
    result = Robustness(settings, reference, shown, tuple(conditions), over_reference, over_base, idle)
    write_text_whole(folder / RESULTS_FILE, json.dumps(result.to_json(), indent=1, default=str) + "\n")
    write_text_whole(folder / TABLE_FILE, result.to_markdown())
    return result


_Metrics = dict[str, dict["Wind", "dict[str, float] | None"]]


def _metrics(evaluation: Evaluation, turbine: Turbine, skip: float) -> _Metrics:
    """Metrics of every agent in every wind; None of a run that ended early."""
    metrics: _Metrics = {}
    for run in evaluation.runs:
        data = run.data.isel(time=slice(1, None))
        metrics.setdefault(run.agent, {})[run.wind] = benchmark_metrics(data, turbine, skip) if run.complete else None
    return metrics


def _gain(metrics: _Metrics, agent: str, reference: str) -> Gain:
    """Gain over a reference in the same winds."""
    improvement, of_agent, of_reference = load_task(COST_TASK).improvement, metrics[agent], metrics[reference]
    gains: list[float | None] = []
    for wind, mine in of_agent.items():
        theirs = of_reference[wind]
        gains.append(None if mine is None or theirs is None else improvement(mine, theirs))
    values = np.array([gain for gain in gains if gain is not None])
    if len(values) < len(gains):
        return Gain(None, None, None, tuple(gains))
    mean = estimate([wind.speed for wind in of_agent], lambda k: values[k].mean(axis=-1), True).to_json()
    return Gain(mean["value"], mean["low"], mean["high"], tuple(gains))
