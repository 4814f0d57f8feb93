"""Load cases of several agents: a file a run, which is not made again where it is there already."""

from __future__ import annotations

import json
import time
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import gymnasium as gym
import numpy as np

import wt_gym
from wt_gym.analysis.statistics import WindClimate
from wt_gym.base.files import json_values, require_writable, write_text_whole
from wt_gym.benchmark.run import benchmark_fingerprint
from wt_gym.envs.operation import OWN
from wt_gym.envs.turbine_env import turbine_env_of
from wt_gym.envs.wind_sampler import TURBULENCE
from wt_gym.experiment.loadcases.cases import CASES, SKIP, Plan, plan_of
from wt_gym.experiment.loadcases.results import PARKED, CaseRun, LoadCaseResults
from wt_gym.experiment.loadcases.run import run_agent, run_parked
from wt_gym.experiment.names import fingerprint
from wt_gym.experiment.pool import AgentPool
from wt_gym.runs.definition import RunDefinition
from wt_gym.runs.executors import SerialExecutor
from wt_gym.runs.progress import ProgressLine, clock
from wt_gym.runs.store import RUNS_FOLDER, RunStore
from wt_gym.runs.table import make_runs
from wt_gym.tasks import DEFAULT_ENV
from wt_gym.wind.iec import AVERAGE_OVER_REFERENCE_SPEED, REFERENCE_SPEED

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence
    from typing import Self

    from wt_gym.experiment.loadcases.cases import Condition
    from wt_gym.runs.executors import Executor
    from wt_gym.turbines import Turbine

__all__ = ["REPORT_FILE", "RUNS_FOLDER", "TABLE_FILE", "LoadCaseConfig", "run_load_cases"]

REPORT_FILE, TABLE_FILE = "report.html", "loadcases.json"
_ANY_SPEED = AVERAGE_OVER_REFERENCE_SPEED * REFERENCE_SPEED["II"]  # to look at the exponent of a climate alone
_FORMAT = 2
"""Raise when files of runs mean something else."""
# They belong to what the load cases decide: when and in what wind a run ends.
_OURS = (
    "episode_length", "max_episode_steps", "inflow", "wind_speed", "wind_seeds", "turbulence_model", "turbulence",
)  # fmt: skip


@dataclass(frozen=True)
class LoadCaseConfig:
    """Which cases, and in which environment.

    Attributes
    ----------
    env_id : str
        Actions and observations; the wind is that of the cases.
    env_kwargs : dict
        More arguments of the environment.
    cases : tuple of str
        Numbers out of `wt_gym.experiment.loadcases.cases.CASES`.
    quick : bool
        Fewer and shorter runs, see `wt_gym.experiment.loadcases.cases.plan_of`.
    plan : Plan, optional
        How much is run, in place of what ``quick`` says.
    turbulence : {"kaimal", "mann"}
        Spectra of the turbulent winds.
    iec_class : str, optional
        Of the wind climate, by default the turbine's.
    mean_wind_speed : float, optional
        Annual mean in place of the class's [m/s].
    weibull_shape : float

    Raises
    ------
    ValueError
        If a case or turbulence is unknown, no case is given, or the arguments of the environment hold what the cases
        decide, or no turbine could operate in the wind climate.
    """

    env_id: str = DEFAULT_ENV
    env_kwargs: dict[str, Any] = field(default_factory=dict)
    cases: tuple[str, ...] = tuple(CASES)
    quick: bool = False
    plan: Plan | None = None
    turbulence: str = "kaimal"
    iec_class: str | None = None
    mean_wind_speed: float | None = None
    weibull_shape: float = 2.0

    def __post_init__(self) -> None:
        unknown = [case for case in self.cases if case not in CASES]
        if unknown or not self.cases:
            raise ValueError(f"load cases must be some of {', '.join(CASES)}, got {', '.join(unknown) or 'none'}")
        if self.turbulence not in TURBULENCE:
            raise ValueError(f"turbulence must be one of {TURBULENCE}, got {self.turbulence!r}")
        for name in _OURS:
            if name in self.env_kwargs:
                raise ValueError(f"{name} follows from the load cases; leave it out of the environment's arguments")
        WindClimate(_ANY_SPEED if self.mean_wind_speed is None else self.mean_wind_speed, self.weibull_shape)


