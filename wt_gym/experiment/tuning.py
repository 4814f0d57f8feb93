"""Tuning of a controller's parameters on training winds, for a stated cost.

The search is Optuna's (CMA-ES for several numbers needs its extra; the tree-structured Parzen estimator, its default,
takes few trials well). The result is a record: cost, search space, winds, versions and every trial.
"""

from __future__ import annotations

import json
import math
import platform
from dataclasses import asdict, dataclass, field
from inspect import signature
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import numpy as np

import wt_gym
from wt_gym.analysis.metrics import LIFETIME_COST_WEIGHTS
from wt_gym.base.errors import SimulationError
from wt_gym.base.files import require_writable, write_text_whole
from wt_gym.control.controllers.names import SHORT_FOR, load_class
from wt_gym.envs.wind_sampler import TRAINING_WIND_SEEDS
from wt_gym.experiment.comparison import Case, check_times, run_cases
from wt_gym.experiment.names import read_name

if TYPE_CHECKING:
    from collections.abc import Callable

    from wt_gym.experiment.comparison import ControllerRuns
    from wt_gym.turbines import Turbine

__all__ = ["SPACES", "Cost", "Range", "TuningTask", "tune"]


@dataclass(frozen=True)
class Range:
    """Where a parameter is searched, evenly in itself or in its logarithm."""

    low: float
    high: float
    log: bool = False


_FADE = Range(math.radians(0.5), math.radians(6.0), log=True)  # the default acts in full from 3 degrees on
SPACES: dict[str, dict[str, Range]] = {
    "retuned": {"gain_factor": Range(0.5, 1.2)},
    "tsr_tracking": {
        "tip_speed_ratio": Range(6.0, 12.0),
        "thrust_limit": Range(0.75, 1.0),
        "torque_frequency": Range(0.05, 0.6, log=True),
        "wind_time_constant": Range(0.5, 15.0, log=True),
    },
    "ipc": {"bandwidth": Range(0.03, 1.0, log=True), "lead": Range(0.0, 0.5), "proportional_time": Range(0.0, 1.0)},
    "ipc_2p": {
        "bandwidth": Range(0.03, 1.0, log=True),
        "lead": Range(0.0, 0.5),
        "second_harmonic": Range(0.05, 2.0, log=True),
    },
    "constrained_ipc": {
        "level": Range(0.02, 0.3),
        "bandwidth": Range(0.03, 1.0, log=True),
        "leak_time": Range(1.0, 60.0, log=True),
        "proportional_time": Range(0.0, 1.0),
        "fade": _FADE,
    },
    "lidar": {
        "gain": Range(0.2, 1.2),
        "delay": Range(0.0, 2.0),
        "filter_length": Range(0.1, 0.5, log=True),
    },
    "fore_aft_damper": {"damping": Range(0.01, 0.3, log=True)},
    "side_side_damper": {"damping": Range(0.005, 0.1, log=True)},
    "yaw": {"dead_band": Range(0.05, 0.3), "slow": Range(10.0, 120.0, log=True)},
}
"""Search spaces of the names of the catalogue; a combined controller has those of all its parts."""


@dataclass(frozen=True)
class Cost:
    """Weighted sum of the changes against a reference in the same wind, averaged over the winds; less is better.

    What falls short of the least power costs ten times its share more, so that no search sells power for loads.

    ``sum w_k (x_k / x_k,ref - 1)``. What a drive does (duty cycle of the pitch, rate of the torque) counts over its
    full use instead, ``w_k (x_k - x_k,ref) / full``: the reference's own may be nearly zero.

    Attributes
    ----------
    weights : dict
        By the keys of `wt_gym.benchmark.run.benchmark_metrics`. By default
        `wt_gym.analysis.metrics.LIFETIME_COST_WEIGHTS`, by which the load-reduction tasks of the benchmark score
        too: one per cent of energy is one per cent of cost.
    least_power : float
        Captured power over that of the reference; the benchmark's load-reduction tasks allow no less either.
    """

    weights: dict[str, float] = field(default_factory=lambda: dict(LIFETIME_COST_WEIGHTS))
    least_power: float = 0.995

    def of(self, metrics: dict[str, float], reference: dict[str, float], turbine: Turbine) -> float:
        """Cost of a run against the reference in the same wind."""
        full_use = {"pitch_duty_cycle": 1.0, "torque_rate": turbine.drivetrain.max_torque_rate or math.inf}
        changes = (
            weight * (metrics[key] - reference[key]) / full_use.get(key, reference[key])
            for key, weight in self.weights.items()
        )
        missing = max(self.least_power - metrics["captured_power"] / reference["captured_power"], 0.0)
        return float(sum(changes) + _OF_MISSING_POWER * missing)


_OF_MISSING_POWER = 10.0
FAILURE_COST = 10.0
"""Of a wind in which the simulation failed."""


