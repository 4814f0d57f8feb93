"""Tuning of a controller's parameters on training winds, for a stated cost.

The search is Optuna's (CMA-ES for several numbers needs its extra; the tree-structured Parzen estimator, its default,
takes few trials well). The result is a record: cost, search space, winds, versions and every trial.
"""

import json
import math
import platform
import time
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from inspect import signature
from pathlib import Path
from typing import Any, cast

import numpy as np

import wt_gym
from wt_gym.analysis.metrics import LIFETIME_COST_WEIGHTS
from wt_gym.analysis.results import Wind
from wt_gym.base.errors import SimulationError
from wt_gym.base.files import read_toml, require_writable, write_text_whole
from wt_gym.base.options import LONGEST, Options, option, option_record
from wt_gym.control.controllers.names import BASELINE, SHORT_FOR, load_class
from wt_gym.envs.wind_sampler import TRAINING_WIND_SEEDS
from wt_gym.experiment.benchmark_tasks import ScoreTerm, improvement
from wt_gym.experiment.comparison import ComparisonConfig, ControllerRuns, run_cases
from wt_gym.experiment.execute import ProgressLine, clock
from wt_gym.experiment.names import read_name
from wt_gym.experiment.run import LEAST_MEASURED
from wt_gym.turbines import Turbine

__all__ = ["SPACES", "Cost", "SearchRange", "TuningTask", "parameters_text", "tune"]


@dataclass(frozen=True)
class SearchRange:
    """Where a parameter is searched, evenly in itself or in its logarithm."""

    low: float
    high: float
    log: bool = False


SPACES: dict[str, dict[str, SearchRange]] = {
    controller: {name: SearchRange(**space) for name, space in spaces.items()}
    for controller, spaces in read_toml(Path(__file__).with_suffix(".toml")).items()
}
"""Search spaces of the names of the catalog; a combined controller has those of all its parts."""


@dataclass(frozen=True)
class Cost:
    """Weighted sum of the changes against a reference in the same wind, averaged over the winds; less is better.

    ``sum w_k (x_k / x_k,ref - 1)``: by default the negative of what the load-reduction tasks of the benchmark score, so
    that one per cent of energy is one per cent of cost. The activity of a drive (duty cycle of the pitch, rate of the
    torque) counts over its full use instead, ``w_k (x_k - x_k,ref) / full``: the reference's may be nearly zero. Power
    below the least costs ten times its share more, so that no search sells power for loads.
    """

    weights: dict[str, float] = field(default_factory=lambda: dict(LIFETIME_COST_WEIGHTS))
    """By the keys of `wt_gym.experiment.run.benchmark_metrics`."""
    least_power: float = 0.995
    """Captured power over that of the reference; the benchmark's load-reduction tasks allow no less either."""

    def of(self, metrics: dict[str, float], reference: dict[str, float], turbine: Turbine) -> float:
        """Cost of a run against the reference in the same wind."""
        full_use = {"pitch_duty_cycle": 1.0, "torque_rate": turbine.drivetrain.max_torque_rate or math.inf}
        terms = [ScoreTerm(key, weight, full_use.get(key)) for key, weight in self.weights.items()]
        missing = max(self.least_power - metrics["captured_power"] / reference["captured_power"], 0.0)
        return float(_OF_MISSING_POWER * missing - improvement(terms, metrics, reference))


_OF_MISSING_POWER = 10.0
FAILURE_COST = 10.0
"""Of a wind in which the simulation failed."""


@option_record
class TuningTask(Options):
    """Controller to tune, winds, and cost.

    ``cost`` is a `Cost`. ``space``, a mapping of parameters to `SearchRange`, is by default that of the parts of the
    name in `SPACES`; of a class of yours its attribute ``SPACE``: low and high by name.
    """

    title = "tuning"

    controller: str = option("names of the catalog, or a class of yours as ``path/file.py:Class``", default="ipc")
    reference: str = option("controller that the cost compares with", default=BASELINE)
    winds: tuple[float, ...] = option("mean wind speeds", default=(12.0, 15.0, 18.0), unit="m/s", low=0.0, above=True)
    seeds: tuple[int, ...] = option(
        "turbulence seeds of training", default=(1, 2), low=min(TRAINING_WIND_SEEDS), high=max(TRAINING_WIND_SEEDS)
    )
    duration: float = option("measured time", default=150.0, unit="s", low=LEAST_MEASURED, high=LONGEST)
    skip: float = option("time before it", default=30.0, unit="s", low=0.0, high=LONGEST)
    fidelity: str | None = option("fidelity of the simulator", default=None, otherwise="that of the turbine")
    cost: Cost = field(default_factory=Cost)
    space: dict[str, SearchRange] | None = None

    def check(self) -> None:
        """Resolve aliases and the search space; refuse a controller without one."""
        for key in ("controller", "reference"):
            self._set(key, read_name(getattr(self, key)).text)
        name, space = read_name(self.controller), self.space
        if space is None and name.kind == "class":
            limits = getattr(load_class(name.target), "SPACE", {})
            space = {key: SearchRange(*interval) for key, interval in limits.items()}
        elif space is None:
            parts = _parts(self.controller)
            space = {
                f"{part}__{key}" if len(parts) > 1 else key: interval
                for part in parts
                for key, interval in SPACES.get(part, {}).items()
            }
        self._set("space", space)
        if not space:
            raise ValueError(
                f"the controller to tune must be among {', '.join(SPACES)}, got {self.controller!r}; "
                'a class of your own has SPACE = {"parameter": (low, high)}, and --space says what else is searched'
            )


