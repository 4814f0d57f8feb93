"""One run of an evaluation: how it starts, and its measurements. Its sources are part of the identity of results."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Any

from wt_gym.analysis.metrics import run_metrics
from wt_gym.analysis.results import Run, Wind
from wt_gym.envs.terminations import violated
from wt_gym.envs.turbine_env import turbine_env_of
from wt_gym.experiment.evaluation_config import LEAST_MEASURED
from wt_gym.experiment.evaluation_winds import actual_wind
from wt_gym.runs.playing import play
from wt_gym.runs.progress import clock

if TYPE_CHECKING:
    import xarray as xr

    from wt_gym.envs.episode import EpisodeStep
    from wt_gym.envs.turbine_env import WindTurbineEnv
    from wt_gym.experiment.evaluation_config import EvaluationConfig
    from wt_gym.experiment.pool import AgentPool
    from wt_gym.runs.progress import ProgressLine
    from wt_gym.turbines import Turbine

__all__ = ["run_agent"]


def run_agent(pool: AgentPool, job: tuple[str, Wind], config: EvaluationConfig, line: ProgressLine) -> Run:
    """Run one agent in one wind.

    Parameters
    ----------
    pool : AgentPool
    job : tuple of str and Wind
        Name of the agent, and the requested wind.
    config : EvaluationConfig
    line : ProgressLine
        Shows how far the run is.
    """
    (name, request), (env, agent) = job, pool[job[0]]
    turbine_env, began = turbine_env_of(env), time.monotonic()

    def show_progress(step: EpisodeStep) -> None:
        simulated, elapsed = step.info["time"], time.monotonic() - began
        line.show(
            f"evaluating {name} at {request.name}: {simulated:.0f} of {config.duration:.0f} s simulated"
            f" in {clock(elapsed)} min ({simulated / max(elapsed, 1e-9):.0f} x real time)",
            final=step.done,
        )

    options = _options(turbine_env, request, config)
    replay = config.replay_in(request)
    result = play(env, agent, seed=config.seed_in(request), options=options, replay=replay, on_step=show_progress)
    wind = actual_wind(turbine_env, request, config.winds)
    seed = int(turbine_env.episode_wind.wind_seed)
    metrics = _metrics(result.after_start, turbine_env.turbine, config.skip, result.time)
    if metrics and turbine_env.options.limits.costs is not None:
        violations = violated({name: cost / result.steps for name, cost in result.costs.items()})
        metrics["limits_violated"] = float(bool(violations))
    return Run(
        agent=name,
        wind=wind,
        data=result.data.assign_attrs(agent=name, wind_speed=wind.speed, wind_seed=seed),
        metrics=metrics,
        episode_return=result.episode_return,
        reward_terms=result.reward_terms,
        planned_duration=config.duration,
        duration=result.time,
        ending=result.ending,
        failure=result.failure,
        replay=result.replay,
    )


def _options(env: WindTurbineEnv, request: Wind, config: EvaluationConfig) -> dict[str, Any]:
    """Reset options for a requested wind, as far as the environment has them."""
    allowed = env.wind.options
    options: dict[str, Any] = {"azimuth": 0.0}
    if "wind_speed" in allowed:
        options["wind_speed"] = request.speed
    if request.seed is not None and "wind_seed" in allowed:
        options["wind_seed"] = request.seed
    if request.draw is not None and (pieces := env.wind.windows(config.duration)):
        file, start = pieces[(request.draw - 1) % len(pieces)]  # drawn ones would overlap, or be the same
        options["inflow"] = file.inflow(start)
    return options


def _metrics(data: xr.Dataset, turbine: Turbine, skip: float, duration: float) -> dict[str, float]:
    """Metrics of a run, none if it ended before there was something to measure."""
    return run_metrics(data, turbine, skip) if duration >= skip + LEAST_MEASURED else {}
