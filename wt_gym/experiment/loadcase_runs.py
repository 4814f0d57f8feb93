"""Design load cases of several agents: runs, stored a file each, and the loads that they amount to."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any, cast

import gymnasium as gym
import numpy as np

import wt_gym
from wt_gym.analysis.metrics import idle_time, run_metrics
from wt_gym.analysis.statistics import LIFETIME_EXPONENTS, WindClimate, lifetime_load, wind_weights
from wt_gym.base.errors import SimulationError
from wt_gym.base.files import json_values, require_writable, write_text_whole
from wt_gym.base.options import Options, option, option_record
from wt_gym.control import Demand
from wt_gym.envs.episode import Agent
from wt_gym.envs.operation import OWN
from wt_gym.envs.turbine_env import turbine_env_of
from wt_gym.envs.wind_sampler import TURBULENCE
from wt_gym.experiment.environments import AgentExperiment, with_common_step
from wt_gym.experiment.execute import Executor
from wt_gym.experiment.loadcases import (
    CASES,
    DEFLECTION_FACTOR,
    EVENT,
    EXTRAPOLATION,
    SKIP,
    DesignSituation,
    Plan,
    inflow_of,
    plan_of,
)
from wt_gym.experiment.names import fingerprint
from wt_gym.experiment.options import ClimateOptions
from wt_gym.experiment.run import LEAST_MEASURED, benchmark_fingerprint, play, run_controller
from wt_gym.experiment.store import RUNS_FOLDER, RunStore, run_definition
from wt_gym.simulation import Fidelity, Recorder, Simulator
from wt_gym.simulation.drivetrain.faults import FEATHER, ShutDown
from wt_gym.tasks import DEFAULT_ENV
from wt_gym.turbines import Turbine
from wt_gym.turbines.variants import unloaded_clearance

if TYPE_CHECKING:
    import xarray as xr

__all__ = [
    "CLEARANCE", "COMPLETE", "EXTREMES", "PARKED", "REPORT_FILE", "SPEED", "TABLE_FILE", "CaseRun",
    "LoadCaseConfig", "LoadCaseResults", "Value", "run_agent", "run_load_cases", "run_parked",
]  # fmt: skip

EXTREMES = ("blade_flap_max", "blade_edge_max", "tower_base_max", "rotor_speed_max", "tip_clearance_min")
"""What is kept of a run: largest sizes of moments [N m], largest rotor speed [rad/s], smallest clearance [m]."""
_FATIGUE = ("blade_flap_del", "blade_edge_del", "tower_fore_aft_del", "tower_side_side_del")
TRACES = ("wind_x", "rotor_speed", "generator_power", "pitch_1", "root_flap_moment_1", "tower_base_fore_aft_moment")
"""Signals that are kept of a transient, from 10 s before it on."""
COMPLETE = ("time", "stopped")
"""Ends of runs that went as planned: their time is over, or the rotor has come to rest after a shut-down."""
_SEED = 2**40 + 2**33
"""Seeds of the environment, for noise: beyond those of any training and evaluation."""
_BEFORE_EVENT = 10.0
_PARKED_STEP = 0.2


def run_agent(env: gym.Env, agent: Agent, situation: DesignSituation) -> dict[str, Any]:
    """Run an agent in an environment without a limit of time; a failed simulation is a result as any other.

    Returns
    -------
    dict
        JSON values: ``ending`` ("time", "stopped", or why the episode was terminated), ``failure`` (message or None),
        ``time`` [s], ``idle_time`` (`wt_gym.envs.terminations.IdleClock.total`) [s], ``extremes`` (`EXTREMES`) and
        ``fatigue`` after the skipped start, None where there was nothing to measure, ``unloaded_clearance`` [m], and
        ``trace``: signals of a transient.
    """
    plain = turbine_env_of(env)
    options = {
        "inflow": inflow_of(situation, plain.turbine), "faults": situation.faults,
        "azimuth": math.radians(situation.azimuth),
    }  # fmt: skip
    seed = _SEED + (situation.seed or 0)
    try:
        found = play(env, agent, seed=seed, options=options, duration=situation.duration)
    except SimulationError as error:
        return _nothing(str(error))
    ending, time = found.ending, plain.signals["time"]
    if ending == "standstill" and any(isinstance(f, ShutDown) and time > f.time for f in situation.faults):
        ending = "stopped"
    return _result(found.data, plain.turbine, situation, ending, found.failure)


def run_parked(turbine: Turbine, fidelity: str | Fidelity, situation: DesignSituation) -> dict[str, Any]:
    """Run a turbine that idles with feathered blades, from rest; as `run_agent`, without an agent."""
    simulator = Simulator(turbine, inflow_of(situation, turbine), fidelity)
    step = simulator.time_step * max(1, round(_PARKED_STEP / simulator.time_step))
    pitch, recorder = min(FEATHER, turbine.pitch.max_pitch), Recorder(simulator)
    rest = {
        "rotor_speed": 0.0, "pitch": pitch, "azimuth": math.radians(situation.azimuth), "generator_torque": 0.0,
    }  # fmt: skip
    ending, failure = "time", None
    try:
        still = Demand(np.full(turbine.n_blades, pitch), 0.0, 0.0)
        feathered = SimpleNamespace(channels=(), start=lambda *_: None, step=lambda *_: still)
        run_controller(simulator, feathered, situation.duration, step, recorder=recorder, start=rest)
    except SimulationError as error:
        if not len(recorder):
            return _nothing(str(error))
        ending, failure = "failure", str(error)
    return _result(recorder.to_dataset(), turbine, situation, ending, failure)


def _nothing(failure: str | None) -> dict[str, Any]:
    """Result of a run that could not start."""
    return {
        "ending": "failure", "failure": failure, "time": 0.0, "extremes": None, "fatigue": None,
        "idle_time": 0.0, "unloaded_clearance": None, "trace": None,
    }  # fmt: skip


def _result(
    data: xr.Dataset, turbine: Turbine, situation: DesignSituation, ending: str, failure: str | None
) -> dict[str, Any]:
    """What is kept of a run."""
    time = data["time"].values
    result = _nothing(failure) | {
        "ending": ending,
        "time": float(time[-1]),
        "idle_time": idle_time(data),
        "unloaded_clearance": unloaded_clearance(turbine),
    }
    if time[-1] >= SKIP + LEAST_MEASURED:
        metrics = run_metrics(data.isel(time=slice(1, None)), turbine, SKIP)
        edge = [np.abs(data[f"root_edge_moment_{b + 1}"].values[time >= SKIP]).max() for b in range(turbine.n_blades)]
        metrics["blade_edge_max"] = float(max(edge))
        result |= {
            "extremes": {name: metrics[name] for name in EXTREMES},
            "fatigue": {name: metrics[name] for name in _FATIGUE},
        }
    if situation.seed is None:
        kept = time >= EVENT - _BEFORE_EVENT
        result["trace"] = {
            name: [float(f"{value:.5g}") for value in values[kept]]
            for name, values in (("time", time), *((name, data[name].values) for name in TRACES))
        }
    return result


# ---- results ----

PARKED = "no controller"
"""Name in place of an agent's where nobody controls."""
CLEARANCE, SPEED = "tip_clearance_min", "rotor_speed_max"
_EXTRAPOLATED = ("blade_flap_max", "blade_edge_max", CLEARANCE)


