"""Callbacks of a training: curve, figures, checkpoints, reasons to stop, evaluation in winds that no training sees."""

import logging
import math
import signal
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import asdict, replace
from types import FrameType
from typing import Any

import numpy as np
from stable_baselines3.common.callbacks import BaseCallback

from wt_gym.analysis.results import Wind
from wt_gym.analysis.statistics import relative_change
from wt_gym.envs.episode import Agent
from wt_gym.envs.options import registered_arguments
from wt_gym.envs.wind_sampler import EVALUATION_WIND_SEEDS, WindSampler
from wt_gym.experiment.evaluation import EvaluationConfig, evaluate
from wt_gym.experiment.execute import ProgressLine, clock
from wt_gym.learning.options import TrainingConfig

_log = logging.getLogger(__name__)

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

    The winds have the mean speeds of the training environment's and other seeds. In those of ``before``, evaluations in
    the record of an earlier session, the baseline is not run again. Attributes are the figures of the baseline by wind,
    None before the first evaluation, and the wall time spent [s].
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
        before = before or {}
        self.baseline, self.seconds = None, float(before.get("seconds", 0.0))
        if before.get("winds") == [asdict(wind) for wind in self.winds]:
            rows = self.baseline = before.get("baseline")  # None: stopped before the first evaluation
            whole = isinstance(rows, list) and len(rows) == len(self.winds) and all(isinstance(r, dict) for r in rows)
            if rows is not None and not whole:
                raise ValueError(f"the record is damaged: the baseline's figures are {rows!r:.80}")

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
    return [
        {"episode_return": run.episode_return}
        | {name: run.metrics[name] for name in FIGURES if run.complete and name in run.metrics}
        for run in evaluation.runs
    ]


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


def _compare(name: str, own: list[dict[str, Any]], baseline: list[dict[str, Any]]) -> float | None:
    """Mean over the winds of a figure against the baseline's; None where a run lacks it, or the baseline has none."""
    if any(name not in row for row in own + baseline):
        return None
    pairs = [(row[name], other[name]) for row, other in zip(own, baseline, strict=True)]
    if name == "episode_return":
        return float(np.mean([new - old for new, old in pairs]))
    mean = float(np.mean([relative_change(new, old) for new, old in pairs]))
    return None if math.isnan(mean) else mean


class StopRequest:
    """Signal that asked the training to stop; None: nobody did."""

    signal_number: int | None = None

    @property
    def name(self) -> str | None:
        """Name of the signal."""
        return None if self.signal_number is None else signal.Signals(self.signal_number).name


@contextmanager
def stop_on_signals(outer: StopRequest | None = None) -> Iterator[StopRequest]:
    """Turn SIGINT (Ctrl-C) and SIGTERM into a request; the second one ends the program.

    Only in the main thread, and not where an outer request exists, which is used then.
    """
    request = outer or StopRequest()
    if outer is not None or threading.current_thread() is not threading.main_thread():
        yield request
        return
    numbers = (signal.SIGINT, signal.SIGTERM)
    before = {number: signal.getsignal(number) for number in numbers}

    def ask(number: int, _frame: FrameType | None) -> None:
        request.signal_number = number
        for each in numbers:
            signal.signal(each, before[each])

    for number in numbers:
        signal.signal(number, ask)
    try:
        yield request
    finally:
        for number in numbers:
            signal.signal(number, before[number])


class Watch(BaseCallback):
    """Extends the learning curve, shows progress and stops at the time limit or when asked to."""

    def __init__(
        self, config: TrainingConfig, control_dt: float, curve: dict[str, list[Any]], stop: StopRequest, shown: bool
    ):
        super().__init__()
        self._config, self._control_dt, self._stop = config, control_dt, stop
        self._relative = bool(registered_arguments(config.env_id, config.env_kwargs).get("relative_reward"))
        self._line, self._started, self._first_step = ProgressLine(shown), time.monotonic(), 0
        self.curve, self.ended = curve, "finished"

    @property
    def seconds(self) -> float:
        """Time since the start [s]."""
        return time.monotonic() - self._started

    def _on_training_start(self) -> None:
        self._first_step = self.num_timesteps

    def _on_step(self) -> bool:
        for info in self.locals["infos"]:
            if "episode" in info:
                self.curve["steps"].append(int(self.num_timesteps))
                self.curve["episode_return"].append(float(info["episode"]["r"]))
                self.curve["episode_length"].append(float(info["episode"]["l"]) * self._control_dt)
        self._line.show(self.text)
        limit = self._config.max_seconds
        if self._stop.signal_number is not None:
            self.ended = "interrupted"
        elif limit is not None and self.seconds >= limit:
            self.ended = "time limit"
        return self.ended == "finished"

    def text(self) -> str:
        """Describe the state of the training."""
        limit, seconds = self._config.max_seconds, self.seconds
        recent = self.curve["episode_return"][-10:]
        returns = f"mean return of the last {len(recent)} {np.mean(recent):.1f}" if recent else "none finished yet"
        if recent and self._relative:
            returns += " (0: as the base controller alone)"
        rate = (self.num_timesteps - self._first_step) / max(seconds, 1e-9)
        return (
            f"training {self.num_timesteps} of about {self._config.total_steps} steps, {clock(seconds)}"
            f"{f' of {clock(limit)}' if limit is not None else ''} min, {rate:.0f}"
            f" steps/s, {len(self.curve['steps'])} episodes, {returns}"
        )

    def finish(self) -> None:
        """Show the last line."""
        self._line.show(self.text(), final=True)