@dataclass(frozen=True)
class TuningTask:
    """What is tuned, where, and by which cost.

    Attributes
    ----------
    controller : str
        Names of the catalogue, or a class of yours as ``path/file.py:Class``.
    reference : str
        Controller that the cost compares with.
    winds : tuple of float
        [m/s].
    seeds : tuple of int
        Turbulence seeds, of `TRAINING_WIND_SEEDS`.
    duration, skip : float
        Measured time and time before it [s].
    fidelity : str, optional
        As of the simulator.
    cost : Cost
    space : dict of Range, optional
        By default those of the parts of the name in `SPACES`; of a class of yours its attribute ``SPACE``: low
        and high by name.

    Raises
    ------
    ValueError
        If a seed is not one of training, a time is out of range, or nothing is known to search.
    """

    controller: str
    reference: str = "discon"
    winds: tuple[float, ...] = (12.0, 15.0, 18.0)
    seeds: tuple[int, ...] = (1, 2)
    duration: float = 150.0
    skip: float = 30.0
    fidelity: str | None = None
    cost: Cost = field(default_factory=Cost)
    space: dict[str, Range] | None = None

    def __post_init__(self) -> None:
        held_back = sorted(set(self.seeds) - set(TRAINING_WIND_SEEDS))
        if held_back:
            raise ValueError(f"seeds of a tuning must be training seeds (1 … 24), got {held_back}")
        check_times(self.duration, self.skip)
        for name in ("controller", "reference"):
            object.__setattr__(self, name, read_name(getattr(self, name)).text)
        if self.space is None and read_name(self.controller).kind == "class":
            given = getattr(load_class(read_name(self.controller).target), "SPACE", {})
            object.__setattr__(self, "space", {name: Range(*limits) for name, limits in given.items()})
        if self.space is None:
            parts = _parts(self.controller)
            several = len(parts) > 1
            found = {
                f"{part}__{name}" if several else name: interval
                for part in parts
                for name, interval in SPACES.get(part, {}).items()
            }
            object.__setattr__(self, "space", found)
        if not self.space:
            raise ValueError(
                f"the controller to tune must be among {', '.join(SPACES)}, got {self.controller!r}; "
                'a class of your own has SPACE = {"parameter": (low, high)}, and --space says what else is searched'
            )


def tune(
    turbine: Turbine,
    task: TuningTask,
    trials: int,
    seed: int = 0,
    output: Path | None = None,
    progress: Callable[[int, float, dict[str, float]], None] | None = None,
) -> dict[str, Any]:
    """Search the parameters of least cost.

    The first trial is the controller's defaults, where they are numbers and lie in the search space.

    Parameters
    ----------
    turbine : Turbine
    task : TuningTask
    trials : int
    seed : int
        Of the search.
    output : Path, optional
        JSON file with the record, written after every trial.
    progress : callable, optional
        Called with number, cost and parameters of every trial.

    Returns
    -------
    dict
        The record: ``best`` (parameters, cost), ``trials``, ``task``, ``versions``.

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
    cases = [Case(wind, number) for wind in task.winds for number in task.seeds]

    def runs(choice: str, parameters: dict[str, float]) -> ControllerRuns:
        name = read_name(choice)
        given = {choice: (name.target, name.parameters | parameters)}
        return run_cases(turbine, given, cases, task.duration, task.skip, task.fidelity)[0]

    reference = runs(task.reference, {})
    if reference.failures:
        failures = "; ".join(f"{case.label}: {message}" for case, message in reference.failures.items())
        raise SimulationError(f"the reference {task.reference!r} failed: {failures}")

    unknown = [name for name in task.cost.weights if any(name not in found for found in reference.metrics.values())]
    if unknown:
        known = ", ".join(next(iter(reference.metrics.values())))
        raise ValueError(f"weights of the cost must be some of {known}, got {', '.join(unknown)}")

    space = cast("dict[str, Range]", task.space)  # found by the name where none was given

    def cost(trial: optuna.Trial) -> float:
        parameters = {
            name: trial.suggest_float(name, interval.low, interval.high, log=interval.log)
            for name, interval in space.items()
        }
        run = runs(task.controller, parameters)
        single = [
            task.cost.of(run.metrics[case], reference.metrics[case], turbine) if case in run.metrics else FAILURE_COST
            for case in cases
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
        if progress is not None:
            progress(trial.number, cast("float", trial.value), trial.params)

    study.optimize(cost, n_trials=trials, callbacks=[note])
    return record


def _parts(controller: str) -> list[str]:
    """Parts of a name, those that it is short for among them."""
    return [part for name in read_name(controller).target.split("+") for part in SHORT_FOR.get(name, (name,))]


def _defaults(controller: str, space: dict[str, Range]) -> dict[str, float]:
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