@dataclass(frozen=True)
class CaseRun:
    """A run and what came of it."""

    agent: str
    situation: DesignSituation
    result: dict[str, Any]  #: as `run_agent` gives it

    @property
    def complete(self) -> bool:
        """Whether it went as planned."""
        return self.result["ending"] in COMPLETE


@dataclass(frozen=True)
class Value:
    """An extreme of a case."""

    characteristic: float  #: without the factors
    design: float  #: with them
    where: str  #: the situation that is worst


@dataclass(frozen=True)
class LoadCaseResults:
    """Runs of several agents in the same cases."""

    turbine: str
    cases: tuple[str, ...]  #: numbers of the cases
    agents: tuple[str, ...]  #: in the order given, without `PARKED`
    runs: dict[tuple[str, str], list[CaseRun]]  #: runs by case and agent; those of a parked turbine under `PARKED`
    climate: WindClimate | None  #: how often each wind blows; None where the turbine has no class
    settings: dict[str, Any]  #: how it was made, JSON values

    def rows(self) -> list[tuple[str, str]]:
        """Case and agent of each row of a table."""
        names = (*self.agents, PARKED)
        return [(case, agent) for case in self.cases for agent in names if (case, agent) in self.runs]

    def survived(self, case: str, agent: str) -> tuple[int, int]:
        """How many runs went as planned, and how many there are."""
        runs = self.runs[case, agent]
        return sum(run.complete for run in runs), len(runs)

    def failures(self, case: str, agent: str) -> dict[str, list[CaseRun]]:
        """Runs that did not go as planned, by how they ended."""
        found: dict[str, list[CaseRun]] = {}
        for run in self.runs[case, agent]:
            if not run.complete:
                found.setdefault(run.result["ending"], []).append(run)
        return found

    def value(self, case: str, agent: str, key: str) -> Value | None:
        """Extreme (`EXTREMES`) of a case with and without the factors.

        A load is multiplied by γ_f (in DLC 1.1 after its extrapolation), the rotor speed by nothing. Of the clearance
        c the deflection from the unloaded clearance c₀ counts: c₀ − γ_f γ_m (c₀ − c). None where fatigue counts,
        nothing was measured, or the case says nothing about the quantity: loads other than those of the blades where
        they are extrapolated, and the clearance of a parked rotor.
        """
        kind = CASES[case]
        worst = self._worst(case, agent, key)
        if kind.fatigue or worst is None:
            return None
        characteristic, where = worst
        if key == SPEED:
            return Value(characteristic, characteristic, where)
        if (kind.extrapolated and key not in _EXTRAPOLATED) or (key == CLEARANCE and agent == PARKED):
            return None
        factor = cast(float, kind.factor) * (EXTRAPOLATION if kind.extrapolated else 1.0)
        if key != CLEARANCE:
            return Value(characteristic, factor * characteristic, where)
        unloaded = max(run.result["unloaded_clearance"] or -math.inf for run in self.runs[case, agent])
        deflection = unloaded - characteristic
        return Value(characteristic, unloaded - factor * DEFLECTION_FACTOR * deflection, where)

    def _worst(self, case: str, agent: str, key: str) -> tuple[float, str] | None:
        """Characteristic value of a case and where it comes from."""
        sign = -1.0 if key == CLEARANCE else 1.0
        groups: dict[tuple[Any, ...], list[tuple[float, CaseRun]]] = {}
        for run in self.runs[case, agent]:
            if run.result["extremes"] is not None:
                groups.setdefault(run.situation.group, []).append((sign * run.result["extremes"][key], run))
        if not groups:
            return None
        means = {}
        for group, found in groups.items():
            values = np.sort([value for value, _ in found])[::-1]
            means[group] = values[: math.ceil(0.5 * len(values))].mean() if CASES[case].larger_half else values.mean()
        group = max(means, key=means.__getitem__)
        return float(sign * means[group]), groups[group][0][1].situation.name

    def lifetime(self, agent: str, key: str) -> float | None:
        """Damage-equivalent load at 1 Hz over the life of the climate, of the runs of DLC 1.2 [N m].

        At one mean wind speed the damage of all seeds counts: the mean of their L^m, for a key of
        `wt_gym.analysis.statistics.LIFETIME_EXPONENTS`. γ_f is 1. None without DLC 1.2, a climate, or a complete run at
        each speed.
        """
        runs = self.runs.get(("1.2", agent))
        if not runs or self.climate is None or not all(run.complete for run in runs):
            return None
        exponent, speeds = LIFETIME_EXPONENTS[key], sorted({run.situation.speed for run in runs})
        loads = []
        for speed in speeds:
            values = np.array([run.result["fatigue"][key] for run in runs if run.situation.speed == speed])
            loads.append(lifetime_load(values, np.full(len(values), 1.0 / len(values)), exponent))
        return float(lifetime_load(np.array(loads), wind_weights(self.climate, speeds), exponent))

    def to_json(self) -> dict[str, Any]:
        """Everything but the signals, as JSON values."""
        table = []
        for case, agent in self.rows():
            passed, planned = self.survived(case, agent)
            values = {key: self.value(case, agent, key) for key in EXTREMES}
            table.append({
                "case": case, "agent": agent, "runs": planned, "complete": passed,
                "endings": {end: len(runs) for end, runs in self.failures(case, agent).items()},
                "failures": sorted({run.result["failure"] for runs in self.failures(case, agent).values()
                                    for run in runs if run.result["failure"]}),
                "extremes": {key: value and vars(value) for key, value in values.items()},
            })  # fmt: skip
        lifetime = {a: {key: self.lifetime(a, key) for key in LIFETIME_EXPONENTS} for a in self.agents}
        return {"turbine": self.turbine, "settings": self.settings, "cases": table, "lifetime": lifetime}