class EpisodeFigures(BaseCallback):
    """Gives the logger, and so TensorBoard, figures of the episodes, means since the last writing.

    ``episode/``: return, length [s], mean power [MW], highest rotor speed [rad/s], least tip clearance [m], share of
    terminated episodes; ``reward/``: each term, summed over an episode.
    """

    def _on_training_start(self) -> None:
        self._episodes: list[dict[str, Any]] = [_new_episode() for _ in range(self.training_env.num_envs)]

    def _on_step(self) -> bool:
        for i, info in enumerate(self.locals["infos"]):
            episode = self._episodes[i]
            episode["power"].append(info["generator_power"])
            episode["speed"] = max(episode["speed"], info["rotor_speed_max"])
            episode["clearance"] = min(episode["clearance"], info["tip_clearance_min"])
            for name, value in info["reward_terms"].items():
                episode["terms"][name] = episode["terms"].get(name, 0.0) + value
            if "episode" not in info:
                continue
            figures = {
                "episode/return": info["episode"]["r"],
                "episode/length_s": info["time"],
                "episode/mean_power_mw": 1e-6 * float(np.mean(episode["power"])),
                "episode/rotor_speed_max": episode["speed"],
                "episode/tip_clearance_min": episode["clearance"],
                "episode/terminated": float("termination" in info),
            } | {f"reward/{name}": value for name, value in episode["terms"].items()}
            for name, value in figures.items():
                self.logger.record_mean(name, value)
            self._episodes[i] = _new_episode()
        return True


def _new_episode() -> dict[str, Any]:
    return {"power": [], "speed": 0.0, "clearance": float("inf"), "terms": {}}


class _AtMultiples(BaseCallback):
    """Something at the first step at or beyond each multiple of a number of steps."""

    def __init__(self, steps: int):
        super().__init__()
        self._steps = steps

    def _on_training_start(self) -> None:
        self._next = self._steps * (self.num_timesteps // self._steps + 1)


class Checkpoints(_AtMultiples):
    """Saves by steps and by wall time, whichever comes first; with 0 minutes only steps count."""

    def __init__(self, steps: int, minutes: float, save: Callable[[], None]):
        super().__init__(steps)
        self._seconds, self._save, self._last_time = 60.0 * minutes, save, time.monotonic()

    def _on_step(self) -> bool:
        by_time = self._seconds > 0.0 and time.monotonic() - self._last_time >= self._seconds
        if self.num_timesteps >= self._next or by_time:
            self._save()
            self._last_time = time.monotonic()
            self._on_training_start()
        return True


class Evaluations(_AtMultiples):
    """Evaluates the policy every so many steps, extends the curve and saves the best model.

    Parameters
    ----------
    agent : callable
        Returns the agent to evaluate.
    save_best : callable
        Called without arguments where the return is the highest so far.
    report : callable, optional
        Called with steps and figures; training stops where it returns False.
    """

    def __init__(
        self,
        every: int,
        evaluation: SelectionEvaluation,
        agent: Callable[[], Any],
        curve: dict[str, list[Any]],
        save_best: Callable[[], None],
        report: Callable[[int, dict[str, Any]], bool] | None = None,
    ):
        super().__init__(every)
        self._evaluation, self._agent, self.curve = evaluation, agent, curve
        self._save_best, self._report = save_best, report

    def record(self) -> dict[str, Any]:
        """Winds, figures of the baseline, curve, best model so far and wall time, as JSON values."""
        row = int(np.argmax(self.curve["episode_return"])) if self.curve["steps"] else None
        return {
            "winds": [asdict(wind) for wind in self._evaluation.winds],
            "baseline": self._evaluation.baseline,
            "curve": self.curve,
            "best": None if row is None else {name: values[row] for name, values in self.curve.items()},
            "seconds": self._evaluation.seconds,
        }

    def _on_step(self) -> bool:
        if self.num_timesteps < self._next:
            return True
        self._on_training_start()
        return self.evaluate()

    def evaluate(self) -> bool:
        """Evaluate now; return False where training stops."""
        figures = self._evaluation(self._agent())
        steps = int(self.model.num_timesteps)
        for name, value in {"steps": steps, **figures}.items():
            self.curve[name].append(value)
        for name, value in figures.items():
            if value is not None:
                self.logger.record(f"evaluation/{name}", value)
        if np.argmax(self.curve["episode_return"]) == len(self.curve["steps"]) - 1:
            self._save_best()
        return self._report is None or self._report(steps, figures)

    def finish(self) -> None:
        """Evaluate the last policy, unless that has been done."""
        if self.curve["steps"][-1:] != [int(self.model.num_timesteps)]:
            self.evaluate()