class _LoadCaseFolder(RunStore):
    """Runs on disk; a context that holds the folder for this process."""

    def __enter__(self) -> Self:
        super().__enter__()
        try:
            require_writable(self.path / RUNS_FOLDER)
        except OSError:
            self.__exit__(None)
            raise
        return self


def run_load_cases(
    agents: Mapping[str, str],
    config: LoadCaseConfig,
    folder: str | Path,
    *,
    allow_other_environment: bool = False,
    executor: Executor | None = None,
    progress: bool = True,
) -> LoadCaseResults:
    """Run all agents in all cases.

    Parameters
    ----------
    agents : mapping
        Name to word or path for `wt_gym.experiment.pool.load_agent`.
    config : LoadCaseConfig
    folder : str or path
        Keeps each run as soon as it is made, under the hash of all it depends on: agent (a model by its SHA-256 sums),
        condition, environment and code. What is there is not made again; what belongs to others stays.
    allow_other_environment : bool
    executor : Executor, optional
        Both as of `wt_gym.experiment.evaluation.evaluate`; the files are the same.
    progress : bool
        Show progress on standard error.

    Returns
    -------
    LoadCaseResults

    Raises
    ------
    ValueError
        If the folder is in use, a file in it is damaged, a model does not fit the environment, there is no agent, or an
        agent has the name `PARKED`.
    OSError
        If the folder cannot be written.
    ChildProcessError
        If runs were lost, because the processes or machines that did them ended again and again.
    wt_gym.base.errors.InflowError
        If the turbine has no class of IEC 61400-1.
    """
    executor = SerialExecutor() if executor is None else executor
    if not agents or PARKED in agents:
        raise ValueError(
            f"agents of load cases must be at least one, named otherwise than {PARKED!r}; got "
            f"{', '.join(agents) or 'none'}"
        )
    where = config.env_id, config.env_kwargs
    with (
        _LoadCaseFolder(folder, "loadcases") as store,
        AgentPool(agents, *where, as_given=allow_other_environment) as pool,
    ):
        plain = pool.env
        turbine = turbine_env_of(plain).turbine
        climate = _climate(turbine, config)  # which is refused before any run, if at all
        plan = config.plan or plan_of(turbine, config.quick)
        cases = tuple(case for case in CASES if case in config.cases)
        # runs of several cases are the same: they stand once, by what they are
        jobs = [(case, job) for case in cases for job in _jobs(agents, _conditions(case, turbine, plan, config))]
        if config.env_kwargs.get("simulator", OWN) != OWN and any(name == PARKED for _, (name, _) in jobs):
            parked = [case for case, (name, _) in jobs if name == PARKED]
            raise ValueError(
                f"cases with another simulator than {OWN!r} must be without a parked turbine, got "
                f"{', '.join(dict.fromkeys(parked))}"
            )
        shown = _Progress(progress)
        results = make_runs(
            [job for _, job in jobs], partial(pool.results, _play, executor),
            tally=executor.tally, store=store, define=_definitions(agents, config, plain), label=_label,
            begin=shown.begin, told=shown.done,
        )  # fmt: skip
        runs: dict[tuple[str, str], list[CaseRun]] = {}
        for (case, (name, condition)), result in zip(jobs, results, strict=True):
            runs.setdefault((case, name), []).append(CaseRun(name, condition, result))
        table = LoadCaseResults(turbine.title, cases, tuple(agents), runs, climate, _settings(config, plan, plain))
        write_text_whole(store.path / TABLE_FILE, json.dumps(table.to_json(), indent=1) + "\n")
    return table


def _conditions(case: str, turbine: Turbine, plan: Plan, config: LoadCaseConfig) -> list[Condition]:
    """Runs of a case, with the chosen turbulence where there is any."""
    conditions = CASES[case].conditions(turbine, plan)
    return [replace(c, turbulence=config.turbulence) if c.seed is not None else c for c in conditions]


