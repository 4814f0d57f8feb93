"""Pretrain a policy: record episodes, identify what offsets do, follow the gradient of the cost, record again.

Between two recordings the policy changes only in the model, thousands of times faster than in the simulator; each round
starts from what the current policy really does, so that errors of the model do not add up. Models that plan in a
learned latent state do likewise (Hafner et al., arXiv:1912.01603); here the model is the linear one that also designs
`wt_gym.control.controllers.linear_optimal`.
"""

from __future__ import annotations

import json
import math
import time
from dataclasses import asdict, dataclass, field, fields
from functools import cached_property
from typing import TYPE_CHECKING, Any, TypeVar

import gymnasium as gym
import numpy as np
import torch

from wt_gym.analysis.metrics import BLADE_EXPONENT, TOWER_EXPONENT
from wt_gym.base.quantities import DAY
from wt_gym.deployment.export.policy import network_of
from wt_gym.envs.dial import DIAL_NAMES, dial_of, scaled
from wt_gym.envs.options import wind_files_of
from wt_gym.envs.turbine_env import turbine_env_of
from wt_gym.experiment.execute import clock
from wt_gym.experiment.run import benchmark_fingerprint
from wt_gym.experiment.store import described
from wt_gym.experiment.trained_agent import TrainedAgent
from wt_gym.learning import pretraining_episodes
from wt_gym.learning.options import excitation_of
from wt_gym.learning.pretraining_episodes import Actor, EpisodeJob, LinearizedEpisode, Plants, RecordedEpisode
from wt_gym.learning.recording import RecordingStore, identify, identify_and_judge

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence
    from pathlib import Path

    from stable_baselines3.common.base_class import BaseAlgorithm

    from wt_gym.deployment.export.policy import Network
    from wt_gym.envs.dial import DialTerm
    from wt_gym.experiment.execute import Executor
    from wt_gym.learning.options import PretrainingOptions


FRONT_SETTINGS: dict[str, dict[str, float]] = {
    "equal": {}, "fatigue": {"fatigue": 4.0}, "power": {"power": 4.0}, "travel": {"travel": 4.0},
    "little travel": {"travel": 0.25}, "little fatigue": {"fatigue": 0.25}, "little power": {"power": 0.25},
}  # fmt: skip
"""Settings of a dial of which a forecast is recorded: each factor at a quarter, one and four times the others."""

_T = TypeVar("_T")
_MAIN = (BLADE_EXPONENT, TOWER_EXPONENT)
_AIM = 0.98
"""Share of the limit that a multiplier aims at."""
_SUMMED, _PROPORTIONAL = 2e-3, 0.1
"""Where the travel is far beyond its limit: growth of a multiplier in a step of the optimizer, and its part in
proportion to what is beyond. Multipliers are some hundredths."""
_MEAN_OF_BATCHES = 0.2
"""Part of the last batch in the mean travel of several."""
_JUDGED = 4
"""Factors of a dial with which each held-out wind is judged."""
_untrained: dict[tuple[Any, ...], tuple[Any, list[RecordedEpisode]]] = {}
"""Runs before any policy, of the last pretraining of this process: those of another seed are the same."""


@dataclass(frozen=True)
class Round:
    """Result of a round."""

    recorded: float
    """Mean lifetime cost of the recorded policy less that of the published controller, in the held-out winds."""
    forecast: float
    """The same of the policy after it, by the model."""
    fitted: float
    """The same in the winds of the optimization."""
    iteration: int
    """Of the optimizer, at which the held-out winds chose the policy."""
    conditions: list[tuple[float, float]] = field(default_factory=list)
    """Recorded and forecast cost in the held-out winds of each condition."""
    travel: float = 0.0
    """Forecast pitch travel of the policy after it, in all its winds [rad/day]."""
    multiplier: float = 0.0
    """Of the budget of travel at the end of the optimization: price of a whole budget in the cost that is followed."""
    seconds: float = 0.0
    """Of recording and optimization."""


@dataclass(frozen=True)
class Execution:
    """How a pretraining runs."""

    executor: Executor
    """Entered."""
    progress: Callable[[str], None] = lambda _: None
    """Called with lines."""
    check: Callable[[], None] = lambda: None
    """Called after every episode and every step of the optimizer; an exception of it ends the pretraining."""
    recordings: Path | None = None
    """Folder that keeps each recorded episode as soon as it is done: what is there is not recorded again."""


