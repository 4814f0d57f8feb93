"""Controllers compared in the same winds, each against the first: runs, table and page."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import partial
from html import escape
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.special import stdtrit

from wt_gym.analysis.change import is_relative, relative_change
from wt_gym.analysis.metrics import METRICS, idle_time
from wt_gym.analysis.paired import Estimate
from wt_gym.analysis.plots import agent_styles
from wt_gym.analysis.report_page import Row, Section, agent_label, legend, settings_element, table, today, write_page
from wt_gym.analysis.results import Wind
from wt_gym.analysis.summary import format_estimate, format_value
from wt_gym.base.errors import SimulationError
from wt_gym.base.options import LONGEST, Options, option, option_record
from wt_gym.control.controllers import Name, make_controller
from wt_gym.envs.operation import OWN, simulator_maker
from wt_gym.envs.turbine_env import WindTurbineEnv
from wt_gym.experiment.agents import load_agent, load_model
from wt_gym.experiment.environments import environment_of_training
from wt_gym.experiment.execute import Experiment
from wt_gym.experiment.names import INTERFACE, RESIDUAL_INTERFACE, env_choices_of, is_base_controller, read_name
from wt_gym.experiment.run import LEAST_MEASURED, benchmark_metrics, play, run_controller
from wt_gym.simulation import Fidelity
from wt_gym.simulation.fidelity import fidelity as fidelity_of
from wt_gym.simulation.fidelity import suited_fidelity
from wt_gym.wind import SteadyInflow, TurbulenceBox, TurbulentInflow

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence
    from pathlib import Path

    import xarray as xr

    from wt_gym.envs.episode import Agent
    from wt_gym.experiment.execute import Executor
    from wt_gym.simulation.contract import TurbineSimulator
    from wt_gym.turbines import Turbine
    from wt_gym.wind import Inflow

__all__ = [
    "COLUMNS", "ComparisonConfig", "ControllerRuns", "change", "comparison_table", "half_width", "in_all_winds",
    "inflow_of", "run_cases", "write_comparison",
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
    steady = _steady(turbine, wind, shear_exponent)
    if wind.seed is None:
        return steady
    box = TurbulenceBox.kaimal(
        wind.speed, turbine.hub_height, turbine.rotor_diameter, turbine.turbulence_class, seed=wind.seed,
        turbine_class=turbine.iec_class,
    )  # fmt: skip
    return TurbulentInflow(box, steady)


def _steady(turbine: Turbine, wind: Wind, shear_exponent: float) -> SteadyInflow:
    """Mean wind; refuses a speed without meaning."""
    return SteadyInflow(wind.speed, turbine.hub_height, shear_exponent=shear_exponent)


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
    for wind in winds:
        _steady(turbine, wind, 0.0)
    runs = [] if runs is None else runs
    by_label = {label: ControllerRuns(label, {}, {}) for label in controllers}
    runs += by_label.values()
    experiment = _Comparison(turbine, dict(controllers), config or ComparisonConfig())
    experiment.check(_steady(turbine, winds[0], 0.0))
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

    A change is the mean over the seeds of the relative change in the same wind; from three seeds on with the half width
    of its 95 % interval (Student's t). Duty cycle, torque rate and greatest speed are means, not changes, and so is a
    metric whose reference rounds to zero.
    """
    head = ["wind", "controller", *(name for _, name in COLUMNS)]
    lines = ["| " + " | ".join(head) + " |", "|---" * len(head) + "|"]
    for speed in sorted({wind.speed for wind in runs[0].metrics}):
        for run in runs:
            cells = [_cell(key, run, runs[0], speed) for key, _ in COLUMNS]
            lines.append(f"| {speed:g} | {run.name} | " + " | ".join(cells) + " |")
    return "\n".join(lines)


def change(
    run: ControllerRuns, reference: ControllerRuns, wind_speed: float | None, metric: str
) -> tuple[float, float]:
    """Mean relative change of a metric over the seeds of a wind speed, or over all winds, with half its 95 % interval.

    Returns
    -------
    mean, half_width : float
        NaN where no run, or fewer than three, can be compared, and where no share makes sense
        (`wt_gym.analysis.change.is_relative`).
    """
    values, references = np.array(_pairs(run, reference, wind_speed, metric)).reshape(-1, 2).T
    if values.size == 0 or not is_relative(metric, references):
        return float("nan"), float("nan")
    ratios = relative_change(values, references)
    if ratios.size < LEAST_FOR_INTERVAL:
        return float(ratios.mean()), float("nan")
    return float(ratios.mean()), half_width(ratios)


LEAST_FOR_INTERVAL = 3
"""Seeds from which on a change has an interval."""


def half_width(values: np.ndarray) -> float:
    """Half width of the 95 % interval of a mean, by Student's t; of two values at least."""
    return float(stdtrit(values.size - 1, 0.975) * values.std(ddof=1) / np.sqrt(values.size))


def _pairs(
    run: ControllerRuns, reference: ControllerRuns, wind_speed: float | None, metric: str
) -> list[tuple[float, float]]:
    """Values of a metric in the winds of a speed in which both ran: of the run and of the reference."""
    cases = [c for c in run.metrics if wind_speed in (None, c.speed) and c in reference.metrics]
    return [(run.metrics[c][metric], reference.metrics[c][metric]) for c in cases]