# ---- the study ----

REPORT_FILE, TABLE_FILE = "report.html", "loadcases.json"
_FORMAT = 2
"""Raise when files of runs mean something else."""
# They belong to the load cases, which decide when and in what wind a run ends.
_OURS = (
    "episode_length", "max_episode_steps", "inflow", "wind_speed", "wind_seeds", "turbulence_model", "turbulence",
)  # fmt: skip


@option_record
class LoadCaseConfig(Options):
    """Cases, and the environment that they are run in.

    ``env_kwargs`` are more arguments of the environment, whose wind is that of the cases; ``plan``, a
    `wt_gym.experiment.loadcases.Plan`, says how much is run in place of ``quick``.
    """

    title = "load cases"

    env_id: str = option("id of the environment, for actions and observations", default=DEFAULT_ENV)
    env_kwargs: dict[str, Any] = field(default_factory=dict)
    cases: tuple[str, ...] = option("numbers of the cases", default=tuple(CASES), choices=tuple(CASES))
    quick: bool = option("fewer and shorter runs", default=False)
    plan: Plan | None = None
    turbulence: str = option("spectra of the turbulent winds", default="kaimal", choices=TURBULENCE)
    climate: ClimateOptions = option(
        "wind climate for loads over a life", default=ClimateOptions(), kinds=(ClimateOptions,)
    )

    def check(self) -> None:
        """Refuse no case, and arguments of the environment that the cases decide on."""
        if not self.cases:
            raise ValueError(f"cases must be some of {', '.join(CASES)}, got none")
        for name in _OURS:
            if name in self.env_kwargs:
                raise ValueError(f"{name} follows from the load cases; leave it out of the environment's arguments")


