"""Controllers compared in the same winds, each against the first."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.special import stdtrit

from wt_gym.analysis.metrics import idle_time
from wt_gym.analysis.statistics import is_relative, relative_change
from wt_gym.base.errors import SimulationError
from wt_gym.base.options import check_duration
from wt_gym.benchmark.run import INTERFACE, benchmark_metrics
from wt_gym.control.controllers import Name, make_controller
from wt_gym.envs.operation import OWN, simulator_maker
from wt_gym.envs.turbine_env import WindTurbineEnv
from wt_gym.experiment.names import RESIDUAL_INTERFACE, env_choices_of, is_base_controller, read_name
from wt_gym.experiment.pool import load_agent, load_model
from wt_gym.experiment.trained_environment import environment_of_training
from wt_gym.runs.executors import SerialExecutor
from wt_gym.runs.playing import play, run_controller
from wt_gym.runs.table import make_runs
from wt_gym.simulation.fidelity import fidelity as fidelity_of
from wt_gym.simulation.fidelity import suited_fidelity
from wt_gym.wind import SteadyInflow, TurbulenceBox, TurbulentInflow

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping

    import xarray as xr

    from wt_gym.envs.episode import Agent
    from wt_gym.runs.executors import Executor
    from wt_gym.simulation import Fidelity
    from wt_gym.simulation.contract import TurbineSimulator
    from wt_gym.turbines import Turbine
    from wt_gym.wind import Inflow

__all__ = [
    "COLUMNS",
    "LEAST_FOR_INTERVAL",
    "LEAST_MEASURED",
    "RESIDUAL_INTERFACE",
    "Case",
    "ControllerRuns",
    "change",
    "check_times",
    "half_width",
    "in_all_winds",
    "inflow_of",
    "run_agent",
    "run_cases",
    "table",
]

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

LEAST_MEASURED = 2.0
"""Shortest time that metrics are taken of, and longest interval of a controller [s]."""


@dataclass(frozen=True)
class Case:
    """A wind: mean speed [m/s] and turbulence seed (None: steady)."""

    wind_speed: float
    seed: int | None = None

    @property
    def label(self) -> str:
        """Name for sentences."""
        return f"{self.wind_speed:g} m/s" + ("" if self.seed is None else f", seed {self.seed}")


@dataclass
class ControllerRuns:
    """Metrics of one controller by case; a run that failed has none, its message stands in ``failures``.

    ``idle`` has the time in which the turbine made no power without a reason [s], see `wt_gym.envs.terminations`.
    """

    name: str
    metrics: dict[Case, dict[str, float]]
    failures: dict[Case, str]
    idle: dict[Case, float] = field(default_factory=dict)

    @property
    def done(self) -> tuple[Case, ...]:
        """Cases that were run, whether they failed or not."""
        return (*self.metrics, *self.failures)


def inflow_of(turbine: Turbine, case: Case, shear_exponent: float = 0.2) -> Inflow:
    """Wind of a case: sheared, with Kaimal turbulence of the turbine's class if there is a seed."""
    steady = _steady(turbine, case, shear_exponent)
    if case.seed is None:
        return steady
    box = TurbulenceBox.kaimal(
        case.wind_speed, turbine.hub_height, turbine.rotor_diameter, turbine.turbulence_class, seed=case.seed,
        turbine_class=turbine.iec_class,
    )  # fmt: skip
    return TurbulentInflow(box, steady)


def _steady(turbine: Turbine, case: Case, shear_exponent: float) -> SteadyInflow:
    """Mean wind of a case; refuses a speed without meaning."""
    return SteadyInflow(case.wind_speed, turbine.hub_height, shear_exponent=shear_exponent)


def check_times(duration: float, skip: float, control_dt: float | None = None) -> None:
    """Refuse times of a comparison that have no meaning.

    Parameters
    ----------
    duration, skip : float
        Measured time and time before it [s].
    control_dt : float, optional
        Interval of the controllers [s].

    Raises
    ------
    ValueError
    """
    check_duration("the duration", duration, LEAST_MEASURED)
    check_duration("the skipped start", skip)
    if control_dt is not None and not 0.0 < control_dt <= LEAST_MEASURED:
        raise ValueError(f"the control step must be above 0 and at most {LEAST_MEASURED:g} s, got {control_dt!r}")