@dataclass(frozen=True)
class _Identified:
    """A condition."""

    plants: Plants
    """From offsets to loads."""
    seen: Plants | None
    """From offsets to what the agent sees; None in the condition of the environment, where there is no such effect."""
    explained: dict[float, dict[str, float]]
    """Shares of unseen runs that the plants explain, by wind speed."""


@dataclass
class _Budget:
    """Pitch travel that a policy may have, with its Lagrangian multiplier.

    The multiplier has a part that adds up what is traveled beyond the limit and one in proportion to it, which damps
    (Stooke, Achiam, Abbeel, ICML 2020, arXiv:2007.03964).
    """

    limit: float
    """[rad/s]; infinite without one."""
    multiplier: float = 0.0
    """Of the share of the limit that is traveled, in the unit of the lifetime cost."""
    _sum: float = 0.0
    _share: float = 1.0

    def lagrangian(self, cost: torch.Tensor, travel: torch.Tensor) -> torch.Tensor:
        """Objective of the optimizer; its gradient keeps its size whatever the multiplier."""
        return (cost + self.multiplier * travel / self.limit) / (1.0 + self.multiplier)

    def update(self, travel: float) -> None:
        """Move the multiplier by the travel of a batch [rad/s]."""
        self._share += _MEAN_OF_BATCHES * (travel / (_AIM * self.limit) - self._share)
        beyond = (self._share - 1.0) / (self._share + 1.0)
        self._sum = max(0.0, self._sum + _SUMMED * beyond)
        self.multiplier = max(0.0, self._sum + _PROPORTIONAL * beyond)

    def beyond(self, travel: float) -> float:
        """Travel beyond the limit [rad/s]."""
        return max(travel - self.limit, 0.0)

    def overdrawn(self, actor: Actor, episodes: Sequence[LinearizedEpisode]) -> float:
        """Travel of a policy beyond the limit in episodes [rad/s]; nothing is computed without a limit."""
        return self.beyond(_travel(actor, episodes)) if math.isfinite(self.limit) else 0.0


class _Deployed:
    """Policy without torch, as it acts in a process that records."""

    def __init__(self, network: Network) -> None:
        self._network = network

    def predict(
        self, observation: Any, state: Any = None, episode_start: Any = None, deterministic: bool = True
    ) -> tuple[Any, Any]:
        """Action of an observation as the environment gives it."""
        return self._network.of_observation(observation), state


