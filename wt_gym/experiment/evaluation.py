"""Evaluation of agents in winds that no training saw."""

from __future__ import annotations

import logging
from contextlib import nullcontext
from functools import partial
from typing import TYPE_CHECKING, Any

import gymnasium as gym
import numpy as np

import wt_gym
from wt_gym.analysis.results import Evaluation, Run, Wind
from wt_gym.analysis.statistics import WindClimate
from wt_gym.base.files import json_values
from wt_gym.benchmark.run import benchmark_fingerprint
from wt_gym.envs.layout import layout_of
from wt_gym.envs.turbine_env import turbine_env_of
from wt_gym.experiment.evaluation_config import FIRST_SEED, EvaluationConfig
from wt_gym.experiment.evaluation_folder import EvaluationFolder
from wt_gym.experiment.evaluation_run import run_agent
from wt_gym.experiment.evaluation_winds import DEFAULT_WIND_SEEDS
from wt_gym.experiment.oscillation_notes import oscillation_notes
from wt_gym.experiment.pool import AgentPool
from wt_gym.experiment.training_notes import training_notes
from wt_gym.runs.executors import SerialExecutor
from wt_gym.runs.progress import ProgressLine
from wt_gym.runs.table import make_runs
from wt_gym.wind.iec import REFERENCE_SPEED

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping
    from pathlib import Path

    from wt_gym.envs.episode import Agent
    from wt_gym.envs.layout import EnvLayout
    from wt_gym.runs.executors import Executor
    from wt_gym.turbines import Turbine

__all__ = ["DEFAULT_WIND_SEEDS", "FIRST_SEED", "EvaluationConfig", "evaluate"]

_log = logging.getLogger(__name__)


def evaluate(
    agents: Mapping[str, str | Agent],
    config: EvaluationConfig,
    *,
    folder: str | Path | None = None,
    overwrite: bool = False,
    allow_other_environment: bool = False,
    executor: Executor | None = None,
    progress: bool = True,
) -> Evaluation:
    """Run every agent in every wind from the same start.

    Parameters
    ----------
    agents : mapping
        Name to agent, or to a word or path for `load_agent`. The first is the one the others are compared with.
    config : EvaluationConfig
    folder : str or path, optional
        Keeps each run as soon as it is done, and in the end the tables. Runs of the same evaluation that are there
        already are not run again. Needs agents by word or path.
    overwrite : bool
        Remove what another evaluation left in the folder.
    allow_other_environment : bool
        Take trained models into an environment with other noise, action spans or base controller than in their
        training, see `wt_gym.experiment.trained_environment`.
    executor : Executor, optional
        Of `wt_gym.runs.executors`, entered: does the runs, by default one after another. The numbers are the same.
        One that does them in other processes needs agents by word or path.
    progress : bool
        Show progress on standard error.

    Returns
    -------
    Evaluation

    Raises
    ------
    ValueError
        If the folder holds another evaluation or is in use by another process, an agent that is to be kept there or to
        run in another process is given as an object, or a model does not fit the environment.
    OSError
        If the folder cannot be written.
    ChildProcessError
        If runs were lost, because the processes or machines that did them ended again and again.
    """
    executor = SerialExecutor() if executor is None else executor
    if executor.beside and (objects := [name for name, agent in agents.items() if not isinstance(agent, str)]):
        raise ValueError(
            f"agents that run in other processes must be names or paths, got objects for {', '.join(objects)}"
        )
    store = None if folder is None else EvaluationFolder(folder, agents, config)
    where = config.env_id, config.env_kwargs, config.duration
    with store or nullcontext(), AgentPool(agents, *where, allow_other_environment) as pool:
        env = pool.env
        layout = layout_of(env)
        notes = training_notes(pool.agents, config.winds)
        for note in notes.values():
            _log.warning(note)
        climate = _climate(layout.turbine, config)
        if store:  # nothing else can be refused any more
            store.begin(benchmark_fingerprint(layout.turbine, turbine_env_of(env).fidelity), overwrite)
        jobs = [(name, wind) for wind in config.winds for name in agents]
        line, shown = ProgressLine(progress), ProgressLine(progress and not executor.beside)

        def told(job: tuple[str, Wind], run: Run, there: int) -> None:
            if executor.beside:
                line.show(f"{there} of {len(jobs)}: {run.agent} at {run.wind.name}", final=True)

        made = make_runs(
            jobs, partial(pool.results, partial(run_agent, config=config, line=shown), executor),
            tally=executor.tally, store=store, define=store.definition if store else None,
            label=lambda job: f"{job[0]} at {job[1].label}", told=told,
        )  # fmt: skip
        runs = dict(zip(jobs, made, strict=True))
        _require_common_winds(runs, agents, config.winds)
        turbine = layout.turbine
        swinging = oscillation_notes(runs.values(), turbine.drivetrain.rated_rotor_speed, config.skip)
        for name, note in swinging.items():
            _log.warning(note)
            notes[name] = f"{notes[name]} {note}" if name in notes else note
        evaluation = Evaluation(
            turbine=turbine.title,
            settings=_settings(config, layout, env),
            runs=[runs[job] for job in jobs],
            baseline=next(iter(agents)),
            limits={
                "rated_power": turbine.drivetrain.rated_power,
                "rated_rotor_speed": turbine.drivetrain.rated_rotor_speed,
            },
            training={
                name: record for name, agent in pool.agents.items() if (record := getattr(agent, "record", None))
            },
            climate=climate
            if all(turbine.cut_in <= run.wind.speed <= turbine.cut_out for run in runs.values())
            else None,
            notes=notes,
        )
        if store:
            store.save_tables(evaluation, jobs)
    return evaluation


def _climate(turbine: Turbine, config: EvaluationConfig) -> WindClimate | None:
    """Wind climate of the evaluation; None where the turbine's class has none."""
    limits = {"shape": config.weibull_shape, "cut_in": turbine.cut_in, "cut_out": turbine.cut_out}
    chosen = config.iec_class or turbine.iec_class
    if config.mean_wind_speed is not None:
        return WindClimate(config.mean_wind_speed, **limits)
    if config.iec_class is None and turbine.iec_class not in REFERENCE_SPEED:
        return None
    return WindClimate.of_class(chosen, **limits)


def _require_common_winds(runs: Mapping[tuple[str, Wind], Run], agents: Iterable[str], winds: Iterable[Wind]) -> None:
    """Refuse to compare agents that did not meet the same wind where the same was asked for."""
    for asked in winds:
        if len(met := dict.fromkeys(runs[name, asked].wind for name in agents)) > 1:
            raise ValueError(
                f"agents met different winds where one was asked for, {' and '.join(w.label for w in met)}: the "
                "inflow must follow from the random generator that it is given, and from nothing else"
            )


def _settings(config: EvaluationConfig, layout: EnvLayout, env: gym.Env) -> dict[str, Any]:
    """How the evaluation was made, as JSON values."""
    fidelity = turbine_env_of(env).fidelity
    settings = {
        "env_id": config.env_id,
        "env_kwargs": config.env_kwargs,
        "fidelity": fidelity if isinstance(fidelity, str) else fidelity.name,
        "control_dt": layout.control_dt,
        "iec_class": layout.turbine.iec_class,
        "turbulence_class": turbine_env_of(env).options.wind.turbulence_class or layout.turbine.turbulence_class,
        "duration": config.duration,
        "skip": config.skip,
        "seed": config.seed,
        "wt_gym": wt_gym.__version__,
        "numpy": np.__version__,
        "gymnasium": gym.__version__,
    }
    return json_values(settings)
