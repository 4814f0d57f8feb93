"""Controllers compared in the same winds, each against the first: runs, table and page."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from wt_gym.analysis.metrics import idle_time
from wt_gym.analysis.page import (
    Row,
    Section,
    agent_labels,
    change_tag,
    format_estimate,
    format_value,
    html_list,
    legend,
    markdown,
    settings_element,
    table,
    today,
    write_page,
)
from wt_gym.analysis.results import Wind
from wt_gym.analysis.statistics import LEAST_PER_STRATUM, Estimate, change_in_winds, is_relative
from wt_gym.base.errors import SimulationError
from wt_gym.base.options import LONGEST, Options, option, option_record
from wt_gym.control.controllers import Name, make_controller
from wt_gym.envs.episode import Agent
from wt_gym.envs.operation import OWN, simulator_maker
from wt_gym.envs.turbine_env import WindTurbineEnv
from wt_gym.experiment.agents import load_agent, load_model
from wt_gym.experiment.environments import environment_of_training
from wt_gym.experiment.execute import Executor, Experiment
from wt_gym.experiment.names import INTERFACE, RESIDUAL_INTERFACE, env_choices_of, is_base_controller, read_name
from wt_gym.experiment.run import LEAST_MEASURED, benchmark_metrics, play, run_controller
from wt_gym.simulation import Fidelity
from wt_gym.simulation.contract import TurbineSimulator
from wt_gym.simulation.fidelity import fidelity as fidelity_of
from wt_gym.simulation.fidelity import suited_fidelity
from wt_gym.turbines import Turbine
from wt_gym.wind import Inflow, SteadyInflow, TurbulenceBox, TurbulentInflow

if TYPE_CHECKING:
    import xarray as xr

__all__ = [
    "COLUMNS", "ComparisonConfig", "ControllerRuns", "change", "comparison_table", "in_all_winds", "inflow_of",
    "run_cases", "write_comparison",
]  # fmt: skip

COLUMNS = (
    ("mean_power", "power"),
    ("blade_flap_del", "flap DEL"),
    ("blade_edge_del", "edge DEL"),
    ("tower_fore_aft_del", "tower f-a DEL"),
    ("tower_side_side_del", "tower s-s DEL"),
    ("pitch_duty_cycle", "duty"),
    ("torque_rate", "torque rate"),
    ("rotor_speed_max", "speed max"),
)
"""Metrics of `wt_gym.analysis.metrics` and their short names."""


@dataclass
class ControllerRuns:
    """Metrics of one controller by wind; a run that failed has none, its message stands in ``failures``.

    ``idle`` has the time in which the turbine made no power without a reason [s], see `wt_gym.envs.terminations`.
    """

    name: str
    metrics: dict[Wind, dict[str, float]]
    failures: dict[Wind, str]
    idle: dict[Wind, float] = field(default_factory=dict)

    @property
    def done(self) -> tuple[Wind, ...]:
        """Winds that were run, whether runs failed or not."""
        return (*self.metrics, *self.failures)


def inflow_of(turbine: Turbine, wind: Wind, shear_exponent: float = 0.2) -> Inflow:
    """Inflow of a wind: sheared, with Kaimal turbulence of the turbine's class if there is a seed."""
    steady = SteadyInflow(wind.speed, turbine.hub_height, shear_exponent=shear_exponent)
    if wind.seed is None:
        return steady
    box = TurbulenceBox.kaimal(
        wind.speed, turbine.hub_height, turbine.rotor_diameter, turbine.turbulence_class, seed=wind.seed,
        turbine_class=turbine.iec_class,
    )  # fmt: skip
    return TurbulentInflow(box, steady)


@option_record
class ComparisonConfig(Options):
    """Length of the runs of a comparison, and their simulation.

    ``simulator`` is as the argument of the environment, for controllers and agents.
    """

    title = "comparison"

    duration: float = option("measured time", default=150.0, unit="s", low=LEAST_MEASURED, high=LONGEST)
    skip: float = option("time before it", default=30.0, unit="s", low=0.0, high=LONGEST)
    fidelity: str | Fidelity | None = option(
        "fidelity of the simulator", default=None, kinds=(str, Fidelity), otherwise="that of the turbine"
    )
    control_dt: float | None = option(
        "interval of the controllers; signals are recorded at it, and agents of a longer one hold their actions",
        default=None, unit="s", low=0.0, high=LEAST_MEASURED, above=True, otherwise="step of the simulator",
    )  # fmt: skip
    simulator: Any = OWN