def _jobs(agents: Mapping[str, str], conditions: Sequence[Condition]) -> Iterator[tuple[str, Condition]]:
    """Who runs in which condition; a parked turbine is the same for all."""
    for condition in conditions:
        for name in (PARKED,) if condition.parked else agents:
            yield name, condition


def _definitions(
    agents: Mapping[str, str], config: LoadCaseConfig, env: gym.Env
) -> Callable[[tuple[str, Condition]], dict[str, Any]]:
    """Give the function that says what a run depends on."""
    code = benchmark_fingerprint(turbine_env_of(env).turbine, turbine_env_of(env).fidelity)
    known = {name: fingerprint(choice) for name, choice in agents.items()}
    for print_ in known.values():
        if "sha256" in print_:
            del print_["choice"]  # a model is what it is wherever it lies

    def definition(job: tuple[str, Condition]) -> dict[str, Any]:
        name, condition = job
        given = condition.to_json()
        wind = {key: given[key] for key in ("wind", "speed", "seed", "direction", "turbulence", "label")}
        common = RunDefinition(
            wind, condition.duration, SKIP, code, faults=given["faults"], azimuth=condition.azimuth,
            more={"format": _FORMAT},
        )  # fmt: skip
        if name == PARKED:
            return common.to_json()
        return replace(common, agent=known[name], env_id=config.env_id, env_kwargs=config.env_kwargs).to_json()

    return definition


def _play(pool: AgentPool, job: tuple[str, Condition]) -> dict[str, Any]:
    """Make a run."""
    name, condition = job
    if name == PARKED:
        env = turbine_env_of(pool.env)
        return run_parked(env.turbine, env.fidelity, condition)
    return run_agent(*pool[name], condition)


def _label(job: tuple[str, Condition]) -> str:
    """Name of a run."""
    return f"{job[0]} in {job[1].name}"


class _Progress:
    """Says how far it is."""

    def __init__(self, shown: bool):
        self._line, self._total, self._simulated, self._start = ProgressLine(shown), 0, 0.0, time.monotonic()

    def begin(self, total: int, there: int) -> None:
        """Take the number of runs, and say how many are there."""
        self._total = total
        if there:
            self._line.show(f"{there} of {total} runs are there already", final=True)

    def done(self, job: tuple[str, Condition], result: dict[str, Any], there: int) -> None:
        """Count a run."""
        self._simulated += result["time"]
        elapsed = time.monotonic() - self._start
        text = (
            f"{there} of {self._total} runs, {_label(job)}: {result['ending']}; {self._simulated:.0f} s simulated in "
            f"{clock(elapsed)} min"
        )
        self._line.show(text, final=there == self._total)


def _climate(turbine: Turbine, config: LoadCaseConfig) -> WindClimate | None:
    """Wind climate, None where the turbine's class has none."""
    limits = {"shape": config.weibull_shape, "cut_in": turbine.cut_in, "cut_out": turbine.cut_out}
    if config.mean_wind_speed is not None:
        return WindClimate(config.mean_wind_speed, **limits)
    chosen = config.iec_class or turbine.iec_class
    return WindClimate.of_class(chosen, **limits) if chosen in REFERENCE_SPEED else None


def _settings(config: LoadCaseConfig, plan: Plan, env: gym.Env) -> dict[str, Any]:
    """How it was made, as JSON values."""
    plain = turbine_env_of(env)
    settings = {
        "env_id": config.env_id, "env_kwargs": config.env_kwargs, "quick": config.quick, "plan": vars(plan),
        "turbulence": config.turbulence,
        "fidelity": plain.fidelity if isinstance(plain.fidelity, str) else plain.fidelity.name,
        "control_dt": plain.control_dt,
        "wt_gym": wt_gym.__version__, "numpy": np.__version__, "gymnasium": gym.__version__,
    }  # fmt: skip
    return json_values(settings)
