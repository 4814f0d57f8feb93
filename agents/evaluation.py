"""Evaluation of agents in winds that no training saw."""

from __future__ import annotations

import json
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

import gymnasium as gym
import numpy as np

import wt_gym
from agents.constant import ConstantAgent
from agents.controller_agent import ControllerAgent
from agents.progress import ProgressLine, clock
from wt_gym.analysis.metrics import run_metrics
from wt_gym.analysis.results import Evaluation, Run, Wind
from wt_gym.envs.layout import layout_of
from wt_gym.envs.wind_sampler import EVALUATION_WIND_SEEDS
from wt_gym.simulation import Recorder

if TYPE_CHECKING:
    from collections.abc import Mapping

    from wt_gym.envs.layout import EnvLayout
    from wt_gym.turbines import Turbine

__all__ = ["BASELINE", "Agent", "EvaluationConfig", "default_names", "evaluate", "load_agent"]

BASELINE = "Baseline PI"
# A metric of a few samples says nothing: runs that end earlier than this after the skipped start have none.
_LEAST_MEASURED = 2.0
_ENDLESS = 10**9  # control steps


class Agent(Protocol):
    """Anything with stable-baselines3's ``predict``."""

    def predict(self, observation, state=None, episode_start=None, deterministic: bool = True):
        """Action and state for an observation."""
        ...


@dataclass(frozen=True)
class EvaluationConfig:
    """Where and how long to evaluate.

    Attributes
    ----------
    env_id : str
    env_kwargs : dict
        Arguments of the environment besides episode length.
    winds : tuple of Wind
        By default two held-back turbulence seeds at 15 m/s.
    duration : float
        Length of a run [s].
    skip : float
        Start left out of the metrics [s].
    seed : int
        Of the environment (measurement noise).
    """

    env_id: str = "wt_gym/LoadReduction-v0"
    env_kwargs: dict[str, Any] = field(default_factory=dict)
    winds: tuple[Wind, ...] = tuple(Wind(15.0, seed) for seed in EVALUATION_WIND_SEEDS[:2])
    duration: float = 600.0
    skip: float = 30.0
    seed: int = 0


def load_agent(choice: str, layout: EnvLayout) -> Agent:
    """Give the agent that a word or path means.

    Parameters
    ----------
    choice : str
        ``"baseline"`` (the controller beneath residual actions, else the baseline controller), ``"constant"``, or the
        path of a trained model or its folder.
    layout : EnvLayout

    Returns
    -------
    Agent
    """
    if choice == "baseline":  # beneath residual actions runs a controller already
        return ConstantAgent(layout) if layout.action.mode == "residual" else ControllerAgent(layout)
    if choice == "constant":
        return ConstantAgent(layout)
    from agents.trained import TrainedAgent  # torch takes seconds to import

    agent = TrainedAgent.load(choice)
    agent.check_fits(layout)
    return agent


def evaluate(agents: Mapping[str, str | Agent], config: EvaluationConfig, *, progress: bool = True) -> Evaluation:
    """Run every agent in every wind from the same start.

    Parameters
    ----------
    agents : mapping
        Name to agent, or to a word or path for `load_agent`. The first is the one the others are compared with.
    config : EvaluationConfig
    progress : bool
        Show progress on standard error.

    Returns
    -------
    Evaluation

    Raises
    ------
    ValueError
        If the runs are too short to leave something to measure, or the arguments of the environment hold a length of
        the episodes.
    """
    if not (config.skip >= 0.0 and config.duration >= config.skip + _LEAST_MEASURED):
        raise ValueError(
            f"nothing is left to evaluate: the duration of {config.duration:g} s must exceed the skipped start of "
            f"{config.skip:g} s (at least 0) by {_LEAST_MEASURED:g} s or more"
        )
    for name in ("episode_length", "max_episode_steps"):
        if name in config.env_kwargs:
            raise ValueError(f"{name} follows from the duration of the evaluation; leave it out of env_kwargs")
    # the duration of the evaluation is the only limit, whatever the length of a task's episodes
    env = gym.make(config.env_id, **config.env_kwargs, episode_length=config.duration, max_episode_steps=_ENDLESS)
    try:
        layout = layout_of(env)
        ready = {name: load_agent(a, layout) if isinstance(a, str) else a for name, a in agents.items()}
        line, runs, geometry, label = ProgressLine(progress), [], {}, ""
        for wind in config.winds:
            for name, agent in ready.items():
                run = _run(env, name, agent, wind, config, line)
                runs.append(run)
                if not geometry and run.complete:
                    geometry = env.unwrapped.simulator.geometry()
                    label = f"{name} at {wind.label}, after {run.duration:.0f} s"
        turbine = layout.turbine
        return Evaluation(
            turbine=turbine.name,
            settings=_settings(config, layout, env),
            runs=runs,
            baseline=next(iter(agents)),
            limits={
                "rated_power": turbine.drivetrain.rated_power,
                "rated_rotor_speed": turbine.drivetrain.rated_rotor_speed,
            },
            training={name: agent.record for name, agent in ready.items() if getattr(agent, "record", None)},
            geometry=geometry,
            geometry_label=label,
        )
    finally:
        env.close()