def run_cases(
    turbine: Turbine,
    controllers: Mapping[str, tuple[str, dict[str, Any]]],
    winds: Iterable[Wind],
    config: ComparisonConfig | None = None,
    *,
    runs: list[ControllerRuns] | None = None,
    executor: Executor | None = None,
    progress: bool = False,
) -> list[ControllerRuns]:
    """Run every controller in every wind.

    Where one is an agent with ``predict``, all run in environments, controllers as base controllers of zero actions:
    so that all start alike.

    Parameters
    ----------
    controllers : mapping
        From a label to name and parameters: of a controller as `make_controller` takes them, or of any agent that
        `wt_gym.experiment.names.read_name` knows, which runs in an environment with the same wind.
    winds : iterable of Wind
        Mean speed and seed of the turbulence; without a seed the wind is steady.
    runs : list of ControllerRuns, optional
        That get the metrics, by default new ones. The caller's own have those of the runs before the series stopped.
    executor, progress
        As of `wt_gym.experiment.evaluation.evaluate`.

    Raises
    ------
    ValueError
        If a controller or agent cannot be made; nothing has run then.
    wt_gym.base.errors.InflowError
        If a wind cannot be made; nothing has run then.
    """
    winds = list(winds)
    steady = [inflow_of(turbine, Wind(wind.speed), 0.0) for wind in winds]  # refuses speeds without meaning
    runs = [] if runs is None else runs
    by_label = {label: ControllerRuns(label, {}, {}) for label in controllers}
    runs += by_label.values()
    experiment = _Comparison(turbine, dict(controllers), config or ComparisonConfig())
    experiment.check(steady[0])
    rows = [(label, wind) for wind in winds for label in controllers]
    for number, (metrics, failure, idle) in experiment.played(rows, executor, progress=progress):
        label, wind = rows[number]
        if metrics is not None:
            by_label[label].metrics[wind], by_label[label].idle[wind] = metrics, idle
        else:
            by_label[label].failures[wind] = str(failure)
    return runs


class _Comparison(Experiment):
    """Rows of a comparison: label of a controller and wind.

    Simulator and inflow stay from one row to the next, and go to no other process.
    """

    def __init__(self, turbine: Turbine, controllers: dict[str, tuple[str, dict[str, Any]]], config: ComparisonConfig):
        self._turbine, self._controllers, self._config = turbine, controllers, config
        self._fidelity = suited_fidelity(turbine) if config.fidelity is None else config.fidelity
        self._in_environments = not all(is_base_controller(choice) for choice, _ in controllers.values())
        self._whole = config.skip + config.duration
        self._simulator: TurbineSimulator | None = None
        self._wind: tuple[Wind, Inflow] | None = None

    def __getstate__(self) -> dict[str, Any]:
        return vars(self) | {"_simulator": None, "_wind": None}

    def definition(self, row: tuple[str, Wind]) -> dict[str, Any]:
        return {"label": row[0], "speed": row[1].speed, "seed": row[1].seed}

    def label(self, row: tuple[str, Wind]) -> str:
        return f"{row[0]} at {row[1].name}"

    def __call__(self, row: tuple[str, Wind]) -> tuple[dict[str, float] | None, str | None, float]:
        """Metrics of a controller in a wind, or why there are none, and `idle_time` [s]."""
        label, wind = row
        if self._wind is None or self._wind[0] != wind:
            self._wind = wind, inflow_of(self._turbine, wind)
        try:
            data = (self._played if self._in_environments else self._controlled)(label, self._wind[1])
            return benchmark_metrics(data, self._turbine, self._config.skip), None, idle_time(data)
        except SimulationError as error:
            return None, str(error), 0.0

    def check(self, inflow: Inflow) -> None:
        """Make every controller or agent once, in any wind: what cannot be made is refused before the first run."""
        for label, (choice, parameters) in self._controllers.items():
            try:
                if self._in_environments:
                    self._environment(label, inflow)[0].close()
                else:
                    make_controller(choice, self._turbine, **parameters)
            except (ValueError, TypeError, OSError) as error:
                raise ValueError(f"{label}: {error}") from error

    def _controlled(self, label: str, inflow: Inflow) -> xr.Dataset:
        """Signals of a controller on the bare simulator."""
        if self._simulator is None:
            maker = simulator_maker(self._config.simulator, self._turbine, pictured=False, longest=lambda: self._whole)
            self._simulator = maker(self._turbine, inflow, self._fidelity)
        self._simulator.inflow = inflow
        choice, parameters = self._controllers[label]
        controller = make_controller(choice, self._turbine, **parameters)
        return run_controller(
            self._simulator, controller, self._whole, self._config.control_dt, name=label
        ).to_dataset()

    def _played(self, label: str, inflow: Inflow) -> xr.Dataset:
        """Signals of an agent in an environment, at the start and after every control step."""
        env, agent = self._environment(label, inflow)
        try:
            episode = play(env, agent, seed=0, options={"azimuth": 0.0}, duration=self._whole)
            if episode.ending != "time":
                raise SimulationError(f"ended after {episode.time:g} s: {episode.failure or episode.ending}")
            return episode.data
        finally:
            env.close()

    def _environment(self, label: str, inflow: Inflow) -> tuple[WindTurbineEnv, Agent]:
        """Environment of the training of an agent, or the one that it chooses, and the agent in it.

        A controller is the base controller of zero actions, and so are words without an environment of their own.
        """
        choice, parameters = self._controllers[label]
        name, config = Name(read_name(choice).kind, choice, parameters), self._config
        model = load_model(name) if name.kind == "trained" else None
        record = (model.record if model is not None else None) or {}
        interface = environment_of_training(record, INTERFACE) | env_choices_of(name.text)
        if name.kind == "word" or is_base_controller(name.text):
            interface |= RESIDUAL_INTERFACE
        if is_base_controller(name.text):
            interface["controller"] = partial(make_controller, name.text)
        step = fidelity_of(self._fidelity).step_for(self._turbine.drivetrain.rated_rotor_speed)
        interface["control_dt"] = config.control_dt or interface.get("control_dt") or step
        interface |= {"inflow": inflow, "wind_speed": None, "start": "steady", "simulator": config.simulator}
        env = WindTurbineEnv(self._turbine, fidelity=self._fidelity, **interface)
        try:
            agent = load_agent(name.text, env.layout, env) if model is None else model
            if model is not None:
                model.enter(env.layout)
        except BaseException:
            env.close()
            raise
        return env, agent