def _cell(key: str, run: ControllerRuns, reference: ControllerRuns, speed: float) -> str:
    """One number as the table shows it."""
    pairs = _pairs(run, reference, speed, key)
    if not pairs:
        return "failed"
    value = float(np.mean([new for new, _ in pairs]))
    match key:
        case "pitch_duty_cycle":
            return f"{value:.3f}"
        case "torque_rate":
            return f"{value / 1e3:.1f} kN m/s"
        case "rotor_speed_max":
            return f"{value * 30 / np.pi:.1f} rpm"
    mean, half = change(run, reference, speed, key)
    if run is reference or np.isnan(mean):
        return f"{value / 1e6:.3f} MW" if key == "mean_power" else f"{value / 1e6:.2f} MN m"
    return f"{100 * mean:+.1f} %" if np.isnan(half) else f"{100 * mean:+.1f} ± {100 * half:.1f} %"


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


class _Compared:
    """Names for the colors."""

    def __init__(self, runs: Sequence[ControllerRuns]):
        self.agents = [run.name for run in runs]


def write_comparison(
    runs: Sequence[ControllerRuns], path: str | Path, turbine: str, settings: Mapping[str, Any]
) -> Path:
    """Write the page.

    Parameters
    ----------
    runs : sequence of ControllerRuns
        In the same winds; the first is the reference.
    path : str or path
        HTML file; its folder is created if missing.
    turbine : str
        Title of the turbine.
    settings : mapping
        With ``duration`` and ``skip`` [s], and what else it was made with.
    """
    cases = runs[0].done
    speeds = sorted({case.speed for case in cases})
    seeds = list(dict.fromkeys(case.seed for case in cases if case.seed is not None))
    marks = [
        f"changes against <b>{escape(runs[0].name)}</b> in the same winds: mean over the seeds, with its 95 % interval"
        f" (Student's t) from {LEAST_FOR_INTERVAL} seeds on",
        "pitch, torque and speed: means",
    ]
    failures = "".join(
        f"<li>{escape(f'{run.name} at {case.speed:g} m/s, seed {case.seed}: {message}')}</li>"
        for run in runs
        for case, message in run.failures.items()
    )
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
            Section("failed", "What failed", f"<ul>{failures}</ul>" if failures else ""),
            Section("method", "Settings", settings_element(settings)),
        ],
    )  # fmt: skip


def _result(runs: Sequence[ControllerRuns]) -> str:
    """The controller with the least fatigue over all winds, and what it changes."""
    reference, *others = runs
    if not others:
        return f"{reference.name} alone, in {len(reference.metrics)} winds."
    changes = {run.name: {key: change(run, reference, None, key)[0] for key in _LOADS} for run in others if run.metrics}
    least = {name: float(np.mean(list(found.values()))) for name, found in changes.items()}
    known = {name: value for name, value in least.items() if not math.isnan(value)}
    if not known:
        return f"No wind in which {reference.name} and another controller ran."
    best = min(known, key=known.__getitem__)
    if known[best] >= 0.0:
        return f"No controller has less fatigue than {reference.name} in the mean of blade and tower."
    words = ", ".join(f"{name} by {_percent(changes[best][key])}" for key, name in _LOADS.items())
    power = change(next(run for run in others if run.name == best), reference, None, "mean_power")[0]
    more = "" if math.isnan(power) else f", and power by {_percent(power)}"
    winds = f"mean over {len(reference.metrics)} winds"
    return f"Least fatigue: {best} changes {words}{more} against {reference.name}, {winds}."


def _percent(value: float) -> str:
    return f"{100.0 * value:+.1f}\u00a0%".replace("-", "\u2212")


def _blocks(runs: Sequence[ControllerRuns], speeds: Sequence[float]) -> str:
    """A block a wind speed, a row a controller."""
    styles = agent_styles(_Compared(runs))
    rows = []
    for speed in speeds:
        rows.append(Row(f"{speed:g} m/s"))
        rows += [
            Row(agent_label(run.name, styles[run.name]), [_html_cell(key, run, runs[0], speed) for key, _ in COLUMNS])
            for run in runs
        ]
    return table(["Controller", *(_HEADS[key] for key, _ in COLUMNS)], rows)


def _html_cell(key: str, run: ControllerRuns, reference: ControllerRuns, speed: float) -> str:
    """Value of the reference or of a metric that is shown as such, else a change with its mark."""
    values = [m[key] for c, m in run.metrics.items() if c.speed == speed]
    if not values:
        return "failed"
    mean, half = change(run, reference, speed, key)
    if run is reference or key in _VALUES or math.isnan(mean):
        return f"{format_value(key, float(np.mean(values)))} {METRICS[key].unit}"
    found = Estimate(mean, mean - half, mean + half, True, len(values))
    value, _, interval = format_estimate(key, found).partition(" [")
    kind = "none" if value == "=" else found.kind(key)
    return f"<span class='diff main {kind}'>{value}{f'<small>[{interval}</small>' if interval else ''}</span>"
