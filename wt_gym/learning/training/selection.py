"""Evaluation while training: against the baseline controller, in winds that no training sees."""

from __future__ import annotations

import logging
import math
import time
from dataclasses import asdict, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from wt_gym.analysis.results import Wind
from wt_gym.analysis.statistics import relative_change
from wt_gym.envs.wind_sampler import EVALUATION_WIND_SEEDS
from wt_gym.experiment.evaluation import EvaluationConfig, evaluate

if TYPE_CHECKING:
    from wt_gym.analysis.results import Run
    from wt_gym.envs.episode import Agent
    from wt_gym.envs.wind_sampler import WindSampler
    from wt_gym.learning.training.config import TrainingConfig

_log = logging.getLogger(__name__)
__all__ = ["FIGURES", "SELECTION_WIND_SEEDS", "SelectionEvaluation"]

SELECTION_WIND_SEEDS = EVALUATION_WIND_SEEDS[:-9:-1]
"""Wind seeds by which the best model of a training is chosen, the last of those held back from training: the first
ones, which an evaluation takes by default, have no part in the choice."""

FIGURES = {
    "episode_return": "return against the baseline's",
    "mean_power": "power",
    "blade_flap_del": "flap DEL",
    "tower_fore_aft_del": "tower fore-aft DEL",
    "tower_side_side_del": "tower side-side DEL",
}
"""Difference of the return, and relative changes of metrics against the baseline in the same winds."""

_SKIP = 10.0  # start left out of the metrics [s]
_SEED = 2**31  # of what the wind seed does not decide (directions, gusts, noise): no other evaluation's


class SelectionEvaluation:
    """Runs a policy and, once, the baseline controller in the same few winds.

    Parameters
    ----------
    config : TrainingConfig
    wind : WindSampler
        Of the training environment: the winds have its mean speeds and other seeds.
    before : dict, optional
        Evaluations as an earlier session has recorded them: in the same winds the baseline is not run again.

    Attributes
    ----------
    baseline : list of dict or None
        Figures of the baseline controller by wind, from the first evaluation on.
    seconds : float
        Wall time spent [s].

    Raises
    ------
    ValueError
        If the training draws from so many seeds that too few are held back, or the earlier evaluations are damaged.
    """

    def __init__(self, config: TrainingConfig, wind: WindSampler, before: dict[str, Any] | None = None):
        self.winds = _winds(config, wind)
        limits = ("episode_length", "max_episode_steps")  # runs are as long as the evaluation
        kwargs = {name: value for name, value in config.env_kwargs.items() if name not in limits}
        self._config = EvaluationConfig(
            config.env_id, kwargs, self.winds, duration=config.eval_seconds, skip=_SKIP, seed=_SEED, replay=0.0
        )
        # Zero residual actions are the controller, whatever components and mode the policy acts by.
        residual = {name: value for name, value in kwargs.items() if name != "action_spans"}
        self._baseline_config = replace(self._config, env_kwargs=residual | {"action_mode": "residual"})
        self.baseline, self.seconds = None, 0.0
        if before and before.get("winds") == [asdict(wind) for wind in self.winds]:
            self.baseline = _checked(before.get("baseline"), len(self.winds))

    def __call__(self, agent: Agent) -> dict[str, float | None]:
        """Figures of `FIGURES` for an agent, means over the winds; None where a run ended too early to have them."""
        started = time.monotonic()
        if self.baseline is None:
            self.baseline = _run("baseline", self._baseline_config)
        own = _run(agent, self._config)
        self.seconds += time.monotonic() - started
        return {name: _compare(name, own, self.baseline) for name in FIGURES}


def _run(agent: str | Agent, config: EvaluationConfig) -> list[dict[str, Any]]:
    """Return and metrics of an agent in every wind."""
    name = agent if isinstance(agent, str) else "agent"
    evaluation = evaluate({name: agent}, config, progress=False)
    for sentence in evaluation.idle_sentences.values():
        _log.warning(sentence)
    return [_figures(run) for run in evaluation.runs]


def _winds(config: TrainingConfig, wind: WindSampler) -> tuple[Wind, ...]:
    """Winds over the range of mean speeds, each with a seed of its own if there is turbulence."""
    low, high = wind.speeds
    n = config.eval_winds
    speeds = [low + (k + 0.5) / n * (high - low) for k in range(n)]
    if not wind.seeds and wind.draws_more:  # gusts, or several inflows of the user
        return tuple(Wind(speed, draw=k) for k, speed in enumerate(speeds, 1))
    if not wind.seeds:
        return tuple(Wind(speed) for speed in dict.fromkeys(speeds))
    seeds = [seed for seed in SELECTION_WIND_SEEDS if seed not in wind.seeds]
    if len(seeds) < n:
        raise ValueError(
            f"eval_winds must be at most {len(seeds)}, the seeds of {SELECTION_WIND_SEEDS[-1]} to "
            f"{SELECTION_WIND_SEEDS[0]} that training does not draw; got {n}"
        )
    return tuple(Wind(speed, seed) for speed, seed in zip(speeds, seeds, strict=False))


def _checked(baseline: Any, n_winds: int) -> list[dict[str, Any]] | None:
    """Figures of the baseline from a record.

    Raises
    ------
    ValueError
        If they are none.
    """
    if baseline is None:  # stopped before the first evaluation
        return None
    if not (isinstance(baseline, list) and len(baseline) == n_winds and all(isinstance(row, dict) for row in baseline)):
        raise ValueError(f"the record is damaged: the baseline's figures are {baseline!r:.80}")
    return baseline


def _figures(run: Run) -> dict[str, Any]:
    """Return and metrics of a run."""
    metrics = run.metrics if run.complete else {}
    return {"episode_return": run.episode_return} | {name: metrics[name] for name in FIGURES if name in metrics}


def _compare(name: str, own: list[dict[str, Any]], baseline: list[dict[str, Any]]) -> float | None:
    """Mean over the winds of a figure against the baseline's; None where a run lacks it, or the baseline has none."""
    if any(name not in row for row in own + baseline):
        return None
    pairs = [(row[name], other[name]) for row, other in zip(own, baseline, strict=True)]
    if name == "episode_return":
        return float(np.mean([new - old for new, old in pairs]))
    mean = float(np.mean([relative_change(new, old) for new, old in pairs]))
    return None if math.isnan(mean) else mean