def run_cases(
    turbine: Turbine,
    controllers: Mapping[str, tuple[str, dict[str, Any]]],
    cases: Iterable[Case],
    duration: float,
    skip: float = 30.0,
    fidelity: str | Fidelity | None = None,
    control_dt: float | None = None,
    progress: Callable[[str, Case], None] | None = None,
    runs: list[ControllerRuns] | None = None,
    simulator: Any = OWN,
    executor: Executor | None = None,
) -> list[ControllerRuns]:
    """Run every controller in every wind.

    Where one is an agent with ``predict``, all run in environments, controllers as base controllers of zero actions:
    so that all start alike.

    Parameters
    ----------
    turbine : Turbine
    controllers : mapping
        From a label to name and parameters: of a controller as `make_controller` takes them, or of any agent that
        `wt_gym.experiment.names.read_name` knows, which runs in an environment with the same wind.
    cases : iterable of Case
    duration, skip : float
        Measured time and time before it [s].
    fidelity : str or Fidelity, optional
        As of the simulator.
    control_dt : float, optional
        [s]; by default the step of the simulator.
    progress : callable, optional
        Called with label and case after every run.
    runs : list of ControllerRuns, optional
        That get the metrics, by default new ones. The caller's own have what was done where the series is stopped.
    simulator : str, mapping or callable
        What simulates controllers and agents, as the argument of the environment.
    executor : Executor, optional
        Of `wt_gym.runs.executors`, entered: does the runs, by default one after another. The numbers are the same.

    Raises
    ------
    ValueError
        If a time is out of range.
        If a controller or agent cannot be made; nothing has run then.
    wt_gym.base.errors.InflowError
        If a wind cannot be made; nothing has run then.
    """
    cases = list(cases)
    check_times(duration, skip, control_dt)
    for case in cases:
        _steady(turbine, case, 0.0)
    runs = [] if runs is None else runs
    own = {label: ControllerRuns(label, {}, {}) for label in controllers}
    runs += own.values()
    executor = SerialExecutor() if executor is None else executor

    def told(job: tuple[str, Case], outcome: tuple[dict[str, float] | None, str | None, float], _: int) -> None:
        (label, case), (metrics, failure, idle) = job, outcome
        if metrics is not None:
            own[label].metrics[case], own[label].idle[case] = metrics, idle
        else:
            own[label].failures[case] = str(failure)
        if progress is not None:
            progress(label, case)

    fidelity = suited_fidelity(turbine) if fidelity is None else fidelity
    in_environments = not all(is_base_controller(choice) for choice, _ in controllers.values())
    run = _Runner(turbine, dict(controllers), in_environments, duration, skip, fidelity, control_dt, simulator)
    run.check(_steady(turbine, cases[0], 0.0))
    make_runs(
        [(label, case) for case in cases for label in controllers], partial(executor.results, run),
        tally=executor.tally, label=lambda job: f"{job[0]} at {job[1].label}", told=told,
    )  # fmt: skip
    return runs


@dataclass
class _Runner:
    """Does one run of a comparison; simulator and wind stay from one to the next, and go to no other process."""

    turbine: Turbine
    controllers: dict[str, tuple[str, dict[str, Any]]]
    in_environments: bool
    duration: float
    skip: float
    fidelity: Any
    control_dt: float | None
    simulator: Any
    _running: TurbineSimulator | None = None
    _wind: tuple[Case, Inflow] | None = None

    def __getstate__(self) -> dict[str, Any]:
        return self.__dict__ | {"_running": None, "_wind": None}

    def __call__(self, job: tuple[str, Case]) -> tuple[dict[str, float] | None, str | None, float]:
        """Metrics of a controller in a wind, or why there are none, and `idle_time` [s]."""
        (label, case), whole = job, self.skip + self.duration
        choice, parameters = self.controllers[label]
        try:
            if self.in_environments:
                agent = Name(read_name(choice).kind, choice, parameters)
                data = run_agent(
                    self.turbine, agent, self._inflow(case), whole, self.fidelity, self.control_dt, self.simulator
                )
            else:
                controller = make_controller(choice, self.turbine, **parameters)
                data = run_controller(self._placed(case), controller, whole, self.control_dt, name=label).to_dataset()
            return benchmark_metrics(data, self.turbine, self.skip), None, idle_time(data)
        except SimulationError as error:
            return None, str(error), 0.0

    def check(self, inflow: Inflow) -> None:
        """Make every controller or agent once, in any wind: what cannot be made is refused before the first run."""
        for label, (choice, parameters) in self.controllers.items():
            try:
                if not self.in_environments:
                    make_controller(choice, self.turbine, **parameters)
                    continue
                name = Name(read_name(choice).kind, choice, parameters)
                environment_and_agent(self.turbine, name, inflow, self.fidelity, self.control_dt, self.simulator)[
                    0
                ].close()
            except (ValueError, TypeError, OSError) as error:
                raise ValueError(f"{label}: {error}") from error

    def _inflow(self, case: Case) -> Inflow:
        if self._wind is None or self._wind[0] != case:
            self._wind = case, inflow_of(self.turbine, case)
        return self._wind[1]

    def _placed(self, case: Case) -> TurbineSimulator:
        """The simulator in the wind of a case."""
        inflow = self._inflow(case)
        if self._running is None:
            whole = self.skip + self.duration
            maker = simulator_maker(self.simulator, self.turbine, pictured=False, longest=lambda: whole)
            self._running = maker(self.turbine, inflow, self.fidelity)
        self._running.inflow = inflow
        return self._running