def pretrain(
    model: BaseAlgorithm,
    env_id: str,
    env_kwargs: dict[str, Any],
    options: PretrainingOptions,
    execution: Execution,
    seed: int = 0,
    travel_limit: float | None = None,
) -> dict[str, Any]:
    """Change the actor of a model until it costs least.

    Parameters
    ----------
    model : PPO
        Fresh; its last layer is set to zero first, so that it begins as the base controller alone.
    env_kwargs : dict
        JSON values.
    seed : int
        Of the order of episodes and of the noise.
    travel_limit : float, optional
        Pitch travel that the policy may have, mean of the blades and of all episodes, whatever their condition or dial
        [rad/day]. A Lagrangian multiplier holds it. The cheapest of ten points of the optimization within the limit is
        kept, or without one that nearest to it.

    Returns
    -------
    dict
        Record: options, shares that the plants explain by condition, rounds; JSON values.

    Raises
    ------
    ValueError
        If the environment is of a kind that cannot be pretrained on.
    wt_gym.base.errors.SimulationError
        If an episode ends early.
    """
    policy: Any = model.policy
    work, actor, say = _Work(env_id, env_kwargs, options, execution), _actor(policy), execution.progress
    plain = work.env
    names, dials = plain.layout.observation.names, dial_of(plain)
    dial_at = [] if dials is None else [names.index(f"dial_{name}") for name in DIAL_NAMES]
    with torch.no_grad():
        policy.action_net.weight.zero_()
        policy.action_net.bias.zero_()
        if isinstance(plain.options.dial.weights, str):
            # few of many inputs: as strong together as the others, so that they bend the policy from the start
            size = math.sqrt((len(names) - len(dial_at)) / len(dial_at))
            policy.mlp_extractor.policy_net[0].weight[:, dial_at] *= size
    (identified, baselines), first = work.before_any_policy()
    high, drives = plain.operation.action.pitch_high, plain.turbine.pitch
    limits = pretraining_episodes.Limits(
        float(high[0]), float(high[1]), plain.options.controller.residual_washout, drives.max_rate,
        plain.turbine.drivetrain.rated_power, options.skip, tuple(dial_at),
    )  # fmt: skip
    budget = _Budget(math.inf if travel_limit is None else travel_limit / DAY)
    torch.manual_seed(seed)
    rng, rounds = np.random.default_rng(seed), []
    for number in range(options.rounds):
        began = time.monotonic()
        recorded = first
        if number > 0:
            agent = _Deployed(network_of(TrainedAgent(model, None, {}), plain.layout))
            recorded = work.recorded(agent, number)
        made = [
            LinearizedEpisode(one, actor, of.plants, limits, _between(baselines, one.speed), of.seen)
            for one, of in zip(recorded, work.in_turns(identified), strict=True)
        ]
        before = _costs(actor, made[: options.held_out])
        found = _optimized(policy, made, options, rng, execution, budget, dials)
        after = _costs(actor, made[: options.held_out])
        several = len(options.conditions)
        of_each = [(float(np.mean(before[c::several])), float(np.mean(after[c::several]))) for c in range(several)]
        rounds.append(
            Round(
                *found, conditions=of_each, travel=DAY * _travel(actor, made),
                multiplier=budget.multiplier, seconds=round(time.monotonic() - began, 1),
            )
        )  # fmt: skip
        say(
            f"round {number + 1} of {options.rounds}: held-out winds {100 * rounds[-1].recorded:+.2f} % of the cost as "
            f"recorded, {100 * rounds[-1].forecast:+.2f} % forecast"
        )
    plain.close()
    if rounds and budget.beyond(rounds[-1].travel / DAY) > 0.0:
        say(
            f"the budget of {travel_limit:g} rad/d is not kept: the policy nearest to it is forecast to travel "
            f"{rounds[-1].travel:.0f} rad/d"
        )
    record = {
        "options": asdict(options),
        "explained": [{f"{speed:g} m/s": shares for speed, shares in of.explained.items()} for of in identified],
        "rounds": [asdict(one) for one in rounds],
    }
    if dials is not None and rounds:
        drawn = isinstance(plain.options.dial.weights, str)
        record["front"] = forecast_front(actor, made[: options.held_out], FRONT_SETTINGS if drawn else None)
    return record


def forecast_front(
    actor: Actor, held_out: Sequence[LinearizedEpisode], settings: Mapping[str, Mapping[str, float]] | None
) -> dict[str, list[float]]:
    """Forecast of the parts of the lifetime cost under a policy, less those of the base controller alone.

    Fatigue, power and travel by setting, means over the episodes. Settings are factors of the dial by name; None:
    those of the recordings, called "own".
    """
    alone = np.eye(len(DIAL_NAMES)).tolist()

    def parts(one: LinearizedEpisode, offsets: torch.Tensor) -> list[float]:
        return [float(one.cost(offsets, dial=tuple(unit))) for unit in alone]

    dials = {"own": None} if settings is None else {
        name: scaled(chosen.get(of, 1.0) for of in DIAL_NAMES) for name, chosen in settings.items()
    }  # fmt: skip
    with torch.no_grad():
        base = np.array([parts(one, torch.zeros(3, one.steps)) for one in held_out])
        found = {
            name: np.mean([parts(one, one.offsets(actor, dial=dial)) for one in held_out] - base, axis=0)
            for name, dial in dials.items()
        }
    return {name: [float(f"{value:.4g}") for value in values] for name, values in found.items()}


def _actor(policy: Any) -> Actor:
    """Mean actions of observations."""
    return lambda observations: policy.action_net(policy.mlp_extractor.policy_net(observations))


def _between(values: dict[float, dict[str, float]], speed: float) -> dict[str, float]:
    """Metrics at a wind speed, of those at several."""
    at = sorted(values)
    return {name: float(np.interp(speed, at, [values[s][name] for s in at])) for name in values[at[0]]}