def _run(env: gym.Env, name: str, agent: Agent, wind: Wind, config: EvaluationConfig, line: ProgressLine) -> Run:
    """One agent in one wind."""
    # what the wind leaves open (directions, transients, own inflows) is drawn for every wind, once for all agents
    allowed, number = env.unwrapped.wind.options, config.winds.index(wind)
    options: dict[str, Any] = {"azimuth": 0.0}
    if "wind_speed" in allowed:
        options["wind_speed"] = wind.speed
    if wind.seed is not None and "wind_seed" in allowed:
        options["wind_seed"] = wind.seed
    observation, info = env.reset(seed=config.seed + 1000 * number, options=options)
    turbine_env, started = env.unwrapped, time.monotonic()
    recorder = Recorder(turbine_env.simulator, agent=name, wind_speed=wind.speed, wind_seed=info["wind_seed"])
    recorder.append(turbine_env.signals)
    state, episode_start = None, np.ones(1, dtype=bool)
    total, terms, done = 0.0, {}, False
    while not done:
        action, state = agent.predict(observation, state=state, episode_start=episode_start, deterministic=True)
        observation, reward, terminated, truncated, info = env.step(action)
        episode_start, done = np.zeros(1, dtype=bool), terminated or truncated
        total += float(np.sum(reward))  # one number, or its terms with vector_reward
        for key, value in info["reward_terms"].items():
            terms[key] = terms.get(key, 0.0) + value
        if "failure" not in info:  # the signals of a failed step are those of the step before
            recorder.append(turbine_env.signals)
        simulated, elapsed = info["time"], time.monotonic() - started
        line.show(
            f"evaluating {name} at {wind.label}: {simulated:.0f} of {config.duration:.0f} s simulated"
            f" in {clock(elapsed)} min ({simulated / max(elapsed, 1e-9):.0f} x real time)",
            final=done,
        )
    data = recorder.to_dataset()
    return Run(
        agent=name,
        wind=wind,
        data=data,
        metrics=_metrics(data, turbine_env.turbine, config.skip, info["time"]),
        episode_return=float(total),
        reward_terms=terms,
        planned_duration=config.duration,
        duration=float(info["time"]),
        ending=info.get("termination", "time"),
        failure=info.get("failure"),
    )


def _metrics(data, turbine: Turbine, skip: float, duration: float) -> dict[str, float]:
    """Metrics of a run, none if it ended before there was something to measure.

    Each sample stands for the step that led to it, so the start at t = 0 is left out.
    """
    return run_metrics(data.isel(time=slice(1, None)), turbine, skip) if duration >= skip + _LEAST_MEASURED else {}


def _settings(config: EvaluationConfig, layout: EnvLayout, env: gym.Env) -> dict[str, Any]:
    """How the evaluation was made, as JSON values."""
    fidelity = env.unwrapped.fidelity
    settings = {
        "env_id": config.env_id,
        "env_kwargs": config.env_kwargs,
        "fidelity": fidelity if isinstance(fidelity, str) else fidelity.name,
        "control_dt": layout.control_dt,
        "duration": config.duration,
        "skip": config.skip,
        "seed": config.seed,
        "wt_gym": wt_gym.__version__,
        "numpy": np.__version__,
        "gymnasium": gym.__version__,
    }
    return json.loads(json.dumps(settings, default=str))


def default_names(choices: list[str]) -> dict[str, str]:
    """Names for the agents of a command line: ``NAME=CHOICE``, or a name that follows from the choice.

    Parameters
    ----------
    choices : list of str
        Words or paths for `load_agent`, each with or without a name in front.

    Returns
    -------
    dict
        Name to choice, in the given order.

    Raises
    ------
    ValueError
        If two agents get the same name.
    """
    named: dict[str, str] = {}
    for choice in choices:
        name, separator, rest = choice.partition("=")
        if not separator:
            rest = choice
            name = {"baseline": BASELINE, "constant": "Constant action"}.get(choice) or _model_name(Path(choice))
        if name in named:
            raise ValueError(f"two agents are called {name!r}; give them names as NAME=PATH")
        named[name] = rest
    return named


def _model_name(path: Path) -> str:
    """Algorithm of a trained model, else the name of its file or folder."""
    from agents.trained import RECORD_FILE, read_record

    record = (path if path.is_dir() else path.parent) / RECORD_FILE
    if record.is_file():
        return read_record(record)["algorithm"]
    return path.stem