def tune(
    turbine: Turbine, task: TuningTask, trials: int, seed: int = 0, output: Path | None = None, progress: bool = False
) -> dict[str, Any]:
    """Search the parameters of least cost.

    The first trial is the controller's defaults, where they are numbers and lie in the search space.

    The JSON file of ``output`` gets the record after every trial: ``best`` (parameters, cost), ``trials``, ``task``,
    ``versions``; with ``progress`` each trial is shown on standard error.

    Raises
    ------
    ValueError
        If there is no trial to make, or the cost weighs what is not a metric of a run.
    SimulationError
        If the reference does not run to the end.
    OSError
        If the record cannot be written.
    """
    import optuna  # in the extra "tune"

    if trials < 1:
        raise ValueError(f"the number of trials must be at least 1, got {trials}")
    if output is not None:
        require_writable(output.parent)
    line, began = ProgressLine(progress), time.monotonic()
    winds = [Wind(wind, number) for wind in task.winds for number in task.seeds]

    settings = ComparisonConfig(duration=task.duration, skip=task.skip, fidelity=task.fidelity)

    def runs(choice: str, parameters: dict[str, float]) -> ControllerRuns:
        name = read_name(choice)
        given = {choice: (name.target, name.parameters | parameters)}
        return run_cases(turbine, given, winds, settings)[0]

    reference = runs(task.reference, {})
    if reference.failures:
        failures = "; ".join(f"{wind.label}: {message}" for wind, message in reference.failures.items())
        raise SimulationError(f"the reference {task.reference!r} failed: {failures}")

    unknown = [name for name in task.cost.weights if any(name not in found for found in reference.metrics.values())]
    if unknown:
        known = ", ".join(next(iter(reference.metrics.values())))
        raise ValueError(f"weights of the cost must be some of {known}, got {', '.join(unknown)}")

    space = cast("dict[str, SearchRange]", task.space)  # found by the name where none was given

    def cost(trial: optuna.Trial) -> float:
        parameters = {
            name: trial.suggest_float(name, interval.low, interval.high, log=interval.log)
            for name, interval in space.items()
        }
        run = runs(task.controller, parameters)
        single = [
            task.cost.of(run.metrics[wind], reference.metrics[wind], turbine) if wind in run.metrics else FAILURE_COST
            for wind in winds
        ]
        return float(np.mean(single))

    optuna.logging.set_verbosity(optuna.logging.ERROR)  # it warns of a trial that Ctrl-C ends by a traceback
    study = optuna.create_study(sampler=optuna.samplers.TPESampler(seed=seed))
    defaults = _defaults(task.controller, space)
    study.enqueue_trial({key: value for key, value in defaults.items() if space[key].low <= value <= space[key].high})
    record: dict[str, Any] = {
        "task": asdict(task),
        "turbine": turbine.name,
        "search": {"sampler": "TPE", "seed": seed},
        "versions": {"wt_gym": wt_gym.__version__, "optuna": optuna.__version__, "python": platform.python_version()},
        "trials": [],
    }

    def note(_: optuna.Study, trial: optuna.trial.FrozenTrial) -> None:
        record["trials"].append({"cost": trial.value, "parameters": trial.params})
        record["best"] = min(record["trials"], key=lambda row: row["cost"])
        if output is not None:
            write_text_whole(output, json.dumps(record, indent=1) + "\n")
        done, elapsed = trial.number + 1, time.monotonic() - began
        line.show(
            f"trial {done}/{trials}: cost {trial.value:+.4f} with {parameters_text(trial.params)}, {clock(elapsed)} "
            f"min, about {clock(elapsed / done * (trials - done))} min left", final=True,
        )  # fmt: skip

    study.optimize(cost, n_trials=trials, callbacks=[note])
    return record


def parameters_text(parameters: Mapping[str, float]) -> str:
    """Parameters in a sentence."""
    return ", ".join(f"{name} {value:.4g}" for name, value in parameters.items())


def _parts(controller: str) -> list[str]:
    """Parts of a name, those that it is short for among them."""
    return [part for name in read_name(controller).target.split("+") for part in SHORT_FOR.get(name, (name,))]


def _defaults(controller: str, space: dict[str, SearchRange]) -> dict[str, float]:
    """Numbers that a controller has by default for what is searched, as far as they are numbers and not rules."""
    from wt_gym.control.controllers import FadeParameters, controller_parameters

    name = read_name(controller)
    if name.kind == "class":
        own = {key: p.default for key, p in signature(load_class(name.target)).parameters.items()} | name.parameters
        return {key: float(own[key]) for key in space if isinstance(own.get(key), int | float)}
    known = {f"{part}__{key}": v for part in _parts(controller) for key, v in controller_parameters(part).items()}
    for part in name.target.split("+"):
        known |= controller_parameters(part)  # of tuned ones what was found
    faded = {key: FadeParameters().pitch[1] for key, value in known.items() if key.endswith("fade") and value is True}
    return {key: value for key, value in (known | faded).items() if key in space and isinstance(value, float)}