class _Work:
    """Recordings of a pretraining."""

    def __init__(
        self, env_id: str, env_kwargs: dict[str, Any], options: PretrainingOptions, execution: Execution
    ) -> None:
        self.env, self._options, self._execution = turbine_env_of(gym.make(env_id, **env_kwargs)), options, execution
        pretraining_episodes.check_environment(self.env)
        if self.env.wind.speeds is None:
            raise ValueError("pretraining needs winds with a mean speed: wind_speed=(low, high)")
        self._speeds, self._say = self.env.wind.speeds, execution.progress
        # limits change no episode: recordings serve every budget
        self._id, self._arguments = env_id, {k: v for k, v in env_kwargs.items() if not k.startswith("cost_limits")}
        self._store = RecordingStore(execution.recordings, RecordedEpisode)

    def before_any_policy(self) -> tuple[Any, list[RecordedEpisode]]:
        """Plants, and episodes under the base controller alone."""
        arguments = {name: v for name, v in self._arguments.items() if not name.startswith("dial_")}
        key = (self._id, json.dumps(arguments, sort_keys=True), json.dumps(asdict(self._options), sort_keys=True))
        if key not in _untrained:
            _untrained.clear()
            _untrained[key] = self.identified(), self.recorded(None, 0)
        return _untrained[key]

    def _record(self, jobs: Sequence[EpisodeJob], what: str) -> list[RecordedEpisode]:
        """Episodes of jobs, in their order; those of a condition run one after the other, with one environment."""
        definitions = [self._definition(job) for job in jobs]
        found = self._store.find_all(definitions)
        recorded, total, began = len(found), len(jobs), time.monotonic()
        self._say(f"{what}: {recorded}/{total} recorded, {self._options.duration:g} s each")
        queue = sorted(((k, job) for k, job in enumerate(jobs) if k not in found), key=lambda job: job[1].condition)
        for (k, _), episode in self._execution.executor.results(_numbered, queue):
            found[k] = episode
            self._store.keep(definitions[k], episode)
            self._execution.check()
            if len(found) % max(total // 8, 1) == 0 or len(found) == total:
                left = (time.monotonic() - began) / (len(found) - recorded) * (total - len(found))
                self._say(f"{what}: {len(found)}/{total}" + (f", about {clock(left)} min left" if left else ""))
        return [found[k] for k in range(total)]

    def _definition(self, job: EpisodeJob) -> dict[str, Any]:
        """Everything on which the numbers of an episode depend."""
        values = {part.name: getattr(job, part.name) for part in fields(job)}
        own = {"fingerprint": self._fingerprint, "parts": [part.name for part in fields(RecordedEpisode)]}
        return {**own, "wind_files": wind_files_of(self._arguments), **described(values)}

    @cached_property
    def _fingerprint(self) -> dict[str, Any]:
        return benchmark_fingerprint(self.env.turbine, self.env.fidelity)

    def _job(self, speed: float, seed: int, condition: Mapping[str, Any], **more: Any) -> EpisodeJob:
        arguments, duration = json.dumps(self._arguments), self._options.duration
        return EpisodeJob(self._id, arguments, speed, seed, duration, condition=json.dumps(condition), **more)

    def in_turns(self, values: Sequence[_T]) -> list[_T]:
        """What each episode of a round has of values by condition."""
        return [values[k % len(values)] for k in range(self._options.episodes)]

    def identified(self) -> tuple[list[_Identified], dict[float, dict[str, float]]]:
        """Conditions, and metrics of the published controller in that of the environment, by wind speed."""
        options, (low, high) = self._options, self._speeds
        count = options.plant_speeds if high > low else 1
        at = tuple(float(v) for v in np.linspace(low, high, count)) if count > 1 else (0.5 * (low + high),)
        first = options.first_wind_seed + options.episodes
        winds = [(v, first + i * options.excited + k) for i, v in enumerate(at) for k in range(options.excited)]
        published = self._record([self._job(v, s, {}, baseline=True) for v, s in winds], "baseline runs")
        baselines = {}
        for i, v in enumerate(at):
            metrics = [self._published(run) for run in published[i * options.excited : (i + 1) * options.excited]]
            baselines[v] = {name: float(np.mean([m[name] for m in metrics])) for name in metrics[0]}
        found: dict[str, _Identified] = {}
        for condition in options.conditions:
            key = json.dumps(condition, sort_keys=True)
            if key not in found:
                found[key] = self._identified(at, winds, condition)
        return [found[json.dumps(condition, sort_keys=True)] for condition in options.conditions], baselines

    def _identified(
        self, at: tuple[float, ...], winds: Sequence[tuple[float, int]], condition: Mapping[str, Any]
    ) -> _Identified:
        options, env = self._options, self.env
        steps = round(options.duration / env.control_dt)
        spans = env.operation.action.pitch_high
        drawn = [
            pretraining_episodes.PlayedActions(
                (excitation_of(env.turbine).draw(steps, env.control_dt, seed) / spans[:, None]).clip(-1.0, 1.0).T
            )
            for _, seed in winds
        ]
        jobs = [self._job(v, s, condition) for v, s in winds]
        jobs += [self._job(v, s, condition, agent=agent) for (v, s), agent in zip(winds, drawn, strict=True)]
        which = f" in {json.dumps(condition)}" if condition else ""
        runs = self._record(jobs, f"identification runs{which}")
        still, moved = runs[: len(winds)], runs[len(winds) :]
        taps = round(options.memory / env.control_dt)

        # the fit of the model is no linear response, and longer than the memory
        slow = [name.startswith("model_") for name in env.layout.observation.names]
        responses, seen, explained = [], [], {}
        for i, v in enumerate(at):
            own = slice(i * options.excited, (i + 1) * options.excited)
            inputs = [run.offsets for run in moved[own]]
            if not all(np.any([np.any(offsets[row]) for offsets in inputs]) for row in range(3)):
                raise ValueError(
                    f"pretraining needs winds in which offsets act, and at {v:g} m/s{which} they have faded out: give "
                    "wind_speed a higher lower end, or leave the condition out"
                )
            pairs = list(zip(moved[own], still[own], strict=True))
            changes = [pretraining_episodes.plant_outputs(a) - pretraining_episodes.plant_outputs(b) for a, b in pairs]
            if not all(change.any() for change in changes):
                raise ValueError(
                    f"pretraining needs winds in which the turbine runs, and at {v:g} m/s{which} offsets change "
                    "nothing: give wind_speed a lower upper end, or leave the condition out"
                )
            found, shares = identify_and_judge(inputs, changes, taps, options.ridge, options.decay)
            explained[v] = dict(zip(pretraining_episodes.OUTPUTS, np.round(shares, 3).tolist(), strict=False))
            responses.append(found)
            if condition:
                outputs = [(a.observations - b.observations).T.astype(float) for a, b in pairs]
                before = [offsets[:, :-1] for offsets in inputs]
                answers = identify(before, outputs, taps, options.ridge, options.decay)
                answers[slow] = 0.0
                seen.append(answers)
            self._say(f"{v:g} m/s: explained " + ", ".join(f"{k} {s:.2f}" for k, s in explained[v].items()))
        loop = Plants(at, np.stack(seen)) if condition else None
        return _Identified(Plants(at, np.stack(responses)), loop, explained)

    def _published(self, run: RecordedEpisode) -> dict[str, float]:
        """Metrics of the published controller [MN m, MW]."""
        skip = round(self._options.skip / run.dt)
        series = (run.flap / 1e6, run.edge / 1e6, run.tower / 1e6, run.pitch, run.platform)
        flap, edge, tower, pitch, platform = map(pretraining_episodes.tensor, series)
        full_rate = self.env.turbine.pitch.max_rate
        found = pretraining_episodes.load_metrics((flap, edge), tower, pitch, run.dt, full_rate, skip, _MAIN, platform)
        power = np.minimum(run.power, self.env.turbine.drivetrain.rated_power)[skip:].mean() / 1e6
        return {name: float(value) for name, value in found.items()} | {"captured_power": float(power)}

    def recorded(self, agent: _Deployed | None, number: int) -> list[RecordedEpisode]:
        """Episodes under a policy, in winds spread evenly over the range of the environment; the first are held out."""
        options = self._options
        low, high = self._speeds
        order = np.random.default_rng(options.first_wind_seed).permutation(options.episodes)
        winds = low + (high - low) * (order + 0.5) / options.episodes
        dials, rng = dial_of(self.env), np.random.default_rng((options.first_wind_seed, number))
        jobs = [
            self._job(
                round(speed, 2), options.first_wind_seed + n, condition, agent=agent,
                dial=None if dials is None else dials.factors(rng),
            )
            for n, (speed, condition) in enumerate(zip(winds.tolist(), self.in_turns(options.conditions), strict=True))
        ]  # fmt: skip
        return self._record(jobs, f"episodes of round {number + 1}")


def _numbered(job: tuple[int, EpisodeJob]) -> RecordedEpisode:
    return pretraining_episodes.record_episode(job[1])


def _costs(actor: Actor, episodes: Sequence[LinearizedEpisode]) -> list[float]:
    """Costs of a policy in episodes, with the factors of a dial that they were recorded with."""
    with torch.no_grad():
        return [float(one.cost(one.offsets(actor))) for one in episodes]


def _travel(actor: Actor, episodes: Sequence[LinearizedEpisode]) -> float:
    """Mean pitch travel of a policy in episodes [rad/s]."""
    with torch.no_grad():
        return float(np.mean([float(one.cost_and_travel(one.offsets(actor))[1]) for one in episodes]))


def _optimized(
    policy: Any,
    made: Sequence[LinearizedEpisode],
    options: PretrainingOptions,
    rng: np.random.Generator,
    execution: Execution,
    budget: _Budget,
    dials: DialTerm | None = None,
) -> tuple[float, float, float, int]:
    """Follow the gradient; keep what is best in the held-out winds, of what is within the budget in all winds.

    With a dial each episode of a batch has other factors, and held-out winds are judged with the same few of each.
    """
    actor, held, fitted = _actor(policy), made[: options.held_out], made[options.held_out :]
    judges = np.random.default_rng(options.first_wind_seed)
    judged: list[tuple[float, ...] | None] = [None]
    if dials is not None:
        judged = [dials.factors(judges) for _ in range(_JUDGED * options.held_out)]
    parts = [*policy.mlp_extractor.policy_net.parameters(), *policy.action_net.parameters()]
    optimizer = torch.optim.AdamW(parts, lr=options.learning_rate, weight_decay=options.weight_decay)
    schedule = torch.optim.lr_scheduler.OneCycleLR(
        optimizer, 2.0 * options.learning_rate, total_steps=options.iterations, pct_start=0.1
    )
    exponents = (options.blade_exponent, options.tower_exponent)

    def mean_cost(episodes: Sequence[LinearizedEpisode]) -> float:
        with torch.no_grad():
            several = max(len(judged) // max(len(episodes), 1), 1)
            pairs = [(one, judged[(several * k + j) % len(judged)]) for k, one in enumerate(episodes)
                     for j in range(several)]  # fmt: skip
            return float(np.mean([float(one.cost(one.offsets(actor, dial=d), dial=d)) for one, d in pairs]))

    recorded = mean_cost(held)
    best = (budget.overdrawn(actor, made), recorded, 0, [part.detach().clone() for part in parts])
    every = max(options.iterations // 10, 1)
    for number in range(1, options.iterations + 1):
        traveled = []
        for k in rng.choice(len(fitted), min(options.batch, len(fitted)), replace=False):
            one, dial = fitted[k], None if dials is None else dials.factors(rng)
            cost, travel = one.cost_and_travel(one.offsets(actor, options.noise, dial), exponents, dial)
            (budget.lagrangian(cost, travel) / options.batch).backward()
            traveled.append(float(travel.detach()))
        budget.update(float(np.mean(traveled)))
        torch.nn.utils.clip_grad_norm_(parts, 0.5)
        optimizer.step()
        optimizer.zero_grad()
        schedule.step()
        execution.check()
        if number % every == 0 or number == options.iterations:
            now, beyond = mean_cost(held), budget.overdrawn(actor, made)
            more = f", {DAY * beyond:.0f} rad/d beyond the budget" if math.isfinite(budget.limit) else ""
            execution.progress(f"iteration {number}: {100 * now:+.2f} % of the cost in held-out winds{more}")
            if (beyond, now) < best[:2]:
                best = (beyond, now, number, [part.detach().clone() for part in parts])
    with torch.no_grad():
        for part, kept in zip(parts, best[3], strict=True):
            part.copy_(kept)
    return recorded, best[1], mean_cost(fitted[: options.held_out]), best[2]