def run_agent(
    turbine: Turbine,
    name: Name,
    inflow: Inflow,
    duration: float,
    fidelity: str | Fidelity | None = None,
    control_dt: float | None = None,
    simulator: Any = OWN,
) -> xr.Dataset:
    """Simulate under an agent in an environment: that of its training, or the one that it chooses.

    A controller is the base controller of zero actions, and so are words without an environment of their own.

    Parameters
    ----------
    turbine : Turbine
    name : Name
        Of the agent.
    inflow : Inflow
    duration : float
        [s].
    fidelity : str or Fidelity, optional
        As of the simulator.
    control_dt : float, optional
        [s]; by default the step of the simulator, at which controllers are recorded too: what is sampled less often
        has smaller loads. An agent that was trained with a longer step holds its actions.
    simulator : str, mapping or callable
        As the argument of the environment.

    Returns
    -------
    xarray.Dataset
        Signals at the start and after every control step.

    Raises
    ------
    wt_gym.base.errors.SimulationError
        If the episode ends before its time.
    ValueError
        If the agent does not fit its environment.
    """
    env, agent = environment_and_agent(turbine, name, inflow, fidelity, control_dt, simulator)
    try:
        episode = play(env, agent, seed=0, options={"azimuth": 0.0}, duration=duration)
        if episode.ending != "time":
            raise SimulationError(f"ended after {episode.time:g} s: {episode.failure or episode.ending}")
        return episode.data
    finally:
        env.close()


def environment_and_agent(
    turbine: Turbine,
    name: Name,
    inflow: Inflow,
    fidelity: str | Fidelity | None = None,
    control_dt: float | None = None,
    simulator: Any = OWN,
) -> tuple[WindTurbineEnv, Agent]:
    """Environment of `run_agent` and the agent in it; parameters as there."""
    found = load_model(name) if name.kind == "trained" else None
    record = (found.record if found is not None else None) or {}
    interface = environment_of_training(record, INTERFACE) | env_choices_of(name.text)
    if name.kind == "word" or is_base_controller(name.text):
        interface |= RESIDUAL_INTERFACE
    if is_base_controller(name.text):
        interface["controller"] = partial(make_controller, name.text)
    fidelity = suited_fidelity(turbine) if fidelity is None else fidelity
    step = fidelity_of(fidelity).step_for(turbine.drivetrain.rated_rotor_speed)
    interface["control_dt"] = control_dt or interface.get("control_dt") or step
    interface |= {"inflow": inflow, "wind_speed": None, "start": "steady", "simulator": simulator}
    env = WindTurbineEnv(turbine, fidelity=fidelity, **interface)
    try:
        agent = load_agent(name.text, env.layout, env) if found is None else found
        if found is not None:
            found.enter(env.layout)
    except BaseException:
        env.close()
        raise
    return env, agent


def in_all_winds(runs: list[ControllerRuns]) -> list[ControllerRuns]:
    """Give the same without the winds in which only some have run, because the series was stopped there."""
    done = [case for case in runs[0].done if all(case in run.done for run in runs)]
    return [
        ControllerRuns(
            run.name,
            {case: run.metrics[case] for case in done if case in run.metrics},
            {case: run.failures[case] for case in done if case in run.failures},
            run.idle,
        )
        for run in runs
    ]


def table(runs: list[ControllerRuns]) -> str:
    """Markdown by wind speed: the first controller's means over the seeds, and the changes of the others against it.

    A change is the mean over the seeds of the relative change in the same wind; from three seeds on with the half width
    of its 95 % interval (Student's t). Duty cycle, torque rate and greatest speed are means, not changes, and so is a
    metric whose reference rounds to zero.
    """
    head = ["wind", "controller", *(name for _, name in COLUMNS)]
    lines = ["| " + " | ".join(head) + " |", "|---" * len(head) + "|"]
    for speed in sorted({case.wind_speed for case in runs[0].metrics}):
        for run in runs:
            cells = [_cell(key, run, runs[0], speed) for key, _ in COLUMNS]
            lines.append(f"| {speed:g} | {run.name} | " + " | ".join(cells) + " |")
    return "\n".join(lines)


def change(run: ControllerRuns, reference: ControllerRuns, wind_speed: float, metric: str) -> tuple[float, float]:
    """Mean relative change of a metric over the seeds of a wind speed, and the half width of its 95 % interval.

    Returns
    -------
    mean, half_width : float
        NaN where no run, or fewer than three, can be compared, and where no share makes sense
        (`wt_gym.analysis.statistics.is_relative`).
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


def _pairs(run: ControllerRuns, reference: ControllerRuns, wind_speed: float, metric: str) -> list[tuple[float, float]]:
    """Values of a metric in the winds of a speed in which both ran: of the run and of the reference."""
    cases = [c for c in run.metrics if c.wind_speed == wind_speed and c in reference.metrics]
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