def in_all_winds(runs: list[ControllerRuns]) -> list[ControllerRuns]:
    """Give the same without the winds in which only some have run, because the series was stopped there."""
    done = [wind for wind in runs[0].done if all(wind in run.done for run in runs)]
    return [
        ControllerRuns(
            run.name,
            {wind: run.metrics[wind] for wind in done if wind in run.metrics},
            {wind: run.failures[wind] for wind in done if wind in run.failures},
            run.idle,
        )
        for run in runs
    ]


def comparison_table(runs: list[ControllerRuns]) -> str:
    """Markdown by wind speed: the first controller's means over the seeds, and the changes of the others against it.

    Duty cycle, torque rate and greatest speed are means, not changes, and so is a metric whose reference rounds to
    zero.
    """
    rows = [
        Row(f"{speed:g}", [run.name, *(_cell(key, run, runs[0], speed) for key, _ in COLUMNS)])
        for speed in sorted({wind.speed for wind in runs[0].metrics})
        for run in runs
    ]
    return "\n".join(markdown(["wind", "controller", *(name for _, name in COLUMNS)], rows))


def change(run: ControllerRuns, reference: ControllerRuns, wind_speed: float | None, metric: str) -> Estimate | None:
    """Change of a metric in the winds of a speed, or in all, by `wt_gym.analysis.statistics.change_in_winds`.

    None where no wind can be compared, and where no share makes sense (`wt_gym.analysis.statistics.is_relative`).
    """
    winds = [wind for wind in run.metrics if wind_speed in (None, wind.speed) and wind in reference.metrics]
    values, baseline = ([each.metrics[wind][metric] for wind in winds] for each in (run, reference))
    if not winds or not is_relative(metric, baseline):
        return None
    return change_in_winds(metric, values, baseline, [wind.speed for wind in winds])


def _cell(key: str, run: ControllerRuns, reference: ControllerRuns, speed: float, html: bool = False) -> str:
    """Value of the reference or of a metric that is shown as such, else the change."""
    values = [metrics[key] for wind, metrics in run.metrics.items() if wind.speed == speed]
    if not values:
        return "failed"
    estimate = change(run, reference, speed, key)
    if run is reference or key in _VALUES or estimate is None:
        return format_value(key, float(np.mean(values)), unit=True)
    return change_tag(key, estimate, "main") if html else format_estimate(key, estimate)


# ---- the page ----