class _LoadCaseRuns(AgentExperiment):
    """Rows of load cases: name of an agent, or `PARKED`, and design situation."""

    def __init__(self, agents: Mapping[str, str], config: LoadCaseConfig, as_given: bool):
        super().__init__(agents, config.env_id, config.env_kwargs, as_given=as_given)
        self._config, plain = config, turbine_env_of(self.env)
        self._behavior = benchmark_fingerprint(plain.turbine, plain.fidelity)
        self._prints = {name: fingerprint(choice) for name, choice in agents.items()}
        for one in self._prints.values():
            if "sha256" in one:
                del one["choice"]  # a model is the same wherever it lies

    def definition(self, row: tuple[str, DesignSituation]) -> dict[str, Any]:
        (name, situation), config = row, self._config
        values = situation.to_json()
        controlled = name != PARKED
        return run_definition(
            wind={key: values[key] for key in ("wind", "speed", "seed", "direction", "turbulence", "label")},
            duration=situation.duration, skip=SKIP, fingerprint=self._behavior, faults=values["faults"],
            azimuth=situation.azimuth, format=_FORMAT, agent=self._prints[name] if controlled else None,
            env_id=config.env_id if controlled else None, env_kwargs=config.env_kwargs if controlled else None,
        )  # fmt: skip

    def __call__(self, row: tuple[str, DesignSituation]) -> dict[str, Any]:
        name, situation = row
        if name == PARKED:
            env = turbine_env_of(self.env)
            return run_parked(env.turbine, env.fidelity, situation)
        return run_agent(*self[name], situation)

    def label(self, row: tuple[str, DesignSituation]) -> str:
        return f"{row[0]} in {row[1].name}"

    def outcome(self, row: tuple[str, DesignSituation], result: dict[str, Any]) -> str:
        return f": {result['ending']}"


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
        Name to word or path for `wt_gym.experiment.agents.load_agent`.
    folder : str or path
        Stores each run as soon as it is made, under the hash of all it depends on: agent (a model by its SHA-256 sums),
        situation, environment and behavior. Runs that are there are not made again; those of others stay.
    allow_other_environment, executor, progress
        As of `wt_gym.experiment.evaluation.evaluate`; the files are the same.

    Raises
    ------
    ValueError, OSError, ChildProcessError
        As of `wt_gym.experiment.evaluation.evaluate`; and if there is no agent, or one has the name `PARKED`.
    wt_gym.base.errors.InflowError
        If the turbine has no class of IEC 61400-1.
    """
    if not agents or PARKED in agents:
        raise ValueError(
            f"agents of load cases must be at least one, named otherwise than {PARKED!r}; got "
            f"{', '.join(agents) or 'none'}"
        )
    config = replace(config, env_kwargs=with_common_step(agents, config.env_id, config.env_kwargs))
    with (
        RunStore(folder, "loadcases") as store,
        _LoadCaseRuns(agents, config, as_given=allow_other_environment) as experiment,
    ):
        plain = turbine_env_of(experiment.env)
        turbine = plain.turbine
        climate = config.climate.of(turbine)  # which is refused before any run, if at all
        plan = config.plan or plan_of(turbine, config.quick)
        cases = tuple(case for case in CASES if case in config.cases)
        # runs of several cases are the same: they stand once, by their definition
        rows = [
            (case, name, replace(one, turbulence=config.turbulence) if one.seed is not None else one)
            for case in cases
            for one in CASES[case].situations(turbine, plan)
            for name in ((PARKED,) if one.parked else agents)
        ]
        parked = dict.fromkeys(case for case, name, _ in rows if name == PARKED)
        if config.env_kwargs.get("simulator", OWN) != OWN and parked:
            raise ValueError(
                f"cases with another simulator than {OWN!r} must be without a parked turbine, got {', '.join(parked)}"
            )
        require_writable(store.path / RUNS_FOLDER)
        results = experiment.table([(name, one) for _, name, one in rows], executor, store, progress)
        runs: dict[tuple[str, str], list[CaseRun]] = {}
        for (case, name, situation), result in zip(rows, results, strict=True):
            runs.setdefault((case, name), []).append(CaseRun(name, situation, result))
        settings = json_values({
            "env_id": config.env_id, "env_kwargs": config.env_kwargs, "quick": config.quick, "plan": vars(plan),
            "turbulence": config.turbulence,
            "fidelity": plain.fidelity if isinstance(plain.fidelity, str) else plain.fidelity.name,
            "control_dt": plain.control_dt,
            "wt_gym": wt_gym.__version__, "numpy": np.__version__, "gymnasium": gym.__version__,
        })  # fmt: skip
        table = LoadCaseResults(turbine.heading, cases, tuple(agents), runs, climate, settings)
        write_text_whole(store.path / TABLE_FILE, json.dumps(table.to_json(), indent=1) + "\n")
    return table