_HEADS = {
    "mean_power": "Power", "blade_flap_del": "Flap DEL", "blade_edge_del": "Edge DEL",
    "tower_fore_aft_del": "Fore-aft DEL", "tower_side_side_del": "Side-side DEL", "pitch_duty_cycle": "Pitch duty",
    "torque_rate": "Torque rate", "rotor_speed_max": "Speed, largest",
}  # fmt: skip
_VALUES = ("pitch_duty_cycle", "torque_rate", "rotor_speed_max")
"""Shown as means, not as changes."""
_LOADS = {
    "blade_flap_del": "flapwise blade fatigue", "tower_fore_aft_del": "fore-aft tower fatigue",
    "tower_side_side_del": "side-side tower fatigue",
}  # fmt: skip


def write_comparison(
    runs: Sequence[ControllerRuns], path: str | Path, turbine: str, settings: Mapping[str, Any]
) -> Path:
    """Write an HTML page of runs in the same winds, against the first; its folder is created if missing.

    The settings have ``duration`` and ``skip`` [s], and what else it was made with; the turbine is told by its title.
    """
    cases = runs[0].done
    speeds = sorted({case.speed for case in cases})
    seeds = list(dict.fromkeys(case.seed for case in cases if case.seed is not None))
    marks = [
        f"changes against <b>{escape(runs[0].name)}</b> in the same winds, with a 95 % interval from"
        f" {LEAST_PER_STRATUM} seeds on",
        "pitch, torque and speed: means",
    ]
    failures = [
        f"{run.name} at {case.speed:g} m/s, seed {case.seed}: {message}"
        for run in runs
        for case, message in run.failures.items()
    ]
    return write_page(
        path,
        title=f"{turbine}: controllers compared",
        result=_result(runs),
        facts={
            "Turbine": turbine,
            "Mean wind speed": f"{', '.join(f'{speed:g}' for speed in speeds)} m/s",
            "Winds": f"seeds {', '.join(map(str, seeds))}" if seeds else "steady",
            "Duration": f"{settings['duration']:g} s each, after {settings['skip']:g} s that are left out",
            "Simulation": f"fidelity \u201c{settings['fidelity']}\u201d",
            "Date": today(),
        },
        sections=[
            Section("verdict", f"What changes against {runs[0].name}?", legend(more=marks) + _blocks(runs, speeds),
                    link="Changes"),
            Section("failed", "What failed", html_list(failures)),
            Section("method", "Settings", settings_element(settings)),
        ],
    )  # fmt: skip


def _result(runs: Sequence[ControllerRuns]) -> str:
    """The controller with the least fatigue over all winds, and what it changes."""
    reference, *others = runs
    if not others:
        return f"{reference.name} alone, in {len(reference.metrics)} winds."

    def changed(run: ControllerRuns, metric: str) -> float:
        """Change over all winds; NaN where there is none."""
        estimate = change(run, reference, None, metric)
        return math.nan if estimate is None else estimate.value

    def percent(value: float) -> str:
        return f"{100.0 * value:+.1f}\u00a0%".replace("-", "\u2212")

    changes = {run.name: {key: changed(run, key) for key in _LOADS} for run in others if run.metrics}
    least = {name: float(np.mean(list(by_load.values()))) for name, by_load in changes.items()}
    known = {name: value for name, value in least.items() if not math.isnan(value)}
    if not known:
        return f"No wind in which {reference.name} and another controller ran."
    best = min(known, key=known.__getitem__)
    if known[best] >= 0.0:
        return f"No controller has less fatigue than {reference.name} in the mean of blade and tower."
    words = ", ".join(f"{name} by {percent(changes[best][key])}" for key, name in _LOADS.items())
    power = changed(next(run for run in others if run.name == best), "mean_power")
    more = "" if math.isnan(power) else f", and power by {percent(power)}"
    winds = f"mean over {len(reference.metrics)} winds"
    return f"Least fatigue: {best} changes {words}{more} against {reference.name}, {winds}."


def _blocks(runs: Sequence[ControllerRuns], speeds: Sequence[float]) -> str:
    """A block a wind speed, a row a controller."""
    labels, rows = agent_labels([run.name for run in runs]), []
    for speed in speeds:
        rows.append(Row(f"{speed:g} m/s"))
        rows += [
            Row(labels[run.name], [_cell(key, run, runs[0], speed, html=True) for key, _ in COLUMNS]) for run in runs
        ]
    return table(["Controller", *(_HEADS[key] for key, _ in COLUMNS)], rows)
